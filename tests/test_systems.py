"""Systems whose parts are reduced one by one: the same joints, the forces in them, and the study over methods."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from test_coupling import cut, elastic

import femsub as fs
from femsub.modes.normal_modes import NormalModes, all_modes
from femsub.reduction import reduce as part_by_part
from femsub.reduction.reduce import METHODS

pytestmark = pytest.mark.filterwarnings("ignore::femsub.checks.PortWarning")  # every part has a port
BAND = (0.0, 0.35)
ROUNDING = 1e-9


def force_error(full: fs.System, reduced: fs.System, band: tuple[float, float]) -> float:
    return fs.modes.force_error(full, all_modes(full.K, full.M), reduced, all_modes(reduced.K, reduced.M), band)


def system(pieces: int = 3, n: int = 60) -> fs.System:
    parts, joints, _ = cut(n, pieces)
    return fs.couple(parts, joints)


def test_parts_are_reduced_one_by_one_and_joined_again() -> None:
    full = system()
    rom = fs.reduce(full, {"p0": fs.CraigBampton(3), "p2": fs.Rubin(2)})
    assert isinstance(rom, fs.System) and rom.parts["p1"] is full.parts["p1"] and rom.joints == full.joints
    assert isinstance(rom.parts["p0"], fs.ReducedSubstructure) and rom.parts["p2"].modes == 2
    assert {name: len(places) for name, places in rom.open.items()} == {name: len(places) for name, places in full.open.items()}
    kept = fs.couple(full.parts, full.joints, interface=[("p0", full.parts["p0"].interface.tolist())])  # the joined mass, too
    again = fs.reduce(kept, {"p0": fs.CraigBampton(3)})
    assert again.open["p0"].tolist() == kept.open["p0"].tolist() == [0, 1] and not len(again.open["p2"])
    assert list(rom.ports) == list(full.ports) and rom.cutoff == min(rom.parts[name].cutoff for name in ("p0", "p2"))
    with pytest.raises(fs.InputError, match="p3"):
        fs.reduce(full, {"p3": fs.CraigBampton(3)})
    with pytest.raises(fs.InputTypeError, match="System"):
        fs.reduce(fs.chain(5), {"chain": fs.CraigBampton(3)})  # type: ignore[call-overload]
    with pytest.raises(fs.InputError, match="contacts belong to one component"):
        fs.reduce(full, {"p0": fs.CraigBampton(3)}, contacts=fs.Belt(port="p0.belt", slope=-0.1))  # type: ignore[call-overload]


def test_what_is_collected_is_what_was_expanded() -> None:
    full = system()
    x = np.random.default_rng(1).standard_normal((full.size, 2)) + 1j
    np.testing.assert_allclose(full.collected(full.expand(x)), x, atol=1e-12)
    outer = fs.couple({"front": full, "back": fs.chain(4, fixed=False, interface=[1])},
                      [fs.Rigid(("front", [int(full.interface[-1])]), ("back", [0]))])
    x = np.random.default_rng(2).standard_normal((outer.size, 2))
    np.testing.assert_allclose(outer.collected(outer.expand(x)), x, atol=1e-12)
    dual = fs.couple(full.parts, cut(60, 3)[1], assembly="dual")
    moved = {name: np.ones(part.size) for name, part in dual.parts.items()}  # the joints hold in it; multipliers move nothing
    for name, u in dual.expand(dual.collected(moved)).items():
        np.testing.assert_allclose(u, moved[name], atol=1e-12)
    with pytest.raises(fs.InputError, match="the part 'p0' is reduced"):
        fs.reduce(full, {"p0": fs.CraigBampton(3)}).collected({})


@pytest.mark.parametrize(("call", "words"), [
    (lambda s: s.collected({"p0": np.ones(s.parts["p0"].size)}), "'p1'"),
    (lambda s: s.collected({name: np.ones(1) for name in s.parts}), "'p0'"),
    (lambda s: s.collected("x"), "u must be"),
    (lambda s: s.interface_forces([1.0, 2.0], np.ones((s.size, 3))), "each of omega"),
    (lambda s: s.interface_forces([1.0], np.ones((3, 1))), "rows"),
    (lambda s: fs.couple(s.parts, [fs.Rigid(("p0", [[0], [1, 2]]), ("p1", [0]))]), "whole numbers"),
    (lambda s: fs.couple(s.parts, [*s.joints, fs.Spring(("p1", [0]), ("p1", [0]), stiffness=1.0)]), "joined to itself"),
])
def test_what_does_not_fit_a_system_is_told(call: Callable[[fs.System], object], words: str) -> None:
    with pytest.raises((fs.InputError, fs.InputTypeError), match=words):
        call(system())


def test_forces_in_joints_balance_each_other_and_hold_the_parts() -> None:
    """Newton's third law at each joint; and of a spring cut in two, the force is k times its stretch."""
    full = system()
    modes = fs.normal_modes(full, count=6)
    found = full.interface_forces(modes.frequencies, modes.shapes)
    largest = max(np.abs(g).max() for g in found.values())
    for one, other in (("p0", "p1"), ("p1", "p2")):
        np.testing.assert_allclose(found[one][1], -found[other][0], atol=ROUNDING * largest)
    assert np.abs(found["p2"][-1]).max() < ROUNDING * largest  # the free end
    u = full.expand(modes.shapes)["p1"]
    part = full.parts["p1"]
    spring = -part.K[0, 1]
    np.testing.assert_allclose(found["p1"][0], -part.M[0, 0] * modes.eigenvalues * u[0] + spring * (u[0] - u[1]),
                               atol=ROUNDING * largest)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("key", ["craig-bampton", "craig-chang", "rubin", "dual-craig-bampton", "herting"])
