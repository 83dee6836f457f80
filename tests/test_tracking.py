"""Modes followed over a parameter: closed forms of coalescence, veering and crossing, random models against fine steps."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from benchmarks.attacks.borders import meetings
from femsub.algebra import factors_made
from femsub.app.cli import main
from femsub.app.grammar import text_of
from femsub.components import two_mode, two_mode_critical, ziegler, ziegler_critical
from femsub.modes import match
from femsub.output import draw
from femsub.reduction import METHODS
from femsub.stability.flutter_chart import OTHERS, flutter_chart

EYE = np.eye(2)


def pair(coupling: float, damping: tuple[float, float] = (0.0, 0.0)) -> fs.Affine:
    """Two oscillators, ω² = 4 ± √(p² + c²)."""
    return fs.Affine(EYE, np.diag(damping), [(1.0, [[4.0, coupling], [coupling, 4.0]]), ("p", [[1.0, 0.0], [0.0, -1.0]])])


def random_model(seed: int, n: int = 4) -> fs.Affine:
    """K0 + pK1 with a random, for even seeds unsymmetric K1; damped, so that no two eigenvalues meet exactly."""
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.standard_normal((n, n)))[0]
    change, dashpots = rng.standard_normal((2, n, n))
    return fs.Affine(np.eye(n), 0.02 * dashpots @ dashpots.T,
                     [(1.0, (Q * rng.uniform(20, 40, n)) @ Q.T), ("p", 2 * (change if seed % 2 == 0 else change + change.T))])


def by_fine_steps(model: fs.Affine, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """λ at p = -1 and, in the same order, at p = 1: each step takes the eigenvalues next to those continued in a line."""
    before = here = np.zeros(0)
    for i, p in enumerate(np.linspace(-1.0, 1.0, steps)):
        pencil = model.at(p=p)
        state = np.block([[np.zeros_like(pencil.M), np.eye(len(pencil.M))], [-pencil.K, -pencil.D]])
        values = np.linalg.eigvals(state)
        if i == 0:
            start = before = here = values
        else:
            before, here = here, values[match(2 * here - before, values)[1]]
    return start, here


def test_a_line_of_text_counts_the_meetings() -> None:
    """ω² = 1 + s crosses 1.2 and 3, which do not act on it."""
    three = fs.Affine(np.eye(3), None, [(1.0, np.diag([1.0, 1.2, 3.0])), ("s", np.diag([1.0, 0.0, 0.0]))])
    assert "; 2 crossings; " in repr(fs.track(three, None, "s", np.linspace(0.0, 4.0, 11)))
    assert "; 1 crossing; " in repr(fs.track(three, None, "s", np.linspace(0.0, 1.0, 11)))


@pytest.mark.parametrize("values", [np.linspace(0, 1.5, 7), [0.0, 1.0], np.linspace(0, 1, 6)])
def test_two_modes_coalesce_at_three_quarters(values: np.ndarray) -> None:
    found = fs.track(two_mode(), None, "mu", values)
    (met,) = found.meetings
    assert met.kind == "coalescence" and met.value == pytest.approx(0.75, abs=1e-8)
    assert met.eigenvalue == pytest.approx(1j * np.sqrt(2), abs=1e-6)
    # the square root: ω² are 2 ± √(1 - 4μ/3), at every value computed
    squares = -found.eigenvalues**2
    assert np.allclose(squares.sum(axis=1), 4.0, atol=1e-8)
    assert np.allclose((squares[:, 1] - squares[:, 0]) ** 2 / 4, 1 - 4 * found.values / 3, atol=1e-7)
    assert found.eigenvalues[0, 0].imag < found.eigenvalues[0, 1].imag  # the higher branch grows
    assert found.eigenvalues[-1, 1].real > 0.1 and found.growing[-1].tolist() == [False, True]


def test_at_the_exceptional_point_no_eigenvalue_is_told_better_than_the_root_of_eps() -> None:
    (met,) = fs.track(two_mode(), None, "mu", np.linspace(0, 1, 5)).meetings  # 3/4 is one of the values
    assert met.gap < 1e-7 and met.condition > 1e6 and 1e-9 < met.error_bar < 1e-5
    (met,) = fs.track(two_mode((0.05, 0.1)), None, "mu", np.linspace(0, 1, 5)).meetings  # damping keeps them apart
    assert met.kind == "coalescence" and 1e-3 < met.gap < 0.05 and met.condition < 1e3 and met.error_bar < 1e-11


def test_a_value_at_the_exceptional_point_itself_breaks_no_branch() -> None:
    """K = [[2, d], [1, 2]] with ω² = 2 ± √d: at d = 0 there is one vector, free of rounding."""
    model = fs.Affine(EYE, None, [(1.0, [[2.0, 0.0], [1.0, 2.0]]), ("d", [[0.0, 1.0], [0.0, 0.0]])])
    found = fs.track(model, None, "d", [-0.5, -0.25, 0.0, 0.25, 0.5])
    assert found.eigenvalues.shape[1] == 2 and not np.isnan(found.eigenvalues).any()
    (met,) = found.meetings
    assert met.kind == "splitting" and abs(met.value) < 1e-7 and met.condition > 1e6
    assert np.allclose((-found.eigenvalues**2 - 2) ** 2, found.values[:, None], atol=1e-7)


def test_a_mode_that_looks_rigid_beside_its_coalescence_breaks_no_branch() -> None:
    """Where a step was halved it had ω = 7e-6, was taken for rigid motion there, and its branch ended."""
    with pytest.warns(fs.ConditionWarning, match="rigid"):
        assert meetings("symmetric", 2) == "certified"


@pytest.mark.sampled(13)
@pytest.mark.parametrize("rigid", [0, 1])
@pytest.mark.parametrize("values", [[-1, 0, 1], [-1, 0.3, 1], [0, 0.5, 1], [-1, -0.5, 0], [-1, -0.5, 0, 0.5, 1]])
@pytest.mark.parametrize("damping", [0.0, 0.1])
@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_an_eigenvalue_0_at_a_value_asked_for_breaks_no_branch(rigid: int, values: list[float], damping: float, way: float
                                                              ) -> None:
    """λ² + dλ ∓ p = 0 has λ = 0 at p = 0: of a pair without damping, else of one real λ. Rigid motion is no branch."""
    moves = np.diag(np.eye(2 + rigid)[0])
    model = fs.Affine(np.eye(len(moves)), damping * moves, [(1.0, np.diag(4 * np.eye(2 + rigid)[1])), ("p", way * moves)])
    found = fs.track(model, None, "p", values)
    real = max(damping**2 / 4 - way * p for p in values) > 0
    assert found.eigenvalues.shape[1] == (3 if real else 2) and not np.isnan(found.eigenvalues).any()
    polynomial = found.eigenvalues**2 + damping * found.eigenvalues + way * found.values[:, None]
    assert (np.count_nonzero(np.abs(polynomial) < 1e-8, axis=1) == (2 if real else 1)).all()
    if not damping and values[0] < 0 < values[-1]:
        (met,) = found.meetings
        assert met.kind == ("coalescence" if way < 0 else "splitting") and abs(met.value) < 1e-8


@pytest.mark.parametrize("coupling", [0.2, 1e-2, 1e-4])
def test_a_veering_pair_follows_its_curves(coupling: float) -> None:
    found = fs.track(pair(coupling), None, "p", np.linspace(-1.0, 1.1, 6))
    for column, sign in ((0, -1), (1, 1)):
        assert np.allclose(found.eigenvalues[:, column].imag ** 2, 4 + sign * np.hypot(found.values, coupling), atol=1e-12)
    (met,) = found.meetings
    assert met.kind == "veering" and abs(met.value) < 0.05 * coupling and met.gap == pytest.approx(coupling / 2, rel=0.05)
    assert len(found.values) < 60


@pytest.mark.parametrize("damping", [(0.0, 0.0), (0.1, 0.02)])
def test_modes_that_do_not_act_on_each_other_cross(damping: tuple[float, float]) -> None:
    found = fs.track(pair(0.0, damping), None, "p", np.linspace(-1.0, 1.1, 6))
    assert found.asked.all()  # no step is halved
    for column, sign in ((0, 1), (1, -1)):
        omega = np.sqrt(4 + sign * found.values - damping[column] ** 2 / 4)
        assert np.allclose(found.eigenvalues[:, column], -damping[column] / 2 + 1j * omega, atol=1e-12)
    (met,) = found.meetings
    assert met.kind == "crossing" and abs(met.value) < 2e-3
    assert met.gap == pytest.approx(abs(damping[0] - damping[1]) / 2, abs=1e-6)


@pytest.mark.parametrize("angle", [0.4, 0.7, 1.0, 1.3])
def test_a_crossing_at_a_value_asked_for_goes_straight(angle: float) -> None:
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])  # at p = 0 all vectors are eigenvectors
    model = fs.Affine(EYE, None, [(4.0, EYE), ("p", turn @ np.diag([1.0, -1.0]) @ turn.T)])
    found = fs.track(model, None, "p", np.linspace(-1.0, 1.0, 5))
    assert np.allclose(np.diff(found.eigenvalues.imag**2, axis=0), [[0.5, -0.5]] * 4, atol=1e-12) \
        or np.allclose(np.diff(found.eigenvalues.imag**2, axis=0), [[-0.5, 0.5]] * 4, atol=1e-12)
    assert [met.kind for met in found.meetings] == ["crossing"]


@pytest.mark.parametrize("b", [1e-4, 1e-3])
def test_long_steps_over_a_near_coalescence_take_the_branch_that_grows_already(b: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """With damping the lower branch of Ziegler's pendulum grows before the two come together, and goes on growing."""
    monkeypatch.setattr("femsub.stability.tracking.EQUAL", 1e-2)
    found = fs.track(ziegler(b), None, "P", np.linspace(1.0, 3.0, 4))
    assert found.eigenvalues[0, 0].imag < found.eigenvalues[0, 1].imag and len(found.values) < 20
    assert found.eigenvalues[-1, 0].real > 0.1 > found.eigenvalues[-1, 1].real


