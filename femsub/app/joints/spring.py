"""Springs and dashpots between the nodes of two ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import femsub as fs
from femsub.app.joints import ENDS, JointKind
from femsub.app.kinds import key


@dataclass(frozen=True)
class SpringJointKind(JointKind):
    """A spring and a dashpot between each pair of DOF that meet, or at a port 'part.port'."""

    spring: list[str] = key([], f"the two ends: {ENDS}", required=True, form="[first, second]", example=["pad.back", "ground"])
    stiffness: float = key(0.0, "stiffness of each spring", unit="force/length", least=0)
    damping: float = key(0.0, "constant of each dashpot", unit="force·time/length", least=0)

    KIND: ClassVar[str] = "spring"

    def made(self, ends: Sequence[Any], meshes: Mapping[str, fs.Mesh]) -> list[Any]:
        return [fs.Spring(ends[0], ends[1], stiffness=self.stiffness, damping=self.damping, tol=self.tol)]
