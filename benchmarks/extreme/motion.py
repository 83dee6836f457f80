"""Extreme cases of motion in time and of limit cycles: equations of their own, integrated by SciPy to 1e-11 or closer."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.integrate import solve_ivp
from scipy.optimize import linear_sum_assignment
from scipy.sparse.linalg import spsolve

import femsub as fs
from benchmarks.extreme.cases import case, judge
from benchmarks.extreme.reference import Array, Found, claim


@dataclass(frozen=True)
class Chain:
    """Unit masses and springs, fixed at the left, a dashpot at the first mass, a belt of force 1 under mass `belt`.

    μ(v) = 0.3 (2/π) atan(v/ε) + 0.2 exp(-2|v|), or the odd (0.3 + 0.2 exp(-2|v|)) (2/π) atan(v/ε).
    """

    n: int
    belt: int
    damping: float
    speed: float
    eps: float
    odd: bool = False

    def model(self) -> tuple[fs.Substructure, fs.Belt]:
        law = (fs.StribeckArctanOdd if self.odd else fs.StribeckArctan)(eps=self.eps)
        return fs.chain(self.n, belt=self.belt, damping=self.damping), fs.Belt(speed=self.speed, law=law)

    @property
    def parts(self) -> tuple[sp.csr_array, sp.csr_array, Array]:
        beside = -np.ones(self.n - 1)
        K = sp.diags_array([beside, np.append(-2 * beside, 1), beside], offsets=[-1, 0, 1])
        D = sp.csr_array(([self.damping], ([0], [0])), shape=(self.n, self.n))
        return sp.csr_array(K), D, np.eye(self.n)[self.belt - 1]

    def friction(self, v: float) -> float:
        arc, fall = 2 / np.pi * np.arctan(v / self.eps), 0.2 * np.exp(-2 * abs(v))
        return float((0.3 + fall) * arc if self.odd else 0.3 * arc + fall)

    def slope(self, v: float) -> float:
        arc, rise = 2 / np.pi * np.arctan(v / self.eps), 2 / np.pi * self.eps / (self.eps**2 + v * v)
        fall = 0.2 * np.exp(-2 * abs(v))
        return float((0.3 + fall) * rise - 2 * np.sign(v) * fall * arc if self.odd else 0.3 * rise - 2 * np.sign(v) * fall)

    def less(self, v: float) -> float:
        """μ(v0 - v) - μ(v0) of the printed law, without cancellation for a small v."""
        v0 = self.speed
        arc = np.arctan(-v / self.eps / (1 + v0 * (v0 - v) / self.eps**2)) if abs(v) < 0.5 * v0 else \
            np.arctan((v0 - v) / self.eps) - np.arctan(v0 / self.eps)
        further = -v if v < v0 else v - 2 * v0  # |v0 - v| - |v0| for v0 > 0
        return float(0.3 * 2 / np.pi * arc + 0.2 * np.exp(-2 * v0) * np.expm1(-2 * further))


def small_motion(n: int, belt: int, blow: float, end: float, samples: int = 600) -> Found:
    """The speed under the belt after a blow on steady sliding, integrated as the distance from it, to 1e-12 of the blow."""
    chain = Chain(n, belt, 0.1, 0.19113, 1e-3)
    model, contact = chain.model()
    run = fs.transient(model, contact, (0.0, end), impulse=blow, samples=samples, method="alpha" if n <= 300 else "auto")
    K, D, w = chain.parts

    def rhs(t: float, y: Array) -> Array:
        z, v = y[:n], y[n:]
        return np.concatenate([v, w * chain.less(float(v[belt - 1])) - D @ v - K @ z])

    exact = solve_ivp(rhs, (0.0, end), np.concatenate([np.zeros(n), blow * w]), "DOP853", rtol=1e-12, atol=1e-14 * blow,
                      t_eval=run.t).y[n + belt - 1]
    error = float(np.abs(run.velocity("belt") - exact).max() / np.abs(exact).max())
    bound = np.inf if run.error is None else float(run.error)
    rest = spsolve(sp.csc_array(K), w * chain.friction(chain.speed))
    lie = "" if np.allclose(run.start.displacement, rest, rtol=1e-12) else "it does not start from steady sliding"
    return Found(f"{run.effort.method}, {run.effort.steps} steps", error, bound, error / bound, "Transient.error", lie=lie)


def proportional_to_its_blow(method: str, within: float) -> Found:
    """What follows on a blow of 1e-6 and of 1e-9 is the same but for its size: exp(At), with friction linearised."""
    from scipy.linalg import expm

    chain = Chain(12, 3, 0.1, 0.19113, 1e-3)
    model, contact = chain.model()
    K, D, w = chain.parts
    A = np.block([[np.zeros((12, 12)), np.eye(12)], [-K.toarray(), -D.toarray() - chain.slope(chain.speed) * np.outer(w, w)]])
    step = expm(0.2 * A)
    course = [np.concatenate([np.zeros(12), w])]
    for _ in range(300):
        course.append(step @ course[-1])
    exact = np.array(course)[:, 12 + 2]
    errors = []
    for blow in (1e-6, 1e-9):
        run = fs.transient(model, contact, (0.0, 60.0), impulse=blow, samples=300, method=method)
        errors.append(float(np.abs(run.velocity("belt") / blow - exact).max() / np.abs(exact).max()))
        if run.error is not None:
            within = run.error
    return Found(f"{method}, blows of 1e-6 and 1e-9", *judge(np.array(errors), np.full(2, within)),
                 "Transient.error, or 1e-4 of SciPy's integrators")


def floquet(chain: Chain, harmonics: int | None) -> Found:
    """Every multiplier within its own doubt: against the variation of the cycle that shooting closes, both own, to 1e-11."""
    model, contact = chain.model()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.FemsubWarning)
        found = fs.harmonic_balance(model, contact, harmonics=harmonics)
        start, multipliers = found.state(), found.floquet
    assert multipliers is not None
    Phi = _closed(chain, np.concatenate([start.displacement, start.velocity]), found.period)
    exact = np.linalg.eigvals(Phi)
    exact = exact[np.argsort(np.abs(exact - 1))[1:]]  # without the trivial one
    gap = np.abs(multipliers.values[:, None] - exact)
    rows, columns = linear_sum_assignment(gap)
    largest = float(np.abs(exact).max())
    lie = "" if found.is_stable in (None, largest < 1) else f"is_stable is {found.is_stable}, |μ| = {largest:.6g}"
    return Found(f"{len(rows)} multipliers, {len(found.orbit.v) - 1} harmonics",
                 *judge(gap[rows, columns], multipliers.doubts[rows] + 1e-8), "femsub's doubt + 1e-8 of the reference (absolute)",
                 missed=len(exact) - len(rows), lie=lie)


def _closed(chain: Chain, y: Array, period: float) -> Array:
    """Φ(T) of the cycle next to a start, by Newton's method: y(T) - y(0) = 0, ẏ(0)ᵀδy = 0."""
    n = chain.n
    K, D, w = (sp.csr_array(part).toarray() if sp.issparse(part) else part for part in chain.parts)

    def field(y: Array) -> Array:
        return np.concatenate([y[n:], w * chain.friction(chain.speed - y[n + chain.belt - 1]) - D @ y[n:] - K @ y[:n]])

    def rhs(t: float, state: Array) -> Array:
        y, Phi = state[:2 * n], state[2 * n:].reshape(2 * n, 2 * n)
        slope = chain.slope(chain.speed - y[n + chain.belt - 1])
        low = -K @ Phi[:n] - D @ Phi[n:] - slope * np.outer(w, Phi[n + chain.belt - 1])
        return np.concatenate([field(y), np.vstack([Phi[n:], low]).ravel()])

    for _ in range(12):
        begin = np.concatenate([y, np.eye(2 * n).ravel()])
        state = solve_ivp(rhs, (0.0, period), begin, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
        rest, Phi = state[:2 * n] - y, state[2 * n:].reshape(2 * n, 2 * n)
        if np.abs(rest).max() < 1e-9 * np.abs(y).max():
            return Phi
        bordered = np.block([[Phi - np.eye(2 * n), field(state[:2 * n])[:, None]], [field(y)[None], np.zeros((1, 1))]])
        change = np.linalg.solve(bordered, np.append(-rest, 0.0))
        y, period = y + change[:-1], period + change[-1]
    raise ArithmeticError("no cycle next to the one that was found")


class Tanh:
    """μ = (0.3 + 0.2 exp(-2|v|)) tanh(v / 0.01), without an ε by name."""

    def value(self, v: Array) -> Array:
        return (0.3 + 0.2 * np.exp(-2 * np.abs(v))) * np.tanh(v / 0.01)

    def slope(self, v: Array) -> Array:
        level, fall = 0.3 + 0.2 * np.exp(-2 * np.abs(v)), -0.4 * np.sign(v) * np.exp(-2 * np.abs(v))
        return level * 100 / np.cosh(np.clip(v / 0.01, -300, 300)) ** 2 + fall * np.tanh(v / 0.01)


def sticking_unknown() -> Found:
    """A cycle that sticks, under a law without ε: its share of sticking is unknown, not 0 %."""
    found = fs.harmonic_balance(fs.chain(2, belt=1, damping=0.05), fs.Belt(speed=0.1, law=Tanh()))
    peak = float(np.abs(found.peak))
    lie = "the cycle does not stick" if peak <= 0.1 else "" if np.isnan(found.sticking) else f"sticking {found.sticking:.0%}"
    return claim(f"peak speed {peak:.3g}, sticking {found.sticking}", lie, "without ε nobody knows what sticks")


for n, belt, blow in ((120, 5, 1e-3), (320, 20, 1e-3), (320, 20, 1e-9), (320, 20, 0.1)):
    case("motion", f"alpha, {n} masses, blow of {blow:g}", small_motion, n, belt, blow, 60.0)
case("motion", "alpha, 320 masses, few samples", small_motion, 320, 20, 1e-3, 60.0, 100, quick=False)
for integrator in ("alpha", "lsoda", "dop853", "radau"):
    case("motion", f"{integrator}, tiny blows", proportional_to_its_blow, integrator, 1e-4, quick=integrator != "radau")
for cycle, harmonics in ((Chain(2, 2, 0.05, 0.2, 0.01, odd=True), 8), (Chain(3, 2, 0.1, 0.3, 0.01), 10),
                         (Chain(3, 3, 0.1, 0.2, 0.005), None), (Chain(4, 4, 0.2, 0.15, 0.01), 20),
                         (Chain(5, 2, 0.1, 0.3, 0.01, odd=True), 12)):
    case("motion", f"Floquet, chain {cycle.n}, belt m{cycle.belt}, {harmonics or 'usual'} harmonics", floquet, cycle, harmonics)
case("motion", "sticking without an ε", sticking_unknown)
