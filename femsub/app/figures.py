"""The figures of studies: the paper's, errors against run time, interfaces on springs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from femsub import Study
from femsub.app.figure_style import few_decades, look, new_figure

FLOOR = 1e-16  # where an error of zero is drawn on a logarithmic axis


def friction_figure(speeds: Any, curves: Sequence[Mapping[str, Any]], titles: Mapping[str, str], speed: float,
                    slope: float) -> Any:
    """μ over the sliding speed for several ε, a panel for each law by its key (the paper's Fig. 2)."""
    figure = new_figure(4.5 * len(titles), 4)
    axes = figure.subplots(1, len(titles), sharey=True)
    widths = sorted({curve["eps"] for curve in curves}, reverse=True)
    shades = dict(zip(widths, ("#9ecae1", "#4292c6", "#08519c", "#000000"), strict=False))
    for axis, (law, title) in zip(axes, titles.items(), strict=True):
        for curve in curves:
            if curve["law"] == law:
                axis.plot(speeds, curve["value"], color=shades[curve["eps"]], label=f"ε = {curve['eps']:g}")
        axis.axvline(speed, color="#c44e00", lw=0.8, ls="--", label=f"v0 = {speed:g}, μ' = {slope:.4f}")
        axis.set(title=title, xlabel="sliding speed v  [length/time]", xticks=[-1, -0.5, 0, 0.5, 1])
        axis.grid()
    axes[0].set_ylabel("friction coefficient μ  [-]")
    axes[0].legend(loc="lower right")
    return figure


def belt_sweep_figure(found: Mapping[str, Any]) -> Any:
    """max Re λ over the slope and the belt's place, with the border of stability (the paper's Fig. 3a)."""
    panels, belts, slopes = found["panels"], found["belts"], np.abs(found["slopes"])
    interfaces = list(dict.fromkeys(panel["interface"] for panel in panels))
    columns = len(panels) // len(interfaces)
    figure = new_figure(3.6 * columns + 1, 3.2 * len(interfaces))
    axes = figure.subplots(len(interfaces), columns, sharex=True, sharey=True, squeeze=False)
    top = max(float(np.max(panel["growth"])) for panel in panels)
    from matplotlib.colors import SymLogNorm

    norm = SymLogNorm(linthresh=1e-3 * top, vmin=-top, vmax=top)
    mesh = None
    for axis, panel in zip(axes.ravel(), panels, strict=True):
        growth = np.where(np.isfinite(panel["growth"]), panel["growth"], np.nan)
        mesh = axis.pcolormesh(belts, slopes, growth.T, norm=norm, cmap="RdBu_r", shading="nearest", rasterized=True)
        border = -np.array(panel["critical_slope"], dtype=float)
        axis.plot(belts, np.where(np.isfinite(border), border, np.nan), "k.-", lw=1, label="critical slope")
        axis.set(yscale="log", title=f"{look(panel['model']).label}, interface {panel['interface']}")
        axis.set_xticks(belts)
    for axis in axes[-1]:
        axis.set_xlabel("belt under mass number  [-]")
    for axis in axes[:, 0]:
        axis.set_ylabel("-dμ/dv  [time/length]")
    axes[0, -1].legend(loc="upper right")
    decades = 10.0 ** np.arange(np.ceil(np.log10(1e-2 * top)), np.log10(top))
    figure.colorbar(mesh, ax=axes, label="max Re λ  [1/time]", shrink=0.8, ticks=[*-decades[::-1], 0.0, *decades])
    return figure


def size_sweep_figure(curves: Sequence[Mapping[str, Any]], belt: int) -> Any:
    """Critical slope, and its relative error, over the size of the reduced model (the paper's Fig. 3b)."""
    interfaces = list(dict.fromkeys(curve["interface"] for curve in curves))
    figure = new_figure(4.6 * len(interfaces), 6)
    axes = figure.subplots(2, len(interfaces), sharex=True, sharey="row", squeeze=False)
    for column, interface in enumerate(interfaces):
        upper, lower = axes[:, column]
        for curve in (curve for curve in curves if curve["interface"] == interface):
            seen = look(curve["method"])
            style = {"color": seen.colour, "marker": seen.marker, "label": seen.label, "ms": 5}
            upper.plot(curve["sizes"], np.where(np.isfinite(curve["slope"]), curve["slope"], np.nan), **style)
            lower.semilogy(curve["sizes"], np.maximum(curve["error"], FLOOR), **style)
            full = curve["full"]
        upper.axhline(full, color="black", lw=1, ls="--", label=f"full: {full:.6f}")
        upper.set(title=f"belt under m{belt}, interface {interface}")
        lower.set(xlabel="DOF of the reduced model  [-]")
        upper.legend()
        for axis in (upper, lower):
            axis.grid()
    axes[0, 0].set_ylabel("critical slope dμ/dv  [time/length]")
    axes[1, 0].set_ylabel("relative error  [-]")
    return figure


def eigenvalue_figure(models: Sequence[Mapping[str, Any]], title: str) -> Any:
    """Eigenvalues in the complex plane (the paper's Fig. 4); hollow above the reduced model's cut-off."""
    panels = list(dict.fromkeys(model["panel"] for model in models))
    figure = new_figure(4.8 * len(panels), 4.8)
    axes = figure.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)[0]
    for axis, panel in zip(axes, panels, strict=True):
        for model in (model for model in models if model["panel"] == panel):
            values, beyond = np.asarray(model["eigenvalues"]), np.asarray(model["above_cutoff"])
            full, (label, colour, marker) = model["model"] == "full", look(model["model"])
            style = {"color": colour, "marker": marker, "ls": "none", "ms": 9 if full else 6, "mfc": "none"}
            axis.plot(values.real[~beyond], values.imag[~beyond], label=f"{label}, {model['size']} DOF",
                      **style | {"mfc": "none" if full else colour})
            if beyond.any():
                axis.plot(values.real[beyond], values.imag[beyond], label=f"{label}, above its cut-off", **style)
        axis.axvline(0, color="grey", lw=0.8)
        axis.set(title=panel, xlabel="Re λ  [1/time]")
        axis.grid()
        axis.legend()
    axes[0].set_ylabel("Im λ  [rad/time]")
    figure.suptitle(title)
    return figure


