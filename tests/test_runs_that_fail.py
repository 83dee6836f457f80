"""Scene files and command lines with odd content end in one line on stderr and an exit status, and leave no traceback."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import femsub as fs
from femsub.app.cli import READER_GONE, main

DEEP = "x = " + "[" * 3000 + "]" * 3000

CHAIN = 'scene = "chain"\n'
ODD = {
    'scene = ["chain"]': "scene: it must be a string",
    "scene = 3": "scene: it must be a string",
    DEEP: "nested too deeply",
    CHAIN + "[part.chain]\nchain = 10000000000": "at most",
    CHAIN + f"[part.chain]\nchain = 1{'0' * 400}": "at most",
    CHAIN + "[contact.belt]\nspeed = inf": "contact.belt.speed",
    CHAIN + "[reduce]\nsizes = []": "reduce.sizes: it is an empty list",
    CHAIN + "ask = []": "nothing is asked",
    CHAIN + "[part.chain]\nmasses = 1e308": "Choose other units",
    CHAIN + "[part.chain]\nmasses = 1e-300": "Choose other units",
    CHAIN + "[part.chain]\ndamping = 1e308": "Choose other units",
    CHAIN + "[part.chain]\nsprings = 1e308": "NaN or Inf",
    CHAIN + "[contact.belt]\neps = 1e-320": "contact.belt: eps must be positive",
    CHAIN + "[reduce]\nrepeats = 100000000000": "repeats: it must be at least 1 and at most 1000",
    CHAIN + "[contact.belt]\nforce = -1.0": "force: it must not be negative",
    'scene = "plate"\n[part.plate]\nplate = {lengths = [0.4, 0.3], elements = [100000, 100000]}': "GB",
    'scene = "plate"\n[part.plate]\nthickness = 1e200': "Choose other units",
    'scene = "solid"\n[part.disc]\nsolid = {radii = [0.05, 0.15], thickness = 0.01, elements = [100000, 100000, 3]}': "GB",
    'scene = "beam"\n[part.beam]\nelements = 10000000000': "at most",
    'scene = "beam"\n[material.steel]\nE = 1e308': "Choose other units",
    'scene = "chain-transient"\n[[ask]]\nmotion = [0.0, 10.0]\nstep = 1e-300': "points",
    'scene = "matrices"\n[part.part]\nmatrices = {M = "/dev/zero", K = "/dev/null"}': "no file",
}


@pytest.mark.parametrize("text", ODD, ids=lambda text: text[:40])
def test_odd_scenes_end_in_one_line(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "odd.toml").write_text(text, encoding="utf-8")
    assert main(["run", str(tmp_path / "odd.toml"), "--out", str(tmp_path / "out")]) in (1, 2)
    said = capsys.readouterr()
    assert ODD[text] in said.err and said.err.count("\n") == 1 and len(said.err) < 400
    assert not (tmp_path / "out").exists()


PLANTED = (CHAIN + "[reduce]\nrepeats = 1\nsizes = [5]\n" + '[[ask]]\ncritical = "slope"\n[[ask]]\ncomplex-modes = "all"\n'
           '[[ask]]\ncompare = ["growth", "critical", "held"]\n')


@pytest.mark.parametrize(("thrown", "status", "lacking"), [
    (fs.NotConvergedError("planted"), 1, {"complex-modes"}), (KeyboardInterrupt(), 130, {"complex-modes", "compare"})])
def test_what_was_computed_before_an_output_fails_is_kept(thrown: BaseException, status: int, lacking: set[str], tmp_path: Path,
                                                          monkeypatch: pytest.MonkeyPatch,
                                                          capsys: pytest.CaptureFixture[str]) -> None:
    from femsub.app.asks.complex_modes import ComplexModesAsk

    def fails(*_: object) -> None:
        raise thrown

    monkeypatch.setattr(ComplexModesAsk, "run", fails)
    (tmp_path / "scene.toml").write_text(PLANTED, encoding="utf-8")
    assert main(["run", "-v", str(tmp_path / "scene.toml"), "--no-figures", "--out", str(tmp_path / "out")]) == status
    said, data = capsys.readouterr(), json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    assert {"critical", "complex-modes", "compare"} - set(data) == lacking
    assert data["critical"] and "Critical dμ/dv" in said.out
    if status == 1:
        assert data["failed"] == {"complex-modes": "NotConvergedError: planted"}
        assert "complex-modes: failed; planted" in said.out and "complex-modes failed: NotConvergedError: planted" in said.err
    else:
        assert data["complete"] is False and "incomplete" in said.out


def test_ctrl_c_ends_a_block_and_nothing_else_does() -> None:
    from femsub.checks import Interruptible

    done = []
    with Interruptible() as work:
        for number in range(3):
            done.append(number)
            if number == 1:
                raise KeyboardInterrupt
    assert done == [0, 1] and not work.complete
    with Interruptible() as work:
        pass
    assert work.complete
    with pytest.raises(fs.NotConvergedError), Interruptible():
        raise fs.NotConvergedError("planted")


def test_outcomes_are_not_caught_as_wrong_arguments_and_ctrl_c_in_one_place() -> None:
    """What a computation finds is told by an error of its own, so that a wrong argument is never taken for it."""
    wide = {"Exception", "BaseException", "KeyboardInterrupt", "InputError", "InputTypeError"}
    package = Path(fs.__file__).parent
    for path in (path for room in ("model", "components", "motion", "app") for path in (package / room).rglob("*.py")):
        caught = {name.id for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.ExceptHandler)
                  and not isinstance(node.body[0], ast.Raise)  # one that says where it was found stays what it is
                  for name in ast.walk(node.type or ast.Name("BaseException")) if isinstance(name, ast.Name)}
        assert not caught & wide or path.name == "cli.py", f"{path} catches {caught & wide}"


def test_where_every_output_fails_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from femsub.app.asks import compare, complex_modes, critical

    def fails(*_: object) -> None:
        raise fs.NotConvergedError("planted")

    for kind in (critical.CriticalAsk, complex_modes.ComplexModesAsk, compare.CompareAsk):
        monkeypatch.setattr(kind, "run", fails)
    (tmp_path / "scene.toml").write_text(PLANTED, encoding="utf-8")
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out")]) == 1
    assert not (tmp_path / "out").exists()


def _femsub(words: str, *, out: str | None = None) -> subprocess.CompletedProcess[str]:
    command = f"{sys.executable} -m femsub {words}" + (f" > {out}" if out else "")
    return subprocess.run(["bash", "-c", f"set -o pipefail; {command}"], capture_output=True, text=True, check=False)


def test_a_reader_that_has_seen_enough_is_no_error() -> None:
    # `true` reads nothing at all: the pipe is broken before, or while, the first line is written
    done = _femsub("scenes | true")
    assert done.returncode in (READER_GONE, 0) and not done.stderr


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs Linux' /dev/full")
@pytest.mark.parametrize("words", ["scenes", "run two-mode --no-figures"])
def test_a_full_disk_is_told(words: str) -> None:
    done = _femsub(words, out="/dev/full")
    assert done.returncode == 1 and done.stderr.startswith("femsub: the results could not be printed") and \
        done.stderr.count("\n") == 1


def test_shooting_ends_where_it_would_never_have_come_back() -> None:
    rom = fs.reduce(fs.chain(6, belt=2), fs.CraigChang(modes=3), ports=True)
    belt = fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=1e-2))
    start = fs.State(np.zeros(rom.size), np.zeros(rom.size))
    for keys, said in (({"tol": 0.0}, "tol"), ({"period": 1e308}, "period"), ({"rounds": -1}, "rounds")):
        with pytest.raises(fs.InputError, match=said):
            fs.shoot(rom, belt, start, **{"period": 8.0, **keys})
