"""What a method knows of a component before it has modes, and the wide spaces that a search for their number spans."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from femsub.checks import Array, Matrix
from femsub.model.substructure import Substructure
from femsub.modes.shift_invert import ShiftInvert
from femsub.reduction.basis import COLUMNS


@dataclass(frozen=True, eq=False)
class Parts:
    """The factor, the constraint modes C and the static loads.

    Attributes
    ----------
    handle : ShiftInvert
        Of K and M within `rows`: the interior (Craig-Bampton), or all.
    constraint, condensed : ndarray, shapes (n, n_c) and (n_c, n_c)
        C and CᵀKC; without columns for Craig-Chang.
    forces : ndarray, shape (n_i, s)
        F, whose static responses join the basis.
    """

    sub: Substructure
    handle: ShiftInvert
    rows: Array | slice
    constraint: Array
    condensed: Array
    forces: Array

    @cached_property
    def inertia(self) -> Array:
        """MC, shape (n, n_c)."""
        return self.sub.M @ self.constraint

    @cached_property
    def rounding(self) -> Array:
        """|E| (n_c, n_c), positive semidefinite, of what CᵀKC may be off by: two formulas for it differ by E.

        Rigid motion is left out, of which the condensed stiffness has been cleaned.
        """
        if not len(self.condensed):
            return self.condensed
        E = self.constraint.T @ (self.sub.K @ self.constraint) - self.condensed
        bare = self.sub.K.diagonal()[self.sub.interface]
        unit = np.sqrt(np.where(bare > 0, bare, 1.0))
        stiffness, vectors = np.linalg.eigh(self.condensed / np.outer(unit, unit))
        elastic = vectors[:, stiffness > 1e-14 * stiffness[-1]]
        values, vectors = np.linalg.eigh(elastic.T @ ((E + E.T) / 2 / np.outer(unit, unit)) @ elastic)
        root = unit[:, None] * (elastic @ (vectors * np.sqrt(np.abs(values))))
        return root @ root.T


@dataclass(frozen=True, eq=False)
class Span:
    """U = [C Φ Ξ] (n, R) that is never formed: Φ and Ξ have the rows of the interior only, and are large."""

    parts: Parts
    modes: Array
    static: Array

    def dot(self, x: Array) -> Array:
        """Uᵀx, shape (R, k), for x of all rows."""
        inner = x[self.parts.rows]
        return np.concatenate([self.parts.constraint.T @ x, self.modes.T @ inner, self.static.T @ inner])

    def times(self, q: Array) -> Array:
        """Uq, shape (n, k)."""
        first, second = self.parts.constraint.shape[1], self.parts.constraint.shape[1] + self.modes.shape[1]
        u = self.parts.constraint @ q[:first]
        u[self.parts.rows] += self.modes @ q[first:second] + self.static @ q[second:]
        return u

    def projected(self, D: Matrix) -> Array:
        """UᵀDU, shape (R, R), a block of columns at a time."""
        return np.hstack([self.dot(D @ block) for block in self._blocks()])

    def _blocks(self) -> Iterator[Array]:
        for group in (self.parts.constraint, self.modes, self.static):
            for start in range(0, group.shape[1], COLUMNS):
                block = group[:, start:start + COLUMNS]
                if group is not self.parts.constraint and len(group) < self.parts.sub.size:
                    full = np.zeros((self.parts.sub.size, block.shape[1]), order="F")
                    full[self.parts.rows] = block
                    block = full
                yield block
