"""The paper's chain of masses on a belt, with any number of masses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.algebra import check_room
from femsub.checks import Array, items, truth, whole_number
from femsub.components.build import not_negative, per_part
from femsub.model import Substructure


def chain(n: int = 10, belt: int = 1, damping: float = 0.1, *, masses: Any = 1.0, springs: Any = 1.0,
          interface: Sequence[int] = (1,), fixed: bool = True, name: str = "chain") -> Substructure:
    """The paper's chain of masses and springs, with a dashpot at the first mass and a belt under one of them.

    M = diag(m), K tridiagonal with k_j + k_{j+1} and -k_{j+1}, D = d1 e1 e1ᵀ, all (n, n); port "belt" w = e_b.
    Spring k_1 connects mass m_1 to the wall, spring k_j connects m_{j-1} to m_j; the right end is free. The dashpot d1
    stays at m_1 wherever the belt is. With unit masses and springs the undamped frequencies are
    ω_j = 2 sin((2j - 1)π / (4n + 2)).

    Parameters
    ----------
    n : int
        Number of masses.
    belt : int
        The number of the mass on the belt; **masses count from 1**, as in the paper.
    damping : float
        d1 ≥ 0, the constant of the dashpot between m_1 and the wall.
    masses, springs : float or array_like, shape (n,)
        Positive; any consistent units.
    interface : sequence of int
        Interface masses, counted from 1. Their DOF are counted from 0.
    fixed : bool
        False removes the wall: k_1 is not used, and the chain floats with one rigid-body mode.

    Raises
    ------
    InputError
        A mass that is not positive, a belt or an interface beyond the chain, a negative spring or dashpot.

    References
    ----------
    The conference paper that compares HCB and CC for n = 10 (its Fig. 1 and eqs. (4), (5)). It gives neither d1 nor F;
    d1 = 0.1 and F = 1 reproduce the axes of its Fig. 4.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.chain(10, belt=2, damping=0.1)
    Substructure 'chain': 10 DOF, sparse, 28 nonzeros in K, 1 interface DOF, ports belt
    """
    n = whole_number("n", n, least=1)
    # three entries of K in each row, each with its column, and four copies while they are computed
    check_room(f"a chain of {n:.3g} masses", 3 * 16 * 4.0 * n)
    mass, spring = per_part("masses", masses, n, "mass"), per_part("springs", springs, n, "spring")
    dashpot = not_negative("damping", damping)
    place = whole_number("belt (masses count from 1)", belt, 1, n)
    if not truth("fixed", fixed):
        spring = spring.copy()
        spring[0] = 0.0
    diagonal = spring + np.append(spring[1:], 0.0)
    K = sp.diags_array([-spring[1:], diagonal, -spring[1:]], offsets=[-1, 0, 1], shape=(n, n), format="csr")
    M = sp.diags_array(mass, format="csr")
    D = sp.csr_array(([dashpot], ([0], [0])), shape=(n, n)) if dashpot else None
    w = np.zeros(n)
    w[place - 1] = 1.0
    held = [whole_number("interface (masses count from 1)", number, 1, n) - 1
            for number in items("interface", interface, "mass numbers")]
    return Substructure(M, K, D, held, {"belt": w}, name)


def chain_frequencies(n: int, count: int | None = None) -> Array:
    """The exact frequencies of the undamped chain of unit masses and springs: ω_j = 2 sin((2j - 1)π / (4n + 2)), j = 1 … count.

    The chain is `chain(n)`, with its wall. Without `count`, all n frequencies are returned.

    Raises
    ------
    InputError
        n or count below 1, or count above n.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.chain_frequencies(10, 2).round(6)
    array([0.14946 , 0.445042])
    """
    n = whole_number("n", n, least=1)
    count = n if count is None else whole_number("count", count, 0, n)
    check_room(f"a list of {count:.3g} frequencies", 24.0 * count)
    j = np.arange(1, count + 1)
    return 2 * np.sin((2 * j - 1) * np.pi / (4 * float(n) + 2))
