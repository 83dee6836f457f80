"""Folders and files of somebody else: nothing is deleted that is not ours, no code is run that nobody named, nothing hangs."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import femsub as fs
from femsub.app.cli import main
from femsub.io import mesh_text
from femsub.io.atomic import NEXT, TEMPORARY
from femsub.output import MODE_FILE

CHAIN = 'scene = "chain"\nfigures = false\n[reduce]\nsizes = [3]\nrepeats = 1\n[[ask]]\ncritical = "slope"\n'
MARK = "from pathlib import Path\nPath({!r}).write_text('run')\n"


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene, and the folder of its run beside it."""
    folder = tmp_path_factory.mktemp("sound")
    (folder / "chain.toml").write_text(CHAIN)
    assert main(["run", "-q", str(folder / "chain.toml"), "--out", str(folder / "out")]) == 0
    return folder


@pytest.fixture
def out(sound: Path, tmp_path: Path) -> Path:
    """The folder of a run, a copy of its own."""
    shutil.copytree(sound, tmp_path, dirs_exist_ok=True)
    return tmp_path / "out"


def again(out: Path, *more: str) -> int:
    return main(["run", "-q", str(out.parent / "chain.toml"), "--out", str(out), *more])


def changed(out: Path, **entries: Any) -> dict[str, Any]:
    """results.json with other entries, and without its own sum; None takes one away."""
    told = json.loads((out / "results.json").read_text())
    told["sha256"].pop("results.json", None)
    told |= entries
    (out / "results.json").write_text(json.dumps({key: value for key, value in told.items() if value is not None}))
    return told


def hash_of(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def failed_in_one_line(arguments: list[str], capsys: pytest.CaptureFixture[str], words: str = "") -> None:
    capsys.readouterr()
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert words in said and said.count("\n") == 1, said


def command(*words: str, **more: Any) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-m", "femsub", *words], stderr=subprocess.PIPE, text=True,
                            stdout=subprocess.DEVNULL, **more)


# ---- what is deleted


def test_nothing_is_deleted_that_is_not_of_the_last_run(tmp_path: Path, out: Path) -> None:
    """Texts of one's own; a file through a link, to a file and to a folder; one that was changed since; one without a hash."""
    victim = tmp_path / "victim"
    victim.mkdir()
    mine = {"thesis.docx": "mine", "changed.csv": "mine", "unhashed.csv": "mine", "folder/thesis.txt": "mine"}
    (out / "folder").mkdir()
    for name, text in mine.items():
        (out / name).write_text(text)
    for name in ("thesis.txt", "data.csv", "other.csv"):
        (victim / name).write_text("mine")
    (out / "link").symlink_to("../victim")
    (out / "linked.csv").symlink_to("../victim/other.csv")
    (out / "ours.csv").write_text("ours")
    (out / "below").mkdir()
    (out / "below" / "ours.vtu").write_text("ours")
    names = {name: hash_of("mine") for name in [*mine, "link/thesis.txt", "link/data.csv", "linked.csv", "link"]}
    names |= {"changed.csv": hash_of("ours"), "ours.csv": hash_of("ours"), "below/ours.vtu": hash_of("ours"), "a\0b.csv": ""}
    del names["unhashed.csv"]
    changed(out, written=[*names, "unhashed.csv", ".", "", 3], sha256=names)
    assert again(out) == 0
    assert all((out / name).read_text() == "mine" for name in mine)
    assert all((victim / name).read_text() == "mine" for name in ("thesis.txt", "data.csv", "other.csv"))
    assert (out / "link").is_symlink() and (out / "linked.csv").is_symlink()
    assert not (out / "ours.csv").exists() and not (out / "below").exists()


def test_nothing_is_written_through_a_link(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "victim").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "complex-modes-shape").symlink_to("../victim")
    (tmp_path / "beam.toml").write_text('scene = "beam"\n[part.beam]\nelements = 20\n[reduce]\nmodes = [8]\n[[ask]]\n'
                                        'complex-modes = "all"\n')
    failed_in_one_line(["run", "-q", str(tmp_path / "beam.toml"), "--out", str(tmp_path / "out")], capsys,
                       "complex-modes-shape is a link to another folder")
    assert not list((tmp_path / "victim").iterdir()) and [path.name for path in (tmp_path / "out").iterdir()] == [
        "complex-modes-shape"]


