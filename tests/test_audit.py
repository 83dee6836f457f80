"""`audit`: each planted fault is found, and nothing is said of sound models; what cannot be known is told as such."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import femsub as fs
from femsub.reduction import METHODS

pytestmark = pytest.mark.filterwarnings("ignore::femsub.errors.PortWarning")  # belts on the inside are meant
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
        lambda m: changed(changed(kept(m, [*range(20), 13]), "M", put((13, 20, 0), (20, 13, 0))), "K", put((13, 20, 0), (20, 13, 0))),
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
    "a stiff entry changed": (lambda m: changed(m, "K", put((4, 7, 1.1), (7, 4, 1.1))), "rigid motion strains nothing", True, True),
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
    "single precision": (lambda m: {**m, **{key: m[key].astype(np.float32).astype(float) for key in "MKD"}}, "digits", True, True),
    "an empty coordinate": (lambda m: changed(changed(m, "M", lambda A: A * np.outer(np.arange(20) != 17, np.arange(20) != 17)), "K",
                                              lambda A: A * np.outer(np.arange(20) != 17, np.arange(20) != 17)),
                            "coordinates independent", True, True),
    "matrices of two sizes": (lambda m: m | {"D": m["D"][:-1, :-1]}, "sizes fit", True, True),
}


def names(found: fs.Audit) -> list[str]:
    return [one.what for one in found.faults]


def alone(told: Given) -> fs.Audit:
    """Without the full model, but with what its user knows of the part: it floats, its mass, and its units."""
    return fs.audit({key: value for key, value in told.items() if key not in ("V", "full_interface")}, mass=47.1, floating=True,
                    units="SI")


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
        assert found.verdict == "good" and not found.faults, found.text
    assert fs.audit(reduced(), full()).evidence == "certified"
