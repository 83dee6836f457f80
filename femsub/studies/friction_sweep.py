"""Models under friction over μ: the pencil as a function of μ, where stability is lost, and errors of reduced models."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from femsub.checks import Array
from femsub.errors import NotConvergedError
from femsub.model import Affine, Contact, Substructure, in_band
from femsub.modes import ComplexModes, match
from femsub.modes.quadratic.complex_modes import complex_modes

GRID = 10  # values of μ between which the first loss is searched
FINE = 1e-6  # of the range: how exactly a loss is located
CLOSE = 0.02  # of ω: the band in which the full model's mode is followed
STEPS = 12  # of the secant method
BELOW = 1e-4  # relative precision of the full model's critical μ


def over_mu(model: Substructure, contacts: Sequence[Contact]) -> Affine:
    """The pencil as a function of μ: M, D₀ + μ D₁, K₀ + μ K₁. It is exact, since Coulomb friction is linear in μ."""
    at = [model.linearised([replace(contact, mu=value) for contact in contacts]) for value in (0.0, 1.0)]  # type: ignore[type-var]
    return Affine(at[0].M, [(1.0, at[0].D), ("mu", at[1].D - at[0].D)], [(1.0, at[0].K), ("mu", at[1].K - at[0].K)])


def growth(modes: ComplexModes, band: Sequence[float]) -> tuple[float, float]:
    """The largest Re λ in the band, and its ω."""
    values = modes.eigenvalues[in_band(modes.eigenvalues, (band[0], band[1]))]
    if not len(values):
        return -np.inf, np.nan
    top = values[np.argmax(values.real)]
    return float(top.real), float(top.imag)


def first_loss(model: Affine, mu: Sequence[float], band: Sequence[float]) -> tuple[float, float]:
    """The first μ of a small model at which a mode in the band begins to grow, and its ω; (inf, nan) if there is none.

    The range is looked at in GRID steps. A loss that is regained within one step is not seen: `critical_value` excludes that.
    """
    from scipy.optimize import brentq

    def rate(value: float) -> float:
        return growth(complex_modes(model.at(mu=value), band=(band[0], band[1])), band)[0]

    values = np.linspace(mu[0], mu[1], GRID + 1)
    before = values[0]
    for value in values:
        if rate(value) > 0:
            at = float(brentq(rate, before, value, xtol=FINE * (mu[1] - mu[0]))) if value > before else float(value)
            return at, growth(complex_modes(model.at(mu=at), band=(band[0], band[1])), band)[1]
        before = value
    return np.inf, np.nan


def same_loss(model: Affine, mu: float, omega: float) -> tuple[float, float]:
    """The μ at which the mode near ω of a large model begins to grow, from that of a reduced model; and its ω.

    By the secant method, with one search of a narrow band at each step.

    Raises
    ------
    NotConvergedError
        The model has no such mode there, or it does not lose its stability nearby.
    """
    def mode(value: float, near: float) -> complex:
        found = complex_modes(model.at(mu=value), band=((1 - CLOSE) * near, (1 + CLOSE) * near)).eigenvalues
        if not len(found):
            raise NotConvergedError(f"the full model has no mode near ω = {near:.6g} at mu = {value:.4g}")
        return complex(found[np.argmax(found.real)])

    before, at = mu, mu * (1 + 1e-2)
    last = mode(before, omega)
    for _ in range(STEPS):
        now = mode(at, last.imag)
        if now.real == last.real:
            break
        step = -now.real * (at - before) / (now.real - last.real)
        before, last = at, now
        at = at + float(np.clip(step, -0.1 * mu, 0.1 * mu))
        if abs(step) <= BELOW * mu:
            return at, float(now.imag)
    raise NotConvergedError(f"the mode of the full model near ω = {omega:.6g} does not lose its stability near mu = {mu:.4g}")


@dataclass(frozen=True)
class FrictionRow:
    """A reduced model against the full one.

    Attributes
    ----------
    method, modes, size
    seconds : float
        To reduce, and to solve at one μ.
    solving : float
        Of these, to solve at one μ.
    error, growth_error : float
        The largest |Δλ| and |Δ Re λ| relative to |λ|, over all modes in the band at all μ of the full model that have a
        counterpart; NaN if none has.
    missed, invented : int
        Unstable modes of the full model that are stable in this one, and the other way round.
    mu, mu_error : float
        The critical μ, and its relative error.
    """

    method: str
    modes: int
    size: int
    seconds: float
    solving: float
    error: float
    growth_error: float
    missed: int
    invented: int
    mu: float
    mu_error: float

    def flat(self) -> dict[str, Any]:
        """For tables and files."""
        return dict(vars(self))


def compared(method: str, modes: int, model: Affine, seconds: float, full: dict[float, ComplexModes], mu: Sequence[float],
             band: Sequence[float], critical: float) -> FrictionRow:
    """The row of one reduced model, solved at the values of μ at which the full one was."""
    error, rate, missed, invented, took = -np.inf, -np.inf, 0, 0, []
    for value, exact in full.items():
        start = time.perf_counter()
        found = complex_modes(model.at(mu=value), band=(band[0], 1.05 * band[1]))
        took.append(time.perf_counter() - start)
        ours, bars = _inside(exact, band)
        theirs = found.eigenvalues[found.eigenvalues.imag > 0]
        at, to = match(ours, theirs)
        error = max(error, float((np.abs(theirs[to] - ours[at]) / np.abs(ours[at])).max(initial=-np.inf)))
        rate = max(rate, float((np.abs(theirs[to].real - ours[at].real) / np.abs(ours[at])).max(initial=-np.inf)))
        unstable = ours.real > bars
        missed += int((unstable[at] & (theirs[to].real <= 0)).sum()) + int(unstable.sum() - unstable[at].sum())
        grows = (theirs.real > 0) & in_band(theirs, (band[0], band[1]))
        invented += int(grows.sum() - (grows[to] & (ours[at].real > 0)).sum())
    own = first_loss(model, mu, band)[0]
    solving = float(np.median(took)) if took else np.nan
    error, rate = (value if np.isfinite(value) else np.nan for value in (error, rate))
    return FrictionRow(method, modes, model.size, seconds + solving, solving, error, rate, missed, invented, own,
                       abs(own - critical) / critical if np.isfinite(own + critical) else np.nan)


def _inside(modes: ComplexModes, band: Sequence[float]) -> tuple[Array, Array]:
    keep = in_band(modes.eigenvalues, (band[0], band[1])) & (modes.eigenvalues.imag > 0)
    return modes.eigenvalues[keep], modes.error_bar[keep]
