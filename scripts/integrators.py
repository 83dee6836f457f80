#!/usr/bin/env python3
"""Error against run time of the integrators behind `fs.transient`: chains on a belt, full and HCB, n = 10, 100, 1000.

    .venv/bin/python scripts/integrators.py [--time 50] [--numbers 10 100 1000]

Each run starts with a blow of 0.3 on the belt's mass, so that it slips and sticks from the first moment. The error is the
largest of the velocity under the belt over the whole run, relative to the belt's speed, against LSODA at tol = 1e-12. The full
chain of 1000 masses is compared with that of 100: up to t = 190 no wave has come back from the end of either.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Iterator

import numpy as np

import femsub as fs

BELT = fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=1e-3))
HCB_MODES = {10: 4, 100: 19, 1000: 99}
TOLS = {"lsoda": (1e-6, 1e-8, 1e-10), "dop853": (1e-6, 1e-8, 1e-10), "radau": (1e-6, 1e-8), "bdf": (1e-6, 1e-8),
        "alpha": (1e-4, 1e-5, 1e-6)}
SLOW = {"radau": 60, "bdf": 120, "lsoda": 400, "dop853": 400}  # DOF beyond which a method is left out: minutes


def models(numbers: list[int]) -> Iterator[tuple[str, fs.Substructure, fs.Substructure]]:
    """What is integrated, and what its solution is compared with."""
    for n in numbers:
        full = fs.chain(n, belt=2, damping=0.1)
        yield f"n = {n}, full", full, full if n <= 100 else fs.chain(100, belt=2, damping=0.1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fs.PortWarning)
            rom = fs.reduce(full, fs.CraigBampton(HCB_MODES.get(n, min(n - 1, 20))))
        yield f"n = {n}, HCB", rom, rom


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--time", type=float, default=50.0)
    parser.add_argument("--numbers", type=int, nargs="+", default=[10, 100, 1000])
    options = parser.parse_args()
    if options.time > 190:
        parser.error("--time must not exceed 190: waves would come back from the end of the chain")
    print(f"{'model':<16} {'DOF':>5} {'method':<7} {'tol':>6} {'error':>8} {'s':>8} {'steps':>7} {'rhs':>7} {'jac':>5} "
          f"{'balance':>8}")
    for name, model, judge in models(options.numbers):
        keys = {"time": (0.0, options.time), "impulse": 0.3, "step": 0.1}
        exact = fs.transient(judge, BELT, **keys, tol=1e-12, method="lsoda").velocity("belt")
        for method, tols in TOLS.items():
            if model.size > SLOW.get(method, np.inf):
                continue
            for tol in tols:
                began = time.perf_counter()
                run = fs.transient(model, BELT, **keys, tol=tol, method=method)
                seconds = time.perf_counter() - began
                error = np.abs(run.velocity("belt") - exact).max() / BELT.speed
                print(f"{name:<16} {model.size:>5} {method:<7} {tol:>6.0e} {error:>8.1e} {seconds:>8.3f} {run.effort.steps:>7} "
                      f"{run.effort.rhs:>7} {run.effort.jacobians:>5} {run.energy.residual:>8.0e}", flush=True)


if __name__ == "__main__":
    main()
