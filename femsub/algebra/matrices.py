"""Real matrices, dense or sparse: checks, symmetry, scaling, norms."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.algebra.frozen import frozen, is_sealed
from femsub.algebra.processes.cache import shared
from femsub.algebra.processes.threads import times
from femsub.checks import EPS, Array, InputError, InputTypeError, Matrix, rows

ROUNDING = 64 * EPS  # relative to sqrt(|a_ii a_jj|): two assemblies of the same element matrices in different order differ by it


def as_matrix(name: str, value: Any, size: int | None = None) -> Matrix:
    """A checked square real matrix: dense as a read-only array, sparse as a canonical, read-only CSR.

    The arrays are copied, so that later changes by the caller have no effect. Only a canonical CSR with the arrays of a model is
    shared.

    Raises
    ------
    InputTypeError
        Not numeric, or complex.
    InputError
        Not square, not of the given size, or with NaN or Inf in it (the first place is named).
    """
    given = value if sp.issparse(value) else rows(name, value)
    try:
        raw: Any = sp.csr_array(given) if sp.issparse(given) else given
        sealed = isinstance(value, sp.csr_array) and is_sealed(value) and raw.has_canonical_format
        matrix = None if np.iscomplexobj(raw) else raw
        if matrix is not None and not (sealed and raw.dtype == np.float64):
            if sp.issparse(raw):  # with 32-bit indices where they suffice: sums of matrices often have 64-bit ones
                short = max(raw.nnz, *raw.shape) <= np.iinfo(np.int32).max
                places = (part.astype(np.int32 if short else np.int64) for part in (raw.indices, raw.indptr))
                matrix = sp.csr_array((raw.data.astype(np.float64), *places), shape=raw.shape)
            else:
                matrix = raw.astype(np.float64)
    except (NotImplementedError, OverflowError, TypeError, ValueError):
        raise InputTypeError(f"{name} must be a numeric array or a scipy sparse matrix, not {type(value).__name__}") from None
    if matrix is None:
        raise InputTypeError(f"{name} is complex, but femsub takes real matrices only. Put damping into D")
    if sp.issparse(matrix):
        matrix.sum_duplicates()
    data = matrix.data if sp.issparse(matrix) else matrix
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise InputError(f"{name} must be square, but its shape is {matrix.shape}")
    if matrix.shape[0] == 0:
        raise InputError(f"{name} is empty; a model needs at least one DOF")
    if size is not None and matrix.shape[0] != size:
        raise InputError(f"{name} is {matrix.shape[0]} x {matrix.shape[1]}, but the other matrices are {size} x {size}")
    if not np.isfinite(data).all():
        entries = sp.coo_array(matrix)
        row, column = (int(places[~np.isfinite(entries.data)][0]) for places in (entries.row, entries.col))
        raise InputError(f"{name} holds a NaN or Inf, first at row {row}, column {column}")
    largest = max(float(data.max(initial=0.0)), -float(data.min(initial=0.0)))  # |A| would be a copy of it
    # products of three entries must stay below 1e308; a damping may be arbitrarily small
    if largest > 1e100 or (name not in "DH" and 0 < largest < 1e-100):
        raise InputError(f"{name}'s largest entry is {largest:.3g}. Products of such numbers leave the range of floating point. "
                         "Choose other units")
    return frozen(matrix)


def same(A: Matrix, B: Matrix) -> bool:
    """Whether two arrays, or two sparse matrices in canonical form, have equal entries in equal places."""
    if A is B or not (sp.issparse(A) and sp.issparse(B)):
        return A is B or (sp.issparse(A) == sp.issparse(B) and np.array_equal(A, B))
    return same_pattern(A, B) and bool(np.array_equal(A.data, B.data))


def is_symmetric(matrix: Matrix) -> bool:
    """Whether A = Aᵀ exactly. The answer is cached for a model's matrix: the transpose takes as much memory as the matrix."""
    if sp.issparse(matrix) and matrix.format == "csr" and is_sealed(matrix):
        return shared((matrix,), "symmetric", lambda: _is_symmetric(matrix))
    return _is_symmetric(matrix)


