"""Mesh files: reading gives a checked `Mesh` with its named sets; VTU and a few other formats are written."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from femsub.checks import Array, InputError, as_word, choice, instance, mapping, path_of, word
from femsub.components import CELLS, Mesh, checked
from femsub.io.atomic import Writer, scratch, write_or_refuse
from femsub.io.cdb import read_cdb
from femsub.io.damage import head_of, unreadable_refused
from femsub.io.foreign_meshes import quietly, read_foreign, read_tetgen
from femsub.io.gmsh import BODIES, counted, is_gmsh, read_gmsh
from femsub.io.inp import read_inp
from femsub.io.mesh_text import including, meshio
from femsub.io.nastran import read_nastran
from femsub.io.universal import is_universal, read_universal

_SET, _GROUP, _NUMBER = "set:", "group:", "number"  # names of sets, groups and node numbers in femsub's files
#: cell data that number the groups, and the names of unnamed groups, for each dimension
_TAGS = {"nastran:ref": ("property",) * 4, "gmsh:physical": BODIES, "medit:ref": BODIES}
#: suffix: meshio's writer, and whether it takes data at the nodes
_WRITERS = {".vtu": ("vtu", True), ".vtk": ("vtk", True), ".msh": ("gmsh", True), ".inp": ("abaqus", False)}
_OWN = {".inp": read_inp, ".bdf": read_nastran, ".nas": read_nastran, ".fem": read_nastran,
        ".node": read_tetgen, ".ele": read_tetgen}  # readers that are not meshio's
#: lines of Nastran's decks, and of Abaqus' and CalculiX', whatever the file is called
_NASTRAN = re.compile(rb"(?mi)^(CEND\b|[ \t]*BEGIN[ \t]+BULK\b|[ \t]*INCLUDE[ \t]+['\"]|GRID\*?[ \t,]+\d)")
_ARCHIVE = re.compile(rb"(?mi)^[ \t]*[NE]BLOCK[ \t]*,")  # of Ansys
_TECPLOT = re.compile(rb"(?mi)^[ \t]*(TITLE|VARIABLES|ZONE)\b")  # what .dat means to meshio
_KEYWORD = re.compile(rb"(?mi)^[ \t]*\*(NODE|ELEMENT|HEADING|INCLUDE|PART)\b")
_ABAQUS = {"hexahedron": b"C3D8", "hexahedron20": b"C3D20", "tetra": b"C3D4", "tetra10": b"C3D10", "triangle": b"S3",
           "quad": b"S4", "line": b"T3D2"}


@unreadable_refused
def read_mesh(path: str | Path, *, kind: str | None = None, name: str | None = None, includes: str | Path | None = None) -> Mesh:
    """Read a mesh file: the cells of the highest dimension with their named sets, checked (see `mesh_checks.checked`).

    Abaqus and CalculiX .inp, Nastran .bdf, Ansys .cdb, Gmsh .msh, TetGen and universal files (.unv, .uff) have their own
    readers; meshio reads all other formats. Decks and universal files may have any name: their content shows which they are.
    Tables of what each reads, refuses and cannot detect stand at the readers: `femsub.io.inp.read_inp`,
    `femsub.io.nastran.read_nastran`, `femsub.io.cdb.read_cdb`, `femsub.io.gmsh.read_gmsh`, `femsub.io.universal.read_universal`,
    `femsub.io.foreign_meshes.read_tetgen` and `read_foreign`. Cells of lower dimension only define sets. Coordinates are not
    converted; they are in the file's unit of length.

    ============================  =====================  ==============================================
    file                          sets of nodes          groups of cells
    ============================  =====================  ==============================================
    Gmsh physical groups          all                    those of the highest dimension
    \\*NSET, \\*ELSET               all                    \\*ELSET
    Nastran property 7            property-7             property-7
    Ansys                         components             components, material-7
    VTU, VTK of `write_mesh`      point data set:NAME    cell data group:NAME
    ============================  =====================  ==============================================

    A group without a name (Gmsh, Medit) is named by its tag: volume-1, surface-2, line-3, point-4. A set of nodes with the
    same name as a group is kept.

    Parameters
    ----------
    path : str or Path
    kind : str, optional
        Take only the cells of this kind, and note in `repairs` what was dropped. Needed for a mesh of mixed kinds.
    name : str, optional
        Default: the file's name without suffix.
    includes : str or Path, optional
        Another folder from which .inp and Nastran files may include files. By default they may only use their own folder.

    Returns
    -------
    Mesh
        `numbers` are the file's node numbers for .inp, .bdf, .cdb, .unv and femsub's VTU; else nodes are numbered from 1 on.
        `repairs` lists repairs and anything unusual.

    Raises
    ------
    InputError
        No such file; cut short or no mesh; kinds that are mixed or not supported; tangled or flat cells.
    MissingPackageError
        meshio or scikit-fem is not installed.

    Examples
    --------
    >>> import femsub as fs
    >>> path = fs.write_mesh("block.vtu", fs.block((1.0, 1.0, 1.0), (2, 2, 2), "hexahedron"))
    >>> fs.read_mesh(path)
    Mesh 'block': 27 nodes, 8 hexahedron, sets left, right, front, back, bottom, top
    """
    place = path_of("path", path)
    if not place.is_file():
        raise InputError(f"there is no mesh file {place}" if not place.exists() else f"{place} is a folder, not a mesh file")
    with including(*([] if includes is None else [path_of("includes", includes)])):
        meshio()
        found, notes = _reader(place)(place)
    if not len(found.points) or not any(len(block.data) for block in found.cells):
        raise InputError(f"{place} holds {len(found.points)} nodes and no cells; {'; '.join(notes) or 'is it cut short?'}")
    # the kind to take; cells of other kinds of its dimension or above are dropped
    counts: dict[int, Counter[str]] = {}
    for block in found.cells:
        dimension = 3 if block.type.startswith("polyhedron") else int(block.dim)
        if len(block.data):
            counts.setdefault(dimension, Counter())[block.type] += len(block.data)
    top, dropped = counts[max(counts)], Counter[str]()
    if kind is None:
        usable = [one for one in top if one in CELLS]
        if len(usable) < len(top):
            raise InputError(f"{place} has {_several(top)} cells, but femsub knows only {', '.join(CELLS)}: mesh it with one of "
                             "these" + (f", or read_mesh(..., kind={usable[0]!r}) takes those and drops the others" if usable
                                        else ""))
        if len(top) > 1:
            raise InputError(f"{place} mixes {_several(top)} cells, but a mesh is of one kind: mesh it anew, or read_mesh(..., "
                             f"kind={top.most_common(1)[0][0]!r}) takes those and drops the others")
        chosen = usable[0]
    else:
        chosen = choice("kind of cell", kind, CELLS)
        if not any(kind in here for here in counts.values()):
            raise InputError(f"{place} has no {kind} cells; it has {_several(sum(counts.values(), Counter()))}")
        for dimension in range(CELLS[kind][0], 4):
            dropped.update(counts.get(dimension, {}))
        del dropped[kind]
    # cells of the chosen kind
    kept = [number for number, block in enumerate(found.cells) if len(block.data) and not block.type.startswith("polyhedron")]
    blocks = [found.cells[number] for number in kept]
    if dropped:
        notes.append(f"{_several(dropped)} cells dropped, as kind={kind!r} asks")
    cells = np.concatenate([block.data for block in blocks if block.type == chosen])
    if cells.shape[1:] != (CELLS[chosen][1],) or cells.min() < 0 or cells.max() >= len(found.points):
        raise InputError(f"{place}: {chosen} cells name nodes that the file does not give; is it damaged?")
    # name and, for each block, the rows of the cells in it; a name may come twice
    nothing, listed = np.zeros(0, dtype=np.intp), list[tuple[str, list[Array]]]()
    for label, members in found.cell_sets.items():
        if not label.startswith("gmsh:"):
            listed.append((label, [nothing if members[number] is None else np.asarray(members[number], dtype=np.intp)
                                   for number in kept]))
    for key, parts in found.cell_data.items():
        if key in _TAGS and [len(part) for part in parts] != [len(block.data) for block in found.cells]:
            raise InputError(f"some cells of the mesh file have a {_TAGS[key][3]} and some have none; give one to each")
        values = [np.asarray(parts[number]).reshape(len(found.cells[number].data), -1)[:, 0] for number in kept]
        if key.startswith(_GROUP):
            listed.append((key.removeprefix(_GROUP), [np.flatnonzero(value) for value in values]))
        elif key in _TAGS:
            names = {(int(tag), int(dimension)): label for label, (tag, dimension) in found.field_data.items()}
            for dimension in range(4):
                here = [value if block.dim == dimension else nothing for block, value in zip(blocks, values, strict=True)]
                for tag in filter(None, np.unique(np.concatenate(here))):  # 0 is no group
                    label = names.get((int(tag), dimension), f"{_TAGS[key][dimension]}-{tag}")
                    listed.append((label, [np.flatnonzero(value == tag) for value in here]))
    # sets of nodes, groups of the chosen cells, and cells of lower dimension that are in no set
    nodes_in, cells_in = dict[str, list[Array]](), dict[str, list[Array]]()
    named = [np.zeros(len(block.data), dtype=bool) for block in blocks]
    offsets = np.cumsum([0, *(len(block.data) * (block.type == chosen) for block in blocks)])
    for label, members in listed:
        for block, rows, inside, offset in zip(blocks, members, named, offsets[:-1], strict=True):
            nodes_in.setdefault(label, []).append(np.unique(block.data[rows]))
            inside[rows] = True
            if block.type == chosen and len(rows):
                cells_in.setdefault(label, []).append(rows + offset)
    lost: Counter[str] = Counter()
    for block, inside in zip(blocks, named, strict=True):
        ends = np.sort(block.data[inside], axis=1)
        if block.dim < CELLS[chosen][0] and (twice := int(np.count_nonzero((ends[:, 1:] == ends[:, :-1]).any(axis=1)))):
            notes.append(f"{twice} {block.type} cell{'s' * (twice > 1)} of a set name{'s' * (twice == 1)} a node twice: is a "
                         "number damaged, so that the set lacks a node?")
        if block.dim < CELLS[chosen][0] and not inside.all():
            lost[block.type] += int(np.count_nonzero(~inside))
    sets = {label: np.unique(np.concatenate(parts)) for label, parts in nodes_in.items()}
    sets |= {label: np.asarray(rows, dtype=np.intp) for label, rows in found.point_sets.items()}
    sets |= {label.removeprefix(_SET): np.flatnonzero(np.asarray(values).reshape(len(found.points), -1)[:, 0])
             for label, values in found.point_data.items() if label.startswith(_SET)}
    groups = {label: np.concatenate(parts) for label, parts in cells_in.items()}
    for label, parts in (*((label, [values]) for label, values in found.point_data.items()), *found.cell_data.items()):
        mine, other = label.startswith((_SET, _GROUP)), [value for part in parts for value in np.setdiff1d(part, (0, 1))]
        if mine and other:
            raise InputError(f"{place}: {label!r} has {other[0]:g} where 1 marks a member, and 0 the others; it is damaged")
        if not mine and not other and all(np.asarray(part).dtype == np.int8 for part in parts):
            notes.append(f"the data {label!r:.60} are 0 or 1 as the marks of a set, but are called neither {_SET}NAME nor "
                         f"{_GROUP}NAME: left out")
    sets, groups = ({key if as_word(key) in of else as_word(key): rows for key, rows in of.items()} for of in (sets, groups))
    if lost:
        notes.append(f"{_several(lost)} cells of lower dimension, in no set, dropped")
    # numbers of nodes, if each has one of its own, and of cells
    numbers, of_cells = (getattr(found, key, None) for key in ("points_id", "cells_id"))
    if numbers is None and _NUMBER in found.point_data:
        numbers = np.asarray(found.point_data[_NUMBER]).ravel().astype(np.int64)
    if numbers is not None and len(np.unique(numbers)) != len(found.points):
        numbers = None
    called = as_word(place.stem) if name is None else word("name", name)
    mesh = Mesh(found.points, cells, chosen, sets=sets, groups=groups, numbers=numbers, repairs=notes, name=called)
    return checked(mesh, None if of_cells is None else np.concatenate(
        [of_cells[number] for number, block in zip(kept, blocks, strict=True) if block.type == chosen]))


def _reader(path: Path) -> Callable[[Path], tuple[Any, list[str]]]:
    """The reader of a file: by its content, where programs share a suffix or use any; else by its suffix."""
    suffix = path.suffix.lower()
    if suffix == ".msh":
        return read_gmsh if is_gmsh(path) else read_foreign
    if suffix in (".inp", ".bdf", ".nas", ".fem", ".dat") or suffix not in meshio().extension_to_filetypes:
        head = head_of(path)
        if _NASTRAN.search(head):
            return read_nastran
        if _KEYWORD.search(head):
            return read_inp
        if is_universal(head):
            return read_universal
        if suffix == ".cdb" or _ARCHIVE.search(head):
            return read_cdb
        if suffix not in _OWN and not (suffix == ".dat" and _TECPLOT.search(head)):
            raise InputError(f"{path}: neither the ending {suffix!r} nor the content is that of a mesh file that femsub reads")
    return _OWN.get(suffix, read_foreign)


def _several(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in sorted(counts.items()))


def mesh_bytes(mesh: Mesh, shapes: Mapping[str, Any] | None = None, suffix: str = ".vtu") -> bytes:
    """The content of `write_mesh`'s file with this suffix."""
    instance("mesh", mesh, Mesh)
    shapes = {} if shapes is None else mapping("shapes", shapes, "names and arrays")
    for key in shapes:
        word("a name of shapes", key)
    if suffix.lower() not in _WRITERS:
        raise InputError(f"meshes are written as {', '.join(_WRITERS)}, not as {suffix or 'a file without suffix'!r}")
    form, takes_data = _WRITERS[suffix.lower()]
    if shapes and not takes_data:
        raise InputError(f"{suffix} files hold no shapes; write .vtu")
    if form == "abaqus" and mesh.kind not in _ABAQUS:
        raise InputError(f"{suffix} files have no {mesh.kind} cells; write .vtu")
    # names that could not be read back unchanged
    for each in ([*mesh.sets, *shapes], [*mesh.groups]):
        for name in each:
            spoilt = any(ord(letter) < 32 or ord(letter) == 127 for letter in name)
            if spoilt or (form == "abaqus" and (not name.strip() or name != name.strip() or set(name) & set(',"'))):
                raise InputError(f"the name {name!r} cannot be written into {suffix.lower()} files so that it is read again: "
                                 "rename it" + ("" if spoilt else ", or write .vtu"))
        capitals = Counter(name.upper() for name in each)
        same = [name for name in each if capitals[name.upper()] > 1]
        if form == "abaqus" and same:
            raise InputError(f"in {suffix.lower()} files the names {same[0]!r} and {same[1]!r} are the same: rename one, or "
                             "write .vtu")
    # points, and the data of points and cells
    spelt = partial(escape, entities={'"': "&quot;"}) if form == "vtu" else str  # meshio writes names into XML as they are
    points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.points.shape[1])))
    data, n = dict[str, Array](), len(points)
    for key, values in shapes.items():
        if key.startswith((_SET, _GROUP)) or key == _NUMBER:
            raise InputError(f"a shape cannot be called {key!r}: that name is taken for sets, groups and node numbers")
        found: Array = np.asarray(values)
        if np.iscomplexobj(found) or found.dtype.kind not in "fiub":
            raise InputError(f"the shape {key!r} must be real, not {found.dtype}. Give the real and the imaginary part "
                             "separately")
        if found.shape not in ((n,), (n, 2), (n, 3)) or not np.isfinite(found).all():
            raise InputError(f"the shape {key!r} must be finite, of shape ({n}, 3), ({n}, 2) or ({n},), one row per node; it is "
                             f"{found.shape}")
        data[spelt(key)] = (np.column_stack([found, np.zeros(n)]) if found.shape == (n, 2) else found).astype(float)
    groups: dict[str, list[Array]] = {}
    named: dict[str, Any] = {}
    if takes_data:
        data |= {spelt(_SET + key): np.isin(np.arange(len(points)), rows).astype(np.int8) for key, rows in mesh.sets.items()}
        if np.issubdtype(mesh.numbers.dtype, np.integer):
            data[_NUMBER] = mesh.numbers.astype(np.int64)
        groups = {spelt(_GROUP + key): [np.isin(np.arange(len(mesh.cells)), rows).astype(np.int8)]
                  for key, rows in mesh.groups.items()}
    else:
        named = {"point_sets": {key: rows for key, rows in mesh.sets.items() if len(rows)},
                 "cell_sets": {key: [rows] for key, rows in mesh.groups.items()}}
    whole = meshio().Mesh(points, [(mesh.kind, mesh.cells)], point_data=data, cell_data=groups, **named)

    def written() -> bytes:
        with scratch(float(points.nbytes + mesh.cells.nbytes + sum(values.nbytes for values in data.values()))) as folder:
            whole.write(folder / f"mesh{suffix.lower()}", file_format=form)
            found = (folder / f"mesh{suffix.lower()}").read_bytes()
        return counted(found) if form == "gmsh" else found

    content: bytes = quietly(written, f"the mesh {mesh.name!r} cannot be written as {suffix}")[0]
    # meshio writes the last name it knows for a kind, such as C3D20RH, which CalculiX does not have
    return re.sub(rb"(?<=\*ELEMENT, TYPE=)\w+", _ABAQUS[mesh.kind], content, count=1) if form == "abaqus" else content


