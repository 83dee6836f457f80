"""Surfaces of meshes that do not match, glued."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import femsub as fs
from femsub.app.ends import GROUND
from femsub.app.joints import JointKind
from femsub.app.kinds import key
from femsub.checks import InputError


@dataclass(frozen=True)
class TiedJointKind(JointKind):
    """Two surfaces, glued. With `facing`, only those faces of the second surface are joined that lie opposite the first."""

    tied: list[str] = key([], "the surfaces, 'part.set'; the first is the smaller one", required=True, form="[first, second]",
                          example=["post.bottom", "base.top"])
    facing: bool = key(False, "whether only those faces of the second surface are joined that lie opposite the first")

    KIND: ClassVar[str] = "tied"

    def made(self, ends: Sequence[Any], meshes: Mapping[str, fs.Mesh]) -> list[Any]:
        for words, end in zip(self.tied, ends, strict=True):
            if end == GROUND or end[0] not in meshes:
                raise InputError(f"glue joins surfaces of meshes, but {words!r} is none")
        return [fs.Tied(ends[0], ends[1], {end[0]: meshes[end[0]] for end in ends}, tol=self.tol)]
