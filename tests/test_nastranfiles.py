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


def test_included_files_include_others_beside_themselves_or_beside_the_deck(tmp_path: Path) -> None:
    """Nastran looks from the folder of the run."""
    lines = bricks("small")
    (tmp_path / "parts" / "more here").mkdir(parents=True)
    (tmp_path / "parts" / "more here" / "cells.inc").write_text("\n".join([*lines[12:], ""]))
    for name in ("parts/more here/cells.inc", "more here/cells.inc", "'more here/cells.inc'"):
        assert_bricks(deck(tmp_path, ["INCLUDE parts/one.bdf $ the rest", "ENDDATA"],
                           **{"parts/one": [*lines[:12], f"include {name}  "]}))
    with pytest.raises(fs.InputError, match=r"one.bdf includes 'none.inc', which is not a file beside it or beside .*deck.bdf"):
        deck(tmp_path, ["INCLUDE parts/one.bdf", "ENDDATA"], **{"parts/one": ["INCLUDE none.inc"]})


def test_bulk_data_that_begin_twice_are_no_superelements(tmp_path: Path) -> None:
    assert_bricks(deck(tmp_path, ["BEGIN BULK", "$ a comment", "", "BEGIN BULK", *bricks("small"), "ENDDATA"]))


def test_points_given_twice_at_the_same_place(tmp_path: Path) -> None:
    lines = bricks("small")
    mesh = deck(tmp_path, [*lines, *lines[:2], "ENDDATA"])
    assert mesh.repairs == ("2 nodes were given twice at the same place, kept once",)
    assert np.array_equal(mesh.cells, BRICKS.cells) and mesh.numbers.tolist() == NODES


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
    ("GRID,7,,", "GRDSET,,3\nGRID,7,,", "in the coordinate system 3 (fields CP and CD), but it has no CORD1R, CORD1C"),
    ("GRID,7,,", "CORD2R,3,3,,,,,,1.\n,1.\nGRID,7,3,", "the coordinate system 3 is defined by itself"),
    ("GRID,7,,", "CORD2R,3,,,,,,,1.\n,,,2.\nGRID,7,3,", "the three points of the coordinate system 3 lie on a line"),
    ("GRID,7,,", "CORD1S,3,17,27,99\nGRID,7,3,", "the coordinate system 3 names node 99, which the file does not give"),
    ("GRID,17,,", "GRID,7,,", "gives 1 nodes more than once, the first is node 7"),
    ("CHEXA,2,5,", "CHEXA,1,5,", "gives 1 elements more than once, the first is element 1"),
    ("GRID,17,,", "GRID,,,", "the numbers of GRID must be whole and positive, not 0"),
    ("CHEXA,2,5,47,87,", "CHEXA,2,5,47,,", "CHEXA 2 has 7 nodes, not 8 or 20"),
    ("CHEXA,2,5,47,87,", "CHEXA,2,5,47,999,", "names node 999, which the file does not give"),
    ("CHEXA,2,5,47,87,", "CHEXA,2,5,47,8.7,", "the fields of CHEXA are not all numbers"),
    ("CHEXA,2,5,47,87,", "CHEXA,2,5,47,8 7,", "the fields of CHEXA are not all numbers"),
    ("GRID,17,,", "GRID,17,,x", "the fields of GRID are not all numbers"),
    ("CHEXA,2,5,", "CHEX,2,5,", "has CHEX cards, which are not read; did you mean CHEXA?"),
    ("CHEXA,2,5,", "CIHEX3,2,5,", "has CIHEX3 cards, which are not read: write"),
    ("GRID,7,,", "GRIDD,7,,", "has GRIDD cards, which are not read; did you mean GRID?"),
    ("CHEXA,2,5,", "HCEXA,2,5,", "has HCEXA cards, which are not read; did you mean CHEXA?"),
    ("GRID,17,,", "=,*(10),=\nGRID,17,,", "has = cards, which are not read"),
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
    assert_bricks(deck(tmp_path, [*lines, "FREQ    3       1.", "+A0     2.", "ENDDATA"]))  # a mark that is used twice
    *grid, first, more, second, rest = lines
    for order in ((first, rest, second, more), (first, "FREQ    3       1.", more, second, rest)):
        with pytest.raises(fs.InputError, match=r"the continuation '\+A[01]' does not stand below the line it continues"):
            deck(tmp_path, [*grid, *order, "ENDDATA"])


