"""Factorise once, solve many: LAPACK for dense and small matrices, PETSc for sparse ones, behind one handle."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterable
from contextlib import suppress
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp

from femsub.algebra.matrices import Difference, equilibration, same_pattern
from femsub.algebra.ordering import leaves_first
from femsub.algebra.petsc import Kind, SparseFactor
from femsub.algebra.processes.beside import divided, is_fork_safe, shared_zeros
from femsub.algebra.processes.cache import drop, forget, shared
from femsub.algebra.processes.limits import BLOCK, FACTOR_BYTES, LARGE, SMALL, WORK
from femsub.checks import EPS, Array, Matrix, SingularMatrixError

log = logging.getLogger(__name__)


class Handle(Protocol):
    """The interface of every factorisation."""

    kind: Kind
    package: str
    size: int
    columns: int
    on_disk: bool

    @property
    def negative_pivots(self) -> int: ...

    @property
    def bytes(self) -> float: ...

    def solve(self, B: Array) -> Array: ...

    def close(self) -> None: ...


class DenseFactor:
    """A⁻¹B for a dense A by Cholesky (definite) or LU, with the inertia from LDLᵀ (symmetric)."""

    package, on_disk = "lapack", False

    def __init__(self, A: Array, kind: Kind) -> None:
        import scipy.linalg as la

        self.kind, self.size, self.columns, self.bytes = kind, int(A.shape[0]), 0, float(A.nbytes)
        SparseFactor.made += 1
        try:
            if kind == "definite":
                factor = la.cho_factor(A, lower=True, check_finite=False)
                self._solve = lambda b: la.cho_solve(factor, b, check_finite=False)
                return
            rows, columns = equilibration(A)
            A = rows[:, None] * A * columns
            self._matrix = A
            with warnings.catch_warnings():
                warnings.simplefilter("error", la.LinAlgWarning)
                warnings.simplefilter("error", RuntimeWarning)
                factor = la.lu_factor(A, check_finite=False)
            rcond, _ = la.lapack.dgecon(factor[0], float(np.linalg.norm(A, 1)))
            if rcond < EPS:
                raise la.LinAlgError(f"reciprocal condition {rcond:.1e}")
        except (la.LinAlgError, la.LinAlgWarning, RuntimeWarning) as error:
            raise SingularMatrixError(f"the {kind} factorisation of a {self.size} x {self.size} matrix broke down; it is "
                                      f"singular, or not of this kind ({error})") from None
        self._solve = lambda b: (columns * la.lu_solve(factor, (rows * b.T).T, check_finite=False).T).T

    @property
    def negative_pivots(self) -> int:
        """The number of negative eigenvalues, which the scaling does not change (Sylvester)."""
        return negative_eigenvalues(self._matrix)

    def solve(self, B: Array) -> Array:
        """A⁻¹B for B of shape (n,) or (n, k)."""
        self.columns += 1 if np.ndim(B) == 1 else np.shape(B)[1]
        return self._solve(B)

    def close(self) -> None:
        """Does nothing: there is no memory to free, as in sparse factors."""


def factorise(A: Matrix | Difference, kind: Kind) -> Handle:
    """A factorisation of A, chosen by its kind: 'definite', 'symmetric' or 'general'.

    Raises
    ------
    SingularMatrixError
        A is singular, or not positive definite although its kind says so.
    """
    A = Difference.of(A)
    if (small := _small(A)) is not None:
        return _logged(DenseFactor(small, kind))
    if kind == "definite" and A.diagonal().min() <= 0:
        raise SingularMatrixError("a matrix with a diagonal entry that is not positive is not positive definite")
    return _logged(SparseFactor(A, kind))


def _logged(handle: Handle) -> Handle:
    """The same factor, after a line in the log: of level INFO for a sparse factor, DEBUG for a dense one."""
    log.log(logging.DEBUG if isinstance(handle, DenseFactor) else logging.INFO, "%s factor of %d DOF by %s%s", handle.kind,
            handle.size, handle.package.upper(), ", on disk: memory is short" if handle.on_disk else "")
    return handle


def shared_factor(K: Matrix, kind: Kind, M: Matrix | None = None, sigma: float = 0.0) -> Handle:
    """The factor of a model's K - σM, from the cache if it was made before (see `shared`). Its users must not close it.

    Raises
    ------
    SingularMatrixError
        As `factorise`. The cache keeps this result, too.
    """
    def made() -> Handle | str:
        try:
            return factorise(Difference(K, M, sigma), kind)
        except SingularMatrixError as error:
            return str(error)

    found = shared(*_key(K, kind, M, sigma), made, lambda it: 0.0 if isinstance(it, str) else it.bytes)
    if isinstance(found, str):
        raise SingularMatrixError(found)
    return found


def forget_factor(K: Matrix, kind: Kind, M: Matrix | None = None, sigma: float = 0.0) -> None:
    """Removes a factor that has turned out to be of no use from the cache."""
    forget(*_key(K, kind, M, sigma))


def release(model: Any) -> None:
    """Removes all cached objects of a model or pencil. Its factors are freed as soon as nobody uses them."""
    pencil = getattr(model, "pencil", model)
    drop(model.M, model.K, pencil.M, pencil.K)


def factors_made() -> int:
    """How many factorisations have been made in this process."""
    return SparseFactor.made


def _key(K: Matrix, kind: Kind, M: Matrix | None, sigma: float) -> tuple[tuple[Matrix, ...], tuple[str, str, float]]:
    return (K, M) if sigma and M is not None else (K,), ("factor", kind, sigma)


def fork_pays(factor: Handle, columns: int) -> bool:
    """Whether solves for this number of columns are worth a fork, and a fork is safe.

    It is safe with CHOLMOD, which solves without threads and without messages of its own.
    """
    if not isinstance(factor, SparseFactor) or factor.package != "cholmod":
        return False
    # twenty times the work from which a thread is worth it: a fork takes some 20 ms, and the solves take much longer
    return columns > BLOCK // 2 and factor.fill * factor.size * columns >= 20 * WORK and is_fork_safe()


def solved(factor: Handle, B: Array) -> Array:
    """A⁻¹B for B (n, k). Where it pays, a fork solves for half of the columns: a second thread of BLAS gains much less."""
    if not fork_pays(factor, B.shape[1]):
        return factor.solve(B)
    X = shared_zeros(*B.shape)

    def some(part: slice) -> None:
        X[:, part] = factor.solve(B[:, part])

    divided(some, B.shape[1], True)
    return X


class TreeFactor:
    """A = L D Lᵀ of a symmetric sparse A (n, n) whose graph is a forest, from the leaves on, without fill or pivoting.

    The signs of D are those of a matrix that differs from A by rounding in each entry (Demmel and Gragg, Linear Algebra
    Appl. 185 (1993) 203). So the count is as accurate as the entries of A allow; solutions may be less accurate.
    """

    kind: Kind = "symmetric"
    package, on_disk = "superlu", False

    def __init__(self, A: Matrix, order: Array) -> None:
        from scipy.sparse.linalg import splu

        self.size, self.columns, self._order = int(A.shape[0]), 0, order
        SparseFactor.made += 1
        try:
            self._lu = splu(sp.csc_array(A[order][:, order]), permc_spec="NATURAL", diag_pivot_thresh=0.0, relax=1, panel_size=1,
                            options={"SymmetricMode": True})
        except RuntimeError as error:
            raise SingularMatrixError(f"a {self.size} x {self.size} matrix is singular ({error})") from None
        self._pivots, self.bytes = self._lu.U.diagonal(), 2 * FACTOR_BYTES * self._lu.nnz
        if not (np.array_equal(self._lu.perm_r, self._lu.perm_c) and np.isfinite(self._pivots).all() and self._pivots.all()):
            raise SingularMatrixError(f"a {self.size} x {self.size} matrix has a pivot that is zero")

    @property
    def negative_pivots(self) -> int:
        """The number of negative eigenvalues (Sylvester)."""
        return int(np.count_nonzero(self._pivots < 0))

    def solve(self, B: Array) -> Array:
        """A⁻¹B for B of shape (n,) or (n, k)."""
        self.columns += 1 if np.ndim(B) == 1 else np.shape(B)[1]
        result = np.empty(np.shape(B))
        result[self._order] = self._lu.solve(np.asarray(B, dtype=float)[self._order])
        return result

    def close(self) -> None:
        """Does nothing: there is no memory to free, as in PETSc's factors."""


