"""The predicted cost of a quadratic eigenproblem: all eigenvalues by LAPACK, or some of them by PEP with their count.

Costs are in units of LAPACK's, which are proportional to n³. The coefficients are measured, with one thread, on reduced models of
446 to 1,500 coordinates. LAPACK took 6 ns n³. PEP took (1.2 x + 13 x²) ns n³ for xn eigenvalues: solves, and orthogonalisation.
The count in a disc took 22 x³ ns n³ for each column of a contact or dashpot.
"""

from __future__ import annotations

ALL = 6.0  # by LAPACK
SOLVED, ORTHOGONAL, SAMPLED = 1.2 / ALL, 13.0 / ALL, 22.0 / ALL
SHARE = 0.1  # of LAPACK's cost that a search by PEP may have: if it fails, so much is lost, and LAPACK comes after it


def by_pep(size: int, ask: int, columns: int = 0) -> float:
    """The cost of `ask` of the 2n eigenvalues, and of their count where contacts and dashpots have so many `columns`."""
    x = ask / size
    return x * (SOLVED + x * (ORTHOGONAL + x * SAMPLED * columns))


class Budget:
    """What searches by PEP may cost before LAPACK is asked for all eigenvalues; without a limit of a model too large for it.

    A sparse model may take all of LAPACK's cost: its solves cost next to nothing, and its counts are cheap.
    """

    def __init__(self, size: int, is_dense: bool, is_limited: bool = True) -> None:
        self.size, self.is_dense, self.is_limited = size, is_dense, is_limited
        self.left = (SHARE if is_dense else 1.0) if is_limited else float("inf")

    def covers(self, ask: int, columns: int = 0) -> bool:
        """Whether a search for `ask` eigenvalues is within the budget."""
        return by_pep(self.size, ask, columns) <= self.left

    def spend(self, ask: int, columns: int = 0) -> bool:
        """The same, and take its cost from what is left."""
        self.left -= by_pep(self.size, ask, columns)
        return self.left >= 0
