"""Friction laws: values and slopes of DESIGN, slopes against differences, the sign of the belt."""

from __future__ import annotations

import numpy as np
import pytest

import femsub as fs

LAWS = [fs.StribeckArctan(), fs.StribeckArctanOdd(), fs.StribeckArctan(eps=0.1), fs.StribeckArctanOdd(eps=0.1, drop=0.1)]


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_slope_is_the_derivative_of_the_value(law: fs.StribeckArctan) -> None:
    for v in (-0.7, -0.1, 0.05, 0.19113, 2.0):
        h = 1e-6 * abs(v)
        assert law.slope(v) == pytest.approx((law.value(v + h) - law.value(v - h)) / (2 * h), rel=1e-6)


def test_the_paper_s_law_is_not_odd_and_the_other_one_is() -> None:
    assert fs.StribeckArctan().value(0.0) == pytest.approx(0.2)
    assert fs.StribeckArctanOdd().value(0.0) == 0.0
    v = np.linspace(0.01, 2, 50)
    assert np.allclose(fs.StribeckArctanOdd().value(-v), -fs.StribeckArctanOdd().value(v), rtol=0, atol=1e-16)


@pytest.mark.parametrize(("law", "speed"), [(LAWS[0], 0.19113), (LAWS[0], 0.04400), (LAWS[1], 0.18388)])
def test_speeds_of_the_slope_in_fig_4(law: fs.StribeckArctan, speed: float) -> None:
    assert law.slope(speed) == pytest.approx(-0.2677, abs=6e-5)


def test_belt_linearises_onto_its_port() -> None:
    sub = fs.chain(10, belt=3, damping=0.1)
    pencil = sub.linearised(fs.Belt(force=2.0, slope=-0.05))
    expected = np.zeros((10, 10))
    expected[0, 0], expected[2, 2] = 0.1, -0.1
    assert np.array_equal(pencil.D.toarray(), expected)


def test_belt_takes_its_slope_from_the_law() -> None:
    belt = fs.Belt(port="belt", force=1.0, speed=0.1911, law=fs.StribeckArctan(eps=1e-3))
    assert belt.slope == fs.StribeckArctan().slope(0.1911)


@pytest.mark.parametrize(("arguments", "words"), [
    ({}, "needs a friction law"), ({"law": LAWS[0]}, "needs its speed"), ({"slope": np.nan}, "slope must be a finite"),
    ({"slope": -0.1, "force": -1.0}, "force must not be negative"), ({"law": LAWS[0], "speed": 0.2, "slope": 1.0}, "contradicts"),
])
def test_belt_refuses(arguments: dict, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        fs.Belt(**arguments)
    with pytest.raises(ValueError, match="eps must be positive"):
        fs.StribeckArctan(eps=0.0)
    with pytest.raises(TypeError, match="law must be a friction law"):
        fs.Belt(speed=0.2, law=0.3)  # type: ignore[arg-type]


class Table:
    """μ in a table that ends at v = 0.3."""

    def value(self, v: float) -> float:
        return {True: 0.4 - 0.1 * v}[bool(np.max(v) < 0.3)]

    def slope(self, v: float) -> float:
        return {True: -0.1}[bool(np.max(v) < 0.3)] + 0.0 * np.asarray(v)


class FastTable(Table):
    def scalar(self) -> tuple:
        return self.value, self.slope


@pytest.mark.parametrize("law", [Table(), FastTable()])
def test_what_a_law_raises_is_told_with_the_law_and_the_speed(law: Table) -> None:
    with pytest.raises(fs.InputError, match=r"Table.slope\(v\), of the friction law, fails at v = 0.5 with KeyError") as told:
        fs.Belt(speed=0.5, law=law)
    assert isinstance(told.value.__cause__, KeyError)
    belt, chain = fs.Belt(speed=0.1, law=law), fs.chain(4, belt=2)
    calls = (lambda: belt.exerted(None, np.array([-0.3])), lambda: belt.tangents(None, np.array([-0.3])),
             lambda: fs.transient(chain, belt, (0, 5), start=fs.State(np.zeros(4), np.full(4, -1.0))),
             lambda: fs.transient(chain, [belt], (0, 5), start=fs.State(np.zeros(4), np.full(4, -1.0)), method="alpha"),
             lambda: fs.critical_value(chain, belt, "speed", between=(0.1, 1.0)))
    for call in calls:
        with pytest.raises(fs.InputError, match=r"Table\.\w+\(v\), of the friction law, fails at v = .* with KeyError"):
            call()


def test_a_law_must_give_numbers() -> None:
    class Ends(Table):
        def value(self, v: float) -> float:
            return 0.4 - 0.1 * v if v < 0.2 else np.nan

    with pytest.raises(fs.InputError, match=r"Ends.value\(v\), of the friction law, is not a finite number near v = 0.2"):
        fs.Belt(speed=0.2, law=Ends())

    class Empty:
        def value(self, v: float) -> None: ...

        def slope(self, v: float) -> None: ...

    with pytest.raises(fs.InputTypeError, match=r"Empty.slope\(v\), of .* must be a number at v = 0.5, but is None"):
        fs.Belt(speed=0.5, law=Empty())


def test_a_very_wide_stick_slip_transition_is_no_overflow() -> None:
    for law in (fs.StribeckArctan(eps=1e308), fs.StribeckArctanOdd(eps=1e308)):
        assert fs.Belt(speed=0.2, law=law).slope == pytest.approx(law.scalar()[1](0.2))


class Sloped:
    def __init__(self, slope: float) -> None:
        self._slope = slope

    def value(self, v: float) -> float:
        return 0.3 - 0.1 * v

    def slope(self, v: float) -> float:
        return self._slope


class OnlySlope:
    def slope(self, v: float) -> float:
        return -0.1


def test_a_law_whose_slope_is_not_that_of_its_values_is_refused() -> None:
    assert fs.Belt(speed=0.2, law=Sloped(-0.1)).slope == -0.1
    for wrong in (0.1, -0.2, 0.0):
        with pytest.raises(fs.InputError, match="contradict"):
            fs.Belt(speed=0.2, law=Sloped(wrong))
    with pytest.raises(fs.InputTypeError, match=r"value\(v\)"):
        fs.Belt(speed=0.2, law=OnlySlope())  # type: ignore[arg-type]


@pytest.mark.parametrize("eps", [1e-12, 1e-3, 1.0, 1e6])
@pytest.mark.parametrize("speed", [1e-9, 1e-3, 0.19113, 1.0, 1e4, -0.2])
@pytest.mark.parametrize("law", [fs.StribeckArctan, fs.StribeckArctanOdd])
def test_the_laws_own_slopes_pass_at_every_scale(eps: float, speed: float, law: type[fs.StribeckArctan]) -> None:
    assert np.isfinite(fs.Belt(speed=speed, law=law(eps=eps)).slope)
