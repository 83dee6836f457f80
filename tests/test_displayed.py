"""Results show themselves: each chart holds the numbers of its result, figures have units, tables become data frames."""

from __future__ import annotations

import re
import sys
from base64 import b64decode
from collections.abc import Callable
from functools import cache
from html import escape
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy import stats

import femsub as fs
from femsub.output import Chart, Displayed

SLOPE = fs.Belt(slope=-0.05)
LAW = fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=2e-2))
K = [(1.0, [[1, 0], [0, 2]]), ("split", [[0, 0], [0, 1]]), ("mu", [[0, 1], [-1, 0]])]


@cache
def model() -> fs.Substructure:
    return fs.chain(10, belt=2, damping=0.1)


@cache
def small() -> fs.Substructure:
    return fs.reduce(model(), fs.CraigChang(3), ports=True)


@cache
def modes() -> fs.ComplexModes:
    return fs.complex_modes(model(), SLOPE)


@cache
def pair() -> fs.Affine:
    return fs.Affine([[1, 0], [0, 1]], [[0.1, 0], [0, 0.1]], K)


@cache
def cycle() -> fs.LimitCycle:
    return fs.harmonic_balance(small(), LAW, harmonics=40)


@cache
def run() -> fs.Transient:
    return fs.transient(small(), LAW, time=(0, 200))


MADE: dict[str, Callable[[], Any]] = {
    "complex modes": modes,
    "normal modes": lambda: fs.normal_modes(model(), count=6),
    "critical value": lambda: fs.critical_value(pair().fixed(split=0.5), None, "mu", between=(0.0, 2.0)),
    "tracked": lambda: fs.track(pair().fixed(split=0.5), None, "mu", np.linspace(0, 2, 9)),
    "sweep": lambda: fs.sweep(model(), SLOPE, "slope", [-0.1, -0.2, 0.0]),
    "map": lambda: fs.stability_map(pair(), {"split": (-2.0, 1.0), "mu": (0.0, 2.0)}, points=(4, 5)),
    "scatter": lambda: fs.scatter(pair(), {"mu": stats.norm(0.7, 0.1), "split": stats.uniform(-2, 3)}, samples=64),
    "sensitivities": lambda: fs.sensitivities(model(), SLOPE, modes(), ["slope", "force"], of=modes().unstable),
    "what helps": lambda: fs.what_helps(model(), SLOPE, {"damper": fs.AddedDamper([4], 0.2), "mass": fs.AddedMass([4], 1.0)},
                                        band=(0.0, 0.5)),
    "response": lambda: fs.frequency_response(model(), at=np.linspace(0.05, 2, 30)),
    "study": lambda: fs.study(model(), [fs.CraigBampton(4), fs.CraigChang(4)], band=(0.0, 0.75), contacts=SLOPE, repeats=1),
    "cycle": cycle,
    "shot cycle": lambda: fs.shoot(small(), LAW, cycle()),
    "branch": lambda: fs.branch(fs.chain(5, belt=2), LAW, points=3),
    "run": run,
    "spectrum": lambda: fs.spectrum(run().t, run().velocity("belt"), (100.0, 200.0)),
    "spectrogram": lambda: fs.spectrogram(run().t, run().velocity("belt"), 20.0),
    "masses": lambda: fs.effective_masses(beam(), fs.normal_modes(beam(), count=4)),
    "card": lambda: fs.mode_cards(model(), SLOPE, modes(), modes().unstable[:1])[0],
    "audit": lambda: fs.audit(fs.reduce(fs.chain(30), fs.CraigBampton(8)), fs.chain(30)),
}
UNTABLED = {"spectrogram"}


@cache
def beam() -> fs.Substructure:
    return fs.beam(1.0, 10, E=1.0, I=1.0, rho=1.0, A=1.0, supports={"left": "clamped"})


@cache
def made(name: str) -> Any:
    return MADE[name]()


def points(chart: Chart, panel: int = 0) -> set[tuple[float, float]]:
    """All points of a panel that have a place."""
    pairs = [(float(x), float(y)) for one in chart.panels[panel].series
             for x, y in zip(np.asarray(one.x, dtype=float), np.asarray(one.y, dtype=float), strict=True)]
    return {one for one in pairs if np.isfinite(one).all()}


