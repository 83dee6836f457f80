"""Superelements in and out: Nastran's OP4 with .asm and .pch, DMIG; Abaqus, CalculiX, Exudyn."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
import subprocess
import sys
import tracemalloc
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from matrixhelp import Op2Writer, sierra_netcdf, sierra_text, superelement_op2

import femsub as fs
from femsub.app.cli import main
from femsub.checks import installed_by
from femsub.io.dmig import dmig_of

DIRECTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")
DATA = Path(__file__).parent.parent / "meshes" / "nastran"
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
    np.testing.assert_allclose(system.collected(system.expand(found.shapes)), found.shapes, atol=1e-12)  # as a full part's
    grids = fs.couple(parts, [fs.Rigid(("in", grid), ("out", grid)) for grid in ("3", "11", "19", "27")])
    assert np.abs(fs.normal_modes(grids, count=48).frequencies - found.frequencies).max() < 1e-8 * theirs[-1]


def test_what_a_superelement_knows() -> None:
    pytest.importorskip("pyyeti.nastran.op4")
    part = read(DATA / "inboard.pch", ports={"belt": "11:uy"}, name="wing")
    assert (part.size, len(part.V), part.modes, part.name, part.cutoff) == (32, 44, 8, "wing", 300.0)
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
    assert np.hypot.reduce((part.V @ x)[32:35]) == pytest.approx(1.0, abs=1e-7)  # MUG1 has single precision
    assert part.full_dofs.name(32) == "ux@own at node 4" and part.full_dofs.name(24) == "q at node 2995001"


def test_an_audit_bounds_the_frequencies_of_a_part_whose_k_lost_digits() -> None:
    """Without the rigid motion that the part carries, K counted as singular, and nothing was known of its frequencies."""
    pytest.importorskip("pyyeti.nastran.op4")
    found = fs.audit(fs.read_component(DATA / "outboard.asm", cutoff=314.0))
    assert not found.faults and found.trusted == pytest.approx(96.85, abs=0.01)
    assert (found.lower <= found.omega).all() and found.error.max() < 0.01


def test_a_cut_off_is_asked_for(tmp_path: Path) -> None:
    pytest.importorskip("pyyeti.nastran.op4")
    with pytest.warns(fs.FemsubWarning, match="up to which frequency"):
        part = fs.read_component(DATA / "inboard.op4")
    assert part.cutoff == pytest.approx(1310.65, abs=0.01)
    (tmp_path / "static.pch").write_text("".join(line for line in (HEADS + CARDS).splitlines(True) if " 11 " not in line
                                                 and ",11," not in line) + "EXTRN,1,123,2,1\n")
    with pytest.warns(fs.FemsubWarning, match="counts as a full model"):
        assert fs.read_component(tmp_path / "static.pch").cutoff == np.inf


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
    assert fs.read_matrix(written(tmp_path, HEADS, "job.dat"), "maax").shape == (5, 5)
    with_param = written(tmp_path, f"{HEADS}PARAM   KAAX    YES\n", "param.dat")
    assert fs.read_matrix(with_param, "KAAX").shape == (5, 5)
    for card in ("DMLG", "DMI"):
        with pytest.raises(fs.InputError, match="is no DMIG"):
            fs.read_matrix(written(tmp_path, f"{HEADS}{card:8}KAAX    YES\n", "wrong.dat"), "KAAX")
    named = fs.read_component(f"{tmp_path}/part.pch:MAAX", f"{tmp_path}/part.pch:KAAX", interface=["2.1"])
    assert named.size == 5 and named.interface.tolist() == [3]


@pytest.mark.parametrize(("change", "message"), [
    (("EXTRN,1,123,2,1", "EXTRN,1,123,2,9"), None),  # DMIG tells its own order
    (("GRID,2", "$"), "no GRID card of 1 boundary"), (("CORD2C,7,0", "CORD2C,8,0"), "coordinate system 7"),
    (("3.000000000D+00", "3.0000x0000D+00"), "not a number"), (("3.000000000D+00", "3.00000000D+999"), "beyond all numbers"),
    (("DMIG    MAAX           0", "DMIG    MAAY           0"), "no head"),
    (("SPOINT,11,THRU,12", "SPOINT,11,THRU,99999999"), "too many"),
    (("SPOINT,11,THRU,12", "SPOINT,1,THRU,6000000\nSPOINT,1,THRU,6000000"), "too many"),
    (("       0       6       2", "       0       5       2"), "form 5"),
    (("KAAX                          11", "KAAX                            "), "not a whole number"),
    (("*                      2               1-1.0", "*                      1               1-1.0"), "twice"),
    ((".5\n", ".5\nDMIG,MAAX,2,1,,2,1,.5\n"), "twice"),
    (("GRID,1,", "BEGIN SUPER 3\nBEGIN SUPER 4\nGRID,1,"), "superelements 3, 4"),
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


def test_a_missing_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is written needs it; a file is read without."""
    for module in ("pyyeti.nastran.op4", "pyyeti.nastran", "pyyeti"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(fs.MissingPackageError, match=re.escape(installed_by("pyyeti"))):
        fs.write_superelement(tmp_path / "out", fs.read_component(DATA / "inboard.asm", cutoff=300.0), "nastran")


@pytest.fixture(scope="module")
def arm() -> tuple[fs.Substructure, fs.ReducedSubstructure]:
    mesh = fs.block((1.0, 0.1, 0.1), (6, 1, 1), "hexahedron")
    part = fs.solid(mesh, fs.Material(2.1e11, 0.3, 7850.0), interface=["left", "right"], name="arm")
    return part, fs.reduce(part, fs.CraigBampton(modes=7))


def frequencies(model: fs.Substructure) -> Any:
    return fs.normal_modes(model, count=12).frequencies


@pytest.mark.parametrize("program", ["nastran", "dmig"])
def test_what_is_written_for_nastran_is_read_back(arm: Any, tmp_path: Path, program: str) -> None:
    if program == "nastran":
        pytest.importorskip("pyyeti.nastran.op4")
    rom = fs.damped(arm[1].with_damping(1e-6 * arm[1].K), structural=0.02)
    fs.write_superelement(tmp_path, rom, program, number=7, recover="all")
    found = read(tmp_path / "arm.pch")
    digits = 1e-15 if program == "nastran" else 1e-10  # of DMIG, ten
    for ours, theirs in ((rom.M, found.M), (rom.K, found.K), (rom.D, found.D), (rom.H, found.H)):
        assert np.abs(ours - theirs).max() <= digits * np.abs(ours).max()
    assert rom.full_dofs is not None and found.full_dofs is not None
    place = {(node, kind): at for at, (node, kind) in enumerate(zip(rom.full_dofs.nodes, rom.full_dofs.components, strict=True))}
    labels = [found.full_dofs.labels[kind][:2] for kind in found.full_dofs.components]
    motions = [at for at, label in enumerate(labels) if label in DIRECTIONS]  # the others are the coordinates themselves
    rows = [place[found.full_dofs.nodes[at], DIRECTIONS.index(labels[at])] for at in motions]
    assert sorted(rows) == list(range(84)) and len(motions) == len(labels) - found.modes
    assert np.abs(rom.V[rows] - found.V[motions]).max() <= digits * np.abs(rom.V).max()
    assert found.interface_dofs is not None and rom.interface_dofs is not None
    assert np.abs(found.interface_dofs.points - rom.interface_dofs.points).max() < 1e-10
    assert "superelement" in found.method and ("7 " in found.method) == (program == "nastran" or found.modes == 7)
    if program == "nastran":
        assert np.abs(frequencies(found)[6:] / frequencies(rom)[6:] - 1).max() < 1e-12


def test_dof_without_mass_are_left_out_of_dmig_and_come_back(arm: Any, tmp_path: Path) -> None:
    """MacNeal leaves the interface without mass: its MAAX has fewer DOF than its KAAX."""
    rom = fs.reduce(arm[0], fs.MacNeal(modes=3))
    path, *_ = fs.write_superelement(tmp_path, rom, "dmig")
    empty = int((~rom.M.any(axis=0)).sum())
    with pytest.warns(fs.FemsubWarning, match=rf"MAAX has no entries for {empty} of {rom.size} DOF, first grid .* without mass"):
        found = fs.read_component(path, cutoff=rom.cutoff)
    for ours, theirs in ((rom.M, found.M), (rom.K, found.K)):
        assert np.abs(ours - theirs).max() <= 1e-10 * np.abs(ours).max()
    with pytest.raises(fs.InputError, match=r"M of 'arm' is singular, and Exudyn needs .* fs\.Rubin"):
        fs.write_superelement(tmp_path, rom, "exudyn", full=arm[0])
    fs.write_superelement(tmp_path, fs.reduce(arm[0], fs.Rubin(modes=3)), "exudyn", full=arm[0])


def test_pynastran_reads_what_is_written(arm: Any, tmp_path: Path) -> None:
    bdf, op4 = pytest.importorskip("pyNastran.bdf.bdf"), pytest.importorskip("pyNastran.op4.op4")
    pytest.importorskip("pyyeti.nastran.op4")
    for program in ("nastran", "dmig"):
        fs.write_superelement(tmp_path / program, arm[1], program, recover="all")
    deck = bdf.read_bdf(tmp_path / "dmig" / "arm.pch", punch=True, xref=False, debug=None)
    found = {name: deck.dmig[name].get_matrix(is_sparse=False, apply_symmetry=True)[0] for name in ("KAAX", "MAAX", "MUG1T")}
    whole = op4.read_op4(str(tmp_path / "nastran" / "arm.op4"), matrix_names=["KAA", "MAA"], debug=None)
    for ours, dmig, name in ((arm[1].K, found["KAAX"], "KAA"), (arm[1].M, found["MAAX"], "MAA")):
        assert np.abs(ours - dmig).max() < 1e-10 * np.abs(ours).max()
        stored = whole[name]
        assert np.array_equal(ours, stored.data if hasattr(stored, "form") else stored[1])
    bdf.read_bdf(tmp_path / "nastran" / "arm.asm", punch=True, xref=False, debug=None)


def test_matrices_for_abaqus_and_calculix(arm: Any, tmp_path: Path) -> None:
    rom = arm[1]
    for program in ("abaqus", "calculix"):
        fs.write_superelement(tmp_path / program, rom, program, recover="all")
        back = fs.read_component(tmp_path / program / "M.mtx", tmp_path / program / "K.mtx")
        assert np.array_equal(back.K.toarray(), rom.K) and np.array_equal(back.M.toarray(), rom.M)
        assert back.dofs is not None and back.dofs.name(23) == "uz at node 28"
        assert np.array_equal(fs.read_matrix(tmp_path / program / "recovery.mtx"), rom.V)
    deck = (tmp_path / "abaqus" / "arm.inp").read_text()
    assert "*MATRIX INPUT, NAME=FEMSUB_K, INPUT=K.mtx\n" in deck and deck.endswith("STIFFNESS=FEMSUB_K, MASS=FEMSUB_M\n")
    assert "cut-off 25688.1 rad" in deck
    fs.write_superelement(tmp_path, fs.damped(rom, rayleigh=(1.0, 1e-6), structural=0.02), "abaqus")
    assert "VISCOUS DAMPING=FEMSUB_D, STRUCTURAL DAMPING=FEMSUB_H\n" in (tmp_path / "arm.inp").read_text()
    for name, ours in (("D", 1.0 * rom.M + 1e-6 * rom.K), ("H", 0.02 * rom.K)):
        assert np.abs(fs.read_matrix(tmp_path / f"{name}.mtx") - ours).max() < 1e-15 * np.abs(ours).max()
    deck = (tmp_path / "calculix" / "arm.inp").read_text()
    assert deck.endswith("*BOUNDARY\n101003, 2, 2\n101003, 3, 3\n")  # seven modal coordinates, three at a node


def test_how_far_it_may_be_trusted_stands_beside_it(tmp_path: Path) -> None:
    mesh = fs.block((1.0, 0.1, 0.1), (3, 1, 1), "hexahedron")
    part = fs.solid(mesh, fs.Material(2.1e11, 0.3, 7850.0), interface=["left"], name="arm")
    rom = fs.reduce(part, fs.CraigBampton(band=(0.0, 8e3), tol=1e-2))
    for program in ("dmig", "abaqus", "calculix", "exudyn", *(["nastran"] if find_spec("pyyeti") else [])):
        files = fs.write_superelement(tmp_path / program, rom, program, full=part)
        about = json.loads((tmp_path / program / "validity.json").read_text())
        assert about["cutoff"] == rom.cutoff and rom.estimate is not None and about["estimate"] == rom.estimate.record()
        told = [path.name for path in files if path.suffix in (".inp", ".pch", ".asm") and
                f"cut-off {rom.cutoff:.6g} rad per unit of time, estimated error" in path.read_text()]
        assert len(told) == {"nastran": 2, "exudyn": 0}.get(program, 1)
    rom = fs.reduce(fs.chain(10), fs.CraigBampton(band=(0.0, 0.8), tol=1e-2))
    fs.write_superelement(tmp_path, rom, "dmig")
    about = json.loads((tmp_path / "validity.json").read_text())
    assert about["cutoff"] == rom.cutoff and rom.estimate is not None and about["estimate"] == rom.estimate.record()
    assert about["coordinates"][0] == {"node": 10100001, "direction": 0, "kind": "constraint"}
    assert "SPOINT  10100001    THRU" in (tmp_path / "chain.pch").read_text()


def test_what_no_program_takes_is_refused(arm: Any, tmp_path: Path) -> None:
    craig_chang = fs.reduce(fs.chain(10), fs.CraigChang(modes=3))
    for model, program, more, message in (
            (arm[1], "ansys", {}, "unknown program"), (craig_chang, "dmig", {}, "no coordinates"),
            (arm[1], "exudyn", {}, "the full one"), (arm[1], "dmig", {"number": 1000}, "at most 999"),
            (arm[1], "exudyn", {"full": fs.chain(10)}, "the full one"),
            (fs.damped(arm[1], structural=0.1), "calculix", {}, "no matrix for it"),
            (fs.damped(arm[1], rayleigh=(1.0, 0.0)), "calculix", {}, "no matrix for it"),
            (fs.damped(arm[1], rayleigh=(1.0, 0.0)), "exudyn", {"full": arm[0]}, "no matrix for it")):
        with pytest.raises(fs.InputError, match=message):
            fs.write_superelement(tmp_path, model, program, **more)


@pytest.mark.parametrize("held", [False, True])
def test_exudyn_has_the_frequencies_of_the_reduced_model(tmp_path: Path, held: bool) -> None:
    """Free, and clamped at one end with its frame at rest."""
    exu, fem = pytest.importorskip("exudyn"), pytest.importorskip("exudyn.FEM")
    mesh = fs.block((1.0, 0.1, 0.1), (6, 1, 1), "hexahedron")
    part = fs.solid(mesh, fs.Material(2.1e11, 0.3, 7850.0), interface=["right"], supports=["left"] if held else [], name="arm")
    rom = fs.reduce(part, fs.CraigBampton(modes=7))
    fs.write_superelement(tmp_path, rom, "exudyn", full=part)
    body, mbs = fem.ObjectFFRFreducedOrderInterface(), exu.SystemContainer().AddSystem()
    body.LoadFromFile(str(tmp_path / "arm.npz"))
    node = body.AddObjectFFRFreducedOrder(mbs)["nRigidBody"]
    if held:
        items = exu.itemInterface
        for coordinate in (0, 1, 2, 4, 5, 6):  # the Euler parameters have a constraint of their own
            ground = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0))
            marker = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
            mbs.AddObject(items.CoordinateConstraint(markerNumbers=[ground, marker]))
    mbs.Assemble()
    theirs = np.sqrt(np.sort(mbs.ComputeODE2Eigenvalues()[0]))
    rigid = 0 if held else 6
    ours = fs.normal_modes(rom, count=rom.size - rigid).frequencies
    assert len(theirs) == len(ours) and np.abs(theirs[rigid:] / ours[rigid:] - 1).max() < 1e-9
    assert body.totalMass == pytest.approx(78.5 if not held else body.totalMass)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
