"""Damage that left a reader other numbers without a word: what the file holds shows it, so that it is refused or named."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import fuzz_measured
import numpy as np
import pytest
from matrixhelp import Op2Writer, sierra_text

import femsub as fs


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
