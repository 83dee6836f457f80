"""Abaqus and CalculiX input files (.inp): nodes, elements and sets, with the numbers that the file gives them.

meshio reads these too. But it keeps no numbers, reads only the last of several *NODE blocks, and confuses the sets that
*ELEMENT lines name. The result is a meshio.Mesh; its numbers are named as in meshio's Nastran reader.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from itertools import pairwise, takewhile
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from femsub.checks import Array, InputError
from femsub.io.damage import MOST
from femsub.io.mesh_text import Deck, as_numbers, as_table, fields, meshed, once, rows_of, whole_numbers, without_copies

#: keywords that change a mesh in ways that are not read
_CHANGING = ("IMPERFECTION", "IMPORT", "IMPORT ELSET", "IMPORT NSET", "SYMMETRIC MODEL GENERATION", "REFINE MESH", "PARAMETER")
_ITEM = re.compile(r'(?:[^,"]|"[^"]*"?)+')
_PLANE = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9", 65: "triangle6"}
#: how the name of an element begins, and what the number after that means
_FAMILIES = (
    (r"C3D|DC3D", {4: "tetra", 10: "tetra10", 8: "hexahedron", 20: "hexahedron20", 6: "wedge", 15: "wedge15", 5: "pyramid"}),
    (r"CPS|CPE|CAX|STRI|SFM3D|M3D|R3D|US|S", _PLANE),
    (r"T2D|T3D", {2: "line", 3: "line3"}),
    (r"B[23]", {1: "line", 2: "line3", 3: "line"}),
)
_SIZES = {"tetra": 4, "tetra10": 10, "hexahedron": 8, "hexahedron20": 20, "wedge": 6, "wedge15": 15, "pyramid": 5,
          "triangle": 3, "quad": 4, "triangle6": 6, "quad8": 8, "quad9": 9, "line": 2, "line3": 3}
#: other elements that fill a volume, which would be missing: cohesive, gasket, acoustic, infinite, continuum shells, ...
_VOLUMES = re.compile(r"(COH|GK|AC|CIN|EC|PC|FC|F|Q|DCC|EMC)3D([4-9]|\d\d)|SC[68]|CSS8|C3D")
_SCOPES = ("PART", "INSTANCE", "ASSEMBLY", "END PART", "END INSTANCE", "END ASSEMBLY")
#: a line with more options of the keyword above it. If the line behind a keyword's last comma has none, the comma is a mistake
_OPTIONS = re.compile(r"[^,\n]*=|[ \t]*(GENERATE|UNSORTED|INTERNAL|SHIFT|REFLECT|POLE)[ \t]*(,|\n|\Z)", re.IGNORECASE)


def read_inp(path: Path) -> tuple[Any, list[str]]:
    """A meshio.Mesh with `points_id` and `cells_id` (the file's numbers), and what was skipped.

    ==============  ==========================================================================================================
    reads           \\*NODE, \\*ELEMENT, \\*NSET, \\*ELSET (lists, names, quoted names, GENERATE), \\*NGEN (straight, arcs),
                    \\*NFILL (equal intervals), \\*NCOPY, \\*NMAP (RECTANGULAR, CYLINDRICAL), \\*ELGEN, \\*ELCOPY, \\*INCLUDE and
                    INPUT= (files beside the one that names them, or beside this one); blank and missing fields as 0, Fortran
                    exponents, a byte-order mark, Latin-1; the mesh of a part, or of an instance
    skips, reports  elements that are no cells (MASS, SPRING, ...); nodes, elements and sets that only the assembly has; more
                    nodes on a line than an element has; nodes and elements of sets that the file does not give; nodes given
                    twice at the same place
    refuses         several parts or instances, one that is moved, \\*SYSTEM, nodes in cylindrical coordinates; other options
                    of what is read; \\*IMPERFECTION, \\*IMPORT, \\*MODEL CHANGE, \\*REFINE MESH, \\*PARAMETER, \\*SYMMETRIC MODEL
                    GENERATION; nearly known keywords; elements given twice, nodes at two places; elements that fill a volume
                    and are not supported; a last line that does not end
    cannot know     whether lines are missing between two keywords or at the end: the format counts nothing. A number in a
                    list of a set is a node or element, a set called 7 needs quotes there
    ==============  ==========================================================================================================

    Raises
    ------
    InputError
        What is refused, by keyword, set and number.
    """
    # keyword by keyword
    found = Contents(path)
    for keyword, options, data in _blocks(path, found.notes):
        if keyword == "SYSTEM" and data.strip():
            raise InputError(f"{path} has a *SYSTEM, which moves coordinates; write the nodes in the global system")
        if keyword in _SCOPES:
            found.scopes[keyword] += 1
            if found.scopes["PART"] > 1 or found.scopes["INSTANCE"] > 1 or (keyword == "INSTANCE" and data.strip()):
                raise InputError(f"{path} has several parts or a part that is moved: write one flat file, e.g. with "
                                 "'do not use parts and assemblies in input files' in Abaqus/CAE")
            continue
        in_assembly = (found.scopes["ASSEMBLY"] > found.scopes["END ASSEMBLY"]
                       and found.scopes["INSTANCE"] == found.scopes["END INSTANCE"])
        found.continues |= keyword == "RESTART" and "READ" in options
        if keyword not in _MAKERS:
            continue
        maker, option, accepted = _MAKERS[keyword]
        if in_assembly and "INSTANCE" not in options:
            found.apart.add(f"*{keyword} {options.get(option, '')}".strip())
            continue
        for key, value in options.items() if accepted else ():
            if key not in (*accepted, "INPUT"):
                raise InputError(f"{path}: *{keyword}, {f'{key}={value}' if value else key} is not read: write the mesh with all "
                                 "nodes and elements listed")
        for members in maker(found, keyword, options, data):
            if option in options:
                found.add("EL" if keyword.startswith("EL") else "N", options[option], members)
    # nodes and elements
    if not found.nodes or not found.elements:
        others = ", ".join(f"{count} of type {kind}" for kind, count in found.skipped.items())
        if others and found.nodes:
            raise InputError(f"{path} has only elements of types that femsub does not read: {others}")
        also = ": it continues another run (*RESTART, READ), whose file has the mesh" if found.continues else ""
        raise InputError(f"{path} has no {'*ELEMENT' if found.nodes else '*NODE'} data{also}")
    numbers, points = found.all_nodes()
    known = found.all_elements()
    once(path, "elements", known)
    # sets
    node_sets, cell_sets = dict[str, Array](), dict[str, Array]()
    for (sort, _), name in found.spelling.items():
        what = f"*{sort}SET {name}"
        listed = found.members(sort, name, what)
        if sort == "N":
            node_sets[name] = whole_numbers(f"{path}: the nodes of {what}", listed)
            found.leave_out(what, "nodes", np.setdiff1d(listed, numbers))
            continue
        found.leave_out(what, "elements", np.setdiff1d(listed, known))
        if not len(listed) or any(np.isin(part, listed).any() for _, part, _ in found.elements):  # else of skipped elements
            cell_sets[name] = listed
    mesh = meshed(path, numbers, points, found.elements, node_sets, cell_sets)
    notes = [f"{count} element{'s' * (count != 1)} of type {kind} skipped" for kind, count in found.skipped.items()] + found.notes
    if found.apart:
        notes.append(f"keywords that belong to the assembly only skipped: {', '.join(sorted(found.apart))}")
    return mesh, notes


# ---- the content read so far, by the file's numbers

class Range(NamedTuple):
    first: int
    last: int
    step: int


class NodesOf(NamedTuple):
    elements: str


Part: TypeAlias = "Array | Range | NodesOf"


@dataclass
class Contents:
    """The content of a file, by the file's numbers."""

    path: Path
    nodes: list[tuple[Array, Array]] = field(default_factory=list)
    elements: list[tuple[str, Array, Array]] = field(default_factory=list)
    others: list[Array] = field(default_factory=list)  # numbers of elements of kinds that are no cells
    sets: dict[tuple[str, str], list[Part]] = field(default_factory=dict)  # by sort (N or EL) and name in capitals
    spelling: dict[tuple[str, str], str] = field(default_factory=dict)
    skipped: Counter[str] = field(default_factory=Counter)
    scopes: Counter[str] = field(default_factory=Counter)
    apart: set[str] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)
    continues: bool = False  # another run, by *RESTART, READ

    def add(self, sort: str, name: str, members: Part) -> None:
        """Add members to a set. Names are not case-sensitive; a set that appears again grows."""
        self.spelling.setdefault((sort, name.upper()), name)
        self.sets.setdefault((sort, name.upper()), []).append(members)

    def all_nodes(self) -> tuple[Array, Array]:
        """Numbers, ascending, and points; a number that comes again at another place is an error."""
        if not self.nodes:
            raise InputError(f"{self.path} has no *NODE data where they are needed")
        if len(self.nodes) > 1 or not (np.diff(self.nodes[0][0]) > 0).all():
            numbers, points = (np.concatenate(parts) for parts in zip(*self.nodes, strict=True))
            rows, notes = without_copies(numbers, points)
            self.notes += notes
            rows = rows[once(self.path, "nodes", numbers[rows])]
            self.nodes = [(numbers[rows], points[rows])]
        return self.nodes[0]

    def all_elements(self) -> Array:
        return np.sort(np.concatenate([np.zeros(0, dtype=np.int64), *(part for _, part, _ in self.elements), *self.others]))

    def place(self, what: str, wanted: Array) -> Array:
        """The points of nodes."""
        numbers, points = self.all_nodes()
        return points[rows_of(self.path, what, "node", numbers, wanted)]

    def members(self, sort: str, name: str, what: str) -> Array:
        """The numbers in a set as far as it has been read, ascending."""
        parts = self.sets.get((sort, name.upper()))
        if parts is None:
            raise InputError(f"{self.path}: {what} names the set {name!r}, which is not above it")
        found = [np.zeros(0, dtype=np.int64)]
        for part in parts:
            if isinstance(part, NodesOf):
                cells = self.members("EL", part.elements, what)
                found += [nodes[np.isin(numbers, cells)].ravel() for _, numbers, nodes in self.elements]
            elif isinstance(part, Range):
                numbers = self.all_nodes()[0] if sort == "N" else self.all_elements()
                count = (part.last - part.first) // part.step + 1
                inside = numbers[(numbers >= part.first) & (numbers <= part.last) & ((numbers - part.first) % part.step == 0)]
                if len(inside) < count:
                    wrong = np.flatnonzero(inside != part.first + part.step * np.arange(len(inside)))
                    missing = part.first + part.step * (int(wrong[0]) if len(wrong) else len(inside))
                    self.leave_out(what, "nodes" if sort == "N" else "elements", [missing], count - len(inside))
                found.append(inside)
            else:
                found.append(part)
        return np.unique(np.concatenate(found))

    def leave_out(self, what: str, kind: str, missing: Sequence[int] | Array, count: int | None = None) -> None:
        """Note members of a set that the file does not give, if there are any: meshes often have gaps in their numbers.

        `missing` begins with the first; `count` is how many there are, if it does not list them.
        """
        if not len(missing):
            return
        note = f"{what} names {count or len(missing)} {kind} that the file does not give, the first is {missing[0]}: left out"
        self.notes += [note] * (note not in self.notes)


