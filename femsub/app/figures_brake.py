"""Figures of systems under friction: errors of reduced models against time, and the flutter diagram."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from femsub.app.figure_style import Look, few_decades, look, new_figure
from femsub.checks import Array
from femsub.reduction.contact_modes import ContactModes
from femsub.stability.tracking import Tracked
from femsub.studies.friction_sweep import FrictionRow

FLOOR = 1e-7  # errors below are drawn there: the critical μ is not located better
OWN = {"contact-modes": Look("real modes of the brake and friction responses", ContactModes.colour, ContactModes.marker),
       "real-modes": Look("real modes of the brake alone", "#7f7f7f", "v")}
KINDS = {"error": "eigenvalues", "growth_error": "growth rates", "mu_error": "critical mu"}


def errors_figure(rows: Sequence[FrictionRow], full: float, title: str) -> Any:
    """The errors of eigenvalues, growth rates and critical μ over the seconds to reduce and to solve at one μ."""
    figure = new_figure(10.5, 4.6)
    axes = figure.subplots(1, len(KINDS), sharex=True)
    for axis, (kind, name) in zip(axes, KINDS.items(), strict=True):
        for method in dict.fromkeys(row.method for row in rows):
            style = OWN.get(method) or look(method)
            found = [row for row in rows if row.method == method and np.isfinite(getattr(row, kind))]
            places = [row.seconds for row in found], [max(getattr(row, kind), FLOOR) for row in found]
            axis.plot(*places, color=style.colour, marker=style.marker, ms=6, lw=1, mfc="none", label=style.label)
            if missing := [i for i, row in enumerate(found) if row.missed]:
                axis.plot([places[0][i] for i in missing], [places[1][i] for i in missing], "x", color="red", ms=9, ls="none",
                          label="misses an unstable mode")
        axis.axvline(full, color="black", ls="--", lw=1, label="full model, one mu")
        axis.set(xscale="log", yscale="log", xlabel="seconds to reduce and solve, one mu", title=name)
        axis.grid(lw=0.4)
        few_decades(axis)
    axes[0].set_ylabel("largest error relative to |λ|, or to mu  [-]")
    lines = dict(zip(*reversed(axes[0].get_legend_handles_labels()), strict=True))
    figure.legend(lines.values(), lines.keys(), loc="outside lower center", ncols=4)
    figure.suptitle(f"{title}: reduced models against the full one")
    return figure


STABLE, UNSTABLE = "#4d4d4d", "#c0392b"
Points = Sequence[tuple[float, Array]]  # μ, and the eigenvalues there


def flutter_figure(reduced: Tracked, full: Points, critical: float, title: str) -> Any:
    """Im λ and Re λ over μ: of the reduced model as lines, of the full one as circles; the critical μ as a vertical line."""
    figure = new_figure(7.5, 8.5)
    axes = figure.subplots(2, 1, sharex=True)
    for axis, part, name in zip(axes, (np.imag, np.real), ("Im λ  [rad/time]", "Re λ  [1/time]"), strict=True):
        for at, branch in enumerate(reduced.eigenvalues.T):
            grows = branch.real > 0
            axis.plot(reduced.values, part(branch), color=STABLE, lw=0.8, label="reduced, stable" if at == 0 else None)
            axis.plot(reduced.values, np.where(grows, part(branch), np.nan), color=UNSTABLE, lw=1.6)
        axis.plot([], [], color=UNSTABLE, lw=1.6, label="reduced, unstable")
        mu = np.concatenate([np.full(len(values), value) for value, values in full])
        values = np.concatenate([values for _, values in full])
        for chosen, colour, word in ((values.real <= 0, STABLE, "stable"), (values.real > 0, UNSTABLE, "unstable")):
            axis.plot(mu[chosen], part(values[chosen]), "o", color=colour, ms=6, mfc="none", mew=0.8, label=f"full, {word}")
        if np.isfinite(critical):
            axis.axvline(critical, color="#0067a5", lw=1, ls="--", label=f"critical mu = {critical:.4g}")
        axis.set_ylabel(name)
        axis.grid(lw=0.4)
    axes[1].set_xlabel("mu  [-]")
    top = float(np.nanmax(reduced.eigenvalues.real, initial=0.0))
    axes[1].set_ylim(-1.0 * max(top, 1.0), 1.15 * max(top, 1.0))
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.suptitle(title)
    return figure
