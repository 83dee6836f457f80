"""Which frequencies ω and eigenvalues λ count as in a band, above a limit, in the upper half plane, or 0. Decided only here."""

from __future__ import annotations

import numpy as np

from femsub.checks import EPS, EQUAL, Array

# Two eigenvalues closer than DOUBLE |λ| are a double eigenvalue split by rounding: both are in a band, or neither is. A conjugate
# pair as close as this stands for two real eigenvalues. A |λ| below DOUBLE hi counts as 0.
DOUBLE = 1e-6
SMALL_SHARE = 1e-2  # these tolerances use at least this share of hi in place of |λ|: near 0 the rounding exceeds any share of |λ|
REAL_ROOT = 1e-6  # a root of the border function counts only if its coefficient c is real: |Im c| / |Re c| up to this
Range = tuple[float, float]


def in_band(values: Array, band: Range, re: Range | None = None) -> Array:
    """Which values are in the band: lo ≤ ω ≤ hi, or lo ≤ Im λ ≤ hi and, with `re` = (a, b), a ≤ Re λ ≤ b; bool, shape (k,).

    The edges belong to the band. Values up to EQUAL |λ| beyond an edge are in as well, since rounding moves them.
    Rounding splits a double eigenvalue by about the square root of EPS. So a value within DOUBLE |λ| of a value in the
    band is in, too. The conjugate of a complex λ counts as such a neighbour: a double real eigenvalue may have become a
    pair a ± bi with a small b. Both rules use at least hi/100 in place of |λ|.

    Parameters
    ----------
    values : ndarray, shape (k,)
        Real: frequencies ω. Complex: eigenvalues λ, with both members of a pair or only those with Im λ ≥ 0.
    band, re : (lo, hi)
    """
    size = np.maximum(np.abs(values), SMALL_SHARE * band[1] if np.isfinite(band[1]) else 0.0)
    outside = distance_outside(values, band, re)
    result = outside <= EQUAL * size
    beside = np.flatnonzero(~result & (outside <= DOUBLE * size))
    if len(beside):
        mirrored = values.conj()
        members = np.append(values[result], mirrored[distance_outside(mirrored, band, re) <= EQUAL * size])
        if len(members):
            from scipy.spatial import cKDTree

            points, tree = (np.stack([part.real, part.imag], axis=1) for part in (values[beside], members))
            result[beside] = np.asarray(cKDTree(tree).query(points)[0]) <= DOUBLE * size[beside]
    return result


def within(values: Array, band: Range) -> Array:
    """Which λ have lo ≤ Im λ ≤ hi and |Re λ| ≤ hi."""
    return in_band(values, band, (-band[1], band[1]))


def beyond(omega: Array | float, limit: Array | float) -> Array:
    """Which ω lie above a limit, by more than rounding."""
    return np.asarray(omega > limit * (1 + EQUAL))


def upper(values: Array) -> Array:
    """Which λ have Im λ ≥ 0. If rounding has turned two equal real eigenvalues into a pair, both count."""
    return values.imag >= -DOUBLE * np.abs(values)


def doubled(values: Array) -> Array:
    """Indices of nearly real λ whose conjugates count too: two real λ that rounding made a pair, with one member in `values`."""
    return np.flatnonzero(upper(values.conj()) & ~np.isin(values.conj(), values))


def moving(values: Array, bar: Array) -> Array:
    """Which λ differ from 0 by more than rounding (their error `bar`, and the eigensolver's). Rigid motion has λ = 0."""
    return np.abs(values) > bar + 10 * EPS * np.abs(values).max(initial=0.0)


def distance_outside(values: Array, band: Range, re: Range | None = None) -> Array:
    """Distance of each value to the band, the largest over its edges; 0 inside, shape (k,)."""
    height = values.imag if np.iscomplexobj(values) else values
    beyond = np.maximum(band[0] - height, height - band[1])
    if re is not None:
        beyond = np.maximum(beyond, np.maximum(re[0] - values.real, values.real - re[1]))
    return np.maximum(beyond, 0.0)


def widened(limit: float) -> float:
    """The limit up to which to search, so that nothing in a band that ends at `limit` (≥ 0) is missed."""
    return limit * (1 + 4 * DOUBLE)
