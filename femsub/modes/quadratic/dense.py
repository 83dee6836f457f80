"""All eigenvalues of a small quadratic pencil, by LAPACK on a linearisation scaled to energy.

With M positive definite the undamped modes come first: K_s Φ = MΦΩ² with K_s the symmetric part of K, and the state is
(Ωq, q̇) in modal coordinates,

    λ [a; b] = [[0, Ω], [-H Ω⁻¹, -C]] [a; b],   H = ΦᵀKΦ, C = ΦᵀDΦ, a = Ωq, b = λq.

For a symmetric K this matrix is skew-symmetric except for the damping, hence nearly normal. So eigenvalues from 1e-5 to 1e7
are as accurate as their condition allows. If M is not definite, see `singular_mass`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg as la

from femsub.algebra import FEW, ROUNDING, is_symmetric, one_thread, undamped, unit_length, unresisted
from femsub.checks import EPS, EQUAL, Array, InputError, SingularMatrixError
from femsub.model import RigidMotion, costs, rounding, units
from femsub.modes.dense import dense_modes
from femsub.modes.quadratic import singular_mass
from femsub.modes.quadratic.correction import converged, step
from femsub.modes.quadratic.matching import SPLIT
from femsub.modes.quadratic.singular_mass import REGULAR
from femsub.modes.shift_invert import ShiftInvert, motion_of, of_full

if TYPE_CHECKING:
    from femsub.model import Pencil


@dataclass(frozen=True, eq=False)
class ModalForm:
    """A dense pencil in its undamped modes: Φ (n, n), Ω > 0 (n,), H = ΦᵀKΦ, C = ΦᵀDΦ; KΦ = 0 for the first `rigid`.

    H is None if K is symmetric: then it is diag(±Ω²), with `sign`.
    """

    shapes: Array
    omega: Array
    sign: Array
    H: Array | None
    C: Array
    rigid: int

    def state(self, C: Array | None = None) -> Array:
        """The state matrix, shape (2n - rigid, 2n - rigid). A rigid-body mode has no potential energy, hence no state a."""
        damping = self.C if C is None else C
        n, r = len(self.omega), self.rigid
        A = np.zeros((2 * n - r, 2 * n - r))
        A[:n - r, n:] = np.diag(self.omega[r:])
        A[n - r:, n - r:] = -damping
        rows = np.arange(n - r)
        if self.H is None:
            A[n + rows, rows] = -(self.sign * self.omega)[r:]
        else:
            A[n - r:, :n - r] = -self.H[:, r:] / self.omega[r:]
        return A

    def resisted(self, A: Array, M: Array) -> ModalForm:
        """The form in which rigid motions on which A acts are elastic modes; A may be a loss against a fixed point."""
        r = self.rigid
        turn, free = undamped(A, self.shapes[:, :r], units(M))
        if len(free) == r:
            return self
        T = np.eye(len(self.omega))
        T[:r, :r] = turn[:, [*free, *np.setdiff1d(np.arange(r), free)]]
        shapes, omega = self.shapes @ T, self.omega.copy()
        omega[:r] = np.sqrt(np.maximum(np.abs(np.einsum("ij,ij->j", shapes[:, :r], A @ shapes[:, :r])), omega[:r]**2))
        return replace(self, shapes=shapes, omega=omega, H=None if self.H is None else T.T @ self.H @ T, C=T.T @ self.C @ T,
                       rigid=len(free))

    @property
    def is_definite(self) -> bool:
        """Whether K is symmetric, without negative ω²."""
        return self.H is None and bool((self.sign[self.rigid:] > 0).all())

    def with_energy(self, values: Array, states: Array, lost: Array | None = None) -> Array:
        """Re λ = -b̄ᵀCb / (2 b̄ᵀb) for the complex λ of definite K and symmetric C, states (a, b) of shape (2n - rigid, k).

        It follows from q̄ᵀP(λ)q = 0 with real coefficients, whose two roots are λ and its conjugate. It is accurate even if Re λ
        is smaller than the rounding of λ, as for the low modes of a large model with a single dashpot. If the roots are real,
        rounding has turned two equal real λ into a pair, and -b̄ᵀCb / (2 b̄ᵀb) is the mean of two other roots: these λ are not
        changed. `lost` is b̄ᵀCb, if it is known more accurately.
        """
        a, b = np.split(states, [len(self.omega) - self.rigid])
        potential, kinetic = (np.linalg.norm(part, axis=0) for part in (a, b))
        power = np.einsum("ij,ij->j", b.conj(), self.C @ b).real if lost is None else lost
        paired = (values.imag != 0) & (np.abs(power) < 2 * np.abs(values) * potential * kinetic)
        decay = np.divide(power, 2 * kinetic**2, out=np.zeros_like(power), where=paired)
        return np.where(paired, -decay + 1j * values.imag, values)

    def at(self, s: complex) -> Array:
        """ΦᵀP(s)Φ, shape (n, n).

        Ω² + s² is computed as (Ω + is)(Ω - is): near a resonance a difference of squares would lose the relevant digits.
        """
        elastic = np.arange(len(self.omega)) >= self.rigid
        stiffness = np.diag(self.sign * self.omega**2 * elastic) if self.H is None else self.H
        P = (stiffness + s**2 * np.eye(len(self.omega)) + s * self.C).astype(complex)
        if self.H is None:
            gap = (self.omega + 1j * s) * (self.omega - 1j * s) + s * self.C.diagonal()
            np.fill_diagonal(P, np.where((self.sign > 0) & elastic, gap, P.diagonal()))
        return P


def definite_form(pencil: Pencil) -> ModalForm:
    """The modal form of a pencil, made dense; an InputError if its M is not definite."""
    form = modal_form(pencil.dense())
    if form is None:
        raise InputError("M is singular or nearly so (massless DOF), but the stability border needs a regular M. Condense such "
                         "DOF, or give them a little mass. In a reduced model keep fewer modes, or take Rubin in place of "
                         "MacNeal, whose interface has no mass. complex_modes and sweep accept a singular M")
    return form


def modal_form(pencil: Pencil) -> ModalForm | None:
    """The modal form of a dense pencil, or None if M is not symmetric positive definite."""
    M, K, D = pencil.M, pencil.K, pencil.D
    if not is_symmetric(M):
        return None
    symmetric = is_symmetric(K)
    with one_thread(pencil.size <= FEW):
        with np.errstate(all="ignore"):
            try:
                scale = M.diagonal() ** -0.5
                if not np.isfinite(scale).all() or np.linalg.cond(M * np.outer(scale, scale)) > REGULAR:
                    return None
                motion = motion_of(pencil.rigid_motion)
                values, shapes, rigid = _undamped(K if symmetric else (K + K.T) / 2, M, K, motion)
            except la.LinAlgError:
                return None
        if shapes.shape[1] < pencil.size:  # the mass of a motion is rounding
            return None
        omega = np.sqrt(np.abs(values))
        omega = np.maximum(omega, 1e-8 * omega.max() or 1e-8)  # where this is not the frequency, it is only a scaling
        H = None
        if not symmetric or (omega[rigid:] ** 2 > np.abs(values[rigid:]) * (1 + 1e-12)).any():
            H = shapes.T @ (K @ shapes)
        # C = ΦᵀDΦ, with exact zeros for rigid motions that D does not damp: each of these has a double eigenvalue at 0, which
        # rounding in C would split
        free = np.arange(0 if motion is None else motion.free)
        if rigid and motion is None:
            z, free = unresisted(D, shapes[:, :rigid], units(M))
            shapes = np.hstack([z, shapes[:, rigid:]])
        C = shapes.T @ (D @ shapes)
        if is_symmetric(D):
            C = (C + C.T) / 2  # symmetric to the last digit: then left vectors are conjugate right ones
            C[free] = 0.0
        C[:, free] = 0.0
    return ModalForm(shapes, omega, np.sign(values), H, C, rigid)


def _undamped(still: Array, M: Array, K: Array, motion: RigidMotion | None) -> tuple[Array, Array, int]:
    """ω² (n,) and Φ (n, n) of the symmetric part of K, and the number of rigid-body modes, which come first with ω² = 0.

    While LAPACK computes the others, rigid-body modes are shifted to a quarter of the lowest elastic ω², as in `normal_modes`.
    A `motion` that the pencil carries is taken as it is.
    """
    handle = None
    if motion is not None and motion.count:
        Z, lowest, handle = _given(still, M, motion)
    else:
        values, shapes = _by_lapack(still, M)
        low = np.abs(values) <= 1e-8 * np.abs(values).max()
        if motion is not None or not low.any():
            return values, shapes, 0
        Z, lowest = _rigid(still, M, values, shapes, low)
        if still is not K:
            Z, loose = unresisted(K - still, Z, units(M))
            Z = Z[:, loose]
    r = Z.shape[1]
    if 0 < r < len(M):
        held = M @ Z
        values, shapes = _by_lapack(still + 0.25 * lowest * (held @ held.T), M)
        order = np.argsort(-np.linalg.norm(held.T @ shapes, axis=0), kind="stable")
        rest = np.sort(order[r:])
        values, shapes = values[rest], shapes[:, rest] - Z @ (held.T @ shapes[:, rest])
        if handle is not None:
            values, shapes = handle.cleared(values, shapes)[:2]
        values, shapes = np.append(np.zeros(r), values), np.hstack([Z, shapes])
    elif r:
        values, shapes = np.zeros(r), Z
    return values, shapes, r


def _by_lapack(K: Array, M: Array) -> tuple[Array, Array]:
    try:
        return dense_modes(K, M)
    except SingularMatrixError:  # floating, or made indefinite by friction
        values, shapes = la.eigh(K, M, check_finite=False)
        return values, shapes


def _given(K: Array, M: Array, motion: RigidMotion) -> tuple[Array, float, ShiftInvert | None]:
    """M-orthonormal rigid-body modes (n, r) of a given motion, in its order, the lowest elastic ω², and a factor if K ≥ 0."""
    Z: Array = motion.shapes @ np.linalg.inv(np.linalg.qr(np.sqrt(M.diagonal())[:, None] * motion.shapes)[1])
    Z = Z @ np.linalg.inv(np.linalg.cholesky(Z.T @ M @ Z)).T  # triangular factors: the first motions stay the first
    handle = None
    try:
        handle = ShiftInvert(K, M, carried=motion)
        lowest = handle.lowest
    except SingularMatrixError:  # a negative stiffness
        own, shapes = la.eigh(K, M, check_finite=False)
        order = np.argsort(-np.linalg.norm(Z.T @ M @ shapes, axis=0), kind="stable")
        lowest = float(np.abs(own[order[motion.count:]]).min(initial=np.inf))
    known = np.isfinite(lowest) and lowest > 0
    return Z, lowest if known else float((np.abs(K.diagonal()) / M.diagonal()).max()) or 1.0, handle


def _rigid(K: Array, M: Array, values: Array, shapes: Array, low: Array) -> tuple[Array, float]:
    """The M-orthonormal rigid-body modes Z (n, r), and the lowest elastic ω². If K is semidefinite, `ShiftInvert` decides."""
    try:
        handle = ShiftInvert(K, M)
    except SingularMatrixError:  # a negative stiffness, or a large stiffness contrast
        top = float(np.abs(values).max()) or 1.0
        # the softest modes contain rounding of the stiffest ones; two solves with K + sM remove it
        soft, shift = shapes[:, low], 1e-10 * top
        with np.errstate(all="ignore"):
            factor = la.lu_factor(K + shift * M, check_finite=False)
            for _ in range(2):
                soft = la.lu_solve(factor, M @ soft, check_finite=False)
                soft = soft / np.sqrt(np.abs(np.einsum("ij,ij->j", soft, M @ soft)))
        Z, loose = unresisted(K, soft, units(K))
        Z = Z[:, loose]
        return Z @ np.linalg.inv(np.linalg.cholesky(Z.T @ M @ Z)).T, float(np.abs(values[~low]).min(initial=top))
    return handle.rigid, handle.lowest if np.isfinite(handle.lowest) else float(np.abs(values).max())


def blurred(pencil: Pencil, X: Array) -> tuple[Array, float]:
    """Which shapes (n, k) have an elastic energy within the rounding of K's entries, and this rounding; none if it is eps."""
    K = pencil.K0  # the skew part has no energy
    unit = rounding(K)
    if unit <= EPS:  # saves a product with K, which takes a second with 83,000 DOF
        return np.zeros(X.shape[1], dtype=bool), unit
    return np.abs(costs(K, X)[1]) <= unit, unit


