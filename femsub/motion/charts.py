"""Charts of motion in time: signals, spectra, spectrograms, errors over run time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.checks import Array
from femsub.output import Chart, Heat, Level, Panel, Series, grouped, hover_of, look

if TYPE_CHECKING:
    from femsub.model import Substructure
    from femsub.motion.signals import Spectrogram, Spectrum
    from femsub.motion.transient import Transient


@dataclass(frozen=True, eq=False)
class Track:
    """A run as shown in charts: the velocity `v` (m,) at a port, and its spectrum in a window of time, None if it is short."""

    kind: str  #: the key of the model, such as 'full'
    run: Transient
    v: Array
    window: tuple[float, float]
    spectrum: Spectrum | None
    speed: float | None  #: the belt's speed, None without a belt

    @property
    def model(self) -> Substructure:
        return self.run.contact.model

    @property
    def size(self) -> int:
        """DOF of the model."""
        return self.model.size

    @property
    def name(self) -> str:
        """The name of the model, with its size."""
        return f"{look(self.kind).label}, {self.size} DOF"

    @property
    def peaks(self) -> Array:
        """The frequencies of the peaks, the highest peak first; empty without a spectrum."""
        return np.zeros(0) if self.spectrum is None else self.spectrum.peaks


def highest(tracks: Sequence[Track], strongest: int = 3) -> float:
    """The highest ω of all spectra in charts: 1.3 times the largest ω of the `strongest` peaks of any run."""
    return 1.3 * max((float(at) for one in tracks for at in one.peaks[:strongest]), default=1.0)


def motion_chart(track: Track, title: str) -> Chart:
    """The velocity over the whole run and in its last periods, and its spectrum."""
    known = [track] * (track.spectrum is not None)
    signals, spectra = signals_chart([track]), spectra_chart(known, highest(known)) if known else None
    panels = [*signals.panels, *(replace(one, title="spectrum") for one in (spectra.panels if spectra else ()))]
    return replace(signals, name="motion", title=title, panels=panels, across=len(panels), width=1.25, height=2.6)


def spectrum_chart(found: Spectrum, title: str) -> Chart:
    """The amplitude over ω, with marks at its peaks."""
    return Chart("spectrum", title, [_spectrum(found, "", "amplitude", 1.3 * float(max(found.peaks[:3], default=found.omega[-1])),
                                               float(found.amplitude.max()), 4)], width=0.8)


def signals_chart(tracks: Sequence[Track], periods: int = 10) -> Chart:
    """For each model, the velocity over the whole run and in its last periods (of the highest peak), with the belt's speed."""
    panels = []
    for item in tracks:
        run = item.run
        if len(run.t) < 2:
            continue
        v = item.v
        period = 2 * np.pi / item.peaks[0] if len(item.peaks) else np.ptp(run.t) / 20
        t, whole = run.t, v
        if np.ptp(t) > 4 * periods * period:  # too many periods to be seen: their envelope
            t, *ends = envelope(t, v)
            t, whole = np.repeat(t, 2), np.stack(ends, axis=1).ravel()
        late = run.t > run.t[-1] - periods * period
        about = f"{item.name}{'' if run.complete else ' (interrupted)'}"
        for x, y, title in ((t, whole, about), (run.t[late], v[late], f"last {periods} periods")):
            panels.append(Panel([Series(item.name, x, y, item.kind, "solid", "", width=0.7, legend=False)], "t  [time]",
                                "velocity v  [length/time]", title, levels=[] if item.speed is None
                                else [Level(item.speed, "speed of the belt", "y")],
                                share={"y": "v"}, among=about))
    return Chart("motion-signals", "Velocity at the contact", panels, 2, note="Dashed: the speed of the belt.", height=1.7,
                 about="the least and the largest value over time, and the last periods")


