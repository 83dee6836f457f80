"""The only importer of petsc4py and slepc4py: factorise once, solve blocks, EPS and PEP on the same handle.

Arrays and scipy matrices go in, arrays come out; no PETSc object leaves this file, and each is destroyed here.

The kind of the matrix decides the factorisation: CHOLMOD for positive definite matrices, MUMPS LDLᵀ for symmetric ones, MUMPS LU
for all others. In a PETSc without CHOLMOD, MUMPS factorises positive definite matrices, too. Chains and beams are the exception:
PETSc factorises them itself, from end to end. There it is as accurate as CHOLMOD, while MUMPS loses up to five digits
(docs/performance.md). MUMPS reports no error for a singular matrix. So each of its factors is tested with a random right-hand
side.
"""

from __future__ import annotations

import atexit
import sys
import weakref
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from threading import RLock
from typing import Any, ClassVar, Literal

import numpy as np
import scipy.sparse as sp

from femsub.algebra.matrices import Difference, equilibrated
from femsub.algebra.memory import BUFFERED, disk, goes_to_disk
from femsub.algebra.ordering import good_order, slender
from femsub.algebra.processes.cache import drop
from femsub.algebra.processes.folders import task_folder
from femsub.algebra.processes.limits import BLOCK, FACTOR_BYTES
from femsub.algebra.processes.memory import give_back_freed_memory
from femsub.algebra.processes.system import functions_of, set_unless_given
from femsub.algebra.processes.threads import no_openmp
from femsub.checks import (
    EPS,
    Array,
    BreakdownError,
    InputError,
    Matrix,
    MissingPackageError,
    NotConvergedError,
    NotEnoughMemoryError,
    SingularMatrixError,
    installed_by,
    set_up_by,
)

Kind = Literal["definite", "symmetric", "general"]
CHOLMOD = True  # use it if PETSc has it; tests set False
MUMPS_ORDERS = {"amd": 0, "amf": 2}  # ICNTL(7); by options, as PETSc overrules a setMumpsIcntl(7)
SINGULAR = (-6, -10)  # errors of MUMPS that the matrix causes; others come from the machine
ROOM = (10, 200)  # for delayed pivots of indefinite matrices, in per cent of MUMPS' estimate: first and second attempt
WHEEL = "dolfinx_solver"  # to be imported before the petsc4py of the same folder


def installation() -> str:
    """How to install PETSc and SLEPc for this interpreter, as the end of a message."""
    command = installed_by("dolfinx-solver-real")
    return f"Set it up anew: {command}" if set_up_by() else (
        "In a clone of femsub: scripts/setup, which takes Debian's packages, a wheel or the sources (docs/install.md). With "
        f"Python 3.12 or later on Linux: {command}")


def load_wheel() -> None:
    """Imports the module of the `dolfinx-solver` wheels, which loads MPI; their petsc4py fails to import without it."""
    ours, wheel = (find_spec(name) for name in ("petsc4py", WHEEL))
    if ours and wheel and Path(str(ours.origin)).parent.parent == Path(str(wheel.origin)).parent.parent:
        import_module(WHEEL)


