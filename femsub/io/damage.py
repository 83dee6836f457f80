"""Signs of damage that are checked in every format, and the exceptions of other packages for damaged files."""

from __future__ import annotations

import io
import lzma
import re
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np
import scipy.sparse as sp

from femsub.algebra import available
from femsub.checks import Array, InputError, NotEnoughMemoryError, warn

#: exceptions of NumPy, SciPy, h5py, pyyeti, meshio and Python's own readers, which trust the sizes in a file
THROWN = (ArithmeticError, AssertionError, AttributeError, BufferError, EOFError, ImportError, LookupError, NameError, OSError,
          RuntimeError, StopIteration, SyntaxError, TypeError, ValueError, Warning, lzma.LZMAError, struct.error,
          tokenize.TokenError, zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error)

#: Most rows, nodes, elements or members of a set that a few numbers of a file may announce. No computer that femsub runs on holds
#: a model of so many nodes. A list of them takes 1 GB, which a damaged digit must not cause.
MOST = 10_000_000

P = ParamSpec("P")
T = TypeVar("T")


def unreadable_refused(reader: Callable[P, T]) -> Callable[P, T]:
    """A public reader whose error names the file that cannot be read, for lack of rights or because its disk fails."""
    @wraps(reader)
    def reading(*args: P.args, **named: P.kwargs) -> T:
        try:
            return reader(*args, **named)
        except OSError as error:
            name = next(iter([*args, *named.values()])) if error.filename is None else error.filename
            raise InputError(f"{name} cannot be read: {error.strerror or error}") from None
    return reading


@dataclass
class Cursor:
    """Takes numbers from a buffer, one after the other, and never more than there are."""

    what: str  # the owner of the content, with which errors begin
    content: Any
    place: int = 0  # in bytes

    def __post_init__(self) -> None:
        self.end = memoryview(self.content).nbytes

    def skip(self, size: int) -> None:
        if size < 0 or self.place + size > self.end:
            raise InputError(f"{self.what} has fewer numbers than it says: is it cut short or damaged?")
        self.place += size

    def take(self, kind: Any, count: int) -> Array:
        """The next numbers, or records of them, of a kind that NumPy knows."""
        start, kind = self.place, np.dtype(kind)
        self.skip(count * kind.itemsize)
        return np.frombuffer(self.content, kind, count, start)

    def record(self, length: Any) -> Array:
        """The bytes of the next record of Fortran, which stand between two copies of their number."""
        start, size = self.place, int(self.take(length, 1)[0])
        data = self.take("u1", size)
        if self.take(length, 1)[0] != size:
            raise InputError(f"{self.what} is damaged, at byte {start}: a record does not end where it should; write it again")
        return data


def existing(path: Path) -> Path:
    """The path of a file that is there."""
    if not path.is_file():
        raise InputError(f"there is no file {path}")
    return path


def head_of(path: Path) -> bytes:
    """The beginning of a file, by which its format is known: a MB, since comments may stand before the first keyword."""
    with path.open("rb") as file:
        return file.read(1 << 20)


def check_room(path: Path, size: int) -> None:
    """Refuse a file that would not fit into memory, before reading it."""
    free = available()
    if free is not None and size > free:
        raise NotEnoughMemoryError(f"{path} holds {size / 1e9:.0f} GB, but only {free / 1e9:.0f} GB of memory are available")


def check_extent(path: Path, shape: tuple[int, int], count: int, dense: bool = False) -> None:
    """Refuse a size (rows or columns; if dense, their product) far beyond the number of entries: a digit must be wrong."""
    if (shape[0] * shape[1] if dense else max(shape)) > MOST + 100 * count or max(shape) >= 2 ** 31:
        raise InputError(f"{path} announces a matrix of {shape[0]} x {shape[1]}, but holds {count} entries; write it again")


def check_indices(matrix: Any) -> None:
    """Refuse indices of a compressed sparse matrix that leave its arrays; SciPy lets them pass where the last pointer is 0."""
    matrix.check_format(full_check=True)
    if (np.diff(matrix.indptr) < 0).any():
        raise ValueError("its index pointers fall")


def run_rows(first: Array, counts: Array) -> Array:
    """The rows of runs of entries, one after the other, by the first row of each run and its number of entries."""
    return np.repeat(first - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())


