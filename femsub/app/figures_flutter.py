"""The flutter diagram: frequencies and growth rates of tracked modes over a parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from femsub.app.figure_style import look, new_figure
from femsub.checks import Array
from femsub.reduction import METHODS

if TYPE_CHECKING:
    from femsub.stability import Tracked

COLOURS = ("#1f77b4", "#2ca02c", "#9467bd", "#8c564b", "#e377c2", "#17becf", "#bcbd22", "#7f7f7f")
OTHERS = (("#c44e00", "s"), ("#0067a5", "^"), ("#333333", "D"), ("#6a3d9a", "v"))  # of models that are no reduction
MARKS = 31  # values marked of each model beside the first
STABLE, UNSTABLE = "#4d4d4d", "#c0392b"
ROOM = 0.06  # of the range of Re λ and Im λ, left around the curves

Points: TypeAlias = Sequence[tuple[float, Array]]  # values of the parameter, and the eigenvalues there


def flutter_figure(tracks: Mapping[str, Tracked], critical: Mapping[str, Sequence[float]], label: str, title: str,
                   points: Mapping[str, Points] | None = None) -> Any:
    """Im λ above, Re λ below. The first model has a line for each branch, bold where it grows.

    The others have marks, filled where a mode grows. A vertical line stands at each critical value. `tracks` and `critical` have
    the models by their names, reduced ones by the keys of their methods. `points` are models that were solved at some values
    only; they have circles. More branches than there are colours are grey, and red where they grow; Re λ is then drawn about
    the axis.
    """
    figure = new_figure(7.0, 6.4)
    axes = figure.subplots(2, 1, sharex=True)
    every = np.concatenate([item.eigenvalues.ravel() for item in tracks.values()])
    every = every if every.size else np.zeros(1)  # no mode in the band
    many = next(iter(tracks.values())).eigenvalues.shape[1] > len(COLOURS)
    top = float(np.nanmax(every.real))
    for axis, part in zip(axes, (every.imag, every.real), strict=True):
        lo, hi = (max(-top, np.nanmin(part)), top) if many and top > 0 and axis is axes[1] else (np.nanmin(part), np.nanmax(part))
        room = ROOM * ((hi - lo) or 1.0)
        axis.set_ylim(max(lo - room, -room) if axis is axes[0] else lo - room, hi + room)
        axis.grid(lw=0.4)
    for at, (name, item) in enumerate(tracks.items()):
        style = look(name)
        colour, marker = (style.colour, style.marker) if name in METHODS else OTHERS[(at - 1) % len(OTHERS)]
        if at == 0:
            colour = "black"
            _lines(axes, item, style.label, many)
        else:
            _marks(axes, item, style.label, colour, marker)
        for i, value in enumerate(critical.get(name, ())):
            for axis in axes:
                axis.axvline(value, color=colour, ls="--" if at == 0 else ":", lw=1.0,
                             label=f"{style.label}: stability lost at {value:.4g}" if i == 0 and axis is axes[0] else None)
    for name, solved in (points or {}).items():
        _circles(axes, solved, name)
    axes[1].axhline(0.0, color="black", lw=0.8)
    axes[0].set_ylabel("Im λ  [rad/time]")
    axes[1].set(xlabel=label, ylabel="Re λ  [1/time]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    figure.suptitle(f"{title}: flutter diagram", fontsize=11)
    return figure


def _lines(axes: Any, item: Tracked, name: str, many: bool) -> None:
    """Each branch in a colour of its own, or grey if there are many; bold where it grows; a circle where two meet."""
    grow = item.growing
    wide = {"lw": 1.8} if many else {"lw": 3.6, "alpha": 0.55}
    for j, branch in enumerate(item.eigenvalues.T):
        own = COLOURS[j % len(COLOURS)]
        for axis, part in zip(axes, (branch.imag, branch.real), strict=True):
            first = j == 0 and axis is axes[0]
            axis.plot(item.values, part, color=STABLE if many else own, lw=0.8 if many else 1.2, label=name if first else None)
            axis.plot(item.values, np.where(grow[:, j], part, np.nan), color=UNSTABLE if many else own, solid_capstyle="butt",
                      **wide)
    if grow.any():
        axes[0].plot([], [], color=UNSTABLE if many else "black", label=f"a mode grows ({'red' if many else 'bold, filled'})",
                     **wide)
    met = [one for one in item.meetings if one.kind in ("coalescence", "splitting")]
    for axis, heights in zip(axes, ([one.eigenvalue.imag for one in met], [one.eigenvalue.real for one in met]), strict=True):
        axis.plot([one.value for one in met], heights, "o", color="black", ms=6, mfc="none",
                  label="coalescence or splitting" if met and axis is axes[0] else None)


def _circles(axes: Any, solved: Points, name: str) -> None:
    places = np.concatenate([np.full(len(values), place) for place, values in solved])
    every = np.concatenate([values for _, values in solved])
    for chosen, colour, word in ((every.real <= 0, STABLE, "stable"), (every.real > 0, UNSTABLE, "unstable")):
        for axis, part in zip(axes, (every.imag, every.real), strict=True):
            axis.plot(places[chosen], part[chosen], "o", color=colour, ms=6, mfc="none", mew=0.8,
                      label=f"{name}, {word}" if chosen.any() and axis is axes[0] else None)


def _marks(axes: Any, item: Tracked, name: str, colour: str, marker: str) -> None:
    asked = np.flatnonzero(item.asked)
    taken: Array = asked[np.unique(np.linspace(0, len(asked) - 1, min(MARKS, len(asked))).astype(int))]
    grow = item.growing[taken]
    for axis, part in zip(axes, (item.eigenvalues[taken].imag, item.eigenvalues[taken].real), strict=True):
        places = np.broadcast_to(item.values[taken, None], part.shape)
        axis.plot(places.ravel(), part.ravel(), marker, color=colour, ms=4, mfc="none", mew=0.8,
                  label=name if axis is axes[0] else None)
        axis.plot(places[grow], part[grow], marker, color=colour, ms=4, mew=0.8)
