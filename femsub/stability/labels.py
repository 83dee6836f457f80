"""Which modes grow at many values of parameters: mostly from enclosures around few decompositions, else from single solutions.

The values are divided as a k-d tree. In the middle of a leaf the family is decomposed, and `leaves` encloses the eigenvalues at
each value of the leaf. The values at which a mode stays undecided are halved along the parameter that turns the vectors most. If
few values are left, each is solved alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from femsub.checks import NOT_CHECKED, Array
from femsub.stability.leaves import Companion, Linear, Middle
from femsub.stability.margins import ModesAt, point_modes

if TYPE_CHECKING:
    from femsub.model import Affine
    from femsub.modes import ComplexModes

ALONE = 3  #: up to this number, values are solved one by one: a leaf takes as long as about two
CORNERS = 8  #: largest number of corners of a leaf at which the error of a `BoxModel` is evaluated
WAVE = 64  #: number of leaves that are examined before the next ones are chosen


class Enclosed(NamedTuple):
    """A family in first-order form about a place, for the values at which `holds` is True.

    `error` returns the largest distance of its λ from those of the full model between two corners (q,) around the place. It is
    relative to |λ|, or to `still` if |λ| is less. Without `error`, λ are exact to rounding.
    """

    linear: Callable[[Array], Linear]
    holds: Callable[[Array], Array]
    error: Callable[[Array, Array, Array], float] | None = None
    still: float = 0.0


class SeenMode(NamedTuple):
    """A mode at a place (q,), which represents this mode at values around it: λ, x with xᴴMx = 1 and Mx (n,)."""

    place: Array
    value: complex
    x: Array
    Mx: Array

    @classmethod
    def of(cls, place: Array, value: complex, x: Array, M: Any) -> SeenMode:
        Mx = M @ x
        size = max(float((x.conj() @ Mx).real), float(np.finfo(float).tiny)) ** 0.5
        return cls(place, complex(value), x / size, Mx / size)


class Labels:
    """The verdicts of m points, and the modes that grow there.

    Attributes
    ----------
    verdict : ndarray of int, shape (m,)
        1 where a mode certainly grows, -1 where all decay, 0 where that is undecided.
    growth, omega : ndarray, shape (m,)
        The largest Re λ in the band and |Im λ| of that mode; -inf and NaN of an empty band, NaN where nothing is known.
    hits : list of (int, int, int, complex)
        Point, node (-1 if it has none yet), vote 1 or 0, and λ, of all modes that grow or are undecided.
    nodes : list of SeenMode
    solved : int
        Decompositions and eigenproblems.
    whole : bool
        Whether all spectra were complete.
    """

    def __init__(self, solver: ModesAt, points: Array, region: tuple[float, float, float, float]) -> None:
        self.solver, self.points, self.region = solver, points, region
        self.verdict = np.zeros(len(points), dtype=int)
        self.growth, self.omega = np.full((2, len(points)), np.nan)
        self.hits: list[tuple[int, int, int, complex]] = []
        self.nodes: list[SeenMode] = []
        self.solved, self.whole = 0, True

    def _take(self, at: Array, values: Array, votes: Array, nodes: Sequence[int]) -> None:
        """Store λ and votes (m, k) of the modes at points; NaN and -1 outside the band."""
        rate = np.where(np.isnan(values.real), -np.inf, values.real)
        self.growth[at] = rate.max(axis=1, initial=-np.inf)
        if values.shape[1]:
            self.omega[at] = np.abs(values[np.arange(len(at)), rate.argmax(axis=1)].imag)
        self.verdict[at] = np.where((votes > 0).any(axis=1), 1, np.where((votes == 0).any(axis=1), 0, -1))
        for row, column in np.argwhere(votes >= 0):
            self.hits.append((int(at[row]), nodes[column], int(votes[row, column]), complex(values[row, column])))

    # by leaves

    def by_leaves(self, family: Affine, sources: Sequence[Enclosed], among: Array) -> Array:
        """Label these points by leaves; the points that leaves do not decide are returned."""
        names, alone = self.solver.names, list[Array]()

        def factors(rows: Array) -> Array:
            return np.array([family.factors(**dict(zip(names, row, strict=True))) for row in rows.tolist()])

        known = np.full((len(self.points), len(family.factors(**dict(zip(names, self.points[0].tolist(), strict=True))))), np.nan)
        known[among] = factors(self.points[among])
        mass = len(family.M)
        left = among
        for source in sources:
            inside = source.holds(self.points[left])
            waiting, left = [left[inside]], left[~inside]
            if np.ptp(known[waiting[0], :mass], axis=0).any() if len(waiting[0]) else False:
                alone.append(waiting.pop())  # b of a leaf must not change
            while waiting:
                alone += [at for at in waiting if len(at) <= ALONE]
                waiting = [at for at in waiting if len(at) > ALONE]
                now, waiting = waiting[-WAVE:], waiting[:-WAVE]
                self.solved += len(now)
                for at, found in zip(now, self.solver.each(partial(self._leaf, source, known, factors), now), strict=True):
                    rest, parameter, values, votes, shapes, place = found
                    done = ~np.isin(at, rest)
                    if done.any():
                        used = (votes[done] >= 0).any(axis=0)
                        number = np.cumsum(used) - 1 + len(self.nodes)
                        M = family.weighted(factors(place[None])[0]).M
                        M = M[-len(shapes):, -len(shapes):]  # without free rigid motion
                        self.nodes += [SeenMode.of(place, values[done, k][votes[done, k] >= 0][0], shapes[:, k], M)
                                       for k in np.flatnonzero(used)]
                        self._take(at[done], values[done], votes[done], number.tolist())
                    if len(rest) and not np.ptp(self.points[rest], axis=0).any():
                        alone.append(rest)
                    elif len(rest):
                        column = self.points[rest, parameter]
                        low = column <= (column.min() + column.max()) / 2
                        waiting += [part for part in (rest[low], rest[~low]) if len(part)]
        return np.concatenate([left, *alone]).astype(int)

    def _leaf(self, source: Enclosed, known: Array, factors: Callable[[Array], Array], at: Array) -> tuple[Any, ...]:
        """The points left open, and the parameter along which to halve them; values, votes and shapes; the middle."""
        p = self.points[at]
        lo, hi = p.min(axis=0), p.max(axis=0)
        place, widest = (lo + hi) / 2, int(np.argmax((hi - lo) / np.where(hi > lo, np.ptp(self.points, axis=0), 1.0)))
        here = factors(place[None])[0]
        none = np.zeros((len(at), 0))
        linear = source.linear(place)
        if (middle := Middle.of(linear, here)) is None:
            return at, widest, none, none, none, place
        changes = known[at] - here
        ends = np.repeat(place[None], 2 * len(place), axis=0)
        ends[0::2][np.diag_indices(len(place))], ends[1::2][np.diag_indices(len(place))] = lo, hi
        moved = factors(ends) - here
        around = middle.around(changes, moved[1::2] - moved[0::2])
        a, b, low, high = self.region
        listed = np.flatnonzero(middle.z.imag >= 0)
        turning = [around.turning(moved[2 * i:2 * i + 2], listed) for i in range(len(place))]
        parameter = int(np.argmax(turning)) if max(turning) > 0 else widest
        if not np.isfinite(around.F).all():
            return at, parameter, none, none, none, place
        radius = np.zeros(len(listed))
        if source.error is not None:
            # relative to the largest |λ| in the leaf, since a real λ may pass 0
            radius = source.error(place, lo, hi) * np.maximum(np.abs(around.centres(changes, listed)).max(axis=0), source.still)
            if not np.isfinite(radius).all():
                return at, parameter, none, none, none, place
        values, votes, own = around.votes(changes, listed, radius)
        if source.error is not None:
            votes[votes == 0] = 2  # with states fixed at the middle; the states of the place itself may decide
        doubt = own + radius
        inside = (values.imag <= high) & ((values.imag >= low) | (low <= 0)) & (values.real >= a) & (values.real <= b)
        edge = np.minimum(np.abs(values.imag - high), np.abs(values.real - b)) <= doubt
        edge |= (np.abs(values.imag - low) <= doubt) & (low > 0)
        votes = np.where(edge & (votes != -1), 2, np.where(inside, votes, -1))
        values = np.where(inside, values, np.nan)
        return (at[(votes == 2).any(axis=1)], parameter, values, votes, linear.x @ middle.V[:, listed], place)

    # one by one

    def one_by_one(self, at: Array) -> None:
        """Labels of these points, each from its own eigenproblem."""
        solver, points, self.solved = self.solver, self.points[at], self.solved + len(at)
        if solver.together or solver.modes:
            for i, found in zip(at.tolist(), solver(points), strict=True):
                self.whole &= found.whole
                self._take(np.array([i]), found.values[None], found.votes[None], [-1] * len(found.values))
            return
        for i, modes in zip(at.tolist(), map(solver.whole, points), strict=True):
            self.whole &= modes.evidence != NOT_CHECKED
            found = point_modes(modes, self.solver.band)
            nodes = list(self._nodes_of(self.points[i], modes, found.values, found.votes))
            self._take(np.array([i]), found.values[None], found.votes[None], nodes)

    def _nodes_of(self, place: Array, modes: ComplexModes, values: Array, votes: Array) -> Iterator[int]:
        M = self.solver.at(dict(zip(self.solver.names, place.tolist(), strict=True))).M
        free = int(np.count_nonzero(modes.rigid)) // 2 if self.solver.modes else 0
        for value, vote in zip(values, votes, strict=True):
            if vote < 0:
                yield -1
                continue
            x = modes.shapes[:, int(np.abs(modes.eigenvalues - value).argmin())]
            self.nodes.append(SeenMode.of(place, complex(value), x[free:], M[free:, free:] if free else M))
            yield len(self.nodes) - 1

    def with_nodes(self, most: int = 64, alike: float = 0.05) -> None:
        """Give hits without a node the node of a mode with about the same λ, at the nearest place that has one.

        Shapes are computed at up to `most` places at a time. λ is about the same if |Δλ| is at most `alike` times |λ|.
        """
        from scipy.spatial import cKDTree

        scale = np.where(np.ptp(self.points, axis=0) > 0, np.ptp(self.points, axis=0), 1.0)
        for last in (False, True):
            missing = [row for row, hit in enumerate(self.hits) if hit[1] < 0]
            if not missing:
                return
            mine: dict[int, list[complex]] = {}
            for row in missing:
                mine.setdefault(self.hits[row][0], []).append(self.hits[row][3])
            for i in list(mine)[:most]:
                list(self._nodes_of(self.points[i], self.solver.whole(self.points[i]), np.array(mine[i]), np.ones(len(mine[i]))))
            places, at = np.unique([node.place for node in self.nodes], axis=0, return_inverse=True)
            owned = [np.flatnonzero(at == k) for k in range(len(places))]
            nearest = cKDTree(places / scale).query(self.points[[self.hits[row][0] for row in missing]] / scale)[1]
            values = np.array([node.value for node in self.nodes])
            for row, place in zip(missing, nearest, strict=True):
                i, _, vote, value = self.hits[row]
                k = owned[place][np.abs(values[owned[place]] - value).argmin()]
                if last or abs(values[k] - value) <= alike * abs(value):
                    self.hits[row] = i, int(k), vote, value


def sources_of(family: Affine) -> list[Enclosed]:
    """The first-order forms of a family: one for each proved cell of a `BoxModel`, one for all values of another dense family.

    About a place the model is projected on the states there, if the cell has any. These states are used for all values around,
    and the error that this causes is evaluated in corners.
    """
    box: Any = family
    M, D, K = ([np.asarray(A.toarray() if hasattr(A, "toarray") else A) for _, A in part]
               for part in (family.M, family.D, family.K))
    if not hasattr(box, "cells"):
        whole = Companion.of(M, D, K)
        return [Enclosed(lambda place: whole, lambda points: np.ones(len(points), dtype=bool))]
    names = list(box.parameters)
    M, D, K = ([A[box.free:, box.free:] for A in part] for part in (M, D, K))

    def values(place: Array) -> dict[str, float]:
        return dict(zip(names, place.tolist(), strict=True))

    def of(cell: Any) -> Enclosed:
        lo, hi = np.transpose([cell.ranges[name] for name in names])
        states, every = cell.states, None if cell.states else Companion.of(M, D, K)

        def linear(place: Array) -> Companion:
            return every or Companion.between(M, D, K, states.unit, *states.at(values(place)))

        def error(place: Array, low: Array, high: Array) -> float:
            if states is None:
                lam, radius, known = box.eigenvalues(values(place))
                found = [float((radius / np.maximum(np.abs(lam), box.box.still)).max(initial=0.0)) if known else np.inf]
            else:
                here = states.staying(values(place))
                # one of each two opposite corners: to first order the error of the states is the same in both
                sides = np.array(list(product((0, 1), repeat=len(place) - 1))[:CORNERS], dtype=bool)
                corners = np.where(np.hstack([np.ones((len(sides), 1), dtype=bool), sides]), high, low)
                found = [box.distance(cell, here, values(corner)) for corner in corners]
            return max(2 * max(found), box.box.tol, box.error)

        return Enclosed(linear, lambda points: ((points >= lo) & (points <= hi)).all(axis=1), error, box.box.still)

    return [of(cell) for cell in box.cells if cell.number is not None]
