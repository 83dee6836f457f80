"""Rubin: free modes and residual attachment modes, with the interface as physical coordinates."""

from __future__ import annotations

from dataclasses import dataclass

from femsub.reduction.basis import Basis, Statics
from femsub.reduction.free_interface import FreeInterface, recovered


@dataclass(frozen=True)
class Rubin(FreeInterface):
    """Rubin's method: free modes with residual flexibility and its inertia; the coordinates are [u_b, η].

    With Φ = [Φ_r Φ_f] the kept free modes, Ψ (n, n_b) the residual responses to unit forces at the interface, and

        G = Ψ_b (n_b, n_b), H = ΨᵀMΨ,     u = [Ψ G⁻¹, Φ - Ψ G⁻¹ Φ_b] [u_b; η],
        K = [[G⁻¹, -G⁻¹Φ_b], [-Φ_bᵀG⁻¹, Ω² + Φ_bᵀG⁻¹Φ_b]],
        M = [[G⁻¹HG⁻¹, -G⁻¹HG⁻¹Φ_b], [-Φ_bᵀG⁻¹HG⁻¹, I + Φ_bᵀG⁻¹HG⁻¹Φ_b]].

    G⁻¹ - ω² G⁻¹HG⁻¹ is Rubin's expansion of the residual's dynamic stiffness up to ω². It is also an exact projection onto
    [Φ Ψ]. The span is that of Craig-Chang, so frequencies bound those of the full model from above. Craig and Chang (1977)
    describe the same model as their method with the physical interface: u_b = Φ_b η + Ψ_b p is solved for p. If the modes leave
    no residual in some direction (G is singular), modal coordinates are solved for instead (`recovered`). ``.dropped`` is the
    number of columns lost in this way.

    Parameters
    ----------
    modes : int
        Number of elastic free modes; the rigid-body modes of a floating part are added to them.
    band : (lo, hi), with tol : float
        As in `CraigChang`; the estimate holds for the uncoupled part.

    References
    ----------
    S. Rubin, AIAA J. 13 (1975) 995; R. R. Craig, C.-J. Chang, NASA CR-2781 (1977); R. R. Craig, A. J. Kurdila, Fundamentals of
    Structural Dynamics (2006), ch. 17.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.reduce(fs.chain(10, interface=(1, 10), fixed=False), fs.Rubin(modes=1)).kinds
    ('interface', 'interface', 'rigid', 'free')
    """

    key, label, colour, marker = "rubin", "Rubin", "#009e73", "D"

    def coordinates(self, basis: Basis, statics: Statics) -> Basis:
        """The Craig-Chang basis in physical interface coordinates."""
        return recovered(basis, statics)
