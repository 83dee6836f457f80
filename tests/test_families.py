"""Factors over ranges of parameters by interval arithmetic, and models with contacts as sums of matrices with such factors."""

from __future__ import annotations

import math
import operator
import pickle
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, ClassVar

import mpmath
import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from femsub.model import Expression, Factor, family_of
from femsub.model.intervals import RISING, UFUNCS, Interval, range_of
from femsub.stability import pencil_over

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


@pytest.mark.slow
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


@pytest.mark.parametrize("name", ["add", "sub", "mul", "truediv"])
def test_bounds_are_rounded_outwards(name: str) -> None:
    """Of single numbers: the exact result, a fraction, lies between the bounds, which are two or three roundings apart."""
    operation, rng = getattr(operator, name), np.random.default_rng(2)
    strict = 0
    for x, y in rng.standard_normal((300, 2)).tolist():
        exact, found = operation(Fraction(x), Fraction(y)), operation(Interval(x, x), y)
        assert Fraction(float(found.lo)) <= exact <= Fraction(float(found.hi))
        assert 0 < found.hi - found.lo <= 4 * np.spacing(abs(float(exact)))
        strict += operation(x, y) != exact
    assert strict > 100


@pytest.mark.parametrize("name", ["sqrt", "exp", "log", "sin", "cos", "tan", "tanh", "arctan", "cbrt", "sinh"])
def test_functions_are_rounded_outwards(name: str) -> None:
    """The value by 40 digits lies between the bounds of a single number."""
    function = getattr(mpmath, {"arctan": "atan"}.get(name, name))
    for x in np.random.default_rng(3).uniform(0.1, 50.0, 300).tolist():
        found = getattr(np, name)(Interval(x, x))
        with mpmath.workdps(40):
            assert float(found.lo) < function(mpmath.mpf(x)) < float(found.hi) or name == "tanh"


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


@pytest.mark.parametrize("pole", [lambda x: 1 / x, lambda x: x**-2, np.log, lambda x: np.tan(x + 1.5), lambda x: 1 / np.sin(x),
                                  lambda x: np.log(x - 0.25)])
def test_a_pole_between_the_bounds_is_an_error(pole: Callable[[Any], Any]) -> None:
    with pytest.raises(ZeroDivisionError):
        pole(Interval(0.0, 0.5))


def test_a_square_is_not_negative_and_a_range_below_zero_has_its_size() -> None:
    whole = Interval(np.array([0.0, -2.0]), np.array([1.0, -1.0]))
    assert (np.sqrt(whole * whole).lo >= [0.0, 0.999]).all() and (np.exp(-1000.0 * abs(whole)).lo == 0.0).all()
    assert abs(whole).lo.tolist() == [0.0, 1.0] and (whole**2).lo[0] == 0.0 and (-(whole**2)).hi[0] == 0.0
    assert (whole * whole * -1.0).hi[0] == 0.0


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


@pytest.mark.parametrize("law", [fs.StribeckArctan(eps=0.05), fs.StribeckArctanOdd(eps=0.05)])
def test_the_slope_of_a_friction_law_and_a_factor_of_a_scene_have_proved_ranges(law: fs.FrictionLaw) -> None:
    written = Factor(Expression("mu * (1 - speed / 40) + sqrt(speed) * exp(-speed)", "K[0]"), ("speed",), (("mu", 0.3),))
    family = fs.Affine(ONE, [(lambda speed: law.slope(speed), ONE)], [(written, ONE)])
    for ends in ((0.0, 0.3), (0.1, 2.0)):
        lo, hi, proved = family.factor_ranges({"speed": ends})
        values = np.array([family.factors(speed=p) for p in np.linspace(*ends, 200)])
        assert proved.all() and (lo <= values.min(axis=0)).all() and (values.max(axis=0) <= hi).all()
        assert (hi - lo <= 1.5 * np.ptp(values, axis=0)).all()