def _rows(what: str, data: str, width: int, kind: type = np.int64, lines: int = 0) -> Array:
    """The numbers of each line, (lines, width), missing ones as 0. `lines` sets the number of rows; more lines are an error."""
    values, counts = fields(f"{what}: its data", data, kind)
    if counts.max(initial=0) > width or len(counts) > lines > 0:
        raise InputError(f"{what} takes {lines or 'any'} lines of up to {width} numbers, not {len(counts)} of {counts.max()}")
    rows: Array = np.zeros((max(lines, len(counts)), width), dtype=kind)
    rows[:len(counts), :counts.max(initial=0)] = as_table(values, counts)
    return rows


def _integer(what: str, options: Mapping[str, str], name: str) -> int:
    if not re.fullmatch(r"[+-]?\d{1,15}", options.get(name, "")):
        raise InputError(f"{what} needs {name}=..., a whole number; it has {options.get(name)!r}")
    return int(options[name])


# ---- keywords, with the content of *INCLUDE and INPUT= inserted

def _blocks(path: Path, notes: list[str]) -> Iterator[tuple[str, dict[str, str], str]]:
    """The keywords of a file in their order, their options in capitals (values without quotes), and the lines below them.

    Raises
    ------
    InputError
        A file that is named but not there; a last line that may be cut; a keyword that changes the mesh in a way that is
        not read; a misspelt keyword of a mesh.
    """
    # the text with the files it includes, without comments
    def named(line: str) -> str:
        found = re.search(r'INPUT\s*=\s*("[^"]*"|[^,\n]*)', line, flags=re.IGNORECASE)
        return _unquoted(found[1]) if found else ""

    deck = Deck(path)
    text = deck.whole(r"^[ \t]*\*[ \t]*INCLUDE\b([^\n]*(?:,[ \t]*\n[^\n]*)*)\n?", named, _ended)
    text = re.sub(r"^[ \t]*\*\*.*\n?", "", text, flags=re.MULTILINE)
    quoted: dict[str, str] = {}
    first, *parts = re.split(r"^[ \t]*\*", text, flags=re.MULTILINE)
    if first.strip():
        notes.append(f"{first.strip().splitlines()[0]!r:.40} stands before the first keyword, left out: is a line with * lost?")
    for part in parts:
        head, _, data = part.partition("\n")
        if head.rstrip().endswith(","):
            lines = part.split("\n")
            goes_on = (above.rstrip().endswith(",") and _OPTIONS.match(line) for above, line in pairwise(lines))
            count = 1 + sum(1 for _ in takewhile(bool, goes_on))
            head, data = "".join(lines[:count]), "\n".join(lines[count:])
        # keyword and options
        words = _ITEM.findall(head)
        keyword = " ".join(words[0].split()).upper() if words else ""
        options = {key.strip().upper(): _unquoted(value) for key, _, value in (word.partition("=") for word in words[1:])}
        # keywords that change the mesh, and misspelt ones
        if keyword in _CHANGING or (keyword == "MODEL CHANGE" and options.get("TYPE", "ELEMENT").upper() == "ELEMENT"):
            raise InputError(f"{path} has *{keyword}, which changes the mesh in a way that femsub does not support. Write the "
                             "mesh after this change")
        near = get_close_matches(keyword.replace(" ", ""), _MESH, n=1, cutoff=0.8)
        if near and keyword not in _MESH:
            raise InputError(f"{path} has the unknown keyword *{keyword}; did you mean *{near[0]}?")
        if keyword not in _MESH and not re.fullmatch("[A-Z][A-Z _-]{0,39}", keyword):  # too long, or with other signs
            notes.append(f"*{keyword:.20} is no keyword of Abaqus or CalculiX, left out with its lines: is it damaged?")
        # names of sets, and data of another file
        for name in re.findall(r'SET\s*=\s*"([^"]*)"', head, flags=re.IGNORECASE):
            if quoted.setdefault(name.upper(), name) != name:
                raise InputError(f"{path} has sets {quoted[name.upper()]!r} and {name!r}, which differ only in upper and lower "
                                 "case. They would become one; rename one of them")
        if keyword in _MESH and "INPUT" in options:
            place, more = deck.included(deck.path, options["INPUT"])
            _ended(place, more, alone=False)
            more = re.sub(r"^[ \t]*\*\*.*\n?", "", more, flags=re.MULTILINE)
            if re.search(r"^[ \t]*\*", more, flags=re.MULTILINE):
                raise InputError(f"{place} is the INPUT of *{keyword}, but has a keyword of its own: *INCLUDE it instead")
            data = (more if more.endswith("\n") or not more else f"{more}\n") + data
        if keyword in ("NSET", "ELSET") and re.search(r"\n[ \t]*\n", f"\n{data.rstrip()}"):
            notes.append(f"the data of *{keyword} have an empty line above or between them: is a line with a keyword lost?")
        if keyword in ("NSET", "ELSET") and not data.strip() and "ELSET" not in {*options} - {keyword}:
            notes.append(f"*{keyword} {options.get(keyword, '')} has no members: is a line lost?")
        yield keyword, options, data


