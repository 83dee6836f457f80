"""Initial guesses for limit cycles: an unstable mode with a balanced amplitude, or a signal in time.

With v = a cos ωt the friction has the first harmonic N(a) a/2 with a real N. One harmonic alone is balanced if

    1 = Y(iω) N(a),   that is at a crossing of the linear model, c(ω) = -N(a)

(describing function; Krack and Gross 2019, sec. 2.2). Every crossing ω_j that the belt's slope has passed, F μ' < c_j, is the
seed of a cycle. A law that changes from sliding to sticking within ε ≪ v0 is first replaced by smoother laws, from ε = v0/10 on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import is_dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from femsub.checks import EPS, EQUAL, Array, InputError, NoCycleError, real_array
from femsub.coupling import width_of
from femsub.model import beyond
from femsub.modes import PortFunction, eigenvalues
from femsub.motion.cycles.balance import Orbit, coefficients, power_of_two
from femsub.motion.cycles.compliance import Compliance, Fractions, compliance
from femsub.motion.nonlinear_model import Sliding


def levels(contact: Sliding, wide: float = 0.1, sharper: float = 0.72) -> list[Sliding]:
    """The contact with increasingly sharp laws, ending with its own laws; one entry if no law has an ε (see `FrictionLaw`).

    The first law, the smoothest one, has at least ε = `wide` v0. `sharper` is the factor of ε from one level to the next.
    """
    known = [(belt, width_of(belt.law) if is_dataclass(belt.law) else np.nan, abs(belt.speed or 0.0)) for belt in contact.belts]
    most = max([1.0, *(wide * speed / width for _, width, speed in known if width > 0)])
    steps = int(np.ceil(np.log(most) / -np.log(sharper)))
    return [contact.changed([belt if np.isnan(width) or factor == 1 else
                             replace(belt, law=replace(belt.law, eps=max(width, min(width * factor, wide * speed))))  # type: ignore[type-var]
                             for belt, width, speed in known])
            for factor in np.geomspace(most, 1.0, steps + 1).tolist()]


def harmonics_for(contact: Sliding, most: int) -> int:
    """The number of harmonics needed for the sharpest transition of a law, empirical: 1.2 v0/ε, at least 10."""
    ratios = [abs(belt.speed or 0.0) / width_of(belt.law) for belt in contact.belts]
    ratio = max((ratio for ratio in ratios if not np.isnan(ratio)), default=10.0)
    return int(np.clip(1.2 * ratio, 10, most))


def gain(contact: Sliding, shape: Array, amplitudes: Array, samples: int = 4096) -> Array:
    """N_c(a) (m, p): first harmonic of f over first harmonic of v = Re(a shape e^{iωt}), column by column; shape (p,), a (m,)."""
    wave = np.cos(2 * np.pi * np.arange(samples) / samples)
    found, sizes = np.empty((len(amplitudes), len(shape))), np.abs(amplitudes[:, None] * shape)
    for i, size in enumerate(sizes):
        v = size[:, None] * wave
        found[i] = 2 * coefficients(contact.exerted(v, v), 1)[1].real / np.where(size > 0, size, 1.0)
    return found if (sizes > 0).all() else np.where(sizes > 0, found, slopes_of(contact))


def slopes_of(contact: Sliding) -> Array:
    """df/dv of steady sliding under belts, column by column, (p,)."""
    still = np.zeros(contact.columns)
    return contact.tangents(still, still)[1].diagonal()


def unstable_modes(contact: Sliding, flexibility: Fractions) -> Array:
    """λ with Re λ > 0 of steady sliding, (k,), the fastest growing first, without those above the model's cut-off."""
    form = flexibility.found.form
    values = eigenvalues(form, form.C - (flexibility.w * slopes_of(contact)) @ flexibility.w.T)
    noise = 4096 * EPS * float(np.abs(values).max(initial=1.0))  # rounding in λ
    values = values[(values.real > noise) & (values.imag > 0) & ~beyond(values.imag, contact.model.cutoff)]
    return values[np.argsort(-values.real)]


