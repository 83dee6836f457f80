"""Displacement fields at the nodes of a mesh from DOF: of full models, or recovered from reduced models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from femsub.checks import Array, InputError, InputTypeError, instance, mapping, rows
from femsub.components.mesh import Mesh, places_of
from femsub.model import DofMap, Substructure, displacements as motions_of, full_dofs

#: the coordinate of the displacement for each label; other labels (slopes) are not displacements
COMPONENTS = {"ux": 0, "uy": 1, "uz": 2, "w": 2}


def displacements(mesh: Mesh, dofs: DofMap, u: Array) -> Array:
    """The displacement of each node of a mesh: shape (nodes, 3) from u (n,), or (nodes, 3, k) from u (n, k).

    Held DOF are 0. A solid has ux, uy, uz. The w of a beam or a plate is the third coordinate; slopes are left out. For a
    reduced model use `rom.expand(q)` with `rom.full_dofs`. `write_mesh` accepts the result as a shape; give the real and the
    imaginary part separately.

    Parameters
    ----------
    mesh : Mesh
        The component's mesh; for a beam a mesh of 'line' cells with nodes counted from 1.
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
    """The rows of `mesh.points` of the nodes with these numbers."""
    place = places_of(numbers, mesh.numbers)
    if (place < 0).any():
        raise InputError(f"the mesh {mesh.name!r} has no node {numbers[np.argmin(place)]}, so the DOF map belongs to another "
                         "mesh. Give the component's own mesh")
    return place


def moved_fields(model: Substructure, q: Array, meshes: Mesh | Mapping[str, Mesh]) -> tuple[list[Mesh], list[Array]]:
    """The meshes of a model's parts, and their fields (nodes, 3, k) of motions q (r, k) in the model's own coordinates.

    Raises
    ------
    InputError
        A mesh for an unknown part, or of another part; a part without a DOF map.
    """
    named = {"": meshes} if isinstance(meshes, Mesh) else mapping("meshes", meshes, "names of parts and their meshes")
    fields = []
    for name, mesh in named.items():
        dofs = full_dofs(model, name)
        if dofs is None:
            raise InputError(f"{name or model.name!r} has no DOF map, so the nodes of its DOF are not known")
        fields.append(displacements(mesh, dofs, motions_of(model, np.arange(dofs.size), name) @ q))
    return list(named.values()), fields


def joined_shapes(model: Substructure, q: Array, meshes: Mesh | Mapping[str, Mesh]) -> tuple[Mesh, Array]:
    """One mesh of all parts, which share no nodes, and the fields of `moved_fields` on it, (nodes, 3, k), with the maximum 1.

    Raises
    ------
    InputError
        See `moved_fields`; meshes of different kinds.
    """
    parts, fields = moved_fields(model, q, meshes)
    kinds = sorted({mesh.kind for mesh in parts})
    if len(kinds) != 1:
        raise InputError(f"meshes must be of one kind of cells, but are of {', '.join(kinds) or 'none'}: draw those of each kind "
                         "apart")
    shapes = np.concatenate(fields)
    largest = np.linalg.norm(shapes, axis=1).max(axis=0)
    return joined_mesh(parts), shapes / np.where(largest > 0, largest, 1.0)


def joined_mesh(meshes: Sequence[Mesh], groups: Mapping[str, Array] | None = None) -> Mesh:
    """One mesh from several meshes of one kind, which share no nodes; `groups` are groups of its cells."""
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    return Mesh(np.vstack([mesh.points for mesh in meshes]),
                np.vstack([mesh.cells + start for mesh, start in zip(meshes, starts, strict=False)]), meshes[0].kind,
                groups=groups or {})


def joined_parts(meshes: Mapping[str, Mesh]) -> tuple[Mesh, Array]:
    """One mesh from the parts' meshes of one kind, with the parts as groups, and the number of each node's part, from 1."""
    ends = np.cumsum([len(mesh.cells) for mesh in meshes.values()])
    groups = {name: np.arange(end - len(mesh.cells), end) for (name, mesh), end in zip(meshes.items(), ends, strict=True)}
    numbers = np.repeat(np.arange(1.0, len(meshes) + 1), [len(mesh.points) for mesh in meshes.values()])
    return joined_mesh(list(meshes.values()), groups), numbers


def turned(fields: Array) -> Array:
    """Complex shapes (nodes, 3, k), each turned in phase so that its largest entry is real and positive."""
    if not np.iscomplexobj(fields):
        return fields
    flat = fields.reshape(-1, fields.shape[-1])
    largest = np.take_along_axis(flat, np.abs(flat).argmax(axis=0)[None], axis=0)[0]
    return np.asarray(fields * np.exp(-1j * np.angle(largest)))
