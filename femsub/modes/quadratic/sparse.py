"""Eigenvalues of a sparse pencil nearest to a shift, by SLEPc's PEP (TOAR), with right and left vectors."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from copy import copy
from typing import TYPE_CHECKING

import numpy as np

from femsub.algebra import Handle, SparseFactor, Transposed, quadratic_modes, shared_factor
from femsub.checks import EQUAL, Array
from femsub.errors import MissedModesError, NotConvergedError, SingularMatrixError
from femsub.model import DOUBLE, costs
from femsub.modes.normal_modes import lowest_modes
from femsub.modes.quadratic.matching import SPLIT, clusters, distinct, joined, match
from femsub.modes.shift_invert import ShiftInvert, motion_of

if TYPE_CHECKING:
    from femsub.model import Pencil

# Attempts: tolerance, increment of the random seed, relative increment of the number asked for. TOAR's error estimate is
# optimistic, by five digits at 1e-12 if K is singular. If it fails while reordering a Schur form with equal eigenvalues,
# another start and a larger space usually succeed.
ATTEMPTS = ((1e-14, 0, 0.0), (1e-12, 0, 0.0), (1e-12, 100, 0.15), (1e-12, 200, 0.3))
KEPT = 200_000  # DOF up to which the count, and the memory of its second factor, is the default


class Shifted:
    """The factor of P(σ) of a sparse pencil and a scale for λ. σ = 0 if K is regular, else a small positive shift."""

    def __init__(self, pencil: Pencil) -> None:
        self.pencil = pencil
        self.shift = 0.0
        self.rigid: Array = np.zeros((pencil.size, 0))
        self.handle: ShiftInvert | None = None  # for a floating model: K - σM, positive definite
        symmetric = pencil.symmetric[0] and pencil.symmetric[2]
        self.motion = motion_of(pencil.rigid_motion)
        try:
            if symmetric and self.motion is not None and self.motion.count:
                raise SingularMatrixError("K has rigid motion")
            self.factor = self._factor(0.0, symmetric)
            self.scale = self._scale()
        except SingularMatrixError:
            self.shift = self.scale = self._free_shift(symmetric)
            self.factor = self._factor(self.shift, symmetric and pencil.symmetric[1])

    def _factor(self, shift: float, symmetric: bool) -> SparseFactor | Transposed:
        matrix = self.pencil.at(shift) if shift else self.pencil.K
        found: Handle | None = None
        if symmetric and matrix.diagonal().min() > 0:
            with suppress(SingularMatrixError):
                found = shared_factor(matrix, "definite")
        found = found or shared_factor(matrix, "symmetric" if symmetric else "general")
        assert isinstance(found, SparseFactor)
        return found

    @property
    def definite(self) -> tuple[Callable[[Array], Array], float] | None:
        """The solver of K + μM, positive definite, and μ, where its factor is there; else None."""
        if self.shift == 0:
            return (self.factor.solve, 0.0) if self.factor.kind == "definite" else None
        return None if self.handle is None else (self.handle.factor.solve, -self.handle.sigma)

    def _scale(self) -> float:
        """The size of the smallest eigenvalues, min(‖K⁻¹M‖^-½, ‖K⁻¹D‖^-1), by a few power steps."""
        x = np.random.default_rng(5).standard_normal((self.pencil.size, 2))
        growth = np.ones(2)
        for _ in range(4):
            x = self.factor.solve(np.stack([self.pencil.M @ x[:, 0], self.pencil.D @ x[:, 1]], axis=1))
            growth = np.linalg.norm(x, axis=0)
            x = x / np.where(growth > 0, growth, 1.0)
        if growth[0] * self.pencil.norms[2] > 1e15 * self.pencil.norms[0]:
            raise SingularMatrixError("K is singular to working precision")
        with np.errstate(divide="ignore"):
            return float(min(growth[0] ** -0.5, 1 / growth[1]))

    def _free_shift(self, symmetric: bool) -> float:
        """Half of the first elastic frequency if K and M are symmetric; else from the smallest k_ii / m_ii."""
        if symmetric:
            handle = ShiftInvert(self.pencil.K, self.pencil.M, carried=self.pencil.rigid_motion)
            self.rigid = handle.rigid
            if self.motion is None:
                self.motion = handle.motion(self.pencil.D)
                self.rigid = self.motion.shapes
            if self.pencil.size <= KEPT:
                self.handle = handle
            return 0.5 * float(lowest_modes(handle, 1).frequencies[-1])
        stiffness, mass = np.abs(self.pencil.K.diagonal()), self.pencil.M.diagonal()
        loaded = (stiffness > 0) & (mass > 0)
        if not loaded.any():
            raise SingularMatrixError("K is singular, and no DOF has both mass and stiffness, so no shift can be chosen. Check K "
                                      "and M")
        return 1e-2 * float(np.sqrt((stiffness[loaded] / mass[loaded]).min()))

    def nearest(self, count: int, seed: int = 1) -> tuple[Array, Array]:
        """At least `count` eigenvalues nearest to the shift, with shapes, without duplicates. Only Im λ ≥ 0 is listed."""
        pencil = self.pencil
        matrices = (pencil.M, pencil.D, pencil.K)
        for tol, start, room in ATTEMPTS:
            ask = min(count + int(np.ceil(room * count)), 2 * pencil.size)
            try:
                values, X = quadratic_modes(self.factor, matrices, self.shift, ask, tol=tol, scale=self.scale, seed=seed + start)
                break
            except NotConvergedError as error:
                last = error
        else:
            raise last
        values, X = distinct(values, X)
        if self.rigid.shape[1]:
            # those of rigid motion are exactly 0: n_r, and one more for each that D does not damp. The solver returns a multiple
            # eigenvalue split by rounding
            assert self.motion is not None
            number, order = self.motion.zeros, np.argsort(np.abs(values), kind="stable")
            of = np.cumsum(1 + (values[order].imag != 0))
            drop = order[:int(np.searchsorted(of, number)) + 1]
            if of[len(drop) - 1] != number or np.abs(values[drop]).max() > 0.1 * self.shift:
                raise MissedModesError(f"{number} eigenvalues must be 0 because of {self.rigid.shape[1]} rigid-body modes, but "
                                       f"those nearest to 0 are {values[drop]}. Ask for more eigenvalues")
            keep = np.setdiff1d(np.arange(len(values)), drop)
            shapes = self.rigid[:, np.arange(number) % self.rigid.shape[1]]
            values, X = np.append(values[keep], np.zeros(number)), np.hstack([X[:, keep], shapes])
        elif self.shift:
            still = np.flatnonzero(np.abs(values) < 1e-5 * self.shift)
            still = still[costs(pencil.K, X[:, still])[0] <= EQUAL]
            both = still[values[still].imag != 0]  # their conjugates are 0 as well
            values[still] = 0.0
            if len(both):
                values, X = np.append(values, values[both]), np.hstack([X, X[:, both].conj()])
        return values, X / np.linalg.norm(X, axis=0)

    def left(self, values: Array, X: Array, ask: int, searches: int) -> Array:
        """Left vectors y, yᴴP(λ) = 0: x̄ for a symmetric pencil, else from the transposed one, matched by λ.

        `ask` and `searches` are those of the search for the right vectors. If no counterpart is found, the column is zero,
        which makes its error bar infinite.
        """
        if all(self.pencil.symmetric):
            return X.conj()
        other = copy(self)
        other.pencil, other.factor = self.pencil.transposed(), self.factor.transposed
        found, vectors = other.nearest(ask)
        for seed in range(2, searches + 1):  # each from another start
            found, vectors = joined(found, vectors, *other.nearest(ask, seed))
        Y = np.zeros_like(X)
        at, to = match(values, found, far=2 * SPLIT)
        near = np.abs(found[to] - values[at]) <= SPLIT * np.maximum(np.abs(values[at]), self.shift)
        Y[:, at[near]] = vectors[:, to[near]].conj()
        return Y


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
