#!/usr/bin/env python3
"""CHOLMOD against what takes over in a PETSc without it: seconds and errors of positive definite factors.

    python scripts/factors.py [--models chain beam slab] [--largest DOF] [--repeats N]

The factors are those of a PETSc with CHOLMOD, of one without (chains and beams by PETSc itself, all else by MUMPS), and of MUMPS
alone. Each is made in a process of its own. Seconds are medians. A PETSc without CHOLMOD gives the rows that it can.

factorise  Seconds for one factor of K.
64 at once Seconds to solve for 64 right-hand sides.
20 modes   Seconds for the lowest 20 modes, with their factor and their count.
error      Chain: the largest relative error of the lowest 20 ω against the closed form. Beam: that of the deflection of its free
           end under a force there, FL³/(3EI). Slab: that of its first mode shape x, solved for from Kx, in the norm.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np

import femsub as fs
from benchmarks.processes import Row, fresh, warm_up
from femsub.algebra import petsc
from femsub.algebra.factor import release
from femsub.studies.tables import table

COLUMNS = 64
MODELS: tuple[tuple[str, int, Any], ...] = (  # kind, DOF, masses or elements
    ("chain", 10_000, 10_000), ("chain", 100_000, 100_000), ("beam", 2000, 1000), ("slab", 30_750, (50, 40, 4)),
    ("slab", 106_500, (100, 70, 4)))
PACKAGES = ("with CHOLMOD", "without", "MUMPS alone")


def build(kind: str, size: Any) -> fs.Substructure:
    """A chain of `size` masses, a cantilever of so many elements, a steel slab of so many hexahedra, held at one end."""
    if kind == "chain":
        return fs.chain(size)
    if kind == "beam":
        return fs.beam(1.0, size, E=1.0, I=1.0, rho=1.0, A=1.0, supports={"left": "clamped"})
    return fs.solid(fs.block((1.0, 0.7, 0.05), size, "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0), supports=["left"])


def error(kind: str, sub: fs.Substructure, factor: petsc.Factor, modes: fs.NormalModes) -> float:
    """What the head of this file tells."""
    if kind == "chain":
        return float(np.abs(modes.frequencies / fs.chain_frequencies(sub.size, 20) - 1).max())
    if kind == "beam":
        load = np.zeros(sub.size)
        load[-2] = 3.0
        return float(abs(factor.solve(load)[-2] - 1))
    shape = modes.shapes[:, 0]
    return float(np.linalg.norm(factor.solve(sub.K @ shape) - shape) / np.linalg.norm(shape))


def measure(kind: str, size: Any, package: str, repeats: int) -> Row | None:
    """One row of the table, or None where PETSc has no CHOLMOD."""
    warnings.simplefilter("ignore", fs.ConditionWarning)
    warm_up()
    if package == "with CHOLMOD" and not petsc.has_cholmod():
        return None
    sub = build(kind, size)
    right = np.random.default_rng(0).standard_normal((sub.size, COLUMNS))
    times: list[list[float]] = [[], [], []]

    def timed(at: int, call: Callable[..., Any], *arguments: Any) -> Any:
        start = time.perf_counter()
        result = call(*arguments)
        times[at].append(time.perf_counter() - start)
        return result

    with patch.object(petsc, "CHOLMOD", package == "with CHOLMOD"), \
            patch.object(petsc, "slender", petsc.slender if package == "without" else lambda A: False):
        for _ in range(repeats):
            factor = timed(0, petsc.Factor, sub.K, "definite")
            timed(1, factor.solve, right)
            release(sub)
            modes = timed(2, partial(fs.normal_modes, sub, count=20))
        return {"DOF": sub.size, "factor": factor.package, **dict(zip(("factorise", "64 at once", "20 modes"),
                map(statistics.median, times), strict=True)), "error": error(kind, sub, factor, modes)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", nargs="+", choices=("chain", "beam", "slab"), default=["chain", "beam", "slab"])
    parser.add_argument("--largest", type=int, default=200_000, metavar="DOF")
    parser.add_argument("--repeats", type=int, default=3)
    args = parser.parse_args()
    print(f"PETSc {petsc.versions()['PETSc']}", flush=True)
    for kind, n, size in MODELS:
        if kind not in args.models or n > args.largest:
            continue
        rows: dict[str, list[Any]] = {}
        for package in PACKAGES:
            if row := fresh(measure, kind, size, package, args.repeats):
                rows.setdefault(row["factor"], [kind, *row.values()])
        print(table(["model", "DOF", "factor", "factorise", "64 at once", "20 modes", "error"], list(rows.values()),
                    ["", ",", "", ".3f", ".3f", ".2f", ".0e"]), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
