"""Repeated and clustered spectra, with bands that end on eigenvalues and counts that cut clusters; what "in the band" means."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from clustered import evaluate, make

import femsub as fs
from benchmarks.lattices import lattice, membrane, membrane_eigenvalues
from femsub.algebra import petsc
from femsub.checks import EQUAL
from femsub.model.bands import DOUBLE, beyond, in_band, moving, upper, widened, within
from femsub.modes.dense import dense_modes
from femsub.modes.quadratic.matching import clear_radius, clusters, distinct, joined

# Of 1000 numbers these were wrong or refused at some time, each in a way of its own.
KNOWN = (51, 91, 113, 153, 161, 167, 365, 453, 557, 873)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("first", range(0, 64, 8))
def test_random_models_are_complete_and_none_is_refused(first: int) -> None:
    """The first 64 of the random models; 3,000 were tried once, at commit 4e8630c."""
    for number in range(first, first + 8):
        case = make(number)
        assert not (told := evaluate(case)), f"{number}: {case}: {told}"


@pytest.mark.slow
@pytest.mark.sampled(99)
@pytest.mark.sampled(2)
@pytest.mark.parametrize("number", KNOWN)
def test_models_that_failed_once(number: int) -> None:
    assert not (told := evaluate(make(number))), told


# what "in the band" means


def test_edges_belong_to_the_band() -> None:
    omega = np.array([1.0, 1.0 * (1 - 0.5 * EQUAL), 1.0 - 1e-4, 2.0, 2.0 * (1 + 0.5 * EQUAL), 2.0 + 1e-4])
    assert np.array_equal(in_band(omega, (1.0, 2.0)), [True, True, False, True, True, False])
    values = np.array([-0.1 + 1j, -0.1 * (1 + EQUAL) + 1j, -0.2 + 1j, 0.3 + 1j, -0.05 + 1.5j, -0.05 + 2.5j])
    assert np.array_equal(in_band(values, (1.0, 2.0), (-0.1, 0.1)), [True, True, False, False, True, False])
    assert np.array_equal(in_band(values, (1.0, 2.0)), [True, True, True, True, True, False])
    assert not in_band(np.zeros(0), (1.0, 2.0)).size and np.array_equal(in_band(np.zeros(2), (0.0, 1.0)), [True, True])


def test_a_split_double_eigenvalue_is_in_or_out_as_one() -> None:
    split = 2e-8
    real = np.array([-3 + split * 1j, -3 - split * 1j])
    assert in_band(real, (0.0, 5.0)).all() and in_band(real[:1], (0.0, 5.0)).all() and in_band(real[1:], (0.0, 5.0)).all()
    on_edge = np.array([-3 - split + 1j, -3 + split + 1j])
    assert in_band(on_edge, (0.0, 5.0), (-3.0, 0.0)).all()
    assert not in_band(on_edge, (0.0, 5.0), (-2.9, 0.0)).any()
    assert np.array_equal(in_band(np.array([-3 - 4 * DOUBLE + 1j, -3 + 1j]), (0.0, 5.0), (-3.0, 0.0)), [False, True])
    noise = np.array([1e-16 - 5e-16j, 1e-16 + 5e-16j])  # of an eigenvalue at 0
    assert in_band(noise, (0.0, 2.0)).all()
    assert np.array_equal(in_band(np.array([1j, -1j]), (0.0, 2.0)), [True, False])


def test_other_filters_have_the_same_edges() -> None:
    omega = 2.0 * (1 + EQUAL * np.array([-1.0, 0.0, 0.9, 1.1]))
    assert np.array_equal(beyond(omega, 2.0), ~in_band(omega, (0.0, 2.0)) | (omega > 2 * (1 + EQUAL)))
    assert np.array_equal(beyond(omega, 2.0), [False, False, False, True]) and not beyond(omega, np.inf).any()
    values = np.array([-1.0 + 1j, -3.0 + 1j, 1j, 3j, -1.0 - 0.5 * DOUBLE * 1j, -1.0 - 2 * DOUBLE * 1j, 0.0])
    assert np.array_equal(within(values, (0.0, 2.0)), in_band(values, (0.0, 2.0), (-2.0, 2.0)))
    assert np.array_equal(upper(values), [True, True, True, True, True, False, True])
    bars = np.array([0.0, 2e-3, 0.0, 0.0])
    assert np.array_equal(moving(np.array([1.0, 1e-3, 1e-16j, 0.0]), bars), [True, False, False, False])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("sparse", [False, True])
def test_every_mode_on_an_edge_is_in(sparse: bool) -> None:
    m = 16 if sparse else 7
    sub, omega = membrane(m), np.sqrt(membrane_eigenvalues(m))
    sub = sub if sparse else fs.Substructure(sub.M.toarray(), sub.K.toarray())
    D = 0.02 * sub.M
    for lo, hi in ((0.0, omega[9]), (omega[4], omega[9]), (omega[1], omega[2] * (1 + 1e-7)), (omega[7], omega[12])):
        expected = int(np.count_nonzero((omega >= lo * (1 - 1e-12)) & (omega <= hi * (1 + 1e-12))))
        found = fs.normal_modes(sub, band=(lo, hi))
        assert len(found.frequencies) == expected
        assert found.counted[1] == expected + found.unlisted
        edges = [float(np.sqrt(edge**2 - 0.01**2)) if edge else 0.0 for edge in (lo, hi)]
        for re in (None, (-0.01, 0.01), (-1.0, -0.01)):
            modes = fs.complex_modes(fs.Pencil(sub.M, D, sub.K), band=(edges[0], edges[1]), re=re)
            assert len(modes) == expected and modes.evidence == "certified"


@pytest.mark.parametrize("sparse", [False, True])
def test_all_of_a_sixfold_cluster_on_an_edge_come_back(sparse: bool) -> None:
    one = fs.chain(70 if sparse else 12)
    K, M = (sp.csr_array(sp.kron(sp.eye_array(6), part)) for part in (one.K, one.M))
    K, M = (K, M) if sparse else (K.toarray(), M.toarray())
    omega = fs.chain_frequencies(one.size, 4)
    for band in ((0.0, omega[2]), (omega[1], omega[2]), (omega[2], omega[3])):
        expected = np.repeat(omega[(omega >= band[0]) & (omega <= band[1])], 6)
        assert fs.normal_modes(fs.Substructure(M, K), band=band).frequencies == pytest.approx(expected, rel=1e-10)
        modes = fs.complex_modes(fs.Pencil(M, None, K), band=band)
        assert np.sort(modes.frequencies) == pytest.approx(expected, rel=1e-10) and modes.evidence == "certified"


@pytest.mark.sampled(2)
@pytest.mark.parametrize("n", [20, 300])
@pytest.mark.parametrize("re", [None, (-1.0, 0.0), (-2.5, -1.0)])
def test_both_of_a_double_real_eigenvalue_come_back(n: int, re: tuple[float, float] | None) -> None:
    """One critically damped mode, λ = -1 twice, among others with |Im λ| ≥ 3."""
    rng = np.random.default_rng(n)
    k = np.append(1.0, np.linspace(9.1, 60.0, n - 1))
    d = np.append(2.0, np.full(n - 1, 0.01))
    A = sp.csr_array(sp.block_diag([sp.coo_array(la.qr(rng.standard_normal((4, 4)))[0]) for _ in range(n // 4)]))
    parts = [sp.csr_array(A.T @ sp.diags_array(part) @ A) for part in (np.ones(n), d, k)]
    modes = fs.complex_modes(fs.Pencil(*parts), band=(0.0, 2.5), re=re)
    assert modes.eigenvalues == pytest.approx([-1.0, -1.0], abs=1e-6)


# right, but refused


@pytest.mark.parametrize("n", [12, 60, 300, 3100])
def test_stiffness_proportional_to_mass(n: int) -> None:
    M = sp.diags_array([np.full(n - 1, 1 / 6), np.full(n, 4 / 6), np.full(n - 1, 1 / 6)], offsets=[-1, 0, 1], format="csr")
    modes = fs.normal_modes(fs.Substructure(M, 2 * M), count=9)
    assert modes.frequencies == pytest.approx(np.full(9, np.sqrt(2)), rel=1e-12)
    assert modes.shapes.T @ (M @ modes.shapes) == pytest.approx(np.eye(9), abs=1e-10)
    exact = -0.01 + 1j * np.sqrt(2 - 0.01**2)
    found = fs.complex_modes(fs.Pencil(M, 0.02 * M, 2 * M), count=8)
    assert np.where(found.eigenvalues.imag > 0, found.eigenvalues, found.eigenvalues.conj()) == pytest.approx(np.full(8, exact))
    assert (found.error_bar < 1e-9).all() and found.evidence == "certified"


def test_the_seam_of_dense_modes_lies_in_a_gap(rng: np.random.Generator) -> None:
    """A cluster at the middle of the spectrum, where the two decompositions would meet."""
    for spread in (0.0, 1e-14, 1e-10, 1e-6):
        values = np.concatenate([[1e-3, 2e-3], 1 + spread * rng.uniform(-1, 1, 20), [5e2, 1e3]])
        A = la.qr(rng.standard_normal((24, 24)))[0] * rng.uniform(0.5, 2, 24)
        M, K = A.T @ A, A.T @ (values[:, None] * A)
        found, shapes = dense_modes((K + K.T) / 2, (M + M.T) / 2)
        assert found == pytest.approx(np.sort(values), rel=1e-10)
        assert shapes.T @ M @ shapes == pytest.approx(np.eye(24), abs=1e-11)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("count", range(2, 20, 3))
def test_a_count_that_cuts_a_cluster(count: int) -> None:
    one = fs.chain(60, belt=2)
    pencil = one.linearised(fs.Belt(slope=-0.01))
    parts = [sp.csr_array(sp.kron(sp.eye_array(5), part)) for part in (pencil.M, pencil.D, pencil.K)]
    exact = np.repeat(fs.complex_modes(one, fs.Belt(slope=-0.01)).eigenvalues, 5)
    modes = fs.complex_modes(fs.Pencil(*parts), count=count)
    assert len(modes) in (count, count + 1)
    assert np.sort(np.abs(modes.eigenvalues)) == pytest.approx(np.sort(np.abs(exact))[:len(modes)], rel=1e-8)
    normal = fs.normal_modes(fs.Substructure(parts[0], parts[2]), count=count)
    assert normal.frequencies == pytest.approx(np.repeat(fs.chain_frequencies(60, 5), 5)[:count], rel=1e-10)
    assert normal.counted[1] <= count + 5


@pytest.mark.sampled(3)
@pytest.mark.parametrize("count", [6, 18, 19, 40])
@pytest.mark.parametrize("seed", [0, 4])
def test_an_unsymmetric_floating_pencil_has_all_of_its_zeros(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    sub = lattice(8, 8, seed=seed)
    first, second = rng.choice(sub.size // 2, 2, replace=False)
    normal, along = np.zeros((2, sub.size, 1))
    normal[[2 * first, 2 * second], 0] = along[[2 * first + 1, 2 * second + 1], 0] = 1, -1
    pencil = fs.Pencil(sub.M, None, sub.K + sp.csr_array((0.3 * normal + 0.1 * along) @ normal.T))
    modes = fs.complex_modes(pencil, count=count)
    assert np.count_nonzero(modes.eigenvalues == 0) == 4  # of two translations; a turn shears the contact
    squares = la.eigvals(pencil.K.toarray(), pencil.M.toarray())
    exact = np.sort(np.abs(np.sqrt(np.append(squares, squares).astype(complex))))[:len(modes)]
    assert np.sort(np.abs(modes.eigenvalues))[4:] == pytest.approx(exact[4:], rel=1e-6)
    assert modes.evidence == "certified"


def test_a_breakdown_is_met_with_another_start_and_more_room(monkeypatch: pytest.MonkeyPatch) -> None:
    original, tried = petsc.quadratic_modes, []

    def breaking(*arguments: object, **options: object) -> tuple[np.ndarray, np.ndarray]:
        tried.append((arguments[3], options["seed"]))
        if len(tried) < 3:
            raise fs.checks.BreakdownError("PEP failed (Error in LAPACK subroutine trexc: info=1)")
        return original(*arguments, **options)

    exact = fs.complex_modes(fs.chain(2500, belt=2), count=10)
    monkeypatch.setattr("femsub.modes.quadratic.search.right_pairs", lambda *_: None)
    monkeypatch.setattr("femsub.modes.quadratic.sparse.quadratic_modes", breaking)
    again = fs.complex_modes(fs.chain(2500, belt=2), count=10)
    assert len(tried) == 3 and tried[2][0] > tried[0][0] and tried[2][1] != tried[0][1]
    assert again.eigenvalues == pytest.approx(exact.eigenvalues, rel=1e-9)


def test_a_limit_that_a_mode_lies_on_is_moved() -> None:
    for n in (40, 300):
        omega = fs.chain_frequencies(n)
        found = fs.normal_modes(fs.chain(n), band=(0.0, omega[7] / widened(1.0)))
        assert len(found.frequencies) == 7 and found.counted[1] == 7 + found.unlisted


# searches put together


def test_ghosts_go_and_defective_pairs_stay(rng: np.random.Generator) -> None:
    X = rng.standard_normal((30, 6)) + 1j * rng.standard_normal((30, 6))
    values = np.array([1j, 1j * (1 + 1e-14), 2j, 2j, -1 + 1e-8j, -1 - 1e-8j])
    X[:, 1] = X[:, 0] * (2 + 1j) + 1e-9 * X[:, 1]  # a ghost; 2j is double
    X[:, 5] = X[:, 4] + 1e-8 * X[:, 5]  # a Jordan block that rounding has split
    kept, shapes = distinct(values, X)
    assert len(kept) == 5 == shapes.shape[1] and np.count_nonzero(np.abs(kept - 1j) < 1e-6) == 1


def test_two_equal_real_ones_that_rounding_made_a_pair_are_two(rng: np.random.Generator) -> None:
    x = rng.standard_normal((30, 2)) @ np.array([1, 1j])
    values, X = distinct(np.array([-2 + 1e-15j, -3 + 1e-8j]), np.column_stack([x, x]))
    assert np.sort_complex(values) == pytest.approx([-3 + 1e-8j, -2, -2], abs=1e-12)
    assert np.linalg.matrix_rank(X[:, values == -2]) == 2 and not X[:, values == -2].imag.any()


def test_another_search_adds_what_is_new(rng: np.random.Generator) -> None:
    space = rng.standard_normal((30, 3)).astype(complex)
    other = rng.standard_normal((30, 2)).astype(complex)
    late = np.column_stack([space @ rng.standard_normal((3, 2)), 2j * other[:, 0], other[:, 1]])
    values, X = joined(np.array([1j, 3j]), np.column_stack([space[:, 0], other[:, 0]]), np.array([1j, 1j, 3j, 4j]), late)
    assert np.array_equal(values, [1j, 3j, 1j, 1j, 4j]) and np.linalg.matrix_rank(X) == 5


def test_clusters_and_where_to_count() -> None:
    values = np.array([0.0, 1j, 2j, 1j * (1 + 1e-9), 0.0, 5.0])
    assert sorted(map(tuple, clusters(values, 1e-6))) == [(0, 4), (1, 3)]
    size = np.array([1.0, 2.0, 2.0, 2.0, 3.0])
    assert 2.0 < clear_radius(size, 2) < 3.0 and 1.0 < clear_radius(size, 1) < 2.0
    assert 1.999 < clear_radius(size[:4], 2) < 2.0 and 2.999 < clear_radius(size, 5) < 3.0
    assert 0.999 < clear_radius(np.ones(4), 2) < 1.0
