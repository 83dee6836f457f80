"""Gmsh's .msh of versions 2 and 4, in text and in binary: nodes, elements and physical groups, each counted.

meshio reads these too. But it keeps only one unnamed physical group per entity, reads UTF-8 only, and does not check the sizes
in the file.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from femsub.checks import Array, InputError
from femsub.io.damage import Cursor, head_of
from femsub.io.mesh_text import as_numbers, once, rows_of, text_of

BODIES = ("point", "line", "surface", "volume")
VERSIONS = ("2", "2.0", "2.1", "2.2", "4", "4.0", "4.1")
#: Gmsh's number of a kind: its name, nodes and dimension
_KINDS = {15: ("vertex", 1, 0), 1: ("line", 2, 1), 8: ("line3", 3, 1), 2: ("triangle", 3, 2), 9: ("triangle6", 6, 2),
          3: ("quad", 4, 2), 16: ("quad8", 8, 2), 10: ("quad9", 9, 2), 4: ("tetra", 4, 3), 11: ("tetra10", 10, 3),
          5: ("hexahedron", 8, 3), 17: ("hexahedron20", 20, 3), 12: ("hexahedron27", 27, 3), 6: ("wedge", 6, 3),
          18: ("wedge15", 15, 3), 13: ("wedge18", 18, 3), 7: ("pyramid", 5, 3), 19: ("pyramid13", 13, 3),
          14: ("pyramid14", 14, 3)}
_HEXA = [0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15]
_ANNOUNCED = b"femsub: sections of data: "
_ORDER = {"tetra10": [0, 1, 2, 3, 4, 5, 6, 7, 9, 8], "hexahedron20": _HEXA, "hexahedron27": [*_HEXA, 22, 23, 21, 24, 20, 25, 26]}


def is_gmsh(path: Path) -> bool:
    """Whether a .msh file is Gmsh's; Ansys uses the same suffix."""
    return b"$MeshFormat" in head_of(path)


def counted(content: bytes) -> bytes:
    """The content of a file, with a comment on its number of data sections: Gmsh's format has none, and one may be cut off."""
    data = len(re.findall(rb"\n\$(?:Node|Element)Data\n", content))
    head, end, rest = content.partition(b"$EndMeshFormat\n")
    return head + end + b"$Comments\n%s%d\n$EndComments\n" % (_ANNOUNCED, data) + rest


def read_gmsh(path: Path) -> tuple[Any, list[str]]:
    """A meshio.Mesh with the physical groups as `cell_sets`: by name, or by dimension and tag (surface-8).

    ==============  ==========================================================================================================
    reads           versions 2.0 to 2.2, 4.0 and 4.1, text and binary; elements up to second order; any number of physical
                    groups of an entity; names in UTF-8 or Latin-1; node and element data that `write_mesh` wrote
    refuses         sections that do not end or hold less or more than they say; nodes given twice, or not at all; partitioned
                    meshes; elements of third order and above; another byte order
    cannot know     whether whole sections are missing at the end (Gmsh's own files end with $Elements; `write_mesh` announces
                    their number)
    ==============  ==========================================================================================================

    Raises
    ------
    InputError
        What is refused, by section.
    """
    import meshio

    # section by section, blanks between them
    found = _Found(path)
    raw, place, blanks = path.read_bytes(), 0, re.compile(rb"\s*")
    while (at := blanks.match(raw, place)) and (place := at.end()) < len(raw):
        if raw[place:place + 1] != b"$":
            raise found.wrong(f"there is {raw[place:place + 20]!r} where a section should begin")
        end = raw.find(b"\n", place)
        end = len(raw) if end < 0 else end
        section = raw[place + 1:end].strip().decode("latin-1")
        if not found.version and section in _SECTIONS and section not in ("MeshFormat", "Comments"):
            raise found.wrong(f"${section} stands before $MeshFormat")
        place = _SECTIONS.get(section, _skipped)(found, section, raw, end + 1)
    if found.announced is not None and found.announced != found.sections:
        raise found.wrong(f"it has {found.sections} sections of data, but announces {found.announced}: is it cut short?")
    # cells and their sets by physical groups, nodes in the order of the file
    if found.points is None or found.numbers is None or not found.blocks:
        raise found.wrong(f"it has no {'$Nodes' if found.points is None else '$Elements'}: is it cut short?")
    order = once(found.path, "nodes", found.numbers)
    ascending = found.numbers[order]
    cells, sets = [], dict[str, list[Array]]()
    for i, (kind, _, nodes, tags) in enumerate(found.blocks):
        name, _, dimension = _KINDS[kind]
        at = order[rows_of(found.path, "$Elements", "node", ascending, nodes)]
        cells.append((name, at[:, _ORDER[name]] if name in _ORDER else at))
        for tag in dict.fromkeys(tags) if isinstance(tags, list) else np.unique(tags[tags > 0]).tolist():
            label = found.names.get((dimension, tag), f"{BODIES[dimension]}-{tag}")
            members = np.arange(len(nodes)) if isinstance(tags, list) else np.flatnonzero(tags == tag)
            parts = sets.setdefault(label, [np.zeros(0, dtype=np.int64) for _ in found.blocks])
            parts[i] = np.union1d(parts[i], members)
    mesh = meshio.Mesh(found.points, cells, cell_sets=sets)
    for name, (tags, values) in found.point_data.items():
        mesh.point_data[name] = np.zeros(len(found.points))
        mesh.point_data[name][order[rows_of(found.path, "$NodeData", "node", ascending, tags)]] = values[:, 0]
    every = np.concatenate([block[1] for block in found.blocks])
    by_number = np.argsort(every, kind="stable")
    for name, (tags, values) in found.cell_data.items():
        whole = np.zeros(len(every))
        whole[by_number[rows_of(found.path, "$ElementData", "element", every[by_number], tags)]] = values[:, 0]
        mesh.cell_data[name] = np.split(whole, np.cumsum([len(block[1]) for block in found.blocks])[:-1])
    return mesh, found.notes


