"""Judges of extreme cases: Sturm counts and eigenvalues in 60 digits (mpmath), closed forms, and bounds from condition numbers.

These references do not use femsub. Each judge calls femsub once for a model, and returns a `Found`. A model is given alone, or in
a pair with its known spectrum.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from mpmath import mp
from scipy.optimize import linear_sum_assignment

import femsub as fs
from benchmarks.attacks.common import dense, exact_eigenvalues
from femsub.checks import EPS, Array

mp.dps = 60
ASKED = 1e-12  # of Krylov-Schur by femsub, relative to the shifted and inverted eigenvalue
DEPENDENT = 1e-13  # share of its energy below which Craig-Chang drops a column
TALLEST = 1e6  # entry of V of a model of unit masses and springs; it was 1e42
LAPACK = "n eps min(λ/λ₁, λ_n/λ), of LAPACK"


@dataclass(frozen=True)
class Found:
    """The measurements of a case: the largest error and the bound stated for this value beforehand, both relative, and others."""

    computed: str
    error: float
    bound: float
    ratio: float  #: the largest error over its own bound, of all values
    why: str  #: where the bound comes from
    backward: float | None = None
    orthogonality: float | None = None
    condition: float | None = None
    missed: int | None = None
    lie: str = ""  #: a claim of femsub's that is not true


def worst(founds: Iterable[Found]) -> Found:
    """The result nearest to its bound among several, with the false claims and the missed values of all."""
    several = list(founds)
    said = "; ".join(dict.fromkeys(found.lie for found in several if found.lie))
    missed = [found.missed for found in several if found.missed is not None]
    found = max(several, key=lambda found: found.ratio)
    return replace(found, lie=said, missed=sum(missed) if missed else None, computed=f"{len(several)} x {found.computed}")


def every(run: Callable[..., Found], *arguments: object, asks: Sequence[dict[str, object]], **options: object) -> Found:
    """One case for several models, bands or counts."""
    return worst(run(*arguments, **options, **ask) for ask in asks)


def figures(errors: Array, bounds: Array) -> tuple[float, float, float]:
    """The largest error, the bound of that value, and the largest error over its own bound."""
    if not len(errors):
        return 0.0, EPS, 0.0
    at = int(np.argmax(errors))
    return float(errors[at]), float(bounds[at]), float((errors / bounds).max())


# ---- references


def exact(matrix: Any) -> Any:
    """The double-precision entries as they are, in an mpmath matrix."""
    return mp.matrix(dense(matrix).tolist())


class Sturm:
    """How many eigenvalues of Kφ = λMφ lie below σ, M semidefinite: the negative pivots of K - σM = LDLᵀ in 60 digits.

    Without pivoting, in a band-reducing order: 60 digits bear the growth.
    """

    def __init__(self, K: Any, M: Any) -> None:
        parts = [sp.csr_array(part) for part in (K, M)]
        order = sp.csgraph.reverse_cuthill_mckee(sp.csr_array(abs(parts[0]) + abs(parts[1])), symmetric_mode=True)
        self.rows: list[dict[int, list[Any]]] = [{} for _ in order]
        for which, part in enumerate(parts):
            upper = sp.triu(part[order][:, order]).tocoo()
            for i, j, value in zip(upper.row, upper.col, upper.data, strict=True):
                self.rows[i].setdefault(int(j), [mp.zero, mp.zero])[which] += mp.mpf(float(value))

    def count(self, sigma: Any) -> int:
        """Eigenvalues below σ."""
        rows = [{j: k - sigma * m for j, (k, m) in row.items()} for row in self.rows]
        negative = 0
        for i, row in enumerate(rows):
            pivot = row.pop(i, mp.zero)
            if pivot == 0:
                if not any(row.values()):
                    continue  # a DOF on its own with λ = σ
                pivot = mp.mpf(10) ** -50 * max(abs(value) for value in row.values())
            negative += pivot < 0
            entries = sorted(row.items())
            for at, (j, value) in enumerate(entries):
                if value:
                    factor, below = value / pivot, rows[j]
                    for k, other in entries[at:]:
                        below[k] = below.get(k, mp.zero) - factor * other
        return negative

    def errors(self, values: Iterable[float], first: int = 1) -> Array:
        """The relative distance of each value (ascending) to the eigenvalue of its number; `first` is the first value's number.

        It is the smallest δ, to a tenth of a decade, for which the counts at λ(1 - δ) and λ(1 + δ) enclose the number. Larger
        distances become 1, and no difference becomes 1e-18.
        """
        def encloses(value: float, number: int, power: float) -> bool:
            delta = mp.mpf(10) ** power
            return self.count(value * (1 - delta)) < number <= self.count(value * (1 + delta))

        result = []
        for number, value in enumerate(values, first):
            low, high = -18.0, 0.0
            while high - low > 0.1:
                middle = (low + high) / 2
                low, high = (low, middle) if encloses(float(value), number, middle) else (middle, high)
            result.append(10**high)
        return np.array(result)


def quadratic(M: Any, D: Any, K: Any) -> list[Any]:
    """All finite λ of (λ²M + λD + K)x = 0 in 60 digits, from a companion matrix.

    If M is singular, the companion matrix of the reversed problem is used; if K is singular too, for μ = λ - 1.
    """
    singular = [np.linalg.matrix_rank(dense(part)) < np.shape(M)[0] for part in (M, K)]
    return exact_eigenvalues(exact(M), exact(D), exact(K), int(singular[1]) if singular[0] else None)


def matched(found: Array, reference: list[Any]) -> tuple[Array, Array]:
    """|λ - λ*| for each computed eigenvalue, and the number of its partner; NaN and -1 without a partner.

    Eigenvalues are compared as sets, by the least total distance.
    """
    there = np.array([complex(value) for value in reference])
    rows, columns = linear_sum_assignment(np.abs(found[:, None] - there))
    distance, partner = np.full(len(found), np.nan), np.full(len(found), -1)
    for i, j in zip(rows, columns, strict=True):
        distance[i], partner[i] = float(abs(mp.mpc(complex(found[i])) - reference[j])), j
    return distance, partner


def border(M: Any, D: Any, K: Any, w: Array, omega: float) -> tuple[Any, float]:
    """c = -1/G in 60 digits at the root of Im G next to a given ω, G(ω) = iω wᵀ(-ω²M + iωD + K)⁻¹w, and its condition.

    The condition is the relative change of c if each entry of M, D, K changes by a relative eps. To first order
    yᵀδP q + yᵀP'q iδω + iω (wᵀq)² δc = 0 with δω and δc real.
    """
    (mass, damping, stiffness), column = (exact(part) for part in (M, D, K)), mp.matrix(w.tolist())

    def response(at: Any, left: bool = False) -> Any:
        P = stiffness - at * at * mass + 1j * at * damping
        return mp.lu_solve(P.T if left else P, column)

    def G(at: Any) -> Any:
        return 1j * at * (column.T * response(at))[0]

    # the root of Im G by secants: a resonance may be no wider than the spacing of doubles
    before, root = mp.mpf(omega), mp.mpf(omega) * (1 + mp.mpf(10) ** -22)
    there, here = G(before).imag, G(root).imag
    for _ in range(60):
        if here == there or abs(root - before) < mp.mpf(10) ** -45 * root:
            break
        before, root, there = root, root - here * (root - before) / (here - there), here
        here = G(root).imag
    c = -1 / G(root)
    if abs(c.imag) > mp.mpf(10) ** -20 * abs(c.real):
        raise ArithmeticError(f"no crossing next to ω = {omega}")
    M, D, K, at = dense(M), dense(D), dense(K), float(root)
    q, y = (np.array([complex(value) for value in response(root, left)]) for left in (False, True))
    turn = y @ ((2j * at * M + D) @ q) * 1j
    feed = 1j * at * (w @ q) * (w @ y)
    moved = sum(float((np.abs(part) * np.abs((np.conj(turn) * factor * np.outer(y, q)).imag)).sum())
                for part, factor in zip((M, D, K), (-at * at, 1j * at, 1.0), strict=True))
    return c.real, float(moved / abs((np.conj(turn) * feed).imag) / abs(float(c.real))) * EPS


def roots(damping: Any, stiffness: Any) -> Array:
    """The roots of λ² + dλ + k = 0 for all pairs of coefficients, without cancellation."""
    d, k = (np.atleast_1d(np.asarray(part, dtype=complex)) for part in np.broadcast_arrays(damping, stiffness))
    root = np.sqrt(d * d / 4 - k)
    large = -d / 2 - np.where((d.conj() * root).real >= 0, root, -root)
    return np.concatenate([large, np.divide(k, large, out=np.zeros_like(large), where=large != 0)])


# ---- bounds


def entry_condition(K: Any, M: Any, shapes: Array, values: Array) -> Array:
    """eps |φ|ᵀ(|K| + λ|M|)|φ| / λ, ΦᵀMΦ = I: the relative change of λ if each entry of K and M changes by a relative eps."""
    size = np.abs(shapes)
    return EPS * np.einsum("ij,ij->j", size, abs(K) @ size + (abs(M) @ size) * values) / values


def spread(values: Array, K: Any, M: Any, n: int) -> Array:
    """The possible relative error by LAPACK, which works from both ends of the spectrum: n eps min(λ/λ₁, λ_n/λ)."""
    top = float(np.max(np.divide(K.diagonal(), M.diagonal(), out=np.zeros(K.shape[0]), where=M.diagonal() > 0)))
    return n * EPS * np.minimum(values / values[0], np.maximum(2 * top / values, 1.0))


def energy_conditions(M: Any, D: Any, K: Any) -> tuple[Array, Array]:
    """λ in double precision, and a first-order bound of its absolute error.

    10 m eps ‖A‖₂ / |yᴴx| + 8 eps |y|ᵀ(|λ|²|M| + |λ||D| + |K|)|x| / |yᴴP'(λ)x|, for a backward stable method in energy coordinates
    and one rounding in each entry. A is the state matrix (Ωq, q̇) of order m.
    """
    M, D, K = dense(M), dense(D), dense(K)
    upper = la.cholesky(M)
    inverse = la.solve_triangular(upper, np.eye(len(M)))
    stiffness = inverse.T @ K @ inverse
    values, turn = la.eigh((stiffness + stiffness.T) / 2)
    omega = np.sqrt(np.maximum(np.abs(values), 1e-20 * np.abs(values).max()))
    shapes, n = inverse @ turn, len(M)
    A = np.block([[np.zeros_like(K), np.diag(omega)], [-(turn.T @ stiffness @ turn) / omega, -(shapes.T @ D @ shapes)]])
    found, left, right = la.eig(A, left=True, right=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        sensitivity = 1 / np.abs(np.einsum("ij,ij->j", left.conj(), right))
        x, y, size = np.abs(shapes @ right[n:]), np.abs(shapes @ left[n:]), np.abs(found)
        momentum = (M @ (shapes @ right[n:])) * 2 * found + D @ (shapes @ right[n:])
        slope = np.einsum("ij,ij->j", (shapes @ left[n:]).conj(), momentum)
        entries = np.einsum("ij,ij->j", y, (abs(M) @ x) * size**2 + (abs(D) @ x) * size + abs(K) @ x) / np.abs(slope)
    return found, 10 * len(A) * EPS * np.linalg.norm(A, 2) * sensitivity + 8 * EPS * np.nan_to_num(entries, nan=0.0)


# ---- normal modes and bases


def modes(build: Callable[[], Any], rigid: int = 0, checked: int | None = None, **ask: Any) -> Found:
    """Normal modes by a count or a band, compared as sets with all known ω: all modes asked for, also on edges, and no others.

    Without known ω, the first `checked` elastic modes are compared with Sturm counts in 60 digits, with `rigid` rigid-body modes.
    femsub's own count must be the number of frequencies below its limit.
    """
    made = build()
    sub, omega = made if isinstance(made, tuple) else (made, None)
    found = fs.normal_modes(sub, **ask)
    count, shapes = ask.get("count", 0), found.shapes
    large = sp.issparse(sub.K) and sub.size > 100 and count <= 0.3 * sub.size
    if omega is None:
        elastic = np.arange(found.rigid, found.rigid + (count if checked is None else checked))
        squares, sturm = found.eigenvalues[elastic], Sturm(sub.K, sub.M)
        lie = f"{found.rigid} rigid-body modes, but there are {rigid}" if found.rigid != rigid else ""
        errors = sturm.errors(squares, found.rigid + 1)
        last = float(found.eigenvalues[-1]) * (1 - 1e-9) if count else 0.0
        missed = sturm.count(last) - int(np.count_nonzero(found.eigenvalues < last)) if count else 0
    else:
        omega = np.sort(omega)
        near = 1e-9 * omega[-1]
        lo, hi = ask.get("band", (0.0, np.inf))
        wanted = omega[(omega >= lo * (1 - 1e-12)) & (omega <= hi * (1 + 1e-12))]
        if "count" in ask:  # rigid-body modes come on top
            wanted = wanted[:int(np.count_nonzero(omega < near)) + count]
        limit, number = found.counted or (0.0, 0)
        lie = f"{number} counted below {limit:.6g}, where {np.count_nonzero(omega < limit)} are" * (
            int(np.count_nonzero(omega < limit)) != number)
        extra, common = len(found.eigenvalues) - len(wanted), min(len(found.eigenvalues), len(wanted))
        elastic = np.flatnonzero(wanted[:common] > near)
        squares, missed = wanted[elastic] ** 2, max(0, -extra)
        errors, lie = np.abs(found.eigenvalues[elastic] / squares - 1), lie or (f"{extra} too many" if extra > 0 else "")
    bounds, why = np.zeros(0), "no elastic mode was asked for"
    if len(squares):
        bounds = 8 * entry_condition(sub.K, sub.M, shapes[:, elastic], squares) + (
            ASKED if large else spread(squares, sub.K, sub.M, sub.size))
        why = f"8 roundings per entry + {'1e-12, asked of Krylov-Schur' if large else LAPACK}"
    gram = shapes.T @ (sub.M @ shapes)
    return Found(f"{len(found.eigenvalues)} modes, {found.rigid} rigid", *figures(errors, bounds), why,
                 float(found.residual.max(initial=0.0)), float(np.abs(gram - np.eye(len(gram))).max(initial=0.0)),
                 float(np.linalg.cond(gram)) if len(gram) else 1.0, missed, lie)


def basis(build: Callable[[], fs.Substructure], method: Any, rigid: int = 0, ports: bool = False, whole: bool = False,
          floating: int | None = None) -> Found:
    """A reduced model: kept modes by Sturm counts, and statics at the interface by solves in 60 digits.

    With `whole`, no mode is left out: then the spectrum must be that of the full model, which has `floating` rigid-body modes
    (default: `rigid`).
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
    why = f"8 roundings per entry + {LAPACK}"
    if len(sub.interface) and (hcb or not rigid):
        static, limit = statics(sub, rom, hcb)
        errors, bounds, why = np.append(errors, static), np.append(bounds, limit), why + ", also for statics"
    massive = np.flatnonzero(np.diag(rom.M) > 0)
    unit = rom.M[massive, massive] ** -0.5
    weights = np.linalg.svd(rom.M[np.ix_(massive, massive)] * np.outer(unit, unit), compute_uv=False)
    cond = float(weights[0] / weights[weights > 1e-13 * weights[0]][-1])  # of a singular M, that of its range
    if whole:
        sturm = Sturm(sub.K, sub.M)
        there = sturm.count(mp.mpf(10) ** 15 * float(abs(sub.K).max() / abs(sub.M).max()))  # as many as M has ranks
        full = fs.normal_modes(rom, count=there - (rigid if floating is None else floating))
        squares, rounding = full.eigenvalues[full.rigid:], full.rounding[full.rigid:]
        errors = np.append(errors, sturm.errors(squares, full.rigid + 1))
        joined = 8 * (entry_condition(sub.K, sub.M, rom.V @ full.shapes[:, full.rigid:], squares) + rounding)
        bounds = np.append(bounds, joined + sub.size * EPS * cond + spread(squares, sub.K, sub.M, sub.size))
        why += ", n eps cond(VᵀMV)"
    own = rom.V[inner][:, (at if hcb else massive)]
    residual = np.linalg.norm(K @ shapes - (M @ shapes) * values, axis=0) / np.maximum(
        np.linalg.norm(abs(K) @ abs(shapes) + (abs(M) @ abs(shapes)) * values, axis=0), 1e-300) if len(at) else np.zeros(1)
    return Found(f"{'HCB' if hcb else 'CC'}, {len(at)} modes, {rom.size} of {sub.size} DOF", *figures(errors, bounds), why,
                 float(residual.max()), float(np.abs(own.T @ (M @ own) - np.eye(own.shape[1])).max(initial=0.0)), cond, 0, lie)


