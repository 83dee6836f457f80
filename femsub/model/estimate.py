"""What a reduction to a tolerance tells of itself, and the band in which a model's modes may be asked for a verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from femsub.checks import Array, check_band
from femsub.errors import InputError
from femsub.model.bands import beyond
from femsub.model.substructure import Substructure

SHARE = 0.7  # a band ends below so much of the cut-off: the terms left out of a series in (ω/ω_cut)² then stay below a half


@dataclass(frozen=True, eq=False, repr=False)
class Estimate:
    """What was asked of a reduced model, and how far each of its modes in the band is estimated to be off.

    Attributes
    ----------
    band : (lo, hi)
        In radians per unit of time.
    tol : float
        The largest relative error allowed.
    modes : int
        Elastic modes kept for it.
    cutoff : float
        The band ends below 0.7 of this frequency (inf for a complete basis).
    frequencies, frequency_error : ndarray, shape (k,)
        ω of the undamped reduced model, and the estimate of (ω - ω_exact) / ω_exact; rigid-body modes are exact. What the
        residual of the modes themselves leaves (1e-10 at most, and squared in ω) is not in it: Craig-Chang's figures
        here are those of rounding.
    eigenvalues, eigenvalue_error : ndarray, shape (l,)
        λ with Im λ ≥ 0 of the damped reduced model, and the estimate of |λ - λ_exact| / |λ_exact|; empty without damping.
    unmatched : int
        Complex eigenvalues in the band that only the reduced or only the richer model has.
    searched : int
        Elastic modes that were computed to decide.
    """

    band: tuple[float, float]
    tol: float
    modes: int
    cutoff: float
    frequencies: Array
    frequency_error: Array
    eigenvalues: Array
    eigenvalue_error: Array
    unmatched: int = 0
    searched: int = 0

    def record(self) -> dict[str, Any]:
        """All of it in numbers and lists, for JSON: λ as pairs (Re, Im), infinity as None."""
        return {"band": list(self.band), "tol": self.tol, "modes": self.modes,
                "cutoff": None if np.isinf(self.cutoff) else self.cutoff,
                "frequencies": self.frequencies.tolist(), "frequency_error": self.frequency_error.tolist(),
                "eigenvalues": np.stack([self.eigenvalues.real, self.eigenvalues.imag], axis=1).tolist(),
                "eigenvalue_error": self.eigenvalue_error.tolist(), "unmatched": self.unmatched, "searched": self.searched}

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> Estimate:
        """That of which `record` was written.

        Raises
        ------
        InputError
            Something is missing, of another kind, or of another length.
        """
        try:
            lo, hi = record["band"]
            omega, omega_error, parts, error = (np.asarray(record[key], dtype=float) for key in (
                "frequencies", "frequency_error", "eigenvalues", "eigenvalue_error"))
            parts = parts.reshape(-1, 2) if parts.size else np.zeros((0, 2))
            if omega.ndim != 1 or omega.shape != omega_error.shape or error.shape != parts[:, 0].shape:
                raise ValueError("its lists differ in length")
            return cls((float(lo), float(hi)), float(record["tol"]), int(record["modes"]),
                       np.inf if record["cutoff"] is None else float(record["cutoff"]), omega, omega_error,
                       parts[:, 0] + 1j * parts[:, 1], error, int(record["unmatched"]), int(record["searched"]))
        except (KeyError, TypeError, ValueError) as problem:
            raise InputError(f"the estimate is damaged ({type(problem).__name__}: {problem})") from None

    @property
    def worst(self) -> float:
        """The largest of all figures; infinite where an eigenvalue has no counterpart."""
        if self.unmatched:
            return np.inf
        return float(max(self.frequency_error.max(initial=0.0), self.eigenvalue_error.max(initial=0.0)))

    @property
    def met(self) -> bool:
        """Whether all figures are within `tol` and the band ends below 0.7 of the cut-off."""
        return self.worst <= self.tol and self.band[1] < SHARE * self.cutoff

    def __repr__(self) -> str:
        told = f"{len(self.frequencies)} ω within {self.frequency_error.max(initial=0.0):.1e}"
        if len(self.eigenvalues) or self.unmatched:
            told += f", {len(self.eigenvalues)} λ within {self.eigenvalue_error.max(initial=0.0):.1e}"
        if self.unmatched:
            told += f", {self.unmatched} λ without a counterpart"
        return (f"Estimate: {told}, {self.tol:g} asked from {self.band[0]:.5g} to {self.band[1]:.5g} rad/time: "
                f"{'met' if self.met else 'not met'} with {self.modes} modes (cut-off {self.cutoff:.4g})")


def usable_band(model: Substructure, band: Any = None) -> tuple[float, float]:
    """(lo, hi) in which a model's modes may be asked for a verdict: hi ≤ the cut-off; by default all up to there.

    Above it a reduced model has shapes of the reduction, which may be hardly damped, and not those of the component. So a
    band that reaches above is refused, here, for whoever asks: an answer for a part of it would pass for one for all of it.
    Up to SHARE of the cut-off, errors are small by rule; between the two they need not be.

    Raises
    ------
    InputError
        No band; one that ends above the cut-off.
    """
    if band is None:
        return 0.0, float(model.cutoff)
    lo, hi = check_band(band)
    if beyond(hi, model.cutoff):
        raise InputError(f"band=({lo:.6g}, {hi:.6g}) reaches above the cut-off of {model.name!r}, {model.cutoff:.6g} rad/time: "
                         "up there its modes are those of the reduction, not of the component; keep more modes, or end the band "
                         f"at the cut-off ({SHARE:g} of it, {SHARE * model.cutoff:.5g}, for errors that are small by rule)")
    return lo, hi
