"""What large models need: block Lanczos, the memory that is foretold, a count that can be put off."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from benchmarks.lattices import lattice, membrane, membrane_eigenvalues
from femsub.algebra import memory
from femsub.algebra.factor import factorise
from femsub.algebra.petsc import SparseFactor
from femsub.algebra.processes import memory as process_memory
from femsub.algebra.processes.system import libc
from femsub.checks import InputError, MissedModesError, NotConvergedError, NotEnoughMemoryError
from femsub.modes.block_lanczos import block_lanczos
from femsub.modes.shift_invert import ShiftInvert

STEEL = fs.Material(2.1e11, 0.3, 7850.0)


@pytest.fixture
def every_model_is_heavy(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Block Lanczos for all; returns the list of how many modes were asked of it."""
    asked: list[int] = []

    def counted(*args: object, **options: object) -> tuple[np.ndarray, np.ndarray]:
        asked.append(args[3])  # type: ignore[arg-type]
        return block_lanczos(*args, **options)  # type: ignore[arg-type]

    monkeypatch.setattr("femsub.modes.normal_modes.HEAVY", 0.0)
    monkeypatch.setattr("femsub.modes.block_lanczos.block_lanczos", counted)
    return asked


@pytest.mark.parametrize("block", [1, 3, 10])
def test_block_lanczos_finds_pairs(block: int) -> None:
    sub = membrane(40)
    values, shapes = block_lanczos(SparseFactor(sub.K, "definite"), sub.M, 0.0, 30, tol=1e-10, block=block)
    order = np.argsort(values)
    exact = membrane_eigenvalues(40)[:30]
    if block > 1:  # one vector sees one shape of each pair, which is what the count is there for
        np.testing.assert_allclose(values[order], exact, rtol=1e-12)
    assert np.abs(shapes.T @ (sub.M @ shapes) - np.eye(30)).max() < 1e-9
    assert np.linalg.norm(sub.K @ shapes - sub.M @ shapes * values) < 1e-9 * values.max()


def test_block_lanczos_leaves_no_memory_but_that_of_its_shapes() -> None:
    sub = membrane(25)
    _, shapes = block_lanczos(SparseFactor(sub.K, "definite"), sub.M, 0.0, 30, tol=1e-10)
    assert shapes.base is None or shapes.base.nbytes == shapes.nbytes


def test_block_lanczos_beside_known_shapes() -> None:
    sub = lattice(20, 18)
    handle = ShiftInvert(sub.K, sub.M)
    values, shapes = block_lanczos(handle.factor, sub.M, handle.sigma, 12, tol=1e-10, known=handle.rigid)
    assert handle.rigid.shape[1] == 3
    assert np.abs(handle.rigid.T @ (sub.M @ shapes)).max() < 1e-10
    exact = la.eigvalsh(sub.K.toarray(), sub.M.toarray(), subset_by_index=[3, 14])
    np.testing.assert_allclose(np.sort(values), exact, rtol=1e-9)


def test_block_lanczos_where_the_space_is_soon_exhausted() -> None:
    # two eigenvalues only: the second block is rounding, and is replaced at random
    K = np.diag(np.where(np.arange(121) < 118, 1.0, 4.0))
    values, shapes = block_lanczos(factorise(K, "definite"), np.eye(121), 0.0, 5, tol=1e-10)
    np.testing.assert_allclose(values, 1.0, rtol=1e-12)
    assert np.abs(shapes.T @ shapes - np.eye(5)).max() < 1e-10


def test_block_lanczos_says_when_it_has_not_converged() -> None:
    sub = membrane(40)
    with pytest.raises(NotConvergedError, match=r"of 30 modes converged to 1e-13 within 0 restarts"):
        block_lanczos(SparseFactor(sub.K, "definite"), sub.M, 0.0, 30, tol=1e-13, restarts=0)


class Counted:
    """M, with the number of columns that it was multiplied by."""

    def __init__(self, M: sp.csr_array) -> None:
        self.M, self.columns, self.diagonal = M, 0, M.diagonal

    def __matmul__(self, x: np.ndarray) -> np.ndarray:
        self.columns += x.shape[1]
        return self.M @ x


@pytest.mark.parametrize("count, block", [(30, 8), (100, 16)])
def test_a_block_is_orthogonalised_in_one_pass(count: int, block: int) -> None:
    sub = membrane(60)
    factor, M = SparseFactor(sub.K, "definite"), Counted(sub.M)
    _, shapes = block_lanczos(factor, M, 0.0, count, tol=1e-9)
    assert M.columns == 2 * factor.columns + block  # one product before the pass, one after it
    assert np.abs(shapes.T @ (sub.M @ shapes) - np.eye(count)).max() < 1e-11


