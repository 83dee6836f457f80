"""Charts of results: lines and marks on axes, as data. Figures, files and pages draw them from one definition."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from femsub.checks import Array
from femsub.output.tables import Look, look

ROUNDING = 1e-13  # errors below are rounding, and drawn there
#: line, hollow and width of models of one method: the most modes first on springs, last in receptances
STYLES = (("solid", False, 1.6), ("dash", True, 1.2), ("dot", True, 0.9))


@dataclass(frozen=True)
class Series:
    """Points (x, y), as marks, a line or both; a gap where one of the two is NaN.

    Attributes
    ----------
    name : str
        In the legend; those of one name are shown and hidden together.
    x, y : sequence of float
    model : str
        The key of the model that colour and mark are those of, where none are given.
    line : str
        'solid', 'dash', 'dot', or '' for none.
    marker, colour : str
        A mark by matplotlib's letter, '' for none.
    size, width : float
        Of marks and lines, in points.
    hollow, legend : bool
    labels : sequence of str
        Beside the points.
    hover : mapping of str to sequence
        What else a page shows of each point.
    """

    name: str
    x: Any
    y: Any
    model: str = ""
    line: str = ""
    marker: str | None = None
    colour: str = ""
    size: float = 5.0
    width: float = 1.2
    hollow: bool = False
    legend: bool = True
    labels: Sequence[str] = ()
    hover: Mapping[str, Any] = field(default_factory=dict)

    @property
    def look(self) -> Look:
        """The name, the colour and the mark."""
        model = look(self.model)
        return Look(self.name, self.colour or model.colour, model.marker if self.marker is None else self.marker)


class Level(NamedTuple):
    """A straight line across a panel at x or y."""

    at: float
    text: str = ""
    axis: str = "x"
    line: str = "dash"
    colour: str = "black"


class Heat(NamedTuple):
    """Values (n, m) in colours at x (m,) and y (n,) of a figure, logarithmic from `low` to `top`.

    `signed` ones are on both sides of 0, and linear up to `low`; `whole` ones are numbers from `low` to `top`, each in a colour.
    The scale is named by `label`. Where `hatched` (n, m) is True, the values are undecided. A page has those that are `paged`.
    """

    x: Any
    y: Any
    values: Array
    label: str
    low: float
    top: float
    signed: bool = False
    whole: bool = False
    hatched: Any = None
    paged: bool = False

    def plain(self) -> dict[str, Any]:
        """For a page, which draws the colours of signed ones about 0, linear."""
        return {"x": _plain(self.x), "y": _plain(self.y), "z": [_plain(row) for row in np.asarray(self.values, dtype=float)],
                "label": self.label, "signed": self.signed}


@dataclass(frozen=True)
class Panel:
    """Series on a pair of axes.

    Attributes
    ----------
    series : sequence of Series
    x, y : str
        The labels of the axes, with units in brackets.
    title : str
    logs : str
        The logarithmic axes: '', 'x', 'y' or 'xy'.
    linear : mapping of str to float
        Axes of a figure that are logarithmic on both sides of 0, and linear up to this size.
    whole : str
        Axes of whole numbers: '', 'x', 'y' or 'xy'.
    levels : sequence of Level
    limits : mapping of str to (float, float)
        Of 'x' and 'y', where they are not those of the data.
    rounding : bool
        Whether y are errors, of which those of rounding lie on a grey band.
    share : mapping of str to str
        Panels of one word for 'x', or for 'y', have that axis in common.
    among : str
        Panels of one word stand in one place of a page, where one of them is chosen.
    where : str
        'figure' or 'page', where it is not drawn on both.
    band : (float, float), optional
        A range of y that is grey.
    heat : Heat, optional
        What lies below the series in a figure.
    """

    series: Sequence[Series]
    x: str
    y: str
    title: str = ""
    logs: str = ""
    levels: Sequence[Level] = ()
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    rounding: bool = False
    share: Mapping[str, str] = field(default_factory=dict)
    among: str = ""
    where: str = ""
    band: tuple[float, float] | None = None
    linear: Mapping[str, float] = field(default_factory=dict)
    whole: str = ""
    heat: Heat | None = None


@dataclass(frozen=True)
class Chart:
    """Panels side by side and one below the other.

    Attributes
    ----------
    name : str
        That of its PNG file.
    title : str
    panels : sequence of Panel
    across : int
        Panels side by side.
    about : str
        Lines below the title.
    note : str
        How it is read, for a page.
    width, height : float
        Of the figure over that of a page; of a row of panels in inches.
    columns : int
        Of the legend.
    """

    name: str
    title: str
    panels: Sequence[Panel]
    across: int = 1
    about: str = ""
    note: str = ""
    width: float = 1.0
    height: float = 3.0
    columns: int = 4

    @property
    def drawn(self) -> list[Panel]:
        """The panels of its figure; a chart without them has none."""
        return [panel for panel in self.panels if panel.where != "page"]

    def plain(self, hertz: bool = False) -> dict[str, Any]:
        """As it stands in results.json, for a page; with `hertz` what is in rad/time is shown in Hz as well."""
        places: dict[str, list[dict[str, Any]]] = {}
        for panel in self.panels:
            series = []
            for one in panel.series if panel.where != "figure" else ():
                _, colour, marker = one.look
                hover = list(one.hover.items())
                if hertz:
                    hover += [("f [Hz]", np.asarray(values, dtype=float) / (2 * np.pi)) for name, values in hover
                              if "[rad/time]" in name]
                series.append({"name": one.name, "x": _plain(one.x), "y": _plain(one.y), "line": one.line, "marker": marker,
                               "colour": colour, "size": one.size, "width": one.width, "hollow": one.hollow,
                               "legend": one.legend, "hover": [[name, _plain(values)] for name, values in hover]})
            if series:
                places.setdefault(panel.among or panel.title, []).append({
                    "title": panel.title, "x": panel.x, "y": panel.y, "logs": panel.logs, "series": series,
                    **({"heat": panel.heat.plain()} if panel.heat and panel.heat.paged else {}),
                    "levels": [one._asdict() for one in panel.levels if math.isfinite(one.at)]})
        return {"name": self.name, "title": self.title, "note": self.note,
                "places": [{"title": title, "panels": panels} for title, panels in places.items()]}


def hover_of(rows: Sequence[Mapping[str, Any]], words: Mapping[str, str]) -> dict[str, list[Any]]:
    """What a page shows of points: columns of their rows by the words that stand there; those that the rows lack are left out."""
    return {word: [row[key] for row in rows] for word, key in words.items() if key in rows[0]}


def _plain(values: Iterable[Any]) -> list[Any]:
    """Numbers to the seven digits that a chart can show, None for what no axis has a place for; words as they are."""
    return [value if isinstance(value, str) or value is None else float(f"{value:.7g}") if math.isfinite(value) else None
            for value in values]


def finite(values: Any) -> Array:
    """Numbers, with NaN for those that are infinite."""
    found = np.asarray(values, dtype=float)
    return np.where(np.isfinite(found), found, np.nan)


def floored(errors: Iterable[float | None]) -> list[float]:
    """Errors as they are drawn: those of rounding at `ROUNDING`, NaN for those that are not known."""
    return [max(float(error), ROUNDING) if error is not None and math.isfinite(error) else math.nan for error in errors]


def nested(at: int) -> float:
    """The size of a mark: those drawn later are smaller, so that marks that lie on each other are all seen."""
    return max(7.5 - 2 * at, 3.0)


def damping_percent(eigenvalues: Any) -> Array:
    """-100 Re λ/|λ|; 0 at λ = 0."""
    values = np.asarray(eigenvalues, dtype=complex)
    size = np.abs(values)
    return np.asarray(-100 * values.real / np.where(size > 0, size, 1.0))


def linear_up_to(values: Any, piled: float = 0.03, decades: int = 5) -> float:
    """Where an axis of values of both signs becomes logarithmic; 0 where it need not.

    It is logarithmic where half of the sizes are below `piled` of the largest, so that they would lie on each other at 0. It has
    at most so many `decades` on each side of 0.
    """
    sizes = np.abs(np.asarray(values, dtype=float))
    sizes = sizes[np.isfinite(sizes)]
    sizes = sizes[sizes > ROUNDING * sizes.max(initial=0.0)]
    if not len(sizes) or np.median(sizes) > piled * sizes.max():
        return 0.0
    return float(10.0 ** max(np.floor(np.log10(np.quantile(sizes, 0.2))), np.ceil(np.log10(sizes.max())) - decades))