@cache
def load() -> tuple[Any, Any]:
    set_unless_given({
        # Debian's PETSc is linked to OpenMPI, which would start a helper process for each Python process.
        "OMPI_MCA_ess_singleton_isolated": "1",
        # All such processes share one folder in /tmp. The first process to end removes it, and MPI_Init aborts in new ones.
        "OMPI_MCA_orte_create_session_dirs": "0",
        "SCOTCH_PTHREAD_NUMBER": "1"})  # with more threads each call gives other parts
    # By default PETSc answers a closed pipe or Ctrl-C with a page of text and MPI_ABORT, and lists unused options at exit.
    options_of_petsc = ["femsub", "-no_signal_handler", "-options_left", "no"]
    try:
        load_wheel()
        import petsc4py
        import slepc4py

        if mpi := sys.modules.get("mpi4py.MPI"):  # else PETSc would wait for all processes of MPI to load it
            petsc4py.init(options_of_petsc, comm=mpi.COMM_SELF)
        slepc4py.init(options_of_petsc)
        from petsc4py import PETSc
        from slepc4py import SLEPc
    except (AttributeError, ImportError, ValueError) as error:  # AttributeError, ValueError: compiled for another NumPy
        if "numpy" in str(error):
            raise MissingPackageError(
                f"petsc4py was compiled for an earlier NumPy than {np.__version__} ({error}). Install that: "
                f"{installed_by('numpy', numpy_below=int(np.__version__.split('.')[0]))}") from error
        raise MissingPackageError(f"slepc4py (with petsc4py) cannot be imported by this Python ({error}). "
                                  f"{installation()}") from error
    give_back_freed_memory()
    atexit.register(drop)  # before PETSc is finalised
    if np.dtype(PETSc.ScalarType).kind == "c":
        raise MissingPackageError("this PETSc has complex scalars; femsub needs a build with real ones (twice as fast)")
    options = PETSc.Options()
    options.setValue("mat_cholmod_print", 0)
    # Without these two options CHOLMOD accepts an indefinite matrix (LDLᵀ with negative pivots) without an error.
    options.setValue("mat_cholmod_final_asis", 0)
    options.setValue("mat_cholmod_final_ll", 1)
    for name, number in MUMPS_ORDERS.items():
        options.setValue(f"femsub_{name}_mat_mumps_icntl_7", number)
    return PETSc, SLEPc


def versions() -> dict[str, str]:
    """The versions of PETSc and SLEPc, and the package that makes their Cholesky factors."""
    PETSc, SLEPc = load()
    found = {name: ".".join(map(str, module.Sys.getVersion())) for name, module in (("PETSc", PETSc), ("SLEPc", SLEPc))}
    return found | {"Cholesky": "CHOLMOD" if has_cholmod() else "MUMPS"}


def has(name: str) -> bool:
    """Whether PETSc was built with the package that PETSc calls `name`."""
    return bool(load()[0].Sys.hasExternalPackage(name))


def has_cholmod() -> bool:
    """Whether CHOLMOD factorises positive definite matrices."""
    return CHOLMOD and has("suitesparse")


def package(kind: Kind, A: Matrix) -> str:
    """Which package factorises a sparse A of that kind: 'cholmod', 'mumps' or 'petsc', its own.

    Raises
    ------
    MissingPackageError
        PETSc was built without MUMPS, and A needs it.
    """
    if kind == "definite":
        if has_cholmod():
            return "cholmod"
        if slender(A):
            return "petsc"
    if not has("mumps"):
        raise MissingPackageError(f"this PETSc was built without MUMPS, which {kind} matrices need. {installation()}")
    return "mumps"


def scotch_parts(graph: Matrix, count: int) -> Array | None:
    """The part, 0 to count - 1, of each node of a graph (n, n) by SCOTCH, shape (n,); None where PETSc was built without it.

    Few edges lead from part to part. Parts have about the same size. The same graph always gives the same parts.
    """
    PETSc, _ = load()
    if not has("ptscotch"):
        return None
    scotch = functions_of(PETSc.__file__, {"SCOTCH_randomReset": 0})
    if scotch is None:
        return None
    scotch[0]()  # otherwise it continues the random numbers of the last call
    with ExitStack() as stack:
        adjacency = _until(stack, _matrix(sp.csr_array(graph, dtype=float)).convert("mpiadj"))
        partitioning = _until(stack, PETSc.MatPartitioning().create(comm=PETSc.COMM_SELF))
        partitioning.setAdjacency(adjacency)
        partitioning.setType("ptscotch")
        PETSc.Options().setValue("femsub_mat_partitioning_nparts", count)  # petsc4py 3.18 has no call for it
        partitioning.setOptionsPrefix("femsub_")
        partitioning.setFromOptions()
        found = _until(stack, PETSc.IS().create(comm=PETSc.COMM_SELF))
        partitioning.apply(found)
        return np.array(found.getIndices(), dtype=np.intp)


