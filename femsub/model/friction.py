"""Friction laws μ(v) with their slopes μ'(v), and the belt that brings one of them to a port.

The sign, once and for all: the belt drags the mass along, so the friction force acts on the right-hand side,
M ẍ + P ẋ + Q x = w F μ(v0 - wᵀẋ). Linearised about steady sliding this is **D = P + F μ'(v0) w wᵀ**, and a
falling characteristic (μ' < 0) takes damping away. The paper's eq. (1) read literally has the opposite sign, with
which its own Fig. 4 could not be unstable.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Protocol, Self

import numpy as np

from femsub.checks import EPS, Array, Matrix, finite_number, shown, word
from femsub.errors import InputError, InputTypeError
from femsub.model.pencil import contact_damping

Scalar = Callable[[float], float]
NARROWEST = 1e-100  # ε
STICKING = 3.0  # times ε: sliding slower counts as sticking; the arctan law has reached 80 % of its plateau there
SLOPE_AGREES = 0.01  # relative difference of a law's slope and that of its values that is let pass


class FrictionLaw(Protocol):
    """μ(v) of the sliding speed v, and the rules for a law of your own.

    A law has `value` and `slope`; make it a frozen dataclass, so that it can be compared, changed by `replace` and pickled.

    ===========================  ==========================================================================================
    value(v), slope(v)           μ and μ' = dμ/dv of a float or an array, in its shape. μ' must be that of μ: `Belt` compares
                                 them at its speed. At a jump of μ', the mean of both sides.
    eps, a number above 0        the width of the transition from sticking to sliding, as a speed: |v0 - v| ≤ 3 ε counts as
                                 sticking. Harmonic balance begins with larger ones, ``replace(law, eps=...)``. Without it, it
                                 begins with the law itself, and what sticks is unknown.
    scalar()                     (μ, μ') as functions of one float, where those are quicker: for integrators
    with_slope(slope, speed)     the law with another μ'(speed), which branches over the slope vary; refused without
    label                        what figures call it; by default its key
    ===========================  ==========================================================================================

    Only the first line is needed. A law that stands in `LAWS` is known to scenes by its key there, and is made with their ε as
    ``LAWS[key](eps=...)``.
    """

    def value(self, v: Any) -> Any: ...

    def slope(self, v: Any) -> Any: ...


@dataclass(frozen=True)
class StribeckArctan:
    """μ(v) = c (2/π) arctan(v/ε) + d exp(-r|v|), the law as the paper prints it (its eq. (7)).

    With c = 0.3, d = 0.2, r = 2. It is not odd: μ(0) = d, so that the friction force does not vanish with the
    sliding speed; `StribeckArctanOdd` is the odd law next to it.

    Parameters
    ----------
    eps : float
        Width ε of the transition from sticking to sliding, in units of speed.
    coulomb, drop, decay : float
        c and d (dimensionless) and r (1/speed).
    """

    eps: float = 1e-3
    coulomb: float = 0.3
    drop: float = 0.2
    decay: float = 2.0

    label: ClassVar[str] = "as printed, eq. (7)"

    def __post_init__(self) -> None:
        for name in ("eps", "coulomb", "drop", "decay"):
            finite_number(name, getattr(self, name))
        if self.eps < NARROWEST:
            raise InputError(f"eps must be positive, and at least {NARROWEST:g}, not {self.eps!r}: it is the width of the "
                             "stick-slip transition")

    def value(self, v: Any) -> Any:
        """μ(v)."""
        return self.coulomb * 2 / np.pi * np.arctan(v / self.eps) + self.drop * np.exp(-self.decay * np.abs(v))

    def slope(self, v: Any) -> Any:
        """μ'(v) = c (2/π) ε/(ε² + v²) - d r sign(v) exp(-r|v|); at v = 0 the mean of both sides."""
        rise = self.coulomb * 2 / np.pi / self.eps / (1 + np.square(v / self.eps))
        return rise - self.drop * self.decay * np.sign(v) * np.exp(-self.decay * np.abs(v))

    def scalar(self) -> tuple[Scalar, Scalar]:
        """μ and μ' for one Python float, ten times faster than through NumPy: for integrators, which ask one at a time."""
        c, eps, drop, decay, atan, exp = self.coulomb * 2 / math.pi, self.eps, self.drop, self.decay, math.atan, math.exp

        def value(v: float) -> float:
            return c * atan(v / eps) + drop * exp(-decay * abs(v))

        def slope(v: float) -> float:
            fall = drop * decay * exp(-decay * abs(v)) if v else 0.0
            ratio = v / eps
            return c / eps / (1 + ratio * ratio) - math.copysign(fall, v)

        return value, slope

    def with_slope(self, slope: float, speed: float) -> Self:
        """The same law with d chosen so that μ'(speed) = slope; ε, c and r stay. μ' is linear in d.

        Raises
        ------
        InputError
            d has no say in μ' at this speed, as at 0.
        """
        finite_number("slope", slope)
        flat, one = replace(self, drop=0.0), replace(self, drop=1.0)
        base = float(flat.slope(finite_number("speed", speed)))
        gain = float(one.slope(speed)) - base
        if abs(gain) <= 1e-9 * self.decay or speed == 0:
            raise InputError(f"the falling part of the law has no slope at a sliding speed of {speed!r}, so that μ' cannot be "
                             f"made {slope!r} there; choose another speed")
        return replace(self, drop=(slope - base) / gain)


@dataclass(frozen=True)
class StribeckArctanOdd(StribeckArctan):
    """μ(v) = (c + d exp(-r|v|)) (2/π) arctan(v/ε), the odd variant of the paper's eq. (7): μ(-v) = -μ(v)."""

    label: ClassVar[str] = "odd variant"

    def value(self, v: Any) -> Any:
        """μ(v)."""
        return (self.coulomb + self.drop * np.exp(-self.decay * np.abs(v))) * 2 / np.pi * np.arctan(v / self.eps)

    def slope(self, v: Any) -> Any:
        """μ'(v), even in v and smooth."""
        level = self.coulomb + self.drop * np.exp(-self.decay * np.abs(v))
        fall = self.drop * self.decay * np.exp(-self.decay * np.abs(v)) * np.arctan(np.abs(v) / self.eps)
        return 2 / np.pi * (level / self.eps / (1 + np.square(v / self.eps)) - fall)

    def scalar(self) -> tuple[Scalar, Scalar]:
        """μ and μ' for one Python float."""
        two, c, eps, drop, decay, atan, exp = (2 / math.pi, self.coulomb, self.eps, self.drop, self.decay, math.atan, math.exp)

        def value(v: float) -> float:
            return (c + drop * exp(-decay * abs(v))) * two * atan(v / eps)

        def slope(v: float) -> float:
            more = drop * exp(-decay * abs(v))
            return two * ((c + more) / eps / (1 + (v / eps) * (v / eps)) - decay * more * atan(abs(v) / eps))

        return value, slope


#: The laws that scenes know by their keys; one of your own is added with LAWS["my-law"] = MyLaw.
LAWS: dict[str, Callable[..., FrictionLaw]] = {"stribeck-arctan": StribeckArctan, "stribeck-arctan-odd": StribeckArctanOdd}


def scalar_law(law: FrictionLaw) -> tuple[Scalar, Scalar]:
    """μ and μ' of any law for one float: its own `scalar()` if it has one."""
    if callable(own := getattr(law, "scalar", None)):
        return own()
    return lambda v: float(law.value(v)), lambda v: float(law.slope(v))


def width_of(law: Any) -> float:
    """ε of a law; NaN where it has none."""
    eps = getattr(law, "eps", None)
    usable = isinstance(eps, (int, float, np.integer, np.floating)) and not isinstance(eps, bool) and 0 < eps < np.inf
    return float(eps) if usable else np.nan  # type: ignore[arg-type]


def with_slope(law: Any, slope: float, speed: float) -> Any:
    """The law with another μ'(speed); an InputError for one that has no `with_slope`."""
    if not callable(getattr(law, "with_slope", None)):
        raise InputError(f"the slope cannot be varied: {type(law).__name__} has no with_slope(slope, speed)")
    return law.with_slope(slope, speed)


class SlopeOfLaw(float):
    """μ'(v0) that a belt has taken from its law: beside a law it is taken anew, where another number must be that of the law."""


@dataclass(frozen=True)
class Belt:
    """A belt sliding at speed v0 under a normal force F on a port w: D = P + F μ'(v0) w wᵀ.

    A changed copy, such as ``dataclasses.replace(belt, speed=0.3)``, takes the slope anew from the law. A slope that was given
    stays, and must still be that of the law, if there is one.

    Parameters
    ----------
    port : str
        The port it acts on.
    force : float
        Normal force F, not negative.
    speed : float, optional
        Belt speed v0; needed with a `law`.
    law : FrictionLaw, optional
        Gives μ'(v0).
    slope : float, optional
        μ'(v0) itself, instead of a law. Negative destabilises.

    Raises
    ------
    InputError
        Neither `law` nor `slope`, both in contradiction, a law without a speed, a negative force, NaN.
    """

    port: str = "belt"
    force: float = 1.0
    speed: float | None = None
    law: FrictionLaw | None = None
    slope: float | None = None

    def __post_init__(self) -> None:
        word("port", self.port)
        finite_number("force", self.force)
        if self.force < 0:
            raise InputError(f"force must not be negative, but is {self.force!r}: the belt presses, it does not pull")
        if self.speed is not None:
            finite_number("speed", self.speed)
        if self.law is None and self.slope is None:
            raise InputError("a belt needs a friction law with the belt's speed, or a slope: Belt(slope=-0.2677)")
        if self.law is not None:
            if not callable(getattr(self.law, "slope", None)) or not callable(getattr(self.law, "value", None)):
                raise InputTypeError("law must be a friction law with value(v) and slope(v), e.g. StribeckArctan(eps=1e-3), not "
                                     f"{shown(self.law)}")
            if self.speed is None:
                raise InputError("a belt with a friction law needs its speed, e.g. Belt(speed=0.1911, law=...)")
            slope = _consistent_slope(self.law, self.speed)
            if self.slope is None or isinstance(self.slope, SlopeOfLaw):
                object.__setattr__(self, "slope", SlopeOfLaw(slope))
            elif finite_number("slope", self.slope) != slope:
                raise InputError(f"slope={shown(self.slope)} contradicts the law, whose slope at {self.speed!r} is {slope!r}")
        finite_number("slope", self.slope)

    def damping(self, w: Array) -> Matrix:
        """F μ'(v0) w wᵀ, sparse, shape (n, n), for a port w of shape (n,) or (n, p)."""
        return contact_damping(w, self.force * self.slope)  # type: ignore[operator]

    def sticks(self, v: Any, multiple: float = STICKING, below: float | None = None) -> Any:
        """Where |v0 - v| ≤ multiple · ε of the law, or ≤ `below`, with v the speed under the belt; bool, in the shape of v.

        Raises
        ------
        InputError
            The law has no ε, and `below` is not given.
        """
        limit = finite_number("multiple", multiple) * width_of(self.law) if below is None else finite_number("below", below)
        if np.isnan(limit):
            raise InputError(f"the friction law on {self.port!r} has no eps; say by `below` what counts as sticking")
        return np.abs(self.speed - np.asarray(v)) <= limit


def _consistent_slope(law: FrictionLaw, speed: float) -> float:
    """μ'(v0) of a law, compared with differences of its values μ(v0 ± h) over several steps h."""
    slope = float(law.slope(speed))
    if speed == 0 or not np.isfinite(slope):
        return finite_number("the slope of the law at the belt's speed", slope)
    steps = abs(speed) * 10.0 ** -np.arange(2.0, 8.0)
    ahead, behind = (np.array([float(law.value(speed + sign * h)) for h in steps]) for sign in (1.0, -1.0))
    found = (ahead - behind) / (2 * steps)
    rounding = 8 * EPS * (np.abs(ahead) + np.abs(behind)) / steps
    if (np.abs(found - slope) > SLOPE_AGREES * np.maximum(np.abs(found), abs(slope)) + rounding).all():
        raise InputError(f"the law's slope at the speed {speed:g} is {slope:.6g}, but its values rise by "
                         f"{found[len(found) // 2]:.6g} per unit of speed there: value and slope contradict each other")
    return slope
