"""Large sparse models in time: M a + D v + K x = W f(Wᵀv) by PETSc's TSALPHA2, without M⁻¹ and with one solve per step.

The generalised-α method (Chung and Hulbert, J. Appl. Mech. 60 (1993) 371) is of second order, and damps what the step cannot
resolve (spectral radius RADIUS at infinity). Each of its steps is an equation in which the contact is of rank p:

    S d = -r + W (f(v₁) - f(v₀)),   v₁ = v₀ + s Wᵀd,   S = σM + sD + K,

with r the residual at the predictor, s and σ the shifts of the step. S depends on the step size only and is factorised once
for each; what is left is p equations for v₁, solved to rounding by Newton's method. PETSc gets this as its nonlinear solver.

Error control: the local error of the velocities, ‖v₁ - 3v₀ + 3v₋₁ - v₋₂‖/12 in the norm of diag M, is at most
tol (‖v‖ + v_s). A block of 32 steps in which it is not is done again with half the step (or less), and one in which it never
exceeds a sixteenth is followed by steps of twice the length. v_s is the belts' speed on the motion M⁻¹w that takes least energy
for it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub._slepc import _load
from femsub.contacts import Sliding, State
from femsub.errors import InputError, NotConvergedError, SingularMatrixError
from femsub.factor import Handle, factorise
from femsub.pencil import Array

RADIUS = 0.9  # amplification of what oscillates infinitely fast
AT_ONCE = 8  # points of the grid: so many are lost at most by Ctrl-C
BLOCK = 32  # steps between two decisions on their length
KEPT, BYTES = (2, 12), 1e9  # factorisations kept, the last ones used: as many as go into so much memory, within limits
AT_MOST = 5  # halvings after one look at the error
HALVINGS = 40  # of the step at a stretch, before giving up
PREFIX = "femsub_alpha_"


class AlphaFlow:
    """A trajectory of a sparse model under way; see `integrators.Flow`, whose attributes and methods it has."""

    method = "alpha"

    def __init__(self, contact: Sliding, start: State, t: float, step: float, tol: float, columns: Array, whole: bool) -> None:
        model = contact.model
        self.contact, self.t, self.tol, self.columns, self.whole = contact, t, tol, columns, whole
        self.M, self.D, self.K = (sp.csr_array(part) for part in (model.M, model.D, model.K))
        if self.M.diagonal().min() <= 0:
            raise InputError(f"M of {model.name!r} is singular (massless DOF): velocities are undetermined there; condense those "
                             "DOF, or reduce the model first")
        self.kind: Any = "definite" if model.pencil.symmetric[1] else "general"
        self.weight = self.M.diagonal()
        self.steps = self.rhs = self.jacobians = 0
        self.work = self.loss = 0.0
        self.dt = self.largest = step
        self.speed = _speed(contact, start)
        self.done, self.worst = 0, 0.0  # steps since the last decision on their length, and the largest local error of these
        self.kept = KEPT[0]
        self.factors: dict[tuple[float, float], tuple[Handle, Array, Array]] = {}
        self.stepper = Stepper(self, start)
        self.history: list[Array] = []  # the last speeds, at distances of `last`
        self.last = 0.0
        self.reached = self._checkpoint()

    @property
    def stretch(self) -> float:
        return AT_ONCE * self.largest

    @property
    def state(self) -> State:
        return State(*self.reached[:2])

    @property
    def balance(self) -> tuple[float, float, float]:
        """Work of the belts and dissipation since the start, and the energy now."""
        x, v, work, loss, _ = self.reached
        return work, loss, float(v @ (self.M @ v) + x @ (self.K @ x)) / 2

    def close(self) -> None:
        """Gives factors and PETSc's objects back."""
        for handle, _, _ in self.factors.values():
            handle.close()
        self.factors.clear()
        self.stepper.close()

    def advance(self, times: Array) -> tuple[Array, ...]:
        """columnsᵀq and columnsᵀq̇ (m, c) at times, and with `whole` q and q̇ (m, n)."""
        shown = [self._seen()]
        begin, at, done, worst = self._checkpoint(), 0, self.done, self.worst
        history, last, halved = self.history or [begin[1]], self.last, 0
        while at < len(times) - 1:
            span = times[at + 1] - times[at]
            count = max(1, int(np.ceil(span / self.dt * (1 - 1e-9))))
            step = float(f"{span / count:.9e}")  # equal steps share a factorisation
            if step != last:  # the third difference needs four speeds at equal distances
                history, last = history[-1:], step
            failed = False
            for _ in range(count):
                history = [*history[-3:], self._step(step)]
                done += 1
                if len(history) == 4:
                    worst = max(worst, self._error(history))
                    if worst > self.tol:
                        failed = True
                        break
            if failed:
                halved += 1
                if halved > HALVINGS:
                    raise NotConvergedError(f"the step fell to {step:.2g} near t = {times[at]:g} and the local error is still "
                                            f"{worst:.1e} at tol = {self.tol:g}; take a larger tol or eps")
                at -= self._back(begin, shown)
                # the local error falls with the third power of the step: what is far too long is halved more than once
                halvings = min(max(1, int(np.log2(worst / self.tol) / 3)), AT_MOST)
                self.dt, done, worst, history = step / 2**halvings, 0, 0.0, [begin[1]]
                continue
            at += 1
            shown.append(self._seen())
            if done >= BLOCK:
                if worst < self.tol / 16 and 2 * self.dt <= self.largest * (1 + 1e-9):
                    self.dt *= 2
                begin, done, worst, halved = self._checkpoint(), 0, 0.0, 0
                begin = (*begin[:4], len(shown))
        self.t, self.done, self.worst, self.reached = float(times[-1]), done, worst, self._checkpoint()
        self.history, self.last = history, last
        return tuple(np.array(part) for part in zip(*shown, strict=True))

    def _checkpoint(self) -> tuple[Array, Array, float, float, int]:
        x, v = self.stepper.get()
        return x.copy(), v.copy(), self.work, self.loss, 1

    def _back(self, begin: tuple[Array, Array, float, float, int], shown: list[Any]) -> int:
        """Back to a checkpoint; returns how many points of the grid are lost with it."""
        x, v, self.work, self.loss, kept = begin
        self.stepper.put(x, v)
        lost = len(shown) - kept
        del shown[kept:]
        return lost

    def _seen(self) -> tuple[Array, ...]:
        x, v = self.stepper.get()
        ports = (self.columns.T @ x, self.columns.T @ v)
        return (*ports, x.copy(), v.copy()) if self.whole else ports

    def _step(self, step: float) -> Array:
        before = self.stepper.get()[0].copy()
        self.stepper.step(step)
        x, v = self.stepper.get()
        moved = x - before
        self.work += float(self.stepper.force @ (self.contact.W.T @ moved))
        if self.D.nnz:
            self.loss += float(moved @ (self.D @ moved)) / step
        self.steps += 1
        if not np.isfinite(v[0]):
            raise NotConvergedError("alpha met a NaN or Inf: the motion grows without bound, or the friction law is not finite")
        return v.copy()

    def _error(self, v: list[Array]) -> float:
        """Local error of the velocity over its scale: third difference / 12, the trapezoidal rule's."""
        third = v[3] - v[0] - 3 * (v[2] - v[1])
        size = np.sqrt(self.weight @ np.square(v[3])) + self.speed
        return float(np.sqrt(self.weight @ np.square(third))) / 12 / size

    def factor(self, sigma: float, s: float) -> tuple[Handle, Array, Array]:
        """The factor of S = σM + sD + K, with S⁻¹W and s WᵀS⁻¹W; made when the shifts are new."""
        key = (sigma, s)
        if key not in self.factors:
            while len(self.factors) >= self.kept:
                self.factors.pop(next(iter(self.factors)))[0].close()
            S = sigma * self.M + s * self.D + self.K
            self.jacobians += 1
            try:
                handle = factorise(S, self.kind)
            except SingularMatrixError:  # a D that feeds energy
                self.kind = "general"
                handle = factorise(S, self.kind)
            fill = getattr(handle, "fill", np.nan)
            self.kept = int(np.clip(BYTES / (8 * len(self.weight) * (fill if np.isfinite(fill) else 500)), *KEPT))
            Z = handle.solve(self.contact.W)
            self.factors[key] = handle, Z, s * (self.contact.W.T @ Z)
        self.factors[key] = self.factors.pop(key)  # the last one used stands last
        return self.factors[key]


