"""How many times as long complex modes of a brake take as so many real ones.

    python -m benchmarks brake [--size METRES] [--count N] [--rounds N]

N real modes of the brake without friction are sought first, then all complex modes in a band that holds N/2 pairs, then those N
nearest to 0. All are counted. Last come the N nearest without a count, by PEP. Elements of 0.033 m make 5,934 DOF, of 0.0085
48,762, of 0.007 83,382.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp

import femsub as fs
from femsub.app.scenes.brake import Brake, BrakeScene
from femsub.studies.losses import affine_over
from femsub.studies.tables import table

MU = 0.5


def brake(size: float) -> Brake:
    """Its meshes; the parts and the system are made when they are asked for."""
    return Brake(BrakeScene(size=size), lambda _: None)


def main(*, size: float = 0.0085, count: int = 60, rounds: int = 1) -> None:
    """Prints a row for each search."""
    made = brake(size)
    affine = affine_over(made.system, made.contacts(0.0), "mu", made.range)
    hi = float(np.sort(fs.complex_modes(affine.at(mu=MU), count=count + 2).eigenvalues.imag)[-2:].mean())

    def real() -> fs.NormalModes:
        given = affine.at(mu=0.0)
        return fs.normal_modes(fs.Substructure(given.M, sp.csr_array((given.K + given.K.T) * 0.5)), count=count)

    # a new pencil each time: factors and counts go with it
    searches: dict[str, Callable[[], Any]] = {
        "real": real, f"band to {hi:.0f} rad/s": lambda: fs.complex_modes(affine.at(mu=MU), band=(0.0, hi)),
        "nearest to 0": lambda: fs.complex_modes(affine.at(mu=MU), count=count),
        "nearest to 0, not counted": lambda: fs.complex_modes(affine.at(mu=MU), count=count, evidence=False)}
    rows = []
    for _ in range(rounds):
        first = 0.0
        for name, search in searches.items():
            start = time.perf_counter()
            found = repr(search())
            seconds = time.perf_counter() - start
            first = first or seconds
            rows.append([name, seconds, seconds / first, found])
    print(f"{made.system.size:,} DOF")
    print(table(["modes", "seconds", "times", "found"], rows, ["", ".3g", ".2f", ""]))
