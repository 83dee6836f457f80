"""The stability border of a small model under a contact that feeds a port, D + c W Wᵀ: the largest c ≤ 0 at which a pair grows.

For one column it is a root of the scalar function; for several it is bracketed on the complex modes. Rigid motion begins to drift
where a real λ passes 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.linalg as la

from femsub.algebra import FEW, is_symmetric, one_thread
from femsub.checks import EPS, EQUAL, Array, NotConvergedError
from femsub.model import REAL_ROOT, Pencil, in_band
from femsub.modes import PortFunction, definite_form
from femsub.stability.crossings import ASIDE

FELT = 2**20 * EPS  # a shape moves the contact if |Wᵀq| exceeds this share of ‖W‖‖q‖
NO_RATIO = 1024 * EPS  # twice a damping ratio of the size of rounding
OUTSIDE = 0.02  # share of the band or of an edge: modes are followed so far outside, since Im λ moves with the parameter
METHOD = "bracketing"
Band = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Border:
    """A stability border: c, the k frequencies that cross there, their shapes (n, k), Re λ of the first just above and below c.

    The default values mean that stability is never lost.

    `unstable` are the λ that grow at c = 0 already, with Im λ ≥ 0. `beyond` is the number of growing eigenvalues just below c.
    """

    c: float = -np.inf
    crossing: Array = field(default_factory=lambda: np.zeros(0))
    shapes: Array = field(default_factory=lambda: np.zeros((1, 0)))
    growth: tuple[float, float] = (np.nan, np.nan)
    method: str = "scalar function"
    unstable: Array = field(default_factory=lambda: np.zeros(0, dtype=complex))
    beyond: int | None = None

    @property
    def omega(self) -> float:
        return float(self.crossing[0]) if len(self.crossing) else np.nan

    def joined(self, omega: Array, shapes: Array) -> Border:
        """The border of a drift, with the oscillating modes that cross at the same c."""
        return replace(self, crossing=np.append(self.crossing, omega), shapes=np.hstack([self.shapes, shapes]))


class ModalContact:
    """A dense pencil in modal form under a contact: its spectrum at any c."""

    def __init__(self, pencil: Pencil, W: Array) -> None:
        form = definite_form(pencil)
        self.form, self.pencil = form, pencil
        self.W = form.shapes.T @ W
        self.contact = self.W @ self.W.T
        self.symmetric = is_symmetric(pencil.D)
        # Dissipation is summed dashpot by dashpot: in ΦᵀDΦ the rounding of a large dashpot would exceed the small ones.
        # LDLᵀ is used, since all entries of eigenvectors have rounding errors of the size of the largest entry.
        lower, blocks, _ = la.ldl((pencil.D + pencil.D.T) / 2, check_finite=False)
        power, turn = np.linalg.eigh(blocks)
        self.power, self.strokes = power[power != 0], (lower @ turn[:, power != 0]).T @ form.shapes
        self.size = float(np.linalg.norm(form.state(), 2)) if len(form.omega) <= 300 else float(form.omega.max())
        self._known: dict[float, tuple[Array, Array, Array]] = {}

    def decomposition(self, c: float) -> tuple[Array, Array, Array]:
        """λ, left and right vectors of the state matrix at contact coefficient c; the last few are cached."""
        if c not in self._known:
            if len(self._known) >= 3:  # a border needs c and a value on each side of it
                self._known.pop(next(iter(self._known)))
            self._known[c] = la.eig(self.form.state(self.form.C + c * self.contact), left=True, right=True, check_finite=False)
        return self._known[c]

    def spectrum(self, c: float, band: Band, real: bool = False) -> tuple[Array, Array]:
        """λ with Im λ > 0 (with real=True: ≥ 0) in the band at contact coefficient c, (k,), and modal shapes q (n, k).

        For symmetric matrices Re λ is computed from the energy, see `ModalForm.with_energy`.
        """
        values, _, right = self.decomposition(c)
        keep = ((values.imag >= 0) if real else (values.imag > 0)) & in_band(values, band)
        values, states = values[keep], right[:, keep]
        q = states[len(self.form.omega) - self.form.rigid:]
        if self.form.is_definite and self.symmetric:
            values = self.form.with_energy(values, states, self.lost(q) + c * self.fed(q))
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

    def beside(self, c: float, omega: float, rate: float = 0.0) -> tuple[float, float]:
        """Re λ of the pair next to iω at c(1 ∓ ASIDE); for ω = 0, of the real λ with dλ/dc = -rate."""
        found = []
        for at in (c * (1 - ASIDE), c * (1 + ASIDE)):
            values, _ = self.spectrum(at, (0.0, np.inf), real=not omega)
            values = values if omega else values[values.imag == 0]
            expected = 1j * omega + (c - at) * rate
            found.append(float(values[np.argmin(np.abs(values - expected))].real) if len(values) else np.nan)
        return found[0], found[1]

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
        growth = self.beside(c, 0.0, np.linalg.norm(self.W.T @ shape) ** 2 / (shape @ shape))  # zᵀ(λ + C + cWWᵀ)z = 0
        shape = self.form.shapes @ shape
        return Border(c, np.zeros(1), (shape / np.linalg.norm(shape))[:, None], growth) if growth[1] > 0 else None


def dense_border(pencil: Pencil, W: Array, band: Band, method: str = "auto") -> Border:
    """The border of a small model from all of its modes. Method 'auto' uses the scalar function for a contact of one column."""
    with one_thread(pencil.size <= FEW):
        model = ModalContact(pencil.dense(), W)
        form = model.form
        # decided at c = 0: modes that grow, by more than some thousand roundings if D is unsymmetric or λ real
        values, q = model.spectrum(0.0, band)
        undamped = model.undamped(values, q) & (np.abs(values.real) <= 1e3 * model.noise)
        growing = [values[(values.real > (0.0 if model.symmetric else model.noise)) & ~undamped]]
        if band[0] == 0:
            every = model.decomposition(0.0)[0]
            growing.append(every[(every.imag == 0) & (every.real > 1e3 * model.noise)])
        unstable = np.concatenate(growing)
        if len(unstable):
            return Border(unstable=unstable)
        # an undamped mode that moves the contact, and rigid motion that nothing damps
        free = np.flatnonzero(model.felt(q) & undamped)
        order = free[np.argsort(values[free].imag)]
        if band[0] == 0 and model.drift is not None and model.drift.c == 0:
            return model.drift.joined(values[order].imag, form.shapes @ q[:, order])
        if len(free):
            return Border(0.0, values[order].imag, form.shapes @ q[:, order])
        border = bracketed(model, band) if method == METHOD or model.W.shape[1] > 1 else _rooted(model, band)
        if not np.isfinite(border.c):
            return border
        before, beyond = (model.ranked(border.c * factor, band) for factor in (1 - ASIDE, 1 + ASIDE))
    # defective eigenvalues lose more digits to rounding
    if (already := before.max(initial=-np.inf)) > 1e2 * model.noise:
        raise NotConvergedError(f"the border c = {border.c:.9g} (ω = {border.omega:.6g}) is not the first one: Re λ = "
                                f"{already:.3g} just before it. A pair that lost its stability outside the band has moved into "
                                "it, or one was missed. Widen the band, or use method='bracketing'")
    return replace(border, beyond=int((beyond > 1e2 * model.noise).sum()))


def _rooted(model: ModalContact, band: Band) -> Border:
    """The first root of the scalar function at which a pair begins to grow, or the drift of rigid motion if that comes first."""
    function = PortFunction.of(model.form, model.W[:, 0], model.decomposition(0.0))
    omega, c = function.crossings(*band)
    drift = model.drift if band[0] == 0 else None
    limit = -np.inf if drift is None else drift.c
    at = 0
    while at < len(c) and c[at] >= limit * (1 + EQUAL):
        group = np.flatnonzero(np.abs(c - c[at]) <= EQUAL * abs(c[at]))
        doubt = function.rounding(float(omega[at]))
        if doubt > ASIDE:
            raise NotConvergedError(f"rounding may move the border c = {c[at]:.3g} at ω = {omega[at]:.6g} by a relative "
                                    f"{doubt:.0e}. Some dashpots are much larger than the relevant damping. Fix the DOF of such "
                                    "dashpots, or leave the dashpots out")
        growth = model.beside(float(c[at]), float(omega[at]))
        if growth[1] > 0:
            group = group[np.argsort(omega[group])]
            shapes = np.stack([model.form.shapes @ function.exact(value)[2] for value in omega[group].tolist()], axis=1)
            shapes /= np.linalg.norm(shapes, axis=0)
            if drift is not None and abs(c[at] - drift.c) <= EQUAL * abs(drift.c):
                return drift.joined(omega[group], shapes)
            return Border(float(c[at]), omega[group], shapes, growth)
        at = int(group.max()) + 1
    if drift is not None:
        return drift
    # never lost, unless rounding of a large dashpot exceeds the damping of a mode that moves the contact
    values, q = model.spectrum(0.0, band)
    lost, noise = model.lost(q), EPS * np.einsum("ij,ij->j", np.abs(q), np.abs(model.form.C) @ np.abs(q))
    drowned = np.flatnonzero(model.felt(q) & (noise > ASIDE * np.abs(lost)) & ~model.undamped(values, q))
    if model.symmetric and len(drowned):
        raise NotConvergedError(f"the damping of the mode at ω = {values[drowned[0]].imag:.6g} is lost in the rounding of a "
                                "dashpot that is much larger. Fix the DOF of that dashpot, or leave it out")
    return Border()


def bracketed(model: ModalContact, band: Band) -> Border:
    """The border by steps down in c, half of the way to the next crossing predicted by dλ/dc, then by bisection on Re λ.

    Which pair crosses, and whether it does so in the band, is known only at the crossing. Pairs that cross outside the band
    are counted, and the pair with the next largest growth is followed.
    """
    contact = float(np.trace(model.contact))
    if contact == 0:
        return Border(method=METHOD)
    wide = (band[0] * (1 - OUTSIDE), band[1] * (1 + OUTSIDE))
    drift = model.drift if band[0] == 0 else None
    furthest = -1e6 * model.size / contact * len(model.form.omega)
    last = furthest if drift is None else drift.c * (1 - EQUAL)
    stable, lost, q_rows = 0.0, 0, slice(len(model.form.omega) - model.form.rigid, None)

    def grown(c: float) -> int:
        return int(np.count_nonzero(model.ranked(c, wide) > 0))

    def next_growth(c: float) -> float:
        ranked = model.ranked(c, wide)
        return float(ranked[lost]) if lost < len(ranked) else -model.size

    lost = grown(stable)
    while stable > last:
        # half of the way to the nearest c below at which, to first order, a pair crosses; or a little beyond a near one
        values, left, right = model.decomposition(stable)
        keep = (values.imag > 0) & in_band(values, wide)
        values, left, right = values[keep], left[:, keep], right[:, keep]
        with np.errstate(divide="ignore", invalid="ignore"):
            rate = -np.einsum("ij,ij->j", left[q_rows].conj(), model.contact @ right[q_rows]) / \
                np.einsum("ij,ij->j", left.conj(), right)
            places = stable - values.real / rate.real
        ahead = float(places[(rate.real < 0) & (places < stable)].max(initial=-np.inf))
        if np.isinf(ahead):
            trial = 2 * stable if stable else 1e-9 * furthest  # steps that double reach all of the way in thirty
        else:
            trial = ahead * (1 + 2e-3) if stable - ahead <= 1e-3 * abs(ahead) else stable + 0.5 * (ahead - stable)
        trial = max(trial, last)
        if grown(trial) <= lost:
            stable, lost = trial, grown(trial)
            continue
        from scipy.optimize import brentq

        c = float(brentq(next_growth, trial, stable, xtol=1e-16 * abs(trial), rtol=1e-15)) if next_growth(stable) < 0 else stable
        # the border, if a pair on the axis there has its frequency in the band: all that cross together, else the nearest
        values, q = model.spectrum(c, wide)
        values, q = values[model.felt(q)], q[:, model.felt(q)]
        fed = model.fed(q) / np.maximum(np.linalg.norm(q, axis=0) ** 2, 1e-300)
        inside, growth = in_band(values, band), np.abs(values.real)
        together = np.flatnonzero(inside & (growth <= max(model.noise, EQUAL * abs(c) * contact) * fed / contact))
        if not len(together):
            # no pair within rounding: the nearest one, if its growth is below a millionth of what the contact feeds it
            near = np.flatnonzero(inside & (growth <= 1e-6 * abs(c) * fed))
            together = near[np.argsort(growth[near])][:1]
        if len(together):
            order = together[np.argsort(values[together].imag)]
            shapes: Array = model.form.shapes @ q[:, order]
            omega = values[order].imag
            return Border(c, omega, shapes / np.linalg.norm(shapes, axis=0), model.beside(c, float(omega[0])), METHOD)
        stable, lost = min(c, stable) * (1 + EQUAL), max(grown(c * (1 + EQUAL)), lost + 1)
    return Border(method=METHOD) if drift is None else drift
