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
from benchmarks.extreme.reference import EPS, Array, Found, Sturm, entry_condition, exact, mp

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
