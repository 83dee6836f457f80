"""Parts are reduced side by side in processes: with the digits of one process, and with what is done kept where one dies."""

from __future__ import annotations

import logging
import os
import pickle
import re
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from shutil import which
from threading import Timer
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from joinedparts import truss

import femsub as fs
from femsub.algebra.factor import SparseFactor
from femsub.algebra.petsc import versions
from femsub.algebra.processes import folders, parts as workers
from femsub.algebra.processes.stored import load, store
from femsub.algebra.processes.system import LAUNCHER, ONE
from femsub.algebra.processes.threads import libraries, one_thread
from femsub.algebra.processes.waiting import is_stopped
from femsub.reduction.method import Method

ROOT = Path(__file__).parent.parent
pytestmark = pytest.mark.filterwarnings("ignore::femsub.checks.PortWarning")


@dataclass(frozen=True)
class Dying(fs.CraigBampton):
    """Kills its process, unless a file is there that says that it has done so before."""

    mark: str = ""

    def statics(self, *given: Any) -> Any:
        if not Path(self.mark).exists():
            Path(self.mark).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().statics(*given)


@dataclass(frozen=True)
class Failing(fs.CraigBampton):
    """Raises an error of the kind given."""

    error: type[Exception] = MemoryError

    def statics(self, *given: Any) -> Any:
        raise self.error("no more")


def system(pieces: int = 3) -> fs.System:
    made = truss(pieces, 16, 4).system()
    assert isinstance(made, fs.System)
    return made


def methods(whole: fs.System) -> dict[str, Method]:
    return {name: fs.CraigBampton(modes) for modes, name in enumerate(whole.parts, 3)}


def assert_same(one: fs.Substructure, other: fs.Substructure) -> None:
    """To the last digit, and read-only."""
    assert isinstance(one, fs.System) and isinstance(other, fs.System) and list(one.parts) == list(other.parts)
    for a, b in zip([one, *one.parts.values()], [other, *other.parts.values()], strict=True):
        for key in ("M", "D", "K", "V"):
            A, B = getattr(a, key, None), getattr(b, key, None)
            if sp.issparse(A):
                assert (A != B).nnz == 0
            elif A is not None:
                assert np.array_equal(A, B) and not B.flags.writeable
        assert repr(a) == repr(b)


@pytest.fixture
def threads() -> Iterator[ThreadPoolExecutor]:
    """An executor that starts no process."""
    with ThreadPoolExecutor(2) as pool:
        yield pool


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where tasks and results are stored."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(folders, "MEMORY", tmp_path)
    return tmp_path


@pytest.mark.slow
def test_two_workers_give_the_digits_of_one(folder: Path) -> None:
    whole = system()
    assert_same(fs.reduce(system(), methods(whole)), fs.reduce(whole, methods(whole), workers=2))
    assert not list(folder.iterdir())


@pytest.mark.slow
def test_a_worker_that_is_killed_is_named_and_the_run_goes_on_from_the_others(folder: Path, tmp_path: Path) -> None:
    whole = system()
    given = methods(whole) | {"t0": Dying(3, mark=str(tmp_path / "mark"))}
    with pytest.raises(fs.WorkerError, match=r"no result for the part 't0'.*methods \| error.done") as caught:
        fs.reduce(whole, given, workers=2)
    error = caught.value
    assert error.part == "t0" and set(error.done) == {"t1", "t2"}
    assert [path.name for path in folder.iterdir()] == ["mark"]
    found = fs.reduce(whole, given | error.done)
    assert found.parts["t1"] is error.done["t1"] and found.parts["t2"] is error.done["t2"]
    assert_same(fs.reduce(system(), methods(whole)), found)


def test_any_executor_will_do_and_gets_no_matrix(threads: ThreadPoolExecutor) -> None:
    sent = []

    class Telling(Executor):
        def submit(self, *given: Any) -> Future[Any]:  # type: ignore[override]
            sent.append(len(pickle.dumps(given)))
            return threads.submit(*given)

    whole = system()
    assert_same(fs.reduce(system(), methods(whole)), fs.reduce(whole, methods(whole), executor=Telling()))
    assert len(sent) == 3 and max(sent) < 1000 < len(pickle.dumps(whole.parts["t0"].K))


