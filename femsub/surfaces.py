"""The surface of a solid mesh: its faces, and what a patch of it sees on the average."""

from __future__ import annotations

import numpy as np

from femsub.elements import face_quadrature, jacobians, reference, shape_functions
from femsub.meshes import Mesh
from femsub.pencil import Array


def boundary_faces(mesh: Mesh) -> tuple[Array, Array]:
    """The faces that belong to one cell only: their cells (f,) and which of the cell's faces each is (f,)."""
    faces = np.array(reference(mesh.kind).faces)
    corners = np.sort(mesh.cells[:, faces].reshape(-1, faces.shape[1]), axis=1)
    order = np.lexsort(corners.T)
    same = (corners[order[1:]] == corners[order[:-1]]).all(axis=1)
    alone = np.ones(len(order), dtype=bool)
    alone[1:] &= ~same
    alone[:-1] &= ~same
    chosen = np.sort(order[alone])
    return chosen // len(faces), chosen % len(faces)


def corner_nodes(mesh: Mesh, cells: Array, sides: Array) -> Array:
    """The corners of faces as rows of `points`, seen from outside anticlockwise, shape (f, 3 or 4)."""
    return np.take_along_axis(mesh.cells[cells], np.array(reference(mesh.kind).faces)[sides], axis=1)


def patch_average(mesh: Mesh, nodes: Array) -> tuple[Array, Array]:
    """a_i = ∫ N_i dA / A, so that a·u is the average over the patch, and n, its average outward unit normal.

    The patch is made of the faces of the surface all of whose corners are among `nodes`; where there is none, as with
    a few single nodes, the average over the nodes is taken, and n is 0. It is 0 also for a patch closed in itself.

    Returns
    -------
    average : ndarray, shape (n,)
        One weight for each node of the mesh; their sum is 1.
    normal : ndarray, shape (3,)
    """
    cells, sides = boundary_faces(mesh)
    marked = np.zeros(len(mesh.points), dtype=bool)
    marked[nodes] = True
    inside = marked[corner_nodes(mesh, cells, sides)].all(axis=1)
    cells, sides = cells[inside], sides[inside]
    average, normal = np.zeros(len(mesh.points)), np.zeros(3)
    if not len(cells):
        average[nodes] = 1 / len(nodes)
        return average, normal
    X, tangents, w = face_quadrature(mesh.kind, 2 * reference(mesh.kind).degree)
    for side in np.unique(sides):
        members = mesh.cells[cells[sides == side]]
        N, dN = shape_functions(mesh.kind, X[side])
        along = tangents[side] @ jacobians(mesh.points, members, dN)
        area = np.cross(along[:, :, 0], along[:, :, 1]) * w[:, None]
        np.add.at(average, members, np.linalg.norm(area, axis=2) @ N)
        normal += area.sum(axis=(0, 1))
    length, whole = float(np.linalg.norm(normal)), float(average.sum())
    # faces that surround a hole or a body cancel: what is left is rounding and no direction
    return average / whole, normal / length if length > 1e-6 * whole else np.zeros(3)
