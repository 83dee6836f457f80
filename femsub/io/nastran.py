"""Nastran bulk data (.bdf, .nas, .fem, .dat): cards in fields of 8 and 16 columns and free ones, grids and frames, elements.

meshio reads these too. But it ignores INCLUDE and GRDSET, reads angles and offsets of shells as nodes, and fails at free
continuations, blank fields and lower case.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from femsub.checks import Array, InputError, is_file
from femsub.io.damage import check_end
from femsub.io.mesh_text import Deck, as_numbers, meshed, text_of, whole_numbers, without_copies

NAMES = tuple(f"CORD{way}{shape}" for way in (1, 2) for shape in "RCS")  # of coordinate systems
_INCLUDE = r"""^[ \t]*INCLUDE\b[ \t]*('[^']*'?|"[^"]*"?|[^\n$]*)[^\n]*\n?"""  # the name may go on in the next lines
BLANK = "-9"  # stands for a coordinate system that is not given: GRDSET may give it
_HEXA20 = [*range(12), 16, 17, 18, 19, 12, 13, 14, 15]  # Nastran has the upright edges before those of the top
_IHEX2 = [0, 2, 4, 6, 12, 14, 16, 18, 1, 3, 5, 7, 13, 15, 17, 19, 8, 9, 10, 11]  # around the bottom, upright edges, the top
_WEDGE15 = [*range(9), 12, 13, 14, 9, 10, 11]
#: card: kind of cell by number of nodes; behind a line's two nodes stands its orientation
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
#: card: how many fields are read: number of a point and the systems of its place and motions; number, property, nodes of a cell
_WIDTHS = {"GRID": 3, "GRID place": 3, "GRDSET": 6} | {name: 2 + max(sizes) for name, sizes in _CELLS.items()} | {
    name: 4 if name.startswith("CORD1") else 11 for name in NAMES}
KNOWN = {*_WIDTHS, "DMIG", "DTI", "SPOINT", "EXTRN", "SECONCT", "BSET", "BSET1", "QSET", "QSET1", "BNDFIX", "BNDFIX1"}
_TWICE = ("CROD", "CTUBE", *(name for name in NAMES if name.startswith("CORD1")))  # two of them may stand on one card
_ORDER = {("CHEXA", 20): _HEXA20, ("CIHEX2", 20): _IHEX2, ("CPENTA", 15): _WEDGE15, ("CTRIAX6", 6): [0, 2, 4, 1, 3, 5]}
#: elements that are not cells: skipped, with a note
_SKIPPED = re.compile(r"CONM[12]|CMASS\d|CELAS\d|CDAMP\d|CVISC|CONROD|CWELD|CFAST|CSEAM|CBEND|CHBDY.?|RBE\d|RBAR|RROD|RJOINT|"
                      r"PLOTEL|GENEL|CTRI(M6|AAX|ARG)|CTRAP(AX|RG)|CTRSHL|CTRPLT1|CTORDRG|CCONEAX|CIS2D8|CFLUID\d|CAXIF\d|CSLOT\d|"
                      r"CRIGD\w|CRROD|CELBOW|CBEAM3|CBUSH2D|CPLST[NS]\d")
