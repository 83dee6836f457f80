"""A beam under a belt: the finite-element study in its smallest form, and its answer to a harmonic force at the contact."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from femsub import Mesh, Substructure, beam
from femsub.app.keys import key
from femsub.app.scenes.component import ComponentScene
from femsub.components import SUPPORTS


@dataclass(frozen=True)
class BeamScene(ComponentScene):
    """A steel beam of 1 m x 20 mm x 10 mm, clamped at the left, in SI units; any consistent units will do."""

    length: float = key(1.0, "the beam's length", unit="m", above=0)
    width: float = key(0.02, "the cross-section's width", unit="m", above=0)
    height: float = key(0.01, "the cross-section's height; the beam bends across it", unit="m", above=0)
    I: float = key(0.0, "second moment of area; 0 stands for that of the rectangle width x height", unit="m⁴", least=0)  # noqa: E741
    A: float = key(0.0, "area; 0 stands for that of the rectangle width x height", unit="m²", least=0)
    elements: int = key(200, "equal elements along the beam", least=1)
    E: float = key(2.1e11, "Young's modulus", unit="Pa", above=0)
    rho: float = key(7850.0, "density", unit="kg/m³", above=0)
    foundation: float = key(0.0, "stiffness of an elastic foundation per length", unit="N/m²", least=0)
    left: str = key("clamped", "how the left end is held", choices=lambda _: SUPPORTS)
    right: str = key("free", "how the right end is held", choices=lambda _: SUPPORTS)
    interface: list[float | str] = key(["right"], "nodes through which the beam is joined: 'left', 'right' or their x", unit="m")
    contact: float | str = key(0.35, "where the belt is: x of a node, 'left' or 'right'; it rubs across the beam, along w",
                               unit="m")
    rayleigh: list[float] = key([5.0, 1e-7], "[alpha, beta] of the damping D = αM + βK", unit="1/s, s", form="[alpha, beta]")
    force: float = 20.0
    modes: list[int] = field(default_factory=lambda: [6, 8, 10, 12, 16, 20])
    repeats: int = 3

    def component(self) -> tuple[Substructure, Mesh]:
        sub = beam(self.length, self.elements, E=self.E, I=self.I or self.width * self.height**3 / 12, rho=self.rho,
                   A=self.A or self.width * self.height, foundation=self.foundation,
                   supports={"left": self.left, "right": self.right}, interface=self.interface, ports={"belt": self.contact},
                   rayleigh=(self.rayleigh[0], self.rayleigh[1]), name=self.name)
        nodes = np.arange(self.elements + 1)
        places = nodes * (self.length / self.elements)
        return sub, Mesh(places[:, None], np.stack([nodes[:-1], nodes[1:]], axis=1), "line", name=self.name)



@dataclass(frozen=True)
class FrequencyResponseScene(BeamScene):
    """The steel beam of the scene `beam`, driven at its contact. Other component scenes have this output on request."""

    loss: float = 0.01
    rayleigh: list[float] = field(default_factory=lambda: [0.0, 0.0])
    modes: list[int] = field(default_factory=lambda: [6, 8, 10])

    OUTPUTS: ClassVar[tuple[str, ...]] = ("frequency-response",)
    ON_REQUEST: ClassVar[tuple[str, ...]] = BeamScene.OUTPUTS
