"""The plots of a run's page as Plotly draws them, from results.json: each point tells its numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import pi
from typing import Any

from femsub.app.figure_style import look
from femsub.app.verdict import seconds_words, units_of

Data = Mapping[str, Any]
Trace = dict[str, Any]
SYMBOLS = {"o": "circle-open", "s": "square", "^": "triangle-up", "D": "diamond", "v": "triangle-down", "*": "star",
           "P": "cross", "X": "x", "h": "hexagon", "p": "pentagon", "<": "triangle-left", ">": "triangle-right"}
FLOOR = 1e-16  # errors of zero are drawn there
DASHES = ("solid", "dash", "dot", "dashdot")
INK = "ink"  # the page's own colour of text, light or dark
KINDS = {"fold": "diamond", "period doubling": "square", "Neimark-Sacker": "triangle-up", "branch point": "triangle-down"}
OVER = {"slope": "slope μ'(v0)  [time/length]", "speed": "belt speed v0  [length/time]", "force": "normal force F  [force]"}
BRANCHES = ("Solid: stable. Dashed: unstable. Dotted: stability not computed. Star: where the branch begins. Open circle: where "
            "a transient ended. Triangle, square, diamond: special points, which tell their kind.")
ERRORS = {"error_growth": "error of Re λ", "error_eigenvalue": "error of λ", "error_frequency": "error of ω",
          "error_critical": "error of the critical value", "error_force": "error of the forces in joints",
          "error_real": "error of Re λ, over |λ|"}


def plots(told: Data) -> list[dict[str, Any]]:
    """All plots that the results have data for: title, note, traces, axes."""
    makers = (_eigenvalues, _error_time, _critical_slopes, _size_sweep, _flutter, _branch_plots, _spectra, _springs, _friction)
    return [plot for make in makers for plot in make(told)]


def _plot(title: str, note: str, traces: Iterable[Trace], x: str, y: str, told: Data, *, logs: str = "",
          choices: Mapping[str, Mapping[str, str]] | None = None, lines: Sequence[Data] = ()) -> dict[str, Any]:
    """A plot; `logs` names its logarithmic axes; `choices` are, for x or y, columns of the traces by what stands at the axis;
    `lines` are upright ones.
    """
    said = units_of(told).said
    return {"title": said(title), "note": note, "traces": [_drawn(trace) for trace in traces],
            "x": said(x), "y": said(y), "logs": logs, "lines": lines,
            "choices": {axis: {key: said(label) for key, label in columns.items()} for axis, columns in (choices or {}).items()}}


def _drawn(trace: Trace) -> Trace:
    """A trace without what no axis has a place for: numbers that are infinite stand as words in results.json."""
    def places(values: Sequence[Any]) -> list[Any]:
        return [value if isinstance(value, (int, float)) else None for value in values]

    columns = {key: places(values) for key, values in trace.get("columns", {}).items()}
    return trace | {"x": places(trace["x"]), "y": places(trace["y"])} | ({"columns": columns} if columns else {})


def _trace(model: str, name: str, x: Sequence[Any], y: Sequence[Any], text: Sequence[str], mode: str = "markers",
           **more: Any) -> Trace:
    """Points in the colour and with the mark of a model."""
    _, colour, marker = look(model)
    colour = INK if colour == "black" else colour
    return {"name": name, "x": x, "y": y, "text": text, "mode": mode, "colour": colour, "symbol": SYMBOLS.get(marker, "circle"),
            **more}


def _line(at: float, text: str, only: Sequence[str] = ()) -> Data:
    """An upright line, at `only` these choices of x, or at all."""
    return {"at": at, "text": text} | ({"only": only} if only else {})


def _label(model: str, size: int | None = None, modes: int | None = None) -> str:
    label = look(model).label
    return label + (f", {modes} modes" if modes else "") + (f", {size} DOF" if size is not None else "")


def _told(told: Data, head: str, **values: Any) -> str:
    """The lines that a point shows, without what is not known; 'omega' also in Hz where the units are known."""
    lines = [head]
    for name, value in values.items():
        if value is None or value == "":
            continue
        shown = f"{value:.6g}" if isinstance(value, float) else str(value)
        if name == "ω" and units_of(told).known and isinstance(value, float):
            shown += f" rad/s = {value / (2 * pi):.6g} Hz"
        lines.append(f"{name.replace('_', ' ')}: {shown}")
    return "<br>".join(lines)


def _eigenvalues(told: Data) -> Iterator[dict[str, Any]]:
    """The complex plane: a panel for each interface, or for few, some and many modes."""
    found = told.get("eigenvalues")
    models: Sequence[Data] = found["models"] if isinstance(found, dict) else found or []
    if not models:
        return
    kept = list(dict.fromkeys(model["modes"] for model in models if model.get("modes")))
    if "interface" in models[0]:
        panels = {f"interface {place}": [model for model in models if model["interface"] == place]
                  for place in dict.fromkeys(model["interface"] for model in models)}
    else:
        chosen = dict.fromkeys([kept[0], kept[len(kept) // 2], kept[-1]]) if kept else {}
        panels = {f"{modes} modes": [model for model in models if model["model"] == "full" or model["modes"] == modes]
                  for modes in chosen}
    for panel, shown in panels.items():
        traces = []
        for model in shown:
            at = [i for i, value in enumerate(model["eigenvalues"]) if value[1] >= 0]
            values = [model["eigenvalues"][i] for i in at]
            name = _label(model["model"], model["size"])
            text = [_told(told, name, **{"Re λ": re, "ω": im, "error bar of Re λ": model["error_bar"][i],
                                         "damping ratio": -re / (re * re + im * im) ** 0.5 if im else None,
                                         "note": "above the model's cut-off" if model["above_cutoff"][i] else None})
                    for i, (re, im) in zip(at, values, strict=True)]
            traces.append(_trace(model["model"], name, [re for re, _ in values], [im for _, im in values], text,
                                 size=11 if model["model"] == "full" else 7,
                                 hollow=[bool(model["above_cutoff"][i]) for i in at]))
        yield _plot(f"Eigenvalues, {panel}", "Right of the line Re λ = 0 a mode grows. Hollow marks of reduced models lie above "
                    "their cut-off. Conjugates are not drawn.", traces, "Re λ  [1/time]", "Im λ  [rad/time]", told,
                    lines=[_line(0.0, "")])


def _studies(told: Data) -> Iterator[tuple[str, Sequence[Data]]]:
    """Each table of errors against run time, with what it is about."""
    for name, found in told.items():
        rows = found["rows"] if isinstance(found, dict) and "rows" in found else found
        if not (isinstance(rows, list) and rows and isinstance(rows[0], dict)):
            continue
        if "solution_median_s" not in rows[0]:
            continue
        places = list(dict.fromkeys(row.get("interface") for row in rows))
        about = name.removeprefix("error-time").removeprefix("methods").strip("-").replace("-", " ")
        for place in places:
            yield f"interface {place}" if place else about, [row for row in rows if row.get("interface") == place]


def _error_time(told: Data) -> Iterator[dict[str, Any]]:
    for about, rows in _studies(told):
        times = {"solve": "seconds to solve", "reduce": "seconds to reduce", "both": "seconds to reduce and solve once"}
        errors = {key: label for key, label in ERRORS.items() if key in rows[0] and
                  any(isinstance(row.get(key), float) and row["method"] != "full" for row in rows)}
        if not errors:
            continue
        traces = []
        reduced = [row for row in rows if row["method"] != "full"]
        for method in dict.fromkeys(row["method"] for row in reduced):
            own = [row for row in reduced if row["method"] == method]
            seconds = [_seconds(row) for row in own]
            columns: dict[str, list[Any]] = {"solve": [b for _, b in seconds], "reduce": [a for a, _ in seconds],
                                             "both": [a + b for a, b in seconds]}
            columns |= {key: [_floored(row.get(key)) for row in own] for key in errors}
            text = [_told(told, _label(method, row["size"], row["modes"]), **{
                        label: row.get(key) for key, label in errors.items()}, **{
                        "s to reduce": a, "s to solve": b, "missing": row["missing"], "extra": row["extra"],
                        "missed": row["missed"], "invented": row["invented"]})
                    for row, (a, b) in zip(own, seconds, strict=True)]
            traces.append(_trace(method, _label(method), columns["solve"], columns[next(iter(errors))], text, "lines+markers",
                                 columns=columns))
        full = next((row["solution_median_s"] for row in rows if row["method"] == "full"), None)
        yield _plot(f"Error against run time{f', {about}' if about else ''}",
                    f"Below and to the left is better. Errors of zero are drawn at {FLOOR:g}.",
                    traces, times["solve"], next(iter(errors.values())), told, logs="xy", choices={"x": times, "y": errors},
                    lines=[_line(full, f"full model: {seconds_words(full)}", ["solve", "both"])] if full else [])


def _seconds(row: Data) -> tuple[float, float]:
    """To reduce, and to solve."""
    return row["reduction_median_s"], row["solution_median_s"]


def _floored(value: Any) -> float | None:
    return max(float(value), FLOOR) if isinstance(value, (int, float)) else None


def _critical_slopes(told: Data) -> Iterator[dict[str, Any]]:
    """Critical slopes over the belt's place, or over the size of the reduced models."""
    found = told.get("critical-slope")
    over_belts = isinstance(found, dict)
    rows: Sequence[Data] = found["rows"] if isinstance(found, dict) else found or []
    if not rows:
        return
    choices = {"y": {"slope": "critical slope dμ/dv  [time/length]", "error": "relative error"}}
    note = "A slope below the border destabilises. Where a point is missing, the band reaches above the model's cut-off."
    if not over_belts:
        reduced = [row for row in rows if row["model"] != "full"]
        full = rows[0]
        traces = [_sloped(told, model, _label(model), own, [row["size"] for row in own])
                  for model in dict.fromkeys(row["model"] for row in reduced)
                  if (own := sorted((row for row in reduced if row["model"] == model), key=lambda row: row["size"]))]
        ends = [min((row["size"] for row in reduced), default=0), max((row["size"] for row in reduced), default=1)]
        if isinstance(full["slope"], float):
            traces.append(_trace("full", f"full, {full['size']} DOF", ends, [full["slope"]] * 2, [
                _told(told, "full model", slope=full["slope"], **{"ω": full["omega"]})] * 2, "lines", dash="dash",
                columns={"slope": [full["slope"]] * 2, "error": [None] * 2}))
        yield _plot("Critical slope over the model's size", note, traces, "DOF of the reduced model", choices["y"]["slope"], told,
                    choices=choices)
        return
    given = f"{{{', '.join(f'm{mass}' for mass in told['interface'])}}}"  # the interface without the belt's mass
    traces = []
    for method in dict.fromkeys(row["method"] for row in rows):
        for widened in (False, True):
            own = [row for row in rows if row["method"] == method and (row["interface"] != given) == widened]
            name = _label(method, own[0]["size"] if own else None) + (", belt in the interface" if widened else "")
            if own:
                traces.append(_sloped(told, method, name, own, [row["belt"] for row in own], dash="dot" if widened else "solid"))
    exact = {row["belt"]: row["full"] for row in rows}
    traces.append(_trace("full", "full model", list(exact), list(exact.values()), [
        _told(told, "full model", belt=f"m{belt}", slope=slope) for belt, slope in exact.items()], "lines+markers",
        columns={"slope": list(exact.values()), "error": [None] * len(exact)}))
    yield _plot("Critical slope over the belt's place", note, traces, "belt under mass number", choices["y"]["slope"], told,
                choices=choices)


