"""Complex modes: complete, certified, and never more certain than they can be."""

from __future__ import annotations

import warnings
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from benchmarks.lattices import lattice, membrane
from femsub.algebra.petsc import has_cholmod
from femsub.checks import EQUAL, Tally
from femsub.modes import match
from femsub.modes.quadratic import correction, dense
from femsub.modes.quadratic.bars import mended
from femsub.modes.quadratic.complex_modes import with_bars
from femsub.modes.quadratic.region import Region
from femsub.modes.quadratic.search import SearchResult
from femsub.stability import port_root
from femsub.stability.border import dense_border

BELT = fs.Belt(slope=-0.2677)


def reference(pencil: fs.Pencil) -> np.ndarray:
    """All eigenvalues by QZ on the companion form, for a diagonal M and scaled so that it can be trusted."""
    n = pencil.size
    M, D, K = (part.toarray() if sp.issparse(part) else part for part in (pencil.M, pencil.D, pencil.K))
    scale = M.diagonal() ** -0.5
    D, K = D * np.outer(scale, scale), K * np.outer(scale, scale)
    gamma = np.sqrt(np.linalg.norm(K, 2))
    return gamma * la.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-K / gamma**2, -D / gamma]]))


def brake(n: int, seed: int = 0, friction: float = 0.3) -> fs.Pencil:
    """A brake-like pencil: stiff lattice, milligram masses, unsymmetric contact stiffness, strong dashpots on some DOF."""
    rng = np.random.default_rng(seed)
    sub = lattice(n // 20, 10, held=True, seed=seed)
    size = sub.size
    K = 1e6 * sub.K
    a, b = rng.choice(size, (2, size // 10), replace=False)
    N = sp.csr_array((np.full(len(a), friction * 1e6), (a, b)), shape=(size, size))
    D = 1e-6 * K + 1e-5 * sub.M * 10 + sp.diags_array(np.where(rng.random(size) < 0.02, 500.0, 0.0))
    return fs.Pencil(1e-5 * sub.M, D, K + N)


def agree(found: np.ndarray, exact: np.ndarray, bars: np.ndarray) -> None:
    """One to one, and within the error bars (the reference has its own rounding)."""
    assert len(found) == len(exact)
    at, to = match(exact, found)
    difference = np.abs(found[to] - exact[at])
    assert (difference <= 3 * bars[to] + 1e-8 * np.abs(exact[at])).all()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("symmetric", [True, False])
def test_dense_against_qz(seed: int, symmetric: bool) -> None:
    rng = np.random.default_rng(seed)
    A, D, N = rng.standard_normal((3, 12, 12))
    K = A @ A.T + np.eye(12) + (0 if symmetric else N)
    pencil = fs.Pencil(np.diag(rng.uniform(0.5, 2, 12)), D + D.T if symmetric else D, K)
    modes = fs.complex_modes(pencil)
    agree(modes.eigenvalues, reference(pencil), modes.error_bar)
    assert modes.evidence == "certified" and modes.backward_error.max() < 1e-13
    assert np.abs(pencil.residual(modes.eigenvalues, modes.shapes)).max() < 1e-10


def test_numbers_of_the_paper_s_figure_4() -> None:
    sub = fs.chain(10, belt=2)
    with pytest.warns(fs.PortWarning):
        models = [sub, fs.reduce(sub, fs.CraigBampton(4)), fs.reduce(sub, fs.CraigChang(4))]
    for model, growth in zip(models, (0.0212, 0.0185, 0.0212), strict=True):
        modes = fs.complex_modes(model, BELT)
        assert round(modes.eigenvalues.real.max(), 4) == growth == round(modes.growth, 4)
        assert modes.is_stable is False and len(modes) == 2 * model.size


def test_modes_above_the_cut_off_are_marked_and_decide_nothing() -> None:
    sub = fs.chain(10, belt=3, interface=(1, 3))
    rom = fs.reduce(sub, fs.CraigChang(3))
    slope = 0.5 * float(fs.critical_slope(sub, "belt"))  # the full model is stable there
    modes = fs.complex_modes(rom, fs.Belt(slope=slope))
    assert fs.complex_modes(sub, fs.Belt(slope=slope)).is_stable is True
    assert (modes.eigenvalues.real > modes.error_bar).any(), "the artefact is gone, choose another model"
    assert modes.is_stable is True
    assert np.array_equal(modes.above_cutoff, modes.frequencies > rom.cutoff)


@pytest.mark.parametrize("n", [30, 300])
def test_count_is_nearest_to_zero_with_pairs_complete(n: int) -> None:
    sub = fs.chain(n, belt=2)
    modes = fs.complex_modes(sub, BELT, count=7)
    assert len(modes) == 8  # a pair is never split
    assert np.allclose(modes.eigenvalues[::2], modes.eigenvalues[1::2].conj(), rtol=0, atol=0)
    assert (modes.eigenvalues[::2].imag > 0).all() and (np.diff(np.abs(modes.eigenvalues[::2])) > 0).all()
    exact = reference(sub.linearised(BELT))
    exact = exact[np.argsort(np.abs(exact))][:8]
    agree(modes.eigenvalues, exact, modes.error_bar)


def test_the_nearest_to_zero_are_told_apart_however_large_others_are() -> None:
    """λ² + dλ + 1: two overdamped motions differ by 1e-7; one of 1e7 beside them must not blur which is nearer to 0."""
    pencil = fs.Pencil(np.eye(3), np.diag([3.0, 3 * (1 + 1e-7), 1e7]), np.diag([1.0, 1.0, 1e10]))
    nearest = fs.complex_modes(pencil, count=1)
    d = 3 * (1 + 1e-7)
    assert nearest.eigenvalues == pytest.approx([-2 / (d + np.sqrt(d * d - 4))], rel=1e-9)
    assert np.array_equal(nearest.eigenvalues, fs.complex_modes(pencil).eigenvalues[:1])


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_brake_like_pencil_by_count_and_by_band(seed: int) -> None:
    pencil = brake(300, seed)
    exact = reference(pencil)
    modes = fs.complex_modes(pencil, count=30)
    nearest = exact[np.argsort(np.abs(exact))]
    agree(modes.eigenvalues, nearest[:len(modes)], modes.error_bar)
    assert modes.backward_error.max() < 1e-11
    hi = float(np.abs(nearest[40]))
    for band, re in (((0.0, hi), None), ((0.3 * hi, hi), None), ((0.0, hi), (-0.1 * hi, 0.1 * hi))):
        modes = fs.complex_modes(pencil, band=band, re=re)
        a, b = re or (-hi, hi)
        inside = (exact.imag >= band[0]) & (exact.imag <= band[1]) & (exact.real >= a) & (exact.real <= b)
        if band[0] == 0:  # QZ leaves real eigenvalues an imaginary part of rounding
            inside |= (np.abs(exact.imag) < 1e-9 * np.abs(exact)) & (exact.real >= a) & (exact.real <= b)
            exact_inside = exact[inside]
        else:
            exact_inside = exact[inside]
        agree(modes.eigenvalues, exact_inside, modes.error_bar)
        assert modes.searched == (a, b, *band) and modes.evidence == "certified"
        assert (np.diff(modes.eigenvalues.imag) >= 0).all()


def test_overdamped_modes_are_among_the_wanted_ones() -> None:
    pencil = brake(300)
    modes = fs.complex_modes(pencil, count=60)
    assert (modes.eigenvalues.imag == 0).any()
    np.testing.assert_allclose(modes.damping_percent[modes.eigenvalues.imag == 0], 100, rtol=1e-14)


@pytest.mark.slow
def test_a_missed_eigenvalue_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    from femsub.modes.quadratic import search, sparse

    def forgetful(module: ModuleType, name: str) -> None:
        original = getattr(module, name)

        def without_one(*arguments: object, **options: object) -> tuple[np.ndarray, np.ndarray]:
            values, shapes = original(*arguments, **options)
            keep = np.setdiff1d(np.arange(len(values)), [3])
            return values[keep], shapes[:, keep]

        monkeypatch.setattr(module, name, without_one)

    def not_for_lapack(patch: pytest.MonkeyPatch) -> None:
        patch.setattr("femsub.modes.quadratic.search.QUADRATIC", 200)

    sub = fs.chain(300, belt=2)
    exact = fs.complex_modes(sub, BELT, band=(0.0, 0.2), evidence=True)
    forgetful(search, "right_pairs")
    with monkeypatch.context() as patch:
        not_for_lapack(patch)
        searched = fs.complex_modes(sub, BELT, band=(0.0, 0.2), evidence=True)
    assert searched.evidence == exact.evidence == "certified"
    assert np.allclose(searched.eigenvalues, exact.eigenvalues, rtol=1e-9, atol=1e-12)
    forgetful(sparse, "quadratic_modes")
    whole = fs.complex_modes(sub, BELT, band=(0.0, 0.2))  # by LAPACK, which can do a model as small as this
    assert whole.evidence == "certified" and np.allclose(whole.eigenvalues, exact.eigenvalues, rtol=1e-9, atol=1e-12)
    not_for_lapack(monkeypatch)
    with pytest.raises(fs.MissedModesError, match=r"36 eigenvalues were found in .*Re λ < .* count gives 38"):
        fs.complex_modes(sub, BELT, band=(0.0, 0.2), evidence=True)


@pytest.mark.parametrize("n", [10, 300, 3000, pytest.param(20_000, marks=pytest.mark.slow)])
def test_stable_and_undamped_chains_are_never_called_unstable(n: int) -> None:
    stable = fs.chain(n, belt=2)
    border = float(fs.critical_slope(stable, band=(0.0, 30 / n)))
    modes = fs.complex_modes(stable, fs.Belt(slope=border / 2), count=20)
    assert modes.is_stable is not False and len(modes.unstable) == 0
    free = fs.complex_modes(fs.chain(n, damping=0.0, fixed=False), count=20)
    assert free.is_stable is not False and False not in free.stable
    assert free.rigid.sum() == 2 and np.array_equal(free.eigenvalues[:2], [0, 0])
    assert not fs.complex_modes(fs.chain(n, damping=0.0), count=20).rigid.any()


@pytest.mark.parametrize(("nx", "ny"), [(4, 5), (14, 12)])
@pytest.mark.parametrize("braked", [0, 1])
def test_rigid_body_eigenvalues_are_recognised(nx: int, ny: int, braked: int) -> None:
    plain = lattice(nx, ny)
    D = None
    if braked:
        dashpot = np.zeros(plain.size)
        dashpot[0] = 0.2  # brakes one combination of the three rigid motions
        D = sp.diags_array(dashpot)
    modes = fs.complex_modes(fs.Substructure(plain.M, plain.K, D), count=14)
    assert modes.rigid.sum() == 6 - braked
    assert np.array_equal(modes.eigenvalues[modes.rigid], np.zeros(6 - braked))
    assert modes.is_stable is not False
    assert (modes.backward_error < (1e-10 if has_cholmod() else 2e-9)).all()  # the factor of a floating part by MUMPS: 3e-10


def test_a_defective_pair_is_undecided() -> None:
    # flutter: two modes whose frequencies have just met under circulatory stiffness
    N = np.array([[0.0, 1.0], [-1.0, 0.0]])
    K = np.diag([1.0, 2.0]) + 0.5 * N
    modes = fs.complex_modes(fs.Pencil(np.eye(2), None, K))
    assert modes.is_stable is None
    assert modes.error_bar.max() > 1e-9
    apart = fs.complex_modes(fs.Pencil(np.eye(2), None, K + 0.1 * N))
    assert apart.is_stable is False and apart.error_bar.max() < 1e-13


@pytest.mark.parametrize("N", [[[1.0, 1], [0, 1]], [[1.0, 0.1], [-0.1, 1.2]], [[1e6, 1e5], [-1e5, 1.2e6]], [[2, 0.5], [-0.5, 3]]])
def test_rounding_that_splits_a_defective_pair_is_not_flutter(N: list) -> None:
    # rounding moves such a pair by sqrt(eps): further than the first order of the error bar says
    assert fs.complex_modes(fs.Pencil(np.eye(2), None, N)).is_stable is None


def test_a_pencil_without_mass() -> None:
    modes = fs.complex_modes(fs.Pencil(np.zeros((2, 2)), np.eye(2), np.diag([1.0, 3.0])))
    assert np.allclose(np.sort(modes.eigenvalues.real), [-3, -1], rtol=1e-14)


def test_a_defective_eigenvalue_without_a_neighbour_has_an_infinite_bar() -> None:
    pencil = fs.Pencil(np.eye(1), 2 * np.eye(1), np.eye(1))
    found = with_bars(pencil, np.array([-1.0 + 0j]), np.ones((1, 1)), np.ones((1, 1)))
    assert found.error_bar.tolist() == [np.inf] and found.is_stable is None


@pytest.mark.parametrize("n", [8, 250])
def test_repeated_semisimple_pairs_keep_small_error_bars(n: int) -> None:
    one = fs.chain(n, belt=1)
    two = fs.Substructure(*(sp.block_diag([part, part]) for part in (one.M, one.K, one.D)))
    modes = fs.complex_modes(two, count=12)
    assert modes.error_bar.max() < 1e-9
    single = fs.complex_modes(one, count=6).eigenvalues
    agree(modes.eigenvalues, np.concatenate([single, single]), modes.error_bar)


@pytest.mark.parametrize("sparse", [False, True])
def test_error_bars_hold_where_friction_is_a_million_times_the_stiffness(sparse: bool) -> None:
    K = np.diag(np.arange(1.0, 6.0))  # triangular, so that λ² + 0.1 λ + k = 0
    K[np.triu_indices(5, 1)] = 3.546, 2.0342e4, 9.1027e4, 13.449, 0.072, 67.877, 0.853, 3.2406e4, 24.203, 1.95367e5
    pencil = fs.Pencil(*((sp.csr_array(A) if sparse else A) for A in (np.eye(5), 0.1 * np.eye(5), K)))
    found = fs.complex_modes(pencil)
    exact = np.concatenate([np.roots([1.0, 0.1, k]) for k in range(1, 6)])
    assert (np.abs(found.eigenvalues[:, None] - exact).min(axis=1) <= found.error_bar).all()


def test_error_bars_hold_against_higher_precision(rng: np.random.Generator) -> None:
    # the paper's chain with unit damping ratios known in closed form: D = 2ζK^½ would be dense; Rayleigh is exact too
    n, alpha, beta = 40, 1e-3, 1e-2
    K = fs.chain(n).K.toarray()
    modes = fs.complex_modes(fs.Pencil(np.eye(n), alpha * np.eye(n) + beta * K, K))
    omega = fs.chain_frequencies(n)
    decay = (alpha + beta * omega**2) / 2
    exact = -decay + 1j * np.sqrt(omega**2 - decay**2)
    upper = modes.eigenvalues.imag > 0
    error = np.abs(np.sort_complex(modes.eigenvalues[upper])[::-1] - np.sort_complex(exact)[::-1])
    at, to = match(exact, modes.eigenvalues[upper])
    error = np.abs(modes.eigenvalues[upper][to] - exact[at])
    assert (error <= modes.error_bar[upper][to]).all()
    assert modes.error_bar.max() < 1e-11
    assert modes.is_stable is True


def test_singular_mass_goes_to_qz() -> None:
    mass = np.diag([1.0, 0.0, 1.0])
    K = np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 2]])
    modes = fs.complex_modes(fs.Substructure(mass, K))
    assert len(modes) == 4
    assert np.allclose(np.sort(modes.frequencies)[::2], np.sqrt([1.0, 2.0]), rtol=1e-10)


