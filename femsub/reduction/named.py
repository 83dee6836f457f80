"""Methods by the names that files and other programs have for them, with as many modes as a part has room for."""

from __future__ import annotations

import re

from femsub.checks import InputError
from femsub.model import MOTIONS, Substructure
from femsub.modes.normal_modes import normal_modes
from femsub.reduction.reduce import METHODS, Method

#: of the literature, and of Python's MacNeal
SHORT_NAMES = {"hcb": "craig-bampton", "cc": "craig-chang", "dcb": "dual-craig-bampton", "mac-neal": "macneal"}


def method_key(name: str) -> str:
    """'craig-bampton' for CraigBampton and HCB, which are the method's names elsewhere."""
    if name in METHODS:
        return name
    plain = re.sub(r"(?<=[a-z])(?=[A-Z])", "-", name).lower()
    return SHORT_NAMES.get(plain, plain)


def with_room(key: str, sub: Substructure, modes: int) -> Method:
    """A method with so many modes, or all that a part has room for."""
    kind, room = METHODS[key], len(sub.interior)
    if not kind.held:  # of a free part; its rigid motions are counted only where so many modes are asked for
        rigid = len(MOTIONS)
        room = sub.size - (normal_modes(sub, count=min(1, sub.size)).rigid if modes > sub.size - rigid else rigid)
    return kind(min(modes, max(room, 0)))


def of_size(key: str, sub: Substructure, size: int) -> Method | None:
    """A method with as many modes as make a model of this size; None where the static shapes alone are more.

    Raises
    ------
    InputError
        The part is smaller.
    """
    if size > sub.size:
        raise InputError(f"sizes: {size} are more than the {sub.size} DOF of {sub.name!r}")
    modes = size - METHODS[key](0).static_columns(sub)
    return METHODS[key](modes) if modes >= 0 else None
