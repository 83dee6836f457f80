"""Checks and repairs of a mesh before it is used: valid cells, no unused nodes; other findings are noted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from femsub.checks import EQUAL, POSITION, Array, InputError
from femsub.components.mesh import Mesh, corners_of, distinct_sides, sides_of
from femsub.components.solid_elements import KINDS, jacobians, quadrature, reference, shape_functions

CHUNK = 1 << 25  # bytes of Jacobians held at a time

_PLANE = {"triangle": np.array([[0, 1, 2]]), "quad": np.array([[0, 1, 3], [1, 2, 0], [2, 3, 1], [3, 0, 2]])}


def checked(mesh: Mesh, cell_numbers: Array | None = None) -> Mesh:
    """The checked mesh: all cells have det ∂x/∂X > 0 at the quadrature points and ≥ 0 at the corners.

    Repaired, and noted in `repairs`: cells whose nodes are listed in mirrored order, cells given twice, nodes without a cell.
    Only noted: nodes that coincide (parts that were not merged), a mesh of several pieces. Surfaces in space (3D points
    not in a plane z = const) are checked for flat and concave cells only.

    Parameters
    ----------
    mesh : Mesh
    cell_numbers : ndarray, shape (m,), optional
        Numbers of the cells in messages; default: rows of `cells`.

    Raises
    ------
    InputError
        A node twice in a cell; tangled or flat cells; cells folded into their neighbours. The message has their number, and the
        numbers and places of the first cells.
    """
    labels = np.arange(len(mesh.cells)) if cell_numbers is None else np.asarray(cell_numbers)
    ordered = np.sort(mesh.cells, axis=1)
    _refuse(mesh, (ordered[:, 1:] == ordered[:, :-1]).any(axis=1), labels, "name a node twice (collapsed cells)",
            "Mesh that part with other cells")
    # each cell once
    first = _first_alike(mesh)
    kept = np.flatnonzero(first == np.arange(len(first)))
    if len(kept) < len(first):
        row = np.searchsorted(kept, first)
        note = f"{plural(len(first) - len(kept), 'cell was', 'cells were')} given twice, kept once"
        mesh = replace(mesh, cells=mesh.cells[kept], groups={name: row[members] for name, members in mesh.groups.items()},
                       repairs=(*mesh.repairs, note))
        labels = labels[kept]
    # nodes that belong to a cell
    used = _in_cells(mesh)
    if not used.all():
        row = np.cumsum(used) - 1
        sets = {name: row[nodes[used[nodes]]] for name, nodes in mesh.sets.items()}
        lost = mesh.numbers[~used]
        notes = [f"{plural(len(lost), 'node belongs', 'nodes belong')} to no cell, dropped: {listed(lost)}"]
        notes += [f"the set {name!r} lost {plural(len(nodes) - len(sets[name]), 'node', 'nodes')} by that"
                  for name, nodes in mesh.sets.items() if len(nodes) > len(sets[name])]
        mesh = replace(mesh, points=mesh.points[used], cells=row[mesh.cells], sets=sets, numbers=mesh.numbers[used],
                       repairs=(*mesh.repairs, *notes))
    # cells that are not inside out
    low, high, corner_low, corner_high = (np.concatenate(part) for part in zip(*_volumes(mesh), strict=True))
    mirrored = (high < -POSITION) & (corner_high <= POSITION)
    sound = (low > POSITION) & (corner_low >= -POSITION)
    if mesh.kind == "line":
        wrong, cure = "have no length", "Leave them out, e.g. springs between nodes at the same place, or move their nodes"
    else:
        wrong = "are tangled or flat (the Jacobian determinant changes its sign or vanishes)"
        cure = "move their nodes, or mesh that part anew"
    _refuse(mesh, ~mirrored & ~sound, labels, wrong, cure)
    if mirrored.any():
        if mesh.kind in _PLANE:
            order = np.array([0, 2, 1] if mesh.kind == "triangle" else [0, 3, 2, 1])
        else:  # the nodes of the reference element with two axes exchanged
            nodes = reference(mesh.kind).nodes
            order = np.abs(nodes[:, None, [1, 0, 2]] - nodes[None, :, :]).max(axis=2).argmin(axis=1)
        cells = mesh.cells.copy()
        cells[mirrored] = cells[np.ix_(mirrored, order)]
        note = f"{mirrored.sum()} of {len(cells)} {mesh.kind} cells were listed in mirrored order, re-ordered"
        mesh = replace(mesh, cells=cells, repairs=(*mesh.repairs, note))
        _refuse(mesh, _folded(mesh) & mirrored, labels, "are turned inside out and lie within their neighbours", cure)
    # only noted: nodes that coincide, separate pieces
    from scipy.spatial import cKDTree

    repairs = list(mesh.repairs)
    smallest = min(np.linalg.norm(mesh.points[one] - mesh.points[other], axis=1).min()
                   for one, other in combinations(corners_of(mesh).T, 2))
    near = min(POSITION * float(np.ptp(mesh.points, axis=0).max()), smallest / 2)
    pairs = len(cKDTree(mesh.points).query_pairs(near, output_type="ndarray"))
    if pairs:
        repairs.append(f"{plural(pairs, 'pair', 'pairs')} of nodes coincide (not merged: their parts are not joined there)")
    count, k = len(mesh.points), mesh.cells.shape[1]
    graph = sp.coo_array((np.ones(len(mesh.cells) * (k - 1), dtype=bool),
                          (np.repeat(mesh.cells[:, 0], k - 1), mesh.cells[:, 1:].ravel())), shape=(count, count))
    pieces = connected_components(graph, directed=False, return_labels=False)
    if pieces > 1:
        repairs.append(f"the mesh is in {pieces} separate pieces")
    return replace(mesh, repairs=tuple(dict.fromkeys(repairs)))


def refuse_spoilt(mesh: Mesh) -> None:
    """Raise an error for cells given twice and nodes without a cell, which would give wrong matrices. (`checked` repairs them.)

    Raises
    ------
    InputError
        There are such cells or nodes. The message lists their numbers.
    """
    first = _first_alike(mesh)
    again = np.flatnonzero(first != np.arange(len(first)))
    if len(again):
        of = f"of {mesh.name!r}"
        raise InputError(f"{plural(len(again), f'cell {of} is', f'cells {of} are')} given twice. The first is cell {again[0]}, "
                         f"which is cell {first[again[0]]} again (counted from 0). Its mass would count twice; leave it out")
    unused = ~_in_cells(mesh)
    if unused.any():
        of = f"of {mesh.name!r}"
        which = plural(np.count_nonzero(unused), f"node {of} belongs", f"nodes {of} belong")
        raise InputError(f"{which} to no cell: number {listed(mesh.numbers[unused])}. Such a node has no mass and no stiffness; "
                         "leave it out")


def _first_alike(mesh: Mesh) -> Array:
    """For each cell the first cell with the same nodes, which is the cell itself unless it is given twice."""
    _, first, number = np.unique(np.sort(mesh.cells, axis=1), axis=0, return_index=True, return_inverse=True)
    return first[number.ravel()]


def _in_cells(mesh: Mesh) -> Array:
    """Which nodes belong to a cell, bool (n,)."""
    return np.bincount(mesh.cells.ravel(), minlength=len(mesh.points)) > 0


def _refuse(mesh: Mesh, bad: Array, labels: Array, what: str, advice: str) -> None:
    rows = np.flatnonzero(bad)
    if len(rows):
        places = mesh.points[mesh.cells[rows[:3]]].mean(axis=1)
        where = "; ".join(f"cell {labels[row]} around ({', '.join(f'{x:.4g}' for x in place)})"
                          for row, place in zip(rows, places, strict=False))
        raise InputError(f"{len(rows)} of {len(bad)} {mesh.kind} cells of the mesh {mesh.name!r} {what}: {where}"
                         f"{'; ...' if len(rows) > 3 else ''}. {advice}")


def listed(numbers: Array) -> str:
    return ", ".join(str(number) for number in numbers[:5]) + (", ..." if len(numbers) > 5 else "")


def plural(count: int, one: str, many: str) -> str:
    """'1 node belongs', '3 nodes belong'."""
    return f"{count} {one if count == 1 else many}"


def _volumes(mesh: Mesh) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Smallest and largest det ∂x/∂X, divided by the product of the edge lengths, at quadrature points and at corners.

    For plane cells the sign refers to the z axis if all lie in one plane z = const, otherwise to the cell's own normal.
    """
    if mesh.kind == "line":
        length = np.linalg.norm(mesh.points[mesh.cells[:, 1]] - mesh.points[mesh.cells[:, 0]], axis=1)
        share = length / max(length.max(), np.finfo(float).tiny)
        yield share, share, share, share
        return
    if mesh.kind in _PLANE:
        points = np.zeros((len(mesh.points), 3))
        points[:, :mesh.points.shape[1]] = mesh.points
        triangles = points[mesh.cells[:, _PLANE[mesh.kind]]]
        one, other = triangles[:, :, 1] - triangles[:, :, 0], triangles[:, :, 2] - triangles[:, :, 0]
        cross = np.cross(one, other)
        normal = cross.sum(axis=1)
        size = np.linalg.norm(points.max(axis=0) - points.min(axis=0))
        if np.ptp(points[:, 2]) <= EQUAL * size:
            normal = np.array([[0.0, 0.0, 1.0]])
        normal = normal / np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)[:, None]
        edges = np.linalg.norm(one, axis=2) * np.linalg.norm(other, axis=2)
        share = (cross * normal[:, None, :]).sum(axis=2) / np.maximum(edges, np.finfo(float).tiny)
        whole = (cross.sum(axis=1) * normal).sum(axis=1) / np.maximum(edges.sum(axis=1), np.finfo(float).tiny)
        yield whole, whole, share.min(axis=1), share.max(axis=1)
        return
    element = reference(mesh.kind)
    inside, _ = quadrature(mesh.kind, 2 * element.degree)
    _, dN = shape_functions(mesh.kind, np.vstack([inside, element.nodes[:element.corners]]))
    step = max(1, CHUNK // (dN.shape[0] * 9 * 8))
    for start in range(0, len(mesh.cells), step):
        J = jacobians(mesh.points, mesh.cells[start:start + step], dN)
        share = np.linalg.det(J) / np.maximum(np.linalg.norm(J, axis=3).prod(axis=2), np.finfo(float).tiny)
        at, corners = share[:, :len(inside)], share[:, len(inside):]
        yield at.min(axis=1), at.max(axis=1), corners.min(axis=1), corners.max(axis=1)


def _folded(mesh: Mesh) -> Array:
    """Which cells are on the same side of a face as a neighbour: both list the face's corners in the same sense."""
    sides = np.array(reference(mesh.kind).faces) if mesh.kind in KINDS else sides_of(mesh.kind, "edges")
    corners, size = mesh.cells[:, sides], sides.shape[1]
    start = corners.argmin(axis=2, keepdims=True)
    after, before = (np.take_along_axis(corners, (start + step) % size, axis=2) for step in (1, -1))
    sense = after < before if size > 2 else start == 0
    key = 2 * distinct_sides(mesh, sides)[1] + sense[:, :, 0]
    return (np.bincount(key.ravel())[key] > 1).any(axis=1)
