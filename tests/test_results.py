"""Results that stand alone: a run is repeated from them, changed files are told, units are those named, nothing is mixed."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from copy import deepcopy
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from sandbox import HOOK

import femsub as fs
from femsub.algebra import commit
from femsub.app.cli import main
from femsub.app.grammar import Scene, built_in, text_of
from femsub.output import SYSTEMS, UNKNOWN, WIDTH, table_csv

#: beside a model
VARIED = 'vary = {"part.chain.belt" = [1, 2], "part.chain.interface" = [[1], [1, "belt"]]}\n'
QUICKLY = "[reduce]\nmodes = [8]\nrepeats = 1\n"
#: a small model of each scene
SMALL = {
    "chain": f'units = "SI"\n[reduce]\nsizes = [3, 5]\nrepeats = 1\n[[ask]]\nfriction-law = [0.1, 0.01]\n[[ask]]\n'
             f'critical = "slope"\n'
             f'{VARIED}[[ask]]\ngrowth = "slope"\npoints = 5\n{VARIED}[[ask]]\ncomplex-modes = "all"\nevery = true\n[[ask]]\n'
             'compare = ["growth", "critical", "held"]\nname = "error-time"\n',
    "matrices": 'band = [0.0, 0.4]\n[part.part]\nmatrices = {M = "M.npz", K = "model.mat:K"}\n[contact.belt]\nslope = -0.1\n'
                '[reduce]\n'
                "modes = [6]\nrepeats = 1\n",
    "beam": f'units = "SI"\n[part.beam]\nelements = 40\n{QUICKLY}',
    "plate": f"[part.plate]\nplate = {{lengths = [0.4, 0.3], elements = [8, 6]}}\n{QUICKLY}",
    "solid": '[part.disc]\nsolid = "part.inp"\nsupports = ["left"]\ninterface = ["right:y"]\nports = {belt = "top"}\n' + QUICKLY,
    "frequency-response": f'[part.beam]\nelements = 20\n{QUICKLY}[[ask]]\nresponse = ["beam.belt"]\nloss = 0.01\n'
                          f'frequencies = 60\n',
    "chain-parts": '[part.chain]\nchain = 12\n[reduce]\nmodes = [2]\nmethods = ["HCB", "rubin"]\nrepeats = 1\n[[ask]]\n'
                   'compare = ["growth", "critical", "held"]\nlisted = 20\n',
    "plate-parts": "band = [0.0, 1000.0]\n[part.plate]\nplate = {lengths = [0.4, 0.3], elements = [8, 6]}\ncut = 2\n"
                   '[reduce]\nmodes = [2]\nmethods = ["HCB"]\nrepeats = 1\n',
    "solid-parts": text_of("solid-parts").partition("[reduce]")[0].replace("elements =", 'cells = "hexahedron", elements =')
                   + '[reduce]\nmodes = [3]\nmethods = ["HCB"]\nrepeats = 1\n',
    "own-parts": 'band = [0.0, 0.4]\n[part.disc]\nmatrices = {M = "M.npz", K = "model.mat:K"}\ninterface = [19]\n'
                 'ports = {belt = [1]}\n'
                 '[part.pad]\nmatrices = {M = "M.npz", K = "model.mat:K"}\ninterface = [19]\n[[joint]]\nrigid = ["disc", "pad"]\n'
                 '[contact.belt]\nslope = -0.1\n[reduce]\nmethods = ["CC"]\nmodes = [3]\nrepeats = 1\n',
    "superelements": 'band = [0.0, 1e4]\n[part.in]\nsuperelement = "arm.pch"\ncutoff = 2e4\n[part.out]\n'
                     'superelement = "arm.pch"\n'
                     'cutoff = 2e4\n[[joint]]\nrigid = ["in", "out"]\n[[joint]]\nspring = ["in", "ground"]\nstiffness = 1e7\n'
                     '[reduce]\n'
                     'methods = ["CC"]\nmodes = [3]\nrepeats = 1\n[[ask]]\naudit = "parts"\n[[ask]]\nmodes = "band"\n'
                     'reference = [3000.0]\n[[ask]]\ncompare = ["growth", "held"]\n',
    "brake": "band = [1e4, 1.2e4]\n" + "".join(f'[part.{name}]\nsolid = {{brake = "{name}", size = 0.08}}\n'
                                               for name in ("disc", "inboard", "outboard"))
             + '[reduce]\nmodes = [8]\n[[ask]]\ncomplex-modes = "full"\nat = {mu = 0.5}\nname = "unstable"\n',
    "chain-transient": "[[ask]]\nmotion = [0.0, 300.0]\nwindow = [100.0, 300.0]\nlength = 100.0\n"
                       'show = ["growth", "quality", "signals", "spectrum", "spectrogram"]\n',
    "solid-transient": "[part.disc]\nsolid = {radii = [0.05, 0.15], thickness = 0.012, elements = [2, 12, 1]}\n[reduce]\n"
                       "modes = [20]\n"
                       'methods = ["CC"]\n[[ask]]\nmotion = [0.0, 20.0]\nin_periods = true\nimpulse = 0.1\nmodels = "best"\n'
                       'show = ["spectrum"]\n',
    "chain-limit-cycle": 'band = [0.6, 0.9]\n[reduce]\nmethods = ["CC"]\n[[ask]]\ncycles = 1\n[[ask]]\nbranch = "slope"\n'
                         'families = 1\n'
                         "dots = 1\nperiods = 20\nharmonics = 20\npoints = 6\n",
    "plate-limit-cycle": f"[part.plate]\nplate = {{lengths = [0.4, 0.3], elements = [4, 3]}}\n{QUICKLY}[[ask]]\ncycles = 1\n",
    "two-mode": '[[ask]]\ncritical = "mu"\nvary = {"parameter.d.value" = [0.0, 0.05]}\n[[ask]]\nflutter = "mu"\npoints = 11\n',
    "affine": '[part.disc]\naffine.M = {matrix = "M.npz"}\naffine.K = [{matrix = "model.mat:K", factor = "1 + p**2"}, '
              '{matrix = "M.npz", factor = "-p / q"}]\n[parameter.p]\nbetween = [0.0, 3.0]\n[parameter.q]\nvalue = 40.0\n'
              '[[ask]]\ncritical = "p"\n[[ask]]\nflutter = "p"\npoints = 11\n',
    "ziegler": '[[ask]]\ncritical = "P"\n[[ask]]\nflutter = "P"\npoints = 11\nvary = {"parameter.b.value" = [0.0, 0.1]}\n',
    "audit": '[[ask]]\naudit = {M = "M.npz", K = "model.mat:K", interface = [0]}\n'
             'full = {M = "M.npz", K = "model.mat:K", interface = [0]}\n',
}
#: scenes whose repetition takes long, and shows what that of another one does
LONG = ("affine", "beam", "chain-transient", "plate", "solid", "solid-parts")
EACH = [pytest.param(name, marks=() if name in ("superelements", "audit") else pytest.mark.rare if name in LONG else
                     pytest.mark.slow) for name in SMALL]
CHAIN = ('figures = false\n[reduce]\nsizes = [3, 5]\nrepeats = 1\n[[ask]]\ncritical = "slope"\n[[ask]]\ncritical = "slope"\n'
         'name = "size-sweep"\nvary = {"reduce.sizes" = [[3], [5]]}\n')
SHORT = {"solid": SMALL["solid"] + '[[ask]]\nmodes = 8\n', "matrices": SMALL["matrices"] + '[[ask]]\ncomplex-modes = "all"\n'}
CLOCK = {"date", "sha256", "sentence", "seconds", "seconds_per_period", "speedup", "recommended", "pareto",  # by the clock
         "verdict"}
#: what a run may start: it tells the commit and the machine
STARTED = tuple(f"started: ['{name}'" for name in ("git", "lscpu", "uname"))


def scene_file(folder: Path, name: str, text: str | None = None) -> str:
    """A scene file with the files it names."""
    folder.mkdir(exist_ok=True)
    if name in ("matrices", "own-parts", "affine", "audit"):
        chain = fs.chain(20, belt=2)
        scipy.sparse.save_npz(folder / "M.npz", scipy.sparse.csc_matrix(chain.M))
        scipy.io.savemat(folder / "model.mat", {"K": scipy.sparse.csc_matrix(chain.K), "other": np.eye(2)})
    if name == "solid":
        block = fs.block((0.1, 0.06, 0.01), (4, 3, 1), "hexahedron20")
        fs.write_mesh(folder / "nodes.inp", block)
        (folder / "part.inp").write_text("*INCLUDE, INPUT=nodes.inp\n")
    if name == "superelements":
        mesh, steel = fs.block((1.0, 0.1, 0.1), (4, 1, 1), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0)
        arm = fs.solid(mesh, steel, interface=["left"], name="arm")
        fs.write_superelement(folder, fs.reduce(arm, fs.CraigBampton(6)), "dmig")
    path = folder / "scene.toml"
    path.write_text(f'scene = "{name}"\n{SMALL[name] if text is None else text}', encoding="utf-8")
    return str(path)


def results(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "results.json").read_text(encoding="utf-8"))


def test_tables_have_every_digit_whatever_numpy_prints(tmp_path: Path) -> None:
    value = 0.1 + 0.2
    with np.printoptions(legacy="1.13"):  # pyyeti sets it
        table_csv([{"one": np.float64(value), "more": np.array([value, 1.0])}], file := io.BytesIO())
    assert file.getvalue().decode() == f"one,more\n{value!r},{value!r} 1.0\n"


def difference(one: Any, other: Any, where: str = "") -> list[str]:
    """Where two results differ by more than 1e-12, times and dates apart."""
    if isinstance(one, dict) and str(one.get("x")).startswith("run time"):
        return []  # a panel of errors over seconds
    if isinstance(one, dict) and isinstance(other, dict):
        keys = [key for key in one.keys() | other.keys() if key not in CLOCK and not key.endswith("_s")]
        return [line for key in keys for line in difference(one.get(key), other.get(key), f"{where}/{key}")]
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        return [line for at, pair in enumerate(zip(one, other, strict=True)) for line in difference(*pair, f"{where}[{at}]")]
    same = abs(one - other) <= 1e-12 * max(1.0, abs(one)) if isinstance(one, float) and isinstance(other, float) else one == other
    return [] if same else [f"{where}: {one} {other}"]


def without_folders(inputs: Any) -> Any:
    if isinstance(inputs, list):
        return [without_folders(one) for one in inputs]
    if not isinstance(inputs, dict):
        return inputs
    files = ("solid", "M", "K", "matrix", "superelement")
    return {key: Path(value).name if key in files and isinstance(value, str) else without_folders(value)
            for key, value in inputs.items()}


@contextmanager
def watched(folder: Path, temporary: Path) -> Iterator[list[str]]:
    """What a block changes outside of a folder or leaves in that for temporary files; the list is filled at the block's end."""
    findings: list[str] = []
    temporary.mkdir(exist_ok=True)
    with tempfile.TemporaryFile() as file, pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", str(temporary))
        patch.setattr(tempfile, "tempdir", str(temporary))
        patch.setattr(sys, "dont_write_bytecode", True)
        HOOK.start(str(folder), file.fileno())
        try:
            yield findings
        finally:
            HOOK.said = None
            file.seek(0)
            findings += [line for line in file.read().decode().splitlines() if not line.startswith(STARTED)]
            findings += [f"left: {path.name}" for path in temporary.iterdir()]


