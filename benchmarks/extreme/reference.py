"""What extreme cases are judged by: 60 digits (mpmath), Sturm counts, condition numbers, none of it from femsub."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from mpmath import mp
from scipy.optimize import linear_sum_assignment

from benchmarks.attacks.common import dense, exact_eigenvalues

EPS = float(np.finfo(float).eps)
Array = np.ndarray
mp.dps = 60


def exact(matrix: Any) -> Any:
    """The doubles as they are, in an mpmath matrix."""
    return mp.matrix(dense(matrix).tolist())


class Pivots:
    """The pivots of Σ fᵢAᵢ = LDLᵀ in 60 digits for symmetric sparse Aᵢ; one DOF may be eliminated `last`.

    Without pivoting, in a band-reducing order: 60 digits bear the growth.
    """

    def __init__(self, *parts: Any, last: int | None = None) -> None:
        several = [sp.csr_array(part) for part in parts]
        order = sp.csgraph.reverse_cuthill_mckee(sp.csr_array(sum(abs(part) for part in several)), symmetric_mode=True)
        if last is not None:
            order = np.append(order[order != last], last)
        self.rows: list[dict[int, list[Any]]] = [{} for _ in order]
        for which, part in enumerate(several):
            upper = sp.triu(part[order][:, order]).tocoo()
            for i, j, value in zip(upper.row, upper.col, upper.data, strict=True):
                self.rows[i].setdefault(int(j), [mp.zero] * len(several))[which] += mp.mpf(float(value))

    def __call__(self, *factors: Any) -> list[Any]:
        rows = [{j: mp.fdot(factors, several) for j, several in row.items()} for row in self.rows]
        pivots = []
        for i, row in enumerate(rows):
            pivot = row.pop(i, mp.zero)
            if pivot == 0:
                if not any(row.values()):
                    continue  # a DOF on its own with λ = σ
                pivot = mp.mpf(10) ** -50 * max(abs(value) for value in row.values())
            pivots.append(pivot)
            entries = sorted(row.items())
            for at, (j, value) in enumerate(entries):
                if value:
                    factor, below = value / pivot, rows[j]
                    for k, other in entries[at:]:
                        below[k] = below.get(k, mp.zero) - factor * other
        return pivots


class Sturm(Pivots):
    """How many eigenvalues of Kφ = λMφ lie below σ: the negative pivots of K - σM, M semidefinite."""

    def count(self, sigma: Any) -> int:
        """Eigenvalues below σ."""
        return sum(pivot < 0 for pivot in self(1, -sigma))

    def errors(self, values: Iterable[float], first: int = 1) -> Array:
        """Relative distance of each value (ascending) to the eigenvalue of its number, `first` that of the first one.

        The smallest δ, to a tenth of a decade, for which the counts at λ(1 - δ) and λ(1 + δ) enclose that number; 1 stands
        for all that is further off, and 1e-18 for no difference.
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
    """All finite λ of (λ²M + λD + K)x = 0 in 60 digits: a companion matrix of it, or of its reverse where M is singular,
    that of μ = λ - 1 if K is as well.
    """
    singular = [np.linalg.matrix_rank(dense(part)) < np.shape(M)[0] for part in (M, K)]
    return exact_eigenvalues(exact(M), exact(D), exact(K), int(singular[1]) if singular[0] else None)


def matched(found: Array, reference: list[Any]) -> tuple[Array, Array]:
    """|λ - λ*| of each computed eigenvalue and the number of its partner, as sets by least total distance; NaN and -1
    where it has none.
    """
    there = np.array([complex(value) for value in reference])
    rows, columns = linear_sum_assignment(np.abs(found[:, None] - there))
    distance, partner = np.full(len(found), np.nan), np.full(len(found), -1)
    for i, j in zip(rows, columns, strict=True):
        distance[i], partner[i] = float(abs(mp.mpc(complex(found[i])) - reference[j])), j
    return distance, partner


