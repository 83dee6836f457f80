"""Tasks side by side in several processes, on matrices that each process maps from a file instead of getting a copy.

A task is stored as a folder: a pickle, and each array in a file of its own, which a process maps into its memory. So is a result.
An executor passes on only the names of these folders. Hence any executor with the interface of `concurrent.futures` will do.
"""

from __future__ import annotations

import logging
import os
import shutil
import signal
import subprocess
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from errno import ENOSPC
from functools import partial
from importlib import import_module
from multiprocessing import current_process
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any

from femsub.algebra.petsc import versions
from femsub.algebra.processes.cache import at_hand
from femsub.algebra.processes.folders import MEMORY, has_room, task_folder
from femsub.algebra.processes.limits import BASE, LOOK
from femsub.algebra.processes.memory import available
from femsub.algebra.processes.stored import bytes_of, load, store
from femsub.algebra.processes.system import environment_of_workers
from femsub.algebra.processes.threads import BRINGING, one_thread
from femsub.algebra.processes.waiting import first_done, is_stopped
from femsub.checks import (
    FemsubError,
    FemsubWarning,
    InputError,
    InputTypeError,
    WorkerError,
    no_room_error,
    shown,
    temporary,
    warn,
    whole_number,
)

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future, ProcessPoolExecutor

log = logging.getLogger(__name__)

PROCESS = "process"  # a file in a task's folder: the number of the process that has it, and its machine
# A shell with this script reads until the process that started it dies. Then it ends all other processes of its group, removes
# the folder $0, and kills the processes that outlived SIGTERM. A line that it reads is an order to kill at once.
UNDERTAKER = 'trap "" TERM; read _ || { kill 0; sleep 1; }; rm -rf "$0"; kill -9 0'
FORWARDED = FemsubWarning, RuntimeWarning
_lock = RLock()  # PETSc is not safe in threads: a process does one task at a time, also if the executor gives it threads


def check_workers(workers: Any, executor: Any) -> None:
    """Check the arguments `workers` and `executor` of a public function.

    Raises
    ------
    InputError, InputTypeError
        Both are given, `workers` is no whole number from 1 on, or `executor` is no executor.
    """
    if workers is not None:
        whole_number("workers", workers, least=1, most=1024)  # more is a typing error: no machine has so many cores
        if executor is not None:
            raise InputError("workers and executor exclude each other: an executor brings its own processes. Leave one out")
    if hasattr(executor, "get_executor"):
        raise InputTypeError("executor must have the interface of concurrent.futures.Executor. Of a dask client, give "
                             "client.get_executor()")
    if executor is not None and (isinstance(executor, type) or not callable(getattr(executor, "submit", None))):
        raise InputTypeError(f"executor must be a concurrent.futures.Executor, or have its submit, not {shown(executor)}")
    context = getattr(executor, "_mp_context", None)  # of a ProcessPoolExecutor
    if context is not None and context.get_start_method() == "fork":
        raise InputError("executor forks this process, and a fork of a process with PETSc and its threads hangs. Give "
                         "ProcessPoolExecutor(..., mp_context=multiprocessing.get_context('spawn'))")


def side_by_side(call: Callable[..., Any], tasks: Mapping[str, tuple[Any, ...]], workers: int | None = None,
                 executor: Executor | None = None, *, what: str = "part", needs: Mapping[str, float] | None = None,
                 advice: str = "") -> dict[str, Any]:
    """{name: call(*arguments)} of all tasks, in processes side by side; with one worker, in this process.

    Parameters
    ----------
    call : function
        A function at the top level of a module, or a `functools.partial` of one with the arguments that all tasks share. They are
        stored once.
    tasks : mapping of str to tuple
        The arguments by name, in the order in which they begin.
    workers : int, optional
        Number of processes, at most one for each task. They are started for this call, by 'spawn'.
    executor : concurrent.futures.Executor, optional
        Runs the tasks instead. Its processes must see this machine's temporary folder (TMPDIR).
    what : str
        What a task is, for messages.
    needs : mapping of str to float, optional
        Bytes of memory that the tasks need. If they do not fit side by side, fewer processes are started.
    advice : str
        How to go on with the results that exist, for the message of a `WorkerError`.

    Raises
    ------
    WorkerError
        A process died or ran out of memory. It is raised when the other tasks have ended.
    InputError
        Arguments that cannot be pickled, or processes that do not start.
    """
    check_workers(workers, executor)
    count = min(workers or 1, len(tasks))
    if executor is None and count > 1:
        if current_process().daemon:
            raise InputError(f"workers={workers} in a daemonic process, such as one of multiprocessing.Pool: it may start no "
                             "others. Leave workers out here, or take concurrent.futures.ProcessPoolExecutor")
        count = fitting(needs or {}, count, what)
    if executor is None and count < 2:
        return {name: call(*arguments) for name, arguments in tasks.items()}
    sent = sum(bytes_of((call, arguments), f"{what} {name!r}") for name, arguments in tasks.items())
    with task_folder(MEMORY if executor is None and has_room(sent) else temporary()) as folder:
        store(Path(folder, "call"), call)
        results = partial(_results, tasks, Path(folder), what, advice)
        if executor is not None:
            return results([executor] * len(tasks))
        with _processes(folder) as started:
            return results(started(count), started)