def _matrix(A: Matrix | Difference, kind: Kind = "general", shared: bool = False) -> Any:
    """A as a PETSc matrix; for a symmetric factor its upper triangle alone.

    `shared`: the whole matrix, on the arrays of A itself. It is for MUMPS, which copies the triangle that it needs.
    """
    (PETSc, _), given = load(), Difference.of(A)
    shared = shared and not given.sigma
    whole = shared or kind == "general"
    A = sp.csr_array(given.formed()) if whole else given.upper()
    if shared and not A.has_sorted_indices:  # PETSc takes the entries behind the diagonal as triangle
        A = A.sorted_indices()
    index = PETSc.IntType
    if A.nnz > np.iinfo(index).max:
        raise InputError(f"{A.nnz} nonzeros are more than this PETSc's {np.dtype(index).name} can count")
    arrays = (A.indptr.astype(index, copy=False), A.indices.astype(index, copy=False), np.asarray(A.data, dtype=float))
    mat = PETSc.Mat()
    if shared:
        mat.createAIJWithArrays(A.shape, arrays, comm=PETSc.COMM_SELF)
    else:
        (mat.createAIJ if whole else mat.createSBAIJ)(A.shape, 1, csr=arrays, comm=PETSc.COMM_SELF)
    mat.assemble()
    if kind == "definite":
        mat.setOption(PETSc.Mat.Option.SPD, True)
    return mat


