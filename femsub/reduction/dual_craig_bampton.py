"""Dual Craig-Bampton: free modes and residual flexibility, with interface forces as coordinates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la

from femsub.checks import EPS
from femsub.coupling import FORCE
from femsub.reduction.basis import Basis, Statics
from femsub.reduction.free_interface import DUST, FreeInterface, motion_by


@dataclass(frozen=True)
class DualCraigBampton(FreeInterface):
    """Free modes, and residual responses to the interface forces. The coordinates are [η, g], g the interface forces.

    u = Φ η + Ψ g with Φ = [Φ_r Φ_f] the kept free modes and Ψ (n, n_b) the residual responses to unit forces at the interface:

        M = diag(I, ΨᵀMΨ),   K = diag(Ω², G),   G = Ψ_b the residual flexibility at the interface (n_b, n_b).

    M and K are as simple as in Craig-Bampton, with forces in place of displacements. `couple` joins such parts by g = -Bᵀλ with
    the joint's forces λ. The interfaces are compatible only in the mean, weighted with the residual flexibility. A system has a
    negative or infinite eigenvalue for each λ; these eigenvalues are spurious. A single part has the same span as in Craig-Chang.

    A force has no coordinate if its residual response depends linearly on the responses to other forces, which represent it: M
    and K would be singular together. The same holds if the kept modes represent the whole response. With every mode kept there
    are no coordinates g. ``.dropped`` counts such forces.

    Parameters
    ----------
    modes : int
        Number of elastic free modes; the rigid-body modes of a floating part are added to them.
    band : (lo, hi), with tol : float
        As in `CraigChang`; the estimate holds for the uncoupled part.

    References
    ----------
    D. J. Rixen, J. Comput. Appl. Math. 168 (2004) 383; F. M. Gruber, D. J. Rixen, Strojniški vestnik 62 (2016) 452.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.reduce(fs.chain(10, interface=(1, 10), fixed=False), fs.DualCraigBampton(modes=1)).kinds
    ('rigid', 'free', 'interface force', 'interface force')
    """

    key, label, colour, marker = "dual-craig-bampton", "Dual Craig-Bampton", "#332288", "h"

    def coordinates(self, basis: Basis, statics: Statics) -> Basis:
        """The Craig-Chang basis [Φ Ξ] turned to [Φ Ψ]: Ψ = Ξ (ΞᵀKΞ)⁻¹ Ξ_bᵀ is as accurate as Ξ."""
        n_b, m = len(basis.interface), len(basis.M) - basis.kinds.count(statics.kind)
        stiffness = basis.K.diagonal()[m:]
        if not len(stiffness):
            return basis
        residual = np.arange(len(basis.M)) >= m  # an interface motion that is rounding is no residual flexibility
        basis = replace(basis, interface=np.where(residual & (np.abs(motion_by(basis)) < DUST), 0.0, basis.interface))
        at = basis.interface[:, m:].T / np.sqrt(stiffness)[:, None]  # motion at unit energy (s, n_b)
        size = np.linalg.norm(at, axis=0)
        left, R, order = la.qr(at / np.where(size > 0, size, 1.0), pivoting=True)
        # shapes that move the interface by rounding only belong to the ports
        rank = int(np.count_nonzero(np.abs(R.diagonal()) > (512 * EPS) ** 0.5)) if size.any() else 0
        blocks, kinds = [at[:, np.sort(order[:rank])]], (FORCE,) * rank
        if statics.forces.shape[1] > n_b:  # shapes of ports, K-orthogonal to those of the interface
            blocks, kinds = [*blocks, left[:, rank:]], kinds + ("static port",) * (len(at) - rank)
        T = np.eye(len(basis.M), m + len(kinds))
        T[m:, m:] = np.hstack(blocks) / np.sqrt(stiffness)[:, None]
        rigid = None if basis.rigid is None else np.pad(basis.rigid[:m], ((0, len(kinds)), (0, 0)))
        return basis.turned(T, basis.kinds[:m] + kinds, rigid)
