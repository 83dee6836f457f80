"""Abaqus and CalculiX input files (.inp): nodes, elements and sets, with the numbers that the file gives them.

meshio reads these too, but keeps no numbers, takes only the last of several *NODE blocks, and mixes up the sets that
*ELEMENT lines name. What is read here is handed on as meshio's readers do it, with the numbers as its Nastran reader
names them.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from femsub.errors import InputError
from femsub.pencil import Array

_PLANE = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9", 65: "triangle6"}
#: how the name of an element begins, and what the number after that means
_FAMILIES = (
    (r"C3D|DC3D", {4: "tetra", 10: "tetra10", 8: "hexahedron", 20: "hexahedron20", 6: "wedge", 15: "wedge15", 5: "pyramid"}),
    (r"CPS|CPE|CAX|STRI|SFM3D|M3D|R3D|S", _PLANE),
    (r"T2D|T3D", {2: "line", 3: "line3"}),
    (r"B[23]", {1: "line", 2: "line3", 3: "line"}),
)
_SIZES = {"tetra": 4, "tetra10": 10, "hexahedron": 8, "hexahedron20": 20, "wedge": 6, "wedge15": 15, "pyramid": 5,
          "triangle": 3, "quad": 4, "triangle6": 6, "quad8": 8, "quad9": 9, "line": 2, "line3": 3}


@dataclass
class _Found:
    """What a file holds, by the file's numbers."""

    nodes: list[tuple[Array, Array]] = field(default_factory=list)
    elements: list[tuple[str, Array, Array]] = field(default_factory=list)
    node_sets: dict[str, list[Array]] = field(default_factory=dict)
    cell_sets: dict[str, list[Array]] = field(default_factory=dict)
    spelling: dict[str, str] = field(default_factory=dict)
    skipped: Counter[str] = field(default_factory=Counter)
    scopes: Counter[str] = field(default_factory=Counter)
    apart: set[str] = field(default_factory=set)


def read_inp(path: Path) -> tuple[Any, list[str]]:
    """A meshio.Mesh with `points_id` and `cells_id` (the file's numbers), and what was skipped.

    One part at most: nodes and elements that an assembly adds (reference points) are skipped with their sets.

    Raises
    ------
    InputError
        No nodes; data that do not fit the keyword; a number or set that is not in the file; several parts or
        instances, an instance that is moved, coordinates in a *SYSTEM of their own.
    """
    import meshio

    found = _Found()
    _collect(path, found, depth=0)
    if not found.nodes or not found.elements:
        raise InputError(f"{path} has no {'*NODE' if not found.nodes else '*ELEMENT'} data")
    numbers = np.concatenate([part for part, _ in found.nodes])
    points = np.concatenate([part for _, part in found.nodes])
    numbers, first, copies = np.unique(numbers, return_index=True, return_counts=True)
    if copies.max() > 1:
        raise InputError(f"{path} gives {np.count_nonzero(copies > 1)} nodes more than once, the first is node "
                         f"{numbers[copies.argmax()]}")
    blocks = [(kind, _rows(path, f"a {kind} element", numbers, nodes)) for kind, _, nodes in found.elements]
    cell_numbers = [part for _, part, _ in found.elements]
    point_sets = {found.spelling["n" + name]: _rows(path, f"*NSET {name}", numbers, np.concatenate(parts))
                  for name, parts in found.node_sets.items()}
    cell_sets = {}
    for name, parts in found.cell_sets.items():
        members = np.concatenate(parts)
        cell_sets[found.spelling["e" + name]] = [np.flatnonzero(np.isin(part, members)) for part in cell_numbers]
    mesh = meshio.Mesh(points[first], blocks, point_sets=point_sets, cell_sets=cell_sets)
    mesh.points_id, mesh.cells_id = numbers, cell_numbers
    notes = [f"{count} elements of type {kind} skipped" for kind, count in found.skipped.items()]
    if found.apart:
        notes.append(f"what belongs to the assembly only skipped: {', '.join(sorted(found.apart))}")
    return mesh, notes


