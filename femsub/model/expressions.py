"""Factors of matrices as text: arithmetic with names of parameters, as "1 / speed" or "mu * (1 - speed / 40)".

An expression is parsed by Python's `ast`. Only numbers, names, + - * / **, parentheses and a few functions are accepted, and
nothing is run as code. One walk over the tree evaluates floats, an `Interval` (is the value defined everywhere?) and straight
lines.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from inspect import Parameter, Signature
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from femsub.checks import EQUAL, InputError, Matrix, parsing
from femsub.model.affine import Affine
from femsub.model.intervals import Interval

LONGEST = 500  # characters of an expression: no factor of a model needs more, and Python's parser may fail on much longer ones
OPERATORS: dict[type, Callable[[Any, Any], Any]] = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
                                                    ast.Div: operator.truediv, ast.Pow: operator.pow}
SIGNS: dict[type, Callable[[Any], Any]] = {ast.UAdd: lambda a: a, ast.USub: operator.neg}
FUNCTIONS = {"sqrt": math.sqrt, "exp": math.exp, "log": math.log, "sin": math.sin, "cos": math.cos}
CONSTANTS = {"pi": math.pi}
BROKEN = "a fractional power of a negative number"
TAKEN = f"numbers, names of parameters, + - * / **, parentheses, {', '.join(FUNCTIONS)} and pi"


@dataclass(frozen=True)
class Expression:
    """An arithmetic expression of parameters, checked when it is made. Errors name `where`, the matrix that it belongs to.

    Raises
    ------
    InputError
        Not an expression, or an expression with elements that are not in `TAKEN`.
    """

    text: str
    where: str

    def __post_init__(self) -> None:
        if len(self.text) > LONGEST:
            raise InputError(f"the factor of {self.where} must have at most {LONGEST} characters, but has {len(self.text)}")
        if strange := set(self.text) & {"#", "\\"}:  # Python would ignore the text after them
            raise InputError(f"the factor of {self.where}: {self.text!r} has {min(strange)} in it, but only {TAKEN} may "
                             "stand there")
        for node in ast.walk(self._tree):
            if isinstance(node, ast.Constant):
                good = isinstance(node.value, (int, float)) and not isinstance(node.value, bool)
            elif isinstance(node, ast.Call):
                good = isinstance(node.func, ast.Name) and node.func.id in FUNCTIONS and len(node.args) == 1 and not node.keywords
            else:
                good = isinstance(node, (ast.Name, ast.BinOp, ast.UnaryOp, ast.Load, *OPERATORS, *SIGNS))
            if not good:
                found = "^ (write ** for powers)" if isinstance(node, ast.BitXor) else \
                    ast.unparse(node) if isinstance(node, ast.expr) else type(node).__name__
                raise InputError(f"the factor of {self.where}: {self.text!r} has {found} in it, but only {TAKEN} may stand there")

    @cached_property
    def _tree(self) -> ast.expr:
        try:
            with parsing():
                return ast.parse(self.text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            reason = error.msg if isinstance(error, SyntaxError) else type(error).__name__
            raise InputError(f"the factor of {self.where} must be an expression such as '1 / speed', not {self.text!r} "
                             f"({reason})") from None

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The parameters, in the order in which they appear in the text."""
        called = {id(node.func) for node in ast.walk(self._tree) if isinstance(node, ast.Call)}
        found = [node for node in ast.walk(self._tree) if isinstance(node, ast.Name) and id(node) not in called]
        if bad := [node.id for node in found if node.id in FUNCTIONS]:
            raise InputError(f"the factor of {self.where}: {bad[0]} needs an argument, as in '{bad[0]}(speed)'")
        found.sort(key=lambda node: (node.lineno, node.col_offset))
        return tuple(dict.fromkeys(node.id for node in found if node.id not in CONSTANTS))

    def __call__(self, values: Mapping[str, Any]) -> Any:
        """The value at given values of all parameters; an `Interval` if one of them is.

        Raises
        ------
        InputError
            There is no value: a division by zero, the root of a negative number, a value that is not finite.
        """
        if any(isinstance(value, Interval) for value in values.values()):
            return self._walk(values)
        try:
            found = self._walk(values)
            if not math.isfinite(found):
                raise ArithmeticError("it is not finite")
        except (ArithmeticError, ValueError) as error:
            raise self._undefined(values, error) from None
        return float(found)

    def check_over(self, parameter: str, between: tuple[float, float], values: Mapping[str, float], most: int = 10_000) -> None:
        """Checks by interval arithmetic, on at most `most` intervals, that there is a value everywhere in a parameter's range.

        Raises
        ------
        InputError
            The expression has no value at a place in the range, such as a division by zero; the message names the place. Or a
            sine or cosine has more than a hundred periods in the range: no search could follow it.
        """
        for end in between:
            self({**values, parameter: end})
        left, tried = [between], 0
        while left and tried < most:
            lo, hi = left.pop()
            tried += 1
            try:
                found = self._walk({**values, parameter: Interval(lo, hi)})
                if isinstance(found, Interval) and not math.isfinite(found.hi - found.lo):
                    raise ArithmeticError("it is not finite")
            except _RapidError as error:
                raise InputError(f"the factor of {self.where}: {self.text!r} has a {error} with more than 100 periods for "
                                 f"{parameter} from {lo:g} to {hi:g}. Change the expression or the range") from None
            except ArithmeticError as error:
                middle = (lo + hi) / 2
                self({**values, parameter: middle})
                if hi - lo > EQUAL * (between[1] - between[0]) and lo < middle < hi:
                    left += [(middle, hi), (lo, middle)]
                elif isinstance(error, ZeroDivisionError):
                    raise self._undefined({**values, parameter: middle}, error) from None

    def lines(self, parameter: str, values: Mapping[str, float]) -> tuple[float, float] | None:
        """(a, b) if the expression is a + b · parameter; None otherwise."""
        try:
            found = self._walk({**values, parameter: Polynomial([0.0, 1.0])})
        except (ArithmeticError, AttributeError, TypeError, ValueError):  # not a polynomial, such as 1 / parameter
            return None
        terms: list[float] = [*(found.coef.tolist() if isinstance(found, Polynomial) else [found]), 0.0]
        return (terms[0], terms[1]) if all(map(math.isfinite, terms[:2])) and not any(terms[2:]) else None

    def _walk(self, values: Mapping[str, Any]) -> Any:
        """The value for these values of the names: floats, an `Interval` or a polynomial."""
        def value(node: ast.expr) -> Any:
            match node:
                case ast.Constant():
                    return float(node.value)  # type: ignore[arg-type]
                case ast.Name():
                    return CONSTANTS[node.id] if node.id in CONSTANTS else values[node.id]
                case ast.BinOp():
                    found = OPERATORS[type(node.op)](value(node.left), value(node.right))
                    if isinstance(found, complex):
                        raise ArithmeticError(BROKEN)
                    return found
                case ast.UnaryOp():
                    return SIGNS[type(node.op)](value(node.operand))
                case ast.Call(func=ast.Name(id=name)):
                    argument = value(node.args[0])
                    if name in ("sin", "cos") and isinstance(argument, Interval) and argument.hi - argument.lo > 200 * math.pi:
                        raise _RapidError(name)
                    return FUNCTIONS[name](argument) if isinstance(argument, float) else getattr(np, name)(argument)
            raise AssertionError(node)

        return value(self._tree)

    def _undefined(self, values: Mapping[str, float], error: Exception) -> InputError:
        place = ", ".join(f"{name} = {values[name]:.9g}" for name in self.names)
        return InputError(f"the factor of {self.where}: {self.text!r} has no value at {place}: {error}. Change the expression or "
                          "the range")


