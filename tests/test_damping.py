"""Rayleigh, modal and dashpot damping on full and reduced models."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from benchmarks.lattices import lattice, membrane

STEEL = {"E": 210e9, "I": 1e-2**4 / 12, "rho": 7850.0, "A": 1e-4}


def beam(n: int = 12, **options: object) -> fs.Substructure:
    return fs.beam(1.0, n, **STEEL, supports={"left": "clamped"}, interface=("right",), ports={"belt": 0.5}, **options)


def reduced() -> fs.ReducedSubstructure:
    return fs.reduce(beam(), fs.CraigChang(modes=4), ports=True)


def ratios(sub: fs.Substructure, count: int) -> tuple[np.ndarray, np.ndarray]:
    """|λ| and ζ = -Re λ/|λ| of the lowest pairs."""
    lam = fs.complex_modes(sub).eigenvalues
    lam = lam[lam.imag > 0][:count]
    return np.abs(lam), -lam.real / np.abs(lam)


@pytest.mark.parametrize("make", [beam, reduced])
def test_rayleigh(make) -> None:  # type: ignore[no-untyped-def]
    sub = make()
    damped = fs.damped(sub, rayleigh=(3.0, 1e-5))
    assert type(damped) is type(sub) and sp.issparse(damped.D) == sp.issparse(sub.K)
    assert abs(damped.D - 3.0 * sub.M - 1e-5 * sub.K).max() <= 1e-14 * abs(damped.D).max()
    omega, zeta = ratios(damped, 4)
    assert np.allclose(zeta, 1.5 / omega + 0.5e-5 * omega, rtol=1e-6)
    assert abs(sub.D).max() == 0  # the model given is as it was


@pytest.mark.parametrize("order", [1, -1])
def test_rayleigh_through_two_ratios(order: int) -> None:
    sub = beam()
    omega = fs.normal_modes(sub, count=4).frequencies
    points = ((omega[0], 0.02), (omega[2], 0.03))[::order]
    _, zeta = ratios(fs.damped(sub, ratios=points), 3)
    assert np.allclose(zeta[[0, 2]], [0.02, 0.03], rtol=1e-8)
    only_mass = fs.damped(sub, ratios=((1.0, 0.04), (4.0, 0.01))).D  # on the limit: β = 0 up to rounding
    assert abs(only_mass - 0.08 * sub.M).max() < 1e-10 * abs(only_mass).max()


@pytest.mark.parametrize("make", [beam, reduced])
def test_modal_ratios(make) -> None:  # type: ignore[no-untyped-def]
    sub = make()
    _, zeta = ratios(fs.damped(sub, modal=(0.01, 0.05, 0.0, 0.02)), 5)
    assert np.allclose(zeta[:5], [0.01, 0.05, 0.0, 0.02, 0.0], atol=1e-8)
    _, zeta = ratios(fs.damped(sub, modal=0.03), sub.size)
    assert len(zeta) == sub.size and np.allclose(zeta, 0.03, rtol=1e-5)


def test_modal_damping_leaves_rigid_motion_alone() -> None:
    sub = fs.beam(1.0, 10, **STEEL)
    damped = fs.damped(sub, modal=0.02)
    rigid = fs.normal_modes(sub, count=1).shapes[:, :2]
    assert np.abs(damped.D @ rigid).max() < 1e-9 * (abs(damped.D) @ np.abs(rigid)).max()
    assert np.array_equal(damped.D.toarray(), damped.D.toarray().T)


def test_dashpots() -> None:
    sub = lattice(4, 3, held=True)
    D = fs.damped(sub, dashpots={3: 2.0, (0, 5): 0.5, "belt": 4.0}).D.toarray()
    expected = np.zeros((sub.size, sub.size))
    expected[3, 3] = 2.0
    expected[np.ix_([0, 5], [0, 5])] = [[0.5, -0.5], [-0.5, 0.5]]
    expected += 4.0 * np.outer(sub.port("belt"), sub.port("belt"))
    assert np.allclose(D, expected, rtol=1e-14, atol=0)


def test_dashpots_of_a_reduced_model_sit_at_the_component() -> None:
    sub = beam()
    for method in (fs.CraigChang(modes=4), fs.CraigBampton(modes=4)):
        rom = fs.reduce(sub, method, ports=True)
        before = fs.reduce(fs.damped(sub, dashpots={4: 2.0, (0, 6): 1.0, "belt": 3.0}), method, ports=True)
        after = fs.damped(rom, dashpots={4: 2.0, (0, 6): 1.0, "belt": 3.0})
        assert isinstance(after, fs.ReducedSubstructure) and np.allclose(after.D, before.D, rtol=1e-12)


def test_kinds_add_up_and_so_do_calls() -> None:
    sub = beam()
    at_once = fs.damped(sub, rayleigh=(1.0, 1e-6), modal=0.01, dashpots={"belt": 2.0}).D
    one_by_one = fs.damped(fs.damped(fs.damped(sub, rayleigh=(1.0, 1e-6)), modal=0.01), dashpots={"belt": 2.0}).D
    assert abs(at_once - one_by_one).max() < 1e-14 * abs(at_once).max()
    assert abs(beam(rayleigh=(1.0, 1e-6)).D - fs.damped(sub, rayleigh=(1.0, 1e-6)).D).max() == 0


@pytest.mark.parametrize(("arguments", "words"), [
    ({}, "at least one of rayleigh"), ({"rayleigh": (0.1, -1e-3)}, "beta of rayleigh must not be negative"),
    ({"rayleigh": 0.1}, "must be a pair"), ({"rayleigh": (1, 0), "ratios": ((1, 0.1), (2, 0.1))}, "Give only one of them"),
    ({"ratios": ((1.0, -0.1), (2.0, 0.1))}, "zeta of ratios must not be negative"),
    ({"ratios": ((2.0, 0.1), (2.0, 0.2))}, "two different positive frequencies"),
    ({"ratios": ((1.0, 0.02), (4.0, 0.1))}, "second ζ can be 0.005 to 0.08"), ({"ratios": (1.0, 0.1)}, "each point of ratios"),
    ({"modal": -0.01}, "modal must not be negative"), ({"modal": [0.01, -0.02]}, r"modal\[1\] must not be negative"),
    ({"modal": "all"}, "must be a ratio"), ({"modal": [0.01] * 99}, "99 elastic modes were asked for"),
    ({"dashpots": {"belt": -1.0}}, "dashpot 'belt' must not be negative"), ({"dashpots": {"bolt": 1.0}}, "did you mean 'belt'"),
    ({"dashpots": {99: 1.0}}, "there is no DOF 99"), ({"dashpots": {(1, 1): 1.0}}, "has the same DOF at both ends"),
    ({"dashpots": {(1, 2, 3): 1.0}}, "at one DOF or between two"), ({"dashpots": [1.0]}, "dashpots must map"),
    ({"dashpots": {1.5: 1.0}}, "must be a whole number"),
])
def test_damped_refuses(arguments: dict, words: str) -> None:
    with pytest.raises((ValueError, TypeError), match=words):
        fs.damped(beam(), **arguments)


def test_modal_damping_of_a_large_sparse_model_is_refused() -> None:
    with pytest.raises(fs.InputError, match="Apply it to the reduced model"):
        fs.damped(membrane(50), modal=0.01)
    with pytest.raises(fs.InputTypeError, match="takes a Substructure"):
        fs.damped(fs.Pencil([[1.0]], None, [[1.0]]), modal=0.01)  # type: ignore[type-var]