def counting(A: Matrix | Difference, keep: bool = True, awaited: Callable[[], float] | None = None) -> Handle:
    """A factorisation of a symmetric A for its inertia; the accuracy of its solutions is not tested.

    Where A is singular within rounding, eigenvalues that are rounding may count as negative or not. With keep=False it
    cannot solve, and takes a quarter of the memory. `awaited` waits for the σ of K - σM; as much as possible is done before that.

    Raises
    ------
    SingularMatrixError
        A has a null pivot.
    """
    A = Difference.of(A)
    if awaited is not None and (not sp.issparse(A.K) or A.shape[0] <= SMALL or A.K.nnz < 3 * A.shape[0]):
        A, awaited = A.at(awaited()), None
    if (small := _small(A)) is not None:
        return _logged(DenseFactor(small, "symmetric"))
    if A.K.nnz < 3 * A.shape[0] and (order := leaves_first(sparse := A.formed())) is not None:
        with suppress(SingularMatrixError):  # a pivot can be zero where the matrix is regular: MUMPS decides
            return _logged(TreeFactor(sparse, order))
    return _logged(SparseFactor(A, "symmetric", keep, probed=False, awaited=awaited))


def inertia(A: Matrix | Difference, awaited: Callable[[], float] | None = None) -> int:
    """The number of negative eigenvalues of a symmetric A (n, n), by a factorisation that is not kept (see `counting`)."""
    handle = counting(A, keep=False, awaited=awaited)
    count = handle.negative_pivots
    handle.close()
    log.debug("inertia: %d of %d eigenvalues are negative", count, handle.size)
    return count


