"""Equal motion of two ends or more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import femsub as fs
from femsub.app.joints import ENDS, JointKind
from femsub.app.kinds import key


@dataclass(frozen=True)
class RigidJointKind(JointKind):
    """The ends move alike."""

    rigid: list[str] = key([], f"the ends, two or more: {ENDS}", required=True, example=["disc.front", "pad.back"])

    KIND: ClassVar[str] = "rigid"

    def made(self, ends: Sequence[Any], meshes: Mapping[str, fs.Mesh]) -> list[Any]:
        return [fs.Rigid(*ends, tol=self.tol)]
