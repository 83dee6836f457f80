"""Ziegler's pendulum under a follower load, which damping destabilises."""

from __future__ import annotations

import numpy as np

from femsub.checks import finite_number
from femsub.model import Affine


def ziegler(damping: float = 0.0) -> Affine:
    """Ziegler's pendulum: two bars of length l, masses 2m and m, springs k and dashpots b in both joints: parameter "P".

    M = [[3, 1], [1, 1]], D = b [[2, -1], [-1, 1]], K = [[2 - P, P - 1], [-1, 1]], in the units m = l = k = 1. The load P follows
    the direction of the second bar, so K is unsymmetric.

    Parameters
    ----------
    damping : float
        b ≥ 0 of the dashpot in each joint.

    References
    ----------
    H. Ziegler, Ing.-Arch. 20 (1952) 49; O. N. Kirillov, Nonconservative Stability Problems of Modern Physics (2013), ch. 1.
    """
    joints = np.array([[2.0, -1.0], [-1.0, 1.0]])
    D = finite_number("damping", damping) * joints
    return Affine([[3.0, 1.0], [1.0, 1.0]], D if D.any() else None, [(1.0, joints), ("P", [[-1.0, 1.0], [0.0, 0.0]])])


def ziegler_critical(damping: float = 0.0) -> float:
    """The load at which `ziegler` begins to flutter: 7/2 - √2 without damping, else 41/28 + b²/2.

    The second from the Hurwitz determinant of 2s⁴ + 7bs³ + (7 - 2P + b²)s² + 2bs + 1. Its limit for b → 0 is lower
    than the first by 30 %: the destabilisation paradox.
    """
    return 41 / 28 + damping**2 / 2 if damping else 3.5 - float(np.sqrt(2.0))
