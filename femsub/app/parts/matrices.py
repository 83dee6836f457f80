"""Your own matrices M, D, K from files."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar

import femsub as fs
from femsub.app.ends import End
from femsub.app.kinds import key
from femsub.app.parts import RAYLEIGH, Made, Part, PartSite, from_file, rates
from femsub.checks import unknown_name

DOF = "counted from 0, or by the DOF map as '12:uz', '12.3' (node and direction) or '12:*'"
ALL = "interface"  # the set of all interface DOF


@dataclass(frozen=True)
class MatrixFiles:
    """Files of matrices: Matrix Market, SciPy, MATLAB, Nastran OP4, Abaqus, CalculiX; 'model.mat:K' is K in a file of several."""

    M: str = key("", "the file of the mass matrix", required=True, example="M.mtx", file=True)
    K: str = key("", "the file of the stiffness matrix", required=True, example="K.mtx", file=True)
    D: str = key("", "the file of the damping matrix", otherwise="no damping", example="D.mtx", file=True)
    dofs: str = key("", "the file of the DOF map, if the files of matrices do not contain it: .dof, or a line 'node,component' "
                    "per DOF", example="K.dof", file=True, otherwise="none")
    massless: bool = key(False, "whether M may leave out DOF of K")
    drop_empty: bool = key(False, "whether DOF with neither mass, damping nor stiffness are left out")


@dataclass(frozen=True)
class MatricesPart(Part):
    """A part whose matrices are in files, in any consistent units. A joint names it, 'part', or some of its DOF, 'part:0,4'."""

    matrices: MatrixFiles = key(None, "the files", required=True, example={"M": "M.mtx", "K": "K.mtx"})
    interface: list[int | float | str] = key([], f"interface DOF, {DOF}", least=0, otherwise="none", example=[0])
    ports: dict[str, Any] = key({}, f"places by their names: lists of DOF, {DOF}", otherwise="none", example={"belt": [1]})

    rayleigh: list[float] = key([], "[alpha, beta] of the damping αM + βK, which is added", **RAYLEIGH)

    KIND: ClassVar[str] = "matrices"

    def made(self, site: PartSite, mesh: fs.Mesh | None) -> Made:
        own = self.matrices
        paths: dict[str, Any] = {name: found(site, getattr(own, name)) for name in ("M", "K", "D", "dofs") if getattr(own, name)}
        sub = fs.read_component(**paths, interface=self.prefer(site), ports=self.ports, name=site.name, massless=own.massless,
                                drop_empty=own.drop_empty)
        if len(sub.interface) and not sub.sets:
            sub = fs.Substructure(sub.M, sub.K, sub.D, {ALL: sub.interface}, sub.ports, site.name, sub.dofs, H=sub.H)
        return self.one(site, fs.damped(sub, rayleigh=rates(self.rayleigh)) if self.rayleigh else sub)

    def needed(self, end: End) -> list[Any]:
        return list(end.dofs)

    def end(self, words: str, sets: Iterable[str] | None) -> Any:
        raise unknown_name("set of a part from matrices; name it alone, or its DOF as 'part:0,4'. Found", words, [])


def found(site: PartSite, name: str) -> Any:
    """The path of a file of matrices; the name of one matrix in it may follow after a colon."""
    path = site.folder / name
    if not path.is_file() and ":" in path.name:
        from_file(site, name.rpartition(":")[0])
        return path
    return from_file(site, name)
