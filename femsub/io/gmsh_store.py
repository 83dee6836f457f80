"""What has been read of a Gmsh mesh so far, and its numbers, of which none is taken that is not there."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from femsub.checks import Array
from femsub.errors import InputError
from femsub.io.mesh_text import as_numbers


@dataclass
class Found:
    path: Path
    version: str = ""
    binary: bool = False
    words: str = "<u8"  # how sizes are stored in binary
    names: dict[tuple[int, int], str] = field(default_factory=dict)
    entities: dict[tuple[int, int], list[int]] = field(default_factory=dict)
    numbers: Array | None = None
    points: Array | None = None
    #: kind, numbers of the elements, nodes by number, physical tags: of each element, or those all of them have
    blocks: list[tuple[int, Array, Array, Array | list[int]]] = field(default_factory=list)
    point_data: dict[str, tuple[Array, Array]] = field(default_factory=dict)
    cell_data: dict[str, tuple[Array, Array]] = field(default_factory=dict)

    def wrong(self, why: str) -> InputError:
        return InputError(f"{self.path} cannot be read as a Gmsh mesh: {why}")


class Numbers:
    """Takes numbers one after the other from a section, and never more than there are."""

    def __init__(self, found: Found, section: str, raw: bytes, start: int, kind: type = float) -> None:
        self.found, self.section, self.raw, self.place = found, section, raw, start
        self.end = len(raw)
        self.values: Array | None = None
        if not found.binary:
            self.end = raw.find(b"$End" + section.encode(), start)
            if self.end < 0:
                raise found.wrong(f"${section} does not end: is it cut short?")
            text = raw[start:self.end].decode("latin-1")
            self.values, self.place = as_numbers(f"{found.path}: the data of ${section}", text, kind), 0

    def take(self, kind: str, count: int) -> Array:
        """`count` numbers: 'i' whole, 'n' sizes and tags, 'd' real."""
        if self.values is not None:
            part = self.values[self.place:self.place + count]
            if len(part) < count or count < 0:
                raise self.found.wrong(f"${self.section} has fewer numbers than it says: is it cut short or damaged?")
            self.place += count
            if kind == "d":
                return part.astype(float)
            if (part % 1 != 0).any() or (np.abs(part) > 2.0**53).any():
                raise self.found.wrong(f"${self.section} has {part[part % 1 != 0][:1]} where a whole number belongs")
            return part.astype(np.int64)
        dtype = np.dtype({"i": "<i4", "n": self.found.words, "d": "<f8"}[kind])
        if count < 0 or self.place + count * dtype.itemsize > self.end:
            raise self.found.wrong(f"${self.section} says it has {count} numbers more than the file: is it cut short or damaged?")
        part = np.frombuffer(self.raw, dtype=dtype, count=count, offset=self.place)
        self.place += count * dtype.itemsize
        if kind == "n" and len(part) and part.max() > np.uint64(2**62):
            raise self.found.wrong(f"${self.section} has a number beyond all limits")
        return part.astype(float if kind == "d" else np.int64)

    def one(self, kind: str) -> int:
        return int(self.take(kind, 1)[0])

    def records(self, dtype: Any, count: int) -> Array:
        """Rows of a binary section."""
        size = np.dtype(dtype).itemsize
        if count < 0 or self.place + count * size > self.end:
            raise self.found.wrong(f"${self.section} says it has {count} rows, more than the file: is it cut short or damaged?")
        self.place += count * size
        return np.frombuffer(self.raw, dtype=dtype, count=count, offset=self.place - count * size)

    def done(self) -> int:
        """The place in the file behind the section, all of which must have been taken."""
        if self.values is not None and self.place != len(self.values):
            raise self.found.wrong(f"${self.section} has {len(self.values) - self.place} numbers more than it says")
        mark = b"$End" + self.section.encode()
        place = self.end if self.values is not None else self.place + len(self.raw[self.place:self.place + 9]) - len(
            self.raw[self.place:self.place + 9].lstrip())
        if self.raw[place:place + len(mark)] != mark:
            raise self.found.wrong(f"${self.section} does not end where it says: is it cut short or damaged?")
        return place + len(mark)