def fitting(needs: Mapping[str, float], count: int, what: str) -> int:
    """The number of workers, 1 to `count`, with which the largest tasks fit into memory side by side."""
    sizes = sorted(needs.values(), reverse=True)
    sums = [sum(sizes[:several]) + several * BASE for several in range(1, count + 1)]
    free = at_hand(sums[-1])
    if free is None or sums[-1] <= free:
        return count
    fits = max(1, sum(need <= free for need in sums))
    warn(f"only {fits} of {count} workers run: {count} {what}s side by side need about {sums[-1] / 1e9:.3g} GB, but only "
         f"{free / 1e9:.3g} GB are available")
    return fits


def _results(tasks: Mapping[str, tuple[Any, ...]], folder: Path, what: str, advice: str, free: list[Executor],
             restart: Callable[[int], list[Executor]] | None = None) -> dict[str, Any]:
    """Give each free executor a task until all are done; `restart` replaces one whose process has died."""
    from concurrent.futures import BrokenExecutor

    def at_work() -> dict[int, str]:
        """The processes of this machine that have a task now."""
        found = {}
        for name, _, path in running.values():
            with suppress(OSError):  # the task waits for a process
                number, machine = (path / PROCESS).read_text(encoding="utf-8").split()
                if machine == os.uname().nodename:
                    found[int(number)] = f"the {what} {name!r}"
        return found

    waiting = list(enumerate(tasks))
    running: dict[Future[None], tuple[str, Executor, Path]] = {}
    done: dict[str, Any] = {}
    lost: dict[str, Exception] = {}
    warned: list[Warning] = []
    stopped: set[int] = set()
    try:
        while waiting or running:
            while waiting and free:
                (number, name), lane = waiting.pop(0), free.pop()
                path = store(folder / str(number), tasks[name])
                try:
                    running[lane.submit(_run, str(path), f"{what} {name!r}")] = name, lane, path
                except BrokenExecutor as error:
                    lost[name] = error
                except RuntimeError as error:
                    raise InputError(f"the executor takes no task: {error}") from error
            for future in first_done(running, at_work, stopped):
                name, lane, path = running.pop(future)
                next_lane = [lane]
                try:
                    future.result()
                    done[name], warnings_of_task = load(_result(path))
                except BrokenExecutor as error:
                    lost[name] = error
                    next_lane = restart(1) if restart and waiting else []
                except Exception as error:
                    of_task = any(note.startswith("in the worker") for note in getattr(error, "__notes__", ()))
                    if of_task and not isinstance(error, MemoryError):
                        raise  # as it would be without workers
                    lost[name] = error
                else:
                    warned += warnings_of_task
                    log.info("%s %r is done, %d of %d: %r", what, name, len(done), len(tasks), done[name])
                shutil.rmtree(path)
                free += next_lane
    finally:
        for future in running:
            future.cancel()
    for warning in warned:
        warn(warning)
    if not lost:
        return done
    cause = next(iter(lost.values()))
    which = f"the {what}{'s' * (len(lost) > 1)} {', '.join(map(repr, lost))}"
    why = "ran out of memory" if isinstance(cause, MemoryError) else \
        "ended, killed or out of memory" if isinstance(cause, BrokenExecutor) else "failed"
    raise WorkerError(f"no result for {which}: the worker process {why} ({type(cause).__name__}: {cause}). The results of the "
                      f"other {len(done)} of {len(tasks)} are in this error's .done. {advice}", next(iter(lost)), done) from cause