def _names(data: str) -> list[str]:
    """The words between commas and line ends, without surrounding blanks; quotes stay."""
    return [word for line in data.split("\n") for item in _ITEM.findall(line) if (word := item.strip())]


def _unquoted(value: str) -> str:
    return value.strip().strip('"')


def _ended(path: Path, text: str, alone: bool) -> None:
    """Refuse a last line without an end if it may contain incomplete mesh data."""
    if text.endswith("\n") or not text:
        return
    heads = re.findall(r"^[ \t]*\*(?!\*)([^\n,]*)", text, flags=re.MULTILINE)
    last = " ".join(heads[-1].split()).upper() if heads else "" if alone else "NODE"
    line = text[text.rfind("\n") + 1:].lstrip()
    cut = line.startswith("*") and not line.startswith("**") and any(word.startswith(last) for word in (*_MESH, "INCLUDE"))
    if line and not line.startswith("**") and (last in _MESH or cut):
        raise InputError(f"{path} ends within a line of *{last} data: is it cut short? If not, end that line")


# ---- what is listed

def _nodes(found: Contents, keyword: str, options: Mapping[str, str], data: str) -> Iterator[Part]:
    path = found.path
    if options.get("SYSTEM", "R").upper() != "R":
        raise InputError(f"{path} gives nodes in cylindrical or spherical coordinates; write them as x, y, z")
    values, counts = fields(f"{path}: the data of *NODE", data, float)
    if not len(counts):
        return
    rows = [line for line in data.split("\n") if line.strip()] if counts.max() > 4 else [""]
    lines = [line.rstrip(", \t").count(",") for line in rows]
    table = as_table(values, counts)
    for at, line in enumerate(rows):  # 7, 1., 2., , 0.: the blank coordinate is 0, and 0 alone is no normal
        if len(rows) == len(table) and lines[at] == 4 and not line.split(",")[3].strip() and not table[at, 4:].any():
            lines[at] = 3
    some = table[np.isin(lines, (4, 5)), 4:7] if len(lines) == len(table) else table[:0, 4:7]  # of a normal, or of 0,5
    if not 3 <= counts.max() <= 8 or max(lines) > 6 or not ((np.abs(some) <= 1).all() and some.any(axis=1).all()):
        raise InputError(f"{path}: *NODE has {len(values)} numbers in {len(counts)} lines; each line must be number, x, y, z "
                         "(coordinates that are left out at the end of a line are 0; a normal may follow; write 0.5, not 0,5)")
    if len(some):
        found.notes.append(f"{len(some)} node{'s have' if len(some) > 1 else ' has'} one or two direction cosines of a normal. A "
                           "coordinate with a decimal comma (0,5) would look alike: check that the file has none")
    whole = whole_numbers(f"{path}: the numbers of nodes", table[:, 0])
    points = np.zeros((len(table), 3))
    points[:, :min(table.shape[1] - 1, 3)] = table[:, 1:4]
    found.nodes.append((whole, points))
    yield whole


