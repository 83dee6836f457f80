"""Parameters of a scene: quantities that may change in an analysis, and their ranges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import femsub as fs
from femsub.app.kinds import key
from femsub.checks import InputError, unknown_name

if TYPE_CHECKING:
    from femsub.app.models import Models

CONSTANTS = ("E", "nu", "rho", "loss", "thickness")


@dataclass(frozen=True)
class ParameterKeys:
    """A quantity that may change: a key of the contacts or a name in factors of matrices, if the parameter has the same name.

    Otherwise one of these keys says what changes: a constant of a material, `material = "pad.lining"`, or a mass that is added at
    an end, or a spring or a damper from an end to the ground.
    """

    between: list[float] = key([], "its range", form="[lo, hi]", otherwise="each analysis has its own", example=[0.0, 0.6])
    value: float | None = key(None, "its value where it does not change", otherwise="that of the contact", example=0.4)
    deviation: float = key(0.0, "standard deviation of a normal distribution about the value, for scatter", least=0,
                           otherwise="it is uniform over its range")
    material: str = key("", "the part, or 'part.group', whose material changes", otherwise="no material changes",
                        example="pad.lining")
    constant: str = key("E", "which constant of the material", choices=lambda _: CONSTANTS)
    mass: str = key("", "the end 'part.set' at which a mass is added", otherwise="none", example="disc.rim")
    spring: str = key("", "the end at which a spring is added", otherwise="none", example="pad.back")
    damper: str = key("", "the end at which a damper is added", otherwise="none", example="pad.back")
    directions: list[str] = key([], "motions on which mass, spring or damper act", otherwise="all translations", example=["uz"])

    def __post_init__(self) -> None:
        if len(self.acts) > 1:
            raise InputError(f"{' and '.join(self.acts)} are given: a parameter is one of them")

    @property
    def acts(self) -> list[str]:
        """The keys that say what changes: at most one of them is given."""
        return [name for name in ("material", "mass", "spring", "damper") if getattr(self, name)]

    @property
    def range(self) -> tuple[float, float] | None:
        """The range, if one is given."""
        return (self.between[0], self.between[1]) if self.between else None

    def change(self, models: Models) -> Any:
        """The change of the models, such as `AddedMass`; None for a parameter of contacts or of matrices."""
        if not self.acts:
            return None
        what, = self.acts
        if what != "material":
            made = {"mass": fs.AddedMass, "spring": fs.AddedSpring, "damper": fs.AddedDamper}[what]
            return made(models.at_end(getattr(self, what)), directions=self.directions or None)
        name, _, group = self.material.partition(".")
        part = models.scene.parts.get(name)
        if part is None:
            raise unknown_name("part", name, models.scene.parts)
        return part.changed(models.scene.site(name), models.scene.meshes.get(name), group, self.constant,
                            "" if models.alone else name)
