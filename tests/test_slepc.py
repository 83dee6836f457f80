"""Factorise once and reuse it; nothing is kept; singular matrices are never called solved."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.machinery import ModuleSpec

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from benchmarks.lattices import lattice
from femsub.algebra import petsc
from femsub.algebra.factor import ComplexFactor, factorise
from femsub.algebra.ordering import slender
from femsub.algebra.petsc import SparseFactor, quadratic_modes, symmetric_modes
from femsub.checks import EPS, MissingPackageError, SingularMatrixError


def resident() -> int:
    """kB of memory in use now."""
    with open("/proc/self/statm", encoding="utf-8") as file:
        return int(file.read().split()[1]) * 4


def test_one_factor_serves_solves_modes_and_complex_modes() -> None:
    PETSc, _ = petsc.load()
    PETSc.Log.begin()
    event = PETSc.Log.Event("MatCholFctrNum")
    sub = fs.chain(500, belt=2)
    before = event.getPerfInfo()["count"]
    factor = SparseFactor(sub.K, "definite")
    for _ in range(2):
        symmetric_modes(factor, sub.K, sub.M, 0.0, 5, tol=1e-12)
        quadratic_modes(factor, (sub.M, sub.D, sub.K), 0.0, 6, tol=1e-10, scale=0.01)
        factor.solve(np.ones((500, 3)))
    assert event.getPerfInfo()["count"] - before == 1
    assert factor.columns == 2 * (3 + 5)  # the right-hand sides, and the modes in their purification


@pytest.mark.parametrize("kind", ["definite", "symmetric", "general"])
def test_block_solve(kind: str, rng: np.random.Generator) -> None:
    K = fs.chain(400).K
    B = rng.standard_normal((400, 300))  # more than one block
    X = factorise(K, kind).solve(B)
    assert np.abs(K @ X - B).max() < 1e-9
    assert factorise(K, kind).solve(B[:, 0]).shape == (400,)


@pytest.mark.parametrize("n", [50, 1000])
@pytest.mark.parametrize("kind", ["definite", "symmetric", "general"])
def test_a_singular_matrix_is_refused(n: int, kind: str) -> None:
    with pytest.raises(fs.SingularMatrixError):
        factorise(fs.chain(n, fixed=False).K, kind)


@pytest.mark.parametrize("n", [50, 1000])
def test_an_indefinite_matrix_is_not_taken_for_definite(n: int) -> None:
    # CHOLMOD's LDLᵀ would accept it without a word
    K = sp.csr_array(fs.chain(n).K - 0.5 * sp.eye_array(n))
    with pytest.raises(fs.SingularMatrixError):
        factorise(K, "definite")
    with pytest.raises(fs.SingularMatrixError):
        factorise(sp.csr_array(-fs.chain(n).K), "definite")


SLENDER = {"chain": lambda: fs.chain(1000), "beam": lambda: clamped_beam(200)}


def clamped_beam(n: int) -> fs.Substructure:
    return fs.beam(1.0, n, E=1.0, I=1.0, rho=1.0, A=1.0, supports={"left": "clamped"})


@pytest.fixture
def no_cholmod(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a PETSc that was built without it."""
    monkeypatch.setattr(petsc, "CHOLMOD", False)


@pytest.mark.parametrize(("name", "package"), [("chain", "PETSC"), ("beam", "PETSC"), ("lattice", "MUMPS")])
def test_without_cholmod_another_factor_takes_over_and_is_named(name: str, package: str, no_cholmod: None) -> None:
    sub = lattice(20, 15, held=True) if name == "lattice" else SLENDER[name]()
    factor = SparseFactor(sub.K, "definite")
    assert repr(factor) == f"SparseFactor(definite, by {package}, {sub.size} x {sub.size})"
    assert petsc.versions()["Cholesky"] == "MUMPS"
    x = np.random.default_rng(1).standard_normal((sub.size, 70))
    X = factor.solve(sub.K @ x)
    assert np.abs(sub.K @ (X - x)).max() < 1e-12 * abs(sub.K).max()
    indefinite = sp.csr_array(sub.K - 1.01 * fs.normal_modes(sub, count=1).eigenvalues[0] * sub.M)
    for wrong in (indefinite, -sub.K):
        with pytest.raises(fs.SingularMatrixError, match=f"by {package} broke down; it is singular, or not of this kind"):
            SparseFactor(wrong, "definite")


