"""Joints of a surface with one node: rigid (RBE2, kinematic coupling) and by the mean motion (RBE3, distributing coupling)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, real_array
from femsub.coupling.joints import End, Joint, Link, Site, site, spatial, stacked, title
from femsub.errors import InputError
from femsub.model import DofMap, Substructure

LOST = 1e-9  # of a motion of unit size that may be missing before it counts as not determined
TRANSLATIONS = {"ux": 0, "uy": 1, "uz": 2, "w": 2}
#: the rotation that a motion is, and its sign: the slopes of a deflection w are ∂w/∂x = -θ_y and ∂w/∂y = θ_x
ROTATIONS = {"rx": (0, 1.0), "ry": (1, 1.0), "rz": (2, 1.0), "w,x": (1, -1.0), "w,y": (0, 1.0)}
STILL = ("w,xy",)  # motions that are 0 in rigid motion


def rigid_rows(dofs: DofMap, origin: Array) -> Array:
    """R (k, 6) with u = R g for the rigid motion g = (t, θ) about a point: t + θ × (x - x₀), and the rotations themselves.

    Raises
    ------
    InputError
        A motion that is none of ux, uy, uz, w, slopes and rotations.
    """
    strange = [label for label in dofs.labels if label not in (*TRANSLATIONS, *ROTATIONS, *STILL)]
    if strange:
        raise InputError(f"the motion {strange[0]!r} has no known part in a rigid motion; those of "
                         f"{', '.join((*TRANSLATIONS, *ROTATIONS, *STILL))} have")
    assert dofs.points is not None
    r = spatial(dofs.points) - origin
    # row a of the cross product θ × r, as coefficients of θ
    turn = np.zeros((len(r), 3, 3))
    for a, (b, c) in enumerate(((1, 2), (2, 0), (0, 1))):
        turn[:, a, b], turn[:, a, c] = r[:, c], -r[:, b]
    R = np.zeros((dofs.size, 6))
    for number, label in enumerate(dofs.labels):
        at = np.flatnonzero(dofs.components == number)
        if label in TRANSLATIONS:
            axis = TRANSLATIONS[label]
            R[at, axis], R[at, 3:] = 1.0, turn[at, axis]
        elif label in ROTATIONS:
            axis, sign = ROTATIONS[label]
            R[at, 3 + axis] = sign
    return R


@dataclass(frozen=True, eq=False)
class _Node:
    """A reference node and a surface: their sites, the places of the DOF, and R (k, 6) of both about the node."""

    node: Site
    surface: Site
    own: Array
    rows: Array
    dofs: DofMap

    @classmethod
    def of(cls, parts: Mapping[str, Substructure], reference: End, surface: End) -> _Node:
        sites = [site(parts, end) for end in (reference, surface)]
        for one in sites:
            if one.dofs is None or one.dofs.points is None:
                raise InputError(f"the DOF of {one.title} have no known places: give {one.part!r} a DofMap with points")
        (node, other), (where, dofs) = sites, (sites[0].dofs, sites[1].dofs)
        assert where is not None and dofs is not None
        if len(np.unique(where.nodes)) > 1:
            raise InputError(f"{node.title} must be one node, but its DOF belong to {len(np.unique(where.nodes))}")
        assert where.points is not None
        origin = spatial(where.points)[0]
        return cls(node, other, rigid_rows(where, origin), rigid_rows(dofs, origin), dofs)

    def size(self) -> Array:
        """What makes rotations comparable with displacements: 1 for t, one over the extent of the surface for θ."""
        reach = float(np.abs(self.rows[:, 3:]).max(initial=0.0))
        return np.append(np.ones(3), np.full(3, 1 / reach if reach > 0 else 1.0))


def _missing(rows: Array, known: Array) -> Array:
    """How much of each row is not in the row space of `known`, relative to its length."""
    _, values, V = np.linalg.svd(known)
    basis = V[:int(np.count_nonzero(values > LOST * values.max(initial=0.0)))]
    rest = rows - (rows @ basis.T) @ basis
    return np.linalg.norm(rest, axis=1) / np.maximum(np.linalg.norm(rows, axis=1), 1e-300)


@dataclass(frozen=True, eq=False)
class Kinematic(Joint):
    """A surface that moves as a rigid body with one node (RBE2, kinematic coupling): u_s = R g, g the motion of the node.

    Parameters
    ----------
    reference : (part, set) or (part, list of DOF)
        DOF of one node: 'ux', 'uy', 'uz' and the rotations 'rx', 'ry', 'rz', or 'w' with its slopes.
    surface : (part, set) or (part, list of DOF)
        The DOF that follow it.
    name : str
        For messages and multipliers.

    Raises
    ------
    InputError
        By `couple`: DOF without coordinates; a reference node without a rotation that the surface needs.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.Kinematic(("hub", "node"), ("disc", "bore"))
    Kinematic(hub.node, disc.bore)
    """

    reference: End
    surface: End
    name: str = ""

    def __repr__(self) -> str:
        return self.name or f"Kinematic({title(self.reference)}, {title(self.surface)})"

    def link(self, parts: Mapping[str, Substructure]) -> Link:
        """One equation for each DOF of the surface."""
        found = _Node.of(parts, self.reference, self.surface)
        unit = found.size()
        own, rows = found.own * unit, found.rows * unit
        lost = _missing(rows, own)
        if lost.max(initial=0.0) > LOST:
            raise InputError(f"{found.node.title} does not determine {found.surface.name(int(lost.argmax()))}: it needs all "
                             "translations and rotations of its node ('rx', 'ry', 'rz')")
        follow = rows @ np.linalg.pinv(own)
        return Link(stacked([(found.surface.part, found.surface.chosen()),
                             (found.node.part, sp.csr_array(-follow) @ found.node.chosen())]))


@dataclass(frozen=True, eq=False)
class Averaged(Joint):
    """A node that moves as a surface does on average (RBE3, distributing coupling).

    u_r = R_r g with the rigid motion g that minimises Σ w_i |u_i - R_i g|² over the surface. The joint does not stiffen the
    surface. A force on the node acts on the surface with the same resultant and moment.

    Parameters
    ----------
    reference : (part, set) or (part, list of DOF)
        DOF of one node, as for `Kinematic`; it may have fewer.
    surface : (part, set) or (part, list of DOF)
        Its displacements count, its rotations do not.
    weights : sequence of float, optional
        One per DOF of the surface, in its order; by default all the same.
    name : str
        For messages and multipliers.

    Raises
    ------
    InputError
        By `couple`: DOF without coordinates; a surface that does not determine a motion of the node, such as the rotation about
        the line on which all its nodes lie.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.Averaged(("hub", "node"), ("disc", "bore"))
    Averaged(hub.node, disc.bore)
    """

    reference: End
    surface: End
    weights: Sequence[float] | None = None
    name: str = ""

    def __repr__(self) -> str:
        return self.name or f"Averaged({title(self.reference)}, {title(self.surface)})"

    def link(self, parts: Mapping[str, Substructure]) -> Link:
        """One equation for each DOF of the node."""
        found = _Node.of(parts, self.reference, self.surface)
        count, unit = len(found.surface), found.size()
        weights = np.ones(count) if self.weights is None else real_array("weights", self.weights)
        if weights.shape != (count,) or (weights < 0).any() or not weights.any():
            raise InputError(f"weights must be {count} numbers, one per DOF of {found.surface.title}, none negative and not "
                             "all 0")
        moved = np.isin(found.dofs.components, [i for i, label in enumerate(found.dofs.labels) if label in TRANSLATIONS])
        root = np.sqrt(weights * moved)
        own, rows = found.own * unit, root[:, None] * found.rows * unit
        lost = _missing(own, rows)
        if lost.max(initial=0.0) > LOST:
            raise InputError(f"the mean motion of {found.surface.title} does not determine "
                             f"{found.node.name(int(lost.argmax()))}: take a surface whose nodes do not lie on one line, or "
                             "leave that DOF out of the node")
        mean = own @ np.linalg.pinv(rows, rcond=LOST) * root
        return Link(stacked([(found.node.part, found.node.chosen()),
                             (found.surface.part, sp.csr_array(-mean) @ found.surface.chosen())]))