def test_forces_become_those_of_the_full_system(key: str) -> None:
    """With more modes the error falls; with all of them it is rounding."""
    full = system(n=30)
    made = [fs.reduce(full, dict.fromkeys(full.parts, METHODS[key](count))) for count in (2, 4)]
    few, more = (force_error(full, rom, BAND) for rom in made)
    assert more < few / 3
    whole = {name: METHODS[key](len(part.interior) if METHODS[key].held else part.size - fs.normal_modes(part, count=1).rigid)
             for name, part in full.parts.items()}
    complete = fs.reduce(full, whole)
    np.testing.assert_allclose(elastic(complete), elastic(full), rtol=1e-9)
    assert force_error(full, complete, BAND) < 1e-7
    assert force_error(full, full, BAND) < ROUNDING and np.isnan(force_error(full, complete, (100.0, 200.0)))


@pytest.mark.slow
def test_a_study_of_a_system_compares_methods_part_by_part() -> None:
    full = system()
    methods = [dict.fromkeys(full.parts, fs.CraigBampton(4)), {"p0": fs.CraigBampton(8), "p1": fs.CraigBampton(6)},
               {"p0": fs.CraigBampton(3), "p2": fs.Rubin(2)}, fs.CraigBampton(6)]
    found = fs.study(full, methods, BAND, contacts=fs.Belt(port="p0.belt", slope=-0.1), repeats=1)
    assert [row.method for row in found.rows] == ["craig-bampton", "craig-bampton", "mixed", "craig-bampton"]
    assert [row.modes for row in found.rows] == [12, 14, 5, 6]
    assert found.rows[2].parts == {"p0": 3, "p2": 2} and found.rows[3].parts == {}
    assert found.full.error_force == 0 and all(0 < row.error_force < 1 for row in found.rows[:3])
    assert np.isnan(found.rows[3].error_force)  # joined first: there are no joints to compare
    assert all(row.mac > 0.5 and row.error_critical < 0.1 for row in found.rows)
    assert "err force" in str(found) and found.rows[2].flat()["modes_p2"] == 2
    words = found.recommendation(0.05)
    assert "in p0" in words or "in each part" in words
    assert "the forces in the joints are within" in words
    with pytest.raises(fs.InputTypeError, match="each of methods"):
        fs.study(full, [{"p0": 3}], BAND)  # type: ignore[dict-item]


def test_the_modes_of_the_full_system_are_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    full, solved = system(2, 20), []

    def counted(K: Any, M: Any, **carried: Any) -> NormalModes:
        solved.append(K is full.K)
        return all_modes(K, M, **carried)

    monkeypatch.setattr("femsub.modes.quadratic.matching.all_modes", counted)
    fs.study(full, [dict.fromkeys(full.parts, fs.CraigBampton(count)) for count in (2, 3, 4)], BAND, repeats=1)
    assert sum(solved) == 1  # not once more for each row


