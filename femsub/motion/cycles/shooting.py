"""Shooting: a limit cycle as a fixed point of time integration, without harmonics.

    F(y, T) = y(T; y) - y = 0,  ẏ(0)·(y - y_0) = 0,   y = (q, q̇) (2n,)

by Newton's method. dF/dy = Φ(T) - I comes from the variational equation, integrated together with y by an explicit
Runge-Kutta method of order 8 (SciPy's DOP853). The Floquet multipliers are a by-product. The cost grows with n³, so shooting is
for models of a few dozen DOF. It serves to check harmonic balance (Peeters et al., Mech. Syst. Signal Process. 23 (2009) 195).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from femsub.checks import EPS, Array, InputError, NotConvergedError, finite_number, whole_number
from femsub.modes import all_modes
from femsub.motion.cycles.branch_chart import cycle_chart
from femsub.motion.cycles.limit_cycle import LimitCycle
from femsub.motion.first_order import Flow
from femsub.motion.nonlinear_model import State, sliding
from femsub.motion.transient import TIGHTEST
from femsub.output import Chart, Displayed, Table

if TYPE_CHECKING:
    from femsub.model import Contact, Substructure

FEW_DOF = 60  # largest number of DOF: the variational equation has (2n)² unknowns
CLOSED = EPS**0.5  # ‖y(T) - y‖ / ‖y‖ at which the orbit counts as closed: Newton's next step would reach rounding
OSCILLATIONS = 100  # largest number of oscillations of the lowest elastic mode in a period: more would take too long


@dataclass(frozen=True, eq=False, repr=False)
class ShotCycle(Displayed):
    """A limit cycle found by `shoot`.

    Attributes
    ----------
    state : State
        A state on the cycle.
    period : float
    multipliers : ndarray of complex, shape (2n,)
        All Floquet multipliers, the largest first; one of them is 1.
    residual : float
        ‖y(T) - y(0)‖ / ‖y(0) - mean‖, relative to the size of the motion.
    velocity : ndarray, shape (p, m)
        Speeds under the belts at m equidistant times of one period.
    steps : int
        The number of Newton steps.

    Examples
    --------
    >>> import femsub as fs
    >>> model = fs.reduce(fs.chain(10, belt=2), fs.CraigChang(modes=3), ports=True)
    >>> belt = fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=2e-2))
    >>> shot = fs.shoot(model, belt, fs.harmonic_balance(model, belt, harmonics=40))
    >>> shot.is_stable, len(shot.multipliers)
    (True, 10)
    """

    state: State
    period: float
    multipliers: Array
    residual: float
    velocity: Array
    steps: int

    @property
    def omega(self) -> float:
        return 2 * np.pi / self.period

    @property
    def rms(self) -> float:
        """Root mean square of the speed under the first column, over one period."""
        return float(np.sqrt(np.mean(self.velocity[0] ** 2)))

    @property
    def peak(self) -> float:
        """Largest |v| of the first column."""
        return float(np.abs(self.velocity[0]).max())

    @property
    def is_stable(self) -> bool:
        """Whether all multipliers except the one nearest to 1 lie inside the unit circle."""
        others = np.delete(self.multipliers, np.argmin(np.abs(self.multipliers - 1)))
        return bool(np.abs(others).max(initial=0.0) < 1)

    def tables(self) -> list[Table]:
        """One row with the numbers of the cycle."""
        row = {"omega": self.omega, "rms": self.rms, "peak": self.peak,
               "is_stable": self.is_stable, "residual": self.residual}
        return [Table("cycle", [row], ["omega", "rms", "peak", "is_stable", "residual"], "Limit cycle")]

    def chart(self, title: str = "Limit cycle") -> Chart:
        """One period of the speeds v at the contacts, the orbit of v over the displacement u, and the harmonics of v."""
        found = np.fft.rfft(self.velocity, axis=1)
        k = np.arange(found.shape[1])
        moved = np.fft.irfft(np.where(k > 0, found / (1j * self.omega * np.maximum(k, 1)), 0.0), self.velocity.shape[1], axis=1)
        t = np.linspace(0.0, self.period, self.velocity.shape[1], endpoint=False)
        return cycle_chart(t, self.velocity, moved, self.omega, None, title)

    def __repr__(self) -> str:
        return (f"ShotCycle: ω = {self.omega:.7g}, rms {self.rms:.6g}, peak {self.peak:.6g}, "
                f"{'stable' if self.is_stable else 'unstable'}; closed to {self.residual:.0e} in {self.steps} Newton steps")


def shoot(model: Substructure, contacts: Contact | Sequence[Contact], start: LimitCycle | State,
          period: float | None = None, *, tol: float = 1e-10, rounds: int = 12) -> ShotCycle:
    """A limit cycle by shooting: y(T) = y(0) of M q̈ + D q̇ + K q = W f(Wᵀq, Wᵀq̇), y = (q, q̇). A check of `harmonic_balance`.

    Parameters
    ----------
    model : Substructure
        At most 60 DOF.
    contacts : Belt or another contact, or a sequence of them
        As for `transient`.
    start : LimitCycle or State
        A cycle of the same model, or a state near the cycle.
    period : float, optional
        The approximate period, needed with a state.
    tol : float
        Relative tolerance of the time integration.
    rounds : int
        Largest number of Newton steps.

    Returns
    -------
    ShotCycle

    Raises
    ------
    InputError, InputTypeError
        A model of more than 60 DOF; a state without a period, or of another size than the model.
    NotConvergedError
        The orbit did not close.

    References
    ----------
    M. Peeters, R. Viguié, G. Sérandour, G. Kerschen, J.-C. Golinval, Mech. Syst. Signal Process. 23 (2009) 195.

    Examples
    --------
    >>> import femsub as fs
    >>> model = fs.reduce(fs.chain(10, belt=2), fs.CraigChang(modes=3), ports=True)
    >>> belt = fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=2e-2))
    >>> cycle = fs.harmonic_balance(model, belt, harmonics=40)
    >>> abs(fs.shoot(model, belt, cycle).omega - cycle.omega) < 1e-6
    True
    """
    contact = sliding(model, contacts, "shooting")
    if not TIGHTEST <= finite_number("tol", tol) <= 1e-2:
        raise InputError(f"tol must lie between {TIGHTEST:g} and 0.01, not {tol!r}")
    whole_number("rounds", rounds, least=1)
    if model.size > FEW_DOF:
        raise InputError(f"shooting is for models of up to {FEW_DOF} DOF, but this one has {model.size}. Use fs.harmonic_balance")
    if isinstance(start, LimitCycle):
        period = start.period if period is None else period
        start = start.state()
    start = contact.checked(start)
    if period is None or not finite_number("period", period) > float(np.finfo(float).tiny):
        raise InputError(f"shooting from a state needs a positive period, not {period!r}")
    modes = all_modes(model.K, model.M, carried=model.rigid_motion)
    turns = period * modes.elastic[:1] / (2 * np.pi)
    if (turns > OSCILLATIONS).any():
        raise InputError(f"period={period:.6g} contains {turns[0]:.3g} oscillations of the lowest mode, but at most "
                         f"{OSCILLATIONS} are allowed. Give the period in the model's unit of time")
    flow = Flow(contact, start, 0.0, tol, "dop853", contact.W)
    y, atol = flow.y[:-2], flow.tolerances()[:-2]
    size, eye = len(y), np.eye(len(y))
    for turn in range(1, rounds + 1):  # noqa: B007 - a field of the result
        whole = _integrated(partial(_varied, flow), np.concatenate([y, eye.ravel()]), period, tol,
                            np.concatenate([atol, np.full(eye.size, 1e-3 * tol)]))[:, -1].reshape(-1, size)
        end, Phi = whole[0], whole[1:].T
        slope = _rate(flow, y)
        scale = float(np.linalg.norm(slope)) / (2 * np.pi / period)
        gap = end - y
        if np.linalg.norm(gap) <= CLOSED * scale:
            break
        J = np.block([[Phi - eye, _rate(flow, end)[:, None]], [slope[None, :], np.zeros((1, 1))]])
        step = np.linalg.solve(J, np.append(-gap, 0.0))
        y, period = y + step[:-1], period + float(step[-1])
        if not 0 < period < np.inf:
            raise NotConvergedError("shooting lost the cycle: the period became negative. Start nearer to the cycle")
    else:
        raise NotConvergedError(f"shooting did not close the orbit in {rounds} steps: the gap is "
                                f"{np.linalg.norm(gap) / scale:.1e} of the motion, above {CLOSED:.0e}. Start nearer to the cycle")
    values = np.linalg.eigvals(Phi)
    times = np.linspace(0, period, 4096, endpoint=False)
    speeds = contact.W.T @ flow.T @ _integrated(partial(_rate, flow), y, period, tol, atol, times)[size // 2:]
    flow.y = np.append(y, [0.0, 0.0])
    return ShotCycle(flow.state, float(period), values[np.argsort(-np.abs(values))], float(np.linalg.norm(gap)) / scale, speeds,
                     turn)


def _rate(flow: Flow, y: Array) -> Array:
    """ẏ (2n,)."""
    return flow.rate(0.0, np.append(y, [0.0, 0.0]))[:-2].copy()


def _varied(flow: Flow, whole: Array) -> Array:
    """ẏ and Φ̇ᵀ of [y, Φᵀ] (2n (2n + 1),)."""
    y, Phi = np.vsplit(whole.reshape(-1, 2 * len(flow.T)), [1])
    slope = flow.jacobian(0.0, np.append(y, [0.0, 0.0]))[:-2, :-2]  # transposed
    return np.vstack([_rate(flow, y[0]), Phi @ slope]).ravel()


def _integrated(rate: Callable[[Array], Array], y: Array, period: float, tol: float, atol: Array,
                times: Array | None = None) -> Array:
    from scipy.integrate import solve_ivp

    found = solve_ivp(lambda _, x: rate(x), (0, period), y, "DOP853", times, rtol=tol, atol=atol)
    if not found.success:
        raise NotConvergedError(f"the time integration over one period failed: {found.message}. Start nearer to the cycle")
    return found.y
