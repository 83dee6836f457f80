"""How many modes each part of a system needs, so that the system's band meets a tolerance with few modes in all.

A part that hardly moves in the band, or that is stiff, takes few modes. Leaving out the mode j of a part raises the system's
frequency ω_i, to first order and relatively, by

    η_ij² (θ_j - ω_i²) / (2ω_i²),

with θ_j the square of the mode's own frequency and η_ij its amplitude in the system's mode i of unit modal mass. These sums
choose. The estimate of the joined model decides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from femsub.checks import Array
from femsub.errors import InputError, NotConvergedError
from femsub.model import beyond
from femsub.modes import lowest_modes
from femsub.reduction.basis import Kept
from femsub.reduction.craig_bampton import CraigBampton
from femsub.reduction.error_bounds import Nested
from femsub.reduction.method import Method
from femsub.reduction.system_estimate import JoinedSearch

if TYPE_CHECKING:
    from femsub.coupling import System
    from femsub.model import Contacts, Estimate, ReducedSubstructure
    from femsub.reduction.statics import Statics

ENOUGH = 0.3  # of the tolerance: the largest model is to leave some choice
EXCHANGED = 4  # modes of one part that are tried at a time in place of those of others
TRIALS = 12  # choices by first order that are tried before all modes are taken


@dataclass(frozen=True)
class Goal:
    """What a system is to be within."""

    band: tuple[float, float]
    tol: float


def common_goal(methods: Mapping[str, Method | ReducedSubstructure]) -> Goal | None:
    """The band and the tolerance that the methods of the parts share, or None where each has a number of modes.

    Raises
    ------
    InputError
        The parts have different ones, or a method whose modes are not those of a system with its interfaces held.
    """
    goals = {name: Goal(method.band, method.tol) for name, method in methods.items()
             if isinstance(method, Method) and method.band is not None and method.tol is not None}
    if not goals:
        return None
    (first, goal), *_ = goals.items()
    for name, other in goals.items():
        if other != goal:
            raise InputError(f"band and tol are those of the system, the same for all parts, but {first!r} has {goal.tol:g} in "
                             f"{goal.band} and {name!r} {other.tol:g} in {other.band}")
    for name, method in methods.items():
        if not (isinstance(method, CraigBampton) and type(method).kept is CraigBampton.kept):
            raise InputError("modes are chosen for the band of a system where its parts are reduced by CraigBampton or Hurty, "
                             f"not by {method} ({name!r}). Give numbers of modes to all parts, and ask fs.system_estimate what "
                             "their reductions cost the system")
    return goal


def chosen_together(system: System, statics: Mapping[str, Statics], given: Mapping[str, int],
                    contacts: Contacts, goal: Goal) -> tuple[dict[str, Kept], Estimate]:
    """The modes kept of each part, and the estimate of the system made of them.

    Parameters
    ----------
    statics : mapping of str to Statics
        Of each part that is reduced.
    given : mapping of str to int
        The number of modes of parts where that is not to be chosen.

    Raises
    ------
    NotConvergedError
        No bases meet the tolerance, even with all modes or 1000 of a part.
    """
    band, tol = goal.band, goal.tol
    search = JoinedSearch(system, statics, contacts, band[1], {name: count + 1 for name, count in given.items()})
    while True:
        nested, space = search.plain()
        most = search.most()
        fixed = np.array([given.get(name, -1) for name in statics])
        most = np.where(fixed >= 0, fixed, most)
        largest = _estimate(nested, most, band, tol, False)
        if not search.exhausted and (not largest.met or (not given and largest.worst > ENOUGH * tol)):
            search.grow(2.0)
            continue
        if largest.met and search.damped:
            nested = search.nested(nested, space, band)
            largest = _estimate(nested, most, band, tol)
        if not largest.met:
            if search.exhausted:
                raise NotConvergedError(_lacking(system, largest, nested, band, tol, given))
            search.grow(2.0)
            continue
        counts, found = fewest(nested, np.where(fixed >= 0, fixed, _below(nested, band[1])), most, band, tol)
        if kept := _counted(search, counts):
            return kept, found


def fewest(nested: Nested, least: Array, most: Array, band: tuple[float, float], tol: float) -> tuple[Array, Estimate]:
    """Few modes in all that meet the tolerance, between `least` and `most` of each part, which meet it; and their estimate."""
    costs = _costs(nested, band)
    base = _estimate(nested, most, band, tol, False).frequency_error.max(initial=0.0)
    allowed, best = tol, (most, _estimate(nested, most, band, tol))
    for _ in range(TRIALS):
        counts = _leanest(costs, least, most, allowed - base)
        found = _estimate(nested, counts, band, tol)
        if found.met:
            if counts.sum() < best[0].sum():
                best = counts, found
            break
        allowed *= np.clip(0.95 * tol / found.worst, 0.3, 0.95)
    return _trimmed(nested, least, best, band, tol)


def _trimmed(nested: Nested, least: Array, best: tuple[Array, Estimate], band: tuple[float, float],
             tol: float) -> tuple[Array, Estimate]:
    """One mode less of each part in turn, as long as the estimate allows it."""
    number, going = len(least), True
    while going:
        going = False
        for at in range(number):
            while best[0][at] > least[at]:
                counts = best[0] - (np.arange(number) == at)
                found = _estimate(nested, counts, band, tol)
                if not found.met:
                    break
                best, going = (counts, found), True
    return best


def _costs(nested: Nested, band: tuple[float, float]) -> list[Array]:
    """Of each part, what leaving out a mode costs each frequency of the band, relatively and to first order, (modes, k)."""
    kept = nested.rest.start
    omega, shapes = nested.lowest(nested.M[:kept, :kept], nested.K[:kept, :kept])
    inside = np.flatnonzero(~beyond(omega, band[1]) & ~beyond(band[0], omega))
    amplitude, square = shapes[kept - nested.modes:, inside], omega[inside] ** 2
    cost = amplitude**2 * np.maximum(nested.values[:, None] - square, 0.0) / (2 * square)
    return np.split(cost, np.cumsum(nested.most)[:-1])


def _leanest(costs: Sequence[Array], least: Array, most: Array, allowed: float) -> Array:
    """Few modes in all whose summed cost stays within what is allowed.

    From all modes on, always the cheapest one goes. Then up to EXCHANGED more of one part are tried against fewer of others.
    """
    tails = [np.vstack([np.cumsum(cost[:count][::-1], axis=0)[::-1], np.zeros((1, cost.shape[1]))])
             for cost, count in zip(costs, most, strict=True)]  # of each part: what all modes from a number on cost
    counts = _without_the_cheapest(tails, least, most, allowed)
    going = True
    while going:
        going = False
        for at in range(len(counts)):
            for more in range(1, EXCHANGED + 1):
                trial, floor = counts.copy(), least.copy()
                trial[at] = floor[at] = min(counts[at] + more, most[at])
                trial = _without_the_cheapest(tails, floor, trial, allowed)
                if trial.sum() < counts.sum():
                    counts, going = trial, True
    return counts


def _without_the_cheapest(tails: Sequence[Array], least: Array, counts: Array, allowed: float) -> Array:
    """Always the mode goes that leaves the smallest largest cost, until that would exceed what is allowed."""
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


def _below(nested: Nested, hi: float) -> Array:
    """How many modes of each part lie in the band: they may be modes of the system, and the cut-off is to lie above it."""
    inside = ~beyond(np.sqrt(nested.values), hi)
    return np.array([int(part.sum()) for part in np.split(inside, np.cumsum(nested.most)[:-1])])


def _estimate(nested: Nested, counts: Array, band: tuple[float, float], tol: float, damped: bool = True) -> Estimate:
    """The estimate of the system; that of λ only where ω are within the tolerance, since it takes far longer."""
    found = replace(nested.estimate(counts, band, tol, False), share=1.0)
    if not damped or nested.D is None or not found.met:
        return found
    return replace(nested.estimate(counts, band, tol), share=1.0)


def _counted(search: JoinedSearch, counts: Array) -> dict[str, Kept]:
    """The modes kept of each part, once the inertia counts them; empty if a mode had been missed, which is then found."""
    kept, missed = {}, False
    for (name, one), count in zip(search.searches.items(), counts.tolist(), strict=True):
        handle, more = one.statics.handle, count < one.most
        found = lowest_modes(handle, count + more, known=one.found, defer=True)
        if not np.array_equal(found.eigenvalues, one.found.eigenvalues[:len(found.eigenvalues)]):
            one.replace(lowest_modes(handle, one.modes, known=found, evidence=False))
            missed = True
        kept[name] = Kept(found, count, float(found.frequencies[-1]) if more else np.inf)
    return {} if missed else kept


def _lacking(system: System, found: Estimate, nested: Nested, band: tuple[float, float], tol: float,
             given: Mapping[str, int]) -> str:
    floor = nested.floor(band)
    rounding = f". Rounding alone causes {floor:.1e}" if floor > tol else ""
    held = f", give more modes to {', '.join(map(repr, given))}" if given else ""
    return (f"the parts of {system.name!r} cannot be reduced to a relative error of {tol:g} from {band[0]:.5g} to {band[1]:.5g} "
            f"rad/time. With {found.modes} modes in all: {found!r}{rounding}. Lower the band, raise tol{held}, put ports into "
            "the interfaces, or call reduce(..., ports=True)")
