"""Removal of Lagrange multipliers μ from a pencil: (λ²M + λD + K)x + Cμ = 0, Bx = 0, so that x = X q."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.algebra import (
    Equations,
    comparable,
    eliminate,
    is_symmetric,
    known_sums,
    product,
    rows_of_zeros,
    same,
    unit_length,
    units,
)
from femsub.checks import Array, Matrix, SingularMatrixError, empty_dofs_error
from femsub.model.rigid_motion import Restricted, changed

if TYPE_CHECKING:
    from femsub.model.pencil import Pencil


@dataclass(frozen=True, eq=False)
class Freed:
    """The pencil YᵀP(λ)X (k, k) on the motions X (n, k) that the constraints allow. Its λ are all finite λ of P.

    In `whole`, the rows `held` are the constraints and the columns `held` the multipliers. `rest` are the other rows and columns.
    Y = X if the constraint forces are Bᵀμ.
    """

    whole: Pencil
    pencil: Pencil
    held: Array
    rest: Array
    X: Matrix
    Y: Matrix

    def shapes(self, values: Array, q: Array, w: Array) -> tuple[Array, Array]:
        """Right and left shapes (n, m) of unit length of the whole pencil, multipliers included, from those on X and Y."""
        right = self._with_forces(self.whole, values, self.X @ q)
        if self.X is self.Y and all(self.whole.symmetric) and np.array_equal(w, q.conj()):
            return right, right.conj()
        return right, self._with_forces(self.whole.transposed(), values.conj(), self.Y @ w)

    def _with_forces(self, pencil: Pencil, values: Array, x: Array) -> Array:
        """x (k, m) and the multipliers μ with Cμ = -P(λ)x, by least squares in units of energy."""
        from scipy.sparse.linalg import splu

        found = np.zeros((pencil.size, len(values)), dtype=complex)
        found[self.rest] = x
        unit = comparable(units(pencil.M.diagonal(), pencil.K.diagonal())[0][self.rest])
        C = sp.csc_array(sp.csr_array(pencil.K)[self.rest][:, self.held].multiply(unit[:, None]))
        size = np.sqrt(C.multiply(C).sum(axis=0))
        C = sp.csc_array(C / size)
        factor = splu(sp.csc_array(C.T @ C))
        for _ in range(2):  # the second step removes the error from the squared condition number
            force = C.T @ (unit[:, None] * pencil.residual(values, found)[self.rest])
            found[self.held] -= (factor.solve(force.real) + 1j * factor.solve(force.imag)) / size[:, None]
        return unit_length(found)


def freed(pencil: Pencil) -> Freed | None:
    """The pencil without its multipliers, or None if it has none.

    Raises
    ------
    SingularMatrixError
        The constraints depend on each other, so that det P(λ) = 0 for every λ, or they leave no motion.
    """
    held = _multipliers(pencil)
    if not len(held):
        return None
    if len(empty := rows_of_zeros(pencil.K, among=held)):
        raise empty_dofs_error(len(empty), (f"DOF {row}" for row in empty))
    rest, K = np.setdiff1d(np.arange(pencil.size), held), sp.csr_array(pencil.K)
    B, C = sp.csr_array(K[held][:, rest]), sp.csr_array(K[rest][:, held].T)
    unit = comparable(units(pencil.M.diagonal(), pencil.K.diagonal())[0][rest])
    X = _motions(B, unit, held)
    Y = X if same(B, C) else _motions(C, unit, held)
    if not X.shape[1]:
        raise SingularMatrixError(f"the {len(held)} constraints leave no motion to the other {len(rest)} DOF, so there are no "
                                  "eigenvalues")
    free = _projected(pencil, rest, X, Y)
    free = free.carrying(changed(pencil.rigid_motion, Restricted(X, rest)), abs(X).T @ pencil.noise[rest])
    return Freed(pencil, free, held, rest, X, Y)


def _multipliers(pencil: Pencil) -> Array:
    """DOF without mass, damping and stiffness of their own, whose rows of K are constraints on the others."""
    still = np.flatnonzero((pencil.K.diagonal() == 0) & (pencil.M.diagonal() == 0) & (pencil.D.diagonal() == 0))
    if not len(still):
        return still
    for part in (pencil.M, pencil.D):
        size = abs(part)
        still = still[np.asarray(size.sum(axis=0) + size.sum(axis=1))[still] == 0]
    among = sp.csr_array(sp.csr_array(pencil.K)[still][:, still])
    linked, taken = sp.csr_array(abs(among) + abs(among.T)), np.ones(len(still), dtype=bool)
    for row in np.flatnonzero(np.diff(linked.indptr)):  # if two candidates are coupled, one of them is an ordinary DOF
        others = linked.indices[linked.indptr[row]:linked.indptr[row + 1]]
        taken[row] = not taken[others[others < row]].any()
    return still[taken]


def _motions(B: Matrix, unit: Array, held: Array) -> Matrix:
    """X (n, k), sparse, that spans all x with Bx = 0."""
    found = eliminate(Equations(B, unit, np.zeros(len(unit), dtype=bool), held), lambda *_: None)
    if found.redundant:
        raise SingularMatrixError(f"{found.redundant} of the {len(held)} constraints (DOF with neither mass, damping nor "
                                  "stiffness of their own) follow from the others or constrain nothing, so the pencil is "
                                  "singular for every λ. Leave them out, or join parts by couple, which does so")
    return found.L


def _projected(pencil: Pencil, rest: Array, X: Matrix, Y: Matrix) -> Pencil:
    """YᵀP(λ)X. Entries that are only the rounding of a sum are set to exact zeros."""
    def between(A: Matrix) -> Matrix:
        own = A[rest][:, rest] if sp.issparse(A) else A[np.ix_(rest, rest)]
        found = product(Y.T, product(own, X))
        size = product(abs(Y.T), product(abs(own), abs(X)))
        found = known_sums(found, size)
        return (found + found.T) / 2 if X is Y and is_symmetric(own) else found

    found = type(pencil)(*(between(A) for A in (pencil.M, pencil.D, pencil.K)))
    if X is not Y or (not pencil.contacts and pencil.K0 is pencil.K):
        return found
    return found._with(contacts=tuple((*C, X.T @ W[rest]) for *C, W in pencil.contacts),
                       K0=found.K if pencil.K0 is pencil.K else between(pencil.K0))
