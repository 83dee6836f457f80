"""`harmonic_balance` of chains of 1 or 2 masses on a belt against shooting: the stated error holds, or there is a warning.

A refusal is right in two cases: steady sliding is stable by NumPy's eigenvalues and no start was given; or the motion does not
become periodic in ten times as long a time, since it decays or does not repeat itself.
"""

from __future__ import annotations

import re
import warnings

import numpy as np

import femsub as fs
from benchmarks.attacks.common import Random, attack, eigenvalues, row_of_springs
from femsub.motion.cycles.initial_guess import of_signal

KINDS = ("from a transient", "given harmonics", "by itself")
SLACK = 2.0  # the stated error is a first-order estimate


@attack("cycles", KINDS, seed_first=True)
def attacked(kind: str, rng: Random) -> str:
    """One random case: 'confirmed' within the error stated, 'warned', 'refused: …', the reason why a refusal is right, or a text
    that begins with 'wrong'.
    """
    n = int(rng.integers(1, 3))
    springs = 10.0 ** rng.uniform(-0.5, 0.5, n)
    K = row_of_springs(np.append(springs, 0.0))
    M = np.diag(10.0 ** rng.uniform(-0.3, 0.3, n))
    at = int(rng.integers(n))
    model = fs.Substructure(M, K, 10.0 ** rng.uniform(-3, -1.3) * K, interface=[at], ports={"belt": np.eye(n)[at]})
    speed, eps = float(rng.uniform(0.05, 0.5)), 10.0 ** rng.uniform(-2.0, -0.8)
    law = fs.StribeckArctan(eps=eps * speed)
    belt = fs.Belt(force=float(10.0 ** rng.uniform(-0.5, 0.5)), speed=speed, law=law)
    period = 2 * np.pi / np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real.min())
    start = fs.State(np.zeros(n), np.full(n, 0.5 * speed))
    harmonics = int(rng.integers(3, 80)) if kind == "given harmonics" else None
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        try:
            if kind == "by itself":
                cycle = fs.harmonic_balance(model, belt)
            else:
                run = fs.transient(model, belt, time=(0.0, 40 * period), samples=8_000, start=start)
                if not settled(run):
                    return "no periodic motion"
                cycle = fs.harmonic_balance(model, belt, start=run, harmonics=harmonics)
        except fs.FemsubError as error:
            step = 1e-6 * speed
            D = np.array(model.D)
            D[at, at] += belt.force * (law.value(speed + step) - law.value(speed - step)) / (2 * step)
            if kind == "by itself" and eigenvalues(M, D, K).real.max() < 0:
                return "steady sliding is stable"
            if harmonics is not None and (more := _advised(model, belt, run, str(error))):
                return f"needs more than the given harmonics, as advised: {more}"
            run = fs.transient(model, belt, time=(0.0, 400 * period), samples=160_000, start=start)
            return f"refused: {str(error)[:60]}" if settled(run, 2e-3) else "no periodic motion"
    told = [one for one in seen if issubclass(one.category, fs.FemsubWarning) and "leave out" in str(one.message)]
    if (cycle.truncation > 1e-4) != bool(told):
        return f"wrong: {len(told)} warnings at {cycle!r}"
    try:
        shot = fs.shoot(model, belt, cycle, tol=1e-8)
    except fs.FemsubError as error:
        return f"no reference: {str(error)[:40]}"
    off = max(abs(cycle.omega / shot.omega - 1), abs(cycle.rms / shot.rms - 1))
    if off > SLACK * cycle.truncation + 1e-6:
        if not told:
            return f"wrong: {off:.1e} off: {cycle!r}; {shot!r}"
        return "warned, further off than stated"
    return "warned" if told else "confirmed"


def _advised(model: fs.Substructure, belt: fs.Belt, run: fs.Transient, advice: str) -> int:
    """The number of harmonics that the message of a refusal recommends, if it converges; otherwise 0."""
    while found := re.search(r"harmonics=(\d+)", advice):
        try:
            fs.harmonic_balance(model, belt, start=run, harmonics=int(found[1]))
        except fs.FemsubError as error:
            if int(found[1]) > 1500:
                break
            advice = str(error)
        else:
            return int(found[1])
    return 0


def settled(run: fs.Transient, off: float = 0.02) -> bool:
    """Whether the transient has become periodic: its last period, by the autocorrelation, repeats the period before it.

    The mean difference may be the share `off` of the motion's size, with the period that fits best.
    """
    speed = run.velocity("belt")
    quarter = len(speed) // 4
    if np.ptp(speed[-quarter:]) < max(1e-3 * np.ptp(speed), (1 - off) * np.ptp(speed[-2 * quarter:-quarter])):
        return False
    try:
        period = 2 * np.pi / of_signal(run.t, speed, 1).omega
    except fs.FemsubError:
        return False
    t = run.t[-1] - period * np.arange(1000) / 1000
    here = np.interp(t, run.t, speed)
    before = [np.interp(t - period * factor, run.t, speed) for factor in np.linspace(0.99, 1.01, 201)]
    return bool(np.abs(here - before).mean(axis=1).min() < off * np.ptp(here))
