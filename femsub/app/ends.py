"""Ends of joints and contacts in scene files: 'part.set', 'part', 'part:0,4' or 'ground'."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, NamedTuple, Self

from femsub.app.kinds import Kind

GROUND = "ground"


class End(NamedTuple):
    """A part, the mark behind its name ('.', ':' or none), and the set, port or DOF."""

    part: str
    mark: str = ""
    rest: str = ""

    @classmethod
    def of(cls, words: str) -> Self:
        """That of 'disc.track'."""
        return cls(*re.fullmatch(r"([^.:]*)([.:]?)(.*)", words, re.DOTALL).groups())  # type: ignore[union-attr]

    @property
    def dofs(self) -> list[int]:
        """[0, 4] of 'disc:0,4'."""
        return [int(one) for one in self.rest.split(",") if one.strip().isdecimal()] if self.mark == ":" else []


class LinkKind(Kind):
    """A joint or a contact: it acts between ends, of which the first two may be surfaces."""

    facing: bool = False  #: whether the second surface takes part where it lies opposite the first alone

    @property
    def tol(self) -> float | None:
        """The largest distance of what meets, if one is given."""
        return None

    @property
    def surfaces(self) -> list[str]:
        """The ends, or the sets 'part.set' that a contact acts between."""
        return []

    def ports(self) -> Mapping[str, Mapping[str, Any]]:
        """Ports that parts need for it, by parts."""
        return {}
