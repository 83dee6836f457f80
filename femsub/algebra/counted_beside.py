"""An inertia count, or a test of definiteness, by a second process, while this process goes on.

Both need a factorisation that nothing else uses. So it can be made while the search for the modes still runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import scipy.sparse as sp

from femsub.algebra.factor import are_definite, inertia
from femsub.algebra.matrices import Difference, Sum
from femsub.algebra.memory import MOST_FILL, room_of_count
from femsub.algebra.processes.beside import Process
from femsub.algebra.processes.limits import BASE, FACTOR_BYTES, WORTH
from femsub.checks import Matrix

if TYPE_CHECKING:
    from femsub.algebra.factor import Handle


class CountBeside(Process):
    """The inertia of K - σM by a process that waits for σ (`ask`); `answer` is the number of negative eigenvalues, or None."""

    def __init__(self, K: Matrix, M: Matrix) -> None:
        super().__init__(count, (K, M))

    @classmethod
    def started(cls, K: Matrix, M: Matrix, nonzeros: float, columns: float) -> CountBeside | None:
        """Starts the process if a core and the memory are free, and a factor with `nonzeros` is worth it; else None.

        The calling process will need `columns` of n numbers meanwhile.
        """
        need = room_of_count(K, nonzeros) + 8.0 * K.shape[0] * columns
        return cls.if_room(need, lambda: (K, M)) if nonzeros >= WORTH else None

    @classmethod
    def early(cls, K: Matrix, M: Matrix, columns: float) -> CountBeside | None:
        """As `started`, before this process has its factor: memory must suffice for the largest factor that is likely for K."""
        # for most matrices with 20 nonzeros per row, as of solids and plates, the factor has four or more times as many
        if not sp.issparse(K) or K.nnz < max(WORTH / 4, 20 * K.shape[0]):
            return None
        return cls.if_room(MOST_FILL * FACTOR_BYTES * K.nnz + BASE + 8.0 * K.shape[0] * columns, lambda: (K, M))


class SignsBeside(Process):
    """The two results of `signs`, by a process that begins at once; `answer` returns them, or None."""

    def __init__(self, A: Matrix, D: Matrix, d: tuple[float, float]) -> None:
        super().__init__(both_signs, (A, D, d))
        self.ask(0.0)

    @classmethod
    def started(cls, A: Difference, D: Callable[[], Matrix], d: tuple[float, float], factor: Handle,
                columns: float) -> SignsBeside | None:
        """Starts the process if it is worth it, and memory has room for it and a second factor of the size of A's; else None.

        The calling process will need `columns` of n numbers meanwhile.
        """
        if not sp.issparse(A.K) or factor.bytes < FACTOR_BYTES * WORTH or factor.on_disk:
            return None
        need = room_of_count(A.K, factor.bytes / FACTOR_BYTES, kept=True) + 8.0 * factor.size * columns
        return cls.if_room(need, lambda: (A.formed(), D(), d))

    def answer(self) -> tuple[bool, bool] | None:
        """Both results, at the first call; None if the process found none. It waits for the end of the process."""
        found = super().answer()
        return None if found is None else (bool(found[0]), bool(found[1]))


def signs(A: Matrix | Sum, D: Matrix | Sum, d: tuple[float, float]) -> tuple[bool, bool]:
    """Whether d₀A - D and d₁A + D are positive definite, by Cholesky factors that are not kept; True for an infinite d."""
    finite = [(one, sign) for one, sign in zip(d, (-1, 1), strict=True) if one < math.inf]
    known = iter(are_definite(sp.csr_array(Sum.of(A).plus(sign / one, D)) for one, sign in finite))
    minus, plus = (one == math.inf or next(known) for one in d)
    return minus, plus


def count(K: Matrix, M: Matrix, sigma: Callable[[], float]) -> int:
    """The result of the process of `CountBeside`. It finds the order of elimination before σ is known."""
    return inertia(Difference(K, M), sigma)


def both_signs(A: Matrix, D: Matrix, d: tuple[float, float], begin: Callable[[], float]) -> tuple[bool, bool]:
    """The result of the process of `SignsBeside`."""
    begin()
    return signs(A, D, d)
