"""Springs that hold the mean motion of sets of nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import femsub as fs
from femsub.app.joints import JointKind
from femsub.app.kinds import key
from femsub.checks import InputError


@dataclass(frozen=True)
class MountJointKind(JointKind):
    """A spring and a dashpot from the mean motion of each set to the ground, along each of the directions."""

    mount: list[str] = key([], "the sets of solids, 'part.set'", required=True, example=["pad.back"])
    directions: str = key("xyz", "axes along which springs and dashpots act")
    stiffness: float = key(0.0, "stiffness of each spring", unit="force/length", least=0)
    damping: float = key(0.0, "constant of each dashpot", unit="force·time/length", least=0)

    KIND: ClassVar[str] = "mount"

    def __post_init__(self) -> None:
        if not self.directions or set(self.directions) - set("xyz"):
            raise InputError(f"directions must be some of x, y and z, as 'xyz', not {self.directions!r}")

    def ports(self) -> Mapping[str, Mapping[str, Any]]:
        found: dict[str, dict[str, Any]] = {}
        for end in self.mount:
            part, _, name = end.partition(".")
            found.setdefault(part, {}).update({f"{name}-{axis}": (name, axis) for axis in self.directions})
        return found

    def made(self, ends: Sequence[Any], meshes: Mapping[str, fs.Mesh]) -> list[Any]:
        return [fs.Spring((part, f"{name}-{axis}"), stiffness=self.stiffness, damping=self.damping)
                for part, name in ends for axis in self.directions]
