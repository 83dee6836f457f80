"""The count by projection on undamped modes: right whenever it is given, for damping and friction of any rank, and certified."""

from __future__ import annotations

import os
import signal
import tracemalloc
from copy import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from brakescene import brake_models
from scipy.io import loadmat

import femsub as fs
from benchmarks.lattices import lattice
from femsub.algebra import factors_made, fork_pays, petsc
from femsub.modes.quadratic import dense, projected_count, projected_pairs, sparse
from femsub.modes.quadratic.energy_basis import Coupling
from femsub.modes.quadratic.projected_count import Projection, Varied
from femsub.modes.quadratic.projected_pairs import left_vectors, right_pairs
from femsub.modes.quadratic.region import Contour, Count
from femsub.modes.quadratic.search import projection_over

FEW = (80, 130)  # DOF of models of which LAPACK takes all eigenvalues again and again
DAMPING = ("parts", "dashpots", "gyroscopic", "any", "parts and gyroscopic", "none")


def random_pencil(seed: int, sizes: tuple[int, int] = (110, 200)) -> fs.Pencil:
    """A net of springs, 110 to 200 DOF, of unlike stiffness and mass; damped somehow, half of them with circulatory forces."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(*sizes))

    def somewhere(count: int, size: float) -> sp.csr_array:
        i, j = rng.integers(0, n, (2, count))
        return sp.csr_array((size * rng.standard_normal(count), (i, j)), shape=(n, n))

    k = 10 ** rng.uniform(-1, 1, n + 1)
    K = sp.diags_array([k[:-1] + k[1:], -k[1:-1], -k[1:-1]], offsets=[0, 1, -1])
    ends = rng.integers(0, n, (n, 2))
    ends = ends[ends[:, 0] != ends[:, 1]]
    rows = np.arange(len(ends))
    B = sp.csr_array((np.ones(len(ends)), (rows, ends[:, 0])), shape=(len(ends), n))
    B = B - sp.csr_array((np.ones(len(ends)), (rows, ends[:, 1])), shape=(len(ends), n))
    K = sp.csr_array(K + B.T @ sp.diags_array(10 ** rng.uniform(-3, 0, len(ends))) @ B)
    M = sp.csr_array(sp.diags_array(10 ** rng.uniform(-0.5, 0.5, n)))
    size, kind, D = 10 ** rng.uniform(-3, 0.5), DAMPING[seed % len(DAMPING)], sp.csr_array((n, n))
    if "parts" in kind:
        D = D + 0.1 * size * B.T @ sp.diags_array(rng.random(len(ends))) @ B
    if kind == "dashpots":
        D = D + sp.diags_array(np.where(rng.random(n) < 0.1, size * rng.standard_normal(n), 0.0))
    if "gyroscopic" in kind:
        G = somewhere(n // 4, 0.1 * size)
        D = D + G - G.T
    if kind == "any":
        D = D + somewhere(n, 0.03 * size)
    if seed // len(DAMPING) % 2:
        N = somewhere(n // 6, 10 ** rng.uniform(-2, 0.7))
        K = K + (N if rng.random() < 0.5 else N - N.T)
    return fs.Pencil(M, sp.csr_array(D), sp.csr_array(K))


def by_lapack(pencil: fs.Pencil) -> np.ndarray:
    """All eigenvalues, without the vectors, which take three times as long."""
    form = dense.modal_form(pencil.dense())
    assert form is not None
    return dense.eigenvalues(form)


def count(pencil: fs.Pencil, contour: Contour) -> Count | None:
    """Inside this contour, or None."""
    try:
        return Projection(pencil, contour).on(lambda *_: contour)
    except (fs.SingularMatrixError, fs.NotConvergedError, fs.MissedModesError):
        return None


@pytest.mark.sampled(7)  # each kind of damping
@pytest.mark.parametrize("seed", range(36))
def test_a_count_is_never_wrong(seed: int) -> None:
    """Where it is given, it is LAPACK's; and it is given for most. In 300 models of the same kind none was wrong."""
    pencil, rng = random_pencil(seed, FEW), np.random.default_rng(seed)
    values = by_lapack(pencil)
    sizes = np.sort(np.abs(values))
    hi = float(sizes[rng.integers(8, 50)] * rng.uniform(0.9, 1.1))
    for contour in (Contour(hi), Contour(sides=(-hi, hi, hi)), Contour(sides=(-0.3 * hi, 0.1 * hi, hi))):
        found = count(pencil, contour)
        assert found is None or found.number == np.count_nonzero(contour.encloses(values))
        if "gyroscopic" not in DAMPING[seed % len(DAMPING)] and seed // len(DAMPING) % 2 == 0:
            assert found is not None and found.margin < 1


