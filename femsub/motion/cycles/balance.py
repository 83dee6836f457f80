"""Harmonic balance, condensed onto the contacts: a periodic speed of their columns and its frequency.

With v(t) = Σ_{0<|k|≤H} v_k e^{ikωt} (p,) and f_k the Fourier coefficients of f(u(t), v(t)), the linear model answers

    R_k = v_k - Y(ikω) f_k = 0,  k = 1 … H,   Y(s) = s Wᵀ(s²M + sD + K)⁻¹W

The unknowns are v_k and ω, 2Hp + 1 real numbers for a model of any size. f_k is computed by alternating frequency and time: an
inverse FFT gives samples of v, f is evaluated there, and an FFT gives f_k. Forces that depend on displacements need
u_k = v_k / (ikω) and a mean u_0 (p,). The mean is not an unknown, but follows from

    u_0 = h(0) f_0(u_0, v),   h(0) = WᵀK⁻¹W,

by Newton's method within each evaluation, which starts from the mean of a nearby orbit. (If forces do not depend on u, the mean
force only shifts the mean displacement.) The Jacobian is exact. With the coefficients G^u_k, G^v_k (p, p) of ∂f/∂u and ∂f/∂v, and
with ũ = u - u_0,

    δf_k = Σ_j (G^v_{k-j} + G^u_{k-j} / (ijω)) δv_j + (G^v_{k+j} - G^u_{k+j} / (ijω)) δv̄_j + G^u_k δu_0 - (∂f/∂u ũ)_k δω / ω,

where δu_0 = (I - h(0) G^u_0)⁻¹ h(0) δf_0 with the other terms of δf_0, and dR/dω = -ik Y'(ikω) f_k at a constant f.

Cameron and Griffin, J. Appl. Mech. 56 (1989) 149 (alternating frequency/time); Krack and Gross, Harmonic Balance for
Nonlinear Vibration Problems, Springer 2019, ch. 2 to 4 (condensation, continuation).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.linalg as la

from femsub.checks import EPS, Array, NotConvergedError
from femsub.motion.cycles.compliance import NEGLECTED, Compliance
from femsub.motion.nonlinear_model import Sliding


@dataclass(frozen=True, eq=False)
class Orbit:
    """The unknowns of harmonic balance: v_k (H, p), k = 1 … H, and ω; and a mean u_0 (p,), the start of the search for u_0.

    Without a mean, the search starts from the equilibrium. Forces that do not depend on u need no mean.
    """

    v: Array
    omega: float
    mean: Array | None = None

    @property
    def harmonics(self) -> int:
        return len(self.v)

    @property
    def s(self) -> Array:
        """ikω (H,)."""
        return 1j * self.omega * np.arange(1, self.harmonics + 1)

    @cached_property
    def norm(self) -> float:
        """Root mean square of v over one period, summed over the columns."""
        return float(np.sqrt(2) * np.linalg.norm(self.v))

    @property
    def periods(self) -> int:
        """The number of periods of the motion within 2π/ω: the greatest common divisor of all k with v_k above rounding."""
        size = np.abs(self.v).max(axis=1)
        return max(1, int(np.gcd.reduce(1 + np.flatnonzero(size > EPS**0.5 * size.max()))))

    @property
    def vector(self) -> Array:
        """[Re v, Im v, ω] (2Hp + 1,)."""
        return np.append(parts_of(self.v), self.omega)

    def at(self, x: Array) -> Orbit:
        """The orbit of a vector of the same shape."""
        half = (len(x) - 1) // 2
        return replace(self, v=(x[:half] + 1j * x[half:-1]).reshape(self.v.shape), omega=float(x[-1]))

    def with_harmonics(self, count: int) -> Orbit:
        """The orbit truncated, or padded with zeros."""
        v = np.zeros((count, self.v.shape[1]), dtype=complex)
        v[:min(count, len(self.v))] = self.v[:count]
        return replace(self, v=v)

    def samples(self, count: int) -> Array:
        """v at `count` equidistant times of one period, (p, count)."""
        return samples_of(self.v, count)


def parts_of(v: Array) -> Array:
    """[Re v, Im v] (2Hp,) of v (H, p)."""
    return np.concatenate([v.real.ravel(), v.imag.ravel()])


def samples_of(v: Array, count: int) -> Array:
    """Σ_k v_k e^{ikτ} + conjugate at τ = 2πj/count, (H, p) to (p, count)."""
    spectrum = np.zeros((v.shape[1], count // 2 + 1), dtype=complex)
    kept = min(len(v), count // 2)
    spectrum[:, 1:kept + 1] = v[:kept].T
    return np.fft.irfft(spectrum * count, n=count, axis=1)


def power_of_two(least: int) -> int:
    """The smallest power of two that is at least `least`, the best length for an FFT."""
    return 1 << (least - 1).bit_length()


def coefficients(samples: Array, count: int) -> Array:
    """Coefficients k = 0 … count of (p, m) samples, (count + 1, p)."""
    return np.fft.rfft(samples, axis=1)[:, :count + 1].T / samples.shape[1]


class Course(NamedTuple):
    """u - u_0, v and f at equidistant times of one period, (p, count) each, and u_0 (p,); u is None if f depends on v only."""

    u: Array | None
    v: Array
    f: Array
    mean: Array | None


class Terms(NamedTuple):
    """R (H, p), Y and dY/dω (H, p, p), f_k (H, p) and the course of one orbit."""

    R: Array
    Y: Array
    slope: Array
    f: Array
    course: Course


class StepsEndedError(NotConvergedError):
    """Newton's steps did not become small, or led to steady sliding. They ended at `orbit`, with `residual` = ‖R‖/‖v‖."""

    def __init__(self, message: str, orbit: Orbit, residual: float) -> None:
        super().__init__(message)
        self.orbit, self.residual = orbit, residual


