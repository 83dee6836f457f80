"""A small model under a contact, D + c W Wᵀ: its spectrum at any c, and the c at which rigid motion begins to drift."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg as la

from femsub.algebra import is_symmetric
from femsub.checks import EPS, Array
from femsub.model import REAL_ROOT, in_band
from femsub.modes import definite_form

if TYPE_CHECKING:
    from femsub.model import Pencil

TOGETHER = 1e-9  # relative difference of c up to which pairs cross together
MARGIN = 1e-3  # each border is verified on the pencil at c(1 ∓ MARGIN)
KEPT = 3  # decompositions of one model that are cached
FELT = 1e-10  # a shape moves the contact if |Wᵀq| exceeds this share of ‖W‖‖q‖
NO_RATIO = 2e-13  # twice a damping ratio of the size of rounding
Band = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Border:
    """A stability border: c, the k frequencies that cross there, their shapes (n, k), Re λ of the first just above and below c.

    `unstable` are the λ that grow at c = 0 already, with Im λ ≥ 0. `beyond` is the number of growing eigenvalues just below c.
    """

    c: float
    crossing: Array
    shapes: Array
    growth: tuple[float, float] = (np.nan, np.nan)
    method: str = "scalar function"
    unstable: Array = field(default_factory=lambda: np.zeros(0, dtype=complex))
    beyond: int | None = None

    @property
    def omega(self) -> float:
        return float(self.crossing[0]) if len(self.crossing) else np.nan

    @classmethod
    def none(cls, size: int, method: str = "scalar function") -> Border:
        """The border of a model that never loses its stability (c = -inf)."""
        return cls(-np.inf, np.zeros(0), np.zeros((size, 0), dtype=complex), method=method)


class Model:
    """A dense pencil in modal form under a contact: its spectrum at any c."""

    def __init__(self, pencil: Pencil, W: Array) -> None:
        form = definite_form(pencil)
        self.form, self.pencil = form, pencil
        self.W = form.shapes.T @ W
        self.contact = self.W @ self.W.T
        self.symmetric = is_symmetric(pencil.D)
        # Dissipation is summed dashpot by dashpot: in ΦᵀDΦ the rounding of a large dashpot would exceed the small ones.
        # By LDLᵀ: eigenvectors have rounding errors of the size of the largest entry everywhere.
        lower, blocks, _ = la.ldl((pencil.D + pencil.D.T) / 2, check_finite=False)
        power, turn = np.linalg.eigh(blocks)
        self.power, self.strokes = power[power != 0], (lower @ turn[:, power != 0]).T @ form.shapes
        self.size = float(np.linalg.norm(form.state(), 2)) if len(form.omega) <= 300 else float(form.omega.max())
        self._known: dict[float, tuple[Array, Array, Array]] = {}

    def decomposition(self, c: float) -> tuple[Array, Array, Array]:
        """λ, left and right vectors of the state matrix at contact coefficient c; the last few are cached."""
        if c not in self._known:
            if len(self._known) >= KEPT:
                self._known.pop(next(iter(self._known)))
            self._known[c] = la.eig(self.form.state(self.form.C + c * self.contact), left=True, right=True, check_finite=False)
        return self._known[c]

    def spectrum(self, c: float, band: Band, real: bool = False) -> tuple[Array, Array]:
        """λ with Im λ > 0 (with real=True: ≥ 0) in the band at contact coefficient c, (k,), and modal shapes q (n, k).

        For symmetric matrices Re λ is computed from the energy, see `femsub.modes.quadratic.dense.with_energy`.
        """
        values, _, right = self.decomposition(c)
        keep = ((values.imag >= 0) if real else (values.imag > 0)) & in_band(values, band)
        values, q = values[keep], right[len(self.form.omega) - self.form.rigid:, keep]
        if self.form.H is None and (self.form.sign[self.form.rigid:] > 0).all() and self.symmetric:
            gain = -(self.lost(q) + c * self.fed(q)) / np.maximum(np.linalg.norm(q, axis=0) ** 2, 1e-300) / 2
            values = np.where(values.imag != 0, gain + 1j * values.imag, values)
        return values, q

    def lost(self, q: Array) -> Array:
        """q̄ᵀCq, the power dissipated by D, without cancellation."""
        return self.power @ np.abs(self.strokes @ q) ** 2

    def fed(self, q: Array) -> Array:
        """q̄ᵀWWᵀq, the power supplied by the contact, divided by -c."""
        return (np.abs(self.W.T @ q) ** 2).sum(axis=0)

    def felt(self, q: Array) -> Array:
        """Which shapes move the contact, by more than rounding."""
        return np.linalg.norm(self.W.T @ q, axis=0) > FELT * np.linalg.norm(self.W) * np.linalg.norm(q, axis=0)

    def ranked(self, c: float, band: Band) -> Array:
        """Re λ of the modes that move the contact, the largest first; a pair counts twice, a real λ once.

        Real λ count, since a pair that grows fast enough becomes two real eigenvalues.
        """
        values, q = self.spectrum(c, band, real=True)
        moving = self.felt(q) & (np.abs(values) > 1e-12 * self.size)
        values = values[moving]
        return np.sort(np.repeat(values.real, np.where(values.imag > 0, 2, 1)))[::-1]

    def growth(self, c: float, band: Band) -> float:
        """max Re λ over the modes that move the contact."""
        return float(self.ranked(c, band).max(initial=-np.inf))

    def with_others(self, border: Border, omega: Array, shapes: Array) -> Border:
        """The border of a drift with the oscillating modes that cross with it."""
        return replace(border, crossing=np.append(border.crossing, omega), shapes=np.hstack([border.shapes, shapes]))

    def undamped(self, values: Array, q: Array) -> Array:
        """Which modes are undamped: the dashpot is at a node of the mode, or the powers of two dashpots cancel.

        A damping ratio below 1e-13, the size of rounding, counts as none.
        """
        dust = (np.abs(self.strokes) @ np.abs(q)) ** 2
        lost, either = np.abs(self.lost(q)), np.abs(self.power) @ np.abs(self.strokes @ q) ** 2
        size = np.linalg.norm(q, axis=0) ** 2
        small = lost * np.trace(self.contact) <= NO_RATIO * np.abs(values.imag) * size * self.fed(q)
        return (lost <= 1e-28 * (np.abs(self.power) @ dust)) | (lost <= 1e-13 * either) | small

    @property
    def noise(self) -> float:
        """Re λ below this is rounding."""
        return 1e-14 * self.size

    @cached_property
    def drift(self) -> Border | None:
        """The c ≤ 0 at which ZᵀDZ + c ZᵀW WᵀZ becomes singular on the rigid-body modes Z (n, r), KZ = 0; None without one.

        There a real λ passes 0, at the limit ω → 0 of the root of 1 + c G(ω): rigid motion has lost its damping and begins
        to drift. If D does not damp a rigid motion that moves the contact, any falling characteristic drives it: c = 0.
        """
        r = self.form.rigid
        if not r or np.linalg.norm(self.W[:r]) <= FELT * np.linalg.norm(self.W):
            return None
        _, damping, turn = np.linalg.svd(self.form.C[:r, :r])
        motions = np.zeros((len(self.form.omega), r))
        motions[:r] = turn.T
        z = np.abs(self.form.shapes @ motions)
        # As for elastic modes: a damping ratio below 1e-13 of the lowest one, or rounding of D's entries, counts as none.
        lowest = float(self.form.omega[r:].min(initial=np.inf)) if r < len(self.form.omega) else 0.0
        free = damping <= NO_RATIO * lowest + 1e2 * EPS * np.einsum("ij,ij->j", z, np.abs(self.pencil.D) @ z)
        loose, braked = motions[:, free], motions[:, ~free]
        if np.linalg.norm(self.W.T @ loose) > FELT * np.linalg.norm(self.W):
            return Border(0.0, np.zeros(1), (self.form.shapes @ loose @ np.linalg.svd(self.W.T @ loose)[2][0])[:, None])
        if not braked.shape[1]:
            return None
        fed = braked.T @ self.W
        answer = np.linalg.solve(braked.T @ self.form.C @ braked, fed)
        values, mix = np.linalg.eig(fed.T @ answer)
        lost = np.flatnonzero((values.real > 0) & (np.abs(values.imag) <= REAL_ROOT * values.real))
        if not len(lost):
            return None
        first = lost[np.argmax(values.real[lost])]
        c, shape = -1 / float(values.real[first]), braked @ (answer @ mix[:, first].real)
        growth = self._drifting(c * (1 - MARGIN), c, shape), self._drifting(c * (1 + MARGIN), c, shape)
        shape = self.form.shapes @ shape
        return Border(c, np.zeros(1), (shape / np.linalg.norm(shape))[:, None], growth) if growth[1] > 0 else None

    def _drifting(self, c: float, border: float, z: Array) -> float:
        """The real λ next to the solution of zᵀ(λ + C + cWWᵀ)z = 0, for a rigid motion z near the border of its drift."""
        values, _ = self.spectrum(c, (0.0, np.inf), real=True)
        values = values[values.imag == 0].real
        expected = (border - c) * np.linalg.norm(self.W.T @ z) ** 2 / (z @ z)
        return float(values[np.argmin(np.abs(values - expected))]) if len(values) else np.nan
