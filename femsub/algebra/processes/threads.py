"""One thread for small dense work, and several for products with large sparse matrices.

NumPy, SciPy and PETSc each bring a BLAS with its own threads. These keep spinning for a while and slow down the next library. On
two cores LAPACK's eigensolver then takes 100 ms for 100 DOF, and 1 ms with one thread.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from threading import RLock
from typing import Any, ClassVar, TypeVar

import numpy as np
import scipy.sparse as sp
from threadpoolctl import ThreadpoolController

from femsub.algebra.processes.limits import WORK
from femsub.algebra.processes.system import held_during_forks, own_processors
from femsub.checks import Array, Matrix

T = TypeVar("T")
BRINGING = ("numpy", "scipy.linalg", "scipy.sparse.linalg", "petsc4py.PETSc")  # modules that load a BLAS


class _Limited:
    """The number of calls that hold BLAS to one thread now, its number of threads before the first; the same for OpenMP."""

    depth, before, lock = 0, 1, held_during_forks(RLock())
    held: ClassVar[list[tuple[ThreadpoolController, list[int]]]] = []
    loops = 0
    levels: ClassVar[list[tuple[Any, int]]] = []


@contextmanager
def one_thread(small: bool) -> Iterator[None]:
    """Context manager: if the work is small, every loaded BLAS uses one thread inside, and as many as before afterwards.

    Calls may overlap in any order: the last to end gives the threads back. In a BLAS built on OpenMP, each Python thread has its
    own number of BLAS threads. Only the number of the Python thread with the first call is set.
    """
    with _Limited.lock:
        held = small and (_Limited.depth > 0 or threads() > 1)
        if held:
            controller = libraries()
            if not _Limited.depth:
                _Limited.before = threads()
            _Limited.depth += 1
    if not held:
        yield
        return
    try:
        with _Limited.lock:
            if controller not in (one for one, _ in _Limited.held):  # the first call, or a BLAS was loaded since
                counts = [library.num_threads for library in controller.lib_controllers]
                _Limited.held.append((controller, counts))
                _set(controller, [1] * len(counts))
        yield
    finally:
        with _Limited.lock:
            _Limited.depth -= 1
            while not _Limited.depth and _Limited.held:
                _set(*_Limited.held.pop())


def _set(controller: ThreadpoolController, counts: list[int]) -> None:
    """Give each BLAS its number of threads. In threadpoolctl 3.8 one Python thread has control, until it gives control up."""
    kinds = {kind for library in controller.lib_controllers if hasattr(kind := type(library), "clear_controlling_thread")}
    for kind in kinds:
        kind.clear_controlling_thread(force=True)
    for library, count in zip(controller.lib_controllers, counts, strict=True):
        library.set_num_threads(count)
    for kind in kinds:
        kind.clear_controlling_thread()


@contextmanager
def no_openmp() -> Iterator[None]:
    """Context manager: OpenMP loops inside have one thread, where BLAS has threads of its own. Calls may overlap.

    CHOLMOD uses four threads, or as many as there are cores, for small loops between two calls of BLAS. Both sets of threads spin
    while they wait, and take the cores from each other. On two cores a factorisation takes a sixth to a third longer.
    """
    with _Limited.lock:
        if not _Limited.loops:  # else a library with one number for all threads shows the 0 that another call has set
            _Limited.levels = [(library, library.omp_get_max_active_levels()) for library in _openmp(_loaded())]
        before = _Limited.levels
        _Limited.loops += 1
    try:
        for library, _ in before:
            library.omp_set_max_active_levels(0)
        yield
    finally:
        for library, levels in before:
            library.omp_set_max_active_levels(levels)
        with _Limited.lock:
            _Limited.loops -= 1


@cache
def _openmp(_key: int) -> list[Any]:
    """OpenMP's libraries; none where a BLAS is built on OpenMP, or may be."""
    layers = {getattr(library, "threading_layer", "") for library in libraries().lib_controllers}
    apart = layers == {"pthreads"}
    return [library.dynlib for library in ThreadpoolController().select(user_api="openmp").lib_controllers] if apart else []


def cores() -> int:
    """How many cores this process may use: the number of threads of its BLAS outside `one_thread`."""
    return min(_Limited.before if _Limited.depth else threads(), own_processors())


def libraries() -> ThreadpoolController:
    """Every BLAS in this process, and its number of threads."""
    return _libraries(_loaded())


def _loaded() -> int:
    """The number of imported modules that load a BLAS. When it changes, the libraries are searched again."""
    return sum(name in sys.modules for name in BRINGING)


@cache
def _libraries(_key: int) -> ThreadpoolController:
    return ThreadpoolController().select(user_api="blas")


def threads() -> int:
    """How many threads the BLAS of this process has now."""
    return max((library.num_threads for library in libraries().lib_controllers), default=1)


def by_threads(call: Callable[..., T], *columns: Any) -> Iterator[T]:
    """`call(*row)` for each row of the columns, in order, by as many threads as `cores`, each with one thread of BLAS.

    It pays where products or NumPy's calls of LAPACK take most of the time: these do not hold Python's lock.
    """
    from concurrent.futures import ThreadPoolExecutor

    with one_thread(True), ThreadPoolExecutor(cores()) as pool:
        yield from pool.map(call, *columns)


def times(A: Matrix, X: Array) -> Array:
    """AX for A (l, n) and X (n, k) or (n,). Rows of a large A are divided among as many threads as BLAS has; SciPy uses one.

    For a real A and a complex X, SciPy and NumPy would make a complex copy of A. Here X is taken as twice as many real columns.
    """
    if X.ndim == 1:
        return np.asarray(A @ X)
    if np.iscomplexobj(X) and not np.iscomplexobj(A):
        return times(A, np.ascontiguousarray(X).view(X.real.dtype)).view(X.dtype)
    # sparse multiplications take five times as long as dense ones; with ten nonzeros per row, as in a chain, the copies cost more
    # than a second thread gains
    if not sp.issparse(A) or A.format != "csr" or A.nnz < max(WORK / 5 / max(X.shape[1], 1), 10 * A.shape[0]) \
            or (count := threads()) == 1:
        return np.asarray(A @ X)
    from concurrent.futures import ThreadPoolExecutor

    X, result = np.ascontiguousarray(X), np.empty((A.shape[0], X.shape[1]))

    def some(first: int, last: int) -> None:
        at = slice(A.indptr[first], A.indptr[last])
        rows = sp.csr_array((A.data[at], A.indices[at], A.indptr[first:last + 1] - A.indptr[first]), (last - first, A.shape[1]))
        result[first:last] = rows @ X

    cuts = np.searchsorted(A.indptr, np.linspace(0, A.nnz, count + 1))
    cuts[-1] = A.shape[0]
    with ThreadPoolExecutor(count) as pool:
        list(pool.map(some, cuts[:-1], cuts[1:]))
    return result
