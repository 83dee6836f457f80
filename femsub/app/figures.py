"""Figures that are pictures of a field: growth over the slope and the belt's place, spectrograms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from femsub.app.figure_style import PAGE, legend_below, new_figure
from femsub.studies import look

DECADES = 3  # of the spectrograms' scale


def belt_sweep_figure(found: Mapping[str, Any]) -> Any:
    """max Re λ over the slope and the belt's place, with the border of stability (the paper's Fig. 3a)."""
    panels, belts, slopes = found["panels"], found["belts"], np.abs(found["slopes"])
    interfaces = list(dict.fromkeys(panel["interface"] for panel in panels))
    columns = len(panels) // len(interfaces)
    figure = new_figure(PAGE, 2.4 * len(interfaces) + 0.6)
    axes = figure.subplots(len(interfaces), columns, sharex=True, sharey=True, squeeze=False)
    top = max(float(np.max(panel["growth"])) for panel in panels)
    from matplotlib.colors import SymLogNorm

    norm = SymLogNorm(linthresh=1e-3 * top, vmin=-top, vmax=top)
    mesh = None
    for axis, panel in zip(axes.ravel(), panels, strict=True):
        growth = np.where(np.isfinite(panel["growth"]), panel["growth"], np.nan)
        mesh = axis.pcolormesh(belts, slopes, growth.T, norm=norm, cmap="RdBu_r", shading="nearest", rasterized=True)
        border = -np.array(panel["critical_slope"], dtype=float)
        axis.plot(belts, np.where(np.isfinite(border), border, np.nan), "k.-", lw=1, ms=5, label="critical slope")
        axis.set(yscale="log", title=f"{look(panel['model']).label}, {panel['interface']}")
        axis.set_xticks(belts)
    for axis in axes[-1]:
        axis.set_xlabel("belt under mass  [-]")
    for axis in axes[:, 0]:
        axis.set_ylabel("-dμ/dv  [time/length]")
    legend_below(figure, axes[0, :1])
    figure.suptitle("Growth and critical slope over the belt's place; in braces the interface")
    decades = 10.0 ** np.arange(np.ceil(np.log10(1e-2 * top)), np.log10(top))
    figure.colorbar(mesh, ax=axes, label="max Re λ  [1/time]", shrink=0.8, ticks=[*-decades[::-1], 0.0, *decades])
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
        axis.set(title=f"{look(item.kind).label}, {item.model.size} DOF", xlabel="t  [time]", ylim=(0, highest))
        axis.locator_params(axis="x", nbins=4)
    axes[0].set_ylabel("ω  [rad/time]")
    figure.colorbar(picture, ax=list(axes), label="amplitude of v under the belt\n[length/time]")
    return figure