def _elements(found: Contents, keyword: str, options: Mapping[str, str], data: str) -> Iterator[Part]:
    path, kind_here = found.path, options.get("TYPE", "").upper()
    kind = next((kinds.get(int(match[1])) for family, kinds in _FAMILIES
                 if (match := re.match(rf"(?:{family})(\d{{1,9}})(?!\d)", kind_here))), None)
    what = f"{path}: the data of *ELEMENT, TYPE={kind_here}"
    if kind is None:
        if not kind_here or _VOLUMES.match(kind_here):
            raise InputError(f"{path}: elements of type {kind_here or '(none)'} cannot be read; C3D4, C3D10, C3D8 and C3D20 can")
        # numbers of elements that are no cells; a line that ends with a comma goes on in the next
        lines = [line for line in data.split("\n") if line.strip()]
        heads = [line.split(",")[0] for line, above in zip(lines, ["", *lines], strict=False) if not above.rstrip().endswith(",")]
        others = as_numbers(f"{path}: the numbers of *ELEMENT, TYPE={kind_here}", " ".join(heads))
        found.skipped[kind_here] += len(others)
        found.others.append(others)
        yield others
        return
    bare = "\n".join(line.rstrip(", \t") for line in data.split("\n"))
    values, counts = fields(what, bare)  # CalculiX passes over all commas at the end
    width = _SIZES[kind] + 1
    if len(counts) and counts.min() >= width < counts.max():
        more = int(counts.max()) - width
        found.notes.append(f"elements of type {kind_here} have up to {more} node{'s' * (more != 1)} too many on a line, left out")
        values, counts = as_table(values, counts)[:, :width].ravel(), np.full(len(counts), width)
    if len(values) % width:
        raise InputError(f"{path}: *ELEMENT, TYPE={kind_here} has {len(values)} numbers, which is no multiple of {width} (number "
                         f"and {width - 1} nodes); is the file cut short?")
    if not len(values):
        return
    if len(within := np.setdiff1d(np.arange(width, len(values), width), np.cumsum(counts))):
        raise InputError(f"{path}: *ELEMENT, TYPE={kind_here}: element {values[within[0]]} begins within a line; a line has "
                         f"{width} numbers")
    table = values.reshape(-1, width)
    found.elements.append((kind, whole_numbers(f"{path}: the numbers of elements", table[:, 0]), table[:, 1:]))
    yield table[:, 0]


