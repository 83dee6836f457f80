"""The first steps of a reduction: part, factor, constraint modes and loads; and the space [C Φ Ξ] of the error estimates."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, Matrix
from femsub.errors import SingularMatrixError
from femsub.modes import ShiftInvert

if TYPE_CHECKING:
    from femsub.model import Substructure

COLUMNS = 64  # columns of V that are processed at a time


@dataclass(frozen=True, eq=False)
class Partition:
    """The part of a component whose modes are kept: the `rows` of the interior, with the interface held, or all.

    `factorisations` were made to choose it. With `turn` (n, n) the part is in other coordinates z of the component, x = turn z.
    """

    sub: Substructure
    rows: Array | slice
    factorisations: int = 0
    turn: Matrix | None = None

    @classmethod
    def of(cls, sub: Substructure, held: bool) -> Partition:
        return cls(sub, sub.interior if held and len(sub.interface) else slice(None))

    def factored(self) -> ShiftInvert:
        """The factor of the part, for modes and static solves; a factor made earlier for the same part is reused."""
        try:
            return ShiftInvert(self.sub.K, self.sub.M, self.rows, self.sub.rigid_motion)
        except SingularMatrixError as error:
            raise SingularMatrixError(f"{self.sub.name!r}: {error}") from None


@dataclass(frozen=True, eq=False)
class Statics:
    """The factor, the constraint modes C and the static loads.

    Attributes
    ----------
    handle : ShiftInvert
        Factor of K (or K - σM) of the part.
    constraint, condensed : ndarray, shapes (n, n_c) and (n_c, n_c)
        C and CᵀKC; without columns for Craig-Chang.
    forces : ndarray, shape (n_i, s)
        F, whose static responses join the basis.
    kind : str
        The label of their columns in V.
    rigid : ndarray, shape (n_c, k), or None
        The rigid motions C rigid of the part, beside those of its modes; None where they are not known.
    """

    part: Partition
    handle: ShiftInvert
    constraint: Array
    condensed: Array
    forces: Array
    kind: str
    rigid: Array | None = None

    @classmethod
    def of(cls, part: Partition, handle: ShiftInvert, forces: Array, kind: str) -> Statics:
        """The responses to these forces alone, without constraint modes."""
        return cls(part, handle, zeros(part.sub.size, 0, 0), zeros(0, 0, 0), forces, kind, zeros(0, 0, 0))

    def rigid_in(self, modes: int, size: int) -> Array | None:
        """The rigid motion of the part in [C Φ Ξ], (size, k), the first `modes` columns of Φ being rigid; None if not known."""
        if self.rigid is None:
            return None
        n_c, free = self.rigid.shape
        found = np.zeros((size, free + modes))
        found[:n_c, :free], found[n_c + np.arange(modes), free + np.arange(modes)] = self.rigid, 1.0
        return found

    @cached_property
    def inertia(self) -> Array:
        """MC, shape (n, n_c)."""
        return self.part.sub.M @ self.constraint

    @cached_property
    def rounding(self) -> Array:
        """Rounding error of CᵀKC, shape (n_c, n_c): |E|, positive semidefinite, where E is the difference of two formulas.

        Rigid motion is left out: its condensed stiffness has been set to 0.
        """
        if not len(self.condensed):
            return self.condensed
        E = self.constraint.T @ (self.part.sub.K @ self.constraint) - self.condensed
        bare = self.part.sub.K.diagonal()[self.part.sub.interface]
        unit = np.sqrt(np.where(bare > 0, bare, 1.0))
        stiffness, vectors = np.linalg.eigh(self.condensed / np.outer(unit, unit))
        elastic = vectors[:, stiffness > 1e-14 * stiffness[-1]]
        values, vectors = np.linalg.eigh(elastic.T @ ((E + E.T) / 2 / np.outer(unit, unit)) @ elastic)
        root = unit[:, None] * (elastic @ (vectors * np.sqrt(np.abs(values))))
        return root @ root.T


@dataclass(frozen=True, eq=False)
class Span:
    """U = [C Φ Ξ] (n, R) as an operator: Φ and Ξ are large and have interior rows only, so U is never stored."""

    statics: Statics
    modes: Array
    static: Array

    @property
    def rest(self) -> slice:
        """The columns of Ξ."""
        first = self.statics.constraint.shape[1] + self.modes.shape[1]
        return slice(first, first + self.static.shape[1])

    def dot(self, x: Array) -> Array:
        """Uᵀx, shape (R, k), for x (n, k)."""
        inner = x[self.statics.part.rows]
        return np.concatenate([self.statics.constraint.T @ x, self.modes.T @ inner, self.static.T @ inner])

    def times(self, q: Array) -> Array:
        """Uq, shape (n, k)."""
        first, second = self.statics.constraint.shape[1], self.statics.constraint.shape[1] + self.modes.shape[1]
        u = self.statics.constraint @ q[:first]
        u[self.statics.part.rows] += self.modes @ q[first:second] + self.static @ q[second:]
        return u

    def projected(self, D: Matrix) -> Array:
        """UᵀDU, shape (R, R), a block of columns at a time."""
        return np.hstack([self.dot(D @ block) for block in self._blocks()])

    def _blocks(self) -> Iterator[Array]:
        for group in (self.statics.constraint, self.modes, self.static):
            for start in range(0, group.shape[1], COLUMNS):
                block = group[:, start:start + COLUMNS]
                if group is not self.statics.constraint and len(group) < self.statics.part.sub.size:
                    full = np.zeros((self.statics.part.sub.size, block.shape[1]), order="F")
                    full[self.statics.part.rows] = block
                    block = full
                yield block


def zeros(rows: int, columns: int, room: int) -> Array:
    """Zeros (rows, columns) with memory for `room` more columns behind them, which costs nothing until it is written to."""
    return np.zeros((rows, columns + room), order="F")[:, :columns]


def widened(C: Array, columns: int) -> Array:
    """C and columns of zeros behind it: in its own memory where `zeros` left the room. Of a large interface, a second C would
    cost as much memory as all that follows.
    """
    whole = C.base
    if whole is None or whole.shape[1] < columns:
        whole = np.zeros((len(C), columns), order="F")
        whole[:, :C.shape[1]] = C
    V: Array = whole[:, :columns]
    return V


def square(matrix: Matrix, places: Array) -> Array:
    """The submatrix of the given rows and columns, dense."""
    part = matrix[places][:, places]
    return part.toarray() if sp.issparse(part) else part
