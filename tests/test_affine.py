"""A pencil with named parameters: its matrices at values, some parameters fixed, projected once."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import eigh

import femsub as fs


def spinning() -> fs.Affine:
    """A rotor of three DOF with D/Ω, a gyroscopic ΩG, Ω²K and a follower force."""
    rng = np.random.default_rng(3)
    A = rng.standard_normal((5, 3, 3))
    sym, skew = A @ np.swapaxes(A, 1, 2), A - np.swapaxes(A, 1, 2)
    return fs.Affine(sym[0], [(0.1, sym[1]), (lambda speed: 1 / speed, sym[2]), ("speed", skew[3])],
                     [(1.0, sym[3]), (lambda speed: speed**2, sym[4]), ("mu", A[0])])


def test_its_pencil_is_the_sum() -> None:
    family = spinning()
    assert family.parameters == ("speed", "mu") and family.size == 3 and "parameters speed, mu" in repr(family)
    pencil = family.at(speed=2.0, mu=0.3)
    for name, factors in (("M", [1.0]), ("D", [0.1, 0.5, 2.0]), ("K", [1.0, 4.0, 0.3])):
        exact = sum(factor * A for factor, (_, A) in zip(factors, getattr(family, name), strict=True))
        np.testing.assert_allclose(getattr(pencil, name), exact, rtol=1e-15)
    assert pencil.symmetric == (True, False, False)
    part = family.fixed(mu=0.3)
    assert part.parameters == ("speed",) and family.parameters == ("speed", "mu")
    assert np.array_equal(part.at(speed=2.0).K, pencil.K)
    assert fs.Affine(np.eye(2), None, [(lambda a, b, c=2.0: a * b * c, np.eye(2))]).fixed(a=3.0).at(b=4.0).K[0, 0] == 24.0


def test_each_matrix_is_projected_once_and_the_pencils_agree() -> None:
    family, V = spinning(), np.linalg.qr(np.random.default_rng(1).standard_normal((3, 2)))[0]
    small, full = family.reduced(V).at(speed=1.5, mu=0.2), family.at(speed=1.5, mu=0.2)
    for name in "MDK":
        np.testing.assert_allclose(getattr(small, name), V.T @ getattr(full, name) @ V, atol=1e-14)
    assert small.symmetric[0]
    sub = fs.chain(30, belt=2)
    rom = fs.reduce(sub, fs.CraigChang(6), ports=True)
    w = sp.csr_array(sub.port("belt")[:, None])
    chain = fs.Affine(sub.M, [(1.0, sub.D), ("slope", w @ w.T)], sub.K)
    assert chain.at(slope=-0.1).is_sparse and "sparse" in repr(chain)
    found = fs.complex_modes(chain.reduced(rom.V).at(slope=-0.1)).eigenvalues
    exact = fs.complex_modes(rom, fs.Belt(slope=-0.1)).eigenvalues
    assert np.abs(found[:, None] - exact).min(axis=1).max() < 1e-12


def test_a_reduced_family_keeps_the_cut_off_of_its_basis() -> None:
    """Two modes above the cut-off flutter, which the basis does not know: no answer may be certified there."""
    sub = fs.chain(30, belt=2)
    M, K = (A.toarray() for A in (sub.M, sub.K))
    omega, X = (part[12:14] if part.ndim == 1 else part[:, 12:14] for part in eigh(K, M))
    F = M @ X * np.sqrt(omega[1] - omega[0])
    family = fs.Affine(M, 1e-4 * K, [(1.0, K), ("mu", F @ np.array([[0.0, 1.0], [-1.0, 0.0]]) @ F.T)])
    rom = fs.reduce(replace(sub, ports={}), fs.CraigBampton(4))
    band, asked = (0.0, 1.5 * float(np.sqrt(omega[1]))), {"contacts": None, "parameter": "mu", "between": (0.0, 1.0)}
    assert np.isfinite(fs.critical_value(family, band=band, **asked).value) and rom.cutoff < np.sqrt(omega[0])
    for small in (family.reduced(rom), family.reduced(rom.V, cutoff=rom.cutoff)):
        pencils = small.at(mu=1.0), small.fixed(mu=1.0).at(), family.at(mu=1.0).reduced(rom)
        for model in (small, *pencils):
            assert model.cutoff == rom.cutoff and f"cut-off {rom.cutoff:.4g}" in repr(model)
        with pytest.raises(fs.InputError, match="above the cut-off of the reduced Affine"):
            fs.critical_value(small, band=band, **asked)
        for pencil in pencils:
            with pytest.raises(fs.InputError, match="above the cut-off of the reduced Pencil"):
                fs.complex_modes(pencil, band=band)
        assert f"up to the cut-off {rom.cutoff:.4g} rad/time" in repr(fs.critical_value(small, **asked))
    alone = family.reduced(rom.V)  # whose cut-off nobody knows
    for found in (*(fs.critical_value(alone, band=one, **asked) for one in (band, None)), fs.complex_modes(alone.at(mu=1.0))):
        assert found.evidence == "not checked" and "not known" in repr(found) and "cut-off not known" in repr(alone)
    assert family.reduced(np.eye(30)).cutoff == np.inf
    for one in (family, family.at(mu=0.5)):
        with pytest.raises(fs.InputTypeError, match=r"\.reduced\(rom\)"):
            fs.reduce(one, fs.CraigBampton(4))  # type: ignore[call-overload]


@pytest.mark.parametrize("kind", [sp.csr_array, np.asarray])
def test_what_does_not_act_leaves_no_trace(kind: Callable[[np.ndarray], Any]) -> None:
    """A sparse matrix whose factor is 0 is not added, and one that stands alone is not copied."""
    K, friction = 2 * np.eye(3), np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    family = fs.Affine(kind(np.eye(3)), None, [(1.0, kind(K)), ("mu", kind(friction))])
    still, sliding = family.at(mu=0.0), family.at(mu=0.5)
    assert still.symmetric[2] and not sliding.symmetric[2]
    if kind is sp.csr_array:
        assert np.shares_memory(still.K.data, family.K[0][1].data) and sliding.K.nnz == 4
        assert np.shares_memory(still.M.data, sliding.M.data)
    for pencil, mu in ((still, 0.0), (sliding, 0.5)):
        assert not abs(pencil.K - (K + mu * friction)).max()
    mixed = fs.Affine(sp.eye_array(3), None, [(1.0, sp.csr_array(K)), ("mu", kind(friction))])
    assert [mixed.at(mu=mu).is_sparse for mu in (0.0, 0.5)] == [kind is sp.csr_array] * 2  # no value changes the kind
    nothing = fs.Affine(kind(np.eye(3)), [("a", kind(K)), ("a", kind(K))], kind(K)).at(a=0.0)
    assert abs(nothing.D).max() == 0 and nothing.D.shape == (3, 3)
    with pytest.raises(ValueError, match="read-only"):
        (sliding.K.data if kind is sp.csr_array else sliding.K)[0] = 1.0


def test_what_does_not_fit_is_told() -> None:
    family, eye = spinning(), np.eye(2)
    for call, told in ((lambda: family.at(speed=1.0), "no value is given for mu"),
                       (lambda: family.at(speed=1.0, mu=0.1, nu=2.0), "unknown parameter 'nu'"),
                       (lambda: family.at(speed=0.0, mu=0.1), "cannot be computed at speed = 0"),
                       (lambda: family.at(speed="x", mu=0.1), "speed must be a number"),
                       (lambda: fs.Affine(eye, None, np.eye(3)), "3 x 3, but the other"),
                       (lambda: fs.Affine(eye, None, None), "at least one matrix"),
                       (lambda: fs.Affine(eye, None, [("1/speed", eye)]), "no name of a parameter"),
                       (lambda: fs.Affine(eye, None, [(None, eye)]), "factor of a matrix in K must be a number"),
                       (lambda: fs.Affine(eye, None, [(lambda *a: 1.0, eye)]), "must name its arguments"),
                       (lambda: family.reduced(np.eye(2)), "V must have 3 rows")):
        with pytest.raises((fs.InputError, fs.InputTypeError), match=told):
            call()


def reciprocal_logarithm(p: float, scale: float = 1.0) -> float:
    return scale / math.log(p)


@pytest.mark.parametrize(("theta", "value", "words"), [
    (lambda p: math.log(p), -1.0, r"factor <lambda>\(p\) cannot be computed at p = -1: ValueError"),
    (reciprocal_logarithm, 1.0, r"factor reciprocal_logarithm\(p\) cannot be computed at p = 1: ZeroDivisionError"),
    (lambda p: {0.0: 1.0}[p], 2.0, r"cannot be computed at p = 2: KeyError: 2"),
    (lambda p: None, 2.0, r"factor <lambda>\(p\) at p = 2 must be a number, not None")])
def test_what_a_factor_raises_is_told_with_factor_and_value(theta: Callable[[float], float], value: float, words: str) -> None:
    family = fs.Affine(np.eye(2), None, [(1.0, np.eye(2)), (theta, np.eye(2))])
    with pytest.raises((fs.InputError, fs.InputTypeError), match=words) as told:
        family.at(p=value)
    assert "number" in words or type(told.value.__cause__).__name__ in words
    with pytest.raises((fs.InputError, fs.InputTypeError), match="the factor"):
        fs.critical_value(family, None, "p", between=(value - 1, value + 1))


def test_a_factor_with_one_parameter_fixed_is_told_with_both() -> None:
    family = fs.Affine(np.eye(1), None, [(lambda a, b: math.sqrt(a - b), np.eye(1))]).fixed(a=1.0)
    with pytest.raises(fs.InputError, match=r"factor <lambda>\(a, b\) cannot be computed at a = 1, b = 2: ValueError"):
        family.at(b=2.0)


@pytest.mark.parametrize("storage", ["dense", "sparse"])
def test_d_and_k_in_each_others_place_are_noticed(storage: str) -> None:
    """Dashpots, damping of the material, and both; in their own places there is no word, as heavy as the damping may be."""
    sub = fs.chain(30, damping=0.1)
    beam = fs.beam(1.0, 10, E=2.1e11, I=1e-9, rho=7850.0, A=1e-4, supports={"left": "clamped"})
    heavy = fs.chain(30, damping=0.0)
    cases = [(sub.M, sub.K, sub.D), (sub.M, sub.K, 0.01 * sub.K + 0.01 * sub.M), (beam.M, beam.K, 1e-7 * beam.K)]
    for M, K, D in cases:
        M, K, D = (part.toarray() if storage == "dense" else sp.csr_array(part) for part in (M, K, D))
        for model in (fs.Pencil(M, K, D), fs.Substructure(M, D, K)):
            with warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always")
                fs.complex_modes(model, count=4)  # which may be inaccurate as well
            assert "D and K seem to be in each other's place" in str(told[0].message)
        with pytest.warns(fs.FemsubWarning, match="in each other's place"):
            fs.Affine(M, K, [(1.0, D), ("mu", K)])
        fs.Affine(M, D, [(1.0, K), ("mu", K)])
        fs.complex_modes(fs.Pencil(M, D, K), count=4)  # warnings are errors here
    for D in (40.0 * heavy.M, sp.diags_array(np.linspace(30, 50, 30))):
        fs.complex_modes(fs.Pencil(heavy.M, sp.csr_array(D), heavy.K), count=4)
