"""Measurements in processes of their own: the memory of each is its own, and so are its threads of BLAS."""

from __future__ import annotations

import ctypes
import os
import resource
import sys
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from threading import Event, Thread
from typing import Any
from unittest.mock import patch

import femsub as fs
from benchmarks import models
from femsub.app import report

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
Row = dict[str, Any]


def peak_mb() -> float:
    """The largest resident memory of this process so far, in 10⁶ bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e6


@contextmanager
def taken_mb() -> Iterator[list[float]]:
    """The largest memory that was taken from the machine during a block, in 10⁶ bytes, in a list of one; Linux.

    What several processes share counts once, which a sum of their peaks does not do. Other programs count as well.
    """
    def available() -> float:
        lines = Path("/proc/meminfo").read_text().splitlines()
        return 1.024e-3 * int(next(line for line in lines if line.startswith("MemAvailable")).split()[1])

    def watch() -> None:
        while not done.wait(0.2):
            found[0] = max(found[0], before - available())

    before, done, found = available(), Event(), [0.0]
    thread = Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield found
    finally:
        done.set()
        thread.join()


def warm_up(kind: str = "chain") -> None:
    """Loads everything, below and above the size from which the sparse solvers are taken."""
    # The belt at m2 is outside the interface {m1} on purpose, as in the paper; the scene chain shows what that costs.
    warnings.simplefilter("ignore", fs.PortWarning)
    for size in (20, 200):
        fs.complex_modes(fs.reduce(fs.chain(size, belt=2), fs.CraigBampton(modes=3)), count=2)
        fs.complex_modes(fs.chain(size, belt=2), count=2)
    if kind != "chain":
        fs.reduce(models.build(kind, models.KINDS[kind].sizes[0]), fs.CraigBampton(modes=3), ports=True)


def machine() -> Row:
    """Processor, cores, versions, and how many threads each BLAS has, when everything is loaded."""
    warm_up()
    threads, maps = {}, Path("/proc/self/maps")
    loaded = maps.read_text().splitlines() if maps.exists() else []
    for library in sorted({Path(line.split()[-1]) for line in loaded if "openblas" in line.rpartition("/")[2]}):
        for name in ("openblas_get_num_threads", "openblas_get_num_threads64_", "scipy_openblas_get_num_threads"):
            if hasattr(handle := ctypes.CDLL(str(library)), name):
                threads[library.name] = getattr(handle, name)()
    return report.machine() | report.versions() | {"OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS"),
                               "blas_threads": threads}


def fresh(task: Callable[..., Any], *args: Any, cores: int | None = None) -> Any:
    """task(*args) in a process of its own, with so many threads of BLAS. It is started by this one, which therefore must
    stay small: on Linux the peak of a child begins at the size of its parent."""
    threads = {} if cores is None else dict.fromkeys(THREADS, str(cores))
    with patch.dict(os.environ, threads), ProcessPoolExecutor(max_workers=1, mp_context=get_context("spawn")) as pool:
        return pool.submit(task, *args).result()