def holds(chart: Chart, x: Any, y: Any, panel: int = 0) -> bool:
    """Whether a panel has all these points."""
    there = points(chart, panel)
    return set(zip(np.asarray(x, dtype=float).tolist(), np.asarray(y, dtype=float).tolist(), strict=True)) <= there


@pytest.mark.parametrize("name", MADE)
def test_a_result_draws_itself_and_stands_in_a_notebook(name: str) -> None:
    found = made(name)
    assert isinstance(found, Displayed)
    figure = found.plot()
    assert {axis.get_ylabel() for axis in figure.axes} & {panel.y for panel in found.chart().drawn}
    page = found._repr_html_()
    picture, = re.findall(r'<img[^>]*base64,([^"]*)"', page)
    assert b64decode(picture).startswith(b"\x89PNG") and escape(repr(found)) in page
    assert (name in UNTABLED) == (not found.tables())
    assert all(table.rows and table.name for table in found.tables())


def test_a_figure_stands_in_a_notebook() -> None:
    assert made("complex modes").plot()._repr_png_().startswith(b"\x89PNG")


def test_complex_modes_are_drawn_with_growth_and_damping_in_percent() -> None:
    found = made("complex modes")
    chart, upper = found.chart(), found.eigenvalues[found.eigenvalues.imag >= 0]
    assert points(chart) == set(zip(upper.real.tolist(), upper.imag.tolist(), strict=True))
    assert holds(chart, -100 * upper.real / abs(upper), upper.imag, 1)
    grows, = (one for one in chart.panels[0].series if one.name == "grows")
    assert len(grows.x) == len(found.unstable) / 2 and min(grows.x) > 0
    np.testing.assert_allclose(found.damping_percent, -100 * found.eigenvalues.real / abs(found.eigenvalues))
    np.testing.assert_allclose(2 * np.pi * found.frequencies_hz, found.frequencies)
    row = found.tables()[0].rows[0]
    assert row["damping"] == -100 * row["growth"] / abs(complex(row["growth"], row["omega"]))


def test_normal_modes_are_drawn_by_number() -> None:
    found = made("normal modes")
    assert points(found.chart()) == set(enumerate(found.frequencies.tolist(), 1))
    np.testing.assert_allclose(2 * np.pi * found.frequencies_hz, found.frequencies)


def test_losses_and_regains_are_drawn_where_they_are() -> None:
    found = made("critical value")
    assert holds(found.chart(), [one.value for one in found.losses], [one.omega for one in found.losses]) and found.losses
    assert [row["stability"] for row in found.rows()] == ["lost"] * len(found.losses) + ["regained"] * len(found.regains)
    never = fs.critical_value(pair().fixed(split=0.5), None, "mu", between=(0.0, 0.01))
    assert [row["stability"] for row in never.rows()] == ["never lost"] and never.plot()


def test_a_flutter_diagram_colours_those_that_couple_and_shows_damping() -> None:
    three = fs.Affine(np.eye(3), 0.001 * np.eye(3),
                      [(1.0, [[2, 1, 0], [1, 2, 0], [0, 0, 5]]), ("mu", [[0, -4 / 3, 0], [0, 0, 0], [0, 0, 0]])])
    found = fs.track(three, None, "mu", np.linspace(0, 1, 9))
    chart = found.chart(crossings=fs.critical_value(three, None, "mu", between=(0.0, 1.0)).losses)
    assert [panel.y for panel in chart.panels] == ["Im λ  [rad/time]", "Re λ  [1/time]", "-Re λ / |λ|  [%]"]
    colours = {one.name: one.colour for one in chart.panels[0].series if one.line}
    assert {name for name in colours if "mode" in name} >= {"modes 1 and 2", "other modes"}
    assert len({one.colour for one in chart.panels[0].series if one.name == "modes 1 and 2"}) == 1
    for panel, values in enumerate((found.eigenvalues.imag, found.eigenvalues.real,
                                    -100 * found.eigenvalues.real / abs(found.eigenvalues))):
        for j in range(values.shape[1]):
            assert holds(chart, found.values, values[:, j], panel)
    assert not chart.panels[1].linear  # growth alone sets the scale
    assert any(abs(level.at - 0.75) < 1e-4 for level in chart.panels[1].levels)


