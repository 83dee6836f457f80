"""Four files that users asked for, each of at most 30 lines, beside the Python calls."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import femsub as fs
from femsub.app.grammar import Scene

MESHES = Path(__file__).parents[1] / "meshes"

MOTION = """
units = "SI"
band = [0, "3 kHz"]
[part.beam]
matrices = {M = "calculix/beam.mas", K = "calculix/beam.sti", dofs = "calculix/beam.dof"}
interface = ["17:*"]
ports = {belt = ["17:uy"]}
rayleigh = [5.0, 1e-5]
[contact.belt]
belt = "beam.belt"
force = 400.0
eps = 0.1
[reduce]
methods = ["craig-chang"]
modes = [8]
[[ask]]
motion = [0.0, 0.005]
tol = 1e-4
"""
FLUTTER = """
ask = [{critical = "mu", models = "best"}, {flutter = "mu"}, {complex-modes = "best", at = {mu = 0.6}}]
units = "SI"
band = ["200 Hz", "3 kHz"]
[material.iron]
E = 1.1e11
rho = 7200.0
[material.lining]
E = 5e9
rho = 2500.0
[parameter.mu]
between = [0.0, 0.7]
[part.disc]
solid = "brake-disc.vtu"
material = "iron"
supports = ["hub"]
[part.pad]
solid = "brake-inboard.vtu"
material = "lining"
[joint.springs]
mount = ["pad.back", "pad.leading", "pad.trailing"]
stiffness = 1e7
[contact.pad]
friction = ["pad.face", "disc.inboard"]
facing = true
stiffness = 2e11
axis = [0.0, 0.0, 1.0]
[reduce]
methods = ["contact-modes"]
modes = [30]
"""
RESPONSE = """
band = [1.0, 60.0]
[part.in]
superelement = "nastran/inboard.asm"
cutoff = 314.0
ports = {root = ["3:uz"]}
[part.out]
superelement = "nastran/outboard.asm"
cutoff = 314.0
ports = {tip = ["11:uz"]}
[[joint]]
rigid = ["in", "out"]
[reduce]
modes = [6, 12]
[[ask]]
response = ["out.tip"]
observe = ["out.tip", "in.root"]
frequencies = 100
"""
CYCLE = """
units = "SI"
band = [0, "3 kHz"]
[material.steel]
E = 2.1e11
rho = 7850.0
[part.disc]
solid = "disc-with-pad.msh"
material = "steel"
supports = ["inner"]
ports = {belt = ["pad", "y"]}
rayleigh = [2.0, 1e-7]
[contact.belt]
belt = "disc.belt"
force = 60000.0
law = "stribeck-arctan-odd"
eps = 0.05
speed = 0.4
[reduce]
methods = ["craig-chang"]
modes = [12]
[[ask]]
cycles = 1
"""


def ran(text: str, tmp_path: Path) -> tuple[Scene, dict[str, Any], str]:
    """A file run beside the meshes, from a folder of its own: its scene, data and what it prints."""
    lines = text.strip().splitlines()
    assert len(lines) <= 30
    path = tmp_path / "own.toml"
    path.write_text(text.replace('= "calculix', f'= "{MESHES}/calculix').replace('= "nastran', f'= "{MESHES}/nastran').replace(
        '= "brake-', f'= "{MESHES}/brake-').replace('= "disc-with', f'= "{MESHES}/disc-with'), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene = Scene.from_file(path)
        found = scene.run(lambda said: None)
    return scene, found.data, found.printed(scene.units, True)


@pytest.mark.slow
def test_motion_in_time_of_own_matrices_under_a_belt(tmp_path: Path) -> None:
    scene, data, _ = ran(MOTION, tmp_path)
    full, small = data["motion"]["models"]
    assert full["size"] == 144 and small["size"] < 30
    run = fs.transient(scene.models.reduced[0].model, scene.models.contacts, (0.0, 0.005), impulse=1e-3, step=0.005 / 20_000,
                       tol=1e-4)
    window = (0.75 * 0.005, 0.005)
    assert small["rms"] == pytest.approx(fs.rms(run.t, run.velocity("belt"), window), rel=1e-4)


@pytest.mark.rare
def test_flutter_of_own_meshes_with_friction(tmp_path: Path) -> None:
    scene, data, text = ran(FLUTTER, tmp_path)
    assert "Hz" in text and "damping [%]" in text
    row, = data["critical"]
    small = scene.models.best.model
    exact = fs.critical_value(small, scene.models.at({}), "mu", between=(0.0, 0.7),
                              band=scene.models.band_below(scene.models.best))
    assert row["value"] == pytest.approx(exact.value, rel=1e-5)
    modes = fs.complex_modes(small, scene.models.at({"mu": 0.6}), band=scene.models.band_below(scene.models.best))
    assert len(data["complex-modes"]["unstable"]) == len(modes.unstable)


@pytest.mark.slow
def test_response_of_two_joined_superelements(tmp_path: Path) -> None:
    scene, data, _ = ran(RESPONSE, tmp_path)
    system = scene.models.full
    omega = np.linspace(1.0, 60.0, 100)
    exact = fs.frequency_response(system, at=omega, loads="out.tip", responses=["out.tip", "in.root"])
    small = fs.frequency_response(scene.models.reduced[-1].model, at=omega, loads="out.tip", responses=["out.tip", "in.root"])
    off = np.abs(small.receptance - exact.receptance)[:, :, 0].max(axis=0) / np.abs(exact.receptance[:, :, 0]).max(axis=0)
    rows = data["response"]["rows"][-2:]
    assert [row["place"] for row in rows] == ["out.tip", "in.root"] and len(scene.parts) == 2
    assert all(row["error"] >= 0.99 * one for row, one in zip(rows, off, strict=True))


@pytest.mark.rare
def test_limit_cycle_of_a_solid_from_a_mesh_of_ones_own(tmp_path: Path) -> None:
    scene, data, _ = ran(CYCLE, tmp_path)
    row = next(row for row in data["cycles"] if row["model"] == "craig-chang" and "omega" in row)
    exact = fs.harmonic_balance(scene.models.reduced[0].model, scene.models.contacts, start=row["family"])
    assert row["omega"] == pytest.approx(exact.omega, rel=1e-6) and row["rms"] == pytest.approx(exact.rms, rel=1e-4)
