"""A sweep of the frequency meets all crossings of a parameter that acts through few columns, and no bound of it is too small."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from femsub.checks import NotConvergedError
from femsub.modes import Projection, Varied, projection_over
from femsub.modes.quadratic.axis_sweep import AxisSweep, Line, _discs
from femsub.stability.critical_value import question_of
from femsub.stability.followed import _swept

BAND = (0.0, 0.6)


def coupled(seed: int, n: int = 60) -> tuple[fs.Affine, sp.csr_array]:
    """A damped chain, and a circulatory pair that p multiplies."""
    rng = np.random.default_rng(seed)
    K = sp.csr_array(sp.diags_array([2.0 + 0.2 * rng.random(n), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1]))
    M, a, b = sp.csr_array(sp.eye_array(n)), *rng.choice(n, 2, replace=False)
    pair = sp.csr_array(([1.0, -rng.uniform(0.5, 1.0)], ([a, b], [b, a])), shape=(n, n))
    return fs.Affine(M, 1e-3 * M + 1e-3 * K, [(1.0, K), ("p", pair)]), pair


def projected(seed: int, at: float = 0.2) -> Projection:
    family, pair = coupled(seed)
    projection = projection_over(family.at(p=at), [Varied(pair, 0, 0.5)], (-BAND[1], BAND[1], *BAND)).changed([0.0])
    projection.lost  # noqa: B018  (before residuals)
    return projection


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", [3, 10, 11])  # one loss, two, and two with a regain
def test_the_sweep_meets_the_crossings_of_the_discs_and_no_other(seed: int) -> None:
    family, _ = coupled(seed, 45)
    found = _swept(question_of(family, None, "p", (0.0, 0.5), BAND), 6)
    exact = fs.critical_value(family, None, "p", between=(0.0, 0.5), band=BAND, solver="discs")
    assert exact.evidence == found.evidence == "certified" and found.losses and not found.open
    for several, every in ((found.losses, exact.losses), (found.regains, exact.regains)):
        assert [one.value for one in several] == pytest.approx([one.value for one in every], abs=1e-10)
        assert [one.omega for one in several] == pytest.approx([one.omega for one in every], rel=1e-8)
        assert [one.kind for one in several] == [one.kind for one in every]


@pytest.mark.parametrize("seed", range(3))
def test_the_discs_hold_the_parameters_of_the_full_pencil_all_over_their_pieces(seed: int) -> None:
    """p at which iω is an eigenvalue are those of a dense problem of full size, for any ω of a piece, however large it is."""
    family, pair = coupled(seed)
    sweep, rng = AxisSweep(projected(seed), [1.0], (-0.2, 0.3)), np.random.default_rng(seed)
    pencil, close = family.at(p=0.2).dense(), []
    for size in 10.0 ** np.linspace(-8.0, -2.0, 25):
        omega = rng.uniform(*BAND)
        discs = sweep.discs(np.array([1j * omega]), np.array([size]), 1j)
        for t in size * np.array([-1.0, -0.4, 0.3, 1.0]):
            exact = -np.linalg.eigvals(np.linalg.solve(pencil.at(1j * (omega + t)), pair.toarray()))
            exact = exact[np.argsort(-np.abs(exact))[:2]]
            centre = discs.mu[0] + t * discs.slope[0] + t * t * discs.bend[0]
            off = np.abs(exact[:, None] - centre) - discs.radius[0]
            assert (off.min(axis=1) <= 0).all()
            if discs.clear[0].all() and np.isfinite(discs.radius).all():
                assert (np.count_nonzero(off <= 0, axis=0) == 1).all()
                close.append(float(np.min(np.abs(exact[:, None] - centre).min(axis=1) / discs.radius[0].max())))
    assert max(close) > 0.02  # the bounds are not so large that they cannot fail


def test_discs_of_a_small_matrix_hold_its_eigenvalues_and_scaled_ones_one_each() -> None:
    rng = np.random.default_rng(1)
    for _ in range(300):
        r = int(rng.integers(1, 5))
        G, b, q, F = ((rng.standard_normal((1, r, r)) + 1j * rng.standard_normal((1, r, r))) * size
                      for size in (1.0, 1.0, 1.0, 10.0 ** rng.uniform(-9, -1)))
        h = 10.0 ** rng.uniform(-7, 0)
        mu, V = np.linalg.eig(G)
        W = np.linalg.inv(V)
        discs = _discs(G, mu, V, W, W @ b @ V, W @ q @ V, np.abs(W @ F @ V), np.array([h]))
        t = rng.uniform(-h, h)
        exact = np.linalg.eigvals(G + t * b + t * t * q + F)[0]
        off = np.abs(exact[:, None] - (discs.mu[0] + t * discs.slope[0] + t * t * discs.bend[0])) <= discs.radius[0]
        assert off.any(axis=1).all() and (off.sum(axis=0)[discs.clear[0]] == 1).all()


def test_a_real_eigenvalue_that_passes_0_and_modes_that_grow_from_the_begin_on_are_counted() -> None:
    n = 50
    K = sp.csr_array(sp.diags_array([np.full(n, 2.02), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1]))
    w = sp.csr_array(([1.0], ([20], [20])), shape=(n, n))
    family = fs.Affine(sp.eye_array(n), 0.05 * K, [(1.0, K), ("p", -w)])
    found = _swept(question_of(family, None, "p", (0.0, 1.0), BAND), 6)
    value = 1 / np.linalg.inv(K.toarray())[20, 20]
    assert [(one.kind, one.omega) for one in found.losses] == [("divergence", 0.0)] and found.evidence == "certified"
    assert found.value == pytest.approx(value, rel=1e-11)
    back = _swept(question_of(family, None, "p", (1.0, 0.0), BAND), 6)
    assert back.growing == 1 and [one.value for one in back.regains] == pytest.approx([value]) and back.value == 1.0
    z = fs.complex_modes(family.at(p=1.0).dense()).eigenvalues
    assert back.fastest == pytest.approx(z[np.argmax(z.real)], rel=1e-3)


def test_crossings_at_one_frequency_and_several_values_are_distinguished() -> None:
    """Two real eigenvalues pass 0 at values of their own; and with a skew change p and -p have the same frequencies."""
    n = 50
    K = sp.csr_array(sp.diags_array([np.full(n, 2.02), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1]))
    two = sp.csr_array(([1.0, 0.8], ([10, 30], [10, 30])), shape=(n, n))
    family = fs.Affine(sp.eye_array(n), 0.05 * K, [(1.0, K), ("p", -two)])
    found = _swept(question_of(family, None, "p", (0.0, 1.0), BAND), 6)
    flexible = np.linalg.inv(K.toarray())[np.ix_([10, 30], [10, 30])]
    exact = np.sort(1 / np.linalg.eigvals(flexible @ np.diag([1.0, 0.8])).real)
    assert [one.value for one in found.losses] == pytest.approx(exact, rel=1e-10) and found.evidence == "certified"
    skew = sp.csr_array(([1.0, -1.0], ([10, 30], [30, 10])), shape=(n, n))
    family = fs.Affine(sp.eye_array(n), 1e-3 * K, [(1.0, K), ("p", skew)])
    found = _swept(question_of(family, None, "p", (-1.0, 1.0), BAND), 6)
    assert found.evidence == "certified" and len(found.losses) == len(found.regains) > 2
    assert sorted(one.value for one in found.losses) == pytest.approx(sorted(-one.value for one in found.regains), abs=1e-10)


def test_without_damping_the_sweep_says_that_it_cannot() -> None:
    """All eigenvalues are on the axis for all values, of the model or of a part that nothing damps: no loop, no answer."""
    family, pair = coupled(0)
    undamped = fs.Affine(family.M, None, family.K)
    with pytest.raises(NotConvergedError, match="without damping"):
        _swept(question_of(undamped, None, "p", (0.0, 0.5), BAND), 6)
    n, alone = 60, sp.csr_array(([0.09], ([60], [60])), shape=(61, 61))
    M, D, K, T = (sp.block_diag([part, sp.csr_array((1, 1))], format="csr") for part in (
        sp.eye_array(n), family.at(p=0.0).D, family.at(p=0.0).K, pair))
    beside = fs.Affine(M + alone / 0.09, D, [(1.0, K + alone), ("p", T)])
    with pytest.raises(NotConvergedError, match="crossings are not known"):
        _swept(question_of(beside, None, "p", (0.0, 0.5), BAND), 6)


def test_a_bound_that_is_too_small_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a thousandth of the remainder the discs lose what they hold: the other tests would fail."""
    real = AxisSweep.discs
    monkeypatch.setattr(AxisSweep, "discs", lambda self, s, h, along: real(self, s, h / 1000, along))
    with pytest.raises(AssertionError):
        for seed in range(3):
            test_the_discs_hold_the_parameters_of_the_full_pencil_all_over_their_pieces(seed)


def test_a_line_of_no_crossing_takes_few_pieces() -> None:
    sweep = AxisSweep(projected(1), [1.0], (-0.2, 0.3))
    met, left = sweep.swept(Line(0.5 + 0j, 1j, 0.6), 1e-9)
    assert not met and not left