class SparseFactor:
    """A = L Lᵀ, L D Lᵀ or L U of a sparse A (n, n), made once; `solve` is A⁻¹B for B (n,) or (n, k).

    A factor that would not fit into memory goes to a disk (`goes_to_disk`). MUMPS reads it at each solve, which then takes twice
    as long. With keep=False only the signs of the pivots of L D Lᵀ are kept, which takes a quarter of the memory. probed=False
    leaves out the test with a random right-hand side, for callers that need only these signs. `awaited` waits for the σ of
    K - σM; before that, MUMPS finds the order of elimination.

    Raises
    ------
    SingularMatrixError
        The factorisation broke down, or the probe shows that A is singular to working precision.
    """

    made = 0  #: number of factorisations in this process; tests count with it
    packages: ClassVar[set[str]] = set()  #: packages that made them

    def __init__(self, A: Matrix | Difference, kind: Kind, keep: bool = True, probed: bool = True,
                 awaited: Callable[[], float] | None = None) -> None:
        PETSc, _ = load()
        self.kind, self.size, self.columns, self.keep = kind, int(A.shape[0]), 0, keep
        A = Difference.of(A)
        self.on_disk = goes_to_disk(A.K, keep and has("mumps"), keep)
        self.package = "mumps" if self.on_disk else package(kind, A.K)
        self._order = good_order(A.K) if self.package == "mumps" else None
        self._held = ExitStack()
        self._lock = RLock()  # threads share a factor: while it solves with Aᵀ, others must wait
        self._finalizer = weakref.finalize(self, self._held.close)
        scaling = equilibrated(A.formed()) if probed and self.package == "mumps" else None
        SparseFactor.made += 1
        mat = _matrix(A if awaited is None else A.pattern(), "general" if self.package == "petsc" else kind,
                      shared=self.package == "mumps" and awaited is None)
        try:
            mat = self._set_up(mat, ROOM[0], None if awaited is None else lambda: _matrix(A.at(awaited()), kind))
            if self._infog(1) in (-8, -9):  # delayed pivots need more room
                self._held.close()
                self._set_up(mat, ROOM[1])
        except PETSc.Error as error:
            raise self._refused(_last_line(error)) from None
        finally:
            mat.destroy()  # the KSP has a reference of its own
        # Whoever else gets this KSP (EPS, PEP) must not factorise again.
        self._ksp.getPC().setReusePreconditioner(True)
        SparseFactor.packages.add(self.package)
        self._check_disk()
        if kind == "definite" and self.package != "cholmod":
            code, negative, null = self._infog(1), self._infog(12), self._infog(28)
            if self.package == "petsc":
                negative, null = self._factor.getInertia()[:2]
            if code < 0 or negative or null:
                raise self._refused(f"error {code}, {negative} negative and {null} null pivots")
        if scaling is not None:
            self._probe(A, *scaling)
        elif null := self._infog(28):
            raise self._refused(f"{null} null pivots")

    def _set_up(self, mat: Any, room: int, values: Callable[[], Any] | None = None) -> Any:
        """Makes the KSP with the factor of `mat`, or of what `values()` returns, and returns that matrix."""
        folder, set_up = self._held.enter_context(task_folder(disk()[0])) if self.on_disk else None, ExitStack()
        self._ksp = _until(self._held, load()[0].KSP().create(comm=load()[0].COMM_SELF))
        self._ksp.setType("preonly")
        self._ksp.setOperators(mat)
        pc = _until(self._held, self._ksp.getPC())
        pc.setType("lu" if self.kind == "general" else "cholesky")
        pc.setFactorSolverType(self.package)
        if self.package == "petsc":
            self._ksp.setErrorIfNotConverged(True)  # only a pivot of exactly zero is an error
            pc.setFactorPivot(0.0)
            pc.setFactorOrdering("rcm")  # reverse Cuthill-McKee: from end to end
        pc.setFactorSetUpSolverType()
        self._factor = _until(self._held, pc.getFactorMatrix())
        if self.package != "mumps":
            with no_openmp():
                self._ksp.setUp()
            return mat
        prefix = f"femsub_{self._order}_" if self._order else "femsub_" if folder else ""
        if prefix:
            self._factor.setOptionsPrefix(prefix)
        if folder:
            options = load()[0].Options()
            options.setValue(name := f"{prefix}mat_mumps_ooc_tmpdir", folder)
            set_up.callback(options.delValue, name)
            self._factor.setMumpsIcntl(22, 1)  # the factor goes to files as it is made
        self._factor.setMumpsIcntl(14, room)
        self._factor.setMumpsIcntl(24, 1)  # null pivots are detected, and counted in INFOG(28)
        self._factor.setMumpsIcntl(31, 0 if self.keep else 1)  # 1: the factor is thrown away while it is made
        with set_up:
            if values is not None:
                return self._in_two_steps(mat, values)
            self._ksp.setUp()
        return mat

    def _in_two_steps(self, pattern: Any, values: Callable[[], Any]) -> Any:
        """Finds the order of elimination of the pattern, then factorises the matrix that `values()` returns; returns that matrix.

        If the matrix has fewer nonzeros than the pattern, the order does not fit it, and the factorisation begins anew.
        """
        PETSc, F = load()[0], self._factor.handle
        info = np.zeros(64)  # PETSc's MatFactorInfo has 11 numbers, of which MUMPS reads none
        steps = _two_steps()
        code = steps[0](F, pattern.handle, None, info.ctypes.data) if steps else 0
        mat = values()
        fit = steps is not None and mat.getInfo()["nz_used"] == pattern.getInfo()["nz_used"]
        pattern.destroy()
        if steps and fit and not code:
            code = steps[1](F, mat.handle, info.ctypes.data)
        if code:
            raise PETSc.Error(code)
        if not fit:
            self._held.close()
            self._set_up(mat, ROOM[0])
        return mat

    def again(self, A: Matrix) -> bool:
        """Become the factor of another definite matrix with the same pattern; whether that was possible.

        The order of elimination, a third of the work or more, is kept. Nothing is done if CHOLMOD did not make this factor, or if
        PETSc hides the steps of its factorisation.

        Raises
        ------
        SingularMatrixError
            The factorisation broke down.
        """
        steps = _two_steps()
        if self.package != "cholmod" or steps is None:
            return False
        SparseFactor.made += 1
        mat = _matrix(A, self.kind)
        try:
            with no_openmp():
                code = steps[1](self._factor.handle, mat.handle, np.zeros(64).ctypes.data)
        finally:
            mat.destroy()
        if code:
            raise self._refused(f"PETSc's error {code}")
        return True

    def _infog(self, number: int) -> int:
        """MUMPS' INFOG(number): 1 is an error, 12 counts negative pivots, 28 null ones. CHOLMOD raises instead."""
        return int(self._factor.getMumpsInfog(number)) if self.package == "mumps" else 0

    def _check_disk(self) -> None:
        """Raises an error that names the disk, not the matrix, if MUMPS could not write or read the factor."""
        if self.on_disk and (code := self._infog(1)) < 0 and code not in SINGULAR:
            self.close()
            raise NotEnoughMemoryError(f"the factor of {self.size} DOF does not fit into memory, and MUMPS could not keep it in "
                                       f"{disk()[0]} either (its error {code}). Name a folder with more room by TMPDIR")

    def _refused(self, why: str) -> SingularMatrixError:
        self.close()
        return SingularMatrixError(f"the {self.kind} factorisation of a {self.size} x {self.size} matrix by "
                                   f"{self.package.upper()} broke down; it is singular, or not of this kind ({why})")

    def __repr__(self) -> str:
        where = ", on disk" if self.on_disk else ""
        return f"SparseFactor({self.kind}, by {self.package.upper()}, {self.size} x {self.size}{where})"

    def _probe(self, A: Difference, rows: Array, columns: Array, size: float) -> None:
        b = np.random.default_rng(0).standard_normal(self.size)
        x = self.solve(b / rows) / columns
        self.columns = 0
        length, given = float(np.linalg.norm(x)), float(np.linalg.norm(b))
        growth = size * length / given
        null = self._infog(28)
        wrong = float(np.linalg.norm(rows * (A @ (columns * x)) - b)) > 1e-6 * (size * length + given)
        if null or wrong or not growth < 0.1 / EPS:
            self.close()
            raise SingularMatrixError(f"a {self.size} x {self.size} matrix is singular to working precision "
                                      f"(condition at least {growth:.1e}, {null} null pivots)")

    @property
    def negative_pivots(self) -> int:
        """The number of negative eigenvalues of a symmetric A (Sylvester's law of inertia)."""
        if self.kind != "symmetric":
            raise InputError("only a symmetric factorisation counts the inertia")
        return self._infog(12)

    @property
    def fill(self) -> float:
        """Nonzeros of L per row, all of which a solve reads."""
        return self._nonzeros / self.size

    @property
    def bytes(self) -> float:
        """The estimated memory of the factor, in bytes."""
        return FACTOR_BYTES * self._nonzeros * (BUFFERED if self.on_disk else 1.0)

    @property
    def _nonzeros(self) -> float:
        return float(self._factor.getInfo()["nz_used"])

    @property
    def transposed(self) -> SparseFactor | Transposed:
        """The factor of Aᵀ: this one, with L and U exchanged."""
        return Transposed(self) if self.kind == "general" else self

    def solve(self, B: Array, transposed: bool = False) -> Array:
        """A⁻¹B, or A⁻ᵀB, in blocks of right-hand sides."""
        if not self.keep:
            raise InputError("this factor was made to count pivots and not kept: it cannot solve")
        PETSc, _ = load()
        right = np.asarray(B, dtype=np.float64).reshape(self.size, -1)
        result = np.empty(right.shape, order="F")
        with self._lock, ExitStack() as turned:
            if transposed and self.kind == "general":
                self._factor.setMumpsIcntl(9, 0)
                turned.callback(self._factor.setMumpsIcntl, 9, 1)
            try:
                for start in range(0, right.shape[1], BLOCK):
                    b, x = np.require(right[:, start:start + BLOCK], requirements=["F", "W"]), result[:, start:start + BLOCK]
                    with ExitStack() as stack:
                        source, target = (PETSc.Mat().createDense(part.shape, array=part, comm=PETSc.COMM_SELF)
                                          for part in (b, x))
                        for mat in (source, target):
                            stack.callback(mat.destroy)
                            mat.assemble()
                        self._factor.matSolve(source, target)
                        self._check_disk()
            except PETSc.Error as error:
                raise SingularMatrixError(f"a solve with a {self.size} x {self.size} matrix failed "
                                          f"({_last_line(error)})") from None
        self.columns += right.shape[1]
        return result.reshape(np.shape(B))

    def lend(self, st: Any, stack: ExitStack) -> None:
        """Puts this factor into a spectral transformation for as long as the stack lives."""
        stack.enter_context(self._lock)
        _lend(self._ksp, st, stack)

    def close(self) -> None:
        """Frees the memory; the factor cannot solve afterwards."""
        self._finalizer()


