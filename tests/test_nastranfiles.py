"""Nastran bulk data: the same mesh in every way of writing it down, and refusals that name card and number."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from test_meshes import volume

import femsub as fs

meshio = pytest.importorskip("meshio")

BRICKS = fs.block((2, 1, 1), (2, 1, 1), "hexahedron")


def deck(folder: Path, lines: list[str], **files: list[str]) -> fs.Mesh:
    for name, others in files.items():
        (folder / f"{name}.bdf").write_text("\n".join(others) + "\n")
    path = folder / "deck.bdf"
    path.write_text("\n".join(lines) + "\n")
    return fs.read_mesh(path)


def card(form: str, name: str, *values: object) -> list[str]:
    """A card in one of the forms that Nastran takes."""
    words = [f"{value}" for value in values]
    each = 4 if form == "large" else 8
    parts = [words[i:i + each] for i in range(0, len(words), each)]
    if form == "large":
        parts += [[]] * (len(parts) % 2)
        return [f"{(name + '*' if not i else '*'):8s}" + "".join(f"{word:>16s}" for word in part) for i, part in enumerate(parts)]
    if form == "small":
        return [f"{(name if not i else ''):8s}" + "".join(f"{word:>8s}" for word in part) for i, part in enumerate(parts)]
    if form == "small marked":
        return [f"{(name if not i else f'+C{i}'):8s}" + "".join(f"{word:<8s}" for word in part).ljust(64)
                + (f"+C{i + 1}" if i + 1 < len(parts) else "") for i, part in enumerate(parts)]
    sign = {"free": "", "free plus": "+"}[form]
    return [",".join([name if not i else sign, *part]) + (f",{sign}" if i + 1 < len(parts) and form == "free plus" else "")
            for i, part in enumerate(parts)]


FORMS = ("small", "small marked", "large", "free", "free plus")
NODES = [7 + 10 * i for i in range(12)]


def bricks(form: str) -> list[str]:
    lines = [line for number, (x, y, z) in zip(NODES, BRICKS.points, strict=True)
             for line in card(form, "GRID", number, "", f"{x:.1f}", f"{y:.1f}" if y else "", f"{z:.1f}")]
    for i, cell in enumerate(BRICKS.cells):
        lines += card(form, "CHEXA", i + 1, 4 + i, *(NODES[node] for node in cell))
    return lines


def assert_bricks(mesh: fs.Mesh) -> None:
    assert np.array_equal(mesh.points, BRICKS.points) and np.array_equal(mesh.cells, BRICKS.cells)
    assert mesh.numbers.tolist() == NODES and {name: rows.tolist() for name, rows in mesh.groups.items()} == {
        "property-4": [0], "property-5": [1]}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("change", ["as it is", "small letters", "comments", "executive control", "tabs"])
def test_two_bricks_in_every_form(form: str, change: str, tmp_path: Path) -> None:
    lines = [*bricks(form), "ENDDATA"]
    if change == "small letters":
        lines = [line.lower() for line in ["BEGIN BULK", *lines]]
    elif change == "comments":
        lines = ["$ made by hand", "", *(part for line in lines for part in (line, "$ a comment")), "what follows, is nothing"]
    elif change == "executive control":
        lines = ["SOL 103", "CEND", "TITLE = GRID, CHEXA", "BEGIN BULK", "PARAM,POST,-1", "GRDSET,,,,,,,456", *lines]
    elif change == "tabs" and form.startswith("small"):
        lines = ["\t".join(line[i:i + 8].strip() for i in range(0, len(line), 8)) for line in lines]
    assert_bricks(deck(tmp_path, lines))


def test_included_files(tmp_path: Path) -> None:
    lines = bricks("small")
    assert_bricks(deck(tmp_path, ["BEGIN BULK", "include 'nodes.bdf' $ here", *lines[12:], "ENDDATA"], nodes=lines[:12]))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", ["hexahedron20", "tetra10", "tetra"])
def test_middle_nodes_stand_where_they_belong(kind: str, form: str, tmp_path: Path) -> None:
    mesh = fs.annulus(1.0, 3.0, 0.5, (2, 8, 1), kind)
    order = [*range(12), 16, 17, 18, 19, 12, 13, 14, 15] if kind == "hexahedron20" else range(mesh.cells.shape[1])
    name = "CHEXA" if kind == "hexahedron20" else "CTETRA"
    lines = [line for i, x in enumerate(mesh.points) for line in card(form, "GRID", i + 1, "", *(f"{v:.5f}" for v in x))]
    lines += [line for i, cell in enumerate(mesh.cells) for line in card(form, name, i + 1, 1, *(cell[order] + 1))]
    back = deck(tmp_path, [*lines, "ENDDATA"])
    assert np.array_equal(back.cells, mesh.cells) and np.allclose(back.points, mesh.points, rtol=0, atol=1e-5)
    assert back.repairs == () and volume(back) == pytest.approx(volume(mesh), rel=1e-4)


@pytest.mark.parametrize("kind", ["hexahedron", "hexahedron20", "tetra10"])
def test_what_meshio_writes(kind: str, tmp_path: Path) -> None:
    """Its quadratic cells are called CHEXA_, and in large fields have the nodes in an order that is nobody's."""
    mesh = fs.annulus(1.0, 3.0, 0.5, (2, 8, 1), kind)
    points, path = np.round(mesh.points, 4) + 5, tmp_path / "m.bdf"
    for form in ("fixed-small", "free"):
        meshio.nastran.write(path, meshio.Mesh(points, [(kind, mesh.cells)]), point_format=form, cell_format="fixed-small")
        back = fs.read_mesh(path)
        assert np.array_equal(back.cells, mesh.cells) and np.allclose(back.points, points, rtol=0, atol=1e-10)
    meshio.nastran.write(path, meshio.Mesh(points, [(kind, mesh.cells)]), cell_format="fixed-large")
    if kind == "hexahedron":
        assert np.array_equal(fs.read_mesh(path).cells, mesh.cells)
    else:
        with pytest.raises(fs.InputError, match=r"_\* cards"):
            fs.read_mesh(path)


