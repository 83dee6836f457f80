"""Floating, damped parts by eight methods: as many eigenvalues at 0 and rigid modes as the geometry says, and none that grows.

The reference is exact rigid motion from the coordinates of the nodes, in units of the part's length, and the rank of what joints,
springs and dashpots make of it. All damping takes energy away, so that no mode may be called unstable.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

import femsub as fs

KINDS = ("part", "system", "guided")
METHODS = (fs.CraigBampton, fs.Hurty, fs.CraigChang, fs.Rubin, fs.MacNeal, fs.Herting, fs.DualCraigBampton,
           fs.Guyan)
LOUD = 1e-8  # backward error of an eigenpair that is none
RANK = 1e-7  # singular values of conditions in units of length below which they are 0

Random = np.random.Generator


@dataclass(frozen=True)
class Part:
    """A floating part, its exact rigid motion Z (n, r) in a common unit of length, and which motions D takes energy from, B Z."""

    sub: fs.Substructure
    Z: np.ndarray
    braked: np.ndarray
    groups: tuple[tuple[int, ...], ...]  # DOF of a node at one end and at the other, in the same order


def attacked(kind: str, seed: int) -> str:
    """The evidence of a reduced model that has the rigid motion of its geometry; 'refused', 'undecided', or what is wrong."""
    random = np.random.default_rng([KINDS.index(kind), seed])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        shape = str(random.choice(["beam", "beam", "chain", "plate", "solid"]))
        units = 10.0 ** random.uniform(-3, 9), 10.0 ** random.uniform(-3, 3), 10.0 ** random.uniform(-9, 3)  # E, length, ρ
        count = 1 if kind == "part" else int(random.integers(1 if kind == "guided" else 2, 4))
        parts = [_part(random, shape, units) for _ in range(count)]
        method = METHODS[int(random.integers(len(METHODS)))]
        try:
            counts = [int(random.integers(0, max(1, min(6, part.sub.size // 3)) + 1)) for part in parts]
            roms = [fs.reduce(part.sub, method(count)) for part, count in zip(parts, counts, strict=True)]
        except fs.FemsubError as error:
            return f"refused: seed {seed}: {error}"
        if kind == "part":
            return _judged(f"seed {seed}, {shape}, {method.__name__}", [parts[0].sub, roms[0]], parts, [])
        joints, equations = _joints(random, parts, kind)
        mixed = [part.sub if random.random() < 0.2 and i else rom for i, (part, rom) in enumerate(zip(parts, roms, strict=True))]
        try:
            models = [fs.couple({f"p{i}": one for i, one in enumerate(chosen)}, joints)
                      for chosen in ([part.sub for part in parts], mixed)]
            if len(parts) > 2 and random.random() < 0.3:
                models.append(_nested(models[1]))
        except fs.FemsubError as error:
            return f"refused: seed {seed}: {error}"
        return _judged(f"seed {seed}, {shape}, {method.__name__}", models, parts, equations)


def _nested(system: fs.System) -> fs.System:
    """The system as the one part of another."""
    return fs.couple({"whole": system}, [])


def _judged(what: str, models: Sequence[fs.Substructure], parts: list[Part], equations: list[np.ndarray]) -> str:
    Z = la.block_diag(*(part.Z for part in parts))
    free = _null(np.array(equations).reshape(-1, len(Z)) @ Z, np.eye(Z.shape[1]))
    rigid = free.shape[1]
    braked = la.block_diag(*(part.braked for part in parts))  # the dampers of joints see no more than their springs do
    zeros = 2 * rigid - (rigid - _null(braked, free).shape[1])
    words = []
    for name, model in zip(("full", "reduced", "nested"), models, strict=False):
        try:
            modes = fs.complex_modes(model)
            undamped = fs.normal_modes(model, count=0)
        except fs.FemsubError as error:
            if name == "full":
                return f"refused in full: {what}: {error}"
            words.append(f"refused: {what}: {error}")
            continue
        told = f"{what}, {name} ({rigid} rigid, {zeros} at 0)"
        if undamped.rigid != rigid and undamped.evidence == "certified":
            return f"wrong{' in full' * (name == 'full')}: {told}: normal_modes has {undamped.rigid} rigid"
        if modes.rigid.sum() != zeros and modes.evidence == "certified":
            return f"wrong{' in full' * (name == 'full')}: {told}: {modes.rigid.sum()} at 0, {modes!r}"
        if modes.backward_error.max(initial=0.0) > LOUD and modes.evidence == "certified":
            return f"wrong{' in full' * (name == 'full')}: {told}: {modes!r}"
        if modes.is_stable is False:
            return f"wrong{' in full' * (name == 'full')}: {told}: {modes!r}"
        if name != "full":
            words.append(modes.evidence)
    return next((word for word in words if word.startswith("refused")), words[-1])


def _null(B: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """The motions of a basis that B annuls."""
    size = np.linalg.norm(B, axis=1, keepdims=True)
    B = (B / np.where(size > 0, size, 1.0))[size[:, 0] > 0] @ basis
    if not len(B):
        return basis
    values, V = np.linalg.svd(B)[1:]
    return basis @ V[int(np.count_nonzero(values > RANK)):].T


def _part(random: Random, shape: str, units: tuple[float, float, float]) -> Part:
    """A free part with rounding in all of its numbers, stiffer or softer than others by up to four orders of magnitude."""
    E, L, rho = units[0] * 10.0 ** random.uniform(-2, 2), units[1] * random.uniform(0.5, 2.0), units[2] * random.uniform(0.5, 2)
    groups: tuple[tuple[int, ...], ...]
    if shape == "chain":
        n = int(random.integers(3, 15))
        sub = fs.chain(n, fixed=False, damping=0.0)
        sub = fs.Substructure(sub.M * rho * L**3, sub.K * E * L)
        Z, unit, groups = np.ones((n, 1)), np.full(n, L), ((0,), (n - 1,))
    elif shape == "beam":
        n = int(random.integers(2, 12))
        sub = fs.beam(L, n, E=E, I=(0.03 * L) ** 4 * random.uniform(0.5, 2.0), rho=rho, A=(0.1 * L) ** 2)
        x, angle = _points(sub)[:, 0] / L, _directions(sub) == 1
        Z, unit = np.stack([~angle, np.where(angle, 1.0, x - 0.5)], axis=1).astype(float), np.where(angle, 1.0, L)
        groups = ((0, 1), (2 * n, 2 * n + 1))
    elif shape == "plate":
        mesh = fs.rectangle((L, 0.6 * L), (int(random.integers(1, 4)), 2), "quad")
        sub = fs.plate(mesh, E=E, nu=0.3, rho=rho, thickness=0.02 * L)
        (x, y), kind = _points(sub).T / L, _directions(sub)
        Z = np.stack([kind == 0, np.select([kind == 0, kind == 1], [x - 0.5, 1.0]),
                      np.select([kind == 0, kind == 2], [y - 0.3, 1.0])], axis=1).astype(float)
        unit = np.select([kind == 0, kind == 3], [L, 1 / L], 1.0)
        groups = tuple(tuple(int(i) for i in np.flatnonzero(np.abs(x - at) < 1e-9)) for at in (0.0, 1.0))
    else:
        mesh = fs.block((L, 0.4 * L, 0.3 * L), (int(random.integers(1, 4)), 1, 1), "hexahedron")
        sub = fs.solid(mesh, fs.Material(E, 0.3, rho))
        p, kind = _points(sub) / L - [0.5, 0.2, 0.15], _directions(sub)
        turn = np.stack([np.cross(axis, p)[np.arange(len(p)), kind] for axis in np.eye(3)], axis=1)
        Z, unit = np.hstack([np.eye(3)[kind], turn]), np.full(len(p), L)
        groups = tuple(tuple(int(i) for i in np.flatnonzero(np.abs(p[:, 0] - at) < 1e-9)) for at in (-0.5, 0.5))
    Z = Z * np.where(unit == L, L / units[1], 1.0)[:, None]  # of all parts in one unit of length
    damping, braked = _damping(random, sub, Z, unit)
    dofs = list(dict.fromkeys([*groups[0], *groups[1]]))
    chosen = list(groups[0]) if random.random() < 0.15 else dofs
    if random.random() < 0.3:
        chosen += [int(i) for i in random.choice(sub.size, 2, replace=False) if i not in chosen]
    own = fs.Substructure(sub.M, sub.K, damping, chosen, name=shape)
    return Part(own, Z, braked, groups)


def _points(sub: fs.Substructure) -> np.ndarray:
    assert sub.dofs is not None and sub.dofs.points is not None
    return sub.dofs.points


def _directions(sub: fs.Substructure) -> np.ndarray:
    assert sub.dofs is not None
    return sub.dofs.components


def _damping(random: Random, sub: fs.Substructure, Z: np.ndarray, unit: np.ndarray) -> tuple[object, np.ndarray]:
    """βK, with dashpots between DOF, from a DOF to the ground, or that a column of K stretches; and what they see of Z."""
    K, none = sub.K.toarray(), np.zeros((0, Z.shape[1]))
    omega = np.sqrt(np.median(K.diagonal() / sub.M.toarray().diagonal()))
    kind = str(random.choice(["K", "K", "K", "column", "between", "ground", "none"]))
    D = 10.0 ** random.uniform(-6, 0) / omega * K if kind == "K" or random.random() < 0.4 else np.zeros_like(K)
    strength = 10.0 ** random.uniform(-3, 1)
    i, j = random.choice(sub.size, 2, replace=False)
    if kind == "none":
        return None, none
    if kind == "column":
        row = K[i] / K[i, i]
        return D + strength / omega * K[i, i] * np.outer(row, row), none
    if kind == "between" and unit[i] == unit[j]:
        row = np.eye(sub.size)[i] - np.eye(sub.size)[j]
        return D + strength / omega * min(K[i, i], K[j, j]) * np.outer(row, row), (row @ Z)[None]
    if kind == "ground":
        row = np.eye(sub.size)[i]
        return D + strength / omega * K[i, i] * np.outer(row, row), (row @ Z)[None]
    return D + 1e-2 / omega * K, none


def _joints(random: Random, parts: list[Part], kind: str) -> tuple[list[fs.Rigid | fs.Spring], list[np.ndarray]]:
    """Ends joined in a row, rigidly or by springs, all DOF or some; of a guided system one end is partly held, too."""
    joints: list[fs.Rigid | fs.Spring] = []
    equations = []
    start = np.cumsum([0, *(part.sub.size for part in parts)])
    rows = np.eye(start[-1])

    def row(part: int, dof: int) -> np.ndarray:
        return rows[start[part] + dof]

    for i in range(1, len(parts)):
        one = [dof for dof in parts[i - 1].groups[1] if dof in parts[i - 1].sub.interface] or list(parts[i - 1].groups[0])
        other = list(parts[i].groups[0])
        count = min(len(one), len(other))
        some = random.permutation(count)[:int(random.integers(1, count + 1))] if random.random() < 0.4 else np.arange(count)
        a, b = [int(one[k]) for k in some], [int(other[k]) for k in some]
        ends = (f"p{i - 1}", a), (f"p{i}", b)
        size = float(min(np.abs(parts[i].sub.K.diagonal()[b]).min(), np.abs(parts[i - 1].sub.K.diagonal()[a]).min()))
        if random.random() < 0.6:
            joints.append(fs.Rigid(*ends, tol=np.inf))
        else:
            damped = random.random() < 0.3
            omega = np.sqrt(np.median(parts[i].sub.K.diagonal() / parts[i].sub.M.diagonal()))
            joints.append(fs.Spring(*ends, stiffness=size * 10.0 ** random.uniform(-4, 2), damping=damped * 0.01 * size / omega))
        equations += [row(i - 1, p) - row(i, q) for p, q in zip(a, b, strict=True)]
    if kind == "guided":
        at = int(random.integers(len(parts)))
        dofs = parts[at].sub.interface
        held = [int(dof) for dof in random.permutation(dofs)[:int(random.integers(1, 1 + min(3, len(dofs))))]]
        size = float(np.abs(parts[at].sub.K.diagonal()[held]).min())
        joints.append(fs.Rigid((f"p{at}", held), "ground") if random.random() < 0.6 else
                      fs.Spring((f"p{at}", held), stiffness=size * 10.0 ** random.uniform(-3, 1)))
        equations += [row(at, dof) for dof in held]
    return joints, equations
