"""Figures of models in time: signals, spectra, spectrograms side by side, error against the time per period."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from femsub.app.figure_style import PAGE, label_points, legend_below, look, new_figure
from femsub.checks import Array

DECADES = 3  # of the spectrograms' scale
PERIODS = 10  # of the highest peak, at the end of a signal
COLUMNS = 600  # of pixels across an envelope
FLOOR = 1e-8  # errors below are drawn there: amplitudes are not known better


def _name(item: Any) -> str:
    return f"{look(item.kind).label}, {item.model.size} DOF"


def signals_figure(tracks: Sequence[Any]) -> Any:
    """For each model the envelope of the whole run, and its last periods beside the belt's speed."""
    shown = [item for item in tracks if len(item.run.t) > 1]
    figure = new_figure(PAGE, 0.9 + 1.5 * len(shown))
    axes = figure.subplots(len(shown), 2, squeeze=False, sharey=True, width_ratios=[2, 1])
    for (left, right), item in zip(axes, shown, strict=True):
        run, colour = item.run, look(item.kind).colour
        v, speed = run.velocity("belt"), run.contact.belts[0].speed
        known = item.spectrum is not None and len(item.spectrum.peaks)
        period = 2 * np.pi / item.spectrum.peaks[0] if known else np.ptp(run.t) / 20
        if np.ptp(run.t) > 4 * PERIODS * period:
            t, low, high = envelope(run.t, v)
            left.fill_between(t, low, high, color=colour, alpha=0.25, lw=0)
            for edge in (low, high):
                left.plot(t, edge, color=colour, lw=0.8)
        else:  # few enough to be told apart
            left.plot(run.t, v, color=colour, lw=0.8)
        late = run.t > run.t[-1] - PERIODS * period
        right.plot(run.t[late], v[late], color=colour, lw=0.7)
        for axis in (left, right):
            axis.axhline(speed, color="black", lw=0.8, ls="--", label="speed of the belt")
            axis.grid()
            axis.margins(x=0.02)
        left.set_ylabel("velocity v\n[length/time]")
        left.set_title(f"{_name(item)}{'' if run.complete else ' (interrupted)'}")
        right.set_title(f"last {PERIODS} periods")
    for axis in axes[-1]:
        axis.set_xlabel("t  [time]")
    for axis in axes.ravel():
        axis.locator_params(axis="x", nbins=4)
    legend_below(figure, axes[0, :1])
    figure.suptitle("Velocity under the belt: the least and the largest value over time, and the last periods")
    return figure


def envelope(t: Array, v: Array) -> tuple[Array, Array, Array]:
    """The smallest and the largest value of a signal in each of COLUMNS stretches of equal length; all of it if it is short."""
    column = np.minimum(((t - t[0]) / (t[-1] - t[0]) * COLUMNS).astype(int), COLUMNS - 1)
    starts = np.flatnonzero(np.diff(column, prepend=-1))
    return t[starts], np.minimum.reduceat(v, starts), np.maximum.reduceat(v, starts)


def spectra_figure(tracks: Sequence[Any], highest: float) -> Any:
    """Amplitudes over ω in the window, one below the other, the peaks marked."""
    figure = new_figure(PAGE, 0.8 + 1.6 * len(tracks))
    axes = figure.subplots(len(tracks), 1, squeeze=False, sharex=True, sharey=True)[:, 0]
    top = max(float(item.spectrum.amplitude.max()) for item in tracks)
    for axis, item in zip(axes, tracks, strict=True):
        found = item.spectrum
        inside = found.omega <= highest
        axis.semilogy(found.omega[inside], found.amplitude[inside], color=look(item.kind).colour, lw=0.8)
        for at, height in list(zip(found.peaks, found.heights, strict=True))[:4]:
            if at <= highest:
                axis.annotate(f"{at:.4g}", (at, height), (0, 4), textcoords="offset points", ha="center", fontsize=8)
        axis.set(ylim=(top * 1e-4, top * 5), xlim=(0, highest), ylabel="amplitude\n[length/time]")
        axis.set_title(f"{_name(item)}: t = {item.window[0]:g} to {item.window[1]:g}")
        axis.grid()
    axes[-1].set_xlabel("ω  [rad/time]")
    return figure


def spectrogram_figure(made: Sequence[tuple[Any, Any]], highest: float) -> Any:
    """Short-time spectra side by side, on one scale (the paper's Fig. 5)."""
    from matplotlib.colors import LogNorm

    figure = new_figure(PAGE, 3.6)
    axes = figure.subplots(1, len(made), squeeze=False, sharey=True)[0]
    top = max(float(found.amplitude.max()) for _, found in made)
    scale = LogNorm(top / 10**DECADES, top)
    for axis, (item, found) in zip(axes, made, strict=True):
        inside = found.omega <= highest
        values = np.maximum(found.amplitude[inside], top / 10**DECADES)
        picture = axis.pcolormesh(found.t, found.omega[inside], values, norm=scale, shading="nearest", cmap="magma",
                                  rasterized=True)
        axis.set(title=_name(item), xlabel="t  [time]", ylim=(0, highest))
        axis.locator_params(axis="x", nbins=4)
    axes[0].set_ylabel("ω  [rad/time]")
    figure.colorbar(picture, ax=list(axes), label="amplitude of v under the belt\n[length/time]")
    return figure


def period_figure(rows: Sequence[Mapping[str, Any]]) -> Any:
    """Error of the amplitude over the wall time of a simulated period; the full model is the dashed line."""
    figure = new_figure(PAGE, 4.2)
    axis = figure.subplots()
    full = next(row for row in rows if row["model"] == "full")
    labels = []
    for kind in dict.fromkeys(row["model"] for row in rows if row["model"] != "full"):
        seen = look(kind)
        points = [(row["seconds_per_period"], max(row["amplitude_error"], FLOOR), str(row["size"])) for row in rows
                  if row["model"] == kind]
        axis.plot([x for x, _, _ in points], [y for _, y, _ in points], color=seen.colour, marker=seen.marker, lw=0.8,
                  label=seen.label)
        labels += [(axis, *point, seen.colour) for point in points]
    axis.axvline(full["seconds_per_period"], color="black", ls="--", lw=1, label=f"full model, {full['size']} DOF")
    axis.axhline(0.01, color="grey", lw=0.8, ls=":", label="1 %")
    axis.set(xscale="log", yscale="log", xlabel="run time of a simulated period  [s]",
             ylabel="relative error of the rms velocity  [-]", title="Error against run time in the limit cycle; numbers: DOF")
    axis.margins(0.08)
    axis.grid()
    legend_below(figure, [axis])
    label_points(figure, labels)
    return figure
