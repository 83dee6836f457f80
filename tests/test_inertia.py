"""Counting negative eigenvalues: trees by SuperLU without pivoting, all else by MUMPS, whose factor is not kept."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path
from threading import Event, Timer
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from benchmarks.lattices import lattice
from femsub.algebra import CountBeside, SignsBeside, are_definite, factors_made, libraries, petsc, signs
from femsub.algebra.factor import TreeFactor, counting, inertia
from femsub.algebra.matrices import Difference
from femsub.algebra.ordering import good_order, leaves_first
from femsub.algebra.petsc import SparseFactor
from femsub.algebra.processes import beside
from femsub.modes.dense import orthonormalise
from femsub.modes.quadratic.projected_count import Projection
from femsub.modes.quadratic.region import Contour


def tree(n: int, seed: int) -> sp.csr_array:
    """A symmetric matrix on a random tree, entries over six decades, diagonal of either sign."""
    rng = np.random.default_rng(seed)
    child, mixed = np.arange(1, n), rng.permutation(n)
    parent = np.maximum(0, child - rng.integers(1, 30, n - 1))
    entries, diagonal = (10.0 ** rng.uniform(-3, 3, size) for size in (n - 1, n))
    A = sp.coo_array((entries, (mixed[child], mixed[parent])), shape=(n, n))
    return sp.csr_array(A + A.T + sp.diags_array(diagonal * rng.choice([-1, 1], n)))


@pytest.mark.parametrize("pieces", [1, 8])
@pytest.mark.parametrize("seed", range(6))
def test_a_tree_is_counted_and_solved_without_pivoting(pieces: int, seed: int, rng: np.random.Generator) -> None:
    A = sp.csr_array(sp.block_diag([tree(400 // pieces, seed + 10 * i) for i in range(pieces)]))
    n = A.shape[0]
    order = leaves_first(A)
    assert order is not None and np.array_equal(np.sort(order), np.arange(n))
    later = np.argsort(order)
    rows, columns = A.nonzero()
    above = np.bincount(rows[later[columns] > later[rows]], minlength=n)
    assert above.max() == 1  # all but one of the neighbours come before
    handle = counting(A)
    assert isinstance(handle, TreeFactor)
    assert handle.negative_pivots == np.count_nonzero(np.linalg.eigvalsh(A.toarray()) < 0) == inertia(A)
    B = rng.standard_normal((n, 3))
    assert np.abs(A @ handle.solve(B) - B).max() < 1e-6 and handle.solve(B[:, 0]).shape == (n,)


def test_many_pieces_are_a_forest() -> None:
    many = sp.csr_array(sp.block_diag([tree(5, seed) for seed in range(60)]))
    order = leaves_first(many)
    assert order is not None and sorted(order) == list(range(300))
    assert TreeFactor(many, order).negative_pivots == np.count_nonzero(np.linalg.eigvalsh(many.toarray()) < 0)
    assert sorted(leaves_first(sp.csr_array(sp.eye_array(300)))) == list(range(300))


def test_a_cycle_is_no_tree() -> None:
    ring = fs.chain(300).K + sp.coo_array(([-0.5, -0.5], ([0, 299], [299, 0])), shape=(300, 300))
    assert leaves_first(sp.csr_array(ring)) is None
    assert isinstance(counting(sp.csr_array(ring - 0.3 * sp.eye_array(300))), SparseFactor)


def test_the_chain_is_counted_at_each_of_its_modes() -> None:
    sub, omega = fs.chain(5000, belt=2), fs.chain_frequencies(5000)
    for below in (1, 20, 333, 4321, 4999):
        value = float(omega[below - 1] * omega[below])
        assert inertia(Difference(sub.K, sub.M, value)) == below


def test_a_pivot_of_zero_is_left_to_mumps() -> None:
    path = sp.csr_array(sp.diags_array([np.ones(399), np.zeros(400), np.ones(399)], offsets=[-1, 0, 1]))
    order = leaves_first(path)
    assert order is not None and inertia(path) == 200
    with pytest.raises(fs.SingularMatrixError, match="pivot that is zero"):
        TreeFactor(path, order)


def test_a_count_keeps_no_factor_and_finds_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    sub = lattice(14, 11, held=True)
    A = Difference(sub.K, sub.M, 0.4)
    assert inertia(A) == counting(A).negative_pivots == np.count_nonzero(np.linalg.eigvalsh(A.formed().toarray()) < 0) > 3
    lost = counting(A, keep=False)
    assert isinstance(lost, SparseFactor) and lost._factor.getMumpsIcntl(31) == 1  # MUMPS throws it away as it goes
    with pytest.raises(fs.InputError, match="not kept"):
        lost.solve(np.ones(sub.size))
    monkeypatch.setattr("femsub.algebra.factor.SMALL", 1000)  # the same by LAPACK
    assert inertia(A) == lost.negative_pivots


@pytest.mark.parametrize("hidden", [False, True])
@pytest.mark.parametrize("cancels", [False, True])
def test_the_order_of_elimination_is_found_before_the_shift_is_known(hidden: bool, cancels: bool,
                                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    """Where an entry of K - σM cancels, or PETSc hides the two steps, the factor is made in one."""
    sub = lattice(14, 11, held=True)
    n, pair = sub.size, ([0, 1], [1, 0])
    M = sp.csr_array(sub.M + sp.coo_array(([0.125] * 2, pair), shape=(n, n)))
    K = sp.csr_array(sub.K + sp.coo_array(([0.0625 - sub.K[0, 1]] * 2, pair), shape=(n, n)))
    A, steps = Difference(K, M, 0.5 if cancels else 0.4), []
    genuine = petsc._two_steps()

    def counted(step: Callable[..., int]) -> Callable[..., int]:
        return lambda *given: (steps.append(step.__name__), step(*given))[1]

    def told() -> float:
        steps.append("told")
        return A.sigma

    monkeypatch.setattr(petsc, "_two_steps", lambda: None if hidden or genuine is None else [*map(counted, genuine)])
    expected = np.count_nonzero(np.linalg.eigvalsh(A.formed().toarray()) < 0)
    assert inertia(A.at(0.0), told) == inertia(A) == expected > 3
    if hidden or genuine is None:
        assert steps == ["told"]
    else:
        assert steps == ["MatCholeskyFactorSymbolic", "told", *["MatCholeskyFactorNumeric"] * (not cancels)]
    monkeypatch.setattr("femsub.algebra.factor.SMALL", 1000)  # LAPACK finds no order
    assert inertia(A.at(0.0), told) == expected


def test_surfaces_and_trees_have_an_order_of_their_own() -> None:
    plate = fs.plate(fs.rectangle((1.0, 0.8), (20, 16)), E=2e11, nu=0.3, rho=7850, thickness=0.01)
    solid = fs.solid(fs.block((1.0, 1.0, 1.0), (8, 8, 8), "hexahedron"), fs.Material(2e11, 0.3, 7850))
    assert [good_order(part.K) for part in (fs.chain(200), plate, solid)] == ["amd", "amf", None]
    for part, number in ((plate, 2), (solid, 7)):  # AMF, or MUMPS' own choice
        made = SparseFactor(part.K + 1e3 * part.M, "symmetric")
        assert made._factor.getMumpsIcntl(7) == number
        made.close()


# a count beside the search ----------------------------------------------------------------------------------------------

@pytest.fixture
def plate() -> fs.Substructure:
    return fs.plate(fs.rectangle((1.0, 0.7), (12, 9)), E=2.1e11, nu=0.3, rho=7850.0, thickness=0.01,
                    interface=["left"])


def test_a_process_beside_counts_as_this_one_does(plate: fs.Substructure) -> None:
    beside = CountBeside(plate.K, plate.M)
    values = fs.normal_modes(plate, count=12).eigenvalues
    limit = float(values[8] + values[9]) / 2
    beside.ask(limit)
    assert beside.answer() == 9
    assert beside.answer() is None  # it answers once, and has ended


def test_a_process_beside_takes_all_cores_once_it_is_waited_for(monkeypatch: pytest.MonkeyPatch,
                                                                 capsys: pytest.CaptureFixture[str]) -> None:
    """It is heard of them while it factorises; before, it has one."""
    got, given = [], Event()

    class Libraries:
        def limit(self, limits: int) -> None:
            got.append(limits)
            given.set()

    def inertia(K: sp.csr_array, M: sp.csr_array, sigma: Callable[[], float]) -> int:
        os.write(ask, f"{(2.5).hex()}\n".encode())
        assert sigma() == 2.5 and not given.wait(0.05)
        os.write(ask, b"3\n")
        assert given.wait(60)
        return 7

    heard, ask = os.pipe()
    monkeypatch.setattr(beside, "load", lambda path: (inertia, (sp.eye_array(2), sp.eye_array(2))))
    monkeypatch.setattr(beside, "libraries", Libraries)
    monkeypatch.setattr("sys.stdin", SimpleNamespace(fileno=lambda: heard))
    monkeypatch.setattr("sys.argv", ["", ""])
    beside.serve()
    os.close(ask)
    assert got == [3] and capsys.readouterr().out == "7\n"


def test_cores_are_told_to_the_process_that_counts(plate: fs.Substructure, monkeypatch: pytest.MonkeyPatch) -> None:
    written, write = [], os.write
    monkeypatch.setattr(os, "write", lambda at, text: (written.append(text), write(at, text))[1])
    count = CountBeside(plate.K, plate.M)
    count.ask(1.0)
    with libraries().limit(limits=1):
        assert count.answer() == inertia(Difference(plate.K, plate.M, 1.0))
    assert written == [b"0x1.0000000000000p+0\n", b"1\n"]


def test_a_process_beside_that_was_not_asked_or_was_killed_answers_nothing(plate: fs.Substructure) -> None:
    before = set(Path("/dev/shm").glob("femsub-*"))
    assert CountBeside(plate.K, plate.M).answer() is None
    killed = CountBeside(plate.K, plate.M)
    children = Path(f"/proc/self/task/{os.getpid()}/children").read_text(encoding="ascii").split()
    os.kill(int(children[-1]), signal.SIGKILL)
    killed.ask(1.0)
    assert killed.answer() is None
    assert set(Path("/dev/shm").glob("femsub-*")) == before


@pytest.mark.parametrize("kind", [CountBeside, SignsBeside])
def test_a_process_beside_that_is_stopped_is_ended_and_named(kind: type[CountBeside | SignsBeside], plate: fs.Substructure,
                                                             monkeypatch: pytest.MonkeyPatch,
                                                             caplog: pytest.LogCaptureFixture) -> None:
    """Then this process does its work: None says so."""
    monkeypatch.setattr("femsub.algebra.processes.beside.PATIENCE", 0.2)
    started = CountBeside(plate.K, plate.M) if kind is CountBeside else SignsBeside(plate.K, plate.M, (1.0, 1.0))
    pid = int(Path(f"/proc/self/task/{os.getpid()}/children").read_text(encoding="ascii").split()[-1])
    os.kill(pid, signal.SIGSTOP)
    late = Timer(40.0, os.kill, (pid, signal.SIGKILL))  # the test would wait for ever
    late.start()
    if isinstance(started, CountBeside):
        started.ask(1.0)
    assert started.answer() is None and late.is_alive()
    late.cancel()
    assert not Path(f"/proc/{pid}").exists()
    assert [record.getMessage() for record in caplog.records if f"process {pid}" in record.getMessage()
            and "is stopped (state T)" in record.getMessage()]


def test_a_small_model_starts_no_process(plate: fs.Substructure) -> None:
    assert CountBeside.started(plate.K, plate.M, 1e5, 100) is None


@pytest.mark.slow
def test_the_process_starts_before_the_factor_where_it_is_sure_to_be_worth_it(monkeypatch: pytest.MonkeyPatch) -> None:
    solid = fs.solid(fs.block((1.0, 0.5, 0.3), (14, 9, 6), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0),
                     supports={"left": "clamped"})
    assert CountBeside.early(solid.K, solid.M, 30) is None  # too small
    monkeypatch.setattr("femsub.algebra.counted_beside.WORTH", 1e5)
    order, start, factor = [], CountBeside.__init__, SparseFactor.__init__
    monkeypatch.setattr(CountBeside, "__init__", lambda self, *given: (order.append("count"), start(self, *given))[1])
    monkeypatch.setattr(SparseFactor, "__init__", lambda self, *given: (order.append("factor"), factor(self, *given))[1])
    with libraries().limit(limits=2):
        modes = fs.normal_modes(solid, count=12)
    both = len(os.sched_getaffinity(0)) > 1
    assert modes.evidence == "certified" and order[0] == ("count" if both else "factor")
    chain = fs.chain(50000)
    assert CountBeside.early(chain.K, chain.M, 30) is None  # its factor has few nonzeros


@pytest.mark.slow
def test_a_part_is_counted_beside_its_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """From about the middle of the search on: its limit need not be known to more than a few digits."""
    asked, ask, made, order, blocks = [], CountBeside.ask, [], [], []
    answer, solve = CountBeside.answer, SparseFactor.solve
    monkeypatch.setattr("femsub.algebra.counted_beside.WORTH", 1e5)
    monkeypatch.setattr(CountBeside, "ask", lambda self, value: (asked.append(value), blocks.append("ask"), ask(self, value)))
    monkeypatch.setattr(SparseFactor, "solve", lambda self, B: (blocks.append(B.shape[1:]), solve(self, B))[1])
    # slower than all else here, as the count of a large part is
    monkeypatch.setattr(CountBeside, "busy", property(lambda self: self.value is not None))
    monkeypatch.setattr(CountBeside, "answer", lambda self: (order.append("count"), answer(self))[1])
    monkeypatch.setattr("femsub.modes.normal_modes.orthonormalise",
                        lambda *given: (order.append("residuals"), orthonormalise(*given))[1])
    for threads in (1, 2):
        sub = fs.solid(fs.block((1.0, 0.5, 0.3), (14, 9, 6), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0), interface=["left"])
        made.append(-factors_made())
        blocks.clear()
        with libraries().limit(limits=threads):
            highest = fs.reduce(sub, fs.CraigBampton(20)).K[-1, -1]
        made[-1] += factors_made()
    assert len(asked) == made[0] - made[1] == int(len(os.sched_getaffinity(0)) > 1)
    assert all(highest < value for value in asked)
    assert order == ["residuals", "residuals", "count"][:2 + len(asked)]
    if asked:
        search = [one for one in blocks if one in ("ask", (8,))]
        assert 0.3 * len(search) < search.index("ask") < 0.7 * len(search)


@pytest.mark.slow
def test_the_modes_of_a_projection_are_counted_beside_its_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three factorisations less in this process, that of the count and two of the bounds, and the same count."""
    monkeypatch.setattr("femsub.algebra.counted_beside.WORTH", 1e5)
    told = []
    for threads in (1, 2):
        sub = fs.solid(fs.block((1.0, 0.5, 0.3), (14, 9, 6), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0),
                       supports={"left": "clamped"})
        uneven = sp.diags_array(np.linspace(1.0, 2.0, sub.size))
        pencil = fs.Pencil(sub.M, sp.csr_array(1e-7 * (uneven @ sub.K @ uneven)), sub.K)
        before = factors_made()
        with libraries().limit(limits=threads):
            found = fs.complex_modes(pencil, band=(0.0, 6e3))
        told.append((factors_made() - before, len(found), found.evidence))
    assert told[0][0] - told[1][0] == 3 * int(len(os.sched_getaffinity(0)) > 1)
    assert told[0][1:] == told[1][1:] and told[0][1] > 2 and told[0][2] == "certified"


