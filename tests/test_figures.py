"""Figures and tables can be read: colours, labels, sizes of texts, widths; what is drawn is what was computed."""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO
from itertools import combinations, pairwise, product
from typing import Any

import numpy as np
import pytest

from femsub.app.grammar import Scene
from femsub.output import KNOWN, WIDTH, Table, fitted, table
from femsub.reduction.contact_modes import ContactModes
from femsub.reduction.interface_modes import InterfaceModes
from femsub.reduction.reduce import METHODS
from femsub.studies.results import Row, Study, Timing

pytest.importorskip("matplotlib")

from femsub import annulus, rectangle
from femsub.components.pictures import shapes_figure
from femsub.modes import eigenvalue_chart, springs_chart
from femsub.motion.charts import envelope
from femsub.output import (
    MANY,
    PAGE,
    ROUNDING,
    SIZES,
    STYLE,
    Chart,
    Panel,
    Series,
    draw,
    label_points,
    legend_below,
    look,
    new_figure,
    render,
)
from femsub.stability import growth_chart
from femsub.studies.charts_errors import error_time_chart, errors_chart, friction_errors_chart

#: what those see who lack one kind of cones, on linear RGB (Machado, Oliveira and Fernandes 2009, severity 1)
SEEN = {"all": np.eye(3),
        "no red": np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]),
        "no green": np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]),
        "no blue": np.array([[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]])}
APART = 12.0  # in CIELAB; 2.3 is just noticeable


def lab(colour: str, seen: np.ndarray) -> np.ndarray:
    """CIELAB, D65, of '#rrggbb' as it is seen."""
    rgb = np.array([int(colour[at:at + 2], 16) for at in (1, 3, 5)]) / 255
    linear = np.clip(seen @ np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4), 0, 1)
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ linear
    x, y, z = np.cbrt(xyz / np.array([0.9505, 1.0, 1.089]))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def test_each_method_has_a_colour_and_a_mark_that_all_can_tell_apart() -> None:
    kinds = [*METHODS.values(), InterfaceModes, ContactModes]
    kinds = [kind for kind in kinds if kind.__module__.startswith("femsub.")]
    assert len({kind.marker for kind in kinds}) == len(kinds) >= 10
    for (one, other), seen in product(combinations(["#000000", *(kind.colour for kind in kinds)], 2), SEEN.values()):
        assert np.linalg.norm(lab(one, seen) - lab(other, seen)) > APART, (one, other)
    assert look("contact-modes")[1:] == (ContactModes.colour, ContactModes.marker)


# ---- error against run time


def error_time_figure(studies: Any) -> Any:
    return draw(error_time_chart(studies))


def errors_figure(found: Study) -> Any:
    return draw(errors_chart(found, "x", "methods"))


def friction_errors_figure(found: Study) -> Any:
    return draw(friction_errors_chart(found, "x", "error-time"))


def eigenvalue_figure(models: Any) -> Any:
    return draw(eigenvalue_chart(models, "x"))


def study(errors: dict[str, list[float]], slope: float = 1e-3, force: float = np.nan) -> Study:
    full = Row("full", 0, 400, 0.0, 0.0, 0.0, 0, -1.0, 0.0, Timing(0, 0, 0), Timing(0.5, 0.4, 0.6), 0.0)
    rows = [Row(method, 5 + at, 8 + at, 0.1 * error, error, slope * error, 0, -1.0, 0.0, Timing(0.1, 0.09, 0.2),
                Timing(1e-3, 0.9e-3, 2e-3), 0.0, error_frequency=error, error_force=force, pareto=at == 0)
            for method, several in errors.items() for at, error in enumerate(several)]
    return Study("x", (0.0, 1.0), 3, full, tuple(rows))


FOUND = study({"craig-bampton": [1e-1, 2e-2, 1.9e-2, 1e-3], "craig-chang": [1e-2, 1.9e-2, 1e-4, 1e-16]})


def drawn(figure: Any) -> list[Any]:
    return [axis for axis in figure.axes if axis.get_visible()]