def test_a_factor_that_takes_no_interval_is_sampled() -> None:
    table = np.linspace(0, 3, 7) ** 2
    family = fs.Affine(ONE, None, [(lambda x: math.sin(40 * x), ONE), (lambda x: 2.0 if x > 1 else 1.0, ONE),
                                   (lambda x, y: y * float(np.interp(x, np.linspace(0, 3, 7), table)), ONE)])
    lo, hi, proved = family.factor_ranges({"x": (0.0, 3.0), "y": (-1.0, 2.0)})
    assert proved.tolist() == [True, False, False, False]
    assert (lo[1:] <= [-1.0, 1.0, -9.0]).all() and (hi[1:] >= [1.0, 2.0, 18.0]).all()
    assert (lo[1:] > [-1.3, 0.0, -13.0]).all() and (hi[1:] < [1.3, 3.1, 22.0]).all()
    looked_up = fs.Affine(ONE, None, [(lambda x: {"1.0": 5.0}.get(repr(x), 2.0), ONE)])  # asks what the argument is
    assert not looked_up.factor_ranges({"x": (1.0, 2.0)})[2][1] and looked_up.factor_ranges({"x": (1.0, 2.0)})[1][1] >= 5.0
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


def same_pencil(family: fs.Affine, model: Any, contacts: list[Any], ranges: dict[str, tuple[float, float]], tol: float = 1e-13,
                turns: int = 8) -> None:
    """The family's matrices at random values are those of the model under the changed contacts, to rounding."""
    rng = np.random.default_rng(7)
    for _ in range(turns):
        p = {name: float(rng.uniform(*ranges[name])) for name in family.parameters}
        changed = [replace(one, **{name: value for name, value in p.items() if hasattr(one, name)}) for one in contacts]
        exact, found = model.linearised(changed), family.at(**p)
        for name in "MDK":
            A, B = getattr(exact, name), getattr(found, name)
            assert abs(A - B).max() <= tol * abs(A).max(), (name, p)
        assert np.greater_equal(found.symmetric, exact.symmetric).all()


@dataclass(frozen=True)
class Turning:
    """C_D = (μ/Ω) d d^T + Ω G and C_K = k [[1, 0], [μ, 0]], with all of it declared."""

    ports: tuple[str, ...] = ("n", "t")
    k: float = 2.0
    mu: float = 0.3
    speed: float = 4.0

    affine: ClassVar[tuple[str, ...]] = ("k", "mu")
    affine_through: ClassVar[dict[str, Any]] = {"speed": (np.reciprocal, None)}

    def linearised(self, model: Any) -> tuple[Any, Any]:
        turned = np.array([[0.0, 1.0], [-1.0, 0.0]])
        return self.mu / self.speed * np.diag([1.0, 3.0]) + self.speed * turned, self.k * np.array([[1.0, 0.0], [self.mu, 0.0]])


def beam() -> fs.Substructure:
    part = fs.chain(20, belt=5)
    return fs.Substructure(part.M, part.K, 1e-3 * part.K, ports={"n": np.eye(20)[2], "t": np.eye(20)[7], "belt": np.eye(20)[11]})


RANGES = {"k": (0.5, 4.0), "mu": (0.0, 0.6), "speed": (2 * np.pi, 8 * np.pi)}


@pytest.mark.parametrize("names", [["mu"], ["speed"], ["k", "mu"], ["mu", "speed"], ["speed", "k", "mu"]])
def test_a_model_with_contacts_is_a_sum_over_their_parameters(names: list[str]) -> None:
    model, contacts, ranges = beam(), [Turning(), fs.Belt(slope=-0.1)], {name: RANGES[name] for name in names}
    family = family_of(model, contacts, names, ranges)
    assert set(family.parameters) == set(names) and family.size == 20
    same_pencil(family, model, contacts, ranges)
    assert pickle.loads(pickle.dumps(family)).at(**dict.fromkeys(names, 2.5)).K.shape == (20, 20)
    assert family.factor_ranges(ranges)[2].all()


def test_a_narrow_range_far_from_zero_costs_no_digits() -> None:
    """Constants are then differences of numbers a thousand times as large, which cancel in the sum at every value."""
    ranges = {"k": (1000.0, 1000.5), "mu": (0.6, 0.6003), "speed": (20.0, 20.1)}
    model, contact = beam(), Turning()
    family = family_of(model, contact, list(ranges), ranges)
    same_pencil(family, model, [contact], ranges)


