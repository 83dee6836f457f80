"""The Euler-Bernoulli beam against closed forms, its rigid motion in any units, and its reduced models."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import brentq

import femsub as fs

SI = {"E": 210e9, "I": 1e-2**4 / 12, "rho": 7850.0, "A": 1e-4}  # a steel bar of 10 mm x 10 mm: m, kg, s
MM = {"E": 210e3, "I": 1e4 / 12, "rho": 7.85e-9, "A": 100.0}  # the same in mm, t, s
SPEED = np.sqrt(SI["E"] * SI["I"] / (SI["rho"] * SI["A"]))  # ω = (wave number)² SPEED


def roots(f: Callable[[float], float], shift: float, count: int) -> np.ndarray:
    return np.array([brentq(f, (k + shift) * np.pi - 1, (k + shift) * np.pi + 1, xtol=1e-14) for k in range(1, count + 1)])


def wave_numbers(ends: str, count: int) -> np.ndarray:
    """βL: kπ, cosh βL cos βL = -1, and cosh βL cos βL = 1."""
    if ends == "pinned":
        return np.pi * np.arange(1, count + 1)
    if ends == "clamped-free":
        return roots(lambda x: np.cos(x) + 1 / np.cosh(x), -0.5, count)
    return roots(lambda x: np.cos(x) - 1 / np.cosh(x), 0.5, count)


SUPPORTS: dict[str, dict] = {"pinned": {"left": "pinned", "right": "pinned"}, "clamped-free": {"left": "clamped"}, "free": {}}


def test_a_foundation_adds_to_every_eigenvalue() -> None:
    bare, bedded = (fs.normal_modes(fs.beam(1.0, 20, **SI, foundation=k), count=6).eigenvalues for k in (0.0, 2e3))
    assert np.allclose(bedded[:2], 2e3 / (SI["rho"] * SI["A"]), rtol=1e-9)
    assert np.allclose(bedded[2:6] - bare[2:6], 2e3 / (SI["rho"] * SI["A"]), rtol=1e-7)


@pytest.mark.sampled(5)
@pytest.mark.filterwarnings("ignore:.*rounding may take:femsub.checks.ConditionWarning")
@pytest.mark.parametrize("n", [1, 4, 7, 49, 50, 51, 200, 2000])
@pytest.mark.parametrize(("units", "length"), [(SI, 1.0), (MM, 1000.0), (SI, 0.03), (MM, 50_000.0)])
def test_rigid_body_modes_are_counted_in_any_units(n: int, units: dict, length: float) -> None:
    count = min(5, 2 * n)
    assert fs.normal_modes(fs.beam(length, n, **units), count=count).rigid == 2
    for supports, rigid in (({"left": "pinned"}, 1), ({"left": "guided", "right": "guided"}, 1), ({"left": "clamped"}, 0)):
        assert fs.normal_modes(fs.beam(length, n, **units, supports=supports), count=min(5, 2 * n - 1)).rigid == rigid


def test_rigid_body_modes_of_unequal_elements(rng: np.random.Generator) -> None:
    for m in (3, 60):  # few enough for LAPACK, and not
        for _ in range(8):
            places = np.append(0.0, np.cumsum(rng.uniform(0.1, 2.0, m)))
            modes = fs.normal_modes(fs.beam(places[-1], places, **SI), count=2 * m)
            assert modes.rigid == 2 and modes.residual.max() < 1e-11


def test_units_change_no_digit_beyond_rounding() -> None:
    si, mm = (fs.normal_modes(fs.beam(length, 40, **units), count=10).frequencies for length, units in ((1.0, SI), (1e3, MM)))
    assert np.abs(mm[2:] / si[2:] - 1).max() < 1e-9


def test_rigid_motion_costs_nothing_and_carries_the_whole_mass() -> None:
    places = np.array([0.0, 0.1, 0.35, 0.6, 1.0])
    sub = fs.beam(1.0, places, **SI)
    lift, turn = np.tile([1.0, 0.0], 5), np.ravel(np.column_stack([places, np.ones(5)]))
    for motion in (lift, turn):
        assert np.abs(sub.K @ motion).max() < 1e-14 * (abs(sub.K) @ np.abs(motion)).max()
    mass = SI["rho"] * SI["A"]
    assert np.isclose(lift @ sub.M @ lift, mass, rtol=1e-14) and np.isclose(turn @ sub.M @ turn, mass / 3, rtol=1e-14)
    assert all(sp.issparse(part) and (part != part.T).nnz == 0 for part in (sub.K, sub.M))


def test_matrices_are_those_of_scikit_fem() -> None:
    import skfem
    from skfem.helpers import dd, ddot

    places = np.array([0.0, 0.2, 0.3, 0.7])
    basis = skfem.Basis(skfem.MeshLine(places), skfem.ElementLineHermite(), intorder=6)
    K = skfem.BilinearForm(lambda u, v, w: ddot(dd(u), dd(v))).assemble(basis)
    M = skfem.BilinearForm(lambda u, v, w: u * v).assemble(basis)
    sub = fs.beam(0.7, places, E=[1.0, 1.0, 1.0], I=1.0, rho=1.0, A=1.0)
    assert abs(sub.K - K).max() < 1e-11 * abs(K).max() and abs(sub.M - M).max() < 1e-12 * abs(M).max()


def test_sections_may_change_along_the_beam() -> None:
    stepped = fs.beam(1.0, 2, E=[1.0, 2.0], I=1.0, rho=1.0, A=[3.0, 1.0])
    halves = [fs.beam(0.5, 1, E=E, I=1.0, rho=1.0, A=A) for E, A in ((1.0, 3.0), (2.0, 1.0))]
    for name in "MK":
        expected = np.zeros((6, 6))
        for at, half in zip((0, 2), halves, strict=True):
            expected[at:at + 4, at:at + 4] += getattr(half, name).toarray()
        assert np.allclose(getattr(stepped, name).toarray(), expected, rtol=1e-14)


def test_interface_ports_and_dof_names() -> None:
    sub = fs.beam(1.0, 10, **SI, supports={"left": "clamped", 0.5: "pinned"}, interface=("right", 0.5),
                  ports={"belt": 0.3, "twist": ("right", "w,x")})
    assert sub.size == 22 - 3 and sub.dofs is not None
    assert [sub.dofs.name(i) for i in sub.interface] == ["w at node 11", "w,x at node 11", "w,x at node 6"]
    for port, node, label in (("belt", 4, "w"), ("twist", 11, "w,x")):
        where = np.flatnonzero(sub.port(port))
        assert list(where) == list(sub.dofs.find(node, label)) and sub.port(port)[where[0]] == 1.0
    assert np.allclose(sub.dofs.points[sub.dofs.find(4)], 0.3)


def test_static_deflection_of_a_cantilever_is_exact() -> None:
    from scipy.sparse.linalg import spsolve

    sub = fs.beam(2.0, 3, **SI, supports={"left": "clamped"}, ports={"tip": "right"})
    w = sub.port("tip")
    assert np.isclose(w @ spsolve(sub.K.tocsc(), w), 2.0**3 / (3 * SI["E"] * SI["I"]), rtol=1e-12)


@pytest.mark.parametrize(("supports", "interface"), [
    ({"left": "clamped"}, ("right",)), ({}, ("right",)),  # just held by its interface: rigid motion is all that K_bb has
    ({}, ("left", "right"))])
@pytest.mark.parametrize("method", [fs.CraigBampton(modes=6), fs.CraigChang(modes=6)])
@pytest.mark.parametrize(("units", "length"), [(SI, 1.0), (MM, 1000.0)])
def test_reduced_models_bound_from_above(method: fs.CraigBampton | fs.CraigChang, supports: dict, interface: tuple,
                                         units: dict, length: float) -> None:
    sub = fs.beam(length, 60, **units, supports=supports, interface=interface, ports={"belt": length / 2})
    full, rom = fs.normal_modes(sub, count=6), fs.normal_modes(fs.reduce(sub, method, ports=True), count=6)
    error = rom.eigenvalues[rom.rigid:] / full.eigenvalues[full.rigid:] - 1
    assert rom.rigid == full.rigid and error.min() > -1e-7 and error[:3].max() < 3e-3


@pytest.mark.parametrize(("arguments", "words"), [
    ({"length": -1.0}, "length must be positive"), ({"elements": 0}, "elements must be at least 1"),
    ({"elements": [0.0, 0.5, 0.4, 1.0]}, "must ascend"), ({"elements": [0.0, 0.5]}, "from 0 to the length 1"),
    ({"E": 0.0}, "E must be positive"), ({"rho": [1.0, 2.0]}, "one number or 10"), ({"foundation": -1.0}, "zero or more"),
    ({"A": [1.0] * 9 + [-1.0]}, "A must be positive and finite, but is -1 in element 10"),
    ({"supports": {"left": "clampd"}}, "unknown support 'clampd'; did you mean 'clamped'"),
    ({"supports": {"lift": "clamped"}}, "did you mean 'left'"), ({"supports": "left"}, "supports must be a dict of places"),
    ({"supports": {0.33: "pinned"}}, r"no node at x = 0.33. The nearest is number 4 at x = 0.3"),
    ({"interface": ("left",), "supports": {"left": "clamped"}}, "interface 'left' of 'beam' is held"),
    ({"interface": "left"}, "a list of places"), ({"ports": {"belt": 2.0}}, "no node at x = 2. The nearest is number 11 at"),
    ({"ports": {"belt": ("left", "v")}}, "unknown motion"), ({"rayleigh": (-1.0, 0.0)}, "alpha of rayleigh must not be negative"),
    ({"ports": {"belt": "left"}, "supports": {"left": "pinned"}}, "DOF that the supports hold"),
    ({"elements": 1, "supports": {"left": "clamped", "right": "clamped"}}, "hold every DOF"),
])
def test_beam_refuses(arguments: dict, words: str) -> None:
    with pytest.raises((ValueError, TypeError), match=words):
        fs.beam(**{"length": 1.0, "elements": 10, **SI, **arguments})


@pytest.mark.filterwarnings("ignore:.*rounding may take:femsub.checks.ConditionWarning")
def test_a_slender_beam_that_is_held_keeps_its_stiffness() -> None:
    def tip(elements: int) -> float:
        sub = fs.beam(1.0, elements, E=2.1e11, I=8e-9, rho=7850.0, A=2e-4, supports={"left": "clamped"}, interface=["right"])
        return float(fs.reduce(sub, fs.CraigBampton(modes=5)).K[0, 0] / (12 * 2.1e11 * 8e-9) - 1)

    assert abs(tip(1000)) < 1e-5 and abs(tip(2000)) < 1e-3


@pytest.mark.slow
def test_the_entries_of_a_fine_beam_hold_its_lowest_frequency() -> None:
    """The Rayleigh quotient of the cantilever's first mode, in exact arithmetic, from the entries as they are stored."""
    mode = wave_numbers("clamped-free", 1)[0]
    for elements in (1000, 3000):
        for L, places in ((1.0, elements), (0.7, elements), (0.7, np.linspace(0.0, 0.7, elements + 1))):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", fs.ConditionWarning)
                sub = fs.beam(L, places, **SI, supports={"left": "clamped"})
            z = mode * sub.dofs.points[::2, 0] / L
            ratio = (np.cosh(mode) + np.cos(mode)) / (np.sinh(mode) + np.sin(mode))
            w = np.cosh(z) - np.cos(z) - ratio * (np.sinh(z) - np.sin(z))
            slope = mode / L * (np.sinh(z) + np.sin(z) - ratio * (np.cosh(z) - np.cos(z)))
            x = np.ravel(np.column_stack([w, slope])).tolist()
            stiffness, inertia = (sum(Fraction(v) * Fraction(x[i]) * Fraction(x[j]) for i, j, v in
                                      zip(A.row.tolist(), A.col.tolist(), A.data.tolist(), strict=True))
                                  for A in (sub.K.tocoo(), sub.M.tocoo()))
            exact = (mode / L) ** 4 * SI["E"] * SI["I"] / (SI["rho"] * SI["A"])
            assert abs(float(stiffness / inertia) / exact - 1) < 1e-6  # it was 6e-3, by springs of rounding under every node


