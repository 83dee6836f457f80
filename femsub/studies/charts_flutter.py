"""The flutter diagram: frequencies and growth rates of tracked modes over a parameter."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from femsub.checks import Array
from femsub.studies.charts import Chart, Level, Panel, Series, look

if TYPE_CHECKING:
    from femsub.stability import Crossing, Tracked

COLOURS = ("#1f77b4", "#2ca02c", "#9467bd", "#8c564b", "#e377c2", "#17becf", "#bcbd22", "#7f7f7f")
OTHERS = (("#c44e00", "s"), ("#0067a5", "^"), ("#333333", "D"), ("#6a3d9a", "v"))  # of models that are no reduction
MEETS = "d"  # no model's mark
STABLE, UNSTABLE = "#4d4d4d", "#c0392b"
REGAINED = "#8f8f8f"
NOTE = "Dashed: where stability is lost. A mode with Re λ above 0 grows; its line is red and wide, its marks are filled."

Points: TypeAlias = Sequence[tuple[float, Array]]  # values of the parameter, and the eigenvalues there


class Passage(NamedTuple):
    """Where a branch begins to grow (`lost`) or ceases to, between two computed values of the parameter."""

    before: int  #: the row of the value after it
    value: float
    eigenvalue: complex
    lost: bool


def passages(item: Tracked, branch: int, known: Sequence[Crossing] = (), near: float = 0.05) -> list[Passage]:
    """All of a branch: at the crossing that is known there, else where a straight line between both values has Re λ = 0.

    A known crossing belongs to a branch if it is within `near` of its ω, or within what ω changes between the two values.
    """
    found, values, grow = [], item.eigenvalues[:, branch], item.growing[:, branch]
    for i in np.flatnonzero((grow[:-1] != grow[1:]) & np.isfinite(values[:-1].real) & np.isfinite(values[1:].real)):
        (here, there), (left, right) = values[i:i + 2], item.values[i:i + 2]
        share = float(np.clip(-here.real / (there.real - here.real), 0.0, 1.0))
        omega = here.imag + share * (there.imag - here.imag)
        least = max(near * abs(omega), abs(there.imag - here.imag))
        mine = [(one.value, one.omega) for one in known if left <= one.value <= right and abs(one.omega - omega) <= least]
        value, omega = min(mine, key=lambda one: abs(one[1] - omega), default=(float(left + share * (right - left)), omega))
        found.append(Passage(int(i) + 1, value, complex(0.0, omega), bool(grow[i + 1])))
    return found


def flutter_chart(name: str, tracks: Mapping[str, Tracked], critical: Mapping[str, Sequence[Crossing]], label: str, title: str,
                  points: Mapping[str, Points] | None = None, marks: int = 31) -> Chart:
    """Im λ above, Re λ below. The first model has a line for each branch, wide and red where it grows.

    The others have at most so many `marks` on each branch, filled where a mode grows. Triangles stand at the losses and regains
    of each branch of the first, a narrow diamond where two of them meet, a vertical line at each of `critical`. `tracks` and
    `critical` have the models by their names, reduced ones by the keys of their methods. `points` are models that were solved at
    some values only; they have circles. More branches than there are colours are grey. Re λ is then drawn about the axis, and the
    panel says what it leaves out.
    """
    (model, item), *others = tracks.items()
    # the first model: each branch in a colour of its own, or grey if there are many; wide and red where it grows
    called, count, known = look(model).label, item.eigenvalues.shape[1], critical.get(model, ())
    many = count > len(COLOURS)
    thin: list[dict[str, list[Series]]] = []
    wide: list[dict[str, list[Series]]] = []
    crossed: list[Passage] = []
    for j in range(count):
        passed = passages(item, j, known)
        crossed += passed
        before = [one.before for one in passed]
        places = np.insert(item.values, before, [one.value for one in passed])
        branch = np.insert(item.eigenvalues[:, j], before, [one.eigenvalue for one in passed])
        grow = np.insert(item.growing[:, j], before, True)
        hover = {"branch": [float(j)] * len(branch), "error bar": np.insert(item.error_bar[:, j], before, np.nan)}
        thin.append(_pair(branch, places, called if many or count == 1 else f"{called}, mode {j + 1}", hover,
                          line="solid", marker="", colour=STABLE if many else COLOURS[j], width=0.8 if many else 1.2,
                          legend=not many or j == 0))
        if grow.any():
            wide.append(_pair(np.where(grow, branch, complex(np.nan, np.nan)), places, "a mode grows", hover, line="solid",
                              marker="", colour=UNSTABLE, width=1.8 if many else 3.6, legend=not wide))
    pairs = thin + wide if many else wide + thin
    # its losses and regains, and a diamond where two branches meet
    for word, marker, lost in (("begins to grow", "^", True), ("ceases to grow", "v", False)):
        if these := [one for one in crossed if one.lost == lost]:
            pairs.append(_pair(np.array([one.eigenvalue for one in these]), [one.value for one in these], word, marker=marker))
    if met := [one for one in item.meetings if one.kind in ("coalescence", "splitting")]:
        pairs.append(_pair(np.array([one.eigenvalue for one in met]), [one.value for one in met], "coalescence or splitting",
                           {"kind": [one.kind for one in met]}, marker=MEETS, size=10.0, hollow=True))
    levels = _levels(called, known, "dash", "black")
    # the other models: marks at the values that were asked for
    for at, (model, item) in enumerate(others):
        style = look(model)
        colour, marker = (style.colour, style.marker) if style.label != model else OTHERS[at % len(OTHERS)]
        asked = np.flatnonzero(item.asked)
        taken: Array = asked[np.unique(np.linspace(0, len(asked) - 1, min(marks, len(asked))).astype(int))]
        values, grow = item.eigenvalues[taken], item.growing[taken]
        places = np.broadcast_to(item.values[taken, None], values.shape)
        drawn: dict[str, Any] = {"colour": colour, "marker": marker, "size": 4.0}
        pairs.append(_pair(values.ravel(), places.ravel(), style.label, hollow=True, **drawn))
        if grow.any():
            pairs.append(_pair(values[grow], places[grow], f"{style.label}, a mode grows", **drawn))
        levels += _levels(style.label, critical.get(model, ()), "dot", colour)
    # models that were solved at some values only
    for model, solved in (points or {}).items():
        where = np.concatenate([np.full(len(values), place) for place, values in solved])
        found = np.concatenate([values for _, values in solved])
        pairs += [_pair(found[chosen], where[chosen], f"{model}, {word}", colour=colour, size=6.0, hollow=True)
                  for chosen, colour, word in ((found.real <= 0, STABLE, "stable"), (found.real > 0, UNSTABLE, "unstable"))
                  if chosen.any()]
    # frequencies and growth rates
    every = np.concatenate([item.eigenvalues.ravel() for item in tracks.values()])
    every = every if every.size else np.zeros(1)  # no mode in the band
    top = float(np.nanmax(every.real))
    panels = []
    for part, axis, lines, about in (("imag", "Im λ  [rad/time]", levels, "Frequencies"),
                                     ("real", "Re λ  [1/time]", [*levels, Level(0.0, "", "y", "solid")], "Growth rates")):
        lowest, most = float(np.nanmin(getattr(every, part))), float(np.nanmax(getattr(every, part)))
        cut = many and part == "real" and 0 < 1.5 * top < -lowest  # one that reaches little further down is not cut
        least = -top if cut else lowest
        room = 0.06 * ((most - least) or 1.0)  # around the curves
        low = max(least - room, -room) if part == "imag" else least - room
        if lowest < low:
            about += f" (the axis is cut: values go down to {lowest:.4g})"
        panels.append(Panel([one for pair in pairs for one in pair[part]], re.sub(r"\bmu\b", "μ", label), axis, about,
                            levels=lines, limits={"y": (low, most + room)}, share={"x": "parameter"}))
    return Chart(name, f"{title}: flutter diagram", panels, note=NOTE, width=0.875, height=2.7, columns=2)


def _levels(name: str, crossings: Sequence[Crossing], line: str, colour: str, few: int = 4) -> list[Level]:
    """Lines at a few losses and regains with their values, or at the first loss where there are more."""
    ordered = sorted(crossings, key=lambda one: one.value)
    seen = [(one.value, "lost" if one.growth[1] > one.growth[0] else "regained") for one in ordered]
    if len(seen) > few:
        seen = [next((one for one in seen if one[1] == "lost"), seen[0])]
    return [Level(value, f"{name}: stability {word} at {value:.4g}", "x", line, colour if word == "lost" else REGAINED)
            for value, word in seen]


def _pair(values: Array, places: Any, name: str, hover: Mapping[str, Any] | None = None, **style: Any) \
        -> dict[str, list[Series]]:
    """Im λ and Re λ over the parameter; each name stands in the legend once."""
    known = {"Im λ [rad/time]": values.imag, "Re λ": values.real, **(hover or {})}
    return {part: [Series(name, places, getattr(values, part), hover=known, **style)] for part in ("imag", "real")}
