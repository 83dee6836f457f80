"""Equal and almost equal eigenvalues: two spectra are matched, duplicates are removed, several searches are merged."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from femsub.algebra import unit_length
from femsub.checks import EPS, EQUAL, Array
from femsub.errors import NotConvergedError
from femsub.model import DOUBLE

HALF = EPS**0.5  # half of the digits: what is known to fewer is poor, and eigenvalues nearer than this are one to first order
#: Two results for one eigenvalue may differ by this, λ relative to |λ| and unit shapes in the remainder of one beside others. The
#: residual of a search is HALF at worst, and a defective double eigenvalue and its shape are known to the root of it.
SPLIT = HALF**0.5


class Search:
    """Eigenvalues nearest to a shift, by several searches from different starts; their results are merged.

    Parameters
    ----------
    nearest : callable (number, seed) → λ (k,), X (n, k)
        Makes one search.
    size : int
        n.
    most : int
        Searches at most. Each other start finds one more direction of an eigenspace by itself; four were always enough.

    `searches` is the number so far, `ask` the last number asked.
    """

    def __init__(self, nearest: Callable[[int, int], tuple[Array, Array]], size: int, most: int = 4) -> None:
        self.nearest, self.size, self.most, self.searches, self.ask = nearest, size, most, 1, 0
        self.pool: tuple[Array, Array] = np.zeros(0), np.zeros((size, 0))

    @property
    def exhausted(self) -> bool:
        return self.searches >= self.most

    def found(self, ask: int) -> tuple[Array, Array]:
        """λ and X of a search for `ask` eigenvalues."""
        if ask != self.ask:
            new = self.nearest(ask, self.searches)
            self.pool = joined(*self.pool, *new) if self.searches > 1 else new
            self.ask = ask
        return self.pool

    def more(self, ask: int, missed: int) -> int:
        """The number to ask for in a new search if `missed` eigenvalues are missing."""
        self.searches, self.ask = self.searches + 1, 0
        return min(ask + 2 * missed + 10, 2 * self.size)

    def settled(self) -> bool:
        """Whether all clusters are complete: there is none, or another search finds the same eigenvalues."""
        values, X = self.pool
        if self.exhausted or not clusters(values[values != 0], DOUBLE):
            return True
        self.searches += 1
        with suppress(NotConvergedError):
            self.pool = joined(values, X, *self.nearest(self.ask, self.searches))
        return len(self.pool[0]) == len(values)


def match(reference: Array, values: Array, alike: Array | None = None, *, weight: float = 0.05,
          far: float | None = None) -> tuple[Array, Array]:
    """The one-to-one assignment of two spectra with the least sum of `pair_costs`: indices into both."""
    return assigned(pair_costs(reference, values, alike, weight=weight, far=far))


def pair_costs(reference: Array, values: Array, alike: Array | None = None, *, weight: float = 0.05,
               far: float | None = None) -> Array:
    """|Δλ| + weight |λ| (1 - MAC); with `far` min(|Δλ| / |λ|, far) + weight (1 - MAC), shape (k, l).

    `far` limits the cost of an eigenvalue without a counterpart, so that it does not change the assignment of others.

    Parameters
    ----------
    reference, values : ndarray, shapes (k,) and (l,)
    alike : ndarray, shape (k, l), optional
        The MAC of the shapes, which decides between close frequencies; NaN means no cost.
    weight : float
        |Δλ| / |λ| that costs as much as a MAC of 0. By default as far apart as modes change places between two models.
    far : float, optional
        The largest |Δλ| / |λ| that counts.
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