def assembled(what: str, rows: Array, columns: Array, values: Array, shape: tuple[int, int], partner: Any = None,
              labels: Array | None = None) -> Any:
    """A CSR of entries, each of which may occur once; `partner` turns an entry off the diagonal into its transposed one.

    `labels` (n, 2) has node and DOF of each row, by which an error names an entry.
    """
    beside = rows != columns
    if partner:
        rows, columns = np.append(rows, columns[beside]), np.append(columns, rows[beside])
        values = np.append(values, partner(values[beside]))
    matrix = sp.csr_array(sp.coo_array((values, (rows, columns)), shape=shape))
    if matrix.nnz < len(values):
        flat = np.sort(rows.astype(np.int64) * shape[1] + columns)
        row, column = divmod(int(flat[1:][flat[1:] == flat[:-1]][0]), shape[1])
        place = f"row {row + 1}, column {column + 1}" if labels is None else \
            f"node {labels[row][0]}, DOF {labels[row][1]} with node {labels[column][0]}, DOF {labels[column][1]}"
        raise InputError(f"{what} lists an entry twice: {place}; each may occur once"
                         + (", and of a symmetric matrix one triangle only" if partner else ""))
    return matrix


def mirrored(half: Any) -> Any:
    """The symmetric matrix of which one triangle is given."""
    return sp.csr_array(half + half.T - sp.diags_array(half.diagonal()))


def check_partners(path: Path, name: str, matrix: Any, single: bool) -> None:
    """Warn of a matrix that its file calls symmetric, if the two entries of a pair differ by more than rounding.

    Half of the digits of the file's precision may differ, relative to √(a_ii a_jj): no entry of a stiffness or mass exceeds that.
    """
    if matrix.shape[0] != matrix.shape[1]:
        raise InputError(f"{path} calls {name!r} symmetric, but it is {matrix.shape[0]} x {matrix.shape[1]}; it is damaged")
    eps, A = np.finfo(np.float32 if single else float).eps, sp.coo_array(matrix)
    gap, size = sp.coo_array(A - A.T), np.sqrt(np.abs(A.diagonal()))
    allowed = np.sqrt(eps) * size[gap.row] * size[gap.col] + eps * np.abs(A.data).max(initial=0.0)
    if len(wrong := np.flatnonzero(np.abs(gap.data) > allowed)):
        row, column = sorted((int(gap.row[wrong[0]]), int(gap.col[wrong[0]])))
        B = sp.csr_array(A)
        warn(f"{path} calls {name!r} symmetric, but {len(wrong) // 2} of its pairs differ, first {B[row, column]:g} in row "
             f"{row + 1} of column {column + 1} and {B[column, row]:g} in row {column + 1} of column {row + 1}: is it damaged?")


def announced(lines: Sequence[str]) -> list[str]:
    """The lines of a text file for Nastran. The first gets their number and a checksum of the others, which the format lacks."""
    return [f"{lines[0]}, {len(lines)} lines, sum {_sum(line.encode() for line in lines[1:]):08x}", *lines[1:]]


def _sum(lines: Iterable[bytes]) -> int:
    """CRC-32 of lines without their ends, blanks at their ends and empty lines: a transfer may change these."""
    found = 0
    for line in lines:
        found = zlib.crc32(kept + b"\n", found) if (kept := line.rstrip()) else found
    return found


def check_lines(path: Path) -> bool:
    """Refuse a text file of femsub whose first line announces other lines, by number or sum; returns whether it announces any."""
    with open(path, "rb") as file:
        said = re.fullmatch(rb"\$ .*, by femsub, (\d{1,15}) lines(?:, sum ([0-9a-f]{8}))?\s*", file.readline(1000))
        lines = [line for line in file if line.strip()] if said else []
    if said and int(said[1]) != 1 + len(lines):
        raise InputError(f"{path} has {1 + len(lines)} lines, but its first line says {int(said[1])}: it is cut short or "
                         "damaged. Write it again; if you changed it, change that number, and take ', sum ...' out of the line")
    if said and said[2] and int(said[2], 16) != _sum(lines):
        raise InputError(f"{path} has other lines than femsub wrote, by the sum in its first line: it is damaged. Write it "
                         "again; if you changed it, take ', sum ...' out of the first line")
    return bool(said)


def check_end(path: Path, comment: bytes = b"\n", last_words: Sequence[str] = ()) -> None:
    """Refuse a text file whose last line has no end: it was cut short, and its last number may have lost digits.

    A line with a `comment` sign may be cut. A line that is one of the `last_words` is whole.
    """
    with open(path, "rb") as file:
        end = file.seek(0, io.SEEK_END)
        file.seek(max(0, end - 200))
        tail = file.read()
    if not tail:
        raise InputError(f"{path} is empty")
    last = tail.replace(b"\r", b"\n").rpartition(b"\n")[2].partition(comment)[0].decode("ascii", "replace")
    if last.strip() and last.strip().upper() not in last_words:
        raise InputError(f"{path} seems to be cut short: its last line, {last[-40:]!r}, does not end. Write the file again; "
                         "if it is complete, end the line")
