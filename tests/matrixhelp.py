"""For the tests of matrix files: text as Abaqus and CalculiX write it, and matrices equal to the last digit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

import femsub as fs


def same(first: Any, second: Any) -> None:
    """Equal to the last digit, sparse where it was sparse."""
    assert sp.issparse(first) == sp.issparse(second) and first.shape == second.shape
    assert abs(first - second).max() == 0


def abaqus(path: Path, matrix: Any, dofs: fs.DofMap, triangle: Callable[..., Any] | None = sp.tril) -> Path:
    """As *MATRIX OUTPUT, FORMAT=MATRIX INPUT writes it."""
    entries = sp.coo_array(triangle(matrix) if triangle else matrix)
    text = "".join(f"{dofs.nodes[i]},{dofs.components[i] + 1}, {dofs.nodes[j]},{dofs.components[j] + 1}, {value:.17e}\n"
                   for i, j, value in zip(entries.row, entries.col, entries.data, strict=True))
    path.write_text(text, encoding="ascii")
    return path


def numbered(path: Path, matrix: Any, triangle: Callable[..., Any] | None, form: str = "%.17e") -> Path:
    """As FORMAT=COORDINATE and CalculiX' matrixstorage.c ('%d %d %20.13e') write it."""
    entries = sp.coo_array(triangle(matrix) if triangle else matrix)
    order = np.lexsort((entries.row, entries.col))
    lines = (f"{entries.row[k] + 1} {entries.col[k] + 1} {form % entries.data[k]}\n" for k in order)
    path.write_text("".join(lines), encoding="ascii")
    return path
