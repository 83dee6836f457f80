"""Error bars of the eigenvalues of λ²M + λD + K: residual times condition, entry by entry, from left vectors.

A search is accurate relative to the norms of M, D and K. This says little if a dashpot is many orders of magnitude larger than
all other entries. The residual shows such errors entry by entry, and `mended` corrects pairs with poor error bars (`correction`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from femsub.algebra import QUADRATIC, equilibration, scaled, times
from femsub.checks import EPS, EQUAL, Array
from femsub.modes.quadratic.correction import converged, corrected, is_rounding, solver_near
from femsub.modes.quadratic.dense import carries
from femsub.modes.quadratic.matching import HALF, SPLIT, clusters

if TYPE_CHECKING:
    from femsub.model import Pencil

SOLVED = 1e-3  # |y|ᵀ|P(λ)x|, relative to the sizes of its terms, above which (λ, x) is no solution, and first order says nothing


class Bars(NamedTuple):
    """Errors of k eigenpairs; the names are those of `ComplexModes`."""

    backward_error: Array
    error_bar: Array
    condition: Array


def bars(pencil: Pencil, values: Array, X: Array, Y: Array, known: Array | None = None) -> Bars:
    """Residuals, backward errors and error bars of eigenpairs λ (k,), X (n, k) with their left vectors Y (n, k).

    `known` are all computed eigenvalues, including neighbours outside the requested region; default `values`.
    If each complex value is followed by its conjugate, only one of the two is computed.
    """
    from scipy.spatial import cKDTree

    found = values if known is None else known  # the gap of a λ is its distance to the nearest other one, conjugates included
    every = np.append(found, found[~np.isin(found.conj(), found)].conj())  # one or both of a pair may be listed
    points, asked = (np.stack([part.real, part.imag], axis=1) for part in (every, values))
    gaps = np.asarray(cKDTree(points).query(asked, k=2)[0][:, 1])  # inf without a neighbour
    half, second = np.flatnonzero(values.imag >= 0), np.flatnonzero(values.imag < 0)
    upper = values[half]
    of = np.repeat(np.arange(len(half)), 1 + (upper.imag > HALF * np.abs(upper)))
    if len(of) == len(values) and np.array_equal(np.where(values.imag < 0, upper[of].conj(), upper[of]), values) \
            and np.array_equal(X[:, second], X[:, second - 1].conj()):
        return Bars(*(figures[of] for figures in _one_by_one(pencil, upper, X[:, half], Y[:, half], gaps[half])))
    return _one_by_one(pencil, values, X, Y, gaps)


def _one_by_one(pencil: Pencil, values: Array, X: Array, Y: Array, gap: Array) -> Bars:
    # |y|ᵀ|r| and not ‖y‖‖r‖: the bar then does not depend on the units of the DOF (displacements, rotations).
    inertia = times(pencil.M, X) * values
    rest = inertia + times(pencil.D, X)
    residual = rest * values + pencil.restoring(values, X)
    slope = inertia + rest  # P'(λ)x = 2λMx + Dx
    whole = pencil.magnitude(values, X)
    # factor 2: vectors may be wrong by a half, and the first-order error with them
    doubt = 2 * np.abs(residual) + 4 * EPS * whole
    doubt += EPS * (pencil.noise @ (pencil.noise.T @ np.abs(X))) * np.abs(values)  # the projection's rounding in D
    sensitivity = np.abs(np.einsum("ij,ij->j", Y.conj(), slope))
    size = np.abs(Y)
    spread, length = np.einsum("ij,ij->j", size, doubt), np.sqrt(np.einsum("ij,ij->j", size, size))
    for group in clusters(values, HALF):
        # in a group of equal eigenvalues any basis is valid: take the dual left vectors
        gram = Y[:, group].conj().T @ slope[:, group]
        # dimensionless: vectors of unit length would depend on the units of the DOF
        if np.linalg.cond(scaled(gram, *equilibration(gram))) < 1 / HALF:
            dual = Y[:, group] @ np.linalg.inv(gram).conj().T
            # rounding couples them: each moves by at most the sum of its row (Gershgorin)
            spread[group] = (np.abs(dual).T @ doubt[:, group]).sum(axis=1)
            length[group] = np.linalg.norm(dual, axis=0)
            sensitivity[group] = 1.0
        else:
            sensitivity[group] = 0.0
    bar = np.divide(spread, sensitivity, out=np.full(len(values), np.inf), where=sensitivity > 0)
    # With a neighbour at distance g the first-order bar b becomes d from d (g - d) = b g. If b is not small compared with
    # g, the two eigenvalues may coalesce, and first-order theory is not valid.
    close = ~(bar < gap / 8)  # also if both are infinite
    share = np.divide(bar, gap, out=np.zeros_like(bar), where=~close & (gap > 0))
    bar = np.where(close, bar + gap, 2 * bar / (1 + np.sqrt(1 - 4 * share)))
    left, terms = (np.einsum("ij,ij->j", np.abs(Y), part) for part in (np.abs(residual), whole))
    share = np.divide(left, terms, out=np.where(residual.any(axis=0), np.inf, 0.0), where=terms > 0)
    bar[share > SOLVED] = np.inf
    # A left vector may lack a small component that acts where the residual is large. Then |y|ᵀ|r| is too small. So poor bars
    # are evaluated again, with y after a step of inverse iteration; in a sparse model, where a step takes a factor, only if the
    # pair is solved. Their number is limited: of a dense model, together they take the time of a single one in the largest model
    backward = pencil.backward_error(values, X, residual)
    poor = np.isfinite(bar) & (bar > HALF * np.abs(values)) & (values != 0) & ((backward <= EQUAL) | (not pencil.is_sparse))
    for k in np.flatnonzero(poor)[:int((QUADRATIC / pencil.size) ** 3)]:
        solver = solver_near(pencil, values[k])
        if solver is not None:
            y = corrected(pencil, values[k], Y[:, k].conj(), Y[:, k], solver)[1]
            with np.errstate(all="ignore"):  # λ is exact
                better = 2 * np.abs(y) @ np.abs(residual[:, k]) / abs(y.conj() @ slope[:, k])
            bar[k] = max(bar[k], better if np.isfinite(better) else 0.0)
    still = np.flatnonzero(values == 0)
    if len(still):  # K may have nothing but rounding on a carried motion
        bar[still if carries(pencil) else still[share[still] <= HALF]] = 0.0
    size = np.abs(values)
    scale = size**2 * pencil.norms[0] + size * pencil.norms[1] + pencil.norms[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        condition = np.where(sensitivity * size > 0, scale * np.linalg.norm(X, axis=0) * length / (sensitivity * size), np.inf)
    return Bars(backward, bar, condition)


class Mended(NamedTuple):
    """λ (k,), X and Y (n, k), which of them were mended, and which are vague: they may be no eigenvalues, bool (k,) each."""

    values: Array
    X: Array
    Y: Array
    done: Array
    vague: Array


def mended(pencil: Pencil, values: Array, X: Array, Y: Array, vague: float = 0.1) -> Mended:
    """Eigenpairs, corrected where the error bar is poor: above `EQUAL` |λ|, and with a residual above rounding.

    A pair is mended only if λ stays within its error bar and its residual falls to rounding. It is kept apart from pairs that are
    mended already. If two pairs still converge to the same shape, the second keeps its old values, so no pair is lost. If a left
    vector is missing (a zero column), the iteration starts with x̄.

    Parameters
    ----------
    pencil : Pencil
    values, X, Y : ndarray, shapes (k,), (n, k) and (n, k)
    vague : float
        Error bar relative to |λ| above which a pair that cannot be mended may be no eigenpair: less than one digit of λ is known.
    """
    values, X, done = values.copy(), X.astype(complex), np.zeros(len(values), dtype=bool)
    Y = np.where(Y.any(axis=0), Y, X.conj())
    if not len(values):
        return Mended(values, X, Y, done, done)
    bar = bars(pencil, values, X, Y).error_bar
    poor = (bar > EQUAL * np.abs(values)) & (values != 0)
    if poor.any():
        poor[poor] = ~is_rounding(pencil, values[poor], X[:, poor], Y[:, poor])
    for k in np.flatnonzero(poor):
        around = done & (np.abs(values - values[k]) <= 2 * bar[k])
        found = converged(pencil, values[k], X[:, k], Y[:, k], (values[around], X[:, around], Y[:, around]))
        if found is None or not abs(found[0] - values[k]) <= bar[k]:
            continue
        near = np.flatnonzero(np.abs(values - found[0]) <= SPLIT * abs(found[0]))
        near = near[near != k]
        share = np.abs(found[1].conj() @ X[:, near]) / np.linalg.norm(X[:, near], axis=0)
        if (1 - share**2 <= SPLIT**2).any():  # two have become one
            continue
        values[k], X[:, k], Y[:, k], done[k] = *found, True
    return Mended(values, X, Y, done, poor & ~done & (bar > vague * np.abs(values)))
