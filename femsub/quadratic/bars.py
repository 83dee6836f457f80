"""How far each eigenvalue of λ²M + λD + K may be off: residual times condition, entry by entry, with left vectors."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from femsub.checks import EPS, Array
from femsub.model.matrices import equilibration, scaled

if TYPE_CHECKING:
    from femsub.model.pencil import Pencil

CLUSTER = 1e-7  # eigenvalues closer than this, relatively, get their left vectors as a group


class Bars(NamedTuple):
    """What `ComplexModes` says under these names of k eigenpairs."""

    backward_error: Array
    error_bar: Array
    condition: Array


def bars(pencil: Pencil, values: Array, X: Array, Y: Array, known: Array | None = None) -> Bars:
    """Residuals, backward errors and error bars of eigenpairs λ (k,), X (n, k) with their left vectors Y (n, k).

    `known` are all eigenvalues that are known, neighbours outside of a band or beyond a count among them: by default `values`.
    Where each complex one is followed by its conjugate, as by count, only one of the two is worked out.
    """
    gaps = _gaps(values, values if known is None else known)
    first = np.flatnonzero(values.imag > 0)
    in_pairs = len(first) > 0 and len(first) == np.count_nonzero(values.imag < 0) and first[-1] + 1 < len(values) \
        and np.array_equal(values[first + 1], values[first].conj()) and np.array_equal(X[:, first + 1], X[:, first].conj())
    if in_pairs and bool((values.imag[first] > CLUSTER * np.abs(values[first])).all()):
        half = np.flatnonzero(values.imag >= 0)
        double = np.sort(np.append(np.arange(len(half)), np.flatnonzero(values.imag[half])))
        regular = len(values) == 2 * len(half)  # then a view of the left vectors, which no product needs in one piece, will do
        both = _one_by_one(pencil, values[half], X[:, half], Y[:, ::2] if regular else Y[:, half], gaps[half])
        return Bars(*(figures[double] for figures in both))
    return _one_by_one(pencil, values, X, Y, gaps)


def _one_by_one(pencil: Pencil, values: Array, X: Array, Y: Array, gap: Array) -> Bars:
    # |y|ᵀ|r| and not ‖y‖‖r‖: DOF of mixed units (displacements next to rotations) then leave the bar as it is.
    inertia = (pencil.M @ X) * values
    rest = inertia + pencil.D @ X
    residual = rest * values + pencil.K @ X
    slope = inertia + rest  # P'(λ)x = 2λMx + Dx
    doubt = np.abs(residual) + 4 * EPS * pencil.magnitude(values, X)
    sensitivity = np.abs(np.einsum("ij,ij->j", Y.conj(), slope))
    size = np.abs(Y)
    spread, length = np.einsum("ij,ij->j", size, doubt), np.sqrt(np.einsum("ij,ij->j", size, size))
    for group in _clusters(values):
        # In a group of equal eigenvalues any combination of vectors is as good: take the dual left ones.
        gram = Y[:, group].conj().T @ slope[:, group]
        # in no units: unit lengths, where DOF differ in theirs, are of no account
        if np.linalg.cond(scaled(gram, *equilibration(gram))) < 1 / np.sqrt(EPS):
            dual = Y[:, group] @ np.linalg.inv(gram).conj().T
            # Rounding mixes them, too: each moves by no more than the sum of its row (Gershgorin).
            spread[group] = (np.abs(dual).T @ doubt[:, group]).sum(axis=1)
            length[group] = np.linalg.norm(dual, axis=0)
            sensitivity[group] = 1.0
        else:
            sensitivity[group] = 0.0
    bar = np.divide(spread, sensitivity, out=np.full(len(values), np.inf), where=sensitivity > 0)
    # A neighbour at the distance g: d (g - d) = b g is what the first order b = d leaves of d. Where b is no longer small
    # next to g, the two may coalesce, and the first order says nothing further.
    close = bar > gap / 8
    share = np.divide(bar, gap, out=np.zeros_like(bar), where=~close & (gap > 0))
    bar = np.where(close, bar + gap, 2 * bar / (1 + np.sqrt(1 - 4 * share)))
    bar[values == 0] = 0.0
    size = np.abs(values)
    scale = size**2 * pencil.norms[0] + size * pencil.norms[1] + pencil.norms[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        condition = np.where(sensitivity * size > 0, scale * np.linalg.norm(X, axis=0) * length / (sensitivity * size), np.inf)
    return Bars(pencil.backward_error(values, X, residual), bar, condition)


def _gaps(values: Array, found: Array) -> Array:
    """The distance of each eigenvalue to the nearest other one of those found, its own conjugate included; inf without one."""
    if len(values) == 0:
        return np.zeros(0)
    from scipy.spatial import cKDTree

    upper, lower = found[found.imag >= 0], found[found.imag < 0].conj()
    upper = np.append(upper, lower[~np.isin(lower, upper)])  # of a pair one or both may be listed
    every = np.append(upper, upper[upper.imag > 0].conj())
    points, asked = (np.stack([part.real, part.imag], axis=1) for part in (every, values))
    return np.asarray(cKDTree(points).query(asked, k=2)[0][:, 1])


def _clusters(values: Array) -> list[Array]:
    if len(values) == 0:
        return []
    order = np.lexsort((values.real, values.imag))
    close = np.abs(np.diff(values[order])) <= CLUSTER * np.abs(values[order][1:])
    groups = np.split(order, np.flatnonzero(~close) + 1)
    return [group for group in groups if len(group) > 1]
