"""How every figure looks and is saved. matplotlib is only imported when something is drawn."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from itertools import pairwise, takewhile
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from femsub.checks import package
from femsub.output.charts import ROUNDING, Chart, Panel
from femsub.output.units import UNKNOWN, Units

HERTZ = (lambda omega: omega / (2 * np.pi), lambda hertz: 2 * np.pi * hertz)
PAGE = 8.0  # inches: width of a picture on a page; a wider one is shrunk there, with its text
STYLE = {"font.size": 9, "axes.titlesize": 9, "axes.labelsize": 9, "xtick.labelsize": 8, "ytick.labelsize": 8,
         "legend.fontsize": 8, "figure.titlesize": 10, "grid.alpha": 0.3, "axes.axisbelow": True, "figure.dpi": 150}


class Sizes(NamedTuple):
    """Sizes of what is drawn beside the lines of `STYLE`."""

    number: float = 8  #: font size, in points, of numbers beside marks
    touching: float = 4.0  #: distance, in points, below which marks count as lying on each other
    clearly: float = 1.15  #: a number is nearer to its own mark than to others of its colour by this factor
    stretch: float = 0.12  #: length at which the largest displacement of a solid is drawn, relative to the mesh's largest side
    pieces: int = 3  #: number of pieces along each edge into which a face of a coarse mesh is cut
    fine: int = 8000  #: number of cells from which on cell edges are not drawn
    nearer: float = 0.02  #: distance of edges in front of their face, relative to the largest displacement as drawn
    slides: float = 0.5  #: share of the motion normal to the surface below which arrows show it: the shape hardly changes
    arrows: int = 60  #: approximate number of these arrows


SIZES = Sizes()
#: places (right, up) of a number beside its mark: the second group is for numbers that find no room at any place of the first
SIDES = (((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1)), ((1, 0.3), (-1, 0.3), (1, -0.3), (-1, -0.3)))
MANY = "#7f7f7f"  # in a legend: a name whose marks have the colours of several models
DASHES = {"solid": "-", "dash": "--", "dot": ":", "": "none"}


def render(make: Callable[[], Any], file: BinaryIO, units: Units = UNKNOWN, note: str = "") -> None:
    """Writes the figure of a drawing function as PNG, in these units, with a note below its title."""
    figure_of(make, units, note).canvas.print_png(file)  # `savefig` would draw all of it a second time, for the layout alone


def figure_of(make: Callable[[], Any], units: Units = UNKNOWN, note: str = "") -> Any:
    """The figure that a drawing function returns, in these units, with a note below its title."""
    with _matplotlib().rc_context(STYLE):
        figure = make()
        # labels in these units, and an axis in Hz opposite each axis in rad/s
        if units.known:
            for text in figure.findobj(_matplotlib().text.Text):
                text.set_text(units.said(text.get_text()))
            panels = {axis: axis.get_subplotspec() for axis in figure.axes if axis.get_subplotspec() is not None}
            for axis, place in panels.items():
                if "[rad/s]" in axis.get_xlabel():
                    column = [other for other in panels if panels[other].colspan == place.colspan]
                    first = min(column, key=lambda other: panels[other].rowspan.start)
                    first.secondary_xaxis("top", functions=HERTZ).set_xlabel("f  [Hz]")
                if "[rad/s]" in axis.get_ylabel():
                    after = sorted((other for other in panels if panels[other].rowspan == place.rowspan
                                    and panels[other].colspan.start > place.colspan.start),
                                   key=lambda other: panels[other].colspan.start)
                    # a panel without a label has that of the panel on its left
                    row = [axis, *takewhile(lambda other: not other.get_ylabel(), after)]
                    shared = axis.get_shared_y_axes()
                    for other in row if not shared.joined(axis, row[-1]) else row[-1:]:
                        hertz = other.secondary_yaxis("right", functions=HERTZ)
                        hertz.ticklabel_format(axis="y", useOffset=False)
                        hertz.set_ylabel("f  [Hz]" if other is row[-1] else "")
        # the title, with the note below it
        if note:
            title = figure._suptitle  # get_suptitle is newer than the oldest matplotlib
            figure.suptitle(f"{title.get_text()}\n{note}" if title else note)
        title = figure._suptitle
        if title is not None:  # break the lines of a title that is wider than its figure
            # in letters, each as wide as 0.58 of its height: above the mean
            room = int(figure.get_figwidth() * 72 / (0.58 * title.get_fontsize()))
            title.set_text("\n".join(textwrap.fill(line, room) for line in title.get_text().split("\n")))
    return figure


def new_figure(width: float, height: float) -> Any:
    """An empty figure, in inches, that belongs to no window and no global state."""
    figure = figure_class()(figsize=(width, height), layout="constrained")
    _matplotlib().backends.backend_agg.FigureCanvasAgg(figure)
    return figure


@cache
def figure_class() -> Any:
    """matplotlib's class `Figure`, extended: it is drawn in `STYLE` wherever it is drawn, and notebooks show it."""

    class Figure(_matplotlib().figure.Figure):  # type: ignore[misc]
        def draw(self, renderer: Any) -> None:
            with _matplotlib().rc_context(STYLE):
                super().draw(renderer)

        def _repr_png_(self) -> bytes:
            file = io.BytesIO()
            self.canvas.print_png(file)
            return file.getvalue()

    return Figure