def _is_symmetric(matrix: Matrix) -> bool:
    if sp.issparse(matrix):
        other = matrix.T.tocsr()  # canonical, as `matrix` is
        return bool(np.array_equal(matrix.data, other.data)) if same_pattern(matrix, other) else (matrix != other).nnz == 0
    return bool(np.array_equal(matrix, matrix.T))


def weighted(terms: Sequence[tuple[float, Matrix]]) -> Matrix:
    """Σ θ_i A_i of a model's matrices, dense or CSR; dense if one of them is. Sparse A_i with θ_i = 0 are left out.

    The sum is read-only like its terms, so that `as_matrix` takes a sparse sum without a copy.
    """
    acting = [(theta, A) for theta, A in terms if theta or not sp.issparse(A)] or terms
    return frozen(reduce(plus, (A if theta == 1 else theta * A for theta, A in acting)))


def plus(A: Matrix, B: Matrix) -> Matrix:
    """A + B, dense, or sparse without stored zeros. SciPy merges rows, which takes four times as long for equal patterns."""
    if sp.issparse(A) and sp.issparse(B) and A.format == B.format == "csr" and same_pattern(A, B):
        data = A.data + B.data
        return _some(A, data, data != 0)
    return A + B


def rows_of_zeros(*matrices: Matrix, among: Array | None = None) -> Array:
    """The rows, of those in `among`, that are 0 in every matrix; in a square matrix the same column must be 0, too."""
    rows = np.arange(matrices[0].shape[0]) if among is None else among
    for A in matrices:
        if A.shape[0] == A.shape[1]:
            rows = rows[A.diagonal()[rows] == 0]  # most diagonal entries are not 0
    for A in matrices:
        size = np.asarray(abs(A[rows]).sum(axis=-1)) if len(rows) else np.zeros(0)
        if len(rows) and A.shape[0] == A.shape[1]:
            size = size + np.asarray(abs(A[:, rows]).sum(axis=0))
        rows = rows[size == 0]
    return rows


def is_identity(matrix: Matrix) -> bool:
    """Whether a sparse A in canonical form is the unit matrix."""
    return matrix.shape[0] == matrix.shape[1] and same(matrix, sp.eye_array(matrix.shape[0], format="csr"))


def halves(A: Matrix) -> tuple[Matrix, Matrix]:
    """(A + Aᵀ)/2 and (A - Aᵀ)/2. If A is sparse, a CSR in canonical form, they store no zeros."""
    even, odd = _halves(A, (1.0, -1.0))
    return even, odd


def _halves(A: Matrix, signs: Sequence[float]) -> Iterator[Matrix]:
    """(A + sign Aᵀ)/2 for each sign, by one transpose."""
    turned = A.T.tocsr() if sp.issparse(A) else A.T
    alike = sp.issparse(A) and same_pattern(A, turned)
    for sign in signs:
        if alike:
            data = A.data + turned.data if sign > 0 else A.data - turned.data
            data *= 0.5
            yield _some(A, data, data != 0)
        else:
            yield (A + turned if sign > 0 else A - turned) * 0.5


def _some(A: Matrix, data: Array, keep: Array) -> Matrix:
    """A CSR matrix with the pattern of A and the entries `data`, without those where `keep` is False."""
    if keep.all():
        return sp.csr_array((data, A.indices, A.indptr), shape=A.shape)
    at = np.flatnonzero(keep)
    return sp.csr_array((data[at], A.indices[at], np.searchsorted(at, A.indptr).astype(A.indptr.dtype)), shape=A.shape)