def test_the_first_column_of_a_continuation_mark_means_nothing(tmp_path: Path) -> None:
    """NASTRAN compares columns 74 to 80 of a line with 2 to 8 of the next one; NASTRAN-95's own decks have CCORD, then +CORD."""
    lines = [re.sub(r"\+C(\d)$", r"CC\1", line) for line in bricks("small marked")]
    assert any(line.endswith("CC1") for line in lines)
    assert_bricks(deck(tmp_path, [*lines, "ENDDATA"]))


def test_continuations_of_cards_that_are_not_read_may_stand_anywhere(tmp_path: Path) -> None:
    assert_bricks(deck(tmp_path, [*bricks("small"), "TABLED1 7                                                               +T1",
                                  "FREQ    3       1.                                                              +F1",
                                  "+T1     0.      1.", "+F1     2.", "ENDDATA"]))


def test_a_file_without_enddata_is_read_if_its_last_line_ends(tmp_path: Path) -> None:
    mesh = deck(tmp_path, bricks("free"))
    assert len(mesh.repairs) == 1 and "no ENDDATA" in mesh.repairs[0]
    assert_bricks(mesh)
    (tmp_path / "deck.bdf").write_text("\n".join(bricks("free")))
    with pytest.raises(fs.InputError, match="seems to be cut short"):
        fs.read_mesh(tmp_path / "deck.bdf")


@pytest.mark.parametrize("card", ["PBEAM", "PBUSH", "PBUSH1D", "PTUBE", "PSHEAR", "EGRID", "DVGRID", "RADSET", "PBUSH2D", "GAP"])
def test_cards_that_only_look_like_those_of_a_mesh_are_skipped(card: str, tmp_path: Path) -> None:
    assert_bricks(deck(tmp_path, [f"{card},1,2,3.5", *bricks("small"), "ENDDATA"]))


def test_formulas_are_no_fields(tmp_path: Path) -> None:
    assert_bricks(deck(tmp_path, ["DEQATN  1       F(R,T,P)=SQRT(R**2+T**2,P)+1,2,3,4,5,6,7,8,9,10", *bricks("free"), "ENDDATA"]))