def test_a_double_real_eigenvalue_of_one_vector_breaks_no_branch() -> None:
    """λ² + 2λ + 1 + p: critical damping at p = 0, where left and right vectors are at right angles."""
    found = fs.track(fs.Affine([[1.0]], [[2.0]], [(1.0, [[1.0]]), ("p", [[1.0]])]), None, "p", np.linspace(-0.5, 0.5, 5))
    assert found.eigenvalues.shape[1] == 2 and np.allclose((found.eigenvalues + 1) ** 2, -found.values[:, None], atol=1e-8)
    (met,) = found.meetings
    assert met.kind == "splitting" and abs(met.value) < 1e-8 and met.condition == met.error_bar == np.inf


def test_two_meetings_in_one_step_are_both_seen() -> None:
    """κ = 1 - 4/3 p(2 - p) vanishes at p = 1/2 and 3/2; the ends of the range look alike."""
    model = fs.Affine(EYE, None, [(1.0, [[2.0, 1.0], [1.0, 2.0]]), (lambda p: p * (2 - p), [[0.0, -4 / 3], [0.0, 0.0]])])
    found = fs.track(model, None, "p", [0.0, 2.0])
    assert [met.kind for met in found.meetings] == ["coalescence", "splitting"]
    assert np.allclose([met.value for met in found.meetings], [0.5, 1.5], atol=1e-7)


