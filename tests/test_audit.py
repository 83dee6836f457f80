"""`audit`: each planted fault is found, and nothing is said of sound models; what cannot be known is told as such."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from benchmarks.attacks import audits
from femsub.app.cli import main
from femsub.reduction import METHODS

pytestmark = pytest.mark.filterwarnings("ignore::femsub.checks.PortWarning")  # belts on the inside are meant
BEAM: dict[str, Any] = {"E": 2.1e11, "I": 1.7e-9, "rho": 7850.0, "A": 2e-4}
STEEL = fs.Material(2.1e11, 0.3, 7850.0)
Given = dict[str, Any]


@cache
def full(supports: tuple[str, ...] = ()) -> fs.Substructure:
    """A bar of 84 DOF, whose interface are the twelve DOF of one end; its density is that of steel."""
    return fs.solid(fs.block((1.0, 0.1, 0.06), (6, 1, 1), "hexahedron"), STEEL, interface=["right"], supports=supports,
                    rayleigh=(2.0, 1e-7), name="bar")


@cache
def reduced(method: str = "craig-bampton", supports: tuple[str, ...] = ()) -> fs.ReducedSubstructure:
    return fs.reduce(full(supports), METHODS[method](8))


def given(rom: fs.ReducedSubstructure, *left_out: str) -> Given:
    """The model as another program gives it: matrices and lists, each of which may be changed."""
    told = {"M": rom.M.copy(), "K": rom.K.copy(), "D": rom.D.copy(), "V": rom.V.copy(), "kinds": list(rom.kinds),
            "full_interface": rom.full_interface.copy(), "dofs": rom.interface_dofs, "cutoff": rom.cutoff}
    if len(rom.interface):
        told["interface"] = rom.interface.copy()
    return {key: value for key, value in told.items() if key not in left_out}


def kept(told: Given, at: Any) -> Given:
    """The model with these coordinates only, or in another order."""
    at = np.atleast_1d(at)
    new = told | {key: told[key][np.ix_(at, at)] for key in "MKD"} | {"kinds": [told["kinds"][one] for one in at]}
    if "V" in told:
        new["V"] = told["V"][:, at]
    return new


def scaled(told: Given, columns: np.ndarray, keys: str = "MKDV") -> Given:
    """The model with its coordinates multiplied, in all of its matrices or in some."""
    both = np.outer(columns, columns)
    new = told | {key: told[key] * both for key in "MKD" if key in keys}
    if "V" in keys and "V" in told:
        new["V"] = told["V"] * columns
    return new


def changed(told: Given, key: str, value: Callable[[np.ndarray], np.ndarray | None]) -> Given:
    """The model with one of its matrices changed; the function may change it in place."""
    A = told[key].copy()
    result = value(A)
    return told | {key: A if result is None else result}


def put(*entries: tuple[int, int, float]) -> Callable[[np.ndarray], None]:
    """Multiplies some entries."""
    def within(A: np.ndarray) -> None:
        for i, j, by in entries:
            A[i, j] *= by
    return within


def cleared(told: Given, *places: tuple[int, int]) -> Given:
    """The model with entries of M and K set to zero, in both triangles."""
    zeros = put(*((i, j, 0.0) for i, j in places), *((j, i, 0.0) for i, j in places))
    return changed(changed(told, "M", zeros), "K", zeros)


def turned(sign: int) -> np.ndarray:
    columns = np.ones(20)
    columns[sign] = -1.0
    return columns


def grounded(A: np.ndarray) -> None:
    A[1, 1] += 1e4


def indefinite(A: np.ndarray) -> None:
    A[:3, :3] -= 2 * np.diag(np.diag(A)[:3])


def mixed(told: Given, angle: float) -> Given:
    """One mode takes in a little of another, which is called a mode all the same."""
    T = np.eye(20)
    T[13, 12] = angle
    return told | {key: T.T @ told[key] @ T for key in "MKD"} | ({"V": told["V"] @ T} if "V" in told else {})


def not_converged(told: Given) -> Given:
    """A mode with a share of one that is left out: mass 1 and orthogonal to the others, but of no frequency of the full model."""
    sub = full()
    handle = np.setdiff1d(np.arange(sub.size), told["full_interface"])
    K, M = (sp.csr_array(A)[handle][:, handle].toarray() for A in (sub.K, sub.M))
    modes = np.linalg.eigh(np.linalg.solve(L := np.linalg.cholesky(M), np.linalg.solve(L, K).T))[1]
    other = np.linalg.solve(L.T, modes[:, 9])
    V = reduced().V.copy()
    V[handle, 12] = np.cos(0.01) * V[handle, 12] + np.sin(0.01) * other
    new = told | {key: V.T @ (A @ V) for key, A in (("M", sub.M), ("K", sub.K), ("D", sub.D))}
    return new | ({"V": V} if "V" in told else {})


def other_part() -> fs.ReducedSubstructure:
    part = fs.solid(fs.block((1.0, 0.1, 0.05), (6, 1, 1), "hexahedron"), STEEL, interface=["right"])
    return fs.reduce(part, fs.CraigBampton(8))


def swapped(told: Given) -> Given:
    """Two coordinates of the interface in each other's place, in M, K and D."""
    at = np.arange(20)
    at[[0, 1]] = 1, 0
    return told | {key: told[key][np.ix_(at, at)] for key in "MKD"}


