"""Craig-Chang with the physical interface recovered: its residual coordinates are solved for."""

from __future__ import annotations

from dataclasses import dataclass

from femsub.reduction.rubin import Rubin


@dataclass(frozen=True)
class CraigChangPhysical(Rubin):
    """Craig-Chang's basis with the interface displacements as coordinates, so that parts are joined by equal DOF.

    u_b = Φ_b η + Ξ_b p is solved for the residual coordinates, p = Ξ_b⁻¹(u_b - Φ_b η), so the coordinates are [u_b, η]:

        u = [Ξ Ξ_b⁻¹, Φ - Ξ Ξ_b⁻¹ Φ_b] [u_b; η].

    This is the model of `Rubin`, entry by entry. Rubin starts from the residual's dynamic stiffness, Craig and Chang from a
    Ritz basis. Both names are in use.

    Parameters
    ----------
    modes : int
        Number of elastic free modes; the rigid-body modes of a floating part are added to them.
    band : (lo, hi), with tol : float
        As in `CraigChang`; the estimate holds for the uncoupled part.

    References
    ----------
    R. R. Craig, C.-J. Chang, 18th Structures, Structural Dynamics and Materials Conf., AIAA/ASME (1977) 89; R. R. Craig,
    C.-J. Chang, NASA CR-2781 (1977).

    Examples
    --------
    >>> import femsub as fs
    >>> fs.reduce(fs.chain(10, belt=10, interface=[10]), fs.CraigChangPhysical(modes=2)).interface
    array([0])
    """

    key, label, colour, marker = "craig-chang-physical", "Craig-Chang, physical", "#56b4e9", "<"
