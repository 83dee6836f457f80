"""Null spaces within rounding: of equations, of singular mass matrices, and of forces on given motions.

Three limits say what counts as rounding. A sum is compared with SUMS times the sizes of its terms, a vector of forces with
ROUNDING times the forces that cancel in it. The remainder of a row of size 1, beside other rows, is compared with DEPENDENT.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from femsub.algebra.matrices import is_symmetric
from femsub.checks import EPS, Array, Matrix

SUMS = 16 * EPS  # largest remainder seen of a sum of products that cancel, relative to the sizes of its terms
ROUNDING = 512 * EPS  # the same for the norm of forces in a motion that rounding has mixed with stiffer motions
SINGULAR = 64 * EPS  # an eigenvalue of M, scaled to a unit diagonal, counts as 0 up to this share of the largest
DEPENDENT = 1e-10  # a row is redundant if the others leave no more than this share of it; so are motions in some coordinates


def rank_of_mass(M: Matrix) -> int:
    """The rank of a positive semidefinite M (n, n): by the eigenvalues of SMS, s_i = m_ii^(-1/2), of each connected piece."""
    pieces, piece = connected_components(sp.csr_array(M), directed=False)
    rows = np.argsort(piece, kind="stable")
    counts = np.bincount(piece, minlength=pieces)
    rank = int(np.count_nonzero(M.diagonal()[rows[np.repeat(counts, counts) == 1]]))
    for part in np.split(rows, np.cumsum(counts)[:-1]):
        if len(part) > 1:
            block = M[part][:, part]
            block = block.toarray() if sp.issparse(block) else block
            mass = block.diagonal()
            unit = np.where(mass > 0, mass, 1.0) ** -0.5
            sizes = np.linalg.eigvalsh(unit[:, None] * block * unit)
            rank += int(np.count_nonzero(sizes > SINGULAR * sizes[-1]))
    return rank


def massless_apart(M: Array, rank: int, stiffness: Array) -> tuple[Array, Array]:
    """T (n, n), and TᵀMT = [[M₁₁, 0], [0, 0]] with M₁₁ of `rank` DOF. The last columns of T are motions that move no mass.

    The first columns are single DOF, the pivots of `factor_of_mass`; a rotation would mix stiff DOF into soft ones.
    """
    import scipy.linalg as la

    R, order = factor_of_mass(M, rank, stiffness)
    rest = np.setdiff1d(np.arange(len(M)), order)
    T, kept = np.zeros(M.shape), np.zeros(M.shape)
    T[np.append(order, rest), np.arange(len(M))] = 1.0
    T[order, rank:] = -la.solve_triangular(R[:, order], R[:, rest])
    kept[:rank, :rank] = M[np.ix_(order, order)]
    return T, kept


def factor_of_mass(M: Array, rank: int, stiffness: Array) -> tuple[Array, Array]:
    """R (rank, n) with M = RᵀR, by Cholesky's decomposition with pivots, and the pivots (rank,).

    A pivot has the largest ratio of remaining mass to `stiffness` (n,). Otherwise a stiff DOF of little mass would move far in
    the motions that move no mass, and the stiffness of all others would be rounding beside its own.
    """
    n, mass = len(M), M.diagonal()
    left, R, order = mass.copy(), np.zeros((rank, n)), np.zeros(0, dtype=np.intp)
    speed = np.divide(1.0, stiffness, out=np.full(n, np.inf), where=stiffness > 0)
    for k in range(rank):
        clear = left > SINGULAR * mass
        score = np.multiply(left, speed, out=np.full(n, -1.0), where=clear) if clear.any() else left.copy()
        score[order] = -np.inf
        order = np.append(order, score.argmax())
        R[k] = (M[order[k]] - R[:k, order[k]] @ R[:k]) / np.sqrt(left[order[k]])
        left = np.maximum(left - R[k] ** 2, 0.0)
    return R, order


@dataclass(frozen=True, eq=False)
class RowSpace:
    """Qᵀ Aᵀ[:, order] = R of a dense A (m, n), with pivots: Q = [Q₁ Q₂], Q₁ (n, rank) spans its rows, A Q₂ = 0.

    `doubt` is the largest pivot near the limit, which may or may not be rounding; 0 where all pivots are clear.
    """

    Q: Array
    R: Array
    order: Array
    rank: int
    doubt: float

    @property
    def rest(self) -> Array:
        """Q₂ (n, n - rank)."""
        return self.Q[:, self.rank:]


def row_space(A: Array, dependent: float = DEPENDENT, unsure: float = 100.0, basis: bool = True) -> RowSpace:
    """The row space of an A (m, n) with rows of size 1; a row whose pivot is not above `dependent` counts as redundant.

    A pivot within a factor `unsure` of `dependent` is in doubt. The rounding of shapes and places lies below that range. Without
    `basis`, Q is empty.
    """
    import scipy.linalg as la

    found = la.qr(A.T, mode="full" if basis else "r", pivoting=True, check_finite=False)
    Q, R, order = found if basis else (np.zeros((A.shape[1], 0)), *found)
    pivots = np.abs(R.diagonal())
    near = pivots[(pivots > dependent / unsure) & (pivots < dependent * unsure)]
    return RowSpace(Q, R, order, int(np.count_nonzero(pivots > dependent)), float(near.max(initial=0.0)))


def null_space(B: Array, size: Array, free: float = 3e-8) -> Array | None:
    """N (r, k), a basis of all c with B c = 0; None where rounding leaves its size open.

    `size` (m, r) ≥ |B| is the size of the terms that cancel in B. A condition, a row of B, counts as met if c violates it by less
    than `free` times its terms. Within a factor of 30 of that the answer is open. The motions of reduced parts contain some 1e-10
    of other motions.

    Rows and columns are first scaled by `size`, so that neither units nor masses matter. The factors bring the entries of `size`
    nearest to 1 in the mean of their logarithms. The largest entry of a row is no measure: where the row joins a large motion to
    a small one, only the large one decides it.
    """
    r = B.shape[1]
    rows = size.any(axis=1)
    B, size = B[rows], size[rows]
    if not len(B):
        return np.eye(r)
    there = size > 0
    share = there / there.sum(axis=1, keepdims=True)
    log = np.log(size, out=np.zeros_like(size), where=there)
    log -= there * (share * log).sum(axis=1, keepdims=True)
    columns = np.exp(np.linalg.lstsq(np.diag(there.sum(axis=0)) - there.T @ share, log.sum(axis=0), rcond=None)[0])
    widest = (size / columns).max(axis=1, keepdims=True)
    columns *= np.where(there.any(axis=0), (size / columns / widest).max(axis=0), 1.0)
    B = B / widest / columns
    found = row_space(B, free, 30.0)
    return None if found.doubt else (found.rest.T / columns).T


def sizes(Z: Array, unit: Array, least: float = 1e-3) -> Array:
    """|Z| (n, r) plus the share `least` of each column's largest displacement, measured in the units (n,) of the DOF.

    A DOF that moves less than this share may do so by rounding.
    """
    size = np.abs(Z)
    return size + least * unit[:, None] * (size / unit[:, None]).max(axis=0, initial=0.0)


def unresisted(A: Matrix, Z: Array, unit: Array) -> tuple[Array, Array]:
    """The motions Z (n, r), rotated so that as many as possible have A z = 0, and the indices of these; `unit` scales the DOF.

    A may be several matrices below each other; `unit` is then repeated for each of them.
    """
    turn, free = undamped(A, Z, unit)
    return Z @ turn, free


def undamped(A: Matrix, Z: Array, unit: Array) -> tuple[Array, Array]:
    """The rotation (r, r) of `unresisted`, and the indices of the motions with A z = 0."""
    turn = np.linalg.svd(unit[:, None] * (A @ Z), full_matrices=False)[2].T
    size = sizes(Z, unit[:len(Z)], 1.0).sum(axis=1)  # of all motions: one at rest at the dashpot has no scale
    scale = np.linalg.norm(unit * (abs(A) @ size))
    return turn, np.flatnonzero(np.linalg.norm(unit[:, None] * (A @ (Z @ turn)), axis=0) <= ROUNDING * scale)


def without(A: Array, Z: Array, unit: Array) -> Array:
    """PᵀAP (n, n) with P Z = 0, so that A Z, which is rounding, becomes 0. P is an orthogonal projection in units of `unit`.

    If A is not symmetric, the result is A P: only the product with Z is removed.
    """
    if not Z.shape[1]:
        return A
    scaled = Z / unit[:, None]
    force = A @ Z
    if not force.any():
        return A
    # ZᵀG = I; a pseudo-inverse, as motions may be dependent if only some of the coordinates are considered
    G = np.linalg.pinv(scaled, rcond=DEPENDENT).T / unit[:, None]
    if not is_symmetric(A):
        return A - force @ G.T
    result = A - force @ G.T - G @ force.T + G @ (Z.T @ force) @ G.T
    return (result + result.T) / 2

