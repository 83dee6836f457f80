"""Hundreds of modes of a solid: how far block Lanczos is from its limit, and what modes from elsewhere would still cost.

    python -m benchmarks.hundreds slab 150,90,6 200
    python -m benchmarks.hundreds bulk 40,20,10 500 --beyond 2 3

The limit is a factor and 2.5 solves for each mode, in blocks of 64. Modes from elsewhere, as by automated multilevel
substructuring, would need a factor as well, two block iterations and the residuals. `--beyond` counts the modes below so many
times the highest frequency: about as many coordinates has the dense eigenproblem of that method.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import scipy.linalg as la

from benchmarks.comparisons import solid
from femsub.algebra import Difference, inertia, times
from femsub.modes import ShiftInvert, lowest_modes
from femsub.modes.normal_modes import relative_residual

NODES, BLOCK, GUARD = 84, 64, 20  # of the interface; right-hand sides at once; columns beyond the modes


def main() -> None:
    """Prints a line for each phase."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("component", choices=["slab", "bulk"])
    parser.add_argument("cells", type=lambda text: tuple(int(part) for part in text.split(",")))
    parser.add_argument("modes", type=int)
    parser.add_argument("--beyond", type=float, nargs="*", default=[])
    asked = parser.parse_args()
    sub = solid(asked.component, asked.cells, NODES)
    inner = sub.interior
    K, M = (A[inner][:, inner].tocsr() for A in (sub.K, sub.M))
    start, rng = time.perf_counter(), np.random.default_rng(0)

    def lap(what: str) -> float:
        nonlocal start
        now = time.perf_counter()
        start, seconds = now, now - start
        print(f"{what:60s}{seconds:8.1f} s", flush=True)
        return seconds

    handle = ShiftInvert(K, M)
    factor = lap(f"factor and checks, {len(inner)} DOF")
    loads = np.asfortranarray(rng.standard_normal((len(inner), BLOCK)))
    handle.factor.solve(loads)
    solves = lap(f"{BLOCK} solves in a block") / BLOCK * 2.5 * asked.modes
    found = lowest_modes(handle, asked.modes)
    whole = factor + lap(f"{asked.modes} modes, {found.evidence}, residual {found.residual.max():.0e}")
    print(f"{whole / (factor + solves):.2f} times the limit of {factor + solves:.1f} s")
    X, other = np.hstack([found.shapes, rng.standard_normal((len(inner), GUARD))]), factor
    start = time.perf_counter()
    for _ in range(2):
        MX = times(M, X)
        Z = handle.factor.solve(MX)
        other += lap("solves of a block iteration")
        energy, mass = Z.T @ MX, Z.T @ times(M, Z)
        X = Z @ la.eigh((energy + energy.T) / 2, (mass + mass.T) / 2)[1]
        other += lap("its Rayleigh-Ritz step")
    relative_residual(K, M, found.eigenvalues, np.asfortranarray(X[:, :asked.modes]))
    other += lap("residuals")
    print(f"modes from elsewhere, if they cost nothing: {other:.1f} of {whole:.1f} s, {whole / other:.2f} times faster at most")
    for beyond in asked.beyond:
        print(f"{inertia(Difference(K, M, (beyond * found.frequencies[-1]) ** 2))} modes below {beyond:g} times the highest")


if __name__ == "__main__":
    main()
