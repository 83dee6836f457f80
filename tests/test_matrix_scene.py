"""The scene of one's own matrices: names from a DOF map in, reduced matrices out."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from matrixhelp import numbered

import femsub as fs
from femsub.app.cli import main

SCENE = """
scene = "matrices"
band = [0.0, 0.9]
[part.part]
matrices = {M = "K.mas", K = "K.sti", dofs = "K.dof"}
interface = ["1.1", "8:ux"]
ports = {belt = ["4:ux"]}
[contact.belt]
slope = -0.1
[reduce]
modes = [3]
repeats = 1
"""
WRITTEN = SCENE + '[[ask]]\nmatrices = "mtx"\n'


def calculix_chain(folder: Path) -> fs.Substructure:
    sub = fs.chain(20, belt=4)
    numbered(folder / "K.sti", sub.K, sp.triu)
    numbered(folder / "K.mas", sub.M, sp.triu)
    (folder / "K.dof").write_text("".join(f"{node}.1\n" for node in range(1, 21)))
    return sub


@pytest.mark.parametrize("format", ["mtx", "mat"])
def test_a_scene_writes_reduced_matrices(tmp_path: Path, capsys: pytest.CaptureFixture[str], format: str) -> None:
    sub = calculix_chain(tmp_path)
    (tmp_path / "scene.toml").write_text(WRITTEN.replace("mtx", format))
    assert main(["run", str(tmp_path / "scene.toml")]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"K.sti", "K.mas", "K.dof", "scene.toml"}
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out")]) == 0, capsys.readouterr().err
    assert "craig-chang-3" in capsys.readouterr().out
    read = fs.read_component(tmp_path / "out" / "craig-bampton-3")
    undamped = fs.Substructure(sub.M, sub.K, None, [0, 7], {"belt": sub.port("belt")}, "part")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        expected = fs.reduce(undamped, fs.CraigBampton(3))
    assert read.V.shape == (20, 5) and np.allclose(read.K, expected.K, atol=1e-12)
    assert read.full_dofs.name(3) == "ux at node 4"
    assert json.loads((tmp_path / "out" / "results.json").read_text())["matrices"] == ["craig-bampton-3", "craig-chang-3"]


def test_reduced_matrices_are_only_written_on_request(tmp_path: Path) -> None:
    calculix_chain(tmp_path)
    (tmp_path / "scene.toml").write_text("figures = false\n" + SCENE)
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out")]) == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"results.json", "critical.csv", "complex-modes.csv",
                                                                    "complex-modes-unstable.csv", "compare.csv"}


@pytest.mark.parametrize(("change", "words"), [
    (('"K.dof"', '"L.dof"'), "there is no file"), (('"4:ux"', '"4:uy"'), "there is no uy at node 4"),
    (('"4:ux"', "4.5"), "port 'belt': 4.5 is not a DOF"), (('"4:ux"', "20"), "there is no DOF 20"),
    (('"mtx"', '"mtz"'), "'mtz'; did you mean 'mtx'"), (('"K.sti"', '"K.dof"'), "K: "),
])
def test_a_scene_with_bad_names(tmp_path: Path, capsys: pytest.CaptureFixture[str], change: tuple[str, str], words: str) -> None:
    calculix_chain(tmp_path)
    (tmp_path / "scene.toml").write_text(WRITTEN.replace(*change))
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr().err
    assert change[0] in WRITTEN and words in printed and printed.count("\n") == 1 and not (tmp_path / "out").exists()
