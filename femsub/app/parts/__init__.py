"""Parts of a scene: each kind builds substructures from its keys. `Part` is the base class of all kinds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import femsub as fs
from femsub.app.ends import End
from femsub.app.kinds import Kind, key
from femsub.checks import FemsubError, InputError, unknown_name

if TYPE_CHECKING:
    from femsub.checks import Array


@dataclass(frozen=True)
class MaterialKeys:
    """A material: Young's modulus, Poisson's ratio, density."""

    E: float = key(0.0, "Young's modulus", unit="force/length²", above=0, required=True, example=2.1e11)
    nu: float = key(0.3, "Poisson's ratio", above=-1, below=0.5)
    rho: float = key(0.0, "density", unit="mass/length³", above=0, required=True, example=7850.0)
    loss: float = key(0.0, "loss factor of its structural damping", least=0)


class PartSite(NamedTuple):
    """Data from which a part is built, beside its keys: name, folder, materials, and needs of joints and contacts."""

    name: str
    folder: Path
    materials: Mapping[str, MaterialKeys]
    interface: Sequence[Any] = ()  #: sets or DOF that joints and contacts name
    ports: Mapping[str, Any] = {}  #: ports that joints need

    def material(self, name: str) -> fs.Material:
        """The material with this name.

        Raises
        ------
        InputError
            No material has this name.
        """
        if name not in self.materials:
            raise unknown_name("material", name, self.materials)
        one = self.materials[name]
        return fs.Material(one.E, one.nu, one.rho, one.loss)


@dataclass(frozen=True)
class Made:
    """The model of a part: substructures by name (several if the part is cut), joints between them, and their meshes."""

    parts: dict[str, Any]
    joints: Sequence[Any] = ()
    meshes: Mapping[str, fs.Mesh] = field(default_factory=dict)


@dataclass(frozen=True)
class Part(Kind):
    """The base class of parts: keys that all kinds have."""

    interface: list[int | float | str] = key([], "where it is joined, in addition to the sets and DOF that joints and contacts "
                                             "name", otherwise="only these")
    ports: dict[str, Any] = key({}, "places where contacts, loads and springs act, by their names", otherwise="none")
    loss: float = key(0.0, "loss factor of the structural damping of the whole part", least=0)

    FAMILY: ClassVar[str] = "part"

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the parameters in factors of its matrices."""
        return ()

    def check_port(self, name: str, port: str) -> None:
        """Refuses a port that the part `name` does not have, if that is known before its files are read."""
        if not self.port_names:
            raise InputError(f"{name!r} has no port {port!r}. Give it one in [part.{name}], by ports")
        if port not in self.port_names:
            raise unknown_name(f"port of {name!r}", port, self.port_names)

    @property
    def port_names(self) -> list[str]:
        """The names of its ports."""
        return list(self.ports)

    @property
    def materials(self) -> list[str]:
        """The names of its materials."""
        given = getattr(self, "material", [])
        return [given] if isinstance(given, str) else list(given.values()) if isinstance(given, Mapping) else []

    def needed(self, end: End) -> list[Any]:
        """The sets or DOF that an end of a joint or contact adds to the interface."""
        if end.mark != "." or end.rest in self.port_names:
            return []
        with suppress(FemsubError):
            return [self.end(end.rest, None)]
        return []

    def sets_named(self) -> Iterable[tuple[str, str]]:
        """(key, set) for each key that names a set of the mesh."""
        return ()

    def mesh(self, site: PartSite) -> fs.Mesh | None:
        """The mesh, read or built before the part is assembled; None if the part has no mesh."""
        return None

    def prefer(self, site: PartSite) -> list[Any]:
        """The interface: the sets or DOF of the key `interface`, then those that joints and contacts name."""
        return list(dict.fromkeys([*self.interface, *site.interface]))

    def made(self, site: PartSite, mesh: fs.Mesh | None) -> Made:
        """The substructures of the part, with joints and meshes."""
        raise NotImplementedError

    def one(self, site: PartSite, sub: fs.Substructure, mesh: fs.Mesh | None = None) -> Made:
        """The model of a part that is one substructure, with the structural damping of `loss`."""
        sub = fs.damped(sub, structural=self.loss) if self.loss else sub
        return Made({site.name: sub}, (), {site.name: mesh} if mesh is not None else {})

    def changed(self, site: PartSite, mesh: fs.Mesh | None, group: str, constant: str, part: str) -> Any:
        """The change of a constant of its material, in a group of cells; `part` is the part's name in a system."""
        raise InputError(f"a part of the kind {self.KIND!r} has no material that could change")

    def end(self, words: str, sets: Iterable[str] | None) -> Any:
        """The end 'part.words' as `couple` takes it: the name of a set."""
        if sets is not None and words not in sets:
            raise unknown_name("set", words, sets)
        return words

    def set_of(self, words: str) -> Any:
        """The name of the substructure's set for an end 'part.words'."""
        found = self.end(words, None)
        return f"{found:g}" if isinstance(found, float) else found

    def moved(self, mesh: fs.Mesh, sub: fs.Substructure, u: Array) -> Array | None:
        """Displacements (nodes, 3, k) of the mesh's nodes for motions u (n, k); None if there is no DOF map."""
        return None if sub.dofs is None else fs.displacements(mesh, sub.dofs, u)


def motions(names: Iterable[Any]) -> dict[str, str]:
    """Set → directions: {"inner": "xyz", "symmetry": "x"} for ["inner", "symmetry:x"]."""
    pairs = (name.rpartition(":") if ":" in name else (name, ":", "xyz") for name in map(str, names))
    return {name: axes for name, _, axes in pairs}


def rates(given: Sequence[float]) -> tuple[float, float] | None:
    """(alpha, beta) of Rayleigh damping."""
    return (given[0], given[1]) if given else None


RAYLEIGH: dict[str, Any] = {"unit": "1/time, time", "form": "[alpha, beta]", "otherwise": "none", "example": [5.0, 1e-7]}


def from_file(site: PartSite, name: str) -> Path:
    """The path of a file that a part names.

    Raises
    ------
    InputError
        There is no such file.
    """
    return fs.io.existing(site.folder / name)
