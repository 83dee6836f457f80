"""A steel rail on sleepers that lie ever farther apart, in pieces: each is written to a file, and the whole is never there."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import femsub as fs
from femsub.io.pieces import Piece

STEEL = fs.Material(2.1e11, 0.3, 7850.0)
SIDE = 0.01  # m, of an element
APART = 0.4, 0.8  # m between sleepers, at the start and at the end; so the lowest frequencies lie apart, too
WIDE = 0.05  # m, of a sleeper
PATCH = 0.025  # m, half of that on which a belt rubs, in a quarter of the last span: in its middle bending does not move the top
ARGUMENTS = {"material": STEEL, "supports": ["sleepers"], "ports": {"belt": ("patch", "x")}, "rayleigh": (0.0, 2e-7)}


def cells_of(dof: float, parts: int, section: tuple[int, int]) -> list[int]:
    """Layers of elements of each part of a rail with about so many DOF, before the supports."""
    layers = round(dof / (3 * (section[0] + 1) * (section[1] + 1)))
    return [layers * (at + 1) // parts - layers * at // parts for at in range(parts)]


def sleepers(length: float) -> np.ndarray:
    """Their middles, from 0 to the end."""
    count = max(2, round(2 * length / sum(APART)))
    places = np.append(0.0, np.cumsum(np.linspace(*APART, count)))
    return places * (length / places[-1])


def piece(at: int, layers: list[int], section: tuple[int, int]) -> fs.Mesh:
    """The mesh of one part, with the numbers that its nodes have in the whole rail."""
    first, count = sum(layers[:at]), layers[at]
    mesh = fs.block((count * SIDE, section[0] * SIDE, section[1] * SIDE), (count, *section), "hexahedron")
    face, nodes = (section[0] + 1) * (section[1] + 1), np.arange(len(mesh.points))
    points = mesh.points + np.array([first * SIDE, 0.0, 0.0])
    x, _, z = points.T
    ends = {f"p{other}+p{other + 1}": chosen for other, chosen in ((at, nodes[:face]), (at + 1, nodes[-face:]))
            if 0 < other < len(layers)}
    places = sleepers(sum(layers) * SIDE)
    under = np.abs(x[:, None] - places).min(axis=1) <= WIDE / 2 + 1e-9
    sets = {**ends, "sleepers": nodes[(z <= 1e-9) & under]}
    middle = 0.75 * places[-2] + 0.25 * places[-1]
    patch = nodes[(z >= section[1] * SIDE - 1e-9) & (np.abs(x - middle) <= PATCH + 1e-9)]
    if len(patch):
        sets["patch"] = patch
    return fs.Mesh(points, mesh.cells, mesh.kind, sets, numbers=first * face + 1 + nodes, name=f"p{at + 1}")


def rail(folder: Path, dof: float, parts: int, section: tuple[int, int]) -> dict[str, Piece]:
    """The files of all parts, one after the other, and what builds each."""
    layers = cells_of(dof, parts, section)
    return {f"p{at + 1}": Piece.of(fs.write_mesh(folder / f"p{at + 1}.vtu", piece(at, layers, section)), fs.solid, ARGUMENTS)
            for at in range(parts)}