def test_a_third_mode_that_passes_a_growing_and_a_decaying_one_coalesces_with_neither() -> None:
    """Two λ become one at 0.421; from 0.45 on all of them are at least 0.09 apart."""
    K = np.array([[5.74, 0.22, -0.08, 0.34], [0.22, 3.6, -0.19, -0.06], [-0.08, -0.19, 3.36, -0.1], [0.34, -0.06, -0.1, 4.68]])
    C = np.array([[0.0, 2.43, 0.32, -0.52], [0.0, 0.0, 0.46, 0.04], [0.0, 0.0, 0.0, -0.08], [0.0, 0.0, 0.0, 0.0]])
    found = fs.track(fs.Affine(np.eye(4), None, [(1.0, K), ("p", C - C.T)]), None, "p", np.linspace(0, 1, 14))
    (met,) = [met for met in found.meetings if met.kind in ("coalescence", "splitting")]
    assert met.value == pytest.approx(0.421069, abs=1e-6) and met.gap < 1e-6
    assert [other.kind for other in found.meetings if other is not met] == ["crossing", "crossing"]


@pytest.mark.parametrize("beside", [1e-6, 1e-9])
def test_a_value_next_to_a_narrow_flutter_hides_neither_of_its_ends(beside: float) -> None:
    """ω² = 4 ± √(p² - c²): the two λ at the middle value are one but for 1e-6."""
    c = 1e-3
    model = fs.Affine(EYE, None, [(1.0, [[4.0, c], [-c, 4.0]]), ("p", [[1.0, 0.0], [0.0, -1.0]])])
    found = fs.track(model, None, "p", [-1.0, -c * (1 - beside), 1.1])
    assert [met.kind for met in found.meetings] == ["coalescence", "splitting"]
    assert np.allclose([met.value for met in found.meetings], [-c, c], atol=1e-8)