def test_a_band_high_up_goes_to_lapack_or_is_refused() -> None:
    # with a real shift all eigenvalues below the band are needed
    sub = fs.chain(250, belt=2)
    modes = fs.complex_modes(sub, BELT, band=(1.9, 2.1))
    exact = reference(sub.linearised(BELT))
    agree(modes.eigenvalues, exact[(exact.imag >= 1.9) & (exact.imag <= 2.1)], modes.error_bar)
    assert modes.evidence == "certified"
    with pytest.raises(ValueError, match="the disc around 0 that holds the band has about"):
        fs.complex_modes(fs.chain(5000, belt=2), BELT, band=(1.9, 2.1))


def test_refusals() -> None:
    sub = fs.chain(3000)
    with pytest.raises(ValueError, match="6000 eigenvalues: ask for count=20 or band"):
        fs.complex_modes(sub)
    for options, words in (({"count": 0}, "between 1 and 6000"), ({"count": 6001}, "between 1 and 6000"),
                           ({"count": 2.0}, "whole number"), ({"count": 2, "band": (0, 1)}, "count or band, not both"),
                           ({"re": (0, 1)}, "together with band"), ({"band": (1, 0)}, "0 <= lo < hi"),
                           ({"band": (0, 1), "re": (1, 0)}, "re must be .* lo < hi")):
        with pytest.raises((ValueError, TypeError), match=words):
            fs.complex_modes(sub, **options)
    with pytest.raises(ValueError, match="has no ports"):
        fs.complex_modes(fs.Pencil(np.eye(2), None, np.eye(2)), BELT)
    with pytest.raises(ValueError, match="unknown port 'bolt'"):
        fs.complex_modes(sub, fs.Belt("bolt", slope=-0.1), count=2)
    with pytest.raises(TypeError, match=r"Substructure \(or a Pencil\)"):
        fs.complex_modes(np.eye(3))


