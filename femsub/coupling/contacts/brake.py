"""A disc brake of three meshes in one coordinate system: a disc with hat, and two pads, of 20-node bricks, without Gmsh."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from femsub.checks import EQUAL, POSITION, Array, positive_number
from femsub.components import Mesh, ring

Cuts = tuple[float, ...]

RADII: Cuts = (0.035, 0.075, 0.083, 0.095, 0.145, 0.15)  # of the disc, in m: hub, wall of the hat, ring with its track
HEIGHTS: Cuts = (-0.006, 0.006, 0.036, 0.044)  # of the ring, and of the flange of the hat, in m
PAD_RADII: Cuts = (0.094, 0.098, 0.142, 0.146)  # the lining is between the inner two
PAD_ANGLES: Cuts = (-33.0, -30.0, 30.0, 33.0)  # degrees
PAD_DEPTHS: Cuts = (0.006, 0.017, 0.022)  # of the lining's face, and of both faces of the back plate, in m


def brake_meshes(size: float = 0.025) -> dict[str, Mesh]:
    """The meshes 'disc', 'inboard' and 'outboard', in m, with the axis along z: the brake of meshes/, made without Gmsh.

    Elements are about `size` long in the disc and 0.8 `size` in the pads, so that their faces do not match. The disc has the sets
    hub, rim, inboard and outboard (its tracks). A pad has the sets face, back, leading and trailing, and the groups lining and
    plate.
    """
    positive_number("size", size)
    around = (RADII[2] + RADII[-1]) / 2 * np.pi / 2
    disc = _bricks("disc", RADII, (0.0, 90.0, 180.0, 270.0, 360.0), HEIGHTS, size, around)
    r, z = _middles(disc)
    ring, wall, flange = (z < HEIGHTS[1]) & (r > RADII[1]), (r > RADII[1]) & (r < RADII[2]), (z > HEIGHTS[2]) & (r < RADII[2])
    disc = _kept(disc, ring | wall | flange)
    r, z = np.hypot(disc.points[:, 0], disc.points[:, 1]), disc.points[:, 2]
    track = (r > RADII[3] - EQUAL) & (r < RADII[4] + EQUAL)
    disc = disc.with_sets(hub=r < RADII[0] + EQUAL, rim=r > RADII[-1] - EQUAL, inboard=track & (z < HEIGHTS[0] + EQUAL),
                          outboard=track & (np.abs(z - HEIGHTS[1]) < EQUAL))
    meshes = {"disc": disc}
    length = (RADII[2] + RADII[-1]) / 2 * np.radians(PAD_ANGLES[2] - PAD_ANGLES[1])
    for name, side in (("inboard", -1), ("outboard", 1)):
        depths = PAD_DEPTHS if side > 0 else tuple(-depth for depth in reversed(PAD_DEPTHS))
        pad = _bricks(name, PAD_RADII, PAD_ANGLES, depths, 0.8 * size, length)
        r, z = _middles(pad)
        angle = np.degrees(np.arctan2(*pad.points[pad.cells].mean(axis=1)[:, 1::-1].T))
        plate = side * z > PAD_DEPTHS[1]
        lining = ~plate & (r > PAD_RADII[1]) & (r < PAD_RADII[2]) & (np.abs(angle) < PAD_ANGLES[2])
        pad = _kept(pad, plate | lining, lining=lining, plate=plate)
        angle, depth = np.degrees(np.arctan2(pad.points[:, 1], pad.points[:, 0])), side * pad.points[:, 2]
        meshes[name] = pad.with_sets(face=depth < PAD_DEPTHS[0] + EQUAL, back=depth > PAD_DEPTHS[2] - EQUAL,
                                     leading=angle < PAD_ANGLES[0] + POSITION, trailing=angle > PAD_ANGLES[3] - POSITION)
    return meshes


def _bricks(name: str, radii: Cuts, angles: Cuts, heights: Cuts, size: float, length: float) -> Mesh:
    """An annulus or a sector whose bricks end at the given cuts. `length` is the arc length of the widest span of angles."""
    widest = max(end - start for start, end in pairwise(angles))
    counts = [[max(1, round((end - start) * scale / size)) for start, end in pairwise(cuts)]
              for cuts, scale in ((radii, 1.0), (angles, length / widest), (heights, 1.0))]
    grid, cells = ring([sum(one) for one in counts], "hexahedron20", closed=angles[-1] - angles[0] == 360)
    r, turn, z = (np.interp(places, np.append(0.0, np.cumsum(one)), cuts)
                  for places, one, cuts in zip(grid.T, counts, (radii, angles, heights), strict=True))
    angle = np.radians(turn)
    return Mesh(np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1), cells, "hexahedron20", name=name)


def _middles(mesh: Mesh) -> tuple[Array, Array]:
    """The mean radius and height of each cell."""
    points = mesh.points[mesh.cells]
    return np.hypot(points[..., 0], points[..., 1]).mean(axis=1), points[..., 2].mean(axis=1)


def _kept(mesh: Mesh, cells: Array, **groups: Array) -> Mesh:
    """The mesh of some cells, without unused nodes, and with groups of these cells."""
    nodes, places = np.unique(mesh.cells[cells], return_inverse=True)
    named = {name: np.flatnonzero(chosen[cells]) for name, chosen in groups.items()}
    return Mesh(mesh.points[nodes], places.reshape(-1, mesh.cells.shape[1]), mesh.kind, groups=named, name=mesh.name)
