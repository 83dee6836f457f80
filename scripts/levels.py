#!/usr/bin/env python3
"""A model that no process holds: a rail of millions of DOF in parts on disk, reduced level by level in worker processes.

    python scripts/levels.py [--dof N] [--parts N] [--section Y Z] [--cutoff W] [--workers N] [--dask] [--gigabytes G] [--out DIR]

It prints what each level took, the lowest frequencies with their bounds, and the slope of the friction characteristic at which
the rail loses its stability under a belt. Then it tells what clusters of 4 to 256 workers would take. A run that was stopped
goes on where it was, if DIR is the same.

--dask       The workers are those of dask.distributed, each with a limit of memory (--gigabytes), beyond which dask ends it.

A cluster is simulated from the measured seconds: each task begins when the tasks below it are done and a worker is free, the
longest first. What it reads goes over a network of 1 GB/s, with 1 ms for each file.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import femsub as fs
from benchmarks.cluster import simulated
from benchmarks.pictures import save
from benchmarks.processes import peak_mb
from benchmarks.rail import rail
from femsub.app.figure_style import draw
from femsub.studies.charts import Chart, Panel, Series
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
    if sys.stderr.isatty():
        logging.basicConfig(level=logging.INFO, format="%(message)s")
        logging.getLogger("distributed").setLevel(logging.WARNING)
    start = time.perf_counter()
    parts = rail(given.out / "meshes", given.dof, given.parts, tuple(given.section))
    written = time.perf_counter()
    with workers_of(given) as where:
        whole = fs.reduce_by_levels(parts, fs.CraigBampton(cutoff=given.cutoff), given.out / "reduced", **where)
    reduced = time.perf_counter()
    bounds, (port,) = whole.bounds(given.count), whole.model.ports
    begin = time.perf_counter()
    border = fs.critical_slope(whole.model, port=port, band=(0.0, float(bounds.upper[-1])))
    found = {"dof": sum(task.size for task in whole.tasks.values() if not task.below), "parts": given.parts,
             "section": given.section, "cutoff": given.cutoff, "workers": given.workers, "dask": given.dask,
             "seconds": {"meshes": written - start, "reduce": reduced - written, "border": time.perf_counter() - begin},
             "memory": {"of a worker": whole.memory, "of this process": 1e6 * peak_mb()}, "border": border.value,
             "omega": border.omega, "evidence": {"frequencies": bounds.evidence, "border": border.evidence},
             "levels": [level_of(whole, level) for level in range(whole.levels)],
             "frequencies": [dict(zip(("upper", "lower", "error"), row, strict=True))
                             for row in zip(bounds.upper.tolist(), bounds.lower.tolist(), bounds.error.tolist(), strict=True)],
             "clusters": [vars(simulated(whole.tasks, workers)) for workers in SIZES]}
    for line in text(repr(whole), repr(bounds), found):
        print(line)
    (given.out / "levels.json").write_text(json.dumps(found, indent=1), encoding="utf-8")
    save(given.out / "levels.png", lambda: draw(chart(found)))
    return 0


def level_of(whole: fs.Levels, level: int) -> dict[str, Any]:
    tasks = [task for task in whole.tasks.values() if task.level == level]
    kinds = "size", "reduced_to", "modes", "seconds", "memory", "bytes"
    most = {key: max(getattr(task, key) for task in tasks) for key in kinds}
    return {"level": level, "tasks": len(tasks), "all": sum(task.seconds for task in tasks), **most}


def text(whole: str, bounds: str, found: dict[str, Any]) -> Iterator[str]:
    """What is printed."""
    seconds, clusters = found["seconds"], found["clusters"]
    yield whole
    yield (f"{seconds['meshes']:.1f} s to write the meshes, {seconds['reduce']:.1f} s to reduce; "
           f"this process took {found['memory']['of this process'] / 1e9:.2g} GB")
    yield table(["level", "tasks", "DOF of the largest", "reduced to", "modes", "seconds, all", "the longest", "GB of a process",
                 "MB of its files"],
                [[row["level"], row["tasks"], row["size"], row["reduced_to"], row["modes"], row["all"], row["seconds"],
                  row["memory"] / 1e9, row["bytes"] / 1e6] for row in found["levels"]],
                ["d", "d", ",d", ",d", "d", ".1f", ".1f", ".2f", ".1f"])
    yield bounds
    yield table(["ω (rad/s)", "not below", "error at most"], [list(row.values()) for row in found["frequencies"]],
                [".8g", ".8g", ".1e"])
    yield (f"stable down to a slope of {found['border']:.6g} at {found['omega']:.6g} rad/s ({found['evidence']['border']}), "
           f"{seconds['border']:.1f} s")
    yield table(["workers", "seconds", "times as fast", "busy", "MB sent"],
                [[row["workers"], row["seconds"], clusters[0]["seconds"] / row["seconds"], row["busy"], row["sent"] / 1e6]
                 for row in clusters], ["d", ".1f", ".1f", ".0%", ".0f"])


def chart(found: dict[str, Any]) -> Chart:
    """What clusters would take, and how far the frequencies may be off."""
    clusters, rows = found["clusters"], found["frequencies"]
    x, y = ([row[key] for row in clusters] for key in ("workers", "seconds"))
    ideal = Series("the same work, evenly divided", x, [y[0] / workers for workers in x], line="dash", marker="", colour="grey")
    return Chart("levels", f"{found['dof']:,} DOF in {found['parts']} parts, level by level", [
        Panel([Series("simulated from measured tasks", x, y, line="solid", marker="o", colour="black"), ideal], "workers  [-]",
              "seconds  [s]", "clusters", logs="xy"),
        Panel([Series("proved", [row["upper"] for row in rows], [row["error"] for row in rows], model="craig-bampton")],
              "ω  [rad/s]", "error of ω at most  [-]", "frequencies", logs="y")], across=2, columns=3)


if __name__ == "__main__":
    raise SystemExit(main())
