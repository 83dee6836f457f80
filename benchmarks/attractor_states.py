"""Which motion a trajectory has settled on, and whether two of them, of whatever model, are the same physical state.

A motion is known by what it does under the belt: its lines (frequencies with their shares of the power), its rms and
whether the lines are multiples of one frequency. Several motions attract: what a model does is the shares in which
starts end on them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from femsub.checks import Array
from femsub.errors import InputError

REACH = 0.015  # relative distance up to which two lines are one
FINE = 4.0  # the same in steps 2π/T of the shorter record; less than that no window of T can tell
OVERLAP = 0.8  # the share of the power on common lines from which on two motions are the same state
LEVEL = 0.1  # and the relative difference of their rms up to which they are
STEADY_OVERLAP, STEADY_LEVEL = 0.9, 0.01  # the same for two windows of one trajectory that has settled
FAINT = 1e-3  # a line below this share of the power is left out
HARMONIC = 0.99  # the share of the power on multiples of one frequency from which on a motion is periodic
ALIGNED = 0.3  # by so much of 2π/T a line may miss its multiple: centres of lines are sharper than the lines
SUBHARMONICS = 4  # that frequency may be the dominant one over 1, 2, … of these
STILL = 1e-6  # an rms below this share of the belt's speed is no motion


@dataclass(frozen=True, repr=False)
class Motion:
    """What is known of a motion.

    Attributes
    ----------
    omega : float
        The strongest line, radians per unit of time; 0 where nothing moves.
    rms : float
        Of the speed under the belt about its mean.
    sticking : float
        The share of time with |v0 - v| below the limit given.
    periodic : bool
        At least 99 % of the power on multiples of omega / k, k ≤ 4. Otherwise it is quasi-periodic or irregular.
    lines : tuple of (float, float)
        Frequency and share of the power, by ascending frequency.
    resolution : float
        2π/T of the record.
    """

    omega: float
    rms: float
    sticking: float
    periodic: bool
    lines: tuple[tuple[float, float], ...]
    resolution: float

    def __repr__(self) -> str:
        kind = "nothing moves" if not self.lines else ("periodic" if self.periodic else "not periodic")
        return f"Motion: {kind}, ω = {self.omega:.4f}, rms {self.rms:.3g}, sticks {100 * self.sticking:.0f} % of the time"

    def flat(self) -> dict[str, Any]:
        """For JSON; `Motion.of` takes it back."""
        return asdict(self)

    @classmethod
    def of(cls, flat: dict[str, Any]) -> Motion:
        """A motion that `flat` has written."""
        return cls(**(flat | {"lines": tuple((line[0], line[1]) for line in flat["lines"])}))


def motion(velocity: Array, step: float, speed: float, slip: float) -> Motion:
    """What a record v(t) under a belt shows, shape (m,), in steps of `step`.

    Parameters
    ----------
    speed : float
        The belt's speed v0.
    slip : float
        |v0 - v| below which it sticks; a few ε for a regularised law.
    """
    v = np.asarray(velocity, dtype=float)
    if v.ndim != 1 or len(v) < 64 or not np.isfinite(v).all():
        raise InputError("a motion needs a flat record of at least 64 finite speeds")
    sticking = float(np.mean(np.abs(speed - v) <= slip))
    rms, resolution = float(v.std()), 2 * np.pi / (step * len(v))
    if rms <= STILL * abs(speed):
        return Motion(0.0, rms, sticking, False, (), resolution)
    lines = _lines(v, step)
    omega = max(lines, key=lambda line: line[1])[0]
    return Motion(omega, rms, sticking, _is_periodic(lines, omega, resolution), lines, resolution)


def _lines(v: Array, step: float) -> tuple[tuple[float, float], ...]:
    """Peaks of the Blackman-windowed power with all that lies between the neighbouring minima, where they are not faint."""
    from scipy.signal import argrelmin, periodogram

    omega, power = periodogram(v, fs=2 * np.pi / step, window="blackman", detrend="constant")
    cuts = np.concatenate([[0], argrelmin(power)[0], [len(power)]])
    starts = np.unique(cuts[:-1])
    share, moment = np.add.reduceat(power, starts), np.add.reduceat(power * omega, starts)
    share, centre = share / power.sum(), moment / np.maximum(share, 1e-300)
    strong = share >= FAINT
    return tuple((float(at), float(part)) for at, part in zip(centre[strong], share[strong], strict=True))


def _is_periodic(lines: Sequence[tuple[float, float]], omega: float, resolution: float) -> bool:
    at, share = np.array(lines).T
    best = 0.0
    for divisor in range(1, SUBHARMONICS + 1):
        order = np.rint(at * divisor / omega)
        on = (order > 0) & (np.abs(at - order * omega / divisor) <= ALIGNED * resolution)
        best = max(best, float(share[on].sum()))
    return best >= HARMONIC * float(share.sum())


def overlap(one: Motion, other: Motion) -> float:
    """The largest share of the power of one spectrum that moves to the other with no line going further than REACH, 0 to 1.

    (The smallest rests first: lines from the lowest on, each to the lowest line within reach that has room left.)
    """
    if not one.lines or not other.lines:
        return 1.0 if one.lines == other.lines else 0.0
    finest = FINE * max(one.resolution, other.resolution)
    moved, room = 0.0, [share for _, share in other.lines]
    first = 0
    for omega, share in one.lines:
        reach = max(REACH * omega, finest)
        while first < len(room) and (other.lines[first][0] < omega - reach or room[first] <= 0):
            first += 1
        at = first
        while share > 0 and at < len(room) and other.lines[at][0] <= omega + reach:
            part = min(share, room[at])
            share, room[at], moved = share - part, room[at] - part, moved + part
            at += 1
    total = max(sum(share for _, share in one.lines), sum(share for _, share in other.lines))
    return moved / total


def _level(one: Motion, other: Motion) -> float:
    largest = max(one.rms, other.rms)
    return abs(one.rms - other.rms) / largest if one.lines or other.lines else 0.0


def same_state(one: Motion, other: Motion) -> bool:
    """Both periodic or both not, rms within 10 %, and at least 80 % of the power on lines within 1.5 % (or 4 · 2π/T)."""
    return one.periodic == other.periodic and _level(one, other) <= LEVEL and overlap(one, other) >= OVERLAP


def settled(before: Motion, now: Motion) -> bool:
    """Whether two successive windows of a trajectory show one motion: rms within 1 %, 90 % of the power on common lines."""
    return _level(before, now) <= STEADY_LEVEL and overlap(before, now) >= STEADY_OVERLAP


def states(motions: Sequence[Motion]) -> list[int]:
    """The state of each motion: that of the leader it overlaps most with among those that are the same state as it.

    A motion that is the same state as no earlier leader leads itself. Leaders do not move, so that no chain of small steps can
    put two different motions under one label; whoever comes first leads, hence the full model's motions should.
    """
    leaders: list[int] = []
    for at, each in enumerate(motions):
        if not any(same_state(motions[leader], each) for leader in leaders):
            leaders.append(at)
    labels = []
    for at, each in enumerate(motions):
        fit = [label for label, leader in enumerate(leaders) if leader == at or same_state(motions[leader], each)]
        labels.append(leaders.index(at) if at in leaders else max(fit, key=lambda label: overlap(motions[leaders[label]], each)))
    return labels


def shares(labels: Sequence[int], count: int) -> Array:
    """The share of each of `count` states, shape (count,)."""
    return np.bincount(np.asarray(labels, dtype=int), minlength=count) / max(len(labels), 1)


def total_variation(p: Array, q: Array) -> float:
    """½ Σ |p - q|: the least share of starts that would have to end elsewhere, 0 to 1."""
    return float(np.abs(np.asarray(p) - np.asarray(q)).sum() / 2)


def bootstrap(one: Sequence[int], other: Sequence[int], count: int, seed: int = 0, draws: int = 4000) -> tuple[float, float]:
    """2.5 % and 97.5 % of the total variation when the starts are drawn anew, the same ones for both models."""
    pairs = np.stack([np.asarray(one, dtype=int), np.asarray(other, dtype=int)])
    chosen = np.random.default_rng(seed).integers(0, pairs.shape[1], (draws, pairs.shape[1]))
    p, q = (np.stack([(labels[chosen] == state).mean(axis=1) for state in range(count)]) for labels in pairs)
    low, high = np.quantile(np.abs(p - q).sum(axis=0) / 2, [0.025, 0.975])
    return float(low), float(high)


def chance(labels: Sequence[int], count: int, starts: int, seed: int = 0, draws: int = 20_000) -> float:
    """95 % of the total variation between two sets of so many starts of one and the same model: what chance alone does.

    Its shares are not known but estimated from labels, of all its starts: p is drawn from the Dirichlet distribution that
    they leave of Jeffreys' prior, which grants a state that was never seen in m starts about 1/(2m).
    """
    rng = np.random.default_rng(seed)
    seen = np.bincount(np.asarray(labels, dtype=int), minlength=count)
    seen = np.append(seen[seen > 0], 0)  # and one that nobody saw
    p = rng.dirichlet(seen + 0.5, draws)
    one, other = rng.multinomial(starts, p), rng.multinomial(starts, p)
    return float(np.quantile(np.abs(one - other).sum(axis=1) / (2 * starts), 0.95))


def rank_correlation(rows: Sequence[Mapping[str, Any]], criteria: Sequence[str], measured: Sequence[str]) -> list[dict[str, Any]]:
    """Spearman's ρ between each criterion and each measured error over rows of a table; NaN where one of them is constant.

    One dict per criterion: its name, and ρ under the name of each measured error. Rows in which either is NaN are left out.
    """
    from scipy.stats import rankdata

    table: list[dict[str, Any]] = []
    for name in criteria:
        line: dict[str, Any] = {"criterion": name}
        for error in measured:
            pairs = np.array([(row[name], row[error]) for row in rows], dtype=float).reshape(-1, 2)
            x, y = (rankdata(column) for column in pairs[np.isfinite(pairs).all(axis=1)].T)
            spread = x.std() * y.std() if len(x) > 1 else 0.0
            line[error] = float(((x - x.mean()) * (y - y.mean())).mean() / spread) if spread > 0 else np.nan
        table.append(line)
    return table
