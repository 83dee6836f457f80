"""Charts of components and of the paper: friction laws, critical slopes, eigenvalues, interfaces on springs, receptances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from femsub.studies.charts import ROUNDING, Chart, Heat, Level, Panel, Series, finite, floored, hover_of, look
from femsub.studies.tables import grouped

ERROR = "relative error  [-]"
MISSING = "Where a point is missing, the band reaches above the model's cut-off, or stability is never lost."
HOLLOW = "Right of the line Re λ = 0 a mode grows. Hollow marks of reduced models lie above their cut-off."
RESPONSE = "The error is bounded: the difference from the full model's receptance, and what is not known of both."
PLANE = "Re λ  [1/time]", "Im λ  [rad/time]"
#: line, hollow and width of models of one method: the most modes first on springs, last in receptances
STYLES = (("solid", False, 1.6), ("dash", True, 1.2), ("dot", True, 0.9))
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


def nested(at: int) -> float:
    """The size of a mark: those drawn later are smaller, so that marks that lie on each other are all seen."""
    return max(7.5 - 2 * at, 3.0)


def eigenvalue_chart(models: Sequence[Mapping[str, Any]], title: str, clump: float = 0.4, piled: float = 0.03,
                     decades: int = 5) -> Chart:
    """Eigenvalues in the complex plane (the paper's Fig. 4); hollow above the reduced model's cut-off.

    Where those of the reduced models would lie in one clump, in less than this part of the full model's range of Im λ, a second
    row of the figure shows them enlarged: what fills more is seen well enough. Where half of |Re λ| are below `piled` of the
    largest, they would pile up at 0: the axis is logarithmic, with at most so many `decades` on each side of 0.
    """
    places = grouped(models, "panel")
    # the frames around the reduced models' eigenvalues below their cut-off
    frames: dict[str, tuple[tuple[float, float], tuple[float, float]]] = {}
    for name, several in places.items():
        every = np.concatenate([np.asarray(model["eigenvalues"]) for model in several])
        values = np.concatenate([np.zeros(0), *(np.asarray(model["eigenvalues"])[~np.asarray(model["above_cutoff"])]
                                                for model in several if model["model"] != "full")])
        values = values[values.imag >= 0]
        if len(values) and values.imag.max() < clump * every.imag.max():
            low, high = -0.05 * values.imag.max(), 1.15 * values.imag.max()
            seen = every[(every.imag >= low) & (every.imag <= high)]
            room = 0.08 * (np.ptp(seen.real) or high)
            frames[name] = (float(seen.real.min() - room), float(seen.real.max() + room)), (float(low), float(high))
    # the decade from which on the axis of Re λ is logarithmic
    growth = np.abs(np.concatenate([np.asarray(model["eigenvalues"]).real for model in models]))
    growth = growth[np.isfinite(growth)]
    growth, linear = growth[growth > ROUNDING * growth.max(initial=0.0)], dict[str, float]()
    if len(growth) and np.median(growth) <= piled * growth.max():
        linear["x"] = float(10.0 ** max(np.floor(np.log10(np.quantile(growth, 0.2))), np.ceil(np.log10(growth.max())) - decades))
    # panels
    line = [Level(0.0, line="solid", colour="#808080")]
    sizes = {name: " and ".join(dict.fromkeys(str(model["size"]) for model in several if model["model"] != "full"))
             for name, several in places.items()}  # '5', or '9 and 10' where the methods differ
    panels = [Panel(_spectra(several), *PLANE, f"{name} ({sizes[name]} DOF)" if len(several) > 1 else name, levels=line,
                    share={"x": "all", "y": "all"}, band=frames[name][1] if name in frames else None, linear=linear)
              for name, several in places.items()]
    for name, several in places.items() if frames else ():
        limits = dict(zip("xy", frames[name], strict=True)) if name in frames else {}
        panels.append(Panel(_spectra(several, True) if name in frames else (), *PLANE,
                            "the grey part, enlarged" if name in frames else "", levels=line, limits=limits,
                            where="figure"))
    return Chart("complex-modes", f"Eigenvalues: {title}", panels, len(places), note=HOLLOW, width=1.0 if len(places) > 1
                 else 0.7,
                 height=3.6, columns=3)


def _spectra(models: Sequence[Mapping[str, Any]], enlarged: bool = False, crowd: int = 60) -> list[Series]:
    """The full model as large circles, the reduced ones within them; small ones for more eigenvalues than a `crowd`."""
    series = []
    for at, model in enumerate(models):
        values, beyond = np.asarray(model["eigenvalues"]), np.asarray(model["above_cutoff"])
        full, label = model["model"] == "full", look(model["model"]).label
        size = (10.0 if len(values) <= crowd or enlarged else 5.0) if full else nested(at - 1)
        for chosen, hollow, word in ((~beyond, full, label), (beyond, True, f"{label}, above its cut-off")):
            own = values[chosen]
            if len(own):
                hover = {"DOF": [model["size"]] * len(own), "Re λ": own.real, "ω [rad/time]": own.imag,
                        "error bar of Re λ": np.asarray(model["error_bar"])[chosen],
                        "damping [%]": [-100 * z.real / abs(z) if z.imag else None for z in own]}
                series.append(Series(word, own.real, own.imag, model["model"], size=size, hollow=hollow, hover=hover))
    return series


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


def response_chart(curves: Sequence[Mapping[str, Any]], title: str) -> Chart:
    """|h| and its phase over ω for each model, and for reduced models the bound of the relative error.

    A curve has `model`, `modes`, `size`, `omega`, `magnitude`, `phase` in degrees and, of a reduced model, `error`.
    """
    panels = []
    for key, label, logs in (("magnitude", "|h|  [length/force]", "y"), ("phase", "phase of h  [°]", ""),
                             ("error", "bound of the error over |h|  [-]", "y")):
        seen: dict[str, int] = {}
        series = []
        for curve in curves:
            if key not in curve:
                continue
            at = seen.setdefault(curve["model"], 0)
            seen[curve["model"]] += 1
            line, _, width = STYLES[at % len(STYLES)] if curve["model"] != "full" else ("solid", False, 2.2)
            series.append(Series(f"{look(curve['model']).label}, {curve['size']} DOF{curve.get('words', '')}", curve["omega"],
                                 np.asarray(curve[key], dtype=float), curve["model"], line, "", width=width))
        panels.append(Panel(series, "ω  [rad/time]", label, logs=logs, rounding=key == "error", share={"x": "omega"}))
    return Chart("response", title, panels, note=RESPONSE, height=2.0, columns=3)
