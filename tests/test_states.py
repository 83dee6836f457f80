"""Pairs from two-sided states: the eigenvalues of a box's model, in less time, and never fewer than are proved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from math import comb

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from femsub.model import in_band
from femsub.modes import Contour
from femsub.reduction import parameter_box
from femsub.reduction.states import Polynomials, Spaces, States, inverse_beside, iterated, listed, of_each, seen, settled
from femsub.stability.leaves import Companion

CONTOUR = Contour(sides=(-3.0, 3.0, 3.0))


def pencil(rng: np.random.Generator, d: int) -> list[np.ndarray]:
    """Factors M, D, K of a damped model with gyroscopic and circulatory parts, ω from 0.5 to 20."""
    turn = la.qr(rng.standard_normal((d, d)))[0]
    K = turn.T @ np.diag(np.linspace(0.5, 20.0, d) ** 2) @ turn
    skew = rng.standard_normal((2, d, d))
    return [np.eye(d), 0.02 * np.eye(d) + 0.05 * (skew[0] - skew[0].T), K + 0.2 * (skew[1] - skew[1].T)]


def all_inside(matrices: list[np.ndarray], contour: Contour = CONTOUR) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """λ inside a contour, and right and left vectors, by LAPACK."""
    M, D, K = matrices
    d = len(M)
    companion = np.block([[np.zeros((d, d)), np.eye(d)], [-la.solve(M, K), -la.solve(M, D)]])
    lam, left, right = la.eig(companion, left=True)
    at = np.flatnonzero(contour.encloses(lam))
    return lam[at], right[:d, at], la.solve(M.T, left[d:, at])


def exact(matrices: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Those with Im λ ≥ 0."""
    lam, x, z = all_inside(matrices)
    return lam[lam.imag >= 0], x[:, lam.imag >= 0], z[:, lam.imag >= 0]


def states_of(at: Callable[[dict[str, float]], list[np.ndarray]], ranges: dict[str, tuple[float, float]], most: int) -> States:
    """Of the pencils M, D, K at values of the parameters."""
    over, spaces = Polynomials.of(ranges, most), list[Spaces]()
    for place in over.nodes.tolist():
        M, D, K = at(dict(zip(ranges, place, strict=True)))
        spaces.append(Spaces.of((K, D, M), *all_inside([M, D, K]), 1.0, *spaces[:1]))
    return States.of(over, spaces, 1.0)


def fixed(right: np.ndarray, left: np.ndarray) -> States:
    """The same states everywhere."""
    return States.of(Polynomials.of({"p": (0.0, 1.0)}, 1), [Spaces(right, left)], 1.0)


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
    M, D, K = pencil(np.random.default_rng(seed), 24)

    def at(values: dict[str, float]) -> list[np.ndarray]:
        return [M, values["damping"] * D, values["stiffness"] * K]

    states = states_of(at, {"damping": (0.8, 1.2), "stiffness": (0.97, 1.03)}, 10)
    for damping, stiffness in ((1.0, 1.0), (0.9, 1.01), (1.2, 1.03)):
        here = at(values := {"damping": damping, "stiffness": stiffness})
        lam, _, _ = exact(here)
        number = len(lam) + np.count_nonzero(lam.imag)
        assert states.right.shape == states.left.shape == (10, 48, number)
        matrices = here[2], here[1], here[0]
        found = listed(states, values, matrices, CONTOUR.encloses, number, sizes_of(here), 1e-3)
        assert found is not None
        np.testing.assert_allclose(np.sort_complex(found[0]), np.sort_complex(lam), rtol=1e-6)
        for wrong in (number - 1, number + 2):  # a number that is not met: the whole problem is to be solved
            assert listed(states, values, matrices, CONTOUR.encloses, wrong, sizes_of(here), 1e-3) is None


@pytest.mark.parametrize("q", [1, 2, 3, 5])
def test_polynomials_have_their_own_values_everywhere(q: int) -> None:
    """All of their degree, on nodes in the box of which the first are those of each lower degree."""
    rng, ranges = np.random.default_rng(q), {f"p{i}": (i - 1.0, 2 * i + 0.5) for i in range(q)}
    lo, hi = np.transpose(list(ranges.values()))
    over = Polynomials.of(ranges, 40)
    assert over.counts == [comb(q + g, g) for g in range(len(over.counts))]
    assert over.counts[-1] == len(over.nodes) <= 40 < comb(q + len(over.counts), q)
    assert (over.nodes >= lo).all() and (over.nodes <= hi).all()
    np.testing.assert_allclose(over.nodes[0], (lo + hi) / 2)
    for degree, m in enumerate(over.counts):
        slope = rng.uniform(-1, 1, q) / q

        def exactly(p: np.ndarray, slope: np.ndarray = slope, degree: int = degree) -> np.ndarray:
            return (1 + (p - lo) / (hi - lo) @ slope) ** degree

        weights = np.linalg.solve(over.weights(over.nodes[:m])[:, :m], exactly(over.nodes[:m]))
        places = np.vstack([lo, hi, rng.uniform(lo, hi, (20, q))])
        error = np.abs(over.weights(places)[:, :m] @ weights - exactly(places))
        assert error.max() <= 1e-9 * exactly(places).max()


