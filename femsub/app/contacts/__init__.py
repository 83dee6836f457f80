"""Contacts of a scene. `ContactKind` is what all kinds share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from femsub.app.ends import LinkKind

if TYPE_CHECKING:
    from femsub import Mesh


@dataclass(frozen=True)
class ContactKind(LinkKind):
    """What all kinds of contacts have: places, surfaces that they join, and the contact of the models."""

    FAMILY: ClassVar[str] = "contact"

    @property
    def places(self) -> list[str]:
        """Ports 'part.port' that it acts on."""
        return []

    def parameters(self) -> list[str]:
        """What may change in an analysis."""
        return []

    def check_nonlinear(self) -> None:
        """Refuses a contact that is linear alone, where motion in time is asked for."""

    def made(self, port: Callable[[str], str], meshes: Mapping[str, Mesh], surfaces: list[str]) -> Any:
        """The contact; `port` gives the name that a place has in the model, `surfaces` are those of the model."""
        raise NotImplementedError
