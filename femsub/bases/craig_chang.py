"""Craig-Chang: free modes and (inertia-relief) residual attachment modes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from femsub.bases.basis import Basis, check_modes, energy_error, independent, kept_modes
from femsub.eigen import confirm
from femsub.pencil import Array
from femsub.shift_invert import ShiftInvert
from femsub.substructure import Substructure


@dataclass(frozen=True)
class CraigChang:
    """V = [Φ_r Φ_f Ψ], (K - ω²M)φ = 0 with the interface free, Ψ = (I - ΦΦᵀM) K⁺ (I - MΦΦᵀ) F, Φ = [Φ_r Φ_f].

    F holds a unit force at each interface DOF, and with `ports=True` the ports' columns. For a component that is
    held K⁺ = K⁻¹; for one that floats this is inertia relief (P = I - MΦ_rΦ_rᵀ) with the same factor of K - σM that
    gave the modes. Ψ is M- and K-orthogonal to Φ; it is made M-orthonormal, and columns that depend on the modes or
    on each other to working precision are dropped and counted. All of M is the identity then, and K is diagonal.

    Parameters
    ----------
    modes : int
        Number of elastic free modes; the rigid-body modes of a floating component come on top.

    References
    ----------
    R. R. Craig, C.-J. Chang, 18th Structures, Structural Dynamics and Materials Conf., AIAA/ASME (1977) 89; R. R.
    Craig, A. J. Kurdila, Fundamentals of Structural Dynamics (2006), ch. 17; the paper, eqs. (16)-(24).
    """

    modes: int

    def __post_init__(self) -> None:
        check_modes(self.modes)

    def basis(self, sub: Substructure, extra: Array, ports: Mapping[str, Array]) -> Basis:
        handle = ShiftInvert(sub.K, sub.M)
        found, values, modes, cutoff = kept_modes(handle, self.modes)
        n_b, s = len(sub.interface), len(sub.interface) + extra.shape[1]
        loads = np.zeros((sub.size, s + sum(w.shape[1] for w in ports.values())), order="F")
        loads[sub.interface, np.arange(n_b)] = 1.0
        loads[:, n_b:] = np.hstack([extra, *ports.values()])
        forces = loads[:, :s]
        rest = handle.elastic_solve(loads, modes)
        handle.release()
        confirm(handle, found)
        elastic = values[found.rigid:]
        held = modes[:, found.rigid:].T @ loads
        missing = np.einsum("ij,ij->j", rest, loads)
        whole = missing + np.einsum("ij,ij->j", held, held / elastic[:, None])

        residual, stiffness, inertia, dropped = independent(handle, rest[:, :s], forces, whole[:s], modes)
        kinds = ("rigid",) * found.rigid + ("free",) * self.modes + ("residual attachment",) * len(stiffness)
        errors, at = {}, s
        for name, w in ports.items():
            columns = slice(at, at + w.shape[1])
            at += w.shape[1]
            left = residual.T @ w
            errors[name] = energy_error(missing[columns] - np.einsum("ij,ij->j", left, left / stiffness[:, None]),
                                        whole[columns])
        return Basis(np.hstack([modes, residual]), np.diag(np.concatenate([np.ones(len(values)), inertia])),
                     np.diag(np.concatenate([values, stiffness])), kinds, cutoff,
                     f"Craig-Chang with {self.modes} free modes", dropped, errors, handle.factorisations)
