"""Every analysis takes a coupled system as it takes a part: the same thing in five forms gives the same answers."""

from __future__ import annotations

import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import femsub as fs

N, CUT = 8, 4  # masses of the chain, and of its left part
LAW = fs.StribeckArctan(eps=0.02)
BELT = fs.Belt(speed=0.19113, law=LAW)
BAND = (0.0, 2.5)
FORMS = ("reduced", "coupled", "coupled and reduced", "coupled of reduced", "system of systems")


@cache
def whole() -> fs.Substructure:
    return fs.chain(N, belt=2, damping=0.1, interface=[2, N])


def halves() -> dict[str, fs.Substructure]:
    """The chain in two, which share the mass m_4; the right one holds none of it."""
    left = fs.chain(CUT, belt=2, damping=0.1, interface=[2, CUT])
    right = fs.Substructure(np.diag([0.0] + [1.0] * (N - CUT)), fs.chain(N - CUT + 1, fixed=False).K.toarray(),
                            interface=[0, N - CUT])
    return {"left": left, "right": right}


@cache
def form(name: str) -> fs.Substructure:
    parts, weld = halves(), fs.Rigid(("left", [CUT - 1]), ("right", [0]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        if name == "whole":
            return whole()
        if name == "reduced":
            return fs.reduce(whole(), fs.CraigBampton(N - 2))
        if name == "coupled":
            return fs.couple(parts, [weld])
        if name == "coupled and reduced":
            return fs.reduce(fs.couple(parts, [weld]), fs.CraigBampton(N - 2))
        if name == "coupled of reduced":
            return fs.couple({"left": fs.reduce(parts["left"], fs.CraigChang(CUT)),
                              "right": fs.reduce(parts["right"], fs.CraigBampton(N - CUT - 1))}, [weld])
        inner = fs.couple({"a": parts["left"]}, [fs.Spring(("a", [1]), stiffness=1e-300)])
        return fs.couple({"left": inner, "right": parts["right"]}, [fs.Rigid(("left", [CUT - 1]), ("right", [0]))])


def belt(model: fs.Substructure) -> fs.Belt:
    """The belt on the port 'belt', by the name that it has in the model."""
    return fs.Belt(port=next(name for name in model.ports if name.endswith("belt")), speed=0.19113, law=LAW)


@pytest.fixture(params=FORMS)
def model(request: pytest.FixtureRequest) -> fs.Substructure:
    return form(request.param)


def sorted_by_place(values: np.ndarray) -> np.ndarray:
    return values[np.lexsort((values.imag.round(9), values.real.round(9)))]


def test_normal_modes(model: fs.Substructure) -> None:
    np.testing.assert_allclose(fs.normal_modes(model, count=N).frequencies, fs.chain_frequencies(N), rtol=1e-9)


def test_complex_modes(model: fs.Substructure) -> None:
    mine, reference = fs.complex_modes(model, belt(model)), fs.complex_modes(whole(), BELT)
    assert mine.is_stable is reference.is_stable is False
    np.testing.assert_allclose(sorted_by_place(mine.eigenvalues), sorted_by_place(reference.eigenvalues), atol=1e-9)
    assert len(fs.complex_modes(model, belt(model), band=BAND)) == len(fs.complex_modes(whole(), BELT, band=BAND))


def test_critical_slope_and_sweep(model: fs.Substructure) -> None:
    port = belt(model).port
    assert fs.critical_slope(model, port).value == pytest.approx(fs.critical_slope(whole()).value, rel=1e-8)
    mine, reference = (fs.sweep(one, fs.Belt(place, slope=0.0), "slope", [-0.1, -0.01])
                       for one, place in ((model, port), (whole(), "belt")))
    np.testing.assert_allclose(mine.growth, reference.growth, rtol=1e-8)


def test_transient(model: fs.Substructure) -> None:
    mine, reference = (fs.transient(one, belt(one), (0.0, 30.0)) for one in (model, whole()))
    np.testing.assert_allclose(mine.port(belt(model).port)[:200], reference.port("belt")[:200], atol=1e-5)


def test_harmonic_balance(model: fs.Substructure) -> None:
    mine, reference = (fs.harmonic_balance(one, belt(one), harmonics=20) for one in (model, whole()))
    assert mine.omega == pytest.approx(reference.omega, rel=1e-6)


def test_study(model: fs.Substructure) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.FemsubWarning)
        table = fs.study(model, [fs.CraigBampton(2), fs.CraigChang(2)], (0.0, 0.5), contacts=belt(model),
                         repeats=1)
        reference = fs.study(whole(), [fs.CraigBampton(2), fs.CraigChang(2)], (0.0, 0.5), contacts=BELT, repeats=1)
    for mine, other in zip(table.rows, reference.rows, strict=True):
        assert mine.size == other.size and mine.error_frequency == pytest.approx(other.error_frequency, rel=1e-4, abs=1e-9)


def test_refine(model: fs.Substructure) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.FemsubWarning)
        rom = fs.reduce(model, fs.CraigBampton(3))
        found = fs.refine(model, fs.complex_modes(rom, belt(model), band=(0.0, 0.5)), rom, belt(model))
        reference = fs.complex_modes(whole(), BELT)
    for value in found.modes.eigenvalues:
        assert np.abs(reference.eigenvalues - value).min() < 1e-9