def test_error_against_time_has_two_panels_a_study_and_none_of_rounding() -> None:
    assert len(drawn(error_time_figure([("{m1}", FOUND), ("{m1, m2}", FOUND)]))) == 4
    for change in ({"missing": 1}, {"size": 400}):  # the full model alone
        others = replace(FOUND, rows=tuple(replace(row, **change) for row in FOUND.rows))
        assert len(error_time_figure([("{m1}", others)]).legends[0].get_texts()) == 1
    titles = [axis.get_title() for axis in drawn(error_time_figure([("{m1}", study({"rubin": [1e-2, 1e-3]}, slope=1e-14))]))]
    assert titles == ["growth rates Re λ", "eigenvalues λ"]
    figure = error_time_figure([("{m1}", FOUND)])
    axis = drawn(figure)[0]
    assert axis.get_ylim()[0] > 0.01 * ROUNDING  # an error of 1e-16 does not stretch the axis
    assert {tuple(line.get_xdata()) for line in axis.lines if line.get_linestyle() == "--"} == {(0.5, 0.5)}  # the full model
    marks = {(line.get_marker(), line.get_markerfacecolor() == "none") for line in axis.lines if line.get_marker() in "s^"}
    assert marks == {("s", True), ("s", False), ("^", True), ("^", False)}
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["Craig-Bampton", "Craig-Chang", "no other is both as fast and as accurate", "full model, 400 DOF",
                      "rounding"]


def test_labels_of_points_cover_no_mark_and_no_other_label() -> None:
    figure = error_time_figure([("{m1}", FOUND)])
    figure.canvas.draw()
    for axis in drawn(figure):
        boxes = [text.get_window_extent() for text in axis.texts]
        assert len(boxes) >= 6
        assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
        for line in axis.lines:
            if line.get_marker() not in ("None", None, ""):
                for x, y in line.get_transform().transform(np.column_stack(line.get_data())):
                    assert not any(box.contains(x, y) for box in boxes)


def test_a_label_without_room_is_left_out() -> None:
    figure = new_figure(4.0, 3.0)
    axis = figure.subplots()
    axis.plot([0.5] * 9, [0.5] * 9, "o")
    label_points(figure, [(axis, 0.5, 0.5, f"{at}" * 3, "black") for at in range(40)])
    figure.draw_without_rendering()
    assert 1 <= len(axis.texts) <= 8


def test_a_label_is_nearer_to_its_own_mark_than_to_another_of_its_colour() -> None:
    """Two models of nearly the same time and error had each the number of the other beside them."""
    figure = new_figure(4.0, 3.0)
    axis = figure.subplots()
    x, y = np.full(5, 0.5), np.linspace(0.3, 0.6, 5)
    axis.plot(x, y, "s-", ms=5)
    label_points(figure, [(axis, *at, f"{number}", "black") for number, at in enumerate(zip(x, y, strict=True))])
    figure.canvas.draw()
    places = axis.transData.transform(np.column_stack([x, y]))
    assert len(axis.texts) >= 3
    for text in axis.texts:
        box = text.get_window_extent()
        gaps = [np.hypot(*np.maximum(0, np.maximum(box.p0 - place, place - box.p1))) for place in places]
        own = int(text.get_text())
        assert all(1.1 * gaps[own] < gap for at, gap in enumerate(gaps) if at != own)


def test_a_name_of_marks_of_several_colours_is_grey_in_the_legend() -> None:
    """'fold' had the blue of Craig-Chang, but was drawn in the colours of all models."""
    figure = new_figure(4.0, 3.0)
    axis = figure.subplots()
    for colour in ("#c44e00", "#0067a5"):
        axis.plot([0, 1], [0, 1], "D", color=colour, label="fold")
        axis.plot([0, 1], [0, 1], "-", color="black", label="full")
    legend_below(figure, [axis])
    shown = {text.get_text(): line.get_color() for text, line in zip(
        figure.legends[0].get_texts(), figure.legends[0].get_lines(), strict=True)}
    assert shown == {"fold": MANY, "full": "black"}
    assert axis.lines[-2].get_color() == "#0067a5"  # what is drawn stays


@pytest.mark.slow
def test_systems_have_a_panel_for_each_error_and_models_with_a_missing_mode_none() -> None:
    found = study({"rubin": [1e-2, 1e-3]}, force=1e-2)
    titles = [axis.get_title() for axis in drawn(errors_figure(found))]
    assert titles == ["frequencies ω", "growth rates Re λ", "critical slope", "forces in the joints"]
    assert [axis.get_title() for axis in drawn(errors_figure(study({"rubin": [1e-2]})))] == titles[:3]
    for change in ({"missing": 1}, {"extra": 1}, {"size": 400}):  # the full model alone
        figure = errors_figure(replace(found, rows=tuple(replace(row, **change) for row in found.rows)))
        assert len(figure.legends[0].get_texts()) == 1


