"""Charts of results as data: lines and marks on axes. Figures, files and pages are drawn from this one definition."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from femsub.checks import Array
from femsub.output.tables import Look, look

ROUNDING = 1e-13  # smaller errors are rounding errors, and are drawn at this value
#: line, hollow marks and line width of one method's models: with the most modes first on springs, last in receptances
STYLES = (("solid", False, 1.6), ("dash", True, 1.2), ("dot", True, 0.9))


@dataclass(frozen=True)
class Series:
    """Points (x, y), as marks, a line or both; a gap where x or y is NaN.

    Attributes
    ----------
    name : str
        Name in the legend. Series of one name are shown and hidden together.
    x, y : sequence of float
    model : str
        Key of the model whose colour and mark are used where `colour` or `marker` is not given.
    line : str
        'solid', 'dash', 'dot', or '' for no line.
    marker, colour : str
        Mark by matplotlib's letter, '' for no marks; colour by matplotlib's name or hex code.
    size, width : float
        Size of the marks and width of the line, in points.
    hollow, legend : bool
        Whether the marks are hollow, and whether the legend lists the series.
    labels : sequence of str
        Texts beside the points.
    hover : mapping of str to sequence
        Further values of each point, which a page shows beside it.
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
    """Values (n, m) drawn as colours at x (m,) and y (n,), on a logarithmic scale from `low` to `top`.

    The scale of `signed` values extends to both sides of 0, and is linear up to `low`. `whole` values are whole numbers from
    `low` to `top`, each with its own colour. `label` names the scale. Values are undecided where `hatched` (n, m) is True. With
    `paged`, a page shows the values too.
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
        """The values for a page, whose colour scale is linear, and centred at 0 for signed values."""
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
        Axes of a figure that are logarithmic on both sides of 0, each with the size up to which it is linear.
    whole : str
        Axes of whole numbers: '', 'x', 'y' or 'xy'.
    levels : sequence of Level
    limits : mapping of str to (float, float)
        Limits of 'x' and 'y', where they do not follow from the data.
    rounding : bool
        Whether y is an error. A grey band then marks rounding errors.
    share : mapping of str to str
        Panels with the same word for 'x' (or 'y') have that axis in common.
    among : str
        Panels with the same word share one place of a page; its reader chooses which panel is shown.
    where : str
        'figure' or 'page', if the panel is drawn on one of them only.
    band : (float, float), optional
        A range of y that is grey.
    heat : Heat, optional
        Values in colours, below the series.
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
    """Panels in rows of `across` panels.

    Attributes
    ----------
    name : str
        Name of its PNG file, without ending.
    title : str
    panels : sequence of Panel
    across : int
        Number of panels side by side.
    about : str
        Lines below the title.
    note : str
        How to read the chart, for a page.
    width, height : float
        Width of the figure relative to a page; height of a row of panels in inches.
    columns : int
        Columns of the legend.
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
        """The panels of its figure. If there are none, the chart has no figure."""
        return [panel for panel in self.panels if panel.where != "page"]

    def plain(self, hertz: bool = False) -> dict[str, Any]:
        """The chart as results.json and a page have it; with `hertz`, values in rad/time are also shown in Hz beside a point."""
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
    """Columns of `rows` that a page shows beside points, named by `words` (key → word); keys that rows lack are left out."""
    return {word: [row[key] for row in rows] for word, key in words.items() if key in rows[0]}


def _plain(values: Iterable[Any]) -> list[Any]:
    """Numbers rounded to the seven digits that a chart can show, None for infinite and missing values; words unchanged."""
    return [value if isinstance(value, str) or value is None else float(f"{value:.7g}") if math.isfinite(value) else None
            for value in values]


def finite(values: Any) -> Array:
    """An array of the numbers, with NaN in place of infinite ones."""
    found = np.asarray(values, dtype=float)
    return np.where(np.isfinite(found), found, np.nan)


def floored(errors: Iterable[float | None]) -> list[float]:
    """Errors as they are drawn: at least `ROUNDING`; NaN for unknown errors."""
    return [max(float(error), ROUNDING) if error is not None and math.isfinite(error) else math.nan for error in errors]


def nested(at: int) -> float:
    """The size of a mark of series number `at`. Later series have smaller marks, so that coincident marks all stay visible."""
    return max(7.5 - 2 * at, 3.0)


def damping_percent(eigenvalues: Any) -> Array:
    """-100 Re λ/|λ|; 0 at λ = 0."""
    values = np.asarray(eigenvalues, dtype=complex)
    size = np.abs(values)
    return np.asarray(-100 * values.real / np.where(size > 0, size, 1.0))


def linear_up_to(values: Any, piled: float = 0.03, decades: int = 5) -> float:
    """The size at which an axis of values of both signs turns from linear to logarithmic; 0 if all of it may be linear.

    It becomes logarithmic if half of the sizes are below `piled` times the largest: they would lie on each other at 0. It has at
    most `decades` decades on each side of 0.
    """
    sizes = np.abs(np.asarray(values, dtype=float))
    sizes = sizes[np.isfinite(sizes)]
    sizes = sizes[sizes > ROUNDING * sizes.max(initial=0.0)]
    if not len(sizes) or np.median(sizes) > piled * sizes.max():
        return 0.0
    return float(10.0 ** max(np.floor(np.log10(np.quantile(sizes, 0.2))), np.ceil(np.log10(sizes.max())) - decades))
