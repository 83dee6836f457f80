"""Friction laws μ(v) with their slopes μ'(v), and the belt that applies a law at a port.

The sign convention: the belt drags the mass along, so the friction force acts on the right-hand side,
M ẍ + P ẋ + Q x = w F μ(v0 - wᵀẋ). Linearised about steady sliding this gives **D = P + F μ'(v0) w wᵀ**. A falling
characteristic (μ' < 0) reduces the damping. The paper's eq. (1), read literally, has the opposite sign. With that sign,
the system of its Fig. 4 would be stable.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import numpy as np

from femsub.checks import EPS, EQUAL, Array, FemsubError, InputError, InputTypeError, finite_number, real_array, shown, word

if TYPE_CHECKING:
    from femsub.model import Substructure

Scalar = Callable[[float], float]
STICKING = 3.0  # sliding slower than 3 ε counts as sticking: the arctan law reaches 80 % of its plateau there


class FrictionLaw(Protocol):
    """A friction law μ(v) of the sliding speed v. This table is the interface for a law of your own.

    A law has `value` and `slope`. Make it a frozen dataclass, so that it can be compared, changed by `replace` and pickled.

    ===========================  ==========================================================================================
    value(v), slope(v)           μ and μ' = dμ/dv for a float or an array v, in the shape of v. μ' must be the derivative of μ:
                                 `Belt` compares them at its speed. At a jump of μ', return the mean of both sides.
    eps, a number above 0        the width of the transition from sticking to sliding, as a speed: |v0 - v| ≤ 3 ε counts as
                                 sticking. Harmonic balance starts with larger values, ``replace(law, eps=...)``. A law without
                                 eps is used as it is, and sticking cannot be detected.
    scalar()                     (μ, μ') as fast functions of one float, for the integrators
    with_slope(slope, speed)     the law with another μ'(speed), for branches over the slope, which are refused without it
    knots, numbers               speeds at which μ' has a kink or a jump, such as those of a table, for `critical_value`
    label                        the name in figures; by default the key
    ===========================  ==========================================================================================

    Only the first line is required. Scene files refer to a law by its key in `LAWS`; it is created as ``LAWS[key](eps=...)``.
    """

    def value(self, v: Any) -> Any: ...

    def slope(self, v: Any) -> Any: ...


@dataclass(frozen=True)
class StribeckArctan:
    """The Stribeck friction law as the paper prints it: μ(v) = c (2/π) arctan(v/ε) + d exp(-r|v|), with c = 0.3, d = 0.2, r = 2.

    Source: the paper, eq. (7). The law is not odd: μ(0) = d, so the friction force does not vanish at zero sliding speed.
    `StribeckArctanOdd` is the odd variant.

    Parameters
    ----------
    eps : float
        Width ε of the transition from sticking to sliding, in units of speed.
    coulomb, drop, decay : float
        c and d (dimensionless) and r (1/speed).

    Raises
    ------
    InputError, InputTypeError
        An eps that is not positive; a parameter that is not a finite number.

    Examples
    --------
    >>> import femsub as fs
    >>> law = fs.StribeckArctan(eps=1e-3)
    >>> print(f"{law.value(0.2):.4f} {law.slope(0.2):.4f}")
    0.4331 -0.2634
    """

    eps: float = 1e-3
    coulomb: float = 0.3
    drop: float = 0.2
    decay: float = 2.0

    label: ClassVar[str] = "as printed, eq. (7)"
    knots: ClassVar[tuple[float, ...]] = (0.0,)

    def __post_init__(self) -> None:
        for name in ("eps", "coulomb", "drop", "decay"):
            finite_number(name, getattr(self, name))
        narrowest = sys.float_info.min ** (1 / 3)  # above it, the third derivative of the law is a finite number
        if self.eps < narrowest:
            raise InputError(f"eps must be positive, at least {narrowest:.1g}, not {self.eps!r}: it is the width of the "
                             "transition")

    def value(self, v: Any) -> Any:
        """μ(v)."""
        return self._formulas(np.arctan, np.exp, np.sign)[0](v)

    def slope(self, v: Any) -> Any:
        """μ'(v); at v = 0 the mean of both sides."""
        return self._formulas(np.arctan, np.exp, np.sign)[1](v)

    def scalar(self) -> tuple[Scalar, Scalar]:
        """μ and μ' for one Python float: ten times faster than NumPy, for the integrators."""
        return self._formulas(math.atan, math.exp, _sign)

    def _formulas(self, atan: Callable[..., Any], exp: Callable[..., Any],
                  sign: Callable[..., Any]) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
        """μ(v), and μ'(v) = c (2/π) ε/(ε² + v²) - d r sign(v) exp(-r|v|), with functions of NumPy or of floats."""
        c, eps, drop, decay = self.coulomb * 2 / math.pi, self.eps, self.drop, self.decay

        def value(v: Any) -> Any:
            return c * atan(v / eps) + drop * exp(-decay * abs(v))

        def slope(v: Any) -> Any:
            ratio = v / eps
            return c / eps / (1 + ratio * ratio) - sign(v) * drop * decay * exp(-decay * abs(v))

        return value, slope

    def with_slope(self, slope: float, speed: float) -> Self:
        """The law with d chosen so that μ'(speed) = slope; ε, c and r do not change. μ' is linear in d.

        Raises
        ------
        InputError
            μ' does not depend on d at this speed, e.g. at 0.
        """
        finite_number("slope", slope)
        flat, one = replace(self, drop=0.0), replace(self, drop=1.0)
        base = float(flat.slope(finite_number("speed", speed)))
        gain = float(one.slope(speed)) - base
        if abs(gain) <= EQUAL * self.decay or speed == 0:
            raise InputError(f"the falling part of the law has no slope at a sliding speed of {speed!r}, so μ' cannot be set to "
                             f"{slope!r} there. Choose another speed")
        return replace(self, drop=(slope - base) / gain)


@dataclass(frozen=True)
class StribeckArctanOdd(StribeckArctan):
    """The odd variant of the paper's friction law: μ(v) = (c + d exp(-r|v|)) (2/π) arctan(v/ε), with μ(-v) = -μ(v).

    For parameters and errors see `StribeckArctan`, the paper's eq. (7).

    Examples
    --------
    >>> import femsub as fs
    >>> law = fs.StribeckArctanOdd(eps=1e-3)
    >>> print(f"{law.value(0.2):.4f} {law.value(-0.2):.4f}")
    0.4327 -0.4327
    """

    label: ClassVar[str] = "odd variant"

    def _formulas(self, atan: Callable[..., Any], exp: Callable[..., Any],
                  sign: Callable[..., Any]) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
        """μ(v), and μ'(v), even in v and smooth."""
        two, c, eps, drop, decay = 2 / math.pi, self.coulomb, self.eps, self.drop, self.decay

        def value(v: Any) -> Any:
            return (c + drop * exp(-decay * abs(v))) * two * atan(v / eps)

        def slope(v: Any) -> Any:
            ratio, more = v / eps, drop * exp(-decay * abs(v))
            return two * ((c + more) / eps / (1 + ratio * ratio) - decay * more * atan(abs(ratio)))

        return value, slope


#: Friction laws by their keys in scene files. Add your own with LAWS["my-law"] = MyLaw.
LAWS: dict[str, Callable[..., FrictionLaw]] = {"stribeck-arctan": StribeckArctan, "stribeck-arctan-odd": StribeckArctanOdd}


def scalar_law(law: FrictionLaw) -> tuple[Scalar, Scalar]:
    """μ and μ' of a law as functions of one float: its `scalar()` if it has one."""
    if callable(own := getattr(law, "scalar", None)):
        value, slope = own()
        if type(law).__module__ == __name__:
            return value, slope
        return lambda v: asked(law, "value", v, value), lambda v: asked(law, "slope", v, slope)
    return lambda v: _number(law, "value", v), lambda v: _number(law, "slope", v)


def _sign(v: float) -> float:
    """The sign of one float, 0 at 0; NumPy's function takes several times as long."""
    return math.copysign(1.0, v) if v else 0.0


def asked(law: FrictionLaw | None, name: str, v: Any, function: Callable[[Any], Any] | None = None) -> Any:
    """`law.value(v)` or `law.slope(v)`, by its name. An error in a law of your own is reported with the law and the speed."""
    try:
        return (getattr(law, name) if function is None else function)(v)
    except FemsubError:
        raise
    except Exception as error:
        raise InputError(f"{type(law).__name__}.{name}(v), of the friction law, fails at v = {shown(v)} with "
                         f"{type(error).__name__}: {error}. It must give μ, or μ', at every sliding speed") from error


def _number(law: FrictionLaw, name: str, v: float) -> float:
    found = asked(law, name, v)
    try:
        return float(found)
    except (TypeError, ValueError):
        raise InputTypeError(f"{type(law).__name__}.{name}(v), of the friction law, must be a number at v = {v:g}, but is "
                             f"{shown(found)}") from None


def width_of(law: Any) -> float:
    """ε of a law; NaN if the law has no ε."""
    eps = getattr(law, "eps", None)
    usable = isinstance(eps, (int, float, np.integer, np.floating)) and not isinstance(eps, bool) and 0 < eps < np.inf
    return float(eps) if usable else np.nan  # type: ignore[arg-type]


def knots_of(law: Any) -> Array:
    """The speeds at which μ' has a kink or a jump, as the law declares."""
    return np.ravel(real_array(f"the knots of {type(law).__name__}", getattr(law, "knots", ())))


def with_slope(law: Any, slope: float, speed: float) -> Any:
    """The law with another μ'(speed); an InputError if the law has no `with_slope`."""
    if not callable(getattr(law, "with_slope", None)):
        raise InputError(f"the slope cannot be varied: {type(law).__name__} has no with_slope(slope, speed)")
    return law.with_slope(slope, speed)


class SlopeOfLaw(float):
    """μ'(v0) computed from a law. A copy of the belt computes it again; a plain float must agree with the law."""


@dataclass(frozen=True)
class Belt:
    """A belt that slides over a port w at speed v0 under a normal force F: D = P + F μ'(v0) w wᵀ.

    A changed copy, such as ``dataclasses.replace(belt, speed=0.3)``, computes the slope from the law again. A slope given by you
    does not change. If there is a law as well, the slope must agree with it.

    Parameters
    ----------
    port : str
        The port that the belt acts on.
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
        Neither `law` nor `slope`, a slope that contradicts the law, a law without a speed, a negative force, NaN.

    Examples
    --------
    >>> import femsub as fs
    >>> belt = fs.Belt(port="belt", force=1.0, speed=0.1911, law=fs.StribeckArctan(eps=1e-3))
    >>> print(f"{belt.slope:.4f}")
    -0.2677
    """

    port: str = "belt"
    force: float = 1.0
    speed: float | None = None
    law: FrictionLaw | None = None
    slope: float | None = None

    columnwise: ClassVar[bool] = True

    def __post_init__(self) -> None:
        word("port", self.port)
        finite_number("force", self.force)
        if self.force < 0:
            raise InputError(f"force must not be negative, but is {self.force!r}: it is the normal force of the belt")
        if self.speed is not None:
            finite_number("speed", self.speed)
        if self.law is None and self.slope is None:
            raise InputError("a belt needs a friction law and a speed, e.g. Belt(speed=0.1911, law=...), or a slope, "
                             "e.g. Belt(slope=-0.2677)")
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

    @property
    def ports(self) -> tuple[str, ...]:
        """The port, for the protocol of contacts."""
        return (self.port,)

    @property
    def affine(self) -> tuple[str, ...]:
        """F μ' is affine in each factor. With a law it is not affine in the speed; without a law the speed has no effect."""
        return ("force", "slope", *(("speed",) if self.law is None else ()))

    @property
    def affine_through(self) -> dict[str, Callable[[Any], Any]]:
        """F μ' is affine in μ'(v0) of the law, as a function of the speed."""
        return {} if self.law is None else {"speed": self.law.slope}

    def kinks(self, parameter: str) -> tuple[float, ...]:
        """The knots of the law over the speed. For a law with a width ε and without knots, the speed 0, where μ' changes most."""
        if parameter != "speed" or self.law is None:
            return ()
        return tuple(knots_of(self.law).tolist()) or (() if np.isnan(width_of(self.law)) else (0.0,))

    def linearised(self, model: Substructure) -> tuple[float, None]:
        """(F μ'(v0), None): each column of the port is a separate contact, see `femsub.model.contact.Contact`."""
        return self.force * float(self.slope or 0.0), None

    def in_motion(self, model: Substructure) -> Self:
        """The belt itself; an InputError without a law."""
        if self.law is None:
            raise InputError(f"the belt on port {self.port!r} has a slope only, but motion in time needs a friction law and the "
                             "belt's speed, e.g. Belt(speed=0.19113, law=StribeckArctan(eps=1e-3))")
        return self

    def exerted(self, u: Any, v: Any) -> Any:
        """f = F μ(v0 - v), in the shape of v."""
        return self.force * asked(self.law, "value", self.speed - v)

    def tangents(self, u: Any, v: Any) -> tuple[None, Array]:
        """(∂f/∂u, ∂f/∂v) = (None, -F μ'(v0 - v)), diagonal: (p, p) for v (p,), (p, p, m) for v (p, m)."""
        found, at = np.zeros((len(v), *np.shape(v))), np.arange(len(v))
        found[at, at] = -self.force * self.slope_at(self.speed - v)
        return None, found

    def scalar(self) -> tuple[Scalar, Scalar]:
        """f and ∂f/∂v of one column as functions of one Python float v, for the integrators."""
        (mu, slope), force, speed = scalar_law(self.law), self.force, float(self.speed or 0.0)  # type: ignore[arg-type]
        return lambda v: force * mu(speed - v), lambda v: -force * slope(speed - v)

    def slope_at(self, v: Any) -> Any:
        """μ'(v) of the law, in the shape of v."""
        return asked(self.law, "slope", v)

    def sticks(self, v: Any, multiple: float = STICKING, below: float | None = None) -> Any:
        """Whether |v0 - v| ≤ multiple · ε of the law, or ≤ `below`, with the velocity v of the port; bool, in the shape of v.

        Raises
        ------
        InputError
            The law has no ε, and `below` is not given.
        """
        limit = finite_number("multiple", multiple) * width_of(self.law) if below is None else finite_number("below", below)
        if np.isnan(limit):
            raise InputError(f"the friction law on {self.port!r} has no eps. Give `below`, the speed that counts as sticking")
        return np.abs(self.speed - np.asarray(v)) <= limit


def _consistent_slope(law: FrictionLaw, speed: float, tol: float = 0.01) -> float:
    """μ'(v0) of a law, checked against difference quotients of its values μ(v0 ± h) for several steps h, to `tol`.

    No step reaches beyond a knot of the law. At a jump that is not a knot, it suffices if the quotient of one side agrees.
    """
    slope = _number(law, "slope", speed)
    if speed == 0 or not np.isfinite(slope):
        return finite_number("the slope of the law at the belt's speed", slope)
    steps = abs(speed) * 10.0 ** -np.arange(2.0, 8.0)
    steps = steps[steps <= np.abs(knots_of(law) - speed).min(initial=np.inf)]
    if not len(steps):
        return slope
    ahead, behind = (np.array([_number(law, "value", speed + sign * h) for h in steps]) for sign in (1.0, -1.0))
    here = _number(law, "value", speed)
    if not (np.isfinite(ahead) & np.isfinite(behind)).all() or not np.isfinite(here):
        raise InputError(f"{type(law).__name__}.value(v), of the friction law, is not a finite number near v = {speed:g}")
    found = np.concatenate([(ahead - behind) / (2 * steps), (ahead - here) / steps, (here - behind) / steps])
    rounding = np.tile(8 * EPS * (np.abs(ahead) + np.abs(behind)) / steps, 3)
    if (np.abs(found - slope) > tol * np.maximum(np.abs(found), abs(slope)) + rounding).all():
        raise InputError(f"the friction law contradicts itself at the speed {speed:g}: slope() returns {slope:.6g}, but the "
                         f"difference quotient of value() is {found[len(steps) // 2]:.6g}")
    return slope
