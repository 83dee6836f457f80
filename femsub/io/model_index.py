"""model.json, what a folder of `write_matrices` says of itself: read, and checked entry by entry and against the files."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from femsub.errors import InputError
from femsub.io.atomic import content_hash

INDEX = "model.json"
VERSION = 1
HASHES = "sha256"  # the key of {file: hash}: which files belong together


def read_index(path: Path) -> dict[str, Any]:
    """What model.json tells, every entry of the kind it should be, and every file it names the one it was written with.

    Raises
    ------
    InputError
        An entry that is missing, twice or of another kind; another version; a file outside the folder, missing, or changed
        since: also where a write was stopped between two files, so that they are of two models.
    """
    try:
        about = json.loads(path.read_bytes().decode("utf-8"), object_pairs_hook=_once, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is damaged ({error!s:.100}); write the model again") from None
    _check(path, about)
    _check_files(path, about)
    return dict(about)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key stands twice")
    return found


def _no_number(word: str) -> float:
    raise ValueError(f"{word} is no number")


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2 ** 62


def _is_size(value: Any) -> bool:  # JSON's 1e400 is infinite
    return isinstance(value, (int, float)) and not isinstance(value, bool) and 0 <= value < math.inf


def _is_list(of: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, list) and all(map(of, value))


def _is_table(of: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, dict) and all(map(of, value.values()))


def _is_file(value: Any) -> bool:
    """A name in this folder, and no path to somewhere else."""
    return _is_text(value) and value not in ("", ".", "..") and not set(value) & set("/\\:\0")


def _is_place(value: Any) -> bool:
    """A file, or one of its matrices: 'model.mat:K'."""
    return _is_text(value) and _is_file(value.partition(":")[0]) and not value.endswith(":")


Check = tuple[str, Callable[[Any], bool], str]
CHECKS: tuple[Check, ...] = (
    ("name", _is_text, "a text"), ("interface", _is_list(_is_count), "a list of DOF counted from 0"),
    ("ports", _is_table(_is_count), "the number of columns of each port"),
    ("files", _is_table(_is_place), "a file in this folder for each matrix"),
    (HASHES, _is_table(_is_text), "the hash of each file"))
REDUCED: tuple[Check, ...] = (
    ("interface", _is_list(_is_count), "a list of DOF counted from 0"), ("kinds", _is_list(_is_text), "a list of texts"),
    ("modes", _is_count, "a count"), ("method", _is_text, "a text"), ("dropped", _is_count, "a count"),
    ("factorisations", _is_count, "a count"),
    ("cutoff", lambda value: value is None or (_is_size(value) and value > 0), "a positive number or null"),
    ("port_error", _is_table(lambda value: value is None or _is_size(value)), "a number for each port"))

MAP: tuple[Check, ...] = (("dofs", _is_file, "a file in this folder"), ("labels", _is_list(_is_text), "a list of texts"))


def _check(path: Path, about: Any) -> None:
    if not isinstance(about, dict):
        raise InputError(f"{path} is damaged: it holds no table of names; write the model again")
    version = about.get("femsub")
    if type(version) is not int or version != VERSION:
        raise InputError(f"{path} has the version {version!r} ('femsub'), but this femsub reads {VERSION}; write the model "
                         "with this version, or read its matrices one by one")
    if HASHES not in about:
        raise InputError(f"{path} has no hashes of its files, as an older femsub wrote it: write the model again, or read its "
                         "matrices one by one, read_component('M.mtx', 'K.mtx')")
    _check_entries(path, "", about, CHECKS)
    reduced = about.get("reduced")
    if reduced is not None:
        if not isinstance(reduced, dict):
            raise InputError(f"{path} is damaged: 'reduced' must be a table, not {reduced!r:.40}; write the model again")
        _check_entries(path, "reduced: ", {"modes": 0} | reduced, REDUCED)
    if "dofs" in about:
        _check_entries(path, "", about, MAP)
    wanted = {"M", "D", "K"} | ({"V"} if reduced is not None else set()) | ({"ports"} if about["ports"] else set())
    if set(about["files"]) != wanted:
        raise InputError(f"{path} is damaged: 'files' must name {', '.join(sorted(wanted))}, but names "
                         f"{', '.join(sorted(about['files'])) or 'none'}; write the model again")


def _check_entries(path: Path, where: str, table: Mapping[str, Any], checks: tuple[Check, ...]) -> None:
    for key, test, what in checks:
        if key not in table:
            raise InputError(f"{path} is damaged: {where}{key!r} is missing; write the model again")
        if not test(table[key]):
            raise InputError(f"{path} is damaged: {where}{key!r} must be {what}, not {table[key]!r:.80}; write the model again")


def _check_files(path: Path, about: Mapping[str, Any]) -> None:
    named = {place.partition(":")[0] for place in about["files"].values()} | ({about["dofs"]} if "dofs" in about else set())
    if named != set(about[HASHES]):
        raise InputError(f"{path} is damaged: it tells hashes of {', '.join(sorted(about[HASHES])) or 'no file'}, but names "
                         f"{', '.join(sorted(named))}; write the model again")
    for name, expected in about[HASHES].items():
        file = path.parent / name
        if not file.is_file():
            raise InputError(f"there is no file {file}, which {path.name} names; write the model again")
        with open(file, "rb") as content:
            found = content_hash(content)
        if found != expected:
            raise InputError(f"{file} is not the file that {path.name} was written with: a write was stopped on the way, or it "
                             "was changed; write the model again (a file that you changed yourself can be read by its own name)")
