"""Hopf points: steady sliding loses its stability as a belt's speed, force or slope changes, and a branch of cycles begins.

`critical_slope` or `critical_value` gives F μ'(v0) = c. The first cycles of the branch, extrapolated to amplitude 0, must agree.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from femsub.checks import Array, InputError, NoCycleError, interval
from femsub.coupling import Belt
from femsub.motion.cycles.balance import Orbit
from femsub.motion.cycles.compliance import Compliance, Fractions
from femsub.motion.cycles.continuation import Path, Place
from femsub.motion.cycles.initial_guess import crossings
from femsub.motion.nonlinear_model import Sliding
from femsub.stability import Crossing, critical_slope
from femsub.stability.critical_value import critical_value


@dataclass(frozen=True)
class HopfPoint:
    """The beginning of a branch: value of the parameter, ω, `coefficient` F μ', and the side on which the cycles exist.

    `limit` contains the parameter and ω of the branch, extrapolated to amplitude 0. `supercritical` is True if cycles exist where
    steady sliding is unstable (a soft onset), and False if they exist where it is stable (a hard onset).
    """

    value: float
    omega: float
    coefficient: float
    limit: tuple[float, float] = (np.nan, np.nan)
    supercritical: bool | None = None

    @property
    def error(self) -> float:
        """The relative difference between `limit` and the linear border, in the parameter or in ω, whichever is larger."""
        return float(max(abs(self.limit[0] / self.value - 1), abs(self.limit[1] / self.omega - 1)))


def hopf_point(contact: Sliding, flexibility: Compliance, parameter: str, between: tuple[float, float] | None,
               near: float | None) -> tuple[HopfPoint, Array]:
    """The Hopf point, at which F μ'(v0) is the critical coefficient, and the speeds of its mode under the belt."""
    belt, model = contact.contacts[0], contact.model
    if not isinstance(flexibility, Fractions) or (near is not None and contact.columns > 1):
        raise InputError(f"a branch that begins at a Hopf point needs at most 2,000 DOF, not {model.size}, and with start= as a "
                         f"frequency a contact of one column, not {contact.columns}. Start from a cycle: start=cycle, found from "
                         "that of a reduced model")
    found: tuple[Crossing, ...] = ()
    if near is None:
        found = critical_slope(model, belt.port).first
        slopes, heights = (np.array([getattr(one, name) for one in found]) for name in ("value", "omega"))
    else:  # the crossings that coincide with the one nearest to that frequency
        heights, slopes = crossings(flexibility, 0.0, np.inf)
        nearest = slopes[np.argmin(np.abs(heights - near))] if len(heights) else np.nan
        together = np.abs(slopes - nearest) <= 1e-6 * abs(nearest)
        heights, slopes = heights[together], slopes[together]
        if len(heights) == 1:  # the loss of stability there, or its regain if a pair ceases to grow, in a narrow band
            band = heights[0] * (1 - 1e-3), heights[0] * (1 + 1e-3)
            found = critical_slope(model, belt.port, band=band).first or critical_value(
                model, Belt(belt.port, slope=0.0), "slope", between=(slopes[0] / 2, 2 * slopes[0]), band=band).regains
    if len(slopes) and slopes[0] == 0:
        raise NoCycleError(f"{model.name!r} has undamped modes under the belt. All of them cross at slope 0, and no single "
                           "branch begins there. Add damping")
    if len(heights) > 1:
        listed = ", ".join(f"{value:.5g}" for value in heights)
        raise NoCycleError(f"{len(heights)} pairs cross together at F μ' = {slopes[0]:.6g} (ω = {listed}), so several branches "
                           "begin at this point. Move the belt away from the damper, or start from a cycle (start=cycle)")
    if not found:
        raise NoCycleError(f"{model.name!r} has no Hopf point: steady sliding is stable at every slope. Damping prevails at "
                           "this place of the belt; move the belt or reduce the damping")
    c, omega, speeds = found[0].value, found[0].omega, contact.W.T @ found[0].shape
    speeds = speeds / speeds[np.argmax(np.abs(speeds))]
    # the value with F μ'(v0) = c; the largest if several belt speeds fulfil this
    if parameter == "slope":
        return HopfPoint(c / belt.force, omega, c), speeds
    if parameter == "force":
        slope = float(belt.slope_at(belt.speed))
        if slope >= 0:
            raise NoCycleError(f"μ' = {slope:.6g} at the belt's speed is not negative, so no normal force makes steady sliding "
                               "unstable. Change the speed or the law")
        return HopfPoint(c / slope, omega, c), speeds
    from scipy.optimize import brentq

    lo, hi = limits_of(between, parameter, belt.speed or 1.0, belt)
    places = np.linspace(lo, hi, 4001)
    excess = belt.force * np.asarray(belt.slope_at(places)) - c
    signs = np.flatnonzero(excess[1:] * excess[:-1] < 0)
    if not len(signs):
        raise NoCycleError(f"no belt speed from {lo:.6g} to {hi:.6g} is a Hopf point: F μ' is never {c:.6g} there. "
                           "Widen between=")
    last = signs[-1] if hi > 0 else signs[0]
    value = brentq(lambda v: belt.force * float(belt.slope_at(v)) - c, places[last], places[last + 1], xtol=1e-15, rtol=1e-15)
    return HopfPoint(float(value), omega, c), speeds


