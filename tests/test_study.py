"""The study: spectra matched as sets, errors, times that belong to what they say."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
import scipy.linalg

import femsub as fs
from femsub.algebra.petsc import SparseFactor
from femsub.algebra.timing import timed
from femsub.modes import match, spectrum_errors, turnover
from femsub.output import answer
from femsub.reduction import METHODS, Reductor
from femsub.studies.results import Row, Study, Timing, with_front


def test_spectra_are_matched_as_sets(rng: np.random.Generator) -> None:
    reference = rng.standard_normal(20) + 1j * rng.standard_normal(20)
    order = rng.permutation(20)
    at, to = match(reference, reference[order] + 1e-9)
    assert np.array_equal(order[to], at)


def test_errors_shrink_and_vanish_with_all_modes() -> None:
    methods = [kind(modes) for kind in (fs.CraigBampton, fs.CraigChang) for modes in (4, 6, 9)]
    found = fs.study(fs.chain(10, belt=2), methods, band=(0.0, 0.75), contacts=fs.Belt(slope=-0.2677), repeats=3)
    assert len(found.rows) == 6 and found.full.size == 10 and found.repeats == 3
    for rows in (found.rows[:3], found.rows[3:]):
        for key in ("error_eigenvalue", "error_growth", "error_critical"):
            errors = [getattr(row, key) for row in rows]
            assert errors[0] > errors[1] > errors[2] < 1e-10
        assert all(row.missing == 0 and row.reduction.least <= row.reduction.median <= row.reduction.most for row in rows)
    assert found.rows[0].error_critical == pytest.approx(2.7e-3, abs=5e-5)
    assert found.rows[0].method == "craig-bampton" and "10 DOF" in repr(found)


def test_a_mode_that_the_reduced_model_lacks_is_counted() -> None:
    sub = fs.chain(10, belt=2)
    with pytest.warns(fs.PortWarning):
        rom = fs.reduce(sub, fs.CraigBampton(1))
    full = fs.complex_modes(sub, band=(0.0, 0.75))
    assert spectrum_errors(full, fs.complex_modes(rom)).missing == 1
    assert spectrum_errors(full, fs.complex_modes(sub))[:3] == (0.0, 0.0, 0)


def test_refusals() -> None:
    with pytest.raises(ValueError, match="methods is empty"):
        fs.study(fs.chain(10), [], band=(0, 1))
    with pytest.raises(ValueError, match="repeats must be at least 1"):
        fs.study(fs.chain(10), [fs.CraigChang(2)], band=(0, 1), repeats=0)
    with pytest.raises(ValueError, match="unknown port 'bel'; did you mean 'belt'"):
        fs.study(fs.chain(10), [fs.CraigChang(2)], band=(0, 1), contacts=fs.Belt("bel", slope=0.0))
    with pytest.raises(TypeError, match="model must be a Substructure"):
        fs.study(fs.chain(10).K, [fs.CraigChang(2)], band=(0, 1))


def test_the_slope_of_a_study_is_per_unit_of_the_belt_s_force() -> None:
    belt = fs.Belt(force=2.0, slope=-0.1)
    found = fs.study(fs.chain(10, belt=2), [fs.CraigChang(9)], band=(0.0, 0.75), contacts=belt, repeats=1)
    assert 2 * found.full.critical == pytest.approx(-0.025567, abs=1e-6)


def test_each_row_tells_where_its_seconds_went_and_what_it_holds() -> None:
    found = fs.study(fs.chain(400, belt=2), [fs.CraigBampton(6), fs.CraigChang(6)], band=(0.0, 0.02), repeats=3, assembly=0.25)
    for row in found.rows:
        assert list(row.phases) == ["factorisation", "basis", "certificate", "projection"]
        # each run's phases are within its seconds, and about all of them; medians of a busy machine are of different runs
        assert sum(one.least for one in row.phases.values()) <= row.reduction.most
        assert sum(one.most for one in row.phases.values()) >= 0.5 * row.reduction.least
        assert all(one.median > 0 for one in row.phases.values())
        assert row.memory == pytest.approx((3 * row.size**2 + 400 * row.size) * 8e-6)
        assert {"factorisation_s", "basis_s", "projection_s", "memory", "mac", "pareto"} <= row.flat().keys()
    with timed() as seconds, pytest.warns(fs.PortWarning):  # too light a factor to be given back before the count
        fs.reduce(fs.chain(400, belt=2), fs.CraigChang(6))
    assert seconds["certificate"] > 1e-5 and seconds["factorisation"] > 0
    assert found.full.phases == {} and "assembled in 250 ms" in str(found)


def test_no_run_finds_the_factor_of_another() -> None:
    """What is timed is a first call: each reduction takes a factor and that of its count, the full model two."""
    made = []
    for repeats in (1, 3):
        before = SparseFactor.made
        fs.study(fs.chain(400, belt=2), [fs.CraigBampton(6), fs.CraigChang(6)], band=(0.0, 0.02), repeats=repeats)
        made.append(SparseFactor.made - before)
    assert made[1] - made[0] == 2 * 6


@pytest.mark.sampled(6)
@pytest.mark.parametrize("name", list(METHODS))
@pytest.mark.parametrize("ports", [False, True])
def test_a_reductor_gives_the_models_with_fewer_modes(name: str, ports: bool) -> None:
    mesh = fs.block((1.0, 0.2, 0.1), (8, 2, 2), "hexahedron")
    sub = fs.solid(mesh, fs.Material(2.1e11, 0.3, 7850.0), interface=["left", "right"], ports={"belt": ("top", "y")})
    basis = Reductor(sub, METHODS[name](9), ports)
    for modes in (9, 0, 4):
        try:
            alone = quiet(lambda: fs.reduce(sub, METHODS[name](modes), ports=ports))  # noqa: B023
        except fs.InputError as error:
            with pytest.raises(fs.InputError, match=re.escape(str(error))):
                basis.first(modes)
            continue
        found = quiet(lambda: basis.first(modes))  # noqa: B023
        assert (found.kinds, found.method, found.modes) == (alone.kinds, alone.method, alone.modes)
        assert found.cutoff == pytest.approx(alone.cutoff, rel=1e-10)
        assert found.port_error["belt"] == pytest.approx(alone.port_error["belt"], rel=1e-6, abs=1e-6)
        assert found.dropped == alone.dropped
        omega = [fs.normal_modes(model, count=min(modes, 4)).frequencies for model in (found, alone)]
        assert omega[0] == pytest.approx(omega[1], rel=1e-12)
        outside = found.V - alone.V @ np.linalg.lstsq(alone.V, found.V, rcond=None)[0]
        assert np.linalg.norm(outside) < 1e-10 * np.linalg.norm(found.V)
    with pytest.raises(fs.InputError, match="modes must be at least 0 and at most 9"):
        basis.first(10)


@pytest.mark.parametrize("name", [name for name, kind in METHODS.items() if kind.nested])
def test_a_reductor_does_the_large_work_once(name: str) -> None:
    """Each model takes one product with the largest basis: no factor, no solve, no product with K or M."""
    products = []

    class Counted(np.ndarray):
        def __matmul__(self, other: np.ndarray) -> np.ndarray:
            products.append(other.shape)
            return np.asarray(self) @ other

    mesh = fs.block((1.0, 0.2, 0.1), (8, 2, 2), "hexahedron")
    sub = fs.solid(mesh, fs.Material(2.1e11, 0.3, 7850.0), interface=["left", "right"])
    basis, made = Reductor(sub, METHODS[name](9)), SparseFactor.made
    basis.U, handle = basis.U.view(Counted), basis.statics.handle
    handle.K = handle.M = None
    assert "factor" not in vars(handle)
    for modes in (0, 3, 5, 7, 9):
        basis.first(modes)
    assert SparseFactor.made == made and len(products) == 5
    if name == "craig-bampton":
        assert not any(columns for _, columns in products)  # all columns are columns of the largest basis


def test_models_of_a_reductor_share_no_memory() -> None:
    basis = Reductor(fs.chain(400, belt=2), fs.CraigBampton(6), ports=True)
    large = basis.first(6)
    before = large.V.copy()
    basis.first(3)
    assert np.array_equal(large.V, before)


@pytest.mark.slow
def test_models_of_one_method_share_one_basis() -> None:
    """One factor and that of its count for each method, in place of one each for every model; the errors are the same."""
    methods = [kind(modes) for kind in (fs.CraigBampton, fs.CraigChang) for modes in (4, 6, 9)]
    made, found = [], []
    for shared in (False, True):
        sub, before = fs.chain(400, belt=2), SparseFactor.made
        found.append(fs.study(sub, methods, band=(0.0, 0.02), repeats=1, shared=shared))
        made.append(SparseFactor.made - before)
    assert made[0] - made[1] == 2 * 4
    for one, other in zip(found[0].rows, found[1].rows, strict=True):
        assert (one.size, one.modes, one.cutoff) == (other.size, other.modes, pytest.approx(other.cutoff, rel=1e-10))
        assert one.error_eigenvalue == pytest.approx(other.error_eigenvalue, rel=1e-6, abs=1e-10)
    for rows in (found[1].rows[:3], found[1].rows[3:]):  # the first makes the basis of all three, and all have its seconds
        assert rows[0].phases["factorisation"].median > 0
        assert min(row.reduction.median for row in rows) > rows[0].phases["factorisation"].median
    parts = fs.couple({name: fs.chain(30, interface=[1, 30], fixed=False) for name in "ab"},
                      [fs.Rigid(("a", [29]), ("b", [0])), fs.Spring(("a", [0]), "ground", stiffness=1.0)])
    steps = [dict.fromkeys("ab", fs.CraigBampton(modes)) for modes in (2, 5)]
    alone, together = (fs.study(parts, steps, (0.0, 0.3), repeats=1, shared=shared) for shared in (False, True))
    assert [row.error_frequency for row in alone.rows] == pytest.approx([row.error_frequency for row in together.rows], abs=1e-10)


def quiet(call: Callable[[], fs.ReducedSubstructure]) -> fs.ReducedSubstructure:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        return call()


def test_frequencies_and_shapes_are_compared_in_the_band() -> None:
    sub = fs.chain(10, belt=2)
    found = fs.study(sub, [fs.CraigBampton(3), fs.CraigBampton(9), fs.CraigChang(3)], (0.0, 0.75), repeats=1)
    crude, whole, free = found.rows
    exact = fs.normal_modes(sub, band=(0.0, 0.75)).frequencies
    with pytest.warns(fs.PortWarning):
        rom = fs.reduce(sub, fs.CraigBampton(3))
    assert crude.error_frequency == pytest.approx((fs.normal_modes(rom, count=3).frequencies / exact - 1).max(), rel=1e-9)
    assert whole.error_frequency < 1e-12 and free.error_frequency < 1e-12 < crude.error_frequency
    assert 1e-4 < 1 - crude.mac < 0.1 and abs(1 - whole.mac) < 1e-12


def test_shapes_decide_where_frequencies_do_not_and_clusters_are_subspaces() -> None:
    def oscillators(*stiffness: float) -> fs.Substructure:
        return fs.Substructure(np.eye(len(stiffness)), np.diag(stiffness), 0.01 * np.eye(len(stiffness)))

    full, other = oscillators(1.0, 1.1, 9.0), oscillators(1.2, 1.06, 9.0)  # by distance alone the first two would swap
    modes = [fs.complex_modes(model) for model in (full, other)]
    assert spectrum_errors(*modes).eigenvalue < 0.05
    by_shape = spectrum_errors(*modes, (full, other))
    assert by_shape.eigenvalue == pytest.approx(np.sqrt(1.2) - 1, rel=1e-2) and by_shape.mac == pytest.approx(1.0)
    # a repeated pair, turned in its plane: each shape alone looks wrong, the plane is right
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    stiffness = np.diag([1.0, 1.00001])
    pair = [fs.Substructure(np.eye(2), K, 0.01 * np.eye(2)) for K in (stiffness, turn @ stiffness @ turn.T)]
    assert spectrum_errors(*(fs.complex_modes(model) for model in pair), tuple(pair)).mac == pytest.approx(1.0)


def test_modes_that_grow_in_one_model_alone_are_counted() -> None:
    def grows(*rates: float) -> fs.ComplexModes:
        return fs.complex_modes(fs.Substructure(np.eye(3), np.diag([1.0, 4.0, 9.0]), -2 * np.diag(rates)))

    full, other = grows(0.1, 0.1, -0.1), grows(0.1, -0.1, 0.1)
    found = spectrum_errors(full, other, band=(0.0, 2.5))
    assert (found.missed, found.invented) == (1, 0)  # what grows at 3 lies outside the band
    assert (spectrum_errors(full, other).missed, spectrum_errors(full, other).invented) == (1, 1)
    assert found.real == pytest.approx(0.2 / 2) and spectrum_errors(full, full)[5:] == (0, 0)
    far = fs.complex_modes(fs.Substructure(np.eye(1), [[400.0]], [[-0.1]]))  # no counterpart at all
    assert (spectrum_errors(full, far).missed, spectrum_errors(full, far).invented) == (2, 1)


def test_over_a_range_the_error_of_the_critical_value_and_missed_modes_decide() -> None:
    time = Timing(1.0, 1.0, 1.0)

    def row(size: int, growth: float, critical: float, missed: int = 0) -> Row:
        return Row("rubin", 5, size, 0.0, growth, critical, 0, 0.3, 0.0, time, time, 0.0, missed=missed)

    full, rows = row(100, 0.0, 0.0), (row(5, 1e-6, 0.2), row(6, 1e-6, 1e-4, 1), row(7, 0.5, 1e-4), row(8, 1e-6, 1e-6))
    found = Study("x", (0.0, 1.0), 1, full, rows, parameter="mu", between=(0.0, 1.0))
    assert found.recommended() is rows[2] and replace(found, between=None).recommended() is rows[0]
    assert "0.1 % of the critical μ" in found.recommendation()
    assert "no unstable mode of the full model is missed and none is invented" in found.recommendation()
    assert "comes nearest with 0.0001 %" in found.recommendation(1e-9) and "none" in str(replace(
        found, rows=(replace(rows[0], critical=np.inf, error_critical=np.inf),)))


def test_a_parameter_is_that_of_the_contacts() -> None:
    sub, methods = fs.chain(10, belt=2), [fs.CraigChang(4)]
    for given, words in (({"values": [0.1]}, "name it, e.g. parameter='mu'"), ({"parameter": "mu"}, "unknown parameter 'mu'"),
                         ({"contacts": fs.Belt(slope=-0.1), "between": (-1.0, 0.0)}, "leave between out"),
                         ({"critical": [0.1]}, "critical must have 2 values, of the full model and of each method, not 1")):
        with pytest.raises(fs.InputError, match=re.escape(words)):
            fs.study(sub, methods, (0.0, 0.75), repeats=1, **given)  # type: ignore[arg-type]
    slopes = [-0.01, -0.2677]
    found = fs.study(sub, methods, (0.0, 0.75), contacts=fs.Belt(slope=0.0), values=slopes, repeats=1)
    each = [fs.study(sub, methods, (0.0, 0.75), contacts=fs.Belt(slope=slope), repeats=1) for slope in slopes]
    assert found.rows[0].error_growth == max(one.rows[0].error_growth for one in each) and found.values == tuple(slopes)
    assert found.full.stable is False and [modes.is_stable for modes in found.spectra] == [True, False]
    assert found.rows[0].critical == each[0].rows[0].critical and found.models[0].size == found.rows[0].size


def test_a_method_that_cannot_reduce_the_model_is_left_out() -> None:
    free = fs.chain(10, belt=2, fixed=False, interface=())
    found = fs.study(free, [fs.CraigBampton(3), fs.Herting(2), fs.Guyan(3)], (0.0, 0.75), repeats=1)
    assert [row.label for row in found.rows][-1] == "Guyan" and any("Herting is left out" in one for one in found.left_out)
    assert "is left out" in str(found)
    with pytest.raises(fs.InputError, match="Herting needs interface DOF"):
        fs.study(free, [fs.Herting(2)], (0.0, 0.75), repeats=1)


def test_without_an_interface_methods_that_coincide_are_compared_once() -> None:
    methods = [fs.CraigBampton(3), fs.CraigChang(3), fs.Guyan(3), fs.CraigBampton(4), fs.Rubin(4)]
    free = fs.study(fs.chain(10, belt=2, interface=()), methods, (0.0, 0.75), repeats=1, held=True)
    assert [(row.method, row.size) for row in free.rows] == [("craig-bampton", 3), ("guyan", 3), ("craig-bampton", 4)]
    assert free.left_out == tuple(f"{name} is left out: without an interface it is the same as Craig-Bampton"
                                  for name in ("Craig-Chang", "Rubin"))
    assert " ".join(free.brief().split()).endswith(" ".join(free.left_out))  # a table of one method only needs its reasons
    joined = fs.study(fs.chain(10, belt=2), methods, (0.0, 0.75), repeats=1)
    assert len(joined.rows) == len(methods) and not joined.left_out
    assert free.advice(0.5).condition == ["the model has no interface. Its accuracy when joined to others is unknown."]


def test_a_model_that_is_good_free_may_be_bad_held() -> None:
    """The free chain held at m1 is one of 9 masses between a wall and a free end: ω_j = 2 sin((2j - 1)π / 38)."""
    sub, band = fs.chain(10, belt=1, fixed=False), (0.0, 0.9)
    methods = [fs.CraigBampton(4), fs.CraigChang(1), fs.CraigChang(4), fs.CraigBampton(2)]
    found = fs.study(sub, methods, band, contacts=fs.Belt(slope=-0.1), repeats=1, held=True)
    exact = 2 * np.sin((2 * np.arange(1, 4) - 1) * np.pi / 38)
    assert exact[-1] < band[1] < 2 * np.sin(7 * np.pi / 38)
    for row, model in zip(found.rows, found.models, strict=True):
        Z = scipy.linalg.null_space(np.atleast_2d(model.interface_rows))
        ritz = np.sqrt(scipy.linalg.eigh(Z.T @ model.K @ Z, Z.T @ model.M @ Z, eigvals_only=True))
        worst = np.inf if len(ritz) < 3 else max(abs(ritz[:3] / exact - 1))
        assert row.error_held == pytest.approx(worst, rel=1e-6, abs=1e-12)
    assert found.rows[0].error_held < 1e-9 < found.rows[2].error_held < np.inf  # fixed-interface modes are exact there
    assert found.rows[3].error_held == np.inf and found.rows[3].error_frequency < np.inf
    assert "lacks" in str(found) and "inf" not in str(found)
    assert np.isnan(fs.study(sub, methods, band, repeats=1).rows[0].error_held)


@pytest.mark.parametrize(("held", "words"), [
    (np.nan, "the interface is free, as in this run. A held interface was not compared."),
    (1e-4, "as in this run, or held at rest. Held at rest, this model has frequencies that are off by 1.0e-04."),
    (np.inf, "Held at rest, this model lacks a mode of the band; there no model of this run is accurate enough."),
    (8e-2, "off by 8.0e-02; there take Craig-Bampton with 9 modes (20 DOF), which is off by 1.0e-05."),
    (9e-2, "off by 9.0e-02; there no model of this run is accurate enough.")])
def test_the_verdict_names_its_condition_and_the_figure_for_a_held_interface(held: float, words: str) -> None:
    time = Timing(1.0, 0.99, 1.01)
    small = Row("craig-chang", 4, 5, 1e-6, 1e-6, 1e-6, 0, -1.0, 0.0, time, time, 0.0, stable=True, error_held=held)
    large = replace(small, method="craig-bampton", modes=9, size=20, error_held=1e-5 if held == 8e-2 else held)
    full = replace(small, method="full", modes=0, size=100, error_held=0.0)
    found = Study("x", (0.0, 1.0), 3, full, (small, large), interface=2)
    choice = found.advice()
    assert choice.condition[0].endswith(words)
    said = answer([choice]).text.splitlines()
    assert said[0] == "May a small model replace the full one?"
    assert said[1].startswith("Yes. Craig-Chang with 4 modes (5 DOF) may")
    assert said[2].endswith(words) and said[2].startswith("Condition: ")
    assert found.recommended() == small and found.recommended(held=True) == (
        large if held == 8e-2 else small if held <= 1e-3 else None)
    assert [line.split()[:2] for line in found.brief().splitlines()[2:]] == [
        ["full", "100"], [">", "Craig-Chang"], ["Craig-Bampton", "20"], [">", "recommended"]]


def test_the_front_leaves_out_what_is_beaten_in_both() -> None:
    time = [Timing(seconds, 0.99 * seconds, 1.01 * seconds) for seconds in (1.0, 2.0, 3.0)]
    rows = [Row("craig-chang", 4, 5, 0.0, error, 0.0, missing, 0.0, 0.0, time[turn], time[0], 0.0)
            for turn, error, missing in ((0, 1e-2, 0), (1, 1e-3, 0), (2, 1e-2, 0), (2, 1e-4, 1), (2, 1e-3, 0))]
    assert [row.pareto for row in with_front(rows)] == [True, True, False, False, False]


def test_the_error_of_the_growth_rate_does_not_blow_up_at_the_border() -> None:
    sub = fs.chain(10, belt=2)
    border = float(fs.critical_slope(sub))
    for factor in (0.5, 1.0, 1.5):
        found = fs.study(sub, [fs.CraigChang(4)], band=(0.0, 0.75), contacts=fs.Belt(slope=factor * border), repeats=1)
        row = found.rows[0]
        assert row.error_eigenvalue < 2e-3 and row.error_growth < 5e-3  # at the border it was 1e+05
    at = fs.study(sub, [fs.CraigChang(4)], band=(0.0, 0.2), contacts=fs.Belt(slope=border), repeats=1)  # the first pair only
    assert at.rows[0].error_growth < 1e-5 and at.recommended() is at.rows[0]
    assert at.full.stable is None or abs(at.full.growth) < 1e-12
    if at.rows[0].stable != at.full.stable:
        assert "the border is nearer than the error" in at.recommendation()
    beyond = fs.study(sub, [fs.CraigChang(4)], band=(0.0, 0.75), contacts=fs.Belt(slope=1.5 * border), repeats=1)
    assert beyond.full.stable is beyond.rows[0].stable is False


def test_without_a_belt_the_scale_of_the_growth_rate_is_itself() -> None:
    sub = fs.chain(10, belt=2)
    modes = fs.complex_modes(sub)
    assert np.allclose(turnover(sub, None, modes), np.abs(modes.eigenvalues.real), rtol=1e-9)
    belt = fs.Belt(slope=float(fs.critical_slope(sub)))
    assert turnover(sub, belt, fs.complex_modes(sub, belt)).min() > 1e-5  # as large as the damping, where Re λ is 0


def test_what_lies_above_the_cut_off_has_no_slope_and_no_star() -> None:
    sub = fs.chain(10, belt=2)
    methods = [fs.CraigBampton(1), fs.CraigChang(2), fs.CraigChang(6)]
    found = fs.study(sub, methods, band=(0.0, 0.75), contacts=fs.Belt(slope=0.0), repeats=1)
    assert [np.isnan(row.error_critical) for row in found.rows] == [True, True, False]
    assert [row.pareto for row in found.rows] == [False, False, True]
    assert all("cut-off" in row.reason for row in found.rows[:2]) and "above the cut-off" in str(found)


def test_noise_of_milliseconds_does_not_move_the_star(rng: np.random.Generator) -> None:
    """Timings drawn anew, as from run to run: the same rows are starred, and the same one is recommended."""
    sizes, errors = (5, 5, 8, 8, 12), (1e-2, 1e-3, 1e-4, 1e-4, 1e-5)
    stars, best = set(), set()
    for _ in range(20):
        seconds = [Timing.of(0.01 * (1 + rng.random(9))) for _ in sizes]
        rows = [Row("craig-chang", 4, size, 0.0, error, 0.0, 0, 0.0, 0.0, time, time, 0.0)
                for size, error, time in zip(sizes, errors, seconds, strict=True)]
        found = Study("x", (0.0, 1.0), 3, replace(rows[0], size=100), with_front(rows, 1.0))
        stars.add(tuple(row.pareto for row in found.rows))
        chosen = found.recommended()
        best.add(None if chosen is None else (chosen.size, chosen.error_growth))
    assert stars == {(False, True, True, True, True)} and best == {(5, 1e-3)}
    slow, quick = Timing(3.0, 2.9, 3.1), Timing(0.1, 0.09, 0.11)  # where the difference is real it decides
    rows = [Row("craig-chang", 4, 5, 0.0, 1e-3, 0.0, 0, 0.0, 0.0, slow, slow, 0.0),
            Row("craig-bampton", 4, 6, 0.0, 1e-3, 0.0, 0, 0.0, 0.0, quick, quick, 0.0)]
    assert [row.pareto for row in with_front(rows)] == [False, True]
    once = [replace(row, reduction=Timing.of([row.reduction.median])) for row in rows]
    assert [row.pareto for row in with_front(once)] == [True, False]  # of one run the spread is unknown: the smaller model wins


def test_a_recommendation_says_what_is_slower_and_what_is_not_to_be_trusted() -> None:
    def words(seconds: float, force: float, tolerance: float = 1e-3) -> str:
        time = Timing(seconds, seconds, seconds)
        full = Row("full", 0, 100, 0.0, 0.0, 0.0, 0, -1.0, 0.0, time, Timing(1.0, 1.0, 1.0), 0.0)
        small = Row("rubin", 5, 10, 0.0, 1e-5, 0.0, 0, -1.0, 0.0, time, time, 0.0, error_force=force,
                    parts={"disc": 3, "pad": 2})
        return Study("x", (0.0, 1.0), 1, full, (small,)).recommendation(tolerance)

    assert "4 times faster than the full model; the forces in the joints are within 5 %" in words(0.25, 0.05)
    assert "4 times slower than the full model; the forces in the joints are not to be trusted" in words(4.0, 0.4)
    assert "Rubin with 3 modes in disc, 2 in pad (10 DOF in total) comes nearest" in words(1.0, 0.0, 1e-6)


def test_reasons_that_are_the_same_are_told_once() -> None:
    time = Timing(1.0, 1.0, 1.0)
    full = Row("full", 0, 100, 0.0, 0.0, 0.0, 0, -1.0, 0.0, time, time, 0.0)
    rows = tuple(Row(method, size - 3, size, 0.0, 1e-5, np.nan, 0, np.nan, 0.0, time, time, 0.0, reason="M is singular")
                 for method in ("macneal", "guyan") for size in (4, 6))
    said = str(Study("x", (0.0, 1.0), 1, full, rows, parameter="slope")).splitlines()
    assert [line for line in said if "no critical slope" in line] == [
        f"no critical slope of {label} with 4, 6 DOF: M is singular" for label in ("MacNeal", "Guyan")]
    assert "take MacNeal with 1 mode (4 DOF)" in Study("x", (0.0, 1.0), 1, full, rows).recommendation()


def test_without_damping_the_frequencies_decide() -> None:
    """All growth rates are 0 then: the smallest model was recommended, whatever its frequencies."""
    full = fs.chain(20, damping=0.0)
    found = fs.study(full, [fs.CraigBampton(3), fs.CraigBampton(6), fs.CraigBampton(12)], (0.0, 0.2), repeats=1)
    errors = [row.error_frequency for row in found.rows]
    assert errors[0] > errors[1] > errors[2] and not any(row.error_growth for row in found.rows)
    tol = float(np.sqrt(errors[0] * errors[1]))
    assert found.decisive == "error_frequency" and found.recommended(tol) is found.rows[1]
    assert "of the undamped frequencies" in found.recommendation(tol) and "err ω" in found.brief(tol)
    assert "the undamped frequencies in the band are within" in found.advice(tol).decides[0]


@dataclass(frozen=True)
class Rubbing:
    """Two columns: a normal spring of stiffness 1, and the friction μ of its force along the other."""

    ports: tuple[str, ...] = ("n", "t")
    mu: float = 0.0

    def linearised(self, model: object) -> tuple[None, np.ndarray]:
        return None, np.array([[1.0, 0.0], [self.mu, 0.0]])


def test_undamped_frequencies_are_those_without_friction() -> None:
    """At one value of μ alone, the symmetric part of friction's stiffness may make K indefinite: the study ended there."""
    full = fs.chain(20)
    full = fs.Substructure(full.M, full.K, full.D, full.interface, {"n": np.eye(20)[5], "t": np.eye(20)[12]})
    K = full.linearised(Rubbing(mu=3.0)).K.toarray()
    assert np.linalg.eigvalsh((K + K.T) / 2)[0] < 0
    one, both = (fs.study(full, [fs.CraigBampton(5)], (0.0, 1.0), contacts=Rubbing(), parameter="mu", values=values, repeats=1)
                 for values in ((3.0,), (0.0, 3.0)))
    assert one.rows[0].error_frequency == pytest.approx(both.rows[0].error_frequency) and one.rows[0].error_frequency > 0
