"""What scenes in time share: runs of full and reduced models one after the other, what they show, and Ctrl-C."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import femsub as fs
from femsub import growth_rate, studies, transient
from femsub.app.figures import spectrogram_figure
from femsub.app.scene import Picture, Progress, Result, Run
from femsub.checks import Interruptible
from femsub.modes import ComplexModes, relative_error
from femsub.motion import Spectrum, sliding
from femsub.studies import NEVER, Remark, Table, Verdict, column, label, named, sentence


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


def found_table(rows: Sequence[dict[str, Any]]) -> Table:
    """The table of what was seen: the rows of tracks."""
    columns = ["model", "size", "rms", column("peaks", "peaks (rad/time)", ".5g", unit="rad/time",
                                              cell=lambda row: strongest(row["peaks"])), "sticking",
               "energy_residual", "seconds",
               column("complete", form="s", cell=lambda row: "yes" if row["complete"] else f"to t = {row['end']:.5g}")]
    return Table("models", rows, columns, "Models in time", 2, "the run, or its window, was too short")


def verdict(tracks: Sequence[Track]) -> Verdict:
    """What single trajectories can decide: nothing, but their figures stand side by side."""
    seen = [(named(item.kind, item.model.size), item.row) for item in tracks]
    return Verdict([f"{name}: rms {row['rms']:.5g}, strongest at {row['peaks'][0]:.5g} rad/time." for name, row in seen
                    if row["rms"] is not None and len(row["peaks"])],
                   [NEVER, "Where several motions exist, another start may end in another one. One trajectory does not show it."],
                   headline="The models are compared in time, each by one trajectory. No tolerance is set, so the figures below "
                   "are yours to judge.")


@dataclass(eq=False)
class InTime(Run):
    """The outputs of runs in time: `tracks`, and for their growth the models by 'full' or the method's key."""

    scene: Any
    progress: Progress
    belt: fs.Belt
    models: Sequence[tuple[str, fs.Substructure]]
    tracks: Sequence[Track]
    length: float  #: of the window of a spectrogram

    def __post_init__(self) -> None:
        super().__init__(self.scene, self.progress)
        self.known = [item for item in self.tracks if item.spectrum is not None]

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
            *[Picture("spectrogram", lambda: spectrogram_figure(made, self.highest))] * bool(made)])

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
