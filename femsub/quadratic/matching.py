"""Two spectra compared as sets, by distance and by shape, never by position."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from femsub.checks import Array, Matrix
from femsub.model.bands import upper, within
from femsub.model.substructure import ReducedSubstructure, Substructure

if TYPE_CHECKING:
    from femsub.model.friction import Belt
    from femsub.quadratic.complex_modes import ComplexModes

NEAR = 0.5  # |Δλ| / |λ| beyond which an eigenvalue has no counterpart
SWAP = 0.05  # |Δλ| / |λ| that shapes which have nothing in common weigh as much as
CLUSTER = 1e-3  # |Δλ| / |λ| up to which modes count as one subspace


class SpectrumErrors(NamedTuple):
    """Largest errors of λ, over |λ|, and of Re λ over matched eigenvalues, how many have none, and the smallest MAC."""

    eigenvalue: float
    growth: float
    missing: int
    mac: float


def match(reference: Array, values: Array, alike: Array | None = None, *, weight: float = SWAP,
          far: float | None = None) -> tuple[Array, Array]:
    """The one-to-one assignment of two spectra with the least sum of `pair_costs`: indices into both, never by position."""
    return assigned(pair_costs(reference, values, alike, weight=weight, far=far))


def pair_costs(reference: Array, values: Array, alike: Array | None = None, *, weight: float = SWAP,
               far: float | None = None) -> Array:
    """|Δλ| + weight |λ| (1 - MAC); with `far` min(|Δλ| / |λ|, far) + weight (1 - MAC), shape (k, l).

    With `far` one without a counterpart does not drive others from theirs.

    Parameters
    ----------
    reference, values : ndarray, shapes (k,) and (l,)
    alike : ndarray, shape (k, l), optional
        The MAC of the shapes, which decides where frequencies lie close; where it is NaN the shapes cost nothing.
    """
    cost, size = np.abs(reference[:, None] - values), np.abs(reference)[:, None]
    if far is not None:
        cost = np.divide(cost, size, out=np.where(cost > 0, far, 0.0), where=size > 0)
        cost, size = np.minimum(cost, far), np.ones(1)
    return cost if alike is None else cost + weight * size * np.nan_to_num(1 - alike)


def assigned(cost: Array) -> tuple[Array, Array]:
    """Rows and columns of the one-to-one assignment with the least sum of costs."""
    from scipy.optimize import linear_sum_assignment

    return linear_sum_assignment(cost)


def likeness(full: Substructure, model: Substructure, x: Array, y: Array) -> Array:
    """MAC |xᴴM Vy|² / (xᴴMx · yᴴM_r y) of shapes x (n, k) of the full model and y (r, l) of a reduced one, (k, l).

    NaN where the other model has no basis V to compare on. M as weight makes it free of the units of each DOF.
    """
    fields = _fields(full, model, y)
    if fields is None:
        return np.full((x.shape[1], y.shape[1]), np.nan)
    Mx = full.M @ x
    return np.abs(Mx.conj().T @ fields) ** 2 / np.outer(_energy(x, Mx), _energy(fields, full.M @ fields))


def _fields(full: Substructure, model: Substructure, y: Array) -> Array | None:
    if isinstance(model, ReducedSubstructure) and len(model.V) == full.size:
        return model.V @ y
    return y if model.size == full.size else None


def _energy(x: Array, Mx: Array) -> Array:
    return np.einsum("ij,ij->j", x.conj(), Mx).real


def spectrum_errors(full: ComplexModes, reduced: ComplexModes,
                    models: tuple[Substructure, Substructure] | None = None, scale: Array | None = None) -> SpectrumErrors:
    """Errors over the eigenvalues of the full model with Im λ ≥ 0, rigid motion apart.

    That of Re λ is over `scale`, one figure for each eigenvalue of the full model, such as `turnover`: Re λ itself, which
    stands in where there is none, vanishes at the border of stability. Where both it and the difference are within the
    error bars there is nothing to compare.

    With the two `models` shapes count as well: where frequencies lie close they decide which belongs to which, and the
    smallest MAC is given (else NaN), for clusters that of the subspace.
    """
    ours, theirs = listed(full), listed(reduced)
    reference, x, bars = full.eigenvalues[ours], full.shapes[:, ours], full.error_bar[ours]
    values, y, other = reduced.eigenvalues[theirs], reduced.shapes[:, theirs], reduced.error_bar[theirs]
    if len(reference) == 0:
        return SpectrumErrors(0.0, 0.0, 0, 1.0 if models else np.nan)
    at, to = match(reference, values, likeness(*models, x, y) if models else None)
    error = np.abs(values[to] - reference[at]) / np.abs(reference[at])
    near = error <= NEAR
    missing = len(reference) - int(near.sum())
    if not near.any():
        return SpectrumErrors(np.nan, np.nan, missing, np.nan)
    size = np.abs(reference.real) if scale is None else np.maximum(scale[ours], np.abs(reference.real))
    growth, noise = np.abs(values[to].real - reference[at].real), np.nan_to_num(bars[at] + other[to], posinf=0.0)
    size = np.maximum(size[at], noise)
    growth = np.divide(growth, size, out=np.zeros_like(size), where=(size > noise) | (growth > noise))
    mac = _least_mac(models, reference[at[near]], x[:, at[near]], y[:, to[near]]) if models else np.nan
    return SpectrumErrors(float(error[near].max()), float(growth[near].max()), missing, mac)


def _least_mac(models: tuple[Substructure, Substructure], values: Array, x: Array, y: Array) -> float:
    """The smallest share of xᴴMx that the partners of a shape and of all shapes of its cluster can do."""
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


def turnover(model: Substructure, contacts: Belt | None, modes: ComplexModes) -> Array:
    """(|xᴴDx| + F|μ'| |Wᵀx|²) / 2xᴴMx: the rates at which D takes power and a belt feeds it, without their cancellation.

    Of a complex λ of a symmetric pencil Re λ is the difference of the two, which vanishes at the border of stability.
    Without a belt the figure is |Re λ|.
    """
    x = modes.shapes
    taken = np.abs(np.einsum("ij,ij->j", x.conj(), model.D @ x).real)
    if contacts is not None and contacts.slope is not None:
        W = model.port(contacts.port).reshape(model.size, -1)
        taken = taken + abs(contacts.force * contacts.slope) * (np.abs(W.T @ x) ** 2).sum(axis=0)
    return taken / (2 * np.maximum(_energy(x, model.M @ x), np.finfo(float).tiny))


def listed(modes: ComplexModes) -> Array:
    """The eigenvalues that are compared, bool (k,): Im λ ≥ 0, and no rigid motion."""
    return np.asarray(~modes.rigid & upper(modes.eigenvalues))


def extra_eigenvalues(full: ComplexModes, reduced: ComplexModes, band: tuple[float, float]) -> int:
    """Eigenvalues of a reduced model in the band, below its cut-off, that match none of the full model."""
    shown = listed(reduced)
    reference, values = full.eigenvalues[listed(full)], reduced.eigenvalues[shown]
    counted = ~reduced.above_cutoff[shown] & within(values, band)
    counted[match(reference, values)[1]] = False
    return int(counted.sum())


def frequency_error(full: Array, reduced: Array) -> float:
    """The largest |Δω| / ω over the frequencies of the full model that have a counterpart (0 where there are none)."""
    if not len(full):
        return 0.0
    if not len(reduced):
        return np.nan
    at, to = match(full, reduced)
    error = np.abs(reduced[to] - full[at]) / full[at]
    near = error <= NEAR
    return float(error[near].max()) if near.any() else np.nan


def relative_error(value: float, reference: float) -> float:
    """|value - reference| / |reference|; 0 where both are equal, infinite ones too."""
    if value == reference:
        return 0.0
    return float(abs(value - reference) / abs(reference)) if reference else np.nan
