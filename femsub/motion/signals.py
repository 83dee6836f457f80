"""Evaluation of signals: amplitude, spectrum, spectrogram, sticking, growth rate.

All functions take the times and a signal on a uniform grid, e.g. run.t and run.velocity("belt"), and `between` = (from, to)
to select a part. Frequencies are in radians per unit of time, amplitudes in the signal's unit: a sin(ωt) has a at ω.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from femsub.checks import Array, InputError, finite_number, interval, real_array, whole_number
from femsub.motion.charts import spectrogram_chart, spectrum_chart
from femsub.output import Chart, Displayed, Table, column

WINDOW = "blackman"  # side lobes at -58 dB; the main lobe ends 3 bins from its centre
FEWEST = 32  # smallest number of points for a spectrum


@dataclass(frozen=True, eq=False, repr=False)
class Spectrum(Displayed):
    """|2/Σg Σ g_j (x_j - x̄) exp(-iωt_j)| of a signal x with the Blackman window g.

    Attributes
    ----------
    omega, amplitude : ndarray, shape (m,)
    peaks, heights : ndarray, shape (k,)
        Frequencies and heights of the peaks, the highest first, by a parabola through the logarithms of three points.
    resolution : float
        2π / length of the window; peaks closer than three times this merge.
    """

    omega: Array
    amplitude: Array
    peaks: Array
    heights: Array
    resolution: float

    def tables(self) -> list[Table]:
        """A row for each peak."""
        rows = [{"omega": float(omega), "amplitude": float(height)}
                for omega, height in zip(self.peaks, self.heights, strict=True)]
        return [Table("spectrum", rows, ["omega", column("amplitude", form=".4g")], "Peaks")] if rows else []

    def chart(self, title: str = "Spectrum") -> Chart:
        """The amplitude over ω, with marks at its peaks."""
        return spectrum_chart(self, title)

    def __repr__(self) -> str:
        listed = ", ".join(f"{at:.5g} ({height:.3g})" for at, height in zip(self.peaks[:4], self.heights[:4], strict=True))
        return f"Spectrum: peaks at {listed or 'none'}, resolution {self.resolution:.2g} rad/time"


@dataclass(frozen=True, eq=False, repr=False)
class Spectrogram(Displayed):
    """Spectra of a moving window: amplitude (len(omega), len(t)), with t the centres of the windows."""

    t: Array
    omega: Array
    amplitude: Array
    length: float  #: length of the window in time

    def chart(self, title: str = "Spectrogram", highest: float | None = None) -> Chart:
        """Amplitudes in colours over time and ω, up to `highest`: by default all above a thousandth of the largest."""
        if highest is None:
            loud = (self.amplitude > 1e-3 * self.amplitude.max()).any(axis=1)
            highest = float(self.omega[min(int(np.flatnonzero(loud).max(initial=0)) + 1, len(self.omega) - 1)])
        return replace(spectrogram_chart([("", self)], highest), title=title)

    def __repr__(self) -> str:
        return f"Spectrogram: {len(self.t)} windows of {self.length:g} from t = {self.t[0]:g} to {self.t[-1]:g}, " \
               f"up to {self.omega[-1]:.4g} rad/time"


@dataclass(frozen=True)
class Growth:
    """x ≈ a exp(rate t) cos(omega t + φ): `rate` fitted to the logarithms of the peaks of |x| over `between`.

    `spread` is the standard error of the rate. A large `spread` means that the growth was not exponential.
    """

    rate: float
    omega: float
    spread: float
    between: tuple[float, float]


def spectrum(t: Array, signal: Array, between: tuple[float, float] | None = None, *, count: int = 8,
             floor: float = 0.01) -> Spectrum:
    """The amplitude spectrum of a signal with a Blackman window, and its highest peaks.

    The `count` highest peaks are listed, if their height is at least `floor` times the highest. With a floor below 0.0013 the
    side lobes of the window appear as peaks.

    Raises
    ------
    InputError
        Fewer than 32 points, times that are no uniform grid, a time and a signal of different lengths, a floor outside 0 to 1.

    Examples
    --------
    >>> import femsub as fs, numpy as np
    >>> t = np.linspace(0, 50, 2000)
    >>> fs.spectrum(t, 0.5 * np.sin(2 * t)).peaks.round(2)
    array([2.])
    """
    from scipy.fft import next_fast_len, rfft
    from scipy.signal import find_peaks, get_window

    whole_number("count", count, least=0)
    if not 0 <= finite_number("floor", floor) <= 1:
        raise InputError(f"floor is a share of the highest peak between 0 and 1, not {floor!r}")
    _, x, step = part_of(t, signal, between, FEWEST)
    m = len(x)
    g = get_window(WINDOW, m)
    long = next_fast_len(4 * m, real=True)  # zeros behind the signal, for the interpolation of peaks
    amplitude = np.abs(rfft(g * (x - g @ x / g.sum()), long)) * 2 / g.sum()
    omega = 2 * np.pi * np.arange(len(amplitude)) / (long * step)
    resolution = 2 * np.pi / (m * step)
    at, _ = find_peaks(amplitude, height=floor * amplitude.max(), distance=3 * resolution / omega[1])
    at = at[np.argsort(-amplitude[at])][:count]
    vertices = np.array([_parabola(np.log(amplitude[i - 1:i + 2])) for i in at]).reshape(-1, 2)
    return Spectrum(omega, amplitude, omega[at] + omega[1] * vertices[:, 0], np.exp(vertices[:, 1]), resolution)


def _parabola(y: Array) -> tuple[float, float]:
    """Position (in steps from the middle) and height of the vertex of a parabola through three values."""
    curve, slope = y[0] - 2 * y[1] + y[2], (y[2] - y[0]) / 2
    place = -slope / curve if curve < 0 else 0.0
    return float(place), float(y[1] + slope * place / 2)


def spectrogram(t: Array, signal: Array, length: float, *, between: tuple[float, float] | None = None,
                windows: int = 200) -> Spectrogram:
    """The change of a signal's spectrum in time: short-time spectra by scipy.signal.ShortTimeFFT.

    A Blackman window of `length` (in time) is moved to about `windows` positions. The mean of each window is removed.

    Examples
    --------
    >>> import femsub as fs, numpy as np
    >>> t = np.linspace(0, 50, 2000)
    >>> found = fs.spectrogram(t, np.sin(2 * t), length=20.0, windows=5)
    >>> found.amplitude.shape == (len(found.omega), len(found.t))
    True
    """
    from scipy.signal import ShortTimeFFT, get_window

    times, x, step = part_of(t, signal, between, FEWEST)
    points = finite_number("length", length) / step
    if not FEWEST - 0.5 <= points < len(x) + 0.5:
        raise InputError(f"length must be between {FEWEST * step:g} and the signal's {len(x) * step:g}, but is {length!r}")
    points = round(points)
    hop = max(1, (len(x) - points) // max(1, whole_number("windows", windows) - 1))
    g = get_window(WINDOW, points)
    transform = ShortTimeFFT(g, hop, fs=1 / step, fft_mode="onesided", scale_to="magnitude")
    first, last = transform.lower_border_end[1], transform.upper_border_begin(len(x))[1]
    found = transform.stft_detrend(x, "constant", p0=first, p1=max(last, first + 1))
    middles = times[0] + transform.t(len(x), p0=first, p1=max(last, first + 1))
    return Spectrogram(middles, 2 * np.pi * transform.f, 2 * np.abs(found), points * step)


def rms(t: Array, signal: Array, between: tuple[float, float] | None = None) -> float:
    """The root mean square of a signal about its mean: sqrt(mean((x - x̄)²)).

    Examples
    --------
    >>> import femsub as fs, numpy as np
    >>> t = np.linspace(0, 20 * np.pi, 2000)
    >>> print(f"{fs.rms(t, np.sin(t)):.3f}")
    0.707
    """
    return float(part_of(t, signal, between, 2)[1].std())


def growth_rate(t: Array, signal: Array, between: tuple[float, float] | None = None, *, below: float | None = None) -> Growth:
    """The growth rate σ of a signal x ≈ a exp(σt) cos(ωt + φ) with zero mean.

    σ is the slope of a straight line through the logarithms of the peaks of |x|.

    Parameters
    ----------
    t, signal : ndarray, shape (m,)
        A uniform grid.
    between : (from, to), optional
        The part to use.
    below : float, optional
        Use only peaks before |x| first exceeds this value, that is before nonlinear friction limits the growth.

    Raises
    ------
    InputError
        Fewer than five peaks: the window is too short, or the grid too coarse.

    Examples
    --------
    >>> import femsub as fs, numpy as np
    >>> t = np.linspace(0, 50, 2000)
    >>> print(f"{fs.growth_rate(t, np.exp(0.05 * t) * np.cos(2 * t)).rate:.4f}")
    0.0500
    """
    from scipy.signal import find_peaks

    times, x, step = part_of(t, signal, between, 8)
    if below is not None:
        over = np.flatnonzero(np.abs(x) > finite_number("below", below))
        end = over[0] if len(over) else len(x)
        times, x = times[:end], x[:end]
    y = np.abs(x)
    at, _ = find_peaks(y)
    if len(at) < 5:
        raise InputError(f"a growth rate needs at least 5 peaks of |x|, but there are {len(at)}. Use a longer "
                         "window, a finer grid or a larger `below`")
    refined = [_parabola(y[i - 1:i + 2]) for i in at]
    places = times[at] + step * np.array([place for place, _ in refined])
    heights = np.log([height for _, height in refined])
    (rate, _), covariance = np.polyfit(places, heights, 1, cov=True)
    # zeros are counted, not peaks: a grid of a few points per period misses peaks
    turns = np.count_nonzero(np.diff(np.signbit(x[at[0]:at[-1] + 1])))
    return Growth(float(rate), float(np.pi * turns / (places[-1] - places[0])), float(np.sqrt(covariance[0, 0])),
                  (float(places[0]), float(places[-1])))


def period_near(t: Array, signal: Array, guess: float) -> float:
    """The period T within 3 % of a guess for which x(t + T) is nearest to x(t). A few periods of the signal are enough."""
    trial = guess * np.linspace(0.97, 1.03, 1201)
    early = t[t <= t[-1] - trial[-1]]
    first = np.interp(early, t, signal)
    gap = np.array([np.square(np.interp(early + period, t, signal) - first).mean() for period in trial])
    return float(trial[np.argmin(gap)])


def part_of(t: Any, signal: Any, between: tuple[float, float] | None, fewest: int, uneven: float = 0.05
            ) -> tuple[Array, Array, float]:
    """The part of a signal, its times and its step, checked. Times may be `uneven` steps away from a uniform grid.

    Files have rounded times. At a twentieth of the sampling frequency 0.05 steps are a phase of 1°.
    """
    times, x = real_array("t", t), real_array("signal", signal, finite=False)
    if times.ndim != 1 or x.shape != times.shape:
        raise InputError(f"t and the signal must have the same length, but their shapes are {times.shape} and {x.shape}. "
                         "If the port has several columns, select one")
    if between is not None:
        lo, hi = between = interval("between", between)
        inside = (times >= lo) & (times <= hi)
        times, x = times[inside], x[inside]
    if len(times) < fewest:
        span = "the signal" if between is None else f"the part between {between[0]:g} and {between[1]:g}"
        raise InputError(f"{span} has {len(times)} points, but at least {fewest} are needed")
    if not (good := np.isfinite(x)).all():
        raise InputError(f"the signal holds a NaN or Inf at t = {times[~good][0]:.12g}. Interpolate it there, np.interp(t, "
                         "t[good], signal[good]) with good = np.isfinite(signal), or select a part without it by `between`")
    if len(times) == 1:
        return times, x, np.nan
    if (back := np.flatnonzero(np.diff(times) <= 0)).size:
        raise InputError(f"t must increase, but {times[back[0] + 1]:.12g} comes after {times[back[0]]:.12g}. Sort t and the "
                         "signal by t, and leave out times that are there twice")
    step = float((times[-1] - times[0]) / (len(times) - 1))
    away = np.abs(times - (times[0] + step * np.arange(len(times)))) / step
    if away.max() > uneven:
        raise InputError(f"t must be a uniform grid, but {times[away.argmax()]:.12g} is {away.max():.2g} steps away from it. "
                         "Let even = np.linspace(t[0], t[-1], len(t)). Interpolate the signal first, np.interp(even, t, signal); "
                         "if t only lacks digits, give even in its place")
    return times, x, step
