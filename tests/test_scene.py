"""The command line: what is asked is done, nothing else is imported or written, and bad input ends in one line."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
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
from femsub.app.grammar import Scene, text_of
from femsub.output import to_json

CHAIN = 'scene = "chain"\n'
QUICK = CHAIN + "[reduce]\nsizes = [3, 5]\nrepeats = 1\n"
TABLES = {"critical-slope", "size-sweep", "eigenvalues", "eigenvalues-unstable", "error-time"}


def asked(*asks: str) -> str:
    """Tables [[ask]] of these lines."""
    return "".join(f"[[ask]]\n{one}\n" for one in asks)


def paper(*names: str, belts: str = "[1, 2]", sizes: str = "[[2, 4, 5, 6, 10]]") -> str:
    """The file of the paper's chain with other places of the belt and sizes, and those of its asks alone that are named."""
    text = text_of("chain").replace("[1, 2, 3, 4, 5, 6, 7, 8, 9, 10]", belts).replace("[[2, 3, 4, 5, 6, 7, 8, 9, 10]]", sizes)
    text = text.replace("ports = false", "ports = false\nrepeats = 2")
    first, *asks = text.split("[[ask]]\n")
    kept = [one for one in asks if not names or any(f'name = "{name}"' in one for name in names)]
    return first + "".join(f"[[ask]]\n{one}" for one in kept)


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
    """Without figures, which `test_chain_writes_tables_and_figures` draws."""
    return chain(tmp_path_factory.mktemp("chain"), "figures = false\n" + paper())


@pytest.mark.slow
def test_chain_writes_tables_and_figures(tmp_path: Path) -> None:
    folder, _ = chain(tmp_path, paper())
    shape = "eigenvalues-shape"
    pictures = {"friction-law", "critical-slope", "growth", "size-sweep", "eigenvalues", "error-time", shape,
                "eigenvalues-unstable"}
    assert {path.name for path in folder.iterdir()} == {
        "results.json", *(f"{name}.csv" for name in TABLES), *(f"{name}.png" for name in pictures), shape, f"{shape}.vtu",
        f"{shape}.pvd", "eigenvalues-unstable.vtu"}
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in folder.glob("*.png"))


def test_the_verdict_with_its_condition_and_figure_stands_in_the_first_lines(chain_run: tuple[Path, str]) -> None:
    folder, text = chain_run
    best = json.loads((folder / "results.json").read_text())["error-time"]["recommended"][1]["model"]
    first = " ".join(" ".join(text.splitlines()[:10]).split())
    assert first.startswith("May a small model replace the full one? Yes. Craig-Chang with 3 modes (5 DOF) may replace the full")
    assert "Condition: the interface is free" in first and f"{best['error_held']:.1e}" in first
    assert max(map(len, text.splitlines())) <= 80 and len(text.splitlines()) < 42
    assert "Critical slopes" not in text and "-v prints them" in text


