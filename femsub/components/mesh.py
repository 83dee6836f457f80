"""`Mesh`: points, cells of one kind, named sets of nodes and of cells; its faces and edges."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from femsub.algebra import Frozen
from femsub.checks import Array, InputError, choice, instance, items, mapping, real_array, rows, word
from femsub.components.solid_elements import KINDS, reference

#: kind: (dimension of the cell, nodes)
CELLS = {"line": (1, 2), "triangle": (2, 3), "quad": (2, 4), "tetra": (3, 4), "tetra10": (3, 10), "hexahedron": (3, 8),
         "hexahedron20": (3, 20), "hexahedron27": (3, 27)}


@dataclass(frozen=True, eq=False, repr=False)
class Mesh(Frozen):
    """A mesh: points (n, d), cells (m, k) of one kind, and named sets of nodes and of cells.

    Parameters
    ----------
    points : array_like, shape (n, d)
        Coordinates, d = 1 to 3, in the unit of length of E and rho.
    cells : array_like of int, shape (m, k)
        Nodes of each cell as rows of `points`, in meshio's (VTK's) order.
    kind : str
        'line', 'triangle', 'quad', 'tetra', 'tetra10', 'hexahedron', 'hexahedron20', 'hexahedron27'.
    sets : mapping of str to array_like of int
        Named sets of nodes, as rows of `points`.
    groups : mapping of str to array_like of int
        Named sets of cells, as rows of `cells`.
    numbers : array_like of int, shape (n,), optional
        Unique node numbers of the source (e.g. a mesh file); default 1 to n.
    repairs : sequence of str
        The repairs made when the mesh was read.
    name : str

    Raises
    ------
    InputError, InputTypeError
        Shapes that do not fit, a node or cell that does not exist, coordinates that are not finite or not real, node numbers
        that are not whole or not unique, names that are not strings.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.Mesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], "triangle", sets={"bottom": [0, 1]})
    Mesh 'mesh': 3 nodes, 1 triangle, sets bottom
    """

    points: Array
    cells: Array
    kind: str
    sets: Mapping[str, Array]
    groups: Mapping[str, Array]
    numbers: Array
    repairs: tuple[str, ...]
    name: str

    def __init__(self, points: Any, cells: Any, kind: str, sets: Mapping[str, Any] | None = None,
                 groups: Mapping[str, Any] | None = None, numbers: Any = None, repairs: Iterable[str] = (),
                 name: str = "mesh") -> None:
        choice("kind of cell", kind, CELLS)
        word("name", name)
        places, corners = np.array(real_array("points", points, finite=False)), rows("cells", cells)
        if places.ndim != 2 or not 1 <= places.shape[1] <= 3 or not len(places):
            raise InputError(f"points must have the shape (n, 1), (n, 2) or (n, 3), not {places.shape}")
        if places.shape[1] < CELLS[kind][0]:
            raise InputError(f"{kind} cells are {CELLS[kind][0]}D, but the points of {name!r} have {places.shape[1]} coordinates")
        if not np.isfinite(places).all():
            raise InputError(f"node {int(np.argmin(np.isfinite(places).all(axis=1)))} has a coordinate that is not finite")
        if corners.ndim != 2 or corners.shape[1] != CELLS[kind][1] or not len(corners):
            raise InputError(f"cells must have the shape (m, {CELLS[kind][1]}) for {kind}, not {corners.shape}")
        count = len(places)
        corners = _within("cells", corners, count).reshape(corners.shape)
        named = rows("numbers", np.arange(1, count + 1) if numbers is None else numbers)
        named = named if named.dtype.kind in "iu" else real_array("numbers", named, finite=False)
        if named.shape != (count,):
            raise InputError(f"numbers must have {count} entries, one per node, but their shape is {named.shape}")
        wrong = (named % 1 != 0) | (np.abs(named) >= 2.0**53)
        if wrong.any():
            raise InputError(f"numbers must be whole numbers, but node {int(wrong.argmax())}, counted from 0, has "
                             f"{named[wrong][0]}")
        different, times = np.unique(named, return_counts=True)
        if len(different) < count:
            raise InputError(f"numbers must be unique, but {int(different[times.argmax()])} comes twice")
        node_sets = {key: np.unique(_within(f"set {key!r}", chosen, count)) for key, chosen in _named("sets", sets)}
        cell_sets = {key: np.unique(_within(f"group {key!r}", chosen, len(corners))) for key, chosen in _named("groups", groups)}
        notes = tuple(instance("each of repairs", one, str) for one in items("repairs", repairs, "strings"))
        self._set(points=places, cells=corners, kind=kind, numbers=named.astype(np.int64), repairs=notes,
                  name=name, sets=node_sets, groups=cell_sets)

    def __repr__(self) -> str:
        sets = f"sets {', '.join(self.sets)}" if self.sets else "no sets"
        groups = f", groups {', '.join(self.groups)}" if self.groups else ""
        mended = f"; {'; '.join(self.repairs)}" if self.repairs else ""
        return f"Mesh {self.name!r}: {len(self.points)} nodes, {len(self.cells)} {self.kind}, {sets}{groups}{mended}"

    @property
    def dimension(self) -> int:
        """The dimension of the cells: 1, 2 or 3."""
        return CELLS[self.kind][0]

    def nodes(self, name: str) -> Array:
        """The nodes of a set, ascending; an unknown or empty set is an InputError."""
        if not len(self.sets[choice(f"set of nodes of the mesh {self.name!r}:", name, self.sets)]):
            raise InputError(f"the set {name!r} of the mesh {self.name!r} is empty. Name a set with nodes")
        return self.sets[name]

    def cells_in(self, groups: Iterable[str], what: str) -> dict[str, Array]:
        """The cells of some groups, which together must contain each cell of the mesh exactly once."""
        found = {name: self.groups[choice(f"group of cells of the mesh {self.name!r}:", name, self.groups)] for name in groups}
        times = np.bincount(np.concatenate([np.zeros(0, dtype=int), *found.values()]), minlength=len(self.cells))
        if (times != 1).any():
            raise InputError(f"{what}: {np.count_nonzero(times == 0)} cells of {self.name!r} are in none of the groups, and "
                             f"{np.count_nonzero(times > 1)} in several. Each cell needs exactly one")
        return found

    def with_sets(self, **sets: Any) -> Mesh:
        """A copy with additional (or replaced) sets of nodes.

        Each set is given as rows of `points`, as n booleans, or as a function of the points (n, d) that returns either.
        """
        found = {name: chosen(self.points) if callable(chosen) else chosen for name, chosen in sets.items()}
        return replace(self, sets={**self.sets, **found})


def places_of(wanted: Array, known: Array) -> Array:
    """The places of the wanted numbers among the known numbers, which are unique; -1 for a number that is not known."""
    if not len(known):
        return np.full(len(wanted), -1)
    order = np.argsort(known)
    place = order[np.minimum(np.searchsorted(known, wanted, sorter=order), len(order) - 1)]
    return np.where(known[place] == wanted, place, -1)


def corners_of(mesh: Mesh) -> Array:
    """The corners of each cell, (m, c)."""
    return mesh.cells[:, :reference(mesh.kind).corners] if mesh.kind in KINDS else mesh.cells


def sides_of(kind: str, what: str) -> Array:
    """The nodes of each face or edge of a cell, (s, k), by `what` = 'faces' or 'edges'; a plane cell has edges only.

    The corners come first, as in `reference(kind).faces`, then the midside nodes between them in the same order, then the node in
    the middle of the face.
    """
    if kind not in KINDS:
        count = {"triangle": 3, "quad": 4}[kind]
        return np.stack([np.arange(count), (np.arange(count) + 1) % count], axis=1)
    element = reference(kind)
    middle = {frozenset(group): element.corners + i for i, group in enumerate(element.middles)}
    found = []
    for side in element.faces if what == "faces" else element.edges:
        groups = map(frozenset, (*zip(side, (*side[1:], side[0]), strict=True), side))
        found.append([*side, *dict.fromkeys(middle[group] for group in groups if group in middle)])
    return np.array(found)


def distinct_sides(mesh: Mesh, sides: Array) -> tuple[Array, Array, Array]:
    """The different faces or edges of a mesh, the numbers of each cell's faces or edges, and how many cells have each.

    Parameters
    ----------
    sides : ndarray, shape (s, c)
        The corners of the faces or edges of a cell.

    Returns
    -------
    corners : ndarray, shape (f, c)
        The corners as rows of `points`, ascending in each row and from row to row.
    number : ndarray, shape (m, s)
        For each cell, its faces or edges as rows of `corners`.
    times : ndarray, shape (f,)
        The number of cells that have each face or edge.
    """
    rows = np.sort(mesh.cells[:, sides].reshape(-1, sides.shape[1]), axis=1)
    # one integer for each row, in the order of the rows: np.unique of rows takes seven times as long
    key, span = rows[:, 0].astype(np.int64), len(mesh.points)
    for column in rows.T[1:]:
        if span * len(mesh.points) > np.iinfo(np.int64).max:
            different, key = np.unique(key, return_inverse=True)
            span = len(different)
        key, span = key * len(mesh.points) + column, span * len(mesh.points)
    _, first, number, times = np.unique(key, return_index=True, return_inverse=True, return_counts=True)
    return rows[first], number.reshape(len(mesh.cells), -1), times


def boundary_faces(mesh: Mesh) -> tuple[Array, Array]:
    """The faces that belong to one cell only: their cells (f,), and their index among the cell's faces (f,)."""
    _, number, times = distinct_sides(mesh, np.array(reference(mesh.kind).faces))
    cells, sides = np.nonzero(times[number] == 1)
    return cells, sides


