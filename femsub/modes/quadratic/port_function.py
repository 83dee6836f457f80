"""Where the eigenvalues of λ²M + λ(D + c w wᵀ) + K cross the imaginary axis: roots of a scalar function.

The contact has rank one. So on the stability border λ = iω

    1 + c G(ω) = 0,   G(ω) = iω wᵀ(-ω²M + iωD + K)⁻¹w,

so the crossings are the roots of Im G, with c = -1/G. G is evaluated in the undamped modes of the dense pencil, where -ω²M + K is
the diagonal Ω² - ω², free of cancellation. Brackets of the roots come from the poles λ_k of G, that is from the eigenvalues of
the model, on a grid as fine as their real parts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg as la

from femsub.checks import EPS, Array
from femsub.model import REAL_ROOT, in_band, widened

if TYPE_CHECKING:
    from femsub.modes.quadratic.dense import ModalForm


@dataclass(frozen=True, eq=False)
class PortFunction:
    """The function G of a dense model in modal form: the port's modal amplitudes w (n,), poles λ_k and residues."""

    form: ModalForm
    w: Array
    poles: Array
    residues: Array

    @classmethod
    def of(cls, form: ModalForm, w: Array, decomposition: tuple[Array, Array, Array] | None = None) -> PortFunction:
        """The function G of a port w (n,); `decomposition` is λ, left and right vectors of the state matrix, if known."""
        n, r = len(form.omega), form.rigid
        values, left, right = decomposition or la.eig(form.state(), left=True, right=True, check_finite=False)
        scale = np.einsum("ij,ij->j", left.conj(), right)
        with np.errstate(divide="ignore", invalid="ignore"):
            residues = (left[n - r:].conj().T @ w) * (w @ right[n - r:]) / scale
        return cls(form, w, values, np.where(np.isfinite(residues), residues, 0.0))

    def approximate(self, omega: Array) -> Array:
        """G by its partial fractions, shape (m,): fast, and accurate enough for brackets."""
        result = np.empty(len(omega), dtype=complex)
        for start in range(0, len(omega), 512):
            part = omega[start:start + 512]
            with np.errstate(divide="ignore", invalid="ignore"):  # a point may coincide with an undamped pole
                result[start:start + 512] = (self.residues / (1j * part[:, None] - self.poles)).sum(axis=1)
        return result

    def exact(self, omega: float) -> tuple[complex, complex, Array]:
        """G(ω), dG/dω and the modal shape q with P(iω)q = w."""
        s, (q, y) = 1j * omega, self._responses(omega)
        h = self.w @ q
        slope = h - s * (y @ (2 * s * q + self.form.C @ q))
        return s * h, 1j * slope, q

    def _responses(self, omega: float) -> tuple[Array, Array]:
        """q and y with P(iω)q = w and P(iω)ᵀy = w."""
        factor = la.lu_factor(self.form.at(1j * omega), check_finite=False)
        return (la.lu_solve(factor, self.w, check_finite=False), la.lu_solve(factor, self.w, trans=1, check_finite=False))

    def rounding(self, omega: float) -> float:
        """Relative change of c = -1/G(ω) if each entry of C changes by one rounding error: EPS ω |y|ᵀ|C||q| / |h|.

        Rounding in the stiffness shifts ω, and changes c by less.
        """
        q, y = self._responses(omega)
        return float(EPS * omega * np.abs(y) @ (np.abs(self.form.C) @ np.abs(q)) / np.abs(self.w @ q))

    def grid(self, lo: float, hi: float) -> Array:
        """Frequencies between which Im G should change sign at most once, judged by the poles."""
        poles = self.poles[self.poles.imag >= 0]
        centre = np.append(poles.imag, np.abs(poles[poles.imag == 0].real))
        width = np.append(np.abs(poles.real), np.abs(poles[poles.imag == 0].real))
        top = float(np.abs(self.poles).max(initial=0.0)) or 1.0
        width = np.maximum(width, 1e-14 * np.maximum(centre, 1e-6 * top))
        steps = 4.0 ** np.arange(-1, 28)
        offsets = np.concatenate([-steps[::-1], [0.0], steps])
        points = (centre[:, None] + width[:, None] * offsets).ravel()
        ordered = np.sort(centre)
        edges = [lo if lo > 0 else 1e-9 * max(min(hi, top), 1e-300), min(hi, 2 * top)]
        points = np.concatenate([points, (ordered[1:] + ordered[:-1]) / 2, np.linspace(edges[0], edges[1], 64), edges])
        return np.unique(points[(points >= edges[0]) & (points <= edges[1])])

    def crossings(self, lo: float, hi: float) -> tuple[Array, Array]:
        """(ω, c) of all crossings with lo ≤ ω ≤ hi and c < 0, largest c first; edges as in `in_band`."""
        omega = self.grid(lo * lo / widened(lo) if lo else lo, widened(hi))  # edges a little outside, for roots on them
        if len(omega) < 2:
            return np.zeros(0), np.zeros(0)
        imag = self.approximate(omega).imag
        at = np.flatnonzero(np.sign(imag[1:]) * np.sign(imag[:-1]) <= 0)
        left, right, low = omega[at], omega[at + 1], imag[at]
        for _ in range(60):
            middle = (left + right) / 2
            value = self.approximate(middle).imag
            same = np.sign(value) == np.sign(low)
            left, right, low = np.where(same, middle, left), np.where(same, right, middle), np.where(same, value, low)
        roots = (left + right) / 2
        G = self.approximate(roots)
        likely = (G.real > 0) & (np.abs(G.imag) < 1e-2 * G.real)
        rough = -1 / np.where(likely, G, -1.0).real
        found: list[tuple[float, float]] = []
        widths = np.abs(1j * roots[:, None] - self.poles).min(axis=1, initial=np.inf)
        # relative error of the approximate value: the rounding error of the pole over its distance from the axis
        doubt = 1e-6 + 20 * EPS * np.abs(self.poles).max() / np.maximum(widths, 1e-300)
        for j in sorted(np.flatnonzero(likely), key=lambda j: -rough[j]):
            # Crossings whose c is certainly below the best need no refinement. Two more are kept in reserve, in case the best
            # crosses in the wrong direction.
            if len(found) >= 3 and rough[j] < (1 + doubt[j]) * sorted(pair[1] for pair in found)[-3]:
                continue
            width = float(widths[j])
            root = self._polish(float(roots[j]), width)
            if root is not None and in_band(np.array([root[0]]), (lo, hi))[0]:
                found.append(root)
        found.sort(key=lambda pair: (-pair[1], pair[0]))
        omegas = np.array([pair[0] for pair in found])
        return omegas, np.array([pair[1] for pair in found])

    def _polish(self, omega: float, width: float) -> tuple[float, float] | None:
        """Newton's method on Im G with the exact function; None if the root is an antiresonance."""
        for _ in range(30):
            G, slope, _ = self.exact(omega)
            step = -G.imag / slope.imag if slope.imag else 0.0
            step = float(np.clip(step, -width / 2, width / 2))
            if not np.isfinite(step) or omega + step <= 0:
                return None
            omega += step
            if abs(step) <= 4e-16 * omega or abs(step) <= 1e-13 * width:
                break
        G = self.exact(omega)[0]
        c = -1 / G if G else np.inf
        # a resonance may be as narrow as the spacing of floating-point numbers at ω
        limit = REAL_ROOT + 16 * float(np.spacing(omega)) / width
        if not np.isfinite(c) or c.real >= 0 or abs(c.imag) > limit * abs(c.real):
            return None
        return omega, float(c.real)


