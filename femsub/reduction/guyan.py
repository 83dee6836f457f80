"""Guyan: static condensation on the interface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from femsub.errors import InputError, NotConvergedError
from femsub.reduction.basis import Kept
from femsub.reduction.craig_bampton import CraigBampton
from femsub.reduction.statics import Statics

if TYPE_CHECKING:
    from femsub.model.pencil import Pencil


@dataclass(frozen=True)
class Guyan(CraigBampton):
    """Static condensation: the interior follows the interface without inertia of its own.

    V = [I; Ψ], Ψ = -K_ii⁻¹ K_ib (n_i, n_b), shown in the order (interface, interior). That is Craig-Bampton without
    modes. The interface DOF are the "masters": put further DOF into the interface to refine the model. Statics are exact.
    Frequencies are good far below the first frequency with the interface fixed, which is the model's cut-off.

    Parameters
    ----------
    modes : int, optional
        0, the default: there are none.
    band : (lo, hi), with tol : float
        Checks that the condensed model is within `tol` in the band; a `NotConvergedError` says how many modes it would take.

    References
    ----------
    R. J. Guyan, AIAA J. 3 (1965) 380; B. Irons, AIAA J. 3 (1965) 961.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.reduce(fs.chain(10, interface=(1, 5, 10)), fs.Guyan()).size
    3
    """

    key, label, colour, marker = "guyan", "Guyan", "#7a7a7a", "v"

    def __post_init__(self) -> None:
        if self.modes is None and self.band is None and self.tol is None:
            object.__setattr__(self, "modes", 0)
        super().__post_init__()
        if self.modes:
            raise InputError(f"Guyan keeps no modes, but modes={self.modes} was asked for: give modes=0 and put more DOF into "
                             "the interface, or use CraigBampton")

    def __str__(self) -> str:
        return self.label if self.band is None else super().__str__()

    def title(self, modes: int) -> str:
        return self.label

    def kept(self, statics: Statics, pencil: Pencil | None) -> Kept:
        """No modes; with a band and a tolerance, only if none are needed."""
        found = super().kept(statics, pencil)
        if found.elastic:
            assert self.band is not None
            raise NotConvergedError(
                f"{statics.part.sub.name!r} cannot be condensed to {self.tol:g} up to {self.band[1]:.5g} rad/time: it takes "
                f"{found.elastic} modes with the interface fixed; use CraigBampton(modes={found.elastic}), or put more DOF into "
                "the interface")
        return found