def test_equal_eigenvalues_all_along_cost_nothing() -> None:
    """Four double eigenvalues, as of a disc; their vectors are arbitrary at each value."""
    Q = np.linalg.qr(np.random.default_rng(3).standard_normal((8, 8)))[0]
    first, second = ((Q * np.repeat(values, 2)) @ Q.T for values in ([1.0, 3.0, 5.0, 7.0], [0.5, 0.1, -0.3, 0.2]))
    model = fs.Affine(np.eye(8), None, [(1.0, (first + first.T) / 2), ("p", (second + second.T) / 2)])
    found = fs.track(model, None, "p", np.linspace(0, 1, 9))
    assert found.asked.all() and found.eigenvalues.shape == (9, 8)
    assert np.allclose(np.sort(found.eigenvalues.imag**2, axis=1)[:, :2], 1 + found.values[:, None] / 2)


def test_real_eigenvalues_have_branches_of_their_own() -> None:
    """Above P = 7/2 + √2 Ziegler's pendulum has four real eigenvalues; the spectrum is complete at each value."""
    found = fs.track(ziegler(), None, "P", np.linspace(0.0, 8.0, 9))
    for P, row in zip(found.values, found.eigenvalues, strict=True):
        exact = fs.complex_modes(ziegler().at(P=P)).eigenvalues
        both = np.append(row, row.conj())
        assert np.abs(exact[:, None] - both).min(axis=1).max() < 1e-6
    at = [met.value for met in found.meetings if met.kind == "coalescence"]
    assert np.allclose(np.unique(np.round(at, 6)), [3.5 - np.sqrt(2), 3.5 + np.sqrt(2)], atol=2e-6)
    assert found.eigenvalues.shape[1] == 4 and np.abs(found.eigenvalues[-1].imag).max() == 0.0


@pytest.mark.sampled(6)
@pytest.mark.parametrize("seed", range(10))
def test_random_models_agree_with_fine_steps(seed: int) -> None:
    model = random_model(seed)
    start, end = by_fine_steps(model, 1500)
    found = fs.track(model, None, "p", np.linspace(-1.0, 1.0, 4))
    assert found.eigenvalues.shape[1] == 4 and not np.isnan(found.eigenvalues).any()
    for branch in found.eigenvalues.T:
        assert abs(end[np.abs(start - branch[0]).argmin()] - branch[-1]) < 1e-8


def test_a_reduced_model_under_a_belt() -> None:
    full = fs.chain(10, belt=2)
    rom = fs.reduce(full, fs.CraigChang(modes=4), ports=True)
    slopes = np.linspace(-0.05, 0.0, 5)
    one, other = (fs.track(model, fs.Belt(slope=0.0), "slope", slopes, band=(0.0, 0.8)) for model in (full, rom))
    assert np.abs(one.eigenvalues[one.asked] - other.eigenvalues[other.asked]).max() < 1e-4
    whole = fs.track(rom, fs.Belt(slope=0.0), "slope", slopes)
    assert whole.band[1] == rom.cutoff and np.nanmax(whole.eigenvalues[0].imag) <= rom.cutoff
    with pytest.raises(fs.InputError, match="above the cut-off"):
        fs.track(rom, fs.Belt(slope=0.0), "slope", slopes, band=(0.0, 2 * rom.cutoff))


