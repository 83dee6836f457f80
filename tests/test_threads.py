"""Threads of BLAS are put away for small dense work, and are back afterwards."""

from __future__ import annotations

import ast
import gc
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from threading import Lock

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from femsub.algebra import load, store, times
from femsub.model import Expression

CODE = """
import scipy.linalg
import femsub as fs
from femsub.modes.quadratic import dense
from femsub.algebra.processes import threads

def counts():
    return [one["num_threads"] for one in threads.libraries().info()]

seen = []
solve = dense._solved
dense._solved = lambda pencil: (seen.append(counts()), solve(pencil))[1]
before = counts()
fs.complex_modes(fs.chain(10))
assert all(count == 1 for count in seen[0]), seen
assert counts()[:len(before)] == before, (before, counts())
try:
    with threads.one_thread(True):
        raise KeyError
except KeyError:
    pass
assert counts()[:len(before)] == before
with threads.one_thread(False):
    assert counts()[:len(before)] == before
"""
OVERLAPPING = """
from concurrent.futures import ThreadPoolExecutor
import scipy.linalg
from femsub.algebra.processes import threads

def counts():
    return [one["num_threads"] for one in threads.libraries().info()]

for library in threads.libraries().lib_controllers:
    library.set_num_threads(2)  # two even on one core, but for a BLAS built without threads
before = counts()
assert max(before) == 2
with ThreadPoolExecutor(1) as pool:  # its thread lives to the end
    held = threads.one_thread(True)
    pool.submit(held.__enter__).result()
    with threads.one_thread(True):
        pool.submit(held.__exit__, None, None, None).result()
        assert set(counts()) == {1}, counts()
    assert counts() == before, counts()
    with threads.one_thread(True):
        assert set(counts()) == {1}, counts()
        held = threads.one_thread(True)
        pool.submit(held.__enter__).result()
    assert set(counts()) == {1}, counts()
    pool.submit(held.__exit__, None, None, None).result()
    assert counts() == before, counts()
    for library in threads.libraries().lib_controllers:  # the pool's thread is alive, and gave up setting them
        library.set_num_threads(1)
        assert library.num_threads == 1
"""

FACTOR = """
import os
import numpy as np
import scipy.sparse as sp
from threadpoolctl import ThreadpoolController
from femsub.algebra import petsc
from femsub.algebra.processes import threads
from femsub.checks import SingularMatrixError

petsc.load()
loops = [one.dynlib for one in ThreadpoolController().select(user_api="openmp").lib_controllers]
levels = [one.omp_get_max_active_levels() for one in loops]
running = len(os.listdir("/proc/self/task"))
factor = petsc.SparseFactor(sp.csr_array(np.ones((300, 300)) + 300 * np.eye(300)), "definite")
factor.again(sp.csr_array(np.ones((300, 300)) + 400 * np.eye(300)))
try:
    petsc.SparseFactor(sp.csr_array(np.ones((300, 300)) - 2 * np.eye(300)), "definite")
except SingularMatrixError:
    pass
if {one["threading_layer"] for one in threads.libraries().info()} == {"pthreads"}:
    with threads.no_openmp():
        assert not any(one.omp_get_max_active_levels() for one in loops)
    assert len(os.listdir("/proc/self/task")) == running
assert [one.omp_get_max_active_levels() for one in loops] == levels
"""