@dataclass(frozen=True)
class Repeated:
    """Two runs of a scene, what the second printed, and what both changed elsewhere.

    The first draws figures into a new folder. The second goes by its results.json, into a folder that holds the same files.
    """

    first: dict[str, Any]
    second: dict[str, Any]
    drawn: set[str]
    printed: str
    elsewhere: list[str]


@pytest.fixture(scope="module")
def repeated(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Repeated]:
    """repeated("chain"): each scene runs when it is first asked for."""
    @cache
    def run(name: str) -> Repeated:
        folder = tmp_path_factory.mktemp(name)
        out, again, temporary = folder / "out", folder / "deep" / "again", folder / "temporary"
        scene, printed = scene_file(folder / "here", name), io.StringIO()
        with watched(out, temporary) as first:
            assert main(["run", "-q", scene, "--out", str(out)]) == 0
        shutil.copytree(out, again)
        with (watched(again, temporary) as second, pytest.MonkeyPatch.context() as patch, redirect_stdout(printed)):
            patch.chdir(folder)
            assert main(["run", "out/results.json", "-v", "--no-figures", "--out", "deep/again"]) == 0
        drawn, kept = ({path.relative_to(one).as_posix() for path in one.rglob("*") if path.is_file()} for one in (out, again))
        return Repeated(results(out), results(again), drawn - kept, printed.getvalue(), first + second)

    return run


