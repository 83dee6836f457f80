"""What every reduction method hands to `reduce`, and the steps they share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from femsub.eigen import NormalModes, lowest_modes
from femsub.errors import InputError
from femsub.pencil import EPS, Array, Matrix, whole_number
from femsub.phases import phase
from femsub.shift_invert import ShiftInvert

COLUMNS = 64  # of V, worked on at a time
DEPENDENT = 1e-13  # share of a column's static energy below which what is left of it is rounding


@dataclass(frozen=True, eq=False)
class Basis:
    """V (n, r) with its labels, and M = VᵀMV, K = VᵀKV (r, r) from the relations that the modes fulfil.

    K is not formed as VᵀKV: for the low modes of a large model that product is all cancellation.
    """

    V: Array
    M: Array
    K: Array
    kinds: tuple[str, ...]
    cutoff: float
    method: str
    dropped: int
    port_error: Mapping[str, float]
    factorisations: int


@phase("projection")
def projected(A: Matrix, V: Array) -> Array:
    """VᵀAV, shape (r, r), without AV: a block of columns at a time."""
    result = np.zeros((V.shape[1],) * 2)
    if not sp.issparse(A) or A.nnz:
        for start in range(0, V.shape[1], COLUMNS):
            part = slice(start, start + COLUMNS)
            result[:, part] = V.T @ (A @ V[:, part])
    return result


def check_modes(modes: object) -> None:
    """`modes` is a whole number, not negative."""
    if whole_number("modes", modes) < 0:
        raise InputError(f"modes must not be negative, but is {modes}")


def kept_modes(handle: ShiftInvert, count: int) -> tuple[NormalModes, Array, Array, float]:
    """The modes with one more, if there is one: (all, kept values, kept shapes with the rigid ones, cut-off).

    The count of a large model is still to be confirmed.
    """
    try:
        found = lowest_modes(handle, count + 1, defer=True)
        cutoff = float(found.frequencies[-1])
    except InputError:
        found = lowest_modes(handle, count, defer=True)
        cutoff = np.inf
    keep = found.rigid + count
    return found, found.eigenvalues[:keep], found.shapes[:, :keep], cutoff


def independent(handle: ShiftInvert, shapes: Array, forces: Array, static: Array,
                kept: Array) -> tuple[Array, Array, Array, int]:
    """Static shapes Ψ (n, s) made M- and K-orthogonal: ΨC with CᵀEC = diag(k), CᵀMC = diag(m) and m = 1.

    Parameters
    ----------
    handle : K and M
    shapes : Ψ, the response to `forces` without the share of the modes
    forces : F with E = ΨᵀKΨ = ΨᵀF, which holds no cancellation
    static : the energy of each column's whole static response, of which Ψ is what the modes do not hold
    kept : the modes Φ (n, m); at most n - m columns can be independent of them

    Returns
    -------
    shapes, k, m, dropped
        Where a column moves no mass, k = 1 and m = 0 instead.
    """
    given, room = shapes.shape[1], len(shapes) - kept.shape[1]
    scale = np.where(static > 0, static, 1.0) ** -0.5
    share, vectors = np.linalg.eigh(block_energy(shapes, forces) * np.outer(scale, scale))
    keep = np.flatnonzero(share > DEPENDENT)[::-1][:max(room, 0)]
    change = scale[:, None] * vectors[:, keep] / np.sqrt(share[keep])
    inertia, rotation = np.linalg.eigh(change.T @ (shapes.T @ (handle.M @ shapes)) @ change)
    order = np.argsort(-inertia)
    inertia, shapes = inertia[order], shapes @ (change @ rotation[:, order])
    count = int(np.count_nonzero(inertia > 1e-14 * inertia.max(initial=0.0)))
    unit = np.where(np.arange(len(inertia)) < count, inertia, 1.0)
    shapes, stiffness = shapes / np.sqrt(unit), 1 / unit
    if count:
        noise = EPS / float(share[keep].min())
        shapes[:, :count], stiffness[:count] = _again(handle, shapes[:, :count], stiffness[:count], noise, kept)
    mass = np.where(np.arange(len(inertia)) < count, 1.0, np.maximum(inertia, 0.0))
    return shapes, stiffness, mass, given - len(keep)


def _again(handle: ShiftInvert, x: Array, stiffness: Array, noise: float, kept: Array) -> tuple[Array, Array]:
    """A second pass: what was left of nearly dependent columns has lost digits, and picked up some of the modes.

    Their energy is taken from K itself where its product loses fewer digits than the first pass did (`noise`).
    """
    x = x - kept @ (kept.T @ (handle.M @ x))
    gram, energy = x.T @ (handle.M @ x), x.T @ (handle.K @ x)
    lost = EPS * np.einsum("ij,ij->j", abs(x), abs(handle.K) @ abs(x)) / stiffness
    if lost.max() > noise:
        energy = np.diag(stiffness)
    root = np.linalg.inv(np.linalg.cholesky((gram + gram.T) / 2))
    energy = root @ energy @ root.T
    values, rotation = np.linalg.eigh((energy + energy.T) / 2)
    return x @ (root.T @ rotation), values


def block_energy(shapes: Array, forces: Array) -> Array:
    """ΨᵀKΨ = ΨᵀF, made symmetric."""
    energy = shapes.T @ forces
    return (energy + energy.T) / 2


def energy_error(missing: Array, whole: Array) -> float:
    """sqrt(missing / whole), the largest over a port's columns."""
    share = np.divide(missing, whole, out=np.zeros_like(whole), where=whole > 0)
    return float(np.sqrt(np.clip(share, 0.0, None).max(initial=0.0)))
