"""Branches of limit cycles: where they begin, folds and other points by name, and what has no branch."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

import femsub as fs
from femsub.motion.cycles.balance import Balance, Orbit
from femsub.motion.cycles.branch import Branch

LAW = fs.StribeckArctan(eps=1e-3)
BELT = fs.Belt(speed=0.19113, law=LAW)


def reduced(method: object, belt: int = 2) -> fs.Substructure:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        return fs.reduce(fs.chain(10, belt=belt), method)


def test_with_slope_gives_the_slope_asked() -> None:
    for law in (LAW, fs.StribeckArctanOdd(eps=1e-3)):
        for slope, speed in ((-0.2677, 0.19113), (-0.02, 0.5), (-0.1, -0.3)):
            made = law.with_slope(slope, speed)
            assert made.slope(speed) == pytest.approx(slope, rel=1e-12)  # NumPy's exp differs from math's by rounding
            assert made.scalar()[1](speed) == pytest.approx(slope, rel=1e-12)
            assert (made.eps, made.coulomb, made.decay) == (law.eps, law.coulomb, law.decay)
    with pytest.raises(fs.InputError, match="Choose another speed"):
        LAW.with_slope(-0.1, 0.0)


@pytest.mark.parametrize(("sub", "parameter", "between"), [
    (fs.chain(10, belt=2), "slope", (-0.1, -0.01)), (fs.chain(10, belt=3), "slope", (-0.1, -0.005)),
    (fs.chain(10, belt=6), "force", (0.005, 0.1)), (reduced(fs.CraigBampton(4)), "speed", (0.1, 3.0)),
    (reduced(fs.CraigChang(4), 4), "slope", (-0.1, -0.005)), (fs.chain(40, belt=5), "slope", (-0.1, -1e-4))])
def test_a_branch_starts_at_the_hopf_point(sub: fs.Substructure, parameter: str, between: tuple[float, float]) -> None:
    found = fs.branch(sub, BELT, parameter, between, points=4, stability=False)
    border = fs.critical_slope(sub)
    assert found.hopf is not None and found.hopf.error < 1e-6
    assert found.hopf.limit[1] == pytest.approx(border.omega, rel=1e-6)
    belt = {"slope": lambda value: value, "force": lambda value: value * BELT.slope,
            "speed": lambda value: float(LAW.slope(value))}[parameter]
    assert belt(found.hopf.limit[0]) == pytest.approx(float(border), rel=1e-6)


@pytest.mark.slow
def test_the_next_mode_has_a_branch_of_its_own_which_becomes_the_attractor() -> None:
    found = fs.branch(reduced(fs.CraigBampton(4)), BELT, "slope", (-0.2677, -0.01), start=0.73)
    assert found.hopf is not None and found.hopf.omega == pytest.approx(0.7321, abs=1e-4) and found.hopf.error < 1e-6
    assert found.hopf.supercritical is True and found.ended.startswith("the range ends")
    assert found.points[5].is_stable is False and found.points[-1].is_stable is True
    assert "Neimark-Sacker" in {point.kind for point in found.special}
    last = fs.harmonic_balance(reduced(fs.CraigBampton(4)), BELT)
    assert (found.omega[-1], found.rms[-1]) == pytest.approx((last.omega, last.rms), rel=1e-3)


@pytest.fixture(scope="module")
def over_speed() -> Branch:
    law = fs.StribeckArctan(eps=0.02)
    sub = fs.Substructure([[1.0]], [[1.0]], [[0.05]], ports={"belt": [1.0]})
    return fs.branch(sub, fs.Belt(speed=1.0, law=law), "speed", (0.2, 4.0), points=120)


@pytest.mark.slow
def test_one_oscillator_has_a_hard_onset_with_a_fold(over_speed: Branch) -> None:
    # F μ'(v0) = -0.05: from there an unstable cycle leads to higher speeds, and turns at a fold where stick-slip begins
    hopf = over_speed.hopf
    assert hopf is not None and hopf.supercritical is False and hopf.error < 1e-6 and hopf.omega == pytest.approx(1.0)
    folds = [point for point in over_speed.special if point.kind == "fold"]
    assert [point.kind for point in over_speed.special] == ["fold"] and folds[0].value > hopf.value
    assert folds[0].value == pytest.approx(over_speed.values.max(), rel=2e-3)
    top = int(np.argmax(over_speed.values))
    stable = over_speed.stable
    assert set(stable[3:top - 1]) == {False} and set(stable[top + 2:]) == {True}
    assert len(over_speed.at((hopf.value + folds[0].value) / 2)) == 2
    assert "fold" in repr(over_speed) and "\n" not in repr(over_speed)


@pytest.mark.slow
def test_a_branch_lists_no_cycle_twice(over_speed: Branch) -> None:
    top = int(np.argmax(over_speed.values))
    for at in (0, 5, top, len(over_speed.values) - 1):  # at the very value of a point, which ends one step and begins the next
        found = over_speed.at(float(over_speed.values[at]))
        assert sum(point is over_speed.points[at] for point in found) == 1
        assert len({id(point) for point in found}) == len(found)
    # just below the turn, where one point is the nearest of both passes
    value = over_speed.values[top] - 1e-3 * (over_speed.values[top] - over_speed.values[top - 1:top + 2].min())
    assert over_speed.at(float(value)) == [over_speed.points[top]]
    assert over_speed.at(float(over_speed.values.max() + 1.0)) == []


@pytest.mark.slow
def test_points_of_a_branch_are_cycles_of_their_own(over_speed: Branch) -> None:
    for at in (20, -5):
        point = over_speed.points[at]
        shot = fs.shoot(point.contact.model, point.contact.belts, point)
        assert (shot.omega, shot.rms) == pytest.approx((point.omega, point.rms), rel=1e-3)
        assert shot.is_stable is point.is_stable
        assert point.contact.belts[0].speed == pytest.approx(over_speed.values[at])
    rows = over_speed.rows()
    assert rows[0].keys() >= {"speed", "omega", "rms", "peak", "is_stable"} and len(rows) == len(over_speed.points)


@pytest.mark.slow
def test_period_doubling_is_named() -> None:
    sub = reduced(fs.CraigBampton(4))
    cycle = fs.harmonic_balance(sub, BELT, start=0.44)
    assert cycle.floquet is not None and cycle.floquet.values[0].real < -1.01
    found = fs.branch(sub, BELT, "speed", (0.12, 0.3), start=cycle, points=60)
    doubling = [point for point in found.special if point.kind == "period doubling"]
    assert doubling and all(abs(point.multiplier + 1) < 0.02 for point in doubling)
    assert found.values.min() < 0.19113 < found.values.max()


def test_where_no_simple_branch_begins_it_is_told() -> None:
    with pytest.raises(fs.InputError, match="pairs cross together"):
        fs.branch(fs.chain(10, belt=1), BELT)
    with pytest.raises(fs.InputError, match="pairs cross together"):
        fs.branch(fs.chain(10, belt=1), BELT, start=0.445)
    with pytest.raises(fs.InputError, match="undamped modes"):
        fs.branch(fs.chain(10, belt=2, damping=0.0), BELT)
    free = fs.Substructure(np.eye(2), np.eye(2), np.eye(2), ports={"belt": [0.0, 0.0]})
    with pytest.raises(fs.InputError, match="no Hopf point"):
        fs.branch(free, BELT)
    with pytest.raises(fs.InputError, match="no normal force"):
        fs.branch(fs.chain(10, belt=2), fs.Belt(speed=1e-4, law=LAW), "force")
    with pytest.raises(fs.InputError, match="Widen between"):
        fs.branch(fs.chain(10, belt=2), BELT, "speed", (0.1, 0.2))


@pytest.mark.parametrize(("belt", "arguments", "words"), [
    (BELT, ("sloep",), "did you mean 'slope'"), (BELT, ("slope", (-0.1, -0.2)), "lo < hi"),
    (BELT, ("slope", (-1.0, 1.0)), r"holds the slope 0, where no branch goes on.* such as \(-0.12.*, -0.0051"),
    (BELT, ("speed", (-1.0, 1.0)), "holds the speed 0, where no branch goes on: a belt at rest"),
    (BELT, ("slope", (-0.5, -0.1)), "Hopf point at slope = -0.0255.* is not within"),
    (BELT, ("force", (5.0, 7.0)), "is not within"),
    (BELT, ("force", (-1.0, 2.0)), "must not be negative"), (fs.Belt(speed=0.0, law=LAW), ("slope",), "at rest"),
    (fs.Belt(speed=0.19113, law=LAW, force=0.0), ("slope",), "normal force is zero"),
    (fs.Belt(slope=-0.1), ("slope",), "slope only")])
def test_bad_input_is_told(belt: fs.Belt, arguments: tuple, words: str) -> None:
    with pytest.raises(fs.InputError, match=words):
        fs.branch(fs.chain(10, belt=2), belt, *arguments)
    with pytest.raises(fs.InputError, match="floats"):
        fs.branch(fs.chain(10, belt=2, fixed=False), BELT)


def test_without_stability_no_multiplier_is_computed_whatever_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise AssertionError("a multiplier was computed")

    rom = reduced(fs.CraigBampton(4))
    with monkeypatch.context() as patch:
        patch.setattr("femsub.motion.cycles.limit_cycle.multipliers", refused)
        found = fs.branch(rom, BELT, "slope", (-0.1, -0.01), points=4, stability=False)
        assert "; stability not computed;" in repr(found) and "stable;" not in repr(found)
        assert set(found.stable) == {None} and {row["is_stable"] for row in found.rows()} == {None}
        assert "stability not computed" in repr(found.points[-1]) and found.points[-1].floquet is None
    later = replace(found.points[-1], stability=True)
    assert later.floquet is not None and "not computed" not in repr(later)


def test_a_cycle_of_another_contact_is_refused_as_a_start() -> None:
    chain = fs.chain(6, belt=2, damping=0.2)
    both = fs.Substructure(chain.M, chain.K, chain.D, [0], {"belt": np.eye(6)[:, [1, 4]]})
    belt = fs.Belt(speed=0.3, law=fs.StribeckArctan(eps=0.02))
    for model, other, words in ((chain, both, r"start: the cycle has 2 column\(s\) of contact, but .* has 1 .*Give a cycle"),
                                (both, chain, r"start: the cycle has 1 column\(s\) of contact, but .* has 2 .*Give a cycle")):
        cycle = fs.harmonic_balance(other, belt)
        with pytest.raises(fs.InputError, match=words):
            fs.branch(model, belt, "speed", (0.28, 0.31), start=cycle, stability=False)
        with pytest.raises(fs.InputError, match=words):
            fs.harmonic_balance(model, belt, start=cycle)


def test_a_branch_from_a_cycle_uses_no_more_harmonics_than_allowed() -> None:
    model = fs.chain(10, belt=2)
    belt = fs.Belt(speed=0.3, law=fs.StribeckArctan(eps=1e-2))
    found = fs.harmonic_balance(model, belt, start=1.0)
    path = fs.branch(model, belt, "speed", (0.29, 0.31), start=found, harmonics=20, points=6, tol=1e-1, stability=False)
    assert found.orbit.harmonics > 20 >= max(point.orbit.harmonics for point in path.points)


def test_what_a_point_leaves_out_is_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Orbit] = []
    plain = Balance.unresolved

    def counted(self: Balance, orbit: Orbit, target: float = 0.0) -> tuple[float, float, int]:
        asked.append(orbit)
        return plain(self, orbit, target)

    monkeypatch.setattr(Balance, "unresolved", counted)
    found = fs.branch(reduced(fs.CraigBampton(4)), BELT, "slope", (-0.1, -0.01), points=8, stability=False)
    assert len(asked) >= len(found.points) == 8 and len({id(orbit) for orbit in asked}) == len(asked)
    monkeypatch.undo()
    for point in found.points:  # one turned in phase: the same to rounding, and to the samples of that phase
        assert point.truncation == pytest.approx(plain(Balance(point.contact, point.flexibility), point.orbit)[0], rel=1e-3)