def draw(chart: Chart) -> Any:
    """The figure of a chart."""
    shown = chart.drawn
    across = min(chart.across, len(shown))
    down = -(-len(shown) // across)
    figure = new_figure(chart.width * PAGE, chart.height * down + 1.0)
    axes = figure.subplots(down, across, squeeze=False).ravel()
    labels: list[Any] = []
    for at, panel in enumerate(shown):
        axis, limits = axes[at], {}
        for which in "xy":  # y last, since `values` below are those of the panels that share y: one band of rounding errors
            # panels that share this axis need limits that hold for all of them, or data of one would leave its panel
            alike = [(one, other) for one, other in zip(shown, axes, strict=False)
                     if one is panel or (which in panel.share and one.share.get(which) == panel.share[which])]
            if alike[0][0] is not panel:
                getattr(axis, f"share{which}")(alike[0][1])
            ends = np.array([one.limits[which] for one, _ in alike if which in one.limits])
            if which in panel.limits:
                limits[which] = ends[:, 0].min(), ends[:, 1].max()
        values = [value for one, _ in alike for series in one.series for value in np.asarray(series.y, dtype=float)]
        labels += draw_panel(axis, panel, values, limits)
        below, beside = shown[at + across:at + across + 1], shown[at - 1:at] if at % across else []
        axis.set(title=panel.title, **{"xlabel": panel.x} if not below or below[0].x != panel.x else {},
                 **{"ylabel": panel.y} if not beside or beside[0].y != panel.y else {})
        for other, which in ((below, "x"), (beside, "y")):
            if other and panel.share.get(which, at) == other[0].share.get(which):
                axis.tick_params(**{"labelbottom" if which == "x" else "labelleft": False})
    draw_heats(figure, axes, shown)
    for axis in axes[len(shown):]:
        axis.set_visible(False)
    for axis, panel in zip(axes, shown, strict=False):
        if "x" in panel.logs:
            few_decades(axis)
        elif across > 1 and "x" not in panel.linear and panel.heat is None:  # few enough for labels of six digits
            axis.locator_params(axis="x", nbins=5 if across > 2 else 6)
        for which in panel.whole:
            getattr(axis, f"{which}axis").set_major_locator(_matplotlib().ticker.MaxNLocator(integer=True, min_n_ticks=1))
    legend_below(figure, axes[:len(shown)], chart.columns)
    figure.suptitle("\n".join(filter(None, (chart.title, chart.about))))
    label_points(figure, labels)
    return figure


def draw_panel(axis: Any, panel: Panel, values: Sequence[float], limits: Mapping[str, tuple[float, float]]) -> list[Any]:
    """Draws the series and the levels of a panel. Returns labels for `label_points`, of each series the end points first.

    `values` are the y of all panels that share its y axis, for the band of rounding errors; `limits` are those of its axes.
    """
    if panel.band:
        axis.axhspan(*panel.band, color="0.88", lw=0, zorder=0)
    axis.set(**{f"{which}scale": "log" for which in panel.logs})
    for which, linear in panel.linear.items():
        getattr(axis, f"set_{which}scale")("symlog", linthresh=linear, linscale=0.5)
    axis.set(**{f"{which}lim": ends for which, ends in limits.items()})  # before plotting: a single point gives no limits
    labels = []
    for one in panel.series:
        name, colour, marker = one.look
        x, y = np.asarray(one.x, dtype=float), np.asarray(one.y, dtype=float)
        axis.plot(x, y, color=colour, ls=DASHES[one.line], lw=one.width, marker=marker or "none", ms=one.size, mew=0.9,
                  mfc="none" if one.hollow else colour, label=name if one.legend else None, zorder=3 if marker else 2)
        places = sorted(range(len(one.labels)), key=lambda at: at not in (0, len(one.labels) - 1))
        labels += [(axis, x[at], y[at], one.labels[at], colour) for at in places if np.isfinite(y[at])]
    for level in panel.levels:
        getattr(axis, "axvline" if level.axis == "x" else "axhline")(
            level.at, color=level.colour, ls=DASHES[level.line], lw=0.9, label=level.text or None, zorder=1.5)
    if panel.rounding:
        rounding_below(axis, values)
    if panel.heat is None:
        axis.grid(lw=0.4)
    return labels


def draw_heats(figure: Any, axes: Sequence[Any], panels: Sequence[Panel]) -> None:
    """Draws values as colours. Panels whose values have the same label share one colour bar, beside them all."""
    from matplotlib import colormaps
    from matplotlib.colors import BoundaryNorm, LogNorm, SymLogNorm
    from matplotlib.ticker import MaxNLocator

    heats, scales = [panel.heat for panel in panels], dict[str, tuple[Any, Any, list[Any]]]()
    for axis, heat in zip(axes, heats, strict=False):
        if heat is not None:
            numbers = np.arange(heat.low, heat.top + 1) if heat.whole else np.zeros(0)
            colours = colormaps["YlOrRd"].resampled(max(len(numbers), 2)) if heat.whole else "RdBu_r" if heat.signed else "magma"
            norm = BoundaryNorm(np.append(numbers, heat.top + 1) - 0.5, len(numbers)) if heat.whole else \
                SymLogNorm(heat.low, vmin=-heat.top, vmax=heat.top) if heat.signed else LogNorm(heat.low, heat.top)
            values = heat.values if heat.signed or heat.whole else np.maximum(heat.values, heat.low)
            whole_x = np.array_equal(heat.x, np.rint(heat.x))  # such as numbers of belts
            beside = min(sum(map(bool, heats)), axis.get_subplotspec().get_gridspec().ncols)
            axis.xaxis.set_major_locator(MaxNLocator(12 // beside, integer=whole_x))  # few enough that all labels have room
            mesh = axis.pcolormesh(heat.x, heat.y, values, norm=norm, cmap=colours, shading="nearest", rasterized=True)
            decades = 10.0 ** np.arange(np.ceil(np.log10(10 * heat.low)), np.log10(heat.top)) if heat.low else numbers
            ticks = numbers[::-(-len(numbers) // 12)] if heat.whole else [*-decades, 0.0, *decades] if heat.signed else None
            scales.setdefault(heat.label, (mesh, ticks, []))[2].append(axis)
            if np.any(heat.hatched):
                axis.contourf(heat.x, heat.y, np.asarray(heat.hatched, dtype=float), [0.5, 1.5], colors="none", hatches=["////"])
                axis.fill([], [], fill=False, hatch="////", label="undecided")
    for label, (mesh, ticks, those) in scales.items():
        figure.colorbar(mesh, ax=those, label=label, ticks=ticks)


def few_decades(axis: Any) -> None:
    """Puts ticks at 1, 2 and 5 of each decade where a logarithmic x axis spans less than two; minor ticks have no labels."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    lo, hi = axis.get_xlim()
    if hi < 100 * lo:
        # within a factor of 5 there may be fewer than two such ticks: LogLocator then takes evenly spaced ones, of any number
        axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)) if hi > 5 * lo else MaxNLocator(4, steps=[1, 2, 5, 10]))
        axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())


def legend_below(figure: Any, axes: Iterable[Any], columns: int = 4) -> None:
    """Draws one legend for all axes, below them, with each label once."""
    lines: dict[str, Any] = {}
    colours: dict[str, set[Any]] = {}
    for line, label in ((line, label) for axis in axes for line, label in zip(*axis.get_legend_handles_labels(), strict=True)):
        lines[label] = line
        colours.setdefault(label, set()).add(getattr(line, "get_color", str)())
    for label in (label for label, found in colours.items() if len(found) > 1):
        line, lines[label] = lines[label], _matplotlib().lines.Line2D([], [])
        lines[label].update_from(line)
        lines[label].set(color=MANY, markeredgecolor=MANY)  # the name stands for lines of several colours
        if line.get_markerfacecolor() != "none":
            lines[label].set_markerfacecolor(MANY)
    if lines:
        figure.legend(lines.values(), lines.keys(), loc="outside lower center", ncols=min(columns, len(lines)))


def rounding_below(axis: Any, errors: Iterable[float]) -> None:
    """Sets the limits of an axis of errors, with a grey band for rounding errors if there are any."""
    known = [max(error, ROUNDING) for error in errors if np.isfinite(error)]
    lo, hi = min(known, default=1e-3), max(known, default=1.0)
    low, high = 10 ** np.floor(np.log10(lo / 2)), 10 ** np.ceil(np.log10(hi * 2))
    axis.set(yscale="log", ylim=(low, high))
    if high < 1e4 * low:
        from matplotlib.ticker import NullFormatter

        axis.yaxis.set_minor_formatter(NullFormatter())
    if lo == ROUNDING:
        axis.axhspan(low, 2 * lo, color="0.88", lw=0, label="rounding")


def label_points(figure: Any, labels: Sequence[tuple[Any, float, float, str, str]]) -> None:
    """Puts texts beside points: (axis, x, y, text, colour). A text covers no mark and no other text, and is clearly nearer to its
    own point than to other points of its colour. A text that finds no such place is left out.

    The first texts are placed first. They appear when the figure is drawn, since its layout fixes the places of axes only then.
    """
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    class Labelled(ConstrainedLayoutEngine):
        waiting = labels

        def execute(self, fig: Any) -> None:
            super().execute(fig)
            for axis in dict.fromkeys(label[0] for label in self.waiting):
                _put_labels(axis, [label[1:] for label in self.waiting if label[0] is axis], fig.dpi / 72)
            self.waiting = ()

    figure.set_layout_engine(Labelled())


def _put_labels(axis: Any, labels: Sequence[tuple[float, float, str, str]], pixels: float) -> None:
    """Puts the labels (x, y, text, colour) of one axis; a typographic point has `pixels` pixels."""
    from matplotlib.patheffects import withStroke
    from matplotlib.transforms import Bbox

    def box_at(x: float, y: float, wide: float, high: float) -> Bbox:
        return Bbox.from_bounds(x - wide / 2, y - high / 2, wide, high)

    frame = axis.get_window_extent().padded(-2 * pixels)
    lines = [(line, line.get_transform().transform(np.column_stack(line.get_data()))) for line in axis.lines]
    marks = [(*mark, (line.get_markersize() + 2) * pixels) for line, found in lines
             if line.get_marker() not in ("None", "none", "", None) for mark in found]
    # points some 2 typographic points apart on the visible lines; none where a line has a gap or leaves the page
    points = [np.zeros((0, 2))]
    for line, corners in lines:
        for one, other in pairwise(corners if line.get_linestyle() not in ("None", "none", "", None) else ()):
            if np.isfinite([one, other]).all() and (length := float(np.abs(other - one).max())) < 1e5:
                points.append(one + np.linspace(0.0, 1.0, int(length / (2 * pixels)) + 2)[:, None] * (other - one))
    crossed = np.concatenate(points)
    taken = [box_at(x, y, size, size) for x, y, size in marks]
    taken += [text.get_window_extent() for text in axis.texts]
    mine = [(axis.transData.transform((x, y)), text, colour) for x, y, text, colour in labels]

    def place(x: float, y: float, text: str, colour: str, sides: Iterable[tuple[float, float]]) -> bool:
        """Puts a text at one of these sides of its mark; False if none has room."""
        wide, high = (0.62 * len(text) * SIZES.number + 1) * pixels, SIZES.number * pixels
        at = axis.transData.transform((x, y))
        others = [spot for spot, word, shade in mine if word != text and shade == colour
                  and np.hypot(*(spot - at)) > SIZES.touching * pixels]  # of coincident marks none can be nearer to its text
        free: list[tuple[int, int, Any, Bbox]] = []
        for right, up in sides:
            gap = (4.0 if right and abs(up) == 1 else 6.5) * pixels
            shift = np.array([right * (gap + wide / 2), up * (gap + high / 2 if abs(up) == 1 else high)])
            box = box_at(at[0] + shift[0], at[1] + shift[1], wide, high)
            if up and any(box.y0 < other[1] < box.y1 for other in others):
                continue  # at the height of another mark it would be read as the label of that mark's bar
            if all(frame.fully_contains(*corner) for corner in (box.p0, box.p1)) and not box.count_overlaps(taken) \
                    and all(SIZES.clearly * _gap(box, at) <= _gap(box, other) for other in others):
                inside = ((crossed > box.p0) & (crossed < box.p1)).all(axis=1)
                under = int((inside & (np.abs(crossed[:, 1] - at[1]) > 1)).sum())
                free.append((under, len(free), shift, box))
        if free:  # at the side where it covers the least of the lines, not counting a bar through its own mark
            _, _, shift, box = min(free, key=lambda one: one[:2])
            axis.annotate(text, (x, y), tuple(shift / pixels), textcoords="offset points", fontsize=SIZES.number, color=colour,
                          ha="center", va="center", zorder=6, path_effects=[withStroke(linewidth=2, foreground="white")])
            taken.append(box)
        return bool(free)

    waiting = labels
    for sides in SIDES:
        waiting = [label for label in waiting if not place(*label, sides)]


def _gap(box: Any, point: Any) -> float:
    """The distance of a point from a box, 0 inside."""
    return float(np.hypot(*np.maximum(0.0, np.maximum(box.p0 - point, point - box.p1))))


def _matplotlib() -> Any:
    found = [package(f"matplotlib{name}", "figures need matplotlib", "matplotlib", otherwise=" (--no-figures draws none)")
             for name in ("", ".backends.backend_agg", ".figure", ".lines", ".text", ".ticker")]
    return found[0]
