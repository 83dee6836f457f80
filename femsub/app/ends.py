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
        """The end that words such as 'disc.track' name."""
        return cls(*re.fullmatch(r"([^.:]*)([.:]?)(.*)", words, re.DOTALL).groups())  # type: ignore[union-attr]

    @property
    def dofs(self) -> list[int]:
        """[0, 4] of 'disc:0,4'."""
        return [int(one) for one in self.rest.split(",") if one.strip().isdecimal()] if self.mark == ":" else []


class LinkKind(Kind):
    """A joint or a contact: it acts between ends, of which the first two may be surfaces."""

    facing: bool = False  #: whether only those faces of the second surface take part that lie opposite the first
    tolerance: float = 0.0  #: the largest distance of nodes or faces that meet; 0: none is given

    @property
    def tol(self) -> float | None:
        """The tolerance, if one is given."""
        return self.tolerance or None

    @property
    def surfaces(self) -> list[str]:
        """The ends of a joint, or the surfaces 'part.set' between which a contact acts."""
        return []

    def ports(self) -> Mapping[str, Mapping[str, Any]]:
        """Ports that it needs: part → name of the port → its definition."""
        return {}