def test_the_last_step_of_inverse_iteration_needs_no_solve() -> None:
    sub = membrane(60)
    values, shapes = block_lanczos(SparseFactor(sub.K, "definite"), sub.M, 0.0, 30, tol=1e-3)
    residual = np.linalg.norm(sub.K @ shapes - sub.M @ shapes * values, axis=0) / values
    assert residual.max() < 2e-3  # 2e-2 without that step


def test_modes_that_only_show_a_limit_need_not_converge() -> None:
    sub, errors = membrane(60), []

    def seen(values: np.ndarray, error: np.ndarray) -> int:
        errors.append(error)
        return 30

    factor = SparseFactor(sub.K, "definite")
    values, shapes = block_lanczos(factor, sub.M, 0.0, 33, tol=1e-9, seen=seen)
    assert errors[-1][:30].max() <= 1e-9 < errors[-1].max()
    np.testing.assert_allclose(values[:30], membrane_eigenvalues(60)[:30], rtol=1e-11)
    assert np.linalg.norm(sub.K @ shapes - shapes * values, axis=0)[:30].max() < 1e-9 * values[29]


def test_a_missed_mode_is_sought_beside_exact_ones_only(monkeypatch: pytest.MonkeyPatch) -> None:
    exact = membrane_eigenvalues(30)

    def forgetful(factor: SparseFactor, M: sp.csr_array, sigma: float, count: int, *, tol: float, known: np.ndarray,
                  **_: object) -> tuple[np.ndarray, np.ndarray]:
        values, shapes = block_lanczos(factor, M, sigma, count + 1, tol=tol, known=known)
        missed = shapes[:, 2].copy()
        values, shapes = np.delete(values, 2), np.delete(shapes, 2, axis=1)
        shapes[:, -1] += 1e-3 * missed  # as inexact as a mode that only shows the limit may be
        return values, shapes

    monkeypatch.setattr("femsub.modes.normal_modes.HEAVY", 0.0)
    monkeypatch.setattr("femsub.modes.normal_modes.DENSE", 100)  # LAPACK would mend it
    monkeypatch.setattr("femsub.modes.block_lanczos.block_lanczos", forgetful)
    modes = fs.normal_modes(membrane(30), count=10)
    np.testing.assert_allclose(modes.eigenvalues, exact[:10], rtol=1e-11)
    assert modes.residual.max() < 1e-9 and modes.evidence == "certified"


