"""Tasks side by side in several processes, on matrices that each process maps from a file instead of getting a copy.

A task is a file: its pickle, and its arrays apart (pickle protocol 5, PEP 574), which a process maps into its memory. So is a
result. An executor passes on the names of these files alone. Hence any with the interface of `concurrent.futures` will do.
"""

from __future__ import annotations

import logging
import mmap
import os
import pickle
import shutil
import signal
import subprocess
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import import_module
from multiprocessing import current_process
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from threading import RLock, Thread
from typing import TYPE_CHECKING, Any

from femsub.algebra.memory import at_hand
from femsub.algebra.petsc import versions
from femsub.algebra.process_memory import available
from femsub.algebra.threads import BRINGING, one_thread
from femsub.checks import shown, whole_number
from femsub.errors import FemsubError, FemsubWarning, InputError, InputTypeError, NotEnoughMemoryError, WorkerError, warn

if TYPE_CHECKING:
    from concurrent.futures import Executor, ProcessPoolExecutor

log = logging.getLogger(__name__)

MOST = 1024  # processes of one call
ALIGNED = 64  # bytes; where arrays begin in a file
BASE = 2e8  # bytes that a process takes before its first task
ONE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # environment of a worker
LAUNCHER = ("OMPI_", "PMIX_", "PMI_")  # variables of mpiexec, by which MPI would take a worker for the process that started it
MEMORY = Path("/dev/shm")  # a folder in memory; on a disk, files would be written to it as well
ROOM = 10  # times what is sent must be free there, since results come back as well
ALIVE = "alive"  # a file that is locked as long as a run lives
PATIENCE = 5.0  # seconds
FORWARDED = FemsubWarning, RuntimeWarning
_lock = RLock()  # PETSc is not safe in threads: a process does one task at a time, also if the executor gives it threads


def check_workers(workers: Any, executor: Any) -> None:
    """Check the arguments `workers` and `executor` of a public function.

    Raises
    ------
    InputError, InputTypeError
        Both are given, `workers` is no whole number from 1 on, or `executor` is none.
    """
    if workers is not None:
        whole_number("workers", workers, least=1, most=MOST)
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
    """{name: call(*arguments)} of all tasks, in processes side by side; with one worker in this process.

    Parameters
    ----------
    call : function
        At the top level of a module, or a `functools.partial` of such a one with what all tasks share, which is stored once.
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
        How to go on with what is done, for the message of a `WorkerError`.

    Raises
    ------
    WorkerError
        A process died or ran out of memory. It is raised when the other tasks have ended.
    InputError
        Arguments that cannot be pickled, or processes that do not start.
    """
    check_workers(workers, executor)
    count = min(workers or 1, len(tasks))
    if executor is None and count > 1 and current_process().daemon:
        raise InputError(f"workers={workers} in a daemonic process, such as one of multiprocessing.Pool: it may start no others. "
                         "Leave workers out here, or take concurrent.futures.ProcessPoolExecutor")
    if executor is None and count > 1:
        count = fitting(needs or {}, count, what)
    if executor is None and count < 2:
        return {name: call(*arguments) for name, arguments in tasks.items()}
    sent = sum(_bytes((call, arguments), f"{what} {name!r}") for name, arguments in tasks.items())
    with task_folder(MEMORY if executor is None and has_room(sent) else Path(gettempdir())) as folder:
        run = _Run(tasks, Path(folder), what)
        _store(Path(folder, "call"), call)
        if executor is not None:
            return run.results([executor] * len(tasks), None, advice)
        with _processes(folder) as started:
            return run.results(started(count), started, advice)


def fitting(needs: Mapping[str, float], count: int, what: str) -> int:
    """So many workers that the largest tasks fit into memory side by side, `count` at most, and 1 at least."""
    sizes = sorted(needs.values(), reverse=True)
    fits = count
    while fits > 1 and (free := at_hand(sum(sizes[:fits]) + fits * BASE)) is not None and sum(sizes[:fits]) + fits * BASE > free:
        fits -= 1
    if fits < count and free is not None:
        warn(f"only {fits} of {count} workers run: {count} {what}s side by side need about "
             f"{(sum(sizes[:count]) + count * BASE) / 1e9:.3g} GB, but only {free / 1e9:.3g} GB are available",
             FemsubWarning)
    return fits


