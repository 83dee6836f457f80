"""Abaqus and CalculiX input files as keywords: what *INCLUDE and INPUT= bring in stands where it belongs."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import NamedTuple

from femsub.errors import InputError
from femsub.io.mesh_text import text_of

#: keywords with data from which a mesh is made
MESH = ("NODE", "ELEMENT", "NSET", "ELSET", "NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM")
#: keywords that change a mesh in ways that are not read
CHANGING = ("IMPERFECTION", "IMPORT", "IMPORT ELSET", "IMPORT NSET", "SYMMETRIC MODEL GENERATION", "REFINE MESH", "PARAMETER")
DEEPEST = 9  # files included by files
_ITEM = re.compile(r'(?:[^,"]|"[^"]*"?)+')


class Block(NamedTuple):
    """A keyword, its options in capitals (quotes taken off the values), and the lines of data below it."""

    keyword: str
    options: Mapping[str, str]
    data: str


def blocks(path: Path) -> Iterator[Block]:
    """The keywords of a file in their order.

    Raises
    ------
    InputError
        A file that is named but not there; a last line that may be cut; a keyword that changes the mesh in a way that is
        not read; one that is nearly, but not quite, the name of one that is.
    """
    text = re.sub(r"^[ \t]*\*\*.*\n?", "", _whole(path, 0), flags=re.MULTILINE)
    quoted: dict[str, str] = {}
    for part in re.split(r"^[ \t]*\*", text, flags=re.MULTILINE)[1:]:
        head, _, data = part.partition("\n")
        while head.rstrip().endswith(",") and data:
            more, _, data = data.partition("\n")
            head += more
        words = _ITEM.findall(head)
        keyword = " ".join(words[0].split()).upper() if words else ""
        options = {key.strip().upper(): _unquoted(value) for key, _, value in (word.partition("=") for word in words[1:])}
        _refuse(path, keyword, options)
        for name in re.findall(r'SET\s*=\s*"([^"]*)"', head, flags=re.IGNORECASE):
            if quoted.setdefault(name.upper(), name) != name:
                raise InputError(f"{path} has sets {quoted[name.upper()]!r} and {name!r}, which differ in capitals only and "
                                 "would become one: rename one of them")
        if keyword in MESH and "INPUT" in options:
            data = _input(path, keyword, options["INPUT"]) + data
        yield Block(keyword, options, data)


def names(data: str) -> list[str]:
    """What stands between commas and ends of lines, without the blanks around it; quotes stay."""
    return [word for line in data.split("\n") for item in _ITEM.findall(line) if (word := item.strip())]


def _unquoted(value: str) -> str:
    return value.strip().strip('"')


def _refuse(path: Path, keyword: str, options: Mapping[str, str]) -> None:
    if keyword in CHANGING or (keyword == "MODEL CHANGE" and options.get("TYPE", "ELEMENT").upper() == "ELEMENT"):
        raise InputError(f"{path} has *{keyword}, which changes the mesh in a way that femsub does not read: write the mesh as "
                         "it is after it")
    near = get_close_matches(keyword.replace(" ", ""), MESH, n=1, cutoff=0.8)
    if near and keyword not in MESH:
        raise InputError(f"{path} has the unknown keyword *{keyword}; did you mean *{near[0]}?")


def _whole(path: Path, depth: int) -> str:
    """The text with the files it includes, as if they had been typed there."""
    text = text_of(path)
    _ended(path, text, alone=depth == 0)
    parts = re.split(r"^[ \t]*\*[ \t]*INCLUDE\b([^\n]*(?:,[ \t]*\n[^\n]*)*)\n?", text, flags=re.MULTILINE | re.IGNORECASE)
    for i in range(1, len(parts), 2):
        found = re.search(r'INPUT\s*=\s*("[^"]*"|[^,\n]*)', parts[i], flags=re.IGNORECASE)
        name = _unquoted(found[1]) if found else ""
        if depth >= DEEPEST or not name or not (path.parent / name).is_file():
            raise InputError(f"{path} includes {name or 'no file'!r}, which is not a file beside it")
        parts[i] = _whole(path.parent / name, depth + 1)
    return "".join(part if part.endswith("\n") or not part else f"{part}\n" for part in parts)


def _input(path: Path, keyword: str, name: str) -> str:
    place = path.parent / name
    if not place.is_file():
        raise InputError(f"{path}: *{keyword} takes its data from {name!r}, which is not a file beside it")
    text = text_of(place)
    _ended(place, text, alone=False)
    text = re.sub(r"^[ \t]*\*\*.*\n?", "", text, flags=re.MULTILINE)
    if re.search(r"^[ \t]*\*", text, flags=re.MULTILINE):
        raise InputError(f"{place} is the INPUT of *{keyword}, but has a keyword of its own: *INCLUDE it instead")
    return text if text.endswith("\n") or not text else f"{text}\n"


def _ended(path: Path, text: str, alone: bool) -> None:
    """Refuses a last line without an end where mesh data, or a keyword that brings some, may be cut in it."""
    if text.endswith("\n") or not text:
        return
    heads = re.findall(r"^[ \t]*\*(?!\*)([^\n,]*)", text, flags=re.MULTILINE)
    last = " ".join(heads[-1].split()).upper() if heads else "" if alone else "NODE"
    line = text[text.rfind("\n") + 1:].lstrip()
    cut = line.startswith("*") and not line.startswith("**") and any(word.startswith(last) for word in (*MESH, "INCLUDE"))
    if line and not line.startswith("**") and (last in MESH or cut):
        raise InputError(f"{path} ends within a line of *{last} data: is it cut short? If not, end that line")
