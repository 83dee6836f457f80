"""From DOF back to the nodes of a mesh: displacement fields of shapes, full or recovered from a reduced model."""

from __future__ import annotations

import numpy as np

from femsub.checks import Array, instance, rows
from femsub.components.mesh import Mesh, places_of
from femsub.errors import InputError, InputTypeError
from femsub.model import DofMap

#: the coordinate of the displacement for each label; other labels (slopes) are not displacements
COMPONENTS = {"ux": 0, "uy": 1, "uz": 2, "w": 2}


def displacements(mesh: Mesh, dofs: DofMap, u: Array) -> Array:
    """The displacement of each node of a mesh: shape (nodes, 3) from u (n,), or (nodes, 3, k) from u (n, k).

    Held DOF are 0. A solid has ux, uy, uz. The w of a beam or a plate is the third coordinate; slopes are left out. For a
    reduced model use `rom.expand(q)` with `rom.full_dofs`. `write_mesh` takes the result as a shape; give the real and the
    imaginary part separately.

    Parameters
    ----------
    mesh : Mesh
        The component's mesh; for a beam a mesh of 'line' cells whose nodes count from 1.
    dofs : DofMap
        The component's DOF map.
    u : array_like, shape (n,) or (n, k), real or complex
        Displacements of the DOF.

    Raises
    ------
    InputError
        Rows that do not fit the map, or a node of the map that is not in the mesh.

    Examples
    --------
    >>> import femsub as fs, numpy as np
    >>> mesh = fs.rectangle((1.0, 1.0), (2, 2))
    >>> sub = fs.plate(mesh, E=2.1e11, nu=0.3, rho=7850.0, thickness=0.01, supports={"left": "clamped"})
    >>> fs.displacements(mesh, sub.dofs, np.zeros(sub.size)).shape
    (9, 3)
    """
    instance("mesh", mesh, Mesh)
    instance("dofs", dofs, DofMap)
    values = rows("u", u)
    if values.dtype.kind not in "iufc":
        raise InputTypeError(f"u must hold numbers, not {values.dtype}")
    if values.ndim not in (1, 2) or len(values) != dofs.size:
        raise InputError(f"u must have {dofs.size} rows, one per DOF, but its shape is {values.shape}")
    axis = np.array([COMPONENTS.get(label, -1) for label in dofs.labels])[dofs.components]
    moved = np.flatnonzero(axis >= 0)
    field = np.zeros((len(mesh.points), 3, *values.shape[1:]), dtype=np.result_type(values, float))
    field[node_rows(mesh, dofs.nodes[moved]), axis[moved]] = values[moved]
    return field


def node_rows(mesh: Mesh, numbers: Array) -> Array:
    """The rows of `points` of nodes by their numbers."""
    place = places_of(numbers, mesh.numbers)
    if (place < 0).any():
        raise InputError(f"the mesh {mesh.name!r} has no node {numbers[np.argmin(place)]}, so the DOF map belongs to another "
                         "mesh. Give the component's own mesh")
    return place
