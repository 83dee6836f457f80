"""Figures of errors against run time: of components, of systems part by part, of systems under friction."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.app.figure_style import PAGE, ROUNDING, few_decades, label_points, legend_below, look, new_figure, rounding_below

if TYPE_CHECKING:
    from femsub.studies import Row, Study

COMPONENT = {"error_growth": "growth rates Re λ", "error_critical": "critical slope", "error_eigenvalue": "eigenvalues λ"}
SYSTEM = {"error_frequency": "frequencies ω", "error_growth": "growth rates Re λ", "error_critical": "critical slope",
          "error_force": "forces in the joints"}
FRICTION = {"error_eigenvalue": "eigenvalues λ", "error_real": "growth rates Re λ", "error_critical": "critical μ"}
LEGEND = "filled: to solve once; hollow: to reduce and to solve; numbers: DOF"


@dataclass(frozen=True)
class Point:
    """A reduced model: seconds to solve, and to reduce and to solve, each as (median, least, most)."""

    method: str
    size: int
    error: float
    solve: tuple[float, float, float]
    whole: tuple[float, float, float]
    best: bool = False  #: no other is both as fast and as accurate
    misses: bool = False  #: an unstable mode of the full model


def error_time_figure(studies: Sequence[tuple[str, Study]]) -> Any:
    """Errors over seconds: a row of panels for each study, by the name of its interface.

    Models of full size are not shown, since their errors are rounding. Shown are the two errors that tell most: those of growth
    rates and of the critical slope, or of eigenvalues where there is no slope or its error is rounding.
    """
    shown = [[row for row in found.rows if row.missing == 0 and row.size < found.full.size] for _, found in studies]
    rows = [row for several in shown for row in several]
    kinds = [kind for kind in COMPONENT if any(getattr(row, kind) > ROUNDING for row in rows)][:2] or ["error_growth"]
    found = studies[0][1]
    head = (f"{found.name}: error against run time, band {found.band[0]:g} to {found.band[1]:.4g} rad/time\n"
            f"{LEGEND}{_runs(studies)}")
    panels = [({kind: COMPONENT[kind] + (f", interface {interface}" if len(studies) > 1 else "") for kind in kinds},
               one.full, several) for (interface, one), several in zip(studies, shown, strict=True)]
    return _figure(panels, head, len(kinds))


def _runs(studies: Sequence[tuple[str, Study]]) -> str:
    times = [time for _, found in studies for row in found.rows for time in (row.reduction, row.solution)]
    spread = any(time.most > time.least for time in times)
    runs = studies[0][1].repeats
    return (f"; medians of {runs} runs" if runs > 1 else "; one run") + (", bars from least to most" if spread else "")


def errors_figure(found: Study, title: str) -> Any:
    """Errors of frequencies, growth rates, critical slope and forces in the joints of a system over seconds."""
    rows = [row for row in found.rows if row.sound and row.size < found.full.size]
    kinds = {kind: name for kind, name in SYSTEM.items() if any(np.isfinite(getattr(row, kind)) for row in found.rows)}
    head = (f"{title}: error against run time, band {found.band[0]:g} to {found.band[1]:.4g} rad/time\n{LEGEND}"
            f"{_runs([('', found)])}\nnot shown: models of full size, and those with a mode missing or added in the band")
    return _figure([(kinds, found.full, rows)], head, 2)


def _figure(panels: Sequence[tuple[Mapping[str, str], Row, Sequence[Row]]], head: str, columns: int) -> Any:
    lines = sum(-(-len(kinds) // columns) for kinds, _, _ in panels)
    figure = new_figure(PAGE, 2.7 * lines + 1.2)
    axes = figure.subplots(lines, columns, sharex=True, squeeze=False).ravel()
    labels, at = [], 0
    for kinds, full, rows in panels:
        for axis, (kind, name) in zip(axes[at:], kinds.items(), strict=False):
            axis.axvline(full.solution.median, color="black", ls="--", lw=1, label=f"full model, {full.size} DOF")
            labels += error_panel(axis, [_point(row, kind) for row in rows])
            axis.set_title(name)
        at += -(-len(kinds) // columns) * columns
        for axis in axes[at - columns + len(kinds) % columns:at] if len(kinds) % columns else ():
            axis.set_visible(False)
    _finish(figure, axes, columns, head, labels)
    return figure


def friction_errors_figure(found: Study, title: str) -> Any:
    """The errors of eigenvalues, growth rates and critical μ over the seconds at one μ; those of a system under friction."""
    kinds = {kind: name for kind, name in FRICTION.items() if any(np.isfinite(getattr(row, kind)) for row in found.rows)}
    figure = new_figure(PAGE, 3.9)
    axes = figure.subplots(1, max(len(kinds), 1), sharex=True, squeeze=False)[0]
    labels = []
    for axis, (kind, name) in zip(axes, kinds.items(), strict=False):
        axis.axvline(found.full.solution.median, color="black", ls="--", lw=1, label="full model, one μ")
        labels += error_panel(axis, [_point(row, kind) for row in found.rows])
        axis.set_title(name)
    _finish(figure, axes, len(axes), f"{title}: error against run time at one μ\n{LEGEND}", labels)
    axes[0].set_ylabel("largest error over |λ|, or over μ  [-]")
    return figure


def _point(row: Row, kind: str) -> Point:
    reduce, solve = row.reduction, row.solution
    whole = (reduce.median + solve.median, reduce.least + solve.least, reduce.most + solve.most)
    return Point(row.method, row.size, getattr(row, kind), (solve.median, solve.least, solve.most), whole,
                 row.pareto and kind == "error_growth", row.missed > 0 and kind in FRICTION)


def error_panel(axis: Any, points: Sequence[Point]) -> list[tuple[Any, float, float, str, str]]:
    """Draws the models of all methods; what is returned labels them with their DOF, the smallest and largest first."""
    ends: list[tuple[Any, float, float, str, str]] = []
    others: list[tuple[Any, float, float, str, str]] = []
    for method in dict.fromkeys(point.method for point in points):
        style = look(method)
        mine = [point for point in points if point.method == method and np.isfinite(point.error)]
        height = np.array([max(point.error, ROUNDING) for point in mine])
        solve = np.array([point.solve for point in mine]).reshape(-1, 3)
        whole = np.array([point.whole for point in mine]).reshape(-1, 3)
        axis.hlines(height, solve[:, 0], whole[:, 0], color=style.colour, lw=0.8, ls=(0, (1, 3)), alpha=0.6, zorder=2)
        for seconds, fill in ((solve, style.colour), (whole, "white")):
            axis.hlines(height, seconds[:, 1], seconds[:, 2], color=style.colour, lw=1.2, alpha=0.5, zorder=2.5)
            axis.plot(seconds[:, 0], height, color=style.colour, lw=0.8, alpha=0.6, zorder=2)
            axis.plot(seconds[:, 0], height, color=style.colour, marker=style.marker, mfc=fill, ms=5, ls="none", zorder=4,
                      label=style.label if fill != "white" else None)
        for i, point in enumerate(mine):
            (others if 0 < i < len(mine) - 1 else ends).append((axis, solve[i, 0], height[i], str(point.size), style.colour))
    known = [point for point in points if np.isfinite(point.error)]
    best, lacking = [point for point in known if point.best], [point for point in known if point.misses]
    for which, mark, size, word in ((best, "o", 10, "no other is both as fast and as accurate"),
                                    (lacking, "x", 9, "misses an unstable mode")):
        if which:
            axis.plot([point.solve[0] for point in which], [max(point.error, ROUNDING) for point in which], mark, ms=size,
                      mfc="none", mec="black", mew=0.8, ls="none", zorder=5, label=word)
    axis.set_xscale("log")
    rounding_below(axis, [point.error for point in points])
    axis.grid(lw=0.4)
    return ends + others


def _finish(figure: Any, axes: Sequence[Any], columns: int, head: str, labels: list[tuple[Any, float, float, str, str]]) -> None:
    shown = [axis for axis in axes if axis.get_visible()]
    seconds = [time for axis in shown for line in axis.lines for time in _finite(line.get_xdata()) if time > 0]
    shown[0].set_xlim(min(seconds, default=1e-3) / 1.7, max(seconds, default=1.0) * 1.7)
    for at, axis in enumerate(axes):
        if at % columns == 0:
            axis.set_ylabel("relative error  [-]")
        below = at + columns
        if below >= len(axes) or not axes[below].get_visible():
            axis.set_xlabel("run time  [s]")
            axis.tick_params(labelbottom=True)
    few_decades(shown[0])
    legend_below(figure, shown, 3)
    figure.suptitle(head, fontsize=9)
    label_points(figure, labels)


def _finite(values: Iterable[Any]) -> list[float]:
    return [float(value) for value in values if np.isfinite(value)]
