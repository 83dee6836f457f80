"""Charts of answers about stability: losses of several models, growth over a parameter, derivatives, changes that help."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.output import (
    Chart,
    Heat,
    Level,
    Panel,
    Series,
    finite,
    floored,
    grouped,
    hover_of,
    linear_up_to,
    look,
    nested,
)

if TYPE_CHECKING:
    from femsub.stability.changes_tried import WhatHelps
    from femsub.stability.question import CriticalValue
    from femsub.stability.sensitivities import Sensitivities
    from femsub.stability.sweep import StabilitySweep

NOTE = ("Each bar goes from the largest growth rate of the model as it is to that with the change. Left of the target the change "
        "is enough. The slope alone misleads where modes meet, or where another mode begins to grow.")
ERROR = "relative error  [-]"
MISSING = "Where a point is missing, the band reaches above the model's cut-off, or stability is never lost."
VERDICTS = {True: ("all modes decay", "#2166ac"), False: ("a mode grows", "#b2182b"), None: ("undecided", "0.5")}


def changes_chart(name: str, found: WhatHelps, title: str) -> Chart:
    """A bar for each candidate, the best at the top: the largest Re λ now and with the change.

    Marks show what the slope predicts, and the full model, where it was solved.
    """
    now, ranks, tried = found.before.growth, range(1, len(found.tried) + 1), list(found.tried)
    bars = list[Series]()
    for rank, one in zip(ranks, tried, strict=True):
        word, colour = VERDICTS[one.is_stable]
        ends = finite([now, one.growth])  # a band without modes has no growth
        middle = float(np.mean(ends[np.isfinite(ends)])) if np.isfinite(ends).any() else found.target
        bars += [Series("", ends, [rank, rank], line="solid", marker="", colour=colour, width=4.0, legend=False),
                 Series(word, ends[1:], [rank], marker="o", colour=colour, size=7.0, hover={"candidate": [one.name]}),
                 Series("", [middle], [rank - 0.3], marker="", colour="black", legend=False, labels=[one.name])]
    bars.append(Series("by slope", finite([one.by_slope for one in tried]), ranks, marker="|", colour="black", size=11.0))
    full = {rank: one.in_full.growth for rank, one in zip(ranks, tried, strict=True) if one.in_full is not None}
    if full:
        bars.append(Series("full model", finite(list(full.values())), list(full), marker="D", colour="black", hollow=True,
                           size=8.0))
    levels = [Level(now, "as it is", line="dot"), Level(found.target, "target")]
    panel = Panel(bars, "largest Re λ  [1/time]", "rank of the candidate", levels=levels,
                  limits={"y": (len(tried) + 0.5, 0.4)}, whole="y")
    return Chart(name, title, [panel], note=NOTE, height=1.5 + 0.45 * len(tried), columns=6)


def crossings_chart(found: CriticalValue, title: str) -> Chart:
    """Where modes begin and cease to grow, over the parameter and their frequency, and the intervals not excluded."""
    series = []
    for word, several, marker, colour in (("a mode begins to grow", found.losses, "^", "#c0392b"),
                                          ("a mode ceases to grow", found.regains, "v", "#2166ac")):
        if several:
            values = [one.value for one in several]
            series.append(Series(word, values, [one.omega for one in several], marker=marker, colour=colour, size=8.0,
                                 labels=[f"{value:.5g}" for value in values], hover={"width": [one.width for one in several]}))
    if found.open:
        ends = [value for pair in found.open for value in (*pair, np.nan)]
        series.append(Series("not excluded", ends, np.zeros(len(ends)), line="solid", marker="", colour="#e69f00", width=5.0))
    lo, hi = sorted(found.searched)
    room = 0.03 * (hi - lo)
    limits = {"x": (lo - room, hi + room)} if np.isfinite(room) else {}
    top = max([*(one.omega for one in (*found.losses, *found.regains)), found.band[1] if np.isfinite(found.band[1]) else 0.0])
    panel = Panel(series, f"{found.parameter}  [-]", "ω  [rad/time]", limits=limits | {"y": (-0.03 * (top or 1.0), 1.06 * (
        top or 1.0))})
    return Chart("critical", title, [panel], about=f"from {found.searched[0]:g} to {found.searched[1]:g}; {found.evidence}",
                 width=0.8)


def growth_over_chart(found: StabilitySweep, title: str) -> Chart:
    """The largest Re λ over the parameter, and Im λ of that mode."""
    order = np.argsort(found.values, kind="stable")
    panels = [Panel([Series("largest growth", found.values[order], y[order], line="solid", size=4.0, colour="#0067a5")],
                    f"{found.parameter}  [-]", label, share={"x": "parameter"}, levels=levels)
              for label, y, levels in (("max Re λ  [1/time]", finite(found.growth), [Level(0.0, "", "y", "solid")]),
                                       ("its Im λ  [rad/time]", finite(found.omega), []))]
    return Chart("sweep", title, panels, width=0.8, height=2.2)


def sensitivities_chart(found: Sensitivities, title: str, most: int) -> Chart:
    """The change of Re λ of each eigenvalue by the whole of each parameter, to first order, or by one unit if it has no value.

    Only the `most` eigenvalues with the largest Re λ are drawn.
    """
    whole = np.isfinite(found.values)
    slopes = np.where(whole, found.relative.real, found.growth)
    bars = np.where(whole, np.abs(found.values), 1.0) * found.error_bar
    names = [name if known else f"{name}, by one unit" for name, known in zip(found.parameters, whole, strict=True)]
    upper = np.flatnonzero(found.eigenvalues.imag >= 0)
    chosen = upper[np.argsort(-found.eigenvalues[upper].real, kind="stable")][:most]
    panels = []
    for k in chosen:
        order = np.argsort(-np.abs(np.nan_to_num(slopes[k])), kind="stable")
        series = list[Series]()
        for rank, j in enumerate(order, 1):
            value, bar = slopes[k, j], bars[k, j]
            colour = "#c0392b" if value > 0 else "#2166ac"
            series += [Series("", [0.0, value], [rank, rank], line="solid", marker="", colour=colour, width=6.0, legend=False),
                       Series("error bar", [value - bar, value + bar], [rank, rank], line="solid", marker="|", colour="black",
                              legend=rank == 1 and k == chosen[0]),
                       Series("", [value / 2], [rank - 0.35], marker="", colour="black", legend=False, labels=[names[j]])]
        up_to = linear_up_to(slopes[k])
        panels.append(Panel(series, "change of Re λ  [1/time]", "rank of the parameter",
                            f"λ = {found.eigenvalues[k].real:.4g} {found.eigenvalues[k].imag:+.5g}i",
                            levels=[Level(0.0, line="solid", colour="#808080")], limits={"y": (len(order) + 0.5, 0.3)},
                            whole="y", linear={"x": up_to} if up_to else {}))
    left = f"{most} of {len(upper)} eigenvalues are drawn" if len(upper) > most else ""
    return Chart("sensitivities", title, panels, min(2, len(panels)), about=left, height=1.2 + 0.4 * len(names))


def growth_chart(found: Mapping[str, Any]) -> Chart:
    """max Re λ of the full model over the slope and another variable, such as the belt's place, with the borders of all models
    (the paper's Fig. 3a), and beside it the deviation of the reduced models' borders."""
    full, belts, lines, errors = next(panel for panel in found["panels"] if panel["model"] == "full"), found["at"], [], []
    growth, border = finite(full["growth"]), finite(full["critical_slope"])
    top = float(np.nanmax(np.abs(growth), initial=0.0)) or 1.0
    heat = Heat(belts, np.abs(found["slopes"]), growth.T, "max Re λ  [1/time]", 1e-3 * top, top, signed=True)
    lines.append(Series("full", belts, -border, "full", "solid", size=8.0, hollow=True))
    for panel in found["panels"]:
        if panel["model"] != "full":
            other, mine = panel["rest"] != full["rest"], finite(panel["critical_slope"])
            one = Series(f"{look(panel['model']).label}{panel['rest'] and ', '}{panel['rest']}", belts, -mine, panel["model"],
                         "dot" if other else "solid", size=4.0, hollow=other)
            lines.append(one)
            errors.append(replace(one, y=floored(np.abs(mine / border - 1))))
    x, common = f"{found['over']}  [-]", {"x": "over"}
    return Chart("growth", f"Growth and critical slope over {found['over']}", [
        Panel(lines, x, "-dμ/dv  [time/length]", "full model: growth, and the borders of all", "y", share=common, heat=heat),
        Panel(errors, x, ERROR, "error of the reduced models' borders", rounding=True, share=common)], 2, columns=3)


def critical_chart(rows: Sequence[Mapping[str, Any]], varied: Sequence[str], said: str, title: str) -> Chart:
    """Critical values and their errors over a numerical variable, or over the size of the reduced models (the paper's Fig. 3b).

    Other variables have panels of their own.
    """
    x = next((name for name in varied if len({row[name] for row in rows}) > 1 and all(
        isinstance(row[name], (int, float)) for row in rows)), "size")
    rest = [name for name in varied if name != x]
    places: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        places.setdefault(", ".join(f"{name} {row[name]}" for name in rest), []).append(row)
    words = {"DOF": "size", f"critical {said}": "value", "relative error": "error", "ω [rad/time]": "omega",
             "static port error": "port_error", "why": "reason"}
    axis, panels = "DOF of the reduced model  [-]" if x == "size" else f"{x}  [-]", list[Panel]()
    unit = "time/length" if said == "dμ/dv" else "-"
    for key, label, drawn in (("value", f"critical {said}  [{unit}]", finite), ("error", ERROR, floored)):
        for place, mine in places.items():
            errors, levels = key == "error", list[Level]()
            series = [Series(name, [row[x] for row in own], drawn([row[key] for row in own]), own[0]["model"], "solid",
                             size=nested(at), hover=hover_of(own, words)) for at, (name, own) in enumerate(
                                 curves_of([row for row in mine if row["model"] != "full"], x))]
            full = [row for row in mine if row["model"] == "full" and np.isfinite(row["value"])]
            if full and not errors and x == "size":
                levels = [Level(full[0]["value"], f"full model: {full[0]['value']:.6f}", "y")]
            elif full and not errors:
                series.append(Series("full", [row[x] for row in full], [row["value"] for row in full], "full", "solid", size=8.0,
                                     hollow=True))
            panels.append(Panel(series, axis, label, "" if errors else place, "y" * errors, levels, rounding=errors,
                                share={"x": "x", "y": key}, among=place or "critical"))
    return Chart("critical", f"{title}: critical {said}", panels, len(places), note=MISSING,
                 width=1.0 if len(places) > 1 else 0.65, height=2.4)


def curves_of(rows: Sequence[Mapping[str, Any]], x: str) -> list[tuple[str, list[Mapping[str, Any]]]]:
    """The rows of each method in the order of x, with its name. Unless x is the size, each number of modes or of DOF is a curve.

    Of these two numbers, the one that varies less is used: models of equal size with different interfaces differ in their modes.
    """
    if x == "size":
        return [(look(model).label, sorted(own, key=lambda row: row[x])) for model, own in grouped(rows, "model").items()]
    by, unit = min((("modes", "modes"), ("size", "DOF")), key=lambda one: len({row[one[0]] for row in rows}))
    several = len({row[by] for row in rows}) > 1
    return [(look(model).label + (f", {count} {unit}" if several else ""), sorted(own, key=lambda row: row[x]))
            for (model, count), own in grouped(rows, "model", by).items()]
