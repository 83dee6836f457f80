"""`critical_value` against a dense scan with bisection on random models: none missed, none invented.

    python scripts/critical_values.py [FIRST] [NUMBER]

Undamped circulatory models, damped ones, gyroscopic ones, negative damping, and factors that are not affine, in turn. The number
of growing eigenvalues that follows from the losses and regains is compared with the number counted at 2,001 values of the
parameter and between any two crossings. Each crossing that bisection finds on this grid must be in the result.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import femsub as fs
from femsub.checks import Array

KINDS = ("circulatory", "damped", "gyroscopic", "negative damping", "not affine")
GRID = 2001
ON_AXIS = 1e-7  # of the largest |λ|: what rounding may do to an undamped eigenvalue near a coalescence
NEAR = 1e-7  # of the range: a crossing found by bisection is the same as one of `critical_value`


class Problem(NamedTuple):
    kind: str
    family: fs.Affine
    between: tuple[float, float]
    undamped: bool


def problem(seed: int) -> Problem:
    """A random model with one parameter p."""
    rng = np.random.default_rng(seed)
    kind, n = KINDS[seed % len(KINDS)], int(rng.integers(2, 7))

    def spd(least: float) -> Array:
        A = rng.standard_normal((n, n))
        return A @ A.T / n + least * np.eye(n)

    M, K, any_K, skew = spd(0.5), 4 * spd(0.3), rng.standard_normal((n, n)), rng.standard_normal((n, n))
    skew, damping = skew - skew.T, 10.0 ** rng.uniform(-4, 0) * spd(0.01)
    between = (-float(rng.uniform(0.1, 3)), float(rng.uniform(0.5, 6)))
    eye = np.eye(n)
    terms: dict[str, tuple[Any, Any]] = {
        "circulatory": (None, [(1.0, K), ("p", any_K)]),
        "damped": (damping, [(1.0, K), ("p", any_K)]),
        "gyroscopic": ([(1.0, 2 * skew)], [(1.0, K - 3 * eye), ("p", spd(0.0) - eye)]),
        "negative damping": ([(1.0, damping), ("p", 0.1 * (any_K + any_K.T))], [(1.0, K), ("p", 0.2 * skew)]),
        "not affine": (damping, [(1.0, K), (lambda p: np.sin(3 * p), any_K), (lambda p: p**2, 0.1 * skew)])}
    return Problem(kind, fs.Affine(M, *terms[kind]), between, kind in ("circulatory", "gyroscopic"))


def counter(task: Problem) -> Callable[[Array], tuple[Array, Array]]:
    """p (k,) ↦ the number of growing eigenvalues, and how clear it is: the smallest |Re λ| that counted, relative."""
    n, inverse = task.family.size, np.linalg.inv(task.family.M[0][1])

    def summed(terms: Any, p: Array) -> Array:
        found = np.zeros((len(p), n, n))
        for theta, A in terms:
            found += np.broadcast_to(p if theta == "p" else theta(p) if callable(theta) else theta, p.shape)[:, None, None] * A
        return found

    def grown(p: Array) -> tuple[Array, Array]:
        state = np.zeros((len(p), 2 * n, 2 * n))
        state[:, :n, n:] = np.eye(n)
        state[:, n:, :n], state[:, n:, n:] = -inverse @ summed(task.family.K, p), -inverse @ summed(task.family.D, p)
        z = np.linalg.eigvals(state)
        rate = z.real / np.abs(z).max(axis=1)[:, None]
        if task.undamped:
            return (rate > ON_AXIS).sum(axis=1), np.ones(len(p))
        return (rate > 0).sum(axis=1), np.abs(rate).min(axis=1)

    return grown


def differences(task: Problem, found: fs.CriticalValue) -> list[str]:
    """Where the result and the scan disagree, up to three places; nothing if they agree."""
    lo, hi = task.between
    grown, told = counter(task), []
    events = sorted([(one.value, 2 if one.omega else 1) for one in found.losses]
                    + [(one.value, -2 if one.omega else -1) for one in found.regains])
    values = np.array([value for value, _ in events])
    change = np.cumsum([0, *(step for _, step in events)])
    inner = (values[1:] + values[:-1]) / 2
    grid = np.sort(np.concatenate([np.linspace(lo, hi, GRID), inner]))
    counts, clear = grown(grid)
    claimed = found.growing + change[np.searchsorted(values, grid)]
    near = np.abs(grid[:, None] - values).min(axis=1, initial=np.inf) <= NEAR * (hi - lo)
    wrong = (claimed != counts) & (clear > 1e-11) & ~near
    told += [f"{counts[i]} grow at p = {grid[i]:.9g}, but {claimed[i]} are claimed" for i in np.flatnonzero(wrong)][:3]
    for i in np.flatnonzero(np.diff(counts)):
        a, b = float(grid[i]), float(grid[i + 1])
        while b - a > 1e-10 * (hi - lo):
            points = np.linspace(a, b, 9)
            first = int(np.flatnonzero(np.diff(grown(points)[0]))[0])
            a, b = float(points[first]), float(points[first + 1])
        if np.abs(values - b).min(initial=np.inf) > NEAR * (hi - lo):
            told.append(f"the crossing at p = {b:.9g} is missing")
    return told


def main(begin: int = 0, number: int = 300) -> int:
    """Print one line per kind; 1 if anything disagrees."""
    start, failed, kinds = time.perf_counter(), 0, Counter[str]()
    for seed in range(begin, begin + number):
        task = problem(seed)
        found = fs.critical_value(task.family, None, "p", between=task.between)
        for one in (*found.losses, *found.regains):
            kinds[f"{task.kind}: {one.kind}"] += 1
        kinds[f"{task.kind}: {found.evidence}"] += 1
        kinds["eigenproblems"] += found.solved
        kinds["with three crossings or more"] += len(found.losses) + len(found.regains) >= 3
        for line in differences(task, found):
            failed += 1
            print(f"seed {seed} ({task.kind}): {line}")
    for name, count in sorted(kinds.items()):
        print(f"  {name:32} {count}")
    print(f"{number} models, {failed} disagreements, {time.perf_counter() - start:.0f} s")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
