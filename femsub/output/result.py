"""The result of a run: sentences, tables, charts, pictures and files, in the order in which they are shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from html import escape
from typing import Any, BinaryIO, TypeAlias

from femsub.output.charts import Chart
from femsub.output.displayed import picture
from femsub.output.figures import draw, figure_of, render
from femsub.output.files import table_csv
from femsub.output.tables import Table
from femsub.output.units import UNKNOWN, Units
from femsub.output.verdicts import Advice, Remark, answer, sentence

Writer: TypeAlias = Callable[[BinaryIO], object]


@dataclass(frozen=True)
class Picture:
    """A figure: the name of its file, without ending, and a function that draws it as a new matplotlib figure."""

    name: str
    draw: Callable[[], Any]


Shown: TypeAlias = Any  # str, Table, Chart or Picture


@dataclass(frozen=True)
class Result:
    """The result of a run, ready to be shown.

    Attributes
    ----------
    data : dict
        All figures that are printed or drawn, for results.json.
    shown : sequence of str, Table, Chart or Picture
        The output, in this order. Sentences and tables are printed; each table that has rows is also a CSV file. Each chart and
        each picture is a PNG file. A page shows tables and charts.
    files : dict of str to callable
        File name to a function that writes the file's content. The name may include a subfolder of the results. The functions
        are called only where there is a folder to write to.
    head : sequence
        The first items of `shown`: they describe the model.
    notes : dict of str to str
        Notes below the titles of figures, by the figures' names.
    """

    data: dict[str, Any]
    shown: Sequence[Shown] = ()
    files: dict[str, Writer] = field(default_factory=dict)
    head: Sequence[Shown] = ()
    notes: Mapping[str, str] = field(default_factory=dict)

    @property
    def tables(self) -> dict[str, Table]:
        """The tables that have rows and a name, by this name of their CSV files."""
        return {one.name: one for one in self.shown if isinstance(one, Table) and one.name and one.rows}

    @property
    def drawings(self) -> dict[str, Callable[[], Any]]:
        """File names (without ending) to functions that draw a new matplotlib figure."""
        return {chart.name: partial(draw, chart) for chart in self.charts if chart.drawn} | {
            one.name: one.draw for one in self.shown if isinstance(one, Picture)}

    @property
    def charts(self) -> list[Chart]:
        """All charts of `shown`."""
        return [one for one in self.shown if isinstance(one, Chart)]

    def text(self, units: Units = UNKNOWN) -> str:
        """All sentences and printed tables, in these units."""
        return units.said("\n".join(one if isinstance(one, str) else one.text(units.known) for one in self.shown
                                    if isinstance(one, str) or (isinstance(one, Table) and one.columns)))

    def printed(self, units: Units = UNKNOWN, whole: bool = False) -> str:
        """The verdict, and the short table of each comparison. With `whole`, or if nothing was compared, all tables."""
        verdict = answer(self.shown)
        choices = [one for one in self.shown if isinstance(one, Advice)]
        parts = [verdict.text] if verdict.decided else []
        if whole or not choices:
            parts.append(self.text(units))
        else:
            parts.append(Result({}, self.head).text(units))
            parts += [f"{one.where.capitalize()}\n{one.brief}" if one.where else one.brief for one in choices]
        decides = verdict.decides if whole or not choices else [
            line for one in self.shown if isinstance(one, Remark) for line in one.decides
            if one not in choices or line.startswith("Mind")]
        if not whole:  # where no model is accurate enough, the sentence of the advice says what to do
            decides = [*(sentence(one.sentence, one.where) for one in choices if not one.model), *decides]
        lists = [("What decides it", decides), ("Not checked", verdict.unchecked if whole else ())]
        parts += ["\n".join([f"{title}:", *(f"- {line}" for line in dict.fromkeys(lines))]) for title, lines in lists if lines]
        if choices and not whole:
            parts.append(f"All tables ({len(self.tables)}): -v prints them, --out DIR writes them.")
        return units.said("\n\n".join(filter(None, parts)))

    def writers(self, figures: bool = True, units: Units = UNKNOWN) -> dict[str, Writer]:
        """Functions that write the files of the result, by file name: a CSV file per table, the figures, and `files`."""
        found: dict[str, Writer] = {f"{name}.csv": partial(table_csv, units.with_hertz(one.filed))
                                    for name, one in self.tables.items()}
        if figures:
            found |= {f"{name}.png": partial(render, make, units=units, note=self.notes.get(name, ""))
                      for name, make in self.drawings.items()}
        return found | self.files

    def record(self, units: Units = UNKNOWN) -> dict[str, Any]:
        """The content of results.json: data, meaning of the tables' columns, charts and verdict.

        Where the units are known, each frequency in rad/s has its value in Hz beside it.
        """
        tables = {}
        for name, one in self.tables.items():
            place, rows = _place(self.data, one.rows), units.with_hertz(one.filed)
            tables[name] = {"title": units.said(one.title), "columns": [
                {"key": at.key, "head": units.said(at.head), "unit": units.said(at.unit), "meaning": at.meaning, "role": at.role}
                for at in replace(one, rows=rows, only=()).every], **({"place": place} if place else {"rows": rows})}
        undone = [f"The ask {name} failed: {reason}." for name, reason in self.data.get("failed", {}).items()]
        if not self.data.get("complete", True):
            undone.append("The run was interrupted. Later asks are missing.")
        charts = [units.with_hertz(chart.plain(units.known)) for chart in self.charts]
        return {**units.with_hertz(self.data), "tables": tables, "charts": [one for one in charts if one["places"]],
                "verdict": answer([*self.shown, Remark(unchecked=undone)]).said(units.said)}

    def _repr_html_(self) -> str:
        """For notebooks: sentences, tables, charts and pictures, in their order."""
        parts: list[str] = []
        for one in self.shown:
            if isinstance(one, str):
                parts.append(f"<p>{escape(one)}</p>")
            elif isinstance(one, Table):
                parts.append(one._repr_html_())
            elif isinstance(one, (Chart, Picture)) and one.name in self.drawings:
                parts.append(picture(figure_of(self.drawings[one.name]), one.name))
        return "\n".join(filter(None, parts))


def _place(data: Mapping[str, Any], rows: Any) -> list[str]:
    """The keys in `data` that lead to the rows of a table; none if `data` does not contain these rows."""
    for key, value in data.items():
        if value is rows:
            return [key]
        if isinstance(value, dict) and (found := _place(value, rows)):
            return [key, *found]
    return []
