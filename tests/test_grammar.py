"""The grammar of scenes: every kind of part with every analysis, full and reduced, right or refused with its reason."""

from __future__ import annotations

import tempfile
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from femsub.app.grammar import Scene
from femsub.app.kinds import Kinds
from femsub.checks import InputError

MESHES = Path(__file__).parents[1] / "meshes"
STEEL = {"steel": {"E": 2.1e11, "rho": 7850.0}}
#: a small scene for each kind of part: [material], [part], band, and where its belt is
PARTS: dict[str, dict[str, Any]] = {
    "chain": {"part": {"p": {"chain": 7, "belt": 2, "interface": [1, 4]}}, "band": [0.0, 1.0]},
    "beam": {"material": STEEL, "part": {"p": {
        "beam": 1.0, "material": "steel", "width": 0.02, "height": 0.01, "elements": 6, "left": "clamped",
        "interface": ["right"],
        "ports": {"belt": 0.5}, "rayleigh": [5.0, 1e-6]}}, "band": [0.0, 3000.0]},
    "plate": {"material": STEEL, "part": {"p": {
        "plate": {"lengths": [0.4, 0.3], "elements": [4, 3]}, "material": "steel", "thickness": 0.002, "clamped": ["left"],
        "interface": ["corners"], "ports": {"belt": [0.2, 0.1]}, "rayleigh": [5.0, 1e-5]}}, "band": [0.0, 1500.0]},
    "solid": {"material": STEEL, "part": {"p": {
        "solid": {"lengths": [0.1, 0.02, 0.02], "elements": [4, 1, 1], "cells": "hexahedron"}, "material": "steel",
        "supports": ["left"], "interface": ["right"], "ports": {"belt": ["right", "y"]}, "rayleigh": [5.0, 1e-7]}}, "band": [0.0,
                                                                                                                             8e4]},
    "matrices": {"part": {"p": {
        "matrices": {"M": str(MESHES / "calculix/beam.mas"), "K": str(MESHES / "calculix/beam.sti"),
                     "dofs": str(MESHES / "calculix/beam.dof")},
        "interface": ["17:*", "18:*"], "ports": {"belt": ["17:uy"]}, "rayleigh": [5.0, 1e-5]}}, "band": [0.0, 1e4]},
    "superelement": {"part": {"p": {"superelement": "made when it is needed"}}, "band": [0.0, 3000.0]},
    "affine": {"part": {"p": {"affine": {
        "M": [{"matrix": [[1.0, 0.0], [0.0, 1.0]]}], "D": [{"matrix": [[0.05, 0.0], [0.0, 0.1]], "factor": "d"}],
        "K": [{"matrix": [[2.0, 1.0], [1.0, 2.0]]}, {"matrix": [[0.0, -4 / 3], [0.0, 0.0]], "factor": "mu"}]}}}, "band": [0.0,
                                                                                                                          2.0],
        "parameter": {"mu": {"between": [0.0, 1.5], "value": 0.9}, "d": {"value": 1.0, "between": [0.5, 1.5]}}},
}
#: a wide ε, so that cycles need few harmonics; each force is a little beyond the border
FORCES = {"chain": 0.4, "beam": 60.0, "plate": 90.0, "solid": 40.0, "matrices": 200.0, "superelement": 50.0}


def belt(part: str, **others: float) -> dict[str, Any]:
    """The belt of a scene."""
    return {"belt": {"belt": "p.belt", "force": FORCES[part], "law": "stribeck-arctan-odd", "eps": 0.05, "speed": 0.4} | others}


