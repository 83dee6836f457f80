"""Complex eigenvalues against references in many digits, or by LAPACK from a companion matrix, one to one within error bars.

bars        Small pencils with M, D and K up to 40 orders of magnitude apart, against 150 digits.
structural  Every solution of λ²M + λD + K ± iH under friction: the λ of the upper sign above the real axis, their conjugates, and
            the real λ without H. 'friction': H ⪰ 0 of any rank, unsymmetric contacts. 'overdamped': some λ are real without H.
            'gyroscopic': D with a skew part. 'floating': rigid motion, with an H that acts on it in half of the models. 'large':
            8 to 24 DOF of the first three, against LAPACK on the companion matrix; else 60 digits.
counts      Counts and storage: models of 40 to 400 DOF at one value of the families of `boxes`, by band or count, against LAPACK
            on their dense matrices.
dual        Systems assembled by multipliers, against the primal matrices in 60 digits, and pairs whole. Parts are of 1 to 4 DOF
            whose stiffness and mass differ by up to ten powers of ten. The joints are solved exactly. Both assemblies are
            looked at.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from mpmath import mp
from scipy.optimize import linear_sum_assignment

import femsub as fs
from benchmarks.attacks.boxes import KINDS, family
from benchmarks.attacks.common import (
    Random,
    attack,
    dense,
    eigenvalues,
    exact_eigenvalues,
    misfit,
    row_of_springs,
)
from femsub.checks import Array
from femsub.coupling.joints import Joint, Link
from femsub.model import in_band

BARS = ("scales", "units", "nearly singular", "friction", "clusters")
STRUCTURAL = ("friction", "overdamped", "gyroscopic", "floating", "large")
DUAL = ("two parts", "several parts", "massless", "damped", "belts")
DIGITS = 60
EDGE = 1e-6  # relative distance from an edge at which rounding beside a large D decides what is in the band


# -- bars


def spd(rng: Random, n: int) -> Array:
    B = rng.standard_normal((n, n)).round(3)
    return B @ B.T + 0.1 * np.eye(n)


def scaled_pencil(kind: str, rng: Random) -> fs.Pencil:
    n = int(rng.integers(1, 5))
    M, D, K = spd(rng, n), spd(rng, n) * rng.choice([0.0, 1.0, 1.0, -1.0]), spd(rng, n)
    if rng.random() < 0.3:
        D = np.diag(rng.choice([0.0, 1.0], n))
    if rng.random() < 0.3:
        M = np.diag(rng.uniform(0.5, 2.0, n))
    if kind == "nearly singular":
        z = rng.choice([1.0, -1.0, 0.5], n)
        P = np.eye(n) - np.outer(z, z) / (z @ z)
        K = P @ K @ P
        K = (K + K.T) / 2 + 10.0 ** rng.uniform(-20, -12) * np.diag(rng.uniform(0, 1, n)) * rng.choice([0.0, 1.0])
    if kind in ("friction", "scales") and rng.random() < 0.5:
        K = K + rng.standard_normal((n, n)) * rng.choice([0.1, 1.0, 10.0])
    if kind == "clusters":
        K, M, D = (np.kron(np.eye(2), A) for A in (np.kron(np.eye(n), K[:1, :1]), M, D))
        K[0, 0] *= 1 + 10.0 ** rng.uniform(-16, -6)
    if kind in ("scales", "friction", "nearly singular"):
        M, D, K = (A * 10.0 ** rng.uniform(-20, 20) for A in (M, D, K))
    if kind == "units":
        unit = 10.0 ** rng.uniform(-10, 10, len(M))
        M, D, K = (unit[:, None] * A * unit for A in (M, D * 10.0 ** rng.uniform(-10, 10), K))
        M, D, K = ((A + A.T) / 2 for A in (M, D, K))
    return fs.Pencil(M, D, K)


@attack("bars", BARS)
def bars(kind: str, rng: Random) -> str:
    given = scaled_pencil(kind, rng)
    try:
        modes = fs.complex_modes(given)
    except fs.FemsubError:
        return "refused"
    with mp.workdps(150):
        exact = exact_eigenvalues(*(mp.matrix(A.tolist()) for A in (given.M, given.D, given.K)))
        if len(exact) != len(modes):
            return modes.evidence if modes.evidence == "not checked" else f"wrong: {len(modes)} of {len(exact)}"
        unit = np.abs(given.K).max(axis=0)
        unit = np.where(unit > 0, unit, 1.0) ** -0.5
        if modes.rigid.any() and np.linalg.cond(given.K * np.outer(unit, unit)) < 1e11:  # in one stiffness of all DOF
            return f"wrong: {np.count_nonzero(modes.rigid)} rigid, but K is regular"
        # of a K that is singular within rounding λ is 0
        fault = misfit(modes.eigenvalues, np.where(modes.rigid, np.inf, modes.error_bar), exact)
    return f"wrong: {fault}" if fault else modes.evidence


# -- structural


@attack("structural", STRUCTURAL)
def structural(kind: str, rng: Random) -> str:
    """The evidence, or what is wrong."""
    model, contact = lossy_model(kind, rng)
    try:
        modes = fs.complex_modes(model, contact)
    except fs.FemsubError as error:
        return f"refused: {error}"
    pencil = model.linearised(contact, structural=True).dense()
    lossy, plain = (lossy_eigenvalues(pencil, scale * np.asarray(model.H), kind == "large") for scale in (1.0, 0.0))
    size = np.abs(lossy).max()
    sure = 1e-7 if kind == "large" else 1e-9  # of the largest |λ|: nearer to the axis rounding of the matrices decides the side
    up, real = lossy[lossy.imag > 0], plain[np.abs(plain.imag) <= (1e-12 * size if kind == "large" else 0.0)]
    found = modes.eigenvalues
    bar = modes.error_bar + (1e-8 * size if kind == "large" else 1e-15 * np.abs(found)) + np.where(modes.rigid, 1e-7 * size, 0.0)
    for name, mine, own, there in (("upper", found[found.imag > 0], bar[found.imag > 0], up),
                                   ("real", found[found.imag == 0], bar[found.imag == 0], real)):
        clear = np.abs(there.imag) > sure * size if name == "upper" else np.ones(len(there), dtype=bool)
        far = np.abs(mine[:, None] - there) - own[:, None]
        rows, columns = linear_sum_assignment(np.maximum(far, 0.0))
        unmet = [there[j] for j in np.setdiff1d(np.arange(len(there)), columns) if clear[j]]
        strange = [mine[i] for i in np.setdiff1d(np.arange(len(mine)), rows) if np.abs(mine[i].imag) > own[i] or name == "real"]
        off = [mine[i] for i, j in zip(rows, columns, strict=True) if far[i, j] > 0 and np.isfinite(own[i])]
        if unmet or strange or off:
            if modes.evidence == "not checked" and not off:
                return "not checked"
            return f"wrong: {modes.evidence}, {name}: missing {unmet}, too many {strange}, off {off}"
    growth = max(np.max(up.real, initial=-np.inf), np.max(real.real, initial=-np.inf))
    if modes.is_stable is not None and abs(growth) > sure * size and modes.is_stable != (growth < 0):
        return f"wrong: stable {modes.is_stable}, but growth {growth}"
    return modes.evidence


def lossy_model(kind: str, rng: Random) -> tuple[fs.Substructure, fs.LinearContact]:
    n = int(rng.integers(8, 25) if kind == "large" else rng.integers(1, 5))
    M = np.diag(10 ** rng.uniform(-1, 1, n)) if rng.random() < 0.5 else semidefinite(rng, n, n) + 0.2 * np.eye(n)
    K = semidefinite(rng, n, n) + 0.1 * np.eye(n)
    H = semidefinite(rng, n, int(rng.integers(1, n + 1))) * 10 ** rng.uniform(-4, 1)
    D = np.zeros((n, n))
    kinds = {kind} if kind != "large" else set(rng.choice(STRUCTURAL[:3], int(rng.integers(1, 4))))
    if "overdamped" in kinds:
        D = D + semidefinite(rng, n, int(rng.integers(1, n + 1))) * 10 ** rng.uniform(0, 2)
    if "gyroscopic" in kinds:
        G = rng.standard_normal((n, n)) * 10 ** rng.uniform(-2, 1)
        D = D + G - G.T
    if "floating" in kinds:
        z = rng.integers(1, 3, n) * rng.choice([-1.0, 1.0], n)
        P = np.eye(n) * (z @ z) - np.outer(z, z)
        K = P @ np.diag(rng.integers(1, 9, n).astype(float)) @ P  # whole numbers: Kz is 0 to the last digit
        if rng.random() < 0.5:
            H = P @ np.diag(rng.integers(0, 9, n).astype(float)) @ P * 2.0 ** rng.integers(-9, 2)
        else:
            H = H + 2.0 ** rng.integers(-9, 2) * np.eye(n)
    if rng.random() < 0.3:
        H = 2.0 ** rng.integers(-7, 2) * K  # HZ is 0 where KZ is
    if rng.random() < 0.2 and "floating" not in kinds:
        K = K - rng.uniform(0, 2) * np.eye(n)
    if rng.random() < 0.1:
        H = -H
    ports = {name: rng.standard_normal(n) for name in "ab"}
    C = [rng.standard_normal((2, 2)) * rng.integers(0, 2) * 10 ** rng.uniform(-2, 0.5) for _ in range(2)]
    if "floating" in kinds:
        C[1] *= 0.0
    return (fs.Substructure(M, K, D, H=(H + H.T) / 2, ports=ports),
            fs.LinearContact(("a", "b"), damping=C[0], stiffness=C[1]))


def semidefinite(rng: Random, n: int, rank: int) -> Array:
    A = rng.standard_normal((n, rank))
    return A @ A.T


def lossy_eigenvalues(pencil: fs.Pencil, H: Array, by_lapack: bool) -> Array:
    if by_lapack:
        return eigenvalues(pencil.M, pencil.D, pencil.K + 1j * H)
    with mp.workdps(DIGITS):
        M, D, K, loss = (mp.matrix(A.tolist()) for A in (pencil.M, pencil.D, pencil.K, H))
        values = exact_eigenvalues(M, D, K + mp.mpc(0, 1) * loss)
        size = max(abs(value) for value in values)  # a multiple λ has the root of the working precision as its error
        return np.array([complex(value.real, 0 if abs(value.imag) <= mp.mpf(10) ** (-DIGITS // 3) * size else value.imag)
                         for value in values])


# -- counts


@attack("counts", KINDS)
def counts(kind: str, rng: Random) -> str:
    """The evidence, or what is wrong."""
    full, ranges, (_, hi) = family(kind, rng)
    pencil = full.at(**{name: float(rng.uniform(*ends)) for name, ends in ranges.items()})
    every = fs.complex_modes(pencil.dense()).eigenvalues
    try:
        if rng.random() < 0.6:
            modes = fs.complex_modes(pencil, band=(0.0, hi))
            least, most = (every[in_band(every, (0.0, hi * edge), (-hi * edge, hi * edge))] for edge in (1 - EDGE, 1 + EDGE))
        else:
            count = int(rng.integers(2, 50))
            modes = fs.complex_modes(pencil, count=count)
            size = np.sort(np.abs(every))
            edge = np.abs(modes.eigenvalues).max()
            least, most = every[np.abs(every) < edge * (1 - EDGE)], every[np.abs(every) <= edge * (1 + EDGE)]
            if not size[count - 1] * (1 - EDGE) <= edge <= size[min(count, len(size) - 1)] * (1 + EDGE):
                return f"wrong: {modes.evidence}, |λ| up to {edge}, but {size[count - 1:count + 1]}"
    except fs.FemsubError as error:
        return f"refused: {error}"
    if not len(least) <= len(modes) <= len(most):
        return modes.evidence if modes.evidence == "not checked" else \
            f"wrong: {modes.evidence}, {len(modes)} listed, but there are {len(least)} to {len(most)}"
    return modes.evidence


# -- dual


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
    """The number of motions without energy, within the rounding of K in units of energy."""
    basis = np.array(T.tolist(), dtype=float)
    K = basis.T @ la.block_diag(*(dense(one.K) for one in parts.values())) @ basis
    unit = np.where(K.diagonal() > 0, K.diagonal(), 1.0) ** -0.5
    return int(np.count_nonzero(np.linalg.eigvalsh(K * np.outer(unit, unit)) < 1e-12))


def fault(modes: fs.ComplexModes, exact: list[mp.mpc], free: int) -> str:
    """The first disagreement, as text; '' if all λ agree."""
    found = modes.eigenvalues
    if sorted(found.tolist(), key=lambda z: (z.real, z.imag)) != sorted(found.conj().tolist(), key=lambda z: (z.real, z.imag)):
        return "a pair is split"
    if len(found) != len(exact):
        return f"{len(found)} eigenvalues of {len(exact)}"
    if np.count_nonzero(modes.rigid) > 2 * free:
        return f"{np.count_nonzero(modes.rigid)} of rigid motion, where {free} motions cost nothing"
    return misfit(found, np.where(modes.rigid, np.inf, modes.error_bar), exact)  # where K is singular within rounding, λ is 0


@attack("dual", DUAL)
def dual(kind: str, rng: Random) -> str:
    """The evidence of the second assembly, or what is wrong."""
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
