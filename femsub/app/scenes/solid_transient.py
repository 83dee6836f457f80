"""A solid component in time: its limit cycle under a belt, full against reduced, and what a simulated period costs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from femsub import Belt, State, complex_modes, transient
from femsub.app.keys import key
from femsub.app.scene import NO_SLOPE, Progress, Result, run_outputs
from femsub.app.scenes.component import Work
from femsub.app.scenes.in_time import found_table, growth, most_unstable, signals, spectra, spectrograms, track, verdict, whole
from femsub.app.scenes.solid import SolidScene
from femsub.checks import Interruptible
from femsub.errors import InputError
from femsub.modes import relative_error
from femsub.motion import project
from femsub.studies import Table, column, label, period_chart

SETTLED = 1 / 4  # of the long run, at its end: where its spectrum is taken

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


def run(scene: SolidTransientScene, progress: Progress) -> Result:
    """Computes what `scene.outputs` names, and nothing else."""
    work, belt = Work(scene, progress), scene.rubbing
    models = [(method.key, rom.modes, rom) for method, rom in work.reduced]
    kind, _, reference = max(reversed(models), key=lambda item: (item[0] == models[-1][0], item[2].size))
    modes = complex_modes(reference, belt)
    at = most_unstable(modes)
    if at is None:
        raise InputError(f"nothing grows: {reference!r} is stable below its cut-off at μ' = {belt.slope:.4g} and F = "
                         f"{belt.force:g}; take a larger force, less damping or another speed")
    value = complex(modes.eigenvalues[at])
    rate, omega, period = value.real, value.imag, 2 * np.pi / value.imag
    step = period / scene.points

    def saying(name: str) -> Callable[[str], None]:
        return lambda text: work.say(f"{name}, {text}")

    long = transient(reference, belt, (0.0, scene.periods * period), impulse=scene.impulse, step=step, tol=scene.tol,
                     progress=saying(f"{label(kind)} from the blow"))
    window = ((1 - SETTLED) * long.t[-1], float(long.t[-1])) if long.complete else (0.0, 0.0)
    tracks = [track(kind, reference, long, window)]
    data: dict[str, Any] = {
        "model": repr(work.sub), "size": work.sub.size, **scene.friction,
        "rayleigh": scene.rayleigh,
        "growth": rate, "omega": omega, "period": period, "periods": scene.periods, "compared": scene.compared,
        "impulse": scene.impulse, "tol": scene.tol, "full_tol": scene.full_tol, "models": [item.row for item in tracks]}
    shown = [f"{scene.name}: {work.sub!r}\n{scene.friction_words}; a mode at {omega:.6g} rad/time grows (Re λ = {rate:.5g})",
            "", f"From a blow of {scene.impulse:g} over {scene.periods:g} periods", found_table(data["models"]), verdict(tracks)]
    views: dict[str, Callable[[], Result]] = {
        "growth": lambda: growth([(kind, rom) for kind, _, rom in models], belt),
        "signals": lambda: signals(tracks), "spectrum": lambda: spectra(tracks),
        "spectrogram": lambda: spectrograms(tracks, 20 * period)}

    def error_time() -> Result:
        state = State(reference.expand(long.final.displacement), reference.expand(long.final.velocity))
        return _error_time(scene, work, belt, state, period, work.models, saying)

    views["error-time"] = error_time
    return run_outputs(scene.outputs, lambda output: views[output](), data | {"complete": True}, shown, long.complete,
                       ["error-time"])


def _error_time(scene: SolidTransientScene, work: Work, belt: Belt, state: State, period: float,
                models: list[tuple[str, int, Any]], saying: Callable[[str], Callable[[str], None]]) -> Result:
    """Full and reduced models from one physical state: amplitude, its error, and seconds per period."""
    rows: list[dict[str, Any]] = []
    exact = 0.0
    with Interruptible() as course:
        for kind, modes, model in models:
            start = state if kind == "full" else State(*(project(model, work.sub.M, part) for part in
                                                         (state.displacement, state.velocity)))
            tol, method, times = (scene.full_tol, "alpha", 1) if kind == "full" else (scene.tol, "lsoda", scene.repeats)
            say = saying(f"{label(kind)} with {model.size} DOF")
            runs = [whole(transient(model, belt, (0.0, scene.compared * period), start=start, step=period / scene.points, tol=tol,
                                    method=method, progress=say)) for _ in range(times)]
            v = runs[0].velocity("belt")
            amplitude = float(v[len(v) // 2:].std())
            exact = amplitude if kind == "full" else exact
            seconds = float(np.median([item.effort.seconds for item in runs])) / scene.compared
            rows.append({"model": kind, "modes": modes, "size": model.size, "rms": amplitude,
                         "amplitude_error": relative_error(amplitude, exact), "seconds_per_period": seconds,
                         "speedup": rows[0]["seconds_per_period"] / seconds if rows else 1.0, "steps": runs[0].effort.steps,
                         "energy_residual": runs[0].energy.residual, "method": runs[0].effort.method})
    columns = ["model", "modes", "size", column("rms", form=".6g"), column("amplitude_error", "error", ".1e"),
               column("seconds_per_period", "s per period", ".2g"), column("speedup", "times faster", ".4g"), "steps",
               "energy_residual"]
    head = f"Full and reduced models from one physical state over {scene.compared:g} periods (amplitudes over the second half)"
    data = {"error-time": rows} | ({} if course.complete else {"complete": False})
    return Result(data, [head, Table("error-time", rows, columns, "Error against run time"),
                         *([period_chart(rows)] if len(rows) > 1 else [])])
