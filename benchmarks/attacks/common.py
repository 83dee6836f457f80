"""Common parts of attacks: cases with their own random generator and seed, small models, and independently computed spectra."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import wraps
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp
from mpmath import mp
from scipy.optimize import linear_sum_assignment

import femsub as fs
from femsub.checks import Array

Random = np.random.Generator


#: the subjects of attacks by name: the kinds of cases, and a function of a kind and a seed
SUBJECTS: dict[str, tuple[Sequence[str], Callable[[str, int], str]]] = {}


def attack(subject: str, kinds: Sequence[str], seed_first: bool = False, silent: bool = True) -> Callable[
        [Callable[[str, Random], str]], Callable[[str, int], str]]:
    """Adds a function of a kind and a generator to SUBJECTS, as a function of a kind and a seed. Its texts contain the seed.

    The generator is seeded with the place of the kind and the seed, in this order or, with `seed_first`, in reverse order.
    """
    def made(case: Callable[[str, Random], str]) -> Callable[[str, int], str]:
        @wraps(case)
        def attacked(kind: str, seed: int) -> str:
            place = tuple(kinds).index(kind)
            with warnings.catch_warnings():
                if silent:
                    warnings.simplefilter("ignore")
                found = case(kind, np.random.default_rng([seed, place] if seed_first else [place, seed]))
            word, colon, text = found.partition(":")
            return f"{word}: seed {seed}{colon}{text}" if colon else f"{word}, seed {seed}" if word == "wrong" else word

        SUBJECTS[subject] = kinds, attacked
        return attacked

    return made


def heard(call: Callable[..., Any], *args: Any, **options: Any) -> tuple[Any, fs.FemsubError | None, list[Warning]]:
    """The result of a call (None if it was refused), the error that refused it, and the warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            found, error = call(*args, **options), None
        except fs.FemsubError as refusal:
            found, error = None, refusal
    return found, error, [one.message for one in caught if isinstance(one.message, Warning)]


def dense(A: Any) -> Array:
    return np.array(A.toarray() if sp.issparse(A) else A, dtype=float)


def positive(rng: Random, n: int, least: float) -> Array:
    """A random positive definite matrix with eigenvalues of at least `least`."""
    A = rng.standard_normal((n, n))
    return np.asarray(A @ A.T / n + least * np.eye(n))


def stiffness(n: int, pairs: Any, springs: Any) -> Array:
    """K (n, n) of springs between pairs of DOF; -1 is the ground."""
    K, (i, j) = np.zeros((n + 1, n + 1)), np.asarray(pairs).T
    for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
        np.add.at(K, (a, b), sign * np.asarray(springs))
    return K[:n, :n]


def grid_pairs(place: Array) -> Array:
    """The neighbours (k, 2) in a grid of numbers, along both axes."""
    return np.vstack([np.stack([one.ravel(), other.ravel()], axis=1) for one, other in (
        (place[:-1], place[1:]), (place[:, :-1], place[:, 1:]))])


def row_of_springs(springs: Array) -> Array:
    """K of a row of masses: springs[i] is before mass i, and a last spring is behind the last mass."""
    n = len(springs) - 1
    return stiffness(n, [(i - 1, i if i < n else -1) for i in range(n + 1)], springs)


def null_space(B: Array, basis: Array, rank: float) -> Array:
    """The motions x of a basis with B x = 0. Singular values up to `rank` count as 0."""
    if not len(B) or not basis.shape[1]:
        return basis
    values, V = np.linalg.svd(B @ basis)[1:]
    return np.asarray(basis @ V[int(np.count_nonzero(values > rank)):].T)


def eigenvalues(M: Array, D: Array, K: Array) -> Array:
    """All λ of (λ²M + λD + K)x = 0 by LAPACK, with a regular M."""
    n = len(M)
    return np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]]))


