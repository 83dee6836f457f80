"""All eigenvalues of a small pencil whose M is singular or not definite: infinite eigenvalues are removed before QZ.

QZ would return infinite eigenvalues as finite ones of any size and sign: rounding makes an M of rank r regular, with 2n - 2r very
large eigenvalues instead of infinite ones. The remaining pencil, or a pencil that cannot be split, is solved by QZ in companion
form, scaled as proposed by Fan, Lin and Van Dooren (SIAM J. Matrix Anal. Appl. 26 (2004) 252).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import scipy.linalg as la

from femsub.algebra import SINGULAR, SUMS, equilibration, factor_of_mass, rank_of_mass, scaled, unit_length
from femsub.checks import EPS, Array
from femsub.model import Pencil

if TYPE_CHECKING:
    from femsub.model import RigidMotion

REGULAR = 1e12  # condition up to which a matrix is inverted
UNSURE = 8.0  # a singular value within this factor of the limit of a rank may be rounding or not
Eigenpairs: TypeAlias = tuple[Array, Array, Array]  # λ (k,), right and left shapes (n, k) of unit length
Solver: TypeAlias = Callable[[Pencil], Eigenpairs]  # of a pencil with a regular M


def _regular(A: Array) -> bool:
    """Whether A, after equilibration, is well conditioned enough to be inverted."""
    return bool(np.linalg.cond(scaled(A, *equilibration(A))) < REGULAR) if A.size else True


@dataclass(frozen=True, eq=False)
class Parts:
    """UᵀMV = diag(Σ, 0, 0) and, on the null space of M, UᵀDV = diag(Δ, 0): three groups of coordinates q = (q₁, q_a, q_b).

    U and V (n, n) are regular, and equal if M and D are symmetric. `clear` says whether no rank depends on rounding.
    """

    U: Array
    V: Array
    mass: Array
    drag: Array
    clear: bool

    @property
    def groups(self) -> tuple[slice, slice, slice]:
        rank, damped = len(self.mass), len(self.mass) + len(self.drag)
        return slice(rank), slice(rank, damped), slice(damped, len(self.U))


def parts_of(pencil: Pencil) -> Parts:
    """The coordinates with mass, with damping alone, and with neither.

    DOF without mass are not mixed with others. So a small damping among them gets no rounding errors from a larger damping
    elsewhere.
    """
    # DOF with mass get scales that make the entries of M similar in size, so that its rank is clear; DOF without mass get the
    # pencil's scales. The common factor between the two kinds comes from the DOF with mass, which have both
    moves = pencil.M.any(axis=1), pencil.M.any(axis=0)
    rows, columns = (np.where(on, own, unit * 2.0 ** np.rint(np.median(np.log2(own[on] / unit[on])))) if on.any() else unit
                     for own, unit, on in zip(equilibration(pencil.M), pencil.units, moves, strict=True))
    M, D = scaled(pencil.M, rows, columns), scaled(pencil.D, rows, columns)
    n = pencil.size
    bare = ~M.any(axis=0) & ~M.any(axis=1)
    own = np.flatnonzero(~bare)
    left, mass, right = _decomposed(M[np.ix_(own, own)])
    rank, clear = _rank(mass, np.abs(mass).max(initial=0.0), SINGULAR)
    if rank == n:
        return Parts(rows[:, None] * left, columns[:, None] * right, mass, mass[:0], clear)
    U, V = (np.zeros((n, n)) for _ in range(2))
    U[np.ix_(own, np.arange(len(own)))], V[np.ix_(own, np.arange(len(own)))] = left, right
    U[np.flatnonzero(bare), np.arange(len(own), n)] = V[np.flatnonzero(bare), np.arange(len(own), n)] = 1.0
    # null vectors that are single DOF are exact; the error of others is rounding relative to the smallest mass
    doubt = np.full((n - rank, n - rank), np.sqrt(n) * SUMS * np.linalg.norm(D, 2))
    if 0 < rank < len(own):
        doubt *= np.abs(mass[0] / mass[rank - 1])
    doubt[len(own) - rank:, len(own) - rank:] = EPS * SUMS * np.linalg.norm(D, 2)  # the square of a rounding
    doubt = np.maximum(doubt, _projected(pencil, rows[:, None] * U[:, rank:], columns[:, None] * V[:, rank:]))
    left, drag, right, damped, sure = _split(U[:, rank:], D, V[:, rank:], doubt)
    U[:, rank:], V[:, rank:] = U[:, rank:] @ left, V[:, rank:] @ right
    return Parts(rows[:, None] * U, columns[:, None] * V, mass[:rank], drag[:damped], clear and sure)


def _decomposed(A: Array) -> tuple[Array, Array, Array]:
    """A = L diag(s) Rᵀ with orthonormal L and R, |s| descending; L = R if A is symmetric, then s may be negative.

    s is computed as diag(LᵀAR): LAPACK's own s have errors of several roundings of the largest s, which would hide whether the
    smallest are 0.
    """
    if np.array_equal(A, A.T):
        left = right = la.eigh(A)[1] if len(A) else A
    else:
        left, _, right = la.svd(A)
        right = right.T
    size = np.einsum("ij,ij->j", left, A @ right)
    order = np.argsort(-np.abs(size), kind="stable")
    return left[:, order], size[order], right[:, order]


def _rank(sizes: Array, whole: float, least: float) -> tuple[int, bool]:
    """The number of singular values that are above the rounding of `whole`, and whether none is near that limit."""
    limit, size = max(least, len(sizes) * EPS) * whole, np.abs(sizes)
    return int(np.count_nonzero(size > limit)), not ((size > limit / UNSURE) & (size < limit * UNSURE)).any()


def _projected(pencil: Pencil, U: Array, V: Array) -> Array:
    """The rounding in UᵀDV of the projections that D stems from: EPS |U|ᵀG Gᵀ|V|, see `Pencil.noise`."""
    return EPS * (np.abs(U).T @ pencil.noise) @ (pencil.noise.T @ np.abs(V))


def _between(U: Array, A: Array, V: Array, doubt: Array | float = 0.0) -> tuple[Array, Array, bool]:
    """UᵀAV with 0 for entries within rounding or `doubt`; this limit, entry by entry; and whether no entry is near it."""
    found = U.T @ A @ V
    size, limit = np.abs(found), np.maximum(doubt, SUMS * (np.abs(U).T @ np.abs(A) @ np.abs(V)))
    return np.where(size > limit, found, 0.0), limit, not ((size > limit / UNSURE) & (size < limit * UNSURE)).any()


def _damping(pencil: Pencil, U: Array, V: Array) -> Array:
    """UᵀDV with 0 for entries within rounding, that of the projections that D stems from included."""
    return _between(U, pencil.D, V, _projected(pencil, U, V))[0]


def _split(U: Array, A: Array, V: Array, doubt: Array | float) -> tuple[Array, Array, Array, int, bool]:
    """L, s, R with LᵀUᵀAVR = diag(s), the number of |s|, the first, above rounding, and whether none is near that limit.

    L and R are not orthonormal: rows and columns are first scaled to similar size, so that large entries do not drown small ones
    in their rounding.
    """
    block, noise, sure = _between(U, A, V, doubt)
    r, c = equilibration(block)
    left, size, right = _decomposed(scaled(block, r, c))
    noise = scaled(np.where(np.outer(block.any(axis=1), block.any(axis=0)), noise, 0.0), r, c)
    rank, clear = _rank(size, 1.0, float(np.linalg.norm(noise)))
    return r[:, None] * left, size, c[:, None] * right, rank, sure and clear


def parted(pencil: Pencil, solve: Solver) -> Eigenpairs | None:
    """All finite eigenpairs, and no others, for a singular M with any null space, by the coordinates of `Parts`.

    q_b has neither mass nor damping and follows statically: 0 = K_b1 q₁ + D_b1 v₁ + K_ba q_a + K_bb q_b, v₁ = λq₁. Inserted
    into the other rows, this gives a pencil A - λE in (q₁, v₁, q_a) with a regular E. If the massless part has no damping, the
    result is a quadratic pencil again, with the regular Σ. If K_bb is singular, its null vectors are multipliers, as in
    `Pencil.freed`. Returns None if M is regular, or if a constraint holds velocities.
    """
    parts = parts_of(pencil)
    U, V, mass = parts.U, parts.V, parts.mass
    one, a, b = parts.groups
    rank, damped = len(parts.mass), len(parts.drag)
    if rank == pencil.size:
        return None
    D, K = _damping(pencil, U, V), U.T @ pencil.K @ V
    D[a, a], D[a, b], D[b, a], D[b, b] = np.diag(parts.drag), 0.0, 0.0, 0.0
    if not _regular(K[b, b]):
        if (found := as_multipliers(pencil, parts)) is None:
            return None
        changed, U, V, _ = found
        values, q, w = solve(changed)
        return values, unit_length(V @ q), unit_length(U @ w)
    G = -np.linalg.solve(K[b, b], np.hstack([K[b, one], D[b, one], K[b, a]]))
    g1, gv, ga = G[:, :rank], G[:, rank:2 * rank], G[:, 2 * rank:]
    if not damped and not D[one, b].any() and not D[b, one].any():
        values, q1, w1 = (solve(Pencil(np.diag(mass), D[one, one], K[one, one] + K[one, b] @ g1)) if rank else
                          (mass, *np.zeros((2, 0, 0))))  # without mass and damping nothing moves by itself
        qa = wa = np.zeros((0, len(values)))
        qb = g1 @ q1
    else:
        gamma = float(np.sqrt(np.linalg.norm(K) / np.abs(mass[0]))) if rank else 1.0  # λ = γμ, v = μq
        E, A = np.zeros((2, 2 * rank + damped, 2 * rank + damped))
        top, middle, low = slice(rank), slice(rank, 2 * rank), slice(2 * rank, None)
        E[top, top] = A[top, middle] = np.eye(rank)
        E[middle, middle] = gamma**2 * (np.diag(mass) + D[one, b] @ gv)
        E[middle, low], E[low, low] = gamma * (D[one, a] + D[one, b] @ ga), gamma * np.diag(parts.drag)
        A[middle, top], A[low, top] = -K[one, one] - K[one, b] @ g1, -K[a, one] - K[a, b] @ g1
        A[middle, middle] = -gamma * (D[one, one] + D[one, b] @ g1 + K[one, b] @ gv)
        A[low, middle] = -gamma * (D[a, one] + K[a, b] @ gv)
        A[middle, low], A[low, low] = -K[one, a] - K[one, b] @ ga, -K[a, a] - K[a, b] @ ga
        if not _regular(E):
            return None
        values, left, right = _by_qz(A, E, len(E))
        q1, qa = right[top], right[low]
        speed = right[middle]
        fast = (values != 0) & (np.linalg.norm(speed, axis=0) > np.linalg.norm(q1, axis=0))
        q1 = np.where(fast, speed / np.where(fast, values, 1.0), q1)
        values, w1, wa = gamma * values, left[middle], left[low]
        qb = g1 @ q1 + gv @ (q1 * values) + ga @ qa
    wb = -np.linalg.solve(K[b, b].T, (D[one, b].T @ w1) * values.conj() + K[one, b].T @ w1 + K[a, b].T @ wa)
    return values, unit_length(V @ np.vstack([q1, qa, qb])), unit_length(U @ np.vstack([w1, wa, wb]))


def as_multipliers(pencil: Pencil, parts: Parts) -> tuple[Pencil, Array, Array, bool] | None:
    """UᵀP(λ)V with multipliers as the last DOF, U, V, and whether their number is clear; None if a constraint holds velocities.

    Multipliers are the null vectors of K_bb.
    """
    *_, b = parts.groups
    U, V = parts.U.copy(), parts.V.copy()
    left, size, right, rank, clear = _split(U[:, b], pencil.K, V[:, b], 0.0)
    U[:, b], V[:, b] = U[:, b] @ left, V[:, b] @ right
    D, K, M = _damping(pencil, U, V), U.T @ pencil.K @ V, np.zeros(pencil.M.shape)
    held = slice(b.start + rank, None)
    if rank == len(size) or D[held].any() or D[:, held].any():
        return None
    M[:len(parts.mass), :len(parts.mass)] = np.diag(parts.mass)
    K[held, b], K[b, held] = 0.0, 0.0
    return Pencil(M, D, K), U, V, clear


def without_rigid(pencil: Pencil, motion: RigidMotion, solve: Solver) -> Eigenpairs:
    """All eigenpairs of a pencil with rigid motion, which gets λ = 0 exactly. QZ would return small numbers of any sign instead.

    M and D are symmetric. With K Z = 0, and D Z_f = 0 for the free motions Z_f of Z = [Z_f Z_d], let x = Z_f c + Z_d d + E y. y
    are all DOF except a few whose support would hold the model. The rows of c give c = -(Z_fᵀMZ_f)⁻¹Z_fᵀM (Z_d d + E y) for every
    λ ≠ 0. The remaining pencil has stiffness in y alone. If there is a d, the states are (y, ḋ, ẏ), since d itself has no energy.
    """
    Z, free, n = motion.shapes, motion.free, pencil.size
    heavy = np.sqrt(np.abs(pencil.M.diagonal()))  # rotations compare with translations, and no massless DOF holds the model
    turn = np.asarray(np.linalg.qr(heavy[:, None] * Z, mode="r"))  # triangular: the free motions stay the first
    Z = np.linalg.solve(turn.T, Z.T).T
    holding = la.qr((heavy[:, None] * Z).T, mode="r", pivoting=True)[1][:motion.count]
    rest = np.setdiff1d(np.arange(n), holding)
    T = np.hstack([Z[:, free:], np.eye(n)[:, rest]])
    M, D = (T.T @ part @ T for part in (pencil.M, pencil.D))
    K, moving = np.zeros_like(M), slice(motion.count - free, None)
    K[moving, moving] = pencil.K[np.ix_(rest, rest)]
    if free:
        momentum = Z[:, :free].T @ pencil.M
        inverse = np.linalg.inv(momentum @ Z[:, :free])
        drift = -inverse @ (momentum @ T)
        share, size = (momentum @ T).T @ drift, np.abs(Z[:, :free]).T @ np.abs(pencil.M) @ np.abs(T)
        size = size.T @ np.abs(inverse) @ size
        M = np.where(np.abs(M + share) > SUMS * size, M + share, 0.0)
        M *= np.outer(M.diagonal() > 0, M.diagonal() > 0)  # M ≥ 0: beside a 0 on the diagonal, its row is rounding
        rank = rank_of_mass(pencil.M) - free  # from the whole M: rounding would hide the rank of the rest
        terms = np.einsum("ij,ij->j", np.abs(T), np.abs(pencil.M) @ np.abs(T))
        most = min(max(rank, 0), int(np.count_nonzero(M.diagonal() > 0)))
        R = factor_of_mass(M, most, size.diagonal() + terms)[0]  # pivots have the largest ratio of mass to rounding
        lost = size / REGULAR + SUMS * np.sqrt(np.outer(terms, terms))
        M = R.T @ R if (np.abs(M - R.T @ R) <= lost).all() else M
        T = T + Z[:, :free] @ drift
    small = Pencil((M + M.T) / 2, (D + D.T) / 2, K).carrying(motion.none(len(M)), np.abs(T).T @ pencil.noise)
    if free == motion.count:
        values, x, y = solve(small)
    else:
        values, x, y = qz_of(small, motion.count - free)
    still = np.hstack([Z, Z[:, :free]])
    return (np.append(values, np.zeros(motion.zeros)), unit_length(np.hstack([T @ x, still])),
            unit_length(np.hstack([T @ y, still])))


def finite(pencil: Pencil) -> int | None:
    """The number of finite eigenvalues of a dense pencil; None if it depends on rounding, or on a constraint of velocities.

    It is 2n for a regular M, else 2 rank M + rank of D on the null space of M. This requires a regular K_bb, the stiffness where
    M and D are both 0, and a regular M₁₁ - D_1b K_bb⁻¹ D_b1. Multipliers are projected out. The rank r of M on the motions that
    they allow is confirmed by rank [[M, C], [B, 0]] = r + 2 (multipliers).
    """
    if (freed := pencil.freed) is not None:
        M = pencil.M + 0.0
        M[freed.held], M[:, freed.held] = pencil.K[freed.held], pencil.K[:, freed.held]
        rows, columns = equilibration(M)
        sizes = la.svdvals(scaled(M, rows, columns))
        rank, clear = _rank(sizes, 1.0, SINGULAR)
        left = freed.pencil
        moving = left.size if _regular(left.M) else len(parts_of(left).mass)
        return finite(left) if clear and rank - 2 * len(freed.held) == moving else None
    if _regular(pencil.M):
        return 2 * pencil.size
    parts = parts_of(pencil)
    if not parts.clear:
        return None
    one, _, b = parts.groups
    stiffness, D = parts.U[:, b].T @ pencil.K @ parts.V[:, b], _damping(pencil, parts.U, parts.V)
    if _regular(stiffness):
        added = D[one, b] @ np.linalg.solve(stiffness, D[b, one])
        return 2 * len(parts.mass) + len(parts.drag) if not added.any() or _regular(np.diag(parts.mass) - added) else None
    found = as_multipliers(pencil, parts)
    return finite(found[0]) if found is not None and found[3] else None


def _by_qz(A: Array, B: Array, number: int) -> Eigenpairs:
    """The `number` smallest λ of A - λB, left and right vectors; one less if a conjugate pair would be split."""
    rows, columns = equilibration(abs(A) + abs(B))
    A, B = scaled(A, rows, columns), scaled(B, rows, columns)
    (alpha, beta), left, right = la.eig(A, B, left=True, right=True, homogeneous_eigvals=True, check_finite=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.abs(alpha) / np.abs(beta)
    # LAPACK lists pairs side by side, Im λ > 0 first, conjugate up to rounding: a pair counts as a whole
    second = np.flatnonzero(alpha.imag < 0)
    alone = np.setdiff1d(np.arange(len(alpha)), second)
    weight = 1 + np.isin(alone + 1, second)
    order = np.argsort(np.where(np.isfinite(size[alone]), size[alone], np.inf), kind="stable")
    order = order[np.isfinite(size[alone[order]])]
    chosen = order[np.cumsum(weight[order]) <= number]
    pairs = np.repeat(alone[chosen], weight[chosen])
    values, left, right = alpha[pairs] / beta[pairs], left[:, pairs], right[:, pairs]
    ends = np.cumsum(weight[chosen])[weight[chosen] == 2] - 1
    values[ends], left[:, ends], right[:, ends] = values[ends].conj(), left[:, ends].conj(), right[:, ends].conj()
    return values, rows[:, None] * left, columns[:, None] * right


def qz_of(pencil: Pencil, drifting: int = 0) -> Eigenpairs:
    """Eigenpairs by QZ on the companion form, states (q, q̇); only q̇ for the first `drifting` DOF, which have no stiffness."""
    rows, columns = pencil.units
    M, D, K = (scaled(part, rows, columns) for part in (pencil.M, pencil.D, pencil.K))
    mass, damping, stiffness = (np.linalg.norm(part, 2) for part in (M, D, K))
    gamma = np.sqrt(stiffness / mass) if stiffness > 0 and mass > 0 else 1.0
    delta = 2 / (stiffness + gamma * damping) if stiffness + gamma * damping > 0 else 1.0
    n = pencil.size
    eye, zero, m = np.eye(n)[drifting:], np.zeros((n, n))[:, drifting:], n - drifting
    A = np.block([[zero[drifting:], eye], [-delta * K[:, drifting:], -delta * gamma * D]])
    B = np.block([[np.eye(m), zero.T], [zero, delta * gamma**2 * M]])
    number = 2 * n if _regular(M) else finite(pencil)
    values, left, right = _by_qz(A, B, _staircase(A, B) if number is None else number - drifting)
    top, bottom = right[:m], right[m:]
    with np.errstate(divide="ignore", invalid="ignore"):
        top = np.vstack([np.where(values == 0, 0.0, bottom[:drifting] / values), top])
    X = np.where(np.linalg.norm(top, axis=0) >= np.linalg.norm(bottom, axis=0), top, bottom)
    return gamma * values, unit_length(columns[:, None] * X), unit_length(rows[:, None] * left[m:])


def _staircase(A: Array, B: Array) -> int:
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
