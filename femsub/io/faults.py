"""The faults of a TOML file, all reported at once, each with its line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from femsub.checks import FemsubError, InputError
from femsub.io.toml_files import line_numbers

Place = Sequence[Any]  # the keys that lead to a value: ("part", "disc", "E"), ("ask", 2, "between")


class Faults:
    """The faults found so far. `source` is the name of the file, `text` its content."""

    def __init__(self, source: str = "", text: str = "") -> None:
        self.source, self.lines = source, line_numbers(text)
        self.found: list[tuple[int, str]] = []

    def line(self, place: Place) -> int:
        """The line of a value, or of the nearest table around it; 0 if the file has neither."""
        keys = tuple(place)
        while keys and keys not in self.lines:
            within = [line for one, line in self.lines.items() if one[:len(keys)] == keys]  # [part.disc] stands for part
            if within:
                return min(within)
            keys = keys[:-1]
        return self.lines.get(keys, 0)

    def add(self, place: Place, error: object) -> None:
        """Notes a fault of a value."""
        said = f"{spelt(place)}: {error}" if place else str(error)
        if said not in [text for _, text in self.found]:
            self.found.append((self.line(place), said))

    @contextmanager
    def at(self, place: Place) -> Iterator[None]:
        """Inside, an error of femsub is noted as a fault of this place."""
        try:
            yield
        except FemsubError as error:
            self.add(place, error)

    def check(self) -> None:
        """Refuses the file if anything is wrong.

        Raises
        ------
        InputError
            All faults, in the order of their lines.
        """
        if not self.found:
            return
        said = [f"line {line}: {text}" if line else text for line, text in sorted(self.found, key=lambda one: one[0])]
        whose = f"{self.source}, " if self.source else ""
        raise InputError(f"{whose}{said[0]}" if len(said) == 1 else f"{whose}{len(said)} faults:\n"
                         + "\n".join(f"  {one}" for one in said))


def spelt(place: Place) -> str:
    """'part.disc.E', 'ask 3.between'."""
    words = ""
    for key in place:
        words += f" {key + 1}" if isinstance(key, int) else f".{key}" if words else str(key)
    return words
