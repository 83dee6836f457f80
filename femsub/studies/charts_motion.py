"""Charts of motion: signals, spectra and errors of models in time, and bifurcation diagrams of limit cycles over a parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from femsub.checks import Array
from femsub.studies.charts import Chart, Heat, Level, Panel, Series, hover_of, look
from femsub.studies.tables import grouped

WIDTHS = (2.0, 1.0, 1.3)  # of reduced models, in turn: where lines lie on each other, each is seen
KINDS = {"fold": "D", "period doubling": "s", "Neimark-Sacker": "^", "branch point": "v"}
UNITS = {"slope": "slope μ'(v0)  [time/length]", "speed": "belt speed v0  [length/time]", "force": "normal force F  [force]"}
SHOWN = {"rms": "rms of v  [length/time]", "omega": "ω  [rad/time]", "peak": "peak of v  [length/time]",
         "sticking": "share of the period in which it sticks  [-]"}  # the first two in the figure
HOVER = {"ω [rad/time]": "omega", "rms": "rms", "peak": "peak", "sticking": "sticking", "harmonics": "harmonics"}
LINES = {True: ("", "solid", None), False: (", unstable", "dash", 0.8), None: (" (stability not computed)", "", None)}
NOTE = ("v is the speed under the belt. Dashed: unstable. Star: where the branch begins. Open circle: where a transient ended. "
        "Dotted: the value of the scene.")


def _name(item: Any) -> str:
    return f"{look(item.kind).label}, {item.model.size} DOF"


def signals_chart(tracks: Sequence[Any], periods: int = 10) -> Chart:
    """For each model the envelope of the whole run, and its last periods, those of the highest peak, beside the belt's speed."""
    panels = []
    for item in tracks:
        run = item.run
        if len(run.t) < 2:
            continue
        v = item.v
        known = item.spectrum is not None and len(item.spectrum.peaks)
        period = 2 * np.pi / item.spectrum.peaks[0] if known else np.ptp(run.t) / 20
        t, whole = run.t, v
        if np.ptp(t) > 4 * periods * period:  # too many to be distinguished
            t, *ends = envelope(t, v)
            t, whole = np.repeat(t, 2), np.stack(ends, axis=1).ravel()
        late = run.t > run.t[-1] - periods * period
        about = f"{_name(item)}{'' if run.complete else ' (interrupted)'}"
        for x, y, title in ((t, whole, about), (run.t[late], v[late], f"last {periods} periods")):
            panels.append(Panel([Series(_name(item), x, y, item.kind, "solid", "", width=0.7, legend=False)], "t  [time]",
                                "velocity v  [length/time]", title, levels=[] if item.speed is None
                                else [Level(item.speed, "speed of the belt", "y")],
                                share={"y": "v"}, among=about))
    return Chart("motion-signals", "Velocity at the contact", panels, 2, note="Dashed: the speed of the belt.", height=1.7,
                 about="the least and the largest value over time, and the last periods")


def envelope(t: Array, v: Array, stretches: int = 600) -> tuple[Array, Array, Array]:
    """The smallest and the largest value of a signal in each of so many stretches of equal length; all of it if it is short.

    By default there are as many as a panel has pixels across.
    """
    column = np.minimum(((t - t[0]) / (t[-1] - t[0]) * stretches).astype(int), stretches - 1)
    starts = np.flatnonzero(np.diff(column, prepend=-1))
    return t[starts], np.minimum.reduceat(v, starts), np.maximum.reduceat(v, starts)


def spectra_chart(tracks: Sequence[Any], highest: float, labelled: int = 4) -> Chart:
    """Amplitudes over ω in the window, one below the other, the peaks marked; the highest have their ω beside them."""
    top = max(float(item.spectrum.amplitude.max()) for item in tracks)
    panels = []
    for item in tracks:
        found, name = item.spectrum, _name(item)
        inside = (found.omega <= highest) & (found.omega > 0)
        omega, _, height = envelope(found.omega[inside], found.amplitude[inside])
        shown = found.peaks <= highest
        peaks, heights = np.asarray(found.peaks)[shown], np.asarray(found.heights)[shown]
        panels.append(Panel(
            [Series(name, omega, height, item.kind, "solid", "", width=0.8, legend=False),
             Series(name, peaks, heights, item.kind, size=3.0, legend=False, labels=[f"{at:.4g}" for at in peaks[:labelled]],
                    hover={"ω [rad/time]": peaks, "amplitude": heights})],
            "ω  [rad/time]", "amplitude  [length/time]", f"{name}: t = {item.window[0]:g} to {item.window[1]:g}", "y",
            limits={"x": (0, highest), "y": (top * 1e-4, top * 5)}, share={"x": "omega", "y": "amplitude"}))
    return Chart("motion-spectrum", "Spectra of the velocity under the belt", panels, note="Marks are the peaks.", height=1.7)


def spectrogram_chart(made: Sequence[tuple[Any, Any]], highest: float, decades: int = 3) -> Chart:
    """Short-time spectra side by side, on one scale of so many `decades` (the paper's Fig. 5)."""
    top, panels = max((float(found.amplitude.max()) for _, found in made), default=1.0), []
    for item, found in made:
        inside = found.omega <= highest
        heat = Heat(found.t, found.omega[inside], found.amplitude[inside], "amplitude of v under the belt\n[length/time]",
                    top / 10**decades, top)
        panels.append(Panel((), "t  [time]", "ω  [rad/time]", _name(item), limits={"y": (0, highest)}, share={"y": "omega"},
                            where="figure", heat=heat))
    return Chart("motion-spectrogram", "Spectra over time of the velocity v under the belt", panels, len(panels), height=2.6)