def block_diagonal(matrices: Sequence[Matrix]) -> Matrix:
    """diag(A₁, A₂, …), sparse. SciPy's function needs twice the memory of its result beside it."""
    blocks = [one if isinstance(one, sp.csr_array) else sp.csr_array(one) for one in matrices]
    rows, columns, entries = (np.cumsum([0, *sizes]) for sizes in zip(*((*one.shape, one.nnz) for one in blocks), strict=True))
    whole = np.int32 if max(columns[-1], entries[-1]) <= np.iinfo(np.int32).max else np.int64
    indices = np.concatenate([np.add(one.indices, start, dtype=whole)
                              for one, start in zip(blocks, columns[:-1].astype(whole), strict=True)])
    indptr = np.concatenate([np.zeros(1, dtype=whole), *(np.add(one.indptr[1:], start, dtype=whole)
                                                         for one, start in zip(blocks, entries[:-1].astype(whole), strict=True))])
    return sp.csr_array((np.concatenate([one.data for one in blocks]), indices, indptr), shape=(rows[-1], columns[-1]))


def without_rounding(matrix: Matrix, beside: Matrix | None = None) -> tuple[Matrix, bool]:
    """(A + Aᵀ)/2 if |a_ij - a_ji| ≤ ROUNDING sqrt(|d_i d_j|) for all i, j, else A itself; and whether the result is symmetric.

    An assembly may add up the two triangles in different order. The skew part is then rounding, but it would rule out the
    cheaper methods for symmetric matrices. d is the diagonal of A, or of A + `beside` for a matrix that A will be added to.
    """
    if sp.issparse(matrix):
        other = matrix.T.tocsr()  # canonical, as `matrix` is
        if same_pattern(matrix, other):
            at = np.flatnonzero(matrix.data != other.data)
            row, column = np.searchsorted(matrix.indptr, at, side="right") - 1, matrix.indices[at]
            skew = matrix.data[at] - other.data[at]
        else:
            rest = sp.coo_array(matrix - other)
            row, column, skew = rest.row, rest.col, rest.data
        del other
    elif np.array_equal(matrix, matrix.T):
        return matrix, True
    else:
        row, column = np.ogrid[:len(matrix), :len(matrix)]
        skew = matrix - matrix.T
    if not skew.any():
        return matrix, True
    scale = np.sqrt(np.abs(matrix.diagonal() + (0.0 if beside is None else diagonal(beside))))
    if (np.abs(skew) > ROUNDING * scale[row] * scale[column]).any():
        return matrix, False
    return frozen(next(_halves(matrix, (1.0,)))), True  # both halves would take twice the memory


def without_signs(A: Matrix) -> Matrix:
    """|A| entry by entry; A itself if no entry is negative. If sparse, it shares A's indices, which SciPy's abs would copy."""
    if not sp.issparse(A) or A.format != "csr":
        return abs(A)
    return A if A.data.min(initial=0.0) >= 0 else sp.csr_array((np.abs(A.data), A.indices, A.indptr), shape=A.shape)


def diagonal(matrix: Matrix) -> Array:
    """The diagonal (n,) of a model's matrix, cached with it: SciPy passes through all entries of a sparse matrix each time."""
    if not sp.issparse(matrix):
        return np.diagonal(matrix)
    found: Array = shared((matrix,), "diagonal", lambda: frozen(matrix.diagonal()), lambda d: d.nbytes)
    return found


def norm(matrix: Matrix) -> float:
    """sqrt(‖A‖₁ ‖A‖_∞), which bounds the spectral norm from above (and is ‖A‖_∞ for a symmetric A)."""
    absolute = without_signs(matrix)
    return float(np.sqrt(np.max(absolute.sum(axis=0)) * np.max(absolute.sum(axis=1))))


