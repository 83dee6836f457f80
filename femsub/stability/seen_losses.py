"""Losses of stability of a model of any size: by `critical_value`, or of one too large for it those that `track` has seen."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from femsub.checks import Tally
from femsub.modes import ComplexModes
from femsub.modes.quadratic.complex_modes import complex_modes
from femsub.stability.critical_value import LARGEST, CriticalValue, critical_value
from femsub.stability.crossings import Crossing, fed_by

if TYPE_CHECKING:
    from femsub.model import Affine
    from femsub.stability.tracking import Tracked

HALVINGS = 20  # of the step between two values of `track`
BESIDE = 1e-3  # of |λ| or of the band's end: how far around a branch modes are looked for, beside its own change


def losses_over(model: Affine, parameter: str, between: tuple[float, float], band: tuple[float, float] | None,
                tracked: Callable[[], Tracked]) -> CriticalValue:
    """`critical_value` where the model's size allows it, else what its tracked modes show."""
    if model.size <= LARGEST:
        return critical_value(model, None, parameter, between=between, band=band)
    return seen_losses(model, tracked())


def seen_losses(model: Affine, tracked: Tracked) -> CriticalValue:
    """Where the branches begin and cease to grow, each place by bisection; `open` is the whole range.

    A loss and regain between two neighbouring values, or of a mode that enters the band as it grows, is not seen.
    """
    grow, solved = tracked.growing, len(tracked.values)
    losses: list[Crossing] = []
    regains: list[Crossing] = []
    for i, j in np.argwhere(grow[:-1] != grow[1:]):
        if np.isnan(tracked.eigenvalues[i:i + 2, j]).any():
            continue
        found = _located(model, tracked, int(i), int(j))
        (regains if grow[i, j] else losses).append(found)
        solved += HALVINGS + 1
    begin = grow[0] & ~np.isnan(tracked.eigenvalues[0])
    growing = int(2 * begin.sum() - (begin & (tracked.eigenvalues[0].imag == 0)).sum())
    searched = float(tracked.values[0]), float(tracked.values[-1])
    losses, regains = (sorted(several, key=lambda one: one.value) for several in (losses, regains))
    value = searched[0] if growing else losses[0].value if losses else np.inf
    return CriticalValue(tracked.parameter, value, tuple(losses), tuple(regains), searched, tracked.band, growing, (searched,),
                         Tally(0), solved)


def _located(model: Affine, tracked: Tracked, i: int, j: int) -> Crossing:
    """The crossing of a branch between two neighbouring values, by the number of growing modes around it."""
    heights = tracked.eigenvalues[i:i + 2].imag
    own = heights[:, j]
    margin = np.ptp(own) + BESIDE * (own.max() or tracked.band[1])
    near = max(own.min() - margin, 0.0), own.max() + margin
    growth = near[1] + 2 * float(np.nanmax(np.abs(tracked.eigenvalues[i:i + 2].real)))

    def modes(p: float) -> ComplexModes:
        return complex_modes(model.at(**{tracked.parameter: p}), band=near, re=(-growth, growth))

    inside = (heights >= near[0]) & (heights <= near[1])
    begin = int((tracked.growing[i] & inside[0]).sum())
    lo, hi = tracked.values[i:i + 2]
    for _ in range(HALVINGS):
        middle = (lo + hi) / 2
        found = modes(middle)
        if int((found.eigenvalues.real > found.error_bar).sum()) == begin:
            lo = middle
        else:
            hi = middle
    found = modes(hi if tracked.growing[i + 1, j] else lo)
    at = int(np.argmax(found.eigenvalues.real))
    value, shape = found.eigenvalues[at], found.shapes[:, at]
    rates = tracked.eigenvalues[i:i + 2, j].real
    pencil = model.at(**{tracked.parameter: hi if tracked.growing[i + 1, j] else lo})
    kind = "divergence" if value.imag == 0 else fed_by(pencil, shape, value.imag)
    return Crossing(float(lo + hi) / 2, float(hi - lo), float(value.imag), shape, kind, (float(rates[0]), float(rates[1])))