@pytest.mark.skipif(not os.path.isdir("/proc/self/task"), reason="threads are counted in /proc")
def test_a_factorisation_starts_no_threads_beside_those_of_blas() -> None:
    """CHOLMOD's OpenMP and BLAS would take the cores from each other."""
    done = subprocess.run([sys.executable, "-c", FACTOR], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("code", [CODE, OVERLAPPING], ids=["dense", "overlapping"])
def test_small_dense_work_takes_one_thread_and_gives_the_others_back(code: str) -> None:
    two = {**os.environ, "OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2"}
    done = subprocess.run([sys.executable, "-c", code], env=two, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("long", [0.0, 1e9])  # in two threads, and in one
def test_a_product_with_a_complex_block_is_that_of_its_parts(long: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("femsub.algebra.processes.threads.WORK", long)
    monkeypatch.setattr("femsub.algebra.processes.threads.threads", lambda: 2)
    rng = np.random.default_rng(1)
    A = sp.csr_array(sp.random_array((60, 60), density=0.4, rng=rng))
    X = np.asfortranarray(rng.standard_normal((60, 5)) + 1j * rng.standard_normal((60, 5)))
    for given in (X, X.real, X[:, :1]):
        found = times(A, given)
        assert found.dtype == given.dtype and np.allclose(found, A.toarray() @ given, rtol=0, atol=1e-13)
        assert np.allclose(times(A.toarray(), given), found, rtol=0, atol=1e-13)
    single = times(A.toarray().astype(np.float32), X.astype(np.complex64))
    assert single.dtype == np.complex64 and np.allclose(single, A.toarray() @ X, rtol=0, atol=1e-5)
    assert np.allclose(times(A, X[:, 0]), A.toarray() @ X[:, 0], rtol=0, atol=1e-13)


class Entered:
    """How many threads are in Python's parser at once, at most. Each waits there, so that others could come."""

    def __init__(self, parse: Callable[..., ast.AST]) -> None:
        self.parse, self.now, self.most, self.calls, self.lock = parse, 0, 0, 0, Lock()

    def __call__(self, *given: object, **options: object) -> ast.AST:
        with self.lock:
            self.now, self.calls = self.now + 1, self.calls + 1
            self.most = max(self.most, self.now)
        time.sleep(0.002)
        try:
            return self.parse(*given, **options)
        finally:
            with self.lock:
                self.now -= 1


@pytest.fixture
def readers(tmp_path: Path) -> list[Callable[[], object]]:
    """All that reads a file of NumPy, or an expression."""
    A = np.arange(9.0).reshape(3, 3)
    store(tmp_path / "stored", {"A": A})
    np.save(tmp_path / "dense.npy", A)
    np.savez(tmp_path / "several.npz", A=A, B=A)
    sp.save_npz(tmp_path / "sparse.npz", sp.csr_array(A))
    fs.write_matrices(tmp_path / "model", fs.chain(4), "npz")
    return [lambda: load(tmp_path / "stored"), lambda: fs.read_matrix(tmp_path / "dense.npy"),
            lambda: fs.read_matrix(tmp_path / "several.npz", "A"), lambda: fs.read_matrix(tmp_path / "sparse.npz"),
            lambda: fs.read_component(tmp_path / "model"), lambda: Expression("1 / (speed + 2)", "value")]


def in_threads(readers: list[Callable[[], object]], times: int) -> None:
    with ThreadPoolExecutor(8) as pool:
        for found in [pool.submit(reader) for _ in range(times) for reader in readers]:
            found.result()


def test_one_thread_at_a_time_is_in_the_parser(readers: list[Callable[[], object]], monkeypatch: pytest.MonkeyPatch) -> None:
    entered = Entered(ast.parse)
    monkeypatch.setattr(ast, "parse", entered)
    in_threads(readers, 4)
    assert entered.most == 1 and entered.calls >= 4 * len(readers)
    monkeypatch.setattr("femsub.algebra.processes.stored.parsing", nullcontext)
    in_threads(readers[:1], 16)
    assert entered.most > 1  # so the counter sees it


def test_threads_that_read_arrays_do_not_meet_in_the_parser(readers: list[Callable[[], object]]) -> None:
    """Python 3.11.2 raises SystemError where two do (python/cpython#106905); the garbage collector lets others run meanwhile."""
    def pause(*_: object) -> None:
        time.sleep(0)

    before = gc.get_threshold()
    gc.callbacks.append(pause)
    gc.set_threshold(5)
    try:
        in_threads(readers[:3] + readers[-1:], 60)
    finally:
        gc.callbacks.remove(pause)
        gc.set_threshold(*before)


PARSE = {"load", "load_npz", "read_array", "read_array_header_1_0", "read_array_header_2_0", "parse", "literal_eval"}


def parsed_without_lock(path: Path) -> Iterator[str]:
    """Where a file of NumPy is read, or a text parsed, outside of `with parsing()`."""
    text = path.read_text(encoding="utf-8")
    if not any(f".{name}" in text for name in PARSE):
        return
    tree = ast.parse(text)
    locked = {id(inner) for node in ast.walk(tree) if isinstance(node, ast.With)
              if any(ast.unparse(item.context_expr) == "parsing()" for item in node.items) for inner in ast.walk(node)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and node.attr in PARSE and id(node) not in locked \
                and ast.unparse(node.value) in ("np", "numpy", "sp", "np.lib.format", "ast"):
            yield f"{path.name}:{node.lineno} {ast.unparse(node)}"


def test_all_that_parses_takes_the_lock(tmp_path: Path) -> None:
    package = Path(fs.__file__).parent
    assert not [place for path in package.rglob("*.py") for place in parsed_without_lock(path)]
    (tmp_path / "one.py").write_text("with parsing():\n    np.load(1)\nwith parsing(), np.load(2):\n    pass\nnp.load(3)\n")
    assert [*parsed_without_lock(tmp_path / "one.py")] == ["one.py:5 np.load"]
