"""Nastran's DMIG cards, matrices in the text of punch files and decks: the place of each entry is a grid and a direction."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import pairwise
from pathlib import Path

import numpy as np

from femsub.checks import Array, InputError, warn
from femsub.io.abaqus_calculix import TextMatrix
from femsub.io.damage import assembled, check_end, check_extent, check_lines
from femsub.io.nastran import KNOWN, bulk_of, cards_in

#: cards of `write_superelement`
WRITTEN = {"ASET1", "BEGIN SUPER", "BSET1", "DMIG", "DTI", "EXTRN", "GRID", "QSET1", "SEBULK", "SECONCT", "SPOINT"}
#: cards whose first field may be any name
OTHERS = ("PARAM", "DTI", "DTABLE", "MDLPRM", "DOPTPRM", "AECOMP", "AECOMPL", "MONSUM",
          "MONPNT1", "MONPNT2", "MONPNT3", "MONDSP1")
_REAL = re.compile(r"[+-]?(\d++\.?\d*+|\.\d++)([EDed][+-]?\d++|[+-]\d++)?", re.ASCII)


class Form(IntEnum):
    """Forms of matrices, of DMIG, OP2 and OP4 alike. Columns of NUMBERED have numbers, not grids."""

    SQUARE = 1
    RECTANGULAR = 2
    SYMMETRIC = 6
    NUMBERED = 9


@dataclass
class Entries:
    """Places (row grid, row direction, column grid, column direction) and values, as they stand in a file."""

    form: int
    is_complex: bool
    width: int
    places: list[tuple[int, int, int, int]] = field(default_factory=list)
    values: list[complex] = field(default_factory=list)

    def matrix(self, path: Path, name: str) -> TextMatrix:
        """The matrix, checked."""
        if not self.values:
            raise InputError(f"{path}: DMIG {name.upper()} has no entries; the file may be cut short")
        places = np.array(self.places, dtype=np.int64)
        if max(places[:, 1].max(), 0 if self.form == Form.NUMBERED else places[:, 3].max()) > 6:
            raise InputError(f"{path}: DMIG {name.upper()} has a direction beyond 6")
        keys = places[:, 0::2] * 10 + places[:, 1::2]
        square = self.form in (Form.SQUARE, Form.SYMMETRIC)
        rows, columns = (np.unique(keys if square else keys[:, side]) for side in (0, 1))
        if self.form == Form.NUMBERED and self.width:
            check_extent(path, (0, self.width), len(keys))
            columns = np.arange(1, self.width + 1) * 10
        values: Array = np.array(self.values) if self.is_complex else np.array(self.values).real
        i, j = np.searchsorted(rows, keys[:, 0]), np.searchsorted(columns, keys[:, 1])
        partner = np.positive if self.form == Form.SYMMETRIC else None
        matrix = assembled(f"{path}: DMIG {name.upper()}", i, j, values, (len(rows), len(columns)), partner)
        labels = [np.stack([part // 10, part % 10], axis=1) for part in (rows, columns)]
        return TextMatrix(matrix, labels[0], None if square else labels[1])


def real(path: Path, what: str, text: str) -> float:
    """A number of Nastran: 1.5, 1.5E-3, 1.5D-3 and 1.5-3 alike; '' is 0."""
    if not text:
        return 0.0
    if not _REAL.fullmatch(text):
        raise InputError(f"{path}: {text!r:.30} in {what} is not a number")
    value = float(re.sub(r"(?<=[\d.])(?=[+-]\d)", "e", text.replace("D", "E").replace("d", "e")))
    if not math.isfinite(value):
        raise InputError(f"{path}: {text!r:.30} in {what} is beyond all numbers")
    return value


def whole(path: Path, what: str, text: str, least: int = 0) -> int:
    """A whole number of Nastran, not below `least`; '' is 0."""
    if not re.fullmatch("[0-9]{1,15}", text or "0") or int(text or "0") < least:
        raise InputError(f"{path}: {text!r:.30} in {what} is not a whole number from {least}")
    return int(text or "0")


def quadruples(fields: list[str], size: int = 4) -> Iterator[list[str]]:
    """The fields in groups of `size`, without groups that are all blank."""
    for start in range(0, len(fields), size):
        some = fields[start:start + size]
        if any(some):
            yield some + [""] * (size - len(some))


def read_dmig(path: Path) -> dict[str, TextMatrix]:
    """Name (lower case) to matrix, from the DMIG cards of a file; scalar points have direction 0.

    ===================  =======================================================================================
    it reads             square, symmetric and rectangular matrices, real and complex; fields of 8 and 16 columns
                         and free ones; INCLUDE (files beside this one)
    it refuses           words that are no numbers, an entry twice, both entries of a pair of a symmetric matrix,
                         columns without the head of their matrix, a matrix twice, amplitude and phase, a last
                         line without its end
    it cannot know       whether lines or digits are missing: the format counts nothing. A file of femsub says how many
                         lines it has, and another number is refused
    ===================  =======================================================================================

    Raises
    ------
    InputError
        See the table.
    """
    return dmig_of(path, cards_of(path))


def cards_of(path: Path) -> list[tuple[str, list[str]]]:
    """`cards_in` a file whose last line has its end. A file of femsub must have the lines and the cards that femsub writes."""
    check_end(path)
    own, (lines, _, notes, _) = check_lines(path), bulk_of(path)
    for note in notes:
        warn(f"{path}: {note}")
    for line in lines:
        if "," not in line and line[80:].strip() and (line[0] in "*+" or line[:8].upper().rstrip("* ") in KNOWN):
            raise InputError(f"{path}: {line.strip()!r:.75} has {line[80:].strip()!r:.20} behind column 80, unread by Nastran. "
                             "Remove it, or the blanks before it")
    cards = list(cards_in(path, lines))
    if wrong := next((card for card, _ in cards if card[0].isdigit()), None):
        raise InputError(f"{path} has a card {wrong!r:.20}, which begins with a digit: a name or a continuation is damaged")
    if own and (other := next((card for card, _ in cards if card not in WRITTEN), None)):
        raise InputError(f"{path} has a card {other!r:.20}, which femsub does not write: a name, or the * of a continuation, is "
                         "damaged. Write it again; if you added the card, take ', ... lines, sum ...' out of line 1")
    return cards


def dmig_of(path: Path, cards: list[tuple[str, list[str]]]) -> dict[str, TextMatrix]:
    """`read_dmig` of cards that were read already."""
    found: dict[str, Entries] = {}
    for (before, _), (card, fields) in pairwise([("", [""]), *cards]):
        if card != "DMIG":
            if before == "DMIG" and not fields[0] and card not in ("BEGIN SUPER", "GRDSET"):
                raise InputError(f"{path}: the card {card!r:.20} below {before} has a blank first field, as a continuation "
                                 "has: its * is damaged, and an entry would be lost")
            if card[:4] == "DMIG" or (fields[0].lower() in found and card not in OTHERS):
                raise InputError(f"{path}: the card {card!r:.40} of {fields[0]!r:.20} is no DMIG card, but begins like one, or "
                                 "names a DMIG matrix. Correct its name, or remove a comma from its fields of fixed width")
            continue
        name = fields[0].lower()
        what = f"DMIG {fields[0]}"
        if not re.fullmatch(r"[a-z]\w{0,7}", name):
            raise InputError(f"{path}: {fields[0]!r:.30} is no name of a DMIG matrix")
        if fields[1] == "0":
            if name in found:
                raise InputError(f"{path} has two heads of the matrix {fields[0]}: it may hold two runs")
            form, kind = (whole(path, what, text) for text in fields[2:4])
            if form not in [*Form] or kind not in (1, 2, 3, 4):
                raise InputError(f"{path}: {what} has the form {form} and the type {kind}; forms are 1, 2, 6, 9, types 1 to 4")
            if fields[5:6] == ["1"]:
                raise InputError(f"{path}: {what} has amplitude and phase; only real and imaginary parts are read")
            found[name] = Entries(form, kind > 2, whole(path, what, "".join(fields[7:8])))
        elif name not in found:
            raise InputError(f"{path}: {what} has a column, but no head (DMIG NAME 0 ...) before it")
        else:
            # a column: its place, then row, direction and one or two numbers of each entry
            entries, at = found[name], (whole(path, what, fields[1], 1), whole(path, what, fields[2]))
            column = f"column {at[0]} {at[1] or ''}"
            if entries.form == Form.NUMBERED and entries.width and at[0] > entries.width:
                raise InputError(f"{path}: {what} announces {entries.width} columns, but has column {at[0]}")
            if not any(fields[4:]):
                raise InputError(f"{path}: {what} has the {column} without an entry: the lines below it are lost")
            for row, direction, one, other in quadruples(fields[4:]):
                if not one or (other and not entries.is_complex):
                    raise InputError(f"{path}: {what} has {f'{one} {other}'.strip()!r:.40} as the value in row {row} {direction} "
                                     f"of {column}; it should be {'two numbers' if entries.is_complex else 'a number'}")
                entries.places.append((whole(path, what, row, 1), whole(path, what, direction), *at))
                imaginary = real(path, what, other) if entries.is_complex else 0.0
                entries.values.append(complex(real(path, what, one), imaginary))
    return {name: entries.matrix(path, name) for name, entries in found.items()}
