"""Anybody's reduced model from files, checked by itself or against the full one; `femsub audit` makes such a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from femsub import CraigBampton, ReducedSubstructure, Substructure, audit, beam, read_component, read_matrix, reduce
from femsub.app.keys import key
from femsub.app.scene import Progress, Result, Scene
from femsub.errors import InputError
from femsub.io import read_dofs

NO_BELT = "a reduced model is checked by itself: there is no belt, and nothing is reduced"
MODEL = "model.json"


@dataclass(frozen=True)
class AuditScene(Scene):
    """A reduced model from files, yours or anybody's, checked by itself or against the full model.

    Without files the model is an example: a steel beam of which one mode is missing.
    """

    model: str = key("", "the model.json of a folder of write_matrices with the reduced model", file=True,
                     example="small/model.json", otherwise="the model comes from its matrices")
    M: str = key("", "the file of the reduced mass matrix, relative to the scene file", example="M.mtx", file=True,
                 otherwise="that of model, or the example")
    K: str = key("", "the file of the reduced stiffness matrix", required_with="M", example="K.mtx", file=True,
                 otherwise="that of model, or the example")
    D: str = key("", "the file of the reduced damping matrix", otherwise="no damping", example="D.mtx", file=True)
    V: str = key("", "the file of the basis, with a row for each DOF of the full model", otherwise="not known", example="V.mtx",
                 file=True)
    interface: list[int] = key([], "the coordinates of the reduced model that are interface DOF, from 0", least=0,
                               distinct=True, otherwise="not known", example=[0, 1, 2])
    dofs: str = key("", "the file of their DOF map, 'node,component,x,y,z' a line", otherwise="not known", file=True,
                    example="interface.csv")
    kinds: list[str] = key([], "the kind of each coordinate, such as 'constraint' and 'fixed-interface'", otherwise="not stated",
                           example=["constraint", "fixed-interface"])
    full: str = key("", "the model.json of a folder of write_matrices with the full model", example="full/model.json", file=True,
                    otherwise="it comes from its matrices, or is not known")
    full_M: str = key("", "the file of the full mass matrix", example="full-M.mtx", file=True, otherwise="not known")
    full_K: str = key("", "the file of the full stiffness matrix", required_with="full_M", example="full-K.mtx", file=True,
                      otherwise="not known")
    full_D: str = key("", "the file of the full damping matrix", otherwise="no damping", example="full-D.mtx", file=True)
    full_dofs: str = key("", "the file of the full model's DOF map", otherwise="none", example="full-K.dof", file=True)
    full_interface: list[int | str] = key([], "the interface as DOF of the full model, in the order of the reduced one: from "
                                          "0, or by the map as '12:uz' or '12:*'", least=0, example=["12:*"],
                                          otherwise="not known")
    cutoff: float = key(0.0, "the frequency below which all modes are said to be kept", unit="rad/time", least=0,
                        otherwise="what the model states")
    mass: float = key(0.0, "the mass that the part should have", unit="mass", least=0, otherwise="not stated")
    floating: str = key("", "whether the part hangs on nothing", choices=lambda _: ("yes", "no"), otherwise="not stated",
                        example="yes")
    gyroscopic: bool = key(False, "whether the part turns, so that D may be unsymmetric")

    OUTPUTS: ClassVar[tuple[str, ...]] = ("audit",)
    WITHOUT: ClassVar[Mapping[str, str]] = dict.fromkeys(("slope", "law", "eps", "speed", "force", "methods", "repeats"), NO_BELT)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.model and self.M:
            raise InputError("model and M are given. Name the reduced model by one of them")
        if self.full and self.full_M:
            raise InputError("full and full_M are given. Name the full model by one of them")
        for name in ("model", "full"):
            if (file := getattr(self, name)) and Path(file).name != MODEL:
                raise InputError(f"{name} names {file}, but must name the {MODEL} of a folder of write_matrices")

    def run(self, progress: Progress) -> Result:
        """The verdict, the checks, the frequencies and their errors."""
        progress(f"{self.name}: reading the models")
        reduced, full = (self.reduced(), self.whole()) if self.model or self.M else example()
        progress(f"{self.name}: checking")
        found = audit(reduced, full, mass=self.mass or None, cutoff=self.cutoff or None, gyroscopic=self.gyroscopic,
                      floating={"yes": True, "no": False}.get(self.floating), units=self.units)
        checks, frequencies = found.tables
        listed = ["", f"{frequencies.title}:", frequencies] if len(found.omega) else []
        charts = [found.chart] if np.isfinite(found.lower).any() else []
        return Result({"audit": found.record()}, [found.answer, checks, *listed, *charts])

    def reduced(self) -> Any:
        """The reduced model: as it was written, or its matrices as they are."""
        folder = Path(self.folder)
        if self.model:
            return read_component((folder / self.model).parent)
        found: dict[str, Any] = {name: read_matrix(folder / getattr(self, name)) for name in "MKDV" if getattr(self, name)}
        lists = {"interface": self.interface, "kinds": self.kinds, "dofs": read_dofs(folder / self.dofs) if self.dofs else None}
        return found | {"name": self.name} | {name: value for name, value in lists.items() if value}

    def whole(self) -> Substructure | None:
        """The full model, if there is one."""
        folder = Path(self.folder)
        if self.full:
            return read_component((folder / self.full).parent)
        if not self.full_M:
            return None
        paths = {name: folder / file for name in "MKD" if (file := getattr(self, f"full_{name}"))}
        return read_component(paths["M"], paths["K"], paths.get("D"), dofs=folder / self.full_dofs if self.full_dofs else None,
                              interface=self.full_interface, massless=True)


def example(lost: int = 3) -> tuple[ReducedSubstructure, Substructure]:
    """A steel beam reduced to twelve coordinates, of which one mode, the third, is then left out as if nothing had happened."""
    full = beam(1.0, 60, E=2.1e11, I=1.7e-9, rho=7850.0, A=2e-4, supports={"left": "clamped"}, interface=["right"], rayleigh=(
        5.0, 1e-7))
    whole = reduce(full, CraigBampton(10))
    at = np.delete(np.arange(whole.size), len(whole.interface) + lost - 1)
    M, D, K = (A[np.ix_(at, at)] for A in (whole.M, whole.D, whole.K))
    return ReducedSubstructure(M, K, D, {}, whole.name, V=whole.V[:, at], kinds=tuple(whole.kinds[one] for one in at),
                               full_interface=whole.full_interface, cutoff=whole.cutoff, method="Craig-Bampton",
                               full_dofs=whole.full_dofs), full