def test_a_low_eigenvalue_of_a_stiff_model_is_not_taken_for_rigid_motion() -> None:
    sub = fs.chain(6, springs=np.where(np.arange(6) % 2, 1e12, 1.0))
    modes = fs.complex_modes(sub)
    assert not modes.rigid.any()
    pairs = fs.complex_modes(fs.chain(3, masses=[2.0, 2.0, 2.0])).frequencies  # each stiff spring joins two masses
    assert np.allclose(np.sort(modes.frequencies)[:6], np.sort(pairs), atol=3 * modes.error_bar.max())
    assert np.abs(np.sort(modes.frequencies)[:6] / np.sort(pairs) - 1).max() < 0.1


def test_one_without_its_conjugate_beside_a_pair_has_its_own_certificate() -> None:
    """Only where each is followed by its conjugate, value and shape, one of the two stands for both."""
    sub = fs.chain(20, belt=2)
    pencil = sub.linearised(fs.Belt(slope=-0.05))
    values, X, Y = dense.solve(pencil.dense())
    upper = np.flatnonzero(values.imag > 0)[:2]
    rows = [values[upper[0]], values[upper[0]].conj(), values[upper[1]].conj()]
    x, y = (np.stack([part[:, upper[0]], part[:, upper[0]].conj(), part[:, upper[1]].conj()], axis=1) for part in (X, Y))
    found = with_bars(pencil, np.array(rows), x, y)
    assert len(found.backward_error) == len(found.error_bar) == len(found.condition) == 3 and found.backward_error.max() < 1e-13
    spoilt = x[:, :2].copy()
    spoilt[3, 1] *= 1.1  # the second of a pair
    assert with_bars(pencil, np.array(rows[:2]), spoilt, y[:, :2]).backward_error[1] > 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("ask", [{"band": (0.0, 0.05)}, {"count": 16}])
