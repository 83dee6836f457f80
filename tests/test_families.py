"""Factors over ranges of parameters by interval arithmetic, and models with contacts as sums of matrices with such factors."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import femsub as fs
from femsub.model.intervals import RISING, UFUNCS, Interval, range_of

ONE = np.eye(1)
BOX = {"a": (0.4, 2.5), "b": (-1.5, 0.7)}


def expression(rng: np.random.Generator, depth: int) -> str:
    """A random formula of a > 0 and b, with no pole or root of a negative number by its form."""
    if depth == 0:
        return str(rng.choice(["a", "b", f"{rng.uniform(-2, 2):.3f}", "np.float64(0.3)"]))
    x, y = expression(rng, depth - 1), expression(rng, int(rng.integers(depth)))
    return str(rng.choice([f"({x} + {y})", f"({x} - {y})", f"({x} * {y})", f"{x} / (1.1 + ({y})**2)", f"({x})**3", f"({x})**2",
                           f"abs({x})", f"np.sin({x})", f"np.cos(2 * ({x}))", f"np.tanh({x})", f"np.arctan({x})", f"-({x})",
                           f"np.exp(-abs({x}))", f"np.sqrt(abs({x}))", f"np.log(1.5 + ({x})**2)", f"(0.1 + abs({x}))**-1.5",
                           f"(0.2 + ({x})**2)**({y})" if len(y) < 10 else f"1.5**np.sin({x})", f"np.tan(np.sin({x}))",
                           f"np.square({x}) * a / a", f"np.reciprocal(0.5 + a) * ({x})"]))


def test_no_value_of_a_random_formula_lies_outside_its_proved_range() -> None:
    """1,000 formulas of two parameters at 2,500 places each. The pieces make the bounds narrower than one interval is."""
    rng = np.random.default_rng(56)
    a, b = np.meshgrid(*(np.linspace(*ends, 50) for ends in BOX.values()))
    width = []
    for turn in range(1000):
        text = expression(rng, 1 + turn % 4)
        formula: Callable[..., Any] = eval(f"lambda a, b: {text}", {"np": np})
        with np.errstate(over="ignore", invalid="ignore"):
            values = np.broadcast_to(formula(a, b), a.shape)
        if not np.isfinite(values).all():
            continue
        lo, hi, proved = range_of(formula, BOX, lambda given, formula=formula: formula(**given))
        assert lo <= values.min() and values.max() <= hi, text
        if proved and np.ptp(values) > 1e-3 * np.abs(values).max():
            width.append((hi - lo) / np.ptp(values))
    assert len(width) > 600 and np.median(width) < 1.2


@pytest.mark.parametrize("function", sorted(RISING | set(UFUNCS), key=lambda function: function.__name__))
def test_each_function_holds_its_values_and_no_more(function: np.ufunc) -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        lo, hi = np.sort(rng.uniform(0.05, 0.95, 2) if function is np.arcsin else rng.uniform(0.05, 1.5, 2))
        x = np.linspace(lo, hi, 400)
        others = [Interval(0.3, 0.7)] * (function.nin - 1)
        found = function(Interval(lo, hi), *others)
        values = np.concatenate([function(x, *(np.full(400, end) for _ in others)) for end in (0.3, 0.7)])
        assert found.lo <= values.min() and values.max() <= found.hi
        assert found.hi - found.lo <= np.ptp(values) + 1e-4 * (1 + np.abs(values).max())


def test_a_wave_has_its_highest_and_lowest_value_where_its_crest_and_its_trough_are() -> None:
    x = Interval(np.array([0.1, 2.0, 4.0, -9.0, 3.0]), np.array([3.0, 3.0, 5.0, 9.0, 3.2]))
    sine, cosine = np.sin(x), np.cos(x)
    np.testing.assert_allclose(sine.hi, [1.0, np.sin(2.0), np.sin(4.0), 1.0, np.sin(3.0)], rtol=1e-14)
    np.testing.assert_allclose(sine.lo, [np.sin(0.1), np.sin(3.0), -1.0, -1.0, np.sin(3.2)], rtol=1e-14)
    np.testing.assert_allclose(cosine.hi, [np.cos(0.1), np.cos(2.0), np.cos(5.0), 1.0, np.cos(3.0)], rtol=1e-14)
    np.testing.assert_allclose(cosine.lo, [np.cos(3.0), np.cos(3.0), np.cos(4.0), -1.0, -1.0], rtol=1e-14)


@pytest.mark.parametrize("unfit", [lambda x: x > 1, lambda x: x == 1, float, math.sin, lambda x: max(x, 1), lambda x: {1: 2}[x],
                                   lambda x: 1 if x else 2, lambda x: np.interp(x, [0, 1], [0, 1]), lambda x: x // 1,
                                   lambda x: x * np.ones(2), lambda x: np.ones(2) * x, lambda x: x * 1j, lambda x: np.floor(x),
                                   lambda x: np.add(x, 1, where=True)])
def test_an_interval_is_refused_where_no_range_can_be_computed(unfit: Callable[[Any], Any]) -> None:
    with pytest.raises(TypeError):
        unfit(Interval(0.5, 2.0))


@pytest.mark.parametrize("pole", [lambda x: 1 / x, lambda x: x**-2, np.log, lambda x: np.tan(x + 1.5), lambda x: 1 / np.sin(x)])
def test_a_pole_between_the_bounds_is_an_error(pole: Callable[[Any], Any]) -> None:
    with pytest.raises(ZeroDivisionError):
        pole(Interval(0.0, 0.5))


@pytest.mark.parametrize("root", [np.sqrt, lambda x: x**0.5, np.log, np.arcsin, lambda x: x**x])
def test_the_root_of_a_negative_number_is_an_error(root: Callable[[Any], Any]) -> None:
    with pytest.raises(ArithmeticError):
        root(Interval(-1.5, 0.5))


def test_the_ranges_of_factors_are_exact_for_numbers_names_and_what_each_variable_enters_once() -> None:
    family = fs.Affine([(1.0, ONE), (lambda speed: 1 / speed, ONE)], [("mu", ONE)],
                       [(-2.5, ONE), (lambda mu, speed: mu / speed, ONE), (lambda speed: speed**2, ONE),
                        (lambda mu, c=3.0: c * np.sqrt(mu), ONE)])
    lo, hi, proved = family.factor_ranges({"speed": (2, 5), "mu": (0.0, 0.64)})
    np.testing.assert_allclose(lo, [1.0, 0.2, 0.0, -2.5, 0.0, 4.0, 0.0], rtol=1e-14, atol=1e-300)
    np.testing.assert_allclose(hi, [1.0, 0.5, 0.64, -2.5, 0.32, 25.0, 2.4], rtol=1e-14)
    assert proved.all() and lo[0] == hi[0] == 1.0 and (lo[2], hi[2]) == (0.0, 0.64) and (lo <= hi).all()
    most, sure = family.deviation({"speed": (2, 5), "mu": (0.0, 0.64)}, {"speed": 4.0, "mu": 0.16})
    np.testing.assert_allclose(most, [0.0, 0.25, 0.48, 0.0, 0.28, 12.0, 1.2], rtol=1e-14)
    assert sure.all() and most[0] == 0.0
    part = family.fixed(mu=0.16)
    assert part.factor_ranges({"speed": (2, 2)})[0][4] == pytest.approx(0.08, rel=1e-14)


def test_a_variable_that_stands_twice_costs_little_and_a_pole_has_no_bound() -> None:
    family = fs.Affine(ONE, None, [(lambda x: x / (1 + x), ONE), (lambda x: x * (1 - x), ONE), (lambda x: 1 / (x - 0.3), ONE)])
    lo, hi, proved = family.factor_ranges({"x": (0.0, 1.0)})
    np.testing.assert_allclose([lo[1:3], hi[1:3]], [[0.0, 0.0], [0.5, 0.25]], atol=0.02)
    assert hi[1] >= 0.5 and hi[2] >= 0.25 and proved.all() and (lo[3], hi[3]) == (-np.inf, np.inf)


def test_a_factor_that_takes_no_interval_is_sampled() -> None:
    table = np.linspace(0, 3, 7) ** 2
    family = fs.Affine(ONE, None, [(lambda x: math.sin(40 * x), ONE), (lambda x: 2.0 if x > 1 else 1.0, ONE),
                                   (lambda x, y: y * float(np.interp(x, np.linspace(0, 3, 7), table)), ONE)])
    lo, hi, proved = family.factor_ranges({"x": (0.0, 3.0), "y": (-1.0, 2.0)})
    assert proved.tolist() == [True, False, False, False]
    assert (lo[1:] <= [-1.0, 1.0, -9.0]).all() and (hi[1:] >= [1.0, 2.0, 18.0]).all()
    assert (lo[1:] > [-1.3, 0.0, -13.0]).all() and (hi[1:] < [1.3, 3.1, 22.0]).all()
    branching = fs.Affine(ONE, None, [(lambda x: 1 / x if x > 1 else float("nan"), ONE)])
    with pytest.raises(fs.InputError, match="factor <lambda>"):
        branching.factor_ranges({"x": (0.0, 2.0)})


@pytest.mark.parametrize(("ranges", "words"), [
    ({"x": (0, 1)}, "no range is given for y. Give all of x, y"), ({"x": (0, 1), "y": (1, 0)}, "lo ≤ hi"),
    ({"x": (0, 1), "y": (0, 1), "z": (0, 1)}, "unknown parameter 'z'"), ({"x": (0, 1), "y": (0, np.inf)}, "finite"),
    ({"x": (0, 1), "y": (0, 1, 2)}, "lo ≤ hi"), ({"x": (0, 1), "y": ()}, "must be")])
def test_ranges_are_checked(ranges: dict[str, Any], words: str) -> None:
    with pytest.raises(fs.InputError, match=words):
        fs.Affine(ONE, None, [("x", ONE), ("y", ONE)]).factor_ranges(ranges)
