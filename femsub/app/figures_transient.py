"""Figures of models in time: signals, spectra, spectrograms side by side, error against the time per period."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from femsub.app.figure_style import look, new_figure

DECADES = 3  # of the spectrograms' scale
PERIODS = 10  # of the highest peak, at the end of a signal
THINNED = 4000  # points of an envelope


def _name(item: Any) -> str:
    return f"{look(item.kind).label}, {item.model.size} DOF"


def signals_figure(tracks: Sequence[Any]) -> Any:
    """For each model the envelope of the whole run, and its last periods beside the belt's speed."""
    shown = [item for item in tracks if len(item.run.t) > 1]
    figure = new_figure(10, 1 + 1.9 * len(shown))
    axes = figure.subplots(len(shown), 2, squeeze=False, sharey=True, width_ratios=[2, 1])
    for (left, right), item in zip(axes, shown, strict=True):
        run, colour = item.run, look(item.kind).colour
        v, speed = run.velocity("belt"), run.contact.belts[0].speed
        block = max(1, len(v) // (THINNED // 2))
        parts = v[:len(v) // block * block].reshape(-1, block)
        left.fill_between(run.t[:len(parts) * block:block], parts.min(axis=1), parts.max(axis=1), color=colour, lw=0.5)
        known = item.spectrum is not None and len(item.spectrum.peaks)
        period = 2 * np.pi / item.spectrum.peaks[0] if known else np.ptp(run.t) / 20
        late = run.t > run.t[-1] - PERIODS * period
        right.plot(run.t[late], v[late], color=colour, lw=0.9)
        for axis in (left, right):
            axis.axhline(speed, color="grey", lw=0.8, ls="--")
            axis.grid()
        left.set_ylabel("velocity  [length/time]")
        left.set_title(f"{_name(item)}{'' if run.complete else ' (interrupted)'}")
        right.set_title(f"its last {PERIODS} periods; dashed: the belt")
    for axis in axes[-1]:
        axis.set_xlabel("t  [time]")
        axis.locator_params(axis="x", nbins=4)
    return figure


def spectra_figure(tracks: Sequence[Any], highest: float) -> Any:
    """Amplitudes over ω in the window, one below the other, the peaks marked."""
    figure = new_figure(9.5, 1 + 1.9 * len(tracks))
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

    figure = new_figure(1.5 + 3.6 * len(made), 4.2)
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
    figure.colorbar(picture, ax=list(axes), label="velocity under the belt  [length/time]")
    return figure


def period_figure(rows: Sequence[Mapping[str, Any]]) -> Any:
    """Error of the amplitude over the wall time of a simulated period; the full model is the dashed line."""
    figure = new_figure(7.5, 4.5)
    axis = figure.subplots()
    full = next(row for row in rows if row["model"] == "full")
    for side, kind in enumerate(dict.fromkeys(row["model"] for row in rows if row["model"] != "full")):
        points, seen = [row for row in rows if row["model"] == kind], look(kind)
        axis.plot([row["seconds_per_period"] for row in points], [max(row["amplitude_error"], 1e-8) for row in points],
                  color=seen.colour, marker=seen.marker, ls="", label=seen.label)
        for row in points:
            axis.annotate(str(row["size"]), (row["seconds_per_period"], max(row["amplitude_error"], 1e-8)), (6, 4 - 13 * side),
                          textcoords="offset points", fontsize=8, color=seen.colour)
    axis.axvline(full["seconds_per_period"], color="black", ls="--", lw=1, label=f"full, {full['size']} DOF")
    axis.axhline(0.01, color="grey", lw=0.8, ls=":", label="1 %")
    axis.set(xscale="log", yscale="log", xlabel="wall time per simulated period  [s]",
             ylabel="relative error of the rms velocity  [-]", title="Numbers: DOF of the reduced models")
    axis.grid(which="both")
    axis.legend()
    return figure
