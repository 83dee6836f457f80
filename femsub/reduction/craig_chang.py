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
    """Craig-Chang (CC): free modes, rigid-body modes and residual attachment modes of the interface.

    V = [Φ_r Φ_f Ψ], (K - ω²M)φ = 0 with the interface free, Ψ = (I - ΦΦᵀM) K⁺ (I - MΦΦᵀ) F, Φ = [Φ_r Φ_f].

    F holds a unit force at each interface DOF, and with ``reduce(..., ports=True)`` the ports' columns too. For a held
    component K⁺ = K⁻¹. For a floating one, inertia relief (P = I - MΦ_rΦ_rᵀ) uses the factor of K - σM that gave the
    modes. Ψ is M- and K-orthogonal to Φ and is made M-orthonormal. Columns that depend on the modes or on each other to
    working precision are dropped and counted. Then M is the identity and K is diagonal.

    Parameters
    ----------
    modes : int
        Number of elastic free modes; the rigid-body modes of a floating component are added to them.
    band : (lo, hi), with tol : float
        Instead of `modes`: the smallest number for which every mode from lo to hi (radians per unit of time) is
        estimated to be within the relative error `tol`, and hi is below 0.7 of the cut-off; see `reduce`. Without
        damping, all frequencies below the cut-off are exact for any number of modes; `tol` matters for damped models.

    Raises
    ------
    InputError, InputTypeError
        Neither `modes` nor `band` with `tol`, or both; a negative or non-integer number of modes; tol outside (0, 1).

    References
    ----------
    R. R. Craig, C.-J. Chang, 18th Structures, Structural Dynamics and Materials Conf., AIAA/ASME (1977) 89; R. R.
    Craig, A. J. Kurdila, Fundamentals of Structural Dynamics (2006), ch. 17; the paper, eqs. (16)-(24).

    Examples
    --------
    >>> import femsub as fs
    >>> sub = fs.chain(10, belt=2)
    >>> fs.reduce(sub, fs.CraigChang(modes=3), ports=True).kinds
    ('free', 'free', 'free', 'residual attachment', 'residual attachment')
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
        """One block solve for all loads. The modes' contribution is removed first, so that `missing` suffers no cancellation."""
        loads, s = np.hstack([statics.forces, *ports.values()]), statics.forces.shape[1]
        rest = statics.handle.elastic_solve(loads, kept.shapes)
        missing, held = np.einsum("ij,ij->j", rest, loads), kept.shapes[:, kept.rigid:].T @ loads
        whole = missing + np.einsum("ij,ij->j", held, held / kept.values[kept.rigid:, None])
        return Responses(rest[:, :s], whole[s:], missing[s:], len(kept.values))