class Transposed:
    """A⁻ᵀ by the factor of A."""

    def __init__(self, factor: SparseFactor) -> None:
        self.transposed, self.kind, self.size = factor, factor.kind, factor.size

    def solve(self, B: Array) -> Array:
        """A⁻ᵀB for B of shape (n,) or (n, k)."""
        return self.transposed.solve(B, transposed=True)

    def lend(self, st: Any, stack: ExitStack) -> None:
        """As `SparseFactor.lend`, by a PC that solves with the transpose."""
        PETSc, _ = load()
        ksp = _until(stack, PETSc.KSP().create(PETSc.COMM_SELF))
        ksp.setType("preonly")
        ksp.getPC().setType("python")
        ksp.getPC().setPythonContext(self)
        _lend(ksp, st, stack)

    def apply(self, _: Any, x: Any, y: Any) -> None:
        """y = A⁻ᵀx; PETSc calls it."""
        with self.transposed._lock:
            self.transposed._factor.solveTranspose(x, y)


@cache
def _two_steps() -> list[Callable[..., int]] | None:
    """PETSc's functions for the two steps of a factorisation, symbolic and numeric, which petsc4py does not call.

    None where the library hides them: then both steps wait for the values of the matrix.
    """
    return functions_of(load()[0].__file__, {"MatCholeskyFactorSymbolic": 4, "MatCholeskyFactorNumeric": 3})


