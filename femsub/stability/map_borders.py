"""The borders of a map as curves: where the number of growing modes changes on the edges of a grid, joined across its cells.

A cell is halved where the second differences of a margin allow a mode to cross inside, though it crosses at no corner. On an edge
each margin that changes its sign has a root. In a cell, two places at which the same mode crosses are joined; ω identifies the
mode.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product
from typing import NamedTuple, TypeAlias

import numpy as np

from femsub.algebra import one_thread
from femsub.checks import Array
from femsub.modes import assigned
from femsub.stability.margins import ModesAt, PointModes, between

Node: TypeAlias = tuple[int, int]  # indices in the grid, in units of the smallest cells
Edge: TypeAlias = tuple[Node, Node]
Knot: TypeAlias = tuple[Edge, int]  # a crossing: its edge, and its number there


class BorderLine(NamedTuple):
    """A curve on which the number of growing modes changes: m places (m, 2), and ω there (m,).

    ω is 0 where a real eigenvalue passes 0. `closed`: the ends are the same point.
    """

    points: Array
    omega: Array
    closed: bool


class Nodes(dict[Node, PointModes]):
    """The modes at the points of a grid with smaller cells in some places."""

    def __init__(self, axes: Sequence[Array], step: int, solver: ModesAt) -> None:
        super().__init__()
        self.axes, self.step, self.solver = axes, step, solver

    def place(self, node: Node) -> Array:
        return np.array([np.interp(at / self.step, np.arange(len(axis)), axis)
                         for at, axis in zip(node, self.axes, strict=True)])

    def far(self, place: Array, other: Array) -> float:
        """The distance of two places, in units of the side of the smallest cells."""
        return float(np.linalg.norm([np.diff(np.interp([one, two], axis, self.step * np.arange(len(axis))))
                                     for one, two, axis in zip(place, other, self.axes, strict=True)]))

    def add(self, nodes: Iterable[Node]) -> None:
        new = [node for node in dict.fromkeys(nodes) if node not in self]
        if new:
            self.update(zip(new, self.solver(np.array([self.place(node) for node in new])), strict=True))


class MapCell(NamedTuple):
    """A square of nodes, from its lower corner on."""

    i: int
    j: int
    side: int

    @property
    def corners(self) -> list[Node]:
        return [(self.i, self.j), (self.i + self.side, self.j), (self.i + self.side, self.j + self.side),
                (self.i, self.j + self.side)]

    @property
    def parts(self) -> list[MapCell]:
        half = self.side // 2
        return [MapCell(self.i + a, self.j + b, half) for a, b in product((0, half), repeat=2)]

    def around(self, nodes: Nodes) -> list[Edge]:
        """The edges along its sides, anticlockwise, from each node to the next; nodes of smaller cells beside it count."""
        corners = self.corners
        walk = [(a + (c - a) * k // self.side, b + (d - b) * k // self.side)
                for (a, b), (c, d) in zip(corners, [*corners[1:], corners[0]], strict=True) for k in range(self.side)]
        known = [node for node in walk if node in nodes]
        return [*zip(known, known[1:] + known[:1], strict=True)]


def leaves(nodes: Nodes, grid: Sequence[Sequence[PointModes]], step: int) -> list[MapCell]:
    """The cells, halved where a margin may pass 0 inside though at no corner, or where both corners of a diagonal have more."""
    most = max(one.growing for row in grid for one in row) + 1
    margins = np.array([[[one.margin(k) for k in range(most)] for one in row] for row in grid])
    bends = np.zeros((2, *margins.shape))
    sides = [np.diff(axis) for axis in nodes.axes]
    for axis in (0, 1):
        if margins.shape[axis] > 2:  # second derivatives: values may be given, at unequal distances
            rows, apart = np.moveaxis(margins, axis, 0), sides[axis][:, None, None]
            bend = 2 * np.abs(np.diff(np.diff(rows, axis=0) / apart, axis=0)) / (apart[1:] + apart[:-1])
            bends[axis] = np.moveaxis(np.pad(bend, [(1, 1), (0, 0), (0, 0)], mode="edge"), 0, axis)
    done: list[MapCell] = []
    cells = [MapCell(step * i, step * j, step) for i, j in np.ndindex(margins.shape[0] - 1, margins.shape[1] - 1)]
    while cells and cells[0].side > 1:
        halved: list[MapCell] = []
        for cell in cells:
            around = [nodes[corner] for corner in cell.corners]
            growing = [one.growing for one in around]
            i, j = cell.i // step, cell.j // step
            wide = np.array([sides[0][i], sides[1][j]]) * cell.side / step
            bend = np.tensordot(wide**2, bends[:, i:i + 2, j:j + 2], 1).max(axis=(0, 1)) / 4
            above, below = max(growing), min(growing) - 1  # the first margin that is negative, and the last above 0
            open_ = (above < most and bend[above] > -max(one.margin(above) for one in around)) \
                or (below >= 0 and bend[below] > min(one.margin(below) for one in around)) \
                or min(growing[::2]) > max(growing[1::2]) or min(growing[1::2]) > max(growing[::2])
            if open_:
                halved += cell.parts
            else:
                done.append(cell)
        nodes.add(corner for cell in halved for corner in cell.corners)
        cells = halved
    return done + cells


class Bracket(NamedTuple):
    """A part of an edge, from t = `first` to t = `last`, with the modes at both ends."""

    edge: Edge
    first: float
    last: float
    here: PointModes
    there: PointModes

    @property
    def begins(self) -> bool:
        """Whether more modes grow at its last end."""
        return self.there.growing > self.here.growing

    def once_more(self) -> float | None:
        """t between a mode that ceases to grow and one that begins to, where modes are computed; None if there are not both."""
        places = []
        for one, other in ((self.here, self.there), (self.there, self.here)):
            rows = np.flatnonzero(one.votes > 0)
            if not len(rows) or not len(other.values):
                return None
            mine, to = assigned(np.abs(one.values[rows, None] - other.values))
            if not (passed := np.flatnonzero(other.votes[to] < 0)).size:
                return None
            high, low = one.values[rows[mine[passed[0]]]].real, other.values[to[passed[0]]].real
            places.append(high / (high - low) if one is self.here else low / (low - high))
        return float(self.first + np.clip(np.mean(places), 0.1, 0.9) * (self.last - self.first))

    def guess(self, k: int) -> tuple[float, float]:
        """t and ω where the mode of the k-th margin may be on the axis, on a line from λ to the nearest at the other end."""
        high, low = (self.there, self.here) if self.begins else (self.here, self.there)
        value, still = high.margins[k] + 1j * high.heights[k], low.values[low.votes <= 0]
        other = still[np.argmin(np.abs(still - value))] if len(still) else value - 2 * value.real
        share = value.real / (value.real - other.real) if other.real < 0 else 0.5
        return (self.first + (1 - share if self.begins else share) * (self.last - self.first),
                float(value.imag + share * (other.imag - value.imag)))


class BorderPlace(NamedTuple):
    """A place at which a border meets an edge, ω there, and whether a mode begins to grow on the way along the edge."""

    place: Array
    omega: float
    begins: bool


def crossings(edges: Sequence[Edge], nodes: Nodes, rounds: int = 6) -> dict[Edge, list[BorderPlace]]:
    """The places where borders meet edges.

    An edge on which one mode begins and another ceases to grow is divided between both, in at most `rounds` rounds. The two
    places are then nearer to each other than 0.5 to 2 % of the edge.
    """
    from scipy.optimize.elementwise import find_root

    found: dict[Edge, list[BorderPlace]] = {edge: [] for edge in edges}
    edges = [(a, b) for a, b in edges if nodes[a].growing or nodes[b].growing]
    ends = {edge: [nodes.place(node) for node in edge] for edge in edges}

    def place(one: Bracket, t: float) -> Array:
        return between(ends[one.edge], t)

    def solve(several: Sequence[tuple[Bracket, float]]) -> list[PointModes]:
        return nodes.solver(np.array([place(*one) for one in several]))

    brackets, whole = [Bracket(edge, 0.0, 1.0, nodes[edge[0]], nodes[edge[1]]) for edge in edges], list[Bracket]()
    for _ in range(rounds):
        at = [(one, one.once_more()) for one in brackets]
        whole += [one for one, t in at if t is None]
        parted = [(one, t) for one, t in at if t is not None]
        brackets = [part for (one, t), middle in zip(parted, solve(parted) if parted else [], strict=True)
                    for part in (one._replace(last=t, there=middle), one._replace(first=t, here=middle))]
    # for each margin that changes its sign: the place where its mode is on the axis
    left: list[tuple[Bracket, int]] = []
    with one_thread(True):
        for one in whole + brackets:
            low, high = sorted((one.here, one.there), key=lambda end: end.growing)
            met, k = list[float](), low.growing
            while k < high.growing:
                on_axis = nodes.solver.on_axis(ends[one.edge], *one.guess(k))
                if on_axis is not None and one.first <= on_axis[0] <= one.last and on_axis[2] == one.begins \
                        and not np.isclose(on_axis[1], met, rtol=nodes.solver.fine).any():
                    met.append(on_axis[1])
                    found[one.edge].append(BorderPlace(place(one, on_axis[0]), *on_axis[1:]))
                else:
                    left.append((one, k))
                k += 2 if high.heights[k] > 0 else 1
    if not left:
        return found
    # otherwise a root of the margin, for all remaining margins at once
    heights: dict[tuple[int, float], float] = {}

    def margins(t: Array, which: Array) -> Array:
        asked = [(*left[int(number)], int(number), float(share)) for number, share in zip(which.flat, t.flat, strict=True)]
        inside = [(one, share) for one, _, _, share in asked if one.first < share < one.last]
        solved = iter(solve(inside) if inside else [])
        values = []
        for one, k, number, share in asked:
            end = one.here if share <= one.first else one.there if share >= one.last else next(solved)
            values.append(end.margin(k))
            heights[number, share] = float(end.heights[k]) if k < len(end.heights) else 0.0
        return np.array(values).reshape(t.shape)

    fine = nodes.solver.fine
    result = find_root(margins, (np.array([one.first for one, _ in left]), np.array([one.last for one, _ in left])),
                       args=(np.arange(len(left), dtype=float),), tolerances={"xatol": fine, "xrtol": 0.0, "frtol": fine})
    for number, (one, _) in enumerate(left):
        t, sides = float(result.x[number]), [float(end[number]) for end in result.bracket]
        if sides[1] - sides[0] <= 2 * fine:  # the margin may jump, as at an end of the band: where it is above 0 it has its ω
            t = sides[0 if result.f_bracket[0][number] > 0 else 1]
        found[one.edge].append(BorderPlace(place(one, t), heights[number, t], one.begins))
    return found


def joined(cells: Sequence[MapCell], nodes: Nodes, alike: float = 0.01) -> list[BorderLine]:
    """The lines of all borders: in a cell, a mode that begins to grow on the way around it is joined to one that ceases to.

    If several modes do, ω identifies them. If two modes that begin to grow differ in ω by less than `alike`, relative to ω, they
    may be one mode: the cell is halved. In a cell of the smallest size, nearby places are joined instead.
    """
    found: dict[Edge, list[BorderPlace]] = {}
    while True:
        walks = [cell.around(nodes) for cell in cells]
        edges = dict.fromkeys((min(pair), max(pair)) for walk in walks for pair in walk)
        found |= crossings([edge for edge in edges if edge not in found], nodes)
        knots = {(edge, at): one for edge in edges for at, one in enumerate(found[edge])}
        links: dict[Knot, list[Knot]] = {key: [] for key in knots}
        halved: list[MapCell] = []
        for cell, walk in zip(cells, walks, strict=True):
            sides: tuple[list[Knot], list[Knot]] = ([], [])
            for a, b in walk:
                edge = (min(a, b), max(a, b))
                for at, one in enumerate(found[edge]):
                    sides[int(one.begins == (edge == (a, b)))].append((edge, at))
            ceases, begins = ([knots[key] for key in side] for side in sides)
            omega = np.sort([one.omega for one in begins])
            if cell.side > 1 and (np.diff(omega) <= alike * omega[1:]).any():
                halved.append(cell)
            far = [[abs(one.omega - other.omega) + alike * max(omega) * nodes.far(one.place, other.place) / cell.side
                    for other in begins] for one in ceases]
            for i, j in zip(*assigned(np.array(far).reshape(len(ceases), len(begins))), strict=True):
                links[sides[0][i]].append(sides[1][j])
                links[sides[1][j]].append(sides[0][i])
        if not halved:
            break
        parts = [part for cell in halved for part in cell.parts]
        nodes.add(corner for part in parts for corner in part.corners)
        cells = [cell for cell in cells if cell not in set(halved)] + parts
    lines, used = list[BorderLine](), set[Knot]()
    for key in sorted(knots, key=lambda one: len(links[one])):  # ends first; what is left are closed lines
        if key in used:
            continue
        line = [key]
        used.add(key)
        while ahead := [other for other in links[line[-1]] if other not in used]:
            line.append(ahead[0])
            used.add(ahead[0])
        closed = len(links[key]) > 1
        line += line[:1] * closed
        lines.append(BorderLine(np.array([knots[one].place for one in line]), np.array([knots[one].omega for one in line]),
                                closed))
    return lines
