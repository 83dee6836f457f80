"""Scenes in time: what they compute, write and draw, and what Ctrl-C leaves of them."""

from __future__ import annotations

import itertools
import json
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

import femsub as fs
from femsub.app.cli import main
from femsub.app.grammar import Scene
from femsub.checks import InputError

CHAIN = """
scene = "chain-transient"
[[ask]]
motion = [0, 1500]
window = [1000, 1500]
step = 0.2
length = 30.0
tol = 1e-9
show = ["growth", "quality", "signals", "spectrum", "spectrogram"]
"""
BRIEF = CHAIN.replace("1500", "300").replace("1000", "100")
COARSE = """
scene = "solid-transient"
[part.disc]
solid = {radii = [0.05, 0.15], thickness = 0.012, elements = [2, 12, 1]}
[reduce]
methods = ["CC"]
modes = [8, 20]
"""
LONG = COARSE + """
[[ask]]
motion = [0, 150]
in_periods = true
impulse = 0.1
models = "best"
show = ["growth", "spectrum"]
"""
BESIDE = """
[[ask]]
compare-motion = 4
long = 150
impulse = 0.1
full_tol = 1e-4
"""


def shows(text: str, *outputs: str) -> str:
    """The same with other outputs."""
    return re.sub(r"show = .*", f"show = {json.dumps(outputs)}", text)


def scene_file(folder: Path, text: str) -> str:
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


@pytest.mark.slow
def test_the_chain_in_time_writes_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert main(["run", scene_file(tmp_path, CHAIN), "--out", str(out)]) == 0
    data = json.loads((out / "results.json").read_text())
    models = data["motion"]["models"]
    assert "complete" not in data and [row["model"] for row in models] == ["full", "craig-bampton", "craig-chang"]
    assert models[1]["peaks"][0] == pytest.approx(0.7245, rel=5e-3)
    assert models[2]["peaks"][0] == pytest.approx(0.7227, rel=5e-3)
    assert all(row["energy_residual"] < 1e-6 for row in models)
    assert all(row["error"] < 0.01 for row in data["motion-growth"]) and len(data["motion-growth"]) == 3
    quality = data["motion-quality"]
    assert [(row["model"], row["size"], row["missing"]) for row in quality] == [("craig-bampton", 5, 4), ("craig-chang", 5, 4)]
    rms, peak = ([row[key] for row in models] for key in ("rms", "peaks"))
    for at, row in enumerate(quality, start=1):
        assert row["error_amplitude"] == pytest.approx(abs(rms[at] / rms[0] - 1))
        assert row["error_frequency"] == pytest.approx(abs(peak[at][0] / peak[0][0] - 1))
    assert {path.name for path in out.iterdir()} == {"results.json", "motion.csv", *(
        f"motion-{name}.csv" for name in ("growth", "quality", "spectrum", "spectrogram")), *(
        f"motion-{name}.png" for name in ("signals", "spectrum", "spectrogram"))}
    assert "highest" not in capsys.readouterr().err