@pytest.mark.parametrize("name", ["deck.dat", "deck.inp", "deck.txt", "deck", "deck.run1"])
def test_the_content_tells_a_deck_whatever_it_is_called(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text("\n".join(["ID A,B", "CEND", "BEGIN BULK", *bricks("large"), "ENDDATA", ""]))
    assert_bricks(fs.read_mesh(path))
    nodes = [f"{number}, {x}, {y}, {z}" for number, (x, y, z) in zip(NODES, BRICKS.points, strict=True)]
    cells = [f"{i + 1}, {', '.join(str(NODES[node]) for node in cell)}" for i, cell in enumerate(BRICKS.cells)]
    path.write_text("\n".join(["*NODE", *nodes, "*ELEMENT, TYPE=C3D8", *cells, ""]))
    mesh = fs.read_mesh(path)
    assert np.array_equal(mesh.cells, BRICKS.cells) and mesh.numbers.tolist() == NODES


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", ["CROD", "CTUBE"])
def test_two_rods_on_one_card(name: str, form: str, tmp_path: Path) -> None:
    grid = [f"GRID,{i + 1},,{i}." for i in range(4)]
    mesh = deck(tmp_path, [*grid, *card(form, name, 12, 13, 1, 2, 3, 12, 3, 2), *card(form, name, 20, 13, 3, 4), "ENDDATA"])
    assert sorted(map(tuple, mesh.numbers[mesh.cells].tolist())) == [(1, 2), (3, 2), (3, 4)]
    assert sorted(mesh.groups) == ["property-12", "property-13"] and len(mesh.groups["property-13"]) == 2


@pytest.mark.parametrize(("name", "order"), [
    ("CIHEX1", None), ("CHEXA1", None), ("CHEXA2", None),
    ("CIHEX2", [0, 8, 1, 9, 2, 10, 3, 11, 16, 17, 18, 19, 4, 12, 5, 13, 6, 14, 7, 15])])
def test_bricks_of_old_decks(name: str, order: list[int] | None, tmp_path: Path) -> None:
    mesh = fs.annulus(1.0, 3.0, 0.5, (2, 8, 1), "hexahedron20" if order else "hexahedron")
    lines = [line for i, x in enumerate(mesh.points) for line in card("free", "GRID", i + 1, "", *(f"{v:.5f}" for v in x))]
    lines += [line for i, cell in enumerate(mesh.cells) for line in card("small", name, i + 1, 1, *(cell[order or range(8)] + 1))]
    back = deck(tmp_path, [*lines, "ENDDATA"])
    assert np.array_equal(back.cells, mesh.cells) and back.repairs == ()


@pytest.mark.parametrize(("name", "kind"), [
    ("CTRIA2", "triangle"), ("CTRMEM", "triangle"), ("CQUAD1", "quad"), ("CQDMEM1", "quad")])
def test_shells_of_old_decks(name: str, kind: str, tmp_path: Path) -> None:
    grid = [f"GRID,{i + 1},,{x},{y}" for i, (x, y) in enumerate(((0., 0.), (1., 0.), (1., 1.), (0., 1.)))]
    nodes = "1,2,3" if kind == "triangle" else "1,2,3,4"
    mesh = deck(tmp_path, [*grid, f"{name},1,1,{nodes},29.2", "ENDDATA"])
    assert mesh.kind == kind and mesh.cells.tolist() == [list(range(len(mesh.cells[0])))]


@pytest.mark.parametrize(("name", "nodes"), [("CPENTA", 6), ("CPENTA", 15), ("CPYRAM", 13)])
def test_solids_that_femsub_has_not_are_refused_by_their_kind(name: str, nodes: int, tmp_path: Path) -> None:
    lines = [f"GRID,{i + 1},,{i}.,{i * i}.,{i**3}." for i in range(nodes)]
    kind = f"{'wedge' if name == 'CPENTA' else 'pyramid'}{nodes if nodes > 6 else ''}"
    with pytest.raises(fs.InputError, match=f"has 1 {kind} cells, but femsub knows only"):
        deck(tmp_path, [*lines, *card("free", name, 1, 1, *range(1, nodes + 1)), "ENDDATA"])


def turned(axis: int, degrees: float) -> np.ndarray:
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.insert(np.insert(np.array([[c, -s], [s, c]]), axis, 0, axis=0), axis, np.eye(3)[axis], axis=1)


def local(shape: str, points: np.ndarray, origin: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Points in a system whose unit vectors are the rows of `axes`; angles in degrees, θ of a sphere from the z axis."""
    x, y, z = axes @ (points - origin).T
    r, around = np.hypot(x, y), np.rad2deg(np.arctan2(y, x))
    return np.stack({"R": (x, y, z), "C": (r, around, z),
                     "S": (np.hypot(r, z), np.rad2deg(np.arctan2(r, z)), around)}[shape], axis=1)


def numbers(values: np.ndarray) -> str:
    return ",".join(f"{value:.12f}" for value in np.ravel(values))


@pytest.mark.parametrize("shape", "RCS")
@pytest.mark.parametrize("defined", ["by points", "by points of another system", "by nodes", "by GRDSET"])
def test_points_in_coordinate_systems(shape: str, defined: str, tmp_path: Path) -> None:
    """The bricks, given in a system that is turned and moved."""
    origin, axes = np.array([3.0, -2.0, 0.5]), turned(2, 40) @ turned(0, 25)
    three = np.array([origin, origin + 2 * axes[2], origin + 3 * axes[0] + 4 * axes[2]])
    lines = [f"GRID,{number},{'' if defined == 'by GRDSET' else 5},{numbers(place)}"
             for number, place in zip(NODES, local(shape, BRICKS.points, origin, axes), strict=True)]
    if defined == "by nodes":
        lines += [f"GRID,{901 + i},,{numbers(place)}" for i, place in enumerate(three)]
        lines += [f"CORD1{shape},4,901,902,903,5,901,902,903"]
    else:
        of = 9 if "another" in defined else 0
        tilted = turned(1, -70)
        given = local("C", three, np.ones(3), tilted) if of else three
        lines += [f"CORD2{shape},5,{of},{numbers(given[:2])},+", f"+,{numbers(given[2])}", "GRDSET,,5" * (defined == "by GRDSET")]
        lines += [f"CORD2C,9,,1.,1.,1.,{numbers(1 + tilted[2])}", f",{numbers(1 + tilted[0])}"]
    mesh = deck(tmp_path, [*lines, *bricks("free")[12:], "ENDDATA"])
    assert np.allclose(mesh.points, BRICKS.points, rtol=0, atol=1e-9) and np.array_equal(mesh.cells, BRICKS.cells)


@pytest.mark.parametrize(("old", "new", "message"), [
    ("GRID*                  4               0             0.0             0.0\n*                    1.0",
     "GRID*                  4               0             0.0             0.0", r"GRID\* 4 has one line"),
    ("CTETRA         2", "CTETRA         2,", "neither in columns"),
    ("CTETRA         2", "CTETRA  2       ", None),
    ("CTETRA         2", "CTETRA 2        ", "neither in columns"),
    ("             0.0             0.0\n*", "             0,5             0.0\n*", "neither in columns"),
    ("GRID           2              1.      0.      0.", "GRID,2,,1,0,0.,0.", r"'0\.' behind its coordinates")])
def test_a_card_that_would_be_left_out_is_refused(old: str, new: str, message: str | None, tmp_path: Path) -> None:
    text = ("GRID           1              0.      0.      0.\nGRID           2              1.      0.      0.\n"
            "GRID           3              0.      1.      0.\nGRID           5              0.      0.     -1.\n"
            "GRID*                  4               0             0.0             0.0\n*                    1.0\n"
            "CTETRA         1       1       1       2       3       4\nCTETRA         2       1       1       2       3       5\n"
            "ENDDATA\n")
    assert text.count(old) == 1
    path = tmp_path / "part.bdf"
    path.write_text(text)
    assert len(fs.read_mesh(path).cells) == 2
    path.write_text(text.replace(old, new))
    if message is None:
        assert len(fs.read_mesh(path).cells) == 2
        return
    with pytest.raises(fs.InputError, match=message):
        fs.read_mesh(path)


def test_what_mesh_readers_need_not_know_does_not_stop_them(tmp_path: Path) -> None:
    """Decks include alterations of solutions (DMAP) that stand elsewhere; a card that is not read may have texts with commas."""
    points = fs.block((1.0, 1.0, 1.0), (1, 1, 1)).points
    places = [f"GRID,{at + 1},,{x:.1f},{y:.1f},{z:.1f}" for at, (x, y, z) in enumerate(points)]
    head = "SOL 103\nINCLUDE '/loads/dmaps/nas2cam.v9'\nCEND\n"
    bulk = ["OUTRCV, 401, 1", "+       CID=0 , METHOD=EXTRAP", *places, "CTETRA,1,1,1,2,3,5", "ENDDATA", ""]
    path = tmp_path / "a.bdf"
    path.write_text(head + "\n".join(["BEGIN BULK", *bulk]))
    found = fs.read_mesh(path)
    assert len(found.cells) == 1 and any("INCLUDE '/loads/dmaps/nas2cam.v9' before BEGIN BULK left out" in note
                                         for note in found.repairs)
    path.write_text(head + "\n".join(["BEGIN BULK", "INCLUDE 'grids.inc'", *bulk]))
    with pytest.raises(fs.InputError, match=r"includes 'grids\.inc', which is not a file beside it"):
        fs.read_mesh(path)
    path.write_text("\n".join(["GRID,1,,0.,0.,0.", "CTETRA,1,1,1,2", "+       CID=0 , METHOD=EXTRAP", ""]))
    with pytest.raises(fs.InputError, match="neither in columns of 8 or 16 nor between commas"):
        fs.read_mesh(path)
