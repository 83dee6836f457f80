"""Nastran bulk data (.bdf, .nas, .fem): grid points and elements, fixed fields of 8 and 16 columns and free ones alike.

meshio reads these too. But it ignores INCLUDE and GRDSET, reads angles and offsets of shells as nodes, and fails at free
continuations, blank fields and lower case.
"""

from __future__ import annotations

import re
from collections import Counter
from difflib import get_close_matches
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from femsub.checks import Array
from femsub.errors import InputError
from femsub.io.mesh_text import Deck, as_numbers, once, rows_of

CHUNK = 400_000  # lines split at a time

_HEXA20 = [*range(12), 16, 17, 18, 19, 12, 13, 14, 15]  # Nastran has the upright edges before those of the top
_WEDGE15 = [*range(9), 12, 13, 14, 9, 10, 11]
#: card: kind of cell by number of nodes; a line's two nodes are followed by what orients it
_CELLS: dict[str, dict[int, str]] = {
    "CTETRA": {4: "tetra", 10: "tetra10"}, "CHEXA": {8: "hexahedron", 20: "hexahedron20"}, "CPENTA": {6: "wedge", 15: "wedge15"},
    "CPYRAM": {5: "pyramid", 13: "pyramid13"}, "CPYRA": {5: "pyramid", 13: "pyramid13"}, "CPYR": {5: "pyramid", 13: "pyramid13"},
    "CTRIA3": {3: "triangle"}, "CTRIAR": {3: "triangle"}, "CTRIA6": {6: "triangle6"}, "CTRIAX6": {6: "triangle6"},
    "CQUAD4": {4: "quad"}, "CQUADR": {4: "quad"}, "CSHEAR": {4: "quad"}, "CQUAD8": {8: "quad8"}, "CQUAD": {9: "quad9"},
    "CROD": {2: "line"}, "CTUBE": {2: "line"}, "CBAR": {2: "line"}, "CBEAM": {2: "line"}, "CBUSH": {2: "line"},
    "CBUSH1D": {2: "line"}, "CGAP": {2: "line"}}
_ORDER = {("CHEXA", 20): _HEXA20, ("CPENTA", 15): _WEDGE15, ("CTRIAX6", 6): [0, 2, 4, 1, 3, 5]}
#: elements that are not cells: skipped, with a note
_SKIPPED = re.compile(r"CONM[12]|CMASS\d|CELAS\d|CDAMP\d|CVISC|CONROD|CWELD|CFAST|CSEAM|CBEND|CHBDY.|RBE\d|RBAR|RROD|RJOINT|"
                      r"PLOTEL|GENEL")
_HARMLESS = ("CBARAO", "CORD1R", "CORD2R", "CORD1C", "CORD2C", "CORD1S", "CORD2S", "GRID", "GRDSET")
#: others that fill a volume or change what is given
_REFUSED = re.compile(r"CIHEX\d|CHACAB|CHACBR|CHEXCZ|CPENTCZ|CIF\w+|CHEX[AP]\w+|SEBULK|SEELT|GMCORD|=.*|/.*|\*\(\d+\)")


class _Lines(NamedTuple):
    """Lines of cards: which card each belongs to, where its fields begin in it, and the fields (n, 8) with blanks stripped."""

    card: Array
    offset: Array
    fields: Array


