"""Measurements in separate processes, each with its own memory and its own BLAS threads."""

from __future__ import annotations

import os
import signal
import sys
import time
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor, wait
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

LEFT_MB = 500.0  # free memory of the machine below which a measurement is stopped, before the system stops another process
WATCHED = 0.25  # seconds between two looks at a measurement,
SELDOM = 10  # and of its memory after so many times what the last look took: all pages of a large process are counted
Row = dict[str, Any]


class StoppedError(Exception):
    """A measurement took longer or more memory than it may."""


def begin(*folders: Path) -> None:
    """The start of a long command: checks that its folders can be written to, and makes it end orderly on a signal."""
    for folder in folders:
        try:
            with report.output_folder(str(folder)):
                pass
        except fs.InputError as error:
            raise UsageError(str(error)) from None
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # or the process that computes stays behind


def put(folder: Path, files: Mapping[str, str | bytes]) -> None:
    """Writes files into a folder, either all files or none."""
    def written(file: BinaryIO, content: str | bytes) -> None:
        file.write(content.encode() if isinstance(content, str) else content)

    write_whole(folder, {name: partial(written, content=content) for name, content in files.items()})


def peak_mb() -> float:
    """The largest resident memory of this process so far, in 10⁶ bytes."""
    return most_memory() / 1e6


def warm_up() -> None:
    """Loads all packages, by models below and above the size from which sparse solvers are used."""
    # The belt at m2 is outside the interface {m1} on purpose, as in the paper; the scene chain shows what that costs.
    warnings.simplefilter("ignore", fs.PortWarning)
    for size in (20, 200):
        fs.complex_modes(fs.reduce(fs.chain(size, belt=2), fs.CraigBampton(modes=3)), count=2)
        fs.complex_modes(fs.chain(size, belt=2), count=2)


def machine() -> Row:
    """Processor, cores, versions, and the number of threads of each BLAS, after all packages are loaded."""
    warm_up()
    threads = {Path(one["filepath"]).name: one["num_threads"] for one in libraries().info() if one["user_api"] == "blas"}
    return fs.algebra.machine() | report.versions() | {"OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS"),
                                                       "blas_threads": threads}


class Worker:
    """A process that runs one task after the other, and is replaced if it crashes or takes too long. Its memory needs Linux."""

    pool: ProcessPoolExecutor | None = None
    peak_mb = 0.0  #: of the last task, with all that it started, as far as it was looked at

    def __call__(self, task: Callable[..., Any], *args: Any, limit: float = np.inf) -> Any:
        """What the task returns.

        Raises
        ------
        StoppedError
            The process crashed, or was killed after so many seconds, or because the machine's memory was nearly used up.
        """
        self.pool = self.pool or ProcessPoolExecutor(max_workers=1, mp_context=get_context("spawn"))
        process, start, due, why = self.pool.submit(os.getpid).result(), time.perf_counter(), 0.0, ""
        running, self.peak_mb = self.pool.submit(task, *args), 0.0
        try:
            while not wait([running], min(WATCHED, limit)).done:
                if (begun := time.perf_counter()) >= due:
                    self.peak_mb = max(self.peak_mb, together_mb(process))
                    due = time.perf_counter() + SELDOM * (time.perf_counter() - begun)
                if time.perf_counter() - start > limit:
                    why = f"longer than {limit:g} s"
                elif (available() or np.inf) < 1e6 * LEFT_MB:
                    why = f"stopped at {self.peak_mb / 1e3:.1f} GB, with no memory left"
                if why:
                    os.kill(process, signal.SIGKILL)
                    break
            return running.result()
        except BrokenProcessPool:
            self.close()
            raise StoppedError(why or f"its process crashed, at {self.peak_mb / 1e3:.1f} GB") from None
        except (KeyboardInterrupt, SystemExit):
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)  # or leaving would wait for it
            raise

    def close(self) -> None:
        """Ends the process; the next task has a new one."""
        if self.pool:
            self.pool.shutdown()
            self.pool = None


def fresh(task: Callable[..., Any], *args: Any) -> Any:
    """task(*args) in a process of its own. It is started by this one, which therefore must stay small: on Linux the peak of a
    child begins at the size of its parent."""
    worker = Worker()
    try:
        return worker(task, *args)
    finally:
        worker.close()


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