@pytest.mark.filterwarnings("ignore:.*rounding may take:femsub.checks.ConditionWarning")
@pytest.mark.parametrize("places", ["equal", "linspace", "graded"])
def test_lifting_a_beam_costs_nothing_to_the_last_digit(places: str) -> None:
    x = {"equal": 300, "linspace": np.linspace(0.0, 0.7, 301), "graded": 0.7 * np.linspace(0.0, 1.0, 301) ** 1.5}[places]
    sub = fs.beam(0.7, x, **{**SI, "E": np.linspace(1.0, 3.0, 300)})
    lift = np.tile([1.0, 0.0], 301)
    bare = slice(None) if places != "graded" else slice(20, None)  # at the thin end neighbours differ by too much
    assert not (sub.K @ lift)[bare].any()
    assert (sub.K != sub.K.T).nnz == 0
    moved = sub.K @ np.ravel(np.column_stack([sub.dofs.points[::2, 0], np.ones(301)]))
    assert np.abs(moved).max() < 1e-13 * (abs(sub.K) @ (lift + 1)).max()


@pytest.mark.parametrize("ends", ["clamped-free", "pinned", "free"])
def test_rounding_of_a_fine_beam_is_told_with_its_figure(ends: str) -> None:
    exact = wave_numbers(ends, 1)[0] ** 2 * SPEED
    for elements in (200, 500, 1000, 3000):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always", fs.ConditionWarning)
            sub = fs.beam(1.0, elements, **SI, supports=SUPPORTS[ends])
            modes = fs.normal_modes(sub, count=1)
        figures = [float(str(one.message).split("may take ")[1].split()[0]) for one in told if "may take" in str(one.message)]
        assert len(figures) == (elements > 540)
        assert abs(modes.frequencies[modes.rigid] / exact - 1) < (2 * figures[0] if figures else 1e-6)