def test_without_cholmod_a_floating_part_is_found_to_float(no_cholmod: None) -> None:
    for sub, rigid in ((lattice(14, 12), 3), (fs.chain(1000, fixed=False), 1)):
        modes = fs.normal_modes(sub, count=5)
        assert modes.rigid == rigid and modes.residual.max() < 1e-10
        with pytest.raises(fs.SingularMatrixError):
            SparseFactor(sub.K, "definite")


def test_without_cholmod_a_matrix_that_is_definite_by_rounding_only_is_refused(no_cholmod: None) -> None:
    K = lattice(14, 12).K
    with pytest.raises(fs.SingularMatrixError, match="singular"):
        SparseFactor(K + EPS * abs(K).max() * sp.eye_array(K.shape[0], format="csr"), "definite")


def test_without_cholmod_slender_models_keep_their_digits(no_cholmod: None) -> None:
    """MUMPS takes 4e-10 of the lowest ω of this chain and 5e-5 of this deflection; CHOLMOD nothing and 1e-11."""
    n = 10_000
    assert np.abs(fs.normal_modes(fs.chain(n), count=5).frequencies / fs.chain_frequencies(n, 5) - 1).max() < 1e-12
    with pytest.warns(fs.ConditionWarning, match="rounding may take"):
        beam = clamped_beam(1000)
    load = np.zeros(beam.size)
    load[-2] = 3.0
    assert abs(SparseFactor(beam.K, "definite").solve(load)[-2] - 1) < 1e-7


def test_slender_is_what_has_a_narrow_band_in_some_order(rng: np.random.Generator) -> None:
    for model in SLENDER.values():
        K = model().K
        mixed = rng.permutation(K.shape[0])
        assert slender(K) and slender(K[mixed][:, mixed])
    ring = sp.lil_array(fs.chain(300).K)
    ring[0, 299] = ring[299, 0] = -1.0
    assert slender(sp.csr_array(ring)) and not slender(lattice(20, 15).K)


