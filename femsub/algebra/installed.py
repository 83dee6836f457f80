"""The installation that computations depend on: packages, BLAS, processors and memory, with the faults found in it."""

from __future__ import annotations

import platform
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from femsub.algebra import petsc
from femsub.algebra.factor import inertia
from femsub.algebra.processes.memory import available
from femsub.algebra.processes.system import own_processors, processors, variable
from femsub.algebra.processes.threads import libraries
from femsub.checks import DENSE, EQUAL, FemsubError, installed_by

OPTIONAL = "matplotlib", "scikit-fem", "meshio", "plotly", "pyyeti"
PACKAGES = {"MUMPS": "mumps", "CHOLMOD": "suitesparse", "METIS": "metis", "Scotch": "ptscotch"}  # as PETSc calls them
#: exceptions of packages that are missing, broken, or do not fit each other
THROWN = (ArithmeticError, AttributeError, FemsubError, ImportError, LookupError, OSError, RuntimeError, SystemError, TypeError,
          ValueError, np.linalg.LinAlgError)


@dataclass
class Findings:
    """Lines to print, and the faults that were found, each with its remedy."""

    lines: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)

    def add(self, what: str, found: object) -> None:
        self.lines.append(f"{what:<12} {found}")

    @property
    def text(self) -> str:
        """The lines, the faults, and a verdict."""
        verdict = "something is wrong: see above" if self.wrong else "nothing is wrong"
        return "\n".join([*self.lines, *(f"WRONG        {one}" for one in self.wrong), verdict])

    @contextmanager
    def noting(self, part: str) -> Iterator[None]:
        """Inside, an exception is noted as a fault, and the examination goes on. femsub's own errors name the remedy."""
        try:
            yield
        except THROWN as error:
            said = " ".join(str(error).split())
            self.wrong.append(said if isinstance(error, FemsubError) else f"{part}: {type(error).__name__}: {said}")


def examine() -> Findings:
    """Examine all parts of the installation. A part that fails is noted as a fault, and the next is examined."""
    found = Findings()
    with found.noting("python"):
        found.add("Python", f"{platform.python_version()}, {sys.executable}")
        found.add("system", f"{platform.platform()}, {processors()} processors")
    with found.noting("packages"):
        for name in ("numpy", "scipy", *OPTIONAL):
            try:
                found.add(name, metadata.version(name))
            except metadata.PackageNotFoundError:
                found.add(name, f"not installed; if you need it: {installed_by(name)}")
    with found.noting("petsc"):
        for name, version in petsc.versions().items():
            found.add(name, version)
        for name, key in PACKAGES.items():
            found.add(name, "in PETSc" if petsc.has(key) else "not in PETSc")
        if not petsc.has(PACKAGES["MUMPS"]):
            found.wrong.append("this PETSc has no MUMPS, which symmetric indefinite and unsymmetric matrices need. "
                               + petsc.installation())
        if not petsc.has(PACKAGES["CHOLMOD"]):
            found.add("", "MUMPS factorises positive definite matrices instead, and PETSc itself those of chains and beams")
        n = 400
        A = sp.diags_array([-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1)], offsets=[-1, 0, 1], format="csr")
        kinds: dict[petsc.Kind, float] = {"definite": 0.0, "symmetric": 0.5, "general": 0.5}
        b = np.linspace(-1.0, 1.0, n)
        for kind, shift in kinds.items():
            K = sp.csr_array(A - shift * sp.eye_array(n))
            x = petsc.SparseFactor(K, kind).solve(b)
            residual = float(np.linalg.norm(K @ x - b) / (np.linalg.norm(x) * 4 + np.linalg.norm(b)))
            if not residual <= EQUAL:
                found.wrong.append(f"a {kind} factorisation has a residual of {residual:.0e}: PETSc and its packages do not fit "
                                   f"each other, or its BLAS is broken. {petsc.installation()}")
        count = inertia(sp.csr_array(A - 0.5 * sp.eye_array(n)))
        true = int(np.count_nonzero(2 - 2 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1)) < 0.5))
        if count != true:
            found.wrong.append(f"the inertia of a matrix with {true} negative eigenvalues is counted as {count}: certificates "
                               f"cannot be trusted; take a PETSc with Debian's MUMPS. {petsc.installation()}")
    with found.noting("blas"):  # the libraries in the process, their kernels and threads, and whether their products are right
        import scipy.linalg  # loads SciPy's own  # noqa: F401

        own, lines = own_processors(), libraries().info()
        for one in lines:
            library, threads = Path(one["filepath"]).name, one["num_threads"]
            found.add("BLAS", f"{library}: {one['internal_api']} {one['version']}, kernels {one.get('architecture')}, {threads} "
                              "thread(s)")
            if threads > own:
                found.wrong.append(f"{library} uses {threads} threads, but this process may use {own} processors, which slows "
                                   f"small products down by far: set OMP_NUM_THREADS={own}, or 1")
        if not lines:
            found.add("BLAS", "no BLAS found in the process")
        for name in ("OPENBLAS_CORETYPE", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
            if value := variable(name):
                found.add("", f"{name}={value}")
        A = np.random.default_rng(0).standard_normal((300, 300))
        Q = np.linalg.qr(A)[0]
        off = float(np.abs(Q.T @ Q - np.eye(300)).max())
        if not off <= EQUAL:
            found.wrong.append(f"NumPy's BLAS is broken: QᵀQ of a QR decomposition is {off:.0e} off; try "
                               f"OPENBLAS_CORETYPE=Haswell, and install NumPy anew: {installed_by('numpy')}")
    with found.noting("memory"):
        free = available()
        found.add("memory", "unknown on this system" if free is None else f"{free / 1e9:.1f} GB available to this process")
        # all modes of a dense model: the two matrices of its linearisation, of twice its size, and left and right eigenvectors
        if free is not None and free < 4 * 8 * (2 * DENSE)**2:
            found.wrong.append(f"only {free / 1e9:.1f} GB of memory are available: end other programs, or raise the container's "
                               "limit")
    return found
