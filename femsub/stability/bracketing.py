"""The stability border by steps in c and bisection on the complex modes; also for contacts of several columns."""

from __future__ import annotations

import numpy as np

from femsub.checks import Array
from femsub.model import in_band
from femsub.stability.contact_model import TOGETHER, Band, Border, Model

BESIDE = 1e-2  # relative width beyond the band's edges in which pairs are followed, since Im λ moves with c
METHOD = "bracketing"


def bracketed(model: Model, band: Band) -> Border:
    """Steps down in c, half of the way to the next crossing predicted by dλ/dc, then bisection on Re λ.

    Which pair crosses, and whether it does so in the band, is known only at the crossing. Pairs that cross outside the band
    are counted, and the pair with the next largest growth is followed. The border must still be verified.
    """
    contact = float(np.trace(model.contact))
    size = model.pencil.size
    if contact == 0:
        return Border.none(size, METHOD)
    wide = (band[0] * (1 - BESIDE), band[1] * (1 + BESIDE))
    drift = model.drift if band[0] == 0 else None
    furthest = -1e6 * model.size / contact * len(model.form.omega)
    last = furthest if drift is None else drift.c * (1 - TOGETHER)
    stable, lost = 0.0, 0

    def grown(c: float) -> int:
        return int(np.count_nonzero(model.ranked(c, wide) > 0))

    def next_growth(c: float) -> float:
        ranked = model.ranked(c, wide)
        return float(ranked[lost]) if lost < len(ranked) else -model.size

    lost = grown(stable)
    while stable > last:
        trial = max(_step(model, stable, wide, furthest), last)
        if grown(trial) <= lost:
            stable, lost = trial, grown(trial)
            continue
        from scipy.optimize import brentq

        c = float(brentq(next_growth, trial, stable, xtol=1e-16 * abs(trial), rtol=1e-15)) if next_growth(stable) < 0 else stable
        found = _at(model, c, band, wide, contact)
        if found is not None:
            return found
        stable, lost = min(c, stable) * (1 + TOGETHER), max(grown(c * (1 + TOGETHER)), lost + 1)
    return Border.none(size, METHOD) if drift is None else drift


def _at(model: Model, c: float, band: Band, wide: Band, contact: float) -> Border | None:
    """The border at c if a pair on the axis there has its frequency in the band."""
    values, q = model.spectrum(c, wide)
    values, q = values[model.felt(q)], q[:, model.felt(q)]
    fed = model.fed(q) / np.maximum(np.linalg.norm(q, axis=0) ** 2, 1e-300)
    slack = max(model.noise, 1e-9 * abs(c) * contact) * fed / contact
    inside = in_band(values, band)
    together = np.flatnonzero(inside & (np.abs(values.real) <= slack))
    if not len(together):
        near = np.flatnonzero(inside & (np.abs(values.real) <= 1e-6 * abs(c) * fed))
        together = near[np.argsort(np.abs(values.real[near]))][:1]
    if not len(together):
        return None
    order = together[np.argsort(values[together].imag)]
    shapes: Array = model.form.shapes @ q[:, order]
    return Border(c, values[order].imag, shapes / np.linalg.norm(shapes, axis=0), method=METHOD)


def _step(model: Model, stable: float, band: Band, furthest: float) -> float:
    ahead = _foretold(model, stable, band)
    if np.isinf(ahead):
        return 2 * stable if stable else 1e-3 * furthest * 1e-6
    if stable - ahead <= 1e-3 * abs(ahead):
        return ahead * (1 + 2e-3)
    return stable + 0.5 * (ahead - stable)


def _foretold(model: Model, c: float, band: Band) -> float:
    """The nearest c below at which, to first order, a pair in the band crosses; -inf if none does."""
    n, r = len(model.form.omega), model.form.rigid
    values, left, right = model.decomposition(c)
    keep = (values.imag > 0) & in_band(values, band)
    values, left, right = values[keep], left[:, keep], right[:, keep]
    b, d = right[n - r:], left[n - r:]
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = -np.einsum("ij,ij->j", d.conj(), model.contact @ b) / np.einsum("ij,ij->j", left.conj(), right)
        ahead = c - values.real / rate.real
    ahead = ahead[(rate.real < 0) & (ahead < c)]
    return float(ahead.max(initial=-np.inf))
