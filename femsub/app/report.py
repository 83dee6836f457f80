"""Results on the terminal and in a folder: all its files are replaced together."""

from __future__ import annotations

import platform
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import femsub
from femsub.algebra import commit, machine
from femsub.app.result import Result
from femsub.checks import InputError, is_there, printable
from femsub.io import Writer, held, with_index, write_or_refuse
from femsub.output import UNKNOWN, Units, for_json


@contextmanager
def output_folder(folder: str | None) -> Iterator[Path | None]:
    """Context manager: creates and locks the output folder, so that no other run writes into it. An empty one is removed.

    Raises
    ------
    InputError
        The folder cannot be created or written, or another process writes into it.
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


def write(result: Result, folder: Path, figures: bool, units: Units = UNKNOWN, name: str = "results") -> list[Path]:
    """Writes name.json, a CSV file for each table, the figures and the scene's own files, all or none; returns their paths."""
    index, writers = f"{name}.json", result.writers(figures, units)
    written = put(folder, with_index(writers, index, for_json(result.data | {"written": [index, *writers]})))
    return [written[-1], *written[:-1]]


def put(folder: Path, writers: Mapping[str, Writer]) -> list[Path]:
    """Writes files into the folder, all or none; returns their paths.

    Raises
    ------
    InputError
        The folder cannot be written.
    """
    return write_or_refuse(f"the output folder {folder}", folder, writers)


def run_on() -> dict[str, Any]:
    """The versions of packages and the machine of a run."""
    return {"versions": versions(), "machine": machine()}


def versions() -> dict[str, Any]:
    """Versions of femsub, Python and the packages used so far, femsub's commit, and the packages that factorised matrices."""
    import scipy

    found = {"femsub": femsub.__version__, "commit": commit(Path(__file__).parent), "python": platform.python_version(),
             "numpy": np.__version__, "scipy": scipy.__version__}
    if "femsub.algebra.petsc" in sys.modules and "petsc4py.PETSc" in sys.modules:
        found |= sys.modules["femsub.algebra.petsc"].versions()
        found["factors"] = sorted(sys.modules["femsub.algebra.petsc"].SparseFactor.packages)
    return found


def progress(text: str) -> None:
    """Prints one line on stderr that replaces the last one; prints nothing if stderr is not a terminal."""
    if sys.stderr.isatty():
        print(f"\r\033[K{printable(text[:100])}", end="", file=sys.stderr, flush=True)


def progress_done() -> None:
    """Removes the progress line."""
    if sys.stderr.isatty():
        print("\r\033[K", end="", file=sys.stderr, flush=True)
