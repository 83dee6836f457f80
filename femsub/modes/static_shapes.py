"""Static shapes made M- and K-orthogonal to modes and to each other, with their stiffness and mass."""

from __future__ import annotations

import numpy as np

from femsub.checks import EPS, Array
from femsub.modes.shift_invert import ShiftInvert

DEPENDENT = 1e-13  # share of a static shape's energy below which its remainder beside the modes is rounding
NOISE = 1e-13  # share of a static response's motion that may be rounding
BALANCED = 1e-8  # of a load's rigid part, as energy at the lowest elastic ω²: reference of a load that inertia balances
COLUMNS = 64  # columns that are processed at a time, where temporaries take memory


def independent(handle: ShiftInvert, rest: Array, forces: Array, kept: Array,
                values: Array) -> tuple[Array, Array, Array, int]:
    """Static shapes Ψ (n, s) made M- and K-orthogonal: ΨC with CᵀEC = diag(k), CᵀMC = diag(m), m = 1 or exactly 0.

    Parameters
    ----------
    handle : K and M
    rest : Ψ, the response to `forces` without the modes' contribution
    forces : F with E = ΨᵀKΨ = ΨᵀF, which is free of cancellation
    kept, values : the modes Φ (n, m) and ω² (m,), 0 for rigid ones

    Returns
    -------
    shapes, k, m, dropped
        A column that moves no mass has k = 1 and m = 0. Such columns come from massless DOF: with all modes kept their mass
        is only rounding, and scaling it to m = 1 would make the whole column rounding.
    """
    given, room = rest.shape[1], len(rest) - kept.shape[1]
    static, motion = _whole(handle, rest, forces, kept, values)
    energy = rest.T @ forces
    change, share = energy_directions((energy + energy.T) / 2, static, max(room, 0))
    inertia, rotation = np.linalg.eigh(change.T @ (rest.T @ (handle.M @ rest)) @ change)
    order = np.argsort(-inertia)
    inertia, change = inertia[order], change @ rotation[:, order]
    shapes = rest @ change
    top = np.append(inertia, 1 / values[-1:][values[-1:] > 0]).max(initial=0.0)  # including the highest mode
    least = np.maximum(lightest(handle) * top,
                       (NOISE * (abs(change).T @ motion)) ** 2)
    # at most as many columns have mass as there are finite modes not kept
    count = int(np.count_nonzero((inertia > least)[:max(handle.finite - kept.shape[1], 0)]))
    unit = np.where(np.arange(len(inertia)) < count, inertia, 1.0)
    shapes, stiffness = shapes / np.sqrt(unit), 1 / unit
    noise = EPS / float(share.min(initial=1.0))
    if count:
        shapes[:, :count], stiffness[:count] = _again(handle, shapes[:, :count], stiffness[:count], noise, kept)
    if count < len(inertia):
        shapes[:, count:] = _of_unit_energy(handle, shapes[:, count:], noise)
    return shapes, stiffness, np.where(np.arange(len(inertia)) < count, 1.0, 0.0), given - len(share)


def energy_directions(energy: Array, whole: Array, most: int | None = None) -> tuple[Array, Array]:
    """C (s, k) with CᵀEC = I for shapes with the energy E (s, s), and each direction's share of the energy of `whole` (s,).

    Directions with a share of at most DEPENDENT are rounding and left out. At most `most` are kept, the largest first.
    """
    scale = np.where(whole > 0, whole, 1.0) ** -0.5
    share, vectors = np.linalg.eigh(energy * np.outer(scale, scale))
    keep = np.flatnonzero(share > DEPENDENT)[::-1][:most]
    return scale[:, None] * vectors[:, keep] / np.sqrt(share[keep]), share[keep]


def _whole(handle: ShiftInvert, rest: Array, forces: Array, kept: Array, values: Array) -> tuple[Array, Array]:
    """Energy and size of the full static responses (Ψ plus the modes' contribution).

    The size sqrt(Σ m_ii x_i²), free of cancellation in M, is the reference for rounding in the entries. The response to a
    load that inertia balances by itself, as on a piece of one DOF, is nothing but rounding.
    """
    rigid, kept = np.split(kept, [values.searchsorted(0.0, "right")], axis=1)
    values = values[values > 0]
    share = (kept.T @ forces) / values[:, None]
    energy = np.einsum("ij,ij->j", rest, forces) + values @ share**2
    if rigid.shape[1]:
        energy = np.maximum(energy, 0.0) + BALANCED * ((rigid.T @ forces) ** 2).sum(axis=0) / handle.lowest
    if not forces.shape[1]:
        return energy, energy
    motion = (np.einsum("i,ij,ij->j", handle.M.diagonal(), x, x) for x in (rest, kept))
    return energy, np.sqrt(next(motion) + next(motion) @ share**2)


def lightest(handle: ShiftInvert) -> float:
    """The smallest mass per stiffness, relative to the kept modes, that does not count as 0.

    Without massless DOF no shape is faster than the highest mode. With them, a shape may be a static deflection with hardly
    any mass. Scaled to unit mass, its stiffness would be unbounded. Its inertia has no effect up to the highest kept mode.
    """
    return 1e-14 if handle.finite == handle.K.shape[0] else 1e-8


def _lost(handle: ShiftInvert, x: Array, stiffness: Array) -> float:
    """The relative error of the energies by rounding in the product with K."""
    size, found = abs(handle.K), 0.0
    for start in range(0, x.shape[1], COLUMNS):  # all at once they would take three times the memory of x
        part = slice(start, start + COLUMNS)
        motion = abs(x[:, part])
        found = max(found, float((EPS * np.einsum("ij,ij->j", motion, size @ motion) / stiffness[part]).max()))
    return found


def _again(handle: ShiftInvert, x: Array, stiffness: Array, noise: float, kept: Array) -> tuple[Array, Array]:
    """A second pass: the remainders of nearly dependent columns have lost digits, and contain parts of the modes again.

    Their energy is computed from K itself if that loses fewer digits than the first pass did (`noise`).
    """
    x -= kept @ (kept.T @ (handle.M @ x))
    gram, energy = x.T @ (handle.M @ x), x.T @ (handle.K @ x)
    if _lost(handle, x, stiffness) > noise:
        energy = np.diag(stiffness)
    root = np.linalg.inv(np.linalg.cholesky((gram + gram.T) / 2))
    energy = root @ energy @ root.T
    values, rotation = np.linalg.eigh((energy + energy.T) / 2)
    return x @ (root.T @ rotation), values


def _of_unit_energy(handle: ShiftInvert, x: Array, noise: float) -> Array:
    """The second pass for shapes without mass: XᵀKX = I."""
    if _lost(handle, x, np.ones(x.shape[1])) > noise:
        return x
    energy = x.T @ (handle.K @ x)
    return x @ np.linalg.inv(np.linalg.cholesky((energy + energy.T) / 2)).T
