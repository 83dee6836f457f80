"""Valid scene files, folders of results and files of modes for `fuzzing`, and how each is read, shown, run and written into."""

from __future__ import annotations

import json
import re
import shutil
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.sparse as sp
from fuzzing import Subject

import femsub as fs
from femsub.app.cli import main
from femsub.app.moving import MODE_FILE, read_mode
from femsub.app.page import show
from femsub.app.record import Record
from femsub.app.report import output_folder
from femsub.app.scene import Result, load
from femsub.errors import FemsubError
from femsub.studies import Table

NUMBERS = re.compile(r"[-+]?(?:\d+\.?\d*(?:e[-+]?\d+)?|\binf\b)|\bnan\b")
KEYS = (b"scene", b"name", b"n", b"modes", b"band", b"outputs", b"methods", b"slope", b"M", b"K", b"[[parts]]", b"[[joints]]",
        b"mesh", b"units", b"interface", b"port", b"file", b"factor", b"true", b"[]", b'""', b'"x.py"', b'"../../x"', b"1e308")
SCENES = {
    "chain": 'name = "a"\nn = 6\nbelts = [2]\nsizes = [3]\nslope = -0.1\nband = [0.0, 0.8]\nmethods = ["HCB", "CC"]\n'
             'outputs = ["critical-slope"]\nfigures = false\nrepeats = 1\nunits = "SI"\n',
    "matrices": 'M = "{0}/M.npz"\nK = "{0}/model.mat:K"\ninterface = [0, 7]\nport = 3\nmodes = [3]\nband = [0.0, 0.9]\n'
                'outputs = ["reduced-matrices"]\nformat = "npz"\n',
    "own-parts": 'methods = ["CC"]\nmodes = [3]\nband = [0.0, 0.4]\nslope = -0.1\nrepeats = 1\n[[parts]]\nname = "a"\n'
                 'M = "{0}/M.npz"\nK = "{0}/model.mat:K"\ninterface = [19]\nport = 1\n[[parts]]\nname = "b"\nM = "{0}/M.npz"\n'
                 'K = "{0}/model.mat:K"\ninterface = [19]\n[[joints]]\nbetween = ["a", "b"]\n',
    "affine": 'between = [0.0, 3.0]\npoints = 11\nM = {{file = "{0}/M.npz"}}\nK = [{{file = "{0}/model.mat:K", '
              'factor = "1 + p**2"}}, {{file = "{0}/M.npz", factor = "-p / q"}}]\nfixed = {{name = "q", value = 40.0}}\n',
    "superelements": 'band = [0.0, 1e4]\nreference = [3000.0]\n[[parts]]\nname = "a"\nfile = "{0}/arm.pch"\ncutoff = 2e4\n'
                     '[[joints]]\nkind = "spring"\nbetween = ["a", "ground"]\nstiffness = 1e7\n',
    "brake": 'size = 0.08\nfull = [0.5]\nband = [1e4, 1.2e4]\nE = [1.1e11, 8e9, 2.1e11]\nnu = [0.26, 0.3, 0.3]\n'
             'rho = [7200.0, 2600.0, 7850.0]\nmodes = [8]\noutputs = ["unstable"]\n',
}


def read_scene(path: Path) -> Any:
    """A scene file or a results.json."""
    scene, _ = load(str(path / "results.json" if path.is_dir() else path))
    return {key: repr(value).replace(str(path), "") for key, value in asdict(scene).items() if key != "folder"}


def run_scene(path: Path) -> Any:
    """A scene file of the chain, if it asks for what is quick to compute."""
    scene, run = load(str(path))
    if getattr(scene, "n", 99) > 20 or scene.repeats > 9 or scene.outputs != ["critical-slope"]:
        return "large"
    return sorted(run(scene, lambda _: None).data)


def honest_scene(path: Path) -> Any:
    """The content, if all that the text says by TOML is in it; the scenes' own rules are for names of methods and outputs."""
    try:
        table, content = tomllib.loads(path.read_text(encoding="utf-8")), read_scene(path)
    except (FemsubError, ValueError, RecursionError):
        return None
    for key, value in table.items():
        if key not in ("scene", "methods", "outputs", "law", "name") and not isinstance(value, dict) and not (
                isinstance(value, list) and any(isinstance(one, (dict, str)) for one in value)):
            found = eval(content[key], {"inf": float("inf"), "nan": float("nan")})
            if found != value and found != [value] and repr(found) != repr(value):
                return None
    # in tables, each number stands among those of the content
    tables = {key: value for key, value in table.items() if key not in ("methods", "outputs")}
    known = NUMBERS.findall(repr(content))
    if any(value not in map(float, known) for value in reals(tables)):
        return None
    return content


