"""From DOF back to the nodes of a mesh: displacement fields of shapes, full or recovered from a reduced model."""

from __future__ import annotations

import numpy as np

from femsub.checks import Array, instance, real_array
from femsub.components.mesh import Mesh
from femsub.errors import InputError, InputTypeError
from femsub.model.dof_map import DofMap

#: which coordinate of the displacement a motion is; all others (slopes) are not displacements
COMPONENTS = {"ux": 0, "uy": 1, "uz": 2, "w": 2}


def displacements(mesh: Mesh, dofs: DofMap, u: Array) -> Array:
    """The displacement of each node, shape (nodes, 3), from u (n,), or (nodes, 3, k) from u (n, k); 0 where it is held.

    ux, uy, uz of a solid; w of a beam or a plate is the third coordinate. Slopes are left out. Of a reduced model take
    `rom.expand(q)` with `rom.full_dofs`. The result is what `write_mesh` takes as a shape, real and imaginary part apart.

    Parameters
    ----------
    mesh : Mesh
        That of the component; of a beam a mesh of 'line' cells whose nodes count from 1.
    dofs : DofMap
        The component's.
    u : array_like, shape (n,) or (n, k), real or complex

    Raises
    ------
    InputError
        Rows that do not fit the map, or a node of the map that the mesh has not.
    """
    instance("mesh", mesh, Mesh)
    instance("dofs", dofs, DofMap)
    values = u if isinstance(u, np.ndarray) else real_array("u", u)
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
    order = np.argsort(mesh.numbers, kind="stable")
    ordered = mesh.numbers[order]
    place = np.minimum(np.searchsorted(ordered, numbers), len(ordered) - 1)
    strange = ordered[place] != numbers
    if strange.any():
        raise InputError(f"the mesh {mesh.name!r} has no node {numbers[np.argmax(strange)]}: it is not the one that the DOF map "
                         "belongs to")
    return order[place]
