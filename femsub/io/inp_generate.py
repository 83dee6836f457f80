"""Where the nodes and elements lie that an Abaqus or CalculiX file has made: *NGEN, *NFILL, *NCOPY, *NMAP and *ELGEN.

What each line means stands in the Abaqus Keywords Reference Guide, under the keyword.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from femsub.checks import Array
from femsub.errors import InputError

MOST = 50_000_000  # nodes or elements that one line may make
Place = Callable[[Array], Array]  # numbers of nodes to their points (n, 3); an unknown number is an InputError


def steps(what: str, first: int, last: int, step: int) -> Array:
    """first, first + step, ..., last."""
    if step == 0 or (last - first) % step or (last - first) // step < 1:
        raise InputError(f"{what}: {last} is not reached from {first} in steps of {step}")
    if (last - first) // step > MOST:
        raise InputError(f"{what}: from {first} to {last} in steps of {step} are more than {MOST} numbers")
    return np.arange(first, last + np.sign(step), step)


def along(what: str, table: Array, place: Place, line: str) -> tuple[Array, Array, Array]:
    """*NGEN: nodes between two, on a straight line or (LINE=C) on an arc about a third; numbers, points, ends included.

    Columns: first node, last node, step of the numbers, centre as a node, or its coordinates, normal of the arc.
    """
    first, last, step = (int(value) for value in (*table[:2], table[2] or 1))
    numbers = steps(what, first, last, step)
    ends = place(numbers[[0, -1]])
    share = np.linspace(0.0, 1.0, len(numbers))[1:-1, None]
    if line not in ("", "C"):
        raise InputError(f"{what}, LINE={line} is not read: write the mesh with all nodes and elements listed")
    if not line:
        return numbers[1:-1], ends[0] + share * (ends[1] - ends[0]), numbers
    centre = place(np.array([int(table[3])]))[0] if table[3] else table[4:7]
    arms = ends - centre
    axis = np.cross(arms[0], arms[1])
    size, radii = np.linalg.norm(axis), np.linalg.norm(arms, axis=1)
    if table[7:].any() or not radii.all() or size < 1e-6 * radii.prod() or abs(radii[0] - radii[1]) > 1e-3 * radii[0]:
        raise InputError(f"{what}, LINE=C from node {first} to {last} is not read: only arcs below 180° about their centre are")
    angle = np.arctan2(size, arms[0] @ arms[1])
    side = np.cross(axis / size, arms[0])
    radius = 1 + share * (radii[1] / radii[0] - 1)
    return numbers[1:-1], centre + radius * (np.cos(share * angle) * arms[0] + np.sin(share * angle) * side), numbers


def between(what: str, first: Array, last: Array, count: int, step: int, place: Place) -> tuple[Array, Array]:
    """*NFILL: `count` equal intervals from each node of a set to that of the other in the same place of the order."""
    if len(first) != len(last) or not len(first) or count < 1:
        raise InputError(f"{what} fills {count} intervals between sets of {len(first)} and {len(last)} nodes, which cannot be "
                         "paired")
    if count * len(first) > MOST:
        raise InputError(f"{what} makes more than {MOST} nodes")
    share = (np.arange(1, count) / count)[None, :, None]
    start, end = place(first)[:, None, :], place(last)[:, None, :]
    return (first[:, None] + step * np.arange(1, count)).ravel(), (start + share * (end - start)).reshape(-1, 3)


def moved(what: str, table: Array, points: Array) -> Array:
    """*NCOPY, SHIFT: a translation (first line), then a turn about the axis from a to b by an angle in degrees (second)."""
    rows = np.zeros((2, 7))
    if table.shape[0] > 2 or table.shape[1] > 7:
        raise InputError(f"{what}, SHIFT takes two lines, of 3 and 7 numbers")
    rows[:table.shape[0], :table.shape[1]] = table
    points = points + rows[0, :3]
    if not rows[1, 6]:
        return points
    axis = rows[1, 3:6] - rows[1, :3]
    length = np.linalg.norm(axis)
    if not length:
        raise InputError(f"{what}, SHIFT turns about an axis whose two points are the same")
    n, arms, angle = axis / length, points - rows[1, :3], np.deg2rad(rows[1, 6])
    along_axis = (arms @ n)[:, None] * n
    return rows[1, :3] + along_axis + np.cos(angle) * (arms - along_axis) + np.sin(angle) * np.cross(n, arms)


def reflected(what: str, how: str, table: Array, points: Array) -> Array:
    """*NCOPY, REFLECT: through the point a, the line from a to b, or the plane (MIRROR) through a, b and c."""
    given = np.zeros(9)
    flat = np.concatenate([row[:6] for row in table]) if len(table) else given
    need = {"POINT": 3, "LINE": 6, "MIRROR": 9}.get(how, 0)
    if not need or len(flat) < need:
        raise InputError(f"{what}, REFLECT={how} with {len(flat)} numbers is not read: POINT needs 3, LINE 6, MIRROR 9")
    a, b, c = flat[:3], flat[3:6], flat[6:9]
    arms = points - a
    if how == "POINT":
        return a - arms
    direction = b - a if how == "LINE" else np.cross(b - a, c - a)
    length = np.linalg.norm(direction)
    if not length:
        raise InputError(f"{what}, REFLECT={how}: the points give no {'line' if how == 'LINE' else 'plane'}")
    n = direction / length
    along_n = (arms @ n)[:, None] * n
    return a + (2 * along_n - arms if how == "LINE" else arms - 2 * along_n)


def mapped(what: str, kind: str, table: Array, points: Array) -> Array:
    """*NMAP: local coordinates, scaled, into the global system; a is the origin, and a, b and c lie in a plane.

    RECTANGULAR: x from a to b, y towards c. CYLINDRICAL (r, θ in degrees, z): z from a to b, θ = 0 towards c.
    """
    rows = np.zeros((3, 6))
    if table.shape[0] > 3 or table.shape[1] > 6 or kind not in ("RECTANGULAR", "CYLINDRICAL"):
        raise InputError(f"{what}, TYPE={kind or '(none)'} with {len(table)} lines is not read; RECTANGULAR and CYLINDRICAL are")
    rows[:table.shape[0], :table.shape[1]] = table
    a, b, c = rows[0, :3], rows[0, 3:], rows[1, :3]
    one, plane = b - a, np.cross(b - a, c - a)
    if not plane.any():
        raise InputError(f"{what}: the three points of its system lie on a line")
    e1, e3 = one / np.linalg.norm(one), plane / np.linalg.norm(plane)
    e2 = np.cross(e3, e1)
    local = points * np.where(rows[2, :3] == 0, 1.0, rows[2, :3])
    if kind == "CYLINDRICAL":
        angle = np.deg2rad(local[:, 1])
        local = np.stack([local[:, 2], local[:, 0] * np.cos(angle), local[:, 0] * np.sin(angle)], axis=1)
    return a + local @ np.stack([e1, e2, e3])


def in_rows(what: str, table: Array) -> tuple[int, Array, Array]:
    """*ELGEN: the master element, and what each element of rows, rows of rows and layers adds to node and element numbers.

    Columns: master; count, step of nodes, step of elements along the row; the same three for rows; for layers.
    """
    full = np.zeros(10, dtype=np.int64)
    full[:min(len(table), 10)] = table[:10]
    count, node, element = (np.where(full[start::3][:3] == 0, 1, full[start::3][:3]) for start in (1, 2, 3))
    if len(table) > 10 or count.min() < 1 or np.prod(count.astype(float)) > MOST:
        raise InputError(f"{what} of element {full[0]} makes {' x '.join(map(str, count))} elements, which is none or too many")
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in count), indexing="ij"), axis=-1).reshape(-1, 3)[1:]
    return int(full[0]), grid @ node, grid @ element