def test_a_branch_may_leave_the_band() -> None:
    found = fs.track(pair(0.0), None, "p", np.linspace(-1.0, 1.0, 9), band=(1.7, 2.02))
    leaves = np.sqrt(4 + found.values) > 2.02 + 0.1 * 0.32
    assert found.eigenvalues.shape[1] == 2 and np.isnan(found.eigenvalues[leaves, 0]).all()
    assert np.allclose(found.eigenvalues[~leaves, 0].imag, np.sqrt(4 + found.values[~leaves]))


def test_a_sparse_model_is_searched_in_its_band() -> None:
    n = 320
    K = sp.diags_array([-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1)], offsets=[-1, 0, 1], format="csr")
    follower = sp.csr_array(([1.0], ([5], [n - 9])), shape=(n, n))
    model = fs.Affine(sp.eye_array(n, format="csr"), None, [(1.0, K), ("p", follower)])
    values, band = np.linspace(0.0, 0.004, 3), (0.0, 0.03)
    found = fs.track(model, None, "p", values, band=band)
    for p, row in zip(found.values, found.eigenvalues, strict=True):
        modes = fs.complex_modes(model.at(p=p), band=band)
        assert np.abs(modes.eigenvalues[:, None] - row[~np.isnan(row)]).min(axis=1).max() < 1e-9
    with pytest.raises(fs.InputError, match="needs a band"):
        fs.track(model, None, "p", values)


@pytest.mark.slow
def test_many_values_of_a_large_model_take_one_small_one() -> None:
    """Its branches are those of single solutions within their error bars, and meet where these do; no value has a factor."""
    n, band = 400, (0.0, 0.06)
    K = sp.diags_array([-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1)], offsets=[-1, 0, 1], format="csr")
    follower = sp.csr_array(([1.0, -1.0], ([5, n - 9], [n - 9, 5])), shape=(n, n))
    model = fs.Affine(sp.eye_array(n, format="csr"), 1e-3 * K, [(1.0, K), ("p", follower)])
    values = np.linspace(0.0, 0.01, 10)
    before = factors_made()
    small = fs.reduce(model, fs.ParameterBox({"p": (0.0, 0.01)}, (0.0, 0.066)))
    made, before = factors_made() - before, factors_made()
    found = fs.track(model, None, "p", values, band=band)
    assert factors_made() - before == made
    for at, p in zip(np.flatnonzero(found.asked), values, strict=True):
        modes, row = fs.complex_modes(model.at(p=p), band=band), found.eigenvalues[at]
        near = np.abs(modes.eigenvalues[:, None] - np.nan_to_num(row, nan=np.inf))
        assert len(modes) == np.count_nonzero((row.imag >= 0) & (row.imag <= band[1])) > 5
        assert (near.min(axis=1) <= found.error_bar[at][near.argmin(axis=1)] + modes.error_bar).all()
        assert (found.error_bar[at] <= 1e-6 * np.abs(row))[~np.isnan(row)].all()
    again = fs.track(small, None, "p", values, band=band)
    assert again.eigenvalues.shape == found.eigenvalues.shape
    assert np.allclose(again.eigenvalues, found.eigenvalues, rtol=1e-6, atol=0.0, equal_nan=True)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("what", ["pole", "open"])
def test_where_no_small_model_is_proved_values_are_solved_alone(what: str) -> None:
    """A factor that is infinite between two values, or gyroscopic forces beyond the bound: no error, and no word of cells."""
    n, band = 320, (0.0, 0.05)
    K = sp.diags_array([-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1)], offsets=[-1, 0, 1], format="csr")
    turn = sp.csr_array(sp.diags_array([np.ones(n - 1), -np.ones(n - 1)], offsets=[1, -1]))
    pair = sp.csr_array(([1.0, -1.0], ([5, n - 9], [n - 9, 5])), shape=(n, n))
    D, K_of = ([(1.0, 1e-3 * K)], [(1.0, K), (lambda p: 1e-4 / p, pair)]) if what == "pole" else \
        ([(1.0, 1e-3 * K), ("p", turn)], [(1.0, K)])
    model, values = fs.Affine(sp.eye_array(n, format="csr"), D, K_of), np.linspace(-0.3, 0.3, 10)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", ".*cells")
        found = fs.track(model, None, "p", values, band=band)
    for p, row in zip(values.tolist(), found.eigenvalues[found.asked], strict=True):
        modes = fs.complex_modes(model.at(p=p), band=band)
        assert len(modes) and np.abs(modes.eigenvalues[:, None] - row[~np.isnan(row)]).min(axis=1).max() < 1e-9


