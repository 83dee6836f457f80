"""`femsub audit FILES...`: anybody's reduced model from files, as a scene that asks for its audit alone.

The command line reads this module before it knows what is asked: nothing here imports NumPy.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from femsub.checks import InputError

if TYPE_CHECKING:
    from femsub.app.grammar import Scene

MODEL = "model.json"  # of a folder of write_matrices
#: options, their metavariables, and what they mean; those of the first five are keys of the reduced model's files
OPTIONS = {
    "V": ("FILE", "the file of the basis, with a row for each DOF of the full model"),
    "interface": ("LIST", "the coordinates of the reduced model that are interface DOF, from 0; with commas between"),
    "dofs": ("FILE", "the file of their DOF map, 'node,component,x,y,z' a line"),
    "kinds": ("LIST", "the kind of each coordinate, such as 'constraint' and 'fixed-interface'; with commas between"),
    "full_dofs": ("FILE", "the file of the full model's DOF map"),
    "full_interface": ("LIST", "the interface as DOF of the full model, in the order of the reduced one: from 0, or by the map "
                       "as '12:uz' or '12:*'"),
    "cutoff": ("NUMBER", "the cut-off: all modes below it are kept, as the author states [rad/time]"),
    "mass": ("NUMBER", "the mass that the part should have"),
    "floating": ("yes|no", "whether the part is unsupported (floats)"),
    "units": ("SI|mm-t-s", "the units of all numbers"),
}


def add_arguments(command: argparse.ArgumentParser) -> None:
    """The arguments of the command beside those of every run."""
    command.add_argument("files", nargs="+", metavar="FILE",
                         help="a folder of write_matrices, or the files of M and K, and of D if there is one")
    command.add_argument("--full", nargs="+", metavar="FILE", default=[], help="the full model, named alike")
    for name, (shape, text) in OPTIONS.items():
        kind: Any = {"LIST": listed, "NUMBER": float}.get(shape, str)
        command.add_argument(f"--{name.replace('_', '-')}", type=kind, metavar=shape, help=text)
    command.add_argument("--gyroscopic", action="store_true", default=None, help="the part turns, so that D may be unsymmetric")


def listed(text: str) -> list[int | str]:
    """[0, "12:uz"] of "0,12:uz"."""
    words = [word.strip() for word in text.split(",") if word.strip()]
    return [int(word) if word.isdecimal() else word for word in words]


def scene(given: argparse.Namespace) -> Scene:
    """The scene of the command."""
    from femsub.app.grammar import Scene

    known = {name: value for name in (*OPTIONS, "gyroscopic") if (value := getattr(given, name)) is not None}
    own = _named(given.files) | {name: known.pop(name) for name in ("V", "interface", "dofs", "kinds") if name in known}
    full = _named(given.full) if given.full else {}
    full |= {name.removeprefix("full_"): known.pop(name) for name in ("full_dofs", "full_interface") if name in known}
    units = {"units": known.pop("units")} if "units" in known else {}
    return Scene({"name": "audit", **units, "ask": [{"audit": own, **({"full": full} if full else {}), **known}]})


def _named(files: Sequence[str]) -> dict[str, Any]:
    """The keys for a folder of write_matrices, or for the files of M, K and D."""
    if len(files) == 1:
        path = Path(files[0])
        if not path.is_dir() and path.name != MODEL:
            raise InputError(f"{files[0]} is no folder of write_matrices: name one, or the files of M and K")
        return {"model": str(path / MODEL if path.is_dir() else path)}
    if len(files) > 3:
        raise InputError(f"{len(files)} files are given: name those of M, K and D, in this order")
    return dict(zip("MKD", files, strict=False))
