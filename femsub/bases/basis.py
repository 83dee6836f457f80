"""What every reduction method hands to `reduce`, and the steps they share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from femsub.eigen import NormalModes, ShiftInvert
from femsub.errors import InputError, InputTypeError
from femsub.pencil import Array

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


def check_modes(modes: object) -> None:
    """`modes` is a whole number, not negative."""
    if isinstance(modes, bool) or not isinstance(modes, (int, np.integer)):
        raise InputTypeError(f"modes must be a whole number, not {modes!r}")
    if modes < 0:
        raise InputError(f"modes must not be negative, but is {modes}")


def kept_modes(handle: ShiftInvert, count: int) -> tuple[NormalModes, Array, Array, float]:
    """The modes with one more, if there is one: (all, kept values, kept shapes with the rigid ones, cut-off)."""
    try:
        found = handle.modes(count + 1)
        cutoff = float(found.frequencies[-1])
    except InputError:
        found = handle.modes(count)
        cutoff = np.inf
    keep = found.rigid + count
    return found, found.eigenvalues[:keep], found.shapes[:, :keep], cutoff


def independent(shapes: Array, energy: Array, mass: Array, static: Array, room: int) -> tuple[Array, Array, Array, int]:
    """Static shapes Ψ (n, s) made M- and K-orthogonal: ΨC with CᵀEC = diag(k), CᵀMC = diag(m) and m = 1.

    Parameters
    ----------
    shapes : Ψ
    energy, mass : E = ΨᵀKΨ and ΨᵀMΨ, shape (s, s)
    static : the energy of each column's whole static response, of which Ψ is what the modes do not hold
    room : at most so many columns can be independent of the modes

    Returns
    -------
    shapes, k, m, dropped
        Where a column moves no mass, k = 1 and m = 0 instead.
    """
    given = shapes.shape[1]
    scale = np.where(static > 0, static, 1.0) ** -0.5
    values, vectors = np.linalg.eigh(energy * np.outer(scale, scale))
    keep = np.flatnonzero(values > DEPENDENT)[::-1][:max(room, 0)]
    change = scale[:, None] * vectors[:, keep] / np.sqrt(values[keep])
    inertia, rotation = np.linalg.eigh(change.T @ mass @ change)
    order = np.argsort(-inertia)
    inertia, change = inertia[order], change @ rotation[:, order]
    massive = inertia > 1e-14 * (inertia.max() if len(inertia) else 0.0)
    unit = np.where(massive, inertia, 1.0)
    change = change / np.sqrt(unit)
    return shapes @ change, 1 / unit, np.where(massive, 1.0, np.maximum(inertia, 0.0)), given - len(keep)


def block_energy(shapes: Array, forces: Array) -> Array:
    """ΨᵀKΨ = ΨᵀF, made symmetric."""
    energy = shapes.T @ forces
    return (energy + energy.T) / 2


def energy_error(missing: Array, whole: Array) -> float:
    """sqrt(missing / whole), the largest over a port's columns."""
    share = np.divide(missing, whole, out=np.zeros_like(whole), where=whole > 0)
    return float(np.sqrt(np.clip(share, 0.0, None).max(initial=0.0)))
