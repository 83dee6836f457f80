"""The quadratic pencil λ²M + λD + K: what every stability question is asked of, full and reduced alike."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp

from femsub.errors import InputError, InputTypeError

Array: TypeAlias = np.ndarray
Matrix: TypeAlias = Any  # numpy.ndarray (dense) or scipy.sparse.csr_array (sparse), both float64

EPS = float(np.finfo(float).eps)
ROUNDING = 1e-14  # of sqrt(|a_ii a_jj|): what two orders of adding up the same element matrices may differ by
SPREAD = 16.0  # units of the DOF may differ by so much before a sparse pencil is brought to units of its own
LARGEST = 1e100  # the largest entry of a matrix, and one over the smallest that a matrix may have for its largest


def as_matrix(name: str, value: Any, size: int | None = None) -> Matrix:
    """A square real matrix, checked: dense as a read-only array, sparse as a canonical, read-only CSR.

    The data are copied, so that what is checked stays as it was checked.

    Raises
    ------
    InputTypeError
        Not numeric, or complex.
    InputError
        Not square, not of the given size, or with NaN or Inf in it (the first place is named).
    """
    if sp.issparse(value):
        matrix = sp.csr_array(value)
        if np.iscomplexobj(matrix.data):
            raise InputTypeError(f"{name} is complex; femsub takes real matrices (damping belongs in D)")
        matrix = matrix.astype(np.float64, copy=True)
        matrix.sum_duplicates()
        data = matrix.data
    else:
        try:
            raw = np.asarray(value)
            if np.iscomplexobj(raw):
                raise InputTypeError(f"{name} is complex; femsub takes real matrices (damping belongs in D)")
            matrix = data = np.array(raw, dtype=np.float64)
        except (TypeError, ValueError) as error:
            if isinstance(error, InputTypeError):
                raise
            raise InputTypeError(f"{name} must be a numeric array or a scipy sparse matrix, not {type(value).__name__}")\
                from None
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise InputError(f"{name} must be square, but its shape is {matrix.shape}")
    if matrix.shape[0] == 0:
        raise InputError(f"{name} is empty; a model needs at least one DOF")
    if size is not None and matrix.shape[0] != size:
        raise InputError(f"{name} is {matrix.shape[0]} x {matrix.shape[1]}, but the other matrices are {size} x {size}")
    if not np.isfinite(data).all():
        row, column = _first(matrix, ~np.isfinite(data))
        raise InputError(f"{name} holds a NaN or Inf, first at row {row}, column {column}")
    largest = float(np.abs(data).max(initial=0.0))
    if largest > LARGEST or (name != "D" and 0 < largest < 1 / LARGEST):  # a damping may be as small as it likes
        raise InputError(f"{name}'s largest entry is {largest:.3g}: products of such numbers leave the range of floating point; "
                         "choose other units")
    data.flags.writeable = False
    return matrix


def _first(matrix: Matrix, mask: Array) -> tuple[int, int]:
    where = int(np.flatnonzero(mask)[0])
    if sp.issparse(matrix):
        return int(np.searchsorted(matrix.indptr, where, side="right") - 1), int(matrix.indices[where])
    row, column = np.unravel_index(where, matrix.shape)
    return int(row), int(column)


def is_symmetric(matrix: Matrix) -> bool:
    """A = Aᵀ to the last digit."""
    if sp.issparse(matrix):
        other = matrix.T.tocsr()  # canonical, as `matrix` is
        if np.array_equal(matrix.indptr, other.indptr) and np.array_equal(matrix.indices, other.indices):
            return np.array_equal(matrix.data, other.data)
        return (matrix != other).nnz == 0
    return bool(np.array_equal(matrix, matrix.T))


def without_rounding(matrix: Matrix) -> tuple[Matrix, bool]:
    """(A + Aᵀ)/2 where |a_ij - a_ji| ≤ ROUNDING sqrt(|a_ii a_jj|) throughout, else A itself; and whether that is symmetric.

    An assembly adds up the two triangles in different orders: the skew part is then rounding, and would cost all that
    symmetric matrices are spared.
    """
    if is_symmetric(matrix):
        return matrix, True
    scale = np.sqrt(np.abs(matrix.diagonal()))
    skew = sp.coo_array(matrix - matrix.T)
    if (np.abs(skew.data) > ROUNDING * scale[skew.row] * scale[skew.col]).any():
        return matrix, False
    mean = (matrix + matrix.T) * 0.5
    mean = sp.csr_array(mean) if sp.issparse(mean) else mean
    (mean.data if sp.issparse(mean) else mean).flags.writeable = False
    return mean, True


def norm(matrix: Matrix) -> float:
    """sqrt(‖A‖₁ ‖A‖_∞), which bounds the spectral norm from above (and is ‖A‖_∞ for a symmetric A)."""
    absolute = abs(matrix)
    return float(np.sqrt(np.max(absolute.sum(axis=0)) * np.max(absolute.sum(axis=1))))


def equilibration(A: Matrix) -> tuple[Array, Array]:
    """r and c, (n,) each, powers of two, with which the rows and columns of r_i a_ij c_j have sums near 1.

    Deflections, slopes and twists in one vector make entries that differ by the fourth power of the element's length;
    a condition number means something only once that is taken out. A symmetric A gets r = c.
    (Ruiz, A scaling algorithm to equilibrate both rows and columns norms in matrices, RAL-TR-2001-034.)
    """
    size = abs(A)
    r, c = np.ones(A.shape[0]), np.ones(A.shape[0])
    for _ in range(5):
        rows, columns = r * (size @ c), c * (size.T @ r)
        r /= np.sqrt(np.where(rows > 0, rows, 1.0))
        c /= np.sqrt(np.where(columns > 0, columns, 1.0))
    return 2.0 ** np.rint(np.log2(r)), 2.0 ** np.rint(np.log2(c))


def equilibrated(A: Matrix) -> tuple[Array, Array, float]:
    """Row and column scales, and the norm of the scaled matrix, which is not formed: beside a factor it would not fit."""
    rows, columns = equilibration(A)
    size = abs(A)
    return rows, columns, float(np.sqrt(np.max(rows * (size @ columns)) * np.max(columns * (size.T @ rows))))


def scaled(A: Matrix, rows: Array, columns: Array) -> Matrix:
    """r_i a_ij c_j; powers of two change no digit."""
    if not sp.issparse(A):
        return rows[:, None] * A * columns
    data = A.data * np.repeat(rows, np.diff(A.indptr)) * columns[A.indices]
    return sp.csr_array((data, A.indices, A.indptr), shape=A.shape)


def unit_length(x: Array) -> Array:
    """The columns of x (n, k) divided by their lengths; zeros stay."""
    size = np.linalg.norm(x, axis=0)
    return x / np.where(size > 0, size, 1.0)


@dataclass(frozen=True, eq=False)
class Difference:
    """K - σM of symmetric sparse K and M, (n, n), formed only where it must be: beside a large factor it would not fit."""

    K: Matrix
    M: Matrix
    sigma: float

    @property
    def shape(self) -> tuple[int, int]:
        return self.K.shape

    def diagonal(self) -> Array:
        return self.K.diagonal() - self.sigma * self.M.diagonal()

    def formed(self) -> Matrix:
        """The matrix itself."""
        return self.K - self.sigma * self.M if self.sigma else self.K

    def upper(self) -> Matrix:
        """Its upper triangle, made of those of K and M."""
        return upper(self.K) - self.sigma * upper(self.M) if self.sigma else upper(self.K)

    def __matmul__(self, x: Array) -> Array:
        return self.K @ x - self.sigma * (self.M @ x) if self.sigma else self.K @ x


def upper(A: Matrix) -> Matrix:
    """The upper triangle of a sparse A, diagonal included, as CSR."""
    A = sp.csr_array(A)
    keep = A.indices >= np.repeat(np.arange(A.shape[0], dtype=A.indices.dtype), np.diff(A.indptr))
    starts = np.append(0, np.cumsum(keep, dtype=A.indptr.dtype))[A.indptr]
    return sp.csr_array((A.data[keep], A.indices[keep], starts), shape=A.shape)


@dataclass(frozen=True, eq=False, repr=False)
class Pencil:
    """P(λ) = λ²M + λD + K with real M, D, K of shape (n, n), sparse or dense, symmetric or not.

    Parameters
    ----------
    M, D, K : array_like or sparse, shape (n, n)
        Mass, damping and stiffness in any consistent units; λ then comes in radians per unit of time.
        ``D=None`` means no damping. If one of the three is dense, all are kept dense.

    Raises
    ------
    InputError, InputTypeError
        Shapes that do not fit, NaN or Inf, complex entries.
    """

    M: Matrix
    D: Matrix
    K: Matrix
    symmetric: tuple[bool, bool, bool]  #: whether M, D and K are, to the last digit
    contacts: tuple[tuple[float, Array], ...]  #: (c, W) of each cWWᵀ in D; rounding hides their rank from its entries

    def __init__(self, M: Any, D: Any, K: Any) -> None:
        mass = as_matrix("M", M)
        stiffness = as_matrix("K", K, mass.shape[0])
        damping = sp.csr_array(mass.shape) if D is None else as_matrix("D", D, mass.shape[0])
        parts = (mass, damping, stiffness)
        if not all(sp.issparse(part) for part in ((mass, stiffness) if D is None else parts)):
            parts = tuple(part.toarray() if sp.issparse(part) else part for part in parts)
        checked, flags = zip(*(without_rounding(part) for part in parts), strict=True)
        for name, part in zip(("M", "D", "K", "symmetric"), (*checked, flags), strict=True):
            object.__setattr__(self, name, part)
        object.__setattr__(self, "contacts", ())

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
        return Pencil(*(sp.csr_array(part) for part in (self.M, self.D, self.K)))._beside(self.contacts)

    def _beside(self, contacts: tuple[tuple[float, Array], ...]) -> Pencil:
        object.__setattr__(self, "contacts", contacts)
        return self

    def transposed(self) -> Pencil:
        """λ²Mᵀ + λDᵀ + Kᵀ, whose right eigenvectors are the conjugated left ones of this pencil."""
        return Pencil(self.M.T, self.D.T, self.K.T)

    def with_contact(self, coefficient: float, W: Array) -> Pencil:
        """A copy with D + cWWᵀ, W of shape (n,) or (n, p); M and K are shared, and not checked again."""
        found = self.with_damping(contact_damping(W, coefficient))
        return found._beside((*self.contacts, *([(coefficient, W.reshape(len(W), -1))] if coefficient else [])))

    def with_damping(self, extra: Matrix) -> Pencil:
        """A copy with D + extra; M and K are shared, and not checked again."""
        D = self.D + sp.csr_array(extra) if self.is_sparse else self.D + (extra.toarray() if sp.issparse(extra) else extra)
        D, symmetric = without_rounding(as_matrix("D", D, self.size))
        copy = object.__new__(Pencil)
        flags = (self.symmetric[0], symmetric, self.symmetric[2])
        copy.__dict__.update({"M": self.M, "D": D, "K": self.K, "symmetric": flags, "contacts": ()})
        return copy

    @cached_property
    def units(self) -> tuple[Array, Array]:
        """r and c, (n,) each, powers of two: the DOF of diag(r) P(λ) diag(c) are alike in size. r = c unless M is unsymmetric.

        By the stiffness of each DOF, and where one has none by `equilibration` of |K| + ω|D| + ω²|M| with a typical ω.
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
        """diag(r) P(λ) diag(c) with the `units` r and c: its λ are those of P, its shapes x / c and y / r.

        The pencil itself where its DOF are alike as they stand, within a factor of 16. Krylov vectors are orthonormal in
        the units of the DOF: where those differ by 2ᵏ, some 4ᵏ roundings are lost.
        """
        if all(unit.max() <= SPREAD * unit.min() for unit in self.units):
            return self
        copy = object.__new__(Pencil)
        rows, columns = self.units
        parts = [scaled(part, rows, columns) for part in (self.M, self.D, self.K)]
        copy.__dict__.update(dict(zip("MDK", parts, strict=True)) | {"symmetric": self.symmetric})
        if np.array_equal(rows, columns):
            return copy._beside(tuple((c, rows[:, None] * W) for c, W in self.contacts))
        object.__setattr__(copy, "symmetric", tuple(is_symmetric(part) for part in parts))  # no congruence: D and K may lose it
        return copy._beside(())

    def at(self, value: complex) -> Matrix:
        """P(value), shape (n, n); complex only if `value` is."""
        return value * value * self.M + value * self.D + self.K

    def residual(self, eigenvalues: Array, shapes: Array) -> Array:
        """R = MXΛ² + DXΛ + KX, column by column P(λ_j) x_j; shapes (k,) and (n, k) give (n, k)."""
        lam = np.asarray(eigenvalues)
        return (self.M @ shapes) * lam**2 + (self.D @ shapes) * lam + self.K @ shapes

    def magnitude(self, eigenvalues: Array, shapes: Array) -> Array:
        """(|λ|²|M| + |λ||D| + |K|)|x| entry by entry: what rounding in P(λ)x is measured against."""
        lam, size = np.abs(eigenvalues), np.abs(shapes)
        return (abs(self.M) @ size) * lam**2 + (abs(self.D) @ size) * lam + abs(self.K) @ size

    def backward_error(self, eigenvalues: Array, shapes: Array, residual: Array | None = None) -> Array:
        """η_j = ‖P(λ_j)x_j‖ / ((|λ_j|²‖M‖ + |λ_j|‖D‖ + ‖K‖) ‖x_j‖), shape (k,).

        The matrices would have to be changed by η, relatively, for (λ, x) to be an exact pair
        (Tisseur, Linear Algebra Appl. 309 (2000), Th. 1); η is free of units and of the scale of x. `residual` is R
        where it is at hand already.
        """
        lam = np.abs(eigenvalues)
        mass, damping, stiffness = self.norms
        scale = (lam**2 * mass + lam * damping + stiffness) * np.linalg.norm(shapes, axis=0)
        size = np.linalg.norm(self.residual(eigenvalues, shapes) if residual is None else residual, axis=0)
        return np.divide(size, scale, out=np.zeros_like(size), where=scale > 0)


def contact_damping(w: Array, coefficient: float) -> Matrix:
    """c w wᵀ as a sparse matrix, shape (n, n); w of shape (n,) or (n, p)."""
    column = sp.csr_array(np.asarray(w).reshape(len(w), -1))
    return sp.csr_array(coefficient * (column @ column.T))