@pytest.mark.sampled(13)
@pytest.mark.parametrize("seed", range(36))
def test_one_projection_counts_for_all_values_of_a_parameter(seed: int) -> None:
    """P(s) + Σ θ_q s^q T_q with stiffness, damping, mass and a contact that change: where a count is given, it is LAPACK's."""
    pencil, rng = random_pencil(seed, FEW), np.random.default_rng(seed)
    n, values = pencil.size, by_lapack(pencil)
    hi = float(np.sort(np.abs(values))[rng.integers(8, 40)] * rng.uniform(0.9, 1.1))
    contour = Contour(sides=(-hi, hi, hi))
    i, j = rng.integers(0, n, (2, 4))
    contact = sp.csr_array((rng.standard_normal(4) * pencil.K.diagonal().mean(), (i, j)), shape=(n, n))
    anywhere = sp.csr_array((rng.standard_normal(n), (rng.permutation(n), rng.permutation(n))), shape=(n, n))
    every = (contact, 0), (0.02 * anywhere * pencil.K.diagonal().min(), 0), (0.1 / hi * contact, 1), (0.1 * pencil.M, 2), \
        (0.02 / hi * pencil.K, 1)
    changes = [Varied(sp.csr_array(T), power, 1.0) for T, power in every if rng.random() < 0.5]
    try:
        projection = Projection(pencil, contour, changes=changes)
    except (fs.SingularMatrixError, fs.NotConvergedError, fs.MissedModesError):
        return
    for theta in (np.zeros(len(changes)), *rng.uniform(-1, 1, (3, len(changes)))):
        parts = [pencil.K, pencil.D, pencil.M]
        for share, change in zip(theta.tolist(), changes, strict=True):
            parts[change.power] = parts[change.power] + share * change.matrix
        values = by_lapack(fs.Pencil(*parts[::-1]))
        projection = projection.changed(theta.tolist())
        found = projection.on(lambda *_: contour)
        assert found is None or found.number == np.count_nonzero(contour.encloses(values))
        if found is not None and projection.counted is not None and not any(change.power == 2 for change in changes):
            again = count(fs.Pencil(*parts[::-1]), contour)
            assert again is None or again.number == found.number


def test_few_columns_that_change_act_inside_the_basis_alone() -> None:
    """A⁻¹T joins V, so that T has no image outside: the margin does not depend on θ T where VᵀPV does not."""
    pencil = random_pencil(6)
    T = sp.csr_array(([5.0, -5.0], ([3, 70], [70, 3])), shape=(pencil.size, pencil.size))
    projection = Projection(pencil, Contour(0.5), changes=[Varied(T, 0, 2.0)])
    acting = projection.changed([1.5])
    assert acting.terms[-1].spanned and acting.coercivity((-0.5, 0.5), 0.5) == projection.coercivity((-0.5, 0.5), 0.5)
    x = np.random.default_rng(1).standard_normal((acting.size, 3))
    image = projection.factor.solve(acting.image(len(acting.terms) - 1, x))
    outside = image - acting.V @ (acting.V.T @ (acting.product(image)))
    assert np.linalg.norm(outside) < 1e-11 * np.linalg.norm(image)
    assert acting.size == projection.size and acting.terms[-1].weights == (1.5, 0.0, 0.0)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.sampled(4)
def test_each_sign_of_damping_has_its_own_bound(seed: int) -> None:
    """Re xᴴP(s)x ≥ c xᴴAx outside the basis all over an uneven rectangle, and as many eigenvalues as by LAPACK."""
    pencil = random_pencil(seed)
    hi, rng = 0.5, np.random.default_rng(seed)
    a, b = (float(-hi * 10 ** rng.uniform(-2, 0)), float(hi * 10 ** rng.uniform(-2, 0)))
    projection = Projection(pencil, Contour(sides=(a, b, hi)))
    A = projection.A.formed().toarray()
    V = np.hstack([projection.V, projection.free])
    outside = la.null_space((A @ V).T)
    held = la.cholesky(outside.T @ A @ outside, lower=True)
    least = np.inf
    for s in (complex(x, y) for x in (a, 0.0, b) for y in (0.0, hi)):
        P = outside.T @ pencil.at(s).toarray() @ outside
        real = la.solve_triangular(held, la.solve_triangular(held, (P + P.conj().T) / 2, lower=True).conj().T, lower=True)
        least = min(least, float(la.eigvalsh(real)[0]))
    assert least >= projection.least - 1e-9
    found = projection.on(lambda *_: Contour(sides=(a, b, hi)))
    assert found is not None and found.number == np.count_nonzero(found.contour.encloses(by_lapack(pencil)))


