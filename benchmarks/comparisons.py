"""What `python -m benchmarks bases` measures: one function for each measurement, to be called in a process of its own.

Each loads its packages, solves a tiny problem, and only then starts the clock. None of it is used by femsub.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

import femsub as fs
from benchmarks.processes import Row, peak_mb

STEEL = (2.1e11, 0.3, 7850.0)
BLOCKS = {"slab": ((1.0, 0.6, 0.06), "hexahedron"), "bulk": ((1.0, 0.5, 0.25), "hexahedron20")}
DISC = "disc"  # a brake's disc with two pads
COMPONENTS = {"slab": "slab of 8-node hexahedra", "bulk": "bulk of 20-node hexahedra", DISC: "disc with pads"}
DUST = 1e-14  # share of a contact's largest stiffness below which an entry is rounding
ROWS = 500  # of the constraint modes that are compared
REFERENCE = "femsub"  # what others are compared with
Solve: TypeAlias = Callable[[np.ndarray], np.ndarray]
Factorise: TypeAlias = Callable[[Any], AbstractContextManager[Solve]]
Lowest: TypeAlias = Callable[[Any, Any, int, Solve], tuple[np.ndarray, np.ndarray]]


class Laps:
    """Seconds from one call to the next, by name; `begin` starts the clock."""

    def begin(self) -> None:
        self.base, self.last = peak_mb(), time.perf_counter()
        self.seconds: dict[str, float] = {}

    def __call__(self, name: str) -> None:
        now = time.perf_counter()
        self.seconds[name] = self.seconds.get(name, 0.0) + now - self.last
        self.last = now

    def split(self, phases: dict[str, float]) -> None:
        """Takes the phases that were measured within the last lap out of it."""
        lap = list(self.seconds)[-1]
        self.seconds[lap] -= sum(phases.values())
        self.seconds |= phases

    def row(self) -> Row:
        """What the clock has seen, and the memory up to here."""
        return {"seconds": sum(self.seconds.values()), "phases": self.seconds, "peak_mb": peak_mb(), "base_mb": self.base}


def solid(component: str, counts: tuple[int, ...], nodes: int) -> fs.Substructure:
    """Slab or bulk; its interface are the `nodes` nodes about the middle of the face x = 0."""
    lengths, kind = BLOCKS[component]
    mesh = fs.block(lengths, counts, kind)
    mesh = mesh.with_sets(joint=about(mesh, mesh.nodes("left"), np.array([0, lengths[1] / 2, lengths[2] / 2]), nodes))
    return fs.solid(mesh, fs.Material(*STEEL), interface=["joint"], name=component)


def about(mesh: fs.Mesh, face: np.ndarray, middle: np.ndarray, count: int) -> np.ndarray:
    """The nodes of a face that are nearest to its middle."""
    away = np.linalg.norm(mesh.points[face] - middle, axis=1)
    return face[np.argsort(away.round(9), kind="stable")[:count]]


def disc(size: float, nodes: int) -> fs.Substructure:
    """The undamped brake with elements of so many metres: disc and pads on the stiffness of their contact, without friction.

    The interface are the `nodes` nodes about the middles of the pads' backs, half of them on each. It holds the pads, so that the
    springs of the scene's brake are left out.
    """
    from benchmarks.brake import brake
    from femsub.app.scenes.brake import PADS

    made = brake(size)
    system = fs.couple({name: made.part(name) for name in ("disc", *PADS)}, made.contacts(0.0), DISC)
    contact = system.linearised(made.contacts(0.0)).K - system.K
    # normals are tilted by rounding, so that DOF along the contact would join the parts for nothing
    contact.data[np.abs(contact.data) < DUST * np.abs(contact.data).max()] = 0.0
    contact.eliminate_zeros()
    start, interface = 0, []
    for name, part in system.parts.items():
        if name in PADS:  # nothing holds a DOF of a pad, so that node i has the DOF 3 i to 3 i + 2
            mesh, back = made.meshes[name], made.meshes[name].nodes("back")
            chosen = np.sort(about(mesh, back, mesh.points[back].mean(axis=0), nodes // 2))
            interface.append(start + (3 * chosen[:, None] + np.arange(3)).ravel())
        start += part.size
    return fs.Substructure(system.M, system.K + contact, interface=np.concatenate(interface), name=DISC)


def built(component: str, size: Any, nodes: int) -> fs.Substructure:
    """Slab or bulk of so many cells, or the disc with pads of elements so long."""
    return disc(size, nodes) if component == DISC else solid(component, size, nodes)


def size_for(component: str, size: Any, dof: int) -> Any:
    """What `built` takes to make about so many DOF: the cells of a block in the proportions of those given, or a length."""
    if component != DISC:
        counts = np.maximum(1, np.outer(np.linspace(0.02, 4.0, 4000), size).round()).astype(int)
        found = counts[np.abs(np.log(_dof(counts, BLOCKS[component][1]) / dof)).argmin()]
        return tuple(int(count) for count in found)
    tried: dict[float, float] = {}
    for _ in range(6):  # elements are counted in whole numbers, so that DOF grow by steps: the nearest of some
        tried[size] = _disc_dof(size) / dof
        size *= tried[size] ** 0.4
    return min(tried, key=lambda one: abs(np.log(tried[one])))


def _dof(counts: np.ndarray, kind: str) -> np.ndarray:
    """Of blocks with so many cells (k, 3): 3 for each corner, and for the middle of each edge where there are such nodes."""
    corners = np.prod(counts + 1, axis=1)
    edges = sum(corners * counts[:, axis] / (counts[:, axis] + 1) for axis in range(3))
    return np.asarray(3 * (corners + (edges if kind == "hexahedron20" else 0)))


def _disc_dof(size: float) -> int:
    from femsub.coupling import brake_meshes

    meshes = brake_meshes(size)
    return 3 * (sum(len(mesh.points) for mesh in meshes.values()) - len(meshes["disc"].nodes("hub")))


def bases(method: str, component: str, size: Any, nodes: int, modes: int, folder: Path | None) -> Row:
    """One way to the HCB basis. With a folder, femsub leaves its result there and the others compare theirs with it."""
    from femsub.modes.normal_modes import relative_residual

    laps = Laps()
    make = METHODS[method]
    make(solid("slab", (5, 3, 2), 4), 3, laps)
    sub = built(component, size, nodes)
    values, V, M, K, factorisations = make(sub, modes, laps)
    row = laps.row() | {"dof": sub.size, "interface": len(sub.interface), "factorisations": factorisations}
    row["values"] = [float(value) for value in values]
    b, i = len(sub.interface), sub.interior
    row["residual"] = float(relative_residual(sub.K[i][:, i], sub.M[i][:, i], values, V[i, b:]).max())
    rows = np.linspace(0, sub.size - 1, min(ROWS, sub.size)).astype(int)
    found = {"values": values, "constraint": V[rows, :b], "M": np.sqrt(M.diagonal()[:b]), "K": K[:b, :b]}
    for name, array in found.items():
        if folder is None:
            break
        if method == REFERENCE:
            np.save(folder / f"{name}.npy", array)
        elif (folder / f"{name}.npy").exists():
            ours = np.load(folder / f"{name}.npy")
            scale = np.abs(array) if name == "values" else np.abs(array).max()
            row[f"error_{name}"] = float((np.abs(ours - array) / scale).max())
    return row


def femsub_bases(sub: fs.Substructure, modes: int, laps: Laps) -> tuple[Any, ...]:
    from femsub.algebra.factor import factors_made
    from femsub.algebra.timing import timed

    before = factors_made()
    laps.begin()
    with timed() as phases:
        rom = fs.reduce(sub, fs.CraigBampton(modes=modes))
    laps("modes and constraint modes")
    laps.split(phases)
    return rom.K.diagonal()[len(sub.interface):], rom.V, rom.M, rom.K, factors_made() - before


def factored_bases(sub: fs.Substructure, modes: int, laps: Laps, factorise: Factorise, lowest: Lowest) -> tuple[Any, ...]:
    """One factor of K_ii, for the modes and for all constraint modes at once."""
    laps.begin()
    K, M, load = partitioned(sub)
    with factorise(K) as solve:
        laps("factor")
        values, fixed = lowest(K, M, modes, solve)
        laps("modes")
        constraint = -solve(load)
        laps("constraint modes")
    return values, *projected(sub, constraint, fixed, laps), 1


@contextmanager
def superlu(K: Any, **options: Any) -> Iterator[Solve]:
    import scipy.sparse as sp
    from scipy.sparse.linalg import splu

    yield splu(sp.csc_array(K), **options).solve


@contextmanager
def pardiso(K: Any) -> Iterator[Solve]:
    """MKL's Cholesky factor of the upper triangle."""
    import scipy.sparse as sp
    from pypardiso import PyPardisoSolver

    upper, solver = sp.csr_matrix(sp.triu(K)), PyPardisoSolver(mtype=2)
    solver.factorize(upper)
    yield lambda b: np.asarray(solver.solve(upper, np.asfortranarray(b)))
    solver.free_memory(everything=True)


