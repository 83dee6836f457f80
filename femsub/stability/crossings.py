"""Finds the modes that cross the imaginary axis in a narrow window, from both of its sides, and checks their number.

The eigenvalues at two values beside the window are matched by distance. Eigenvalues that move further than they lie apart form a
group, whose members are not distinguished. A mode crosses if its group has growing eigenvalues on one side of the window only.
Eigenvalues that pass 0 are counted separately, as the roots t of det(K + tK') = 0, which do not depend on the damping. A window
is settled if the modes found explain the change in the number of growing eigenvalues (2 per pair, 1 per real λ), and if as many
of them pass 0 as there are roots.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
import scipy.linalg as la
from scipy.sparse.csgraph import connected_components

from femsub.checks import EPS, Array
from femsub.modes import assigned
from femsub.stability.exclusion import Decomposition, Family

if TYPE_CHECKING:
    from femsub.model import Pencil

ASIDE = 1e-3  # share of a value or of the range: distance from a crossing at which its growth is given; below it, values are near
STEP = EPS ** (1 / 3)  # of the range: half the step of a difference, whose rounding EPS/STEP is then about its error STEP²


@dataclass(frozen=True, eq=False, repr=False)
class Crossing:
    """A point at which a mode begins to grow, or ceases to.

    Attributes
    ----------
    value : float
        The parameter.
    width : float
        The crossing lies within value ∓ width / 2.
    omega : float
        Its frequency, in radians per unit of time; 0 for divergence.
    shape : ndarray, shape (n,) or (r,)
        Its eigenvector in the model's coordinates, of unit length; complex unless it diverges.
    kind : str
        'divergence': a real eigenvalue passes 0. Otherwise ω xᴴD_s x + Im xᴴK_a x = 0 with the symmetric part of D and the skew
        part of K. 'hopf': xᴴD_s x < 0, negative damping feeds the motion. 'flutter': a circulatory K feeds the motion, or two
        undamped modes coalesce.
    growth : (float, float)
        Re λ of this mode a little before and beyond the value, on the way from the start of the range to its end.
    """

    value: float
    width: float
    omega: float
    shape: Array
    kind: str
    growth: tuple[float, float]

    @property
    def place(self) -> str:
        """The kind and ω, in words."""
        return self.kind + ("" if self.kind == "divergence" else f" at ω = {self.omega:.6g} rad/time")

    def __repr__(self) -> str:
        return (f"Crossing: {shown_value(self.value, self.width)} ({self.place}), Re λ from {self.growth[0]:.3g} to "
                f"{self.growth[1]:.3g}")


Found: TypeAlias = tuple[list[Crossing], list[Crossing]]  # losses and regains


def shown_value(value: float, width: float) -> str:
    """A value with at most 9 digits, and without digits below its width."""
    last = 10.0 ** np.floor(np.log10(width)) if width > 0 else 0.0
    return f"{round(value / last) * last + 0.0 if last > EPS * abs(value) else value:.9g}"


def fixed_digits(value: float, width: float) -> str:
    """A value with up to 10 decimal places, none of them below its width."""
    return f"{value:.{min(max(-int(np.floor(np.log10(width or 1e-10))), 0), 10)}f}"


def fed_by(pencil: Pencil, x: Array, omega: float) -> str:
    """What feeds a motion x at the axis, or just beyond it: 'flutter' or 'hopf'.

    There xᴴP(iω)x = 0 has the imaginary part ω xᴴD_s x + Im xᴴK_a x = 0 with the symmetric part of D and the skew part of K. The
    first term is the work that D takes from the motion, the second term the work that K takes. If D takes work, K feeds the
    motion. Neither term changes with the units of the DOF.
    """
    damping = omega * float((x.conj() @ ((pencil.D + pencil.D.T) / 2 @ x)).real)
    circulatory = float((x.conj() @ ((pencil.K - pencil.K.T) / 2 @ x)).imag)
    return "hopf" if damping < circulatory else "flutter"


class _Match(NamedTuple):
    """The successor and the group number of each eigenvalue on the left side, (m,). Members of a group are not distinguished."""

    to: Array
    group: Array

    def of(self, at: int) -> Array:
        return np.flatnonzero(self.group == self.group[at])


def _matched(left: Decomposition, right: Decomposition) -> _Match:
    """Two neighbouring spectra, matched by distance."""
    cost = np.abs(left.z[:, None] - right.z)
    to = assigned(cost)[1]
    bars = [np.minimum(np.abs(found.noise.diagonal()), np.abs(found.z)) for found in (left, right)]
    moved = np.maximum(cost[np.arange(len(to)), to], np.maximum(bars[0], bars[1][to]))
    after = right.z[to]
    # two eigenvalues that lie within the sum of their movements may have changed places
    apart = np.minimum(np.abs(left.z[:, None] - left.z), np.abs(after[:, None] - after))
    return _Match(to, connected_components(apart <= 2 * np.maximum.outer(moved, moved), directed=False)[1])


class _Change(NamedTuple):
    """A mode that crosses: its indices on both sides, whether it begins to grow, and its frequency (0 if it passes 0)."""

    before: int
    after: int
    begins: bool
    omega: float


def _changes(family: Family, a: float, b: float) -> list[_Change] | None:
    """The modes that cross between two values near each other; None if they are not distinguished from others."""
    left, right = family.spectrum(a), family.spectrum(b)
    match = _matched(left, right)
    grows, grown = family.grown(a)[0], family.grown(b)[0][match.to]
    after = right.z[match.to]
    found: list[_Change] = []
    unclear: list[_Change] = []  # pairs near 0, which may also become real before they cross
    real: list[_Change] = []
    for number in np.unique(match.group[grows | grown]):
        group = np.flatnonzero(match.group == number)
        change = int(grown[group].sum()) - int(grows[group].sum())
        heights = np.concatenate([left.z[group].imag, after[group].imag])
        own = bool((heights == 0).any() or (heights.min() < 0 < heights.max()))  # its own conjugate
        if change == 0 or (not own and heights[0] < 0):
            continue
        here, there = (grown, grows) if change > 0 else (grows, grown)
        z = after if change > 0 else left.z
        members = group[here[group]]
        crossed = [_Change(int(i), int(match.to[i]), change > 0, float(z[i].imag)) for i in members if z[i].imag > 0]
        if not there[group].any() and len(crossed) * (2 if own else 1) == abs(change):
            (unclear if own else found).extend(crossed)
        elif not own:
            return None
        else:
            first = members[np.lexsort((np.abs(z[members]), there[members]))][:abs(change)]
            real += [_Change(int(i), int(match.to[i]), change > 0, 0.0) for i in first]
    roots, at_edge = len(_roots(family, a, b)), a <= family.between[0] or b >= family.between[1]
    passing = [one._replace(omega=0.0) for one in unclear for _ in range(2)]
    for several in (unclear, passing):
        expected = len(real) + sum(one.omega == 0 for one in several)
        if roots == expected or (at_edge and roots > expected):
            return [*found, *real, *several]
    return None


def _roots(family: Family, a: float, b: float) -> list[tuple[float, Array]]:
    """Values p at which K is singular, between two values near each other, each with the motion that has no stiffness."""
    lo, hi = family.between
    m = min(max((a + b) / 2, lo), hi)
    step = STEP * (hi - lo)
    ends = max(lo, m - step), min(hi, m + step)
    slope = (family.pencil_at(ends[1]).K - family.pencil_at(ends[0]).K) / (ends[1] - ends[0])
    modes = family.shapes / family.omega
    K, change = (modes.T @ part @ modes for part in (family.pencil_at(m).K, slope))
    size = float(np.linalg.norm(change))
    if not size:
        return []
    scale = max(float(np.linalg.norm(K)) / size, hi - lo)
    with np.errstate(all="ignore"):
        (top, bottom), Y, X = la.eig(K, -scale * change, left=True, right=True, homogeneous_eigvals=True, check_finite=False)
        places = m + top / bottom * scale
        force = np.einsum("ij,ij->j", np.abs(Y), np.abs(K) @ np.abs(X))
        bars = np.minimum(4 * EPS * len(K) * force / np.abs(np.einsum("ij,ij->j", Y.conj(), change @ X)), b - a)
        inside = np.isfinite(places) & (places.imag == 0) & (a - bars <= places.real) & (places.real <= b + bars)
    numbers = np.flatnonzero(inside)
    shapes = modes @ X[:, numbers].real
    return [(float(places[i].real), x / np.linalg.norm(x)) for i, x in zip(numbers, shapes.T, strict=True)]


def weight(heights: Iterable[float]) -> int:
    """The number of eigenvalues with these Im λ ≥ 0: a pair counts twice."""
    return sum(2 if height else 1 for height in heights)


def change(losses: Iterable[Crossing], regains: Iterable[Crossing]) -> int:
    """How many more eigenvalues grow beyond these crossings than before them."""
    lost, regained = (weight(one.omega for one in several) for several in (losses, regains))
    return lost - regained


def settled(family: Family, window: tuple[float, float], room: tuple[float, float],
            known: tuple[int | None, int | None]) -> Found | None:
    """The losses and regains in a window, if the modes that cross explain the change in the number of growing modes; else None.

    Parameters
    ----------
    room : (float, float)
        Values below and above the window, up to which there is no other crossing.
    known : (int or None, int or None)
        The numbers of growing eigenvalues on both sides of the window. If a number is None, it is counted at a value at which
        rounding leaves no eigenvalue undecided, and the width of the crossings extends to this value.
    """
    for a, b in _sides(family, window, room):
        counts = []
        for p, number in zip((a, b), known, strict=True):
            grown, undecided = family.grown(p)
            counts.append(int(grown.sum()) if number is not None or not undecided else -1)
        if all(count >= 0 and number in (None, count) for count, number in zip(counts, known, strict=True)):
            found = _changes(family, a, b)
            if found is not None and sum(weight([one.omega]) * (1 if one.begins else -1) for one in found) == \
                    counts[1] - counts[0]:
                ends = tuple(side if number is None else edge for side, edge, number in zip((a, b), window, known, strict=True))
                return _crossings(family, found, (a, b), (ends[0], min(ends[1], family.between[1])), room)
    return None


def extrapolated(family: Family, window: tuple[float, float], room: tuple[float, float]) -> Found | None:
    """The losses or regains near a window, if rounding leaves undecided which modes grow beside it; None if they are not found.

    Re λ of a mode that certainly grows is extrapolated to 0 on a straight line, or (Re λ)² if two modes coalesce. Two
    extrapolations must agree. A real λ that passes 0 shows nothing about the pair beyond, unless there is no damping.
    """
    begins = int(family.grown(window[1])[0].sum()) > int(family.grown(window[0])[0].sum())
    for a, b in _sides(family, window, room):
        found = _changes(family, window[0], b) if begins else _changes(family, a, window[1])
        near = b if begins else a
        step = near - window[1 if begins else 0]
        points = [near, near + step, near + 3 * step]
        if not found or not step or not room[0] <= points[-1] <= room[1] or \
                not all(one.begins == begins and (one.omega or family.mirrored) for one in found):
            continue
        places = [_to_axis(family, points, one.after if begins else one.before) for one in found]
        if np.isfinite(places).all() and np.abs(np.array(places)[:, 0] - near).max() <= 2 * abs(step):
            several: list[Crossing] = []
            for one, (place, spread, omega) in zip(found, places, strict=True):
                half, sides = spread + family.least, (window[0], b) if begins else (a, window[1])
                crossing = _crossings(family, [one], sides, (place - half, place + half), room)[0 if begins else 1][0]
                several.append(replace(crossing, omega=omega if crossing.omega else 0.0))
            return (several, []) if begins else ([], several)
    return None


def _to_axis(family: Family, points: list[float], at: int) -> tuple[float, float, float]:
    """The value at which a growing mode meets the axis, its uncertainty, and ω there; NaN if it cannot be found."""
    numbers, spectra = [at], [family.spectrum(p) for p in points]
    for one, two in pairwise(spectra):
        numbers.append(int(_matched(one, two).to[numbers[-1]]))
    z = np.array([found.z[number] for found, number in zip(spectra, numbers, strict=True)])
    if not all(family.grown(p)[0][number] for p, number in zip(points, numbers, strict=True)):
        return np.nan, np.nan, np.nan
    p = np.array(points)
    with np.errstate(all="ignore"):
        steps = [np.diff(p) / np.diff(z.real**power) * z.real[:-1] ** power for power in (1, 2)]
    places = p[:-1] - np.array(steps)
    spread = np.nan_to_num(np.abs(np.diff(places)[:, 0]), nan=np.inf)
    first, second = places[int(np.argmin(spread))]
    if not abs(first - second) <= abs(p[1] - p[0]) / 20:  # they differ: the way to the axis is not as straight as assumed
        return np.nan, np.nan, np.nan
    slope = (z[1].imag - z[0].imag) / (p[1] - p[0])
    return float(first), float(abs(first - second)), float(z[0].imag + slope * (first - p[0]))


def _sides(family: Family, window: tuple[float, float], room: tuple[float, float]) -> Iterator[tuple[float, float]]:
    """Values below and above a window, further and further away, up to the room's ends."""
    most = max(window[0] - room[0], room[1] - window[1])
    step = min(max(window[1] - window[0], family.least), most)
    while True:
        yield max(window[0] - step, room[0]), min(window[1] + step, room[1])
        if step >= most:
            return
        step = min(8 * step, most)  # each try costs one decomposition on either side


