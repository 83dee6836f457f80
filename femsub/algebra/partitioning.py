"""A graph cut into parts of about the same size, with few edges from part to part."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components, reverse_cuthill_mckee

from femsub.algebra.ordering import quotient
from femsub.algebra.petsc import scotch_parts
from femsub.checks import Array, Matrix


def partition(graph: Matrix, count: int) -> Array:
    """The part, 0 to count - 1, of each node of a symmetric graph (n, n), shape (n,), by SCOTCH or by bisection.

    A part is in one piece wherever the graph allows it. No part is empty, for count ≤ n. The same graph gives the same parts.
    """
    edges = sp.coo_array(graph)
    apart = edges.row != edges.col
    graph = sp.csr_array((np.ones(apart.sum()), (edges.row[apart], edges.col[apart])), shape=graph.shape)
    found = scotch_parts(graph, count)
    if found is None or len(np.unique(found)) < count:
        found = bisected(graph, count)
    return in_one_piece(graph, found)


def bisected(graph: Matrix, count: int) -> Array:
    """The part of each node, (n,), by repeated bisection from end to end (Cuthill and McKee); needs no library."""
    part = np.zeros(graph.shape[0], dtype=np.intp)
    waiting = [(np.arange(graph.shape[0]), 0, count)]
    while waiting:
        nodes, first, several = waiting.pop()
        if several == 1:
            part[nodes] = first
            continue
        order = reverse_cuthill_mckee(sp.csr_array(graph[nodes][:, nodes]), symmetric_mode=True)
        half = several // 2
        at = len(nodes) * half // several
        waiting += [(nodes[order[:at]], first, half), (nodes[order[at:]], first + half, several - half)]
    return part


def in_one_piece(graph: Matrix, part: Array) -> Array:
    """The part of each node, (n,), after each part has kept only its largest piece: other pieces join a neighbouring part.

    A piece joins the part with which it has most edges. It may join another piece that is moved as well. So this is repeated as
    long as the number of loose pieces falls.
    """
    edges = sp.coo_array(graph)
    part, fewest = part.copy(), len(part) + 1
    while True:
        inside = part[edges.row] == part[edges.col]
        count, piece = connected_components(sp.csr_array((np.ones(inside.sum()), (edges.row[inside], edges.col[inside])),
                                                         shape=graph.shape), directed=False)
        size, owner = np.bincount(piece), np.zeros(count, dtype=np.intp)
        owner[piece] = part
        largest = np.zeros(part.max() + 1, dtype=np.intp)
        largest[owner[np.argsort(size, kind="stable")]] = np.argsort(size, kind="stable")
        outside = sp.csr_array((np.ones((~inside).sum()), (piece[edges.row[~inside]], part[edges.col[~inside]])),
                               shape=(count, len(largest)))
        loose = np.setdiff1d(np.flatnonzero(outside.sum(axis=1)), largest)
        if not 0 < len(loose) < fewest:
            break
        fewest = len(loose)
        owner[loose] = outside[loose].toarray().argmax(axis=1)
        part = owner[piece]
    return part


def runs(A: Matrix) -> Array:
    """The number of each row's run, (n,), in A (n, n). A run is successive rows of one pattern, as the DOF of a mesh node."""
    _, sizes = quotient(sp.csr_array(A))
    return np.repeat(np.arange(len(sizes)), sizes.astype(int))
