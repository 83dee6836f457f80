"""The paper's chain cut into parts, each reduced, and joined again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from femsub import couple
from femsub.app.keys import key
from femsub.app.scene import Progress, Result, Run
from femsub.app.scenes.chain import MassKeys
from femsub.app.scenes.joined_parts import JoinedRun, JoinedScene
from femsub.coupling import cut_chain
from femsub.errors import InputError


@dataclass(frozen=True)
class ChainPartsScene(JoinedScene, MassKeys):
    """The paper's chain in several parts. A mass at a cut belongs to both parts, half to each."""

    n: int = key(10, "number of masses", least=3, most=10**6)
    springs: float | list[float] = key(1.0, "the springs: one value, or n of them", unit="force/length", above=0)
    parts: list[int] = key([2, 3, 5], "numbers of parts to cut it into", least=2, distinct=True)
    band: list[float] = key([], "the frequencies in which models are compared", unit="rad/time", least=0, form="[lo, hi]",
                            otherwise="the lowest three of a chain of equal masses and springs", example=[0.0, 0.8])

    OUTPUTS: ClassVar[tuple[str, ...]] = ("methods",)

    def __post_init__(self) -> None:
        self.fill(band=self.three_pairs)
        super().__post_init__()
        if self.belt > self.n:
            raise InputError(f"belt must be at least 1 and at most {self.n}, the number of masses, but is {self.belt}")
        for count in self.parts:
            if count >= self.n:
                raise InputError(f"parts: a chain of {self.n} masses can be cut into {self.n - 1} parts at most, not {count}")


SCENE = ChainPartsScene


class ChainPartsRun(Run):
    """The study over methods for each number of parts."""

    def compute(self, output: str) -> Result:
        scene, count = self.scene, int(output.split()[0])
        parts, joints, port = cut_chain(scene.n, count, scene.belt, scene.damping, masses=scene.masses, springs=scene.springs)
        system = couple(parts, joints, f"{scene.name} in {count}")
        return JoinedRun(scene, self.progress, system, replace(scene.linear_belt, port=port)).compared(
            f"{scene.name} in {count} parts", f"methods-{count}-parts")


def run(scene: ChainPartsScene, progress: Progress) -> Result:
    """The study over methods for each number of parts."""
    data = {"n": scene.n, "belt": scene.belt, "band": scene.band, **scene.friction}
    return ChainPartsRun(scene, progress).result(data, [f"{scene.words}, belt under m{scene.belt}, {scene.friction_words}"],
                                                 outputs=[f"{count} parts" for count in scene.parts])
