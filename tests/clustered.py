"""Random models with repeated and clustered spectra, asked for by count and by bands whose ends are eigenvalues.

Each number seeds one model, dense or sparse, whose spectrum is known: by construction (K = AᵀΛA, M = AᵀA), in closed
form (grids), or by LAPACK's QZ on one of several equal pieces. `evaluate` says what is wrong with the answer.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.optimize import linear_sum_assignment

import femsub as fs

SPREADS = (0.0, 0.0, 1e-13, 1e-11, 1e-8)  # of a cluster, relative
NEAR = 4e-6  # |Δλ| / |λ| up to which an eigenvalue found is the exact one: a double one is known to the root of rounding
ROOM = 4e-6  # beyond an edge, relative, where an eigenvalue may be listed or not


@dataclass(frozen=True)
class Case:
    """A model with its exact spectrum: ω (real, rigid ones as 0) for normal modes, all 2n λ for complex ones."""

    kind: str
    model: Any
    exact: np.ndarray
    ask: dict[str, Any]

    def __str__(self) -> str:
        asked = ", ".join(f"{key}={value}" for key, value in self.ask.items())
        return f"{self.kind}, {self.model.size} DOF, {'sparse' if sp.issparse(self.model.K) else 'dense'}, {asked}"


def clustered(rng: np.random.Generator, n: int) -> np.ndarray:
    """n values from 1 to about 1e3 in clusters of up to eight, one of them perhaps large."""
    values: list[float] = []
    while len(values) < n:
        size = int(rng.choice([1, 1, 2, 2, 3, 6, 8, max(1, n // 3)], p=[.2, .1, .2, .1, .1, .15, .1, .05]))
        centre, spread = 10 ** rng.uniform(0, 3), rng.choice(SPREADS)
        values += list(centre * (1 + spread * rng.uniform(-1, 1, size)))
    return np.array(values[:n])


def mixing(rng: np.random.Generator, n: int, sparse: bool) -> Any:
    """A regular A (n, n): orthogonal but for a diagonal; sparse as two layers of blocks of four."""
    scale = rng.uniform(0.5, 2.0, n)
    if not sparse:
        return la.qr(rng.standard_normal((n, n)))[0] * scale
    A = sp.eye_array(n, format="csr")
    for _ in range(2):
        blocks = [sp.coo_array(la.qr(rng.standard_normal((m, m)))[0]) for m in [4] * (n // 4) + ([n % 4] if n % 4 else [])]
        A = A[rng.permutation(n)] @ sp.csr_array(sp.block_diag(blocks))
    return sp.csr_array(A @ sp.diags_array(scale))


def congruent(A: Any, B: Any) -> Any:
    """AᵀBA, symmetric to the last digit where B is."""
    result = A.T @ (B @ A)
    if abs(B - B.T).max() == 0:
        result = (result + result.T) / 2
    return sp.csr_array(result) if sp.issparse(result) else np.asarray(result)


def diagonal(values: np.ndarray, sparse: bool) -> Any:
    return sp.diags_array(values, format="csr") if sparse else np.diag(values)


def size_of(rng: np.random.Generator, sparse: bool) -> int:
    return int(rng.integers(120, 420)) if sparse else int(rng.integers(6, 90))


# normal modes


def rotated(rng: np.random.Generator, sparse: bool) -> tuple[Any, np.ndarray]:
    n = size_of(rng, sparse)
    values, A = clustered(rng, n), mixing(rng, n, sparse)
    return fs.Substructure(congruent(A, diagonal(np.ones(n), sparse)), congruent(A, diagonal(values, sparse))), np.sqrt(values)


def proportional(rng: np.random.Generator, sparse: bool) -> tuple[Any, np.ndarray]:
    n, c = size_of(rng, sparse), float(10 ** rng.uniform(-2, 3))
    if rng.random() < 0.5:
        M = congruent(mixing(rng, n, sparse), diagonal(rng.uniform(0.5, 2, n), sparse))
    else:
        M = sp.diags_array([np.full(n - 1, 1 / 6), np.full(n, 4 / 6), np.full(n - 1, 1 / 6)], offsets=[-1, 0, 1], format="csr")
        M = M if sparse else M.toarray()
    return fs.Substructure(M, c * M), np.full(n, np.sqrt(c))


def grid(rng: np.random.Generator, sparse: bool) -> tuple[Any, np.ndarray]:
    """A square or cubic grid of springs, held or free at its rim."""
    three = rng.random() < 0.5
    least, most = ((5, 8) if three else (11, 22)) if sparse else ((2, 5) if three else (3, 10))
    m = int(rng.integers(least, most))
    free = rng.random() < 0.4
    main = np.full(m, 2.0)
    if free:
        main[[0, -1]] = 1.0
    line = sp.diags_array([-np.ones(m - 1), main, -np.ones(m - 1)], offsets=[-1, 0, 1])
    one = 4 * np.sin((np.arange(m) if free else np.arange(1, m + 1)) * np.pi / (2 * (m if free else m + 1))) ** 2
    eye, K, values = sp.eye_array(m), line, one
    for _ in range(2 if three else 1):
        K = sp.kron(K, eye) + sp.kron(sp.eye_array(K.shape[0]), line)
        values = (values[:, None] + one).ravel()
    values[np.abs(values) < 1e-12] = 0.0
    K = sp.csr_array(K) if sparse else K.toarray()
    return fs.Substructure(diagonal(np.ones(len(values)), sparse), K), np.sqrt(values)


def pieces(rng: np.random.Generator, sparse: bool) -> tuple[Any, np.ndarray]:
    """Several equal chains that do not know of each other, shuffled; floating or not."""
    copies, n = int(rng.integers(2, 7)), int(rng.integers(60, 90) if sparse else rng.integers(3, 14))
    springs = rng.uniform(0.5, 2, n + 1)
    if rng.random() < 0.3:
        springs[[0, n]] = 0.0
    K1 = np.diag(springs[:n] + springs[1:]) - np.diag(springs[1:n], 1) - np.diag(springs[1:n], -1)
    M1 = np.diag(rng.uniform(0.5, 2, n))
    values = la.eigh(K1, M1, eigvals_only=True)
    if springs[0] == 0:
        values[0] = 0.0
    order = rng.permutation(copies * n)
    K, M = (sp.csr_array(sp.kron(sp.eye_array(copies), sp.csr_array(part)))[order][:, order] for part in (K1, M1))
    if not sparse:
        K, M = K.toarray(), M.toarray()
    return fs.Substructure(M, K), np.sqrt(np.tile(values, copies))


# complex modes


def roots(d: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Both roots of λ² + dλ + k, pair by pair."""
    root = np.sqrt((d * d / 4 - k).astype(complex))
    far = -d / 2 - root
    near = np.where(root.imag != 0, -d / 2 + root, np.divide(k, far, out=np.zeros_like(far), where=far != 0))
    return np.concatenate([far, near])


