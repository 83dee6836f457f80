"""`harmonic_balance` of chains of 1 or 2 masses on a belt against shooting: the error stated holds, or there is a warning."""

from __future__ import annotations

import warnings

import numpy as np

import femsub as fs
from femsub.motion.cycles.initial_guess import of_signal

KINDS = ("from a transient", "given harmonics", "by itself")
SLACK = 2.0  # the error stated is an estimate to first order


def attacked(kind: str, seed: int) -> str:
    """One random case: 'confirmed' within the error stated, 'refused: …', 'warned', or a text that begins with 'wrong'."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    n = int(rng.integers(1, 3))
    springs = 10.0 ** rng.uniform(-0.5, 0.5, n)
    K = np.diag(springs + np.append(springs[1:], 0.0)) - np.diag(springs[1:], 1) - np.diag(springs[1:], -1)
    M = np.diag(10.0 ** rng.uniform(-0.3, 0.3, n))
    at = int(rng.integers(n))
    model = fs.Substructure(M, K, 10.0 ** rng.uniform(-3, -1.3) * K, interface=[at], ports={"belt": np.eye(n)[at]})
    speed, eps = float(rng.uniform(0.05, 0.5)), 10.0 ** rng.uniform(-2.0, -0.8)
    belt = fs.Belt(force=float(10.0 ** rng.uniform(-0.5, 0.5)), speed=speed, law=fs.StribeckArctan(eps=eps * speed))
    period = 2 * np.pi / np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real.min())
    harmonics = int(rng.integers(3, 80)) if kind == "given harmonics" else None
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        try:
            if kind == "by itself":
                cycle = fs.harmonic_balance(model, belt)
            else:
                run = fs.transient(model, belt, time=(0.0, 40 * period), samples=8_000,
                                   start=fs.State(np.zeros(n), np.full(n, 0.5 * speed)))
                if not settled(run):
                    return "no periodic motion"
                cycle = fs.harmonic_balance(model, belt, start=run, harmonics=harmonics)
        except fs.FemsubError as error:
            return f"refused: {str(error)[:60]}"
    told = [one for one in seen if issubclass(one.category, fs.FemsubWarning) and "leave out" in str(one.message)]
    if (cycle.truncation > 1e-4) != bool(told):
        return f"wrong: seed {seed}: {len(told)} warnings at {cycle!r}"
    try:
        shot = fs.shoot(model, belt, cycle, tol=1e-8)
    except fs.FemsubError as error:
        return f"no reference: {str(error)[:40]}"
    off = max(abs(cycle.omega / shot.omega - 1), abs(cycle.rms / shot.rms - 1))
    if off > SLACK * cycle.truncation + 1e-6:
        if not told:
            return f"wrong: seed {seed}: {off:.1e} off: {cycle!r}; {shot!r}"
        return "warned, further off than stated"
    return "warned" if told else "confirmed"


def settled(run: fs.Transient) -> bool:
    """Whether the transient has come to a periodic motion: its last period, by the autocorrelation, repeats the one before."""
    speed = run.velocity("belt")
    if np.ptp(speed[-2000:]) < 1e-3 * np.ptp(speed):
        return False
    try:
        period = 2 * np.pi / of_signal(run.t, speed, 1).omega
    except fs.FemsubError:
        return False
    t = run.t[-1] - period * np.arange(1000) / 1000
    here, before = np.interp(t, run.t, speed), np.interp(t - period, run.t, speed)
    return bool(np.abs(here - before).mean() < 0.02 * np.ptp(here))
