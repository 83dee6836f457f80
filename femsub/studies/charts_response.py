"""Bode charts: magnitude and phase of receptances over frequency, full and reduced, and the bound of the error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from femsub.studies.charts import Chart, Panel, Series, look

OMEGA = "ω  [rad/time]"
NOTE = "The error is bounded: the difference from the full model's receptance, and what is not known of both."
STYLES = (("solid", 1.6), ("dash", 1.2), ("dot", 1.0))  # of the models of one method, the most modes last


def response_chart(curves: Sequence[Mapping[str, Any]], title: str) -> Chart:
    """|h| and its phase over ω for each model, and for reduced models the bound of the relative error.

    A curve has `model`, `modes`, `size`, `omega`, `magnitude`, `phase` in degrees and, of a reduced model, `error`.
    """
    panels = []
    for key, label, logs in (("magnitude", "|h|  [length/force]", "y"), ("phase", "phase of h  [°]", ""),
                             ("error", "bound of the error over |h|  [-]", "y")):
        seen: dict[str, int] = {}
        series = []
        for curve in curves:
            if key not in curve:
                continue
            at = seen.setdefault(curve["model"], 0)
            seen[curve["model"]] += 1
            line, width = STYLES[at % len(STYLES)] if curve["model"] != "full" else ("solid", 2.2)
            series.append(Series(f"{look(curve['model']).label}, {curve['size']} DOF", curve["omega"],
                                 np.asarray(curve[key], dtype=float), curve["model"], line, "", width=width))
        panels.append(Panel(series, OMEGA, label, logs=logs, rounding=key == "error", share={"x": "omega"}))
    return Chart("frequency-response", title, panels, note=NOTE, height=2.0, columns=3)
