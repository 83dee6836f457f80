"""Following a branch of limit cycles, and locating the points where stability changes.

The key of a cycle is the sign of dp/ds and the number of multipliers outside the unit circle. If it changes between two
neighbours, the step between them is halved until the change is located. The multiplier that passes the circle gives the
point its name: +1 at a fold, -1 at a period doubling, a complex pair at a Neimark-Sacker point.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from femsub.errors import NotConvergedError
from femsub.motion.cycles.balance import in_phase
from femsub.motion.cycles.continuation import EASY, HARD, Path, Place
from femsub.motion.cycles.limit_cycle import LimitCycle

LONGEST, SHORTEST, FIRST = 0.15, 1e-5, 0.01  # scaled steps along a branch
HALVINGS = 6  # halvings to locate a special point
YOUNG = 0.02  # amplitude / belt speed below which the amplitude's multiplier is 1 within its error
BESIDE = 2e-3  # distance from a fold, as a share of the parameter's range, within which a multiplier is 1 within its error
TURN = 0.85  # smallest cosine between the tangents of neighbours


@dataclass(frozen=True)
class SpecialPoint:
    """A named point of a branch: 'fold', 'period doubling', 'Neimark-Sacker' or 'branch point' (+1 without a fold)."""

    kind: str
    value: float
    omega: float
    rms: float
    multiplier: complex


class Tracer:
    """One walk along a path, in one direction: the cycles found, in order, and why it ended."""

    def __init__(self, path: Path, direction: float, limits: tuple[float, float], stability: bool) -> None:
        self.path, self.direction, self.limits, self.stability = path, direction, limits, stability
        self.values: list[float] = []
        self.cycles: list[LimitCycle] = []
        self.special: list[SpecialPoint] = []
        self.ended = ""

    def walk(self, first: Place, points: int, tell: Callable[[str], None]) -> Tracer:
        """Walk from `first` on, until the end of the range, of the branch, or of the allowed number of points."""
        place, length = first, FIRST
        cycle = self.cycle(place)
        self._keep(place, cycle)
        while len(self.values) < points:
            tell(f"branch: {len(self.values)} cycles, {self.path.parameter} = {place.value:.6g}")
            try:
                found, turns = self.path.step(place, self.direction * length)
                if self._angle(place, found) < TURN:
                    raise NotConvergedError("the branch turns too sharply for this step")
            except NotConvergedError as error:
                length /= 2
                if length < SHORTEST:
                    self.ended = f"the steps became too small at {self.path.parameter} = {place.value:.6g}: {error}"
                    return self
                continue
            self.ended = self._over(place, found, first)
            if self.ended:
                self._last(found)
                return self
            fresh = self.cycle(found)
            self._scan(place, cycle, found, fresh, length, HALVINGS)
            place, cycle = found, fresh
            self._keep(place, cycle)
            length = min(LONGEST, 1.5 * length) if turns <= EASY else 0.5 * length if turns >= HARD else length
        self.ended = f"{points} points"
        return self

    def cycle(self, place: Place) -> LimitCycle:
        """The `LimitCycle` of a place."""
        truncation, aliasing = place.left_out or self.path.left_out(place)
        return LimitCycle(self.path.contact(place.value), in_phase(place.orbit), self.path.flexibility, place.residual,
                          truncation, aliasing, stability=self.stability)

    def _keep(self, place: Place, cycle: LimitCycle) -> None:
        self.values.append(place.value)
        self.cycles.append(cycle)

    def _angle(self, old: Place, new: Place) -> float:
        if new.orbit.harmonics != old.orbit.harmonics:
            old = self.path.resized(old, new.orbit.harmonics)
        return float(old.tangent @ new.tangent)

    def _over(self, old: Place, new: Place, first: Place) -> str:
        """Why the branch ends at a new place; empty if it does not."""
        lo, hi = self.limits
        if not lo <= new.value <= hi:
            return f"the range ends at {self.path.parameter} = {lo if new.value < lo else hi:.6g}"
        kept = min(old.orbit.harmonics, new.orbit.harmonics)
        if np.vdot(old.orbit.v[:kept], new.orbit.v[:kept]).real <= 0:
            return f"back at steady sliding, a Hopf point near {self.path.parameter} = {(old.value + new.value) / 2:.6g}"
        if len(self.values) > 8:
            big = self.path.resized(first, new.orbit.harmonics)
            last = old.orbit.with_harmonics(new.orbit.harmonics)
            here, there, before = (self.path.scaled(orbit, value) for orbit, value in (
                (new.orbit, new.value), (big.orbit, big.value), (last, old.value)))
            if np.linalg.norm(here - there) < 0.6 * np.linalg.norm(here - before):
                return "the branch is closed"
        return ""

    def _last(self, beyond: Place) -> None:
        """The cycle exactly at the end of the range."""
        lo, hi = self.limits
        if lo <= beyond.value <= hi:
            return
        try:
            place = self.path.at_value(beyond.orbit, beyond.value, lo if beyond.value < lo else hi)
        except NotConvergedError:
            return
        self._keep(place, self.cycle(place))

    def _key(self, place: Place, cycle: LimitCycle) -> tuple[bool, int]:
        return place.direction > 0, 0 if cycle.floquet is None else cycle.floquet.unstable

    def _scan(self, a: Place, one: LimitCycle, b: Place, two: LimitCycle, length: float, halvings: int) -> None:
        if self._key(a, one) == self._key(b, two):
            return
        if halvings:
            try:
                middle, _ = self.path.step(a, self.direction * length / 2)
            except NotConvergedError:
                halvings = 0
            else:
                between = self.cycle(middle)
                self._scan(a, one, middle, between, length / 2, halvings - 1)
                self._scan(middle, between, b, two, length / 2, halvings - 1)
                return
        point = self._named(a, one, b, two)
        if point is not None and not self._told(point):
            self.special.append(point)

    def _told(self, point: SpecialPoint) -> bool:
        """Whether the point repeats a known one: a fold is also detected as a multiplier crossing +1 nearby."""
        near = [other for other in self.special if {other.kind, point.kind} == {"fold", "branch point"}
                and abs(other.value - point.value) <= BESIDE * self.path.scales[2]]
        if point.kind == "fold":
            self.special = [other for other in self.special if other not in near]
            return False
        return bool(near)

    def _named(self, a: Place, one: LimitCycle, b: Place, two: LimitCycle) -> SpecialPoint | None:
        fold = (a.direction > 0) != (b.direction > 0)
        share = a.direction / (a.direction - b.direction) if fold else 0.5
        critical = 1 + 0j
        if not fold:
            if max(one.peak, two.peak) < YOUNG * self.path.scales[0]:
                return None
            assert one.floquet is not None and two.floquet is not None
            critical, sizes = _passing(one, two)
            if sizes[0] != sizes[1]:
                share = float(np.clip((1 - sizes[0]) / (sizes[1] - sizes[0]), 0, 1))
        kind = "fold" if fold else _kind(critical)
        return SpecialPoint(kind, a.value + share * (b.value - a.value), one.omega + share * (two.omega - one.omega),
                            one.rms + share * (two.rms - one.rms), critical)


def _passing(one: LimitCycle, two: LimitCycle) -> tuple[complex, tuple[float, float]]:
    """The multiplier that passes the unit circle between two neighbours, and its size at both."""
    assert one.floquet is not None and two.floquet is not None
    before, after = one.floquet.values[:12], two.floquet.values[:12]
    best: tuple[float, complex, tuple[float, float]] = (np.inf, 1 + 0j, (1.0, 1.0))
    for value in after:
        near = before[np.argmin(np.abs(before - value))]
        crossing = (abs(value) - 1) * (abs(near) - 1) <= 0
        distance = abs(abs(value) - 1) + abs(abs(near) - 1) + (0.0 if crossing else 1.0)
        if distance < best[0]:
            best = (distance, complex((value + near) / 2), (float(abs(near)), float(abs(value))))
    return best[1], best[2]


def _kind(multiplier: complex) -> str:
    if abs(multiplier.imag) > 2e-2 * abs(multiplier):
        return "Neimark-Sacker"
    return "branch point" if multiplier.real > 0 else "period doubling"
