"""Ansys' archives (.cdb, and the .dat of Workbench): nodes, elements and components in blocks of text (CDWRITE).

PyAnsys reads these, too. But its compiled part ends the process at damaged files, or reads nonsense as numbers, and it needs VTK.
"""

from __future__ import annotations

import re
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from femsub.checks import Array, InputError
from femsub.io.damage import MOST, check_end
from femsub.io.mesh_text import as_numbers, meshed, once, text_of, whole

#: fields of an element in EBLOCK before its nodes
FIELDS = ("material", "type", "real constant", "section", "coordinate system", "birth", "solid model", "shape", "nodes",
          "not used", "number")
_COMMAND = re.compile(r"(?i)[ \t]*(NBLOCK|EBLOCK|CMBLOCK|ETBLOCK|ET|KEYOPT?|CSYS|LOCAL|CLOCAL|CSWPLA|CS|N|EN?)[ \t]*,")
#: families of element types by their numbers; others are no cells: contact, masses, springs, loads on surfaces
_FAMILIES = {
    "brick": {5, 45, 46, 62, 64, 65, 69, 70, 73, 89, 90, 95, 96, 97, 107, 122, 185, 186, 190, 191, 225, 226, 231, 236, 278, 279},
    "tetra": {72, 87, 92, 98, 123, 127, 187, 227, 232, 237, 285},
    "face": {13, 25, 28, 41, 42, 43, 53, 55, 57, 63, 67, 75, 77, 78, 82, 83, 91, 93, 99, 121, 131, 132, 143, 157, 181, 182, 183,
             223, 230, 233, 238, 281},
    "triangle": {2, 35}, "line": {1, 3, 4, 8, 10, 16, 20, 23, 24, 33, 44, 54, 180, 188, 288}, "curve": {189, 289}}
#: elements whose family depends on the first of their key options: MESH200
_MESHES = {200: {0: "line", 1: "curve", 2: "line", 3: "curve", 4: "triangle", 5: "triangle", 6: "face", 7: "face", 8: "tetra",
                 9: "tetra", 10: "brick", 11: "brick"}}
_FAMILY = {number: family for family, numbers in _FAMILIES.items() for number in numbers}
#: for each family: pairs of equal nodes; the cells with straight and with curved edges, and their nodes' places in the element
_FORMS: dict[str, list[tuple[tuple[tuple[int, int], ...], tuple[str, list[int]], tuple[str, list[int]]]]] = {
    "brick": [(((2, 3), (4, 5), (4, 6), (4, 7)), ("tetra", [0, 1, 2, 4]), ("tetra10", [0, 1, 2, 4, 8, 9, 11, 16, 17, 18])),
              (((4, 5), (4, 6), (4, 7)), ("pyramid", [0, 1, 2, 3, 4]), ("pyramid13", [*range(5), *range(8, 12), *range(16, 20)])),
              (((2, 3), (6, 7)), ("wedge", [0, 1, 2, 4, 5, 6]),
               ("wedge15", [0, 1, 2, 4, 5, 6, 8, 9, 11, 12, 13, 15, 16, 17, 18])),
              ((), ("hexahedron", [*range(8)]), ("hexahedron20", [*range(20)]))],
    "tetra": [((), ("tetra", [*range(4)]), ("tetra10", [*range(10)]))],
    "face": [(((2, 3),), ("triangle", [0, 1, 2]), ("triangle6", [0, 1, 2, 4, 5, 7])),
             ((), ("quad", [*range(4)]), ("quad8", [*range(8)]))],
    "triangle": [((), ("triangle", [*range(3)]), ("triangle6", [*range(6)]))],
    "line": [((), ("line", [0, 1]), ("line", [0, 1]))], "curve": [((), ("line", [0, 1]), ("line3", [0, 1, 2]))]}