def statics(sub: fs.Substructure, rom: fs.ReducedSubstructure, hcb: bool) -> tuple[float, float]:
    """The error of the statics at the interface, and its bound, relative to the largest entry.

    For HCB the statics are K_bb - K_bi K_ii⁻¹ K_ib with the bound 8 eps |Ψ|ᵀ|K||Ψ|; if they are 0, relative to the largest entry
    of K_bb. For CC they are FᵀK⁻¹F with the bound 8 eps |u|ᵀ|K||u| plus the energy of dropped columns.
    """
    b, K = [int(dof) for dof in sub.interface], exact(sub.K)
    if hcb:
        i, found = [int(dof) for dof in sub.interior], rom.K[:len(b), :len(b)]
        loads = [mp.matrix([K[r, c] for r in i]) for c in b]
        held = mp.matrix([[K[r, c] for c in i] for r in i])
        moved = [mp.lu_solve(held, load) if i else load for load in loads]
        there = [[K[b[r], b[c]] - (mp.fdot(loads[r], moved[c]) if i else 0) for c in range(len(b))] for r in range(len(b))]
        psi, bare = np.abs(rom.V[:, :len(b)]), float(max(abs(K[dof, dof]) for dof in b))
    else:
        answer = [mp.lu_solve(K, mp.matrix([mp.mpf(int(row == dof)) for row in range(sub.size)])) for dof in b]
        there = [[answer[c][b[r]] for c in range(len(b))] for r in range(len(b))]
        found, bare = rom.V[b] @ np.linalg.solve(rom.K, rom.V[b].T), 0.0
        psi = np.abs(np.array([[float(value) for value in column] for column in answer]).T)
    size = float(max(abs(value) for row in there for value in row))
    size = size if size > 1e-14 * bare else bare
    error = max(abs(there[r][c] - mp.mpf(float(found[r, c]))) for r in range(len(b)) for c in range(len(b)))
    rounding = 8 * EPS * float((psi.T @ (abs(sub.K) @ psi)).max()) / size
    return float(error) / size, rounding if hcb else rounding + rom.dropped * DEPENDENT


