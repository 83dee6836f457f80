"""Your own parts, from matrices, meshes and superelements, joined: reduced by several methods, or each by one of its own."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.keys import key
from femsub.app.scene import Progress, Result, other_method_names
from femsub.app.scenes.audit import MODEL
from femsub.app.scenes.joined_parts import JoinedRun, JoinedScene
from femsub.app.scenes.solid import motions
from femsub.components import DIRECTIONS
from femsub.errors import InputError, unknown_name
from femsub.reduction import METHODS
from femsub.studies import Remark, Table, column

GROUND, FULL, ALL = "ground", "full", "interface"
KINDS = ("rigid", "spring", "tied")
OF_SUPERELEMENTS = ("part", "size", column("grids", "grids", "d"), "interface", "modes", "cutoff",
                    column("recovered", "motions", "d"), column("own_frame", "own frame", "d"),
                    column("trusted", "trusted ω", ".5g", unit="rad/time"), column("faults", "faults", "d"))


@dataclass(frozen=True)
class PartKeys:
    """One part: matrices M, D, K from files, a solid from a mesh, or a superelement of another program."""

    name: str = key("", "the part's name, a word without a dot", required=True, example="disc")
    M: str = key("", "the file of the mass matrix, relative to the scene file", otherwise="the part comes from its mesh",
                 example="disc-M.mtx", file=True)
    file: str = key("", "a superelement of another program, any one of its files (.asm, .pch, .op4, .op2, .nc), a .full "
                    "file, or the model.json of a folder of write_matrices", otherwise="the part comes from its matrices "
                    "or its mesh", example="wing.asm", file=True)
    cutoff: float = key(0.0, "of a superelement: up to which frequency its author kept modes", unit="rad/time", least=0,
                        otherwise="that of its highest mode, with a warning")
    K: str = key("", "the file of the stiffness matrix", otherwise="the part comes from its mesh", required_with="M",
                 example="disc-K.mtx", file=True)
    D: str = key("", "the file of the damping matrix", otherwise="no damping", example="disc-D.mtx", file=True)
    dofs: str = key("", "the file of the DOF map, where the matrices do not carry it in themselves", example="disc-K.dof",
                    otherwise="none", file=True)
    massless: bool = key(False, "whether M may leave out DOF of K")
    drop_empty: bool = key(False, "whether DOF with neither mass, damping nor stiffness are left out")
    mesh: str = key("", "a mesh file of hexahedra or tetrahedra, instead of matrices", example="pad.msh", file=True,
                    otherwise="the part comes from its matrices")
    E: float = key(2.1e11, "Young's modulus of a mesh", unit="Pa", above=0)
    nu: float = key(0.3, "Poisson's ratio of a mesh", above=-1, below=0.5)
    rho: float = key(7850.0, "density of a mesh", unit="kg/m³", above=0)
    rayleigh: list[float] = key([0.0, 0.0], "[alpha, beta] of the damping D = αM + βK of a mesh", unit="1/s, s",
                                form="[alpha, beta]")
    supports: list[str] = key([], "sets of the mesh that are held, in all directions or as 'set:xy' in some", otherwise="none",
                              example=["back"])
    interface: list[int | str] = key([], "where the part is joined: sets of the mesh; of matrices DOF, counted from 0, or by the "
                                     "map as '12:uz' or '12:*'", least=0, otherwise="that of the superelement",
                                     example=["front"])
    contact: str = key("", "the set of the mesh under the belt", otherwise="none", example="rubbing")
    direction: str | list[float] = key("y", "along which the contact slides: an axis, the surface's normal, or a vector",
                                       form="[x, y, z]", choices=lambda _: DIRECTIONS)
    port: list[int | str] = key([], "of matrices or a superelement the DOF under the belt, '12:uz'", least=0, example=[1],
                                otherwise="none")
    method: str = key("", "the method for this part in every model; 'full' keeps it as it is", example=FULL,
                      otherwise="each of methods in turn", choices=lambda _: [FULL, *METHODS], also=other_method_names)
    modes: list[int] = key([], "numbers of modes for this part, model by model", least=0, otherwise="modes of the scene",
                           example=[5, 10])

    def model(self, folder: str) -> tuple[fs.Substructure, fs.Mesh | None]:
        """The part, with the port "belt" if it has a contact, and its mesh. Of matrices the interface is the set 'interface'."""
        sources = [name for name in ("M", "mesh", "file") if getattr(self, name)]
        if len(sources) != 1:
            are = f"{' and '.join(sources)} are given" if sources else "none is given"
            raise InputError(f"the part {self.name!r} needs one of the matrices M and K, a mesh, or the file of a superelement, "
                             f"but {are}")
        if not self.file and not self.interface:
            raise InputError(f"the part {self.name!r} has no interface: name where it is joined")
        if self.mesh and self.port:
            raise InputError(f"the part {self.name!r} has a mesh: name its contact, not a port")
        if not self.mesh and self.contact:
            raise InputError(f"the part {self.name!r} has matrices: name its port, not a contact")
        if self.mesh:
            mesh = fs.read_mesh(Path(folder) / self.mesh)
            return fs.solid(mesh, fs.Material(self.E, self.nu, self.rho), supports=motions(self.supports), name=self.name,
                         interface=motions([str(one) for one in self.interface]), rayleigh=(self.rayleigh[0], self.rayleigh[1]),
                         ports={"belt": (self.contact, self.direction)} if self.contact else {}), mesh
        named = ("M", "K", "D", "dofs", "file")
        paths: dict[str, Any] = {name: Path(folder) / getattr(self, name) for name in named if getattr(self, name)}
        file = paths.pop("file", None)
        first = paths.pop("M") if file is None else file.parent if file.name == MODEL else file
        ports = {"belt": self.port} if self.port else {}
        given: dict[str, Any] = {"interface": self.interface, "ports": ports, "cutoff": self.cutoff}
        found = fs.read_component(first, **paths, name=self.name, massless=self.massless, drop_empty=self.drop_empty,
                               **{name: value for name, value in given.items() if value})
        if isinstance(found, fs.ReducedSubstructure) or found.sets:
            return found, None
        return fs.Substructure(found.M, found.K, found.D, {ALL: found.interface}, found.ports, self.name, found.dofs,
                            H=found.H), None


@dataclass(frozen=True)
class JointKeys:
    """One joint. Its ends are 'part.set', 'part' for the whole interface of a part of matrices, 'part:0,4,5' for its DOF,
    'part.belt' for a spring at a port, or 'ground'.
    """

    between: list[str] = key([], "the ends: 'part.set', 'part' (all of its interface), 'part:0,4,5' (DOF) or 'ground'; "
                             "of a rigid joint two or more", required=True, example=["disc.front", "pad.back"])
    kind: str = key("rigid", "rigid: equal motion; spring: stiffness and damping between the ends; tied: surfaces of meshes that "
                    "do not match", choices=lambda _: KINDS)
    stiffness: float = key(0.0, "of a spring", unit="force/length", least=0)
    damping: float = key(0.0, "of a spring", unit="force time/length", least=0)
    tolerance: float = key(0.0, "how far places that meet may lie apart", unit="length", least=0,
                           otherwise="a small share of the distance of neighbours")

    def made(self, parts: dict[str, fs.Substructure], meshes: dict[str, fs.Mesh]) -> fs.Rigid | fs.Spring | fs.Tied:
        """The joint between the parts."""
        ends = [_end(one, parts) for one in self.between]
        tol = self.tolerance or None
        if self.kind == "rigid":
            return fs.Rigid(*ends, tol=tol)
        if len(ends) != 2:
            raise InputError(f"a {self.kind} joint has two ends, but between names {len(ends)}: {', '.join(self.between)}")
        if self.kind == "spring":
            return fs.Spring(ends[0], ends[1], stiffness=self.stiffness, damping=self.damping)
        for end in ends:
            if end == GROUND or end[0] not in meshes:
                raise InputError(f"a tied joint glues surfaces of meshes, but {self.between[ends.index(end)]!r} is none")
        return fs.Tied(ends[0], ends[1], {end[0]: meshes[end[0]] for end in ends}, tol=tol)


@dataclass(frozen=True)
class ContactKeys:
    """Two surfaces of meshes with Coulomb friction between them; see `FrictionContact`."""

    between: list[str] = key([], "the surfaces, the smaller one first: sets of meshes that are interface, the second may be "
                             "'ground'", required=True, form="[first, second]", example=["pad.face", "disc.track"])
    stiffness: float = key(0.0, "normal stiffness per area", unit="force/length³", above=0, required=True, example=2e11)
    pressure: float = key(0.0, "pressure in steady sliding, for the damping by friction", unit="force/area", least=0)
    direction: list[float] = key([], "in which the second surface moves", form="[x, y, z]", otherwise="it turns about axis",
                                 example=[1.0, 0.0, 0.0])
    axis: list[float] = key([], "about which the second surface turns", form="[x, y, z]", otherwise="it moves in direction",
                            example=[0.0, 0.0, 1.0])
    centre: list[float] = key([0.0, 0.0, 0.0], "a point of the axis", unit="length", form="[x, y, z]")
    speed: float = key(0.0, "velocity along direction, or angular velocity about axis (rad/time)", least=0,
                       otherwise="without damping by friction")

    def made(self, meshes: dict[str, fs.Mesh]) -> fs.FrictionContact:
        """The contact without friction, mu = 0."""
        return fs.FrictionContact(self.between[0], self.between[1], meshes, self.stiffness, 0.0, self.pressure,
                               direction=np.array(self.direction) if self.direction else None,
                               axis=np.array(self.axis) if self.axis else None, centre=np.array(self.centre),
                               speed=self.speed or None)


@dataclass(frozen=True)
class OwnPartsScene(JoinedScene):
    """Parts that are joined, one of them under a belt or with friction between them: full, and reduced part by part."""

    parts: list[PartKeys] = key([], "the parts", required=True, example=[
        PartKeys("disc", M="disc-M.mtx", K="disc-K.mtx", interface=[0, 4], port=[2]),
        PartKeys("pad", mesh="pad.msh", interface=["back"])])
    joints: list[JointKeys] = key([], "the joints", required=True, example=[JointKeys(["disc", "pad.back"])])
    contacts: list[ContactKeys] = key([], "surfaces with friction between them; models are then reduced to contact modes as well",
                                      otherwise="none", example=[
                                          ContactKeys(["pad.face", "disc.track"], 2e11, axis=[0.0, 0.0, 1.0])])
    mu: list[float] = key([0.0, 1.0], "the range of their coefficient of friction in which stability may be lost", least=0,
                          form="[lo, hi]")
    interface: list[str] = key([], "the interface of the system: ends as of joints", otherwise="what is not joined",
                               example=["disc.front"])
    reference: list[float] = key([], "frequencies of the system that another program found, to compare with", unit="rad/time",
                                 above=0, otherwise="none", example=[10.67387655, 11.10545089])
    full: list[float] = key([], "values of mu at which the full model is solved", least=0, distinct=True,
                            otherwise="the end of the range", example=[0.2, 0.4])
    belt: str = key("", "the part under the belt", otherwise="the first one with a port or a contact; none", example="disc")

    OUTPUTS: ClassVar[tuple[str, ...]] = ("methods",)
    ON_REQUEST: ClassVar[tuple[str, ...]] = ("modes",)
    RUN: ClassVar[type[JoinedRun]] = JoinedRun  #: the outputs

    def __post_init__(self) -> None:
        super().__post_init__()
        names = [part.name for part in self.parts]
        if twice := [name for name in names if names.count(name) > 1]:
            raise InputError(f"parts: the name {twice[0]!r} is given {names.count(twice[0])} times; names distinguish parts")
        if parted := [name for name in names if not re.fullmatch(r"[^.:]+", name) or name == GROUND]:
            raise InputError(f"parts: the name {parted[0]!r} must be a word without a dot or colon, other than 'ground': joints "
                             "name their ends as 'part.set'")
        if self.belt and self.belt not in names:
            raise unknown_name("part", self.belt, names)

    def run(self, progress: Progress) -> Result:
        progress(f"{self.name}: reading the parts")
        made = {part.name: part.model(self.folder) for part in self.parts}
        parts = {name: sub for name, (sub, _) in made.items()}
        meshes = {name: mesh for name, (_, mesh) in made.items() if mesh is not None}
        surfaces = [contact.made(meshes) for contact in self.contacts]
        system = fs.couple(parts, [*(joint.made(parts, meshes) for joint in self.joints), *surfaces], self.name,
                        interface=[_end(one, parts) for one in self.interface] or None)
        rubbing = self.belt or next((name for name, sub in parts.items() if sub.ports), "")
        if self.belt and not parts[self.belt].ports:
            raise InputError(f"belt: the part {self.belt!r} has no port; give it a port (of matrices) or a contact (of a mesh)")
        belt = [replace(self.linear_belt, port=f"{rubbing}.belt")] if rubbing else []
        over = {"parameter": "mu", "values": self.full or [self.mu[1]], "between": (self.mu[0], self.mu[1])} if surfaces else {}
        choices = {part.name: (part.method, part.modes) for part in self.parts if part.method or part.modes}
        data: dict[str, Any] = {"band": self.band, "belt": rubbing, **(self.friction if rubbing else {})}
        text = [f"{self.name}: {len(parts)} parts, {len(self.joints)} joint{'s' * (len(self.joints) != 1)}"
                + (f", {self.friction_words}" if rubbing else ""), *map(repr, (*parts.values(), *surfaces))]
        return self.RUN(self, progress, system, [*surfaces, *belt], meshes, choices, over).result(data, text)


class SuperelementsRun(JoinedRun):
    """The outputs of superelements that are joined."""

    def parts(self) -> Result:
        """What was read of each part that is a reduced model, and the audit's statements."""
        rows: list[dict[str, Any]] = []
        checks: list[dict[str, Any]] = []
        masses: list[str] = []
        faults: list[str] = []
        unknown: list[str] = []
        for name, part in self.system.parts.items():
            if not isinstance(part, fs.ReducedSubstructure):
                continue
            self.say(f"checking {name}")
            found = fs.audit(part, units=self.scene.units)
            dofs, full = part.interface_dofs, part.full_dofs
            frames = [at for at, label in enumerate(full.labels) if "@" in label] if full else []  # which the files do not say
            rows.append({"part": name, "size": part.size, "interface": len(part.interface_numbers), "modes": part.modes,
                         "cutoff": part.cutoff, "recovered": len(part.V), "grids": len(np.unique(dofs.nodes)) if dofs else None,
                         "own_frame": int(np.isin(full.components, frames).sum()) if full else None, "trusted": found.trusted,
                         "faults": len(found.faults), "unknown": len(found.unknown)})
            checks += [{"part": name, **row} for row in found.tables[0].rows]
            masses += [f"{name}: {one.said}" for one in found.findings if one.what == "mass and inertia"]
            faults += [f"{name}: {one.what}: {one.said}. {one.todo}." for one in found.faults]
            unknown += [f"{name}: {one.what}: {one.said}." for one in found.unknown]
        table = Table("superelements", rows, OF_SUPERELEMENTS, "Superelements")
        return Result({"superelements": rows, "checks": checks}, [
            "Superelements as they were read, and checked by themselves:", table, *masses,
            Table("checks", checks, (), "Checks of superelements"), Remark(faults, unknown)])


