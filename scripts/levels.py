#!/usr/bin/env python3
"""A model that no process holds: a rail of millions of DOF in parts on disk, reduced level by level in worker processes.

    python scripts/levels.py [--dof N] [--parts N] [--section Y Z] [--cutoff W] [--workers N] [--dask] [--gigabytes G] [--out DIR]

It prints what each level took, the lowest frequencies with their bounds, and the slope of the friction characteristic at which
the rail loses its stability under a belt. Then it tells what clusters of 4 to 256 workers would take. A run that was stopped
goes on where it was, if DIR is the same.

--dask       The workers are those of dask.distributed, each with a limit of memory (--gigabytes), beyond which dask ends it.
coarser      The border once more with the lower half of each part's modes; the difference is what the border's digits are worth.

A cluster is simulated from the measured seconds: each task begins when the tasks below it are done and a worker is free, the
longest first. What it reads goes over a network of 1 GB/s, with 1 ms for each file.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import femsub as fs
from benchmarks.cluster import simulated
from benchmarks.processes import peak_mb
from benchmarks.rail import rail
from femsub.studies.tables import table

if TYPE_CHECKING:
    from concurrent.futures import Executor

SIZES = (1, 2, 4, 8, 16, 32, 64, 128, 256)  # of the clusters


@contextmanager
def workers_of(given: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """The arguments of `reduce_by_levels` for the workers."""
    if not given.dask:
        yield {"workers": given.workers}
        return
    from distributed import Client, LocalCluster

    with LocalCluster(n_workers=given.workers, threads_per_worker=1, memory_limit=f"{given.gigabytes}GB", dashboard_address=None,
                      local_directory=str(given.out / "dask")) as cluster, Client(cluster) as client:
        executor: Executor = client.get_executor()
        yield {"executor": executor}


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--dof", type=float, default=4e6)
    parser.add_argument("--parts", type=int, default=32)
    parser.add_argument("--section", type=int, nargs=2, default=(13, 7), help="elements across and up")
    parser.add_argument("--cutoff", type=float, default=4e4, help="rad/s, of the modes of the parts")
    parser.add_argument("--count", type=int, default=20, help="frequencies")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--dask", action="store_true")
    parser.add_argument("--gigabytes", type=float, default=6.0, help="of memory for each worker of dask")
    parser.add_argument("--out", type=Path, default=Path("levels"))
    given = parser.parse_args()
    start = time.perf_counter()
    parts = rail(given.out / "meshes", given.dof, given.parts, tuple(given.section))
    written = time.perf_counter()
    with workers_of(given) as where:
        whole = fs.reduce_by_levels(parts, fs.CraigBampton(cutoff=given.cutoff), given.out / "reduced", **where)
    reduced = time.perf_counter()
    print(whole)
    print(f"{written - start:.1f} s to write the meshes, {reduced - written:.1f} s to reduce; this process took "
          f"{peak_mb() / 1e3:.2g} GB")
    levels = []
    for level in range(whole.levels):
        tasks = [task for task in whole.tasks.values() if task.level == level]
        size, left, modes, longest, memory, files = (
            max(getattr(task, key) for task in tasks) for key in ("size", "reduced_to", "modes", "seconds", "memory", "bytes"))
        seconds = sum(task.seconds for task in tasks)
        levels.append([level, len(tasks), size, left, modes, seconds, longest, memory / 1e9, files / 1e6])
    print(table(["level", "tasks", "DOF of the largest", "reduced to", "modes", "seconds, all", "the longest", "GB of a process",
                 "MB of its files"], levels, ["d", "d", ",d", ",d", "d", ".1f", ".1f", ".2f", ".1f"]))
    bounds = whole.bounds(given.count)
    print(bounds)
    print(table(["ω (rad/s)", "not below", "error at most"],
                list(zip(bounds.upper, bounds.lower, bounds.error, strict=True)), [".8g", ".8g", ".1e"]))
    port = next(iter(whole.model.ports))
    begin = time.perf_counter()
    border = fs.critical_slope(whole.model, port=port, band=(0.0, float(bounds.upper[-1])))
    print(f"{border!r}, {time.perf_counter() - begin:.1f} s")
    sizes = [simulated(whole.tasks, workers) for workers in SIZES]
    print(table(["workers", "seconds", "times as fast", "busy", "MB sent"], [
        [row.workers, row.seconds, sizes[0].seconds / row.seconds, row.busy, row.sent / 1e6] for row in sizes],
        ["d", ".1f", ".1f", ".0%", ".0f"]))
    found = {
        "dof": sum(task.size for task in whole.tasks.values() if not task.below), "seconds": reduced - written,
        "memory": whole.memory, "levels": levels, "upper": bounds.upper.tolist(), "lower": bounds.lower.tolist(),
        "border": border.value, "cluster": [[row.workers, row.seconds, row.busy, row.sent] for row in sizes]}
    (given.out / "levels.json").write_text(json.dumps(found, indent=1), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
