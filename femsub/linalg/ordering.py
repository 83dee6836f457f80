"""The graph of a sparse matrix: its nodes, and layers of them from one end of a component to the other."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, Matrix

FLAT = 300_000  # DOF of a surface up to which minimum fill is the quicker
SURFACE = 13  # nodes around one, itself counted: 9 on a surface, 15 and more in a body
TREES = 50  # a matrix may fall into, each of which is walked through by itself


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
    """'amd' for trees and 'amf' for surfaces, None where nested dissection (PORD) makes up for its own time.

    Minimum degree leaves a tree (a chain, a branched shaft) without any fill, where PORD fills a chain by half and takes three
    times as long at 10⁶ DOF. On plates minimum fill comes near to it and is quicker by a quarter; in solids it is twice as slow.
    """
    A, n = sp.csr_array(A), A.shape[0]
    if A.nnz <= 3 * n:
        return "amd"
    filled = np.diff(A.indptr) > 0
    ends = A.indices[A.indptr[:-1][filled]], A.indices[A.indptr[1:][filled] - 1]
    nodes = 1 + int(np.count_nonzero(np.diff(ends[0]) | np.diff(ends[1])))  # the DOF of a node begin and end alike
    return "amf" if n <= FLAT and A.nnz / n * nodes / n < SURFACE else None


def leaves_first(A: Matrix) -> Array | None:
    """An order (n,) in which each DOF comes before all but one of its neighbours, if the graph of A is a forest of few trees."""
    n = A.shape[0]
    edges = (A.nnz - int(np.count_nonzero(A.diagonal()))) // 2
    if not 0 < n - edges <= TREES:
        return None
    pieces, label = sp.csgraph.connected_components(A, directed=False)
    if pieces != n - edges:  # a cycle somewhere
        return None
    roots = np.unique(label, return_index=True)[1]
    return np.concatenate([sp.csgraph.breadth_first_order(A, root, return_predecessors=False) for root in roots])[::-1]


def smooth_shape(A: Matrix) -> Array:
    """cos(πl/L) on one DOF of each node, l its layer of the L + 1 from end to end: about as soft as a wave along A."""
    graph, weight = quotient(sp.csr_array(A))
    inside = np.ones(len(weight), dtype=bool)
    found = layers(graph, inside, np.array([0]))
    found = layers(graph, inside, found[-1])
    shape = np.zeros(A.shape[0])
    first = np.concatenate([[0], np.cumsum(weight)[:-1]]).astype(int)
    for number, nodes in enumerate(found):
        shape[first[nodes]] = np.cos(np.pi * number / max(1, len(found) - 1))
    return shape