def test_the_terms_are_those_of_the_formula_and_no_rounding() -> None:
    """μ/Ω, Ω and kμ, k: four matrices, each of the rank and the entries that the formula has."""
    family = family_of(beam(), Turning(), ["k", "mu", "speed"], RANGES)
    values = {"k": 3.0, "mu": 0.5, "speed": 10.0}
    assert [len(terms) for terms in (family.M, family.D, family.K)] == [1, 3, 3]
    np.testing.assert_allclose(sorted(family.factors(**values)), sorted([1.0, 1.0, 1.0, 0.05, 10.0, 3.0, 1.5]), rtol=1e-14)
    assert all(A.nnz <= 2 for _, A in (*family.D[1:], *family.K[1:]))
    assert "k" in [theta for theta, _ in family.K]


def test_contacts_share_a_term_and_what_has_no_parameter_stays_constant() -> None:
    model = beam()
    contacts = [fs.Belt(slope=-0.2, force=2.0), fs.Belt("n", slope=0.3, force=1.0), Turning()]
    family = family_of(model, contacts, ["force"], {"force": (0.0, 3.0)})
    assert [theta for theta, _ in family.D] == [1.0, "force"] and len(family.K) == 1 and family.affine_in("force")
    same_pencil(family, model, contacts, {"force": (0.0, 3.0)})
    idle = family_of(model, contacts[0], ["speed"], {"speed": (1.0, 2.0)})  # without a law it has no effect
    assert idle.parameters == ("speed",) and abs(idle.at(speed=1.5).D - model.linearised(contacts[0]).D).max() < 1e-15
    assert pencil_over(model, contacts[0], "speed").terms((1.0, 2.0)) == []
    law = fs.StribeckArctanOdd(eps=0.05)
    several = [fs.Belt("belt", 1.0, 0.5, law), fs.Belt("n", 2.0, 0.5, law), fs.Belt("t", 2.0, slope=-0.1)]
    ranges = {"speed": (0.2, 2.0), "force": (0.5, 3.0)}
    family = family_of(model, several, ["speed", "force"], ranges)
    assert len(family.D) == 3  # constant, force of the belt without a law, and force times the slope of both laws
    same_pencil(family, model, several, ranges)


def test_matrices_stay_sparse_and_symmetric_ones_symmetric() -> None:
    """A contact with many columns and a C_K that BLAS would make unsymmetric in the last digit."""
    rng = np.random.default_rng(5)
    W, A = rng.standard_normal((40, 13)), rng.standard_normal((2, 13, 13))

    @dataclass(frozen=True)
    class Pressed:
        ports: tuple[str, ...] = ("w",)
        p: float = 1.0
        q: float = 1.0
        affine = ("p", "q")

        def linearised(self, model: Any) -> tuple[Any, Any]:
            B, C = A + np.swapaxes(A, 1, 2)
            return None, sp.csr_array(B + self.p * C + self.p * self.q * np.outer(W[0], W[0]))

    model = fs.Substructure(sp.eye_array(40), fs.chain(40).K, ports={"w": W})
    family = family_of(model, Pressed(), ["p", "q"], {"p": (0.3, 1.7), "q": (1.0, 2.0)})
    assert len(family.K) == 3 and not family.D and all(sp.issparse(K) and abs(K - K.T).max() == 0 for _, K in family.K)
    same_pencil(family, model, [Pressed()], {"p": (0.3, 1.7), "q": (1.0, 2.0)})
    rom = fs.reduce(fs.Substructure(model.M, model.K, interface=[0, 39], ports=dict(model.ports)), fs.CraigBampton(6), ports=True)
    small = family_of(rom, Pressed(), ["p", "q"], {"p": (0.3, 1.7), "q": (1.0, 2.0)})
    assert small.cutoff == rom.cutoff and not any(sp.issparse(K) for _, K in small.K)
    same_pencil(small, rom, [Pressed()], {"p": (0.3, 1.7), "q": (1.0, 2.0)})