def period_chart(rows: Sequence[Mapping[str, Any]], floor: float = 1e-8) -> Chart:
    """Error of the amplitude over the wall time of a simulated period; the full model is the dashed line.

    Amplitudes are known to `floor` at best: errors below are drawn there.
    """
    models, series = grouped(rows, "model"), []
    full = models.pop("full")[0]
    for kind, own in models.items():
        hover = hover_of(own, {"DOF": "size", "error": "amplitude_error", "s per period": "seconds_per_period", "steps": "steps"})
        series.append(Series(look(kind).label, hover["s per period"], [max(error, floor) for error in hover["error"]], kind,
                             "solid", width=0.8, labels=[str(size) for size in hover["DOF"]], hover=hover))
    levels = [Level(full["seconds_per_period"], f"full model, {full['size']} DOF"), Level(0.01, "1 %", "y", "dot", "#808080")]
    return Chart("compare-motion", "Error against run time in the limit cycle; numbers: DOF", [Panel(
        series, "run time of a simulated period  [s]", "relative error of the rms velocity  [-]", logs="xy", levels=levels)],
        note="Below and to the left is better. Dashed: the full model.", height=3.2)


def bifurcation_chart(branches: Sequence[Mapping[str, Any]], dots: Sequence[Mapping[str, Any]], parameter: str,
                      families: Sequence[float], now: float, title: str) -> Chart:
    """One column per family of cycles: rms of the speed under the belt above, ω below; a page has peak and sticking as well.

    Open circles are transients, drawn where their strongest frequency belongs.
    """
    shown = [family for family in families if any(item["family"] == family for item in branches)] or list(families[:1])
    reduced = [name for name in dict.fromkeys(item["model"] for item in branches) if name != "full"]
    widths = {"full": 3.2} | {name: WIDTHS[i % len(WIDTHS)] for i, name in enumerate(reduced)}
    # of each transient, the family whose frequencies its strongest one is nearest to, within 5 %
    known = [np.concatenate([[family], *(item["branch"].omega for item in branches if item["family"] == family)])
             for family in shown]
    homes: list[float | None] = []
    for dot in dots:
        gaps = [float(np.abs(omega / dot["omega"] - 1).min()) for omega in known]
        best = int(np.argmin(gaps)) if gaps and np.isfinite(dot["omega"]) else -1
        homes.append(shown[best] if best >= 0 and gaps[best] < 0.05 else None)
    # panels
    across = min(len(shown), 2)  # families side by side, as wide as a page has room for
    panels = []
    for start in range(0, len(shown), across):
        for key, label in SHOWN.items():
            for family in shown[start:start + across]:
                own = [item for item in branches if item["family"] == family]
                own.sort(key=lambda item: item["model"] != "full")  # the wide line of the full model lies below
                series = [one for item in own for one in _branch(item["model"], item["branch"], parameter, key,
                                                                 widths[item["model"]])]
                series += [Series("transient", [dot["value"]], [dot[key]], dot["model"], marker="o", size=6.0, hollow=True)
                           for dot, home in zip(dots, homes, strict=True) if home == family and key in dot]
                panels.append(Panel(
                    series, UNITS[parameter], label, f"from the mode at ω = {family:.4g} rad/time" if key != "omega" else "",
                    levels=[Level(now, "value of the scene", line="dot", colour="#999999")], share={"x": f"{family}"},
                    among=f"from the mode at ω = {family:.4g} rad/time", where="" if key in ("rms", "omega") else "page"))
    return Chart("branch", f"{title}: limit cycles over the {parameter}, v under the belt", panels, across, note=NOTE,
                 width=1.0 if across > 1 else 0.7, height=2.3, columns=3 if across == 1 else 4)


def _branch(model: str, branch: Any, parameter: str, key: str, width: float) -> list[Series]:
    """Pieces that are stable, or not, each to the next point, so that the line has no gaps; its begin, and special points."""
    rows, name = branch.rows(), look(model).label
    x, y = np.asarray(branch.values, dtype=float), np.array([row[key] for row in rows], dtype=float)
    hover = {parameter: x, **hover_of(rows, HOVER)}
    flags = [None if flag is None and all(one is None for one in branch.stable) else flag is not False for flag in branch.stable]
    series = []
    for flag, (word, line, thin) in LINES.items():
        own = np.array([one is flag for one in flags])
        if own.any():
            keep = own | np.append(False, own[:-1]) if line else own
            series.append(Series(f"{name}{word}", x, np.where(keep, y, np.nan), model, line, "" if line else "x",
                                 size=7.0 if not line else 4.0, width=thin or width, hover=hover))
    if branch.hopf is not None:
        kind = "supercritical" if branch.hopf.supercritical else "subcritical"
        series.append(Series("Hopf point", x[:1], y[:1], model, marker="*", size=8.0,
                             hover={"model": [name], "kind": [kind], parameter: x[:1]}))
    for point in branch.special:
        if key in ("rms", "omega"):
            series.append(Series(point.kind, [point.value], [getattr(point, key)], model, marker=KINDS[point.kind], size=4.5,
                                 hover={"model": [name], parameter: [point.value]}))
    return series
