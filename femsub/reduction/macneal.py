"""MacNeal: free modes and residual flexibility without its inertia."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from femsub.reduction.basis import Basis, Statics
from femsub.reduction.free_interface import FreeInterface, recovered


@dataclass(frozen=True)
class MacNeal(FreeInterface):
    """MacNeal's method: free modes with residual flexibility but without its inertia; the coordinates are [u_b, η].

    With Φ = [Φ_r Φ_f] the kept free modes and G (n_b, n_b) the residual flexibility at the interface

        K = [[G⁻¹, -G⁻¹Φ_b], [-Φ_bᵀG⁻¹, Ω² + Φ_bᵀG⁻¹Φ_b]],   M = [[0, 0], [0, I]].

    The interface has no mass, so its DOF follow statically. K, D and the ports are projections as in `Rubin`. M is not a
    projection, so frequencies of a system may lie below those of the full model. If the modes leave no residual in some
    direction, modal coordinates are solved for instead (`recovered`) and keep their mass.

    Do not use this model with friction at the interface: a falling characteristic on a DOF without mass is unstable at once,
    with a large real λ. `critical_slope` and motion in time need a regular M.

    Parameters
    ----------
    modes : int
        Number of elastic free modes; the rigid-body modes of a floating part are added to them. No band: see Raises.

    Raises
    ------
    InputError
        A band and a tolerance: the estimates need a projection.

    References
    ----------
    R. H. MacNeal, Comput. Struct. 1 (1971) 581; S. Rubin, AIAA J. 13 (1975) 995; C. Monjaraz-Tec, J. Gross, M. Krack, Comput.
    Struct. 259 (2022) 106698 (with the projected D).

    Examples
    --------
    >>> import femsub as fs
    >>> fs.reduce(fs.chain(10, belt=10, interface=[10]), fs.MacNeal(modes=2)).M.diagonal()
    array([0., 1., 1.])
    """

    key, label, colour, marker = "macneal", "MacNeal", "#cc79a7", "X"
    unestimated = "its mass matrix is no projection; use Rubin, whose model has the same size"

    def coordinates(self, basis: Basis, statics: Statics) -> Basis:
        """The Craig-Chang basis in physical interface coordinates, with the mass of the residual shapes set to 0."""
        massive = np.array([kind != statics.kind for kind in basis.kinds], dtype=float)
        # as few modes as possible are solved for, since each brings mass to the interface
        return recovered(replace(basis, M=np.diag(massive)), statics, clear=1e-4)
