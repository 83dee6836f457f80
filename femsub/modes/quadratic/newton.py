"""Newton's method for single eigenpairs of a quadratic pencil, where the eigensolver left an error that is no rounding.

A search is accurate beside the norms of M, D and K. That is worth little where a dashpot is many orders larger than all else.
The residual shows it entry by entry, and two-sided Newton steps mend it (`correction`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from femsub.checks import EPS, Array
from femsub.modes.quadratic.bars import bars
from femsub.modes.quadratic.correction import corrected, left_slope, slope, solver_near, step
from femsub.modes.quadratic.multiplicity import PARALLEL

if TYPE_CHECKING:
    from femsub.model import Pencil

POOR = 1e-8  # error bar relative to |λ| above which an eigenpair is mended,
FLOOR = 30.0  # if it is so many times what rounding in P(λ)x alone would make it
VAGUE = 0.1  # the same above which a pair that cannot be mended may be none
STEPS = 7  # each with a factorisation
LAST = 1e-10  # |Δλ| / |λ| of a last step: the next would be its square over the distance to other eigenvalues, rounding if 1e-4
NEAR = 1e-6  # |Δλ| / |λ| of two pairs that may have become one
AROUND = 1e-2  # |Δλ| / |λ|, beside the error bar, of mended pairs whose shapes a new one must not take up,
APART = 3  # in so many first steps: these shapes are taken out of it


class Mended(NamedTuple):
    """λ (k,), X and Y (n, k), which of them were mended, and which are vague: they may be no eigenvalues, bool (k,) each."""

    values: Array
    X: Array
    Y: Array
    done: Array
    vague: Array


def mended(pencil: Pencil, values: Array, X: Array, Y: Array) -> Mended:
    """Eigenpairs with Newton steps for those whose error bar is poor.

    A pair is mended only if λ stays within its error bar and its residual falls to rounding. Pairs that are mended already are
    kept out of it. If two still come to the same shape, the second stays as it was, so none is lost. Without a left vector (a
    zero column) x̄ is the start.
    """
    values, X, done = values.copy(), X.astype(complex), np.zeros(len(values), dtype=bool)
    Y = np.where(Y.any(axis=0), Y, X.conj())
    if not len(values):
        return Mended(values, X, Y, done, done)
    bar = bars(pencil, values, X, Y).error_bar
    # a poor error bar is large, and larger than rounding explains
    size, left = np.abs(values), np.abs(Y)
    rounding, residual = EPS * pencil.magnitude(values, X), np.abs(pencil.residual(values, X))
    poor = (bar > POOR * size) & (size > 0)
    poor &= np.einsum("ij,ij->j", left, residual) > FLOOR * np.einsum("ij,ij->j", left, rounding)
    for k in np.flatnonzero(poor):
        around = done & (np.abs(values - values[k]) <= max(AROUND * abs(values[k]), bar[k]))
        others = values[around], X[:, around], Y[:, around]
        found = _newton(pencil, values[k], X[:, k], Y[:, k], others)
        if found is None or not abs(found[0] - values[k]) <= max(bar[k], POOR * abs(values[k])):
            continue
        near = np.flatnonzero(np.abs(values - found[0]) <= NEAR * abs(found[0]))
        share = np.abs(found[1].conj() @ X[:, near[near != k]]) / np.linalg.norm(X[:, near[near != k]], axis=0)
        if (1 - share**2 <= PARALLEL).any():
            continue
        values[k], X[:, k], Y[:, k], done[k] = *found, True
    return Mended(values, X, Y, done, poor & ~done & (bar > VAGUE * np.abs(values)))


def _newton(pencil: Pencil, value: complex, x: Array, y: Array, others: tuple[Array, Array, Array]
            ) -> tuple[complex, Array, Array] | None:
    """The eigenpair near (λ, x, y), columns of unit length; None if the residual does not fall to rounding."""
    real, apart, before = value.imag == 0, APART if len(others[0]) else 0, np.inf
    for turn in range(STEPS):
        if turn < apart:
            x, y = _without(pencil, x, y, others)
        solver = solver_near(pencil, value)
        if solver is None:
            return None
        x, y = corrected(pencil, value, x, y, solver)
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            return None
        if turn < apart:
            x, y = _without(pencil, x, y, others)
        off = step(pencil, value, x, y)
        value = value - (off.real if real else off)
        if not np.isfinite(value):
            return None
        settled = _is_settled(pencil, value, x, y)
        # this step is rounding, or the next one would be, or none will be smaller
        last = abs(off) <= 4 * EPS * abs(value) or (settled and (abs(off) <= LAST * abs(value) or abs(off) > before / 2))
        if turn >= apart and last:
            break
        before = abs(off)
    return (value, x, y) if settled else None


def _is_settled(pencil: Pencil, value: complex, x: Array, y: Array) -> bool:
    """Whether yᴴP(λ)x is rounding."""
    residual = pencil.residual(np.array([value]), x[:, None])[:, 0]
    rounding = EPS * pencil.magnitude(np.array([value]), x[:, None])[:, 0]
    return bool(np.abs(y) @ np.abs(residual) <= FLOOR * (np.abs(y) @ rounding))


def _without(pencil: Pencil, x: Array, y: Array, others: tuple[Array, Array, Array]) -> tuple[Array, Array]:
    """x and y with yᵢᴴP'(λᵢ)x = 0 and yᴴP'(λᵢ)xᵢ = 0 for the eigenpairs (λᵢ, xᵢ, yᵢ) near them, and of unit length."""
    for value, right, left in zip(others[0], others[1].T, others[2].T, strict=True):
        own, back = slope(pencil, value, right), left_slope(pencil, value, left)
        whole = left.conj() @ own
        x, y = x - right * ((back.conj() @ x) / whole), y - left * (y.conj() @ own / whole).conj()
        x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
    return x, y
