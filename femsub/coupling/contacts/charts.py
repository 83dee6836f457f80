"""Friction laws as curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from femsub.output import Chart, Level, Panel, Series

SHADES = ("#9ecae1", "#4292c6", "#08519c", "#000000")


def friction_chart(speeds: Any, curves: Sequence[Mapping[str, Any]], titles: Mapping[str, str], speed: float,
                   slope: float) -> Chart:
    """μ over the sliding speed for several ε, a panel for each law by its key (the paper's Fig. 2)."""
    shades = dict(zip(sorted({curve["eps"] for curve in curves}, reverse=True), SHADES, strict=False))
    panels = [Panel([Series(f"ε = {curve['eps']:g}", speeds, curve["value"], line="solid", marker="", colour=shades[curve["eps"]])
                     for curve in curves if curve["law"] == law], "sliding speed v  [length/time]", "friction coefficient μ  [-]",
                    title, levels=[Level(speed, f"v0 = {speed:g}, μ' = {slope:.4f}", colour="#4d4d4d")], share={"y": "mu"})
              for law, title in titles.items()]
    return Chart("friction-law", "Friction laws", panels, len(panels), height=2.8)
