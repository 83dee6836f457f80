"""A thin plate, from a mesh file or as a rectangle."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.kinds import key
from femsub.app.parts import RAYLEIGH, Made, Part, PartSite, from_file, rates


@dataclass(frozen=True)
class Rectangle:
    """A rectangle in the plane z = 0. Its sets are left, right, front, back, edge (all four sides) and corners."""

    lengths: list[float] = key([], "its sides", unit="length", above=0, form="[x, y]", required=True, example=[0.4, 0.3])
    elements: list[int] = key([16, 12], "numbers of cells along its sides", least=1, form="[x, y]")
    cells: str = key("quad", "its cells", choices=lambda _: ("quad", "triangle"))

    def mesh(self, name: str) -> fs.Mesh:
        """The mesh."""
        made = fs.rectangle(self.lengths, self.elements, self.cells, name=name)
        ends = [np.intersect1d(made.sets[x], made.sets[y]) for x in ("left", "right") for y in ("front", "back")]
        return made.with_sets(corners=np.concatenate(ends))


@dataclass(frozen=True)
class PlatePart(Part):
    """A thin plate in a plane z = const. Ports act along w."""

    plate: str | Rectangle = key("", "a mesh file of triangles or axis-parallel rectangles, or a rectangle", file=True,
                                 required=True, example="plate.msh")
    material: str = key("", "the name of its material", required=True, example="steel")
    thickness: float = key(0.0, "its thickness", unit="length", above=0, required=True, example=0.002)
    clamped: list[str] = key([], "sets of nodes that are clamped", otherwise="none", example=["left"])
    simply_supported: list[str] = key([], "sets of nodes that are simply supported", otherwise="none", example=["edge"])
    interface: list[int | float | str] = key([], "sets of nodes where it is joined, in addition to those that joints and "
                                             "contacts name; held DOF are left out", otherwise="only these", example=["right"])
    ports: dict[str, Any] = key({}, "places by their names: a set of nodes (the mean of w over its cells, edges or nodes), or "
                                "[x, y] of a node", otherwise="none", example={"belt": [0.3, 0.2]})
    rayleigh: list[float] = key([], "[alpha, beta] of the damping D = αM + βK", **RAYLEIGH)
    cut: int = key(0, "number of pieces, each of which is a part; they are chosen so that they share few DOF", least=0)
    cut_at: list[str] = key([], "instead of cut: groups of cells, each of which is a piece", otherwise="none",
                            example=["left-half", "right-half"])

    KIND: ClassVar[str] = "plate"

    def sets_named(self) -> Iterable[tuple[str, str]]:
        ports = [one for one in self.ports.values() if isinstance(one, str)]
        for key_, names in (("clamped", self.clamped), ("simply_supported", self.simply_supported), ("interface", self.interface),
                            ("ports", ports)):
            yield from ((key_, str(name)) for name in names)

    def mesh(self, site: PartSite) -> fs.Mesh | None:
        if isinstance(self.plate, Rectangle):
            return self.plate.mesh(site.name)
        return fs.read_mesh(from_file(site, self.plate))

    def made(self, site: PartSite, mesh: fs.Mesh | None) -> Made:
        of = site.material(self.material)
        supports = dict.fromkeys(self.simply_supported, "simply supported") | dict.fromkeys(self.clamped, "clamped")
        options: dict[str, Any] = {"E": of.E, "nu": of.nu, "rho": of.rho, "thickness": self.thickness, "supports": supports,
                                   "ports": self.ports, "rayleigh": rates(self.rayleigh)}
        assert mesh is not None
        if self.cut or self.cut_at:
            found = fs.cut(mesh, fs.plate, into=None if self.cut_at else self.cut, sets=self.cut_at or None, **options)
            return Made(dict(found.parts), found.joints, found.meshes)
        return self.one(site, fs.plate(mesh, interface=self.prefer(site), name=site.name, **options), mesh)

    def changed(self, site: PartSite, mesh: fs.Mesh | None, group: str, constant: str, part: str) -> Any:
        of = site.material(self.material)
        assert mesh is not None
        return fs.MaterialChange.plate(mesh, constant, E=of.E, nu=of.nu, rho=of.rho, thickness=self.thickness, cells=group
                                       or None, part=part, rayleigh=rates(self.rayleigh))
