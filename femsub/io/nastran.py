"""Nastran bulk data (.bdf, .nas, .fem): grid points and elements, fixed fields of 8 and 16 columns and free ones alike.

meshio reads these too. But it ignores INCLUDE and GRDSET, reads angles and offsets of shells as nodes, and fails at free
continuations, blank fields and lower case.
"""

from __future__ import annotations

import re
from collections import Counter
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from femsub.checks import Array
from femsub.errors import InputError
from femsub.io.mesh_text import Deck, as_numbers, once, rows_of, whole_numbers

BLANK = "-9"  # stands for a coordinate system that is not given: GRDSET may give it
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
#: card: how many fields are read: number and system of a point, and its place; number, property and nodes of a cell
_WIDTHS = {"GRID": 2, "GRID place": 3, "GRDSET": 2} | {name: 2 + max(sizes) for name, sizes in _CELLS.items()}
_ORDER = {("CHEXA", 20): _HEXA20, ("CPENTA", 15): _WEDGE15, ("CTRIAX6", 6): [0, 2, 4, 1, 3, 5]}
#: elements that are not cells: skipped, with a note
_SKIPPED = re.compile(r"CONM[12]|CMASS\d|CELAS\d|CDAMP\d|CVISC|CONROD|CWELD|CFAST|CSEAM|CBEND|CHBDY.|RBE\d|RBAR|RROD|RJOINT|"
                      r"PLOTEL|GENEL")
_HARMLESS = ("CBARAO", "CORD1R", "CORD2R", "CORD1C", "CORD2C", "CORD1S", "CORD2S", "GRID", "GRDSET")
#: others that fill a volume or change what is given
_REFUSED = re.compile(r"CIHEX\d|CHACAB|CHACBR|CHEXCZ|CPENTCZ|CIF\w+|CHEX[AP]\w+|SEBULK|SEELT|GMCORD|.{17,}|=.*|/.*|\*\(\d+\)")


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

    cards, skipped = _cards(path)
    numbers, points = _points(path, cards)
    order = once(path, "nodes", numbers)
    blocks = [block for name in _CELLS if cards[name] for block in _cells(path, name, cards[name])]
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
    text = re.sub(r"\$.*", "", text).expandtabs(8).encode("ascii", "replace").decode()
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


def _cards(path: Path) -> tuple[dict[str, list[str]], Counter[str]]:
    """The fields of each card that is read, between blanks, by their names; and how many are elements but no cells."""
    cards: dict[str, list[str]] = {name: [] for name in _WIDTHS}
    counts: Counter[str] = Counter()
    name, card, mark = "", list[str](), ""
    for line in _bulk(path).split("\n"):
        if line.isspace() or not line:
            continue
        head, data, after = _fields(path, line)
        if head and head[0] != "+" and (head[0] != "*" or head[1:2] == "("):
            _close(path, cards, name, card)
            name, card = head.rstrip("*"), []
            counts[head] += 1
        elif not name:
            raise InputError(f"{path} begins with a continuation: {line.strip()!r}")
        elif mark and head.lstrip("+*") not in ("", mark):  # older files may list them anywhere
            raise InputError(f"{path}: the continuation {head!r} does not stand below the line it continues: sort the file")
        card += data
        mark = after.strip().lstrip("+*").upper()
    _close(path, cards, name, card)
    return cards, _skipped(path, counts)


def _fields(path: Path, line: str) -> tuple[str, list[str], str]:
    """The first field in capitals, four wide or eight small ones of data, and the last field of a line."""
    if "," not in line:
        head = line[:8].strip().upper()
        width = 16 if "*" in head else 8
        return head, [line[start:start + width].strip() for start in range(8, 72, width)], line[72:80]
    words = [word.strip() for word in line.split(",")]
    if len(words) > 10:
        raise InputError(f"{path} has a line of more than 10 fields: {line[:60]!r}")
    head = words[0].upper()
    count = 4 if "*" in head else 8
    words += [""] * (10 - len(words))
    return head, words[1:count + 1], words[count + 1]


def _close(path: Path, cards: dict[str, list[str]], name: str, card: list[str]) -> None:
    """Keep the fields of a card that is complete; those that are blank as 0."""
    name = name.rstrip("_")  # meshio's CHEXA_ is a CHEXA of 20 nodes
    if name not in _WIDTHS:
        return
    width = _WIDTHS[name]
    if len(_CELLS.get(name, {})) == 2 and any(card[width:]):
        raise InputError(f"{path}: {name} {card[0]} has more than {width - 2} nodes")
    if name == "GRID":
        _close(path, cards, "GRID place", card[2:5])
        card[1] = card[1] or BLANK
    cards[name].append(" ".join([field or "0" for field in card[:width]] + ["0"] * (width - len(card))))


def _skipped(path: Path, counts: Counter[str]) -> Counter[str]:
    """How many cards are elements but no cells; what is not read and must be is refused."""
    skipped: Counter[str] = Counter()
    for head, count in counts.items():
        name = head.rstrip("*")
        if name.rstrip("_") in _CELLS or name in _HARMLESS:
            if head.endswith("_*"):
                raise InputError(f"{path} has {head} cards, in which meshio mixes up the nodes: write small fields")
        elif _SKIPPED.fullmatch(name):
            skipped[name] += count
        elif (near := get_close_matches(name, _WIDTHS, n=1, cutoff=0.8)) or _REFUSED.fullmatch(name):
            raise InputError(f"{path} has {name} cards, which are not read" + (f"; did you mean {near[0]}?" if near else
                             ": write the mesh without them"))
    return skipped


def _values(path: Path, name: str, cards: list[str], kind: type = np.int64) -> Array:
    """The fields as numbers, (cards, fields)."""
    data = " ".join(cards)
    if kind is float:
        data = re.sub(r"(?<=[\d.])(?=[+-]\d)", "e", data)
    what, width = f"{path}: the fields of {name.split()[0]}", _WIDTHS[name]
    found = as_numbers(what, data, kind)
    if len(found) != len(cards) * width:
        raise InputError(f"{what} are not all numbers: one has a blank in it, or the columns cut it in two")
    return found.reshape(len(cards), width)


def _points(path: Path, cards: dict[str, list[str]]) -> tuple[Array, Array]:
    if not cards["GRID"]:
        raise InputError(f"{path} has no GRID cards")
    if len(cards["GRDSET"]) > 1:
        raise InputError(f"{path} has several GRDSET cards")
    default = _values(path, "GRDSET", cards["GRDSET"])[:, 1].any()
    numbers, system = _values(path, "GRID", cards["GRID"]).T
    whole_numbers(f"{path}: the numbers of GRID", numbers)
    if (np.where(system == int(BLANK), default, system) != 0).any():
        raise InputError(f"{path} gives nodes in coordinate systems of their own (field CP of GRID or GRDSET); write them in the "
                         "basic one")
    return numbers, _values(path, "GRID place", cards["GRID place"], float)


def _cells(path: Path, name: str, cards: list[str]) -> list[tuple[str, Array, Array, Array]]:
    """Kind, numbers, properties and nodes of the cells of a card, for each number of nodes it may have."""
    values = _values(path, name, cards)
    given = values[:, 2:] != 0
    count = np.where(given.all(axis=1), given.shape[1], given.argmin(axis=1))
    whole_numbers(f"{path}: the numbers of {name}", values[:, 0])
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
