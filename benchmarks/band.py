"""How many times as long complex modes of a brake take as so many real ones.

    python -m benchmarks band [--size METRES] [--hard] [--count N] [--rounds N]

N real modes of the brake without friction are sought first, then all complex modes in a band that holds N/2 pairs, then those N
nearest to 0. All are counted. Last come the N nearest without a count, by PEP. Elements of 0.033 m make 5,934 DOF, of 0.0085
48,762, of 0.007 83,382.

--hard   The brake turns and is damped unevenly: D has a skew part of full rank, stiffness-proportional damping that differs from
         DOF to DOF, and twenty dashpots so strong that modes are overdamped.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

import femsub as fs
from benchmarks.brake import MU, brake
from femsub.studies.losses import affine_over
from femsub.studies.tables import table

TURNING, UNEVEN, DASHPOTS, STRONG = 200.0, 2e-8, 20, (0.05, 0.3)  # rad/s, s, their number, in units of sqrt(mk)


def hardened(pencil: fs.Pencil) -> fs.Pencil:
    """The same pencil with gyroscopic, uneven and strong damping."""
    n, rng = pencil.size, np.random.default_rng(5)
    shift = sp.diags_array(np.ones(n - 1), offsets=1, shape=(n, n))
    gyroscopic = pencil.M @ shift - shift.T @ pencil.M
    weight = sp.diags_array(1 + np.sin(9 * np.arange(n) / n))
    uneven = weight @ (pencil.K + pencil.K.T) @ weight * 0.5
    strong, at = np.zeros(n), rng.choice(n, DASHPOTS, replace=False)
    strong[at] = rng.uniform(*STRONG, DASHPOTS) * np.sqrt(np.abs(pencil.K.diagonal()) * pencil.M.diagonal())[at]
    D = pencil.D + TURNING * gyroscopic + UNEVEN * uneven + sp.diags_array(strong)
    return fs.Pencil(pencil.M, sp.csr_array(D), pencil.K)


def main(*, size: float = 0.0085, hard: bool = False, count: int = 60, rounds: int = 1) -> None:
    """Prints a row for each search."""
    made = brake(size)
    affine = affine_over(made.system, made.contacts(0.0), "mu", made.range)

    def pencil() -> fs.Pencil:  # a new one each time: factors and counts go with it
        found = affine.at(mu=MU)
        return hardened(found) if hard else found

    def band() -> float:
        sizes = np.sort(fs.complex_modes(pencil(), count=count + 2).eigenvalues.imag)
        return float(sizes[-2:].mean())

    def real() -> str:
        given = affine.at(mu=0.0)
        return repr(fs.normal_modes(fs.Substructure(given.M, sp.csr_array((given.K + given.K.T) * 0.5)), count=count))

    hi = band()
    searches: dict[str, Callable[[], str]] = {
        "real": real, f"band to {hi:.0f} rad/s": lambda: repr(fs.complex_modes(pencil(), band=(0.0, hi))),
        "nearest to 0": lambda: repr(fs.complex_modes(pencil(), count=count)),
        "nearest to 0, not counted": lambda: repr(fs.complex_modes(pencil(), count=count, evidence=False))}
    rows = []
    for _ in range(rounds):
        first = 0.0
        for name, search in searches.items():
            start = time.perf_counter()
            told = search()
            seconds = time.perf_counter() - start
            first = first or seconds
            rows.append([name, seconds, seconds / first, told])
    print(f"{made.system.size} DOF")
    print(table(["modes", "seconds", "times", "found"], rows, ["", ".3g", ".2f", ""]))
