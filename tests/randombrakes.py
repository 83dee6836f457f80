"""Random small brakes: a ring, a sector or a plate, and one to three pads that rub on it; small enough for dense solutions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg as la

import femsub as fs
from femsub.model.bands import upper, within
from femsub.modes import match

TOL = 1e-3
Random = np.random.Generator
KINDS = ("ring", "sector", "plate")


@dataclass(frozen=True, eq=False)
class Brake:
    """A system, its contacts, and the band that is asked. `values` are all λ of the full model, `noise` what rounding may do."""

    seed: int
    kind: str
    system: fs.System
    contacts: tuple[fs.FrictionContact, ...]
    band: tuple[float, float]
    values: np.ndarray
    noise: np.ndarray
    traits: tuple[str, ...]

    @property
    def mu(self) -> float:
        return self.contacts[0].mu

    @property
    def inside(self) -> np.ndarray:
        """Rows of the λ in the band."""
        return np.flatnonzero(within(self.values, self.band) & upper(self.values))

    @property
    def votes(self) -> list[bool | None]:
        """Of the λ in the band: True if it decays, False if it grows, None if rounding decides."""
        return [None if abs(self.values[k].real) <= self.noise[k] else bool(self.values[k].real < 0) for k in self.inside]

    @property
    def is_stable(self) -> bool | None:
        return verdict(self.votes)


def verdict(votes: Sequence[bool | None]) -> bool | None:
    """Of a model, from those of its modes."""
    return False if False in votes else None if None in votes or not votes else True


def errors(brake: Brake, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """|Δλ|/|λ| of the full model's λ in the band, inf without a counterpart in another model; and the counterparts, or -1."""
    exact, rows = brake.values[brake.inside], np.flatnonzero(upper(values))
    at, to = match(exact, values[rows], far=2.0)
    found, partner = np.full(len(exact), np.inf), np.full(len(exact), -1)
    found[at] = np.abs(values[rows[to]] - exact[at]) / np.abs(exact[at])
    partner[at] = rows[to]
    return found, partner


def judged(brake: Brake) -> dict[str, Any]:
    """A model of contact modes with a tolerance against the full one: verdicts, errors and their estimates, and its size."""
    rom = fs.reduce(brake.system, fs.ContactModes(band=brake.band, tol=TOL, contacts=brake.contacts))
    modes, estimate = fs.complex_modes(rom, brake.contacts), rom.estimate
    assert estimate is not None
    error, partner = errors(brake, modes.eigenvalues)
    votes = [modes.stable[k] if k >= 0 else True for k in partner]  # without a counterpart it is missed
    found = [int(np.abs(estimate.eigenvalues - value).argmin()) for value in modes.eigenvalues[partner]]
    exact, noise = brake.values[brake.inside], brake.noise[brake.inside]
    off = np.abs(exact - estimate.located[found]) > estimate.radius[found] + noise
    own = fs.complex_modes(rom, brake.contacts, band=brake.band)
    pairs = list(zip(brake.votes, votes, strict=True))
    return {"wanted": len(exact), "unstable": brake.votes.count(False), "missed": pairs.count((False, True)),
            "undecided": pairs.count((False, None)), "invented": pairs.count((True, False)), "outside": int(off.sum()),
            "full": brake.is_stable, "rom": own.is_stable if len(own) else None, "modes": rom.modes, "basis": rom.size,
            "true": float(error.max(initial=0.0)), "estimate": estimate.worst, "searched": estimate.searched,
            "pairs": [[float(a), float(estimate.eigenvalue_error[k])] for a, k in zip(error, found, strict=True)],
            "radii": (estimate.radius / np.abs(estimate.located)).tolist()}