@contextmanager
def cholmod(K: Any) -> Iterator[Solve]:
    """CHOLMOD's factor by PETSc, for all columns of a block at once."""
    from femsub.algebra.petsc import SparseFactor

    factor = SparseFactor(K, "definite", probed=False)
    if factor.package != "cholmod":
        raise MemoryError("CHOLMOD's factor does not fit")
    yield factor.solve
    factor.close()


def fastest(K: Any) -> AbstractContextManager[Solve]:
    """Pardiso where it is installed, else SuperLU."""
    return pardiso(K) if find_spec("pypardiso") else superlu(K, **SYMMETRIC)


def arpack(K: Any, M: Any, modes: int, solve: Solve) -> tuple[np.ndarray, np.ndarray]:
    from scipy.sparse.linalg import LinearOperator, eigsh

    values, shapes = eigsh(K, modes, M, sigma=0, OPinv=LinearOperator(K.shape, solve, dtype=float))
    return values, shapes


def primme(K: Any, M: Any, modes: int, solve: Solve) -> tuple[np.ndarray, np.ndarray]:
    """Generalised Davidson, which needs the fewest solves of PRIMME's methods, with K⁻¹ as its preconditioner.

    Of block sizes and bases that were tried, blocks of 8 in a basis twice as large as the number of modes took least time.
    ``tol`` is relative to the highest eigenvalue: 1e-12 of it makes residuals of about 1e-11 of K's and M's terms.
    """
    from primme import eigsh
    from scipy.sparse.linalg import LinearOperator

    inverse = LinearOperator(K.shape, matvec=solve, matmat=solve, dtype=float)
    values, shapes = eigsh(K, modes, M, which="SA", OPinv=inverse, tol=1e-12, method="PRIMME_DEFAULT_MIN_MATVECS",
                           maxBlockSize=8, ncv=min(max(2 * modes, modes + 20), K.shape[0]))
    order = np.argsort(values)
    return values[order], shapes[:, order]


