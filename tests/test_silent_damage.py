"""Damage that left a reader other numbers without a word: what the file holds shows it, so that it is refused or named."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import fuzz_measured
import numpy as np
import pytest
from fuzz_ansys import full_file
from matrixhelp import Op2Writer, sierra_netcdf, sierra_text

import femsub as fs
from femsub.app.cli import main


@pytest.fixture(scope="module")
def arm() -> tuple[Any, Any]:
    full = fs.solid(fs.block((1.0, 0.1, 0.1), (3, 1, 1), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0), interface=["left"],
                    name="arm")
    return full, fs.reduce(full, fs.CraigBampton(modes=3))


def punch(arm: Any, folder: Path) -> Path:
    return next(path for path in fs.write_superelement(folder, arm[1], "dmig", recover="all") if path.suffix == ".pch")


def foreign(text: str) -> str:
    """Without the count and the sum of lines."""
    return re.sub(", by femsub.*", "", text, count=1)


def test_a_digit_in_a_file_of_ours_is_refused(arm: Any, tmp_path: Path) -> None:
    """A row of DMIG became another one, and a moved line left an entry in another column."""
    path = punch(arm, tmp_path)
    text = path.read_text()
    lines = text.splitlines(keepends=True)
    at = [at for at, line in enumerate(lines) if line.startswith("*  ")]
    moved = [*lines[:at[5]], *lines[at[5] + 1:]]
    moved.insert(at[9], lines[at[5]])
    digit = [*lines[:at[7]], lines[at[7]].replace("1", "2"), *lines[at[7] + 1:]]
    for changed in (moved, digit):
        path.write_text("".join(changed))
        with pytest.raises(fs.InputError, match="other lines than femsub wrote"):
            fs.read_component(path, cutoff=1e4)
    path.write_bytes(text.replace("\n", " \r\n").encode())  # as a transfer may leave it
    assert fs.read_component(path, cutoff=1e4).size == arm[1].size


def test_a_damaged_list_of_recovered_grids_is_named(arm: Any, tmp_path: Path) -> None:
    path = punch(arm, tmp_path)
    text = foreign(path.read_text())
    good = "       6       6      31"
    assert good in text
    for wrong in ("       6       9      31", "       5       6      31", "       6       6      30"):
        path.write_text(text.replace(good, wrong, 1))
        with pytest.raises(fs.InputError, match="DTI TUG1 names a grid twice"):
            fs.read_component(path, cutoff=1e4)
    path.write_text(text.replace(f"       1{good}", f"      31{good}", 1))
    with pytest.warns(fs.FemsubWarning, match="a point of the kind 31"):
        fs.read_component(path, cutoff=1e4)


@pytest.mark.parametrize(("card", "said"), [("ENDDATA", "ENDDATA is followed by"), ("BEGIN BULK", "stands before BEGIN BULK")])
def test_cards_that_nastran_would_leave_out_are_named(card: str, said: str, arm: Any, tmp_path: Path) -> None:
    path = punch(arm, tmp_path)
    lines = foreign(path.read_text()).splitlines(keepends=True)
    at = max(at for at, line in enumerate(lines) if line.startswith("*  "))
    mass = next(at for at, line in enumerate(lines) if line.startswith("DMIG    KAAX"))
    whole = "".join([*lines[:at + 1], f"{card}\n", *lines[at:]]) if card == "ENDDATA" else "".join([
        *lines[:mass], f"{card}\n", *lines[mass:]])
    path.write_text(whole)
    with pytest.warns(fs.FemsubWarning, match=said):
        fs.read_matrix(path, "KAAX")


def test_cards_of_a_mesh_behind_its_end_are_named(tmp_path: Path) -> None:
    points = fs.block((1.0, 1.0, 1.0), (1, 1, 1)).points
    places = [f"GRID,{at + 1},,{x:.1f},{y:.1f},{z:.1f}" for at, (x, y, z) in enumerate(points)]
    text = "\n".join(["BEGIN BULK", *places, "CTETRA,1,1,1,2,3,5", "ENDDATA", "CTETRA,2,1,8,7,6,4", ""])
    (tmp_path / "a.bdf").write_text(text)
    assert any("behind ENDDATA left out" in note for note in fs.read_mesh(tmp_path / "a.bdf").repairs)
    (tmp_path / "a.bdf").write_text(text.replace("CTETRA,2,1,8,7,6,4\n", "sent on 1 May\n"))
    assert not any("ENDDATA" in note for note in fs.read_mesh(tmp_path / "a.bdf").repairs)


@pytest.mark.parametrize("text", [False, True])
def test_a_pair_that_differs_in_a_symmetric_op4_is_named(text: bool, tmp_path: Path) -> None:
    op4 = pytest.importorskip("pyyeti.nastran.op4")
    K = np.diag([2.0, 3.0, 4.0]) + np.ones((3, 3))
    K[0, 2] += 1e-12
    op4.write(str(tmp_path / "a.op4"), {"k": (K, 6)}, binary=not text)
    assert np.allclose(fs.read_matrix(tmp_path / "a.op4"), K)
    K[0, 1] = 1.5
    op4.write(str(tmp_path / "a.op4"), {"k": (K, 6)}, binary=not text)
    with pytest.warns(fs.FemsubWarning, match="calls 'k' symmetric, but 1 of its pairs differ, first 1.5 in row 1 of column 2"):
        fs.read_matrix(tmp_path / "a.op4")


def test_a_pair_that_differs_in_a_symmetric_op2_is_named(tmp_path: Path) -> None:
    K = np.diag([2.0, 3.0, 4.0]) + np.ones((3, 3))
    path = Op2Writer().matrix("K", K).write(tmp_path / "a.op2")
    assert np.array_equal(fs.read_matrix(path).toarray(), K)
    raw = path.read_bytes()
    path.write_bytes(raw.replace(np.array([3.0, 1.0, 1.0]).tobytes(), np.array([3.0, 1.0, 7.0]).tobytes(), 1))
    with pytest.warns(fs.FemsubWarning, match="calls 'K' symmetric"):
        fs.read_matrix(path)


def test_lost_entries_of_sierra_are_named(arm: Any, tmp_path: Path) -> None:
    path = sierra_text(tmp_path, "arm", arm[0])[1]
    text = path.read_text()
    entry = re.search(r"\n(5 5 .*)\n", text)
    assert entry is not None
    path.write_text(text.replace(entry[1], ""))
    with pytest.warns(fs.FemsubWarning, match="has an empty line among its entries"), \
            pytest.warns(fs.FemsubWarning, match="no entry on the diagonal of 1 rows"):
        fs.read_matrix(path)


def test_a_second_data_set_that_lost_its_beginning_is_refused(tmp_path: Path) -> None:
    """Behind binary values the line -1 that ends a data set is no line of its own."""
    h = np.random.default_rng(4).standard_normal((2, 8)).view(complex)
    one, two = (fuzz_measured.function(2 + row, h[row], True) for row in (0, 1))
    path = tmp_path / "a.uff"
    path.write_bytes(one + b"   $-1" + two[6:])
    with pytest.raises(fs.InputError, match="is in no data set"):
        fs.read_response(path)
    path.write_bytes(one + two + b"\x1a")
    assert len(fs.read_response(path).responses) == 2
    path.write_bytes(one.replace(b"    4         1", b"    2.5xyz         1"))
    with pytest.raises(fs.InputError, match="whole numbers in its columns 6 to 30"):
        fs.read_response(path)


def test_what_is_left_out_of_measured_modes_is_told(tmp_path: Path) -> None:
    from test_universal import BENCH, SHAPES, new_mode, old_mode

    old = [old_mode(10.0, 0.01, SHAPES[0]), old_mode(12.0, 0.0, SHAPES[1])]
    (tmp_path / "a.uff").write_text(BENCH + "".join(old))
    assert not any("left out" in note or "place" in note for note in fs.read_modes(tmp_path / "a.uff").notes)
    (tmp_path / "a.uff").write_text(BENCH + old[0] + old[1].replace("8         2         3\n", "8         1         3\n"))
    assert any("data set 55 left out" in note for note in fs.read_modes(tmp_path / "a.uff").notes)
    (tmp_path / "a.uff").write_text("".join(old))
    assert any("does not give the place of node" in note for note in fs.read_modes(tmp_path / "a.uff").notes)
    new = [new_mode(-1 + 40j, np.hstack([SHAPES[0] + 1j * SHAPES[1]] * 2)) for _ in range(2)]
    (tmp_path / "a.uff").write_text(BENCH + new[0] + new[1].replace("  2414\n", "     7\n"))
    assert any("data set 7 left out" in note for note in fs.read_modes(tmp_path / "a.uff").notes)


def test_lost_keywords_of_sets_are_named(tmp_path: Path) -> None:
    path = fs.write_mesh(tmp_path / "a.inp", fs.block((2.0, 1.0, 1.0), (2, 1, 1), "hexahedron"))
    text = path.read_text()
    head = re.search(r"(?m)^\*NSET, NSET=right\n", text)
    assert head is not None and fs.read_mesh(path).repairs == ()
    for changed, said in ((text.replace(head[0], "\n"), "have an empty line"),
                          (text.replace(head[0], f"{head[0]}*NSET, NSET=x\n"), "NSET right has no members"),
                          (text.replace("*HEADING\n", ""), "stands before the first keyword")):
        path.write_text(changed)
        assert any(said in note for note in fs.read_mesh(path).repairs), said


@pytest.mark.parametrize("card", ["DTABLE", "AECOMPL", "MONSUM", "PARAM"])
def test_other_cards_may_begin_with_the_name_of_a_matrix(card: str, arm: Any, tmp_path: Path) -> None:
    path = punch(arm, tmp_path)
    path.write_text(foreign(path.read_text()) + f"{card:8}KAAX    1.0\n")
    assert fs.read_matrix(path, "KAAX").shape[0] == arm[1].size


def test_a_model_whose_index_was_changed_is_refused(tmp_path: Path) -> None:
    """A cut-off or a count of modes that is another possible one decides what a small model is trusted with."""
    fs.write_matrices(tmp_path, fs.reduce(fs.chain(10, belt=1), fs.CraigBampton(3)))
    path = tmp_path / "model.json"
    text = path.read_text()
    about = json.loads(text)
    path.write_text(json.dumps(about, sort_keys=True))  # the layout does not matter
    assert fs.read_component(tmp_path).size == 4
    about["reduced"]["cutoff"] *= 10
    path.write_text(json.dumps(about))
    with pytest.raises(fs.InputError, match="another content than femsub wrote"):
        fs.read_component(tmp_path)
    del about["sha256"]["model.json"]
    path.write_text(json.dumps(about))
    assert fs.read_component(tmp_path).size == 4  # as an older femsub wrote it, or somebody who meant it


def test_results_that_were_changed_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("plotly")
    scene, out = tmp_path / "chain.toml", tmp_path / "out"
    scene.write_text('scene = "chain"\n[part.chain]\nchain = 6\n[reduce]\nsizes = [3]\nrepeats = 1\n[[ask]]\n'
                     'critical = "slope"\n')
    assert main(["run", "-q", str(scene), "--out", str(out), "--no-figures"]) == 0 == main(["show", str(out)])
    assert "another content" not in capsys.readouterr().err
    known = json.loads((out / "results.json").read_text())
    known["critical"][0]["value"] *= 2
    (out / "results.json").write_text(json.dumps(known))
    for command in (["show", str(out)], ["run", "-q", str(out / "results.json"), "--no-figures"]):
        assert main(command) == 0
        assert "results.json has another content than femsub wrote" in capsys.readouterr().err


def test_a_page_without_its_mode_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("plotly")
    scene, out = tmp_path / "beam.toml", tmp_path / "out"
    scene.write_text('scene = "beam"\npage = true\n[part.beam]\nelements = 20\n[reduce]\nmodes = [8]\nrepeats = 1\n[[ask]]\n'
                     'complex-modes = "all"\n')
    assert main(["run", "-q", str(scene), "--out", str(out), "--no-figures"]) == 0
    (out / "mode.npz").unlink()
    capsys.readouterr()
    assert main(["show", str(out)]) == 0 and "mode.npz, which the run wrote, is gone" in capsys.readouterr().err


@pytest.mark.parametrize(("suffix", "form"), [(".msh", "gmsh"), (".vtu", "vtu")])
def test_a_mark_of_a_set_is_0_or_1(suffix: str, form: str, tmp_path: Path) -> None:
    """A turned bit made a node a member of a set."""
    import meshio

    cube, path = fs.block((1.0, 1.0, 1.0), (1, 1, 1), "hexahedron"), tmp_path / f"a{suffix}"
    marks = np.array([1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 2.6e-309])
    mesh = meshio.Mesh(cube.points, [("hexahedron", cube.cells)], {"set:left": marks})
    meshio.write(path, mesh, file_format=form)
    with pytest.raises(fs.InputError, match=r"'set:left' has 2\.6e-309 where 1 marks a member"):
        fs.read_mesh(path)


def test_the_command_of_a_block_that_became_longer_is_missed(tmp_path: Path) -> None:
    from fuzz_meshes import archive

    bricks = fs.block((2.0, 1.0, 1.0), (2, 1, 1), "hexahedron")
    path = tmp_path / "a.cdb"
    text = archive(fs.Mesh(bricks.points, bricks.cells, "hexahedron", {"left": bricks.nodes("left")}, {}, np.arange(12) + 100))
    path.write_text(text)
    assert "LEFT" in fs.read_mesh(path).sets
    path.write_text(text.replace("CMBLOCK,LEFT", "185185CMBLOCK,LEFT"))
    with pytest.raises(fs.InputError, match="the command of its block is lost"):
        fs.read_mesh(path)


def test_recovered_motions_that_cannot_be_placed_are_named(arm: Any, tmp_path: Path) -> None:
    """A row of MUG1T that is no DOF, columns of MUG1 that are too few, and TUG1 that is lost took all of them away."""
    path = punch(arm, tmp_path)
    text = foreign(path.read_text())
    start = text.index("DMIG*   MUG1T")
    row = re.compile(r"(?m)^\*  +( 3) +2").search(text, start)
    assert row is not None and fs.read_component(path, cutoff=1e4).V.shape[0] > arm[1].size
    path.write_text(text[:row.start(1)] + " 9" + text[row.end(1):])
    with pytest.warns(fs.FemsubWarning, match="MUG1T has motions by grid 9, direction 2, which is no DOF"):
        fs.read_component(path, cutoff=1e4)


def test_recovered_motions_of_op4_that_cannot_be_placed_are_named(arm: Any, tmp_path: Path) -> None:
    op4 = pytest.importorskip("pyyeti.nastran.op4")
    fs.write_superelement(tmp_path, arm[1], "nastran", recover="all")
    (tmp_path / "validity.json").unlink()
    parts = op4.load(str(tmp_path / "arm.op4"), into="dct")
    assert fs.read_component(tmp_path / "arm.op4", cutoff=1e4).V.shape[0] > arm[1].size
    parts = {key: part[0] for key, part in parts.items()}  # without form and type
    op4.write(str(tmp_path / "arm.op4"), {key: part[:, :-1] if key == "mug1" else part for key, part in parts.items()})
    with pytest.warns(fs.FemsubWarning, match="MUG1 has 14 columns, and KAA 15 rows"):
        fs.read_component(tmp_path / "arm.op4", cutoff=1e4)
    op4.write(str(tmp_path / "arm.op4"), parts)
    pch = tmp_path / "arm.pch"
    lines = foreign(pch.read_text()).splitlines(keepends=True)
    first = next(at for at, line in enumerate(lines) if line.startswith("DTI"))
    pch.write_text("".join(lines[:first]))
    with pytest.warns(fs.FemsubWarning, match="no DTI TUG1 beside it"):
        fs.read_component(tmp_path / "arm.op4", cutoff=1e4)


def test_netcdf_that_is_longer_than_its_variables_is_named(arm: Any, tmp_path: Path) -> None:
    path = sierra_netcdf(tmp_path / "arm.nc", arm[1])
    whole = path.read_bytes()
    fs.read_component(path, cutoff=1e4)
    at = len(whole) - 40  # among the places of the nodes
    for changed in (whole[:at] + bytes(4) + whole[at:], whole + b"\1\2\3\4"):
        path.write_bytes(changed)
        with pytest.warns(fs.FemsubWarning, match="does not end with the values of its last variable"):
            fs.read_component(path, cutoff=1e4)


def test_a_response_whose_number_was_damaged_is_named(tmp_path: Path) -> None:
    """A data set 58 that became another one, or a function of another type, went away without a word."""
    h = np.random.default_rng(4).standard_normal((2, 8)).view(complex)
    one, two = (fuzz_measured.function(2 + row, h[row], False) for row in (0, 1))
    path = tmp_path / "a.uff"
    for changed in (one.replace(b"    58\n", b"     7\n"), one.replace(b"    4         1", b"    6         1")):
        path.write_bytes(changed + two)
        with pytest.warns(fs.FemsubWarning, match="is left out, although it has complex values of a motion over a force"):
            assert fs.read_response(path).responses == ("3:uz",)


def test_a_mesh_of_ours_that_lost_its_sets_is_refused(tmp_path: Path) -> None:
    """Cut behind a section, a .msh is whole by its format; write_mesh announces how many sections of data there are."""
    path = fs.write_mesh(tmp_path / "a.msh", fs.block((1.0, 1.0, 1.0), (1, 1, 1), "hexahedron"))
    whole = path.read_bytes()
    assert len(fs.read_mesh(path).sets) == 6
    path.write_bytes(whole[:whole.rindex(b"$NodeData")])
    with pytest.raises(fs.InputError, match="it has 6 sections of data, but announces 7"):
        fs.read_mesh(path)
    path.write_bytes(whole.replace(b"set:left", b"smt:left"))
    assert any("'smt:left' are neither a set:NAME nor a group:NAME" in note for note in fs.read_mesh(path).repairs)
    vtu = fs.write_mesh(tmp_path / "a.vtu", fs.block((1.0, 1.0, 1.0), (1, 1, 1), "hexahedron"))
    vtu.write_bytes(vtu.read_bytes().replace(b"set:left", b"smt:left"))
    assert any("'smt:left' are 0 or 1 as the marks of a set" in note for note in fs.read_mesh(vtu).repairs)


def test_a_face_that_names_a_node_twice_is_named(tmp_path: Path) -> None:
    from fuzz_meshes import gmsh

    path = tmp_path / "a.msh"
    whole = gmsh(fs.block((3.0, 1.0, 1.0), (3, 1, 1), "hexahedron"), "2.2")
    path.write_text(whole.replace("1 3 2 4 1 1 2 4 3", "1 3 2 4 1 3 2 4 3"))
    assert any("1 quad cell of a set names a node twice" in note for note in fs.read_mesh(path).repairs)


def test_bytes_lost_across_two_data_sets_are_refused(tmp_path: Path) -> None:
    """The head of one response went on in the other's: a response was gone, and the load of the other one had another name."""
    h = np.random.default_rng(4).standard_normal((2, 8)).view(complex)
    one, two = (fuzz_measured.function(2 + row, h[row], True) for row in (0, 1))
    start, whole = one.index(b"   3 NONE") + 9, one + two
    stop = len(one) + two.index(b"         0 NONE")
    path = tmp_path / "a.uff"
    path.write_bytes(whole[:start] + whole[stop - 20:])
    with pytest.raises(fs.InputError, match="is longer than its 80 columns"):
        fs.read_response(path)


