"""Charts of errors against run time: of components, of systems of several parts, of systems under friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.output import ROUNDING, Chart, Level, Panel, Series, floored, grouped, look

if TYPE_CHECKING:
    from femsub.studies.results import Row, Study

#: the errors of each kind of chart; a figure draws the first ones
COMPONENT = ("error_growth", "error_critical", "error_eigenvalue", "error_frequency")
SYSTEM = ("error_frequency", "error_growth", "error_critical", "error_force", "error_eigenvalue")
FRICTION = ("error_eigenvalue", "error_real", "error_critical")
NAMES = {"error_growth": "growth rates Re λ", "error_eigenvalue": "eigenvalues λ", "error_frequency": "frequencies ω",
         "error_force": "forces in the joints", "error_real": "growth rates Re λ"}
LEGEND = "filled: to solve once; hollow: to reduce and to solve; numbers: DOF"
NOTE = ("Below and to the left is better. Filled: the time to solve once. Hollow: to reduce and to solve. Dashed: the full "
        f"model. Errors of zero are drawn at {ROUNDING:g}.")


def study_chart(found: Study, title: str, name: str = "compare") -> Chart:
    """Errors over seconds of a study: over a range of a parameter, of a system with forces in its joints, or of a component."""
    if found.between is not None:
        return friction_errors_chart(found, title, name)
    return errors_chart(found, title, name) if found.full.error_force == 0 else error_time_chart([(title, found)])


def error_time_chart(studies: Sequence[tuple[str, Study]], top: int = 2) -> Chart:
    """Errors over seconds: a row of panels for each study, by the name of its interface.

    Models of full size are not shown, since their errors are rounding. The figure shows `top` of the errors side by side: those
    of growth rates and of the critical slope, or of eigenvalues if there is no slope or its error is rounding. A page shows all.
    """
    shown = [[row for row in found.rows if row.missing == 0 and row.size < found.full.size] for _, found in studies]
    kinds = [kind for kind in COMPONENT if any(getattr(row, kind) > ROUNDING for rows in shown for row in rows)][:top]
    kinds = kinds or ["error_growth"]
    panels = [panel for (interface, one), rows in zip(studies, shown, strict=True)
              for panel in _panels(one, rows, COMPONENT, kinds, interface if len(studies) > 1 else "")]
    return _chart("compare", [one for _, one in studies], studies[0][1].name, panels, len(kinds))


def errors_chart(found: Study, title: str, name: str) -> Chart:
    """Errors of frequencies, growth rates, critical slope and forces in the joints of a system, over seconds."""
    rows = [row for row in found.rows if row.sound and row.size < found.full.size]
    kinds = [kind for kind in SYSTEM[:4] if any(np.isfinite(getattr(row, kind)) for row in found.rows)]
    about = ["not shown: models of full size, and those with a mode missing or added in the band"]
    drawn = {row.method for row in rows}
    for method, own in grouped((row for row in found.rows if row.method not in drawn), "method").items():
        why = [word for word, hidden in (("of full size", [row.size >= found.full.size for row in own]),
                                         ("a mode missing", [row.missing for row in own]),
                                         ("a mode added", [row.extra for row in own])) if any(hidden)]
        about.append(f"{look(method).label} has no mark: {' or '.join(why)} in each of its models")
    return _chart(name, [found], title, _panels(found, rows, SYSTEM, kinds, ""), 2, [*about, *found.left_out])


def friction_errors_chart(found: Study, title: str, name: str) -> Chart:
    """For a system under friction: errors of eigenvalues, growth rates and critical μ, over the seconds at one μ."""
    kinds = [kind for kind in FRICTION if any(np.isfinite(getattr(row, kind)) for row in found.rows)] or ["error_eigenvalue"]
    full = Level(found.full.solution.median, "full model, one μ")
    panels = [_panel(found, found.rows, kind, full, "largest error over |λ|, or over μ  [-]") for kind in kinds]
    return Chart(name, f"{title}: error against run time at one μ", panels, len(kinds), LEGEND, NOTE, columns=3)


def size_chart(found: Study, title: str) -> Chart:
    """The known errors over the DOF of the models, side by side."""
    kinds = [kind for kind in (SYSTEM[:4] if found.between is None else FRICTION)
             if any(np.isfinite(getattr(row, kind)) and getattr(row, kind) > 0 for row in found.rows)]
    panels = []
    for kind in kinds:
        series = []
        for method, rows in grouped(found.rows, "method").items():
            own = sorted(rows, key=lambda row: row.size)
            series.append(Series(look(method).label, [row.size for row in own], floored(getattr(row, kind) for row in own),
                                 method, "solid", hover={"modes": [row.modes for row in own]}))
        panels.append(Panel(series, "DOF of the reduced model  [-]", "relative error  [-]", _title(found, kind), rounding=True,
                            share={"y": "error"}, whole="x"))
    lo, hi = found.band
    return Chart("sizes", f"{title}: error over size, band {lo:g} to {hi:.6g} rad/time", panels, min(len(panels), 3))


def _title(found: Study, kind: str) -> str:
    """The quantity of which `kind` is the error, in words."""
    return NAMES.get(kind, f"critical {found.symbol or 'slope'}")


def _chart(name: str, studies: Sequence[Study], title: str, panels: Sequence[Panel], across: int,
           about: Sequence[str] = ()) -> Chart:
    (lo, hi), runs = studies[0].band, studies[0].repeats
    times = [time for found in studies for row in found.rows for time in (row.reduction, row.solution)]
    spread = ", bars from least to most" if any(time.most > time.least for time in times) else ""
    about = [LEGEND, (f"medians of {runs} runs" if runs > 1 else "one run") + spread, *about]
    head = f"{title}: error against run time, band {lo:g} to {hi:.6g} rad/time"
    return Chart(name, head, panels, across, "\n".join(about), NOTE, height=2.7, columns=3)


def _panels(found: Study, rows: Sequence[Row], kinds: Sequence[str], drawn: Sequence[str], place: str) -> list[Panel]:
    """A panel for each known error; errors that are not in `drawn` are only on the page."""
    full = Level(found.full.solution.median, f"full model, {found.full.size} DOF")
    panels = [replace(_panel(found, rows, kind, full, "relative error  [-]"), where="" if kind in drawn else "page")
              for kind in kinds if kind in drawn or any(np.isfinite(getattr(row, kind)) for row in rows)]
    return [replace(one, title=f"{one.title}, {place}", among=place) for one in panels] if place else panels


def _panel(found: Study, rows: Sequence[Row], kind: str, full: Level, y: str) -> Panel:
    known = [row for row in rows if np.isfinite(getattr(row, kind))]
    series = []
    for method, own in grouped(known, "method").items():
        label, height = look(method).label, floored(getattr(row, kind) for row in own)
        solve, whole = (np.array([astuple(getattr(row, key)) for row in own]) for key in ("solution", "whole"))
        hover: dict[str, list[Any]] = {word: [getattr(row, key) for row in own] for word, key in (
            ("DOF", "size"), ("modes", "modes"), ("error", kind))}
        hover |= {"s to solve": list(solve[:, 0]), "s to reduce": list(whole[:, 0] - solve[:, 0])}
        hover |= {word: [getattr(row, word) for row in own] for word in ("missing", "extra", "missed", "invented")}
        # dotted bars between the two marks of a model, and solid bars from the least to the most seconds of each
        bars = [(solve[:, 0], whole[:, 0], "dot", 0.8),
                *((one[:, 1], one[:, 2], "solid", 1.6) for one in (solve, whole) if (one[:, 1] < one[:, 2]).any())]
        for low, high, line, width in bars:
            x = [value for pair in zip(low, high, strict=True) for value in (*pair, np.nan)]
            series.append(Series(label, x, np.repeat(height, 3), method, line, "", width=width, legend=False))
        # filled and hollow marks
        series += [
            Series(label, solve[:, 0], height, method, "solid", width=0.6, labels=list(map(str, hover["DOF"])), hover=hover),
            Series(label, whole[:, 0], height, method, "solid", width=0.6, hollow=True, legend=False, hover=hover)]
    front = [row for row in known if row.pareto and kind == "error_growth"]
    misses = [row for row in known if row.missed and kind in FRICTION]
    for which, mark, size, word in ((front, "o", 10.0, "no other is both as fast and as accurate"),
                                    (misses, "x", 9.0, "misses an unstable mode")):
        if which:
            series.append(Series(word, [row.solution.median for row in which], floored(getattr(row, kind) for row in which),
                                 marker=mark, size=size, hollow=True))
    times = [time for row in rows for time in (*astuple(row.solution), *astuple(row.whole)) if time > 0] + [full.at]
    limits = {"x": (min(times) / 1.7, max(times) * 1.7)} if min(times) > 0 else {}
    return Panel(series, "run time  [s]", y, _title(found, kind), logs="xy", levels=[full], limits=limits, rounding=True,
                 share={"x": "time"}, among="errors")