def test_models_under_friction_without_a_counterpart_have_no_error_to_draw() -> None:
    time = Timing(0.1, 0.1, 0.1)
    row = Row("rubin", 5, 10, np.nan, np.nan, np.nan, 1, np.inf, 0.0, time, time, 0.0, missed=1)
    found = Study("x", (0.0, 1.0), 1, row, (row,), parameter="mu", between=(0.0, 1.0))
    friction_errors_figure(found).canvas.draw()
    more = replace(row, method="contact-modes", error_eigenvalue=1e-3, error_real=1e-4)
    figure = friction_errors_figure(replace(found, rows=(row, more)))
    assert [axis.get_title() for axis in drawn(figure)] == ["eigenvalues λ", "growth rates Re λ"]
    assert "misses an unstable mode" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_no_bar_leaves_its_axes_where_two_studies_share_them() -> None:
    def took(seconds: float) -> Study:
        once = Timing(seconds, seconds, seconds)
        row = replace(FOUND.rows[0], solution=Timing(seconds, 0.5 * seconds, 40 * seconds), reduction=once)
        return replace(FOUND, rows=(row,), repeats=1)

    figure = error_time_figure([("{m1}", took(1.0)), ("{m1, m2}", took(1e-3))])
    for axis in drawn(figure):
        (low, high), lines = axis.get_xlim(), [line.get_xdata() for line in axis.lines]
        seconds = np.concatenate([line for line in lines if len(line) > 2])
        assert low < np.nanmin(seconds) and np.nanmax(seconds) < high


def test_a_method_without_a_mark_is_named_with_its_reason() -> None:
    found = study({"rubin": [1e-2, 1e-3], "craig-chang": [1e-2, 1e-3]})
    gone = tuple(replace(row, missing=1) if row.method == "craig-chang" else row for row in found.rows)
    chart = errors_chart(replace(found, rows=gone, left_out=("MacNeal is left out: no reason",)), "x", "methods")
    assert "Craig-Chang has no mark: a mode missing in each of its models" in chart.about and "MacNeal is left out" in chart.about
    assert "has no mark" not in errors_chart(found, "x", "methods").about


def test_a_page_has_all_lines_over_springs_and_a_figure_those_that_can_be_told_apart() -> None:
    rows = [{"model": model, "modes": modes, "size": modes + 3, "springs": springs, "error": 1e-3}
            for model in ("craig-bampton", "craig-chang", "rubin") for modes in (4, 8, 12, 20) for springs in (0.1, 1.0)]
    chart = springs_chart(rows, "x", lines=8)
    (panel,) = chart.drawn
    looks = {(*one.look[1:], one.line, one.hollow) for one in panel.series}
    assert len(looks) == len(panel.series) == 6 <= 8 and {one.hover["modes"][0] for one in panel.series} == {4, 20}
    assert len(chart.plain()["places"][0]["panels"][0]["series"]) == 12 and "models with 8, 12 modes" in chart.about
    assert len(springs_chart(rows[:8], "x").drawn[0].series) == 3  # one method: fewest, most, and one between


# ---- eigenvalues, signals


def spectrum(model: str, top: float, panel: str = "a") -> dict[str, Any]:
    values = np.linspace(-top, top, 20) * 1j + 0.01
    return {"panel": panel, "model": model, "size": 5, "eigenvalues": values, "above_cutoff": np.zeros(20, bool),
            "error_bar": np.zeros(20)}


def test_a_clump_of_eigenvalues_is_enlarged() -> None:
    assert len(drawn(eigenvalue_figure([spectrum("full", 2.0), spectrum("rubin", 1.9)]))) == 1
    upper, lower = drawn(eigenvalue_figure([spectrum("full", 2.0), spectrum("rubin", 0.2)]))
    assert upper.get_ylim()[1] > 2.0 and 0.2 < lower.get_ylim()[1] < 0.3
    several = [spectrum("full", 2.0), spectrum("rubin", 0.2), spectrum("full", 2.0, "b"), spectrum("rubin", 0.1, "b")]
    axes = drawn(eigenvalue_figure(several))
    assert axes[2].get_ylim()[1] > 0.2 > axes[3].get_ylim()[1] > 0.1  # each its own part


