#!/usr/bin/env python3
"""A plate in parts, reduced by one process and by several side by side: seconds, and whether the digits are the same.

    python scripts/workers.py [--parts N] [--cells N] [--modes N] [--workers N] [--repeats N]

Both are measured in turn, each time in a process of its own with one thread of BLAS. The seconds are those of `reduce`: with the
start of the workers, and with the coupling of the reduced parts, which one process does.

ratio      Seconds of one process by those of several, of one round: median, least and most.
by CPU     The same where other programs do not disturb: CPU seconds of one process, by those of the process that waits and an
           equal share for each worker.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import sys
import time
from typing import Any

import numpy as np

import femsub as fs
from benchmarks.joined import strips
from benchmarks.processes import Row, fresh, peak_mb
from femsub.studies.tables import table

FEWEST = 100_000  # DOF of the plate that the requirement is about
TIMES = 1.6  # how many times faster two workers are to be


def measured(parts: int, cells: int, modes: int, workers: int) -> Row:
    """One reduction, and the lowest 20 frequencies of what it gives."""
    whole: Any = strips(parts, cells).system()
    before, start = cpu(), time.perf_counter()
    found = fs.reduce(whole, dict.fromkeys(whole.parts, fs.CraigBampton(modes)), workers=workers)
    seconds, (own, children) = time.perf_counter() - start, np.subtract(cpu(), before)
    return {"dof": whole.size, "reduced": found.size, "seconds": seconds, "own": own, "children": children, "peak_mb": peak_mb(),
            "frequencies": fs.normal_modes(found, 20).frequencies}


def cpu() -> tuple[float, float]:
    """CPU seconds of this process and of those it has waited for."""
    own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime, children.ru_utime + children.ru_stime


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--parts", type=int, default=8)
    parser.add_argument("--cells", type=int, default=75, help="elements along the side of a part (4 DOF each)")
    parser.add_argument("--modes", type=int, default=40, help="of each part")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    runs: dict[int, list[Row]] = {1: [], given.workers: []}
    for repeat in range(given.repeats):
        for workers in list(runs)[::1 if repeat % 2 == 0 else -1]:
            runs[workers].append(fresh(measured, given.parts, given.cells, given.modes, workers, cores=1))
    one, several = runs.values()
    ratios = [a["seconds"] / b["seconds"] for a, b in zip(one, several, strict=True)]
    by_cpu = [a["own"] / (b["own"] + b["children"] / given.workers) for a, b in zip(one, several, strict=True)]
    same = all(np.array_equal(run["frequencies"], one[0]["frequencies"]) for run in one + several)
    print(f"{given.parts} parts, {one[0]['dof']:,} DOF, reduced to {one[0]['reduced']:,}; {given.modes} modes of each part")
    keys = ("seconds", "own", "children", "peak_mb")
    print(table(["workers", "seconds", "CPU", "CPU of workers", "peak, MB"],
                [[str(workers), *(statistics.median(row[key] for row in found) for key in keys)]
                 for workers, found in runs.items()],
                ["", ".1f", ".1f", ".1f", ".0f"]))
    print(f"ratio {statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f}), by CPU "
          f"{statistics.median(by_cpu):.2f}; {'equal to the last digit' if same else 'NOT EQUAL'}")
    judged = one[0]["dof"] >= FEWEST and given.workers == 2
    if judged:
        print(f"at least {TIMES:g} asked: {'met' if statistics.median(ratios) >= TIMES else 'NOT MET'}")
    return int(not same or (judged and statistics.median(ratios) < TIMES))


if __name__ == "__main__":
    sys.exit(main())
