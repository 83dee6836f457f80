"""The surface of a solid mesh: its faces and their corners."""

from __future__ import annotations

import numpy as np

from femsub.checks import Array
from femsub.components.mesh import Mesh
from femsub.components.solid_elements import reference


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
