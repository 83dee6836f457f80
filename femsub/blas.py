"""How many threads BLAS may use: for small matrices one, since several wait for each other longer than they work.

NumPy, SciPy and PETSc bring an OpenBLAS each, with threads of their own that stay awake for a while and stand in the way of
the next library's. On two cores LAPACK's eigensolver takes 100 ms for 100 DOF then, and 1 ms with one thread.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

WORK = 1e8  # multiplications below which one thread is quicker, or loses less than a tenth of a second
NAMES = ("openblas_{}_num_threads", "openblas_{}_num_threads64_", "scipy_openblas_{}_num_threads",
         "scipy_openblas_{}_num_threads64_")
USERS = ("scipy.linalg", "petsc4py.PETSc")  # loading them may bring another library
Control = tuple[Callable[[], int], Callable[[int], None]]


@contextmanager
def threads_for(work: float) -> Iterator[None]:
    """One thread in every OpenBLAS of the process if `work`, in multiplications, is small; as before afterwards."""
    before = [(put, get()) for get, put in _controls(tuple(name in sys.modules for name in USERS))] if work < WORK else []
    for put, _ in before:
        put(1)
    try:
        yield
    finally:
        for put, count in before:
            put(count)


@cache
def _controls(_loaded: tuple[bool, ...]) -> tuple[Control, ...]:
    """How each OpenBLAS is asked for its number of threads, and told; none where the system does not list its libraries."""
    found: dict[int, Control] = {}
    with suppress(OSError):
        lines = Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace").splitlines()
        for path in sorted({line.split(maxsplit=5)[-1] for line in lines if "blas" in line}):
            with suppress(OSError):
                library = ctypes.CDLL(path)
                for name in NAMES:
                    if hasattr(library, name.format("get")) and hasattr(library, name.format("set")):
                        get, put = getattr(library, name.format("get")), getattr(library, name.format("set"))
                        found[ctypes.cast(put, ctypes.c_void_p).value or 0] = (get, put)
    return tuple(found.values())
