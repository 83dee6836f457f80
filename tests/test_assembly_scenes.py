"""The scenes plate-parts and solid-parts: what they join, show and recommend."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import femsub as fs
from femsub.app.cli import main
from femsub.app.grammar import Scene
from femsub.components.pictures import _far_to_near

POSTS = [f"post{i}" for i in range(1, 5)]
GLUED = [*POSTS, "carrier", "pad"]  # those whose lower face lies within another part's upper one


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("fineness", "kind"), [(1, "hexahedron"), (2, "hexahedron"), (1, "hexahedron27")])
def test_the_assembly_is_joined_at_any_fineness(fineness: int, kind: str) -> None:
    """Each glued surface lies within the other, no face meets one of its own size, and bolts meet in a place."""
    table = {"scene": "solid-parts", "part": {}}
    for name, part in Scene({"scene": "solid-parts"}).table["part"].items():
        counts = [fineness * count for count in part["solid"]["elements"]]
        table["part"][name] = {"solid": {**part["solid"], "elements": counts, "cells": kind}}
    scene = Scene(table)
    meshes, system = scene.meshes, scene.models.full
    assert len(system.parts) == 8 and fs.normal_modes(system, 1).frequencies[0] > 0
    glued = sum(3 * len(meshes[above].sets["bottom"]) for above in GLUED)
    assert system.size == sum(part.size for part in system.parts.values()) - glued
    for post in POSTS:
        ends = [meshes[name].points[meshes[name].sets[end]] for name, end in ((post, "head"), ("cover", post))]
        np.testing.assert_allclose(ends[0], ends[1], atol=1e-12)


def test_parts_are_shown_and_the_modes_recommended_meet_the_tolerance(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text('scene = "plate-parts"\nband = [0.0, 1500.0]\n[part.plate]\n'
                                         'plate = {lengths = [0.4, 0.3], elements = [12, 6]}\ncut = 4\n'
                                         '[[ask]]\nparts = true\n[[ask]]\nmodes-per-part = 1e-3\n', encoding="utf-8")
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--no-figures"]) == 0
    data = json.loads((tmp_path / "out" / "results.json").read_text())
    mesh = fs.rectangle((0.4, 0.3), (12, 6))
    shown = fs.read_mesh(tmp_path / "out" / "parts.vtu")
    assert {name: len(cells) for name, cells in shown.groups.items()} == {row["part"]: row["cells"] for row in data["parts"]}
    assert len(shown.cells) == len(mesh.cells)
    cut = fs.cut(mesh, fs.plate, into=4, E=2.1e11, nu=0.3, rho=7850.0, thickness=0.002, supports={"left": "clamped"},
                 ports={"belt": [0.3, 0.2]})
    roms = {row["part"]: fs.reduce(cut.parts[row["part"]], fs.CraigBampton(row["modes"]), ports=True)
            for row in data["modes-per-part"]["parts"]}
    reduced, full = (fs.normal_modes(fs.couple(parts, cut.joints), 12).frequencies for parts in (roms, cut.parts))
    inside = full <= 1500.0
    assert inside.sum() > 4 and np.abs(reduced / full - 1)[inside].max() <= 1e-3


def test_what_is_seen_before_is_painted_later() -> None:
    """From the right in front and above: y small, z large, x large."""
    brick = fs.block((1.0, 1.0, 1.0), (1, 1, 1), "hexahedron").points
    wide = brick * (5.0, 5.0, 1.0)
    assert _far_to_near({"above": wide + np.array((0, 0, 1)), "below": brick}) == ["below", "above"]
    assert _far_to_near({"front": brick, "back": wide + np.array((0, 1, 0))}) == ["back", "front"]
    assert _far_to_near({"right": brick + np.array((5, 0, 0)), "left": wide}) == ["left", "right"]
