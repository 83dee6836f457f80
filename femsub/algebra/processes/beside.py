"""Work beside this process, on the second core: by a fork, which has this process' factors in memory, or by a new interpreter.

A fork starts at once, and solves with a factor that exists. Work that needs a new factor is done by a new interpreter: CHOLMOD
has hung in a fork while it made a factor. Threads would not do: PETSc is not thread-safe.
"""

from __future__ import annotations

import gc
import json
import logging
import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from contextvars import ContextVar
from mmap import mmap
from pathlib import Path
from select import POLLIN, poll
from threading import Thread, current_thread, main_thread
from typing import Any, Self, TypeVar

import numpy as np

from femsub.algebra.processes.folders import MEMORY, has_room, task_folder
from femsub.algebra.processes.limits import BLOCK, LOOK, PATIENCE
from femsub.algebra.processes.memory import available
from femsub.algebra.processes.stored import bytes_of, load, store
from femsub.algebra.processes.system import environment_of_workers, libc
from femsub.algebra.processes.threads import cores, libraries, one_thread
from femsub.algebra.processes.waiting import is_stopped
from femsub.checks import Array, NotEnoughMemoryError, temporary

T = TypeVar("T")
log = logging.getLogger(__name__)
_forks: ContextVar[tuple[Divided, ...]] = ContextVar("femsub_forks", default=())  # the forks that work beside this thread


def divided(solve: Callable[[slice], None], columns: int, forked: bool, meanwhile: Callable[[], T] | None = None,
            width: int | None = None) -> T | None:
    """Call `solve(part)` for slices that make up all columns, and return what `meanwhile()` returns.

    A fork takes blocks from the first on while `meanwhile` is called here. Then this process takes blocks from the last on, until
    all are solved. A block that the fork began and did not finish is solved again here, so that only time depends on the fork. So
    `solve` must overwrite all of its columns, and add to none. The columns must lie in `shared_zeros`.

    Parameters
    ----------
    solve : function
    columns : int
    forked : bool
        Whether there is a fork. Without it `meanwhile` is called first.
    meanwhile : function, optional
        It should call `give_back_cores` now and then: while the fork works, BLAS has one thread.
    width : int, optional
        Columns of a block: by default `BLOCK`, or half of it with a fork, so that neither waits long for the other.
    """
    work = Divided(solve, columns, forked, width or (BLOCK // 2 if forked else BLOCK))
    token = _forks.set((*_forks.get(), work))
    try:
        found = None if meanwhile is None else meanwhile()
        work.finish()
        return found
    finally:
        _forks.reset(token)
        work.close()


def give_back_cores() -> None:
    """Let BLAS have all cores again if the forks beside this thread have ended."""
    for work in _forks.get():
        work.busy()


def columns_left() -> int:
    """Columns that forks beside this thread, and then this process, have yet to solve: their memory is not taken yet."""
    return sum(work.left for work in _forks.get())


def is_fork_safe() -> bool:
    """Whether this process may be forked, and has a core for it.

    A fork has only the thread that made it. It would upset networks of clusters, which write into the memory of MPI processes.
    """
    return sys.platform == "linux" and current_thread() is main_thread() and "mpi4py.MPI" not in sys.modules and cores() > 1


def shared_zeros(rows: int, columns: int) -> Array:
    """Zeros (rows, columns) in memory that this process shares with its forks."""
    try:
        return np.ndarray((rows, columns), buffer=mmap(-1, max(8 * rows * columns, 1)), order="F")
    except OSError as error:
        raise MemoryError(f"{rows} x {columns} numbers: {error}") from None


class Divided:
    """Columns by blocks, which a fork takes from the first on; `finish` takes those that are left. See `divided`."""

    def __init__(self, solve: Callable[[slice], None], columns: int, forked: bool, width: int) -> None:
        self._solve = solve
        self._parts = [slice(at, min(at + width, columns)) for at in range(0, columns, width)]
        self._begun, self._done = np.ndarray((2, len(self._parts)), dtype=bool, buffer=mmap(-1, max(2 * len(self._parts), 1)))
        self._one_core = ExitStack()
        self._start = time.monotonic()
        self._fork = 0
        if not forked:
            return
        self._one_core.enter_context(one_thread(True))  # before the fork, which has no threads of BLAS
        held = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))  # Ctrl-C is for this process alone
        try:
            with warnings.catch_warnings(), suppress(OSError):  # OSError: no room for a fork
                warnings.simplefilter("ignore", DeprecationWarning)  # Python warns of threads, and those of BLAS end in a fork
                self._fork = os.fork()
                if not self._fork:
                    self._work_to_the_end()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, held)

    def _work_to_the_end(self) -> None:
        """Runs in the fork: solves all blocks that nobody has begun, and never returns."""
        try:
            gc.disable()  # the parent may still use what the fork would collect: files, other processes
            libc().prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG of Linux: it dies with its parent
            for at in range(len(self._parts)):
                if self._begun[at]:
                    break
                self._take(at)
        finally:
            os._exit(0)

    def _take(self, at: int) -> None:
        self._begun[at] = True
        self._solve(self._parts[at])
        self._done[at] = True

    @property
    def left(self) -> int:
        """How many columns are not solved yet."""
        return sum(part.stop - part.start for part, done in zip(self._parts, self._done, strict=True) if not done)

    def busy(self) -> bool:
        """Whether the fork still works. If it does not, BLAS has all cores again."""
        if self._fork:
            with suppress(ChildProcessError):  # it has ended, and other code has waited for it before
                if os.waitpid(self._fork, os.WNOHANG) == (0, 0):
                    return True
        self._fork = 0
        self._one_core.close()
        return False

    def finish(self) -> None:
        """Solve all columns that are left. The fork is given up if it needs more than as long again, and `PATIENCE` on top."""
        for at in reversed(range(len(self._parts))):
            if self._begun[at]:
                break
            self._take(at)
        now = time.monotonic()
        patience = now + PATIENCE + (now - self._start)
        while self.busy() and time.monotonic() < patience:
            time.sleep(LOOK)
        self.close()
        for at in np.flatnonzero(~self._done):
            self._take(int(at))

    def close(self) -> None:
        """End the fork."""
        if self._fork:
            with suppress(OSError):
                os.kill(self._fork, signal.SIGKILL)
                os.waitpid(self._fork, 0)
        self._fork = 0
        self._one_core.close()


