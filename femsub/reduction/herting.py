"""Herting: constraint modes, and the interior part of free modes and of inertia relief."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from femsub.checks import Array, InputError
from femsub.modes import ShiftInvert
from femsub.reduction.basis import Kept, Partition, Statics
from femsub.reduction.craig_bampton import CraigBampton
from femsub.reduction.method import lowest

if TYPE_CHECKING:
    from femsub.model import Pencil


@dataclass(frozen=True)
class Herting(CraigBampton):
    """Herting's method: constraint modes with free modes and inertia relief; the coordinates are [u_b, ξ].

    V = [[I, 0], [Ψ, X]] in the order (interface, interior), Ψ = -K_ii⁻¹K_ib. X spans the interior parts of

    - the elastic free modes without their static part, φ_i - Ψφ_b = ω² K_ii⁻¹ (Mφ)_i,
    - the inertia relief shapes of a floating part, K_ii⁻¹ (MΦ_r)_i: the interior's response to rigid acceleration.

    The interface is physical. The span is that of Craig-Chang and Rubin, since a response to interface forces is also a response
    to interface displacements (and to rigid acceleration in a floating part). The computation differs: it uses the factor of
    K_ii and inverts no residual flexibility. X is made M-orthonormal and K-orthogonal. Dependent columns are dropped and
    counted. Herting's paper does not prescribe the modes. With fixed-interface modes and without inertia relief the method
    is Craig-Bampton.

    Parameters
    ----------
    modes : int
        Number of elastic free modes. No band: see Raises.

    Raises
    ------
    InputError
        A band and a tolerance are given, but there is no estimate. The interface is empty, or does not hold the part.

    References
    ----------
    D. N. Herting, Finite Elem. Anal. Des. 1 (1985) 153.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.reduce(fs.chain(10, interface=(1, 10), fixed=False), fs.Herting(modes=2)).size
    5
    """

    key, label, colour, marker = "herting", "Herting", "#e69f00", "p"
    takes_cutoff = False
    mode_kind = "free"
    unestimated = "its modes have a free and its static shapes a fixed interface; use Rubin, which spans the same space"

    def statics(self, part: Partition, handle: ShiftInvert, extra: Array) -> Statics:
        """The constraint modes of Craig-Bampton."""
        return replace(super().statics(part, handle, extra), kind="free and inertia relief")

    def kept(self, statics: Statics, pencil: Pencil | None) -> Kept:
        """Free modes Φ of the whole part. The responses to (MΦ)_i join the basis. The next free mode gives the cut-off."""
        assert self.modes is not None
        sub = statics.part.sub
        if not len(sub.interface):
            raise InputError(f"Herting needs interface DOF, but {sub.name!r} has none. Name some, or use CraigChang")
        handle = ShiftInvert(sub.K, sub.M, carried=sub.rigid_motion)
        kept = lowest(handle, self.modes, defer=False)
        handle.release()
        return replace(kept, forces=(sub.M @ kept.shapes)[statics.part.rows], inside=False)
