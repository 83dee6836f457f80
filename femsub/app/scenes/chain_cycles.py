"""Limit cycles of the paper's chain: full and reduced models, by harmonic balance, with branches and transients."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from femsub.app.keys import key
from femsub.app.scene import Progress, Result
from femsub.app.scenes.chain import ChainScene
from femsub.app.scenes.cycle_keys import CycleKeys, run_cycles


@dataclass(frozen=True)
class ChainCycleScene(CycleKeys, ChainScene):
    """Limit cycles of the paper's chain and of its reduced models."""

    band: list[float] = key([], "holds the frequencies of the modes whose cycles are sought", unit="rad/time", least=0,
                            form="[lo, hi]", otherwise="the four lowest modes of the paper's chain")

    OUTPUTS: ClassVar[tuple[str, ...]] = ("cycles", "branches")

    def __post_init__(self) -> None:
        if not self.band:
            from femsub import chain_frequencies

            lowest = chain_frequencies(max(self.n, 1), min(max(self.n, 1), 4))
            self.put(band=[0.0, float(1.02 * lowest[-1])])
        super().__post_init__()


SCENE = ChainCycleScene


def run(scene: ChainCycleScene, progress: Progress) -> Result:
    """Computes what `scene.outputs` names, and nothing else."""
    full = scene.model(scene.belt, False)
    models = {"full": full, **{method: scene.reduced(full, method, scene.size) for method in scene.methods}}
    head = f"{scene.words}, belt under m{scene.belt}, {scene.friction_words}; {scene.labels} of {scene.size} DOF"
    data = {"n": scene.n, "damping": scene.damping, "belt": scene.belt, "interface": scene.interface, "size": scene.size}
    return run_cycles(scene, models, (scene.band[0], scene.band[1]), data, head, progress)