@pytest.mark.parametrize("low", [0.5, 1.5, 3.0])
def test_a_stiffness_that_is_far_from_definite_keeps_room_for_damping(low: float) -> None:
    """Each step of the mass that lifts it is twice the last: what it takes from c beyond need, other terms would lack."""
    n, hi = 80, 1.0
    k = np.append(-low * 2 * hi**2, np.linspace(0.2, 40.0, n - 1))
    N = sp.csr_array(([0.1, -0.1], ([2, 5], [5, 2])), shape=(n, n))
    pencil = fs.Pencil(sp.eye_array(n, format="csr"), sp.csr_array(1e-3 * sp.eye_array(n)), sp.csr_array(sp.diags_array(k) + N))
    projection = Projection(pencil, Contour(sides=(-hi, hi, hi)))
    assert projection.mu <= 2 * max(low, 0.5) * 2 * hi**2 * (1 + 1e-9)
    found = count(pencil, Contour(sides=(-hi, hi, hi)))
    assert found is not None and found.number == np.count_nonzero(found.contour.encloses(by_lapack(pencil)))


def test_little_decay_needs_few_shapes_of_strong_damping() -> None:
    pencil = random_pencil(0)
    damped = fs.Pencil(pencil.M, sp.csr_array(sp.diags_array(np.linspace(0.0, 20.0, pencil.size))), pencil.K)
    wide, narrow = (Projection(damped, Contour(sides=(a, 0.4, 0.4))) for a in (-0.4, -0.01))
    assert narrow.least > 0 and wide.least > 0 and narrow.size < wide.size - 20


@pytest.mark.parametrize("seed", range(6, 10))
def test_both_halves_of_a_change_move_an_eigenvalue_together(seed: int) -> None:
    """An entry on one side of the diagonal in a model that is unsymmetric already: what one half moves, the other takes back."""
    pencil = random_pencil(seed)
    n = pencil.size
    T = sp.csr_array(([3.0], ([5], [n - 7])), shape=(n, n))
    projection = Projection(pencil, Contour(sides=(-0.5, 0.5, 0.5)), changes=[Varied(T, 0, 1.0)]).changed([0.0], [1e-6])
    small = Coupling.of(projection, 0.7)
    near = small.nu != 0
    moved, lam = projection._moved(small)[near], small.values
    other = Coupling.of(projection.changed([1e-6]), 0.7).values
    alone = np.abs(lam[:, None] - lam + np.diag(np.full(len(lam), np.inf))).min(axis=1) > 1e-2 * np.abs(lam)
    at = np.flatnonzero(alone & (np.abs(lam) < 0.5))
    change = np.abs(lam[at, None] - other).min(axis=1)
    assert len(at) > 4 and np.allclose(moved[at], change, rtol=1e-2, atol=1e-12)


