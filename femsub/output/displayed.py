"""The base class of results that can be shown: a chart, tables, and both in a notebook."""

from __future__ import annotations

import base64
import io
from html import escape
from typing import Any

from femsub.checks import InputError, package
from femsub.output.charts import Chart
from femsub.output.figures import draw, figure_of
from femsub.output.tables import Table
from femsub.output.units import SYSTEMS, UNKNOWN, Units


class Displayed:
    """A result with a `chart`, with `tables`, or with both. It holds no data of its own."""

    def chart(self) -> Chart | None:
        """Its chart as a value; None where there is nothing to draw."""
        return None

    def tables(self) -> list[Table]:
        """Its tables, the most important one first; those without rows are left out."""
        return []

    def plot(self, *, units: Any = "", **how: Any) -> Any:
        """A figure of matplotlib: notebooks show it, `savefig("name.png")` writes it.

        Parameters
        ----------
        units : str or mapping
            The units of the model's numbers: 'SI', 'mm-t-s', or names such as {"length": "mm", "time": "s", "mass": "t"}. Where
            the unit of time is the second, each axis in rad/s has an axis in Hz on its other side.
        **how
            The keywords of `chart`.

        Raises
        ------
        InputError
            The units are unknown, or there is nothing to draw.
        MissingPackageError
            matplotlib is not installed.
        """
        chart = self.chart(**how)
        if chart is None or not chart.drawn:
            raise InputError(f"{self!r} has nothing that can be drawn")
        return figure_of(lambda: draw(chart), units_of(units))

    def to_frame(self, table: str = "", *, units: Any = "") -> Any:
        """One of the `tables`, by default the first, as a data frame of pandas.

        For `units` see `plot`. Where the unit of time is the second, a column in Hz follows each column in rad/s.

        Raises
        ------
        InputError
            No table has this name, or the units are unknown.
        MissingPackageError
            pandas is not installed.
        """
        pandas = package("pandas", "data frames need pandas", "pandas")
        known = {one.name: one for one in self.tables()}
        if not known or table not in ("", *known):
            raise InputError(f"table is one of {', '.join(map(repr, known)) or 'none: there are no rows'}, not {table!r}")
        chosen = known[table or next(iter(known))]
        rows = units_of(units).with_hertz(chosen.filed)
        return pandas.DataFrame(rows, columns=list(dict.fromkeys(key for row in rows for key in row)))

    def _repr_html_(self) -> str:
        """For notebooks: the result's `repr`, its tables and its figure."""
        parts = [f"<p>{escape(repr(self))}</p>", *(one._repr_html_() for one in self.tables())]
        chart = self.chart()
        if chart is not None and chart.drawn:
            parts.append(picture(figure_of(lambda: draw(chart)), chart.title))
        return "\n".join(parts)


def picture(figure: Any, words: str) -> str:
    """HTML of a figure as an inlined PNG, with `words` as its alternative text."""
    file = io.BytesIO()
    figure.canvas.print_png(file)
    return f'<img alt="{escape(words)}" src="data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}">'


def units_of(units: Any) -> Units:
    """`Units` from the name of a system, from a mapping to names of units, or as given.

    Raises
    ------
    InputError
        No system has this name.
    """
    if isinstance(units, Units):
        return units
    if isinstance(units, str) and units not in ("", *SYSTEMS):
        raise InputError(f"units is one of {', '.join(map(repr, SYSTEMS))}, or a mapping of length, time and mass to names, not "
                         f"{units!r}")
    return Units.of(units) if units else UNKNOWN
