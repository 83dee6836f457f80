"""The OpenBLAS libraries of this process, and one thread for small dense work.

NumPy, SciPy and PETSc bring an OpenBLAS each, with threads of their own that stay awake for a while and stand in the way of the
next library's. On two cores LAPACK's eigensolver takes 100 ms for 100 DOF then, and 1 ms with one thread.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from itertools import product

FEW = 500  # up to so many DOF a dense quadratic eigenproblem gains next to nothing from a second thread
WORK = 1e8  # multiplications below which one thread is quicker, or loses less than a tenth of a second
BRINGING = ("numpy", "scipy.linalg", "scipy.sparse.linalg", "petsc4py.PETSc")  # modules that come with a BLAS
NAMES = tuple(product(("", "scipy_"), ("64_", "", "_64")))  # before and behind OpenBLAS' functions, by how it was built


@dataclass(frozen=True)
class Library:
    """An OpenBLAS: its file, how it was built and for which processor, and how its threads are told and set."""

    path: str
    config: str
    core: str
    get: Callable[[], int]
    put: Callable[[int], None]


@contextmanager
def one_thread(small: bool) -> Iterator[None]:
    """Inside, if the work is small, every OpenBLAS that is loaded computes with one thread; afterwards with as many as before."""
    before = [(library, library.get()) for library in libraries()] if small else []
    changed = [(library, count) for library, count in before if count > 1]
    try:
        for library, _ in changed:
            library.put(1)
        yield
    finally:
        for library, count in changed:
            library.put(count)


def libraries() -> list[Library]:
    """Every OpenBLAS in this process; none where the system does not list what is loaded."""
    return _libraries(sum(name in sys.modules for name in BRINGING))


@cache
def _libraries(_imported: int) -> list[Library]:
    """Looked for again once more modules are there that bring one."""
    found: dict[int, Library] = {}
    for path in _loaded():
        try:
            library = ctypes.CDLL(path)
        except OSError:
            continue
        for prefix, suffix in NAMES:
            names = [f"{prefix}openblas_{call}{suffix}" for call in ("get_num_threads", "set_num_threads", "get_config",
                                                                     "get_corename")]
            if all(hasattr(library, name) for name in names):
                get, put, config, core = (getattr(library, name) for name in names)
                config.restype = core.restype = ctypes.c_char_p
                place = ctypes.cast(put, ctypes.c_void_p).value or 0  # one library may be listed by two paths
                found.setdefault(place, Library(path, config().decode(), core().decode(), get, put))
                break
    return list(found.values())


def _loaded() -> list[str]:
    try:
        with open("/proc/self/maps", encoding="utf-8", errors="replace") as maps:
            return sorted({line.split(maxsplit=5)[-1].strip() for line in maps if "blas" in line and ".so" in line})
    except OSError:
        return []