#: other elements that fill a volume, and cards that change the mesh: refused
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
    bulk, begins, notes, ended = bulk_of(path)
    if not ended:
        check_end(path)
        notes.append("the file has no ENDDATA: if it was cut short at the end of a line, cards are missing")
    if len(begins) > 1 or any(re.search(r"SUPER|AUXM", begin, flags=re.IGNORECASE) for begin in begins):
        raise InputError(f"{path} has several parts of bulk data (superelements): write one")
    tables, others = tables_of(path, cards_in(path, bulk))
    skipped = Counter[str]()
    for name, many in others.items():
        if _SKIPPED.fullmatch(name):
            skipped[name] = many
        elif _REFUSED.fullmatch(name):
            raise InputError(f"{path} has {name} cards, which are not read: write the mesh without them")
        elif name != "CBARAO" and (near := get_close_matches(name, _WIDTHS, n=1, cutoff=0.8)) and (
                name[0] == near[0][0] or sorted(name) == sorted(near[0])):  # PBEAM, EGRID, RADSET are cards of their own
            raise InputError(f"{path} has {name} cards, which are not read; did you mean {near[0]}?")
    systems, copies = systems_of(path, tables)
    numbers, points = systems.numbers, systems.points()
    # kind, numbers, properties and nodes of the cells of a card, for each number of nodes it may have
    blocks = []
    for name in (one for one in _CELLS if tables[one]):
        values = _values(path, name, tables[name])
        filled = values[:, 2:] != 0
        count = np.where(filled.all(axis=1), filled.shape[1], filled.argmin(axis=1))
        whole_numbers(f"{path}: the numbers of {name}", values[:, 0])
        if name in ("CBUSH", "CBUSH1D", "CGAP"):  # with one node they lead to the ground
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
    properties = [np.where(block[2] == 0, block[1], block[2]) for block in blocks]
    given = any(block[2].any() for block in blocks)
    mesh = meshed(path, numbers, points, [(kind, ids, nodes) for kind, ids, _, nodes in blocks],
                  cell_data={"nastran:ref": properties} if given else {})
    return mesh, [*notes, *copies, *(f"{count} {name} skipped" for name, count in sorted(skipped.items()))]


