"""Tables of results: rows, and definitions of their columns. Terminal, files and pages use this one definition."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import Any, NamedTuple

import numpy as np

WIDTH = 80  # columns of a terminal that every table fits
GAPS = ("  ", " ")  # between columns; the narrow one where a table fits only with it
NONE = "-"  # where there is no value
RATE = "rad/time"  # where the unit of time is known, a column of this unit has a column in Hz beside it


class Look(NamedTuple):
    """How a model is named and drawn."""

    label: str
    colour: str
    marker: str


#: looks of reduced models, by the keys of their methods; each method adds its own look
LOOKS = {"contact-modes": Look("Contact modes", "#c51b7d", "*"), "real-modes": Look("Real modes", "#8a8a8a", "o")}


def look(model: Any) -> Look:
    """The look of a reduced model, by its method's key. Others, such as 'full', have their key as name and black circles."""
    return LOOKS.get(model, Look(str(model), "black", "o"))


def label(model: Any) -> str:
    """The name of a reduced model, by its method's key; for another model, such as 'full', the key itself."""
    return look(model).label


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes
    ----------
    key : str
        Key of the values in the rows, and name of the column in files.
    head : str
        Heading.
    form : str
        Format of the printed values, as for `format`. A column without a format is not printed: it is in files and on the page.
    unit, meaning : str
        Unit, and tooltip of the heading on a page.
    role : str
        'model': keys of methods, shown as names. 'modes': numbers that the full model does not have. 'verdict': yes, no, or ?
    cell : callable, optional
        Row → printed value, where this is not the value itself.
    """

    key: str
    head: str = ""
    form: str = ""
    unit: str = ""
    meaning: str = ""
    role: str = ""
    cell: Callable[[Mapping[str, Any]], Any] | None = None

    def printed(self, row: Mapping[str, Any]) -> Any:
        """The value of a row as the terminal shows it."""
        value = self.cell(row) if self.cell else row.get(self.key)
        if self.role == "modes":
            return None if row.get("model", row.get("method")) == "full" else value
        if self.role == "model":
            return label(value)
        return {True: "yes", False: "no", None: "?"}[value] if self.role == "verdict" else value


#: columns of several tables
KNOWN = {one.key: one for one in (
    *(Column(key, "model", "s", "", "the full model, or the method of reduction", "model") for key in ("model", "method")),
    Column("modes", "modes", "d", "", "modes kept in the basis", "modes"),
    Column("size", "DOF", "d", "", "degrees of freedom of the model"),
    Column("mode", "mode", "d"),
    Column("part", "part", "s"),
    Column("interface", "interface", "d"),
    Column("error_eigenvalue", "err λ", ".1e", "", "largest error of a complex eigenvalue, over its modulus"),
    Column("error_growth", "err Re λ", ".1e", "", "largest error of a growth rate, over the rates of damping and friction"),
    Column("critical", "critical", ".6g", "", "where stability is first lost: the slope, or another parameter"),
    Column("error_critical", "err critical", ".1e", "", "relative error of the critical slope, or of another parameter"),
    Column("error_real", "err Re λ, over |λ|", ".1e", "", "largest error of Re λ, over |λ|"),
    Column("error_frequency", "err ω", ".1e", "", "largest relative error of an undamped frequency"),
    Column("error_response", "err h", ".1e", "", "bound of the error of the receptance, relative to the largest one"),
    Column("error_held", "err ω held", ".1e", "", "largest error of an undamped frequency, interface held at rest; or it "
           "lacks a mode", cell=lambda row: "lacks" if row["error_held"] == np.inf else row["error_held"]),
    Column("error_force", "err force", ".1e", "", "relative error of the forces in the joints"),
    Column("missing", "missing", "d", "", "eigenvalues of the full model that the small one lacks"),
    Column("extra", "extra", "d", "", "eigenvalues of the small model that the full one lacks"),
    Column("mac", "MAC", ".3f", "", "least agreement of the shapes; 1: the same"),
    Column("memory", "MB", ".3g", "", "size of the model's matrices"),
    *(Column(key, "stable", "s", "", "the verdict in the band; undecided within the error bars: no value", "verdict")
      for key in ("stable", "is_stable")),
    Column("pareto", "front", "s", "", "no other model is both as fast and as accurate in Re λ"),
    Column("reduction_median_s", "reduce [s]", ".2g", "s", "time to reduce, median of the runs"),
    Column("solution_median_s", "solve [s]", ".2g", "s", "time to solve, median of the runs"),
    Column("counted", "count", "d", "", "eigenvalues up to that frequency"),
    Column("full_counted", "in full", "d", "", "eigenvalues of the full model up to that frequency"),
    Column("growth", "Re λ", ".6g", "1/time", "largest growth rate; above 0 a motion grows"),
    Column("full_growth", "in full", ".6g", "1/time", "the growth rate of the full model",
           cell=lambda row: row["full_growth"] if np.isfinite(row["full_growth"]) else None),
    Column("omega", "ω", ".6g", RATE, "angular frequency"),
    *(Column(key, "f [Hz]", ".6g", "Hz", "frequency") for key in ("hertz", "frequency_hz")),
    Column("up_to", "up to ω", ".5g", RATE, "end of the comparison: the band's, or the model's cut-off"),
    Column("cutoff", "cut-off ω", ".5g", RATE, "above it the reduced model's modes are meaningless"),
    Column("slope", "slope dμ/dv", ".6g", "time/length", "critical slope, or the slope of the friction law",
           cell=lambda row: "never" if row["slope"] == -np.inf else row["slope"]),
    Column("full", "full model", ".6g", "", "the full model's value",
           cell=lambda row: "never" if row["full"] == -np.inf else row["full"]),
    Column("error", "rel. error", ".1e", "", "error relative to the full model, or to the closed form"),
    Column("port_error", "static port error", ".1e", "", "error of the static response at the contact, in the energy norm"),
    Column("error_bar", "error bar", ".0e", "1/time", "bound of the error of Re λ from rounding"),
    Column("residual", "residual", ".0e", "", "relative residual"),
    Column("backward_error", "backward error", ".0e", "", "relative residual of the equation; 1e-16 is rounding"),
    Column("belt", "belt", "d", "", "number of the mass under the belt"),
    *(Column(key, "why not", "s", "", "why there is no value") for key in ("reason", "why")),
    Column("shape_error", "shape error", ".1e", "", "sine of the angle between the least stable shapes, in the norm of M"),
    Column("family", "from ω", ".4g", RATE, "frequency of the mode from which the cycle begins"),
    Column("rms", "rms of v", ".5g", "length/time", "rms of the speed under the belt"),
    Column("peak", "peak of v", ".5g", "length/time", "largest speed under the belt"),
    Column("sticking", "sticking", ".1%", "", "share of the time in which it sticks"),
    Column("harmonics", "harmonics", "d", "", "harmonics of the cycle"),
    Column("truncation", "truncation", ".0e", "", "error by the harmonics that are left out, relative to v"),
    Column("multiplier", "multiplier", ".4g", "", "largest Floquet multiplier; inside the unit circle: stable",
           cell=lambda row: None if row["multiplier"] is None else abs(row["multiplier"])),
    Column("missed", "missed", "d", "", "unstable modes of the full model that are stable in the small one"),
    Column("invented", "invented", "d", "", "unstable modes of the small model that are stable in the full one"),
    Column("springs", "springs", ".3g", "", "stiffness of the springs over that of the interface"),
    Column("damping", "damping [%]", ".3g", "%", "damping ratio, -Re λ / |λ| in %; below 0 a motion grows"),
    Column("seconds", "seconds", ".2g", "s", "time of the computation"),
    Column("steps", "steps", "d", "", "steps of the integration"),
    Column("energy_residual", "energy balance", ".0e", "", "energy lost or gained by the integration, over that exchanged"),
    Column("evidence", "evidence", "s", "", "how completeness was shown"))}


def column(key: str, head: str = "", form: str = "", **others: Any) -> Column:
    """The column of `KNOWN` with this key, or a new column, with `head`, `form` and the attributes in `others` replaced."""
    known = KNOWN.get(key, Column(key, key.replace("_", " ")))
    if key.endswith("_hz") and key not in KNOWN:
        known = replace(column(key[:-3]), key=key, unit="Hz", cell=None)
        known = replace(known, head=f"{known.head.removesuffix(' ω')} [Hz]")
    return replace(known, head=head or known.head, form=form or known.form, **others)


@dataclass(frozen=True)
class Table:
    """Rows, and the columns that are printed. Files and pages also have columns for the other keys of the rows.

    Attributes
    ----------
    name : str
        Name of its CSV file; a table without a name is only printed.
    rows : sequence of mappings
    columns : sequence of Column or str
        Printed columns; a str is a key of `KNOWN`. Without columns nothing is printed.
    title : str
    keys : int
        Number of first columns that are repeated where a wide table continues below itself.
    none : str
        Meaning of a dash.
    most : int, optional
        Largest number of printed rows.
    only : sequence of str
        Keys that files have; empty: all keys.
    """

    name: str
    rows: Sequence[Mapping[str, Any]]
    columns: Sequence[Any] = ()
    title: str = ""
    keys: int = 1
    none: str = ""
    most: int | None = None
    only: Sequence[str] = ()

    @property
    def every(self) -> list[Column]:
        """All columns, in the order of the rows' keys."""
        own = {one.key: one for one in self._printed}
        return [own[key] if key in own else replace(column(key), form="")
                for key in self.only or dict.fromkeys(key for row in self.rows for key in row)]

    @property
    def filed(self) -> Sequence[Mapping[str, Any]]:
        """The rows as files have them."""
        return [{key: row.get(key) for key in self.only} for row in self.rows] if self.only else self.rows

    @property
    def _printed(self) -> list[Column]:
        return [column(one) if isinstance(one, str) else one for one in self.columns]

    def text(self, hertz: bool = False) -> str:
        """The printed columns; with `hertz`, each column in rad/time has a column in Hz beside it."""
        shown = self._printed
        if not shown:
            return ""
        return table([one.head for one in shown], [[one.printed(row) for one in shown] for row in self.rows[:self.most]],
                     [one.form for one in shown], [one.head for one in shown if one.unit == RATE] if hertz else (), self.keys,
                     self.none)


    def _repr_html_(self) -> str:
        """For notebooks: the printed columns, or all columns if none is printed."""
        shown = self._printed or self.every
        cells = [[f"<th>{escape(one.head)}</th>" for one in shown], *(
            [f"<td>{escape(_cell(one.printed(row), one.form))}</td>" for one in shown] for row in self.rows[:self.most])]
        caption = f"<caption>{escape(self.title)}</caption>" if self.title else ""
        return f"<table>{caption}" + "".join(f"<tr>{''.join(row)}</tr>" for row in cells) + "</table>"


