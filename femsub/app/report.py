"""Results on the terminal and in a folder: all its files are replaced together."""

from __future__ import annotations

import csv
import io
import json
import platform
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

import femsub
from femsub.algebra import completed, processors
from femsub.app.result import Remark, Result, studies
from femsub.checks import InputError, csv_cell, hash_of, is_there, printable, resolved
from femsub.io import HASHES, OURS, Writer, hashed, held, summed, write_whole
from femsub.output import UNKNOWN, Units


@contextmanager
def output_folder(folder: str | None) -> Iterator[Path | None]:
    """The output folder, made and locked: no other run writes into it meanwhile. One that stays empty is taken away again.

    Raises
    ------
    InputError
        It cannot be made or written, or another process writes into it.
    """
    if folder is None:
        yield None
        return
    if not folder:
        raise InputError("--out needs the name of a folder; it is empty")
    path = existing = Path(folder)
    while not is_there(existing):
        existing = existing.parent
    if not existing.is_dir():
        raise InputError(f"the output folder {folder} cannot be written: {existing} is not a folder")
    with ExitStack() as stack:
        try:
            stack.enter_context(held(path))
            tempfile.TemporaryFile(dir=path).close()
        except OSError as error:
            raise InputError(f"the output folder {folder} cannot be written: {error.strerror or error}") from None
        yield path


def write(result: Result, folder: Path, figures: bool, name: str = "results", units: Units = UNKNOWN,
          notes: Mapping[str, str] | None = None) -> list[Path]:
    """name.json, a CSV file for each table, the figures and the scene's own files, all or none; what was written.

    `units` are those that figures are drawn in, `notes` what stands at the foot of some, by name.
    """
    writers: dict[str, Writer] = {f"{file}.csv": partial(table_csv, units.with_hertz(table.filed))
                                  for file, table in result.tables.items()}
    if figures and result.drawings:
        from femsub.output import render

        writers |= {f"{title}.png": partial(render, draw, units=units, note=(notes or {}).get(title, ""))
                    for title, draw in result.drawings.items()}
    writers |= result.files
    index = f"{name}.json"
    data = result.data | {"written": [index, *writers]}
    files, hashes = hashed(writers)
    written = put(folder, {**files, index: lambda file: file.write(
        to_json(summed(index, _plain(data | {HASHES: hashes}))).encode())})
    return [written[-1], *written[:-1]]


def put(folder: Path, writers: Mapping[str, Writer]) -> list[Path]:
    """Writes files into the folder, all or none.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    try:
        return write_whole(folder, writers)
    except OSError as error:
        raise InputError(f"the output folder {folder} cannot be written: {error.strerror or error}") from None


def remove(folder: Path, hashes: Mapping[Any, Any]) -> None:
    """Deletes files of the last run, {name: hash}, and the folders that are empty then.

    Only what the last run wrote: regular files below the folder with an ending of femsub's files, their content that of the
    hash. No link is followed.
    """
    whole = resolved(folder)
    for name, known in hashes.items():
        with suppress(OSError, ValueError):  # a name that none can be; a file that may not be read or deleted stays
            path = whole / name
            below = resolved(path) == path and whole in path.parents
            if below and path.suffix in OURS and path.is_file() and hash_of(path) == known:
                path.unlink()
                for parent in path.relative_to(whole).parents[:-1]:
                    (whole / parent).rmdir()


def results(result: Result, units: Units = UNKNOWN) -> dict[str, Any]:
    """The data, with Hz beside rad per unit of time where the units are known; what the columns of its tables mean; its charts;
    its verdict.
    """
    tables = {}
    for name, one in result.tables.items():
        place, rows = _place(result.data, one.rows), units.with_hertz(one.filed)
        tables[name] = {"title": units.said(one.title), "columns": [
            {"key": at.key, "head": units.said(at.head), "unit": units.said(at.unit), "meaning": at.meaning, "role": at.role}
            for at in replace(one, rows=rows, only=()).every], **({"place": place} if place else {"rows": rows})}
    undone = [f"The ask {name} failed: {reason}." for name, reason in result.data.get("failed", {}).items()]
    if not result.data.get("complete", True):
        undone.append("The run was interrupted. Later asks are missing.")
    charts = [units.with_hertz(chart.plain(units.known)) for chart in result.charts]
    return {**units.with_hertz(result.data), "tables": tables, "charts": [one for one in charts if one["places"]],
            "verdict": studies.answer([*result.shown, Remark(unchecked=undone)]).said(units.said)}


def _place(data: Mapping[str, Any], rows: Any) -> list[str]:
    """The keys that lead to the rows of a table; none where they are not part of the data."""
    for key, value in data.items():
        if value is rows:
            return [key]
        if isinstance(value, dict) and (found := _place(value, rows)):
            return [key, *found]
    return []


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


def table_csv(rows: Sequence[dict[str, Any]], file: BinaryIO) -> None:
    """A line for each row; several values in one cell stand with blanks between them."""
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    keys = list(dict.fromkeys(key for row in rows for key in row))
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([csv_cell(key) for key in keys])
    for row in rows:
        cells: list[Any] = []
        for value in (row.get(key, "") for key in keys):
            # numbers as Python's own, which have every digit whatever NumPy's print options are (pyyeti changes them)
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


def machine() -> dict[str, Any]:
    """What the seconds were measured on."""
    model = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            model = next((line.split(":", 1)[1].strip() for line in file if line.startswith("model name")), model)
    except OSError:
        pass
    return {"cpu": model, "cores": processors(), "system": platform.platform()}


def versions() -> dict[str, Any]:
    """Of femsub, Python and the packages at work so far; which of them factorised sparse matrices, and femsub's commit."""
    import scipy

    found = {"femsub": femsub.__version__, "commit": commit(Path(__file__).parent), "python": platform.python_version(),
             "numpy": np.__version__, "scipy": scipy.__version__}
    if "femsub.algebra.petsc" in sys.modules and "petsc4py.PETSc" in sys.modules:
        found |= sys.modules["femsub.algebra.petsc"].versions()
        found["factors"] = sorted(sys.modules["femsub.algebra.petsc"].SparseFactor.packages)
    return found


def commit(folder: Path) -> str | None:
    """The commit of the clone that a folder is part of, with '-dirty' where files were changed; None outside of one."""
    def git(*words: str) -> str:
        done = completed(["git", "--no-optional-locks", "-C", str(folder), *words], 10.0)
        if done is None or done.returncode:
            raise OSError("git did not answer")
        return done.stdout.strip()

    try:
        git("ls-files", "--error-unmatch", "__init__.py")  # it may lie in a clone of something else
        return git("describe", "--always", "--dirty", "--abbrev=40", "--exclude", "*")
    except OSError:
        return None


def progress(text: str) -> None:
    """One line on stderr that overwrites itself; nothing where stderr is not a terminal."""
    if sys.stderr.isatty():
        print(f"\r\033[K{printable(text[:100])}", end="", file=sys.stderr, flush=True)


def progress_done() -> None:
    """Takes the progress line away."""
    if sys.stderr.isatty():
        print("\r\033[K", end="", file=sys.stderr, flush=True)
