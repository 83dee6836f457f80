"""What every reduction method hands to `reduce`, and the steps they share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, Matrix, check_band, finite_number, whole_number
from femsub.errors import InputError
from femsub.model.estimate import Estimate
from femsub.modes.normal_modes import NormalModes, lowest_modes
from femsub.modes.shift_invert import ShiftInvert
from femsub.timing import phase

COLUMNS = 64  # of V, worked on at a time


@dataclass(frozen=True, eq=False)
class Basis:
    """V (n, r) with its labels, and M = VᵀMV, K = VᵀKV (r, r) from the relations that the modes fulfil.

    K is not formed as VᵀKV: for the low modes of a large model that product is all cancellation.
    """

    V: Array
    M: Array
    K: Array
    kinds: tuple[str, ...]
    cutoff: float
    method: str
    dropped: int
    port_error: Mapping[str, float]
    factorisations: int
    estimate: Estimate | None = None


@phase("projection")
def projected(A: Matrix, V: Array) -> Array:
    """VᵀAV, shape (r, r), without AV: a block of columns at a time."""
    result = np.zeros((V.shape[1],) * 2)
    if not sp.issparse(A) or A.nnz:
        for start in range(0, V.shape[1], COLUMNS):
            part = slice(start, start + COLUMNS)
            result[:, part] = V.T @ (A @ V[:, part])
    return result


@dataclass(frozen=True)
class Extent:
    """How far a basis goes: `modes` of them, or as many as a band and a tolerance need."""

    modes: int | None = None
    band: tuple[float, float] | None = None
    tol: float | None = None

    def __post_init__(self) -> None:
        name = type(self).__name__
        if (self.modes is None) == (self.band is None and self.tol is None):
            found = "nothing is given" if self.modes is None else f"modes={self.modes!r} and a band or tolerance are both given"
            raise InputError(f"{name} takes modes=20, or band=(lo, hi) with tol=1e-3, but {found}")
        if self.modes is not None:
            if whole_number("modes", self.modes) < 0:
                raise InputError(f"modes must not be negative, but is {self.modes}")
            return
        if self.band is None or self.tol is None:
            lacking = "band=(lo, hi), in rad per unit of time," if self.band is None else "tol=1e-3, the relative error allowed,"
            raise InputError(f"{name}: {lacking} is missing; band and tol go together")
        object.__setattr__(self, "band", check_band(self.band))
        if not 0 < finite_number("tol", self.tol) < 1:
            raise InputError(f"tol is a relative error between 0 and 1, not {self.tol!r}")

    def __str__(self) -> str:
        """The extent in words."""
        if self.modes is not None:
            return f"{self.modes} modes"
        return f"tol {self.tol:g} up to {self.band[1]:.5g} rad/time"  # type: ignore[index]


@dataclass(frozen=True, eq=False)
class Kept:
    """The modes of a basis: all that were found, of which `elastic` are kept, with the rigid ones; those left out begin at
    `cutoff`.
    """

    found: NormalModes
    elastic: int
    cutoff: float

    @property
    def rigid(self) -> int:
        return self.found.rigid

    @property
    def values(self) -> Array:
        """ω² of the modes kept, shape (rigid + elastic,)."""
        return self.found.eigenvalues[:self.rigid + self.elastic]

    @property
    def shapes(self) -> Array:
        """Φ of the modes kept, shape (n, rigid + elastic)."""
        return self.found.shapes[:, :self.rigid + self.elastic]


def kept_modes(handle: ShiftInvert, count: int) -> Kept:
    """The modes, with one more for the cut-off, if there is one; the count of a large model is still to be confirmed."""
    try:
        found = lowest_modes(handle, count + 1, defer=True)
        return Kept(found, count, float(found.frequencies[-1]))
    except InputError:
        return Kept(lowest_modes(handle, count, defer=True), count, np.inf)


def energy_error(missing: Array, whole: Array) -> float:
    """sqrt(missing / whole), the largest over a port's columns."""
    share = np.divide(missing, whole, out=np.zeros_like(whole), where=whole > 0)
    return float(np.sqrt(np.clip(share, 0.0, None).max(initial=0.0)))
