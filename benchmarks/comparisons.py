"""What scripts/bench.py measures: one function for each measurement, to be called in a process of its own.

Each loads its packages, solves a tiny problem, and only then starts the clock. None of it is used by femsub.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import femsub as fs
from benchmarks.processes import Row, peak_mb

STEEL = (2.1e11, 0.3, 7850.0)
COMPONENTS = {"slab": ((1.0, 0.6, 0.06), "hexahedron"), "bulk": ((1.0, 0.5, 0.25), "hexahedron20")}
SLOPES = 100  # of the sweep
COUNT = "certificate"  # the phase in which `reduce` makes sure that no mode is missing, which nobody else does
GROWTH = 1e-3  # the largest relative error of a growth rate that a reduced model may have to be chosen


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
    lengths, kind = COMPONENTS[component]
    mesh = fs.block(lengths, counts, kind)
    face = mesh.nodes("left")
    away = np.linalg.norm(mesh.points[face] - np.array([0, lengths[1] / 2, lengths[2] / 2]), axis=1)
    mesh = mesh.with_sets(joint=face[np.argsort(away.round(9), kind="stable")[:nodes]])
    return fs.solid(mesh, fs.Material(*STEEL), interface=["joint"], name=component)


# assembly ------------------------------------------------------------------------------------------------------------

def assembly(method: str, kind: str, counts: tuple[int, ...], folder: Path | None) -> Row:
    """K and M of a block by femsub or scikit-fem. With a folder, femsub leaves them there and scikit-fem compares."""
    import scipy.sparse as sp

    make = {"femsub": femsub_matrices, "scikit-fem": skfem_matrices}[method]
    laps, tiny, mesh = Laps(), fs.block((1, 1, 1), (2, 1, 1), kind), fs.block((1.0, 0.5, 0.25), counts, kind)
    make(tiny, laps)
    K, M, basis = make(mesh, laps)
    row = laps.row() | {"dof": K.shape[0], "nonzeros": K.nnz}
    if folder is None:
        return row
    for name, matrix in (("K", K), ("M", M)) if basis is None else ():
        sp.save_npz(folder / f"{kind}-{name}.npz", matrix, compressed=False)
    if basis is None or not (folder / f"{kind}-M.npz").exists():
        return row
    at = femsub_dof(basis, mesh.points)
    return row | {"error": max(entry_error(sp.load_npz(folder / f"{kind}-{name}.npz")[at][:, at], matrix)
                               for name, matrix in (("K", K), ("M", M)))}


def femsub_matrices(mesh: fs.Mesh, laps: Laps) -> tuple[Any, Any, None]:
    from femsub.components.solid_assembly import stiffness_and_mass

    laps.begin()
    K, M = stiffness_and_mass(mesh, [(fs.Material(*STEEL), np.arange(len(mesh.cells)))])
    laps("K and M")
    return K, M, None


def skfem_matrices(mesh: fs.Mesh, laps: Laps) -> tuple[Any, Any, Any]:
    import skfem
    from skfem.helpers import dot
    from skfem.models.elasticity import linear_elasticity

    from femsub.components.solid_assembly import exact_degree
    from femsub.components.solid_elements import quadrature, reference

    used, corners = np.unique(mesh.cells[:, :8], return_inverse=True)
    theirs, ours = skfem.ElementHex1().doflocs, reference(mesh.kind).nodes[:8]
    order = np.abs(theirs[:, None] - ours).max(axis=2).argmin(axis=1)  # of the corners, by their place
    grid = skfem.MeshHex(mesh.points[used].T.copy(), corners.reshape(-1, 8)[:, order].T.copy())
    X, w = quadrature(mesh.kind, int(exact_degree(mesh, np.arange(len(mesh.cells))).max()))
    element = {"hexahedron20": skfem.ElementHexS2, "hexahedron27": skfem.ElementHex2}[mesh.kind]()
    material = fs.Material(*STEEL)
    laps.begin()
    basis = skfem.Basis(grid, skfem.ElementVector(element), quadrature=(np.ascontiguousarray(X.T), w))
    laps("basis")
    K = linear_elasticity(*material.lame).assemble(basis)
    laps("K")
    M = skfem.BilinearForm(lambda u, v, _: material.rho * dot(u, v)).assemble(basis)
    laps("M")
    return K, M, basis


def femsub_dof(basis: Any, points: np.ndarray) -> np.ndarray:
    """The DOF 3 i + a of femsub for each of scikit-fem's, by its place and direction."""
    from scipy.spatial import cKDTree

    direction = np.empty(basis.N, dtype=int)
    direction[basis.element_dofs] = (np.arange(len(basis.element_dofs)) % 3)[:, None]
    return 3 * cKDTree(points).query(basis.doflocs.T)[1] + direction