def border(M: Any, D: Any, K: Any, w: Array, omega: float, sparse: bool = False) -> tuple[Any, float]:
    """c = -1/G in 60 digits where Im G = 0 next to a given ω, G(ω) = iω wᵀ(-ω²M + iωD + K)⁻¹w; and how far c moves,
    relatively, when each entry of M, D, K moves by one eps.

    To first order yᵀδP q + yᵀP'q iδω + iω (wᵀq)² δc = 0 with δω and δc real. Of a `sparse` symmetric model, whose belt is under
    one DOF, 1/wᵀP⁻¹w is the pivot of that DOF when it is eliminated last.
    """
    last = Pivots(M, D, K, last=int(np.argmax(w))) if sparse else None
    mass, damping, stiffness = (None if sparse else exact(part) for part in (M, D, K))
    column = mp.matrix(w.tolist())

    def response(at: Any, way: str = "right") -> Any:
        P = stiffness - at * at * mass + 1j * at * damping
        return mp.lu_solve(P if way == "right" else P.T, column)

    def G(at: Any) -> Any:
        return 1j * at / last(-at * at, 1j * at, 1)[-1] if last else 1j * at * (column.T * response(at))[0]

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
    if sparse:
        q = y = np.linalg.solve(K - at**2 * M + 1j * at * D, w)
    else:  # P is symmetric or not: the left shape from Pᵀ
        q, y = (np.array([complex(value) for value in response(root, way)]) for way in ("right", "left"))
    turn = y @ ((2j * at * M + D) @ q) * 1j
    feed = 1j * at * (w @ q) * (w @ y)
    moved = sum(float((np.abs(part) * np.abs((np.conj(turn) * factor * np.outer(y, q)).imag)).sum())
                for part, factor in zip((M, D, K), (-at * at, 1j * at, 1.0), strict=True))
    return c.real, float(moved / abs((np.conj(turn) * feed).imag) / abs(float(c.real))) * EPS


def entry_condition(K: Any, M: Any, shapes: Array, values: Array) -> Array:
    """eps |φ|ᵀ(|K| + λ|M|)|φ| / λ for ΦᵀMΦ = I: how far λ moves, relatively, when each entry of K and M moves by one eps."""
    size = np.abs(shapes)
    return EPS * np.einsum("ij,ij->j", size, abs(K) @ size + (abs(M) @ size) * values) / values


def energy_conditions(M: Any, D: Any, K: Any) -> tuple[Array, Array]:
    """λ in double precision with the first-order bound of a backward stable method in energy coordinates and of one
    rounding in each entry: 10 m eps ‖A‖₂ / |yᴴx| + 8 eps |y|ᵀ(|λ|²|M| + |λ||D| + |K|)|x| / |yᴴP'(λ)x|, absolute.

    A is the state matrix (Ωq, q̇) of order m.
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


@dataclass(frozen=True)
class Found:
    """What a case measured: the largest error and the bound stated for that value beforehand, both relative, and the rest."""

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
    """Of several: the one that is nearest to its bound, with the lies of all and what was missed in all."""
    several = list(founds)
    said = "; ".join(dict.fromkeys(found.lie for found in several if found.lie))
    missed = [found.missed for found in several if found.missed is not None]
    found = max(several, key=lambda found: found.ratio)
    return replace(found, lie=said, missed=sum(missed) if missed else None, computed=f"{len(several)} x {found.computed}")


def every(run: Callable[..., Found], *arguments: object, asks: Sequence[dict[str, object]], **options: object) -> Found:
    """One case for several bands or counts."""
    return worst(run(*arguments, **options, **ask) for ask in asks)


def answered(run: Callable[[], Any]) -> Found:
    """What is to be refused: wrong if there is an answer."""
    return Found(str(run()).splitlines()[0][:60], 1.0, EPS, np.inf, "it is to be refused", lie="it was answered")


def claim(text: str, lie: str, why: str) -> Found:
    """Something said that is either true or not."""
    return Found(text, 0.0, EPS, 0.0, why, lie=lie)
