"""Where stability is lost over one parameter: of a small model, and of a large one near a loss of a small one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from femsub.errors import NotConvergedError
from femsub.model import Affine, in_band
from femsub.modes import ComplexModes
from femsub.modes.quadratic.complex_modes import complex_modes

GRID = 10  # values of μ between which the first loss is searched
FINE = 1e-6  # of the range: how exactly a loss is located
CLOSE = 0.02  # of ω: the band in which the full model's mode is followed
STEPS = 12  # of the secant method
BELOW = 1e-4  # relative precision of the full model's critical μ


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

    (name,) = model.parameters

    def rate(value: float) -> float:
        return growth(complex_modes(model.at(**{name: value}), band=(band[0], band[1])), band)[0]

    values = np.linspace(mu[0], mu[1], GRID + 1)
    before = values[0]
    for value in values:
        if rate(value) > 0:
            at = float(brentq(rate, before, value, xtol=FINE * (mu[1] - mu[0]))) if value > before else float(value)
            return at, growth(complex_modes(model.at(**{name: at}), band=(band[0], band[1])), band)[1]
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
    (name,) = model.parameters

    def mode(value: float, near: float) -> complex:
        found = complex_modes(model.at(**{name: value}), band=((1 - CLOSE) * near, (1 + CLOSE) * near)).eigenvalues
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
