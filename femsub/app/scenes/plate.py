"""A thin plate under a belt, from a mesh file or as a rectangle."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from femsub import Mesh, Substructure, plate, rectangle
from femsub.app.keys import key
from femsub.app.scenes.component import ComponentScene
from femsub.app.scenes.outputs import run_component


@dataclass(frozen=True)
class PlateScene(ComponentScene):
    """A steel plate of 0.4 m x 0.3 m x 2 mm, clamped along one side, in SI units; any consistent units will do.

    The rectangle's sets of nodes are left, right, front, back, edge (all four sides) and corners.
    """

    mesh: str = key("", "a mesh file of triangles or axis-parallel rectangles in a plane z = const, relative to the scene file",
                    otherwise="a rectangle of lengths, elements and cells", example="plate.msh", file=True)
    lengths: list[float] = key([0.4, 0.3], "the rectangle's sides", unit="m", above=0, form="[x, y]")
    elements: list[int] = key([32, 24], "numbers of cells along the rectangle's sides", least=1, form="[x, y]")
    cells: str = key("quad", "the rectangle's cells", choices=lambda _: ("quad", "triangle"))
    E: float = key(2.1e11, "Young's modulus", unit="Pa", above=0)
    nu: float = key(0.3, "Poisson's ratio", above=-1, below=0.5)
    rho: float = key(7850.0, "density", unit="kg/m³", above=0)
    thickness: float = key(0.002, "the plate's thickness", unit="m", above=0)
    clamped: list[str] = key([], "sets of nodes that are clamped", otherwise="none of a mesh file; 'left' of the rectangle if "
                             "simply_supported is left out", example=["left"])
    simply_supported: list[str] = key([], "sets of nodes that are simply supported", otherwise="none", example=["edge"])
    interface: list[str] = key([], "sets of nodes through which the plate is joined; what is held is left out",
                               otherwise="none of a mesh file; 'corners' of the rectangle clamped at 'left'", example=["corners"])
    contact: str | list[float] = key("", "the belt's place: a set of nodes (the mean of w over its cells, edges or nodes), or "
                                     "[x, y] of a node; the belt rubs along w", unit="m", form="[x, y]",
                                     required_with="mesh", otherwise="[3/4, 2/3] of the rectangle's sides", example="contact")
    rayleigh: list[float] = key([5.0, 1e-6], "[alpha, beta] of the damping D = αM + βK", unit="1/s, s", form="[alpha, beta]")
    force: float = 30.0
    modes: list[int] = field(default_factory=lambda: [8, 10, 15, 20, 30])
    repeats: int = 3
    folder: str = "."

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mesh:
            return
        if not self.clamped and not self.simply_supported:
            object.__setattr__(self, "clamped", ["left"])
            object.__setattr__(self, "interface", self.interface or ["corners"])
        if not self.contact:
            object.__setattr__(self, "contact", [0.75 * self.lengths[0], 2 / 3 * self.lengths[1]])

    def component(self) -> tuple[Substructure, Mesh]:
        mesh = self._mesh()
        supports = dict.fromkeys(self.simply_supported, "simply supported") | dict.fromkeys(self.clamped, "clamped")
        sub = plate(mesh, E=self.E, nu=self.nu, rho=self.rho, thickness=self.thickness, supports=supports,
                    interface=self.interface, ports={"belt": self.contact}, rayleigh=(self.rayleigh[0], self.rayleigh[1]),
                    name=self.name)
        return sub, mesh

    def _mesh(self) -> Mesh:
        if self.mesh:
            from femsub.io import read_mesh

            return read_mesh(Path(self.folder) / self.mesh)
        made = rectangle(self.lengths, self.elements, self.cells, name=self.name)
        ends = [np.intersect1d(made.sets[x], made.sets[y]) for x in ("left", "right") for y in ("front", "back")]
        return made.with_sets(corners=np.concatenate(ends))


SCENE, run = PlateScene, run_component