def exact_eigenvalues(M: mp.matrix, D: mp.matrix, K: mp.matrix, shift: Any = None) -> list[mp.mpc]:
    """All λ in mpmath's working precision. With a `shift`, all finite λ, also for a singular M, by 1/(λ - shift)."""
    if shift is not None:
        found = exact_eigenvalues(K + shift * D + shift * shift * M, D + 2 * shift * M, M)
        least = max(abs(value) for value in found) * mp.mpf(10) ** -20
        return [shift + 1 / value for value in found if abs(value) > least]
    n, lead = M.rows, M ** -1
    low, middle, companion = -(lead * K), -(lead * D), mp.zeros(2 * M.rows)
    for i in range(n):
        companion[i, n + i] = 1
        for j in range(n):
            companion[n + i, j], companion[n + i, n + j] = low[i, j], middle[i, j]
    return list(mp.eig(companion, left=False, right=False))


def crossed(spectrum: Callable[[float], Array], grid: Array, shortest: float) -> list[tuple[float, float]]:
    """(p, ω) at which λ cross the axis, by bisection between grid values with different numbers of growing λ."""
    def grown(p: float) -> int:
        return int((spectrum(p).real > 0).sum())

    exact: list[tuple[float, float]] = []
    counts = [grown(float(p)) for p in grid]
    waiting = [(float(a), float(b), *pair) for (a, b), pair in zip(pairwise(grid), pairwise(counts), strict=True)]
    while waiting:
        a, b, before, after = waiting.pop()
        m = (a + b) / 2
        if before != after and b - a < shortest:
            z = spectrum(b if after > before else a)
            z = z[(z.imag >= 0) & (z.real > 0)]  # λ near the crossing, not lightly damped ones
            exact += [(m, float(value.imag)) for value in z[np.argsort(z.real)[:max(1, abs(after - before) // 2)]]]
        elif before != after:
            waiting += [(a, m, before, middle := grown(m)), (m, b, middle, after)]
    return exact


def crossings(found: fs.CriticalValue) -> tuple[Array, Array]:
    """The values at which eigenvalues cross the axis, ascending, and the change of the number that grow, beginning with 0."""
    events = sorted([(one.value, 2 if one.omega else 1) for one in found.losses]
                    + [(one.value, -2 if one.omega else -1) for one in found.regains])
    return np.array([value for value, _ in events]), np.cumsum([0, *(step for _, step in events)])


def miscounted(found: fs.CriticalValue, points: Any, count: Callable[[float], int | None]) -> list[str]:
    """Up to three places at which the number of growing eigenvalues contradicts the losses and regains.

    `count` returns the number at a value, or None if rounding decides. Open intervals are left out.
    """
    values, change = crossings(found)
    told = list[str]()
    for p in np.sort(np.asarray(points, dtype=float)).tolist():
        if len(told) < 3 and not any(a <= p <= b for a, b in found.open) and (number := count(p)) is not None:
            claimed = found.growing + int(change[np.searchsorted(values, p)])
            told += [f"{number} grow at p = {p:.17g}, but {claimed} are claimed"] * (number != claimed)
    return told


def misfit(found: Array, bars: Array, exact: Sequence[Any]) -> str:
    """The λ that is further from its exact λ than its error bar and its last digit, in pairs one to one; '' if all fit."""
    there = [mp.mpc(value) for value in found]
    room = [mp.mpf(bar) + abs(value) * mp.mpf(2.0**-53) + mp.mpf(10) ** -400 for value, bar in zip(there, bars, strict=True)]
    excess = np.array([[float(mp.log10(abs(value - other) / size)) for other in exact]
                       for value, size in zip(there, room, strict=True)]).reshape(len(found), len(exact))
    rows, columns = linear_sum_assignment(np.maximum(excess, 0.0))
    worst = int(excess[rows, columns].argmax()) if len(rows) else 0
    if not len(rows) or excess[rows[worst], columns[worst]] <= 0:
        return ""
    return (f"λ = {found[rows[worst]]:.6g}, exactly {complex(exact[columns[worst]]):.6g}, bar {bars[rows[worst]]:.1e}, off by a "
            f"factor 1e{excess[rows[worst], columns[worst]]:.3f}")