def test_a_large_dense_model_is_solved_for_what_is_asked(ask: dict, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its contact fills D, but is known to be of rank one: neither count needs more than a sparse model's does."""
    sub = fs.damped(fs.chain(900, belt=7, interface=range(1, 900, 2)), rayleigh=(1e-3, 1e-2))
    rom = fs.reduce(sub, fs.CraigBampton(modes=10))
    assert rom.size == 460
    belt = fs.Belt(slope=-0.02)
    every = fs.complex_modes(rom, belt).eigenvalues
    assert len(every) == 2 * rom.size

    def all_of_them(pencil: fs.Pencil) -> None:
        raise AssertionError("LAPACK was asked for all eigenvalues")

    monkeypatch.setattr("femsub.modes.quadratic.dense.solve", all_of_them)
    found = fs.complex_modes(rom, belt, **ask)
    near = every[(every.imag >= 0) & (every.imag <= 0.05) & (np.abs(every.real) <= 0.05)] if "band" in ask else \
        every[np.argsort(np.abs(every))][:16]
    assert found.evidence == "certified" and len(found) == len(near)
    distance = np.abs(found.eigenvalues[:, None] - near).min(axis=1)
    assert (distance <= found.error_bar + 1e-12).all()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("ask", [{"band": (0.0, 0.5)}, {"count": 12}])
def test_belts_on_many_dof_are_counted_whatever_rounding_they_leave_in_d(ask: dict) -> None:
    """Each belt is of rank one, but D = αM + βK + Σ cwwᵀ less αM + βK is rounding on each of its DOF."""
    plain = lattice(40, 5, held=True)
    rows, rng = np.arange(plain.size - 120, plain.size), np.random.default_rng(2)
    ports = {name: np.zeros(plain.size) for name in ("one", "two")}
    for w in ports.values():
        w[rows] = rng.uniform(0.005, 0.02, len(rows))
    sub = fs.damped(fs.Substructure(plain.M, plain.K, ports=ports), rayleigh=(1e-3, 1e-2))
    belts = [fs.Belt("one", slope=-1e-5), fs.Belt("two", slope=-2e-5), fs.Belt("one", slope=0.0)]
    found = fs.complex_modes(sub, belts, **ask)
    assert found.evidence == "certified"
    every = dense.solve(sub.linearised(belts).dense())[0]
    if "count" in ask:
        assert found.counted and np.count_nonzero(np.abs(every) < found.counted[0]) == found.counted[1]
    else:
        assert len(found) == np.count_nonzero((every.imag >= 0) & (every.imag <= 0.5) & (np.abs(every.real) <= 0.5))


@pytest.mark.slow
def test_sweep_and_border_of_a_large_dense_model_are_those_of_the_sparse_one() -> None:
    sub = fs.damped(fs.chain(700, belt=501, interface=range(1, 700, 2)), rayleigh=(1e-5, 1e-3))
    rom, band = fs.reduce(sub, fs.CraigBampton(modes=5)), (0.0, 0.05)
    assert rom.size > 300
    border, full = fs.critical_slope(rom, band=band), fs.critical_slope(sub, band=band)
    exact = dense_border(rom.pencil, rom.port("belt").reshape(-1, 1), band, "auto")  # of all modes, by LAPACK
    assert border.value == pytest.approx(exact.c, rel=1e-8) and border.omega == pytest.approx(exact.omega, rel=1e-6)
    assert border.value == pytest.approx(full.value, rel=1e-3)
    small = fs.sweep(rom, fs.Belt(slope=0.0), "slope", [0.5 * border.value, 1.1 * border.value], band=band).growth
    assert small[0] < 0 < small[1]


def test_another_search_takes_the_place_of_one_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """Contacts, region and bars neither know nor ask how the eigenpairs were found."""
    sub = fs.chain(150, belt=2)
    asks: list[dict[str, Any]] = [{"count": 9}, {"band": (0.0, 0.3)}, {"band": (0.1, 0.3), "re": (-1e-3, 1e-3)}]
    ours = [fs.complex_modes(sub, BELT, **ask) for ask in asks]
    asked = []

    def by_scipy(pencil: fs.Pencil, region: Region, evidence: bool | None, projection: object) -> SearchResult:
        asked.append(region)
        P, n = pencil.dense(), pencil.size
        companion = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(P.M, P.K), -np.linalg.solve(P.M, P.D)]])
        values, X = np.linalg.eig(companion)
        return SearchResult(values, X[:n] / np.linalg.norm(X[:n], axis=0), X[:n].conj(), values, Tally(0))

    monkeypatch.setattr("femsub.modes.quadratic.complex_modes.search", by_scipy)
    for ask, own in zip(asks, ours, strict=True):
        found = fs.complex_modes(sub, BELT, **ask)
        assert len(found) == len(own) > 0 and found.searched == own.searched
        at, to = match(own.eigenvalues, found.eigenvalues)
        assert (np.abs(found.eigenvalues[to] - own.eigenvalues[at]) <= found.error_bar[to] + own.error_bar[at]).all()
        assert own.evidence == "certified" and found.evidence == "not checked"
    assert [region.count for region in asked] == [9, None, None] and asked[2].box == (-1e-3, 1e-3, 0.1, 0.3)