def random_brake(seed: int) -> Brake:
    """The brake of a seed."""
    random = np.random.default_rng([18, seed])
    kind = str(random.choice(KINDS, p=[0.5, 0.2, 0.3]))
    traits: list[str] = []
    disc, spans, sides = _disc(random, kind)
    iron = fs.Material(10 ** random.uniform(10.5, 11.4), random.uniform(0.2, 0.33), random.uniform(2500.0, 8000.0))
    damping = _damping(random, traits)
    number = int(random.integers(1, 4))
    pads = {f"pad{i}": _pad(random, kind, disc, spans, side) for i, side in enumerate(sides[:number])}
    speed, pressure, slope = None, 0.0, 0.0
    if random.random() < 0.5:
        traits.append("damping by friction")
        speed = 10 ** random.uniform(0.3, 2.0) if kind != "plate" else 10 ** random.uniform(-1.0, 1.0)
        pressure = 10 ** random.uniform(4.5, 6.3)
        if random.random() < 0.3:
            traits.append("slope")
            slope = -10 ** random.uniform(-4.0, -2.0)
    under = sorted({side for _, side in pads.values()})
    part = fs.solid(disc, iron, supports=_held(random, kind), interface=under, rayleigh=damping, name="disc")
    if kind == "ring" and random.random() < 0.3:
        traits.append("gyroscopic")
        part = fs.rotating(part, disc, iron).at(10 ** random.uniform(1.0, 3.0))
    parts, meshes = {"disc": part}, {"disc": disc}
    joints: list[fs.Spring] = []
    contacts = []
    mu = float(0.7 * np.sqrt(random.uniform(0.02, 1.0)))
    for name, (mesh, side) in pads.items():
        lining = fs.Material(iron.E * 10 ** random.uniform(-2.0, 0.3), random.uniform(0.15, 0.35), random.uniform(1500.0, 8000.0))
        face, back = ("bottom", "top") if side == "top" else ("top", "bottom")
        own = _damping(random, []) if damping is not None else None
        mounted = random.random() < 0.6
        ends = [back, *(("start", "end") if kind != "plate" else ("left", "right"))]
        ports = {f"{end}-{axis}": (end, axis) for end in ends for axis in "xyz"} if mounted else {}
        parts[name] = fs.solid(mesh, lining, supports=[] if mounted else [back], interface=[face], ports=ports, rayleigh=own,
                               name=name)
        meshes[name] = mesh
        height = float(np.ptp(mesh.points[:, 2]))
        area = float(np.ptp(mesh.points[:, 0]) * np.ptp(mesh.points[:, 1]))
        stiffness = lining.E / height * 10 ** random.uniform(-1.3, 0.7)
        spring = lining.E * area / height * 10 ** random.uniform(-2.0, 0.0)
        joints += [fs.Spring((name, port), stiffness=spring) for port in ports]
        along = np.array([1.0, 0.0, 0.0]) if kind == "plate" else None
        about = np.array([0.0, 0.0, 1.0]) if kind != "plate" else None
        contacts.append(fs.FrictionContact(f"{name}.{face}", f"disc.{side}", {"disc": disc, name: mesh}, stiffness, mu,
                                           pressure, along, about, speed=speed, slope=slope))
    system = fs.couple(parts, [*contacts, *joints], f"brake {seed}")
    pencil = system.linearised(contacts).dense()
    values, noise = eigenvalues(pencil)
    held = system.linearised([replace(one, mu=0.0) for one in contacts]).dense().K
    still = np.sqrt(la.eigvalsh((held + held.T) / 2, pencil.M))
    last = int(random.integers(4, 13))
    hi = float(still[last - 1] + random.uniform(0.2, 0.8) * (still[last] - still[last - 1]))
    return Brake(seed, kind, system, tuple(contacts), (0.0, hi), values, noise, tuple(traits))


