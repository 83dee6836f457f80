"""Comparison of two models by their spectra: eigenvalues are matched by distance and by shape, never by position."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from femsub.checks import Array, Matrix
from femsub.coupling import System
from femsub.model import Contacts, ReducedSubstructure, Substructure, contacts_of, in_band, small_matrices, upper, within
from femsub.modes.quadratic.multiplicity import match

if TYPE_CHECKING:
    from femsub.modes.quadratic.complex_modes import ComplexModes

NEAR = 0.5  # |Δλ| / |λ| above which an eigenvalue has no counterpart
CLUSTER = 1e-3  # |Δλ| / |λ| up to which modes are compared as one subspace


class SpectrumErrors(NamedTuple):
    """Largest errors of λ and of Re λ over the matched eigenvalues, and how many are not matched, or of another stability.

    `eigenvalue` and `real` are relative to |λ|, `growth` to a scale of its own. `missing` have no counterpart, `mac` is the
    smallest one. `missed` grow in the full model alone, `invented` in the reduced one alone.
    """

    eigenvalue: float
    growth: float
    missing: int
    mac: float
    real: float
    missed: int
    invented: int


def likeness(full: Substructure, model: Substructure, x: Array, y: Array) -> Array:
    """MAC |xᴴM Vy|² / (xᴴMx · yᴴM_r y) of shapes x (n, k) of the full model and y (r, l) of a reduced one, (k, l).

    NaN if the other model has no basis V. The weight M makes it independent of the units of the DOF.
    """
    fields = _fields(full, model, y)
    if fields is None:
        return np.full((x.shape[1], y.shape[1]), np.nan)
    Mx = full.M @ x
    return np.abs(Mx.conj().T @ fields) ** 2 / np.outer(_energy(x, Mx), _energy(fields, full.M @ fields))


def _fields(full: Substructure, model: Substructure, y: Array) -> Array | None:
    if isinstance(full, System) and isinstance(model, System):
        return full.collected(model.expand(y)) if model is not full else y
    if isinstance(model, ReducedSubstructure) and len(model.V) == full.size:
        return model.V @ y
    return y if model.size == full.size else None


def _energy(x: Array, Mx: Array) -> Array:
    return np.einsum("ij,ij->j", x.conj(), Mx).real


def spectrum_errors(full: ComplexModes, reduced: ComplexModes, models: tuple[Substructure, Substructure] | None = None,
                    scale: Array | None = None, band: tuple[float, float] = (0.0, np.inf)) -> SpectrumErrors:
    """Errors over the eigenvalues of the full model with Im λ ≥ 0, rigid motion apart.

    The error of Re λ is relative to `scale`, one value per eigenvalue of the full model, such as `turnover`. Without it the
    scale is Re λ itself, which vanishes at the stability border. Differences within the error bars are ignored.

    If the two `models` are given, shapes count as well. They decide between close frequencies. The smallest MAC is
    returned (else NaN), for clusters that of the subspace. Modes of the reduced model that grow count in the `band`.
    """
    ours, theirs = listed(full), listed(reduced)
    reference, x, bars = full.eigenvalues[ours], full.shapes[:, ours], full.error_bar[ours]
    values, y, other = reduced.eigenvalues[theirs], reduced.shapes[:, theirs], reduced.error_bar[theirs]
    lost, grows = reference.real > bars, (values.real > other) & in_band(values, band)
    if len(reference) == 0:
        return SpectrumErrors(0.0, 0.0, 0, 1.0 if models else np.nan, 0.0, 0, int(grows.sum()))
    at, to = match(reference, values, likeness(*models, x, y) if models else None)
    error = np.abs(values[to] - reference[at]) / np.abs(reference[at])
    near = error <= NEAR
    missing = len(reference) - int(near.sum())
    same = near & (reference[at].real > 0) & (values[to].real > 0)
    missed, invented = int(lost.sum() - (lost[at] & same).sum()), int(grows.sum() - (grows[to] & same).sum())
    if not near.any():
        return SpectrumErrors(np.nan, np.nan, missing, np.nan, np.nan, missed, invented)
    size = np.abs(reference.real) if scale is None else np.maximum(scale[ours], np.abs(reference.real))
    growth, noise = np.abs(values[to].real - reference[at].real), np.nan_to_num(bars[at] + other[to], posinf=0.0)
    real = float((growth / np.abs(reference[at]))[near].max())
    size = np.maximum(size[at], noise)
    growth = np.divide(growth, size, out=np.zeros_like(size), where=(size > noise) | (growth > noise))
    mac = _least_mac(models, reference[at[near]], x[:, at[near]], y[:, to[near]]) if models else np.nan
    return SpectrumErrors(float(error[near].max()), float(growth[near].max()), missing, mac, real, missed, invented)


def _least_mac(models: tuple[Substructure, Substructure], values: Array, x: Array, y: Array) -> float:
    """The smallest share of xᴴMx that is represented by the partners of a shape and of its cluster."""
    fields = _fields(*models, y)
    if fields is None:
        return np.nan
    M: Matrix = models[0].M
    together = np.abs(values[:, None] - values) <= CLUSTER * np.abs(values)
    least = 1.0
    for j, group in enumerate(together):
        Z, shape = fields[:, group], x[:, j]
        MZ, Mx = M @ Z, M @ shape
        held = MZ.conj().T @ shape
        share = (held.conj() @ np.linalg.lstsq(Z.conj().T @ MZ, held, rcond=None)[0]).real / (shape.conj() @ Mx).real
        least = min(least, float(share))
    return max(least, 0.0)


def turnover(model: Substructure, contacts: Contacts, modes: ComplexModes) -> Array:
    """(|xᴴDx| + |xᴴHx| / |λ| + Σ |u|ᵀ(|C_D| + |C_K - C_Kᵀ| / 2|λ|)|u|) / 2xᴴMx, u = Wᵀx: the sum of the rates at which D and H
    dissipate energy and contacts supply it; for a belt F|μ'| |u|².

    For a complex λ of a symmetric pencil, |Re λ| is the difference of these rates, which vanishes at the stability border.
    Without a contact the value is |Re λ|.
    """
    x = modes.shapes
    taken = np.abs(np.einsum("ij,ij->j", x.conj(), model.D @ x).real)
    size = np.maximum(np.abs(modes.eigenvalues), np.finfo(float).tiny)
    if model.H is not None:
        taken = taken + np.abs(np.einsum("ij,ij->j", x.conj(), model.H @ x)) / size
    for contact in contacts_of(contacts):
        W, damping, stiffness = small_matrices(model, contact)
        moved = np.abs(W.T @ x)
        skew = 0.0 if isinstance(stiffness, float) else (stiffness - stiffness.T) / 2
        for C, unit in ((damping, 1.0), (skew, size)):
            if not isinstance(C, float) or C:
                taken = taken + np.einsum("ij,ij->j", moved, abs(C) * moved if isinstance(C, float) else abs(C) @ moved) / unit
    return taken / (2 * np.maximum(_energy(x, model.M @ x), np.finfo(float).tiny))


def listed(modes: ComplexModes) -> Array:
    """Which eigenvalues are compared, bool (k,): Im λ ≥ 0, without rigid-body modes."""
    return np.asarray(~modes.rigid & upper(modes.eigenvalues))


def extra_eigenvalues(full: ComplexModes, reduced: ComplexModes, band: tuple[float, float]) -> int:
    """The number of eigenvalues of a reduced model in the band, below its cut-off, without a match in the full model."""
    shown = listed(reduced)
    reference, values = full.eigenvalues[listed(full)], reduced.eigenvalues[shown]
    counted = ~reduced.above_cutoff[shown] & within(values, band)
    counted[match(reference, values)[1]] = False
    return int(counted.sum())


def frequency_error(full: Array, reduced: Array) -> float:
    """The largest |Δω| / ω over the frequencies of the full model that have a counterpart (0 if there are none)."""
    if not len(full):
        return 0.0
    if not len(reduced):
        return np.nan
    at, to = match(full, reduced)
    error = np.abs(reduced[to] - full[at]) / full[at]
    near = error <= NEAR
    return float(error[near].max()) if near.any() else np.nan


def relative_error(value: float, reference: float) -> float:
    """|value - reference| / |reference|; 0 if both are equal, even if infinite."""
    if value == reference:
        return 0.0
    return float(abs(value - reference) / abs(reference)) if reference else np.nan