def test_calculix_solves_a_superelement(arm: Any, tmp_path: Path) -> None:
    """Clamped at its left end; CalculiX takes superelements from version 2.21."""
    rom = arm[1]
    fs.write_superelement(tmp_path, rom, "calculix")
    (tmp_path / "job.inp").write_text("*INCLUDE, INPUT=arm.inp\n*BOUNDARY\n" + "".join(f"{node}, 1, 3\n" for node in (1, 2, 3, 4))
                                      + "*STEP\n*FREQUENCY\n6\n*NODE PRINT, NSET=P101\nU\n*END STEP\n")
    done = subprocess.run(["ccx", "job"], cwd=tmp_path, capture_output=True, text=True, check=False)
    if "MATRIXASSEMBLE" in done.stdout:
        pytest.skip("CalculiX older than 2.21")
    lines = (tmp_path / "job.dat").read_text().split("MODE NO")[1].split("P A R T I C I P A T I O N")[0].splitlines()
    theirs = [float(words[2]) for words in map(str.split, lines) if len(words) == 5 and words[0].isdigit()]
    free = np.setdiff1d(np.arange(rom.size), rom.interface[rom.sets["left"]])
    ours = np.sqrt(scipy.linalg.eigh(rom.K[np.ix_(free, free)], rom.M[np.ix_(free, free)], eigvals_only=True))
    assert len(theirs) == 6 and np.abs(theirs / ours[:6] - 1).max() < 1e-5