def test_a_damped_mode_does_not_set_the_scale_of_a_flutter_diagram() -> None:
    D = np.diag([1e-3, 1e-3, 4.0])
    heavy = fs.Affine(np.eye(3), D, [(1.0, [[2, 1, 0], [1, 2, 0], [0, 0, 50]]), ("mu", [[0, -1.01, 0], [0, 0, 0], [0, 0, 0]])])
    found = fs.track(heavy, None, "mu", np.linspace(0, 1, 9))
    grow = found.eigenvalues.real.max()
    assert 0 < grow < 0.1 and found.eigenvalues.real.min() == pytest.approx(-2.0)
    linear = found.chart().panels[1].linear["y"]
    assert grow / 10 < linear <= grow


def test_a_sweep_is_drawn_in_the_order_of_its_values() -> None:
    found = made("sweep")
    first = found.chart().panels[0].series[0]
    assert list(first.x) == sorted(found.values) and holds(found.chart(), found.values, found.growth)
    assert holds(found.chart(), found.values, found.omega, 1)


def test_a_map_is_drawn_with_its_borders() -> None:
    found = made("map")
    heat = found.chart().panels[0].heat
    assert heat is not None
    np.testing.assert_array_equal(heat.values, found.number.T)
    line = found.borders[0].points
    assert holds(found.chart(), line[:, 0], line[:, 1]) and len(found.tables()[0].rows) == found.number.size


def test_scatter_and_derivatives_are_drawn_by_size() -> None:
    found = made("scatter")
    grows = np.concatenate([one.growth[one.growth > 0] for one in found.families])
    assert {x for x, _ in points(found.chart())} == set(grows.tolist())
    slopes = made("sensitivities")
    chart = slopes.chart(most=1)
    k = int(np.argmax(np.where(slopes.eigenvalues.imag >= 0, slopes.eigenvalues.real, -np.inf)))
    ends = [one.x[1] for one in chart.panels[0].series if one.width == 6.0]
    assert sorted(ends) == sorted(slopes.relative[k].real.tolist()) and abs(ends[0]) >= abs(ends[1])
    assert len(chart.panels) == 1 and "1 of" in chart.about
    assert len(slopes.tables()[0].rows) == slopes.first.size


def test_changes_are_drawn_from_the_growth_now_to_that_with_them() -> None:
    found = made("what helps")
    bars = [one for one in found.chart().panels[0].series if one.width == 4.0]
    assert [list(one.x) for one in bars] == [[found.before.growth, one.growth] for one in found.tried]


def test_receptances_are_drawn_with_their_phase_and_the_first_of_many() -> None:
    found = made("response")
    h = found.receptance[:, 0, 0]
    assert holds(found.chart(), found.omega, abs(h)) and holds(found.chart(), found.omega, np.degrees(np.angle(h)), 1)
    measured = fs.FrequencyResponse.measured([1.0, 2.0], np.ones((2, 3, 4)), list("abc"), list("wxyz"))
    assert "8 of 12 pairs" in measured.chart().about and not measured.chart(most=12).about


def test_a_study_is_drawn_as_error_over_seconds() -> None:
    found = made("study")
    for row in found.rows:
        assert (row.solution.median, max(row.error_growth, 1e-13)) in points(found.chart())


def test_a_study_is_drawn_over_the_size_of_its_models() -> None:
    found = made("study")
    chart = found.chart(over="size")
    assert {panel.title for panel in chart.panels} >= {"growth rates Re λ", "frequencies ω"}
    for panel in chart.panels:
        key = {"growth rates Re λ": "error_growth", "frequencies ω": "error_frequency"}.get(panel.title, "error_critical")
        assert {(row.size, max(getattr(row, key), 1e-13)) for row in found.rows} == {
            point for one in panel.series for point in zip(one.x, one.y, strict=True)}
        assert all(list(one.x) == sorted(one.x) for one in panel.series)
    with pytest.raises(fs.InputError, match="unknown over 'seconds'; valid: size, time"):
        found.chart(over="seconds")