def test_frequencies_of_a_system_with_all_modes_have_the_full_ones_shapes() -> None:
    """A complete model has the full one's number of coordinates, but not its coordinates."""
    full = system(2, 20)
    whole = {name: fs.CraigBampton(len(part.interior)) for name, part in full.parts.items()}
    row = fs.study(full, [whole], (0.0, 1.0), contacts=fs.Belt("p0.belt", slope=0.0), repeats=1).rows[0]
    assert row.size == full.size and row.mac > 1 - 1e-9 and row.error_eigenvalue < 1e-9


def test_a_mode_that_leaves_the_joint_unloaded_is_no_error_of_100_percent() -> None:
    """Two equal parts: in symmetric modes nothing goes through the joint, and rounding is no force."""
    half = fs.chain(20, interface=[20], damping=0.0)
    full = fs.couple({"a": half, "b": half}, [fs.Rigid(("a", [19]), ("b", [19]))])
    modes = fs.normal_modes(full, count=4)
    load = np.abs(full.interface_forces(modes.frequencies, modes.shapes)["a"][0])
    assert (load[[0, 2]] < 1e-9 * load.max()).all() or (load[[1, 3]] < 1e-9 * load.max()).all()
    few, more = (force_error(full, fs.reduce(full, dict.fromkeys("ab", fs.CraigChang(count))), (0.0, 0.3)) for count in (3, 6))
    assert more < few < 0.2


@pytest.mark.slow
@pytest.mark.sampled(99)
@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", ["chain", "beam"])
def test_the_recommended_system_has_the_full_one_s_critical_slope(kind: str) -> None:
    """Damped parts under a belt, reduced part by part: at the recommended size the critical slope is within 0.1 %."""
    if kind == "chain":
        parts, joints, _ = cut(60, 3)
        full, band, port, force = fs.couple(parts, joints), BAND, "p0.belt", 1.0
    else:
        steel = {"E": 2.1e11, "I": 1e-8, "rho": 7850.0, "A": 1e-4}
        held = fs.beam(1.0, 20, **steel, supports={"left": "clamped"}, interface=["right"], rayleigh=(2.0, 1e-6),
                       ports={"belt": 0.5})
        loose = fs.beam(0.5, 12, **steel, interface=["left"], rayleigh=(2.0, 1e-6))
        full = fs.couple({"a": held, "b": loose}, [fs.Rigid(("a", "right"), ("b", "left"), tol=float("inf"))])
        omega = fs.normal_modes(full, count=6).frequencies
        band, port, force = (0.0, float(omega[4] + omega[5]) / 2), "a.belt", 100.0
    methods = [dict.fromkeys(full.parts, method(count)) for method in (fs.CraigBampton, fs.Rubin, fs.DualCraigBampton)
               for count in (2, 4, 8, 12)]
    found = fs.study(full, methods, band, contacts=fs.Belt(port=port, force=force, slope=-0.1), ports=True, repeats=1)
    best = found.recommended()
    assert best is not None and best.size < full.size
    assert best.error_critical < 1e-3 and best.error_force < 0.05


def test_a_warning_points_to_the_line_that_called() -> None:
    """Directly, part by part, and through a joint: the way inside femsub plays no role."""
    parts = {"a": fs.chain(5, belt=2, interface=[5]), "b": fs.chain(5, belt=3, interface=[1], fixed=False)}
    system = fs.couple(parts, [fs.Rigid(("a", [4]), ("b", [0]))])
    for call in (lambda: fs.reduce(parts["a"], fs.CraigBampton(1)), lambda: fs.reduce(system, {"a": fs.CraigBampton(1)})):
        with pytest.warns(fs.PortWarning) as told:
            call()
        assert {one.filename for one in told} == {__file__}


def test_equal_parts_are_found_without_comparing_each_with_each(monkeypatch: pytest.MonkeyPatch) -> None:
    compared = []
    equal = part_by_part._equal
    monkeypatch.setattr(part_by_part, "_equal", lambda one, other: compared.append(1) or equal(one, other))
    parts, joints, _ = cut(200, 20)
    full = fs.couple(parts, joints)
    fs.reduce(full, dict.fromkeys(parts, fs.CraigBampton(2)))
    assert not compared
    alike = {name: fs.chain(9, interface=[1, 9], fixed=False, name=name) for name in "abcd"}
    twins = fs.couple(alike, [fs.Rigid((one, [8]), (other, [0])) for one, other in itertools.pairwise("abcd")])
    rom = fs.reduce(twins, dict.fromkeys(alike, fs.CraigBampton(2)))
    assert len(compared) == 3 and all(part.V is rom.parts["a"].V for part in rom.parts.values())
