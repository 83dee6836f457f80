"""A small model under a contact, D + c W Wᵀ: its spectrum at any c, and where its rigid motion begins to drift."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg as la

from femsub.checks import EPS, Array
from femsub.model.bands import REAL_ROOT, in_band
from femsub.model.matrices import is_symmetric
from femsub.quadratic.dense import definite_form

if TYPE_CHECKING:
    from femsub.model.pencil import Pencil

TOGETHER = 1e-9  # pairs whose c agree to this, relatively, cross together
MARGIN = 1e-3  # each border is verified on the pencil at c(1 ∓ MARGIN)
KEPT = 3  # decompositions of one model
FELT = 1e-10  # of ‖W‖‖q‖ that a shape moves the contact by, at least
NO_RATIO = 2e-13  # twice a damping ratio of the size of rounding
Band = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Border:
    """c, the frequencies that cross there, the shape of the first, Re λ just above and below c."""

    c: float
    crossing: Array
    shape: Array
    growth: tuple[float, float] = (np.nan, np.nan)
    method: str = "scalar function"

    @property
    def omega(self) -> float:
        return float(self.crossing[0]) if len(self.crossing) else np.nan

    @classmethod
    def none(cls, size: int, method: str = "scalar function") -> Border:
        """That of a model which never loses its stability."""
        return cls(-np.inf, np.zeros(0), np.zeros(size, dtype=complex), method=method)


class Model:
    """A dense pencil in modal form under a contact: its spectrum at any c."""

    def __init__(self, pencil: Pencil, W: Array) -> None:
        form = definite_form(pencil)
        self.form, self.pencil = form, pencil
        self.W = form.shapes.T @ W
        self.contact = self.W @ self.W.T
        self.symmetric = is_symmetric(pencil.D)
        # Power is taken dashpot by dashpot: in modal coordinates, ΦᵀDΦ, a heavy one drowns the little power of all others.
        # LDLᵀ and not eigenvectors, whose rounding is that of the largest entry everywhere.
        lower, blocks, _ = la.ldl((pencil.D + pencil.D.T) / 2, check_finite=False)
        power, turn = np.linalg.eigh(blocks)
        self.power, self.strokes = power[power != 0], (lower @ turn[:, power != 0]).T @ form.shapes
        self.size = float(np.linalg.norm(form.state(), 2)) if len(form.omega) <= 300 else float(form.omega.max())
        self._known: dict[float, tuple[Array, Array, Array]] = {}

    def decomposition(self, c: float) -> tuple[Array, Array, Array]:
        """λ, left and right vectors of the state matrix at contact coefficient c; those asked for last are kept."""
        if c not in self._known:
            if len(self._known) >= KEPT:
                self._known.pop(next(iter(self._known)))
            self._known[c] = la.eig(self.form.state(self.form.C + c * self.contact), left=True, right=True, check_finite=False)
        return self._known[c]

    def spectrum(self, c: float, band: Band, real: bool = False) -> tuple[Array, Array]:
        """λ with Im λ > 0 (with real=True: ≥ 0) in the band at contact coefficient c, (k,), and modal shapes q (n, k).

        For symmetric matrices Re λ is taken from its energy, see `femsub.quadratic.dense.with_energy`.
        """
        values, _, right = self.decomposition(c)
        keep = ((values.imag >= 0) if real else (values.imag > 0)) & in_band(values, band)
        values, q = values[keep], right[len(self.form.omega) - self.form.rigid:, keep]
        if self.form.H is None and (self.form.sign[self.form.rigid:] > 0).all() and self.symmetric:
            gain = -(self.lost(q) + c * self.fed(q)) / np.maximum(np.linalg.norm(q, axis=0) ** 2, 1e-300) / 2
            values = np.where(values.imag != 0, gain + 1j * values.imag, values)
        return values, q

    def lost(self, q: Array) -> Array:
        """q̄ᵀCq, the power that D takes, without cancellation."""
        return self.power @ np.abs(self.strokes @ q) ** 2

    def fed(self, q: Array) -> Array:
        """q̄ᵀWWᵀq, what the contact feeds in per -c."""
        return (np.abs(self.W.T @ q) ** 2).sum(axis=0)

    def felt(self, q: Array) -> Array:
        """Which shapes move the contact, by more than rounding."""
        return np.linalg.norm(self.W.T @ q, axis=0) > FELT * np.linalg.norm(self.W) * np.linalg.norm(q, axis=0)

    def ranked(self, c: float, band: Band) -> Array:
        """Re λ of what moves the contact, the largest first; a pair counts twice, and a real λ once.

        Real λ count: of a pair that grows fast enough two of them are what is left.
        """
        values, q = self.spectrum(c, band, real=True)
        moving = self.felt(q) & (np.abs(values) > 1e-12 * self.size)
        values = values[moving]
        return np.sort(np.repeat(values.real, np.where(values.imag > 0, 2, 1)))[::-1]

    def growth(self, c: float, band: Band) -> float:
        """max Re λ over what moves the contact."""
        return float(self.ranked(c, band).max(initial=-np.inf))

    def undamped(self, values: Array, q: Array) -> Array:
        """Which modes lose no power to D: a dashpot at a node of the mode, or the power of two cancelling.

        A slope so small that it could not turn a damping ratio of 1e-13, of the size of rounding, counts as none, too.
        """
        dust = (np.abs(self.strokes) @ np.abs(q)) ** 2
        lost, either = np.abs(self.lost(q)), np.abs(self.power) @ np.abs(self.strokes @ q) ** 2
        size = np.linalg.norm(q, axis=0) ** 2
        small = lost * np.trace(self.contact) <= NO_RATIO * np.abs(values.imag) * size * self.fed(q)
        return (lost <= 1e-28 * (np.abs(self.power) @ dust)) | (lost <= 1e-13 * either) | small

    @property
    def noise(self) -> float:
        """Re λ below which a number is rounding."""
        return 1e-14 * self.size

    @cached_property
    def drift(self) -> Border | None:
        """The c ≤ 0 at which ZᵀDZ + c ZᵀW WᵀZ becomes singular on the rigid-body modes Z (n, r), KZ = 0; None without one.

        There a real λ passes 0, which is where the root of 1 + c G(ω) for ω → 0 lies: rigid motion that has lost the
        damping it had begins to drift. Where D takes nothing from a motion that the contact feels, any falling
        characteristic drives it: c = 0.
        """
        r = self.form.rigid
        if not r or np.linalg.norm(self.W[:r]) <= FELT * np.linalg.norm(self.W):
            return None
        _, damping, turn = np.linalg.svd(self.form.C[:r, :r])
        motions = np.zeros((len(self.form.omega), r))
        motions[:r] = turn.T
        z = np.abs(self.form.shapes @ motions)
        # As for elastic modes: damping that could not turn a ratio of 1e-13 of the lowest one, or is rounding of D's entries.
        lowest = float(self.form.omega[r:].min(initial=np.inf)) if r < len(self.form.omega) else 0.0
        free = damping <= NO_RATIO * lowest + 1e2 * EPS * np.einsum("ij,ij->j", z, np.abs(self.pencil.D) @ z)
        loose, braked = motions[:, free], motions[:, ~free]
        if np.linalg.norm(self.W.T @ loose) > FELT * np.linalg.norm(self.W):
            return Border(0.0, np.zeros(1), self.form.shapes @ loose @ np.linalg.svd(self.W.T @ loose)[2][0])
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
        return Border(c, np.zeros(1), shape / np.linalg.norm(shape), growth) if growth[1] > 0 else None

    def _drifting(self, c: float, border: float, z: Array) -> float:
        """The real λ next to what zᵀ(λ + C + cWWᵀ)z = 0 says, for a rigid motion z near the border of its drift."""
        values, _ = self.spectrum(c, (0.0, np.inf), real=True)
        values = values[values.imag == 0].real
        expected = (border - c) * np.linalg.norm(self.W.T @ z) ** 2 / (z @ z)
        return float(values[np.argmin(np.abs(values - expected))]) if len(values) else np.nan
