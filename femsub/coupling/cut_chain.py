"""The paper's chain, cut into parts that joints hold together."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from femsub.checks import whole_number
from femsub.components import per_part
from femsub.components.chain import chain
from femsub.coupling.joints import Rigid
from femsub.model import Substructure


def cut_chain(n: int, pieces: int, belt: int = 1, damping: float = 0.1, *, masses: Any = 1.0,
              springs: Any = 1.0) -> tuple[dict[str, Substructure], list[Rigid], str]:
    """The chain of `chain` in pieces of about the same length, joined at masses of which either side has half.

    Returns
    -------
    parts, joints, port
        'p1', 'p2', ... from the wall on, the joints for `couple`, and the belt's port in the system, 'p1.belt'. Only the part
        under the belt has a port.
    """
    n = whole_number("n", n, least=3)
    place = whole_number("belt (masses count from 1)", belt, 1, n) - 1
    mass, spring = per_part("masses", masses, n, "mass"), per_part("springs", springs, n, "spring")
    ends = np.linspace(0, n - 1, whole_number("pieces", pieces, 2, n - 1) + 1).astype(int)
    parts: dict[str, Substructure] = {}
    joints: list[Rigid] = []
    port = ""
    for number, (first, last) in enumerate(pairwise(ends.tolist()), start=1):
        own, count = mass[first:last + 1].copy(), last - first + 1
        sides = {"left": [0]} if number > 1 else {}
        sides |= {"right": [count - 1]} if number < pieces else {}
        own[[at for side in sides.values() for at in side]] /= 2
        name = f"p{number}"
        part = chain(count, damping=damping if number == 1 else 0.0, masses=own, springs=spring[first:last + 1], interface=(),
                     fixed=number == 1, name=name)
        w = np.zeros(count)
        if not port and place <= last:
            port = f"{name}.belt"
            w[place - first] = 1.0
        parts[name] = Substructure(part.M, part.K, part.D, sides, {"belt": w} if w.any() else {}, name)
        if number > 1:
            joints.append(Rigid((f"p{number - 1}", "right"), (name, "left")))
    return parts, joints, port