def _set(found: Contents, keyword: str, options: Mapping[str, str], data: str) -> Iterator[Part]:
    sort = keyword.removesuffix("SET")
    name = options.get(keyword, "")
    what = f"{found.path}: *{keyword} {name}"
    if not name:
        raise InputError(f"{found.path}: a *{keyword} without a name ({keyword}=...)")
    yield np.zeros(0, dtype=np.int64)
    if sort == "N" and "ELSET" in options:
        yield NodesOf(options["ELSET"])
        return
    if "GENERATE" in options:
        for first, last, step, _ in _rows(f"{what}, GENERATE", data, 4).tolist():
            step = step or 1
            if step < 1 or last < first or first < 1:
                raise InputError(f"{what}, GENERATE has a line from {first} to {last} in steps of {step}; it must be first, "
                                 "last, step with last ≥ first and a step of 1 or more")
            yield Range(first, last, step)
        return
    if not re.search(r"[^\d\s,+-]", data):
        yield as_numbers(f"{what}: its data", data, commas=True)
        return
    members: list[str] = []
    have = set(map(id, found.sets.get((sort, name.upper()), ())))
    for word in dict.fromkeys(_names(data)):
        if re.fullmatch(r"[+-]?[0-9]+", word):
            members.append(word)
            continue
        other = word.strip('"')
        known = found.sets.get((sort, other.upper()))
        if known is None or (other.upper() == name.upper() and len(known) == 1):
            raise InputError(f"{what} names {word!r}, which is neither a number nor a set above it")
        for part in [part for part in known if id(part) not in have]:  # the set has the others already
            have.add(id(part))
            yield part
    yield as_numbers(f"{what}: its data", " ".join(members))


