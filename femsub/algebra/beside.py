"""An inertia count, or a test of definiteness, in a process of its own, on the second core, while this process goes on.

It needs a factorisation that nothing else uses. So it can be made while the modes that it proves something of are still sought.
Threads would not do: PETSc is not safe in them. Nor would a fork: CHOLMOD solves in one, but has hung while it made a factor.
"""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from select import POLLIN, poll
from threading import Thread
from typing import TYPE_CHECKING

import scipy.sparse as sp

from femsub.algebra.cache import FACTOR_BYTES
from femsub.algebra.factor import are_definite, inertia
from femsub.algebra.folders import MEMORY, has_room, task_folder
from femsub.algebra.matrices import Difference
from femsub.algebra.memory import BASE, COUNTED, MOST_FILL, SPARE, room_of_count
from femsub.algebra.process_memory import available
from femsub.algebra.stored import load, store
from femsub.algebra.threads import cores, libraries
from femsub.algebra.waiting import LEAST, is_stopped
from femsub.algebra.workers import environment_of_workers
from femsub.checks import Matrix, temporary
from femsub.errors import NotEnoughMemoryError

if TYPE_CHECKING:
    from femsub.algebra.factor import Handle

log = logging.getLogger(__name__)

FILLED, FULL = 4, 20  # nonzeros of a factor for each of K, which most have that have so many per row
INPUT = 0  # the file descriptor of what the process that counts is told
WORTH = 2e7  # nonzeros of the factor from which the count takes much longer than a process takes to start


class _Beside:
    """A process that runs `serve` on two matrices, and ends with this object and with this process."""

    def __init__(self, K: Matrix, M: Matrix, serve: Callable[[], None]) -> None:
        with ExitStack() as stack:
            place = MEMORY if has_room(16 * (K.nnz + M.nnz)) else temporary()
            folder = stack.enter_context(task_folder(place))
            store(Path(folder, "pencil"), (K, M))
            with environment_of_workers():
                name = serve.__name__
                script = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import {name}; {name}()"
                self._process = stack.enter_context(subprocess.Popen(
                    [sys.executable, "-c", script, folder], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL, text=True))
            stack.callback(self._process.kill)
            assert self._process.stdin is not None
            self._stdin = self._process.stdin.fileno()
            self._held = stack.pop_all()

    def _ask(self, value: float) -> None:
        with suppress(OSError):  # written at once: what is left in a buffer would be an error when the pipe is closed
            os.write(self._stdin, f"{value.hex()}\n".encode())

    def _told(self) -> str:
        """The line that it tells, for which this waits; empty if it could not, or is stopped. The process ends."""
        with self._held:
            assert self._process.stdout is not None
            line = poll()
            line.register(self._process.stdout, POLLIN)
            while not line.poll(1000 * LEAST):
                if is_stopped(pid := self._process.pid):
                    log.warning("process %d, which works beside this one, is stopped (state T). It is ended, and this process "
                                "does its work", pid)
                    return ""
            answer = self._process.stdout.readline().strip()
            if not answer:
                log.info("process %d, which worked beside this one, has ended without a result. This process does its work",
                         self._process.pid)
            return answer

    def __del__(self) -> None:
        if hasattr(self, "_held"):
            self._held.close()


def _is_free(need: float) -> bool:
    """Whether there are a core, and so many bytes, for a process beside this one."""
    if cores() == 1 or not Path(sys.executable or "").name.startswith("python"):
        return False
    return (free := available()) is not None and free >= need


