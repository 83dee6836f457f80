"""Gmsh's .msh: every physical group of an entity, every version in text and in binary, and nothing beyond what is counted."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import femsub as fs

meshio = pytest.importorskip("meshio")

NODES = "1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 1\n"
#: two tetrahedra in volumes 1 (physical 1, 2, 9) and 2 (9), a face in surface 1 (physical 7, 8)
FOUR = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
1
3 9 "whole"
$EndPhysicalNames
$Entities
0 0 1 2
1 0 0 0 1 1 1 2 7 8 0
1 0 0 0 1 1 1 3 1 2 9 1 1
2 0 0 0 1 1 1 1 9 1 -1
$EndEntities
$Nodes
1 5 1 5
3 1 0 5
1
2
3
4
5
0 0 0
1 0 0
0 1 0
0 0 1
1 1 1
$EndNodes
$Elements
3 3 1 3
2 1 2 1
1 1 2 3
3 1 4 1
2 1 2 3 4
3 2 4 1
3 2 3 4 5
$EndElements
"""
TWO = f"""$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
3 9 "whole"
$EndPhysicalNames
$Nodes
5
{NODES}$EndNodes
$Elements
3
1 2 2 7 1 1 2 3
2 4 2 9 1 1 2 3 4
3 4 3 9 2 1 2 3 4 5
$EndElements
"""


def read(folder: Path, text: str | bytes) -> fs.Mesh:
    path = folder / "m.msh"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return fs.read_mesh(path)


def test_every_physical_group_of_an_entity(tmp_path: Path) -> None:
    mesh = read(tmp_path, FOUR)
    assert {name: rows.tolist() for name, rows in mesh.groups.items()} == {"volume-1": [0], "volume-2": [0], "whole": [0, 1]}
    assert mesh.nodes("surface-7").tolist() == mesh.nodes("surface-8").tolist() == [0, 1, 2]
    assert mesh.nodes("volume-2").tolist() == [0, 1, 2, 3] and mesh.repairs == ()


def test_version_2(tmp_path: Path) -> None:
    mesh = read(tmp_path, TWO)
    assert {name: rows.tolist() for name, rows in mesh.groups.items()} == {"whole": [0, 1]}
    assert mesh.nodes("surface-7").tolist() == [0, 1, 2] and mesh.repairs == ()


@pytest.mark.parametrize("form", ["2.2", "4.0", "4.1"])
@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("kind", ["hexahedron", "hexahedron20", "hexahedron27", "tetra", "tetra10"])
def test_what_meshio_writes(kind: str, binary: bool, form: str, tmp_path: Path) -> None:
    mesh = fs.annulus(1.0, 3.0, 0.5, (2, 8, 1), kind)
    path = tmp_path / "m.msh"
    meshio.gmsh.write(path, meshio.Mesh(mesh.points, [(kind, mesh.cells)]), fmt_version=form, binary=binary)
    back = fs.read_mesh(path)
    assert np.array_equal(back.cells, mesh.cells) and np.allclose(back.points, mesh.points, rtol=1e-15, atol=1e-15)


def test_long_runs_of_elements_of_alternating_kinds(tmp_path: Path) -> None:
    """Version 2 lists elements of any kind line by line: each run of one kind is taken whole, however long."""
    grid = fs.block((8, 8, 8), (8, 8, 8), "tetra")
    lines = [f"{i + 1} 4 2 1 1 {' '.join(map(str, cell + 1))}" for i, cell in enumerate(grid.cells)]
    lines[700:700] = [f"{9000 + i} 2 2 5 1 {' '.join(map(str, cell[:3] + 1))}" for i, cell in enumerate(grid.cells[:3])]
    lines[5:5] = ["9990 15 2 6 1 1", "9991 2 3 5 1 0 1 2 3"]
    nodes = "".join(f"{i + 1} {x} {y} {z}\n" for i, (x, y, z) in enumerate(grid.points))
    mesh = read(tmp_path, f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{len(grid.points)}\n{nodes}$EndNodes\n$Elements\n"
                + "\n".join([str(len(lines)), *lines, "$EndElements\n"]))
    assert np.array_equal(mesh.cells, grid.cells) and len(mesh.groups["volume-1"]) == 3072
    assert mesh.nodes("point-6").tolist() == [0] and mesh.nodes("surface-5").tolist()[:3] == [0, 1, 2]


