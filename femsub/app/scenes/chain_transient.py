"""The paper's chain in time: full and reduced models from the same blow, what frequencies appear (its Fig. 5)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

from femsub import transient
from femsub.app.figure_style import look
from femsub.app.report import machine
from femsub.app.scene import Progress, Result, run_outputs
from femsub.app.scenes.chain import ChainKeys
from femsub.app.scenes.in_time import Track, growth, quality, signals, spectra, spectrograms, told, track, whole
from femsub.checks import interval
from femsub.errors import InputError
from femsub.linalg.factor import QUADRATIC
from femsub.linalg.timing import Interruptible


@dataclass(frozen=True)
class ChainTransientScene(ChainKeys):
    """The chain of `femsub.chain` under the nonlinear belt.

    Attributes
    ----------
    join_belt : bool
        Whether the belt's mass joins the interface masses.
    impulse : float
        The blow on the belt's mass with which each model leaves its own sliding equilibrium.
    time, window : list of float
        [from, to] of the run, and of the part whose amplitude and spectrum are shown.
    step : float
        Of the grid that is recorded.
    length : float
        Of the spectrogram's window, in time.
    tol : float
        Error control of the integration, see `femsub.transient`.
    """

    join_belt: bool = False
    impulse: float = 1e-3
    time: list[float] = field(default_factory=lambda: [0.0, 20000.0])
    window: list[float] = field(default_factory=lambda: [12000.0, 20000.0])
    step: float = 0.2
    length: float = 400.0
    tol: float = 1e-9

    OUTPUTS: ClassVar[tuple[str, ...]] = ("growth", "quality", "signals", "spectrum", "spectrogram")

    def __post_init__(self) -> None:
        super().__post_init__()
        for key in ("time", "window"):
            interval(key, getattr(self, key))
        if self.window[0] < self.time[0] or self.window[1] > self.time[1]:
            raise InputError(f"window {self.window} reaches beyond the time {self.time}")
        if self.n > QUADRATIC and {"growth", "quality"} & set(self.outputs):
            raise InputError(f"outputs 'growth' and 'quality' need all eigenvalues, which is up to n = {QUADRATIC}; name others")
        _ = self.rubbing  # refuses a slope


SCENE = ChainTransientScene


def run(scene: ChainTransientScene, progress: Progress) -> Result:
    """Computes what `scene.outputs` names, and nothing else."""
    belt = scene.rubbing
    full = scene.model(scene.belt, scene.join_belt)
    tracks: list[Track] = []
    window = (scene.window[0], scene.window[1])
    with Interruptible() as work:
        for kind in ("full", *scene.methods):
            def tell(text: str, kind: str = kind) -> None:
                progress(f"{scene.name}: {look(kind).label}, {text}")

            model = full if kind == "full" else scene.reduced(full, kind, scene.size)
            found = transient(model, belt, (scene.time[0], scene.time[1]), impulse=scene.impulse, step=scene.step, tol=scene.tol,
                              progress=tell)
            tracks.append(track(kind, model, found, window))
            whole(found)
    parts: dict[str, Callable[[], Result]] = {
        "growth": lambda: growth([(item.kind, item.model) for item in tracks], belt),
        "quality": lambda: quality(tracks, belt), "signals": lambda: signals(tracks), "spectrum": lambda: spectra(tracks),
        "spectrogram": lambda: spectrograms(tracks, scene.length)}
    data: dict[str, Any] = {
        "scene": scene.name, "machine": machine(), "n": scene.n, "masses": scene.masses, "springs": scene.springs,
        "damping": scene.damping, "belt": scene.belt, "interface": [int(dof) + 1 for dof in full.interface], "size": scene.size,
        **scene.friction,
        "impulse": scene.impulse, "time": scene.time, "window": scene.window, "step": scene.step, "tol": scene.tol,
        "models": [item.row for item in tracks]}
    text = [f"{scene.name}: {scene.n} masses, belt under m{scene.belt} at {scene.speed:g}, F = {scene.force:g}, {scene.law}, ε = "
            f"{scene.eps:g}: μ' = {belt.slope:.6g}; each model from its own sliding equilibrium and a blow of {scene.impulse:g}",
            f"Velocity at m{scene.belt} over t = {window[0]:g} to {window[1]:g}\n{told(tracks)}"]
    return run_outputs(scene.outputs, lambda output: parts[output](), data | {"complete": True}, text, work.complete)