@dataclass(frozen=True)
class SuperelementsScene(OwnPartsScene):
    """Superelements of other programs, joined, beside parts from matrices and meshes. Each is checked, and reduced once more."""

    parts: list[PartKeys] = key([], "the parts", required=True, example=[
        PartKeys("in", file="inboard.asm", cutoff=314.0), PartKeys("out", file="outboard.asm", cutoff=314.0, port=["11:uy"])])
    joints: list[JointKeys] = key([], "the joints; an end is a grid, 'in.11', or a part's whole boundary, 'in'", required=True,
                                  example=[JointKeys(["in", "out"])])
    methods: list[str] = field(default_factory=lambda: ["craig-bampton", "craig-chang", "rubin"])
    modes: list[int] = field(default_factory=lambda: [4, 8, 12])

    OUTPUTS: ClassVar[tuple[str, ...]] = ("parts", "modes", "methods")
    ON_REQUEST: ClassVar[tuple[str, ...]] = ()
    RUN: ClassVar[type[JoinedRun]] = SuperelementsRun


def _end(said: str, parts: dict[str, fs.Substructure]) -> Any:
    """'ground', or (part, set), (part, DOF): what `couple` takes."""
    if said == GROUND:
        return GROUND
    name, mark, rest = re.fullmatch(r"([^.:]*)([.:]?)(.*)", said).groups()  # type: ignore[union-attr]
    if name not in parts:
        raise unknown_name("part", name, parts)
    if mark == ":":
        if not re.fullmatch(r"\s*\d+(\s*,\s*\d+)*\s*", rest):
            raise InputError(f"the end {said!r} must list DOF of {name!r} behind the colon, counted from 0, as '{name}:0,4,5'")
        return name, [int(number) for number in rest.split(",")]
    if mark:
        return name, rest
    whole = [one for one, rows in parts[name].sets.items() if len(rows) == len(parts[name].interface_numbers)]
    return name, whole[0] if whole else parts[name].interface.tolist()  # a set is matched by place, a list in its order
