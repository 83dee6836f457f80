"""The cells, faces, edges or nodes that a port on a named set acts on, and the mean over them in a solid."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from femsub.checks import POSITION, Array, InputError, PortWarning, unknown_name, warn
from femsub.components.mesh import Mesh, boundary_faces, corner_nodes, corners_of, edges_of, edges_within, sides_of
from femsub.components.mesh_checks import listed
from femsub.components.solid_elements import jacobians, on_side, quadrature, reference, shape_functions, side_quadrature


@dataclass(frozen=True, eq=False)
class Patch:
    """The parts of a mesh that make up a set; each node of the set belongs to one of them.

    Attributes
    ----------
    kind : str
        'cells', 'faces' (of the surface of a solid), 'edges' or 'nodes'.
    nodes : ndarray, shape (k,)
        The nodes of the set, as rows of `points`.
    cells, sides : ndarray, shape (f,)
        The cells; or the cells of the faces or edges with the index of the face or edge (`sides_of`). Empty for nodes.
    share : ndarray, shape (f,)
        1 for cells and faces. An edge is listed for every cell that has it, with the share 1 over the number of these cells.
    """

    kind: str
    nodes: Array
    cells: Array
    sides: Array
    share: Array


def patch(mesh: Mesh, name: str, what: str) -> Patch:
    """The cells, faces, edges or nodes that a group of cells or a set of nodes stands for.

    A group stands for its cells. A set of nodes stands for the first of the following that contains all its nodes: the faces of
    a solid's surface within the set, the cells within it, its edges (between two nodes of the border only edges of the border).
    Without any edge within it, the set stands for its nodes. If a group has the same name and the same nodes, the set stands for
    the group. Corners decide: midside nodes that are not part of a whole face (cell, edge) are ignored.

    Parameters
    ----------
    mesh : Mesh
        A mesh of plane or solid cells.
    what : str
        The owner of the set, for messages, e.g. "port 'belt'".

    Warns
    -----
    PortWarning
        Midside nodes are ignored.

    Raises
    ------
    InputError
        An unknown set; or a mixed set, so that a mean would leave out some of its nodes.
    """
    every = np.arange(len(mesh.cells))
    group = mesh.groups.get(name, every[:0])
    if len(group) and (name not in mesh.sets or np.array_equal(mesh.sets[name], np.unique(mesh.cells[group]))):
        return _patch("cells", np.unique(mesh.cells[group]), group)
    if name not in mesh.sets:
        raise unknown_name(f"set of nodes or group of cells of the mesh {mesh.name!r}:", name, (*mesh.sets, *mesh.groups))
    nodes, tried = mesh.nodes(name), []
    for one in _candidates(mesh, nodes):
        left = np.setdiff1d(nodes, nodes_of(mesh, one))
        if not len(left):
            return one
        tried.append((one, left))
    if not tried:
        return _patch("nodes", nodes, every[:0])
    corners = np.unique(corners_of(mesh))
    for one, left in tried:
        if not np.isin(left, corners).any():
            warn(f"{what}: {len(left)} of the {len(nodes)} nodes of the set {name!r} (number "
                 f"{listed(mesh.numbers[left])}) are midside nodes of {one.kind} whose corners are not all in the set. "
                 f"The mean is taken over the complete {one.kind} only", PortWarning)
            return one
    kind, left = tried[0][0].kind, tried[0][1]
    raise InputError(f"{what}: {len(left)} of the {len(nodes)} nodes of the set {name!r} belong to none of the {kind} within it "
                     f"(number {listed(mesh.numbers[left])}), so a mean over {kind} would leave them out. Take them out of the "
                     f"set, add the nodes that complete their {kind}, or name a group of cells")


def _candidates(mesh: Mesh, nodes: Array) -> Iterator[Patch]:
    """Yields the faces, the cells and the edges within a set, if there are any, in `patch`'s order of preference."""
    every, some = np.arange(len(mesh.cells)), False
    ways = [("cells", every, np.zeros_like(every), corners_of(mesh))]
    if mesh.dimension == 3:
        cells, sides = boundary_faces(mesh)
        ways.insert(0, ("faces", cells, sides, corner_nodes(mesh, cells, sides)))
    for kind, cells, sides, corners in ways:
        inside = np.isin(corners, nodes).all(axis=1)
        if inside.any():
            some = True
            yield _patch(kind, nodes, cells[inside], sides[inside])
    ends, number, border = edges_of(mesh)
    chosen = edges_within(ends, border, nodes)
    # a row of nodes along the border of a plane mesh may contain a whole cell in a corner
    if chosen.any() and (not some or (mesh.dimension == 2 and bool(border[chosen].all()))):
        cells, sides = np.nonzero(chosen[number])
        yield Patch("edges", nodes, cells, sides, 1 / np.bincount(number.ravel())[number[cells, sides]])


def nodes_of(mesh: Mesh, found: Patch) -> Array:
    """All nodes of the cells, faces or edges of a patch."""
    if found.kind in ("cells", "nodes"):
        return np.unique(mesh.cells[found.cells]) if found.kind == "cells" else found.nodes
    return np.unique(mesh.cells[found.cells[:, None], sides_of(mesh.kind, found.kind)[found.sides]])


def solid_average(mesh: Mesh, name: str, what: str) -> tuple[Array, Array]:
    """a_i = ∫ N_i / ∫ 1 over the patch, so that a·u is the mean over its volume, area or length, and its mean normal n.

    For single nodes a·u is the mean over the nodes. n is the average outward unit normal of faces; it is 0 for every other kind,
    and for a closed surface.

    Returns
    -------
    average : ndarray, shape (n,)
        One weight for each node of the mesh; their sum is 1.
    normal : ndarray, shape (3,)
    """
    found = patch(mesh, name, what)
    average, normal, element = np.zeros(len(mesh.points)), np.zeros(3), reference(mesh.kind)
    if found.kind == "nodes":
        average[found.nodes] = 1.0
    for side in np.unique(found.sides):
        if found.kind == "cells":
            degree = 4 * element.degree - (3 if mesh.kind.startswith("tetra") else 1)  # the degree of N det J
            (X, w), tangents = quadrature(mesh.kind, degree), np.eye(3)
        else:
            corners = (element.faces if found.kind == "faces" else element.edges)[side]
            # exact on flat parallelograms and straight edges; four Gauss points for curved edges, whose length is no polynomial
            s, w = side_quadrature(len(corners), 2 * element.degree if found.kind == "faces" else 7)
            X, tangents = on_side(mesh.kind, corners, s)
        N, dN = shape_functions(mesh.kind, X)
        chosen = found.sides == side
        members = mesh.cells[found.cells[chosen]]
        along = tangents @ jacobians(mesh.points, members, dN)
        vector = along[:, :, 0] if found.kind == "edges" else np.cross(along[:, :, 0], along[:, :, 1])
        size = (vector * along[:, :, 2]).sum(axis=2) if found.kind == "cells" else np.linalg.norm(vector, axis=2)
        np.add.at(average, members, (size * w * found.share[chosen, None]) @ N)
        if found.kind == "faces":
            normal += (vector * w[:, None]).sum(axis=(0, 1))
    length, whole = float(np.linalg.norm(normal)), float(average.sum())
    # normals of a closed surface cancel: what remains is rounding of the coordinates, not a direction
    return average / whole, normal / length if length > POSITION * whole else np.zeros(3)


def _patch(kind: str, nodes: Array, cells: Array, sides: Array | None = None) -> Patch:
    return Patch(kind, nodes, cells, np.zeros_like(cells) if sides is None else sides, np.ones(len(cells)))