def few_digits(told: Given, digits: int = 6) -> Given:
    rounded = np.vectorize(lambda value: float(f"{value:.{digits - 1}e}"))
    return told | {key: rounded(told[key]) for key in "MKD"}


#: faults by what finds them: (the check, whether it is found without V, and without the full model); of a floating bar
ROOT = ("K = VᵀKV", "M = VᵀMV")
FAULTS: dict[str, tuple[Callable[[Given], Given], str, bool, bool]] = {
    "a mode dropped": (lambda m: kept(m, np.delete(np.arange(20), 14)), "modes below the cut-off", True, False),
    "the last mode dropped": (lambda m: kept(m, np.arange(19)), "modes below the cut-off", True, False),
    "two modes too few for the cut-off": (lambda m: m | {"cutoff": m["cutoff"] * 1.6}, "modes below the cut-off", True, False),
    "a mode twice": (lambda m: kept(m, [*range(20), 13]), "coordinates independent", True, True),
    "a mode twice as a mode of its own": (
        lambda m: cleared(kept(m, [*range(20), 13]), (13, 20)),
        "modes below the cut-off", True, True),
    "units of K": (lambda m: changed(m, "K", lambda A: 1e-3 * A), "static interface response", True, False),
    "units of M": (lambda m: changed(m, "M", lambda A: 1e-3 * A), "mass and inertia", True, True),
    "units of both": (lambda m: {**m, "M": 1e-3 * m["M"], "K": 1e-3 * m["K"]}, "static interface response", True, True),
    "weight for mass": (lambda m: changed(m, "M", lambda A: 9.80665 * A), "mass and inertia", True, True),
    "density": (lambda m: changed(m, "M", lambda A: A * 7.8 / 7.85), "mass and inertia", True, True),
    "mass lost at the interface": (lambda m: changed(m, "M", lambda A: np.diag(np.diag(A) * (np.arange(20) > 11))), "M positive",
                                   True, True),
    "mass lost at one DOF": (lambda m: changed(m, "M", put((5, 5, 0.5))), "inertia seen from the interface", True, True),
    "mass lost in one direction": (lambda m: scaled(m, np.where(np.arange(20) % 3 == 2, 0.9, 1.0) ** (np.arange(20) < 12), "M"),
                                   "mass and inertia", True, True),
    "K not symmetric": (lambda m: changed(m, "K", put((0, 3, 1.01))), "K symmetric", True, True),
    "half of K": (lambda m: changed(m, "K", np.triu), "K symmetric", True, True),
    "M not symmetric": (lambda m: changed(m, "M", put((13, 2, 1.001))), "M symmetric", True, True),
    "K indefinite": (lambda m: changed(m, "K", indefinite), "K positive", True, True),
    "M indefinite": (lambda m: changed(m, "M", indefinite), "M positive", True, True),
    "K of a mode negative": (lambda m: changed(m, "K", put((15, 15, -1))), "K positive", True, True),
    "a spring to the ground": (lambda m: changed(m, "K", grounded), "rigid motion strains nothing", True, True),
    "an entry changed": (lambda m: changed(m, "K", put((4, 7, 1.1), (7, 4, 1.1))), "rigid motion strains nothing", True, True),
    "DOF swapped": (swapped, "static interface response", True, True),
    "the sign of a DOF turned": (lambda m: scaled(m, turned(4), "MKD"), "static interface response", True, True),
    "a DOF in mm": (lambda m: scaled(m, np.where(np.arange(20) == 4, 1e-3, 1.0), "MKD"), "static interface response", True, True),
    "a mode not converged": (not_converged, "modes converged", True, False),
    "modes not orthogonal": (lambda m: mixed(m, 1e-3), "modes orthonormal", True, True),
    "modes scaled, matrices not": (lambda m: scaled(m, np.where(np.arange(20) == 12, 2.0, 1.0), "V"), "M = VᵀMV", False, False),
    "modes scaled in M_bi alone": (
        lambda m: changed(m, "M", lambda A: A * np.where((np.arange(20)[:, None] >= 12) ^ (np.arange(20) >= 12), 0.5, 1.0)),
        "coupling of modes and interface (M_bi)", True, False),
    "M_bi lost": (lambda m: changed(m, "M", lambda A: A * ~((np.arange(20)[:, None] >= 12) ^ (np.arange(20) >= 12))),
                  "coupling of modes and interface (M_bi)", True, False),
    "M_bi of another order": (
        lambda m: changed(m, "M", lambda A: np.block([[A[:12, :12], A[:12, :11:-1]], [A[:11:-1, :12], A[12:, 12:]]])),
        "coupling of modes and interface (M_bi)", True, False),
    "a constraint mode wrong": (
        lambda m: scaled(m, np.where(np.arange(20) == 7, 1.02, 1.0)), "static interface response", True, True),
    "constraint modes that share stiffness with the modes": (
        lambda m: changed(m, "K", lambda A: A + 1e-3 * np.sqrt(A[13, 13] * A[1, 1]) * (
            np.outer(np.eye(20)[13], np.eye(20)[1]) + np.outer(np.eye(20)[1], np.eye(20)[13]))),
        "modes and interface share no stiffness", True, True),
    "V of another part": (lambda m: m | {"V": other_part().V.copy()}, "K = VᵀKV", False, False),
    "the model of another part": (lambda m: m | {key: getattr(other_part(), key).copy() for key in "MK"},
                                  "static interface response", True, True),
    "V of another size": (lambda m: m | {"V": np.vstack([m["V"], m["V"][:3]])}, "same full model", False, False),
    "an interface list of another end": (
        lambda m: m | {"full_interface": np.arange(12)}, "interface list", True, False),
    "the interface list in another order": (
        lambda m: m | {"full_interface": m["full_interface"][::-1].copy()}, "interface list", True, False),
    "an interface coordinate twice": (lambda m: m | {"interface": [*range(11), 10]}, "sizes fit", True, True),
    "D negative": (lambda m: changed(m, "D", lambda A: -A), "D takes energy out", True, True),
    "D not symmetric": (lambda m: changed(m, "D", put((3, 5, 1.5))), "D symmetric", True, True),
    "D of other units": (lambda m: changed(m, "D", lambda A: 1e3 * A), "damping seen from the interface", True, False),
    "D lost": (lambda m: changed(m, "D", lambda A: 0 * A), "damping seen from the interface", True, False),
    "NaN": (lambda m: changed(m, "M", put((2, 2, np.nan))), "entries are numbers", True, True),
    "infinite": (lambda m: changed(m, "K", put((2, 9, np.inf))), "entries are numbers", True, True),
    "six digits": (few_digits, "digits", True, True),
    "single precision": (lambda m: m | {key: m[key].astype(np.float32).astype(float) for key in "MKD"}, "digits", True, True),
    "an empty coordinate": (lambda m: cleared(m, *((17, at) for at in range(20))), "coordinates independent", True, True),
    "matrices of two sizes": (lambda m: m | {"D": m["D"][:-1, :-1]}, "sizes fit", True, True),
}