def test_names_in_latin_1_and_names_that_differ_in_case_or_behind_a_comma(tmp_path: Path) -> None:
    text = TWO.replace('1\n3 9 "whole"', '3\n3 9 "Fläche, 1"\n2 7 "Fläche, 2"\n3 1 "FLÄCHE, 1"')
    text = text.replace("2 4 2 9 1 1", "2 4 2 1 1 1")
    for encoding in ("utf-8", "latin-1"):
        mesh = read(tmp_path, text.encode(encoding))
        assert set(mesh.sets) == {"Fläche, 1", "Fläche, 2", "FLÄCHE, 1"} and set(mesh.groups) == {"Fläche, 1", "FLÄCHE, 1"}


@pytest.mark.parametrize(("text", "old", "new", "why"), [
    (FOUR, "3 3 1 3\n", "3 4 1 4\n", "$Elements has 3 elements, but says 4"),
    (FOUR, "3 3 1 3\n", "4 3 1 3\n", "$Elements has fewer numbers than it says"),
    (FOUR, "1 5 1 5\n", "1 99999999999 1 5\n", "$Nodes has 5 nodes, but says 99999999999"),
    (FOUR, "3 1 0 5\n", "3 1 0 99999999999\n", "$Nodes has fewer numbers than it says"),
    (FOUR, "3 2 4 1\n", "3 5 4 1\n", "names the volume 5, which $Entities does not give"),
    (FOUR, "3 2 4 1\n", "3 2 29 1\n", "elements of Gmsh's type 29"),
    (FOUR, "3 2 4 1\n", "2 1 4 1\n", "a tetra belongs to an entity of dimension 2"),
    (FOUR, "3 2 3 4 5\n", "3 2 3 4 99999999999\n", "names node 99999999999, which the file does not give"),
    (FOUR, "3 2 3 4 5\n", "3 2 3 4.5 5\n", "the data of $Elements are not all numbers"),
    (FOUR, "3 2 3 4 5\n", "3 2 3 4 5 6\n", "$Elements has 1 numbers more than it says"),
    (FOUR, "4\n5\n0 0", "4\n4\n0 0", "gives 1 nodes more than once, the first is node 4"),
    (FOUR, "$EndElements", "", "$Elements does not end: is it cut short?"),
    (FOUR, "$Entities", "$PartitionedEntities", "it is partitioned"),
    (FOUR, "1\n3 9", "2\n3 9", "there are 1 physical names where '2' should be"),
    (TWO, "\n3\n1 2 2", "\n4\n1 2 2", "$Elements ends where 1 elements should follow"),
    (TWO, "\n3\n1 2 2", "\n2\n1 2 2", "numbers more than it says"),
    (TWO, "\n5\n1 0", "\n6\n1 0", "$Nodes has fewer numbers than it says"),
    (TWO, "2 4 2 9 1 1", "2 4 -2 9 1 1", "elements with -2 tags where 2 should follow"),
])
def test_what_is_refused(text: str, old: str, new: str, why: str, tmp_path: Path) -> None:
    assert text.count(old) == 1
    with pytest.raises(fs.InputError, match=re.escape(why)) as caught:
        read(tmp_path, text.replace(old, new))
    assert "m.msh" in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("form", ["gmsh22", "gmsh"])
def test_every_cut_of_a_binary_file_is_refused(form: str, tmp_path: Path) -> None:
    mesh, path = fs.block((1, 1, 1), (1, 1, 1), "hexahedron"), tmp_path / "whole.msh"
    meshio.write(path, meshio.Mesh(mesh.points, [("hexahedron", mesh.cells)]), file_format=form)
    whole = path.read_bytes()
    whole = whole[:whole.index(b"$EndElements") + 12]
    assert len(read(tmp_path, whole).cells) == 1
    for size in range(len(whole)):
        with pytest.raises(fs.InputError):
            read(tmp_path, whole[:size])