def write_mesh(path: str | Path, mesh: Mesh, shapes: Mapping[str, Any] | None = None) -> Path:
    """Write a mesh to a file: .vtu (for ParaView), .vtk, .msh or .inp. The file is written completely or not at all.

    Sets become the point data "set:NAME" (0 or 1), groups the cell data "group:NAME", node numbers the point data
    "number", so that `read_mesh` can read them. .inp has \\*NSET and \\*ELSET instead, and numbers from 1. A missing folder is
    created.

    Parameters
    ----------
    path : str or Path
    mesh : Mesh
    shapes : mapping of str to array_like, shape (n, 3), (n, 2) or (n,), optional
        Real point data by name: mode shapes, displacements. For a complex shape give the real and the imaginary part.

    Returns
    -------
    Path

    Raises
    ------
    InputError
        Another suffix, a shape that does not fit the nodes, a name that could not be read back unchanged, a folder that cannot
        be written.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.write_mesh("block.vtu", fs.block((1.0, 1.0, 1.0), (2, 2, 2))).name
    'block.vtu'
    """
    place = path_of("path", path)
    content = mesh_bytes(mesh, shapes, place.suffix)
    write_or_refuse(f"the mesh file {place}", place.parent, {place.name: lambda file: file.write(content)})
    return place


def mesh_writer(mesh: Mesh, shapes: Mapping[str, Any] | None = None) -> Writer:
    """A function that writes a mesh with fields on it as VTU into an open file."""
    return lambda file: file.write(mesh_bytes(mesh, shapes))


def series_bytes(times: Mapping[str, float]) -> bytes:
    """A ParaView data file (.pvd), which shows VTU files, named relative to it, one after the other at their times."""
    entries = "\n".join(f'  <DataSet timestep="{time!r}" part="0" file="{escape(name)}"/>' for name, time in times.items())
    return ('<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n <Collection>\n'
            f"{entries}\n </Collection>\n</VTKFile>\n").encode()
