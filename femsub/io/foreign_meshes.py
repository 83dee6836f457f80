"""Mesh files that are read by meshio, with checks against the counts in their headers; and TetGen's pair of files."""

from __future__ import annotations

import contextlib
import io
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from femsub.checks import Array, InputError
from femsub.io.damage import THROWN, check_end, check_room, head_of
from femsub.io.mesh_text import as_numbers, meshio, text_of

_VTK_COUNTS = re.compile(rb"^(POINTS|CELLS|CELL_TYPES|POINT_DATA|CELL_DATA|LOOKUP_TABLE|DIMENSIONS|[XYZ]_COORDINATES|SCALARS|"
                         rb"\S+ \d+ \d+ (?=[a-zA-Z]))([^\n]*)", re.MULTILINE | re.IGNORECASE)


def read_foreign(path: Path) -> tuple[Any, list[str]]:
    """A file read by meshio, and meshio's messages.

    ==============  ==========================================================================================================
    reads           what meshio reads: VTU, VTK, MED, XDMF, SU2, Ansys .msh, Medit, ...
    refuses         Fluent's .msh (cells by their faces);
                    VTU, VTK and SU2 with more or fewer points or cells than their headers say, or sizes beyond the file's own;
                    in their text, and XDMF's, words that begin like a number and are none;
                    VTU in several pieces; SU2 with lines that do not belong, or a last line that does not end; Ansys files
                    without an end
    cannot know     for the other formats, what meshio does not check; whether arrays are missing at a cut file's end
    ==============  ==========================================================================================================

    Raises
    ------
    InputError
        What is refused, or what meshio says.
    """
    suffix = path.suffix.lower()
    counted = {".vtk": _vtk, ".su2": _su2, ".vtu": _xml, ".xdmf": _xml, ".xmf": _xml}.get(suffix)
    points, cells = counted(path, path.read_bytes()) if counted else (None, None)
    what = f"{path} cannot be read as a mesh"
    if suffix == ".msh" and head_of(path).lstrip()[:1] == b"(":  # of Ansys
        if re.search(rb"^[ \t\r]*\((20|30)?13\b", path.read_bytes(), re.MULTILINE):
            raise InputError(f"{path} is a mesh of Fluent, which describes cells by the faces between them; femsub does not read "
                             "these. Write the mesh in another format, e.g. as Gmsh's .msh, .inp or .bdf")
        with _Ending(io.FileIO(path)) as file:
            found, said = quietly(lambda: meshio().read(file, "ansys"), what)
    else:
        found, said = quietly(lambda: meshio().read(path), what, _Lost() if suffix == ".su2" else None)
    if "not closed" in said:
        raise InputError(f"{path} is cut short: {said}")
    for name, count, promised in (("points", len(found.points), points), ("cells", sum(len(b.data) for b in found.cells), cells)):
        if promised is not None and count != promised:
            raise InputError(f"{path} has {count} {name}, but its header says {promised}: is it cut short or damaged?")
    return found, [f"meshio: {said}"] if said else []


class _Lost(io.StringIO):
    """Collects meshio's messages, and raises an error at the first line that meshio passes over: each message takes it 1 ms."""

    def write(self, text: str) -> int:
        if "could not parse" in text:
            raise ValueError(f"it has lines that do not belong to what is above them: {' '.join(text.split())}")
        return super().write(text)


def quietly(act: Callable[[], Any], what: str, into: io.StringIO | None = None) -> tuple[Any, str]:
    """The result and the printed text. Any exception of meshio, including SystemExit, becomes an InputError of one line."""
    said, own = into or io.StringIO(), meshio()._exceptions  # meshio exports only two of them
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return act(), " ".join(said.getvalue().split())
    except (*THROWN, own.ReadError, own.WriteError, own.CorruptionError, SystemExit) as error:
        text = " ".join(said.getvalue().split()) if isinstance(error, SystemExit) else " ".join(str(error).split())
        if isinstance(error, (LookupError, AssertionError)):  # their text alone is not clear
            text = f"{text} ({type(error).__name__}); is it cut short or damaged?".strip()
        raise InputError(f"{what}: {text or 'is it cut short or damaged?'}") from None