def limits_of(between: tuple[float, float] | None, parameter: str, value: float, belt: Belt) -> tuple[float, float]:
    if between is None:
        now = float(belt.speed or 0.0) if parameter == "speed" else value
        return (0.2 * now, 5 * now) if now > 0 else (5 * now, 0.2 * now)
    lo, hi = interval("between", between)
    if parameter == "force" and lo < 0:
        raise InputError(f"a force must not be negative, but the range between=(lo, hi) begins at {lo!r}")
    if lo < 0 < hi:
        why = "a belt at rest supplies no energy" if parameter == "speed" else "friction that does not fall supplies no energy"
        raise InputError(f"between=({lo:g}, {hi:g}) holds the {parameter} 0, where no branch goes on: {why}. Give a range on one "
                         f"side of 0, such as ({min(0.2 * value, 5 * value):.4g}, {max(0.2 * value, 5 * value):.4g})")
    return lo, hi


def range_around(belt: Belt, parameter: str, coefficient: float) -> tuple[float, float]:
    """The range of a parameter from the Hopf point, where F μ' = `coefficient`, to a quarter beyond the belt's own value.

    For the speed, the range is half to three times the belt's own speed.
    """
    now = float(getattr(belt, parameter))
    if parameter == "speed":
        return min(0.5 * now, 3 * now), max(0.5 * now, 3 * now)
    assert belt.slope is not None
    begins = coefficient / belt.force if parameter == "slope" else coefficient / belt.slope
    last = now + 0.25 * (now - begins)
    ends = begins - 0.02 * (last - begins), last
    return min(ends), max(ends)


def begun(path: Path, hopf: HopfPoint, shape: Array, small: float = 1e-3) -> tuple[HopfPoint, Place]:
    """The Hopf point with the limit of the branch, and the second of two cycles with the amplitudes a and 2a.

    a is the share `small` of the belt's speed. The parameter p and ω are even in a, which gives their limit at a = 0.
    """
    found = []
    column = int(np.argmax(np.abs(shape)))
    for size in (small, 2 * small):
        a = size * path.scales[0]
        orbit = Orbit((0.5 * a * shape)[None, :].astype(complex), hopf.omega).with_harmonics(5)
        row = np.zeros(2 * orbit.v.size + 2)
        row[column] = 1.0
        found.append(path.correct(orbit, hopf.value, row, 0.5 * size)[0])
    (one, two) = found
    limit = ((4 * one.value - two.value) / 3, (4 * one.orbit.omega - two.orbit.omega) / 3)
    belt = path.contact(two.value).contacts[path.at]
    assert belt.slope is not None
    return replace(hopf, limit=limit, supercritical=bool(belt.force * belt.slope < hopf.coefficient)), two
