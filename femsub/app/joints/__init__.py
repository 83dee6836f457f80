"""Joints of a scene. `JointKind` is the base class of all kinds; ends are 'part.set', 'part', 'part:0,4' or 'ground'."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from femsub.app.ends import LinkKind
from femsub.app.kinds import key

if TYPE_CHECKING:
    from femsub import Mesh

ENDS = "'part.set', 'part' (all of its interface), 'part:0,4' (DOF), or 'ground'"


@dataclass(frozen=True)
class JointKind(LinkKind):
    """The base class of joints: keys that all kinds have."""

    tolerance: float = key(0.0, "largest distance of places that are joined", unit="length", least=0,
                           otherwise="a small fraction of the distance of neighbours")

    FAMILY: ClassVar[str] = "joint"

    @property
    def surfaces(self) -> list[str]:
        found = getattr(self, self.KIND.replace("-", "_"))
        return [found] if isinstance(found, str) else list(found)

    def made(self, ends: Sequence[Any], meshes: Mapping[str, Mesh]) -> list[Any]:
        """The joints between the ends, as `couple` takes them."""
        raise NotImplementedError
