"""A model under its contacts as a first-order system, and its integration by SciPy.

    ẋ = u,   u̇ = -K̂ x - D̂ u + G Δf,   Δf = f(Gᵀu) - f(0),   q = T (x + x₀),   TᵀMT = I

x₀ is steady sliding, K̂ x₀ = G f(0). Without this shift, tolerance and rounding of a static deflection would hide a small motion
about it. For the same reason Δf is not computed as a difference if the motion is small, see `ForceChange`. (If x₀ does not
exist, or if its rounding would matter, x₀ and f(0) are 0 here.) T is chosen so that the contact acts on the first p velocities
only: G = TᵀW (n, p) is zero below row p. For a contact with `scalar`, a right-hand side is one matrix-vector product and a few
operations on floats, about 1.3 µs at n = 10. Two more unknowns are the work ∫ ΔfᵀWᵀq̇ dt and the dissipation ∫ q̇ᵀDq̇ dt, with
the same error control. The work of the constant f(0) is f(0)ᵀWᵀ(q - q(0)).

LSODA (C code, one call for a stretch of the grid) is the default for its speed. Measured at commit 18f1073: 50 time units of
stick-slip, seconds for an error of 1e-6 of the belt's speed (2 cores of an AMD EPYC, busy; interpolated):

    model (DOF)            LSODA   DOP853  Radau   BDF     alpha at an error of 2e-3
    chain, full (10)       0.01    0.05    0.3     1       5
    chain, HCB (5)         0.01    0.03    0.13    0.4     1
    chain, full (100)      0.03    0.06    -       1.5     1.2
    chain, HCB (20)        0.005   0.02    0.1     0.3     1
    chain, full (1000)     -       -       -       -       1.8

LSODA switches to BDF automatically where the friction law is stiff (ε → 1e-6); DOP853 cannot. Sparse models with consistent
masses have no sparse first-order form: see `generalised_alpha`.

Error control: |local error of y_i| ≤ tol (|y_i| + s_i) for every i. For velocities s = v/‖w‖_M⁻¹, where v is the largest of the
belts' speeds and of the speeds under them at the start. But s is at most the motion itself, m = (‖u‖² + ‖u̇‖²/ω²)^½, at the
beginning of a stretch of the integration. For displacements the scale is s/ω with ω² = wᵀM⁻¹KM⁻¹w / wᵀM⁻¹w, for work and
dissipation s² + s min(m, ‖G f(0)‖/ω). The tolerance is never below the rounding of ‖G Δf‖.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
import scipy.linalg as la

from femsub.checks import EPS, Array, Matrix, NotConvergedError
from femsub.motion.nonlinear_model import SMALL_CHANGE, ForceChange, Sliding, State, massless

TINY = float(np.finfo(float).tiny)

Right = Callable[[float, Array], Array]
#: Work of Δf, dissipation, change of the energy about x₀, the additional work that is also energy, largest energy about x₀
Balance = tuple[float, float, float, float, float]


class Flow:
    """A trajectory of a dense model: `advance` integrates it along a grid and keeps the current state.

    Attributes
    ----------
    t, y
        Current time since the start, and state, y = [x, u, work, dissipation], shape (2n + 2,).
    begin : float
        The time of the start, for messages: the model does not depend on time.
    rate, jacobian : callable
        ẏ = rate(t, y) and ∂ẏ/∂y **transposed**, in arrays that the next call overwrites.
    rest : ndarray, shape (n,)
        x₀ if it is known (`shifted`), otherwise 0.
    scale : float
        v/‖w‖_M⁻¹ of the error control: the largest s for velocities.
    omega, thrust : float
        ω and ‖G f(0)‖ of the error control.
    highest : float
        The largest ω of the model.
    columns
        The columns of the recorded motions columnsᵀq.
    begins : float
        The motion at the start, m of the error control.
    steps, rhs, jacobians : int
        Numbers of steps, right-hand sides and Jacobians.

    Raises
    ------
    InputError
        M is singular.
    """

    error = None  # SciPy's integrators do not report their local errors

    def __init__(self, contact: Sliding, start: State, t: float, tol: float, method: str, columns: Matrix) -> None:
        self.t, self.begin, self.tol, self.method, self.columns = 0.0, t, tol, method, columns
        self.steps = self.rhs = self.jacobians = 0
        pencil = contact.model.pencil.dense()
        try:
            L = la.cholesky(pencil.M, lower=True)
        except la.LinAlgError:
            L = np.zeros_like(pencil.M)
        # each entry is compared with its own diagonal: masses of rotations and of displacements have different units
        if (np.diagonal(L) ** 2 <= len(L) * EPS * pencil.M.diagonal()).any():
            raise massless(f"M of {contact.model.name!r}", "velocities are not determined")
        Q, _ = la.qr(la.solve_triangular(L, contact.W, lower=True))
        self.T = T = la.solve_triangular(L, Q, lower=True, trans="T")
        K, D, G = T.T @ pencil.K @ T, T.T @ pencil.D @ T, T.T @ contact.W
        self.K = K = (K + K.T) / 2
        self.highest = float(np.sqrt(max(la.eigvalsh(K)[-1], 0.0)))
        inverse = T.T @ pencil.M
        begin = inverse @ start.displacement
        # x₀ is the start if it is an equilibrium; otherwise K⁻¹ G f(0) if it exists and is accurate enough
        rest = None
        if not contact.pull(start.displacement).any():
            rest = begin
        elif contact.by_speed:
            with suppress(la.LinAlgError):
                force = G @ contact.resting(start.displacement)
                found = la.cho_solve(la.cho_factor(K), force)
                # a residual above some thousand roundings is accepted only if the start is near x₀
                sharp = np.abs(K @ found - force).max() <= 4096 * EPS * np.abs(force).max()
                if sharp or np.linalg.norm(found - begin) <= 0.5 * np.linalg.norm(found):
                    rest = found
        self.shifted = rest is not None
        change = contact.change(start.displacement if rest is None else T @ rest)
        self.thrust = float(np.linalg.norm(G @ change.rest))
        if rest is None:
            rest, none = np.zeros(len(K)), np.zeros(contact.columns)
            change = ForceChange(contact, none, none, none)
        self.rest = rest
        self.rate, self.jacobian = _functions(change, K, D, G[:min(contact.columns, len(K))])
        # ω and v/‖w‖_M⁻¹; a contact that moves only rigidly, up to rounding, has no ω of its own
        pull = max((float(g @ (K @ g) / (g @ g)) for g in G.T if g.any()), default=0.0)
        self.omega = float(np.sqrt(pull)) if pull > (1e-6 * self.highest) ** 2 else self.highest or 1.0
        thickest = np.sqrt(np.einsum("ij,ij->j", G, G)).max() or 1.0
        speed = max(float(contact.speeds.max()), float(np.abs(contact.W.T @ start.velocity).max()))
        if speed == 0:  # belt and start at rest: the speed that friction alone can cause
            speed = thickest**2 * float(np.abs(contact.resting(start.displacement)).max()) / self.omega
        self.scale = (speed or 1.0) / thickest
        self.first = self.y = np.concatenate([begin - rest, inverse @ start.velocity, [0.0, 0.0]])
        self.begins = self._motion()

    @property
    def stretch(self) -> float:
        """The time to integrate in one call, 200 periods of the highest mode. Progress is reported between calls."""
        return 200 * 2 * np.pi / (self.highest or 1.0)

    def advance(self, times: Array) -> tuple[Array, Array]:
        """columnsᵀq and columnsᵀq̇ at times since the start, (m, c) each.

        times[0] is the current time, at which the integrator restarts.

        Raises
        ------
        NotConvergedError
            The integrator failed.
        """
        from scipy.integrate import ODEintWarning, odeint, solve_ivp

        with np.errstate(over="ignore", invalid="ignore"), warnings.catch_warnings():  # NaN and Inf are checked below
            options: dict[str, Any] = {"rtol": self.tol, "atol": self.tolerances()}
            if self.method == "lsoda":
                warnings.simplefilter("ignore", ODEintWarning)  # its message is in `info`
                # with more steps between two points the integration counts as failed
                found, info = odeint(self.rate, self.y, times, Dfun=self.jacobian, col_deriv=True, tfirst=True, full_output=True,
                                     mxstep=5_000_000, **options)
                effort = info["nst"][-1], info["nfe"][-1], info["nje"][-1]
                failed = "" if info["message"] == "Integration successful." else info["message"]
            else:
                if self.method in ("radau", "bdf"):
                    options["jac"] = lambda t, y: self.jacobian(t, y).T.copy()
                done = solve_ivp(lambda t, y: self.rate(t, y).copy(), (times[0], times[-1]), self.y, METHODS[self.method], times,
                                 dense_output=True, **options)
                found, effort = done.y.T, (len(done.sol.ts) - 1, done.nfev, done.njev)
                failed = "" if done.success else done.message
        self.steps, self.rhs, self.jacobians = (before + int(more) for before, more in zip(
            (self.steps, self.rhs, self.jacobians), effort, strict=True))
        between = " and ".join(f"{self.begin + time:g}" for time in (times[0], times[-1]))
        if failed:
            raise NotConvergedError(f"{self.method} stopped between t = {between} at tol = {self.tol:g}: "
                                    f"{' '.join(failed.split())}. Use a larger tol or eps, or another method")
        if not np.isfinite(found).all():
            raise NotConvergedError(f"{self.method} met a NaN or Inf between t = {between}. Either the friction law is not "
                                    "finite, or the motion grows without bound. A belt cannot cause that, so check D")
        self.t, self.y = float(times[-1]), found[-1].copy()
        n, C = len(self.T), self.T.T @ self.columns
        return (found[:, :n] + self.rest) @ C, found[:, n:2 * n] @ C

    def close(self) -> None:
        """Does nothing; `AlphaFlow` frees its factors."""

    @property
    def state(self) -> State:
        n = len(self.T)
        return State(self.T @ (self.y[:n] + self.rest), self.T @ self.y[n:2 * n])

    @property
    def balance(self) -> Balance:
        """The terms of the energy balance since the start."""
        before, now = self._energy(self.first), self._energy(self.y)
        # x₀ᵀK̂x = f(0)ᵀGᵀx is both work of the friction at rest and energy
        common = float(self.rest @ (self.K @ (self.y - self.first)[:len(self.T)]))
        return float(self.y[-2]), float(self.y[-1]), now - before, common, max(before, now)

    def _energy(self, y: Array) -> float:
        """½ uᵀu + ½ xᵀK̂x, the energy of the motion about x₀."""
        x, u = np.split(y[:-2], 2)
        return float(u @ u + x @ (self.K @ x)) / 2

    def _motion(self) -> float:
        """m of the error control, at the current state."""
        u, a = self.y[len(self.T):-2], self.rate(0.0, self.y)[len(self.T):-2]
        return float(np.hypot(np.linalg.norm(u), np.linalg.norm(a) / self.omega))

    def tolerances(self) -> Array:
        """tol · s of the error control at the current state, but at least the rounding, shape (2n + 2,)."""
        n, pushed = len(self.T), self.thrust / self.omega
        m = max(self._motion(), TINY ** (1 / 3) * self.scale)  # so that its square does not underflow
        # a smaller motion is rounding of the friction's impulse over a period
        at = max(self.tol * min(self.scale, m), 4 * EPS * (min(pushed, m / SMALL_CHANGE) if self.shifted else pushed))
        power = at * (min(self.scale, m) + (min(pushed, m) if self.shifted else pushed))
        return np.concatenate([np.full(n, at / self.omega), np.full(n, at), np.full(2, power)])


def _functions(change: ForceChange, K: Array, D: Array, G: Array) -> tuple[Right, Right]:
    """The right-hand side and the transposed Jacobian. G (p, p) are the nonzero rows of TᵀW; `change` is Δf about x₀."""
    contact, n, p = change.contact, len(K), len(G)
    work, loss, size = 2 * n, 2 * n + 1, 2 * n + 2
    symmetric = (D + D.T) / 2
    values, shapes = np.linalg.eigh(symmetric)
    felt = np.abs(values) > n * EPS * np.abs(values).max(initial=0.0)
    rows = shapes[:, felt].T
    # The damped speeds lᵢᵀu are appended below ẏ, so that one product gives all. A single damped speed (the chain's dashpot) is
    # stored in the entry of the dissipation, and squared there.
    one = len(rows) == 1
    A = np.zeros((size + (0 if one else len(rows)), size))
    A[:n, n:2 * n] = np.eye(n)
    A[n:2 * n, :n], A[n:2 * n, n:2 * n] = -K, -D
    A[loss if one else slice(size, None), n:2 * n] = rows
    weights = values[felt]
    weight = float(weights[0]) if one else 0.0
    whole = np.empty(len(A))
    out, tail = whole[:size], whole[size:]
    linear = np.zeros((size, size))
    linear[:, :2 * n] = A[:2 * n].T
    gradient = np.empty((size, size))
    dot = A.dot

    def dissipated() -> None:
        if one:
            out[loss] *= weight * out.item(loss)
        elif len(tail):
            out[loss] = (weights * tail) @ tail

    def rhs(t: float, y: Array) -> Array:
        dot(y, whole)
        v = y[n:n + p] @ G
        f = change(y[:p] @ G, v)
        out[n:n + p] += G @ f
        dissipated()
        out[work] = f @ v
        return out

    def jacobian(t: float, y: Array) -> Array:
        np.copyto(gradient, linear)
        gradient[n:work, loss] = 2 * (symmetric @ y[n:work])
        u, v = y[:p] @ G, y[n:n + p] @ G
        of_u, of_v = contact.tangents(change.place + u, v)
        gradient[:p, n:n + p] += (G @ of_u @ G.T).T
        gradient[n:n + p, n:n + p] += (G @ of_v @ G.T).T
        gradient[:p, work] = G @ (of_u.T @ v)
        gradient[n:n + p, work] = G @ (change(u, v) + of_v.T @ v)
        return gradient

    alone = contact.moving[0]
    if contact.columns > 1 or not contact.by_speed or not callable(getattr(alone, "scalar", None)):
        return rhs, jacobian
    exerted, slope = alone.scalar()
    g, first, rounding = float(G[0, 0]), float(change.rest[0]), float(change.rounding[0])
    small = SMALL_CHANGE * abs(first)

    def scalar_rhs(t: float, y: Array) -> Array:
        dot(y, whole)
        v = g * y.item(n)
        f = exerted(v) - first
        if -small < f < small:  # `change` in floats
            smooth = v * slope(v / 2)
            f = smooth if abs(smooth - f) <= rounding else f
        out[n] += g * f
        dissipated()
        out[work] = f * v
        return out

    return scalar_rhs, jacobian


#: SciPy's names of the integration methods
METHODS = {"lsoda": "LSODA", "dop853": "DOP853", "radau": "Radau", "bdf": "BDF"}