def test_eigenvalues_that_pile_up_at_zero_have_an_axis_that_parts_them() -> None:
    near = spectrum("full", 2.0) | {"eigenvalues": np.append(-np.geomspace(1e-4, 1e-3, 19), -5.0) + 1j}
    axis = drawn(eigenvalue_figure([near, spectrum("rubin", 1.9) | {"eigenvalues": near["eigenvalues"]}]))[0]
    assert axis.get_xscale() == "symlog"
    pixels = axis.transData.transform(np.column_stack([near["eigenvalues"].real, np.ones(20)]))
    assert np.ptp(axis.transAxes.inverted().transform(pixels)[:19, 0]) > 0.1
    assert drawn(eigenvalue_figure([spectrum("full", 2.0), spectrum("rubin", 1.9)]))[0].get_xscale() == "linear"


def test_marks_that_lie_on_each_other_are_all_seen() -> None:
    axis = eigenvalue_figure([spectrum(name, 2.0) for name in ("full", "craig-bampton", "craig-chang", "rubin")]).axes[0]
    sizes = [line.get_markersize() for line in axis.lines if line.get_marker() not in ("None", "")]
    assert len(sizes) == 4 and all(one > other for one, other in pairwise(sizes))
    assert all(line.get_zorder() > 2 for line in axis.lines if line.get_marker() not in ("None", ""))


def test_an_envelope_has_every_extreme(rng: np.random.Generator) -> None:
    t = np.sort(rng.random(20_000))
    v = rng.standard_normal(20_000)
    places, low, high = envelope(t, v, 600)
    assert len(places) == 600 and low.min() == v.min() and high.max() == v.max()
    at = np.searchsorted(places, t, side="right") - 1
    assert np.all((low[at] <= v) & (v <= high[at]))
    assert np.array_equal(envelope(t[:3], v[:3])[1], v[:3])


# ---- shapes


def test_a_solid_is_drawn_with_its_outline_at_rest_and_arrows_where_it_slides_within_its_surface() -> None:
    from matplotlib.collections import LineCollection
    from matplotlib.quiver import Quiver

    mesh = annulus(0.05, 0.15, 0.01, (3, 24, 1), "hexahedron")
    x, y, _ = mesh.points.T
    torsion = np.column_stack([-y, x, 0 * x]) / 0.15
    bending = np.column_stack([0 * x, 0 * x, x / 0.15])
    figure = shapes_figure(mesh, np.stack([bending, torsion], axis=-1), ["bending", "torsion"], "x", {})
    rims = np.linalg.norm(mesh.points[:, :2], axis=1).max()
    for axis, arrows in zip(drawn(figure)[:2], (0, 1), strict=True):
        (outline,) = (one for one in axis.collections if isinstance(one, LineCollection))
        corners = np.concatenate([line.vertices for line in outline.get_paths()])
        assert np.abs(corners[:, 0]).max() == pytest.approx(rims, rel=0.02)  # not that of the shape, which is wider
        assert sum(isinstance(one, Quiver) for one in axis.collections) == arrows
    assert "at rest" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_plate_s_deflection_has_shades_with_edges() -> None:
    mesh = rectangle((2.0, 1.0), (8, 4))
    w = np.column_stack([0 * mesh.points[:, 0], 0 * mesh.points[:, 0], mesh.points[:, 0] - 1])
    axis = drawn(shapes_figure(mesh, w[..., None], ["a"], "x", {}))[0]
    levels = [level for one in axis.collections for level in getattr(one, "levels", ())]
    assert len(levels) == 22 and 0.0 not in levels


def test_growth_over_a_place_compares_all_models_in_one_panel() -> None:
    belts, slopes = [1, 2, 3], -np.geomspace(1e-3, 0.4, 5)
    panels = [{"model": model, "rest": place, "growth": np.linspace(-1, 1, 15).reshape(3, 5),
               "critical_slope": [-0.1, -0.02 * (1 + error), -0.01]}
              for place in ("{m1}", "{m1, belt}") for model, error in (("full", 0.0), ("craig-bampton", 1e-2), ("rubin", 1e-4))]
    left, right = drawn(draw(growth_chart({"over": "belt", "at": belts, "slopes": slopes, "panels": panels})))[:2]
    names = [f"{look(model).label}, {place}" for place in ("{m1}", "{m1, belt}") for model in ("craig-bampton", "rubin")]
    assert left.get_legend_handles_labels()[1] == ["full", *names]
    assert [line.get_ydata()[1] for line in right.lines] == pytest.approx([1e-2, 1e-4] * 2)


