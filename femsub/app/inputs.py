"""The inputs of a run, read from its results.json, so that the run can be repeated."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from femsub import __version__
from femsub.checks import FemsubWarning, InputError, hash_of, warn
from femsub.io import newest, results_of


def inputs_of(path: Path) -> tuple[dict[str, Any], Path]:
    """The table of the scene in a results.json, as in a scene file, and the folder to which its file names are relative.

    A file of the scene that is no longer at its place is looked for beside results.json.

    Raises
    ------
    InputError
        The file is no results.json of a run; a file of the scene is missing, or has changed.
    """
    path = newest(path.parent, path.name)
    known = results_of(path, compared=True)
    if known is None or not known["inputs"]:
        raise InputError(f"{path} does not hold the inputs of a run; name a scene, a scene file, or the results.json of a run "
                         "with --out")
    keys = known["inputs"]
    for own in keys.get("use", []):
        if not any(item["path"] == own for item in known["files"]):
            raise InputError(f"{path} names the Python file {own}, but not its SHA-256; it is not run")
    for item in known["files"]:
        place = path.parent / item["path"]
        if not place.is_file():
            place = path.parent / place.name
            keys = _renamed(keys, item["path"], place.name)
        if not place.is_file():
            raise InputError(f"{path} needs the file {item['path']}, which is neither there nor beside it")
        now = hash_of(place)
        if now != item["sha256"]:
            raise InputError(f"{place} has changed since the run of {path}: its SHA-256 was {item['sha256'][:12]}… and is "
                             f"{now[:12]}…. Put the old file back, or run the scene file")
    if (then := known["versions"].get("femsub")) != __version__:
        warn(f"{path} was written by femsub {then}, and this is {__version__}: figures may differ", FemsubWarning)
    return keys, path.parent


def _renamed(value: Any, file: str, name: str) -> Any:
    """A copy of a table in which values that name `file` name `name` instead, also as in 'model.mat:K', a matrix in a file."""
    if isinstance(value, list):
        return [_renamed(item, file, name) for item in value]
    if isinstance(value, dict):
        return {key: _renamed(item, file, name) for key, item in value.items()}
    return name + value[len(file):] if isinstance(value, str) and f"{value}:".startswith(f"{file}:") else value