def envelope(t: Array, v: Array, stretches: int = 600) -> tuple[Array, Array, Array]:
    """Times, and the smallest and largest values of a signal in `stretches` stretches of equal length; all values if it is short.

    The default is the width of a panel in pixels.
    """
    column = np.minimum(((t - t[0]) / (t[-1] - t[0]) * stretches).astype(int), stretches - 1)
    starts = np.flatnonzero(np.diff(column, prepend=-1))
    return t[starts], np.minimum.reduceat(v, starts), np.maximum.reduceat(v, starts)


def spectra_chart(tracks: Sequence[Track], highest: float, labelled: int = 4) -> Chart:
    """Amplitudes over ω in the window, one panel for each model, with marks at the peaks and ω beside the highest ones."""
    top = max(float(item.spectrum.amplitude.max()) for item in tracks if item.spectrum is not None)
    panels = [replace(_spectrum(item.spectrum, item.kind, "amplitude  [length/time]", highest, top, labelled),
                      title=f"{item.name}: t = {item.window[0]:g} to {item.window[1]:g}")
              for item in tracks if item.spectrum is not None]
    return Chart("motion-spectrum", "Spectra of the velocity under the belt", panels, note="Marks are the peaks.", height=1.7)


def _spectrum(found: Spectrum, model: str, label: str, highest: float, top: float, labelled: int) -> Panel:
    inside = (found.omega <= highest) & (found.omega > 0)
    omega, _, height = envelope(found.omega[inside], found.amplitude[inside])
    shown = found.peaks <= highest
    peaks, heights = np.asarray(found.peaks)[shown], np.asarray(found.heights)[shown]
    return Panel([Series("", omega, height, model, "solid", "", width=0.8, legend=False),
                  Series("", peaks, heights, model, size=3.0, legend=False, labels=[f"{at:.4g}" for at in peaks[:labelled]],
                         hover={"ω [rad/time]": peaks, "amplitude": heights})],
                 "ω  [rad/time]", label, logs="y", limits={"x": (0, highest), "y": (top * 1e-4, top * 5)},
                 share={"x": "omega", "y": "amplitude"})


def spectrogram_chart(made: Sequence[tuple[str, Spectrogram]], highest: float, decades: int = 3) -> Chart:
    """Short-time spectra side by side, on one colour scale of `decades` decades (the paper's Fig. 5)."""
    top, panels = max((float(found.amplitude.max()) for _, found in made), default=1.0), []
    for name, found in made:
        inside = found.omega <= highest
        heat = Heat(found.t, found.omega[inside], found.amplitude[inside], "amplitude of v under the belt\n[length/time]",
                    top / 10**decades, top)
        panels.append(Panel((), "t  [time]", "ω  [rad/time]", name, limits={"y": (0, highest)}, share={"y": "omega"},
                            where="figure", heat=heat))
    return Chart("motion-spectrogram", "Spectra over time of the velocity v under the belt", panels, len(panels), height=2.6)


def period_chart(rows: Sequence[Mapping[str, Any]], floor: float = 1e-8) -> Chart:
    """Error of the amplitude over the wall time of a simulated period; the full model is the dashed line.

    Amplitudes are accurate to `floor` at best: smaller errors are drawn at `floor`.
    """
    models, series = grouped(rows, "model"), []
    full = models.pop("full")[0]
    for kind, own in models.items():
        hover = hover_of(own, {"DOF": "size", "error": "amplitude_error", "s per period": "seconds_per_period", "steps": "steps"})
        series.append(Series(look(kind).label, hover["s per period"], [max(error, floor) for error in hover["error"]], kind,
                             "solid", width=0.8, labels=[str(size) for size in hover["DOF"]], hover=hover))
    levels = [Level(full["seconds_per_period"], f"full model, {full['size']} DOF"), Level(0.01, "1 %", "y", "dot", "#808080")]
    return Chart("compare-motion", "Error against run time in the limit cycle; numbers: DOF", [Panel(
        series, "run time of a simulated period  [s]", "relative error of the rms velocity  [-]", logs="xy", levels=levels)],
        note="Below and to the left is better. Dashed: the full model.", height=3.2)