# tests of definiteness beside the search --------------------------------------------------------------------------------

@pytest.mark.slow
def test_a_process_beside_tells_signs_as_this_one_does(plate: fs.Substructure) -> None:
    t = float(fs.normal_modes(plate, count=12).eigenvalues[8])
    A, M = sp.csr_array(plate.K + t * plate.M), plate.M
    for d, D, both in ((2.0, M, (True, True)), (0.5, M, (False, True)), (0.5, sp.csr_array(-M), (True, False))):
        ends = d / t, d / t
        assert SignsBeside(A, D, ends).answer() == both == signs(A, D, ends)  # xᵀAx ≥ t xᵀMx, as in rigid motion


def test_matrices_of_one_pattern_share_their_order(plate: fs.Substructure, monkeypatch: pytest.MonkeyPatch) -> None:
    t = float(fs.normal_modes(plate, count=12).eigenvalues[8])
    given, again = [], SparseFactor.again
    monkeypatch.setattr(SparseFactor, "again", lambda self, A: (given.append(A), again(self, A))[1])
    definite, indefinite = sp.csr_array(plate.K + t * plate.M), sp.csr_array(plate.K - t * plate.M)
    twice, other = 2 * definite, sp.csr_array(sp.eye_array(plate.size))
    matrices = [definite, twice, indefinite, definite, twice, other, definite]
    assert are_definite(matrices) == [True, True, False, True, True, True, True]
    assert len(given) == 3 and given[0] is twice and given[1] is indefinite and given[2] is twice