class _Ending(io.BufferedReader):
    """A file that raises an error if its end is read repeatedly, as in meshio's loops that wait for a bracket."""

    empty = 0

    def _count(self, data: bytes, size: int | None) -> bytes:
        self.empty = 0 if data or size == 0 else self.empty + 1
        if self.empty > 10:
            raise EOFError("the file ends before a bracket is closed: is it cut short?")
        return data

    def read(self, size: int | None = -1) -> bytes:
        return self._count(super().read(size), size)

    def readline(self, size: int | None = -1) -> bytes:
        return self._count(super().readline(size), size)


def _vtk(path: Path, raw: bytes) -> tuple[int | None, int | None]:
    """Points and cells announced in the header of a legacy VTK file; no size in it may exceed the file's size."""
    if b"ASCII" in [line.strip().upper() for line in raw.split(b"\n", 3)[2:3]]:
        check_end(path)
        _all_numbers(path, raw[raw.find(b"\nDATASET"):])
    counts: dict[bytes, int] = {}
    for match in _VTK_COUNTS.finditer(raw):
        numbers = [int(word.lstrip(b"0")[:18] or 0) for word in match[0].split()[1:] if word.isdigit()]
        key = match[1].upper()
        size = max(numbers, default=0) if key == b"CELLS" else float(np.prod([float(number or 1) for number in numbers]))
        if key == b"DIMENSIONS":  # a grid has no lists of points and cells; meshio makes 3 and 8 numbers of 8 bytes for each
            check_room(path, (3 + 8) * 8 * int(size))
        elif size > len(raw):
            raise InputError(f"{path} says {match[0].decode('latin-1').strip():.60}, but has {len(raw)} bytes: is it cut short?")
        counts.setdefault(key, numbers[0] if numbers else -1)
    return counts.get(b"POINTS"), counts.get(b"CELL_TYPES")


#: begins like a number, but is not one
_NO_NUMBER = re.compile(rb"(?<!\S)(?=[+\-.]?[+\-.\d])(?![+-]?[nNiI])(?![+-]?(?:\d++\.?\d*+|\.\d++)(?:[eE][+-]?\d++)?(?!\S))\S+"
                        rb"|(?<!\S)(?:[+\-.?#](?!\S)|[\x80-\xff]\S*)")


def _su2(path: Path, raw: bytes) -> tuple[int | None, int | None]:
    sizes: dict[bytes, list[int]] = {}
    for key, count in re.findall(rb"^[ \t]*(NPOIN|NELEM|MARKER_ELEMS)[ \t]*=[ \t]*(\d{1,18})", raw, flags=re.MULTILINE):
        sizes.setdefault(key, []).append(int(count))
        if int(count) > len(raw):
            raise InputError(f"{path} says {key.decode()}= {int(count)}, but has {len(raw)} bytes: is it cut short or damaged?")
    check_end(path)
    _all_numbers(path, raw)
    if len(re.findall(rb"^[ \t]*MARKER_TAG", raw, flags=re.MULTILINE)) != sum(
            int(count) for count in re.findall(rb"^[ \t]*NMARK[ \t]*=[ \t]*(\d{1,9})", raw, flags=re.MULTILINE)):
        raise InputError(f"{path} has another number of markers than NMARK says: is it cut short or damaged?")
    return sum(sizes[b"NPOIN"]) if b"NPOIN" in sizes else None, sum(sizes.get(b"NELEM", [0]) + sizes.get(b"MARKER_ELEMS", []))


