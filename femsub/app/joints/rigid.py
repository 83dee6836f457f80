"""Equal motion of two ends or more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import femsub as fs
from femsub.app.joints import ENDS, JointKind
from femsub.app.kinds import key

if TYPE_CHECKING:
    from femsub import Mesh


@dataclass(frozen=True)
class RigidJointKind(JointKind):
    """The ends move alike."""

    rigid: list[str] = key([], f"the ends, two or more: {ENDS}", required=True, example=["disc.front", "pad.back"])

    KIND: ClassVar[str] = "rigid"

    def made(self, ends: Sequence[Any], meshes: Mapping[str, Mesh]) -> list[Any]:
        return [fs.Rigid(*ends, tol=self.tol)]
