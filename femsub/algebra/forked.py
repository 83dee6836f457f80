"""Blocks of columns that a fork of this process finds on the second core, with the factor that it has in memory.

A new process would have to make a factor of its own. Threads would not do: PETSc is not safe in them.
"""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from mmap import mmap
from threading import current_thread, main_thread
from typing import TYPE_CHECKING

import numpy as np

from femsub.algebra.petsc import Factor
from femsub.algebra.threads import cores, one_thread
from femsub.algebra.waiting import LEAST, LOOK
from femsub.checks import Array

if TYPE_CHECKING:
    from femsub.algebra.factor import Handle

WORTH = 2e9  # nonzeros of the factor times columns from which the solves take much longer than a fork
WIDTH, ALONE = 32, 64  # columns of a block with a fork, and without
OPEN, BEGUN, DONE = 0, 1, 2  # states of a block
PATIENCE = 10.0  # times what a block took, `LEAST` seconds on top, after which a fork that does not answer is given up
DIES_WITH_PARENT = 1  # Linux' PR_SET_PDEATHSIG


def fork_pays(factor: Handle, columns: int) -> bool:
    """Whether so many solves with this factor are worth a fork, and whether one is safe.

    CHOLMOD solves without threads and without messages of its own. A fork has no thread but that which called it. Networks of
    clusters write into the memory of processes of MPI, which a fork would upset.
    """
    if not isinstance(factor, Factor) or factor.package != "cholmod" or "mpi4py.MPI" in sys.modules:
        return False
    worth = columns > WIDTH and factor.fill * factor.size * columns >= WORTH
    return worth and sys.platform == "linux" and current_thread() is main_thread() and cores() > 1


def shared_zeros(rows: int, columns: int) -> Array:
    """Zeros (rows, columns) in memory that this process shares with its forks."""
    try:
        return np.ndarray((rows, columns), buffer=mmap(-1, max(8 * rows * columns, 1)), order="F")
    except OSError as error:
        raise MemoryError(f"{rows} x {columns} numbers: {error}") from None


class Divided:
    """All columns by blocks: a fork takes them from the first on, and `finish` takes those that are left from the last on.

    A block that the fork began and did not end is found again here: nothing depends on the fork but time. So `solve` must write
    all of its columns, whatever is there, and add to none.
    """

    def __init__(self, solve: Callable[[slice], None], columns: int, beside: bool, width: int | None = None) -> None:
        self._solve = solve
        width = width or (WIDTH if beside else ALONE)
        self._parts = [slice(at, min(at + width, columns)) for at in range(0, columns, width)]
        self._state: Array = np.ndarray(len(self._parts), dtype=np.int8, buffer=mmap(-1, max(len(self._parts), 1)))
        self._one_core = ExitStack()
        self._begun = time.monotonic()
        self._fork = 0
        if beside:
            self._one_core.enter_context(one_thread(True))  # before the fork, which has no threads of BLAS
            held = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))  # Ctrl-C is for this process alone
            try:
                self._begin()
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, held)

    def _begin(self) -> None:
        """Begins the fork, where there is room for one. It never returns from here."""
        with warnings.catch_warnings(), suppress(OSError):
            warnings.simplefilter("ignore", DeprecationWarning)  # Python warns of threads, and those of BLAS end in a fork
            self._fork = os.fork()
            if self._fork:
                return
            try:
                gc.disable()  # what the fork finds unused, this process may still use: files, other processes
                ctypes.CDLL(None).prctl(DIES_WITH_PARENT, signal.SIGKILL)
                for at in range(len(self._parts)):
                    if self._state[at] != OPEN:
                        break
                    self._take(at)
            finally:
                os._exit(0)

    def _take(self, at: int) -> None:
        self._state[at] = BEGUN
        self._solve(self._parts[at])
        self._state[at] = DONE

    @property
    def left(self) -> int:
        """How many columns are not found yet."""
        return sum(part.stop - part.start for part, state in zip(self._parts, self._state, strict=True) if state != DONE)

    def busy(self) -> bool:
        """Whether the fork still works. Who asks, and hears that it does not, has both cores again."""
        if self._fork:
            with suppress(ChildProcessError):  # it has ended, and somebody else was told
                if os.waitpid(self._fork, os.WNOHANG) == (0, 0):
                    return True
        self._fork = 0
        self._one_core.close()
        return False

    def finish(self) -> None:
        """Find all columns that are not there."""
        for at in reversed(range(len(self._parts))):
            if self._state[at] != OPEN:
                break
            self._take(at)
        done = max(int(np.count_nonzero(self._state == DONE)), 1)
        patience = time.monotonic() + LEAST + PATIENCE * (time.monotonic() - self._begun) / done
        while self.busy() and time.monotonic() < patience:
            time.sleep(LOOK)
        self.close()
        for at in np.flatnonzero(self._state != DONE):
            self._take(int(at))

    def close(self) -> None:
        """Ends the fork."""
        if self._fork:
            with suppress(OSError):
                os.kill(self._fork, signal.SIGKILL)
                os.waitpid(self._fork, 0)
        self._fork = 0
        self._one_core.close()


@contextmanager
def divided(solve: Callable[[slice], None], columns: int, beside: bool, width: int | None = None) -> Iterator[Divided]:
    """A fork calls `solve(part)` for slices of the columns meanwhile; at the end all are found. See `Divided`."""
    work = Divided(solve, columns, beside, width)
    try:
        yield work
        work.finish()
    finally:
        work.close()


def solved(factor: Handle, B: Array) -> Array:
    """A⁻¹B, of which a fork finds half where that pays: a second thread of BLAS gains much less."""
    if not fork_pays(factor, B.shape[1]):
        return factor.solve(B)
    X = shared_zeros(*B.shape)

    def some(part: slice) -> None:
        X[:, part] = factor.solve(B[:, part])

    with divided(some, B.shape[1], True):
        pass
    return X
