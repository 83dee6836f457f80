"""All eigenvalues of a small pencil whose M is singular or not definite: infinite eigenvalues are removed before QZ.

QZ would list them as finite, of any size and sign: if rounding fills up an M of rank r, it has 2n - 2r very large eigenvalues
instead of infinite ones. The remaining pencil, or one that cannot be split, goes to QZ in companion form, scaled as proposed
by Fan, Lin and Van Dooren (SIAM J. Matrix Anal. Appl. 26 (2004) 252).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import scipy.linalg as la

from femsub.checks import EPS, Array
from femsub.linalg.null_space import SINGULAR
from femsub.model.matrices import equilibration, scaled, unit_length
from femsub.model.pencil import Pencil

REGULAR = 1e12  # condition up to which a matrix is inverted
Eigenpairs: TypeAlias = tuple[Array, Array, Array]  # λ (k,), right and left shapes (n, k) of unit length
Solver: TypeAlias = Callable[[Pencil], Eigenpairs]  # of a pencil with a regular M


def bare(pencil: Pencil) -> Array:
    """DOF with neither mass nor damping, if they can be condensed statically: they have no dynamics."""
    M, D, K = pencil.M, pencil.D, pencil.K
    bare = np.flatnonzero(~sum(part.any(axis=axis) for part in (M, D) for axis in (0, 1)).astype(bool))
    if len(bare) in (0, pencil.size) or not _regular(K[np.ix_(bare, bare)]):
        return bare[:0]
    return bare


def _regular(A: Array) -> bool:
    """Whether A, after equilibration, is well conditioned enough to be inverted."""
    return bool(np.linalg.cond(scaled(A, *equilibration(A))) < REGULAR) if A.size else True


def condensed(pencil: Pencil, bare: Array, solve: Solver) -> Eigenpairs:
    """Eigenpairs of the other DOF with K_mm - K_mb K_bb⁻¹ K_bm, extended statically to the bare DOF, right and left."""
    rest = np.setdiff1d(np.arange(pencil.size), bare)
    K = pencil.K
    right = -np.linalg.solve(K[np.ix_(bare, bare)], K[np.ix_(bare, rest)])
    left = -np.linalg.solve(K[np.ix_(bare, bare)].T, K[np.ix_(rest, bare)].T)
    stiffness = K[np.ix_(rest, rest)] + K[np.ix_(rest, bare)] @ right
    values, x, y = solve(Pencil(pencil.M[np.ix_(rest, rest)], pencil.D[np.ix_(rest, rest)], stiffness))
    X, Y = (np.zeros((pencil.size, len(values)), dtype=complex) for _ in range(2))
    X[rest], X[bare], Y[rest], Y[bare] = x, right @ x, y, left @ y
    return values, unit_length(X), unit_length(Y)


def parted(pencil: Pencil, solve: Solver) -> Eigenpairs | None:
    """All finite eigenpairs, and no others, for a singular M = U diag(Σ, 0) Vᵀ with any null space.

    On the null space D is diag(Δ, 0) by another SVD, so that q = V₁q₁ + V_a q_a + V_b q_b. q_b has neither mass nor damping
    and follows statically: 0 = K_b1 q₁ + D_b1 v₁ + K_ba q_a + K_bb q_b, v₁ = λq₁. Inserted into the other rows, this gives
    a pencil A - λE in (q₁, v₁, q_a) with a regular E. If the massless part has no damping, the result is a quadratic pencil
    again, with the regular Σ. Returns None if M is regular, or if K_bb or E is singular (constraints by multipliers).
    """
    n, (rows, columns) = pencil.size, _units_of_mass(pencil)
    M, D, K = (scaled(part, rows, columns) for part in (pencil.M, pencil.D, pencil.K))
    U, sizes, V = la.svd(M)
    rank = int(np.count_nonzero(sizes > max(SINGULAR, n * EPS) * sizes[0]))
    if rank == n:
        return None
    V, tiny = V.T, 10 * n * EPS * np.linalg.norm(D, 2)
    turn, drag, back = la.svd(U[:, rank:].T @ D @ V[:, rank:])
    U[:, rank:], V[:, rank:] = U[:, rank:] @ turn, V[:, rank:] @ back.T
    damped = int(np.count_nonzero(drag > tiny))
    one, a, b = slice(rank), slice(rank, rank + damped), slice(rank + damped, n)
    D, K = U.T @ D @ V, U.T @ K @ V
    if not _regular(K[b, b]):
        return None
    G = -np.linalg.solve(K[b, b], np.hstack([K[b, one], D[b, one], K[b, a]]))
    g1, gv, ga = G[:, :rank], G[:, rank:2 * rank], G[:, 2 * rank:]
    if not damped and np.abs(D[one, b]).max(initial=0) <= tiny and np.abs(D[b, one]).max(initial=0) <= tiny:
        # for a symmetric M, V is U up to signs
        mass, signs = sizes[:rank], np.sign(np.einsum("ij,ij->j", U[:, one], V[:, one])) if pencil.symmetric[0] else 1.0
        values, q1, w1 = solve(Pencil(np.diag(mass), (D[one, one].T * signs).T, ((K[one, one] + K[one, b] @ g1).T * signs).T))
        w1, qa, wa = (w1.T * signs).T, np.zeros((0, len(values))), np.zeros((0, len(values)))
        qb = g1 @ q1
    else:
        gamma = float(np.sqrt(np.linalg.norm(K) / sizes[0])) if rank else 1.0  # λ = γμ, v = μq
        E, A = np.zeros((2, 2 * rank + damped, 2 * rank + damped))
        top, middle, low = slice(rank), slice(rank, 2 * rank), slice(2 * rank, None)
        E[top, top] = A[top, middle] = np.eye(rank)
        E[middle, middle] = gamma**2 * (np.diag(sizes[:rank]) + D[one, b] @ gv)
        E[middle, low], E[low, low] = gamma * (D[one, a] + D[one, b] @ ga), gamma * np.diag(drag[:damped])
        A[middle, top], A[low, top] = -K[one, one] - K[one, b] @ g1, -K[a, one] - K[a, b] @ g1
        A[middle, middle] = -gamma * (D[one, one] + D[one, b] @ g1 + K[one, b] @ gv)
        A[low, middle] = -gamma * (D[a, one] + K[a, b] @ gv)
        A[middle, low], A[low, low] = -K[one, a] - K[one, b] @ ga, -K[a, a] - K[a, b] @ ga
        if not _regular(E):
            return None
        values, left, right = _by_qz(A, E, len(E))
        q1, qa = right[top], right[low]
        speed = right[middle]
        fast = np.linalg.norm(speed, axis=0) > np.linalg.norm(q1, axis=0)
        q1 = np.where(fast, speed / np.where(fast, values, 1.0), q1)
        values, w1, wa = gamma * values, left[middle], left[low]
        qb = g1 @ q1 + gv @ (q1 * values) + ga @ qa
    wb = -np.linalg.solve(K[b, b].T, (D[one, b].T @ w1) * values.conj() + K[one, b].T @ w1 + K[a, b].T @ wa)
    X, Y = V[:, one] @ q1 + V[:, a] @ qa + V[:, b] @ qb, U[:, one] @ w1 + U[:, a] @ wa + U[:, b] @ wb
    return values, unit_length(columns[:, None] * X), unit_length(rows[:, None] * Y)


def _units_of_mass(pencil: Pencil) -> tuple[Array, Array]:
    """Scales r and c that make the entries of M similar in size, so that its rank is clear; without mass, the pencil's scales."""
    mass, others = equilibration(pencil.M), pencil.units
    still = (~pencil.M.any(axis=1), ~pencil.M.any(axis=0))
    moving = [~rest for rest in still]
    # the common factor between the two kinds of scales comes from the DOF that have both
    found = [np.where(rest, unit * 2.0 ** np.rint(np.median(np.log2(own[on] / unit[on]))) if on.any() else unit, own)
             for own, unit, rest, on in zip(mass, others, still, moving, strict=True)]
    return found[0], found[1]