@pytest.mark.parametrize("glides", [False, True])
def test_a_shape_is_as_good_at_a_small_eigenvalue(glides: bool) -> None:
    """K = [[1, 0], [3, e]] has λ = ±√-e, though its symmetric part has no small eigenvalue; a third DOF may be free."""
    worst = []
    for e in 10.0 ** -np.arange(6.0, 16.0):
        K, M = np.zeros((3, 3)), np.diag([1.0, 1.0, 2.0])
        K[:2, :2] = [[1, 0], [3, e]]
        D = np.diag([0.0, 0.0, 0.1]) if glides else np.zeros((3, 3))
        D[1, 2] = D[2, 1] = 0.02 * glides
        part = slice(None if glides else 2)
        modes = fs.complex_modes(fs.Pencil(M[part, part], D[part, part], K[part, part]))
        worst.append(modes.backward_error.max())
        if not glides:
            assert np.count_nonzero(np.abs(np.abs(modes.eigenvalues) / np.sqrt(e) - 1) < 0.5) == 2
    assert max(worst) < 1e-12


@pytest.mark.parametrize(("M", "D", "K"), [
    ([[2.0]], [[1.5e9]], [[19.6]]), ([[9e4]], [[-1.1e8]], [[-1.2e-9]]),
    (np.eye(2), np.diag([4.0, 5.0]) * 1e16, [[2.5, -1.5], [-1.5, 1.7]])])
def test_a_slow_decay_beside_a_heavy_damping_is_no_rigid_motion(M: list, D: list, K: list) -> None:
    """λ = -k/d was 0 with a bar of 0, since rounding of d/m hides it; K is regular."""
    modes = fs.complex_modes(fs.Pencil(M, D, K))
    slow = np.sort_complex(la.eigvals(-np.asarray(K), np.asarray(D)))
    at = np.argsort(np.abs(modes.eigenvalues))[:len(slow)]
    near, bar = np.sort_complex(modes.eigenvalues[at]), modes.error_bar[at]
    assert not modes.rigid.any() and (np.abs(near - slow) <= bar.max() + 1e-12 * np.abs(slow)).all() and (bar > 0).all()


