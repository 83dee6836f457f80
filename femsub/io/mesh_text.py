"""Text of mesh files: decoding, fast conversion of fields to numbers, and lookup of node and cell numbers."""

from __future__ import annotations

import codecs
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np

from femsub.checks import Array, InputError, is_file, package, resolved

DEEPEST = 9  # largest depth of nested includes
MOST_INCLUDED = 1000  # files that a deck may include; a file counts each time
MOST_REPEATED = 100_000_000  # bytes that a deck may include from files that it has included before
_trusted: ContextVar[tuple[Path, ...]] = ContextVar("femsub_trusted", default=())
_asked: ContextVar[list[Path] | None] = ContextVar("femsub_texts", default=None)


@contextmanager
def texts_read() -> Iterator[list[Path]]:
    """The text files that are read inside: those of meshes, and what they include."""
    paths: list[Path] = []
    token = _asked.set(paths)
    try:
        yield paths
    finally:
        _asked.reset(token)


def text_of(path: Path, raw: bytes | None = None) -> str:
    """The text of a file, or of its content `raw`, with newlines only.

    It is UTF-8 with or without a byte-order mark, UTF-16 with one, or else Latin-1.
    """
    raw = path.read_bytes() if raw is None else raw
    if (asked := _asked.get()) is not None:
        asked.append(path)
    try:
        text = raw.decode("utf-16" if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


@contextmanager
def including(*folders: str | Path) -> Iterator[None]:
    """Inside, mesh files may include files from these folders, as well as from their own."""
    token = _trusted.set((*_trusted.get(), *map(resolved, folders)))
    try:
        yield
    finally:
        _trusted.reset(token)


class Deck:
    """A mesh file with the files that it includes.

    It may include files from its own folder and from the folders of `including` only. The number of files is limited, and so are
    the bytes from files that it has included before: each file may include another several times, level by level.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.count, self.repeated = path, 0, 0
        self.seen: set[Path] = set()

    def included(self, by: Path, name: str) -> tuple[Path, str]:
        """The path and the text of a file that `by` includes: beside `by`, else beside the deck, where a solver would run.

        Raises
        ------
        InputError
            The file does not exist, lies in another folder, or is one too many.
        """
        places = [folder / name for folder in dict.fromkeys((by.parent, self.path.parent))]
        place = next((place for place in places if name and is_file(place)), None)
        if place is None:
            also = f" or beside {self.path}" if len(places) > 1 else ""
            raise InputError(f"{by} includes {name or 'no file'!r}, which is not a file beside it{also}")
        whole = resolved(place)
        home = resolved(self.path.parent)
        if not any(whole.is_relative_to(folder) for folder in (home, *_trusted.get())):
            raise InputError(f"{by} includes {name!r}, which lies outside of its folder {home}. Copy it there, or allow it: "
                             f"read_mesh(..., includes={str(whole.parent)!r}), or femsub run SCENE --trust {whole.parent}")
        self.count += 1
        self.repeated += whole.stat().st_size if whole in self.seen else 0
        self.seen.add(whole)
        if self.count > MOST_INCLUDED or self.repeated > MOST_REPEATED:
            raise InputError(f"{self.path} includes more than {MOST_INCLUDED} files, or some of them again and again: more than "
                             f"{MOST_REPEATED // 1_000_000} MB repeated. Write one file without includes")
        return place, text_of(place)

    def whole(self, pattern: str, named: Callable[[str], str],
              check: Callable[[Path, str, bool], None] = lambda path, text, alone: None, own: str | None = None) -> str:
        """The text, or `own` in its place, with the content of included files inserted.

        `pattern` finds a line that includes a file. `named` extracts the file's name from the pattern's group. `check` gets
        each text, and whether it is the file's own.
        """
        def inserted(path: Path, text: str, depth: int) -> str:
            check(path, text, depth == 0)
            parts = re.split(pattern, text, flags=re.MULTILINE | re.IGNORECASE) if "INCLUDE" in text.upper() else [text]
            if len(parts) > 1 and depth >= DEEPEST:
                raise InputError(f"{path} includes {named(parts[1])!r}, {DEEPEST} files deep: does a file include itself?")
            for i in range(1, len(parts), 2):
                parts[i] = inserted(*self.included(path, named(parts[i])), depth + 1)
            return "".join(part if part.endswith("\n") or not part else f"{part}\n" for part in parts)

        return inserted(self.path, text_of(self.path) if own is None else own, 0)


def meshio() -> Any:
    """The package meshio, or an error that says how to install it."""
    found = package("meshio", "mesh files need meshio", "meshio")
    for kind in ("wedge15", "pyramid13"):  # known to its readers, but without a dimension
        found._mesh.topological_dimension.setdefault(kind, 3)
    return found


def meshed(path: Path, numbers: Array, points: Array, blocks: Iterable[tuple[str, Array, Array]],
           node_sets: Mapping[str, Any] | None = None, cell_sets: Mapping[str, Any] | None = None, **more: Any) -> Any:
    """A meshio.Mesh with `points_id` and `cells_id`, from the tables of a file.

    Nodes have `numbers` (n,) and `points` (n, 3). A block of elements has their kind, their numbers (m,) and the numbers of their
    nodes (m, k). A set has the numbers of its members.

    Raises
    ------
    InputError
        A node or element that is given twice, a node that the file does not give.
    """
    order, blocks = once(path, "nodes", numbers), list(blocks)
    ids = [part for _, part, _ in blocks]
    once(path, "elements", np.concatenate([np.zeros(0, dtype=np.int64), *ids]))
    cells = [(kind, order[rows_of(path, f"a {kind} element", "node", numbers[order], nodes)]) for kind, _, nodes in blocks]
    point_sets = {name: np.flatnonzero(np.isin(numbers, part)) for name, part in (node_sets or {}).items()}
    groups = {name: [np.flatnonzero(np.isin(some, part)) for some in ids] for name, part in (cell_sets or {}).items()}
    mesh = meshio().Mesh(points, cells, point_sets=point_sets, cell_sets=groups, **more)
    mesh.points_id, mesh.cells_id = numbers, ids
    return mesh


def as_numbers(what: str, data: str, kind: type = np.int64, commas: bool = False) -> Array:
    """Numbers between blanks, or also between `commas`; D stands for E, as in Fortran.

    Raises
    ------
    InputError
        Something that is not a number is among them, as 0,5 for 0.5.
    """
    if not commas and "," in data:
        at = data.index(",")
        raise InputError(f"{what} hold a comma, in {data[max(0, at - 15):at + 15].strip()!r}: write 0.5, not 0,5, with a blank "
                         "between two numbers")
    if kind is float:
        data = re.sub(r"[dD](?=[+-]?\d)", "e", data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # NumPy warns about text that is not a number, and stops there
            values: Array = np.fromstring(data.replace(",", " "), dtype=kind, sep=" ")
    except (DeprecationWarning, ValueError):
        raise InputError(f"{what} are not all numbers") from None
    if kind is not float and len(values) and (values.max() > 10**17 or values.min() < -10**17):
        raise InputError(f"{what} hold a number beyond all limits")  # strtol has no larger ones
    return values


def fields(what: str, data: str, kind: type = np.int64) -> tuple[Array, Array]:
    """The numbers of comma-separated lines, blank fields as 0, and their count on each line that is not empty.

    Each line has its end. A comma at the end of a line is followed by a blank field.
    """
    data = re.sub(r"\n[ \t]*(?=\n)", "", f"\n{data}\n")[1:] if re.search(r"^[ \t]*\n", data, re.MULTILINE) else data
    if not data.strip():
        return np.zeros(0, dtype=kind), np.zeros(0, dtype=np.intp)
    if re.search(r"^[ \t]*,|,[ \t]*[,\n]", data, re.MULTILINE):
        data = re.sub(r"(^|,)(?=[ \t]*[,\n])", r"\g<1>0", data, flags=re.MULTILINE)
    raw = np.frombuffer(data.encode("utf-8"), dtype=np.uint8)
    counts = np.diff(np.searchsorted(np.flatnonzero(raw == ord(",")), np.flatnonzero(raw == ord("\n"))), prepend=0) + 1
    values = as_numbers(what, data, kind, commas=True)
    if len(values) != counts.sum():
        raise InputError(f"{what} have {len(values)} numbers in {counts.sum()} fields: is a comma missing?")
    return values, counts


def as_table(values: Array, counts: Array) -> Array:
    """A table (lines, largest number of fields); missing fields are 0."""
    width = int(counts.max(initial=0))
    if (counts == width).all():
        return values.reshape(len(counts), width)
    table = np.zeros((len(counts), width), dtype=values.dtype)
    table[np.arange(width) < counts[:, None]] = values
    return table


def whole_numbers(what: str, values: Array) -> Array:
    """The numbers of nodes or elements, which must be whole and positive."""
    wrong = ~((values >= 1) & (values < 2.0**53) & (values % 1 == 0))
    if wrong.any():
        raise InputError(f"{what} must be whole and positive, not {values[wrong][0]}")
    return values.astype(np.int64)


def whole(path: Path, what: str, words: list[str]) -> list[int]:
    """Whole numbers of at most 15 digits."""
    bad = [word for word in words if not re.fullmatch("-?[0-9]{1,15}", word)]
    if bad:
        raise InputError(f"{path}: {bad[0]!r:.30} in {what} is not a whole number")
    return [int(word) for word in words]


def once(path: Path, what: str, numbers: Array) -> Array:
    order = np.argsort(numbers, kind="stable")
    again = numbers[order][1:][numbers[order][1:] == numbers[order][:-1]]
    if len(again):
        raise InputError(f"{path} gives {len(np.unique(again))} {what} more than once, the first is {what[:-1]} {again[0]}")
    return order


def without_copies(numbers: Array, values: Array) -> tuple[Array, list[str]]:
    """The rows of nodes without repetitions of a row above them, and a note of the number of repetitions.

    `values` (n, k) are the data of each node. A row with the same number but other values stays: `once` refuses it.
    """
    order = np.argsort(numbers, kind="stable")
    again = (np.diff(numbers[order]) == 0) & (values[order][1:] == values[order][:-1]).all(axis=1)
    count = int(np.count_nonzero(again))
    words = "node was" if count == 1 else "nodes were"
    notes = [f"{count} {words} given twice at the same place, kept once"] * (count > 0)
    return np.setdiff1d(np.arange(len(numbers)), order[1:][again]), notes


def rows_of(path: Path, what: str, sort: str, numbers: Array, wanted: Array) -> Array:
    """The indices of the wanted numbers in the ascending `numbers`."""
    rows = np.minimum(np.searchsorted(numbers, wanted), len(numbers) - 1)
    missing = wanted[numbers[rows] != wanted] if len(numbers) else wanted
    if missing.size:
        raise InputError(f"{path}: {what} names {sort} {missing.ravel()[0]}, which the file does not give")
    return rows
