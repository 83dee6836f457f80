"""Systems assembled by multipliers, against the primal matrices in 60 digits: λ one to one within the bars, and pairs whole.

Parts are of 1 to 4 DOF whose stiffness and mass differ by up to ten powers of ten. The joints are solved exactly. Both
assemblies are looked at.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from mpmath import mp

import femsub as fs
from benchmarks.attacks.common import Random, attack, dense, exact_eigenvalues, misfit, row_of_springs
from femsub.checks import Array
from femsub.coupling.joints import Joint, Link

KINDS = ("two parts", "several parts", "massless", "damped", "belts")
DIGITS = 60


@dataclass(frozen=True)
class Weighted(Joint):
    """Σ w u = 0 over DOF (part, place in its interface, w)."""

    terms: tuple[tuple[str, int, float], ...]
    name: str

    def link(self, parts: Mapping[str, fs.Substructure]) -> Link:
        found: dict[str, Array] = {}
        for part, place, weight in self.terms:
            row = found.setdefault(part, np.zeros((1, len(parts[part].interface_numbers))))
            row[0, place] += weight
        return Link(equations={part: sp.csr_array(row) for part, row in found.items()})

    def __repr__(self) -> str:
        return self.name


def part(kind: str, rng: Random, name: str, small: bool) -> fs.Substructure:
    n = int(rng.integers(1, 3 if small else 5))
    size = 10.0 ** rng.uniform(-4, 10) if rng.random() < 0.6 else 1.0
    way = rng.integers(0, 4)
    if way == 0:  # one stiff motion
        h = rng.choice([1.0, -0.5, 0.25, 2.0], n)
        K = size * np.outer(h, h)
    elif way == 1:  # springs, held or floating
        inner = [rng.uniform(0.5, 2.0) for _ in range(n - 1)]
        K = size * row_of_springs(np.array([rng.choice([0.0, 1.0]), *inner, 0.0]))
    elif way == 2:
        K = size * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    else:
        B = rng.integers(-3, 4, (n, n)).astype(float)
        K = size * (B @ B.T + np.diag(10.0 ** rng.uniform(-2, 2, n).round(1)))
    mass = 10.0 ** rng.choice([0.0, 2.0, rng.uniform(-3, 3)]) * rng.choice([1.0, 2.0, 0.5], n)
    if kind in ("massless", "damped") and rng.random() < 0.6:
        mass[rng.choice(n, max(1, n // 2), replace=False)] = 0.0
        mass[0] = mass[0] or (1.0 if not mass.any() else 0.0)
        K = K + np.diag((mass == 0) * size * rng.uniform(0.5, 2.0, n))  # or a motion without mass might have no stiffness
    M = np.diag(mass)
    if rng.random() < 0.3 and n > 1 and mass.all():
        M = M + 0.25 * np.sqrt(np.outer(mass, mass)) * (1 - np.eye(n))
    damping = rng.choice(["none", "stiffness", "mass", "dashpots"])
    D = {"none": 0 * K, "stiffness": 10.0 ** rng.uniform(-4, 0) * K, "mass": 0.1 * M,
         "dashpots": np.diag(rng.choice([0.0, 1.0], n) * 10.0 ** rng.uniform(-3, 5 if kind == "damped" else 1))}[str(damping)]
    if kind == "massless":
        D = D * np.outer(mass > 0, mass > 0)
    ports = {"p": rng.choice([0.0, 1.0, -0.5], n) * (mass > 0)}
    if rng.random() < 0.3:
        M, K, D = (sp.csr_array(one) for one in (M, K, D))
    return fs.Substructure(M, K, D, interface=rng.permutation(n), ports=ports, name=name)


def joined(kind: str, rng: Random) -> tuple[dict[str, fs.Substructure], list[Joint]]:
    count = int(rng.integers(3, 5)) if kind == "several parts" else 2
    parts = {f"p{i}": part(kind, rng, f"p{i}", count > 2) for i in range(count)}
    names: list[str] = list(parts)
    joints: list[Joint] = []
    for i in range(1, count):
        one, other = names[i], names[int(rng.integers(0, i))]
        most = min(parts[one].size, parts[other].size)
        held = int(rng.integers(1, most + 1))
        at = [[int(dof) for dof in rng.permutation(parts[name].interface)[:held]] for name in (one, other)]
        pairs = list(zip(*at, strict=False))
        joints += [fs.Rigid((one, [a]), (other, [b]), name=f"r{i}.{j}") for j, (a, b) in enumerate(pairs)]
    if kind == "several parts" and rng.random() < 0.5:  # round a loop, redundant or not
        ends = [(str(name), [int(parts[name].interface[0])]) for name in rng.choice(names, 2, replace=False)]
        joints.append(fs.Rigid(*ends, name="loop"))
    if rng.random() < 0.3:
        terms = tuple((name, int(rng.integers(0, parts[name].size)), float(rng.choice([1.0, -1.0, 0.3, -0.7, 2.0])))
                      for name in rng.permutation(names)[:2] for _ in range(int(rng.integers(1, 3))))
        joints.append(Weighted(tuple((str(a), b, c) for a, b, c in terms), "weighted"))
    if rng.random() < 0.2:
        joints.append(fs.Rigid((names[0], [int(parts[names[0]].interface[0])]), "ground", name="wall"))
    return parts, joints


def motions(parts: dict[str, fs.Substructure], joints: list[Joint]) -> mp.matrix:
    """T with q = T y for all q that the joints allow, by Gauss-Jordan elimination of their equations."""
    start = dict(zip(parts, np.cumsum([0, *(one.size for one in parts.values())]), strict=False))
    n = sum(one.size for one in parts.values())
    pivots: dict[int, list[mp.mpf]] = {}
    for equations in (joint.link(parts).equations for joint in joints):
        rows = np.zeros((next(iter(equations.values())).shape[0], n))
        for name, C in equations.items():
            rows[:, start[name] + parts[name].interface_numbers] += dense(C)
        for row in rows.tolist():
            row = [mp.mpf(value) for value in row]
            for at, other in pivots.items():
                row = [a - row[at] * b for a, b in zip(row, other, strict=True)]
            best = max(range(n), key=lambda j: abs(row[j]))
            if abs(row[best]) < mp.mpf(10) ** -30:
                continue
            row = [a / row[best] for a in row]
            pivots = {at: [a - other[best] * b for a, b in zip(other, row, strict=True)] for at, other in pivots.items()}
            pivots[best] = row
    free = [j for j in range(n) if j not in pivots]
    T = mp.zeros(n, len(free))
    for k, j in enumerate(free):
        T[j, k] = 1
        for at, row in pivots.items():
            T[at, k] = -row[j]
    return T


def finite(parts: dict[str, fs.Substructure], T: mp.matrix, belts: list[tuple[str, float]]) -> list[mp.mpc] | None:
    """All finite λ in 60 digits; None if the pencil is singular."""
    M, D, K = (mp.matrix(la.block_diag(*(dense(getattr(one, key)) for one in parts.values())).tolist()) for key in "MDK")
    for port, slope in belts:
        w = mp.matrix(np.concatenate([one.port("p").ravel() * (port == f"{name}.p") for name, one in parts.items()]).tolist())
        D += mp.mpf(slope) * w * w.T
    M, D, K = T.T * M * T, T.T * D * T, T.T * K * T
    sizes = [mp.sqrt(K[i, i] / M[i, i]) for i in range(T.cols) if M[i, i] > 0 and K[i, i] > 0]
    sigma = (mp.sqrt(3) - 1) * max([*sizes, mp.mpf(1)])
    try:
        found = exact_eigenvalues(M, D, K, sigma)
    except ZeroDivisionError:
        return None
    return None if min((abs(value - sigma) for value in found), default=sigma) < sigma * mp.mpf(10) ** -25 else found


def floating(parts: dict[str, fs.Substructure], T: mp.matrix) -> int:
    """How many motions cost nothing within rounding of K, its DOF in units of energy."""
    basis = np.array(T.tolist(), dtype=float)
    K = basis.T @ la.block_diag(*(dense(one.K) for one in parts.values())) @ basis
    unit = np.where(K.diagonal() > 0, K.diagonal(), 1.0) ** -0.5
    return int(np.count_nonzero(np.linalg.eigvalsh(K * np.outer(unit, unit)) < 1e-12))


def fault(modes: fs.ComplexModes, exact: list[mp.mpc], free: int) -> str:
    """What does not fit, or nothing."""
    found = modes.eigenvalues
    if sorted(found.tolist(), key=lambda z: (z.real, z.imag)) != sorted(found.conj().tolist(), key=lambda z: (z.real, z.imag)):
        return "a pair is split"
    if len(found) != len(exact):
        return f"{len(found)} eigenvalues of {len(exact)}"
    if np.count_nonzero(modes.rigid) > 2 * free:
        return f"{np.count_nonzero(modes.rigid)} of rigid motion, where {free} motions cost nothing"
    return misfit(found, np.where(modes.rigid, np.inf, modes.error_bar), exact)  # where K is singular within rounding, λ is 0


@attack(KINDS)
def attacked(kind: str, rng: Random) -> str:
    parts, joints = joined(kind, rng)
    belts = [(f"{name}.p", float(-(10.0 ** rng.uniform(-3, 3)))) for name in parts
             if kind == "belts" or rng.random() < 0.2]
    belts = [belt for belt in belts if parts[belt[0].split(".")[0]].port("p").any()]
    words = []
    with mp.workdps(DIGITS):
        T = motions(parts, joints)
        exact = finite(parts, T, belts) if T.cols else []
        for assembly in ("primal", "dual"):
            try:
                system = fs.couple(parts, joints, assembly=assembly)
                modes = fs.complex_modes(system, [fs.Belt(port, slope=slope) for port, slope in belts] or None)
            except (fs.FemsubError, ValueError) as error:
                words.append("refused" if isinstance(error, fs.FemsubError) else f"wrong: {error}")
                continue
            if exact is None:
                words.append("wrong" if modes.evidence == "certified" else modes.evidence)
                if words[-1] == "wrong":
                    return f"wrong: {assembly}: certified, but the pencil is singular"
                continue
            what = fault(modes, exact, floating(parts, T))
            if what and modes.evidence != "not checked":
                return f"wrong: {assembly}: {modes.evidence}, but {what}"
            words.append(modes.evidence)
    return words[-1]