def slepc_bases(sub: fs.Substructure, modes: int, laps: Laps, package: str) -> tuple[Any, ...]:
    from femsub.algebra.petsc import load as solvers

    PETSc, SLEPc = solvers()

    laps.begin()
    K, M, load = partitioned(sub)
    A, B = (PETSc.Mat().createAIJ(part.shape, csr=(part.indptr.astype(PETSc.IntType), part.indices.astype(PETSc.IntType),
                                                   part.data), comm=PETSc.COMM_SELF) for part in (K, M))
    A.setOption(PETSc.Mat.Option.SPD, True)
    B.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    eps = SLEPc.EPS().create(PETSc.COMM_SELF)
    eps.setOperators(A, B)
    eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    eps.setDimensions(modes)
    eps.setTarget(0.0)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    st = eps.getST()
    st.setType("sinvert")
    ksp = st.getKSP()
    ksp.setType("preonly")
    ksp.getPC().setType("cholesky")
    ksp.getPC().setFactorSolverType(package)
    eps.setUp()
    laps("factor")
    eps.solve()
    x, b = A.createVecs()
    values, fixed, constraint = np.empty(modes), np.empty((len(K.indptr) - 1, modes)), np.empty_like(load)
    for j in range(modes):
        values[j] = eps.getEigenpair(j, x).real
        fixed[:, j] = x.getArray()
    laps("modes")
    for j in range(load.shape[1]):
        b.setArray(load[:, j])
        ksp.solve(b, x)
        constraint[:, j] = -x.getArray()
    laps("constraint modes")
    for thing in (ksp, st, eps, A, B, x, b):
        thing.destroy()
    return values, *projected(sub, constraint, fixed, laps), 1


def partitioned(sub: fs.Substructure) -> tuple[Any, Any, np.ndarray]:
    """K_ii, M_ii and a dense K_ib."""
    b, i = sub.interface, sub.interior
    return sub.K[i][:, i], sub.M[i][:, i], sub.K[i][:, b].toarray()


def projected(sub: fs.Substructure, constraint: np.ndarray, fixed: np.ndarray, laps: Laps) -> tuple[np.ndarray, ...]:
    """V, VᵀMV and VᵀKV."""
    b = len(sub.interface)
    V = np.zeros((sub.size, b + fixed.shape[1]))
    V[sub.interface, np.arange(b)] = 1.0
    V[sub.interior, :b], V[sub.interior, b:] = constraint, fixed
    M, K = V.T @ (sub.M @ V), V.T @ (sub.K @ V)
    laps("projection")
    return V, M, K


# What SuperLU's guide names for a matrix like K_ii: an ordering of K + Kᵀ, and pivots from the diagonal.
SYMMETRIC: dict[str, Any] = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
METHODS: dict[str, Callable[..., tuple[Any, ...]]] = {
    REFERENCE: femsub_bases, "SciPy, MKL Pardiso": partial(factored_bases, factorise=pardiso, lowest=arpack),
    "SciPy": partial(factored_bases, factorise=partial(superlu, **SYMMETRIC), lowest=arpack),
    "SciPy, defaults": partial(factored_bases, factorise=superlu, lowest=arpack),
    "SLEPc, CHOLMOD": partial(slepc_bases, package="cholmod"), "SLEPc, MUMPS": partial(slepc_bases, package="mumps"),
    "PRIMME": partial(factored_bases, factorise=fastest, lowest=primme),
    "PRIMME, CHOLMOD": partial(factored_bases, factorise=cholmod, lowest=primme)}
NAMES = tuple(METHODS)