class _Run:
    """The tasks of one call, and what has become of them."""

    def __init__(self, tasks: Mapping[str, tuple[Any, ...]], folder: Path, what: str) -> None:
        self.tasks, self.folder, self.what = tasks, folder, what
        self.done: dict[str, Any] = {}
        self.lost: dict[str, BaseException] = {}
        self.told: list[Warning] = []

    def results(self, free: list[Executor], restart: Callable[[int], list[Executor]] | None, advice: str) -> dict[str, Any]:
        """Give each free executor a task until all are done; `restart` replaces one whose process has died."""
        from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait

        waiting = list(enumerate(self.tasks))
        running: dict[Future[None], tuple[str, Executor, Path]] = {}
        try:
            while waiting or running:
                while waiting and free:
                    (number, name), lane = waiting.pop(0), free.pop()
                    path = _store(self.folder / str(number), self.tasks[name])
                    try:
                        running[lane.submit(_run, str(path), f"{self.what} {name!r}")] = name, lane, path
                    except BrokenExecutor as error:
                        self.lost[name] = error
                    except RuntimeError as error:
                        raise InputError(f"the executor takes no task: {error}") from error
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    name, lane, path = running.pop(future)
                    self._taken(future, name, path)
                    broken = isinstance(self.lost.get(name), BrokenExecutor)
                    if broken and restart and waiting:
                        free += restart(1)
                    elif not broken:
                        free.append(lane)
        finally:
            for future in running:
                future.cancel()
        for warning in self.told:
            warn(warning)
        if self.lost:
            raise self._error(advice)
        return self.done

    def _taken(self, future: Any, name: str, path: Path) -> None:
        try:
            future.result()
        except MemoryError as error:
            self.lost[name] = error
        except Exception as error:
            if any(note.startswith("in the worker") for note in getattr(error, "__notes__", ())):
                raise  # an error of the task itself, as it would be without workers
            self.lost[name] = error
        else:
            self.done[name], told = load(_result(path))
            self.told += told
            log.info("%s %r is done, %d of %d: %r", self.what, name, len(self.done), len(self.tasks), self.done[name])
        path.unlink(missing_ok=True)

    def _error(self, advice: str) -> WorkerError:
        from concurrent.futures import BrokenExecutor

        names, cause = list(self.lost), next(iter(self.lost.values()))
        which = f"the {self.what} {names[0]!r}" if len(names) == 1 else f"the {self.what}s {', '.join(map(repr, names))}"
        why = "ran out of memory" if isinstance(cause, MemoryError) else \
            "ended, killed or out of memory" if isinstance(cause, BrokenExecutor) else "failed"
        error = WorkerError(f"no result for {which}: the worker process {why} ({type(cause).__name__}: {cause}). The results of "
                            f"the other {len(self.done)} of {len(self.tasks)} are in this error's .done. {advice}", names[0],
                            self.done)
        error.__cause__ = cause
        return error


@contextmanager
def _processes(folder: str) -> Iterator[Callable[[int], list[Executor]]]:
    """A function that starts worker processes, each as an executor of its own: where one dies, its task is known.

    'spawn', since a fork of a process with PETSc, MPI and threads is not safe. If the block ends by an error or Ctrl-C, the
    processes are killed.
    """
    from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
    from multiprocessing import get_context

    pools: dict[ProcessPoolExecutor, int] = {}
    undertaker = _undertaker(folder)

    def started(count: int) -> list[Executor]:
        new = [ProcessPoolExecutor(1, get_context("spawn"), _begin, (folder,)) for _ in range(count)]
        pools.update(dict.fromkeys(new, 0))
        try:
            with _environment():
                pools.update({pool: future.result() for pool, future in [(pool, pool.submit(os.getpid)) for pool in new]})
        except BrokenExecutor:
            raise InputError("the worker processes ended before they began; their own message is above. A script that uses "
                             'workers must begin its work under `if __name__ == "__main__":`, since each worker imports the '
                             "script") from None
        if undertaker is not None and undertaker.stdin is not None:
            with suppress(BrokenPipeError):
                undertaker.stdin.write("".join(f"{pools[pool]}\n" for pool in new))
        return [*new]

    try:
        yield started
    except BaseException:
        for pid in filter(None, pools.values()):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        raise
    finally:
        for pool in pools:
            pool.shutdown(wait=True, cancel_futures=True)
        if undertaker is not None:
            undertaker.kill()
            undertaker.communicate()


def _undertaker(folder: str) -> subprocess.Popen[str] | None:
    """A shell that outlives this process by a few seconds, to kill the workers that it was told and to remove their folder.

    A worker ends with its parent by a thread of its own. That thread waits for ever where other code holds Python's lock, such as
    an OpenBLAS that tries again and again to get memory. The shell reads until this process has died, and asks nobody.
    """
    if not Path("/proc/self/cmdline").exists():
        return None
    script = (f'while read pid; do all="$all $pid"; done; sleep {PATIENCE}; for pid in $all; do '
              'grep -qs multiprocessing /proc/$pid/cmdline && kill -9 $pid; done; rm -rf "$0"')
    with suppress(OSError):
        return subprocess.Popen(["/bin/sh", "-c", script, folder], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL,
                                stderr=subprocess.DEVNULL, text=True, bufsize=1, start_new_session=True)
    return None