# ---- the content read so far, and its numbers

@dataclass
class _Found:
    path: Path
    version: str = ""
    binary: bool = False
    words: str = "<u8"  # how sizes are stored in binary
    names: dict[tuple[int, int], str] = field(default_factory=dict)
    entities: dict[tuple[int, int], list[int]] = field(default_factory=dict)
    numbers: Array | None = None
    points: Array | None = None
    #: kind, numbers of the elements, nodes by number, physical tags: an array by element, or a list that all elements share
    blocks: list[tuple[int, Array, Array, Array | list[int]]] = field(default_factory=list)
    point_data: dict[str, tuple[Array, Array]] = field(default_factory=dict)
    cell_data: dict[str, tuple[Array, Array]] = field(default_factory=dict)
    sections: int = 0  # sections of data
    announced: int | None = None  # by `write_mesh`
    notes: list[str] = field(default_factory=list)

    def wrong(self, why: str) -> InputError:
        return InputError(f"{self.path} cannot be read as a Gmsh mesh: {why}")


class _Numbers:
    """Reads numbers from a section. A text is first converted to numbers of one kind, and then read like a binary file."""

    def __init__(self, found: _Found, section: str, raw: bytes, start: int, kind: type = float) -> None:
        self.found, self.section, self.raw, self.end = found, section, raw, -1
        content: Any = raw
        self.kinds = {"i": "<i4", "n": found.words, "d": "<f8"}
        if not found.binary:
            self.end = _end(found, section, raw, start)
            content = as_numbers(f"{found.path}: the data of ${section}", raw[start:self.end].decode("latin-1"), kind)
            self.kinds, start = dict.fromkeys("ind", content.dtype.str), 0
        self.cursor = Cursor(f"{found.path} cannot be read as a Gmsh mesh: ${section}", content, start)

    def take(self, kind: str, count: int) -> Array:
        """`count` numbers: 'i' whole, 'n' sizes and tags, 'd' real."""
        part = self.cursor.take(self.kinds[kind], count)
        return part.astype(float) if kind == "d" else self._whole(part)

    def _whole(self, part: Array) -> Array:
        wrong = (part % 1 != 0) | (np.abs(part) > 2.0**53)
        if wrong.any():
            raise self.found.wrong(f"${self.section} has {part[wrong][0]} where a whole number belongs")
        return part.astype(np.int64)

    def one(self, kind: str) -> int:
        return int(self.take(kind, 1)[0])

    def rows(self, count: int, width: int) -> tuple[Array, Array]:
        """The numbers of nodes or elements (count,), and the real numbers behind each of them (count, width)."""
        rows = self.cursor.take([("number", self.kinds["i"]), ("values", self.kinds["d"], (width,))], count)
        return self._whole(rows["number"]), rows["values"].astype(float)

    def left(self) -> Array:
        """The numbers of a text that have not been taken."""
        content: Array = self.cursor.content
        return content[self.cursor.place // content.itemsize:]

    def done(self) -> int:
        """The place in the file behind the section; an error if numbers in it have not been taken."""
        if self.end >= 0 and len(self.left()):
            raise self.found.wrong(f"${self.section} has {len(self.left())} numbers more than it says")
        place = self.end if self.end >= 0 else self.cursor.place
        mark = re.compile(rb"\s{0,9}\$End" + self.section.encode()).match(self.raw, place)
        if not mark:
            raise self.found.wrong(f"${self.section} does not end where it says: is it cut short or damaged?")
        return mark.end()


# ---- the sections

def _skipped(found: _Found, section: str, raw: bytes, start: int) -> int:
    if section == "PartitionedEntities":
        raise found.wrong("it is partitioned: save it whole")
    return _end(found, section, raw, start) + 4 + len(section)


def _end(found: _Found, section: str, raw: bytes, start: int) -> int:
    """The position of a section's end mark."""
    end = raw.find(b"$End" + section.encode("latin-1"), start)
    if end < 0:
        raise found.wrong(f"${section} does not end: is it cut short?")
    return end


def _comments(found: _Found, section: str, raw: bytes, start: int) -> int:
    end = _end(found, section, raw, start)
    if said := re.fullmatch(re.escape(_ANNOUNCED) + rb"(\d{1,9})\s*", raw[start:end]):
        found.announced = int(said[1])
    return end + len("$EndComments")


def _format(found: _Found, section: str, raw: bytes, start: int) -> int:
    end = raw.find(b"\n", start)
    words = raw[start:max(end, start)].split()
    if len(words) < 3 or words[1] not in (b"0", b"1") or words[2] not in (b"4", b"8"):
        raise found.wrong(f"its format is {b' '.join(words)!r}")
    found.version = words[0].decode("latin-1")
    if found.version not in VERSIONS:
        raise found.wrong(f"version {found.version} is not read; {', '.join(VERSIONS)} are")
    found.binary, found.words = words[1] == b"1", f"<u{words[2].decode()}"
    if found.binary and raw[end + 1:end + 5] != b"\x01\0\0\0":
        raise found.wrong("its binary numbers are in another byte order")
    return _skipped(found, section, raw, end)


def _names(found: _Found, section: str, raw: bytes, start: int) -> int:
    end = _end(found, section, raw, start)
    count, *lines = [line for line in text_of(found.path, raw[start:end]).split("\n") if line.strip()] or ["0"]
    for line in lines:
        match = re.fullmatch(r'\s*([0-3])\s+(-?\d{1,10})\s+(?:"(.*)"|(\S+))\s*', line)
        if not match or (int(match[1]), abs(int(match[2]))) in found.names:
            raise found.wrong(f"{line.strip()!r} names no physical group, or one that has a name")
        found.names[int(match[1]), abs(int(match[2]))] = match[3] if match[3] is not None else match[4]
    if count.strip() != str(len(lines)):
        raise found.wrong(f"there are {len(lines)} physical names where {count.strip()!r} should be")
    return end + len("$EndPhysicalNames")


def _entities(found: _Found, section: str, raw: bytes, start: int) -> int:
    numbers = _Numbers(found, section, raw, start)
    for dimension, count in enumerate(numbers.take("n", 4).tolist()):
        for _ in range(count):
            tag = numbers.one("i")
            numbers.take("d", 3 if dimension == 0 and found.version != "4.0" else 6)  # its extent
            found.entities[dimension, tag] = np.abs(numbers.take("i", numbers.one("n"))).tolist()
            if dimension:
                numbers.take("i", numbers.one("n"))  # its boundary
    return numbers.done()


def _nodes(found: _Found, section: str, raw: bytes, start: int) -> int:
    if found.version[0] == "2":
        numbers, count = _counted(found, section, raw, start, float)
        found.numbers, found.points = numbers.rows(count, 3)
        return numbers.done()
    numbers = _Numbers(found, section, raw, start)
    blocks, total = numbers.take("n", 2 if found.version == "4.0" else 4)[:2].tolist()
    tags, points = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))]
    for _ in range(blocks):
        dimension, _, parametric = numbers.take("i", 3).tolist()
        count = numbers.one("n")
        if found.version == "4.0":
            some, places = numbers.rows(count, 3)
        else:
            width = 3 + (min(max(dimension, 0), 3) if parametric else 0)
            some, places = numbers.take("n", count), numbers.take("d", count * width).reshape(count, width)
        tags.append(some)
        points.append(places[:, :3])
    found.numbers, found.points = np.concatenate(tags), np.concatenate(points)
    if len(found.numbers) != total:
        raise found.wrong(f"$Nodes has {len(found.numbers)} nodes, but says {total}")
    return numbers.done()


