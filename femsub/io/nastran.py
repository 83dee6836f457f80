"""Nastran bulk data (.bdf, .nas, .fem, .dat): grid points and elements, fixed fields of 8 and 16 columns and free ones alike.

meshio reads these too. But it ignores INCLUDE and GRDSET, reads angles and offsets of shells as nodes, and fails at free
continuations, blank fields and lower case.
"""

from __future__ import annotations

import re
from collections import Counter
from difflib import get_close_matches
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from femsub.checks import Array, is_file
from femsub.errors import InputError, warn
from femsub.io.damage import check_end
from femsub.io.mesh_text import Deck, as_numbers, once, rows_of, text_of, whole_numbers, without_copies
from femsub.io.nastran_systems import NAMES, Systems

_INCLUDE = r"""^[ \t]*INCLUDE\b[ \t]*('[^']*'?|"[^"]*"?|[^\n$]*)[^\n]*\n?"""  # the name may go on in the next lines
BLANK = "-9"  # stands for a coordinate system that is not given: GRDSET may give it
_HEXA20 = [*range(12), 16, 17, 18, 19, 12, 13, 14, 15]  # Nastran has the upright edges before those of the top
_IHEX2 = [0, 2, 4, 6, 12, 14, 16, 18, 1, 3, 5, 7, 13, 15, 17, 19, 8, 9, 10, 11]  # around the bottom, upright edges, the top
_WEDGE15 = [*range(9), 12, 13, 14, 9, 10, 11]
#: card: kind of cell by number of nodes; a line's two nodes are followed by what orients it
_CELLS: dict[str, dict[int, str]] = {
    "CTETRA": {4: "tetra", 10: "tetra10"}, "CHEXA": {8: "hexahedron", 20: "hexahedron20"}, "CPENTA": {6: "wedge", 15: "wedge15"},
    "CPYRAM": {5: "pyramid", 13: "pyramid13"}, "CPYRA": {5: "pyramid", 13: "pyramid13"}, "CPYR": {5: "pyramid", 13: "pyramid13"},
    "CTRIA3": {3: "triangle"}, "CTRIAR": {3: "triangle"}, "CTRIA6": {6: "triangle6"}, "CTRIAX6": {6: "triangle6"},
    "CQUAD4": {4: "quad"}, "CQUADR": {4: "quad"}, "CSHEAR": {4: "quad"}, "CQUAD8": {8: "quad8"}, "CQUAD": {9: "quad9"},
    "CROD": {2: "line"}, "CTUBE": {2: "line"}, "CBAR": {2: "line"}, "CBEAM": {2: "line"}, "CBUSH": {2: "line"},
    "CBUSH1D": {2: "line"}, "CGAP": {2: "line"},
    # of Nastran before 1990
    "CIHEX1": {8: "hexahedron"}, "CIHEX2": {20: "hexahedron20"}, "CHEXA1": {8: "hexahedron"}, "CHEXA2": {8: "hexahedron"},
    "CWEDGE": {6: "wedge"}, **{name: {3: "triangle"} for name in ("CTRIA1", "CTRIA2", "CTRMEM", "CTRBSC", "CTRPLT")},
    **{name: {4: "quad"} for name in ("CQUAD1", "CQUAD2", "CQDMEM", "CQDMEM1", "CQDMEM2", "CQDPLT", "CTWIST")}}
#: card: how many fields are read: number and system of a point, and its place; number, property and nodes of a cell
_WIDTHS = {"GRID": 2, "GRID place": 3, "GRDSET": 2} | {name: 2 + max(sizes) for name, sizes in _CELLS.items()} | {
    name: 4 if name.startswith("CORD1") else 11 for name in NAMES}
