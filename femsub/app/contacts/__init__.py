"""Contacts of a scene. `ContactKind` is the base class of all kinds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from femsub.app.ends import LinkKind

if TYPE_CHECKING:
    from femsub import Mesh


@dataclass(frozen=True)
class ContactKind(LinkKind):
    """The base class of contacts: the places or surfaces on which a contact acts, and the contact object of the models."""

    FAMILY: ClassVar[str] = "contact"

    @property
    def places(self) -> list[str]:
        """Ports 'part.port' that it acts on."""
        return []

    def parameters(self) -> list[str]:
        """The names of its parameters, which may change in an analysis."""
        return []

    def check_nonlinear(self) -> None:
        """Refuses a contact that has no nonlinear law, for analyses of nonlinear motion."""

    def made(self, port: Callable[[str], str], meshes: Mapping[str, Mesh], surfaces: list[str]) -> Any:
        """The contact object. `port` gives the name of a place in the model; `surfaces` are names of the model's surfaces."""
        raise NotImplementedError
