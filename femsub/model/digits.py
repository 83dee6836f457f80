"""How well the entries of K are known: what distinguishes the rounding of a written or roughly assembled K from a soft mount."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from femsub.checks import EPS, Array, Matrix

ROUGH = 512 * EPS  # sums of rows that are smaller are rounding of a good assembly
SEEN = 1e-6  # largest share of K's entries that is taken for rounding
ALONG = 0.5  # share of the absolute sum from which forces add up, as those of a mount do; those of rounding do not
SLACK = 4.0  # rounding of K along rotations may be larger than along translations
MANY = 200_000  # entries of a sparse K from which some are left out at once
SAMPLE, FEW = 2000, 10  # entries that are looked at; different ones that are needed
TYPICAL = 0.125  # of the last digit, since many roundings of either sign add up in a mode
DIGITS = range(5, 15)  # decimal digits of a written K; numbers with fewer may be round by themselves
DUST = 64 * EPS  # of the largest entry: smaller ones are rounding themselves
BITS = np.finfo(np.float32).nmant + 1  # of a number in single precision


def rounding_of(K: Matrix, t: Array, forces: tuple[Array, Array] | None = None) -> float:
    """The relative rounding u of the entries of K that its own figures show: eps, or more.

    Two figures show more. Entries that all end after as many digits were written so. In a free body the rows of K sum to 0
    along each translation t (n, k); sums of either sign are rounding, while those of a soft mount add up. `forces` are Kt and
    |K|t, where they are known.
    """
    sums, size = forces or (K @ t, abs(K) @ t)
    ratio = np.divide(np.abs(sums), size, out=np.zeros_like(size), where=size > 0).max(axis=0, initial=0.0)
    seen = (SLACK * ratio > ROUGH) & (ratio <= SEEN)
    along, most = t[:, seen] * sums[:, seen], float(ratio[seen].max(initial=0.0))
    entries = K.data[::max(1, K.nnz // MANY)] if sp.issparse(K) else K.ravel()
    written = max(map(_written, (entries, entries[entries < 0])))  # columns of a fixed width leave negative ones a digit less
    if (along.sum(axis=0) > ALONG * np.abs(along).sum(axis=0)).any():
        # springs to the ground; or a regular mesh, where rounding is the same at many nodes: at most half of the last digit
        return written if most <= 0.5 / TYPICAL * written else EPS
    return max(EPS, written, SLACK * most)


def _written(entries: Array, most: float = 0.95) -> float:
    """u of entries written in single precision, or with 5 to 14 decimal digits; 0 if they hold more.

    It is that of `most` of the entries, not of all: springs that were added later may have more digits.
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
    """a_ij / √(a_ii a_jj). Where a diagonal entry is not positive, the largest of its row stands for it."""
    diagonal, size = A.diagonal(), np.abs(A).max(axis=0, initial=0.0)
    unit = np.where(diagonal > 0, diagonal, np.where(size > 0, size, 1.0)) ** -0.5
    return A * np.outer(unit, unit)


def over_diagonal(difference: Array, A: Array, rounding: Array | float = 0.0) -> Array:
    """|Δ_ij| over √(a_ii a_jj); what is within the rounding counts as none."""
    size = np.sqrt(np.abs(A.diagonal()))
    size = np.where(size > 0, size, EPS * size.max(initial=0.0))
    beyond = np.maximum(np.abs(difference) - rounding, 0.0)
    return np.divide(beyond, np.outer(size, size), out=np.where(beyond > 0, np.inf, 0.0), where=np.outer(size, size) > 0)
