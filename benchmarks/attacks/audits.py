"""`audit` of femsub's own reductions, which have no fault, and of the same reductions with one planted fault."""

from __future__ import annotations

from typing import Any

import numpy as np

import femsub as fs
from benchmarks.attacks import frequency_bounds, rigid
from benchmarks.attacks.common import Random, attack
from femsub.checks import Array
from femsub.reduction import METHODS

KINDS = ("sound", "planted with V", "planted without V")
LEAST = 1e-5  # smallest relative change of an entry by a planted fault


@attack("audits", KINDS, seed_first=True)
def attacked(kind: str, rng: Random) -> str:
    """One random case: 'certified' if a sound model has no reported fault, or the fault is found; 'missed: …' with its kind."""
    full = component(rng)
    name = str(rng.choice(list(METHODS)))
    method = METHODS[name]() if name == "guyan" else METHODS[name](int(rng.integers(0 if name == "hurty" else 1, 9)))
    try:
        rom = fs.reduce(full, method, ports=bool(full.ports) and rng.random() < 0.3)
    except fs.FemsubError as error:
        return f"not reduced: {str(error)[:60]}"
    if kind == "sound":
        given: Any = rom if rng.random() < 0.5 else as_matrices(rom, *(key for key in ("V", "kinds", "dofs", "cutoff")
                                                                       if rng.random() < 0.3))
        faults = [f"{one.what}: {one.said}" for whole in (full, None) for one in fs.audit(given, whole).faults]
        return f"wrong: {name} of {full.name}: {'; '.join(faults)}" if faults else "certified"
    given = as_matrices(rom, *(() if kind == "planted with V" else ("V",)))
    what = ""
    for _ in range(50):
        changed = {key: value.copy() if key in "MKD" else value for key, value in given.items()}
        what = plant(changed, rng)
        if is_fault(given, changed, rom, full):
            break
    else:
        return "nothing to plant"
    given = changed
    found = fs.audit(given, full)
    return "certified" if found.faults else f"missed {what} of {name} ({full.name})"


def component(rng: Random) -> fs.Substructure:
    """A chain, beam, plate or solid that floats, or a chain, beam or net of springs that is held."""
    if rng.random() < 0.5:
        return frequency_bounds.part(rng)
    E, length, rho = 10.0 ** rng.uniform([5, -2, 2], [12, 2, 4])
    return rigid.part(rng, str(rng.choice(["chain", "beam", "plate", "solid"])), (E, length, rho)).sub.with_damping(None)


def as_matrices(rom: fs.ReducedSubstructure, *left_out: str) -> dict[str, Any]:
    """The model as bare matrices, as another program would give it."""
    told = {"M": rom.M.copy(), "K": rom.K.copy(), "D": rom.D.copy(), "V": rom.V.copy(), "kinds": list(rom.kinds),
            "full_interface": rom.full_interface.copy(), "dofs": rom.interface_dofs, "cutoff": rom.cutoff}
    if len(rom.interface):
        told["interface"] = rom.interface.copy()
    return {key: value for key, value in told.items() if key not in left_out}


def is_fault(given: dict[str, Any], changed: dict[str, Any], rom: fs.ReducedSubstructure,
             full: fs.Substructure) -> bool:
    """Whether a change exceeds rounding and, without V, is more than a different order, sign or scale of coordinates."""
    for key in "MK":
        A, B = given[key], changed[key]
        size = np.sqrt(np.abs(np.outer(A.diagonal(), A.diagonal())))
        V = np.abs(rom.V)
        rounding = 1e4 * np.finfo(float).eps * (V.T @ (abs(getattr(full, key)) @ V))
        if (np.abs(A - B) > LEAST * size + rounding).any():
            break
    else:
        return False
    if "V" in given:
        return True
    r = len(given["M"])
    moved = [j for j in range(r) if any((given[key][j] != changed[key][j]).any() for key in "MK")]
    pairs = [(i, j) for i in moved for j in moved if i < j]
    turns = []
    for i, j in pairs:
        at = np.arange(r)
        at[[i, j]] = j, i
        turns.append(np.eye(r)[at])
    for j in range(r):
        turn = np.eye(r)
        scale = np.sqrt(max(changed["M"][j, j], 0.0) / given["M"][j, j]) if given["M"][j, j] > 0 else 1.0
        for turn[j, j] in (-1.0, scale, -scale):
            turns.append(turn.copy())
    return not any(all(np.allclose(turn @ given[key] @ turn.T, changed[key], rtol=1e-9, atol=1e-12 * np.abs(given[key]).max())
                       for key in "MK") for turn in turns)


def plant(given: dict[str, Any], rng: Random) -> str:
    """Puts one fault into the matrices, and names it."""
    r = len(given["M"])
    fault = str(rng.choice(["entry", "sign", "mass", "stiffness", "order", "units", "scale"]))
    key = str(rng.choice(["M", "K"]))
    A: Array = given[key]
    by = 1 + float(rng.choice([-1, 1])) * 10.0 ** rng.uniform(np.log10(LEAST) + 1, -0.1)
    size = np.sqrt(np.abs(np.outer(A.diagonal(), A.diagonal())))
    j = int(rng.integers(r))
    kind = given["kinds"][j]
    off = np.argwhere(np.triu(np.abs(A) > 1e-3 * size, 1))
    if fault in ("entry", "sign") and not len(off):
        fault = "mass"
    if fault in ("entry", "sign"):
        i, j = off[rng.integers(len(off))]
        by = -1.0 if fault == "sign" else by
        A[i, j] *= by
        A[j, i] *= by
        return f"{fault} of {key} between {given['kinds'][i]} and {given['kinds'][j]}"
    if fault in ("mass", "stiffness"):
        A = given["M" if fault == "mass" else "K"]
        if not A[j, j]:
            j = int(np.argmax(np.abs(A.diagonal())))
        A[j, j] *= by
        return f"{fault} of {given['kinds'][j]}"
    if fault == "order":
        i = int(rng.integers(r))
        if np.allclose(A[i], A[j]) or i == j:
            i, j = int(np.argmin(A.diagonal())), int(np.argmax(A.diagonal()))
        A[[i, j]] = A[[j, i]]
        A[:, [i, j]] = A[:, [j, i]]
        return f"order of {given['kinds'][i]} and {given['kinds'][j]} in {key}"
    if fault == "units":
        by = float(rng.choice([1e-3, 1e3, 9.80665, 1e6, 25.4]))
        given[key] = by * A
        return f"units of {key}"
    A[j] *= by
    A[:, j] *= by
    return f"scale of {kind} in {key}"