@contextmanager
def _processes(folder: str) -> Iterator[Callable[[int], list[Executor]]]:
    """A function that starts worker processes, each as an executor of its own: if one dies, its task is known.

    They start by 'spawn', since a fork of a process with PETSc, MPI and threads is not safe. The workers join the process group
    of a shell. So Ctrl-C reaches this process alone, and one signal ends all workers. The shell sends it if the block ends by an
    error or Ctrl-C, or if this process dies. The signal also ends a worker that is stuck in code that holds Python's lock.
    """
    from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
    from multiprocessing import connection, get_context

    pools: list[ProcessPoolExecutor] = []
    shell = subprocess.Popen(["/bin/sh", "-c", UNDERTAKER, folder], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL,
                             stderr=subprocess.DEVNULL, process_group=0, text=True)

    def numbers(of: Sequence[ProcessPoolExecutor]) -> list[int]:
        return [pid for pool in of for pid in pool._processes or ()]

    def started(count: int) -> list[Executor]:
        new: list[ProcessPoolExecutor] = []
        try:
            for _ in range(count):
                pools.append(ProcessPoolExecutor(1, get_context("spawn"), os.setpgid, (0, shell.pid)))
                new.append(pools[-1])
            with environment_of_workers():
                begun, stopped = {pool.submit(os.getpid) for pool in new}, set[int]()
                while begun:
                    ended = first_done(begun, lambda: dict.fromkeys(numbers(new), "a worker that begins"), stopped,
                                       "and this call ends with an error")
                    begun -= {future for future in ended if future.result()}
        except OSError as error:
            if error.errno != ENOSPC:
                raise
            raise no_room_error(MEMORY, "the semaphores of worker processes", 0.0, error.strerror or error,
                                "Make room there, or leave workers out") from None
        except BrokenExecutor:
            raise InputError("the worker processes ended before they began; their own message is above. A script that uses "
                             'workers must begin its work under `if __name__ == "__main__":`, since each worker imports the '
                             "script") from None
        return [*new]

    try:
        yield started
    except BaseException:
        try:
            print("now", file=shell.stdin, flush=True)
            if is_stopped(shell.pid):
                raise BrokenPipeError
        except BrokenPipeError:  # somebody has killed the shell, or stopped it
            os.killpg(shell.pid, signal.SIGKILL)
        raise
    finally:
        left = {process.sentinel: process for pool in pools for process in [*(pool._processes or {}).values()]}
        for pool in pools:
            pool.shutdown(wait=False, cancel_futures=True)
        while left:  # a stopped worker has no task, and would be waited for
            for ended in connection.wait([*left], LOOK):
                del left[int(str(ended))]
            for process in left.values():
                if process.pid is not None and is_stopped(process.pid):
                    process.kill()
        shell.kill()
        shell.communicate()


def _run(path: str, name: str) -> None:
    """Does one task, in a worker, and stores the result and the warnings to be repeated beside it."""
    with suppress(OSError):  # a full disk: then nobody sees that this process is stopped
        Path(path, PROCESS).write_text(f"{os.getpid()} {os.uname().nodename}", encoding="utf-8")
    with _lock:
        for module in BRINGING[:3]:  # a BLAS that is loaded within the task would take all cores
            import_module(module)
        with suppress(FemsubError):
            versions()  # loads PETSc
        try:
            call, arguments = load(Path(path).parent / "call"), load(Path(path))
        except FileNotFoundError:
            raise WorkerError(f"it cannot read {path}. All workers must see the temporary folder: set TMPDIR to one that all "
                              "machines share") from None
        if (free := available()) is not None and free < BASE / 4:
            raise MemoryError(f"only {free / 1e6:.0f} MB are left: BLAS may wait for memory for ever")
        try:
            with one_thread(True), warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                result = call(*arguments)
            store(_result(Path(path)), (result, [one.message for one in caught if issubclass(one.category, FORWARDED)]))
        except Exception as error:
            error.add_note(f"in the worker of the {name}")
            raise


def _result(path: Path) -> Path:
    return path.with_suffix(".result")
