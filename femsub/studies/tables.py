"""Tables and texts on the terminal."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np

WIDTH = 100  # columns of a terminal that every table fits
GAP = "  "  # between columns
NONE = "-"  # where there is no value


def table(head: Sequence[str], rows: Sequence[Sequence[Any]], formats: Sequence[str], hertz: Sequence[str] = (), keys: int = 1,
          none: str = "") -> str:
    """Columns aligned to the right, the first to the left; None and NaN are a dash.

    `hertz` names the columns in rad/s that have one in Hz beside them. A table of more than WIDTH columns has its heads broken
    into lines; if that is not enough, its last columns stand below the others, beside the first `keys` again. `none` says what a
    dash stands for, in a line below a table that has one.
    """
    for name in hertz:
        at = list(head).index(name) + 1
        head, formats = [*head[:at], "Hz", *head[at:]], [*formats[:at], formats[at - 1], *formats[at:]]
        rows = [[*row[:at], None if row[at - 1] is None else row[at - 1] / (2 * np.pi), *row[at:]] for row in rows]
    body = [[_cell(value, form) for value, form in zip(row, formats, strict=True)] for row in rows]
    wide = [max((len(row[at]) for row in body), default=0) for at in range(len(head))]
    heads = [[text] for text in head]
    if _total(heads, wide) > WIDTH:
        heads = [textwrap.wrap(text, max(least, 1), break_long_words=False, break_on_hyphens=False)
                 for text, least in zip(head, wide, strict=True)]
    wide = [max(least, *map(len, lines)) for lines, least in zip(heads, wide, strict=True)]
    parts = []
    for block in _blocks(wide, keys):
        high = max(len(heads[at]) for at in block)
        lines = [[([""] * high + heads[at])[line - high] for at in block] for line in range(high)]
        lines += [["-" * wide[at] for at in block], *([row[at] for at in block] for row in body)]
        parts.append("\n".join(GAP.join(cell.rjust(wide[at]) if at else cell.ljust(wide[at])
                                        for at, cell in zip(block, line, strict=True)).rstrip() for line in lines))
    if none and any(NONE in row for row in body):
        parts[-1] += f"\n{NONE}  {none}"
    return "\n\n".join(parts)


def _cell(value: Any, form: str) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return NONE
    return value if isinstance(value, str) else format(value, form)


def _total(heads: Sequence[Sequence[str]], wide: Sequence[int]) -> int:
    return sum(max(least, *map(len, lines)) for lines, least in zip(heads, wide, strict=True)) + len(GAP) * (len(wide) - 1)


def _blocks(wide: Sequence[int], keys: int) -> list[list[int]]:
    """Columns that stand side by side, each time with the first `keys`."""
    blocks: list[list[int]] = [list(range(keys))]
    for at in range(keys, len(wide)):
        if sum(wide[one] + len(GAP) for one in [*blocks[-1], at]) - len(GAP) > WIDTH and len(blocks[-1]) > keys:
            blocks.append(list(range(keys)))
        blocks[-1].append(at)
    return blocks


def fitted(text: str) -> str:
    """A text with its lines of more than WIDTH columns broken at blanks; the lines that follow are set in."""
    return "\n".join(line if len(line) <= WIDTH else textwrap.fill(
        line, WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False) for line in text.split("\n"))


def yes_no(value: bool | None) -> str:
    """A verdict: 'yes', 'no', or '?' where error bars leave it undecided."""
    return {True: "yes", False: "no", None: "?"}[value]
