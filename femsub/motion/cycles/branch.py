"""Branches of limit cycles over a parameter of a contact, such as a belt's speed, with their special points.

A branch begins at a Hopf point, where steady sliding loses its stability, or at a known cycle. The Floquet multipliers show
which cycles are stable, and how stability changes. At a fold one multiplier passes +1, and the branch turns back. At a period
doubling a multiplier passes -1. At a Neimark-Sacker point a pair leaves the unit circle, and quasi-periodic motion begins.

The key of a cycle is the sign of dp/ds and the number of multipliers outside the unit circle. If it changes between two
neighbours, the step between them is halved until the change is located. The multiplier that passes the circle gives the
point its name.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from femsub.checks import (
    Array,
    InputError,
    NoCycleError,
    NotConvergedError,
    choice,
    finite_number,
    listener,
    positive_number,
    truth,
    whole_number,
)
from femsub.coupling import Belt
from femsub.model import Contact, Substructure, fields_of
from femsub.motion.cycles.balance import Orbit, in_phase
from femsub.motion.cycles.branch_chart import bifurcation_chart
from femsub.motion.cycles.continuation import Path, Place, with_parameter
from femsub.motion.cycles.hopf import HopfPoint, begun, hopf_point, limits_of
from femsub.motion.cycles.limit_cycle import LimitCycle, flexibility_of
from femsub.motion.nonlinear_model import sliding
from femsub.output import Chart, Displayed, Table, column


@dataclass(frozen=True)
class SpecialPoint:
    """A named point of a branch: 'fold', 'period doubling', 'Neimark-Sacker' or 'branch point' (+1 without a fold)."""

    kind: str
    value: float
    omega: float
    rms: float
    multiplier: complex


@dataclass(frozen=True, eq=False, repr=False)
class Branch(Displayed):
    """A branch of limit cycles over a parameter of a contact, made by `branch`.

    Attributes
    ----------
    parameter : str
        Such as 'slope', 'speed' or 'force'.
    values : ndarray, shape (m,)
        The parameter at each point.
    points : tuple of LimitCycle, length m
    special : tuple of SpecialPoint
        Folds, period doublings, Neimark-Sacker and branch points.
    hopf : HopfPoint or None
        The beginning of the branch, if it is a Hopf point.
    ended : str
        Why the branch ends where it does.

    Examples
    --------
    >>> import femsub as fs
    >>> belt = fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=2e-2))
    >>> found = fs.branch(fs.chain(5, belt=2), belt, points=3)
    >>> found.parameter, found.hopf.supercritical, found.ended
    ('slope', True, '3 points')
    """

    parameter: str
    values: Array
    points: tuple[LimitCycle, ...]
    special: tuple[SpecialPoint, ...]
    hopf: HopfPoint | None
    ended: str

    @property
    def omega(self) -> Array:
        return np.array([point.omega for point in self.points])

    @property
    def rms(self) -> Array:
        return np.array([point.rms for point in self.points])

    @property
    def peak(self) -> Array:
        return np.array([point.peak for point in self.points])

    @property
    def stable(self) -> tuple[bool | None, ...]:
        return tuple(point.is_stable for point in self.points)

    def at(self, value: float) -> list[LimitCycle]:
        """The points of the branch nearest to a value of the parameter: one for each time that the branch passes the value.

        If the branch passes the value, turns and passes it again within two steps, only one point is listed.
        """
        gap = np.sign(self.values - value)
        size = np.abs(self.values - value)
        passes = np.flatnonzero(gap[1:] * gap[:-1] < 0)  # a point exactly at the value belongs to two steps: treated separately
        near = np.concatenate([np.flatnonzero(gap == 0), np.where(size[passes] <= size[passes + 1], passes, passes + 1)])
        return [self.points[i] for i in np.unique(near)]

    def rows(self) -> list[dict[str, Any]]:
        """One row for each point, for tables."""
        return [{self.parameter: float(value)} | point.row() for value, point in zip(self.values, self.points, strict=True)]

    def record(self) -> dict[str, Any]:
        """The points, the Hopf point, the special points and the end of the branch, for files."""
        hopf = self.hopf and {key: getattr(self.hopf, key) for key in ("value", "omega", "limit", "error", "supercritical")}
        return {"hopf": hopf, "special": [vars(point) for point in self.special], "ended": self.ended, "points": self.rows()}

    def summary(self) -> dict[str, Any]:
        """One row with the numbers of cycles and of stable cycles, and the Hopf point."""
        row: dict[str, Any] = {"cycles": len(self.points), "stable": sum(flag is True for flag in self.stable)}
        if hopf := self.hopf:
            row |= {"begins": hopf.value, "error": hopf.error, "critical": "super" if hopf.supercritical else "sub"}
        return row

    def tables(self) -> list[Table]:
        """A row for each cycle."""
        columns = [column(self.parameter, form=".6g"), "omega", "rms", "peak", "sticking", "is_stable", "harmonics", "truncation"]
        return [Table("branch", self.rows(), columns, f"Limit cycles over the {self.parameter}")]

    def chart(self, title: str = "") -> Chart:
        """The bifurcation diagram: rms of the speed under the belt and ω over the parameter, stable and unstable."""
        family = float(self.hopf.omega if self.hopf is not None else self.omega[0])
        own = {"model": "cycles", "family": family, "branch": self}
        return bifurcation_chart([own], [], self.parameter, [family], None, title)

    def __repr__(self) -> str:
        begin = "" if self.hopf is None or self.hopf.supercritical is None else \
            f" from a {'super' if self.hopf.supercritical else 'sub'}critical Hopf point at {self.hopf.value:.6g}"
        named = ", ".join(f"{point.kind} at {point.value:.5g}" for point in self.special) or "no special points"
        stable = "stability not computed" if all(point.floquet is None for point in self.points) else \
            f"{sum(flag is True for flag in self.stable)} stable"
        return (f"Branch: {len(self.points)} cycles over the {self.parameter} {self.values.min():.5g} to {self.values.max():.5g}"
                f"{begin}; {stable}; {named}; {self.ended}")


def branch(model: Substructure, contacts: Contact | Sequence[Contact], parameter: str = "slope",
           between: tuple[float, float] | None = None, *, start: float | LimitCycle | None = None, port: str | None = None,
           points: int = 150, harmonics: int = 400, tol: float = 1e-3, stability: bool = True,
           progress: Callable[[str], None] | None = None) -> Branch:
    """Follow a branch of limit cycles over a parameter of a contact, from a Hopf point or a known cycle on.

    The unknowns are those of `harmonic_balance`; the branch is followed by pseudo-arclength continuation.

    Parameters
    ----------
    model, contacts : as for `harmonic_balance`
    parameter : str
        A numerical field of one of the contacts; for a belt 'slope', 'speed' or 'force'. The slope is μ' at the belt's speed,
        varied by the falling part of the law (`StribeckArctan.with_slope`).
    between : (lo, hi), optional
        Range of the parameter, on one side of 0. The branch ends where it leaves the range, which must contain the Hopf point.
        Default: a fifth to five times the slope or force of the Hopf point, or of the belt's speed. From a cycle, a fifth to five
        times the present value.
    start : float or LimitCycle, optional
        Default: the first Hopf point, from `critical_slope`. A frequency: the Hopf point nearest to it. A cycle of this
        model under these contacts: the branch is followed from it in both directions.
    port : str, optional
        A port of the contact that is varied; by default the first contact with the parameter. Other contacts do not change.
    points : int
        Largest number of cycles.
    harmonics : int
        Largest number of harmonics.
    tol : float
        Largest effect of the neglected harmonics, relative to the cycle; above it more harmonics are used.
    stability : bool
        Whether to compute multipliers (for models of up to 2,000 DOF), which special points other than folds need. The cycles of
        the branch have the same `stability`.
    progress : callable, optional
        Called now and then with a line of text.

    Returns
    -------
    Branch

    Raises
    ------
    InputError
        No Hopf point (stability is never lost, or not within `between`); several pairs that cross together at the Hopf point, so
        that several branches begin there; an unknown parameter or port; zero force; a cycle with another number of contact
        columns.
    NotConvergedError
        The first cycles were not found.

    References
    ----------
    M. Krack, J. Gross, Harmonic Balance for Nonlinear Vibration Problems, Springer (2019), ch. 4.

    Examples
    --------
    >>> import femsub as fs
    >>> belt = fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=2e-2))
    >>> found = fs.branch(fs.chain(5, belt=2), belt, points=3)
    >>> print(found.stable)
    (True, True, True)
    """
    contact = sliding(model, contacts, "a branch of limit cycles")
    # the place of the contact whose parameter is varied
    known = [[name for name in fields_of(one) if isinstance(getattr(one, name), (int, float))] for one in contact.contacts]
    choice("parameter", parameter, sorted({name for own in known for name in own}))
    having = [place for place, own in enumerate(known) if parameter in own]
    ports = {name: place for place in reversed(having) for name in contact.contacts[place].ports}
    at = having[0] if port is None else ports[choice(f"port of a contact with a {parameter}", port, ports)]
    whole_number("points", points, least=1)
    whole_number("harmonics", harmonics, least=1)
    truth("stability", stability)
    if not 0 < finite_number("tol", tol) < 1:
        raise InputError(f"tol must lie between 0 and 1, such as 1e-3, not {tol!r}")
    one = contact.contacts[at]
    value = float(getattr(one, parameter))
    if isinstance(one, Belt) and parameter != "speed" and not one.speed:
        raise InputError("the belt is at rest and supplies no energy. Give it a speed")
    if isinstance(one, Belt) and parameter != "force" and one.force == 0:
        raise InputError("the normal force is zero, so nothing excites the model. Give the belt a force")
    with_parameter(one, parameter, value)  # raises an error for a law without `with_slope`
    flexibility = flexibility_of(contact, start)
    report = listener("progress", progress)
    hopf = shape = None
    walks = [(1.0, points)]
    if isinstance(start, LimitCycle):
        limits, orbit = limits_of(between, parameter, value, one), start.orbit
        walks = [(-1.0, points // 2), (1.0, points // 2)]
    else:
        near = None if start is None else positive_number("start (a frequency, if it is no LimitCycle)", start)
        if len(contact.contacts) > 1 or not isinstance(one, Belt):
            raise InputError("with several contacts, or one that is no belt, a branch must begin at a known cycle. Give start=, "
                             "a cycle from fs.harmonic_balance")
        hopf, shape = hopf_point(contact, flexibility, parameter, between, near)
        limits = limits_of(between, parameter, hopf.value, one)
        if not limits[0] <= hopf.value <= limits[1]:
            raise NoCycleError(f"the Hopf point at {parameter} = {hopf.value:.6g} (ω = {hopf.omega:.5g}), where the branch begins"
                               f", is not within between=({limits[0]:g}, {limits[1]:g}). Widen between=, or start from a cycle "
                               "there (start=cycle)")
        orbit = Orbit(shape[None, :], hopf.omega)
    speed = float(contact.speeds[contact.blocks[at]].max()) or orbit.norm
    path = Path(contact, flexibility, parameter, at, (speed, orbit.omega, limits[1] - limits[0]), tol, harmonics)
    if hopf is None or shape is None:
        first = path.at_value(orbit.with_harmonics(min(orbit.harmonics, harmonics)), value, value)
    else:
        hopf, first = begun(path, hopf, shape)
    *back, ahead = (Tracer(path, sign, limits, stability).walk(first, most, report) for sign, most in walks)
    found = [*(point for walk in back for point in walk.points[:0:-1]), *ahead.points]
    special = [*(point for walk in back for point in walk.special[::-1]), *ahead.special]
    return Branch(parameter, np.array([point.place.value for point in found]), tuple(point.cycle for point in found),
                  tuple(special), hopf, "; ".join(walk.ended for walk in (*back, ahead)))


class Point(NamedTuple):
    """A place on a path, and its cycle."""

    place: Place
    cycle: LimitCycle

    @property
    def key(self) -> tuple[bool, int]:
        """Whether the parameter increases along the path, and the number of multipliers outside the unit circle."""
        return self.place.direction > 0, 0 if self.cycle.floquet is None else self.cycle.floquet.unstable


class Tracer:
    """One walk along a path, in one direction: the points found, in order, and the reason for its end.

    The scaled steps (see `Path`) begin with `first`, and are at most `longest`. The walk ends if they must be shorter than
    `shortest`. A special point is located by `halvings` halvings of the step across it. Each halving computes one more cycle.
    """

    def __init__(self, path: Path, direction: float, limits: tuple[float, float], stability: bool, *, first: float = 0.01,
                 longest: float = 0.15, shortest: float = 1e-5, halvings: int = 6) -> None:
        self.path, self.direction, self.limits, self.stability = path, direction, limits, stability
        self.first, self.longest, self.shortest, self.halvings = first, longest, shortest, halvings
        self.points: list[Point] = []
        self.special: list[SpecialPoint] = []
        self.ended = ""

    def walk(self, first: Place, most: int, report: Callable[[str], None]) -> Tracer:
        """Walk from `first` to the end of the range or of the branch, or up to `most` points."""
        self.points.append(self.point(first))
        length = self.first
        while not self.ended:
            last = self.points[-1]
            if len(self.points) >= most:
                self.ended = f"{most} points"
                break
            where = f"{self.path.parameter} = {last.place.value:.6g}"
            report(f"branch: {len(self.points)} cycles, {where}")
            try:
                found, turns = self.path.step(last.place, self.direction * length)
                # the tangents of neighbours differ by 32° at most
                if self.path.resized(last.place, found.orbit.harmonics).tangent @ found.tangent < 0.85:
                    raise NotConvergedError("the branch turns too sharply for this step")
            except NotConvergedError as error:
                length /= 2
                if length < self.shortest:
                    self.ended = f"the steps became too small at {where}: {error}"
                continue
            self.ended = self._over(last.place, found)
            if not self.ended:
                self.points.append(self.point(found))
                self._scan(last, self.points[-1], length, self.halvings)
                # after few Newton steps the next step may be longer; many mean that this step was too long
                length = min(self.longest, 1.5 * length) if turns <= 4 else 0.5 * length if turns >= 8 else length
        return self

    def point(self, place: Place) -> Point:
        """The point at a place."""
        truncation, aliasing = place.left_out or self.path.left_out(place)
        return Point(place, LimitCycle(self.path.contact(place.value), in_phase(place.orbit), self.path.flexibility,
                                       place.residual, truncation, aliasing, stability=self.stability))

    def _over(self, old: Place, new: Place) -> str:
        """The reason why the branch ends at a new place, or ''. At the end of the range, the cycle exactly there is added."""
        edge = float(np.clip(new.value, *self.limits))
        if new.value != edge:
            with suppress(NotConvergedError):
                self.points.append(self.point(self.path.at_value(new.orbit, new.value, edge)))
            return f"the range ends at {self.path.parameter} = {edge:.6g}"
        here, there, before = (replace(place, orbit=place.orbit.with_harmonics(new.orbit.harmonics))
                               for place in (new, self.points[0].place, old))
        if np.vdot(before.orbit.v, here.orbit.v).real <= 0:
            return f"back at steady sliding, a Hopf point near {self.path.parameter} = {(old.value + new.value) / 2:.6g}"
        x, begin, last = (self.path.scaled(place.orbit, place.value) for place in (here, there, before))
        if len(self.points) > 8 and np.linalg.norm(x - begin) < 0.6 * np.linalg.norm(x - last):
            return "the branch is closed"
        return ""

    def _scan(self, a: Point, b: Point, length: float, halvings: int) -> None:
        """Locate and name the special point between two points with different keys, by halving the step between them."""
        if a.key == b.key:
            return
        if halvings:
            with suppress(NotConvergedError):
                middle = self.point(self.path.step(a.place, self.direction * length / 2)[0])
                self._scan(a, middle, length / 2, halvings - 1)
                self._scan(middle, b, length / 2, halvings - 1)
                return
        critical, kind, ends = 1 + 0j, "fold", (a.place.direction, b.place.direction)
        if (ends[0] > 0) == (ends[1] > 0):
            # in a cycle so small compared with the belt's speed, the multiplier of the amplitude is 1 within its error
            if max(a.cycle.peak, b.cycle.peak) < 0.02 * self.path.scales[0]:
                return
            # the multiplier that passes the unit circle between the two, and its distance from the circle at both
            assert a.cycle.floquet is not None and b.cycle.floquet is not None
            before, after = a.cycle.floquet.values[:12], b.cycle.floquet.values[:12]
            before = before[np.argmin(np.abs(np.subtract.outer(after, before)), axis=1)]
            gaps = np.abs(before) - 1, np.abs(after) - 1
            at = int(np.argmin(np.abs(gaps[0]) + np.abs(gaps[1]) + (gaps[0] * gaps[1] > 0)))
            critical, ends = complex((before[at] + after[at]) / 2), (float(gaps[0][at]), float(gaps[1][at]))
            # within a degree of the real axis it counts as real
            kind = "Neimark-Sacker" if abs(critical.imag) > 2e-2 * abs(critical) else \
                "branch point" if critical.real > 0 else "period doubling"
        share = float(np.clip(ends[0] / (ends[0] - ends[1]), 0, 1)) if ends[0] != ends[1] else 0.5
        value, omega, rms = (x + share * (y - x) for x, y in ((a.place.value, b.place.value), (a.cycle.omega, b.cycle.omega),
                                                              (a.cycle.rms, b.cycle.rms)))
        point = SpecialPoint(kind, value, omega, rms, critical)
        # A fold is also detected as a multiplier that crosses +1: within 0.002 of the parameter's range it is 1 within its error.
        near = [other for other in self.special if {other.kind, point.kind} == {"fold", "branch point"}
                and abs(other.value - point.value) <= 0.002 * self.path.scales[2]]
        if point.kind == "fold":
            self.special = [other for other in self.special if other not in near]
        if point.kind == "fold" or not near:
            self.special.append(point)