def test_a_slow_decay_is_found_where_rounding_has_put_another_number(rng: np.random.Generator) -> None:
    """LAPACK's λ was neither 0 nor near -k/d: a backward error of 0.9, on some processors."""
    for _ in range(30):
        Q = np.linalg.qr(rng.standard_normal((2, 2)))[0]
        K = rng.standard_normal((2, 2))
        pencil = fs.Pencil(np.eye(2), Q @ np.diag([4.0, 5.0]) @ Q.T * 1e16, K @ K.T + 0.1 * np.eye(2))
        modes = fs.complex_modes(pencil)
        slow = np.sort(la.eigvals(-pencil.K, pencil.D).real)
        assert np.sort(modes.eigenvalues.real)[2:] == pytest.approx(slow, rel=1e-8)


def test_rigid_motion_still_has_exact_zeros() -> None:
    modes = fs.complex_modes(fs.Pencil(np.eye(3), None, np.diff(np.eye(3), axis=0).T @ np.diff(np.eye(3), axis=0)))
    assert modes.rigid.tolist().count(True) == 2 and (modes.error_bar[modes.rigid] == 0).all()


def test_what_solves_nothing_has_no_bar() -> None:
    """To first order the error of an eigenpair that is none is no larger than that of a good one."""
    sub = fs.chain(4)
    exact = fs.complex_modes(sub)
    X = exact.shapes.copy()
    X[:, 0] = [1.0, -2.0, 1.0, 3.0]
    found = with_bars(sub.pencil.dense(), exact.eigenvalues, X, X.conj())
    assert np.isinf(found.error_bar[0]) and np.isfinite(found.error_bar[2:]).all()


@pytest.mark.parametrize(("kind", "seeds"), [("scales", (45, 68, 511, 570)), ("units", (113, 426, 600236)),
                                             ("friction", (38, 471, 507)),
                                             ("nearly singular", (55, 304, 501)), ("clusters", (0,))])
def test_error_bars_hold_where_matrices_are_many_orders_apart(kind: str, seeds: tuple[int, ...]) -> None:
    from benchmarks.attacks.eigenvalues import bars

    assert not [found for seed in seeds if (found := bars(kind, seed)).startswith("wrong")]


@pytest.mark.sampled(2)
@pytest.mark.filterwarnings("ignore:a complex mode has a backward error", "ignore:.* have an elastic energy within the rounding")
@pytest.mark.parametrize("digits", [9, 12])
def test_rigid_motion_of_a_k_with_few_digits_is_not_called_unstable(digits: int) -> None:
    """Rounding makes K indefinite, of a free body that nothing drives: its rigid motion is at 0, or known to no digit."""
    full = fs.solid(fs.block((1.0, 0.1, 0.1), (8, 3, 2), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0))
    K = full.K.copy()
    K.data = np.array([float(f"{value:.{digits - 1}e}") for value in K.data])
    pencil = fs.Pencil(full.M, 1e-6 * K, K)
    with pytest.warns(fs.ConditionWarning, match="6 modes are taken as rigid-body motion, although K gives them"):
        modes = fs.complex_modes(pencil, count=14)
    assert modes.is_stable is not False and not len(modes.unstable)
    elastic = np.abs(modes.eigenvalues) > 1000
    assert elastic.sum() == 2 and all(vote is True for vote in np.array(modes.stable, dtype=object)[elastic])


# heavy dashpots: Newton steps on single eigenpairs -----------------------------------------------------------------------

def braked_chain(n: int, at: tuple[int, ...], size: float = 5.7e5) -> fs.Pencil:
    """A chain of unit masses and springs, fixed at the left, with dashpots that nearly hold some masses."""
    sub = fs.chain(n, belt=2, damping=0.1)
    D = sp.lil_array(sub.D)
    for mass in at:
        D[mass, mass] += size
    return fs.Pencil(sub.M, sp.csr_array(D), sub.K)


def root_near(pencil: fs.Pencil, value: complex) -> complex:
    """The root of det P next to a value, by Newton on the ratios of a tridiagonal matrix' leading minors: good entry by entry."""
    M, D, K = (part.toarray().diagonal() for part in (pencil.M, pencil.D, pencil.K))
    beside = np.append(0.0, np.diag(pencil.K.toarray(), 1))
    s = complex(value)
    for _ in range(40):
        ratio, slope, whole = 1.0 + 0j, 0j, 0j
        for m, d, k, c in zip(M, D, K, beside, strict=True):
            ratio, slope = s * s * m + s * d + k - c * c / ratio, 2 * s * m + d + c * c * slope / ratio**2
            if ratio == 0:
                return s
            whole += slope / ratio  # (log det P)'
        s -= 1 / whole
    return s


@pytest.mark.parametrize("ask", [{"count": 14}, {"band": (0.0, 0.1)}])
def test_heavy_dashpots_leave_small_bars_that_hold(ask: dict) -> None:
    """The search is accurate beside ‖D‖ only. λ was off by 4e-4 of itself, and its bar was a fifth of it."""
    pencil = braked_chain(120, (60,))
    found = fs.complex_modes(pencil, **ask)
    exact = np.array([root_near(pencil, value) for value in found.eigenvalues])
    assert (np.abs(found.eigenvalues - exact) <= found.error_bar + 1e-10 * np.abs(exact)).all()
    assert (found.error_bar <= 1e-8 * np.abs(exact)).all() and found.backward_error.max() < 1e-12
    assert len(np.unique(np.round(exact * 1e9))) == len(exact)
    assert found.evidence == "certified"


