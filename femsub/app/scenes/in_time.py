"""Scenes in time: runs of full and reduced models one after the other, what they show, and Ctrl-C."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

import femsub as fs
from femsub import growth_rate, studies, transient
from femsub.algebra import QUADRATIC
from femsub.app.keys import key
from femsub.app.scene import NO_SLOPE, Progress, Result, Run, behind
from femsub.app.scenes.chain import ChainKeys
from femsub.app.scenes.component import ComponentRun
from femsub.app.scenes.solid import SolidScene
from femsub.checks import Interruptible
from femsub.errors import InputError
from femsub.modes import ComplexModes, relative_error
from femsub.motion import Spectrum, project, sliding
from femsub.studies import NEVER, Remark, Table, Verdict, column, label, named, period_chart, sentence


@dataclass(frozen=True)
class Track:
    """One model's run and what is seen of it in the window; None where it was interrupted before there was enough."""

    kind: str  #: 'full', or the method's key
    model: fs.Substructure
    run: fs.Transient
    window: tuple[float, float]
    spectrum: Spectrum | None
    row: dict[str, Any]


def whole(run: fs.Transient) -> fs.Transient:
    """The run, if it went to its end; an interruption goes on to whoever keeps what is done (`Interruptible`)."""
    if not run.complete:
        raise KeyboardInterrupt
    return run


def track(kind: str, model: fs.Substructure, run: fs.Transient, window: tuple[float, float]) -> Track:
    """What a run shows in the window: amplitude, frequencies, sticking."""
    v = run.velocity("belt")
    row: dict[str, Any] = {"model": kind, "size": model.size, "window": list(window), "rms": None, "peaks": None, "heights": None,
                           "sticking": None, "energy_residual": run.energy.residual,
                           "steps": run.effort.steps, "seconds": run.effort.seconds, "end": run.end, "complete": run.complete}
    inside = (run.t >= window[0]) & (run.t <= window[1])
    seen = None
    if run.complete and inside.sum() > 64:
        seen = fs.spectrum(run.t, v, window)
        row |= {"rms": fs.rms(run.t, v, window), "peaks": seen.peaks, "heights": seen.heights,
                "sticking": None if run.contact.without_eps else fs.sticking(run, "belt", window)}
    return Track(kind, model, run, window, seen, row)


def most_unstable(found: ComplexModes) -> int | None:
    """The complex mode below a model's cut-off that grows fastest; None where none grows."""
    at = np.flatnonzero((found.eigenvalues.imag > 0) & ~found.above_cutoff & (found.eigenvalues.real > 0))
    return int(at[found.eigenvalues[at].real.argmax()]) if len(at) else None


def strongest(peaks: Sequence[float] | None) -> list[float] | None:
    """The frequencies of the three largest peaks of a spectrum, which come first in it; None where there is no spectrum."""
    return None if peaks is None else [float(at) for at in peaks[:3]]