def seeds(contact: Sliding, flexibility: Fractions, near: float | None = None, largest: float = 3.0) -> list[Orbit]:
    """Orbits of one harmonic at the crossing next to the fastest growing mode, or nearest to a frequency; best first.

    Amplitudes are tried up to `largest` times the belt speed. There is no orbit if steady sliding is stable and no frequency was
    given, or if no amplitude balances one harmonic.
    """
    growing = unstable_modes(contact, flexibility)
    if not len(growing) and (near is None or contact.columns > 1):
        return []
    # densest around the belt's speed, where the mass begins to stick
    shares = np.concatenate([np.geomspace(1e-3, 0.3, 40), np.linspace(0.31, 1.3, 200), np.linspace(1.32, largest, 60)])
    amplitudes = float(contact.speeds.max()) * shares
    if contact.columns == 1:
        function = port_function(flexibility)
        centre = float(growing[0].imag) if near is None else near
        omega, c = function.crossings(0.75 * centre, 1.3 * centre)
        if near is not None and not len(omega):
            omega, c = crossings(flexibility, 0.0, np.inf)
        N = gain(contact, np.ones(1), amplitudes)[:, 0]
        found = []
        for at in np.argsort(np.abs(omega - centre)):
            balance = N + c[at]
            for i in np.flatnonzero(balance[1:] * balance[:-1] <= 0)[::-1]:
                a = amplitudes[i] - balance[i] * (amplitudes[i + 1] - amplitudes[i]) / (balance[i + 1] - balance[i] or 1.0)
                found.append(Orbit(np.array([[a / 2 + 0j]]), float(omega[at])))
        return found
    # with several columns, the amplitude of the mode is increased until the mode neither grows nor decays
    form, w = flexibility.found.form, flexibility.w
    target = complex(growing[0] if near is None else growing[np.argmin(np.abs(growing.imag - near))])
    shape, before = np.zeros(0), None
    for a in amplitudes:
        N = gain(contact, shape, np.array([a]), 512)[0] if len(shape) else slopes_of(contact)
        values, vectors = np.linalg.eig(form.state(form.C - (w * N) @ w.T))
        at = int(np.argmin(np.abs(values - target)))
        target = complex(values[at])
        speeds = w.T @ vectors[len(form.omega) - form.rigid:, at]
        shape = speeds / speeds[np.argmax(np.abs(speeds))]
        if before is not None and target.real <= 0:
            return [Orbit((before / 2 * shape)[None, :].astype(complex), target.imag)]
        before = a
    return []


def port_function(flexibility: Fractions) -> PortFunction:
    """The port function of a contact of one column (Im G = 0 at crossings), from the decomposition of `flexibility`."""
    return PortFunction(flexibility.found.form, flexibility.w[:, 0], flexibility.found.values, flexibility.residues[:, 0])


def onsets(contact: Sliding, band: tuple[float, float]) -> tuple[Array, Array]:
    """(ω, c) of the crossings in a band that the belt's slope has passed, F μ' < c < 0, in the order of passing."""
    flexibility = compliance(contact)
    if not isinstance(flexibility, Fractions) or contact.columns > 1:
        raise InputError("onsets can be listed for a contact of one column and at most 2,000 DOF. Reduce the model first")
    omega, c = crossings(flexibility, band[0], min(band[1], contact.model.cutoff))
    passed = np.flatnonzero(c > -slopes_of(contact)[0])
    order = passed[np.argsort(-c[passed], kind="stable")]
    return omega[order], c[order]


def crossings(flexibility: Fractions, lo: float, hi: float) -> tuple[Array, Array]:
    """(ω, c) of every crossing with lo ≤ ω ≤ hi, ascending in ω, searched mode by mode."""
    function = port_function(flexibility)
    centres = np.sort(function.poles.imag[(function.poles.imag > lo) & (function.poles.imag < hi)])
    edges = np.unique([lo, *(centres[1:] + centres[:-1]) / 2, min(hi, 2 * float(np.abs(function.poles).max()))])
    pairs = [function.crossings(float(a), float(b)) for a, b in pairwise(edges)]
    omega, c = (np.concatenate([pair[i] for pair in pairs] or [np.zeros(0)]) for i in range(2))
    order = np.argsort(omega)
    omega, c = omega[order], c[order]
    fresh = np.diff(omega, prepend=-np.inf) > EQUAL * omega
    return omega[fresh], c[fresh]


