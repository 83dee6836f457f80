"""`Interval`: all values between two bounds, for functions of parameters over a whole range. Every bound is rounded outwards.

A function of Python arithmetic and NumPy's functions accepts an `Interval` in place of a number, and returns one that contains
all of its values. The result is the exact range only if each variable occurs once: x - x is not 0. Bounds over small pieces of
the range are tighter, so lo and hi may be arrays, one entry per piece.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import product
from numbers import Real
from typing import Any, NoReturn

import numpy as np

from femsub.checks import EPS, Array

CLOSEST = 4  # units in the last place by which NumPy's vectorised functions may be off, see its test_umath_accuracy.py


@dataclass(frozen=True, eq=False)
class Interval:
    """All numbers x with lo ≤ x ≤ hi; for arrays entry by entry.

    It supports + - * / ** and abs among intervals and numbers, and NumPy's functions in `RISING` and `UFUNCS`. Anything else is a
    TypeError: comparisons, as in branches of a function, `float`, and the functions of `math`.

    Raises
    ------
    ZeroDivisionError
        There is a pole between the bounds: a division by 0, log(0), tan(π/2).
    ArithmeticError
        The root, the logarithm or a fractional power of a negative number.

    Notes
    -----
    R. E. Moore, R. B. Kearfott, M. J. Cloud, Introduction to Interval Analysis, SIAM 2009, chapters 2 and 5.
    """

    lo: Any
    hi: Any

    __hash__ = None  # type: ignore[assignment]

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *given: Any, **options: Any) -> Any:
        given = tuple(x.item() if isinstance(x, np.ndarray) and not x.ndim else x for x in given)  # as np.polyval passes it on
        numbers: list[Any] = [x if isinstance(x, Interval) else float(x) for x in given if isinstance(x, (Interval, Real))]
        if method != "__call__" or options or len(numbers) < len(given):
            return NotImplemented
        return UFUNCS[ufunc](*numbers) if ufunc in UFUNCS else _rising(ufunc, *numbers) if ufunc in RISING else NotImplemented

    def __pos__(self) -> Interval:
        return self

    def __neg__(self) -> Interval:
        return Interval(-self.hi, -self.lo)

    def __abs__(self) -> Interval:
        return Interval(np.maximum(np.maximum(self.lo, -self.hi), 0.0), np.maximum(self.hi, -self.lo))

    def __add__(self, other: Any) -> Interval:
        return _combined(np.add, self, other)

    def __sub__(self, other: Any) -> Interval:
        return _combined(np.subtract, self, other)

    def __mul__(self, other: Any) -> Interval:
        return _combined(np.multiply, self, other)

    def __truediv__(self, other: Any) -> Interval:
        return _combined(np.divide, self, other)

    def __rsub__(self, other: Any) -> Interval:
        return _combined(np.subtract, other, self)

    def __rtruediv__(self, other: Any) -> Interval:
        return _combined(np.divide, other, self)

    __radd__ = __add__
    __rmul__ = __mul__

    def __pow__(self, exponent: Any) -> Interval:
        if isinstance(exponent, Interval):
            return np.exp(exponent * np.log(self))
        if not isinstance(exponent, Real):
            return NotImplemented
        if exponent < 0:
            return 1.0 / self ** -exponent
        whole = float(exponent).is_integer()
        if not whole and np.any(np.less(self.lo, 0)):
            raise ArithmeticError("a fractional power of a negative number")
        return _rising(lambda x: np.power(x, float(exponent)), abs(self) if whole and exponent % 2 == 0 else self)

    def __rpow__(self, base: Any) -> Interval:
        if not isinstance(base, Real):
            return NotImplemented
        return np.exp(self * np.log(Interval(float(base), float(base))))

    def _compared(self, other: object) -> NoReturn:
        raise TypeError("an Interval is neither larger nor smaller than a number")

    __eq__ = __ne__ = __lt__ = __le__ = __gt__ = __ge__ = _compared

    def __bool__(self) -> NoReturn:
        self._compared(0)


def _outwards(ends: Array, units: int) -> Interval:
    """From the smallest to the largest value, each moved outwards by `units` in the last place, but not past 0.

    A bound that is NaN, such as 0 · inf, becomes infinite.
    """
    lo, hi = ends.min(axis=0), ends.max(axis=0)
    with np.errstate(invalid="ignore", over="ignore"):
        below, above = lo - units * np.spacing(np.abs(lo)), hi + units * np.spacing(np.abs(hi))
    negative = np.signbit(ends)  # True for -0.0, to which a negative product of small numbers underflows
    below = np.where(negative.any(axis=0), below, np.maximum(below, 0.0))
    above = np.where(negative.all(axis=0), np.minimum(above, 0.0), above)
    return Interval(np.where(np.isnan(below), -np.inf, below), np.where(np.isnan(above), np.inf, above))


def _combined(operation: np.ufunc, one: Any, other: Any) -> Any:
    """The range of a sum, difference, product or quotient, from its values at the ends of both intervals."""
    pairs = [(x.lo, x.hi) if isinstance(x, Interval) else (float(x), float(x)) for x in (one, other)
             if isinstance(x, (Interval, Real))]
    if len(pairs) < 2:
        return NotImplemented
    ours, (lo, hi) = pairs
    if operation is np.divide and np.any(np.less_equal(lo, 0) & np.greater_equal(hi, 0)):
        raise ZeroDivisionError("division by zero")
    with np.errstate(invalid="ignore", over="ignore", under="ignore"):
        return _outwards(np.array([operation(a, b) for a in ours for b in (lo, hi)]), 1)


def _rising(function: Callable[[Any], Any], x: Interval) -> Interval:
    """The range of a non-decreasing function."""
    try:
        with np.errstate(divide="raise", invalid="raise", over="ignore", under="ignore"):
            ends = np.array([function(x.lo), function(x.hi)])
    except FloatingPointError as error:  # log(0) is a division for NumPy
        raise (ZeroDivisionError if "divide" in str(error) else ArithmeticError)(str(error)) from None
    return _outwards(ends, CLOSEST)


def _holds(x: Interval, place: float, period: float) -> Array:
    """Whether place + k · period is within the bounds for some integer k, or so close to them that rounding may hide it."""
    near = CLOSEST * EPS * (1 + np.maximum(np.abs(x.lo), np.abs(x.hi)) / period)
    return np.asarray(np.floor((x.hi - place) / period + near) >= np.ceil((x.lo - place) / period - near))


def _waves(function: np.ufunc, top: float, x: Interval) -> Interval:
    """The range of sin or cos, which is 1 at `top` and -1 half a period later."""
    with np.errstate(invalid="ignore"):
        found = _outwards(np.array([function(x.lo), function(x.hi)]), CLOSEST)
    low, high = (_holds(x, place, 2 * np.pi) for place in (top + np.pi, top))
    return Interval(np.where(low, -1.0, np.maximum(found.lo, -1.0)), np.where(high, 1.0, np.minimum(found.hi, 1.0)))


def _log(x: Interval) -> Interval:
    if np.any(np.less_equal(x.lo, 0) & np.greater_equal(x.hi, 0)):
        raise ZeroDivisionError("log of 0")
    return _rising(np.log, x)


def _tan(x: Interval) -> Interval:
    if _holds(x, np.pi / 2, np.pi).any():
        raise ZeroDivisionError("tan of an odd multiple of π/2")
    return _rising(np.tan, x)


#: NumPy's functions that are non-decreasing where they are defined.
RISING = {np.sqrt, np.cbrt, np.exp, np.expm1, np.log2, np.log10, np.log1p, np.sinh, np.tanh, np.arcsinh, np.arcsin,
          np.arctan, np.sign}
#: The other functions, and the operators, which NumPy calls as ufuncs if its number is the left operand.
UFUNCS: dict[np.ufunc, Callable[..., Any]] = {
    np.add: operator.add, np.subtract: operator.sub, np.multiply: operator.mul, np.divide: operator.truediv,
    np.power: operator.pow, np.negative: operator.neg, np.positive: operator.pos, np.absolute: abs, np.fabs: abs,
    np.square: lambda x: x**2, np.reciprocal: lambda x: 1.0 / x, np.log: _log, np.tan: _tan,
    np.sin: lambda x: _waves(np.sin, np.pi / 2, x), np.cos: lambda x: _waves(np.cos, 0.0, x)}


def range_of(function: Callable[..., Any], box: Mapping[str, tuple[float, float]], value: Callable[[dict[str, float]], Any],
             pieces: int = 64, samples: int = 256) -> tuple[float, float, bool]:
    """(lo, hi, proved): bounds of a function for all arguments in the box; `value` returns the function at one point.

    Bounds by interval arithmetic on about `pieces` pieces of the box are proved. They are infinite if a piece may contain a pole.
    A function that accepts no `Interval` is sampled at about `samples` Chebyshev points. The bounds of the samples are widened by
    the largest distance of a sample from the chord of its neighbours. A smooth function exceeds its samples by a quarter of this.
    """
    sides = len(box)
    each = max(round(pieces ** (1 / sides)), 1)
    edges = [np.linspace(*ends, each + 1).reshape([-1 if at == side else 1 for at in range(sides)])
             for side, ends in enumerate(box.values())]
    lows, highs = ([np.take(edge, rows, axis=side) for side, edge in enumerate(edges)]
                   for rows in (np.arange(each), np.arange(1, each + 1)))
    whole = {name: Interval(lo, hi) for name, lo, hi in zip(box, lows, highs, strict=True)}
    with suppress(Exception):  # a user's function may raise anything for an `Interval`; its errors for numbers are reported
        try:
            found = function(**whole)
        except ZeroDivisionError:
            return -np.inf, np.inf, True
        if isinstance(found, Interval):  # otherwise the function tested the type of its argument
            return float(np.min(found.lo)), float(np.max(found.hi)), True
    each = max(round(samples ** (1 / sides)), 3)
    places = [(lo + hi) / 2 - (hi - lo) / 2 * np.cos(np.linspace(0.0, np.pi, each)) for lo, hi in box.values()]
    values = np.reshape([value(dict(zip(box, point, strict=True))) for point in product(*(x.tolist() for x in places))],
                        [each] * sides)
    margin = 0.0
    for x, f in ((x, np.moveaxis(values, side, -1)) for side, x in enumerate(places)):
        if x[-1] > x[0]:
            share = (x[1:-1] - x[:-2]) / (x[2:] - x[:-2])
            margin += float(np.abs(f[..., 1:-1] - (1 - share) * f[..., :-2] - share * f[..., 2:]).max())
    return float(values.min()) - margin, float(values.max()) + margin, False
