"""A plane beam of Hermite elements."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.kinds import key
from femsub.app.parts import RAYLEIGH, Made, Part, PartSite, rates
from femsub.checks import InputError


@dataclass(frozen=True)
class BeamPart(Part):
    """A beam along x that bends in the plane of x and w.

    A joint or contact names a node as 'part.left', 'part.right' or by its x, 'part.0.35'. Ports act along w.
    """

    beam: float = key(1.0, "its length", unit="length", above=0, required=True, example=1.0)
    material: str = key("", "the name of its material", required=True, example="steel")
    elements: int = key(20, "equal elements along it", least=1, most=10**7)
    width: float = key(0.0, "the cross-section's width", unit="length", least=0, otherwise="I and A are given", example=0.02)
    height: float = key(0.0, "the cross-section's height; it bends across it", unit="length", least=0,
                        otherwise="I and A are given", example=0.01)
    I: float = key(0.0, "second moment of area", unit="length⁴", least=0,  # noqa: E741
                   otherwise="from width and height of a rectangle")
    A: float = key(0.0, "area", unit="length²", least=0, otherwise="from width and height of a rectangle")
    foundation: float = key(0.0, "stiffness of an elastic foundation per length", unit="force/length²", least=0)
    left: str = key("free", "how the left end is held", choices=lambda _: fs.components.SUPPORTS)
    right: str = key("free", "how the right end is held", choices=lambda _: fs.components.SUPPORTS)
    ports: dict[str, Any] = key({}, "places by their names: x of a node, 'left' or 'right'", otherwise="none",
                                example={"belt": 0.35})
    rayleigh: list[float] = key([], "[alpha, beta] of the damping D = αM + βK", **RAYLEIGH)

    KIND: ClassVar[str] = "beam"

    def __post_init__(self) -> None:
        if not (self.I or (self.width and self.height)) or not (self.A or (self.width and self.height)):
            raise InputError("give width and height, or I and A")

    def mesh(self, site: PartSite) -> fs.Mesh | None:
        return fs.components.line(np.arange(self.elements + 1) * (self.beam / self.elements), site.name)

    @property
    def section(self) -> dict[str, float]:
        """Second moment of area I and area A, by these names."""
        return {"I": self.I or self.width * self.height**3 / 12, "A": self.A or self.width * self.height}

    def changed(self, site: PartSite, mesh: fs.Mesh | None, group: str, constant: str, part: str) -> Any:
        of = site.material(self.material)
        return fs.MaterialChange.beam(self.beam, self.elements, constant, E=of.E, rho=of.rho, foundation=self.foundation,
                                      part=part, rayleigh=rates(self.rayleigh), **self.section)

    def made(self, site: PartSite, mesh: fs.Mesh | None) -> Made:
        of = site.material(self.material)
        return self.one(site, fs.beam(
            self.beam, self.elements, E=of.E, rho=of.rho, **self.section, foundation=self.foundation,
            supports={"left": self.left, "right": self.right},
            interface=self.prefer(site), ports=self.ports, rayleigh=rates(self.rayleigh), name=site.name), mesh)

    def end(self, words: str, sets: Iterable[str] | None) -> Any:
        if words in ("left", "right"):
            return words
        try:
            return float(words)
        except ValueError:
            raise InputError(f"{words!r} is no node of a beam: name 'left', 'right' or its x") from None
