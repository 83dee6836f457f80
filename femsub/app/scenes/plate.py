"""A thin plate under a belt, from a mesh file or as a rectangle."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from femsub import Mesh, Substructure, plate, read_mesh, rectangle
from femsub.app.keys import key
from femsub.app.scene import Scene
from femsub.app.scenes.component import ComponentScene


@dataclass(frozen=True)
class PlateKeys(Scene):
    """The plate and its belt."""

    mesh: str = key("", "a mesh file of triangles or axis-parallel rectangles in a plane z = const, relative to the scene file",
                    otherwise="a rectangle of lengths, elements and cells", example="plate.msh", file=True)
    lengths: list[float] = key([0.4, 0.3], "the rectangle's sides", unit="m", above=0, form="[x, y]")
    elements: list[int] = key([32, 24], "numbers of cells along the rectangle's sides", least=1, form="[x, y]")
    cells: str = key("quad", "the rectangle's cells", choices=lambda _: ("quad", "triangle"))
    E: float = key(2.1e11, "Young's modulus", unit="Pa", above=0)
    nu: float = key(0.3, "Poisson's ratio", above=-1, below=0.5)
    rho: float = key(7850.0, "density", unit="kg/m³", above=0)
    thickness: float = key(0.002, "the plate's thickness", unit="m", above=0)
    clamped: list[str] = key(["left"], "sets of nodes that are clamped")
    simply_supported: list[str] = key([], "sets of nodes that are simply supported", otherwise="none", example=["edge"])
    contact: str | list[float] = key("", "the belt's place: a set of nodes (the mean of w over its cells, edges or nodes), or "
                                     "[x, y] of a node; the belt rubs along w", unit="m", form="[x, y]",
                                     required_with="mesh", otherwise="[3/4, 2/3] of the rectangle's sides", example="contact")
    rayleigh: list[float] = key([5.0, 1e-6], "[alpha, beta] of the damping D = αM + βK", unit="1/s, s", form="[alpha, beta]")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.mesh:
            self.fill(contact=[0.75 * self.lengths[0], 2 / 3 * self.lengths[1]])

    def whole(self) -> Mesh:
        """The mesh of the plate."""
        return read_mesh(Path(self.folder) / self.mesh) if self.mesh else \
            rectangle(self.lengths, self.elements, self.cells, name=self.name)

    @property
    def properties(self) -> dict[str, Any]:
        """What `plate` is given beside the mesh."""
        supports = dict.fromkeys(self.simply_supported, "simply supported") | dict.fromkeys(self.clamped, "clamped")
        return {"E": self.E, "nu": self.nu, "rho": self.rho, "thickness": self.thickness, "supports": supports,
                "ports": {"belt": self.contact}, "rayleigh": (self.rayleigh[0], self.rayleigh[1])}


@dataclass(frozen=True)
class PlateScene(ComponentScene, PlateKeys):
    """A steel plate of 0.4 m x 0.3 m x 2 mm, clamped along one side, in SI units; any consistent units will do.

    The rectangle's sets of nodes are left, right, front, back, edge (all four sides) and corners.
    """

    clamped: list[str] = key([], "sets of nodes that are clamped", otherwise="none of a mesh file; 'left' of the rectangle if "
                             "simply_supported is left out", example=["left"])
    interface: list[str] = key([], "sets of nodes through which the plate is joined; what is held is left out",
                               otherwise="none of a mesh file; 'corners' of the rectangle clamped at 'left'", example=["corners"])
    modes: list[int] = field(default_factory=lambda: [8, 10, 15, 20, 30])
    force: float = 30.0
    repeats: int = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.mesh or self.clamped or self.simply_supported):
            self.fill(clamped=["left"], interface=["corners"])

    def component(self) -> tuple[Substructure, Mesh]:
        mesh = self.whole()
        if not self.mesh:
            ends = [np.intersect1d(mesh.sets[x], mesh.sets[y]) for x in ("left", "right") for y in ("front", "back")]
            mesh = mesh.with_sets(corners=np.concatenate(ends))
        return plate(mesh, interface=self.interface, name=self.name, **self.properties), mesh
