"""Results in files: JSON with every digit, and CSV."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from typing import Any, BinaryIO

import numpy as np

from femsub.checks import csv_cell


def to_json(data: Any) -> str:
    """JSON with every digit; arrays as lists, complex numbers as [re, im], NaN and Inf as null and strings."""
    return json.dumps(for_json(data), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def for_json(value: Any) -> Any:
    """A value of numbers, texts, lists and dicts only, as JSON has them; see `to_json`."""
    if isinstance(value, dict):
        return {str(key): for_json(item) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return for_json(value.tolist())
    if isinstance(value, (list, tuple)):
        return [for_json(item) for item in value]
    if isinstance(value, complex):
        return [for_json(value.real), for_json(value.imag)]
    if isinstance(value, float) and not np.isfinite(value):
        return None if np.isnan(value) else str(value)
    return value


def table_csv(rows: Sequence[dict[str, Any]], file: BinaryIO) -> None:
    """Writes CSV, a line for each row. Several values of one cell are separated by blanks."""
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    keys = list(dict.fromkeys(key for row in rows for key in row))
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([csv_cell(key) for key in keys])
    for row in rows:
        cells: list[Any] = []
        for value in (row.get(key, "") for key in keys):
            # Python's own numbers print every digit; those of NumPy follow its print options, which pyyeti changes
            if isinstance(value, np.generic):
                cells.append(value.item())
            elif isinstance(value, str):
                cells.append(csv_cell(value))
            elif isinstance(value, (list, tuple, np.ndarray)):
                found = np.ravel(value).tolist()
                cells.append((csv_cell if any(isinstance(one, str) for one in found) else str)(" ".join(map(str, found))))
            else:
                cells.append(value)
        writer.writerow(cells)
    text.detach()