def test_a_constraint_that_is_no_direction_is_named(tmp_path: Path) -> None:
    """A changed byte held a DOF, which took a row of K away."""
    from femsub.io.ansys import read_full

    K = np.diag(np.arange(2.0, 8.0)) - 0.5 * (np.eye(6, k=1) + np.eye(6, k=-1))
    held = np.tile([1, 2, 3], 2)
    about = {"nodes": np.array([3, 1]), "kinds": np.array([1, 2, 3]), "held": held}
    assert read_full(full_file(tmp_path / "a.full", K, K, about, False))["K"].matrix.shape == (6, 6)
    held[4] = -1024
    with pytest.warns(fs.FemsubWarning, match="the constraint of DOF 5 is -1024, where its direction 2 belongs"):
        read_full(full_file(tmp_path / "b.full", K, K, about, False))


@pytest.mark.parametrize("damage", ["more", "fewer", "place", "size", "windows"])
def test_tables_that_leave_out_zeros_are_checked(damage: str, tmp_path: Path) -> None:
    from femsub.io.ansys import read_full

    K = np.diag(np.arange(2.0, 14.0)) - 0.5 * (np.eye(12, k=1) + np.eye(12, k=-1))
    about = {"nodes": np.array([3, 1, 7, 9]), "kinds": np.array([1, 2, 3]), "held": np.tile([1, 2, 3], 4)}
    path = full_file(tmp_path / "a.full", K, K, about, False, packed=True)
    assert np.array_equal(read_full(path)["K"].matrix.toarray(), read_full(
        full_file(tmp_path / "b.full", K, K, about, False))["K"].matrix.toarray())
    words = np.fromfile(path, "<i4")
    at = int(words[105 + 35])  # of DOF for each node: 4 entries, one window from 0, four times 3
    assert words[at:at + 8].tolist() == [5, -2**31 + 2**28, 4, 1, 0, -4, 3, 5]
    words[at + {"more": 2, "fewer": 2, "place": 4, "size": 5, "windows": 3}[damage]] += {"more": 1, "fewer": -1, "place": -1,
                                                                                      "size": -1, "windows": 1}[damage]
    words.tofile(tmp_path / "c.full")
    with pytest.raises(fs.InputError, match="there is no record of DOF for each node"):
        read_full(tmp_path / "c.full")


