"""Valid scene files, folders of results and files of modes for `fuzzing`, and how each is read, shown, run and written into."""

from __future__ import annotations

import json
import re
import shutil
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.sparse as sp
from fuzzing import Subject

import femsub as fs
from femsub.app.cli import main
from femsub.app.grammar import Scene
from femsub.app.page import show
from femsub.app.record import Record
from femsub.app.report import output_folder
from femsub.app.result import Result
from femsub.checks import FemsubError
from femsub.io import read_mode
from femsub.output import MODE_FILE, Table

NUMBERS = re.compile(r"[-+]?(?:\d+\.?\d*(?:e[-+]?\d+)?|\binf\b)|\bnan\b")
KEYS = (b"scene", b"name", b"chain", b"modes", b"band", b"[[ask]]", b"methods", b"slope", b"M", b"K", b"[part.a]", b"[[joint]]",
        b"vary", b"units", b"interface", b"ports", b"critical", b"factor", b"true", b"[]", b'""', b'use = ["x.py"]',
        b'"../../x"', b"1e308", b"[contact.belt]", b"[reduce]", b"[material.steel]", b"[parameter.p]", b'"part.chain.belt"',
        b"ask")
FAMILIES = ("parts", "joints", "contacts", "materials", "parameters", "asks", "reduce", "settings")
MATRICES = 'matrices = {{M = "{0}/M.npz", K = "{0}/model.mat:K"}}\n'
SCENES = {
    "chain": 'name = "a"\nband = [0.0, 0.8]\nfigures = false\nunits = "SI"\n[part.chain]\nchain = 6\n[contact.belt]\n'
             'slope = -0.1\n'
             '[reduce]\nsizes = [3]\nmethods = ["HCB", "CC"]\nrepeats = 1\n[[ask]]\ncritical = "slope"\n',
    "matrices": f'band = [0.0, 0.9]\n[part.part]\n{MATRICES}interface = [0, 7]\nports = {{{{belt = [3]}}}}\n[reduce]\n'
                f'modes = [3]\n'
                '[[ask]]\nmatrices = "npz"\n',
    "own-parts": f'band = [0.0, 0.4]\n[part.disc]\n{MATRICES}interface = [19]\nports = {{{{belt = [1]}}}}\n[part.pad]\n{MATRICES}'
                 'interface = [19]\n[[joint]]\nrigid = ["disc", "pad"]\n[contact.belt]\nslope = -0.1\n[reduce]\n'
                 'methods = ["CC"]\n'
                 'modes = [3]\nrepeats = 1\n[[ask]]\ncompare = ["growth"]\nvary = {{"part.disc.loss" = [0.0, 0.5]}}\n',
    "affine": '[part.disc]\naffine.M = {{matrix = "{0}/M.npz"}}\n'
              'affine.K = [{{matrix = "{0}/model.mat:K", factor = "1 + p**2"}}, '
              '{{matrix = "{0}/M.npz", factor = "-p / q"}}]\n[parameter.p]\nbetween = [0.0, 3.0]\n[parameter.q]\nvalue = 40.0\n'
              '[[ask]]\nflutter = "p"\npoints = 11\n',
    "superelements": 'band = [0.0, 1e4]\n[part.in]\nsuperelement = "{0}/arm.pch"\ncutoff = 2e4\n[part.out]\n'
                     'superelement = "{0}/arm.pch"\n'
                     'cutoff = 2e4\n[[joint]]\nrigid = ["in", "out"]\n[[joint]]\nspring = ["in", "ground"]\nstiffness = 1e7\n'
                     '[[ask]]\n'
                     'modes = "band"\nreference = [3000.0]\n',
    "brake": 'band = [1e4, 1.2e4]\n[material.iron]\nE = 1.1e11\nnu = 0.26\nrho = 7200.0\n[part.disc]\n'
             'solid = {{brake = "disc", size = 0.08}}\n'
             '[reduce]\nmodes = [8]\n[[ask]]\ncomplex-modes = "full"\nat = {{mu = 0.5}}\nname = "unstable"\n',
}


def read_scene(path: Path) -> Any:
    """A scene file or a results.json."""
    scene = Scene.from_file(path / "results.json" if path.is_dir() else path)
    return {family: repr(getattr(scene, family)).replace(str(path), "") for family in FAMILIES}


def run_scene(path: Path) -> Any:
    """A scene file of the chain, if it asks for what is quick to compute."""
    scene = Scene.from_file(path)
    part, asks = next(iter(scene.parts.values()), None), [(ask.KIND, ask.vary) for ask in scene.asks]
    if getattr(part, "chain", 99) > 20 or scene.reduce.repeats > 9 or asks != [("critical", {})]:
        return "large"
    return sorted(scene.run(lambda _: None).data)


def honest_scene(path: Path) -> Any:
    """The content, if all that the text says by TOML is in it: its numbers, and its texts but for the names of methods."""
    try:
        table, content = tomllib.loads(path.read_text(encoding="utf-8")), read_scene(path)
    except (FemsubError, ValueError, RecursionError):
        return None
    whole = repr(content)
    known = set(map(float, NUMBERS.findall(whole)))
    if any(value not in known for value in reals(table)):
        return None
    told = {key: {name: one for name, one in value.items() if name != "methods"} if key == "reduce" else value
            for key, value in table.items() if key != "scene"}
    return content if all(repr(value)[1:-1] in whole for value in texts(told)) else None


def texts(value: Any) -> Iterator[str]:
    """The texts in nested tables and lists."""
    if isinstance(value, (dict, list)):
        for part in value.values() if isinstance(value, dict) else value:
            yield from texts(part)
    elif isinstance(value, str):
        yield value


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
        scene = Scene.from_file(copy / "scene.toml")
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
            path.write_text('scene = "beam"\npage = true\n[part.beam]\nelements = 20\n[reduce]\nmodes = [8]\nrepeats = 1\n'
                            '[[ask]]\n'
                            'complex-modes = "all"\n[[ask]]\ncritical = "slope"\n[[ask]]\n'
                            'compare = ["growth", "critical", "held"]\n')
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