def distinct(values: Array, X: Array) -> tuple[Array, Array]:
    """λ (k,) and X (n, k) without duplicates: eigenpairs whose eigenvalue and shape are listed already.

    A duplicate could hide a missing eigenvalue when numbers are compared. Two equal real eigenvalues that rounding has turned
    into a pair, of which only Im λ > 0 is listed, become two again, with Re x and Im x.
    """
    false = np.flatnonzero((values.imag != 0) & (np.abs(values.imag) <= EQUAL * np.abs(values)))
    parts = (np.column_stack([x.real, x.imag]) for x in unit_length(X[:, false]).T)
    false = false[np.array([la.svdvals(part)[1] > SPLIT for part in parts], dtype=bool)]
    if len(false):
        values, X = np.append(values, values[false].real), np.hstack([X, X[:, false].imag])
        values[false], X[:, false] = values[false].real, X[:, false].real
        X = unit_length(X)
    keep = np.ones(len(values), dtype=bool)
    for group in clusters(values, EQUAL):
        if values[group[0]] == 0:
            continue  # rigid-body motion: its number is known
        R, order = la.qr(unit_length(X[:, group]), mode="r", pivoting=True, check_finite=False)
        small = np.abs(R.diagonal()) <= SPLIT
        keep[group[order[len(small) - np.count_nonzero(small):]]] = False
    return (values, X) if keep.all() else (values[keep], X[:, keep])


def joined(values: Array, X: Array, more: Array, Y: Array) -> tuple[Array, Array]:
    """The eigenpairs (λ, X) of one search together with the new ones of another search, (more, Y).

    A search from one start vector finds one direction of each eigenspace, and others only by rounding. Another start finds
    others. In a known cluster only shapes outside its span are new.
    """
    known = len(values)
    both, new = np.append(values, more), np.ones(len(more), dtype=bool)
    for group in clusters(both, SPLIT):
        old, late = group[group < known], group[group >= known] - known
        if not len(old) or not len(late):
            continue
        if both[group[0]] == 0:
            new[late] = False
            continue
        Q = la.qr(X[:, old], mode="economic", check_finite=False)[0]
        for j in late:
            rest = Y[:, j] / np.linalg.norm(Y[:, j])
            for _ in range(2):
                rest = rest - Q @ (Q.conj().T @ rest)
            length = np.linalg.norm(rest)
            new[j] = length > SPLIT
            if new[j]:
                Q = np.column_stack([Q, rest / length])
    return np.append(values, more[new]), np.hstack([X, Y[:, new]])


def clusters(values: Array, radius: float) -> list[Array]:
    """Clusters of values (k,) connected by relative distances ≤ radius: indices of groups of two or more; zeros are one group."""
    from scipy.spatial import cKDTree

    size = np.abs(values)
    zeros, at = np.flatnonzero(size == 0), np.flatnonzero(size)
    found = [zeros] if len(zeros) > 1 else []
    if len(at) > 1:
        relative = np.stack([np.log(size[at]), np.angle(values[at])], axis=1)
        pairs = cKDTree(relative).query_pairs(radius, output_type="ndarray")
        links = sp.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(at), len(at)))
        label = sp.csgraph.connected_components(links, directed=False)[1]
        order = np.argsort(label, kind="stable")
        groups = np.split(at[order], np.flatnonzero(np.diff(label[order])) + 1)
        found += [group for group in groups if len(group) > 1]
    return found


def clear_radius(size: Array, count: int) -> float:
    """A radius at which the first `count` eigenvalues can be counted, given the sizes |λ|, ascending (k,).

    It lies in the widest gap behind them. If there is no gap, because they end inside a cluster, it lies just below the
    cluster. Then no smaller eigenvalue is missing, and any member of the cluster may be listed.
    """
    tail = size[count - 1:]
    if len(tail) > 1 and tail[-1] > 0:
        floor = np.maximum(tail, 1e-3 * tail[-1])
        ratios = floor[1:] / floor[:-1]
        at = int(np.argmax(ratios))
        if ratios[at] > 1 + DOUBLE:
            return float(np.sqrt(floor[at] * floor[at + 1]))
    gaps = np.flatnonzero(np.diff(size[:count]) > DOUBLE * size[1:count])
    return float(size[gaps[-1] + 1 if len(gaps) else 0] * (1 - DOUBLE / 2))