def test_a_process_that_was_killed_tells_no_sign(plate: fs.Substructure) -> None:
    killed = SignsBeside(plate.K, plate.M, (1.0, 1.0))
    children = Path(f"/proc/self/task/{os.getpid()}/children").read_text(encoding="ascii").split()
    os.kill(int(children[-1]), signal.SIGKILL)
    assert killed.answer() is None


def damped(share: float) -> fs.Pencil:
    """A solid with uneven damping, and at some DOF dashpots of so large a share of their stiffness at ω = 6,000 rad/s."""
    sub = fs.solid(fs.block((1.0, 0.5, 0.3), (14, 9, 6), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0),
                   supports={"left": "clamped"})
    uneven, strong = sp.diags_array(np.linspace(1.0, 2.0, sub.size)), np.zeros(sub.size)
    strong[::700] = share * sub.K.diagonal()[::700] / 6e3
    return fs.Pencil(sub.M, sp.csr_array(1e-7 * (uneven @ sub.K @ uneven) + sp.diags_array(strong)), sub.K)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("end", ["answers", "is killed"])
@pytest.mark.parametrize("share", [0.0, 3.0])
def test_bounds_of_damping_are_those_of_this_process(share: float, end: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether dampers are strong or not, and whatever becomes of the process."""
    found, answers, start, answer = [], [], SignsBeside.__init__, SignsBeside.answer

    def begun(self: SignsBeside, A: sp.csr_array, D: sp.csr_array, d: tuple[float, float]) -> None:
        start(self, A, D, d)
        if end == "is killed":
            self._process.kill()

    monkeypatch.setattr(SignsBeside, "__init__", begun)
    monkeypatch.setattr(SignsBeside, "answer", lambda self: (answers.append(answer(self)), answers[-1])[1])
    for worth in (1e12, 1e5):
        monkeypatch.setattr("femsub.algebra.counted_beside.WORTH", worth)
        with libraries().limit(limits=2):
            projection = Projection(damped(share), Contour(sides=(-6e3, 6e3, 6e3)))
        found.append((projection.coercivity((-6e3, 6e3), 6e3), projection.size))
    assert found[0] == pytest.approx(found[1], rel=1e-9) and found[0][0] > 0
    if len(os.sched_getaffinity(0)) > 1:
        assert answers == [None if end == "is killed" else (share == 0, True)]


@pytest.mark.slow
def test_modes_of_a_projection_are_counted_while_their_factor_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("femsub.algebra.counted_beside.WORTH", 1e5)
    order, ask, factor = [], CountBeside.ask, SparseFactor.__init__
    monkeypatch.setattr(CountBeside, "ask", lambda self, value: (order.append("count"), ask(self, value))[1])
    monkeypatch.setattr(SparseFactor, "__init__", lambda self, *given: (order.append("factor"), factor(self, *given))[1])
    with libraries().limit(limits=2):
        Projection(damped(0.0), Contour(sides=(-6e3, 6e3, 6e3)))
    both = len(os.sched_getaffinity(0)) > 1
    assert order[0] == ("count" if both else "factor")