_KNOWN = {*_WIDTHS, "DMIG", "DTI", "SPOINT", "EXTRN", "SECONCT", "BSET", "BSET1", "QSET", "QSET1", "BNDFIX", "BNDFIX1"}
_TWICE = ("CROD", "CTUBE", *(name for name in NAMES if name.startswith("CORD1")))  # two of them may stand on one card
_ORDER = {("CHEXA", 20): _HEXA20, ("CIHEX2", 20): _IHEX2, ("CPENTA", 15): _WEDGE15, ("CTRIAX6", 6): [0, 2, 4, 1, 3, 5]}
#: elements that are not cells: skipped, with a note
_SKIPPED = re.compile(r"CONM[12]|CMASS\d|CELAS\d|CDAMP\d|CVISC|CONROD|CWELD|CFAST|CSEAM|CBEND|CHBDY.?|RBE\d|RBAR|RROD|RJOINT|"
                      r"PLOTEL|GENEL|CTRI(M6|AAX|ARG)|CTRAP(AX|RG)|CTRSHL|CTRPLT1|CTORDRG|CCONEAX|CIS2D8|CFLUID\d|CAXIF\d|CSLOT\d|"
                      r"CRIGD\w|CRROD|CELBOW|CBEAM3|CBUSH2D|CPLST[NS]\d")
#: others that fill a volume or change what is given
_REFUSED = re.compile(r"CIHEX\d|CHACAB|CHACBR|CHEXCZ|CPENTCZ|CIF\w+|CHEX[AP]\w+|CF(HEX\d|TETRA|WEDGE)|CQUADX\d?|CTRIAX|GRID[BFG]|"
                      r"SEBULK|SEELT|GMCORD|=.*|/.*|\*\(\d+\)")


