"""Complex modes as files: on a mesh's surface in single precision, which a page animates, and over a period, for ParaView."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from femsub.checks import Array, InputError
from femsub.components import Mesh, boundary_faces, corner_nodes
from femsub.io.atomic import Writer
from femsub.io.matrix_files import read_arrays
from femsub.io.mesh_files import mesh_bytes, series_bytes
from femsub.output import MODE_FILE, Moving

MOST_BYTES = 1 << 26  # largest size of a mode's file, unpacked: ten times the size of such a surface
ARRAYS = ("points", "cells", "real", "imag")  # cells are lines or triangles


def mode_file(mesh: Mesh, u: Array, title: str, eigenvalue: complex) -> dict[str, Writer]:
    """{name: writer} for the file of a complex shape u (nodes, 3) that a page shows; the writer makes the content."""
    return {MODE_FILE: partial(_write, mesh, u, {"title": title, "eigenvalue": [eigenvalue.real, eigenvalue.imag],
                                                 "nodes": len(mesh.points)})}


def motion_files(mesh: Mesh, shape: Array, omega: float, words: str, title: str, phases: int = 12) -> dict[str, Writer]:
    """Re(u e^(iωt)) at `phases` times of a period: a .pvd file, which ParaView animates, and a .vtu file for each time."""
    bare = Mesh(mesh.points, mesh.cells, mesh.kind)
    times = {f"{title}/phase-{k:02d}.vtu": 2 * np.pi * k / phases / omega for k in range(phases)}

    def phase(time: float, file: BinaryIO) -> None:
        file.write(mesh_bytes(bare, {f"displacement {words}": (shape * np.exp(1j * omega * time)).real}))

    def series(file: BinaryIO) -> None:
        file.write(series_bytes(times))

    files: dict[str, Writer] = {f"{title}.pvd": series}
    return files | {name: partial(phase, time) for name, time in times.items()}


def moving(mesh: Mesh, u: Array, facts: Mapping[str, Any], most: int = 12_000) -> Moving:
    """A mesh's surface, or its lines, with `most` nodes at most; the largest displacement is 1, at the phase 0.

    A browser redraws 12,000 nodes some 20 times a second.
    """
    cells = mesh.cells
    if mesh.dimension == 1:
        cells = cells[:, :2]
    else:
        corners = corner_nodes(mesh, *boundary_faces(mesh)) if mesh.dimension == 3 else cells
        cells = corners if corners.shape[1] == 3 else corners[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.points.shape[1])))
    used, inverse = np.unique(cells, return_inverse=True)
    points, u, cells = points[used], u[used], inverse.reshape(cells.shape)
    # a larger surface gets one point for each box of a grid, and keeps the cells that join boxes: Rossignac and Borrel (1993)
    if len(points) > most:
        low, edge = points.min(axis=0), float(np.ptp(points, axis=0).max()) / most
        while True:  # find the smallest boxes that do, within a quarter
            at = ((points - low) / edge).astype(np.int64)
            boxes, box = np.unique(at @ np.array([1, most + 1, (most + 1) ** 2]), return_inverse=True)
            if len(boxes) <= most:
                break
            edge *= 1.25
        joined = box[cells]
        ordered = np.sort(joined, axis=1)
        whole = np.flatnonzero((np.diff(ordered, axis=1) > 0).all(axis=1))
        _, first = np.unique(ordered[whole], axis=0, return_index=True)
        points, u, cells = _means(points, box), _means(u, box), joined[whole[first]]
    length = np.linalg.norm(u, axis=1).max()
    largest = u.ravel()[np.abs(u).argmax()]
    return Moving(dict(facts), points, cells, u * (np.conj(largest) / abs(largest) / length) if length else u)


def _means(values: Array, box: Array) -> Array:
    """The mean of the values (n, 3) in each box."""
    found = np.zeros((box.max() + 1, values.shape[1]), values.dtype)
    np.add.at(found, box, values)
    return found / np.bincount(box)[:, None]


def _write(mesh: Mesh, u: Array, facts: Mapping[str, Any], file: BinaryIO) -> None:
    made = moving(mesh, u, facts)
    np.savez_compressed(file, facts=np.frombuffer(json.dumps(made.facts).encode(), dtype=np.uint8),
                        points=made.points.astype(np.float32), cells=made.cells.astype(np.int32),
                        real=made.u.real.astype(np.float32), imag=made.u.imag.astype(np.float32))


def read_mode(path: Path, content: BinaryIO | None = None) -> Moving:
    """The mode in a file, or in `content` where the file is not written yet.

    Raises
    ------
    InputError
        The file does not hold a mode.
    """
    try:
        found = read_arrays(path, content, MOST_BYTES)
        facts = json.loads(found["facts"].tobytes())
        points, cells, real, imag = (found[name] for name in ARRAYS)
        # a title, an eigenvalue and the size of the mesh, each of its type
        value = facts.get("eigenvalue") if isinstance(facts, dict) else None
        known = (isinstance(value, list) and len(value) == 2
                 and all(type(part) in (int, float) and abs(part) < math.inf for part in value)
                 and isinstance(facts.get("title"), str) and type(facts.get("nodes")) is int)
        if not (known and points.shape == real.shape == imag.shape == (len(points), 3) and cells.ndim == 2
                and all(part.dtype.kind == "f" and np.isfinite(part).all() for part in (points, real, imag))
                and cells.dtype.kind in "iu" and cells.shape[1] in (2, 3)
                and cells.min(initial=0) >= 0 and cells.max(initial=0) < max(len(points), 1)):
            raise ValueError("its arrays do not fit each other")
    except (ValueError, KeyError, RecursionError) as error:
        raise InputError(f"{path} does not hold a mode as femsub writes it: {error!s:.200}. Delete it, or run the scene again") \
            from None
    return Moving(facts, points, cells, real + 1j * imag)
