"""Mesh files: what goes in comes out again under its names; what is wrong is mended and told, or refused in one line."""

from __future__ import annotations

import os
import re
import runpy
from pathlib import Path

import numpy as np
import pytest

import femsub as fs
from femsub.elements import KINDS, jacobians, quadrature, shape_functions
from femsub.meshchecks import checked
from femsub.meshfiles import mesh_bytes

meshio = pytest.importorskip("meshio")
ROOT = Path(__file__).parent.parent


def volume(mesh: fs.Mesh) -> float:
    X, w = quadrature(mesh.kind, 6)
    return float((np.linalg.det(jacobians(mesh.points, mesh.cells, shape_functions(mesh.kind, X)[1])) @ w).sum())


def area(mesh: fs.Mesh) -> float:
    x = mesh.points[mesh.cells]
    following = np.roll(x, -1, axis=1)
    return float((x[..., 0] * following[..., 1] - x[..., 1] * following[..., 0]).sum() / 2)


def changed(mesh: fs.Mesh, **new: object) -> fs.Mesh:
    values = {key: getattr(mesh, key) for key in ("points", "cells", "kind", "sets", "groups", "numbers", "repairs", "name")}
    return fs.Mesh(**{**values, **new})  # type: ignore[arg-type]


def numbered(kind: str) -> fs.Mesh:
    mesh = fs.annulus(1.0, 3.0, 0.5, (2, 8, 1), kind)
    return changed(mesh, groups={"half": np.arange(5)}, numbers=np.arange(len(mesh.points)) + 100)


# ---- meshes made of a grid

