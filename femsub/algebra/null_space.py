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


def massless_apart(M: Array, rank: int) -> tuple[Array, Array]:
    """T (n, n) with TᵀMT = [[M₁₁, 0], [0, 0]], M₁₁ of `rank` DOF. The last columns are motions that move no mass.

    The first columns are single DOF (pivoted Cholesky of SMS); a rotation would mix stiff DOF into soft ones.
    """
    import scipy.linalg as la

    n, unit = len(M), _unit(M)
    R, pivots = la.lapack.dpstrf(unit[:, None] * M * unit, tol=0.0)[:2]
    order = pivots - 1
    T = np.zeros((n, n))
    T[order, np.arange(n)] = 1.0
    null = -la.solve_triangular(R[:rank, :rank], R[:rank, rank:])
    T[order[:rank], rank:] = unit[order[:rank], None] * null / unit[order[rank:]]
    mass = np.zeros((n, n))
    mass[:rank, :rank] = M[np.ix_(order[:rank], order[:rank])]
    return T, mass


def _unit(M: Array) -> Array:
    mass = M.diagonal()
    return np.where(mass > 0, mass, 1.0) ** -0.5
