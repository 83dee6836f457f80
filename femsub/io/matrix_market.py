"""Matrix Market files. Every character is checked, since SciPy's reader accepts words that only begin with a number."""

from __future__ import annotations

import io
import re
from inspect import signature
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, Matrix
from femsub.errors import InputError, unknown_name
from femsub.io.abaqus_calculix import fortran_mended
from femsub.io.damage import check_end, check_extent

LAYOUTS = ("coordinate", "array")
FIELDS = {"real": 1, "integer": 1, "complex": 2}  # and how many numbers a value has
SYMMETRIES = ("general", "symmetric", "skew-symmetric", "hermitian")
BLOCK = 1 << 22  # bytes that are checked at a time

_DIGIT, _MINUS, _PLUS, _POINT, _EXPONENT, _BLANK, _END, _OTHER = range(8)
_KIND = bytes(_DIGIT if byte in b"0123456789" else {b"-"[0]: _MINUS, b"+"[0]: _PLUS, b"."[0]: _POINT, b"e"[0]: _EXPONENT,
              b"E"[0]: _EXPONENT, b" "[0]: _BLANK, b"\t"[0]: _BLANK, b"\n"[0]: _END}.get(byte, _OTHER) for byte in range(256))


def _pairs(followers: dict[int, set[int]]) -> bytes:
    return bytes(8 * first + second for first, seconds in followers.items() for second in seconds)


#: what may follow what
_NEIGHBOURS = _pairs({
    _DIGIT: {_DIGIT, _POINT, _EXPONENT, _BLANK, _END}, _MINUS: {_DIGIT, _POINT}, _PLUS: {_DIGIT},
    _POINT: {_DIGIT, _EXPONENT, _BLANK, _END}, _EXPONENT: {_DIGIT, _MINUS, _PLUS},
    _BLANK: {_DIGIT, _MINUS, _POINT, _BLANK, _END}, _END: {_DIGIT, _MINUS, _POINT, _BLANK, _END}})
#: the same in lines without their digits and signs: blanks, then one point at most, then one 'e' at most
_MARKS = {"real": _pairs({_END: {_END, _BLANK, _POINT, _EXPONENT}, _BLANK: {_END, _BLANK, _POINT, _EXPONENT},
                          _POINT: {_EXPONENT, _END}, _EXPONENT: {_END}}),
          "integer": _pairs({_END: {_END, _BLANK}, _BLANK: {_END, _BLANK}})}