def _lend(ksp: Any, st: Any, stack: ExitStack) -> None:
    PETSc, _ = load()
    st.setKSP(ksp)
    spare = _until(stack, PETSc.KSP().create(PETSc.COMM_SELF))
    # EPS, PEP and ST reset the KSP when they are destroyed, which would throw the factor away: take it back before.
    stack.callback(st.setKSP, spare)


def _last_line(error: BaseException) -> str:
    lines = [line.split("]", 1)[-1].strip() for line in str(error).splitlines()]
    return lines[-1][:120] if lines else type(error).__name__


def _until(stack: ExitStack, thing: Any) -> Any:
    """The same object, which the stack destroys when it closes."""
    stack.callback(thing.destroy)
    return thing


def _solve(solver: Any, count: int, tol: float, wanted: str, advice: str) -> int:
    """Runs a solver and returns the number of converged eigenpairs, at least `count`."""
    PETSc, _ = load()
    try:
        solver.solve()
    except (PETSc.Error, SystemError) as error:  # slepc4py 3.25 raises the second from the first
        raise BreakdownError(f"{type(solver).__name__} failed ({_last_line(error.__cause__ or error)})") from None
    found = int(solver.getConverged())
    if found < count:
        raise NotConvergedError(f"{found} of {count} {wanted} converged to {tol:g} within {solver.getIterationNumber()} restarts "
                                f"(reason {solver.getConvergedReason()}); ask for fewer, or {advice} the matrices")
    return found


def _vectors(stack: ExitStack, like: Any, columns: Array) -> list[Any]:
    """The columns of an array as vectors of PETSc."""
    vectors = [_until(stack, like.createVecRight()) for _ in columns.T]
    for vector, column in zip(vectors, columns.T, strict=True):
        vector.setArray(column)
    return vectors


def _start(size: int, seed: int) -> Array:
    """A seeded start vector (n, 1), so that a run can be repeated to the last digit."""
    return np.random.default_rng(seed).standard_normal((size, 1))


