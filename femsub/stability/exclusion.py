"""Intervals of a parameter in which no eigenvalue of a pencil can cross the imaginary axis, excluded by Gershgorin discs.

In a state form common to all p the pencil is a matrix A(p). With A(m) = V diag(z) V⁻¹ in the middle m of an interval, t = p - m,
B = V⁻¹A'V, and a turn of the vectors to first order, x_ij = b_ij / (z_j - z_i) where z_i and z_j are far enough apart,

    (V(I + tX))⁻¹ A(p) V(I + tX) = diag(z + tb) + (I + tX)⁻¹ (tB' + t²C),   C = BX - X diag(b)

for an A that is affine in p; b is the diagonal of B, B' has the entries that X leaves. The last term is bounded entry by entry by
F = (I - h|X|)⁻¹ (h|B'| + h²|C| + rounding), h half the width. Each eigenvalue stays in the union of the discs around z_i + t b_i
with the radii Σ_j f_ij. If row and column i are scaled by 1/τ and τ, a disc that is clear of all others shrinks to the second
order in F, and holds exactly one eigenvalue. An interval is excluded if no disc touches the axis.

Without damping (and for gyroscopic forces with a symmetric K) the spectrum is symmetric about the axis. There an eigenvalue on
the axis stays on it as long as its disc is clear of all others: it can only leave together with another one.

Sources: S. Gershgorin 1931; R. S. Varga, Geršgorin and His Circles (2004), sec. 1.1 and 2.1 (scaled discs and their counts).
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.linalg as la

from femsub.algebra import equilibration, scaled
from femsub.checks import EPS, Array, InputError
from femsub.model import SAMPLES
from femsub.modes import REGULAR, definite_form, first_turn
from femsub.stability.parameter import PencilOver

if TYPE_CHECKING:
    from femsub.model import Pencil

SLOWEST = 1e-6  # times the highest ω: smallest scale of a displacement in the state
ANYWHERE = ((0.0, np.inf),)  # heights of which nothing is known
RESOLUTION = 1e-11  # share of the range: an interval of this width is not divided any more


class Decomposition(NamedTuple):
    """A(m) = V diag(z) V⁻¹; `noise` (m, m) bounds the rounding in V⁻¹AV."""

    z: Array
    V: Array
    inverse: Array
    noise: Array


@dataclass(frozen=True)
class Stretch:
    """A part of the range with `growing` eigenvalues throughout, or (None) not excluded.

    `heights` are ranges of |Im λ| that contain each eigenvalue which may touch the axis anywhere in such a part.
    """

    begin: float
    end: float
    growing: int | None
    heights: tuple[tuple[float, float], ...] = ()

    def meets(self, band: tuple[float, float]) -> bool:
        """Whether an eigenvalue that may touch the axis may be in the band."""
        return not self.heights or any(low <= band[1] and high >= band[0] for low, high in self.heights)


class Family:
    """The state matrices A(p) of a pencil over a range of p.

    The state is (Ωη, λη) with q = Φη; Φ (n, n) and Ω are the undamped modes in the middle of the range. `affine`: A
    is affine in p, as `over` declares. Deviations of samples from the chord then count as rounding in `size`. `mirrored`: the
    spectrum is symmetric about the imaginary axis. `over` gives the p at which a pencil that is not affine must be examined.
    Decompositions are kept in up to `memory` bytes. If A is not affine, its deviation from the chord between samples is taken as
    `safety` times the largest deviation at samples.
    """

    def __init__(self, over: PencilOver, between: tuple[float, float], memory: float = 2e8, safety: float = 1.5) -> None:
        self.over, self.between, self.safety = over, between, safety
        lo, hi = between
        self.middle, self.least = (lo + hi) / 2, max(RESOLUTION * (hi - lo), 8 * EPS * max(abs(lo), abs(hi)))
        pencil_at, pencil = self.pencil_at, self.pencil_at(self.middle)
        if pencil.symmetric[0]:
            form = definite_form(pencil)
            self.shapes, omega = form.shapes, form.omega
        else:  # with an unsymmetric M, the DOF themselves, scaled
            if np.linalg.cond(scaled(pencil.M, *equilibration(pencil.M))) > REGULAR:
                raise InputError("M is singular or nearly so. Condense DOF without mass, or give them a little mass")
            rows, columns = pencil.units
            mass, stiffness = (np.linalg.norm(scaled(part, rows, columns), 2) for part in (pencil.M, pencil.K))
            self.shapes, omega = np.diag(columns), np.full(pencil.size, np.sqrt(stiffness / mass) or 1.0)
        self.omega = np.maximum(omega, SLOWEST * omega.max())
        kept = max(8, int(memory / (50 * (2 * len(self.omega)) ** 2)))
        self.matrix, self.spectrum = lru_cache(maxsize=kept)(self._matrix), lru_cache(maxsize=kept)(self._spectrum)
        points = [lo + share * (hi - lo) for share in SAMPLES]
        self.affine = over.affine(between)
        self.kinks = over.kinks(between)
        self.sampled = None if self.affine else over.sampled(between)
        pencils, matrices = [pencil_at(p) for p in points], [self.matrix(p) for p in points]
        self.slope: Array = (matrices[-1] - matrices[0]) / (hi - lo)
        if self.sampled is not None:
            pencils += [pencil_at(p) for p in self.sampled.places(lo, hi)]
        self.size = np.maximum.reduce([self._magnitude(pencil) for pencil in (pencils[0], *pencils[len(points) - 1:])])
        self.size += max(abs(lo), abs(hi)) * np.abs(self.slope)  # the rounding of p itself
        if self.affine:  # a deviation from the chord is rounding: of terms that cancel in a contact, and of the projection
            off = np.max([np.abs(A - matrices[0] - (p - lo) * self.slope) for p, A in zip(points, matrices, strict=True)], axis=0)
            off = np.minimum.outer(off.max(axis=1), off.max(axis=0))  # a single entry may be exact by chance
            self.size = np.maximum(self.size, off / (4 * EPS))  # `_spectrum` multiplies it by 4 EPS
        self.floating = all(pencil.symmetric[0] and definite_form(pencil).rigid > 0
                            for pencil in (pencils[0], pencils[2], pencils[len(points) - 1]))
        self.mirrored = all(map(is_mirrored, pencils))
        self.solved = 0

    def pencil_at(self, p: float) -> Pencil:
        """The dense pencil at p, extrapolated linearly above the range, where a contact may refuse the parameter."""
        hi = self.between[1]
        if p <= hi:
            return self.over(p).dense()
        last, before = self.pencil_at(hi), self.pencil_at(2 * hi - p)
        return type(last)(*(2 * getattr(last, name) - getattr(before, name) for name in "MDK"))

    def _matrix(self, p: float) -> Array:
        """A(p), shape (2n, 2n)."""
        pencil = self.pencil_at(p)
        M, D, K = (self.shapes.T @ (part @ self.shapes) for part in (pencil.M, pencil.D, pencil.K))
        forces = np.hstack([K / self.omega, D])
        return self._state(-forces if _is_eye(M) else -la.solve(M, forces, check_finite=False))

    def _state(self, accelerations: Array) -> Array:
        return np.vstack([np.hstack([np.zeros_like(self.shapes), np.diag(self.omega)]), accelerations])

    def _magnitude(self, pencil: Pencil) -> Array:
        """A with the absolute values of all terms that its entries sum up: EPS times this is their rounding."""
        size = np.abs(self.shapes)
        K, D = (size.T @ (np.abs(part) @ size) for part in (pencil.K, pencil.D))
        M, forces = self.shapes.T @ pencil.M @ self.shapes, np.hstack([K / self.omega, D])
        return self._state(forces if _is_eye(M) else np.abs(np.linalg.inv(M)) @ forces)

    def at(self, p: float) -> Array:
        """A(p); the pencil is not needed if the family is affine."""
        return self.matrix(self.middle) + (p - self.middle) * self.slope if self.affine else self.matrix(p)

    def _spectrum(self, p: float) -> Decomposition:
        A = self.at(p)
        self.solved += 1
        z, V = la.eig(A, check_finite=False)
        try:
            inverse = np.linalg.inv(V)
        except np.linalg.LinAlgError:
            inverse = np.full_like(V, np.inf)
        with np.errstate(all="ignore"):
            noise = np.abs(inverse @ (A @ V) - np.diag(z)) + 4 * EPS * (np.abs(inverse) @ (self.size @ np.abs(V)))
        return Decomposition(z, V, inverse, np.where(np.isfinite(noise), noise, np.inf))

    def shape(self, found: Decomposition, at: int) -> Array:
        """The shape of one eigenvalue in the model's coordinates, of unit length."""
        x: Array = self.shapes @ (found.V[:len(self.omega), at] / self.omega)
        return x / np.linalg.norm(x)

    def tested(self, begin: float, end: float) -> list[Stretch]:
        """The test of one interval, from the decomposition in its middle: the interval as one part, or with windows cut out."""
        m, h = (begin + end) / 2, (end - begin) / 2
        found = self.spectrum(m)
        with np.errstate(all="ignore"):
            slope, curved, towards = self.slope, np.zeros_like(found.noise), np.zeros(len(found.z))
            if not self.affine:
                slope, A = (self.at(end) - self.at(begin)) / (end - begin), self.at(m)
                usual = [begin, (begin + m) / 2, (m + end) / 2, end]
                more = [] if self.sampled is None else self.sampled.places(begin, end, usual)
                rest = np.array([found.inverse @ ((self.at(p) - A - (p - m) * slope) @ found.V) for p in (*usual, *more)])
                curved = self.safety * np.abs(rest).max(axis=0)
                towards = self.safety * np.abs(np.einsum("kii->ki", rest).real).max(axis=0)
            discs = _discs(found.z, h, found.inverse @ slope @ found.V, found.noise + curved, found.noise.diagonal() + towards)
        if discs is None:
            return [Stretch(begin, end, None, ANYWHERE)]
        touching, on_axis = _touching(discs, self.mirrored)
        growing = int(np.count_nonzero(found.z.real[~on_axis & ~touching] > 0))
        if not touching.any():
            return [Stretch(begin, end, growing)]
        cut = self._cut(discs, touching, growing, begin, end)
        return [Stretch(begin, end, None, discs.heights(touching))] if cut is None else cut

    def _cut(self, discs: _Discs, touching: Array, growing: int, begin: float, end: float) -> list[Stretch] | None:
        """The interval in excluded parts, and windows in which a clear disc may reach the axis.

        None if a disc is not clear of all others, or if windows would cover more than half. The centre of a disc moves linearly,
        z_i + t b_i. So its eigenvalue crosses only where |Re(z_i + t b_i)| is below the radius. The radius falls with a higher
        power of h, so that one step reduces an interval around a simple crossing to a narrow window.
        """
        h = (end - begin) / 2
        speed = discs.drift.real[touching] / h
        radius = discs.axis[touching] + isolated(discs.F, discs.apart)[touching]
        if self.mirrored or not np.isfinite(radius).all() or not speed.all():
            return None
        rate = discs.z.real[touching]
        # a window must not vanish between two neighbouring floating-point numbers
        centre, half = -rate / speed, np.maximum(radius / np.abs(speed), 4 * EPS * max(abs(begin), abs(end)))
        pieces = union(zip(np.maximum(centre - half, -h).tolist(), np.minimum(centre + half, h).tolist(), strict=True))
        if sum(hi - lo for lo, hi in pieces) > h:
            return None
        middle, result = (begin + end) / 2, []
        # rounding must leave no sliver between a piece and the end that it reaches: its count would be wrong
        inside = (begin if edge <= -h else end if edge >= h else middle + edge for piece in pieces for edge in piece)
        edges = [begin, *inside, end]
        for i, (lo, hi) in enumerate(pairwise(edges)):
            inner = growing + int(np.count_nonzero(rate + ((lo + hi) / 2 - middle) * speed > 0))
            if lo < hi:
                result.append(Stretch(lo, hi, None, discs.heights(touching)) if i % 2 else Stretch(lo, hi, inner))
        return result

    def grown(self, p: float) -> tuple[Array, bool]:
        """Which eigenvalues certainly grow at one value p, bool (m,), and whether rounding leaves any other undecided."""
        found = self.spectrum(p)
        with np.errstate(all="ignore"):
            discs = _discs(found.z, 0.0, np.zeros_like(found.V), found.noise, found.noise.diagonal())
        if discs is None:
            return np.zeros(len(found.z), dtype=bool), True
        touching, on_axis = _touching(discs, self.mirrored)
        return (found.z.real > 0) & ~on_axis & ~touching, bool(touching.any())

    def parts(self, most: int, band: tuple[float, float] = (0.0, np.inf)) -> list[Stretch]:
        """The range as a sequence of intervals, divided until each is excluded or narrow. After `most` tests, others are open.

        An interval in which only eigenvalues outside the band may touch the axis is left as it is, unless it meets a narrow one.
        """
        (lo, hi), least = self.between, self.least
        # 32 intervals at first if A is not affine: samples a whole range apart would show little
        edges = sorted({lo, hi} if self.affine else {*np.linspace(lo, hi, 33).tolist(), *self.kinks})
        waiting, done, aside = sorted((a - b, a, b) for a, b in pairwise(edges)), list[Stretch](), list[Stretch]()

        def divide(begin: float, end: float) -> None:
            m = (begin + end) / 2
            for a, b in ((begin, m), (m, end)):
                heapq.heappush(waiting, (a - b, a, b))

        for _ in range(most):
            if not waiting:  # a window can only be settled between excluded intervals
                ends = {end for part in done if part.growing is None and part.meets(band) for end in (part.begin, part.end)}
                beside = [part for part in aside if ends & {part.begin, part.end}]
                for part in beside:
                    aside.remove(part)
                    divide(part.begin, part.end)
            if not waiting:
                break
            _, a, b = heapq.heappop(waiting)
            for part in self.tested(a, b):
                if part.growing is not None or (part.heights and part.end - part.begin <= least):
                    done.append(part)
                elif not part.meets(band):
                    aside.append(part)
                elif part.end - part.begin < (b - a) / 2:
                    heapq.heappush(waiting, (part.begin - part.end, part.begin, part.end))
                elif all(self.grown(p)[1] for p in ((a + b) / 2, (3 * a + b) / 4, (a + 3 * b) / 4)):
                    done.append(part)  # rounding alone leaves open which eigenvalues grow: dividing does not help
                else:
                    divide(a, b)
        done += [*aside, *(Stretch(a, b, None, ANYWHERE) for _, a, b in waiting)]
        # Neighbours that are not excluded become one. Between excluded neighbours with different numbers there is a crossing.
        result: list[Stretch] = []
        for part in sorted(done, key=lambda part: part.begin):
            last = result[-1] if result else None
            if last is not None and last.growing is None and part.growing is None:
                result[-1] = Stretch(last.begin, part.end, None, (*last.heights, *part.heights))
                continue
            if last is not None and None not in (last.growing, part.growing) and last.growing != part.growing:
                result.append(Stretch(last.end, last.end, None))
            result.append(part)
        return result