def names(found: fs.Audit) -> list[str]:
    return [one.what for one in found.faults]


def alone(told: Given) -> fs.Audit:
    """Without the full model, but with what its user knows of the part: it floats, its mass, and its units."""
    return fs.audit({key: value for key, value in told.items() if key not in ("V", "full_interface")}, mass=47.1, floating=True,
                    units="SI")


@pytest.mark.sampled(10)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_found(fault: str) -> None:
    plant, check, without_v, by_itself = FAULTS[fault]
    found = fs.audit(plant(given(reduced())), full())
    in_projection = {"damping seen from the interface": "D = VᵀDV"}.get(check, check)  # with V, that check takes its place
    assert found.verdict == "fault" and in_projection in names(found), found.text
    assert all(one.said and one.todo for one in found.faults)
    if without_v:
        bare = fs.audit(plant(given(reduced(), "V")), full())
        assert check in names(bare) or (check == "interface list" and names(bare)), bare.text
    assert bool(alone(plant(given(reduced()))).faults) == by_itself


def test_the_sound_model_has_none_of_them() -> None:
    for found in (fs.audit(reduced(), full()), fs.audit(given(reduced()), full()), fs.audit(given(reduced(), "V"), full()),
                  alone(given(reduced())), fs.audit(given(reduced(), "V", "kinds"), full())):
        assert found.verdict == ("good" if found.full_size else "no fault found") and not found.faults, found.text
    assert fs.audit(reduced(), full()).evidence == "certified"


