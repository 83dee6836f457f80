"""The text formats of Abaqus and CalculiX: sparse matrices line by line, and the node and direction of each row."""

from __future__ import annotations

import csv
import io
import re
import warnings
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, InputError, Matrix, csv_cell
from femsub.io.damage import assembled, check_end, check_extent, mirrored
from femsub.model import LARGEST, DofMap

#: directions 1 to 6 of Abaqus, CalculiX and Nastran; others (8 pressure, 11 temperature, ...) are called 'dof8'
DIRECTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")
HELD = 1e36  # Abaqus' diagonal entry in K for a DOF that a boundary condition holds
AS_WRITTEN = "*MATRIX OUTPUT with FORMAT=MATRIX INPUT or COORDINATE"


@dataclass(frozen=True)
class TextMatrix:
    """A matrix, shape (n, m), and the (node, direction) of each row if the file has them, shape (n, 2), ascending.

    `columns` (m, 2) has those of the columns, or None if they are the same as those of the rows.
    """

    matrix: Matrix
    rows: Array | None = None
    columns: Array | None = None

    @property
    def labels(self) -> Array | None:
        """(node, direction) of the rows if the columns have the same, else None."""
        return self.rows if self.columns is None else None


def read_text_matrix(path: Path) -> TextMatrix:
    """A matrix as Abaqus or CalculiX writes it, one triangle or both, shape (n, n).

    Lines are 'row node, row DOF, column node, column DOF, value' (Abaqus, FORMAT=MATRIX INPUT) or 'row column value',
    counted from 1 (Abaqus, FORMAT=COORDINATE; CalculiX, SOLVER=MATRIXSTORAGE). A file that holds one triangle is mirrored.

    ===================  =======================================================================================
    it reads             both kinds of lines, with blanks or commas; comments (**) and empty lines; Fortran's
                         exponents 2.5D+03 and 2.5+103
    it refuses           a word that is not a number, NaN and Inf, lines of another length, an entry twice, an entry
                         without its transposed one beside complete pairs, a row without its diagonal, a last line
                         without its end, a row number far beyond the entries
    it cannot know       whether a digit is wrong; whether one triangle lost entries off the diagonal, or the last
                         rows are missing: the file has no count (M and K are compared)
    ===================  =======================================================================================

    Raises
    ------
    InputError
        A line that is incomplete or not numeric, NaN, an entry listed twice, neither a triangle nor a full matrix.
    """
    check_end(path)
    # heading: up to the first line of data
    heading, first = 0, ""
    with open(path, encoding="ascii", errors="replace") as file:
        for first in file:
            if first.strip() and not first.startswith("**"):
                break
            heading += 1
    if first.startswith("*") and not first.startswith("**"):
        raise InputError(f"{path} holds keywords ({first.strip()[:40]}); only matrices of *MATRIX GENERATE are read: "
                         f"{AS_WRITTEN}")
    # numbers of each line: places, then the entry
    table = lines_of_numbers(path, heading, "," if "," in first else None, comment=("**",))
    if not table.size:
        raise InputError(f"{path} is empty")
    if table.shape[1] not in (3, 5):
        extra = " (ELEMENT BY ELEMENT matrices are not assembled)" if table.shape[1] == 6 else ""
        raise InputError(f"{path} has {table.shape[1]} numbers a line{extra}; Abaqus writes 5 or 3 and CalculiX 3: {AS_WRITTEN}")
    places, values = table[:, :-1], table[:, -1]
    if not np.isfinite(values).all():
        raise InputError(f"{path} holds a NaN or Inf, first in data line {int(np.argmin(np.isfinite(values))) + 1}")
    sound = (places == np.floor(places)) & (np.abs(places) < LARGEST)  # NaN is neither
    if not sound.all():
        where = int(np.argmin(sound.all(axis=1)))
        raise InputError(f"{path}: the place of an entry must be whole numbers, but data line {where + 1} has "
                         f"{', '.join(f'{value:g}' for value in places[where])}")
    numbers = places.astype(np.int64)
    if numbers.shape[1] == 2:
        if numbers.min() < 1:
            raise InputError(f"{path}: rows and columns count from 1, but data line {int(numbers.min(axis=1).argmin()) + 1} "
                             f"has {numbers.min()}; {AS_WRITTEN}")
        size = int(numbers.max())
        check_extent(path, (size, size), len(values))
        return TextMatrix(_unfolded(path, numbers[:, 0] - 1, numbers[:, 1] - 1, values, size, None))
    if numbers[:, [1, 3]].min() < 0 or numbers[:, [1, 3]].max() > 99:
        raise InputError(f"{path}: the second and fourth number of a line must be DOF such as 1 to 6; {AS_WRITTEN}")
    # one number per (node, direction): a million of them sort much faster than pairs do
    keys = numbers[:, 0::2] * 100 + numbers[:, 1::2]
    unique = np.unique(keys)
    index = np.searchsorted(unique, keys)
    labels = np.stack([unique // 100, unique % 100], axis=1)
    return TextMatrix(_unfolded(path, index[:, 0], index[:, 1], values, len(unique), labels), labels)


def _unfolded(path: Path, rows: Array, columns: Array, values: Array, size: int, labels: Array | None) -> Matrix:
    matrix = assembled(str(path), rows, columns, values, (size, size), labels=labels)
    below, above = int((rows > columns).sum()), int((rows < columns).sum())
    ones = sp.csr_array((np.ones(matrix.nnz), matrix.indices, matrix.indptr), shape=matrix.shape)
    paired = int(ones.multiply(ones.T).nnz) - int((rows == columns).sum()) if below and above else 0
    # with node and DOF, each entry may be in either triangle: Abaqus chooses which row comes first
    if not paired and (not below or not above or labels is not None):
        _check_diagonal(path, rows, columns, size, labels)
        return mirrored(matrix)
    if paired == below + above and (matrix != matrix.T).nnz == 0:
        _check_diagonal(path, rows, columns, size, labels)
    if paired < below + above:
        raise InputError(f"{path} is neither one triangle nor a full matrix: {below} entries below the diagonal and {above} "
                         f"above, {below + above - paired} of them without the transposed entry. Write it again: it may be "
                         "cut short")
    return matrix


def _check_diagonal(path: Path, rows: Array, columns: Array, size: int, labels: Array | None) -> None:
    """Refuse a missing diagonal entry: the last line of these files is on the diagonal, so a file cut short lacks it."""
    on = rows == columns
    empty = np.setdiff1d(np.concatenate([rows[~on], columns[~on]]), rows[on])
    if labels is not None:
        empty = empty[labels[empty, 0] > 0]  # Abaqus' own nodes, below 0, may be Lagrange multipliers
    if len(empty):
        place = f"row {empty[0] + 1}" if labels is None else f"node {labels[empty[0]][0]}, DOF {labels[empty[0]][1]}"
        raise InputError(f"{path} has entries, but none on the diagonal, for {len(empty)} of {size} DOF, first {place}; it may "
                         "be cut short, write it again")


def lines_of_numbers(path: Path, skip: int, delimiter: str | None = None, dtype: Any = float,
                     comment: tuple[str, ...] = ()) -> Array:
    """The numbers behind the first `skip` lines, without lines that begin as a comment.

    Raises
    ------
    InputError
        A word that is no number, a line of another length. The message counts the lines with data from 1.
    """
    try:
        return _loaded(path, path, delimiter, dtype, skip)
    except InputError:  # NumPy cannot read comments between the lines or Fortran's exponents
        with open(path, encoding="utf-8", errors="replace") as file:
            mended = (fortran_mended(line) for line in islice(file, skip, None) if not line.startswith(comment))
            return _loaded(path, mended, delimiter, dtype)


def fortran_mended(text: str) -> str:
    """2.5e+03 and 2.5e+103 for Fortran's 2.5D+03 and 2.5+103: Fortran omits the letter before exponents of three digits."""
    text = re.sub(r"(?<=[\d.])[dD](?=[+-]?\d)", "e", text)
    return re.sub(r"(\d\.\d*|\.\d+)([+-]\d{3})(?!\d)", r"\1e\2", text, flags=re.ASCII)


def _loaded(path: Path, source: Any, delimiter: str | None, dtype: Any = float, skip: int = 0) -> Array:
    """NumPy's table, or an error that names the line in which NumPy stopped."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a file without data
            warnings.simplefilter("error", DeprecationWarning)  # 1.5 where a whole number belongs
            return np.loadtxt(source, dtype=dtype, delimiter=delimiter, ndmin=2 if dtype is float else 1, encoding="utf-8",
                              skiprows=skip, comments=None, quotechar='"' if "U" in str(dtype) else None)
    except ValueError as error:
        reason = str(error).split(";")[0].rstrip(".")
        if found := re.match(r"could not convert string (.+) to \w+ at row (\d+)", reason):
            reason = f"{found[1]} in data line {int(found[2]) + 1} is not a {'whole ' * (' int' in reason)}number"
        elif found := re.search(r"(?:changed from|requires) (\d+) (?:to|columns but) (\d+) .*at row (\d+)", reason):
            reason = f"data line {found[3]} has {found[2]} values, not {found[1]}"
        raise InputError(f"{path} cannot be read: {reason}; it may be cut short, write it again") from None


def dof_map(labels: Array) -> DofMap:
    """The map of (node, direction) pairs, shape (n, 2), with directions from 1 as Abaqus and CalculiX number them."""
    directions = np.unique(labels[:, 1])
    names = DIRECTIONS[:3] if len(directions) and 1 <= directions.min() <= directions.max() <= 3 else DIRECTIONS
    others = directions[(directions < 1) | (directions > len(names))]
    index = np.where(np.isin(labels[:, 1], others), len(names) + np.searchsorted(others, labels[:, 1]), labels[:, 1] - 1)
    return DofMap(labels[:, 0], index, (*names, *(f"dof{number}" for number in others)))


def read_dofs(path: Path, labels: tuple[str, ...] | None = None) -> DofMap:
    """A DOF map from text, one line per DOF: 'node.direction' (CalculiX' .dof) or 'node,component[,x[,y[,z]]]'.

    Components are names ('uz') or directions from 1 (3); a first line that starts with 'node' is a heading. Refused are a
    node or direction that is not a whole number, a coordinate that is not finite, and the same motion of a node twice. Missing
    lines are detected by the size of the matrices only.

    Raises
    ------
    InputError
        A line in neither format, or the same motion of the same node twice.
    """
    if not path.is_file():
        raise InputError(f"dofs: there is no file {path}")
    check_end(path)
    text = path.read_bytes().decode("utf-8", "replace").replace("\r\n", "\n")
    heading, _, rest = text.partition("\n")
    body = rest if heading.lower().lstrip("\ufeff ").startswith("node") else text
    first = body.lstrip().partition("\n")[0]
    if not first:
        raise InputError(f"{path} is empty")
    try:
        if "," not in first:
            cells = _loaded(path, io.StringIO(body), None, _text_type(body))
            if cells.ndim != 1:
                raise InputError("each line must be one word, 'node.direction'")
            parts = np.char.partition(cells, ".")
            return dof_map(np.stack([_whole(path, parts[:, 0]), _whole(path, parts[:, 2])], axis=1))
        width = len(next(csv.reader([first])))
        if not 2 <= width <= 5:
            raise InputError(f"the first line has {width} values; a line is 'node,component' or 'node,component,x,y,z'")
        word = _text_type(body)
        table = _loaded(path, io.StringIO(body), ",", [("node", word), ("component", word), *(
            (axis, float) for axis in ("x", "y", "z")[:width - 2])])
        nodes, components = _whole(path, table["node"]), np.char.strip(table["component"])
        points = np.stack([table[axis] for axis in ("x", "y", "z")[:width - 2]], axis=1) if width > 2 else None
        if points is not None and not np.isfinite(points).all():
            raise InputError(f"the place of data line {int(np.argmin(np.isfinite(points).all(axis=1))) + 1} is not finite")
        if (marked := np.char.startswith(components, "'")).any():  # see `csv_cell`
            components[marked] = [cell[1:] if csv_cell(cell[1:]) == cell else cell for cell in components[marked].tolist()]
        if (components == "").any():
            raise InputError(f"data line {int(np.argmax(components == '')) + 1} has no component")
        if np.char.isdecimal(components).all():
            plain = dof_map(np.stack([nodes, _whole(path, components)], axis=1))
            return DofMap(plain.nodes, plain.components, plain.labels, points)
        found = set(components.tolist())
        if labels and found <= set(labels):
            names = labels
        elif found <= set(DIRECTIONS[:3]):
            names = DIRECTIONS[:3]
        else:
            names = (*(name for name in DIRECTIONS if name in found), *sorted(found - set(DIRECTIONS)))
        order = np.argsort(names)
        place = np.searchsorted(np.array(names)[order], components)
        return DofMap(nodes, order[place], names, points)
    except InputError as error:
        message = str(error)
        raise InputError(message if message.startswith(str(path)) else f"{path}: {message}") from None


def _text_type(text: str) -> str:
    """NumPy's type for words as long as the longest line; a shorter type would silently truncate words."""
    return f"U{max(8, max(map(len, text.splitlines()), default=0))}"


def _whole(path: Path, cells: Array) -> Array:
    try:
        plain = np.char.strip(cells).astype("S")  # Python's int() accepts digits of other scripts, and 1_0
        if (np.char.find(plain, b"_") < 0).all():
            found = plain.astype(np.int64)
            if (np.abs(found) < LARGEST).all():
                return found
    except (ValueError, OverflowError):
        pass
    bad = next(str(cell) for cell in cells if not re.fullmatch(r"\s*[-+]?[0-9]{1,15}\s*", str(cell)))
    raise InputError(f"{path}: {bad!r} is not a node or direction; a line is 'node.direction', as 12.3, or "
                     "'node,component', as 12,uz")


def write_dofs(file: BinaryIO, dofs: DofMap) -> None:
    """Write the map as CSV with a heading: node, component and, if known, x, y, z with all digits."""
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    columns = [dofs.nodes.tolist(), np.array([csv_cell(label) for label in dofs.labels])[dofs.components].tolist()]
    columns += [] if dofs.points is None else dofs.points.T.tolist()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("node", "component", "x", "y", "z")[:len(columns)])
    writer.writerows(zip(*columns, strict=True))
    text.flush()
    text.detach()