def eigenvalues(form: ModalForm, C: Array | None = None) -> Array:
    """All 2n eigenvalues of the modal form, exact zeros of rigid motion included; C = ΦᵀDΦ may be replaced."""
    with one_thread(len(form.omega) <= FEW):
        return np.concatenate([np.zeros(form.rigid), la.eigvals(form.state(C), check_finite=False)])


def solve(pencil: Pencil) -> tuple[Array, Array, Array]:
    """λ (2n,), right shapes X (n, 2n), left shapes Y (n, 2n), yᴴP(λ) = 0, of a dense pencil, without infinite λ.

    Conjugates are exact conjugates. Columns have unit length.
    """
    with one_thread(pencil.size <= FEW):
        return _solved(pencil)


def _solved(pencil: Pencil) -> tuple[Array, Array, Array]:
    if (freed := pencil.freed) is not None:
        values, X, Y = _solved(freed.pencil)
        return values, *freed.shapes(values, X, Y)
    form = modal_form(pencil)
    if form is None and all(pencil.symmetric):
        motion = motion_of(pencil.rigid_motion) or of_full(pencil)
        if motion is not None and motion.count:
            return singular_mass.without_rigid(pencil, motion, solve)
    if form is None:
        return _lifted(pencil, *(singular_mass.parted(pencil, solve) or singular_mass.qz_of(pencil)))
    return _lifted(pencil, *_by_modes(pencil.size, form), form.shapes[:, :form.rigid])


