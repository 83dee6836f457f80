"""The graph of a sparse matrix: its nodes, their layers from end to end, and the order in which to eliminate them."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, Matrix


def quotient(A: Matrix) -> tuple[Matrix, Array]:
    """The graph whose nodes are runs of rows with the same pattern (the DOF of a mesh node), and the numbers of these rows."""
    n = A.shape[0]
    mark = sp.csr_array((np.ones(A.nnz), A.indices, A.indptr), shape=A.shape) @ np.random.default_rng(0).random(n)
    fresh = np.ones(n, dtype=bool)
    fresh[1:] = np.abs(mark[1:] - mark[:-1]) > 1e-9 * mark[1:]
    first = np.flatnonzero(fresh)
    return A[first][:, first], np.diff(np.append(first, n)).astype(float)


def neighbours(graph: Matrix, nodes: Array) -> Array:
    start = graph.indptr[nodes]
    lengths = graph.indptr[nodes + 1] - start
    before = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    return graph.indices[np.repeat(start - before, lengths) + np.arange(lengths.sum())]


def layers(graph: Matrix, inside: Array, start: Array) -> list[Array]:
    """Layers of the nodes `inside` that are reached from `start`, by their distance."""
    waiting, layers = inside.copy(), [start]
    waiting[start] = False
    while True:
        near = neighbours(graph, layers[-1])
        near = np.unique(near[waiting[near]])
        if not len(near):
            return layers
        waiting[near] = False
        layers.append(near)


def good_order(A: Matrix) -> str | None:
    """The fill-reducing ordering: 'amd' for trees, 'amf' for surfaces, None where nested dissection (PORD) is faster.

    Minimum degree gives no fill in a tree (a chain, a branched shaft). PORD fills a chain by half and takes three times as
    long at 10⁶ DOF. On plates minimum fill has nearly as little fill as PORD and is faster by a quarter. In solids it is
    twice as slow.
    """
    A, n = sp.csr_array(A), A.shape[0]
    if A.nnz <= 3 * n:
        return "amd"
    filled = np.diff(A.indptr) > 0
    ends = A.indices[A.indptr[:-1][filled]], A.indices[A.indptr[1:][filled] - 1]
    nodes = 1 + int(np.count_nonzero(np.diff(ends[0]) | np.diff(ends[1])))  # DOF of a node: same first, last column
    # A node on a surface has 9 neighbours, itself included, and in a solid 15 and more. Beyond 300,000 DOF PORD is faster anyway.
    return "amf" if n <= 300_000 and A.nnz / n * nodes / n < 13 else None


def leaves_first(A: Matrix) -> Array | None:
    """An elimination order (n,) without fill, leaves first, if the graph of A is a forest; else None."""
    n = A.shape[0]
    edges = (A.nnz - int(np.count_nonzero(A.diagonal()))) // 2
    if edges >= n:
        return None
    pieces, label = sp.csgraph.connected_components(A, directed=False)
    if pieces != n - edges:  # there is a cycle
        return None
    # breadth first from the roots of all trees: an additional node has them as neighbours
    roots = sp.csr_array((np.ones(pieces), (np.unique(label, return_index=True)[1], np.zeros(pieces, dtype=int))), shape=(n, 1))
    whole = sp.block_array([[A, roots], [roots.T, None]], format="csr")
    return sp.csgraph.breadth_first_order(whole, n, return_predecessors=False)[:0:-1]


def slender(A: Matrix, band: int = 24) -> bool:
    """Whether A has a narrow band in reverse Cuthill-McKee order: chains, beams, shafts with few branches.

    `band` is the largest bandwidth. It is 3 for a beam in the plane and 11 for one in space; two branches double it.
    """
    A, n = sp.csr_array(A), A.shape[0]
    if A.nnz > (2 * band + 1) * n:
        return False
    place = np.argsort(sp.csgraph.reverse_cuthill_mckee(A, symmetric_mode=True))
    return bool(np.abs(place[A.indices] - np.repeat(place, np.diff(A.indptr))).max(initial=0) <= band)


def smooth_shape(A: Matrix) -> Array:
    """cos(πl/L) at the first DOF of each node in layer l = 0, …, L from end to end, (n,): a smooth shape with low energy."""
    graph, weight = quotient(sp.csr_array(A))
    inside = np.ones(len(weight), dtype=bool)
    found = layers(graph, inside, np.array([0]))
    found = layers(graph, inside, found[-1])
    shape = np.zeros(A.shape[0])
    first = np.concatenate([[0], np.cumsum(weight)[:-1]]).astype(int)
    for number, nodes in enumerate(found):
        shape[first[nodes]] = np.cos(np.pi * number / max(1, len(found) - 1))
    return shape
