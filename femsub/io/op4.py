"""Nastran's .op4 files: their structure checked record by record, then read by pyyeti, which trusts every number."""

from __future__ import annotations

import mmap
import re
import struct
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from femsub.checks import Matrix
from femsub.errors import InputError, MissingPackageError
from femsub.io.damage import check_extent

_INTEGER = re.compile(rb" *-?\d+ *")
BIG = 65536  # rows from which the sparse format is the one for big matrices


class _Matrix(NamedTuple):
    columns: int
    rows: int  # negative: sparse, in the format for big matrices
    kind: int  # 1, 2 real, 3, 4 complex; single and double precision


def op4_module() -> Any:
    """pyyeti's module for OP4 files."""
    try:
        from pyyeti.nastran import op4
    except ImportError as error:
        raise MissingPackageError("Nastran OP4 files need pyyeti: pip install femsub[nastran]") from error
    return op4


def read_op4(path: Path) -> dict[str, Matrix]:
    """Name (lower case) to matrix, shape (n, m), sparse (COO) or dense as it was written.

    ===================  =======================================================================================
    it reads             binary files (32 and 64 bit, either byte order) and text, dense, sparse and big sparse
    it refuses           records whose two lengths differ, strings of numbers that leave their record, column or
                         matrix, columns out of order, words of text that are no numbers, a name or an entry twice
    it cannot know       whether a number is wrong, or the last matrices are gone: there is no table of contents
    ===================  =======================================================================================

    Raises
    ------
    InputError
        See the table.
    MissingPackageError
        pyyeti is not installed.
    """
    op4 = op4_module()
    with open(path, "rb") as file:
        start = file.read(16)
        if len(start) < 16:
            raise InputError(f"{path} is empty or cut short ({len(start)} bytes); write it again")
        if 0 in start[:4]:
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
                _check_binary(path, content)
        else:
            file.seek(0)
            _check_text(path, file)
    with warnings.catch_warnings():
        # a premature end is only a warning there; a name that is no identifier is harmless
        warnings.filterwarnings("error", "Premature end-of-file")
        warnings.filterwarnings("ignore", "Output4 file has matrix name")
        names, matrices, *_ = op4.load(str(path), into="list", sparse=None)
    found: dict[str, Matrix] = {}
    for name, matrix in zip(names, matrices, strict=True):
        if name in found:
            raise InputError(f"{path} holds two matrices called {name!r}; give each a name of its own")
        found[name] = matrix
        if sp.issparse(matrix):
            found[name] = sp.csr_array(matrix)
            if found[name].nnz < matrix.nnz:
                raise InputError(f"{path}: {name!r} lists an entry twice; it is damaged")
    return found


def _damaged(path: Path, place: str) -> InputError:
    return InputError(f"{path} is damaged or cut short, {place}; write it again")


def _check_header(path: Path, what: _Matrix, place: str) -> None:
    if what.columns < 1 or not what.rows or what.kind not in (1, 2, 3, 4):
        raise InputError(f"{path} is no OP4 file or damaged, {place}: {what.columns} columns, {abs(what.rows)} rows, type "
                         f"{what.kind}")


def _check_record(path: Path, what: _Matrix, column: int, last: int, place: str) -> None:
    if not last < column <= what.columns + 1:
        raise InputError(f"{path} is damaged, {place}: column {column} of {what.columns} follows column {last}")


def _check_rows(path: Path, what: _Matrix, row: int, numbers: int, place: str) -> int:
    count = numbers // (1 if what.kind < 3 else 2)
    if row < 1 or numbers < 1 or row - 1 + count > abs(what.rows):
        raise InputError(f"{path} is damaged, {place}: {count} entries from row {row} in a matrix of {abs(what.rows)} rows")
    return count


def _check_binary(path: Path, content: mmap.mmap) -> None:
    order = "<" if struct.unpack_from("<I", content)[0] <= 48 else ">"
    wide = struct.unpack_from(f"{order}I", content)[0] == 48
    word, size = ("q", 8) if wide else ("i", 4)
    head, three, two, one = (struct.Struct(order + count * word) for count in (4, 3, 2, 1))

    def record(place: int) -> int:
        """The length of the record at a place, which stands before and behind it."""
        if place + 8 > len(content):
            raise _damaged(path, f"at byte {place}")
        length = int(struct.unpack_from(f"{order}i", content, place)[0])
        end = place + 4 + length
        if length < 3 * size or end + 4 > len(content) or struct.unpack_from(f"{order}i", content, end)[0] != length:
            raise _damaged(path, f"a record at byte {place} does not end where it should")
        return length

    place = 0
    while place < len(content):
        if record(place) != (48 if wide else 24):
            raise _damaged(path, f"at byte {place}: no head of a matrix")
        what = _Matrix(*(head.unpack_from(content, place + 4)[part] for part in (0, 1, 3)))
        _check_header(path, what, f"at byte {place}")
        place += 8 + (48 if wide else 24)
        per = 1 if what.kind % 2 or wide else 2  # words per number
        last, count, packed = 0, 0, None
        while last <= what.columns:
            length, told = record(place), f"at byte {place}"
            column, row, words = three.unpack_from(content, place + 4)
            _check_record(path, what, column, last, told)
            if packed is None:
                packed = row == 0
            start, place, last = place + 4 + 3 * size, place + 8 + length, column
            if column > what.columns:
                break
            if words < 0 or 3 * size + words * size != length or (row == 0) != packed:
                raise _damaged(path, f"{told}: {words} words in a record of {length} bytes")
            if not packed:
                count += _check_rows(path, what, row, _whole(path, words, per, what, told), told)
                continue
            while words > 0:
                if what.rows < 0 or what.rows >= BIG:
                    length, row = two.unpack_from(content, start)
                    length, used, start = length - 1, length + 1, start + 2 * size
                else:
                    code = one.unpack_from(content, start)[0]
                    length, row = (code >> 16) - 1, code & 0xFFFF
                    used, start = length + 1, start + size
                if length < 1 or used > words:
                    raise _damaged(path, f"{told}: a string of {length} words, and {words} are left")
                count += _check_rows(path, what, row, _whole(path, length, per, what, told), told)
                words, start = words - used, start + length * size
        check_extent(path, (abs(what.rows), what.columns), count, not packed)