def test_changes_are_parameters_as_fields_of_contacts_are() -> None:
    """E and a mass are factors themselves, ν a function; values are the constants, and those of now give the model itself."""
    mesh, steel = fs.block((1.0, 0.2, 0.1), (5, 1, 1)), fs.Material(2.0, 0.3, 1.0)
    model = fs.solid(mesh, steel, supports=["left"], interface=["right"], rayleigh=(0.01, 0.02))
    changes = {name: fs.MaterialChange.solid(mesh, steel, name, rayleigh=(0.01, 0.02)) for name in ("E", "nu", "rho")}
    tip = [fs.AddedMass("right"), fs.AddedDamper("right", directions=["uz"])]
    for name, between, start in (("E", (1.0, 3.0), 2.0), ("nu", (0.2, 0.4), 0.3), ("rho", (0.5, 2.0), 1.0),
                                 ("tip", (0.0, 0.5), 0.0)):
        several = tip if name == "tip" else changes[name]
        family = fs.family_of(model, None, [name], {name: between}, {name: several})
        for value in (*between, start):
            given = [replace(one, amount=value - start) for one in (several if isinstance(several, list) else [several])]
            want, found = fs.modified(model, given), family.at(**{name: value})
            for key in "MDK":
                A, B = getattr(want, key), getattr(found, key)
                assert abs(A - B).max() <= 1e-13 * abs(A).max()
        assert family.factor_ranges({name: between})[2].all() and family.affine_in(name) == (name == "E")


def test_changes_of_a_family_are_refused_where_they_make_no_sense() -> None:
    sub, mesh, steel = fs.chain(5, belt=2), fs.block((1.0, 0.2, 0.1), (2, 1, 1)), fs.Material(2.0, 0.3, 1.0)
    solid, soft = fs.solid(mesh, steel, supports=["left"]), fs.MaterialChange.solid(mesh, steel, "E")
    lossy = fs.MaterialChange.solid(mesh, fs.Material(2.0, 0.3, 1.0, 0.1), "E")
    other = fs.MaterialChange.solid(mesh, fs.Material(3.0, 0.3, 1.0), "E")
    known = fs.family_of(sub, None, ["m"], {"m": (0, 1)}, {"m": fs.AddedMass([1])})
    for model, name, between, given, says in (
            (solid, "E", (-1.0, 3.0), {"E": soft}, "E must be positive"),
            (solid, "E", (1.0, 3.0), {"E": [soft, other]}, "different"),
            (solid, "E", (1.0, 3.0), {"E": lossy}, "structural"), (solid, "E", (1.0, 3.0), {"E": []}, "no changes"),
            (solid, "E", (1.0, 3.0), {"E": soft, "F": soft}, "unknown change 'F'"),
            (sub, "slope", (1.0, 3.0), {"slope": fs.AddedMass([1])}, "another name"),
            (known, "m", (0, 1), {"m": soft}, "an Affine")):
        with pytest.raises(fs.InputError, match=says):
            fs.family_of(model, fs.Belt(slope=-0.1) if name == "slope" else None, [name], {name: between}, given)


def test_a_term_that_is_rounding_of_others_is_none() -> None:
    @dataclass(frozen=True)
    class Cancelling(Turning):
        affine = ("k", "mu")

        def linearised(self, model: Any) -> tuple[Any, Any]:
            return None, np.array([[self.k, (self.mu + 300.0) - 300.0 - self.mu], [0.0, 0.0]])

    family = family_of(beam(), Cancelling(), ["k", "mu"], RANGES)
    assert [theta for theta, A in family.K if abs(A).max()] == [1.0, "k"] and family.parameters == ("k", "mu")


def test_a_false_declaration_shows_although_the_other_factor_is_0_at_the_end() -> None:
    """μ/Ω said to be affine in Ω, over μ from 0: where the range begins, there is nothing to see."""
    @dataclass(frozen=True)
    class Hidden(Turning):
        affine = ("mu", "speed")

    with pytest.raises(fs.InputError, match="affine in 'speed'"):
        family_of(beam(), Hidden(), ["mu", "speed"], {**RANGES, "mu": (0.0, 0.5)})


def test_what_a_contact_declares_is_asked_within_the_range() -> None:
    """Without friction a contact is affine in the speed, and over a range of μ it is not."""
    @dataclass(frozen=True)
    class Asking(Turning):
        @property
        def affine(self) -> tuple[str, ...]:  # type: ignore[override]
            return ("k", "mu", *(("speed",) if not self.mu else ()))

        affine_through = {"speed": (np.reciprocal, None)}  # noqa: RUF012

    same_pencil(family_of(beam(), Asking(mu=0.0), ["mu", "speed"], RANGES), beam(), [Asking()], RANGES)