# sound models

#: components of all kinds, with an interface each: chains, beams, plates, solids, held and floating
PARTS: dict[str, Callable[[], fs.Substructure]] = {
    "chain": lambda: fs.chain(30, belt=3, interface=(1, 20)),
    "floating chain": lambda: fs.chain(40, belt=4, interface=(1, 40), fixed=False),
    "stiff and soft": lambda: fs.chain(40, interface=(1, 20), masses=np.exp(np.sin(np.arange(40))), springs=np.exp(
        3 * np.cos(np.arange(40)))),
    "beam": lambda: fs.beam(1.0, 20, supports={"left": "clamped"}, interface=["right"], rayleigh=(2.0, 1e-6), **BEAM),
    "floating beam": lambda: fs.beam(1.0, 20, interface=["left", "right"], **BEAM),
    "beam on springs": lambda: fs.beam(1.0, 20, interface=["right"], foundation=1e4, **BEAM),
    "plate": lambda: fs.plate(fs.rectangle((0.4, 0.3), (6, 4)), E=2.1e11, nu=0.3, rho=7850.0, thickness=0.002,
                              interface=["right"]),
    "bar": full,
    "held bar": lambda: full(("left",)),
    "bar in mm": lambda: fs.solid(fs.block((1000.0, 100.0, 60.0), (6, 1, 1), "hexahedron"), fs.Material(2.1e5, 0.3, 7.85e-9),
                                  interface=["right"], name="bar"),
    "bar on a slide": lambda: fs.solid(fs.block((1.0, 0.1, 0.06), (6, 1, 1), "hexahedron"), STEEL, interface=["right"],
                                       supports={"left": "yz"}),
}


def sound(part: str, sizes: tuple[int, ...]) -> list[fs.ReducedSubstructure]:
    """Models of a component by all methods, with so many modes each."""
    sub, found = PARTS[part](), []
    for name, method in METHODS.items():
        for modes in (None,) if name == "guyan" else sizes:
            try:
                found.append(fs.reduce(sub, method() if modes is None else method(modes)))
            except fs.FemsubError:  # an interface that does not hold the component, for instance
                continue
    return found


def check_sound(part: str, *sizes: int) -> int:
    """Audits all of them with and without the full model, as they are and as bare matrices; how many models there are."""
    sub, models = PARTS[part](), sound(part, sizes)
    for rom in models:
        for told in (rom, given(rom, "kinds"), given(rom, "V", "kinds", "cutoff", "dofs")):
            for found in (fs.audit(told, sub), fs.audit(told)):
                assert not found.faults, (rom, found.text)
        if rom.kinds.count("fixed-interface") + rom.kinds.count("free") == rom.modes > 0 and rom.cutoff < np.inf:
            assert fs.audit(rom, sub).evidence == "certified", rom
    return len(models)


@pytest.mark.parametrize("part", ["chain", "floating beam"])
def test_nothing_is_said_of_sound_models(part: str) -> None:
    assert check_sound(part, 4) >= 7


@pytest.mark.rare
def test_nothing_is_said_of_fifty_sound_models() -> None:
    assert sum(check_sound(part, 7) for part in PARTS) >= 50


@pytest.mark.parametrize("modes", [1, 2, 3])
def test_the_shape_of_a_port_among_coordinates_of_no_stated_kind_is_no_mode_that_failed_to_converge(modes: int) -> None:
    full = fs.chain(11, belt=3, interface=[1], fixed=True)
    rom = fs.reduce(full, fs.CraigBampton(modes), ports=True)
    given = {"M": rom.M, "K": rom.K, "D": rom.D, "interface": rom.interface, "full_interface": rom.full_interface,
             "dofs": rom.interface_dofs}
    assert not fs.audit(given, full).faults


