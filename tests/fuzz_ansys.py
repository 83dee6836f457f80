"""Valid files of Ansys for `fuzzing`, from the examples of PyAnsys' reader where that is installed, and how they are read."""

from __future__ import annotations

import shutil
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import fuzz_measured
from fuzzing import Subject

import femsub as fs


def examples() -> Path | None:
    """The folder of the reader's example files, if the reader is installed."""
    try:
        found = find_spec("ansys.mapdl.reader")
    except ModuleNotFoundError:
        found = None
    return Path(found.origin).parent / "examples" if found is not None and found.origin is not None else None


def read_full(path: Path) -> Any:
    part = fs.read_component(path)
    assert part.dofs is not None
    return {"K": part.K, "M": part.M, "nodes": part.dofs.nodes, "components": part.dofs.components}


def read_rst(path: Path) -> Any:
    return fuzz_measured.read_modes(path)


def subjects(folder: Path) -> list[Subject]:
    source, made = examples(), list[Subject]()
    if source is None:
        return made
    for name, header in (("full", 1000), ("rst", 3000)):
        path = folder / name / f"file.{name}"
        path.parent.mkdir(parents=True)
        shutil.copy(source / path.name, path)
        made.append(Subject(f"ansys-{name}", path, f"fuzz_ansys:read_{name}", text=False, strict=frozenset({"cut"}),
                            header=header))
    return made