def modal(rng: np.random.Generator, sparse: bool) -> tuple[Any, np.ndarray]:
    """Modal damping, by clusters; some modes critically damped (a double real eigenvalue) or more."""
    n = size_of(rng, sparse)
    k = clustered(rng, n)
    rough = 10 ** rng.uniform(-4, -1)
    zeta = rough * np.round(rng.uniform(1, 3, n))  # equal ones beside equal frequencies
    some = rng.random(n) < (0.1 if rng.random() < 0.5 else 0.0)
    zeta[some] = rng.choice([1.0, 1.0, 1.25], int(some.sum()))
    k[some & (zeta == 1.0)] = np.round(np.sqrt(k[some & (zeta == 1.0)])) ** 2
    d = 2 * zeta * np.sqrt(k)
    A = mixing(rng, n, sparse)
    return fs.Pencil(*(congruent(A, diagonal(part, sparse)) for part in (np.ones(n), d, k))), roots(d, k)


def rayleigh(rng: np.random.Generator, sparse: bool) -> tuple[Any, np.ndarray]:
    """Proportional damping: all Re λ = -α/2 where β = 0."""
    sub, omega = [rotated, grid, pieces, proportional][int(rng.integers(4))](rng, sparse)
    alpha, beta = float(rng.choice([0.0, 1e-3, 0.02])), float(rng.choice([0.0, 0.0, 1e-4]))
    D = sub.M * alpha + sub.K * beta if alpha or beta else None
    return fs.Pencil(sub.M, D, sub.K), roots(alpha + beta * omega**2, omega**2)


def copied(rng: np.random.Generator, sparse: bool) -> tuple[Any, np.ndarray]:
    """Equal pieces with any damping and with circulatory forces; floating or not."""
    copies, n = int(rng.integers(2, 5)), int(rng.integers(60, 90) if sparse else rng.integers(3, 12))
    springs = rng.uniform(0.5, 2, n + 1)
    floating = rng.random() < 0.3
    if floating:
        springs[[0, n]] = 0.0
    K1 = np.diag(springs[:n] + springs[1:]) - np.diag(springs[1:n], 1) - np.diag(springs[1:n], -1)
    D1 = 0.02 * K1 + np.diag(np.where(rng.random(n) < 0.2, 0.2, 0.0))
    if rng.random() < 0.6:  # forces of a follower, of which a uniform motion feels none
        turn = np.diag(np.full(n - 1, 0.05), 1)
        turn = turn - turn.T
        K1 = K1 + (turn - np.diag(turn.sum(axis=1)) if floating else turn)
    M1 = np.eye(n) if rng.random() < 0.5 else np.diag(rng.uniform(0.5, 2, n))
    zero = np.zeros((n, n))
    one = la.eigvals(np.block([[zero, np.eye(n)], [-K1, -D1]]), la.block_diag(np.eye(n), M1))
    one[np.abs(one) < 1e-5] = 0.0  # of rigid motion; all others are larger
    order = rng.permutation(copies * n)
    parts = [sp.csr_array(sp.kron(sp.eye_array(copies), sp.csr_array(part)))[order][:, order] for part in (M1, D1, K1)]
    return fs.Pencil(*(parts if sparse else [part.toarray() for part in parts])), np.tile(one, copies)