def of_signal(t: Any, v: Any, columns: int) -> Orbit:
    """The last period of a signal v (m,) or (p, m) at times t (m,); the period comes from the autocorrelation.

    Raises
    ------
    InputError
        The signal is too short, or not finite.
    NoCycleError
        It is not periodic.
    """
    from scipy.signal import correlate, find_peaks

    time, speed = real_array("t of start=(t, v)", t), np.atleast_2d(real_array("v of start=(t, v)", v))
    if time.ndim != 1 or speed.shape != (columns, len(time)):
        raise InputError(f"start=(t, v) takes times (m,) and speeds ({columns}, m), one row per column of the contact, not "
                         f"{np.shape(t)} and {np.shape(v)}")
    if (back := np.flatnonzero(np.diff(time) <= 0)).size:
        raise InputError(f"the times of start=(t, v) must increase, but {time[back[0] + 1]:.12g} comes after "
                         f"{time[back[0]]:.12g}")
    if len(time) < 64:
        raise InputError(f"the signal has {len(time)} samples, but at least 64 are needed to find a period")
    even = np.linspace(time[len(time) // 2], time[-1], power_of_two(len(time)))
    tail = np.array([np.interp(even, time, row) for row in speed])
    tail = tail - tail.mean(axis=1, keepdims=True)
    lags = np.arange(len(even) // 2)
    alike = sum(correlate(row, row, method="fft")[len(even) - 1 + lags] for row in tail) / (len(even) - lags)
    low = np.flatnonzero(alike < 0.3 * alike[0])
    if not alike[0] > 0 or not len(low):
        raise NoCycleError("the second half of the signal must contain two oscillations, but does not. Give a longer signal")
    tops, _ = find_peaks(alike)
    tops = tops[tops > low[0]]
    if not len(tops) or alike[tops].max() < 0.5 * alike[0]:
        raise NoCycleError("the second half of the signal is not periodic. Give a longer signal, or another start")
    top = int(tops[np.flatnonzero(alike[tops] >= 0.98 * alike[tops].max())[0]])
    left, middle, right = alike[top - 1:top + 2]
    period = (top + 0.5 * (left - right) / (left - 2 * middle + right)) * (even[1] - even[0])
    count = 4096
    grid = even[-1] - period + period * np.arange(count) / count
    one = np.array([np.interp(grid, time, row) for row in speed])
    return Orbit(coefficients(one, count // 2 - 1)[1:], 2 * np.pi / period)


def orbits(contact: Sliding, flexibility: Compliance, near: float | None,
           largest: float = 3.0) -> Iterator[tuple[list[Sliding], Orbit]]:
    """Yields contacts from smooth to sharp laws with an initial orbit, beginning with the smoothest law for which there is one.

    Amplitudes are tried up to `largest` times the belt speed. Above the belt speed, friction reverses in each period and
    dissipates energy.

    Raises
    ------
    InputError
        The model is too large to compute all of its modes.
    NoCycleError
        With the belts' own laws, steady sliding is stable and no frequency was given, or no amplitude balances one harmonic.
    """
    if contact.model.H is not None:
        raise InputError(f"{contact.model.name!r} has structural damping, with which no start is found by itself. Give start=, "
                         "e.g. the cycle of fs.equivalent_viscous(model, omega)")
    if not isinstance(flexibility, Fractions):
        raise InputError(f"a model of {contact.model.size} DOF is too large for an automatic start. Give start=, e.g. the cycle "
                         "of a reduced model (start=cycle) or a signal in time (start=(t, v))")
    sharp = levels(contact)
    for at in range(len(sharp)):
        found = seeds(sharp[at], flexibility, near, largest)
        for orbit in found[:2]:
            yield sharp[at:], orbit
        if found and at > len(sharp) // 2:
            return
    if found:
        return
    if near is None and not len(unstable_modes(contact, flexibility)):
        slopes = ", ".join(f"F μ' = {belt.force * belt.slope:.4g}" for belt in contact.belts if belt.slope is not None)
        why = slopes if contact.speeds.any() else "the belt is at rest and supplies no energy: give it a speed"
        raise NoCycleError(f"steady sliding is stable ({why}): no mode of {contact.model.name!r} grows, so there is no initial "
                           "guess for a cycle. Make the slope of the friction more negative or its force larger (see "
                           "fs.critical_slope), or give start= if a cycle is known")
    raise NoCycleError(f"no amplitude up to {largest:g} times the belt's speed balances one harmonic"
                       + (f" near ω = {near:g}" if near else "") + ". Give start=(t, v), a signal in time, or another frequency")
