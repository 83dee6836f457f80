"""Nastran's .op2 files: the matrices in them, record by record, and the DMIG tables that EXTSEOUT(DMIGOP2) writes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from femsub.checks import Array, InputError, Matrix
from femsub.io.abaqus_calculix import TextMatrix
from femsub.io.damage import Cursor, assembled, check_extent, check_partners, run_rows
from femsub.io.dmig import Entries, Form

DMIG = (114, 1, 120)  # words with which a record of DMIG entries begins
#: words with which a superelement's other records begin: the card, and the number of words of each (0: the record is one list)
CARDS = {(1627, 16, 463): ("EXTRN", 0), (5551, 49, 105): ("SPOINT", 0), (4501, 45, 1): ("GRID", 8),
         (4501, 45, 1120001): ("GRID", 11),
         (2101, 21, 8): ("CORD2R", 13), (2001, 20, 9): ("CORD2C", 13), (2201, 22, 10): ("CORD2S", 13)}
#: the names in the table of contents of a superelement's file, and those of the matrices in OP4
NAMES = {"matk": "kaa", "matm": "maa", "matb": "baa", "matk4": "k4aa"}
CONTENTS, SUPERELEMENT, RECOVERED = "xsop2dir", "extdb", "tug1"

Card = tuple[str, list[str]]


def read_op2(path: Path) -> tuple[dict[str, TextMatrix], list[Card]]:
    """Name (lower case) to matrix, shape (n, m), and the cards of a superelement that EXTSEOUT(DMIGOP2) wrote.

    A second matrix of the name 'kaa' is 'kaa#2'. DMIG tables have their grids.

    ===================  =======================================================================================
    it reads             files of 32 and 64 bit words, either byte order; real and complex matrices of single and
                         double precision; of EXTSEOUT(DMIGOP2) the DMIG tables, EXTRN, GRID, SPOINT, CORD2x, TUG1
    it passes over       all other tables: results, geometry of full models
    it refuses           records whose two lengths differ or that no key announces, entries outside their matrix,
                         columns that are not as many as announced, DMIG tables of 64 bit words, text
    it warns             of a pair that differs in a matrix that its trailer calls symmetric (form 6)
    it cannot know       whether a number is wrong, or blocks at the end are gone: some programs leave out the mark
                         of the end
    ===================  =======================================================================================

    Raises
    ------
    InputError
        See the table.
    """
    if path.stat().st_size < 16:
        raise InputError(f"{path} is empty or cut short; write it again")
    blocks = _Blocks(path, np.memmap(path, np.uint8, "r"))
    found, cards, contents, place = dict[str, TextMatrix](), list[Card](), list[str](), -1
    for place, (name, item) in enumerate(blocks.read()):
        if name == CONTENTS and isinstance(item, list):
            contents = [""] * place + [name, *(blocks.text(record) for record in item)]
        elif name == SUPERELEMENT:
            name = contents[place] if place < len(contents) else name
        if isinstance(item, list):
            cards.extend(blocks.cards(name, item) if contents else ())
            if not item or tuple(blocks.words(item[0])[:3].tolist()) != DMIG:
                continue
            item = blocks.dmig(name, item[0])
        name = NAMES.get(name, name) if contents else name
        count = 1 + sum(known.partition("#")[0] == name for known in found)
        found[name if count == 1 else f"{name}#{count}"] = item
    if contents and place + 1 != len(contents):
        raise InputError(f"{path} is cut short: its table of contents names {len(contents)} blocks, and {place + 1} are there")
    return found, cards


class _Blocks:
    """The data blocks of a file. Each record stands between two copies of its length; a key is a record of one whole number."""

    def __init__(self, path: Path, content: Array) -> None:
        self.path, self.cursor = path, Cursor(str(path), content)
        order = next((sign for sign, name in (("<", "little"), (">", "big"))
                      if int.from_bytes(content[:4].tobytes(), name) in (4, 8)), "")  # type: ignore[arg-type]
        if not order:
            raise InputError(f"{path} is no .op2 file: it does not begin with the length of a word. Text (FORMATTED) is not read")
        self.length, self.order = np.dtype(f"{order}i4"), order
        self.bytes = int(content[:4].view(self.length)[0])
        self.word = np.dtype(f"{order}i{self.bytes}")

    def read(self) -> Iterator[tuple[str, TextMatrix | list[Array]]]:
        """All matrices, and the records of tables, in their order."""
        key = self._key()
        if key == 3:  # the date, what wrote the file, its label, its version
            self._parts(key)
            self._keys(1)
            key = self._next()
        while key > 0:
            name = self.text(self._parts(key)[0])
            trailer = self._data(self._key()).view(self.word)
            self._keys(3)
            self._parts(self._key())
            self._keys(1)
            if self._key() > 0:
                yield name, TextMatrix(self._matrix(name, trailer))
                self._keys(1)
            else:
                records = list[Array]()
                while (part := self._key()) != 0:
                    some = self._parts(part) if part > 0 else [np.zeros(0, np.uint8)]  # a negative key ends an empty record
                    records.append(some[0] if len(some) == 1 else np.concatenate(some))
                    self._keys(2)
                yield name, records
            key = self._next()

    def text(self, record: Array) -> str:
        """A name, in small letters."""
        return record.tobytes().decode("ascii", "replace").replace(" ", "").replace("\0", "").lower()

    def words(self, record: Array) -> Array:
        """A record as whole numbers."""
        return record[:len(record) // self.bytes * self.bytes].view(self.word)

    def _wrong(self, what: str) -> InputError:
        return InputError(f"{self.path} is damaged or no .op2 file, at byte {self.cursor.place}: {what}; write it again")

    def _key(self) -> int:
        data = self.cursor.record(self.length)
        if len(data) != self.bytes:
            raise self._wrong(f"a record of {len(data)} bytes, where a key should be")
        return int(data.view(self.word)[0])

    def _keys(self, count: int) -> None:
        for _ in range(count):
            self._key()

    def _next(self) -> int:
        """The key of the next block; some programs leave out the last mark, 0."""
        return self._key() if self.cursor.place < self.cursor.end else 0

    def _parts(self, key: int) -> list[Array]:
        """The records of a first key and of the positive keys behind it."""
        parts = [self._data(key)]
        while (key := self._key()) > 0:
            parts.append(self._data(key))
        return parts

    def _data(self, key: int) -> Array:
        """The next record, which must have `key` words."""
        data = self.cursor.record(self.length)
        if len(data) != key * self.bytes:
            raise self._wrong(f"a record of {len(data)} bytes, where {key} words should be")
        return data

    def _matrix(self, name: str, trailer: Array) -> Matrix:
        columns, rows, kind = (int(trailer[at]) for at in (1, 2, 4)) if len(trailer) > 4 else (0, 0, 0)
        if columns < 1 or rows < 1 or kind not in (1, 2, 3, 4):
            raise self._wrong(f"the matrix {name.upper()} of {rows} rows and {columns} columns, type {kind}")
        size = (self.bytes if kind % 2 else 8) * (1 if kind < 3 else 2)
        number = np.dtype(f"{self.order}{'f' if kind < 3 else 'c'}{size}")
        places: list[tuple[int, int, int]] = []
        values: list[Array] = [np.zeros(0, number)]
        column, more = 0, 1
        while more > 0:
            while (key := self._key()) > 0:
                data = self._data(key + 1)  # the row, and `key` words of numbers
                row = int(data[:self.bytes].view(self.word)[0]) - 1
                count, rest = divmod(len(data) - self.bytes, size)
                if rest or row < 0 or row + count > rows or column >= columns:
                    raise self._wrong(f"{count} entries from row {row + 1} of column {column + 1} in the matrix {name.upper()} "
                                      f"of {rows} x {columns}")
                places.append((row, column, count))
                values.append(data[self.bytes:].view(number))
            self._keys(1)
            more, column = self._key(), column + 1
        if column != columns:
            raise self._wrong(f"{column} columns in the matrix {name.upper()}, which announces {columns}")
        found = np.concatenate(values)
        check_extent(self.path, (rows, columns), len(found))
        start, at, count = np.array(places, dtype=np.int64).reshape(-1, 3).T
        matrix = assembled(f"{self.path}: {name.upper()}", run_rows(start, count), np.repeat(at, count),
                           found.astype(complex if kind > 2 else float), (rows, columns))
        if trailer[3] == Form.SYMMETRIC:
            check_partners(self.path, name.upper(), matrix, kind % 2 == 1)
        return matrix

    def dmig(self, name: str, record: Array) -> TextMatrix:
        """The matrix of a record of DMIG entries."""
        words = self.words(record)
        form, kind = (int(words[at]) for at in (6, 7)) if len(words) > 12 else (0, 0)
        if self.bytes != 4 or form not in [*Form] or kind not in (1, 2, 3, 4):
            raise self._wrong(f"DMIG {name.upper()} of form {form} and type {kind} in words of {self.bytes} bytes")
        number = np.dtype(f"{self.order}{'f' if kind < 3 else 'c'}{4 * (kind if kind < 3 else 2 * (kind - 2))}")
        entries = Entries(form, kind > 2, int(words[11]) if form == Form.NUMBERED else 0)
        taken = Cursor(str(self.path), words[12:].copy())
        while taken.place + 2 * self.bytes < taken.end:
            column = taken.take(self.word, 2).tolist()
            if form == Form.NUMBERED:
                column[1] = 0
            while (row := taken.take(self.word, 2).tolist())[0] != -1:
                if min(row[0], column[0]) < 1 or min(row[1], column[1]) < 0 or column[0] > (entries.width or column[0]):
                    raise self._wrong(f"DMIG {name.upper()} has an entry at {row} of column {column}")
                entries.places.append((*row, *column))
                entries.values.append(complex(taken.take(number, 1)[0]))
        scalar = {grid for place in entries.places for grid, direction in (place[:2], place[2:]) if not direction}
        if form != Form.NUMBERED:  # the columns of scalar points have direction 1 where their rows have 0
            entries.places = [(grid, 0 if grid in scalar else at, column, 0 if column in scalar else to)
                              for grid, at, column, to in entries.places]
        return entries.matrix(self.path, name)

    def cards(self, name: str, records: list[Array]) -> Iterator[Card]:
        """A superelement's records as the cards that a text file would have."""
        if name == RECOVERED and len(records) > 1:
            table = self.words(records[1])[10:]  # behind a heading of ten words: (type, grid, motions, row, 0), grid by grid
            rows = table[:len(table) // 5 * 5].reshape(-1, 5)[:, :4]
            yield "DTI", ["TUG1", "2", *map(str, rows.ravel().tolist())]
        for record in records:
            words = self.words(record)
            card, size = CARDS.get(tuple(words[:3].tolist()), ("", 0))
            words = words[3:]
            if card and size == 0:
                yield card, [str(word) for word in words.tolist() if word >= 0]
            elif card and self.bytes == 4:
                # GRID: number, system, three coordinates, frame. CORD2x: number, reference, nine coordinates
                before, after, step = (2, 3, (size - 5) // 3) if card == "GRID" else (4, 0, 1)
                for row in words[:len(words) // size * size].reshape(-1, size):
                    reals = np.ascontiguousarray(row[before:size - after]).view(f"{self.order}f{4 * step}").astype(float)
                    head = row[:2] if card == "GRID" else row[[0, 3]]
                    yield card, [*map(str, head.tolist()), *(f"{value:.17e}" for value in reals.tolist()),
                                 *([str(row[-3])] if after else [])]