def test_states_converge_with_their_degree_where_modes_meet_on_the_axis() -> None:
    """At flutter two vectors become one, but the space of both stays analytic: each degree gains its digits."""
    M, K = np.eye(4), np.diag([1.0, 1.1, 20.0, 30.0])
    rub = np.zeros((4, 4))
    rub[0, 1], rub[1, 0], rub[2, 0], rub[1, 3] = 1.0, -1.0, 2.0, -3.0

    def at(values: dict[str, float]) -> list[np.ndarray]:
        return [M, 0.02 * M, K + values["mu"] * rub]

    ranges = {"mu": (0.0, 0.1)}  # flutter at 0.05
    errors = []
    for most in (1, 2, 3, 5):
        states, worst = states_of(at, ranges, most), 0.0
        for mu in np.linspace(0.0, 0.1, 11).tolist():
            M_, D, K_ = at({"mu": mu})
            lam, x, _ = states.pairs({"mu": mu}, (K_, D, M_), CONTOUR.encloses)
            residual = K_ @ x + D @ x * lam + M_ @ x * lam**2
            worst = max(worst, float((la.norm(residual, axis=0) / la.norm(x, axis=0)).max()))
            assert len(lam) == 2
        errors.append(worst)
    assert errors[-1] < 1e-6 and all(b < a / 10 for a, b in pairwise(errors)), errors


def test_a_pair_is_listed_once() -> None:
    rng = np.random.default_rng(5)
    here = pencil(rng, 20)
    lam, x, z = exact(here)
    M, D, K = here

    class Twice(States):
        def pairs(self, *_: object) -> tuple[np.ndarray, ...]:
            return np.append(lam, lam[:1] * (1 + 1e-9)), np.hstack([x, x[:, :1]]), np.hstack([z, z[:, :1]])

    none = fixed(np.zeros((40, 1)), np.zeros((40, 1)))
    twice = Twice(none.over, none.right, none.left, 1.0)
    number = len(lam) + np.count_nonzero(lam.imag)
    found = listed(twice, {}, (K, D, M), CONTOUR.encloses, number, sizes_of(here), 1e-3)
    assert found is not None and len(found[0]) == len(lam)


@pytest.mark.filterwarnings("error")
def test_states_that_are_singular_list_nothing() -> None:
    """Right and left states that do not act on each other: LAPACK has no eigenvalues then, and the whole problem is solved."""
    M, D, K = here = pencil(np.random.default_rng(6), 20)
    apart = fixed(np.eye(40)[:, :5], np.eye(40)[:, 10:15])
    assert listed(apart, {"p": 0.5}, (K, D, M), CONTOUR.encloses, 5, sizes_of(here), 1e-3) is None


