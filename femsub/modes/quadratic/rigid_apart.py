"""Eigenpairs of a pencil whose M is singular, without its rigid motion: QZ would return λ = 0 as numbers of any sign.

With K Z = 0, and D Z_f = 0 for the free motions Z_f of Z = [Z_f Z_d], let x = Z_f c + Z_d d + E y. y are the DOF but a few that
hold the model. The rows of c give c = -(Z_fᵀMZ_f)⁻¹Z_fᵀM (Z_d d + E y) for every λ ≠ 0. What is left has K in y alone. Where
there is a d, the states are (y, ḋ, ẏ), since d itself has no energy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg as la

from femsub.algebra import unit_length
from femsub.model import Pencil
from femsub.modes.quadratic.singular_mass import Eigenpairs, Solver, qz_of

if TYPE_CHECKING:
    from femsub.algebra import RigidMotion


ROUNDING = 1e-14  # share of the mass that moves with the rigid motion below which the rest is no mass


def solve(pencil: Pencil, motion: RigidMotion, rest_of: Solver) -> Eigenpairs:
    """λ, right and left shapes of a dense pencil with symmetric M and D, exact zeros included, without infinite λ."""
    Z, free, n = motion.shapes, motion.free, pencil.size
    heavy = np.sqrt(np.abs(pencil.M.diagonal()))  # a DOF without mass would leave the rounding of one to the others
    Z = Z / np.linalg.norm(heavy[:, None] * Z, axis=0)
    holding = la.qr((heavy[:, None] * Z).T, mode="r", pivoting=True)[1][:motion.count]
    rest = np.setdiff1d(np.arange(n), holding)
    T = np.hstack([Z[:, free:], np.eye(n)[:, rest]])
    M, D = (T.T @ part @ T for part in (pencil.M, pencil.D))
    K, moving = np.zeros_like(M), slice(motion.count - free, None)
    K[moving, moving] = pencil.K[np.ix_(rest, rest)]
    if free:
        momentum = Z[:, :free].T @ pencil.M
        drift = -np.linalg.solve(momentum @ Z[:, :free], momentum @ T)
        share = (momentum @ T).T @ drift
        M = np.where(np.abs(M + share) > ROUNDING * np.abs(share), M + share, 0.0)
        T = T + Z[:, :free] @ drift
    small = Pencil((M + M.T) / 2, (D + D.T) / 2, K)
    if free == motion.count:
        values, x, y = rest_of(small.carrying(motion.none(len(M)), small.noise))
    else:
        values, x, y = qz_of(small, motion.count - free)
    still = np.hstack([Z, Z[:, :free]])
    return (np.append(values, np.zeros(motion.zeros)), unit_length(np.hstack([T @ x, still])),
            unit_length(np.hstack([T @ y, still])))
