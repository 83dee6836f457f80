"""Floquet multipliers of a limit cycle: which small disturbances of it grow.

    δẏ = (A + B diag(g(t)) Bᵀ) δy,  g = df/dv along the cycle (p,),  δy(T) = Φ δy(0)

The linear part is constant and is known by its eigenvectors, the periodic part has rank p. Hence a step of Strang's splitting,
exp(Ah/2) exp(h B g Bᵀ) exp(Ah/2), costs O(m p) for each of the m columns of Φ, and its steps may be as uneven as g is: they
are short where friction changes from sliding to sticking. Two and more step sizes give the extrapolated Φ and its error
(Romberg). One multiplier is 1, that of a shift along the cycle: how far the computed one is from 1 says how far to trust the
others.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la

from femsub.balance import Orbit
from femsub.compliance import Fractions
from femsub.contacts import Sliding
from femsub.pencil import Array

STEPS = 1024  # of the first of two passes
MOST = 32768
TRUSTED = 1e-4  # error of the leading multipliers by the steps at which they are short enough
LEFT = 0.1  # of the last extrapolation's change is taken for what is still wrong
FAINT = 0.05  # beyond it nothing is said about stability


@dataclass(frozen=True, eq=False, repr=False)
class Multipliers:
    """μ of a cycle, the largest first.

    Attributes
    ----------
    values : ndarray of complex, shape (m,)
        Without the trivial one.
    trivial : complex
        The one that is 1 in exact arithmetic.
    discretisation : float
        Estimated error of the leading multipliers by the finite steps: a tenth of what the extrapolation changed.
    steps : int
    """

    values: Array
    trivial: complex
    discretisation: float
    steps: int

    @property
    def error(self) -> float:
        """|μ - 1| of the trivial multiplier."""
        return float(abs(self.trivial - 1))

    @property
    def doubt(self) -> float:
        """By how much the others may be off: the larger of `error`, which also knows how good the orbit is, and the steps'."""
        return max(self.error, self.discretisation)

    @cached_property
    def is_stable(self) -> bool | None:
        """All |μ| < 1; None within `doubt`."""
        doubt = self.doubt
        leading = float(np.abs(self.values).max(initial=0.0))
        if doubt > FAINT or abs(leading - 1) <= doubt:
            return None
        return leading < 1

    @property
    def unstable(self) -> int:
        """How many multipliers lie outside of the unit circle, by more than the error."""
        return int(np.count_nonzero(np.abs(self.values) > 1 + self.doubt))

    def __repr__(self) -> str:
        first = self.values[0] if len(self.values) else np.nan
        words = {True: "stable", False: f"unstable ({self.unstable} outside of the unit circle)", None: "undecided"}
        return f"Multipliers: {words[self.is_stable]}, largest {first:.6g}, |μ| = {abs(first):.6g}; trivial one off by " \
               f"{self.error:.0e}"


def multipliers(contact: Sliding, flexibility: Fractions, orbit: Orbit, *, steps: int = STEPS) -> Multipliers:
    """The multipliers of an orbit of a dense model, with steps halved until they are right to 1e-4 as far as the steps go."""
    coarse, before, last = _monodromy(contact, flexibility, orbit, steps), None, np.inf
    while True:
        fine = _monodromy(contact, flexibility, orbit, 2 * steps)
        rough, best = fine, fine + (fine - coarse) / 3
        if before is not None:
            rough, best = best, best + (best - before) / 15
        before = fine + (fine - coarse) / 3
        found, plain = _sorted(np.linalg.eigvals(best)), np.linalg.eigvals(rough)
        at = int(np.argmin(np.abs(found - 1)))
        wrong = LEFT * max(float(np.abs(plain - value).min()) / max(1.0, abs(value)) for value in [*found[:4], found[at]])
        trivial = float(abs(found[at] - 1))
        # where shorter steps no longer bring it nearer to 1, the orbit's own error is what is left
        done = wrong <= TRUSTED and (trivial <= TRUSTED or trivial > 0.5 * last)
        last = trivial
        if done or 2 * steps >= MOST:
            return Multipliers(np.delete(found, at), complex(found[at]), wrong, 2 * steps)
        steps, coarse = 2 * steps, fine


def _sorted(values: Array) -> Array:
    return values[np.argsort(-np.abs(values), kind="stable")]


def _monodromy(contact: Sliding, flexibility: Fractions, orbit: Orbit, steps: int) -> Array:
    """Φ (m, m) in the eigenvectors of A, over steps of which each sees the same change of g."""
    edges = _edges(contact, orbit, steps)
    h = np.diff(edges)
    period = 2 * np.pi / orbit.omega
    g = contact.tangent(_values(orbit, (edges[1:] + edges[:-1]) / 2))
    U, V, S = flexibility.into, flexibility.out, flexibility.w.T @ flexibility.w
    E = _impulses(g * (h * period), S)
    after = 0.5 * period * np.append(h[:-1] + h[1:], h[-1])  # half of this step and half of the next
    Z = np.diag(np.exp(0.5 * h[0] * period * flexibility.found.values))
    for i in range(len(h)):
        Z += U @ (E[i] @ (V @ Z))
        Z *= np.exp(after[i] * flexibility.found.values)[:, None]
    return Z


def _impulses(strength: Array, S: Array) -> Array:
    """E (m, p, p) with exp(U G V) = I + U E V, VU = S, G = diag(strength): E = φ(GS) G, φ(x) = (eˣ - 1)/x."""
    if len(S) == 1:
        x = strength[0] * S[0, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(np.abs(x) > 1e-300, np.expm1(x) / x, 1.0).reshape(-1, 1, 1) * strength[0].reshape(-1, 1, 1)
    p, m = strength.shape
    whole = np.zeros((m, 2 * p, 2 * p))
    whole[:, :p, :p] = strength.T[:, :, None] * S
    whole[:, np.arange(p), p + np.arange(p)] = strength.T
    return la.expm(whole)[:, :p, p:]


def _edges(contact: Sliding, orbit: Orbit, steps: int) -> Array:
    """0 = τ_0 < … < τ_steps = 1 of a period, finer where g changes; a quarter of the steps is spread evenly."""
    count = 2 ** int(np.ceil(np.log2(max(8 * orbit.harmonics, 4096))))
    g = contact.tangent(orbit.samples(count))
    change = np.abs(np.diff(np.hstack([g, g[:, :1]]), axis=1)).sum(axis=0)
    total = float(change.sum())
    # the square root spreads steps over the flanks of a jump, where most of the error is made
    weight = np.sqrt(change) / np.sqrt(change).sum() if total > 0 else np.full(count, 1 / count)
    kernel = max(3, count // 512)
    weight = np.convolve(np.tile(weight, 3), np.ones(kernel) / kernel, mode="same")[count:2 * count]
    density = 0.4 / count + 0.6 * weight / weight.sum()
    along = np.concatenate([[0.0], np.cumsum(density)])
    return np.interp(np.linspace(0, along[-1], steps + 1), along, np.linspace(0, 1, count + 1))


def _values(orbit: Orbit, tau: Array) -> Array:
    """v at times τ of one period (in periods), (p, m), by a fine FFT and cubic interpolation in between."""
    from scipy.interpolate import CubicSpline

    count = 2 ** int(np.ceil(np.log2(max(32 * orbit.harmonics, 8192))))
    v = orbit.samples(count)
    return CubicSpline(np.linspace(0, 1, count + 1), np.hstack([v, v[:, :1]]), axis=1, bc_type="periodic")(tau)
