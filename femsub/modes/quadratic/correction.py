"""One correction of an eigenpair (λ, x, y) of a quadratic pencil from both sides, by a factor of P at λ or beside it:

    x ← P(λ)⁻¹P'(λ)x,   y ← P(λ)⁻ᴴP'(λ)ᴴy,   λ ← the root s next to λ of yᴴP(s)x = 0.

Together they converge like the square of the error of λ, of unsymmetric pencils too (generalised Rayleigh quotient iteration;
P. Lancaster, Lambda-Matrices and Vibrating Systems, 1966; H. Schwetlick, K. Schreiber, Linear Algebra Appl. 436 (2012) 3991).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
import scipy.linalg as la

from femsub.algebra import SUMS, ComplexFactor, SparseFactor, equilibration, plus, scaled
from femsub.checks import EPS, EQUAL, Array, Matrix, SingularMatrixError
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
    """P(s)⁻¹; with structural damping H, (P(s) + iH)⁻¹.

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
    """P(λ)⁻¹, or P⁻¹ at a λ beside it if P(λ) is singular; None if both are singular, as beside rigid motion."""
    for beside in (0.0, 1e6 * EPS):  # so near that corrections are the same, and far enough that P is regular
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
    """x and y (n,) after one step of inverse iteration, of unit length."""
    x, y = solver.solve(slope(pencil, value, x)), solver.solve(left_slope(pencil, value, y).conj(), transposed=True).conj()
    with np.errstate(all="ignore"):  # lengths may overflow; the caller checks for that
        x, y = x / np.abs(x).max(), y / np.abs(y).max()
        return x / np.linalg.norm(x), y / np.linalg.norm(y)


def step(pencil: Pencil, value: complex, x: Array, y: Array) -> complex:
    """λ - s for the root s next to λ of yᴴP(s)x = 0: yᴴP(λ)x / yᴴP'(λ)x to first order.

    The residual P(λ)x is formed entry by entry, because what remains of it after cancellation decides the last digits.
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


def left_by_symmetric_factor(pencil: Pencil, value: complex, matrices: tuple[Matrix, Matrix], x: Array, y: Array,
                             others: tuple[Array, Array, Array], beside: float, *, along: Array, steps: int = 80,
                             tol: float = EPS**0.85) -> Array | None:
    """A better left vector y of unit length, of a sparse P = P(λ): Pᴴδ = -Pᴴy by GMRES with a factor of S = Re (P + Pᵀ)(s) / 2.

    s has the imaginary part `beside`, somewhere between Im λ and that of the next eigenvalue: friction turns the shape of a mode
    more than it changes its frequency, so that the symmetric part at λ itself would be nearly singular in another direction than
    x. For a lightly damped mode S⁻¹P is the unit matrix except for friction and the modes near λ. The nearest modes, X and Y (n,
    k) with PᴴY in `others`, are solved separately. GMRES is preconditioned from the right on the complement of the mode, with
    f = P'x (`along`) and g = P'ᴴy:

        δ = (1 - y fᴴ / fᴴy) (S⁻¹(r - PᴴYc) + Yc),   c = (XᴴPᴴY)⁻¹Xᴴr   of   (1 - g xᴴ / xᴴg) r,   fᴴδ = 0.

    The symmetric factor takes a tenth of the time of a complex one. The part of Pᴴy along g shows an error of λ, not of y.
    `matrices` are P and Pᵀ, by rows. None if the residual is not below `tol` times its terms after so many `steps`.
    """
    from scipy.sparse.linalg import LinearOperator, gmres

    P, turned = matrices
    out = left_slope(pencil, value, y)
    residual = (turned @ y.conj()).conj()
    residual -= out * (np.vdot(x, residual) / np.vdot(x, out))
    enough = tol * float(np.linalg.norm(abs(turned) @ np.abs(y)))
    if np.linalg.norm(residual) <= enough:
        return y
    X, Y, image = others
    twice = plus(plus(P.real, turned.real), 2 * (value.imag**2 - beside**2) * pencil.M)
    try:
        factor = SparseFactor(twice, "symmetric", probed=False)
        apart = np.linalg.inv(X.conj().T @ image) @ X.conj().T
    except (SingularMatrixError, np.linalg.LinAlgError):
        return None

    def correction(r: Array) -> Array:
        r = r - out * (np.vdot(x, r) / np.vdot(x, out))
        c = apart @ r
        r = r - image @ c
        both = factor.solve(np.stack([r.real, r.imag], axis=1))
        v = 2 * (both[:, 0] + 1j * both[:, 1]) + Y @ c
        return np.asarray(v - y * (np.vdot(along, v) / np.vdot(along, y)))

    operator = LinearOperator(P.shape, matvec=lambda r: (turned @ correction(r).conj()).conj(), dtype=complex)
    found, failed = gmres(operator, -residual, rtol=0.0, atol=enough, restart=steps, maxiter=1)
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
        Eigenpairs to which the iteration must not converge. yᵢᴴ((λ + λᵢ)M + D)x = 0 holds between two eigenpairs, and is enforced
        while steps are large.
    steps : int
        The largest number of steps. Each factorises P. Three steps bring a few correct digits to all; a poor start takes more.
    """
    real, before, settled = np.imag(value) == 0, np.inf, False
    for _ in range(steps):
        if before <= SPLIT * abs(value):  # now it cannot become one of the others, and their rounding would stay in it
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
        # this step is rounding; or the next step would be, as the square of this one; or steps no longer shrink
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