@pytest.mark.parametrize("seed", [6, 20, 31, 50])
def test_the_rounding_of_the_reduced_stiffness_is_no_stiffness_against_rigid_motion(seed: int) -> None:
    n = np.arange(11)
    springs, masses = 1 + 0.9 * np.cos(seed + 3 * n), 1 + 0.5 * np.sin(seed + n)
    full = fs.chain(11, belt=2, interface=[1], fixed=False, springs=springs, masses=masses)
    found = fs.audit(fs.reduce(full, fs.MacNeal(8)), full)
    assert "static interface response" not in [one.what for one in found.faults]


@pytest.mark.parametrize(("kind", "seed"), [("sound", 124), ("planted without V", 61), ("planted without V", 89), ("sound", 5071),
                                            ("sound", 5113), ("sound", 5198), ("planted without V", 5076)])
def test_random_parts_with_few_inner_dof_or_none(kind: str, seed: int) -> None:
    """Herting's coordinates of a part of 12 inner DOF, 11 of them kept and 10 modes; parts that are all interface; MacNeal's
    models whose interface has mass, since some modes are solved for."""
    assert audits.attacked(kind, seed) == "certified"


@pytest.mark.parametrize("modes", [0, 4])
def test_rigid_coordinates_of_hurty_are_no_modes_of_mass_one(modes: int) -> None:
    """Two DOF hold the beam, so all of its interface coordinates are rigid motions; their masses are not 1."""
    whole = fs.beam(4.0, 26, E=2.1e11, I=1e-9, rho=7850.0, A=1e-4, interface=["right"])
    rom = fs.reduce(whole, fs.Hurty(modes))
    for told in (rom, given(rom, "V")):
        for found in (fs.audit(told, whole), fs.audit(told)):
            assert not found.faults, found.text


@pytest.mark.sampled(3)
@pytest.mark.parametrize("method", ["craig-chang", "dual-craig-bampton", "rubin", "hurty", "herting"])
@pytest.mark.parametrize("key", ["M", "K"])
def test_a_wrong_entry_of_any_coordinate_is_found_without_v(method: str, key: str) -> None:
    whole = PARTS["floating chain"]()
    rom = fs.reduce(whole, METHODS[method](4))
    assert not fs.audit(given(rom, "V"), whole).faults
    for j in range(rom.size):
        told = given(rom, "V")
        if key == "K" and rom.kinds[j] == "rigid":
            continue
        assert fs.audit(changed(told, key, put((j, j, 1.02))), whole).faults, rom.kinds[j]


def test_lost_mass_of_macneal_is_found() -> None:
    whole = PARTS["floating chain"]()
    rom = fs.reduce(whole, METHODS["macneal"](4))
    j = rom.kinds.index("free")
    assert not fs.audit(given(rom), whole).faults
    assert names(fs.audit(changed(given(rom), "M", put((j, j, 0.98))), whole))[0] == "M = VᵀMΦΦᵀMV"


def test_interface_modes_are_sound_too() -> None:
    mesh = fs.block((1.0, 0.1, 0.1), (9, 1, 1), "hexahedron")
    system = fs.couple(*fs.cut(mesh, fs.solid, into=3, material=STEEL, supports=["left"]))
    small = fs.reduce(system, dict.fromkeys(system.parts, fs.CraigBampton(4)))
    for model, whole in ((small, system), (fs.reduce(small, fs.InterfaceModes(6)), small)):
        assert not fs.audit(model, whole).faults and not fs.audit(model).faults


# what is stated, told and written

def test_what_its_user_knows_of_a_part_is_checked() -> None:
    told = given(reduced())
    assert {"mass as stated", "units fit"} <= {one.what for one in alone(told).findings if one.verdict == "good"}
    assert names(fs.audit(told, mass=40.0)) == ["mass as stated"]
    said = fs.audit(told, mass=0.0471).faults[0].said
    assert said == "the mass is 47.1, but 0.0471 is stated, by a factor of 1000 (as t against kg, or N/mm against N/m)"
    assert names(fs.audit(told, units="mm-t-s")) == ["units fit"]  # as if 1 m were 1 mm
    assert names(fs.audit(fs.reduce(PARTS["bar in mm"](), fs.CraigBampton(8)), units="mm-t-s")) == []
    held = fs.audit(given(reduced(supports=("left",))), floating=True)
    assert names(held) == ["rigid motion strains nothing"]
    assert names(fs.audit(told, cutoff=2 * told["cutoff"])) == []  # nobody can know
    stated = fs.audit(told, full(), cutoff=2 * told["cutoff"])
    assert names(stated) == ["modes below the cut-off", "frequencies within their bounds"]


