"""Floquet multipliers of a limit cycle, which show whether small disturbances grow.

    δẏ = (A + B g(t) Bᵀ) δy,  g = ∂f/∂v along the cycle (p, p),  δy(T) = Φ δy(0)

The linear part is constant, with known eigenvectors. The periodic part has rank p. Hence a step of Strang's splitting,
exp(Ah/2) exp(h B g Bᵀ) exp(Ah/2), costs O(m p) for each of the m columns of Φ. The steps are short where friction changes
between sliding and sticking. Φ is extrapolated from two or more step sizes (Romberg).

The orbit has finitely many harmonics and is not exactly the cycle: v̂ = Σ Y(ikω) f_k over many more harmonics differs from v
by ρ. The correction to the cycle follows from the linear equation that Φ solves, driven by ρ:

    ż = A z + B g (Bᵀz + ρ),  z(T) + ẏ δT = z(0),  ẏ(0)ᴴ z(0) = 0

An additional column of Φ gives z(T) for z(0) = 0. Another pass gives the cycle's speeds v + ρ + Bᵀz, correct to second order,
and Φ is computed for these speeds. The change of each multiplier by this correction and by the last extrapolation estimates its
error. The multiplier of a shift along the cycle is exactly 1. The error of its computed value is added to all error estimates.

Test: 450 random cycles of chains and their ROMs, both laws, 8 or more harmonics, compared with the cycle and its variation
integrated to 1e-12. Every multiplier was within its error estimate (`doubts`). The factors were fitted to this test: they are
empirical, not bounds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la
from scipy.interpolate import CubicSpline
from scipy.special import exprel

from femsub.checks import Array
from femsub.modes import match
from femsub.motion.cycles.balance import Orbit, coefficients, power_of_two, samples_of
from femsub.motion.cycles.compliance import Fractions
from femsub.motion.nonlinear_model import Sliding


@dataclass(frozen=True, eq=False, repr=False)
class Multipliers:
    """Floquet multipliers μ of a cycle, the largest first.

    Attributes
    ----------
    values : ndarray of complex, shape (m,)
        All multipliers without the trivial one.
    doubts : ndarray, shape (m,)
        Error estimate of each multiplier. It is the sum of three times its change by the correction of the orbit and by the
        last extrapolation, a tenth of the largest such change of any multiplier, and ten times `error`. Infinite if the
        orbit is too far from a cycle.
    trivial : complex
        The multiplier that is 1 in exact arithmetic.
    """

    values: Array
    doubts: Array
    trivial: complex

    @property
    def error(self) -> float:
        """|μ - 1| of the trivial multiplier."""
        return float(abs(self.trivial - 1))

    @property
    def doubt(self) -> float:
        """The largest error estimate, the trivial multiplier included."""
        return float(max(self.error, self.doubts.max(initial=0.0)))

    @cached_property
    def is_stable(self) -> bool | None:
        """Whether all |μ| < 1; None if the error estimates leave it undecided."""
        size = np.abs(self.values)
        if (size - self.doubts > 1).any():
            return False
        return True if (size + self.doubts < 1).all() else None

    @property
    def unstable(self) -> int:
        """The number of multipliers outside the unit circle by more than their error estimate."""
        return int(np.count_nonzero(np.abs(self.values) - self.doubts > 1))

    def __repr__(self) -> str:
        first = self.values[0] if len(self.values) else np.nan
        words = {True: "stable", False: f"unstable ({self.unstable} outside of the unit circle)", None: "undecided"}
        return f"Multipliers: {words[self.is_stable]}, largest {first:.6g}, |μ| = {abs(first):.6g}; off by up to {self.doubt:.0e}"


def multipliers(contact: Sliding, flexibility: Fractions, orbit: Orbit, *, steps: int = 1024, most: int = 32768,
                tol: float = 1e-4) -> Multipliers:
    """The multipliers of the cycle near an orbit of a dense model.

    The first two passes have `steps` and 2 `steps` steps per period. The number is doubled until the estimated error of the
    leading multipliers is at most `tol`, or a pass has `most` steps. A pass costs O(steps n²).
    """
    waves = _Waves(contact, flexibility, orbit)
    coarse, before, last = _passage(contact, flexibility, waves.course(steps))[0], None, np.inf
    while True:
        fine = _passage(contact, flexibility, waves.course(2 * steps))[0]
        rough, best = fine, fine + (fine - coarse) / 3
        if before is not None:
            rough, best = best, best + (best - before) / 15
        before = fine + (fine - coarse) / 3
        found, plain = _sorted(np.linalg.eigvals(best[:, :-1])), np.linalg.eigvals(rough[:, :-1])
        at = int(np.argmin(np.abs(found - 1)))
        # a tenth of the last extrapolation's change is taken as the error that remains
        wrong = 0.1 * max(float(np.abs(plain - value).min()) / max(1.0, abs(value)) for value in [*found[:4], found[at]])
        trivial = float(abs(found[at] - 1))
        # if shorter steps do not bring it nearer to 1, the remaining error is that of the orbit
        done = wrong <= tol and (trivial <= tol or trivial > 0.5 * last)
        last = trivial
        if done or 2 * steps >= most:
            break
        steps, coarse = 2 * steps, fine
    corrected = _corrected(contact, flexibility, waves, best, steps)
    Phi = best if corrected is None else best + _passage(contact, flexibility, corrected)[0] - coarse
    values = _sorted(np.linalg.eigvals(Phi[:, :-1]))
    at = int(np.argmin(np.abs(values - 1)))
    to = match(values, found)[1]
    moved, stepped = np.abs(values - found[to]), np.abs(found - plain[match(found, plain)[1]])[to]
    # The factors were fitted to the test above. 3: second-order terms, and extrapolation beside a kink of the law. A tenth of the
    # largest change is added to all. 10: the error of the trivial multiplier is of second order after the correction.
    changed = moved + stepped
    doubts = 3 * (changed + 0.1 * changed.max()) + 10 * abs(values[at] - 1)
    if corrected is None:
        doubts = np.full(len(values), np.inf)
    return Multipliers(np.delete(values, at), np.delete(doubts, at), complex(values[at]))


def _sorted(values: Array) -> Array:
    return values[np.argsort(-np.abs(values), kind="stable")]


@dataclass(frozen=True, eq=False)
class _Course:
    """N steps h (N,) of one period with their midpoints τ (N,), in units of the period, and v and ρ (p, N) at the midpoints."""

    tau: Array
    h: Array
    v: Array
    gap: Array
    period: float


class _Waves:
    """v(τ), v'(τ) and ρ(τ) of an orbit, from a fine FFT with cubic interpolation."""

    def __init__(self, contact: Sliding, flexibility: Fractions, orbit: Orbit) -> None:
        self.contact, self.orbit = contact, orbit
        count = power_of_two(max(32 * orbit.harmonics, 8192))
        v = orbit.samples(count)
        self.f = coefficients(contact.exerted(v, v), count // 4)[1:]
        self.s = 1j * orbit.omega * np.arange(1, len(self.f) + 1)
        answer = np.einsum("kij,kj->ki", flexibility.mobility(self.s)[0], self.f)
        answer[:orbit.harmonics] -= orbit.v
        tau = np.linspace(0, 1, count + 1)
        self.v, self.gap = (CubicSpline(tau, np.hstack([wave, wave[:, :1]]), axis=1, bc_type="periodic")
                            for wave in (v, samples_of(answer, count)))

    def course(self, steps: int) -> _Course:
        # the steps 0 = τ_0 < … < τ_steps = 1 are finer where g changes
        count = power_of_two(max(8 * self.orbit.harmonics, 4096))
        v = self.orbit.samples(count)
        g = self.contact.tangents(v, v)[1].reshape(-1, count)
        change = np.abs(np.diff(g, append=g[:, :1], axis=1)).sum(axis=0)
        # the square root places steps on both sides of a jump, where most of the error arises
        weight = np.sqrt(change) if change.any() else np.ones(count)
        kernel = max(3, count // 512)
        weight = np.convolve(np.tile(weight, 3), np.ones(kernel) / kernel, mode="same")[count:2 * count]
        density = 0.4 / count + 0.6 * weight / weight.sum()
        along = np.concatenate([[0.0], np.cumsum(density)])
        edges = np.interp(np.linspace(0, along[-1], steps + 1), along, np.linspace(0, 1, count + 1))
        tau = (edges[1:] + edges[:-1]) / 2
        return _Course(tau, np.diff(edges), self.v(tau), self.gap(tau), 2 * np.pi / self.orbit.omega)

    def rate(self, flexibility: Fractions) -> Array:
        """ẏ(0) (m,) in coordinates of the eigenvectors of A."""
        values, force = flexibility.found.values[:, None], flexibility.into @ self.f.T
        other = flexibility.into @ self.f.conj().T
        return (force * self.s / (self.s - values)).sum(axis=1) + (other * self.s / (self.s + values)).sum(axis=1)


def _passage(contact: Sliding, flexibility: Fractions, course: _Course, Z: Array | None = None) -> tuple[Array, Array]:
    """Z(T) (m, k) from Z(0) = `Z`, in the eigenvectors of A, and Bᵀz + ρ (p, N) of the last column in the middle of each step.

    ρ drives the last column. By default Z(T) is Φ, with z(T) for z(0) = 0 as an additional last column, (m, m + 1).

    An impulse U E_l s_l at t_l adds V exp(A (t_j - t_l)) U E_l s_l to s_j = V z(t_j) + ρ_j. One triangular system gives all s of
    a block of steps. Its matrix is V exp(A t_j) times exp(-A t_l) U E_l, with t from the start of the block.
    """
    h, values, W = course.h * course.period, flexibility.found.values, flexibility.w
    E = _impulses(contact.tangents(course.v, course.v)[1] * h, W.T @ W)
    U, V, m, p, steps = flexibility.into, flexibility.out, len(values), len(W.T), len(h)
    t = np.append(np.cumsum(h) - h / 2, h.sum())  # impulses act in the middle of the steps; the last entry is the end
    Z = np.exp(t[0] * values)[:, None] * (np.eye(m, m + 1) if Z is None else Z)
    speeds = np.empty((steps, p), dtype=complex)
    decay, most = t * np.abs(values.real).max(), np.log(np.finfo(float).max) / 2  # in a block beyond it exp(-A t) overflows
    i = 0
    while i < steps:
        # at least 64 unknowns: fewer take as much time
        last = min(steps, i + max(1, max(64, m) // p), max(i + 1, int(np.searchsorted(decay, decay[i] + most))))
        D, count = np.exp((t[i:last + 1] - t[i])[:, None] * values), last - i
        out = (V * D[:-1, None]).reshape(-1, m)
        into = np.moveaxis((U / D[:-1, :, None]) @ E[i:last], 1, 0).reshape(m, -1)
        S = (out @ Z).reshape(count, p, -1)
        S[:, :, -1] += course.gap[:, i:last].T
        coupled = -(out @ into)
        coupled.reshape(count, p, count, p)[np.arange(count), :, np.arange(count)] = 0.0
        S = la.solve_triangular(coupled, S.reshape(count * p, -1), lower=True, unit_diagonal=True, check_finite=False)
        speeds[i:last] = S[:, -1].reshape(count, p)
        Z = D[-1][:, None] * (Z + into @ S)
        i = last
    return Z, (speeds + np.einsum("ab,ibc,ic->ia", W.T @ W, E, speeds) / 2).T  # with half of the impulse


def _corrected(contact: Sliding, flexibility: Fractions, waves: _Waves, whole: Array, steps: int) -> _Course | None:
    """The cycle near the orbit, correct to second order; None if it is too far away. `whole` is Z(T) from `_passage`."""
    course, m = waves.course(steps), len(whole)
    rate = waves.rate(flexibility)
    bordered = np.vstack([np.hstack([np.eye(m) - whole[:, :-1], -rate[:, None]]), np.append(rate.conj(), 0.0)])
    try:
        found = la.solve(bordered, np.append(whole[:, -1], 0.0))
    except la.LinAlgError:
        return None
    z, longer = found[:-1], float(found[-1].real)
    change = _passage(contact, flexibility, course, z[:, None])[1].real
    change += course.tau * (longer / course.period) * waves.v(course.tau, 1)
    far = np.sqrt((np.square(change) @ course.h).sum() / (np.square(course.v) @ course.h).sum())
    if not far + abs(longer) / course.period <= 0.05:  # farther away the linear correction decides nothing
        return None
    return _Course(course.tau, course.h, course.v + change, 0 * course.gap, course.period + longer)


def _impulses(strength: Array, S: Array) -> Array:
    """E (m, p, p) with exp(U G V) = I + U E V, VU = S, and G (p, p, m) at m times: E = φ(GS) G, φ(x) = (eˣ - 1)/x."""
    p, G = len(S), np.moveaxis(strength, -1, 0)
    if p == 1:
        return exprel(G * S) * G
    whole = np.zeros((len(G), 2 * p, 2 * p))
    whole[:, :p, :p], whole[:, :p, p:] = G @ S, G
    return la.expm(whole)[:, :p, p:]
