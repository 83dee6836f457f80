"""Changes of models: exact in full ones, within the error in reduced ones; candidates in the order of their true effect."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la
from brakescene import PADS, brake_models
from scipy.sparse.linalg import splu

import femsub as fs
from femsub.app.models import Models
from femsub.output import draw
from femsub.reduction.wider import Wider
from femsub.stability.changes_tried import _each_modified
from femsub.stability.charts import changes_chart

BRICKS = fs.block((0.2, 0.02, 0.03), (6, 1, 1))
BAR = fs.Mesh(BRICKS.points, BRICKS.cells, BRICKS.kind, sets=dict(BRICKS.sets), groups={"root": range(4), "tip": [4, 5]})
STEEL, SOFT = fs.Material(2.1e11, 0.3, 7850.0), fs.Material(5e9, 0.25, 2500.0, loss=0.02)


def bar(tip: fs.Material = SOFT) -> fs.Substructure:
    return fs.solid(BAR, {"root": STEEL, "tip": tip}, supports=["left"], interface=["right"], rayleigh=(3.0, 1e-7))


@pytest.mark.parametrize(("parameter", "amount"), [("E", 1e9), ("nu", 0.1), ("rho", -500.0), ("loss", 0.1)])
def test_another_material_is_the_model_that_is_built_with_it(parameter: str, amount: float) -> None:
    change = fs.MaterialChange.solid(BAR, SOFT, parameter, amount, cells="tip", rayleigh=(3.0, 1e-7))
    found = fs.modified(bar(), [change])
    wanted = bar(replace(SOFT, **{parameter: getattr(SOFT, parameter) + amount}))
    for key in "MDKH":
        A, B = getattr(found, key), getattr(wanted, key)
        assert abs(A - B).max() <= 1e-13 * abs(B).max(), key
    assert list(found.sets) == ["right"] and np.array_equal(found.interface, wanted.interface)


def test_several_changes_add_up_and_a_system_keeps_its_parts() -> None:
    chain = fs.chain(5, belt=2, interface=[5])
    found = fs.modified(chain, [fs.AddedMass([0, 1], 0.5), fs.AddedSpring([4], 2.0, to=[1]), fs.AddedDamper("belt", 0.3),
                                fs.Spring(("chain", [4]), stiffness=0.25)])
    assert np.allclose(found.M.diagonal(), [1.25, 1.25, 1, 1, 1])
    K = chain.K.toarray()
    K[np.ix_([1, 4], [1, 4])] += 2.0 * np.array([[1, -1], [-1, 1]])
    K[4, 4] += 0.25
    assert np.allclose(found.K.toarray(), K) and np.isclose(found.D[1, 1], chain.D[1, 1] + 0.3)
    system = fs.couple({"a": chain, "b": fs.chain(3, interface=[1], fixed=False)}, [fs.Rigid(("a", [4]), ("b", [0]))])
    heavier = fs.modified(system, [fs.AddedMass(("b", [2]), 0.5)])
    assert isinstance(heavier, fs.System) and list(heavier.parts) == ["a", "b"]
    assert np.isclose(heavier.M.sum() - system.M.sum(), 0.5)
    with pytest.raises(fs.InputError, match="after its parts were joined"):
        heavier.with_parts({})


@pytest.mark.parametrize("method", [fs.CraigBampton(20), fs.CraigChang(8), fs.Rubin(8)])
def test_a_reduced_model_follows_a_change_within_its_error(method: Any) -> None:
    full = bar().with_structural_damping(None)
    changes = [fs.AddedMass([9, 10, 11], 0.2), fs.MaterialChange.solid(BAR, replace(SOFT, loss=0.0), "E", 2e9, cells="tip")]
    rom = fs.reduce(full, method)
    small, exact = fs.modified(rom, changes), fs.normal_modes(fs.modified(full, changes), count=4).frequencies
    assert exact[3] <= 0.7 * rom.cutoff
    off = fs.normal_modes(small, count=4).frequencies / exact - 1
    assert small.size > rom.size and -1e-9 < off.max() <= small.change_error + 1e-9 and off.max() < 1e-3
    del full
    plain = fs.modified(rom._with(), changes[:1])  # a copy does not know the full model
    assert np.isnan(plain.change_error) and plain.size == rom.size


def test_candidates_are_ordered_by_solving_them() -> None:
    sub, belt = fs.chain(10, belt=2), fs.Belt(slope=-0.05)
    candidates = {f"damper {k}": fs.AddedDamper([k], 0.05) for k in (1, 4, 9)} | {
        "mass and damper": [fs.AddedMass([1], 2.0), fs.AddedDamper([1], 0.2)], "mass": fs.AddedMass([3], 1.0)}
    found = fs.what_helps(sub, belt, candidates, band=(0.0, 1.2))
    growth = {name: fs.complex_modes(fs.modified(sub, one if isinstance(one, list) else [one]), belt, band=(0.0, 1.2)).growth
              for name, one in candidates.items()}
    assert [one.name for one in found.tried] == sorted(growth, key=lambda name: growth[name])
    assert all(np.isclose(one.growth, growth[one.name]) for one in found.tried)
    assert found.best.reached == (found.best.growth <= 0) and len(found.ranking) == 5
    assert all(one.name in str(found) for one in found.tried) and "goes from" in found.ranking[0]


@pytest.mark.parametrize("band", [(0.0, 1.2), (0.2, 0.3)], ids=["modes", "none in the band"])
def test_the_chart_has_a_bar_from_now_to_the_growth_of_each_candidate(band: tuple[float, float]) -> None:
    sub, belt = fs.chain(10, belt=2), fs.Belt(slope=-0.05)
    found = fs.what_helps(sub, belt, [fs.AddedDamper([4], 0.2), fs.AddedMass([4], 1.0)], band=band, full=sub)
    chart = changes_chart("helps", found, "Title")
    series = chart.panels[0].series
    bars = [one for one in series if one.line]
    for rank, (bar, one) in enumerate(zip(bars, found.tried, strict=True), 1):
        assert list(bar.y) == [rank, rank]
        assert np.array_equal(bar.x, [found.before.growth, one.growth]) or not np.isfinite(one.growth)
    assert [label for one in series for label in one.labels] == [one.name for one in found.tried]
    assert [list(one.x) for one in series if one.name == "full model"] == [[found.best.growth]] or band[0]
    assert {level.at for level in chart.panels[0].levels} == {found.before.growth, found.target}
    draw(chart)
    chart.plain()


def test_a_model_of_a_belt_is_confirmed_in_the_full_one() -> None:
    full, belt = fs.chain(60, belt=20), fs.Belt(slope=-0.02)
    rom = fs.reduce(full, fs.CraigBampton(12), ports=True)
    found = fs.what_helps(rom, belt, [fs.AddedDamper([30], 0.3), fs.AddedDamper([50], 0.3)], band=(0.0, 0.3), full=full)
    best = found.best
    assert best.in_full is not None and abs(best.in_full.growth - best.growth) < 0.05 * abs(found.before.growth)
    assert found.tried[1].in_full is None


def test_a_model_without_mass_in_its_residual_modes_keeps_its_basis() -> None:
    """Static responses have mass in common with MacNeal's residual modes, whose own mass is left out."""
    full = fs.chain(30)
    rom = fs.reduce(full, fs.MacNeal(5))
    found = fs.modified(rom, [fs.AddedMass([4], 0.5)])
    assert found.size == rom.size and np.isnan(found.change_error)
    exact = fs.normal_modes(fs.modified(full, [fs.AddedMass([4], 0.5)]), count=2).frequencies
    assert np.allclose(fs.normal_modes(found, count=2).frequencies, exact, rtol=1e-2)