def _speed(contact: Sliding, start: State) -> float:
    """The belts' speed as a norm of velocities: v / sqrt(wᵀ(diag M)⁻¹w), the largest of the columns'."""
    speed = max(*(abs(belt.speed or 0.0) for belt in contact.belts), float(np.abs(contact.W.T @ start.velocity).max())) or 1.0
    norms = np.square(contact.W).T @ (1 / contact.model.M.diagonal())
    return float(speed / np.sqrt(norms[norms > 0].min())) if norms.any() else speed


class Stepper:
    """PETSc's TSALPHA2 on the vectors of a flow; it is handed the nonlinear solver described above."""

    def __init__(self, flow: AlphaFlow, start: State) -> None:
        PETSc, _ = _load()
        self.flow, self.petsc, n = flow, PETSc, flow.contact.model.size
        self.force = np.zeros(flow.contact.columns)
        self.blank = False  # the stage's vectors are wanted, not the residual
        options = PETSc.Options()
        options.setValue(f"{PREFIX}ts_alpha_radius", RADIUS)
        options.setValue(f"{PREFIX}ts_adapt_type", "none")
        self.x, self.v, self.residual, self.spare = (PETSc.Vec().createSeq(n, comm=PETSc.COMM_SELF) for _ in range(4))
        self.x.setArray(start.displacement)
        self.v.setArray(start.velocity)
        self.shell = PETSc.Mat().createAIJ((n, n), nnz=1, comm=PETSc.COMM_SELF)  # PETSc wants one; it stays empty
        self.shell.assemble()
        self.ts = PETSc.TS().create(PETSc.COMM_SELF)
        self.ts.setOptionsPrefix(PREFIX)
        self.ts.setType("alpha2")
        self.ts.setI2Function(self._function, self.residual)
        self.ts.setI2Jacobian(self._jacobian, self.shell, self.shell)
        self.ts.setExactFinalTime(PETSc.TS.ExactFinalTime.STEPOVER)
        self.ts.setMaxTime(1e300)
        self.ts.setMaxSteps(np.iinfo(PETSc.IntType).max)
        self.ts.setTimeStep(flow.dt)
        self.ts.setSolution2(self.x, self.v)
        self.ts.setFromOptions()
        snes = self.ts.getSNES()
        snes.setType("python")
        snes.setPythonContext(self)
        self.ts.setUp()

    def get(self) -> tuple[Array, Array]:
        """x and v, to be read, until the next step."""
        return self.x.array_r, self.v.array_r

    def put(self, x: Array, v: Array) -> None:
        """Another state, from which the method starts anew."""
        self.x.setArray(x)
        self.v.setArray(v)
        self.ts.restartStep()

    def step(self, size: float) -> None:
        """One step."""
        self.ts.setTimeStep(size)
        self.ts.step()

    def close(self) -> None:
        """Destroys PETSc's objects."""
        for thing in (self.ts, self.shell, self.x, self.v, self.residual, self.spare):
            thing.destroy()

    def _function(self, ts: Any, t: float, X: Any, V: Any, A: Any, F: Any) -> None:
        if self.blank:
            return
        flow = self.flow
        v = V.array_r
        self.speeds = flow.contact.W.T @ v
        self.force = flow.contact.force(self.speeds)
        self.raw = flow.M @ A.array_r + flow.K @ X.array_r - flow.contact.W @ self.force
        if flow.D.nnz:
            self.raw += flow.D @ v
        F.setArray(self.raw)
        flow.rhs += 1

    def _jacobian(self, ts: Any, t: float, X: Any, V: Any, A: Any, s: float, sigma: float, J: Any, P: Any) -> bool:
        self.shifts = sigma, s
        return True

    def solve(self, snes: Any, b: Any, x: Any) -> None:
        """What PETSc calls for each stage: one solve with S, p scalar equations, and x is right to rounding."""
        snes.computeFunction(x, self.spare)
        snes.computeJacobian(x, self.shell)
        size = float(np.linalg.norm(self.raw))
        if size:
            handle, Z, C = self.flow.factor(*self.shifts)
            d = handle.solve(-self.raw)
            before = self.force
            linear = self.speeds + self.shifts[1] * (self.flow.contact.W.T @ d)
            self.force = _contact_force(self.flow.contact, linear, self.speeds, before, C)
            d += Z @ (self.force - before)
            x.setArray(x.array_r + d * (self.spare.norm() / size))  # PETSc scales residuals by 1/α_f
        self.blank = True
        snes.computeFunction(x, self.spare)  # only so that it has the stage's v and a
        self.blank = False
        snes.setConvergedReason(self.petsc.SNES.ConvergedReason.CONVERGED_FNORM_ABS)