# ---- generated nodes and elements; for the lines see the Abaqus Keywords Reference Guide, under the keyword

def _line_of_nodes(found: Contents, keyword: str, options: Mapping[str, str], data: str) -> Iterator[Part]:
    """Nodes between two, on a straight line or (LINE=C) on an arc about a third.

    Columns: first node, last node, step of the numbers, centre as a node, or its coordinates, normal of the arc.
    """
    what, line = f"{found.path}: *NGEN", options.get("LINE", "").upper()
    if line not in ("", "C"):
        raise InputError(f"{what}, LINE={line} is not read: write the mesh with all nodes and elements listed")
    for row in _rows(what, data, 11, float):
        if (row[:4] % 1).any():
            raise InputError(f"{what} needs first node, last node, step; it has {row[:4].tolist()}")
        first, last, step = (int(value) for value in (*row[:2], row[2] or 1))
        if (last - first) % step or (last - first) // step < 1:
            raise InputError(f"{what}: {last} is not reached from {first} in steps of {step}")
        if (last - first) // step > MOST:
            raise InputError(f"{what}: from {first} to {last} in steps of {step} are more than {MOST} numbers")
        numbers = np.arange(first, last + np.sign(step), step)
        ends = found.place("*NGEN", numbers[[0, -1]])
        share = np.linspace(0.0, 1.0, len(numbers))[1:-1, None]
        if line:
            centre = found.place("*NGEN", np.array([int(row[3])]))[0] if row[3] else row[4:7]
            arms = ends - centre
            axis = np.cross(arms[0], arms[1])
            size, radii = np.linalg.norm(axis), np.linalg.norm(arms, axis=1)
            if row[7:].any() or not radii.all() or size < 1e-6 * radii.prod() or abs(radii[0] - radii[1]) > 1e-3 * radii[0]:
                raise InputError(f"{what}, LINE=C from node {first} to {last} is not read: only arcs below 180° are")
            angle = share * np.arctan2(size, arms[0] @ arms[1])
            side = np.cross(axis / size, arms[0])
            points = centre + (1 + share * (radii[1] / radii[0] - 1)) * (np.cos(angle) * arms[0] + np.sin(angle) * side)
        else:
            points = ends[0] + share * (ends[1] - ends[0])
        found.nodes.append((numbers[1:-1], points))
        yield numbers


