"""A solid component under a belt, from any mesh file; without one, a disc like that of a brake."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from femsub import Material, Mesh, Substructure, annulus, solid
from femsub.app.scenes.component import ComponentScene
from femsub.app.scenes.outputs import run_component
from femsub.errors import InputError


@dataclass(frozen=True)
class SolidScene(ComponentScene):
    """A steel disc (radii 50 and 150 mm, 12 mm thick) held at the inner rim, in SI units; any consistent units will do.

    Attributes
    ----------
    mesh : str
        A mesh file of hexahedra or tetrahedra, relative to the scene file: whatever `read_mesh` reads.
    kind : str
        The kind of cells: of a mesh file of several kinds that to take; of the disc 'hexahedron20' by default.
    radii, thickness, elements
        Of the disc that is made without a file: radii and thickness (m), bricks along the radius, around and through the
        thickness. Its sets of nodes are inner, outer, bottom, top, contact (cells on top, two around, next to the outer
        rim, at angle 0) and mounts (three nodes of the lower edge of the outer rim, 120° apart).
    E, nu, rho : float, or list of float
        Young's modulus (Pa), Poisson's ratio, density (kg/m³): one for all, or one for each of `groups`.
    groups : list of str
        Groups of cells with a material of their own.
    supports, interface : list of str
        Sets of nodes that are held, and through which the part is joined, in all directions or as "set:xy" in some.
    contact : str
        The set under the belt: the average motion of its faces, cells, edges or nodes is what slides (see `femsub.solid`).
    direction : str, or list of float
        Along which it slides: 'x', 'y', 'z', 'normal', against one of them ('-x', ...), or a vector.
    rayleigh : list of float
        [alpha, beta] of D = αM + βK (1/s, s).
    """

    mesh: str = ""
    kind: str = ""
    radii: list[float] = field(default_factory=lambda: [0.05, 0.15])
    thickness: float = 0.012
    elements: list[int] = field(default_factory=lambda: [5, 48, 2])
    E: float | list[float] = 2.1e11
    nu: float | list[float] = 0.3
    rho: float | list[float] = 7850.0
    groups: list[str] = field(default_factory=list)
    supports: list[str] = field(default_factory=list)
    interface: list[str] = field(default_factory=list)
    contact: str = ""
    direction: str | list[float] = "y"
    rayleigh: list[float] = field(default_factory=lambda: [5.0, 1e-7])
    force: float = 8000.0
    modes: list[int] = field(default_factory=lambda: [10, 20, 40, 80])
    repeats: int = 3
    folder: str = "."

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mesh:
            if not self.contact:
                raise InputError("scene key 'contact' is missing: name the set of nodes of the mesh under the belt")
            return
        for key, value in (("supports", ["inner"]), ("interface", ["mounts"]), ("contact", "contact")):
            if not getattr(self, key):
                object.__setattr__(self, key, value)

    def component(self) -> tuple[Substructure, Mesh]:
        mesh = self._mesh()
        sub = solid(mesh, self._material(), supports=_motions(self.supports), interface=_motions(self.interface),
                    ports={"belt": (self.contact, self.direction)}, rayleigh=self.rayleigh_pair(self.rayleigh), name=self.name)
        return sub, mesh

    def _material(self) -> Material | Mapping[str, Material]:
        values = {key: getattr(self, key) for key in ("E", "nu", "rho")}
        count = max(1, len(self.groups))
        each = {key: value if isinstance(value, list) else [value] * count for key, value in values.items()}
        for key, value in each.items():
            if len(value) != count:
                raise InputError(f"{key} must be one number, or one for each of groups ({count}), but there are {len(value)}")
        made = [Material(*constants) for constants in zip(*each.values(), strict=True)]
        return dict(zip(self.groups, made, strict=True)) if self.groups else made[0]

    def _mesh(self) -> Mesh:
        if self.mesh:
            from femsub.io.mesh_files import read_mesh

            return read_mesh(Path(self.folder) / self.mesh, kind=self.kind or None)
        if len(self.radii) != 2:
            raise InputError(f"radii must be [inner, outer], not {self.radii}")
        made = annulus(self.radii[0], self.radii[1], self.thickness, self.elements, self.kind or "hexahedron20", name=self.name)
        radius, angle = np.hypot(*made.points[:, :2].T), np.arctan2(made.points[:, 1], made.points[:, 0])
        width, sector = (self.radii[1] - self.radii[0]) / self.elements[0], 2 * np.pi / self.elements[1]
        top = made.sets["top"]
        patch = top[(radius[top] > self.radii[1] - 1.01 * width) & (np.abs(angle[top]) < 1.01 * sector)]
        edge = np.intersect1d(made.sets["outer"], made.sets["bottom"])
        around = np.exp(1j * angle[edge])
        mounts = [edge[np.argmin(np.abs(around - np.exp(2j * np.pi * place)))] for place in (1 / 6, 1 / 2, 5 / 6)]
        return made.with_sets(contact=patch, mounts=mounts)


SCENE, run = SolidScene, run_component


def _motions(names: list[str]) -> dict[str, str]:
    """{"inner": "xyz", "symmetry": "x"} of ["inner", "symmetry:x"]."""
    pairs = (name.rpartition(":") if ":" in name else (name, ":", "xyz") for name in names)
    return {name: axes for name, _, axes in pairs}
