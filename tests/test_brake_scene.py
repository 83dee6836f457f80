"""The scene `brake`: its meshes, what it prints and writes, and what it refuses."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import femsub as fs
from femsub.app.cli import main
from femsub.app.scene import load
from femsub.app.scenes.brake import PADS, Brake, BrakeScene
from femsub.coupling.contacts.brake import brake_meshes, opposite
from femsub.coupling.contacts.friction_contact import contact_points

# faces of 80 mm: the chords of their arcs leave 7 % of a pad beside the track
pytestmark = pytest.mark.filterwarnings("ignore:only .* of the face:femsub.errors.PortWarning")

MESHES = Path(__file__).parent.parent / "meshes"
SMALL = ('scene = "brake"\nsize = 0.08\nfull = [0.5]\nband = [8e3, 1.4e4]\nmu = [0.0, 0.6]\nmodes = [20, 30]\n'
         'methods = ["HCB"]\npoints = 3\nE = [1.1e11, 8e9, 2.1e11]\nnu = [0.26, 0.3, 0.3]\nrho = [7200, 2600, 7850]\n')


def half(mesh: fs.Mesh, name: str) -> np.ndarray:
    """The nodes of a set on one side of the plane y = 0."""
    nodes = mesh.sets[name]
    return nodes[mesh.points[nodes, 1] > -1e-9]


@cache
def brake() -> Brake:
    return Brake(BrakeScene(size=0.08), lambda _: None)


def run(folder: Path, text: str, *words: str) -> dict[str, Any]:
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    assert main(["run", str(folder / "scene.toml"), "--out", str(folder / "out"), *words]) == 0
    found: dict[str, Any] = json.loads((folder / "out" / "results.json").read_text())
    return found


@pytest.mark.slow
def test_unstable_modes_are_counted_where_a_comparison_counts_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a full model beyond 2,000 DOF the study measures seconds without a count: the run once told 'not checked'."""
    monkeypatch.setattr("femsub.studies.error_vs_time.QUADRATIC", 0)
    text = SMALL.replace("modes = [20, 30]", "modes = [20]")
    found = run(tmp_path, f'{text}outputs = ["unstable", "error-time"]\nfigures = false\n')
    assert found["completeness"] == "certified" and found["verdict"]["answer"] == "yes"
    assert not any("Completeness" in line for line in found["verdict"]["unchecked"])
    assert any("at μ = 0.5" in line for line in found["verdict"]["decides"] if "Completeness" in line)


def test_the_meshes_are_those_that_gmsh_makes() -> None:
    pytest.importorskip("meshio")
    for name, mesh in brake_meshes(0.025).items():
        shipped = fs.read_mesh(MESHES / f"brake-{name}.vtu")
        assert (len(mesh.points), len(mesh.cells)) == (len(shipped.points), len(shipped.cells))
        order = [np.lexsort(one.points.round(7).T) for one in (mesh, shipped)]
        np.testing.assert_allclose(mesh.points[order[0]], shipped.points[order[1]], atol=1e-7)
        for key in set(mesh.sets) & set(shipped.sets):
            assert len(mesh.sets[key]) == len(shipped.sets[key])


def test_only_the_faces_under_the_pads_carry_the_contact() -> None:
    meshes = brake_meshes(0.025)
    under = opposite(meshes["outboard"], "face", meshes["disc"], "outboard")
    assert set(under) < set(meshes["disc"].sets["outboard"])
    angle = np.degrees(np.arctan2(*meshes["disc"].points[under, 1::-1].T))
    assert np.abs(angle).max() < 30 + 90 / 7 + 1
    pad = meshes["outboard"], "face", "outboard.face"
    assert 0.97 < contact_points(pad, (meshes["disc"], "outboard", "disc.outboard"), None).share <= 1 + 1e-9
    narrow = meshes["disc"].with_sets(part=half(meshes["disc"], "outboard"))
    assert 0.45 < contact_points(pad, (narrow, "part", "disc.part"), None).share < 0.55


def test_the_parts_meet_in_their_contacts_alone() -> None:
    system = brake().system
    assert list(system.parts) == ["disc", *PADS]
    assert set(system.sets) == {f"disc.under-{name}" for name in PADS} | {f"{name}.face" for name in PADS}
    assert len(system.interface) == sum(map(len, system.sets.values()))
    pencil = system.linearised(brake().contacts(0.0))
    assert abs(pencil.K - pencil.K.T).max() <= 1e-9 * abs(pencil.K).max()
    assert fs.normal_modes(fs.Substructure(pencil.M, (pencil.K + pencil.K.T) / 2), count=1).rigid == 0