def test_refine_from_parts_that_were_reduced_one_by_one() -> None:
    full = form("coupled")
    assert isinstance(full, fs.System)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.FemsubWarning)
        rom = full.with_parts({"left": fs.reduce(full.parts["left"], fs.CraigBampton(1)),
                               "right": fs.reduce(full.parts["right"], fs.CraigChang(2))})
        rough = fs.complex_modes(rom, belt(rom), band=(0.0, 0.6))
        found = fs.refine(full, rough, rom, belt(full))
    exact = fs.complex_modes(whole(), BELT).eigenvalues
    off = [max(np.abs(exact - value).min() for value in modes.eigenvalues) for modes in (rough, found.modes)]
    assert len(rough) and off[1] < 1e-9 < 1e-4 < off[0]
    with pytest.raises(fs.InputError, match="are not those of"):
        fs.refine(full, rough, fs.couple({"one": full}, []), belt(full))


def test_self_excitation(model: fs.Substructure) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.FemsubWarning)
        found = fs.self_excitation(model, fs.reduce(model, fs.CraigBampton(N - 2)), belt(model))
    assert found.verdict


@pytest.mark.parametrize("format", ["mtx", "npz", "mat"])
def test_write_matrices(model: fs.Substructure, tmp_path: Path, format: str) -> None:
    fs.write_matrices(tmp_path, model, format)
    again = fs.read_component(tmp_path)
    for key in "MDK":
        assert not np.abs(getattr(again, key) - getattr(model, key)).max()
    np.testing.assert_array_equal(again.interface, model.interface)
    assert list(again.ports) == list(model.ports)


@pytest.mark.parametrize("method", [None, fs.CraigBampton(3), fs.CraigChang(3)])
def test_interface_sets_are_written_too(method: object, tmp_path: Path) -> None:
    part = fs.beam(1.0, 6, E=2.1e11, I=1e-8, rho=7850.0, A=1e-4, interface=["left", 0.5], supports={"right": "clamped"})
    part = part if method is None else fs.reduce(part, method)
    fs.write_matrices(tmp_path, part)
    again = fs.read_component(tmp_path)
    assert {name: places.tolist() for name, places in again.sets.items()} == {"left": [0, 1], "0.5": [2, 3]}
    assert fs.couple({"a": again, "b": part}, [fs.Rigid(("a", "left"), ("b", "left"))]).size == 2 * part.size - 2


def test_damping(model: fs.Substructure) -> None:
    damped = model.with_damping(0.01 * model.K)
    assert type(damped) is type(model) and fs.complex_modes(damped).is_stable
    if isinstance(damped, fs.System):
        assert damped.expand(np.zeros(damped.size)).keys() == model.expand(np.zeros(model.size)).keys()
