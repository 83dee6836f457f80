"""Text of mesh files: decoding, fast conversion of fields to numbers, and lookup of node and cell numbers."""

from __future__ import annotations

import codecs
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

import numpy as np

from femsub.checks import Array
from femsub.errors import InputError

DEEPEST = 9  # largest depth of nested includes
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


def text_of(path: Path) -> str:
    """The file's text with newlines only: UTF-8 or UTF-16 with or without a byte-order mark, else Latin-1."""
    raw = path.read_bytes()
    if (asked := _asked.get()) is not None:
        asked.append(path)
    try:
        text = raw.decode("utf-16" if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def with_included(path: Path, pattern: str, named: Callable[[str], str],
                  check: Callable[[Path, str, bool], None] = lambda path, text, alone: None, depth: int = 0) -> str:
    """The text with the content of included files inserted.

    `pattern` finds a line that includes a file. `named` extracts the file's name from the pattern's group. `check` gets each
    text, and whether it is the file's own.
    """
    text = text_of(path)
    check(path, text, depth == 0)
    parts = re.split(pattern, text, flags=re.MULTILINE | re.IGNORECASE) if "INCLUDE" in text.upper() else [text]
    for i in range(1, len(parts), 2):
        name = named(parts[i])
        if depth >= DEEPEST or not name or not (path.parent / name).is_file():
            raise InputError(f"{path} includes {name or 'no file'!r}, which is not a file beside it")
        parts[i] = with_included(path.parent / name, pattern, named, check, depth + 1)
    return "".join(part if part.endswith("\n") or not part else f"{part}\n" for part in parts)


def as_numbers(what: str, data: str, kind: type = np.int64) -> Array:
    """Numbers between blanks and commas; D stands for E, as in Fortran.

    Raises
    ------
    InputError
        Something that is not a number is among them.
    """
    if kind is float:
        data = re.sub(r"[dD](?=[+-]?\d)", "e", data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # NumPy warns about text that is not a number, and stops there
            values: Array = np.fromstring(data.replace(",", " "), dtype=kind, sep=" ")
    except (DeprecationWarning, ValueError):
        raise InputError(f"{what} are not all numbers") from None
    if kind is not float and len(values) and (values.max() > 10**17 or values.min() < -10**17):
        raise InputError(f"{what} hold a number beyond all limits")  # where strtol ends
    return values


def fields(what: str, data: str, kind: type = np.int64) -> tuple[Array, Array]:
    """The numbers of comma-separated lines, blank fields as 0, and their count on each line that is not empty.

    A comma at the end of a line is followed by a blank field.
    """
    data = re.sub(r"\n[ \t]*(?=\n)", "", f"\n{data}\n")[1:] if re.search(r"^[ \t]*\n", data, re.MULTILINE) else data
    if not data.strip():
        return np.zeros(0, dtype=kind), np.zeros(0, dtype=np.intp)
    if not data.endswith("\n"):
        data += "\n"
    if re.search(r"^[ \t]*,|,[ \t]*[,\n]", data, re.MULTILINE):
        data = re.sub(r"(^|,)(?=[ \t]*[,\n])", r"\g<1>0", data, flags=re.MULTILINE)
    raw = np.frombuffer(data.encode("utf-8"), dtype=np.uint8)
    counts = np.diff(np.searchsorted(np.flatnonzero(raw == ord(",")), np.flatnonzero(raw == ord("\n"))), prepend=0) + 1
    values = as_numbers(what, data, kind)
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


def once(path: Path, what: str, numbers: Array) -> Array:
    order = np.argsort(numbers, kind="stable")
    again = numbers[order][1:][numbers[order][1:] == numbers[order][:-1]]
    if len(again):
        raise InputError(f"{path} gives {len(np.unique(again))} {what} more than once, the first is {what[:-1]} {again[0]}")
    return order


def rows_of(path: Path, what: str, sort: str, numbers: Array, wanted: Array) -> Array:
    """The indices of the wanted numbers in the ascending `numbers`."""
    rows = np.minimum(np.searchsorted(numbers, wanted), len(numbers) - 1)
    missing = wanted[numbers[rows] != wanted] if len(numbers) else wanted
    if missing.size:
        raise InputError(f"{path}: {what} names {sort} {missing.ravel()[0]}, which the file does not give")
    return rows
