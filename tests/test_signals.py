"""What a trajectory shows: frequencies and amplitudes of signals with known ones."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import femsub as fs

T = np.arange(0, 800, 0.1)


def test_peaks_of_known_sines_are_refined_beyond_the_resolution() -> None:
    x = 0.3 + 0.7 * np.sin(0.7245 * T + 1) + 0.02 * np.sin(1.449 * T) + 0.001 * np.sin(5 * T)
    found = fs.spectrum(T, x)
    np.testing.assert_allclose(found.peaks, [0.7245, 1.449], atol=1e-3 * found.resolution)
    np.testing.assert_allclose(found.heights, [0.7, 0.02], rtol=1e-3)
    assert len(fs.spectrum(T, x, floor=1.3e-3).peaks) == 3 and "0.7245 (0.7)" in repr(found)
    np.testing.assert_allclose(fs.spectrum(T, x, (300, 500)).peaks[0], 0.7245, rtol=1e-4)


def test_neighbours_within_the_main_lobe_are_one_peak() -> None:
    resolution = 2 * np.pi / 800
    apart = fs.spectrum(T, np.sin(T) + np.sin((1 + 6 * resolution) * T))
    assert len(apart.peaks) == 2
    assert len(fs.spectrum(T, np.sin(T) + np.sin((1 + resolution) * T)).peaks) == 1


def test_a_spectrogram_follows_a_change_of_frequency() -> None:
    x = np.where(T < 400, 0.5 * np.sin(T), 0.2 * np.sin(2 * T))
    found = fs.spectrogram(T + 1000, x, 80.0, windows=50)
    assert found.amplitude.shape == (len(found.omega), len(found.t)) and len(found.t) == pytest.approx(50, abs=2)
    peak = found.omega[found.amplitude.argmax(axis=0)]
    step = found.omega[1]
    assert (np.abs(peak[found.t < 1350] - 1) <= step).all() and (np.abs(peak[found.t > 1450] - 2) <= step).all()
    assert found.amplitude[:, found.t < 1350].max() == pytest.approx(0.5, rel=0.1)
    assert found.t[0] >= 1040 - 0.1 and found.t[-1] <= 1760 + 0.1  # no window reaches beyond the signal


def test_growth_of_an_exponential() -> None:
    found = fs.growth_rate(T, 1e-6 * np.exp(0.012 * T) * np.cos(1.3 * T), below=1e-3)
    assert found.rate == pytest.approx(0.012, rel=1e-5) and found.omega == pytest.approx(1.3, rel=1e-5)
    assert found.between[1] < np.log(1e3) / 0.012 and found.spread < 1e-6
    assert fs.growth_rate(T, np.exp(-0.01 * T) * np.cos(2 * T)).rate == pytest.approx(-0.01, rel=1e-4)
    coarse = np.arange(0, 800, 0.05)  # 2.5 points per period: most peaks lie between the points
    assert fs.growth_rate(coarse, np.exp(0.001 * coarse) * np.cos(50 * coarse)).omega == pytest.approx(50, rel=1e-3)
    held = np.repeat(np.exp(0.012 * T[::2]) * np.cos(1.3 * T[::2]), 2)  # recorded at half the rate: a step is no peak
    assert fs.growth_rate(T, held).omega == pytest.approx(1.3, rel=1e-3)
    assert fs.growth_rate(T, held).rate == pytest.approx(0.012, rel=1e-2)


def test_rms_and_sticking() -> None:
    assert fs.rms(T, 3 + 2 * np.sin(np.pi * T)) == pytest.approx(np.sqrt(2), rel=1e-3)
    belt = fs.Belt(speed=0.1, law=fs.StribeckArctanOdd(eps=1e-5))
    run = fs.transient(fs.chain(1, damping=0.0), belt, (0, 4), start=fs.State(np.zeros(1), np.array([0.1])), step=0.01)
    assert fs.sticking(run, multiple=100) == 1.0  # the belt carries the mass
    free = fs.transient(fs.chain(3, belt=2), fs.Belt(speed=0.2, law=fs.StribeckArctan()), (0, 5), step=0.01)
    assert fs.sticking(free) == 0.0 and fs.sticking(free, below=1.0) == 1.0


def test_a_port_of_several_columns_sticks_as_its_cycle_does() -> None:
    """It was refused, with a remedy that a port does not have."""
    model = fs.Substructure(np.diag([1.0, 2.0]), [[1.0, -0.1], [-0.1, 2.0]], interface=[0], ports={"belt": np.eye(2)})
    run = fs.transient(model, fs.Belt(speed=0.2, law=fs.StribeckArctan(eps=1e-2)), (0, 100), step=0.02, impulse=0.5)
    apart = np.abs(0.2 - run.velocity("belt")).min(axis=1)
    assert fs.sticking(run) == (apart <= 3e-2).mean() > 0
    assert fs.sticking(run, between=(0, 50), below=1e-3) == (apart[run.t <= 50] <= 1e-3).mean()


def test_what_cannot_be_analysed_says_so() -> None:
    with pytest.raises(fs.InputError, match="at least 32"):
        fs.spectrum(T[:20], T[:20])
    with pytest.raises(fs.InputError, match="part between 900 and 1000 has 0 points"):
        fs.rms(T, T, (900, 1000))
    with pytest.raises(fs.InputError, match="the same length"):
        fs.spectrum(T, np.zeros((len(T), 2)))
    with pytest.raises(fs.InputError, match="length must be between"):
        fs.spectrogram(T, np.sin(T), 5000.0)
    with pytest.raises(fs.InputError, match="at least 5 peaks"):
        fs.growth_rate(T[:50], np.exp(T[:50]))


@pytest.mark.parametrize("found", [fs.spectrum, fs.rms, fs.growth_rate, lambda t, x: fs.spectrogram(t, x, 50.0)])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_signal_must_be_finite(found: Callable[..., Any], bad: float) -> None:
    x = np.exp(0.012 * T) * np.cos(1.3 * T)
    x[500] = bad
    with pytest.raises(fs.InputError, match=r"NaN or Inf at t = 50\. Interpolate it"):
        found(T, x)
    good = np.isfinite(x)  # the remedies that the error names
    assert found(T, np.interp(T, T[good], x[good])) and found(T[501:], x[501:])


@pytest.mark.parametrize("found", [fs.spectrum, fs.rms, fs.growth_rate, lambda t, x: fs.spectrogram(t, x, 50.0)])
def test_times_must_be_a_uniform_grid(found: Callable[..., Any]) -> None:
    x = np.exp(0.012 * T) * np.cos(1.3 * T)
    rounded = T + 0.01 * (T[1] - T[0]) * (-1.0) ** np.arange(len(T))  # as in a file
    assert found(rounded, x)
    with pytest.raises(fs.InputError, match=r"must be a uniform grid, but .* steps away from it. Let even"):
        found(T**1.1, x)
    with pytest.raises(fs.InputError, match=r"must increase, but .* Sort t"):
        found(T[::-1], x)
    with pytest.raises(fs.InputError, match="must increase"):
        found(np.append(T, T[-1]), np.append(x, 0.0))
    t = T**1.1
    even = np.linspace(t[0], t[-1], len(t))  # the remedies that the error names
    assert found(even, np.interp(even, t, x))
    few = np.float64(np.float32(T + 4e5))
    with pytest.raises(fs.InputError, match="if t only lacks digits, give even in its place"):
        found(few, x)
    assert found(np.linspace(few[0], few[-1], len(few)), x)