@pytest.mark.slow
def test_the_scene_tells_unstable_modes_errors_and_the_critical_mu(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    data = run(tmp_path, SMALL + 'outputs = ["unstable", "error-time", "flutter", "losses"]\n')
    said = capsys.readouterr().out
    (row,) = data["unstable"]
    assert row["growth"] > row["error_bar"] and row["damping"] == pytest.approx(-2 * row["growth"] / row["omega"], rel=1e-3)
    assert sum(row[f"energy_{name}"] for name in ("disc", *PADS)) == pytest.approx(1.0)
    critical = data["flutter"]["critical"]
    assert 0 < critical["full"]["mu"] < 0.5 and critical["reduced"]["mu"] == pytest.approx(critical["full"]["mu"], rel=1e-2)
    assert data["losses"]["evidence"] == "certified" and len(data["losses"]["rows"]) == 1
    assert data["losses"]["rows"][0]["mu"] == pytest.approx(critical["reduced"]["mu"], rel=1e-4)
    rows = data["error-time"]["rows"][1:]
    assert {row["method"] for row in rows} == {"craig-bampton", "contact-modes", "real-modes"}
    errors = {(row["method"], row["modes"]): row["error_eigenvalue"] for row in rows}
    assert errors["contact-modes", 30] < errors["contact-modes", 20] and errors["contact-modes", 30] < errors["real-modes", 30]
    best = data["error-time"]["recommended"]
    assert best["missed"] == 0 and best["error_critical"] <= 1e-2
    assert re.search(r"of the reduced model at μ = 0\.\d+, of the full model at μ = 0\.\d+", " ".join(said.split()))
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"unstable.vtu", "most-unstable.pvd", "unstable.png", "flutter.png", "error-time.png", "unstable.csv"} <= written


def test_below_the_critical_mu_nothing_is_unstable(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = run(tmp_path, SMALL.replace("full = [0.5]", "full = [0.1]") + 'outputs = ["unstable"]\n')
    assert data["unstable"] == [] and "All modes decay" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(("text", "words"), [
    ("mu = [-0.1, 0.5]", "mu must not be negative, but is -0.1"),
    ("mu = [0.5, 0.1]", "mu"),
    ("full = [-0.5]", "full must not be negative"),
    ("contact = 0.0", "contact must be positive"),
    ("pressure = -1.0", "pressure must not be negative"),
    ("turning = 0.0", "turning must be positive"),
    ("springs = 0.0", "springs must be positive"),
    ("nu = [0.3, 0.5, 0.3]", "nu must be above -1 and below 0.5, but is 0.5 in place 2"),
    ("speed = 1.0", "the friction of a brake is Coulomb's, with mu, pressure and turning"),
    ('disc = "disc.vtu"', "'inboard' is missing"),
    ('units = "mm-t-s"', "femsub's own brake is in SI units"),
])
def test_what_is_out_of_range_is_told(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "scene.toml").write_text(f'scene = "brake"\n{text}\n', encoding="utf-8")
    with pytest.raises(fs.InputError, match=re.escape(words)):
        load(str(tmp_path / "scene.toml"))


def test_a_pad_that_springs_do_not_hold_is_refused() -> None:
    with pytest.raises(fs.InputError, match=r"the pad '(in|out)board' is not supported against turning"):
        Brake(BrakeScene(size=0.08, sprung=["back"]), lambda _: None)
    with pytest.raises(fs.InputError, match=r"the pad '(in|out)board' is not supported against 3 rigid motions"):
        Brake(BrakeScene(size=0.08, sprung=[]), lambda _: None)


def test_pads_that_do_not_touch_and_sets_that_are_not_there_are_told(tmp_path: Path) -> None:
    pytest.importorskip("meshio")
    meshes = brake_meshes(0.08)
    for name, mesh in meshes.items():
        fs.write_mesh(tmp_path / f"{name}.vtu", mesh)
    files = {name: f"{name}.vtu" for name in meshes}
    own = Brake(BrakeScene(folder=str(tmp_path), **files), lambda _: None)
    assert own.system.size == brake().system.size
    with pytest.raises(fs.InputError, match="face and outboard do not touch"):
        Brake(BrakeScene(folder=str(tmp_path), tracks=["outboard", "inboard"], **files), lambda _: None)
    with pytest.raises(fs.InputError, match=r"do not face each other|do not touch"):
        Brake(BrakeScene(folder=str(tmp_path), face="back", **files), lambda _: None)
    with pytest.raises(fs.InputError, match=r"unknown set of nodes .*'faces'; did you mean 'face'"):
        Brake(BrakeScene(folder=str(tmp_path), face="faces", **files), lambda _: None)


def test_a_face_that_lies_beside_the_track_is_told() -> None:
    meshes = brake_meshes(0.08)
    disc = meshes["disc"].with_sets(inboard=half(meshes["disc"], "inboard"))
    with pytest.MonkeyPatch.context() as patch, pytest.warns(fs.FemsubWarning, match=r"only 4\d% of the face 'face' of 'inb"):
        patch.setattr("femsub.app.scenes.brake.brake_meshes", lambda size: meshes | {"disc": disc})
        assert Brake(BrakeScene(size=0.08), lambda _: None).system.size
