"""A beam under a belt: the finite-element study in its smallest form."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from femsub import Mesh, Substructure, beam
from femsub.app.scenes.component import ComponentScene
from femsub.app.scenes.outputs import run_component
from femsub.checks import positive_number


@dataclass(frozen=True)
class BeamScene(ComponentScene):
    """A steel beam of 1 m x 20 mm x 10 mm, clamped at the left, in SI units; any consistent units will do.

    Attributes
    ----------
    length, width, height : float
        Bending is across the height (m).
    I, A : float
        Second moment of area (m⁴) and area (m²); 0 stands for those of the rectangle width x height.
    elements : int
        Equal elements.
    E, rho : float
        Young's modulus (Pa) and density (kg/m³).
    foundation : float
        Stiffness of an elastic foundation per length (N/m²).
    left, right : str
        'clamped', 'pinned', 'guided' or 'free'.
    interface : list of float or str
        'left', 'right' or the x of nodes (m).
    contact : float or str
        Where the belt is; it rubs across the beam, along w.
    rayleigh : list of float
        [alpha, beta] of D = αM + βK (1/s, s).
    """

    length: float = 1.0
    width: float = 0.02
    height: float = 0.01
    I: float = 0.0  # noqa: E741
    A: float = 0.0
    elements: int = 200
    E: float = 2.1e11
    rho: float = 7850.0
    foundation: float = 0.0
    left: str = "clamped"
    right: str = "free"
    interface: list[float | str] = field(default_factory=lambda: ["right"])
    contact: float | str = 0.35
    rayleigh: list[float] = field(default_factory=lambda: [5.0, 1e-7])
    force: float = 20.0
    modes: list[int] = field(default_factory=lambda: [6, 8, 10, 12, 16, 20])
    repeats: int = 3

    def component(self) -> tuple[Substructure, Mesh]:
        for key in ("width", "height"):
            positive_number(key, getattr(self, key))
        sub = beam(self.length, self.elements, E=self.E, I=self.I or self.width * self.height**3 / 12, rho=self.rho,
                   A=self.A or self.width * self.height, foundation=self.foundation,
                   supports={"left": self.left, "right": self.right}, interface=self.interface, ports={"belt": self.contact},
                   rayleigh=self.rayleigh_pair(self.rayleigh), name=self.name)
        nodes = np.arange(self.elements + 1)
        places = nodes * (self.length / self.elements)
        return sub, Mesh(places[:, None], np.stack([nodes[:-1], nodes[1:]], axis=1), "line", name=self.name)


SCENE, run = BeamScene, run_component
