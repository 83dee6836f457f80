"""A sparse pencil split into a proportionally damped part, whose modes are the undamped ones, and a few columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from femsub.checks import Array, Matrix
from femsub.model import contact_matrix

if TYPE_CHECKING:
    from femsub.model import Pencil

RANK = 40  # largest number of columns of W
JUDGES = 500  # rows on which α and β are tested
FILLED = 0.1  # entries of D are compared with at least this share of sqrt(d_ii d_jj)
EXACT = 1e-12  # relative difference of D and αM + βK, entry by entry, that counts as rounding


@dataclass(frozen=True, eq=False)
class Split:
    """P(s) = (1 + βs)K0 + (s² + αs)M + W(sC_D + C_K)Wᵀ: K0 symmetric (n, n), W (n, q) orthonormal, C_D, C_K (q, q).

    Or P(s) = K0 + s²M + sG with `skew` G = -Gᵀ (n, n), of a part that turns.
    """

    M: Matrix
    K0: Matrix
    alpha: float
    beta: float
    W: Array
    C_D: Array
    C_K: Array
    skew: Matrix | None = None

    def coupling(self, s: Array) -> Array:
        """sC_D + C_K at each s, shape (m, q, q)."""
        return s[:, None, None] * self.C_D + self.C_K

    def squared(self, s: Array) -> Array:
        """ζ with (1 + βs)(K0 + ζM) = P0(s): takes the place of -ω² of the undamped problem."""
        return s * (s + self.alpha) / (1 + self.beta * s)


def split(pencil: Pencil) -> Split | None:
    """The split pencil; None if more than 40 columns W are needed, e.g. because the damping is nowhere proportional.

    No columns are needed where D is skew and K symmetric.
    """
    if not pencil.is_sparse or not pencil.symmetric[0]:
        return None
    found, D = _proportional_but_for_columns(pencil), pencil.D
    if found is not None:
        return found
    # a part that turns: D is skew within rounding, K symmetric
    if pencil.contacts or pencil.symmetric[1:] != (False, True) or abs(D + D.T).max() > EXACT * abs(D).max():
        return None
    none = np.zeros((0, 0))
    return Split(pencil.M, pencil.K, 0.0, 0.0, np.zeros((pencil.size, 0)), none, none, (D - D.T) * 0.5)


def _proportional_but_for_columns(pencil: Pencil) -> Split | None:
    M, D, K0 = pencil.M, pencil.D, pencil.symmetric_stiffness
    rng = np.random.default_rng(11)
    circulatory = [] if K0 is pencil.K0 else [pencil.halves[1]]
    if any(_rank_of_some_rows(part[np.unique(part.nonzero()[0])], rng) > RANK for part in circulatory):
        return None  # before the damping is looked at, which takes longer
    own = np.sqrt(np.abs(D.diagonal()))
    if pencil.contacts:  # D - Σ W C Wᵀ, without what is rounding beside d_ii
        for C, _, W in pencil.contacts:
            D = D - contact_matrix(W, C)
        rest = sp.coo_array(D)
        keep = np.abs(rest.data) > EXACT * FILLED * own[rest.row] * own[rest.col]
        D = sp.csr_array((rest.data[keep], (rest.row[keep], rest.col[keep])), shape=D.shape)
    alpha, beta = _proportional(M, K0, D, own)
    parts = [_without(D, alpha, M, beta, K0, own), *circulatory]
    rows = np.unique(np.concatenate([np.concatenate(part.nonzero()) for part in parts]))
    small = [part[rows][:, rows] for part in parts]
    sketch = [np.zeros((len(rows), 0))]
    if _rank_of_some_rows(small[0], rng) > RANK:
        return None
    for part in small:
        size = abs(part).max() if part.nnz else 0.0
        if size:  # explicit zeros may be stored
            probes = rng.standard_normal((len(rows), RANK + 10))
            sketch += [part @ probes / size, part.T @ probes / size]
    Q, sizes, _ = np.linalg.svd(np.hstack(sketch), full_matrices=False)
    Q = Q[:, sizes > 1e-13 * sizes.max(initial=0.0)]
    if Q.shape[1] > RANK:
        return None
    cores = [Q.T @ (part @ Q) for part in small] + [np.zeros((Q.shape[1], Q.shape[1]))]
    W = np.zeros((pencil.size, Q.shape[1]))
    W[rows] = Q
    C_D, C_K = cores[:2]
    if pencil.contacts:  # their columns join W
        W = np.hstack([W, *(one for *_, one in pencil.contacts)])
        if W.shape[1] > RANK:
            return None
        W, R = la.qr(W, mode="economic")
        terms = [[C if np.ndim(C) else C * np.eye(one.shape[1]) for C in both] for *both, one in pencil.contacts]
        C_D, C_K = (R @ la.block_diag(core, *added) @ R.T for core, *added in zip((C_D, C_K), *terms, strict=True))
    return Split(M, K0, alpha, beta, W, C_D, C_K)


def _rank_of_some_rows(part: Matrix, rng: np.random.Generator) -> int:
    """A lower bound of the rank from a few rows: a cheap test that rules out most dampings that are nowhere proportional."""
    rows = part[rng.choice(part.shape[0], min(part.shape[0], 2 * RANK), replace=False)]
    sizes = la.svdvals(rows[:, np.unique(rows.indices)].toarray()) if rows.nnz else np.zeros(1)
    return int(np.count_nonzero(sizes > 1e-13 * sizes[0]))


def _without(D: Matrix, alpha: float, M: Matrix, beta: float, K: Matrix, own: Array, rows: Array | None = None) -> Matrix:
    """D - αM - βK, or some of its rows, without entries that are rounding.

    `own` is sqrt(d_ii): a reduced D is a product of matrices, so its rounding everywhere has the size of the diagonal's.
    """
    if not alpha and not beta:
        return D
    rest = sp.coo_array(D - alpha * M - beta * K)
    scale = sp.csr_array(abs(D) + abs(alpha) * abs(M) + abs(beta) * abs(K))
    beside = own[rest.row if rows is None else rows[rest.row]] * own[rest.col]
    allowed = EXACT * np.maximum(np.asarray(scale[rest.row, rest.col]).ravel(), FILLED * beside)
    keep = np.abs(rest.data) > allowed
    return sp.csr_array((rest.data[keep], (rest.row[keep], rest.col[keep])), shape=D.shape)


def _proportional(M: Matrix, K: Matrix, D: Matrix, own: Array) -> tuple[float, float]:
    """α and β with D = αM + βK on most rows, or (0, 0).

    They are fitted to a few random rows at a time. Each trial is tested on some hundred other rows.
    """
    if np.count_nonzero(np.diff(D.indptr)) <= D.shape[0] // 2:
        return 0.0, 0.0
    rng = np.random.default_rng(7)
    best, found, judges = 0, (0.0, 0.0), rng.choice(D.shape[0], min(D.shape[0], JUDGES), replace=False)
    M, K, D = M[judges], K[judges], D[judges]
    n = len(judges)
    for _ in range(12):
        rows = rng.choice(n, min(n, 3), replace=False)
        m, k, d = (part[rows].toarray().ravel() for part in (M, K, D))
        scale = np.array([np.abs(m).max(), np.abs(k).max()])
        if not scale.all():
            continue
        (a, b), *_ = np.linalg.lstsq(np.stack([m, k], axis=1) / scale, d, rcond=None)
        # If damping is purely mass- or stiffness-proportional, drop the spurious other coefficient.
        a, b = (0.0 if abs(x) <= 1e-12 * max(abs(a), abs(b)) else x for x in (a, b))
        a, b = float(a / scale[0]), float(b / scale[1])
        clean = n - len(np.unique(_without(D, a, M, b, K, own, judges).nonzero()[0]))
        if clean > best:
            best, found = clean, (a, b)
        if clean > 0.5 * n:
            break
    return found
