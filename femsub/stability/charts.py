"""Charts of answers about stability: losses over a parameter, growth over it, derivatives, changes that help."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from femsub.output import Chart, Level, Panel, Series, finite, linear_up_to

if TYPE_CHECKING:
    from femsub.stability.changes_tried import WhatHelps
    from femsub.stability.question import CriticalValue
    from femsub.stability.sensitivities import Sensitivities
    from femsub.stability.sweep import StabilitySweep

NOTE = ("Each bar goes from the largest growth rate of the model as it is to that with the change. Left of the target the change "
        "is enough. The slope alone misleads where modes meet, or where another mode begins to grow.")
VERDICTS = {True: ("all modes decay", "#2166ac"), False: ("a mode grows", "#b2182b"), None: ("undecided", "0.5")}


def changes_chart(name: str, found: WhatHelps, title: str) -> Chart:
    """A bar for each candidate, the best at the top: the largest Re λ now and with the change.

    Marks show what the slope predicts, and the full model, where it was solved.
    """
    now, ranks, tried = found.before.growth, range(1, len(found.tried) + 1), list(found.tried)
    bars = list[Series]()
    for rank, one in zip(ranks, tried, strict=True):
        word, colour = VERDICTS[one.is_stable]
        ends = finite([now, one.growth])  # a band without modes has no growth
        middle = float(np.mean(ends[np.isfinite(ends)])) if np.isfinite(ends).any() else found.target
        bars += [Series("", ends, [rank, rank], line="solid", marker="", colour=colour, width=4.0, legend=False),
                 Series(word, ends[1:], [rank], marker="o", colour=colour, size=7.0, hover={"candidate": [one.name]}),
                 Series("", [middle], [rank - 0.3], marker="", colour="black", legend=False, labels=[one.name])]
    bars.append(Series("by slope", finite([one.by_slope for one in tried]), ranks, marker="|", colour="black", size=11.0))
    full = {rank: one.in_full.growth for rank, one in zip(ranks, tried, strict=True) if one.in_full is not None}
    if full:
        bars.append(Series("full model", finite(list(full.values())), list(full), marker="D", colour="black", hollow=True,
                           size=8.0))
    levels = [Level(now, "as it is", line="dot"), Level(found.target, "target")]
    panel = Panel(bars, "largest Re λ  [1/time]", "rank of the candidate", levels=levels,
                  limits={"y": (len(tried) + 0.5, 0.4)}, whole="y")
    return Chart(name, title, [panel], note=NOTE, height=1.5 + 0.45 * len(tried), columns=6)


def crossings_chart(found: CriticalValue, title: str) -> Chart:
    """Where modes begin and cease to grow, over the parameter and their frequency, and what was not excluded."""
    series = []
    for word, several, marker, colour in (("a mode begins to grow", found.losses, "^", "#c0392b"),
                                          ("a mode ceases to grow", found.regains, "v", "#2166ac")):
        if several:
            values = [one.value for one in several]
            series.append(Series(word, values, [one.omega for one in several], marker=marker, colour=colour, size=8.0,
                                 labels=[f"{value:.5g}" for value in values], hover={"width": [one.width for one in several]}))
    if found.open:
        ends = [value for pair in found.open for value in (*pair, np.nan)]
        series.append(Series("not excluded", ends, np.zeros(len(ends)), line="solid", marker="", colour="#e69f00", width=5.0))
    lo, hi = sorted(found.searched)
    room = 0.03 * (hi - lo)
    limits = {"x": (lo - room, hi + room)} if np.isfinite(room) else {}
    top = max([*(one.omega for one in (*found.losses, *found.regains)), found.band[1] if np.isfinite(found.band[1]) else 0.0])
    panel = Panel(series, f"{found.parameter}  [-]", "ω  [rad/time]", limits=limits | {"y": (-0.03 * (top or 1.0), 1.06 * (
        top or 1.0))})
    return Chart("critical", title, [panel], about=f"from {found.searched[0]:g} to {found.searched[1]:g}; {found.evidence}",
                 width=0.8)


def growth_over_chart(found: StabilitySweep, title: str) -> Chart:
    """The largest Re λ over the parameter, and Im λ of that mode."""
    order = np.argsort(found.values, kind="stable")
    panels = [Panel([Series("largest growth", found.values[order], y[order], line="solid", size=4.0, colour="#0067a5")],
                    f"{found.parameter}  [-]", label, share={"x": "parameter"}, levels=levels)
              for label, y, levels in (("max Re λ  [1/time]", finite(found.growth), [Level(0.0, "", "y", "solid")]),
                                       ("its Im λ  [rad/time]", finite(found.omega), []))]
    return Chart("sweep", title, panels, width=0.8, height=2.2)


def sensitivities_chart(found: Sensitivities, title: str, most: int) -> Chart:
    """Of each eigenvalue the change of Re λ by the whole of each parameter, to first order, or by one unit if it has no value.

    Those of the `most` eigenvalues with the largest Re λ.
    """
    whole = np.isfinite(found.values)
    slopes = np.where(whole, found.relative.real, found.growth)
    bars = np.where(whole, np.abs(found.values), 1.0) * found.error_bar
    names = [name if known else f"{name}, by one unit" for name, known in zip(found.parameters, whole, strict=True)]
    upper = np.flatnonzero(found.eigenvalues.imag >= 0)
    chosen = upper[np.argsort(-found.eigenvalues[upper].real, kind="stable")][:most]
    panels = []
    for k in chosen:
        order = np.argsort(-np.abs(np.nan_to_num(slopes[k])), kind="stable")
        series = list[Series]()
        for rank, j in enumerate(order, 1):
            value, bar = slopes[k, j], bars[k, j]
            colour = "#c0392b" if value > 0 else "#2166ac"
            series += [Series("", [0.0, value], [rank, rank], line="solid", marker="", colour=colour, width=6.0, legend=False),
                       Series("error bar", [value - bar, value + bar], [rank, rank], line="solid", marker="|", colour="black",
                              legend=rank == 1 and k == chosen[0]),
                       Series("", [value / 2], [rank - 0.35], marker="", colour="black", legend=False, labels=[names[j]])]
        up_to = linear_up_to(slopes[k])
        panels.append(Panel(series, "change of Re λ  [1/time]", "rank of the parameter",
                            f"λ = {found.eigenvalues[k].real:.4g} {found.eigenvalues[k].imag:+.5g}i",
                            levels=[Level(0.0, line="solid", colour="#808080")], limits={"y": (len(order) + 0.5, 0.3)},
                            whole="y", linear={"x": up_to} if up_to else {}))
    left = f"{most} of {len(upper)} eigenvalues are drawn" if len(upper) > most else ""
    return Chart("sensitivities", title, panels, min(2, len(panels)), about=left, height=1.2 + 0.4 * len(names))
