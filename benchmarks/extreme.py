"""Stiff and extreme cases, each right within a bound stated beforehand, or refused with the reason.

    python -m benchmarks extreme [--cases NAME ...] [--quick] [--list] [--out DIR]

--cases takes names, parts of names, or groups; --quick leaves out cases that take longer than a second or two. A failure, even a
crash or a run longer than --limit seconds, is a row of the table and does not end the run.

References come from benchmarks/judges.py: Sturm counts, companion matrices and solves in 60 digits (mpmath, which
`scripts/setup test` installs) of the matrices as they are, in double precision, and closed forms. They do not use femsub. All
errors are relative: of ω², of complex eigenvalues, of slopes, of the reduced model's statics. A bound comes from condition
numbers, from the requested accuracy, or from a method's own error estimate. It is fixed before the error is known, and must be
below 1.

right     Each value lies within its bound, none is missed, no claim (rigid-body modes, stability) is false; the backward error is
          at most 1e-9 and ‖ΦᵀMΦ - I‖ at most 1e-8.
refused   An error of femsub's own, or a warning that rounding takes the digits (then with the figures); the reason is listed.
wrong     Any other result.

The results are written to extreme.csv and extreme.json. Exit status 1: a row is wrong, or differs from its known outcome.
"""

from __future__ import annotations

import time
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

import femsub as fs
from benchmarks import UsageError, lattices
from benchmarks.attacks.common import dense, stiffness
from benchmarks.judges import (
    EPS,
    Array,
    Found,
    basis,
    cea,
    every,
    modes,
    nearly_complete,
    on_an_edge,
    roots,
    slope,
)
from benchmarks.processes import Row, StoppedError, Worker, begin
from femsub.app import report
from femsub.app.result import Result
from femsub.output import Table

BACKWARD, ORTHOGONAL = 1e-9, 1e-8  # a backward error above the first is warned of by femsub itself
FIGURES = ("error", "bound", "ratio", "backward", "orthogonality", "condition", "missed")


@dataclass(frozen=True)
class Case:
    """A named extreme case; `expect` is 'right', or a word that the refusal must contain."""

    name: str
    group: str
    run: Callable[[], Found]
    expect: str = "right"
    quick: bool = True


CASES: dict[str, Case] = {}


def case(group: str, name: str, run: Callable[..., Found], *args: Any, expect: str = "right", quick: bool = True,
         **options: Any) -> None:
    """Adds a case to the table."""
    assert name not in CASES, name
    CASES[name] = Case(name, group, partial(run, *args, **options), expect, quick)


# ---- models


def chain(n: int, **options: Any) -> Callable[[], fs.Substructure]:
    return lambda: fs.chain(n, **options)


def alternating(n: int, ratio: float) -> Array:
    return np.where(np.arange(n) % 2, ratio, 1.0)


def one(n: int, at: int, value: float) -> Array:
    result = np.ones(n)
    result[at] = value
    return result


def graded(first: float, last: float, n: int) -> Array:
    return np.asarray(10 ** np.linspace(first, last, n))


def pieces(*parts: fs.Substructure) -> fs.Substructure:
    """Components side by side, not joined."""
    M, K = (sp.block_diag([getattr(part, key) for part in parts]) for key in "MK")
    return fs.Substructure(M, K)


def lattice(nx: int, ny: int, seed: int = 0, diagonals: bool = True, interface: tuple[int, ...] = (0, 1, -1)) -> fs.Substructure:
    """A plane truss of springs between 0.5 and 2: three rigid-body modes; without diagonals nx + ny free shear motions more."""
    sub = lattices.lattice(nx, ny, seed=seed, diagonals=diagonals)
    return fs.Substructure(sub.M, sub.K, interface=[dof % sub.size for dof in interface])


def ring(n: int) -> fs.Substructure:
    """Equal masses on a circle: λ_j = 4 sin²(jπ/n), each twice but the rigid-body one and, for even n, the last."""
    K = stiffness(n, [(i, (i + 1) % n) for i in range(n)], np.ones(n))
    return fs.Substructure(sp.eye_array(n), sp.csr_array(K))


def loose(free: int) -> fs.Substructure:
    """Eight masses of a chain, one of which is taken out of all connections."""
    K = dense(fs.chain(8).K)
    K[free, :] = K[:, free] = 0.0
    return fs.Substructure(sp.eye_array(8), sp.csr_array(K))


def in_units(sub: fs.Substructure, mass: float, stiffness: float) -> fs.Substructure:
    return fs.Substructure(sub.M * mass, sub.K * stiffness, interface=sub.interface)