def entry_error(A: Any, B: Any) -> float:
    """max |a_ij - b_ij| / sqrt(b_ii b_jj), which no unit and no large entry elsewhere can hide."""
    size, difference = np.sqrt(B.diagonal()), abs(A - B).tocoo()
    return float((difference.data / (size[difference.row] * size[difference.col])).max(initial=0.0))


# bases ---------------------------------------------------------------------------------------------------------------

def bases(method: str, component: str, sizes: Row, folder: Path | None) -> Row:
    """One way to the HCB basis. With a folder, femsub leaves its result there and the others compare theirs with it."""
    from femsub.modes.normal_modes import relative_residual

    make, laps = METHODS[method], Laps()
    make(solid("slab", (5, 3, 2), 4), 3, laps)
    sub = solid(component, sizes[component], sizes["interface"])
    values, V, M, K, factorisations = make(sub, sizes["modes"], laps)
    row = laps.row() | {"dof": sub.size, "interface": len(sub.interface), "factorisations": factorisations}
    b, i = len(sub.interface), sub.interior
    row["residual"] = float(relative_residual(sub.K[i][:, i], sub.M[i][:, i], values, V[i, b:]).max())
    found = {"values": values, "constraint": V[:, :b], "M": np.sqrt(M.diagonal()[:b]), "K": K[:b, :b]}
    for name, array in found.items():
        if folder is None:
            break
        if method == "femsub":
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


def scipy_bases(sub: fs.Substructure, modes: int, laps: Laps, **options: Any) -> tuple[Any, ...]:
    import scipy.sparse as sp
    from scipy.sparse.linalg import LinearOperator, eigsh, splu

    laps.begin()
    K, M, load = partitioned(sub)
    factor = splu(sp.csc_array(K), **options)
    laps("factor")
    inverse = LinearOperator(K.shape, factor.solve, dtype=float)
    values, fixed = eigsh(K, modes, M, sigma=0, OPinv=inverse)
    laps("modes")
    constraint = -factor.solve(load)
    laps("constraint modes")
    del factor, inverse
    return values, *projected(sub, constraint, fixed, laps), 1


def pardiso_bases(sub: fs.Substructure, modes: int, laps: Laps) -> tuple[Any, ...]:
    """MKL's Cholesky factor of the upper triangle, in SciPy's `eigsh` and for all constraint modes at once."""
    import scipy.sparse as sp
    from pypardiso import PyPardisoSolver
    from scipy.sparse.linalg import LinearOperator, eigsh

    laps.begin()
    K, M, load = partitioned(sub)
    upper, solver = sp.csr_matrix(sp.triu(K)), PyPardisoSolver(mtype=2)
    solver.factorize(upper)
    laps("factor")

    def solved(b: np.ndarray) -> np.ndarray:
        x: np.ndarray = solver.solve(upper, b)
        return x

    values, fixed = eigsh(K, modes, M, sigma=0, OPinv=LinearOperator(K.shape, solved, dtype=float))
    laps("modes")
    constraint = -solved(np.asfortranarray(load))
    laps("constraint modes")
    solver.free_memory(everything=True)
    return values, *projected(sub, constraint, fixed, laps), 1


def slepc_bases(sub: fs.Substructure, modes: int, laps: Laps, package: str) -> tuple[Any, ...]:
    from femsub.algebra.petsc import load as solvers

    PETSc, SLEPc = solvers()

    laps.begin()
    K, M, load = partitioned(sub)
    A, B = (PETSc.Mat().createAIJ(part.shape, csr=(part.indptr, part.indices, part.data), comm=PETSc.COMM_SELF)
            for part in (K, M))
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
    "femsub": femsub_bases, "SciPy, MKL Pardiso": pardiso_bases,
    "SciPy": partial(scipy_bases, **SYMMETRIC), "SciPy, defaults": scipy_bases,
    "SLEPc, CHOLMOD": partial(slepc_bases, package="cholmod"),
    "SLEPc, MUMPS": partial(slepc_bases, package="mumps")}