def _sloped(told: Data, model: str, name: str, rows: Sequence[Data], x: Sequence[Any], **more: Any) -> Trace:
    text = [_told(told, name, interface=row.get("interface"), belt=f"m{row['belt']}" if "belt" in row else None,
                  critical_slope=row["slope"], relative_error=row["error"], **{"ω": row.get("omega"),
                  "static port error": row.get("port_error"), "why": row.get("reason")}) for row in rows]
    columns = {"slope": [row["slope"] for row in rows], "error": [_floored(row["error"]) for row in rows]}
    return _trace(model, name, x, columns["slope"], text, "lines+markers", columns=columns, **more)


def _size_sweep(told: Data) -> Iterator[dict[str, Any]]:
    if "size-sweep" not in told:
        return
    rows = told["size-sweep"]["rows"]
    traces = []
    for method, place in dict.fromkeys((row["method"], row["interface"]) for row in rows):
        own = [row for row in rows if (row["method"], row["interface"]) == (method, place)]
        dash = {} if place == rows[0]["interface"] else {"dash": "dot"}
        traces.append(_sloped(told, method, f"{_label(method)}, interface {place}", own, [row["size"] for row in own], **dash))
    labels = {"error": "relative error of the critical slope", "slope": "critical slope dμ/dv  [time/length]"}
    for trace in traces:
        trace["y"] = trace["columns"]["error"]
    yield _plot("Critical slope over the model's size", f"Errors of zero are drawn at {FLOOR:g}.", traces,
                "DOF of the reduced model", labels["error"], told, choices={"y": labels})


