"""What a scene has computed: sentences, tables, charts, pictures and files, in the order in which they are shown.

Kinds take their words from here: `Table`, `column`, `Remark`, and `studies` with the charts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from html import escape
from typing import Any, NamedTuple, TypeAlias

from femsub import studies as studies
from femsub.io import Writer
from femsub.output import (
    UNKNOWN,
    Chart as Chart,
    Table as Table,
    Units,
    column as column,
    draw,
    figure_of,
    label as label,
    picture,
    span as span,
)
from femsub.studies import (
    NEVER as NEVER,
    Advice as Advice,
    Remark as Remark,
    Verdict as Verdict,
    named as named,
    sentence as sentence,
)

Progress = Callable[[str], None]


class Picture(NamedTuple):
    """A figure: the name of its file, without ending, and a function that draws it onto a new matplotlib figure."""

    name: str
    draw: Callable[[], Any]


Shown: TypeAlias = Any  # str, Table, Chart or Picture


@dataclass(frozen=True)
class Result:
    """What a scene has computed, ready to be shown.

    Attributes
    ----------
    data : dict
        Everything printed or drawn, for results.json.
    shown : sequence of str, Table, Chart or Picture
        What is shown, in this order: sentences; tables, which are printed and have a CSV file each if they have rows; charts
        and pictures, each a PNG file. A page has tables and charts.
    files : dict of str to callable
        File name, which may name a folder below that of the results, to a function that writes the file's content. Called
        only where there is a folder to write to.
    head : sequence
        The first of `shown`, which say what the model is.
    notes : dict of str to str
        What stands at the foot of figures, by their names.
    """

    data: dict[str, Any]
    shown: Sequence[Shown] = ()
    files: dict[str, Writer] = field(default_factory=dict)
    head: Sequence[Shown] = ()
    notes: Mapping[str, str] = field(default_factory=dict)

    @property
    def tables(self) -> dict[str, Table]:
        """Those with rows by the names of their files."""
        return {one.name: one for one in self.shown if isinstance(one, Table) and one.name and one.rows}

    @property
    def drawings(self) -> dict[str, Callable[[], Any]]:
        """File names (without ending) to functions that draw onto a new matplotlib figure."""
        return {chart.name: partial(draw, chart) for chart in self.charts if chart.drawn} | {
            one.name: one.draw for one in self.shown if isinstance(one, Picture)}

    @property
    def charts(self) -> list[Chart]:
        """Those for a page."""
        return [one for one in self.shown if isinstance(one, Chart)]

    def text(self, units: Units = UNKNOWN) -> str:
        """All sentences and tables."""
        return units.said("\n".join(one if isinstance(one, str) else one.text(units.known) for one in self.shown
                                    if isinstance(one, str) or (isinstance(one, Table) and one.columns)))

    def printed(self, units: Units = UNKNOWN, whole: bool = False) -> str:
        """The verdict, then the short table of each comparison, or, with `whole` or where nothing was compared, all tables."""
        verdict = studies.answer(self.shown)
        choices = [one for one in self.shown if isinstance(one, studies.Advice)]
        parts = [verdict.text] if verdict.decided else []
        if whole or not choices:
            parts.append(self.text(units))
        else:
            parts.append(Result({}, self.head).text(units))
            parts += [f"{one.where.capitalize()}\n{one.brief}" if one.where else one.brief for one in choices]
        decides = verdict.decides if whole or not choices else [
            line for one in self.shown if isinstance(one, studies.Remark) for line in one.decides
            if one not in choices or line.startswith("Mind")]
        if not whole:  # where no model will do, its sentence says what to do
            decides = [*(studies.sentence(one.sentence, one.where) for one in choices if not one.model), *decides]
        lists = [("What decides it", decides), ("Not checked", verdict.unchecked if whole else ())]
        parts += ["\n".join([f"{title}:", *(f"- {line}" for line in dict.fromkeys(lines))]) for title, lines in lists if lines]
        if choices and not whole:
            parts.append(f"All tables ({len(self.tables)}): -v prints them, --out DIR writes them.")
        return units.said("\n\n".join(filter(None, parts)))

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
