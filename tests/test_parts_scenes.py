"""The scenes of joined parts: the chain in pieces, and parts from matrices and meshes."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

import femsub as fs
from femsub.app.cli import main
from femsub.app.grammar import Scene
from femsub.coupling import cut_chain
from femsub.modes.normal_modes import all_modes

CHAIN = """
scene = "chain-parts"
band = [0.0, 0.37]
[part.chain]
chain = 24
belt = 5
[reduce]
modes = [1, 3]
repeats = 1
[[ask]]
compare = ["growth", "critical", "held"]
vary = {"part.chain.cut" = [2, 4]}
"""
OWN = """
name = "own"
band = [0.0, 0.3]
[part.front]
matrices = {M = "front-M.mtx", K = "front-K.mtx"}
ports = {belt = [2]}
[part.back]
matrices = {M = "back-M.mtx", K = "back-K.mtx"}
interface = 0
[[joint]]
rigid = ["front:7", "back"]
[[joint]]
spring = ["front:0", "ground"]
stiffness = 0.5
[contact.belt]
belt = "front.belt"
slope = -0.1
[reduce]
methods = [{front = "hcb", back = "full"}, {front = "rubin"}]
modes = [2, 5]
ports = false
repeats = 1
[[ask]]
compare = ["growth", "critical", "held"]
listed = 20
"""


def run(folder: Path, text: str) -> dict[str, Any]:
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    assert main(["run", "-v", str(folder / "scene.toml"), "--out", str(folder / "out"), "--no-figures"]) == 0
    found: dict[str, Any] = json.loads((folder / "out" / "results.json").read_text())
    return found


def written(folder: Path) -> tuple[fs.Substructure, fs.Substructure]:
    """Two chains, their matrices in files."""
    front, back = fs.chain(8, fixed=False, damping=0.0), fs.chain(9, fixed=False, damping=0.0, masses=2.0)
    for name, part in (("front", front), ("back", back)):
        for key in "MK":
            scipy.io.mmwrite(folder / f"{name}-{key}.mtx", getattr(part, key))
    return front, back


@pytest.mark.sampled(3)
@pytest.mark.parametrize("pieces", [2, 3, 5, 9])
@pytest.mark.parametrize("belt", [1, 4, 10])
def test_the_pieces_of_the_chain_are_the_chain(pieces: int, belt: int) -> None:
    masses = np.linspace(1.0, 2.0, 10)
    parts, joints, port = cut_chain(10, pieces, belt, masses=masses, springs=masses[::-1])
    system, whole = fs.couple(parts, joints), fs.chain(10, belt, masses=masses, springs=masses[::-1])
    assert list(system.ports) == [port] and len(parts) == pieces
    np.testing.assert_allclose(all_modes(system.K, system.M).eigenvalues, all_modes(whole.K, whole.M).eigenvalues, rtol=1e-11)
    band = (0.0, 3.0)
    slope = float(fs.critical_slope(whole, band=band))
    assert float(fs.critical_slope(system, port, band=band)) == pytest.approx(slope, rel=1e-8, abs=1e-12)


@pytest.mark.slow
def test_the_chain_in_parts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = run(tmp_path, CHAIN)
    for count in (2, 4):
        rows = [row for row in data["compare"]["rows"] if row["cut"] == count]
        assert rows[0]["size"] == 24 and rows[0]["error_force"] == 0
        bampton = [row for row in rows if row["method"] == "craig-bampton"]
        assert [row["modes"] for row in bampton] == [count, 3 * count]
        assert bampton[1]["error_frequency"] < bampton[0]["error_frequency"]
        assert bampton[1]["error_force"] < bampton[0]["error_force"]
    said = " ".join(capsys.readouterr().out.split())
    assert [one["cut"] for one in data["compare"]["recommended"]] == [2, 4]
    assert all(one["sentence"] in said for one in data["compare"]["recommended"])
    assert (tmp_path / "out" / "compare.csv").read_text().startswith("cut,method,modes,size,")


def test_coordinates_of_reduced_parts_are_no_translations(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The pieces of the scene's own chain, reduced by MacNeal's method, were told that M and K were in each other's place."""
    run(tmp_path, 'scene = "chain-parts"\n[reduce]\nmethods = ["macneal", "dual-craig-bampton"]\nrepeats = 1\n'
        '[[ask]]\ncompare = ["growth"]\nvary = {"part.chain.cut" = [5]}\n')
    assert "each other's place" not in capsys.readouterr().err