def _crossings(family: Family, found: list[_Change], sides: tuple[float, float], window: tuple[float, float],
          room: tuple[float, float]) -> Found:
    """The losses and regains, each with its value, shape, kind and growth."""
    (lo, hi), (a, b) = family.between, sides
    roots = _roots(family, a, b) if any(one.omega == 0 for one in found) else []
    far = max(room[0], window[0] - ASIDE * (hi - lo)), min(room[1], window[1] + ASIDE * (hi - lo))
    both: Found = ([], [])
    for one in found:
        p, at = (b, one.after) if one.begins else (a, one.before)
        value, shape = (window[0] + window[1]) / 2, family.shape(family.spectrum(p), at)
        if one.omega:
            kind = fed_by(family.pencil_at(p), shape, one.omega)
        else:
            kind = "divergence"
            place, shape = roots.pop(int(np.argmax([abs(np.vdot(shape, x)) for _, x in roots])))
            value = min(max(place, window[0]), window[1])
        rates = _rate(family, a, far[0], one.before), _rate(family, b, far[1], one.after)
        both[0 if one.begins else 1].append(Crossing(value, window[1] - window[0], one.omega, shape, kind, rates))
    return both


def _rate(family: Family, near: float, far: float, at: int) -> float:
    """Re λ of a mode at `far` from the window, or nearer if it cannot be distinguished from other modes there."""
    found = family.spectrum(near)
    for share in (1.0, 1 / 8, 1 / 64):
        p = near + share * (far - near)
        if p == near:
            break
        there = family.spectrum(p)
        match = _matched(found, there)
        group = match.of(at)
        if family.grown(near)[0][group].sum() == family.grown(p)[0][match.to[group]].sum():
            return float(there.z[match.to[at]].real)
    return float(found.z[at].real)
