"""The command line: what is asked is done, nothing else is imported or written, and bad input ends in one line."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

import femsub as fs
from femsub.app.cli import main
from femsub.app.report import to_json
from femsub.app.scene import load

QUICK = 'n = 10\nbelts = [1, 2]\nsizes = [3, 5]\nrepeats = 1\n'
TABLES = {"critical-slope", "size-sweep", "eigenvalues", "error-time"}


def scene_file(folder: Path, text: str) -> str:
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def run(*arguments: str, code: str = "") -> subprocess.CompletedProcess[str]:
    program = f"import sys; from femsub.app.cli import main; status = main(sys.argv[1:]); {code or 'pass'}; sys.exit(status)"
    return subprocess.run([sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=False)


def chain(folder: Path, text: str) -> tuple[Path, str]:
    """The output of the paper's chain, but for these keys, and what was printed."""
    scene = scene_file(folder, text)
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        assert main(["run", scene, "--out", str(folder / "out")]) == 0, err.getvalue()
    assert err.getvalue() == ""  # no progress where stderr is not a terminal
    return folder / "out", out.getvalue()


@pytest.fixture(scope="module")
def chain_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    return chain(tmp_path_factory.mktemp("chain"), "belts = [1, 2]\nsizes = [2, 4, 5, 6, 10]\nrepeats = 2\n")


def test_chain_writes_tables_and_figures(chain_run: tuple[Path, str]) -> None:
    folder, _ = chain_run
    pictures = {"friction", "belt-sweep", "size-sweep", "eigenvalues", "error-time"}
    assert {path.name for path in folder.iterdir()} == {"results.json", *(f"{name}.csv" for name in TABLES),
                                                      *(f"{name}.png" for name in pictures)}
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in folder.glob("*.png"))


def test_the_verdict_with_its_condition_and_figure_stands_in_the_first_lines(chain_run: tuple[Path, str]) -> None:
    folder, text = chain_run
    best = json.loads((folder / "results.json").read_text())["error-time"]["recommended"][1]["model"]
    first = " ".join(" ".join(text.splitlines()[:10]).split())
    assert first.startswith("May a small model replace the full one? Yes. Craig-Chang with 3 modes (5 DOF) may replace the full")
    assert "Condition: the interface is free" in first and f"{best['error_held']:.1e}" in first
    assert max(map(len, text.splitlines())) <= 80 and len(text.splitlines()) < 40
    assert "Critical slopes" not in text and "-v prints them" in text


