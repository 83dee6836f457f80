"""One BLAS thread for small dense work: the threads of two cores wait for each other longer than they compute."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache

FEW = 500  # up to so many DOF a dense quadratic eigenproblem is solved by one thread
BRINGING = {"numpy", "scipy.linalg", "scipy.sparse.linalg", "petsc4py.PETSc"}  # modules that come with a BLAS
SUFFIXES = ("64_", "", "_64")  # of OpenBLAS' functions, by how it was built
Setter = Callable[[int], None]
Getter = Callable[[], int]


@contextmanager
def one_thread(size: int = 0) -> Iterator[None]:
    """Inside, every OpenBLAS that is loaded computes with one thread if `size` DOF are FEW; other libraries stay as they are.

    NumPy, SciPy and PETSc may each bring one of their own. Eigenvalues of unsymmetric dense matrices gain next to nothing
    from a second thread, and lose a factor of ten where another process has the other core.
    """
    before = [(put, get()) for put, get in _libraries(len(set(sys.modules) & BRINGING))] if size <= FEW else []
    changed = [(put, count) for put, count in before if count > 1]
    try:
        for put, _ in changed:
            put(1)
        yield
    finally:
        for put, count in changed:
            put(count)


def _loaded() -> tuple[str, ...]:
    """The paths of the BLAS libraries in this process; none where the system does not tell."""
    try:
        with open("/proc/self/maps", encoding="utf-8") as maps:
            lines = [line for line in maps if "blas" in line and ".so" in line]
    except OSError:
        return ()
    return tuple(sorted(path for path in {line.split()[-1] for line in lines} if path.rsplit("/")[-1].startswith("lib")))


@cache
def _libraries(imported: int) -> list[tuple[Setter, Getter]]:
    """How each BLAS' threads are set and told; looked for again once more modules are there that bring one."""
    found = []
    for path in _loaded():
        try:
            library = ctypes.CDLL(path)
        except OSError:
            continue
        for name in (f"{prefix}openblas_{{}}_num_threads{suffix}" for prefix in ("", "scipy_") for suffix in SUFFIXES):
            if hasattr(library, name.format("set")) and hasattr(library, name.format("get")):
                found.append((getattr(library, name.format("set")), getattr(library, name.format("get"))))
                break
    return found
