"""Maps of stability over two parameters: their chart, and their tables of points and of borders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.output import Chart, Heat, Panel, Series, Table, column, finite

if TYPE_CHECKING:
    from femsub.stability.stability_map import StabilityMap

NOTE = "Lines: borders, where the number of growing modes changes. Undecided points are hatched in the figure alone."
BORDERS = {"black": "border", "#1b7837": "border of divergence (ω = 0)"}


def stability_map_chart(name: str, maps: Mapping[str, StabilityMap], title: str, labels: Sequence[str] = ("", "")) -> Chart:
    """The number of growing modes, and beside it the largest growth, with borders, over two parameters.

    `maps` are maps at values of a third parameter, by titles such as 'p = 2'; a page shows one map at a time, chosen by a slider.
    A single map has the title ''. `labels` are axis labels with units; by default the axes have the parameters' names.
    """
    panels = []
    top = max(float(np.abs(finite(one.growth)).max(initial=0.0, where=np.isfinite(one.growth))) for one in maps.values()) or 1.0
    most = max(int(one.number.max()) for one in maps.values())
    for at, one in maps.items():
        x, y = one.values
        series: list[Series] = []
        for line in one.borders:
            colour, word = list(BORDERS.items())[int(not line.omega.any())]
            series.append(Series(word, line.points[:, 0], line.points[:, 1], line="solid", marker="", colour=colour, width=1.4,
                                 legend=word not in [known.name for known in series], hover={"ω [rad/time]": line.omega}))
        series += [
            Series(f"full model {word}", [spot.at[0] for spot in spots], [spot.at[1] for spot in spots], marker=marker,
                   colour="#e69f00", size=7.0, hollow=True, hover={"growing modes in full": [spot.full_number for spot in spots]})
            for word, marker, spots in (("agrees", "o", [spot for spot in one.spots if spot.agrees]),
                                        ("differs", "X", [spot for spot in one.spots if not spot.agrees])) if spots]
        across, up = (label or f"{parameter}  [-]" for label, parameter in zip(labels, one.parameters, strict=True))
        for word, heat in (
                ("growing modes", Heat(x, y, one.number.T, "growing modes", 0, most, whole=True)),
                ("largest growth", Heat(x, y, finite(one.growth).T, "max Re λ  [1/time]", 1e-3 * top, top, signed=True))):
            panels.append(Panel(series, across, up, f"{word}, {at}" if at else word, share={"y": at}, among=word,
                                heat=heat._replace(hatched=one.undecided.T, paged=True),
                                limits={"x": (x[0], x[-1]), "y": (y[0], y[-1])}))
    return Chart(name, title, panels, 2, note=NOTE, height=3.4, columns=4)


def stability_map_tables(name: str, found: StabilityMap) -> list[Table]:
    """A row for each point, one for each place of a border, and one for each point solved in full; no table without rows."""
    first, second = found.parameters
    points: list[dict[str, Any]] = [
        {first: float(x), second: float(y), "growing_modes": int(found.number[i, j]), "growth": float(found.growth[i, j]),
         "omega": float(found.omega[i, j]), "undecided": bool(found.undecided[i, j]), "radius": float(found.radius[i, j])}
        for i, x in enumerate(found.values[0]) for j, y in enumerate(found.values[1])]
    borders = [{"border": number, first: float(x), second: float(y), "omega": float(omega)}
               for number, line in enumerate(found.borders, 1) for (x, y), omega in zip(line.points, line.omega, strict=True)]
    spots = [{first: one.at[0], second: one.at[1], "growing_modes": one.number, "full_growing_modes": one.full_number,
              "growth": one.growth, "full_growth": one.full_growth, "radius": one.radius, "agrees": one.agrees}
             for one in found.spots]
    columns = [first, second, "growing_modes", "full_growing_modes", "growth", "full_growth",
               column("agrees", "agree", "s", role="verdict")]
    return [table for table in (Table(name, points), Table(f"{name}-borders", borders), Table(
        f"{name}-spots", spots, [column(one, form=".5g") if isinstance(one, str) else one for one in columns],
        "points at which the full model was solved", keys=2)) if table.rows]
