"""Makes the meshes in meshes/.

Lengths are in m; each comes out the same whenever it is made (Gmsh: with the same version).

    python -m benchmarks make-meshes [--out DIR] [NAME ...]

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

brake-disc.vtu, brake-inboard.vtu and brake-outboard.vtu have the nodes of `femsub.coupling.brake_meshes(0.025)`.
Two come from elsewhere: disc-with-pad.msh by `gmsh -3 -nt 1 disc-with-pad.geo`, calculix/ by CalculiX 2.20 from its
beam.inp.

beam and disc need femsub alone; the other two need Gmsh: pip install gmsh (made with 4.15.2), and its libraries
(Debian: libglu1-mesa libxrender1 libxcursor1 libxft2 libxinerama1).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import femsub as fs
from benchmarks import UsageError
from femsub.checks import installed_by

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


@contextmanager
def gmsh_model(name: str, **options: float) -> Iterator[Any]:
    """Gmsh with one thread and fixed seeds, so that the mesh is the same each time."""
    import gmsh

    gmsh.initialize(["gmsh", "-nt", "1"], readConfigFiles=False)
    try:
        for option, value in {"Terminal": 0, "RandomSeed": 1, "Binary": 0, **options}.items():
            gmsh.option.setNumber(f"{'General' if option == 'Terminal' else 'Mesh'}.{option}", value)
        gmsh.model.add(name)
        yield gmsh
    finally:
        gmsh.finalize()


def plate_with_hole(path: Path) -> None:
    """Plane, z = 0."""
    with gmsh_model("plate-with-hole", MeshSizeMax=0.015, MeshSizeFromCurvature=24, MshFileVersion=2.2) as gmsh:
        occ, model = gmsh.model.occ, gmsh.model
        plate, _ = occ.cut([(2, occ.addRectangle(0, 0, 0, 0.4, 0.2))], [(2, occ.addDisk(0.2, 0.1, 0, 0.04, 0.04))])
        occ.synchronize()
        middles = {tag: occ.getCenterOfMass(1, tag) for _, tag in model.getEntities(1)}
        model.addPhysicalGroup(2, [tag for _, tag in plate], name="plate")
        model.addPhysicalGroup(1, [tag for tag, x in middles.items() if x[0] < 1e-6], name="clamp")
        model.addPhysicalGroup(1, [tag for tag, x in middles.items() if x[0] > 0.4 - 1e-6], name="tip")
        model.addPhysicalGroup(1, [tag for tag in middles if model.getType(1, tag) in ("Circle", "Ellipse")], name="hole")
        model.mesh.generate(2)
        gmsh.write(str(path))


def bracket(path: Path) -> None:
    """The foot in the plane z = 0, the upright leg at x = 0, holes of radius 0.006 in the foot."""
    options = {"MeshSizeMax": 0.014, "MeshSizeFromCurvature": 8, "MshFileVersion": 4.1, "ElementOrder": 2, "HighOrderOptimize": 2}
    with gmsh_model("bracket", **options) as gmsh:
        occ, model = gmsh.model.occ, gmsh.model
        body, _ = occ.fuse([(3, occ.addBox(0, 0, 0, 0.12, 0.08, 0.01))], [(3, occ.addBox(0, 0, 0, 0.01, 0.08, 0.11))])
        holes = [(3, occ.addCylinder(x, y, -0.01, 0, 0, 0.03, 0.006)) for x in (0.05, 0.1) for y in (0.02, 0.06)]
        body, _ = occ.cut(body, holes)
        occ.synchronize()
        surfaces = [tag for _, tag in model.getEntities(2)]
        model.addPhysicalGroup(3, [tag for _, tag in body], name="bracket")
        model.addPhysicalGroup(2, [tag for tag in surfaces if model.getType(2, tag) == "Cylinder"], name="bolts")
        model.addPhysicalGroup(2, [tag for tag in surfaces if occ.getCenterOfMass(2, tag)[2] > 0.11 - 1e-6], name="tip")
        model.mesh.generate(3)
        gmsh.write(str(path))


def main(names: tuple[str, ...] = (), *, out: Path = MESHES) -> int:
    made: dict[str, Callable[[Path], object]] = {
        "beam.inp": lambda path: fs.write_mesh(path, beam()), "disc.vtu": lambda path: fs.write_mesh(path, disc()),
        "plate-with-hole.msh": plate_with_hole, "bracket.msh": bracket}
    if strange := set(names) - set(made):
        raise UsageError(f"unknown: {', '.join(sorted(strange))}; there are {', '.join(made)}")
    out.mkdir(parents=True, exist_ok=True)
    for name in names or made:
        path = out / name
        try:
            made[name](path)
        except (ImportError, OSError) as error:
            if name.endswith(".msh"):
                print(f"{name} needs Gmsh ({error}): {installed_by('gmsh')}", file=sys.stderr)
                return 1
            raise
        print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB, {fs.read_mesh(path)!r}")
    return 0
