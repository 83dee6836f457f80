"""Harmonic balance with contacts whose force depends on displacements as well, f(u, v), and couples their columns.

With u_k = v_k / (ikω) the unknowns stay v_k and ω. The mean displacement u_0 (p,) is no unknown: it follows from

    u_0 = h(0) f_0(u_0, v),   h(0) = WᵀK⁻¹W,

by Newton's method within each evaluation. With G^u_k, G^v_k (p, p) the coefficients of ∂f/∂u and ∂f/∂v, the derivative is

    δf_k = Σ_j (G^v_{k-j} + G^u_{k-j} / (ijω)) δv_j + (G^v_{k+j} - G^u_{k+j} / (ijω)) δv̄_j + G^u_k δu_0 - (∂f/∂u ũ)_k δω / ω,

where ũ = u - u_0, and δu_0 = (I - h(0) G^u_0)⁻¹ h(0) δf_0 with the other terms of δf_0.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from femsub.checks import EPS, Array
from femsub.errors import NotConvergedError
from femsub.motion.cycles.balance import Balance, Orbit, coefficients, samples_of
from femsub.motion.cycles.compliance import Compliance
from femsub.motion.nonlinear_model import Sliding

ROUNDS = 50  # Newton steps to the mean displacement
STILL = 1e3 * EPS  # relative step at which it is reached


def balance_of(contact: Sliding, flexibility: Compliance) -> Balance:
    """The harmonic balance of belts alone, or of any contacts."""
    return CoupledBalance(contact, flexibility) if contact.others else Balance(contact, flexibility)


class CoupledBalance(Balance):
    """R(v, ω) of any contacts."""

    @cached_property
    def _belts(self) -> list[tuple[slice, Any]]:
        return list(zip(self.contact.blocks, self.contact.belts, strict=False))

    @cached_property
    def _others(self) -> list[tuple[slice, Any]]:
        return list(zip(self.contact.blocks[len(self.contact.belts):], self.contact.others, strict=True))

    @cached_property
    def _mean(self) -> Array:
        """u_0 from which Newton's method begins: that of the last orbit, at first the equilibrium's."""
        return self.contact.W.T @ self.contact.equilibrium

    def _moved(self, orbit: Orbit, count: int) -> tuple[Array, Array]:
        """ũ and v at `count` times, (p, count) each."""
        k = np.arange(1, orbit.harmonics + 1)[:, None]
        return samples_of(orbit.v / (1j * orbit.omega * k), count), orbit.samples(count)

    def _course(self, u: Array, v: Array) -> Array:
        """f at all times, (p, count); a contact that is no belt is asked time by time."""
        f = np.empty_like(v)
        for rows, belt in self._belts:
            f[rows] = belt.exerted(u[rows], v[rows])
        for rows, other in self._others:
            f[rows] = np.array([other.exerted(*pair) for pair in zip(u[rows].T, v[rows].T, strict=True)]).T
        return f

    def _tangents(self, u: Array, v: Array) -> tuple[Array, Array]:
        """∂f/∂u and ∂f/∂v at all times, (p, p, count) each."""
        found = np.zeros((2, len(v), *v.shape))
        for rows, belt in self._belts:
            at = np.arange(rows.start, rows.stop)
            found[1, at, at] = -belt.force * belt.slope_at(belt.speed - v[rows])
        for rows, other in self._others:
            parts = np.array([other.tangents(*pair) for pair in zip(u[rows].T, v[rows].T, strict=True)])
            found[:, rows, rows] = parts.transpose(1, 2, 3, 0)
        return found[0], found[1]

    def _settled(self, u: Array, v: Array) -> tuple[Array, Array]:
        """u_0, and f at all times with it."""
        mean = self._mean
        for _ in range(ROUNDS):
            f = self._course(mean[:, None] + u, v)
            rest = mean - self.contact.static[1] @ f.mean(axis=1)
            size = float(np.abs(mean).max() + np.abs(u).max())
            if np.abs(rest).max() <= STILL * size:
                self._mean = mean
                return mean, f
            of_u = self._tangents(mean[:, None] + u, v)[0].mean(axis=-1)
            mean = mean - np.linalg.solve(np.eye(len(mean)) - self.contact.static[1] @ of_u, rest)
        raise NotConvergedError(f"no mean displacement under the contacts was found: Newton's last residual is "
                                f"{np.abs(rest).max() / size:.1e} of the motion. Give another start")

    def force(self, orbit: Orbit, count: int) -> Array:
        """f at `count` equidistant times of one period, (p, count)."""
        return self._settled(*self._moved(orbit, count))[1]

    def derivative(self, orbit: Orbit, count: int, parts: tuple[Array, Array, Array, Array]) -> Array:
        """dR/d[Re v, Im v, ω], shape (2Hp, 2Hp + 1)."""
        H, p = orbit.v.shape
        _, Y, slope, f = parts
        u, v = self._moved(orbit, count)
        of_u, of_v = self._tangents(self._settled(u, v)[0][:, None] + u, v)
        Gu, Gv = (coefficients(part.reshape(p * p, count), 2 * H).reshape(-1, p, p) for part in (of_u, of_v))
        k, j = np.arange(H + 1)[:, None], np.arange(1, H + 1)
        lag, turn = k - j, 1 / (1j * orbit.omega * j)[:, None, None]

        def at(G: Array) -> Array:
            return np.where((lag >= 0)[..., None, None], G[np.abs(lag)], G[np.abs(lag)].conj())

        one, two = at(Gv) + at(Gu) * turn, Gv[k + j] - Gu[k + j] * turn  # (H + 1, H, p, p)
        fed = coefficients(np.einsum("abm,bm->am", of_u, u), H) / -orbit.omega  # by ω, (H + 1, p)
        static = self.contact.static[1]
        mean = Gu @ np.linalg.solve(np.eye(p) - static @ Gu[0].real, static)  # δf_k of δf_0, (2H + 1, p, p)
        one, two = (part[1:] + np.einsum("kab,jbc->kjac", mean[1:H + 1], part[0]) for part in (one, two))
        fed = fed[1:] + np.einsum("kab,b->ka", mean[1:H + 1], fed[0])
        J = np.empty((2, H, p, 2, H, p))
        for part, sign, unit in ((0, 1, 1.0), (1, -1, 1j)):
            change = -unit * np.einsum("kia,kjac->kijc", Y, one + sign * two)
            J[0, :, :, part], J[1, :, :, part] = change.real, change.imag
        J = J.reshape(2 * H * p, 2 * H * p) + np.eye(2 * H * p)
        omega = -np.einsum("kij,kj->ki", slope, f) - np.einsum("kij,kj->ki", Y, fed)
        return np.hstack([J, np.concatenate([omega.real.ravel(), omega.imag.ravel()])[:, None]])