def read_nastran(path: Path) -> tuple[Any, list[str]]:
    """A meshio.Mesh with `points_id`, `cells_id` and the properties as cell data "nastran:ref", and what was skipped.

    ==============  ==========================================================================================================
    reads           GRID and GRDSET; CTETRA, CHEXA, CPENTA, CPYRAM, shells, bars and the like by their nodes; all three formats
                    of fields, continuations with and without marks, capitals or not, 1.5-3 for 1.5E-3; blank coordinates
                    as 0; INCLUDE (files beside this one)
    skips, tells    elements that are no cells: CONM2, CELAS2, RBE2, ...
    refuses         points in coordinate systems of their own (CP, also from GRDSET); numbers given twice; nodes missing in a
                    card or in the file; continuations out of their order; replication (=); superelements; other solids
                    (CIHEX1, ...) and nearly known names; properties given to some cells only; a file without ENDDATA
    cannot know     whether cards are missing between two others: the format counts nothing
    ==============  ==========================================================================================================

    Raises
    ------
    InputError
        What is refused, by card and number.
    """
    import meshio

    lines = [line for line in _bulk(path).encode("latin-1", "replace").split(b"\n") if line and not line.isspace()]
    names, first, large = _names(lines)
    if not first[0] and lines:
        raise InputError(f"{path} begins with a continuation: {lines[0].decode('latin-1').strip()!r}")
    starts = np.flatnonzero(first)
    cards, skipped = _known(path, names[starts])
    wanted = {name: np.flatnonzero(cards == name) for name in ("GRID", "GRDSET", *_CELLS)}
    parts: dict[str, list[Array]] = {name: [] for name, members in wanted.items() if len(members)}
    edges = [0]
    while edges[-1] < len(starts):
        edges.append(int(np.searchsorted(starts, starts[edges[-1]] + CHUNK, side="right")))
    for low, high in pairwise(edges):
        begin, end = starts[low], starts[high] if high < len(starts) else len(lines)
        taken = _taken_apart(path, lines[begin:end], names[begin:end], first[begin:end], large[begin:end])
        for name in parts:
            inside = wanted[name][(wanted[name] >= low) & (wanted[name] < high)] - low
            parts[name].append(_gathered(path, name, taken, inside))
    tables = {name: np.concatenate(part) for name, part in parts.items()}
    numbers, points = _points(path, tables)
    order = once(path, "nodes", numbers)
    blocks = [block for name, table in tables.items() if name in _CELLS for block in _cells(path, name, table)]
    once(path, "elements", np.concatenate([np.zeros(0, dtype=np.int64), *(block[1] for block in blocks)]))
    given = np.concatenate([np.zeros(0, dtype=np.int64), *(block[2] for block in blocks)]) > 0
    if given.any() and not given.all():
        raise InputError(f"{path}: some cells of the mesh file have a property and some have none; give one to each")
    cells = [(kind, order[rows_of(path, f"a {kind} cell", "node", numbers[order], nodes)]) for kind, _, _, nodes in blocks]
    mesh = meshio.Mesh(points, cells, cell_data={"nastran:ref": [block[2] for block in blocks]} if given.any() else {})
    mesh.points_id, mesh.cells_id = numbers, [block[1] for block in blocks]
    return mesh, [f"{count} {name} skipped" for name, count in sorted(skipped.items())]


def _bulk(path: Path) -> str:
    """The cards between BEGIN BULK (if there is one) and ENDDATA, without comments."""
    include = r"""^[ \t]*INCLUDE\b[ \t]*('[^']*'?|"[^"]*"?|[^\s$]*)[^\n]*\n?"""
    text = Deck(path).whole(include, lambda name: re.sub(r"\s*\n\s*", "", name.strip("'\"")))
    text = re.sub(r"\$.*", "", text).expandtabs(8)
    if "//" in text or "#" in text:
        text = re.sub(r"^(?://|#).*", "", text, flags=re.MULTILINE)
    marks = list(re.finditer(r"^[ \t]*(BEGIN[ \t]+(?:BULK|SUPER)\b[^\n]*|ENDDATA\b)", text, flags=re.MULTILINE | re.IGNORECASE))
    ends = [mark.start() for mark in marks if mark[1].upper() == "ENDDATA"]
    if not ends:
        raise InputError(f"{path} has no ENDDATA: is it cut short?")
    begins = [mark for mark in marks if mark.end() < ends[0]]
    if len(begins) > 1 or (begins and re.search(r"SUPER|AUXM", begins[0][1], flags=re.IGNORECASE)):
        raise InputError(f"{path} has several parts of bulk data (superelements): write one")
    return text[begins[0].end() if begins else 0:ends[0]]


def _names(lines: list[bytes]) -> tuple[Array, Array, Array]:
    """The first field of each line in capitals, whether a card begins with it, and whether its fields are wide."""
    heads = np.array(lines or [b""], dtype="S8")
    raw = heads.view(np.uint8).reshape(-1, 8)
    raw[np.logical_or.accumulate(raw == ord(","), axis=1)] = 0
    indented = (raw[:, 0] == ord(" ")) & (raw > ord(" ")).any(axis=1)
    heads[indented] = np.char.lstrip(heads[indented])
    raw[raw == ord(" ")] = 0
    raw[(raw >= ord("a")) & (raw <= ord("z"))] -= 32
    more = (raw[:, 0] == 0) | (raw[:, 0] == ord("+")) | ((raw[:, 0] == ord("*")) & (raw[:, 1] != ord("(")))
    return heads, ~more, (raw == ord("*")).any(axis=1)


