"""Craig-Chang: free modes and (inertia-relief) residual attachment modes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from femsub.checks import Array
from femsub.model.pencil import Pencil
from femsub.model.substructure import Substructure
from femsub.modes.normal_modes import confirm
from femsub.modes.shift_invert import ShiftInvert
from femsub.modes.static_shapes import independent
from femsub.reduction.basis import Basis, Extent, energy_error, kept_modes
from femsub.reduction.mode_selection import chosen
from femsub.reduction.statics import Parts


@dataclass(frozen=True)
class CraigChang(Extent):
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

    def basis(self, sub: Substructure, extra: Array, ports: Mapping[str, Array], damped: Pencil | None = None) -> Basis:
        parts = self.parts(sub, extra)
        handle, forces, estimate = parts.handle, parts.forces, None
        s = forces.shape[1]
        if self.modes is not None:
            modes = kept_modes(handle, self.modes)
        else:
            modes, estimate = chosen(parts, self.band, self.tol, damped)
        loads = np.hstack([forces, *ports.values()])
        rest = handle.elastic_solve(loads, modes.shapes)
        handle.release()
        confirm(handle, modes.found)
        elastic = modes.values[modes.rigid:]
        held = modes.shapes[:, modes.rigid:].T @ loads
        missing = np.einsum("ij,ij->j", rest, loads)
        whole = missing + np.einsum("ij,ij->j", held, held / elastic[:, None])

        residual, stiffness, inertia, dropped = independent(handle, rest[:, :s], forces, modes.shapes, modes.values)
        kinds = ("rigid",) * modes.rigid + ("free",) * modes.elastic + ("residual attachment",) * len(stiffness)
        errors, at = {}, s
        for name, w in ports.items():
            columns = slice(at, at + w.shape[1])
            at += w.shape[1]
            left = residual.T @ w
            errors[name] = energy_error(missing[columns] - np.einsum("ij,ij->j", left, left / stiffness[:, None]),
                                        whole[columns])
        return Basis(np.hstack([modes.shapes, residual]), np.diag(np.concatenate([np.ones(len(modes.values)), inertia])),
                     np.diag(np.concatenate([modes.values, stiffness])), kinds, modes.cutoff,
                     f"Craig-Chang with {modes.elastic} free modes", dropped, errors, handle.factorisations, estimate)

    def parts(self, sub: Substructure, extra: Array) -> Parts:
        """The factor of the whole, and unit forces at the interface."""
        n, n_b = sub.size, len(sub.interface)
        forces = np.zeros((n, n_b + extra.shape[1]), order="F")
        forces[sub.interface, np.arange(n_b)] = 1.0
        forces[:, n_b:] = extra
        return Parts(sub, ShiftInvert(sub.K, sub.M), slice(None), np.zeros((n, 0)), np.zeros((0, 0)), forces)