@pytest.mark.parametrize("amount", [1e-3, 0.3, 100.0])
@pytest.mark.parametrize("method", [fs.CraigBampton(8), fs.CraigChang(8)])
def test_a_heavy_damper_shows_in_the_error(method: fs.Method, amount: float) -> None:
    """Static responses do not resolve its force. In undamped frequencies nothing of that is seen."""
    full = fs.chain(80, damping=0)
    small, whole = (fs.modified(model, [fs.AddedDamper([47], amount)]) for model in (fs.reduce(full, method), full))
    found, exact = (fs.complex_modes(model).eigenvalues for model in (small, whole))
    found = found[(found.imag > 0) & (np.abs(found) < 0.7 * small.cutoff)]
    off = np.abs(found[:, None] - exact).min(axis=1) / np.abs(found)
    assert 0.3 * small.change_error <= off.max() <= small.change_error + 1e-11


@pytest.mark.slow
def test_candidates_tried_together_are_as_each_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """One basis has the static responses of all, and the full model is solved once for them, whatever their number."""
    solves, responses = list[int](), Wider.responses
    monkeypatch.setattr(Wider, "responses", lambda self, sub, loads: solves.append(1) or responses(self, sub, loads))
    full = fs.solid(BAR, {"root": STEEL, "tip": SOFT}, supports=["left"], interface=["right"], rayleigh=(5.0, 1e-7))
    rom = fs.reduce(full, fs.Rubin(8))
    softer = fs.MaterialChange.solid(BAR, SOFT, "E", -1e9, cells="tip", rayleigh=np.array([5.0, 1e-7]))
    candidates = [[fs.AddedMass([180, 181], 0.01)], [fs.AddedSpring([60, 61], 1e6)],
                  # responses in common, and others that depend on each other
                  [fs.AddedMass([180, 181], 0.02), fs.AddedSpring([180, 181], 1e5), fs.AddedDamper([60], 10.0)],
                  [fs.AddedMass([60, 61, 64], 0.01), fs.AddedSpring([60, 61], 2e5)]]
    with_material = [[softer], [fs.AddedMass([60], 0.01), softer]]
    alone = [fs.modified(rom, changes) for changes in candidates + with_material]
    before = len(solves)
    together = list(_each_modified(rom, candidates))
    assert len(solves) - before == 2
    for one, other, changes in zip([*together, *_each_modified(rom, with_material)], alone, candidates + with_material,
                                   strict=True):
        # the error by its definition, rᴴK⁻¹r / |λ xᵀP'x| (1 - |λ|²/ω_c²)⁻¹ with r of the changed full model
        whole, limit = fs.modified(full, changes), 0.7 * rom.cutoff
        C, (D, u) = whole.D - full.D, (one.V.T @ ((whole.D - full.D) @ one.V), np.eye(one.size))
        value, x = la.eig(np.block([[0 * u, u], [-one.K, -D]]), la.block_diag(u, one.M))
        keep = (value.imag > 0) & (np.abs(value) < limit)
        value, x = value[keep], one.V @ x[:one.size, keep]
        r, rate = whole.K @ x + (C @ x) * value + (whole.M @ x) * value**2, 2 * (whole.M @ x) * value + C @ x
        energy = np.einsum("ij,ij->j", r.conj(), splu(full.K.tocsc().astype(complex)).solve(r)).real
        error = energy / np.abs(value * np.einsum("ij,ij->j", x, rate)) / (1 - np.abs(value / rom.cutoff) ** 2)
        assert np.isclose(one.change_error, error.max(), rtol=1e-3, atol=1e-11)
        assert one.size == other.size and one.kinds == other.kinds
        now, then = (fs.normal_modes(part, count=6).frequencies for part in (one, other))
        assert np.allclose(now, then, rtol=1e-9)
        assert np.isclose(one.change_error, other.change_error, rtol=1e-6, atol=1e-11)
        pair = fs.complex_modes(one).eigenvalues, fs.complex_modes(other).eigenvalues
        assert np.allclose(*(np.sort(values[np.abs(values) < 0.5 * rom.cutoff].real) for values in pair), rtol=1e-6, atol=1e-6)
    del solves[:]
    dampers = {f"{k}": fs.AddedDamper([60, 61], 10.0 * k) for k in range(1, 8)}
    found = fs.what_helps(rom, None, dampers, band=(0.0, 0.5 * rom.cutoff))
    assert len(found.tried) == 7 and len(solves) == 2