def read_cdb(path: Path) -> tuple[Any, list[str]]:
    """A meshio.Mesh with `points_id`, `cells_id`, components as sets and, if there are several, materials as groups.

    ==============  ==========================================================================================================
    reads           NBLOCK, EBLOCK of solids, planes, shells, beams and MESH200 with their degenerate forms, straight and curved
                    edges, ET, ETBLOCK, KEYOPT, CMBLOCK of nodes and elements
    skips, reports  elements of other types (contact, masses, loads on surfaces), blocks that are not SOLID, frames of nodes,
                    which matter to motions alone
    refuses         nodes in another coordinate system than the global one (CSYS, LOCAL), nodes or elements that come by the
                    commands N and E, numbers given twice, elements without some of their nodes in the middle of edges, a block
                    without its end or with another count than it announces
    cannot know     units; components of components (CMGRP) are passed over
    ==============  ==========================================================================================================

    Raises
    ------
    InputError
        What is refused, by command and number.
    """
    check_end(path, last_words=("FINI", "FINISH", "/GO", "/EOF", "SAVE", "SOLVE"))
    deck = _Archive(path)
    if not deck.numbers or not deck.elements:
        count = sum(map(len, deck.elements.values()))
        raise InputError(f"{path} has {len(deck.numbers)} nodes in NBLOCK and {count} elements in EBLOCK"
                         f"{''.join(f'; {note}' for note in deck.notes)}. Write it with CDWRITE,DB")
    numbers, notes = np.array(deck.numbers, dtype=np.int64), deck.notes
    once(path, "elements", np.array([one.number for some in deck.elements.values() for one in some], dtype=np.int64))
    # cells of each family's forms, their nodes in meshio's order
    blocks, materials = [], dict[int, list[int]]()
    for (kind, count), some in deck.elements.items():
        number = deck.types.get(kind)
        family = _MESHES[number].get(deck.options.get(kind, 0)) if number in _MESHES else _FAMILY.get(number or 0)
        if family is None:
            known = f"type {number}" if number else f"type number {kind}, which no ET defines"
            notes[f"{len(some)} element{'s' * (len(some) != 1)} of {known} skipped"] += 1
            continue
        family = "triangle" if family == "face" and count in (3, 6) else family
        table = np.zeros((len(some), max(count, 20)), dtype=np.int64)
        table[:, :count] = [one.nodes for one in some]
        left = np.ones(len(some), dtype=bool)
        for same, straight, curved in _FORMS[family]:
            mine = left & np.all([table[:, one] == table[:, other] for one, other in same] or [left], axis=0)
            left &= ~mine
            between = table[:, curved[1][len(straight[1]):]]
            if (wrong := np.flatnonzero(mine & ((between != 0).any(axis=1) & (between == 0).any(axis=1)))).size:
                raise InputError(f"{path}: element {some[wrong[0]].number} lacks some of its nodes in the middle of edges; "
                                 "add them (EMID)")
            bent = mine & (between != 0).any(axis=1)
            for rows, (name, places) in ((mine & ~bent, straight), (bent, curved)):
                if rows.any():
                    taken = [some[at] for at in np.flatnonzero(rows)]
                    blocks.append((name, np.array([one.number for one in taken], dtype=np.int64), table[rows][:, places]))
                    for one in taken:
                        materials.setdefault(one.material, []).append(one.number)
    # components as sets, materials as groups
    if not blocks:
        raise InputError(f"{path} has no elements that are cells: {'; '.join(notes)}")
    groups = {f"material-{number}": materials[number] for number in sorted(materials) if len(materials) > 1}
    mesh = meshed(path, numbers, np.concatenate(deck.points), blocks, deck.components["NODE"], deck.components["ELEM"] | groups)
    return mesh, [f"{text} ({count} times)" if count > 1 else text for text, count in notes.items()]


class _Element(NamedTuple):
    number: int
    material: int
    nodes: list[int]


