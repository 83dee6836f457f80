"""Motions in time of several models of one structure: their results, growth compared with Re λ, strongest frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from femsub.model import Contact, Substructure
from femsub.modes import ComplexModes
from femsub.motion.charts import Track
from femsub.motion.nonlinear_model import sliding
from femsub.motion.signals import Spectrogram, growth_rate, rms, spectrogram
from femsub.motion.transient import sticking, transient


def motion_row(track: Track, port: str) -> dict[str, Any]:
    """The results of a run at a port: amplitude, frequencies and sticking in the window; None if the window is short."""
    run, window = track.run, track.window
    row: dict[str, Any] = {"model": track.kind, "size": track.size, "cutoff": getattr(track.model, "cutoff", np.inf),
                           "window": list(window), "rms": None, "peaks": None, "heights": None, "sticking": None,
                           "energy_residual": run.energy.residual, "steps": run.effort.steps, "seconds": run.effort.seconds,
                           "end": run.end, "complete": run.complete}
    if track.spectrum is not None:
        row |= {"rms": rms(run.t, track.v, window), "peaks": track.spectrum.peaks, "heights": track.spectrum.heights}
        if any(belt.port == port for belt in run.contact.belts) and not run.contact.without_eps:
            row["sticking"] = sticking(run, port, window)
    return row


def growth_in_time(model: Substructure, contacts: Sequence[Contact], modes: ComplexModes, port: str, speed: float,
                   faint: float = 1e-6, still: float = 1e-3) -> dict[str, Any]:
    """Growth rate and frequency of the fastest growing mode below the cut-off, measured in time at a port, and those of its λ.

    `faint` and `still` are shares of `speed`: the mode's velocity at the start, and the velocity up to which the growth is
    followed. Up to there the model is nearly linear. All values are None if no mode grows.
    """
    measured = ("growth", "growth_of_cea", "omega", "omega_of_cea", "error")
    if (at := modes.fastest) is None:
        return dict.fromkeys(measured)
    # from the velocity `faint` until it should reach `still`, and for at least a dozen periods
    value, shape = complex(modes.eigenvalues[at]), modes.shapes[:, at]
    shape = shape * (faint * speed / max(float(np.abs(model.port(port).T @ shape * value).max()), 1e-300))
    start = sliding(model, contacts).perturbed(shape.real, (value * shape).real)
    period = 2 * np.pi / value.imag
    end = max(np.log(still / faint) / value.real, 12 * period)
    run = transient(model, contacts, (0.0, end), start=start, step=period / 40, tol=1e-10, method="lsoda").whole()
    own = growth_rate(run.t, run.velocity(port), below=2 * still * speed)
    return dict(zip(measured, (own.rate, value.real, own.omega, value.imag, abs(own.rate / value.real - 1)), strict=True))


def spectrograms(tracks: Sequence[Track], length: float) -> tuple[list[tuple[Track, Spectrogram]], list[dict[str, Any]]]:
    """Short-time spectra of the runs that are long enough, and rows with the strongest frequency at about eight times of each."""
    made = [(item, spectrogram(item.run.t, item.v, length)) for item in tracks
            if len(item.run.t) and np.ptp(item.run.t) > 2 * length]
    return made, [{"model": item.kind, "size": item.size, "from": float(found.t[at]) - length / 2,
                   "to": float(found.t[at]) + length / 2, "omega": float(found.omega[found.amplitude[:, at].argmax()])}
                  for item, found in made for at in range(0, len(found.t), max(1, len(found.t) // 8))]