def test_where_no_model_will_do_the_first_lines_tell_what_to_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = 'methods = ["craig-bampton"]\nsizes = [3]\nbelt = 1\nrepeats = 1\noutputs = ["error-time"]\n'
    assert main(["run", scene_file(tmp_path, text)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert said.startswith("May a small model replace the full one? No. No small model of this run")
    assert "no smaller model is accurate enough" in said and "Keep more modes, or lower the band." in said


def test_chain_results_hold_the_paper_s_figures(chain_run: tuple[Path, str]) -> None:
    folder, _ = chain_run
    data = json.loads((folder / "results.json").read_text())
    growth = {(m["model"], m["interface"]): m["growth"] for m in data["eigenvalues"]["models"]}
    for model, expected in (("full", 0.0212), ("craig-bampton", 0.0185), ("craig-chang", 0.0212)):
        assert round(growth[model, "{m1}"], 4) == expected
    rows = {(row["belt"], row["interface"], row["method"]): row for row in data["critical-slope"]["rows"]}
    assert round(rows[2, "{m1}", "craig-bampton"]["slope"], 6) == -0.025634
    assert rows[2, "{m1, m2}", "craig-bampton"]["error"] == pytest.approx(9e-7, abs=1e-7)
    assert {panel["interface"] for panel in data["belt-sweep"]["panels"]} == {"{m1}", "{m1, belt}"}
    for row in data["error-time"]["rows"]:
        assert row["reduction_least_s"] <= row["reduction_median_s"] <= row["reduction_most_s"]
    assert data["slope"] == pytest.approx(-0.2677, abs=1e-5)


@pytest.mark.slow
def test_chain_results_hold_the_paper_s_order_of_methods_for_every_place_of_the_belt(tmp_path: Path) -> None:
    """HCB is worst with the belt under m2, and CC better than HCB for every place m2 to m10."""
    folder, _ = chain(tmp_path, 'outputs = ["critical-slope"]\nfigures = false\n')
    rows = json.loads((folder / "results.json").read_text())["critical-slope"]["rows"]
    errors = {(row["method"], row["belt"]): row["error"] for row in rows if row["interface"] == "{m1}"}
    hcb, cc = (np.array([errors[method, belt] for belt in range(2, 11)]) for method in ("craig-bampton", "craig-chang"))
    assert np.argmax(hcb) == 0 and (cc < hcb).all()


def test_each_table_is_a_csv_file_of_its_own(chain_run: tuple[Path, str]) -> None:
    data = json.loads((chain_run[0] / "results.json").read_text())
    for name in TABLES:
        with open(chain_run[0] / f"{name}.csv", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        expected = data[name]["rows"]
        assert len(rows) == len(expected) and [row["method"] for row in rows] == [row["method"] for row in expected]
        assert all("" not in row.values() or "reason" in row for row in rows)  # no column of another table


def test_only_what_is_named_is_computed_and_imported(tmp_path: Path) -> None:
    scene = scene_file(tmp_path, QUICK + 'outputs = ["critical-slope"]\nfigures = false')
    code = "print([name for name in ('skfem', 'meshio', 'matplotlib', 'petsc4py', 'scipy.optimize') if name in sys.modules])"
    done = run("run", scene, "--out", str(tmp_path / "out"), code=code)
    assert done.returncode == 0 and done.stdout.splitlines()[-1] == "[]"
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"results.json", "critical-slope.csv"}
    assert "eigenvalues" not in json.loads((tmp_path / "out" / "results.json").read_text())


@pytest.mark.parametrize("names", ['["HCB", "CC"]', '["CraigBampton", "CraigChang"]', '["craig-bampton", "craig-chang"]'])
def test_a_method_goes_by_each_of_its_names(tmp_path: Path, names: str) -> None:
    scene, _ = load(scene_file(tmp_path, f"methods = {names}"))
    assert scene.methods == ["craig-bampton", "craig-chang"]


def test_without_out_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                        capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    scene_file(tmp_path, QUICK + 'outputs = ["eigenvalues", "friction"]')
    assert main(["run", "scene.toml"]) == 0
    assert "largest Re λ is 0.021187" in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


def test_a_chain_without_petsc_s_sizes_never_loads_petsc(tmp_path: Path) -> None:
    scene = scene_file(tmp_path, QUICK + 'outputs = ["eigenvalues"]')
    done = run("run", scene, code="print('petsc4py' in sys.modules)")
    assert done.stdout.splitlines()[-1] == "False"


def test_scenes_lists_what_there_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenes"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["chain", "matrices", "beam", "plate", "solid", "frequency-response",
                                                   "chain-parts", "plate-parts", "solid-parts", "own-parts", "superelements",
                                                   "brake", "chain-transient", "solid-transient", "chain-limit-cycle",
                                                   "plate-limit-cycle", "two-mode", "affine", "ziegler", "audit"]


@pytest.mark.parametrize(("text", "words"), [
    ("dampin = 0.2", "unknown scene key 'dampin'; did you mean 'damping'"),
    ("elements = 3", "The file names no scene, so that it is read as one of 'chain'"),
    ("belt = 11", "belt (masses count from 1) must be at least 1 and at most 10, but is 11"),
    ("belts = [1, 12]", "at least 1 and at most 10, but is 12"),
    ("masses = 0.0", "masses must be positive, but is 0.0"),
    ("masses = [1.0, 1, 1, 1, -1, 1, 1, 1, 1, 1]", "masses must be positive, but is -1.0 in place 5"),
    ("springs = nan", "springs' must be a finite number"),
    ("interface = [1, 1]", "listed 2 times"),
    ("sizes = [12]", "more modes than there are; the chain has 10 masses"),
    ('methods = ["craig-bampten"]', "unknown method 'craig-bampten'; did you mean 'craig-bampton'"),
    ('outputs = ["eigenvalue"]', "unknown output 'eigenvalue'; did you mean 'eigenvalues'"),
    ('law = "stribeck"', "unknown law 'stribeck'"),
    ('n = "ten"', "scene key 'n' must be a whole number, not 'ten'"),
    ("n = 0", "n must be at least 1"),
    ("", "names no scene"), ("# a comment\n", "names no scene"),
    ("n = [", "is not a TOML file"), (f"n = {'1' * 5000}", "is not a TOML file"),
    ('scene = "chian"', "unknown scene 'chian'; did you mean 'chain'"),
    ("size = 1", "no room for the interface of 1"),
    ("repeats = 0", "repeats must be at least 1"),
    ("speed = nan", "speed' must be a finite number"),
    ("eps = 0.0", "eps must be positive"),
    ("force = -1.0", "force must"),
    ("band = [1.0, 0.5]", "0 <= lo < hi"),
    ("band = [1.0]", "band must be [lo, hi], not [1.0]"),
    ('scene = "matrices"\nK = "K.mtx"\nband = [0.0, 1.0]', "scene key 'M' is missing: the file of the mass matrix"),
    ('scene = "matrices"\nM = "M.mtx"\nK = "K.mtx"\nport = 0', "scene key 'band' is missing"),
    ('scene = "matrices"\nM = "M.mtx"\nK = "K.mtx"\nport = 0\nband = [0.0, 1.0]', "there is no file"),
])
def test_bad_scene_ends_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, words: str) -> None:
    scene = scene_file(tmp_path, text)
    assert main(["run", scene, "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert words in printed.err and printed.err.startswith("femsub: ") and printed.err.count("\n") == 1
    assert printed.out == "" and not (tmp_path / "out").exists()


@pytest.mark.parametrize(("change", "words"), [
    ({"K": (2, 2, np.nan)}, "K holds a NaN or Inf, first at row 2, column 2"),
    ({"M": (0, 1, 0.5)}, "M is not symmetric: M[0, 1] = 0.5"),
    ({"M": (3, 3, -1.0)}, "M has a negative mass: M[3, 3] = -1"),
    ({}, ""),
])
def test_matrices_from_files(tmp_path: Path, capsys: pytest.CaptureFixture[str], change: dict, words: str) -> None:
    sub = fs.chain(20, belt=2)
    for name, matrix in (("M", sub.M), ("K", sub.K), ("D", sub.D)):
        changed = sp.lil_array(matrix)
        if name in change:
            row, column, value = change[name]
            changed[row, column] = value
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", sp.coo_matrix(changed), symmetry="general")
    scene = scene_file(tmp_path, 'scene = "matrices"\nM = "M.mtx"\nK = "K.mtx"\nD = "D.mtx"\ninterface = [0]\nport = 1\n'
                                 "modes = [6]\nband = [0.0, 0.4]\nslope = -0.1\nrepeats = 1\n")
    status = main(["run", scene, "--out", str(tmp_path / "out")])
    printed = capsys.readouterr()
    if words:
        assert status == 2 and words in printed.err and printed.err.count("\n") == 1 and not (tmp_path / "out").exists()
        return
    assert status == 0, printed.err
    data = json.loads((tmp_path / "out" / "results.json").read_text())
    assert data["critical-slope"][0]["slope"] == pytest.approx(float(fs.critical_slope(sub)), rel=1e-10)


@pytest.mark.parametrize("place", ["file", "file/below", "/proc/out", ""])
def test_an_output_folder_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str], place: str) -> None:
    (tmp_path / "file").write_text("mine")
    assert main(["run", "chain", "--out", str(tmp_path / place) if place else ""]) == 2
    printed = capsys.readouterr()
    assert ("cannot be written" in printed.err or not place) and printed.err.count("\n") == 1
    assert (tmp_path / "file").read_text() == "mine"


def test_results_are_renamed_into_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                        capsys: pytest.CaptureFixture[str]) -> None:
    scene = scene_file(tmp_path, QUICK + 'outputs = ["eigenvalues"]\nfigures = false')
    assert main(["run", scene, "--out", str(tmp_path / "out")]) == 0
    before = (tmp_path / "out" / "results.json").read_bytes()

    def full_disk(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full_disk)
    assert main(["run", scene, "--out", str(tmp_path / "out")]) == 2
    assert "No space left" in capsys.readouterr().err
    assert (tmp_path / "out" / "results.json").read_bytes() == before
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"results.json", "eigenvalues.csv"}


def test_json_keeps_every_digit_and_is_strict() -> None:
    data = {"a": np.pi, "b": np.array([1 + 2j]), "c": np.nan, "d": -np.inf, "e": np.bool_(True), "f": np.int64(3)}
    assert json.loads(to_json(data)) == {"a": np.pi, "b": [[1.0, 2.0]], "c": None, "d": "-inf", "e": True, "f": 3}
