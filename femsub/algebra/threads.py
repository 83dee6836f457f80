"""One thread for small dense work.

NumPy, SciPy and PETSc each bring a BLAS with its own threads. These keep spinning for a while and slow down the next library. On
two cores LAPACK's eigensolver then takes 100 ms for 100 DOF, and 1 ms with one thread.
"""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager, nullcontext
from functools import cache

from threadpoolctl import ThreadpoolController

# DOF up to which a dense quadratic eigenproblem gets one thread. A second one gains little; beside other work it costs much: on a
# busy machine of two cores 500 DOF took 35 s with two threads and 2 s with one
FEW = 1500
WORK = 1e8  # multiplications below which one thread is faster, or loses less than 0.1 s
BRINGING = ("numpy", "scipy.linalg", "scipy.sparse.linalg", "petsc4py.PETSc")  # modules that load a BLAS


def one_thread(small: bool) -> AbstractContextManager[object]:
    """Context manager: if the work is small, every loaded BLAS uses one thread inside, and as many as before afterwards."""
    return libraries().limit(limits=1) if small else nullcontext()


def libraries() -> ThreadpoolController:
    """Every BLAS in this process, and its number of threads."""
    return _libraries(sum(name in sys.modules for name in BRINGING))


@cache
def _libraries(_imported: int) -> ThreadpoolController:
    """Search again when more of the modules that load a BLAS are imported."""
    return ThreadpoolController().select(user_api="blas")