def reals(value: Any) -> Iterator[float]:
    """The numbers in nested tables and lists."""
    if isinstance(value, (dict, list)):
        for part in value.values() if isinstance(value, dict) else value:
            yield from reals(part)
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        yield float(value)


def honest_run(path: Path) -> Any:
    try:
        return None if honest_scene(path) is None else run_scene(path)
    except FemsubError:  # a value that does not fit the others
        return None


def show_results(path: Path) -> Any:
    """In a copy, since two at a time look at the valid folder, and one of them would be refused; all that the page shows."""
    with tempfile.TemporaryDirectory() as place:
        return re.sub(r"<script.*?</script>", "", show(shutil.copytree(path, Path(place) / "out")).read_text(), flags=re.DOTALL)


def write_results(path: Path) -> Any:
    """As a run of the same scene, whose file is there, writes into a copy of the folder."""
    with tempfile.TemporaryDirectory() as place:
        copy = shutil.copytree(path, Path(place) / "out")
        scene, _ = load(str(copy / "scene.toml"))
        with output_folder(str(copy)) as folder:
            assert folder is not None
            Record(scene, folder).write(Result({}, [Table("table", [{"a": 1}])]))
    return "written"


def mode(path: Path) -> Any:
    found = read_mode(path)
    return {"facts": json.dumps(found.facts), "points": found.points, "cells": found.cells, "u": found.u}


def subjects(folder: Path) -> list[Subject]:
    chain = fs.chain(20, belt=2)
    sp.save_npz(folder / "M.npz", sp.csc_matrix(chain.M))
    scipy.io.savemat(folder / "model.mat", {"K": sp.csc_matrix(chain.K)})
    made, free = [], frozenset[str]()
    for name, text in SCENES.items():
        path = folder / f"{name}.toml"
        path.write_text(f'scene = "{name}"\n' + text.format(folder), encoding="utf-8")
        made.append(Subject(f"scene-{name}", path, "fuzz_runs:read_scene", strict=free, vocabulary=KEYS, header=10_000,
                            honest=honest_scene))
    made.append(Subject("scene-run", folder / "chain.toml", "fuzz_runs:run_scene", strict=free, vocabulary=KEYS, header=10_000,
                        honest=honest_run))
    for name, scene in {"chain": "chain", "beam": None, "matrices": "matrices"}.items():
        out, path = folder / f"out-{name}", folder / f"{scene}.toml"
        if scene is None:
            path = folder / "beam.toml"
            path.write_text('scene = "beam"\nelements = 20\nmodes = [8]\nrepeats = 1\noutputs = ["eigenvalues", '
                            '"critical-slope", "error-time", "page"]\n')
        assert main(["run", "-q", str(path), "--out", str(out), "--no-figures"]) == 0
        (out / "scene.toml").write_bytes(path.read_bytes())
        made.append(Subject(f"show-{name}", out, "fuzz_runs:show_results", strict=free))
        made.append(Subject(f"again-{name}", out, "fuzz_runs:write_results", strict=free))
        if name == "matrices":
            for file in ("M.npz", "model.mat"):  # found beside results.json, wherever that is
                (out / file).write_bytes((folder / file).read_bytes())
        made.append(Subject(f"results-{name}", out, "fuzz_runs:read_scene", strict=free))
    whole = folder / "mode" / MODE_FILE
    whole.parent.mkdir()
    whole.write_bytes((folder / "out-beam" / MODE_FILE).read_bytes())
    made.append(Subject("mode", whole, "fuzz_runs:mode", text=False, strict=frozenset({"cut", "bytes", "bits", "nul"})))
    plain = folder / "mode-raw" / MODE_FILE
    plain.parent.mkdir()
    with np.load(whole) as arrays:
        np.savez(plain, **arrays)
    made.append(Subject("mode-raw", plain, "fuzz_runs:mode", text=False, strict=frozenset({"cut", "bytes", "bits", "nul"})))
    return made