def _counted(found: _Found, section: str, raw: bytes, start: int, kind: type) -> tuple[_Numbers, int]:
    """The numbers of a section of version 2, and its count, which is a line of text in binary files, too."""
    if not found.binary:
        numbers = _Numbers(found, section, raw, start, kind)
        return numbers, numbers.one("n")
    end = raw.find(b"\n", start)
    word = raw[start:max(end, start)].strip()
    if not re.fullmatch(rb"\d{1,15}", word):
        raise found.wrong(f"${section} begins with {word[:20]!r}, which is no count")
    return _Numbers(found, section, raw, end + 1), int(word)


def _elements(found: _Found, section: str, raw: bytes, start: int) -> int:
    if found.version[0] == "2":
        # runs of elements of the same kind and number of tags, which binary files announce and text repeats for each element
        numbers, total = _counted(found, section, raw, start, np.int64)
        left = total
        while left > 0:
            if found.binary:
                before, (kind, count, tags) = 1, numbers.take("i", 3).tolist()
            else:
                before, rest = 3, numbers.left()
                if len(rest) < 3:
                    raise found.wrong(f"$Elements ends where {left} elements should follow: is it cut short or damaged?")
                kind, tags = (int(value) for value in rest[1:3])
                width = max(3 + tags + _size(found, kind), 3)
                most, seen = min(left, len(rest) // width), 1
                heads = rest[:most * width].reshape(-1, width)[:, 1:3]
                while seen < most and (heads[:seen] == (kind, tags)).all():  # twice as many each time, as kinds may change
                    seen = min(2 * seen, most)
                same = (heads[:seen] == (kind, tags)).all(axis=1)
                count = len(same) if same.all() else int(same.argmin())
            size = _size(found, kind)
            if not 0 <= tags <= 100 or not 0 < count <= left:
                raise found.wrong(f"$Elements has {count} elements with {tags} tags where {left} should follow: is it cut short "
                                  "or damaged?")
            table = numbers.take("i", count * (before + tags + size)).reshape(count, -1)
            left -= count
            physical = np.abs(table[:, before]) if tags else np.zeros(count, dtype=np.int64)
            found.blocks.append((kind, table[:, 0], table[:, before + tags:], physical))
    else:
        numbers = _Numbers(found, section, raw, start, np.int64)
        early = found.version == "4.0"
        blocks, total = numbers.take("n", 2 if early else 4)[:2].tolist()
        for _ in range(blocks):
            dimension, tag, kind = numbers.take("i", 3).tolist()
            dimension, tag = (tag, dimension) if early else (dimension, tag)
            count, size = numbers.one("n"), _size(found, kind)
            table = numbers.take("i" if early else "n", count * (1 + size)).reshape(count, 1 + size)
            if dimension != _KINDS[kind][2]:
                raise found.wrong(f"a {_KINDS[kind][0]} belongs to an entity of dimension {dimension}")
            if found.entities and (dimension, tag) not in found.entities:
                raise found.wrong(f"$Elements names the {BODIES[dimension]} {tag}, which $Entities does not give")
            found.blocks.append((kind, table[:, 0], table[:, 1:], found.entities.get((dimension, tag), [])))
    if sum(len(block[1]) for block in found.blocks) != total:
        raise found.wrong(f"$Elements has {sum(len(block[1]) for block in found.blocks)} elements, but says {total}")
    return numbers.done()


def _size(found: _Found, kind: int) -> int:
    if kind not in _KINDS:
        raise found.wrong(f"elements of Gmsh's type {kind} (of third order or above, or none) are not read")
    return _KINDS[kind][1]


def _data(found: _Found, section: str, raw: bytes, start: int) -> int:
    """$NodeData and $ElementData of `write_mesh`; those of other programs are skipped."""
    found.sections += 1
    place, lists = start, list[list[str]]()
    for _ in range(3):  # names, real numbers (time), whole numbers (step, components, rows)
        place, word = _line(found, section, raw, place)
        if not word.isdecimal() or len(word) > 6:
            raise found.wrong(f"${section} has the count {word[:20]!r}")
        lists.append([])
        for _ in range(int(word)):
            place, line = _line(found, section, raw, place)
            lists[-1].append(line)
    name = lists[0][0].strip('"') if lists[0] else ""
    if not name.startswith(("set:", "group:", "number")):
        if found.announced is not None and lists[2][1:2] == ["1"]:  # as the mark of a set in a file of femsub
            found.notes.append(f"the data {name!r:.60} are neither a set:NAME nor a group:NAME: left out")
        return _skipped(found, section, raw, place)
    if len(lists[2]) < 3 or lists[2][1] != "1" or not lists[2][2].isdecimal():
        raise found.wrong(f"${section} {name!r} must have one number for each row, but does not")
    numbers, count = _Numbers(found, section, raw, place), int(lists[2][2])
    (found.point_data if section == "NodeData" else found.cell_data)[name] = numbers.rows(count, 1)
    return numbers.done()


def _line(found: _Found, section: str, raw: bytes, start: int) -> tuple[int, str]:
    end = raw.find(b"\n", start)
    if end < 0:
        raise found.wrong(f"${section} does not end: is it cut short?")
    return end + 1, raw[start:end].decode("utf-8", "replace").strip()


_SECTIONS = {"MeshFormat": _format, "PhysicalNames": _names, "Entities": _entities, "Nodes": _nodes, "Elements": _elements,
             "NodeData": _data, "ElementData": _data, "Comments": _comments}
