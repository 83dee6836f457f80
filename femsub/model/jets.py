"""`Jet`: a number with its first and second derivatives in several parameters, computed without finite differences.

A function of Python arithmetic and NumPy's functions accepts a `Jet` in place of a number, as it accepts an `Interval`.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np

from femsub.checks import EPS, Array


@dataclass(frozen=True, eq=False)
class Jet:
    """f, ∂f/∂p_i and ∂²f/∂p_i∂p_j of q parameters: a float and arrays (q,) and (q, q).

    It supports + - * / ** and abs among jets and numbers, NumPy's functions in `UFUNCS` and `CURVES`, and comparisons of the
    value. Anything else is a TypeError: `float`, and the functions of `math`.
    """

    value: float
    first: Array
    second: Array

    __hash__ = None  # type: ignore[assignment]

    @classmethod
    def of(cls, value: float, at: int, count: int) -> Jet:
        """The jet of the parameter with the index `at` among `count` parameters."""
        return cls(float(value), np.eye(count)[at], np.zeros((count, count)))

    def through(self, value: float, slope: float, curve: float) -> Jet:
        """The jet of g(f) from the value, the slope g' and the second derivative g'' of g at f."""
        return Jet(float(value), slope * self.first, slope * self.second + curve * np.outer(self.first, self.first))

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *given: Any, **options: Any) -> Any:
        given = tuple(x.item() if isinstance(x, np.ndarray) and not x.ndim else x for x in given)
        if method != "__call__" or options or not all(isinstance(x, (Jet, Real)) for x in given):
            return NotImplemented
        if ufunc in UFUNCS:
            return UFUNCS[ufunc](*given)
        if ufunc not in CURVES:
            return NotImplemented
        with np.errstate(all="ignore"):
            return self.through(*CURVES[ufunc](self.value))

    def __pos__(self) -> Jet:
        return self

    def __neg__(self) -> Jet:
        return Jet(-self.value, -self.first, -self.second)

    def __abs__(self) -> Jet:
        return -self if self.value < 0 else self if self.value > 0 else self.through(0.0, np.nan, np.nan)

    def __add__(self, other: Any) -> Jet:
        if isinstance(other, Jet):
            return Jet(self.value + other.value, self.first + other.first, self.second + other.second)
        return Jet(self.value + float(other), self.first, self.second) if isinstance(other, Real) else NotImplemented

    def __sub__(self, other: Any) -> Jet:
        return self + -other if isinstance(other, (Jet, Real)) else NotImplemented

    def __rsub__(self, other: Any) -> Jet:
        return -self + other

    def __mul__(self, other: Any) -> Jet:
        if isinstance(other, Jet):
            mixed = np.outer(self.first, other.first)
            return Jet(self.value * other.value, self.value * other.first + other.value * self.first,
                       self.value * other.second + other.value * self.second + mixed + mixed.T)
        return self.through(self.value * float(other), float(other), 0.0) if isinstance(other, Real) else NotImplemented

    def __truediv__(self, other: Any) -> Jet:
        return self * (other**-1 if isinstance(other, Jet) else 1 / float(other)) if isinstance(other, (Jet, Real)) else \
            NotImplemented

    def __rtruediv__(self, other: Any) -> Jet:
        return self**-1 * other

    __radd__ = __add__
    __rmul__ = __mul__

    def __pow__(self, exponent: Any) -> Jet:
        if isinstance(exponent, Jet):
            return np.exp(exponent * np.log(self))
        if not isinstance(exponent, Real):
            return NotImplemented
        n, x = float(exponent), np.float64(self.value)
        with np.errstate(all="ignore"):  # a pole, and the slope of a root at 0, are infinite
            return self.through(float(x**n), float(n * x ** (n - 1)) if n else 0.0,
                                float(n * (n - 1) * x ** (n - 2)) if n * (n - 1) else 0.0)

    def __rpow__(self, base: Any) -> Jet:
        return np.exp(self * np.log(float(base))) if isinstance(base, Real) else NotImplemented

    def __lt__(self, other: Any) -> bool:
        return bool(self.value < _value(other))

    def __le__(self, other: Any) -> bool:
        return bool(self.value <= _value(other))

    def __gt__(self, other: Any) -> bool:
        return bool(self.value > _value(other))

    def __ge__(self, other: Any) -> bool:
        return bool(self.value >= _value(other))

    def __eq__(self, other: object) -> bool:
        return bool(self.value == _value(other))


