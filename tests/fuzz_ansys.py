"""Valid files of Ansys for `fuzzing`, from the examples of PyAnsys' reader where that is installed, and how they are read."""

from __future__ import annotations

import shutil
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import fuzz_measured
import numpy as np
from fuzzing import Subject

from benchmarks.attacks.files import full_file
from femsub.io.ansys import read_full as labelled


def examples() -> Path | None:
    """The folder of the reader's example files, if the reader is installed."""
    try:
        found = find_spec("ansys.mapdl.reader")
    except ModuleNotFoundError:
        found = None
    return Path(found.origin).parent / "examples" if found is not None and found.origin is not None else None


def read_full(path: Path) -> Any:
    found = labelled(path)
    return {key: found[key].matrix for key in "KM"} | {"labels": found["K"].labels}


def read_rst(path: Path) -> Any:
    return fuzz_measured.read_modes(path)


def subjects(folder: Path) -> list[Subject]:
    source, made, rng = examples(), list[Subject](), np.random.default_rng(5)
    for unsymmetric in (False, True):
        path = folder / f"full-{unsymmetric}" / "file.full"
        path.parent.mkdir(parents=True)
        B = np.tril(rng.standard_normal((6, 6))) + 3 * np.eye(6)
        about = {"nodes": np.array([3, 1]), "kinds": np.array([1, 2, 3]), "held": np.tile([1, 2, 3], 2)}
        full_file(path, B @ B.T + unsymmetric * rng.standard_normal((6, 6)), B @ B.T, about, unsymmetric)
        made.append(Subject(f"ansys-full{'-unsymmetric' * unsymmetric}", path, "fuzz_ansys:read_full", text=False,
                            strict=frozenset({"cut", "nul"}), header=1000))
    if source is not None:
        path = folder / "rst" / "file.rst"
        path.parent.mkdir(parents=True)
        shutil.copy(source / path.name, path)
        made.append(Subject("ansys-rst", path, "fuzz_ansys:read_rst", text=False, strict=frozenset({"cut", "nul"}), header=3000))
    return made
