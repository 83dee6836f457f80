"""Superelements in and out: Nastran's OP4 with .asm and .pch, DMIG; Abaqus, CalculiX, Exudyn."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import femsub as fs

DATA = Path(__file__).parent / "data" / "nastran"
CARDS = """GRID,1,,0.,0.,0.,7
GRID,2,,1.,0.,0.
CORD2C,7,0,0.,0.,0.,0.,0.,1.
,0.,1.,0.
SPOINT,11,THRU,12
EXTRN,1,123,2,1,11,0,12,0
"""
HEADS = """DMIG    KAAX           0       6       2       0
DMIG*   KAAX                           1               1
*                      1               1 2.000000000D+00
*                      2               1-1.000000000D+00
DMIG*   KAAX                           1               2
*                      1               2 3.000000000D+00
DMIG*   KAAX                           1               3
*                      1               3 4.000000000D+00
DMIG*   KAAX                           2               1
*                      2               1 1.000000000D+00
DMIG*   KAAX                          11               0
*                     11               0 9.000000000D+00
DMIG    MAAX           0       6       2       0
DMIG,MAAX,1,1,,1,1,1.5
DMIG,MAAX,1,2,,1,2,1.5
DMIG,MAAX,1,3,,1,3,1.5
DMIG,MAAX,2,1,,2,1,.5
DMIG,MAAX,11,0,,11,0,1.
"""


def read(path: Path, **more: Any) -> fs.ReducedSubstructure:
    part = fs.read_component(path, cutoff=300.0, **more)
    assert isinstance(part, fs.ReducedSubstructure)
    return part


def written(folder: Path, text: str, name: str = "part.pch") -> Path:
    (folder / name).write_text(text)
    return folder / name


def test_two_superelements_of_nastran_have_the_frequencies_of_its_own_assembly() -> None:
    pytest.importorskip("pyyeti.nastran.op4")
    parts = {"in": read(DATA / "inboard.asm"), "out": read(DATA / "outboard.op4")}
    system = fs.couple(parts, [fs.Rigid(("in", "boundary"), ("out", "boundary"))])
    found = fs.normal_modes(system, count=48)
    theirs = np.sqrt(np.loadtxt(DATA / "eigenvalues.txt")[6:])
    assert found.rigid == 6
    assert np.abs(found.frequencies[6:] / theirs - 1).max() < 5e-8  # they have nine digits
    grids = fs.couple(parts, [fs.Rigid(("in", grid), ("out", grid)) for grid in ("3", "11", "19", "27")])
    assert np.abs(fs.normal_modes(grids, count=48).frequencies - found.frequencies).max() < 1e-8 * theirs[-1]


def test_what_a_superelement_knows() -> None:
    pytest.importorskip("pyyeti.nastran.op4")
    part = read(DATA / "inboard.pch", ports={"belt": "11:uy"}, name="wing")
    assert (part.size, len(part.V), part.modes, part.name, part.cutoff) == (32, 36, 8, "wing", 300.0)
    assert list(part.sets) == ["boundary", "3", "11", "19", "27"]
    assert part.interface.tolist() == list(range(24)) and set(part.kinds) == {"constraint", "fixed-interface"}
    assert part.interface_dofs is not None and part.full_dofs is not None
    assert part.interface_dofs.points is not None
    assert part.interface_dofs.points[6].tolist() == [600.0, 300.0, 300.0]
    # grid 11 has a frame of its own: rigid motion along the basic axes strains nothing
    x = np.zeros(32)
    x[[at for at in range(24) if part.interface_dofs.components[at] == 1]] = 1.0
    assert np.abs(part.K @ x).max() < 1e-12 * np.abs(part.K).max()
    assert x @ part.M @ x == pytest.approx(1.7551, abs=1e-4)
    assert part.ports["belt"][:24].tolist() == [float(at == 7) for at in range(24)]
    # grids 4 and 16 are recovered; a rigid motion moves them as well, whatever their frames
    assert np.hypot.reduce((part.V @ x)[24:27]) == pytest.approx(1.0, abs=1e-7)  # MUG1 has single precision
    assert part.full_dofs.name(24) == "ux@own at node 4"


def test_a_cut_off_is_asked_for() -> None:
    pytest.importorskip("pyyeti.nastran.op4")
    with pytest.warns(fs.FemsubWarning, match="up to which frequency"):
        part = fs.read_component(DATA / "inboard.op4")
    assert part.cutoff == pytest.approx(1310.65, abs=0.01)


def test_dmig_with_grids_is_a_superelement(tmp_path: Path) -> None:
    part = read(written(tmp_path, HEADS + CARDS))
    assert part.size == 5 and len(part.interface) == 4  # the scalar point 12 has neither mass nor stiffness
    dofs = part.interface_dofs
    assert dofs is not None and [dofs.name(at) for at in range(4)] == [f"{way} at node 1" for way in ("ux", "uy", "uz")] + [
        "ux at node 2"]
    # a grid on the axis of its cylindrical frame, whose r is along y: K_rr = 2 stands along y, K_θθ = 3 along -x
    assert np.allclose(part.K[:4, :4], [[3, 0, 0, 0], [0, 2, 0, -1], [0, 0, 4, 0], [0, -1, 0, 1]])
    assert (part.K[4, 4], part.M[4, 4]) == (9.0, 1.0)
    bare = fs.read_matrix(tmp_path / "part.pch", "KAAX")
    assert bare.shape == (5, 5) and bare[0, 3] == bare[3, 0] == -1.0
    named = fs.read_component(f"{tmp_path}/part.pch:MAAX", f"{tmp_path}/part.pch:KAAX", interface=["2.1"])
    assert named.size == 5 and named.interface.tolist() == [3]


@pytest.mark.parametrize(("change", "message"), [
    (("EXTRN,1,123,2,1", "EXTRN,1,123,2,9"), None),  # DMIG tells its own order
    (("GRID,2", "$"), "no GRID card of 1 boundary"), (("CORD2C,7,0", "CORD2C,8,0"), "coordinate system 7"),
    (("3.000000000D+00", "3.0000x0000D+00"), "not a number"), (("3.000000000D+00", "3.00000000D+999"), "beyond all numbers"),
    (("DMIG    MAAX           0", "DMIG    MAAY           0"), "no head"),
    (("SPOINT,11,THRU,12", "SPOINT,11,THRU,99999999"), "too many"), (("       0       6       2", "       0       5       2"), "form 5"),
    (("KAAX                          11", "KAAX                            "), "not a whole number"),
    (("*                      2               1-1.0", "*                      1               1-1.0"), "twice"),
    ((".5\n", ".5\nDMIG,MAAX,2,1,,2,1,.5\n"), "twice"), (("GRID,1,", "BEGIN SUPER 3\nBEGIN SUPER 4\nGRID,1,"), "superelements 3, 4"),
    (("DMIG    KAAX", "+\nDMIG    KAAX"), "begins with a continuation"), (("EXTRN,1,123", "EXTRN,1,1 3"), None)])
def test_faults_of_dmig_are_told(tmp_path: Path, change: tuple[str, str], message: str | None) -> None:
    text = HEADS + CARDS
    assert change[0] in text
    path = written(tmp_path, text.replace(*change))
    if message is None:
        assert read(path).size == 5
    else:
        with pytest.raises(fs.InputError, match=message):
            read(path)


def test_files_that_do_not_belong_together(tmp_path: Path) -> None:
    pytest.importorskip("pyyeti.nastran.op4")
    shutil.copy(DATA / "inboard.op4", tmp_path / "part.op4")
    with pytest.raises(fs.InputError, match=r"neither part\.asm nor part\.pch"):
        fs.read_component(tmp_path / "part.op4")
    shutil.copy(DATA / "outboard.pch", tmp_path / "part.pch")
    with pytest.raises(fs.InputError, match="32 rows, but the cards beside it name 46 DOF"):
        fs.read_component(tmp_path / "part.op4")
    (tmp_path / "part.op4").unlink()
    with pytest.raises(fs.InputError, match=r"no part\.op4 beside it"):
        fs.read_component(tmp_path / "part.pch")
    with pytest.raises(fs.InputError, match="cutoff is for superelements"):
        fs.read_component(tmp_path, cutoff=1.0)
    with pytest.raises(fs.InputError, match="is a superelement"):
        fs.read_component(tmp_path / "part.pch", interface=[1])


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("pyyeti.nastran.op4", "pyyeti.nastran", "pyyeti"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(fs.MissingPackageError, match="pip install pyyeti"):
        fs.read_component(DATA / "inboard.asm")
