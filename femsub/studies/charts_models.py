"""Charts of several models: friction laws, critical values, growth over what varies, interfaces on springs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from femsub.output import ROUNDING, STYLES, Chart, Heat, Level, Panel, Series, finite, floored, grouped, hover_of, look, nested

ERROR = "relative error  [-]"
MISSING = "Where a point is missing, the band reaches above the model's cut-off, or stability is never lost."
SHADES = ("#9ecae1", "#4292c6", "#08519c", "#000000")

def friction_chart(speeds: Any, curves: Sequence[Mapping[str, Any]], titles: Mapping[str, str], speed: float,
                   slope: float) -> Chart:
    """μ over the sliding speed for several ε, a panel for each law by its key (the paper's Fig. 2)."""
    shades = dict(zip(sorted({curve["eps"] for curve in curves}, reverse=True), SHADES, strict=False))
    panels = [Panel([Series(f"ε = {curve['eps']:g}", speeds, curve["value"], line="solid", marker="", colour=shades[curve["eps"]])
                     for curve in curves if curve["law"] == law], "sliding speed v  [length/time]", "friction coefficient μ  [-]",
                    title, levels=[Level(speed, f"v0 = {speed:g}, μ' = {slope:.4f}", colour="#4d4d4d")], share={"y": "mu"})
              for law, title in titles.items()]
    return Chart("friction-law", "Friction laws", panels, len(panels), height=2.8)


def growth_chart(found: Mapping[str, Any]) -> Chart:
    """max Re λ of the full model over the slope and what varies, as the belt's place, with the borders of all models (the paper's
    Fig. 3a), and beside it the deviation of the reduced models' borders."""
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
    """Critical values and their errors over what varies in numbers, or over the size of the reduced models (the paper's Fig. 3b).

    Whatever else varies has panels of its own.
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
    """The rows of each method in the order of x, by their names; over what varies, those of each number of modes or of DOF.

    Of the two it is the one that varies less: a model of a given size has other numbers of modes where its interface is another.
    """
    if x == "size":
        return [(look(model).label, sorted(own, key=lambda row: row[x])) for model, own in grouped(rows, "model").items()]
    by, unit = min((("modes", "modes"), ("size", "DOF")), key=lambda one: len({row[one[0]] for row in rows}))
    several = len({row[by] for row in rows}) > 1
    return [(look(model).label + (f", {count} {unit}" if several else ""), sorted(own, key=lambda row: row[x]))
            for (model, count), own in grouped(rows, "model", by).items()]


def springs_chart(rows: Sequence[Mapping[str, Any]], title: str, lines: int = 8) -> Chart:
    """Error of the lowest frequencies over the stiffness of the springs under the interface; a line for each model.

    A figure has about so many `lines`, which can still be distinguished: of each method the fewest and the most modes, and those
    between as far as there is room. A page has all.
    """
    methods, counts = (list(dict.fromkeys(row[key] for row in rows)) for key in ("model", "modes"))
    room = min(max(lines // max(len(methods), 1), 2), len(STYLES))
    drawn = [counts[at] for at in sorted({round(at) for at in np.linspace(0, len(counts) - 1, min(room, len(counts)))})]
    looks = {modes: STYLES[at] for at, modes in enumerate(reversed(drawn))}

    def panel(kept: Sequence[int], where: str) -> Panel:
        series = []
        for (model, modes), own in grouped((row for row in rows if row["modes"] in kept), "model", "modes").items():
            hover = hover_of(own, {"modes": "modes", "springs": "springs", "error": "error"})
            line, hollow, width = looks.get(modes, STYLES[0])
            series.append(Series(f"{look(model).label}, {own[0]['size']} DOF", hover["springs"], floored(hover["error"]), model,
                                 line, hollow=hollow, width=width, hover=hover))
        return Panel(series, "springs under the interface / static stiffness of the component there  [-]",
                     "relative error of ω  [-]", logs="xy", where=where)

    left = [f"{modes}" for modes in counts if modes not in drawn]
    about = f"not drawn, but in the table: models with {', '.join(left)} modes" if left else ""
    return Chart("springs", title, [panel(drawn, "figure"), panel(counts, "page")], about=about,
                 note="Soft springs leave the interface nearly free, stiff ones nearly fixed. Errors of zero are drawn at "
                 f"{ROUNDING:g}.", height=4.0, columns=3)