def scene(folder: Path, text: str) -> dict[str, Any]:
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    assert main(["run", str(folder / "scene.toml"), "--out", str(folder / "out"), "--no-figures"]) == 0
    found: dict[str, Any] = json.loads((folder / "out" / "results.json").read_text())
    return found


def test_the_scene_tells_what_was_read_and_how_far_it_is_from_nastran(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pyyeti.nastran.op4")
    theirs = np.sqrt(np.loadtxt(DATA / "eigenvalues.txt")[6:12])
    parts = "".join(f'[part.{name}]\nsuperelement = "{DATA / name}board.asm"\n' for name in ("in", "out"))
    data = scene(tmp_path, f'scene = "superelements"\n{parts}[reduce]\nmethods = ["CC"]\nmodes = [4, 8]\nrepeats = 1\n'
                           f'[[ask]]\naudit = "parts"\n[[ask]]\nmodes = "band"\nreference = {[*theirs, 1e4]}\n'
                           '[[ask]]\ncompare = ["growth"]\n')
    assert "6 of 7 reference frequencies are met by modes of the model, within" in capsys.readouterr().out
    rows = data["modes"]["rows"][6:]
    assert [row["reference"] for row in rows] == theirs.tolist() and max(row["difference"] for row in rows) < 5e-8
    assert [(row["size"], row["grids"], row["modes"], row["own_frame"], row["faults"]) for row in data["audit"]["rows"]] == [
        (32, 4, 8, 12, 0), (46, 4, 22, 12, 0)]
    four, eight = (row["error_frequency"] for row in data["compare"]["rows"][1:])
    assert eight < 1e-6 < four < 1e-2 and data["compare"]["rows"][2]["error_force"] < 1e-3


def test_the_scene_joins_a_superelement_and_a_model_of_ours_and_tells_a_fault(arm: Any, tmp_path: Path,
                                                                             capsys: pytest.CaptureFixture[str]) -> None:
    fs.write_superelement(tmp_path, arm[1], "dmig")
    fs.write_matrices(tmp_path / "own", arm[1], "npz")
    text = re.sub(", sum .*", "", (tmp_path / "arm.pch").read_text(), count=1)
    mass, one = text.index("DMIG    MAAX"), "1.0000000000D+00\n"
    (tmp_path / "arm.pch").write_text(text[:mass] + text[mass:].replace(one, one.replace("1", "4", 1), 1))
    data = scene(tmp_path, 'band = [0.0, 2e3]\n[part.theirs]\nsuperelement = "arm.pch"\ncutoff = 1e4\n[part.ours]\n'
                           'superelement = "own/model.json"\n[[joint]]\nspring = ["theirs.1", "ours:0,1,2"]\nstiffness = 1e3\n'
                           '[[ask]]\naudit = "parts"\n[[ask]]\nmodes = "band"\n')
    assert [(row["part"], row["faults"]) for row in data["audit"]["rows"]] == [("theirs", 1), ("ours", 0)]
    assert "theirs: modes orthonormal" in " ".join(capsys.readouterr().out.split()) and len(data["modes"]["rows"]) >= 9
    fault = next(row for row in data["audit"]["checks"] if row["verdict"] == "fault")
    assert (fault["part"], fault["check"]) == ("theirs", "modes orthonormal")


@pytest.mark.parametrize(("order", "word"), [("<", 4), (">", 4), ("<", 8)])
def test_matrices_of_op2_of_every_kind(tmp_path: Path, order: str, word: int) -> None:
    rng = np.random.default_rng(1)
    A = rng.standard_normal((7, 5)) * (rng.random((7, 5)) > 0.4)
    A[:, 2] = 0.0
    file = Op2Writer(order, word).matrix("A", A).table("OUGV1", b"results ").matrix("B", A + 2j * A, 4)
    file.matrix("S", A.astype(np.float32), 1).matrix("C", (A + 1j * A).astype(np.complex64), 3).matrix("A", 2 * A)
    file.write(tmp_path / "a.op2")
    found = {name: fs.read_matrix(tmp_path / "a.op2", name).toarray() for name in ("a", "B", "s", "c", "a#2")}
    for name, expected in {"a": A, "B": A + 2j * A, "s": A.astype(np.float32), "c": (A + 1j * A).astype(np.complex64),
                           "a#2": 2 * A}.items():
        assert np.array_equal(found[name], expected), name
    with pytest.raises(fs.InputError, match="5 matrices"):
        fs.read_matrix(tmp_path / "a.op2")


@pytest.mark.slow
def test_matrices_of_op2_as_pyyeti_reads_them(tmp_path: Path) -> None:
    op2 = pytest.importorskip("pyyeti.nastran.op2")
    A = np.triu(np.random.default_rng(1).standard_normal((7, 5)))
    Op2Writer().matrix("A", A).table("OUGV1", b"results ").matrix("B", A + 2j * A, 4).write(tmp_path / "a.op2")
    for name, theirs in op2.OP2(str(tmp_path / "a.op2")).rdop2mats(which=0, lower=True).items():
        assert np.array_equal(theirs, fs.read_matrix(tmp_path / "a.op2", name).toarray()), name


def test_a_superelement_in_one_op2_file(arm: Any, tmp_path: Path) -> None:
    ours, found = arm[1], read(superelement_op2(tmp_path / "arm.op2", arm[1]))
    assert found.interface_dofs is not None and ours.interface_dofs is not None and found.full_dofs is not None
    place = [ours.interface_dofs.find(node, label)[0] for node, label in zip(
        found.interface_dofs.nodes, np.array(found.interface_dofs.labels)[found.interface_dofs.components], strict=True)]
    at = [*np.array(ours.interface)[place], *np.setdiff1d(np.arange(ours.size), ours.interface)]
    for A, B in ((ours.K, found.K), (ours.M, found.M)):
        assert np.abs(A[np.ix_(at, at)] - B).max() <= 1e-15 * np.abs(A).max()
    assert np.array_equal(found.interface_dofs.points, ours.interface_dofs.points[place]) and found.modes == 7
    x = np.zeros(found.size)
    x[found.interface[found.interface_dofs.components == 1]] = 1.0
    assert np.allclose((found.V @ x)[found.size:][found.full_dofs.components[found.size:] == 1], 1.0)


def test_op2_with_the_cards_beside_it(tmp_path: Path) -> None:
    pytest.importorskip("pyyeti.nastran.op4")
    for ending in ("asm", "pch"):
        shutil.copy(DATA / f"inboard.{ending}", tmp_path / f"part.{ending}")
    K, M = (fs.read_matrix(DATA / "inboard.op4", name) for name in ("kxx", "mxx"))
    Op2Writer().matrix("KAA", K).matrix("MAA", M).write(tmp_path / "part.op2")
    assert np.array_equal(read(tmp_path / "part.op2").K, read(DATA / "inboard.op4").K)


def test_faults_of_op2_are_told(arm: Any, tmp_path: Path) -> None:
    whole = superelement_op2(tmp_path / "arm.op2", arm[1]).read_bytes()
    for stop in [*np.linspace(0, len(whole) - 13, 20, dtype=int)]:
        (tmp_path / "arm.op2").write_bytes(whole[:stop])
        with pytest.raises(fs.InputError, match=r"arm\.op2"):
            read(tmp_path / "arm.op2")
    good = Op2Writer().matrix("A", np.eye(3))
    for old, new, message in ((good.words(101, 3, 3), good.words(101, 2, 3), "row 3 of column 3 in the matrix A of 3 x 2"),
                              (good.words(101, 3, 3), good.words(101, 4, 3), "3 columns in the matrix A"),
                              (good.words(101, 3, 3), good.words(101, 3, 2), "entries from row 3"),
                              (good.words(2, 0, 0), good.words(9, 0, 0), "type 9")):
        (tmp_path / "a.op2").write_bytes(good.bytes.replace(old, new))
        with pytest.raises(fs.InputError, match=message):
            fs.read_matrix(tmp_path / "a.op2")
    (tmp_path / "a.op2").write_text("      4      4 NASTRAN FORMATTED")
    with pytest.raises(fs.InputError, match=r"no \.op2 file"):
        fs.read_matrix(tmp_path / "a.op2")


def test_full_matrices_of_sierra(arm: Any, tmp_path: Path) -> None:
    full = arm[0]
    paths = sierra_text(tmp_path, "block_a", full)
    found = fs.read_component(*paths, interface=["3:*"])
    assert found.dofs is not None and found.dofs.nodes.tolist() == sorted(found.dofs.nodes)
    at = [full.dofs.find(node, found.dofs.labels[kind])[0]
          for node, kind in zip(found.dofs.nodes, found.dofs.components, strict=True)]
    for ours, theirs in ((full.K, found.K), (full.M, found.M)):
        assert abs(ours[at][:, at] - theirs).max() <= 1e-15 * abs(ours).max()
    for name in ("gid", "ASetMap"):
        (tmp_path / f"block_a_{name}.m").rename(tmp_path / f"other_{name}.m")
    assert abs(fs.read_matrix(paths[1]) - full.K).max() <= 1e-15 * abs(full.K).max()
    text = paths[1].read_text()
    for old, new, message in ((text[-200:], "", "no matrix of Sierra"), ("2 1 ", "1 2 ", "above the diagonal"),
                              ("NumRows = 84", "NumRows = 83", "two numbers of rows"), ("2 2 ", "1 1 ", "twice")):
        assert old in text
        paths[1].write_text(text.replace(old, new, 1))
        with pytest.raises(fs.InputError, match=message):
            fs.read_matrix(paths[1])
    paths[1].write_text(text)
    (tmp_path / "other_gid.m").rename(tmp_path / "block_a_gid.m")
    (tmp_path / "block_a_ASetMap.m").write_text("function x = a()\nx = zeros(252, 1);\nx(1) = 1;\n")
    with pytest.raises(fs.InputError, match="name 1 DOF of 28 nodes, and the matrix has 84 rows"):
        fs.read_matrix(paths[1])


def test_a_craig_bampton_model_of_sierra(arm: Any, tmp_path: Path) -> None:
    rom = arm[1].with_damping(1e-6 * arm[1].K)
    found = read(sierra_netcdf(tmp_path / "arm.nc4", rom))
    dofs = rom.interface_dofs
    assert dofs is not None and found.interface_dofs is not None and "Sierra/SD superelement" in found.method
    assert found.interface_dofs.nodes.tolist() == dofs.nodes.tolist() and np.array_equal(found.interface_dofs.points, dofs.points)
    at = np.array([*rom.interface, *np.setdiff1d(np.arange(rom.size), rom.interface)])
    for ours, theirs in ((rom.K, found.K), (rom.M, found.M), (rom.D, found.D)):
        assert np.abs(ours[np.ix_(at, at)] - theirs).max() <= 1e-15 * np.abs(ours).max()
    whole = (tmp_path / "arm.nc4").read_bytes()
    for content, message in ((whole[:700], "cannot be read|has no"), (b"\x89HDF\r\n\x1a\n", "netCDF 4"),
                             (b"12345", "no netCDF file")):
        (tmp_path / "arm.nc4").write_bytes(content)
        with pytest.raises(fs.InputError, match=message):
            read(tmp_path / "arm.nc4")
    with pytest.raises(fs.InputError, match="it has no cbmap"):
        read(sierra_netcdf(tmp_path / "arm.nc", rom, without="cbmap"))


PARTS = {  # floating and held, whose DOF have directions of nodes, names of their own, or no map
    "bar": lambda: fs.solid(fs.block((1.0, 0.1, 0.1), (10, 1, 1), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0),
                            interface=["left", "right"], name="part"),
    "beam": lambda: fs.beam(1.0, 8, E=2.1e11, I=1e-8, rho=7850.0, A=1e-3, interface=["left", "right"], name="part"),
    "pinned beam": lambda: fs.beam(1.0, 8, E=2.1e11, I=1e-8, rho=7850.0, A=1e-3, supports={"left": "pinned"},
                                   interface=["right"], name="part"),
    "chain": lambda: fs.chain(20, interface=[1, 20], damping=0.0)}


@pytest.mark.filterwarnings("ignore::femsub.checks.PortWarning")
@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("program", ["nastran", "dmig"])
def test_what_was_written_for_nastran_is_read_with_its_frequencies(program: str, part: str, tmp_path: Path) -> None:
    """Also with modes scaled to their largest entry, and where ten digits of K leave forces in rigid motion."""
    if program == "nastran":
        pytest.importorskip("pyyeti.nastran.op4")
    rom = fs.reduce(PARTS[part](), fs.CraigBampton(6))
    modal = np.array([kind == "fixed-interface" for kind in rom.kinds])
    s = np.where(modal, 1 / np.abs(rom.V).max(axis=0), 1.0)
    scaled = fs.ReducedSubstructure(rom.M * np.outer(s, s), rom.K * np.outer(s, s), None, {}, "part", V=rom.V * s,
                                    kinds=rom.kinds, cutoff=rom.cutoff, full_interface=rom.full_interface,
                                    full_dofs=rom.full_dofs)
    files = fs.write_superelement(tmp_path, scaled, program)
    found = fs.read_component(next(path for path in files if path.suffix in (".asm", ".pch")), cutoff=rom.cutoff)
    own, read = (fs.normal_modes(model, count=5) for model in (rom, found))
    assert read.rigid == own.rigid == {"bar": 6, "beam": 2, "pinned beam": 1, "chain": 0}[part]
    assert read.evidence == "certified" and np.abs(read.frequencies[own.rigid:] / own.frequencies[own.rigid:] - 1).max() < 1e-6
    assert found.kinds == ("constraint",) * len(rom.interface) + ("fixed-interface",) * 6
    assert fs.complex_modes(found).rigid.sum() == 2 * own.rigid


def test_a_model_without_an_interface_is_no_superelement(tmp_path: Path) -> None:
    rom = fs.reduce(fs.Substructure(np.eye(5), fs.chain(5).K, name="alone"), fs.CraigBampton(3))
    with pytest.raises(fs.InputError, match=r"'alone' has no interface, and Nastran joins.*write_matrices"):
        fs.write_superelement(tmp_path, rom, "dmig")


# ---- what a file says twice

WIDE = """GRID*                  1               0   0.0000000D+00   0.0000000D+00
*          0.0000000D+00               0
GRID*                  2               0   1.0000000D+00   0.0000000D+00
*          5.0000000D-01               0
SPOINT,11,THRU,12
EXTRN,1,123,2,1,11,0,12,0
"""


@pytest.mark.parametrize(("old", "new", "message"), [
    ("*          5.0000000D-01               0\n", "", r"GRID\* 2 has one line"),
    ("DMIG*   KAAX                          11               0", "DMIG*   KAAX                          11,              0",
     "neither in columns"),
    ("*                      2               1-1.000000000D+00", "*                      2               1-1,000000000D+00",
     "neither in columns"),
    ("DMIG*   KAAX                          11", "DMIX*   KAAX                          11", "'DMIX' of 'KAAX' is no DMIG"),
    ("*                     11               0 9.000000000D+00\n", "", "column 11  without an entry"),
    ("*                     11               0 9.000000000D+00", "*                     11               0",
     "as the value in row 11"),
    ("11               0 9.000000000D+00", "11               0 9." + 40 * " " + "5D+00", "behind column 80"),
    ("DMIG,MAAX,1,1,,1,1,1.5", "DMIG,MAAX,1,1,,1,1,1,5", "'1 5' as the value in row 1 1"),
    ("DMIG,MAAX,1,1,,1,1,1.5", "DMIG,MAAX,1,1,,1,1,,1.5", "'1.5' as the value"),
    ("GRID*                  2               0   1.0000000D+00", "GRID*                  2               0   1,0000000D+00",
     "neither in columns"),
])
def test_a_card_that_lost_a_part_is_refused(old: str, new: str, message: str, tmp_path: Path) -> None:
    text = WIDE + HEADS
    assert text.count(old) == 1
    assert read(written(tmp_path, text)).size == 5
    with pytest.raises(fs.InputError, match=message) as error:
        read(written(tmp_path, text.replace(old, new)))
    assert "part.pch" in str(error.value)


def test_the_asm_and_the_pch_must_have_the_same_grids(tmp_path: Path) -> None:
    """A grid that lost its second line was at z = 0: the part's K was 45 % off."""
    pytest.importorskip("pyyeti.nastran.op4")
    full = fs.solid(fs.block((1.0, 0.1, 0.1), (4, 1, 1), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0), interface=["right"],
                    supports=["left"], name="arm")
    files = {path.suffix: path for path in fs.write_superelement(tmp_path, fs.reduce(full, fs.CraigBampton(2)), "nastran")}
    head, *rest = files[".pch"].read_text().splitlines(keepends=True)
    lines = [head.partition(", by femsub")[0] + "\n", *rest]  # as files of Nastran
    asm = files[".asm"].read_text()
    at = max(at for at, line in enumerate(lines) if line.startswith("GRID*") and f"{line}{lines[at + 1]}" in asm
             and lines[at + 1].split()[1][0] != "0")
    files[".pch"].write_text("".join([*lines[:at + 1], "*\n", *lines[at + 2:]]))
    with pytest.raises(fs.InputError, match=r"has the grid \d+ at .* one file is damaged"):
        fs.read_component(files[".asm"], cutoff=1.0)
    files[".pch"].write_text("".join(lines[:at + 1]))
    with pytest.raises(fs.InputError, match=r"GRID\* \d+ has one line"):
        fs.read_component(files[".asm"], cutoff=1.0)
    place = next(at for at, line in enumerate(lines) if line.startswith("EXTRN"))
    files[".pch"].write_text("".join(lines[:place + 1] + lines[place + 2:]))
    with pytest.raises(fs.InputError, match="SECONCT joins the point"):
        fs.read_component(files[".asm"], cutoff=1.0)


@pytest.mark.parametrize("other", ["EXTRN", "KAAX", "7", "GRID*"])
@pytest.mark.parametrize("counted", [True, False])
def test_a_continuation_that_became_a_card_is_refused(other: str, counted: bool, arm: Any, tmp_path: Path) -> None:
    """It dropped one entry of the matrix."""
    path = next(path for path in fs.write_superelement(tmp_path, arm[1], "dmig") if path.suffix == ".pch")
    head, *lines = path.read_text().splitlines(keepends=True)
    at = next(at for at, line in enumerate(lines) if line.startswith("DMIG*")) + 2
    assert lines[at][:2] == "* "
    lines[at] = f"{other:8}{lines[at][8:]}"
    path.write_text("".join([head.partition(", sum")[0] + "\n" if counted else head.partition(", by femsub")[0] + "\n", *lines]))
    with pytest.raises(fs.InputError, match=r"card|GRID"):
        fs.read_component(path, cutoff=1.0)


def test_a_recovered_grid_without_its_card_is_reported(arm: Any, tmp_path: Path) -> None:
    pytest.importorskip("pyyeti.nastran.op4")
    files = {path.suffix: path for path in fs.write_superelement(tmp_path, arm[1], "nastran", recover="all")}
    head, *lines = files[".pch"].read_text().splitlines(keepends=True)
    at = max(at for at, line in enumerate(lines) if line.startswith("GRID*"))
    lines[at] = "GRAD*" + lines[at][5:]
    files[".pch"].write_text("".join([head.partition(", sum")[0] + "\n", *lines]))
    with pytest.raises(fs.InputError, match="a card 'GRAD', which femsub does not write"):
        fs.read_component(files[".asm"], cutoff=1.0)
    files[".pch"].write_text("".join([head.partition(", by femsub")[0] + "\n", *lines]))
    with pytest.warns(fs.FemsubWarning, match="no GRID card of 1 recovered grids"):
        fs.read_component(files[".asm"], cutoff=1.0)


# ---- motions that are recovered

@pytest.mark.parametrize("program", ["nastran", "dmig", "abaqus", "calculix"])
def test_the_nodes_that_are_recovered_are_chosen(arm: Any, program: str, tmp_path: Path) -> None:
    if program == "nastran":
        pytest.importorskip("pyyeti.nastran.op4")
    rom = arm[1]
    sizes = dict[str, int]()
    for name, recover in (("none", None), ("some", [5, 6]), ("all", "all")):
        files = fs.write_superelement(tmp_path / name, rom, program, recover=recover)
        sizes[name] = sum(path.stat().st_size for path in files)
        about = json.loads((tmp_path / name / "validity.json").read_text())
        assert about["recovered nodes"] == {"none": "none but the interface"}.get(name, recover)
        if program in ("nastran", "dmig"):
            found = read(tmp_path / name / "arm.pch")
            others = set(found.full_dofs.nodes.tolist()) - {2800, *rom.interface_dofs.nodes.tolist()}
            listed = {node for node in others if node < 1000}
            assert listed == {"none": set(), "some": {5, 6}}.get(name, set(range(1, 29)) - set(rom.interface_dofs.nodes.tolist()))
            assert np.abs(frequencies(found) - frequencies(rom)).max() < 1e-5 * frequencies(rom).max()
        elif name != "none":
            rows = np.flatnonzero(np.isin(rom.full_dofs.nodes, [5, 6])) if name == "some" else np.arange(len(rom.V))
            assert np.array_equal(fs.read_matrix(tmp_path / name / "recovery.mtx"), rom.V[rows])
            assert (tmp_path / name / "dofs.csv").read_text().count("\n") == 1 + len(rows)
    assert sizes["none"] < sizes["some"] < sizes["all"]
    with pytest.raises(fs.InputError, match=r"not node 99.*'all'"):
        fs.write_superelement(tmp_path, rom, program, recover=[5, 99])
    with pytest.raises(fs.InputError, match="recover"):
        fs.write_superelement(tmp_path, rom, program, recover="every")
    with pytest.raises(fs.InputError, match="not node 7777"):  # also of a model that is not reduced
        fs.write_superelement(tmp_path, arm[0], program, recover=[7777])


def test_what_is_recovered_is_what_was_written(arm: Any, tmp_path: Path) -> None:
    rom = arm[1]
    bare = dataclasses.replace(rom, full_dofs=None)
    fs.write_superelement(tmp_path / "bare", bare, "dmig", recover="all")
    held = dataclasses.replace(rom, V=np.where((rom.full_dofs.nodes == 6)[:, None], 0.0, rom.V))
    files = fs.write_superelement(tmp_path / "held", held, "dmig", recover=[6])
    for name in ("bare", "held"):
        assert json.loads((tmp_path / name / "validity.json").read_text())["recovered nodes"] == "none but the interface"
    assert "MUG1T" not in files[0].read_text() and "TUG1" not in files[0].read_text()
    read(files[0])
    with pytest.raises(fs.InputError, match="recover: Exudyn"):
        fs.write_superelement(tmp_path, rom, "exudyn", full=arm[0], recover=[5])


def test_a_full_target_is_named_not_the_temporary_folder(arm: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pyyeti.nastran.op4")

    def full(*given: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("shutil.copyfileobj", full)
    with pytest.raises(fs.InputError, match=r"the folder .*target cannot be written: No space left"):
        fs.write_superelement(tmp_path / "target", arm[1], "nastran")


@pytest.mark.slow
def test_recovered_motions_are_read_without_a_square_of_their_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The frames of all recovered motions were a full matrix: 36 GB for 60,000 of them."""
    full = fs.solid(fs.block((1.0, 0.1, 0.1), (45, 2, 2), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0), interface=["right"],
                    supports=["left"], name="bar")
    rom = fs.reduce(full, fs.CraigBampton(1))
    fs.write_superelement(tmp_path, rom, "dmig", recover="all")

    def cards(path: Path, lines: Any) -> Any:
        found = dmig_of(path, lines)
        tracemalloc.start()  # what comes behind the text of the cards, which takes more memory and far more time
        return found

    monkeypatch.setattr("femsub.io.superelements.dmig_of", cards)
    found = read(tmp_path / "bar.pch")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(found.V) > 1200 and 0 < peak < 8 * len(found.V) ** 2 / 2


@pytest.mark.parametrize("program", ["nastran", "dmig"])
def test_a_file_of_ours_says_how_many_lines_it_has(arm: Any, program: str, tmp_path: Path) -> None:
    """A column of DMIG that was lost left a smaller matrix, and nothing else in the file shows it."""
    if program == "nastran":
        pytest.importorskip("pyyeti.nastran.op4")
    for path in fs.write_superelement(tmp_path, arm[1], program):
        if path.suffix not in (".asm", ".pch"):
            continue
        assert read(path).size == arm[1].size
        lines = path.read_text().splitlines(keepends=True)
        for changed in (lines[:-2], [*lines[:-3], *lines[-1:]], [*lines, lines[-1]], [*lines[:-2], "\n", lines[-1]]):
            path.write_text("".join(changed))
            count = sum(map(bool, map(str.strip, changed)))
            with pytest.raises(fs.InputError, match=f"has {count} lines, but its first line says {len(lines)}"):
                read(path)
        path.write_text("".join(lines))
