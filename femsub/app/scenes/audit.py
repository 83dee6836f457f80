"""Anybody's reduced model from files, checked by itself or against the full one: the scene, and `femsub audit FILES...`.

The command line reads this module before it knows what is asked: nothing here imports NumPy.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import femsub as fs
from femsub.app.keys import Key, item_kind, key, keys_of
from femsub.app.scene import Progress, Result, Scene
from femsub.errors import InputError

NO_BELT = "a reduced model is checked by itself: there is no belt, and nothing is reduced"
MODEL = "model.json"  # of a folder of write_matrices


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
        found = fs.audit(reduced, full, mass=self.mass or None, cutoff=self.cutoff or None, gyroscopic=self.gyroscopic,
                      floating={"yes": True, "no": False}.get(self.floating), units=self.units)
        checks, frequencies = found.tables
        listed = ["", f"{frequencies.title}:", frequencies] if len(found.omega) else []
        charts = [found.chart] if any(map(math.isfinite, found.lower)) else []
        return Result({"audit": found.record()}, [found.answer, checks, *listed, *charts])

    def reduced(self) -> Any:
        """The reduced model: as it was written, or its matrices as they are."""
        folder = Path(self.folder)
        if self.model:
            return fs.read_component((folder / self.model).parent)
        found: dict[str, Any] = {name: fs.read_matrix(folder / getattr(self, name)) for name in "MKDV" if getattr(self, name)}
        dofs = fs.io.read_dofs(folder / self.dofs) if self.dofs else None
        lists = {"interface": self.interface, "kinds": self.kinds, "dofs": dofs}
        return found | {"name": self.name} | {name: value for name, value in lists.items() if value}

    def whole(self) -> fs.Substructure | None:
        """The full model, if there is one."""
        folder = Path(self.folder)
        if self.full:
            return fs.read_component((folder / self.full).parent)
        if not self.full_M:
            return None
        paths = {name: folder / file for name in ("M", "K", "D", "dofs") if (file := getattr(self, f"full_{name}"))}
        return fs.read_component(**paths, interface=self.full_interface, massless=True)


def example(lost: int = 3) -> tuple[fs.ReducedSubstructure, fs.Substructure]:
    """A steel beam reduced to twelve coordinates, of which one mode, the third, is then left out as if nothing had happened."""
    full = fs.beam(1.0, 60, E=2.1e11, I=1.7e-9, rho=7850.0, A=2e-4, supports={"left": "clamped"}, interface=["right"], rayleigh=(
        5.0, 1e-7))
    whole = fs.reduce(full, fs.CraigBampton(10))
    at = [one for one in range(whole.size) if one != len(whole.interface) + lost - 1]
    M, D, K = (A[at][:, at] for A in (whole.M, whole.D, whole.K))
    return fs.ReducedSubstructure(M, K, D, {}, whole.name, V=whole.V[:, at], kinds=tuple(whole.kinds[one] for one in at),
                                  full_interface=whole.full_interface, cutoff=whole.cutoff, method="Craig-Bampton",
                                  full_dofs=whole.full_dofs), full


def options() -> dict[str, Key]:
    """The keys of the scene that are options of the command: what is known of the models, but not their files."""
    files = ("model", "M", "K", "D", "full", "full_M", "full_K", "full_D")
    return {name: one for name, one in keys_of(AuditScene).items()
            if name == "units" or name not in (*files, *keys_of(Scene))}


def add_arguments(command: argparse.ArgumentParser) -> None:
    """The arguments of the command beside those of every run."""
    command.add_argument("files", nargs="+", metavar="FILE",
                         help="a folder of write_matrices, or the files of M and K, and of D if there is one")
    command.add_argument("--full", nargs="+", metavar="FILE", default=[], help="the full model, named alike")
    for name, one in options().items():
        flag, text = f"--{name.replace('_', '-')}", one.meaning + (f" [{one.unit}]" if one.unit else "")
        if one.type is bool:
            command.add_argument(flag, action="store_true", default=None, help=text)
        elif item_kind(one.type):
            command.add_argument(flag, type=listed, metavar="LIST", help=f"{text}; with commas between")
        else:
            words = "|".join(one.choices(AuditScene)) if one.choices else ""
            shape = words or ("FILE" if one.file else "NUMBER")
            command.add_argument(flag, type=one.type, metavar=shape, help=text)


def listed(text: str) -> list[int | str]:
    """[0, "12:uz"] of "0,12:uz"."""
    words = [word.strip() for word in text.split(",") if word.strip()]
    return [int(word) if word.isdecimal() else word for word in words]


def keys(given: argparse.Namespace) -> dict[str, Any]:
    """The keys of the scene, those that were given."""
    found: dict[str, Any] = {"scene": "audit", **_named(given.files, "model", ""), **_named(given.full, "full", "full_")}
    return found | {name: value for name in options() if (value := getattr(given, name)) is not None}


def _named(files: Sequence[str], folder: str, prefix: str) -> dict[str, str]:
    """The keys for a folder of write_matrices, or for the files of M, K and D."""
    if len(files) == 1:
        path = Path(files[0])
        if not path.is_dir() and path.name != MODEL:
            raise InputError(f"{files[0]} is no folder of write_matrices: name one, or the files of M and K")
        return {folder: str(path / MODEL if path.is_dir() else path)}
    if len(files) > 3:
        raise InputError(f"{len(files)} files are given: name those of M, K and D, in this order")
    return {f"{prefix}{name}": file for name, file in zip("MKD", files, strict=False)}