def bulk_of(path: Path) -> tuple[list[str], list[str], list[str], bool]:
    """The bulk data of a file and its included files, as lines without comments; the BEGIN lines; notes; whether it has ENDDATA.

    The bulk data go from BEGIN BULK to ENDDATA. Files included before BEGIN BULK are alterations of Nastran's solutions (DMAP),
    which lie in Nastran's own folder. A missing one is noted.
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
    # the part between BEGIN BULK, which may stand there twice, and ENDDATA
    above, *behind = re.split(r"^[ \t]*ENDDATA\b", text, maxsplit=1, flags=re.MULTILINE | re.IGNORECASE)
    same, *below = "".join(behind).split("\n")
    if lost := same.strip(" \t,*") or _lost(below):
        notes.append(f"ENDDATA is followed by {lost!r:.40}. Cards behind ENDDATA left out, as in Nastran: if ENDDATA does not "
                     "belong there, cards are missing")
    marks = list(re.finditer(r"^[ \t]*BEGIN[ \t]+(BULK|SUPER)\b[^\n]*", above, flags=re.MULTILINE | re.IGNORECASE))
    begins = [mark[0] for mark, after in zip(marks, [*marks[1:], None], strict=False)
              if after is None or above[mark.end():after.start()].strip()]
    bulks = [mark for mark in marks if mark[1].upper() == "BULK"]
    if bulks and (lost := _lost(above[:bulks[-1].start()].split("\n"))):
        notes.append(f"{lost!r:.40} stands before BEGIN BULK. Cards before BEGIN BULK left out, as in Nastran: if BEGIN BULK "
                     "does not belong there, cards are missing")
    lines = above[bulks[-1].end() if bulks else 0:].split("\n")
    return [line for line in lines if line and not line.isspace()], begins, notes, bool(behind)


def _lost(lines: list[str]) -> str:
    """The first card among lines that are left out, or a continuation of one."""
    return next((line.strip() for line in lines if re.match(r"\s*[*+]\s|\s*\w+\*?[\s,]", line)
                 and line.replace(",", " ").split()[0].upper().rstrip("*+") in {*KNOWN, ""}), "")


def cards_in(path: Path, lines: list[str]) -> Iterator[tuple[str, list[str]]]:
    """Each card: its name in capitals, and its fields behind the name, blanks as ''. BEGIN SUPER is a card with one field."""
    name, card, mark, wanted = "", list[str](), set[str](), False
    marks, astray = set[str](), dict[str, str]()  # marks of lines that wait for a continuation, and of continuations elsewhere
    for line in lines:
        if name.rstrip("_") not in KNOWN and name and line[:1] in ("+", "*") and "," in line and not line[1:8].strip():
            mark = set()
            continue  # of a card that is not read: its fields may be texts with commas
        if begin := re.match(r"\s*BEGIN\s+SUPER\b\W*(\w*)", line, flags=re.IGNORECASE):
            if not begin[1].isdecimal():
                raise InputError(f"{path}: {line.strip()!r:.40} has no number of a superelement")
            head, data, after = "BEGIN SUPER", [begin[1]], ""
        else:
            head, data, after = _fields(path, line)
        if head and head[0] != "+" and (head[0] != "*" or head[1:2] == "("):
            if name:
                yield name, card
            name, card = head.rstrip("*"), []
            wanted = name.rstrip("_") in _WIDTHS
            if wanted and head.endswith("_*"):
                raise InputError(f"{path} has {head} cards, in which meshio mixes up the nodes: write small fields")
        elif not name:
            raise InputError(f"{path} begins with a continuation: {line.strip()!r:.60}")
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
    if name:
        yield name, card
    if wrong := [head for this, head in astray.items() if this in marks]:
        raise InputError(f"{path}: the continuation {wrong[0]!r} does not stand below the line it continues: sort the file")


def _fields(path: Path, line: str) -> tuple[str, list[str], str]:
    """The first field of a line in capitals, four wide or eight small fields of data, and the last field.

    A line with a comma has free fields only. Several words in the first field of a card that is read are refused: its fields are
    not separated.
    """
    name, *more = (line.partition(",")[0] if "," in line else line[:8]).upper().split() or [""]
    if more and more != ["*"] and (name.rstrip("*_") in KNOWN or (name[0] in "*+" and "," in line)):
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


def tables_of(path: Path, cards: Iterable[tuple[str, list[str]]]) -> tuple[dict[str, list[str]], Counter[str]]:
    """{name: the fields of each card, joined by blanks, blank ones as 0} of the cards that are read; and the counts of others."""
    tables, others = {name: list[str]() for name in _WIDTHS}, Counter[str]()
    for name, card in cards:
        known = name.rstrip("_")  # meshio's CHEXA_ is a CHEXA of 20 nodes
        if known not in _WIDTHS:
            others[name] += 1
            continue
        width = _WIDTHS[known]
        if len(_CELLS.get(known, {})) == 2 and any(card[width:]):
            raise InputError(f"{path}: {known} {card[0]} has more than {width - 2} nodes")
        if known == "GRID":
            if wrong := [field for field in card[5:8] if field and not field.isdecimal() and field != "-1"]:
                raise InputError(f"{path}: GRID {card[0]} has {wrong[0]!r:.20} behind its coordinates, where a frame, directions "
                                 "or a superelement belong: is a comma in a number? Write 0.5, not 0,5")
            if len(card) == 4:
                raise InputError(f"{path}: GRID* {card[0]} has one line, and its third coordinate belongs on a second one, which "
                                 "is lost or cut off. Write it again; where the coordinate is 0, a line with * is enough")
            tables["GRID place"].append(" ".join(field or "0" for field in (*card[2:5], "", "", "")[:3]))
            card = [card[0], *(field or BLANK for field in (card[1], (*card, "", "")[5]))]
        for part in [card[4:8], card] if known in _TWICE and any(card[4:8]) else [card]:
            tables[known].append(" ".join([field or "0" for field in part[:width]] + ["0"] * (width - len(part))))
    return tables, others


def systems_of(path: Path, tables: Mapping[str, list[str]]) -> tuple[Systems, list[str]]:
    """The coordinate systems of a file with the points of its GRID cards, each once; and notes."""
    if not tables["GRID"]:
        raise InputError(f"{path} has no GRID cards")
    if len(tables["GRDSET"]) > 1:
        raise InputError(f"{path} has several GRDSET cards")
    numbers, *both = _values(path, "GRID", tables["GRID"]).T
    whole_numbers(f"{path}: the numbers of GRID", numbers)
    default = _values(path, "GRDSET", tables["GRDSET"] or ["0 0 0 0 0 0"])[0, [1, 5]]
    given, moving = (np.where(part == int(BLANK), usual, part) for part, usual in zip(both, default, strict=True))
    points = _values(path, "GRID place", tables["GRID place"], float)
    rows, notes = without_copies(numbers, np.column_stack([given, moving, points]))
    by_nodes, by_points = {}, {}
    for name in NAMES:
        for number, *corners in _values(path, name, tables[name]).tolist() if name.startswith("CORD1") else ():
            by_nodes[number] = name[-1], np.array(corners)
        for number, of, *rest in _values(path, name, tables[name], float).tolist() if name.startswith("CORD2") else ():
            by_points[int(number)] = name[-1], int(of), np.reshape(rest, (3, 3))
    return Systems(path, numbers[rows], given[rows], points[rows], moving[rows], by_nodes, by_points), notes


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


@dataclass
class Systems:
    """The coordinate systems of a file, and its points as given: numbers (n,), the system of each (n,), coordinates (n, 3).

    `motions` (n,) has the system of each point's motions.

    `by_nodes` has shape (R, C or S) and three nodes of each CORD1, `by_points` shape, reference system and three points (3, 3) of
    each CORD2. The z axis leads from the first point to the second. The third lies in the half-plane of x and z.
    """

    path: Path
    numbers: Array
    system: Array
    places: Array
    motions: Array
    by_nodes: Mapping[int, tuple[str, Array]]
    by_points: Mapping[int, tuple[str, int, Array]]
    frames: dict[int, tuple[str, Array, Array] | None] = field(default_factory=dict)  # None while it is computed

    def basic(self, system: int, local: Array) -> Array:
        """Points (n, 3) of one system in the basic one; angles are in degrees."""
        if system == 0:
            return local
        shape, origin, axes = self._frame(system)
        r, one, other = local[:, 0], np.deg2rad(local[:, 1]), np.deg2rad(local[:, 2])
        if shape == "C":
            local = np.stack([r * np.cos(one), r * np.sin(one), local[:, 2]], axis=1)
        elif shape == "S":
            local = np.stack([r * np.sin(one) * np.cos(other), r * np.sin(one) * np.sin(other), r * np.cos(one)], axis=1)
        return origin + local @ axes

    def points(self) -> Array:
        """All points in the basic system, (n, 3)."""
        found = np.empty_like(self.places)
        for system in np.unique(self.system):
            chosen = self.system == system
            found[chosen] = self.basic(int(system), self.places[chosen])
        return found

    def axes(self, system: int, point: Array) -> Array:
        """Unit vectors of a system at a point of the basic one, (3, 3), as rows: along r, θ, z or r, θ, φ where it is curved."""
        if system == 0:
            return np.eye(3)
        shape, origin, axes = self._frame(system)
        if shape == "R":
            return axes
        x, y, z = axes @ (point - origin)
        across = float(np.hypot(x, y))
        c, s = (x / across, y / across) if across > 1e-9 * abs(z) else (1.0, 0.0)
        turned = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        if shape == "S":
            r = float(np.hypot(across, z)) or 1.0
            turned = np.array([[c * across / r, s * across / r, z / r], [c * z / r, s * z / r, -across / r], turned[1]])
        found: Array = turned @ axes
        return found

    def _frame(self, system: int) -> tuple[str, Array, Array]:
        """Shape, origin and unit vectors (3, 3), as rows."""
        if system in self.frames:
            known = self.frames[system]
            if known is None:
                raise InputError(f"{self.path}: the coordinate system {system} is defined by itself")
            return known
        self.frames[system] = None
        if system in self.by_points:
            shape, of, places = self.by_points[system]
            a, b, c = self.basic(of, places)
        elif system in self.by_nodes:
            shape, nodes = self.by_nodes[system]
            rows = [np.flatnonzero(self.numbers == node) for node in nodes]
            if lost := [int(node) for node, row in zip(nodes, rows, strict=True) if len(row) != 1]:
                raise InputError(f"{self.path}: the coordinate system {system} names node {lost[0]}, which the file does not "
                                 "give")
            a, b, c = (self.basic(int(self.system[row[0]]), self.places[row])[0] for row in rows)
        else:
            raise InputError(f"{self.path} gives nodes in the coordinate system {system} (fields CP and CD), but it has no "
                             f"{', '.join(NAMES)} with this number")
        z, across = b - a, np.cross(b - a, c - a)
        if np.linalg.norm(across) <= 1e-9 * np.linalg.norm(z) * np.linalg.norm(c - a):
            raise InputError(f"{self.path}: the three points of the coordinate system {system} lie on a line")
        y, z = across / np.linalg.norm(across), z / np.linalg.norm(z)
        found = shape, a, np.stack([np.cross(y, z), y, z])
        self.frames[system] = found
        return found