def test_the_limit_of_the_effort_is_reported() -> None:
    with pytest.warns(fs.FemsubWarning, match="3 steps were halved, which is the limit"):
        assert len(fs.track(pair(1e-3), None, "p", [-1.0, 1.1], halvings=3).values) == 5


def test_what_cannot_be_tracked_is_refused() -> None:
    for values in ([1.0], [], [[0.0, 1.0], [2.0, np.nan]]):
        with pytest.raises(fs.InputError, match="values"):
            fs.track(two_mode(), None, "mu", values)
    with pytest.raises(fs.InputError, match="unknown parameter 'my'; did you mean 'mu'"):
        fs.track(two_mode(), None, "my", [0.0, 1.0])
    with pytest.raises(fs.InputError, match="no ports for contacts"):
        fs.track(two_mode(), fs.Belt(slope=0.0), "mu", [0.0, 1.0])
    with pytest.raises(fs.InputError, match="unknown parameter 'mu'"):
        fs.track(fs.chain(3), fs.Belt(slope=0.0), "mu", [0.0, 1.0])


def test_the_closed_forms_of_both_models() -> None:
    for damping in ((0.0, 0.0), (0.05, 0.3), (0.0, 0.2)):
        found = fs.critical_value(two_mode(damping), None, "mu", between=(0.0, 2.0))
        assert float(found) == pytest.approx(two_mode_critical(damping), abs=1e-10)
    for b in (0.0, 1e-3, 0.4):
        found = fs.critical_value(ziegler(b), None, "P", between=(0.0, 3.0))
        assert float(found) == pytest.approx(ziegler_critical(b), abs=1e-10)


def test_full_and_reduced_models_in_one_diagram() -> None:
    full = fs.chain(10, belt=2)
    models = {"full": full, "craig-chang": fs.reduce(full, fs.CraigChang(modes=4), ports=True)}
    tracks = {name: fs.track(model, fs.Belt(slope=0.0), "slope", np.linspace(-0.05, 0.0, 11), band=(0.0, 0.8))
              for name, model in models.items()}
    lost = {name: list(fs.critical_value(model, fs.Belt(slope=0.0), "slope", between=(0.0, -0.05), band=(0.0, 0.8)).losses)[:1]
            for name, model in models.items()}
    figure = draw(flutter_chart("a", tracks, lost, "slope", "chain"))
    told = [text.get_text() for text in figure.legends[0].get_texts()]
    assert told == ["a mode grows", *(f"full, mode {j}" for j in range(1, tracks["full"].eigenvalues.shape[1] + 1)),
                    "ceases to grow", "Craig-Chang", "Craig-Chang, a mode grows", "full: stability lost at -0.02557",
                    "Craig-Chang: stability lost at -0.02557"]
    assert [axis.get_ylabel() for axis in figure.axes] == ["Im λ  [rad/time]", "Re λ  [1/time]", "-Re λ / |λ|  [%]"]


def test_branches_without_a_part_in_it_are_grey_and_models_solved_here_and_there_have_circles() -> None:
    chain = fs.chain(10, belt=2)
    tracked = fs.track(chain, fs.Belt(slope=0.0), "slope", np.linspace(-0.05, 0.0, 4))
    solved = [(-0.05, fs.complex_modes(chain, fs.Belt(slope=-0.05)).eigenvalues), (0.0, fs.complex_modes(chain).eigenvalues)]
    figure = draw(flutter_chart("a", {"all": tracked}, {}, "slope", "chain", {"full": solved}))
    told = [text.get_text() for text in figure.legends[0].get_texts()]
    grows = np.flatnonzero(tracked.growing.any(axis=0)) + 1
    assert told == ["a mode grows", "all, other modes", *(f"all, mode {j}" for j in grows), "ceases to grow", "full, stable",
                    "full, unstable"] and 2 < len(grows) < 8
    circles = {line.get_label(): line.get_ydata() for line in figure.axes[0].lines if line.get_label().startswith("full")}
    grow = np.concatenate([values for _, values in solved]).real > 0
    assert len(circles["full, unstable"]) == grow.sum() > 0 and len(circles["full, stable"]) == (~grow).sum()
    assert figure.axes[1].get_yscale() == "linear"  # what grows is seen beside what decays: within a factor of 10
    lo, hi = figure.axes[1].get_ylim()
    assert lo < tracked.eigenvalues.real.min() and tracked.eigenvalues.real.max() < hi


