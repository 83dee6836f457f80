"""Valid mesh files for `fuzzing`, of every format that has a reader of its own or a large use, and how they are read."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import meshio
import numpy as np
from fuzzing import Subject

import femsub as fs

KEYWORDS = (b"*NODE", b"*ELEMENT", b"*NSET", b"*ELSET", b"*NGEN", b"*NFILL", b"*NCOPY", b"*NMAP", b"*ELGEN", b"*ELCOPY",
            b"*INCLUDE", b"GENERATE", b"TYPE=C3D8", b"TYPE=C3D4", b"INPUT=x", b"ELSET=low", b"SHIFT")
CARDS = (b"GRID", b"GRDSET", b"CHEXA", b"CTETRA", b"CQUAD4", b"INCLUDE", b"ENDDATA", b"BEGIN BULK", b"GRID*", b"CONM2", b"+",
         b"*", b"=")
SECTIONS = (b"$Nodes", b"$EndNodes", b"$Elements", b"$EndElements", b"$Entities", b"$EndEntities", b"$PhysicalNames",
            b"$NodeData", b"$MeshFormat", b"$EndMeshFormat")
ARCHIVE = (b"NBLOCK", b"EBLOCK", b"CMBLOCK", b"SOLID", b"NODE", b"ELEM", b"ET,", b"CSYS,", b"LOCAL,12", b"185", b"187", b"-1")
WHOLE = frozenset({"word", "comma", "nul"})  # where a file cut at the end of a line is a file again


def read(path: Path) -> Any:
    """What a mesh file holds; TetGen's two files are a folder."""
    mesh = fs.read_mesh(path / "m.node" if path.is_dir() else path)
    for note in mesh.repairs:
        warnings.warn(note, stacklevel=1)
    points, cells = np.argsort(mesh.numbers, kind="stable"), np.lexsort(mesh.numbers[mesh.cells].T)  # whatever their order is
    at, of = np.argsort(points), np.argsort(cells)
    return {"points": mesh.points[points], "cells": at[mesh.cells[cells]], "kind": mesh.kind, "numbers": mesh.numbers[points],
            "sets": {name: np.sort(at[rows]) for name, rows in mesh.sets.items()},
            "groups": {name: np.sort(of[rows]) for name, rows in mesh.groups.items()}}


def abaqus(mesh: fs.Mesh) -> str:
    """A deck with all that is listed and made."""
    lines = ["*HEADING", "a bar", "*NODE, NSET=every"]
    lines += [f"{10 + i}, {x:.3f}, {y:.3f}, {z:.3f}" for i, (x, y, z) in enumerate(mesh.points)]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=low", f"3, {', '.join(str(10 + node) for node in mesh.cells[0])}"]
    lines += ["*ELGEN, ELSET=row", "3, 2, 4, 1", "*ELCOPY, OLD SET=low, ELEMENT SHIFT=10, SHIFT NODES=8, NEW SET=third"]
    lines += ["*NSET, NSET=end, GENERATE", "10, 13, 1", "*NSET, NSET=both", "end, 14",
              "*NCOPY, OLD SET=end, CHANGE NUMBER=100, SHIFT", "0., 0., 5.", "0., 0., 0., 0., 0., 1., 90.", "*NGEN, NSET=line",
              "110, 113, 3", "*STEP", "*END STEP"]
    return "\n".join(lines) + "\n"


def nastran(mesh: fs.Mesh, form: str) -> str:
    lines = ["SOL 103", "BEGIN BULK"]
    for i, place in enumerate(mesh.points):
        words = [f"{value:.3f}" for value in place]
        lines += ([f"GRID,{5 + i},,{','.join(words)}"] if form == "free" else
                  ["GRID    " + f"{5 + i:<8d}" + " " * 8 + "".join(f"{word:>8s}" for word in words)])
    for i, cell in enumerate(mesh.cells):
        nodes = [str(5 + node) for node in cell]
        lines += ([f"CHEXA,{i + 1},{7 + i},{','.join(nodes[:6])},+", f"+,{','.join(nodes[6:])}"] if form == "free" else
                  ["CHEXA   " + "".join(f"{word:<8s}" for word in (str(i + 1), str(7 + i), *nodes[:6])) + f"+{i:<7d}",
                   f"+{i:<7d}" + "".join(f"{word:<8s}" for word in nodes[6:])])
    return "\n".join([*lines, "ENDDATA", ""])


def gmsh(mesh: fs.Mesh, version: str) -> str:
    count, total = len(mesh.points), len(mesh.cells)
    head = [f"$MeshFormat\n{version} 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n2 4 \"face\"\n3 9 \"body\"\n$EndPhysicalNames"]
    places = [f"{x:.4f} {y:.4f} {z:.4f}" for x, y, z in mesh.points]
    cells = [" ".join(str(node + 1) for node in cell) for cell in mesh.cells]
    if version == "2.2":
        head += ["$Nodes", str(count), *(f"{i + 1} {place}" for i, place in enumerate(places)), "$EndNodes", "$Elements"]
        head += [str(total + 1), "1 3 2 4 1 1 2 4 3", *(f"{i + 2} 5 2 9 1 {cell}" for i, cell in enumerate(cells))]
    else:
        head += ["$Entities", "0 0 1 1", "1 0 0 0 1 1 1 2 4 5 0", "1 0 0 0 1 1 1 1 9 1 1", "$EndEntities"]
        head += ["$Nodes", f"1 {count} 1 {count}", f"3 1 0 {count}", *(str(i + 1) for i in range(count)), *places, "$EndNodes"]
        head += ["$Elements", f"2 {total + 1} 1 {total + 1}", "2 1 3 1", "1 1 2 4 3", f"3 1 5 {total}"]
        head += [f"{i + 2} {cell}" for i, cell in enumerate(cells)]
    return "\n".join([*head, "$EndElements", ""])


