"""A thin plate cut into parts, each reduced, and joined again."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

from femsub import Mesh, couple, cut, plate, read_mesh, rectangle
from femsub.app.keys import key
from femsub.app.scene import Progress, Result, run_outputs
from femsub.app.scenes.joined_parts import JoinedScene, compared
from femsub.app.scenes.parts_shown import chosen_modes, picture
from femsub.errors import InputError

MOST = 1000  # parts


@dataclass(frozen=True)
class PlatePartsScene(JoinedScene):
    """A steel plate of 0.4 m x 0.3 m x 2 mm, clamped along one side, or your own mesh, cut into parts."""

    mesh: str = key("", "a mesh file of triangles or axis-parallel rectangles in a plane z = const, relative to the scene file",
                    otherwise="a rectangle of lengths and elements", example="plate.msh", file=True)
    lengths: list[float] = key([0.4, 0.3], "the rectangle's sides", unit="m", above=0, form="[x, y]")
    elements: list[int] = key([24, 18], "numbers of cells along the rectangle's sides", least=1, form="[x, y]")
    cells: str = key("quad", "the rectangle's cells", choices=lambda _: ("quad", "triangle"))
    parts: int = key(8, "the number of parts, chosen so that they share little", least=2, most=MOST)
    sets: list[str] = key([], "instead of parts: groups of cells of the mesh, each of which is a part", otherwise="parts",
                          example=["left-half", "right-half"])
    E: float = key(2.1e11, "Young's modulus", unit="Pa", above=0)
    nu: float = key(0.3, "Poisson's ratio", above=-1, below=0.5)
    rho: float = key(7850.0, "density", unit="kg/m³", above=0)
    thickness: float = key(0.002, "the plate's thickness", unit="m", above=0)
    clamped: list[str] = key(["left"], "sets of nodes that are clamped")
    simply_supported: list[str] = key([], "sets of nodes that are simply supported", otherwise="none", example=["edge"])
    contact: str | list[float] = key("", "the belt's place: a set of nodes, or [x, y] of a node; the belt rubs along w", unit="m",
                                     form="[x, y]", required_with="mesh", otherwise="[3/4, 2/3] of the rectangle's sides",
                                     example="contact")
    rayleigh: list[float] = key([5.0, 1e-6], "[alpha, beta] of the damping D = αM + βK", unit="1/s, s", form="[alpha, beta]")
    force: float = 30.0
    methods: list[str] = field(default_factory=lambda: ["craig-bampton", "craig-chang", "rubin", "guyan"])
    modes: list[int] = field(default_factory=lambda: [2, 4])
    ports: bool = True
    repeats: int = 3
    band: list[float] = key([0.0, 3000.0], "the frequencies in which models are compared", unit="rad/s", least=0, form="[lo, hi]")
    folder: str = "."

    OUTPUTS: ClassVar[tuple[str, ...]] = ("parts", "methods", "modes-per-part")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sets and not self.mesh:
            raise InputError("sets are groups of cells of a mesh file, but mesh is not given. Give parts for the rectangle")
        if not self.mesh and not self.contact:
            object.__setattr__(self, "contact", [0.75 * self.lengths[0], 2 / 3 * self.lengths[1]])

    def model(self) -> Mesh:
        """The mesh of the whole plate."""
        return read_mesh(Path(self.folder) / self.mesh) if self.mesh else rectangle(self.lengths, self.elements, self.cells,
                                                                                   name=self.name)


SCENE = PlatePartsScene


def run(scene: PlatePartsScene, progress: Progress) -> Result:
    """The parts in colours, the study over methods, and how many modes each part needs."""
    progress(f"{scene.name}: cutting the plate")
    supports = dict.fromkeys(scene.simply_supported, "simply supported") | dict.fromkeys(scene.clamped, "clamped")
    pieces = cut(scene.model(), plate, into=None if scene.sets else scene.parts, sets=scene.sets or None, E=scene.E, nu=scene.nu,
                 rho=scene.rho, thickness=scene.thickness, supports=supports, ports={"belt": scene.contact},
                 rayleigh=(scene.rayleigh[0], scene.rayleigh[1]))
    system = couple(pieces.parts, pieces.joints, scene.name)
    belt = replace(scene.linear_belt, port=next(iter(system.ports)))
    title = f"{scene.name}: {system.size} DOF in {len(pieces.parts)} parts"

    def compute(output: str) -> Result:
        if output == "parts":
            return picture(pieces.meshes, title)
        if output == "methods":
            return compared(scene, system, belt, scene.name, output, progress)
        return chosen_modes(scene, system, output, progress)

    return run_outputs(scene.outputs, compute, {"band": scene.band, **scene.friction}, [f"{pieces!r}, {scene.friction_words}"])
