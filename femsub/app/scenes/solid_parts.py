"""A bolted and glued assembly of eight solids whose meshes do not match."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from femsub import Material, Mesh, Spring, Substructure, Tied, block, couple, solid
from femsub.app.keys import key
from femsub.app.scene import Progress, Result
from femsub.app.scenes.joined_parts import MeshedScene
from femsub.checks import Array

#: name: (lengths, place of the corner nearest to the origin, bricks along x, y, z), in m
PIECES = {
    "base": ((0.30, 0.20, 0.020), (0.0, 0.0, 0.0), (4, 2, 1)),
    "post1": ((0.04, 0.04, 0.060), (0.03, 0.03, 0.020), (2, 2, 3)),
    "post2": ((0.04, 0.04, 0.060), (0.23, 0.03, 0.020), (2, 2, 2)),
    "post3": ((0.04, 0.04, 0.060), (0.03, 0.13, 0.020), (2, 2, 3)),
    "post4": ((0.04, 0.04, 0.060), (0.23, 0.13, 0.020), (2, 2, 2)),
    "cover": ((0.30, 0.20, 0.012), (0.0, 0.0, 0.080), (6, 4, 1)),
    "carrier": ((0.10, 0.08, 0.015), (0.10, 0.06, 0.092), (2, 2, 1)),
    "pad": ((0.06, 0.05, 0.010), (0.12, 0.075, 0.107), (3, 3, 1)),
}
POSTS = tuple(name for name in PIECES if name.startswith("post"))
GLUED = (*(("base", post) for post in POSTS), ("cover", "carrier"), ("carrier", "pad"))  # what lies below, and what on it


@dataclass(frozen=True)
class SolidPartsScene(MeshedScene):
    """A steel base, held below, with four posts glued onto it; a cover bolted to the posts; on it, glued, a carrier and a pad.

    The belt slides on the pad. Glue joins surfaces whose meshes do not match. A bolt is a spring between the middle of the post's
    head and the cover.
    """

    fineness: int = key(1, "how many times finer the meshes are along each edge", least=1, most=16)  # 16: some 10 million DOF
    kind: str = key("hexahedron20", "the kind of bricks", choices=lambda _: ("hexahedron", "hexahedron20", "hexahedron27"))
    E: float = key(2.1e11, "Young's modulus", unit="Pa", above=0)
    nu: float = key(0.3, "Poisson's ratio", above=-1, below=0.5)
    rho: float = key(7850.0, "density", unit="kg/m³", above=0)
    bolts: float = key(5e8, "the stiffness of a bolt, along and across", unit="N/m", above=0)
    rayleigh: list[float] = key([5.0, 1e-7], "[alpha, beta] of the damping D = αM + βK", unit="1/s, s", form="[alpha, beta]")
    force: float = 2000.0
    modes: list[int] = field(default_factory=lambda: [5, 10])
    band: list[float] = field(default_factory=lambda: [0.0, 1.2e4])

    def run(self, progress: Progress) -> Result:
        progress(f"{self.name}: making the parts")
        found = meshes(self.fineness, self.kind)
        parts, joints = assembly(found, Material(self.E, self.nu, self.rho), self.bolts, (self.rayleigh[0], self.rayleigh[1]))
        system = couple(parts, joints, self.name)
        head = f"{self.name}: {system.size} DOF in {len(parts)} parts, {len(joints)} joints"
        return self.joined(system, found, head, progress)


def meshes(fineness: int = 1, kind: str = "hexahedron20") -> dict[str, Mesh]:
    """The meshes, each in its place, with the sets through which they are joined."""
    made = {}
    for name, (lengths, corner, bricks) in PIECES.items():
        mesh = block(lengths, [fineness * count for count in bricks], kind, name=name)
        made[name] = replace(mesh, points=mesh.points + np.array(corner))
    for below, above in GLUED:  # the faces of a top that lie below another mesh, if only in part, are a set of its name
        mesh, top = made[below], made[below].sets["top"]
        chosen = np.ones(len(top), dtype=bool)
        for axis in (0, 1):
            places, other = mesh.points[:, axis], made[above].points[:, axis]
            size = float(np.ptp(places[mesh.cells[0]]))  # the edge of the first brick
            lines = np.linspace(places.min(), places.max(), round(np.ptp(places) / size) + 1)
            low = lines[lines <= other.min() + 0.01 * size].max()
            high = lines[lines >= other.max() - 0.01 * size].min()
            chosen &= np.abs(places[top] - (low + high) / 2) <= (high - low) / 2 + 0.01 * size
        made[below] = mesh.with_sets(**{above: top[chosen]})
    for post in POSTS:
        made[post] = made[post].with_sets(head=_nearest(made[post], "top", made[post].points.mean(axis=0)))
        made["cover"] = made["cover"].with_sets(**{post: _nearest(made["cover"], "bottom", made[post].points.mean(axis=0))})
    return made


def _nearest(mesh: Mesh, side: str, place: Array) -> Array:
    """The node of a side that is nearest to an axis along z."""
    return mesh.sets[side][[np.hypot(*(mesh.points[mesh.sets[side]] - place)[:, :2].T).argmin()]]


def assembly(found: dict[str, Mesh], material: Material, bolts: float,
             rayleigh: tuple[float, float] | None = None) -> tuple[dict[str, Substructure], list[Spring | Tied]]:
    """The parts and their joints."""
    joined = {"base": POSTS, **dict.fromkeys(POSTS, ("bottom", "head")), "cover": (*POSTS, "carrier"),
              "carrier": ("bottom", "pad"), "pad": ("bottom",)}
    parts = {name: solid(mesh, material, supports=["bottom"] if name == "base" else [], interface=joined[name], name=name,
                         ports={"belt": ("top", "y")} if name == "pad" else {}, rayleigh=rayleigh)
             for name, mesh in found.items()}
    joints: list[Spring | Tied] = [Tied((above, "bottom"), (below, above), {name: found[name] for name in (below, above)})
                                   for below, above in GLUED]
    return parts, joints + [Spring((post, "head"), ("cover", post), stiffness=bolts) for post in POSTS]
