"""Hurty's original form: rigid-body modes, redundant constraint modes and fixed-interface modes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from femsub.reduction.basis import Basis, Statics
from femsub.reduction.craig_bampton import CraigBampton


@dataclass(frozen=True)
class Hurty(CraigBampton):
    """Constraint modes split into rigid-body modes and redundant constraint modes, with fixed-interface modes.

    The interface is b = (r, c). The DOF r are just enough to hold the part; the DOF c are redundant. V = [Φ_R Ψ_c Φ]. Φ_R
    (n, n_r) are rigid motions that move one DOF of r by 1. Ψ_c (n, n_c) are static shapes that move one DOF of c by 1, with all
    of r and the other DOF of c fixed. Φ are the fixed-interface modes:

        Φ_R = Ψ_r + Ψ_c R,   R (n_c, n_r) the rigid motion at c, Ψ = [Ψ_r Ψ_c] the constraint modes of Craig-Bampton.

    The span is that of Craig-Bampton. K is exactly 0 for Φ_R, which is what Hurty wanted for parts that move in space. The
    interface is not physical then: u_c = R q_R + q_c. A part that is held by its supports has no Φ_R. The model is then that of
    Craig-Bampton.

    Parameters
    ----------
    modes : int
        Number of fixed-interface modes.
    band : (lo, hi), with tol : float
        As in `CraigBampton`.

    References
    ----------
    W. C. Hurty, AIAA J. 3 (1965) 678; R. R. Craig, A. J. Kurdila, Fundamentals of Structural Dynamics (2006), ch. 17.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.reduce(fs.chain(10, interface=(1, 10), fixed=False), fs.Hurty(modes=1)).kinds
    ('rigid', 'constraint', 'fixed-interface')
    """

    key, label, colour, marker = "hurty", "Hurty", "#661100", "P"

    def coordinates(self, basis: Basis, statics: Statics) -> Basis:
        """Craig-Bampton's coordinates, with rigid motions in place of the interface DOF r."""
        n_b, n_r = len(statics.condensed), 0 if statics.rigid is None else statics.rigid.shape[1]
        if statics.rigid is None or not n_r:
            return basis
        stiffness = statics.part.sub.K.diagonal()[statics.part.sub.interface, None]
        scaled = statics.rigid * np.where(stiffness > 0, stiffness, 1.0) ** 0.5
        holding = la.qr(scaled.T, mode="r", pivoting=True)[1][:n_r]  # DOF that just hold the part
        redundant = np.setdiff1d(np.arange(n_b), holding)
        T = np.eye(len(basis.M))
        T[:n_b, :n_b] = 0.0
        T[holding, np.arange(n_r)], T[redundant, n_r + np.arange(len(redundant))] = 1.0, 1.0
        T[redundant, :n_r] = np.linalg.solve(statics.rigid[holding].T, statics.rigid[redundant].T).T
        rigid = np.pad(statics.rigid[holding], ((0, len(T) - n_r), (0, 0)))
        found = basis.turned(T, ("rigid",) * n_r + basis.kinds[n_r:], rigid)
        found.K[:n_r], found.K[:, :n_r] = 0.0, 0.0
        return found
