"""What is wrong with a scene file: all of it at once, each with its line."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from femsub.checks import FemsubError, InputError

Place = Sequence[Any]  # the keys that lead to a value: ("part", "disc", "E"), ("ask", 2, "between")
HEADER = re.compile(r"\s*(\[\[?)([^\[\]]+)\]")
KEY = re.compile(r"""\s*((?:[\w-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[\w-]+|"[^"]*"|'[^']*'))*)\s*=""")
NAME = re.compile(r"""[\w-]+|"[^"]*"|'[^']*'""")


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
    """A header's names with the number of each array of tables behind its name."""
    place: tuple[Any, ...] = ()
    for at, name in enumerate(names, 1):
        place = (*place, name)
        if names[:at] in counts:
            place = (*place, counts[names[:at]])
    return place


class Faults:
    """What was found wrong so far. `source` is the file, `text` what stands in it."""

    def __init__(self, source: str = "", text: str = "") -> None:
        self.source, self.lines = source, line_numbers(text)
        self.found: list[tuple[int, str]] = []

    def line(self, place: Place) -> int:
        """The line of a value, or of the nearest table around it; 0 where it does not stand in the file."""
        keys = tuple(place)
        while keys and keys not in self.lines:
            within = [line for one, line in self.lines.items() if one[:len(keys)] == keys]  # [part.disc] stands for part
            if within:
                return min(within)
            keys = keys[:-1]
        return self.lines.get(keys, 0)

    def add(self, place: Place, error: object) -> None:
        """Notes what is wrong with a value."""
        said = f"{spelt(place)}: {error}" if place else str(error)
        if said not in [text for _, text in self.found]:
            self.found.append((self.line(place), said))

    @contextmanager
    def at(self, place: Place) -> Iterator[None]:
        """What is refused within belongs to this place."""
        try:
            yield
        except FemsubError as error:
            self.add(place, error)

    def check(self) -> None:
        """Refuses the scene if anything is wrong.

        Raises
        ------
        InputError
            All that was found, by its lines.
        """
        if not self.found:
            return
        said = [f"line {line}: {text}" if line else text for line, text in sorted(self.found, key=lambda one: one[0])]
        whose = f"{self.source}, " if self.source else ""
        raise InputError(f"{whose}{said[0]}" if len(said) == 1 else f"{whose}{len(said)} faults:\n"
                         + "\n".join(f"  {one}" for one in said))


def spelt(place: Place) -> str:
    """'part.disc.E', 'ask 3 (critical)'."""
    words = ""
    for key in place:
        words += f" {key + 1}" if isinstance(key, int) else f".{key}" if words else str(key)
    return words