def _turned(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A dense K with these eigenvalues, and its eigenvectors."""
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((len(values), len(values))))[0]
    return (turn * values) @ turn.T, turn


def test_a_second_pass_follows_cancellation() -> None:
    # (K - σM)⁻¹ makes 1e8 of what rounding leaves of the known shapes
    exact = np.where(np.arange(400) < 3, 1e-8, 1.0 + np.arange(400))
    K, turn = _turned(exact)
    values, shapes = block_lanczos(factorise(K, "definite"), np.eye(400), 0.0, 8, tol=1e-9, known=turn[:, :3])
    np.testing.assert_allclose(np.sort(values), exact[3:11], rtol=1e-12)
    assert np.abs(turn[:, :3].T @ shapes).max() < 1e-9


def test_modes_out_of_reach_of_rounding_are_an_error() -> None:
    K = np.diag(np.where(np.arange(400) < 3, 1e-10, 1.0) * (1.0 + np.arange(400)))
    with pytest.raises(NotConvergedError, match="3 of 5 modes converged"):
        block_lanczos(factorise(K, "definite"), np.eye(400), 0.0, 5, tol=1e-9)


@pytest.mark.parametrize("method", [fs.CraigBampton(12), fs.CraigChang(12)])
def test_a_heavy_model_is_reduced_to_the_same(method: fs.CraigBampton | fs.CraigChang, every_model_is_heavy: list[int],
                                              monkeypatch: pytest.MonkeyPatch) -> None:
    sub = lattice(40, 30, held=True)
    before = SparseFactor.made
    heavy = fs.reduce(sub, method, ports=True)
    assert every_model_is_heavy == [15] and SparseFactor.made - before == 2  # the basis, and the count
    monkeypatch.setattr("femsub.modes.normal_modes.HEAVY", np.inf)
    plain = fs.reduce(sub, method, ports=True)
    assert len(every_model_is_heavy) == 1
    np.testing.assert_allclose(np.linalg.eigvals(np.linalg.solve(heavy.M, heavy.K)).real.sum(),
                               np.linalg.eigvals(np.linalg.solve(plain.M, plain.K)).real.sum(), rtol=1e-8)
    assert heavy.cutoff == pytest.approx(plain.cutoff, rel=1e-10)


def test_a_mode_that_block_lanczos_hides_is_an_error(monkeypatch: pytest.MonkeyPatch, every_model_is_heavy: list[int]) -> None:
    def blind(*args: object, **options: object) -> tuple[np.ndarray, np.ndarray]:
        values, shapes = block_lanczos(*args[:3], args[3] + 1, **options)  # type: ignore[operator, arg-type]
        keep = np.argsort(values) != 4
        return np.sort(values)[keep], shapes[:, np.argsort(values)][:, keep]

    monkeypatch.setattr("femsub.modes.block_lanczos.block_lanczos", blind)
    with pytest.raises(MissedModesError, match=r"modes were found below ω = .*, but the inertia of K - ω²M counts"):
        fs.reduce(lattice(40, 30, held=True), fs.CraigBampton(12))


def test_errors_that_only_refinement_needs_are_not_computed_of_a_large_model(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr("femsub.modes.normal_modes.DENSE", 100)
    monkeypatch.setattr("femsub.modes.normal_modes.scaled_errors", never)
    assert fs.normal_modes(membrane(20), 5).evidence == "certified"


SHAPES = {"slab": fs.block((1, 0.7, 0.05), (40, 30, 4), "hexahedron"), "cube": fs.block((1, 1, 1), (14, 14, 14), "hexahedron"),
          "bar": fs.block((1, 0.1, 0.1), (100, 5, 5), "hexahedron"), "ring": fs.annulus(0.05, 0.15, 0.02, (6, 60, 2)),
          "bulk": fs.block((1, 0.5, 0.25), (14, 7, 4)), "tetra": fs.block((1, 0.5, 0.2), (14, 8, 4), "tetra10")}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", SHAPES)
def test_nonzeros_of_the_factor_are_foretold(name: str) -> None:
    sub = fs.solid(SHAPES[name], STEEL, supports=[next(iter(SHAPES[name].sets))])
    true = SparseFactor(sub.K, "definite").fill * sub.size
    assert 1 / 1.7 < memory.factor_nonzeros(sub.K) / true < 1.7


def test_nonzeros_of_chains_and_of_pieces() -> None:
    assert memory.factor_nonzeros(fs.chain(1000).K) == pytest.approx(1500, rel=0.01)
    one = membrane(30).K
    two = sp.csr_array(sp.block_diag([one, one]))
    assert memory.factor_nonzeros(two) == pytest.approx(2 * memory.factor_nonzeros(one), rel=0.3)


def test_a_reduction_that_does_not_fit_is_refused_before_it_begins(machine: Callable[..., None]) -> None:
    sub = lattice(40, 30, held=True)
    machine(free=1e6, large=1000)
    before = SparseFactor.made
    with pytest.raises(NotEnoughMemoryError, match=r"'lattice' needs about .* but only 0 GB are available. Use .*, or a"):
        fs.reduce(sub, fs.CraigBampton(5))
    assert SparseFactor.made == before
    machine(free=None)
    fs.reduce(sub, fs.CraigBampton(5), ports=True)


def test_small_needs_are_granted_without_a_look(machine: Callable[..., None]) -> None:
    """A look reads several files: for a chain of ten masses it took half of the time."""
    looks: list[float] = []
    machine(free=lambda: looks.append(1e6) or looks[-1])  # type: ignore[func-returns-value]
    fs.chain(10)
    assert not looks
    memory.check_room("what just fits", 1e6)
    assert len(looks) == 1
    with pytest.raises(NotEnoughMemoryError, match="a chain of 1e\\+04 masses"):
        fs.chain(10_000)


def test_the_advice_fits_what_is_largest(machine: Callable[..., None]) -> None:
    machine(free=1.0, large=100)
    K = lattice(20, 20, held=True).K
    with pytest.raises(NotEnoughMemoryError, match="fewer interface DOF"):
        memory.check_memory("part", K, 600, 5, 600)
    with pytest.raises(NotEnoughMemoryError, match="fewer modes"):
        memory.check_memory("part", K, 600, 5000, 5)


def test_the_limits_of_all_control_groups_of_a_process_count(tmp_path: Path) -> None:
    def group(path: str, version: int, most: str, used: float, spare: float) -> None:
        (tmp_path / path).mkdir(parents=True, exist_ok=True)
        names = ("memory.max", "memory.current", "inactive_file") if version == 2 else \
            ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
        texts = most, f"{used:.0f}", f"anon 5\n{names[2]} {spare:.0f}\n"
        for name, text in zip((*names[:2], "memory.stat"), texts, strict=True):
            (tmp_path / path / name).write_text(text)

    own = tmp_path / "own"
    own.write_text("0::/user/job\n4:cpu,memory:/old\n")
    assert process_memory.left_of_groups(tmp_path, own) == []
    group("user", 2, "max", 5e9, 0)
    group("user/job", 2, "8000000000", 5e9, 1e9)
    group("memory/old", 1, "6000000000", 3e9, 5e8)
    assert sorted(process_memory.left_of_groups(tmp_path, own)) == [3.5e9, 4e9]
    group("user", 2, "6000000000", 5e9, 0)
    assert min(process_memory.left_of_groups(tmp_path, own)) == 1e9


PEAK = """
import ctypes, gc, sys
import femsub as fs
from femsub.algebra import memory

def told(key):
    return 1024.0 * int(next(line for line in open("/proc/self/status") if line.startswith(key)).split()[1])

cells, method = eval(sys.argv[1]), eval(sys.argv[2])
sub = fs.solid(fs.block((1, 1, 0.1), cells, "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0), interface=["left"])
held = sub.interface if method.held else None
need = sum(memory.reduction_bytes(sub.K, len(sub.interface), method.modes, held).values()) + memory.BASE / 4
gc.collect(), ctypes.CDLL(None).malloc_trim(0)  # else what the assembly has freed would serve the reduction
open("/proc/self/clear_refs", "w").write("5")  # forget the peak of the assembly
before = told("VmRSS")
fs.reduce(sub, method)
print(need / (told("VmHWM") - before))
"""


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="the peak of a process is told by Linux")
@pytest.mark.slow
@pytest.mark.sampled(99)
@pytest.mark.parametrize(("cells", "method"), [((40, 40, 3), "fs.CraigBampton(40)"), ((28, 28, 3), "fs.Rubin(40)"),
                                               pytest.param((56, 56, 2), "fs.CraigBampton(40)",
                                                            marks=pytest.mark.rare)])
def test_the_memory_of_a_reduction_is_foretold_within_30_percent(cells: tuple[int, ...], method: str) -> None:
    run = subprocess.run([sys.executable, "-c", PEAK, str(cells), method], capture_output=True, text=True, check=True)
    assert 1 / 1.3 < float(run.stdout) < 1.3


KEPT = """
import ctypes, re
import numpy as np
from femsub.algebra import available, reused_memory

def resident():
    return int(re.search(r"VmRSS:\\s*(\\d+)", open("/proc/self/status").read())[1]) / 1e3

def work():
    np.ones((1_000_000, 8)) + 1.0

available()
work()
before, told = resident(), []
with reused_memory(1_000_000):
    work()
    told.append(resident() - before)
    available()
    told.append(resident() - before)
    with reused_memory(1_000_000):
        work()
    told.append(resident() - before)
told.append(resident() - before)
with reused_memory(100):
    work()
told.append(resident() - before)
print(*told)
"""


@pytest.mark.skipif(not hasattr(libc(), "malloc_trim"), reason="malloc is not that of glibc")
def test_freed_arrays_are_kept_for_the_next_while_a_large_model_is_worked_on() -> None:
    """Within a call, an inner one included; they count as available, and go back at its end. Small models keep nothing."""
    run = subprocess.run([sys.executable, "-c", KEPT], capture_output=True, text=True, check=True)
    within, asked, nested, after, small = (float(word) > 30 for word in run.stdout.split())
    assert within and nested and not asked and not after and not small, run.stdout


def test_memory_available_is_a_figure() -> None:
    found = memory.available()
    assert found is None or 1e6 < found < 1e15


@pytest.mark.slow
def test_of_more_modes_than_there_are_a_large_model_makes_an_input_error(monkeypatch: pytest.MonkeyPatch,
                                                                         every_model_is_heavy: list[int]) -> None:
    with pytest.warns(fs.FemsubWarning, match="has 800 of finite frequency"):
        assert len(fs.normal_modes(lattice(20, 20, held=True), count=5000).frequencies) == 800
    monkeypatch.setattr("femsub.modes.normal_modes.DENSE", 700)
    with pytest.raises(InputError):
        fs.normal_modes(lattice(20, 20, held=True), count=5000)
