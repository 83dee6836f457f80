"""Pairs from two-sided states: the eigenvalues of a box's model, in less time, and never fewer than are proved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from femsub.model import in_band
from femsub.modes import Contour
from femsub.reduction import parameter_box
from femsub.reduction.states import States, iterated, listed, settled

CONTOUR = Contour(sides=(-3.0, 3.0, 3.0))


def pencil(rng: np.random.Generator, d: int) -> list[np.ndarray]:
    """Factors M, D, K of a damped model with gyroscopic and circulatory parts, ω from 0.5 to 20."""
    turn = la.qr(rng.standard_normal((d, d)))[0]
    K = turn.T @ np.diag(np.linspace(0.5, 20.0, d) ** 2) @ turn
    skew = rng.standard_normal((2, d, d))
    return [np.eye(d), 0.02 * np.eye(d) + 0.05 * (skew[0] - skew[0].T), K + 0.2 * (skew[1] - skew[1].T)]


def exact(matrices: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """λ inside the contour with Im λ ≥ 0, and right and left vectors, by LAPACK."""
    M, D, K = matrices
    d = len(M)
    companion = np.block([[np.zeros((d, d)), np.eye(d)], [-la.solve(M, K), -la.solve(M, D)]])
    lam, left, right = la.eig(companion, left=True)
    at = np.flatnonzero(CONTOUR.encloses(lam) & (lam.imag >= 0))
    return lam[at], right[:d, at], la.solve(M.T, left[d:, at])


def states_of(several: list[list[np.ndarray]], terms: list[np.ndarray], extra: np.ndarray) -> States:
    """On the vectors of several pencils, with states that belong to none; `terms` are M, D, K, each with a factor."""
    sides: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for M, D, _ in several:
        lam, x, z = exact([M, D, _])
        for side, part in zip(sides, (np.vstack([x, x * lam]), np.vstack([D.T @ z + M.T @ (z * lam.conj()), z])), strict=True):
            side.extend([part.real, part.imag])
    X, Z = (la.qr(np.hstack([*side, one]), mode="economic")[0] for side, one in zip(sides, extra, strict=True))
    k = min(X.shape[1], Z.shape[1])
    return States.of(tuple([A] for A in terms), X[:, :k], Z[:, :k], 1.0)


def sizes_of(matrices: list[np.ndarray]) -> Callable[..., np.ndarray]:
    """The size of the residuals on both sides, of |zᴴP'x| = 1."""
    M, D, K = matrices

    def sizes(lam: np.ndarray, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        P = [K + s * D + s * s * M for s in lam]
        both = [la.norm(one @ x[:, k]) * la.norm(one.conj().T @ z[:, k]) for k, one in enumerate(P)]
        return np.array(both) + 1e-13 * np.abs(lam)  # with rounding

    return sizes


@pytest.mark.parametrize("seed", range(8))
def test_states_list_all_eigenvalues_and_none_of_their_own(seed: int) -> None:
    rng = np.random.default_rng(seed)
    M, D, K = pencil(rng, 24)
    ends = [[M, 0.8 * D, 0.97 * K], [M, 1.2 * D, 1.03 * K]]
    extra = rng.standard_normal((2, 48, 4))  # states of no eigenvalue: their own must not be listed
    states = states_of(ends, [M, D, K], extra)
    assert states.a.shape[1] < 24
    for damping, stiffness in ((1.0, 1.0), (0.9, 1.01), (1.2, 1.03)):
        here = [M, damping * D, stiffness * K]
        lam, _, _ = exact(here)
        number = len(lam) + np.count_nonzero(lam.imag)
        matrices = here[2], here[1], here[0]
        factors = np.array([1.0, damping, stiffness])
        found = listed(states, factors, matrices, CONTOUR.encloses, number, sizes_of(here), 1e-3)
        assert found is not None
        np.testing.assert_allclose(np.sort_complex(found[0]), np.sort_complex(lam), rtol=1e-6)
        for wrong in (number - 1, number + 2):  # a number that is not met: the whole problem is to be solved
            assert listed(states, factors, matrices, CONTOUR.encloses, wrong, sizes_of(here), 1e-3) is None


def test_a_pair_is_listed_once() -> None:
    rng = np.random.default_rng(5)
    here = pencil(rng, 20)
    lam, x, z = exact(here)
    M, D, K = here

    class Twice(States):
        def pairs(self, factors: np.ndarray, inside: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, ...]:
            return np.append(lam, lam[:1] * (1 + 1e-9)), np.hstack([x, x[:, :1]]), np.hstack([z, z[:, :1]])

    twice = Twice(np.zeros((1, 1, 1)), np.zeros((1, 1, 1)), x, z, 1.0)
    number = len(lam) + np.count_nonzero(lam.imag)
    found = listed(twice, np.ones(3), (K, D, M), CONTOUR.encloses, number, sizes_of(here), 1e-3)
    assert found is not None and len(found[0]) == len(lam)


@pytest.mark.filterwarnings("error")
def test_states_that_are_singular_list_nothing() -> None:
    """Right and left states that do not act on each other: LAPACK has no eigenvalues then, and the whole problem is solved."""
    M, D, K = here = pencil(np.random.default_rng(6), 20)
    apart = States.of(([M], [D], [K]), np.eye(40)[:, :5], np.eye(40)[:, 10:15], 1.0)
    assert not apart.b.any() and listed(apart, np.ones(3), (K, D, M), CONTOUR.encloses, 5, sizes_of(here), 1e-3) is None


@pytest.mark.filterwarnings("error")
def test_a_pair_at_an_exact_eigenvalue_needs_no_regular_matrix() -> None:
    """P(0) of a model that moves freely is singular: a pair there cannot be iterated, and is not listed."""
    M, D, K = np.eye(2), 0.1 * np.eye(2), np.diag([0.0, 1.0])
    free = States.of(([M], [D], [K]), np.eye(4), np.eye(4), 1.0)
    exact_pair = np.array([[1.0], [0.0]]) + 0j

    class Free(States):
        def pairs(self, factors: np.ndarray, inside: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, ...]:
            return np.zeros(1, dtype=complex), exact_pair, exact_pair

    def rough(lam: np.ndarray, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        return np.where(np.isfinite(x).all(axis=0), 1.0, np.nan)

    here = Free(free.a, free.b, free.x, free.z, 1.0)
    assert listed(here, np.ones(3), (K, D, M), CONTOUR.encloses, 1, rough, 1e-3) is None


def test_inverse_iteration_mends_a_mixed_pair() -> None:
    rng = np.random.default_rng(7)
    here = pencil(rng, 20)
    M, D, K = here
    lam, x, z = exact(here)
    mixed = x + 0.01 * np.roll(x, 1, axis=1), z + 0.01 * np.roll(z, -1, axis=1)
    before = settled((K, D, M), lam * (1 + 1e-7), *mixed)
    after = iterated((K, D, M), before[0], *before[1:])
    assert (sizes_of(here)(*after) < 1e-6 * sizes_of(here)(*before)).all()
    np.testing.assert_allclose(after[0], lam, rtol=1e-12)


def test_a_model_of_a_box_solves_its_states_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, n = np.random.default_rng(1), 80
    K, turn = fs.chain(n).K, sp.random_array((n, n), density=2 / n, rng=np.random.default_rng(2))
    dashpots = sp.diags_array(rng.uniform(0.0, 0.05, n))
    full = fs.Affine(fs.chain(n).M, [(1.0, dashpots), (1.0, sp.csr_array(0.02 * (turn - turn.T)))],
                     [(1.0, K), ("mu", sp.csr_array(0.01 * turn))])
    small = fs.reduce(full, fs.ParameterBox({"mu": (0.0, 0.5)}, band=(0.0, 0.4)))
    assert small.evidence == "certified" and all(cell.states and len(cell.states.a[0]) < small.size for cell in small.cells)
    places = np.linspace(0.0, 0.5, 7)
    slow = small._with(cells=tuple(replace(cell, states=None) for cell in small.cells))
    whole = [slow.modes(mu=float(mu)) for mu in places]
    monkeypatch.setattr(parameter_box, "eigenpairs", lambda *_: pytest.fail("the whole problem was solved"))
    for mu, other in zip(places, whole, strict=True):
        found = small.modes(mu=float(mu))
        assert found.evidence == "certified" and len(found) == len(other)
        assert (np.abs(found.eigenvalues - other.eigenvalues) <= found.error_bar + other.error_bar).all()


def test_eigenvalues_that_are_all_real_are_no_frequencies() -> None:
    """NumPy returns real arrays then, which `in_band` would take for ω: a mode in the band was not listed, but certified."""
    matrices = np.eye(2), 5.0 * np.eye(2), np.diag([1.0, 2.0])
    states = States.of(tuple([A] for A in matrices), np.eye(4), np.eye(4), 1.0)
    lam, _, _ = states.pairs(np.ones(3), lambda s: np.ones(len(s), dtype=bool))
    assert len(lam) == 4 and not lam.imag.any()
    assert in_band(lam, (0.0, 1.0), (-1.0, 1.0)).sum() == 2