def equilibration(A: Matrix) -> tuple[Array, Array]:
    """r and c, (n,) each, powers of two, with which the rows and columns of r_i a_ij c_j have sums near 1.

    Matrices with deflections and rotations have entries that differ by up to the fourth power of the element length. A
    condition number is meaningful only after scaling. A symmetric A gets r = c.
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
    """Row and column scales, and the norm of the scaled matrix, which is not formed: it may not fit beside a large factor."""
    rows, columns = equilibration(A)
    size = abs(A)
    return rows, columns, float(np.sqrt(np.max(rows * (size @ columns)) * np.max(columns * (size.T @ rows))))


def scaled(A: Matrix, rows: Array, columns: Array) -> Matrix:
    """r_i a_ij c_j; exact if r and c are powers of two."""
    if not sp.issparse(A):
        return rows[:, None] * A * columns
    data = A.data * np.repeat(rows, np.diff(A.indptr)) * columns[A.indices]
    return sp.csr_array((data, A.indices, A.indptr), shape=A.shape)


def same_pattern(A: Matrix, B: Matrix) -> bool:
    """Whether the entries of two CSR matrices stand in the same places."""
    return bool(np.array_equal(A.indptr, B.indptr) and np.array_equal(A.indices, B.indices))


def unit_length(x: Array) -> Array:
    """The columns of x (n, k) divided by their lengths; zeros stay."""
    size = np.linalg.norm(x, axis=0)
    return x / np.where(size > 0, size, 1.0)


@dataclass(frozen=True, eq=False)
class Difference:
    """K - σM of symmetric sparse K and M, (n, n), formed only on demand: beside a large factor it may not fit in memory."""

    K: Matrix
    M: Matrix = None
    sigma: float = 0.0

    @classmethod
    def of(cls, A: Matrix | Difference) -> Difference:
        """A itself, with σ = 0 if it is a matrix."""
        return A if isinstance(A, cls) else cls(A)

    @property
    def shape(self) -> tuple[int, int]:
        return self.K.shape

    def diagonal(self) -> Array:
        return self.K.diagonal() - self.sigma * self.M.diagonal() if self.sigma else self.K.diagonal()

    def formed(self) -> Matrix:
        """The matrix itself."""
        return self.K - self.sigma * self.M if self.sigma else self.K

    def upper(self) -> Matrix:
        """Its upper triangle, from those of K and M."""
        return upper(self.K) - self.sigma * upper(self.M) if self.sigma else upper(self.K)

    def pattern(self) -> Difference:
        """|K| + |M|: nothing cancels in it, so that it has a nonzero wherever K - σM may have one."""
        return Difference(without_signs(self.K), without_signs(self.M), -1.0)

    def at(self, sigma: float) -> Difference:
        """K - σM for another σ."""
        return Difference(self.K, self.M, sigma)

    def __matmul__(self, x: Array) -> Array:
        return times(self.K, x) - self.sigma * times(self.M, x) if self.sigma else times(self.K, x)


@dataclass(frozen=True, eq=False)
class Sum:
    """diag(u) Σ θ_i A_i diag(u) of sparse A_i (n, n). Products are found term by term: the sum may be as large as a basis."""

    terms: Sequence[tuple[float, Matrix]]
    unit: Array  #: u, (n,), powers of two

    @classmethod
    def of(cls, A: Matrix | Sum) -> Sum:
        """A itself, or the sum of a matrix alone."""
        return A if isinstance(A, cls) else cls([(1.0, A)], np.ones(A.shape[0]))

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.unit), len(self.unit)

    @property
    def nnz(self) -> int:
        """An upper bound of the number of nonzeros."""
        return sum(A.nnz for theta, A in self.terms if theta)

    def formed(self) -> Matrix:
        """The matrix itself, summed by slabs of rows: SciPy's sum of two matrices takes room for the entries of both."""
        acting = [(theta, A) for theta, A in self.terms if theta] or self.terms
        if len(acting) == 1:
            found = weighted(acting)
        else:
            n, kind = len(self.unit), np.result_type(*(A.indices for _, A in acting))
            room = max(A.nnz for _, A in acting)  # terms often share their pattern
            data, indices, ends = np.empty(room), np.empty(room, kind), np.zeros(n + 1, kind)
            for a, b in slabs(n):
                rows = weighted([(theta, A[a:b]) for theta, A in acting])
                ends[a + 1:b + 1] = ends[a] + rows.indptr[1:]
                room = len(data) if ends[b] <= len(data) and b < n else int(ends[b]) * n // max(b, 1)  # last slab: exact
                for one in (data, indices):
                    one.resize(room, refcheck=False)
                data[ends[a]:ends[b]], indices[ends[a]:ends[b]] = rows.data, rows.indices
            found = frozen(sp.csr_array((data, indices, ends), shape=self.shape))
        return found if (self.unit == 1).all() else scaled(found, self.unit, self.unit)

    def plus(self, theta: float, other: Matrix | Sum) -> Matrix:
        """The matrix itself plus θ times a matrix, or a sum with the same u."""
        if isinstance(other, Sum):
            return Sum([*self.terms, *((theta * own, A) for own, A in other.terms)], self.unit).formed()
        return plus(self.formed(), theta * other)

    def __matmul__(self, x: Array) -> Array:
        return self._of(np.multiply(self.unit.reshape(-1, *(1,) * (x.ndim - 1)), x, order="C"), self.terms, times)

    def sizes(self, x: Array) -> Array:
        """diag(u) Σ |θ_i| |A_i| diag(u) |x| for x (n, k). |A_i| is formed by slabs of rows, since it is as large as A_i."""
        x = np.abs(x, order="C")
        x *= self.unit[:, None]
        return self._of(x, [(abs(theta), A) for theta, A in self.terms], _sizes)

    def _of(self, x: Array, terms: Sequence[tuple[float, Matrix]], image: Callable[[Matrix, Array], Array]) -> Array:
        found = np.zeros_like(x)
        for theta, A in terms:
            if theta:
                more = image(A, x)
                more *= theta
                found += more
                del more  # before the next product
        found *= self.unit.reshape(-1, *(1,) * (x.ndim - 1))
        return found


