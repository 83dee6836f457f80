"""Contact modes: real modes of a system in contact and its responses to friction, for full and for reduced parts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import femsub as fs
from femsub.algebra import memory, petsc
from femsub.checks import Tally
from femsub.coupling.contacts.friction_contact import FrictionContact
from femsub.model import contacts_at, family_of
from femsub.stability.losses import first_loss
from femsub.stability.question import CriticalValue, LossQuestion

BAND = (1e3, 1.2e5)


def dense(part: fs.Substructure, key: str) -> fs.Substructure:
    """The same in dense matrices, whose complex modes take less time at this size."""
    M, K, D = (A.toarray() for A in (part.M, part.K, part.D))
    return fs.Substructure(M, K, D, {key: part.interface}, part.ports, part.name, part.dofs)


@cache
def pad() -> tuple[fs.System, tuple[FrictionContact, ...]]:
    """A block on springs that rubs on a beam, both of bricks; their faces do not match."""
    steel = fs.Material(2.1e11, 0.3, 7850.0)
    block, plate = fs.block((0.06, 0.03, 0.02), (3, 2, 1), "hexahedron"), fs.block((0.2, 0.05, 0.02), (7, 2, 1), "hexahedron")
    plate = fs.Mesh(plate.points - [0.07, 0.01, 0.02], plate.cells, plate.kind, plate.sets)
    ports = {end + axis: (end, axis) for end in ("left", "right") for axis in "xyz"}
    parts = {"pad": fs.solid(block, steel, interface=["bottom"], ports=ports, rayleigh=(5.0, 1e-8)),
             "beam": fs.solid(plate, steel, supports=["left", "right"], interface=["top"], rayleigh=(5.0, 1e-8))}
    parts = {name: dense(part, key) for (name, part), key in zip(parts.items(), ("bottom", "top"), strict=True)}
    meshes, along = {"pad": block, "beam": plate}, np.array([1.0, 0.0, 0.0])
    contact = FrictionContact("pad.bottom", "beam.top", meshes, 2e12, 0.3, direction=along)
    springs = [fs.Spring(("pad", port), stiffness=1e8) for port in parts["pad"].ports]
    return fs.couple(parts, [contact, *springs]), (contact,)


def at(mu: float) -> list[FrictionContact]:
    return [replace(contact, mu=mu) for contact in pad()[1]]


def errors(model: fs.Substructure, mu: float, count: int) -> np.ndarray:
    """|Δλ|/|λ| of the lowest modes."""
    exact, found = (fs.complex_modes(one, at(mu), band=BAND).eigenvalues[:count] for one in (pad()[0], model))
    return np.abs(found - exact) / np.abs(exact)


def test_without_friction_the_modes_are_those_of_the_system_in_contact() -> None:
    system, contacts = pad()
    small = fs.reduce(system, fs.ContactModes(12, contacts=contacts, friction=False))
    assert small.size == 12 and set(small.kinds) == {"real"}
    pencil = small.linearised(at(0.0))
    omega = np.sqrt(np.linalg.eigvalsh(pencil.K))
    held = system.linearised(at(0.0))
    true = fs.normal_modes(fs.Substructure(held.M, (held.K + held.K.T) / 2), count=13).frequencies
    np.testing.assert_allclose(omega, true[:12], rtol=1e-8)
    assert small.cutoff == pytest.approx(true[12], rel=1e-6)
    np.testing.assert_allclose(small.M, np.eye(12), atol=1e-9)


def test_the_model_holds_the_stiffness_of_the_system_without_the_contact() -> None:
    system, contacts = pad()
    small = fs.reduce(system, fs.ContactModes(8, contacts=contacts))
    np.testing.assert_allclose(small.K, small.V.T @ (system.K @ small.V), atol=1e-9 * np.abs(small.K).max())
    assert list(small.sets) == list(system.sets) and set(small.kinds) == {"real", "friction response"}


def test_responses_to_friction_leave_errors_of_higher_order_in_mu() -> None:
    system, contacts = pad()
    alone, more = (fs.reduce(system, fs.ContactModes(20, contacts=contacts, friction=friction)) for friction in (False, True))
    for mu in (0.1, 0.3):
        assert errors(more, mu, 5).max() < 0.1 * errors(alone, mu, 5).max()


def test_with_every_mode_the_spectrum_is_that_of_the_system() -> None:
    system, contacts = pad()
    rom = fs.reduce(system, {"pad": fs.CraigBampton(3), "beam": fs.CraigBampton(4)}, ports=True)
    whole = fs.reduce(rom, fs.ContactModes(rom.size, contacts=contacts))
    assert whole.size == rom.size
    exact, found = (fs.complex_modes(one, at(0.4), band=BAND).eigenvalues for one in (rom, whole))
    np.testing.assert_allclose(found, exact, rtol=1e-6)


@pytest.mark.parametrize("method", [fs.CraigBampton, fs.CraigChang, fs.Rubin])
def test_systems_of_reduced_parts_are_reduced_further(method: type) -> None:
    system, contacts = pad()
    roms = fs.reduce(system, {name: method(20) for name in system.parts}, ports=True)
    small = fs.reduce(roms, fs.ContactModes(20, contacts=contacts))
    assert small.size < 50 < roms.size
    assert errors(small, 0.3, 5).max() < 1e-2


def test_the_pencil_over_mu_is_that_of_the_contact() -> None:
    system, _ = pad()
    exact, found = system.linearised(at(0.35)), family_of(system, at(0.0), ["mu"], {"mu": (0.0, 2.0)}).at(mu=0.35)
    assert abs(exact.K - found.K).max() <= 1e-12 * abs(exact.K).max()


@pytest.mark.slow
def test_the_first_loss_of_the_full_model_is_near_that_of_the_reduced_one() -> None:
    system, contacts = pad()
    small = fs.reduce(system, fs.ContactModes(30, contacts=contacts))
    (mu, omega, _), (true, height, reason) = (first_loss(one, at(0.0), "mu", (0.0, 2.0), BAND) for one in (small, system))
    assert not reason
    assert true == pytest.approx(mu, rel=1e-2) and height == pytest.approx(omega, rel=1e-2)
    for value, sign in ((0.99 * true, -1), (1.01 * true, 1)):
        near = fs.complex_modes(system, at(value), band=(0.99 * height, 1.01 * height)).eigenvalues
        assert np.sign(near.real.max()) == sign


def test_a_loss_at_a_place_not_known_is_no_critical_value(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where a growing mode comes into the band at its edge: the reason is given, not the start of the interval."""
    def found(asked: object, contacts: object, parameter: str, between: tuple[float, float], *_: object) -> CriticalValue:
        question = LossQuestion(asked, contacts, parameter, None, between, BAND)  # type: ignore[arg-type]
        return CriticalValue.of(question, [], [], Tally(0), method="followed", lost=[between[0]], open=[between])

    monkeypatch.setattr("femsub.stability.losses.first_value", found)
    loss = first_loss(pad()[0], at(0.0), "mu", (0.0, 2.0), BAND)
    assert np.isnan(loss.value) and np.isnan(loss.omega) and "beyond mu = 0, at a place that is not known" in loss.reason


