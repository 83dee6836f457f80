"""Craig-Bampton bases of solid components against SciPy, plain SLEPc and PRIMME: ratios of seconds and memory.

    python -m benchmarks bases [--component slab bulk disc] [--times FACTOR ...] [--modes N ...] [--only METHOD ...]
                               [--limit SECONDS] [--repeats N] [--out DIR] [--quick]

--component  slab or bulk of hexahedra, or a disc with pads; --times: factors of their DOF (about 110,000, 39,000, 49,000)
--modes      of the fixed interface; --only: femsub and these methods alone
--limit      seconds of one measurement, the component's assembly included; --repeats: runs of each
--quick      tiny sizes, to test the command; their times mean nothing

The task is to compute all constraint modes and 40 fixed-interface modes, with the reduced M and K. `reduce` computes and
certifies them. It is compared with other solvers that are available today:
- SciPy's `eigsh(sigma=0)` with MKL's Pardiso (the extra `pardiso`), and with SuperLU and its options for symmetric matrices.
- SLEPc as it comes, with CHOLMOD and MUMPS: one factor in Krylov-Schur and in a KSP that solves column by column.
- PRIMME (the extra `primme`) with the factor of Pardiso, or of SuperLU without it, as its preconditioner.
Only `reduce` counts the modes by a second factorisation, and its time includes the count. The error is the largest error of ω
relative to femsub's certified frequencies. A mode is missed if no frequency lies within 1 % of it.

All methods are measured in one run, in alternating order, each time in a separate process, so that the peak of its resident
memory is its own. Each process loads its packages, solves a tiny problem, and only then starts the clock. Ratios are medians
over the repeats, with minimum and maximum. The results are written to bases.csv and bases.json. Each measurement is a line of
DIR/measured.jsonl. The same call continues a stopped run, and also prints other cases in the folder. A measurement that takes
longer than --limit, or more memory than there is, is marked.
"""

from __future__ import annotations

import json
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
from scipy.optimize import linear_sum_assignment

import femsub as fs
from benchmarks import UsageError
from benchmarks.processes import Row, StoppedError, Worker, begin, fresh, machine, peak_mb
from femsub.algebra.petsc import has_cholmod
from femsub.app import report
from femsub.app.result import Result
from femsub.output import Table, table

STEEL = (2.1e11, 0.3, 7850.0)
BLOCKS = {"slab": ((1.0, 0.6, 0.06), "hexahedron"), "bulk": ((1.0, 0.5, 0.25), "hexahedron20")}
DISC = "disc"  # a brake's disc with two pads
COMPONENTS = {"slab": "slab of 8-node hexahedra", "bulk": "bulk of 20-node hexahedra", DISC: "disc with pads"}
SIZES: dict[bool, Row] = {  # by --quick: bricks or element length, nodes of the interface, modes
    False: {"slab": (90, 58, 6), "bulk": (40, 20, 10), "disc": 0.0085, "interface": 84, "modes": 40},
    True: {"slab": (8, 6, 2), "bulk": (4, 3, 2), "disc": 0.04, "interface": 6, "modes": 6}}
DUST = 1e-14  # share of a contact's largest stiffness below which an entry is rounding
ROWS = 500  # of the constraint modes that are compared
LOST = 1e-2  # a mode is missed if no frequency is nearer than this relative distance
REFERENCE = "femsub"  # the method with which others are compared
PACKAGES = {"SciPy, MKL Pardiso": "pypardiso", "PRIMME": "primme"}  # that methods need
COLUMNS = {"case": "", "method": "", "dof": ",d", "seconds": ".3g", "seconds_least": ".3g", "seconds_most": ".3g", "times": ".3g",
           "times_least": ".3g", "times_most": ".3g", "peak_mb": ".0f", "base_mb": ".0f", "error": ".0e", "missed": "d",
           "residual": ".0e", "ended": ""}
Solve: TypeAlias = Callable[[np.ndarray], np.ndarray]
Factorise: TypeAlias = Callable[[Any], AbstractContextManager[Solve]]
Lowest: TypeAlias = Callable[[Any, Any, int, Solve], tuple[np.ndarray, np.ndarray]]


# ---- the components


def about(mesh: fs.Mesh, face: np.ndarray, middle: np.ndarray, count: int) -> np.ndarray:
    """The nodes of a face that are nearest to its middle."""
    away = np.linalg.norm(mesh.points[face] - middle, axis=1)
    return face[np.argsort(away.round(9), kind="stable")[:count]]