def union(intervals: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Intervals that do not overlap, ascending."""
    found: list[tuple[float, float]] = []
    for a, b in sorted(intervals):
        if found and a <= found[-1][1]:
            found[-1] = found[-1][0], max(found[-1][1], b)
        else:
            found.append((a, b))
    return found


def is_mirrored(pencil: Pencil) -> bool:
    """Whether λ and -λ̄ are eigenvalues together: without damping, or of a gyroscopic model with symmetric M and K."""
    gyroscopic = pencil.symmetric[0] and pencil.symmetric[2]
    return bool(abs(pencil.D + pencil.D.T if gyroscopic else pencil.D).max() == 0)


def _is_eye(M: Array) -> bool:
    """Whether M is the identity, as in coordinates of undamped modes."""
    return bool(np.abs(M - np.eye(len(M))).max() <= 1e-10)


class _Discs(NamedTuple):
    """Centres z (m,) that move by up to `drift` (m,), complex, either way; F bounds other terms; `axis` (m,) bounds Re f_ii."""

    z: Array
    drift: Array
    F: Array
    axis: Array

    @property
    def rest(self) -> Array:
        return np.asarray(self.F.sum(axis=1) - self.F.diagonal())

    def heights(self, at: Array) -> tuple[tuple[float, float], ...]:
        """The ranges of |Im λ| of some of the discs."""
        middle, half = np.abs(self.z.imag[at]), (np.abs(self.drift.imag) + self.F.sum(axis=1))[at]
        return tuple(zip((middle - half).tolist(), (middle + half).tolist(), strict=True))

    def reach(self, radius: Array) -> Array:
        """How far each disc may reach towards the axis, with `radius` (m,) from the entries off the diagonal."""
        return np.abs(self.drift.real) + self.axis + radius

    @property
    def apart(self) -> Array:
        """Smallest distance of the centres over the interval, minus f_ii and f_jj, (m, m); inf on its diagonal."""
        own = self.F.diagonal()
        found = np.abs(self.z[:, None] - self.z) - np.abs(self.drift[:, None] - self.drift) - own[:, None] - own
        np.fill_diagonal(found, np.inf)
        return np.asarray(found)


def _discs(z: Array, h: float, B: Array, extra: Array, towards: Array) -> _Discs | None:
    """The discs of an interval of half width h; None if they overflow.

    `extra` (m, m) bounds rounding and deviations from an affine A, `towards` (m,) the real part of its diagonal.
    """
    b = B.diagonal().copy()
    X = first_turn(z, B, h * np.abs(B))
    if h * np.abs(X).sum(axis=1).max() > 1 / 2:  # I - h|X| must be far from singular: at 1 its inverse may be infinite
        X = np.zeros_like(X)
    first = np.where(X != 0, 0.0, np.abs(B))
    np.fill_diagonal(first, 0.0)
    C, moved = B @ X - X * b, h * extra @ np.abs(X)
    G = h * first + h**2 * np.abs(C) + extra + moved
    if not np.isfinite(G).all():
        return None
    F = la.solve(np.eye(len(z)) - h * np.abs(X), G, check_finite=False)
    axis = h**2 * np.abs(C.diagonal().real) + towards + moved.diagonal() + h * np.einsum("ij,ji->i", np.abs(X), F)
    return _Discs(z, h * b, F, axis)


def isolated(F: Array, apart: Array) -> Array:
    """Radii τ_i r_i, r_i = Σ_{j≠i} f_ij, of discs that are clear of all others and hold one eigenvalue each, (m,); else inf.

    `apart` (m, m) are the least distances of the centres minus f_ii and f_jj, inf on its diagonal. With τ_i disc i has the radius
    f_ii + τ_i r_i, and the others f_jj + r_j - f_ji + f_ji/τ_i. The smallest τ_i that keeps it clear of each of them is the lower
    root of a quadratic equation.
    """
    rest, into = F.sum(axis=1) - F.diagonal(), F.T
    slack = apart - (rest - into)
    own = np.isinf(slack)
    with np.errstate(all="ignore"):
        root = np.sqrt(slack**2 - 4 * rest[:, None] * into)
        lower = np.where(own, 0.0, 2 * into / (slack + root)).max(axis=1) * (1 + 1e-6)
        upper = np.where(own, np.inf, (slack + root) / (2 * rest[:, None])).min(axis=1)
        clear = ((slack > 0) & ~np.isnan(root)).all(axis=1) & ((lower < upper) | (rest == 0))
        return np.where(clear, np.where(rest > 0, lower * rest, 0.0), np.inf)


def _touching(discs: _Discs, mirrored: bool) -> tuple[Array, Array]:
    """Which eigenvalues may leave, reach or cross the axis, and which stay on it, bool (m,) each."""
    none = np.zeros(len(discs.z), dtype=bool)
    rate, rest = np.abs(discs.z.real), discs.rest
    touch = rate <= discs.reach(rest)
    if not touch.any():
        return none, none
    # a group of overlapping plain discs holds as many eigenvalues as discs; if one touches the axis, all are in doubt
    links, doubtful, count = discs.apart <= rest[:, None] + rest, touch, 0
    while count < (count := int(np.count_nonzero(doubtful))):
        doubtful = doubtful | links[:, doubtful].any(axis=1)
    near = doubtful & (rate <= discs.reach(isolated(discs.F, discs.apart)))
    if not mirrored or not near.any():
        return near, none
    # a disc centred on the axis and clear of all others has one eigenvalue; with it the mirrored one, so they are the same
    off = np.where(near, rate + np.abs(discs.drift.real), 0.0)
    moved = _Discs(np.where(near, 1j * discs.z.imag, discs.z), np.where(near, 1j * discs.drift.imag, discs.drift),
                   discs.F + np.diag(off), discs.axis)
    stays = near & np.isfinite(isolated(moved.F, moved.apart))
    return near & ~stays, stays
