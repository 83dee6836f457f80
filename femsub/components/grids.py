"""Meshes from a regular grid: block, annulus and rectangle, with their faces or edges as named sets."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from femsub.algebra import check_room
from femsub.checks import Array, InputError, interval, items, real_array, shown, whole_number
from femsub.components.mesh import Mesh
from femsub.components.solid_elements import box


def block(lengths: Sequence[float], counts: Sequence[int], kind: str = "hexahedron20", name: str = "block") -> Mesh:
    """A mesh of the block [0, lx] x [0, ly] x [0, lz] with nx x ny x nz bricks, or six tetrahedra in place of each brick.

    Parameters
    ----------
    lengths : sequence of float, shape (3,)
        Lengths in the unit of length of E and rho.
    counts : sequence of int, shape (3,)
        Bricks along x, y and z.
    kind : str
        'hexahedron', 'hexahedron20', 'hexahedron27', 'tetra' or 'tetra10'.
    name : str

    Returns
    -------
    Mesh
        Sets of nodes: left and right (x = 0, lx), front and back (y = 0, ly), bottom and top (z = 0, lz).

    Raises
    ------
    InputError
        A length that is not positive, a count below 1, an unknown kind.

    Examples
    --------
    >>> import femsub as fs
    >>> mesh = fs.block((1.0, 0.2, 0.1), (4, 1, 1), "hexahedron")
    >>> len(mesh.points), len(mesh.cells), len(mesh.nodes("left"))
    (20, 4, 4)
    """
    sizes, bricks = _lengths("lengths", lengths, 3), _counts(counts, 3)
    grid, cells = box(bricks, kind)
    return Mesh(grid / bricks * sizes, cells, kind, _sides(grid, bricks), name=name)


def annulus(inner: float, outer: float, thickness: float, counts: Sequence[int] = (4, 48, 2), kind: str = "hexahedron20",
            name: str = "annulus", sector: tuple[float, float] | None = None) -> Mesh:
    """A mesh of a disc with a hole: inner ≤ √(x² + y²) ≤ outer, 0 ≤ z ≤ thickness. Midside nodes lie on the circles.

    With `sector`, only a sector of it, such as the lining of a brake pad.

    Parameters
    ----------
    inner, outer, thickness : float
        Radii and thickness, in the unit of length of E and rho.
    counts : sequence of int, shape (3,)
        Bricks along the radius, around (3 or more in a full circle) and through the thickness.
    kind : str
        'hexahedron', 'hexahedron20', 'hexahedron27', 'tetra' or 'tetra10'.
    name : str
    sector : (start, end), optional
        Angles from the x axis towards y, in radians, less than a full turn apart. Default: the whole annulus.

    Returns
    -------
    Mesh
        Sets of nodes: inner, outer (the two rims), bottom, top; a sector also has start and end.

    Raises
    ------
    InputError
        inner ≥ outer, a length that is not positive, a count below 1 (around: 3 in a turn), an unknown kind, a sector of a
        turn or more.

    Examples
    --------
    >>> import femsub as fs
    >>> mesh = fs.annulus(0.1, 0.2, 0.02, (1, 12, 1), "hexahedron")
    >>> len(mesh.points), len(mesh.cells), len(mesh.nodes("outer"))
    (48, 12, 24)
    """
    low, high, height = _lengths("inner, outer and thickness", (inner, outer, thickness), 3)
    if low >= high:
        raise InputError(f"inner must be below outer, but they are {low:g} and {high:g}")
    bricks = _counts(counts, 3)
    start, end = (0.0, 2 * np.pi) if sector is None else interval("sector", sector)
    if sector is not None and end - start >= 2 * np.pi:
        raise InputError(f"sector must be less than a full turn (2π), not {end - start:.6g} rad. Leave it out for a "
                         "whole annulus")
    if 3 * (end - start) > 2 * np.pi * bricks[1]:
        least = math.ceil(3 * (end - start) / (2 * math.pi))
        raise InputError(f"counts: an annulus needs at least {least} bricks around, not {bricks[1]}")
    grid, cells = ring(bricks, kind, closed=sector is None)
    r, angle = low + grid[:, 0] / bricks[0] * (high - low), start + (end - start) * grid[:, 1] / bricks[1]
    points = np.stack([r * np.cos(angle), r * np.sin(angle), grid[:, 2] / bricks[2] * height], axis=1)
    sides = _sides(grid, bricks)
    sets = {"inner": sides["left"], "outer": sides["right"], "bottom": sides["bottom"], "top": sides["top"]}
    if sector is not None:
        sets |= {"start": sides["front"], "end": sides["back"]}
    return Mesh(points, cells, kind, sets, name=name)


def ring(counts: Sequence[int] | Array, kind: str, closed: bool) -> tuple[Array, Array]:
    """The grid of `box`. In a closed ring, the last nodes along the second axis are the first nodes."""
    grid, cells = box(counts, kind)
    if closed:
        half = np.rint(2 * grid).astype(np.intp)
        half[:, 1] %= 2 * counts[1]
        place = np.ravel_multi_index(tuple(half.T), tuple(2 * np.asarray(counts) + 1))
        _, first, number = np.unique(place, return_index=True, return_inverse=True)
        grid, cells = grid[first], number[cells]
    return grid, cells


def rectangle(lengths: Sequence[float], counts: Sequence[int], kind: str = "quad", name: str = "rectangle") -> Mesh:
    """A plane mesh of the rectangle [0, lx] x [0, ly] with nx x ny quadrilaterals, or two triangles in place of each.

    Parameters
    ----------
    lengths : sequence of float, shape (2,)
        Lengths in the unit of length of E and rho.
    counts : sequence of int, shape (2,)
        Quadrilaterals along x and y.
    kind : str
        'quad' or 'triangle'.
    name : str

    Returns
    -------
    Mesh
        Points have two coordinates. Sets of nodes: left and right (x = 0, lx), front and back (y = 0, ly), and edge, all
        four sides together.

    Raises
    ------
    InputError
        A length that is not positive, a count below 1, an unknown kind.

    Examples
    --------
    >>> import femsub as fs
    >>> mesh = fs.rectangle((2.0, 1.0), (4, 2), "triangle")
    >>> len(mesh.points), len(mesh.cells), len(mesh.nodes("edge"))
    (15, 16, 12)
    """
    sizes, quads = _lengths("lengths", lengths, 2), _counts(counts, 2)
    grid, cells = box(quads, kind)
    sides = _sides(grid, quads)
    sides["edge"] = np.unique(np.concatenate(list(sides.values())))
    return Mesh(grid / quads * sizes, cells, kind, sides, name=name)


def _sides(grid: Array, counts: Array) -> dict[str, Array]:
    names = (("left", "right"), ("front", "back"), ("bottom", "top"))
    return {name: np.flatnonzero(grid[:, axis] == place)
            for axis, count in enumerate(counts) for name, place in zip(names[axis], (0, count), strict=True)}


def _lengths(what: str, values: Sequence[float], size: int) -> Array:
    found = real_array(what, values)
    if found.shape != (size,) or found.min() <= 0:
        raise InputError(f"{what} must be {size} positive numbers, not {values!r:.60}")
    return found


def _counts(values: Sequence[int], size: int) -> Array:
    found = items("counts", values, "whole numbers")
    whole = all(isinstance(count, (int, np.integer)) and not isinstance(count, bool) and count >= 1 for count in found)
    if len(found) != size or not whole:
        raise InputError(f"counts must be {size} whole numbers of 1 or more, not {shown(values)}")
    checked = [whole_number("counts", count) for count in found]
    # 20 node numbers for each cell (8 and their sorted copies), 3 coordinates, and six copies while they are computed
    check_room(f"a mesh of {' x '.join(f'{count:.6g}' for count in checked)} cells", 23 * 8 * 6.0 * math.prod(checked))
    return np.array(checked)


def line(places: Array, name: str = "line") -> Mesh:
    """A mesh of 'line' cells along x, from each place to the next."""
    nodes = np.arange(len(places))
    return Mesh(np.asarray(places, dtype=float)[:, None], np.stack([nodes[:-1], nodes[1:]], axis=1), "line", name=name)


def mounted_disc(inner: float, outer: float, thickness: float, counts: Sequence[int], kind: str, name: str) -> Mesh:
    """An `annulus` with the node sets contact and mounts.

    The contact is a patch of two cells on top, next to the outer rim at angle 0. The mounts are three nodes of the lower edge of
    the outer rim, 120° apart.
    """
    mesh = annulus(inner, outer, thickness, counts, kind, name=name)
    radius, angle = np.hypot(*mesh.points[:, :2].T), np.arctan2(mesh.points[:, 1], mesh.points[:, 0])
    width, sector = (outer - inner) / counts[0], 2 * np.pi / counts[1]
    top = mesh.sets["top"]
    patch = top[(radius[top] > outer - 1.01 * width) & (np.abs(angle[top]) < 1.01 * sector)]
    edge = np.intersect1d(mesh.sets["outer"], mesh.sets["bottom"])
    around = np.exp(1j * angle[edge])
    mounts = [edge[np.argmin(np.abs(around - np.exp(2j * np.pi * place)))] for place in (1 / 6, 1 / 2, 5 / 6)]
    return mesh.with_sets(contact=patch, mounts=mounts)
