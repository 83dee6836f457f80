"""The paper's chain, cut into parts that joints hold together."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from femsub.checks import whole_number
from femsub.components.chain import chain
from femsub.coupling.cutting import in_rows
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
    whole = chain(n, belt, damping, masses=masses, springs=springs, interface=())
    ends = np.linspace(0, n - 1, whole_number("pieces", pieces, 2, n - 1) + 1).astype(int)
    parts, joints = in_rows(whole, {f"p{number}": np.arange(first, last + 1) for number, (first, last) in
                                    enumerate(pairwise(ends.tolist()), start=1)})
    return parts, list(joints), next(f"{name}.belt" for name, part in parts.items() if part.ports)
