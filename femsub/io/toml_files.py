"""TOML: files read with the lines of their keys, and tables written."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any

from femsub.checks import InputError

HEADER = re.compile(r"\s*(\[\[?)([^\[\]]+)\]")
KEY = re.compile(r"""\s*((?:[\w-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[\w-]+|"[^"]*"|'[^']*'))*)\s*=""")
NAME = re.compile(r"""[\w-]+|"[^"]*"|'[^']*'""")


def parsed_toml(text: str, source: str) -> dict[str, Any]:
    """The content of a TOML file.

    Raises
    ------
    InputError
        The text is no TOML.
    """
    try:
        return tomllib.loads(text)
    except ValueError as error:  # text that is no TOML or no UTF-8, a number of more than 4,300 digits
        raise InputError(f"{source} is not a TOML file: {error}") from None
    except RecursionError:
        raise InputError(f"{source} is no scene file: its brackets are nested too deeply") from None


def line_numbers(text: str) -> dict[tuple[Any, ...], int]:
    """The line of each table and key of a TOML file. Members of arrays of tables are counted from 0."""
    found: dict[tuple[Any, ...], int] = {}
    counts: dict[tuple[str, ...], int] = {}
    here: tuple[Any, ...] = ()
    depth, quoted = 0, ""  # within an array of several lines, or a text of several lines
    for number, line in enumerate(text.splitlines(), 1):
        if not depth and not quoted:
            if header := HEADER.match(line):
                names = tuple(name.strip("\"'") for name in NAME.findall(header[2]))
                if header[1] == "[[":
                    counts[names] = counts.get(names, -1) + 1
                here = _indexed(names, counts)
                found.setdefault(here, number)
                continue
            if key := KEY.match(line):
                place = here
                for name in NAME.findall(key[1]):
                    place = (*place, name.strip("\"'"))
                    found.setdefault(place, number)
                for inner in re.finditer(r"[{,]\s*([\w-]+)\s*=", line[key.end():]):
                    found.setdefault((*place, inner[1]), number)
        for mark in ('"""', "'''"):
            if line.count(mark) % 2 and quoted in ("", mark):
                quoted = "" if quoted else mark
        if not quoted:
            bare = re.sub(r""""(?:\\.|[^"\\])*"|'[^']*'|#.*""", "", line)
            depth = max(depth + bare.count("[") + bare.count("{") - bare.count("]") - bare.count("}"), 0)
    return found


def _indexed(names: tuple[str, ...], counts: dict[tuple[str, ...], int]) -> tuple[Any, ...]:
    """A header's names; behind the name of an array of tables, the number of its last table so far."""
    place: tuple[Any, ...] = ()
    for at, name in enumerate(names, 1):
        place = (*place, name)
        if names[:at] in counts:
            place = (*place, counts[names[:at]])
    return place


def toml(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        if value and not 1e-3 <= abs(value) < 1e6:
            mantissa, exponent = f"{value:.16e}".split("e") if float(f"{value:.14e}") != value else f"{value:.14e}".split("e")
            return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
        return repr(float(value))  # the shortest text that gives the same number
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(toml, value))}]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{toml_key(key)} = {toml(item)}" for key, item in value.items()) + "}"
    return str(value)


def toml_key(key: str) -> str:
    """A key, in quotes where it needs them."""
    bare = key and all((mark.isalnum() and mark.isascii()) or mark in "_-" for mark in key)
    return key if bare else json.dumps(key, ensure_ascii=False)


def toml_text(table: Mapping[str, Any]) -> str:
    """A table as a TOML file: keys, then tables. A table in a table has a header as [part.disc]; deeper ones are in braces."""
    return "\n".join(_lines(table, 2)) + "\n"


def _lines(table: Mapping[str, Any], deep: int, header: str = "") -> Iterator[str]:
    """The lines of a table; `deep` levels of the tables in it have headers."""
    known = {toml_key(key): value for key, value in table.items() if value is not None}
    listed = {key for key, value in known.items() if deep == 2 and isinstance(value, list) and value
              and all(isinstance(item, Mapping) for item in value)}
    tables = {key: value for key, value in known.items() if key in listed or (deep and isinstance(value, Mapping))}
    yield from (f"{key} = {toml(value)}" for key, value in known.items() if key not in tables)
    for key, value in tables.items():
        if deep == 2 and key not in listed and value and all(isinstance(item, Mapping) for item in value.values()):
            yield from _lines(value, 1, f"{key}.")
            continue
        for item in value if key in listed else [value]:
            yield f"\n[[{key}]]" if key in listed else f"\n[{header}{key}]"
            yield from _lines(item, 0)
