"""Hoffmann's model of two modes that friction couples, the smallest that shows flutter by mode coupling."""

from __future__ import annotations

import numpy as np

from femsub.checks import finite_number
from femsub.model import Affine


def two_mode(damping: tuple[float, float] = (0.0, 0.0)) -> Affine:
    """A mass on two springs across each other, pressed onto a moving belt: parameter "mu", the coefficient of friction.

    M = I, D = diag(d1, d2), K = [[2, 1 - 4μ/3], [1, 2]]; without damping ω² = 2 ± √(1 - 4μ/3). Both in units of the mass and of
    one of the springs.

    Parameters
    ----------
    damping : (d1, d2)
        Dashpots along and across the belt.

    References
    ----------
    N. Hoffmann, M. Fischer, R. Allgaier, L. Gaul, Int. J. Mech. Sci. 44 (2002) 2029.
    """
    d = np.diag([finite_number("each of damping", value) for value in damping])
    return Affine(np.eye(2), d if d.any() else None, [(1.0, [[2.0, 1.0], [1.0, 2.0]]), ("mu", [[0.0, -4 / 3], [0.0, 0.0]])])


def two_mode_critical(damping: tuple[float, float] = (0.0, 0.0)) -> float:
    """The friction at which `two_mode` begins to flutter: μ = 3/4 (1 + 2 d1 d2), for d1, d2 ≥ 0.

    From the Hurwitz determinant of (s² + d1 s + 2)(s² + d2 s + 2) - (1 - 4μ/3), which vanishes at s² = -2.
    """
    return 0.75 * (1 + 2 * damping[0] * damping[1])