# ---- what is run


@pytest.mark.parametrize("named", ["../evil.py", "sub/evil.py", "{}/evil.py", "link.py"])
def test_a_scene_file_does_not_run_python_from_elsewhere(named: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    here = tmp_path / "here"
    (here / "sub").mkdir(parents=True)
    for folder in (tmp_path, here / "sub"):
        (folder / "evil.py").write_text(MARK.format(str(tmp_path / "mark")))
    (here / "link.py").symlink_to("../evil.py")
    named = named.format(tmp_path)
    (here / "my.toml").write_text(f'use = ["{named}"]\nask = []\n')
    (here / "results.json").write_text(json.dumps({"scene": "evil", "inputs": {"use": [named]}, "versions": {}, "files": [
        {"path": named, "sha256": hashlib.sha256((here / named).read_bytes()).hexdigest()}]}))
    for file in ("my.toml", "results.json"):
        failed_in_one_line(["run", str(here / file)], capsys, f"--trust {here / named}")
        assert not (tmp_path / "mark").exists()
        failed_in_one_line(["run", str(here / file), "--trust", str(here / named)], capsys, "nothing is asked")
        (tmp_path / "mark").unlink()


def test_results_run_python_beside_them_only_with_its_hash(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "evil.py").write_text(MARK.format(str(tmp_path / "mark")))
    told = {"scene": "evil", "inputs": {"use": ["evil.py"]}, "versions": {}}
    for files, words in (([], "but not its SHA-256"), ([{"path": "evil.py", "sha256": "0" * 64}], "has changed since")):
        (tmp_path / "results.json").write_text(json.dumps(told | {"files": files}))
        failed_in_one_line(["run", str(tmp_path / "results.json")], capsys, words)
    assert not (tmp_path / "mark").exists()


# ---- what hangs


def bomb(folder: Path, levels: int = 9, width: int = 10) -> Path:
    for level in range(levels):
        (folder / f"{level}.inp").write_text(f"*INCLUDE, INPUT={level + 1}.inp\n" * width)
    (folder / f"{levels}.inp").write_text("** nothing\n")
    return folder / "0.inp"


def test_an_include_bomb_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(fs.InputError, match=r"includes more than 1000 files|files deep"):
        fs.read_mesh(bomb(tmp_path))
    with pytest.raises(fs.InputError, match="includes more than 1000 files"):
        fs.read_mesh(bomb(tmp_path, 7))
    monkeypatch.setattr(mesh_text, "MOST_REPEATED", 1_000_000)
    (tmp_path / "large.inp").write_text("** nothing at all\n" * 4000)
    for keyword in ("INCLUDE", "NODE"):
        (tmp_path / "many.inp").write_text(f"*{keyword}, INPUT=large.inp\n" * 50)
        with pytest.raises(fs.InputError, match="1 MB repeated"):
            fs.read_mesh(tmp_path / "many.inp")
    (tmp_path / "self.bdf").write_text("INCLUDE 'self.bdf'\nENDDATA\n")
    with pytest.raises(fs.InputError, match="does a file include itself"):
        fs.read_mesh(tmp_path / "self.bdf")


@pytest.mark.parametrize(("suffix", "line"), [(".inp", "*INCLUDE, INPUT={}"), (".inp", "*NODE, INPUT={}"),
                                              (".bdf", "INCLUDE '{}'")])
def test_a_mesh_includes_from_elsewhere_only_if_allowed(suffix: str, line: str, tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    (here / "sub").mkdir(parents=True)
    there.mkdir()
    (there / "part.inp").write_text("1 wrong\n")
    (here / "link.inp").symlink_to("../there/part.inp")
    for name in ("../there/part.inp", str(there / "part.inp"), "link.inp", "sub/../../there/part.inp"):
        deck = here / f"deck{suffix}"
        deck.write_text(f"{line.format(name)}\nENDDATA\n")
        with pytest.raises(fs.InputError, match=f"lies outside of its folder .*includes='{there}'.*--trust {there}"):
            fs.read_mesh(deck)
        with pytest.raises(fs.InputError) as error:
            fs.read_mesh(deck, includes=there)
        assert "outside" not in str(error.value)


def test_a_run_includes_from_a_folder_that_its_user_names(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "here").mkdir()
    fs.write_mesh(tmp_path / "there" / "nodes.inp", fs.block((0.1, 0.06, 0.01), (4, 3, 1), "hexahedron20"))
    (tmp_path / "here" / "part.inp").write_text("*INCLUDE, INPUT=../there/nodes.inp\n")
    scene = tmp_path / "here" / "my.toml"
    scene.write_text('scene = "solid"\n[part.disc]\nsolid = "part.inp"\nsupports = ["left"]\ninterface = ["right"]\n'
                     'ports = {belt = "top"}\n[contact.belt]\nslope = 0.0\n[reduce]\nmodes = [4]\n[[ask]]\nmodes = 4\n')
    failed_in_one_line(["run", str(scene)], capsys, f"--trust {tmp_path / 'there'}")
    assert main(["run", "-q", str(scene), "--trust", str(tmp_path / "there")]) == 0


@pytest.mark.parametrize("line", ['name = "../../x"', 'name = "a\\nb"', f'name = "{"x" * 300}"', "band = [0, 1e308]"])
def test_a_name_or_a_band_that_cannot_be_is_refused(line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "my.toml").write_text(f'scene = "beam"\n{line}\n')
    failed_in_one_line(["run", str(tmp_path / "my.toml"), "--out", str(tmp_path / "out")], capsys, line[:4])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["../../x", "a\\nb", "x" * 300, "inputs", "sha256"])
def test_a_name_of_an_ask_that_cannot_be_is_refused(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It names files, and an entry of results.json."""
    (tmp_path / "my.toml").write_text(f'scene = "beam"\n[[ask]]\nmodes = 3\nname = "{name}"\n')
    failed_in_one_line(["run", str(tmp_path / "my.toml"), "--out", str(tmp_path / "out")], capsys, "line 4: ask 1.name: ")
    assert not (tmp_path / "out").exists()


def test_asks_of_one_name_have_numbers(tmp_path: Path) -> None:
    asks = '[[ask]]\nmodes = 1\n[[ask]]\nmodes = 2\nname = "modes-2"\n[[ask]]\nmodes = 3\n'
    (tmp_path / "my.toml").write_text(f'scene = "beam"\nfigures = false\n[reduce]\nmodes = [4]\n{asks}')
    assert main(["run", "-q", str(tmp_path / "my.toml"), "--out", str(tmp_path / "out")]) == 0
    told = json.loads((tmp_path / "out" / "results.json").read_text())
    assert [len(told[name]["rows"]) for name in ("modes", "modes-2", "modes-3")] == [7, 8, 9]
    assert {"modes.csv", "modes-2.csv", "modes-3.csv"} <= {path.name for path in (tmp_path / "out").iterdir()}


# ---- what is shown


@pytest.mark.sampled(3)
@pytest.mark.parametrize("entries", [
    {"written": 5}, {"written": ["critical.csv", 3]}, {"versions": []}, {"machine": 3}, {"warnings": 7}, {"failed": [1]},
    {"date": 1}, {"files": [1]}, {"files": [{}]}, {"inputs": {"scene": ["chain"]}}, {"inputs": {"scene": "chain", "units": []}},
    {"inputs": {"scene": "chain", "ask": 5}}, {"inputs": {"part": [3], "use": [3]}}, {"inputs": {"part": {"a": 3}, "ask": [3]}},
    {"inputs": {"scene": "chain", "contact": 3, "reduce": [], "joint": {"a": []}}}, {"critical": 3}, {"critical": {"rows": [3]}},
    {"scene": {}}, {"compare": {"rows": 1, "recommended": [1]}}, {"recommended": {"model": 1}},
    {"complex-modes": [{"model": "full"}]},
    {"models": [{}]}, {"cycles": [{"omega": None}]}, {"critical-value": [1]}, {"scene": "\ud800"}, {"spectrum": [[]]}])
def test_damaged_results_are_shown_or_refused_in_one_line(entries: dict[str, Any], out: Path,
                                                          capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("plotly", reason="the page of a run needs plotly")
    changed(out, **entries)
    capsys.readouterr()
    status = main(["show", str(out)])
    said = capsys.readouterr().err
    assert (status, said.count("\n")) in ((0, 0), (2, 1)), said
    assert main(["run", "-q", str(out / "results.json")]) in (0, 2)
    assert again(out) in (0, 2)


def mode(path: Path, **changes: Any) -> None:
    told = {"title": "a", "eigenvalue": [0.0, 1.0], "nodes": 2} | changes.pop("facts", {})
    arrays = {"facts": np.frombuffer(json.dumps(told).encode(), np.uint8), "points": np.zeros((2, 3), np.float32),
              "cells": np.array([[0, 1]]), "real": np.zeros((2, 3)), "imag": np.zeros((2, 3))}
    np.savez_compressed(path, **{key: value for key, value in (arrays | changes).items() if value is not None})


@pytest.mark.sampled(3)
@pytest.mark.parametrize("changes", [
    {"points": None}, {"facts": {"title": 3}}, {"facts": {"eigenvalue": None}}, {"facts": {"eigenvalue": ["a", 1]}},
    {"facts": {"nodes": "x"}}, {"points": np.array([["a"] * 3] * 2)}, {"real": np.full((2, 3), np.nan)},
    {"cells": np.array([[0.0, 1.0]])}, {"real": np.zeros((6_000_000, 3), np.float32)}])
def test_a_damaged_mode_ends_in_one_line(changes: dict[str, Any], out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("plotly", reason="the page of a run needs plotly")
    mode(out / MODE_FILE, **{})
    assert main(["show", str(out)]) == 0
    mode(out / MODE_FILE, **changes)
    failed_in_one_line(["show", str(out)], capsys, "does not hold a mode")


def test_a_mode_that_announces_4_gb_is_not_unpacked(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("plotly", reason="the page of a run needs plotly")
    mode(out / MODE_FILE)
    with zipfile.ZipFile(out / MODE_FILE, "a", zipfile.ZIP_DEFLATED) as archive, archive.open("more.npy", "w") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (2 ** 29,)})
        for _ in range(9):
            file.write(bytes(1 << 23))
    failed_in_one_line(["show", str(out)], capsys, "there are at most 67108864")


def test_a_pipe_in_the_place_of_results_does_not_hang(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out").mkdir()
    os.mkfifo(tmp_path / "out" / "results.json")
    (tmp_path / "chain.toml").write_text(CHAIN)
    failed_in_one_line(["show", str(tmp_path / "out")], capsys, "holds no results.json")
    failed_in_one_line(["run", str(tmp_path / "chain.toml"), "--out", str(tmp_path / "out")], capsys, "was not written by femsub")


# ---- two at a time, and one that is killed


SLOW = """
import sys
from dataclasses import dataclass
from femsub.app.asks import Ask
from femsub.app.kinds import key
from femsub.app.result import Result
from femsub.output import Table

@dataclass(frozen=True)
class One(Ask):
    one: bool = key(True, "that it is asked for")
    KIND = "one"
    alone = True

    def run(self, models):
        print("begun", file=sys.stderr, flush=True)
        sys.stdin.readline()
        return Result({}, ["done", Table("one", [{"a": 1}])])
"""


@pytest.mark.slow
def test_two_runs_into_one_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The second is told. The lock of a run that is killed is gone with it, and its folder, if it had written nothing."""
    (tmp_path / "slow.py").write_text(SLOW)
    (tmp_path / "slow.toml").write_text('use = ["slow.py"]\n[[ask]]\none = true\n')
    (tmp_path / "chain.toml").write_text(CHAIN)
    here, out = ["run", "-q", str(tmp_path / "chain.toml"), "--out", str(tmp_path / "out")], tmp_path / "out"
    with command("run", str(tmp_path / "slow.toml"), "--out", str(out), stdin=subprocess.PIPE) as first:
        assert first.stderr is not None and first.stdin is not None
        assert first.stderr.readline() == "begun\n"
        failed_in_one_line(here, capsys, "another process writes into it")
        failed_in_one_line(["show", str(out)], capsys, "another process writes into it")
        with pytest.raises(fs.InputError, match="another process writes into it"):
            fs.write_matrices(out, fs.chain(3))
        fs.write_mesh(out / "mine.vtu", fs.block((1.0, 1.0, 1.0), (1, 1, 1), "hexahedron"))  # a lone file hinders nobody
        first.communicate("\n")
    assert first.returncode == 0 and (out / "one.csv").exists()
    with command("run", str(tmp_path / "slow.toml"), "--out", str(tmp_path / "other"), stdin=subprocess.PIPE) as second:
        assert second.stderr is not None and second.stderr.readline() == "begun\n"
        second.send_signal(signal.SIGKILL)
    here[-1] = str(tmp_path / "other")
    assert main(here) == 0


def stopped(folder: Path, at: int) -> None:
    """A process that overwrites a model and is killed at its move number `at`."""
    code = f"""
import os, signal, sys
import femsub as fs
real, calls = os.replace, []
def move(*words):
    calls.append(words)
    if len(calls) == {at}:
        os.kill(os.getpid(), signal.SIGKILL)
    real(*words)
os.replace = move
fs.write_matrices({str(folder)!r}, fs.chain(5, belt=2))
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == -signal.SIGKILL


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("at", "size"), [(1, 4), (2, 5), (4, 5)])
def test_a_killed_write_leaves_the_old_model_or_the_new_one(at: int, size: int, tmp_path: Path) -> None:
    """Before the new files are complete the old model is there, then the new one; the next write leaves nothing behind."""
    folder = tmp_path / "model"
    fs.write_matrices(folder, fs.chain(4, belt=2))
    (folder / "notes.txt").write_text("mine")
    before = {path.name for path in folder.iterdir()}
    stopped(folder, at)
    assert fs.read_component(folder).size == size
    shutil.copytree(folder, tmp_path / "copy")  # the model can be moved as it is
    assert fs.read_component(tmp_path / "copy").size == size
    hidden = {path.name for path in folder.iterdir()} - before
    assert len(hidden) == 1 and hidden.pop().startswith(TEMPORARY if at == 1 else NEXT)
    fs.write_matrices(folder, fs.chain(6, belt=2))
    assert fs.read_component(folder).size == 6 and {path.name for path in folder.iterdir()} == before


def test_hidden_folders_that_are_not_a_writer_s_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "victim").mkdir()
    (tmp_path / "victim" / "thesis.txt").write_text("mine")
    for name in (NEXT, f"{TEMPORARY}0"):
        folder = tmp_path / name
        fs.write_matrices(folder, fs.chain(3))
        (folder / name).symlink_to("../victim")
        fs.read_component(folder)
        if name == NEXT:
            with pytest.raises(fs.InputError, match="was not written by femsub"):
                fs.write_matrices(folder, fs.chain(3))
        else:
            fs.write_matrices(folder, fs.chain(3))
    (tmp_path / "own" / NEXT).mkdir(parents=True)
    for folder in (tmp_path / "own", tmp_path / "own" / NEXT):
        (folder / "thesis.docx").write_text(folder.name)
    with pytest.raises(fs.InputError, match=r"thesis\.docx was not written by femsub"):
        fs.write_matrices(tmp_path / "own", fs.chain(3))
    assert (tmp_path / "own" / "thesis.docx").read_text() == "own" and (tmp_path / "victim" / "thesis.txt").exists()


def test_writers_side_by_side_in_one_folder(tmp_path: Path) -> None:
    """Lone files of several processes at a time: nobody sweeps away what another one writes."""
    code = """
import sys
from pathlib import Path
from femsub.io.atomic import write_whole
for step in range(100):
    write_whole(Path(sys.argv[1]), {sys.argv[2]: lambda file: file.write(b"x" * 1000)})
"""
    running = [subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "out"), f"{name}.csv"]) for name in "abc"]
    assert [one.wait() for one in running] == [0, 0, 0]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"a.csv", "b.csv", "c.csv"}