@pytest.mark.parametrize("name", EACH)
def test_a_run_is_repeated_from_its_results_and_told_in_80_columns(name: str, repeated: Callable[[str], Repeated]) -> None:
    run = repeated(name)
    assert all(len(line) <= WIDTH for line in run.printed.splitlines()), max(run.printed.splitlines(), key=len)
    assert not re.search(r"\b(nan|inf|None|True|False)\b", run.printed)
    first, second = deepcopy(run.first), deepcopy(run.second)
    for told in (first, second):  # seen from another folder
        for item in told["files"]:
            item["path"] = Path(item["path"]).name
        told["inputs"] = without_folders(told["inputs"])
    # figures apart, which are not drawn again
    assert ("figures" in first["inputs"], second["inputs"].pop("figures")) == (False, False)
    assert set(first.pop("written")) - set(kept := second.pop("written")) == run.drawn
    assert not difference(first, second)
    assert first["scene"] == first["inputs"]["name"] == name and len(kept) > 1


def test_a_run_without_figures_is_repeated_without_them(tmp_path: Path) -> None:
    assert main(["run", scene_file(tmp_path / "here", "audit"), "--no-figures", "--out", str(tmp_path / "out")]) == 0
    assert main(["run", str(tmp_path / "out" / "results.json"), "--out", str(tmp_path / "again")]) == 0
    first, second = results(tmp_path / "out"), results(tmp_path / "again")
    assert first["inputs"]["figures"] is second["inputs"]["figures"] is False
    assert first["written"] == second["written"] and not list(tmp_path.rglob("*.png"))


