"""Random systems of 2 to 5 parts, small enough for full solutions: chains, networks, beams and plates in a tree of joints."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.spatial import cKDTree

import femsub as fs
from femsub.components.beam import beam
from femsub.components.plate import plate

Random = np.random.Generator


@dataclass(frozen=True, eq=False)
class Case:
    """A full system, a belt where it is damped, the band that is asked, and its lowest frequencies without rigid-body ones.

    `rounding` is the relative change of each ω² if each entry of K and M is rounded once.
    """

    seed: int
    system: fs.System
    band: tuple[float, float]
    belt: fs.Belt | None
    omega: np.ndarray
    rounding: np.ndarray
    kinds: tuple[str, ...]
    damped: bool = field(default=False)


def random_system(seed: int, plates: bool = True) -> Case:
    """The system of a seed."""
    random = np.random.default_rng(seed)
    number = int(random.integers(2, 6))
    kinds = [str(random.choice(["chain", "network", "beam", "plate"] if plates else ["chain", "network"], p=[0.3, 0.4, 0.2, 0.1]
             if plates else None)) for _ in range(number)]
    damped = bool(random.random() < 0.5)
    parts = {f"p{i}": _tuned(random, _part(random, kind), f"p{i}", damped) for i, kind in enumerate(kinds)}
    free = {name: list(map(int, part.interface)) for name, part in parts.items()}
    joints: list[fs.Rigid | fs.Spring] = []
    for i in range(1, number):
        other = f"p{random.integers(0, i)}"
        while not free[other]:
            other = f"p{random.integers(0, i)}"
        most = min(len(free[other]), len(free[f"p{i}"]))
        count = int(random.integers(1, most + 1))
        ends = [(name, [free[name].pop(int(random.integers(0, len(free[name])))) for _ in range(count)])
                for name in (other, f"p{i}")]
        if random.random() < 0.8:
            joints.append(fs.Rigid(*ends))
        else:
            k = float(np.median(parts[other].K.diagonal())) * 10 ** random.uniform(-1.5, 1.0)
            joints.append(fs.Spring(ends[0], ends[1], stiffness=k, damping=2e-3 * k if damped else 0.0))
        if not free[f"p{i}"] and not any(free[f"p{j}"] for j in range(i)):
            break
    ends_of = [joint.ends if isinstance(joint, fs.Rigid) else (joint.first, joint.second) for joint in joints]
    joined = {name for ends in ends_of for name, _ in ends}
    parts = {name: part for name, part in parts.items() if name in joined}
    held = [name for name in parts if free[name]]
    if random.random() < 0.7 and held:
        end = (held[0], [free[held[0]].pop()])
        joints.append(fs.Rigid(end, "ground") if random.random() < 0.5 else fs.Spring(
            end, stiffness=float(np.median(parts[held[0]].K.diagonal()))))
    system = fs.couple(parts, joints)
    last = int(random.integers(2, 10))
    modes = fs.normal_modes(system, count=last + 1)
    omega = modes.frequencies[modes.rigid:]
    hi = float(omega[last - 1] + random.uniform(0.1, 0.9) * (omega[last] - omega[last - 1]))
    belt = None
    if damped and random.random() < 0.7:
        name = str(random.choice(list(system.ports)))
        w = system.ports[name]
        belt = fs.Belt(port=name, slope=-0.02 * hi * float(w @ (system.M @ w)))
    return Case(seed, system, (0.0, hi), belt, omega, modes.rounding[modes.rigid:], tuple(kinds[:len(parts)]), damped)


def _part(random: Random, kind: str) -> fs.Substructure:
    if kind == "chain":
        n = int(random.integers(15, 45))
        ends = [1, n] if random.random() < 0.7 else sorted(random.choice(n, 3, replace=False) + 1)
        return fs.chain(n, masses=random.lognormal(0.0, 0.5, n), springs=random.lognormal(0.0, 0.7, n), interface=ends,
                        fixed=False, damping=0.0)
    if kind == "beam":
        n = int(random.integers(8, 20))
        return beam(1.0, n, E=1.0, I=1.0, rho=1.0, A=1.0, interface=["left", "right"])
    if kind == "plate":
        grid = (int(random.integers(3, 6)), int(random.integers(3, 5)))
        mesh = fs.rectangle((1.0, float(random.uniform(0.6, 1.0))), grid)
        return plate(mesh, E=1.0, nu=0.3, rho=1.0, thickness=0.05, interface=["left"])
    n = int(random.integers(20, 60))
    points = random.random((n, 2))
    pairs = {tuple(sorted((i, int(j)))) for i, row in enumerate(cKDTree(points).query(points, 5)[1]) for j in row[1:]}
    pairs |= {(i, i + 1) for i in range(n - 1)}
    a, b = np.array(sorted(pairs)).T
    k = random.lognormal(0.0, 1.0, len(a))
    B = sp.csr_array((np.tile([1.0, -1.0], len(a)), (np.repeat(np.arange(len(a)), 2), np.stack([a, b], axis=1).ravel())),
                     shape=(len(a), n))
    interface = sorted(random.choice(n, int(random.integers(2, 7)), replace=False).tolist())
    return fs.Substructure(sp.diags_array(random.lognormal(0.0, 0.5, n), format="csr"), sp.csr_array(B.T @ sp.diags_array(k) @ B),
                           interface=interface)


def _tuned(random: Random, sub: fs.Substructure, name: str, damped: bool) -> fs.Substructure:
    """With a first held frequency between 0.5 and 3 rad/time, a mass of its own, and a port on some DOF."""
    mass = sub.M.diagonal()
    inside = sub.interior
    moving = inside[mass[inside] > 0.3 * mass.max()]  # deflections of a beam or plate, no slopes
    K, M = (A.toarray() if sp.issparse(A) else A for A in (sub.K, sub.M))
    square = la.eigvalsh(K[np.ix_(inside, inside)], M[np.ix_(inside, inside)])
    scale = 10 ** random.uniform(-0.7, 0.7) / float(np.trace(M))
    stiffness = scale * 10 ** (2 * random.uniform(-0.3, 0.5)) / square[0]
    D = None
    if damped:
        place = random.choice(moving, 2, replace=False)
        spots = sp.csr_array((random.uniform(0.0, 0.01, 2) * scale * mass[place].max(), (place, place)), shape=K.shape)
        alpha, beta = random.uniform(0, 0.02), random.uniform(0, 0.002)
        D = sp.csr_array(sub.M * scale) * alpha + sp.csr_array(sub.K * stiffness) * beta + spots
    w = np.zeros(sub.size)
    w[random.choice(sub.interface[:1] if random.random() < 0.5 else moving)] = 1.0
    return fs.Substructure(sub.M * scale, sub.K * stiffness, D, sub.interface, {"belt": w}, name)


def compositions(total: int, least: np.ndarray, most: np.ndarray) -> itertools.chain[np.ndarray]:
    """All numbers of modes of the parts, between `least` and `most`, whose sum is `total`."""

    def rest(at: int, left: int) -> list[tuple[int, ...]]:
        if at == len(least) - 1:
            return [(int(least[at]) + left,)] if least[at] + left <= most[at] else []
        return [(int(least[at]) + k, *tail) for k in range(min(left, int(most[at] - least[at])) + 1)
                for tail in rest(at + 1, left - k)]

    spare = total - int(least.sum())
    return itertools.chain(map(np.array, rest(0, spare)) if spare >= 0 else [])