def fewest(brake: Brake, size: int) -> int:
    """The size of the smallest model of contact modes whose true errors meet the tolerance, or `size` if none is smaller.

    With the responses to K₁Φ, and to K₁ᵀΦ and D₁Φ or not. By dense algebra alone.
    """
    system, pencil = brake.system, brake.system.linearised(brake.contacts).dense()
    K0, K1 = (system.linearised([replace(one, mu=mu) for one in brake.contacts]).dense().K for mu in (0.0, 1.0))
    still, D1 = (K0 + K0.T) / 2, pencil.D - system.pencil.dense().D
    shapes, root = la.eigh(still, pencil.M)[1][:, :size], la.cholesky(still)
    right, left, damping = (la.solve(still, load @ shapes, assume_a="pos") for load in (K1 - K0, (K1 - K0).T, D1))
    families = [(shapes, right), (shapes, right, left)]
    if D1.any():
        families += [(shapes, right, damping), (shapes, right, left, damping)]
    for family in families:
        for modes in range(1, size // 2):
            basis = root @ np.hstack([part[:, :modes] for part in family])
            turned, share, _ = la.svd(basis / np.linalg.norm(basis, axis=0), full_matrices=False)
            V = la.solve_triangular(root, turned[:, share > 1e-7])
            if V.shape[1] >= size:
                break
            small = fs.Pencil(*(V.T @ part @ V for part in (pencil.M, pencil.D, pencil.K)))
            if errors(brake, eigenvalues(small)[0])[0].max(initial=0.0) <= TOL:
                size = V.shape[1]
                break
    return size


def eigenvalues(pencil: fs.Pencil) -> tuple[np.ndarray, np.ndarray]:
    """All 2n eigenvalues by LAPACK, of the state matrix in coordinates in which M and the symmetric part of K are diagonal.

    And what rounding may do to each: with the condition, and of a nearly defective pair with the root.
    """
    square, shapes = la.eigh((pencil.K + pencil.K.T) / 2, pencil.M)
    omega = np.sqrt(np.abs(square)) + 1e-6 * np.sqrt(np.abs(square).max())
    n = len(omega)
    state = np.zeros((2 * n, 2 * n))
    state[:n, n:] = np.diag(omega)
    state[n:, :n] = -(shapes.T @ pencil.K @ shapes) / omega
    state[n:, n:] = -(shapes.T @ pencil.D @ shapes)
    values, left, right = la.eig(state, left=True, right=True)
    condition = 1 / np.maximum(np.abs(np.einsum("ij,ij->j", left.conj(), right)), 1e-300)
    rounding = 1e-15 * float(np.linalg.norm(state, 2))
    return values, np.maximum(1e-10 * np.abs(values), np.minimum(condition * rounding, np.sqrt(rounding * np.abs(values))))


def _disc(random: Random, kind: str) -> tuple[fs.Mesh, tuple[int, int], list[str]]:
    """The mesh, the number of cells along and across, and the sides on which pads lie."""
    sides = ["top", "bottom", "top"]
    if kind == "plate":
        length, width, height = 0.2 * random.uniform(0.6, 1.5), 0.06 * random.uniform(0.7, 1.5), 10 ** random.uniform(-2.3, -1.6)
        counts = int(random.integers(4, 9)), int(random.integers(1, 4)), 1
        return fs.block((length, width, height), counts, "hexahedron", "disc"), counts[:2], sides
    inner, outer = random.uniform(0.03, 0.06), random.uniform(0.09, 0.16)
    counts = int(random.integers(1, 4)), int(random.integers(8, 15)), 1
    sector = None if kind == "ring" else (0.0, random.uniform(1.2, 3.0))
    if sector is not None:
        counts = counts[0], int(random.integers(4, 9)), 1
    return fs.annulus(inner, outer, 10 ** random.uniform(-2.4, -1.6), counts, "hexahedron", "disc", sector), counts[:2], sides


def _held(random: Random, kind: str) -> list[str]:
    if kind == "plate":
        return [["left", "right"], ["left"]][int(random.random() < 0.3)]
    return ["inner"] if kind == "ring" or random.random() < 0.5 else ["start", "end"]


def _pad(random: Random, kind: str, disc: fs.Mesh, cells: tuple[int, int], side: str) -> tuple[fs.Mesh, str]:
    """A pad on a side of the disc: over whole faces of it, or anywhere."""
    height, top = 10 ** random.uniform(-2.2, -1.5), float(disc.points[:, 2].max())
    matching = random.random() < 0.4
    layers = int(random.integers(1, 3))
    if kind == "plate":
        length, width = disc.points[:, 0].max(), disc.points[:, 1].max()
        if matching:
            along = int(random.integers(1, max(2, cells[0] // 2) + 1))
            begin = int(random.integers(0, cells[0] - along + 1))
            size, corner = (along * length / cells[0], width), (begin * length / cells[0], 0.0)
            counts = along, cells[1], layers
        else:
            size = random.uniform(0.2, 0.5) * length, random.uniform(0.5, 0.95) * width
            corner = random.uniform(0.0, length - size[0]), random.uniform(0.0, width - size[1])
            counts = int(random.integers(1, 4)), int(random.integers(1, 4)), layers
        mesh = fs.block((*size, height), counts, "hexahedron")
        shift = np.array([*corner, 0.0])
    else:
        radius = np.hypot(disc.points[:, 0], disc.points[:, 1])
        angle = np.arctan2(disc.points[:, 1], disc.points[:, 0]) % (2 * np.pi)
        inner, outer = radius.min(), radius.max()
        whole = 2 * np.pi if kind == "ring" else float(angle.max())
        if matching:
            along = int(random.integers(1, max(2, cells[1] // 4) + 1))
            begin = int(random.integers(0, cells[1] - along + 1))
            sector = (begin * whole / cells[1], (begin + along) * whole / cells[1])
            first = int(random.integers(0, cells[0]))
            radii = inner + first * (outer - inner) / cells[0], outer
            counts = cells[0] - first, along, layers
        else:
            # the disc's faces are plane, its edges straight: a pad that stays inside them has contact everywhere
            span = random.uniform(0.5, 1.2)
            at = random.uniform(0.05, max(0.1, whole - span - 0.05))
            sector = at, min(at + span, whole - 0.02)
            inside = outer * np.cos(whole / cells[1] / 2)
            radii = inner + random.uniform(0.1, 0.5) * (inside - inner), inside * random.uniform(0.9, 0.99)
            counts = int(random.integers(1, 3)), int(random.integers(2, 5)), layers
        mesh = fs.annulus(*radii, height, counts, "hexahedron", sector=sector)
        shift = np.zeros(3)
    shift[2] = top if side == "top" else -height
    return fs.Mesh(mesh.points + shift, mesh.cells, mesh.kind, mesh.sets), side


def _damping(random: Random, traits: list[str]) -> tuple[float, float] | None:
    """None, or α and β of a damping ratio up to some per cent."""
    if random.random() < 0.2:
        traits.append("undamped")
        return None
    return float(10 ** random.uniform(-1.0, 2.0)), float(10 ** random.uniform(-8.5, -5.8))
