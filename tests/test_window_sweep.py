"""Windows of a parameter of any rank meet all crossings of lines, and their bounds are not too small."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from scipy.optimize import brentq

import femsub as fs
from femsub.modes import Line, Varied, WindowSweep, projection_over
from femsub.modes.quadratic.window_sweep import Window
from femsub.stability import followed

BAND = (0.1, 0.6)


def rubbing(seed: int, n: int = 64) -> fs.Affine:
    """A damped net of springs on which friction acts through all DOF, inside and outside of its low modes."""
    rng = np.random.default_rng(seed)
    extra, rub = (sp.random_array((n, n), density=3 / n, rng=rng) for _ in range(2))
    K = sp.csr_array(fs.chain(n).K + sp.diags_array(rng.uniform(0.0, 0.3, n)) + 0.1 * extra @ extra.T)
    M = sp.diags_array(rng.uniform(0.7, 1.4, n), format="csr")
    rub = sp.csr_array(rub + 0.3 * sp.diags_array(rng.standard_normal(n)) + 0.2 * sp.diags_array([np.ones(n - 1)], offsets=[1]))
    D = 1e-3 * K + 1e-3 * M
    return fs.Affine(M, [(1.0, D), ("p", sp.csr_array(0.01 * rub.T))], [(1.0, K), ("p", sp.csr_array(0.1 * rub))])


@cache
def eigenvalues(p: float) -> np.ndarray:
    """Of `rubbing(0)`, all of them."""
    pencil = rubbing(0).at(p=p).dense()
    n, inverse = pencil.size, np.linalg.inv(pencil.M)
    return np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ pencil.K, -inverse @ pencil.D]]))


def passing(rate: float, begin: tuple[float, complex], end: tuple[float, complex]) -> tuple[float, complex]:
    """(p, λ) where the eigenvalue that moves from begin to end, both (p, λ), has Re λ = rate."""
    (a, z), (b, to) = begin, end

    def moved(p: float) -> complex:
        every = eigenvalues(p)
        return every[np.abs(every - z - (p - a) / (b - a) * (to - z)).argmin()]

    value = brentq(lambda p: moved(p).real - rate, a, b, xtol=1e-10)
    return value, moved(value)


def sweep_of(family: fs.Affine) -> WindowSweep:
    terms = [(1, family.D[1][1]), (0, family.K[1][1])]
    projection = projection_over(family.at(p=0.5), [Varied(sp.csr_array(T), power, 0.5) for power, T in terms],
                                 (-0.05, BAND[1], *BAND), 0.01).changed([0.0, 0.0])
    followed.enriched_over(projection, np.ones(2), np.linspace(-0.5, 0.5, 7), BAND)
    return WindowSweep(projection, [1.0, 1.0], (-0.5, 0.5))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", [0, 1])
def test_its_losses_are_those_of_the_discs(seed: int) -> None:
    family = rubbing(seed)
    found = fs.critical_value(family, None, "p", between=(0.0, 0.7), band=BAND, solver="swept")
    exact = fs.critical_value(family, None, "p", between=(0.0, 0.7), band=BAND, solver="discs")
    assert found.evidence == "certified" and not found.open
    for several, every in ((found.losses, exact.losses), (found.regains, exact.regains)):
        assert [one.value for one in several] == pytest.approx([one.value for one in every], abs=1e-9)
        assert [one.omega for one in several] == pytest.approx([one.omega for one in every], rel=1e-7)
    assert seed or found.losses


@pytest.mark.sampled(2)
@pytest.mark.parametrize("rate", [-0.003, 0.002])
def test_it_meets_all_eigenvalues_that_cross_a_line_beside_the_axis(rate: float) -> None:
    """Against dense eigenvalues of the full pencil, whose Re λ changes its sign about the line from value to value."""
    line = Line(rate + 1j * BAND[0], 1j, BAND[1] - BAND[0])
    (met, left), = sweep_of(rubbing(0)).swept([line])
    assert not left
    exact, before = [], eigenvalues(0.0)
    for a, b in pairwise(np.linspace(0.0, 1.0, 51).tolist()):
        after = eigenvalues(b)
        after = after[np.abs(before[:, None] - after).argmin(axis=1)]
        for z, to in zip(before, after, strict=True):
            if (z.real < rate) != (to.real < rate):
                value, at = passing(rate, (a, z), (b, to))
                if BAND[0] < at.imag < BAND[1]:
                    exact.append((at.imag - BAND[0], value - 0.5, to.real < rate))
        before = after
    inside = [one for one in met if -0.5 < sum(one.values) / 2 < 0.5 and 0 < one.at < line.length]
    assert len(inside) == len(exact) > 0
    for (at, value, left_of), one in zip(sorted(exact), inside, strict=True):
        assert abs(at - one.at) < 1e-4 and abs(value - sum(one.values) / 2) < 1e-3 and left_of == one.left
        assert one.between[0] - 1e-6 < at < one.between[1] + 1e-6 and one.values[0] - 1e-5 < value < one.values[1] + 1e-5


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize(("power", "reach", "h"), [(0, 1e-6, 1e-4), (0, 1e-6, 0.03), (0, 0.1, 1e-3), (1, 1e-6, 0.03),
                                                  (1, 0.01, 0.01), (2, 0.1, 0.04)])
def test_what_is_left_of_each_equation_is_bounded(power: int, reach: float, h: float, whole: bool) -> None:
    """The near block of the full pencil is diag(λ - s + tb) and entries that are no larger than F, for complex s and t.

    With S = P_UL P_L⁻¹ P_LU and E = tT - S it is Λ - s + ZᴴE(I + T_fE)⁻¹X, turned and scaled as in the module's text. If V is
    the whole space, there is no S.
    """
    family, rng = rubbing(1), np.random.default_rng(power)
    M, D, K, rub = family.M[0][1], family.D[0][1], family.K[0][1], family.K[1][1]
    terms = [(0, rub), (1, 0.1 * rub.T), (2, 0.3 * (rub + rub.T))][:power + 1]
    projection = projection_over(fs.Affine(M, [(1.0, D + 0.2 * (rub - rub.T))], [(1.0, K + 0.5 * (rub - rub.T))]).at(), [
        Varied(sp.csr_array(T), power, 0.3) for power, T in terms], (-0.05, BAND[1], *BAND), 0.01).changed(np.zeros(len(terms)))
    assert not whole or projection.completed()
    sweep = WindowSweep(projection, np.ones(len(terms)), (-0.3, 0.3))
    sweep.lines = [Line(1j * BAND[0], 1j, BAND[1] - BAND[0])]
    window = Window(sweep, 0.15)
    V, root = projection.V, la.cholesky(projection.A.formed().toarray())
    outside = la.solve_triangular(root, la.null_space((root @ V).T))  # an orthonormal basis in the norm of A
    fixed = M.toarray(), (D + 0.2 * (rub - rub.T)).toarray(), (K + 0.5 * (rub - rub.T)).toarray()
    middle, d = 0.4j, reach * window.clear
    given = window.segment(middle, d)
    assert given is not None
    F, turn, eye = window.rest(given, h), window.turn(h), np.eye(len(window.lam))
    assert F is not None and len(eye) and outside.any() == (not whole)
    for _ in range(12):
        s = middle + d * np.exp(2j * np.pi * rng.random())
        t = h * rng.choice([-1, 1]) * np.exp(1j * min(0.1, sweep.reach / h))
        T = sum(s**power * matrix.toarray() for power, matrix in terms)
        P = s * s * fixed[0] + s * fixed[1] + fixed[2] + (0.15 + t) * T
        S = (V.T @ P @ outside) @ la.solve(outside.T @ P @ outside, outside.T @ P @ V)
        E = t * (V.T @ T @ V) - S
        nu, _, X, Z = window.far
        T_f = (X * (nu / (1 - (s - window.shift) * nu))) @ Z
        near = np.diag(window.lam - s) + window.z.conj().T @ E @ la.solve(np.eye(len(E)) + T_f @ E, window.x)
        turned = la.solve(eye + t * turn, la.solve(eye - t * (window.N[0] + s * window.N[1]), near) @ (eye + t * turn))
        assert (np.abs(turned - np.diag(window.lam - s + t * window.B.diagonal())) <= F * 1.001).all()


@pytest.mark.slow
def test_what_is_not_bounded_is_left(caplog: pytest.LogCaptureFixture) -> None:
    """With no room for shorter windows, or for more of them, the sweep gives pieces instead of crossings, and logs why."""
    family = rubbing(0)
    caplog.set_level("INFO")
    (_, few), = sweep_of(family).swept([Line(1j * BAND[0], 1j, 0.5)], most=10)
    assert few and "and the limit is 10" in caplog.text
    (_, left), = sweep_of(family).swept([Line(1j * BAND[0], 1j, 0.5)], 1.0)
    assert left
