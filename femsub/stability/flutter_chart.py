"""The flutter diagram: frequencies and growth rates of tracked modes over a parameter."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from femsub.checks import Array
from femsub.output import Chart, Level, Panel, Series, damping_percent, linear_up_to, look

if TYPE_CHECKING:
    from femsub.stability.crossings import Crossing
    from femsub.stability.tracking import Tracked

COLOURS = ("#1f77b4", "#2ca02c", "#9467bd", "#8c564b", "#e377c2", "#17becf", "#bcbd22")
COUPLED = ("coalescence", "splitting")  # kinds of meetings
OUTGROWN = 10.0  # an axis is linear if no value exceeds the largest growth by more than this factor
OTHERS = (("#c44e00", "s"), ("#0067a5", "^"), ("#333333", "D"), ("#6a3d9a", "v"))  # looks of models that are no reduction
MEETS = "d"  # a mark that no model has
STABLE, UNSTABLE, OTHER = "#4d4d4d", "#e8998d", "#9a9a9a"
REGAINED = "#8f8f8f"
NOTE = ("Dashed: where stability is lost. A mode with Re λ above 0 grows; its line is underlaid in red, its marks are filled. "
        "Coupled modes have one colour; other modes are grey.")

Points: TypeAlias = Sequence[tuple[float, Array]]  # values of the parameter, and the eigenvalues there


class Passage(NamedTuple):
    """Where a branch begins to grow (`lost`) or ceases to, between two computed values of the parameter."""

    before: int  #: the row of the value after it
    value: float
    eigenvalue: complex
    lost: bool


def passages(item: Tracked, branch: int, known: Sequence[Crossing] = (), near: float = 0.05) -> list[Passage]:
    """All passages of a branch: at a known crossing, else where a straight line between both values has Re λ = 0.

    A known crossing belongs to a branch if it is within `near` of its ω, or within the change of ω between the two values.
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
    """Im λ, Re λ and the damping ratio -Re λ/|λ| in % over a parameter, one below the other.

    The first model has a line for each branch. Branches that meet in a coalescence share one colour and one name; a branch that
    grows by itself has its own. Colours follow the order in which branches begin to grow; all other branches are grey. A line is
    underlaid in red where its mode grows. The other models have at most `marks` marks on each branch, filled where a mode grows.
    Triangles show the losses and regains of each branch of the first model, narrow diamonds where two branches meet, vertical
    lines the values of `critical`. `tracks` and `critical` are mappings by the models' names, or by the keys of reduction
    methods; a single model may have the name ''. `points` are models that were solved at some values only; they have circles. If
    a few damped modes would set the scale, it is logarithmic on both sides of 0.
    """
    (model, item), *others = tracks.items()
    called, known = look(model).label, critical.get(model, ())
    branches = range(item.eigenvalues.shape[1])
    passed = [passages(item, j, known) for j in branches]
    groups = coupled(item)
    colours = dict(zip([j for group in groups[:len(COLOURS)] for j in group],
                       [colour for group, colour in zip(groups, COLOURS, strict=False) for _ in group], strict=True))
    of_it = f"{called}, " if called else ""  # a single model needs no name
    words = {j: f"{of_it}mode{'s' * (len(group) > 1)} {' and '.join(str(one + 1) for one in group)}" for group in groups
             for j in group}
    lines, wide, shown = list[dict[str, list[Series]]](), list[dict[str, list[Series]]](), set[str]()
    for j in sorted(branches, key=lambda j: j in colours):  # grey ones below
        before = [one.before for one in passed[j]]
        places = np.insert(item.values, before, [one.value for one in passed[j]])
        branch = np.insert(item.eigenvalues[:, j], before, [one.eigenvalue for one in passed[j]])
        grow = np.insert(item.growing[:, j], before, True)
        hover = {"branch": [float(j)] * len(branch), "error bar": np.insert(item.error_bar[:, j], before, np.nan)}
        word = words[j] if j in colours else f"{of_it}other modes" if groups else called or "modes"
        lines.append(_lines(branch, places, word, hover, line="solid", marker="", colour=colours.get(j, OTHER),
                            width=1.4 if j in colours else 0.8, legend=word not in shown))
        shown.add(word)
        if grow.any():
            wide.append(_lines(np.where(grow, branch, complex(np.nan, np.nan)), places, "a mode grows", hover, line="solid",
                               marker="", colour=UNSTABLE, width=4.0, legend=not wide))
    found = wide + lines
    # its losses and regains, and a diamond where two branches meet
    for word, marker, lost in (("begins to grow", "^", True), ("ceases to grow", "v", False)):
        if these := [one for several in passed for one in several if one.lost == lost]:
            found.append(_lines(np.array([one.eigenvalue for one in these]), [one.value for one in these], word, marker=marker))
    if met := [one for one in item.meetings if one.kind in COUPLED]:
        found.append(_lines(np.array([one.eigenvalue for one in met]), [one.value for one in met], "coalescence or splitting",
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
        found.append(_lines(values.ravel(), places.ravel(), style.label, hollow=True, **drawn))
        if grow.any():
            found.append(_lines(values[grow], places[grow], f"{style.label}, a mode grows", **drawn))
        levels += _levels(style.label, critical.get(model, ()), "dot", colour)
    # models that were solved at some values only
    for model, solved in (points or {}).items():
        where = np.concatenate([np.full(len(values), place) for place, values in solved])
        every = np.concatenate([values for _, values in solved])
        found += [_lines(every[chosen], where[chosen], f"{model}, {word}", colour=colour, size=6.0, hollow=True)
                  for chosen, colour, word in ((every.real <= 0, STABLE, "stable"), (every.real > 0, UNSTABLE, "unstable"))
                  if chosen.any()]
    # frequencies, growth rates and damping
    every = np.concatenate([item.eigenvalues.ravel() for item in tracks.values()])
    every = every[np.isfinite(every)] if np.isfinite(every).any() else np.zeros(1)  # no mode in the band
    axis, panels = Level(0.0, "", "y", "solid"), list[Panel]()
    for part, y, about in (("imag", "Im λ  [rad/time]", "Frequencies"), ("real", "Re λ  [1/time]", "Growth rates"),
                           ("damping", "-Re λ / |λ|  [%]", "Damping ratios: below 0 a mode grows")):
        values = damping_percent(every) if part == "damping" else getattr(every, part)
        lowest, most = float(values.min()), float(values.max())
        room = 0.06 * ((most - lowest) or 1.0)  # around the curves
        low = max(lowest - room, -room) if part == "imag" else lowest - room
        # damped modes must not set the scale of growing modes: if they would, the axis is logarithmic
        grow = np.abs(values[every.real > 0]).max(initial=0.0)
        up_to = 10.0 ** np.floor(np.log10(grow)) if grow else linear_up_to(values)
        linear = {"y": float(up_to)} if part != "imag" and up_to and np.abs(values).max() > OUTGROWN * grow else {}
        limits = {} if linear else {"y": (low, most + room)}
        panels.append(Panel([one for each in found for one in each[part]], re.sub(r"\bmu\b", "μ", label), y, about,
                            levels=levels if part == "imag" else [*levels, axis], limits=limits, linear=linear,
                            share={"x": "parameter"}))
    head = f"{title}: flutter diagram" if title else "Flutter diagram"
    return Chart(name, head, panels, note=NOTE, width=0.875, height=2.5, columns=2)


def coupled(item: Tracked) -> list[tuple[int, ...]]:
    """Groups of branches that meet in a coalescence, and branches that grow, in the order in which they begin to; others last."""
    groups = list[set[int]]()
    for one in item.meetings:
        if one.kind in COUPLED:
            mine = [group for group in groups if group & set(one.branches)]
            groups = [*(group for group in groups if group not in mine), set(one.branches).union(*mine)]
    alone = set(np.flatnonzero(item.growing.any(axis=0)).tolist()) - set().union(*groups)
    groups += [{int(j)} for j in alone]
    begins = np.where(item.growing.any(axis=0), item.growing.argmax(axis=0), len(item.values))
    return [tuple(sorted(group)) for group in sorted(groups, key=lambda group: (min(begins[j] for j in group), min(group)))]


def _levels(name: str, crossings: Sequence[Crossing], line: str, colour: str, few: int = 4) -> list[Level]:
    """Lines at a few losses and regains with their values, or at the first loss where there are more."""
    ordered = sorted(crossings, key=lambda one: one.value)
    seen = [(one.value, "lost" if one.growth[1] > one.growth[0] else "regained") for one in ordered]
    if len(seen) > few:
        seen = [next((one for one in seen if one[1] == "lost"), seen[0])]
    of_it = f"{name}: " if name else ""
    return [Level(value, f"{of_it}stability {word} at {value:.4g}", "x", line, colour if word == "lost" else REGAINED)
            for value, word in seen]


def _lines(values: Array, places: Any, name: str, hover: Mapping[str, Any] | None = None, **style: Any) \
        -> dict[str, list[Series]]:
    """Im λ, Re λ and the damping ratio over the parameter; each name appears in the legend once."""
    damping = damping_percent(values)
    known = {"Im λ [rad/time]": values.imag, "Re λ": values.real, "damping [%]": damping, **(hover or {})}
    return {part: [Series(name, places, y, hover=known, **style)]
            for part, y in (("imag", values.imag), ("real", values.real), ("damping", damping))}
