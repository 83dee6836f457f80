"""Meetings of two branches of eigenvalues: crossing, veering, coalescence and splitting.

Near a meeting of λ_a and λ_b their mean and (λ_a - λ_b)² are analytic in p, also at an exceptional point, where each of the two
has a square root. So the turn of λ_a - λ_b in the complex plane from one side to the other shows the kind: half a turn at a
crossing, a quarter at a coalescence or splitting, none at a veering.

That holds while no third mode meets one of the two nearby. A coalescence is therefore verified with the vectors at a computed
value next to it. There (λ_a - λ_b)² continues to other values h of the parameter, real or complex, as

    (λ_a - λ_b - h(g_aa - g_bb))² + 4h² g_ab g_ba,   g_jk = y_jᴴP'(λ_k)x_k.

Of its two zeros, one must lie at the meeting and the other far from it, and so must the zeros of either mode with a third one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

from femsub.checks import Array
from femsub.model import DOUBLE

PARTED = 4.0  # the distance of two branches on both sides of a meeting, relative to their smallest distance
HALF, QUARTER = 3 * np.pi / 4, np.pi / 4  # limits between half a turn, a quarter, and none

Modes = Callable[[float], tuple[Array, Array]]  # p ↦ λ (k,) and y_jᴴP'(λ_k)x_k (k, k), with both conjugates of a pair


@dataclass(frozen=True)
class Meeting:
    """Two branches that come together, or nearly so.

    Attributes
    ----------
    kind : str
        'crossing': their frequencies change order; the coupling of the modes is below the difference of their damping, or zero.
        'veering': the branches turn away and exchange their shapes. 'coalescence': two frequencies become one and the growth
        rates separate, as at the onset of flutter; also a pair that becomes two real eigenvalues. 'splitting': the reverse. Both
        are verified with the vectors: two eigenvalues become one at a value of the parameter next to this one (real, or with
        damping complex), and no third mode takes part.
    value : float
        The parameter at which they are nearest.
    width : float
        The distance of the computed values on both sides.
    branches : (int, int)
        Their columns in `Tracked.eigenvalues`.
    eigenvalue : complex
        The mean of both. It is well-conditioned also where each of them is not.
    gap : float
        |λ_a - λ_b| there.
    condition : float
        The larger condition number of the two at the nearest computed value. At an exceptional point (gap 0, one common vector)
        it is infinite; in floating point it is about 1e8.
    error_bar : float
        The larger error bar of the two. At an exceptional point no λ is known better than to the square root of the machine's
        precision.
    """

    kind: str
    value: float
    width: float
    branches: tuple[int, int]
    eigenvalue: complex
    gap: float
    condition: float
    error_bar: float

    def __repr__(self) -> str:
        return (f"Meeting: {self.kind} of branches {self.branches[0]} and {self.branches[1]} at {self.value:.9g}, λ = "
                f"{self.eigenvalue:.6g} ∓ {self.gap / 2:.1g}, condition {self.condition:.1g}")


def meetings_of(p: Array, values: Array, bar: Array, condition: Array, inside: Array, modes: Modes) -> tuple[Meeting, ...]:
    """All meetings of branches that are neighbours in frequency at some value; `modes` at a value verify a coalescence."""
    modes = cache(modes)
    pairs = {tuple(sorted(map(int, pair))) for row in values
             for pair in pairwise(np.lexsort((row.real, row.imag))[:np.count_nonzero(~np.isnan(row.real))])}
    found = [meeting for a, b in sorted(pairs)
             for meeting in _of_pair(p, values[:, [a, b]], bar[:, [a, b]], condition[:, [a, b]], inside[:, [a, b]], (a, b),
                                    modes)]
    above = [one for one in found if one.eigenvalue.imag >= -DOUBLE * abs(one.eigenvalue)]  # others are conjugates of these
    return tuple(sorted(above, key=lambda one: (one.value, one.branches)))


def _of_pair(p: Array, values: Array, bar: Array, condition: Array, inside: Array, branches: tuple[int, int],
             modes: Modes) -> list[Meeting]:
    """The meetings of two branches: where their frequencies change order, and where their distance has a minimum."""
    both = np.flatnonzero(~np.isnan(values).any(axis=1))
    if len(both) < 2:
        return []
    p, values, bar, condition, inside = p[both], values[both], bar[both], condition[both], inside[both]
    gap = values[:, 0] - values[:, 1]
    known = np.where(np.isfinite(bar), bar, 0.0)  # infinite at an exceptional point itself
    size, doubt = np.abs(gap), known.max(axis=1) + DOUBLE * np.abs(values).max(axis=1)

    def meeting(kind: str, value: float, i: int, k: int, least: float) -> Meeting:
        mean = np.interp(value, p, values.mean(axis=1))
        at = i + int(np.argmin(np.abs(p[i:k + 1] - value)))
        return Meeting(kind, float(value), float(p[k] - p[i]), branches, complex(mean), float(least),
                       float(condition[at].max()), float(bar[at].max()))

    result = []
    clear = np.flatnonzero(np.abs(gap.imag) > np.minimum(doubt, size))
    for i, k in pairwise(clear):
        turned = k == i + 1 or np.abs(np.angle(gap[k] / gap[i])) > HALF
        if gap[i].imag * gap[k].imag < 0 and inside[i].all() and turned:
            value, least = _crossing(p, gap, i, k)
            result.append(meeting("crossing", value, i, k, least))
    left, right = -1, -1
    for i in np.argsort(size, kind="stable"):
        if not 0 < i < len(p) - 1 or left < i < right:
            continue
        far = np.flatnonzero(size > max(PARTED * size[i], doubt[i]))
        before, after = far[far < i], far[far > i]
        if not len(before) or not len(after) or size[before[-1]:after[0] + 1].min() < size[i]:
            continue
        turn = np.abs(np.angle(gap[after[0]] / gap[before[-1]]))
        if turn > HALF or not inside[i].all():
            continue
        value, least = _nearest(p[i - 1:i + 2], gap[i - 1:i + 2])
        kind = "veering"
        if turn >= QUARTER:
            apart = np.flatnonzero(size > doubt)  # where the vectors are known
            at = apart[np.argmin(np.abs(p[apart] - value))]
            if not _become_one(*modes(float(p[at])), values[at], value - float(p[at])):
                continue
            kind = "coalescence" if np.abs(gap[before[-1]].imag) > np.abs(gap[before[-1]].real) else "splitting"
        left, right = before[-1], after[0]
        result.append(meeting(kind, value, i - 1, i + 1, least))
    return result


def _become_one(values: Array, rates: Array, pair: Array, ahead: float) -> bool:
    """Whether two modes have one exceptional point at about the distance `ahead`, and no other point is near.

    Near means: up to where the modes are PARTED times as far from each other. There (λ_a - λ_b)² is PARTED² times as large, and
    so is the distance from the exceptional point.
    """
    a = int(np.argmin(np.abs(values - pair[0])))
    b = int(np.argmin(np.where(np.arange(len(values)) == a, np.inf, np.abs(values - pair[1]))))
    with np.errstate(all="ignore"):
        gap = values[[a, b], None] - values
        drift = rates.diagonal()[[a, b], None] - rates.diagonal()
        turn = 2j * np.sqrt(rates[[a, b]] * rates[:, [a, b]].T)
        near, far = np.sort(np.abs(gap / np.stack([drift + turn, drift - turn]) - ahead), axis=0)
    alone = PARTED**2 * near[0, b]
    others = np.delete(np.where(np.abs(turn) > DOUBLE * np.abs(drift), near, np.inf), [a, b], axis=1)  # else they only cross
    return bool(alone <= far[0, b] and (others >= alone).all())


def _crossing(p: Array, gap: Array, i: int, k: int) -> tuple[float, float]:
    """Where Im(λ_a - λ_b) vanishes between two values, and |λ_a - λ_b| there, by a cubic through two more."""
    at = np.array(sorted({max(i - 1, 0), i, k, min(k + 1, len(p) - 1)}))
    step = p[k] - p[i]
    curve = np.polyfit((p[at] - p[i]) / step, gap[at], len(at) - 1)
    roots = np.roots(curve.imag)
    share = float(roots[np.argmin(np.abs(roots - gap[i].imag / (gap[i].imag - gap[k].imag)))].real)
    share = min(max(share, 0.0), 1.0)
    return float(p[i] + share * step), float(abs(np.polyval(curve, share)))


def _nearest(p: Array, gap: Array) -> tuple[float, float]:
    """Where two branches are nearest, and how near, by a parabola through (λ_a - λ_b)² at three values."""
    middle, scale = p[1], p[2] - p[0]
    curve = np.polyfit((p - middle) / scale, gap**2, 2)
    roots = np.roots(curve)
    if not len(roots):
        return float(middle), float(abs(gap[1]))
    at = float(np.clip(roots[np.argmin(np.abs(roots))].real, (p[0] - middle) / scale, (p[2] - middle) / scale))
    return float(middle + at * scale), float(np.sqrt(np.abs(np.polyval(curve, at))))