def _collect(path: Path, found: _Found, depth: int) -> None:
    for keyword, options, data in _blocks(path):
        if keyword == "SYSTEM":
            raise InputError(f"{path} has a *SYSTEM, which moves coordinates; write the nodes in the global system")
        if keyword in ("PART", "INSTANCE", "ASSEMBLY", "END PART", "END ASSEMBLY"):
            found.scopes[keyword] += 1
            if found.scopes["PART"] > 1 or found.scopes["INSTANCE"] > 1 or (keyword == "INSTANCE" and data.strip()):
                raise InputError(f"{path} has several parts or a part that is moved: write one flat file, e.g. with "
                                 "'do not use parts and assemblies in input files' in Abaqus/CAE")
            continue
        name = options.get("NSET" if keyword in ("NODE", "NSET") else "ELSET", "")
        in_assembly = found.scopes["ASSEMBLY"] > found.scopes["END ASSEMBLY"]
        if in_assembly and keyword in ("NODE", "ELEMENT", "NSET", "ELSET") and "INSTANCE" not in options:
            found.apart.add(f"*{keyword} {name}".strip())
        elif keyword == "INCLUDE":
            other = path.parent / options.get("INPUT", "")
            if depth > 9 or not other.is_file():
                raise InputError(f"{path} includes {options.get('INPUT', 'no file')!r}, which is not a file beside it")
            _collect(other, found, depth + 1)
        elif keyword == "NODE":
            _nodes(path, options, data, found)
        elif keyword == "ELEMENT":
            _elements(path, options, data, found)
        elif keyword in ("NSET", "ELSET") and name:
            _set(path, keyword, name, options, data, found)


def _blocks(path: Path) -> Iterator[tuple[str, dict[str, str], str]]:
    """Keyword, its options in capitals, and the lines of data below."""
    text = path.read_text(encoding="utf-8", errors="replace").replace("\r", "")
    last = text[text.rfind("\n*") + 1:].partition("\n")[0].upper()
    if not text.endswith("\n") and re.match(r"\*(NODE|ELEMENT|NSET|ELSET) *(,|$)", last):
        raise InputError(f"{path} ends within a line of {last.partition(',')[0].strip()} data: is it cut short? If not, end "
                         "that line")
    text = re.sub(r"^[ \t]*\*\*.*\n?", "", text, flags=re.MULTILINE)
    for block in re.split(r"^[ \t]*\*", text, flags=re.MULTILINE)[1:]:
        head, _, data = block.partition("\n")
        while head.rstrip().endswith(",") and data:
            more, _, data = data.partition("\n")
            head += more
        words = [word.partition("=") for word in head.split(",")]
        options = {key.strip().upper(): value.strip().strip('"') for key, _, value in words[1:]}
        yield " ".join(words[0][0].split()).upper(), options, data


def _numbers(path: Path, what: str, data: str, kind: type = np.int64) -> Array:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # numpy warns of text that is no number, and stops there
            return np.fromstring(re.sub(r"[dD](?=[+-]?\d)", "e", data).replace(",", " "), dtype=kind, sep=" ")
    except (DeprecationWarning, ValueError):
        raise InputError(f"{path}: the data of {what} are not all numbers") from None


def _rows(path: Path, what: str, numbers: Array, wanted: Array) -> Array:
    """Where the numbers wanted are among the ascending `numbers`."""
    rows = np.minimum(np.searchsorted(numbers, wanted), len(numbers) - 1)
    missing = wanted[numbers[rows] != wanted]
    if len(missing):
        raise InputError(f"{path}: {what} names node {missing.ravel()[0]}, which the file does not give")
    return rows


