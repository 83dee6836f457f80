"""Hurty/Craig-Bampton: constraint modes and fixed-interface modes."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, Matrix
from femsub.errors import ConditionWarning, InputError
from femsub.model.pencil import Pencil
from femsub.model.substructure import Substructure
from femsub.modes.normal_modes import confirm
from femsub.modes.shift_invert import RIGID, ShiftInvert, annihilates_a_translation, rounding_ratio
from femsub.modes.static_shapes import independent
from femsub.reduction.basis import COLUMNS, Basis, Extent, energy_error, kept_modes, projected
from femsub.reduction.mode_selection import chosen, unreduced
from femsub.reduction.statics import Parts

DIGITS = 1e-4  # of the condensed stiffness that rounding may take before `reduce` warns
CLEAR = 4e-15  # up to here it is rounding, beyond any doubt (see `rounding_ratio`)
SOFT = 1e-4  # condensed stiffness, relative to that of the interface with all else fixed, that may be rounding


@dataclass(frozen=True)
class CraigBampton(Extent):
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

    def basis(self, sub: Substructure, extra: Array, ports: Mapping[str, Array], damped: Pencil | None = None) -> Basis:
        b, i = sub.interface, sub.interior
        if len(i) == 0:
            if self.modes:
                raise InputError(f"{self.modes} fixed-interface modes were asked for, but every DOF is interface: there are 0")
            estimate = None if self.band is None else unreduced(sub.K, sub.M, self.band, self.tol, damped)
            return Basis(np.eye(sub.size)[:, b], _block(sub.M, b, b), _block(sub.K, b, b), ("constraint",) * len(b),
                         np.inf, _title(0), extra.shape[1], dict.fromkeys(ports, 0.0), 0, estimate)
        parts = self.parts(sub, extra)
        handle, n_b, condensed, estimate = parts.handle, len(b), parts.condensed, None
        if self.modes is not None:
            modes = kept_modes(handle, self.modes)
        else:
            modes, estimate = chosen(parts, self.band, self.tol, damped)
        r = n_b + modes.shapes.shape[1]
        V = np.zeros((sub.size, r + extra.shape[1]), order="F")
        V[:, :n_b] = parts.constraint
        del parts  # of a large interface, the second set would cost as much as all that follows
        V[i, n_b:r] = modes.shapes
        probes = _solved(handle, [w[i] for w in ports.values()])
        rest = handle.elastic_solve(extra[i], modes.shapes)
        handle.release()
        confirm(handle, modes.found)

        residual, stiffness, inertia, dropped = independent(handle, rest, extra[i], modes.shapes, modes.values)
        V = V[:, :r + len(stiffness)]
        V[i, r:] = residual
        # ΨᵀK_iiΦ = 0 and ΦᵀK_iiΦ = Ω²; the condensed stiffness needs no second product with K_ii.
        diagonal = np.concatenate([modes.values, stiffness])
        K = np.zeros((V.shape[1],) * 2)
        K[:n_b, :n_b] = condensed
        K[n_b:, n_b:] = np.diag(diagonal)
        M = projected(sub.M, V)
        M = (M + M.T) / 2
        massless = r + np.flatnonzero(inertia == 0)
        M[:, massless] = M[massless] = 0.0
        M[n_b:, n_b:] = np.diag(np.concatenate([np.ones(len(modes.values)), inertia]))
        kinds = ("constraint",) * n_b + ("rigid",) * modes.rigid + ("fixed-interface",) * modes.elastic
        errors = _port_errors(ports, i, probes, V, K[:n_b, :n_b], diagonal)
        return Basis(V, M, K, kinds + ("static port",) * len(stiffness), modes.cutoff, _title(modes.elastic), dropped, errors,
                     handle.factorisations, estimate)

    def parts(self, sub: Substructure, extra: Array) -> Parts:
        """The factor of the interior, and the constraint modes with their stiffness."""
        b, i = sub.interface, sub.interior
        handle = ShiftInvert(_part(sub.K, i, i), _part(sub.M, i, i))
        if handle.floating and len(b):
            raise InputError(
                f"the interface does not hold {sub.name!r}: with its {len(b)} DOF fixed, {handle.rigid.shape[1]} rigid-body "
                "modes remain, and constraint modes do not exist; add interface DOF, or use CraigChang")
        C = np.zeros((sub.size, len(b)), order="F")
        C[b, np.arange(len(b))] = 1.0
        return Parts(sub, handle, i, C, _condensed(sub, _constraint_modes(handle, sub, C), C), extra[i])


def _title(modes: int) -> str:
    return f"Craig-Bampton with {modes} fixed-interface modes"


def _condensed(sub: Substructure, condensed: Array, constraint: Array) -> Array:
    """ΨᵀKΨ for the constraint modes, with exactly 0 for rigid motion.

    Of a floating component it is what large forces leave when they cancel. On an interface that just holds it (the two
    DOF at one end of a beam) nothing is left but rounding, of either sign, which nobody could tell from stiffness later.
    Where much cancels, two formulas for the same stiffness, K_bb + K_bi Ψ and ΨᵀKΨ, tell what is left of its digits.
    """
    condensed = (condensed + condensed.T) / 2
    if not condensed.size:
        return condensed
    bare = sub.K.diagonal()[sub.interface]
    unit = np.where(bare > 0, bare, 1.0) ** -0.5
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


def _part(matrix: Matrix, rows: Array, columns: Array) -> Matrix:
    if sp.issparse(matrix):
        return sp.csr_array(matrix[rows][:, columns])
    return matrix[np.ix_(rows, columns)]


def _block(matrix: Matrix, rows: Array, columns: Array) -> Array:
    part = _part(matrix, rows, columns)
    return part.toarray() if sp.issparse(part) else part


def _constraint_modes(handle: ShiftInvert, sub: Substructure, V: Array) -> Array:
    """Puts Ψ = -K_ii⁻¹K_ib into the rows of the interior, a block of columns at a time; returns K_bb + K_bi Ψ."""
    b, i = sub.interface, sub.interior
    Kib, condensed = _part(sub.K, i, b), _block(sub.K, b, b)
    for start in range(0, len(b), COLUMNS):
        part = slice(start, min(start + COLUMNS, len(b)))
        loads = Kib[:, part]
        answers = handle.factor.solve(-(loads.toarray(order="F") if sp.issparse(loads) else loads))
        V[i, part] = answers
        condensed[:, part] += Kib.T @ answers
    return condensed


def _solved(handle: ShiftInvert, loads: list[Array]) -> Array:
    joined = np.hstack(loads) if loads else np.zeros((handle.K.shape[0], 0))
    return handle.elastic_solve(joined) if handle.floating else handle.factor.solve(joined)


def _port_errors(ports: Mapping[str, Array], i: Array, probes: Array, V: Array, condensed: Array,
                 values: Array) -> dict[str, float]:
    """Static error per port: K_ii⁻¹w_i less what the interior columns hold, against the whole response.

    The constraint modes are exact, so all that is missing is interior. For a component that floats on its interface
    the whole is taken for the self-equilibrated part of the load.
    """
    errors, at, n_b = {}, 0, len(condensed)
    inverse = np.linalg.pinv(condensed, rcond=1e-12, hermitian=True) if n_b else condensed
    elastic = values > 0
    for name, w in ports.items():
        answer = probes[:, at:at + w.shape[1]]
        at += w.shape[1]
        inside = np.einsum("ij,ij->j", answer, w[i])
        boundary, held = np.split(V.T @ w, [n_b])
        held = held[elastic]
        missing = inside - np.einsum("ij,ij->j", held, held / values[elastic][:, None])
        errors[name] = energy_error(missing, inside + np.einsum("ij,ij->j", boundary, inverse @ boundary))
    return errors
