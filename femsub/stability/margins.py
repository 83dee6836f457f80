"""The modes at points of a map: which modes grow, and margins that change their sign where a mode begins to grow.

A margin is continuous in the parameters: Re λ, or for two undamped modes, which meet on the axis, the discriminant of both. The
k-th largest margin is continuous as well, also where modes change places. So the number of growing eigenvalues changes between
two points exactly where the k-th margin has a root, whichever mode that is.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg as la

from femsub.algebra import BLOCK, WIDE, by_threads, one_thread
from femsub.checks import EPS, Array
from femsub.model import Affine, Pencil, upper, within
from femsub.modes import REGULAR, ComplexModes, complex_modes


class PointModes(NamedTuple):
    """The modes at one point.

    `values` are λ with Im λ ≥ 0 in the band, without rigid motion (k,). `votes` (k,) are 1 if a mode grows, 0 if that is
    undecided, else -1. `margins` and `heights` (w,) are the margins of all eigenvalues and |Im λ|, a pair twice, the largest
    first. `radius` is the largest radius over |λ|, NaN if it is not known. `whole`: whether these are all modes.
    """

    values: Array
    votes: Array
    margins: Array
    heights: Array
    radius: float = np.nan
    whole: bool = True

    @property
    def number(self) -> int:
        """The number of modes that certainly grow."""
        return int((self.votes > 0).sum())

    @property
    def undecided(self) -> int:
        return int((self.votes == 0).sum())

    @property
    def growth(self) -> float:
        return float(self.values.real.max(initial=-np.inf))

    @property
    def nearness(self) -> float:
        """How near a mode is to the axis: minus the least |Re λ|."""
        return -float(np.abs(self.values.real).min(initial=np.inf))

    @property
    def growing(self) -> int:
        """The number of eigenvalues that certainly grow; a pair counts twice."""
        return int((self.margins > 0).sum())

    @property
    def omega(self) -> float:
        """Im λ of the mode of largest growth."""
        return abs(float(self.values[int(self.values.real.argmax())].imag)) if len(self.values) else np.nan

    def margin(self, k: int) -> float:
        """The k-th largest margin, k from 0; beyond the last margin, the smallest one, and at most -1."""
        return float(self.margins[k]) if k < len(self.margins) else float(self.margins.min(initial=-1.0))


def _ranked(values: Array, votes: Array, margins: Array, heights: Array, radius: float = np.nan) -> PointModes:
    """The modes with their margins in order, pairs twice. Undecided modes count as not growing."""
    twice = np.repeat(np.arange(len(margins)), np.where(heights > 0, 2, 1))
    order = twice[np.argsort(-margins[twice], kind="stable")]
    return PointModes(values, votes, margins[order], heights[order], radius)


def _spectrum(values: Array, votes: Array, radius: float = np.nan) -> PointModes:
    tiny = np.finfo(float).tiny
    return _ranked(values, votes, np.where(votes != 0, values.real, -np.maximum(np.abs(values.real), tiny)), np.abs(values.imag),
                   radius)


def point_modes(modes: ComplexModes, band: tuple[float, float]) -> PointModes:
    at = np.flatnonzero(upper(modes.eigenvalues) & ~modes.rigid & within(modes.eigenvalues, band))
    votes = np.array([0 if vote is None else -1 if vote else 1 for vote in modes.stable], dtype=int)[at]
    return _spectrum(modes.eigenvalues[at], votes)


def _undamped(squares: Array, band: tuple[float, float]) -> PointModes:
    """The modes of λ² (n,). A mode grows if λ² is complex or positive; otherwise it is on the axis.

    Two real λ² meet where their difference is 0, and are complex beyond: minus the square of the difference is their margin. A
    single λ² diverges above 0; its margin is λ² times the largest |λ²|, which gives the same unit.
    """
    size, least = float(np.abs(squares).max()), EPS * len(squares)
    real, pair = np.sort(squares[squares.imag == 0].real), squares[squares.imag > 0]
    real = real[np.abs(real) > least * size]  # rigid motion has 0
    middle = (real[1:] + real[:-1]) / 2
    values = np.sqrt(np.concatenate([pair, real.astype(complex)]))
    votes = np.concatenate([np.where(np.abs(pair.imag) > least**0.5 * size, 1, 0), np.where(real > 0, 1, -1)])
    margins = np.concatenate([4 * pair.imag**2 * np.where(votes[:len(pair)] > 0, 1, -1), -np.diff(real)**2, real * size])
    heights = np.concatenate([np.abs(values[:len(pair)].imag), np.sqrt(np.maximum(-middle, 0.0)), np.zeros(len(real))])
    kept, inside = within(values, band), (heights >= band[0]) & (heights <= band[1])
    return _ranked(values[kept], votes[kept], margins[inside], heights[inside])


def modes_in(pencil: Pencil, band: tuple[float, float]) -> ComplexModes:
    """The complex modes in a band; all modes if the band has no end."""
    return complex_modes(pencil, band=band if np.isfinite(band[1]) else None)


def between(ends: Sequence[Array], t: float) -> Array:
    """A point on a straight line between two ends. Rounding does not move it outside, where a `BoxModel` would refuse it."""
    return np.asarray(np.clip(ends[0] + t * (ends[1] - ends[0]), np.minimum(*ends), np.maximum(*ends)))


class ModesAt:
    """Computes the modes at points, some or many at once, and counts the eigenproblems solved."""

    def __init__(self, model: Any, at: Callable[[Mapping[str, float]], Pencil], names: Sequence[str],
                 band: tuple[float, float], ends: Sequence[Pencil], say: Callable[[str], None], fine: float = 1e-6) -> None:
        self.at, self.names, self.band, self.say, self.solved, self.fine = at, names, band, say, 0, fine
        self.modes: Any = getattr(model, "modes", None) if isinstance(model, Affine) else None  # with the radius of each λ
        self.eigenvalues: Any = getattr(model, "eigenvalues", None)
        self.small = ends[0].size <= WIDE
        self.together = self.modes is None and self.small and all(
            one.freed is None and np.linalg.cond(one.dense().M) < REGULAR for one in ends)

    def each(self, call: Callable[[Any], Any], things: Sequence[Any]) -> list[Any]:
        """The results of a function for each of some things, computed on all cores."""
        return list(by_threads(call, things))

    def __call__(self, points: Array) -> list[PointModes]:
        """The modes at points (m, q)."""
        found: list[PointModes | None] = []
        parts = [points[first:first + BLOCK] for first in range(0, len(points), BLOCK)] if self.together else points[:, None]
        with one_thread(True):
            solve: Callable[[Array], Sequence[PointModes | None]] = self._many if self.together else self._one
            for part in by_threads(solve, parts) if self.together or self.modes else map(solve, parts):
                found += part
                self.say(f"{len(found)} of {len(points)} points")
            self.solved += len(points)
            return [self._one(p[None])[0] if one is None else one for one, p in zip(found, points, strict=True)]

    def on_axis(self, ends: Sequence[Array], t: float, omega: float, rounds: int = 12) -> tuple[float, float, bool] | None:
        """The place between two points, near a guess, where iω is an eigenvalue: t, ω in the band, and whether Re λ rises.

        Newton's method for yᴴP(iω; t)x = 0 with vectors of inverse iteration, and ∂P/∂t from both ends. It takes some dense
        solves and no eigenproblem. None if it does not converge in `rounds` steps, for large models, and for undamped models,
        whose modes coalesce on the axis.
        """
        def matrices(p: Array) -> list[Array]:
            pencil = self.at(dict(zip(self.names, p.tolist(), strict=True))).dense()
            return [pencil.K, pencil.D, pencil.M]

        if not self.small:
            return None
        first, last = (matrices(end) for end in ends)
        if not (first[1].any() and last[1].any()):
            return None
        x, y = np.random.default_rng(len(first[0])).standard_normal((2, len(first[0])))
        for _ in range(rounds):
            now, power = matrices(between(ends, t)), (1j * omega) ** np.arange(3)
            P, changes = (sum(c * A for c, A in zip(power, parts, strict=True))
                          for parts in (now, [B - A for A, B in zip(first, last, strict=True)]))
            with np.errstate(all="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore", la.LinAlgWarning)  # P is singular where it should be
                factor = la.lu_factor(P, check_finite=False)
                x, y = (la.lu_solve(factor, one, trans, check_finite=False) for one, trans in ((x, 0), (y, 2)))
                x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
                off, turn, change = (y.conj() @ (A @ x) for A in (P, now[1] + 2j * omega * now[2], changes))
                # λ = iω - off / turn at this t, and dλ/dt = -change / turn
                rate = -change / turn
                step = (off / turn).real / rate.real
                up = (rate * step - off / turn).imag if omega else 0.0
                t, omega = np.clip(t + step, 0.0, 1.0), omega + up
            if not (self.band[0] <= omega <= self.band[1] and np.isfinite(step)):
                return None
            if abs(step) <= self.fine and abs(up) <= self.fine * omega:
                return float(t), float(omega), bool(rate.real > 0)
        return None

    def whole(self, point: Array) -> ComplexModes:
        """The modes at one point (q,) with their shapes and error bars."""
        p = dict(zip(self.names, point.tolist(), strict=True))
        return self.modes(**p) if self.modes else modes_in(self.at(p), self.band)

    def _one(self, points: Array) -> list[PointModes]:
        """The modes at one point (1, q); a `BoxModel` decides by its radii."""
        if not self.modes:
            return [point_modes(self.whole(points[0]), self.band)]
        values, radius, whole = self.eigenvalues(dict(zip(self.names, points[0].tolist(), strict=True)))
        at = np.flatnonzero(within(values, self.band))
        values, radius = values[at], radius[at]
        votes = np.where(np.abs(values.real) <= radius, 0, np.sign(values.real).astype(int))
        size = np.abs(values)
        largest = float(np.max(np.divide(radius, size, out=np.zeros_like(size), where=size > 0), initial=0.0))
        return [_spectrum(values, votes, largest)._replace(whole=whole)]

    def _many(self, points: Array) -> list[PointModes | None]:
        """The modes from all eigenvalues, without vectors; None if rounding may move an eigenvalue across the axis."""
        pencils = [self.at(dict(zip(self.names, p, strict=True))).dense() for p in points.tolist()]
        M, D, K = (np.stack([getattr(one, name) for one in pencils]) for name in "MDK")
        n, still = M.shape[1], ~D.any(axis=(1, 2))
        try:
            B = -np.linalg.solve(M, np.concatenate([K, D], axis=2))
        except np.linalg.LinAlgError:
            return [None] * len(points)
        state = np.concatenate([np.broadcast_to(np.eye(n, 2 * n, n), (len(B), n, 2 * n)), B], axis=1)
        squares, every = iter(np.linalg.eigvals(B[still, :, :n])), iter(np.linalg.eigvals(state[~still]))
        found: list[PointModes | None] = []
        for undamped in still:
            if undamped:
                found.append(_undamped(next(squares), self.band))
                continue
            values = next(every).astype(complex)
            near = EPS**0.5 * np.abs(values).max()  # rounding may move even a double eigenvalue so far
            values = values[(values.imag >= 0) & within(values, self.band)]
            found.append(None if (np.abs(values.real) <= near).any() else _spectrum(values, np.sign(values.real).astype(int)))
        return found
