"""Mesh files of many programs: what goes in comes out again under its names, and no file is half read or half written."""

from __future__ import annotations

import os
import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_meshes import changed, volume

import femsub as fs
from femsub.components.solid_elements import KINDS
from femsub.io.mesh_files import mesh_bytes

meshio = pytest.importorskip("meshio")
ROOT = Path(__file__).parent.parent


def numbered(kind: str) -> fs.Mesh:
    mesh = fs.annulus(1.0, 3.0, 0.5, (2, 8, 1), kind)
    return changed(mesh, groups={"half": np.arange(5)}, numbers=np.arange(len(mesh.points)) + 100)


# ---- round trips

@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".msh", ".inp"])
@pytest.mark.parametrize("kind", ["hexahedron", "hexahedron20", "tetra10"])
def test_what_is_written_is_read_again(kind: str, suffix: str, tmp_path: Path) -> None:
    mesh = numbered(kind)
    back = fs.read_mesh(fs.write_mesh(tmp_path / f"ring{suffix}", mesh))
    assert back.kind == kind and back.name == "ring" and back.repairs == ()
    assert np.array_equal(back.points, mesh.points) and np.array_equal(back.cells, mesh.cells)
    for name, nodes in mesh.sets.items():
        assert np.array_equal(back.nodes(name), nodes)
    assert np.array_equal(back.groups["half"], np.arange(5))
    assert np.array_equal(back.nodes("half"), np.unique(mesh.cells[:5]))
    assert np.array_equal(back.numbers, mesh.numbers if suffix != ".inp" else np.arange(len(mesh.points)) + 1)


@pytest.mark.parametrize("kind", [*KINDS, "triangle", "quad"])
def test_shapes_in_vtu(kind: str, tmp_path: Path) -> None:
    mesh = fs.rectangle((2, 1), (3, 2), kind) if kind in ("triangle", "quad") else numbered(kind)
    rng = np.random.default_rng(1)
    mode, height = rng.normal(size=(len(mesh.points), 3)), rng.normal(size=len(mesh.points))
    path = fs.write_mesh(tmp_path / "modes.vtu", mesh, {"mode 1": mode, "w": height})
    found = meshio.read(path)
    assert np.array_equal(found.point_data["mode 1"], mode) and np.array_equal(found.point_data["w"], height)
    assert found.cells[0].type == kind and np.array_equal(found.cells[0].data, mesh.cells)
    assert found.points.shape[1] == 3  # ParaView takes no other
    assert mesh_bytes(mesh, {"mode 1": mode, "w": height}) == path.read_bytes()


def test_inp_files_name_elements_that_calculix_has() -> None:
    assert b"*ELEMENT, TYPE=C3D20\n" in mesh_bytes(numbered("hexahedron20"), suffix=".inp")