def nearly_complete(build: Callable[[], fs.Substructure], kind: type, rigid: int = 0) -> Found:
    """Reduced models with all modes, one less, and two less, with and without ports: kept modes and statics.

    With all modes, the spectrum of the full model is compared as well.
    """
    sub, founds = build(), []
    hcb = kind is fs.CraigBampton
    moving = dense(sub.M)[np.ix_(sub.interior, sub.interior)] if hcb else dense(sub.M)
    most = int(np.linalg.matrix_rank(moving)) - (0 if hcb else rigid)
    for left in range(min(3, most + 1)):
        for ports in (False, True):
            found = basis(lambda: sub, kind(most - left), 0 if hcb else rigid, ports, left == 0, rigid)
            tall = float(np.abs(fs.reduce(sub, kind(most - left), ports=ports).V).max())
            unit = max(1.0, float(dense(sub.M).max()) ** -0.5, float(np.abs(dense(sub.K)).max()) ** -0.5)
            founds.append(replace(found, lie=found.lie or f"an entry of V of {tall:.0e}" * (tall > TALLEST * unit)))
    return worst(founds)


# ---- complex modes and borders


def cea(build: Callable[[], Any], power: int = 1, belt: fs.Belt | None = None, regular: bool = True, semisimple: bool = False,
        **ask: Any) -> Found:
    """Complex modes against a companion matrix in 60 digits, or against all known λ.

    An error must lie within femsub's own error bar, and for a dense pencil (with `regular` M) within the bound of a backward
    stable method; at a defective eigenvalue of the order `power` within (10 m eps)^(1/power) ‖A‖ instead. Sets are compared one
    to one: an eigenvalue listed twice is wrong, and all eigenvalues in the band or on its edges must be listed. If equal
    eigenvalues are `semisimple`, no shape may be a combination of the others.
    """
    made = build()
    closed = isinstance(made, tuple)
    model, known = made if closed else (made, None)
    pencil = model if isinstance(model, fs.Pencil) else model.linearised(belt)
    reference = quadratic(pencil.M, pencil.D, pencil.K) if known is None else [mp.mpc(complex(value)) for value in known]
    found = fs.complex_modes(model, belt, **ask)
    distance, partner = matched(found.eigenvalues, reference)
    lie, real = "", partner >= 0
    if not real.all():
        lie = f"{np.count_nonzero(~real)} eigenvalues that do not exist, such as {found.eigenvalues[~real][0]:.3g}"
    values, bar, distance, partner = found.eigenvalues[real], found.error_bar[real], distance[real], partner[real]
    there = np.array([complex(value) for value in reference])
    size, top = np.abs(there[partner]), float(np.abs(there).max())
    bound, why = 1.05 * bar + 4 * (EPS * size + 1e-40 * top), "femsub's error bar"  # closed forms are rounded, too
    defective = (20 * pencil.size * EPS) ** (1 / power) * max(top, 1e-300)
    if closed and power > 1:
        bound, why = np.minimum(bound, defective), f"error bar, and (10 m eps)^(1/{power}) ‖A‖"
    elif regular and not closed:
        near, first = energy_conditions(pencil.M, pencil.D, pencil.K)
        stable = first[np.abs(near[:, None] - there[partner]).argmin(axis=0)]
        bound, why = (np.minimum(bound, stable), "error bar, and 10 m eps ‖A‖ cond + 8 roundings per entry") if power == 1 else (
            np.minimum(stable, defective), f"(10 m eps)^(1/{power}) ‖A‖, {power}-fold defective")
    scale, zero = np.where(size > 0, size, 1.0), (size == 0) & (distance == 0)
    growing = max((float(mp.re(value)) for value in reference), default=-np.inf)
    if not ask and found.is_stable is not None and found.is_stable is not (growing <= 0):
        lie = lie or f"is_stable is {found.is_stable}, but the largest Re λ is {growing:.2e}"
    missed = len(reference) - len(values)
    if "band" in ask:
        lo, hi = ask["band"]
        a, b = ask.get("re") or (-hi, hi)
        beyond = np.max([lo - there.imag, there.imag - hi, a - there.real, there.real - b], axis=0) / np.maximum(
            np.abs(there), 1e-2 * hi)
        listed = np.isin(np.arange(len(there)), partner)
        missed, outside = np.count_nonzero((beyond <= 1e-12) & ~listed), np.count_nonzero((beyond > 4e-6) & listed)
        lie = lie or f"{outside} listed from outside of the band" * bool(outside)
    elif ask:
        reach = np.abs(values).max() * (1 - 1e-6)
        missed = max(0, np.count_nonzero(np.abs(there) < reach) - np.count_nonzero(np.abs(values) < reach))
        if len(values) < min(ask["count"], len(reference)):
            lie = lie or f"{ask['count']} were asked for, {len(values)} came"
    shapes = found.shapes[:, real] / np.linalg.norm(found.shapes[:, real], axis=0)
    if semisimple:
        groups = [np.flatnonzero(np.abs(values - value) <= 1e-9 * abs(value)) for value in values if value]
        least = min((np.linalg.svd(shapes[:, group], compute_uv=False)[-1] for group in groups), default=1.0)
        lie = lie or ("equal eigenvalues with dependent shapes" if least < 1e-6 else "")
    return Found(f"{len(values)} complex eigenvalues, stable: {found.is_stable}",
                 *figures((distance / scale)[~zero], (bound / scale)[~zero]), why,
                 float(found.backward_error[real].max(initial=0.0)), None,
                 float(np.linalg.cond(shapes[:, values.imag > 0])) if (values.imag > 0).any() else None, int(missed), lie)