def test_responses_of_two_pairs_under_one_name_are_named(tmp_path: Path) -> None:
    """A digit made of two responses one that was measured twice, and their mean was returned."""
    h = np.random.default_rng(4).standard_normal((2, 8)).view(complex)
    path = tmp_path / "a.uff"
    path.write_bytes(fuzz_measured.function(3, h[0], False) + fuzz_measured.function(3, h[1], False))
    with pytest.warns(fs.FemsubWarning, match="from 5:ux to 3:uz are taken as one measurement that was repeated"):
        fs.read_response(path)
    path.write_bytes(fuzz_measured.function(3, h[0], False) + fuzz_measured.function(3, 1.05 * h[0], False))
    assert fs.read_response(path).responses == ("3:uz",)


def test_keywords_that_are_none_are_named(tmp_path: Path) -> None:
    path = fs.write_mesh(tmp_path / "a.inp", fs.block((2.0, 1.0, 1.0), (2, 1, 1), "hexahedron"))
    text = path.read_text()
    for wrong in ("*N" + "A" * 50 + "SET", "*N1SET X 1"):
        path.write_text(text.replace("*NSET, NSET=left", f"{wrong}, NSET=left"))
        assert any("is no keyword of Abaqus or CalculiX" in note for note in fs.read_mesh(path).repairs)
    path.write_text(text + "*SOLID SECTION, ELSET=x\n*TRANSVERSE SHEAR STIFFNESS\n1., 1., 0.\n")
    assert fs.read_mesh(path).repairs == ()


