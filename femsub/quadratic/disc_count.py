"""How many eigenvalues lie in a disc: an independent count that needs no complex factorisation, at any size.

Away from a few contacts and dashpots a pencil has proportional damping, whose modes the inertia of K - ω²M counts; what
the contacts make of them follows from a determinant as small as their number.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la

from femsub.checks import CERTIFIED, CONFIRMED, Array
from femsub.errors import SingularMatrixError
from femsub.linalg.factor import counting, factorise, inertia
from femsub.linalg.subspace import orthonormal
from femsub.model.matrices import Difference
from femsub.quadratic.damping_split import Split

SAFE = 0.5  # the margin that is asked on the contour; 1 would do
ROUNDS = 12  # of enrichment, until the margin is safe
SURE = 100.0  # factor between an estimate of the nearest undamped mode and what is relied on
CLOSE = 1e8  # relative distance of a mode, inverted, at which it is on the edge
TINY = 1e-300
Solve = Callable[[Array], Array]


@dataclass(frozen=True)
class Edge:
    """What A = K0 - R²M tells: the number of modes below R, and how near R the next mode may be."""

    radius: float
    below: int
    near: float  #: about max (ω² + R²)/|ω² - R²|


def edge(parts: Split, radius: float) -> Edge:
    """Factorises A once; `near` comes from two random vectors, by two steps of inverse iteration.

    Raises
    ------
    SingularMatrixError
        A mode lies on the edge.
    """
    A = Difference(parts.K0, parts.M, radius**2)
    if not parts.W.shape[1]:
        return Edge(radius, inertia(A), 1.0)
    handle, length = counting(A), np.ones(2)
    x = np.random.default_rng(13).standard_normal((parts.M.shape[0], 2))
    for _ in range(2):
        x = handle.solve(parts.M @ (x / length))
        length = np.sqrt(np.maximum(np.einsum("ij,ij->j", x, parts.M @ x), TINY))
    below, near = handle.negative_pivots, 1 + 2 * radius**2 * float(length.max())
    handle.close()
    if not near < CLOSE:
        raise SingularMatrixError(f"a mode is as near to ω = {radius:.6g} as {1 / near:.1e} of it")
    return Edge(radius, below, near)


@dataclass(frozen=True)
class Count:
    """`number` eigenvalues with |λ| < radius, conjugates included; it holds where `margin` < 1.

    `size` is that of the projected pencil, `solves` the right-hand sides it took.
    """

    radius: float
    number: int
    margin: float
    size: int
    solves: int

    @property
    def evidence(self) -> str:
        """By inertia alone where there are no contacts; else the margin is known at the points sampled only."""
        return CONFIRMED if self.size else CERTIFIED

    @property
    def proved(self) -> bool:
        return self.margin < 1


def count(parts: Split, at: Edge, solve: Solve, mu: float, X: Array) -> Count | None:
    """The number of zeros of det P in |s| < R by Rouché's theorem, of which the eigensolver's result is no premise.

    det P(s) = det P0(s) · f(s), f(s) = det(I + C(s)H(s)), H = WᵀP0⁻¹W, C = sC_D + C_K (matrix determinant lemma), so that

        zeros of P = 2 ν(K0 - R²M) + (zeros - poles of f),

    with ν the number of negative eigenvalues. The last bracket is that of f_V, where H_V is H on a basis V (n, m) that holds
    the shapes X and static responses to the contacts: both counts of small dense matrices. It may stand in for f because on
    |s| = R

        κ ρᵀ |(I + C H_V)⁻¹C| ρ < 1,   |H - H_V|_ij ≤ κ ρ_i ρ_j,

    with the residuals ρ_i = ‖W e_i - P0 V q_i‖ in the norm of (K0 + μM)⁻¹ and κ = sup |(ω² + μ)/(1 + βs)(ω² + ζ)| over all
    ω² ≥ -μ, whether they are known or not; all of it evaluated at some hundred points, dense near poles and zeros of f_V and
    near iR, where κ comes from an estimate of the nearest mode. An X with a mode missing makes V worse, never the count
    wrong. The basis grows where the largest margin is above 0.5: by Im X, by residuals, each third time by all of A⁻¹MV.

    Parameters
    ----------
    parts, at : Split, Edge
    solve : callable
        B (n, k) to (K0 + μM)⁻¹B; K0 + μM has been found positive definite.
    mu : float
        0 ≤ μ < R²/4.
    X : ndarray of complex, shape (n, k)

    Returns
    -------
    Count or None
        None where damping is so strong that proportional modes below R may be overdamped: no count by this way.
    """
    R = at.radius
    if not (abs(parts.alpha) < R / 2 and abs(parts.beta) * R < 0.5 and mu < R**2 / 4):
        return None
    if parts.W.shape[1] == 0:
        return Count(R, 2 * at.below, 0.0, 0, 0)
    basis = _Basis(parts, solve, mu)
    basis.add(np.hstack([X.real, basis.static]))
    for turn in range(ROUNDS):
        small = basis.small(at)
        number = 2 * at.below + small.zeros - small.poles
        s = small.contour()
        margin = small.margin(s)
        worst = float(margin.max())
        if worst < SAFE:
            break
        before = basis.size
        if turn == 0:
            basis.add(X.imag)
        elif turn % 3 == 2:
            basis.add(basis.outside)
        if basis.size == before:
            high = (margin >= SAFE) & (margin >= np.append(margin[1:], 0)) & (margin >= np.append(0, margin[:-1]))
            peaks = np.flatnonzero(high)[np.argsort(-margin[high])][:4]
            basis.add(basis.residuals(small, s[peaks]))
        if basis.size == before:
            break
    return Count(R, number, worst, basis.size, basis.solves)


class _Basis:
    """V with VᵀAV = I, A = K0 + μM, and T = A⁻¹MV less its share in V; likewise A⁻¹W."""

    def __init__(self, parts: Split, solve: Solve, mu: float) -> None:
        n = parts.M.shape[0]
        self.parts, self.solve, self.mu, self.solves = parts, solve, mu, 0
        self.A = Difference(parts.K0, parts.M, -mu)
        self.V, self.AV, self.MV, self.T = (np.zeros((n, 0)) for _ in range(4))
        self.static = self._solved(parts.W)

    @property
    def size(self) -> int:
        return int(self.V.shape[1])

    def _solved(self, B: Array) -> Array:
        self.solves += B.shape[1]
        return self.solve(B)

    def add(self, new: Array) -> None:
        """Appends what is new, made orthonormal."""
        new, Anew = orthonormal(np.array(new, order="C"), self.A.__matmul__, self.V)
        if new.shape[1]:
            Mnew = self.parts.M @ new
            more = [new, Anew, Mnew, self._solved(Mnew)]
            if self.size:
                more = [np.hstack(pair) for pair in zip((self.V, self.AV, self.MV, self.T), more, strict=True)]
            self.V, self.AV, self.MV, self.T = more

    def small(self, at: Edge) -> _Small:
        M, W = self.V.T @ self.MV, self.AV.T @ self.static
        M = (M + M.T) / 2
        # What A⁻¹[W, MV] has outside of V, and its A-products, without a cancellation that squares would suffer.
        inside, q = np.hstack([W, M]), W.shape[1]
        self.outside, forces = self.V @ inside, self.AV @ inside
        for whole, first, rest in ((self.outside, self.static, self.T), (forces, self.parts.W, self.MV)):
            np.subtract(first, whole[:, :q], out=whole[:, :q])
            np.subtract(rest, whole[:, q:], out=whole[:, q:])
        gram = self.outside.T @ forces
        theta, Q = np.linalg.eigh(M)
        return _Small(self.parts, self.mu, at.radius, at.near, theta, Q, Q.T @ W, (gram + gram.T) / 2)

    def residuals(self, small: _Small, s: Array) -> Array:
        """A⁻¹(W - P0(s)Vq) at each s, real and imaginary parts, shape (n, 2 m q)."""
        weights = np.concatenate(list(small.weights(s)), axis=1)
        return np.hstack([self.outside @ weights.real, self.outside @ weights.imag])


@dataclass(frozen=True, eq=False)
class _Small:
    """The pencil on V, in its undamped modes: VᵀMV = Q diag(θ) Qᵀ, K_V = I - μ M_V, W_V = QᵀVᵀW (m, q)."""

    parts: Split
    mu: float
    radius: float
    near: float
    theta: Array
    Q: Array
    W: Array
    gram: Array

    @property
    def poles(self) -> int:
        return 2 * int(np.count_nonzero(self.theta > 1 / (self.radius**2 + self.mu)))

    @property
    def zeros(self) -> int:
        return int(np.count_nonzero(np.abs(self.eigenvalues) < self.radius))

    @cached_property
    def eigenvalues(self) -> Array:
        """By QZ on the reversed pencil in R/s, in which K_V is near I."""
        p, m, R = self.parts, len(self.theta), self.radius
        M, K0 = np.diag(self.theta), np.diag(1 - self.mu * self.theta)
        D = p.alpha * M + p.beta * K0 + self.W @ p.C_D @ self.W.T
        K = K0 + self.W @ p.C_K @ self.W.T
        eye, zero = np.eye(m), np.zeros((m, m))
        A = np.block([[zero, eye], [-R**2 * M, -R * D]])
        B = np.block([[eye, zero], [zero, K]])
        alpha, beta = la.eigvals(A, B, homogeneous_eigvals=True, check_finite=False)
        return R * beta / np.where(np.abs(alpha) > TINY, alpha, TINY)

    def _amplitudes(self, s: Array) -> tuple[Array, Array]:
        """1/((1 + βs)(1 + (ζ - μ)θ)) per mode, shape (len(s), m), and (1 + βs)(ζ - μ)."""
        shift, factor = self.parts.squared(s) - self.mu, 1 + self.parts.beta * s
        return 1 / (factor[:, None] * (1 + shift[:, None] * self.theta)), factor * shift

    def weights(self, s: Array) -> Array:
        """The residual in terms of `outside`, shape (len(s), q + m, q)."""
        amplitude, factor = self._amplitudes(s)
        q = self.Q @ (amplitude[:, :, None] * self.W)
        eye = np.broadcast_to(np.eye(self.W.shape[1]), (len(s), self.W.shape[1], self.W.shape[1]))
        return np.concatenate([eye, -factor[:, None, None] * q], axis=1)

    def margin(self, s: Array) -> Array:
        """κ ρᵀ|(I + CH_V)⁻¹C|ρ at each s."""
        amplitude, _ = self._amplitudes(s)
        H = np.einsum("ip,si,iq->spq", self.W, amplitude, self.W, optimize=True)
        weights, C = self.weights(s), self.parts.coupling(s)
        square = np.einsum("sip,ij,sjp->sp", weights.conj(), self.gram, weights, optimize=True).real
        rho = np.sqrt(np.maximum(square, 0.0))
        with np.errstate(all="ignore"):
            try:
                T = np.linalg.solve(np.eye(C.shape[1]) + C @ H, C)
            except np.linalg.LinAlgError:
                return np.full(len(s), np.inf)
            kappa = self._kappa(s)
            result = kappa * np.einsum("sp,spq,sq->s", rho, np.abs(T), rho)
        return np.where(np.isfinite(result), result, np.inf)

    def _kappa(self, s: Array) -> Array:
        """sup |(ω² + μ)/((1 + βs)(ω² + ζ))| over ω² ≥ -μ; close to -ζ = R² by what the edge knows of the next mode."""
        R2 = self.radius**2
        zeta = self.parts.squared(s)
        shift = zeta - self.mu
        least = np.where(shift.real >= 0, 1.0, np.abs(shift.imag) / np.maximum(np.abs(shift), TINY))
        bound = SURE * self.near
        off = np.abs(zeta + R2) / R2
        close = np.where(off * bound < 0.5, 1 / (2 * bound), 0.0)
        return 1 / np.abs(1 + self.parts.beta * s) / np.maximum(least, close)

    def contour(self) -> Array:
        """Points on the upper half of |s| = R, dense where a pole of f, or a zero, is near."""
        p, R = self.parts, self.radius
        decay = p.alpha + p.beta * R**2
        crossing = np.pi - np.arctan2(np.sqrt(max(R**2 - decay**2 / 4, 0.0)), decay / 2)
        theta = np.maximum(self.theta, TINY)
        omega = np.sqrt(np.maximum(1 / theta - self.mu, 0.0))
        centres = np.append(self.eigenvalues, 1j * omega)
        centres = centres[(np.abs(np.abs(centres) - R) < 0.5 * R) & (centres.imag >= 0)]
        width = np.maximum(np.abs(np.abs(centres) / R - 1), 1e-9)
        steps = 2.0 ** np.arange(-2, 8)
        offsets = np.concatenate([-steps[::-1], [0.0], steps])
        angles = (np.angle(centres)[:, None] + width[:, None] * offsets).ravel()
        graded = 10.0 ** np.arange(-9, 0, 0.25)
        angles = np.concatenate([angles, crossing - graded, [crossing], crossing + graded, np.linspace(0, np.pi, 181)])
        return R * np.exp(1j * np.unique(angles[(angles >= 0) & (angles <= np.pi)]))


def definite(parts: Split, radius: float) -> tuple[Solve, float]:
    """B to (K0 + μM)⁻¹B by a factorisation of its own, and μ > 0, for a K0 that is not positive definite for certain.

    Raises
    ------
    SingularMatrixError
        K0 has an eigenvalue below -R²/5.
    """
    for share in (1e-3, 1e-2, 1e-1, 0.2):
        mu = share * radius**2
        try:
            return factorise(Difference(parts.K0, parts.M, -mu), "definite").solve, mu
        except SingularMatrixError as error:
            last = error
    raise last