def _whole(path: Path, words: int, per: int, what: _Matrix, told: str) -> int:
    if words % (per * (1 if what.kind < 3 else 2)):
        raise _damaged(path, f"{told}: {words} words are no whole count of numbers")
    return words // per


def _check_text(path: Path, file: Iterable[bytes]) -> None:
    lines = _numbered(file)
    for number, line in lines:
        if not line.strip():
            if any(rest.strip() for _, rest in lines):
                raise _damaged(path, f"line {number} is empty")
            return
        width = 16 if line.rstrip().endswith(b"|I16") else 8
        heads = [line[:width], line[width:2 * width], line[2 * width + 8:2 * width + 16], line[2 * width:2 * width + 8]]
        columns, rows, kind, _ = (_integer(path, number, cell) for cell in heads)
        what = _Matrix(columns, rows, kind)
        _check_header(path, what, f"in line {number}")
        form = line[2 * width + 24:].split(b"|")[0].strip().upper().removeprefix(b"1P,")
        match = re.fullmatch(rb"([1-9]\d?)[ED]([1-9]\d?)\.\d{1,2}", form or b"5E16.9")
        if not match:
            raise InputError(f"{path}, line {number}: {form.decode('ascii', 'replace')!r} is no format of numbers, as 3E23.16 is")
        per_line, digits = int(match[1]), int(match[2])
        dense, count = _check_columns(path, what, lines, per_line, digits)
        check_extent(path, (abs(what.rows), what.columns), count, dense)


def _numbered(file: Iterable[bytes]) -> Iterator[tuple[int, bytes]]:
    for number, line in enumerate(file, 1):
        yield number, line.rstrip(b"\r\n")


def _integer(path: Path, number: int, cell: bytes) -> int:
    if not _INTEGER.fullmatch(cell):
        raise InputError(f"{path}, line {number}: {cell.decode('ascii', 'replace')!r} is not a whole number")
    return int(cell)


def _check_columns(path: Path, what: _Matrix, lines: Iterator[tuple[int, bytes]], per_line: int, digits: int) -> tuple[bool, int]:
    """Whether the matrix that begins here is dense, and how many entries it has."""
    per = 1 if what.kind % 2 else 2  # words per number in the sparse formats
    cells: list[bytes] = []
    first = 0

    def following() -> tuple[int, bytes]:
        found = next(lines, None)
        if found is None:
            raise InputError(f"{path} is cut short: it ends within a matrix; write it again")
        return found

    def integers(count: int) -> tuple[int, list[int]]:
        number, line = following()
        if line[8 * count:].strip():
            raise InputError(f"{path}, line {number}: {line.decode('ascii', 'replace')!r:.60} should be {count} whole numbers")
        return number, [_integer(path, number, line[8 * part:8 * part + 8]) for part in range(count)]

    def numbers(count: int) -> None:
        nonlocal first
        for start in range(0, count, per_line):
            number, line = following()
            first = first or number
            length = digits * min(per_line, count - start)
            if len(line) < length or line[length:].strip():
                raise InputError(f"{path}, line {number}: {line.decode('ascii', 'replace')!r:.60} should be "
                                 f"{length // digits} numbers of {digits} characters")
            cells.append(line[:length])

    last, packed, count = 0, None, 0
    while True:
        number, (column, row, words) = integers(3)
        told = f"in line {number}"
        _check_record(path, what, column, last, told)
        packed, last = row == 0 if packed is None else packed, column
        if column > what.columns:
            following()
            break
        if words < 0 or (row == 0) != packed:
            raise _damaged(path, f"{told}: row {row}, {words} words")
        if not packed:
            count += _check_rows(path, what, row, words, told)
            numbers(words)
        while packed and words > 0:
            if what.rows < 0 or what.rows >= BIG:
                number, (length, row) = integers(2)
                length, used = length - 1, length + 1
            else:
                number, line = following()
                code = _integer(path, number, line)
                length, row = (code >> 16) - 1, code & 0xFFFF
                used = length + 1
            if length < 1 or used > words:
                raise _damaged(path, f"in line {number}: a string of {length} words, and {words} are left")
            count += _check_rows(path, what, row, _whole(path, length, per, what, told), told)
            numbers(length // per)
            words -= used
    text = b"".join(cells)
    try:
        if b"_" in text:  # Python takes 1_0 for 10
            raise ValueError
        if not np.isfinite(np.frombuffer(text.upper().replace(b"D", b"E"), dtype=f"S{digits}").astype(float)).all():
            raise ValueError
    except ValueError:
        bad = next(cell for part in cells for cell in (part[at:at + digits] for at in range(0, len(part), digits))
                   if not re.fullmatch(rb" *[+-]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][+-]?\d+)? *", cell))
        raise InputError(f"{path}: {bad.decode('ascii', 'replace').strip()!r} is not a number, in the matrix whose numbers begin "
                         f"in line {first}") from None
    return not packed, count