def grouped(rows: Iterable[Any], *keys: str) -> dict[Any, list[Any]]:
    """Rows by the value of a key (by a tuple of values for several keys), in order of appearance.

    For rows that are objects, keys are names of attributes.
    """
    found: dict[Any, list[Any]] = {}
    for row in rows:
        values = tuple(row[key] if isinstance(row, Mapping) else getattr(row, key) for key in keys)
        found.setdefault(values if len(keys) > 1 else values[0], []).append(row)
    return found


def span(band: Sequence[float]) -> str:
    """'0 to 31415.9 rad/time': with enough digits that a band up to 5000 Hz is shown as 5000 Hz."""
    return f"{band[0]:.6g} to {band[1]:.6g} rad/time"


def table(head: Sequence[str], rows: Sequence[Sequence[Any]], formats: Sequence[str], hertz: Sequence[str] = (), keys: int = 1,
          none: str = "") -> str:
    """The text of a table: the first column aligned to the left, the others to the right. None and NaN are a dash.

    `hertz` names the columns in rad/s that get a column in Hz beside them. If the text is wider than WIDTH characters, the
    headings are broken into lines, then columns are separated by one blank only. If that is not enough, the last columns are put
    below the others, after a repetition of the first `keys` columns. `none`, the meaning of a dash, is a line below a table that
    has dashes.
    """
    for name in hertz:
        at = list(head).index(name) + 1
        head, formats = [*head[:at], "Hz", *head[at:]], [*formats[:at], formats[at - 1], *formats[at:]]
        rows = [[*row[:at], None if row[at - 1] is None else (np.asarray(row[at - 1]) / (2 * np.pi)).tolist(), *row[at:]]
                for row in rows]
    body = [[_cell(value, form) for value, form in zip(row, formats, strict=True)] for row in rows]
    wide = [max((len(row[at]) for row in body), default=0) for at in range(len(head))]
    heads = [[text] for text in head]
    if sum(max(least, len(text)) for text, least in zip(head, wide, strict=True)) + len(GAPS[0]) * (len(wide) - 1) > WIDTH:
        heads = [textwrap.wrap(text, max(least, 1), break_long_words=False, break_on_hyphens=False)
                 for text, least in zip(head, wide, strict=True)]
    wide = [max(least, *map(len, lines)) for lines, least in zip(heads, wide, strict=True)]
    gap = next((one for one in GAPS if sum(wide) + len(one) * (len(wide) - 1) <= WIDTH), GAPS[0])
    blocks, parts = [list(range(keys))], []  # columns side by side; each block begins with the first `keys` columns
    for at in range(keys, len(wide)):
        if sum(wide[one] + len(gap) for one in [*blocks[-1], at]) - len(gap) > WIDTH and len(blocks[-1]) > keys:
            blocks.append(list(range(keys)))
        blocks[-1].append(at)
    for block in blocks:
        high = max(len(heads[at]) for at in block)
        lines = [[([""] * high + heads[at])[line - high] for at in block] for line in range(high)]
        lines += [["-" * wide[at] for at in block], *([row[at] for at in block] for row in body)]
        parts.append("\n".join(gap.join(cell.rjust(wide[at]) if at else cell.ljust(wide[at])
                                        for at, cell in zip(block, line, strict=True)).rstrip() for line in lines))
    if none and any(NONE in row for row in body):
        parts[-1] += f"\n{NONE}  {none}"
    return "\n\n".join(parts)


def _cell(value: Any, form: str) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return NONE
    if isinstance(value, list):
        return ", ".join(_cell(one, form) for one in value) or NONE
    return value if isinstance(value, str) else format(value, form)


def fitted(text: str) -> str:
    """A text whose lines of more than WIDTH characters are broken at blanks; the continuation lines are indented."""
    return "\n".join(line if len(line) <= WIDTH else textwrap.fill(
        line, WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False) for line in text.split("\n"))