def _value(x: Any) -> Any:
    return x.value if isinstance(x, Jet) else x


#: NumPy's functions of one number: the value with the first and second derivative.
CURVES: dict[np.ufunc, Callable[[Any], tuple[Any, Any, Any]]] = {
    np.exp: lambda x: (np.exp(x),) * 3, np.expm1: lambda x: (np.expm1(x), np.exp(x), np.exp(x)),
    np.log: lambda x: (np.log(x), 1 / x, -1 / x**2), np.log1p: lambda x: (np.log1p(x), 1 / (1 + x), -1 / (1 + x) ** 2),
    np.sin: lambda x: (np.sin(x), np.cos(x), -np.sin(x)), np.cos: lambda x: (np.cos(x), -np.sin(x), -np.cos(x)),
    np.sinh: lambda x: (np.sinh(x), np.cosh(x), np.sinh(x)), np.cosh: lambda x: (np.cosh(x), np.sinh(x), np.cosh(x)),
    np.tan: lambda x: (np.tan(x), np.cos(x) ** -2, 2 * np.tan(x) * np.cos(x) ** -2),
    np.tanh: lambda x: (np.tanh(x), np.cosh(x) ** -2, -2 * np.tanh(x) * np.cosh(x) ** -2),
    np.sign: lambda x: (np.sign(x), *((0.0, 0.0) if x else (np.nan, np.nan))),
    np.arctan: lambda x: (np.arctan(x), 1 / (1 + x**2), -2 * x / (1 + x**2) ** 2)}
#: The operators and other functions: NumPy calls operators as ufuncs if its number is the left operand.
UFUNCS: dict[np.ufunc, Callable[..., Any]] = {
    np.add: operator.add, np.subtract: operator.sub, np.multiply: operator.mul, np.divide: operator.truediv,
    np.power: operator.pow, np.negative: operator.neg, np.positive: operator.pos, np.absolute: abs, np.fabs: abs,
    np.square: lambda x: x**2, np.reciprocal: lambda x: x**-1, np.sqrt: lambda x: x**0.5,
    np.less: operator.lt, np.less_equal: operator.le, np.greater: operator.gt, np.greater_equal: operator.ge}


def jet_of(function: Callable[..., Any], values: Mapping[str, float], places: Mapping[str, int], count: int) -> Jet:
    """The jet of a function of named parameters at `values`; `places` are the indices of the parameters among all `count`.

    A function that accepts no `Jet`, such as one of `math` or a table, is differentiated by central differences of the fourth
    order along each of its parameters. The second derivatives then have about half of the digits.
    """
    seeds = {name: Jet.of(values[name], places[name], count) for name in values}
    try:
        found = function(**seeds)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):  # the function accepts plain numbers only
        found = None
    if isinstance(found, Jet):
        return found
    if isinstance(found, Real):  # the function does not depend on its parameters
        return Jet(float(found), np.zeros(count), np.zeros((count, count)))
    names = list(values)
    step = {name: EPS**0.2 * (abs(values[name]) or 1.0) for name in names}

    def at(**moved: int) -> float:
        return float(function(**{name: values[name] + moved.get(name, 0) * step[name] for name in names}))

    f, first, second = at(), np.zeros(count), np.zeros((count, count))
    for name in names:
        i, h = places[name], step[name]
        near, far = ([at(**{name: sign * k}) for sign in (-1, 1)] for k in (1, 2))
        first[i] = (8 * (near[1] - near[0]) - (far[1] - far[0])) / (12 * h)
        second[i, i] = (16 * (near[1] + near[0]) - (far[1] + far[0]) - 30 * f) / (12 * h * h)
        for other in names[:names.index(name)]:
            j = places[other]
            crossed = sum(a * b * at(**{name: a, other: b}) for a in (-1, 1) for b in (-1, 1))
            second[i, j] = second[j, i] = crossed / (4 * h * step[other])
    return Jet(f, first, second)