def test_the_rigid_motion_of_a_plate_is_known_by_its_map() -> None:
    """Its DOF at a node are w, its slopes and its twist, which is 0 in rigid motion."""
    told = given(fs.reduce(PARTS["plate"](), fs.CraigBampton(4)))
    found = {one.what: one for one in fs.audit(told, floating=True).findings}["rigid motion strains nothing"]
    assert (found.verdict, found.said) == ("good", "3 rigid motions are free")
    assert names(fs.audit(changed(told, "K", grounded), floating=True)) == ["rigid motion strains nothing"]


def test_a_part_that_turns_has_an_unsymmetric_damping() -> None:
    told = changed(given(reduced()), "D", put((3, 5, 1.5)))
    assert names(fs.audit(told)) == ["D symmetric", "D takes energy out"] and not fs.audit(told, gyroscopic=True).faults
    sub = full()
    G = np.zeros((sub.size, sub.size))
    G[80, 79], G[79, 80] = 50.0, -50.0
    turning = sub.with_damping(sub.D + sp.csr_array(G))
    assert not fs.audit(fs.reduce(turning, fs.CraigBampton(8)), turning).faults
    assert names(fs.audit(given(fs.reduce(turning, fs.CraigBampton(8))), sub)) == ["D symmetric", "D = VᵀDV"]


def test_without_the_full_model_no_fault_is_no_proof() -> None:
    """A model from which a mode is missing looks sound by itself: the answer is neither yes nor good."""
    wrong = kept(given(reduced(), "V", "full_interface"), np.delete(np.arange(20), 14))
    found = fs.audit(wrong)
    assert (found.verdict, found.answer.answer) == ("no fault found", "no fault found") and fs.audit(wrong, full()).faults
    count = len(found.unknown)
    assert count and f"no fault found; {count} things cannot be known" in repr(found) and "good" not in repr(found)
    assert f"No fault found. {count} things cannot be known of model" in " ".join(found.text.split())
    assert found.record()["verdict"] == "no fault found" and "modes below the cut-off" in found.answer.headline


def test_causes_are_guessed() -> None:
    def todo(plant: Callable[[Given], Given]) -> str:
        found = fs.audit(plant(given(reduced(), "V")), full())
        return next(one.todo for one in found.faults if one.what == "static interface response")

    assert todo(lambda told: scaled(told, turned(4), "MKD")) == "The sign of interface DOF 4 is turned"
    assert todo(swapped) == "Interface DOF 0, 1 are in another order"
    assert todo(lambda told: changed(told, "K", lambda A: 1e3 * A)) == "Bring both models to one system of units"
    assert todo(lambda told: scaled(told, np.where(np.arange(20) == 7, 1.02, 1.0))) == \
        "Look at interface DOF 7: their constraint modes or entries"


def test_mass_and_inertia_are_those_of_the_bar() -> None:
    found = next(one for one in alone(given(reduced())).findings if one.what == "mass and inertia")
    assert found.verdict == "good" and found.said == "mass 47.1, its centre at (0.5, 0.05, 0.03)"


def test_up_to_where_it_may_be_trusted() -> None:
    found, bounded = fs.audit(reduced(), full()), fs.audit(reduced())
    true = fs.normal_modes(full(), len(found.omega)).frequencies[6:]
    assert found.lower == pytest.approx(true, rel=1e-9) and (found.error[found.omega <= found.trusted] <= 0.01).all()
    k = min(len(true), len(bounded.lower))
    assert (bounded.lower[:k] <= true[:k] * (1 + 1e-9)).all() and 0 <= bounded.trusted <= found.trusted
    dropped = fs.audit(kept(given(reduced()), np.delete(np.arange(20), 12)), full())
    first = fs.audit(given(reduced(), "cutoff"), full())
    assert dropped.cutoff < reduced().cutoff == pytest.approx(first.cutoff) and first.evidence == "certified"
    assert dropped.evidence == "not checked" and dropped.trusted < dropped.cutoff


def test_it_is_told_in_one_page_and_written_as_numbers() -> None:
    found = fs.audit(kept(given(reduced()), np.delete(np.arange(20), 12)), full())
    lines = found.text.splitlines()
    assert lines[1].startswith("No. ") and len(lines) <= 60 and max(map(len, lines)) <= 80
    record = found.record()
    assert record["verdict"] == "fault" and json.loads(json.dumps(record, allow_nan=False)) == record
    assert repr(found).startswith("Audit of 'model': fault, ")
    assert fs.audit(given(reduced(), "dofs")).text.count("Not known: ") == len(fs.audit(given(reduced(), "dofs")).unknown) == 2


