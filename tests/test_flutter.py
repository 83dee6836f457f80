"""Closed forms of flutter: Hoffmann's two modes, Ziegler's pendulum, the moving string.

N. Hoffmann et al., Int. J. Mech. Sci. 44 (2002) 2029 (two modes); H. Ziegler, Ing.-Arch. 20 (1952) 49, and O. N. Kirillov,
Nonconservative Stability Problems of Modern Physics (2013), ch. 1 (pendulum); J. A. Wickert, C. D. Mote, J. Appl. Mech. 57 (1990)
738 (string).
"""

from __future__ import annotations

import cmath

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from femsub.components import two_mode, ziegler

EYE = np.eye(2)
TWO_MODE = two_mode()


def two_mode_exact(mu: float) -> list[complex]:
    """λ with Im λ > 0 from ω² = 2 ± √(1 - 4μ/3)."""
    roots = [cmath.sqrt(-(2 + sign * cmath.sqrt(1 - 4 * mu / 3))) for sign in (1, -1)]
    return [root if root.imag > 0 else -root for root in roots]


def string(n: int) -> fs.Affine:
    """A string of length, tension and mass 1 that moves at the speed v between two eyes, by n linear elements."""
    h, ones = 1 / n, np.ones(n - 2)
    M = sp.diags_array([ones * h / 6, np.full(n - 1, 2 * h / 3), ones * h / 6], offsets=[-1, 0, 1], format="csr")
    G = sp.diags_array([-ones, ones], offsets=[-1, 1], format="csr")  # 2 ∫ N_i N_j'
    K = sp.diags_array([-ones / h, np.full(n - 1, 2 / h), -ones / h], offsets=[-1, 0, 1], format="csr")
    return fs.Affine(M, [("v", G)], [(1.0, K), (lambda v: -v * v, K)])


@pytest.mark.parametrize("mu", [0.0, 0.3, 0.7, 0.76, 1.0, 3.0])
def test_two_modes(mu: float) -> None:
    found = fs.complex_modes(TWO_MODE.at(mu=mu)).eigenvalues
    for exact in two_mode_exact(mu):
        assert np.abs(found - exact).min() < 1e-10 and np.abs(found - exact.conjugate()).min() < 1e-10
    if mu == 1.0:
        assert np.abs(found - (0.202072 + 1.428577j)).min() < 1e-6


def test_two_modes_lose_stability_at_three_quarters() -> None:
    found = fs.critical_value(TWO_MODE, None, "mu", between=(0.0, 2.0))
    assert float(found) == pytest.approx(0.75, abs=1e-10) and found.evidence == "certified" and not found.open
    assert len(found.losses) == 1 and not found.regains and found.losses[0].kind == "flutter"
    assert found.losses[0].omega == pytest.approx(np.sqrt(2), rel=1e-6)
    below, above = found.losses[0].growth
    assert abs(below) < 1e-9 < 1e-2 < above


def test_two_modes_as_a_contact_on_a_model() -> None:
    """The same as a structure and a friction contact apart: the model stays symmetric, its linearisation does not."""
    sub = fs.Substructure(EYE, [[2, 1], [1, 2]], ports={"n": EYE[1], "t": EYE[0]})
    for mu in (0.5, 1.0):
        friction = fs.LinearContact(("n", "t"), stiffness=[[0, 0], [-4 / 3 * mu, 0]])
        modes = fs.complex_modes(sub, friction)
        assert all(np.abs(modes.eigenvalues - exact).min() < 1e-10 for exact in two_mode_exact(mu))
        assert modes.is_stable is (None if mu < 0.75 else False)  # undamped: on the axis within the bars


@pytest.mark.parametrize("d", [0.0, 2.0**-52, 2.0**-40, -(2.0**-40), 2.0**-20])
def test_at_the_exceptional_point_the_bar_holds_the_exact_value(d: float) -> None:
    """K = [[2, d], [1, 2]] with ω² = 2 ± √d; d = 1 - 4μ/3 vanishes at the coalescence, and is free of rounding here."""
    modes = fs.complex_modes(fs.Pencil(EYE, None, [[2.0, d], [1.0, 2.0]]))
    exact = np.array([1j * cmath.sqrt(2 + sign * cmath.sqrt(d)) for sign in (1, -1)])
    exact = np.append(exact, -exact)
    assert all(np.abs(value - exact).min() <= bar for value, bar in zip(modes.eigenvalues, modes.error_bar, strict=True))
    assert modes.is_stable is (False if d < 0 else None)
    if 0 <= d <= 2.0**-52:  # not told more exactly than the root of EPS allows
        assert modes.error_bar.min() > 1e-9 and modes.error_bar.max() < 1e-6 and modes.condition.min() > 1e6
    else:  # the pair's condition number grows with 1/√d
        assert np.allclose(np.log10(modes.condition * np.sqrt(abs(d))), 0.0, atol=1.0)


def test_ziegler_without_damping() -> None:
    found = fs.critical_value(ziegler(), None, "P", between=(0.0, 4.0))
    assert float(found) == pytest.approx(3.5 - np.sqrt(2), abs=1e-10) and found.evidence == "certified"
    assert [one.kind for one in (*found.losses, *found.regains)] == ["flutter"]
    assert found.losses[0].omega == pytest.approx(0.5**0.25, rel=1e-5)
    wide = fs.critical_value(ziegler(), None, "P", between=(0.0, 8.0))  # above 7/2 + √2 two pairs of real λ, which grow as well
    assert wide.value == pytest.approx(float(found), abs=1e-10) and len(wide.losses) == 1 and not wide.regains


@pytest.mark.parametrize("b", [1e-4, 1e-2, 0.5])
def test_ziegler_with_damping_loses_much_earlier(b: float) -> None:
    """The Hurwitz determinant of 2s⁴ + 7bs³ + (7 - 2P + b²)s² + 2bs + 1 vanishes at P = 41/28 + b²/2."""
    found = fs.critical_value(ziegler(b), None, "P", between=(0.0, 3.0))
    assert float(found) == pytest.approx(41 / 28 + b**2 / 2, abs=1e-10) and found.evidence == "certified"
    assert found.losses[0].kind == "flutter" and found.losses[0].omega == pytest.approx(np.sqrt(2 / 7), rel=1e-9)
    assert found.losses[0].growth[0] < 0 < found.losses[0].growth[1]


def test_the_moving_string_to_the_mesh_order() -> None:
    """ω_k = kπ(1 - v²), with an error of the second order of the element length."""
    for v in (0.0, 0.3, 0.6):
        errors = []
        for n in (40, 80):
            modes = fs.complex_modes(string(n).at(v=v), count=6)
            found, exact = modes.eigenvalues.imag[modes.eigenvalues.imag > 0], np.pi * np.arange(1, 4) * (1 - v**2)
            errors.append(np.abs(found - exact) / exact)
            assert np.abs(modes.eigenvalues.real).max() < 1e-10 and modes.is_stable is None
        assert (errors[1] < 0.01).all() and (np.abs(errors[0] / errors[1] - 4) < 0.1).all()


@pytest.mark.slow
def test_the_moving_string_is_stable_below_the_speed_of_waves() -> None:
    found = fs.critical_value(string(6), None, "v", between=(0.0, 0.9))
    assert found.value == np.inf and not found.losses and found.evidence == "confirmed"
    for v in (0.5, 0.9):
        pencil = string(40).at(v=v)
        small = string(40).reduced(fs.normal_modes(fs.Substructure(pencil.M, pencil.K), count=6).shapes)
        assert fs.critical_value(small, None, "v", between=(0.0, v)).value == np.inf
