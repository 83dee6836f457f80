"""The nonlinear model in time: energy, growth against the CEA, the paper's Fig. 5 in short, two integrators, hard cases."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.integrate import trapezoid
from scipy.linalg import expm

import femsub as fs
from femsub.motion.nonlinear_model import project, sliding

LAW = fs.StribeckArctan(eps=1e-3)
BELT = fs.Belt(speed=0.19113, law=LAW)
METHODS = ("full", "HCB", "CC")


def paper(kind: str, modes: int = 4) -> fs.Substructure:
    full = fs.chain(10, belt=2, damping=0.1)
    if kind == "full":
        return full
    with pytest.warns(fs.PortWarning):
        return fs.reduce(full, (fs.CraigBampton if kind == "HCB" else fs.CraigChang)(modes))


def one_mass(damping: float = 0.05) -> fs.Substructure:
    return fs.chain(1, belt=1, damping=damping)


@pytest.mark.parametrize("kind", METHODS)
def test_a_small_disturbance_grows_as_the_eigenvalue_says(kind: str) -> None:
    model = paper(kind)
    modes = fs.complex_modes(model, BELT)
    at = int(np.argmax(modes.eigenvalues.real))
    value, shape = modes.eigenvalues[at], modes.shapes[:, at] / np.abs(modes.shapes[:, at]).max() * 1e-6
    start = sliding(model, BELT).perturbed(shape.real, (value * shape).real)
    run = fs.transient(model, BELT, (0, 250), start=start, tol=1e-10)
    found = fs.growth_rate(run.t, run.velocity("belt"), below=1e-4)
    assert found.rate == pytest.approx(value.real, rel=1e-3)
    assert found.omega == pytest.approx(abs(value.imag), rel=1e-4)


@pytest.mark.parametrize("kind", METHODS)
def test_the_belt_s_work_is_what_is_dissipated_and_what_the_energy_gains(kind: str) -> None:
    run = fs.transient(paper(kind), BELT, (0, 600), step=0.05)
    energy = run.energy
    assert energy.residual < 1e-6 and energy.work > 0.3
    assert energy.work == pytest.approx(energy.dissipation + energy.change, rel=1e-6)
    # the same by quadrature of what was recorded
    power = run.friction("belt") * run.velocity("belt")
    assert trapezoid(power, run.t) == pytest.approx(energy.work, rel=1e-2)


@pytest.mark.slow
def test_two_integrators_agree_and_halving_the_tolerance_changes_nothing() -> None:
    model, window = paper("CC"), (1400.0, 1800.0)

    def seen(run: fs.Transient) -> tuple[float, float]:
        v = run.velocity("belt")
        return fs.rms(run.t, v, window), float(fs.spectrum(run.t, v, window).peaks[0])

    runs = {(method, tol): seen(fs.transient(model, BELT, (0, 1800), record_from=1400, step=0.1, method=method, tol=tol))
            for method, tol in (("lsoda", 1e-9), ("lsoda", 5e-10), ("dop853", 1e-9))}
    usual = runs["lsoda", 1e-9]
    assert runs["dop853", 1e-9] == pytest.approx(usual, rel=1e-4)
    assert runs["lsoda", 5e-10] == pytest.approx(usual, rel=1e-5)
    assert usual[1] == pytest.approx(0.7227, rel=5e-3)  # the paper's CC


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("kind", "frequency"), [("HCB", 0.7245), ("CC", 0.7227)])
def test_reduced_models_go_to_the_cycles_of_fig_5(kind: str, frequency: float) -> None:
    run = fs.transient(paper(kind), BELT, (0, 3000), record_from=2000, step=0.2)
    found = fs.spectrum(run.t, run.velocity("belt"))
    assert found.peaks[0] == pytest.approx(frequency, rel=5e-3)
    np.testing.assert_allclose(np.sort(found.peaks)[:3], frequency * np.arange(1, 4), rtol=5e-3)  # and multiples


@pytest.mark.slow
def test_the_full_model_looks_different_before_it_settles() -> None:
    run = fs.transient(paper("full"), BELT, (0, 2000), record_from=1000, step=0.2)
    found = fs.spectrum(run.t, run.velocity("belt"))
    np.testing.assert_allclose(found.peaks[0], 1.794, rtol=5e-3)
    for wanted in (0.148, 1.646):
        assert np.abs(found.peaks / wanted - 1).min() < 0.02


def test_all_models_start_from_the_same_blow() -> None:
    full, rom = paper("full"), paper("HCB")
    runs = [fs.transient(model, BELT, (0, 1), samples=10) for model in (full, rom)]
    np.testing.assert_allclose(runs[1].start.velocity, project(rom, full.M, runs[0].start.velocity), atol=1e-17)
    np.testing.assert_allclose(runs[0].start.velocity[1], 1e-3, rtol=1e-14)
    np.testing.assert_allclose(runs[0].velocity("belt")[0], 1e-3, rtol=1e-12)


def test_a_run_goes_on_where_another_ended() -> None:
    model = paper("HCB")
    whole = fs.transient(model, BELT, (0, 200), step=0.5, tol=1e-11)
    first = fs.transient(model, BELT, (0, 80), step=0.5, tol=1e-11)
    rest = fs.transient(model, BELT, (80, 200), start=first.final, step=0.5, tol=1e-11)
    np.testing.assert_allclose(np.concatenate([first.port("belt"), rest.port("belt")[1:]]), whole.port("belt"), atol=1e-8)
    assert whole.end == 200 and whole.complete


@pytest.mark.slow
def test_grids_and_records() -> None:
    model = fs.chain(3, belt=2)
    run = fs.transient(model, BELT, (0, 10), samples=7, record="states")
    np.testing.assert_allclose(run.t, np.linspace(0, 10, 8))
    assert run.states is not None
    np.testing.assert_allclose(run.states[1][:, 1], run.velocity("belt"), atol=1e-15)
    np.testing.assert_allclose(run.states[0][:, 1], run.port("belt"), atol=1e-15)
    late = fs.transient(model, BELT, (0, 10.25), step=0.5, record_from=6.1)
    np.testing.assert_allclose(late.t, np.arange(6.1, 10.25, 0.5))
    assert late.end == 10.25
    long = fs.transient(one_mass(), BELT, (0, 3000), step=4.0, record_from=100)  # several stretches, some before the record
    assert len(long.t) == len(long.velocity("belt")) == 726
    np.testing.assert_allclose(long.t, 100 + 4.0 * np.arange(726))
    assert fs.transient(model, BELT, (0, 1), step=5.0).t.tolist() == [0.0]
    assert "energy balance to" in repr(run) and "\n" not in repr(run)


def several() -> fs.Substructure:
    chain = fs.chain(6, belt=2)
    W = np.zeros((6, 2))
    W[3, 0], W[4, 1] = 1.0, 0.5
    return fs.Substructure(chain.M, chain.K, chain.D, [0], {"belt": chain.port("belt"), "pair": W, "end": np.eye(6)[5]})


@pytest.mark.rare
def test_several_belts_and_columns() -> None:
    model = several()
    belts = [BELT, fs.Belt("pair", force=0.5, speed=-0.1, law=fs.StribeckArctanOdd(eps=1e-2))]
    run = fs.transient(model, belts, (0, 60), ports=["end"], step=0.1, record="states")
    assert run.velocity("pair").shape == (601, 2) and run.port("end").shape == (601,) and run.energy.residual < 1e-6
    np.testing.assert_allclose(run.velocity("pair"), run.states[1] @ model.port("pair"), atol=1e-14)
    # another integrator with nothing but the definition
    from scipy.integrate import solve_ivp
    contact = sliding(model, belts)

    def rhs(t: float, y: np.ndarray) -> np.ndarray:
        force = contact.exerted(contact.W.T @ y[:6], contact.W.T @ y[6:])
        return np.concatenate([y[6:], contact.W @ force - model.D @ y[6:] - model.K @ y[:6]])

    start = contact.impulse()
    done = solve_ivp(rhs, (0, 60), np.concatenate([start.displacement, start.velocity]), "Radau", rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(done.y[6:, -1], run.final.velocity, atol=1e-6)


@pytest.mark.slow
def test_alpha_agrees_with_lsoda_and_closes_the_balance() -> None:
    full = fs.chain(10, belt=2, damping=0.1)
    start = fs.transient(paper("CC"), BELT, (0, 600), samples=1).final
    start = fs.State(*(paper("CC").expand(part) for part in (start.displacement, start.velocity)))
    exact = fs.transient(full, BELT, (0, 10), start=start, step=0.1)
    errors = []
    for tol in (1e-5, 1e-6):
        run = fs.transient(full, BELT, (0, 10), start=start, step=0.1, tol=tol, method="alpha")
        errors.append(np.abs(run.velocity("belt") - exact.velocity("belt")).max())
        assert run.end == pytest.approx(10) and run.energy.residual < 3e-4  # PETSc 3.18 and 3.26 differ
    assert errors[1] < 2e-3 and errors[1] < errors[0] / 3


@pytest.mark.slow
def test_a_large_sparse_model_takes_one_factor_per_step_size() -> None:
    model = fs.chain(2000, belt=2, damping=0.1)
    start = sliding(model, BELT).impulse(0.1)
    run = fs.transient(model, BELT, (0, 20), start=start, step=0.1)
    assert run.effort.method == "alpha" and run.effort.jacobians <= 40 and run.effort.steps > 200
    short = fs.transient(fs.chain(60, belt=2, damping=0.1), BELT, (0, 20), impulse=0.1, step=0.1)  # the wave is not back by then
    relative = run.velocity("belt") - short.velocity("belt")
    assert np.abs(relative).max() < 5e-3 * np.abs(short.velocity("belt")).max()


@pytest.mark.slow
@pytest.mark.sampled(99)
@pytest.mark.sampled(3)
@pytest.mark.parametrize(("samples", "blow"), [(100, 1e-3), (600, 1e-3), (600, 0.1)])
def test_alpha_sees_small_motions(samples: int, blow: float) -> None:
    model = fs.chain(320, belt=20)
    run = fs.transient(model, BELT, (0, 60), impulse=blow, samples=samples)
    exact = fs.transient(model, BELT, (0, 60), impulse=blow, samples=samples, method="lsoda", tol=1e-11).velocity("belt")
    assert run.effort.method == "alpha" and run.effort.jacobians <= 8
    wrong = np.abs(run.velocity("belt") - exact).max() / np.abs(exact).max()
    assert run.error is not None and wrong < 0.02 and wrong < run.error < 0.05
    assert f"local errors add up to {run.error:.1e} of the motion" in repr(run)


@pytest.mark.slow
@pytest.mark.sampled(99)
@pytest.mark.sampled(2)
@pytest.mark.parametrize(("method", "within"), [("alpha", 1e-4), ("lsoda", 1e-4), ("dop853", 1e-4), ("radau", 1e-4)])
def test_the_motion_after_a_tiny_blow_is_proportional_to_it(method: str, within: float) -> None:
    """Nothing in the accuracy may depend on the size of the motion while friction is as good as linear."""
    model = fs.chain(12, belt=3)
    runs = [fs.transient(model, BELT, (0, 20), impulse=blow, samples=100, method=method).velocity("belt") / blow
            for blow in (1e-6, 1e-9)]
    assert np.abs(runs[1] - runs[0]).max() < within * np.abs(runs[0]).max()


@pytest.mark.parametrize("method", ["alpha", "lsoda"])
def test_a_model_at_rest_stays_there_and_costs_nothing(method: str) -> None:
    run = fs.transient(fs.chain(12, belt=3), BELT, (0, 60), impulse=0.0, samples=300, method=method)
    assert not run.velocity("belt").any() and run.effort.steps <= 600 and run.energy.residual == 0


@dataclass(frozen=True)
class Line:
    """μ = level + fall v, and from the speed `kink` on with twice the fall; `wrong` is the relative error of the slope."""

    level: float = 0.5
    fall: float = -0.1
    kink: float = np.inf
    wrong: float = 0.0

    def value(self, v: Any) -> Any:
        return self.level + self.fall * (v + np.maximum(v - self.kink, 0.0))

    def slope(self, v: Any) -> Any:
        return self.fall * (1 + np.heaviside(v - self.kink, 0.5)) * (1 + self.wrong)


def linear_motion(model: fs.Substructure, contacts: list[Any], t: float, start: np.ndarray) -> np.ndarray:
    """exp(At) of the linearised model."""
    pencil = model.linearised(contacts).dense()
    n = pencil.size
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(pencil.M, pencil.K), -np.linalg.solve(pencil.M, pencil.D)]])
    return expm(A * t) @ start


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("method", "within"), [("lsoda", 1e-6), ("dop853", 1e-6), ("alpha", 5e-2)])
def test_linear_motion_is_right_at_every_size(method: str, within: float) -> None:
    """The belt's constant force is 1e20 times that of the smallest motion."""
    model, tol = fs.chain(6, belt=2, damping=0.1), 1e-4 if method == "alpha" else None
    spring = fs.LinearContact("belt", stiffness=[[0.3]], damping=[[0.05]])
    for contacts in ([fs.Belt(speed=10.0, law=Line())], [fs.Belt(speed=10.0, law=Line()), spring]):
        shape = np.append(np.zeros(6), model.port("belt"))
        exact = linear_motion(model, contacts, 20.0, shape)
        for blow in 10.0 ** -np.arange(0, 21, 4 if method == "lsoda" else 10):
            run = fs.transient(model, contacts, (0, 20), impulse=blow, samples=4, method=method, tol=tol)
            wrong = np.abs(run.final.velocity / blow - exact[6:]).max() / np.abs(exact[6:]).max()
            assert wrong < within and run.energy.residual < (1e-6 if method != "alpha" else 1e-2), blow
        assert run.rounding == 0