def test_numbers_as_nastran_writes_them(tmp_path: Path) -> None:
    ways = ["1.5-3", ".15-2", "1.5E-3", "1.5D-03", "+1.5-3", "15.-4"]
    lines = ["GRID,1", "GRID,2,,1.", "GRID,3,0,,1.", *(f"GRID,{4 + i},,,,{way}" for i, way in enumerate(ways))]
    cells = [f"CTETRA,{i + 1},1,1,2,3,{4 + i}" for i in range(len(ways))]
    mesh = deck(tmp_path, [*lines, *cells, "ENDDATA"])
    assert (mesh.points[3:, 2] == 1.5e-3).all() and mesh.points[:3].tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def test_angles_of_shells_and_vectors_of_bars_are_no_nodes(tmp_path: Path) -> None:
    grid = [f"GRID,{i + 1},,{x},{y}" for i, (x, y) in enumerate(((0., 0.), (1., 0.), (1., 1.), (0., 1.)))]
    rest = ["CQUAD4,1,1,1,2,3,4,45.,.01", "CBAR,2,2,1,2,0.,0.,1.", "CBUSH,3,3,1,,,,,0", "CONM2,4,1,0,2.5", "RBE2,5,1,123,2,3"]
    mesh = deck(tmp_path, [*grid, *rest, "ENDDATA"])
    assert mesh.cells.tolist() == [[0, 1, 2, 3]] and mesh.nodes("property-2").tolist() == [0, 1]
    assert "1 CONM2 skipped" in mesh.repairs and "1 RBE2 skipped" in mesh.repairs


@pytest.mark.parametrize(("old", "new", "text"), [
    ("GRID,7,,", "INCLUDE 'none.bdf'\nGRID,7,,", "includes 'none.bdf', which is not a file beside it"),
    ("GRID,7,,", "GRDSET,,3\nGRID,7,,", "in coordinate systems of their own (field CP of GRID or GRDSET)"),
    ("GRID,17,,", "GRID,7,,", "gives 1 nodes more than once, the first is node 7"),
    ("CHEXA,2,5,", "CHEXA,1,5,", "gives 1 elements more than once, the first is element 1"),
    ("GRID,17,,", "GRID,,,", "the numbers of GRID must be whole and positive, not 0"),
    ("CHEXA,2,5,47,87,", "CHEXA,2,5,47,,", "CHEXA 2 has 7 nodes, not 8 or 20"),
    ("CHEXA,2,5,47,87,", "CHEXA,2,5,47,999,", "names node 999, which the file does not give"),
    ("CHEXA,2,5,47,87,", "CHEXA,2,5,47,8.7,", "the fields of CHEXA are not all numbers"),
    ("CHEXA,2,5,47,87,", "CHEXA,2,5,47,8 7,", "the fields of CHEXA are not all numbers"),
    ("GRID,17,,", "GRID,17,,x", "the fields of GRID are not all numbers"),
    ("CHEXA,2,5,", "CHEX,2,5,", "has CHEX cards, which are not read; did you mean CHEXA?"),
    ("CHEXA,2,5,", "CIHEX1,2,5,", "has CIHEX1 cards, which are not read"),
    ("GRID,17,,", "=,*(10),=\nGRID,17,,", "has = cards, which are not read"),
    ("ENDDATA", "", "has no ENDDATA: is it cut short?"),
    ("GRID,7,,", "+,1\nGRID,7,,", "begins with a continuation"),
    ("CHEXA,2,5,", "CHEXA,2,5,1,2,3,4,5,6,7,8,9", "a line of more than 10 fields"),
    ("ENDDATA", "BEGIN SUPER=1\nENDDATA", "several parts of bulk data"),
])
def test_what_is_refused(old: str, new: str, text: str, tmp_path: Path) -> None:
    whole = "\n".join(["BEGIN BULK", *bricks("free"), "ENDDATA"])
    assert old in whole
    with pytest.raises(fs.InputError, match=re.escape(text)) as caught:
        deck(tmp_path, [whole.replace(old, new, 1)])
    assert "deck.bdf" in str(caught.value) and "\n" not in str(caught.value)


def test_continuations_out_of_order_are_refused(tmp_path: Path) -> None:
    lines = bricks("small marked")
    lines[12:] = [line.replace("+C1", f"+A{i // 2}") for i, line in enumerate(lines[12:])]
    assert_bricks(deck(tmp_path, [*lines, "ENDDATA"]))
    lines[13], lines[15] = lines[15], lines[13]
    with pytest.raises(fs.InputError, match=re.escape("the continuation '+A1' does not stand below the line it continues")):
        deck(tmp_path, [*lines, "ENDDATA"])
