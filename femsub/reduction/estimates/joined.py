"""Error estimates of joined parts: one `Nested` for the whole system, from the factors of its parts.

With all interfaces held, the modes of a system are those of its parts. U = [C Φ Ξ] holds the joined constraint modes C, and Φ
and Ξ of all parts. In these coordinates `nested` treats the system as one component. No matrix of the whole system is factorised.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
import scipy.sparse as sp

from femsub.algebra import QUADRATIC
from femsub.checks import DENSE, EPS, Array, InputError, instance
from femsub.coupling import System, couple, linked, rows_of_parts, sprung
from femsub.model import Contacts, Estimate, ReducedSubstructure, Substructure, contacts_of, small_matrices, upper
from femsub.modes import all_modes, complex_modes, motion_of
from femsub.reduction.basis import Statics
from femsub.reduction.craig_bampton import CraigBampton
from femsub.reduction.estimates.found_modes import FoundModes, Span
from femsub.reduction.estimates.nested import JOINED_RESIDUAL, Nested
from femsub.reduction.estimates.search import Goal, ReferenceModel, Space

ENOUGH = 0.3  # the error of the largest model may be this share of the error of a model judged by it, or of the tolerance


@dataclass(frozen=True, eq=False, repr=False)
class Image(Substructure):
    """A part in the coordinates of its U = [C Φ Ξ], with the interface, the sets and the ports of the part itself."""

    part: Substructure = field(init=False)

    def __init__(self, sub: Substructure, nested: Nested, span: Span) -> None:
        ports = {name: span.dot(w.reshape(sub.size, -1)) for name, w in sub.ports.items()}
        M, K, D = (A if A is None else sp.csr_array(A) for A in (nested.M, nested.K, nested.D))  # C apart, they are diagonal
        super().__init__(M, K, D, range(nested.constraint), ports, sub.name, sets=sub.sets)
        self._carry(nested.motion, self.noise)
        self._set(part=sub, interface_dofs=sub.interface_dofs)

    @property
    def interface_numbers(self) -> Array:
        """The interface numbers of the part itself."""
        return self.part.interface_numbers


class JoinedSpace(Space):
    """The modes found so far of all parts that are reduced; the other parts keep all their DOF."""

    def __init__(self, system: System, statics: Mapping[str, Statics], contacts: Contacts = None,
                 top: float = np.inf, given: Mapping[str, int] = MappingProxyType({})) -> None:
        pencil, self.system = system.linearised(contacts, structural=True), system
        self.damped, self.symmetric = pencil.norms[1] > 0, pencil.symmetric[1]
        self.all = damped_parts(system, contacts)
        whole = {name: part.size for name, part in system.parts.items() if name not in statics}
        most = QUADRATIC if self.damped else DENSE  # LAPACK computes the λ of all these DOF
        if sum(whole.values()) > most:
            raise InputError(f"no estimate is possible for {system.name!r}: its parts that are not reduced have "
                             f"{sum(whole.values())} DOF, {max(whole, key=lambda name: whole[name])!r} most of them, and at most "
                             f"{most} are allowed. Reduce them, too")
        self.enough = 1.0 if given else ENOUGH
        super().__init__(f"the parts of {system.name!r}", {name: FoundModes(one, self.all[name].pencil if self.damped else None)
                                                           for name, one in statics.items()}, top, given)

    def growth(self, reference: Nested, best: Estimate) -> float:
        """A constant factor: the decrease of the error is not extrapolated, since the parts differ."""
        return 2.0

    def assembled(self, own: Mapping[str, tuple[Nested, Span]]) -> ReferenceModel:
        """The joined matrices in the order [C Φ Ξ]."""
        images = dict(self.all) | {name: Image(self.all[name], nested, span) for name, (nested, span) in own.items()}
        joined = couple(images, self.system.joints, self.system.name, interface=[])
        rows = dict(zip(images, rows_of_parts(images), strict=True))
        moved = sprung(images, [linked(joint, images) for joint in self.system.joints])
        L, modes, rests = sp.csr_array(joined.L), [], []
        for name, (nested, _) in own.items():
            later = np.arange(rows[name].start + nested.constraint, rows[name].stop)
            if moved[later].any():
                raise InputError(f"no estimate is possible for {self.system.name!r}: a spring or damper acts on a port inside "
                                 f"{name!r}. Put that port's DOF into the interface")
            inner = L[later].indices  # one coordinate of the system each: no joint acts on them
            modes.append(inner[:nested.modes])
            rests.append(inner[nested.modes:])
        within = np.concatenate([*modes, *rests])
        outside = np.setdiff1d(np.arange(joined.size), within)
        order, count, dense = np.concatenate([outside, within]), len(outside), joined.pencil.dense()
        M, K, D = (A[np.ix_(order, order)] for A in (dense.M, dense.K, dense.D))
        turns = {name: L[rows[name]].toarray()[:, order] for name in own}
        motion = motion_of(joined.rigid_motion)
        # a diagonal R with |xᵀEx| ≤ xᵀRx for every E whose entries are at most EPS times those of K. R matters if a floating
        # stiff part meets a soft one: rounding then affects the sum of their stiffnesses and the rigid motion of the stiff part
        bare, size = K.diagonal()[:count], np.abs(K[:count, :count])
        unit = np.sqrt(np.where(bare > 0, bare, 1.0))
        rounding = np.diag(EPS * unit * (size @ (1 / unit)))
        for name, (nested, _) in own.items():
            C = turns[name][:nested.constraint, :count]
            rounding += C.T @ nested.rounding @ C
        forces = [turns[name].T @ nested.loads for name, (nested, _) in own.items()]
        values = np.concatenate([nested.values for nested, _ in own.values()])
        found = Nested(M, K, D if self.damped else None, count, 0, values, np.hstack(forces), rounding, self.symmetric,
                       max(nested.lightest for nested, _ in own.values()),
                       tuple((len(a), len(b)) for a, b in zip(modes, rests, strict=True)), self.limit,
                       None if motion is None else replace(motion, shapes=motion.shapes[order]), 1.0)
        return ReferenceModel(found, own, turns)


def held_statics(sub: Substructure) -> Statics:
    """The factor and the constraint modes of a part with its interface held, as Craig-Bampton makes them."""
    method = CraigBampton(modes=0)
    part = method.part(sub)
    return method.statics(part, part.factored(), np.zeros((sub.size, 0)))


def damped_parts(system: System, contacts: Contacts) -> dict[str, Substructure]:
    """The parts with the damping of the contacts on their ports.

    Raises
    ------
    InputError
        A contact acts between parts, or adds stiffness.
    """
    found = dict(system.parts)
    for contact in contacts_of(contacts):
        ports, sets = contact.ports, tuple(getattr(contact, "sets", ()))
        owner, *more = {name.partition(".")[0] for name in (*ports, *sets)}
        if more or system.linearised(contact, structural=True).K is not system.pencil.K:
            raise InputError(f"no estimate is possible for {system.name!r} under {contact!r}: it takes contacts that add to D "
                             "alone, each on one part, such as belts. Leave the contact out, or give numbers of modes")
        part = found[owner]
        columns = [part.port(name.partition(".")[2]).reshape(part.size, -1) for name in ports]
        columns += [part.interface_rows[part.sets[name.partition(".")[2]]].T for name in sets]
        W = sp.csc_array(sp.hstack(columns)) if sets else np.hstack(columns)
        found[owner] = part.with_damping(part.pencil.with_contact(small_matrices(system, contact)[1], W).D)
    return found


def system_estimate(full: System, rom: System, band: tuple[float, float], contacts: Contacts = None, *,
                    tol: float = 0.01) -> Estimate:
    """Errors of ω and λ of a system in a band, caused by the reductions of all its parts, without solving the full system.

    The parts may be reduced by any method. Each ω of the full system has an upper and a lower bound. A larger model, with more
    modes and static shapes for held interfaces, gives the upper bound; `Nested.bounds` gives the lower one. Both need the factors
    of the parts with held interfaces, which Craig-Bampton and Hurty have made already. The errors of ω are therefore bounds. The
    errors of λ are estimates of first order (`Nested.doubt`).

    Parameters
    ----------
    full : System
        The system before its parts were reduced.
    rom : System
        ``reduce(full, {...})``, or the same parts joined otherwise than by `reduce`.
    band : (lo, hi)
        Radians per unit of time.
    contacts : Belt or another contact, or a sequence of them, optional
        Contacts under which λ is judged. They add to D, each on one part. Without damping and contacts, no errors of λ are given.
    tol : float
        The relative error that ``.met`` allows.

    Returns
    -------
    Estimate

    Raises
    ------
    InputError, InputTypeError
        The systems have different parts, or are the same; a part is not held by its interface; a spring acts on a port inside a
        part; full parts have more than 3,000 DOF in total; a contact adds stiffness, or acts between parts.

    Examples
    --------
    >>> import femsub as fs
    >>> parts = {"a": fs.chain(20, interface=[20]), "b": fs.chain(30, interface=[1], fixed=False)}
    >>> full = fs.couple(parts, [fs.Rigid(("a", [19]), ("b", [0]))])
    >>> rom = fs.reduce(full, {"a": fs.CraigBampton(4), "b": fs.Rubin(4)}, ports=True)
    >>> fs.system_estimate(full, rom, (0, 0.2)).met
    True
    """
    goal = Goal(band, tol)
    instance("full", full, System, "whose parts were reduced")
    instance("rom", rom, System, "made of the reduced parts")
    parts: dict[str, Substructure] = {}  # the full ones that are reduced in `rom`
    for name in [*full.parts, *rom.parts]:
        one, other = full.parts.get(name), rom.parts.get(name)
        size = other.V.shape[0] if isinstance(other, ReducedSubstructure) else getattr(other, "size", 0)
        if one is None or size != (one.V.shape[0] if one is other and isinstance(one, ReducedSubstructure) else one.size):
            raise InputError(f"{rom.name!r} is not {full.name!r} with reduced parts: {name!r} is missing in one of them, or its "
                             "size differs")
        if one is not other:
            parts[name] = one
    statics = {name: held_statics(part) for name, part in parts.items() if len(part.interior)}
    if not statics:
        raise InputError(f"no part of {rom.name!r} is reduced: it is {full.name!r} itself")
    space, small = JoinedSpace(full, statics, contacts, goal.band[1]), rom.pencil.dense()
    space.reach(goal.band[1])
    found = all_modes(small.K, small.M, JOINED_RESIDUAL, rom.rigid_motion)
    omega, rounding = found.elastic, found.rounding[found.rigid:]
    values = None
    if space.damped:
        modes = complex_modes(rom.linearised(contacts, structural=True).dense())
        keep = upper(modes.eigenvalues) & ~modes.rigid & (modes.eigenvalues != 0)
        values = modes.eigenvalues[keep], modes.error_bar[keep]
    while True:
        given = space.reference()
        nested = given.nested
        judged = nested.judged(omega, omega * rounding / 2, None, goal.band, tol)
        sharp = _sharp(nested.estimate(nested.most, goal.band, tol, False), judged)
        if space.damped and (sharp or space.spent):
            nested = space.extended(given, goal.band)
            judged = nested.judged(omega, omega * rounding / 2, values, goal.band, tol)
            sharp = _sharp(nested.estimate(nested.most, goal.band, tol), judged)
        if sharp or space.spent:
            kept = sum(part.modes for part in rom.parts.values() if isinstance(part, ReducedSubstructure))
            return replace(judged, modes=kept, cutoff=rom.cutoff)
        for part in space.parts.values():
            part.grow(int(np.ceil(1.5 * part.modes)) + 1)


def _sharp(largest: Estimate, judged: Estimate) -> bool:
    """Whether the truncation error of the largest model is negligible beside every error of the judged model."""
    if len(largest.frequencies) != len(judged.frequencies) or largest.unmatched:
        return judged.unmatched > 0
    # errors below a thousandth of the tolerance need not be known to two digits
    fine = largest.frequency_error <= ENOUGH * np.maximum(judged.frequency_error, 1e-3 * judged.tol)
    return bool(fine.all()) and largest.eigenvalue_error.max(initial=0.0) <= ENOUGH * max(judged.worst, judged.tol)
