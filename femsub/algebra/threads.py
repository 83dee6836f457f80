"""The OpenBLAS libraries of this process, and one thread for small dense work.

NumPy, SciPy and PETSc each bring an OpenBLAS with its own threads. These keep spinning for a while and slow down the next
library. On two cores LAPACK's eigensolver then takes 100 ms for 100 DOF, and 1 ms with one thread.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from itertools import product

# DOF up to which a dense quadratic eigenproblem gets one thread. A second one gains little; beside other work it costs much: on a
# busy machine of two cores 500 DOF took 35 s with two threads and 2 s with one
FEW = 1500
WORK = 1e8  # multiplications below which one thread is faster, or loses less than 0.1 s
BRINGING = ("numpy", "scipy.linalg", "scipy.sparse.linalg", "petsc4py.PETSc")  # modules that load a BLAS
NAMES = tuple(product(("", "scipy_"), ("64_", "", "_64")))  # prefixes and suffixes of OpenBLAS' function names


@dataclass(frozen=True)
class Library:
    """A loaded OpenBLAS: its file, build and processor, and functions to read and set its number of threads."""

    path: str
    config: str
    core: str
    get: Callable[[], int]
    put: Callable[[int], None]


@contextmanager
def one_thread(small: bool) -> Iterator[None]:
    """Context manager: if the work is small, every loaded OpenBLAS uses one thread inside, and as many as before afterwards."""
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
    """Every OpenBLAS in this process; none if the system does not list loaded libraries."""
    return _libraries(sum(name in sys.modules for name in BRINGING))


@cache
def _libraries(_imported: int) -> list[Library]:
    """Search again when more of the modules that load a BLAS are imported."""
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
