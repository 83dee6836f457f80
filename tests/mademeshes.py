"""Makes beam.inp and disc.vtu in meshes/.

    PYTHONPATH=. python tests/mademeshes.py

Lengths are in m; each comes out the same whenever it is made.

============================  =============  =================================================================
file                          cells          sets of nodes
============================  =============  =================================================================
beam.inp                      hexahedron20   clamp (x = 0), tip (x = 0.5), contact (top, 0.44 ≤ x ≤ 0.48)
  0.5 x 0.03 x 0.02                          group: beam
disc.vtu                      hexahedron20   inner, rim, bottom, top, contact (top, two cells next to the rim)
  radii 0.05 and 0.15, 0.012 thick
plate-with-hole.msh (2.2)     triangle       clamp (x = 0), tip (x = 0.4), hole
  0.4 x 0.2, a hole of radius 0.04           group: plate
bracket.msh (4.1)             tetra10        bolts (the four holes), tip (the upper end of the upright leg)
  two legs of 0.12 x 0.08 and 0.1 x 0.08,    group: bracket
  0.01 thick, joined at a right angle
============================  =============  =================================================================

The last two were made once with Gmsh 4.15.2, by this script as it is in the history at commit e0d65ca. brake-disc.vtu,
brake-inboard.vtu and brake-outboard.vtu have the nodes of `femsub.coupling.brake_meshes(0.025)`. Two come from elsewhere:
disc-with-pad.msh by `gmsh -3 -nt 1 disc-with-pad.geo`, calculix/ by CalculiX 2.20 from its beam.inp.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import femsub as fs

MESHES = Path(__file__).resolve().parents[1] / "meshes"


def beam() -> fs.Mesh:
    """A cantilever of 25 x 2 x 2 bricks."""
    mesh = fs.block((0.5, 0.03, 0.02), (25, 2, 2), "hexahedron20", name="beam")
    x, top = mesh.points[:, 0], mesh.sets["top"]
    sets = {"clamp": mesh.sets["left"], "tip": mesh.sets["right"], "contact": top[np.abs(x[top] - 0.46) < 0.0201]}
    return fs.Mesh(mesh.points, mesh.cells, mesh.kind, sets, {"beam": np.arange(len(mesh.cells))}, name="beam")


def disc() -> fs.Mesh:
    """A brake disc of 6 x 40 x 2 bricks."""
    mesh = fs.annulus(0.05, 0.15, 0.012, (6, 40, 2), "hexahedron20", name="disc")
    radius, angle = np.hypot(mesh.points[:, 0], mesh.points[:, 1]), np.arctan2(mesh.points[:, 1], mesh.points[:, 0])
    top = mesh.sets["top"]
    near = (radius[top] > 0.15 - 0.1 / 6 - 1e-6) & (np.abs(angle[top]) < 2 * np.pi / 40 + 1e-6)
    sets = {"inner": mesh.sets["inner"], "rim": mesh.sets["outer"], "bottom": mesh.sets["bottom"], "top": top}
    return fs.Mesh(mesh.points, mesh.cells, mesh.kind, {**sets, "contact": top[near]}, name="disc")


if __name__ == "__main__":
    for name, mesh in (("beam.inp", beam()), ("disc.vtu", disc())):
        fs.write_mesh(MESHES / name, mesh)
        print(f"{name}: {(MESHES / name).stat().st_size / 1e3:.0f} kB, {fs.read_mesh(MESHES / name)!r}")