def _nodes_between(found: Contents, keyword: str, options: Mapping[str, str], data: str) -> Iterator[Part]:
    """Nodes at equal intervals from each node of one set to the node of another set with the same index."""
    what = f"{found.path}: *NFILL"
    for line in filter(str.strip, data.split("\n")):
        first, last, *rest = (*_names(line), "", "")
        given = as_numbers(f"{what}: number of intervals and step", " ".join(rest)).tolist()
        if not given or len(given) > 2:
            raise InputError(f"{what} needs two sets, the number of intervals and a step; it has {line.strip()!r}")
        count, step = (*given, 1)[:2]
        low, high = (found.members("N", name.strip('"'), "*NFILL") for name in (first, last))
        if len(low) != len(high) or not len(low) or count < 1:
            raise InputError(f"{what} cannot pair sets of {len(low)} and {len(high)} nodes in {count} intervals")
        if count * max(len(low), step) > MOST:
            raise InputError(f"{what} makes more than {MOST} nodes, or numbers as large")
        share = (np.arange(1, count) / count)[None, :, None]
        start, end = (found.place("*NFILL", nodes)[:, None, :] for nodes in (low, high))
        numbers = (low[:, None] + step * np.arange(1, count)).ravel()
        found.nodes.append((numbers, (start + share * (end - start)).reshape(-1, 3)))
        yield np.concatenate([low, high, numbers])


def _copied_nodes(found: Contents, keyword: str, options: Mapping[str, str], data: str) -> Iterator[Part]:
    what = f"{found.path}: *NCOPY"
    old, change = found.members("N", options.get("OLD SET", ""), "*NCOPY"), _integer(what, options, "CHANGE NUMBER")
    points = found.place("*NCOPY", old)
    if ("SHIFT" in options) == ("REFLECT" in options):
        raise InputError(f"{what} needs one of SHIFT and REFLECT")
    if "SHIFT" in options:
        # a translation (first line), then a rotation about the axis from a to b by an angle in degrees (second line)
        rows = _rows(f"{what}, SHIFT", data, 7, float, lines=2)
        points = points + rows[0, :3]
        if rows[1, 6]:
            n, arms, angle = _unit(f"{what}, SHIFT", rows[1, 3:6] - rows[1, :3]), points - rows[1, :3], np.deg2rad(rows[1, 6])
            along_axis = (arms @ n)[:, None] * n
            points = rows[1, :3] + along_axis + np.cos(angle) * (arms - along_axis) + np.sin(angle) * np.cross(n, arms)
    else:
        # through the point a, the line from a to b, or the plane (MIRROR) through a, b and c
        how = options["REFLECT"].upper()
        flat, _ = fields(f"{what}: its data", re.sub(r",[ \t]*(?=\n|\Z)", "", data), float)
        need = {"POINT": 3, "LINE": 6, "MIRROR": 9}.get(how, 0)
        if not need or len(flat) < need:
            raise InputError(f"{what}, REFLECT={how} with {len(flat)} numbers is not read: POINT needs 3, LINE 6, MIRROR 9")
        a, b, c = np.array([*flat, *np.zeros(9)][:9]).reshape(3, 3)
        arms = points - a
        if how == "POINT":
            points = a - arms
        else:
            n = _unit(f"{what}, REFLECT={how}", b - a if how == "LINE" else np.cross(b - a, c - a))
            along_n = (arms @ n)[:, None] * n
            points = a + (2 * along_n - arms if how == "LINE" else arms - 2 * along_n)
    found.nodes.append((whole_numbers(f"{what}: the new numbers", old + change), points))
    yield old + change


def _unit(what: str, vector: Array) -> Array:
    length = np.linalg.norm(vector)
    if not length:
        raise InputError(f"{what}: its points give no direction, since some are the same or lie on a line")
    return vector / length