@pytest.mark.parametrize("kind", KINDS)
def test_a_block_has_its_volume_and_its_faces(kind: str) -> None:
    mesh = fs.block((2.0, 3.0, 0.7), (3, 2, 1), kind)
    assert volume(mesh) == pytest.approx(4.2, rel=1e-13)
    assert checked(mesh).repairs == ()
    for axis, pair in enumerate((("left", "right"), ("front", "back"), ("bottom", "top"))):
        for name, place in zip(pair, (0.0, (2.0, 3.0, 0.7)[axis]), strict=True):
            assert (mesh.points[mesh.nodes(name), axis] == place).all()
            assert len(mesh.nodes(name)) == np.count_nonzero(np.abs(mesh.points[:, axis] - place) < 1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_an_annulus_closes_and_its_quadratic_cells_follow_the_circle(kind: str) -> None:
    errors = [abs(volume(fs.annulus(1.0, 2.0, 0.5, (1, around, 1), kind)) / (1.5 * np.pi) - 1) for around in (8, 16)]
    order = np.log2(errors[0] / errors[1])
    assert order == pytest.approx(4 if kind[-1].isdigit() else 2, abs=0.2)  # of the area of a polygon, of a parabola
    mesh = checked(fs.annulus(1.0, 2.0, 0.5, (1, 8, 1), kind))
    assert mesh.repairs == ()  # neither double nodes nor a slit
    radius = np.hypot(mesh.points[:, 0], mesh.points[:, 1])
    assert np.allclose(radius[mesh.nodes("inner")], 1) and np.allclose(radius[mesh.nodes("outer")], 2)
    assert np.array_equal(mesh.nodes("top"), np.flatnonzero(mesh.points[:, 2] == 0.5))


@pytest.mark.parametrize("kind", ["quad", "triangle"])
def test_a_rectangle_has_its_area_and_its_edge(kind: str) -> None:
    mesh = fs.rectangle((2.0, 1.0), (3, 4), kind)
    assert area(mesh) == pytest.approx(2.0) and checked(mesh).repairs == ()
    assert len(mesh.nodes("edge")) == 14 and (mesh.points[mesh.nodes("right"), 0] == 2).all()


@pytest.mark.parametrize(("make", "text"), [
    (lambda: fs.block((1, 0, 1), (1, 1, 1)), "lengths must be 3 positive numbers"),
    (lambda: fs.block((1, 1), (1, 1, 1)), "lengths must be 3 positive"),
    (lambda: fs.block((1, 1, 1), (1, 0, 1)), "counts must be 3 whole numbers of 1 or more"),
    (lambda: fs.block((1, 1, 1), (1, 1.5, 1)), "counts must be"),
    (lambda: fs.block((1, 1, 1), (1, 1, 1), "wedge"), "unknown kind of solid element 'wedge'"),
    (lambda: fs.annulus(2, 1, 1), "inner must be below outer"),
    (lambda: fs.annulus(1, 2, 1, (1, 2, 1)), "at least 3 bricks around"),
    (lambda: fs.rectangle((1, 1), (2, 2), "tetra"), "rectangle 'tetra'"),
])
def test_a_grid_that_cannot_be(make, text: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(fs.InputError, match=text):
        make()


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
    ("m.vtu", {"mode": np.zeros(152, complex)}, "give real and imaginary parts apart"),
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
    with pytest.raises(fs.InputError, match="in coordinate systems of their own"):
        fs.read_mesh(path)
    path.write_text("\n".join([*lines, "ENDDATA\n"]).replace("CHEXA,2,5,", "CHEXA,2,,"))
    with pytest.raises(fs.InputError, match="some cells of the mesh file have a property and some have none"):
        fs.read_mesh(path)


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
    assert "1 elements of type MASS skipped" in mesh.repairs[0] and "*NSET reference" in mesh.repairs[1]


@pytest.mark.parametrize(("old", "new", "text"), [
    ("*Element, type=C3D8R", "*Element, type=C3D27", "elements of type C3D27 cannot be read"),
    ("   12, 13, 14\n", "   12, 13\n", "TYPE=C3D8R has 8 numbers, which is no multiple of 9"),
    ("23, 24\n*Nset", "23, 999\n*Nset", "names node 999, which the file does not give"),
    (" clamp, Far End", " clamp, far", "names 'far', which is neither a number nor a set"),
    (" 102, 1., 0., 0.", " 102, 1., 0.", "*NODE has 15 numbers in 4 lines"),
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


# ---- repairs and refusals

def test_mirrored_cells_are_turned_and_told() -> None:
    for kind in KINDS:
        mesh = fs.block((2, 1, 1), (2, 1, 1), kind)
        mended = checked(changed(mesh, points=mesh.points * [-1, 1, 1]))
        assert volume(mended) == pytest.approx(2.0)
        count = len(mesh.cells)
        assert mended.repairs == (f"{count} of {count} {kind} cells were listed in mirrored order, re-ordered",)
        assert np.array_equal(np.sort(mended.cells), np.sort(mesh.cells))


def test_one_mirrored_cell_is_turned() -> None:
    mesh = fs.block((3, 1, 1), (3, 1, 1), "hexahedron")
    cells = mesh.cells.copy()
    cells[1] = cells[1][[4, 5, 6, 7, 0, 1, 2, 3]]
    mended = checked(changed(mesh, cells=cells))
    assert volume(mended) == pytest.approx(3.0) and "1 of 3" in mended.repairs[0]


def test_a_plane_mesh_seen_from_below_is_turned() -> None:
    for kind in ("triangle", "quad"):
        mesh = fs.rectangle((2, 1), (2, 2), kind)
        mended = checked(changed(mesh, cells=mesh.cells[:, ::-1]))
        assert area(mended) == pytest.approx(2.0) and "mirrored order" in mended.repairs[0]


def test_a_cell_turned_inside_out_by_a_stray_node_is_refused() -> None:
    """Its nodes could be listed the other way round, but it would still lie within its neighbours."""
    mesh = fs.block((2, 2, 2), (2, 2, 2), "tetra")
    points = mesh.points.copy()
    inner = int(np.flatnonzero((points == 1).all(axis=1))[0])
    points[inner] = [2.5, 1.1, 0.9]
    with pytest.raises(fs.InputError, match="turned inside out and lie within their neighbours: cell "):
        checked(changed(mesh, points=points))


@pytest.mark.parametrize("kind", ["hexahedron", "hexahedron20", "hexahedron27", "tetra10"])
def test_tangled_cells_are_refused_with_number_and_place(kind: str) -> None:
    mesh = fs.block((4, 1, 1), (4, 1, 1), kind)
    cells = mesh.cells.copy()
    cells[2, [0, 1]] = cells[2, [1, 0]]
    with pytest.raises(fs.InputError, match=rf"1 of {len(cells)} {kind} cells .* tangled or flat .*: cell 2 around \("):
        checked(changed(mesh, cells=cells))


def test_flat_and_concave_and_collapsed_cells_are_refused() -> None:
    mesh = fs.block((1, 1, 1), (1, 1, 1), "hexahedron")
    with pytest.raises(fs.InputError, match=r"1 of 1 hexahedron cells .* tangled or flat"):
        checked(changed(mesh, points=mesh.points * [1, 1, 0]))
    with pytest.raises(fs.InputError, match="name a node twice"):
        checked(changed(mesh, cells=mesh.cells[:, [0, 0, 2, 3, 4, 5, 6, 7]]))
    dart = fs.Mesh([[0, 0], [2, 0], [0.3, 0.3], [0, 2]], [[0, 1, 2, 3]], "quad")
    with pytest.raises(fs.InputError, match="tangled or flat"):
        checked(dart)
    needle = fs.Mesh([[0, 0], [1, 0], [2, 0]], [[0, 1, 2]], "triangle")
    with pytest.raises(fs.InputError, match="tangled or flat"):
        checked(needle)


def test_a_shell_in_space_has_no_side_to_be_on() -> None:
    mesh = fs.rectangle((2, 1), (2, 2), "quad")
    x, y = mesh.points.T
    shell = checked(changed(mesh, points=np.stack([x, y, 0.1 * x * y], axis=1), cells=mesh.cells[:, ::-1]))
    assert shell.repairs == ()


def test_thin_cells_are_no_flat_ones() -> None:
    assert checked(fs.block((1, 1, 1e-4), (2, 2, 1), "tetra10")).repairs == ()


def test_nodes_of_no_cell_are_dropped_and_told(tmp_path: Path) -> None:
    mesh = fs.block((1, 1, 1), (1, 1, 1), "hexahedron")
    points = np.vstack([[[9, 9, 9]], mesh.points, [[8, 8, 8]]])
    path = tmp_path / "m.inp"
    meshio.write(path, meshio.Mesh(points, [("hexahedron", mesh.cells + 1)], point_sets={"top": [9, 2], "far": [0]}))
    back = fs.read_mesh(path)
    assert back.repairs[0] == "2 nodes belong to no cell, dropped: 1, 10" and len(back.points) == 8
    assert list(back.numbers) == list(range(2, 10)) and list(back.numbers[back.nodes("top")]) == [3]
    assert "the set 'top' lost 1 node by that" in back.repairs
    with pytest.raises(fs.InputError, match="the set 'far' of the mesh 'm' is empty"):
        back.nodes("far")
    with pytest.raises(fs.InputError, match="unknown set of nodes of the mesh 'm': 'tops'; did you mean 'top'"):
        back.nodes("tops")


def test_cells_given_twice_are_kept_once() -> None:
    mesh = fs.block((3, 1, 1), (3, 1, 1), "hexahedron")
    twice = changed(mesh, cells=mesh.cells[[2, 0, 1, 0, 2]], groups={"a": [0, 1], "b": [3, 4], "c": [2]})
    mended = checked(twice)
    assert mended.repairs == ("2 cells were given twice, kept once",) and volume(mended) == pytest.approx(3.0)
    centre = {name: sorted(mended.points[mended.cells[rows]].mean(axis=1)[:, 0]) for name, rows in mended.groups.items()}
    assert centre == {"a": [0.5, 2.5], "b": [0.5, 2.5], "c": [1.5]}


def test_parts_that_were_not_merged_are_told() -> None:
    left = fs.block((1, 1, 1), (1, 1, 1), "hexahedron")
    points, cells = [left.points, left.points + np.array([1, 0, 1e-7])], [left.cells, left.cells + 8]
    both = fs.Mesh(np.vstack(points), np.vstack(cells), "hexahedron")
    assert checked(both).repairs == ("4 pairs of nodes coincide (not merged: their parts are not joined there)",
                                     "the mesh is in 2 separate pieces")
    assert checked(checked(both)).repairs == checked(both).repairs


def mixed(top: str) -> meshio.Mesh:
    mesh = fs.block((2, 1, 1), (2, 1, 1), "hexahedron")
    cells = mesh.cells[1]
    other = {"wedge": [[cells[i] for i in (0, 1, 2, 4, 5, 6)]], "tetra": [[cells[i] for i in (0, 1, 3, 4)]]}[top]
    return meshio.Mesh(mesh.points, [("hexahedron", mesh.cells[:1]), (top, other), ("quad", [[0, 1, 3, 2]])])


def test_mixed_and_unknown_kinds(tmp_path: Path) -> None:
    path = tmp_path / "m.vtu"
    meshio.write(path, mixed("tetra"))
    with pytest.raises(fs.InputError, match=r"m\.vtu mixes 1 hexahedron, 1 tetra cells"):
        fs.read_mesh(path)
    chosen = fs.read_mesh(path, kind="hexahedron")
    assert chosen.repairs[0] == "1 tetra cells dropped, as kind='hexahedron' asks" and len(chosen.cells) == 1
    assert "1 quad cells of lower dimension, in no set, dropped" in chosen.repairs
    assert fs.read_mesh(path, kind="quad").repairs[0] == "1 hexahedron, 1 tetra cells dropped, as kind='quad' asks"
    with pytest.raises(fs.InputError, match="has no tetra10 cells; it has 1 hexahedron, 1 quad, 1 tetra"):
        fs.read_mesh(path, kind="tetra10")
    with pytest.raises(fs.InputError, match="unknown kind of cell 'hexa'"):
        fs.read_mesh(path, kind="hexa")
    meshio.write(path, mixed("wedge"))
    with pytest.raises(fs.InputError, match=r"has 1 hexahedron, 1 wedge cells, but femsub knows only .*kind='hexahedron'"):
        fs.read_mesh(path)


def test_plane_points_for_solid_cells(tmp_path: Path) -> None:
    with pytest.raises(fs.InputError, match="tetra cells are 3D, but the points of 'flat' have 2 coordinates"):
        fs.Mesh([[0, 0], [1, 0], [0, 1], [1, 1]], [[0, 1, 2, 3]], "tetra", name="flat")
    path = tmp_path / "flat.inp"
    path.write_text("*NODE\n1,0,0\n2,1,0\n3,0,1\n4,1,1\n*ELEMENT, TYPE=C3D4\n1,1,2,3,4\n")
    with pytest.raises(fs.InputError, match=r"1 of 1 tetra cells of the mesh 'flat' are tangled or flat .*: cell 1 around"):
        fs.read_mesh(path)


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


@pytest.mark.parametrize("suffix", [".inp", ".bdf", ".msh", ".vtu", ".vtk", ".xdmf", ".med", ".txt", ".unv", ""])
def test_a_text_that_is_no_mesh(suffix: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / f"letter{suffix}"
    path.write_text("Dear reader,\nthis is no mesh.\n")
    with pytest.raises(fs.InputError, match=re.escape(str(path))) as caught:
        fs.read_mesh(path)
    assert "\n" not in str(caught.value)
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


# ---- the meshes that come along

SHIPPED = {  # kind, size (volume or area), how near cells come to it, sets
    "beam.inp": ("hexahedron20", 0.5 * 0.03 * 0.02, 1e-12, {"clamp", "tip", "contact", "beam"}),
    "disc.vtu": ("hexahedron20", np.pi * (0.15**2 - 0.05**2) * 0.012, 1e-5, {"inner", "rim", "contact", "top", "bottom"}),
    "plate-with-hole.msh": ("triangle", 0.4 * 0.2 - np.pi * 0.04**2, 2e-3, {"clamp", "tip", "hole", "plate"}),
    "bracket.msh": ("tetra10", (0.12 + 0.1) * 0.08 * 0.01 - 4 * np.pi * 0.006**2 * 0.01, 1e-3, {"bolts", "tip", "bracket"}),
}


def test_every_shipped_mesh_is_listed() -> None:
    assert {path.name for path in (ROOT / "meshes").iterdir()} == set(SHIPPED)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_meshes(name: str) -> None:
    kind, size, near, sets = SHIPPED[name]
    mesh = fs.read_mesh(ROOT / "meshes" / name)
    assert mesh.kind == kind and set(mesh.sets) == sets and mesh.repairs == ()
    assert (area(mesh) if kind == "triangle" else volume(mesh)) == pytest.approx(size, rel=near)
    assert all(len(mesh.nodes(label)) > 5 for label in sets)
    assert (ROOT / "meshes" / name).stat().st_size < 1_000_000


@pytest.mark.parametrize("name", ["beam.inp", "disc.vtu"])
def test_the_script_makes_the_shipped_meshes(name: str) -> None:
    made = runpy.run_path(str(ROOT / "scripts" / "make-meshes.py"))[Path(name).stem]()
    shipped = fs.read_mesh(ROOT / "meshes" / name)
    assert np.allclose(shipped.points, made.points, rtol=0, atol=1e-15) and np.array_equal(shipped.cells, made.cells)
    assert all(np.array_equal(shipped.nodes(label), nodes) for label, nodes in made.sets.items())