#: each analysis on these scenes; a pencil of matrices has parameters in place of a belt
ASKS: dict[str, dict[str, Any]] = {
    "modes": {"modes": "band"}, "complex-modes": {"complex-modes": "all"}, "critical": {"critical": "slope"},
    "flutter": {"flutter": "slope", "between": [-0.3, 0.0], "points": 5}, "compare": {"compare": ["growth", "critical", "held"]},
    "response": {"response": ["p.belt"], "frequencies": 5, "loss": 0.01}, "springs": {"springs": [1.0]},
    "growth": {"growth": "slope", "points": 5, "vary": {"contact.belt.force": [1.0, 2.0]}},
    "friction-law": {"friction-law": [0.01]},
    "motion": {"motion": [0.0, 8.0], "in_periods": True, "show": ["signals"], "tol": 1e-5},
    "compare-motion": {"compare-motion": 4.0, "long": 8.0, "tol": 1e-5, "full_tol": 1e-3}, "cycles": {"cycles": 1},
    "branch": {"branch": "force", "families": 1, "points": 3, "harmonics": 12, "dots": 0}, "audit": {"audit": "parts"},
    "map": {"map": ["slope", "force"], "points": [4, 4], "spots": 1}, "scatter": {"scatter": ["slope"], "samples": 32},
    "sensitivities": {"sensitivities": ["slope", "force"]}, "card": {"card": "best"}, "helps": {"helps": {"damper": 5.0}},
    "parts": {"parts": True}, "modes-per-part": {"modes-per-part": 1e-2}, "matrices": {"matrices": "mtx"},
    "masses": {"masses": [0.0, 0.0, 0.0]},
}
PENCIL: dict[str, dict[str, Any]] = {
    "critical": {"critical": "mu"}, "flutter": {"flutter": "mu", "points": 5}, "map": {"map": ["mu", "d"], "points": [4, 4]},
    "scatter": {"scatter": ["mu"], "samples": 32}, "sensitivities": {"sensitivities": ["mu", "d"]}}
PARAMETERS = {"slope": {"between": [-0.3, 0.0]}, "force": {"between": [10.0, 30.0]}}
LONG = ("motion", "compare-motion", "cycles", "branch")  # analyses in time, and of periodic motion


@cache
def superelement() -> str:
    """A folder of `write_matrices` with a reduced beam."""
    folder = Path(tempfile.mkdtemp()) / "beam"
    beam = fs.beam(1.0, 10, E=2.1e11, I=1.7e-9, rho=7850.0, A=2e-4, supports={"left": "clamped"}, interface=["right"],
                   ports={"belt": 0.5}, rayleigh=(5.0, 1e-6))
    fs.write_matrices(folder, fs.reduce(beam, fs.CraigBampton(6), ports=True))
    return str(folder / "model.json")


@cache
def few_rows() -> dict[str, Any]:
    """Files of matrices of 7 DOF: of as many as in calculix/beam, analyses in time take ten times as long and show no more."""
    folder = Path(tempfile.mkdtemp())
    for name in "MDK":
        scipy.io.mmwrite(folder / name, sp.coo_array(getattr(fs.chain(7), name)))
    files = {name: str(folder / f"{name}.mtx") for name in "MDK"}
    return {"part": {"p": {"matrices": files, "interface": [0, 3], "ports": {"belt": [1]}}}, "band": [0.0, 1.0]}


def table(part: str, ask: str, reduced: bool) -> dict[str, Any]:
    """The scene of a cell."""
    base = PARTS[part] if part != "superelement" else {**PARTS[part], "part": {"p": {"superelement": superelement()}}}
    if part == "matrices" and ask in LONG:
        base = few_rows()
    found: dict[str, Any] = {**base, "ask": [ASKS[ask] if part != "affine" else PENCIL.get(ask, ASKS[ask])], "figures": False}
    if part != "affine":
        found |= {"contact": belt("chain" if base == few_rows() else part), "parameter": dict(PARAMETERS)}
        if ask in ("map", "scatter", "sensitivities", "flutter"):
            found["contact"] = {"belt": {"belt": "p.belt", "force": FORCES[part], "slope": -0.1}}
            if part == "chain":  # forces that it is not far beyond the border with
                found["parameter"]["force"] = {"between": [0.2, 0.6]}
        if ask == "helps":
            found["parameter"]["damper"] = {"damper": "p.belt"}
    if reduced:
        found["reduce"] = {"methods": ["box"]} if part == "affine" else {"methods": ["craig-bampton"], "modes": [2, 4],
                                                                         "repeats": 1}
    return found


