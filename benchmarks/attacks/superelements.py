"""Superelements written for each program and read back: the same frequencies and rigid motion, within the format's digits.

Solids, beams, plates, chains and systems, held, floating and pinned, with a DOF map or without, with modes scaled as other
programs do. The reference are the model's own frequencies. What a format cannot hold is to be refused when it is written.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

import femsub as fs
from benchmarks.attacks.common import Random, attack, component
from femsub.checks import EPS, Array

KINDS = ("nastran", "dmig", "abaqus", "calculix", "exudyn")
LAST = {"dmig": 5e-10}  # half of the last digit of a format, relative
NO_INTERFACE, DAMPED, NO_MAP, SPREAD = "has no interface", "has damping", "needs a reduced model", "are no coordinates"


@attack(KINDS)
def attacked(kind: str, random: Random) -> str:
    """'same', or 'refused in words' where the format cannot hold it; else what is wrong."""
    with tempfile.TemporaryDirectory() as folder:
        full, model = _model(random, scaled=kind != "exudyn")  # by hand, rigid motion is not known, which Exudyn's file needs
        try:
            own = fs.normal_modes(model, count=6)
        except fs.FemsubError:
            return "no reference"
        try:
            files = fs.write_superelement(folder, model, kind, full=full if kind == "exudyn" else None, recover="all")
        except fs.FemsubError as error:
            open_ = len(model.interface) or not isinstance(model, fs.ReducedSubstructure)
            meant = any((
                SPREAD in str(error) and "Hurty" in repr(model), NO_INTERFACE in str(error) and not open_,
                kind in ("calculix", "exudyn") and DAMPED in str(error),
                kind == "exudyn" and (NO_MAP in str(error) or "Exudyn's bodies" in str(error))))
            return f"{'refused in words' if meant else 'refused'}: {error}"
        try:
            return _compared(model, own, _read(kind, files, model), kind)
        except fs.FemsubError as error:
            return f"wrong: what was written is refused: {type(error).__name__}: {error}"


def _compared(model: fs.Substructure, own: fs.NormalModes, found: fs.Substructure | Array, kind: str) -> str:
    omega, slack = own.frequencies[own.rigid:], 1e-9 + 8 * (1 + LAST.get(kind, 0.0) / EPS) * own.rounding[own.rigid:]
    if isinstance(found, np.ndarray):
        other, rigid = found[:len(omega)], own.rigid
    else:
        read = fs.normal_modes(found, count=6)
        other, rigid = read.frequencies[read.rigid:], read.rigid
    if slack.max(initial=0.0) > 0.1:
        return "too few digits"
    if rigid != own.rigid or len(other) != len(omega):
        return (f"wrong: {rigid} rigid and {len(other)} elastic, not {own.rigid} and {len(omega)}: {model!r}, "
                f"{found!r}")
    error = np.abs(other / omega - 1)
    if (error > slack).any():
        at = int((error / slack).argmax())
        return f"wrong: mode {at + 1} off by {error[at]:.1e}, allowed {slack[at]:.1e}: {model!r}"
    if isinstance(model, fs.ReducedSubstructure) and isinstance(found, fs.ReducedSubstructure) and (
            len(found.interface) != len(model.interface) or found.modes != model.size - len(model.interface)):
        return f"wrong: {len(found.interface)} interface DOF and {found.modes} modes: {model!r}, {found!r}"
    return "same"


def _read(kind: str, files: list[Path], model: fs.Substructure) -> fs.Substructure | Array:
    by_name = {path.name: path for path in files}
    if kind in ("nastran", "dmig"):
        path = next(path for path in files if path.suffix == {"nastran": ".asm", "dmig": ".pch"}[kind])
        return fs.read_component(path, cutoff=model.cutoff if np.isfinite(model.cutoff) else 1e30)
    if kind == "exudyn":
        data = np.load(next(path for path in files if path.suffix == ".npz"), allow_pickle=True)
        values = np.sort(np.diag(data["stiffnessMatrixReduced"]) / np.diag(data["massMatrixReduced"]))
        return np.asarray(np.sqrt(np.maximum(values, 0.0)))
    return fs.read_component(by_name["M.mtx"], by_name["K.mtx"])


def _model(random: Random, scaled: bool) -> tuple[fs.Substructure, fs.Substructure]:
    """A full model, and what is written."""
    full = component(random, mapped=True)
    if random.random() < 0.3:
        full = fs.damped(full, rayleigh=(10.0 ** random.uniform(-2, 1), 10.0 ** random.uniform(-9, -5)))
    if random.random() < 0.1 or not len(full.interior):
        return full, full
    method = (fs.CraigBampton, fs.Hurty)[int(random.random() < 0.05)]
    most = max(1, min(8, len(full.interior) - 1))
    rom: fs.Substructure
    try:
        rom = fs.reduce(full, method(int(random.integers(0 if len(full.interface) else 1, most + 1))),
                        ports=bool(random.random() < 0.3))
    except fs.InputError:  # an interface that does not hold it
        rom = fs.reduce(full, fs.CraigBampton(0)) if len(full.interface) else full
    by_hand = scaled and isinstance(rom, fs.ReducedSubstructure) and random.random() < 0.6
    return full, _scaled(random, rom) if by_hand and isinstance(rom, fs.ReducedSubstructure) else rom


def _scaled(random: Random, rom: fs.ReducedSubstructure) -> fs.ReducedSubstructure:
    modal = np.setdiff1d(np.arange(rom.size), rom.interface)
    s = np.ones(rom.size)
    s[modal] = 1 / np.abs(rom.V[:, modal]).max(axis=0) if random.random() < 0.5 else 10.0 ** random.uniform(-4, 4, len(modal))
    D = None if not np.any(rom.D) else rom.D * np.outer(s, s)
    return replace(rom, M=rom.M * np.outer(s, s), K=rom.K * np.outer(s, s), D=D, V=rom.V * s, ports={}, rigid_motion=None,
                   noise=np.zeros((rom.size, 0)), estimate=None, estimated=None)