def read_nastran(path: Path) -> tuple[Any, list[str]]:
    """A meshio.Mesh with `points_id`, `cells_id` and the properties as cell data "nastran:ref", and what was skipped.

    ==============  ==========================================================================================================
    reads           GRID and GRDSET, in coordinate systems (CP) of CORD1R, CORD2R, ..., too; CTETRA, CHEXA, CPENTA, CPYRAM,
                    shells, bars and the like by their nodes, two rods on a card; all three formats of fields,
                    continuations with and without marks, capitals or not, 1.5-3 for 1.5E-3; blank coordinates as 0, a
                    blank property as the element's number, if others have one; INCLUDE (files beside the one that names
                    them, or beside this one; before BEGIN BULK one may be missing, which is reported)
    skips, reports  elements that are no cells: CONM2, CELAS2, RBE2, ...; that ENDDATA is missing; points given twice alike
    refuses         elements given twice, points at two places; nodes missing in a card or in the file; continuations of
                    cells and points out of their order; replication (=); superelements; other solids (CIHEX3, ...) and
                    nearly known names
    cannot know     whether cards are missing between two others, or at the end without ENDDATA: the format counts nothing
    ==============  ==========================================================================================================

    Raises
    ------
    InputError
        What is refused, by card and number.
    """
    import meshio

    # the cards between BEGIN BULK and ENDDATA, if they are there
    text, notes = _text(path)
    marks = list(re.finditer(r"^[ \t]*(BEGIN[ \t]+(?:BULK|SUPER)\b[^\n]*|ENDDATA\b)", text, flags=re.MULTILINE | re.IGNORECASE))
    ends = [mark.start() for mark in marks if mark[1].upper() == "ENDDATA"]
    if not ends:
        check_end(path)
    stop = ends[0] if ends else len(text)
    begins = [mark for mark in marks if mark.end() < stop]
    empty = {i for i, (mark, after) in enumerate(pairwise(begins)) if not text[mark.end():after.start()].strip()}
    begins = [mark for i, mark in enumerate(begins) if i not in empty]  # BEGIN BULK may stand there twice
    if len(begins) > 1 or (begins and re.search(r"SUPER|AUXM", begins[0][1], flags=re.IGNORECASE)):
        raise InputError(f"{path} has several parts of bulk data (superelements): write one")
    notes += [] if ends else ["the file has no ENDDATA: if it was cut short at the end of a line, cards are missing"]
    if ends and (lost := _lost(text[stop:].partition("\n")[2].split("\n"))):
        notes.append(f"{lost!r:.40} behind ENDDATA left out, as in Nastran: if ENDDATA does not belong there, cards are missing")
    if begins and (lost := _lost(text[:begins[0].start()].split("\n"))):
        notes.append(f"{lost!r:.40} before BEGIN BULK left out, as in Nastran: if BEGIN BULK does not belong there, cards are "
                     "missing")
    cards, skipped = _cards(path, text[begins[0].end() if begins else 0:stop])
    # points: numbers, coordinate systems and places, each once
    if not cards["GRID"]:
        raise InputError(f"{path} has no GRID cards")
    if len(cards["GRDSET"]) > 1:
        raise InputError(f"{path} has several GRDSET cards")
    default = _values(path, "GRDSET", cards["GRDSET"])[:, 1]
    numbers, system = _values(path, "GRID", cards["GRID"]).T
    whole_numbers(f"{path}: the numbers of GRID", numbers)
    system = np.where(system == int(BLANK), default[0] if len(default) else 0, system)
    points = _values(path, "GRID place", cards["GRID place"], float)
    rows, copies = without_copies(numbers, np.column_stack([system, points]))
    numbers, system, points = numbers[rows], system[rows], points[rows]
    if system.any():
        by_nodes, by_points = {}, {}
        for name in NAMES:
            for number, *corners in _values(path, name, cards[name]).tolist() if name.startswith("CORD1") else ():
                by_nodes[number] = name[-1], np.array(corners)
            for number, of, *rest in _values(path, name, cards[name], float).tolist() if name.startswith("CORD2") else ():
                by_points[int(number)] = name[-1], int(of), np.reshape(rest, (3, 3))
        points = Systems(path, numbers, system, points, by_nodes=by_nodes, by_points=by_points).points()
    # kind, numbers, properties and nodes of the cells of a card, for each number of nodes it may have
    order = once(path, "nodes", numbers)
    blocks = []
    for name in (one for one in _CELLS if cards[one]):
        values = _values(path, name, cards[name])
        filled = values[:, 2:] != 0
        count = np.where(filled.all(axis=1), filled.shape[1], filled.argmin(axis=1))
        whole_numbers(f"{path}: the numbers of {name}", values[:, 0])
        if name in ("CBUSH", "CBUSH1D", "CGAP"):  # to the ground
            values, filled, count = (part[count == 2] for part in (values, filled, count))
        wrong = np.flatnonzero(~np.isin(count, list(_CELLS[name])) | (filled.sum(axis=1) != count))
        if len(wrong):
            some = int(filled[wrong[0]].sum())
            raise InputError(f"{path}: {name} {values[wrong[0], 0]} has {some} node{'s' * (some != 1)}, not "
                             f"{' or '.join(map(str, _CELLS[name]))}; cells with some of their midside nodes left out are not "
                             "read")
        for size, kind in _CELLS[name].items():
            taken = values[count == size]
            if len(taken):
                blocks.append((kind, taken[:, 0], taken[:, 1], taken[:, 2:][:, _ORDER.get((name, size), range(size))]))
    # cells
    once(path, "elements", np.concatenate([np.zeros(0, dtype=np.int64), *(block[1] for block in blocks)]))
    given = any(block[2].any() for block in blocks)
    properties = [np.where(block[2] == 0, block[1], block[2]) for block in blocks] if given else []
    cells = [(kind, order[rows_of(path, f"a {kind} cell", "node", numbers[order], nodes)]) for kind, _, _, nodes in blocks]
    mesh = meshio.Mesh(points, cells, cell_data={"nastran:ref": properties} if given else {})
    mesh.points_id, mesh.cells_id = numbers, [block[1] for block in blocks]
    return mesh, [*notes, *copies, *(f"{count} {name} skipped" for name, count in sorted(skipped.items()))]