CELLS = [(part, ask, reduced) for part in PARTS for ask in ASKS for reduced in (False, True)]
#: why a cell is refused: of all parts, of one kind, and without reduced models
NEEDS_REDUCED = ("compare", "springs", "compare-motion", "matrices", "audit")
REFUSED: dict[tuple[str, str], str] = {
    **{("", "modes-per-part"): "needs several parts"},
    **{("affine", ask): "a pencil of matrices" for ask in ASKS if ask not in (*PENCIL, "complex-modes")},
    **{(part, "masses"): "no DOF map with places" for part in ("chain", "matrices")},
}


def reason(part: str, ask: str, reduced: bool) -> str:
    """Why a cell is refused; '' of one that works."""
    if found := REFUSED.get((part, ask)) or REFUSED.get(("", ask), ""):
        return found
    if ask in NEEDS_REDUCED and not reduced and not (ask == "audit" and part == "superelement"):
        return "needs reduced models"
    return ""


@cache
def outcome(part: str, ask: str, reduced: bool) -> tuple[Scene, dict[str, Any]]:
    """The scene of a cell, and its data."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene = Scene(table(part, ask, reduced))
        return scene, scene.run(lambda text: None).data


def test_all_kinds_are_in_the_table() -> None:
    kinds = Kinds()
    assert sorted(PARTS) == kinds.names("part")
    assert sorted(ASKS) == kinds.names("ask")


def test_the_docs_say_how_many_cells_work() -> None:
    working = sum(not reason(*cell) for cell in CELLS)
    page = (Path(__file__).parents[1] / "docs/guide/scenes.md").read_text(encoding="utf-8")
    assert f"{working} of {len(CELLS)}" in page


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("part", "ask", "reduced"), [pytest.param(*cell, marks=pytest.mark.slow) if cell[1] in LONG else cell
                                                      for cell in CELLS])
def test_every_part_goes_with_every_analysis(part: str, ask: str, reduced: bool) -> None:
    if why := reason(part, ask, reduced):
        with pytest.raises(InputError, match=why):
            outcome(part, ask, reduced)
        return
    scene, data = outcome(part, ask, reduced)
    assert "failed" not in data and data.get("complete", True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        CHECKS[ask](scene, data)


# each analysis beside the Python call


def close(found: Any, exact: Any, tol: float = 1e-8) -> bool:
    """Whether numbers agree, relative to the largest."""
    found, exact = np.asarray(found, dtype=complex), np.asarray(exact, dtype=complex)
    return bool(found.shape == exact.shape
                and np.abs(found - exact).max(initial=0.0) <= tol * max(np.abs(exact).max(initial=0.0), 1e-300))


def acting(scene: Scene) -> Any:
    """The contacts of the Python call: the belt's slope."""
    belts = [one for one in scene.models.contacts if isinstance(one, fs.Belt)]
    return [fs.Belt(port=one.port, force=one.force, slope=one.slope) for one in belts] or None


def pencil_at(scene: Scene, **values: float) -> Any:
    """The full model of a pencil at values of its parameters."""
    return scene.models.full.at(**{"mu": 0.9, "d": 1.0} | values)


def band(scene: Scene) -> tuple[float, float]:
    lo, hi = scene.settings.band
    return lo, hi


def below(scene: Scene) -> tuple[float, float]:
    """The band up to the cut-off of the largest reduced model."""
    return scene.models.band_below(scene.models.best)


def spectrum(scene: Scene) -> fs.ComplexModes:
    """Complex modes of the full model in the band."""
    if scene.models.pencil:
        return fs.complex_modes(pencil_at(scene), band=band(scene))
    return fs.complex_modes(scene.models.full, acting(scene), band=band(scene))


