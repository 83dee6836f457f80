"""`femsub audit FILES...`: its arguments, and the keys of the scene that it runs. It imports no NumPy."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from femsub.errors import InputError

MODEL = "model.json"  # of a folder of write_matrices
#: options that are keys of the scene, with what stands for their value and what they are
LISTS = {"interface": "coordinates of the reduced model that are interface DOF, as 0,1,2",
         "full-interface": "the same as DOF of the full model, in the same order; with a map also as 12:uz,13:*"}
FILES = {"V": "the basis, with a row for each DOF of the full model",
         "dofs": "the DOF map of the interface, node,component,x,y,z a line",
         "full-dofs": "the DOF map of the full model"}
NUMBERS = {"cutoff": "the frequency below which all modes are said to be kept [rad/time]",
           "mass": "the mass that the part should have"}


def add_arguments(command: argparse.ArgumentParser) -> None:
    """The arguments of the command beside those of every run."""
    command.add_argument("files", nargs="+", metavar="FILE",
                         help="a folder of write_matrices, or the files of M and K, and of D if there is one")
    command.add_argument("--full", nargs="+", metavar="FILE", default=[], help="the full model, named alike")
    for name, text in {**FILES, **LISTS}.items():
        command.add_argument(f"--{name}", metavar="LIST" if name in LISTS else "FILE", help=text)
    for name, text in NUMBERS.items():
        command.add_argument(f"--{name}", type=float, metavar="NUMBER", help=text)
    command.add_argument("--floating", choices=("yes", "no"), help="whether the part hangs on nothing")
    command.add_argument("--gyroscopic", action="store_true", help="the part turns, so that D may be unsymmetric")
    command.add_argument("--units", help="the units of all numbers: SI or mm-t-s")


def keys(options: argparse.Namespace) -> dict[str, Any]:
    """The keys of the scene, those that were given."""
    found: dict[str, Any] = {"scene": "audit", **_named(options.files, "model", ""), **_named(options.full, "full", "full_")}
    for name in [*FILES, *NUMBERS, *LISTS, "floating", "units"]:
        if (value := getattr(options, name.replace("-", "_"))) is not None:
            if name in LISTS:
                words = [word.strip() for word in value.split(",") if word.strip()]
                value = [int(word) if word.isdecimal() else word for word in words]
            found[name.replace("-", "_")] = value
    return found | ({"gyroscopic": True} if options.gyroscopic else {})


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
