"""Limit cycles: the periodic motion of a model under its contacts, by harmonic balance on the contacts' columns only."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.checks import (
    Array,
    FemsubWarning,
    InputError,
    NoCycleError,
    NotConvergedError,
    finite_number,
    positive_number,
    real_array,
    warn,
    whole_number,
)
from femsub.coupling import Belt
from femsub.motion.cycles.balance import Balance, Orbit, StepsEndedError, coefficients, in_phase, power_of_two, samples_of
from femsub.motion.cycles.branch_chart import cycle_chart
from femsub.motion.cycles.compliance import Compliance, Fractions, compliance
from femsub.motion.cycles.floquet import Multipliers, multipliers
from femsub.motion.cycles.initial_guess import harmonics_for, of_signal, orbits
from femsub.motion.nonlinear_model import Sliding, State, sliding
from femsub.motion.transient import DENSE, MOST_POINTS, PER_PERIOD, Transient, transient
from femsub.output import Chart, Displayed, Table

if TYPE_CHECKING:
    from femsub.model import Contact, Substructure

log = logging.getLogger(__name__)

MOST_HARMONICS = 1500  # largest number of harmonics that is chosen automatically
PERIODS = (40, 160)  # lengths of the motion in time, tried one after the other if no other start leads to a cycle
TAIL = 1e-5  # a start leaves out the highest harmonics of a cycle up to this share of it


@dataclass(frozen=True, eq=False, repr=False)
class LimitCycle(Displayed):
    """A limit cycle, made by `harmonic_balance`: q(t + T) = q(t) of M q̈ + D q̇ + K q = W f(Wᵀq, Wᵀq̇), T = 2π/ω.

    Attributes
    ----------
    contact : Sliding
        The model and its contacts.
    omega : float
        ω, rad per unit of time.
    harmonics : ndarray of complex, shape (H, p)
        v_k, k = 1 … H, of the speed under the belts, v(t) = Σ v_k e^{ikωt} + conjugate; v_0 = 0. The largest v_k is real.
    residual : float
        ‖R_k‖ / ‖v‖ over the harmonics kept.
    truncation : float
        An estimate of the effect of the neglected harmonics, relative to the cycle: ‖Y(ikω) f_k‖ / ‖v‖ over these harmonics.
        Unless the cycle is a point of a branch, their first-order effect on the kept harmonics and on ω is added.
    aliasing : float
        Change of the right-hand side, relative to ‖v‖, with four times as many samples.
    newton : int
        The number of Newton steps in all levels together.
    stability : bool
        Whether `floquet` and `is_stable` compute multipliers. `dataclasses.replace(cycle, stability=True)` changes it.

    Examples
    --------
    >>> import femsub as fs
    >>> model = fs.reduce(fs.chain(10, belt=2), fs.CraigChang(modes=3), ports=True)
    >>> belt = fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=2e-2))
    >>> cycle = fs.harmonic_balance(model, belt, harmonics=40)
    >>> cycle.is_stable, cycle.velocity(0.0).shape
    (True, ())
    """

    contact: Sliding
    orbit: Orbit
    flexibility: Compliance
    residual: float
    truncation: float
    aliasing: float
    newton: int = 0
    stability: bool = True

    @property
    def omega(self) -> float:
        return self.orbit.omega

    @property
    def period(self) -> float:
        return 2 * np.pi / self.orbit.omega

    @property
    def harmonics(self) -> Array:
        return self.orbit.v

    @cached_property
    def _wave(self) -> Array:
        return self.orbit.samples(power_of_two(max(16 * self.orbit.harmonics, 4096)))

    @property
    def rms(self) -> float:
        """Root mean square of the speed under the belt (first column) over one period."""
        return float(np.sqrt(2) * np.linalg.norm(self.orbit.v[:, 0]))

    @property
    def peak(self) -> float:
        """Largest |v| over one period, first column."""
        return float(np.abs(self._wave[0]).max())

    @cached_property
    def sticking(self) -> float:
        """The share of the period in which a belt sticks, |v0 - v| ≤ 3 ε; NaN without belts, or if a law has no ε."""
        if self.contact.without_eps or not self.contact.belts:
            return np.nan
        return float(self.contact.sticks(self._wave).any(axis=0).mean())

    def row(self) -> dict[str, Any]:
        """The numbers of the cycle by name, for tables."""
        return {"omega": self.omega, "rms": self.rms, "peak": self.peak, "sticking": self.sticking, "is_stable": self.is_stable,
                "harmonics": self.orbit.harmonics, "truncation": self.truncation, "residual": self.residual}

    def tables(self) -> list[Table]:
        """One row with the numbers of the cycle."""
        columns = ["omega", "rms", "peak", "sticking", "is_stable", "harmonics", "truncation"]
        return [Table("cycle", [self.row()], columns, "Limit cycle")]

    def chart(self, title: str = "Limit cycle") -> Chart:
        """One period of the speeds v at the contacts, the orbit of v over the displacement u, and the harmonics of v."""
        v = self._wave
        moved = samples_of(self.orbit.v / self.orbit.s[:, None], v.shape[1])
        t = np.linspace(0.0, self.period, v.shape[1], endpoint=False)
        return cycle_chart(t, v, moved, self.omega, self.contact.belts[0].speed if self.contact.belts else None, title)

    def velocity(self, t: Any) -> Array:
        """v(t) = Wᵀq̇, in the shape of t for one column, `(p, *t.shape)` for several columns."""
        times = real_array("t", t)
        found = np.moveaxis(2 * (np.exp(np.multiply.outer(times, self.orbit.s)) @ self.orbit.v).real, -1, 0)
        return found[0] if self.contact.columns == 1 else found

    def state(self, t: float = 0.0) -> State:
        """q and q̇ on the cycle at time t in the model's own coordinates: q_k = P(ikω)⁻¹ W f_k, K q_0 = W f_0."""
        f = coefficients(Balance(self.contact, self.flexibility).force(self.orbit, self._wave.shape[1]), self.orbit.harmonics)
        s = self.orbit.s
        q = self.flexibility.response(s, f[1:]) * np.exp(s * float(finite_number("t", t)))
        return State(self.contact.static[0] @ f[0].real + 2 * q.real.sum(axis=1), 2 * (q * s).real.sum(axis=1))

    @cached_property
    def floquet(self) -> Multipliers | None:
        """The Floquet multipliers, or None if they are not computed.

        They are not computed for more than 2,000 DOF, structural damping, forces that depend on displacements, or if `stability`
        is False.
        """
        if not self.stability or not self.contact.by_speed or not isinstance(self.flexibility, Fractions):
            return None
        return multipliers(self.contact, self.flexibility, self.orbit)

    @property
    def is_stable(self) -> bool | None:
        """Whether all multipliers except the trivial one lie inside the unit circle; None if undecided or not computed."""
        return None if self.floquet is None else self.floquet.is_stable

    def __repr__(self) -> str:
        verdict = {True: "stable", False: "unstable",
                   None: "stability not computed" if self.floquet is None else "stability undecided"}[self.is_stable]
        sticking = f"{100 * self.sticking:.3g} %"
        if np.isnan(self.sticking):
            sticking = "not defined (no belt)" if not self.contact.belts else \
                f"unknown (the law on {self.contact.without_eps[0]!r} has no eps)"
        return (f"LimitCycle: ω = {self.omega:.7g}, rms {self.rms:.6g}, peak {self.peak:.6g}, sticking {sticking}, {verdict}; "
                f"{self.orbit.harmonics} harmonics, residual {self.residual:.0e}, left out {self.truncation:.0e}")


