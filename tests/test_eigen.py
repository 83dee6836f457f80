"""Normal modes against closed forms; rigid-body modes; the independent count."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from reducedproblems import rigid_motions

import femsub as fs
from benchmarks.attacks import stiff_soft
from benchmarks.lattices import lattice, membrane, membrane_eigenvalues
from femsub.modes.normal_modes import count_deferred, lowest_modes
from femsub.modes.shift_invert import ShiftInvert


@pytest.mark.parametrize("n", [10, 60, 100, 101, 1000, 10_000])
def test_chain_frequencies(n: int) -> None:
    count = min(n, 20)
    modes = fs.normal_modes(fs.chain(n), count=count)
    assert np.abs(modes.frequencies / fs.chain_frequencies(n, count) - 1).max() < 1e-12
    assert modes.residual.max() < 1e-12 and modes.rigid == 0
    assert modes.counted[1] >= count


@pytest.mark.slow
def test_chain_of_a_million_masses() -> None:
    modes = fs.normal_modes(fs.chain(1_000_000), count=4)
    assert np.abs(modes.frequencies / fs.chain_frequencies(1_000_000, 4) - 1).max() < 1e-9


@pytest.mark.parametrize("n", [10, 1000])
def test_all_modes(n: int) -> None:
    modes = fs.normal_modes(fs.chain(n), count=n)
    assert np.abs(modes.frequencies / fs.chain_frequencies(n) - 1).max() < 1e-11


@pytest.mark.parametrize("m", [6, 30])
def test_repeated_pairs_are_complete(m: int) -> None:
    modes = fs.normal_modes(membrane(m), count=24)
    assert np.allclose(modes.eigenvalues, membrane_eigenvalues(m)[:24], rtol=1e-11)
    assert np.allclose(modes.shapes.T @ modes.shapes, np.eye(24), atol=1e-10)


def test_a_missed_mode_of_a_pair_is_found_and_fetched(monkeypatch: pytest.MonkeyPatch) -> None:
    from femsub import algebra

    original, calls = algebra.symmetric_modes, []

    def forgetful(*arguments: object, **options: object) -> tuple[np.ndarray, np.ndarray]:
        values, shapes = original(*arguments, **options)
        calls.append(len(values))
        if len(calls) > 1:
            return values, shapes
        order = np.argsort(values)
        keep = np.setdiff1d(np.arange(len(values)), order[2])  # one of the pair λ_12 = λ_21
        return values[keep], shapes[:, keep]

    monkeypatch.setattr("femsub.algebra.symmetric_modes", forgetful)
    modes = fs.normal_modes(membrane(30), count=10)
    assert len(calls) == 2
    assert np.allclose(modes.eigenvalues, membrane_eigenvalues(30)[:10], rtol=1e-11)


def test_a_mode_that_cannot_be_fetched_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    from femsub import algebra

    original = algebra.symmetric_modes

    def blind(*arguments: object, **options: object) -> tuple[np.ndarray, np.ndarray]:
        values, shapes = original(*arguments, **options)
        keep = np.argsort(values)[1:]
        return values[keep], shapes[:, keep]

    monkeypatch.setattr("femsub.algebra.symmetric_modes", blind)
    with pytest.raises(fs.MissedModesError, match="inertia"):
        fs.normal_modes(fs.chain(300), count=10)


@pytest.mark.parametrize(("nx", "ny"), [(4, 5), (15, 12)])
@pytest.mark.parametrize(("mass", "stiffness"), [(1.0, 1.0), (1e-9, 1e3), (1e6, 1e-6)])
def test_rigid_modes_survive_a_change_of_units(nx: int, ny: int, mass: float, stiffness: float) -> None:
    plain = lattice(nx, ny)
    modes = fs.normal_modes(fs.Substructure(mass * plain.M, stiffness * plain.K), count=5)
    assert modes.rigid == 3
    assert np.array_equal(modes.eigenvalues[:3], np.zeros(3))
    space = np.linalg.qr(rigid_motions(nx, ny))[0]
    shapes = modes.shapes[:, :3]
    assert np.abs(shapes - space @ (space.T @ shapes)).max() < 1e-10 * np.abs(shapes).max()
    assert np.allclose(modes.shapes.T @ (mass * plain.M @ modes.shapes), np.eye(8), atol=1e-9)
    exact = la.eigvalsh(plain.K.toarray(), plain.M.toarray())[3:8] * stiffness / mass
    assert np.allclose(modes.eigenvalues[3:], exact, rtol=1e-9)


def test_two_floating_pieces() -> None:
    pieces = [lattice(6, 7), lattice(5, 9, seed=1)]
    K = sp.block_diag([piece.K for piece in pieces])
    M = sp.block_diag([piece.M for piece in pieces])
    modes = fs.normal_modes(fs.Substructure(M, K), count=3)
    assert modes.rigid == 6


def test_a_held_component_is_factorised_once_and_looks_for_no_rigid_modes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ShiftInvert, "_find_rigid", None)
    assert fs.normal_modes(lattice(15, 12, held=True), count=5).factorisations == 1


def test_a_floating_one_is_factorised_once_too() -> None:
    assert fs.normal_modes(lattice(15, 12), count=5).factorisations == 1


@pytest.mark.parametrize("n", [80, 300])
def test_band(n: int) -> None:
    exact = fs.chain_frequencies(n)
    modes = fs.normal_modes(fs.chain(n), band=(0.1, 0.4))
    assert np.allclose(modes.frequencies, exact[(exact >= 0.1) & (exact <= 0.4)], rtol=1e-11)
    below = int((exact < 0.4).sum())
    assert modes.counted == (pytest.approx(0.4, rel=1e-5), below) and modes.unlisted == int((exact < 0.1).sum())
    assert f"{below} counted below 0.4, {modes.unlisted} of them outside the band" in repr(modes)


@pytest.mark.parametrize("n", [20, 300])
def test_massless_dof(n: int) -> None:
    sub = fs.chain(n)
    mass = np.ones(n)
    mass[1::2] = 0.0
    modes = fs.normal_modes(fs.Substructure(sp.diags_array(mass), sub.K), count=4)
    # every second mass gone: a chain of n/2 masses with springs 1/2
    K = sub.K.toarray()
    even, odd = np.arange(0, n, 2), np.arange(1, n, 2)
    condensed = K[np.ix_(even, even)] - K[np.ix_(even, odd)] @ np.linalg.solve(K[np.ix_(odd, odd)], K[np.ix_(odd, even)])
    assert np.allclose(modes.eigenvalues, la.eigvalsh(condensed)[:4], rtol=1e-10)


@pytest.mark.parametrize("n", [10, 300])
def test_more_modes_than_there_are_and_bad_requests(n: int) -> None:
    with pytest.warns(fs.FemsubWarning, match=f"count={n + 1} elastic modes .* has {n} of finite"):
        assert np.allclose(fs.normal_modes(fs.chain(n), count=n + 1).frequencies, fs.chain_frequencies(n), rtol=1e-9)
    with pytest.raises(ValueError, match="either count"):
        fs.normal_modes(fs.chain(n))
    with pytest.raises(ValueError, match="0 <= lo < hi"):
        fs.normal_modes(fs.chain(n), band=(0.4, 0.1))
    indefinite = fs.Substructure(sp.eye_array(n), fs.chain(n).K - 0.5 * sp.eye_array(n))
    with pytest.raises(fs.SingularMatrixError, match="not positive definite"):
        fs.normal_modes(indefinite, count=2)


def test_repr() -> None:
    told = repr(fs.normal_modes(fs.chain(10, fixed=False), count=3))
    assert told.startswith("NormalModes: 1 rigid and 3 elastic, ω 0.31287 to 0.90798 rad/time; largest residual")


def test_modes_of_a_reduced_model_have_residuals_too() -> None:
    """Its fixed-interface modes span seven decades of stiffness: the least bit of the highest ruins the lowest."""
    sub = fs.beam(1.0, 100, E=2.1e11, I=1e-9, rho=7850.0, A=1e-4, supports={"left": "clamped"}, interface=["right"])
    rom = fs.reduce(sub, fs.CraigBampton(modes=40))
    modes = fs.normal_modes(rom, count=42)
    assert modes.residual.max() < 1e-12
    assert np.abs(modes.shapes.T @ (rom.M @ modes.shapes) - np.eye(42)).max() < 1e-9


@pytest.mark.parametrize(("n", "spring"), [(12, 1e-12), (12, 1e-10), (300, 1e-9)])
def test_a_soft_mount_is_not_taken_for_rigid_motion(n: int, spring: float) -> None:
    modes = fs.normal_modes(fs.chain(n, springs=np.append(spring, np.ones(n - 1))), count=3)
    assert modes.rigid == 0
    assert modes.eigenvalues[0] == pytest.approx(spring / n, rel=10 * modes.rounding[0] + n * spring)
    assert modes.eigenvalues[1] == pytest.approx(fs.normal_modes(fs.chain(n, fixed=False), count=1).eigenvalues[1], rel=1e-6)


@pytest.mark.parametrize("mass", [1e6, 1e12])
def test_modes_beside_one_of_a_heavy_mass_stay_orthogonal(mass: float) -> None:
    sub = fs.chain(200, masses=np.where(np.arange(200) == 100, mass, 1.0))
    modes = fs.normal_modes(sub, count=55)  # the last solve blows up what is left of the first mode in others by 1e7 and more
    assert modes.residual.max() < 1e-13
    assert np.abs(modes.shapes.T @ (sub.M @ modes.shapes) - np.eye(55)).max() < 1e-12


def test_a_cluster_larger_than_krylov_schur_can_hold_goes_to_lapack() -> None:
    modes = fs.normal_modes(fs.Substructure(sp.eye_array(300), sp.eye_array(300)), count=5)
    assert np.allclose(modes.eigenvalues, np.ones(5), rtol=1e-14)


@pytest.mark.parametrize(("mass", "stiffness"), [(1e-30, 1e30), (1e30, 1e-30)])
def test_floating_dense_models_in_far_units(mass: float, stiffness: float) -> None:
    plain = lattice(4, 5)
    modes = fs.normal_modes(fs.Substructure(mass * plain.M, stiffness * plain.K), count=5)
    exact = fs.normal_modes(plain, count=5).eigenvalues * (stiffness / mass)
    assert modes.rigid == 3 and np.allclose(modes.eigenvalues[3:], exact[3:], rtol=1e-12)


def test_digits_that_rounding_takes_are_told() -> None:
    stiff = fs.chain(200, springs=np.where(np.arange(200) % 2, 1e-12, 1.0))
    with pytest.warns(fs.ConditionWarning, match=r"may change ω² of mode 1 by a relative [1-9]e\+00"):
        modes = fs.normal_modes(stiff, count=3)
    assert modes.rounding[0] > 1 and fs.normal_modes(fs.chain(200), count=3).rounding.max() < 1e-10
    free = fs.Substructure(*(sp.block_diag([getattr(fs.chain(60, fixed=False, springs=k), key) for k in (1.0, 1e12)])
                             for key in "MK"))
    modes = fs.normal_modes(free, count=3)  # no spring joins the two: each keeps its digits
    assert modes.rigid == 2 and np.allclose(modes.frequencies[2:], 2 * np.sin(np.pi * np.arange(1, 4) / 120), rtol=1e-9)


def test_modes_of_a_mass_matrix_of_low_rank_are_counted_by_its_rank() -> None:
    """Two DOF that share one mass, and few masses on a large sparse part: so many modes as M has rank."""
    K = fs.chain(400).K
    at = np.array([10, 50, 90, 200, 300])
    few = sp.lil_array((400, 400))
    few[at, at] = 1.0
    few[10, 50] = few[50, 10] = 0.3  # not diagonal
    exact = 1 / np.sqrt(np.linalg.eigvals(np.linalg.solve(K.toarray(), few.toarray())).real.clip(1e-9))
    exact = np.sort(exact[exact < 1e3])
    assert len(exact) == 5
    for count in (4, 5):
        assert np.allclose(fs.normal_modes(fs.Substructure(few.tocsr(), K), count=count).frequencies, exact[:count], rtol=1e-10)
    with pytest.warns(fs.FemsubWarning, match=r"count=6 elastic modes of 'part' were asked for, but it has 5 of finite"):
        modes = fs.normal_modes(fs.Substructure(few.tocsr(), K), count=6)
    assert np.allclose(modes.frequencies, exact, rtol=1e-10) and modes.evidence == "certified"
    shared = np.eye(20)
    shared[3, 4] = shared[4, 3] = 1.0  # one mass, moved by both
    with pytest.warns(fs.FemsubWarning, match="but it has 19 of finite frequency"):
        assert len(fs.normal_modes(fs.Substructure(shared, fs.chain(20).K), count=20).frequencies) == 19


@pytest.mark.parametrize("free", [False, True])
def test_of_fewer_modes_than_asked_for_all_are_returned(free: bool) -> None:
    """Three DOF of which one has no mass, held and free."""
    sub = fs.Substructure(np.diag([1.0, 0.0, 1.0]), fs.chain(3, fixed=not free).K, name="few")
    beside = " beside 1 rigid-body modes" if free else ""
    with pytest.warns(fs.FemsubWarning, match=f"count=3 elastic modes of 'few' were asked for, but it has {2 - free} of finite "
                                              f"frequency{beside}. All of them are returned"):
        modes = fs.normal_modes(sub, count=3)
    # springs 1/2 and, held, 1 to the ground
    exact = [1.0] if free else np.sqrt(np.linalg.eigvalsh([[1.5, -0.5], [-0.5, 0.5]]))
    assert modes.rigid == free and np.allclose(modes.frequencies[free:], exact) and modes.evidence == "certified"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fs.normal_modes(sub, count=2 - free)


def test_a_piece_held_by_rounding_is_refused() -> None:
    K = np.zeros((7, 7))
    K[:6, :6] = fs.chain(6, fixed=False).K.toarray()
    K[6, 6] = 1e-16
    with pytest.raises(fs.SingularMatrixError, match="K is numerically singular"):
        fs.normal_modes(fs.Substructure(np.eye(7), K), count=3)


def written(A: sp.sparray, digits: int) -> sp.csr_array:
    """The matrix as a file of so many significant digits holds it."""
    A = sp.csr_array(A, copy=True)
    A.data = np.array([float(f"{value:.{digits - 1}e}") for value in A.data])
    return A


def free_block(cells: tuple[int, int, int] = (8, 3, 2)) -> fs.Substructure:
    return fs.solid(fs.block((1.0, 0.1, 0.1), cells, "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0))


def assembled_elsewhere(K: sp.sparray, rounding: float) -> sp.csr_array:
    upper = sp.csr_array(sp.triu(K))
    upper.data *= 1 + rounding * np.random.default_rng(1).uniform(-1, 1, len(upper.data))
    return sp.csr_array(upper + sp.triu(upper, 1).T)


@pytest.mark.parametrize("digits", [8, 9, 10, 12])
def test_rigid_modes_of_a_file_with_few_digits_are_taken_and_told(digits: int) -> None:
    full = free_block()
    exact = fs.normal_modes(full, count=3).frequencies[6:]
    sub = fs.Substructure(written(full.M, digits), written(full.K, digits))
    for count in (3, 320 - 6):  # by Krylov-Schur, and by LAPACK
        with pytest.warns(fs.ConditionWarning, match=r"6 modes are taken as rigid-body motion, although K gives them ω up to .*"
                                                     r"rounding of K's entries \(about .*digits \(17\)"):
            modes = fs.normal_modes(sub, count=count)
        assert modes.rigid == 6 and modes.evidence == "certified"
        assert np.allclose(modes.frequencies[6:9], exact, rtol=1e4 * 10.0**-digits + 1e-9)


def test_single_precision_is_told_too() -> None:
    full = free_block((4, 2, 2))
    sub = fs.Substructure(full.M, full.K.astype(np.float32).astype(float))
    with pytest.warns(fs.ConditionWarning, match="6 modes are taken as rigid-body motion"):
        assert fs.normal_modes(sub, count=3).rigid == 6


@pytest.mark.parametrize("rounding", [1e-13, 1e-12, 1e-10])
def test_rigid_modes_of_another_programs_assembly_are_chosen_by_the_gap(rounding: float) -> None:
    full = free_block()
    sub = fs.Substructure(full.M, assembled_elsewhere(full.K, rounding))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        modes = fs.normal_modes(sub, count=3)
    assert modes.rigid == 6 and np.allclose(modes.frequencies[6:], fs.normal_modes(full, count=3).frequencies[6:], rtol=1e-7)
    assert rounding < 1e-12 or any("taken as rigid" in str(one.message) for one in told)


def test_two_rigid_modes_just_above_the_rounding_of_the_others() -> None:
    """As from Ansys: energies of 4.66e-15 and 4.88e-15 of the forces that cancel, the next mode 1e11 higher."""
    full = free_block((4, 2, 2))
    K, M = full.K.toarray(), full.M.toarray()
    shapes = fs.normal_modes(full, count=1).shapes[:, :6]
    for at, share in ((2, 4.66e-15), (4, 4.88e-15)):
        push = M @ shapes[:, at]
        K += share * float(abs(shapes[:, at]) @ (abs(K) @ abs(shapes[:, at]))) * np.outer(push, push)
    K = (K + K.T) / 2
    with pytest.warns(fs.ConditionWarning, match="6 modes are taken as rigid-body motion.*at most 5e-15"):
        modes = fs.normal_modes(fs.Substructure(M, K), count=3)
    assert modes.rigid == 6
    assert np.allclose(modes.frequencies[6:], fs.normal_modes(full, count=3).frequencies[6:], rtol=1e-9)


def test_modes_that_the_written_digits_do_not_resolve_are_told() -> None:
    full = free_block()
    with pytest.warns(fs.ConditionWarning, match="may change ω² of mode .* entries are known to about"):
        assert fs.normal_modes(fs.Substructure(full.M, written(full.K, 7)), count=8).rigid == 0
    with pytest.raises(fs.SingularMatrixError, match=r"negative eigenvalue, ω² = -.*: .*e-07 of .* K's entries \(about"):
        fs.normal_modes(fs.Substructure(full.M, written(full.K, 6)), count=8)


@pytest.mark.parametrize("share", [2e-14, 5e-14, 1e-12])
def test_a_soft_mount_just_above_rounding_is_elastic(share: float) -> None:
    """All six energies are 5e-15 of the forces that cancel, and more: no rigid motion beside them."""
    full = free_block((4, 2, 2))
    K = full.K + sp.diags_array(share * full.K.diagonal())
    modes = fs.normal_modes(fs.Substructure(full.M, K), count=8)
    Z = fs.normal_modes(full, count=1).shapes[:, :6]
    exact = la.eigvalsh(Z.T @ (share * full.K.diagonal()[:, None] * Z))
    assert modes.rigid == 0 and np.allclose(modes.eigenvalues[:6], exact, rtol=0.3)


@pytest.mark.parametrize("digits", [9, 12, 17])
def test_a_soft_mount_that_the_written_digits_hold_is_elastic(digits: int) -> None:
    full = free_block()
    spring = 1e3 * 10.0**-digits if digits < 17 else 1e-13  # relative: three digits of it are left, or all
    K = full.K + sp.diags_array(spring * full.K.diagonal())
    modes = fs.normal_modes(fs.Substructure(full.M, written(K, digits)), count=8)
    assert modes.rigid == 0
    x = np.zeros((full.size, 3))
    x[np.arange(full.size), np.arange(full.size) % 3] = 1.0
    heave = np.einsum("ij,ij->j", x, (spring * full.K.diagonal())[:, None] * x) / np.einsum("ij,ij->j", x, full.M @ x)
    for value in heave:
        assert np.abs(modes.eigenvalues[:6] / value - 1).min() < 0.05


@pytest.mark.parametrize("seed", [12, 36, 65, 73])
def test_middle_modes_of_a_chain_of_springs_of_nine_decades(seed: int) -> None:
    """LAPACK's modes from the middle have the rounding of the stiffest DOF in all entries: residuals of 3e-10 and more."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 150))
    springs, masses = 10.0 ** rng.uniform(0, 9, n), 10.0 ** rng.uniform(-1, 1, n)
    root = np.sqrt(springs)
    factor = (np.diag(root) - np.diag(root[1:], -1)) / np.sqrt(masses)
    sizes, _, _, scale, *_ = la.lapack.dgejsv(factor, joba=2, jobu=3, jobv=3)  # one-sided Jacobi: nearly all digits
    modes = fs.normal_modes(fs.chain(n, springs=springs.tolist(), masses=masses.tolist()), count=n)
    exact = np.sort(sizes * scale[0] / scale[1]) ** 2
    assert modes.evidence == "certified" and modes.residual.max() < 1e-12
    assert (np.abs(modes.eigenvalues / exact - 1) < 1e-9 + 20 * modes.rounding).all()
    assert np.abs(modes.shapes.T @ (masses[:, None] * modes.shapes) - np.eye(n)).max() < 1e-11