def test_each_kind_of_scene_is_repeated() -> None:
    assert set(SMALL) == set(built_in())


def test_what_the_comparison_would_see() -> None:
    assert len(difference({"a": [1.0, {"b": 2.0}], "c_s": 1.0}, {"a": [1.0, {"b": 2.0 + 1e-11}], "c_s": 9.0})) == 1
    assert difference({"a": None}, {"a": 0.0}) and difference([1], [1, 2]) and not difference([1e-14], [2e-14])


@pytest.mark.slow
def test_all_inputs_and_what_the_run_rests_on_are_told(tmp_path: Path) -> None:
    assert main(["run", scene_file(tmp_path, "solid"), "--no-figures", "--out", str(tmp_path / "out")]) == 0
    told = results(tmp_path / "out")
    scene, disc = Scene.from_file(tmp_path / "scene.toml"), told["inputs"]["part"]["disc"]
    assert disc["supports"] == ["left"] and disc["rayleigh"] == scene.parts["disc"].rayleigh  # type: ignore[attr-defined]
    assert told["inputs"]["material"]["steel"]["rho"] == 7850.0 and "scene" not in told["inputs"]
    assert {item["path"] for item in told["files"]} == {"../part.inp", "../nodes.inp"}  # with the file that the mesh includes
    assert all(len(item["sha256"]) == 64 and item["bytes"] == (tmp_path / "out" / item["path"]).stat().st_size
               for item in told["files"])
    assert told["versions"]["femsub"] == fs.__version__ and {"python", "numpy", "scipy", "commit"} <= set(told["versions"])
    assert set(told["machine"]) == {"cpu", "cores", "system"} and told["date"].endswith("+00:00")


@pytest.mark.slow
def test_the_package_that_factorised_is_told(tmp_path: Path) -> None:
    code = "import sys; from femsub.app.cli import main; sys.exit(main(sys.argv[1:]))"
    scene = scene_file(tmp_path, "beam", "[reduce]\nmodes = [8]\n[[ask]]\nmodes = 8\n")
    subprocess.run([sys.executable, "-c", code, "run", scene, "--no-figures", "--out", str(tmp_path / "out")], check=True,
                   capture_output=True)
    versions = results(tmp_path / "out")["versions"]
    assert {"PETSc", "SLEPc"} <= set(versions) and set(versions["factors"]) & {"mumps", "cholmod", "petsc"}


@pytest.mark.parametrize(("name", "changed"), [("solid", "part.inp"), ("solid", "nodes.inp"), ("matrices", "model.mat"),
                                               ("matrices", "M.npz")])
def test_a_file_that_has_changed_since_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str,
                                               changed: str) -> None:
    assert main(["run", scene_file(tmp_path, name, SHORT[name]), "--no-figures", "--out", str(tmp_path / "out")]) == 0
    capsys.readouterr()
    with (tmp_path / changed).open("ab") as file:
        file.write(b"\n")
    assert main(["run", str(tmp_path / "out" / "results.json")]) == 2
    said = capsys.readouterr()
    assert f"{changed} has changed since the run" in said.err and said.err.count("\n") == 1 and not said.out