@dataclass(eq=False)
class InTime(Run):
    """The outputs of runs in time: `tracks`, and for their growth the models by 'full' or the method's key."""

    belt: fs.Belt
    models: Sequence[tuple[str, fs.Substructure]]
    tracks: Sequence[Track]
    length: float  #: of the window of a spectrogram

    def __post_init__(self) -> None:
        self.known = [item for item in self.tracks if item.spectrum is not None]

    def study(self, first: str, title: str, data: dict[str, Any], complete: bool, long: Sequence[str] = ()) -> Result:
        """What the scene asks for, below what is seen of each run. `complete` and `long` as of `result`.

        Single trajectories decide nothing, but their figures stand side by side.
        """
        columns = ["model", "size", "rms", column("peaks", "peaks (rad/time)", ".5g", unit="rad/time",
                                                  cell=lambda row: strongest(row["peaks"])), "sticking",
                   "energy_residual", "seconds",
                   column("complete", form="s", cell=lambda row: "yes" if row["complete"] else f"to t = {row['end']:.5g}")]
        rows = [item.row for item in self.tracks]
        seen = [f"{named(row['model'], row['size'])}: rms {row['rms']:.5g}, strongest at {row['peaks'][0]:.5g} rad/time."
                for row in rows if row["rms"] is not None and len(row["peaks"])]
        return self.result(data | {"models": rows, "complete": True}, [
            first, "", title, Table("models", rows, columns, "Models in time", 2, "the run, or its window, was too short"),
            Verdict(seen, [NEVER, "Where several motions exist, another start may end in another one. One trajectory does not "
                           "show it."],
                    headline="The models are compared in time, each by one trajectory. No tolerance is set, so the figures below "
                    "are yours to judge.")], complete, long)

    def growth(self, faint: float = 1e-6, still: float = 1e-3) -> Result:
        """Growth of the most unstable complex mode below a model's cut-off, measured in time, beside Re λ.

        `faint` and `still` are shares of the belt's speed: the mode's velocity at the begin, and that up to which it is followed.
        There the model is linear.
        """
        belt, rows = self.belt, list[dict[str, Any]]()
        measured = ("growth", "growth_of_cea", "omega", "omega_of_cea", "error")
        with Interruptible() as work:
            for kind, model in self.models:
                modes = fs.complex_modes(model, belt)
                found = dict.fromkeys(measured)
                if (at := most_unstable(modes)) is not None:  # else too few modes: what grows lies above this model's cut-off
                    # from a velocity `faint` until it should be `still`, and for a dozen periods at least
                    value, shape, speed = complex(modes.eigenvalues[at]), modes.shapes[:, at], abs(belt.speed or 1.0)
                    shape = shape * (faint * speed / max(float(np.abs(model.port("belt").T @ shape * value).max()), 1e-300))
                    start = sliding(model, belt).perturbed(shape.real, (value * shape).real)
                    period = 2 * np.pi / value.imag
                    end = max(np.log(still / faint) / value.real, 12 * period)
                    run = whole(transient(model, belt, (0.0, end), start=start, step=period / 40, tol=1e-10, method="lsoda"))
                    own = growth_rate(run.t, run.velocity("belt"), below=2 * still * speed)
                    found = dict(zip(measured, (own.rate, value.real, own.omega, value.imag, abs(own.rate / value.real - 1)),
                                     strict=True))
                above = float(modes.eigenvalues[modes.above_cutoff].real.max()) if modes.above_cutoff.any() else None
                rows.append({"model": kind, "size": model.size, **found, "above": above})
        columns = ["model", "size", column("growth", "growth in time", ".5g"), column("growth_of_cea", "Re λ", ".5g"),
                   column("error", "error", ".0e"), column("omega", "ω in time", ".5g"),
                   column("omega_of_cea", "Im λ", ".5g", unit="rad/time"), column("above", "Re λ above cut-off", ".5g")]
        head = f"Growth of the most unstable mode below the cut-off, from {faint:g} of the belt's speed"
        if any(row["above"] is not None and row["above"] > (row["growth_of_cea"] or 0.0) for row in rows):
            head += "; where a mode above the cut-off (the reduction's own) grows faster, it takes over"
        return Result({"growth": rows} | ({} if work.complete else {"complete": False}), [head, Table(
            "growth", rows, columns, "Growth in time", 2, "no mode grows below the cut-off, or none lies above it")])

    def signals(self) -> Result:
        """Velocities under the belt: all of the run, and the last ten periods."""
        return Result({}, [studies.signals_chart(self.tracks)] * any(len(item.run.t) > 1 for item in self.tracks))

    @property
    def highest(self) -> float:
        """How far up spectra are drawn: the same for all."""
        tops = [at for item in self.tracks for at in strongest(item.row["peaks"]) or []]
        return 1.3 * max(tops, default=1.0)  # the highest peak stands clear of the edge

    def spectrum(self) -> Result:
        """Spectra in the window."""
        rows = [{"model": item.kind, "size": item.model.size, "omega": at, "amplitude": height} for item in self.known
                for at, height in zip(item.row["peaks"], item.row["heights"], strict=True)]
        return Result({"spectrum": rows}, [Table("spectrum", rows, title="Peaks of the spectra"), *(
            [studies.spectra_chart(self.known, self.highest)] if self.known else [])])

    def spectrogram(self) -> Result:
        """Short-time spectra of the whole runs, on one scale."""
        length = self.length
        made = [(item, fs.spectrogram(item.run.t, item.run.velocity("belt"), length)) for item in self.tracks
                if len(item.run.t) and np.ptp(item.run.t) > 2 * length]
        rows = [{"model": item.kind, "size": item.model.size, "from": float(found.t[at]) - length / 2,
                 "to": float(found.t[at]) + length / 2, "omega": float(found.omega[found.amplitude[:, at].argmax()])}
                for item, found in made for at in range(0, len(found.t), max(1, len(found.t) // 8))]
        return Result({"spectrogram": {"length": length, "strongest": rows}}, [
            Table("spectrogram", rows, title="Strongest frequency over time"),
            studies.spectrogram_chart(made, self.highest)])

    def quality(self) -> Result:
        """Criteria from linear data for each reduced model, beside the error of its strongest frequency and of its rms.

        One trajectory of each: where motions coexist it may have ended in another of them, see docs/guide/motion.md.
        """
        known = [item for item in self.known if len(item.row["peaks"])]
        if not known or known[0].kind != "full":
            return Result({"quality": []})
        exact, reduced = known[0], known[1:]
        measured = [{"model": item.kind, "error_frequency": relative_error(item.row["peaks"][0], exact.row["peaks"][0]),
                     "error_amplitude": relative_error(item.row["rms"], exact.row["rms"])} for item in reduced]
        rows = studies.table_rows(exact.model, [item.model for item in reduced], self.belt, measured)
        columns = ["model", "size", column("missing_share", "missing", ".0%"), column("spurious_share", "spurious", ".0%"),
                   column("growth_error", "err Re λ", ".1%"), column("projection_loss", "loss", ".1%"),
                   column("compliance_mean", "compliance", ".1%"), column("error_frequency", "err ω in time", ".1%"),
                   column("error_amplitude", "err rms", ".1%")]
        return Result({"quality": rows}, [
            "Quality of the reduced models under self-excitation, from linear data, beside this run's errors",
            Table("quality", rows, columns, "Quality under self-excitation"),
            *(f"{label(row['model'])}: {row['verdict']}" for row in rows),
            Remark([sentence(row["verdict"], named(row["model"], row["size"])) for row in rows])])


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

    def run(self, progress: Progress) -> Result:
        belt, full = self.rubbing, self.model(self.belt, self.join_belt)
        window = self.window[0], self.window[1]
        tracks: list[Track] = []
        with Interruptible() as work:
            for kind in ("full", *self.methods):
                model = full if kind == "full" else self.reduced(full, kind, self.size)
                found = transient(model, belt, (self.time[0], self.time[1]), impulse=self.impulse, step=self.step, tol=self.tol,
                                  progress=behind(f"{self.name}: {label(kind)}, ", progress))
                tracks.append(track(kind, model, found, window))
                whole(found)
        data: dict[str, Any] = {
            "n": self.n, "masses": self.masses, "springs": self.springs, "damping": self.damping, "belt": self.belt,
            "interface": [int(dof) + 1 for dof in full.interface], "size": self.size, **self.friction,
            "impulse": self.impulse, "time": self.time, "window": self.window, "step": self.step, "tol": self.tol}
        first = (f"{self.name}: {self.n} masses, belt under m{self.belt} at {self.speed:g}, F = {self.force:g}, {self.law}, ε = "
                 f"{self.eps:g}: μ' = {belt.slope:.6g}; each model from its own sliding equilibrium and a blow of "
                 f"{self.impulse:g}")
        models = [(item.kind, item.model) for item in tracks]
        return InTime(self, progress, belt, models, tracks, self.length).study(
            first, f"Velocity at m{self.belt} over t = {window[0]:g} to {window[1]:g}", data, work.complete)


@dataclass(eq=False)
class SolidTransientRun(InTime):
    """The outputs of the disc: `final` is the state of the largest model, in its own coordinates, at the end of the long run."""

    work: ComponentRun
    final: fs.State
    period: float  #: of the most unstable mode

    def error_time(self) -> Result:
        """Full and reduced models from one physical state: amplitude, its error, and seconds per period."""
        scene, reference, rows = self.scene, self.tracks[0].model, list[dict[str, Any]]()
        assert isinstance(reference, fs.ReducedSubstructure)
        state = [reference.expand(part) for part in (self.final.displacement, self.final.velocity)]
        exact = 0.0
        with Interruptible() as course:
            for kind, modes, model in self.work.models:
                full = kind == "full"
                start = fs.State(*(project(model, self.work.sub.M, part) for part in state)) if isinstance(
                    model, fs.ReducedSubstructure) else fs.State(*state)
                name = f"{label(kind)} with {model.size} DOF"
                runs = [whole(transient(model, self.belt, (0.0, scene.compared * self.period), start=start,
                                        step=self.period / scene.points, tol=scene.full_tol if full else scene.tol,
                                        method="alpha" if full else "lsoda", progress=behind(f"{name}, ", self.say)))
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

    def run(self, progress: Progress) -> Result:
        work, belt = ComponentRun(self, progress), self.rubbing
        kind = work.reduced[-1][0].key
        reference = max((rom for method, rom in reversed(work.reduced) if method.key == kind), key=lambda rom: rom.size)
        modes = fs.complex_modes(reference, belt)
        at = most_unstable(modes)
        if at is None:
            raise InputError(f"nothing grows: {reference!r} is stable below its cut-off at μ' = {belt.slope:.4g} and F = "
                             f"{belt.force:g}; take a larger force, less damping or another speed")
        rate, omega = float(modes.eigenvalues[at].real), float(modes.eigenvalues[at].imag)
        period = 2 * np.pi / omega
        long = transient(reference, belt, (0.0, self.periods * period), impulse=self.impulse, step=period / self.points,
                         tol=self.tol, progress=behind(f"{label(kind)} from the blow, ", work.say))
        # its last quarter has settled
        window = (3 / 4 * long.t[-1], float(long.t[-1])) if long.complete else (0.0, 0.0)
        data: dict[str, Any] = {
            "model": repr(work.sub), "size": work.sub.size, **self.friction, "rayleigh": self.rayleigh, "growth": rate,
            "omega": omega, "period": period, "periods": self.periods, "compared": self.compared, "impulse": self.impulse,
            "tol": self.tol, "full_tol": self.full_tol}
        first = (f"{self.name}: {work.sub!r}\n{self.friction_words}; a mode at {omega:.6g} rad/time grows (Re λ = {rate:.5g})")
        models = [(method.key, rom) for method, rom in work.reduced]
        tracks = [track(kind, reference, long, window)]
        return SolidTransientRun(self, progress, belt, models, tracks, 20 * period, work, long.final, period).study(
            first, f"From a blow of {self.impulse:g} over {self.periods:g} periods", data, long.complete, ["error-time"])
