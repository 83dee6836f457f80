"""Tables on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np


def table(head: Sequence[str], rows: Sequence[Sequence[Any]], formats: Sequence[str], hertz: Sequence[str] = ()) -> str:
    """Columns aligned to the right, the first to the left; `hertz` names those in rad/s that have one in Hz beside them."""
    for name in hertz:
        at = list(head).index(name) + 1
        head, formats = [*head[:at], "Hz", *head[at:]], [*formats[:at], formats[at - 1], *formats[at:]]
        rows = [[*row[:at], None if row[at - 1] is None else row[at - 1] / (2 * np.pi), *row[at:]] for row in rows]
    cells = [list(head)] + [[format(value, form) if value is not None else "-" for value, form in zip(row, formats, strict=True)]
                            for row in rows]
    widths = [max(len(row[i]) for row in cells) for i in range(len(head))]
    lines = ["  ".join(cell.ljust(width) if i == 0 else cell.rjust(width)
                       for i, (cell, width) in enumerate(zip(row, widths, strict=True))) for row in cells]
    return "\n".join([lines[0], "  ".join("-" * width for width in widths), *lines[1:]])


def known(value: float) -> float | None:
    """The value, or None for NaN, which a table shows as "-"."""
    return None if np.isnan(value) else value