@pytest.mark.parametrize("name", ["solid", "matrices"])
def test_files_beside_the_results_are_found(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    scene = scene_file(tmp_path / "there", name, SHORT[name])
    assert main(["run", scene, "--no-figures", "--out", str(tmp_path / "there" / "out")]) == 0
    (tmp_path / "sent").mkdir()
    shutil.copy(tmp_path / "there" / "out" / "results.json", tmp_path / "sent")
    needed = [Path(item["path"]).name for item in results(tmp_path / "sent")["files"]]
    for file in needed[:-1]:
        shutil.copy(tmp_path / "there" / file, tmp_path / "sent")
    capsys.readouterr()
    assert main(["run", str(tmp_path / "sent" / "results.json")]) == 2
    assert f"needs the file ../{needed[-1]}, which is neither there nor beside it" in capsys.readouterr().err
    shutil.copy(tmp_path / "there" / needed[-1], tmp_path / "sent")
    assert main(["run", str(tmp_path / "sent" / "results.json")]) == 0


def test_another_version_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", scene_file(tmp_path, "chain", CHAIN), "--out", str(tmp_path / "out")]) == 0
    path = tmp_path / "out" / "results.json"
    path.write_text(path.read_text().replace(f'"femsub": "{fs.__version__}"', '"femsub": "0.0.1"'))
    assert main(["run", str(path)]) == 0
    assert "was written by femsub 0.0.1" in capsys.readouterr().err


@pytest.mark.parametrize("content", ["", "[1]", "{}", '{"scene": "chain"}', "[" * 9999,
                                     '{"scene": "a", "inputs": {}, "files": [1], "versions": {}}',
                                     '{"scene": "chain", "inputs": 3, "files": [], "versions": {}}'])
def test_a_json_file_that_is_no_run_ends_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str) -> None:
    (tmp_path / "results.json").write_text(content)
    assert main(["run", str(tmp_path / "results.json")]) == 2
    said = capsys.readouterr().err
    assert "does not hold the inputs of a run" in said and said.count("\n") == 1


