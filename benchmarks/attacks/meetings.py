"""`track`: coalescences that are planted must be named, and none beside them.

The undamped models have M = 1 and ω² the eigenvalues of K(p). There a coalescence or splitting is a value at which the number of
real ω², or of positive ones, changes: found on a grid with bisection, or known in closed form where K is made of blocks of two.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

import femsub as fs
from benchmarks.attacks.common import Random, attack
from femsub.checks import Array
from femsub.stability.meetings import Meeting

KINDS = ("circulatory", "blocks", "through a pair", "damped alike", "damped", "veering", "symmetric")
GRID = 4001
GAP = 1e-3  # of two λ of about 2 that are one but for rounding
NEAR = 1e-6  # of the range: a meeting named is the one of the reference


class Problem(NamedTuple):
    """K(p) = A + pB + p²C of ω²; the values of its coalescences and of its splittings in closed form, None for by a grid."""

    terms: tuple[Array, Array, Array]
    between: tuple[float, float]
    told: tuple[list[float], list[float]] | None


@attack(KINDS, seed_first=True, silent=False)
def attacked(kind: str, rng: Random) -> str:
    """One random case: 'certified' if what is named is what there is, or a text that begins with 'wrong'."""
    task = problem(kind, rng)
    n, (lo, hi) = len(task.terms[0]), task.between
    D = 10.0 ** rng.uniform(-4, -1) * np.eye(n) if kind == "damped alike" else np.zeros((n, n))
    if kind == "damped":
        R = rng.standard_normal((n, n))
        D = 10.0 ** rng.uniform(-4, -1) * R @ R.T / n
    family = fs.Affine(np.eye(n), D, [(1.0, task.terms[0]), ("p", task.terms[1]), (lambda p: p**2, task.terms[2])])
    found = fs.track(family, None, "p", np.linspace(lo, hi, int(rng.integers(2, 15))))
    named = [[one for one in found.meetings if one.kind == word] for word in ("coalescence", "splitting")]
    if kind == "damped":
        told = [f"{one.kind} at {one.value:.6g} is none" for group in named for one in group if not exchanged(task, D, one)]
        return f"wrong: {'; '.join(told)}" if told else "confirmed"
    there = task.told or by_grid(task)
    told = [f"{one.kind} at {one.value:.9g} has a gap of {one.gap:.1e}" for group in named for one in group
            if one.gap > GAP]
    for word, group, places in zip(("coalescence", "splitting"), named, there, strict=True):
        at = np.array([one.value for one in group if not D.any() or abs(one.eigenvalue) > 0.2])  # critical damping is another
        near = NEAR * (hi - lo)
        told += [f"{word} at {value:.9g} is missing" for value in places
                 if np.abs(at - value).min(initial=np.inf) > near and min(value - lo, hi - value) > near]
        told += [f"{word} at {value:.9g} is invented" for value in at
                 if np.abs(np.array(places) - value).min(initial=np.inf) > near and not changes(task, value, near)]
    if kind == "veering" and not any(one.kind == "veering" for one in found.meetings):
        told.append("the veering is not named")
    return f"wrong: {'; '.join(told)}" if told else "certified"


def problem(kind: str, rng: Random) -> Problem:
    """A random K(p)."""
    n = int(rng.integers(2, 7))

    def any_symmetric(scale: float) -> Array:
        A = rng.standard_normal((n, n))
        return scale * (A + A.T) / 2

    none = np.zeros((n, n))
    C = rng.standard_normal((n, n))
    if kind in ("circulatory", "damped"):
        K = np.diag(rng.uniform(2, 5, n)) + any_symmetric(0.3) + 1.5 * np.eye(n)
        return Problem((K, C - C.T, none), (0.0, 1.0), None)
    if kind == "symmetric":
        return Problem((np.diag(rng.uniform(2, 9, n)) + 3 * np.eye(n), any_symmetric(2.0), none), (-1.0, 1.0), None)
    if kind == "veering":
        c = 10.0 ** rng.uniform(-4, -1)
        K, B = 4.0 * np.eye(2), np.diag([1.0, -1.0])
        K[0, 1] = K[1, 0] = c
        Q = np.linalg.qr(rng.standard_normal((2, 2)))[0]
        return Problem((Q @ K @ Q.T, Q @ B @ Q.T, np.zeros((2, 2))), (-float(rng.uniform(0.5, 1)), float(rng.uniform(0.5, 1))),
                       ([], []))
    return blocks(rng, through=kind == "through a pair")


def blocks(rng: Random, through: bool) -> Problem:
    """Blocks [[a + sp, bp], [-bp, c + tp]] and single modes, mixed by a similarity: (a - c + (s - t)p)² = 4b²p² at a meeting."""
    pairs, single = int(rng.integers(1, 3)), int(rng.integers(1 if through else 0, 3))
    n = 2 * pairs + single
    A, B = np.zeros((n, n)), np.zeros((n, n))
    places: tuple[list[float], list[float]] = ([], [])
    middle = 0.0
    for j in range(pairs):
        base, apart, b = 5 + 8 * j + rng.uniform(0, 2), rng.uniform(0.1, 0.8), rng.uniform(0.5, 2.0)
        s, t = rng.uniform(-0.3, 0.3, 2)
        A[2 * j, 2 * j], A[2 * j + 1, 2 * j + 1] = base, base + apart
        B[2 * j:2 * j + 2, 2 * j:2 * j + 2] = [[s, b], [-b, t]]
        middle = base + apart / 2
        for root in (apart / (s - t - 2 * b), apart / (s - t + 2 * b)):
            if 0 < root < 1:
                kappa = -2 * (apart - (s - t) * root) * (s - t) - 8 * b**2 * root  # d/dp of (a - c + (s - t)p)² - 4b²p²
                where = places[0 if kappa < 0 else 1]
                if not any(abs(root - other) < 1e-9 for other in where):
                    where.append(float(root))
    for j in range(2 * pairs, n):
        if through:  # in the middle of the last pair at a value after its coalescence
            slope = rng.choice([-1, 1]) * rng.uniform(0.5, 6)
            A[j, j], B[j, j] = middle - slope * rng.uniform(0.1, 0.95), slope
        else:
            A[j, j], B[j, j] = rng.uniform(4, 14), rng.uniform(-3, 3)
    T = np.linalg.qr(rng.standard_normal((n, n)))[0] if rng.random() < 0.5 else rng.standard_normal((n, n)) + 2 * np.eye(n)
    if through and rng.random() < 0.7:  # the single modes act on the others a little
        B += 10.0 ** rng.uniform(-6, -1) * rng.standard_normal((n, n))
        return Problem((T @ A @ np.linalg.inv(T), T @ B @ np.linalg.inv(T), np.zeros((n, n))), (0.0, 1.0), None)
    return Problem((T @ A @ np.linalg.inv(T), T @ B @ np.linalg.inv(T), np.zeros((n, n))), (0.0, 1.0), places)


def counted(task: Problem, p: Array) -> Array:
    """The numbers of complex and of negative ω² at each value, (k, 2)."""
    A, B, C = task.terms
    z = np.linalg.eigvals(A + p[:, None, None] * B + p[:, None, None]**2 * C)
    real = z.imag == 0.0
    return np.stack([(~real).sum(axis=1), (real & (z.real < 0)).sum(axis=1)], axis=1)


def changes(task: Problem, value: float, near: float) -> bool:
    """Whether the numbers differ on both sides of a value; a grid may step over a narrow range of flutter."""
    return bool(np.ptp(counted(task, np.array([value - near, value + near])), axis=0).any())


def by_grid(task: Problem) -> tuple[list[float], list[float]]:
    """Where the number of pairs of complex ω² grows, or of negative ones, and where it falls: a grid with bisection."""
    lo, hi = task.between
    grid = np.linspace(lo, hi, GRID)
    counts = counted(task, grid)
    up: list[float] = []
    down: list[float] = []
    for i in np.flatnonzero((np.diff(counts, axis=0) != 0).any(axis=1)):
        a, b, before, after = float(grid[i]), float(grid[i + 1]), counts[i], counts[i + 1]
        while b - a > 1e-10 * (hi - lo):
            points = np.linspace(a, b, 9)
            inner = counted(task, points)
            first = int(np.flatnonzero((np.diff(inner, axis=0) != 0).any(axis=1))[0])
            a, b = float(points[first]), float(points[first + 1])
        (up if (after - before).sum() > 0 else down).append(b)
    return up, down


def exchanged(task: Problem, D: Array, one: Meeting) -> bool:
    """Whether two λ change places on a circle in the complex plane of p around the place named, small against the range."""
    A, B, C = task.terms
    n = len(A)
    for radius in np.geomspace(1e-4, 0.1, 12) * (task.between[1] - task.between[0]):
        circle = one.value + radius * np.exp(2j * np.pi * np.arange(401) / 400)
        state = np.zeros((len(circle), 2 * n, 2 * n), dtype=complex)
        state[:, :n, n:] = np.eye(n)
        state[:, n:, :n], state[:, n:, n:] = -(A + circle[:, None, None] * B + circle[:, None, None]**2 * C), -D
        z = np.linalg.eigvals(state)
        start = np.argsort(np.abs(z[0] - one.eigenvalue))[:2]
        here = z[0][start]
        for row in z[1:]:
            cost = np.abs(here[:, None] - row)
            here = row[np.argmin(cost, axis=1)]
        if abs(here[0] - z[0][start[1]]) + abs(here[1] - z[0][start[0]]) < 1e-3 * abs(z[0][start[0]] - z[0][start[1]]):
            return True
    return False