def harmonic_balance(model: Substructure, contacts: Contact | Sequence[Contact], *, harmonics: int | None = None,
                     start: Any = None, tol: float = 1e-4) -> LimitCycle:
    """A limit cycle of a full or reduced model under its contacts, by harmonic balance.

    M q̈ + D q̇ + K q = W f(Wᵀq, Wᵀq̇) is solved for the periodic speeds v = Wᵀq̇: v_k = Y(ikω) f_k(v), k = 1 … H, with the
    mobility Y(s) = s Wᵀ(s²M + sD + K)⁻¹W (p, p). The frequency ω is an unknown as well. Structural damping H acts exactly: every
    harmonic has K + iH. A model with H needs a `start` other than a frequency, such as the cycle of
    `equivalent_viscous(model, ω)`, and its cycle has no multipliers.

    Parameters
    ----------
    model : Substructure
        Full or reduced.
    contacts : Belt or another contact, or a sequence of them
        As for `transient`. If a contact is not a belt, `start` must be a motion (not a frequency). Multipliers are not computed
        for forces that depend on displacements: use `shoot`.
    harmonics : int, optional
        H. By default it is increased, at most doubled at a time, until the effect of the neglected harmonics is smaller than
        `tol`. If the iteration does not converge, H is doubled as long as the iteration then ends nearer to a cycle. The limit
        is 1500.
    start : optional
        The initial guess. Usually there is one cycle per unstable mode, and `start` selects it. The default is the mode of steady
        sliding that grows fastest. If no cycle is found from it, the motion in time from there follows, for up to 300 DOF.

        - A frequency: the linear model's crossing nearest to it.
        - A `LimitCycle` of any model under the same contacts.
        - A `Transient` whose second half is periodic. If it is of this model and leads to no cycle, and `harmonics` is not given,
          its motion is continued.
        - (t, v) with the speeds v of the contacts' columns, shape (m,) or (p, m).
    tol : float
        The largest effect of the neglected harmonics, relative to the cycle.

    Returns
    -------
    LimitCycle

    Raises
    ------
    InputError
        No friction law, a floating model, an unusable start; steady sliding is stable and no start is given.
    NotConvergedError
        Newton's method found no cycle; the message reports how far it came.

    Warns
    -----
    FemsubWarning
        The effect of the neglected harmonics is larger than `tol`. The message has its size and a sufficient number.

    References
    ----------
    M. Krack, J. Gross, Harmonic Balance for Nonlinear Vibration Problems, Springer (2019); T. M. Cameron, J. H. Griffin,
    J. Appl. Mech. 56 (1989) 149.

    Examples
    --------
    >>> import femsub as fs
    >>> model = fs.reduce(fs.chain(10, belt=2), fs.CraigChang(modes=3), ports=True)
    >>> belt = fs.Belt(speed=0.19113, law=fs.StribeckArctan(eps=2e-2))
    >>> cycle = fs.harmonic_balance(model, belt, harmonics=40)
    >>> print(f"{cycle.omega:.4f} {cycle.rms:.4f}")
    0.7305 0.1166
    """
    contact = sliding(model, contacts, "harmonic balance", structural=True)
    if harmonics is not None:
        whole_number("harmonics", harmonics, least=1, most=100_000)  # each needs about 16 samples of every column
    if not 0 < finite_number("tol", tol) < 1:
        raise InputError(f"tol must lie between 0 and 1, such as 1e-4, not {tol!r}")
    if all(isinstance(one, Belt) and one.force == 0 for one in contact.contacts):
        raise InputError("the normal force is zero, so nothing excites the model. Give the belt a force")
    flexibility = flexibility_of(contact, start)
    most = MOST_HARMONICS if harmonics is None else harmonics
    balance, failed = Balance(contact, flexibility), None
    for begin, count, steps in _starts(contact, flexibility, start, tol):
        try:
            orbit, residual, turns = _converged(balance, [begin], min(count, most) if harmonics is None else harmonics, most, tol)
            while True:
                steps += turns
                if (periods := orbit.periods) > 1:  # the start had several periods
                    one = replace(orbit, v=orbit.v[periods - 1::periods], omega=periods * orbit.omega)
                    orbit, residual, turns = _converged(balance, [one], harmonics or one.harmonics, most, tol)
                    continue
                target = 0.0 if harmonics else 0.5 * tol
                truncation, aliasing, enough = balance.unresolved(orbit, target, kept=True)
                if truncation <= tol or orbit.harmonics >= most:
                    break
                count = min(most, 2 * orbit.harmonics, max(enough, orbit.harmonics + 1))
                orbit, residual, turns = _converged(balance, [orbit, begin], count, most, tol)
        except NotConvergedError as error:
            if harmonics is not None:  # the given number may be too small
                raise
            failed = failed or error
        else:
            break
    else:
        raise failed or NotConvergedError("no cycle was found. Give start=, e.g. a frequency or a transient")
    if max(truncation, aliasing) > tol:
        target = target or 0.1 * truncation  # the truncation with `enough` harmonics
        warn(f"{orbit.harmonics} harmonics leave out {truncation:.1e} of the cycle, more than tol = {tol:g} (aliasing "
             f"{aliasing:.0e}). harmonics={enough} would leave out about {target:.1e} of it. fs.shoot needs no harmonics",
             FemsubWarning)
    log.info("limit cycle at ω = %.6g with %d harmonics after %d Newton steps", orbit.omega, orbit.harmonics, steps)
    return LimitCycle(contact, in_phase(orbit), flexibility, residual, truncation, aliasing, steps)