def test_a_meeting_has_a_mark_that_no_model_has() -> None:
    model = two_mode()
    solved = [(mu, fs.complex_modes(model.at(mu=mu)).eigenvalues) for mu in (0.5, 1.0)]
    chart = flutter_chart("a", {"reduced": fs.track(model, None, "mu", np.linspace(0.0, 1.0, 12))}, {}, "mu", "two modes",
                          {"full": solved})
    page = (Path(fs.__file__).parent / "output" / "page.html").read_text(encoding="utf-8")
    for panel in chart.panels:
        marks = {one.name: one.look.marker for one in panel.series if one.look.marker}
        meeting = marks.pop("coalescence or splitting")
        assert {"full, stable", "full, unstable", "begins to grow"} <= set(marks)
        assert meeting not in {*marks.values(), *(method.marker for method in METHODS.values()), *(mark for _, mark in OTHERS)}
        assert f' {meeting}: "' in page  # else a page draws a circle


@pytest.mark.parametrize("points", [5, 8, 40])
def test_a_branch_turns_colour_where_stability_is_lost_and_regained(points: int) -> None:
    """The mode grows from 0.0413 to 0.1158; the values computed nearest to that, of five, are 0.054 and 0.1025."""
    from femsub.components import disc_pair

    A = disc_pair()
    model = fs.Affine(A["M"], [(1.0, A["D1"]), (lambda speed: 0.4 / speed, A["DR"]), ("speed", A["DG"])],
                      [(1.0, A["K1"]), (0.4, A["KR"]), (lambda speed: speed**2, A["Kgeo"])])
    found = fs.critical_value(model, None, "speed", between=(0.005, 0.2))
    (lost,), (regained,) = found.losses, found.regains
    tracked = fs.track(model, None, "speed", np.linspace(0.005, 0.2, points))
    chart = flutter_chart("a", {"disc": tracked}, {"disc": [lost, regained]}, "mu", "disc")
    for panel in chart.panels:
        wide = next(one for one in panel.series if one.name == "a mode grows" and np.isfinite(one.y).any())
        drawn = np.asarray(wide.x)[np.isfinite(wide.y)]
        assert drawn[0] == lost.value and drawn[-1] == regained.value and panel.x == "μ"
        ends = {one.name: list(one.x) for one in panel.series if one.marker in ("^", "v")}
        assert ends == {"begins to grow": [lost.value], "ceases to grow": [regained.value]}
    below = flutter_chart("a", {"disc": tracked}, {}, "mu", "disc").panels[1]  # without them: where a straight line is 0
    at = {one.name: one for one in below.series if one.marker in ("^", "v")}
    assert list(at["begins to grow"].y) == [0.0] and abs(at["begins to grow"].x[0] - lost.value) < 0.2 / points
    texts = [level.text for level in chart.panels[0].levels]
    assert texts == [f"disc: stability lost at {lost.value:.4g}", f"disc: stability regained at {regained.value:.4g}"]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("name", "exact"), [("two-mode", [0.75, 0.7575]), ("ziegler", [3.5 - np.sqrt(2), 41 / 28 + 5e-5])])
def test_scenes_tell_the_critical_values_beside_the_closed_forms(tmp_path: Path, name: str, exact: list[float]) -> None:
    (tmp_path / "a.toml").write_text(text_of(name).replace("points = 151", "points = 7"), encoding="utf-8")
    assert main(["run", str(tmp_path / "a.toml"), "--out", str(tmp_path / "out")]) == 0
    told = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    lost = [row for row in told["critical"] if row["stability"] == "lost"]
    assert np.allclose([row["value"] for row in lost][:2], exact, atol=1e-10) and max(row["error"] for row in lost) < 1e-10
    assert {row["kind"] for row in told["flutter"]["meetings"]} >= {"coalescence"} and (tmp_path / "out" / "flutter.png").exists()
