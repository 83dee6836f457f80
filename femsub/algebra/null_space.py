"""The null space of M if it has no zero rows, because several DOF share one mass."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from femsub.checks import Array, Matrix

SINGULAR = 1e-14  # eigenvalues of M, scaled to a unit diagonal, that count as 0


def rank_of_mass(M: Matrix) -> int:
    """The rank of a positive semidefinite M (n, n): by the eigenvalues of SMS, s_i = m_ii^(-1/2), of each connected piece."""
    pieces, piece = connected_components(sp.csr_array(M), directed=False)
    rows = np.argsort(piece, kind="stable")
    sizes = np.bincount(piece, minlength=pieces)
    mass, rank = M.diagonal(), 0
    rank += int(np.count_nonzero(mass[rows[np.repeat(sizes, sizes) == 1]]))
    for part in np.split(rows, np.cumsum(sizes)[:-1]):
        if len(part) > 1:
            block = M[part][:, part]
            block = block.toarray() if sp.issparse(block) else block
            unit = _unit(block)
            rank += int(np.count_nonzero(np.linalg.eigvalsh(unit[:, None] * block * unit) > SINGULAR))
    return rank


def massless_apart(M: Array, rank: int, stiffness: Array) -> tuple[Array, Array]:
    """T (n, n) with TᵀMT = [[M₁₁, 0], [0, 0]], M₁₁ of `rank` DOF. The last columns are motions that move no mass.

    The first columns are single DOF, by Cholesky's decomposition with pivots; a rotation would mix stiff DOF into soft ones. The
    pivot has the most mass left over its `stiffness` (n,). Else a stiff DOF of little mass would move far with each motion that
    moves no mass, and the stiffness of all others would be rounding beside its own.
    """
    import scipy.linalg as la

    n, mass = len(M), M.diagonal()
    left, R, order = mass.copy(), np.zeros((rank, n)), np.zeros(0, dtype=np.intp)
    speed = np.divide(1.0, stiffness, out=np.full(n, np.inf), where=stiffness > 0)
    for k in range(rank):
        clear = left > SINGULAR * mass
        score = np.where(clear, left * speed, -1.0) if clear.any() else np.divide(left, mass, out=np.zeros(n), where=mass > 0)
        score[order] = -np.inf
        order = np.append(order, score.argmax())
        R[k] = (M[order[k]] - R[:k, order[k]] @ R[:k]) / np.sqrt(left[order[k]])
        left = np.maximum(left - R[k] ** 2, 0.0)
    rest = np.setdiff1d(np.arange(n), order)
    T, kept = np.zeros((n, n)), np.zeros((n, n))
    T[np.append(order, rest), np.arange(n)] = 1.0
    T[order, rank:] = -la.solve_triangular(R[:, order], R[:, rest])
    kept[:rank, :rank] = M[np.ix_(order, order)]
    return T, kept


def _unit(M: Array) -> Array:
    mass = M.diagonal()
    return np.where(mass > 0, mass, 1.0) ** -0.5