def are_definite(matrices: Iterable[Matrix]) -> list[bool]:
    """Whether each matrix is positive definite, by Cholesky factors that are not kept.

    A matrix with the same pattern as the one before it uses the same order of elimination.
    """
    found: list[bool] = []
    factor: Handle | None = None
    pattern: Matrix | None = None
    for A in matrices:
        try:
            if not (isinstance(factor, SparseFactor) and pattern is not None and same_pattern(A, pattern) and factor.again(A)):
                if factor is not None:
                    factor.close()  # two may not fit into memory
                factor = factorise(A, "definite")
            found.append(True)
        except SingularMatrixError:
            found.append(False)
            factor = None
        # the pattern alone: beside the next matrix and its factor there may be no room for the entries of this one
        pattern = SimpleNamespace(indptr=A.indptr, indices=A.indices) if sp.issparse(A) else None
        del A
    if factor is not None:
        factor.close()
    return found


def negative_eigenvalues(A: Array) -> int:
    """The number of negative eigenvalues of a symmetric A, by the inertia of LDLᵀ (Bunch and Kaufman), without an eigensolver.

    A block of two rows in D has one eigenvalue of each sign.
    """
    import scipy.linalg as la

    blocks = la.ldl(A, check_finite=False)[1]
    double = np.flatnonzero(np.diag(blocks, -1))
    single = np.setdiff1d(np.arange(len(A)), np.concatenate([double, double + 1]))
    return len(double) + int(np.count_nonzero(blocks.diagonal()[single] < 0))


def _small(A: Difference) -> Array | None:
    """A as a dense array if it is dense or small enough for LAPACK, else None."""
    if not sp.issparse(A.K):
        return np.asarray(A.formed())
    return A.formed().toarray() if A.shape[0] <= SMALL else None


class ComplexFactor:
    """A = L U of a complex sparse A (n, n), which real PETSc cannot factorise: by SuperLU, or for a large A by MUMPS.

    MUMPS factorises the real form, [[Re A, -Im A], [Im A, Re A]] [Re x; Im x] = [Re b; Im b].

    Raises
    ------
    SingularMatrixError
        A is singular.
    """

    def __init__(self, A: Matrix) -> None:
        self.size = int(A.shape[0])
        self._lu: Any = None
        if self.size <= LARGE and A.nnz <= 15 * LARGE:  # beyond it MUMPS is quicker
            from scipy.sparse.linalg import splu

            try:
                self._lu = splu(sp.csc_array(A, dtype=complex))
            except RuntimeError as error:
                raise SingularMatrixError(f"a complex {self.size} x {self.size} matrix is singular ({error})") from None
        else:
            real, imaginary = sp.csr_array(A.real), sp.csr_array(A.imag)
            self._real = SparseFactor(sp.block_array([[real, -imaginary], [imaginary, real]], format="csr"), "general")

    def solve(self, B: Array, transposed: bool = False) -> Array:
        """A⁻¹B, or A⁻ᵀB, for B of shape (n,) or (n, k)."""
        b = np.asarray(B, dtype=complex)
        if self._lu is not None:
            return self._lu.solve(b, "T" if transposed else "N")
        b = b.conj() if transposed else b  # the transpose of the real form is the real form of Aᴴ
        x = self._real.solve(np.concatenate([b.real, b.imag]), transposed)
        x = x[:self.size] + 1j * x[self.size:]
        return x.conj() if transposed else x
