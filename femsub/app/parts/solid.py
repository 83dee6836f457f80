"""A solid, from any mesh file, or a disc, a block, or a part of femsub's own brake."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.kinds import key
from femsub.app.parts import RAYLEIGH, Made, Part, PartSite, from_file, motions, rates
from femsub.checks import Array, InputError, unknown_name

BRICKS = ("hexahedron", "hexahedron20", "hexahedron27")
BRAKE = ("disc", "inboard", "outboard")


@dataclass(frozen=True)
class Shape:
    """A solid that femsub builds: a disc of `radii` about z, a block of `lengths`, or a part of femsub's own `brake`.

    A block has the sets left, right, front, back, bottom and top. A disc has inner, outer, bottom, top, contact (cells on top,
    two around, next to the outer rim, at angle 0) and mounts (three nodes of the lower edge of the outer rim, 120° apart).
    """

    radii: list[float] = key([], "radii of a disc", unit="length", above=0, form="[inner, outer]", otherwise="no disc",
                             example=[0.05, 0.15])
    thickness: float = key(0.0, "thickness of a disc", unit="length", above=0, required_with="radii", example=0.012)
    lengths: list[float] = key([], "edges of a block", unit="length", above=0, form="[x, y, z]", otherwise="no block")
    brake: str = key("", "part of femsub's own brake, whose unit is m", choices=lambda _: BRAKE, otherwise="no brake")
    size: float = key(0.025, "length of the elements of a part of the brake", unit="m", above=0)
    elements: list[int] = key([], "bricks along the radius, around and through the thickness, or along x, y and z", least=1,
                              form="[1, 2, 3]", otherwise="4, 48 and 2", example=[5, 48, 2])
    cells: str = key("hexahedron20", "the kind of bricks", choices=lambda _: BRICKS)
    at: list[float] = key([], "position of a block's corner of least x, y, z, or of the centre of a disc's lower face",
                          unit="length", form="[x, y, z]", otherwise="the origin")

    def __post_init__(self) -> None:
        if sum(map(bool, (self.radii, self.lengths, self.brake))) != 1:
            raise InputError("give radii and thickness of a disc, lengths of a block, or brake")

    def mesh(self, name: str) -> fs.Mesh:
        """The mesh with its sets."""
        counts = self.elements or [4, 48, 2]
        if self.brake:
            return _brake(self.size)[self.brake]
        made = fs.components.mounted_disc(self.radii[0], self.radii[1], self.thickness, counts, self.cells, name) if self.radii \
            else fs.block(self.lengths, counts, self.cells, name=name)
        return replace(made, points=made.points + np.array(self.at)) if self.at else made


_brake = cache(fs.coupling.brake_meshes)  # it makes the meshes of all three parts, which are asked for one by one


@dataclass(frozen=True)
class NearKeys:
    """A set of one node: the node of the set `of` that is nearest to a point."""

    of: str = key("", "the set to which the node belongs", otherwise="any node")
    near: list[float] = key([], "the point; two numbers: only distances along x and y count", unit="length",
                            required=True, example=[0.0, 0.0, 0.1])

    def nodes(self, mesh: fs.Mesh) -> Array:
        """The row of the node in the mesh, as an array of one number."""
        if self.of and self.of not in mesh.sets:
            raise unknown_name("set", self.of, mesh.sets)
        rows, point = mesh.sets[self.of] if self.of else np.arange(len(mesh.points)), self.near[:3]
        return rows[[np.linalg.norm(mesh.points[rows, :len(point)] - point, axis=1).argmin()]]


@dataclass(frozen=True)
class SolidPart(Part):
    """A solid of hexahedra or tetrahedra. A set of nodes is held or joined in all directions, or as 'set:xy' in some."""

    solid: str | Shape = key("", "a mesh file that femsub.read_mesh reads, or a shape that femsub builds", file=True,
                             required=True, example="part.msh")
    material: str | dict[str, str] = key("", "the name of its material, or a name for each group of cells", required=True,
                                         example={"lining": "friction", "plate": "steel"})
    cells: str = key("", "the kind of cells, if the file has several kinds", otherwise="the file's only kind",
                     example="hexahedron20")
    supports: list[str] = key([], "sets that are held", otherwise="none", example=["hub"])
    ports: dict[str, Any] = key({}, "mean motions by their names: a set (motion along y), or [set, direction]; a direction is an "
                                "axis, the surface's 'normal', or a vector", otherwise="none", example={"belt": ["contact", "y"]})
    sets: dict[str, NearKeys] = key({}, "further sets of one node each", otherwise="none")
    rayleigh: list[float] = key([], "[alpha, beta] of the damping D = αM + βK", **RAYLEIGH)

    KIND: ClassVar[str] = "solid"

    def sets_named(self) -> Iterable[tuple[str, str]]:
        ports = [one if isinstance(one, str) else one[0] for one in self.ports.values() if one]
        for key_, names in (("supports", motions(self.supports)), ("interface", motions(self.interface)), ("ports", ports)):
            yield from ((key_, str(name)) for name in names)

    def mesh(self, site: PartSite) -> fs.Mesh | None:
        made = self.solid.mesh(site.name) if isinstance(self.solid, Shape) else fs.read_mesh(
            from_file(site, self.solid), kind=self.cells or None)
        return made.with_sets(**{name: one.nodes(made) for name, one in self.sets.items()}) if self.sets else made

    def made(self, site: PartSite, mesh: fs.Mesh | None) -> Made:
        material: fs.Material | dict[str, fs.Material] = site.material(self.material) if isinstance(self.material, str) else {
            group: site.material(name) for group, name in self.material.items()}
        ports = {name: (one, "y") if isinstance(one, str) else tuple(one) for name, one
                 in (self.ports | dict(site.ports)).items()}
        assert mesh is not None
        return self.one(site, fs.solid(mesh, material, supports=motions(self.supports), interface=motions(self.prefer(site)),
                                       ports=ports, rayleigh=rates(self.rayleigh), name=site.name), mesh)

    def changed(self, site: PartSite, mesh: fs.Mesh | None, group: str, constant: str, part: str) -> Any:
        if isinstance(self.material, dict) and group not in self.material:
            raise unknown_name(f"group of {site.name!r}", group, self.material)
        name = self.material[group] if isinstance(self.material, dict) else self.material
        assert mesh is not None
        return fs.MaterialChange.solid(mesh, site.material(name), constant, cells=group or None, part=part,
                                       rayleigh=rates(self.rayleigh))