@pytest.mark.parametrize("method", ["lsoda", "alpha"])
def test_a_start_that_is_rounding_beside_the_static_deflection_is_told(method: str) -> None:
    model = fs.chain(6, belt=2, damping=0.1)
    shape = np.array([0.2, 1.0, -0.5, 0.3, 0.8, -0.4])
    exact = linear_motion(model, [BELT], 5.0, np.append(shape, np.zeros(6)))
    for size, told in ((1e-3, 1e-12), (1e-9, 1e-6), (1e-13, 1e-2), (1e-19, np.inf)):
        start = sliding(model, BELT).perturbed(shape * size)
        run = fs.transient(model, BELT, (0, 5), start=start, samples=4, method=method)
        wrong = np.abs(run.final.velocity / size - exact[6:]).max() / np.abs(exact[6:]).max()
        assert told / 30 <= run.rounding <= told * 30 or run.rounding == told
        assert wrong < (5e-3 if method == "alpha" else 1e-2 * size**0.5) + 30 * run.rounding
        assert ("is rounding" in repr(run)) == (run.effort.tol < run.rounding < 1)
        assert ("by rounding only" in repr(run)) == (run.rounding >= 1)


def test_the_change_of_friction_has_every_digit_however_small_the_motion_is() -> None:
    model, v0 = fs.chain(2, belt=2), 0.19113
    change = sliding(model, BELT).change(np.zeros(2))
    for v in (-1.0) ** np.arange(21) * 10.0 ** -np.arange(21):
        tail = np.arctan(-v / 1e-3 / (1 + v0 * (v0 - v) / 1e-6)) + (np.pi if v0 < v else 0) * -1
        further = -v if v < v0 else v - 2 * v0
        exact = 0.3 * 2 / np.pi * tail + 0.2 * np.exp(-2 * v0) * np.expm1(-2 * further)
        assert change(np.zeros(1), np.array([v]))[0] == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("law", [Line(kink=0.19113), Line(kink=0.19113 - 1e-6), Line(kink=0.19113 + 1e-5), Line(wrong=1e-3)])
