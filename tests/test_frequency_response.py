"""Receptances against closed forms and dense solutions; the bound of the modal way at every frequency; structural damping."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from benchmarks.lattices import lattice
from femsub.algebra import factors_made
from femsub.modes import receptance

Response = fs.FrequencyResponse


def dense(model: fs.Substructure, omega: Any, F: np.ndarray, C: np.ndarray, contacts: Any = None) -> np.ndarray:
    """Cᵀ(-ω²M + iωD + K + iH)⁻¹F by LAPACK, one frequency after the other."""
    pencil = model.linearised(contacts, structural=True).dense()
    H = np.zeros(pencil.K.shape) if model.H is None else model.H.toarray() if sp.issparse(model.H) else model.H
    return np.array([C.T @ np.linalg.solve(pencil.at(1j * w) + 1j * H, F) for w in np.atleast_1d(omega)])


def within(found: Response, exact: Response) -> bool:
    return bool((np.abs(found.receptance - exact.receptance) <= found.bound + exact.bound).all())


# closed forms

def test_two_masses_with_a_loss_factor_for_each_spring() -> None:
    m, k, eta, omega = (2.0, 3.0), (50.0, 70.0), (0.02, 0.3), np.linspace(0.0, 9.0, 40)
    wall = fs.damped(fs.Substructure([[m[0]]], [[k[0]]], interface=[0]), structural=eta[0])
    spring = fs.Substructure(np.diag([0.0, m[1]]), k[1] * np.array([[1, -1], [-1, 1]]), interface=[0], ports={"end": [0.0, 1.0]})
    system = fs.couple({"wall": wall, "free": fs.damped(spring, structural=eta[1])}, [fs.Rigid(("wall", [0]), ("free", [0]))])
    found = fs.frequency_response(system, at=omega, loads="free.end").receptance[:, 0, 0]
    a, b = (k_ * (1 + 1j * eta_) for k_, eta_ in zip(k, eta, strict=True))
    det = (a + b - omega**2 * m[0]) * (b - omega**2 * m[1]) - b**2
    assert found == pytest.approx((a + b - omega**2 * m[0]) / det, rel=1e-12)


@pytest.mark.parametrize("method", ["direct", "modal"])
def test_the_chain_with_a_loss_factor_has_its_closed_form(method: str) -> None:
    n, eta, omega = 30, 0.01, np.linspace(0.0, 1.9, 50)
    chain = fs.damped(fs.chain(n, belt=1, damping=0.0), structural=eta)
    found = fs.frequency_response(chain, at=omega, loads=[0], responses=[0, n - 1], method=method)
    j, at = np.arange(1, n + 1), np.array([1, n])
    shapes = 2 / np.sqrt(2 * n + 1) * np.sin(np.outer(at, (2 * j - 1) * np.pi / (2 * n + 1)))
    exact = (shapes * shapes[0] / (fs.chain_frequencies(n) ** 2 * (1 + 1j * eta) - omega[:, None, None] ** 2)).sum(axis=2)
    assert np.abs(found.receptance[..., 0] - exact).max() < 1e-9 * np.abs(exact).max()
    assert (np.abs(found.receptance[..., 0] - exact) <= found.bound[..., 0] + 1e-12).all()


def test_a_pinned_beam_tends_to_its_closed_form_with_the_fourth_power() -> None:
    beta, E, I, rho, A = 4.0, 2.1e11, 1e-8, 7850.0, 1e-4  # noqa: E741
    omega = beta**2 * np.sqrt(E * I / (rho * A))  # between the first two modes, L = 1
    x = 0.25  # h(x, x) of a force at x
    parts = (sign * f(beta * x) * f(beta * (1 - x)) / f(beta) for f, sign in ((np.sin, 1), (np.sinh, -1)))
    exact = sum(parts) / (2 * beta**3 * E * I)
    errors = []
    for elements in (16, 32):
        beam = fs.beam(1.0, elements, E=E, I=I, rho=rho, A=A, supports={"left": "pinned", "right": "pinned"}, ports={"x": x})
        errors.append(abs(fs.frequency_response(beam, at=omega).receptance[0, 0, 0].real / exact - 1))
    assert errors[1] < 1e-6 and np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.2)


# against LAPACK

def plate() -> fs.Substructure:
    return fs.plate(fs.rectangle((1.0, 0.7), (6, 5)), thickness=0.01, E=2.1e11, nu=0.3, rho=7850.0, supports={"left": "clamped"},
                    interface=["right"], rayleigh=(2.0, 1e-6), name="plate")


def coupled() -> fs.Substructure:
    """A plate on a soft pad of two materials, one of which has a loss factor, with a dashpot."""
    mesh = replace(fs.block((0.2, 0.2, 0.1), (2, 2, 2), "hexahedron"), groups={"low": range(4), "high": range(4, 8)})
    rubber, steel = fs.Material(1e7, 0.3, 1200.0, loss=0.2), fs.Material(2e9, 0.3, 7800.0)
    pad = fs.solid(mesh, {"low": rubber, "high": steel}, supports=["left"], interface=["right"], name="pad")
    one = fs.damped(fs.chain(40, interface=[40], belt=3), ratios=((0.1, 0.01), (1.0, 0.02)))
    return fs.couple({"pad": pad, "chain": one}, [fs.Spring(("pad", [int(pad.interface[0])]), ("chain", [39]), stiffness=3.0,
                                                           damping=0.1)])


@pytest.mark.parametrize("make", [plate, coupled])
def test_direct_and_modal_responses_of_plate_and_coupled_parts(make: Any) -> None:
    model = make()
    top = 1.1 * fs.normal_modes(model, count=6).frequencies[-1]
    omega, dof = np.linspace(0.0, top, 30), [0, 7, model.size - 1]
    F = np.eye(model.size)[:, dof]
    exact = dense(model, omega, F, F)
    direct = fs.frequency_response(model, at=omega, loads=dof, method="direct")
    assert (np.abs(direct.receptance - exact).max(axis=(1, 2)) < 1e-9 * np.abs(exact).max(axis=(1, 2))).all()
    assert direct.direct.all() and direct.residual.max() < 1e-14 and direct.evidence == "certified"
    modal = fs.frequency_response(model, at=omega, loads=dof, method="modal")
    assert within(modal, direct) and not modal.direct.any() and modal.modes >= 6
    assert modal.evidence == "certified" and modal.residual.max() < 1e-2


def test_about_the_sliding_state_contacts_add_to_d_and_k() -> None:
    chain = fs.chain(150, belt=2)
    ports = {"n": np.eye(150)[4], "t": np.eye(150)[9], "belt": chain.port("belt")}
    two = fs.Substructure(chain.M, chain.K, chain.D, ports=ports)
    rubbing = fs.LinearContact(("n", "t"), stiffness=[[2.0, 0.0], [0.6, 0.0]], damping=[[0, 0.1], [0, 0.2]])
    acting = [fs.Belt(slope=-0.05), rubbing]
    omega, F = np.linspace(0.0, 0.2, 25), np.column_stack([two.port(name) for name in two.ports])
    exact = dense(two, omega, F, F, acting)
    assert not np.allclose(exact, dense(two, omega, F, F), rtol=1e-3)
    assert not np.allclose(exact, exact.transpose(0, 2, 1), rtol=1e-3)
    for method in ("direct", "modal"):
        found = fs.frequency_response(two, acting, at=omega, method=method)
        assert np.abs(found.receptance - exact).max() < 1e-9 * np.abs(exact).max() and found.loads == ("n", "t", "belt")
        assert (np.abs(found.receptance - exact) <= found.bound + 1e-11).all()


def at_random(seed: int) -> tuple[fs.Substructure, Any]:
    """A model, held or floating, with dashpots, distributed, Rayleigh or no damping, loss factors and contacts in any mix."""
    rng = np.random.default_rng([31, seed])
    model: fs.Substructure = lattice(int(rng.integers(3, 8)), int(rng.integers(3, 6)), held=bool(rng.random() < 0.7))
    n = model.size
    scale = float(np.abs(model.K).max() * model.M.diagonal().max()) ** 0.5
    kind = rng.integers(4)
    if kind == 1:
        at = rng.choice(n, int(rng.integers(1, 5)), replace=False)
        model = model.with_damping(sp.csr_array((scale * rng.random(len(at)), (at, at)), shape=(n, n)))
    elif kind == 2:
        model = model.with_damping(sp.diags_array(scale * 0.1 * rng.random(n) ** 4))
    elif kind == 3:
        model = fs.damped(model, rayleigh=(0.01 * rng.random(), 0.05 * rng.random() / scale))
    if rng.random() < 0.5:
        model = fs.damped(model, structural=0.2 * rng.random())
    if rng.random() < 0.3:
        model = model.with_structural_damping(sp.diags_array(0.05 * model.K.diagonal() * rng.random(n)))
    model = fs.Substructure(model.M, model.K, model.D, ports={"a": rng.standard_normal(n), "b": np.eye(n)[:, rng.choice(n, 2)]},
                            H=model.H)
    acts = [fs.LinearContact(("a", "b"), stiffness=0.1 * scale * rng.standard_normal((3, 3)),
                             damping=0.1 * scale * rng.standard_normal((3, 3)))] if rng.random() < 0.4 else None
    return model, acts


@pytest.mark.sampled(40)
@pytest.mark.parametrize("seed", range(120))
def test_the_modal_way_is_within_its_bound_at_every_frequency(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    model, acts = at_random(seed)
    modes = fs.normal_modes(model, count=8)
    omega = np.linspace(0.05, 1.2, 23) * modes.frequencies[-1]
    exact = fs.frequency_response(model, acts, at=omega, method="direct")
    found = fs.frequency_response(model, acts, at=omega, method="modal")
    assert exact.evidence == "certified" and within(found, exact)
    chosen = fs.frequency_response(model, acts, at=omega, tol=1e-5)
    assert chosen.evidence == "certified"
    # it is a bound that tells something
    assert np.median(found.bound / np.abs(exact.receptance).max(axis=(1, 2), keepdims=True)) < 1e-6
    # a coarse basis: the modes and static responses alone, errors above rounding
    monkeypatch.setattr(receptance.Modal, "of", partial(receptance.Modal.of, reach=1.3, sweeps=0))
    coarse = fs.frequency_response(model, acts, at=omega, method="modal")
    assert within(coarse, exact) and not (coarse.bound > 1e5 * np.abs(exact.receptance).max(axis=(1, 2), keepdims=True)).any()


def feedback(way: str) -> sp.csr_array:
    """D of 150 DOF whose rows are not its columns: a sensor far from its actuator, turning forces, a full block."""
    D = sp.lil_array((150, 150))
    if way == "feedback":
        D[110, 21] = 10.0
    elif way == "gyroscopic":
        D[110, 21], D[21, 110], D[60, 60] = 3.0, -3.0, 0.2
    else:
        D[np.ix_([5, 90, 130], [40, 41, 140])] = np.random.default_rng(3).standard_normal((3, 3))
    return sp.csr_array(D)


@pytest.mark.parametrize("way", ["feedback", "gyroscopic", "block"])
def test_forces_may_act_elsewhere_than_the_motion_that_causes_them(way: str) -> None:
    n, omega = 150, np.linspace(0.01, 0.25, 12)
    ports = {"sensor": np.eye(n)[21], "far": np.eye(n)[133]}
    model = fs.Substructure(sp.eye_array(n), fs.chain(n).K, feedback(way), ports=ports)
    exact = fs.frequency_response(model, at=omega, method="direct")
    found = fs.frequency_response(model, at=omega, method="modal")
    assert exact.evidence == found.evidence == "certified" and within(found, exact)
    assert not np.allclose(exact.receptance[:, 0, 1], exact.receptance[:, 1, 0], rtol=1e-3)


def test_the_bound_holds_on_a_soft_mount() -> None:
    n, rng = 200, np.random.default_rng(8)
    k = 10 ** rng.uniform(-1, 1, n + 1)
    k[0], k[-1] = 3e-11, 0.0  # the rigid motion on it has 1e12 times the static response of what moves inside
    K = sp.diags_array([-k[1:n], k[:n] + k[1:n + 1], -k[1:n]], offsets=[-1, 0, 1]).tocsr()
    M = sp.diags_array(10 ** rng.uniform(-1, 1, n)).tocsr()
    model = fs.Substructure(M, K, 1e-3 * M, ports={"a": np.eye(n)[n // 3], "b": np.eye(n)[n - 5]})
    omega = np.linspace(0.05, 0.3, 12)
    exact = fs.frequency_response(model, at=omega, method="direct")
    found = fs.frequency_response(model, at=omega, method="modal")
    assert exact.evidence == found.evidence == "certified" and within(found, exact)


def test_where_the_equations_are_singular_within_rounding_nothing_is_known() -> None:
    """Two masses, in exact arithmetic: what LAPACK finds may be wrong by orders of magnitude, and by more than first order."""
    unknown, rng = 0, np.random.default_rng(1)
    for _ in range(150):
        k, omega = float(rng.uniform(1, 9)), float(10 ** rng.uniform(-9.5, -7))
        K, m = [[k * (1 + rng.integers(0, 3) * 2.2e-16), -k], [-k, k]], rng.uniform(0.5, 2, 2).tolist()
        model = fs.Substructure(np.diag(m), K, ports={"a": [1.0, 0.0]})
        a, b, c = (Fraction(x) - y * Fraction(omega) ** 2 for x, y in (
            (K[0][0], Fraction(m[0])), (K[1][1], Fraction(m[1])), (K[0][1], Fraction(0))))
        try:
            found = fs.frequency_response(model, at=omega)
        except fs.SingularMatrixError:
            continue
        error = abs(Fraction(found.receptance[0, 0, 0].real) - b / (a * b - c * c))
        unknown += np.isinf(found.bound[0, 0, 0])
        assert np.isinf(found.bound[0, 0, 0]) or error <= Fraction(found.bound[0, 0, 0])
    assert unknown


# what is chosen, and what is told

def test_few_frequencies_are_solved_directly_and_many_by_one_real_factor() -> None:
    chain = fs.damped(fs.chain(500, belt=2), structural=0.01)
    few = fs.frequency_response(chain, at=np.linspace(0.01, 0.02, 7))
    assert few.direct.all() and few.modes == 0
    before = factors_made()
    many = fs.frequency_response(chain, at=np.linspace(0.01, 0.02, 300))
    assert not many.direct.any() and many.modes > 3 and factors_made() - before <= 2  # K, and the count of modes
    assert many.evidence == "certified" and within(many, fs.frequency_response(chain, at=many.omega, method="direct"))


def test_where_the_bound_is_too_large_the_model_is_solved() -> None:
    chain = fs.chain(200, belt=2)
    skew = chain.D + sp.diags_array([np.full(199, 1e-3), np.full(199, -1e-3)], offsets=[1, -1])
    turning = chain.with_damping(skew)
    assert fs.frequency_response(turning, at=np.linspace(0.0, 0.1, 30)).direct.all()
    with pytest.raises(fs.InputError, match="unsymmetric D on many DOF"):
        fs.frequency_response(turning, at=[0.1], method="modal")
    found = fs.frequency_response(chain, at=np.linspace(0.0, 0.1, 30), tol=1e-15)  # no way is as accurate
    assert found.direct.all() and found.evidence == "not checked"


def test_errors_of_reduced_models_are_bounded() -> None:
    full = fs.damped(fs.chain(120, belt=2, damping=0.0), structural=0.03)
    omega, asked = np.linspace(0.0, 0.15, 20), {"loads": ["belt"], "responses": [10, "belt"]}
    exact = fs.frequency_response(full, at=omega, **asked)
    whole = dense(full, omega, full.port("belt")[:, None], np.column_stack([np.eye(120)[10], full.port("belt")]))
    previous = np.inf
    for modes in (4, 8, 16):
        small = fs.frequency_response(fs.reduce(full, fs.CraigChang(modes), ports=True), at=omega, **asked)
        error, true = small.error(exact), np.abs(small.receptance - whole)
        assert (true <= error).all() and error.max() < previous and error.max() < 1.01 * true.max() + 1e-6
        previous = error.max()
    assert previous < 0.05 * np.abs(whole).max()
    with pytest.raises(fs.InputError, match="the responses differ"):
        fs.frequency_response(full, at=omega).error(exact)
    with pytest.raises(fs.InputError, match="the frequencies differ"):
        small.error(fs.frequency_response(full, at=omega[:-1], **asked))


def test_a_study_compares_receptances_where_frequencies_are_given() -> None:
    chain, omega = fs.chain(60, belt=2, damping=0.2), np.linspace(0.01, 0.4, 15)
    belt = fs.Belt(slope=-0.02)
    found = fs.study(chain, [fs.CraigBampton(4), fs.CraigBampton(12)], (0.0, 0.3), contacts=belt, at=omega, ports=True, repeats=1)
    w = chain.port("belt")[:, None]
    exact = dense(chain, omega, w, w, belt)
    for row, model in zip(found.rows, found.models, strict=True):
        small = model.port("belt")[:, None]
        true = np.abs(dense(model, omega, small, small, belt) - exact).max() / np.abs(exact).max()
        assert row.error_response == pytest.approx(true, rel=1e-3)
    assert found.rows[1].error_response < found.rows[0].error_response and found.full.error_response == 0
    assert "err h" in str(found)
    assert np.isnan(fs.study(chain, [fs.CraigBampton(4)], (0.0, 0.3), repeats=1, ports=True).rows[0].error_response)


def test_mobility_accelerance_and_entries_by_name() -> None:
    found = fs.frequency_response(fs.chain(10, belt=2), at=[0.3, 0.5], loads=["belt", 4], responses=4)
    assert found.receptance.shape == (2, 1, 2) and found.loads == ("belt", "DOF 4") and found.responses == ("DOF 4",)
    assert found.mobility == pytest.approx(1j * found.omega[:, None, None] * found.receptance)
    assert found.accelerance == pytest.approx(1j * found.omega[:, None, None] * found.mobility)
    assert found.entry("DOF 4", "belt") == pytest.approx(found.receptance[:, 0, 0])
    with pytest.raises(fs.InputError, match="unknown load 'brake'"):
        found.entry("DOF 4", "brake")


def test_loads_are_ports_sets_dof_and_columns_of_full_and_reduced_models() -> None:
    sub = fs.beam(1.0, 6, E=1.0, I=1.0, rho=1.0, A=1.0, supports={"left": "clamped"}, interface=["right"], ports={"tip": "right"})
    rom = fs.reduce(sub, fs.CraigBampton(modes=10))
    by_set = fs.frequency_response(rom, at=2.0, loads="right")
    assert by_set.loads == ("right[0]", "right[1]")
    by_dof = fs.frequency_response(sub, at=2.0, loads=sub.interface.tolist(), responses=[0, 11])
    assert fs.frequency_response(rom, at=2.0, loads=sub.interface.tolist(), responses=[0, 11]).receptance == pytest.approx(
        by_dof.receptance, rel=1e-9)
    assert fs.frequency_response(sub, at=2.0, loads=np.eye(12)[:, 10:]).receptance == pytest.approx(by_set.receptance, rel=1e-9)


@pytest.mark.parametrize(("options", "message"), [
    ({"at": -1.0}, "none of them negative"), ({"at": []}, "at must be frequencies"), ({"at": 1.0, "loads": []}, "loads is empty"),
    ({"at": 1.0, "loads": "pad"}, "unknown port 'pad'"), ({"at": 1.0, "loads": 99}, "there is no DOF 99. 'chain' has 10"),
    ({"at": 1.0, "loads": np.ones(3)}, "the model has 10 DOF"), ({"at": 1.0, "method": "fast"}, "method"),
    ({"at": 1.0, "loads": ["belt", "belt"]}, "named 2 times"), ({"at": 1.0, "tol": 0}, "tol must be positive"),
    ({"at": 1.0, "responses": [True]}, "not True")])
def test_bad_input_is_named(options: dict[str, Any], message: str) -> None:
    with pytest.raises((fs.InputError, fs.InputTypeError), match=message):
        fs.frequency_response(fs.chain(10, belt=2), **options)


@pytest.mark.parametrize("method", ["direct", "modal"])
def test_a_resonance_without_damping_is_named(method: str) -> None:
    model = fs.Substructure(np.eye(2), np.diag([1.0, 4.0]), ports={"a": [1.0, 1.0]})
    with pytest.raises(fs.SingularMatrixError, match="singular at ω = 1, an undamped resonance"):
        fs.frequency_response(model, at=[0.5, 1.0], method=method)
    with pytest.raises(fs.SingularMatrixError, match="singular at ω = 0"):
        fs.frequency_response(fs.chain(5, belt=2, fixed=False), at=0.0, method="direct")


# structural damping travels

def test_loss_factors_of_materials_parts_and_reduced_models() -> None:
    mesh = fs.block((0.4, 0.1, 0.1), (4, 1, 1), "hexahedron")
    steel, pad = fs.Material(2e11, 0.3, 7800.0), fs.Material(2e11, 0.3, 7800.0, loss=0.1)
    plain, lossy = (fs.solid(mesh, one, supports=["left"], interface=["right"], name="bar") for one in (steel, pad))
    assert plain.H is None and abs(lossy.H - 0.1 * lossy.K).max() < 1e-15 * abs(lossy.K).max()
    assert abs(fs.damped(plain, structural=0.1).H - lossy.H).max() < 1e-12 * abs(lossy.H).max()
    methods = (fs.CraigBampton(3), fs.Rubin(3), fs.CraigChang(3), fs.Guyan(), fs.Guyan(2), fs.Hurty(3), fs.Herting(3),
               fs.MacNeal(3), fs.DualCraigBampton(3))
    roms = [fs.reduce(lossy, method) for method in methods]
    roms += [fs.reduce(roms[0], fs.InterfaceModes(4)), fs.reduce(roms[0], fs.CraigBampton(2))]
    for rom in roms:
        assert np.abs(rom.H - 0.1 * rom.K).max() < 1e-9 * np.abs(rom.K).max()
    assert lossy.with_damping(None).H is lossy.H and lossy.with_structural_damping(None).H is None
    with pytest.raises(fs.InputError, match="structural must not be negative"):
        fs.damped(plain, structural=-0.1)
    with pytest.raises(fs.InputError, match="H is not symmetric"):
        plain.with_structural_damping(sp.triu(plain.K))
    with pytest.raises(fs.InputError, match="which a cut does not divide"):
        fs.cut(fs.damped(fs.chain(10), structural=0.1), into=2)


def test_a_folder_holds_structural_damping(tmp_path: Any) -> None:
    from femsub.io.model_folder import read_model

    rom = fs.reduce(fs.damped(fs.chain(10), structural=0.1), fs.CraigBampton(3))
    fs.write_matrices(tmp_path / "model", rom)
    assert np.array_equal(read_model(tmp_path / "model").H, rom.H)


def test_the_scene_compares_receptances_and_tells_which_model_will_do(tmp_path: Any) -> None:
    from femsub.app.cli import main

    scene = tmp_path / "scene.toml"
    scene.write_text('scene = "frequency-response"\nfigures = false\n[part.beam]\nelements = 20\n[reduce]\nmodes = [4, 8]\n'
                     '[[ask]]\nresponse = ["beam.belt"]\nfrequencies = 50\nloss = 0.01\n')
    assert main(["run", "-q", str(scene), "--out", str(tmp_path / "out")]) == 0
    found = json.loads((tmp_path / "out" / "results.json").read_text())
    rows = found["response"]["rows"]
    assert [row["modes"] for row in rows] == [4, 8, 4, 8] and all(row["evidence"] == "certified" for row in rows)
    assert rows[1]["error"] < rows[0]["error"] and rows[3]["error"] < 1e-3 and found["verdict"]["answer"] == "yes"
    assert len((tmp_path / "out" / "response.csv").read_text().splitlines()) == 1 + 5 * 50
    chart = next(one for one in found["charts"] if one["name"] == "response")
    assert [len(panel["series"]) for place in chart["places"] for panel in place["panels"]] == [5, 5, 4]
