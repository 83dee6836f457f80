"""Extreme cases whose whole spectrum is known by construction: clusters, edges of a band, units of single DOF, singular M."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

import femsub as fs
from benchmarks import lattices
from benchmarks.attacks.common import dense
from benchmarks.extreme.cases import ASKED, case, judge, lattice, spread
from benchmarks.extreme.complex import cea, proportional, roots
from benchmarks.extreme.reference import Array, Found, entry_condition, every, exact, mp

Known = tuple[fs.Pencil, Array]


def listed(build: Callable[[], tuple[fs.Substructure, Array]], band: tuple[float, float] | None = None,
           count: int | None = None) -> Found:
    """Normal modes by a band or a count, as sets: all ω in the band and on its edges, or the lowest ones, and no other.

    The count that femsub gives beside them must be that of the frequencies below its limit.
    """
    sub, omega = build()
    omega = np.sort(omega)
    found = fs.normal_modes(sub, count=count) if band is None else fs.normal_modes(sub, band=band)
    near = 1e-9 * omega[-1]
    wanted = omega[:count] if band is None else omega[(omega >= band[0] * (1 - 1e-12)) & (omega <= band[1] * (1 + 1e-12))]
    if band is None:  # rigid-body modes come on top
        wanted = omega[:int(np.count_nonzero(omega < near)) + (count or 0)]
    values, lie = found.eigenvalues, ""
    if found.counted is not None:
        limit, number = found.counted
        lie = f"{number} counted below {limit:.6g}, where {np.count_nonzero(omega < limit)} are" * (
            int(np.count_nonzero(omega < limit)) != number)
    common = min(len(values), len(wanted))
    elastic = wanted[:common] > near
    shapes, squares = found.shapes[:, :common][:, elastic], wanted[:common][elastic] ** 2
    errors = np.abs(values[:common][elastic] / squares - 1)
    large = sp.issparse(sub.K) and sub.size > 100
    bounds = 8 * entry_condition(sub.K, sub.M, shapes, squares) + (ASKED if large else spread(squares, sub.K, sub.M, sub.size))
    gram = found.shapes.T @ (sub.M @ found.shapes) - np.eye(len(values))
    extra = len(values) - len(wanted)
    return Found(f"{len(values)} modes, {'sparse' if large else 'dense'}", *judge(errors, bounds),
                 "8 roundings per entry + " + ("1e-12, asked of Krylov-Schur" if large else "n eps min(λ/λ₁, λ_n/λ), of LAPACK"),
                 float(found.residual.max(initial=0.0)), float(np.abs(gram).max(initial=0.0)), 1.0, max(0, -extra),
                 lie or (f"{extra} too many" if extra > 0 else ""))


def membrane(m: int, sparse: bool = True) -> tuple[fs.Substructure, Array]:
    """m x m unit masses held at the rim, most ω of which are there twice."""
    sub = lattices.membrane(m)
    return sub if sparse else fs.Substructure(np.eye(m * m), sub.K.toarray()), np.sqrt(lattices.membrane_eigenvalues(m))


def copies(n: int, number: int, sparse: bool = True) -> tuple[fs.Substructure, Array]:
    """Equal chains side by side."""
    K = sp.csr_array(sp.kron(sp.eye_array(number), fs.chain(n).K))
    size = number * n
    sub = fs.Substructure(sp.eye_array(size), K) if sparse else fs.Substructure(np.eye(size), K.toarray())
    return sub, np.repeat(fs.chain_frequencies(n), number)


def stiffness_of_mass(n: int, c: float, sparse: bool = True) -> tuple[fs.Substructure, Array]:
    """K = c M with M of linear elements: all ω² are c."""
    M = sp.diags_array([np.full(n - 1, 1.0), np.full(n, 4.0), np.full(n - 1, 1.0)], offsets=[-1, 0, 1], format="csr")
    return fs.Substructure(*(part if sparse else part.toarray() for part in (M, c * M))), np.full(n, np.sqrt(c))


def damped(known: tuple[fs.Substructure, Array], alpha: float) -> Known:
    """The same with D = αM."""
    sub, omega = known
    return fs.Pencil(sub.M, alpha * sub.M, sub.K), roots(alpha, omega**2)


def edge(omega: float, alpha: float) -> float:
    """Im λ of a mode with D = αM."""
    return float(np.sqrt(omega**2 - alpha**2 / 4))


def in_other_units(known: Known, pattern: str) -> Known:
    """DOF multiplied by powers of two between 2^-17 and 2^17, which rounds nothing: SMS, SDS, SKS."""
    pencil, values = known
    n, rng = pencil.size, np.random.default_rng(17)
    powers = {"by turns": np.where(np.arange(n) % 2, -17, 17), "halves": np.where(np.arange(n) < n // 2, -17, 17),
              "rising": np.round(np.linspace(-17, 17, n)), "each": rng.integers(-17, 18, n)}[pattern]
    S = sp.diags_array(2.0 ** powers)
    return fs.Pencil(*(sp.csr_array(S @ part @ S) for part in (pencil.M, pencil.D, pencil.K))), values


def component(known: Known, omega: Array) -> tuple[fs.Substructure, Array]:
    """M and K of a pencil as a component with these frequencies."""
    return fs.Substructure(known[0].M, known[0].K), omega


def mixed(parts: list[tuple[float, float, float]], seed: int) -> Known:
    """Oscillators mλ² + dλ + k by themselves in other coordinates: TᵀMT and so on by an integer T with det T = 1; all exact."""
    rng, n = np.random.default_rng(seed), len(parts)
    low, high = (np.tril(rng.integers(-1, 2, (n, n)), -1) + np.eye(n) for _ in range(2))
    T, values = low @ high.T, []
    for m, d, k in parts:
        values += list(roots(d / m, k / m)) if m else [-k / d] if d else []
    return fs.Pencil(*(T.T @ np.diag([part[i] for part in parts]) @ T for i in range(3))), np.array(values, dtype=complex)


def tied(friction: float) -> Known:
    """Two oscillators tied by a multiplier, q₁ = q₂, and a third: M, D and K of the tied ones add up."""
    M, K, D = np.diag([1.0, 3.0, 1.0, 0.0]), np.diag([2.0, 6.0, 9.0, 0.0]), np.diag([0.25, 0.25, friction, 0.0])
    K[3, :2] = K[:2, 3] = 1, -1
    return fs.Pencil(M, D, K), np.concatenate([roots(0.125, 2.0), roots(friction, 9.0)])


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


def critical_ones(seed: int) -> Known:
    """Three blocks of two to four such oscillators of random ω and damping, many of them critical, beside others far off."""
    rng, blocks, values = np.random.default_rng([seed, 5]), [], []
    first = float(rng.integers(1, 6))
    for start in range(3):
        n = int(rng.integers(2, 5))
        omega, share = rng.integers(2, 9, n).astype(float), rng.integers(0, 5, n) / 2
        if start == 0:
            omega[0], share[0] = first, 1.0
        T = np.eye(n) + np.triu(rng.integers(-2, 3, (n, n)), 1)
        blocks.append([T.T @ np.diag(part) @ T for part in (np.ones(n), 2 * share * omega, omega**2)])
        values.append(roots(2 * share * omega, omega**2))
    rest = rng.integers(400, 900, 110 - sum(len(block[0]) for block in blocks)).astype(float)
    blocks.append([np.eye(len(rest)), np.zeros((len(rest), len(rest))), np.diag(rest)])
    parts = [sp.csr_array(sp.block_diag(part)) for part in zip(*blocks, strict=True)]
    return fs.Pencil(*parts), np.concatenate([*values, roots(0.0, rest)])


def sliding_pairs(n: int) -> Known:
    """A floating chain whose masses move in two directions, coupled by [[1, 0.25], [-0.125, 1.5]]: four zeros, and
    λ² = -μω² with its eigenvalues μ.
    """
    C, omega = np.array([[1.0, 0.25], [-0.125, 1.5]]), 2 * np.sin(np.arange(n) * np.pi / (2 * n))
    values = np.concatenate([roots(0.0, mu * omega**2) for mu in la.eigvals(C).real])
    return fs.Pencil(sp.eye_array(2 * n), None, sp.csr_array(sp.kron(fs.chain(n, fixed=False).K, C))), values


@cache
def _rubbing() -> tuple[Array, Array, Array]:
    """M and K of a floating lattice of 12 nodes with a rubbing contact between two, K unsymmetric, and all λ in 60 digits.

    Two translations are free, hence four zeros; a turn shears the contact. In double precision the entries leave them
    at some 1e-8, which is set to 0.
    """
    sub = lattice(3, 4)
    normal, along = np.zeros((2, sub.size, 1))
    normal[[0, 14], 0] = along[[1, 15], 0] = 1, -1
    M, K = dense(sub.M), dense(sub.K) + (0.3 * normal + 0.1 * along) @ normal.T
    squares = mp.eig(mp.diag([1 / mp.mpf(float(m)) for m in M.diagonal()]) * exact(K), left=False, right=False)
    order = sorted(squares, key=abs)
    assert abs(order[1]) < 1e-12 < 1e-3 < abs(order[2])
    values = [root for square in [0, 0, *order[2:]] for root in (mp.sqrt(-square), -mp.sqrt(-square))]
    return M, K, np.array([complex(value) for value in values])


def rubbing(number: int) -> Known:
    """So many of these side by side, as a sparse pencil; the reference is that of one piece."""
    M, K, values = _rubbing()
    M, K = (sp.csr_array(sp.kron(sp.eye_array(number), part)) for part in (M, K))
    return fs.Pencil(M, None, K), np.tile(values, number)


SCALED = ("by turns", "halves", "rising", "each")
case("units", "PEP, DOF in units of 2^-17 to 2^17", every, cea, asks=[{"build": lambda p=p: in_other_units(proportional(
     300, 0.01, 1e-3), p), **ask} for p in SCALED for ask in ({"count": 12}, {"band": (0.0, 0.1)})], closed=True)
case("units", "modes, DOF in units of 2^-17 to 2^17", every, listed, asks=[{"build": lambda p=p: component(in_other_units(
     proportional(300, 0.0, 0.0), p), fs.chain_frequencies(300))} for p in SCALED], count=12)
case("units", "CEA, DOF in units of 2^-17 to 2^17", every, cea, asks=[{"build": lambda p=p: in_other_units(
     proportional(60, 0.01, 1e-3), p)} for p in SCALED], closed=True)
for label, parts in (("statics", [(1, 0, 4), (2, 0, 3), (0, 0, 1), (0, 0, 5), (1, 0, 9), (0, 0, 2)]),
                     ("dashpots", [(1, 0.5, 4), (0, 3, 1), (2, 0.25, 3), (0, 0, 1), (0, 0.5, 2), (1, 0.125, 16)]),
                     ("one mass", [(1, 0.5, 1), (0, 2, 1), (0, 1, 8), (0, 0, 1), (0, 0, 3)]),
                     ("unstable", [(1, -0.5, 4), (0, 0, 2), (1, 0.25, 9), (0, 1, 3), (0, 0, 7)])):
    case("massless", f"CEA, singular M in mixed DOF, {label}", every, cea, asks=[
         {"build": lambda parts=parts, seed=seed: mixed(parts, seed)} for seed in range(4)], closed=True)
case("massless", "CEA, tied by a multiplier", every, cea, asks=[{"build": lambda f=f: tied(f)} for f in (0.0, 0.125)],
     closed=True)
for pieces_of, counts in ((1, (2, 4, 9)), (5, (6, 18, 19, 40))):
    case("rigid", f"CEA, {pieces_of} floating with friction, by count", every, cea, lambda p=pieces_of: rubbing(p), closed=True,
         asks=[{"count": count} for count in counts])
case("rigid", "PEP, floating, K unsymmetric, by count", every, cea, lambda: sliding_pairs(100), closed=True,
     asks=[{"count": count} for count in (6, 18, 19, 40)])
for sparse, label in ((False, "dense"), (True, "sparse")):
    for n in ((12, 60), (300, 3100))[sparse]:
        case("repeated", f"K = 2 M, {n} DOF", listed, lambda n=n, s=sparse: stiffness_of_mass(n, 2.0, s), count=9)
        case("repeated", f"CEA, K = 2 M, {n} DOF", cea, lambda n=n, s=sparse: damped(stiffness_of_mass(n, 2.0, s), 0.02),
             closed=True,
             count=8, semisimple=True)
    size = 70 if sparse else 12
    case("repeated", f"counts that cut a sixfold one, {label}", every, listed, lambda n=size, s=sparse: copies(n, 6, s),
         asks=[{"count": count} for count in (2, 5, 8, 11, 17)])
    case("repeated", f"CEA, counts that cut a sixfold one, {label}", every, cea,
         lambda n=size, s=sparse: damped(copies(n, 6, s), 1e-3), asks=[{"count": count} for count in (2, 5, 8, 11, 17)],
         closed=True, semisimple=True)
for sparse, label in ((False, "dense"), (True, "sparse")):
    for name, known in (("pairs", lambda s=sparse: membrane(16 if s else 7, s)),
                        ("sixfold", lambda s=sparse: copies(70 if s else 12, 6, s))):
        omega = np.sort(known()[1])
        levels = omega[np.diff(omega, prepend=-1.0) > 1e-9]
        ends = [(0.0, levels[2]), (levels[1], levels[2]), (levels[1], levels[4]), (levels[3], levels[5])]
        tilted = [tuple(edge(omega, 1e-3) if omega else 0.0 for omega in band) for band in ends]
        case("edges", f"{name} on edges, {label}", every, listed, known, asks=[{"band": band} for band in ends])
        case("edges", f"CEA, {name} on edges, {label}", every, cea, lambda known=known: damped(known(), 1e-3), closed=True,
             semisimple=True, asks=[{"band": band, **re} for band in tilted for re in ({}, {"re": (-5e-4, 0.1)})])
    case("edges", f"CEA, double real λ on an edge, {label}", every, cea, lambda s=sparse: critical(0.0, s), closed=True, power=2,
         asks=[{"band": (0.0, 10.0), "re": (-3.0, 10.0)}, {"band": (0.0, 10.0), "re": (-100.0, -3.0)}])
for near in (0.0, 2.0**-30, 2.0**-44, -(2.0**-30)):
    for sparse, label in ((False, "dense"), (True, "sparse")):
        case("defective", f"damping {near:.0e} off critical, {label}", every, cea, lambda r=near, s=sparse: critical(r, s),
             closed=True,
             power=2, asks=[{"band": (0.0, 10.3), "re": (-100.0, 100.0)}, {"count": 4}, {"count": 5}])
case("defective", "critical damping, 25 models", every, cea, closed=True, power=2, asks=[
     {"build": lambda seed=seed: critical_ones(seed), **ask} for seed in range(25)
     for ask in ({"band": (0.0, 10.3), "re": (-100.0, 100.0)}, {"count": 1 + seed % 8})])
