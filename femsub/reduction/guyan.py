"""Guyan: static condensation on the interface and further master DOF."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la

from femsub.checks import NotConvergedError
from femsub.model import Pencil, Substructure
from femsub.modes import ShiftInvert, lowest_modes
from femsub.reduction.basis import Kept, Partition, Statics
from femsub.reduction.craig_bampton import CraigBampton
from femsub.reduction.method import lowest


@dataclass(frozen=True)
class Guyan(CraigBampton):
    """Guyan's static condensation: all DOF follow the master DOF statically.

    V = [I; Ψ], Ψ = -K_ss⁻¹ K_sm, shown in the order (masters m, slaves s). Without further masters this is Craig-Bampton
    without modes. Statics are exact. Frequencies are accurate far below the model's cut-off, which is the first frequency
    with all masters fixed.

    Parameters
    ----------
    modes : int, optional
        Number of master DOF besides the interface, by default none. Each master adds one coordinate, as a mode would. Masters
        are the DOF at which the same number of fixed-interface modes can be distinguished best (pivoted QR, in units of
        sqrt(m_ii)). To choose masters yourself, put them into the interface.
    band : (lo, hi), with tol : float
        Check that condensation onto the interface is within `tol` in the band. A `NotConvergedError` says how many modes
        would be needed in addition.

    References
    ----------
    R. J. Guyan, AIAA J. 3 (1965) 380; B. Irons, AIAA J. 3 (1965) 961. Masters: D. C. Kammer, J. Guid. Control Dyn. 14 (1991)
    251 (by independence of modes); Z. Drmač, S. Gugercin, SIAM J. Sci. Comput. 38 (2016) A631 (by QR).

    Examples
    --------
    >>> import femsub as fs
    >>> fs.reduce(fs.chain(10, interface=(1, 5, 10)), fs.Guyan()).size
    3
    """

    key, label, colour, marker = "guyan", "Guyan", "#4d4d4d", "v"
    takes_cutoff = False
    nested = False

    def __post_init__(self) -> None:
        if self.modes is None and self.band is None and self.tol is None:
            object.__setattr__(self, "modes", 0)
        super().__post_init__()

    def __str__(self) -> str:
        return super().__str__() if self.modes is None else self.title(0)

    def title(self, modes: int) -> str:
        return f"{self.label} with {self.modes} further masters" if self.modes else self.label

    def part(self, sub: Substructure) -> Partition:
        """The slaves, with the interface and the further masters held."""
        held = super().part(sub)
        if not self.modes:
            return held
        handle = held.factored()
        found = lowest_modes(handle, max(self.modes - handle.rigid.shape[1], 0))
        weighted = np.sqrt(handle.M.diagonal())[:, None] * found.shapes[:, :self.modes]
        masters = np.arange(sub.size)[held.rows][la.qr(weighted.T, mode="r", pivoting=True)[1][:self.modes]]
        handle.release()
        more = Substructure(sub.M, sub.K, sub.D, [*sub.interface, *masters], sub.ports, sub.name)
        return replace(Partition.of(more, True), factorisations=found.factorisations)

    def sought(self, handle: ShiftInvert) -> Kept | None:
        """No modes; None with a band and a tolerance."""
        return lowest(handle, 0) if self.band is None else None

    def kept(self, statics: Statics, pencil: Pencil | None) -> Kept:
        """No modes; with a band and a tolerance, only if none are needed."""
        found = super().kept(statics, pencil)
        if self.band is not None and self.tol is not None and found.elastic:
            raise NotConvergedError(
                f"{statics.part.sub.name!r} cannot be condensed to {self.tol:g} up to {self.band[1]:.5g} rad/time: it needs "
                f"{found.elastic} modes with the interface fixed. Use CraigBampton(modes={found.elastic}), or put more DOF into "
                "the interface")
        return found