def check_modes(scene: Scene, data: dict[str, Any]) -> None:
    exact = fs.normal_modes(scene.models.full, band=band(scene))
    assert close([row["omega"] for row in data["modes"]["rows"]], exact.frequencies)


def check_complex_modes(scene: Scene, data: dict[str, Any]) -> None:
    rows, exact = data["complex-modes"]["models"], spectrum(scene)
    assert rows[0]["model"] == "full" and len(rows) == (3 if scene.reduce.methods and not scene.models.pencil else len(rows))
    keep = ~exact.rigid & (exact.eigenvalues.imag >= 0)
    assert close(rows[0]["growth"], exact.eigenvalues.real[keep].max(), 1e-6)
    assert len(data["complex-modes"]["unstable"]) == sum(exact.eigenvalues[exact.unstable].imag >= 0)


def check_critical(scene: Scene, data: dict[str, Any]) -> None:
    rows = data["critical"]
    if scene.models.pencil:
        assert close(rows[0]["value"], 0.75 * (1 + 2 * 0.05 * 0.1), 1e-6)
        return
    if np.isnan(rows[0]["value"]):  # a border needs a regular M, which a superelement need not have
        assert "M is singular" in rows[0]["reason"]
        return
    exact = fs.critical_slope(scene.models.full, "belt", force=acting(scene)[0].force, band=band(scene))
    assert rows[0]["model"] == "full" and rows[0]["value"] == pytest.approx(exact.value, rel=1e-6)
    for row, known in zip(rows[1:], scene.models.reduced, strict=True):
        if not row["reason"]:
            own = fs.critical_slope(known.model, "belt", force=acting(scene)[0].force, band=band(scene))
            assert row["value"] == pytest.approx(own.value, rel=1e-6)


def check_flutter(scene: Scene, data: dict[str, Any]) -> None:
    parameter, first = ("mu", 0.0) if scene.models.pencil else ("slope", -0.3)
    found = [row["growth"] for row in data["flutter"]["branches"] if row[parameter] == first]
    model = scene.models.best.model
    exact = fs.complex_modes(pencil_at(scene, mu=first), band=band(scene)) if scene.models.pencil else fs.complex_modes(
        model, fs.Belt(port="belt", force=acting(scene)[0].force, slope=first), band=below(scene))
    inside = exact.eigenvalues[(exact.eigenvalues.imag >= 0) & ~exact.rigid]
    assert found and max(found) == pytest.approx(inside.real.max(), rel=1e-6, abs=1e-9)


def check_compare(scene: Scene, data: dict[str, Any]) -> None:
    rows, exact = data["compare"]["rows"], fs.normal_modes(scene.models.full, band=band(scene))
    assert [row["method"] for row in rows] == ["full", "craig-bampton", "craig-bampton"]
    for row, known in zip(rows[1:], scene.models.reduced, strict=True):
        own = fs.normal_modes(known.model, count=known.model.size).frequencies
        mine = exact.frequencies[exact.rigid:]
        error = max((np.abs(own - omega).min() / omega for omega in mine), default=0.0)
        assert row["size"] == known.model.size
        if known.model.cutoff > band(scene)[1] and not row["missing"]:
            assert row["error_frequency"] == pytest.approx(error, rel=1e-3, abs=1e-9)


def check_response(scene: Scene, data: dict[str, Any]) -> None:
    omega = np.linspace(band(scene)[0] or band(scene)[1] / 5, band(scene)[1], 5)
    exact = fs.frequency_response(fs.damped(scene.models.full, structural=0.01), at=omega, loads="belt")
    assert data["response"]["evidence"] == exact.evidence
    for row, known in zip(data["response"]["rows"], scene.models.reduced, strict=True):
        own = fs.frequency_response(fs.damped(known.model, structural=0.01), at=omega, loads="belt")
        size = np.abs(exact.entry("belt", "belt")).max()
        assert row["error"] >= 0.999 * float(np.abs(own.entry("belt", "belt") - exact.entry("belt", "belt")).max() / size) - 1e-12