def test_receptances_are_drawn_before_those_of_the_full_model_with_the_error() -> None:
    omega = np.linspace(0.05, 1.0, 30)
    full = fs.chain(10, belt=2)
    exact, near = (fs.frequency_response(one, at=omega) for one in (full, fs.reduce(full, fs.CraigBampton(5), ports=True)))
    size, phase, error = near.chart(full=exact).panels
    np.testing.assert_array_equal(size.series[0].y, abs(exact.receptance[:, 0, 0]))
    np.testing.assert_array_equal(size.series[1].y, abs(near.receptance[:, 0, 0]))
    np.testing.assert_array_equal(phase.series[0].y, np.degrees(np.angle(exact.receptance[:, 0, 0])))
    off = np.maximum(abs(near.receptance / exact.receptance - 1)[:, 0, 0], 1e-13)
    assert (error.series[0].y >= off * (1 - 1e-9)).all() and max(error.series[0].y) < 2 * off.max()
    with pytest.raises(fs.InputError, match="frequencies differ"):
        near.chart(full=fs.frequency_response(full, at=omega[1:]))


@pytest.mark.parametrize("name", ["cycle", "shot cycle"])
def test_a_cycle_is_drawn_over_one_period_and_as_an_orbit(name: str) -> None:
    found = made(name)
    time, orbit, harmonics = found.chart().panels
    t, v = np.asarray(time.series[0].x), np.asarray(time.series[0].y)
    period = 2 * np.pi / found.omega
    assert 0 < period - t[-1] < 0.01 * period and abs(v).max() == pytest.approx(found.peak)
    u = np.asarray(orbit.series[0].x)
    moved = np.gradient(np.concatenate([u[-3:-1], u[:-1], u[:2]]), t[1])[2:-2]  # u is closed: its last point is its first
    np.testing.assert_allclose(moved, v, atol=5e-3 * abs(v).max())
    assert np.sqrt(np.sum(np.asarray(harmonics.series[0].y) ** 2) / 2) == pytest.approx(found.rms, rel=1e-6)
    np.testing.assert_allclose(harmonics.series[0].x[:3], found.omega * np.arange(1, 4))


def test_a_branch_and_a_run_are_drawn_with_what_they_hold() -> None:
    found = made("branch")
    assert holds(found.chart(), found.values, found.rms) and holds(found.chart(), found.values, found.omega, 1)
    track = run().seen()
    chart = run().chart()
    assert len(chart.panels) == 3 and holds(chart, run().t[-5:], run().velocity("belt")[-5:], 1)
    assert track.window == pytest.approx((150.0, 200.0), rel=1e-3) and track.spectrum is not None
    np.testing.assert_allclose(chart.panels[2].series[1].x, [at for at in track.peaks if at <= 1.3 * max(track.peaks[:3])])
    assert chart.panels[0].title == f"reduced, {track.size} DOF"
    assert fs.transient(model(), LAW, time=(0, 5), samples=20).chart().panels[0].title == "full, 10 DOF"
    early = fs.transient(small(), LAW, time=(0, 5), samples=20)
    assert early.seen().spectrum is None and len(early.chart().panels) == 2


def test_effective_masses_are_summed_up() -> None:
    found = made("masses")
    sums = 100 * np.cumsum(found.shares, axis=0)
    assert holds(found.chart(), found.frequencies, sums[:, 0])


def test_a_card_adds_up() -> None:
    found = made("card")
    ends = [one.x[1] for one in found.chart().panels[2].series if one.width == 6.0]
    assert sum(ends) == pytest.approx(found.eigenvalue.real, abs=10 * found.error_bar + 1e-12)


# units, figures, frames


