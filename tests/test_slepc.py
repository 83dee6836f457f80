"""Factorise once and reuse it; nothing is kept; singular matrices are never called solved."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from femsub.errors import SingularMatrixError
from femsub.linalg import petsc
from femsub.linalg.factor import ComplexFactor, factorise
from femsub.linalg.petsc import Factor, quadratic_modes, symmetric_modes


def resident() -> int:
    """kB of memory in use now."""
    with open("/proc/self/statm", encoding="utf-8") as file:
        return int(file.read().split()[1]) * 4


def test_one_factor_serves_solves_modes_and_complex_modes() -> None:
    PETSc, _ = petsc._load()
    PETSc.Log.begin()
    event = PETSc.Log.Event("MatCholFctrNum")
    sub = fs.chain(500, belt=2)
    before = event.getPerfInfo()["count"]
    factor = Factor(sub.K, "definite")
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
    handles = [Factor(fs.chain(n).K, "symmetric") for n in (2000, 16000)]
    entries = [handle._factor.getMumpsInfog(29) for handle in handles]
    assert 2 * 2000 - 1 <= entries[0] <= 10 * 2000
    assert entries[1] <= 1.02 * 8 * entries[0]


def test_a_thousand_factors_do_not_grow_the_memory() -> None:
    sub = fs.chain(1000, belt=2)
    b = np.ones((1000, 3))

    def rounds(count: int) -> int:
        for _ in range(count):
            Factor(sub.K, "definite").solve(b)
        return resident()

    rounds(50)
    before = resident()
    assert rounds(1000) - before < 5_000  # 80 kB a factor leaked once, when the wrappers were not destroyed


def test_eigensolvers_do_not_grow_the_memory() -> None:
    sub = fs.chain(400, belt=2)
    factor = Factor(sub.K, "definite")

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
    monkeypatch.setattr("femsub.linalg.factor.COMPLEX", limit)
    sub = fs.chain(200, belt=2)
    gyroscopic = sp.coo_array((np.array([0.3, -0.3]), ([20, 21], [21, 20])), shape=(200, 200))
    P = sub.pencil.at(0.3j) + 1j * sp.csr_array(gyroscopic)
    factor = ComplexFactor(P)
    for right in (np.ones((200, 2)), np.ones(200)):
        assert np.abs(P @ factor.solve(right) - 1).max() < 1e-9
        assert np.abs(P.T @ factor.solve(right, transposed=True) - 1).max() < 1e-9


def test_memory_of_a_factor_goes_back_to_the_system() -> None:
    """Debian's OpenMPI would keep it in the heap, beside the next factor."""
    code = "import os, numpy as np; from femsub.linalg import petsc; petsc.versions()\n" \
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
    before = Factor.made
    x = Factor(saddle, "symmetric").solve(np.ones(1100))
    assert np.abs(saddle @ x - 1).max() < 1e-8 and Factor.made == before + 1
    monkeypatch.setattr(petsc, "ROOM", (-60, -60))
    with pytest.raises(SingularMatrixError):
        Factor(saddle, "symmetric")
