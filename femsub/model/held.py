"""Checks that each part on which friction acts is held: steady sliding needs supports or springs, not the contact alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.checks import POSITION, Array, InputError
from femsub.model.contact import Contacts, columns_of, contacts_of, small_matrices
from femsub.model.rigid_motion import RigidMotion, Touched, by_places, driven, energy_units, found

if TYPE_CHECKING:
    from femsub.model.substructure import Substructure


def check_held(model: Substructure, contacts: Contacts, noun: str = "the part") -> None:
    """Raises an error if friction drives a rigid motion of a part that only the contact holds.

    The check covers contacts with `sliding`, such as `FrictionContact`. The rigid motion is the one that the model carries, or
    else the one that follows from the places of a full part's DOF. If it is not known, nothing is refused. A disc that is free to
    turn under pads keeps turning, so it is not refused.

    Raises
    ------
    InputError
        There is such a motion. The message names the part.
    """
    given: tuple[Any, ...] = contacts_of(contacts)
    rubbing = [(contact, terms) for contact in given if hasattr(contact, "sliding") for terms in [contact.sliding(model)]
               if terms is not None]
    motion = (found(model.rigid_motion, by_places) or by_places(model)) if rubbing else None
    if motion is None or not motion.count:
        return
    columns = [columns_of(model, contact) for contact, _ in rubbing]
    unit = energy_units(model)
    free = driven(motion, [(W, *terms) for W, (_, terms) in zip(columns, rubbing, strict=True)], unit)
    if free is None or not free.shape[1]:
        return
    moved: dict[str, Array] = {}
    for W, (contact, _) in zip(columns, rubbing, strict=True):
        ends = np.cumsum([0, *(len(model.sets[name]) for name in contact.sets)])
        for name, begin, end in zip(contact.sets, ends[:-1], ends[1:], strict=True):
            moved[name] = (W.T @ free)[begin:end]
    name = max(moved, key=lambda one: float(np.abs(moved[one]).max(initial=0.0)))
    # The motion of the set that moves most, in words; motions of other parts leave it at rest. The motions are as exact as the
    # places of the DOF, from which they are computed.
    U, size, _ = np.linalg.svd(moved[name], full_matrices=False)
    u = U[:, size > POSITION * size[0]]
    against = f"{u.shape[1]} rigid motions"
    if u.shape[1] == 1:
        assert model.interface_dofs is not None
        dofs = model.interface_dofs.kept(model.sets[name])
        mean = [float(u[dofs.components == k].mean()) if (dofs.components == k).any() else 0.0 for k in range(len(dofs.labels))]
        turns = np.abs(u[:, 0] - np.array(mean)[dofs.components]).max(initial=0.0) > POSITION * np.abs(u).max()
        against = ("turning" if turns else "sliding") + " in the plane of the contact"
    raise InputError(f"{noun} {name.rpartition('.')[0] or model.name!r} is not supported against {against}: "
                     f"friction on {name!r} pushes it, and nothing but the contact holds it, so there is no steady sliding. Hold "
                     "it by supports or springs, as its caliper holds a pad. A band that begins above 0 judges its elastic modes")


def floating(model: Substructure, contacts: Contacts) -> RigidMotion | None:
    """The rigid motion with K z = 0 under contacts, whether or not friction drives it (zᵀK ≠ 0); None if it is not known."""
    motion = found(model.rigid_motion, by_places) or by_places(model)
    unit = energy_units(model)
    for contact in contacts_of(contacts):
        if motion is None or not motion.count:
            return motion
        W, damping, stiffness = small_matrices(model, contact)
        motion = Touched(damping, W, stiffness, unit, left=False)(motion)
    return motion