@pytest.mark.parametrize(("path", "shapes", "text"), [
    ("m.stl", {}, "meshes are written as .vtu, .vtk, .msh, .inp, not as '.stl'"),
    ("m", {}, "not as 'a file without suffix'"),
    ("m.vtu", {"mode": np.zeros((3, 3))}, "'mode' must be finite, of shape"),
    ("m.vtu", {"mode": np.full(152, np.nan)}, "'mode' must be finite"),
    ("m.vtu", {"mode": np.zeros(152, complex)}, "Give the real and the imaginary part separately"),
    ("m.vtu", {"set:top": np.zeros(152)}, "taken for sets"),
    ("m.inp", {"mode": np.zeros(152)}, "hold no shapes"),
    ("/dev/null/m.vtu", {}, "the mesh file /dev/null/m.vtu cannot be written"),
    ("m.vtk", {"mode 1": np.zeros(152)}, "spaces in field names"),
])
def test_what_cannot_be_written_leaves_nothing(path: str, shapes: dict, text: str, tmp_path: Path,
                                               capfd: pytest.CaptureFixture[str]) -> None:
    mesh = numbered("hexahedron20")
    assert len(mesh.points) == 152 or not shapes
    with pytest.raises(fs.InputError, match=re.escape(text)):
        fs.write_mesh(tmp_path / path, mesh, shapes)
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "m.vtu"
    path.write_text("old")

    def refuse(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", refuse)  # the last thing that can fail
    with pytest.raises(fs.InputError, match="No space left"):
        fs.write_mesh(path, numbered("hexahedron"))
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["m.vtu"]


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".msh", ".inp"])
def test_a_temporary_folder_without_room_is_named(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What meshio writes goes there first."""
    place, opened = tmp_path / "place", open
    place.mkdir()

    def full(path: Any, *given: Any, **options: Any) -> Any:
        if str(path).startswith(str(place)):
            raise OSError(28, "No space left on device")
        return opened(path, *given, **options)

    monkeypatch.setattr(tempfile, "tempdir", str(place))
    monkeypatch.setattr("builtins.open", full)
    with pytest.raises(fs.NotEnoughMemoryError, match=rf"{place} cannot take temporary files, .* MB .No space left.*Set TMPDIR"):
        fs.write_mesh(tmp_path / f"m{suffix}", numbered("hexahedron"))
    monkeypatch.undo()
    assert os.listdir(tmp_path) == ["place"] and not os.listdir(place)


NAMES = ["x<y", "R&D", "a\nb", "a\tb", "a b", "Fläche", "a,b", 'q"q', "it's", "$End", "a=b", " lead", "trail ", "", "*star",
         "set:x", "7", "-1", "a%20b", "日本", "\x07bell", "number"]


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".msh", ".inp"])
def test_a_name_is_read_again_or_not_written(suffix: str, tmp_path: Path) -> None:
    mesh = fs.block((1, 1, 1), (2, 1, 1), "hexahedron")
    written = 0
    for name in NAMES:
        try:
            named = changed(mesh, sets={name: [0, 3], "other": [1]}, groups={name + "g": [1]})
            path = fs.write_mesh(tmp_path / f"m{suffix}", named)
        except fs.InputError as error:
            assert repr(name) in str(error) or "spaces" in str(error)
            continue
        back, written = fs.read_mesh(path), written + 1
        assert set(back.sets) == {name, "other", name + "g"} and back.nodes(name).tolist() == [0, 3], name
        assert {key: rows.tolist() for key, rows in back.groups.items()} == {name + "g": [1]}
    assert written >= {".vtu": 19, ".vtk": 16, ".msh": 19, ".inp": 14}[suffix]


def test_names_that_are_the_same_in_an_inp_file(tmp_path: Path) -> None:
    mesh = changed(fs.block((1, 1, 1), (1, 1, 1), "hexahedron"), sets={"Top": [0], "TOP": [1]})
    with pytest.raises(fs.InputError, match=r"in \.inp files the names 'Top' and 'TOP' are the same"):
        fs.write_mesh(tmp_path / "m.inp", mesh)
    back = fs.read_mesh(fs.write_mesh(tmp_path / "m.vtu", mesh))
    assert back.nodes("Top").tolist() == [0] and back.nodes("TOP").tolist() == [1]


# ---- what other programs write

def gmsh_pair() -> meshio.Mesh:
    """Two bricks, a volume group each, a surface group, one without a name, a face in no group, and a point."""
    mesh = fs.block((2, 1, 1), (2, 1, 1), "hexahedron")
    quads = [[0, 1, 3, 2], [8, 9, 11, 10], [4, 5, 7, 6]]
    return meshio.Mesh(mesh.points, [("hexahedron", mesh.cells), ("quad", quads), ("vertex", [[11]])],
                       cell_data={"gmsh:physical": [np.array([1, 2]), np.array([7, 8, 0]), np.array([3])],
                                  "gmsh:geometrical": [np.array([1, 2]), np.array([1, 2, 3]), np.array([1])]},
                       field_data={"steel": np.array([1, 3]), "pad": np.array([2, 3]), "clamp": np.array([7, 2]),
                                   "tip": np.array([3, 0])})


def test_physical_groups_of_gmsh(tmp_path: Path) -> None:
    path = tmp_path / "pair.msh"
    meshio.write(path, gmsh_pair(), file_format="gmsh22", binary=False)
    mesh = fs.read_mesh(path)
    assert set(mesh.sets) == {"steel", "pad", "clamp", "tip", "surface-8"}
    assert mesh.repairs == ("1 quad cells of lower dimension, in no set, dropped",)
    assert {name: list(rows) for name, rows in mesh.groups.items()} == {"steel": [0], "pad": [1]}
    assert list(mesh.nodes("clamp")) == [0, 1, 2, 3] and list(mesh.nodes("tip")) == [11]
    assert list(mesh.nodes("pad")) == list(range(4, 12)) and list(mesh.nodes("surface-8")) == [8, 9, 10, 11]


def test_a_set_and_a_group_of_the_same_name_are_apart(tmp_path: Path) -> None:
    mesh = changed(numbered("hexahedron"), groups={"top": [0]})
    back = fs.read_mesh(fs.write_mesh(tmp_path / "m.vtu", mesh))
    assert np.array_equal(back.nodes("top"), mesh.nodes("top")) and list(back.groups["top"]) == [0]


def test_nastran_properties_and_numbers(tmp_path: Path) -> None:
    lines = ["BEGIN BULK"]
    mesh = fs.block((2, 1, 1), (2, 1, 1), "hexahedron")
    lines += [f"GRID,{10 * i + 7},,{x},{y},{z}" for i, (x, y, z) in enumerate(mesh.points)]
    lines += [f"CHEXA,{i + 1},{4 + i},{','.join(str(10 * n + 7) for n in cell[:6])},+\n+,{cell[6] * 10 + 7},{cell[7] * 10 + 7}"
              for i, cell in enumerate(mesh.cells)]
    path = tmp_path / "pair.bdf"
    path.write_text("\n".join([*lines, "ENDDATA\n"]))
    back = fs.read_mesh(path)
    assert np.array_equal(back.points, mesh.points) and np.array_equal(back.cells, mesh.cells)
    assert list(back.numbers) == [10 * i + 7 for i in range(12)]
    assert {name: list(rows) for name, rows in back.groups.items()} == {"property-4": [0], "property-5": [1]}
    assert list(back.nodes("property-4")) == list(range(8))
    path.write_text("\n".join([*lines[1:], "ENDDATA\n"]))  # as Gmsh writes it
    assert np.array_equal(fs.read_mesh(path).cells, mesh.cells)
    path.write_text("\n".join([*lines, "ENDDATA\n"]).replace("GRID,7,,", "GRID,7,3,").replace("GRID,17,,", "GRID,17,3,"))
    with pytest.raises(fs.InputError, match=r"gives nodes in the coordinate system 3 .* but it has no CORD1R"):
        fs.read_mesh(path)
    path.write_text("\n".join([*lines, "ENDDATA\n"]).replace("CHEXA,2,5,", "CHEXA,2,,"))  # then it is the element's number
    assert {name: list(rows) for name, rows in fs.read_mesh(path).groups.items()} == {"property-4": [0], "property-2": [1]}


INP = """** two bricks, as Abaqus/CAE writes one part
*Heading
*Part, name=Bar
*Node
 101, 0., 0., 0.
 102, 1., 0., 0.
 103, 1., 1., 0.
 104, 0., 1., 0.
*NODE, NSET=Middle
 11, 0., 0., 1.
 12, 1., 0., 1.0D+00
 13, 1., 1., 1.
 14, 0., 1., 1.
*NODE
 21, 0., 0., 2.
 22, 1., 0., 2.
 23, 1., 1., 2.
 24, 0., 1., 2.
*Element, type=C3D8R, elset=low
5, 101, 102, 103, 104, 11,
   12, 13, 14
*Element, type=mass, elset=point
6, 11
*Element, type=C3D8,
   elset=high
7, 11, 12, 13, 14, 21, 22, 23, 24
*Nset, nset="far end", generate
 21, 24, 1
*Nset, nset=Clamp
 101, 102,
 103, 104
*Nset, nset=both
 clamp, Far End
 11
*Nset, nset=MIDDLE
 24
*Elset, elset=all
 low, high
*Surface, name=s
 all, S1
*End Part
*Assembly, name=Assembly
*Instance, name=Bar-1, part=Bar
*End Instance
*Node
 1, 9., 9., 9.
*Nset, nset=reference
 1
*Nset, nset=Pick, instance=Bar-1
 12, 13
*End Assembly
*Step
*Boundary
 Clamp, 1, 3
*Node print, nset=Clamp
U
*End Step
"""


def test_an_abaqus_file_with_its_numbers_and_sets(tmp_path: Path) -> None:
    path = tmp_path / "bar.inp"
    path.write_text(INP)
    mesh = fs.read_mesh(path)
    named = {name: sorted(mesh.numbers[rows].tolist()) for name, rows in mesh.sets.items()}
    assert named["Middle"] == [11, 12, 13, 14, 24] and named["far end"] == [21, 22, 23, 24] and named["Pick"] == [12, 13]
    assert named["Clamp"] == [101, 102, 103, 104] and named["both"] == sorted([*named["Clamp"], *named["far end"], 11])
    assert named["low"] == [11, 12, 13, 14, 101, 102, 103, 104] and "reference" not in named
    assert {name: list(rows) for name, rows in mesh.groups.items()} == {"low": [0], "high": [1], "all": [0, 1]}
    assert volume(mesh) == pytest.approx(2.0)
    assert mesh.points[np.flatnonzero(mesh.numbers == 12)[0]].tolist() == [1, 0, 1]
    assert "1 element of type MASS skipped" in mesh.repairs[0] and "*NSET reference" in mesh.repairs[1]


@pytest.mark.parametrize(("old", "new", "text"), [
    ("*Element, type=C3D8R", "*Element, type=C3D27", "elements of type C3D27 cannot be read"),
    ("   12, 13, 14\n", "   12, 13\n", "TYPE=C3D8R has 8 numbers, which is no multiple of 9"),
    ("23, 24\n*Nset", "23, 999\n*Nset", "names node 999, which the file does not give"),
    (" clamp, Far End", " clamp, far", "names 'far', which is neither a number nor a set"),
    (" 102, 1., 0., 0.", " 102, 1., 0., 0., 0., 0., 0., 0., 0.", "*NODE has 21 numbers in 4 lines"),
    (" 102, 1., 0., 0.", " 102, 1., zero, 0.", "are not all numbers"),
    (" 102, 1., 0., 0.", " 101, 1., 0., 0.", "gives 1 nodes more than once, the first is node 101"),
    ("part=Bar\n*End", "part=Bar\n 0., 0., 5.\n*End", "a part that is moved"),
    ("*Element, type=C3D8,\n   elset=high", "*User Element", "names 'high', which is neither"),
    ("*Node\n 101", "*Include, input=other.inp\n*Node\n 101", "includes 'other.inp', which is not a file"),
    ("*Node\n 101", "*System\n0,0,0,1,1,0\n*Node\n 101", "*SYSTEM"),
])
def test_an_abaqus_file_that_is_wrong(old: str, new: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / "bar.inp"
    assert old in INP
    path.write_text(INP.replace(old, new))
    with pytest.raises(fs.InputError, match=re.escape(text)):
        fs.read_mesh(path)


def test_an_included_file(tmp_path: Path) -> None:
    head, tail = INP.split("*Element, type=C3D8R", 1)
    (tmp_path / "nodes.inp").write_text(head.replace("*Part, name=Bar\n", ""))
    (tmp_path / "bar.inp").write_text("*Include, input=nodes.inp\n*Part, name=Bar\n*Element, type=C3D8R" + tail)
    assert volume(fs.read_mesh(tmp_path / "bar.inp")) == pytest.approx(2.0)


# ---- files that cannot be read

@pytest.mark.parametrize("name", ["beam.inp", "disc.vtu", "plate-with-hole.msh", "bracket.msh"])
def test_files_cut_short(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    whole = (ROOT / "meshes" / name).read_bytes()
    for share in (0.0, 0.003, 0.1, 0.45, 0.55, 0.9, 0.99, 1.0):
        path = tmp_path / name
        path.write_bytes(whole[:min(int(share * len(whole)), len(whole) - 3)])
        with pytest.raises(fs.InputError, match=re.escape(str(path))) as caught:
            fs.read_mesh(path)
        assert "\n" not in str(caught.value) and len(str(caught.value)) < 400
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("suffix", [".inp", ".bdf", ".msh", ".vtu", ".vtk", ".xdmf", ".med", ".txt", ".dat", ".unv", ""])
def test_a_text_that_is_no_mesh(suffix: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / f"letter{suffix}"
    path.write_text("Dear reader,\nthis is no mesh.\n")
    with pytest.raises(fs.InputError, match=re.escape(str(path))) as caught:
        fs.read_mesh(path)
    assert "\n" not in str(caught.value)
    assert suffix not in (".txt", ".dat", ".unv", "") or "neither the ending" in str(caught.value)
    path.write_bytes(bytes(range(256)) * 4)
    with pytest.raises(fs.InputError):
        fs.read_mesh(path)
    assert capfd.readouterr() == ("", "")


def test_no_file_and_a_folder(tmp_path: Path) -> None:
    with pytest.raises(fs.InputError, match="there is no mesh file"):
        fs.read_mesh(tmp_path / "none.inp")
    with pytest.raises(fs.InputError, match="is a folder"):
        fs.read_mesh(tmp_path)


def test_vtu_in_pieces_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.vtu"
    text = mesh_bytes(fs.block((1, 1, 1), (1, 1, 1), "hexahedron")).decode()
    piece = text[text.index("<Piece "):text.index("</Piece>") + len("</Piece>")]
    path.write_text(text.replace(piece, piece + piece))
    with pytest.raises(fs.InputError, match="several pieces"):
        fs.read_mesh(path)