def test_where_no_model_will_do_the_first_lines_tell_what_to_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = CHAIN + '[part.chain]\nbelt = 1\n[reduce]\nmethods = ["craig-bampton"]\nsizes = [3]\nrepeats = 1\n' + asked(
        'compare = ["growth", "critical", "held"]')
    assert main(["run", scene_file(tmp_path, text)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert said.startswith("May a small model replace the full one? No. No small model of this run")
    assert "no smaller model is accurate enough" in said and "Keep more modes, or lower the band." in said


def test_chain_results_hold_the_paper_s_figures(chain_run: tuple[Path, str]) -> None:
    folder, _ = chain_run
    data = json.loads((folder / "results.json").read_text())
    growth = {(m["model"], m["interface"]): m["growth"] for m in data["eigenvalues"]["models"]}
    for model, expected in (("full", 0.0212), ("craig-bampton", 0.0185), ("craig-chang", 0.0212)):
        assert round(growth[model, "{1}"], 4) == expected
    rows = {(row["belt"], row["interface"], row["model"]): row for row in data["critical-slope"]}
    assert round(rows[2, "{1}", "craig-bampton"]["value"], 6) == -0.025634
    assert rows[2, "{1, belt}", "craig-bampton"]["error"] == pytest.approx(9e-7, abs=1e-7)
    assert {panel["rest"] for panel in data["growth"]["panels"]} == {"{1}", "{1, belt}"}
    for row in data["error-time"]["rows"]:
        assert row["reduction_least_s"] <= row["reduction_median_s"] <= row["reduction_most_s"]
    assert "-0.267699" in data["contacts"][0]


@pytest.mark.slow
def test_chain_results_hold_the_paper_s_order_of_methods_for_every_place_of_the_belt(tmp_path: Path) -> None:
    """HCB is worst with the belt under m2, and CC better than HCB for every place m2 to m10."""
    folder, _ = chain(tmp_path, "figures = false\n" + paper("critical-slope", belts="[1, 2, 3, 4, 5, 6, 7, 8, 9, 10]"))
    rows = json.loads((folder / "results.json").read_text())["critical-slope"]
    errors = {(row["model"], row["belt"]): row["error"] for row in rows if row["interface"] == "{1}"}
    hcb, cc = (np.array([errors[method, belt] for belt in range(2, 11)]) for method in ("craig-bampton", "craig-chang"))
    assert np.argmax(hcb) == 0 and (cc < hcb).all()


@pytest.mark.slow
def test_growth_of_models_of_several_sizes_stands_apart(tmp_path: Path) -> None:
    text = QUICK + asked('growth = "slope"\npoints = 4\nvary = {"part.chain.belt" = [1, 2, 3]}')
    folder, _ = chain(tmp_path, text)
    panels = json.loads((folder / "results.json").read_text())["growth"]["panels"]
    assert sorted((one["model"], one["rest"]) for one in panels) == [
        ("craig-bampton", "3 DOF"), ("craig-bampton", "5 DOF"), ("craig-chang", "3 DOF"),
        ("craig-chang", "5 DOF"), ("full", "")]
    assert all(np.shape(one["growth"]) == (3, 4) and len(one["critical_slope"]) == 3 for one in panels)


def test_each_table_is_a_csv_file_of_its_own(chain_run: tuple[Path, str]) -> None:
    data = json.loads((chain_run[0] / "results.json").read_text())
    listed = {"eigenvalues": data["eigenvalues"]["models"], "eigenvalues-unstable": data["eigenvalues"]["unstable"],
              "error-time": data["error-time"]["rows"]}
    for name in TABLES:
        with open(chain_run[0] / f"{name}.csv", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        expected = listed.get(name) or data[name]
        head = "method" if name == "error-time" else "model" if name != "eigenvalues-unstable" else "interface"
        assert len(rows) == len(expected) > 0 and [row[head] for row in rows] == [str(row[head]) for row in expected]
        assert {key for key in rows[0] if all(row[key] == "" for row in rows)} <= {"reason"}  # no column of another table


def test_only_what_is_named_is_computed_and_imported(tmp_path: Path) -> None:
    scene = scene_file(tmp_path, "figures = false\n" + QUICK + asked('critical = "slope"'))
    code = "print([name for name in ('skfem', 'meshio', 'matplotlib', 'petsc4py', 'scipy.optimize') if name in sys.modules])"
    done = run("run", scene, "--out", str(tmp_path / "out"), code=code)
    assert done.returncode == 0 and done.stdout.splitlines()[-1] == "[]"
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"results.json", "critical.csv"}
    assert "complex-modes" not in json.loads((tmp_path / "out" / "results.json").read_text())


@pytest.mark.parametrize("names", ['["HCB", "CC"]', '["CraigBampton", "CraigChang"]', '["craig-bampton", "craig-chang"]'])
def test_a_method_goes_by_each_of_its_names(tmp_path: Path, names: str) -> None:
    scene = Scene.from_file(scene_file(tmp_path, f"{CHAIN}[reduce]\nmethods = {names}"))
    assert scene.reduce.methods == ["craig-bampton", "craig-chang"]


def test_without_out_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                        capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    scene_file(tmp_path, QUICK + asked('complex-modes = "all"', "friction-law = [0.1]"))
    assert main(["run", "scene.toml"]) == 0
    assert "largest Re λ is 0.021187" in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


@pytest.mark.slow
def test_a_chain_without_petsc_s_sizes_never_loads_petsc(tmp_path: Path) -> None:
    scene = scene_file(tmp_path, QUICK + asked('complex-modes = "all"'))
    done = run("run", scene, code="print('petsc4py' in sys.modules)")
    assert done.stdout.splitlines()[-1] == "False"


def test_scenes_lists_what_there_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenes"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["chain", "matrices", "beam", "plate", "solid", "frequency-response",
                                                   "chain-parts", "plate-parts", "solid-parts", "own-parts", "superelements",
                                                   "brake", "chain-transient", "solid-transient", "chain-limit-cycle",
                                                   "plate-limit-cycle", "two-mode", "affine", "ziegler", "audit"]


BAD = [
    (CHAIN + "[part.chain]\ndampin = 0.2", "line 3: part.chain.dampin: unknown key 'dampin'; did you mean 'damping'"),
    ("elements = 3", "line 1: elements: unknown key 'elements'"),
    (CHAIN + "[prat.chain]\nbelt = 3", "line 2: prat: unknown table 'prat'; did you mean 'part'"),
    (CHAIN + "[part.chain]\nbelt = 11", "belt (masses count from 1) must be at least 1 and at most 10, but is 11"),
    (CHAIN + asked('critical = "slope"\nvary = {"part.chain.belt" = [1, 12]}'), "at least 1 and at most 10, but is 12"),
    (CHAIN + asked('critical = "slope"\nvary = {"part.chain.bolt" = [1]}'), "line 4: ask 1.vary: part.chain.bolt: unknown key "
                                                                            "'bolt'"),
    (CHAIN + asked('critical = "slope"\nvary = {"part.chian.belt" = [1]}'), "line 4: ask 1.vary: unknown part 'chian'; did you "
                                                                            "mean"),
    (CHAIN + asked('critical = "slope"\nvary = {"part.chain.belt" = [1, "x"]}'), "must be a whole number, not 'x'"),
    (CHAIN + asked('critical = "slope"\nvary = {"part.chain.belt" = []}'), "'part.chain.belt' has no values"),
    (CHAIN + asked('growth = "slope"\nvary = {"part.chain.belt" = [1]}'), "growth needs vary with several values"),
    (CHAIN + asked('critical = "slope"\nvary = {"band.lo" = [1]}'), "'band.lo' is no key: band is no table"),
    (CHAIN + "[part.chain]\nmasses = 0.0", "line 3: part.chain.masses: it must be positive, but is 0.0"),
    (CHAIN + "[part.chain]\nmasses = [1.0, 1, 1, 1, -1, 1, 1, 1, 1, 1]", "must be positive, but is -1.0 in place 5"),
    (CHAIN + "[part.chain]\nsprings = nan", "part.chain.springs: it must be a finite number"),
    (CHAIN + "[part.chain]\ninterface = [1, 1]", "part.chain.interface: 1 is listed 2 times"),
    (CHAIN + "[reduce]\nsizes = [12]", "line 2: reduce: sizes: 12 are more than the 10 DOF of 'chain'"),
    (CHAIN + '[reduce]\nmethods = ["craig-bampten"]', "unknown method 'craig-bampten'; did you mean 'craig-bampton'"),
    (CHAIN + asked('complex-mode = "all"'), "line 2: ask 1: unknown kind of ask: none of its keys names one, as "
                                            "'complex-mode'; did you "
                                            "mean 'complex-modes'"),
    (CHAIN + asked('complex-modes = "all"\nmodes = 3'), "it is of the kinds complex-modes and modes"),
    (CHAIN + '[contact.belt]\nlaw = "stribeck"', "line 3: contact.belt.law: unknown law 'stribeck'"),
    (CHAIN + '[contact.belt]\nbelt = "chian.belt"', "contact.belt.belt: unknown part 'chian'; did you mean 'chain'"),
    (CHAIN + '[contact.belt]\nbelt = "chain.bolt"', "contact.belt.belt: unknown port of 'chain' 'bolt'; did you mean 'belt'"),
    (CHAIN + '[part.chain]\nchain = "ten"', "part.chain.chain: it must be a whole number, not 'ten'"),
    (CHAIN + "[part.chain]\nchain = 0", "part.chain.chain: it must be at least 1"),
    ("", "is empty, or has comments only"), ("# a comment\n", "is empty, or has comments only"),
    ("n = [", "is not a TOML file"), (f"n = {'1' * 5000}", "is not a TOML file"),
    ('scene = "chian"', "line 1: scene: unknown scene 'chian'; did you mean 'chain'"),
    (CHAIN + "[part.chain]\ninterface = [1, 3]\n[reduce]\nsizes = [1]", "no model of 1 DOF has room for the interface of 2"),
    (CHAIN + "[reduce]\nrepeats = 0", "reduce.repeats: it must be at least 1"),
    (CHAIN + "[contact.belt]\nspeed = nan", "contact.belt.speed: it must be a finite number"),
    (CHAIN + "[contact.belt]\neps = 0.0", "contact.belt.eps: it must be positive"),
    (CHAIN + "[contact.belt]\nforce = -1.0", "contact.belt.force: it must not be negative"),
    (CHAIN + "band = [1.0, 0.5]", "line 2: band: it must be (lo, hi) with lo < hi"),
    (CHAIN + "band = [1.0]", "line 2: band: it must be [lo, hi], not [1.0]"),
    ('scene = "matrices"\n[part.part]\nmatrices = {K = "K.mtx"}', "part.part.matrices: the key 'M' is missing: the file of the "
                                                                  "mass matrix"),
    ('scene = "matrices"\n[contact.belt]\nbelt = ""', "contact.belt: the key 'belt' is missing"),
    ('scene = "matrices"\n[part.part]\nmatrices = {M = "M.mtx", K = "K.mtx"}', "there is no file"),
    ("ask = 3\n" + CHAIN, "line 1: ask: it must be tables, [ask.NAME]"),
    ("ask = []\n" + CHAIN, "nothing is asked: give a table [[ask]]"),
    ('[[ask]]\nmodes = 3\n', "there is no part: give a table such as [part.disc]"),
]


@pytest.mark.parametrize(("text", "words"), BAD)
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
    scene = scene_file(tmp_path, 'scene = "matrices"\nband = [0.0, 0.4]\n[part.part]\n'
                                 'matrices = {M = "M.mtx", K = "K.mtx", D = "D.mtx"}\n'
                                 "[contact.belt]\nslope = -0.1\n[reduce]\nmodes = [6]\nrepeats = 1\n")
    status = main(["run", scene, "--no-figures", "--out", str(tmp_path / "out")])
    printed = capsys.readouterr()
    if words:
        assert status == 2 and words in printed.err and printed.err.count("\n") == 1 and not (tmp_path / "out").exists()
        return
    assert status == 0, printed.err
    data = json.loads((tmp_path / "out" / "results.json").read_text())
    assert data["critical"][0]["value"] == pytest.approx(float(fs.critical_slope(sub)), rel=1e-10)


@pytest.mark.parametrize("place", ["file", "file/below", "/proc/out", ""])
def test_an_output_folder_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str], place: str) -> None:
    (tmp_path / "file").write_text("mine")
    assert main(["run", "chain", "--out", str(tmp_path / place) if place else ""]) == 2
    printed = capsys.readouterr()
    assert ("cannot be written" in printed.err or not place) and printed.err.count("\n") == 1
    assert (tmp_path / "file").read_text() == "mine"