def test_what_is_not_declared_or_not_true_is_refused() -> None:
    model, law = beam(), fs.StribeckArctan(eps=0.1)

    @dataclass(frozen=True)
    class Silent(Turning):
        """A subclass declares anew."""

    @dataclass(frozen=True)
    class Wrong(Turning):
        affine = ("k", "speed")
        affine_through = {"mu": lambda mu: mu**2}  # noqa: RUF012

    @dataclass(frozen=True)
    class Twice(Turning):
        affine_through = {"speed": (None, lambda speed: 2 * speed)}  # noqa: RUF012

    for contact, names, words in (
            (Silent(), ["speed"], r"Silent does not declare how .* 'speed'. .*{'speed': np.reciprocal}"),
            (Wrong(), ["speed"], r"affine in 'speed', but at .* off a straight line .* out of `affine`"),
            (Wrong(), ["k", "mu"], r"affine in functions of 'mu', but at .* off that .* out of `affine_through`"),
            (Twice(), ["speed"], r"functions of 'speed' in `affine_through` of Twice depend on each other"),
            (Turning(), ["pressure"], "unknown parameter 'pressure'"),
            (fs.Belt("n", 1.0, 0.5, law), ["mu"], "unknown parameter")):
        with pytest.raises(fs.InputError, match=words):
            family_of(model, contact, names, RANGES)
    with pytest.raises(fs.InputError, match="no range is given for mu"):
        family_of(model, Turning(), ["mu"], {})
    with pytest.raises(fs.InputError):
        family_of(model, Turning(), ["mu"], {"mu": (1.0, 1.0)})
    family = fs.Affine(ONE, None, [(1.0, ONE), ("mu", ONE), ("a", ONE)])
    assert family_of(family, None, ["mu", "a"], {}) is family
    for given, contacts, names, words in ((family, Turning(), ["mu", "a"], "no ports"),
                                          (family, None, ["mu"], "must have values"),
                                          (family, None, ["mu", "b"], "unknown parameter 'b'")):
        with pytest.raises(fs.InputError, match=words):
            family_of(given, contacts, names, RANGES)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_terms_over_one_parameter_give_every_pencil(sign: float) -> None:
    """θ(p) λ^q T of contacts that are affine in functions, the parameter with either sign; none where nothing is declared."""
    model, between = beam(), (5.0, 20.0)
    for contacts in ([Turning(), fs.Belt(slope=-0.1)], [fs.Belt("t", 2.0, 0.5, fs.StribeckArctan(eps=0.05)), Turning()]):
        over = replace(pencil_over(model, contacts, "speed"), sign=sign)
        ends = tuple(sorted(sign * p for p in between))
        terms = over.terms((ends[0], ends[1]))
        assert terms and not over.affine((ends[0], ends[1]))
        first, last = over(ends[0]), over(ends[1])
        for q, name in enumerate("KD"):
            moved = sum((theta(ends[1]) - theta(ends[0])) * T for power, T, theta in terms if power == q)
            difference = getattr(last, name) - getattr(first, name)
            assert abs(difference - moved).max() <= 1e-13 * abs(getattr(first, name)).max()

    @dataclass(frozen=True)
    class Silent(Turning):
        """A subclass declares anew."""

    assert pencil_over(model, Silent(), "speed").terms(between) is None


def test_a_law_with_one_slope_throughout_is_solved_value_by_value_and_a_family_over_it_refused() -> None:
    @dataclass(frozen=True)
    class Falling:
        def value(self, v: Any) -> Any:
            return 0.5 - 0.1 * np.asarray(v)

        def slope(self, v: Any) -> Any:
            return -0.1 + 0 * np.asarray(v)

    belt, between = fs.Belt("t", 1.0, 0.5, Falling()), (0.1, 1.0)
    assert pencil_over(beam(), belt, "speed").terms(between) is None
    with pytest.raises(fs.InputError, match="or one is constant"):
        family_of(beam(), belt, ["speed"], {"speed": between})

    @dataclass(frozen=True)
    class Wrong(Turning):
        affine = ("speed",)

    with pytest.raises(fs.InputError, match="off a straight line"):
        pencil_over(beam(), Wrong(), "speed").terms(between)