def _known(path: Path, names: Array) -> tuple[Array, Counter[str]]:
    """The names of cards, and how many are elements but no cells; what is not read and must be is refused."""
    skipped: Counter[str] = Counter()
    found, inverse, counts = np.unique(names, return_inverse=True, return_counts=True)
    cards = []
    for name, count in zip((name.decode("latin-1").rstrip("*") for name in found.tolist()), counts, strict=True):
        cards.append(name.rstrip("_"))  # meshio's CHEXA_ is a CHEXA of 20 nodes
        if cards[-1] in _CELLS or name in _HARMLESS:
            continue
        if _SKIPPED.fullmatch(name):
            skipped[name] += int(count)
            continue
        near = get_close_matches(name, (*_CELLS, "GRID", "GRDSET"), n=1, cutoff=0.8)
        if _REFUSED.fullmatch(name) or near:
            raise InputError(f"{path} has {name} cards, which are not read" + (f"; did you mean {near[0]}?" if near else
                             ": write the mesh without them"))
    odd = [name for name in found.tolist() if name.endswith(b"_*")]
    if odd:
        raise InputError(f"{path} has {odd[0].decode('latin-1')} cards, in which meshio mixes up the nodes: write small fields")
    return np.array(cards, dtype="U8")[inverse], skipped


def _taken_apart(path: Path, lines: list[bytes], names: Array, first: Array, large: Array) -> _Lines:
    free = np.array([b"," in line for line in lines])
    fields = np.zeros((len(lines), 10), dtype="S16" if free.any() or large.any() else "S8")
    if not free.all():
        fixed = np.array([line for line, is_free in zip(lines, free, strict=True) if not is_free], dtype="S80")
        small = fixed[~large[~free]].view("S8").reshape(-1, 10)
        fields[~free & ~large] = small
        wide = fixed[large[~free]].view(np.uint8).reshape(-1, 80)
        fields[~free & large, 1:5] = np.ascontiguousarray(wide[:, 8:72]).view("S16").reshape(-1, 4)
        fields[~free & large, 9] = np.ascontiguousarray(wide[:, 72:]).view("S8").ravel()
    if free.any():
        texts = [line for line, is_free in zip(lines, free, strict=True) if is_free]
        commas = np.array([line.count(b",") for line in texts])
        if commas.max() > 9:
            raise InputError(f"{path} has a line of more than 10 fields: {texts[int(commas.argmax())][:60].decode('latin-1')!r}")
        split = b",".join([text + b"," * (9 - count) for text, count in zip(texts, commas.tolist(), strict=True)]).split(b",")
        longest = max(split, key=lambda word: len(word.strip()))
        if len(longest.strip()) > 16:
            raise InputError(f"{path} has a field of more than 16 characters: {longest.strip().decode('latin-1')!r}")
        table = np.array([word.strip() for word in split], dtype="S16").reshape(-1, 10)
        rows = np.flatnonzero(free)
        narrow = large[rows]  # a free line of a card GRID* has four fields, too
        fields[rows] = table
        fields[rows[narrow], 9] = table[narrow, 5]
        fields[rows[narrow], 5:9] = b""
    raw = fields.view(np.uint8).reshape(len(lines), 10, -1)
    fields[~(raw > ord(" ")).any(axis=2)] = b""
    card = np.cumsum(first) - 1
    widths = np.where(large, 4, 8)
    total = np.cumsum(widths) - widths
    _in_order(path, fields[:, 9], names, first)
    return _Lines(card, total - total[np.flatnonzero(first)][card], fields[:, 1:9])


def _in_order(path: Path, ends: Array, names: Array, first: Array) -> None:
    """Continuations must follow what they continue: older files may list them anywhere."""
    marked = 1 + np.flatnonzero(~first[1:] & (names[1:].view(np.uint8).reshape(-1, 8)[:, 1] > 0) & (ends[:-1] != b""))
    after = np.char.lstrip(names[marked], b"+*")
    before = np.char.upper(np.char.lstrip(np.char.strip(ends[marked - 1]), b"+*"))
    wrong = marked[(before != after) & (before != b"") & (after != b"")]
    if len(wrong):
        mark = names[wrong[0]].decode("latin-1")
        raise InputError(f"{path}: the continuation {mark!r} does not stand below the line it continues: sort the file")


