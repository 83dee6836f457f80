"""A belt that slides under a port."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import femsub as fs
from femsub.app.contacts import ContactKind
from femsub.app.kinds import key
from femsub.checks import InputError


@dataclass(frozen=True)
class BeltContactKind(ContactKind):
    """Friction F μ(v0 - wᵀẋ) at a port: a belt of speed v0, pressed on with F. Linear analyses use only its slope."""

    belt: str = key("", "the port it slides under, 'part.port'", required=True, example="chain.belt")
    force: float = key(1.0, "the normal force with which it presses", unit="force", least=0)
    speed: float = key(0.19113, "its speed v0", unit="length/time")
    law: str = key("stribeck-arctan", "the friction law: as the paper prints it, odd, or one of your own in LAWS",
                   choices=lambda _: fs.coupling.LAWS)
    eps: float = key(1e-3, "the friction law's width ε around speed 0", unit="length/time", above=0)
    slope: float | None = key(None, "μ'(v0), the slope of the friction law over the sliding speed; it replaces law, eps, speed",
                              unit="time/length", otherwise="the slope of law at speed", example=-0.2677)

    KIND: ClassVar[str] = "belt"

    @property
    def places(self) -> list[str]:
        return [self.belt]

    def parameters(self) -> list[str]:
        return ["slope", "force", "speed"]

    def made(self, port: Callable[[str], str], meshes: Mapping[str, fs.Mesh], surfaces: list[str]) -> Any:
        at = port(self.belt)
        if self.slope is not None:
            return fs.coupling.Belt(port=at, force=self.force, slope=self.slope)
        return fs.coupling.Belt(port=at, force=self.force, speed=self.speed, law=fs.coupling.LAWS[self.law](eps=self.eps))

    @property
    def words(self) -> str:
        """The friction in words, for the first printed lines."""
        if self.slope is not None:
            return f"belt at {self.belt}: F = {self.force:g}, slope {self.slope:.6g}"
        slope = self.made(lambda at: at, {}, []).slope
        return (f"belt at {self.belt}: F = {self.force:g}, {self.law}, ε = {self.eps:g}, v0 = {self.speed:g}: "
                f"μ' = {slope:.6g}")

    def check_nonlinear(self) -> None:
        """Refuses a belt that has only a slope and no friction law."""
        if self.slope is not None:
            raise InputError("the nonlinear model needs a friction law, i.e. law, eps and speed, not a slope")