def test_a_petsc_without_factors_says_what_to_install(no_cholmod: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(petsc, "has", lambda name: False)
    with pytest.raises(MissingPackageError, match=r"built without MUMPS, which definite matrices need\. .*scripts/setup"):
        fs.normal_modes(lattice(20, 15, held=True), count=3)


@pytest.mark.parametrize(("places", "loaded"), [({"petsc4py": "/a/petsc4py", "dolfinx_solver": "/a/dolfinx_solver"}, 1),
                                                ({"petsc4py": "/b/petsc4py", "dolfinx_solver": "/a/dolfinx_solver"}, 0),
                                                ({"petsc4py": "/a/petsc4py"}, 0), ({}, 0)])
def test_the_wheels_own_module_comes_before_its_petsc4py(places: dict[str, str], loaded: int,
                                                         monkeypatch: pytest.MonkeyPatch) -> None:
    imported: list[str] = []
    monkeypatch.setattr(petsc, "find_spec", lambda name: ModuleSpec(name, None, origin=f"{places[name]}/__init__.py")
                        if name in places else None)
    monkeypatch.setattr(petsc, "import_module", imported.append)
    petsc.load_wheel()
    assert imported == ["dolfinx_solver"] * loaded


@pytest.mark.parametrize("n", [60, 600])
def test_inertia_counts_the_eigenvalues_below(n: int) -> None:
    sub, exact = fs.chain(n), fs.chain_frequencies(n)
    for count in (1, n // 3, n - 1):
        middle = (exact[count - 1] + exact[count]) / 2
        assert factorise(sub.K - middle**2 * sub.M, "symmetric").negative_pivots == count


def test_a_tree_is_factorised_without_fill() -> None:
    """Of a chain L has two entries a column. MUMPS counts the zeros of the small fronts that it merges, too, how many depends on
    its version (none in 5.5, five a column in 5.7): they stay in proportion to n, and fill would not.
    """
    handles = [SparseFactor(fs.chain(n).K, "symmetric") for n in (2000, 16000)]
    entries = [handle._factor.getMumpsInfog(29) for handle in handles]
    assert 2 * 2000 - 1 <= entries[0] <= 10 * 2000
    assert entries[1] <= 1.02 * 8 * entries[0]


@pytest.mark.slow
def test_a_thousand_factors_do_not_grow_the_memory() -> None:
    sub = fs.chain(1000, belt=2)
    b = np.ones((1000, 3))

    def rounds(count: int) -> int:
        for _ in range(count):
            SparseFactor(sub.K, "definite").solve(b)
        return resident()

    rounds(50)
    before = resident()
    assert rounds(1000) - before < 5_000  # 80 kB a factor leaked once, when the wrappers were not destroyed


def test_eigensolvers_do_not_grow_the_memory() -> None:
    sub = fs.chain(400, belt=2)
    factor = SparseFactor(sub.K, "definite")

    def rounds(count: int) -> int:
        for _ in range(count):
            symmetric_modes(factor, sub.K, sub.M, 0.0, 5, tol=1e-12)
            quadratic_modes(factor, (sub.M, sub.D, sub.K), 0.0, 6, tol=1e-10, scale=0.01)
        return resident()

    rounds(20)
    before = resident()
    assert rounds(150) - before < 5_000


@pytest.mark.parametrize("limit", [20_000, 10])
def test_complex_factors_of_both_kinds_and_their_transposes(limit: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("femsub.algebra.factor.LARGE", limit)
    sub = fs.chain(200, belt=2)
    gyroscopic = sp.coo_array((np.array([0.3, -0.3]), ([20, 21], [21, 20])), shape=(200, 200))
    P = sub.pencil.at(0.3j) + 1j * sp.csr_array(gyroscopic)
    factor = ComplexFactor(P)
    for right in (np.ones((200, 2)), np.ones(200)):
        assert np.abs(P @ factor.solve(right) - 1).max() < 1e-9
        assert np.abs(P.T @ factor.solve(right, transposed=True) - 1).max() < 1e-9


def test_memory_of_a_factor_goes_back_to_the_system() -> None:
    """Debian's OpenMPI would keep it in the heap, beside the next factor."""
    code = "import os, numpy as np; from femsub.algebra import petsc; petsc.versions()\n" \
           "def resident():\n    with open('/proc/self/statm') as file: return int(file.read().split()[1]) * 4e-3\n" \
           "before = resident(); block = np.ones(20_000_000); held = resident(); del block\n" \
           "print(held - before, resident() - before)"
    if not os.path.exists("/proc/self/statm"):
        pytest.skip("no /proc here")
    run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    held, left = map(float, run.stdout.split())
    assert held > 150 and left < 20


def test_an_indefinite_matrix_gets_more_room_for_its_pivots(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    A = sp.random_array((600, 600), density=1e-2, rng=rng)
    B = sp.random_array((500, 600), density=1e-2, rng=rng) + sp.eye_array(500, 600)
    saddle = sp.csr_array(sp.block_array([[A + A.T, B.T], [B, None]]))
    monkeypatch.setattr(petsc, "ROOM", (-60, 200))  # less than MUMPS says it needs
    before = SparseFactor.made
    x = SparseFactor(saddle, "symmetric").solve(np.ones(1100))
    assert np.abs(saddle @ x - 1).max() < 1e-8 and SparseFactor.made == before + 1
    monkeypatch.setattr(petsc, "ROOM", (-60, -60))
    with pytest.raises(SingularMatrixError):
        SparseFactor(saddle, "symmetric")
