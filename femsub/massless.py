"""Motions that move no mass where M does not show them by zero rows: some DOF then share their mass with others."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from femsub.pencil import Array, Matrix

SINGULAR = 1e-14  # eigenvalues of M, scaled to a unit diagonal, that are rounding


def rank_of_mass(M: Matrix) -> int:
    """The rank of a positive semidefinite M (n, n), of each connected piece by the eigenvalues of SMS, s_i = m_ii^(-1/2)."""
    pieces, piece = connected_components(sp.csr_array(M), directed=False)
    rows = np.argsort(piece, kind="stable")
    sizes = np.bincount(piece, minlength=pieces)
    mass, rank = M.diagonal(), 0
    rank += int(np.count_nonzero(mass[rows[np.repeat(sizes, sizes) == 1]]))
    for part in np.split(rows, np.cumsum(sizes)[:-1]):
        if len(part) > 1:
            block = M[part][:, part]
            values = _scaled(block.toarray() if sp.issparse(block) else block)[0]
            rank += int(np.count_nonzero(values > SINGULAR))
    return rank


def massless_apart(M: Array, rank: int) -> tuple[Array, Array]:
    """T (n, n) and TᵀMT = diag(m, 0): the first `rank` columns move mass, the others none; T is as regular as M is scaled."""
    values, vectors, unit = _scaled(M)
    mass = np.where(np.arange(len(M)) < rank, values[::-1], 0.0)
    return unit[:, None] * vectors[:, ::-1], np.diag(mass)


def _scaled(M: Array) -> tuple[Array, Array, Array]:
    """Eigenvalues, ascending, and vectors of SMS, and the diagonal of S; of a DOF without mass s = 1."""
    mass = M.diagonal()
    unit = np.where(mass > 0, mass, 1.0) ** -0.5
    values, vectors = np.linalg.eigh(unit[:, None] * M * unit)
    return values, vectors, unit
