"""Static shapes made M- and K-orthogonal to modes and to each other, with their stiffness and mass."""

from __future__ import annotations

import numpy as np

from femsub.algebra import BLOCK
from femsub.checks import EPS, Array
from femsub.modes.shift_invert import ShiftInvert

REMAINDER = 1e-13  # share of a static response, its energy or motion, up to which the remainder beside the modes is rounding


def independent(handle: ShiftInvert, rest: Array, forces: Array, kept: Array,
                values: Array) -> tuple[Array, Array, Array, int]:
    """Static shapes Ψ (n, s) made M- and K-orthogonal: ΨC with CᵀEC = diag(k), CᵀMC = diag(m), m = 1 or exactly 0.

    Parameters
    ----------
    handle : K and M
    rest : Ψ, the response to `forces` without the modes' contribution
    forces : F with E = ΨᵀKΨ = ΨᵀF, which is free of cancellation
    kept, values : the modes Φ (n, m) and ω² (m,), 0 for rigid-body modes

    Returns
    -------
    shapes, k, m, dropped
        A column that moves no mass has k = 1 and m = 0. Such columns come from massless DOF: with all modes kept their mass
        is only rounding, and scaling it to m = 1 would make the whole column rounding.
    """
    # energy and size of the full static responses, Ψ plus the modes' contribution. The size sqrt(Σ m_ii x_i²), free of
    # cancellation in M, is the reference for rounding in the entries
    given, room = rest.shape[1], len(rest) - kept.shape[1]
    rigid, elastic = np.split(kept, [values.searchsorted(0.0, "right")], axis=1)
    square = values[values > 0]
    held = (elastic.T @ forces) / square[:, None]
    static = np.einsum("ij,ij->j", rest, forces) + square @ held**2
    if rigid.shape[1]:
        # if inertia alone balances the load, as on a piece of one DOF, the response is nothing but rounding. So the reference
        # gets half of the digits of the load's rigid part, as energy at the lowest elastic ω², or at the shift if there is none
        lowest = handle.lowest if np.isfinite(handle.lowest) else abs(handle.sigma)
        static = np.maximum(static, 0.0) + EPS**0.5 * ((rigid.T @ forces) ** 2).sum(axis=0) / lowest
    motion = static
    if forces.shape[1]:
        own, of_modes = (np.einsum("i,ij,ij->j", handle.M.diagonal(), x, x) for x in (rest, elastic))
        motion = np.sqrt(own + of_modes @ held**2)

    # directions with unit energy, and their mass
    energy = rest.T @ forces
    change, share = energy_directions((energy + energy.T) / 2, static, max(room, 0))
    inertia, rotation = np.linalg.eigh(change.T @ (rest.T @ (handle.M @ rest)) @ change)
    order = np.argsort(-inertia)
    inertia, change = inertia[order], change @ rotation[:, order]
    shapes = rest @ change
    top = np.append(inertia, 1 / values[-1:][values[-1:] > 0]).max(initial=0.0)  # including the highest mode
    least = np.maximum(lightest(handle) * top, (REMAINDER * (abs(change).T @ motion)) ** 2)

    # at most as many columns have mass as there are finite modes not kept
    count = int(np.count_nonzero((inertia > least)[:max(handle.finite - kept.shape[1], 0)]))
    unit = np.where(np.arange(len(inertia)) < count, inertia, 1.0)
    shapes, stiffness = shapes / np.sqrt(unit), 1 / unit

    # a second pass: the remainders of nearly dependent columns have lost digits, and contain parts of the modes again. Their
    # energy is computed from K itself if that loses fewer digits than the first pass did (`noise`)
    noise = EPS / float(share.min(initial=1.0))
    if count:
        x = shapes[:, :count]
        x -= kept @ (kept.T @ (handle.M @ x))
        gram, energy = x.T @ (handle.M @ x), x.T @ (handle.K @ x)
        if _lost(handle, x, stiffness[:count]) > noise:
            energy = np.diag(stiffness[:count])
        root = np.linalg.inv(np.linalg.cholesky((gram + gram.T) / 2))
        energy = root @ energy @ root.T
        stiffness[:count], rotation = np.linalg.eigh((energy + energy.T) / 2)
        shapes[:, :count] = x @ (root.T @ rotation)
    if count < len(inertia):  # shapes without mass: XᵀKX = I
        x = shapes[:, count:]
        if _lost(handle, x, np.ones(x.shape[1])) <= noise:
            energy = x.T @ (handle.K @ x)
            shapes[:, count:] = x @ np.linalg.inv(np.linalg.cholesky((energy + energy.T) / 2)).T
    return shapes, stiffness, np.where(np.arange(len(inertia)) < count, 1.0, 0.0), given - len(share)


def energy_directions(energy: Array, whole: Array, most: int | None = None) -> tuple[Array, Array]:
    """C (s, k) with CᵀEC = I for shapes with the energy E (s, s), and each direction's share of the energy `whole` (s,).

    Directions with a share of at most REMAINDER are left out. At most `most` are kept, the largest first.
    """
    scale = np.where(whole > 0, whole, 1.0) ** -0.5
    share, vectors = np.linalg.eigh(energy * np.outer(scale, scale))
    keep = np.flatnonzero(share > REMAINDER)[::-1][:most]
    return scale[:, None] * vectors[:, keep] / np.sqrt(share[keep]), share[keep]


def lightest(handle: ShiftInvert) -> float:
    """The smallest mass per stiffness, relative to the kept modes, that does not count as 0.

    Without massless DOF no shape is faster than the highest mode. With them, a shape may be a static deflection with hardly
    any mass. Scaled to unit mass, its stiffness would be unbounded. Its inertia has no effect up to the highest kept mode.
    """
    return 1e-14 if handle.finite == handle.K.shape[0] else 1e-8


def _lost(handle: ShiftInvert, x: Array, stiffness: Array) -> float:
    """The largest relative error of the energies of x by rounding in the product with K."""
    size, found = abs(handle.K), 0.0
    for start in range(0, x.shape[1], BLOCK):  # all columns at once would take three times the memory of x
        part = slice(start, start + BLOCK)
        motion = abs(x[:, part])
        found = max(found, float((EPS * np.einsum("ij,ij->j", motion, size @ motion) / stiffness[part]).max()))
    return found
