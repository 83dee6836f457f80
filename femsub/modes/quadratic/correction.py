"""One correction of an eigenpair (λ, x, y) of a quadratic pencil from both sides, by a factor of P at λ or beside it:

    x ← P(λ)⁻¹P'(λ)x,   y ← P(λ)⁻ᴴP'(λ)ᴴy,   λ ← the root s next to λ of yᴴP(s)x = 0.

Together they converge like the square of the error of λ, of unsymmetric pencils too (generalised Rayleigh quotient iteration;
P. Lancaster, Lambda-Matrices and Vibrating Systems, 1966; H. Schwetlick, K. Schreiber, Linear Algebra Appl. 436 (2012) 3991).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from femsub.algebra import SUMS, ComplexFactor, SparseFactor, equilibration, scaled
from femsub.checks import EPS, EQUAL, Array, Matrix
from femsub.errors import SingularMatrixError
from femsub.modes.quadratic.matching import SPLIT

if TYPE_CHECKING:
    from femsub.model import Pencil


class Inverse(Protocol):
    """A factor of a complex matrix P."""

    def solve(self, B: Array, transposed: bool = False) -> Array:
        """P⁻¹B, or P⁻ᵀB, of B (n,) or (n, k)."""


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
        return np.asarray((after * la.lapack.zgetrs(*self.lu, (before * B.T).T, trans=int(transposed))[0].T).T)


def inverse_at(pencil: Pencil, s: complex, H: Matrix | None = None) -> Inverse:
    """P(s)⁻¹; with H, that of P(s) + iH, structural damping.

    Raises
    ------
    SingularMatrixError
        s is an eigenvalue.
    """
    P = pencil.at(s) if H is None else pencil.at(s) + 1j * H
    try:
        return ComplexFactor(P) if pencil.is_sparse else _Dense(P)
    except SingularMatrixError as error:
        raise SingularMatrixError(f"s²M + sD + K is singular at s = {s:.6g} ({error})") from None


def solver_near(pencil: Pencil, value: complex) -> Inverse | None:
    """P(λ)⁻¹, or that of a λ beside it, where P(λ) itself is singular; None if both are, as beside rigid motion."""
    for beside in (0.0, 1e6 * EPS):  # so near that both are one for a correction, and far enough that P is regular
        try:
            return inverse_at(pencil, complex(value * (1 + beside)))
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
    """By how much λ is above the root next to it of yᴴP(s)x = 0: yᴴP(λ)x / yᴴP'(λ)x to first order.

    The residual is summed entry by entry, and what is left of it decides the last digits.
    """
    residual = pencil.residual(np.array([value]), x[:, None])[:, 0]
    with np.errstate(all="ignore"):
        mass, damping, left = (np.complex128(y.conj() @ part) for part in (pencil.M @ x, pencil.D @ x, residual))
        rate = 2 * value * mass + damping
        root = np.sqrt(rate**2 - 4 * mass * left)
        return complex(2 * left / (rate + (root if (np.conj(rate) * root).real >= 0 else -root))) if left else 0.0


def is_rounding(pencil: Pencil, values: Array, X: Array, Y: Array) -> Array:
    """Whether yᴴP(λ)x is rounding, for each of k pairs: |y|ᵀ|P(λ)x| up to SUMS of the sizes of its terms; bool (k,)."""
    residual, terms = np.abs(pencil.residual(values, X)), pencil.magnitude(values, X)
    return np.asarray(np.einsum("ij,ij->j", np.abs(Y), residual - SUMS * terms) <= 0)


def left_by_real_factor(pencil: Pencil, value: complex, P: Matrix, x: Array, y: Array, steps: int = 80, gain: float = 1e-8
                        ) -> Array | None:
    """A better left vector y of unit length, of a sparse P = P(λ): Pᴴδ = -Pᴴy by GMRES with a factor of R = Re P.

    Of a lightly damped mode Im P is small, and R⁻¹P is the unit matrix but for the modes whose distance from λ is not large
    beside their damping. The mode itself makes R nearly singular. So GMRES is preconditioned on its complement, from the right,
    with f = P'x and g = P'ᴴy:

        δ = (1 - y fᴴ / fᴴy) R⁻ᵀ (1 - g xᴴ / xᴴg) r,   xᴴ(1 - g xᴴ / xᴴg) = 0,   fᴴδ = 0.

    The real factor takes a sixth of the time of a complex one. The part of Pᴴy along g shows an error of λ, not one of y. None
    if the residual does not fall by the factor `gain` in so many `steps`, nor to rounding.
    """
    from scipy.sparse.linalg import LinearOperator, gmres

    along, out = slope(pencil, value, x), left_slope(pencil, value, y)
    A = sp.csr_array(P.T)  # by rows: a product by columns would take longer
    residual = (A @ y.conj()).conj()
    residual -= out * (np.vdot(x, residual) / np.vdot(x, out))
    rounding = SUMS * float(np.linalg.norm(abs(A) @ np.abs(y)))
    if np.linalg.norm(residual) <= rounding:
        return y
    try:
        R = SparseFactor(sp.csr_array((P.data.real.copy(), P.indices, P.indptr), shape=P.shape), "general", probed=False)
    except SingularMatrixError:
        return None

    def correction(r: Array) -> Array:
        r = r - out * (np.vdot(x, r) / np.vdot(x, out))
        both = R.solve(np.stack([r.real, r.imag], axis=1), transposed=True)
        v = both[:, 0] + 1j * both[:, 1]
        return np.asarray(v - y * (np.vdot(along, v) / np.vdot(along, y)))

    operator = LinearOperator(P.shape, matvec=lambda r: (A @ correction(r).conj()).conj(), dtype=complex)
    found, failed = gmres(operator, -residual, rtol=gain, atol=rounding, restart=steps, maxiter=1)
    if failed or not np.isfinite(found).all():
        return None
    better = y + correction(found)
    return np.asarray(better / np.linalg.norm(better))


def converged(pencil: Pencil, value: complex, x: Array, y: Array, others: tuple[Array, Array, Array] | None = None,
              steps: int = 8) -> tuple[complex, Array, Array] | None:
    """The eigenpair near (λ, x, y), x and y (n,) of unit length; None if its residual does not fall to rounding.

    Parameters
    ----------
    pencil : Pencil
    value, x, y : complex and ndarray, shape (n,)
        A real λ stays real.
    others : (λᵢ, xᵢ, yᵢ), shapes (k,), (n, k) and (n, k), optional
        Eigenpairs that it must not become: yᵢᴴ((λ + λᵢ)M + D)x = 0 holds between two eigenpairs, and is kept up while steps are
        large.
    steps : int
        Each takes a factor of P. Three double a few digits to all of them; the others serve a start that is far off.
    """
    real, before, settled = np.imag(value) == 0, np.inf, False
    for _ in range(steps):
        if before <= SPLIT * abs(value):  # from here on it comes to none of the others, and the rounding in them would stay in it
            others = None
        x, y = _without(pencil, value, x, y, others)
        solver = solver_near(pencil, value)
        if solver is None:
            return None
        x, y = corrected(pencil, value, x, y, solver)
        x, y = _without(pencil, value, x, y, others)
        off = step(pencil, value, x, y) if np.isfinite([x, y]).all() else np.nan
        value = value - (np.real(off) if real else off)
        if not np.isfinite(value):
            return None
        settled = bool(is_rounding(pencil, np.array([value]), x[:, None], y[:, None])[0])
        # this step is rounding, or the next one would be, as the square of this one, or none will be smaller
        if abs(off) <= 4 * EPS * abs(value) or (settled and (abs(off) <= EQUAL * abs(value) or abs(off) > before / 2)):
            break
        before = abs(off)
    return (value, x, y) if settled else None


def _without(pencil: Pencil, value: complex, x: Array, y: Array, others: tuple[Array, Array, Array] | None
             ) -> tuple[Array, Array]:
    """x and y, of unit length, with yᵢᴴ((λ + λᵢ)M + D)x = 0 and yᴴ((λ + λᵢ)M + D)xᵢ = 0 for the eigenpairs (λᵢ, xᵢ, yᵢ)."""
    for other, right, left in zip(others[0], others[1].T, others[2].T, strict=True) if others else ():
        mean = (value + other) / 2
        own, back = slope(pencil, mean, right), left_slope(pencil, mean, left)
        whole = left.conj() @ own
        x, y = x - right * ((back.conj() @ x) / whole), y - left * (y.conj() @ own / whole).conj()
        x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
    return x, y
