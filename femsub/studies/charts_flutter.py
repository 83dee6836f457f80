"""The flutter diagram: frequencies and growth rates of tracked modes over a parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from femsub.checks import Array
from femsub.studies.charts import Chart, Level, Panel, Series, look

if TYPE_CHECKING:
    from femsub.stability import Tracked

COLOURS = ("#1f77b4", "#2ca02c", "#9467bd", "#8c564b", "#e377c2", "#17becf", "#bcbd22", "#7f7f7f")
OTHERS = (("#c44e00", "s"), ("#0067a5", "^"), ("#333333", "D"), ("#6a3d9a", "v"))  # of models that are no reduction
MARKS = 31  # values marked of each model beside the first
STABLE, UNSTABLE = "#4d4d4d", "#c0392b"
ROOM = 0.06  # of the range of Re λ and Im λ, left around the curves
NOTE = "Dashed: where stability is lost. A mode with Re λ above 0 grows; its line is wide, its marks are filled."

Points: TypeAlias = Sequence[tuple[float, Array]]  # values of the parameter, and the eigenvalues there


def flutter_chart(name: str, tracks: Mapping[str, Tracked], critical: Mapping[str, Sequence[float]], label: str, title: str,
                  points: Mapping[str, Points] | None = None) -> Chart:
    """Im λ above, Re λ below. The first model has a line for each branch, wide where it grows.

    The others have marks, filled where a mode grows. A vertical line stands at each critical value. `tracks` and `critical` have
    the models by their names, reduced ones by the keys of their methods. `points` are models that were solved at some values
    only; they have circles. More branches than there are colours are grey, and red where they grow; Re λ is then drawn about
    the axis.
    """
    first, *others = tracks.items()
    many = first[1].eigenvalues.shape[1] > len(COLOURS)
    pairs = [_branches(*first, many)]
    levels = [Level(value, f"{look(first[0]).label}: stability lost at {value:.4g}" if i == 0 else "")
              for i, value in enumerate(critical.get(first[0], ()))]
    for at, (model, item) in enumerate(others):
        style = look(model)
        colour, marker = (style.colour, style.marker) if style.label != model else OTHERS[at % len(OTHERS)]
        pairs.append(_marks(style.label, item, colour, marker))
        levels += [Level(value, f"{style.label}: stability lost at {value:.4g}" if i == 0 else "", "x", "dot", colour)
                   for i, value in enumerate(critical.get(model, ()))]
    pairs += [_circles(model, solved) for model, solved in (points or {}).items()]
    every = np.concatenate([item.eigenvalues.ravel() for item in tracks.values()])
    every = every if every.size else np.zeros(1)  # no mode in the band
    top = float(np.nanmax(every.real))
    panels = []
    for part, axis, lines, about in (("imag", "Im λ  [rad/time]", levels, "Frequencies"),
                                     ("real", "Re λ  [1/time]", [*levels, Level(0.0, "", "y", "solid")], "Growth rates")):
        values = getattr(every, part)
        least, most = float(np.nanmin(values)), float(np.nanmax(values))
        if many and top > 0 and part == "real":
            least, most = max(-top, least), top
        room = ROOM * ((most - least) or 1.0)
        low = max(least - room, -room) if part == "imag" else least - room
        panels.append(Panel([one for pair in pairs for one in pair[part]], label, axis, about, levels=lines,
                            limits={"y": (low, most + room)}, share={"x": "parameter"}))
    return Chart(name, f"{title}: flutter diagram", panels, note=NOTE, width=0.875, height=2.7, columns=2)


def _pair(values: Array, places: Any, name: str, told: Mapping[str, Any] | None = None, **style: Any) \
        -> dict[str, list[Series]]:
    """Im λ and Re λ over the parameter; each name stands in the legend once."""
    known = {"Im λ [rad/time]": values.imag, "Re λ": values.real, **(told or {})}
    return {part: [Series(name, places, getattr(values, part), told=known, **style)] for part in ("imag", "real")}


def _joined(*pairs: dict[str, list[Series]]) -> dict[str, list[Series]]:
    return {part: [one for pair in pairs for one in pair[part]] for part in ("imag", "real")}


def _branches(model: str, item: Tracked, many: bool) -> dict[str, list[Series]]:
    """Each branch in a colour of its own, or grey if there are many; wide where it grows; a circle where two meet."""
    pairs = []
    name, grow = look(model).label, item.growing
    for j, branch in enumerate(item.eigenvalues.T):
        own, told = COLOURS[j % len(COLOURS)], {"branch": [float(j)] * len(branch), "error bar": item.error_bar[:, j]}
        pairs.append(_pair(branch, item.values, name, told, line="solid", marker="", colour=STABLE if many else own,
                           width=0.8 if many else 1.2, legend=j == 0))
        if grow[:, j].any():
            pairs.append(_pair(np.where(grow[:, j], branch, complex(np.nan, np.nan)), item.values,
                               f"a mode grows ({'red' if many else 'bold, filled'})", told, line="solid", marker="",
                               colour=UNSTABLE if many else own, width=1.8 if many else 3.6, legend=not grow[:, :j].any()))
    if met := [one for one in item.meetings if one.kind in ("coalescence", "splitting")]:
        pairs.append(_pair(np.array([one.eigenvalue for one in met]), [one.value for one in met], "coalescence or splitting",
                           {"kind": [one.kind for one in met]}, size=6.0, hollow=True))
    return _joined(*pairs)


def _circles(name: str, solved: Points) -> dict[str, list[Series]]:
    places = np.concatenate([np.full(len(values), place) for place, values in solved])
    every = np.concatenate([values for _, values in solved])
    return _joined(*(_pair(every[chosen], places[chosen], f"{name}, {word}", colour=colour, size=6.0, hollow=True)
                     for chosen, colour, word in ((every.real <= 0, STABLE, "stable"), (every.real > 0, UNSTABLE, "unstable"))
                     if chosen.any()))


def _marks(name: str, item: Tracked, colour: str, marker: str) -> dict[str, list[Series]]:
    asked = np.flatnonzero(item.asked)
    taken: Array = asked[np.unique(np.linspace(0, len(asked) - 1, min(MARKS, len(asked))).astype(int))]
    grow, values = item.growing[taken], item.eigenvalues[taken]
    places = np.broadcast_to(item.values[taken, None], values.shape)
    style: dict[str, Any] = {"colour": colour, "marker": marker, "size": 4.0}
    return _joined(_pair(values.ravel(), places.ravel(), name, hollow=True, **style),
                   _pair(values[grow], places[grow], name, legend=False, **style))
