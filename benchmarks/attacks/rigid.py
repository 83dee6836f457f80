"""Floating, damped parts by eight methods: as many eigenvalues at 0 and rigid modes as the geometry says, and none that grows.

In the kind "soft", springs down to 1e-12 of the stiffness join the pieces. The next frequency is known from modes of the pieces.
In the kind "fine", a beam, plate or solid has so many elements that the first elastic ω² is near the rounding of K, or below it.
The next frequency is known from a beam of few elements, with 30 digits.

The reference is exact rigid motion from the coordinates of the nodes, in units of the part's length, and the rank of the
conditions by joints, springs and dashpots on it. All damping dissipates energy, so no mode may be called unstable.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from mpmath import mp

import femsub as fs
from benchmarks.attacks.common import Random, attack, dense, heard, null_space
from femsub.checks import EPS

KINDS = ("part", "system", "guided", "soft", "fine")
METHODS = (fs.CraigBampton, fs.Hurty, fs.CraigChang, fs.Rubin, fs.MacNeal, fs.Herting, fs.DualCraigBampton,
           fs.Guyan)
# relative error of the next frequency, beyond which its own rounding must say so; a reduced K does not know that of the full one
CLOSE = {"own": 1e-6, "joined": 1e-6, "reduced": 1e-6, "whole": 1e-4}
FEW = 10.0  # roundings of K's entries in its making
LOUD = 1e-8  # backward error of an eigenpair that is none
RANK = 1e-7  # singular values of conditions in units of length below which they are 0


@dataclass(frozen=True)
class Part:
    """A floating part, its exact rigid motion Z (n, r) in a common unit of length, and which motions D takes energy from, B Z."""

    sub: fs.Substructure
    Z: np.ndarray
    braked: np.ndarray
    groups: tuple[tuple[int, ...], ...]  # DOF of a node at one end and at the other, in the same order
    unit: np.ndarray  # what a motion of 1 in Z is in each DOF


@attack("rigid", KINDS)
def attacked(kind: str, random: Random) -> str:
    """The evidence of a reduced model that has the rigid motion of its geometry; 'refused', 'undecided', or what is wrong."""
    if kind == "soft":
        return _soft(random)
    if kind == "fine":
        return _fine(random)
    shape = str(random.choice(["beam", "beam", "chain", "plate", "solid"]))
    units = 10.0 ** random.uniform(-3, 9), 10.0 ** random.uniform(-3, 3), 10.0 ** random.uniform(-9, 3)  # E, length, ρ
    count = 1 if kind == "part" else int(random.integers(1 if kind == "guided" else 2, 4))
    parts = [part(random, shape, units) for _ in range(count)]
    method = METHODS[int(random.integers(len(METHODS)))]
    try:
        counts = [int(random.integers(0, max(1, min(6, part.sub.size // 3)) + 1)) for part in parts]
        roms = [fs.reduce(part.sub, method(count)) for part, count in zip(parts, counts, strict=True)]
    except fs.FemsubError as error:
        return f"refused: {error}"
    if kind == "part":
        return _judged(f"{shape}, {method.__name__}", [parts[0].sub, roms[0]], parts, [])
    joints, equations = _joints(random, parts, kind)
    mixed = [part.sub if random.random() < 0.2 and i else rom for i, (part, rom) in enumerate(zip(parts, roms, strict=True))]
    try:
        models = [fs.couple({f"p{i}": one for i, one in enumerate(chosen)}, joints)
                  for chosen in ([part.sub for part in parts], mixed)]
        if len(parts) > 2 and random.random() < 0.3:
            models.append(fs.couple({"whole": models[1]}, []))
    except fs.FemsubError as error:
        return f"refused: {error}"
    return _judged(f"{shape}, {method.__name__}", models, parts, equations)


def _judged(what: str, models: Sequence[fs.Substructure], parts: list[Part], equations: list[np.ndarray]) -> str:
    Z = la.block_diag(*(part.Z for part in parts))
    free = _free(np.array(equations).reshape(-1, len(Z)) @ Z, np.eye(Z.shape[1]))
    rigid = free.shape[1]
    braked = la.block_diag(*(part.braked for part in parts))  # the dampers of joints see no more than their springs do
    zeros = 2 * rigid - (rigid - _free(braked, free).shape[1])
    words = []
    for name, model in zip(("full", "reduced", "nested"), models, strict=False):
        try:
            modes, undamped = fs.complex_modes(model), fs.normal_modes(model, count=0)
        except fs.FemsubError as error:
            if name == "full":
                return f"refused in full: {what}: {error}"
            words.append(f"refused: {what}: {error}")
            continue
        certified = modes.evidence == "certified"
        if modes.is_stable is False or (undamped.rigid != rigid and undamped.evidence == "certified") or (
                certified and (modes.rigid.sum() != zeros or modes.backward_error.max(initial=0.0) > LOUD)):
            return (f"wrong{' in full' * (name == 'full')}: {what}, {name} ({rigid} rigid, {zeros} at 0): normal_modes has "
                    f"{undamped.rigid} rigid, {modes.rigid.sum()} at 0, {modes!r}")
        if name != "full":
            words.append(modes.evidence)
    return next((word for word in words if word.startswith("refused")), words[-1])


def _free(B: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """The motions x of a basis with B x = 0, with rows of equal size."""
    size = np.linalg.norm(B, axis=1)
    return null_space(B[size > 0] / size[size > 0, None], basis, RANK)


def part(random: Random, shape: str, units: tuple[float, float, float]) -> Part:
    """A free part with rounding in all of its numbers, stiffer or softer than others by up to four orders of magnitude."""
    E, L, rho = units[0] * 10.0 ** random.uniform(-2, 2), units[1] * random.uniform(0.5, 2.0), units[2] * random.uniform(0.5, 2)
    groups: tuple[tuple[int, ...], ...]
    dofs: Any
    if shape == "chain":
        n = int(random.integers(3, 15))
        sub = fs.chain(n, fixed=False, damping=0.0)
        sub = fs.Substructure(sub.M * rho * L**3, sub.K * E * L)
        Z, unit, groups = np.ones((n, 1)), np.full(n, L), ((0,), (n - 1,))
    elif shape == "beam":
        n = int(random.integers(2, 12))
        sub = fs.beam(L, n, E=E, I=(0.03 * L) ** 4 * random.uniform(0.5, 2.0), rho=rho, A=(0.1 * L) ** 2)
        dofs = sub.dofs
        x, angle = dofs.points[:, 0] / L, dofs.components == 1
        Z, unit = np.stack([~angle, np.where(angle, 1.0, x - 0.5)], axis=1).astype(float), np.where(angle, 1.0, L)
        groups = ((0, 1), (2 * n, 2 * n + 1))
    elif shape == "plate":
        mesh = fs.rectangle((L, 0.6 * L), (int(random.integers(1, 4)), 2), "quad")
        sub = fs.plate(mesh, E=E, nu=0.3, rho=rho, thickness=0.02 * L)
        dofs = sub.dofs
        (x, y), kind = dofs.points.T / L, dofs.components
        Z = np.stack([kind == 0, np.select([kind == 0, kind == 1], [x - 0.5, 1.0]),
                      np.select([kind == 0, kind == 2], [y - 0.3, 1.0])], axis=1).astype(float)
        unit = np.select([kind == 0, kind == 3], [L, 1 / L], 1.0)
        groups = tuple(tuple(int(i) for i in np.flatnonzero(np.abs(x - at) < 1e-9)) for at in (0.0, 1.0))
    else:
        mesh = fs.block((L, 0.4 * L, 0.3 * L), (int(random.integers(1, 4)), 1, 1), "hexahedron")
        sub = fs.solid(mesh, fs.Material(E, 0.3, rho))
        dofs = sub.dofs
        p, kind = dofs.points / L - [0.5, 0.2, 0.15], dofs.components
        turn = np.stack([np.cross(axis, p)[np.arange(len(p)), kind] for axis in np.eye(3)], axis=1)
        Z, unit = np.hstack([np.eye(3)[kind], turn]), np.full(len(p), L)
        groups = tuple(tuple(int(i) for i in np.flatnonzero(np.abs(p[:, 0] - at) < 1e-9)) for at in (-0.5, 0.5))
    Z = Z * np.where(unit == L, L / units[1], 1.0)[:, None]  # of all parts in one unit of length
    common = np.where(unit == L, units[1], 1.0)
    damping, braked = _damping(random, sub, Z, unit)
    chosen = list(groups[0]) if random.random() < 0.15 else list(dict.fromkeys([*groups[0], *groups[1]]))
    if random.random() < 0.3:
        chosen += [int(i) for i in random.choice(sub.size, 2, replace=False) if i not in chosen]
    own = fs.Substructure(sub.M, sub.K, damping, chosen, name=shape)
    return Part(own, Z, braked, groups, common)


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


@dataclass(frozen=True)
class Row:
    """Pieces in a row and masses, each with exact rigid motion, and springs: one DOF of the whole, another, stiffness."""

    pieces: list[tuple[np.ndarray, np.ndarray, np.ndarray]]  # M, K, Z
    springs: list[tuple[int, int, float]]
    ends: list[list[int]]  # DOF of each piece that are its interface

    @property
    def start(self) -> np.ndarray:
        return np.cumsum([0, *(len(piece[0]) for piece in self.pieces)])

    @property
    def interface(self) -> list[int]:
        return sorted({int(start + dof) for start, end in zip(self.start, self.ends, strict=False) for dof in end})

    @property
    def modes(self) -> int:
        """How many modes a method keeps of the row as one part."""
        return int(min(6, (self.start[-1] - len(self.interface)) // 2))

    def matrices(self) -> tuple[np.ndarray, np.ndarray]:
        M, K = (la.block_diag(*(piece[at] for piece in self.pieces)) for at in (0, 1))
        for a, b, k in self.springs:
            K[[a, b], [a, b]] += k
            K[[a, b], [b, a]] -= k
        return M, K

    def parts(self, random: Random) -> tuple[dict[str, fs.Substructure], list[fs.Spring]]:
        """As parts of a system, sparse or dense, and the springs between them."""
        start, parts = self.start, {}
        at = [int(np.searchsorted(start, dof, "right")) - 1 for spring in self.springs for dof in spring[:2]]
        ends = [list(end) for end in self.ends]
        joints = []
        for (a, b, k), i, j in zip(self.springs, at[::2], at[1::2], strict=True):
            one, other = int(a - start[i]), int(b - start[j])
            ends[i] += [one] * (one not in ends[i])
            ends[j] += [other] * (other not in ends[j])
            joints.append(fs.Spring((f"p{i}", [one]), (f"p{j}", [other]), stiffness=k))
        for i, (M, K, _) in enumerate(self.pieces):
            wanted = sp.csr_array if len(M) > 1 and random.random() < 0.5 else np.array
            parts[f"p{i}"] = fs.Substructure(wanted(M), wanted(K), interface=ends[i])
        return parts, joints

    def exact(self) -> tuple[int, float, float]:
        """The number of rigid motions, the next ω, and the energy of its mode beside that of the forces that cancel in it.

        In the modes of the pieces K is diag(ω²) + WᵀkW. Without its null space it is definite, and its inverse keeps the
        digits of soft springs.
        """
        Z, V, omega2 = [], [], []
        for M, K, motion in self.pieces:
            motion = motion / np.sqrt(np.einsum("ij,ij->j", motion, M @ motion))
            own = np.linalg.solve(np.linalg.cholesky(motion.T @ M @ motion), motion.T).T
            held = M @ own
            shift = 0.3771 * float(np.median(K.diagonal() / M.diagonal()))
            shapes = la.eigh(K + shift * held @ held.T, M)[1] if len(M) > own.shape[1] else own
            rest = np.argsort(np.linalg.norm(held.T @ shapes, axis=0), kind="stable")[:len(M) - own.shape[1]]
            shapes = shapes[:, np.sort(rest)]
            shapes = shapes - own @ (held.T @ shapes)
            Z.append(own)
            V.append(shapes)
            omega2.append(np.einsum("ij,ij->j", shapes, K @ shapes) / np.einsum("ij,ij->j", shapes, M @ shapes))
        rigid, elastic = la.block_diag(*Z), la.block_diag(*V)
        W = np.zeros((len(self.springs), len(rigid)))
        for row, (a, b, _) in zip(W, self.springs, strict=True):
            row[a], row[b] = 1.0, -1.0
        size = np.linalg.norm(abs(W) @ abs(rigid), axis=1, keepdims=True)
        values, turn = np.linalg.svd(W @ rigid / np.where(size > 0, size, 1.0))[1:]
        rank = int(np.count_nonzero(values > RANK))
        shapes = np.hstack([rigid @ turn[:rank].T, elastic])
        B = W @ shapes
        springs = np.array([spring[2] for spring in self.springs])
        H = np.diag(np.concatenate([np.zeros(rank), *omega2])) + B.T @ (springs[:, None] * B)
        unit = H.diagonal() ** -0.5
        theta, q = la.eigh(unit[:, None] * np.linalg.inv(unit[:, None] * H * unit) * unit)
        M, K = self.matrices()
        x = shapes @ q[:, -1]
        return rigid.shape[1] - rank, float(theta[-1] ** -0.5), float((x @ M @ x) / theta[-1] / (abs(x) @ abs(K) @ abs(x)))


def _row(random: Random) -> Row:
    """One to three pieces of a kind, by springs of every DOF at their ends, and masses on springs of single DOF."""
    units = 10.0 ** random.uniform(-3, 9), 10.0 ** random.uniform(-3, 3), 10.0 ** random.uniform(-9, 3)
    shape, soft = str(random.choice(["chain", "beam", "plate", "solid"])), 10.0 ** random.uniform(-12, 0)
    parts = [part(random, shape, units) for _ in range(int(random.integers(1, 4)))]
    pieces = [(dense(part.sub.M), dense(part.sub.K), part.unit[:, None] * part.Z) for part in parts]
    ends = [list(dict.fromkeys([*part.groups[0], *part.groups[1]])) for part in parts]
    start, springs = np.cumsum([0, *(len(piece[0]) for piece in pieces)]), []
    for i in range(1, len(parts)):
        for a, b in zip(parts[i - 1].groups[1], parts[i].groups[0], strict=False):
            size = min(pieces[i - 1][1][a, a], pieces[i][1][b, b])
            springs.append((int(start[i - 1] + a), int(start[i] + b), float(soft * size * 10.0 ** random.uniform(-0.3, 0.3))))
    if len(parts) == 1 or random.random() < 0.4:
        i = int(random.integers(len(parts)))
        M, K, _ = pieces[i]
        for dof in random.choice(len(M), int(random.integers(1, 3)), replace=False):
            at = sum(len(piece[0]) for piece in pieces)
            pieces.append((np.array([[M[dof, dof] * 10.0 ** random.uniform(-1, 2)]]), np.zeros((1, 1)), np.ones((1, 1))))
            ends.append([0])
            springs.append((int(start[i] + dof), at, float(soft * K[dof, dof] * 10.0 ** random.uniform(-0.3, 0.3))))
    return Row(pieces, springs, ends)


def _soft(random: Random) -> str:
    """The rigid motions and the next frequency: of K itself, or of full or reduced parts joined by springs; without damping."""
    row = _row(random)
    rigid, omega, energy = row.exact()
    form = str(random.choice(["own", "own", "joined", "joined", "reduced", "reduced", "whole"]))
    method, twice = METHODS[int(random.integers(len(METHODS)))], bool(random.random() < 0.4)
    what = f"{form}{', ' + method.__name__ if form in ('reduced', 'whole') else ''}{', complex' * twice}"
    alone = form in ("own", "whole")  # K's rounding is all that is known
    make, reduced = (_as_one, form == "whole") if alone else (_as_system, form == "reduced")
    try:
        found, lowest, bar, evidence, told = _lowest_of(lambda: make(random, row, method, reduced), twice)
    except fs.FemsubError as refusal:
        # a piece that springs keep from some of its own rigid motions: K Z = 0 of the whole does not hold for these
        held = max(motion.shape[1] for *_, motion in row.pieces) > rigid
        return f"{'beyond K' if (alone or held) and energy < FEW * EPS else 'refused'}: {what}: {refusal}"
    evidence = "told" if told else evidence
    if found != (2 * rigid if twice else rigid):
        known = "told" if evidence == "told" else "beyond K" if alone and energy < FEW * EPS else "wrong"
        return f"{known}: {what}: {found} at 0; next energy {energy:.0e}"
    if np.isinf(lowest):  # without elastic modes MacNeal's part has no mass but that of its rigid motion
        bare = form == "whole" and method is fs.MacNeal and row.modes == 0
        return evidence if bare else f"wrong: {what}: no elastic mode"
    error = lowest / omega - 1  # a reduced model may be stiffer
    if error < -CLOSE[form] or (form in ("own", "joined") and error > CLOSE[form]):
        within = evidence == "told" or abs(error) < FEW * bar
        return "told" if within else f"wrong: {what}: ω is {lowest}, not {omega}, bar {bar:.0e}"
    return evidence


def _as_one(random: Random, row: Row, method: Any, reduced: bool) -> fs.Substructure:
    M, K = row.matrices()
    wanted = sp.csr_array if random.random() < 0.5 else np.array
    model = fs.Substructure(wanted(M), wanted(K), interface=row.interface)
    return fs.reduce(model, method(row.modes)) if reduced else model


def _as_system(random: Random, row: Row, method: Any, reduced: bool) -> fs.Substructure:
    parts, joints = row.parts(random)
    for name, part in parts.items():
        if reduced and part.size > 1:
            parts[name] = fs.reduce(part, method(int(min(6, (part.size - len(part.interface)) // 2))))
    return fs.couple(parts, joints)


def _lowest_of(build: Callable[[], fs.Substructure], twice: bool) -> tuple[int, float, float, str, bool]:
    """How many ω, or λ if `twice`, are at 0; the lowest other ω, inf if there is none; its relative error bar; the evidence; and
    whether a warning names lost digits.
    """
    def ask() -> tuple[int, float, float, str]:
        modes: Any = fs.complex_modes(build()) if twice else fs.normal_modes(build(), count=1)
        zeros = int(np.sum(modes.rigid))
        if zeros == (len(modes.rigid) if twice else len(modes.frequencies)):
            return zeros, np.inf, 0.0, modes.evidence
        if not twice:
            return zeros, float(modes.frequencies[-1]), float(modes.rounding[-1]), modes.evidence
        low = int(np.where(modes.rigid, np.inf, np.abs(modes.eigenvalues)).argmin())
        lowest = float(np.abs(modes.eigenvalues[low]))
        return zeros, lowest, float(modes.error_bar[low]) / lowest, modes.evidence

    found, refusal, said = heard(ask)
    if refusal:
        raise refusal
    return *found, any(isinstance(one, fs.ConditionWarning) for one in said)


def _fine(random: Random) -> str:
    """Beams of own matrices (Euler and Timoshenko), plates and solids in bending: held, guided, on springs, or free."""
    shape = str(random.choice(["euler", "euler", "timoshenko", "strip", "bar"]))
    units = 10.0 ** random.uniform(-3, 9), 10.0 ** random.uniform(-3, 3), 10.0 ** random.uniform(-9, 3)  # EI, length, ρA
    ends = [str(random.choice(["free", "free", "pinned", "guided", "clamped", "spring", "turning spring"])) for _ in range(2)]
    springs = [10.0 ** random.uniform(-9, 2) for _ in range(2)]
    n = int(10.0 ** random.uniform(1, 3.7))
    if shape in ("strip", "bar"):
        n, ends = min(n, 600), [str(random.choice(["free", "clamped"])), "free"]
    shear = 10.0 ** random.uniform(-6, -2) if shape == "timoshenko" else 0.0  # EI/(GA L²)
    rows = [row for end, at in zip(ends, (0.0, 1.0), strict=True) for row in
            {"free": [], "pinned": [(1, at)], "spring": [(1, at)], "clamped": [(1, at), (0, 1)]}.get(end, [(0, 1)])]
    rigid = 2 - int(np.linalg.matrix_rank(np.array([(0, 0), *rows])))
    omega = _lowest(16, shear, ends, springs, rigid)
    if shape in ("strip", "bar"):
        model, more, scale = _of_elements(random, shape, n, ends[0] == "clamped")
        rigid, omega = rigid + more * (rigid > 0), omega * scale
    else:
        omega *= np.sqrt(units[0] / units[2]) / units[1]**2
        wanted = sp.csr_array if n > 40 or random.random() < 0.5 else (lambda A: A.toarray())
        M, K = _beam(n, shear, ends, springs, units)
        model = fs.Substructure(wanted(M), wanted(K), interface=[0, M.shape[0] - 1])
    size = float(np.median(model.K.diagonal()[::3] / model.M.diagonal()[::3]))
    what = f"{shape}, {n} elements, {ends}, springs {springs[0]:.0e} {springs[1]:.0e}, energy {omega**2 / size:.0e}"
    twice = bool(random.random() < 0.3) and model.size < 500
    reduced = bool(random.random() < 0.3)
    try:
        found, lowest, bar, evidence, told = _lowest_of(lambda: fs.reduce(
            model, METHODS[int(random.integers(len(METHODS) - 1))](4)) if reduced else model, twice)
    except fs.FemsubError as refusal:
        return f"{'beyond K' if omega**2 < 100 * EPS * size else 'refused'}: {what}: {refusal}"
    right = found == (2 * rigid if twice else rigid)
    close = abs(lowest / omega - 1) < {"euler": 1e-3, "timoshenko": 0.02}.get(shape, 0.05) + FEW * bar
    if not (right and close) and not told and evidence == "certified":
        word = "beyond K" if omega**2 < 2 * EPS * size and not right else "wrong"  # less than one rounding
        return (f"{word}: {what}, reduced {reduced}, complex {twice}: {found} at 0, not {rigid}; ω is {lowest:.6g}, "
                f"not {omega:.6g}, bar {bar:.0e}")
    return f"told{'' if right else ', other number'}" if told else evidence if right and close else f"not checked, off: {what}"


def _of_elements(random: Random, shape: str, n: int, held: bool) -> tuple[fs.Substructure, int, float]:
    """A free or clamped strip of plate elements or bar of solid ones; more rigid motions if free; √(EI/ρA)/L² of its bending."""
    slender = 10.0 ** random.uniform(-3, -1)  # thickness beside the length
    if shape == "strip":
        mesh = fs.rectangle((1.0, 0.05), (n, 1), "quad")
        return fs.plate(mesh, E=1.0, nu=0.0, rho=1.0, thickness=slender, supports={"left": "clamped"} if held else {},
                        interface=["right"]), 1, slender / np.sqrt(12)
    mesh = fs.block((1.0, slender, 0.7 * slender), (n, 1, 1), "hexahedron20")
    part = fs.solid(mesh, fs.Material(1.0, 0.0, 1.0), supports=["left"] if held else [], interface=["right"])
    return part, 4, 0.7 * slender / np.sqrt(12)


def _beam(n: int, shear: float, ends: list[str], springs: list[float], units: tuple[float, float, float]) -> tuple[Any, Any]:
    """M and K, sparse, of n equal elements with w and w,x at each node; `shear` is EI/(GA L²), springs are in EI/L³ and EI/L."""
    EI, L, rho = units
    h = L / n
    phi = 12 * shear * n**2
    k = EI / h**3 / (1 + phi) * np.array([[12, 6 * h, -12, 6 * h], [6 * h, (4 + phi) * h**2, -6 * h, (2 - phi) * h**2],
                                          [-12, -6 * h, 12, -6 * h], [6 * h, (2 - phi) * h**2, -6 * h, (4 + phi) * h**2]])
    m = rho * h / 420 * np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
                                  [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]])
    at = 2 * np.arange(n)[:, None] + np.arange(4)
    i, j = np.repeat(at, 4, axis=1).ravel(), np.tile(at, (1, 4)).ravel()
    M, K = (sp.csr_array(sp.coo_array((np.tile(A.ravel(), n), (i, j)), shape=(2 * n + 2,) * 2)) for A in (m, k))
    held, added = [], np.zeros(2 * n + 2)
    for end, spring, first in zip(ends, springs, (0, 2 * n), strict=True):
        held += {"pinned": [first], "guided": [first + 1], "clamped": [first, first + 1]}.get(end, [])
        added[first] = spring * EI / L**3 * (end == "spring")
        added[first + 1] = spring * EI / L * (end == "turning spring")
    K = sp.csr_array(K + sp.diags_array(added))
    rest = np.setdiff1d(np.arange(2 * n + 2), held)
    return M[rest][:, rest], K[rest][:, rest]


def _lowest(n: int, shear: float, ends: list[str], springs: list[float], rigid: int) -> float:
    """ω of the first elastic mode of n elements in units of √(EI/ρA)/L², with 30 digits."""
    M, K = _beam(n, shear, ends, springs, (1.0, 1.0, 1.0))
    with mp.workdps(30):
        entry = [[mp.mpf(float(value)) for value in row] for row in K.toarray()]
        K0, M0 = mp.matrix(entry), mp.matrix(M.toarray().tolist())
        root = mp.cholesky(M0) ** -1
        return float(mp.sqrt(sorted(mp.eigsy(root * K0 * root.T, eigvals_only=True))[rigid]))