def test_heavy_dashpots_and_an_unsymmetric_stiffness() -> None:
    plain = braked_chain(120, (60,))
    K = sp.lil_array(plain.K)
    K[30, 31] *= 1.2
    K[31, 30] *= 0.8
    pencil = fs.Pencil(plain.M, plain.D, sp.csr_array(K))
    found = fs.complex_modes(pencil, band=(0.0, 0.1))
    assert (found.error_bar <= 1e-8 * np.abs(found.eigenvalues)).all()
    again = dense_by_elimination(pencil, 60)
    assert (np.abs(found.eigenvalues[:, None] - again).min(axis=1) <= found.error_bar + 1e-5 * np.abs(found.eigenvalues)).all()


def dense_by_elimination(pencil: fs.Pencil, held: int) -> np.ndarray:
    """Eigenvalues of the chain with one mass held, which a heavy dashpot nearly does, and the slow λ = -k/d of that mass."""
    rest = np.setdiff1d(np.arange(pencil.size), [held])
    M, D, K = (part.toarray() for part in (pencil.M, pencil.D, pencil.K))
    values = dense.solve(fs.Pencil(*(part[np.ix_(rest, rest)] for part in (M, D, K))))[0]
    stiffness = K[held, held] - K[held, rest] @ np.linalg.solve(K[np.ix_(rest, rest)], K[rest, held])
    return np.append(values, -stiffness / D[held, held])


def test_newton_steps_merge_no_two_eigenvalues() -> None:
    """Two chains with a millionth between them: pairs of λ that are nearly equal, mended one by one, stay two."""
    one, other = braked_chain(70, (35,)), braked_chain(70, (35,))
    M, D = (sp.csr_array(sp.block_diag((getattr(one, key), getattr(other, key)))) for key in "MD")
    pencil = fs.Pencil(M, D, sp.csr_array(sp.block_diag((one.K, other.K * (1 + 1e-6)))))
    found = fs.complex_modes(pencil, band=(0.0, 0.2))
    assert found.evidence == "certified" and (found.error_bar <= 1e-8 * np.abs(found.eigenvalues)).all()
    alone = fs.Pencil(other.M, other.D, other.K * (1 + 1e-6))
    for part in (one, alone):  # each λ of one chain is listed once
        mine = [value for value in found.eigenvalues if abs(root_near(part, value) - value) <= 1e-8 * abs(value)]
        assert len(mine) == len(fs.complex_modes(part, band=(0.0, 0.2))) == len(found) / 2


def test_newton_steps_end_where_only_rounding_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """K of a beam of 400 elements changes λ by some 1e-8 from rounding to rounding, so that no step is ever as small as EPS."""
    sub = fs.beam(1.0, 400, E=2.1e11, I=1e-9, rho=7850.0, A=1e-4, supports={"left": "clamped"})
    modes, made, factor = fs.complex_modes(sub, count=4), [], correction.ComplexFactor
    monkeypatch.setattr(correction, "ComplexFactor", lambda A: (made.append(1), factor(A))[1])
    for k in range(2):
        made.clear()
        value = modes.eigenvalues[k] * (1 + 1e-5)
        X = modes.shapes[:, [k]] * (1 + 1e-6 * np.random.default_rng(k).standard_normal((sub.size, 1)))
        near, _, _, done, _ = mended(sub.pencil, np.array([value]), X, np.zeros_like(X))
        assert done[0] and len(made) < 7  # not all that are allowed
        assert abs(near[0] - modes.eigenvalues[k]) <= 1e-6 * abs(value)