def check_springs(scene: Scene, data: dict[str, Any]) -> None:
    full = scene.models.full
    condensed = np.diag(fs.reduce(full, fs.CraigBampton(0)).K)[:len(full.interface)]
    bare = full.K.diagonal()[full.interface]
    own = np.where(condensed > 1e-9 * bare, condensed, bare)
    count = min(8, min(known.model.size for known in scene.models.reduced))

    def frequencies(model: Any) -> Any:
        K, M = (A.toarray() if hasattr(A, "toarray") else np.array(A) for A in (model.K, model.M))
        K[model.interface, model.interface] += own
        found = np.sqrt(np.abs(la.eigh(K, M + 1e-14 * np.trace(M) / len(M) * np.eye(len(M)), eigvals_only=True)[:count]))
        return found[found > 1e-4 * found.max()]

    exact = frequencies(full)
    for row, known in zip(data["springs"], scene.models.reduced, strict=True):
        mine = frequencies(known.model)
        if len(mine) == len(exact):
            assert row["error"] == pytest.approx(np.abs(mine / exact - 1).max(), rel=1e-2, abs=1e-7)


def check_growth(scene: Scene, data: dict[str, Any]) -> None:
    full = data["growth"]["panels"][0]
    exact = fs.sweep(scene.models.full, fs.Belt(port="belt", force=1.0, slope=0.0), "slope", data["growth"]["slopes"],
                     band=band(scene))
    assert close(full["growth"][0], exact.growth, 1e-6)


def check_friction_law(scene: Scene, data: dict[str, Any]) -> None:
    curve = next(one for one in data["friction-law"]["curves"] if one["law"] == "stribeck-arctan" and one["eps"] == 0.01)
    assert close(curve["value"], fs.StribeckArctan(eps=0.01).value(data["friction-law"]["speed"]))


def check_motion(scene: Scene, data: dict[str, Any]) -> None:
    rows = data["motion"]["models"]
    assert [row["model"] for row in rows] == ["full", *["craig-bampton"] * (2 if scene.reduce.methods else 0)]
    for row in rows:
        assert row["complete"] and row["rms"] is not None and abs(row["energy_residual"]) < 5e-2


def check_compare_motion(scene: Scene, data: dict[str, Any]) -> None:
    found = spectrum_of(scene.models.best.model, scene)
    fastest = found.eigenvalues[(found.eigenvalues.imag > 0) & ~found.above_cutoff]
    assert data["compare-motion"]["period"] == pytest.approx(2 * np.pi / fastest[fastest.real.argmax()].imag)
    assert [row["model"] for row in data["compare-motion"]["rows"]] == ["full", "craig-bampton", "craig-bampton"]


def spectrum_of(model: Any, scene: Scene) -> fs.ComplexModes:
    return fs.complex_modes(model, acting(scene))


def check_cycles(scene: Scene, data: dict[str, Any]) -> None:
    rows = [row for row in data["cycles"] if "omega" in row]
    assert rows
    model = scene.models.full if rows[0]["model"] == "full" else scene.models.best.model
    exact = fs.harmonic_balance(model, scene.models.contacts, start=rows[0]["family"])
    assert rows[0]["omega"] == pytest.approx(exact.omega, rel=1e-6) and rows[0]["rms"] == pytest.approx(exact.rms, rel=1e-4)


def check_branch(scene: Scene, data: dict[str, Any]) -> None:
    begun = [row for row in data["branch"] if row.get("hopf")]
    assert begun
    belt = acting(scene)[0]
    exact = fs.critical_slope(scene.models.full, "belt", force=1.0, band=band(scene))
    if begun[0]["model"] == "full":  # F μ' at the Hopf point
        assert begun[0]["hopf"]["value"] * belt.slope == pytest.approx(exact.value, rel=1e-3)


