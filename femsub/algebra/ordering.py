"""The graph of a sparse matrix: its nodes, and layers of them from one end of a component to the other."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, Matrix

FLAT = 300_000  # DOF up to which minimum fill is faster for surfaces
SURFACE = 13  # mean number of neighbours of a node, itself included: 9 on a surface, 15 and more in a solid
SLENDER = 20  # nonzeros per row up to which the bandwidth is looked at
BAND = 24  # largest bandwidth of a slender model (a chain, a beam): 3 for a beam in the plane
TREES = 50  # largest number of trees in a forest: each is traversed separately


def quotient(A: Matrix) -> tuple[Matrix, Array]:
    """The graph whose nodes are runs of rows with the same pattern (the DOF of a mesh node), and their sizes."""
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
    return "amf" if n <= FLAT and A.nnz / n * nodes / n < SURFACE else None


def leaves_first(A: Matrix) -> Array | None:
    """An elimination order (n,) without fill, leaves first, if the graph of A is a forest of few trees; else None."""
    n = A.shape[0]
    edges = (A.nnz - int(np.count_nonzero(A.diagonal()))) // 2
    if not 0 < n - edges <= TREES:
        return None
    pieces, label = sp.csgraph.connected_components(A, directed=False)
    if pieces != n - edges:  # there is a cycle
        return None
    roots = np.unique(label, return_index=True)[1]
    return np.concatenate([sp.csgraph.breadth_first_order(A, root, return_predecessors=False) for root in roots])[::-1]


def slender(A: Matrix) -> bool:
    """Whether A has a narrow band in reverse Cuthill-McKee order: chains, beams, shafts with few branches."""
    A, n = sp.csr_array(A), A.shape[0]
    if A.nnz > SLENDER * n:
        return False
    place = np.argsort(sp.csgraph.reverse_cuthill_mckee(A, symmetric_mode=True))
    return bool(np.abs(place[A.indices] - np.repeat(place, np.diff(A.indptr))).max(initial=0) <= BAND)


def smooth_shape(A: Matrix) -> Array:
    """cos(πl/L) on one DOF of each node in layer l of L + 1 from end to end: a smooth shape with low energy."""
    graph, weight = quotient(sp.csr_array(A))
    inside = np.ones(len(weight), dtype=bool)
    found = layers(graph, inside, np.array([0]))
    found = layers(graph, inside, found[-1])
    shape = np.zeros(A.shape[0])
    first = np.concatenate([[0], np.cumsum(weight)[:-1]]).astype(int)
    for number, nodes in enumerate(found):
        shape[first[nodes]] = np.cos(np.pi * number / max(1, len(found) - 1))
    return shape
