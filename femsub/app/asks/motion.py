"""Motion in time of the full and the reduced models: signals, spectra, growth rates, and criteria of quality."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.asks import WHICH, Ask, check_place
from femsub.app.kinds import key
from femsub.app.result import NEVER, Remark, Result, Table, Verdict, column, label, named, sentence
from femsub.checks import InputError, Interruptible

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Known, Models
    from femsub.motion import Track

SHOW = ("growth", "quality", "signals", "spectrum", "spectrogram")


@dataclass(frozen=True)
class MotionAsk(Ask):
    """The motion of each model under its contacts, from its own steady sliding after a blow on a port."""

    motion: list[float] = key([], "the time, [from, to]", unit="time", form="[from, to]", required=True, example=[0.0, 500.0])
    in_periods: bool = key(False, "whether times are in periods of the mode that grows fastest in the largest model of the last "
                           "method")
    window: list[float] = key([], "the time whose amplitude and spectrum are shown", unit="time", form="[from, to]",
                              otherwise="the last quarter")
    step: float = key(0.0, "time step of the recorded values; with in_periods a fraction of a period", unit="time", least=0,
                      otherwise="for some 20,000 points, or 40 per period")
    impulse: float = key(1e-3, "the blow on the first port under a contact with which each model leaves its sliding equilibrium",
                         unit="force·time")
    observe: str = key("", "the place whose velocity is shown, 'part.port'", otherwise="the first port under a contact")
    length: float = key(0.0, "length of the spectrogram's window", unit="time", least=0,
                        otherwise="a fiftieth of the time, but at least ten periods of the strongest frequency")
    tol: float = key(1e-7, "error control of the integration (femsub.transient)", above=0)
    models: str = key("all", "the models: 'full', 'reduced', 'all' or 'best'", choices=lambda _: WHICH)
    show: list[str] = key(["signals", "spectrum", "spectrogram"], "output beside the table; 'growth' (in time, beside Re λ) and "
                          "'quality' (criteria) need all eigenvalues of each model", choices=lambda _: SHOW)

    KIND: ClassVar[str] = "motion"
    NEEDS: ClassVar[tuple[str, ...]] = ("contact",)
    NONLINEAR: ClassVar[bool] = True

    def check(self, scene: Scene) -> None:
        super().check(scene)
        if self.observe:
            check_place(scene, self.observe)
        elif not any(one.places for one in scene.contacts.values()):
            raise InputError("observe is missing: no contact acts on a port, so name the place 'part.port' whose velocity is "
                             "shown")
        if self.window and (self.window[0] < self.motion[0] or self.window[1] > self.motion[1]):
            raise InputError(f"window {self.window} reaches beyond the time {self.motion}")

    def run(self, models: Models) -> Result:
        tracks: list[Track] = []
        rows: list[dict[str, Any]] = []
        with Interruptible() as work:
            for one in models.chosen(self.models):
                run, window, _ = self.long_run(models, one)
                tracks.append(run.seen(self.place(models), window, one.kind))
                rows.append(fs.motion.motion_row(tracks[-1], self.place(models)))
                run.whole()
        place = self.observe or models.places[0]
        columns = ["model", "size", "rms", column("peaks", "peaks (rad/time)", ".5g", unit="rad/time",
                                                  cell=lambda row: None if row["peaks"] is None else row["peaks"][:3].tolist()),
                   "sticking", "energy_residual", "seconds",
                   column("complete", form="s", cell=lambda row: "yes" if row["complete"] else f"to t = {row['end']:.5g}")]
        seen = [f"{named(row['model'], row['size'])}: rms {row['rms']:.5g}, strongest at {row['peaks'][0]:.5g} rad/time."
                for row in rows if row["rms"] is not None and len(row["peaks"])]
        seen += [f"{named(row['model'], row['size'])} moves most above its cut-off, {row['cutoff']:.5g} rad/time. This motion is "
                 "an artefact of reduction; take more modes." for row in rows if row["peaks"] is not None and len(row["peaks"])
                 and row["peaks"][0] > row["cutoff"]]
        shown: list[Any] = [
            f"Velocity at {place}, from a blow of {self.impulse:g}", Table(
                "motion", rows, columns, "Models in time", 2, "the run, or its window, was too short"),
            Verdict(seen, [NEVER, "Where several motions exist, another start may end in another one. One trajectory does not "
                           "show it."],
                    headline="The models are compared in time, each by one trajectory. No tolerance is set, so the figures below "
                    "are yours to judge.")]
        found = Result({"motion": {"models": rows}} | ({} if work.complete else {"complete": False}), shown)
        for name in self.show:
            models.say(f"motion, {name}")
            part: Result = getattr(self, name)(models, tracks)
            apart = [""] * any(isinstance(one, str) for one in part.shown)
            found = Result(found.data | part.data, [*found.shown, *apart, *part.shown])
        return found

    def place(self, models: Models) -> str:
        """The name in the model of the port that is observed."""
        return models.port(self.observe) if self.observe else models.places[0]

    def long_run(self, models: Models, one: Known) -> tuple[fs.Transient, tuple[float, float], float]:
        """(run, window, unit of time) of a model."""
        unit = self.unit(models) if self.in_periods else 1.0
        start, end = self.motion[0] * unit, self.motion[1] * unit
        step = self.step * unit or (unit / 40 if self.in_periods else (end - start) / 20_000)
        place, ports = self.place(models), [name for contact in models.contacts for name in contact.ports]
        window = (self.window[0] * unit, self.window[1] * unit) if self.window else (0.25 * start + 0.75 * end, end)

        def run() -> fs.Transient:
            return fs.transient(one.model, models.contacts, (start, end), impulse=self.impulse, step=step, tol=self.tol,
                                ports=[] if place in ports else [place],
                                progress=lambda text: models.say(f"{label(one.kind)}, {text}"))

        at = "motion", id(one.model), repr(models.contacts), start, end, step, self.tol, self.impulse, place
        return models.kept(at, run), window, unit

    def unit(self, models: Models) -> float:
        """The period of the mode that grows fastest."""
        reference = models.best
        modes = models.spectrum(reference)
        at = modes.fastest
        if at is None:
            raise InputError(f"nothing grows: {reference.model!r} is stable below its cut-off under {models.contacts!r}; take a "
                             "larger force, less damping or another speed")
        return float(2 * np.pi / modes.eigenvalues[at].imag)

    def growth(self, models: Models, tracks: Sequence[Track], faint: float = 1e-6) -> Result:
        """Growth rate of the most unstable mode below a model's cut-off, measured in time.

        The motion starts with `faint` times the belt's speed.
        """
        rows, speed = list[dict[str, Any]](), abs(next((item.speed for item in tracks if item.speed), 1.0))
        with Interruptible() as work:
            for one in models.chosen("reduced" if self.models == "best" else self.models):
                modes = models.spectrum(one)
                above = float(modes.eigenvalues[modes.above_cutoff].real.max()) if modes.above_cutoff.any() else None
                rows.append({"model": one.kind, "size": one.model.size, **fs.motion.growth_in_time(
                    one.model, models.contacts, modes, self.place(models), speed, faint), "above": above})
        columns = ["model", "size", column("growth", "growth in time", ".5g"), column("growth_of_cea", "Re λ", ".5g"),
                   column("error", "error", ".0e"), column("omega", "ω in time", ".5g"),
                   column("omega_of_cea", "Im λ", ".5g", unit="rad/time"), column("above", "Re λ above cut-off", ".5g")]
        head = f"Growth of the most unstable mode below the cut-off, from {faint:g} of the belt's speed"
        if any(row["above"] is not None and row["above"] > (row["growth_of_cea"] or 0.0) for row in rows):
            head += "; where a mode above the cut-off (the reduction's own) grows faster, it takes over"
        return Result({"motion-growth": rows} | ({} if work.complete else {"complete": False}), [head, Table(
            "motion-growth", rows, columns, "Growth in time", 2, "no mode grows below the cut-off, or none lies above it")])

    def signals(self, models: Models, tracks: Sequence[Track]) -> Result:
        """Velocities over the whole run, and over its last ten periods."""
        return Result({}, [fs.motion.signals_chart(tracks)] * any(len(item.run.t) > 1 for item in tracks))

    def spectrum(self, models: Models, tracks: Sequence[Track]) -> Result:
        """Spectra in the window."""
        known = [item for item in tracks if item.spectrum is not None]
        rows = [{"model": item.kind, "size": item.size, "omega": at, "amplitude": height} for item in known
                for at, height in zip(item.peaks, item.spectrum.heights, strict=True)]  # type: ignore[union-attr]
        return Result({"motion-spectrum": rows}, [Table("motion-spectrum", rows, title="Peaks of the spectra"), *(
            [fs.motion.spectra_chart(known, fs.motion.highest(tracks))] if known else [])])

    def spectrogram(self, models: Models, tracks: Sequence[Track]) -> Result:
        """Short-time spectra of the whole runs, with one colour scale."""
        unit = self.unit(models) if self.in_periods else 1.0
        whole_time = (self.motion[1] - self.motion[0]) * unit
        lowest = min((item.peaks[0] for item in tracks if len(item.peaks)), default=np.inf)
        length = self.length * unit or max(whole_time / 50, min(20 * np.pi / lowest, whole_time / 4))
        made, rows = fs.motion.spectrograms(tracks, length)
        return Result({"motion-spectrogram": {"length": length, "strongest": rows}}, [
            Table("motion-spectrogram", rows, title="Strongest frequency over time"),
            *([fs.motion.spectrogram_chart([(item.name, found) for item, found in made], fs.motion.highest(tracks))]
              if made else [])])

    def quality(self, models: Models, tracks: Sequence[Track]) -> Result:
        """Criteria from linear data for each reduced model, beside the errors of its strongest frequency and of its rms.

        These errors are from one trajectory per model. If several motions coexist, models may have reached different ones, see
        docs/guide/motion.md.
        """
        known = [item for item in tracks if len(item.peaks)]
        if not known or known[0].kind != "full":
            return Result({"motion-quality": []})
        exact, reduced = known[0], known[1:]
        rms = [fs.rms(item.run.t, item.v, item.window) for item in known]
        measured = [{"model": item.kind, "error_frequency": fs.modes.relative_error(item.peaks[0], exact.peaks[0]),
                     "error_amplitude": fs.modes.relative_error(own, rms[0])} for item, own in zip(reduced, rms[1:], strict=True)]
        rows = fs.motion.table_rows(exact.model, [item.model for item in reduced], models.contacts, measured)
        columns = ["model", "size", column("missing_share", "missing", ".0%"), column("spurious_share", "spurious", ".0%"),
                   column("growth_error", "err Re λ", ".1%"), column("projection_loss", "loss", ".1%"),
                   column("compliance_mean", "compliance", ".1%"), column("error_frequency", "err ω in time", ".1%"),
                   column("error_amplitude", "err rms", ".1%")]
        return Result({"motion-quality": rows}, [
            "Quality of the reduced models under self-excitation, from linear data, beside this run's errors",
            Table("motion-quality", rows, columns, "Quality under self-excitation"),
            *(f"{label(row['model'])}: {row['verdict']}" for row in rows),
            Remark([sentence(row["verdict"], named(row["model"], row["size"])) for row in rows])])
