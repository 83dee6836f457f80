"""The figures of studies: the paper's, and interfaces on springs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from femsub.app.figure_style import PAGE, ROUNDING, legend_below, look, new_figure, rounding_below

CLUMP = 0.4  # of the range of the full model's eigenvalues: reduced ones that fill less are drawn enlarged as well
CROWD = 60  # eigenvalues of the full model from which on its circles are small


def friction_figure(speeds: Any, curves: Sequence[Mapping[str, Any]], titles: Mapping[str, str], speed: float,
                    slope: float) -> Any:
    """μ over the sliding speed for several ε, a panel for each law by its key (the paper's Fig. 2)."""
    figure = new_figure(PAGE, 3.8)
    axes = figure.subplots(1, len(titles), sharey=True)
    widths = sorted({curve["eps"] for curve in curves}, reverse=True)
    shades = dict(zip(widths, ("#9ecae1", "#4292c6", "#08519c", "#000000"), strict=False))
    for axis, (law, title) in zip(axes, titles.items(), strict=True):
        for curve in curves:
            if curve["law"] == law:
                axis.plot(speeds, curve["value"], color=shades[curve["eps"]], label=f"ε = {curve['eps']:g}")
        axis.axvline(speed, color="0.3", lw=0.8, ls="--", label=f"v0 = {speed:g}, μ' = {slope:.4f}")
        axis.set(title=title, xlabel="sliding speed v  [length/time]", xticks=[-1, -0.5, 0, 0.5, 1])
        axis.grid()
    axes[0].set_ylabel("friction coefficient μ  [-]")
    legend_below(figure, axes)
    return figure


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


def size_sweep_figure(curves: Sequence[Mapping[str, Any]], belt: int) -> Any:
    """Critical slope, and its relative error, over the size of the reduced model (the paper's Fig. 3b)."""
    interfaces = list(dict.fromkeys(curve["interface"] for curve in curves))
    figure = new_figure(PAGE if len(interfaces) > 1 else 0.65 * PAGE, 5.4)
    axes = figure.subplots(2, len(interfaces), sharex=True, sharey="row", squeeze=False)
    for column, interface in enumerate(interfaces):
        upper, lower = axes[:, column]
        mine = [curve for curve in curves if curve["interface"] == interface]
        for at, curve in enumerate(mine):
            seen = look(curve["method"])
            style = {"color": seen.colour, "marker": seen.marker, "label": seen.label, "ms": _nested(at), "zorder": 3}
            upper.plot(curve["sizes"], np.where(np.isfinite(curve["slope"]), curve["slope"], np.nan), **style)
            lower.plot(curve["sizes"], np.maximum(curve["error"], ROUNDING), **style)
            full = curve["full"]
        rounding_below(lower, [error for curve in curves for error in curve["error"]])
        upper.axhline(full, color="black", lw=1, ls="--", label=f"full model: {full:.6f}")
        upper.set(title=f"belt under m{belt}, interface {interface}")
        lower.set(xlabel="DOF of the reduced model  [-]")
        for axis in (upper, lower):
            axis.grid()
    axes[0, 0].set_ylabel("critical slope dμ/dv  [time/length]")
    axes[1, 0].set_ylabel("relative error  [-]")
    legend_below(figure, axes[:, 0])
    return figure


def _nested(at: int) -> float:
    """The size of a mark: those drawn later are smaller, so that marks that lie on each other are all seen."""
    return max(7.5 - 2 * at, 3.0)


def eigenvalue_figure(models: Sequence[Mapping[str, Any]], title: str) -> Any:
    """Eigenvalues in the complex plane (the paper's Fig. 4); hollow above the reduced model's cut-off.

    Where those of the reduced models would lie in one clump, a second row shows them enlarged.
    """
    panels = {name: [model for model in models if model["panel"] == name] for name in dict.fromkeys(
        model["panel"] for model in models)}
    frames = {name: frame for name, several in panels.items() if (frame := _clump(several)) is not None}
    figure = new_figure(PAGE if len(panels) > 1 else 0.7 * PAGE, 8.0 if frames else 4.6)
    axes = figure.subplots(2 if frames else 1, len(panels), squeeze=False)
    for axis in axes[0, 1:]:
        axis.sharex(axes[0, 0])
        axis.sharey(axes[0, 0])
        axis.tick_params(labelleft=False)
    for upper, (name, several) in zip(axes[0], panels.items(), strict=True):
        _spectra(upper, several)
        upper.set_title(f"{name} ({_sizes(several)})" if len(several) > 1 else name)
    for lower, upper, (name, several) in zip(axes[1], axes[0], panels.items(), strict=True) if frames else ():
        _spectra(lower, several, enlarged=True)
        lower.set_visible(name in frames)
        if name in frames:
            (left, right), (low, high) = frames[name]
            upper.axhspan(low, high, color="0.88", lw=0, zorder=0)
            lower.set(xlim=(left, right), ylim=(low, high), title="the grey part, enlarged")
    for axis in axes[-1] if len(frames) == len(panels) else axes.ravel():
        axis.set_xlabel("Re λ  [1/time]")
    for axis in axes[:, 0]:
        axis.set_ylabel("Im λ  [rad/time]")
    legend_below(figure, axes[0], 3)
    figure.suptitle(title)
    return figure


def _spectra(axis: Any, models: Sequence[Mapping[str, Any]], enlarged: bool = False) -> None:
    """The full model as large circles, the reduced ones within them."""
    axis.axvline(0, color="grey", lw=0.8, zorder=1)
    axis.grid()
    for at, model in enumerate(models):
        values, beyond = np.asarray(model["eigenvalues"]), np.asarray(model["above_cutoff"])
        full, (label, colour, marker) = model["model"] == "full", look(model["model"])
        size = (10 if len(values) <= CROWD or enlarged else 5) if full else _nested(at - 1)
        for chosen, fill, word in ((~beyond, "none" if full else colour, label), (beyond, "none", f"{label}, above its cut-off")):
            if chosen.any():
                axis.plot(values.real[chosen], values.imag[chosen], ls="none", color=colour, marker=marker, ms=size, mfc=fill,
                          mew=0.9, zorder=3, label=word)


def _clump(models: Sequence[Mapping[str, Any]]) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """The frame around the reduced models' eigenvalues below their cut-off, if they lie in a small part of the full model's."""
    reduced = [model for model in models if model["model"] != "full"]
    inside = [np.asarray(model["eigenvalues"])[~np.asarray(model["above_cutoff"])] for model in reduced]
    all_values = np.concatenate([np.asarray(model["eigenvalues"]) for model in models])
    values = np.concatenate([*inside, np.zeros(0)])
    values = values[values.imag >= 0]
    if not len(values) or values.imag.max() >= CLUMP * all_values.imag.max():
        return None
    low, high = -0.05 * values.imag.max(), 1.15 * values.imag.max()
    seen = all_values[(all_values.imag >= low) & (all_values.imag <= high)]
    room = 0.08 * (np.ptp(seen.real) or high)
    return (float(seen.real.min() - room), float(seen.real.max() + room)), (float(low), float(high))


def _sizes(models: Sequence[Mapping[str, Any]]) -> str:
    """'5 DOF', or '9 and 10 DOF' where the methods differ."""
    sizes = dict.fromkeys(str(model["size"]) for model in models if model["model"] != "full")
    return f"{' and '.join(sizes)} DOF"


def joined_figure(rows: Sequence[Mapping[str, Any]], title: str) -> Any:
    """Error of the lowest frequencies over the stiffness of the springs under the interface; a line for each model."""
    figure = new_figure(PAGE, 4.2)
    axis = figure.subplots()
    modes = list(dict.fromkeys(row["modes"] for row in rows))
    for method in dict.fromkeys(row["model"] for row in rows):
        seen = look(method)
        for count in modes:
            mine = [row for row in rows if (row["model"], row["modes"]) == (method, count)]
            shade = 0.35 + 0.65 * (modes.index(count) + 1) / len(modes)
            axis.loglog([row["springs"] for row in mine], [max(row["error"], ROUNDING) for row in mine], color=seen.colour,
                        marker=seen.marker, ms=5, lw=1, alpha=shade, label=f"{seen.label}, {mine[0]['size']} DOF")
    axis.set(xlabel="springs under the interface / static stiffness of the component there  [-]",
             ylabel="relative error of ω  [-]", title=title)
    axis.grid()
    figure.legend(loc="outside right upper")
    return figure
