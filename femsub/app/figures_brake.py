"""The flutter diagram of systems under friction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from femsub.app.figure_style import new_figure
from femsub.checks import Array
from femsub.stability.tracking import Tracked

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
