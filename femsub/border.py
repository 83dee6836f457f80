"""The border of stability of a pencil under D + c W Wᵀ: on a dense one, and on a sparse one through a growing basis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la

from femsub.bases.basis import independent
from femsub.cea import complex_modes
from femsub.crossing import PortFunction
from femsub.eigen import lowest_modes, modes_below
from femsub.errors import NotConvergedError, UnstableModelError
from femsub.factor import complex_solve
from femsub.friction import contact_damping
from femsub.pencil import EPS, Array, Pencil, is_symmetric
from femsub.qep import definite_form, eigenvalues
from femsub.shift_invert import ShiftInvert
from femsub.substructure import Substructure

TOGETHER = 1e-9  # pairs whose c agree to this, relatively, cross together
ROUNDS = 8  # in which the basis of a large model may grow
MARGIN = 1e-3  # each border is verified on the pencil at c(1 ∓ MARGIN)
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

    def spectrum(self, c: float, band: Band, real: bool = False) -> tuple[Array, Array]:
        """λ with Im λ > 0 (with real=True: ≥ 0) in the band at contact coefficient c, (k,), and modal shapes q (n, k).

        For symmetric matrices Re λ is taken from its energy, see `qep.with_energy`.
        """
        C = self.form.C + c * self.contact
        values, right = np.linalg.eig(self.form.state(C))
        keep = ((values.imag >= 0) if real else (values.imag > 0)) & (values.imag >= band[0]) & (values.imag <= band[1])
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
        return np.linalg.norm(self.W.T @ q, axis=0) > 1e-10 * np.linalg.norm(self.W) * np.linalg.norm(q, axis=0)

    def growth(self, c: float, band: Band) -> float:
        """max Re λ over what moves the contact. Real λ count: an overdamped mode may be first to be seen unstable."""
        values, q = self.spectrum(c, band, real=True)
        return float(values.real[self.felt(q) & (np.abs(values) > 1e-12 * self.size)].max(initial=-np.inf))

    def undamped(self, values: Array, q: Array) -> Array:
        """Which modes lose no power to D: a dashpot at a node of the mode, or the power of two cancelling.

        A slope so small that it could not turn a damping ratio of 1e-13, of the size of rounding, counts as none, too.
        """
        dust = (np.abs(self.strokes) @ np.abs(q)) ** 2
        lost, either = np.abs(self.lost(q)), np.abs(self.power) @ np.abs(self.strokes @ q) ** 2
        size = np.linalg.norm(q, axis=0) ** 2
        small = lost * np.trace(self.contact) <= 2e-13 * np.abs(values.imag) * size * self.fed(q)
        return (lost <= 1e-28 * (np.abs(self.power) @ dust)) | (lost <= 1e-13 * either) | small

    @property
    def noise(self) -> float:
        """Re λ below which a number is rounding."""
        return 1e-14 * self.size


def dense_border(pencil: Pencil, W: Array, band: Band, bracketing: bool) -> Border:
    """The border of a small model, every mode of which is at hand."""
    model = Model(pencil.dense(), W)
    start = _at_rest(model, band)
    if start is not None:
        return start
    if bracketing:
        return _bracketed(model, band)
    return _rooted(model, band)


def _at_rest(model: Model, band: Band) -> Border | None:
    """The cases that are decided at c = 0: unstable there, or an undamped mode that feels the contact."""
    form = model.form
    values, q = model.spectrum(0.0, band)
    undamped = model.undamped(values, q) & (np.abs(values.real) <= 1e3 * model.noise)
    growing = [values[(values.real > (0.0 if model.symmetric else model.noise)) & ~undamped]]
    if band[0] == 0:
        every = eigenvalues(form)
        growing.append(every[(every.imag == 0) & (every.real > 1e3 * model.noise)])
    unstable = np.concatenate(growing)
    if len(unstable):
        worst = unstable[np.argmax(unstable.real)]
        raise UnstableModelError(f"the model is unstable before the belt acts: λ = {worst.real:.6g} {worst.imag:+.6g}i; a border "
                                 "is sought from a stable state at c = 0 downwards")
    free = np.flatnonzero(model.felt(q) & undamped)
    if not len(free):
        return None
    order = free[np.argsort(values[free].imag)]
    return Border(0.0, values[order].imag, form.shapes @ q[:, order[0]])


def _rooted(model: Model, band: Band) -> Border:
    function = PortFunction.of(model.form, model.W[:, 0])
    omega, c = function.crossings(*band)
    at = 0
    while at < len(c):
        group = np.flatnonzero(np.abs(c - c[at]) <= TOGETHER * abs(c[at]))
        doubt = function.rounding(float(omega[at]))
        if doubt > MARGIN:
            raise NotConvergedError(f"rounding may move the border c = {c[at]:.3g} at ω = {omega[at]:.6g} by {doubt:.0e} of "
                                    "itself: some damping is so much heavier than what counts; hold DOF with such dashpots, "
                                    "or leave them out")
        growth = _verify(model, float(c[at]), float(omega[at]), band)
        if growth[1] > 0:
            already = model.growth(c[at] * (1 - MARGIN), band)
            if already > 1e2 * model.noise:
                raise NotConvergedError(f"at c = {c[at]:.9g} (ω = {omega[at]:.6g}) the model is unstable already: "
                                        f"Re λ = {already:.3g} just before; use method='bracketing'")
            first = group[np.argmin(omega[group])]
            shape = model.form.shapes @ function.exact(float(omega[first]))[2]
            return Border(float(c[at]), np.sort(omega[group]), shape / np.linalg.norm(shape), growth)
        at = int(group[-1]) + 1
    _check_damping(model, band)
    return Border(-np.inf, np.zeros(0), np.zeros(model.pencil.size, dtype=complex))


def _check_damping(model: Model, band: Band) -> None:
    """Where a heavy dashpot has drowned the damping of a mode that feels the contact, nothing can be said of its border."""
    values, q = model.spectrum(0.0, band)
    lost, noise = model.lost(q), EPS * np.einsum("ij,ij->j", np.abs(q), np.abs(model.form.C) @ np.abs(q))
    drowned = np.flatnonzero(model.felt(q) & (noise > MARGIN * np.abs(lost)) & ~model.undamped(values, q))
    if model.symmetric and len(drowned):
        raise NotConvergedError(f"the damping of the mode at ω = {values[drowned[0]].imag:.6g} is lost in the rounding of a "
                                "dashpot that is so much heavier: hold the DOF of that dashpot, or leave it out")


def _verify(model: Model, c: float, omega: float, band: Band) -> tuple[float, float]:
    """Re λ of the pair next to iω at c(1 - 1e-3) and at c(1 + 1e-3)."""
    pair = []
    for factor in (1 - MARGIN, 1 + MARGIN):
        values, _ = model.spectrum(c * factor, (0.0, np.inf))
        pair.append(float(values[np.argmin(np.abs(values - 1j * omega))].real))
    return pair[0], pair[1]


def _bracketed(model: Model, band: Band) -> Border:
    """Steps down in c, half of the way to the next crossing that dλ/dc foretells, then bisection on max Re λ."""
    contact = float(np.trace(model.contact))
    if contact == 0:
        return Border(-np.inf, np.zeros(0), np.zeros(model.pencil.size, dtype=complex), method="bracketing")
    furthest = -1e6 * model.size / contact * len(model.form.omega)
    stable = 0.0
    unstable: float | None = None
    while stable > furthest:
        ahead = _foretold(model, stable, band)
        if np.isinf(ahead):
            trial = 2 * stable if stable else 1e-3 * furthest * 1e-6
        elif stable - ahead <= 1e-3 * abs(ahead):
            trial = ahead * (1 + 2e-3)
        else:
            trial = stable + 0.5 * (ahead - stable)
        if model.growth(trial, band) > 0:
            unstable = trial
            break
        stable = trial
    if unstable is None:
        return Border(-np.inf, np.zeros(0), np.zeros(model.pencil.size, dtype=complex), method="bracketing")
    from scipy.optimize import brentq

    c = float(brentq(lambda value: model.growth(value, band), unstable, stable, xtol=1e-16 * abs(unstable), rtol=1e-15))
    values, q = model.spectrum(c, band)
    values, q = values[model.felt(q)], q[:, model.felt(q)]
    slack = max(model.noise, 1e-9 * abs(c) * contact)
    together = np.flatnonzero(np.abs(values.real) <= slack * np.einsum("ij,ij->j", q.conj(), model.contact @ q).real
                              / np.einsum("ij,ij->j", q.conj(), q).real / contact)
    near = int(np.argmax(values.real))
    order = together[np.argsort(values[together].imag)] if near in together else np.array([near])
    shape = model.form.shapes @ q[:, order[0]]
    return Border(c, values[order].imag, shape / np.linalg.norm(shape), _verify(model, c, float(values[order[0]].imag), band),
                  "bracketing")


def _foretold(model: Model, c: float, band: Band) -> float:
    """The nearest c below at which, by first order, a pair in the band crosses; -inf if none is on its way."""
    n, r = len(model.form.omega), model.form.rigid
    values, left, right = la.eig(model.form.state(model.form.C + c * model.contact), left=True, right=True)
    keep = (values.imag > 0) & (values.imag >= band[0]) & (values.imag <= band[1])
    values, left, right = values[keep], left[:, keep], right[:, keep]
    b, d = right[n - r:], left[n - r:]
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = -np.einsum("ij,ij->j", d.conj(), model.contact @ b) / np.einsum("ij,ij->j", left.conj(), right)
        ahead = c - values.real / rate.real
    ahead = ahead[(rate.real < 0) & (ahead < c)]
    return float(ahead.max(initial=-np.inf))


def sparse_border(model: Substructure, W: Array, band: Band, bracketing: bool) -> Border:
    """The border of a large model, by a basis that grows until the border stands still.

    It starts as the undamped modes up to 1.5 times the band with the static responses of the contact and of dashpots
    (a Craig-Chang basis, in which Ω is known to rounding), and takes in the full model's response to the contact,
    (-ω²M + iωD + K)⁻¹W, at each border found.
    """
    basis = _Growing(model, W, 1.5 * band[1])
    previous = np.nan
    for _ in range(ROUNDS):
        border = dense_border(basis.pencil, basis.W, band, bracketing)
        if not np.isfinite(border.c) or border.c == 0 or abs(border.c - previous) <= 1e-10 * abs(border.c):
            break
        previous = border.c
        basis.grow(border.crossing[:4])
    else:
        raise NotConvergedError(f"the border moved from {previous:.9g} to {border.c:.9g} in the last of {ROUNDS} rounds; "
                                "narrow the band")
    border = replace(border, shape=basis.V @ border.shape)
    return border if not np.isfinite(border.c) or border.c == 0 else _verified(model.pencil, W, border, band)


class _Growing:
    """An M-orthonormal basis V of a sparse model with the projected pencil; `grow` adds responses to the contact."""

    def __init__(self, model: Substructure, W: Array, limit: float) -> None:
        self.full, self.load = model.pencil, W
        handle = ShiftInvert(model.K, model.M)
        modes = modes_below(model.K, model.M, limit, handle)
        if modes.rigid == len(modes.eigenvalues):
            modes = lowest_modes(handle, 1)
        braked = np.unique(model.D.nonzero()[1])
        forces = np.hstack([W, _units(model.size, braked if len(braked) <= 12 else braked[:0])])
        rest = handle.elastic_solve(forces, modes.shapes)
        whole = np.einsum("ij,ij->j", rest, forces) + np.einsum(
            "ij,ij->j", *(2 * [(modes.shapes.T @ forces)[modes.rigid:] / modes.frequencies[modes.rigid:, None]]))
        statics, stiffness, mass, _ = independent(handle, rest, forces, whole, modes.shapes)
        massive = mass > 0
        self.V = np.hstack([modes.shapes, statics[:, massive]])
        self.K = np.diag(np.concatenate([modes.eigenvalues, stiffness[massive]]))

    @property
    def W(self) -> Array:
        return self.V.T @ self.load

    @property
    def pencil(self) -> Pencil:
        return Pencil(np.eye(len(self.K)), self.V.T @ (self.full.D @ self.V), self.K)

    def grow(self, omega: Array) -> None:
        new = np.hstack([complex_solve(self.full.at(1j * value), self.load) for value in omega])
        new = np.hstack([new.real, new.imag])
        new = new[:, np.linalg.norm(new, axis=0) > 0]
        new = new / np.sqrt(np.einsum("ij,ij->j", new, self.full.M @ new))
        for _ in range(2):
            new = new - self.V @ (self.V.T @ (self.full.M @ new))
        values, vectors = np.linalg.eigh(new.T @ (self.full.M @ new))
        keep = values > 1e-18
        new = new @ (vectors[:, keep] / np.sqrt(values[keep]))
        new = new - self.V @ (self.V.T @ (self.full.M @ new))
        cross, own = self.V.T @ (self.full.K @ new), new.T @ (self.full.K @ new)
        self.K = np.block([[self.K, cross], [cross.T, (own + own.T) / 2]])
        self.V = np.hstack([self.V, new])


def _units(size: int, at: Array) -> Array:
    columns = np.zeros((size, len(at)))
    columns[at, np.arange(len(at))] = 1.0
    return columns


def _verified(pencil: Pencil, W: Array, border: Border, band: Band) -> Border:
    """Re λ of the full model at c(1 ∓ 1e-3) by PEP; an error where they contradict the border."""
    growth = []
    for factor in (1 - MARGIN, 1 + MARGIN):
        modes = complex_modes(pencil.with_damping(contact_damping(W, border.c * factor)), band=band,
                              re=(-0.2 * band[1], 0.2 * band[1]), certify=False)
        values, bars = modes.eigenvalues, modes.error_bar
        at = int(np.argmin(np.abs(values - 1j * border.omega)))
        growth.append(float(values[at].real))
        # Real eigenvalues that grow are what became of a pair that crossed outside of the band.
        early = modes.unstable[values[modes.unstable].imag > 0] if factor < 1 else np.zeros(0, dtype=int)
        if len(early) or (factor > 1 and values[at].real < -bars[at]):
            shown = values[early[0]] if len(early) else values[at]
            raise NotConvergedError(f"the border c = {border.c:.9g} at ω = {border.omega:.6g} does not hold on the full model: "
                                    f"at {factor:g} c it has λ = {shown:.6g}; narrow the band")
    return replace(border, growth=(growth[0], growth[1]))
