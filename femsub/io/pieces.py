"""`cut_to_files`: a mesh cut into files of pieces, each of which makes its component where it is needed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.checks import (
    Array,
    InputError,
    InputTypeError,
    hash_of,
    instance,
    items,
    mapping,
    path_of,
    unlike,
    whole_number,
    word,
)
from femsub.components import Mesh
from femsub.coupling import PLACES, cut_mesh
from femsub.io.mesh_files import read_mesh, write_mesh

if TYPE_CHECKING:
    from femsub.model import Substructure


@dataclass(frozen=True)
class Piece:
    """A function without arguments: it reads its mesh and builds its component, with its own supports, interface and ports.

    Attributes
    ----------
    path : Path
        The mesh, in any format of `read_mesh`. Sets with a '+' in their name are shared with other pieces.
    build : function
        `solid`, `plate`, or a function of your own with their keywords.
    arguments : mapping
        Keywords for `build`. Supports, interface and ports whose sets the mesh lacks are left out.
    content : str
        A hash of the file, so that a run on other pieces of the same name does not take them for these.
    """

    path: Path
    build: Callable[..., Substructure]
    arguments: Mapping[str, Any]
    content: str

    @classmethod
    def of(cls, path: Path, build: Callable[..., Substructure], arguments: Mapping[str, Any]) -> Piece:
        return cls(path, build, arguments, hash_of(path))

    def __call__(self) -> Substructure:
        if why := unlike(self.path, self.content):
            raise InputError(f"{self.path} is not the file that this piece was made of: {why}. Cut the mesh again (cut_to_files, "
                             "or Piece.of)")
        mesh = read_mesh(self.path)
        known = {key for key, chosen in (*mesh.sets.items(), *mesh.groups.items()) if len(chosen)}
        shared = [key for key in mesh.sets if "+" in key and key in known]
        own = {key: value for key, value in self.arguments.items() if key not in PLACES}
        for key in PLACES:
            given = () if self.arguments.get(key) is None else self.arguments[key]
            if key == "ports":
                own[key] = {port: value for port, value in dict(given).items() if place_of(port, value) in known}
            elif isinstance(given, Mapping):
                own[key] = {place: value for place, value in given.items() if place in known}
            else:
                own[key] = [place for place in ([given] if isinstance(given, str) else given) if place in known]
        interface = own["interface"]
        if isinstance(interface, Mapping):
            raise InputTypeError("interface of pieces must be a list of sets: all motions of a set are joined")
        own["interface"] = [*interface, *shared]
        return self.build(mesh, name=self.path.stem, **own)


def place_of(name: str, port: Any) -> Any:
    """The set of a port: 'patch', or the first of ('patch', 'z')."""
    return port if isinstance(port, str) else next(iter(items(f"port {name!r}", port, "a set and a direction")), None)


def cut_to_files(folder: str | Path, mesh: Mesh, build: Callable[..., Substructure], *, into: int,
                 **arguments: Any) -> dict[str, Piece]:
    """Cut a mesh between its cells into pieces, and write each to a file, folder/p1.vtu and so on; see `cut`.

    No matrix is made here. Each value of the result is a function that reads its piece and builds the component:
    `reduce_by_levels` calls it in a worker.

    A mesh that no process can hold is written piece by piece by a program of yours, with `write_mesh`. The nodes of a piece have
    their numbers in the whole mesh (`Mesh.numbers`). Its sets 'p1+p2' are the nodes that these and no other pieces share. The
    function of a piece is then ``Piece.of(path, build, arguments)`` of `femsub.io.pieces`.

    Parameters
    ----------
    folder : str or Path
        Created if it does not exist.
    mesh : Mesh
    build : function
        `solid`, `plate`, or a function of your own with their keywords. It must give the DOF a map.
    into : int, 2 or more
        The number of pieces. The set or group of a port is in one of them.
    **arguments
        For `build`, with `supports`, `interface` and `ports` for the whole mesh.

    Returns
    -------
    dict of str to Piece

    Raises
    ------
    InputError, InputTypeError
        More pieces than cells; a support, interface or port that the mesh does not have; a folder that cannot be written.

    Examples
    --------
    >>> import femsub as fs
    >>> mesh, steel = fs.block((2.0, 0.1, 0.1), (20, 1, 1), "hexahedron"), fs.Material(2.1e11, 0.3, 7850.0)
    >>> parts = fs.cut_to_files("bar", mesh, fs.solid, into=2, material=steel, supports=["left"])
    >>> parts["p1"]().sets.keys() == parts["p2"]().sets.keys() == {"p1+p2"}
    True
    """
    instance("mesh", mesh, Mesh, "see read_mesh, block")
    if not callable(build):
        raise InputTypeError(f"build must be the function that makes the component of a mesh, as fs.solid, not {build!r:.60}")
    whole_number("into, the number of parts,", into, 2)
    ports = {} if (given := arguments.get("ports")) is None else mapping("ports", given, "names and sets")
    under = [mesh.numbers[_nodes(mesh, place_of(port, value), f"port {port!r}")] for port, value in ports.items()]
    for what in ("supports", "interface"):
        given = () if arguments.get(what) is None else arguments[what]
        given = [given] if isinstance(given, str) else list(given) if isinstance(given, Mapping) else given
        for place in items(what, given, "names of sets"):
            _nodes(mesh, place, what)
    target, pieces = path_of("folder", folder).absolute(), cut_mesh(mesh, into, under)
    owner = {port: next(name for name, piece in pieces.items() if np.isin(nodes, piece.numbers).all())
             for port, nodes in zip(ports, under, strict=True)}  # another piece may touch the port
    return {name: Piece.of(write_mesh(target / f"{name}.vtu", piece), build,
                           arguments | {"ports": {port: value for port, value in ports.items() if owner[port] == name}})
            for name, piece in pieces.items()}


def _nodes(mesh: Mesh, place: Any, what: str) -> Array:
    if word(f"{what}: the name of a set", place) in mesh.sets:
        return mesh.nodes(place)
    if place in mesh.groups:
        return np.unique(mesh.cells[mesh.groups[place]])
    raise InputError(f"{what}: the mesh {mesh.name!r} has no set {place!r}; it has {', '.join(map(repr, mesh.sets)) or 'none'}")
