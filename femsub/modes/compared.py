"""Errors of a reduced model's undamped modes: of frequencies with the interface at rest, and of the forces in joints."""

from __future__ import annotations

import numpy as np

from femsub.algebra import SMALL
from femsub.checks import Array
from femsub.coupling import Rigid, System, couple
from femsub.model import Substructure, in_band
from femsub.modes.normal_modes import NormalModes, all_modes, normal_modes
from femsub.modes.quadratic.matching import match


def all_modes_of(model: Substructure) -> NormalModes:
    """Every mode of a small model."""
    return all_modes(model.K, model.M, carried=model.rigid_motion)


def force_error(full: System, ours: NormalModes, reduced: System, theirs: NormalModes, band: tuple[float, float],
                near: float = 0.5, held: float = 0.5, least: float = 0.1) -> float:
    """The largest error of the joint forces over the undamped elastic modes of the full system in the band.

    max_j (‖g_j - ḡ_j‖ / ω_j) / max_k (‖g_k‖ / ω_k), g of the full system, ḡ of the reduced one. g are the forces on the
    interfaces of all parts in a mode of unit modal mass. The joints carry no load in some modes, such as the symmetric ones of
    two equal parts. So all modes share one scale, which grows with ω. Modes of a cluster are compared as a subspace. NaN if the
    band holds no mode of the full system, or if one of them has no counterpart. `theirs` are all modes of the reduced one.

    A counterpart is within `near` of ω, as in `match`, and has at least `least` of the largest share of the mode's energy: its
    cluster counts, noise does not. All counterparts together must have more than `held` of the energy, so that no two modes of
    the full system claim the same.
    """
    at = np.flatnonzero(in_band(ours.frequencies, band) & (np.arange(len(ours.frequencies)) >= ours.rigid))
    if not len(at):
        return np.nan
    x, y = ours.shapes[:, at], full.collected(reduced.expand(theirs.shapes))
    size = np.sqrt(np.einsum("ij,ij->j", y, full.M @ y))  # 1 but for methods that change the mass, such as MacNeal's
    share = x.T @ (full.M @ y) / size
    omega = ours.frequencies[at, None]
    share[np.abs(theirs.frequencies - omega) > near * omega] = 0.0
    share[np.abs(share) < least * np.abs(share).max(axis=1, keepdims=True)] = 0.0
    if ((share**2).sum(axis=1) < held).any():
        return np.nan
    own = joint_forces(full, ours, at)
    found = joint_forces(reduced, theirs, np.arange(len(theirs.frequencies))) @ (share / size).T
    scale = ours.frequencies[at] * (np.linalg.norm(own, axis=0) / ours.frequencies[at]).max()
    error = np.linalg.norm(found - own, axis=0)
    return float((error / scale).max()) if scale.any() else np.nan


def joint_forces(system: System, modes: NormalModes, at: Array) -> Array:
    """All interface forces below each other, shape (Σ n_b, k)."""
    return np.concatenate(list(system.interface_forces(modes.frequencies[at], modes.shapes[:, at]).values()))


def held_frequencies(model: Substructure, band: tuple[float, float] | None = None) -> Array:
    """The undamped frequencies in a band while the interface is held at rest; without a band all, of a small model."""
    if model.size <= len(model.interface_numbers):
        return np.empty(0)
    at_rest = couple({"held": model}, [Rigid(("held", model.interface_numbers), "ground")], interface=[])
    found = (normal_modes(at_rest, band=band) if band and at_rest.size > SMALL else all_modes_of(at_rest)).elastic
    return found[in_band(found, band)] if band else found


def held_error(full: Array, reduced: Array) -> float:
    """The largest |Δω| / ω; inf where a frequency of the full model has no counterpart at all."""
    at, to = match(full, reduced)
    return float((np.abs(reduced[to] - full[at]) / full[at]).max(initial=0.0)) if len(at) == len(full) else np.inf
