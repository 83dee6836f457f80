"""Modes to a tolerance: bounds that hold, estimates near the true error, no more modes and factorisations than needed."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from reducedproblems import GALLERY, Problem, positive, quick, statics

import femsub as fs
from benchmarks.lattices import lattice
from femsub.algebra.factor import inertia
from femsub.algebra.petsc import SparseFactor
from femsub.model.bands import doubled, within
from femsub.model.estimate import SHARE
from femsub.modes import match, normal_modes
from femsub.modes.normal_modes import lowest_modes
from femsub.modes.shift_invert import ShiftInvert
from femsub.reduction.estimates.found_modes import FoundModes
from femsub.reduction.estimates.nested import FAR, Nested
from femsub.reduction.estimates.search import Space

paired = partial(match, far=FAR)

CASES = [(problem, kind) for problem in quick() for kind in problem.kinds]
NAMES = [f"{problem.name}-{kind.__name__}" for problem, kind in CASES]


def reduced(problem: Problem, kind: type, tol: float) -> fs.ReducedSubstructure:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        return fs.reduce(problem.sub, kind(band=problem.band, tol=tol), ports=problem.ports, contacts=problem.belt)


def errors(problem: Problem, omega: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """True relative errors of ω and of λ over all that the full model has in the band."""
    full = problem.eigenvalues
    at, to = paired(full, values)
    wrong = np.full(len(full), np.inf)
    wrong[at] = np.abs(values[to] - full[at]) / np.abs(full[at])
    return np.abs(omega[:len(problem.omega)] / problem.omega - 1), wrong[within(full, problem.band)]


def nested(problem: Problem, kind: type, known: int) -> Nested:
    sub = problem.sub
    extra = sub.ports["belt"][:, None] if problem.ports else np.zeros((sub.size, 0))
    space = Space(sub.name, {"": FoundModes(statics(kind, sub, extra), sub.linearised(problem.belt), known)})
    return space.extended(space.reference(), problem.band)


@pytest.mark.sampled(12)
@pytest.mark.parametrize("tol", [1e-2, 1e-3, 1e-4, 1e-6])
@pytest.mark.parametrize(("problem", "kind"), CASES, ids=NAMES)
def test_what_was_asked_is_what_the_full_model_confirms(problem: Problem, kind: type, tol: float) -> None:
    rom = reduced(problem, kind, tol)
    modes = fs.normal_modes(rom, band=(0.0, 1.2 * problem.band[1]))
    omega, values = errors(problem, modes.frequencies[modes.rigid:], positive(rom.linearised(problem.belt)))
    assert len(omega) == len(problem.omega) and max(omega.max(), values.max()) <= tol
    estimate = rom.estimate
    assert estimate.met and estimate.worst <= tol and problem.band[1] < SHARE * rom.cutoff
    assert estimate.cutoff == rom.cutoff and estimate.modes == rom.modes
    assert len(estimate.frequencies) == len(problem.omega) and len(estimate.eigenvalues) >= len(values)
    assert estimate.worst >= 0.99 * max(omega.max(), values.max()) - 1e-10


def effectivity(problem: Problem, model: Nested, count: int) -> np.ndarray:
    """Estimate over true error of the worst ω and the worst λ in the band, where these are not rounding."""
    found = model.estimate(count, problem.band, 1e-3)
    values, full = model.damped(count)[0], problem.eigenvalues
    at, to = paired(full, values)
    near = np.isin(found.eigenvalues, values[to[within(full[at], problem.band)]])
    true = errors(problem, model.undamped(count)[0], values)
    return np.array([guess.max() / error.max() for guess, error in
                     zip((found.frequency_error, found.eigenvalue_error[near]), true, strict=True) if error.max() > 1e-10])


def fair(share: np.ndarray) -> bool:
    return bool(((share >= 0.99) & (share <= 10)).all())


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("problem", "kind"), CASES, ids=NAMES)
def test_the_estimate_is_near_the_error_with_one_mode_more_known(problem: Problem, kind: type) -> None:
    model = fixed(problem) if kind is fs.CraigBampton else problem.sub
    modes = fs.normal_modes(model, count=problem.sub.size // 2)
    least = int(np.searchsorted(SHARE * modes.frequencies[modes.rigid:], problem.band[1], side="right"))
    for count in (least, least + 3):
        share = effectivity(problem, nested(problem, kind, count + 1), count)
        assert fair(share), share


def fixed(problem: Problem) -> fs.Substructure:
    i = problem.sub.interior
    return fs.Substructure(problem.sub.M[i][:, i], problem.sub.K[i][:, i])


def test_a_broken_estimate_is_found_out() -> None:
    problem = quick()[0]
    for kind in problem.kinds:  # with what is left out of the basis cut off, its errors are too small
        model = nested(problem, kind, 7)
        blind = model.M.copy()
        blind[:model.constraint, model.rest] = blind[model.rest, :model.constraint] = 0.0
        D = model.D.copy()
        D[model.rest], D[:, model.rest] = 0.0, 0.0
        assert fair(effectivity(problem, model, 6))
        assert not fair(effectivity(problem, replace(model, M=blind, D=D), 6))


def test_bounds_hold_on_both_sides() -> None:
    sub = fs.chain(200, interface=(1, 90, 200))
    exact = fs.chain_frequencies(200)
    for count in (12, 20, 40):
        model = FoundModes(statics(fs.CraigBampton, sub, np.zeros((200, 0))), None, count).nested()[0]
        below = exact[exact < 0.95 * model.cutoff(count)]
        low, high = model.bounds[:len(below)], model.undamped(count)[0][:len(below)]
        assert (low <= below * (1 + 1e-12)).all() and (high >= below * (1 - 1e-12)).all()
        near = below < SHARE * model.cutoff(count)
        assert (((high - low) / (high - below))[near] < 1.3).all()  # and the lower one is the nearer


def test_bounds_of_a_floating_component_are_as_near() -> None:
    problem = next(problem for problem in quick() if problem.name == "chain 60, floating")
    model = FoundModes(statics(fs.CraigBampton, problem.sub, np.zeros((60, 0))), None, 10).nested()[0]
    low, high = (omega[:len(problem.omega)] for omega in (model.bounds, model.undamped(9)[0]))
    assert (low <= problem.omega).all() and (high >= problem.omega).all()
    assert ((high - low) / (high - problem.omega) < 1.1).all()


@pytest.mark.parametrize("name", ["chain 50, ports", "chain 60, unsymmetric D", "beam", "lattice, held"])
def test_the_reference_is_as_near_as_is_said(name: str) -> None:
    """It has no solution of the full model to lean on: what it leaves out must come from the residuals alone.

    The reference lacks the terms of the third order and on, so that its doubt is the largest model's own error times
    ρ²/(1 - ρ), ρ = |λ|²/ω_cut², and more where left and right residual are not alike (Cauchy and Schwarz; of two
    close modes, say). How far below the doubt the reference's true error lies is no property of it: that
    error comes from what a truncated subspace happens to hold, and differs by halves with the BLAS kernels of
    NumPy and SciPy, while both the doubt and the model's own error are the same to all digits that count.
    """
    problem = next(problem for problem in quick() if problem.name == name)
    exact = problem.eigenvalues[within(problem.eigenvalues, problem.band)]
    for kind in problem.kinds:
        model = nested(problem, kind, {"beam": 7, "lattice, held": 21}.get(name, 13))
        found, said = model.reference[0], np.full(len(model.reference[0]), np.nan)
        at, to = paired(found, model.doubt[0])
        said[at] = model.doubt[1][to]
        at, to = paired(exact, found)
        wrong, said = np.abs(found[to] - exact[at]), said[to]
        seen = wrong > 1e-10 * np.abs(exact)
        assert (said >= wrong)[seen].all() and seen.any()
        own, ratio = np.abs(model.doubt[0][paired(exact, model.doubt[0])[1]] - exact), np.abs(exact) ** 2 / model.values[-1]
        share = said / (own * ratio**2 / (1 - ratio))
        assert (share > 0.5)[seen].all() and np.median(share[seen]) < 2.0
        # and all of it is in the estimate
        given, values = model.estimate(model.modes - 1, problem.band, 1e-3), model.damped(model.modes - 1)[0]
        at, to = paired(found[to], values)
        distance = np.abs(values[to] - model.reference[0][paired(exact, model.reference[0])[1]][at])
        assert (given.eigenvalue_error * np.abs(given.eigenvalues)).sum() >= (distance + said[at]).sum()


def test_rigid_motion_leaves_no_modes_at_zero() -> None:
    problem = next(problem for problem in GALLERY if problem.name == "block, floating")
    for kind in problem.kinds:
        model = nested(problem, kind, 30)
        found = model.estimate(20, problem.band, 1e-3)
        assert found.met and np.abs(found.eigenvalues).min() > 1.0
        # 5 of 6 are braked by αM alone, the other by the belt, too
        assert np.sort(found.eigenvalues.real[np.abs(found.eigenvalues) < 21]) == pytest.approx([-20] * 5 + [-4.83403], rel=1e-5)


@pytest.mark.parametrize("kind", [fs.CraigBampton, fs.CraigChang])
def test_one_factorisation_and_one_count(kind: type, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    original = SparseFactor.__init__

    def noted(self: SparseFactor, A: object, kind: str, *ways: bool, **more: bool) -> None:
        made.append(kind)
        original(self, A, kind, *ways, **more)

    def counted(A: object) -> int:
        made.append("count")
        return inertia(A)

    monkeypatch.setattr(SparseFactor, "__init__", noted)
    monkeypatch.setattr("femsub.modes.normal_modes.inertia", counted)
    chain = fs.chain(3000, belt=2, interface=(1, 900))
    for sub, hi in ((lattice(14, 11), 0.6), (lattice(14, 11, held=True), 0.6), (chain, 0.05)):
        made.clear()
        rom = fs.reduce(sub, kind(band=(0.0, hi), tol=1e-3 if kind is fs.CraigBampton else 1e-5), ports=True)
        counts = [] if rom.estimate.searched > 0.3 * sub.size else ["count"]  # LAPACK, once it has taken over, counts its own
        assert [what for what in made if what != "symmetric"] == ["definite", *counts] and rom.factorisations == 1
    assert rom.estimate.searched > 30  # it has grown beyond the first search


def test_modes_are_added_to_and_not_sought_again() -> None:
    sub = fs.chain(3000)
    handle = ShiftInvert(sub.K, sub.M)
    first = lowest_modes(handle, 10, evidence=False)
    before = handle.factor.columns
    more = lowest_modes(handle, 14, known=first, evidence=False)
    assert np.array_equal(more.shapes[:, :10], first.shapes) and more.tally.counted is None
    assert handle.factor.columns - before <= 20  # the deflation, and the step of inverse iteration, in one block
    assert np.allclose(more.frequencies, fs.chain_frequencies(3000, 14), rtol=1e-12)


def test_a_mode_that_the_search_has_missed_is_fetched(monkeypatch: pytest.MonkeyPatch) -> None:
    original = normal_modes.lowest_modes

    def forgetful(handle: ShiftInvert, count: int, **options: bool) -> fs.NormalModes:
        found = original(handle, count + 1, **options)
        return replace(found, eigenvalues=np.delete(found.eigenvalues, 3), shapes=np.delete(found.shapes, 3, axis=1),
                       residual=np.delete(found.residual, 3))

    calls: list[bool] = []

    def first_time(handle: ShiftInvert, count: int, **options: bool) -> fs.NormalModes:
        calls.append("known" in options)
        return (forgetful if len(calls) == 1 else original)(handle, count, **options)

    monkeypatch.setattr("femsub.reduction.estimates.found_modes.lowest_modes", first_time)
    rom = fs.reduce(fs.chain(500, belt=2, damping=0.0), fs.CraigChang(band=(0.0, 0.08), tol=1e-3), ports=True)
    assert np.allclose(rom.estimate.frequencies, fs.chain_frequencies(500, len(rom.estimate.frequencies)), rtol=1e-11)
    assert len(calls) >= 3 and calls == [False] + [True] * (len(calls) - 1)


def test_a_mode_that_only_the_count_misses_is_fetched_before_any_is_kept() -> None:
    sub = fs.chain(500, belt=2, damping=0.0)
    part = FoundModes(statics(fs.CraigChang, sub, np.zeros((500, 0))), None, 12)
    found = part.found
    part.replace(replace(found, eigenvalues=np.delete(found.eigenvalues, 3), shapes=np.delete(found.shapes, 3, axis=1),
                         residual=np.delete(found.residual, 3)))
    assert part.counted_in(8) is None
    kept = part.counted_in(8)
    assert kept is not None
    np.testing.assert_allclose(np.append(np.sqrt(kept.values), kept.cutoff), fs.chain_frequencies(500, 9), rtol=1e-10)


@pytest.mark.sampled(5)
@pytest.mark.parametrize(("problem", "kind"), CASES, ids=NAMES)
def test_with_one_mode_less_the_tolerance_would_not_be_met(problem: Problem, kind: type) -> None:
    rom = reduced(problem, kind, 1e-3)
    reference = nested(problem, kind, rom.estimate.searched)
    assert reference.estimate(rom.modes, problem.band, 1e-3).met
    assert rom.modes == 0 or not reference.estimate(rom.modes - 1, problem.band, 1e-3).met


def test_rigid_motion_that_a_method_does_not_tell_is_found() -> None:
    sub = fs.chain(60, interface=(1, 30, 60), fixed=False, damping=0.3)
    given = statics(fs.CraigBampton, sub, np.zeros((60, 0)))
    told, silent = (FoundModes(one, sub.pencil, 20).nested()[0] for one in (given, replace(given, rigid=None)))
    assert silent.motion is None and silent.at_rest.count == told.at_rest.count == 1
    assert silent.at_rest.zeros == told.at_rest.zeros == 1  # the dashpot brakes the motion
    omega = told.undamped(8)[0]
    below = replace(silent, limit=0.5).undamped(8)[0]
    np.testing.assert_allclose(below, omega[:len(below)], rtol=1e-9)
    assert len(below) == np.count_nonzero(omega < 0.5) > 5
    assert len(silent.reference[0]) == len(told.reference[0])


@pytest.mark.slow
def test_a_long_chain_against_its_closed_form() -> None:
    for kind in (fs.CraigBampton, fs.CraigChang):
        rom = fs.reduce(fs.chain(8000, belt=2, interface=(1, 3500)), kind(band=(0.0, 5e-3), tol=1e-4), ports=True)
        found = fs.normal_modes(rom, band=(0.0, 5e-3)).frequencies
        assert np.abs(found / fs.chain_frequencies(8000, len(found)) - 1).max() <= 1e-4
        assert "met with" in repr(rom.estimate) and "\n" not in repr(rom.estimate)


def test_a_tighter_tolerance_or_a_belt_never_takes_fewer_modes() -> None:
    sub = fs.chain(60, belt=30)
    counts = [quietly(sub, fs.CraigChang(band=(0.0, 0.3), tol=tol), contacts=fs.Belt(slope=-1.0)).modes
              for tol in (1e-2, 1e-4, 1e-6)]
    assert counts == sorted(counts) and counts[0] < counts[-1]
    assert quietly(sub.with_damping(None), fs.CraigChang(band=(0.0, 0.3), tol=1e-6)).modes < counts[-1]


def quietly(sub: fs.Substructure, method: object, **options: object) -> fs.ReducedSubstructure:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        return fs.reduce(sub, method, **options)


def test_interface_empty_or_everything() -> None:
    plain = fs.chain(30)
    for interface in ([], list(range(30))):
        sub = fs.Substructure(plain.M, plain.K, plain.D, interface)
        rom = fs.reduce(sub, fs.CraigBampton(band=(0.0, 0.5), tol=1e-3))
        assert rom.estimate.met and len(rom.estimate.frequencies) == np.count_nonzero(fs.chain_frequencies(30) < 0.5)
        assert rom.modes == 0 if interface else rom.modes >= 7


@pytest.mark.slow
def test_special_components() -> None:
    sub = fs.chain(150, belt=3, interface=(1, 20))
    mass = np.where(np.arange(150) % 3 == 0, 0.0, 1.0)
    massless = fs.Substructure(sp.diags_array(mass, format="csr"), sub.K, sub.D, sub.interface, sub.ports)
    reduced_already = quietly(sub, fs.CraigBampton(50))
    belts = [fs.Belt(slope=-0.05), fs.Belt(port="pair", slope=-0.1)]
    two = fs.Substructure(sub.M, sub.K, sub.D, [0], {"belt": sub.ports["belt"], "pair": np.eye(150)[:, [5, 90]]})
    for model, contacts in ((massless, belts[0]), (reduced_already, belts[0]), (two, belts)):
        full, damped = fs.normal_modes(model, band=(0.0, 0.15)).frequencies, model.linearised(contacts)
        for kind in (fs.CraigBampton, fs.CraigChang):
            rom = quietly(model, kind(band=(0.0, 0.15), tol=1e-3), contacts=contacts)
            assert np.abs(fs.normal_modes(rom, band=(0.0, 0.17)).frequencies[:len(full)] / full - 1).max() <= 1e-3
            exact, found = positive(damped), positive(rom.linearised(contacts))
            at, to = paired(exact, found)
            inside = within(exact[at], (0.0, 0.15))
            assert inside.sum() >= 5 and np.abs(found[to] / exact[at] - 1)[inside].max() <= 1e-3
    with pytest.raises(fs.InputError, match="is already reduced, with a cut-off of"):
        fs.reduce(reduced_already, fs.CraigBampton(band=(0.0, 1.0), tol=1e-3))


def test_what_cannot_be_met_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(fs.NotConvergedError, match=r"to a relative error of 1e-17.*with \d{1,2} modes.*Rounding alone causes"):
        quietly(fs.chain(3000, belt=2), fs.CraigBampton(band=(0.0, 0.005), tol=1e-17))
    monkeypatch.setattr("femsub.reduction.estimates.found_modes.DENSE", 80)
    with pytest.raises(fs.NotConvergedError, match=r"With \d\d modes: Estimate: .* not met .* put the belt's DOF"):
        quietly(fs.chain(400, belt=2), fs.CraigBampton(band=(0.0, 0.1), tol=1e-9))


def test_the_estimate_goes_with_another_damping_and_stays_in_files(tmp_path: Path) -> None:
    sub = fs.chain(60, belt=30)
    for contacts in (None, fs.Belt(slope=-0.1)):
        rom = quietly(sub if contacts else sub.with_damping(None), fs.CraigChang(band=(0.0, 0.3), tol=1e-3), contacts=contacts)
        assert rom.estimate is not None and bool(len(rom.estimate.eigenvalues)) == bool(contacts)
        for other in (rom.with_damping(0.1 * rom.K), rom.with_damping(None), fs.damped(rom, rayleigh=(0.1, 0.0))):
            assert other.estimate is None
        for format in ("mtx", "npz", "mat"):
            fs.write_matrices(tmp_path / format, rom, format)
            read = fs.read_component(tmp_path / format)
            assert read.estimate.record() == rom.estimate.record() and repr(read.estimate) == repr(rom.estimate)
    complete = fs.reduce(fs.Substructure(sub.M, sub.K, None, range(60)), fs.CraigBampton(band=(0.0, 0.5), tol=1e-3))
    fs.write_matrices(tmp_path, complete)
    assert np.isinf(fs.read_component(tmp_path).estimate.cutoff)
    path = tmp_path / "model.json"
    about = json.loads(path.read_text())
    del about["sha256"]["model.json"]  # its own sum, which would be another
    for key, value in (("frequencies", [1.0]), ("tol", "small"), ("band", None)):
        damaged = json.loads(json.dumps(about))
        damaged["reduced"]["estimate"][key] = value
        (tmp_path / "model.json").write_text(json.dumps(damaged))
        with pytest.raises(fs.InputError, match="estimate is damaged"):
            fs.read_component(tmp_path)
        path.write_text(json.dumps(about))
    del about["reduced"]["estimate"]
    path.write_text(json.dumps(about))
    assert fs.read_component(tmp_path).estimate is None


def test_a_study_takes_tolerances() -> None:
    methods = [fs.CraigBampton(band=(0.0, 0.5), tol=1e-2), fs.CraigChang(band=(0.0, 0.5), tol=1e-4)]
    found = fs.study(fs.chain(40, belt=2), methods, band=(0.0, 0.5), contacts=fs.Belt(slope=-0.1), repeats=1)
    assert [row.error_eigenvalue <= method.tol for row, method in zip(found.rows, methods, strict=True)] == [True, True]
    assert all(row.modes >= 9 for row in found.rows)


@pytest.mark.parametrize("kind", [fs.CraigBampton, fs.CraigChang])
def test_refusals(kind: type) -> None:
    for wrong, told in (({}, "nothing is given"), ({"modes": 3, "band": (0, 1), "tol": 1e-3}, "are both given"),
                        ({"modes": 3, "tol": 1e-3}, "are both given"), ({"band": (0, 1)}, "tol=1e-3.* is missing"),
                        ({"tol": 1e-3}, "band=.* is missing"), ({"band": (1, 0), "tol": 1e-3}, "0 <= lo < hi"),
                        ({"band": (0, 1), "tol": 0.0}, "between 0 and 1"), ({"band": (0, 1), "tol": np.nan}, "finite")):
        with pytest.raises(fs.InputError, match=told):
            kind(**wrong)
    with pytest.raises(fs.InputTypeError, match="tol must be a number"):
        kind(band=(0, 1), tol="fine")
    with pytest.raises(fs.InputError, match="contacts have no effect on a basis with a given number"):
        fs.reduce(fs.chain(10), kind(3), contacts=fs.Belt(slope=-0.1))
    with pytest.raises(fs.InputTypeError, match="list of Belts or other contacts"):
        fs.reduce(fs.chain(10), kind(band=(0, 1), tol=1e-3), contacts=-0.1)
    assert fs.reduce(fs.chain(10, interface=(1,)), fs.CraigChang(3)).estimate is None


@pytest.mark.parametrize("interface", [[1], range(1, 31)])
@pytest.mark.parametrize("place", [-1e-12, 0.0, 1e-12])
def test_a_mode_on_the_edge_of_the_band_is_in_the_estimate(interface: list[int], place: float) -> None:
    """As for every other question (`bands.in_band`): rounding does not decide whether a mode on an edge is to be right."""
    sub = fs.chain(30, damping=0.0, interface=interface)
    edges = fs.normal_modes(sub, count=5).frequencies[[1, 4]] * (1 + place)
    rom = fs.reduce(sub, fs.CraigBampton(band=tuple(edges), tol=1e-3))
    assert len(rom.estimate.frequencies) == 4


@pytest.mark.slow
def test_a_wide_interface_is_estimated_from_the_band_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The estimate's coordinates are twice the interface DOF and more; all of their eigenvalues would take minutes."""
    mesh = fs.block((1.0, 0.3, 0.2), (4, 8, 5), "hexahedron")
    sub = fs.solid(mesh, fs.Material(2.1e11, 0.3, 7850.0), supports=["left"], interface=["right"], rayleigh=(10.0, 1e-6))
    band = (0.0, 1.05 * float(fs.normal_modes(sub, count=4).frequencies[-1]))

    def everything(pencil: fs.Pencil) -> None:
        raise AssertionError(f"all eigenvalues of {pencil.size} coordinates were asked for")

    with monkeypatch.context() as patched:
        patched.setattr("femsub.reduction.estimates.nested.solve", everything)
        rom = fs.reduce(sub, fs.CraigBampton(band=band, tol=1e-3))
    assert len(sub.interface) == 162 and rom.estimate.met
    full = fs.complex_modes(sub, band=band).eigenvalues
    found = fs.complex_modes(rom, band=band).eigenvalues
    assert len(rom.estimate.eigenvalues) == len(full) == len(found)
    true = np.abs(np.sort_complex(found) - np.sort_complex(full)) / np.abs(np.sort_complex(full))
    assert true.max() <= rom.estimate.eigenvalue_error.max() <= 1e-3


