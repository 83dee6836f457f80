"""Bounds of frequencies from reduced matrices alone: one step and several, modes scaled and mixed, equal and soft parts.

The reference is all frequencies of the full model by LAPACK, or in 50 digits if soft and stiff parts would cost LAPACK its
digits. A bound on the wrong side is wrong, whatever the evidence is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from mpmath import mp

import femsub as fs
from benchmarks.attacks.common import Random, attack, dense
from femsub.checks import EPS, Array

DIGITS = 1e-9  # relative error of frequencies by LAPACK, beside what its norm costs

Case = tuple[fs.Substructure, Callable[[Any], fs.Substructure]]  # a full model, and what reduces it


def _frequencies(full: fs.Substructure, exact: bool) -> Array:
    """All ω of the full model, 0 for rigid motion."""
    K, M = dense(full.K), dense(full.M)
    rigid = fs.normal_modes(full, count=0).rigid
    if exact:
        with mp.workdps(50):
            root = [1 / mp.sqrt(mp.mpf(float(m))) for m in M.diagonal()]
            A = mp.matrix(len(K), len(K))
            for i, j in np.argwhere(K != 0).tolist():
                A[i, j] = mp.mpf(float(K[i, j])) * root[i] * root[j]
            values = np.array([float(max(value, 0)) for value in mp.eigsy(A, eigvals_only=True)])
    else:
        values = np.maximum(la.eigvalsh((K + K.T) / 2, M), 0.0)
    values = np.sort(values)
    values[:rigid] = 0.0
    return np.asarray(np.sqrt(values))


def _chain(random: Random, n: int, interface: list[int], fixed: bool = True, spread: float = 1.0) -> fs.Substructure:
    """Random masses and springs; a port somewhere."""
    return fs.chain(n, belt=int(random.integers(1, n + 1)), masses=random.lognormal(0, spread, n),
                    springs=random.lognormal(0, 1.5 * spread, n), interface=sorted({at % n + 1 for at in interface}), damping=0.0,
                    fixed=fixed)


def _beam(random: Random, supports: dict[str, str]) -> fs.Substructure:
    return fs.beam(1.0, int(random.integers(4, 12)), E=1.0, I=10.0 ** random.uniform(-4, 0), rho=1.0,
                   A=10.0 ** random.uniform(-2, 1), supports=supports, interface=["right"])


def _graph(random: Random, n: int) -> fs.Substructure:
    """Springs between random DOF, also to the ground, and a mass matrix with coupling."""
    C = np.zeros((n, n))
    for i in range(1, n):
        j, k = int(random.integers(i)), random.lognormal(0, 1)
        C[[i, j, i, j], [i, j, j, i]] += [k, k, -k, -k]
    C += np.diag(random.lognormal(-1, 1, n) * (random.random(n) < 0.4))
    C[0, 0] += 1.0
    G = random.standard_normal((n, n)) * (random.random((n, n)) < 0.1)
    M = np.diag(random.lognormal(0, 1, n)) + G @ G.T
    some = random.choice(n, int(random.integers(1, 4)), replace=False)
    return fs.Substructure(M, C, interface=[int(i) for i in some], ports={"p": random.standard_normal(n)}, name="graph")


def part(random: Random) -> fs.Substructure:
    which = random.integers(4)
    if which == 0:
        return _beam(random, {"left": "clamped"})
    if which == 1:
        return _graph(random, int(random.integers(6, 24)))
    n = int(random.integers(8, 40))
    return _chain(random, n, [int(i) for i in random.choice(n, 2)], spread=random.uniform(0, 1.5))


def _modes(random: Random, sub: fs.Substructure) -> int:
    most = min(8, max(len(sub.interior) - 1, min(1, len(sub.interior))))
    return int(random.integers(0 if len(sub.interface) else 1, most + 1))


def _method(random: Random, sub: fs.Substructure) -> fs.CraigBampton:
    if random.random() < 0.2 and len(sub.interior):
        at = np.ix_(sub.interior, sub.interior)
        inside = np.sqrt(np.maximum(la.eigvalsh(dense(sub.K)[at], dense(sub.M)[at]), 0.0))
        return fs.CraigBampton(cutoff=float(random.choice(inside)) * random.choice([1.0, 1.1]))
    return (fs.CraigBampton, fs.CraigBampton, fs.Hurty)[int(random.integers(3))](_modes(random, sub))


def _mixed(random: Random, rom: fs.ReducedSubstructure) -> fs.ReducedSubstructure:
    """A model as from a file: coordinates with the interface at rest are scaled, permuted or mixed, and all called modes."""
    inner = np.array([kind not in ("constraint", "rigid") for kind in rom.kinds], dtype=bool)
    m, how = int(inner.sum()), int(random.integers(4))
    T = np.diag(10.0 ** random.uniform(-4, 4, m))
    if how == 1:
        T = T[:, random.permutation(m)]
    elif how == 2:
        T = np.linalg.qr(random.standard_normal((m, m)))[0] @ np.diag(10.0 ** random.uniform(-2, 2, m)) if m else T
    elif how == 3 and m:
        T = np.diag(1 / np.abs(rom.V[:, inner]).max(axis=0))
    S = np.eye(rom.size)
    S[np.ix_(inner, inner)] = T
    M, K = (S.T @ A @ S for A in (rom.M, rom.K))
    if how != 2:
        K[np.ix_(inner, ~inner)] = K[np.ix_(~inner, inner)] = 0.0
    kinds = tuple("fixed-interface" if at else kind for at, kind in zip(inner, rom.kinds, strict=True))
    return fs.ReducedSubstructure((M + M.T) / 2, (K + K.T) / 2, None, {}, rom.name, V=rom.V @ S, kinds=kinds, cutoff=rom.cutoff,
                                  full_interface=rom.full_interface)


def _scaled(random: Random) -> Case:
    full = part(random)
    if random.random() < 0.5:
        return full, lambda full: _mixed(random, fs.reduce(full, _method(random, full), ports=bool(random.random() < 0.3)))
    other = part(random)
    ends = ("a", [int(full.interface[0])]), ("b", [int(other.interface[0])])
    joints = [fs.Spring(*ends, stiffness=10.0 ** random.uniform(-2, 2))]
    system = fs.couple({"a": full, "b": other}, joints)

    def reductions(_: fs.Substructure) -> fs.Substructure:
        small = {name: fs.reduce(part, _method(random, part), ports=bool(random.random() < 0.3))
                 for name, part in {"a": full, "b": other}.items()}
        return fs.couple({name: _mixed(random, part) if random.random() < 0.8 else part for name, part in small.items()}, joints)

    return system, reductions


def _system(random: Random, count: int, part: Callable[[Random], fs.Substructure] = part) -> fs.System:
    """Parts in a row by springs or rigid joints, with an interface here and there."""
    parts: dict[str, fs.Substructure] = {}
    for i in range(count):  # each interface DOF is a set of its own, so that joints find it in a part that was reduced twice
        sub = part(random)
        parts[f"p{i}"] = fs.Substructure(sub.M, sub.K, None, {f"at {dof}": [int(dof)] for dof in sub.interface}, sub.ports,
                                         sub.name)
    joints: list[fs.Rigid | fs.Spring] = []
    for i in range(1, count):
        one, other = ((name, str(random.choice(list(parts[name].sets)))) for name in (f"p{i - 1}", f"p{i}"))
        joints.append(fs.Rigid(one, other, tol=np.inf) if random.random() < 0.6 else
                      fs.Spring(one, other, stiffness=10.0 ** random.uniform(-2, 2)))
    open_ends = [(name, str(random.choice(list(sub.sets)))) for name, sub in parts.items() if random.random() < 0.3]
    return fs.couple(parts, joints, interface=open_ends)


def _nested(random: Random) -> Case:
    full = _system(random, int(random.integers(1, 4)) + 1) if random.random() < 0.8 else part(random)

    def reductions(model: fs.Substructure) -> fs.Substructure:
        if isinstance(model, fs.System):
            some = {name: _method(random, part) for name, part in model.parts.items() if random.random() < 0.8}
            model = fs.reduce(model, some, ports=bool(random.random() < 0.2)) if some else model
            if random.random() < 0.3 and not any(map(len, model.open.values())):  # its ends go by the numbers of full DOF
                again = {name: _method(random, part) for name, part in model.parts.items() if random.random() < 0.5}
                model = fs.reduce(model, again) if again else model
        for _ in range(int(random.integers(1, 3))):
            if len(model.interior) > 2:
                model = fs.reduce(model, _method(random, model), ports=bool(random.random() < 0.2))
        return model

    return full, reductions


def _hub(random: Random) -> fs.Substructure:
    """A hub with equal oscillators, of which some differ by rounding or by a little."""
    n = int(random.integers(3, 10))
    k, m = np.ones(n) * 2.0 ** random.integers(-2, 3), np.ones(n)
    if random.random() < 0.4:
        k = k * (1 + 10.0 ** random.uniform(-16, -4) * random.standard_normal(n))
    K = np.diag(np.append(k.sum() + random.uniform(0, 2), k))
    K[0, 1:] = K[1:, 0] = -k
    return fs.Substructure(np.diag(np.append(random.lognormal(0, 1), m)), K, name="hub",
                           interface=[0, 1] if random.random() < 0.5 else [0])


def _ring(random: Random) -> fs.Substructure:
    """Equal masses in a circle, each on a spring: double frequencies."""
    n = int(random.integers(5, 16))
    K = np.diag(np.full(n, 2.0 + random.uniform(0.01, 1))) - np.roll(np.eye(n), 1, 0) - np.roll(np.eye(n), -1, 0)
    return fs.Substructure(np.eye(n), K, interface=[0], name="ring")


def _equal(random: Random) -> Case:
    makers = (_hub, _hub, _ring, lambda r: fs.chain(int(r.integers(5, 15)), interface=[1], fixed=True, damping=0.0))
    count = int(random.integers(1, 4))
    if random.random() < 0.4:  # twins
        seed = int(random.integers(2**31))
        made = makers[int(random.integers(4))]
        full = _system(random, count + 1, lambda _: made(np.random.default_rng(seed)))
    else:
        full = _system(random, count + 1, lambda r: makers[int(r.integers(4))](r))

    def reductions(model: fs.System) -> fs.Substructure:
        small = fs.reduce(model, {name: fs.CraigBampton(_modes(random, part)) for name, part in model.parts.items()
                                  if random.random() < 0.9})
        return fs.reduce(small, _method(random, small)) if random.random() < 0.2 and len(small.interior) > 2 else small

    return full, reductions


def _soft(random: Random) -> Case:
    """Masses on springs softer by up to twelve orders of magnitude, on the interface, inside, or between parts."""
    ratio = 10.0 ** random.uniform(-12, 0)

    def part(r: Random) -> fs.Substructure:
        n = int(r.integers(4, 8))
        springs = r.lognormal(0, 0.5, n)
        springs[int(r.integers(n))] *= ratio if r.random() < 0.5 else 1.0
        return fs.chain(n, masses=r.lognormal(0, 0.5, n), springs=springs, interface=[int(r.integers(1, n + 1))], damping=0.0)

    parts = {"a": part(random), "b": part(random)}
    joints = [fs.Spring(("a", [int(parts["a"].interface[0])]), ("b", [int(parts["b"].interface[0])]),
                        stiffness=ratio if random.random() < 0.5 else 1.0)]
    full = fs.couple(parts, joints)

    def reductions(model: fs.System) -> fs.Substructure:
        return fs.reduce(model, {name: fs.CraigBampton(_modes(random, part)) for name, part in parts.items()})

    return full, reductions


def _cut(random: Random) -> Case:
    """Matrices cut into parts, beams and solids cut at nodes, held or floating."""
    which = int(random.integers(3))
    if which == 0:
        n = int(random.integers(12, 40))
        sub = _chain(random, n, [1], fixed=bool(random.random() < 0.7))
        G = random.lognormal(0, 1, n) * 0.4
        M = np.diag(np.asarray(sub.M.diagonal()) + G + np.append(G[1:], 0)) + np.diag(G[1:], 1) + np.diag(G[1:], -1)
        sub = fs.Substructure(sp.csr_array(M), sub.K, interface=[0])
        system = fs.couple(*fs.cut(sub, into=int(random.integers(2, 4))))
    elif which == 1:
        sub = fs.beam(1.0, int(random.integers(8, 20)), E=1.0, I=10.0 ** random.uniform(-4, 0), rho=1.0, A=1.0,
                      supports={"left": "clamped"}, interface=["right"])
        system = fs.couple(*fs.cut(sub, into=int(random.integers(2, 4))))
    else:
        mesh = fs.block((1.0, 0.2, 0.1), (int(random.integers(4, 9)), 1, 1), "hexahedron")
        system = fs.couple(*fs.cut(mesh, fs.solid, into=2, material=fs.Material(1.0, 0.3, 1.0),
                                   supports=["left"] if random.random() < 0.5 else []))

    def reductions(model: fs.System) -> fs.Substructure:
        small = fs.reduce(model, {name: fs.CraigBampton(_modes(random, part)) for name, part in model.parts.items()
                                  if len(part.interior) > 2})
        return fs.reduce(small, fs.CraigBampton(_modes(random, small))) if random.random() < 0.2 and len(
            small.interior) > 2 and len(small.interface) else small

    return system, reductions


CASES = {"scaled": _scaled, "nested": _nested, "equal": _equal, "soft": _soft, "cut": _cut}
KINDS = tuple(CASES)


@attack("frequency_bounds", KINDS)
def attacked(kind: str, random: Random) -> str:
    """The evidence of bounds that hold; 'refused', or what is wrong."""
    full, reductions = CASES[kind](random)
    try:
        small = reductions(full)
    except fs.FemsubError as error:
        return f"refused in the reduction: {error}"
    truth = _frequencies(full, exact=kind == "soft")
    rigid = int(np.count_nonzero(truth == 0))
    if small.size <= rigid:
        return "nothing elastic"
    count = int(random.integers(1, max(2, min(8, small.size - rigid + 1))))
    try:
        found = fs.frequency_bounds(small, count)
    except fs.FemsubError as error:
        lacking = "frequencies were asked for" in str(error)
        return f"{'fewer modes' if lacking else 'refused'}: {error}"
    if found.rigid != rigid:
        return f"wrong: {found.rigid} rigid, not {rigid}: {found!r}"
    elastic = truth[rigid:rigid + count]
    rounding = sum((fs.normal_modes(model, len(elastic)).rounding[rigid:] for model in (full, small)), np.zeros(len(elastic)))
    slack = DIGITS + 8 * (rounding + EPS * (0 if kind == "soft" else (truth[-1] / elastic) ** 2))
    low, high = found.lower[:len(elastic)] / elastic - 1, 1 - found.upper[:len(elastic)] / elastic
    if not (np.isfinite(found.lower).all() and (low <= slack).all() and (high <= slack).all()):
        return (f"wrong: lower/true-1 {low.max():.1e}, 1-upper/true {high.max():.1e}, allowed {slack.max():.1e}: "
                f"{found!r}")
    return found.evidence
