"""Which frequencies ω and eigenvalues λ are in a band, above a limit, of the upper half plane, or 0: decided here alone."""

from __future__ import annotations

import numpy as np

from femsub.checks import EPS, Array

EDGE = 1e-9  # of |λ| that an eigenvalue may lie beyond an edge, and still be in the band: room for its rounding
DOUBLE = 1e-6  # of |λ| up to which two eigenvalues are taken for one that rounding has split: if one is in, so is the other
LEAST = 1e-2  # of the band's upper end: the size of smaller eigenvalues in these two, since at 0 an eigenvalue is all rounding
REAL = 1e-7  # |Im λ| / |λ| below which λ is real: rounding makes pairs of two equal ones
REAL_ROOT = 1e-6  # |Im c| / |Re c| up to which a contact's coefficient on the border is real: else it is no border
Range = tuple[float, float]


def in_band(values: Array, band: Range, re: Range | None = None) -> Array:
    """lo ≤ ω ≤ hi, or lo ≤ Im λ ≤ hi and, with `re` = (a, b), a ≤ Re λ ≤ b: which values are in the band, bool, shape (k,).

    The edges belong to the band. What lies on an edge is off it by rounding, hence EDGE |λ| beyond an edge is in as well.
    Rounding splits a double eigenvalue by the square root of its size, hence what is at most DOUBLE |λ| from one that is in is
    in, too. The conjugate of a complex λ counts as such a neighbour: a double real eigenvalue may have become a pair a ± bi
    with a small b. In both a |λ| below LEAST hi counts as LEAST hi.

    Parameters
    ----------
    values : ndarray, shape (k,)
        Real: frequencies ω. Complex: eigenvalues λ, with both members of a pair or only those with Im λ ≥ 0.
    band, re : (lo, hi)
    """
    size = np.maximum(np.abs(values), LEAST * band[1] if np.isfinite(band[1]) else 0.0)
    outside = distance_outside(values, band, re)
    result = outside <= EDGE * size
    beside = np.flatnonzero(~result & (outside <= DOUBLE * size))
    if len(beside):
        mirrored = values.conj()
        members = np.append(values[result], mirrored[distance_outside(mirrored, band, re) <= EDGE * size])
        result[beside] = _distance(values[beside], members) <= DOUBLE * size[beside]
    return result


def within(values: Array, band: Range) -> Array:
    """Which λ have lo ≤ Im λ ≤ hi and |Re λ| ≤ hi."""
    return in_band(values, band, (-band[1], band[1]))


def beyond(omega: Array | float, limit: Array | float) -> Array:
    """Which ω lie above a limit, by more than rounding."""
    return np.asarray(omega > limit * (1 + EDGE))


def upper(values: Array) -> Array:
    """Which λ have Im λ ≥ 0; of a pair that rounding has made of two equal real ones, both."""
    return values.imag >= -REAL * np.abs(values)


def moving(values: Array, bar: Array) -> Array:
    """Which λ are not 0 within rounding, their own (`bar`) and that of the eigensolver: rigid motion has some that are."""
    return np.abs(values) > bar + 10 * EPS * np.abs(values).max(initial=0.0)


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


def _distance(values: Array, others: Array) -> Array:
    """From each value to the nearest of the others, inf if there are none, shape (k,)."""
    from scipy.spatial import cKDTree

    if not len(others):
        return np.full(len(values), np.inf)
    points, tree = (np.stack([part.real, part.imag], axis=1) for part in (values, others))
    return np.asarray(cKDTree(tree).query(points)[0])