@pytest.mark.parametrize("dashpot", [1e-3, 1e-5])
def test_a_free_system_on_a_weak_dashpot_is_reduced_to_a_tolerance(dashpot: float) -> None:
    """Its slow drift at λ = -c wᵀM_r⁻¹w counts, and rounding in K does not reach it: K annihilates the motion exactly."""
    def part(E: float, length: float, elements: int, c: float) -> fs.Substructure:
        sub = fs.beam(length, elements, E=E, I=(0.03 * length) ** 4, rho=7850.0, A=(0.1 * length) ** 2)
        D = 1e-8 * sub.K.toarray()
        D[4, 4] += c
        return fs.Substructure(sub.M, sub.K, D, [0, 1, 2 * elements, 2 * elements + 1])

    parts = {"a": part(2e11, 1.0, 8, dashpot), "b": part(7e10, 0.6, 6, 0.0)}
    full = fs.couple(parts, [fs.Rigid(("a", [16, 17]), ("b", [0, 1]))])
    band = (0.0, 1.05 * float(fs.normal_modes(full, count=3).frequencies[-1]))
    drift = next(value for value in fs.complex_modes(full).eigenvalues if value.imag == 0 and -1.0 < value.real < 0)
    for method in (fs.CraigBampton, fs.Hurty):
        estimate = fs.reduce(full, {name: method(band=band, tol=1e-2) for name in parts}).estimate
        assert estimate.met and len(estimate.frequencies) == 3 and len(estimate.eigenvalues) == 4
        assert np.abs(estimate.eigenvalues - drift).min() < 1e-5 * abs(drift)


@pytest.mark.parametrize("side", [1e-7j, -1e-7j])
def test_real_eigenvalues_that_rounding_made_a_pair_count_twice(side: complex) -> None:
    """Whether the one that is listed lies above the axis or below it differs from processor to processor."""
    values = np.array([-20.0, -20.0 + side, -3.0 + 4.0j])
    assert doubled(values).tolist() == [1]
    assert doubled(np.append(values, -20.0 - side)).tolist() == []  # both are listed