def slope(build: Callable[[], fs.Substructure], known: float | None = None, within: float = EPS, at: float | None = None,
          **options: Any) -> Found:
    """The critical slope against the root of Im G in 60 digits; at 0.999 of it no mode may be unstable.

    A known slope is compared `within` a relative error instead, `at` a known frequency.
    """
    sub = build()
    found = fs.critical_slope(sub, **options)
    told = f"critical slope {found.value:.6g}"
    if known is not None:
        error = abs(found.value - known) / abs(known or 1.0)
        lie = f"it is {known:.6g}" if error > within else f"it is at ω = {at:g}" if at is not None and found.omega != at else ""
        return Found(told, error, within, error / within, "known beforehand, or 8 roundings of D", lie=lie)
    w = sub.port(options.get("port", "belt"))
    if found.value == 0.0 or not np.isfinite(found.value):
        return Found(told, 1.0, EPS, np.inf, "it is neither 0 nor infinite")
    true, moved = border(sub.M, sub.D, sub.K, w, found.omega)
    spectrum = quadratic(sub.M, dense(sub.D) + 0.999 * found.value * np.outer(w, w), sub.K)
    size = max(abs(value) for value in spectrum)
    lo, hi = found.band[0] - mp.mpf(10) ** -30 * size, found.band[1]  # of a real λ Im λ is rounding
    growing = int(sum(lo <= value.imag <= hi and value.real > mp.mpf(10) ** -45 * size for value in spectrum))
    # n eps ω |y|ᵀ|C||q| / |h| of the heaviest motion: C = ΦᵀDΦ is what the border is sought with
    values, shapes = la.eigh(dense(sub.K), dense(sub.M))
    C, load = shapes.T @ dense(sub.D) @ shapes, shapes.T @ w
    q = np.linalg.solve(np.diag(values - found.omega**2 + 0j) + 1j * found.omega * C, load)
    bound = 10 * moved + float(len(w) * EPS * found.omega * np.abs(q) @ np.abs(C) @ np.abs(q) / np.abs(load @ q))
    error = float(abs(true - mp.mpf(found.value)) / abs(true))
    return Found(told, error, bound, error / bound, "10 roundings per entry + those of ΦᵀDΦ", missed=growing)


def on_an_edge(build: Callable[[], fs.Substructure], **options: Any) -> Found:
    """The critical slope of a chain, searched in bands that end or begin at its frequency."""
    omega = fs.critical_slope(build()).omega
    return worst(slope(build, band=edge, **options) for edge in ((omega, 3 * omega), (0.3 * omega, omega)))