def _flutter(told: Data) -> Iterator[dict[str, Any]]:
    """Growth rates and frequencies over a parameter."""
    found = told.get("flutter")
    rows: Sequence[Data] = found["rows"] if isinstance(found, dict) else told.get("branches", [])
    if not rows or "growth" not in rows[0]:
        return
    parameter = "mu" if "mu" in rows[0] else list(rows[0])[1]
    critical = found["critical"] if isinstance(found, dict) else {}
    at = [critical["full"]["mu"] or critical["reduced"]["mu"]] if critical else \
        [row["value"] for row in told.get("critical-value", [])]
    lines: list[Data] = []
    apart = 0.1 * (max(row[parameter] for row in rows) - min(row[parameter] for row in rows))
    for value in dict.fromkeys(value for value in at if isinstance(value, float)):  # texts have no room side by side
        crowded = any(abs(value - other["at"]) < apart for other in lines)
        lines.append(_line(value, "" if crowded else f"{value:.4g}"))
    names = list(dict.fromkeys(row["model"] for row in rows))
    shades = dict(zip((name for name in names if name != "full"), ("#0067a5", "#c44e00", "#1b7837", "#6a3d9a"), strict=False))
    for key, title, label in (("growth", "Growth rates", "Re λ  [1/time]"), ("omega", "Frequencies", "Im λ  [rad/time]")):
        traces = []
        for name in names:
            own = [row for row in rows if row["model"] == name]
            text = [_told(told, name, **{parameter: row[parameter], "Re λ": row["growth"], "ω": row["omega"],
                                         "error bar": row.get("error_bar")}) for row in own]
            full = name == "full"
            traces.append(_trace(name, name, [row[parameter] for row in own], [row[key] for row in own], text,
                                 size=10 if full else 4) | ({} if full else {"colour": shades.get(name, "#7a7a7a"),
                                                                             "symbol": "circle"}))
        yield _plot(f"{title} over {parameter}", "Dashed: where stability is lost. A mode with Re λ above 0 grows.", traces,
                    parameter, label, told, lines=lines)


