"""Solid components: linear elasticity on hexahedra and tetrahedra, linear and quadratic."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from femsub.checks import Array, InputError, InputTypeError, choice, instance, items, naming, real_array, shown, word
from femsub.components.build import component, optional_mapping
from femsub.components.facing import Facing
from femsub.components.mesh import Mesh
from femsub.components.mesh_checks import refuse_spoilt
from femsub.components.patches import solid_average
from femsub.components.solid_assembly import Material, stiffness_and_mass
from femsub.components.solid_elements import KINDS
from femsub.model import TRANSLATIONS, DofMap, Substructure

Direction: TypeAlias = str | Sequence[float]
#: the words for a direction: an axis, the normal of a set's surface, or the opposite of one of them
DIRECTIONS = tuple(sign + axis for axis in (*"xyz", "normal") for sign in ("", "-"))


def solid(mesh: Mesh, material: Material | Mapping[str, Material], *, supports: Mapping[str, str] | Sequence[str] | None = (),
          interface: Mapping[str, str] | Mapping[str | Facing, str] | Sequence[str | Facing] | Facing | None = (),
          ports: Mapping[str, tuple[str, Direction]] | None = None, rayleigh: tuple[float, float] | None = None,
          name: str = "") -> Substructure:
    """A solid component of linear elasticity, meshed with hexahedra or tetrahedra.

    M ü + D u̇ + K u = f with K from ∫ ε:c:ε dV, M from ∫ ρ u·u dV, D = αM + βK, and three DOF (x, y, z) per node. Loss
    factors of materials give the structural damping H. K and M are exact for affine cells; see `stiffness_and_mass`. The DOF
    of supports are removed.

    Bricks of 8 nodes lock in bending. For a part of thickness t with elements of length a, ω is about sqrt(1 + a²/2t²)
    times too high (88 times for a/t = 125), for any number of layers. Bricks of 20 and 27 nodes do not lock.

    Parameters
    ----------
    mesh : Mesh
        A mesh of 'hexahedron', 'hexahedron20', 'hexahedron27', 'tetra' or 'tetra10' cells, as from `read_mesh` or `block`.
    material : Material, or mapping of str to Material
        One material for all cells, or one for each group of cells; the groups must cover all cells.
    supports, interface : sequence of str, or mapping of str to str
        Sets of nodes that are held, and sets through which the component is joined: all three motions, or the motions
        named, e.g. {"left": "xyz", "symmetry": "x"}. Interface DOF are listed node by node, without held DOF. The sets
        keep their names as interface sets. A `Facing` stands for its surface in this mesh.
    ports : mapping of str to (set, direction)
        The columns w on which belts or forces act: wᵀu is the average motion of a set in a direction. The direction is 'x',
        'y', 'z', 'normal', the opposite of one ('-x', '-normal', ...), or a vector, which is normalised. For a set of nodes
        the average is taken over the faces of the surface within it; if these do not contain all nodes, over the cells
        within it; otherwise over its edges; otherwise over its nodes. For a group of cells it is taken over the volume. A
        mixed set is refused.
    rayleigh : (alpha, beta), optional
        α in 1 per unit of time, β in units of time; use `damped` for any other damping.
    name : str
        Default: the name of the mesh.

    Raises
    ------
    InputError
        A set or group that is not in the mesh, plane cells, inverted cells, cells given twice, nodes without a cell, an unknown
        direction, an interface or a port that is held.
    InputTypeError
        An argument of another kind.

    References
    ----------
    K.-J. Bathe, Finite Element Procedures (1996), ch. 5.

    Examples
    --------
    >>> import femsub as fs
    >>> mesh = fs.block((1.0, 0.1, 0.1), (4, 1, 1), "hexahedron")
    >>> fs.solid(mesh, fs.Material(E=2.1e11, nu=0.3, rho=7850.0), supports=["left"], ports={"belt": ("right", "y")})
    Substructure 'block': 48 DOF, sparse, 1440 nonzeros in K, 0 interface DOF, ports belt
    """
    instance("mesh", mesh, Mesh, "see read_mesh, block")
    if mesh.kind not in KINDS:
        raise InputError(f"the mesh {mesh.name!r} has {mesh.kind} cells, which are {mesh.dimension}D, but a solid needs one of "
                         f"{', '.join(KINDS)}")
    refuse_spoilt(mesh)
    mesh, named = _with_facings(mesh, interface)
    held = np.concatenate([np.zeros(0, dtype=int), *_motions(mesh, "supports", supports).values()])
    joined = _motions(mesh, "interface", named)
    ports = optional_mapping("ports", ports, "names and (set, direction)")
    columns = {}
    for key, value in ports.items():
        try:
            place, direction = value
        except (TypeError, ValueError):
            raise InputTypeError(f"port {key!r} must be (set of nodes, direction), e.g. ('contact', 'x'), not {value!r}"
                                 ) from None
        average, normal = solid_average(mesh, place, f"port {key!r}")
        if isinstance(direction, str):
            choice(f"direction of port {key!r}:", direction, DIRECTIONS)
            axis = direction.removeprefix("-")
            vector = normal if axis == "normal" else np.eye(3)["xyz".index(axis)]
            vector = -vector if direction.startswith("-") else vector
        else:
            vector = real_array(f"the direction of port {key!r}", direction, finite=False)
        length = float(np.linalg.norm(vector)) if vector.shape == (3,) else 0.0
        if not 0 < length < np.inf:
            why = "three numbers, not all 0, are needed"
            if isinstance(direction, str):
                why = f"only faces of the surface have a normal, and {place!r} holds none, or is closed in itself"
            raise InputError(f"port {key!r}: {direction!r} is not a direction: {why}")
        columns[key] = np.outer(average, vector / length).ravel()
    materials = materials_of(mesh, material)
    K, M = stiffness_and_mass(mesh, materials)
    lossy = [(replace(one, E=one.loss * one.E), cells) for one, cells in materials if one.loss]
    H = stiffness_and_mass(mesh, lossy)[0] if lossy else None
    every = np.arange(3 * len(mesh.points))
    dofs = DofMap(mesh.numbers[every // 3], every % 3, TRANSLATIONS, mesh.points[every // 3])
    return component(K, M, held, joined, columns, dofs, rayleigh, word("name", name) or mesh.name, by_node=True, H=H)


def materials_of(mesh: Mesh, material: Material | Mapping[str, Material]) -> list[tuple[Material, Array]]:
    """Each material with its cells."""
    if isinstance(material, Material):
        return [(material, np.arange(len(mesh.cells)))]
    if not isinstance(material, Mapping):
        raise InputTypeError(f"material must be a Material or map groups of cells to one, not {material!r:.60}")
    for group, one in material.items():
        if not isinstance(one, Material):
            raise InputTypeError(f"material of the group {group!r} must be a Material(E, nu, rho), not {one!r:.60}")
    return [(material[group], cells) for group, cells in mesh.cells_in(material, "material").items()]


def _with_facings(mesh: Mesh, interface: Any) -> tuple[Mesh, Any]:
    """The mesh with the sets of each `Facing` in an interface, and the interface with the sets' names instead of the `Facing`."""
    if isinstance(interface, Facing):
        interface = [interface]
    if not isinstance(interface, (list, tuple, set, Mapping)) or not any(isinstance(one, Facing) for one in interface):
        return mesh, interface
    named: dict[Any, Any] = {}
    with naming("interface"):
        for one in interface:
            axes = interface[one] if isinstance(interface, Mapping) else "xyz"
            found = one.sets_in(mesh) if isinstance(one, Facing) else {}
            if taken := [name for name, rows in found.items() if not np.array_equal(mesh.sets.get(name, rows), rows)]:
                raise InputError(f"{one!r}: the mesh {mesh.name!r} has another set {taken[0]!r}: give facing a name of its own")
            mesh = mesh.with_sets(**found)
            named |= dict.fromkeys(found or [one if isinstance(one, str) else shown(one)], axes)
    return mesh, named


def _motions(mesh: Mesh, what: str, named: Mapping[str, str] | Iterable[str] | None) -> dict[str, Array]:
    """The DOF of each named set, node by node."""
    if isinstance(named, str):
        named = [named]
    if not isinstance(named, Mapping):
        listed = [] if named is None else items(what, named, "names of sets, or a dict such as {'left': 'xyz'}")
        named = {name if isinstance(name, str) else shown(name): "xyz" for name in listed}
    found = {}
    for name, axes in named.items():
        if not isinstance(axes, str):
            raise InputTypeError(f"{what}: the motions of the set {name!r} must be letters, such as 'xyz', not {axes!r:.60}")
        if axes == "clamped":
            axes = "xyz"
        if not axes or set(axes) - set("xyz"):
            raise InputError(f"{what}: {axes!r} for the set {name!r} must be 'clamped' or some of the letters x, y, z")
        with naming(what):
            nodes = mesh.nodes(name)
        found[name] = (3 * nodes[:, None] + [at for at, axis in enumerate("xyz") if axis in axes]).ravel()
    return found
