"""Finds smaller models that cannot meet a tolerance, without solving them.

A smaller model is the larger model under constraints Nᵀx = 0, one for each mode left out. All eigenpairs of the larger model are
known. The number of eigenvalues of the smaller model below λ = ω² is that of the larger model, minus the number of negative
eigenvalues of

    G(λ) = Nᵀ(K - λM)⁻¹N = Σ_k (φ_kᵀN)ᵀ(φ_kᵀN) / (ω_k² - λ).

This follows from Sylvester's law of inertia. The search changes the number of modes of one part at a time. Without this test, a
system of many parts would be solved at least once for each part. The size of G is the number of modes left out.

References
----------
W. H. Wittrick, F. W. Williams, Q. J. Mech. Appl. Math. 24 (1971) 263.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from femsub.checks import EQUAL, Array
from femsub.model import Estimate, beyond
from femsub.reduction.estimates.nested import MARGIN, Nested


@dataclass(frozen=True, eq=False)
class LeavingOut:
    """A model with `counts` modes of each part, and the highest ω that each mode of a smaller model may have.

    Attributes
    ----------
    inverse : ndarray, shape (r,)
        1/ω² of the model. Rigid-body motion counts as vibration at twice the limit.
    shapes : ndarray, shape (r, r)
        Mode shapes as columns, of unit elastic energy.
    static : ndarray, shape (R, s)
        The static shapes of the model in the coordinates of the reference.
    most : ndarray, shape (k,)
        The largest ω² with which the modes `first`, `first` + 1, … meet the tolerance.
    """

    nested: Nested
    counts: Array
    inverse: Array
    shapes: Array
    static: Array
    first: int
    most: Array

    @classmethod
    def of(cls, nested: Nested, counts: Array, goal: Estimate) -> LeavingOut | None:
        """None if the test is not possible: without a limit, without an interface, or if K is not positive definite."""
        if not np.isfinite(nested.limit) or not nested.constraint:
            return None
        T, M, K = nested.model(counts)
        try:
            inverse, shapes = la.eigh(*nested.pencil_up_to_limit(M, K), check_finite=False)
        except la.LinAlgError:
            return None
        S = T[:, nested.rest.start - nested.modes + np.count_nonzero(nested.held(counts)):]
        low, high = nested.bounds, nested.largest[0]
        known = min(len(low), len(high))
        inside = np.flatnonzero(~beyond(low[:known], goal.band[1]) & ~beyond(goal.band[0], high[:known]))
        most = (low[inside] * (1 + goal.tol / MARGIN) * (1 + EQUAL)) ** 2
        return cls(nested, counts, inverse, shapes, S, int(inside[0]) if len(inside) else 0, most)

    def may_meet(self, counts: Array) -> bool:
        """False if some ω of a model with fewer modes is certainly too high.

        The smaller model has Nᵀx = 0. The columns of N (r, l) are K w for directions w that are K-orthogonal to the smaller
        model. Its static shapes still represent a part of a mode φ that it leaves out. Therefore w = φ + Sβ.
        """
        if not len(self.most):
            return True
        nested, first = self.nested, self.nested.rest.start - self.nested.modes
        held = nested.held(self.counts)
        left = np.flatnonzero(held & ~nested.held(counts))
        stiffness = nested.K.diagonal()[:, None]  # of Φ and Ξ: w has no other components
        W = np.zeros((len(nested.M), len(left)))
        W[first + left, np.arange(len(left))] = 1.0
        if nested.loads.shape[1]:
            new = nested.static(counts)[0]
            if self.static.shape[1] != new.shape[1]:
                return True
            force = stiffness * new
            W -= self.static @ np.linalg.solve(force.T @ self.static, force.T @ W)
        force = stiffness * W
        N = np.concatenate([force[:first], force[first + np.flatnonzero(held)], self.static.T @ force])
        along = self.shapes.T @ N
        for number, square in enumerate(self.most, self.first + 1):
            far = 1 - square * self.inverse
            far[far == 0] = np.finfo(float).tiny
            terms = along / far[:, None]
            G = along.T @ terms
            least = EQUAL * float(np.abs(along * terms).sum(axis=0).max())
            lost = np.count_nonzero(np.linalg.eigvalsh((G + G.T) / 2) < -least)
            if np.count_nonzero(far < 0) - lost < number:
                return False
        return True
