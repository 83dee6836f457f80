"""The fewest modes with which a model of one part, or of joined parts, meets a tolerance.

A reference contains the reduced models with any number of modes, and estimates the error of each. More modes are computed until
the largest of these models meets the tolerance. The first model tried for joined parts follows from the amplitudes of their
modes: leaving out the mode j of a part raises the system's frequency ω_i, to first order and relatively, by

    η_ij² (θ_j - ω_i²) / (2ω_i²),

with θ_j the square of the mode's own frequency and η_ij its amplitude in the system's mode i of unit modal mass.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from femsub.algebra import WIDE
from femsub.checks import Array, InputError, NotConvergedError, check_band, finite_number
from femsub.model import SHARE, Estimate, Pencil, beyond
from femsub.reduction.basis import Kept, Statics
from femsub.reduction.estimates.found_modes import FoundModes, Span
from femsub.reduction.estimates.leaving_out import LeavingOut
from femsub.reduction.estimates.nested import Nested

Best: TypeAlias = tuple[Array, Estimate]  # numbers of modes, one for each part, and the estimate of the model they make


@dataclass(frozen=True)
class Goal:
    """The band, and the largest relative error of a model in it."""

    band: tuple[float, float]
    tol: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "band", check_band(self.band))
        if not 0 < finite_number("tol", self.tol) < 1:
            raise InputError(f"tol is a relative error between 0 and 1, not {self.tol!r}")


class Space:
    """The modes of one part found so far, and the reference made of them. `JoinedSpace` is the subclass for a system.

    ω and |λ| beyond twice `top` are not computed if that saves time. `given` holds the numbers of modes that are prescribed.
    """

    enough = 1.0  #: the error of the largest model must be below this share of the tolerance before a smaller model is chosen

    def __init__(self, name: str, parts: Mapping[str, FoundModes], top: float = np.inf,
                 given: Mapping[str, int] = MappingProxyType({})) -> None:
        self.name, self.parts, self.limit = name, parts, 2 * top
        self.given = np.array([given.get(part, -1) for part in parts])
        for part, count in given.items():
            parts[part].grow(count + 1)

    @classmethod
    def of(cls, statics: Statics, pencil: Pencil | None, top: float) -> Space:
        """The space of one part. `pencil` has its damping; with damping, λ must be within the tolerance, too."""
        name = statics.part.sub.name
        return cls(repr(name), {name: FoundModes(statics, pencil)}, top)

    @property
    def spent(self) -> bool:
        return all(part.spent for part in self.parts.values())

    @property
    def most(self) -> Array:
        """The largest number of modes of each part that a model may have."""
        return np.where(self.given >= 0, self.given, [part.most for part in self.parts.values()])

    def least(self, reference: Nested, hi: float) -> Array:
        """Number of modes of each part in the band, or so little above it that the cut-off must be higher than they are."""
        inside = ~beyond(reference.share * np.sqrt(reference.values), hi)
        counts = [np.count_nonzero(part) for part in np.split(inside, np.cumsum(reference.most)[:-1])]
        return np.where(self.given >= 0, self.given, counts)

    def reach(self, hi: float) -> None:
        """Compute the modes of each part that a band may need, up to `hi`."""
        for part in self.parts.values():
            part.reach(hi / SHARE)

    def best(self, goal: Goal) -> Best | None:
        """The fewest modes that meet the tolerance. None if more modes are needed than were found; these are then computed."""
        band, tol = goal.band, goal.tol
        given = self.reference()
        reference, most = given.nested, self.most
        largest = reference.estimate(most, band, tol, False)
        good = largest.met and largest.worst <= (tol if self.spent else self.enough * tol)
        if good and reference.D is not None:
            reference = self.extended(given, band)
            largest = reference.estimate(most, band, tol)
            good = largest.met
        if good:
            return fewest(reference, self.least(reference, band[1]), (most, largest))
        self.further(reference, largest)
        return None

    def reference(self) -> ReferenceModel:
        """The reference with all modes found."""
        return self.assembled({name: part.nested() for name, part in self.parts.items()})

    def assembled(self, own: Mapping[str, tuple[Nested, Span]]) -> ReferenceModel:
        """The reference, from the references of the parts."""
        ((name, (nested, _)),) = own.items()
        found = replace(nested, limit=self.limit if len(nested.M) > WIDE else np.inf)
        return ReferenceModel(found, own, {name: np.eye(len(nested.M))})

    def extended(self, given: ReferenceModel, band: tuple[float, float]) -> Nested:
        """The reference with the static responses to the residuals of the complex modes in the band."""
        sides, own = sides_of(given.nested, band), {}
        for name, part in self.parts.items():
            span, turn = given.own[name][1], given.turns[name]
            own[name] = part.nested(part.residuals(span, [(value, turn @ x, left) for value, x, left in sides]))
        return self.assembled(own).nested

    def further(self, reference: Nested, best: Estimate) -> None:
        """Compute more modes of each part, since the best model does not meet the tolerance.

        Raises
        ------
        NotConvergedError
            There are no more modes; large parts have used 1000 of them; or rounding alone exceeds the tolerance.
        """
        floor = reference.floor(best.band, len(best.eigenvalues) > 0)
        if self.spent or floor > best.tol:
            complete = all(part.complete for part in self.parts.values())
            bare = complete and reference.D is not None and any(
                part.statics.handle.finite < part.statics.handle.K.shape[0] for part in self.parts.values())
            named = ", ".join(repr(name) for name, count in zip(self.parts, self.given, strict=True) if count >= 0)
            rounding = f". Rounding alone causes {floor:.1e}" if floor > best.tol else ""
            raise NotConvergedError(
                f"{self.name} cannot be reduced to a relative error of {best.tol:g} from {best.band[0]:.5g} to "
                f"{best.band[1]:.5g} rad/time. With {'all' if complete else best.modes} modes: {best!r}{rounding}. Lower the "
                f"band, raise tol{f', give more modes to {named}' if named else ''}, put the belt's DOF"
                f"{', and those with damping but no mass,' * bare} into the interface, or call reduce(..., ports=True)")
        self.grow(self.growth(reference, best))

    def grow(self, factor: float) -> None:
        """Compute modes of each part, up to `factor` times their number plus one."""
        for part in self.parts.values():
            part.grow(int(factor * part.modes) + 1)

    def growth(self, reference: Nested, best: Estimate) -> float:
        """The factor by which to increase the number of modes, extrapolated from the decrease of the error."""
        half = reference.estimate(best.modes // 2, best.band, best.tol, damped=False) if best.modes > 1 else best
        factor = 1.5
        if not best.unmatched and np.isfinite(best.worst):
            slope = np.log(max(half.worst, best.worst) / best.worst) / np.log(2.0) if np.isfinite(half.worst) else 4.0
            factor = (best.worst / best.tol) ** (1 / max(slope, 0.5))
        return float(np.clip(1.1 * factor, 1.5, 3.0))

    def counted_in(self, counts: Array) -> dict[str, Kept]:
        """The kept modes of each part, if inertia counts confirm them. Empty if modes had been missed; they are then computed."""
        kept = {name: part.counted_in(count) for (name, part), count in zip(self.parts.items(), counts.tolist(), strict=True)}
        found = {name: one for name, one in kept.items() if one is not None}
        return found if len(found) == len(kept) else {}


@dataclass(frozen=True, eq=False)
class ReferenceModel:
    """The reference x; the references x_p of the parts, with their U; and T_p (R_p, R), x_p = T_p x."""

    nested: Nested
    own: Mapping[str, tuple[Nested, Span]]
    turns: Mapping[str, Array]


def chosen_in(space: Space, goal: Goal) -> Kept:
    """The kept modes of a single part, with the estimate; see `chosen`."""
    kept, estimate = chosen(space, goal)
    (only,) = kept.values()
    return replace(only, estimate=estimate)


def chosen(space: Space, goal: Goal) -> tuple[dict[str, Kept], Estimate]:
    """The kept modes of each part, and the estimate of the model made of them.

    Every ω and λ of the band is within the tolerance, and the band ends below the `share` of the cut-off.

    Raises
    ------
    NotConvergedError
        No model meets the tolerance, even with all modes or 1000 modes of a part.
    """
    space.reach(goal.band[1])
    while True:
        if (best := space.best(goal)) is not None and (kept := space.counted_in(best[0])):
            return kept, best[1]


def fewest(reference: Nested, least: Array, best: Best) -> Best:
    """Few modes in total that meet the tolerance, between `least` and the known `best`, and their estimate."""
    number = len(least)
    if number > 1:
        best = _by_first_order(reference, least, best)
    going, larger = True, None
    while going:
        going = False
        for at in range(number):
            low = least[at]
            if number > 1 and low < best[0][at] and (larger is None or larger.counts is not best[0]):
                larger = LeavingOut.of(reference, *best)
            trial = best[0][at] - 1 if number > 1 else (low + best[0][at]) // 2  # with many parts, one mode less usually fails
            while low < best[0][at]:
                counts = best[0].copy()
                counts[at] = trial
                found = _judged(reference, counts, best[1]) if larger is None or larger.may_meet(counts) else None
                if found is not None and found.met:
                    best, going = (counts, found), number > 1
                else:
                    low = trial + 1
                trial = (low + best[0][at]) // 2
    return best


def _judged(reference: Nested, counts: Array, goal: Estimate) -> Estimate:
    """The estimate. λ are estimated only if ω are within the tolerance, since λ take far longer."""
    found = reference.estimate(counts, goal.band, goal.tol, False)
    return reference.estimate(counts, goal.band, goal.tol) if found.met and reference.D is not None else found


def _by_first_order(reference: Nested, least: Array, best: Best, trials: int = 12) -> Best:
    """A model with few modes in total that meets the tolerance, from the first-order error of leaving out each mode.

    Returns `best` after `trials` choices that do not meet the tolerance.
    """
    (most, largest), tol = best, best[1].tol
    # for each part: the relative first-order error of each frequency of the band if a mode is left out, (modes, k)
    kept, band = reference.rest.start, largest.band
    omega, shapes = reference.lowest(reference.M[:kept, :kept], reference.K[:kept, :kept])
    inside = np.flatnonzero(~beyond(omega, band[1]) & ~beyond(band[0], omega))
    amplitude, square = shapes[kept - reference.modes:, inside], omega[inside] ** 2
    cost = amplitude**2 * np.maximum(reference.values[:, None] - square, 0.0) / (2 * square)
    costs = np.split(cost, np.cumsum(reference.most)[:-1])
    base = reference.estimate(most, largest.band, tol, False).frequency_error.max(initial=0.0)
    allowed = tol
    for _ in range(trials):
        counts = _leanest(costs, least, most, allowed - base)
        found = _judged(reference, counts, largest)
        if found.met:
            return (counts, found) if counts.sum() < most.sum() else best
        allowed *= np.clip(0.95 * tol / found.worst, 0.3, 0.95)
    return best


def _leanest(costs: Sequence[Array], least: Array, most: Array, allowed: float, exchanged: int = 4) -> Array:
    """Numbers of modes, few in total. The summed errors of the modes left out stay within `allowed` for each frequency.

    The mode with the smallest error is removed again and again, from all modes on. Then up to `exchanged` more modes of one part
    are tried in exchange for fewer modes of other parts.
    """
    tails = [np.vstack([np.cumsum(cost[:count][::-1], axis=0)[::-1], np.zeros((1, cost.shape[1]))])
             for cost, count in zip(costs, most, strict=True)]  # for each part: the error without all modes from a number on
    counts = _without_the_cheapest(tails, least, most, allowed)
    going = True
    while going:
        going = False
        for at in range(len(counts)):
            for more in range(1, exchanged + 1):
                trial, floor = counts.copy(), least.copy()
                trial[at] = floor[at] = min(counts[at] + more, most[at])
                trial = _without_the_cheapest(tails, floor, trial, allowed)
                if trial.sum() < counts.sum():
                    counts, going = trial, True
    return counts


def _without_the_cheapest(tails: Sequence[Array], least: Array, counts: Array, allowed: float) -> Array:
    """Repeatedly removes the mode that raises the largest error least, as long as this error stays within `allowed`."""
    counts = counts.copy()
    spent = np.sum([tail[count] for tail, count in zip(tails, counts, strict=True)], axis=0)
    while True:
        trials = {at: spent + tails[at][counts[at] - 1] - tails[at][counts[at]] for at in range(len(counts))
                  if counts[at] > least[at]}
        if not trials:
            return counts
        at = min(trials, key=lambda one: float(trials[one].max(initial=0.0)))
        if trials[at].max(initial=0.0) > allowed:
            return counts
        counts[at], spent = counts[at] - 1, trials[at]


def sides_of(nested: Nested, band: tuple[float, float]) -> list[tuple[Array, Array, bool]]:
    """λ and vectors of unit energy in U of the largest reduced model near the band; also left vectors if D is unsymmetric."""
    values, _, X, Y, _ = nested.damped(nested.most)
    wanted = (values.imag <= 1.1 * band[1]) & (np.abs(values) <= 2 * band[1])
    sides = []
    for value, x, left in ((values, X, False), (values.conj(), Y, True))[:2 - nested.symmetric]:
        value, x = value[wanted], x[:, wanted]
        # kinetic plus elastic energy; scaled by mass alone, a shape without mass would dominate
        kinetic, elastic = (np.abs(np.einsum("ij,ij->j", x.conj(), part @ x)) for part in (nested.M, nested.K))
        sides.append((value, x / np.sqrt(kinetic + elastic / np.abs(value) ** 2), left))
    return sides
