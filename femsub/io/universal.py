"""Universal files of I-deas (.unv, .uff): nodes, elements and groups, as Salome, Simcenter, NX and test benches write them.

pyuff reads these too. But it stops at elements of more than eight nodes, whose nodes stand on several lines.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from femsub.checks import Array
from femsub.errors import InputError
from femsub.io.mesh_text import as_numbers, once, rows_of, text_of

NODES, OLD_NODES, ELEMENTS, SYSTEMS = 2411, 15, 2412, (18, 2420)
GROUPS = (2435, 2452, 2467, 2477)
BEAMS = (11, 21, 22, 23, 24)  # elements with a line more, of orientation and sections
NODE, ELEMENT = 7, 8  # kinds of members of a group
#: number of the element's type: kind, and at which of our nodes each of theirs is (they go around the bottom, up, around the top)
_CELLS: dict[int, tuple[str, list[int]]] = {
    **dict.fromkeys((11, 21, 22, 23), ("line", [0, 1])), **dict.fromkeys((24,), ("line3", [0, 2, 1])),
    **dict.fromkeys((41, 51, 61, 81, 91), ("triangle", [0, 1, 2])),
    **dict.fromkeys((42, 52, 62, 82, 92), ("triangle6", [0, 3, 1, 4, 2, 5])),
    **dict.fromkeys((44, 54, 64, 84, 94), ("quad", [0, 1, 2, 3])),
    **dict.fromkeys((45, 55, 65, 85, 95), ("quad8", [0, 4, 1, 5, 2, 6, 3, 7])),
    111: ("tetra", [0, 1, 2, 3]), 118: ("tetra10", [0, 4, 1, 5, 2, 6, 7, 8, 9, 3]),
    112: ("wedge", [0, 1, 2, 3, 4, 5]), 113: ("wedge15", [0, 6, 1, 7, 2, 8, 12, 13, 14, 3, 9, 4, 10, 5, 11]),
    115: ("hexahedron", [0, 1, 2, 3, 4, 5, 6, 7]),
    116: ("hexahedron20", [0, 8, 1, 9, 2, 10, 3, 11, 16, 17, 18, 19, 4, 12, 5, 13, 6, 14, 7, 15])}


def is_universal(head: bytes) -> bool:
    """Whether a file's beginning is that of a universal file: a line -1, then the number of a data set."""
    return re.match(rb"\s*-1[ \t]*\r?\n[ \t]*\d{1,4}b?\b", head) is not None


