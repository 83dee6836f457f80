"""One correction of an eigenpair (λ, x, y) of a quadratic pencil from both sides, by a factor of P at λ or beside it:

    x ← P(λ)⁻¹P'(λ)x,   y ← P(λ)⁻ᴴP'(λ)ᴴy,   λ ← λ - yᴴP(λ)x / yᴴP'(λ)x.

Together they converge like the square of the error of λ, of unsymmetric pencils too (generalised Rayleigh quotient iteration).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
import scipy.linalg as la

from femsub.algebra import ComplexFactor, equilibration, scaled
from femsub.checks import EPS, Array
from femsub.errors import SingularMatrixError

if TYPE_CHECKING:
    from femsub.model import Pencil


class Inverse(Protocol):
    """A factor of a complex matrix P."""

    def solve(self, B: Array, transposed: bool = False) -> Array:
        """P⁻¹B, or P⁻ᵀB."""


class _Dense:
    """The factor of a dense matrix, equilibrated: units of the DOF do not matter."""

    def __init__(self, P: Array) -> None:
        self.rows, self.columns = equilibration(P)
        lu, pivots, info = la.lapack.zgetrf(scaled(P, self.rows, self.columns).astype(complex))
        if info:
            raise SingularMatrixError("a complex matrix is singular")
        self.lu = lu, pivots

    def solve(self, B: Array, transposed: bool = False) -> Array:
        before, after = (self.columns, self.rows) if transposed else (self.rows, self.columns)
        return np.asarray(after * la.lapack.zgetrs(*self.lu, before * B, trans=int(transposed))[0])


def solver_near(pencil: Pencil, value: complex) -> Inverse | None:
    """P(λ)⁻¹, or that of a λ beside it, where P(λ) itself is singular; None if both are, as beside rigid motion."""
    for beside in (0.0, 1e6 * EPS):  # so near that both are one for a correction, and far enough that P is regular
        try:
            P = pencil.at(complex(value * (1 + beside)))
            return ComplexFactor(P) if pencil.is_sparse else _Dense(P)
        except SingularMatrixError:
            continue
    return None


def slope(pencil: Pencil, value: complex, x: Array) -> Array:
    """P'(λ)x; Mx for a real eigenvalue 0."""
    return np.asarray(2 * value * (pencil.M @ x) + pencil.D @ x if value else pencil.M @ x)


def left_slope(pencil: Pencil, value: complex, y: Array) -> Array:
    """P'(λ)ᴴy; Mᵀy for a real eigenvalue 0."""
    return np.asarray(2 * np.conj(value) * (pencil.M.T @ y) + pencil.D.T @ y if value else pencil.M.T @ y)


def corrected(pencil: Pencil, value: complex, x: Array, y: Array, solver: Inverse) -> tuple[Array, Array]:
    """Better vectors x and y of unit length."""
    x, y = solver.solve(slope(pencil, value, x)), solver.solve(left_slope(pencil, value, y).conj(), transposed=True).conj()
    with np.errstate(all="ignore"):  # what is not finite is the caller's to see; lengths may overflow
        x, y = x / np.abs(x).max(), y / np.abs(y).max()
        return x / np.linalg.norm(x), y / np.linalg.norm(y)


def step(pencil: Pencil, value: complex, x: Array, y: Array) -> complex:
    """yᴴP(λ)x / yᴴP'(λ)x, by which λ is too large."""
    residual = pencil.residual(np.array([value]), x[:, None])[:, 0]
    with np.errstate(all="ignore"):
        return complex((y.conj() @ residual) / (y.conj() @ slope(pencil, value, x)))
