"""Charts of models in time: signals, spectra, error against the time per period."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from femsub.checks import Array
from femsub.studies.charts import Chart, Level, Panel, Series, look

PERIODS = 10  # of the highest peak, at the end of a signal
COLUMNS = 600  # of pixels across an envelope
FLOOR = 1e-8  # errors below are drawn there: amplitudes are not known better
PEAKS = 4  # that have their ω beside them


def _name(item: Any) -> str:
    return f"{look(item.kind).label}, {item.model.size} DOF"


def signals_chart(tracks: Sequence[Any]) -> Chart:
    """For each model the envelope of the whole run, and its last periods beside the belt's speed."""
    panels = []
    for item in tracks:
        run = item.run
        if len(run.t) < 2:
            continue
        v, speed = run.velocity("belt"), run.contact.belts[0].speed
        known = item.spectrum is not None and len(item.spectrum.peaks)
        period = 2 * np.pi / item.spectrum.peaks[0] if known else np.ptp(run.t) / 20
        t, low, high = envelope(run.t, v) if np.ptp(run.t) > 4 * PERIODS * period else (run.t, v, v)
        if low is not v:
            t, v_all = np.repeat(t, 2), np.stack([low, high], axis=1).ravel()
        else:  # few enough to be told apart
            v_all = v
        late = run.t > run.t[-1] - PERIODS * period
        about = f"{_name(item)}{'' if run.complete else ' (interrupted)'}"
        for x, y, title in ((t, v_all, about), (run.t[late], v[late], f"last {PERIODS} periods")):
            panels.append(Panel([Series(_name(item), x, y, item.kind, "solid", "", width=0.7, legend=False)], "t  [time]",
                                "velocity v  [length/time]", title, levels=[Level(speed, "speed of the belt", "y")],
                                share={"y": "v"}, among=about))
    return Chart("signals", "Velocity under the belt", panels, 2, note="Dashed: the speed of the belt.", height=1.7,
                 about="the least and the largest value over time, and the last periods")


def envelope(t: Array, v: Array) -> tuple[Array, Array, Array]:
    """The smallest and the largest value of a signal in each of COLUMNS stretches of equal length; all of it if it is short."""
    column = np.minimum(((t - t[0]) / (t[-1] - t[0]) * COLUMNS).astype(int), COLUMNS - 1)
    starts = np.flatnonzero(np.diff(column, prepend=-1))
    return t[starts], np.minimum.reduceat(v, starts), np.maximum.reduceat(v, starts)


def spectra_chart(tracks: Sequence[Any], highest: float) -> Chart:
    """Amplitudes over ω in the window, one below the other, the peaks marked."""
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
             Series(name, peaks, heights, item.kind, size=3.0, legend=False, labels=[f"{at:.4g}" for at in peaks[:PEAKS]],
                    told={"ω [rad/time]": peaks, "amplitude": heights})],
            "ω  [rad/time]", "amplitude  [length/time]", f"{name}: t = {item.window[0]:g} to {item.window[1]:g}", "y",
            limits={"x": (0, highest), "y": (top * 1e-4, top * 5)}, share={"x": "omega", "y": "amplitude"}))
    return Chart("spectrum", "Spectra of the velocity under the belt", panels, note="Marks are the peaks.", height=1.7)


def period_chart(rows: Sequence[Mapping[str, Any]]) -> Chart:
    """Error of the amplitude over the wall time of a simulated period; the full model is the dashed line."""
    full = next(row for row in rows if row["model"] == "full")
    series = []
    for kind in dict.fromkeys(row["model"] for row in rows if row["model"] != "full"):
        own = [row for row in rows if row["model"] == kind]
        told = {word: [row[key] for row in own] for word, key in (
            ("DOF", "size"), ("error", "amplitude_error"), ("s per period", "seconds_per_period"), ("steps", "steps"))}
        series.append(Series(look(kind).label, told["s per period"], [max(error, FLOOR) for error in told["error"]], kind,
                             "solid", width=0.8, labels=[str(size) for size in told["DOF"]], told=told))
    levels = [Level(full["seconds_per_period"], f"full model, {full['size']} DOF"), Level(0.01, "1 %", "y", "dot", "#808080")]
    return Chart("error-time", "Error against run time in the limit cycle; numbers: DOF", [Panel(
        series, "run time of a simulated period  [s]", "relative error of the rms velocity  [-]", logs="xy", levels=levels)],
        note="Below and to the left is better. Dashed: the full model.", height=3.2)
