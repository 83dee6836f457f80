"""A solid component in time: its limit cycle under a belt, full against reduced, and what a simulated period costs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

import numpy as np

from femsub import ReducedSubstructure, State, complex_modes, transient
from femsub.app.keys import key
from femsub.app.scene import NO_SLOPE, Progress, Result
from femsub.app.scenes.component import Work
from femsub.app.scenes.in_time import InTime, found_table, most_unstable, track, verdict, whole
from femsub.app.scenes.solid import SolidScene
from femsub.checks import Interruptible
from femsub.errors import InputError
from femsub.modes import relative_error
from femsub.motion import project
from femsub.studies import Table, column, label, period_chart


@dataclass(frozen=True)
class SolidTransientScene(SolidScene):
    """The component of the scene `solid`, by default a coarse disc with so much damping that its lowest modes alone grow.

    A period is that of the most unstable mode below the cut-off of the largest reduced model of the last method. That model goes
    from a blow on the port to its limit cycle; the state it is in then, expanded, is the physical state from which the full and
    all reduced models (projected) run on, side by side.

    """

    elements: list[int] = field(default_factory=lambda: [3, 24, 1])
    rayleigh: list[float] = field(default_factory=lambda: [5.0, 2e-6])
    force: float = 20000.0
    modes: list[int] = field(default_factory=lambda: [10, 20, 40])
    repeats: int = 5
    impulse: float = key(0.1, "the blow with which the long run begins", unit="kg·m/s")
    periods: float = key(400.0, "of the long run", unit="periods", least=4)
    compared: float = key(12.0, "of the runs side by side; amplitudes are compared over the second half", unit="periods", least=4)
    points: int = key(40, "of the grid that is recorded, per period", least=8)
    tol: float = key(1e-7, "error control of reduced models (femsub.transient)", above=0)
    full_tol: float = key(3e-5, "error control of full models (femsub.transient)", above=0)

    WITHOUT: ClassVar[Mapping[str, str]] = NO_SLOPE
    OUTPUTS: ClassVar[tuple[str, ...]] = ("growth", "error-time", "signals", "spectrum", "spectrogram")


SCENE = SolidTransientScene


@dataclass(eq=False)
class SolidTransientRun(InTime):
    """The outputs of the disc: `final` is the state of the largest model, in its own coordinates, at the end of the long run."""

    work: Work
    final: State
    period: float  #: of the most unstable mode

    def step(self, name: str, text: str) -> None:
        """Reports a step of a model's run."""
        self.say(f"{name}, {text}")

    def error_time(self) -> Result:
        """Full and reduced models from one physical state: amplitude, its error, and seconds per period."""
        scene, reference, rows = self.scene, self.tracks[0].model, list[dict[str, Any]]()
        assert isinstance(reference, ReducedSubstructure)
        state = [reference.expand(part) for part in (self.final.displacement, self.final.velocity)]
        exact = 0.0
        with Interruptible() as course:
            for kind, modes, model in self.work.models:
                full = kind == "full"
                start = State(*(project(model, self.work.sub.M, part) for part in state)) if isinstance(
                    model, ReducedSubstructure) else State(*state)
                name = f"{label(kind)} with {model.size} DOF"
                runs = [whole(transient(model, self.belt, (0.0, scene.compared * self.period), start=start,
                                        step=self.period / scene.points, tol=scene.full_tol if full else scene.tol,
                                        method="alpha" if full else "lsoda", progress=partial(self.step, name)))
                        for _ in range(1 if full else scene.repeats)]
                v = runs[0].velocity("belt")
                amplitude = float(v[len(v) // 2:].std())
                exact = amplitude if full else exact
                seconds = float(np.median([item.effort.seconds for item in runs])) / scene.compared
                rows.append({"model": kind, "modes": modes, "size": model.size, "rms": amplitude,
                             "amplitude_error": relative_error(amplitude, exact), "seconds_per_period": seconds,
                             "speedup": rows[0]["seconds_per_period"] / seconds if rows else 1.0, "steps": runs[0].effort.steps,
                             "energy_residual": runs[0].energy.residual, "method": runs[0].effort.method})
        columns = ["model", "modes", "size", column("rms", form=".6g"), column("amplitude_error", "error", ".1e"),
                   column("seconds_per_period", "s per period", ".2g"), column("speedup", "times faster", ".4g"), "steps",
                   "energy_residual"]
        return Result({"error-time": rows} | ({} if course.complete else {"complete": False}), [
            f"Full and reduced models from one physical state over {scene.compared:g} periods (amplitudes over the second half)",
            Table("error-time", rows, columns, "Error against run time"), *([period_chart(rows)] if len(rows) > 1 else [])])


def run(scene: SolidTransientScene, progress: Progress) -> Result:
    """Computes what `scene.outputs` names, and nothing else."""
    work, belt = Work(scene, progress), scene.rubbing
    kind = work.reduced[-1][0].key
    reference = max((rom for method, rom in reversed(work.reduced) if method.key == kind), key=lambda rom: rom.size)
    modes = complex_modes(reference, belt)
    at = most_unstable(modes)
    if at is None:
        raise InputError(f"nothing grows: {reference!r} is stable below its cut-off at μ' = {belt.slope:.4g} and F = "
                         f"{belt.force:g}; take a larger force, less damping or another speed")
    value = complex(modes.eigenvalues[at])
    rate, omega, period = value.real, value.imag, 2 * np.pi / value.imag
    long = transient(reference, belt, (0.0, scene.periods * period), impulse=scene.impulse, step=period / scene.points,
                     tol=scene.tol, progress=lambda text: work.say(f"{label(kind)} from the blow, {text}"))
    # its last quarter has settled
    window = (3 / 4 * long.t[-1], float(long.t[-1])) if long.complete else (0.0, 0.0)
    tracks = [track(kind, reference, long, window)]
    data: dict[str, Any] = {
        "model": repr(work.sub), "size": work.sub.size, **scene.friction, "rayleigh": scene.rayleigh,
        "growth": rate, "omega": omega, "period": period, "periods": scene.periods, "compared": scene.compared,
        "impulse": scene.impulse, "tol": scene.tol, "full_tol": scene.full_tol, "models": [item.row for item in tracks],
        "complete": True}
    shown = [f"{scene.name}: {work.sub!r}\n{scene.friction_words}; a mode at {omega:.6g} rad/time grows (Re λ = {rate:.5g})",
             "", f"From a blow of {scene.impulse:g} over {scene.periods:g} periods", found_table(data["models"]), verdict(tracks)]
    models = [(method.key, rom) for method, rom in work.reduced]
    return SolidTransientRun(scene, progress, belt, models, tracks, 20 * period, work, long.final, period).result(
        data, shown, long.complete, ["error-time"])