def flexibility_of(contact: Sliding, start: Any) -> Compliance:
    """The compliance of the start cycle if it has the same model (the responses of a sparse model are kept); otherwise a new one.

    Raises
    ------
    InputError
        The model floats, or the cycle and the contact have different numbers of columns.
    """
    _ = contact.equilibrium  # raises an error for a floating model
    if not isinstance(start, LimitCycle):
        return compliance(contact)
    known = start.contact
    if known.columns != contact.columns:
        raise InputError(f"start: the cycle has {known.columns} column(s) of contact, but {contact.model.name!r} has "
                         f"{contact.columns} under these. Give a cycle found with the same contacts, or none")
    return start.flexibility if known.model is contact.model and np.array_equal(known.W, contact.W) else compliance(contact)


def _converged(balance: Balance, starts: list[Orbit], count: int, most: int, tol: float) -> tuple[Orbit, float, int]:
    """`Balance.solve` from the first start that converges with `count` harmonics, or with more if `count` may be too small.

    It may be too small if the neglected harmonics exceed `tol`, and if each doubling halves the residual at the end of the steps.
    From a start far from any cycle, the steps end far from a cycle with any number of harmonics.

    Raises
    ------
    NotConvergedError
        There was no convergence with the last number of harmonics.
    """
    before = np.inf
    while True:
        ends = []
        for begin in starts:
            try:
                return balance.solve(begin.with_harmonics(count))
            except StepsEndedError as error:
                ends.append(error)
        ended = min(ends, key=lambda end: end.residual)
        if count >= most or not ended.residual < before / 2 or \
                max(balance.unresolved(one.with_harmonics(count))[0] for one in (*starts, ended.orbit)) <= tol:
            raise ended
        before, count = ended.residual, min(2 * count, most)


