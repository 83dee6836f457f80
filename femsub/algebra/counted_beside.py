"""An inertia count, or a test of definiteness, by a process on the second core, while this process goes on.

It needs a factorisation that nothing else uses. So it can be made while the modes that it proves something of are still sought.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

import scipy.sparse as sp

from femsub.algebra.factor import are_definite, inertia
from femsub.algebra.matrices import Difference, Sum
from femsub.algebra.memory import MOST_FILL, room_of_count
from femsub.algebra.processes.beside import Process
from femsub.algebra.processes.limits import BASE, FACTOR_BYTES, WORTH
from femsub.checks import Matrix, NotEnoughMemoryError

if TYPE_CHECKING:
    from femsub.algebra.factor import Handle


class CountBeside(Process):
    """The inertia of K - σM by a process that waits for σ (`ask`); `answer` is the number of negative eigenvalues, or None."""

    def __init__(self, K: Matrix, M: Matrix) -> None:
        super().__init__(count, (K, M))

    @classmethod
    def started(cls, K: Matrix, M: Matrix, nonzeros: float, columns: float) -> CountBeside | None:
        """The process, if a core and the memory are free for it and a factor of so many nonzeros is worth it; else None.

        This process will need so many columns of n numbers meanwhile.
        """
        if nonzeros >= WORTH and cls.has_room(room_of_count(K, nonzeros) + 8.0 * K.shape[0] * columns):
            with suppress(OSError, NotEnoughMemoryError):
                return cls(K, M)
        return None

    @classmethod
    def early(cls, K: Matrix, M: Matrix, columns: float) -> CountBeside | None:
        """As `started`, before this process has its factor: it may be any that K is likely to have."""
        # most matrices of 20 nonzeros per row, as of solids and plates, have four or more nonzeros of the factor for each
        if not sp.issparse(K) or K.nnz < max(WORTH / 4, 20 * K.shape[0]):
            return None
        if cls.has_room(MOST_FILL * FACTOR_BYTES * K.nnz + BASE + 8.0 * K.shape[0] * columns):
            with suppress(OSError, NotEnoughMemoryError):
                return cls(K, M)
        return None


class SignsBeside(Process):
    """What `signs` returns, by a process that begins at once; `answer` is both, or None."""

    def __init__(self, A: Matrix, D: Matrix, d: tuple[float, float]) -> None:
        super().__init__(both_signs, (A, D, d))
        self.ask(0.0)

    @classmethod
    def started(cls, A: Difference, D: Callable[[], Matrix], d: tuple[float, float], factor: Handle,
                columns: float) -> SignsBeside | None:
        """The process, if it is worth it and there is room for it and a factor like the one given of A; else None.

        This process will need so many columns of n numbers meanwhile.
        """
        if not sp.issparse(A.K) or factor.bytes < FACTOR_BYTES * WORTH or factor.on_disk:
            return None
        if cls.has_room(room_of_count(A.K, factor.bytes / FACTOR_BYTES, kept=True) + 8.0 * factor.size * columns):
            with suppress(OSError, NotEnoughMemoryError):
                return cls(A.formed(), D(), d)
        return None

    def answer(self) -> tuple[bool, bool] | None:
        """Both, once; None if the process could not find it. This waits for the process, which ends."""
        found = super().answer()
        return None if found is None else (bool(found[0]), bool(found[1]))


def signs(A: Matrix | Sum, D: Matrix | Sum, d: tuple[float, float]) -> tuple[bool, bool]:
    """Whether d₀A - D and d₁A + D are positive definite, by Cholesky factors that are not kept; of an infinite d they are."""
    finite = [(one, sign) for one, sign in zip(d, (-1, 1), strict=True) if one < math.inf]
    known = iter(are_definite(sp.csr_array(Sum.of(A).plus(sign / one, D)) for one, sign in finite))
    minus, plus = (one == math.inf or next(known) for one in d)
    return minus, plus


def count(K: Matrix, M: Matrix, sigma: Callable[[], float]) -> int:
    """What the process of `CountBeside` finds: it has the order of elimination before σ is known."""
    return inertia(Difference(K, M), sigma)


def both_signs(A: Matrix, D: Matrix, d: tuple[float, float], begin: Callable[[], float]) -> tuple[bool, bool]:
    """What the process of `SignsBeside` finds."""
    begin()
    return signs(A, D, d)
