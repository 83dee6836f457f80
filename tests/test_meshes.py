"""Meshes: those made of a grid, those that come along; what is wrong is mended and told, or refused in one line."""

from __future__ import annotations

from pathlib import Path

import mademeshes
import numpy as np
import pytest

import femsub as fs
from femsub.components.mesh_checks import checked
from femsub.components.solid_elements import KINDS, jacobians, quadrature, shape_functions

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


@pytest.mark.parametrize("kind", KINDS)
def test_a_sector_lies_on_its_annulus(kind: str) -> None:
    mesh = checked(fs.annulus(1.0, 2.0, 0.5, (2, 4, 1), kind, sector=(-0.4, 0.6)))
    assert mesh.repairs == () and volume(mesh) == pytest.approx(0.75, rel=1e-5 if kind[-1].isdigit() else 2e-2)
    angle = np.arctan2(mesh.points[:, 1], mesh.points[:, 0])
    assert np.allclose(angle[mesh.nodes("start")], -0.4) and np.allclose(angle[mesh.nodes("end")], 0.6)
    assert np.allclose(np.hypot(*mesh.points[mesh.nodes("inner"), :2].T), 1) and np.abs(angle - 0.1).max() < 0.5 + 1e-9
    whole = fs.annulus(1.0, 2.0, 0.5, (2, 4, 1), kind)
    assert set(mesh.sets) - set(whole.sets) == {"start", "end"}


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
    (lambda: fs.annulus(1, 2, 1, (1, 1, 1), sector=(0, 4)), "at least 2 bricks around"),
    (lambda: fs.annulus(1, 2, 1, sector=(0, 7)), "less than a full turn"),
    (lambda: fs.annulus(1, 2, 1, sector=(1, 0)), "lo < hi"),
    (lambda: fs.rectangle((1, 1), (2, 2), "tetra"), "rectangle 'tetra'"),
])
def test_a_grid_that_cannot_be(make, text: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(fs.InputError, match=text):
        make()


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


def test_a_line_between_nodes_at_the_same_place_is_told_to_have_no_length() -> None:
    spring = fs.Mesh([[0, 0, 0], [1, 0, 0], [1, 0, 0]], [[0, 1], [1, 2]], "line")
    with pytest.raises(fs.InputError, match=r"1 of 2 line cells .* have no length: cell 1 around \(1, 0, 0\). Leave them out"):
        checked(spring)


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


# ---- a mesh made by hand

STEEL = fs.Material(E=2.1e11, nu=0.3, rho=7850.0)


def test_a_cell_twice_would_double_its_mass() -> None:
    mesh = fs.block((3, 1, 1), (3, 1, 1), "hexahedron")
    twice = changed(mesh, cells=np.vstack([mesh.cells, mesh.cells[[1]][:, [4, 5, 6, 7, 0, 1, 2, 3]]]))
    with pytest.raises(fs.InputError, match=r"1 cell of 'block' is given twice. The first is cell 3, which is cell 1 again"):
        fs.solid(twice, STEEL)
    flat = fs.rectangle((2, 1), (2, 1), "quad")
    with pytest.raises(fs.InputError, match="1 cell of 'rectangle' is given twice"):
        fs.plate(changed(flat, cells=flat.cells[[0, 1, 0]]), E=1, nu=0.3, rho=1, thickness=0.01)


def test_unused_nodes_are_named_by_number() -> None:
    mesh = fs.block((1, 1, 1), (1, 1, 1), "hexahedron")
    spare = fs.Mesh(np.vstack([mesh.points, [[5, 5, 5], [6, 6, 6]]]), mesh.cells, "hexahedron", numbers=np.arange(10) * 10)
    with pytest.raises(fs.InputError, match="2 nodes of 'mesh' belong to no cell: number 80, 90"):
        fs.solid(spare, STEEL)


TETRA = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]


