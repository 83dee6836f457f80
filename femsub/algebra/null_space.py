"""The null space of M if it has no zero rows, because several DOF share one mass."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from femsub.checks import Array, Matrix

SINGULAR = 1e-14  # share of the largest eigenvalue of M, scaled to a unit diagonal, that counts as 0


def rank_of_mass(M: Matrix) -> int:
    """The rank of a positive semidefinite M (n, n): by the eigenvalues of SMS, s_i = m_ii^(-1/2), of each connected piece."""
    pieces, piece = connected_components(sp.csr_array(M), directed=False)
    rows = np.argsort(piece, kind="stable")
    counts = np.bincount(piece, minlength=pieces)
    mass, rank = M.diagonal(), 0
    rank += int(np.count_nonzero(mass[rows[np.repeat(counts, counts) == 1]]))
    for part in np.split(rows, np.cumsum(counts)[:-1]):
        if len(part) > 1:
            block = M[part][:, part]
            block = block.toarray() if sp.issparse(block) else block
            unit = _unit(block)
            sizes = np.linalg.eigvalsh(unit[:, None] * block * unit)
            rank += int(np.count_nonzero(sizes > SINGULAR * sizes[-1]))
    return rank


def massless_apart(M: Array, rank: int, stiffness: Array) -> tuple[Array, Array]:
    """T (n, n) with TᵀMT = [[M₁₁, 0], [0, 0]], M₁₁ of `rank` DOF. The last columns are motions that move no mass.

    The first columns are single DOF, those of `factor_of_mass`; a rotation would mix stiff DOF into soft ones.
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

    The pivot has the most mass left over its `stiffness` (n,). Else a stiff DOF of little mass would move far with motions that
    move no mass, and the stiffness of all others would be rounding beside its own.
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


def _unit(M: Array) -> Array:
    mass = M.diagonal()
    return np.where(mass > 0, mass, 1.0) ** -0.5
