"""The table of an audit's checks, and the loop that runs them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from femsub.checks import EQUAL
from femsub.studies import audit_figures as see
from femsub.studies.audit_case import Case
from femsub.studies.audit_figures import FAULT, GOOD, Finding, Seen, Sight
from femsub.studies.audit_model import AGREE, SHAPED


class Check(NamedTuple):
    """One check.

    Attributes
    ----------
    what : str
    needs : str
        What a case must have (`Case.has`), in words: 'full, V'. Else the check is left out.
    figure : callable
        Of a case: the figure, or a finding that no limit decides, or None where the check does not apply.
    limit : float, optional
        The figure up to which it is good; without one any above 0 is a fault, and no figure is shown.
    said, todo : str
        The sentence of a fault and the advice, filled with the words of the figure.
    stops : bool
        Whether nothing else is checked after a fault.
    """

    what: str
    needs: str
    figure: Callable[[Case], Sight]
    limit: float | None
    said: str
    todo: str
    stops: bool = False

    def run(self, case: Case) -> Finding | None:
        """The finding of a case."""
        seen = self.figure(case)
        if isinstance(seen, Finding):
            return replace(seen, what=self.what)
        if not isinstance(seen, Seen):
            return None
        figure = None if self.limit is None else float(seen.figure)
        if seen.figure <= (self.limit or 0.0):
            return Finding(self.what, GOOD, "", figure, self.limit)
        return Finding(self.what, FAULT, self.said.format(**seen.words), figure, self.limit, self.todo.format(**seen.words))


#: what is said of several
LEFT_OUT = "Take matrices and lists of one and the same model. Nothing else was checked"
STRAINED = "rigid motion strains nothing"
LOOK = "Look at the {} of coordinate {{at}}: a sign, an entry that is lost, or columns in another order"
TRIANGLES = "Write both triangles, and the same ones; half of a symmetric file may have been read"
PLACE = "{} between interface DOF {{i}} and {{j}} is {{own:.6g}}, but {{there:.6g}} in the full model{{factor}}"
ENTRY = "{0}[{{i}}, {{j}}] is {{own:.6g}}, but {1} gives {{there:.6g}}{{factor}}"
BELOW = "modes below the cut-off"
OTHERS = "M, K or both are of another model, or in other units"

CHECKS = (
    Check("entries are numbers", "", see.not_numbers, None, "{key} holds a NaN or Inf, first at row {row}, column {column}",
          "Write the matrices again. Nothing else was checked", stops=True),
    Check("sizes fit", "", see.misfits, None, "{wrong}", LEFT_OUT, stops=True),
    Check("same full model", "full", see.other_model, None, "{wrong}", "The reduction is of another model", stops=True),
    # the small matrices
    Check("digits", "", see.rounded, 1e-8, "the entries of {key} end after about {digits:.0f} digits",
          "Write them with all digits (17): low modes and rigid motion are small differences of large entries"),
    Check("M symmetric", "", partial(see.skew, "M"), EQUAL, "M[{i}, {j}] = {one:.6g}, but M[{j}, {i}] = {other:.6g}", TRIANGLES),
    Check("K symmetric", "", partial(see.skew, "K"), EQUAL, "K[{i}, {j}] = {one:.6g}, but K[{j}, {i}] = {other:.6g}", TRIANGLES),
    Check("M positive", "", partial(see.negative, "M"), EQUAL,
          "M has a negative eigenvalue, mostly in coordinate {at}: some motion has negative kinetic energy", LOOK.format("mass")),
    Check("K positive", "", partial(see.negative, "K"), EQUAL,
          "K has a negative eigenvalue, mostly in coordinate {at}: energy would be won by a deformation",
          LOOK.format("stiffness")),
    Check("coordinates independent", "", see.dependent, EQUAL, "", ""),
    Check("D symmetric", "D", see.gyroscopic, EQUAL, "a share of {share:.1e} of D is skew, and the part is not said to turn",
          "If it turns, state it (gyroscopic); else an entry is lost, or a triangle is"),
    Check("D takes energy out", "D", see.feeding, EQUAL,
          "D has a negative eigenvalue, mostly in coordinate {at}: it feeds energy in",
          "Look at its sign. Friction with a falling characteristic belongs to a contact, not to D"),
    Check("modes orthonormal", "", see.unlike_modes, AGREE, "ΦᵀMΦ is not I, or ΦᵀKΦ is not diagonal: {why}",
          "Normalise the modes to mass 1, the matrices with them; modes that are not orthogonal have not converged"),
    Check("modes and interface share no stiffness", "", see.shared_stiffness, AGREE,
          "ΨᵀKΦ is not 0 between constraint modes Ψ and fixed-interface modes Φ",
          "The constraint modes are not the static response of this K: compute them again, K_ii Ψ_i = -K_ib"),
    # what the full model decides better where it is known
    Check("no mode twice", "alone, no V", see.alike_modes, None, "", ""),
    Check(STRAINED, "alone", see.carried_strain, EQUAL, "the rigid motion that the model carries has an elastic energy",
          "K has been changed, or grounded by a spring, since it was reduced"),
    Check(STRAINED, "alone", see.mapped_strain, EQUAL, "", ""),
    Check("mass and inertia", "alone", see.unlike_body, AGREE,
          "the masses along x, y, z are {masses}, or moments do not fit a rigid body",
          "Mass is lost, DOF are swapped, or rotations have other units than translations"),
    Check("mass as stated", "alone", see.other_mass, 0.01, "the mass is {mass:.6g}, but {stated:.6g} is stated{factor}",
          "Check density and units"),
    Check("units fit", "alone", see.implausible, None, "", ""),
    # against the full model
    Check("interface list", "full", see.other_interface, None, "{why}", "Take the list that the reduction was made with"),
    Check("V moves the interface", "full, V", see.unmoved_interface, AGREE,
          "V does not move interface DOF {bad} by one with their coordinates",
          "The interface list, its order or a sign is not that of V"),
    Check("M = VᵀMV", "full, V, projected", partial(see.unlike_projection, "M"), AGREE, ENTRY.format("M", "VᵀMV"), "{advice}"),
    Check("M = VᵀMΦΦᵀMV", "full, V, massless", partial(see.unlike_projection, "M"), AGREE, ENTRY.format("M", "VᵀMV"), "{advice}"),
    Check("K = VᵀKV", "full, V", partial(see.unlike_projection, "K"), AGREE, ENTRY.format("K", "VᵀKV"), "{advice}"),
    Check("D = VᵀDV", "full, V", partial(see.unlike_projection, "D"), AGREE, ENTRY.format("D", "VᵀDV"), "{advice}"),
    Check("frequencies of the shapes stated", "full, no V", see.other_spectrum, AGREE,
          "frequency {mode} of all {count} is {own:.6g}, but {there:.6g} in the span of the shapes that the kinds name",
          "An entry of M or K is wrong, or the coordinates are not what their kinds say"),
    Check("static interface response", "full", see.unlike_statics, AGREE, PLACE.format("the condensed stiffness"), "{guess}"),
    Check("inertia seen from the interface", "full", see.unlike_inertia, AGREE, PLACE.format("the mass of static shapes"),
          "{guess}"),
    Check("damping seen from the interface", "full", see.unlike_damping, AGREE, PLACE.format("the damping of static shapes"),
          "{guess}"),
    Check("V has the rigid motion", "full", see.missing_motion, AGREE, "a share of {left:.2g} of it is missing",
          "Add rigid-body modes or constraint modes to the basis"),
    Check(STRAINED, "full", see.moved_strain, EQUAL,
          "the full model has {count} rigid motions, which have an elastic energy in the reduced one",
          "A spring to the ground, swapped or turned DOF, or entries with few digits"),
    Check("mass and inertia", "full", see.other_inertia, AGREE,
          "of rigid motion, the reduced model has {masses} times the full model's{factor}",
          "Mass is lost or counted twice, the density is another one, or units are"),
    Check(BELOW, "full", see.uncounted, 0.0,
          "the full model has {counted} modes below the stated cut-off {cut:.6g} rad/time, the reduced one {listed}", "{advice}"),
    Check("modes converged", "full", see.unconverged, AGREE,
          "mode {mode} of the reduced model is none of the full one: ω² is off by {off:.1e}",
          "Compute it again with a tighter tolerance; or the model is reduced from other matrices, or its coordinates are no "
          "modes: state their kinds"),
    Check("coupling of modes and interface (M_bi)", "full", see.unlike_coupling, SHAPED,
          "the part of the modes near ω = {omega:.6g} in motions of the interface is not the full model's",
          "The block M_bi is lost, transposed or scaled, or its columns are in another order than the modes"),
    Check("frequencies not below the full model's", "full, projected", see.lowered, AGREE,
          "mode {mode} has ω = {own:.6g}, but {there:.6g} in the full model; no projection lowers it", OTHERS),
    Check("frequencies within their bounds", "full", see.unbounded, AGREE,
          "elastic mode {mode} of the full model has ω = {there:.6g}, below the bound {bound:.6g} by the stated cut-off",
          "The cut-off is not what is stated, or the matrices are not those of this model"),
    # what nobody can know
    Check(BELOW, "alone", see.unseen_modes, None, "", ""),
    Check("frequencies", "", see.unknown_frequencies, None, "", ""))


def findings(case: Case) -> tuple[Finding, ...]:
    """Runs the checks that a case has all for, in their order."""
    found = []
    for check in CHECKS:
        if check.needs and not set(check.needs.split(", ")) <= case.has:
            continue
        one = check.run(case)
        if one is None:
            continue
        found.append(one)
        if one.verdict == FAULT:
            case.sound &= "full" in check.needs
            case.stopped = check.stops
            if check.stops:
                break
    return tuple(found)