def read_universal(path: Path) -> tuple[Any, list[str]]:
    """A meshio.Mesh with `points_id`, `cells_id` and the groups as sets, and what was skipped.

    ==============  ==========================================================================================================
    reads           nodes (2411, 15), elements (2412) with straight and curved edges, groups (2467, 2477, 2452, 2435)
    skips, tells    other data sets, elements that are no cells, members of groups that are neither nodes nor elements
    refuses         nodes in a coordinate system that is turned or moved (18, 2420), nodes and elements given twice, an
                    element of the wrong number of nodes, binary data sets (58b), a data set without its end
    cannot know     whether nodes or elements are missing between two others: the format counts nothing. The unit of
                    length: coordinates are not converted
    ==============  ==========================================================================================================

    Raises
    ------
    InputError
        What is refused, by data set and number.
    """
    import meshio

    nodes, elements = dict[int, tuple[int, list[str]]](), dict[int, list[tuple[int, list[int]]]]()
    groups, turned, notes = dict[str, list[tuple[int, int]]](), set[int](), Counter[str]()
    for kind, lines in _data_sets(path):
        if kind in (NODES, OLD_NODES):
            for number, system, place in _nodes(path, kind, lines):
                if number in nodes:
                    raise InputError(f"{path} gives the node {number} twice")
                nodes[number] = system, place
        elif kind == ELEMENTS:
            for number, type_, corners in _elements(path, lines):
                elements.setdefault(type_, []).append((number, corners))
        elif kind in GROUPS:
            for name, members in _groups(path, kind, lines):
                groups[name] = [*groups.get(name, []), *members]
        elif kind in SYSTEMS:
            turned |= _turned(path, kind, lines)
        else:
            notes[f"data set {kind} skipped"] += 1
    if not nodes or not elements:
        raise InputError(f"{path} has {len(nodes)} nodes (data sets 2411, 15) and {len(elements)} types of elements (2412)")
    if used := {system for system, _ in nodes.values()} & turned:
        raise InputError(f"{path} has nodes in the coordinate system {min(used)}, which is turned or moved: write "
                         "it in the global one")
    numbers = np.array(list(nodes), dtype=np.int64)
    order = np.argsort(numbers)
    points = as_numbers(f"{path}: the coordinates of nodes", " ".join(" ".join(place) for _, place in nodes.values()), float)
    if len(points) != 3 * len(numbers):
        raise InputError(f"{path}: the coordinates of nodes are not three numbers each")
    once(path, "elements", np.array([number for some in elements.values() for number, _ in some], dtype=np.int64))
    cells, ids = [], []
    for type_, some in elements.items():
        if type_ not in _CELLS:
            notes[f"{len(some)} element{'s' * (len(some) != 1)} of the type {type_} skipped"] += 1
            continue
        name, where = _CELLS[type_]
        if wrong := [number for number, members in some if len(members) != len(where)]:
            raise InputError(f"{path}: element {wrong[0]} of the type {type_} has not {len(where)} nodes")
        table = np.array([members for _, members in some], dtype=np.int64)[:, np.argsort(where)]
        cells.append((name, order[rows_of(path, f"a {name} element", "node", numbers[order], table)]))
        ids.append(np.array([number for number, _ in some], dtype=np.int64))
    points_in, cells_in = {}, {}
    for name, members in groups.items():
        of_nodes, of_cells = ([number for kind, number in members if kind == wanted] for wanted in (NODE, ELEMENT))
        if of_nodes:
            points_in[name] = np.flatnonzero(np.isin(numbers, of_nodes))
        if of_cells:
            cells_in[name] = [np.flatnonzero(np.isin(part, of_cells)) for part in ids]
        if other := len(members) - len(of_nodes) - len(of_cells):
            notes[f"{other} members of the group {name} are neither nodes nor elements: skipped"] += 1
    mesh = meshio.Mesh(points.reshape(-1, 3), cells, point_sets=points_in, cell_sets=cells_in)
    mesh.points_id, mesh.cells_id = numbers, ids
    return mesh, [f"{text} ({count} times)" if count > 1 else text for text, count in notes.items()]


def _data_sets(path: Path) -> Iterator[tuple[int, list[str]]]:
    """The number of each data set and its lines."""
    lines = text_of(path).split("\n")
    ends = [at for at, line in enumerate(lines) if line.strip() == "-1"]
    if len(ends) % 2 or not ends:
        raise InputError(f"{path} has a data set without its end, a line -1: it is cut short, or holds binary data")
    for begin, end in zip(ends[::2], ends[1::2], strict=True):
        head = lines[begin + 1].split() if end > begin + 1 else []
        if not head or not re.fullmatch("[0-9]{1,4}", head[0]):
            raise InputError(f"{path}, line {begin + 2}: {lines[begin + 1]!r:.40} is not the number of a data set in text")
        yield int(head[0]), lines[begin + 2:end]


def _whole(path: Path, what: str, words: list[str]) -> list[int]:
    bad = [word for word in words if not re.fullmatch("-?[0-9]{1,15}", word)]
    if bad:
        raise InputError(f"{path}: {bad[0]!r:.30} in {what} is not a whole number")
    return [int(word) for word in words]