NORMAL: tuple[Callable, ...] = (rotated, proportional, grid, pieces)
COMPLEX: tuple[Callable, ...] = (modal, rayleigh, copied)


def make(number: int) -> Case:
    """The model of this number, and what is asked of it."""
    rng = np.random.default_rng([11, number])
    sparse, normal = bool(rng.random() < 0.6), number % 2 == 0
    build = (NORMAL if normal else COMPLEX)[int(rng.integers(4 if normal else 3))]
    model, exact = build(rng, sparse)
    return Case(build.__name__, model, exact, _asked(rng, exact, normal))


def _asked(rng: np.random.Generator, exact: np.ndarray, normal: bool) -> dict[str, Any]:
    height = np.sort(exact if normal else exact.imag[exact.imag >= 0])
    moving = height[height > 1e-6]
    if normal and rng.random() < 0.5:
        return {"count": int(rng.integers(1, 1 + max(1, min(len(moving), 60))))}
    if not normal and (rng.random() < 0.5 or not len(moving)):
        return {"count": int(rng.integers(2, 1 + min(len(exact), 80)))}
    edges = np.sort(moving[rng.integers(0, max(1, min(len(moving), 100)), 2)])
    lo = 0.0 if rng.random() < 0.3 or edges[0] == edges[1] else edges[0]
    ask: dict[str, Any] = {"band": (float(lo), float(edges[1]))}
    if not normal and rng.random() < 0.3:
        real = exact.real[(exact.imag >= 0) & (exact.imag <= edges[1]) & (np.abs(exact.real) <= edges[1])]
        a, b = np.sort(rng.choice(real, 2)) if len(real) else (-1.0, 1.0)
        ask["re"] = (float(a), float(b) if b > a else float(a) + 0.5 * float(edges[1]))
    return ask


def evaluate(case: Case) -> str:
    """'' where all is well, else what is wrong ('wrong: …') or that it was refused ('refused: …')."""
    normal = not np.iscomplexobj(case.exact)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.FemsubWarning)
        try:
            found = fs.normal_modes(case.model, **case.ask) if normal else fs.complex_modes(case.model, **case.ask)
        except ValueError as error:
            return f"wrong: {type(error).__name__}: {error}" if not isinstance(error, fs.InputError) else f"refused: {error}"
        except fs.FemsubError as error:
            return f"refused: {type(error).__name__}: {error}"
    values = found.frequencies if normal else found.eigenvalues
    return _by_count(case, values) if "count" in case.ask else _by_band(case, values)


def _by_count(case: Case, values: np.ndarray) -> str:
    normal = not np.iscomplexobj(case.exact)
    size, listed = np.sort(np.abs(case.exact)), np.sort(np.abs(values))
    count = case.ask["count"] + (int(np.count_nonzero(size == 0)) if normal else 0)
    if not count <= len(values) <= count + (0 if normal else 1):
        return f"wrong: {len(values)} listed, not {count}"
    expected = size[:len(values)]
    off = np.abs(listed - expected) > NEAR * expected + 1e-7 * size[size > 0].min()
    if off.any():
        return f"wrong: number {int(np.argmax(off)) + 1} of {len(values)} is {listed[off][0]:.8g}, not {expected[off][0]:.8g}"
    return _matched(case.exact, values)


def _by_band(case: Case, values: np.ndarray) -> str:
    band, exact = case.ask["band"], case.exact
    height = exact if not np.iscomplexobj(exact) else exact.imag
    beyond = np.maximum(band[0] - height, height - band[1])
    if np.iscomplexobj(exact):
        a, b = case.ask.get("re", (-band[1], band[1]))
        beyond = np.maximum(beyond, np.maximum(a - exact.real, exact.real - b))
    size = np.abs(exact)
    must, may = exact[beyond <= 1e-12 * size], exact[beyond <= ROOM * size]
    return _matched(may, values) or _matched(values, must)


def _matched(into: np.ndarray, values: np.ndarray) -> str:
    """Whether each of the values has a counterpart of its own."""
    if not len(values):
        return ""
    scale = max(float(np.abs(into).max(initial=0.0)), float(np.abs(values).max()))
    if len(into) < len(values):
        return f"wrong: {len(values)} where there are {len(into)}"
    distance = np.abs(values[:, None] - into)
    near = distance <= NEAR * np.abs(values)[:, None] + 1e-8 * scale
    at, to = linear_sum_assignment(~near)
    lost = values[at][~near[at, to]]
    return f"wrong: {len(lost)} without counterpart, the first {lost[0]:.9g}" if len(lost) else ""
