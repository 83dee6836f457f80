"""A thin plate under a belt, from a mesh file or as a rectangle."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from femsub import Mesh, Substructure, plate, rectangle
from femsub.app.scenes.component import ComponentScene
from femsub.app.scenes.outputs import run_component
from femsub.errors import InputError


@dataclass(frozen=True)
class PlateScene(ComponentScene):
    """A steel plate of 0.4 m x 0.3 m x 2 mm, clamped along one side, in SI units; any consistent units will do.

    Attributes
    ----------
    mesh : str
        A mesh file of triangles or axis-parallel rectangles in a plane z = const, relative to the scene file. Without
        one a rectangle is made from `lengths`, `elements` and `cells`.
    lengths, elements, cells
        Sides (m), numbers of cells along them, 'quad' or 'triangle'. Its sets of nodes are left, right, front, back, edge
        (all four sides) and corners.
    E, nu, rho, thickness : float
        Young's modulus (Pa), Poisson's ratio, density (kg/m³), thickness (m).
    clamped, simply_supported : list of str
        Sets of nodes that are held.
    interface : list of str
        Sets through which the plate is joined; what is held is left out.
    contact : str, or list of float
        The belt's place: a set (the mean of w over its cells, edges or nodes), or [x, y] of a node (m). It rubs along w.
    rayleigh : list of float
        [alpha, beta] of D = αM + βK (1/s, s).
    """

    mesh: str = ""
    lengths: list[float] = field(default_factory=lambda: [0.4, 0.3])
    elements: list[int] = field(default_factory=lambda: [32, 24])
    cells: str = "quad"
    E: float = 2.1e11
    nu: float = 0.3
    rho: float = 7850.0
    thickness: float = 0.002
    clamped: list[str] = field(default_factory=list)
    simply_supported: list[str] = field(default_factory=list)
    interface: list[str] = field(default_factory=list)
    contact: str | list[float] = ""
    rayleigh: list[float] = field(default_factory=lambda: [5.0, 1e-6])
    force: float = 30.0
    modes: list[int] = field(default_factory=lambda: [8, 10, 15, 20, 30])
    repeats: int = 3
    folder: str = "."

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mesh:
            if not self.contact:
                raise InputError("scene key 'contact' is missing: name the set of nodes of the mesh under the belt, or [x, y]")
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
                    interface=self.interface, ports={"belt": self.contact}, rayleigh=self.rayleigh_pair(self.rayleigh),
                    name=self.name)
        return sub, mesh

    def _mesh(self) -> Mesh:
        if self.mesh:
            from femsub.io.mesh_files import read_mesh

            return read_mesh(Path(self.folder) / self.mesh)
        made = rectangle(self.lengths, self.elements, self.cells, name=self.name)
        ends = [np.intersect1d(made.sets[x], made.sets[y]) for x in ("left", "right") for y in ("front", "back")]
        return made.with_sets(corners=np.concatenate(ends))


SCENE, run = PlateScene, run_component