def test_axes_in_rad_have_hertz_beside_them_where_the_second_is_the_unit_of_time() -> None:
    labels = [axis.get_ylabel() for one in modes().plot(units="SI").axes for axis in (one, *one.child_axes)]
    assert "f  [Hz]" in labels and "Im λ  [rad/s]" in labels
    assert not any("Hz" in axis.get_ylabel() for one in modes().plot().axes for axis in (one, *one.child_axes))
    scattered = made("scatter").plot(units="SI")  # beside the frequencies are panels of probabilities and of ranks
    assert {axis.get_ylabel() for axis in scattered.axes if any("Hz" in one.get_ylabel() for one in axis.child_axes)} == {
        "Im λ  [rad/s]"}
    named = modes().plot(units={"length": "mm", "time": "s", "mass": "t"})
    assert any(axis.get_ylabel() == "f  [Hz]" for one in named.axes for axis in one.child_axes)
    with pytest.raises(fs.InputError, match=r"'SI', 'mm-t-s'.*not 'metric'"):
        modes().plot(units="metric")


def test_a_figure_is_saved_in_the_style_of_all_others(tmp_path: Any) -> None:
    figure = modes().plot()
    figure.savefig(tmp_path / "modes.png")
    assert (tmp_path / "modes.png").stat().st_size > 10_000
    assert {text.get_fontsize() for axis in figure.axes for text in axis.get_xticklabels()} == {8.0}


def test_what_has_nothing_to_draw_says_so() -> None:
    with pytest.raises(fs.InputError, match="nothing that can be drawn"):
        Displayed().plot()
    assert Displayed().tables() == []


class Frame:
    """What `pandas.DataFrame` is given."""

    def __init__(self, rows: Any, columns: Any) -> None:
        self.rows, self.columns = rows, columns


@pytest.fixture
def pandas(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("pandas")
    module.DataFrame = Frame  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pandas", module)


@pytest.mark.usefixtures("pandas")
def test_tables_become_data_frames() -> None:
    frame = modes().to_frame()
    assert frame.columns[:3] == ["mode", "omega", "growth"] and {"damping", "error_bar"} <= set(frame.columns)
    hertz = modes().to_frame(units="SI")
    assert hertz.columns[:3] == ["mode", "omega", "frequency_hz"]
    assert [row["frequency_hz"] for row in hertz.rows] == [row["omega"] / (2 * np.pi) for row in frame.rows]
    assert len(frame.rows) == len(modes()) / 2
    assert "first" in made("scatter").to_frame("scatter-inputs").columns
    with pytest.raises(fs.InputError, match=r"'complex-modes'.*not 'nodes'"):
        modes().to_frame("nodes")
    with pytest.raises(fs.InputError, match="no rows"):
        Displayed().to_frame()


def test_a_true_data_frame() -> None:
    pytest.importorskip("pandas")
    frame = modes().to_frame()
    assert len(frame) == len(modes()) / 2 and frame["omega"].is_monotonic_increasing


def test_without_pandas_the_error_says_how_to_have_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(fs.MissingPackageError, match="data frames need pandas"):
        modes().to_frame()


# shapes on meshes


@cache
def bar() -> tuple[fs.Mesh, fs.Substructure]:
    mesh = fs.block((1.0, 0.1, 0.1), (8, 1, 1), "hexahedron")
    return mesh, fs.solid(mesh, fs.Material(2.1e11, 0.3, 7850.0), supports=["left"], interface=["right"])


def plate() -> tuple[fs.Mesh, fs.Substructure]:
    mesh = fs.rectangle((1.0, 0.5), (6, 3))
    return mesh, fs.plate(mesh, E=2.1e11, nu=0.3, rho=7850.0, thickness=0.01, supports={"left": "clamped"})


def drawn(figure: Any) -> int:
    return sum(bool(axis.get_title()) for axis in figure.axes)


def test_shapes_are_drawn_on_the_mesh_of_the_full_and_of_the_reduced_model() -> None:
    mesh, full = bar()
    small = fs.reduce(full, fs.CraigBampton(6))
    figures = [fs.normal_modes(model, count=8).plot_shapes(model, mesh, units="SI") for model in (full, small)]
    titles = [[axis.get_title() for axis in figure.axes if axis.get_title()] for figure in figures]
    assert len(titles[0]) == 6 and titles[0][0].startswith("mode 1: ω = 694") and all("(110.5 Hz)" in one[0] for one in titles)
    # the fifth mode turns the bar; the first four come in pairs, whose shapes are not unique
    fields = [fs.components.moved_fields(model, fs.normal_modes(model, count=5).shapes[:, 4:], mesh)[1][0]
              for model in (full, small)]
    for one in fields:
        one /= one.ravel()[abs(one).argmax()]
    np.testing.assert_allclose(fields[0], fields[1], atol=0.05)


@pytest.mark.parametrize("make", [lambda: (*bar(), 6), lambda: (*plate(), 4)], ids=["solid", "plate"])
def test_a_window_shows_the_moved_meshes(make: Callable[[], tuple[fs.Mesh, fs.Substructure, int]]) -> None:
    pyvista = pytest.importorskip("pyvista")
    mesh, full, count = make()
    found = fs.normal_modes(full, count=count)
    window = found.plot_shapes(full, mesh, range(count), units="SI", window=True)
    try:
        assert isinstance(window, pyvista.Plotter) and window.shape == (-(-count // 3), 3)
        body = next(iter(window.renderers[0].actors.values())).mapper.dataset
        rest = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.points.shape[1])))
        apart = np.linalg.norm(body.points - rest, axis=1)
        size = body["displacement / largest  [-]"]
        assert size.max() == pytest.approx(1) and apart == pytest.approx(apart.max() * size, abs=1e-6 * apart.max() + 1e-7)
    finally:
        window.close()


