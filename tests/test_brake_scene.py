"""The scene `brake`: its meshes, what it prints and writes, and what it refuses."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from brakescene import PADS, brake, brake_models

import femsub as fs
from femsub.app.cli import main
from femsub.app.grammar import Scene
from femsub.app.models import Models
from femsub.coupling.contacts.brake import brake_meshes
from femsub.coupling.contacts.friction_contact import contact_points

# faces of 80 mm: the chords of their arcs leave 7 % of a pad beside the track
pytestmark = pytest.mark.filterwarnings("ignore:only .* of .*face lies on:femsub.checks.PortWarning")

MESHES = Path(__file__).parent.parent / "meshes"
SMALL = """
scene = "brake"
band = [8e3, 1.4e4]
[material]
iron = {E = 1.1e11, nu = 0.26, rho = 7200.0}
friction = {E = 8e9, nu = 0.3, rho = 2600.0}
steel = {E = 2.1e11, nu = 0.3, rho = 7850.0}
[parameter.mu]
between = [0.0, 0.6]
[part]
disc.solid = {brake = "disc", size = 0.08}
inboard.solid = {brake = "inboard", size = 0.08}
outboard.solid = {brake = "outboard", size = 0.08}
[reduce]
methods = [["craig-bampton", "contact-modes"], "contact-modes", "real-modes"]
modes = [20, 30]
"""
UNSTABLE = '[[ask]]\ncomplex-modes = "full"\nat = {mu = 0.5}\nname = "unstable"\n'
COMPARE = '[[ask]]\ncompare = ["growth", "critical"]\nparameter = "mu"\nvalues = [0.5]\n'


def half(mesh: fs.Mesh, name: str) -> np.ndarray:
    """The nodes of a set on one side of the plane y = 0."""
    nodes = mesh.sets[name]
    return nodes[mesh.points[nodes, 1] > -1e-9]


@cache
def models() -> Models:
    return brake_models(0.08)


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
    found = run(tmp_path, text + COMPARE + UNSTABLE, "--no-figures")
    assert found["unstable"]["models"][0]["evidence"] == "certified" and found["verdict"]["answer"] == "yes"
    assert not any("Completeness" in line for line in found["verdict"]["unchecked"])
    assert any("at mu = 0.5" in line for line in found["verdict"]["decides"] if "Completeness" in line)


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
    found = fs.facing(("outboard", "face"), ("disc", "outboard"), meshes)
    under = found.nodes
    assert set(under) < set(meshes["disc"].sets["outboard"])
    angle = np.degrees(np.arctan2(*meshes["disc"].points[under, 1::-1].T))
    assert np.abs(angle).max() < 30 + 90 / 7 + 1
    pad = meshes["outboard"], "face", "outboard.face"
    assert found.coverage[0] == pytest.approx(1.0, abs=1e-9) and 0.5 < found.coverage[1] < 0.8
    assert contact_points(pad, (meshes["disc"], "outboard", "disc.outboard"), None).share == pytest.approx(1.0, abs=1e-9)
    narrow = meshes["disc"].with_sets(part=half(meshes["disc"], "outboard"))
    assert 0.45 < contact_points(pad, (narrow, "part", "disc.part"), None).share < 0.55


def test_the_parts_meet_in_their_contacts_alone() -> None:
    system = models().full
    assert list(system.parts) == ["disc", *PADS]
    assert set(system.sets) == {f"disc.{name}-facing-{name}-face" for name in PADS} | {f"{name}.face" for name in PADS}
    assert len(system.interface) == sum(map(len, system.sets.values()))
    pencil = system.linearised(models().at({"mu": 0.0}))
    assert abs(pencil.K - pencil.K.T).max() <= 1e-9 * abs(pencil.K).max()
    assert fs.normal_modes(fs.Substructure(pencil.M, (pencil.K + pencil.K.T) / 2), count=1).rigid == 0


@pytest.mark.slow
def test_the_scene_tells_unstable_modes_errors_and_the_critical_mu(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    data = run(tmp_path, SMALL + UNSTABLE + COMPARE + '[[ask]]\nflutter = "mu"\npoints = 3\nfull = [0.5]\n'
               '[[ask]]\ncritical = "mu"\nevery = true\nmodels = "best"\n')
    said = " ".join(capsys.readouterr().out.split())
    (row,) = data["unstable"]["unstable"]
    assert row["growth"] > row["error_bar"]
    assert row["damping"] == pytest.approx(-100 * row["growth"] / np.hypot(row["growth"], row["omega"]), rel=1e-12)
    assert sum(row[f"energy_{name}"] for name in ("disc", *PADS)) == pytest.approx(1.0)
    full, *rows = data["compare"]["rows"]
    best, = data["critical"]
    assert 0 < full["critical"] < 0.5 and best["value"] == pytest.approx(full["critical"], rel=1e-2)
    lost, = data["critical-all"]["rows"]
    assert lost["evidence"] == "certified" and lost["value"] == pytest.approx(best["value"], rel=1e-4)
    assert {row["method"] for row in rows} == {"craig-bampton", "contact-modes", "real-modes"}
    errors = {(row["method"], row["modes"]): row["error_eigenvalue"] for row in rows}
    assert errors["contact-modes", 30] < errors["contact-modes", 20] and errors["contact-modes", 30] < errors["real-modes", 30]
    best, = (one["model"] for one in data["compare"]["recommended"])
    assert best["missed"] == 0 and best["error_critical"] <= 1e-2
    assert re.search(r"Stability is lost in the flutter diagram: of .* at μ = 0\.\d+", said)
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"flutter.png", "compare.png"} <= written
    assert {f"unstable{end}" for end in (".png", "-unstable.csv", "-shape.vtu", "-shape.pvd")} <= written


@pytest.mark.slow
def test_below_the_critical_mu_nothing_is_unstable(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = run(tmp_path, SMALL + UNSTABLE.replace("0.5", "0.1"), "--no-figures")
    assert data["unstable"]["unstable"] == [] and "Steady sliding is stable" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(("text", "words"), [
    ("[parameter.mu]\nbetween = [-0.1, 0.5]", "parameter.mu: it must not be negative, but is -0.1"),
    ("[parameter.mu]\nbetween = [0.5, 0.1]", "parameter.mu.between"),
    ("[contact.inboard]\nmu = -0.5", "contact.inboard.mu: it must not be negative"),
    ("[contact.inboard]\nstiffness = 0.0", "contact.inboard.stiffness: it must be positive"),
    ("[contact.inboard]\npressure = -1.0", "contact.inboard.pressure: it must not be negative"),
    ("[joint.springs]\nstiffness = -1.0", "joint.springs.stiffness: it must not be negative"),
    ("[material.friction]\nnu = 0.5", "material.friction.nu: it must be above -1 and below 0.5, but is 0.5"),
    ("[contact.inboard]\nslop = 1.0", "unknown key 'slop'; did you mean 'slope'"),
    ('[part.disc]\nsolid = "disc.vtu"', "line 2: part.disc: there is no file "),
])
def test_what_is_out_of_range_is_told(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "scene.toml").write_text(f'scene = "brake"\n{text}\n', encoding="utf-8")
    with pytest.raises(fs.InputError, match=re.escape(words)):
        Scene.from_file(tmp_path / "scene.toml")


@pytest.mark.parametrize(("held", "words"), [
    (["back"], r"'(in|out)board' is not supported against turning"),
    ([], r"'(in|out)board' is not supported against 3 rigid motions")])
def test_a_pad_that_springs_do_not_hold_is_refused(held: list[str], words: str) -> None:
    joints = {"springs": {"mount": [f"{name}.{place}" for name in PADS for place in held], "stiffness": 1e7}} if held else {}
    ask = {"complex-modes": "full", "at": {"mu": 0.5}, "band": [0.0, 1.4e4]}
    scene = Scene(brake(0.08).table | {"joint": joints, "ask": [ask]})
    with pytest.raises(fs.InputError, match=words):
        scene.run(lambda _: None)


def test_pads_that_do_not_touch_and_sets_that_are_not_there_are_told(tmp_path: Path) -> None:
    pytest.importorskip("meshio")
    for name, mesh in brake_meshes(0.08).items():
        fs.write_mesh(tmp_path / f"{name}.vtu", mesh)
    table = brake(0.08).table
    table |= {"part": {name: {**part, "solid": f"{name}.vtu"} for name, part in table["part"].items()}}

    def rubbing(inboard: list[str], outboard: list[str]) -> Scene:
        pairs = {"inboard": {"friction": inboard}, "outboard": {"friction": outboard}}
        return Scene(table | {"contact": {name: {**one, **pairs[name]} for name, one in table["contact"].items()}}, tmp_path)

    assert Scene(table, tmp_path).models.full.size == models().full.size
    with pytest.raises(fs.InputError, match=r"contact.inboard: inboard.face and disc.outboard do not face each other: no"):
        _ = rubbing(["inboard.face", "disc.outboard"], ["outboard.face", "disc.inboard"]).models.full
    with pytest.raises(fs.InputError, match="do not face each other"):
        _ = rubbing(["inboard.back", "disc.inboard"], ["outboard.back", "disc.outboard"]).models.full
    with pytest.raises(fs.InputError, match=r"unknown set 'faces'; did you mean 'face'"):
        rubbing(["inboard.faces", "disc.inboard"], ["outboard.face", "disc.outboard"])


def test_a_face_that_lies_beside_the_track_is_told() -> None:
    meshes = brake_meshes(0.08)
    disc = meshes["disc"].with_sets(inboard=half(meshes["disc"], "inboard"))
    with pytest.MonkeyPatch.context() as patch, pytest.warns(fs.FemsubWarning, match=r"only 4\d % of inboard\.face lies on"):
        patch.setattr("femsub.app.parts.solid._brake", lambda size: meshes | {"disc": disc})
        assert brake_models(0.08).full.size
