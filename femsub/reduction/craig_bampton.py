"""Hurty/Craig-Bampton: constraint modes and fixed-interface modes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.sparse as sp

from femsub.algebra import FEW, ROUNDING, SUMS, divided, fork_pays, one_thread, without
from femsub.checks import EPS, Array, ConditionWarning, InputError, Matrix, warn
from femsub.model import Substructure, annihilates_a_translation, bare, costs, loose_by_places, rounding, soft_springs, units
from femsub.modes import IN_PARTS, ShiftInvert, motion_of
from femsub.reduction.basis import Partition, Statics, zeros
from femsub.reduction.method import DIGITS, Method


@dataclass(frozen=True)
class CraigBampton(Method):
    """Hurty/Craig-Bampton (HCB): constraint modes of the interface, and modes with the interface fixed.

    V = [[I, 0], [Ψ, Φ]], Ψ = -K_ii⁻¹ K_ib (n_i, n_b), (K_ii - ω²M_ii) φ = 0, Φᵀ M_ii Φ = I (n_i, m).

    The blocks are shown in the order (interface, interior); the rows of V follow the component's own numbering. The first
    n_b coordinates are the interface displacements. ``reduce(..., ports=True)`` adds the static responses K_ii⁻¹ w_i to
    the ports, made orthogonal to Φ.

    Parameters
    ----------
    modes : int
        Number m of fixed-interface modes.
    band : (lo, hi), with tol : float
        Instead of `modes`: the smallest number for which every mode from lo to hi (radians per unit of time) is
        estimated to be within the relative error `tol`, and hi is below 0.7 of the cut-off; see `reduce`.

    Raises
    ------
    InputError, InputTypeError
        Neither `modes` nor `band` with `tol`, or both; a negative or non-integer number of modes; tol outside (0, 1).

    References
    ----------
    R. R. Craig, M. C. C. Bampton, AIAA J. 6 (1968) 1313; W. C. Hurty, AIAA J. 3 (1965) 678; the paper, eqs. (9)-(15).

    Examples
    --------
    >>> import femsub as fs
    >>> sub = fs.chain(10, belt=1)
    >>> fs.reduce(sub, fs.CraigBampton(modes=4)).kinds
    ('constraint', 'fixed-interface', 'fixed-interface', 'fixed-interface', 'fixed-interface')
    """

    key, label, colour, marker = "craig-bampton", "Craig-Bampton", "#c44e00", "s"
    held = True

    def part(self, sub: Substructure) -> Partition:
        """The interior. If the positions of the DOF show that the interface does not hold the part, this is an error at once."""
        if loose := loose_by_places(sub, sub.interface):
            raise _not_held(sub, loose)
        return Partition.of(sub, self.held)

    def statics(self, part: Partition, handle: ShiftInvert, extra: Array) -> Statics:
        """Constraint modes with their stiffness, and the port columns whose static responses join the basis."""
        sub, b = part.sub, part.sub.interface
        if handle.floating and len(b):
            raise _not_held(sub, handle.rigid.shape[1])
        forked = fork_pays(handle.factor, len(b))
        C = zeros(sub.size, len(b), extra.shape[1] + (len(b) if self.modes is None else self.modes), forked)
        C[b, np.arange(len(b))] = 1.0
        condensed = zeros(len(b), len(b), 0, forked)
        # a method with a `kept` of its own computes its modes later, and a system chooses the modes of all its parts together
        search = partial(self.sought, handle) if part.alone and type(self).kept is Method.kept else None
        sought = divided(_constraint_modes(handle, sub, C, condensed), len(b), forked, search)
        with handle.sharing:
            condensed, rigid = condensed_stiffness(sub, condensed, C)
        return Statics(part, handle, C, condensed, extra[part.rows], "static port", rigid, sought)


def _not_held(sub: Substructure, count: int) -> InputError:
    return InputError(f"the interface does not hold {sub.name!r}: with its {len(sub.interface)} DOF fixed, {count} rigid-body "
                      "modes remain. Craig-Bampton's constraint modes need a held component. Add interface DOF, or use "
                      "CraigChang")


def condensed_stiffness(sub: Substructure, condensed: Array, constraint: Array) -> tuple[Array, Array]:
    """ΨᵀKΨ for the constraint modes, with exactly 0 for rigid motion; and the rigid motions of the interface (n_b, k).

    If the component carries its rigid motions, these are used. Otherwise they are found from its K:

    For a floating component ΨᵀKΨ is the small difference of large forces. If the interface just holds the component
    (the two DOF at one end of a beam), the exact result is 0, and rounding of either sign would look like a stiffness.
    Two formulas for the same matrix, K_bb + K_bi Ψ and ΨᵀKΨ, show how many digits are correct. A DOF without stiffness in K
    (beyond rounding) moves alone: all other entries of its constraint mode become 0. Parts joined later may hold this DOF.
    """
    condensed = (condensed + condensed.T) / 2
    unit = units(sub.K)[sub.interface]
    if not condensed.size:
        return condensed, np.zeros((0, 0))
    loose = bare(sub.K, sub.interface)
    if loose.any():
        condensed[loose], condensed[:, loose] = 0.0, 0.0
        constraint[np.ix_(sub.interior, loose)] = 0.0
    if (motion := motion_of(sub.rigid_motion)) is not None:
        rigid_motions = motion.shapes[sub.interface]
        return without(condensed, rigid_motions, unit), rigid_motions
    own, alone = np.flatnonzero(~loose), np.eye(len(loose))[:, loose]
    rows: Array | slice = slice(None)
    if loose.any():
        constraint, unit, rows = constraint[:, own], unit[own], np.setdiff1d(np.arange(sub.size), sub.interface[loose])
    with one_thread(len(own) <= FEW):
        values, vectors = np.linalg.eigh(unit[:, None] * condensed[np.ix_(own, own)] * unit)
    doubtful = np.flatnonzero(values <= DIGITS)  # eigenvalues of the scaled matrix that may be rounding
    # ten times the limit of rigid-body modes: constraint modes also contain the rounding of their solve
    ratio = costs(sub.K, constraint @ (unit[:, None] * vectors[:, doubtful]))[0] if len(doubtful) else doubtful
    rigid = doubtful[ratio < 10 * ROUNDING]
    block = np.ix_(own, own)
    motions = np.zeros((len(loose), len(rigid)))
    # In three cases the ratio of the force |Kx| to |K||x| does not show which motions are rigid: K was written with few digits,
    # the part is held but long and slender, or a soft spring is stretched. Elastic modes may then have a ratio as small.
    near = ratio[ratio < 10 * ROUNDING]
    if len(doubtful) and (rounding(sub.K) > EPS or soft_springs(sub.K, rounding(sub.K)).nnz or (
            len(near) and near.max() > SUMS and not annihilates_a_translation(sub.K))):
        Z = ShiftInvert(sub.K, sub.M, rows).rigid  # from the whole K, by subspace iteration
        motions = np.zeros((len(loose), Z.shape[1]))
        motions[own] = Z[sub.interface[own] if isinstance(rows, slice) else np.searchsorted(rows, sub.interface[own])]
        condensed[block] = without(condensed[block], motions[own], unit)
    elif len(rigid):
        values[rigid] = 0.0
        kept = (vectors / unit[:, None] * values) @ (vectors / unit[:, None]).T
        condensed[block] = (kept + kept.T) / 2
        motions[own] = unit[:, None] * vectors[:, rigid]
    soft = doubtful[np.argsort(values[doubtful], kind="stable")[motions.shape[1]:][:1]]
    moved = np.abs(constraint @ (unit[:, None] * vectors[:, soft]))
    doubt = EPS * float(np.vdot(moved, abs(sub.K) @ moved))
    if motions.shape[1] and len(soft) and doubt > DIGITS * (share := float(values[soft[0]])):
        warn(f"the condensed stiffness of {sub.name!r} has an elastic motion with a relative stiffness of only {share:.0e}, and "
             f"rounding may change this value by {doubt:.0e}. {IN_PARTS}", ConditionWarning)
    elif len(rigid) and not motions.shape[1]:
        lost = np.abs(constraint.T @ (sub.K @ constraint) - condensed[block]).max() / np.abs(condensed).max()
        if lost > DIGITS:
            warn(f"the condensed stiffness of {sub.name!r} is inaccurate: two formulas for it differ by {lost:.1e} "
                 "(relative). Its elements are much stiffer than the component as a whole. Coarsen the mesh",
                 ConditionWarning)
    return condensed, np.hstack([motions, alone])


def _constraint_modes(handle: ShiftInvert, sub: Substructure, V: Array, condensed: Array) -> Callable[[slice], None]:
    """A function that writes given columns of Ψ = -K_ii⁻¹K_ib into V (interior rows), and of K_bb + K_bi Ψ into `condensed`."""
    b, i, factor = sub.interface, sub.interior, handle.factor
    columns = sub.K[:, b]

    def full(A: Matrix) -> Array:
        return A.toarray(order="F") if sp.issparse(A) else A

    Kib, Kbb = columns[i], full(columns[b])

    def solve(part: slice) -> None:  # overwrites columns that another process left unfinished
        answers = factor.solve(-full(Kib[:, part]))
        V[i, part] = answers
        condensed[:, part] = Kbb[:, part] + Kib.T @ answers

    return solve