@pytest.mark.skipif(not shutil.which("git"), reason="there is no git here")
def test_the_commit_is_that_of_the_clone_the_folder_is_part_of(tmp_path: Path) -> None:
    assert commit(tmp_path) is None
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=b@c"]
    subprocess.run([*git, "init", "-q"], check=True)
    package, guest = tmp_path / "package", tmp_path / "guest"
    for folder in (package, guest):
        folder.mkdir()
        (folder / "__init__.py").write_text("")
    subprocess.run([*git, "add", "package"], check=True)
    subprocess.run([*git, "commit", "-qm", "first"], check=True)
    head = subprocess.run([*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True).stdout.strip()
    assert commit(package) == head and commit(guest) is None
    (package / "__init__.py").write_text("changed")
    assert commit(package) == f"{head}-dirty"


# ---- the folder


def test_results_of_another_scene_are_told_before_anything_is_computed(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                                                       monkeypatch: pytest.MonkeyPatch) -> None:
    assert main(["run", scene_file(tmp_path / "one", "chain", CHAIN), "--out", str(tmp_path / "out")]) == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    monkeypatch.setattr(Scene, "run", lambda *_: pytest.fail("it was run"))
    capsys.readouterr()
    for name, text in (("beam", SMALL["beam"]), ("chain", 'name = "another"\n' + CHAIN)):
        assert main(["run", scene_file(tmp_path / "other", name, text), "--out", str(tmp_path / "out")]) == 2
        said = capsys.readouterr().err
        assert "holds the results of another scene, 'chain' (critical.csv, results.json, size-sweep.csv)" in said
        assert said.count("\n") == 1
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before


@pytest.mark.slow
def test_what_only_the_last_run_wrote_goes_and_what_is_yours_stays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    text = "[part.beam]\nelements = 20\n" + QUICKLY + "[[ask]]\n{}\n"
    assert main(["run", scene_file(tmp_path, "beam", text.format('complex-modes = "all"')), "--out", str(out)]) == 0
    assert (out / "complex-modes-shape" / "phase-00.vtu").exists() and (out / "complex-modes-shape.pvd").exists()
    (out / "notes.txt").write_text("mine")
    (out / "mine.png").write_text("mine")
    capsys.readouterr()
    assert main(["run", scene_file(tmp_path, "beam", text.format('critical = "slope"')), "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {"results.json", "critical.csv", "critical.png", "notes.txt", "mine.png"}
    said = capsys.readouterr().err
    assert "also holds files that are not of this run: mine.png" in said and "notes.txt" not in said


def test_nothing_outside_of_the_folder_is_ever_taken_away(tmp_path: Path) -> None:
    out, mine = tmp_path / "out", tmp_path / "mine.csv"
    assert main(["run", scene_file(tmp_path, "chain", CHAIN), "--out", str(out)]) == 0
    mine.write_text("mine")
    told = results(out)
    told["written"] += ["../mine.csv", str(mine), "least/../../mine.csv", 3, "gone.csv"]
    (out / "results.json").write_text(json.dumps(told))
    assert main(["run", scene_file(tmp_path, "chain", CHAIN), "--out", str(out)]) == 0
    assert mine.read_text() == "mine"


@pytest.mark.parametrize("name", EACH)
def test_a_run_changes_nothing_outside_of_its_folder(name: str, repeated: Callable[[str], Repeated]) -> None:
    """Under an audit hook: what is opened for writing, moved or deleted lies in DIR, the temporary folder or /dev/shm."""
    assert not repeated(name).elsewhere


@pytest.mark.slow
@pytest.mark.parametrize("name", ["two-mode", pytest.param("solid", marks=pytest.mark.rare)])
def test_a_process_changes_nothing_outside_of_its_folder(tmp_path: Path, name: str) -> None:
    """From its imports to its end; figures are drawn into a new folder, and into the same again."""
    (tmp_path / "temporary").mkdir()
    scene = scene_file(tmp_path / "here", name)
    command = [sys.executable, str(Path(__file__).with_name("sandbox.py")), str(tmp_path / "out"), "run", "-q", scene]
    done = subprocess.run([*command, "--out", str(tmp_path / "out")], capture_output=True, text=True, check=False,
                          env={**os.environ, "TMPDIR": str(tmp_path / "temporary")})
    assert done.returncode == 0, done.stderr
    told = [line for line in done.stdout.splitlines() if not line.startswith(STARTED)]
    assert not told and not list((tmp_path / "temporary").iterdir())


def test_a_results_json_that_is_not_ours_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "results.json").write_text("mine")
    assert main(["run", scene_file(tmp_path, "chain", CHAIN), "--out", str(tmp_path / "out")]) == 2
    assert "was not written by femsub" in capsys.readouterr().err
    assert (tmp_path / "out" / "results.json").read_text() == "mine"


# ---- units


BEAM = ('figures = false\n{}\n[part.beam]\nelements = 20\n{}\n[reduce]\nmodes = [8]\n[[ask]]\nmodes = 8\n[[ask]]\n'
        'critical = "slope"\n{}\n')
IN_MM = ("beam = 1000.0\nwidth = 20.0\nheight = 10.0\nports = {belt = 350.0}", "[material.steel]\nE = 2.1e5\nrho = 7.85e-9\n"
         "[contact.belt]\nspeed = 191.13\neps = 1.0")


def test_without_units_none_is_claimed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", scene_file(tmp_path, "beam", BEAM.format("", "", "")), "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "Hz" not in said and "rad/s" not in said and "rad/time" in said
    assert "hz" not in (tmp_path / "out" / "results.json").read_text() + (tmp_path / "out" / "modes.csv").read_text()


def test_hertz_stand_beside_rad_per_second_in_each_system(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = {}
    for units, more in (("SI", ("", "")), ("mm-t-s", IN_MM)):
        out = tmp_path / f"out-{units}"
        assert main(["run", scene_file(tmp_path, "beam", BEAM.format(f'units = "{units}"', *more)), "--out", str(out)]) == 0
        said, data = capsys.readouterr().out, results(out)
        assert "rad/time" not in said and re.search(r"rad/s \(0 to [0-9.e+]+ Hz\)", said)
        for row in data["modes"]["rows"]:
            assert row["frequency_hz"] == pytest.approx(row["omega"] / (2 * np.pi), rel=1e-15)
            assert f"{row['frequency_hz']:.6g}" in said
        with open(out / "critical.csv", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        assert [float(row["frequency_hz"]) for row in rows] == [row["frequency_hz"] for row in data["critical"]]
        found[units] = [row["frequency_hz"] for row in data["modes"]["rows"]]
    assert found["SI"] == pytest.approx(found["mm-t-s"], rel=1e-6)


@pytest.mark.parametrize(("text", "words"), [
    ('units = "mks"', "units: unknown units 'mks'"), ("units = 3", "units: it must be a string or a table"),
    ('units = {length = "mm"}', "units: the key 'time' is missing"), ('units = {lenght = "mm", mass = "t", time = "s"}', "did "
                                                                                                                         "you "
                                                                                                                         "mean "
                                                                                                                         "'length'")])
def test_units_that_cannot_be_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, words: str) -> None:
    assert main(["run", scene_file(tmp_path, "beam", text)]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(("plain", "said"), [
    ("to 6.28319 rad/time", "to 6.28319 rad/s (1 Hz)"),
    ("band 0 to 6.28319e+03 rad/time", "band 0 to 6.28319e+03 rad/s (0 to 1000 Hz)"),
    ("ω  [rad/time]", "ω  [rad/s]"), ("v  [length/time]", "v  [mm/s]"), ("in time, of length 3", "in time, of length 3")])
def test_texts_and_labels_take_the_units(plain: str, said: str) -> None:
    assert SYSTEMS["mm-t-s"].said(plain) == said and UNKNOWN.said(plain) == plain


def test_figures_have_an_axis_in_hertz(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from femsub.modes import eigenvalue_chart
    from femsub.output import draw, render

    models = [{"panel": panel, "eigenvalues": np.array([1j, 2 + 6j]), "above_cutoff": np.zeros(2, bool), "model": "full",
               "error_bar": np.zeros(2), "size": 3} for panel in ("one", "two")]
    for units, expected in ((UNKNOWN, []), (SYSTEMS["SI"], ["f  [Hz]"])):
        made = []
        with (tmp_path / "figure.png").open("wb") as file:
            render(lambda made=made: made.append(draw(eigenvalue_chart(models, "both"))) or made[0], file, units, "as Fig. 4")
        axes = made[0].axes
        assert [child.get_ylabel() for axis in axes for child in axis.child_axes] == expected
        assert axes[0].get_ylabel() == ("Im λ  [rad/s]" if expected else "Im λ  [rad/time]")
        assert made[0].findobj(lambda artist: getattr(artist, "get_text", str)() == "Eigenvalues: both\nas Fig. 4")
        for child in axes[-1].child_axes:
            assert np.array(child.get_ylim()) * 2 * np.pi == pytest.approx(np.array(axes[-1].get_ylim()))


def test_each_scale_of_a_figure_has_its_own_axis_in_hertz(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from femsub.output import new_figure, render

    figure = new_figure(6.0, 4.0)
    axes = figure.subplots(2, 2)
    axes[0, 0].set_ylabel("ω  [rad/time]")
    axes[1, 0].set_xlabel("ω  [rad/time]")
    with (tmp_path / "figure.png").open("wb") as file:
        render(lambda: figure, file, SYSTEMS["SI"])
    labels = [[(child.get_xlabel(), child.get_ylabel()) for child in axis.child_axes] for axis in axes.ravel()]
    assert labels == [[("", ""), ("f  [Hz]", "")], [("", "f  [Hz]")], [], []]


def test_a_note_stands_at_the_foot_of_the_figures_of_its_ask(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    feet = {}
    monkeypatch.setattr("femsub.output.result.render",
                        lambda make, file, units, note="": feet.update({Path(file.name).name: note}))
    text = '[[ask]]\nfriction-law = [0.1]\nnote = "as Fig. 2"\n[[ask]]\ncritical = "slope"\n' + VARIED
    assert main(["run", scene_file(tmp_path, "chain", text), "--out", str(tmp_path / "out")]) == 0
    assert sorted(note for note in feet.values()) == ["", "as Fig. 2"] and len(feet) == 2


def test_the_paper_is_named_with_the_figures_that_correspond_to_its_own() -> None:
    notes = {ask.title: ask.note for ask in Scene.from_file("chain").asks}
    figures = {name: note.partition("corresponds to ")[2] for name, note in notes.items() if note}
    assert figures == {"friction-law": "Fig. 2 of the conference paper", "growth": "Fig. 3a of the conference paper",
                       "size-sweep": "Fig. 3b of the conference paper", "eigenvalues": "Fig. 4 of the conference paper"}
    assert ["Fig. 5" in ask.note for ask in Scene.from_file("chain-transient").asks] == [True]
