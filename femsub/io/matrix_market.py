"""Matrix Market files. NumPy reads their numbers, since SciPy's reader accepts words that only begin with a number."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from femsub.checks import InputError, Matrix, unknown_name
from femsub.io.abaqus_calculix import lines_of_numbers
from femsub.io.damage import assembled, check_end, check_extent

LAYOUTS = ("coordinate", "array")
PLACE = [("row", "i8"), ("column", "i8")]
FIELDS = {"real": [("value", "f8")], "integer": [("value", "i8")], "complex": [("value", "f8"), ("imaginary", "f8")]}
#: symmetry: what turns an entry of the triangle in the file into its entry of the other triangle
MIRRORED = {"general": None, "symmetric": np.positive, "skew-symmetric": np.negative, "hermitian": np.conjugate}


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
    # header: a first line of five words, comments, and a line of sizes
    with open(path, "rb") as file:
        start = file.readline(1000)
        banner = start.decode("ascii", "replace")
        words = banner.lower().split()
        if len(words) != 5 or words[:2] != ["%%matrixmarket", "matrix"]:
            raise InputError(f"{path}: the first line must be '%%MatrixMarket matrix', layout, field and symmetry, but is "
                             f"{banner.strip()!r:.100}")
        layout, field, symmetry = words[2:]
        if field == "pattern":
            raise InputError(f"{path} is a pattern: it has the positions of entries, but no values. Write it with field real")
        for what, word, known in (("layout", layout, LAYOUTS), ("field", field, FIELDS), ("symmetry", symmetry, MIRRORED)):
            if word not in known:
                raise InputError(f"{path}: {unknown_name(what, word, known)}")
        line, lines, size = b"%", 1, path.stat().st_size - len(start)
        while line.startswith(b"%") or (line and not line.strip()):
            line = file.readline()
            lines, size = lines + 1, size - len(line)
    sparse, sizes = layout == "coordinate", line.split()
    if len(sizes) != 2 + sparse or not re.fullmatch(rb"(\d{1,18} ){2,3}", b" ".join(sizes) + b" "):
        wanted = "rows, columns and entries" if sparse else "rows and columns"
        raise InputError(f"{path}: line {lines} must have {wanted}, but is {line.decode('ascii', 'replace').strip()!r:.100}")
    n, m = shape = int(sizes[0]), int(sizes[1])
    if symmetry != "general" and n != m:
        raise InputError(f"{path} is {symmetry}, but has {n} rows and {m} columns")
    if sparse:
        count = int(sizes[2])
    else:
        count = n * m if symmetry == "general" else n * (n + 1) // 2 - (n if symmetry == "skew-symmetric" else 0)
    if count * (6 if sparse else 2) > size:  # '1 1 1' and '1' with the end of the line
        raise InputError(f"{path} is a Truncated file, cut short: it announces {n} x {m} with {count} entries, "
                         f"but only {size} bytes follow; write it again")
    check_extent(path, shape, count)
    # numbers: for each entry its place if it is sparse, and its value
    table = lines_of_numbers(path, lines, dtype=PLACE * sparse + FIELDS[field])
    if len(table) != count:
        short = "is a Truncated file, cut short" if len(table) < count else "is damaged"
        raise InputError(f"{path} {short}: it announces {n} x {m} with {count} entries, but has {len(table)}; write it again")
    values = table["value"] + 1j * table["imaginary"] if field == "complex" else table["value"]
    if np.isinf(values).any() and b"inf" not in path.read_bytes().lower():  # NaN and Inf are left to the user of the matrix
        raise InputError(f"{path} holds a number too large for a double in data line {int(np.argmax(np.isinf(values))) + 1}")
    mirrored = MIRRORED[symmetry]
    # a dense matrix: its columns one after the other, or those of its lower triangle
    if not sparse:
        if mirrored is None:
            return values.reshape(shape, order="F")
        columns, rows = np.triu_indices(n, symmetry == "skew-symmetric")
        matrix = np.zeros(shape, dtype=values.dtype)
        matrix[columns, rows] = mirrored(values)
        matrix[rows, columns] = values
        return matrix
    # a sparse matrix: each entry within it and once, and of a symmetric one its partner
    rows, columns = table["row"] - 1, table["column"] - 1
    outside = (np.minimum(rows, columns) < 0) | (rows >= n) | (columns >= m)
    if outside.any():
        raise InputError(f"{path}, data line {int(np.argmax(outside)) + 1}: row or column is out of bounds")
    if symmetry == "skew-symmetric" and (wrong := (rows == columns) & (values != 0)).any():
        raise InputError(f"{path} is skew-symmetric, but has entries on the diagonal, first in row {rows[wrong].min() + 1}")
    return assembled(str(path), rows.astype(np.int32), columns.astype(np.int32), values, shape, mirrored)
