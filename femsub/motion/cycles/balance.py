"""Harmonic balance, condensed onto the contact: a periodic speed under the belts and its frequency.

With v(t) = Σ_{0<|k|≤H} v_k e^{ikωt} (p,) and f_k the Fourier coefficients of f(v(t)), the linear model answers

    R_k = v_k - Y(ikω) f_k(v) = 0,  k = 1 … H,   Y(s) = s Wᵀ(s²M + sD + K)⁻¹W

(v_0 = 0: the mean force shifts the mean displacement only). The unknowns are v_k and ω, 2Hp + 1 real numbers for a model of
any size. f_k comes by alternating frequency and time: v is sampled, f taken there, and both ways are FFTs. The Jacobian is
exact: with g_k the coefficients of df/dv, δf_k = Σ_j g_{k-j} δv_j + g_{k+j} v̄_j, and dR/dω = -ik Y'(ikω) f_k.

Cameron and Griffin, J. Appl. Mech. 56 (1989) 149 (alternating frequency/time); Krack and Gross, Harmonic Balance for
Nonlinear Vibration Problems, Springer 2019, ch. 2 to 4 (condensation, continuation).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg as la

from femsub.checks import Array
from femsub.errors import NotConvergedError
from femsub.motion.cycles.compliance import Compliance
from femsub.motion.nonlinear_model import Sliding

ALIASING = 1e-7  # samples are doubled until the relative change of v is smaller
SAMPLES = 2**17  # largest number of samples per period
STEP = 1e-9  # relative size of a Newton step at which the iteration ends


@dataclass(frozen=True, eq=False)
class Orbit:
    """The unknowns of harmonic balance: v_k (H, p), k = 1 … H, and ω."""

    v: Array
    omega: float

    @property
    def harmonics(self) -> int:
        return len(self.v)

    @cached_property
    def norm(self) -> float:
        """Root mean square of v over one period, summed over the columns."""
        return float(np.sqrt(2) * np.linalg.norm(self.v))

    @property
    def vector(self) -> Array:
        """[Re v, Im v, ω] (2Hp + 1,)."""
        return np.concatenate([self.v.real.ravel(), self.v.imag.ravel(), [self.omega]])

    def at(self, x: Array) -> Orbit:
        """The orbit of a vector of the same shape."""
        half = (len(x) - 1) // 2
        return Orbit((x[:half] + 1j * x[half:-1]).reshape(self.v.shape), float(x[-1]))

    def with_harmonics(self, count: int) -> Orbit:
        """The orbit truncated, or padded with zeros."""
        v = np.zeros((count, self.v.shape[1]), dtype=complex)
        v[:min(count, len(self.v))] = self.v[:count]
        return Orbit(v, self.omega)

    def samples(self, count: int) -> Array:
        """v at `count` equidistant times of one period, (p, count)."""
        return samples_of(self.v, count)


def samples_of(v: Array, count: int) -> Array:
    """Σ_k v_k e^{ikτ} + conjugate at τ = 2πj/count, (H, p) to (p, count)."""
    spectrum = np.zeros((v.shape[1], count // 2 + 1), dtype=complex)
    kept = min(len(v), count // 2)
    spectrum[:, 1:kept + 1] = v[:kept].T
    return np.fft.irfft(spectrum * count, n=count, axis=1)


def power_of_two(least: int) -> int:
    """The first power of two from `least` on, the best length for an FFT."""
    return 1 << (least - 1).bit_length()


def coefficients(samples: Array, count: int) -> Array:
    """Coefficients k = 0 … count of (p, m) samples, (count + 1, p)."""
    return np.fft.rfft(samples, axis=1)[:, :count + 1].T / samples.shape[1]


class Balance:
    """R(v, ω) of belts and one model's compliance, with its derivatives; `coupled.balance_of` makes that of any contacts."""

    def __init__(self, contact: Sliding, flexibility: Compliance) -> None:
        self.contact, self.flexibility = contact, flexibility

    def force(self, orbit: Orbit, count: int) -> Array:
        """f at `count` equidistant times of one period, (p, count)."""
        return self.contact.force(orbit.samples(count))

    def samples(self, orbit: Orbit) -> int:
        """The number of samples, a power of two, for which R is free of aliasing."""
        H = orbit.harmonics
        count = power_of_two(max(64, 4 * H + 2))
        f = coefficients(self.force(orbit, count), H)
        Y = self.flexibility.estimate(1j * orbit.omega * np.arange(1, H + 1))
        while count < SAMPLES:
            finer = coefficients(self.force(orbit, 2 * count), H)
            error = np.einsum("kij,kj->ki", Y, (finer - f)[1:])
            if np.linalg.norm(error) <= ALIASING * np.linalg.norm(orbit.v):
                break
            count, f = 2 * count, finer
        return count

    def residual(self, orbit: Orbit, count: int) -> tuple[Array, Array, Array, Array]:
        """R (H, p), and Y, dY/dω, f at the same orbit."""
        k = np.arange(1, orbit.harmonics + 1)
        Y, slope = self.flexibility.mobility(1j * orbit.omega * k)
        f = coefficients(self.force(orbit, count), orbit.harmonics)[1:]
        return orbit.v - np.einsum("kij,kj->ki", Y, f), Y, 1j * k[:, None, None] * slope, f

    def derivative(self, orbit: Orbit, count: int, parts: tuple[Array, Array, Array, Array]) -> Array:
        """dR/d[Re v, Im v, ω], shape (2Hp, 2Hp + 1)."""
        H, p = orbit.v.shape
        _, Y, slope, f = parts
        g = coefficients(self.contact.tangent(orbit.samples(count)), 2 * H)
        k = np.arange(1, H + 1)
        lag = k[:, None] - k
        one = np.where((lag >= 0)[..., None], g[np.abs(lag)], g[np.abs(lag)].conj())
        two = g[k[:, None] + k]
        J = np.empty((2, H, p, 2, H, p))
        for part, sign, unit in ((0, 1, 1.0), (1, -1, 1j)):
            # column c of the contact depends on its own speed only; Y couples the columns
            change = -unit * np.einsum("kic,kjc->kijc", Y, one + sign * two)
            J[0, :, :, part], J[1, :, :, part] = change.real, change.imag
        at = np.arange(H)
        for part in range(2):
            for c in range(p):
                J[part, at, c, part, at, c] += 1.0
        omega = -np.einsum("kij,kj->ki", slope, f)
        return np.hstack([J.reshape(2 * H * p, 2 * H * p), np.concatenate([omega.real.ravel(), omega.imag.ravel()])[:, None]])

    def unresolved(self, orbit: Orbit, target: float = 0.0) -> tuple[float, float, int]:
        """Errors relative to v: truncation ‖Y_k f_k‖ over k > H, and aliasing of k ≤ H; and a sufficient number of harmonics.

        With that number, and the f_k of this orbit, the truncation is at most `target`, by default a tenth of its value now.
        """
        H = orbit.harmonics
        used = self.samples(orbit)
        count = min(2 * SAMPLES, 4 * used)
        top = count // 4
        f = coefficients(self.force(orbit, count), top)[1:]
        coarse = coefficients(self.force(orbit, used), H)[1:]
        Y = self.flexibility.estimate(1j * orbit.omega * np.arange(1, top + 1))
        rest = np.linalg.norm(np.einsum("kij,kj->ki", Y, f), axis=1)
        size = float(np.linalg.norm(orbit.v)) or 1.0
        beyond = np.sqrt(np.cumsum(rest[::-1] ** 2)[::-1]) / size  # ‖.‖ over all harmonics from k on
        truncation = float(beyond[H]) if top > H else 0.0
        enough = np.flatnonzero(beyond <= (target or 0.1 * truncation))
        alias = float(np.linalg.norm(np.einsum("kij,kj->ki", Y[:H], coarse - f[:H]))) / size
        return truncation, alias, int(enough[0]) if len(enough) else top

    def solve(self, orbit: Orbit, *, rounds: int = 40, tol: float = STEP) -> tuple[Orbit, float, int]:
        """Newton's method with a line search and the phase condition Σ k Im(v̄_k δv_k) = 0; returns ‖R‖/‖v‖ and the steps, too.

        Raises
        ------
        NotConvergedError
            The steps did not become small, or v became 0, which is steady sliding.
        """
        start, count = orbit.norm, self.samples(orbit)
        parts = self.residual(orbit, count)
        for turn in range(1, rounds + 1):
            J = np.vstack([self.derivative(orbit, count, parts), self.phase(orbit)])
            right = np.concatenate([parts[0].real.ravel(), parts[0].imag.ravel(), [0.0]])
            try:
                step = -la.solve(J, right, check_finite=False)
            except (la.LinAlgError, ValueError):
                raise NotConvergedError(f"harmonic balance met a singular Jacobian at ω = {orbit.omega:.6g} in step {turn}, "
                                        "probably at a fold. Use fs.branch, which follows the branch around it") from None
            size = self.size(orbit, step)
            orbit, parts = self._searched(orbit, step, size, parts, count)
            if orbit.norm < 1e-3 * start or not orbit.omega > 0:
                raise NotConvergedError("the iteration fell back to steady sliding: there is no cycle near the initial guess. "
                                        "Give another start, e.g. a transient's signal: start=(t, v)")
            if size <= tol or (size <= 1e-6 and turn > 12):
                return orbit, float(np.linalg.norm(parts[0]) / np.linalg.norm(orbit.v)), turn
            if size < 0.1:
                needed = self.samples(orbit)
                if needed != count:
                    count, parts = needed, self.residual(orbit, needed)
        raise NotConvergedError(f"harmonic balance with {orbit.harmonics} harmonics did not converge: after {rounds} steps the "
                                f"last relative step was {size:.1e}, above {tol:g}. Give a better start, e.g. a "
                                "transient's signal: start=(t, v)")

    def size(self, orbit: Orbit, step: Array) -> float:
        """Relative size of a step."""
        return float(np.linalg.norm(step[:-1]) / np.linalg.norm(orbit.v) + abs(step[-1]) / orbit.omega)

    def phase(self, orbit: Orbit) -> Array:
        """Σ k Im(v̄_k δv_k) as a row over [δRe v, δIm v, δω]: no step along the orbit itself."""
        k = np.arange(1, orbit.harmonics + 1)[:, None]
        row = np.concatenate([-(k * orbit.v.imag).ravel(), (k * orbit.v.real).ravel(), [0.0]])
        return row / np.linalg.norm(row)

    def _searched(self, orbit: Orbit, step: Array, size: float, parts: tuple, count: int) -> tuple[Orbit, tuple]:
        before, factor = np.linalg.norm(parts[0]), min(1.0, 0.5 / size)
        best = None
        for _ in range(7):
            trial = orbit.at(orbit.vector + factor * step)
            if trial.omega > 0:
                found = self.residual(trial, count)
                after = np.linalg.norm(found[0])
                if best is None or after < best[0]:
                    best = (after, trial, found)
                if after <= (1 - 0.1 * factor) * before or size < 1e-7:
                    break
            factor /= 2
        assert best is not None
        return best[1], best[2]


def in_phase(orbit: Orbit) -> Orbit:
    """The same orbit, shifted in time such that its largest harmonic is real and positive (first column that moves most)."""
    column = int(np.argmax(np.linalg.norm(orbit.v, axis=0)))
    k = int(np.argmax(np.abs(orbit.v[:, column])))
    turn = -np.angle(orbit.v[k, column]) / (k + 1)
    return replace(orbit, v=orbit.v * np.exp(1j * turn * np.arange(1, orbit.harmonics + 1))[:, None])
