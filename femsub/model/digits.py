"""The accuracy of K's entries: it distinguishes the rounding of a written or roughly assembled K from a soft mount."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from femsub.checks import EPS, Array, Matrix

ROUGH = 512 * EPS  # smaller relative row sums are the rounding of a good assembly
SEEN = 1e-6  # larger relative row sums are not taken for rounding
ALONG = 0.5  # |Σ forces| / Σ|forces| above which they are those of a mount: forces from rounding nearly cancel
SLACK = 4.0  # rounding of K along rotations may be larger than along translations
MANY = 200_000  # of a sparse K with more entries, only about this many are read
SAMPLE, FEW = 2000, 10  # entries whose digits are counted; the least number of different entries for a verdict
TYPICAL = 0.125  # typical rounding error as a share of the last digit, since many roundings of either sign add up in a mode
DIGITS = range(5, 15)  # decimal digits of a written K; numbers with fewer may be round by themselves
DUST = 64 * EPS  # share of the largest entry: smaller entries are rounding themselves
BITS = np.finfo(np.float32).nmant + 1  # significant bits of a number in single precision


def rounding_of(K: Matrix, t: Array, forces: tuple[Array, Array] | None = None) -> float:
    """The relative rounding u of the entries of K, as found from K itself: eps, or more.

    Two properties of K show a larger rounding. If all entries have the same number of digits, K was written with these digits.
    In a free body the rows of K sum to 0 along each translation t (n, k): row sums of both signs are rounding, while the row
    sums of a soft mount have one sign. `forces` are Kt and |K|t, if they are known.
    """
    sums, size = forces or (K @ t, abs(K) @ t)
    ratio = np.divide(np.abs(sums), size, out=np.zeros_like(size), where=size > 0).max(axis=0, initial=0.0)
    seen = (SLACK * ratio > ROUGH) & (ratio <= SEEN)
    along, most = t[:, seen] * sums[:, seen], float(ratio[seen].max(initial=0.0))
    entries = K.data[::max(1, K.nnz // MANY)] if sp.issparse(K) else K.ravel()
    written = max(map(_written, (entries, entries[entries < 0])))  # in columns of fixed width, negative numbers have a digit less
    if (along.sum(axis=0) > ALONG * np.abs(along).sum(axis=0)).any():
        # springs to the ground; or a regular mesh, where rounding is the same at many nodes: at most half of the last digit
        return written if most <= 0.5 / TYPICAL * written else EPS
    return max(EPS, written, SLACK * most)


def _written(entries: Array, most: float = 0.95) -> float:
    """The rounding u of entries written in single precision, or with 5 to 14 decimal digits; 0 if they have more digits.

    The share `most` of the entries decides, not all of them: springs that were added later may have more digits.
    """
    size = np.abs(entries)
    size = size[size > DUST * size.max(initial=0.0)]
    values = np.unique(size[::max(1, len(size) // SAMPLE)])
    if len(values) < FEW:
        return 0.0
    bits = np.frexp(values)[0] * 2.0**BITS
    if np.mean(bits == np.rint(bits)) > most and np.mean(bits % 8 != 0) > 0.5:
        return TYPICAL * 2.0 ** (1 - BITS)
    digits = np.array([len(repr(value).split("e")[0].replace(".", "").strip("0")) for value in values.tolist()])
    longest = int(np.quantile(digits, most))
    return TYPICAL * 10.0 ** (1 - longest) if longest in DIGITS and np.mean(digits >= longest - 1) > 0.5 else 0.0


def by_diagonal(A: Array) -> Array:
    """a_ij / √(a_ii a_jj). A diagonal entry that is not positive is replaced by the largest |a_ij| of its column."""
    diagonal, size = A.diagonal(), np.abs(A).max(axis=0, initial=0.0)
    unit = np.where(diagonal > 0, diagonal, np.where(size > 0, size, 1.0)) ** -0.5
    return A * np.outer(unit, unit)


def over_diagonal(difference: Array, A: Array, rounding: Array | float = 0.0) -> Array:
    """|Δ_ij| / √(a_ii a_jj); differences within `rounding` count as 0."""
    size = np.sqrt(np.abs(A.diagonal()))
    size = np.where(size > 0, size, EPS * size.max(initial=0.0))
    beyond = np.maximum(np.abs(difference) - rounding, 0.0)
    return np.divide(beyond, np.outer(size, size), out=np.where(beyond > 0, np.inf, 0.0), where=np.outer(size, size) > 0)
