"""Candidates of `what_helps` in the order of their effect: a bar chart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from femsub.studies.charts import Chart, Level, Panel, Series, finite

if TYPE_CHECKING:
    from femsub.stability import WhatHelps

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
                  limits={"y": (len(tried) + 0.5, 0.4)})
    return Chart(name, title, [panel], note=NOTE, height=1.5 + 0.45 * len(tried), columns=6)
