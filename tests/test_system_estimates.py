"""What the reductions of all parts cost their system: bounds, estimates, the choice of modes, and refinement by the parts."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from randomsystems import Case, random_system
from systemerrors import fewest, moving, of_lambda, of_omega
from test_coupling import cut

import femsub as fs
from femsub.algebra import factor
from femsub.model.estimate import Estimate
from femsub.modes.normal_modes import all_modes
from femsub.modes.quadratic import full_solve
from femsub.reduction.estimates import nested as nested_estimates
from femsub.reduction.estimates.joined import JoinedSpace, held_statics
from femsub.reduction.estimates.leaving_out import LeavingOut
from femsub.reduction.estimates.nested import JOINED_RESIDUAL, Nested

pytestmark = pytest.mark.filterwarnings("ignore::femsub.checks.PortWarning")
TOL = 1e-3
ROUNDING = 1e-9
SEEDS = (0, 3, 5, 6, 9, 11, 17, 21)  # 2 to 5 parts of all kinds, held and floating, damped or not, with springs between them


def together(case: Case, tol: float = TOL, kind: type = fs.CraigBampton) -> fs.System:
    return fs.reduce(case.system, dict.fromkeys(case.system.parts, kind(band=case.band, tol=tol)), contacts=case.belt)


def check(case: Case, rom: fs.System, estimate: Estimate, most: float = 10.0) -> float:
    """The largest true error. Each is below its bound or estimate, but for rounding, and not far below."""
    modes = all_modes(rom.K, rom.M, JOINED_RESIDUAL)
    error = of_omega(case, modes.frequencies[modes.rigid:])
    room = ROUNDING + case.rounding[:len(error)]
    told = estimate.frequency_error[:len(error)]
    assert (error <= told + room).all() and (told <= most * error + 10 * room).all() and not estimate.unmatched
    worst = float(error.max())
    if case.damped:
        error, found = of_lambda(case, moving(case.system, case.belt), moving(rom, case.belt))
        for value, one in zip(found, error, strict=True):
            mine = estimate.eigenvalue_error[np.abs(estimate.eigenvalues - value) <= 1e-7 * np.abs(value)].max()
            assert one <= mine + ROUNDING and mine <= most * one + 10 * ROUNDING
        worst = max(worst, float(error.max()))
    return worst


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_system_meets_its_tolerance_with_few_modes(seed: int) -> None:
    case = random_system(seed)
    rom = together(case)
    assert rom.estimate is not None and rom.estimate.met and rom.estimate.tol == TOL
    assert check(case, rom, rom.estimate) <= TOL
    assert rom.cutoff > case.band[1] and rom.estimate.cutoff == rom.cutoff
    chosen = np.array([part.modes for part in rom.parts.values()])  # type: ignore[attr-defined]
    assert rom.estimate.modes == chosen.sum()
    full = moving(case.system, case.belt) if case.damped else None
    assert chosen.sum() <= 1.3 * fewest(case, full, chosen, TOL)[0]


@pytest.mark.sampled(10)
@pytest.mark.parametrize("kinds", [(fs.CraigBampton, fs.Rubin), (fs.CraigChang, fs.Herting), (fs.MacNeal, fs.CraigBampton),
                                   (fs.DualCraigBampton,)])
@pytest.mark.parametrize("seed", [6, 9, 14, 23])
def test_what_any_methods_cost_a_system(seed: int, kinds: tuple[Callable[[int], fs.CraigBampton], ...]) -> None:
    case = random_system(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.FemsubWarning)
        rom = fs.reduce(case.system, {name: kinds[i % len(kinds)](8) for i, name in enumerate(case.system.parts)})
        found = fs.system_estimate(case.system, rom, case.band, case.belt)
    assert found.share == 1.0 and found.modes == 8 * len(rom.parts)
    check(case, rom, found, most=1e4)  # these bases may be nearer to the full system than what they are compared with


@pytest.mark.slow
def test_the_bounds_hold_however_little_is_known() -> None:
    """Nothing but ten modes of each part, and all shapes that stand for the rest."""
    for seed in range(6):
        case = random_system(seed)
        statics = {name: held_statics(part) for name, part in case.system.parts.items()}
        nested = JoinedSpace(case.system, statics).reference().nested
        known = np.flatnonzero(case.omega < 0.9 * nested.cutoff(nested.most))
        known = known[known < len(nested.bounds)]
        assert (nested.bounds[known] <= case.omega[known] * (1 + ROUNDING + case.rounding[known])).all()


def system(pieces: int = 3, n: int = 60, fixed: bool = True) -> fs.System:
    parts, joints, _ = cut(n, pieces, fixed)
    return fs.couple(parts, joints)


@pytest.mark.slow
def test_a_tolerance_takes_fewer_modes_than_one_limit_for_all_parts() -> None:
    """Modes of all parts up to one frequency, the lowest that will do, are many more in all."""
    counts = []
    for seed in (9, 14, 21):
        case = random_system(seed)
        rom = together(case)
        chosen = np.array([part.modes for part in rom.parts.values()])  # type: ignore[attr-defined]
        counts.append((chosen.sum(), fewest(case, None, chosen, TOL)[2]))
    ours, rule = np.sum(counts, axis=0)
    assert rule > 1.3 * ours


def test_parts_that_stay_and_given_numbers_of_modes() -> None:
    full = system(4)
    method = fs.CraigBampton(band=(0.0, 0.3), tol=TOL)
    exact = fs.normal_modes(full, band=(0.0, 0.3)).frequencies
    for methods in ({"p0": method, "p2": method}, {"p0": method, "p1": fs.CraigBampton(12), "p2": method, "p3": fs.Hurty(11)}):
        rom = fs.reduce(full, methods)
        assert rom.estimate is not None and rom.estimate.met
        given = {name: one.modes for name, one in methods.items() if one.modes}
        assert given == {name: rom.parts[name].modes for name in given}  # type: ignore[attr-defined]
        error = fs.normal_modes(rom, count=len(exact)).frequencies / exact - 1
        assert (error <= rom.estimate.frequency_error).all() and rom.estimate.frequency_error.max() <= TOL
    assert rom.with_damping(None).estimate is None and rom.with_parts({}).estimate is None
    assert replace(rom.estimate, band=(0.0, 1.01 * rom.cutoff)).met is False
    assert Estimate.of_record(rom.estimate.record()).share == 1.0


@pytest.mark.slow
def test_ports_and_contacts_of_a_system() -> None:
    full, belt = system(), fs.Belt(port="p1.belt", slope=-0.05)
    methods = dict.fromkeys(full.parts, fs.Hurty(band=(0.0, 0.35), tol=TOL))
    for contacts in (belt, [belt], fs.LinearContact(("p1.belt",), damping=[[-0.05]])):
        rom = fs.reduce(full, methods, ports=True, contacts=contacts)
        assert rom.estimate is not None and rom.estimate.met and len(rom.estimate.eigenvalues)
        exact, found = (fs.complex_modes(model, contacts, band=(0.0, 0.35)).eigenvalues for model in (full, rom))
        assert (np.abs(exact - found) <= TOL * np.abs(exact)).all()
    for contact in (fs.LinearContact(("p1.belt",), stiffness=[[1.0]]),
                    fs.LinearContact(("p0.belt", "p1.belt"), damping=[[1.0, 0.0], [0.0, 1.0]])):
        with pytest.raises(fs.InputError, match="contacts that add to D"):
            fs.reduce(full, methods, contacts=contact)


BOTH = fs.CraigBampton(band=(0.0, 0.3), tol=TOL)


@pytest.mark.parametrize(("methods", "words"), [
    ({"p0": BOTH, "p1": fs.CraigBampton(band=(0.0, 0.2), tol=TOL)}, "same for all parts"),
    ({"p0": BOTH, "p1": fs.CraigBampton(band=(0.0, 0.3), tol=1e-2)}, "same for all parts"),
    ({"p0": BOTH, "p1": fs.CraigChang(4)}, "system_estimate"),
    ({"p0": fs.Rubin(band=(0.0, 0.3), tol=TOL)}, "system_estimate"),
    ({"p0": BOTH, "p1": fs.Guyan(2)}, "system_estimate"),
])
def test_what_a_system_cannot_be_asked_is_told(methods: dict[str, fs.CraigBampton], words: str) -> None:
    with pytest.raises(fs.InputError, match=words):
        fs.reduce(system(), methods)


def test_a_tolerance_that_is_not_met_is_told() -> None:
    full = system()
    with pytest.raises(fs.NotConvergedError, match="give more modes to 'p1'"):
        fs.reduce(full, {"p0": BOTH, "p1": fs.CraigBampton(0), "p2": BOTH})
    with pytest.raises(fs.NotConvergedError, match="Rounding alone"):
        fs.reduce(full, dict.fromkeys(full.parts, fs.CraigBampton(band=(0.0, 0.3), tol=1e-17)))


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_rounding_between_stiff_and_soft_parts_is_told_in_any_unit(unit: float) -> None:
    soft = fs.chain(9, interface=[7, 8, 9])
    bar = fs.chain(9, interface=[1, 2, 3, 5, 7], fixed=False)

    def goal(contrast: float) -> fs.System:
        parts = {"soft": fs.Substructure(soft.M, unit**2 * soft.K, interface=soft.interface),
                 "stiff": fs.Substructure(bar.M, unit**2 * contrast * bar.K / 3, interface=bar.interface)}
        full = fs.couple(parts, [fs.Rigid(("soft", [8]), ("stiff", [0]))])
        return fs.reduce(full, dict.fromkeys(parts, fs.CraigBampton(band=(0.0, 0.3 * unit), tol=1e-3)))

    assert goal(1e6).estimate is not None
    with pytest.raises(fs.NotConvergedError, match="Rounding alone"):
        goal(1e13)


def test_a_point_mass_is_a_part() -> None:
    parts = {"bar": fs.chain(20, interface=[20]), "mass": fs.Substructure([[3.0]], [[0.0]], interface=[0])}
    full = fs.couple(parts, [fs.Rigid(("bar", [19]), ("mass", [0]))])
    rom = fs.reduce(full, dict.fromkeys(parts, fs.CraigBampton(band=(0.0, 0.3), tol=1e-3)))
    exact, found = (fs.normal_modes(one, count=2).frequencies for one in (full, rom))
    assert rom.estimate is not None and rom.estimate.met
    assert np.abs(found / exact - 1).max() <= 1e-3


def test_systems_without_an_estimate_are_told() -> None:
    full = system()
    sprung = fs.couple(full.parts, [*full.joints, fs.Spring(("p1", "belt"), stiffness=1.0)])
    rom = fs.reduce(sprung, {"p1": fs.CraigBampton(4)})
    with pytest.raises(fs.InputError, match="port inside 'p1'"):
        fs.system_estimate(sprung, rom, (0.0, 0.3))
    for other, words in ((system(2), "missing in one of them"), (full, "no part of 'system' is reduced")):
        with pytest.raises(fs.InputError, match=words):
            fs.system_estimate(full, other, (0.0, 0.3))
    with pytest.raises(fs.InputError, match="at most"):
        long = fs.couple({"a": fs.chain(4000, interface=[4000]), "b": fs.chain(9, interface=[1], fixed=False)},
                         [fs.Rigid(("a", [3999]), ("b", [0]))])
        fs.system_estimate(long, fs.reduce(long, {"b": fs.CraigBampton(3)}), (0.0, 1e-3))


def test_a_system_is_estimated_from_the_factors_of_its_parts() -> None:
    full = system(3, 900)
    rom = fs.reduce(full, dict.fromkeys(full.parts, fs.CraigBampton(6)))
    before = factor.SparseFactor.made
    sizes: list[int] = []
    made = factor.factorise

    def counted(A: Any, kind: Any) -> Any:
        sizes.append(A.shape[0])
        return made(A, kind)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(factor, "factorise", counted)
        found = fs.system_estimate(full, rom, (0.0, 0.01))
    assert found.worst < 1e-2 and factor.SparseFactor.made >= before
    assert max(sizes, default=0) < 250  # dense ones of the joined model


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", SEEDS)
def test_refined_by_the_parts(seed: int) -> None:
    case = random_system(seed)
    kinds = (fs.CraigBampton, fs.Rubin) if seed % 2 else (fs.CraigBampton,)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.FemsubWarning)
        rom = fs.reduce(case.system, {name: kinds[i % len(kinds)](8) for i, name in enumerate(case.system.parts)})
        modes = fs.complex_modes(rom, case.belt, band=case.band)
        found = fs.refine(case.system, modes, rom, case.belt)
    exact = fs.complex_modes(case.system.linearised(case.belt).dense())
    assert not found.whole and "through the parts" in repr(found)
    assert found.modes.backward_error.max() < 1e-8
    for value, rigid in zip(found.modes.eigenvalues, found.modes.rigid, strict=True):
        near = np.abs(exact.eigenvalues - value)
        assert rigid or near.min() <= 1e-6 * abs(value) + 100 * exact.error_bar[near.argmin()]


def plates() -> fs.System:
    parts = {f"p{i}": fs.plate(fs.rectangle((0.5, 0.4), (10, 6)), E=2.1e11, nu=0.3, rho=7850.0, thickness=0.01 + 0.002 * i,
                               interface=["left", "right"] if i else ["right"], supports={} if i else {"left": "clamped"},
                               rayleigh=(2.0, 1e-6), name=f"p{i}") for i in range(3)}
    return fs.couple(parts, [fs.Rigid((f"p{i}", "right"), (f"p{i + 1}", "left"), tol=np.inf) for i in range(2)])


def test_refinement_factorises_nothing_large(monkeypatch: pytest.MonkeyPatch) -> None:
    full = plates()
    band = (0.0, 1000.0)
    rom = fs.reduce(full, dict.fromkeys(full.parts, fs.CraigBampton(4)))
    modes = fs.complex_modes(rom, band=band)
    sizes: list[int] = []
    made = factor.factorise

    def counted(A: Any, kind: Any) -> Any:
        sizes.append(A.shape[0])
        return made(A, kind)

    monkeypatch.setattr(factor, "factorise", counted)
    found = fs.refine(full, modes, rom)
    inside = min(len(part.interior) for part in full.parts.values())
    assert found.factorisations == 0 and not found.whole and max(sizes, default=0) < inside < full.size / 3
    monkeypatch.setattr(full_solve, "_against", lambda full: "for the test")
    by_whole = fs.refine(full, modes, rom)
    assert by_whole.whole == "for the test" and max(sizes) == full.size and "parts" not in repr(by_whole)
    np.testing.assert_allclose(found.modes.eigenvalues, by_whole.modes.eigenvalues, rtol=1e-8)
    assert (found.moved > 1e-6 * np.abs(found.reduced)).any()


def test_where_the_parts_cannot_serve_the_whole_does_and_that_is_said() -> None:
    full = system()
    sprung = fs.couple(full.parts, [*full.joints, fs.Spring(("p1", "belt"), stiffness=1.0)])
    loose = fs.couple({"a": fs.beam(1.0, 9, E=1.0, I=1.0, rho=1.0, A=1.0, supports={"left": "clamped"}, interface=["right"]),
                       "b": fs.beam(1.0, 9, E=1.0, I=1.0, rho=1.0, A=1.0, interface=["left"])},
                      [fs.Rigid(("a", "right"), ("b", "left"), tol=np.inf)])
    pinned = fs.Substructure(loose.parts["b"].M, loose.parts["b"].K, interface=[0])
    loose = fs.couple({"a": loose.parts["a"], "b": pinned}, [fs.Rigid(("a", [16]), ("b", [0]))])
    for one, words in ((sprung, "port inside 'p1'"), (loose, "does not hold 'b'")):
        rom = fs.reduce(one, dict.fromkeys(one.parts, fs.Rubin(4)))
        found = fs.refine(one, fs.complex_modes(rom, count=4), rom)
        assert words in found.whole
    with pytest.raises(fs.InputError, match="does not hold"):
        fs.system_estimate(loose, rom, (0.0, 1.0))


def test_refinement_that_does_not_converge_says_so() -> None:
    full = plates()
    rom = fs.reduce(full, dict.fromkeys(full.parts, fs.CraigBampton(0)))
    with pytest.raises(fs.NotConvergedError, match="after 1 steps"):
        fs.refine(full, fs.complex_modes(rom, count=20), rom, which=range(20), steps=1)


def test_the_parts_solve_what_the_whole_would() -> None:
    full, free = plates(), system(fixed=False)
    for one, kind in ((full, fs.CraigBampton), (full, fs.Rubin), (free, fs.Hurty)):
        by = full_solve.ByParts(one, fs.reduce(one, dict.fromkeys(one.parts, kind(4))))
        B = np.random.default_rng(4).standard_normal((one.size, 3))
        X = by.solve(B)
        size = abs(one.K) @ abs(X)
        assert (np.abs(by.product(X) - B) <= 1e-9 * size.max(axis=0)).all()
        (mass, *own) = by.terms(one.M)  # P(0) - A: the small matrix that is added to K, less
        added = -sum(part.weights[0] * (X.T @ (part.matrix @ X)) for part in (mass, *own))
        np.testing.assert_allclose(added, X.T @ (by.product(X) - one.K @ X), rtol=1e-6, atol=1e-9 * np.abs(
            X.T @ (one.K @ X)).max())


@pytest.mark.slow
def test_the_drift_of_a_free_system_is_estimated_and_its_rigid_motion_is_no_mode() -> None:
    sub = fs.beam(1.0, 8, E=2e11, I=1e-6, rho=7850.0, A=1e-2)
    D = 1e-8 * sub.K.toarray()
    D[4, 4] += 1e-4
    parts = {"a": fs.Substructure(sub.M, sub.K, D, [0, 1, 16, 17]), "b": fs.Substructure(sub.M, sub.K, None, [0, 1, 16, 17])}
    full = fs.couple(parts, [fs.Rigid(("a", [17]), ("b", [1]))])  # by slopes alone: 3 rigid motions
    exact = fs.normal_modes(full, count=2)
    assert exact.rigid == 3
    for method in (fs.Guyan(), fs.Hurty(3), fs.CraigChang(3), fs.Rubin(3), fs.Herting(3), fs.DualCraigBampton(3)):
        rom = fs.reduce(full, {"a": method, "b": method})
        estimate = fs.system_estimate(full, rom, (0.0, 1.05 * float(exact.frequencies[-1])))
        assert estimate.frequencies[0] == pytest.approx(exact.frequencies[3], rel=1e-2)
        slow = estimate.eigenvalues[np.abs(estimate.eigenvalues) < 1.0]
        assert len(slow) == 1 and slow[0].imag == 0 and -1e-4 < slow[0].real < 0


@pytest.mark.slow
def test_the_models_that_are_solved_do_not_grow_with_the_number_of_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """One by one, fewer modes of each part are tried; nearly all of these models are known to be too small without a solution."""
    solved, damped = [], []
    undamped, complex_ = Nested.undamped, Nested._solved
    monkeypatch.setattr(Nested, "undamped", lambda self, count: solved.append(1) or undamped(self, count))
    monkeypatch.setattr(Nested, "_solved", lambda self, T: damped.append(1) or complex_(self, T))
    for pieces in (6, 24):
        full = system(pieces, 15 * pieces)
        solved.clear()
        damped.clear()
        rom = fs.reduce(full, dict.fromkeys(full.parts, fs.CraigBampton(band=(0.0, 0.3), tol=TOL)))
        assert rom.estimate is not None and rom.estimate.met
        assert len(solved) <= 20 and len(damped) <= 8


@pytest.mark.sampled(5)
@pytest.mark.parametrize("ports", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_no_model_that_meets_the_tolerance_is_passed_over(seed: int, ports: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    may_meet = LeavingOut.may_meet

    def checked(self: LeavingOut, counts: np.ndarray) -> bool:
        found = may_meet(self, counts)
        omega = self.nested.undamped(counts)[0]
        most = np.sqrt(self.most)
        too_high = (np.pad(omega, (0, len(most)), constant_values=np.inf)[self.first:self.first + len(most)] > most).any()
        asked.append((found, bool(too_high)))
        assert found or too_high
        return found

    monkeypatch.setattr(LeavingOut, "may_meet", checked)
    case = random_system(seed)
    fs.reduce(case.system, dict.fromkeys(case.system.parts, fs.CraigBampton(band=case.band, tol=TOL)), contacts=case.belt,
              ports=ports)
    assert sum(found and too_high for found, too_high in asked) <= 0.1 * len(asked)  # and hardly one is solved in vain


@pytest.mark.slow
def test_lower_bounds_by_lanczos_are_those_of_lapack(monkeypatch: pytest.MonkeyPatch) -> None:
    """And those of all Ritz modes, of which they need none."""
    for full, top in ((system(12, 180), 0.3), (system(12, 180, fixed=False), 0.3), (plates(), 1000.0)):
        space = JoinedSpace(full, {name: held_statics(part) for name, part in full.parts.items()}, None, top)
        space.reach(top)
        given = space.reference().nested
        found = [replace(given, limit=np.inf).bounds]
        with monkeypatch.context() as patched:
            patched.setattr(nested_estimates, "all_modes", None)
            for least in (0, 10**6):
                patched.setattr(nested_estimates, "WIDE", least)
                found.append(replace(given).bounds)
        by_modes, few, every = found
        assert len(by_modes) == len(every)
        np.testing.assert_allclose(every, by_modes, rtol=1e-7)
        assert len(few) < len(every) / 2 and every[len(few)] > 1.1 * top  # all up to the end of the band, by Lanczos
        np.testing.assert_allclose(few, every[:len(few)], rtol=1e-9)
