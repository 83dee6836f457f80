"""How every figure looks and is saved. matplotlib is only imported when something is drawn."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from femsub.app.units import UNKNOWN, Units
from femsub.errors import MissingPackageError
from femsub.reduction.reduce import METHODS

HERTZ = (lambda omega: omega / (2 * np.pi), lambda hertz: 2 * np.pi * hertz)
STYLE = {"axes.titlesize": 10, "figure.titlesize": 11, "legend.fontsize": 8, "grid.alpha": 0.3}


class Look(NamedTuple):
    """How a model is named and drawn."""

    label: str
    colour: str
    marker: str


def look(kind: str) -> Look:
    """That of a reduced model by its method's key; of the full model, or any other, black circles."""
    method = METHODS.get(kind)
    return Look(kind, "black", "o") if method is None else Look(method.label, method.colour, method.marker)


def render(draw: Callable[[], Any], file: BinaryIO, units: Units = UNKNOWN, note: str = "") -> None:
    """Writes a PNG of what a drawing function makes, in these units, with a note in small print at its foot."""
    with _matplotlib().rc_context(STYLE):
        figure = draw()
        if units.known:
            _put_units(figure, units)
        if note:
            figure.supxlabel(note, fontsize=7, x=0.99, ha="right")
        figure.savefig(file, format="png", dpi=150)


def _put_units(figure: Any, units: Units) -> None:
    """Labels in these units, and an axis in Hz on the other side of each in rad/s."""
    # this finds the title of the whole figure too: figure.get_suptitle is newer than the oldest matplotlib
    for text in figure.findobj(_matplotlib().text.Text):
        text.set_text(units.said(text.get_text()))
    panels = {axis: axis.get_subplotspec() for axis in figure.axes if axis.get_subplotspec() is not None}
    for axis, place in panels.items():
        if "[rad/s]" in axis.get_xlabel():
            column = [other for other in panels if panels[other].colspan == place.colspan]
            first = min(column, key=lambda other: panels[other].rowspan.start)
            first.secondary_xaxis("top", functions=HERTZ).set_xlabel("f  [Hz]")
        if "[rad/s]" in axis.get_ylabel():
            row = sorted((other for other in panels if panels[other].rowspan == place.rowspan),
                         key=lambda other: panels[other].colspan.start)
            shared = axis.get_shared_y_axes()
            for other in row if not shared.joined(axis, row[-1]) else row[-1:]:
                hertz = other.secondary_yaxis("right", functions=HERTZ)
                hertz.ticklabel_format(axis="y", useOffset=False)
                hertz.set_ylabel("f  [Hz]" if other is row[-1] else "")


def new_figure(width: float, height: float) -> Any:
    """An empty figure that belongs to no window and no global state."""
    figure = _matplotlib().figure.Figure(figsize=(width, height), layout="constrained")
    _matplotlib().backends.backend_agg.FigureCanvasAgg(figure)
    return figure


def few_decades(axis: Any) -> None:
    """Ticks at 1, 2 and 5 where a logarithmic time axis spans less than two decades, and no crowd of labels."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    lo, hi = axis.get_xlim()
    if hi < 100 * lo:
        # with fewer than two ticks, as within a factor of 5, LogLocator would take as many even ones as it likes
        axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)) if hi > 5 * lo else MaxNLocator(4, steps=[1, 2, 5, 10]))
        axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())


def _matplotlib() -> Any:
    try:
        import matplotlib.backends.backend_agg
        import matplotlib.figure
        import matplotlib.text
    except ImportError as error:
        raise MissingPackageError("figures need matplotlib: pip install femsub[figures], or run with --no-figures") from error
    return matplotlib
