"""Bifurcation diagrams of limit cycles: amplitude and frequency over a parameter, full and reduced in one chart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from femsub.studies.charts import Chart, Level, Panel, Series, look

WIDTHS = (2.0, 1.0, 1.3)  # of reduced models, in turn: where lines lie on each other, each is seen
ACROSS = 2  # families side by side
KINDS = {"fold": "D", "period doubling": "s", "Neimark-Sacker": "^", "branch point": "v"}
UNITS = {"slope": "slope μ'(v0)  [time/length]", "speed": "belt speed v0  [length/time]", "force": "normal force F  [force]"}
SHOWN = {"rms": "rms of v  [length/time]", "omega": "ω  [rad/time]", "peak": "peak of v  [length/time]",
         "sticking": "share of the period in which it sticks  [-]"}  # the first two in the figure
TOLD = {"ω [rad/time]": "omega", "rms": "rms", "peak": "peak", "sticking": "sticking", "harmonics": "harmonics"}
LINES = {True: ("", "solid", None), False: (", unstable", "dash", 0.8), None: (" (stability not computed)", "", None)}
NOTE = ("v is the speed under the belt. Dashed: unstable. Star: where the branch begins. Open circle: where a transient ended. "
        "Dotted: the value of the scene.")


def bifurcation_chart(branches: Sequence[Mapping[str, Any]], dots: Sequence[Mapping[str, Any]], parameter: str,
                      families: Sequence[float], now: float, title: str) -> Chart:
    """One column per family of cycles: rms of the speed under the belt above, ω below; a page has peak and sticking as well.

    Open circles are transients, drawn where their strongest frequency belongs.
    """
    shown = [family for family in families if any(item["family"] == family for item in branches)] or list(families[:1])
    reduced = [name for name in dict.fromkeys(item["model"] for item in branches) if name != "full"]
    widths = {"full": 3.2} | {name: WIDTHS[i % len(WIDTHS)] for i, name in enumerate(reduced)}
    homes = [_home(dot["omega"], shown, branches) for dot in dots]
    across = min(len(shown), ACROSS)
    panels = []
    for start in range(0, len(shown), across):
        for key, label in SHOWN.items():
            for family in shown[start:start + across]:
                own = [item for item in branches if item["family"] == family]
                own.sort(key=lambda item: item["model"] != "full")  # the wide line of the full model lies below
                series = [one for item in own for one in _branch(item["model"], item["branch"], parameter, key,
                                                                 widths[item["model"]])]
                series += [Series("transient", [dot["value"]], [dot[key]], dot["model"], marker="o", size=6.0, hollow=True)
                           for dot, home in zip(dots, homes, strict=True) if home == family and key in dot]
                panels.append(Panel(
                    series, UNITS[parameter], label, f"from the mode at ω = {family:.4g} rad/time" if key != "omega" else "",
                    levels=[Level(now, "value of the scene", line="dot", colour="#999999")], share={"x": f"{family}"},
                    among=f"from the mode at ω = {family:.4g} rad/time", where="" if key in ("rms", "omega") else "page"))
    return Chart("bifurcation", f"{title}: limit cycles over the {parameter}, v under the belt", panels, across, note=NOTE,
                 width=1.0 if across > 1 else 0.7, height=2.3, columns=3 if across == 1 else 4)


def _branch(model: str, branch: Any, parameter: str, key: str, width: float) -> list[Series]:
    """Pieces that are stable, or not, each to the next point, so that the line has no gaps; its begin, and special points."""
    rows, name = branch.rows(), look(model).label
    x, y = np.asarray(branch.values, dtype=float), np.array([row[key] for row in rows], dtype=float)
    told = {parameter: x, **{word: [row[at] for row in rows] for word, at in TOLD.items()}}
    flags = [None if flag is None and all(one is None for one in branch.stable) else flag is not False for flag in branch.stable]
    series = []
    for flag, (word, line, thin) in LINES.items():
        own = np.array([one is flag for one in flags])
        if own.any():
            keep = own | np.append(False, own[:-1]) if line else own
            series.append(Series(f"{name}{word}", x, np.where(keep, y, np.nan), model, line, "" if line else "x",
                                 size=7.0 if not line else 4.0, width=thin or width, told=told))
    if branch.hopf is not None:
        kind = "supercritical" if branch.hopf.supercritical else "subcritical"
        series.append(Series("Hopf point", x[:1], y[:1], model, marker="*", size=8.0,
                             told={"model": [name], "kind": [kind], parameter: x[:1]}))
    for point in branch.special:
        if key in ("rms", "omega"):
            series.append(Series(point.kind, [point.value], [getattr(point, key)], model, marker=KINDS[point.kind], size=4.5,
                                 told={"model": [name], parameter: [point.value]}))
    return series


def _home(omega: float, families: Sequence[float], branches: Sequence[Mapping[str, Any]]) -> float | None:
    """The family whose frequencies a transient's strongest one is nearest to, within 5 %."""
    gaps = []
    for family in families:
        known = np.concatenate([[family], *(item["branch"].omega for item in branches if item["family"] == family)])
        gaps.append(float(np.abs(known / omega - 1).min()))
    best = int(np.argmin(gaps)) if gaps and np.isfinite(omega) else -1
    return families[best] if best >= 0 and gaps[best] < 0.05 else None
