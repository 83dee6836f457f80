"""Craig-Chang: free modes and (inertia-relief) residual attachment modes."""

from __future__ import annotations

from dataclasses import dataclass

from femsub.reduction.free_interface import FreeInterface


@dataclass(frozen=True)
class CraigChang(FreeInterface):
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