@pytest.mark.parametrize("far", [1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8])
def test_newton_makes_no_step_that_would_be_rounding(far: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A step below EQUAL |λ| is the last one: no factor of P(λ) is made for another. How many there are rounding decides."""
    pencil = braked_chain(70, (35,))
    modes, at, pencil_at = fs.complex_modes(pencil, count=4), [], fs.Pencil.at
    monkeypatch.setattr(fs.Pencil, "at", lambda self, value: (at.append(value), pencil_at(self, value))[1])
    value = modes.eigenvalues[0] * (1 + far)
    X = modes.shapes[:, [0]] + far * np.random.default_rng(0).standard_normal((pencil.size, 1)) * abs(modes.shapes[:, 0]).max()
    near, _, _, done, _ = mended(pencil, np.array([value]), X, np.zeros_like(X))
    steps = abs(np.diff(list(dict.fromkeys(at))))  # at λ itself the error bar has a factor, too
    assert done[0] and len(at) >= 2 and at[0] == value
    assert (steps > EQUAL * abs(value)).all()
    assert abs(near[0] - modes.eigenvalues[0]) <= 1e-12 * abs(value)


@pytest.mark.parametrize("size", [1e-90, 1.0, 1e90])
def test_a_step_ends_at_the_root_of_the_quotient(size: float) -> None:
    """yᴴP(s)x = 0 at s = λ - step, whatever the units; without mass and damping there is no root, and no exception."""
    for seed in range(50):
        rng = np.random.default_rng(seed)
        pencil = fs.Pencil(*(size * rng.standard_normal((4, 4)) for _ in "MDK"))
        x, y = rng.standard_normal((2, 4)) + 1j * rng.standard_normal((2, 4))
        value = complex(*rng.standard_normal(2))
        root = value - correction.step(pencil, value, x, y)
        m, d, k = (y.conj() @ A @ x for A in (pencil.M, pencil.D, pencil.K))
        assert abs(root**2 * m + root * d + k) <= 1e-12 * (abs(root**2 * m) + abs(root * d) + abs(k))
        assert abs(root - value) <= abs(-d / m - root - value) * (1 + 1e-9)  # the other root is not nearer
    still = fs.Pencil(np.diag([1.0, 0.0]), None, np.eye(2) * size)
    assert not np.isfinite(correction.step(still, 0.0, np.array([0.0, 1.0]), np.array([0.0, 1.0])))


def test_a_pair_converges_beside_others_that_are_known() -> None:
    """Two eigenvalues 1e-7 apart, both from starts at the first: the second comes to its own if it is kept from the first."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        B = rng.standard_normal((6, 6))
        one = fs.Pencil(np.eye(6), 0.05 * np.diag(rng.random(6)), B @ B.T + np.eye(6) + 0.1 * rng.standard_normal((6, 6)))
        near = 1 + 1e-7 * rng.uniform(1.0, 3.0)
        pencil = fs.Pencil(*(la.block_diag(getattr(one, name), factor * getattr(one, name))
                             for name, factor in zip("MDK", (1.0, near**0.5, near), strict=True)))
        exact, X, Y = dense.solve(one)
        k = int(exact.imag.argmax())
        start = np.append(X[:, k], 0.3 * X[:, k]), np.append(Y[:, k], 0.3 * Y[:, k])
        found = correction.converged(pencil, exact[k] * (1 + 1e-8), *(part / np.linalg.norm(part) for part in start))
        assert found is not None
        others = np.array([found[0]]), found[1][:, None], found[2][:, None]
        again = correction.converged(pencil, exact[k] * (1 + 1e-8), *(part / np.linalg.norm(part) for part in start), others)
        both = np.sort_complex(exact[k] * np.array([1.0, near**0.5]))
        assert again is not None and abs(np.sort_complex([found[0], again[0]]) - both).max() < 1e-12 * abs(both[0])


# dense models in a band: LAPACK, where PEP would not be much faster ------------------------------------------------------

def damped_everywhere(n: int) -> fs.Pencil:
    """A dense model with a full M and K, and dashpots on half of its DOF."""
    rng = np.random.default_rng(3)
    turn = np.linalg.qr(rng.standard_normal((n, n)))[0]
    D = np.diag(np.where(np.arange(n) % 2, 1e-3 * rng.uniform(0.5, 2.0, n), 0.0))
    K = (turn * np.linspace(0.1, 5.0, n) ** 2) @ turn.T
    return fs.Pencil(np.eye(n), D, (K + K.T) / 2)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("share", [0.05, 0.5, 0.9])
def test_a_dense_model_in_a_band_takes_one_decomposition_at_most(share: float, monkeypatch: pytest.MonkeyPatch) -> None:
    pencil, asked = damped_everywhere(320), []

    def solved(pencil: fs.Pencil) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        asked.append(pencil.size)
        return every(pencil)

    def by_pep(*_: object, **__: object) -> None:
        raise AssertionError("PEP was asked")

    every = dense.solve
    monkeypatch.setattr("femsub.modes.quadratic.dense.solve", solved)
    monkeypatch.setattr("femsub.modes.quadratic.sparse.quadratic_modes", by_pep)
    found = fs.complex_modes(pencil, band=(0.0, 5.0 * share))
    assert asked == ([] if share < 0.1 else [320]) and found.evidence == "certified"  # few modes are for a projection
    assert abs(len(found) - 320 * (5 * share - 0.1) / 4.9) <= 1


@pytest.mark.parametrize("seed", range(2))
def test_a_sparse_model_is_certified_as_a_dense_one_is(seed: int) -> None:
    """A few dashpots far stronger than all else."""
    rng, base = np.random.default_rng(seed), membrane(12)
    strong = np.where(rng.random(base.size) < 0.05, 10 ** rng.uniform(4, 6, base.size), 0.0)
    pencil = fs.Pencil(base.M, sp.csr_array(sp.diags_array(strong)), base.K)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.FemsubWarning)  # backward errors beside such a D
        found, dense_one = (fs.complex_modes(each, band=(0.0, 1.0)) for each in (pencil, pencil.dense()))
    assert found.evidence == dense_one.evidence == "certified" and len(found) == len(dense_one)


@pytest.mark.slow
@pytest.mark.parametrize(("share", "narrow"), [(0.02, True), (0.5, False)])
def test_the_border_of_a_dense_model_takes_its_modes_once_unless_the_band_is_narrow(
        share: float, narrow: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    pencil = damped_everywhere(320)
    w = np.random.default_rng(5).standard_normal(320)
    sub = fs.Substructure(pencil.M, pencil.K, pencil.D + 1e-3 * np.eye(320), ports={"belt": w / np.linalg.norm(w)})
    took = []
    for name in ("sparse_border", "dense_border"):
        whole = getattr(port_root, name)
        monkeypatch.setattr(port_root, name, lambda *args, whole=whole, name=name: (took.append(name), whole(*args))[1])
    found = fs.critical_slope(sub, band=(0.0, 5.0 * share))
    assert took == ["sparse_border" if narrow else "dense_border"] and found.value < 0
