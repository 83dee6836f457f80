"""Error estimates of a model reduced to a tolerance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from femsub.checks import Array, InputError
from femsub.model.bands import DOUBLE, SMALL_SHARE, distance_outside

SHARE = 0.7  # a band ends below this share of the cut-off: the neglected terms of a series in (ω/ω_cut)² then stay below 1/2


@dataclass(frozen=True, eq=False, repr=False)
class Estimate:
    """The estimated error of each mode of a reduced model in a band, and the tolerance it was made for.

    `reduce` makes it for a method with `band` and `tol`; it is in ``.estimate`` of the result.

    Attributes
    ----------
    band : (lo, hi)
        In radians per unit of time.
    tol : float
        The largest relative error allowed.
    modes : int
        The number of elastic modes kept.
    cutoff : float
        The frequency of the first mode left out (inf for a complete basis).
    frequencies, frequency_error : ndarray, shape (k,)
        ω of the undamped reduced model, and the estimate of (ω - ω_exact) / ω_exact; rigid-body modes are exact. The residual
        of the eigensolver is not included; it is at most 1e-10, and its square enters ω. The modes of Craig-Chang are exact,
        so its errors are rounding only.
    eigenvalues, eigenvalue_error : ndarray, shape (l,)
        λ with Im λ ≥ 0 of the damped reduced model, and the estimate of |λ - λ_exact| / |λ_exact|; empty without damping.
    unmatched : int
        The number of λ in the band without a counterpart: only the reduced model or only the reference model has them.
    searched : int
        The number of elastic modes that were computed for the estimate.
    share : float
        The band must end below this share of the cut-off: 0.7 for one component. 1 for a system, since its estimate compares
        with modes above the cut-off.
    located, radius : ndarray, shape (l,) or (0,)
        With friction contact: the λ of the full system that belongs to each eigenvalue is within `radius` of `located`.

    Examples
    --------
    >>> import femsub as fs
    >>> sub = fs.chain(10, belt=1)
    >>> estimate = fs.reduce(sub, fs.CraigChang(band=(0, 0.5), tol=1e-3)).estimate
    >>> estimate.modes, estimate.met, estimate.worst < 1e-3
    (2, True, True)
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
    share: float = SHARE
    located: Array = field(default_factory=lambda: np.zeros(0, dtype=complex))
    radius: Array = field(default_factory=lambda: np.zeros(0))

    def record(self) -> dict[str, Any]:
        """The estimate as numbers and lists, for JSON: λ as pairs (Re, Im), infinity as None."""
        return {"band": list(self.band), "tol": self.tol, "modes": self.modes,
                "cutoff": None if np.isinf(self.cutoff) else self.cutoff,
                "frequencies": self.frequencies.tolist(), "frequency_error": self.frequency_error.tolist(),
                "eigenvalues": np.stack([self.eigenvalues.real, self.eigenvalues.imag], axis=1).tolist(),
                "eigenvalue_error": self.eigenvalue_error.tolist(), "unmatched": self.unmatched, "searched": self.searched,
                "share": self.share, "located": np.stack([self.located.real, self.located.imag], axis=1).tolist(),
                "radius": self.radius.tolist()}

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> Estimate:
        """The estimate from what `record` returned.

        Raises
        ------
        InputError
            A field is missing, has the wrong type, or the wrong length.
        """
        try:
            lo, hi = record["band"]
            omega, omega_error, parts, error = (np.asarray(record[key], dtype=float) for key in (
                "frequencies", "frequency_error", "eigenvalues", "eigenvalue_error"))
            located, radius = (np.asarray(record.get(key, []), dtype=float) for key in ("located", "radius"))
            parts, located = (part.reshape(-1, 2) if part.size else np.zeros((0, 2)) for part in (parts, located))
            if omega.ndim != 1 or omega.shape != omega_error.shape or error.shape != parts[:, 0].shape \
                    or radius.shape != located[:, 0].shape or len(radius) not in (0, len(error)):
                raise ValueError("its lists differ in length")
            return cls((float(lo), float(hi)), float(record["tol"]), int(record["modes"]),
                       np.inf if record["cutoff"] is None else float(record["cutoff"]), omega, omega_error,
                       parts[:, 0] + 1j * parts[:, 1], error, int(record["unmatched"]), int(record["searched"]),
                       float(record.get("share", SHARE)), located[:, 0] + 1j * located[:, 1], radius)
        except (KeyError, TypeError, ValueError) as problem:
            raise InputError(f"the estimate is damaged ({type(problem).__name__}: {problem})") from None

    def growth_of_full(self, values: Array) -> Array:
        """Bounds of Re λ of the full system for each λ of the model, (k, 2); NaN where they are not known.

        The estimate is valid for the contacts that it was made for. So only the λ in `eigenvalues` have bounds. Another λ with
        |λ| of at most 1e-6 of the band's end may be rigid motion, whose λ = 0 rounding moves to either side.
        """
        found = np.full((len(values), 2), np.nan)
        if len(self.located) and len(values):
            mirrored = np.where(values.imag < 0, values.conj(), values)
            apart = np.abs(mirrored[:, None] - self.eigenvalues)
            near = apart.argmin(axis=1)
            known = apart[np.arange(len(values)), near] <= DOUBLE * np.maximum(np.abs(values), SMALL_SHARE * self.band[1])
            middle, radius = self.located.real[near], self.radius[near]
            found[known] = np.stack([middle - radius, middle + radius], axis=1)[known]
            still = DOUBLE * self.band[1]
            found[~known & (np.abs(values) <= still)] = still * np.array([-1.0, 1.0])
        return found

    def reaching(self, band: tuple[float, float]) -> tuple[float, float]:
        """The band, widened to include each λ of the model whose counterpart in the full system may be in the band."""
        outside = distance_outside(self.located, band, (-band[1], band[1])) if len(self.located) else np.zeros(0)
        height = self.eigenvalues.imag[:len(outside)][outside <= self.radius]
        return float(height.min(initial=band[0])), float(height.max(initial=band[1]))

    @property
    def worst(self) -> float:
        """The largest estimated error; infinite if an eigenvalue has no counterpart."""
        if self.unmatched:
            return np.inf
        return float(max(self.frequency_error.max(initial=0.0), self.eigenvalue_error.max(initial=0.0)))

    @property
    def met(self) -> bool:
        """Whether all estimated errors are within `tol` and the band ends below the `share` of the cut-off."""
        return self.worst <= self.tol and self.band[1] < self.share * self.cutoff

    def __repr__(self) -> str:
        text = f"{len(self.frequencies)} ω within {self.frequency_error.max(initial=0.0):.1e}, "
        text = text if len(self.frequencies) or not len(self.eigenvalues) else ""  # a basis of complex modes: no ω are estimated
        if len(self.eigenvalues) or self.unmatched:
            text += f"{len(self.eigenvalues)} λ within {self.eigenvalue_error.max(initial=0.0):.1e}, "
        if self.unmatched:
            text += f"{self.unmatched} λ without a counterpart, "
        return (f"Estimate: {text}{self.tol:g} asked from {self.band[0]:.5g} to {self.band[1]:.5g} rad/time: "
                f"{'met' if self.met else 'not met'} with {self.modes} modes (cut-off {self.cutoff:.4g})")
