"""Universal files of I-deas (.unv, .uff): their data sets, in text and binary, and the meshes in them.

Salome, Simcenter, NX and test benches write them. pyuff reads them, too. But it stops at elements of more than eight nodes and at
complex shapes of six values, which stand on several lines, and it passes over a data set without an end.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from enum import IntEnum
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from femsub.checks import Array, InputError
from femsub.io.mesh_text import as_numbers, meshed, text_of, whole


class Sets(IntEnum):
    """The data sets that are read, by their numbers in I-deas."""

    NODES_SINGLE = 15
    COORDINATE_SYSTEMS = 18
    DATA_AT_NODES = 55
    FUNCTION = 58
    TRACE_LINES = 82
    HEADER = 151
    UNITS = 164
    NODES = 2411
    ELEMENTS = 2412
    ANALYSIS_DATA = 2414
    EXPORT_SYSTEMS = 2420  # the nodes of 2411 do not need them


class Member(IntEnum):
    """Kinds of members of a group."""

    NODE = 7
    ELEMENT = 8


GROUPS = (2435, 2452, 2467, 2477)  # data sets of permanent groups, of different versions
OF_MODES = (Sets.DATA_AT_NODES, Sets.FUNCTION, Sets.ANALYSIS_DATA)
OF_MESHES = (*(kind for kind in Sets if kind not in OF_MODES), *GROUPS)
BEAMS = (11, 21, 22, 23, 24)  # elements with an additional line, of orientation and sections
#: by type of a function's values: their numbers in binary, and how many numbers a value has
NUMBERS = {2: ("f4", 1), 4: ("f8", 1), 5: ("f4", 2), 6: ("f8", 2)}
#: the beginning of a binary data set: its number, then order of bytes, kind of numbers, lines of text and bytes behind them
_BINARY = re.compile(rb"(?m)^([ \t]*)-1[ \t]*(\r?\n)[ \t]*(\d{1,4})b([ \t\d]*)\r?\n")
_HEADS = {Sets.ELEMENTS: "an element", Sets.TRACE_LINES: "a trace line", **dict.fromkeys(GROUPS, "a group")}
#: number of the element's type: kind of cell, and the place in our order of each node in theirs (around the bottom, up, the top)
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


class DataSet(NamedTuple):
    """The number of a data set, its lines, and the bytes behind them if it is binary, with their order, < or >."""

    kind: int
    lines: list[str]
    values: bytes | None = None
    order: str = "<"


def read_universal(path: Path) -> tuple[Any, list[str]]:
    """A meshio.Mesh with `points_id`, `cells_id` and the groups as sets, and what was skipped.

    ==============  ==========================================================================================================
    reads           nodes (2411, 15), elements (2412) with straight and curved edges, groups (2467, 2477, 2452, 2435); where there
                    are no elements, the trace lines of a test model (82) as lines with a group for each
    reports         who wrote it (151), units (164): nothing is converted
    skips, reports  other data sets, elements that are no cells, members of groups that are neither nodes nor elements
    refuses         nodes (15) whose coordinates are in a system that is turned or moved (18), nodes and elements given twice, an
                    element of the wrong number of nodes, a data set without its end
    cannot know     whether nodes or elements are missing between two others: the format counts nothing. The unit of
                    length: coordinates are not converted
    ==============  ==========================================================================================================

    Nodes of the data set 2411 are in the frame of the part, whatever system they name for export.

    Raises
    ------
    InputError
        What is refused, by data set and number.
    """
    elements = dict[int, list[tuple[int, list[int]]]]()
    groups, traces, notes = dict[str, list[tuple[int, int]]](), dict[str, list[list[int]]](), Counter[str]()
    parts = list(data_sets(path))
    for kind, lines, *_ in parts:
        at = 0 if kind in (Sets.ELEMENTS, Sets.TRACE_LINES, *GROUPS) else len(lines)
        while at < len(lines):
            head = whole(path, f"data set {kind}", lines[at].split())
            name, words = lines[at + 1].strip() if at + 1 < len(lines) else "", list[str]()
            if kind == Sets.ELEMENTS:  # number, type, ..., count of nodes; some have a line more; eight nodes on a line
                sound, count_at, skip = len(head) == 6 and head[5] > 0 and head[0] > 0, -1, 1 + any(n in BEAMS for n in head[1:2])
            elif kind == Sets.TRACE_LINES:  # number, count of nodes, color; a name; eight nodes on a line
                sound, count_at, skip = len(head) > 1 and head[1] > 0 and at + 1 < len(lines), 1, 2
            else:  # number, ..., count of members; a name; two members of four numbers on a line
                sound, count_at, skip = len(head) > 1 and 0 <= head[-1] < 10 ** 9 and name != "", -1, 2
            if not sound:
                raise InputError(f"{path}: {lines[at].strip()!r:.60} is no head of {_HEADS[kind]} (data set {kind})")
            name = name or f"trace-{head[0]}"
            what = f"element {head[0]}" if kind == Sets.ELEMENTS else f"{_HEADS[kind].replace('a ', 'the ')} {name}"
            per = 4 if kind in GROUPS else 1
            count, at = per * head[count_at], at + skip
            while len(words) < count and at < len(lines):
                words += lines[at].split()
                at += 1
            listed = whole(path, what, words)
            if len(listed) < count or any(listed[count:]):  # the last line may be filled up with 0
                raise InputError(f"{path}: {what} announces {count // per} {'members' if per == 4 else 'nodes'}, but has "
                                 f"{len(listed) / per:g}")
            if kind == Sets.ELEMENTS:
                elements.setdefault(head[1], []).append((head[0], listed[:count]))
            elif kind == Sets.TRACE_LINES:  # a 0 interrupts the line
                traces.setdefault(name, []).extend([one, other] for one, other in pairwise(listed[:count])
                                                   if one and other and one != other)
            else:
                groups.setdefault(name, []).extend(zip(listed[:count:4], listed[1:count:4], strict=True))
        if kind not in OF_MESHES:
            notes[f"data set {kind} skipped"] += 1
    notes.update(origin_of(parts))
    numbers, points = nodes_of(path, parts)
    if not len(numbers) or not (elements or traces):
        raise InputError(f"{path} has {len(numbers)} nodes (data sets 2411, 15), {len(elements)} types of elements (2412) and "
                         f"{len(traces)} trace lines (82)")
    blocks = []
    for type_, some in elements.items():
        if type_ not in _CELLS:
            notes[f"{len(some)} element{'s' * (len(some) != 1)} of the type {type_} skipped"] += 1
            continue
        name, where = _CELLS[type_]
        if wrong := [number for number, members in some if len(members) != len(where)]:
            raise InputError(f"{path}: element {wrong[0]} of the type {type_} has not {len(where)} nodes")
        table = np.array([members for _, members in some], dtype=np.int64)[:, np.argsort(where)]
        blocks.append((name, np.array([number for number, _ in some], dtype=np.int64), table))
    if traces and elements:
        notes[f"{len(traces)} trace line{'s' * (len(traces) != 1)} skipped"] += 1
    elif traces:
        pairs = [(name, pair) for name, line in traces.items() for pair in line]
        for number, (name, _) in enumerate(pairs, 1):
            groups.setdefault(name, []).append((Member.ELEMENT, number))
        blocks = [("line", np.arange(1, len(pairs) + 1), np.array([pair for _, pair in pairs], dtype=np.int64).reshape(-1, 2))]
    sets: dict[Member, dict[str, list[int]]] = {kind: {} for kind in Member}
    for name, members in groups.items():
        if other := [kind for kind, _ in members if kind not in [*Member]]:
            notes[f"{len(other)} members of the group {name} are neither nodes nor elements: skipped"] += 1
        for kind in Member:
            if chosen := [number for sort, number in members if sort == kind]:
                sets[kind][name] = chosen
    mesh = meshed(path, numbers, points, blocks, sets[Member.NODE], sets[Member.ELEMENT])
    return mesh, [f"{text} ({count} times)" if count > 1 else text for text, count in notes.items()]


def data_sets(path: Path) -> Iterator[DataSet]:
    """The data sets of a universal file, one after the other.

    Raises
    ------
    InputError
        A data set without its end, or without its number.
    """
    raw, at = path.read_bytes(), 0
    parts, values = list[bytes](), list[tuple[bytes, str]]()
    while (head := _BINARY.search(raw, at)) is not None:
        words = [int(word[:18]) for word in head[4].split()]
        start = head.end()
        for _ in range(min(words[2], 100) if len(words) > 3 else 0):
            start = raw.find(b"\n", start) + 1 or len(raw)
        # two numbers of bytes are tried: that in the head, and for a data set 58 that of its count of values, since pyuff writes
        # too small a number for complex values
        sizes, size, counts = words[3:4], 0, (b"\n".join(raw[head.end():start].split(b"\n")[6:7]).split() + [b"0"] * 3)[:3]
        if sizes and all(re.fullmatch(rb"\d{1,12}", word) for word in counts):
            kind_, count, even = map(int, counts)
            name, width = NUMBERS.get(kind_, ("f4", 1))
            size = count * (width + (even == 0)) * int(name[1])
        sizes += [size] * len(sizes)
        stops = [start + size for size in sizes if _closes(raw, start + size, head[1], head[2])]
        if not stops:
            raise InputError(f"{path}: a binary data set {head[3].decode()}b does not end where it says: it is damaged")
        stop = stops[0]
        parts, at = [*parts, raw[at:start], b"\n"], stop
        values.append((raw[start:stop], ">" if words[0] == 2 else "<"))
    lines = text_of(path, b"".join([*parts, raw[at:]]) if parts else raw).split("\n")
    ends = [at for at, line in enumerate(lines) if line.strip() == "-1"]
    if len(ends) % 2 or not ends:
        raise InputError(f"{path} has a data set without its end, a line -1: it is cut short or damaged")
    if stray := [at for at in range(ends[-1] + 1, len(lines)) if lines[at].strip(" \t\x1a\0")]:  # these may fill up a file
        raise InputError(f"{path}, line {stray[0] + 1}: {lines[stray[0]].strip()!r:.40} is in no data set: the line -1 above it "
                         "ended the last one, and that of another is lost or damaged")
    for begin, end, before in zip(ends[::2], ends[1::2], [-1, *ends[1::2]], strict=False):
        if stray := [at for at in range(before + 1, begin) if lines[at].strip()]:
            raise InputError(f"{path}, line {stray[0] + 1}: {lines[stray[0]].strip()!r:.40} is in no data set: each begins and "
                             "ends with a line -1, and one is lost or damaged")
        kind, *more = [*(lines[begin + 1].split() if end > begin + 1 else []), ""]
        if not re.fullmatch("[0-9]{1,4}b?", kind) or (not values if kind[-1] == "b" else any(more)):
            raise InputError(f"{path}, line {begin + 2}: {lines[begin + 1]!r:.40} is not the number of a data set")
        content = values.pop(0) if kind[-1] == "b" else ()
        yield DataSet(int(kind.rstrip("b")), lines[begin + 2:end], *content)


def _closes(raw: bytes, stop: int, indent: bytes, end: bytes) -> bool:
    """Whether values end at `stop`, in front of a line -1 like the first line of the data set, and that line's end.

    Where values were lost, the place lies behind the real end of the values: in the blanks of the line -1, or inside or
    behind the end of the line before it.
    """
    line = re.match(rb"([ \t\r\n]*)-1[ \t]*(\r?\n|\Z)", raw[stop:stop + 90])
    if line is None or len(line[1].rpartition(b"\n")[2]) < len(indent):
        return False
    lost = raw[stop - len(end):stop] == end if b"\n" not in line[1] else end == b"\r\n" == raw[stop - 1:stop + 1]
    return not lost


def origin_of(sets: list[DataSet]) -> list[str]:
    """The program that wrote the file (data set 151) and its units (164), as texts."""
    said = []
    for kind, lines, *_ in sets:
        if kind == Sets.HEADER and (names := [lines[at].strip() for at in (5, 2) if at < len(lines) and lines[at].strip()]):
            said.append(f"written by {names[0]:.60}")
        if kind == Sets.UNITS and lines and (unit := lines[0][10:30].strip()):
            said.append(f"its units: {unit}; nothing is converted")
    return said


def nodes_of(path: Path, sets: list[DataSet]) -> tuple[Array, Array]:
    """Numbers, shape (n,), and places, shape (n, 3), of the nodes in the data sets 2411 and 15.

    Raises
    ------
    InputError
        A node that is given twice or whose place is in a frame of its own.
    """
    nodes, turned = dict[int, tuple[int, list[str]]](), set[int]()
    for kind, lines, *_ in sets:
        # coordinate systems that are not the global one: of another type, turned or moved
        for start in range(0, len(lines), 4) if kind == Sets.COORDINATE_SYSTEMS else ():
            # five numbers, a name, then origin, a point on x and one in the plane of x and z
            number, type_ = [*whole(path, f"data set {kind}", lines[start].split()[:2]), 0, 0][:2]
            given = as_numbers(f"{path}: data set {kind}", " ".join(lines[start + 2:start + 4]), float)
            same = len(given) == 9 and not given[:3].any() and not given[4:6].any() and not given[7] and min(given[[3, 8]]) > 0
            turned |= set() if same and type_ == 0 else {number}
        # nodes: seven numbers on two lines, in the old data set on one
        per = 2 if kind == Sets.NODES else 1
        if kind == Sets.NODES and len(lines) % per:
            raise InputError(f"{path}: the last node of data set {kind} has no coordinates")
        for start in range(0, len(lines), per) if kind in (Sets.NODES, Sets.NODES_SINGLE) else ():
            words = " ".join(lines[start:start + per]).split()
            if len(words) != 7:
                raise InputError(f"{path}: {lines[start].strip()!r:.60} should be a node of seven numbers (data set {kind})")
            number, system, *_ = whole(path, f"data set {kind}", words[:4])
            if number < 1:
                raise InputError(f"{path}: a node has the number {number}; they count from 1")
            if number in nodes:
                raise InputError(f"{path} gives the node {number} twice")
            nodes[number] = system if kind == Sets.NODES_SINGLE else 0, words[4:]
    if used := {system for system, _ in nodes.values()} & turned:
        raise InputError(f"{path} has nodes in the coordinate system {min(used)}, which is turned or moved: write "
                         "it in the global one")
    points = as_numbers(f"{path}: the coordinates of nodes", " ".join(" ".join(place) for _, place in nodes.values()), float)
    if len(points) != 3 * len(nodes):
        raise InputError(f"{path}: the coordinates of nodes are not three numbers each")
    return np.array(list(nodes), dtype=np.int64), points.reshape(-1, 3)


def apart(text: str) -> str:
    """Numbers of fixed width with a blank between them, also where a sign fills the field."""
    return re.sub(r"(?<=[\d.])(?=[+-]\d*\.)", " ", text)