# ---- all of a scene's figures


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("name", "keys"), [
    ("chain", """reduce.sizes = [3, 5]
reduce.repeats = 1
ask = [{friction-law = [0.1, 0.01]}, {critical = "slope"}, {growth = "slope", points = 10, vary = {"part.chain.belt" = [1, 2]}},
       {complex-modes = "all", every = true}, {compare = ["growth", "critical", "held"]}]
"""),
    ("chain-parts", """part.chain.chain = 12
reduce.modes = [2]
reduce.repeats = 1
ask = [{compare = ["growth", "critical", "held"], vary = {"part.chain.cut" = [2]}}]
"""),
    ("chain-transient", """[[ask]]
motion = [0, 300]
window = [100, 300]
length = 100
show = ["growth", "quality", "signals", "spectrum", "spectrogram"]
"""),
    ("two-mode", """ask = [{critical = "mu"}, {flutter = "mu", points = 11, vary = {"parameter.d.value" = [0.0, 0.05]}}]
""")])
def test_figures_have_units_texts_that_can_be_read_and_legends_beside_the_data(name: str, keys: str, tmp_path: Any) -> None:
    from matplotlib import rc_context
    from matplotlib.text import Text

    (tmp_path / "scene.toml").write_text(f'scene = "{name}"\n{keys}')
    result = Scene.from_file(tmp_path / "scene.toml").run(lambda _: None)
    drawings = {chart.name: result.drawings[chart.name] for chart in result.charts if chart.drawn}  # shapes have no axes
    assert drawings
    for title, made in drawings.items():
        with rc_context(STYLE):
            figure = made()
        assert figure.get_figwidth() <= PAGE
        assert figure._suptitle is not None, title  # what is drawn, above the number of the paper's figure
        small = [text.get_text() for text in figure.findobj(Text) if text.get_text().strip() and text.get_fontsize()
                 < SIZES.number and "$" not in text.get_text()]
        assert not small, (title, small)
        for axis in drawn(figure):
            assert axis.get_legend() is None, title
            for label in (axis.get_xlabel(), axis.get_ylabel()):
                assert not label or "[" in label, (title, label)
        assert any(axis.get_xlabel() for axis in figure.axes) and any(axis.get_ylabel() for axis in figure.axes), title


def test_a_figure_is_drawn_once(monkeypatch: pytest.MonkeyPatch) -> None:
    from matplotlib.axes import Axes

    drawn, draw_axes = [], Axes.draw
    monkeypatch.setattr(Axes, "draw", lambda self, *given: (drawn.append(self), draw_axes(self, *given))[1])
    figure = new_figure(4.0, 3.0)
    panels = [figure.add_subplot(1, 2, place) for place in (1, 2)]
    label_points(figure, [(panels[0], 0.5, 0.5, "17", "#000000")])
    render(lambda: figure, BytesIO())
    assert drawn == panels and [text.get_text() for text in panels[0].texts] == ["17"]


def test_a_long_title_is_broken_where_its_figure_ends() -> None:
    figure = new_figure(4.0, 3.0)
    figure.suptitle("a title of many words " * 6)
    render(lambda: figure, BytesIO())
    figure.canvas.draw()  # at the figure's own resolution
    title = next(text for text in figure.findobj(lambda artist: "a title" in getattr(artist, "get_text", str)()))
    assert title.get_text().count("\n") >= 2 and title.get_window_extent().width < figure.bbox.width


# ---- tables


def test_a_wide_table_has_its_heads_broken_and_then_continues_below() -> None:
    head = ["model", "DOF", *(f"static error {at}" for at in range(9))]
    rows = [["Dual Craig-Bampton", 100_000, *[1.5e-3] * 9]]
    said = table(head, rows, ["s", "d", *[".1e"] * 9], keys=2).splitlines()
    assert max(map(len, said)) <= WIDTH and "static" in said[0] and "error" in said[1]
    assert all(line == line.rstrip() for line in said)
    parts = table(head * 3, [rows[0] * 3], ["s", "d", *[".1e"] * 9] * 3, keys=2).split("\n\n")
    assert len(parts) > 2 and max(len(line) for part in parts for line in part.splitlines()) <= WIDTH
    assert all("Dual Craig-Bampton  100000" in part for part in parts)  # the keys stand in each
    assert "".join(parts).count("1.5e-03") == 27