def coupled_twins(n: int, spring: float) -> fs.Substructure:
    """Two equal chains with a weak spring between their ends: pairs as close as that spring is weak."""
    tie = stiffness(2 * n, [(n - 1, 2 * n - 1)], [spring])
    return fs.Substructure(sp.eye_array(2 * n), sp.csr_array(sp.block_diag([fs.chain(n).K] * 2) + tie))


def paired_masses() -> fs.Substructure:
    """M of half rank without a zero on its diagonal."""
    return fs.Substructure(sp.kron(sp.eye_array(10), np.ones((2, 2))), fs.chain(20).K)


def bare(n: int, every: int, fixed: bool = True, consistent: bool = False, units: tuple[float, float] = (1.0, 1.0)
         ) -> fs.Substructure:
    """A chain in which every second (third, ...) DOF has no mass, or every second element of a consistent M has none."""
    M = np.diag(np.where(np.arange(n) % every, 1.0, 0.0))
    if consistent:
        element = np.array([[2.0, 1.0], [1.0, 2.0]]) / 6
        M = sum((np.pad(element, (j, n - 2 - j)) for j in range(0, n - 1, every)), np.zeros((n, n)))
    K = dense(fs.chain(n, fixed=fixed).K)
    return fs.Substructure(M * units[0], K * units[1], 0.02 * K * np.sqrt(units[0] * units[1]), interface=[1, n - 1],
                           ports={"unit": np.eye(n)[2], "several": np.eye(n)[:, [0, n // 2]]})


def issue() -> fs.Substructure:
    """Five DOF, two of them without mass, and D = 0.02 K."""
    K = 2 * np.eye(5) - np.eye(5, k=1) - np.eye(5, k=-1)
    return fs.Substructure(np.diag([1.0, 0, 1, 0, 2]), K, 0.02 * K, interface=[0], ports={"p": np.array([0, 1.0, 0, 0.5, 0])})


def drift(n: int, alpha: float, beta: float, reduced: bool = False, **options: Any) -> Found:
    """Uniform motion of a floating chain has λ(nλ + nα + c) = 0, hence drifts from c = -nα on, at ω = 0.

    Its damping is what is left of D's entries when they are added up; 8 roundings of each are allowed.
    """
    sub = fs.damped(fs.chain(n, belt=10, damping=0.0, fixed=False), rayleigh=(alpha, beta))
    within = 8 * EPS * float(abs(sub.D).sum()) / (n * alpha) if alpha else EPS
    return slope(lambda: fs.reduce(sub, fs.CraigChang(6), ports=True) if reduced else sub, -n * alpha, within, 0.0, **options)


# ---- models with their spectra

Known = tuple[Any, Array]


def proportional(n: int, alpha: float, beta: float) -> Known:
    """The chain with D = αM + βK."""
    sub, omega = fs.chain(n), fs.chain_frequencies(n)
    return fs.Pencil(sub.M, alpha * sub.M + beta * sub.K, sub.K), roots(alpha + beta * omega**2, omega**2)


def paired(n: int, gyroscopic: float, circulatory: Any) -> Known:
    """Two motions for each mass of a chain, λ²I + λgJ + K⊗I₂ + I⊗C with J = [[0, 1], [-1, 0]]: for C = cJ
    λ² ± iλg + ω² ± ic = 0; for a matrix C, without g, λ² = -ω² - (eigenvalues of C).
    """
    J, pair, eye, omega = np.array([[0.0, 1.0], [-1.0, 0.0]]), sp.eye_array(2), sp.eye_array(n), fs.chain_frequencies(n)
    C = circulatory * J if np.ndim(circulatory) == 0 else np.asarray(circulatory)
    K = sp.kron(fs.chain(n).K, pair) + sp.kron(eye, sp.csr_array(C))
    if np.ndim(circulatory) == 0:
        values = np.concatenate([roots(sign * 1j * gyroscopic, omega**2 + sign * 1j * circulatory) for sign in (1, -1)])
    else:
        middle = np.trace(C) / 2  # a defective pair in C: exactly the double eigenvalue
        values = np.concatenate([roots(0.0, omega**2 + middle)] * 2)
    return fs.Pencil(sp.eye_array(2 * n), sp.kron(eye, gyroscopic * sp.csr_array(J)), K), values


def component(M: Any, K: Any, sparse: bool) -> fs.Substructure:
    form: Any = sp.csr_array if sparse else dense
    return fs.Substructure(form(M), form(K))


def membrane(m: int, sparse: bool = True) -> Known:
    """m x m unit masses held at the rim, most ω of which are there twice."""
    return component(sp.eye_array(m * m), lattices.membrane(m).K, sparse), np.sqrt(lattices.membrane_eigenvalues(m))


def copies(n: int, number: int, sparse: bool = True) -> Known:
    """Equal chains side by side."""
    K = sp.kron(sp.eye_array(number), fs.chain(n).K)
    return component(sp.eye_array(number * n), K, sparse), np.repeat(fs.chain_frequencies(n), number)


def stiffness_of_mass(n: int, c: float, sparse: bool = True) -> Known:
    """K = c M with M of linear elements: all ω² are c."""
    M = sp.diags_array([np.full(n - 1, 1.0), np.full(n, 4.0), np.full(n - 1, 1.0)], offsets=[-1, 0, 1])
    return component(M, c * M, sparse), np.full(n, np.sqrt(c))


def damped(known: Known, alpha: float) -> Known:
    """The same with D = αM."""
    sub, omega = known
    return fs.Pencil(sub.M, alpha * sub.M, sub.K), roots(alpha, omega**2)


def edge(omega: float, alpha: float) -> float:
    """Im λ of a mode with D = αM."""
    return float(np.sqrt(omega**2 - alpha**2 / 4))


def in_other_units(known: Known, pattern: str) -> Known:
    """DOF multiplied by powers of two between 2^-17 and 2^17, which rounds nothing: SMS, SDS, SKS."""
    model, values = known
    n, rng = model.size, np.random.default_rng(17)
    powers = {"by turns": np.where(np.arange(n) % 2, -17, 17), "halves": np.where(np.arange(n) < n // 2, -17, 17),
              "rising": np.round(np.linspace(-17, 17, n)), "each": rng.integers(-17, 18, n)}[pattern]
    S = sp.diags_array(2.0 ** powers)
    M, D, K = (sp.csr_array(S @ part @ S) for part in (model.M, model.D, model.K))
    return fs.Pencil(M, D, K) if isinstance(model, fs.Pencil) else fs.Substructure(M, K), values


def mixed(parts: list[tuple[float, float, float]], seed: int) -> Known:
    """Oscillators mλ² + dλ + k by themselves in other coordinates: TᵀMT and so on by an integer T with det T = 1; all exact."""
    rng, n = np.random.default_rng(seed), len(parts)
    low, high = (np.tril(rng.integers(-1, 2, (n, n)), -1) + np.eye(n) for _ in range(2))
    T, values = low @ high.T, []
    for m, d, k in parts:
        values += list(roots(d / m, k / m)) if m else [-k / d] if d else []
    return fs.Pencil(*(T.T @ np.diag([part[i] for part in parts]) @ T for i in range(3))), np.array(values, dtype=complex)


def critical(near: float, sparse: bool = True) -> Known:
    """110 oscillators of which one has λ = -3 twice, or nearly: d = 6 (1 + near); blocks are mixed by integers, exactly."""
    rng = np.random.default_rng(5)
    omega = np.array([3.0, 2, 5, 7, 4, 6, 8, 9])
    share = np.array([1 + near, 0.5, 0, 1.5, 0.5, 0, 2, 0.5])
    blocks = []
    for at in (slice(0, 4), slice(4, 8)):
        T = np.eye(4) + np.triu(rng.integers(-2, 3, (4, 4)), 1)
        blocks.append([T.T @ np.diag(part[at]) @ T for part in (np.ones(8), 2 * share * omega, omega**2)])
    rest = rng.integers(400, 900, 102).astype(float)
    blocks.append([np.eye(102), np.zeros((102, 102)), np.diag(rest)])
    root = omega * np.sqrt((share - 1) * (share + 1) + 0j)  # share - 1 is exact, where squares would lose it
    values = np.concatenate([-share * omega - root, omega**2 / (-share * omega - root), roots(0.0, rest)])
    parts = [sp.csr_array(sp.block_diag(part)) for part in zip(*blocks, strict=True)]
    return fs.Pencil(*(parts if sparse else [part.toarray() for part in parts])), values


# ---- the table

HCB, CC = fs.CraigBampton, fs.CraigChang
BOTH = {"HCB": HCB, "CC": CC}
STEEL: dict[str, Any] = {"E": 2.1e11, "nu": 0.3, "rho": 7850.0}
BAR: dict[str, Any] = {"E": 2.1e11, "I": 1e-16 / 12, "rho": 7850.0, "A": 1e-8}
BELT = fs.Belt(slope=-0.2677)
LARGE = "chain of a million masses"

for name, n, ask, options in (
        ("every other spring 1e12", 12, 12, {"springs": alternating(12, 1e12)}),
        ("one spring of 1e-12", 12, 12, {"springs": one(12, 6, 1e-12)}),
        ("mount of 1e-12", 12, 12, {"springs": one(12, 0, 1e-12)}),
        ("every other mass 1e12", 12, 12, {"masses": alternating(12, 1e12)}),
        ("springs and masses graded over 1e12", 12, 12, {"springs": graded(0, 12, 12), "masses": graded(0, -12, 12)}),
        ("soft and light end, 1e24 in ω²", 12, 12, {"springs": graded(0, -12, 12), "masses": graded(0, 12, 12)}),
        ("springs graded over 1e12, 200 masses", 200, 10, {"springs": graded(0, 12, 200)}),
        ("one spring of 1e12, 200 masses", 200, 10, {"springs": one(200, 100, 1e12)}),
        ("one mass of 1e12, 60 of 200 modes", 200, 60, {"masses": one(200, 100, 1e12)}),
        ("masses graded over 1e12, 200 masses", 200, 60, {"masses": graded(0, 12, 200)})):
    case("ratios", name, modes, chain(n, **options), count=ask, checked=12 if n == 12 else 6)
case("ratios", "every other spring 1e-12, 200 masses", modes, chain(200, springs=alternating(200, 1e-12)), count=10, checked=4,
     expect="rounding in the entries of K")
for label, method in BOTH.items():
    case("ratios", f"{label}, every other spring 1e12", basis, chain(12, springs=alternating(12, 1e12), interface=(1, 12)),
         method(4))
    case("ratios", f"{label}, every other mass 1e12", basis, chain(12, masses=alternating(12, 1e12), interface=(1, 12)),
         method(10 if label == "HCB" else 4), whole=label == "HCB")
for name, options in (("every other spring 1e12", {"springs": alternating(6, 1e12)}),
                      ("every other mass 1e12", {"masses": alternating(6, 1e12)}),
                      ("mount of 1e-12", {"springs": one(6, 0, 1e-12)})):
    case("ratios", f"CEA, {name}", cea, chain(6, **options), belt=None if "mount" in name else BELT)
    case("ratios", f"slope, {name}", slope, chain(6, belt=2, **options))
FLUTTER = np.array([[1000.0, 200, 0], [-600, 1010, 0], [0, 0, 1e13]])  # Re λ = +5.4
case("ratios", "CEA, flutter beside 1e13", cea, lambda: fs.Pencil(np.eye(3), None, FLUTTER))

for label, mass, spring in (("mm, t, s", 1e-3, 1e-3), ("nm, ng, ns", 1e12, 1e-6), ("1e-30 and 1e30", 1e-30, 1e30),
                            ("1e30 and 1e-30", 1e30, 1e-30)):
    case("units", f"floating lattice, {label}", modes, lambda m=mass, k=spring: in_units(lattice(3, 4), m, k), rigid=3, count=5)
case("units", "HCB in mm, t, s", basis, lambda: in_units(fs.chain(12, interface=(1, 12)), 1e-3, 1e-3), HCB(10), whole=True)
case("units", "CC in units of 1e30 and 1e-30", basis, lambda: in_units(fs.chain(12, interface=(1, 12)), 1e30, 1e-30), CC(10),
     whole=True)
for ratio in (1e12, 1e-12):
    case("units", f"CEA, ω times {ratio:g}", cea, lambda r=ratio: fs.Pencil(fs.chain(6).M / r, fs.chain(6).D, fs.chain(6).K * r))
    case("units", f"slope, ω times {ratio:g}", slope, lambda r=ratio: fs.Substructure(
        fs.chain(6).M / r, fs.chain(6).K * r, fs.chain(6).D, [0], fs.chain(6, belt=2).ports))
SCALED = ("by turns", "halves", "rising", "each")
case("units", "PEP, DOF in units of 2^-17 to 2^17", every, cea, asks=[{"build": lambda p=p: in_other_units(proportional(
     300, 0.01, 1e-3), p), **ask} for p in SCALED for ask in ({"count": 12}, {"band": (0.0, 0.1)})])
case("units", "modes, DOF in units of 2^-17 to 2^17", every, modes, count=12, asks=[
     {"build": lambda p=p: in_other_units((fs.chain(300), fs.chain_frequencies(300)), p)} for p in SCALED])
case("units", "CEA, DOF in units of 2^-17 to 2^17", every, cea, asks=[{"build": lambda p=p: in_other_units(
     proportional(60, 0.01, 1e-3), p)} for p in SCALED])

for n in (20, 300):
    case("massless", f"every other mass 0, n = {n}", modes,
         lambda n=n: fs.Substructure(sp.diags_array(1.0 - np.arange(n) % 2), fs.chain(n).K), checked=3, count=5)
case("massless", "M of half rank, no zero on its diagonal", modes, paired_masses, count=10)
case("massless", "more modes than masses", modes, paired_masses, checked=10, count=11)
for label, method in BOTH.items():
    case("massless", f"{label}, massless interface", basis,
         lambda: fs.Substructure(np.diag(1.0 - np.arange(12) % 2), fs.chain(12).K, interface=[1]), method(3))
    for name, build, free in (("2 of 5 bare", issue, 0), ("every 2nd bare", lambda: bare(12, 2), 0),
                              ("floating", lambda: bare(12, 2, fixed=False), 1),
                              ("N, t and s", lambda: bare(11, 3, units=(1e-3, 1e8)), 0),
                              ("consistent M", lambda: bare(12, 3, consistent=True), 0)):
        case("massless", f"{label}, all and nearly all modes, {name}", nearly_complete, build, method, free)
MASSLESS, DASHPOT = np.diag(one(6, 2, 0.0)), 1e6 * np.diag(one(6, 2, 0.0) == 0)
case("massless", "CEA, a massless DOF without damping", cea, lambda: fs.Pencil(MASSLESS, 0.1 * MASSLESS, fs.chain(6).K),
     regular=False)
case("massless", "CEA, a massless DOF on a dashpot", cea, lambda: fs.Pencil(MASSLESS, DASHPOT, fs.chain(6).K), regular=False)
case("massless", "slope, a massless DOF", slope, lambda: fs.Substructure(np.diag(one(6, 1, 0.0)), fs.chain(6).K, fs.chain(6).D,
     [0], fs.chain(6, belt=3).ports), expect="M is singular or nearly so")
for label, parts in (("statics", [(1, 0, 4), (2, 0, 3), (0, 0, 1), (0, 0, 5), (1, 0, 9), (0, 0, 2)]),
                     ("dashpots", [(1, 0.5, 4), (0, 3, 1), (2, 0.25, 3), (0, 0, 1), (0, 0.5, 2), (1, 0.125, 16)]),
                     ("one mass", [(1, 0.5, 1), (0, 2, 1), (0, 1, 8), (0, 0, 1), (0, 0, 3)]),
                     ("unstable", [(1, -0.5, 4), (0, 0, 2), (1, 0.25, 9), (0, 1, 3), (0, 0, 7)])):
    case("massless", f"CEA, singular M in mixed DOF, {label}", every, cea, asks=[
         {"build": lambda parts=parts, seed=seed: mixed(parts, seed)} for seed in range(4)])

for count in (1, 2, 5, 12):
    case("rigid", f"{count} floating chains", modes, lambda c=count: pieces(*[fs.chain(6, fixed=False)] * c), rigid=count,
         count=4)
case("rigid", "4 floating lattices, 12 rigid modes", modes, lambda: pieces(*[lattice(3, 4, seed) for seed in range(4)]), rigid=12,
     checked=3, count=4)
case("rigid", "mechanism with 12 free shears", modes, lambda: lattice(4, 8, diagonals=False), rigid=12, count=3)
case("rigid", "a mass without springs", modes, lambda: loose(4), rigid=1, count=3)
case("rigid", "one piece held, one floating", modes, lambda: pieces(fs.chain(60, fixed=False), fs.chain(50)), rigid=1, count=5)
for ratio in (1e6, 1e12):
    case("rigid", f"two floating pieces, 1e{np.log10(ratio):.0f} in stiffness", modes,
         lambda r=ratio: pieces(fs.chain(60, fixed=False), fs.chain(50, fixed=False, springs=r)), rigid=2, count=5)
case("rigid", "a negative spring", modes, lambda: fs.Substructure(np.eye(8), fs.chain(8).K.toarray() - 0.5 * np.eye(8)), count=2,
     expect="negative eigenvalue")

for label, method in BOTH.items():
    case("interface", f"{label}, empty", basis, lambda: fs.Substructure(fs.chain(12).M, fs.chain(12).K), method(3))
    case("interface", f"{label}, all DOF", basis, chain(12, interface=range(1, 13)), method(0 if label == "HCB" else 3),
         whole=True)
    for what, count in (("no modes", 0), ("one mode", 1), ("all modes", 10)):
        case("modes 0, 1, all", f"{label}, {what}", basis, chain(12, interface=(1, 12)), method(count), whole=count == 10)
case("interface", "HCB, empty and floating", basis, lambda: fs.Substructure(fs.chain(12).M, fs.chain(12, fixed=False).K), HCB(3),
     rigid=1)
case("interface", "HCB, just restraining", basis, lambda: lattice(3, 4), HCB(3))
case("interface", "CC, not restraining", basis, lambda: lattice(3, 4, interface=(0, 1)), CC(3), rigid=3)
case("modes 0, 1, all", "no modes", modes, chain(300), count=0)
case("modes 0, 1, all", "no modes, floating", modes, chain(300, fixed=False), rigid=1, count=0)
case("modes 0, 1, all", "all of 300", modes, lambda: (fs.chain(300), fs.chain_frequencies(300)), count=300)
case("modes 0, 1, all", "a single mass", modes, chain(1), count=1)

case("repeated", "ring of 24, all modes", modes, lambda: ring(24), rigid=1, count=23)
case("repeated", "ring of 240, a pair cut", modes, lambda: ring(240), rigid=1, count=8)
case("repeated", "square plate", modes, lambda: fs.plate(fs.rectangle((1.0, 1.0), (3, 3)), **STEEL, thickness=0.01,
     supports=dict.fromkeys(("left", "right", "front", "back"), "simply supported")), checked=6, count=8)
case("repeated", "annulus, floating", modes,
     lambda: fs.solid(fs.annulus(0.1, 0.2, 0.02, (1, 8, 1), "hexahedron"), fs.Material(**STEEL)), rigid=6, checked=4, count=8,
     quick=False)
for label in ("1e-8", "1e-14"):
    case("repeated", f"twins coupled by {label}", modes, lambda k=float(label): coupled_twins(60, k), checked=6, count=9)
case("repeated", "300 equal modes", modes, lambda: fs.Substructure(sp.eye_array(300), sp.eye_array(300)), count=5)
case("repeated", "CEA, equal damped twins", cea, lambda: fs.Pencil(np.eye(4), np.kron(np.eye(2), fs.chain(2).D.toarray()),
     np.kron(np.eye(2), fs.chain(2).K.toarray())))
for sparse, label in ((False, "dense"), (True, "sparse")):
    for n in ((12, 60), (300, 3100))[sparse]:
        case("repeated", f"K = 2 M, {n} DOF", modes, lambda n=n, s=sparse: stiffness_of_mass(n, 2.0, s), count=9)
        case("repeated", f"CEA, K = 2 M, {n} DOF", cea, lambda n=n, s=sparse: damped(stiffness_of_mass(n, 2.0, s), 0.02),
             count=8, semisimple=True)
    size, cuts = 70 if sparse else 12, [{"count": count} for count in (2, 5, 8, 11, 17)]
    case("repeated", f"counts that cut a sixfold one, {label}", every, modes, lambda n=size, s=sparse: copies(n, 6, s), asks=cuts)
    case("repeated", f"CEA, counts that cut a sixfold one, {label}", every, cea,
         lambda n=size, s=sparse: damped(copies(n, 6, s), 1e-3), asks=cuts, semisimple=True)
    for name, known in (("pairs", lambda s=sparse: membrane(16 if s else 7, s)),
                        ("sixfold", lambda n=size, s=sparse: copies(n, 6, s))):
        omega = np.sort(known()[1])
        levels = omega[np.diff(omega, prepend=-1.0) > 1e-9]
        ends = [(0.0, levels[2]), (levels[1], levels[2]), (levels[1], levels[4]), (levels[3], levels[5])]
        tilted = [tuple(edge(omega, 1e-3) if omega else 0.0 for omega in band) for band in ends]
        case("edges", f"{name} on edges, {label}", every, modes, known, asks=[{"band": band} for band in ends])
        case("edges", f"CEA, {name} on edges, {label}", every, cea, lambda known=known: damped(known(), 1e-3), semisimple=True,
             asks=[{"band": band, **re} for band in tilted for re in ({}, {"re": (-5e-4, 0.1)})])
    case("edges", f"CEA, double real λ on an edge, {label}", every, cea, lambda s=sparse: critical(0.0, s), power=2,
         asks=[{"band": (0.0, 10.0), "re": (-3.0, 10.0)}, {"band": (0.0, 10.0), "re": (-100.0, -3.0)}])
    for near in (0.0, 2.0**-30, 2.0**-44, -(2.0**-30)):
        case("defective", f"damping {near:.0e} off critical, {label}", every, cea, lambda r=near, s=sparse: critical(r, s),
             power=2, asks=[{"band": (0.0, 10.3), "re": (-100.0, 100.0)}, {"count": 4}, {"count": 5}])
for belt in (2, 5, 10):
    case("edges", f"slope on an edge, chain 10, belt m{belt}", on_an_edge, chain(10, belt=belt), quick=belt == 2)
case("edges", "slope on an edge, bracketed", on_an_edge, chain(10, belt=2), method="bracketing", quick=False)

for way in ("auto", "bracketing"):
    case("border", f"drift first, {way}", drift, 10, 1e-4, 0.05, method=way)
    case("border", f"drift first, CC, {way}", drift, 10, 1e-4, 0.05, True, method=way)
case("border", "drift first, 3,000 masses", drift, 3000, 1e-6, 5.0, band=(0.0, 0.01))
case("border", "drift without damping, 400 masses", drift, 400, 0.0, 0.05, band=(0.0, 0.006))

SIX, A = fs.chain(6), np.random.default_rng(3).standard_normal((6, 6))
for label, D in (("undamped", None), ("overdamped", 10 * np.eye(6)), ("overdamped 1e6", 1e6 * np.eye(6)),
                 ("negatively damped", -0.1 * np.eye(6)), ("D not proportional", A @ A.T), ("D unsymmetric", A)):
    case("damping", f"CEA, {label}", cea, lambda D=D: fs.Pencil(SIX.M, D, SIX.K))
case("damping", "CEA, D and K unsymmetric", cea, lambda: fs.Pencil(SIX.M, A, SIX.K.toarray() + 0.5 * (A - A.T)))
case("damping", "CEA, K negative", cea, lambda: fs.Pencil(np.eye(6), 0.1 * np.eye(6), -SIX.K.toarray()))
case("damping", "CEA, K = 0", cea, lambda: fs.Pencil(np.eye(3), np.diag([1.0, 2.0, 3.0]), np.zeros((3, 3))), regular=False)
for alpha, beta in ((0.0, 0.0), (0.01, 1e-3), (-0.01, 0.0), (10.0, 0.0), (1e-9, 0.0)):
    case("damping", f"PEP, D = {alpha:g} M + {beta:g} K", cea, lambda a=alpha, b=beta: proportional(300, a, b), count=12)
case("damping", "PEP, undamped, band", cea, lambda: proportional(300, 0.0, 0.0), band=(0.0, 0.1), quick=False)
case("damping", "PEP, D = 1e4 K", cea, lambda: proportional(300, 0.0, 1e4), count=12, quick=False)
case("damping", "PEP, gyroscopic", cea, lambda: paired(150, 1.0, 0.0), count=12)
case("damping", "PEP, circulatory", cea, lambda: paired(150, 0.0, 1e-3), count=12)
case("damping", "slope, undamped", slope, lambda: fs.chain(6, belt=3).with_damping(None), known=0.0)
case("damping", "slope, overdamped", slope, lambda: fs.chain(6, belt=3).with_damping(10 * np.eye(6)))
case("damping", "slope, gyroscopic", slope, lambda: fs.chain(6, belt=3).with_damping(0.05 * np.eye(6) + 0.3 * (A - A.T)))
for label, expect in (("1e4", "right"), ("1e7", "rounding may move the border"), ("1e11", "lost in the rounding of a dashpot")):
    case("damping", f"slope, dashpot of {label}", slope, chain(6, belt=2, damping=float(label)), expect=expect)

TWIN, TURN = np.array([[1.0, 0.5], [-0.5, 2.0]]), np.array([[0, 1], [-1, 0]])  # two modes whose frequencies have just met
for label, off in (("two modes just met", 0.0), ("1e-8 beyond", 1e-8), ("1e-8 before", -1e-8)):
    case("defective", f"flutter, {label}", cea, lambda off=off: fs.Pencil(np.eye(2), None, TWIN + off * TURN), power=2)
case("defective", "critical damping", cea, lambda: fs.Pencil(np.eye(2), np.diag([2.0, 4.0]), np.diag([1.0, 4.0])), power=2)
case("defective", "triple eigenvalue", cea, lambda: fs.Pencil(np.eye(3), None, np.eye(3) + np.diag([1.0, 1.0], 1)), power=3)
case("defective", "PEP, every mode of 150 a defective pair", cea, lambda: paired(150, 0.0, TWIN), count=12, quick=False)

for name, elements, supports, checked, expect in (
        ("of 1 : 1e-4, 100 elements", 100, {"left": "clamped"}, 4, "right"),
        ("of 2,000 elements", 2000, {"left": "pinned", "right": "pinned"}, 2, "right"),
        ("of 6,000 elements", 6000, {"left": "clamped"}, 1, "rounding may take")):
    case("slender", f"beam {name}", modes, lambda n=elements, s=supports: fs.beam(1.0, n, **BAR, supports=s), count=6,
         checked=checked, expect=expect, quick=elements == 100)
for label, expect in (("1e4", "rounding may take"), ("100", "right")):
    case("slender", f"plate cells of 1 : {label}", modes, lambda w=1 / float(label): fs.plate(
        fs.rectangle((1.0, w), (2, 2)), **STEEL, thickness=w / 100, supports={"left": "clamped"}), count=5, checked=4,
        expect=expect)
case("large", LARGE, modes, lambda: (fs.chain(1_000_000), fs.chain_frequencies(1_000_000, 21)), count=20, quick=False)


# ---- the command


def empty_row(name: str) -> Row:
    """What is known of a case that gave nothing."""
    return {"group": CASES[name].group, "case": name, "verdict": "wrong", "as_known": False, "computed": "", "reason": "",
            **dict.fromkeys(FIGURES), "why": "", "warnings": ""}


def evaluate(name: str) -> Row:
    """Runs one case and judges it."""
    row, start, found = empty_row(name), time.perf_counter(), None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", fs.FemsubWarning)
        warnings.simplefilter("ignore", fs.PortWarning)
        try:
            found = CASES[name].run()
        except Exception as error:  # whatever else is raised is no refusal, but must not end the run
            row |= {"reason": f"{type(error).__name__}: {error}"} | (
                {"verdict": "refused"} if isinstance(error, fs.FemsubError) else {})
    told = [one for one in caught if issubclass(one.category, fs.FemsubWarning)]
    row["warnings"] = "; ".join(str(one.message) for one in told)
    if found is not None:
        row |= {key: getattr(found, key) for key in ("computed", "why", *FIGURES)}
        faults = [found.lie, f"{found.ratio:.2g} times its bound" if found.ratio > 1 else "",
                  "the bound says nothing" if not found.bound < 1 else "", f"{found.missed} missed" if found.missed else "",
                  f"‖ΦᵀMΦ - I‖ = {found.orthogonality:.1e}" if (found.orthogonality or 0) > ORTHOGONAL else "",
                  f"backward error {found.backward:.1e}" if (found.backward or 0) > BACKWARD and not told else ""]
        lost = [str(one.message) for one in told if issubclass(one.category, fs.ConditionWarning)]
        row["reason"] = "; ".join(fault for fault in faults if fault)
        if not row["reason"]:
            row["verdict"] = "right"
        elif lost:
            row |= {"verdict": "refused", "reason": f"ConditionWarning: {lost[0]} [{row['reason']}]"}
    expect = CASES[name].expect
    row["as_known"] = row["verdict"] == "right" if expect == "right" else (
        row["verdict"] == "refused" and expect in row["reason"])
    return row | {"seconds": time.perf_counter() - start}


def text(rows: list[Row]) -> str:
    """The reasons of refusals and of wrong rows, and where the bounds come from; all figures are in the table's file."""
    parts = []
    for verdict in ("refused", "wrong"):
        lines = [f"  {row['case']}: {row['reason']}" for row in rows if row["verdict"] == verdict]
        if lines:
            parts.append("\n".join([f"{verdict}:", *lines]))
    bounds = Counter(row["why"] for row in rows if row["verdict"] == "right")
    lines = [f"  {count} x {why}" for why, count in bounds.most_common()]
    return "\n\n".join([*parts, "\n".join(["bounds of what is right:", *lines])])


def main(*, cases: tuple[str, ...] = (), quick: bool = False, list: bool = False, limit: float = 300.0,
         out: Path = Path("out/extreme")) -> int:
    names = [name for name, case in CASES.items() if (case.quick or not quick) and (
        not cases or any(part in name or part == case.group for part in cases))]
    if not names:
        raise UsageError("no case has such a name; --list shows them")
    if list:
        print(*(f"{CASES[name].group}: {name}" for name in names), sep="\n")
        return 0
    begin(out)
    start, rows, worker = time.perf_counter(), [], Worker()
    for at, name in enumerate(names):
        report.progress(f"{at + 1}/{len(names)}: {CASES[name].group}: {name}")
        try:
            rows.append(worker(evaluate, name, limit=limit))
        except StoppedError as error:
            rows.append(empty_row(name) | {"reason": str(error), "seconds": limit})
    worker.close()
    report.progress_done()
    counts, odd = Counter(row["verdict"] for row in rows), [row["case"] for row in rows if not row["as_known"]]
    summary = (f"{len(rows)} cases in {time.perf_counter() - start:.0f} s: {counts['right']} right within their bounds, "
               f"{counts['refused']} refused with the reason, {counts['wrong']} wrong")
    data = {"machine": fs.algebra.machine() | report.versions(), "summary": summary, "rows": rows, "other_than_known": odd}
    result = Result(data, [text(rows), Table("extreme", rows)])
    print(result.text(), "", summary, *([f"other than known: {', '.join(odd)}"] if odd else []), sep="\n")
    report.write(result, out, figures=False, name="extreme")
    return 1 if odd or counts["wrong"] else 0