#: 1 where a pair of neighbours begins a word, 2 where it ends the last word of a line
_EDGES = bytes(1 if pair // 8 in (_BLANK, _END) and pair % 8 in (_DIGIT, _MINUS, _POINT) else
               2 if pair // 8 in (_DIGIT, _POINT) and pair % 8 == _END else 0 for pair in range(256))
_REAL, _WHOLE = rb"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|(?i:nan|inf))", rb"[+-]?\d+"


class _Header(NamedTuple):
    layout: str
    field: str
    symmetry: str
    shape: tuple[int, int]
    entries: int  # number of lines after the header
    start: int  # first byte after the header
    lines: int  # lines of the header


def read_market(path: Path) -> Matrix:
    """A, shape (n, m): CSR from 'coordinate', dense from 'array'.

    ===================  =======================================================================================
    it reads             real, integer and complex; general, symmetric, skew-symmetric and hermitian, of which
                         the file holds one triangle (either one); Fortran's exponents 2.5D+03 and 2.5+103
    it refuses           a word that is not a number, with its line; 1e400; more or fewer lines than the header
                         announces; an entry listed twice, so both triangles of a symmetric matrix; an
                         index out of range; 'pattern', which holds no values; sizes far beyond the entries
    it cannot know       whether a digit is wrong; whether a comment (%) holds what was meant as data
    ===================  =======================================================================================

    Raises
    ------
    InputError
        See the table. The message names line and word.
    """
    check_end(path)
    header = _header(path)
    mended = _checked(path, header)
    try:
        found = _by_scipy(path if mended is None else mended)
    except (ValueError, OverflowError) as error:
        if mended is None:  # name the word, if it is one: a line too short, a point without digits
            content = path.read_bytes()[header.start:]
            _line_by_line(path, _without_plus(fortran_mended(_tidy(content))), header, header.lines)
        raise InputError(f"{path} cannot be read: {str(error).rstrip('.')}; it may be cut short or damaged, write it again") \
            from None
    finite = np.isfinite(found.data if sp.issparse(found) else found)
    # NaN is left to the user of the matrix; a number too large for a double must not become Inf
    if not finite.all() and (mended is None or not re.search(rb"(?i)nan|inf", mended.getbuffer()[header.start:])):
        row, column = (int(found.row[np.argmin(finite)]), int(found.col[np.argmin(finite)])) if sp.issparse(found) else \
            np.argwhere(~finite)[0].tolist()
        raise InputError(f"{path} holds a number too large for a double in row {row + 1}, column {column + 1}")
    if not sp.issparse(found):
        return found
    matrix = sp.csr_array(found)
    if matrix.nnz < found.nnz:
        _refuse_twice(path, header, found)
    if header.symmetry == "skew-symmetric" and matrix.diagonal().any():
        raise InputError(f"{path} is skew-symmetric, but has entries on the diagonal, first in row "
                         f"{int(np.flatnonzero(matrix.diagonal())[0]) + 1}")
    return matrix


def _by_scipy(source: Path | io.BytesIO) -> Any:
    """Read by SciPy, as an array if that can be chosen: 1.18 warns if it is not, 1.12 has no such option."""
    from scipy.io import mmread

    return mmread(source, **({"spmatrix": False} if "spmatrix" in signature(mmread).parameters else {}))


def _header(path: Path) -> _Header:
    with open(path, "rb") as file:
        banner = file.readline(1000)
        words = banner.decode("ascii", "replace").lower().split()
        if len(words) != 5 or words[:2] != ["%%matrixmarket", "matrix"]:
            raise InputError(f"{path}: the first line must be '%%MatrixMarket matrix', layout, field and symmetry, but is "
                             f"{banner.decode('ascii', 'replace').strip()!r:.100}")
        layout, field, symmetry = words[2:]
        if field == "pattern":
            raise InputError(f"{path} is a pattern: it has the positions of entries, but no values. Write it with field real")
        for what, word, known in (("layout", layout, LAYOUTS), ("field", field, FIELDS), ("symmetry", symmetry, SYMMETRIES)):
            if word not in known:
                raise InputError(f"{path}: {unknown_name(what, word, known)}")
        line, lines = b"%", 1
        while line.startswith(b"%") or (line and not line.strip()):
            line = file.readline()
            lines += 1
        start = file.tell()
        size = file.seek(0, io.SEEK_END) - start
    sizes = line.split()
    if not re.fullmatch(rb"(\d{1,18} ){3}" if layout == "coordinate" else rb"(\d{1,18} ){2}", b" ".join(sizes) + b" "):
        told = "rows, columns and entries" if layout == "coordinate" else "rows and columns"
        raise InputError(f"{path}: line {lines} must tell {told}, but is {line.decode('ascii', 'replace').strip()!r:.100}")
    rows, columns = int(sizes[0]), int(sizes[1])
    if symmetry != "general" and rows != columns:
        raise InputError(f"{path} is {symmetry}, but has {rows} rows and {columns} columns")
    if layout == "coordinate":
        count = int(sizes[2])
    else:
        count = rows * columns if symmetry == "general" else rows * (rows + 1) // 2 - (rows if symmetry[:4] == "skew" else 0)
    if count * (6 if layout == "coordinate" else 2) > size:  # '1 1 1' and '1' with the end of the line
        raise InputError(f"{path} is a Truncated file, cut short: it announces {rows} x {columns} with {count} entries, "
                         f"but only {size} bytes follow; write it again")
    check_extent(path, (rows, columns), count)
    return _Header(layout, field, symmetry, (rows, columns), count, start, lines)


def _checked(path: Path, header: _Header, mend: bool = False) -> io.BytesIO | None:
    """Check each word after the header. None if SciPy can read the file, else the file with exponents that SciPy can read."""
    found, line, mended = 0, header.lines, io.BytesIO()
    with open(path, "rb") as file:
        mended.write(file.read(header.start))
        while block := file.read(BLOCK) + file.readline():
            text = _tidy(_without_plus(fortran_mended(block)) if mend else block)
            count = _lines_of_numbers(text, header)
            if count is None and not mend:
                return _checked(path, header, mend=True)
            found += _line_by_line(path, text, header, line) if count is None else count
            if mend:
                line += block.count(b"\n")
                mended.write(text)
    if found != header.entries:
        short = "is a Truncated file, cut short" if found < header.entries else "is damaged"
        raise InputError(f"{path} {short}: it announces {header.shape[0]} x {header.shape[1]} with {header.entries} entries, but "
                         f"has {found}; write it again")
    mended.seek(0)
    return mended if mend else None


def _tidy(block: bytes) -> bytes:
    """The block without carriage returns and blanks at line ends."""
    if b"\r" in block:
        block = block.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return re.sub(rb"[ \t]+\n", b"\n", block) if b" \n" in block or b"\t\n" in block else block


def _without_plus(block: bytes) -> bytes:
    return re.sub(rb"(?<![^\s])\+(?=[\d.])", b"", block)


def _lines_of_numbers(block: bytes, header: _Header) -> int | None:
    """The number of lines of numbers in a block, or None if any word is not a valid number.

    Lines are not checked one by one: pairs of neighbouring characters decide most cases, and without digits few shapes remain.
    """
    if header.field == "complex":
        return None
    neighbours = _neighbours((b"\n" + block).translate(_KIND))
    if neighbours.translate(None, _NEIGHBOURS):
        return None
    edges: Array = np.frombuffer(neighbours.translate(_EDGES), dtype=np.uint8)
    lines = int(np.count_nonzero(edges == 2))
    if np.count_nonzero(edges == 1) != lines * (3 if header.layout == "coordinate" else 1):
        return None
    marks = _neighbours((b"\n" + block).translate(_KIND, b"0123456789+-"))
    return None if marks.translate(None, _MARKS[header.field]) else lines


def _neighbours(kinds: bytes) -> bytes:
    """One byte for each pair of neighbouring bytes below 8."""
    numbers: Array = np.frombuffer(kinds, dtype=np.uint8)
    return ((numbers[:-1] << 3) | numbers[1:]).tobytes()


def _line_by_line(path: Path, block: bytes, header: _Header, line: int) -> int:
    """The same check line by line, to find the wrong word for the message."""
    value = [_WHOLE if header.field == "integer" else _REAL] * FIELDS[header.field]
    wanted = [re.compile(word) for word in ([_WHOLE] * 2 if header.layout == "coordinate" else []) + value]
    count = 0
    for number, text in enumerate(block.split(b"\n"), line + 1):
        words = text.split()
        for place, word in enumerate(words):
            if place == len(wanted):
                raise InputError(f"{path}, line {number}: {word.decode('ascii', 'replace')!r} is one word too many")
            if not wanted[place].fullmatch(word):
                what = "whole number" if wanted[place].pattern == _WHOLE else "number"
                raise InputError(f"{path}, line {number}: {word.decode('ascii', 'replace')!r:.60} is not a {what}")
        if words and len(words) < len(wanted):
            raise InputError(f"{path}, line {number}: {len(words)} words, but a line has {len(wanted)}; it may be cut short")
        count += bool(words)
    return count


def _refuse_twice(path: Path, header: _Header, found: Any) -> None:
    order = np.lexsort((found.col, found.row))
    rows, columns = found.row[order], found.col[order]
    first = int(np.flatnonzero((np.diff(rows) == 0) & (np.diff(columns) == 0))[0])
    raise InputError(f"{path} lists an entry twice: row {rows[first] + 1}, column {columns[first] + 1}; each may stand once"
                     + ("" if header.symmetry == "general" else f", and of a {header.symmetry} matrix one triangle only"))