def test_the_change_of_friction_is_its_value_s_wherever_that_can_be_told(law: Line) -> None:
    belt = fs.Belt(speed=0.19113, law=law)
    change = sliding(fs.chain(2, belt=2), belt).change(np.zeros(2))
    for v in np.outer([1, -1], 10.0 ** -np.arange(0.3, 21)).ravel():
        exact = law.value(belt.speed - v) - law.value(belt.speed)
        assert change(np.zeros(1), np.array([v]))[0] == pytest.approx(exact, rel=1e-9, abs=32 * np.finfo(float).eps)
    run = fs.transient(fs.chain(2, belt=2, damping=0.1), belt, (0, 50), impulse=1e-9, samples=5)
    assert run.effort.steps < 3000


def test_alpha_is_of_second_order_from_its_first_step_on() -> None:
    model, belt = fs.chain(5, belt=2, damping=0.1), fs.Belt(force=0.0, speed=0.1, law=LAW)
    start = fs.State(np.array([1.0, -0.5, 0.2, 0.0, 0.4]), np.array([0.0, 0.3, 0.0, -0.2, 0.1]))
    A = np.block([[np.zeros((5, 5)), np.eye(5)], [-model.K.toarray(), -model.D.toarray()]])
    wrong = []
    for h in (0.04, 0.02):
        run = fs.transient(model, belt, (0, h), start=start, samples=1, method="alpha")
        assert run.effort.steps == 1
        exact = expm(h * A) @ np.concatenate([start.displacement, start.velocity])
        wrong.append(np.abs(run.final.velocity - exact[5:]).max())
    assert wrong[1] < wrong[0] / 6  # local error of third order: 8