@pytest.mark.parametrize(("arguments", "text"), [
    ({"E": np.array([1 + 1j] * 4)}, "E must be real numbers, not complex128"),
    ({"E": "2e11"}, "E must be"),
    ({"I": [[1.0, 2.0], [3.0]]}, "I must be one number or 4 of them"),
    ({"elements": [0.0, "a", 1.0]}, "(elements) must be real numbers"),
    ({"elements": [0.0, [0.5], 1.0]}, "(elements) must be rows of the same length"),
    ({"elements": None}, "elements must be a whole number"),
    ({"supports": ["left"]}, "supports must be a dict of places"),
    ({"supports": {"left": ["clamped"]}}, "unknown support ['clamped']; did you mean 'clamped'"),
    ({"interface": 1.0}, "interface must be a list of places"),
    ({"interface": [["left"]]}, "a place in interface other than 'left' and 'right' must be a number"),
    ({"ports": {"p": ("left", ["w"])}}, "unknown motion of port 'p'"),
])
def test_arguments_of_the_wrong_kind(arguments: dict, text: str) -> None:
    with pytest.raises((fs.InputError, fs.InputTypeError)) as caught:
        fs.beam(**{"length": 1.0, "elements": 4, "E": 1.0, "I": 1.0, "rho": 1.0, "A": 1.0, **arguments})
    assert text in str(caught.value)
