"""`femsub audit FILES...`: makes a scene that audits a reduced model from files of any program.

The command line imports this module for every command, so nothing here imports NumPy.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from femsub.app.kinds import key
from femsub.checks import InputError
from femsub.io import keys_of

if TYPE_CHECKING:
    from femsub.app.grammar import Scene

MODEL = "model.json"  # the index of a folder of write_matrices
#: options that are keys of the ask, or of the scene
STATED = {
    "cutoff": ("NUMBER", "the cut-off: all modes below it are kept, as the author states [rad/time]"),
    "mass": ("NUMBER", "the mass that the part should have"),
    "floating": ("yes|no", "whether the part is unsupported (floats)"),
    "units": ("SI|mm-t-s", "the units of all numbers"),
}


@dataclass(frozen=True)
class ModelFiles:
    """The files of a model: the model.json of a folder of write_matrices, or the files of its matrices."""

    model: str = key("", "the model.json of a folder of write_matrices", file=True, example="small/model.json",
                     otherwise="the matrices are given")
    M: str = key("", "the file of the mass matrix", example="M.mtx", file=True, otherwise="from model")
    K: str = key("", "the file of the stiffness matrix", required_with="M", example="K.mtx", file=True, otherwise="from model")
    D: str = key("", "the file of the damping matrix", otherwise="no damping", example="D.mtx", file=True)
    V: str = key("", "the file of the basis, with a row for each DOF of the full model", otherwise="not known", example="V.mtx",
                 file=True)
    dofs: str = key("", "the file of the DOF map, with a line 'node,component,x,y,z' per DOF; for a reduced model, the map of "
                    "its interface", otherwise="none", file=True, example="interface.csv")
    interface: list[int | str] = key([], "interface DOF, counted from 0: for a reduced model its coordinates; for a full model "
                                     "its DOF, also as '12:uz' or '12:*' of the map, in the order of the reduced model",
                                     least=0, example=[0, 1, 2], otherwise="not known")
    kinds: list[str] = key([], "the kind of each coordinate, such as 'constraint' and 'fixed-interface'", otherwise="not stated",
                           example=["constraint", "fixed-interface"])

    def __post_init__(self) -> None:
        if bool(self.model) == bool(self.M):
            raise InputError("give the model.json of a folder, model, or the files of the matrices, M and K")
        if self.model and Path(self.model).name != MODEL:
            raise InputError(f"model names {self.model}, but must name the {MODEL} of a folder of write_matrices")


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Adds the arguments of this command only; arguments common to all runs are added by the caller."""
    command.add_argument("files", nargs="+", metavar="FILE",
                         help="a folder of write_matrices, or the files of M and K, and of D if there is one")
    command.add_argument("--full", nargs="+", metavar="FILE", default=[], help="the full model, named alike")
    keys = keys_of(ModelFiles)
    for name in ("V", "interface", "dofs", "kinds", "full-dofs", "full-interface"):
        one = keys[name.removeprefix("full-")]
        meaning = one.meaning if name in keys else f"the same of the full model, see --{name.removeprefix('full-')}"
        command.add_argument(f"--{name}", type=str if one.file else listed, metavar="FILE" if one.file else "LIST",
                             help=meaning if one.file else f"{meaning}; with commas between")
    for name, (shape, text) in STATED.items():
        command.add_argument(f"--{name}", type=float if shape == "NUMBER" else str, metavar=shape, help=text)
    command.add_argument("--gyroscopic", action="store_true", default=None, help="the part turns, so that D may be unsymmetric")


def listed(text: str) -> list[int | str]:
    """The items of a list with commas: [0, "12:uz"] for "0,12:uz"."""
    words = [word.strip() for word in text.split(",") if word.strip()]
    return [int(word) if word.isdecimal() else word for word in words]


def scene(given: argparse.Namespace) -> Scene:
    """The scene of the command."""
    from femsub.app.grammar import Scene

    def stated(names: Sequence[str], before: str = "") -> dict[str, Any]:
        """The options that the user has given, by their keys."""
        return {name: value for name in names if (value := getattr(given, before + name)) is not None}

    own = _named(given.files) | stated(("V", "interface", "dofs", "kinds"))
    full = (_named(given.full) if given.full else {}) | stated(("dofs", "interface"), "full_")
    ask = {"audit": own, **({"full": full} if full else {}), **stated(("cutoff", "mass", "floating", "gyroscopic"))}
    return Scene({"name": "audit", **stated(["units"]), "ask": [ask]})


def _named(files: Sequence[str]) -> dict[str, Any]:
    """The keys of `ModelFiles` for a folder of write_matrices, or for the files of M, K and D."""
    if len(files) == 1:
        path = Path(files[0])
        if not path.is_dir() and path.name != MODEL:
            raise InputError(f"{files[0]} is no folder of write_matrices: name one, or the files of M and K")
        return {"model": str(path / MODEL if path.is_dir() else path)}
    if len(files) > 3:
        raise InputError(f"{len(files)} files are given: name those of M, K and D, in this order")
    return dict(zip("MKD", files, strict=False))