@pytest.mark.parametrize(("call", "error", "words"), [
    (lambda: fs.audit({"M": np.eye(2)}), fs.InputError, "reduced needs M and K, but has M"),
    (lambda: fs.audit({"M": np.eye(2), "K": np.eye(2), "k": 1}), fs.InputError, "reduced has an entry 'k'; known are M, K"),
    (lambda: fs.audit({"M": np.eye(2), "K": np.ones(2)}), fs.InputError, "K must be a matrix"),
    (lambda: fs.audit({"M": np.eye(2), "K": np.eye(2), "kinds": 3}), fs.InputTypeError, "kinds must be"),
    (lambda: fs.audit({"M": np.eye(2), "K": np.eye(2), "cutoff": 0.0}), fs.InputError, "cutoff must be positive"),
    (lambda: fs.audit(np.eye(2)), fs.InputTypeError, "reduced must be a Substructure, a Pencil or a mapping"),
    (lambda: fs.audit(full(), {"M": 1}), fs.InputTypeError, "full must be a Substructure"),
    (lambda: fs.audit(full(), units="inch"), fs.InputError, "unknown units 'inch'"),
    (lambda: fs.audit(full(), floating="yes"), fs.InputTypeError, "floating must be True or False"),
    (lambda: fs.audit(full(), mass=-1.0), fs.InputError, "mass must be positive")])
