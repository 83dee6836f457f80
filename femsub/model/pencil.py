"""The quadratic pencil λ²M + λD + K: the input of every stability analysis, for full and reduced models alike."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, Matrix
from femsub.model.frozen import Frozen
from femsub.model.matrices import as_matrix, equilibration, is_symmetric, norm, scaled, without_rounding

SPREAD = 16.0  # ratio of the DOF's scales above which a sparse pencil is rescaled


@dataclass(frozen=True, eq=False, repr=False)
class Pencil(Frozen):
    """A quadratic eigenvalue problem, given by its matrices: P(λ) = λ²M + λD + K.

    M, D and K are real, of shape (n, n), sparse or dense, symmetric or not.

    Parameters
    ----------
    M, D, K : array_like or sparse, shape (n, n)
        Mass, damping and stiffness in any consistent units; λ then comes in radians per unit of time.
        ``D=None`` means no damping. If one of the three is dense, all are kept dense.

    Attributes
    ----------
    symmetric : (bool, bool, bool)
        Whether M, D and K are exactly symmetric.
    contacts : tuple of (float, ndarray)
        (c, W) of each term cWWᵀ that `with_contact` has added to D. Rounding hides their low rank in D itself.

    Raises
    ------
    InputError, InputTypeError
        Shapes that do not fit, NaN or Inf, complex entries.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.Pencil([[1, 0], [0, 1]], None, [[2, -1], [-1, 1]])
    Pencil: 2 DOF, dense, all symmetric
    """

    M: Matrix
    D: Matrix
    K: Matrix
    symmetric: tuple[bool, bool, bool] = field(init=False)
    contacts: tuple[tuple[float, Array], ...] = field(init=False)

    def __init__(self, M: Any, D: Any, K: Any) -> None:
        mass = as_matrix("M", M)
        stiffness = as_matrix("K", K, mass.shape[0])
        damping = sp.csr_array(mass.shape) if D is None else as_matrix("D", D, mass.shape[0])
        parts = (mass, damping, stiffness)
        if not all(sp.issparse(part) for part in ((mass, stiffness) if D is None else parts)):
            parts = tuple(part.toarray() if sp.issparse(part) else part for part in parts)
        checked, flags = zip(*(without_rounding(part) for part in parts), strict=True)
        self._set(**dict(zip("MDK", checked, strict=True)), symmetric=flags, contacts=())

    def __repr__(self) -> str:
        kind = "sparse" if self.is_sparse else "dense"
        odd = [name for name, flag in zip("MDK", self.symmetric, strict=True) if not flag]
        return f"Pencil: {self.size} DOF, {kind}, {'all symmetric' if not odd else ' and '.join(odd) + ' unsymmetric'}"

    @property
    def size(self) -> int:
        return int(self.M.shape[0])

    @property
    def is_sparse(self) -> bool:
        return bool(sp.issparse(self.K))

    @cached_property
    def norms(self) -> tuple[float, float, float]:
        """Upper bounds of ‖M‖₂, ‖D‖₂ and ‖K‖₂ (see `norm`)."""
        return norm(self.M), norm(self.D), norm(self.K)

    def dense(self) -> Pencil:
        """The same pencil with dense matrices."""
        return Pencil(*(part.toarray() for part in (self.M, self.D, self.K))) if self.is_sparse else self

    def sparse(self) -> Pencil:
        """The same pencil with sparse matrices."""
        if self.is_sparse:
            return self
        return Pencil(*(sp.csr_array(part) for part in (self.M, self.D, self.K)))._with(contacts=self.contacts)

    def _with(self, **changed: Any) -> Pencil:
        """A copy with changed fields, without new checks."""
        copy = object.__new__(Pencil)
        copy.__dict__.update({name: getattr(self, name) for name in ("M", "D", "K", "symmetric", "contacts")} | changed)
        if "K" not in changed:
            copy.__dict__["rescaled"] = self.rescaled
        return copy

    def transposed(self) -> Pencil:
        """λ²Mᵀ + λDᵀ + Kᵀ, whose right eigenvectors are the conjugated left ones of this pencil."""
        return Pencil(self.M.T, self.D.T, self.K.T)

    def with_contact(self, coefficient: float, W: Array) -> Pencil:
        """A copy with D + cWWᵀ, W of shape (n,) or (n, p). M and K are shared and not checked again."""
        found = self.with_damping(contact_damping(W, coefficient))
        return found._with(contacts=(*self.contacts, *([(coefficient, W.reshape(len(W), -1))] if coefficient else [])))

    def with_damping(self, extra: Matrix) -> Pencil:
        """A copy with D + extra. M and K are shared and not checked again."""
        return self.damped_by(self.D + (sp.csr_array(extra) if self.is_sparse else _dense(extra)))

    def damped_by(self, D: Any) -> Pencil:
        """A copy with another D (None: no damping), sparse or dense like M and K, which are shared and not checked again."""
        D = sp.csr_array(self.M.shape) if D is None else D
        D = (D if sp.issparse(D) else sp.csr_array(np.asarray(D))) if self.is_sparse else _dense(D)
        D, symmetric = without_rounding(as_matrix("D", D, self.size))
        return self._with(D=D, symmetric=(self.symmetric[0], symmetric, self.symmetric[2]), contacts=())

    @cached_property
    def rescaled(self) -> dict[tuple[bytes, bytes], tuple[Matrix, Matrix]]:
        """Rescaled M and K, shared by all pencils with the same M and K."""
        return {}

    @cached_property
    def units(self) -> tuple[Array, Array]:
        """Scales r and c, (n,) each, powers of two, such that the DOF of diag(r) P(λ) diag(c) are of similar size.

        They follow from the stiffness of each DOF. If a DOF has none, they come from `equilibration` of |K| + ω|D| + ω²|M|
        with a typical ω. r = c unless M is unsymmetric.
        """
        stiffness = np.abs(self.K.diagonal())
        if self.symmetric[0] and self.symmetric[2] and stiffness.all():
            r = c = 2.0 ** np.rint(-np.log2(stiffness) / 2)
            return r, c
        mass = np.abs(self.M.diagonal())
        both = (mass > 0) & (stiffness > 0)
        omega = float(np.sqrt(np.median(stiffness[both] / mass[both]))) if both.any() else 1.0
        r, c = equilibration(abs(self.K) + omega * abs(self.D) + omega**2 * abs(self.M))
        if self.symmetric[0]:  # a congruence, so that M stays symmetric
            r = c = 2.0 ** np.rint(np.log2(r * c) / 2)
        return r, c

    def alike(self) -> Pencil:
        """The scaled pencil diag(r) P(λ) diag(c) with the `units` r and c: same λ, shapes x / c and y / r.

        This is the pencil itself if the scales of its DOF differ by less than a factor of 16. Krylov vectors are orthonormal
        in the units of the DOF: scales that differ by 2ᵏ enlarge rounding errors by about 4ᵏ.
        """
        if all(unit.max() <= SPREAD * unit.min() for unit in self.units):
            return self
        rows, columns = self.units
        key = rows.tobytes(), columns.tobytes()
        if key not in self.rescaled:  # kept, since their factors are looked up by the matrix
            self.rescaled[key] = scaled(self.M, rows, columns), scaled(self.K, rows, columns)
        mass, stiffness = self.rescaled[key]
        parts = {"M": mass, "D": scaled(self.D, rows, columns), "K": stiffness}
        if np.array_equal(rows, columns):
            return self._with(**parts, contacts=tuple((c, rows[:, None] * W) for c, W in self.contacts))
        # no congruence: D and K may lose their symmetry
        return self._with(**parts, symmetric=tuple(is_symmetric(part) for part in parts.values()), contacts=())

    def at(self, value: complex) -> Matrix:
        """P(value), shape (n, n); complex only if `value` is."""
        return value * value * self.M + value * self.D + self.K

    def residual(self, eigenvalues: Array, shapes: Array) -> Array:
        """R = MXΛ² + DXΛ + KX, column by column P(λ_j) x_j; shapes (k,) and (n, k) give (n, k)."""
        lam = np.asarray(eigenvalues)
        return (self.M @ shapes) * lam**2 + (self.D @ shapes) * lam + self.K @ shapes

    def magnitude(self, eigenvalues: Array, shapes: Array) -> Array:
        """(|λ|²|M| + |λ||D| + |K|)|x| entry by entry: EPS times this is the rounding in P(λ)x."""
        lam, size = np.abs(eigenvalues), np.abs(shapes)
        return (abs(self.M) @ size) * lam**2 + (abs(self.D) @ size) * lam + abs(self.K) @ size

    def backward_error(self, eigenvalues: Array, shapes: Array, residual: Array | None = None) -> Array:
        """Backward errors η_j = ‖P(λ_j)x_j‖ / ((|λ_j|²‖M‖ + |λ_j|‖D‖ + ‖K‖) ‖x_j‖), shape (k,).

        η is the smallest relative change of the matrices that makes (λ, x) an exact eigenpair
        (Tisseur, Linear Algebra Appl. 309 (2000), Th. 1). It depends neither on units nor on the scale of x. `residual` is R
        if it has been computed already.
        """
        lam = np.abs(eigenvalues)
        mass, damping, stiffness = self.norms
        scale = (lam**2 * mass + lam * damping + stiffness) * np.linalg.norm(shapes, axis=0)
        size = np.linalg.norm(self.residual(eigenvalues, shapes) if residual is None else residual, axis=0)
        return np.divide(size, scale, out=np.zeros_like(size), where=scale > 0)


def _dense(A: Any) -> Any:
    return A.toarray() if sp.issparse(A) else A


def contact_damping(w: Array, coefficient: float) -> Matrix:
    """c w wᵀ as a sparse matrix, shape (n, n); w of shape (n,) or (n, p)."""
    column = sp.csr_array(np.asarray(w).reshape(len(w), -1))
    return sp.csr_array(coefficient * (column @ column.T))
