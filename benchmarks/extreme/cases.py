"""Extreme cases of normal modes and of reduction bases, each with what it is judged by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

import femsub as fs
from benchmarks import lattices
from benchmarks.attacks.common import dense, stiffness
from benchmarks.extreme.reference import EPS, Array, Found, Sturm, answered, entry_condition, exact, mp

STEEL: dict[str, Any] = {"E": 2.1e11, "nu": 0.3, "rho": 7850.0}
ASKED = 1e-12  # of Krylov-Schur by femsub, relative to the shifted and inverted eigenvalue
DEPENDENT = 1e-13  # share of its energy below which Craig-Chang drops a column


@dataclass(frozen=True)
class Case:
    """A named extreme case; `expect` is 'right', or what the refusal must speak of."""

    name: str
    group: str
    run: Callable[[], Found]
    expect: str = "right"
    quick: bool = True


CASES: dict[str, Case] = {}


def case(group: str, name: str, run: Callable[..., Found], *args: Any, expect: str = "right", quick: bool = True,
         **options: Any) -> None:
    """Puts a case into the table."""
    assert name not in CASES, name
    CASES[name] = Case(name, group, partial(run, *args, **options), expect, quick)


def alternating(n: int, ratio: float) -> Array:
    return np.where(np.arange(n) % 2, ratio, 1.0)


def one(n: int, at: int, value: float) -> Array:
    result = np.ones(n)
    result[at] = value
    return result


def pieces(*parts: fs.Substructure, interface: tuple[int, ...] = ()) -> fs.Substructure:
    """Components side by side, not joined."""
    M, K = (sp.block_diag([getattr(part, key) for part in parts]) for key in "MK")
    return fs.Substructure(M, K, interface=interface)


def lattice(nx: int, ny: int, seed: int = 0, diagonals: bool = True) -> fs.Substructure:
    """A plane truss of springs between 0.5 and 2: three rigid-body modes, and without diagonals nx + ny free shears."""
    sub = lattices.lattice(nx, ny, seed=seed, diagonals=diagonals)
    return fs.Substructure(sub.M, sub.K, interface=[0, 1, sub.size - 1])


def ring(n: int) -> fs.Substructure:
    """Equal masses on a circle: λ_j = 4 sin²(jπ/n), each twice but the rigid-body one and, for even n, the last."""
    K = stiffness(n, [(i, (i + 1) % n) for i in range(n)], np.ones(n))
    return fs.Substructure(sp.eye_array(n), sp.csr_array(K))


def held(K: Any, free: int) -> Any:
    """K with one DOF taken out of all connections."""
    K = dense(K).copy()
    K[free, :] = K[:, free] = 0.0
    return sp.csr_array(K)


def in_units(sub: fs.Substructure, mass: float, stiffness: float) -> fs.Substructure:
    return fs.Substructure(sub.M * mass, sub.K * stiffness, interface=sub.interface)


def coupled_twins(n: int, spring: float) -> fs.Substructure:
    """Two equal chains with a weak spring between their ends: pairs as close as that spring is weak."""
    K = sp.lil_array(sp.block_diag([fs.chain(n).K] * 2))
    for i, j, sign in ((n - 1, n - 1, 1), (2 * n - 1, 2 * n - 1, 1), (n - 1, 2 * n - 1, -1), (2 * n - 1, n - 1, -1)):
        K[i, j] += sign * spring
    return fs.Substructure(sp.eye_array(2 * n), sp.csr_array(K))


def spread(values: Array, K: Any, M: Any, n: int) -> Array:
    """What LAPACK may lose, which works from both ends of the spectrum: n eps min(λ/λ₁, λ_n/λ)."""
    top = float(np.max(np.divide(K.diagonal(), M.diagonal(), out=np.zeros(K.shape[0]), where=M.diagonal() > 0)))
    return n * EPS * np.minimum(values / values[0], np.maximum(2 * top / values, 1.0))


def judge(errors: Array, bounds: Array) -> tuple[float, float, float]:
    """The largest error, the bound of that value, and the largest error over its own bound."""
    if not len(errors):
        return 0.0, EPS, 0.0
    at = int(np.argmax(errors))
    return float(errors[at]), float(bounds[at]), float((errors / bounds).max())


def modes(build: Callable[[], fs.Substructure], count: int, rigid: int = 0, checked: int | None = None,
          frequencies: Array | None = None) -> Found:
    """`count` elastic modes; the references are Sturm counts in 60 digits, or frequencies in closed form."""
    sub = build()
    found = fs.normal_modes(sub, count=count)
    values, shapes = found.eigenvalues[found.rigid:], found.shapes
    n, large = sub.size, sp.issparse(sub.K) and sub.size > 100 and count <= 0.3 * sub.size
    lie = f"{found.rigid} rigid-body modes, but there are {rigid}" if found.rigid != rigid else ""
    if frequencies is not None:
        errors, missed = np.abs(found.frequencies[found.rigid:] / frequencies[:count] - 1) * 2, None
    else:
        sturm = Sturm(sub.K, sub.M)
        some = slice(0, checked or count)
        errors = sturm.errors(values[some], found.rigid + 1) if count else np.zeros(0)
        last = float(values[-1]) * (1 - 1e-9) if count else 0.0
        missed = sturm.count(last) - int(np.count_nonzero(found.eigenvalues < last)) if count else 0
        values = values[some]
    bounds, why = np.zeros(0), "no elastic mode was asked for"
    if len(values):
        entry = 8 * entry_condition(sub.K, sub.M, shapes[:, found.rigid:found.rigid + len(values)], values)
        bounds = entry + (ASKED if large else spread(values, sub.K, sub.M, n))
        why = "8 roundings per entry + " + ("1e-12, asked of Krylov-Schur" if large else "n eps min(λ/λ₁, λ_n/λ), of LAPACK")
    worst = judge(errors, bounds)
    gram = shapes.T @ (sub.M @ shapes) - np.eye(shapes.shape[1])
    told = f"{count} modes" + (f", {rigid} rigid" if rigid else "")
    return Found(told, *worst, why, float(found.residual.max(initial=0.0)), float(np.abs(gram).max(initial=0.0)),
                 float(np.linalg.cond(gram + np.eye(len(gram)))) if len(gram) else 1.0, missed, lie)


def bending(kind: str, thickness: float, count: int = 8) -> Found:
    """The first frequency of a slender cantilever of bricks (ν = 0) against Euler and Bernoulli; bricks of 8 nodes lock,
    by sqrt(1 + a²/2t²) for elements of length a (the energy of their parasitic shear).
    """
    mesh = fs.block((1.0, thickness, thickness), (count, 1, 1), kind)
    sub = fs.solid(mesh, fs.Material(STEEL["E"], 0.0, STEEL["rho"]), supports={"left": "clamped"})
    found = fs.normal_modes(sub, count=1)
    locked = np.sqrt(1 + 0.5 / (count * thickness) ** 2) if kind == "hexahedron" else 1.0
    omega = 3.5160152685 * locked * np.sqrt(STEEL["E"] / STEEL["rho"] / 12) * thickness
    error, bound = abs(float(found.frequencies[0]) / omega - 1), 1 / count**2 + float(found.rounding[0])
    return Found(f"ω = {found.frequencies[0]:.5g}, locked by {locked:.3g}", error, bound, error / bound,
                 "mesh, (a/L)², + one rounding per entry", float(found.residual[0]))


def soft_rigid(n: int, spring: float) -> Found:
    """A mount too soft to be told from rounding counts as none: ω² = 0 is off by 4e-15 |φ|ᵀ|K||φ| at most."""
    sub = fs.chain(n, springs=one(n, 0, spring))
    found = fs.normal_modes(sub, count=5)
    sturm, shape = Sturm(sub.K, sub.M), found.shapes[:, 0]
    scale = float(np.abs(shape) @ (abs(sub.K) @ np.abs(shape)))
    low, high = mp.mpf(10) ** -40, mp.mpf(1)
    while high / low > 1.01:
        middle = mp.sqrt(low * high)
        low, high = (middle, high) if sturm.count(middle) < 1 else (low, middle)
    gram = found.shapes.T @ (sub.M @ found.shapes) - np.eye(6)
    error = abs(float(high) - float(found.eigenvalues[0])) / scale
    return Found("5 modes, 1 rigid", error, 4e-15, error / 4e-15, "ω² of a rigid-body mode, over |φ|ᵀ|K||φ|: ENERGY",
                 float(found.residual.max()), float(np.abs(gram).max()), float(np.linalg.cond(gram + np.eye(6))),
                 sturm.count(float(found.eigenvalues[-1]) * 0.999) - 5)


def basis(build: Callable[[], fs.Substructure], method: Any, rigid: int = 0, ports: bool = False, whole: bool = False,
          floating: int | None = None) -> Found:
    """A reduced model: kept modes by Sturm counts, its statics at the interface by solves in 60 digits; with `whole`,
    where nothing is left out, the spectrum of the full model, which has `floating` rigid-body modes (default: `rigid`).
    """
    sub = build()
    rom = fs.reduce(sub, method, ports=ports)
    hcb = isinstance(method, fs.CraigBampton)
    inner = sub.interior if hcb else np.arange(sub.size)
    K, M = (sp.csr_array(dense(part)[np.ix_(inner, inner)]) for part in (sub.K, sub.M))
    at = np.array([i for i, kind in enumerate(rom.kinds) if kind in ("fixed-interface", "free")], dtype=int)
    lie = f"{rom.kinds.count('rigid')} rigid-body modes, but there are {rigid}" if rom.kinds.count("rigid") != rigid else ""
    values, shapes = rom.K[at, at], rom.V[np.ix_(inner, at)]
    errors, bounds = np.zeros(0), np.zeros(0)
    if len(at):
        errors = Sturm(K, M).errors(values, rigid + 1)
        bounds = 8 * entry_condition(K, M, shapes, values) + spread(values, K, M, len(inner))
    why = "8 roundings per entry + n eps min(λ/λ₁, λ_n/λ)"
    if len(sub.interface) and (hcb or not rigid):
        static, limit = (_condensed if hcb else _flexibility)(sub, rom)
        errors, bounds, why = np.append(errors, static), np.append(bounds, limit), why + ", also for statics"
    massive = np.flatnonzero(np.diag(rom.M) > 0)
    unit = rom.M[massive, massive] ** -0.5
    weights = np.linalg.svd(rom.M[np.ix_(massive, massive)] * np.outer(unit, unit), compute_uv=False)
    cond = float(weights[0] / weights[weights > 1e-13 * weights[0]][-1])  # of a singular M, that of its range
    if whole:
        sturm = Sturm(sub.K, sub.M)
        there = sturm.count(mp.mpf(10) ** 15 * float(abs(sub.K).max() / abs(sub.M).max()))  # as many as M has ranks
        full = fs.normal_modes(rom, count=there - (rigid if floating is None else floating))
        errors = np.append(errors, sturm.errors(full.eigenvalues[full.rigid:], full.rigid + 1))
        original = rom.V @ full.shapes[:, full.rigid:]
        joined = 8 * (entry_condition(sub.K, sub.M, original, full.eigenvalues[full.rigid:]) + full.rounding[full.rigid:])
        bounds = np.append(bounds, joined + sub.size * EPS * cond + spread(full.eigenvalues[full.rigid:], sub.K, sub.M, sub.size))
        why += ", n eps cond(VᵀMV)"
    worst = judge(errors, bounds)
    own = rom.V[inner][:, (at if hcb else np.flatnonzero(np.diag(rom.M) > 0))]
    gram = own.T @ (M @ own) - np.eye(own.shape[1])
    residual = np.linalg.norm(K @ shapes - (M @ shapes) * values, axis=0) / np.maximum(
        np.linalg.norm(abs(K) @ abs(shapes) + (abs(M) @ abs(shapes)) * values, axis=0), 1e-300) if len(at) else np.zeros(1)
    told = f"{'HCB' if hcb else 'CC'}, {len(at)} modes, {rom.size} of {sub.size} DOF"
    return Found(told, *worst, why, float(residual.max()), float(np.abs(gram).max(initial=0.0)), cond, 0, lie)


def _condensed(sub: fs.Substructure, rom: fs.ReducedSubstructure) -> tuple[float, float]:
    """Error of K_bb - K_bi K_ii⁻¹ K_ib, and 8 eps |Ψ|ᵀ|K||Ψ|, over its largest entry (over that of K_bb where it is 0)."""
    b, i, K = sub.interface, sub.interior, exact(sub.K)
    S = mp.matrix([[K[int(r), int(c)] for c in b] for r in b])
    if len(i):
        Kib = mp.matrix([[K[int(r), int(c)] for c in b] for r in i])
        Kii = mp.matrix([[K[int(r), int(c)] for c in i] for r in i])
        for column in range(len(b)):
            x = mp.lu_solve(Kii, Kib[:, column])
            for row in range(len(b)):
                S[row, column] -= (Kib[:, row].T * x)[0]
    psi, size = np.abs(rom.V[:, :len(b)]), float(max(abs(value) for value in S))
    bare = float(max(abs(K[int(dof), int(dof)]) for dof in b))
    size = size if size > 1e-14 * bare else bare
    error = max(abs(S[r, c] - mp.mpf(float(rom.K[r, c]))) for r in range(len(b)) for c in range(len(b)))
    return float(error) / size, 8 * EPS * float((psi.T @ (abs(sub.K) @ psi)).max()) / size


def _flexibility(sub: fs.Substructure, rom: fs.ReducedSubstructure) -> tuple[float, float]:
    """Error of FᵀK⁻¹F by the reduced model, and what may be lost: 8 eps |u|ᵀ|K||u| and the energy of dropped columns."""
    K, b = exact(sub.K), [int(dof) for dof in sub.interface]
    answer = [mp.lu_solve(K, mp.matrix([mp.mpf(int(row == dof)) for row in range(sub.size)])) for dof in b]
    there = rom.V[b] @ np.linalg.solve(rom.K, rom.V[b].T)
    size = float(max(abs(answer[c][r]) for c in range(len(b)) for r in b))
    error = max(abs(answer[c][b[r]] - mp.mpf(float(there[r, c]))) for r in range(len(b)) for c in range(len(b)))
    u = np.abs(np.array([[float(value) for value in column] for column in answer]).T)
    return float(error) / size, 8 * EPS * float((u.T @ (abs(sub.K) @ u)).max()) / size + rom.dropped * DEPENDENT


HCB, CC = fs.CraigBampton, fs.CraigChang


def chain(n: int, **options: Any) -> Callable[[], fs.Substructure]:
    return lambda: fs.chain(n, **options)


LARGE = "chain of a million masses"


def thin(kind: str, thickness: float, count: int = 1) -> object:
    """A cantilever of steel, 1 long, as thick as wide."""
    return lambda: fs.solid(fs.block((1.0, thickness, thickness), (count, 1, 1), kind), fs.Material(2.1e11, 0.0, 7850.0),
                            supports={"left": "clamped"})


case("ratios", "every other spring 1e12", modes, chain(12, springs=alternating(12, 1e12)), 12)
case("ratios", "every other spring 1e-12, 200 masses", modes, chain(200, springs=alternating(200, 1e-12)), 10, checked=4,
     expect="rounding in the entries of K")
case("ratios", "springs graded over 1e12, 200 masses", modes, chain(200, springs=10 ** np.linspace(0, 12, 200)), 10, checked=4)
case("ratios", "one spring of 1e12, 200 masses", modes, chain(200, springs=one(200, 100, 1e12)), 10, checked=6)
case("ratios", "one spring of 1e-12", modes, chain(12, springs=one(12, 6, 1e-12)), 12)
case("ratios", "mount of 1e-12", modes, chain(12, springs=one(12, 0, 1e-12)), 12)
case("ratios", "mount of 1e-12 under 200 masses", soft_rigid, 200, 1e-12)
case("ratios", "every other mass 1e12", modes, chain(12, masses=alternating(12, 1e12)), 12)
case("ratios", "one mass of 1e12, 60 of 200 modes", modes, chain(200, masses=one(200, 100, 1e12)), 60, checked=6)
case("ratios", "masses graded over 1e12, 200 masses", modes, chain(200, masses=10 ** np.linspace(0, 12, 200)), 60, checked=6)
case("ratios", "springs and masses graded over 1e12", modes,
     chain(12, springs=10 ** np.linspace(0, 12, 12), masses=10 ** np.linspace(0, -12, 12)), 12)
case("ratios", "soft and light end, 1e24 in ω²", modes,
     chain(12, springs=10 ** np.linspace(0, -12, 12), masses=10 ** np.linspace(0, 12, 12)), 12)
case("ratios", "HCB, every other spring 1e12", basis, chain(12, springs=alternating(12, 1e12), interface=(1, 12)), HCB(4))
case("ratios", "CC, every other spring 1e12", basis, chain(12, springs=alternating(12, 1e12), interface=(1, 12)), CC(4))
case("ratios", "HCB, every other mass 1e12", basis, chain(12, masses=alternating(12, 1e12), interface=(1, 12)), HCB(10),
     whole=True)
case("ratios", "CC, every other mass 1e12", basis, chain(12, masses=alternating(12, 1e12), interface=(1, 12)), CC(4))
for label, mass, spring in (("mm, t, s", 1e-3, 1e-3), ("nm, ng, ns", 1e12, 1e-6), ("1e-30 and 1e30", 1e-30, 1e30),
                               ("1e30 and 1e-30", 1e30, 1e-30)):
    case("units", f"floating lattice, {label}", modes, lambda m=mass, k=spring: in_units(lattice(3, 4), m, k), 5, rigid=3)
case("units", "HCB in mm, t, s", basis, lambda: in_units(fs.chain(12, interface=(1, 12)), 1e-3, 1e-3), HCB(10), whole=True)
case("units", "CC in units of 1e30 and 1e-30", basis, lambda: in_units(fs.chain(12, interface=(1, 12)), 1e30, 1e-30), CC(10),
     whole=True)
for n in (20, 300):
    case("massless", f"every other mass 0, n = {n}", modes,
         lambda n=n: fs.Substructure(sp.diags_array(1.0 - np.arange(n) % 2), fs.chain(n).K), 5, checked=3)
case("massless", "M of half rank, no zero on its diagonal", modes, lambda: fs.Substructure(
    sp.kron(sp.eye_array(10), np.ones((2, 2))), fs.chain(20).K), 10)
case("massless", "more modes than masses", modes,
     lambda: fs.Substructure(sp.kron(sp.eye_array(10), np.ones((2, 2))), fs.chain(20).K), 11)
case("massless", "HCB, massless interface", basis,
     lambda: fs.Substructure(np.diag(1.0 - np.arange(12) % 2), fs.chain(12).K, interface=[1]),
     HCB(3))
case("massless", "CC, massless interface", basis,
     lambda: fs.Substructure(np.diag(1.0 - np.arange(12) % 2), fs.chain(12).K, interface=[1]),
     CC(3))
case("massless", "neither mass nor stiffness", modes,
     lambda: fs.Substructure(sp.diags_array(one(8, 7, 0.0)), held(fs.chain(8).K, 7)), 3,
     expect="1 DOF has neither mass nor stiffness: DOF 7")
for count in (1, 2, 5, 12):
    case("rigid", f"{count} floating chains", modes, lambda c=count: pieces(*[fs.chain(6, fixed=False)] * c), 4, rigid=count)
case("rigid", "4 floating lattices, 12 rigid modes", modes,
     lambda: pieces(*[lattice(3, 4, seed) for seed in range(4)]), 4, rigid=12,
     checked=3)
case("rigid", "mechanism with 12 free shears", modes, lambda: lattice(4, 8, diagonals=False), 3, rigid=12)
case("rigid", "a mass without springs", modes, lambda: fs.Substructure(sp.eye_array(8), held(fs.chain(8).K, 4)), 3, rigid=1)
case("rigid", "one piece held, one floating", modes, lambda: pieces(fs.chain(60, fixed=False), fs.chain(50)), 5, rigid=1)
case("rigid", "two floating pieces, 1e6 in stiffness", modes,
     lambda: pieces(fs.chain(60, fixed=False), fs.chain(50, fixed=False, springs=1e6)), 5, rigid=2)
case("rigid", "two floating pieces, 1e12 in stiffness", modes,
     lambda: pieces(fs.chain(60, fixed=False), fs.chain(50, fixed=False, springs=1e12)), 5, rigid=2)
case("rigid", "no stiffness at all", modes,
     lambda: fs.Substructure(np.eye(8), np.zeros((8, 8))), 0, expect="no DOF has both stiffness and mass")
case("rigid", "a negative spring", modes, lambda: fs.Substructure(np.eye(8), fs.chain(8).K.toarray() - 0.5 * np.eye(8)), 2,
     expect="negative eigenvalue")
case("interface", "HCB, empty", basis, lambda: fs.Substructure(fs.chain(12).M, fs.chain(12).K), HCB(3))
case("interface", "HCB, empty and floating", basis,
     lambda: fs.Substructure(fs.chain(12).M, fs.chain(12, fixed=False).K), HCB(3), rigid=1)
case("interface", "HCB, all DOF", basis, chain(12, interface=range(1, 13)), HCB(0), whole=True)
case("interface", "HCB, all DOF, and modes", basis, chain(12, interface=range(1, 13)), HCB(3), expect="every DOF is interface")
case("interface", "HCB, not restraining", basis, lambda: fs.Substructure(lattice(3, 4).M, lattice(3, 4).K, interface=[0, 1]),
     HCB(3),
     expect="the interface does not hold")
case("interface", "HCB, just restraining", basis, lambda: lattice(3, 4), HCB(3))
case("interface", "HCB, on one of two pieces", basis, lambda: pieces(fs.chain(8), fs.chain(8, fixed=False), interface=(0,)),
     HCB(3),
     expect="the interface does not hold")
case("interface", "CC, empty", basis, lambda: fs.Substructure(fs.chain(12).M, fs.chain(12).K), CC(3))
case("interface", "CC, all DOF", basis, chain(12, interface=range(1, 13)), CC(3), whole=True)
case("interface", "CC, not restraining", basis,
     lambda: fs.Substructure(lattice(3, 4).M, lattice(3, 4).K, interface=[0, 1]), CC(3), rigid=3)
case("interface", "port on a support", answered, lambda: fs.plate(fs.rectangle((1.0, 1.0), (4, 4)), **STEEL, thickness=0.01,
     supports={"edge": "clamped"}, ports={"p": "left"}), expect="sits on DOF that the supports hold")
case("modes 0, 1, all", "no modes", modes, chain(300), 0)
case("modes 0, 1, all", "no modes, floating", modes, chain(300, fixed=False), 0, rigid=1)
case("modes 0, 1, all", "all of 300", modes, chain(300), 300, frequencies=fs.chain_frequencies(300))
case("modes 0, 1, all", "a single mass", modes, chain(1), 1)
for method in (HCB, CC):
    name = "HCB" if method is HCB else "CC"
    case("modes 0, 1, all", f"{name}, no modes", basis, chain(12, interface=(1, 12)), method(0))
    case("modes 0, 1, all", f"{name}, one mode", basis, chain(12, interface=(1, 12)), method(1))
    case("modes 0, 1, all", f"{name}, all modes", basis, chain(12, interface=(1, 12)), method(10), whole=True)
    case("modes 0, 1, all", f"{name}, neither modes nor interface", basis, lambda: fs.Substructure(np.eye(3), fs.chain(3).K),
         method(0),
         expect="would be empty")
case("repeated", "ring of 24, all modes", modes, lambda: ring(24), 23, rigid=1)
case("repeated", "ring of 240, a pair cut", modes, lambda: ring(240), 8, rigid=1, checked=8)
case("repeated", "square plate", modes, lambda: fs.plate(fs.rectangle((1.0, 1.0), (3, 3)), **STEEL, thickness=0.01,
     supports=dict.fromkeys(("left", "right", "front", "back"), "simply supported")), 8, checked=6)
case("repeated", "annulus, floating", modes,
     lambda: fs.solid(fs.annulus(0.1, 0.2, 0.02, (1, 8, 1), "hexahedron"), fs.Material(**STEEL)), 8,
     rigid=6, checked=4, quick=False)
case("repeated", "twins coupled by 1e-8", modes, lambda: coupled_twins(60, 1e-8), 9, checked=6)
case("repeated", "twins coupled by 1e-14", modes, lambda: coupled_twins(60, 1e-14), 9, checked=6)
case("repeated", "300 equal modes", modes, lambda: fs.Substructure(sp.eye_array(300), sp.eye_array(300)), 5)
BAR: dict[str, Any] = {"E": 2.1e11, "I": 1e-16 / 12, "rho": 7850.0, "A": 1e-8}
case("slender", "beam of 1 : 1e-4, 100 elements", modes, lambda: fs.beam(1.0, 100, **BAR, supports={"left": "clamped"}), 6,
     checked=4)
case("slender", "beam of 2,000 elements", modes, lambda: fs.beam(1.0, 2000, **BAR, supports={"left": "pinned",
     "right": "pinned"}), 6,
     checked=2, quick=False)
case("slender", "beam of 6,000 elements", modes, lambda: fs.beam(1.0, 6000, **BAR, supports={"left": "clamped"}), 6, checked=1,
     expect="rounding may take", quick=False)
case("slender", "plate cells of 1 : 1e4", modes, lambda: fs.plate(fs.rectangle((1.0, 1e-4), (2, 2)), **STEEL, thickness=1e-6,
     supports={"left": "clamped"}), 5, checked=4, expect="rounding may take")
case("slender", "plate cells of 1 : 100", modes, lambda: fs.plate(fs.rectangle((1.0, 1e-2), (2, 2)), **STEEL, thickness=1e-4,
     supports={"left": "clamped"}), 5, checked=4)
case("slender", "brick of 1 : 1e-3, 20 nodes", modes, thin("hexahedron20", 1e-3), 3, checked=2, quick=False)
case("slender", "bricks of 1 : 1e-4, 20 nodes", modes, thin("hexahedron20", 1e-4, 8), 3, quick=False,
     expect="elements too thin or too small")
case("slender", "locking: 8 elements of 20 nodes", bending, "hexahedron20", 1e-3)
case("slender", "locking: 8 elements of 8 nodes, as foretold", bending, "hexahedron", 1e-3)
case("large", LARGE, modes, chain(1_000_000), 20, frequencies=fs.chain_frequencies(1_000_000, 20), quick=False)