@pytest.mark.filterwarnings("error")
def test_a_pair_at_an_exact_eigenvalue_needs_no_regular_matrix() -> None:
    """P(0) of a model that moves freely is singular: a pair there cannot be iterated, and is not listed."""
    M, D, K = np.eye(2), 0.1 * np.eye(2), np.diag([0.0, 1.0])
    free = fixed(np.eye(4), np.eye(4))
    exact_pair = np.array([[1.0], [0.0]]) + 0j

    class Free(States):
        def pairs(self, *_: object) -> tuple[np.ndarray, ...]:
            return np.zeros(1, dtype=complex), exact_pair, exact_pair

    def rough(lam: np.ndarray, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        return np.where(np.isfinite(x).all(axis=0), 1.0, np.nan)

    here = Free(free.over, free.right, free.left, 1.0)
    assert listed(here, {}, (K, D, M), CONTOUR.encloses, 1, rough, 1e-3) is None


def test_inverse_iteration_mends_a_mixed_pair() -> None:
    rng = np.random.default_rng(7)
    here = pencil(rng, 20)
    M, D, K = here
    lam, x, z = exact(here)
    mixed = x + 0.01 * np.roll(x, 1, axis=1), z + 0.01 * np.roll(z, -1, axis=1)
    before = settled(of_each((K, D, M), mixed[0]), lam * (1 + 1e-7), *mixed)
    after = iterated((K, D, M), *before[:3])
    assert (sizes_of(here)(*after) < 1e-6 * sizes_of(here)(*before[:3])).all()
    np.testing.assert_allclose(after[0], lam, rtol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_the_inverse_beside_some_pairs_is_that_without_them(seed: int) -> None:
    M, D, K = pencil(rng := np.random.default_rng(seed), 16)
    D = D + np.diag(rng.uniform(0.0, 8.0, 16))
    every = all_inside([M, D, K], Contour(sides=(-50.0, 50.0, 50.0)))
    lam, x, z, images = settled(of_each((K, D, M), every[1]), *every)
    assert la.norm(images - of_each((K, D, M), x)) < 1e-12 * la.norm(images)
    assert len(lam) == 32
    inside, norms = CONTOUR.encloses(lam), []
    at = np.flatnonzero(inside & (lam.imag >= 0))
    for s in lam[at] + 1e-5:  # at λ itself P has no inverse; without these pairs it hardly changes
        near = (x[:, inside] / (s - lam[inside])) @ z[:, inside].conj().T
        norms.append(la.norm(la.inv(K + s * D + s * s * M) - near, 2))
    found = inverse_beside(lam[at], lam[~inside], x[:, ~inside], z[:, ~inside])
    assert (found.at == lam[at]).all() and (0.9 * np.array(norms) <= found.size).all()
    assert (found.size <= 1.001 * np.array(norms)).all()
    np.testing.assert_array_equal(found(lam[at][::-1] + 1e-9), found.size[::-1])


@pytest.mark.parametrize("seed", range(4))
def test_what_states_lack_in_the_basis_is_in_their_sizes(seed: int) -> None:
    """Without any error outside: |δλ| ≤ ‖P⁻¹‖ ‖Px‖ ‖Pᴴz‖ with the inverse beside the pairs inside, to first order."""
    M, D, K = pencil(np.random.default_rng(seed), 16)

    def at(values: dict[str, float]) -> list[np.ndarray]:
        return [M, D, K + values["load"] * np.diag(np.arange(16.0))]

    states, worst = states_of(at, {"load": (0.0, 0.4)}, 2), 0.0
    for load in np.linspace(0.0, 0.4, 7).tolist():
        M_, D_, K_ = at(values := {"load": load})
        matrices = K_, D_, M_
        every = all_inside(at(values), Contour(sides=(-50.0, 50.0, 50.0)))
        lam, x, z, _ = settled(of_each(matrices, every[1]), *every)
        inside = CONTOUR.encloses(lam)
        here = replace(states, inverse=inverse_beside(lam[inside], lam[~inside], x[:, ~inside], z[:, ~inside]))
        (found, _, _, size), *_ = seen(here, values, matrices, CONTOUR.encloses, inside.sum(), lambda lam, *_: 0 * lam.real, 1.0)
        ratio = np.abs(found[:, None] - lam).min(axis=1) / np.maximum(size, 1e-13)
        worst = max(worst, float(ratio.max()))
    assert 0.1 < worst < 1.2, worst


@pytest.mark.slow
def test_a_model_of_a_box_solves_its_states_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, n = np.random.default_rng(1), 80
    K, turn = fs.chain(n).K, sp.random_array((n, n), density=2 / n, rng=np.random.default_rng(2))
    dashpots = sp.diags_array(rng.uniform(0.0, 0.05, n))
    full = fs.Affine(fs.chain(n).M, [(1.0, dashpots), (1.0, sp.csr_array(0.02 * (turn - turn.T)))],
                     [(1.0, K), ("mu", sp.csr_array(0.01 * turn))])
    small = fs.reduce(full, fs.ParameterBox({"mu": (0.0, 0.5)}, band=(0.0, 0.4)))
    assert small.evidence == "certified" and all(
        cell.states and cell.states.right.shape[2] == cell.number for cell in small.cells)
    places = np.linspace(0.0, 0.5, 7)
    slow = small._with(cells=tuple(replace(cell, states=None) for cell in small.cells))
    whole = [slow.modes(mu=float(mu)) for mu in places]
    monkeypatch.setattr(parameter_box, "eigenpairs", lambda *_: pytest.fail("the whole problem was solved"))
    for mu, other in zip(places, whole, strict=True):
        found = small.modes(mu=float(mu))
        assert found.evidence == "certified" and len(found) == len(other)
        assert (np.abs(found.eigenvalues - other.eigenvalues) <= found.error_bar + other.error_bar).all()


def test_enclosures_have_the_same_projection() -> None:
    """In a unit of λ other than 1: `Companion` has it in a and b, states in their parts."""
    rng = np.random.default_rng(8)
    M, D, K = pencil(rng, 12)
    right, left = rng.standard_normal((2, 24, 8))
    states = States.of(Polynomials.of({"p": (0.0, 1.0)}, 1), [Spaces(right, left)], 3.0)
    lam, _, _ = states.pairs({"p": 0.5}, (K, D, M), lambda s: np.isfinite(s))
    a, b, _, unit = Companion.between([M], [D], [K], 3.0, right, left)
    every = unit * la.eigvals(a.sum(axis=0), b.sum(axis=0))
    np.testing.assert_allclose(np.sort_complex(every[every.imag >= 0]), np.sort_complex(lam), rtol=1e-8)


def test_eigenvalues_that_are_all_real_are_no_frequencies() -> None:
    """NumPy returns real arrays then, which `in_band` would take for ω: a mode in the band was not listed, but certified."""
    matrices = np.eye(2), 5.0 * np.eye(2), np.diag([1.0, 2.0])
    M, D, K = matrices
    lam, _, _ = fixed(np.eye(4), np.eye(4)).pairs({"p": 0.5}, (K, D, M), lambda s: np.ones(len(s), dtype=bool))
    assert len(lam) == 4 and not lam.imag.any()
    assert in_band(lam, (0.0, 1.0), (-1.0, 1.0)).sum() == 2
