"""A solid component under a belt, from any mesh file; without one, a disc like that of a brake."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from femsub import Material, Mesh, Substructure, annulus, read_mesh, solid
from femsub.app.keys import key
from femsub.app.scenes.component import ComponentScene
from femsub.components import DIRECTIONS
from femsub.errors import InputError


@dataclass(frozen=True)
class SolidScene(ComponentScene):
    """A steel disc (radii 50 and 150 mm, 12 mm thick) held at the inner rim, in SI units; any consistent units will do.

    The disc's sets of nodes are inner, outer, bottom, top, contact (cells on top, two around, next to the outer rim, at angle 0)
    and mounts (three nodes of the lower edge of the outer rim, 120° apart).
    """

    mesh: str = key("", "a mesh file of hexahedra or tetrahedra, relative to the scene file: whatever femsub.read_mesh reads",
                    otherwise="a disc of radii, thickness and elements", example="part.msh", file=True)
    kind: str = key("", "the kind of cells: of a mesh file of several kinds that to take, or of the disc",
                    otherwise="the file's only kind; 'hexahedron20' of the disc", example="hexahedron20")
    radii: list[float] = key([0.05, 0.15], "the disc's radii", unit="m", above=0, form="[inner, outer]")
    thickness: float = key(0.012, "the disc's thickness", unit="m", above=0)
    elements: list[int] = key([5, 48, 2], "the disc's bricks along the radius, around and through the thickness", least=1,
                              form="[radius, around, thickness]")
    E: float | list[float] = key(2.1e11, "Young's modulus: one for all, or one for each of groups", unit="Pa", above=0)
    nu: float | list[float] = key(0.3, "Poisson's ratio: one for all, or one for each of groups", above=-1, below=0.5)
    rho: float | list[float] = key(7850.0, "density: one for all, or one for each of groups", unit="kg/m³", above=0)
    groups: list[str] = key([], "groups of cells with a material of their own", otherwise="one material", example=["steel"])
    supports: list[str] = key([], "sets of nodes that are held, in all directions or as 'set:xy' in some",
                              otherwise="none of a mesh file; 'inner' of the disc", example=["inner"])
    interface: list[str] = key([], "sets of nodes through which the part is joined, in all directions or as 'set:xy' in some",
                               otherwise="none of a mesh file; 'mounts' of the disc", example=["mounts"])
    contact: str = key("", "the set of nodes under the belt: the average motion of its faces, cells, edges or nodes slides",
                       required_with="mesh", otherwise="'contact' of the disc", example="contact")
    direction: str | list[float] = key("y", "along which it slides: an axis, the surface's normal, against one of them, or a "
                                       "vector", form="[x, y, z]", choices=lambda _: DIRECTIONS)
    rayleigh: list[float] = key([5.0, 1e-7], "[alpha, beta] of the damping D = αM + βK", unit="1/s, s", form="[alpha, beta]")
    force: float = 8000.0
    modes: list[int] = field(default_factory=lambda: [10, 20, 40, 80])
    repeats: int = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.mesh:
            self.fill(supports=["inner"], interface=["mounts"], contact="contact")

    def component(self) -> tuple[Substructure, Mesh]:
        # the material: one, or one of each group
        count = max(1, len(self.groups))
        values = {"E": self.E, "nu": self.nu, "rho": self.rho}
        each = {name: value if isinstance(value, list) else [value] * count for name, value in values.items()}
        for name, value in each.items():
            if len(value) != count:
                raise InputError(f"{name} must be one number, or one for each of groups ({count}), but there are {len(value)}")
        made = [Material(*constants) for constants in zip(*each.values(), strict=True)]
        material = dict(zip(self.groups, made, strict=True)) if self.groups else made[0]
        # the mesh: that of the file, or the disc with its contact and three mounts
        if self.mesh:
            mesh = read_mesh(Path(self.folder) / self.mesh, kind=self.kind or None)
        else:
            kind = self.kind or "hexahedron20"
            mesh = annulus(self.radii[0], self.radii[1], self.thickness, self.elements, kind, name=self.name)
            radius, angle = np.hypot(*mesh.points[:, :2].T), np.arctan2(mesh.points[:, 1], mesh.points[:, 0])
            width, sector = (self.radii[1] - self.radii[0]) / self.elements[0], 2 * np.pi / self.elements[1]
            top = mesh.sets["top"]
            patch = top[(radius[top] > self.radii[1] - 1.01 * width) & (np.abs(angle[top]) < 1.01 * sector)]
            edge = np.intersect1d(mesh.sets["outer"], mesh.sets["bottom"])
            around = np.exp(1j * angle[edge])
            mounts = [edge[np.argmin(np.abs(around - np.exp(2j * np.pi * place)))] for place in (1 / 6, 1 / 2, 5 / 6)]
            mesh = mesh.with_sets(contact=patch, mounts=mounts)
        sub = solid(mesh, material, supports=motions(self.supports), interface=motions(self.interface),
                    ports={"belt": (self.contact, self.direction)}, rayleigh=(self.rayleigh[0], self.rayleigh[1]), name=self.name)
        return sub, mesh


def motions(names: list[str]) -> dict[str, str]:
    """{"inner": "xyz", "symmetry": "x"} of ["inner", "symmetry:x"]."""
    pairs = (name.rpartition(":") if ":" in name else (name, ":", "xyz") for name in names)
    return {name: axes for name, _, axes in pairs}