def _nodes(path: Path, kind: int, lines: list[str]) -> Iterator[tuple[int, int, list[str]]]:
    """Number, coordinate system and place of each node: on two lines, in the old data set on one."""
    per = 2 if kind == NODES else 1
    if len(lines) % per:
        raise InputError(f"{path}: the last node of data set {kind} has no coordinates")
    for start in range(0, len(lines), per):
        words = " ".join(lines[start:start + per]).split()
        if len(words) != 7:
            raise InputError(f"{path}: {lines[start].strip()!r:.60} and its coordinates should be seven numbers (data set "
                             f"{kind})")
        number, system, *_ = _whole(path, f"data set {kind}", words[:4])
        if number < 1:
            raise InputError(f"{path}: a node has the number {number}; they count from 1")
        yield number, system, words[4:]


def _elements(path: Path, lines: list[str]) -> Iterator[tuple[int, int, list[int]]]:
    """Number, type and nodes of each element; the nodes are eight on a line."""
    at = 0
    while at < len(lines):
        head = _whole(path, "data set 2412", lines[at].split())
        if len(head) != 6 or head[5] < 1 or head[0] < 1:
            raise InputError(f"{path}: {lines[at].strip()!r:.60} is no head of an element (data set 2412)")
        at += 2 if head[1] in BEAMS else 1
        words: list[str] = []
        while len(words) < head[5] and at < len(lines):
            words, at = [*words, *lines[at].split()], at + 1
        if len(words) != head[5]:
            raise InputError(f"{path}: element {head[0]} announces {head[5]} nodes, but has {len(words)}")
        yield head[0], head[1], _whole(path, f"element {head[0]}", words)


def _groups(path: Path, kind: int, lines: list[str]) -> Iterator[tuple[str, list[tuple[int, int]]]]:
    """Name and members (kind, number) of each group; two members of four numbers on a line."""
    at = 0
    while at < len(lines):
        head = _whole(path, f"data set {kind}", lines[at].split())
        name = lines[at + 1].strip() if at + 1 < len(lines) else ""
        if len(head) < 2 or not 0 <= head[-1] < 10 ** 9 or not name:
            raise InputError(f"{path}: {lines[at].strip()!r:.60} is no head of a group (data set {kind})")
        stop = at + 2 + (head[-1] + 1) // 2
        words = _whole(path, f"the group {name}", " ".join(lines[at + 2:stop]).split())
        if len(words) != 4 * head[-1]:
            raise InputError(f"{path}: the group {name} announces {head[-1]} members, but has {len(words) / 4:g}")
        yield name, list(zip(words[::4], words[1::4], strict=True))
        at = stop


def _turned(path: Path, kind: int, lines: list[str]) -> set[int]:
    """Coordinate systems that are not the global one: of another type, turned or moved."""
    found: set[int] = set()
    if kind == SYSTEMS[0]:  # heads of five numbers and a name, then origin, a point on x and one in the plane of x and z
        for start in range(0, len(lines), 4):
            number, type_ = [*_whole(path, "data set 18", lines[start].split()[:2]), 0, 0][:2]
            words = " ".join(lines[start + 2:start + 4]).split()
            place = as_numbers(f"{path}: data set 18", " ".join(words), float)
            same = len(place) == 9 and not place[:3].any() and place[3] > 0 and not place[4:6].any() and place[8] > 0 \
                and not place[7]
            found |= set() if same and type_ == 0 else {number}
        return found
    for start in range(2, len(lines), 6):  # behind number and name of the part: head, name, and four lines of the matrix
        number, type_ = [*_whole(path, "data set 2420", lines[start].split()[:2]), 0, 0][:2]
        matrix: Array = as_numbers(f"{path}: data set 2420", " ".join(lines[start + 2:start + 6]), float)
        same = len(matrix) == 12 and np.allclose(matrix.reshape(4, 3)[:3], np.eye(3)) and not matrix[9:].any()
        found |= set() if same and type_ == 0 else {number}
    return found
