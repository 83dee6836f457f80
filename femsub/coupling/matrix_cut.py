"""A pair of matrices cut into parts: which DOF each part has, and what of the matrices."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy.sparse as sp

from femsub.checks import EQUAL, Array, Matrix
from femsub.components import places_of
from femsub.errors import InputError


def members(graph: Matrix, owner: Array, ported: Array, count: int) -> tuple[Array, list[Matrix]]:
    """Which parts each node of a graph belongs to, bool (n, p), so that each edge lies within a part.

    Of two neighbours in different parts the one in the part of the lower number is a node at a cut, unless it lies under a port
    and the other does not. Nodes at a cut belong to every part with an inner node beside them. What is left are elements all of
    whose nodes are at a cut; each goes to one part.

    Returns
    -------
    member : ndarray of bool, shape (n, p)
    common : list of sparse, shape (n, n)
        For each part, how many inner nodes and such elements two nodes at a cut have in common.
    """
    edges, rank = sp.coo_array(graph), owner + count * ported
    shared = np.zeros(len(owner), dtype=bool)
    shared[edges.row[(owner[edges.row] != owner[edges.col]) & (rank[edges.row] < rank[edges.col])]] = True
    beside = sp.csr_array(graph.multiply(shared[:, None]))  # the rows of nodes at a cut
    between = sp.csr_array(beside.multiply(shared[None, :]))
    common = []
    for part in range(count):
        inner = sp.csr_array(beside.multiply((~shared & (owner == part))[None, :]))
        common.append(sp.csr_array((inner @ inner.T).multiply(between)))
    member = np.stack([one.diagonal() > 0 for one in common], axis=1)
    member[~shared, owner[~shared]] = True
    for part, element in _elements(between, sum(common), owner):
        member[element, part] = True
        pairs = np.repeat(element, len(element)), np.tile(element, len(element))
        common[part] = common[part] + sp.csr_array((np.ones(len(pairs[0])), pairs), shape=graph.shape)
    if not member.any(axis=0).all():
        raise InputError(f"into={count} parts of {len(owner)} nodes are too many: p{int(member.any(axis=0).argmin()) + 1} has no "
                         "node of its own. " + ("Take fewer" if count > 2 else "Cut a model that has more nodes, or its mesh"))
    return member, common


def _elements(between: Matrix, common: Matrix, owner: Array) -> Iterator[tuple[int, Array]]:
    """Sets of nodes at a cut that are neighbours of each other, with their part; together all pairs that `common` leaves out."""
    def near(node: int) -> set[int]:
        return set(between.indices[between.indptr[node]:between.indptr[node + 1]].tolist())

    found = sp.coo_array(common)
    known = sp.csr_array((np.ones(found.nnz), found.coords), shape=between.shape)
    bare = sp.coo_array(between - between.multiply(known))
    left = (bare.data > 0) & (bare.row <= bare.col)
    waiting = dict.fromkeys(zip(bare.row[left].tolist(), bare.col[left].tolist(), strict=True))
    for i, j in list(waiting):
        if (i, j) in waiting:
            element = {i, j}
            for k in sorted(near(i) & near(j) - element):
                if element <= near(k):
                    element.add(k)
            nodes = np.array(sorted(element))
            yield int(np.bincount(owner[nodes]).argmax()), nodes
            for one in nodes.tolist():
                for other in nodes.tolist():
                    waiting.pop((one, other), None)


def divided(B: Matrix, common: Sequence[Matrix], member: Array) -> list[Matrix]:
    """B (n, n) as a sum of matrices of the parts, each in the part's own rows.

    An entry between two DOF at a cut goes to the parts that have both, by what both have in `common` there. The diagonal entry
    goes to them as the sum of the absolute values beside it. So a diagonally dominant B has diagonally dominant parts. Where B
    is not dominant, the values are taken relative to sqrt(b_ii b_jj), and balanced.
    """
    shared = member.sum(axis=1) > 1
    inner = (member & ~shared[:, None]).astype(float)
    edges = sp.coo_array(B)
    at_cut = shared[edges.row] & shared[edges.col]
    rest = sp.csr_array((edges.data[~at_cut], (edges.row[~at_cut], edges.col[~at_cut])), shape=B.shape)
    row, column, values = edges.row[at_cut], edges.col[at_cut], edges.data[at_cut]
    share = np.stack([entries_at(one, row, column) for one in common], axis=1)  # of each entry (k, p)
    share = np.where(share.any(axis=1, keepdims=True), share, member[row] & member[column])
    share /= share.sum(axis=1, keepdims=True)
    own = np.flatnonzero(row == column)
    share[own] = 0.0
    diagonal = np.abs(B.diagonal())
    beside = abs(rest) @ inner
    np.add.at(beside, row, np.abs(values)[:, None] * share)
    dominant = beside.sum(axis=1) <= (1 + EQUAL) * diagonal
    if not dominant[shared].all():
        unit = np.where(diagonal > 0, diagonal, 1.0) ** -0.5
        scaled = sp.diags_array(unit) @ rest @ sp.diags_array(unit)
        balanced = _balanced(scaled, inner, row, column, (unit[row] * values * unit[column])[:, None] * share)
        beside = np.where(dominant[:, None], beside, balanced)
    beside = np.where(beside.any(axis=1, keepdims=True), beside, member)
    share[own] = beside[row[own]] / beside[row[own]].sum(axis=1, keepdims=True)
    found = []
    for number, chosen in enumerate(member.T):
        kept, place = np.flatnonzero(chosen), np.cumsum(chosen) - 1
        here = np.flatnonzero(share[:, number])
        added = values[here] * share[here, number]
        extra = sp.csr_array((added, (place[row[here]], place[column[here]])), shape=(len(kept), len(kept)))
        found.append(sp.csr_array(rest[kept][:, kept] + extra))
    return found


def _balanced(rest: Matrix, inner: Array, row: Array, column: Array, each: Array, steps: int = 100) -> Array:
    """Shares of the diagonal entries of a matrix with diagonal 1, (n, p), so that b_ij² ≤ b_ii b_jj in each part, if it can be.

    The matrix is `rest`, and in each part the entries `each` (k, p) at (row, column). The shares are balanced in so many `steps`
    at most: of random matrices that can be balanced 99 % need fewer than ten. The excess may rise on the way.
    """
    found = abs(rest) @ inner
    np.add.at(found, row, np.abs(each))
    alone = np.zeros_like(found)  # the largest b_ij² with an inner DOF j
    beside = sp.coo_array(rest)
    part = inner[beside.col].argmax(axis=1)
    outer = ~inner[beside.row].any(axis=1) & inner[beside.col].any(axis=1)
    np.maximum.at(alone, (beside.row[outer], part[outer]), beside.data[outer] ** 2)
    for _ in range(steps):
        found /= np.where((total := found.sum(axis=1, keepdims=True)) > 0, total, 1.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            excess = np.nan_to_num(alone / found)
            np.maximum.at(excess, row, np.nan_to_num(each**2 / (found[row] * found[column])))
        bad = excess.max(axis=1) > 1
        if not bad.any():
            break
        found[bad] *= np.sqrt(excess[bad])
    return found


def entries_at(A: Matrix, row: Array, column: Array) -> Array:
    """The entries at so many places of a sparse A (n, n)."""
    def number(row: Array, column: Array) -> Array:  # needs 64 bits where indices have 32
        return row.astype(np.int64) * A.shape[1] + column

    found = sp.coo_array(A)
    place = places_of(number(row, column), number(found.row, found.col))
    return np.append(found.data, 0.0)[place]