def entries_of(path: Path) -> list[tuple[str, list[str]]]:
    """Every card of a file and of those it includes: its name in capitals, and its fields behind the name, blanks as ''.

    What stands before BEGIN BULK or behind ENDDATA is left out. BEGIN SUPER comes as a card of its own, with its number.
    """
    found: list[tuple[str, list[str]]] = []
    text, notes = _text(path)
    for note in notes:
        warn(f"{path}: {note}")
    lines = [line for line in text.split("\n") if line and not line.isspace()]
    for at, line in enumerate(lines):
        begin = re.match(r"\s*(BEGIN\s+(?:SUPER|BULK)|ENDDATA)\b\W*(\w*)", line, flags=re.IGNORECASE)
        if begin and begin[1].upper() == "ENDDATA":
            if begin[2] or (lost := _lost(lines[at + 1:])):
                warn(f"{path}: ENDDATA is followed by {begin[2] or lost!r:.40}, which is left out as in Nastran: if ENDDATA does "
                     "not belong there, cards are lost")
            break
        if begin:
            name = begin[1].upper().replace("\t", " ")
            if name.endswith("BULK") and (lost := _lost(lines[:at])):
                warn(f"{path}: {lost!r:.40} stands before BEGIN BULK, and is left out as in Nastran: if BEGIN BULK does not "
                     "belong there, cards are lost")
            if name.endswith("SUPER") and not begin[2].isdecimal():
                raise InputError(f"{path}: {line.strip()!r:.40} has no number of a superelement")
            found = [] if name.endswith("BULK") else [*found, ("BEGIN SUPER", [begin[2]])]
            continue
        head, data, _ = _fields(path, line)
        if "," not in line and line[80:].strip() and (head[:1] in ("*", "+") or head.rstrip("*") in _KNOWN):
            raise InputError(f"{path}: {line.strip()!r:.75} has {line[80:].strip()!r:.20} behind column 80, unread by Nastran. "
                             "Remove it, or the blanks before it")
        if head and head[0] != "+" and (head[0] != "*" or head[1:2] == "("):
            found.append((head.rstrip("*"), data))
        elif found:
            found[-1][1].extend(data)
        else:
            raise InputError(f"{path} begins with a continuation: {line.strip()!r:.60}")
    if wrong := next((card for card, _ in found if card[0].isdigit()), None):
        raise InputError(f"{path} has a card {wrong!r:.20}, and no name of a card begins with a digit: a name or the * of a "
                         "continuation is damaged")
    return found


def _lost(lines: list[str]) -> str:
    """The first card among lines that are left out, or a continuation of one."""
    return next((line.strip() for line in lines if re.match(r"\s*[*+]\s|\s*\w+\*?[\s,]", line)
                 and line.replace(",", " ").split()[0].upper().rstrip("*+") in {*_KNOWN, ""}), "")


def complete(path: Path, grid: list[str]) -> None:
    """Refuse the fields of a GRID* without its second line, and of a GRID that a comma in a number moved."""
    if wrong := [field for field in grid[5:8] if field and not field.isdecimal() and field != "-1"]:
        raise InputError(f"{path}: GRID {grid[0]} has {wrong[0]!r:.20} behind its coordinates, where a frame, directions or a "
                         "superelement belong: is a comma in a number? Write 0.5, not 0,5")
    if len(grid) == 4:
        raise InputError(f"{path}: GRID* {grid[0]} has one line, and its third coordinate belongs on a second one, which is lost "
                         "or cut off. Write it again; where the coordinate is 0, a line with * is enough")


def _text(path: Path) -> tuple[str, list[str]]:
    """A file with those it includes, without comments; and notes on included files that are not there, if that does no harm.

    Before BEGIN BULK these are alterations of Nastran's solutions (DMAP), which stand where Nastran is; cards are behind it.
    """
    def named(name: str) -> str:
        return "".join(map(str.strip, name.strip().strip("'\"").split("\n")))

    deck, own, notes = Deck(path), text_of(path), list[str]()
    if begin := re.search(r"^[ \t]*BEGIN[ \t]+BULK\b", own, flags=re.MULTILINE | re.IGNORECASE):
        parts = re.split(f"({_INCLUDE})", own[:begin.start()], flags=re.MULTILINE | re.IGNORECASE)
        for at in range(1, len(parts), 3):  # text, the line, what it names, text, ...
            if not is_file(path.parent / (name := named(parts[at + 1]))):
                notes.append(f"INCLUDE {name!r:.60} before BEGIN BULK left out: there is no such file beside it")
                parts[at] = ""
        own = "".join(part for at, part in enumerate(parts) if at % 3 < 2) + own[begin.start():]
    text = deck.whole(_INCLUDE, named, own=own)
    text = re.sub(r"\$.*", "", text).expandtabs(8).encode("ascii", "replace").decode()
    if "//" in text or "#" in text:
        text = re.sub(r"^(?://|#).*", "", text, flags=re.MULTILINE)
    return text, notes


