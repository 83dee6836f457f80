"""Large sparse models in time: M a + D v + K x = W f(Wᵀx, Wᵀv) by the generalised-α method, with one solve per step.

The method (Chung and Hulbert, J. Appl. Mech. 60 (1993) 371) is of second order, and damps frequencies that the step cannot
resolve (spectral radius RADIUS at infinity). Each step solves an equation in which the contact is a term of rank p:

    S d = -r + W (Δf(u₁, v₁) - Δf(u₀, v₀)),   u₁ = u₀ + Wᵀd,   v₁ = v₀ + s Wᵀd,   S = σM + sD + K,

with the residual r at the predictor, and the shifts s and σ of the step. S depends only on the step size and is factorised once
per size. Newton's method solves the remaining p equations for v₁ to rounding. (PETSc's own TSALPHA2 starts with twice the
acceleration, as of 3.18, and restarts after each rejected step.)

Error control: the local error of the velocities, e = ‖v₁ - 3v₀ + 3v₋₁ - v₋₂‖/12 in the norm of diag M, must not exceed
tol (‖v‖ + min(v_s, V)). A block of 32 steps that violates this limit is repeated with half the step, or less. After a block with
e always below a sixteenth of the limit, the step is doubled. v_s is the norm of the motion M⁻¹w with the belts' speed, the motion
of least energy with this speed. V is the largest ‖v‖ so far, which decays by half over a block, so that the limit does not vanish
at the turning points of a small motion. At the start V is at least aᵀMa/sqrt(aᵀKa), the speed that follows from a displacement
from equilibrium. Rounding in e is ignored.

The unknown is the displacement from the start x₀. K x₀ is a separate term, and Δf is the force less the force at x₀, see
`ForceChange`. Otherwise the rounding of a static deflection and of its forces would hide a small motion.

The sum of the local errors of all steps, relative to V, estimates the error of the velocities at the end (`error`). This
assumes that disturbances grow or decay like the motion itself. On a limit cycle the error is mostly a shift in time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from femsub.algebra import Handle, factorise
from femsub.checks import EPS, EQUAL, Array, Matrix, NotConvergedError, SingularMatrixError
from femsub.motion.first_order import Balance
from femsub.motion.nonlinear_model import SMALL_CHANGE, ForceChange, Sliding, State, mass_solve, massless

RADIUS = 0.9  # amplification at infinite frequency
STAGE, INERTIA = 1 / (1 + RADIUS), (2 - RADIUS) / (1 + RADIUS)  # α_f and α_m: the place in a step where the equation holds
GAMMA, BETA = 0.5 + INERTIA - STAGE, 0.25 * (1 + INERTIA - STAGE) ** 2
JUDGED = 32  # number of steps after which their length is decided on again
FADE = 0.5 ** (1 / JUDGED)  # decay of V per step


class Moment(NamedTuple):
    """x relative to the start, v, a, Δf (p,) and V (`moving`); work, dissipation and the sum of local errors since the start."""

    x: Array
    v: Array
    a: Array
    force: Array
    moving: float
    work: float = 0.0
    loss: float = 0.0
    error: float = 0.0


class AlphaFlow:
    """A trajectory of a sparse model during integration, with the attributes and methods of `first_order.Flow`.

    The factors used last are kept in up to `memory` bytes: at least two, so that the step can change and change back, and at most
    `factors`. The integration fails after `halvings` halvings of the step in succession.
    """

    method = "alpha"

    def __init__(self, contact: Sliding, start: State, t: float, step: float, tol: float, columns: Matrix, *,
                 memory: float = 1e9, factors: int = 12, halvings: int = 40) -> None:
        model = contact.model
        self.memory, self.most, self.halvings = memory, factors, halvings
        self.contact, self.t, self.begin, self.tol, self.columns = contact, 0.0, t, tol, columns
        self.M, self.D, self.K = (sp.csr_array(part) for part in (model.M, model.D, model.K))
        self.weight = self.M.diagonal()
        if self.weight.min() <= 0:
            raise massless(f"M of {model.name!r}", "velocities are not determined")
        self.kind: Any = "definite" if model.pencil.symmetric[1] else "general"
        self.steps = self.rhs = self.jacobians = 0
        self.dt = self.largest = step
        # the belts' speed as a norm of velocities, v / sqrt(wᵀ(diag M)⁻¹w), the largest over the columns
        speed = max(float(contact.speeds.max()), float(np.abs(contact.W.T @ start.velocity).max())) or 1.0
        norms = np.square(contact.W).T @ (1 / self.weight)
        self.speed = float(speed / np.sqrt(norms[norms > 0].min())) if norms.any() else speed
        self.rest, self.change = start.displacement, contact.change(start.displacement)
        self.pull = contact.pull(self.rest)
        self.shaken = self._shaken(self.change.rest)
        self.before = start.velocity @ (self.M @ start.velocity) / 2
        self.kept = 2
        self.factors: dict[tuple[float, float], tuple[Handle, Array, Array]] = {}
        x, v = np.zeros(len(self.rest)), start.velocity
        force = self.change(np.zeros(contact.columns), contact.W.T @ v)
        a = mass_solve(self.M, -self._residual(x, v, x, force))
        # V at the start: the larger of ‖v‖ and aᵀMa/sqrt(aᵀKa), the largest speed of a single mode released from rest
        push = self.pull + contact.W @ force
        released = push / self.weight
        stiffness = float(released @ (self.K @ released))
        self.begins = float(np.hypot(self._norm(v), push @ released / np.sqrt(stiffness) if stiffness > 0 else 0.0))
        self.reached = Moment(x, v, a, force, self.begins)
        self.history = [self.reached]  # up to four moments at intervals of `last`
        self.last = 0.0
        self.done, self.worst = 0, 0.0  # steps since their length was last decided on, and their largest local error

    @property
    def stretch(self) -> float:
        return 8 * self.largest  # Ctrl-C loses at most eight points of the grid

    @property
    def error(self) -> float:
        return self.reached.error

    @property
    def state(self) -> State:
        return State(self.rest + self.reached.x, self.reached.v)

    @property
    def balance(self) -> Balance:
        """The terms of the energy balance since the start."""
        x, v = self.reached.x, self.reached.v
        now = float(v @ (self.M @ v) + x @ (self.K @ x)) / 2
        return (self.reached.work + float(self.pull @ x), self.reached.loss, now - self.before,
                float(self.rest @ (self.K @ x)), max(self.before, now))

    def close(self) -> None:
        """Frees the factors."""
        for handle, _, _ in self.factors.values():
            handle.close()
        self.factors.clear()

    def advance(self, times: Array) -> tuple[Array, Array]:
        """columnsᵀq and columnsᵀq̇ at times since the start, (m, c) each."""
        shown = [self.reached]
        begin, kept, halved = self.reached, 1, 0
        while len(shown) < len(times):
            at = len(shown) - 1
            span = times[at + 1] - times[at]
            count = max(1, int(np.ceil(span / self.dt * (1 - EQUAL))))
            step = float(f"{span / count:.9e}")  # equal steps share a factorisation
            if step != self.last:  # the third difference needs four speeds at equal intervals
                self.history, self.last = self.history[-1:], step
            for _ in range(count):
                self._step(step)
                if self.worst > self.tol:
                    break
            if self.worst > self.tol:
                halved += 1
                if halved > self.halvings:
                    raise NotConvergedError(f"the step fell to {step:.2g} near t = {self.begin + times[at]:g}, but the local "
                                            f"error is still {self.worst:.1e} at tol = {self.tol:g}. Use a larger tol or eps")
                # the local error falls with the third power of the step: a step that is far too long is halved up to five times
                self.dt = step / 2 ** min(max(1, int(np.log2(self.worst / self.tol) / 3)), 5)
                self.history, self.done, self.worst = [begin], 0, 0.0
                del shown[kept:]
                continue
            shown.append(self.history[-1])
            if self.done >= JUDGED:
                if self.worst < self.tol / 16 and 2 * self.dt <= self.largest * (1 + EQUAL):
                    self.dt *= 2
                begin, kept, halved = shown[-1], len(shown), 0
                self.done, self.worst = 0, 0.0
        self.t, self.reached = float(times[-1]), shown[-1]
        return (np.array([self.columns.T @ (self.rest + moment.x) for moment in shown]),
                np.array([self.columns.T @ moment.v for moment in shown]))

    def _step(self, h: float) -> None:
        """One step, see `Moment`: one solve with S and p scalar equations; the stage equation then holds to rounding.

        The stage is x_α = x₀ + α_f (x₁ - x₀), v_α likewise, a_α = a₀ + α_m (a₁ - a₀), with
        x₁ = x₀ + h v₀ + h² ((½ - β) a₀ + β a₁) and v₁ = v₀ + h ((1 - γ) a₀ + γ a₁). The first step starts from M a₀ = sum of all
        forces. A step of another length continues with the last a.
        """
        now, contact = self.history[-1], self.contact
        part, s, sigma = STAGE * BETA * h * h, GAMMA / (BETA * h), INERTIA / (STAGE * BETA * h * h)
        # the predictor has a constant a
        place, speed = now.x + STAGE * (h * now.v + h * h / 2 * now.a), now.v + STAGE * h * now.a
        guess = np.zeros(contact.columns) if contact.by_speed else contact.W.T @ place, contact.W.T @ speed
        before = self.change(*guess)
        handle, Z, C = self._factor(sigma, s)
        d = handle.solve(-self._residual(place, speed, now.a, before))
        force = _contact_force(self.change, guess, s * (contact.W.T @ d), before, C, s)
        change = (d + Z @ (force - before)) / part  # change of a
        moved = h * now.v + h * h * (now.a / 2 + BETA * change)
        x, v = now.x + moved, now.v + h * (now.a + GAMMA * change)
        if not np.isfinite(v[0]):
            raise NotConvergedError("alpha met a NaN or Inf. Either the motion grows without bound, or the law is not finite")
        after = Moment(x, v, now.a + change, force, now.moving, now.work + float(force @ (contact.W.T @ moved)),
                       now.loss + float(moved @ (self.D @ moved)) / h, now.error)
        self.history = [*self.history[-3:], after]
        self.steps += 1
        self.done += 1
        if len(self.history) < 4:
            return
        # local error of the velocity over its scale: a twelfth of the third difference, as for the trapezoidal rule
        one, two, three, four = (moment.v for moment in self.history)
        wrong, size = self._norm(four - one - 3 * (three - two)) / 12, self._norm(four)
        shaken = min(self.shaken, self._shaken(after.force) / SMALL_CHANGE)  # from the forces whose rounding Δf contains
        noise = 64 * EPS * (2 / h * self._norm(after.x) + h / 2 * shaken)  # rounding of the terms that a step adds up
        moving = max(size, FADE * after.moving)
        self.history[-1] = after._replace(moving=moving, error=after.error + (wrong / (moving + noise) if wrong else 0.0))
        self.worst = max(self.worst, 0.0 if wrong <= noise else wrong / (size + min(self.speed, moving)))

    def _residual(self, x: Array, v: Array, a: Array, force: Array) -> Array:
        """M a + D v + K (x₀ + x) - W f (n,), with x relative to the start x₀, and `force` = Δf."""
        self.rhs += 1
        return self.M @ a + self.K @ x - self.contact.W @ force - self.pull + self.D @ v

    def _norm(self, v: Array) -> float:
        return float(np.sqrt(self.weight @ np.square(v)))

    def _shaken(self, force: Array) -> float:
        """The norm of the acceleration by forces on the contact's columns."""
        return float(np.sqrt(np.square(self.contact.W @ force) @ (1 / self.weight)))

    def _factor(self, sigma: float, s: float) -> tuple[Handle, Array, Array]:
        """The factor of S = σM + sD + K, with S⁻¹W and s WᵀS⁻¹W, computed once per pair of shifts."""
        key = (sigma, s)
        if key not in self.factors:
            while len(self.factors) >= self.kept:
                self.factors.pop(next(iter(self.factors)))[0].close()
            S = sigma * self.M + s * self.D + self.K
            self.jacobians += 1
            try:
                handle = factorise(S, self.kind)
            except SingularMatrixError:  # D supplies energy, so S may be indefinite
                self.kind = "general"
                handle = factorise(S, self.kind)
            self.kept = int(np.clip(self.memory / handle.bytes, 2, self.most))
            Z = handle.solve(self.contact.W)
            self.factors[key] = handle, Z, s * (self.contact.W.T @ Z)
        self.factors[key] = self.factors.pop(key)  # most recently used last
        return self.factors[key]