class Process:
    """`call(*things, awaited)` by a new interpreter, whose BLAS has one thread. It ends with this object and with this process.

    `awaited()` waits there for the number that `ask` sends. The result must consist of JSON's types: numbers, booleans, lists.

    Raises
    ------
    OSError, NotEnoughMemoryError
        It cannot be started.
    """

    value: float | None = None  #: the number that `ask` has sent

    def __init__(self, call: Callable[..., Any], things: tuple[Any, ...]) -> None:
        with ExitStack() as stack:
            place = MEMORY if has_room(bytes_of(things, "work beside this process")) else temporary()
            folder = stack.enter_context(task_folder(place))
            store(Path(folder, "task"), (call, things))
            script = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; serve()"
            with environment_of_workers():
                self._process = stack.enter_context(subprocess.Popen(
                    [sys.executable, "-c", script, folder], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL, text=True))
            stack.callback(self._process.kill)
            self._held = stack.pop_all()

    @staticmethod
    def has_room(need: float) -> bool:
        """Whether a core and `need` bytes of memory are free for a process beside this one."""
        if cores() == 1 or not Path(sys.executable or "").name.startswith("python"):
            return False
        return (free := available()) is not None and free >= need

    @classmethod
    def if_room(cls, need: float, things: Callable[[], tuple[Any, ...]]) -> Self | None:
        """The process for the constructor's arguments `things()`, if it has room (`has_room`) and starts; else None."""
        if cls.has_room(need):
            with suppress(OSError, NotEnoughMemoryError):
                return cls(*things())
        return None

    def ask(self, value: float) -> None:
        """Send the number that `awaited` waits for."""
        self.value = value
        self._send(value.hex())

    @property
    def busy(self) -> bool:
        """Whether it has been asked and has not ended."""
        return self.value is not None and self._process.poll() is None

    def answer(self) -> Any:
        """Waits for the result while the process gets all cores, and ends the process. None if it has no result or is stopped.

        Only the first call returns the result.
        """
        asked, self.value = self.value is not None, None
        with self._held:
            if not asked:
                return None
            self._send(str(cores()))
            assert self._process.stdout is not None
            line = poll()
            line.register(self._process.stdout, POLLIN)
            while not line.poll(1000 * PATIENCE):
                if is_stopped(pid := self._process.pid):
                    log.warning("process %d, which works beside this one, is stopped (state T). It is ended, and this process "
                                "does its work", pid)
                    return None
            with suppress(ValueError):
                return json.loads(self._process.stdout.readline())
            log.info("process %d, which worked beside this one, has ended without a result. This process does its work",
                     self._process.pid)
            return None

    def _send(self, line: str) -> None:
        assert self._process.stdin is not None
        with suppress(OSError):  # written at once: what is left in a buffer would be an error when the pipe is closed
            os.write(self._process.stdin.fileno(), f"{line}\n".encode())

    def __del__(self) -> None:
        if hasattr(self, "_held"):
            self._held.close()


def serve() -> None:
    """Runs in the interpreter of a `Process`: calls the function, and prints its result.

    It reads the number that is awaited, then numbers of cores. Its BLAS takes these cores at once, also while PETSc factorises.
    """
    def received() -> Iterator[str]:
        while more := os.read(sys.stdin.fileno(), 100):  # a thread that waits for sys.stdin would not let the process end
            yield from more.decode().split()

    def hurry() -> None:
        for count in lines:
            libraries().limit(limits=int(count))

    def awaited() -> float:
        value = float.fromhex(next(lines, "") or sys.exit())
        Thread(target=hurry, daemon=True).start()
        return value

    lines = received()
    call, things = load(Path(sys.argv[1], "task"))
    print(json.dumps(call(*things, awaited)), flush=True)


def completed(command: Sequence[str], seconds: float) -> subprocess.CompletedProcess[str] | None:
    """The status and the output of a program that has run to its end; None if it took more than `seconds`, and was killed.

    Raises
    ------
    OSError
        It cannot be started.
    """
    try:
        return subprocess.run(list(command), capture_output=True, text=True, check=False, timeout=seconds, errors="replace")
    except subprocess.TimeoutExpired:
        return None