@contextmanager
def _environment() -> Iterator[None]:
    """The environment that workers start in."""
    before = dict(os.environ)
    for name in [name for name in before if name.startswith(LAUNCHER)]:
        del os.environ[name]
    os.environ.update(ONE)
    try:
        yield
    finally:
        for name in ONE:
            os.environ.pop(name)
        os.environ.update({name: value for name, value in before.items() if name.startswith((*ONE, *LAUNCHER))})


def _begin(folder: str) -> None:
    """The first thing a worker process does: Ctrl-C is for its parent, and when its parent dies it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: _end_with_parent(folder, PATIENCE))  # its parent may have got one as well
    Thread(target=_end_with_parent, args=(folder, None), daemon=True).start()


def _end_with_parent(folder: str, patience: float | None) -> None:
    """End this process when its parent has died, and remove what it has left; after so many seconds end it in any case."""
    from multiprocessing import parent_process
    from multiprocessing.connection import wait

    parent = parent_process()
    if parent is not None and wait([parent.sentinel], patience):
        shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def _run(path: str, name: str) -> None:
    """One task, in a worker: the result, and the warnings to be repeated, are stored beside it."""
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
            raise MemoryError(f"{free / 1e6:.0f} MB are left, with which a BLAS may wait for ever")
        try:
            with one_thread(True), warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always")
                result = call(*arguments)
            _store(_result(Path(path)), (result, [one.message for one in told if issubclass(one.category, FORWARDED)]))
        except Exception as error:
            error.add_note(f"in the worker of the {name}")
            raise


def _result(path: Path) -> Path:
    return path.with_suffix(".result")


def _bytes(thing: Any, name: str) -> int:
    """What a task's arrays have, if pickle takes the rest."""
    arrays: list[pickle.PickleBuffer] = []
    try:
        pickle.dumps(thing, protocol=5, buffer_callback=arrays.append)
    except Exception as error:
        raise InputError(f"the {name} cannot be sent to a worker, since pickle refuses it: {error}. Define classes (such as a "
                         "method of your own) at the top level of a module") from None
    return sum(array.raw().nbytes for array in arrays)


@contextmanager
def task_folder(place: Path) -> Iterator[str]:
    """A folder for the files of one run, in memory or in the temporary folder.

    Nobody tidies up if all processes are killed at once. So the run locks a file there as long as it lives, and removes the
    user's own folders whose file is not locked any more.
    """
    with TemporaryDirectory(prefix="femsub-", dir=place, ignore_cleanup_errors=True) as folder:
        try:
            from fcntl import LOCK_EX, LOCK_NB, flock
        except ImportError:  # not on Windows
            yield folder
            return
        for left in place.glob(f"femsub-*/{ALIVE}"):
            with suppress(OSError):
                if left.parent.is_symlink() or left.is_symlink() or left.parent.stat().st_uid != os.getuid():
                    continue
                with left.open("ab") as file:
                    flock(file, LOCK_EX | LOCK_NB)
                    shutil.rmtree(left.parent)
        with Path(folder, "new").open("wb") as file:
            with suppress(OSError):  # a file system without locks: nobody else can lock it either
                flock(file, LOCK_EX)
                os.rename(file.name, Path(folder, ALIVE))
            yield folder


def has_room(sent: int) -> bool:
    """Whether the folder in memory will do; a TMPDIR overrules it."""
    return not os.environ.get("TMPDIR") and MEMORY.is_dir() and os.access(MEMORY, os.W_OK | os.X_OK) and \
        shutil.disk_usage(MEMORY).free > ROOM * sent


def _store(path: Path, thing: Any) -> Path:
    """The same as `store`, with an error that tells what to do if there is no room."""
    try:
        return store(path, thing)
    except OSError as error:
        raise NotEnoughMemoryError(f"{path.parent.parent} cannot take what workers share ({error.strerror}). Set TMPDIR to a "
                                   "folder with more room") from None


def store(path: Path, thing: Any) -> Path:
    """Write an object to a file that `load` maps: the length of the pickle's head, the head, and each array's bytes."""
    buffers: list[pickle.PickleBuffer] = []
    body = pickle.dumps(thing, protocol=5, buffer_callback=buffers.append)
    views = [buffer.raw() for buffer in buffers]
    head = pickle.dumps((body, [view.nbytes for view in views]))
    with path.open("wb") as file:
        file.write(len(head).to_bytes(8, "little"))
        file.write(head)
        for view in views:
            file.seek(_next(file.tell()))
            file.write(view)
    return path


def load(path: Path) -> Any:
    """The object of a file by `store`. Its arrays are the file itself, mapped: pages that are written to become copies."""
    with path.open("rb") as file:
        head = file.read(int.from_bytes(file.read(8), "little"))
        body, sizes = pickle.loads(head)
        place, whole = file.tell(), memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY))
    views = []
    for size in sizes:
        place = _next(place)
        views.append(whole[place:place + size])
        place += size
    return pickle.loads(body, buffers=views)


def _next(place: int) -> int:
    return -(-place // ALIGNED) * ALIGNED