class Balance:
    """R(v, ω) for contacts and the compliance of one model, with its derivatives, from up to `most` samples per period."""

    def __init__(self, contact: Sliding, flexibility: Compliance, most: int = 2**17) -> None:
        self.contact, self.flexibility, self.most = contact, flexibility, most

    def course(self, orbit: Orbit, count: int) -> Course:
        """The motion of the columns and f over one period, with the mean displacement u_0 computed."""
        v = orbit.samples(count)
        if self.contact.by_speed:
            return Course(None, v, self.contact.exerted(v, v), None)
        u = samples_of(orbit.v / orbit.s[:, None], count)
        begin = self.contact.W.T @ self.contact.equilibrium if orbit.mean is None else orbit.mean
        mean, f = self.contact.mean(u, v, begin)
        return Course(u, v, f, mean)

    def force(self, orbit: Orbit, count: int) -> Array:
        """f at `count` equidistant times of one period, (p, count)."""
        return self.course(orbit, count).f

    def samples(self, orbit: Orbit) -> int:
        """The number of samples, a power of two, for which R is free of aliasing."""
        H = orbit.harmonics
        count = power_of_two(max(64, 4 * H + 2))
        f = coefficients(self.force(orbit, count), H)
        Y = self.flexibility.estimate(orbit.s)
        while count < self.most:
            finer = coefficients(self.force(orbit, 2 * count), H)
            error = np.einsum("kij,kj->ki", Y, (finer - f)[1:])
            if np.linalg.norm(error) <= NEGLECTED * np.linalg.norm(orbit.v):
                break
            count, f = 2 * count, finer
        return count

    def residual(self, orbit: Orbit, count: int) -> Terms:
        """R, and the terms from which it is computed."""
        Y, slope = self.flexibility.mobility(orbit.s)
        course = self.course(orbit, count)
        f = coefficients(course.f, orbit.harmonics)[1:]
        return Terms(orbit.v - np.einsum("kij,kj->ki", Y, f), Y, (orbit.s / orbit.omega)[:, None, None] * slope, f, course)

    def derivative(self, orbit: Orbit, terms: Terms) -> Array:
        """dR/d[Re v, Im v, ω], shape (2Hp, 2Hp + 1)."""
        H, p = orbit.v.shape
        omega = -np.einsum("kij,kj->ki", terms.slope, terms.f)
        one, two, fed = self._linear(orbit, terms.course)
        if fed is not None:
            omega -= np.einsum("kij,kj->ki", terms.Y, fed)
        J = np.empty((2, H, p, 2, H * p))
        for part, sign, unit in ((0, 1, 1.0), (1, -1, 1j)):
            change = -unit * (terms.Y @ (one + sign * two).reshape(H, p, H * p))
            J[0, :, :, part], J[1, :, :, part] = change.real, change.imag
        J = J.reshape(2 * H * p, 2 * H * p)
        J[np.diag_indices(len(J))] += 1.0
        return np.hstack([J, parts_of(omega)[:, None]])

    def system(self, orbit: Orbit, terms: Terms) -> tuple[Array, Array]:
        """R and 0 for the phase condition Σ k Im(v̄_k δv_k) = 0, (2Hp + 1,), and their Jacobian (2Hp + 1, 2Hp + 1).

        The condition excludes steps along the orbit, which only shift it in time.
        """
        phase = np.append(parts_of(orbit.s[:, None] * orbit.v), 0.0)
        return np.append(parts_of(terms.R), 0.0), np.vstack([self.derivative(orbit, terms), phase / np.linalg.norm(phase)])

    def _linear(self, orbit: Orbit, course: Course) -> tuple[Array, Array, Array | None]:
        """∂f_k/∂v_j and ∂f_k/∂v̄_j (H, p, H, p), and ∂f_k/∂ω (H, p), which is None if it is 0."""
        H, j = orbit.harmonics, np.arange(1, orbit.harmonics + 1)
        if course.u is None or course.mean is None:
            return *_around(self.contact.tangents(course.v, course.v)[1], j[:, None], j), None
        k = np.arange(H + 1)[:, None]
        of_u, of_v = self.contact.tangents(course.mean[:, None] + course.u, course.v)
        turn, static = 1 / orbit.s[:, None], self.contact.static[1]
        (one, two), (less, more) = _around(of_v, k, j), _around(of_u, k, j)
        one, two = one + less * turn, two - more * turn
        fed = coefficients(np.einsum("abm,bm->am", of_u, course.u), H) / -orbit.omega
        Gu = _transformed(of_u, H)
        mean = Gu @ np.linalg.solve(np.eye(len(static)) - static @ Gu[0].real, static)  # δf_k of δf_0, (H + 1, p, p)
        one, two = (part[1:] + np.einsum("kab,bjc->kajc", mean[1:], part[0]) for part in (one, two))
        return one, two, fed[1:] + np.einsum("kab,b->ka", mean[1:], fed[0])

    def unresolved(self, orbit: Orbit, target: float = 0.0, *, kept: bool = False) -> tuple[float, float, int]:
        """Errors relative to v: truncation ‖Y_k f_k‖ over k > H, and aliasing of k ≤ H; and a sufficient number of harmonics.

        With `kept`, the truncation includes the change of the kept harmonics and of ω by the neglected harmonics. It is infinite
        at a singular Jacobian. The sufficient number reduces the truncation to `target`, by default to a tenth of its value. It
        is estimated from the f_k of this orbit, with the assumption that both parts of the truncation fall in proportion.
        """
        H = orbit.harmonics
        used = self.samples(orbit)
        count = min(2 * self.most, 4 * used)
        top = count // 4
        f = coefficients(self.force(orbit, count), top)[1:]
        coarse = coefficients(self.force(orbit, used), H)[1:]
        Y = self.flexibility.estimate(1j * orbit.omega * np.arange(1, top + 1))
        answer = np.einsum("kij,kj->ki", Y, f)
        rest = np.linalg.norm(answer, axis=1)
        size = float(np.linalg.norm(orbit.v)) or 1.0
        beyond = np.sqrt(np.cumsum(rest[::-1] ** 2)[::-1]) / size  # the norm over all harmonics from k on
        tail = float(beyond[H]) if top > H else 0.0
        truncation = tail
        if kept:  # the Newton step with the neglected harmonics in the friction
            terms, whole = self.residual(orbit, used), replace(orbit, v=np.vstack([orbit.v, answer[H:]]))
            R, J = self.system(orbit, terms)
            changed = coefficients(self.force(whole, 4 * whole.harmonics), H)[1:]
            R[:-1] = parts_of(orbit.v - np.einsum("kij,kj->ki", terms.Y, changed))
            try:
                step = la.solve(J, R, check_finite=False)
                truncation += float(np.linalg.norm(step[:-1]) / np.linalg.norm(parts_of(orbit.v)) + abs(step[-1]) / orbit.omega)
            except (la.LinAlgError, ValueError):
                truncation = np.inf
        enough = np.flatnonzero(beyond * truncation <= (target or 0.1 * truncation) * tail)
        alias = float(np.linalg.norm(np.einsum("kij,kj->ki", Y[:H], coarse - f[:H]))) / size
        return truncation, alias, int(enough[0]) if len(enough) else top

    def solve(self, orbit: Orbit, *, rounds: int = 40, tol: float = 1e-9) -> tuple[Orbit, float, int]:
        """The orbit from Newton's method with a line search on `system` up to a relative step `tol`, ‖R‖/‖v‖ and the step count.

        Raises
        ------
        NotConvergedError
            The steps did not become small, or v became 0, which is steady sliding.
        """
        start, count = orbit.norm, self.samples(orbit)
        terms = self.residual(orbit, count)
        for turn in range(1, rounds + 1):
            R, J = self.system(orbit, terms)
            try:
                step = -la.solve(J, R, check_finite=False)
            except (la.LinAlgError, ValueError):
                raise NotConvergedError(f"harmonic balance met a singular Jacobian at ω = {orbit.omega:.6g} in step {turn}, "
                                        "probably at a fold. Use fs.branch, which follows the branch around it") from None
            size = float(np.linalg.norm(step[:-1]) / np.linalg.norm(orbit.v) + abs(step[-1]) / orbit.omega)
            # line search: a step of at most half the orbit is halved until ‖R‖ falls by a tenth of the decrease of a linear R
            before, factor, best = np.linalg.norm(terms.R), min(1.0, 0.5 / size), None
            for _ in range(7):
                trial = orbit.at(orbit.vector + factor * step)
                if trial.omega > 0:
                    found = self.residual(trial, count)
                    after = np.linalg.norm(found.R)
                    if best is None or after < best[0]:
                        best = after, replace(trial, mean=found.course.mean), found
                    if after <= (1 - 0.1 * factor) * before or size < NEGLECTED:  # for so small a step R is only rounding
                        break
                factor /= 2
            assert best is not None  # ω stays positive with a short step
            _, orbit, terms = best
            off = float(np.linalg.norm(terms.R) / np.linalg.norm(orbit.v))
            if orbit.norm < 1e-3 * start or not orbit.omega > 0:  # as after ten steps that halve the orbit
                raise StepsEndedError(f"with {orbit.harmonics} harmonics the iteration fell back to steady sliding: there is no "
                                      "cycle near the initial guess. Give another start, such as a transient: start=(t, v), "
                                      f"or more (harmonics={2 * orbit.harmonics}). fs.shoot needs no harmonics", orbit, off)
            if size <= tol or (size <= 1e-6 and turn > 12):  # converged, up to rounding or a kink of f
                return orbit, off, turn
            if size < 0.1:  # near a cycle, its number of samples is known
                needed = self.samples(orbit)
                if needed != count:
                    count, terms = needed, self.residual(orbit, needed)
        raise StepsEndedError(f"harmonic balance with {orbit.harmonics} harmonics did not converge: after {rounds} steps the "
                              f"last relative step was {size:.1e}, above {tol:g}. Give more (harmonics={2 * orbit.harmonics}), "
                              "or a start nearer to the cycle, such as a transient's signal: start=(t, v). fs.shoot needs "
                              "no harmonics", orbit, off)


def _transformed(course: Array, count: int) -> Array:
    """G_k, k = 0 … count, of matrices (p, p, m) at m times, (count + 1, p, p)."""
    p = len(course)
    return coefficients(course.reshape(p * p, -1), count).reshape(-1, p, p)


def _around(course: Array, k: Array, j: Array) -> tuple[Array, Array]:
    """G_{k-j} and G_{k+j} of matrices (p, p, m) at m times, for rows k and columns j: (K, p, H, p)."""
    count = 2 * len(j)
    G = _transformed(course, count)
    whole = np.concatenate([G[:0:-1].conj(), G])  # from -count on
    one, two = whole[k - j + count], G[k + j]
    return one.transpose(0, 2, 1, 3), two.transpose(0, 2, 1, 3)


def in_phase(orbit: Orbit) -> Orbit:
    """The same orbit, shifted in time so that the largest harmonic of the column that moves most is real and positive."""
    column = int(np.argmax(np.linalg.norm(orbit.v, axis=0)))
    k = int(np.argmax(np.abs(orbit.v[:, column])))
    turn = -np.angle(orbit.v[k, column]) / (k + 1)
    return replace(orbit, v=orbit.v * np.exp(1j * turn * np.arange(1, orbit.harmonics + 1))[:, None])