# CEA -----------------------------------------------------------------------------------------------------------------

def pad(counts: tuple[int, ...]) -> fs.Substructure:
    """0.2 x 0.1 x 0.04 m, held at x = 0, joined at the corners of x = 0.2 (12 DOF), a belt across a patch on the top."""
    mesh = fs.block((0.2, 0.1, 0.04), counts, "hexahedron20")
    mesh = mesh.with_sets(
        joint=lambda x: (x[:, 0] == 0.2) & np.isin(x[:, 1], (0.0, 0.1)) & np.isin(x[:, 2], (0.0, 0.04)),
        patch=lambda x: (x[:, 2] == 0.04) & (np.abs(x[:, 0] - 0.1) < 0.0501) & (x[:, 1] > 0.0249))
    return fs.solid(mesh, fs.Material(*STEEL), supports=["left"], interface=["joint"], rayleigh=(5.0, 1e-7),
                    ports={"belt": ("patch", (0.8, 0.6, 0.0))}, name="pad")


def setting(counts: tuple[int, ...], modes: int) -> Row:
    """The band, which holds so many modes, and the slopes: from 0 to half more than the critical one."""
    sub = pad(counts)
    omega = fs.normal_modes(sub, count=modes + 1).frequencies
    band = (0.0, float(omega[-2:].mean()))
    rom = fs.reduce(sub, fs.CraigChang(modes=2 * modes), ports=True)
    critical = float(fs.critical_slope(rom, band=band))
    return {"dof": sub.size, "interface": len(sub.interface), "band": band, "critical_slope": critical,
            "slopes": np.linspace(0.0, 1.5 * critical, SLOPES)}


def full_cea(counts: tuple[int, ...], slopes: np.ndarray, band: tuple[float, float]) -> Row:
    """The PEP at each slope; its eigenvalues without the shapes."""
    laps, spectra = Laps(), []
    fs.complex_modes(pad((4, 4, 1)), fs.Belt(slope=-1.0), count=4)
    sub = pad(counts)
    laps.begin()
    for slope in slopes:
        modes = fs.complex_modes(sub, fs.Belt(slope=float(slope)), band=band, evidence=False)
        laps(f"slope {slope:.4g}")
        spectra.append(replace(modes, shapes=np.zeros((0, len(modes)))))
    return laps.row() | {"spectra": spectra}


def reductions(counts: tuple[int, ...], kept: tuple[int, ...], slopes: np.ndarray, spectra: list[fs.ComplexModes]) -> Row:
    """HCB and CC with more and more modes against the full spectra; the smallest within GROWTH, ready for the sweep."""
    from femsub.algebra.factor import release
    from femsub.modes.quadratic.matching import spectrum_errors

    sub, models = pad(counts), {}
    tried: list[Row] = []
    for method in (fs.CraigBampton, fs.CraigChang):
        for modes in kept:
            release(sub)  # each reduction by itself
            start = time.perf_counter()
            rom = fs.reduce(sub, method(modes=modes), ports=True)
            seconds = time.perf_counter() - start
            errors = [spectrum_errors(full, fs.complex_modes(rom, fs.Belt(slope=float(slope))))
                      for slope, full in zip(slopes, spectra, strict=True)]
            growth = max(np.inf if found.missing or np.isnan(found.growth) else found.growth for found in errors)
            tried.append({"method": method.__name__, "modes": modes, "size": rom.size, "growth_error": growth,
                          "reduction_seconds": seconds})
            if growth <= GROWTH:
                models[len(tried) - 1] = (rom.M, rom.K, rom.D, rom.port("belt"))
                break
    best = min(models, key=lambda at: tried[at]["size"], default=None)
    return {"tried": tried} if best is None else {"tried": tried, "chosen": tried[best], "model": models[best]}


def reduced_cea(model: tuple[np.ndarray, ...], slopes: np.ndarray, band: tuple[float, float]) -> Row:
    M, K, D, w = model
    laps, rom = Laps(), fs.Substructure(M, K, D, ports={"belt": w})
    fs.sweep(rom, fs.Belt(slope=0.0), "slope", slopes[:2], band=band)
    laps.begin()
    fs.sweep(rom, fs.Belt(slope=0.0), "slope", slopes, band=band)
    laps("sweep")
    return laps.row()
