"""Makes the meshes in meshes/.

Lengths are in m; each comes out the same whenever it is made (Gmsh: with the same version).

    python -m benchmarks make-meshes [--out DIR] [--size METRES] [NAME ...]

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
brake-disc.vtu                hexahedron20   hub (held), inboard and outboard (the tracks, z = -0.006 and 0.006), rim
  friction ring of radii 0.083 and 0.15,     group: disc
  0.012 thick, on a hat of radius 0.083
brake-inboard.vtu             hexahedron20   face (on the disc), back, leading and trailing (the plate's ends)
brake-outboard.vtu                           groups: lining (0.011 thick, 60°), plate (0.005 thick, 66°)
============================  =============  =================================================================

The brake's parts have a common frame, with the axis along z. Their elements are some 0.025 long, or --size; the pads' are 0.8 of
that, so that their faces do not match the disc's. --size 0.0035 makes 477,000 DOF, 0.0033 makes 617,000. All nodes lie on circles
about the axis, in the middle of edges as well, which a disc that turns needs.

Two come from elsewhere: disc-with-pad.msh by `gmsh -3 -nt 1 disc-with-pad.geo`, calculix/ by CalculiX 2.20 from its
beam.inp.

beam and disc need femsub alone; the others need Gmsh: pip install gmsh (made with 4.15.2), and its libraries
(Debian: libglu1-mesa libxrender1 libxcursor1 libxft2 libxinerama1).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import femsub as fs
from femsub.checks import installed_by
from femsub.components.solid_elements import reference


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


Span = tuple[float, float]
Block = tuple[Span, Span, Span]  # of radius, of angle in degrees, of z

RING, TRACK, RIM, WALL, HUB = 0.083, 0.095, 0.15, 0.075, 0.035  # radii of the brake's disc
HALF, HAT, TOP = 0.006, 0.036, 0.044  # its heights: of the ring, below and above the flange
LINING, PLATE = (0.098, 0.142), (0.094, 0.146)  # radii of a pad
DEPTHS = HALF, 0.017, 0.022  # distances of a lining's and a plate's faces from the disc's middle plane


def brake_disc(size: float) -> fs.Mesh:
    """A friction ring on a hat with a flange, which is held at its inner rim."""
    section = [((RING, TRACK), (-HALF, HALF)), ((TRACK, 0.145), (-HALF, HALF)), ((0.145, RIM), (-HALF, HALF)),
               ((WALL, RING), (-HALF, HALF)), ((WALL, RING), (HALF, HAT)), ((WALL, RING), (HAT, TOP)), ((HUB, WALL), (HAT, TOP))]
    blocks: list[Block] = [(r, (90.0 * quarter, 90.0 * quarter + 90.0), z) for r, z in section for quarter in range(4)]
    mesh = bricks("brake-disc", {"disc": blocks}, size)
    radius, z = np.hypot(mesh.points[:, 0], mesh.points[:, 1]), mesh.points[:, 2]
    track = (radius > TRACK - 1e-9) & (radius < 0.145 + 1e-9)
    return mesh.with_sets(hub=radius < HUB + 1e-9, rim=radius > RIM - 1e-9, inboard=track & (z < -HALF + 1e-9),
                          outboard=track & (np.abs(z - HALF) < 1e-9))


def brake_pad(name: str, side: int, size: float) -> fs.Mesh:
    """A lining under a back plate, on the side of the disc where z has this sign."""
    heights: list[Span] = [(min(side * low, side * high), max(side * low, side * high))
                           for low, high in pairwise(DEPTHS)]
    radii = [(PLATE[0], LINING[0]), LINING, (LINING[1], PLATE[1])]
    angles = [(-33.0, -30.0), (-30.0, 30.0), (30.0, 33.0)]
    mesh = bricks(name, {"lining": [(LINING, angles[1], heights[0])],
                         "plate": [(r, angle, heights[1]) for r in radii for angle in angles]}, 0.8 * size)
    angle, depth = np.degrees(np.arctan2(mesh.points[:, 1], mesh.points[:, 0])), side * mesh.points[:, 2]
    return mesh.with_sets(face=depth < HALF + 1e-9, back=depth > DEPTHS[2] - 1e-9, leading=angle < -33 + 1e-6,
                          trailing=angle > 33 - 1e-6)


def bricks(name: str, groups: dict[str, list[Block]], size: float) -> fs.Mesh:
    """Blocks of a body around the z axis, joined and cut into bricks of 20 nodes with edges of about `size`."""
    with gmsh_model(name, MeshSizeMax=1.0, ElementOrder=2, SecondOrderIncomplete=1, MshFileVersion=4.1) as gmsh:
        occ, model = gmsh.model.occ, gmsh.model
        volumes, owners = [], []
        for group, blocks in groups.items():
            for (r, outer), (start, end), (z, top) in blocks:
                corners = [occ.addPoint(x, 0, y) for x, y in ((r, z), (outer, z), (outer, top), (r, top))]
                edges = [occ.addLine(one, other) for one, other in zip(corners, corners[1:] + corners[:1], strict=True)]
                side = (2, occ.addPlaneSurface([occ.addCurveLoop(edges)]))
                occ.rotate([side], 0, 0, 0, 0, 0, 1, np.radians(start))
                volumes += [one for one in occ.revolve([side], 0, 0, 0, 0, 0, 1, np.radians(end - start)) if one[0] == 3]
                owners.append(group)
        _, pieces = occ.fragment(volumes, [])
        occ.synchronize()
        for group in groups:
            model.addPhysicalGroup(3, [tag for owner, found in zip(owners, pieces[:len(owners)], strict=True) if owner == group
                                       for _, tag in found], name=group)
        for _, curve in model.getEntities(1):
            low, high = (bound[0] for bound in model.getParametrizationBounds(1, curve))
            length = (high - low) * (RING + RIM) / 2 if model.getType(1, curve) == "Circle" else occ.getMass(1, curve)
            model.mesh.setTransfiniteCurve(curve, max(1, round(length / size)) + 1)
        for _, surface in model.getEntities(2):
            model.mesh.setTransfiniteSurface(surface)
            model.mesh.setRecombine(2, surface)
        for _, volume in model.getEntities(3):
            model.mesh.setTransfiniteVolume(volume)
        model.mesh.generate(3)
        with tempfile.TemporaryDirectory() as folder:
            gmsh.write(str(Path(folder) / f"{name}.msh"))
            mesh = fs.read_mesh(Path(folder) / f"{name}.msh", kind="hexahedron20")
    return fs.Mesh(on_circles(mesh), mesh.cells, mesh.kind, groups=mesh.groups, name=name)


def on_circles(mesh: fs.Mesh) -> np.ndarray:
    """The points of bricks of 20 nodes, with nodes in the middle of edges moved to the mean radius of the edges' ends."""
    points = mesh.points.copy()
    for place, ends in enumerate(reference(mesh.kind).middles, start=8):
        across = points[mesh.cells[:, list(ends)], :2]
        middle, radius = across.mean(axis=1), np.linalg.norm(across, axis=2).mean(axis=1)
        points[mesh.cells[:, place], :2] = middle * (radius / np.linalg.norm(middle, axis=1))[:, None]
    return points