def _by_qz(A: Array, B: Array, number: int) -> Eigenpairs:
    """The `number` smallest λ of A - λB, left and right vectors; a pair is never split, its members are exact conjugates."""
    rows, columns = equilibration(abs(A) + abs(B))
    A, B = scaled(A, rows, columns), scaled(B, rows, columns)
    (alpha, beta), left, right = la.eig(A, B, left=True, right=True, homogeneous_eigvals=True, check_finite=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.abs(alpha) / np.abs(beta)
    second = np.flatnonzero(alpha.imag < 0)  # LAPACK lists pairs side by side, Im λ > 0 first, conjugate up to rounding
    size[second] = size[second - 1]
    order = np.argsort(np.where(np.isfinite(size), size, np.inf), kind="stable")[:number]
    order = np.sort(order[np.isfinite(size[order])])
    if len(order) and alpha.imag[order[-1]] > 0 and order[-1] + 1 not in order:
        order = order[:-1]
    values, left, right = alpha[order] / beta[order], left[:, order], right[:, order]
    second = np.flatnonzero(values.imag < 0)
    values[second], left[:, second], right[:, second] = (part[..., second - 1].conj() for part in (values, left, right))
    return values, rows[:, None] * left, columns[:, None] * right


def companion(pencil: Pencil) -> Eigenpairs:
    """By QZ on the companion form, all DOF with states of both kinds."""
    return qz_of(pencil, 0)


def qz_of(pencil: Pencil, drifting: int) -> Eigenpairs:
    """By QZ in the states (q, q̇); the first `drifting` DOF have no stiffness, and of these q̇ alone is a state."""
    rows, columns = pencil.units
    M, D, K = (scaled(part, rows, columns) for part in (pencil.M, pencil.D, pencil.K))
    mass, damping, stiffness = (np.linalg.norm(part, 2) for part in (M, D, K))
    gamma = np.sqrt(stiffness / mass) if stiffness > 0 and mass > 0 else 1.0
    delta = 2 / (stiffness + gamma * damping) if stiffness + gamma * damping > 0 else 1.0
    n = pencil.size
    eye, zero, m = np.eye(n)[drifting:], np.zeros((n, n))[:, drifting:], n - drifting
    A = np.block([[zero[drifting:], eye], [-delta * K[:, drifting:], -delta * gamma * D]])
    B = np.block([[np.eye(m), zero.T], [zero, delta * gamma**2 * M]])
    values, left, right = _by_qz(A, B, len(A) if _regular(M) else _finite(A, B))
    top, bottom = right[:m], right[m:]
    with np.errstate(divide="ignore", invalid="ignore"):
        top = np.vstack([np.where(values == 0, 0.0, bottom[:drifting] / values), top])
    X = np.where(np.linalg.norm(top, axis=0) >= np.linalg.norm(bottom, axis=0), top, bottom)
    return gamma * values, unit_length(columns[:, None] * X), unit_length(rows[:, None] * left[m:])


def _finite(A: Array, B: Array) -> int:
    """The number of finite eigenvalues of A - λB.

    The null space of S = (A - σB)⁻¹B is removed until S has none (V. N. Kublanovskaya's staircase, by singular values).
    """
    try:
        S = la.solve(A - 0.37 * B, B, check_finite=False)
    except la.LinAlgError:  # singular for every σ, or for this one: QZ must decide
        return len(A)
    least = 10 * len(A) * EPS * np.linalg.norm(S, 2)
    while len(S):
        V, rank = la.svd(S)[2], int(np.count_nonzero(la.svdvals(S) > least))
        if rank == len(S):
            break
        S = V[:rank] @ S @ V[:rank].T
    return len(S)
