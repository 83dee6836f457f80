"""Abaqus and CalculiX input files (.inp): nodes, elements and sets, with the numbers that the file gives them.

meshio reads these too, but keeps no numbers, takes only the last of several *NODE blocks, and mixes up the sets that
*ELEMENT lines name. What is read here is handed on as meshio's readers do it, with the numbers as its Nastran reader
names them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from femsub.errors import InputError
from femsub.io.inp_decks import blocks, names
from femsub.io.inp_generate import GENERATORS
from femsub.io.inp_store import Found, NodesOf, Range, once, rows_of, table_of, whole_numbers
from femsub.io.mesh_text import as_numbers, as_table, fields

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
#: other elements that fill a volume, which would be missing: cohesive, gasket, acoustic, infinite, continuum shells, ...
_VOLUMES = re.compile(r"(COH|GK|AC|CIN|EC|PC|FC|F|Q|DCC|EMC)3D([4-9]|\d\d)|SC[68]|CSS8|C3D")
_SCOPES = ("PART", "INSTANCE", "ASSEMBLY", "END PART", "END ASSEMBLY")


def read_inp(path: Path) -> tuple[Any, list[str]]:
    """A meshio.Mesh with `points_id` and `cells_id` (the file's numbers), and what was skipped.

    ==============  ==========================================================================================================
    reads           \\*NODE, \\*ELEMENT, \\*NSET, \\*ELSET (lists, names, quoted names, GENERATE), \\*NGEN (straight, arcs),
                    \\*NFILL (equal intervals), \\*NCOPY, \\*NMAP (RECTANGULAR, CYLINDRICAL), \\*ELGEN, \\*ELCOPY, \\*INCLUDE and
                    INPUT= (files beside this one); blank fields as 0, Fortran exponents, a byte-order mark, Latin-1
    skips, tells    elements that are no cells (MASS, SPRING, ...); nodes, elements and sets that only the assembly has
    refuses         several parts or instances, one that is moved, \\*SYSTEM, nodes in cylindrical coordinates; other options
                    of what is read; \\*IMPERFECTION, \\*IMPORT, \\*MODEL CHANGE, \\*REFINE MESH, \\*PARAMETER, \\*SYMMETRIC MODEL
                    GENERATION; nearly known keywords; nodes and elements given twice; sets of what the file does not
                    give; elements that fill a volume and are none of ours; a last line that does not end
    cannot know     whether lines are missing between two keywords or at the end: the format counts nothing. A number in a
                    list of a set is a node or element, a set called 7 needs quotes there
    ==============  ==========================================================================================================

    Raises
    ------
    InputError
        What is refused, by keyword, set and number.
    """
    import meshio

    found = Found(path)
    _collect(path, found)
    if not found.nodes or not found.elements:
        raise InputError(f"{path} has no {'*NODE' if not found.nodes else '*ELEMENT'} data")
    numbers, points = found.all_nodes()
    cell_numbers = [part for _, part, _ in found.elements]
    once(path, "elements", np.concatenate([*cell_numbers, *found.others]))
    cells = [(kind, rows_of(path, f"a {kind} element", "node", numbers, nodes)) for kind, _, nodes in found.elements]
    point_sets, known, cell_sets = {}, found.all_elements(), {}
    for name in (found.spelling["n" + key] for key in found.node_sets):
        point_sets[name] = rows_of(path, f"*NSET {name}", "node", numbers, found.members("n", name, f"*NSET {name}"))
    for name in (found.spelling["e" + key] for key in found.cell_sets):
        members = found.members("e", name, f"*ELSET {name}")
        rows_of(path, f"*ELSET {name}", "element", known, members)
        rows = [np.flatnonzero(np.isin(part, members)) for part in cell_numbers]
        if not len(members) or any(map(len, rows)):  # else of skipped elements only
            cell_sets[name] = rows
    mesh = meshio.Mesh(points, cells, point_sets=point_sets, cell_sets=cell_sets)
    mesh.points_id, mesh.cells_id = numbers, cell_numbers
    notes = [f"{count} elements of type {kind} skipped" for kind, count in found.skipped.items()]
    if found.apart:
        notes.append(f"what belongs to the assembly only skipped: {', '.join(sorted(found.apart))}")
    return mesh, notes


def _collect(path: Path, found: Found) -> None:
    makers = {"NODE": _nodes, "ELEMENT": _elements, "NSET": _set, "ELSET": _set, **GENERATORS}
    for keyword, options, data in blocks(path):
        if keyword == "SYSTEM" and data.strip():
            raise InputError(f"{path} has a *SYSTEM, which moves coordinates; write the nodes in the global system")
        if keyword in _SCOPES:
            found.scopes[keyword] += 1
            if found.scopes["PART"] > 1 or found.scopes["INSTANCE"] > 1 or (keyword == "INSTANCE" and data.strip()):
                raise InputError(f"{path} has several parts or a part that is moved: write one flat file, e.g. with "
                                 "'do not use parts and assemblies in input files' in Abaqus/CAE")
            continue
        in_assembly = found.scopes["ASSEMBLY"] > found.scopes["END ASSEMBLY"]
        if keyword in makers:
            name = options.get("NSET" if keyword in ("NODE", "NSET") else "ELSET", "")
            if in_assembly and "INSTANCE" not in options:
                found.apart.add(f"*{keyword} {name}".strip())
            else:
                makers[keyword](found, keyword, options, data)


# ---- what is listed

def _nodes(found: Found, keyword: str, options: Mapping[str, str], data: str) -> None:
    path = found.path
    if options.get("SYSTEM", "R").upper() != "R":
        raise InputError(f"{path} gives nodes in cylindrical or spherical coordinates; write them as x, y, z")
    values, counts = fields(f"{path}: the data of *NODE", data, float)
    if not len(counts):
        return
    least = min(int(counts.max()), 4)
    if least < 3 or counts.min() < least or counts.max() > 8:  # a normal may follow, and a comma
        raise InputError(f"{path}: *NODE has {len(values)} numbers in {len(counts)} lines; each line must be number, x, y, z "
                         "(or number, x, y)")
    table = as_table(values, counts)
    whole = whole_numbers(f"{path}: the numbers of nodes", table[:, 0])
    points = np.zeros((len(table), 3))
    points[:, :least - 1] = table[:, 1:least]
    found.nodes.append((whole, points))
    if "NSET" in options:
        found.add("n", options["NSET"], whole)


def _elements(found: Found, keyword: str, options: Mapping[str, str], data: str) -> None:
    path, kind_here = found.path, options.get("TYPE", "").upper()
    kind = next((kinds.get(int(match[1])) for family, kinds in _FAMILIES
                 if (match := re.match(rf"(?:{family})(\d+)", kind_here))), None)
    data = re.sub(r",[ \t]*(?=\n|\Z)", "", data) if kind else data
    what = f"{path}: the data of *ELEMENT, TYPE={kind_here}"
    if kind is None:
        if not kind_here or _VOLUMES.match(kind_here):
            raise InputError(f"{path}: elements of type {kind_here or '(none)'} cannot be read; C3D4, C3D10, C3D8 and C3D20 can")
        _skip(found, kind_here, options, data)
        return
    values, counts = fields(what, data)
    width = _SIZES[kind] + 1
    if len(values) % width:
        raise InputError(f"{path}: *ELEMENT, TYPE={kind_here} has {len(values)} numbers, which is no multiple of {width} (number "
                         f"and {width - 1} nodes); is the file cut short?")
    if not len(values):
        return
    begins = np.zeros(len(values), dtype=bool)
    begins[np.cumsum(counts)[:-1]] = begins[0] = True
    table = values.reshape(-1, width)
    if not begins[::width].all():
        number = table[begins[::width].argmin(), 0]
        raise InputError(f"{path}: *ELEMENT, TYPE={kind_here}: what should be element {number} begins within a line; a line "
                         f"above it has not {width} numbers")
    found.elements.append((kind, whole_numbers(f"{path}: the numbers of elements", table[:, 0]), table[:, 1:]))
    if "ELSET" in options:
        found.add("e", options["ELSET"], table[:, 0])


def _skip(found: Found, kind: str, options: Mapping[str, str], data: str) -> None:
    lines = [line for line in data.split("\n") if line.strip()]
    heads = [line.split(",")[0] for line, above in zip(lines, ["", *lines], strict=False) if not above.rstrip().endswith(",")]
    numbers = as_numbers(f"{found.path}: the numbers of *ELEMENT, TYPE={kind}", " ".join(heads))
    found.skipped[kind] += len(numbers)
    found.others.append(numbers)
    if "ELSET" in options:
        found.add("e", options["ELSET"], numbers)


def _set(found: Found, keyword: str, options: Mapping[str, str], data: str) -> None:
    sort = keyword[0].lower()
    name = options.get(keyword, "")
    what = f"{found.path}: *{keyword} {name}"
    if not name:
        raise InputError(f"{found.path}: a *{keyword} without a name ({keyword}=...)")
    found.add(sort, name, np.zeros(0, dtype=np.int64))
    if sort == "n" and "ELSET" in options:
        found.add(sort, name, NodesOf(options["ELSET"]))
        return
    if "GENERATE" in options:
        for row in table_of(f"{what}, GENERATE", data):
            first, last, step = (*row[:2], row[2] if len(row) > 2 and row[2] else 1) if 2 <= len(row) <= 4 else (0, 0, 0)
            if step < 1 or last < first or first < 1:
                raise InputError(f"{what}, GENERATE has a line {', '.join(map(str, row))}; it must be first, last, step with "
                                 "last ≥ first and a step of 1 or more")
            found.add(sort, name, Range(int(first), int(last), int(step)))
        return
    if not re.search(r"[^\d\s,+-]", data):
        found.add(sort, name, as_numbers(f"{what}: its data", data))
        return
    members: list[int] = []
    for word in names(data):
        if word.lstrip("+-").isdecimal():
            members.append(int(word))
            continue
        other = word.strip('"')
        known = found.sets(sort).get(other.upper())
        if known is None or (other.upper() == name.upper() and len(known) == 1):
            raise InputError(f"{what} names {word!r}, which is neither a number nor a set above it")
        for part in list(known):
            found.add(sort, name, part)
    found.add(sort, name, np.array(members, dtype=np.int64))