def _branch_plots(told: Data) -> Iterator[dict[str, Any]]:
    """Branches of limit cycles: amplitude, frequency or sticking over the parameter, a plot for each family."""
    found = [item for item in told.get("branches", []) if "points" in item]
    columns = {"rms": "rms of v at the belt  [length/time]", "omega": "ω  [rad/time]",
               "peak": "peak of v at the belt  [length/time]", "sticking": "share of the period in which it sticks"}
    parameter = str(told.get("parameter", ""))
    now = [_line(told[parameter], "this run")] if isinstance(told.get(parameter), float) else []
    families = list(dict.fromkeys(item["family"] for item in found))
    for family in families:
        traces: list[Trace] = []
        named: set[str] = set()  # each model stands once in the legend
        for item in (item for item in found if item["family"] == family):
            points = item["points"]
            for stable, dash in ((True, "solid"), (False, "dash"), (None, "dot")):
                if any(point["is_stable"] is stable for point in points):
                    traces.append(_branch(told, item, parameter, stable, columns, dash=dash, quiet=item["model"] in named))
                    named.add(item["model"])
            for special in item["special"]:
                traces.append(_marked(told, item, special["kind"], special["value"], special, columns,
                                      KINDS.get(special["kind"], "cross")))
            if item["hopf"]:
                hopf = item["hopf"]
                kind = "Hopf point, " + ("supercritical" if hopf["supercritical"] else "subcritical")
                traces.append(_marked(told, item, kind, hopf["value"], hopf | {"rms": 0.0}, columns, "star"))
        for dot in told.get("transients", []):
            if isinstance(dot["omega"], float) and min(families, key=lambda one: abs(one - dot["omega"])) == family:
                traces.append(_marked(told, dot, "transient", dot["value"], dot, columns, "circle-open"))
        yield _plot(f"Limit cycles from the mode at ω = {family:.4g} rad/time", BRANCHES, traces, OVER.get(parameter, parameter),
                    columns["rms"], told, choices={"y": columns}, lines=now)