def symmetric_modes(factor: SparseFactor, K: Matrix, M: Matrix, sigma: float, count: int, *, tol: float, seed: int = 1,
                    known: Array | None = None, most: int = 1000) -> tuple[Array, Array]:
    """(K - λM)φ = 0: the λ (k,) nearest to σ and their Φ (n, k), k ≥ count, by Krylov-Schur on (K - σM)⁻¹M.

    `factor` is that of K - σM. The M-orthonormal shapes `known` (n, m) are kept out of the search. Φ is M-normalised.
    """
    PETSc, SLEPc = load()
    known = np.zeros((factor.size, 0)) if known is None else known
    with ExitStack() as stack:
        mats = [_until(stack, _matrix(part)) for part in (K, M)]
        st = _until(stack, SLEPc.ST().create(PETSc.COMM_SELF))
        st.setType("sinvert")
        st.setMatrices(mats)
        st.setShift(sigma)
        eps = _until(stack, SLEPc.EPS().create(PETSc.COMM_SELF))
        factor.lend(st, stack)
        eps.setST(st)
        eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
        eps.setTarget(sigma)
        eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
        eps.setDimensions(count, min(factor.size - known.shape[1], max(2 * count, count + 15)))
        eps.setTolerances(tol, most)
        eps.setPurify(False)  # done below, in one block and between two deflations
        eps.setInitialSpace(_vectors(stack, mats[0], _start(factor.size, seed)))
        if known.shape[1]:
            eps.setDeflationSpace(_vectors(stack, mats[0], known))
        found = _solve(eps, count, tol, "modes", "check")
        values, shapes = _collect(stack, mats[0], found, lambda i, xr, xi: eps.getEigenpair(i, xr, xi).real, real=True)
    return values, _purified(factor, M, shapes, known)


def _purified(factor: SparseFactor, M: Matrix, shapes: Array, known: Array) -> Array:
    """x ← (K - σM)⁻¹Mx, M-normalised: removes components in the null space of M, where Krylov vectors are arbitrary.

    The step also amplifies remainders of the `known` shapes by 1/|σ|. With rigid-body modes and σ = -1e-7, a share of 1e-9 in the
    Krylov vectors would become 1e-2 of each mode. So these shapes are projected out before and after.
    """
    def deflated(x: Array) -> Array:
        return x - known @ (known.T @ (M @ x)) if known.shape[1] else x

    x = deflated(factor.solve(M @ deflated(shapes)))
    return x / np.sqrt(np.einsum("ij,ij->j", x, M @ x))


def quadratic_modes(factor: SparseFactor | Transposed, matrices: Sequence[Matrix], shift: float, count: int, *, tol: float,
                    scale: float, seed: int = 1, most: int = 1000) -> tuple[Array, Array]:
    """(λ²M + λD + K)x = 0: the λ (k,) nearest to a real shift and their X (n, k), complex, by TOAR.

    `factor` is that of P(shift), and the matrices are (M, D, K). The solver finds μ = λ/scale, with `scale` of the size of the
    wanted eigenvalues. With it the backward error at 10⁵ DOF is 1e-12, with SLEPc's own scaling 5e-11, and Re λ keeps its leading
    digits. Of a conjugate pair only the member with Im λ > 0 is returned.
    """
    PETSc, SLEPc = load()
    M, D, K = matrices
    with ExitStack() as stack:
        mats = [_until(stack, _matrix(part)) for part in (K, scale * D, scale**2 * M)]
        pep = _until(stack, SLEPc.PEP().create(PETSc.COMM_SELF))
        pep.setOperators(mats)
        pep.setType(SLEPc.PEP.Type.TOAR)
        pep.setProblemType(SLEPc.PEP.ProblemType.GENERAL)
        pep.setTarget(shift / scale)
        pep.setWhichEigenpairs(SLEPc.PEP.Which.TARGET_MAGNITUDE)
        pep.setDimensions(count, min(2 * factor.size, max(2 * count, count + 20)))
        pep.setTolerances(tol, most)
        pep.setInitialSpace(_vectors(stack, mats[0], _start(factor.size, seed)))
        st = pep.getST()
        st.setType("sinvert")
        factor.lend(st, stack)
        st.setTransform(True)
        found = _solve(pep, count, tol, "complex modes", "scale")
        values, shapes = _collect(stack, mats[0], found, pep.getEigenpair, real=False)
        keep = values.imag >= 0
        return scale * values[keep], shapes[:, keep]


def _collect(stack: ExitStack, mat: Any, count: int, pair: Callable[..., Any], real: bool) -> tuple[Array, Array]:
    xr, xi = (_until(stack, vector) for vector in mat.createVecs())
    shapes = np.empty((mat.getSize()[0], count), dtype=float if real else complex, order="F")
    values = np.empty(count, dtype=shapes.dtype)
    for i in range(count):
        values[i] = pair(i, xr, xi)
        shapes[:, i] = xr.getArray() if real else xr.getArray() + 1j * xi.getArray()
    return values, shapes
