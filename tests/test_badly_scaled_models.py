"""Units of single DOF, singular mass matrices, coalescing eigenvalues: no unit changes a result, and every error bar holds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import scipy.sparse as sp
from scaledmodels import complex_outcome, normal_outcome, problem, same

import femsub as fs
from benchmarks.lattices import lattice
from femsub.modes.quadratic.complex_modes import with_bars

SEEDS = (0, 3, 5, 6, 9, 17, 277, 25, 37, 58, 55, 62, 78)  # each kind of model, damping, units and question; most were refused


@pytest.mark.sampled(5)
@pytest.mark.parametrize("seed", [*SEEDS, pytest.param(22, marks=pytest.mark.rare)])
def test_units_of_the_dof_change_no_complex_mode(seed: int) -> None:
    kind, figures = complex_outcome(seed)
    assert kind == "same", figures


@pytest.mark.parametrize("seed", [0, 3, 5, 22, 37, 62])
def test_units_of_the_dof_change_no_normal_mode(seed: int) -> None:
    kind, figures = normal_outcome(seed)
    assert kind == "same", figures


@pytest.mark.sampled(2)
@pytest.mark.parametrize("power", [3, 6, 9, 13, 17])
def test_entries_of_unlike_size_cost_no_digits(power: int) -> None:
    """By counts as by bands, the bars stay what they are in one unit."""
    sub = lattice(27, 10, held=True)
    D = sub.M * 1e-3 + sp.diags_array(0.05 * np.random.default_rng(1).random(sub.size))
    S = sp.diags_array(2.0 ** np.where(np.arange(sub.size) % 2, -power, power))
    alike = fs.complex_modes(fs.Substructure(sub.M, sub.K, D), count=12, evidence=False)
    unlike = fs.complex_modes(fs.Substructure(S @ sub.M @ S, S @ sub.K @ S, S @ D @ S), count=12, evidence=False)
    assert same(alike, unlike) <= 1
    assert unlike.error_bar.max() < 100 * alike.error_bar.max()
    assert np.allclose(np.linalg.norm(unlike.shapes, axis=0), 1)


def test_dof_that_are_alike_are_left_as_they_are() -> None:
    pencil = fs.chain(300, belt=2).linearised(fs.Belt(slope=-0.1))
    assert pencil.alike() is pencil
    case, _ = problem(3)
    model = case.model(True)
    other = (model if isinstance(model, fs.Pencil) else model.pencil).alike()
    size = np.abs(other.K.diagonal())
    assert size.max() <= 4 * size.min()


@pytest.mark.parametrize("coupling", [0.5, 50.0])
def test_friction_leaves_the_units_to_the_stiffness_unless_it_is_far_larger(coupling: float) -> None:
    """The units come from the diagonal of K; rows in which far more stands beside it, from all of the matrices."""
    size = 2.0 ** np.array([0, 12, -9, 3])
    K = np.eye(4) + coupling * np.diag(np.ones(3), 1)
    alone = fs.Pencil(np.diag(size**2), None, np.diag(size) @ np.eye(4) @ np.diag(size))
    pencil = fs.Pencil(np.diag(size**2), None, np.diag(size) @ K @ np.diag(size))
    assert np.array_equal(alone.units[0], 1 / size)
    assert np.array_equal(pencil.units[0], 1 / size) is (coupling < 1)
    assert np.array_equal(*pencil.units)



def test_rows_of_unlike_size_in_an_unsymmetric_pencil() -> None:
    """Equations in other units than the DOF: rows and columns are scaled apart, where M is unsymmetric anyway."""
    rng = np.random.default_rng(4)
    sub = lattice(15, 10, held=True)
    R, C = (sp.diags_array(2.0 ** rng.integers(-12, 13, sub.size)) for _ in range(2))
    D = sub.M * 0.02
    clean = fs.complex_modes(fs.Pencil(sub.M, D, sub.K), count=10, evidence=False)
    found = fs.complex_modes(fs.Pencil(R @ sub.M @ C, R @ D @ C, R @ sub.K @ C), count=10, evidence=False)
    assert same(clean, found) <= 1 and found.error_bar.max() < 1e-4 * np.abs(found.eigenvalues).max()


@pytest.mark.slow
def test_symmetric_stiffness_beside_an_unsymmetric_mass() -> None:
    """Rows and columns are scaled apart then, which leaves no K symmetric: its factor does not serve for the left vectors."""
    n = 160
    K = sp.diags_array([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    M = sp.diags_array([-0.05 * np.ones(n - 1), np.ones(n), 0.1 * np.ones(n - 1)], offsets=[-1, 0, 1])
    S = sp.diags_array(2.0 ** np.random.default_rng(0).integers(-12, 12, n))
    D = 0.02 * K
    clean = fs.complex_modes(fs.Pencil(M, D, K), count=10, evidence=False)
    model = fs.Pencil(S @ M @ S, S @ D @ S, S @ K @ S)
    found = fs.complex_modes(model, count=10, evidence=False)
    assert model.symmetric == (False, True, True)
    assert same(clean, found) <= 1
    assert found.error_bar.max() < 100 * clean.error_bar.max()


# singular M

def mixed(parts: list[tuple[float, float, float]], seed: int) -> tuple[fs.Pencil, np.ndarray]:
    """Oscillators m λ² + d λ + k by themselves, in other coordinates: an integer T with det T = 1. All numbers are exact."""
    rng, n = np.random.default_rng(seed), len(parts)
    low, high = (np.tril(rng.integers(-1, 2, (n, n)), -1) + np.eye(n) for _ in range(2))
    T = low @ high.T
    exact = np.concatenate([np.roots(np.trim_zeros(part, "f")) for part in parts])
    return fs.Pencil(*(T.T @ np.diag([part[i] for part in parts]) @ T for i in range(3))), exact


def within(found: fs.ComplexModes, exact: np.ndarray) -> None:
    """One to one, and within the bars."""
    from scipy.optimize import linear_sum_assignment

    assert len(found) == len(exact)
    ratio = np.abs(found.eigenvalues[:, None] - exact) / (found.error_bar[:, None] + 4e-16 * np.abs(exact))
    rows, columns = linear_sum_assignment(np.minimum(ratio, 1e6))
    assert ratio[rows, columns].max() <= 1


SINGULAR = {
    "statics": [(1, 0, 4), (2, 0, 3), (0, 0, 1), (0, 0, 5), (1, 0, 9), (0, 0, 2)],
    "dashpots": [(1, 0.5, 4), (0, 3, 1), (2, 0.25, 3), (0, 0, 1), (0, 0.5, 2), (1, 0.125, 16)],
    "all massless but one": [(1, 0.5, 1), (0, 2, 1), (0, 1, 8), (0, 0, 1), (0, 0, 3)],
    "unstable": [(1, -0.5, 4), (0, 0, 2), (1, 0.25, 9), (0, 1, 3), (0, 0, 7)],
}


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", SINGULAR)
def test_a_singular_mass_not_aligned_with_dof(name: str, seed: int) -> None:
    pencil, exact = mixed(SINGULAR[name], seed)
    for unit in (np.ones(pencil.size), 2.0 ** np.random.default_rng(seed).integers(-9, 10, pencil.size)):
        S = np.diag(unit)
        found = fs.complex_modes(fs.Pencil(S @ pencil.M @ S, S @ pencil.D @ S, S @ pencil.K @ S))
        within(found, exact)
        assert found.growth == pytest.approx(exact.real.max(), abs=1e-9)
        assert found.is_stable is {"statics": None, "unstable": False}.get(name, True)


@pytest.mark.parametrize("friction", [0.0, 0.125])
def test_constraints_by_multipliers(friction: float) -> None:
    """q₁ = q₂ of two oscillators and a third: M and K of the tied ones add up, and the multiplier adds no eigenvalue."""
    M, K = np.diag([1.0, 3.0, 1.0, 0.0]), np.diag([2.0, 6.0, 9.0, 0.0])
    K[3, :2] = K[:2, 3] = 1, -1
    D = np.diag([0.25, 0.25, friction, 0.0])
    found = fs.complex_modes(fs.Pencil(M, D, K))
    within(found, np.concatenate([np.roots([4, 0.5, 8]), np.roots([1, friction, 9])]))


def test_unsymmetric_damping_of_what_has_no_mass() -> None:
    """P = [[λ² + λ + 2, λ], [aλ, 1]]: det P = (1 - a)λ² + λ + 2, turned so that no DOF is massless."""
    T = np.array([[1.0, 1.0], [0.0, 1.0]])
    for a in (0.0, 0.5, -3.0):
        M, D, K = np.diag([1.0, 0.0]), np.array([[1.0, 1.0], [a, 0.0]]), np.diag([2.0, 1.0])
        within(fs.complex_modes(fs.Pencil(*(T.T @ part @ T for part in (M, D, K)))), np.roots([1 - a, 1, 2]))


# coalescing eigenvalues

def critical(seed: int, near: Callable[[np.random.Generator], float]) -> tuple[fs.Pencil, np.ndarray, float]:
    """A sparse pencil of small blocks as in `mixed`; one oscillator has critical damping, or nearly. Its frequency, too."""
    rng = np.random.default_rng([seed, 5])
    omega = float(rng.integers(1, 6))
    blocks, exact = [], []
    for start in range(3):
        n = int(rng.integers(2, 5))
        frequency, share = rng.integers(2, 9, n).astype(float), rng.integers(0, 5, n) / 2
        if start == 0:
            frequency[0], share[0] = omega, near(rng)
        T = np.eye(n) + np.triu(rng.integers(-2, 3, (n, n)), 1)
        d = 2 * share * frequency
        blocks.append([sp.coo_array(T.T @ np.diag(part) @ T) for part in (np.ones(n), d, frequency**2)])
        root = np.sqrt((d / 2 - frequency) * (d / 2 + frequency) + 0j)
        exact += [-d / 2 - root, np.where(d / 2 + root != 0, -frequency**2 / np.where(d / 2 + root != 0, d / 2 + root, 1), 0)]
    rest = 110 - sum(block[0].shape[0] for block in blocks)
    blocks.append([sp.coo_array(np.diag(part)) for part in (np.ones(rest), np.zeros(rest), rng.integers(400, 900, rest))])
    return fs.Pencil(*(sp.block_diag(part) for part in zip(*blocks, strict=True))), np.concatenate(exact), omega


@pytest.mark.parametrize("seeds", [range(1), pytest.param(range(1, 5), marks=pytest.mark.slow),
                                   pytest.param(range(5, 13), marks=pytest.mark.rare)])
@pytest.mark.parametrize("near", [0.0, 2.0**-30, 2.0**-44, -(2.0**-30)])
def test_bars_at_a_double_real_eigenvalue(near: float, seeds: range) -> None:
    """Whole, or cut by the edge of a band or by a count."""
    for seed in seeds:
        pencil, exact, omega = critical(seed, lambda rng: 1 + near)
        for ask in ({"band": (0, 10.3), "re": (-100, 100)}, {"band": (0, 10), "re": (-omega, 10)}, {"count": 1 + seed % 8}):
            found = fs.complex_modes(pencil, evidence=False, **ask)
            off = np.abs(found.eigenvalues[:, None] - exact).min(axis=1)
            assert (off <= found.error_bar).all(), (seed, ask)


def test_gaps_see_what_lies_beyond_the_list() -> None:
    """The bar at -1 + 8e-8i knows of the conjugate, which a band has cut off: the two are about to coalesce."""
    pencil = fs.Pencil(np.eye(2), 2 * np.eye(2), np.diag([1.0 + 6e-15, 4.0]))
    everything = fs.complex_modes(pencil)
    some = everything.eigenvalues.imag >= 0
    X = everything.shapes[:, some]
    alone = with_bars(pencil, everything.eigenvalues[some], X, X.conj(), everything.eigenvalues)
    assert np.allclose(alone.error_bar, everything.error_bar[some], rtol=1e-6)
    assert not np.allclose(with_bars(pencil, everything.eigenvalues[some][:1], X[:, :1], X[:, :1].conj(),
                                        np.array([-1.0 + 1j])).error_bar, alone.error_bar[:1], rtol=0.1)