def edges_of(mesh: Mesh) -> tuple[Array, Array, Array]:
    """The edges of a plane or solid mesh: their ends (e, 2), the edges of each cell (m, s), and which are on the border (e,)."""
    table = sides_of(mesh.kind, "edges")[:, :2]
    ends, number, times = distinct_sides(mesh, table)
    if mesh.dimension == 2:
        return ends, number, times == 1
    cells, sides = boundary_faces(mesh)
    of_face = np.array([[at for at, edge in enumerate(table) if set(edge) <= set(face)] for face in reference(mesh.kind).faces])
    border = np.zeros(len(ends), dtype=bool)
    border[number[cells[:, None], of_face[sides]]] = True
    return ends, number, border


def edges_within(ends: Array, border: Array, nodes: Array) -> Array:
    """Which edges have both ends in a set, bool (e,). Between two nodes of the border only edges of the border count."""
    outer = np.isin(ends, ends[border]).all(axis=1)
    return np.isin(ends, nodes).all(axis=1) & (border | ~outer)


def corner_nodes(mesh: Mesh, cells: Array, sides: Array) -> Array:
    """The corners of faces as rows of `points`, anticlockwise seen from outside, shape (f, 3 or 4)."""
    return np.take_along_axis(mesh.cells[cells], np.array(reference(mesh.kind).faces)[sides], axis=1)


def _named(what: str, values: Any) -> list[tuple[str, Any]]:
    found = mapping(what, {} if values is None else values, "names and rows, as {'left': [0, 3]}")
    return [(word(f"each name in {what}", name), chosen) for name, chosen in found.items()]


def _within(what: str, values: Any, count: int) -> Array:
    raw = rows(what, values)
    if raw.size == 0:
        return np.zeros(0, dtype=np.intp)
    if raw.dtype == bool and raw.shape == (count,):
        return np.flatnonzero(raw)
    if not np.issubdtype(raw.dtype, np.integer):
        raise InputError(f"{what} must hold whole numbers, not {raw.dtype}")
    if raw.min() < 0 or raw.max() >= count:
        bad = raw.min() if raw.min() < 0 else raw.max()
        raise InputError(f"{what} contains number {bad}, but there are {count}, counted from 0")
    return raw.astype(np.intp)
