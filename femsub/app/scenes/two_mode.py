"""Hoffmann's two modes coupled by friction: where they coalesce, with and without damping."""

from __future__ import annotations

from dataclasses import dataclass

from femsub.app.keys import key
from femsub.app.scene import Progress, Result
from femsub.app.scenes.flutter import Flutter, FlutterScene
from femsub.components import two_mode, two_mode_critical


@dataclass(frozen=True)
class TwoModeScene(FlutterScene):
    """Hoffmann's model of two modes that friction couples, over the coefficient of friction."""

    damping: list[float] = key([0.0, 0.05], "dashpots d1 along the belt, one model for each", least=0, distinct=True,
                               unit="√(mass force/length)")
    ratio: float = key(2.0, "d2 / d1, the dashpot across the belt", least=0)
    between: list[float] = key([0.0, 1.5], "the range of the coefficient of friction", form="[lo, hi]")


SCENE = TwoModeScene


def run(scene: TwoModeScene, progress: Progress) -> Result:
    """Computes what `scene.outputs` names, and nothing else."""
    pairs = {f"d1 = {d:g}, d2 = {scene.ratio * d:g}": (d, scene.ratio * d) for d in scene.damping}
    exact = {name: two_mode_critical(pair) for name, pair in pairs.items()}
    flutter = Flutter(scene, progress, {name: two_mode(pair) for name, pair in pairs.items()}, "mu", exact, "μ", unit="-")
    return flutter.run({"damping": scene.damping, "ratio": scene.ratio})
