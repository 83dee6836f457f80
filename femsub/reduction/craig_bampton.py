"""Hurty/Craig-Bampton: constraint modes and fixed-interface modes."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array
from femsub.errors import ConditionWarning, InputError
from femsub.modes.shift_invert import RIGID, ShiftInvert, annihilates_a_translation, rounding_ratio, units
from femsub.reduction.method import Method
from femsub.reduction.statics import COLUMNS, Partition, Statics, square, zeros

if TYPE_CHECKING:
    from femsub.model.substructure import Substructure

DIGITS = 1e-4  # of the condensed stiffness that rounding may take before `reduce` warns
CLEAR = 4e-15  # up to here it is rounding, beyond any doubt (see `rounding_ratio`)
SOFT = 1e-4  # condensed stiffness, relative to that of the interface with all else fixed, that may be rounding


@dataclass(frozen=True)
class CraigBampton(Method):
    """V = [[I, 0], [Ψ, Φ]], Ψ = -K_ii⁻¹ K_ib (n_i, n_b), (K_ii - ω²M_ii) φ = 0, Φᵀ M_ii Φ = I (n_i, m).

    Shown in the order (interface, interior); the rows of V follow the component's own numbering. The first n_b
    coordinates are the interface displacements themselves. With `ports=True` the static responses K_ii⁻¹ w_i join,
    made orthogonal to Φ.

    Parameters
    ----------
    modes : int
        Number m of fixed-interface modes.
    band : (lo, hi), with tol : float
        Instead of `modes`: the fewest with which every mode from lo to hi, in radians per unit of time, is estimated to
        be within the relative error `tol`, and hi is below 0.7 of the cut-off; see `reduce`.

    References
    ----------
    R. R. Craig, M. C. C. Bampton, AIAA J. 6 (1968) 1313; W. C. Hurty, AIAA J. 3 (1965) 678; the paper, eqs. (9)-(15).
    """

    key, label, colour, marker = "craig-bampton", "Craig-Bampton", "#c44e00", "s"
    held = True

    def statics(self, part: Partition, handle: ShiftInvert, extra: Array) -> Statics:
        """Constraint modes with their stiffness; of static responses those to the ports that were asked for."""
        sub, b = part.sub, part.sub.interface
        if handle.floating and len(b):
            raise InputError(
                f"the interface does not hold {sub.name!r}: with its {len(b)} DOF fixed, {handle.rigid.shape[1]} rigid-body "
                "modes remain, and constraint modes do not exist; add interface DOF, or use CraigChang")
        C = zeros(sub.size, len(b), extra.shape[1] + (len(b) if self.modes is None else self.modes))
        C[b, np.arange(len(b))] = 1.0
        return Statics(part, handle, C, _condensed(sub, _constraint_modes(handle, sub, C), C), extra[part.rows], "static port")


def _condensed(sub: Substructure, condensed: Array, constraint: Array) -> Array:
    """ΨᵀKΨ for the constraint modes, with exactly 0 for rigid motion.

    Of a floating component it is what large forces leave when they cancel. On an interface that just holds it (the two
    DOF at one end of a beam) nothing is left but rounding, of either sign, which nobody could tell from stiffness later.
    Where much cancels, two formulas for the same stiffness, K_bb + K_bi Ψ and ΨᵀKΨ, tell what is left of its digits.
    """
    condensed = (condensed + condensed.T) / 2
    if not condensed.size:
        return condensed
    unit = units(sub.K)[sub.interface]
    values, vectors = np.linalg.eigh(unit[:, None] * condensed * unit)
    doubtful = np.flatnonzero(values <= SOFT)
    if not len(doubtful):
        return condensed
    # constraint modes carry the rounding of their solve, which rigid shapes have been cleaned of
    ratio = rounding_ratio(sub.K, constraint @ (unit[:, None] * vectors[:, doubtful]))
    rigid = doubtful[ratio < 10 * RIGID]
    if not len(rigid):
        return condensed
    if ratio[ratio < 10 * RIGID].max() > CLEAR and not annihilates_a_translation(sub.K):
        # A long slender part that is held looks much the same: ask K itself.
        rigid = rigid[:ShiftInvert(sub.K, sub.M).rigid.shape[1]]
    if not len(rigid):
        lost = np.abs(constraint.T @ (sub.K @ constraint) - condensed).max() / np.abs(condensed).max()
        if lost > DIGITS:
            warnings.warn(f"the condensed stiffness of {sub.name!r} has lost its digits: two formulas differ by {lost:.1e}, "
                          "since the stiffness of its elements is so much larger; take fewer elements, or larger ones",
                          ConditionWarning, stacklevel=5)
        return condensed
    values[rigid] = 0.0
    vectors = vectors / unit[:, None]
    kept = (vectors * values) @ vectors.T
    return (kept + kept.T) / 2


def _constraint_modes(handle: ShiftInvert, sub: Substructure, V: Array) -> Array:
    """Puts Ψ = -K_ii⁻¹K_ib into the rows of the interior, a block of columns at a time; returns K_bb + K_bi Ψ."""
    b, i = sub.interface, sub.interior
    Kib, condensed = sub.K[i][:, b], square(sub.K, b)
    for start in range(0, len(b), COLUMNS):
        part = slice(start, min(start + COLUMNS, len(b)))
        loads = Kib[:, part]
        answers = handle.factor.solve(-(loads.toarray(order="F") if sp.issparse(loads) else loads))
        V[i, part] = answers
        condensed[:, part] += Kib.T @ answers
    return condensed