def test_without_a_normal_force_the_chain_rings_down() -> None:
    run = fs.transient(one_mass(0.1), fs.Belt(force=0.0, speed=0.2, law=LAW), (0, 40), impulse=0.01, step=0.1)
    omega = np.sqrt(1 - 0.05**2)
    np.testing.assert_allclose(run.port("belt"), 0.01 / omega * np.exp(-0.05 * run.t) * np.sin(omega * run.t), atol=1e-8)


def test_a_belt_at_rest_brings_everything_to_rest() -> None:
    run = fs.transient(one_mass(), fs.Belt(speed=0.0, law=fs.StribeckArctanOdd(eps=1e-3)), (0, 200), impulse=0.3, step=0.1)
    assert np.abs(run.velocity("belt"))[-200:].max() < 1e-3 and run.energy.work < 0


def test_a_reversed_belt_mirrors_an_odd_law_and_only_an_odd_one() -> None:
    model = paper("CC")

    def runs(law: fs.StribeckArctan) -> list[np.ndarray]:
        both = [fs.transient(model, fs.Belt(speed=sign * 0.18388, law=law), (0, 400), impulse=sign * 1e-3, step=0.2)
                for sign in (1, -1)]
        return [run.velocity("belt") for run in both]

    ahead, back = runs(fs.StribeckArctanOdd(eps=1e-3))
    np.testing.assert_allclose(back, -ahead, atol=1e-8)
    ahead, back = runs(LAW)
    assert np.abs(back + ahead).max() > 1e-3


