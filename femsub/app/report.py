"""Results on the terminal and in a folder: written to temporary files first, then renamed."""

from __future__ import annotations

import csv
import io
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

import femsub
from femsub.app.scene import Result
from femsub.app.units import UNKNOWN, Units
from femsub.errors import InputError
from femsub.io.atomic import Writer, write_whole


def check_folder(folder: str | None) -> Path | None:
    """The output folder if it can be written; it is made when there is something to put into it.

    Raises
    ------
    InputError
        It, or the folder it would be made in, cannot be written.
    """
    if folder is None:
        return None
    if not folder:
        raise InputError("--out needs the name of a folder; it is empty")
    path = Path(folder)
    existing = path
    while not os.path.lexists(existing):
        existing = existing.parent
    if not existing.is_dir():
        raise InputError(f"the output folder {folder} cannot be written: {existing} is not a folder")
    try:
        tempfile.TemporaryFile(dir=existing).close()
    except OSError as error:
        raise InputError(f"the output folder {folder} cannot be written: {error.strerror or error} ({existing})") from None
    return path


def write(result: Result, folder: Path, figures: bool, name: str = "results", units: Units = UNKNOWN,
          notes: Mapping[str, str] | None = None) -> list[Path]:
    """name.json, a CSV file for each table, the figures and the scene's own files, each whole or not at all; what was written.

    `units` are those that figures are drawn in, `notes` what stands at the foot of some, by name.
    """
    writers: dict[str, Writer] = {f"{name}.json": lambda file: file.write(to_json(data).encode())}
    writers |= {f"{table}.csv": partial(_csv, rows) for table, rows in result.tables.items() if rows}
    if figures and result.drawings:
        from femsub.app.figure_style import render

        writers |= {f"{title}.png": partial(render, draw, units=units, note=(notes or {}).get(title, ""))
                    for title, draw in result.drawings.items()}
    writers |= result.files
    data = result.data | {"written": list(writers)}
    try:
        return write_whole(folder, writers)
    except OSError as error:
        raise InputError(f"the output folder {folder} cannot be written: {error.strerror or error}") from None


def in_units(result: Result, units: Units) -> Result:
    """A result with Hz beside rad per unit of time where the units are known."""
    tables = {name: units.with_hertz(rows) for name, rows in result.tables.items()}
    return replace(result, data=units.with_hertz(result.data), tables=tables, text=units.said(result.text))


def to_json(data: Any) -> str:
    """JSON with every digit; arrays as lists, complex numbers as [re, im], NaN and Inf as null and strings."""
    return json.dumps(_plain(data), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, complex):
        return [_plain(value.real), _plain(value.imag)]
    if isinstance(value, float) and not np.isfinite(value):
        return None if np.isnan(value) else str(value)
    return value


def _csv(rows: Sequence[dict[str, Any]], file: BinaryIO) -> None:
    """A line for each row; several values in one cell stand with blanks between them."""
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    writer = csv.DictWriter(text, list(dict.fromkeys(key for row in rows for key in row)), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({key: _cell(value) for key, value in row.items()})
    text.detach()


def _cell(value: Any) -> Any:
    """Numbers as Python's own, which have every digit whatever NumPy's print options are (pyyeti changes them)."""
    if isinstance(value, np.generic):
        return value.item()
    return " ".join(map(str, np.ravel(value).tolist())) if isinstance(value, (list, tuple, np.ndarray)) else value


def machine() -> dict[str, Any]:
    """What the seconds were measured on."""
    model = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            model = next((line.split(":", 1)[1].strip() for line in file if line.startswith("model name")), model)
    except OSError:
        pass
    return {"cpu": model, "cores": os.cpu_count(), "system": platform.platform()}


def versions() -> dict[str, Any]:
    """Of femsub, Python and the packages at work so far; which of them factorised sparse matrices, and femsub's commit."""
    import scipy

    found = {"femsub": femsub.__version__, "commit": commit(Path(__file__).parent), "python": platform.python_version(),
             "numpy": np.__version__, "scipy": scipy.__version__}
    if "femsub.linalg.petsc" in sys.modules and "petsc4py.PETSc" in sys.modules:
        found |= sys.modules["femsub.linalg.petsc"].versions()
        found["factors"] = sorted(sys.modules["femsub.linalg.petsc"].Factor.packages)
    return found


def commit(folder: Path) -> str | None:
    """The commit of the clone that a folder is part of, with '-dirty' where files were changed; None outside of one."""
    def git(*words: str) -> str:
        return subprocess.run(["git", "--no-optional-locks", "-C", str(folder), *words], capture_output=True, text=True,
                              check=True).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", "__init__.py")  # it may lie in a clone of something else
        return git("describe", "--always", "--dirty", "--abbrev=40", "--exclude", "*")
    except (OSError, subprocess.CalledProcessError):
        return None


def progress(text: str) -> None:
    """One line on stderr that overwrites itself; nothing where stderr is not a terminal."""
    if sys.stderr.isatty():
        print(f"\r\033[K{text[:100]}", end="", file=sys.stderr, flush=True)


def progress_done() -> None:
    """Takes the progress line away."""
    if sys.stderr.isatty():
        print("\r\033[K", end="", file=sys.stderr, flush=True)
