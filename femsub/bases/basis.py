"""What every reduction method hands to `reduce`, and the steps they share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from femsub.checks import finite_number, whole_number
from femsub.eigen import NormalModes, check_band, lowest_modes
from femsub.errors import InputError
from femsub.estimates import Estimate
from femsub.nested import DEPENDENT, NOISE
from femsub.pencil import EPS, Array, Matrix
from femsub.phases import phase
from femsub.shift_invert import ShiftInvert

COLUMNS = 64  # of V, worked on at a time


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
    estimate: Estimate | None = None


@phase("projection")
def projected(A: Matrix, V: Array) -> Array:
    """VᵀAV, shape (r, r), without AV: a block of columns at a time."""
    result = np.zeros((V.shape[1],) * 2)
    if not sp.issparse(A) or A.nnz:
        for start in range(0, V.shape[1], COLUMNS):
            part = slice(start, start + COLUMNS)
            result[:, part] = V.T @ (A @ V[:, part])
    return result


@dataclass(frozen=True)
class Extent:
    """How far a basis goes: `modes` of them, or as many as a band and a tolerance need."""

    modes: int | None = None
    band: tuple[float, float] | None = None
    tol: float | None = None

    def __post_init__(self) -> None:
        name = type(self).__name__
        if (self.modes is None) == (self.band is None and self.tol is None):
            found = "nothing is given" if self.modes is None else f"modes={self.modes!r} and a band or tolerance are both given"
            raise InputError(f"{name} takes modes=20, or band=(lo, hi) with tol=1e-3, but {found}")
        if self.modes is not None:
            if whole_number("modes", self.modes) < 0:
                raise InputError(f"modes must not be negative, but is {self.modes}")
            return
        if self.band is None or self.tol is None:
            lacking = "band=(lo, hi), in rad per unit of time," if self.band is None else "tol=1e-3, the relative error allowed,"
            raise InputError(f"{name}: {lacking} is missing; band and tol go together")
        object.__setattr__(self, "band", check_band(self.band))
        if not 0 < finite_number("tol", self.tol) < 1:
            raise InputError(f"tol is a relative error between 0 and 1, not {self.tol!r}")

    def __str__(self) -> str:
        """The extent in words."""
        if self.modes is not None:
            return f"{self.modes} modes"
        return f"tol {self.tol:g} up to {self.band[1]:.5g} rad/time"  # type: ignore[index]


@dataclass(frozen=True, eq=False)
class Kept:
    """The modes of a basis: all that were found, of which `elastic` are kept, with the rigid ones; those left out begin at
    `cutoff`.
    """

    found: NormalModes
    elastic: int
    cutoff: float

    @property
    def rigid(self) -> int:
        return self.found.rigid

    @property
    def values(self) -> Array:
        """ω² of the modes kept, shape (rigid + elastic,)."""
        return self.found.eigenvalues[:self.rigid + self.elastic]

    @property
    def shapes(self) -> Array:
        """Φ of the modes kept, shape (n, rigid + elastic)."""
        return self.found.shapes[:, :self.rigid + self.elastic]


def kept_modes(handle: ShiftInvert, count: int) -> Kept:
    """The modes, with one more for the cut-off, if there is one; the count of a large model is still to be confirmed."""
    try:
        found = lowest_modes(handle, count + 1, defer=True)
        return Kept(found, count, float(found.frequencies[-1]))
    except InputError:
        return Kept(lowest_modes(handle, count, defer=True), count, np.inf)


def independent(handle: ShiftInvert, rest: Array, forces: Array, kept: Array,
                values: Array) -> tuple[Array, Array, Array, int]:
    """Static shapes Ψ (n, s) made M- and K-orthogonal: ΨC with CᵀEC = diag(k), CᵀMC = diag(m), m = 1 or exactly 0.

    Parameters
    ----------
    handle : K and M
    rest : Ψ, the response to `forces` without the share of the modes
    forces : F with E = ΨᵀKΨ = ΨᵀF, which holds no cancellation
    kept, values : the modes Φ (n, m) and ω² (m,), 0 for rigid ones

    Returns
    -------
    shapes, k, m, dropped
        Where a column moves no mass, k = 1 and m = 0. That is so of what massless DOF add to the modes: with all modes
        kept their mass is rounding, and one that was scaled to m = 1 would be nothing else.
    """
    given, room = rest.shape[1], len(rest) - kept.shape[1]
    static, motion = _whole(handle, rest, forces, kept, values)
    scale = np.where(static > 0, static, 1.0) ** -0.5
    share, vectors = np.linalg.eigh(block_energy(rest, forces) * np.outer(scale, scale))
    keep = np.flatnonzero(share > DEPENDENT)[::-1][:max(room, 0)]
    change = scale[:, None] * vectors[:, keep] / np.sqrt(share[keep])
    inertia, rotation = np.linalg.eigh(change.T @ (rest.T @ (handle.M @ rest)) @ change)
    order = np.argsort(-inertia)
    inertia, change = inertia[order], change @ rotation[:, order]
    shapes = rest @ change
    top = np.append(inertia, 1 / values[-1:][values[-1:] > 0]).max(initial=0.0)  # that of the highest mode, too
    least = np.maximum(lightest(handle) * top,
                       (NOISE * (abs(change).T @ motion)) ** 2)
    # no more columns can have mass than there are finite modes beside those kept
    count = int(np.count_nonzero((inertia > least)[:max(handle.finite - kept.shape[1], 0)]))
    unit = np.where(np.arange(len(inertia)) < count, inertia, 1.0)
    shapes, stiffness = shapes / np.sqrt(unit), 1 / unit
    noise = EPS / float(share[keep].min(initial=1.0))
    if count:
        shapes[:, :count], stiffness[:count] = _again(handle, shapes[:, :count], stiffness[:count], noise, kept)
    if count < len(inertia):
        shapes[:, count:] = _of_unit_energy(handle, shapes[:, count:], noise)
    return shapes, stiffness, np.where(np.arange(len(inertia)) < count, 1.0, 0.0), given - len(keep)


def lightest(handle: ShiftInvert) -> float:
    """The mass that counts, per stiffness, beside that of the modes kept.

    A shape of a component without massless DOF is no faster than its highest mode. With them it may be a static
    deflection that a mode hardly takes part in: made one of unit mass it would be stiffer than all else without bound, and
    up to the highest mode kept its inertia changes nothing.
    """
    return 1e-14 if handle.finite == handle.K.shape[0] else 1e-8


def _whole(handle: ShiftInvert, rest: Array, forces: Array, kept: Array, values: Array) -> tuple[Array, Array]:
    """Of the whole static responses, of which Ψ is what the modes do not hold: the energy, and the size of the motion.

    The size, sqrt(Σ m_ii x_i²), is what the rounding of each entry is measured against: without cancellation in M.
    """
    kept, values = kept[:, values.searchsorted(0.0, "right"):], values[values > 0]
    share = (kept.T @ forces) / values[:, None]
    energy = np.einsum("ij,ij->j", rest, forces) + values @ share**2
    if not forces.shape[1]:
        return energy, energy
    motion = (np.einsum("i,ij,ij->j", handle.M.diagonal(), x, x) for x in (rest, kept))
    return energy, np.sqrt(next(motion) + next(motion) @ share**2)


def _again(handle: ShiftInvert, x: Array, stiffness: Array, noise: float, kept: Array) -> tuple[Array, Array]:
    """A second pass: what was left of nearly dependent columns has lost digits, and picked up some of the modes.

    Their energy is taken from K itself where its product loses fewer digits than the first pass did (`noise`).
    """
    x = x - kept @ (kept.T @ (handle.M @ x))
    gram, energy = x.T @ (handle.M @ x), x.T @ (handle.K @ x)
    if _lost(handle, x, stiffness) > noise:
        energy = np.diag(stiffness)
    root = np.linalg.inv(np.linalg.cholesky((gram + gram.T) / 2))
    energy = root @ energy @ root.T
    values, rotation = np.linalg.eigh((energy + energy.T) / 2)
    return x @ (root.T @ rotation), values


def _of_unit_energy(handle: ShiftInvert, x: Array, noise: float) -> Array:
    """The same of shapes without mass, XᵀKX = I."""
    if _lost(handle, x, np.ones(x.shape[1])) > noise:
        return x
    energy = x.T @ (handle.K @ x)
    return x @ np.linalg.inv(np.linalg.cholesky((energy + energy.T) / 2)).T


def _lost(handle: ShiftInvert, x: Array, stiffness: Array) -> float:
    """The share of the energies that rounding in the product with K may take."""
    return float((EPS * np.einsum("ij,ij->j", abs(x), abs(handle.K) @ abs(x)) / stiffness).max())


def block_energy(shapes: Array, forces: Array) -> Array:
    """ΨᵀKΨ = ΨᵀF, made symmetric."""
    energy = shapes.T @ forces
    return (energy + energy.T) / 2


def energy_error(missing: Array, whole: Array) -> float:
    """sqrt(missing / whole), the largest over a port's columns."""
    share = np.divide(missing, whole, out=np.zeros_like(whole), where=whole > 0)
    return float(np.sqrt(np.clip(share, 0.0, None).max(initial=0.0)))
