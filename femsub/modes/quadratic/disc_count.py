"""The number of eigenvalues in a disc: an independent count without complex factorisations, for models of any size.

Without a few contacts and dashpots the pencil has proportional damping, and the inertia of K - ω²M counts its modes. The
effect of the contacts follows from a small determinant, whose size is the number of contact columns. For a part that turns
without damping, the inertia of K - ω²M + iωG counts the modes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from femsub.algebra import Difference, counting, factorise, inertia, one_thread, orthonormal, shared_factor
from femsub.checks import Array, Matrix
from femsub.errors import SingularMatrixError
from femsub.modes.quadratic.damping_split import Split
from femsub.modes.quadratic.matching import HALF
from femsub.modes.quadratic.region import Contour, Count

Solve = Callable[[Array], Array]


@dataclass(frozen=True)
class Edge:
    """From A = K0 - R²M: the number of modes below R, and how near to R the next mode may be."""

    radius: float
    below: int
    near: float  #: about max (ω² + R²)/|ω² - R²|


def edge(parts: Split, radius: float) -> Edge:
    """Factorise A once; `near` comes from two random vectors by two steps of inverse iteration.

    Raises
    ------
    SingularMatrixError
        A mode lies on the edge, or K is not positive definite although the part turns.
    """
    if parts.skew is not None:
        return Edge(radius, _turning_below(parts, parts.skew, radius), 1.0)
    A = Difference(parts.K0, parts.M, radius**2)
    if not parts.W.shape[1]:
        return Edge(radius, inertia(A), 1.0)
    handle, length = counting(A), np.ones(2)
    x = np.random.default_rng(13).standard_normal((parts.M.shape[0], 2))
    for _ in range(2):
        x = handle.solve(parts.M @ (x / length))
        length = np.sqrt(np.maximum(np.einsum("ij,ij->j", x, parts.M @ x), np.finfo(float).tiny))
    below, near = handle.negative_pivots, 1 + 2 * radius**2 * float(length.max())
    handle.close()
    if not near * HALF < 1:  # nearer than half of the digits it counts as on the edge
        raise SingularMatrixError(f"a mode lies at ω = {radius:.6g}, within a relative distance of {1 / near:.1e}")
    return Edge(radius, below, near)


def _turning_below(parts: Split, skew: Matrix, radius: float) -> int:
    """The number of eigenvalues iω with 0 < ω < R of K + sG + s²M, with K positive definite and G skew.

    All eigenvalues are imaginary. The quadratic form of the Hermitian P(iω) is k + ωg - ω²m with k > 0, so it changes its sign
    once as ω grows, and the number of negative eigenvalues of P(iR) is the number of ω below R (P. Lancaster, Lambda-Matrices
    and Vibrating Systems, 1966). It is half of that of the real [[A, -RG], [RG, A]], A = K - R²M.
    """
    shared_factor(parts.K0, "definite")  # or an error
    A, B = parts.K0 - radius**2 * parts.M, radius * skew
    negative = inertia(sp.block_array([[A, -B], [B, A]], format="csr"))
    if negative % 2:
        raise SingularMatrixError(f"an eigenvalue lies at ω = {radius:.6g}")
    return negative // 2


def count(parts: Split, at: Edge, solve: Solve, mu: float, X: Array, rounds: int = 12,
          safe: float = 0.5) -> Count | None:
    """The number of zeros of det P in |s| < R by Rouché's theorem, independent of the eigensolver's result.

    det P(s) = det P0(s) · f(s), f(s) = det(I + C(s)H(s)), H = WᵀP0⁻¹W, C = sC_D + C_K (matrix determinant lemma), so that

        zeros of P = 2 ν(K0 - R²M) + (zeros - poles of f),

    with ν the number of negative eigenvalues. The last bracket is computed for f_V instead of f. H_V is H on a basis V (n, m)
    of the shapes X and static responses to the contacts, so zeros and poles belong to small dense matrices. Both brackets
    are equal if on |s| = R

        κ ρᵀ |(I + C H_V)⁻¹C| ρ < 1,   |H - H_V|_ij ≤ κ ρ_i ρ_j,

    with the residuals ρ_i = ‖W e_i - P0 V q_i‖ in the norm of (K0 + μM)⁻¹ and κ = sup |(ω² + μ)/(1 + βs)(ω² + ζ)| over all
    ω² ≥ -μ, known or not. The margin is evaluated at some hundred points. They are dense near poles and zeros of f_V and
    near iR, where κ comes from an estimate of the nearest mode. A mode missing in X makes V worse, but never the count
    wrong. If the largest margin is not `safe`, the basis grows: by Im X, by residuals, each third time by all of A⁻¹MV.

    Parameters
    ----------
    parts, at : Split, Edge
    solve : callable
        Maps B (n, k) to (K0 + μM)⁻¹B; K0 + μM is known to be positive definite.
    mu : float
        0 ≤ μ < R²/4.
    X : ndarray of complex, shape (n, k)
    rounds : int
        Enrichments of the basis at most; few are usual.
    safe : float
        The required margin. The theorem needs 1; half of it is left for points of the contour between those that are looked at.

    Returns
    -------
    Count or None
        None if damping is so strong that proportional modes below R may be overdamped: the method does not apply.
    """
    R = at.radius
    if not (abs(parts.alpha) < R / 2 and abs(parts.beta) * R < 0.5 and mu < R**2 / 4):
        return None
    none = np.zeros(0)
    if parts.W.shape[1] == 0:
        return Count(Contour(R), 2 * at.below, none, 0, 0.0)
    basis = _Basis(parts, solve, mu)
    basis.add(np.hstack([X.real, basis.static]))
    for turn in range(rounds):
        small = basis.small(at)
        number = 2 * at.below + small.zeros - small.poles
        s = small.contour()
        margin = small.margin(s)
        worst = float(margin.max())
        if worst < safe:
            break
        before = basis.size
        if turn == 0:
            basis.add(X.imag)
        elif turn % 3 == 2:
            basis.add(basis.outside)
        if basis.size == before:
            high = (margin >= safe) & (margin >= np.append(margin[1:], 0)) & (margin >= np.append(0, margin[:-1]))
            peaks = np.flatnonzero(high)[np.argsort(-margin[high])][:4]
            basis.add(basis.residuals(small, s[peaks]))
        if basis.size == before:
            break
    return Count(Contour(R), number, none, basis.size, worst, True, basis.solves)


class _Basis:
    """V with VᵀAV = I, A = K0 + μM; and T, the part of A⁻¹MV outside V; likewise for A⁻¹W."""

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
        """Append new directions, made orthonormal."""
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
        # the part of A⁻¹[W, MV] outside V and its A-products; a difference of squares would suffer cancellation
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
        """Eigenvalues by QZ on the reversed pencil in R/s, in which K_V is near I."""
        p, m, R = self.parts, len(self.theta), self.radius
        M, K0 = np.diag(self.theta), np.diag(1 - self.mu * self.theta)
        D = p.alpha * M + p.beta * K0 + self.W @ p.C_D @ self.W.T
        K = K0 + self.W @ p.C_K @ self.W.T
        eye, zero = np.eye(m), np.zeros((m, m))
        A = np.block([[zero, eye], [-R**2 * M, -R * D]])
        B = np.block([[eye, zero], [zero, K]])
        alpha, beta = la.eigvals(A, B, homogeneous_eigvals=True, check_finite=False)
        return R * beta / np.where(np.abs(alpha) > np.finfo(float).tiny, alpha, np.finfo(float).tiny)

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
        with np.errstate(all="ignore"), one_thread(True):  # many small systems: waiting threads would take most of the time
            try:
                T = np.linalg.solve(np.eye(C.shape[1]) + C @ H, C)
            except np.linalg.LinAlgError:
                return np.full(len(s), np.inf)
            kappa = self._kappa(s)
            result = kappa * np.einsum("sp,spq,sq->s", rho, np.abs(T), rho)
        return np.where(np.isfinite(result), result, np.inf)

    def _kappa(self, s: Array) -> Array:
        """sup |(ω² + μ)/((1 + βs)(ω² + ζ))| over ω² ≥ -μ; near -ζ = R² from the edge's distance to the next mode."""
        R2 = self.radius**2
        zeta = self.parts.squared(s)
        shift = zeta - self.mu
        least = np.where(shift.real >= 0, 1.0, np.abs(shift.imag) / np.maximum(np.abs(shift), np.finfo(float).tiny))
        bound = 100 * self.near  # two steps of inverse iteration estimate it, and may be off by two digits
        off = np.abs(zeta + R2) / R2
        close = np.where(off * bound < 0.5, 1 / (2 * bound), 0.0)
        return 1 / np.abs(1 + self.parts.beta * s) / np.maximum(least, close)

    def contour(self) -> Array:
        """Points on the upper half of |s| = R, dense near poles and zeros of f."""
        p, R = self.parts, self.radius
        decay = p.alpha + p.beta * R**2
        crossing = np.pi - np.arctan2(np.sqrt(max(R**2 - decay**2 / 4, 0.0)), decay / 2)
        theta = np.maximum(self.theta, np.finfo(float).tiny)
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
    """The solver B ↦ (K0 + μM)⁻¹B by a separate factorisation, and μ > 0, if K0 may not be positive definite.

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