def test_a_window_without_pyvista_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyvista", None)
    mesh, full = bar()
    with pytest.raises(fs.MissingPackageError, match=r"PyVista: .*(setup window|install .*pyvista)"):
        fs.normal_modes(full, count=2).plot_shapes(full, mesh, window=True)


def test_complex_shapes_stand_at_the_phase_of_their_largest_displacement() -> None:
    mesh, full = bar()
    fields = np.exp(0.7j) * np.ones((len(mesh.points), 3, 1)) * np.arange(1, 1 + len(mesh.points))[:, None, None]
    np.testing.assert_allclose(fs.components.turned(fields).imag, 0.0, atol=1e-12)
    found = fs.complex_modes(fs.damped(full, rayleigh=(0.0, 1e-6)), band=(0.0, 4e3))
    assert drawn(found.plot_shapes(full, mesh)) == 1 and drawn(found.plot_shapes(full, mesh, [0, 1])) == 2


def test_the_parts_of_a_system_are_drawn_by_their_meshes() -> None:
    mesh, left = bar()
    beyond = fs.Mesh(mesh.points + np.array([1.0, 0.0, 0.0]), mesh.cells, mesh.kind, sets=mesh.sets)
    right = fs.solid(beyond, fs.Material(2.1e11, 0.3, 7850.0), interface=["left"], supports=["right"])
    system = fs.couple({"one": left, "two": right}, [fs.Rigid(("one", "right"), ("two", "left"))])
    small = fs.reduce(system, {"one": fs.Rubin(4), "two": fs.Rubin(4)})
    for model in (system, small):
        found = fs.normal_modes(model, count=2)
        assert drawn(found.plot_shapes(model, {"one": mesh, "two": beyond})) == 2
        assert drawn(found.plot_shapes(model, {"two": beyond}, [0])) == 1
    with pytest.raises(fs.InputError, match="'three'"):
        found.plot_shapes(small, {"three": mesh})


def test_shapes_that_cannot_be_drawn_are_refused() -> None:
    mesh, full = bar()
    found = fs.normal_modes(full, count=2)
    with pytest.raises(fs.InputError, match=r"positions among 2 modes, not \[2\]"):
        found.plot_shapes(full, mesh, [2])
    with pytest.raises(fs.InputError, match="no DOF map"):
        fs.normal_modes(model(), count=2).plot_shapes(model(), mesh)
    other = fs.block((1.0, 0.1, 0.1), (8, 1, 1), "tetra")
    two = {"a": full, "b": fs.solid(other, fs.Material(2.1e11, 0.3, 7850.0), interface=["left"])}
    system = fs.couple(two, [fs.Rigid(("a", "right"), ("b", "left"), tol=np.inf)])
    with pytest.raises(fs.InputError, match="one kind of cells, but are of hexahedron, tetra"):
        fs.normal_modes(system, count=2).plot_shapes(system, {"a": mesh, "b": other})
