"""What extreme cases are judged by: 60 digits (mpmath), Sturm counts, condition numbers, none of it from femsub."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from mpmath import mp
from scipy.optimize import linear_sum_assignment

EPS = float(np.finfo(float).eps)
Array = np.ndarray
mp.dps = 60


def dense(matrix: Any) -> Array:
    return matrix.toarray() if sp.issparse(matrix) else np.asarray(matrix, dtype=float)


def exact(matrix: Any) -> Any:
    """The doubles as they are, in an mpmath matrix."""
    return mp.matrix(dense(matrix).tolist())


class Sturm:
    """How many eigenvalues of Kφ = λMφ lie below σ: the negative pivots of K - σM = LDLᵀ in 60 digits, M semidefinite.

    Without pivoting, in a band-reducing order: 60 digits bear the growth.
    """

    def __init__(self, K: Any, M: Any) -> None:
        K, M = sp.csr_array(K), sp.csr_array(M)
        order = sp.csgraph.reverse_cuthill_mckee(sp.csr_array(abs(K) + abs(M)), symmetric_mode=True)
        upper = [sp.triu(part[order][:, order]).tocoo() for part in (K, M)]
        self.rows: list[dict[int, list[Any]]] = [{} for _ in range(K.shape[0])]
        for which, part in enumerate(upper):
            for i, j, value in zip(part.row, part.col, part.data, strict=True):
                self.rows[i].setdefault(int(j), [mp.zero, mp.zero])[which] += mp.mpf(float(value))

    def count(self, sigma: Any) -> int:
        """Eigenvalues below σ."""
        rows = [{j: k - sigma * m for j, (k, m) in row.items()} for row in self.rows]
        negative = 0
        for i, row in enumerate(rows):
            pivot = row.pop(i, mp.zero)
            if pivot == 0:
                if not any(row.values()):
                    continue  # a DOF on its own with λ = σ
                pivot = mp.mpf(10) ** -50 * max(abs(value) for value in row.values())
            negative += pivot < 0
            entries = sorted(row.items())
            for at, (j, value) in enumerate(entries):
                if value:
                    factor, below = value / pivot, rows[j]
                    for k, other in entries[at:]:
                        below[k] = below.get(k, mp.zero) - factor * other
        return negative

    def errors(self, values: Iterable[float], first: int = 1) -> Array:
        """Relative distance of each value (ascending) to the eigenvalue of its number, `first` that of the first one.

        The smallest δ, to a tenth of a decade, for which the counts at λ(1 - δ) and λ(1 + δ) enclose that number; 1 stands
        for all that is further off, and 1e-18 for no difference.
        """
        def encloses(value: float, number: int, power: float) -> bool:
            delta = mp.mpf(10) ** power
            return self.count(value * (1 - delta)) < number <= self.count(value * (1 + delta))

        result = []
        for number, value in enumerate(values, first):
            low, high = -18.0, 0.0
            while high - low > 0.1:
                middle = (low + high) / 2
                low, high = (low, middle) if encloses(float(value), number, middle) else (middle, high)
            result.append(10**high)
        return np.array(result)


def symmetric(K: Any, M: Any) -> list[Any]:
    """All λ of Kφ = λMφ in 60 digits, ascending; M definite, a few DOF."""
    inverse = mp.cholesky(exact(M)) ** -1
    return sorted(mp.eigsy(inverse * exact(K) * inverse.T, eigvals_only=True))


def quadratic(M: Any, D: Any, K: Any) -> list[Any]:
    """All finite λ of (λ²M + λD + K)x = 0 in 60 digits: a companion matrix of it, or of its reverse where M is singular."""
    parts, n = [exact(part) for part in (M, D, K)], np.shape(M)[0]
    reverse = np.linalg.matrix_rank(dense(M)) < n
    if reverse:
        parts = parts[::-1]
    lead = parts[0] ** -1
    companion = mp.zeros(2 * n)
    for i in range(n):
        companion[i, n + i] = mp.one
    low, middle = -(lead * parts[2]), -(lead * parts[1])
    for i in range(n):
        for j in range(n):
            companion[n + i, j], companion[n + i, n + j] = low[i, j], middle[i, j]
    found = mp.eig(companion, left=False, right=False)
    if reverse:
        size = max(abs(value) for value in found)
        found = [1 / value for value in found if abs(value) > size * mp.mpf(10) ** -25]
    return list(found)


def matched(found: Array, reference: list[Any]) -> tuple[Array, Array]:
    """|λ - λ*| of each computed eigenvalue and the number of its partner, as sets by least total distance; NaN and -1
    where it has none.
    """
    there = np.array([complex(value) for value in reference])
    rows, columns = linear_sum_assignment(np.abs(found[:, None] - there))
    distance, partner = np.full(len(found), np.nan), np.full(len(found), -1)
    for i, j in zip(rows, columns, strict=True):
        distance[i], partner[i] = float(abs(mp.mpc(complex(found[i])) - reference[j])), j
    return distance, partner


def border(M: Any, D: Any, K: Any, w: Array, omega: float) -> tuple[Any, Any]:
    """ω and c = -1/G in 60 digits next to a given ω, where Im G = 0 for G(ω) = iω wᵀ(-ω²M + iωD + K)⁻¹w."""
    mass, damping, stiffness, column = exact(M), exact(D), exact(K), mp.matrix(w.tolist())

    def G(at: Any) -> Any:
        return 1j * at * (column.T * mp.lu_solve(stiffness - at * at * mass + 1j * at * damping, column))[0]

    root = mp.findroot(lambda at: G(at).imag, (omega, omega * (1 + 1e-9)), tol=1e-80)
    return root, (-1 / G(root)).real


def entry_condition(K: Any, shapes: Array, values: Array) -> Array:
    """|φ|ᵀ|K||φ| / λ for ΦᵀMΦ = I: by how many eps λ moves, relatively, when each entry of K moves by one."""
    size = np.abs(shapes)
    return np.einsum("ij,ij->j", size, abs(K) @ size) / values


def energy_state(M: Any, D: Any, K: Any) -> tuple[Array, Array]:
    """‖A‖₂ of the state matrix in energy coordinates, its eigenvalues, and their condition numbers 1/|yᴴx|.

    A backward stable method moves λ by eps ‖A‖ / |yᴴx|, to first order.
    """
    M, D, K = dense(M), dense(D), dense(K)
    root = la.cholesky(M)
    inverse = la.solve_triangular(root, np.eye(len(M)))
    stiffness = inverse.T @ K @ inverse
    values, shapes = la.eigh((stiffness + stiffness.T) / 2)
    omega = np.sqrt(np.maximum(np.abs(values), 1e-16 * np.abs(values).max()))
    A = np.block([[np.zeros_like(K), np.diag(omega)],
                  [-(shapes.T @ stiffness @ shapes) / omega, -(shapes.T @ inverse.T @ D @ inverse @ shapes)]])
    found, left, right = la.eig(A, left=True, right=True)
    with np.errstate(divide="ignore"):
        return np.append(found, np.linalg.norm(A, 2)), 1 / np.abs(np.einsum("ij,ij->j", left.conj(), right))
