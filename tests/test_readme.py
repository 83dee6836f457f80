"""Everything in the README runs."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
import scipy.io

import femsub as fs
from femsub.app.cli import main

ROOT = Path(__file__).parent.parent
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL)


def blocks(language: str) -> list[str]:
    return [text for kind, text in BLOCKS if kind == language]


def test_all_kinds_of_blocks_are_known() -> None:
    assert {kind for kind, _ in BLOCKS} == {"sh", "python", "toml"}


@pytest.mark.parametrize("code", blocks("python"))
def test_python(code: str, tmp_path: Path) -> None:
    (tmp_path / "meshes").symlink_to(ROOT / "meshes")
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert all(path.name in code for path in tmp_path.iterdir() if path.name != "meshes")  # only what it names


def test_the_example_prints_what_its_comments_say() -> None:
    done = subprocess.run([sys.executable, "-c", blocks("python")[0]], capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert "20 eigenvalues, unstable (16 of them grow)" in lines[0]
    assert [round(float(word), 4) for word in lines[1].split()] == [0.0212, 0.0212]
    assert [round(float(word), 6) for word in lines[2].split()] == [-0.025567, -0.025567]


def test_your_own_matrices_lose_their_stability_where_the_full_model_does() -> None:
    code = next(block for block in blocks("python") if "sp.diags_array" in block)
    names: dict[str, object] = {}
    exec(code, names)
    sub, rom, band = names["sub"], names["rom"], names["band"]
    exact, found = fs.critical_slope(sub, band=band), fs.critical_slope(rom, band=band)
    assert found.slope == pytest.approx(exact.slope, rel=1e-3) and round(found.slope, 4) == -0.0235
    assert found.omega == pytest.approx(exact.omega, rel=1e-6) and round(found.omega) == 316
    with pytest.raises(ValueError, match="cut-off"):
        fs.critical_slope(fs.reduce(sub, fs.CraigChang(modes=20)), band=band)


@pytest.mark.parametrize("text", blocks("toml"))
def test_scene_files(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    sub = fs.chain(10)
    for name in "MK":
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", getattr(sub, name).tocoo())
    (tmp_path / "my.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert main(["run", "my.toml", "--out", "out"]) == 0, capsys.readouterr().err
    assert (tmp_path / "out" / "results.json").exists()


def test_commands_exist_and_the_scenes_they_name() -> None:
    for line in "".join(blocks("sh")).splitlines():
        script, *words = line.split()
        assert (ROOT / script).stat().st_mode & 0o111, f"{script} cannot be executed"
        if words[:1] == ["run"]:
            from femsub.app.scene import load

            load(words[1])


def test_files_that_are_named_exist() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for name in re.findall(r"\((scripts/[\w./-]+)\)|`(scripts/[\w./-]+|\.ci/run|tests/[\w.]+)", text):
        assert (ROOT / (name[0] or name[1])).exists(), name