@pytest.mark.slow
def test_only_what_is_named_is_computed(tmp_path: Path) -> None:
    out = tmp_path / "out"
    text = shows(BRIEF, "spectrum") + '[reduce]\nmethods = ["CC"]\n'
    code = ("import sys; from femsub.app.cli import main; main(sys.argv[1:]); "
            "print([name for name in ('skfem', 'matplotlib', 'petsc4py') if name in sys.modules])")
    done = subprocess.run([sys.executable, "-c", code, "run", scene_file(tmp_path, text), "--out", str(out), "--no-figures"],
                          capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    data = json.loads((out / "results.json").read_text())
    assert not {"motion-growth", "motion-quality", "motion-spectrogram"} & set(data) and len(data["motion"]["models"]) == 2


@pytest.mark.slow
def test_a_disc_in_time_compares_full_and_reduced_from_one_state(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["run", scene_file(tmp_path, COARSE + BESIDE), "--out", str(out)]) == 0
    rows = json.loads((out / "results.json").read_text())["compare-motion"]["rows"]
    assert [row["model"] for row in rows] == ["full", "craig-chang", "craig-chang"]
    assert rows[0]["method"] == "alpha" and rows[2]["method"] == "lsoda"
    assert rows[2]["amplitude_error"] < 0.02 and rows[2]["speedup"] > 5
    assert (out / "compare-motion.png").stat().st_size > 10_000


@pytest.mark.parametrize(("text", "words"), [
    (CHAIN + "[contact.belt]\nslope = -0.2", "contact belt: the nonlinear model needs a friction law"),
    (CHAIN.replace("[0, 1500]", "[5, 1]"), "ask 1.motion: it must be"),
    (CHAIN.replace("[0, 1500]", "[0, 1200]"), "reaches beyond"),
    (CHAIN.replace("step", "stepp"), "unknown key 'stepp'; did you mean 'step'"),
    (COARSE + BESIDE.replace("150", "2"), "long must be at least 4|it must be at least 4"),
])
def test_bad_scenes_are_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Scene.from_file(scene_file(tmp_path, text))


@pytest.mark.parametrize("asked", [LONG, COARSE + BESIDE])
def test_where_nothing_grows_the_scene_says_so(asked: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", scene_file(tmp_path, asked + "[contact.belt]\nforce = 1.0\n")]) == 2
    assert "nothing grows" in capsys.readouterr().err


TOLD = """import sys
from femsub.app import cli
from femsub.app import report
report.progress = lambda text: print(text, file=sys.stderr, flush=True)  # told to a terminal only, which not every machine has
sys.exit(cli.main(sys.argv[1:]))"""


@pytest.mark.slow
def test_ctrl_c_leaves_what_there_is_marked_as_incomplete(tmp_path: Path) -> None:
    out = tmp_path / "out"
    scene = scene_file(tmp_path, shows(CHAIN, "spectrum").replace("1500", "1e6").replace("1000", "5e5").replace("0.2", "1.0"))
    running = subprocess.Popen([sys.executable, "-c", TOLD, "run", scene, "--out", str(out), "--no-figures"],
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                               # a shell has its jobs in the background ignore it, and so would all that they start
                               preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    assert running.stderr is not None
    assert any(", t = " in line for line in running.stderr)  # waits until the motion is under way, however long it takes here
    running.send_signal(signal.SIGINT)
    said, errors = running.communicate(timeout=60)
    assert running.returncode == 130 and "marked as incomplete" in errors
    data = json.loads((out / "results.json").read_text())
    assert data["complete"] is False and data["motion"]["models"][0]["complete"] is False
    assert 0 < data["motion"]["models"][0]["end"] < 1e6 and data["motion"]["models"][0]["rms"] is None
    assert "incomplete" in said and np.isfinite(data["motion"]["models"][0]["energy_residual"])


class Interrupted:
    """`transient` as a scene calls it, with Ctrl-C while the nth run is under way."""

    def __init__(self, nth: int) -> None:
        self.nth, self.runs, self.run = nth, 0, fs.transient

    def __call__(self, *args: Any, **options: Any) -> fs.Transient:
        self.runs += 1
        if self.runs < self.nth:
            return self.run(*args, **options)

        def stop(text: str) -> None:
            raise KeyboardInterrupt

        return self.run(*args, **options | {"progress": stop})


def interrupted(monkeypatch: pytest.MonkeyPatch, nth: int) -> None:
    ticking = SimpleNamespace(perf_counter=itertools.count().__next__)  # a second at each look
    monkeypatch.setattr("femsub.motion.transient.clock", ticking)
    runs = Interrupted(nth)
    for place in ("femsub", "femsub.motion.compared"):
        monkeypatch.setattr(f"{place}.transient", runs)


@pytest.mark.parametrize("done", [0, 1])
def test_ctrl_c_during_the_growth_marks_the_results_as_incomplete(done: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                                  capsys: pytest.CaptureFixture[str]) -> None:
    interrupted(monkeypatch, 3 + done + 1)  # after the runs of the three models
    out = tmp_path / "out"
    text = "figures = false\n" + shows(BRIEF, "growth", "spectrum")
    assert main(["run", scene_file(tmp_path, text), "--out", str(out)]) == 130
    data = json.loads((out / "results.json").read_text())
    # the runs themselves are whole, and so is what is seen in them
    assert data["complete"] is False and [row["complete"] for row in data["motion"]["models"]] == [True] * 3
    assert [row["model"] for row in data["motion-growth"]] == ["full"][:done] and data["motion-spectrum"]
    printed = capsys.readouterr()
    assert "these results are incomplete" in printed.out and "marked as incomplete" in printed.err


def test_ctrl_c_between_two_runs_of_the_growth_is_told_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("femsub.motion.compared.growth_rate", stop)
    out = tmp_path / "out"
    text = "figures = false\n" + shows(BRIEF, "growth")
    assert main(["run", scene_file(tmp_path, text), "--out", str(out)]) == 130
    data = json.loads((out / "results.json").read_text())
    assert data["complete"] is False and data["motion-growth"] == [] and len(data["motion"]["models"]) == 3


def test_after_ctrl_c_in_the_growth_of_a_disc_no_other_run_begins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: Any) -> None:
        raise AssertionError("a run began")

    interrupted(monkeypatch, 2)  # after the long run; of CC with 18 DOF nothing grows below the cut-off: the next is of 30 DOF
    monkeypatch.setattr("femsub.app.asks.compare_motion.CompareMotionAsk.run", never)
    out = tmp_path / "out"
    text = "figures = false\n" + LONG.replace("150", "40") + BESIDE.replace("150", "40")
    assert main(["run", scene_file(tmp_path, text), "--out", str(out)]) == 130
    data = json.loads((out / "results.json").read_text())
    assert data["complete"] is False and [row["size"] for row in data["motion-growth"]] == [18]
    assert "compare-motion" not in data and "motion-spectrum" in data


@pytest.mark.slow
def test_a_reduced_solid_runs_as_often_as_repeats_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[int] = []
    plain = fs.transient
    monkeypatch.setattr(fs, "transient", lambda model, *args, **options: runs.append(model.size) or
                        plain(model, *args, **options))
    text = COARSE.replace("[8, 20]", "[20]\nrepeats = 2") + BESIDE.replace("150", "4")
    rows = Scene.from_file(scene_file(tmp_path, text)).run(lambda _: None).data["compare-motion"]["rows"]
    small = rows[1]["size"]
    assert runs == [small, rows[0]["size"], small, small]


@pytest.mark.slow
def test_a_motion_that_the_reduction_makes_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its strongest line lies above the cut-off: there `critical` refuses, and a trajectory must not pass for an answer."""
    K = sp.diags([2.0, -1.0, -1.0], [0, 1, -1], shape=(6, 6))
    scipy.io.mmwrite(tmp_path / "M.mtx", sp.eye(6).tocoo())
    scipy.io.mmwrite(tmp_path / "K.mtx", K.tocoo())
    (tmp_path / "my.toml").write_text(
        '[part.mine]\nmatrices = {M = "M.mtx", K = "K.mtx"}\nrayleigh = [0.01, 0.001]\nports = {rub = [3]}\n[contact.belt]\n'
        'belt = "mine.rub"\nforce = 1\nspeed = 0.2\n[reduce]\nmethods = ["HCB"]\nmodes = [3]\n[[ask]]\nmotion = [0, 100]\n',
        encoding="utf-8")
    assert main(["run", str(tmp_path / "my.toml"), "--no-figures", "--out", str(tmp_path / "out")]) == 0
    found = json.loads((tmp_path / "out" / "results.json").read_text())
    full, reduced = found["motion"]["models"]
    assert reduced["peaks"][0] > reduced["cutoff"] and reduced["rms"] > 5 * full["rms"]
    assert "Craig-Bampton (4 DOF) moves most above its cut-off" in " ".join(capsys.readouterr().out.split())
    # the spectrogram's windows are long enough to see the lowest of the strongest frequencies, or a quarter of the time
    assert found["motion-spectrogram"]["length"] == pytest.approx(25.0)
