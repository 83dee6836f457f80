"""Signs of damage that readers look for in every format, and what the packages they call throw at a damaged file."""

from __future__ import annotations

import io
import lzma
import struct
import tokenize
import zipfile
import zlib
from pathlib import Path

from femsub.errors import InputError, NotEnoughMemoryError
from femsub.linalg.process_memory import available

#: by NumPy, SciPy, h5py, pyyeti, meshio and Python's own readers, which trust what a file says of itself
THROWN = (ArithmeticError, AssertionError, AttributeError, BufferError, EOFError, ImportError, LookupError, NameError, OSError,
          RuntimeError, StopIteration, SyntaxError, TypeError, ValueError, Warning, lzma.LZMAError, struct.error,
          tokenize.TokenError, zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error)


def check_room(path: Path, size: int) -> None:
    """Refuses what would not fit into memory, before any is taken."""
    free = available()
    if free is not None and size > free:
        raise NotEnoughMemoryError(f"{path} holds {size / 1e9:.0f} GB, and {free / 1e9:.0f} GB of memory are available")


def check_extent(path: Path, shape: tuple[int, int], count: int, dense: bool = False) -> None:
    """Refuses a size (rows or columns, if dense their product) so far beyond the entries that a digit of it must be wrong."""
    if (shape[0] * shape[1] if dense else max(shape)) > 10_000_000 + 100 * count or max(shape) >= 2 ** 31:
        raise InputError(f"{path} announces a matrix of {shape[0]} x {shape[1]}, but holds {count} entries: one of these must be "
                         "wrong; write it again")


def check_end(path: Path, comment: bytes = b"\n") -> None:
    """A text file that does not end its last line was cut short: a number lost its last digits, and looks like a number.

    What stands behind a `comment` sign may be cut.
    (SciPy's reader of Matrix Market, 1.17, even takes the interpreter down where the cut is behind the 'e' of a number.)
    """
    with open(path, "rb") as file:
        end = file.seek(0, io.SEEK_END)
        file.seek(max(0, end - 200))
        tail = file.read()
    if not tail:
        raise InputError(f"{path} is empty")
    last = tail.replace(b"\r", b"\n").rpartition(b"\n")[2].partition(comment)[0].decode("ascii", "replace")
    if last.strip():
        raise InputError(f"{path} seems to be cut short: its last line, {last[-40:]!r}, does not end; write the file again (or, "
                         "if it is whole, end the line)")
