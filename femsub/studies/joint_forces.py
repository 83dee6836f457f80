"""How far off the forces are that joints exert, mode by mode: what a reduced system says of them against the full one."""

from __future__ import annotations

import numpy as np

from femsub.checks import Array
from femsub.linalg.factor import SMALL
from femsub.model.assembly import System
from femsub.model.bands import in_band
from femsub.modes.normal_modes import NormalModes, all_modes, normal_modes

SAME = 0.1  # of the largest share: modes of the reduced system with less are no counterpart of a mode (they may be a cluster)
HELD = 0.5  # of a mode's energy that its counterparts must have


def force_error(full: System, reduced: System, band: tuple[float, float]) -> float:
    """max over the undamped elastic modes in the band of ‖g_r - g‖ / ‖g‖, g the forces on the interfaces of all parts.

    Both are taken at a mode of unit modal mass; a mode of a cluster is compared with what comes nearest to it among the
    cluster's. NaN if the full system has no mode there, or one of them no counterpart.
    """
    ours = normal_modes(full, band=band) if full.size > SMALL else all_modes(full.K, full.M)
    theirs = all_modes(reduced.K, reduced.M)
    at = np.flatnonzero(in_band(ours.frequencies, band) & (np.arange(len(ours.frequencies)) >= ours.rigid))
    if not len(at):
        return np.nan
    x = ours.shapes[:, at]
    share = x.T @ (full.M @ full.collected(reduced.expand(theirs.shapes)))
    share[np.abs(share) < SAME * np.abs(share).max(axis=1, keepdims=True)] = 0.0
    if ((share**2).sum(axis=1) < HELD).any():
        return np.nan
    own = _forces(full, ours, at)
    found = _forces(reduced, theirs, np.arange(len(theirs.frequencies))) @ share.T
    scale = np.linalg.norm(own, axis=0)
    error = np.linalg.norm(found - own, axis=0)
    return float(np.divide(error, scale, out=np.zeros_like(error), where=scale > 0).max())


def _forces(system: System, modes: NormalModes, at: Array) -> Array:
    """All interface forces below each other, shape (Σ n_b, k)."""
    return np.concatenate(list(system.interface_forces(modes.frequencies[at], modes.shapes[:, at]).values()))
