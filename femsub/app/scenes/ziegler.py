"""Ziegler's pendulum: a little damping lowers the critical load by 30 %."""

from __future__ import annotations

from dataclasses import dataclass

from femsub.app.keys import key
from femsub.app.scene import Progress, Result
from femsub.app.scenes.flutter import Flutter, FlutterScene
from femsub.components import ziegler, ziegler_critical


@dataclass(frozen=True)
class ZieglerScene(FlutterScene):
    """Ziegler's pendulum under a follower load P, in the units m = l = k = 1."""

    damping: list[float] = key([0.0, 0.01, 0.2], "dashpots b in both joints, one model for each", unit="√(m l² k)", least=0,
                               distinct=True)
    between: list[float] = key([0.0, 3.0], "the range of the load", unit="k/l", form="[lo, hi]")


SCENE = ZieglerScene


def run(scene: ZieglerScene, progress: Progress) -> Result:
    """Computes what `scene.outputs` names, and nothing else."""
    models = {f"b = {b:g}": ziegler(b) for b in scene.damping}
    exact = {f"b = {b:g}": ziegler_critical(b) for b in scene.damping}
    return Flutter(scene, progress, models, "P", exact, "P l/k", unit="-").run({"damping": scene.damping})