def test_results_are_renamed_into_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                        capsys: pytest.CaptureFixture[str]) -> None:
    scene = scene_file(tmp_path, "figures = false\n" + QUICK + asked('critical = "slope"'))
    assert main(["run", scene, "--out", str(tmp_path / "out")]) == 0
    before = (tmp_path / "out" / "results.json").read_bytes()

    def full_disk(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full_disk)
    assert main(["run", scene, "--out", str(tmp_path / "out")]) == 2
    assert "No space left" in capsys.readouterr().err
    assert (tmp_path / "out" / "results.json").read_bytes() == before
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"results.json", "critical.csv"}


def test_json_keeps_every_digit_and_is_strict() -> None:
    data = {"a": np.pi, "b": np.array([1 + 2j]), "c": np.nan, "d": -np.inf, "e": np.bool_(True), "f": np.int64(3)}
    assert json.loads(to_json(data)) == {"a": np.pi, "b": [[1.0, 2.0]], "c": None, "d": "-inf", "e": True, "f": 3}


def test_all_faults_of_a_file_are_told_at_once_with_their_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = CHAIN + "[part.chain]\nbelt = 0\n\n[reduce]\nrepeats = 0\n" + asked('complex-modes = "all"\nbad = 1\nband = [3, 1]')
    assert main(["run", scene_file(tmp_path, text), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err.splitlines()
    assert said[0].endswith("scene.toml, 4 faults:") and not (tmp_path / "out").exists()
    assert [line.split(":")[0] for line in said[1:]] == ["  line 3", "  line 6", "  line 9", "  line 10"]
    assert [line.split(": ")[1] for line in said[1:]] == ["part.chain.belt", "reduce.repeats", "ask 1.bad", "ask 1.band"]


def test_keys_of_a_table_replace_single_ones_and_lists_as_a_whole(tmp_path: Path) -> None:
    below = Scene.from_file("chain")
    scene = Scene.from_file(scene_file(tmp_path, CHAIN + "[part.chain]\nbelt = 5\n" + asked('complex-modes = "full"')))
    assert scene.parts["chain"] == dataclasses.replace(below.parts["chain"], belt=5)
    assert [ask.KIND for ask in scene.asks] == ["complex-modes"] and len(below.asks) == 6
    assert scene.reduce == below.reduce and scene.contacts == below.contacts and scene.settings.band == below.settings.band
    kind = Scene.from_file(scene_file(tmp_path, CHAIN + '[contact.belt]\nlinear = ["chain.belt"]\nstiffness = [[1.0]]\n' + asked(
        "modes = 3")))
    assert [type(one).KIND for one in kind.contacts.values()] == ["linear"]  # a table of another kind has none of the old keys