def test_a_start_inside_the_sticking_phase_leaves_it_where_the_spring_overcomes_friction() -> None:
    belt = fs.Belt(speed=0.1, law=fs.StribeckArctanOdd(eps=1e-5))
    run = fs.transient(one_mass(0.0), belt, (0, 12), start=fs.State(np.zeros(1), np.array([0.1])), step=0.002)
    stuck = np.abs(0.1 - run.velocity("belt")) < 1e-3
    slip = run.t[np.argmin(stuck)]
    assert slip == pytest.approx(5.0, rel=0.02)  # 0.1 t = μ(0+) F = 0.5
    assert run.port("belt")[run.t < 4.5] == pytest.approx(0.1 * run.t[run.t < 4.5], abs=1e-3)


@pytest.mark.slow
def test_a_narrow_friction_layer_is_integrated_right() -> None:
    """ε → 1e-6: the arctan law tends to Coulomb's, and two methods find the same cycle."""
    belt = fs.Belt(speed=0.1, law=fs.StribeckArctanOdd(eps=1e-6))
    found = [fs.transient(one_mass(), belt, (0, 60), impulse=0.1, step=0.05, method=method, tol=1e-8)
             for method in ("lsoda", "radau")]
    np.testing.assert_allclose(found[0].port("belt"), found[1].port("belt"), atol=1e-5)
    assert fs.sticking(found[0], below=1e-3) == pytest.approx(fs.sticking(found[1], below=1e-3), abs=0.01)
    assert found[0].energy.residual < 1e-6