def carries(pencil: Pencil) -> bool:
    """Whether the rigid motion of a pencil is known from its parts."""
    return motion_of(pencil.rigid_motion) is not None


def _lifted(pencil: Pencil, values: Array, X: Array, Y: Array, rigid: Array | None = None) -> tuple[Array, Array, Array]:
    """The eigenpairs, with corrections of those that rounding has put falsely at λ = 0 or near it.

    λ = 0 is true only if Kx = 0 within rounding, or if x is one of the `rigid` motions, M-orthonormal (n, r).

    Beside a damping that is 1e17 times larger, λ = -k/d is lost: LAPACK's λ is then 0, or any number within its rounding, and no
    eigenvalue. -k/d is the root next to 0 of λ²yᴴMx + λyᴴDx + yᴴKx, from which `converged` starts.
    """
    noise = (values != 0) & (np.abs(values) <= len(values) * EPS * np.abs(values).max(initial=0.0))
    noise[noise] = ~(pencil.backward_error(values[noise], X[:, noise]) <= EQUAL)
    at = np.flatnonzero(noise | (values == 0))
    if not len(at) or carries(pencil):  # K may have nothing but rounding in these coordinates
        return values, X, Y
    lost = ~(np.isfinite(X[:, at]).all(axis=0) & np.isfinite(Y[:, at]).all(axis=0))  # LAPACK's vectors of such a λ may overflow
    if lost.any():
        X, Y = X.copy(), Y.copy()
        X[:, at[lost]] = Y[:, at[lost]] = np.eye(len(X))[:, [int(np.abs(pencil.K).max(axis=0).argmax())]]
    at = at[costs(pencil.K, X[:, at])[0] > ROUNDING]
    if rigid is not None and rigid.shape[1] and len(at):
        held = pencil.M @ X[:, at]
        size = np.einsum("ij,ij->j", X[:, at].conj(), held).real
        at = at[np.linalg.norm(rigid.T @ held, axis=0) ** 2 < size / 2]
    values, X, Y = (part.copy() for part in (values, X, Y)) if len(at) else (values, X, Y)
    for i in at:
        x, y = X[:, i], Y[:, i] if Y[:, i].any() else X[:, i].conj()
        found = converged(pencil, -step(pencil, 0.0, x, y).real, x, y)
        if found is None or not found[0] or costs(pencil.K, found[1][:, None])[0] <= ROUNDING:
            continue
        if (np.abs(np.delete(values, i) - found[0]) > SPLIT * abs(found[0])).all():  # and none that is listed
            values[i], X[:, i], Y[:, i] = found if np.iscomplexobj(X) else (part.real for part in found)  # P is real there
    return values, X, Y


