"""Matrix Market files. NumPy reads their numbers, since SciPy's reader accepts words that only begin with a number."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, Matrix
from femsub.errors import InputError, unknown_name
from femsub.io.abaqus_calculix import lines_of_numbers
from femsub.io.damage import check_end, check_extent

LAYOUTS = ("coordinate", "array")
PLACE = [("row", "i8"), ("column", "i8")]
FIELDS = {"real": [("value", "f8")], "integer": [("value", "i8")], "complex": [("value", "f8"), ("imaginary", "f8")]}
#: symmetry, and what an entry of the triangle in the file is in the other one
MIRRORED = {"general": None, "symmetric": np.positive, "skew-symmetric": np.negative, "hermitian": np.conjugate}


class _Header(NamedTuple):
    layout: str
    field: str
    symmetry: str
    shape: tuple[int, int]
    entries: int  # number of lines after the header
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
        See the table. The message names the word, and its line counted from the first line of numbers.
    """
    check_end(path)
    header = _header(path)
    sparse = header.layout == "coordinate"
    table = lines_of_numbers(path, header.lines, dtype=PLACE * sparse + FIELDS[header.field])
    if len(table) != header.entries:
        short = "is a Truncated file, cut short" if len(table) < header.entries else "is damaged"
        raise InputError(f"{path} {short}: it announces {header.shape[0]} x {header.shape[1]} with {header.entries} entries, but "
                         f"has {len(table)}; write it again")
    values = table["value"] + 1j * table["imaginary"] if header.field == "complex" else table["value"]
    if np.isinf(values).any() and b"inf" not in path.read_bytes().lower():  # NaN and Inf are left to the user of the matrix
        raise InputError(f"{path} holds a number too large for a double in data line {int(np.argmax(np.isinf(values))) + 1}")
    return _sparse(path, header, table["row"] - 1, table["column"] - 1, values) if sparse else _dense(header, values)


def _sparse(path: Path, header: _Header, rows: Array, columns: Array, values: Array) -> Matrix:
    outside = (np.minimum(rows, columns) < 0) | (rows >= header.shape[0]) | (columns >= header.shape[1])
    if outside.any():
        raise InputError(f"{path}, data line {int(np.argmax(outside)) + 1}: row or column is out of bounds")
    beside = rows != columns
    if header.symmetry == "skew-symmetric" and values[~beside].any():
        raise InputError(f"{path} is skew-symmetric, but has entries on the diagonal, first in row "
                         f"{rows[~beside & (values != 0)].min() + 1}")
    if mirrored := MIRRORED[header.symmetry]:
        rows, columns = np.append(rows, columns[beside]), np.append(columns, rows[beside])
        values = np.append(values, mirrored(values[beside]))
    matrix = sp.csr_array((values, (rows.astype(np.int32), columns.astype(np.int32))), shape=header.shape)
    if matrix.nnz < len(values):
        order = np.lexsort((columns, rows))
        rows, columns = rows[order], columns[order]
        first = int(np.flatnonzero((np.diff(rows) == 0) & (np.diff(columns) == 0))[0])
        raise InputError(f"{path} lists an entry twice: row {rows[first] + 1}, column {columns[first] + 1}; each may stand once"
                         + (f", and of a {header.symmetry} matrix one triangle only" if mirrored else ""))
    return matrix


def _dense(header: _Header, values: Array) -> Array:
    """The matrix of its columns one after the other, or of those of its lower triangle."""
    mirrored = MIRRORED[header.symmetry]
    if not mirrored:
        return values.reshape(header.shape, order="F")
    columns, rows = np.triu_indices(header.shape[0], header.symmetry == "skew-symmetric")
    matrix = np.zeros(header.shape, dtype=values.dtype)
    matrix[columns, rows] = mirrored(values)
    matrix[rows, columns] = values
    return matrix


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
        for what, word, known in (("layout", layout, LAYOUTS), ("field", field, FIELDS), ("symmetry", symmetry, MIRRORED)):
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
        wanted = "rows, columns and entries" if layout == "coordinate" else "rows and columns"
        raise InputError(f"{path}: line {lines} must have {wanted}, but is {line.decode('ascii', 'replace').strip()!r:.100}")
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
    return _Header(layout, field, symmetry, (rows, columns), count, lines)