def surroundings() -> tuple[set[int], dict[str, str]]:
    """How many threads each BLAS of a process has, and variables that matter."""
    told = {name: value for name, value in os.environ.items() if name in ONE or name == "PMIX_RANK"}
    return {one["num_threads"] for one in libraries().info()}, told


@pytest.mark.slow
def test_a_worker_has_one_thread_of_blas_and_is_no_child_of_mpiexec(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (*ONE, "PMIX_RANK"):
        monkeypatch.setenv(name, "2")
    found = workers.side_by_side(surroundings, {"a": (), "b": ()}, 2)
    assert list(found.values()) == [({1}, ONE)] * 2
    assert all(os.environ[name] == "2" for name in (*ONE, "PMIX_RANK"))


def test_a_worker_of_another_executor_has_one_thread_while_it_works(threads: ThreadPoolExecutor) -> None:
    versions()  # loads PETSc, whose BLAS is then among those whose threads are set
    before = [(library, library.num_threads) for library in libraries().lib_controllers]
    try:
        for library, _ in before:
            library.set_num_threads(2)
        given = libraries().info()  # 1 of a BLAS built without threads, as in the wheel of PETSc
        assert max(one["num_threads"] for one in given) == 2
        assert workers.side_by_side(surroundings, {"a": ()}, executor=threads)["a"][0] == {1}
        assert libraries().info() == given
    finally:
        for library, count in before:
            library.set_num_threads(count)


def test_an_executor_that_is_shut_down_is_told() -> None:
    whole, pool = system(2), ThreadPoolExecutor(1)
    pool.shutdown()
    with pytest.raises(fs.InputError, match="the executor takes no task"):
        fs.reduce(whole, methods(whole), executor=pool)


def test_what_is_stored_comes_back_as_a_map_of_the_file(tmp_path: Path) -> None:
    part = system().parts["t1"]
    thing = {"part": part, "none": np.zeros((0, 3)), "column": np.asfortranarray(np.arange(6.0).reshape(3, 2)), "word": "x"}
    store(tmp_path / "file", thing)
    before = {path: path.read_bytes() for path in (tmp_path / "file").iterdir()}
    found = load(tmp_path / "file")
    assert found["word"] == "x" and found["none"].shape == (0, 3) and found["column"].flags.f_contiguous
    np.testing.assert_array_equal(found["column"], thing["column"])
    assert (found["part"].K != part.K).nnz == 0 and not found["part"].K.data.flags.owndata
    assert found["part"].K.data.ctypes.data % 16 == 0
    found["column"][0, 0] = 7.0
    assert {path: path.read_bytes() for path in (tmp_path / "file").iterdir()} == before


def test_what_needs_a_factor_later_makes_it_again(threads: ThreadPoolExecutor) -> None:
    whole = system()
    reduced = fs.reduce(whole, methods(whole), executor=threads)
    modes = fs.complex_modes(reduced, count=4)
    made = SparseFactor.made
    refined = fs.refine(whole, modes, reduced)
    assert SparseFactor.made > made
    alone = fs.reduce(system(), methods(whole))
    expected = fs.refine(system(), fs.complex_modes(alone, count=4), alone)
    np.testing.assert_allclose(refined.modes.eigenvalues, expected.modes.eigenvalues, rtol=1e-10)


@pytest.mark.parametrize("band", [None, (0.0, 1.0)])
def test_a_sweep_takes_workers(threads: ThreadPoolExecutor, band: tuple[float, float] | None) -> None:
    model, slopes = fs.chain(60, belt=3), np.linspace(-0.2, 0.01, 5)
    belt = fs.Belt(slope=0.0)
    alone = fs.sweep(model, belt, "slope", slopes, band=band)
    shared = fs.sweep(model, belt, "slope", slopes, band=band, executor=threads)
    assert np.array_equal(alone.values, shared.values) and np.array_equal(alone.growth, shared.growth)
    assert np.array_equal(alone.omega, shared.omega) and alone.band == shared.band


@pytest.mark.slow
def test_a_sparse_sweep_by_two_processes_has_the_digits_of_one() -> None:
    model, slopes = fs.chain(2400, belt=2), np.linspace(-0.04, -0.02, 5)
    versions()  # loads PETSc, whose BLAS is then among those that are held to one thread, as in the workers
    with one_thread(True):
        alone = fs.sweep(model, fs.Belt(slope=0.0), "slope", slopes, band=(0.0, 0.05))
    shared = fs.sweep(model, fs.Belt(slope=0.0), "slope", slopes, band=(0.0, 0.05), workers=2)
    assert np.array_equal(alone.growth, shared.growth) and np.array_equal(alone.omega, shared.omega)


def test_warnings_of_workers_are_repeated(threads: ThreadPoolExecutor) -> None:
    whole = system(2)
    for given in ({"workers": 1}, {"executor": threads}):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            fs.reduce(whole, methods(whole), **given)  # type: ignore[call-overload]
        assert sorted(str(one.message)[:20] for one in told) == ["port 'belt' of 't0':", "port 'belt' of 't1':"]


@pytest.mark.parametrize("error", [MemoryError, fs.NotEnoughMemoryError])
def test_a_worker_without_memory_is_named(threads: ThreadPoolExecutor, error: type[Exception]) -> None:
    whole = system()
    with pytest.raises(fs.WorkerError, match=r"'t1'.*ran out of memory.*2 of 3") as caught:
        fs.reduce(whole, methods(whole) | {"t1": Failing(3, error=error)}, executor=threads)
    assert caught.value.part == "t1" and isinstance(caught.value.__cause__, error)


@pytest.mark.parametrize("error", [fs.NotConvergedError, KeyError])
def test_an_error_of_a_part_is_the_one_that_it_is_without_workers(threads: ThreadPoolExecutor, error: type[Exception]) -> None:
    whole = system()
    given = methods(whole) | {"t1": Failing(3, error=error)}
    for options in ({}, {"executor": threads}):
        with pytest.raises(error, match="no more") as caught:
            fs.reduce(whole, given, **options)  # type: ignore[call-overload]
    assert caught.value.__notes__ == ["in the worker of the part 't1'"]


def test_a_worker_that_does_not_see_the_files_is_told(threads: ThreadPoolExecutor, monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(path: Path) -> Any:
        raise FileNotFoundError

    whole = system(2)
    monkeypatch.setattr(workers, "load", gone)
    with pytest.raises(fs.WorkerError, match=r"the worker process failed \(WorkerError: it cannot read .* set TMPDIR"):
        fs.reduce(whole, methods(whole), executor=threads)


def test_a_full_disk_is_told(threads: ThreadPoolExecutor, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> Any:
        raise OSError(28, "No space left on device")

    whole = system(2)
    monkeypatch.setattr("numpy.save", full)
    with pytest.raises(fs.NotEnoughMemoryError, match=r"No space left on device.*TMPDIR"):
        fs.reduce(whole, methods(whole), executor=threads)


@pytest.mark.parametrize(("free", "place", "in_memory"), [(1e9, "", True), (1e9, "/tmp", False), (1e3, "", False)])
def test_files_are_in_memory_where_it_has_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: float, place: str,
                                               in_memory: bool) -> None:
    monkeypatch.setattr(folders, "MEMORY", tmp_path)
    monkeypatch.setenv("TMPDIR", place)
    monkeypatch.setattr(folders.shutil, "disk_usage", lambda _: SimpleNamespace(free=free))
    assert folders.has_room(1000) is in_memory
    monkeypatch.setattr(folders, "MEMORY", tmp_path / "none")
    assert not folders.has_room(1000)


def test_what_a_killed_run_left_in_memory_is_removed(tmp_path: Path) -> None:
    left, foreign = tmp_path / "femsub-left", tmp_path / "femsub-foreign"
    for folder in (left, foreign):
        folder.mkdir()
        (folder / "0.result").write_bytes(b"x")
    (left / folders.ALIVE).touch()
    with folders.task_folder(tmp_path) as first:
        assert not left.exists() and foreign.exists()
        with folders.task_folder(tmp_path) as second:
            assert Path(first, folders.ALIVE).exists() and first != second
    assert list(tmp_path.iterdir()) == [foreign]


def stopping(folder: str, which: str) -> str:
    """`which` stops: the process itself, or that of the task before, which has ended."""
    path = Path(folder, "pids")
    with path.open("a") as file:
        file.write(f"{os.getpid()}\n")
    if which == "other":
        until(lambda: len(path.read_text().split()) == 2)
        until(lambda: not [*Path(folder).glob("femsub-*/0")])  # its result is taken
    if which:
        (own, *others) = sorted(map(int, path.read_text().split()), key=lambda pid: pid != os.getpid())
        os.kill(own if which == "self" else others[0], signal.SIGSTOP)
    return which


def continued(folder: Path) -> Timer:
    """After a while stopped processes go on, or a test would wait for ever."""
    late = Timer(40.0, lambda: [os.kill(pid, signal.SIGCONT) for pid in stopped_processes(folder)])
    late.start()
    return late


def stopped_processes(folder: Path) -> list[int]:
    return [pid for pid in map(int, (folder / "pids").read_text().split()) if is_stopped(pid)]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc")
@pytest.mark.parametrize("sent", [signal.SIGCONT, signal.SIGKILL])
def test_a_worker_that_is_stopped_is_named_and_what_is_advised_works(sent: signal.Signals, tmp_path: Path,
                                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("femsub.algebra.processes.waiting.PATIENCE", 0.2)
    said: list[str] = []

    class Advised(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            said.append(record.getMessage())
            command = re.search(rf"`kill -{sent.name[3:]} (\d+)`", said[-1])
            assert command is not None
            os.kill(int(command[1]), sent)

    late = continued(tmp_path)
    log, handler = logging.getLogger("femsub.algebra.processes.waiting"), Advised()
    log.addHandler(handler)
    try:
        tasks = {"a": (str(tmp_path), "self"), "b": (str(tmp_path), "")}
        if sent == signal.SIGCONT:
            assert workers.side_by_side(stopping, tasks, 2) == {"a": "self", "b": ""}
        else:
            with pytest.raises(fs.WorkerError, match="no result for the part 'a'") as caught:
                workers.side_by_side(stopping, tasks, 2)
            assert caught.value.done == {"b": ""}
    finally:
        log.removeHandler(handler)
        late.cancel()
    assert len(said) == 1 and re.match(r"the part 'a' waits: process \d+ is stopped \(state T\)", said[0])


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc")
def test_an_idle_worker_that_is_stopped_is_not_waited_for(folder: Path) -> None:
    late = continued(folder)
    assert workers.side_by_side(stopping, {"a": (str(folder), ""), "b": (str(folder), "other")}, 2) == {"a": "", "b": "other"}
    assert late.is_alive(), "it waited for the timer"
    late.cancel()
    assert not stopped_processes(folder)


def no_room(*_: Any, **__: Any) -> Any:
    raise OSError(28, "No space left on device")


@pytest.mark.parametrize(("what", "words"), [
    ("tempfile.mkdtemp", "cannot take the files of one call .No space left.*TMPDIR"),
    ("multiprocessing.synchronize.SemLock.__init__", "/dev/shm cannot take the semaphores of worker processes"),
    ("tempfile.gettempdir", "no folder takes temporary files .No space left.*TMPDIR")])
def test_a_folder_without_room_for_the_least_is_named(what: str, words: str, folder: Path,
                                                      monkeypatch: pytest.MonkeyPatch) -> None:
    if what == "tempfile.gettempdir":
        monkeypatch.setattr("femsub.checks.gettempdir", no_room)
        monkeypatch.setattr(folders, "MEMORY", folder / "none")
    else:
        monkeypatch.setattr(what, no_room)
    with pytest.raises(fs.NotEnoughMemoryError, match=words):
        workers.side_by_side(stopping, {"a": (str(folder), ""), "b": (str(folder), "")}, 2)
    assert not list(folder.iterdir())


def test_a_bit_of_what_is_stored_that_turned_is_seen(tmp_path: Path) -> None:
    written = store(tmp_path / "one", {"A": np.arange(4.0), "b": 1.5})
    content = bytearray((written / "pickle").read_bytes())
    for at in range(len(content)):
        content[at] ^= 1
        (written / "pickle").write_bytes(content)
        with pytest.raises(fs.InputError, match="one/pickle is damaged"):
            load(written)
        content[at] ^= 1


class Untouched(Executor):
    """Fails where anything is submitted."""

    def submit(self, *_: Any) -> Future[Any]:  # type: ignore[override]
        raise AssertionError("this was to be told beforehand")


def test_what_cannot_be_pickled_is_told_beforehand() -> None:
    @dataclass(frozen=True)
    class Local(fs.CraigBampton):
        pass

    whole = system()
    with pytest.raises(fs.InputError, match=r"the part 't2' cannot be sent to a worker.*top level"):
        fs.reduce(whole, methods(whole) | {"t2": Local(3)}, executor=Untouched())


@pytest.mark.parametrize(("given", "kind", "words"), [
    ({"workers": 0}, fs.InputError, "workers must be at least 1"),
    ({"workers": -1}, fs.InputError, "workers must be at least 1"),
    ({"workers": "two"}, fs.InputTypeError, "workers must be a whole number"),
    ({"workers": True}, fs.InputTypeError, "workers must be a whole number"),
    ({"workers": 10**9}, fs.InputError, "at most"),
    ({"workers": 2, "executor": Untouched()}, fs.InputError, "exclude each other"),
    ({"executor": 2}, fs.InputTypeError, "executor must be"),
    ({"executor": ThreadPoolExecutor}, fs.InputTypeError, "executor must be"),
    ({"executor": type("Client", (), {"submit": print, "get_executor": print})()}, fs.InputTypeError, "client.get_executor"),
])
def test_workers_that_are_none(given: dict[str, Any], kind: type[Exception], words: str) -> None:
    whole = system(2)
    with pytest.raises(kind, match=words):
        fs.reduce(whole, methods(whole), **given)


def test_workers_of_a_sweep_that_are_none() -> None:
    with pytest.raises(fs.InputError, match="workers must be at least 1"):
        fs.sweep(fs.chain(10, belt=2), fs.Belt(slope=0.0), "slope", [-0.1], workers=0)


def test_workers_are_for_the_parts_of_a_system() -> None:
    with pytest.raises(fs.InputError, match="for the parts of a system"):
        fs.reduce(fs.chain(10), fs.CraigBampton(3), workers=2)  # type: ignore[call-overload]


def test_bad_methods_are_told_beforehand() -> None:
    whole = system()
    with pytest.raises(fs.InputTypeError, match="unknown method"):
        fs.reduce(whole, methods(whole) | {"t1": 3}, executor=Untouched())  # type: ignore[call-overload]


def test_parts_that_do_not_fit_side_by_side_are_told_beforehand(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, made = system(), SparseFactor.made
    monkeypatch.setattr(workers, "at_hand", lambda need: workers.BASE)
    monkeypatch.setattr(sys.modules["femsub.reduction.reduce"], "LARGE", 100)  # the function hides the module
    with pytest.warns(fs.FemsubWarning, match=r"only 1 of 2 workers run: 2 parts side by side need about 0.6\d* GB"):
        found = fs.reduce(whole, methods(whole), workers=2)
    assert SparseFactor.made > made  # in this process
    assert_same(fs.reduce(whole, methods(whole)), found)


@pytest.mark.parametrize(("free", "fits"), [(1e12, 3), (9e9, 2), (8.3e9, 1), (1.0, 1), (None, 3)])
def test_as_many_workers_run_as_fit(monkeypatch: pytest.MonkeyPatch, free: float | None, fits: int) -> None:
    monkeypatch.setattr(workers, "at_hand", lambda need: free)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.FemsubWarning)
        assert workers.fitting({"a": 1e9, "b": 5e9, "c": 3e9, "d": 1e9}, 3, "part") == fits


def twins() -> fs.System:
    """A disc between two equal pads, which have names and places of their own."""
    pads = {name: fs.chain(12, interface=[12], damping=0.1, belt=2) for name in ("left", "right")}
    pads = {name: fs.Substructure(pad.M, pad.K, pad.D, {"face": [11]}, pad.ports, name,
                                  fs.DofMap(np.arange(12), np.zeros(12, int), points=np.full((12, 1), float(i))))
            for i, (name, pad) in enumerate(pads.items())}
    disc = fs.chain(9, interface=[1, 9], fixed=False)
    return fs.couple({**pads, "disc": disc}, [fs.Rigid(("left", [11]), ("disc", [0])), fs.Rigid(("right", [11]), ("disc", [8]))])


@pytest.mark.slow
def test_a_pool_of_forks_is_refused_with_its_remedy() -> None:
    """Children forked behind a factorisation would hang in PETSc for ever. A pool that spawns is taken."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    whole = system(2)
    fs.normal_modes(fs.chain(300), count=2)
    with ProcessPoolExecutor(1, mp_context=get_context("fork")) as pool, \
            pytest.raises(fs.InputError, match=r"mp_context=multiprocessing\.get_context\('spawn'\)"):
        fs.reduce(whole, methods(whole), executor=pool)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        assert fs.reduce(whole, methods(whole), executor=pool).size == fs.reduce(whole, methods(whole)).size


@pytest.mark.parametrize("side", [True, False])
def test_equal_parts_are_reduced_once(side: bool, threads: ThreadPoolExecutor, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    statics = fs.CraigBampton.statics
    monkeypatch.setattr(fs.CraigBampton, "statics", lambda self, part, *rest: (seen.append(part.sub.name),
                                                                              statics(self, part, *rest))[1])
    whole = twins()
    found = fs.reduce(whole, dict.fromkeys(whole.parts, fs.CraigBampton(4)), executor=threads if side else None)
    assert len(seen) == 2 and len({*seen} & {"left", "right"}) == 1
    left, right = found.parts["left"], found.parts["right"]
    alone = fs.reduce(twins().parts["right"], fs.CraigBampton(4))
    assert isinstance(left, fs.ReducedSubstructure) and isinstance(right, fs.ReducedSubstructure)
    assert right.V is left.V and np.array_equal(right.V, alone.V) and right.name == "right"
    assert right.full_dofs is whole.parts["right"].dofs and right.interface_dofs.points == 1.0
    assert list(right.sets) == ["face"]
    seen.clear()
    fs.reduce(whole, {"left": fs.CraigBampton(4), "right": fs.CraigBampton(3)})
    assert len(seen) == 2


def test_parts_of_other_matrices_or_ports_are_not_equal() -> None:
    whole = twins()
    left = whole.parts["left"]
    stiffer = fs.Substructure(left.M, left.K * (1 + 1e-15), left.D, left.interface, left.ports)
    other_port = fs.Substructure(left.M, left.K, left.D, left.interface, {"belt": left.port("belt")[::-1]})
    for other in (stiffer, other_port, fs.Substructure(left.M, left.K.toarray(), left.D, left.interface, left.ports)):
        found = fs.reduce(whole.with_parts({"right": other}), dict.fromkeys(("left", "right"), fs.CraigBampton(4)))
        assert found.parts["right"].V is not found.parts["left"].V  # type: ignore[attr-defined]


def test_a_model_of_another_part_is_refused() -> None:
    whole = system()
    with pytest.raises(fs.InputError, match=r"the part 't1' has .* DOF, but"):
        fs.reduce(whole, methods(whole) | {"t1": fs.reduce(fs.chain(5), fs.CraigBampton(2))})


SCRIPT = """
import sys, time
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
import femsub as fs
from tests.joinedparts import truss

@dataclass(frozen=True)
class Slow(fs.CraigBampton):
    mark: str = ""

    def statics(self, *given):
        import os
        Path(self.mark, f"{os.getpid()}.pid").touch()
        time.sleep(600)

def main():
    system, slow = truss(3, 16, 4).system(), Slow(3, mark=sys.argv[1])
    fs.reduce(system, {"t0": slow, "t1": slow, "t2": fs.CraigBampton(3)}, workers=3)

"""
GUARD = 'if __name__ == "__main__":\n    main()\n'


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def environment(folder: Path) -> dict[str, str]:
    clean = {name: value for name, value in os.environ.items() if not name.startswith(LAUNCHER)}
    return {**clean, "TMPDIR": str(folder), "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}


@pytest.mark.slow
@pytest.mark.sampled(99)
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc")
@pytest.mark.parametrize(("sent", "to_all"), [(signal.SIGINT, False), (signal.SIGINT, True), (signal.SIGKILL, False),
                                              (signal.SIGTERM, False), (signal.SIGTERM, True)])
def test_workers_end_with_their_parent_and_leave_no_file(tmp_path: Path, sent: signal.Signals, to_all: bool) -> None:
    script, marks, place = tmp_path / "script.py", tmp_path / "marks", tmp_path / "place"
    marks.mkdir()
    place.mkdir()
    script.write_text(SCRIPT + GUARD)
    # tests that run in the background of a shell ignore SIGINT, and hand that on
    parent = subprocess.Popen([sys.executable, script, marks], env=environment(place), stderr=subprocess.PIPE, text=True,
                              start_new_session=True, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    until(lambda: len(list(marks.iterdir())) == 2 and list(place.glob("femsub-*/*.result")))  # the third worker is idle
    pids = [int(path.stem) for path in marks.iterdir()]
    assert all(map(alive, pids))
    (os.killpg if to_all else os.kill)(parent.pid, sent)
    said = parent.communicate(timeout=60)[1]
    assert parent.returncode != 0 and said.count("KeyboardInterrupt") == (sent == signal.SIGINT), said
    until(lambda: not any(map(alive, pids)))
    until(lambda: not list(place.glob("femsub-*")))


def until(come: Any, seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not come():
        assert time.monotonic() < end, "it did not come to this"
        time.sleep(0.02)


HOLDING = """
import ctypes, os, sys, time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from femsub.algebra import side_by_side

def held(folder):
    Path(folder, f"{os.getpid()}.pid").touch()
    ctypes.PyDLL(None).sleep(600)  # holds Python's lock, so that no thread of Python runs beside it

def main():
    if "while it tidies" in sys.argv:
        ProcessPoolExecutor.shutdown = lambda *_, **__: os.kill(os.getpid(), 9)
    side_by_side(partial(held, sys.argv[1]), {"a": (), "b": ()}, 2)

"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc")
@pytest.mark.parametrize("dies", ["at once", "while it tidies"])
def test_a_worker_that_holds_the_lock_of_python_ends_with_its_parent(tmp_path: Path, dies: str) -> None:
    script, marks, place = tmp_path / "script.py", tmp_path / "marks", tmp_path / "place"
    marks.mkdir()
    place.mkdir()
    script.write_text(HOLDING + GUARD)
    parent = subprocess.Popen([sys.executable, script, marks, dies], env=environment(place), start_new_session=True,
                              preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    pids: list[int] = []
    try:
        until(lambda: len(list(marks.iterdir())) == 2)
        pids = [int(path.stem) for path in marks.iterdir()]
        if dies == "at once":
            parent.kill()
        else:
            os.killpg(parent.pid, signal.SIGINT)  # the workers leave it to their parent
        parent.wait()
        until(lambda: not any(map(alive, pids)))
        until(lambda: not list(place.glob("femsub-*")))
    finally:
        for pid in filter(alive, pids):
            os.kill(pid, signal.SIGKILL)


LEAVING = """
import sys
from concurrent.futures import ThreadPoolExecutor
from femsub.algebra import side_by_side
from pathlib import Path
import os, signal

def die():
    os.kill(os.getpid(), signal.SIGKILL)

side_by_side(die, {"a": ()}, executor=ThreadPoolExecutor(1))
"""


def test_what_a_killed_process_left_for_an_executor_is_removed_by_the_next(tmp_path: Path, threads: ThreadPoolExecutor,
                                                                          monkeypatch: pytest.MonkeyPatch) -> None:
    place, foreign, elsewhere = tmp_path / "place", tmp_path / "place" / "femsub-thesis", tmp_path / "elsewhere"
    foreign.mkdir(parents=True)
    (foreign / "thesis.txt").touch()
    elsewhere.mkdir()
    (elsewhere / folders.ALIVE).touch()
    (place / "femsub-link").symlink_to(elsewhere)
    subprocess.run([sys.executable, "-c", LEAVING], env=environment(place), check=False)
    (left,) = set(place.glob("femsub-*")) - {foreign, place / "femsub-link"}
    assert (left / "call").exists()
    monkeypatch.setattr("tempfile.tempdir", str(place))
    whole = system(2)
    fs.reduce(whole, methods(whole), executor=threads)
    assert not left.exists() and (foreign / "thesis.txt").exists() and (elsewhere / folders.ALIVE).exists()


DAEMON = """
from multiprocessing import get_context
import femsub as fs
from tests.joinedparts import truss

def work(_):
    try:
        system = truss(2, 16, 4).system()
        fs.reduce(system, {name: fs.CraigBampton(3) for name in system.parts}, workers=2)
    except fs.InputError as error:
        return str(error)

def main():
    with get_context("spawn").Pool(1) as pool:
        print(pool.map(work, [0])[0])

"""


@pytest.mark.slow
def test_a_process_that_may_start_none_says_so(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(DAEMON + GUARD)
    done = subprocess.run([sys.executable, tmp_path / "script.py"], env=environment(tmp_path), capture_output=True, text=True,
                          timeout=100, check=True)
    assert "daemonic process" in done.stdout and "ProcessPoolExecutor" in done.stdout


LIMITED = """
import resource, sys
import scipy.sparse as sp
import femsub as fs
from femsub.algebra import factorise
from femsub.algebra.petsc import versions
from femsub.algebra.processes.memory import available
versions()
side = fs.block((1.0, 1.0, 1.0), (12, 12, 12), "hexahedron")
part = fs.solid(side, fs.Material(2e11, 0.3, 7850.0), interface=['left'])
pages = int(open("/proc/self/statm").read().split()[0])
limit = pages * resource.getpagesize() + 150_000_000
resource.setrlimit(resource.{which}, (limit, limit))
assert available() < 2e8
try:
    fs.reduce(part, fs.Guyan())
except fs.NotEnoughMemoryError as error:
    print(error)
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads /proc")
def test_a_limit_of_memory_is_an_error_before_the_factorisation_and_no_hang(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", LIMITED.format(which="RLIMIT_AS")],
                          env=environment(tmp_path), capture_output=True, text=True, timeout=100, check=True)
    assert "ulimit -v" in done.stdout and "GB" in done.stdout, done


@pytest.mark.slow
def test_a_script_without_a_guard_is_told_what_it_lacks(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT + "main()\n")
    done = subprocess.run([sys.executable, script, tmp_path], env=environment(tmp_path), capture_output=True, text=True,
                          timeout=60, check=False)
    assert done.returncode == 1 and "InputError: the worker processes ended before they began" in done.stderr
    assert 'if __name__ == "__main__":' in done.stderr and not list(tmp_path.glob("femsub-*"))


EXECUTORS = """
import sys
import numpy as np
import femsub as fs
from tests.joinedparts import truss

def check(executor):
    system = truss(3, 16, 4).system()
    methods = {name: fs.CraigBampton(modes) for modes, name in enumerate(system.parts, 3)}
    found = fs.reduce(system, methods, executor=executor, ports=True)
    alone = fs.reduce(truss(3, 16, 4).system(), methods, ports=True)
    for name in system.parts:
        assert np.array_equal(found.parts[name].V, alone.parts[name].V), name
    assert np.array_equal(fs.normal_modes(found, 4).frequencies, fs.normal_modes(alone, 4).frequencies)
    print("the same")

if __name__ == "__main__":
"""
DASK = """
    from distributed import Client, LocalCluster
    with LocalCluster(n_workers=2, threads_per_worker=2, dashboard_address=None) as cluster, Client(cluster) as client:
        check(client.get_executor())
"""
POOL = """
    from mpi4py.futures import MPIPoolExecutor
    with MPIPoolExecutor() as executor:
        check(executor)
"""
COMMUNICATOR = """
    from mpi4py import MPI
    from mpi4py.futures import MPICommExecutor
    with MPICommExecutor(MPI.COMM_WORLD, root=0) as executor:
        if executor is not None:
            check(executor)
"""
MPIEXEC = ["mpiexec", "-n", "3"]


@pytest.mark.slow
@pytest.mark.parametrize(("package", "before", "body"), [
    ("distributed", [sys.executable], DASK), ("mpi4py", [sys.executable], COMMUNICATOR),
    ("mpi4py", [*MPIEXEC, sys.executable], COMMUNICATOR), ("mpi4py", [*MPIEXEC, sys.executable, "-m", "mpi4py.futures"], POOL)],
    ids=["dask", "one process of MPI", "three processes of MPI", "mpi4py.futures"])
def test_executors_of_others(tmp_path: Path, package: str, before: list[str], body: str) -> None:
    pytest.importorskip(package, reason=f"{package} is not installed: pip install {package}")
    if not which(before[0]):
        pytest.skip("there is no mpiexec")
    script = tmp_path / "script.py"
    script.write_text(EXECUTORS + body)
    root = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "OMPI_MCA_rmaps_base_oversubscribe": "1"}
    done = subprocess.run([*before, str(script)], env=environment(tmp_path) | root, capture_output=True, text=True, timeout=120,
                          check=False)
    assert done.returncode == 0 and "the same" in done.stdout, done.stderr




def test_what_is_stored_may_be_moved_and_what_was_one_array_stays_one(tmp_path: Path) -> None:
    one = np.arange(6.0)
    store(tmp_path / "there", {"a": one, "b": [one], "part": one[:2], "none": np.zeros(0)}).rename(tmp_path / "here")
    found = load(tmp_path / "here")
    assert found["a"] is found["b"][0] and (found["a"] == one).all() and not len(found["none"])
    assert (found["part"] == one[:2]).all()
    found["a"][0] = 7.0  # a copy of the page, not of the file
    assert load(tmp_path / "here")["a"][0] == 0.0
