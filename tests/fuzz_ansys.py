"""Valid files of Ansys for tests and `fuzzing`, and how they are read.

A `.full` file comes from a writer, which femsub lacks, others from the examples of PyAnsys' reader where that is installed.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import fuzz_measured
import numpy as np
from fuzzing import Subject

from femsub.io.ansys import read_full as labelled


def record(values: np.ndarray) -> np.ndarray:
    """A record of Ansys: its length in words, flags, the content, the length again."""
    content = np.ascontiguousarray(values).view("<i4") if values.dtype == float else values.astype("<i4")
    return np.concatenate([[len(content), 0 if values.dtype == float else -2**31], content, [len(content)]]).astype("<i4")


def packed_record(values: np.ndarray) -> np.ndarray:
    """A record of whole numbers that leaves out entries 0: windows of equal and of other entries, and single ones."""
    content, at, count = list[int](), 0, 0
    while at < len(values):
        end = at + int(np.argmax(values[at:] != values[at])) if (values[at:] != values[at]).any() else len(values)
        if values[at] and (end > at + 1 or at == 0):
            content += [-at, -(end - at), int(values[at])]
        elif values[at]:
            end = end + int(np.argmin(values[end:])) if end < len(values) and not values[end:].all() else len(values)
            content += [at, int(values[at])] if end == at + 1 else [-at, end - at, *values[at:end].tolist()]
        count, at = count + bool(values[at]), end
    return np.concatenate([[len(content) + 2, -2**31 + 2**28, len(values), count], content, [len(content) + 2]]).astype("<i4")


def full_file(path: Path, K: np.ndarray, M: np.ndarray, about: Mapping[str, np.ndarray], unsymmetric: bool,
              triangle: bool = True, packed: bool = False) -> Path:
    """A .full file of all columns of an unsymmetric K, or of lower triangles; of M its `triangle`, or all.

    `packed`: tables of the DOF leave out entries 0.
    """
    def columns(A: np.ndarray, lower: bool) -> tuple[list[np.ndarray], int]:
        found, terms = [], 0
        for column in range(len(A)):
            rows = np.flatnonzero((A[:, column] != 0) | (A[column] != 0))
            rows = rows[(rows > column) | (not lower and rows != column)]
            rows = np.append(rows, column)
            found += [record(rows + 1), record(A[rows, column])]
            terms += len(rows)
        return found, terms

    nodes, kinds, held = about["nodes"], about["kinds"], about["held"]
    first = [record(kinds), record(nodes)]
    tables = [(packed_record if packed else record)(table) for table in (np.full(len(nodes), len(kinds)), held)]
    stiffness, mass = columns(K, not unsymmetric), columns(M, triangle or not unsymmetric)
    starts = np.cumsum([206, *(sum(map(len, part)) for part in (first, stiffness[0], tables, mass[0]))])
    standard, head = np.zeros(100), np.zeros(160)
    standard[[0, 1, 26]] = 4, -1, starts[4]
    head[[0, 1, 7, 8, 13, 18, 26, 32, 33, 35]] = (-4, len(K), len(kinds), stiffness[1], unsymmetric, starts[1] + 60,
                                                  starts[3] + 60, len(nodes), mass[1], starts[2] + 60)
    standard[26] += 60
    parts = [record(standard.astype(int)), record(head.astype(int)), *first, *stiffness[0], *tables, *mass[0]]
    np.concatenate(parts).tofile(path)
    return path


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