@dataclass(frozen=True)
class Factor:
    """A factor θ of an `Affine`: an expression as a function of `parameters`, with fixed `values` of the others."""

    expression: Expression
    parameters: tuple[str, ...]
    values: tuple[tuple[str, float], ...]

    @property
    def __signature__(self) -> Signature:
        return Signature([Parameter(name, Parameter.KEYWORD_ONLY) for name in self.parameters])

    def __call__(self, **given: Any) -> Any:
        return self.expression({**dict(self.values), **given})


class _RapidError(Exception):
    """A sine or cosine over so many periods that its range contains no information."""


def affine_of(sums: Mapping[str, Sequence[tuple[Expression, Matrix]]], free: Sequence[str],
              values: Mapping[str, float]) -> Affine:
    """The pencil of the sums 'M', 'D' and 'K' of θ A over the parameters `free`; the other parameters have fixed values.

    If one parameter p is free, a factor a + b p becomes two terms, so that analyses over p can be certified.
    """
    found: dict[str, Any] = {}
    for name, terms in sums.items():
        added: list[tuple[Any, Matrix]] = []
        for one, A in terms:
            line = one.lines(free[0], values) if len(free) == 1 else None
            if not set(one.names) & set(free):
                added += [(one(values), A)] if one(values) else []
            elif line is None:
                added.append((Factor(one, tuple(at for at in free if at in one.names), tuple(values.items())), A))
            else:
                added += [(theta, factor * A) for theta, factor in ((1.0, line[0]), (free[0], line[1]))
                          if factor] or [(0.0, A)]
        found[name] = added or (None if name == "D" else [(0.0, terms[-1][1])])
    return Affine(**found)


def check_range(factors: Sequence[Expression], free: str, between: tuple[float, float], values: Mapping[str, float]) -> None:
    """Checks that each factor has a value everywhere in a range of the parameter `free`, and that some factor depends on it.

    Raises
    ------
    InputError
        A factor has no value somewhere in the range, or no factor depends on the parameter.
    """
    for one in factors:
        one.check_over(free, between, values)
    lines = [one.lines(free, values) for one in factors]
    if all(line and not line[1] for line in lines):
        raise InputError(f"no factor changes with {free!r}, which cancels. Change the expression, or name another parameter")