class CountBeside(_Beside):
    """The inertia of K - σM by a process that waits for σ, which `ask` tells; `answer` is None if it could not be found."""

    def __init__(self, K: Matrix, M: Matrix) -> None:
        super().__init__(K, M, serve)
        self.value: float | None = None

    @classmethod
    def started(cls, K: Matrix, M: Matrix, nonzeros: float, columns: float) -> CountBeside | None:
        """The process, if a core and the memory are free for it and a factor of so many nonzeros is worth it; else None.

        This process will need so many columns of n numbers meanwhile.
        """
        return cls._where_free(K, M, room_of_count(K, nonzeros) + 8.0 * K.shape[0] * columns) if nonzeros >= WORTH else None

    @classmethod
    def early(cls, K: Matrix, M: Matrix, columns: float) -> CountBeside | None:
        """As `started`, before this process has its factor: it may be any that K is likely to have."""
        if not sp.issparse(K) or K.nnz < max(WORTH / FILLED, FULL * K.shape[0]):
            return None
        return cls._where_free(K, M, MOST_FILL * FACTOR_BYTES * K.nnz + BASE + 8.0 * K.shape[0] * columns)

    @classmethod
    def _where_free(cls, K: Matrix, M: Matrix, need: float) -> CountBeside | None:
        if _is_free(need):
            with suppress(OSError, NotEnoughMemoryError):
                return cls(K, M)
        return None

    def ask(self, value: float) -> None:
        """Begin to count below σ = `value`."""
        self.value = value
        self._ask(value)

    @property
    def busy(self) -> bool:
        """Whether it counts now."""
        return self.value is not None and self._process.poll() is None

    def answer(self) -> int | None:
        """The number of negative eigenvalues of K - σM, told once. It waits for the process, which gets all cores, and ends."""
        asked, self.value = self.value is not None, None
        if not asked:
            self._held.close()
            return None
        with suppress(OSError):
            os.write(self._stdin, f"{cores()}\n".encode())
        return int(told) if (told := self._told()) else None


class SignsBeside(_Beside):
    """Whether dA - D and dA + D are positive definite, by a process that begins at once. A and D are symmetric."""

    def __init__(self, A: Matrix, D: Matrix, d: float) -> None:
        super().__init__(A, D, serve_signs)
        self._ask(d)

    @classmethod
    def started(cls, A: Difference, D: Matrix, d: float, factor: Handle, columns: float) -> SignsBeside | None:
        """The process, if it is worth it and there is room for it and a factor like the one given of A; else None.

        This process will need so many columns of n numbers meanwhile.
        """
        if not sp.issparse(A.K) or factor.bytes < FACTOR_BYTES * WORTH or factor.on_disk:
            return None
        if _is_free(SPARE * factor.bytes + COUNTED * A.K.nnz + BASE + 8.0 * factor.size * columns):
            with suppress(OSError, NotEnoughMemoryError):
                return cls(A.formed(), D, d)
        return None

    def answer(self) -> tuple[bool, bool] | None:
        """Of dA - D and dA + D, told once; None if the process could not find it. It waits for the process, which ends."""
        told = self._told().split()
        return (told[0] == "True", told[1] == "True") if len(told) == 2 else None


def signs(A: Matrix, D: Matrix, d: float) -> tuple[bool, bool]:
    """Whether dA - D and dA + D are positive definite, by Cholesky factors that are not kept."""
    minus, plus = are_definite(sp.csr_array(d * A + sign * D) for sign in (-1, 1))
    return minus, plus


def serve_signs() -> None:
    """What the process of `SignsBeside` does."""
    A, D = load(Path(sys.argv[1], "pencil"))
    print(*signs(A, D, float.fromhex(sys.stdin.readline() or sys.exit())), flush=True)


def serve() -> None:
    """What the process of `CountBeside` does: it finds the order of elimination, waits for σ, counts and tells the number.

    Once it is told how many cores it may have, its BLAS takes them. It is heard while PETSc factorises.
    """
    def heard() -> Iterator[str]:
        while more := os.read(INPUT, 100):  # a thread that waits for sys.stdin would not let the process end
            yield from more.decode().split()

    def hurried() -> None:
        for count in lines:
            libraries().limit(limits=int(count))

    def told() -> float:
        sigma = float.fromhex(next(lines, "") or sys.exit())
        Thread(target=hurried, daemon=True).start()
        return sigma

    lines = heard()
    print(inertia(Difference(*load(Path(sys.argv[1], "pencil"))), told), flush=True)
