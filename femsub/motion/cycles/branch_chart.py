"""Charts of limit cycles: a cycle over its period, and branches of cycles over a parameter (the bifurcation diagram)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from femsub.checks import Array
from femsub.output import ROUNDING, Chart, Level, Panel, Series, hover_of, look

WIDTHS = (2.0, 1.0, 1.3)  # line widths of reduced models, in turn: lines that coincide can be distinguished
KINDS = {"fold": "D", "period doubling": "s", "Neimark-Sacker": "^", "branch point": "v"}
UNITS = {"slope": "slope μ'(v0)  [time/length]", "speed": "belt speed v0  [length/time]", "force": "normal force F  [force]"}
SHOWN = {"rms": "rms of v  [length/time]", "omega": "ω  [rad/time]", "peak": "peak of v  [length/time]",
         "sticking": "share of the period in which it sticks  [-]"}  # figures show the first two
HOVER = {"ω [rad/time]": "omega", "rms": "rms", "peak": "peak", "sticking": "sticking", "harmonics": "harmonics"}
LINES = {True: ("", "solid", None), False: (", unstable", "dash", 0.8), None: (" (stability not computed)", "", None)}
NOTE = ("v is the speed under the belt. Dashed: unstable. Star: where the branch begins. Open circle: where a transient ended. "
        "Dotted: the value of the scene.")


def cycle_chart(t: Array, v: Array, u: Array, omega: float, speed: float | None, title: str) -> Chart:
    """One period of the speed v (p, m) at the contacts, the orbit of v over u, and the amplitudes of the harmonics of v."""
    amplitude = 2 * np.abs(np.fft.rfft(v, axis=1)[:, 1:]) / v.shape[1]
    amplitude = amplitude[:, :max(1, int((amplitude > ROUNDING * amplitude.max()).any(axis=0).nonzero()[0].max(initial=0)) + 1)]
    closed = np.append(np.arange(v.shape[1]), 0)
    names = [f"column {at}" if len(v) > 1 else "v" for at in range(1, len(v) + 1)]
    drawn: list[dict[str, Any]] = [{"line": "solid", "marker": "", "colour": f"C{at % 10}"} for at in range(len(v))]
    belt = [] if speed is None else [Level(speed, "speed of the belt", "y")]
    return Chart("cycle", title, [
        Panel([Series(name, t, one, **how) for name, one, how in zip(names, v, drawn, strict=True)], "t  [time]",
              "v  [length/time]", "one period", levels=belt),
        Panel([Series(name, x[closed], y[closed], **how) for name, x, y, how in zip(names, u, v, drawn, strict=True)],
              "u less its mean  [length]", "v  [length/time]", "orbit", levels=belt),
        Panel([Series(name, omega * np.arange(1, len(one) + 1), one, **how | {"marker": "."}) for name, one, how
               in zip(names, amplitude, drawn, strict=True)], "ω  [rad/time]", "amplitude  [length/time]", "harmonics",
              logs="y")], 3, width=1.25, height=2.6)


def bifurcation_chart(branches: Sequence[Mapping[str, Any]], dots: Sequence[Mapping[str, Any]], parameter: str,
                      families: Sequence[float], now: float | None, title: str) -> Chart:
    """One column per family of cycles: rms of the speed under the belt above, ω below; a page also shows peak and sticking.

    Open circles are transients, drawn in the family of their strongest frequency.
    """
    shown = [family for family in families if any(item["family"] == family for item in branches)] or list(families[:1])
    reduced = [name for name in dict.fromkeys(item["model"] for item in branches) if name != "full"]
    widths = {"full": 3.2} | {name: WIDTHS[i % len(WIDTHS)] for i, name in enumerate(reduced)}
    # for each transient, the family with the frequency nearest to its strongest frequency, within 5 %
    known = [np.concatenate([[family], *(item["branch"].omega for item in branches if item["family"] == family)])
             for family in shown]
    homes: list[float | None] = []
    for dot in dots:
        gaps = [float(np.abs(omega / dot["omega"] - 1).min()) for omega in known]
        best = int(np.argmin(gaps)) if gaps and np.isfinite(dot["omega"]) else -1
        homes.append(shown[best] if best >= 0 and gaps[best] < 0.05 else None)
    # panels
    across = min(len(shown), 2)  # families side by side, as wide as a page has room for
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
                    series, UNITS.get(parameter, f"{parameter}  [-]"), label,
                    f"from the mode at ω = {family:.4g} rad/time" if key != "omega" else "",
                    levels=[] if now is None else [Level(now, "value of the scene", line="dot", colour="#999999")],
                    share={"x": f"{family}"},
                    among=f"from the mode at ω = {family:.4g} rad/time", where="" if key in ("rms", "omega") else "page"))
    head = f"{title}: limit cycles" if title else "Limit cycles"
    return Chart("branch", f"{head} over the {parameter}, v under the belt", panels, across, note=NOTE,
                 width=1.0 if across > 1 else 0.7, height=2.3, columns=3 if across == 1 else 4)


def _branch(model: str, branch: Any, parameter: str, key: str, width: float) -> list[Series]:
    """Lines for the stable and unstable pieces, each drawn to the next point to avoid gaps; the Hopf point; special points."""
    rows, name = branch.rows(), look(model).label
    x, y = np.asarray(branch.values, dtype=float), np.array([row[key] for row in rows], dtype=float)
    hover = {parameter: x, **hover_of(rows, HOVER)}
    flags = [None if flag is None and all(one is None for one in branch.stable) else flag is not False for flag in branch.stable]
    series = []
    for flag, (word, line, thin) in LINES.items():
        own = np.array([one is flag for one in flags])
        if own.any():
            keep = own | np.append(False, own[:-1]) if line else own
            series.append(Series(f"{name}{word}", x, np.where(keep, y, np.nan), model, line, "" if line else "x",
                                 size=7.0 if not line else 4.0, width=thin or width, hover=hover))
    if branch.hopf is not None:
        kind = "supercritical" if branch.hopf.supercritical else "subcritical"
        series.append(Series("Hopf point", x[:1], y[:1], model, marker="*", size=8.0,
                             hover={"model": [name], "kind": [kind], parameter: x[:1]}))
    for point in branch.special:
        if key in ("rms", "omega"):
            series.append(Series(point.kind, [point.value], [getattr(point, key)], model, marker=KINDS[point.kind], size=4.5,
                                 hover={"model": [name], parameter: [point.value]}))
    return series
