"""Craig-Chang: free modes and (inertia-relief) residual attachment modes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from femsub.checks import Array
from femsub.reduction.basis import Kept, Responses
from femsub.reduction.method import Method
from femsub.reduction.statics import Partition, Statics

if TYPE_CHECKING:
    from femsub.modes.shift_invert import ShiftInvert


@dataclass(frozen=True)
class CraigChang(Method):
    """V = [Φ_r Φ_f Ψ], (K - ω²M)φ = 0 with the interface free, Ψ = (I - ΦΦᵀM) K⁺ (I - MΦΦᵀ) F, Φ = [Φ_r Φ_f].

    F holds a unit force at each interface DOF, and with `ports=True` the ports' columns. For a component that is
    held K⁺ = K⁻¹; for one that floats this is inertia relief (P = I - MΦ_rΦ_rᵀ) with the same factor of K - σM that
    gave the modes. Ψ is M- and K-orthogonal to Φ; it is made M-orthonormal, and columns that depend on the modes or
    on each other to working precision are dropped and counted. All of M is the identity then, and K is diagonal.

    Parameters
    ----------
    modes : int
        Number of elastic free modes; the rigid-body modes of a floating component come on top.
    band : (lo, hi), with tol : float
        Instead of `modes`: the fewest with which every mode from lo to hi, in radians per unit of time, is estimated to
        be within the relative error `tol`, and hi is below 0.7 of the cut-off; see `reduce`. Undamped frequencies below
        the cut-off are the component's own with any number of modes; `tol` decides where there is damping.

    References
    ----------
    R. R. Craig, C.-J. Chang, 18th Structures, Structural Dynamics and Materials Conf., AIAA/ASME (1977) 89; R. R.
    Craig, A. J. Kurdila, Fundamentals of Structural Dynamics (2006), ch. 17; the paper, eqs. (16)-(24).
    """

    key, label, colour, marker = "craig-chang", "Craig-Chang", "#0067a5", "^"
    held = False

    def statics(self, part: Partition, handle: ShiftInvert, extra: Array) -> Statics:
        """Unit forces at the interface, and no constraint modes."""
        n, n_b = part.sub.size, len(part.sub.interface)
        forces = np.zeros((n, n_b + extra.shape[1]), order="F")
        forces[part.sub.interface, np.arange(n_b)] = 1.0
        forces[:, n_b:] = extra
        return Statics(part, handle, np.zeros((n, 0)), np.zeros((0, 0)), forces, "residual attachment")

    def responses(self, statics: Statics, kept: Kept, ports: Mapping[str, Array]) -> Responses:
        """One solve for all, without the share of the modes: what is missing at a port is no small difference then."""
        loads, s = np.hstack([statics.forces, *ports.values()]), statics.forces.shape[1]
        rest = statics.handle.elastic_solve(loads, kept.shapes)
        missing, held = np.einsum("ij,ij->j", rest, loads), kept.shapes[:, kept.rigid:].T @ loads
        whole = missing + np.einsum("ij,ij->j", held, held / kept.values[kept.rigid:, None])
        return Responses(rest[:, :s], whole[s:], missing[s:], len(kept.values))