def solid(component: str, counts: tuple[int, ...], nodes: int) -> fs.Substructure:
    """Slab or bulk; its interface are the `nodes` nodes about the middle of the face x = 0."""
    lengths, kind = BLOCKS[component]
    mesh = fs.block(lengths, counts, kind)
    mesh = mesh.with_sets(joint=about(mesh, mesh.nodes("left"), np.array([0, lengths[1] / 2, lengths[2] / 2]), nodes))
    return fs.solid(mesh, fs.Material(*STEEL), interface=["joint"], name=component)


def disc(size: float, nodes: int) -> fs.Substructure:
    """The undamped brake with elements of so many metres: disc and pads on the stiffness of their contact, without friction.

    The interface are the `nodes` nodes about the middles of the pads' backs, half of them on each. It holds the pads, so that the
    springs of the scene's brake are left out.
    """
    from femsub.app.grammar import Scene

    finer = {name: {"solid": {"brake": name, "size": size}} for name in ("disc", "inboard", "outboard")}
    made = Scene({"scene": "brake", "part": finer}).models
    system = fs.couple(made.full.parts, made.at({"mu": 0.0}), DISC)
    contact = system.linearised(made.at({"mu": 0.0})).K - system.K
    # rounding tilts the normals: without this, DOF along the contact would join the parts needlessly
    contact.data[np.abs(contact.data) < DUST * np.abs(contact.data).max()] = 0.0
    contact.eliminate_zeros()
    start, interface = 0, []
    for name, part in system.parts.items():
        if name != "disc":  # nothing holds a DOF of a pad, so that node i has the DOF 3 i to 3 i + 2
            mesh, back = made.meshes[name], made.meshes[name].nodes("back")
            chosen = np.sort(about(mesh, back, mesh.points[back].mean(axis=0), nodes // 2))
            interface.append(start + (3 * chosen[:, None] + np.arange(3)).ravel())
        start += part.size
    return fs.Substructure(system.M, system.K + contact, interface=np.concatenate(interface), name=DISC)


# ---- the methods


def femsub_bases(sub: fs.Substructure, modes: int) -> tuple[Any, ...]:
    rom = fs.reduce(sub, fs.CraigBampton(modes=modes))
    return rom.K.diagonal()[len(sub.interface):], rom.V, rom.M, rom.K


def factored_bases(sub: fs.Substructure, modes: int, factorise: Factorise, lowest: Lowest) -> tuple[Any, ...]:
    """One factor of K_ii, for the modes and for all constraint modes at once."""
    K, M, load = partitioned(sub)
    with factorise(K) as solve:
        values, fixed = lowest(K, M, modes, solve)
        return values, *projected(sub, -solve(load), fixed)


@contextmanager
def superlu(K: Any) -> Iterator[Solve]:
    """What SuperLU's guide names for a matrix like K_ii: an ordering of K + Kᵀ, and pivots from the diagonal."""
    import scipy.sparse as sp
    from scipy.sparse.linalg import splu

    yield splu(sp.csc_array(K), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}).solve


@contextmanager
def pardiso(K: Any) -> Iterator[Solve]:
    """MKL's Cholesky factor of the upper triangle."""
    import scipy.sparse as sp
    from pypardiso import PyPardisoSolver

    upper, solver = sp.csr_matrix(sp.triu(K)), PyPardisoSolver(mtype=2)
    solver.factorize(upper)
    yield lambda b: np.asarray(solver.solve(upper, np.asfortranarray(b)))
    solver.free_memory(everything=True)


def fastest(K: Any) -> AbstractContextManager[Solve]:
    """Pardiso where it is installed, else SuperLU."""
    return pardiso(K) if find_spec("pypardiso") else superlu(K)


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


def slepc_bases(sub: fs.Substructure, modes: int, package: str) -> tuple[Any, ...]:
    from femsub.algebra.petsc import load as solvers

    PETSc, SLEPc = solvers()
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
    eps.solve()
    x, b = A.createVecs()
    values, fixed, constraint = np.empty(modes), np.empty((len(K.indptr) - 1, modes)), np.empty_like(load)
    for j in range(modes):
        values[j] = eps.getEigenpair(j, x).real
        fixed[:, j] = x.getArray()
    for j in range(load.shape[1]):
        b.setArray(load[:, j])
        ksp.solve(b, x)
        constraint[:, j] = -x.getArray()
    for thing in (ksp, st, eps, A, B, x, b):
        thing.destroy()
    return values, *projected(sub, constraint, fixed)


def partitioned(sub: fs.Substructure) -> tuple[Any, Any, np.ndarray]:
    """K_ii, M_ii and a dense K_ib."""
    b, i = sub.interface, sub.interior
    return sub.K[i][:, i], sub.M[i][:, i], sub.K[i][:, b].toarray()


def projected(sub: fs.Substructure, constraint: np.ndarray, fixed: np.ndarray) -> tuple[np.ndarray, ...]:
    """V, VᵀMV and VᵀKV."""
    b = len(sub.interface)
    V = np.zeros((sub.size, b + fixed.shape[1]))
    V[sub.interface, np.arange(b)] = 1.0
    V[sub.interior, :b], V[sub.interior, b:] = constraint, fixed
    return V, V.T @ (sub.M @ V), V.T @ (sub.K @ V)


METHODS: dict[str, Callable[..., tuple[Any, ...]]] = {
    REFERENCE: femsub_bases, "SciPy, MKL Pardiso": partial(factored_bases, factorise=pardiso, lowest=arpack),
    "SciPy": partial(factored_bases, factorise=superlu, lowest=arpack),
    "SLEPc, CHOLMOD": partial(slepc_bases, package="cholmod"), "SLEPc, MUMPS": partial(slepc_bases, package="mumps"),
    "PRIMME": partial(factored_bases, factorise=fastest, lowest=primme)}
NAMES = tuple(METHODS)


# ---- measurements


def measure(method: str, component: str, size: Any, nodes: int, modes: int, folder: Path) -> Row:
    """One way to the HCB basis. femsub leaves its result in the folder, and the others compare theirs with it."""
    from femsub.modes.normal_modes import relative_residual

    METHODS[method](solid("slab", (5, 3, 2), 4), 3)
    sub = disc(size, nodes) if component == DISC else solid(component, size, nodes)
    base, start = peak_mb(), time.perf_counter()
    values, V, M, K = METHODS[method](sub, modes)
    row: Row = {"seconds": time.perf_counter() - start, "peak_mb": peak_mb(), "base_mb": base, "dof": sub.size,
                "interface": len(sub.interface), "values": list(values)}
    b, i = len(sub.interface), sub.interior
    row["residual"] = float(relative_residual(sub.K[i][:, i], sub.M[i][:, i], values, V[i, b:]).max())
    rows = np.linspace(0, sub.size - 1, min(ROWS, sub.size)).astype(int)
    found = {"values": values, "constraint": V[rows, :b], "M": np.sqrt(M.diagonal()[:b]), "K": K[:b, :b]}
    folder.mkdir(parents=True, exist_ok=True)
    for name, array in found.items():
        if method == REFERENCE:
            np.save(folder / f"{name}.npy", array)
        elif (folder / f"{name}.npy").exists():
            ours = np.load(folder / f"{name}.npy")
            scale = np.abs(array) if name == "values" else np.abs(array).max()
            row[f"error_{name}"] = float((np.abs(ours - array) / scale).max())
    return row


def measured_before(path: Path) -> list[Row]:
    """The measurements in a file: a run that was stopped goes on with what is there."""
    rows = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines() if path.exists() else []:
        try:
            rows += [json.loads(line)] if line else []
        except ValueError:  # the process was killed while it wrote it
            print(f"{path}: a line is damaged, and is made anew: {line[:80]!r}", file=sys.stderr)
    return rows


def compared(certified: np.ndarray, found: Sequence[float] | np.ndarray) -> tuple[float, int]:
    """The largest relative error of frequencies, and how many of the certified ones are missed.

    Each certified frequency has one partner at most, and the sum of min(|Δω|/ω, LOST) is the least possible. A frequency whose
    partner is LOST or further away is missed, and counts in no error.
    """
    distance = np.abs(np.asarray(found)[None, :] - certified[:, None]) / certified[:, None]
    pairs = linear_sum_assignment(np.minimum(distance, LOST))
    errors = distance[pairs]
    return float(errors[errors < LOST].max(initial=0.0)), len(certified) - int((errors < LOST).sum())


def rows_of(runs: Sequence[Row]) -> list[Row]:
    """A row for each method of a case: medians, spread, memory, and seconds over femsub's, round by round."""
    found = []
    done = {(row["method"], row["round"]): row for row in runs if "seconds" in row}
    dof, columns = (max((row[key] for row in done.values()), default=0) for key in ("dof", "interface"))
    reference = next((name for name in NAMES if (name, 0) in done), "")
    for name in NAMES:
        mine = {turn: row for (method, turn), row in done.items() if method == name}
        ended = next((row["ended"] for row in runs if row["method"] == name and "ended" in row), None)
        if not mine and not ended:
            continue
        row: Row = {"component": runs[0]["component"], "interface": columns, "modes": runs[0]["modes"], "method": name,
                    "case": f"{runs[0]['component']}, {columns} + {runs[0]['modes']}", "dof": dof, "runs": len(mine),
                    "reference": reference, "ended": ended}
        if mine:
            first = next(iter(mine.values()))
            # ratios within one round, so that a slow phase of the machine affects both methods
            for key, values in (("seconds", [run["seconds"] for run in mine.values()]),
                                ("times", [run["seconds"] / done[REFERENCE, turn]["seconds"] for turn, run in mine.items()
                                           if (REFERENCE, turn) in done])):
                if values:
                    row |= {key: statistics.median(values), f"{key}_least": min(values), f"{key}_most": max(values)}
            row |= {key: statistics.median(run[key] for run in mine.values()) for key in ("peak_mb", "base_mb")}
            row |= {key: first[key] for key in first if key == "residual" or key.startswith("error")}
            row["error"], row["missed"] = compared(np.sqrt(done[reference, 0]["values"]), np.sqrt(first["values"]))
        found.append(row)
    return found


def main(*, component: Annotated[tuple[str, ...], COMPONENTS] = ("slab",), times: tuple[float, ...] = (1.0,),
         modes: tuple[int, ...] = (), limit: float = 1200.0, repeats: int = 3, only: Annotated[tuple[str, ...], NAMES] = (),
         out: Path = Path("out/bases"), quick: bool = False) -> int:
    if repeats < 1:
        raise UsageError("--repeats must be at least 1")
    begin(out)
    # Debian's PETSc starts OpenMPI, see femsub/algebra/petsc.py; here slepc4py is loaded without it.
    os.environ |= {"OMPI_MCA_ess_singleton_isolated": "1", "OMPI_MCA_orte_create_session_dirs": "0"}
    computer, sizes, journal = fresh(machine), SIZES[quick], out / "measured.jsonl"
    rows, failed = measured_before(journal), list[str]()
    left_out = {name for name, package in PACKAGES.items() if find_spec(package) is None}
    left_out |= set() if fresh(has_cholmod) else {"SLEPc, CHOLMOD"}
    methods = [name for name in NAMES if name not in left_out and (not only or name in (REFERENCE, *only))]
    for kind, factor, count, turn in ((kind, factor, count, turn) for kind in component for factor in times
                                      for count in modes or [sizes["modes"]] for turn in range(repeats)):
        stretch = factor ** (1 / 3)
        size = sizes[kind] / stretch if kind == DISC else tuple(round(cells * stretch) for cells in sizes[kind])
        case = f"{kind}-{size}-{sizes['interface']}-{count}".replace(" ", "")
        for method in methods[::1 if turn % 2 == 0 else -1]:
            if any((row["key"], row["method"]) == (case, method) and (row["round"] == turn or "ended" in row) for row in rows):
                continue
            report.progress(f"{kind}, {count} modes: {method}, run {turn + 1}")
            row, worker = {"key": case, "component": kind, "modes": count, "method": method, "round": turn}, Worker()
            try:
                row |= worker(measure, method, kind, size, sizes["interface"], count, out / "reference" / case, limit=limit)
                row["peak_mb"] = max(row["peak_mb"], worker.peak_mb)
            except (StoppedError, MemoryError) as error:
                row |= {"ended": str(error) or "not enough memory"}
            except (fs.FemsubError, ImportError, RuntimeError) as error:
                failed.append(f"{kind}, {method}: {type(error).__name__}: {error}"[:400])
                continue
            finally:
                worker.close()
            rows.append(row)
            with open(journal, "a", encoding="utf-8") as file:
                file.write(f"\n{json.dumps(row)}\n")  # on a line of its own, whatever was left before
    report.progress_done()
    cases = {row["key"]: [one for one in rows if one["key"] == row["key"]] for row in rows}
    rows = [row for runs in cases.values() for row in rows_of(runs)]
    text = table([key.replace("_", " ") for key in COLUMNS], [[row.get(key) for key in COLUMNS] for row in rows],
                 list(COLUMNS.values()))
    data = {"machine": computer, "quick": quick, "repeats": repeats, "rows": rows, "failed": failed}
    result = Result(data, [text, Table("bases", rows)])
    print(result.text(), *(f"failed: {line}" for line in failed), sep="\n")
    report.write(result, out, figures=False, name="bases")
    return 1 if failed else 0
