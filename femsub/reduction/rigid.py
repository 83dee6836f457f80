"""The rigid motion of a component in the coordinates of a basis, and D without its rounding."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from femsub.algebra import SAME, RigidMotion, size_of_products, undamped, units as energy_units, without
from femsub.checks import Array
from femsub.modes import motion_of, rounding_ratio, units

if TYPE_CHECKING:
    from femsub.model import Pencil, Substructure
    from femsub.reduction.basis import Basis
    from femsub.reduction.statics import Statics

__all__ = ["RigidMotion", "coordinates", "damping", "free_first", "motion_of", "without"]

STILL = 1e-9  # ‖KZ‖ relative to its terms above which a method's rigid motion is none


def coordinates(statics: Statics, modes: int, size: int) -> Array | None:
    """The rigid motion of the part in [C Φ Ξ], (size, k), where the first `modes` columns of Φ are rigid; None if not known."""
    if statics.rigid is None:
        return None
    n_c, free = statics.rigid.shape
    found = np.zeros((size, free + modes))
    found[:n_c, :free], found[n_c + np.arange(modes), free + np.arange(modes)] = statics.rigid, 1.0
    return found


def free_first(q: Array, motion: Array, pencil: Pencil | None) -> RigidMotion:
    """Coordinates q (r, k) of a rigid motion (n, k), with those first that D of the component does not damp."""
    if pencil is None or not q.shape[1] or not pencil.norms[1]:
        return RigidMotion(q, q.shape[1])
    turn, free = undamped(pencil.D, motion, units(pencil.M))
    return RigidMotion(q @ turn[:, np.append(free, np.setdiff1d(np.arange(len(turn)), free))], len(free))


def damping(sub: Substructure, basis: Basis, D: Array) -> tuple[Array, RigidMotion | None, Array]:
    """VᵀDV without the rounding of rigid motion, this motion, and G: the rounding of D is up to EPS G Gᵀ."""
    V = basis.V
    noise = np.hstack([np.abs(V).T @ sub.noise, size_of_products(sub.D, V)])
    if sub.pencil.symmetric[1]:
        D = (D + D.T) / 2
    q, motion = _known(sub, basis)
    if q is None:
        return D, None, noise
    found = free_first(q, motion, sub.pencil)
    return without(D, found.undamped, energy_units(basis.M.diagonal(), basis.K.diagonal())[0]), found, noise


def _known(sub: Substructure, basis: Basis) -> tuple[Array | None, Array]:
    """The coordinates q of the rigid motion, and the motion itself: as the method, or else the component, knows it.

    What a component carries is looked for in the span of V.
    """
    if basis.rigid is not None and basis.motion is not None:
        known = sub.rigid_motion is not None or (rounding_ratio(sub.K, basis.motion) <= STILL).all()
        return basis.rigid if known else None, basis.motion
    carried = motion_of(sub.rigid_motion)
    if carried is None:
        return None, basis.V[:, :0]
    unit = units(sub.M)[:, None]
    scaled, wanted = basis.V / unit, carried.shapes / unit
    size = np.linalg.norm(scaled, axis=0)
    size = np.where(size > 0, size, 1.0)
    q = np.linalg.lstsq(scaled / size, wanted, rcond=None)[0]
    left = np.linalg.norm(wanted - scaled / size @ q, axis=0)
    return (q / size[:, None] if (left <= SAME * np.linalg.norm(wanted, axis=0)).all() else None), carried.shapes
