"""A thin plate cut into parts, each reduced, and joined again."""

from __future__ import annotations

from dataclasses import dataclass, field

from femsub import couple, cut, plate
from femsub.app.keys import key
from femsub.app.scene import Progress, Result
from femsub.app.scenes.joined_parts import MeshedScene, run_parts
from femsub.app.scenes.plate import PlateKeys
from femsub.errors import InputError


@dataclass(frozen=True)
class PlatePartsScene(MeshedScene, PlateKeys):
    """A steel plate of 0.4 m x 0.3 m x 2 mm, clamped along one side, or your own mesh, cut into parts."""

    elements: list[int] = field(default_factory=lambda: [24, 18])
    parts: int = key(8, "the number of parts, chosen so that they share little", least=2, most=1000)
    sets: list[str] = key([], "instead of parts: groups of cells of the mesh, each of which is a part", otherwise="parts",
                          example=["left-half", "right-half"])
    modes: list[int] = field(default_factory=lambda: [2, 4])
    force: float = 30.0
    band: list[float] = key([0.0, 3000.0], "the frequencies in which models are compared", unit="rad/s", least=0, form="[lo, hi]")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sets and not self.mesh:
            raise InputError("sets are groups of cells of a mesh file, but mesh is not given. Give parts for the rectangle")


SCENE = PlatePartsScene


def run(scene: PlatePartsScene, progress: Progress) -> Result:
    """The parts in colours, the study over methods, and how many modes each part needs."""
    progress(f"{scene.name}: cutting the plate")
    pieces = cut(scene.whole(), plate, into=None if scene.sets else scene.parts, sets=scene.sets or None, **scene.properties)
    return run_parts(scene, couple(pieces.parts, pieces.joints, scene.name), pieces.meshes, repr(pieces), progress)
