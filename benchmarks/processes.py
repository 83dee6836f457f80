"""Measurements in processes of their own: the memory of each is its own, and so are its threads of BLAS."""

from __future__ import annotations

import os
import signal
import sys
import time
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

import femsub as fs
from benchmarks import UsageError
from femsub.algebra.processes.memory import available, most_memory
from femsub.algebra.processes.threads import libraries
from femsub.app import report
from femsub.io.atomic import write_whole

LEFT_MB = 500.0  # below so much free memory of the machine a measurement is stopped, before the system stops something else
WATCHED = 0.25  # seconds between two looks at a measurement,
SELDOM = 10  # and of its memory after so many times what the last look took: all pages of a large process are counted
Row = dict[str, Any]


class StoppedError(Exception):
    """A measurement took longer or more memory than it may."""


def begin(*folders: Path) -> None:
    """What a command that takes long does first: its folders can be written to, and it leaves in order when it is ended."""
    for folder in folders:
        try:
            with report.output_folder(str(folder)):
                pass
        except fs.InputError as error:
            raise UsageError(str(error)) from None
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # or the process that computes stays behind


def put(folder: Path, files: Mapping[str, str | bytes]) -> None:
    """Writes files into a folder, all of them or none."""
    def written(file: BinaryIO, content: str | bytes) -> None:
        file.write(content.encode() if isinstance(content, str) else content)

    write_whole(folder, {name: partial(written, content=content) for name, content in files.items()})


def peak_mb() -> float:
    """The largest resident memory of this process so far, in 10⁶ bytes."""
    return most_memory() / 1e6


def warm_up() -> None:
    """Loads everything, below and above the size from which the sparse solvers are taken."""
    # The belt at m2 is outside the interface {m1} on purpose, as in the paper; the scene chain shows what that costs.
    warnings.simplefilter("ignore", fs.PortWarning)
    for size in (20, 200):
        fs.complex_modes(fs.reduce(fs.chain(size, belt=2), fs.CraigBampton(modes=3)), count=2)
        fs.complex_modes(fs.chain(size, belt=2), count=2)


def machine() -> Row:
    """Processor, cores, versions, and how many threads each BLAS has, when everything is loaded."""
    warm_up()
    threads = {Path(one["filepath"]).name: one["num_threads"] for one in libraries().info() if one["user_api"] == "blas"}
    return report.machine() | report.versions() | {"OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS"),
                               "blas_threads": threads}


def fresh(task: Callable[..., Any], *args: Any) -> Any:
    """task(*args) in a process of its own. It is started by this one, which therefore must stay small: on Linux the peak of a
    child begins at the size of its parent."""
    with ProcessPoolExecutor(max_workers=1, mp_context=get_context("spawn")) as pool:
        return pool.submit(task, *args).result()


class Worker:
    """A process that does one task after the other, and is replaced when it crashes or takes too long."""

    pool: ProcessPoolExecutor | None = None

    def __call__(self, task: Callable[..., Any], *args: Any, limit: float | None = None) -> Any:
        self.pool = self.pool or ProcessPoolExecutor(max_workers=1, mp_context=get_context("spawn"))
        try:
            return self.pool.submit(task, *args).result(timeout=limit)
        except (BrokenProcessPool, TimeoutError) as error:
            for process in list(self.pool._processes.values()):
                process.kill()
            self.close()
            late = isinstance(error, TimeoutError)
            raise StoppedError(f"no answer within {limit:g} s" if late else "its process crashed") from None

    def close(self) -> None:
        """Ends the process; the next task has a new one."""
        if self.pool:
            self.pool.shutdown()
            self.pool = None


def watched(task: Callable[..., Row], *args: Any, limit: float) -> Row:
    """The row of `fresh`, whose peak_mb is that of the process with all it started; Linux.

    Raises
    ------
    StoppedError
        The process was killed after so many seconds, or because the memory of the machine was nearly used up.
    """
    with ProcessPoolExecutor(max_workers=1, mp_context=get_context("spawn")) as pool:
        process, start = pool.submit(os.getpid).result(), time.perf_counter()
        running, peak, why, due = pool.submit(task, *args), 0.0, "", 0.0
        try:
            while not running.done():
                time.sleep(WATCHED)
                if (begun := time.perf_counter()) >= due:
                    peak = max(peak, together_mb(process))
                    due = time.perf_counter() + SELDOM * (time.perf_counter() - begun)
                if time.perf_counter() - start > limit:
                    why = f"longer than {limit:g} s"
                elif (available() or np.inf) < 1e6 * LEFT_MB:
                    why = f"stopped at {peak / 1e3:.1f} GB, with no memory left"
                if why:
                    os.kill(process, signal.SIGKILL)
                    break
            row: Row = running.result()
        except BrokenProcessPool:
            raise StoppedError(why or f"ended by the system at {peak / 1e3:.1f} GB") from None
        except BaseException:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)  # or leaving the pool would wait for it
            raise
    return row | {"peak_mb": max(row["peak_mb"], peak)}


def together_mb(process: int) -> float:
    """The memory of a process and of all that it started, in 10⁶ bytes; 0 where it has ended.

    What they share counts once, as the pages of a fork do: Σ Pss.
    """
    processes, total = [process], 0.0
    for one in processes:  # all of them before the first look: what is forked between two looks may not count twice
        with suppress(OSError):
            for thread in Path("/proc", str(one), "task").iterdir():
                processes += [int(word) for word in (thread / "children").read_text(encoding="ascii").split()]
    for one in processes:
        with suppress(OSError, StopIteration):
            lines = Path("/proc", str(one), "smaps_rollup").read_text(encoding="ascii").splitlines()
            total += 1.024e-3 * int(next(line for line in lines if line.startswith("Pss:")).split()[1])
    return total