def error_time_figure(studies: Sequence[tuple[str, Study]]) -> Any:
    """Errors of eigenvalues, growth rates and critical slope over the seconds to reduce and to solve."""
    kinds = {"error_eigenvalue": "error of λ", "error_growth": "error of Re λ", "error_slope": "error of the critical slope"}
    shown = [(interface, found, phase) for interface, found in studies for phase in ("reduction", "solution")]
    figure = new_figure(10.5, 2.7 * len(shown) + 0.8)
    axes = figure.subplots(len(shown), len(kinds), sharex=True, sharey="col", squeeze=False)
    seconds = [time for _, one in studies for row in (one.full, *one.rows) for timing in (row.reduction, row.solution)
               for time in (timing.least, timing.most) if time > 0]
    for line, (interface, found, phase) in enumerate(shown):
        for axis, kind in zip(axes[line], kinds, strict=True):
            for number, method in enumerate(dict.fromkeys(row.method for row in found.rows)):
                _error_line(axis, [row for row in found.rows if row.method == method], kind, phase, 4 - 14 * (number % 2))
            if phase == "solution":
                axis.axvline(found.full.solution.median, color="black", ls="--", lw=1, label=f"full, {found.full.size} DOF")
            errors = np.array([getattr(row, kind) for _, one in studies for row in one.rows if row.missing == 0])
            errors = np.maximum(errors[np.isfinite(errors)], FLOOR)
            axis.set(xscale="log", yscale="log", xlim=(min(seconds) / 1.4, max(seconds) * 1.7),
                     ylim=(errors.min(initial=1.0) / 12, errors.max(initial=FLOOR) * 12))
            axis.grid(lw=0.4)
            axis.tick_params(labelbottom=True)
            axis.set_xlabel(f"seconds for {phase}" + (f", interface {interface}" if len(studies) > 1 else ""), fontsize=9)
    for column, label in enumerate(kinds.values()):
        axes[0, column].set_title(label)
    for axis in axes[:, 0]:
        axis.set_ylabel("relative error  [-]")
    few_decades(axes[0, 0])
    figure.legend(*axes[1, -1].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    found = studies[0][1]
    figure.suptitle(f"{found.name}, band {found.band[0]:g} to {found.band[1]:.4g} rad/time\n"
                    f"numbers are DOF; medians of {found.repeats} runs, bars from least to most; circled: no other is both as "
                    "fast (both phases) and as accurate in Re λ", fontsize=9)
    return figure


def _error_line(axis: Any, rows: Sequence[Any], kind: str, phase: str, lift: int) -> None:
    """The reduced models of one method; the numbers of DOF stand `lift` points above."""
    label, colour, marker = look(rows[0].method)
    errors = np.array([getattr(row, kind) for row in rows])
    timing = [getattr(row, phase) for row in rows]
    keep = np.isfinite(errors) & np.array([row.missing == 0 for row in rows])
    seconds = np.array([t.median for t in timing])
    spread = np.array([[t.median - t.least, t.most - t.median] for t in timing]).T
    shown = np.maximum(errors, FLOOR)
    axis.errorbar(seconds[keep], shown[keep], xerr=spread[:, keep], color=colour, marker=marker, ms=5, lw=0.6,
                  elinewidth=0.6, ls="none", label=label)
    order = np.flatnonzero(keep)
    front = np.array([row.pareto for row in rows]) & keep
    if kind == "error_growth" and front.any():
        axis.plot(seconds[front], shown[front], "o", ms=10, mfc="none", mec="black", mew=0.7)
    axis.plot(seconds[order], shown[order], color=colour, lw=0.5, alpha=0.6)
    for at in {order[0], order[-1]} if len(order) else ():  # the smallest and the largest model; all would overlap
        axis.annotate(f"{rows[at].size}", (seconds[at], shown[at]), textcoords="offset points", xytext=(5, lift),
                      fontsize=7, color=colour)


def joined_figure(rows: Sequence[Mapping[str, Any]], title: str) -> Any:
    """Error of the lowest frequencies over the stiffness of the springs under the interface; a line for each model."""
    figure = new_figure(8, 4.6)
    axis = figure.subplots()
    modes = list(dict.fromkeys(row["modes"] for row in rows))
    for method in dict.fromkeys(row["model"] for row in rows):
        seen = look(method)
        for count in modes:
            mine = [row for row in rows if (row["model"], row["modes"]) == (method, count)]
            shade = 0.35 + 0.65 * (modes.index(count) + 1) / len(modes)
            axis.loglog([row["springs"] for row in mine], [max(row["error"], FLOOR) for row in mine], color=seen.colour,
                        marker=seen.marker, ms=5, lw=1, alpha=shade, label=f"{seen.label}, {mine[0]['size']} DOF")
    axis.set(xlabel="springs under the interface / static stiffness of the component there  [-]",
             ylabel="relative error of ω  [-]", title=title)
    axis.grid()
    figure.legend(loc="outside right upper")
    return figure