def _by_modes(n: int, form: ModalForm) -> tuple[Array, Array, Array]:
    """λ, X and Y by LAPACK on the state matrix of the modal form."""
    r = form.rigid
    plain = form.H is None and is_symmetric(form.C)
    state = form.state()
    if plain:
        values, right = la.eig(state, check_finite=False)
        left = right.conj()
    else:
        values, left, right = la.eig(state, left=True, right=True, check_finite=False)
    if plain and form.is_definite:
        values = form.with_energy(values, right)
    X, Y = form.shapes @ right[n - r:], form.shapes @ left[n - r:]
    # b = λq vanishes with λ, and has a relative rounding of EPS/‖b‖: for small λ the elastic part of the shape is that of a = Ωq
    moved = np.linalg.norm(right[n - r:], axis=0)
    # a only where |λ| is far below all ω of the shape: where it is below some of them, b has the smaller rounding
    slow = moved < 0.1 * np.linalg.norm(right[:n - r], axis=0)
    X[:, slow] = form.shapes[:, r:] @ (right[:n - r, slow] / form.omega[r:, None])
    gliding = slow & (moved >= len(right) * EPS)  # below, the rigid part of b is rounding
    pace = values if np.iscomplexobj(right) else values.real
    X[:, gliding] += form.shapes[:, :r] @ (right[n - r:n, gliding] / pace[gliding])
    values, X, Y = np.append(values, np.zeros(r)), np.hstack([X, form.shapes[:, :r]]), np.hstack([Y, form.shapes[:, :r]])
    if plain:
        Y = X.conj()
    return values, unit_length(X), unit_length(Y)