class _Archive:
    """The blocks of an archive."""

    def __init__(self, path: Path) -> None:
        self.path, self.lines, self.at = path, text_of(path).split("\n"), 0
        self.numbers, self.points = list[int](), list[Array]()
        self.elements = dict[tuple[int, int], list[_Element]]()  # by type in this file, and count of nodes
        self.types, self.options = dict[int, int](), dict[int, int]()
        self.components: dict[str, dict[str, list[int]]] = {"NODE": {}, "ELEM": {}}
        self.system, self.notes = "0", Counter[str]()
        while self.at < len(self.lines):
            line = self.lines[self.at]
            self.at += 1
            above = self.lines[self.at - 2].strip() if self.at > 1 else ""
            if re.match(r"[ \t]*\(\d*[iIeE]\d", line) and not re.match(r"(?i)[A-Z]*BLOCK\b|\*|\(|/|!|$", above):
                raise InputError(f"{self.path}, line {self.at}: the format {line.strip()!r:.40} is below {above!r:.40}: the "
                                 "command of its block is lost")
            found = _COMMAND.match(line)
            if found is None:
                continue
            command, words = found[1].upper(), [word.strip() for word in line.split("!")[0].split("$")[0].split(",")] + [""] * 6
            if command == "NBLOCK":
                self._nodes(words)
            elif command == "EBLOCK" and words[2].upper() == "SOLID":
                self._elements(words)
            elif command == "EBLOCK":
                self.notes["a block of elements that is not SOLID skipped"] += 1
            elif command == "CMBLOCK":
                self._component(words)
            elif command == "ETBLOCK":
                for row in self._block("ETBLOCK"):
                    number, kind = whole(self.path, "ETBLOCK", [field.strip() for field in row[:2]])
                    self.types[number] = kind
            elif command == "ET" and (named := re.fullmatch(r"(\d{1,6}),[A-Za-z]*(\d{1,4})", ",".join(words[1:3]))):
                self.types[int(named[1])] = int(named[2])
            elif command.startswith("KEYOP") and words[2] == "1" and re.fullmatch(r"\d{1,6},\d{1,4}", f"{words[1]},{words[3]}"):
                self.options[int(words[1])] = int(words[3])
            elif command == "CSYS":
                self.system = words[1] or "0"
            elif command in ("LOCAL", "CS", "CLOCAL", "CSWPLA"):
                self.system = f"of {command}"
            elif command in ("N", "E", "EN") and "-1" not in words:
                self.notes[f"{'node' if command == 'N' else 'element'} by the command {command} skipped"] += 1

    def _block(self, what: str, count: int | None = None) -> list[list[str]]:
        """The fields of a block's lines, cut by its format, as (3i9,6e21.13e3), up to its end or `count` lines."""
        form = self.lines[self.at].strip() if self.at < len(self.lines) else ""
        parts = re.findall(r"((?<!\d)\d++|)[ieaEIA](\d++)(?:\.\d++(?:[eE]\d++)?)?", form)
        widths = [int(width[:3]) for times, width in parts for _ in range(min(int(times.lstrip("0")[:9] or 1), 1000))]
        if not re.fullmatch(r"\([\w.,\s]+\)", form) or not widths or not min(widths):
            raise InputError(f"{self.path}, line {self.at + 1}: {form!r:.40} is not the format of the block {what}")
        ends, rows = np.cumsum([0, *widths]).tolist(), list[list[str]]()
        self.at += 1
        while count is None or len(rows) < count:
            if self.at >= len(self.lines):
                raise InputError(f"{self.path} ends inside of {what}: is it cut short?")
            line = self.lines[self.at].rstrip()
            if count is None and _COMMAND.match(line):
                break
            self.at += 1
            if count is None and line.strip() == "-1":
                break
            if not 0 < len(line) <= ends[-1]:
                raise InputError(f"{self.path}, line {self.at}: {line[:40]!r} is empty, or longer than the format of {what} says")
            rows.append([line[start:stop] for start, stop in pairwise(ends) if start < len(line)])
        return rows

    def _nodes(self, words: list[str]) -> None:
        if self.system != "0":
            raise InputError(f"{self.path} has nodes in the coordinate system {self.system}; write it in the global one (CSYS,0)")
        form = self.lines[self.at] if self.at < len(self.lines) else ""
        leading = re.match(r"\s*\((?:(\d{0,3})[iI]\d+,)(?:(\d{0,3})[iI]\d+,)?", form)
        rows = self._block("NBLOCK")
        first = sum(int(times or 1) for times in leading.groups() if times is not None) if leading else 1
        self._counted("NBLOCK", words[4], len(rows))
        self.numbers += whole(self.path, "NBLOCK", [row[0].strip() for row in rows])
        whole(self.path, "NBLOCK", [field.strip() or "0" for row in rows for field in row[1:first]])  # solid and line of a node
        places = np.array([(row[first:] + [""] * 6)[:6] for row in rows], dtype=object).reshape(-1, 6)
        text = " ".join(field if field.strip() else "0" for field in places.ravel())
        values = as_numbers(f"{self.path}: the coordinates of nodes", text, float)
        if len(values) != places.size or not np.isfinite(values).all() or min(self.numbers, default=1) < 1:
            raise InputError(f"{self.path}: the nodes of an NBLOCK are not a number from 1 and coordinates each")
        table = values.reshape(-1, 6)
        self.points.append(table[:, :3])
        if own := int(np.count_nonzero(table[:, 3:].any(axis=1))):
            self.notes[f"{own} nodes have a frame of their own, which the mesh leaves out"] += 1

    def _elements(self, words: list[str]) -> None:
        rows = self._block("EBLOCK")
        at, before = 0, sum(map(len, self.elements.values()))
        while at < len(rows):
            listed = whole(self.path, "EBLOCK", [field.strip() for field in rows[at]])
            head, nodes = dict(zip(FIELDS, listed, strict=False)), listed[len(FIELDS):]
            at += 1
            if len(listed) < len(FIELDS) or head["nodes"] < 1 or head["number"] < 1:
                raise InputError(f"{self.path}: {''.join(rows[at - 1]).strip()!r:.60} is no element of an EBLOCK")
            number, count = head["number"], head["nodes"]
            while len(nodes) < count and at < len(rows) and len(nodes) >= 8:
                nodes += whole(self.path, f"element {number}", [field.strip() for field in rows[at]])
                at += 1
            if len(nodes) != count:
                raise InputError(f"{self.path}: element {number} announces {count} nodes, but has {len(nodes)}")
            self.elements.setdefault((head["type"], count), []).append(_Element(number, head["material"], nodes))
        self._counted("EBLOCK", words[4], sum(map(len, self.elements.values())) - before)

    def _component(self, words: list[str]) -> None:
        name, kind = words[1], words[2].upper()
        count = whole(self.path, f"the component {name}", [words[3]])[0]
        form = self.lines[self.at] if self.at < len(self.lines) else ""
        width = re.match(r"\s*\((\d{1,9})[iI]\d+\)", form)
        per = max(int(width[1]), 1) if width else 8
        rows = self._block(f"the component {name}", -(-count // per))
        listed = whole(self.path, f"the component {name}", [field.strip() for row in rows for field in row])
        if len(listed) != count or (listed and listed[0] < 0):
            raise InputError(f"{self.path}: the component {name} announces {count} numbers, but has {len(listed)}")
        if kind not in self.components:
            self.notes[f"the component {name} of {kind} skipped"] += 1
            return
        members = self.components[kind].setdefault(name, [])
        for one in listed:  # a negative number is the end of a range
            if one < 0 and (members[-1] > -one or len(members) - one - members[-1] > MOST):
                raise InputError(f"{self.path}: the component {name} goes from {members[-1]} to {-one}")
            members += range(members[-1] + 1, 1 - one) if one < 0 else [one]

    def _counted(self, what: str, announced: str, found: int) -> None:
        if announced.isdecimal() and (announced.lstrip("0") or "0") != str(found):
            raise InputError(f"{self.path}: {what} announces {announced:.30} entries, but has {found}: is it cut short?")