def test_a_mode_that_the_basis_lacks_leaves_no_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without one undamped mode, and with a wrong bound of what is left out, the number would be two short: it is not given."""
    pencil = random_pencil(0)
    values = by_lapack(pencil)
    hi = float(np.sort(np.abs(values))[30]) * 1.01
    contour = Contour(sides=(-hi, hi, hi))
    right = count(pencil, contour)
    assert right is not None and right.number == np.count_nonzero(contour.encloses(values))
    from femsub.modes.quadratic import projected_count

    original = projected_count.modes_below

    def without_one(*arguments: object) -> fs.NormalModes:
        modes = original(*arguments)
        keep = np.setdiff1d(np.arange(len(modes.eigenvalues)), [3])
        return replace(modes, eigenvalues=modes.eigenvalues[keep], shapes=modes.shapes[:, keep], residual=modes.residual[keep])

    monkeypatch.setattr(projected_count, "modes_below", without_one)
    assert count(pencil, contour) is None  # its inertia count differs from what is listed


@pytest.mark.parametrize("held", [True, False])
def test_rigid_motion_and_units_change_no_count(held: bool) -> None:
    sub = lattice(9, 8, held=held, seed=1)
    pencil = fs.Pencil(sub.M, 1e-2 * lattice(9, 8, held=held, seed=2).K, sub.K)
    values = by_lapack(pencil)
    hi = float(np.sort(np.abs(values))[40]) * 1.01
    for unit in (1.0, 1e-3, 1e6):  # of time
        scaled = fs.Pencil(unit**2 * pencil.M, unit * pencil.D, pencil.K)
        found = count(scaled, Contour(hi / unit))
        assert found is not None and found.number == np.count_nonzero(np.abs(values) < hi)


@pytest.mark.slow
def test_complex_modes_are_certified_by_it_for_a_band_and_a_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """Damping that is nowhere proportional, in 260 DOF."""
    sub = lattice(13, 10, held=True, seed=3)
    rng = np.random.default_rng(5)
    D = sub.K @ sp.diags_array(2e-3 * rng.random(sub.size))
    N = sp.random_array((sub.size, sub.size), density=3e-4, rng=rng) * 0.05 * sub.K.diagonal().max()
    pencil = fs.Pencil(sub.M, (D + D.T) * 0.5, sub.K + N - N.T)
    values = by_lapack(pencil)
    hi = float(np.sort(np.abs(values))[40])
    band = fs.complex_modes(pencil, band=(0.2 * hi, hi * 1.001))
    inside = values[(values.imag >= 0.2 * hi) & (values.imag <= hi * 1.001) & (np.abs(values.real) <= hi)]
    assert band.evidence == "certified" and len(band) == len(inside) and band.counted is None
    with monkeypatch.context() as searched:  # left vectors by a search of their own instead of those of the projection
        searched.setattr("femsub.modes.quadratic.search.left_vectors", lambda *_: None)
        again = fs.complex_modes(pencil, band=(0.2 * hi, hi * 1.001))
    assert np.allclose(band.error_bar, again.error_bar, rtol=0.02) and np.allclose(band.condition, again.condition, rtol=0.02)
    assert not np.array_equal(band.error_bar, again.error_bar)
    near = fs.complex_modes(pencil, count=20)
    assert near.evidence == "certified" and near.counted is not None and near.counted[1] >= 20


@pytest.mark.slow
def test_a_counted_band_needs_no_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """The projection's pairs, corrected by its own factor, are those of a search and of LAPACK; doublets are corrected as one."""
    sub, rng = lattice(9, 8, held=True, seed=3), np.random.default_rng(5)
    D = sub.K @ sp.diags_array(2e-3 * rng.random(sub.size))
    N = sp.random_array((sub.size, sub.size), density=1e-3, rng=rng) * 0.05 * sub.K.diagonal().max()
    pencil = fs.Pencil(sub.M, (D + D.T) * 0.5, sub.K + N - N.T)
    twice = fs.Pencil(*(sp.csr_array(sp.block_diag([part, part])) for part in (pencil.M, pencil.D, pencil.K)))
    hi = float(np.sort(np.abs(by_lapack(pencil)))[30]) * 1.001

    def never(*_: object, **__: object) -> None:
        raise AssertionError("a search was made")

    for model, each in ((pencil, 1), (twice, 2)):
        made = factors_made()
        with monkeypatch.context() as watched:
            watched.setattr(sparse, "quadratic_modes", never)
            found = fs.complex_modes(model, band=(0.2 * hi, hi))
        assert factors_made() - made <= 5 and found.evidence == "certified"  # A, its modes' count, two of the damping's bound
        values = dense.solve(pencil.dense())[0]
        inside = np.repeat(values[(values.imag >= 0.2 * hi) & (values.imag <= hi)], each)
        assert np.allclose(found.eigenvalues, inside[np.argsort(inside.imag)], rtol=1e-10)
        assert found.backward_error.max() < 1e-14 and (found.error_bar < 1e-11 * np.abs(found.eigenvalues)).all()


