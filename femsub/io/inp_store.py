"""What has been read of an Abaqus or CalculiX file so far, by the file's numbers, and the checks every part of it needs."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from femsub.checks import Array
from femsub.errors import InputError
from femsub.io.mesh_text import as_table, fields


class Range(NamedTuple):
    first: int
    last: int
    step: int


class NodesOf(NamedTuple):
    elements: str


Part: TypeAlias = "Array | Range | NodesOf"


@dataclass
class Found:
    """What a file holds, by the file's numbers."""

    path: Path
    nodes: list[tuple[Array, Array]] = field(default_factory=list)
    elements: list[tuple[str, Array, Array]] = field(default_factory=list)
    others: list[Array] = field(default_factory=list)  # numbers of elements of kinds that are no cells
    node_sets: dict[str, list[Part]] = field(default_factory=dict)
    cell_sets: dict[str, list[Part]] = field(default_factory=dict)
    spelling: dict[str, str] = field(default_factory=dict)
    skipped: Counter[str] = field(default_factory=Counter)
    scopes: Counter[str] = field(default_factory=Counter)
    apart: set[str] = field(default_factory=set)

    def add(self, sort: str, name: str, members: Part) -> None:
        """Names are the same in capitals and small letters, and a set that comes again grows."""
        self.spelling.setdefault(sort + name.upper(), name)
        self.sets(sort).setdefault(name.upper(), []).append(members)

    def sets(self, sort: str) -> dict[str, list[Part]]:
        return self.node_sets if sort == "n" else self.cell_sets

    def all_nodes(self) -> tuple[Array, Array]:
        """Numbers, ascending, and points; a number that comes twice is an error."""
        if not self.nodes:
            raise InputError(f"{self.path} has no *NODE data where they are needed")
        if len(self.nodes) > 1 or not (np.diff(self.nodes[0][0]) > 0).all():
            numbers = np.concatenate([part for part, _ in self.nodes])
            order = once(self.path, "nodes", numbers)
            self.nodes = [(numbers[order], np.concatenate([part for _, part in self.nodes])[order])]
        return self.nodes[0]

    def all_elements(self) -> Array:
        return np.sort(np.concatenate([np.zeros(0, dtype=np.int64), *(part for _, part, _ in self.elements), *self.others]))

    def place(self, what: str, wanted: Array) -> Array:
        """The points of nodes."""
        numbers, points = self.all_nodes()
        return points[rows_of(self.path, what, "node", numbers, wanted)]

    def members(self, sort: str, name: str, what: str) -> Array:
        """Numbers in a set as it is now, ascending."""
        parts = self.sets(sort).get(name.upper())
        if parts is None:
            raise InputError(f"{self.path}: {what} names the set {name!r}, which is not above it")
        found = [self._resolved(what, sort, part) for part in parts]
        return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *found]))

    def _resolved(self, what: str, sort: str, part: Part) -> Array:
        if isinstance(part, NodesOf):
            cells = self.members("e", part.elements, what)
            return np.concatenate([np.zeros(0, dtype=np.int64),
                                   *(nodes[np.isin(numbers, cells)].ravel() for _, numbers, nodes in self.elements)])
        if not isinstance(part, Range):
            return part
        numbers = self.all_nodes()[0] if sort == "n" else self.all_elements()
        count = (part.last - part.first) // part.step + 1
        inside = numbers[(numbers >= part.first) & (numbers <= part.last) & ((numbers - part.first) % part.step == 0)]
        if len(inside) < count:
            wrong = np.flatnonzero(inside != part.first + part.step * np.arange(len(inside)))
            missing = part.first + part.step * (int(wrong[0]) if len(wrong) else len(inside))
            raise InputError(f"{self.path}: {what} names {'node' if sort == 'n' else 'element'} {missing}, which the file does "
                             "not give")
        return inside


def table_of(what: str, data: str, kind: type = np.int64) -> list[list[Any]]:
    """The numbers of each line."""
    values, counts = fields(f"{what}: its data", data, kind)
    return [part.tolist() for part in np.split(values, np.cumsum(counts)[:-1])] if len(counts) else []


def whole_numbers(what: str, values: Array) -> Array:
    if not ((values >= 1) & (values < 2.0**53)).all() or (values % 1).any():
        raise InputError(f"{what} must be whole and positive, not {values[np.argmin((values >= 1) & (values % 1 == 0))]}")
    return values.astype(np.int64)


def once(path: Path, what: str, numbers: Array) -> Array:
    order = np.argsort(numbers, kind="stable")
    again = numbers[order][1:][numbers[order][1:] == numbers[order][:-1]]
    if len(again):
        raise InputError(f"{path} gives {len(np.unique(again))} {what} more than once, the first is {what[:-1]} {again[0]}")
    return order


def rows_of(path: Path, what: str, sort: str, numbers: Array, wanted: Array) -> Array:
    """Where the numbers wanted are among the ascending `numbers`."""
    rows = np.minimum(np.searchsorted(numbers, wanted), len(numbers) - 1)
    missing = wanted[numbers[rows] != wanted] if len(numbers) else wanted
    if missing.size:
        raise InputError(f"{path}: {what} names {sort} {missing.ravel()[0]}, which the file does not give")
    return rows


def padded(what: str, data: str) -> Array:
    values, counts = fields(f"{what}: its data", data, float)
    return as_table(values, counts) if len(counts) else np.zeros((0, 1))


def integer(what: str, options: Mapping[str, str], name: str) -> int:
    if not re.fullmatch(r"[+-]?\d{1,15}", options.get(name, "")):
        raise InputError(f"{what} needs {name}=..., a whole number; it has {options.get(name)!r}")
    return int(options[name])
