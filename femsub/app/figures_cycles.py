"""Bifurcation diagrams of limit cycles: amplitude and frequency over a parameter, full and reduced in one figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from femsub.app.figure_style import PAGE, look, new_figure

WIDTHS = (2.0, 1.0, 1.3)  # of reduced models, in turn: where lines lie on each other, each is seen
ACROSS = 2  # families side by side
KINDS = {"fold": "D", "period doubling": "s", "Neimark-Sacker": "^", "branch point": "v"}
UNITS = {"slope": "slope μ'(v0)  [time/length]", "speed": "belt speed v0  [length/time]", "force": "normal force F  [force]"}


def bifurcation_figure(branches: Sequence[Mapping[str, Any]], dots: Sequence[Mapping[str, Any]], parameter: str,
                       families: Sequence[float], now: float, title: str) -> Any:
    """One column per family of cycles: rms of the speed under the belt above, ω below; stable solid, unstable thin and dashed.

    Open circles are transients, drawn where their strongest frequency belongs.
    """
    shown = [family for family in families if any(item["family"] == family for item in branches)] or list(families[:1])
    across = min(len(shown), ACROSS)
    below = -(-len(shown) // across)
    figure = new_figure(PAGE if across > 1 else 0.7 * PAGE, 4.6 * below + 1.0)
    cells = figure.subplots(2 * below, across, sharex=True, squeeze=False)
    panels = list(zip(cells[0::2].ravel(), cells[1::2].ravel(), strict=True))
    models = list(dict.fromkeys([item["model"] for item in branches] + [dot["model"] for dot in dots]))
    reduced = [name for name in models if name != "full"]
    widths = {"full": 3.2} | {name: WIDTHS[i % len(WIDTHS)] for i, name in enumerate(reduced)}
    homes = [_home(dot["omega"], shown, branches) for dot in dots]
    kinds: set[str] = set()
    for (top, bottom), family in zip(panels, shown, strict=False):
        for item in sorted(branches, key=lambda item: item["model"] != "full"):  # the wide line of the full model lies below
            if item["family"] != family:
                continue
            kinds |= _drawn(top, bottom, item["branch"], look(item["model"]).colour, widths[item["model"]])
        for dot, home in zip(dots, homes, strict=True):
            if home == family:
                for axis, key in ((top, "rms"), (bottom, "omega")):
                    axis.plot(dot["value"], dot[key], "o", ms=6, mfc="none", mec=look(dot["model"]).colour, mew=1.1, zorder=5)
        top.set_title(f"from the mode at ω = {family:.4g} rad/time")
        bottom.set_xlabel(UNITS[parameter])
        bottom.tick_params(labelbottom=True)
        bottom.ticklabel_format(axis="y", useOffset=False)
        for axis in (top, bottom):
            axis.axvline(now, color="0.6", lw=0.8, ls=":")
            axis.grid()
    for at, (top, bottom) in enumerate(panels):
        top.set_visible(at < len(shown))
        bottom.set_visible(at < len(shown))
        if at % across == 0:
            top.set_ylabel("rms of v  [length/time]")
            bottom.set_ylabel("ω  [rad/time]")
    points = {item["model"] for item in branches if all(flag is None for flag in item["branch"].stable)}
    figure.legend(handles=_handles(models, widths, kinds, bool(dots), points), loc="outside lower center",
                  ncols=3 if across == 1 else 4)
    figure.suptitle(f"{title}: limit cycles over the {parameter}, v under the belt")
    return figure


def _drawn(top: Any, bottom: Any, branch: Any, colour: str, width: float) -> set[str]:
    stable = np.array([flag is not False for flag in branch.stable])
    known = any(flag is not None for flag in branch.stable)
    for axis, y in ((top, branch.rms), (bottom, branch.omega)):
        if not known:
            axis.plot(branch.values, y, "x", color=colour, ms=7)
            continue
        # pieces overlap by one point, so that the line has no gaps
        edges = np.flatnonzero(np.diff(stable)) + 1
        for piece in np.split(np.arange(len(stable)), edges):
            ends = np.append(piece, piece[-1] + 1) if piece[-1] + 1 < len(stable) else piece
            whole = bool(stable[piece[0]])
            axis.plot(branch.values[ends], y[ends], color=colour, lw=width if whole else 0.8, ls="-" if whole else (0, (4, 3)))
        if branch.hopf is not None:
            axis.plot(branch.values[0], y[0], "*", color=colour, ms=8, zorder=4)
    for point in branch.special:
        for axis, value in ((top, point.rms), (bottom, point.omega)):
            axis.plot(point.value, value, KINDS[point.kind], color=colour, ms=4.5, mec="white", mew=0.4, zorder=4)
    return {point.kind for point in branch.special}


def _home(omega: float, families: Sequence[float], branches: Sequence[Mapping[str, Any]]) -> float | None:
    """The family whose frequencies a transient's strongest one is nearest to, within 5 %."""
    gaps = []
    for family in families:
        known = np.concatenate([[family], *(item["branch"].omega for item in branches if item["family"] == family)])
        gaps.append(float(np.abs(known / omega - 1).min()))
    best = int(np.argmin(gaps)) if gaps and np.isfinite(omega) else -1
    return families[best] if best >= 0 and gaps[best] < 0.05 else None


def _handles(models: Sequence[str], widths: Mapping[str, float], kinds: set[str], dots: bool, points: set[str]) -> list[Any]:
    from matplotlib.lines import Line2D

    made = [Line2D([], [], color=colour, marker="x", ms=7, ls="", label=f"{label} (stability not computed)") if name in points
            else Line2D([], [], color=colour, lw=widths[name], label=label)
            for name, (label, colour, _) in zip(models, map(look, models), strict=True)]
    made += [Line2D([], [], color="0.4", lw=1.5, label="stable or undecided"),
             Line2D([], [], color="0.4", lw=0.8, ls=(0, (4, 3)), label="unstable"),
             Line2D([], [], color="0.4", marker="*", ls="", ms=8, label="Hopf point"),
             Line2D([], [], color="0.6", lw=0.8, ls=":", label="value of the scene")]
    made += [Line2D([], [], color="0.4", marker=mark, ls="", ms=5, label=kind) for kind, mark in KINDS.items() if kind in kinds]
    if dots:
        made.append(Line2D([], [], color="0.4", marker="o", mfc="none", ls="", ms=6, label="transient"))
    return made