def _all_numbers(path: Path, data: bytes) -> None:
    """Refuse words that only begin like a number: NumPy reads 1e as 1 and 0x10 as 0, and drops the rest."""
    end = 0  # the end of a line with a keyword or the name of an array
    for word in _NO_NUMBER.finditer(data):
        if word.start() >= end:
            start, end = data.rfind(b"\n", 0, word.start()) + 1, (data.find(b"\n", word.start()) + 1 or len(data) + 1) - 1
            if not re.match(rb"[a-zA-Z%]|\S+ \d+ \d+ [a-zA-Z]", data[start:end].strip()):
                raise InputError(f"{path} has {word[0].decode('latin-1'):.30} where a number belongs")


def _xml(path: Path, raw: bytes) -> tuple[int | None, int | None]:
    for head, data in re.findall(rb"<Data(?:Array|Item)\b([^<>]*)>([^<]*)", raw):
        if re.search(rb'format="(ascii|xml)"', head, flags=re.IGNORECASE):
            _all_numbers(path, data)
    if raw.count(b"<Piece ") > 1:
        raise InputError(f"{path} holds several pieces, but meshio would keep only one. Merge them (ParaView: Merge Blocks)")
    piece = re.search(rb"<Piece [^<>]*>", raw)
    found = [re.search(name + rb'="\s*(\d{1,18})\s*"', piece[0]) if piece else None
             for name in (b"NumberOfPoints", b"NumberOfCells")]
    points, cells = (int(match[1]) if match else None for match in found)
    return points, cells


def read_tetgen(path: Path) -> tuple[Any, list[str]]:
    """TetGen's files .node and .ele, of the same name in one folder, as a meshio.Mesh.

    ==============  ==========================================================================================================
    reads           tetrahedra of 4 nodes; numbers from 0 or 1; comments; attributes and markers are passed over
    refuses         rows missing or too many, columns that do not fit the header, numbers out of their order, 10 nodes, a last
                    line that does not end
    cannot know     whether .node and .ele belong together
    ==============  ==========================================================================================================

    Raises
    ------
    InputError
        What is refused, by file.
    """
    nodes, cells = _tetgen(path.with_suffix(".node"), 4, 3), _tetgen(path.with_suffix(".ele"), 3, 4)
    first, wanted = int(nodes[0, 0]), cells[:, 1:5]
    if (wanted % 1 != 0).any() or wanted.min() < first or wanted.max() >= first + len(nodes):
        raise InputError(f"{path.with_suffix('.ele')} names nodes that {path.with_suffix('.node').name} does not give")
    return meshio().Mesh(nodes[:, 1:4].copy(), [("tetra", wanted.astype(np.int64) - first)]), []


def _tetgen(path: Path, header: int, width: int) -> Array:
    """Rows of a number, `width` columns, and the further columns announced in the header."""
    if not path.is_file():
        raise InputError(f"there is no file {path}, which the other of TetGen's two files needs")
    check_end(path, b"#")
    lines = [line for line in re.sub(r"#.*", "", text_of(path)).split("\n") if line.strip()]
    sizes = lines[0].split() if lines else []
    if not 1 < len(sizes) <= header or not all(re.fullmatch(r"\d{1,12}", size) for size in sizes) or int(sizes[1]) != width:
        raise InputError(f"{path} begins with {' '.join(sizes)!r}; it must be the number of rows, {width}, and how many "
                         "other columns there are")
    count, columns = int(sizes[0]), 1 + width + sum(int(size) for size in sizes[2:])
    values = as_numbers(f"{path}: its rows", "\n".join(lines[1:]), float)
    if len(lines) - 1 != count or len(values) != count * columns or not count:
        raise InputError(f"{path} has {len(values)} numbers in {len(lines) - 1} rows, but its header says {count} rows of "
                         f"{columns}: is it cut short or damaged?")
    table = values.reshape(count, columns)
    first = table[0, 0]
    if first not in (0, 1) or (table[:, 0] != np.arange(count) + first).any():
        raise InputError(f"{path}: its rows are not numbered one after the other from 0 or 1")
    return table
