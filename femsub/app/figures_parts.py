"""The figure of systems that were reduced part by part."""

from __future__ import annotations

from typing import Any

import numpy as np

from femsub.app.figure_style import few_decades, look, new_figure
from femsub.studies.results import Row, Study

KINDS = {"error_frequency": "frequencies", "error_growth": "growth rates", "error_slope": "critical slope",
         "error_force": "forces in the joints"}
FLOOR = 1e-13  # errors below are rounding, and drawn there


def errors_figure(found: Study, title: str) -> Any:
    """Errors of frequencies, growth rates, critical slope and forces in the joints: over DOF, and over seconds."""
    kinds = {kind: name for kind, name in KINDS.items()
             if any(np.isfinite(getattr(row, kind)) for row in found.rows)}
    figure = new_figure(3.1 * max(len(kinds), 2), 6.4)
    axes = figure.subplots(2, len(kinds), sharex="row", sharey="col", squeeze=False)
    for line, (across, label) in enumerate(((_size, "DOF of the system  [-]"), (_seconds, "seconds to reduce and to solve"))):
        for axis, kind in zip(axes[line], kinds, strict=True):
            for key in dict.fromkeys(row.method for row in found.rows):
                rows = [row for row in found.rows if row.method == key and row.sound and np.isfinite(getattr(row, kind))]
                points = [(across(row), max(getattr(row, kind), FLOOR)) for row in rows]
                style = look(key)
                axis.plot(*(zip(*points, strict=True) if points else ((), ())), color=style.colour, marker=style.marker,
                          markersize=5, lw=1, mfc="none", label=style.label)
            axis.axvline(across(found.full), color="black", ls="--", lw=1, label="full")
            axis.set(xscale="log", yscale="log", xlabel=label)
            axis.grid(lw=0.4)
        few_decades(axes[line, 0])
    for column, name in enumerate(kinds.values()):
        axes[0, column].set_title(name)
    for axis in axes[:, 0]:
        axis.set_ylabel("relative error  [-]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    figure.suptitle(f"{title}, band {found.band[0]:g} to {found.band[1]:.4g} rad/time\n"
                    "models with a mode missing or added in the band are not shown", fontsize=9)
    return figure


def _size(row: Row) -> float:
    return float(row.size)


def _seconds(row: Row) -> float:
    return row.seconds