def test_slopes_do_not_depend_on_how_many_are_computed_together() -> None:
    sub, belt = fs.chain(10, belt=2), fs.Belt(slope=-0.05)
    candidates = [fs.AddedDamper([k], 0.02) for k in range(5)]
    one, other = (fs.what_helps(sub, belt, candidates, band=(0.0, 1.2), at_once=count) for count in (2, 100))
    assert np.allclose([change.by_slope for change in one.tried], [change.by_slope for change in other.tried], rtol=1e-12)


def test_what_has_no_place_is_refused() -> None:
    chain = fs.chain(4)
    with pytest.raises(fs.InputError, match="negative mass"):
        fs.modified(chain, [fs.AddedMass([1], -2.0)])
    with pytest.raises(fs.InputError, match="empty"):
        fs.what_helps(chain, fs.Belt("belt", slope=-0.1), [])
    with pytest.raises(fs.InputError, match="DOF map"):
        fs.modified(fs.Substructure(np.eye(2), np.eye(2)), [fs.MaterialChange.solid(BAR, SOFT, "E", 1.0)])
    with pytest.raises(fs.InputError, match="equations"):
        fs.modified(chain, [fs.JointChange(fs.Rigid(("chain", [0]), "ground"))])
    with pytest.raises(fs.InputError, match="nu"):
        fs.MaterialChange.solid(BAR, SOFT, "nu", 0.5)


@pytest.mark.rare
def test_the_best_damper_and_the_best_shim_quieten_the_full_brake() -> None:
    """The scene `brake` with large elements at μ = 0.6: one unstable mode at 5.2 kHz. A damper has 100 g·s/mm, 981 N·s/m."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)  # of the straight edges of large elements
        _quietened(brake_models(0.08), PADS)


def _quietened(brake: Models, pads: tuple[str, ...]) -> None:
    full, contacts, band = brake.full, brake.at({"mu": 0.6}), (2e4, 3.6e4)
    small = fs.reduce(full, fs.ContactModes(40, contacts=brake.at({"mu": 0.0})))
    dampers = {f"damper {place}-{axis}": [fs.AddedDamper(f"{name}.{place}-{axis}", 981.0) for name in pads]
               for place in ("back", "leading", "trailing") for axis in "xz"}
    shims = {f"shim {c:g}": [change for name in pads for axis in "xyz" for change in (
        fs.AddedSpring(f"{name}.back-{axis}", 3e7), fs.AddedDamper(f"{name}.back-{axis}", c))] for c in (1e3, 6e3)}
    assert fs.complex_modes(full, contacts, band=band).is_stable is False
    for candidates in (dampers, shims):
        found = fs.what_helps(small, contacts, candidates, band=band, full=full)
        assert found.before.is_stable is False and found.best.reached
        assert found.best.in_full is not None and found.best.in_full.is_stable is True