def _starts(contact: Sliding, flexibility: Compliance, start: Any, tol: float) -> Iterator[tuple[Orbit, int, int]]:
    """Yields initial orbits with all their known harmonics, the number of harmonics to begin with, and the Newton steps taken.

    The caller tries the next orbit if it finds no cycle from an orbit.

    Raises
    ------
    NotConvergedError
        The first failure of a level, if neither the levels nor the motion in time led to a cycle.
    """
    if isinstance(start, LimitCycle):
        beyond = np.sqrt(np.cumsum(np.square(np.linalg.norm(start.harmonics, axis=1))[::-1])[::-1])
        yield start.orbit, max(5, np.count_nonzero(beyond > TAIL * beyond[0])), 0
        return
    run = start if isinstance(start, Transient) else None
    if run is not None:
        start = (run.t, _speeds(contact, run))
    if isinstance(start, tuple) and len(start) == 2:
        orbit = of_signal(*start, contact.columns)
        yield orbit, harmonics_for(contact, orbit.harmonics), 0
        if run is not None and run.contact.model is contact.model:
            yield from _in_time(contact, flexibility, run.final, orbit.omega)
        return
    near = None if start is None else \
        positive_number("start (a frequency, if it is no LimitCycle, transient or (t, v))", start)
    if bare := next((one for one in contact.contacts if not isinstance(one, Belt)), None):
        raise InputError(f"with {type(bare).__name__} a cycle needs a start that moves: a transient, a signal start=(t, v), or a "
                         "LimitCycle. Only belts have one that is found by itself")
    # from one harmonic of a smooth law to all harmonics of the belts' own laws, level by level
    failed: NotConvergedError | None = None
    first: Orbit | None = None
    for sharp, orbit in orbits(contact, flexibility, near):
        steps, first = 0, first or orbit
        levels = [(sharp[0], count) for count in (1, 3, 5, 10)] + [(at, harmonics_for(at, MOST_HARMONICS)) for at in sharp]
        try:
            for at, count in levels:
                orbit, _, turns = _converged(Balance(at, flexibility), [orbit], count, MOST_HARMONICS, tol)
                steps += turns
        except NotConvergedError as error:
            failed = failed or error
        else:
            yield orbit, orbit.harmonics, steps
    # then the motion in time from the first of these orbits of one harmonic, unless a frequency was given
    if first is not None and near is None:
        state = LimitCycle(contact, first, flexibility, np.nan, np.nan, np.nan).state()
        yield from _in_time(contact, flexibility, state, first.omega)
    if failed is not None:
        raise failed


def _speeds(contact: Sliding, run: Transient) -> Array:
    """Wᵀq̇ of a transient, (p, m): from its states, or as recorded at the ports."""
    if run.states is not None and run.contact.model is contact.model:
        return np.asarray(contact.W.T @ run.states[1].T)
    if bare := next((one for one in contact.contacts if getattr(one, "sets", ())), None):
        raise InputError(f"{type(bare).__name__} acts on the sets {', '.join(bare.sets)}, which a transient does not record at "
                         "ports. Run it on the same model with record='states'")
    return np.vstack([np.asarray(run.velocity(port)).T for one in contact.contacts for port in one.ports])


def _in_time(contact: Sliding, flexibility: Compliance, state: State, omega: float) -> Iterator[tuple[Orbit, int, int]]:
    """Yields starts from the motion in time after a state, at increasing times, if it is periodic. Large models have none."""
    if not isinstance(flexibility, Fractions) or contact.model.size > DENSE:
        return
    for periods in PERIODS:
        if periods * PER_PERIOD * flexibility.found.form.omega.max() > MOST_POINTS * omega:
            log.info("no cycle found, and %d periods of the motion in time would take too long", periods)
            return
        log.info("no cycle found: %d periods of the motion in time follow", periods)
        period = 2 * np.pi / omega
        run = transient(contact.model, contact.contacts, (0.0, periods * period), start=state, tol=TAIL,
                        samples=MOST_POINTS // 2, record_from=(periods - PERIODS[0]) * period)
        if not run.complete:
            return
        state = run.final
        try:
            orbit = of_signal(run.t, _speeds(contact, run), contact.columns)
        except NoCycleError:  # not periodic yet
            continue
        yield orbit, harmonics_for(contact, orbit.harmonics), 0