def main() -> int:
    made: dict[str, Callable[[Path], object]] = {
        "beam.inp": lambda path: fs.write_mesh(path, beam()), "disc.vtu": lambda path: fs.write_mesh(path, disc()),
        "plate-with-hole.msh": plate_with_hole, "bracket.msh": bracket,
        "brake-disc.vtu": lambda path: fs.write_mesh(path, brake_disc(arguments.size)),
        "brake-inboard.vtu": lambda path: fs.write_mesh(path, brake_pad("brake-inboard", -1, arguments.size)),
        "brake-outboard.vtu": lambda path: fs.write_mesh(path, brake_pad("brake-outboard", 1, arguments.size))}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(made)}; all by default")
    parser.add_argument("--out", default=Path(__file__).resolve().parent.parent / "meshes", type=Path)
    parser.add_argument("--size", default=0.025, type=float, metavar="METRES", help="of the brake's elements; default 0.025")
    arguments = parser.parse_args()
    if set(arguments.names) - set(made):
        parser.error(f"unknown: {', '.join(sorted(set(arguments.names) - set(made)))}; there are {', '.join(made)}")
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in arguments.names or made:
        path = arguments.out / name
        try:
            made[name](path)
        except (ImportError, OSError) as error:
            if name.endswith(".msh") or name.startswith("brake"):
                print(f"{name} needs Gmsh ({error}): {installed_by('gmsh')}", file=sys.stderr)
                return 1
            raise
        print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB, {fs.read_mesh(path)!r}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
