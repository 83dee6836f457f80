"""Finds reduction methods by their names in files and other programs, with a number of modes that the part allows."""

from __future__ import annotations

import re

from femsub.checks import InputError
from femsub.model import MOTIONS, Substructure
from femsub.modes.normal_modes import normal_modes
from femsub.reduction.reduce import METHODS, Method

#: abbreviations in the literature, and what `method_key` makes of the class name MacNeal
SHORT_NAMES = {"hcb": "craig-bampton", "cc": "craig-chang", "dcb": "dual-craig-bampton", "mac-neal": "macneal"}


def method_key(name: str) -> str:
    """The key of a method: 'craig-bampton' for the class name CraigBampton and for the abbreviation HCB."""
    if name in METHODS:
        return name
    plain = re.sub(r"(?<=[a-z])(?=[A-Z])", "-", name).lower()
    return SHORT_NAMES.get(plain, plain)


def with_room(key: str, sub: Substructure, modes: int) -> Method:
    """A method with `modes` modes, or with all modes of the part if it has fewer."""
    kind, room = METHODS[key], len(sub.interior)
    if not kind.held:  # free modes; rigid-body modes are counted only if `modes` may exceed the number of elastic modes
        rigid = len(MOTIONS)
        room = sub.size - (normal_modes(sub, count=min(1, sub.size)).rigid if modes > sub.size - rigid else rigid)
    return kind(min(modes, max(room, 0)))


def of_size(key: str, sub: Substructure, size: int) -> Method | None:
    """A method with `size` coordinates, rigid-body modes not counted; None if it has more static shapes than that.

    Raises
    ------
    InputError
        The part has fewer than `size` DOF.
    """
    if size > sub.size:
        raise InputError(f"sizes: {size} are more than the {sub.size} DOF of {sub.name!r}")
    modes = size - METHODS[key](0).static_columns(sub)
    return METHODS[key](modes) if modes >= 0 else None