def _contact_force(contact: Sliding, linear: Array, guess: Array, before: Array, C: Array) -> Array:
    """f(v) with v = linear + C (f(v) - before), by Newton's method that halves its steps; shape (p,)."""
    def gap(v: Array) -> tuple[Array, Array]:
        f = contact.force(v)
        return v - linear - C @ (f - before), f

    v = guess
    rest, f = gap(v)
    floor = 8 * np.finfo(float).eps * (np.abs(linear).max() + np.abs(C).max() * np.abs(before).max() + np.abs(v).max())
    for _ in range(200):
        if np.abs(rest).max() <= floor:
            return f
        change = np.linalg.solve(np.eye(len(v)) - C * contact.tangent(v), rest)
        part = 1.0
        while part > 1e-12:
            trial = v - part * change
            found, f = gap(trial)
            if np.linalg.norm(found) < np.linalg.norm(rest) or np.abs(found).max() <= floor:
                break
            part /= 2
        else:
            if np.abs(rest).max() <= 1e4 * floor:
                return contact.force(v)
            break
        v, rest = trial, found
    raise NotConvergedError(f"the contact's equation is left with a residual of {np.abs(rest).max():.1e}, where Newton's method "
                            "stalled: several speeds fulfil it, or the friction law jumps; take a smaller step or a larger eps")