def test_ctrl_c_leaves_what_there_is(monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(text: str) -> None:
        raise KeyboardInterrupt

    ticking = SimpleNamespace(perf_counter=itertools.count().__next__)  # a second at each look
    monkeypatch.setattr("femsub.motion.transient.clock", ticking)
    run = fs.transient(paper("HCB"), BELT, (0, 5000), step=1.0, progress=stop)
    assert not run.complete and 0 < run.end < 5000 and "interrupted at t =" in repr(run)
    assert len(run.t) == len(run.velocity("belt")) > 100 and run.t[-1] == run.end
    assert np.isfinite(run.final.velocity).all()


@pytest.mark.parametrize(("keys", "words"), [
    ({"time": (5, 5)}, "time must be .* with lo < hi"), ({"time": (5, 1)}, "time must be"),
    ({"time": (0, np.nan)}, "time must be a finite"),
    ({"step": 0.0}, "step must be positive"), ({"step": 0.1, "samples": 3}, "either step or samples"),
    ({"samples": 0}, "at least 1"), ({"record_from": 50.0}, "record_from must lie"), ({"tol": 1.0}, "tol must lie"),
    ({"method": "euler"}, "unknown method 'euler'"), ({"record": "all"}, "unknown record"),
    ({"ports": ["bel"]}, "did you mean 'belt'"),
    ({"start": fs.State(np.zeros(3), np.full(3, np.nan))}, "NaN or Inf"),
    ({"start": fs.State(np.zeros(4), np.zeros(4))}, "3 entries, one per DOF.*project"),
    ({"start": fs.State(np.zeros(3), np.zeros(3)), "impulse": 1.0}, "either start or impulse"), ({"impulse": np.nan}, "impulse"),
])
def test_bad_input_says_what_to_do(keys: dict, words: str) -> None:
    with pytest.raises(fs.InputError, match=words):
        fs.transient(fs.chain(3, belt=2), BELT, **({"time": (0, 10)} | keys))


def test_bad_types_and_models_say_what_to_do() -> None:
    chain = fs.chain(3, belt=2)
    with pytest.raises(fs.InputTypeError, match="time must be"):
        fs.transient(chain, BELT, 10.0)  # type: ignore[arg-type]
    with pytest.raises(fs.InputTypeError, match="list of names"):
        fs.transient(chain, BELT, ports="belt")
    with pytest.raises(fs.InputTypeError, match="State"):
        fs.transient(chain, BELT, start=np.zeros(3))  # type: ignore[arg-type]
    with pytest.raises(fs.InputError, match="slope only"):
        fs.transient(chain, fs.Belt(slope=-0.2))
    for q, v, words in (("x", None, "displacement must be real numbers, not 'x'"), ([0.0], None, "velocity must be real numbers"),
                        ([0.0, 1.0], [0.0], r"shapes are \(2,\) and \(1,\)"), (0.0, 0.0, "one number per coordinate")):
        with pytest.raises((fs.InputError, fs.InputTypeError), match=words):
            fs.State(q, v)  # type: ignore[arg-type]
    massless = fs.Substructure(np.diag([1.0, 0.0]), [[2.0, -1.0], [-1.0, 1.0]], ports={"belt": [1.0, 0.0]})
    for method in ("auto", "alpha"):
        with pytest.raises(fs.InputError, match="singular"):
            fs.transient(massless, BELT, start=fs.State(np.zeros(2), np.zeros(2)), method=method)
    with pytest.raises(fs.InputError, match=r"'lsoda' is for dense models.*method='alpha'"):
        fs.transient(fs.chain(3000, belt=2), BELT, method="lsoda")
    run = fs.transient(chain, BELT, (0, 1))
    with pytest.raises(fs.InputError, match="unknown port 'bolt'"):
        run.port("bolt")
    with pytest.raises(fs.InputError, match="was not recorded"):
        fs.transient(several(), BELT, (0, 1)).velocity("end")
    with pytest.raises(fs.InputError, match="unknown port of a belt 'end'"):
        fs.transient(several(), BELT, (0, 1), ports=["end"]).friction("end")


def test_a_floating_model_has_no_equilibrium_but_moves_from_a_start_of_its_own() -> None:
    floating = fs.chain(4, belt=2, damping=0.0, fixed=False)
    with pytest.raises(fs.InputError, match="floats"):
        fs.transient(floating, BELT)
    run = fs.transient(floating, BELT, (0, 20), start=fs.State(np.zeros(4), np.zeros(4)), samples=10, record="states")
    assert run.states is not None and run.energy.residual < 1e-6
    momentum = run.states[1].sum(axis=1)
    assert momentum[-1] > 0 and momentum[-1] <= 4 * 0.19113 * 1.1  # dragged along, no faster than the belt takes it


def test_motion_without_bound_is_an_error() -> None:
    with pytest.raises(fs.NotConvergedError, match=r"without bound|stopped"):
        fs.transient(fs.chain(2, belt=2).with_damping(-np.eye(2)), BELT, (0, 5000), step=1.0)


def test_a_law_of_one_s_own() -> None:
    class Coulomb:
        """μ = 0.3 tanh(v / 0.01)."""

        def value(self, v: np.ndarray) -> np.ndarray:
            return 0.3 * np.tanh(v / 0.01)

        def slope(self, v: np.ndarray) -> np.ndarray:
            return 30 / np.cosh(np.clip(v / 0.01, -300, 300)) ** 2

    run = fs.transient(fs.chain(3, belt=2), fs.Belt(speed=0.1, law=Coulomb()), (0, 30), impulse=0.1, step=0.1)
    assert run.energy.residual < 1e-6
    with pytest.raises(fs.InputError, match="no eps"):
        fs.sticking(run)


def test_scalar_laws_are_the_laws() -> None:
    from femsub.coupling.contacts.belt import scalar_law

    v = np.concatenate([-np.geomspace(1, 1e-6, 30), [0.0], np.geomspace(1e-6, 1, 30)])
    for law in (fs.StribeckArctan(eps=1e-3), fs.StribeckArctanOdd(eps=1e-3, drop=0.1)):
        value, slope = scalar_law(law)
        np.testing.assert_allclose([value(x) for x in v.tolist()], law.value(v), rtol=1e-14)
        np.testing.assert_allclose([slope(x) for x in v.tolist()], law.slope(v), rtol=1e-13)


def test_the_jacobian_is_that_of_the_right_hand_side(rng: np.random.Generator) -> None:
    from femsub.motion.first_order import Flow

    damped = several().with_damping(sp.csr_array(np.diag([0.1, 0.2, 0.0, 0.3, 0.1, 0.2])))
    for model, belts in ((several(), [BELT]), (damped, [BELT, fs.Belt("pair", speed=0.1, law=LAW)])):
        contact = sliding(model, belts)
        system = Flow(contact, contact.impulse(), 0.0, 1e-9, "lsoda", contact.W)
        y = rng.uniform(-0.1, 0.1, 14)
        J = system.jacobian(0.0, y).T.copy()
        numeric = np.array([(system.rate(0.0, y + h).copy() - system.rate(0.0, y - h)) / 2e-7 for h in 1e-7 * np.eye(14)]).T
        np.testing.assert_allclose(J, numeric, atol=2e-6)


@pytest.mark.slow
def test_the_full_model_settles_to_fig_5() -> None:
    """The window of the paper is [12000, 20000] (scene chain-transient); the state is reached by 6000."""
    run = fs.transient(paper("full"), BELT, (0, 8000), record_from=6000, step=0.2)
    found = fs.spectrum(run.t, run.velocity("belt"))
    np.testing.assert_allclose(np.sort(found.peaks[:3]), [0.1485, 1.642, 1.791], rtol=5e-3)
    assert run.energy.residual < 1e-6


@pytest.mark.parametrize("method", ["lsoda", "alpha"])
def test_the_motion_does_not_depend_on_when_it_begins(method: str) -> None:
    """LSODA lost digits far from t = 0: at 1e9 the error was 4e-5, and from 1e15 on it failed."""
    belt = fs.Belt(speed=0.2, law=fs.StribeckArctan(eps=1e-2))
    first = fs.transient(fs.chain(6, belt=2), belt, (0.0, 20.0), samples=10, method=method)
    for begin in (1e9, 1e15):
        later = fs.transient(fs.chain(6, belt=2), belt, (begin, begin + 20.0), samples=10, method=method)
        assert np.array_equal(later.t, begin + first.t) and later.end == begin + 20.0
        assert np.array_equal(later.velocity("belt"), first.velocity("belt"))


@pytest.mark.parametrize(("time", "more"), [((0.0, 1e-12), {}), ((0.0, 5.0), {"record_from": 4.999999}),
                                            ((1e8, 1e8 + 1e-7), {"step": 1.0})])
def test_a_run_may_be_shorter_than_its_step(time: tuple[float, float], more: dict[str, float]) -> None:
    run = fs.transient(fs.chain(6, belt=2), fs.Belt(speed=0.2, law=fs.StribeckArctan(eps=1e-2)), time, **more)  # type: ignore[arg-type]
    assert run.complete and run.end == time[1] and len(run.t) == 1
