"""Joints of a surface with one node: rigid (RBE2, kinematic coupling), or by its mean motion (RBE3, distributing coupling)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.checks import EQUAL, Array, InputError, naming, real_array, word
from femsub.coupling.joints import End, Joint, Link, Site, site, stacked, title

if TYPE_CHECKING:
    from femsub.model import Substructure



@dataclass(frozen=True, eq=False, repr=False)
class _OneNode(Joint):
    """A joint of a reference node and a surface: one of them follows the rigid motion g of the other, u_f = R_f g."""

    reference: End
    surface: End

    def __post_init__(self) -> None:
        word("name", self.name)  # type: ignore[attr-defined]

    def __repr__(self) -> str:
        return self.name or f"{type(self).__name__}({title(self.reference)}, {title(self.surface)})"  # type: ignore[attr-defined]

    def _sites(self, parts: Mapping[str, Substructure]) -> tuple[tuple[Site, Array], tuple[Site, Array]]:
        """The node and the surface, each with R (k, 6). Its units make rotations comparable with displacements."""
        with naming("reference"):
            node = site(parts, self.reference)
        with naming("surface"):
            surface = site(parts, self.surface)
        for one in (node, surface):
            if one.dofs is None or one.dofs.points is None:
                raise InputError(f"the DOF of {one.title} have no known places: give {one.part!r} a DofMap with points")
        assert node.dofs is not None and node.dofs.points is not None and surface.dofs is not None
        if len(np.unique(node.dofs.nodes)) > 1:
            raise InputError(f"{node.title} must be one node, but its DOF belong to {len(np.unique(node.dofs.nodes))}")
        own, rows = (dofs.rigid(node.dofs.in_space[0]) for dofs in (node.dofs, surface.dofs))
        reach = float(np.abs(rows[:, 3:]).max(initial=0.0))  # the extent of the surface
        unit = np.append(np.ones(3), np.full(3, 1 / reach if reach > 0 else 1.0))
        return (node, own * unit), (surface, rows * unit)


def _following(follower: tuple[Site, Array], leader: tuple[Site, Array], weight: Array, lost: Callable[[str], str]) -> Link:
    """u_f = R_f (W R_l)⁺ W u_l, W = diag(weight). `lost` returns the message for a DOF of u_f that u_l does not determine."""
    (first, rows), (second, known) = follower, leader
    _, values, V = np.linalg.svd(weight[:, None] * known, full_matrices=False)
    basis = V[:int(np.count_nonzero(values > EQUAL * values.max(initial=0.0)))]
    missing = np.linalg.norm(rows - (rows @ basis.T) @ basis, axis=1) / np.maximum(np.linalg.norm(rows, axis=1), 1e-300)
    if missing.max(initial=0.0) > EQUAL:
        raise InputError(lost(first.name(int(missing.argmax()))))
    follow = rows @ np.linalg.pinv(weight[:, None] * known, rcond=EQUAL) * weight
    return Link(stacked([(first.part, first.chosen()), (second.part, sp.csr_array(-follow) @ second.chosen())]))


@dataclass(frozen=True, eq=False, repr=False)
class Kinematic(_OneNode):
    """A surface that moves as a rigid body with one node (RBE2, kinematic coupling): u_s = R g, g the motion of the node.

    Parameters
    ----------
    reference : (part, set) or (part, list of DOF)
        DOF of one node: 'ux', 'uy', 'uz' and the rotations 'rx', 'ry', 'rz', or 'w' with its slopes.
    surface : (part, set) or (part, list of DOF)
        The DOF that follow the node.
    name : str
        Used in messages and for multipliers.

    Raises
    ------
    InputError
        In `couple`: DOF without coordinates; a reference node without a rotation that the surface needs.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.Kinematic(("hub", "node"), ("disc", "bore"))
    Kinematic(hub.node, disc.bore)
    """

    name: str = ""

    def link(self, parts: Mapping[str, Substructure]) -> Link:
        """One equation for each DOF of the surface."""
        node, surface = self._sites(parts)
        return _following(surface, node, np.ones(len(node[0])), lambda dof: f"{node[0].title} does not determine {dof}: it needs "
                          "all translations and rotations of its node ('rx', 'ry', 'rz')")


@dataclass(frozen=True, eq=False, repr=False)
class Averaged(_OneNode):
    """A node that follows the mean motion of a surface (RBE3, distributing coupling).

    u_r = R_r g with the rigid motion g that minimises Σ w_i |u_i - R_i g|² over the surface. The joint does not stiffen the
    surface. A force on the node acts on the surface with the same resultant and moment.

    Parameters
    ----------
    reference : (part, set) or (part, list of DOF)
        DOF of one node, as for `Kinematic`, or some of them.
    surface : (part, set) or (part, list of DOF)
        The DOF of the surface. Only displacements count, not rotations.
    weights : sequence of float, optional
        The weight w_i of each DOF of the surface, in its order; by default equal weights.
    name : str
        Used in messages and for multipliers.

    Raises
    ------
    InputError
        In `couple`: DOF without coordinates; a surface that does not determine a motion of the node, such as the rotation about
        the line on which all nodes of the surface lie.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.Averaged(("hub", "node"), ("disc", "bore"))
    Averaged(hub.node, disc.bore)
    """

    weights: Sequence[float] | None = None
    name: str = ""

    def link(self, parts: Mapping[str, Substructure]) -> Link:
        """One equation for each DOF of the node."""
        node, (surface, rows) = self._sites(parts)
        weights = np.ones(len(surface)) if self.weights is None else real_array("weights", self.weights)
        if weights.shape != (len(surface),) or (weights < 0).any() or not weights.any():
            raise InputError(f"weights must be {len(surface)} numbers, one per DOF of {surface.title}, none negative and not "
                             "all 0")
        assert surface.dofs is not None
        moved = surface.dofs.rigid()[:, :3].any(axis=1)
        return _following(node, (surface, rows), np.sqrt(weights * moved), lambda dof: f"the mean motion of {surface.title} does "
                          f"not determine {dof}: take a surface whose nodes do not lie on one line, or leave that DOF out of "
                          "the node")