def slabs(n: int, rows: int = 1000) -> Iterator[tuple[int, int]]:
    """First row and end of slabs of some `rows` of n rows: work slab by slab takes little memory beside the matrix."""
    return pairwise(np.linspace(0, n, max(n // rows, 1) + 1).astype(int).tolist())


def _sizes(A: Matrix, x: Array) -> Array:
    """|A|x of a CSR matrix."""
    found = np.empty((A.shape[0], x.shape[1]))
    for a, b in slabs(len(x)):
        at = slice(A.indptr[a], A.indptr[b])
        found[a:b] = sp.csr_array((np.abs(A.data[at]), A.indices[at], A.indptr[a:b + 1] - A.indptr[a]), (b - a, len(x))) @ x
    return found


def upper(A: Matrix) -> Matrix:
    """The upper triangle of a sparse A, diagonal included, as CSR."""
    A = sp.csr_array(A)
    keep, ends = np.empty(A.nnz, dtype=bool), np.zeros_like(A.indptr)
    for a, b in slabs(A.shape[0]):
        at = slice(A.indptr[a], A.indptr[b])
        keep[at] = A.indices[at] >= np.repeat(np.arange(a, b, dtype=A.indices.dtype), np.diff(A.indptr[a:b + 1]))
        ends[a + 1:b + 1] = ends[a] + np.searchsorted(np.flatnonzero(keep[at]), A.indptr[a + 1:b + 1] - A.indptr[a])
    return sp.csr_array((A.data[keep], A.indices[keep], ends), shape=A.shape)


def translations(n: int) -> Array:
    """Uniform motions of every s-th DOF (n, k): translations of a body whose nodes have s DOF each."""
    at = np.arange(n)
    return np.stack([at % s == first for s in (1, 2, 3, 4, 6) if n % s == 0 for first in range(s)], axis=1).astype(float)
