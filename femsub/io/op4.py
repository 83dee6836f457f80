"""Nastran's .op4 files, read record by record and line by line: nothing may exceed its record, column or matrix."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from femsub.checks import Array, InputError, Matrix, package
from femsub.io.damage import Cursor, assembled, check_extent, check_partners, run_rows
from femsub.io.dmig import Form

_INTEGER = re.compile(rb" *-?\d+ *")


def op4_module() -> Any:
    """pyyeti's module, which writes OP4 files."""
    return package("pyyeti.nastran.op4", "Nastran OP4 files are written by pyyeti", "pyyeti")


def read_op4(path: Path) -> dict[str, Matrix]:
    """Name (lower case) to matrix, shape (n, m), sparse (CSR) or dense as it was written.

    ===================  =======================================================================================
    it reads             binary files (32 and 64 bit, either byte order) and text, dense, sparse and big sparse
    it refuses           records whose two lengths differ, strings of numbers that leave their record, column or
                         matrix, columns out of order, words of text that are no numbers, a name or an entry twice
    it warns             of a pair that differs in a matrix that its head calls symmetric (form 6)
    it cannot know       whether a number is wrong, or the last matrices are gone: there is no table of contents
    ===================  =======================================================================================

    A matrix whose name is no word is called m0, m1, ... by its place in the file.

    Raises
    ------
    InputError
        See the table.
    """
    found: dict[str, Matrix] = {}
    with open(path, "rb") as file:
        start = file.read(16)
        if len(start) < 16:
            raise InputError(f"{path} is empty or cut short ({len(start)} bytes); write it again")
        file.seek(0)
        source = _Binary(path, np.memmap(file, mode="r")) if 0 in start[:4] else _Text(path, file)
        place = 0
        while head := source.head():
            (columns, rows, form, kind), name = head  # kinds: 1, 2 real, 3, 4 complex; single and double precision
            name = name.replace(" ", "").replace("\0", "").lower()
            name, place = name if name.isidentifier() else f"m{place}", place + 1
            if columns < 1 or not rows or kind not in (1, 2, 3, 4):
                raise InputError(f"{path} is no OP4 file or damaged, {source.here()}: {abs(rows)} x {columns}, type {kind}")
            if name in found:
                raise InputError(f"{path} holds two matrices called {name!r}. Give them different names")
            per = 1 if kind % 2 or source.wide else 2  # words per number
            # sparse matrices with a negative number of rows are big: a string's head has a word for the row, not 16 bits
            words_per_entry, rows, negative = per * (1 if kind < 3 else 2), abs(rows), rows < 0
            big = negative or rows >= 1 << 16
            last, packed, runs = 0, None, list[tuple[int, int, int]]()  # first row, column and count of entries
            while last <= columns:
                column, row, words = source.column(columns, kind)
                if not last < column <= columns + 1:
                    raise InputError(f"{path} is damaged, {source.here()}: column {column} of {columns} follows column {last}")
                packed, last = row == 0 if packed is None else packed, column
                if column > columns:
                    break
                if words < (0 if packed else 1) or (row == 0) != packed:
                    raise _damaged(path, f"{source.here()}: row {row}, {words} words")
                while words > 0:
                    length = used = words
                    if packed and big:
                        length, row = source.integers(2)
                        length, used = length - 1, length + 1
                    elif packed:
                        code = source.integers(1)[0]
                        length, row = (code >> 16) - 1, code & 0xFFFF
                        used = length + 1
                    if length < 1 or used > words:
                        raise _damaged(path, f"{source.here()}: a string of {length} words, and {words} are left")
                    entries, rest = divmod(length, words_per_entry)
                    if rest:
                        raise _damaged(path, f"{source.here()}: {length} words are no whole count of numbers")
                    if row < 1 or row - 1 + entries > rows:
                        raise InputError(f"{path} is damaged, {source.here()}: {entries} entries from row {row} in a matrix of "
                                         f"{rows} rows")
                    source.take(length // per, per)
                    runs.append((row - 1, column - 1, entries))
                    words -= used
            first, at, count = np.array(runs, dtype=np.int64).reshape(-1, 3).T
            check_extent(path, (rows, columns), int(count.sum()), not packed)
            values = source.numbers()
            values = values[::2] + 1j * values[1::2] if kind > 2 else values
            i, j = run_rows(first, count), np.repeat(at, count)
            if packed or (negative and not runs):
                found[name] = assembled(f"{path}: {name}", i, j, values, (rows, columns))
            else:
                found[name] = np.zeros((rows, columns), dtype=values.dtype)
                found[name][i, j] = values
            if form == Form.SYMMETRIC:
                check_partners(path, name, found[name], kind % 2 == 1)
    return found


def _damaged(path: Path, place: str) -> InputError:
    return InputError(f"{path} is damaged or cut short, {place}; write it again")


class _Binary:
    """A binary file, record by record; the length of each record is stored before and after it."""

    def __init__(self, path: Path, content: Array) -> None:
        self.path, self.cursor, self.start = path, Cursor(str(path), content), 0
        order = "<" if content[0] else ">"
        self.wide = 48 in (content[0], content[3])  # the length of a head: 24 of four bytes or 48 of eight
        self.length, self.word = np.dtype(f"{order}i4"), np.dtype(f"{order}i{8 if self.wide else 4}")
        self.words, self.listed, self.at = np.zeros(0, self.word), list[int](), 0  # of a record, and the place in it
        self.parts, self.per = list[Array](), 1

    def here(self) -> str:
        return f"at byte {self.start}"

    def _record(self) -> int:
        """Begin the next record; returns how many words it has."""
        self.start = self.cursor.place
        data = self.cursor.record(self.length)
        words, rest = divmod(len(data), self.word.itemsize)
        if rest or words < 3:
            raise _damaged(self.path, f"a record {self.here()} has {len(data)} bytes")
        self.words, self.at = data.view(self.word), 0
        self.listed = self.words.tolist()
        return words

    def head(self) -> tuple[list[int], str] | None:
        """Columns, rows, form and kind of the next matrix, and its name."""
        if self.cursor.place >= self.cursor.end:
            return None
        if self._record() != 6:
            raise _damaged(self.path, f"{self.here()}: no head of a matrix")
        self.parts = []
        return self.integers(4), self.words[4:].tobytes().decode("ascii", "replace")

    def column(self, columns: int, kind: int) -> list[int]:
        length = self._record()
        column, row, words = self.integers(3)
        if column <= columns and 3 + words != length:
            raise _damaged(self.path, f"{self.here()}: {words} words in a record of {length}")
        return [column, row, words]

    def integers(self, count: int) -> list[int]:
        self.at += count
        if self.at > len(self.words):
            raise _damaged(self.path, f"a record {self.here()} has {len(self.words)} words")
        return self.listed[self.at - count:self.at]

    def take(self, count: int, per: int) -> None:
        self.integers(count * per)
        self.parts.append(self.words[self.at - count * per:self.at].view(np.uint8))
        self.per = per

    def numbers(self) -> Array:
        """All numbers that were taken from the matrix."""
        content = np.concatenate([np.zeros(0, np.uint8), *self.parts])
        return content.view(f"{self.word.str[0]}f{self.per * self.word.itemsize}").astype(float)


class _Text:
    """A text file, line by line; its numbers are collected and checked at the end of each matrix."""

    wide = False

    def __init__(self, path: Path, file: Iterable[bytes]) -> None:
        self.path, self.lines, self.line = path, iter(file), 0
        self.per_line, self.digits, self.first = 0, 0, 0
        self.cells: list[bytes] = []

    def here(self) -> str:
        return f"in line {self.line}"

    def _next(self) -> bytes:
        line = next(self.lines, None)
        if line is None:
            raise InputError(f"{self.path} is cut short: it ends within a matrix; write it again")
        self.line += 1
        return line.rstrip(b"\r\n")

    def _integer(self, cell: bytes) -> int:
        if not _INTEGER.fullmatch(cell):
            raise InputError(f"{self.path}, line {self.line}: {cell.decode('ascii', 'replace')!r} is not a whole number")
        return int(cell)

    def head(self) -> tuple[list[int], str] | None:
        self.line, line = self.line + 1, next(self.lines, b"").rstrip(b"\r\n")
        if not line.strip():
            if any(rest.strip() for rest in self.lines):
                raise _damaged(self.path, f"line {self.line} is empty")
            return None
        width = 16 if line.rstrip().endswith(b"|I16") else 8
        heads = [line[:width], line[width:2 * width], line[2 * width:2 * width + 8], line[2 * width + 8:2 * width + 16]]
        form = line[2 * width + 24:].split(b"|")[0].strip().upper().removeprefix(b"1P,")
        match = re.fullmatch(rb"([1-9]\d?)[ED]([1-9]\d?)\.\d{1,2}", form or b"5E16.9")
        if not match:
            raise InputError(f"{self.path}, line {self.line}: {form.decode('ascii', 'replace')!r} is no format as 3E23.16")
        self.per_line, self.digits, self.first, self.cells = int(match[1]), int(match[2]), 0, []
        return [self._integer(cell) for cell in heads], line[2 * width + 16:2 * width + 24].decode("ascii", "replace")

    def column(self, columns: int, kind: int) -> list[int]:
        column, row, words = self.integers(3)
        if column > columns:
            self._next()  # a dummy number
        return [column, row, words if row == 0 or kind % 2 else 2 * words]  # of a dense matrix the text counts numbers

    def integers(self, count: int) -> list[int]:
        line = self._next()
        if count > 1 and line[8 * count:].strip():
            raise InputError(f"{self.path}, line {self.line}: {line.decode('ascii', 'replace')!r:.60} should be {count} whole "
                             "numbers")
        return [self._integer(line[8 * part:8 * part + 8] if count > 1 else line) for part in range(count)]

    def take(self, count: int, per: int) -> None:
        for start in range(0, count, self.per_line):
            line = self._next()
            self.first = self.first or self.line
            length = self.digits * min(self.per_line, count - start)
            if len(line) < length or line[length:].strip():
                raise InputError(f"{self.path}, line {self.line}: {line.decode('ascii', 'replace')!r:.60} should be "
                                 f"{length // self.digits} numbers of {self.digits} characters")
            self.cells.append(line[:length])

    def numbers(self) -> Array:
        text, digits = b"".join(self.cells), self.digits
        try:
            values: Array = np.frombuffer(text.upper().replace(b"D", b"E"), dtype=f"S{digits}").astype(float)
            if b"_" not in text and np.isfinite(values).all():  # Python reads 1_0 as 10
                return values
        except ValueError:
            pass
        bad = next(cell for part in self.cells for cell in (part[at:at + digits] for at in range(0, len(part), digits))
                   if not re.fullmatch(rb" *[+-]?(?:\d++\.?\d*+|\.\d++)(?:[EeDd][+-]?\d++)? *", cell))
        raise InputError(f"{self.path}: {bad.decode('ascii', 'replace').strip()!r} is not a number, in the matrix whose "
                         f"numbers begin in line {self.first}")
