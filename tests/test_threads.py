"""Threads of BLAS are put away for small dense work, and are back afterwards."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
import scipy.sparse as sp

from femsub.algebra import times

CODE = """
import scipy.linalg
import femsub as fs
from femsub.modes.quadratic import dense
from femsub.algebra import threads

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
from femsub.algebra import threads

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
from femsub.algebra import petsc, threads
from femsub.errors import SingularMatrixError

petsc.load()
loops = [one.dynlib for one in ThreadpoolController().select(user_api="openmp").lib_controllers]
levels = [one.omp_get_max_active_levels() for one in loops]
running = len(os.listdir("/proc/self/task"))
factor = petsc.Factor(sp.csr_array(np.ones((300, 300)) + 300 * np.eye(300)), "definite")
factor.again(sp.csr_array(np.ones((300, 300)) + 400 * np.eye(300)))
try:
    petsc.Factor(sp.csr_array(np.ones((300, 300)) - 2 * np.eye(300)), "definite")
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
    monkeypatch.setattr("femsub.algebra.threads.LONG", long)
    monkeypatch.setattr("femsub.algebra.threads.threads", lambda: 2)
    rng = np.random.default_rng(1)
    A = sp.csr_array(sp.random_array((60, 60), density=0.4, rng=rng))
    X = np.asfortranarray(rng.standard_normal((60, 5)) + 1j * rng.standard_normal((60, 5)))
    for given in (X, X.real, X[:, :1]):
        found = times(A, given)
        assert found.dtype == given.dtype and np.allclose(found, A.toarray() @ given, rtol=0, atol=1e-13)
    assert np.allclose(times(A, X[:, 0]), A.toarray() @ X[:, 0], rtol=0, atol=1e-13)