def _branch(told: Data, item: Data, parameter: str, stable: bool | None, columns: Mapping[str, str], **more: Any) -> Trace:
    """The points of one branch that are stable, or not; the others are gaps."""
    points = item["points"]
    # a piece reaches to the next point, so that the line has no gaps
    shown = [point["is_stable"] is stable or (i > 0 and points[i - 1]["is_stable"] is stable) for i, point in enumerate(points)]
    values = {key: [point[key] if keep else None for point, keep in zip(points, shown, strict=True)] for key in columns}
    name, verdicts = _label(item["model"]), {True: "yes", False: "no"}
    text = [_told(told, name, **{parameter: point[parameter], "ω": point["omega"], "stable": verdicts.get(point["is_stable"])},
                  **{key: point[key] for key in ("rms", "peak", "sticking", "harmonics")}) for point in points]
    return _trace(item["model"], name, [point[parameter] for point in points], values["rms"], text, "lines+markers", size=4,
                  columns=values, **more)


def _marked(told: Data, item: Data, kind: str, x: float, values: Data, columns: Mapping[str, str], symbol: str) -> Trace:
    text = [_told(told, f"{_label(item['model'])}: {kind}", value=x, rms=values.get("rms"), **{"ω": values.get("omega")})]
    here = {key: [values.get(key)] for key in columns}
    return _trace(item["model"], kind, [x], here["rms"], text, size=11, columns=here, quiet=True) | {"symbol": symbol}


def _spectra(told: Data) -> Iterator[dict[str, Any]]:
    rows = told.get("spectrum", [])
    if not rows:
        return
    traces = []
    for model in dict.fromkeys(row["model"] for row in rows):
        own = [row for row in rows if row["model"] == model]
        name = _label(model, own[0]["size"])
        text = [_told(told, name, amplitude=row["amplitude"], **{"ω": row["omega"]}) for row in own]
        traces.append(_trace(model, name, [row["omega"] for row in own], [row["amplitude"] for row in own], text, size=9))
    yield _plot("Peaks of the spectra", "The strongest frequencies in the window, model by model.", traces, "ω  [rad/time]",
                "amplitude  [length/time]", told, logs="y")


def _springs(told: Data) -> Iterator[dict[str, Any]]:
    rows = told.get("joined-interface", [])
    if not rows:
        return
    traces = []
    kept = list(dict.fromkeys(row["modes"] for row in rows))
    for model, modes in dict.fromkeys((row["model"], row["modes"]) for row in rows):
        own = [row for row in rows if (row["model"], row["modes"]) == (model, modes)]
        name = _label(model, None, modes)
        text = [_told(told, name, springs=row["springs"], error=row["error"]) for row in own]
        traces.append(_trace(model, name, [row["springs"] for row in own], [_floored(row["error"]) for row in own], text,
                             "lines+markers", dash=DASHES[kept.index(modes) % len(DASHES)]))
    yield _plot("Error with the interface on springs", "Soft springs leave the interface nearly free, stiff ones nearly fixed.",
                traces, "stiffness of the springs, over that of the interface", "largest relative error of a frequency", told,
                logs="xy")


def _friction(told: Data) -> Iterator[dict[str, Any]]:
    if "friction" not in told:
        return
    found = told["friction"]
    traces = []
    for curve in found["curves"]:
        name = f"{curve['law']}, ε = {curve['eps']:g}"
        text = [_told(told, name, v=v, **{"μ": mu}) for v, mu in zip(found["speed"], curve["value"], strict=True)]
        shown = curve["eps"] == told.get("eps")
        colour = "#0067a5" if curve["law"] == told.get("law") else "#c44e00"
        traces.append({"name": name, "x": found["speed"], "y": curve["value"], "text": text, "mode": "lines", "symbol": "circle",
                       "colour": colour, "dash": "solid" if shown else "dot"})
    yield _plot("Friction laws", "Solid: the width ε of this run.", traces, "sliding speed v  [length/time]",
                "friction coefficient μ", told)