@pytest.mark.parametrize(("arguments", "text"), [
    ({"points": np.array(TETRA) * (1 + 1j)}, "points must be real numbers, not complex128"),
    ({"points": [*TETRA[:3], [0, 0]]}, "points must be rows of the same length"),
    ({"points": [["a"] * 3] * 4}, "points must be real numbers, not <U1"),
    ({"cells": [[0, 1, 2, 3], [0]]}, "cells must be rows of the same length"),
    ({"cells": [[0, 1, 2, 3.5]]}, "cells must hold whole numbers, not float64"),
    ({"cells": None}, "cells must have the shape (m, 4) for tetra, not ()"),
    ({"kind": ["tetra"]}, "unknown kind of cell ['tetra']"),
    ({"numbers": [1, 2, 3, 4.5]}, "numbers must be whole numbers, but node 3, counted from 0, has 4.5"),
    ({"numbers": [1, 2, 3, 3]}, "numbers must be unique, but 3 comes twice"),
    ({"numbers": ["a", "b", "c", "d"]}, "numbers must be real numbers, not <U1"),
    ({"numbers": [1, 2, 3]}, "numbers must have 4 entries"),
    ({"numbers": [1, 2, 3, float("nan")]}, "numbers must be whole numbers"),
    ({"sets": ["left"]}, "sets must be a dict of names and rows"),
    ({"sets": {7: [0]}}, "each name in sets must be a string, not 7"),
    ({"sets": {"a": [[0, 1], [2]]}}, "set 'a' must be rows of the same length"),
    ({"groups": {"a": [0.5]}}, "group 'a' must hold whole numbers, not float64"),
])
def test_arguments_of_the_wrong_kind(arguments: dict, text: str) -> None:
    with pytest.raises((fs.InputError, fs.InputTypeError)) as caught:
        fs.Mesh(**{"points": TETRA, "cells": [[0, 1, 2, 3]], "kind": "tetra", **arguments})
    assert text in str(caught.value)


def test_whole_numbers_in_floats_are_numbers() -> None:
    mesh = fs.Mesh(TETRA, [[0, 1, 2, 3]], "tetra", numbers=[10.0, 20.0, 30.0, 40.0], repairs=["one"])
    assert mesh.numbers.tolist() == [10, 20, 30, 40] and mesh.numbers.dtype.kind == "i" and mesh.repairs == ("one",)
    with pytest.raises(fs.InputError, match="unknown set of nodes"):
        mesh.nodes(["left"])  # type: ignore[arg-type]


# ---- the meshes that come along

SHIPPED = {  # kind, size (volume or area), how near cells come to it, sets
    "beam.inp": ("hexahedron20", 0.5 * 0.03 * 0.02, 1e-12, {"clamp", "tip", "contact", "beam"}),
    "disc.vtu": ("hexahedron20", np.pi * (0.15**2 - 0.05**2) * 0.012, 1e-5, {"inner", "rim", "contact", "top", "bottom"}),
    "plate-with-hole.msh": ("triangle", 0.4 * 0.2 - np.pi * 0.04**2, 2e-3, {"clamp", "tip", "hole", "plate"}),
    "brake-disc.vtu": (
        "hexahedron20", np.pi * ((0.15**2 - 0.075**2) * 0.012 + (0.083**2 - 0.075**2) * 0.038 + (0.075**2 - 0.035**2) * 0.008),
        1e-5, {"disc", "hub", "rim", "inboard", "outboard"}),
    **{f"brake-{side}board.vtu": (
        "hexahedron20", np.pi / 360 * (60 * (0.142**2 - 0.098**2) * 0.011 + 66 * (0.146**2 - 0.094**2) * 0.005), 1e-5,
        {"lining", "plate", "face", "back", "leading", "trailing"}) for side in ("in", "out")},
    "brake-disc.msh": ("hexahedron20", np.pi * (0.15**2 - 0.055**2) * 0.012, 2e-5, {"disc", "hub", "inboard", "outboard"}),
    "brake-pad.msh": ("hexahedron20", np.pi * 50 / 360 * (0.145**2 - 0.095**2) * 0.016, 2e-5,
                      {"lining", "plate", "face", "back", "leading", "trailing"}),
    "bracket.msh": ("tetra10", (0.12 + 0.1) * 0.08 * 0.01 - 4 * np.pi * 0.006**2 * 0.01, 1e-3, {"bolts", "tip", "bracket"}),
    "disc-with-pad.msh": ("tetra10", np.pi * (0.15**2 - 0.05**2) * 0.012, 1e-3, {"inner", "pad", "disc"}),
}


def test_every_shipped_mesh_is_listed() -> None:
    assert {path.name for path in (ROOT / "meshes").iterdir() if path.is_file() and path.suffix != ".geo"} == set(SHIPPED)


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
    made = getattr(mademeshes, Path(name).stem)()
    shipped = fs.read_mesh(ROOT / "meshes" / name)
    assert np.allclose(shipped.points, made.points, rtol=0, atol=1e-15) and np.array_equal(shipped.cells, made.cells)
    assert all(np.array_equal(shipped.nodes(label), nodes) for label, nodes in made.sets.items())
