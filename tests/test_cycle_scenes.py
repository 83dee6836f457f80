"""The scenes of limit cycles: tables, branches, figure; and what they refuse."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from femsub.cli import main


def scene_file(folder: Path, text: str) -> str:
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_cycles_and_branches_of_the_chain(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = 'scene = "chain-limit-cycle"\nband = [0.6, 0.9]\nfamilies = 1\ndots = 1\nperiods = 300\nharmonics = 100\npoints = 60\n'
    assert main(["run", scene_file(tmp_path, text), "--out", str(tmp_path / "out")]) == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"results.json", "results.csv", "bifurcation.png"}
    data = json.loads((tmp_path / "out" / "results.json").read_text())
    found = {row["model"]: row for row in data["cycles"]}
    assert found["HCB"]["omega"] == pytest.approx(0.7245, rel=1e-4) and found["HCB"]["is_stable"] is True
    assert found["CC"]["omega"] == pytest.approx(0.7227, rel=1e-4) and found["CC"]["is_stable"] is True
    assert found["full"]["is_stable"] is False
    assert {item["model"] for item in data["branches"]} == {"full", "HCB", "CC"}
    for item in data["branches"]:
        assert item["hopf"]["error"] < 1e-6 and item["hopf"]["supercritical"] is True
    # where a transient ends on the cycle, it lies on the branch
    dots = {dot["model"]: dot for dot in data["transients"]}
    branch = next(item for item in data["branches"] if item["model"] == "CC")
    near = min(branch["points"], key=lambda point: abs(point["slope"] - dots["CC"]["value"]))
    assert dots["CC"]["omega"] == pytest.approx(near["omega"], rel=5e-3)
    assert dots["CC"]["rms"] == pytest.approx(near["rms"], rel=0.05)
    assert "Branches over the slope" in capsys.readouterr().out


def test_full_plate_and_its_reduced_models(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = ('scene = "plate-limit-cycle"\nelements = [4, 3]\nmodes = [8]\noutputs = ["cycles"]\nfigures = false\n')
    assert main(["run", scene_file(tmp_path, text), "--out", str(tmp_path / "out")]) == 0
    rows = {row["model"]: row for row in json.loads((tmp_path / "out" / "results.json").read_text())["cycles"]}
    assert rows["CC"]["omega_error"] < 1e-4 and rows["HCB"]["rms_error"] < 1e-2
    assert "Limit cycles at v0" in capsys.readouterr().out


@pytest.mark.parametrize(("text", "words"), [
    ('parameter = "speeed"', "did you mean 'speed'"), ("slope = -0.2", "needs a friction law"), ("families = 0", "at least 1"),
    ("between = [1.0]", "between must be"), ('dots_from = "rest"', "unknown dots_from"), ("force = 0.001", "no cycle begins"),
])
def test_a_bad_scene_ends_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, words: str) -> None:
    scene = scene_file(tmp_path, f'scene = "chain-limit-cycle"\n{text}\n')
    assert main(["run", scene, "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert words in printed.err and printed.err.count("\n") == 1 and not (tmp_path / "out").exists()
