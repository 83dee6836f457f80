"""Coulomb friction between two surfaces."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.contacts import ContactKind
from femsub.app.kinds import key


@dataclass(frozen=True)
class FrictionContactKind(ContactKind):
    """Two surfaces that slide on each other, see `FrictionContact`. The second one moves along direction, or turns about axis."""

    friction: list[str] = key([], "the surfaces, the smaller one first: 'part.set'; the second may be 'ground'", required=True,
                              form="[first, second]", example=["pad.face", "disc.track"])
    stiffness: float = key(0.0, "normal stiffness per area", unit="force/length³", above=0, required=True, example=2e11)
    mu: float = key(0.0, "coefficient of friction", least=0)
    pressure: float = key(0.0, "pressure in steady sliding, for the damping by friction", unit="force/area", least=0)
    direction: list[float] = key([], "direction in which the second surface moves", form="[x, y, z]",
                                 otherwise="it turns about axis", example=[1.0, 0.0, 0.0])
    axis: list[float] = key([], "axis about which the second surface turns", form="[x, y, z]",
                            otherwise="it moves in direction", example=[0.0, 0.0, 1.0])
    centre: list[float] = key([0.0, 0.0, 0.0], "a point of the axis", unit="length", form="[x, y, z]")
    speed: float = key(0.0, "velocity along direction, or angular velocity about axis (rad/time)", least=0,
                       otherwise="without damping by friction")
    slope: float = key(0.0, "μ', the slope of μ over the sliding speed", unit="time/length")
    tolerance: float = key(0.0, "largest distance of the surfaces", unit="length", least=0,
                           otherwise="0.05 of the size of a face")
    facing: bool = key(False, "whether only those faces of the second surface take part that lie opposite the first, such as "
                       "the few faces of a disc's track under the pad")

    KIND: ClassVar[str] = "friction"

    @property
    def surfaces(self) -> list[str]:
        return list(self.friction)

    def parameters(self) -> list[str]:
        return ["mu", "stiffness", "pressure", "speed", "slope"]

    def made(self, port: Callable[[str], str], meshes: Mapping[str, fs.Mesh], surfaces: list[str]) -> Any:
        return fs.FrictionContact(surfaces[0], surfaces[1], meshes, self.stiffness, self.mu, self.pressure,
                                  direction=np.array(self.direction) if self.direction else None,
                                  axis=np.array(self.axis) if self.axis else None, centre=np.array(self.centre),
                                  speed=self.speed or None, slope=self.slope, tol=self.tol)

    @property
    def words(self) -> str:
        """The friction in words, for the first printed lines."""
        return (f"friction of {self.friction[0]} on {self.friction[1]}: μ = {self.mu:g}, stiffness {self.stiffness:g}, "
                f"pressure {self.pressure:g}")