def test_bad_input_is_named(call: Callable[[], object], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        call()


ODD = [{"M": 0 * np.eye(3), "K": np.eye(3)}, {"M": np.eye(3), "K": 0 * np.eye(3)}, {"M": -np.eye(3), "K": -np.eye(3)},
       {"M": [[1.0]], "K": [[2.0]]}, {"M": np.eye(3), "K": np.eye(3), "V": np.zeros((5, 3)), "full_interface": [0, 1]},
       {"M": 1e-90 * np.eye(3), "K": 1e90 * np.eye(3), "interface": [2], "cutoff": 1.0}, {"M": np.ones((2, 3)), "K": np.eye(3)}]


@pytest.mark.parametrize("at", range(len(ODD)))
def test_odd_matrices_are_answered(at: int) -> None:
    small = fs.Substructure(np.eye(5), 2 * np.eye(5) - np.eye(5, k=1) - np.eye(5, k=-1), interface=[0])
    for whole in (None, small):
        found = fs.audit(ODD[at], whole, floating=True, units="SI", mass=2.0)
        assert found.text and found.chart() and json.dumps(found.record(), allow_nan=False)


def test_a_pencil_and_a_full_model_can_be_audited() -> None:
    assert not fs.audit(fs.Pencil(np.eye(2), None, np.diag([1.0, 2.0]))).faults
    assert names(fs.audit(fs.Pencil(np.eye(2), None, [[1.0, 0.5], [0.1, 2.0]]))) == ["K symmetric"]
    assert not fs.audit(full(), full()).faults  # nothing is left out


# the command and the scene

@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the bar, its reduced model, and one from which a mode is missing, as bare matrices."""
    place = tmp_path_factory.mktemp("audit")
    fs.write_matrices(place / "full", full())
    fs.write_matrices(place / "small", reduced())
    at = np.delete(np.arange(20), 14)
    for key in "MK":
        np.save(place / f"{key}.npy", getattr(reduced(), key)[np.ix_(at, at)])
    dofs = reduced().interface_dofs
    assert dofs is not None and dofs.points is not None
    rows = [f"{node},{dofs.labels[kind]},{','.join(map(repr, point))}" for node, kind, point in zip(
        dofs.nodes.tolist(), dofs.components, dofs.points.tolist(), strict=True)]
    (place / "interface.csv").write_text("node,component,x,y,z\n" + "\n".join(rows) + "\n")
    return place


def test_the_command_prints_a_page_and_ends_with_1_at_a_fault(folder: Path, monkeypatch: pytest.MonkeyPatch,
                                                              capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(folder)
    assert main(["audit", "small", "--full", "full"]) == 0
    printed = capsys.readouterr().out
    assert printed.splitlines()[1].startswith("Yes. ") and max(map(len, printed.splitlines())) <= 80
    bare = ["audit", "M.npy", "K.npy", "--interface", ",".join(map(str, range(12))), "--cutoff", str(reduced().cutoff)]
    assert main([*bare, "--full", "full", "--out", "out", "--no-figures"]) == 1
    assert "No. " in (printed := capsys.readouterr().out) and "the full model has 8 modes below the stated cut-off" in printed
    told = json.loads((folder / "out" / "results.json").read_text(encoding="utf-8"))
    assert told["audit"]["verdict"] == "fault" and {"checks.csv", "frequencies.csv"} <= set(told["written"])
    assert main([*bare, "--dofs", "interface.csv", "--mass", "47.1", "--floating", "yes", "--units", "SI"]) == 0
    printed = capsys.readouterr().out
    assert "mass and inertia" in printed and printed.splitlines()[1].startswith("No fault found. ")
    full_files = ["--full", "full/M.mtx", "full/K.mtx", "--full-dofs", "full/dofs.csv", "--full-interface"]
    nodes = ",".join(f"{node}:*" for node in dict.fromkeys(reduced().interface_dofs.nodes.tolist()))  # type: ignore[union-attr]
    assert main([*bare, *full_files, nodes]) == 1 and "modes below the cut-off" in capsys.readouterr().out


@pytest.mark.parametrize(("arguments", "words"), [
    (["M.npy"], "M.npy is no folder of write_matrices"), (["M.npy", "K.npy", "D.npy", "V.npy"], "4 files are given"),
    (["M.npy", "K.npy", "--interface", "a"], "interface"), (["none", "--full", "full"], "none is no folder"),
    (["M.npy", "missing.npy"], "there is no file missing.npy"), (["small", "--units", "inch"], "units"),
    (["M.npy", "interface.csv"], "interface.csv"), (["K.npy", "M.npy"], "by its name holds a stiffness matrix")])
def test_wrong_arguments_are_told(arguments: list[str], words: str, folder: Path, monkeypatch: pytest.MonkeyPatch,
                                  capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(folder)
    assert main(["audit", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_a_scene_file_does_the_same(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "scene.toml").write_text('[[ask]]\naudit = {model = "small/model.json"}\nfull = {model = "full/model.json"}\n')
    assert main(["run", str(folder / "scene.toml")]) == 0 and "Yes. " in capsys.readouterr().out
    (folder / "wrong.toml").write_text('[[ask]]\naudit = {model = "small/model.json", M = "M.npy", K = "K.npy"}\n')
    assert main(["run", str(folder / "wrong.toml")]) == 2
    assert "ask 1.audit: give the model.json of a folder, model, or the files of the matrices" in capsys.readouterr().err


def test_the_scene_has_an_example_of_which_a_mode_is_missing(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "audit"]) == 0
    assert "the full model has 10 modes below the stated" in " ".join(capsys.readouterr().out.split())


def test_a_model_of_rigid_motion_alone_is_compared() -> None:
    """It has no elastic frequency that gives the energy of rigid motion a scale: the full model's does."""
    whole = fs.chain(12, damping=0.0, fixed=False, interface=[1])
    rom = fs.reduce(whole, fs.Guyan())
    model: Given = {"M": rom.M, "K": rom.K, "V": rom.V, "full_interface": rom.full_interface}
    assert rom.size == 1 and not fs.audit(model, whole).faults
    wrong = np.linspace(0.0, 1.0, 12)[:, None] + 1.0
    found = fs.audit(model | {"V": wrong, "M": wrong.T @ (whole.M @ wrong), "K": wrong.T @ (whole.K @ wrong)}, whole)
    assert "static interface response" in [one.what for one in found.faults]


@pytest.mark.sampled(10)
@pytest.mark.parametrize("key", ["M", "K", "MK"])
@pytest.mark.parametrize("by", [0.0, -1.0])
@pytest.mark.parametrize("method", sorted(METHODS))
def test_matrices_that_are_lost_or_negative_are_faults(method: str, by: float, key: str) -> None:
    rom = fs.reduce(full(), METHODS[method]() if method == "guyan" else METHODS[method](4))
    for left_out in ((), ("V",), ("kinds", "full_interface")):
        model = given(rom, *left_out)
        model |= {one: by * model[one] for one in key}
        for whole in (full(), None):
            assert fs.audit(model, whole, mass=1.0, units="SI", floating=True).faults or (by == 0.0 and key == "K" and not whole)