def over_a_family(n: int, width: int = 40) -> tuple[Projection, fs.Affine, int, int]:
    """The projection of springs between each mass and the next ones, over a spring; bytes that it holds and takes beside V."""
    K = sp.csr_array(sp.diags_array([-np.ones(n - j) for j in range(1, width + 1)], offsets=range(1, width + 1), shape=(n, n)))
    K = sp.csr_array(K + K.T - sp.diags_array((K + K.T).sum(axis=0) - 1e-6))
    one = sp.csr_array(([1.0], ([n // 3], [n // 3])), shape=(n, n))
    family = fs.Affine(sp.eye_array(n), [(1e-3, K)], [(1.0, K), ("k", one)])
    tracemalloc.start()
    try:
        found = projection_over((family, family.factors(k=0.5)), [Varied(one, 0, 0.5)], (-1.0, 1.0, 0.0, 1.0))
        held = tracemalloc.get_traced_memory()[0]
        tracemalloc.reset_peak()
        found.sizes(found.V)
        taken = tracemalloc.get_traced_memory()[1] - held
    finally:
        tracemalloc.stop()
    return found, family, held - found.V.base.nbytes, taken


def test_a_family_is_not_kept_formed():
    """Its reference has a K and a D of its own, as large as a basis each."""
    over_a_family(500)  # what is imported and kept for all
    projection, family, held, taken = over_a_family(8000)
    size, reference = 12 * family.K[0][1].nnz, family.at(k=0.5)
    assert held < (0.3 if petsc.has_cholmod() else 1.3) * size  # MUMPS keeps what it factorises
    assert taken < size
    for found, part in zip(projection.matrices, (reference.K, reference.D, reference.M), strict=True):
        np.testing.assert_allclose(found, projection.V.T @ (part @ projection.V), rtol=0, atol=1e-9 * np.abs(found).max())


@pytest.mark.slow
@pytest.mark.parametrize("end", ["works", "is killed"])
def test_a_fork_corrects_half_of_the_pairs(end: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Right and left vectors, doublets among them, are those that this process finds alone; also where the fork is killed."""
    sub, rng = lattice(9, 8, held=True, seed=3), np.random.default_rng(5)
    D = sub.K @ sp.diags_array(2e-3 * rng.random(sub.size))
    N = sp.random_array((sub.size, sub.size), density=1e-3, rng=rng) * 0.05 * sub.K.diagonal().max()
    twice = fs.Pencil(*(sp.csr_array(sp.block_diag([part, part])) for part in (sub.M, (D + D.T) * 0.5, sub.K + N - N.T)))
    hi = float(np.sort(np.abs(by_lapack(twice)))[60]) * 1.001
    contour, fork, forks, found = Contour(sides=(-hi, hi, hi)), os.fork, [], []

    def forked() -> int:
        forks.append(fork())
        if not forks[-1] and end == "is killed":
            os.kill(os.getpid(), signal.SIGKILL)
        return forks[-1]

    monkeypatch.setattr(os, "fork", forked)
    monkeypatch.setattr("femsub.algebra.processes.beside.cores", lambda: 2)
    for worth in (1e12, 0.0):
        monkeypatch.setattr("femsub.algebra.factor.WORK", worth)
        projection = Projection(twice, contour)
        if not worth and not fork_pays(projection.factor, 1000):
            pytest.skip("no CHOLMOD")
        assert projection.on(lambda *_: contour) is not None and projection.counted is not None
        before = len(forks)
        pairs = right_pairs(projection.counted, twice, together=3)
        assert pairs is not None and len(forks) - before == (not worth)
        order = np.argsort(pairs[0].imag, kind="stable")
        values, X = pairs[0][order], pairs[1][:, order]
        assert twice.backward_error(values, X).max() < 1e-14
        assert left_vectors(projection.counted, twice, values, X, together=3) is not None  # each is clearly of its eigenvalue
        found.append((projection.lost, values))
        with monkeypatch.context() as strict:  # none converges to that, and none is given
            for limit in ("SUMS", "ROUNDING"):
                strict.setattr(projected_pairs, limit, 0.0)
            assert right_pairs(projection.counted, twice) is None
    for one, other in zip(*found, strict=True):
        assert np.allclose(one, other, rtol=1e-8, atol=1e-10 * np.abs(one).max())


def test_a_strong_dashpot_and_a_fast_rotor() -> None:
    """Dashpots of any strength count by their shapes; gyroscopic forces beyond the stiffness are refused."""
    sub = lattice(9, 8, held=True, seed=1)
    rng = np.random.default_rng(7)
    D = sp.diags_array(np.where(rng.random(sub.size) < 0.05, 30.0, 1e-3 * rng.random(sub.size)))
    pencil = fs.Pencil(sub.M, D, sub.K)
    values = by_lapack(pencil)
    hi = float(np.sort(np.abs(values))[30]) * 1.01
    contour = Contour(sides=(-hi, hi, hi))
    found = count(pencil, contour)
    assert found is not None and found.number == np.count_nonzero(contour.encloses(values))
    G = sp.random_array((sub.size, sub.size), density=0.05, rng=rng) * 100 * hi
    assert count(fs.Pencil(sub.M, G - G.T, sub.K), contour) is None


def test_the_sum_over_eigenpairs_is_the_inverse() -> None:
    projection = Projection(random_pencil(7), Contour(1.0))
    small = Coupling.of(projection, 1.0)
    assert small.wrong < 1e-8
    changed = copy(small)
    changed.x = small.x * (1 + 1e-3 * (np.arange(len(small.nu)) == 5))
    del changed.wrong
    assert changed.wrong > 1e-6  # one pair that is wrong is seen
    s = 0.3 + 0.8j
    for found, x in zip(small.both_products, (small.x, small.z), strict=True):  # of conjugates as well
        assert np.allclose(found, small._products(x), rtol=0, atol=1e-12 * np.abs(found).max())
        assert np.abs(found.imag).max() > 1e-8 * np.abs(found).max()
    weights = small.nu / (1 - (s - small.shift) * small.nu)
    inverse = (small.x * weights) @ small.z.conj().T
    assert la.norm(small.pairs.sum(weights) - inverse) < 1e-13 * la.norm(np.abs(weights) * la.norm(small.x, axis=0)
                                                                         * la.norm(small.z, axis=0))
    P = np.eye(projection.size) + sum(
        complex(part.weight(np.array([s]))[0]) * (projection.V.T @ projection.image(i, np.eye(projection.size)))
        for i, part in enumerate(projection.terms))
    assert la.norm(inverse @ P - np.eye(projection.size)) < 1e-8


@pytest.mark.parametrize("seed", [7, 3, 10])  # with a lift, without, under circulatory forces
def test_modes_need_no_solve_for_their_inertia(seed: int) -> None:
    """A⁻¹Mφ = φ / (ω² + μ), so the products of these images are known; solves give the same."""
    projection = Projection(random_pencil(seed), Contour(1.0))
    image = projection.image(0, np.eye(projection.size))
    exact = image.T @ projection.solve(image)
    known = projection.inside[0].T @ projection.inside[0] + projection.lost[0, :, 0]
    assert projection.size and la.norm(known - exact) < 1e-9 * la.norm(exact)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("seed", "size"), [(7, 1.0), (3, 1.0), (10, 1.0), (10, 1e-80), (10, 1e80)])
def test_images_that_grow_are_those_of_all_columns(seed: int, size: float) -> None:
    """A contact acts on few rows, of which alone its images are made. They are right in any units."""
    pencil = random_pencil(seed)
    pencil = fs.Pencil(*(size * part for part in (pencil.M, pencil.D, pencil.K)))
    projection, rng = Projection(pencil, Contour(1.0)), np.random.default_rng(seed)
    n, m = projection.V.shape
    assert projection.add(rng.standard_normal((n, 3))) and projection.size == m + 3
    x = rng.standard_normal((m + 3, 2)) + 1j * rng.standard_normal((m + 3, 2))
    few, exact = 0, []
    for i, part in enumerate(projection.terms):
        few += not isinstance(part.rows, slice)
        exact.append(part.matrix @ projection.V)
        assert la.norm(projection.image(i, x) - exact[i] @ x) <= 1e-12 * la.norm(exact[i] @ x)
        assert la.norm(projection.inside[i] - projection.V.T @ exact[i]) <= 1e-12 * la.norm(exact[i]) * la.norm(projection.V)
    gram = np.einsum("ain,bnj->aibj", np.array([one.T for one in exact]), np.array([projection.solve(one) for one in exact]))
    inner = np.einsum("aij,bik->ajbk", projection.inside, projection.inside)
    assert la.norm(projection.lost + inner - gram.reshape(projection.lost.shape)) <= 1e-9 * la.norm(gram)
    assert few or seed != 10
    s = np.array([0.3 + 0.8j, -0.1 + 0.5j])
    for adjoint in (False, True):  # Pᴴ of a real pencil is Pᵀ at the conjugates
        at = s.conj() if adjoint else s
        image = np.column_stack([(P.T if adjoint else P) @ (projection.V @ x[:, k]) for k, P in enumerate(map(pencil.at, at))])
        whole = projection.solve(image.real) + 1j * projection.solve(image.imag)
        outside = whole - projection.V @ (projection.V.T @ image)
        found = projection.residuals(s, x, adjoint)
        assert la.norm(found[:, ::2] + 1j * found[:, 1::2] - outside) <= 1e-5 * la.norm(outside)


def test_a_proved_count_and_solved_pairs_cost_nothing_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """No directions are solved for once the margin is safe, and pairs that will be solved leave the block."""
    pencil = random_pencil(18)
    hi = float(np.sort(np.abs(by_lapack(pencil)))[20]) * 1.01
    projection = Projection(pencil, contour := Contour(sides=(-hi, hi, hi)))
    assert projection.on(lambda *_: contour) is not None and projection.counted is not None
    columns: list[int] = []
    solve = projection.factor.solve

    def counting(B: np.ndarray) -> np.ndarray:
        columns.append(B.shape[1])
        return solve(B)

    monkeypatch.setattr(projection.factor, "solve", counting)
    far = Coupling._far
    with monkeypatch.context() as large:  # pairs far from the contour have the largest share, and more directions would lower it
        large.setattr(Coupling, "_far", lambda *given: (0.6, far(*given)[1]))
        margin, more = projection.counted.margin(contour, projection.coercivity((-hi, hi), hi))
    assert 0.6 <= margin < 0.9 and not more and not columns
    found = right_pairs(projection.counted, pencil)
    assert found is not None and pencil.backward_error(*found).max() < 4e-15
    assert columns[0] == 2 * len(found[0]) > 2 * columns[-1] and columns == sorted(columns, reverse=True)


def test_left_vectors_come_from_what_the_count_has_solved_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """All within a per cent of LAPACK's, and most without a solve. With gyroscopic forces the signs of the weights matter."""
    pencil = random_pencil(16)
    every, _, exact = dense.solve(pencil.dense())
    hi = float(np.sort(np.abs(every))[40]) * 1.01
    projection = Projection(pencil, contour := Contour(hi))
    assert projection.on(lambda *_: contour) is not None and projection.counted is not None
    found = right_pairs(projection.counted, pencil)
    assert found is not None
    columns: list[int] = []
    solve = projection.factor.solve
    monkeypatch.setattr(projection.factor, "solve", lambda B: (columns.append(B.shape[1]), solve(B))[1])
    left = left_vectors(projection.counted, pencil, *found)
    assert left is not None and sum(columns) < len(found[0])
    exact = exact[:, [np.abs(every - value).argmin() for value in found[0]]]
    beside = exact - left * np.einsum("ij,ij->j", left.conj(), exact)
    assert (la.norm(beside, axis=0) < 4e-3 * la.norm(exact, axis=0)).all()


@pytest.mark.slow
def test_the_full_brake_is_certified() -> None:
    """7,458 DOF, friction on every node under the pads: 'not checked' before."""
    brake = brake_models(0.025)
    pencil = brake.full.linearised(brake.at({"mu": 0.6}))
    made = factors_made()
    modes = fs.complex_modes(pencil, band=(1e3, 5e4))
    assert modes.evidence == "certified" and modes.is_stable is False
    assert factors_made() - made <= 5


def test_the_energy_of_modes_is_computed_only_where_digits_of_k_are_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a K with all its digits no mode is within rounding: a product with every shape would be for nothing."""
    asked: list[int] = []
    monkeypatch.setattr(dense, "costs", lambda K, x: (asked.append(x.shape[1]), np.ones(x.shape[1])))
    written = fs.chain(10, damping=0.1)
    pencil = fs.Pencil(written.M, written.D, written.K)
    assert len(fs.complex_modes(pencil, count=4)) == 4 and not asked
    monkeypatch.setattr(dense, "rounding", lambda K: 1e-7)
    assert len(fs.complex_modes(pencil, count=4)) == 4 and asked == [4]


def strongly_damped(cells: int) -> tuple[fs.Pencil, np.ndarray]:
    """A chain of 60 masses and so many cells of four, each with a strong dashpot: sparse, shuffled; and all eigenvalues."""
    rng = np.random.default_rng(7)
    parts, values = [], []
    for n, strong in ((60, 0.0), *((4, 60.0),) * cells):
        line = sp.diags_array([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
        K = sp.csr_array(rng.uniform(0.8, 1.2) * (25.0 if strong else 1.0) * line)
        D = 1e-3 * K + sp.diags_array(strong * (np.arange(n) == n // 2))
        parts.append((sp.eye_array(n), D, K))
        values.append(dense.solve(fs.Pencil(*(part.toarray() for part in parts[-1])))[0])
    whole = [sp.csr_array(sp.block_diag(some)) for some in zip(*parts, strict=True)]
    order = rng.permutation(whole[0].shape[0])
    return fs.Pencil(*(part[order][:, order] for part in whole)), np.concatenate(values)


@pytest.mark.slow
def test_a_count_that_is_possible_is_made_and_one_that_is_not_names_what_it_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    """210 strongly damped shapes. Where there are too many for LAPACK, the warning has their number."""
    pencil, values = strongly_damped(210)
    contour = Contour(sides=(-0.2, 0.2, 0.2))
    found = count(pencil, contour)
    assert found is not None and found.number == np.count_nonzero(contour.encloses(values)) > 2 and found.size >= 210
    monkeypatch.setattr("femsub.modes.quadratic.search.QUADRATIC", 40)
    pencil, values = strongly_damped(50)
    with pytest.warns(fs.FemsubWarning, match=r"the basis needs \d+ shapes, \d+ of them strongly damped, and the limit is 40"):
        assert fs.complex_modes(pencil, band=(0.0, 0.2)).evidence == "not checked"


@pytest.mark.parametrize("seed", range(4))
def test_strongly_damped_shapes_of_few_rows_are_those_of_lanczos(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Dashpots of both signs on 60 of 300 masses: the basis is one space by a dense eigenproblem, and by ARPACK."""
    rng = np.random.default_rng(seed)
    chain = fs.chain(300)
    K = sp.csr_array(chain.K + 0.01 * sp.eye_array(300))
    D = sp.csr_array(sp.diags_array(np.where(np.arange(300) % 5 == 3, rng.standard_normal(300), 0.0)))
    pencil, found = fs.Pencil(sp.csr_array(chain.M), D, K), []
    for most in (projected_count.QUADRATIC, 0):
        monkeypatch.setattr(projected_count, "QUADRATIC", most)
        found.append(Projection(pencil, Contour(sides=(-0.3, 0.3, 0.3))))
    X, Y = (one.V for one in found)
    assert X.shape == Y.shape and found[0].least == pytest.approx(found[1].least)
    assert X.shape[1] > 5 + len(fs.normal_modes(fs.Substructure(pencil.M, K), band=(0.0, 0.75)).eigenvalues)
    assert np.linalg.svd(X.T @ (found[0].A @ Y), compute_uv=False).min() > 1 - 1e-9  # in the norm of A


@pytest.mark.slow
def test_friction_outside_of_the_basis_does_not_keep_corrections_from_converging(monkeypatch: pytest.MonkeyPatch) -> None:
    """A disc and a pad of 348 DOF: the residuals of the pairs join the basis. LAPACK took all 696 eigenvalues."""
    disc = fs.annulus(0.05, 0.15, 0.012, (1, 12, 1))
    pad = fs.annulus(0.09, 0.145, 0.012, (1, 2, 1), sector=(-0.4, 0.4))
    pad = replace(pad, points=pad.points + np.array([0.0, 0.0, 0.012]))
    top = disc.nodes("top")
    disc = disc.with_sets(track=top[np.abs(np.arctan2(disc.points[top, 1], disc.points[top, 0])) < 0.6])
    ports = {f"{place}-{axis}": (place, axis) for place in ("top", "start", "end") for axis in "xyz"}
    iron, lining = fs.Material(1.1e11, 0.26, 7200.0), fs.Material(5e9, 0.25, 2500.0)
    parts = {"disc": fs.solid(disc, iron, supports=["inner"], interface=["track"], rayleigh=(10.0, 1e-8)),
             "pad": fs.solid(pad, lining, interface=["bottom"], ports=ports, rayleigh=(10.0, 1e-8))}
    rubbing = fs.FrictionContact("pad.bottom", "disc.track", {"disc": disc, "pad": pad}, 2e11, 0.3, 1e6, axis=(0, 0, 1),
                                 speed=50.0)
    brake = fs.couple(parts, [rubbing, *(fs.Spring(("pad", port), stiffness=1e7) for port in ports)])
    band = (1e3, 4.5e4)
    exact = dense.solve(brake.linearised(rubbing).dense())[0]
    exact = exact[(exact.imag >= band[0]) & (exact.imag <= band[1])]
    monkeypatch.setattr(dense, "solve", None)
    found = fs.complex_modes(brake, rubbing, band=band)
    assert found.evidence == "certified" and len(found) == len(exact) > 10
    assert np.abs(found.eigenvalues[:, None] - exact).min(axis=1).max() < 1e-8 * band[1]


BRAKE = Path(__file__).parent.parent.parent / "shared" / "brake-m0"


@pytest.mark.rare
@pytest.mark.skipif(not BRAKE.is_dir(), reason=f"the matrices of a brake are not in {BRAKE}")
@pytest.mark.parametrize("turns", [1, 2, 4])
def test_the_public_brake_with_its_material_damping_is_certified(turns: int) -> None:
    """37 eigenvalues, one of which grows; 230 shapes are strongly damped (Gräbner et al., ZAMM 96 (2016) 1388).

    Slow tests do the same at 1 turn a second (docs/tutorials/public-brake.md) and at 7.5 (tests/test_public_brake.py).
    """
    M, D1, DG, DR, D4, K1, KR, KG = (
        sp.csr_array(next(value for name, value in loadmat(BRAKE / f"{file}.mat").items() if not name.startswith("_")))
        for file in ("BMLL", "BDLL", "BYLL", "BDIWLL", "BHLL", "BKLL", "BKQLL", "BWLL"))
    speed = 2 * np.pi * turns
    found = fs.complex_modes(fs.Pencil(M, D1 + DR / speed + speed * DG + D4 / 1600, K1 + KR + speed**2 * KG), band=(0.0, 2e4))
    assert found.evidence == "certified" and len(found) == 37 and len(found.unstable) == 1
    growing = {1: 0.000250 + 5130.604314j, 2: 0.000193 + 5130.604345j, 4: 0.000049 + 5130.605396j}[turns]
    assert abs(found.eigenvalues[found.unstable[0]] - growing) < 1e-6


def test_a_projection_whose_eigenvalues_are_all_real_gives_left_vectors() -> None:
    """LAPACK's vectors are real then, which was a raw ValueError where their number is odd."""
    n, rng = 140, np.random.default_rng(0)
    line = sp.diags_array([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    D = sp.csr_array(sp.diags_array(rng.uniform(20, 30, n)) + sp.csr_array(([0.1, -0.1], ([3, 7], [7, 3])), shape=(n, n)))
    for count in (4, 5):
        found = fs.complex_modes(fs.Pencil(sp.eye_array(n), D, sp.csr_array(line + 0.01 * sp.eye_array(n))), count=count)
        assert len(found) == count and (found.eigenvalues.imag == 0).all() and np.isfinite(found.error_bar).all()


@pytest.mark.slow
def test_a_large_floating_model_needs_no_square_of_its_size() -> None:
    sub = fs.chain(50_000, fixed=False, belt=2)
    modes = fs.complex_modes(sub, fs.Belt(slope=-1e-3), band=(0.0, 4e-4))
    assert modes.evidence == "certified" and len(modes) > 5