def test_a_large_interface_without_shapes_of_its_own_asks_for_no_memory(machine: Callable[..., None]) -> None:
    steel, mesh = fs.Material(2.1e11, 0.3, 7850.0), fs.block((0.2, 0.2, 0.01), (8, 8, 1), "hexahedron")
    wide = fs.solid(mesh, steel, supports=["top"], interface=["bottom"])
    contact = FrictionContact("bottom", "ground", mesh, 1e12, 0.3, direction=(1, 0, 0))
    petsc.load()  # else its libraries would count
    machine(free=1.1 * sum(memory.reduction_bytes(wide.K, 2, 2).values()), large=100)
    with pytest.raises(fs.NotEnoughMemoryError, match="fewer interface DOF"):
        fs.reduce(wide, fs.CraigBampton(2))
    assert fs.reduce(wide, fs.ContactModes(2, contacts=contact)).size == 4
    with pytest.raises(fs.NotEnoughMemoryError, match="fewer modes"):
        fs.reduce(wide, fs.ContactModes(150, contacts=contact))


@pytest.mark.parametrize("made", ["contact modes", "parts"])
def test_modes_under_friction_are_refined_to_those_of_the_full_model(made: str) -> None:
    system, contacts = pad()
    method = fs.ContactModes(20, contacts=contacts) if made == "contact modes" else {name: fs.CraigBampton(12) for name in
                                                                                  system.parts}
    model = fs.reduce(system, method, **({} if made == "contact modes" else {"ports": True}))
    out = fs.refine(system, fs.complex_modes(model, at(0.4), band=(1e3, 6e4)), model, at(0.4))
    exact = fs.complex_modes(system, at(0.4), band=(1e3, 6e4)).eigenvalues
    assert len(out.modes.eigenvalues) == len(exact) and out.factorisations == 1 and out.steps <= 6 and not out.lost.any()
    np.testing.assert_allclose(out.modes.eigenvalues, exact, rtol=1e-9)
    assert "a contact adds" in out.whole


def test_contact_modes_need_contacts_that_have_the_parameter() -> None:
    with pytest.raises(fs.InputError, match="needs the contacts of the system"):
        fs.ContactModes(4)
    with pytest.raises(fs.InputError, match=r"parameter 'my'.*mu"):
        fs.ContactModes(4, contacts=pad()[1], parameter="my")


def test_contacts_without_the_parameter_are_told(caplog: pytest.LogCaptureFixture) -> None:
    beside = fs.LinearContact("belt", damping=[[1.0]])
    with caplog.at_level("INFO", logger="femsub"):
        assert contacts_at([*pad()[1], beside], "mu", 0.25)[0].mu == 0.25
    assert "LinearContact has no mu and stays as it is" in caplog.text
    with pytest.raises(fs.InputError, match=r"unknown parameter 'mu'; valid: damping, ports, stiffness"):
        contacts_at(beside, "mu", 0.25)
