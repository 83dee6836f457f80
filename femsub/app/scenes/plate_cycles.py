"""Limit cycles of a plate under a belt: reduced models by harmonic balance and in time, the full model by harmonic balance."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from femsub.app.scene import Progress, Result
from femsub.app.scenes.component import Work
from femsub.app.scenes.cycle_keys import CycleKeys, run_cycles
from femsub.app.scenes.plate import PlateScene
from femsub.studies import span


@dataclass(frozen=True)
class PlateCycleScene(CycleKeys, PlateScene):
    """Limit cycles of a plate under a belt, over the normal force. Of several `modes` the largest serves.

    The full model's cycles are solved for the harmonics of the contact alone, each from that of a reduced model, at a few values
    of the force; their stability is not computed.
    """

    parameter: str = "force"
    families: int = 1
    modes: list[int] = field(default_factory=lambda: [20])
    force: float = 60.0
    points: int = 60
    dots: int = 2
    periods: int = 8
    dots_from: str = "cycle"

    OUTPUTS: ClassVar[tuple[str, ...]] = ("cycles", "branches")


SCENE = PlateCycleScene


def run(scene: PlateCycleScene, progress: Progress) -> Result:
    """Computes what `scene.outputs` names, and nothing else."""
    work = Work(scene, progress)
    most = max(scene.modes)
    models = {**{method.key: rom for method, rom in work.reduced if method.modes == most}, "full": work.sub}
    band, rule = work.band
    head = (f"{scene.name}: {work.sub!r}\n{scene.friction_words}; "
            f"{scene.labels} with {most} modes; band {span(band)} ({rule})")
    data = {"model": repr(work.sub), "size": work.sub.size, "modes_kept": most, "band_rule": rule}
    return run_cycles(scene, models, band, data, head, progress)