def _cards(path: Path, bulk: str) -> tuple[dict[str, list[str]], Counter[str]]:
    """The fields of each card that is read, between blanks, by their names; and how many are elements but no cells."""
    cards: dict[str, list[str]] = {name: [] for name in _WIDTHS}
    counts: Counter[str] = Counter()
    name, card, mark, wanted = "", list[str](), set[str](), False
    marks, astray = set[str](), dict[str, str]()  # of lines that wait for a continuation; of continuations elsewhere
    for line in bulk.split("\n"):
        if line.isspace() or not line:
            continue
        if name and not wanted and line[:1] in ("+", "*") and "," in line and not line[1:8].strip():
            mark = set()
            continue  # of a card that is not read: its fields may be texts with commas
        head, data, after = _fields(path, line)
        if head and head[0] != "+" and (head[0] != "*" or head[1:2] == "("):
            _close(path, cards, name, card)
            name, card = head.rstrip("*"), []
            counts[head] += 1
            wanted = name.rstrip("_") in _WIDTHS
        elif not name:
            raise InputError(f"{path} begins with a continuation: {line.strip()!r}")
        elif (this := head.lstrip("+*")) in mark:
            marks -= mark
        elif this and (mark or not wanted):  # older files may list them anywhere
            astray[this] = head
            marks |= {this} if wanted else set()
        card += data
        end = after.strip().upper()
        mark = {end.lstrip("+*"), end[1:]} - {""}  # NASTRAN does not compare the first character, whatever it is
        if wanted:
            marks |= mark
            if line.count(",") > 9 and "".join(line.split(",")[10:]).strip():
                raise InputError(f"{path} has a line of more than 10 fields: {line[:60]!r}")
    _close(path, cards, name, card)
    if wrong := [head for this, head in astray.items() if this in marks]:
        raise InputError(f"{path}: the continuation {wrong[0]!r} does not stand below the line it continues: sort the file")
    # how many are elements but no cells; what is not read and must be is refused
    skipped: Counter[str] = Counter()
    for head, count in counts.items():
        name = head.rstrip("*")
        if name.rstrip("_") in _WIDTHS or name == "CBARAO":
            if head.endswith("_*"):
                raise InputError(f"{path} has {head} cards, in which meshio mixes up the nodes: write small fields")
        elif _SKIPPED.fullmatch(name):
            skipped[name] += count
        elif _REFUSED.fullmatch(name):
            raise InputError(f"{path} has {name} cards, which are not read: write the mesh without them")
        elif (near := get_close_matches(name, _WIDTHS, n=1, cutoff=0.8)) and (
                name[0] == near[0][0] or sorted(name) == sorted(near[0])):  # PBEAM, EGRID, RADSET are cards of their own
            raise InputError(f"{path} has {name} cards, which are not read; did you mean {near[0]}?")
    return cards, skipped


def _fields(path: Path, line: str) -> tuple[str, list[str], str]:
    """The first field in capitals, four wide or eight small ones of data, and the last field of a line.

    A comma makes all fields of a line free ones: then what should be its first field may hold others behind it.
    """
    name, *more = (line.partition(",")[0] if "," in line else line[:8]).upper().split() or [""]
    if more and more != ["*"] and (name.rstrip("*_") in _KNOWN or (name[0] in "*+" and "," in line)):
        raise InputError(f"{path}: {line.strip()!r:.75} has its fields neither in columns of 8 or 16 nor between commas. Write "
                         "0.5, not 0,5, and a comma between all fields or none")
    if "," not in line:
        head = line[:8].strip().upper()
        head = f"{head[:-1].rstrip()}*" if head.endswith("*") else head  # 'GRID   *'
        width = 16 if "*" in head else 8
        return head, [line[start:start + width].strip() for start in range(8, 72, width)], line[72:80]
    words = [word.strip() for word in line.split(",")]
    head = words[0].upper() if not line.startswith("DEQATN") else "DEQATN"  # a formula follows, which may have commas
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
        complete(path, card)
        _close(path, cards, "GRID place", card[2:5])
        card[1] = card[1] or BLANK
    if name in _TWICE and any(card[4:8]):
        _close(path, cards, name, card[4:8])
    cards[name].append(" ".join([field or "0" for field in card[:width]] + ["0"] * (width - len(card))))


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