def test_own_parts_are_joined_and_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    front, back = written(tmp_path)
    data = run(tmp_path, OWN)
    rows = data["compare"]["rows"]
    assert [(row["method"], row["modes"], row["size"]) for row in rows[1:]] == [
        ("craig-bampton", 2, 12), ("craig-bampton", 5, 15), ("rubin", 2, 13), ("rubin", 5, 16)]
    assert all(row["modes_front"] == row["modes"] and "modes_back" not in row for row in rows[1:])
    assert rows[4]["error_frequency"] < rows[3]["error_frequency"] < 0.1
    # the same by hand: the chains end to end, held by a spring
    K = np.zeros((16, 16))
    M = np.zeros((16, 16))
    for part, at in ((front, slice(0, 8)), (back, slice(7, 16))):
        K[at, at] += part.K.toarray()
        M[at, at] += part.M.toarray()
    K[0, 0] += 0.5
    w = np.eye(16)[2]
    slope = float(fs.critical_slope(fs.Substructure(M, K, ports={"belt": w}), band=(0.0, 0.3)))
    assert rows[0]["critical"] == pytest.approx(slope, abs=1e-12) and rows[0]["size"] == 16
    assert "joined" not in capsys.readouterr().err


def two_blocks(folder: Path, names: Sequence[str], apart: float, meshes: list[fs.Mesh]) -> list[fs.Mesh]:
    """Mesh files of two blocks, the second moved along x."""
    meshes[1] = replace(meshes[1], points=meshes[1].points + np.array([apart, 0, 0]))
    for name, mesh in zip(names, meshes, strict=True):
        fs.write_mesh(folder / f"{name}.vtu", mesh)
    return meshes


