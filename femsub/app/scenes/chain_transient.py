"""The paper's chain in time: full and reduced models from the same blow, what frequencies appear (its Fig. 5)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from femsub import transient
from femsub.algebra import QUADRATIC
from femsub.app.keys import key
from femsub.app.scene import NO_SLOPE, Progress, Result, Shown
from femsub.app.scenes.chain import ChainKeys
from femsub.app.scenes.in_time import InTime, Track, found_table, track, verdict, whole
from femsub.checks import Interruptible
from femsub.errors import InputError
from femsub.studies import label


@dataclass(frozen=True)
class ChainTransientScene(ChainKeys):
    """The paper's chain in time, under the nonlinear belt."""

    join_belt: bool = key(False, "whether the belt's mass joins the interface masses")
    impulse: float = key(1e-3, "the blow on the belt's mass with which each model leaves its own sliding equilibrium",
                         unit="mass·length/time")
    time: list[float] = key([0.0, 20000.0], "of the run", unit="time", form="[from, to]")
    window: list[float] = key([12000.0, 20000.0], "of the part whose amplitude and spectrum are shown", unit="time",
                              form="[from, to]")
    step: float = key(0.2, "of the grid that is recorded", unit="time", above=0)
    length: float = key(400.0, "of the spectrogram's window", unit="time", above=0)
    tol: float = key(1e-9, "error control of the integration (femsub.transient)", above=0)

    WITHOUT: ClassVar[Mapping[str, str]] = NO_SLOPE
    OUTPUTS: ClassVar[tuple[str, ...]] = ("growth", "quality", "signals", "spectrum", "spectrogram")
    PAPER: ClassVar[Mapping[str, str]] = {"spectrogram": "Fig. 5"}

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.window[0] < self.time[0] or self.window[1] > self.time[1]:
            raise InputError(f"window {self.window} reaches beyond the time {self.time}")
        if self.n > QUADRATIC and {"growth", "quality"} & set(self.outputs):
            raise InputError(f"outputs 'growth' and 'quality' need all eigenvalues, which is up to n = {QUADRATIC}; name others")


SCENE = ChainTransientScene


def run(scene: ChainTransientScene, progress: Progress) -> Result:
    """Computes what `scene.outputs` names, and nothing else."""
    belt = scene.rubbing
    full = scene.model(scene.belt, scene.join_belt)
    tracks: list[Track] = []
    window = (scene.window[0], scene.window[1])
    with Interruptible() as work:
        for kind in ("full", *scene.methods):
            def say(text: str, kind: str = kind) -> None:
                progress(f"{scene.name}: {label(kind)}, {text}")

            model = full if kind == "full" else scene.reduced(full, kind, scene.size)
            found = transient(model, belt, (scene.time[0], scene.time[1]), impulse=scene.impulse, step=scene.step, tol=scene.tol,
                              progress=say)
            tracks.append(track(kind, model, found, window))
            whole(found)
    data: dict[str, Any] = {
        "n": scene.n, "masses": scene.masses, "springs": scene.springs,
        "damping": scene.damping, "belt": scene.belt, "interface": [int(dof) + 1 for dof in full.interface], "size": scene.size,
        **scene.friction, "impulse": scene.impulse, "time": scene.time, "window": scene.window, "step": scene.step,
        "tol": scene.tol, "models": [item.row for item in tracks], "complete": True}
    shown: list[Shown] = [
        f"{scene.name}: {scene.n} masses, belt under m{scene.belt} at {scene.speed:g}, F = {scene.force:g}, {scene.law}, ε = "
        f"{scene.eps:g}: μ' = {belt.slope:.6g}; each model from its own sliding equilibrium and a blow of {scene.impulse:g}",
        "", f"Velocity at m{scene.belt} over t = {window[0]:g} to {window[1]:g}", found_table(data["models"]), verdict(tracks)]
    models = [(item.kind, item.model) for item in tracks]
    return InTime(scene, progress, belt, models, tracks, scene.length).result(data, shown, work.complete)