def check_audit(scene: Scene, data: dict[str, Any]) -> None:
    known = scene.models.reduced
    assert len(data["audit"]["rows"]) == len(known) + (type(scene.parts["p"]).KIND == "superelement")
    if known:
        exact = fs.audit(known[-1].model, scene.models.full)
        assert data["audit"]["rows"][-1]["faults"] == len(exact.faults)


def check_map(scene: Scene, data: dict[str, Any]) -> None:
    corner = fs.complex_modes(pencil_at(scene, mu=1.5, d=1.5), band=band(scene)) if scene.models.pencil \
        else fs.complex_modes(scene.models.best.model, fs.Belt(port="belt", force=scene.parameters["force"].between[1],
                                                                slope=-0.3), band=below(scene))
    assert data["map"]["growing"][""] >= sum(corner.eigenvalues[corner.unstable].imag >= 0)


def check_scatter(scene: Scene, data: dict[str, Any]) -> None:
    lo, hi = data["scatter"]["interval"]
    assert 0 <= lo <= data["scatter"]["probability"] <= hi <= 1 and data["scatter"]["samples"] >= 32


def check_sensitivities(scene: Scene, data: dict[str, Any]) -> None:
    row = data["sensitivities"][0]
    step, value = 1e-5, row["growth"] + 1j * row["omega"]
    ends = []
    for sign in (1, -1):
        if scene.models.pencil:
            found = fs.complex_modes(pencil_at(scene, mu=0.9 + sign * step), band=band(scene))
        else:
            belt = acting(scene)[0]
            found = fs.complex_modes(scene.models.best.model, fs.Belt(port="belt", force=belt.force, slope=belt.slope
                                                                      + sign * step),
                                     band=below(scene))
        ends.append(found.eigenvalues[np.abs(found.eigenvalues - value).argmin()])
    slope = (ends[0] - ends[1]) / (2 * step)
    assert row["growth_slope"] == pytest.approx(slope.real, rel=1e-3, abs=1e-3 * abs(slope))


def check_card(scene: Scene, data: dict[str, Any]) -> None:
    model = scene.models.best.model
    modes = fs.complex_modes(model, acting(scene), band=below(scene))
    near = int(np.abs(modes.eigenvalues - data["card"][0]["eigenvalue"]).argmin())
    assert fs.mode_cards(model, acting(scene), modes, [near])[0].sentence == data["card"][0]["sentence"]


def check_helps(scene: Scene, data: dict[str, Any]) -> None:
    model = scene.models.best.model
    changed = fs.modified(model, [fs.AddedDamper("belt", 5.0)])
    exact = fs.complex_modes(changed, acting(scene), band=below(scene))
    keep = (exact.eigenvalues.imag >= 0) & ~exact.rigid
    assert data["helps"]["rows"][0]["growth"] == pytest.approx(exact.eigenvalues.real[keep].max(), rel=1e-5, abs=1e-9)


def check_parts(scene: Scene, data: dict[str, Any]) -> None:
    mesh = scene.meshes.get("p")
    assert data["parts"] == ([] if mesh is None else [{"part": "p", "nodes": len(mesh.points), "cells": len(mesh.cells),
                                                       "kind": mesh.kind}])


def check_masses(scene: Scene, data: dict[str, Any]) -> None:
    modes = fs.normal_modes(scene.models.full, band=band(scene))
    exact = fs.effective_masses(scene.models.full, modes)
    assert [row["omega"] for row in data["masses"][:len(modes.frequencies)]] == pytest.approx(exact.frequencies)


def check_matrices(scene: Scene, data: dict[str, Any]) -> None:
    assert data["matrices"] == ["craig-bampton-2", "craig-bampton-4"]


CHECKS = {name: globals()[f"check_{name.replace('-', '_')}"] for name in ASKS if name != "modes-per-part"}