def archive(mesh: fs.Mesh) -> str:
    """What Ansys writes with CDWRITE,DB."""
    nodes = "".join(f"{number:9d}{0:9d}{0:9d}" + "".join(f"{value:21.13E}" for value in place) + "\n"
                    for number, place in zip(mesh.numbers, mesh.points, strict=True))
    rows = [(1 + at % 2, 1, 1, 1, 0, 0, 0, 0, 8, 0, 11 + at, *mesh.numbers[cell]) for at, cell in enumerate(mesh.cells)]
    cells = "".join("".join(f"{value:9d}" for value in row) + "\n" for row in rows)
    left = mesh.numbers[mesh.sets["left"]]
    return "\n".join(["/PREP7", "ET,1,185", "CSYS,0", f"NBLOCK,6,SOLID,{max(mesh.numbers)},{len(mesh.points)}",
                      f"(3i9,6e21.13e3)\n{nodes}N,R5.3,LOC,       -1,", f"EBLOCK,19,SOLID,13,{len(mesh.cells)}",
                      f"(19i9)\n{cells}       -1", f"CMBLOCK,LEFT    ,NODE,{len(left)}  ! nodes", "(8i10)",
                      "".join(f"{number:10d}" for number in left), "CMBLOCK,LOW     ,ELEM,       2", "(8i10)",
                      f"{11:10d}{-12:10d}", "FINISH", ""])


def subjects(folder: Path) -> list[Subject]:
    bricks, tetra = fs.block((3.0, 1.0, 1.0), (3, 1, 1), "hexahedron"), fs.block((1.0, 1.0, 1.0), (1, 1, 1), "tetra")
    named = fs.Mesh(bricks.points, bricks.cells, "hexahedron", {"left": bricks.nodes("left"), "right": bricks.nodes("right")},
                    {"low": [0, 1]}, np.arange(16) + 100)
    plain = meshio.Mesh(bricks.points, [("hexahedron", bricks.cells)])
    made: list[Subject] = []

    def add(name: str, file: str, **how: Any) -> Path:
        path = folder / name / file
        path.parent.mkdir(parents=True, exist_ok=True)
        made.append(Subject(name, path, "fuzz_meshes:read", **how))
        return path

    add("abaqus", "m.inp", vocabulary=KEYWORDS, strict=WHOLE).write_text(abaqus(bricks))
    fs.write_mesh(add("calculix", "m.inp", vocabulary=KEYWORDS, strict=WHOLE), named)
    for form in ("fixed", "free"):
        add(f"bdf-{form}", "m.bdf", vocabulary=CARDS, strict=WHOLE).write_text(nastran(bricks, form))
    for version in ("2.2", "4.0", "4.1"):
        if version != "4.0":
            add(f"msh-{version}", "m.msh", vocabulary=SECTIONS).write_text(gmsh(bricks, version))
        meshio.gmsh.write(add(f"msh-{version}-binary", "m.msh", text=False), plain, fmt_version=version, binary=True)
    fs.write_mesh(add("msh-own", "m.msh", text=False, strict=frozenset()), named)
    fs.write_mesh(add("vtu", "m.vtu", text=False), named)
    meshio.write(add("vtu-text", "m.vtu"), plain, file_format="vtu", binary=False)
    for form in ("vtk42", "vtk51"):
        writer = meshio.vtk._vtk_42.write if form == "vtk42" else meshio.vtk._vtk_51.write
        writer(add(form, "m.vtk", text=False), plain, binary=True)
        writer(add(f"{form}-text", "m.vtk"), plain, binary=False)
    meshio.write(add("med", "m.med", text=False), plain)
    meshio.write(add("xdmf-text", "m.xdmf"), plain, data_format="XML")
    add("su2", "m.su2").write_text("\n".join([
        "NDIME= 3", "NPOIN= 16", *(f"{x} {y} {z} {i}" for i, (x, y, z) in enumerate(bricks.points)), "NELEM= 3",
        *(f"12 {' '.join(map(str, cell))} {i}" for i, cell in enumerate(bricks.cells)), "NMARK= 1", "MARKER_TAG= 1",
        "MARKER_ELEMS= 1", "9 0 1 3 2", ""]))
    pair = add("tetgen", "pair", text_file=lambda name: True)
    pair.mkdir()
    meshio.write(pair / "m.node", meshio.Mesh(tetra.points, [("tetra", tetra.cells)]), file_format="tetgen")
    nodes = "".join("".join(f"{value:10d}" for value in (at + 1, 1, 1, 11)) + "\n"
                    + "".join(f"{value:25.16E}" for value in place) + "\n" for at, place in enumerate(bricks.points))
    elements = "".join("".join(f"{value:10d}" for value in (at + 1, 115, 1, 1, 7, 8)) + "\n"
                       + "".join(f"{value + 1:10d}" for value in cell) + "\n" for at, cell in enumerate(bricks.cells))
    add("unv", "m.unv", vocabulary=(b"2411", b"2412", b"2467", b"2420", b"15", b"-1", b"115", b"118")).write_text(
        f"    -1\n  2411\n{nodes}    -1\n    -1\n  2412\n{elements}    -1\n")
    add("cdb", "m.cdb", vocabulary=ARCHIVE, strict=WHOLE).write_text(archive(named))
    return made