@pytest.mark.parametrize("kind", stiff_soft.KINDS)
def test_attacks_on_stiff_and_soft_find_nothing(kind: str) -> None:
    outcomes = [stiff_soft.attacked(kind, seed) for seed in range(10)]
    assert not [outcome for outcome in outcomes if outcome.startswith("wrong")]
    assert "certified" in outcomes


@pytest.mark.parametrize("seed", [141, 158, 193, 240])
def test_free_lumps_on_springs_of_unlike_softness_have_the_digits_that_are_stated(seed: int) -> None:
    """ω² were off by 6e-12 to 1e-6, 100 to 10,000 roundings: by those of a mode that is less soft, in a basis of both."""
    assert stiff_soft.attacked("free lumps", seed) == "certified"


def test_a_deferred_count_certifies_no_mode_that_may_be_rigid_motion() -> None:
    sub = fs.chain(3000)
    handle = ShiftInvert(sub.K, sub.M)
    modes = lowest_modes(handle, 3)
    modes = replace(modes, tally=replace(modes.tally, counted=None))  # as of a large model
    assert count_deferred(handle, modes).evidence == "certified"
    doubtful = replace(modes, rounding=np.array([5.0, 0.0, 0.0]))
    assert count_deferred(handle, doubtful).evidence == "not checked"