def _gathered(path: Path, name: str, lines: _Lines, members: Array) -> Array:
    """The fields of cards of one name, (cards, fields): of GRID the first 8, of a cell as many as it may have."""
    width = {"GRID": 8, "GRDSET": 8}.get(name, 2 + max(_CELLS.get(name, {0: ""})))
    row = np.full(int(lines.card[-1]) + 1, -1)
    row[members] = np.arange(len(members))
    table = np.zeros((len(members), width), dtype=lines.fields.dtype)
    here = np.flatnonzero(row[lines.card] >= 0)
    for column in range(8):
        place = lines.offset[here] + column
        inside = place < width
        values = lines.fields[here[inside], column]
        filled = values != b""  # large lines have 4 fields, and nothing in the others
        table[row[lines.card[here[inside]]][filled], place[inside][filled]] = values[filled]
        more = lines.fields[here[~inside], column] != b""
        if more.any() and len(_CELLS.get(name, {})) == 2:
            number = table[row[lines.card[here[~inside][more][0]]], 0].decode("latin-1").strip()
            raise InputError(f"{path}: {name} {number} has more than {width - 2} nodes")
    return table


def _values(path: Path, name: str, table: Array, kind: type = np.int64) -> Array:
    """The fields as numbers, blank ones as 0."""
    flat, width = table.ravel(), table.dtype.itemsize
    found: list[Array] = [np.zeros(0, dtype=kind)]
    for start in range(0, len(flat), CHUNK):
        part = flat[start:start + CHUNK]
        text = np.full((len(part), width + 1), ord(" "), dtype=np.uint8)
        raw = part.view(np.uint8).reshape(len(part), width)
        text[:, :width] = np.where(raw == 0, ord(" "), raw)
        text[part == b"", 0] = ord("0")
        data = text.tobytes().decode("latin-1")
        if kind is float:
            data = re.sub(r"(?<=[\d.])(?=[+-]\d)", "e", data)
        found.append(as_numbers(f"{path}: the fields of {name}", data, kind))
        if len(found[-1]) != len(part):
            raise InputError(f"{path}: the fields of {name} are not all numbers: one has a blank in it, or the columns cut it in "
                             "two")
    return np.concatenate(found).reshape(table.shape)


def _points(path: Path, tables: dict[str, Array]) -> tuple[Array, Array]:
    if "GRID" not in tables:
        raise InputError(f"{path} has no GRID cards")
    default = _values(path, "GRDSET", tables["GRDSET"][:, [1]])[:, 0] if "GRDSET" in tables else np.zeros(1, dtype=np.int64)
    if len(default) > 1:
        raise InputError(f"{path} has several GRDSET cards")
    numbers, system = _values(path, "GRID", tables["GRID"][:, :2]).T
    _positive(path, "GRID", numbers)
    if (np.where(tables["GRID"][:, 1] == b"", default[0], system) != 0).any():
        raise InputError(f"{path} gives nodes in coordinate systems of their own (field CP of GRID or GRDSET); write them in the "
                         "basic one")
    return numbers, _values(path, "GRID", tables["GRID"][:, 2:5], float)


def _cells(path: Path, name: str, table: Array) -> list[tuple[str, Array, Array, Array]]:
    """Kind, numbers, properties and nodes of the cells of a card, for each number of nodes it may have."""
    values = _values(path, name, table)
    given = values[:, 2:] != 0
    count = np.where(given.all(axis=1), given.shape[1], given.argmin(axis=1))
    _positive(path, name, values[:, 0])
    if name in ("CBUSH", "CBUSH1D", "CGAP"):  # to the ground
        values, given, count = (part[count == 2] for part in (values, given, count))
    wrong = np.flatnonzero(~np.isin(count, list(_CELLS[name])) | (given.sum(axis=1) != count))
    if len(wrong):
        raise InputError(f"{path}: {name} {values[wrong[0], 0]} has {given[wrong[0]].sum()} nodes, not "
                         f"{' or '.join(map(str, _CELLS[name]))}")
    blocks = []
    for size, kind in _CELLS[name].items():
        taken = values[count == size]
        if len(taken):
            blocks.append((kind, taken[:, 0], taken[:, 1], taken[:, 2:][:, _ORDER.get((name, size), range(size))]))
    return blocks


def _positive(path: Path, name: str, numbers: Array) -> None:
    if (numbers < 1).any():
        raise InputError(f"{path}: a {name} card has the number {numbers[numbers < 1][0]}, or none")