def _contact_force(force: ForceChange, guess: tuple[Array, Array], change: Array, before: Array, C: Array, s: float) -> Array:
    """Δf(u, v) (p,), where v = v₀ + change + C (Δf(u, v) - before), u = u₀ + (v - v₀)/s, by Newton's method with step halving."""
    contact, (place, begin) = force.contact, guess
    linear = begin + change

    def gap(v: Array) -> tuple[Array, Array]:
        f = force(place + (v - begin) / s, v)
        return v - linear - C @ (f - before), f

    v = begin
    rest, f = gap(v)
    felt = min(float(np.abs(force.rest).max(initial=0.0)), float(np.abs(f).max()) / SMALL_CHANGE) + np.abs(f).max()
    floor = 8 * EPS * (np.abs(linear).max() + np.abs(C).max() * felt + np.abs(v).max())
    if not contact.by_speed:  # forces depend on displacements as well, and so on their rounding
        floor += 8 * EPS * float((np.abs(C @ contact.tangents(force.place + place, v)[0]) @ np.abs(place)).max())
    for _ in range(200):
        if np.abs(rest).max() <= floor:
            return f
        of_u, of_v = contact.tangents(force.place + place + (v - begin) / s, v)
        step = np.linalg.solve(np.eye(len(v)) - C @ (of_v + of_u / s), rest)
        for part in 0.5 ** np.arange(40):
            trial = v - part * step
            found, f = gap(trial)
            if np.linalg.norm(found) < np.linalg.norm(rest) or np.abs(found).max() <= floor:
                break
        else:
            if np.abs(rest).max() <= 1e4 * floor:  # eleven digits are enough beside a kink of the law
                return gap(v)[1]
            break
        v, rest = trial, found
    raise NotConvergedError(f"Newton's method for the contact stalled at a residual of {np.abs(rest).max():.1e}. Either several "
                            "speeds fulfil the equation, or the friction law jumps. Use a smaller step or a larger eps")
