"""A linear contact at ports."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import femsub as fs
from femsub.app.contacts import ContactKind
from femsub.app.kinds import key


@dataclass(frozen=True)
class LinearContactKind(ContactKind):
    """Matrices on ports, W C Wᵀ: D becomes D + W C_D Wᵀ and K becomes K + W C_K Wᵀ. They may be unsymmetric."""

    linear: list[str] = key([], "the ports, 'part.port'", required=True, example=["disc.normal", "disc.along"])
    stiffness: list[list[float]] = key([], "C_K, by rows", unit="force/length", otherwise="0", example=[[1e6, 0.0], [4e5, 0.0]])
    damping: list[list[float]] = key([], "C_D, by rows", unit="force·time/length", otherwise="0")

    KIND: ClassVar[str] = "linear"

    @property
    def places(self) -> list[str]:
        return list(self.linear)

    def made(self, port: Callable[[str], str], meshes: Mapping[str, fs.Mesh], surfaces: list[str]) -> Any:
        return fs.LinearContact(tuple(map(port, self.linear)), self.stiffness or None, self.damping or None)  # type: ignore[arg-type]

    @property
    def words(self) -> str:
        """The contact in words, for the first printed lines."""
        return f"linear contact at {', '.join(self.linear)}"