def _add(found: _Found, sort: str, name: str, members: Array) -> None:
    """Names are the same in capitals and small letters, and a set that comes again grows."""
    found.spelling.setdefault(sort + name.upper(), name)
    (found.node_sets if sort == "n" else found.cell_sets).setdefault(name.upper(), []).append(members)


def _nodes(path: Path, options: dict[str, str], data: str, found: _Found) -> None:
    if options.get("SYSTEM", "R").upper() != "R":
        raise InputError(f"{path} gives nodes in cylindrical or spherical coordinates; write them as x, y, z")
    lines = len(data.split("\n")) - data.split("\n").count("") if data else 0
    values = _numbers(path, "*NODE", data, float)
    if not lines:
        return
    if len(values) not in (3 * lines, 4 * lines) or (values.reshape(lines, -1)[:, 0] % 1).any():
        raise InputError(f"{path}: *NODE has {len(values)} numbers in {lines} lines; each line must be number, x, y, z "
                         "(or number, x, y)")
    table = values.reshape(lines, -1)
    points = np.zeros((lines, 3))
    points[:, :table.shape[1] - 1] = table[:, 1:]
    found.nodes.append((table[:, 0].astype(np.int64), points))
    if "NSET" in options:
        _add(found, "n", options["NSET"], found.nodes[-1][0])


def _elements(path: Path, options: dict[str, str], data: str, found: _Found) -> None:
    kind_here = options.get("TYPE", "").upper()
    kind = next((kinds.get(int(match[1])) for family, kinds in _FAMILIES
                 if (match := re.match(rf"(?:{family})(\d+)", kind_here))), None)
    if kind is None:
        if kind_here.startswith("C3D") or not kind_here:
            raise InputError(f"{path}: elements of type {kind_here or '(none)'} cannot be read; C3D4, C3D10, C3D8 and C3D20 can")
        found.skipped[kind_here] += sum(1 for line in data.split("\n") if line.strip())
        return
    values = _numbers(path, f"*ELEMENT, TYPE={kind_here}", data)
    width = _SIZES[kind] + 1
    if len(values) % width:
        raise InputError(f"{path}: *ELEMENT, TYPE={kind_here} has {len(values)} numbers, which is no multiple of {width} (number "
                         f"and {width - 1} nodes); is the file cut short?")
    table = values.reshape(-1, width)
    if not len(table):
        return
    found.elements.append((kind, table[:, 0], table[:, 1:]))
    if "ELSET" in options:
        _add(found, "e", options["ELSET"], table[:, 0])


def _set(path: Path, keyword: str, name: str, options: dict[str, str], data: str, found: _Found) -> None:
    sort = keyword[0].lower()
    known = found.node_sets if sort == "n" else found.cell_sets
    if sort == "n" and "ELSET" in options:
        members = np.concatenate(found.cell_sets.get(options["ELSET"].upper(), [np.zeros(0, dtype=np.int64)]))
        taken = [nodes[np.isin(numbers, members)].ravel() for _, numbers, nodes in found.elements]
        _add(found, sort, name, np.unique(np.concatenate(taken)))
        return
    if "GENERATE" in options:
        for line in filter(str.strip, data.split("\n")):
            first, last, *step = _numbers(path, f"*{keyword} {name}", line)
            _add(found, sort, name, np.arange(first, last + 1, step[0] if step else 1))
        return
    words = re.findall(r"[^\s,][^,\n]*", data)
    names = [word.strip() for word in words if not word.strip().lstrip("+-").isdigit()]
    for other in names:
        if other.upper() not in known:
            raise InputError(f"{path}: *{keyword} {name} names {other!r}, which is neither a number nor a set above it")
        _add(found, sort, name, np.concatenate(known[other.upper()]))
    if not names:
        _add(found, sort, name, _numbers(path, f"*{keyword} {name}", data))
    else:
        _add(found, sort, name, np.array([int(word) for word in words if word.strip() not in names], dtype=np.int64))