@pytest.mark.slow
def test_a_mesh_is_tied_to_another(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("meshio")
    two_blocks(tmp_path, ("left", "right"), 0.2, [fs.block((0.2, 0.05, 0.05), counts, "hexahedron20")
                                                  for counts in ((3, 2, 2), (2, 1, 1))])
    text = """
band = [1.0, 6e4]
units = "SI"
[material.steel]
E = 2.1e11
rho = 7850.0
[part.held]
solid = "left.vtu"
material = "steel"
supports = ["left"]
rayleigh = [5.0, 1e-7]
[part.loose]
solid = "right.vtu"
material = "steel"
ports = {belt = ["right", "y"]}
rayleigh = [5.0, 1e-7]
[[joint]]
tied = ["held.right", "loose.left"]
[contact.belt]
belt = "loose.belt"
force = 100.0
[reduce]
modes = [12]
ports = false
repeats = 1
[[ask]]
compare = ["growth", "critical"]
listed = 20
"""
    data = run(tmp_path, text)
    rows = data["compare"]["rows"]
    assert len(rows) == 3 and rows[0]["missing"] == 0 and rows[0]["critical"] < 0
    assert all(row["error_frequency"] < 0.02 and row["error_force"] < 0.1 for row in rows[1:])
    printed = capsys.readouterr().out
    worst = max(row["port_error"] for row in rows)
    assert worst > 0.01 and f"the static response to the contact is off by up to {100 * worst:.2g} %" in printed
    assert not {"modes.csv", "modes.vtu"} & {path.name for path in (tmp_path / "out").iterdir()}  # nobody asked
    again = run(tmp_path, text.replace("ports = false", "ports = true"))
    assert again["compare"]["rows"][0]["critical"] == pytest.approx(rows[0]["critical"], rel=1e-9)
    assert "static response to the contact" not in capsys.readouterr().out


RUBBING = """
band = [1e3, 1e5]
units = "SI"
[material.steel]
E = 2.1e11
rho = 7850.0
[part.pad]
solid = "pad.vtu"
material = "steel"
rayleigh = [1.0, 1e-9]
[part.beam]
solid = "beam.vtu"
material = "steel"
supports = ["left", "right"]
rayleigh = [1.0, 1e-9]
[[joint]]
spring = ["pad.top", "ground"]
stiffness = 1e7
[contact.rub]
friction = ["pad.bottom", "beam.top"]
stiffness = 2e12
direction = [1.0, 0.0, 0.0]
[reduce]
methods = [["craig-bampton", "contact-modes"], "contact-modes"]
modes = [8, 20]
tolerance = 0.05
repeats = 1
[parameter.mu]
between = [0.0, 1.0]
[[ask]]
compare = ["growth", "critical"]
parameter = "mu"
values = [0.2, 0.6]
"""


@pytest.mark.slow
def test_own_parts_with_friction_tell_the_error_of_the_critical_mu(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("meshio")
    meshes = {"pad": fs.block((0.06, 0.03, 0.05), (3, 2, 1), "hexahedron"),
              "beam": fs.block((0.2, 0.05, 0.02), (7, 2, 1), "hexahedron")}
    meshes["beam"] = replace(meshes["beam"], points=meshes["beam"].points - [0.07, 0.01, 0.02])
    for name, mesh in meshes.items():
        fs.write_mesh(tmp_path / f"{name}.vtu", mesh)
    data = run(tmp_path, RUBBING)
    found, printed = data["compare"], capsys.readouterr().out
    full, *rows = found["rows"]
    steel = fs.Material(2.1e11, 0.3, 7850.0)
    parts = {"pad": fs.solid(meshes["pad"], steel, interface=["bottom", "top"], rayleigh=(1.0, 1e-9)),
             "beam": fs.solid(meshes["beam"], steel, supports=["left", "right"], interface=["top"], rayleigh=(1.0, 1e-9))}
    contact = fs.FrictionContact("pad.bottom", "beam.top", meshes, 2e12, 0.0, direction=np.array([1.0, 0, 0]))
    system = fs.couple(parts, [contact, fs.Spring(("pad", "top"), "ground", stiffness=1e7)])
    growth = [fs.complex_modes(system, replace(contact, mu=mu), band=(1e3, 1e5)).growth
              for mu in (0.3 * full["critical"], 0.7 * full["critical"], 0.9999 * full["critical"], 1.0001 * full["critical"])]
    assert max(growth[:3]) < 0 < growth[3]
    assert [(row["method"], row["modes"]) for row in rows] == [
        ("craig-bampton", 8), ("craig-bampton", 20), ("contact-modes", 8), ("contact-modes", 20)]
    for row in rows:
        if row["cutoff"] < 1e5:  # no border in a band that the basis does not cover
            assert row["critical"] is None and row["error_critical"] is None and "reaches above the cut-off" in row["reason"]
        else:
            error = abs(row["critical"] / full["critical"] - 1)
            assert row["error_critical"] == pytest.approx(error, rel=1e-3)
    assert [row["cutoff"] < 1e5 for row in rows] == [True, False] * 2
    best, = found["recommended"]
    assert best["model"]["error_critical"] <= 0.05 and best["model"]["missed"] == 0
    assert best["sentence"] in " ".join(printed.split()) and "critical μ" in printed


@pytest.mark.parametrize(("change", "words"), [
    (("front:7", "front:8"), "part.front: interface: there is no DOF 8; the model has 8"),
    (("front:7", "frnt:7"), "line 11: joint 1.rigid: unknown part 'frnt'; did you mean 'front'"),
    (("front:7", "front:x"), "'front:x' must list DOF behind the colon"),
    (('rigid = ["front:7", "back"]\n[[joint]]\n', ""), "part.back: it is joined to nothing"),
    (("[part.back]", "[part.front]"), "not a TOML file: Cannot declare .'part', 'front'. twice"),
    (("[part.back]", '[part."b.1"]'), "a word without a dot"),
    (("[part.back]", "[part.ground]"), "other than 'ground'"),
    (('M = "front-M.mtx", ', ""), "part.front.matrices: the key 'M' is missing"),
    (('back = "full"', 'back = "ful"'), "did you mean 'full'"),
    (('belt = "front.belt"', 'belt = "back.belt"'), "'back' has no port 'belt'"),
    (('belt = "front.belt"', 'belt = "bck.belt"'), "unknown part 'bck'; did you mean 'back'"),
    (('spring = ["front:0", "ground"]\nstiffness = 0.5', 'tied = ["front:0", "ground"]'), "glue joins surfaces of meshes"),
    (("interface = 0\n", ""), "line 9: joint 1: 'back' has no interface"),
    (("stiffness", "stifness"), "line 14: joint 2.stifness: unknown key 'stifness'; did you mean 'stiffness'"),
])
def test_what_does_not_fit_is_told(change: tuple[str, str], words: str, tmp_path: Path,
                                   capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path)
    assert change[0] in OWN
    (tmp_path / "scene.toml").write_text(OWN.replace(*change, 1), encoding="utf-8")
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert re.search(words, said) and said.startswith("femsub: ") and "Traceback" not in said, said
    first, *others = said.splitlines()
    assert not others or (first.endswith(" faults:") and all(re.match("  line [0-9]+: ", line) for line in others)), said
    assert not (tmp_path / "out").exists()


def test_a_method_that_a_part_does_not_take_is_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A part that floats with its interface held has no constraint modes; the other methods are compared all the same."""
    written(tmp_path)
    two = fs.chain(8, fixed=False, damping=0.0)
    K = np.zeros((16, 16))
    K[:8, :8] = K[8:, 8:] = two.K.toarray()
    scipy.io.mmwrite(tmp_path / "front-K.mtx", K)
    scipy.io.mmwrite(tmp_path / "front-M.mtx", np.eye(16))
    data = run(tmp_path, OWN)
    assert {row["method"] for row in data["compare"]["rows"]} == {"full", "rubin"}
    assert "Craig-Bampton is left out" in capsys.readouterr().out and "'front'" in data["compare"]["left_out"][0]


def test_a_refusal_that_comes_late_leaves_a_method_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A held part has no mass left by MacNeal without modes: this shows at the end of its reduction only. With modes it has."""
    written(tmp_path)
    scipy.io.mmwrite(tmp_path / "front-K.mtx", fs.chain(8).K)
    text = OWN.replace('[{front = "hcb", back = "full"}, {front = "rubin"}]', '[{front = "macneal"}, {front = "hcb"}]').replace(
        "[2, 5]", "[0, 2]")
    data = run(tmp_path, text)
    assert [row["method"] for row in data["compare"]["rows"]] == ["full", "macneal", "craig-bampton", "craig-bampton"]
    assert "each part by MacNeal with 0 modes is left out: M has no mass" in " ".join(capsys.readouterr().out.split())
    (tmp_path / "scene.toml").write_text(text.replace(', {front = "hcb"}', "").replace("[0, 2]", "[0]"), encoding="utf-8")
    assert main(["run", str(tmp_path / "scene.toml")]) == 2
    assert "M has no mass" in capsys.readouterr().err


def test_parts_are_reduced_for_the_study_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written(tmp_path)
    reduced: list[Any] = []
    monkeypatch.setattr("femsub.reduction.steps.reduce", lambda sub, method, *given, **options: (
        reduced.append(method), fs.reduce(sub, method, *given, **options))[1])
    data = run(tmp_path, OWN)
    assert [list(one) for one in reduced] == [["front"]] * 4
    assert data["compare"]["left_out"] == []


def test_natural_frequencies_are_listed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Those of the full system in the band, with those of the model that is recommended."""
    front, back = written(tmp_path)
    text = OWN.replace(', {front = "rubin"}', "").replace("[2, 5]", "[2]\ntolerance = 0.05").replace(
        "band = [0.0, 0.3]", 'band = [0.1, 0.6]\nunits = "SI"')
    data = run(tmp_path, text)["compare"]
    pieces = {"front": fs.Substructure(front.M, front.K, interface=[0, 7]),
              "back": fs.Substructure(back.M, back.K, interface=[0])}
    system = fs.couple(pieces, [fs.Rigid(("front", [7]), ("back", [0])), fs.Spring(("front", [0]), "ground", stiffness=0.5)])
    own, model = (all_modes(one.K, one.M).frequencies[1:4]  # the first lies below the band
                  for one in (system, fs.reduce(system, {"front": fs.CraigBampton(2)})))
    rows = data["frequencies"]
    assert [row["mode"] for row in rows] == [1, 2, 3]
    np.testing.assert_allclose([row["omega"] for row in rows], own, rtol=1e-9)
    np.testing.assert_allclose([row["frequency_hz"] for row in rows], own / (2 * np.pi), rtol=1e-9)
    np.testing.assert_allclose([row["reduced"] for row in rows], model, rtol=1e-9)
    np.testing.assert_allclose([row["error"] for row in rows], model / own - 1, rtol=1e-6)
    assert (tmp_path / "out" / "compare-frequencies.csv").read_text().startswith("mode,omega,frequency_hz,reduced,error\n")
    said = " ".join(capsys.readouterr().out.split())
    assert "the band, and of Craig-Bampton with 12 DOF, in rad/s: mode ω Hz reduced ω" in said
    alone = run(tmp_path, text.replace("0.05", "1e-9"))["compare"]["frequencies"]
    np.testing.assert_allclose([row["omega"] for row in alone], own, rtol=1e-9)
    assert "reduced" not in alone[0]
    assert re.search(r"natural frequencies of the full model in the band, in rad/s:\nmode +ω +Hz\n", capsys.readouterr().out)


@pytest.mark.parametrize("kinds", [("hexahedron", "hexahedron"), ("hexahedron", "tetra")])
def test_modes_of_joined_parts_are_drawn_on_their_meshes(kinds: tuple[str, str], tmp_path: Path) -> None:
    """Two blocks side by side, and a chain on them: one field a mode, the largest displacement of all meshes 1."""
    meshio = pytest.importorskip("meshio")
    pytest.importorskip("matplotlib")
    written(tmp_path)
    meshes = two_blocks(tmp_path, "ab", 0.1, [fs.block((0.1, 0.1, 0.1), (1, 1, 1), kind) for kind in kinds])
    table = {
        "band": [0.0, 3e4], "units": "SI", "material": {"steel": {"E": 2.1e11, "rho": 7850.0}},
        "part": {"a": {"solid": "a.vtu", "material": "steel", "supports": ["left"]},
                 "b": {"solid": "b.vtu", "material": "steel"},
                 "chain": {"matrices": {"M": "front-M.mtx", "K": "front-K.mtx"}}},
        "joint": [{"tied": ["b.left", "a.right"]}, {"spring": ["chain:0", "a:1"], "stiffness": 1.0}],
        "ask": [{"modes": "band"}]}
    result = Scene(table, tmp_path).run(lambda _: None)
    rows = result.data["modes"]["rows"]
    parts = {name: fs.solid(mesh, fs.Material(2.1e11, 0.3, 7850.0), supports={"left": "clamped"} if name == "a" else {},
                            interface=["right" if name == "a" else "left"]) for name, mesh in zip("ab", meshes, strict=True)}
    system = fs.couple(parts, [fs.Tied(("b", "left"), ("a", "right"), dict(zip("ab", meshes, strict=True)))])
    found = fs.normal_modes(system, band=(10.0, 3e4))  # above those of the chain
    assert len(rows) == 8 + len(found.frequencies) > 10
    np.testing.assert_allclose([row["omega"] for row in rows[8:]], found.frequencies, rtol=1e-8)
    assert "not drawn, since they have no mesh: chain" in result.text()
    pieces = {"modes": [0, 1]} if kinds[0] == kinds[1] else {"modes-hexahedron": [0], "modes-tetra": [1]}
    assert set(result.drawings) == set(pieces) == {name.removesuffix(".vtu") for name in result.files}
    moved, fields = system.expand(found.shapes[:, 2]), []
    for mesh, (name, part) in zip(meshes, parts.items(), strict=True):
        assert part.dofs is not None
        fields.append(fs.displacements(mesh, part.dofs, moved[name]))
    largest = max(np.linalg.norm(field, axis=1).max() for field in fields)
    for name, places in pieces.items():
        with (tmp_path / f"{name}.vtu").open("wb") as file:
            result.files[f"{name}.vtu"](file)
        drawn = meshio.read(tmp_path / f"{name}.vtu")
        np.testing.assert_allclose(drawn.points, np.vstack([meshes[i].points for i in places]))
        assert set(np.concatenate([block.data.ravel() for block in drawn.cells])) == set(range(len(drawn.points)))
        assert len([key for key in drawn.point_data if key.startswith("mode-")]) == len(rows)
        shape = drawn.point_data[f"mode-11 {rows[10]['omega'] / (2 * np.pi):.4g} Hz"]
        np.testing.assert_allclose(abs(shape), abs(np.vstack([fields[i] for i in places])) / largest, atol=1e-6)
        assert len([axis for axis in result.drawings[name]().axes if axis.get_title().startswith("mode ")]) == 6


@pytest.mark.slow
def test_figures_of_parts_are_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    (tmp_path / "scene.toml").write_text(CHAIN.replace("[2, 4]", "[2]"), encoding="utf-8")
    assert main(["run", "-v", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "compare.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.sampled(6)
@pytest.mark.parametrize("span", [(0.27, 0.44), (0.9, 4.1), (0.2, 1.1), (0.002, 0.15), (140.0, 160.0)])
def test_numbers_at_an_axis_do_not_collide(span: tuple[float, float]) -> None:
    """Within a factor of 5, matplotlib set nine numbers of four digits side by side."""
    pytest.importorskip("matplotlib")
    from femsub.output import few_decades, new_figure

    figure = new_figure(12.4, 6.4)
    axes = figure.subplots(2, 4)
    axes[0, 0].set(xscale="log", xlim=span)
    few_decades(axes[0, 0])
    figure.canvas.draw()
    boxes = [label.get_window_extent() for label in axes[0, 0].get_xticklabels()
             if label.get_text() and span[0] <= label.get_position()[0] <= span[1]]
    assert len(boxes) >= 2 and all(one.x1 < two.x0 for one, two in pairwise(boxes))