def test_a_table_prints_its_columns_and_files_all_keys() -> None:
    rows = [{"model": "full", "modes": 0, "is_stable": None, "multiplier": 3 + 4j, "extra": 1},
            {"model": "rubin", "modes": 2, "is_stable": True, "multiplier": None, "extra": 2}]
    one = Table("a", rows, ("model", "modes", "is_stable", "multiplier"))
    assert [line.split() for line in one.text().splitlines()[2:]] == [["full", "-", "?", "5"], ["Rubin", "2", "yes", "-"]]
    assert [at.key for at in one.every] == ["model", "modes", "is_stable", "multiplier", "extra"] and one.filed is rows
    assert [(at.head, at.form) for at in one.every[-1:]] == [(KNOWN["extra"].head, "")]
    short = Table("a", rows, ("model",), only=("model", "gone"), most=1)
    assert short.filed[1] == {"model": "rubin", "gone": None} and len(short.text().splitlines()) == 3
    assert Table("a", rows).text() == ""


def test_a_figure_draws_what_the_page_is_told() -> None:
    chart = error_time_chart([("{m1}", FOUND)])
    panels = [panel for place in chart.plain()["places"] for panel in place["panels"]]
    for axis, panel in zip(drawn(draw(chart)), panels, strict=False):  # those of the page alone come last
        assert (axis.get_title(), axis.get_ylabel() or panel["y"]) == (panel["title"], panel["y"])
        for one in panel["series"]:
            x, y = (np.array(one[key], dtype=float) for key in "xy")
            assert any(len(line.get_xdata()) == len(x) and np.allclose(line.get_xdata(), x, rtol=1e-6, atol=0, equal_nan=True)
                       and np.allclose(line.get_ydata(), y, rtol=1e-6, atol=0, equal_nan=True)
                       and line.get_color() == one["colour"] for line in axis.lines)
    assert len(panels) == 4 and len(chart.drawn) == 2


def test_what_has_no_value_is_a_dash_and_the_table_says_why() -> None:
    said = table(["a", "ω"], [["x", np.nan], ["y", None], ["z", 1.0]], ["s", ".1f"], ["ω"], none="not computed").splitlines()
    assert [line.split() for line in said[2:5]] == [["x", "-", "-"], ["y", "-", "-"], ["z", "1.0", "0.2"]]
    assert said[-1] == "-  not computed" and "nan" not in "".join(said)
    assert "not computed" not in table(["a"], [["x"]], ["s"], none="not computed")


def test_long_lines_are_broken_and_short_ones_left() -> None:
    text = "short   line\n" + "word " * 40 + "\n" + "x" * 120
    said = fitted(text).splitlines()
    assert said[0] == "short   line" and said[-1] == "x" * 120
    assert all(len(line) <= WIDTH for line in said[:-1]) and " ".join(" ".join(said[1:-1]).split()) == ("word " * 40).strip()


def test_the_widest_study_fits() -> None:
    slow = Timing(123.0, 99.0, 150.0)
    row = Row("dual-craig-bampton", 99, 99_999, 1e-10, 1e-10, 1e-10, 100, -1.0, 0.0, slow, slow, 0.0, stable=True,
              error_frequency=1e-10, error_force=1e-10, pareto=True, cutoff=0.5, reason="the reason is " + "long " * 30)
    for force in (0.0, np.nan):
        found = Study("x", (0.0, 1.0), 5, replace(row, method="full", size=100_000, error_force=force), (row, row))
        assert max(map(len, str(found).splitlines())) <= WIDTH
        assert "\n\n" not in str(found)  # in one piece


def test_panels_that_share_an_axis_of_errors_show_all_of_them() -> None:
    """The last panel has the smaller errors: its limits must not cut off those of the first."""
    panels = [Panel([Series("Rubin", [5.0], [error], "rubin")], "DOF", "error", rounding=True, share={"y": "error"}, logs="y")
              for error in (2.6e-3, 1e-13)]
    for axis in draw(Chart("errors", "Errors", panels, across=2)).axes:
        assert axis.get_ylim()[0] < 1e-13 and axis.get_ylim()[1] > 2.6e-3
