"""Points of Nastran's coordinate systems (CORD1R, CORD2R, ..., cylindrical and spherical ones too) in the basic system."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from femsub.checks import Array
from femsub.errors import InputError

NAMES = tuple(f"CORD{way}{shape}" for way in (1, 2) for shape in "RCS")


@dataclass
class Systems:
    """The coordinate systems of a file, and its points as given: numbers (n,), the system of each (n,), coordinates (n, 3).

    `motions` (n,) has the system of each point's motions.

    `by_nodes` has the three nodes of each CORD1, `by_points` system and three points (3, 3) of each CORD2; the z axis leads
    from the first to the second, and the third lies in the half-plane of x and z. The shape is R, C or S.
    """

    path: Path
    numbers: Array
    system: Array
    places: Array
    motions: Array
    by_nodes: Mapping[int, tuple[str, Array]]
    by_points: Mapping[int, tuple[str, int, Array]]
    frames: dict[int, tuple[str, Array, Array] | None] = field(default_factory=dict)  # None while it is looked for

    def basic(self, system: int, local: Array) -> Array:
        """Points (n, 3) of one system in the basic one; angles are in degrees."""
        if system == 0:
            return local
        shape, origin, axes = self._frame(system)
        r, one, other = local[:, 0], np.deg2rad(local[:, 1]), np.deg2rad(local[:, 2])
        if shape == "C":
            local = np.stack([r * np.cos(one), r * np.sin(one), local[:, 2]], axis=1)
        elif shape == "S":
            local = np.stack([r * np.sin(one) * np.cos(other), r * np.sin(one) * np.sin(other), r * np.cos(one)], axis=1)
        return origin + local @ axes

    def points(self) -> Array:
        """All points in the basic system, (n, 3)."""
        found = np.empty_like(self.places)
        for system in np.unique(self.system):
            chosen = self.system == system
            found[chosen] = self.basic(int(system), self.places[chosen])
        return found

    def axes(self, system: int, point: Array) -> Array:
        """Unit vectors of a system at a point of the basic one, (3, 3), as rows: along r, θ, z or r, θ, φ where it is curved."""
        if system == 0:
            return np.eye(3)
        shape, origin, axes = self._frame(system)
        if shape == "R":
            return axes
        x, y, z = axes @ (point - origin)
        across = float(np.hypot(x, y))
        c, s = (x / across, y / across) if across > 1e-9 * abs(z) else (1.0, 0.0)
        turned = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        if shape == "S":
            r = float(np.hypot(across, z)) or 1.0
            turned = np.array([[c * across / r, s * across / r, z / r], [c * z / r, s * z / r, -across / r], turned[1]])
        found: Array = turned @ axes
        return found

    def _frame(self, system: int) -> tuple[str, Array, Array]:
        """Shape, origin and unit vectors (3, 3), as rows."""
        if system in self.frames:
            known = self.frames[system]
            if known is None:
                raise InputError(f"{self.path}: the coordinate system {system} is defined by itself")
            return known
        self.frames[system] = None
        if system in self.by_points:
            shape, of, places = self.by_points[system]
            a, b, c = self.basic(of, places)
        elif system in self.by_nodes:
            shape, nodes = self.by_nodes[system]
            rows = [np.flatnonzero(self.numbers == node) for node in nodes]
            if lost := [int(node) for node, row in zip(nodes, rows, strict=True) if len(row) != 1]:
                raise InputError(f"{self.path}: the coordinate system {system} names node {lost[0]}, which the file does not "
                                 "give")
            a, b, c = (self.basic(int(self.system[row[0]]), self.places[row])[0] for row in rows)
        else:
            raise InputError(f"{self.path} gives nodes in the coordinate system {system} (fields CP and CD), but it has no "
                             f"{', '.join(NAMES)} with this number")
        z, across = b - a, np.cross(b - a, c - a)
        if np.linalg.norm(across) <= 1e-9 * np.linalg.norm(z) * np.linalg.norm(c - a):
            raise InputError(f"{self.path}: the three points of the coordinate system {system} lie on a line")
        y, z = across / np.linalg.norm(across), z / np.linalg.norm(z)
        found = shape, a, np.stack([np.cross(y, z), y, z])
        self.frames[system] = found
        return found