def _mapped_nodes(found: Contents, keyword: str, options: Mapping[str, str], data: str) -> Iterable[Part]:
    """Turns local coordinates of nodes, scaled, into global ones; a is the origin, and a, b and c lie in a plane.

    RECTANGULAR: x from a to b, y towards c. CYLINDRICAL (r, θ in degrees, z): z from a to b, θ = 0 towards c.
    """
    what, kind = f"{found.path}: *NMAP", options.get("TYPE", "").upper()
    members, rows = found.members("N", options.get("NSET", ""), "*NMAP"), _rows(what, data, 6, float, lines=3)
    if kind not in ("RECTANGULAR", "CYLINDRICAL"):
        raise InputError(f"{what}, TYPE={kind or '(none)'} is not read; RECTANGULAR and CYLINDRICAL are")
    a, b, c = rows[0, :3], rows[0, 3:], rows[1, :3]
    e3, e1 = _unit(what, np.cross(b - a, c - a)), _unit(what, b - a)
    local = found.place("*NMAP", members) * np.where(rows[2, :3] == 0, 1.0, rows[2, :3])
    if kind == "CYLINDRICAL":
        angle = np.deg2rad(local[:, 1])
        local = np.stack([local[:, 2], local[:, 0] * np.cos(angle), local[:, 0] * np.sin(angle)], axis=1)
    numbers, places = found.all_nodes()
    places = places.copy()
    places[np.searchsorted(numbers, members)] = a + local @ np.stack([e1, np.cross(e3, e1), e3])
    found.nodes = [(numbers, places)]
    return ()


def _rows_of_elements(found: Contents, keyword: str, options: Mapping[str, str], data: str) -> Iterator[Part]:
    """Copies of a master element: along a row, in several rows, and in several layers.

    Columns: master; count, step of nodes, step of elements along the row; the same three for rows, and for layers.
    """
    what = f"{found.path}: *ELGEN"
    for row in _rows(what, data, 10):
        master, steps = row[:1], row[1:].reshape(3, 3)
        count, node, element = np.where(steps == 0, 1, steps).T
        if count.min() < 1 or np.prod(count.astype(float)) > MOST:
            raise InputError(f"{what} of element {master[0]} makes {' x '.join(map(str, count))} elements, which is none or too "
                             "many")
        grid = np.stack(np.meshgrid(*(np.arange(n) for n in count), indexing="ij"), axis=-1).reshape(-1, 3)
        _copy_elements(found, what, master, grid[1:] @ node, grid[1:] @ element)
        yield master + grid @ element


def _copied_elements(found: Contents, keyword: str, options: Mapping[str, str], data: str) -> Iterator[Part]:
    what = f"{found.path}: *ELCOPY"  # REFLECT changes the order of nodes in a cell, which is checked and mended for every cell
    old = found.members("EL", options.get("OLD SET", ""), "*ELCOPY")
    shift = _integer(what, options, "ELEMENT SHIFT")
    _copy_elements(found, what, old, np.array([_integer(what, options, "SHIFT NODES")]), np.array([shift]))
    yield old + shift


def _copy_elements(found: Contents, what: str, old: Array, node: Array, element: Array) -> None:
    """Copies of elements, one for each pair of increments of node numbers and element number."""
    left = np.setdiff1d(old, np.concatenate([np.zeros(0, dtype=np.int64), *(numbers for _, numbers, _ in found.elements)]))
    if len(left):
        raise InputError(f"{what} copies element {left[0]}, which is not above it")
    for kind, numbers, nodes in list(found.elements):
        taken = np.isin(numbers, old)
        if taken.any() and len(element):
            new = whole_numbers(f"{what}: the new numbers", (numbers[taken] + element[:, None]).ravel())
            found.elements.append((kind, new, (nodes[taken] + node[:, None, None]).reshape(-1, nodes.shape[1])))


#: keyword: the function that returns its nodes, elements or members; the option that names their set; the options that are read,
#: if others must be refused
_MAKERS: dict[str, tuple[Callable[[Contents, str, Mapping[str, str], str], Iterable[Part]], str, tuple[str, ...]]] = {
    "NODE": (_nodes, "NSET", ()), "ELEMENT": (_elements, "ELSET", ()), "NSET": (_set, "NSET", ()), "ELSET": (_set, "ELSET", ()),
    "NGEN": (_line_of_nodes, "NSET", ("LINE", "NSET")), "NFILL": (_nodes_between, "NSET", ("NSET",)),
    "NCOPY": (_copied_nodes, "NEW SET", ("CHANGE NUMBER", "OLD SET", "NEW SET", "SHIFT", "REFLECT")),
    "NMAP": (_mapped_nodes, "NSET", ("NSET", "TYPE")), "ELGEN": (_rows_of_elements, "ELSET", ("ELSET",)),
    "ELCOPY": (_copied_elements, "NEW SET", ("ELEMENT SHIFT", "OLD SET", "NEW SET", "SHIFT NODES", "REFLECT"))}
_MESH = (*_MAKERS, "SYSTEM")  # keywords whose data define the mesh
