"""How every figure looks and is saved. matplotlib is only imported when something is drawn."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, BinaryIO, NamedTuple

from femsub.errors import MissingPackageError
from femsub.reduction.reduce import METHODS

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


def render(draw: Callable[[], Any], file: BinaryIO) -> None:
    """Writes a PNG of what a drawing function makes."""
    with _matplotlib().rc_context(STYLE):
        draw().savefig(file, format="png", dpi=150)


def new_figure(width: float, height: float) -> Any:
    """An empty figure that belongs to no window and no global state."""
    figure = _matplotlib().figure.Figure(figsize=(width, height), layout="constrained")
    _matplotlib().backends.backend_agg.FigureCanvasAgg(figure)
    return figure


def _matplotlib() -> Any:
    try:
        import matplotlib.backends.backend_agg
        import matplotlib.figure
    except ImportError as error:
        raise MissingPackageError("figures need matplotlib: pip install femsub[figures], or run with --no-figures") from error
    return matplotlib
