"""A beam's answer to a harmonic force at its contact: receptances of full and reduced models, with bounds of the error."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from femsub.app.scenes.beam import BeamScene
from femsub.app.scenes.outputs import run_component


@dataclass(frozen=True)
class FrequencyResponseScene(BeamScene):
    """The steel beam of the scene `beam`, driven at its contact. Other component scenes have this output on request."""

    loss: float = 0.01
    rayleigh: list[float] = field(default_factory=lambda: [0.0, 0.0])
    modes: list[int] = field(default_factory=lambda: [6, 8, 10])

    OUTPUTS: ClassVar[tuple[str, ...]] = ("frequency-response",)
    ON_REQUEST: ClassVar[tuple[str, ...]] = BeamScene.OUTPUTS


SCENE, run = FrequencyResponseScene, run_component