def test_lines_that_lost_their_sign_are_refused(arm: Any, tmp_path: Path) -> None:
    """A comment that became BEGIN SUPER; a field of a node that no reader needs; sections before the one with the version."""
    from fuzz_meshes import archive, gmsh

    path = punch(arm, tmp_path)
    path.write_text(foreign(path.read_text()).replace("$ K2GG", "BEGIN SUPER K2GG"))
    with pytest.raises(fs.InputError, match="has no number of a superelement"):
        fs.read_component(path, cutoff=1e4)
    bricks = fs.block((2.0, 1.0, 1.0), (2, 1, 1), "hexahedron")
    text = archive(fs.Mesh(bricks.points, bricks.cells, "hexahedron", {"left": bricks.nodes("left")}, {}, np.arange(12) + 100))
    (tmp_path / "a.cdb").write_text(text.replace("      104        0        0", "      104        0      S 0"))
    with pytest.raises(fs.InputError, match="NBLOCK"):
        fs.read_mesh(tmp_path / "a.cdb")
    (tmp_path / "a.msh").write_text("$Nodes\n" + gmsh(bricks, "2.2"))
    with pytest.raises(fs.InputError, match=r"\$Nodes stands before \$MeshFormat"):
        fs.read_mesh(tmp_path / "a.msh")
