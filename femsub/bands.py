"""What "in the band" means at its edges: the one place where that is decided, for frequencies ω and eigenvalues λ alike."""

from __future__ import annotations

import numpy as np

from femsub.pencil import Array

EDGE = 1e-9  # of |λ| that an eigenvalue may lie beyond an edge, and still be in the band: room for its rounding
DOUBLE = 1e-6  # of |λ| up to which two eigenvalues are taken for one that rounding has split: in the band both are, or none
Range = tuple[float, float]


def in_band(values: Array, band: Range, re: Range | None = None) -> Array:
    """lo ≤ ω ≤ hi, or lo ≤ Im λ ≤ hi and, with `re` = (a, b), a ≤ Re λ ≤ b: which values are in the band, bool, shape (k,).

    The edges belong to the band. What lies on an edge is off it by rounding, hence EDGE |λ| beyond an edge is in as well.
    Rounding splits a double eigenvalue by the square root of its size: of values that are DOUBLE |λ| apart at the most
    each may lie beyond an edge by as much as they are apart. With a complex λ its conjugate counts as such a
    neighbour: a double real eigenvalue may have become a pair a ± bi with a small b.

    Parameters
    ----------
    values : ndarray, shape (k,)
        Real: frequencies ω. Complex: eigenvalues λ, with both members of a pair or only those with Im λ ≥ 0.
    band, re : (lo, hi)
    """
    size = np.abs(values)
    outside = distance_outside(values, band, re)
    result = outside <= EDGE * size
    if (~result & (outside <= DOUBLE * size)).any():
        apart = _apart(values)
        result |= outside <= np.where(apart <= DOUBLE * size, apart, 0.0)
    return result


def distance_outside(values: Array, band: Range, re: Range | None = None) -> Array:
    """How far each value lies beyond the edge that it is furthest beyond; 0 within, shape (k,)."""
    height = values.imag if np.iscomplexobj(values) else values
    beyond = np.maximum(band[0] - height, height - band[1])
    if re is not None:
        beyond = np.maximum(beyond, np.maximum(re[0] - values.real, values.real - re[1]))
    return np.maximum(beyond, 0.0)


def widened(limit: float) -> float:
    """A limit (≥ 0) beyond which nothing is in a band that ends at it: up to there is to be searched."""
    return limit * (1 + 4 * DOUBLE)


def _apart(values: Array) -> Array:
    """The distance of each value to the nearest other one, conjugates included, shape (k,); inf where there is none."""
    from scipy.spatial import cKDTree

    apart = np.full(len(values), np.inf)
    if len(values) > 1:
        points = np.stack([values.real, values.imag], axis=1)
        apart = np.asarray(cKDTree(points).query(points, k=2)[0][:, 1])
    return np.minimum(apart, np.where(values.imag != 0, 2 * np.abs(values.imag), np.inf))
