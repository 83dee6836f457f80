"""The nonlinear model in time: M q̈ + D q̇ + K q = W f(Wᵀq, Wᵀq̇), full or reduced."""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from femsub.algebra import QUADRATIC, WIDE
from femsub.checks import (
    EPS,
    Array,
    InputError,
    Interruptible,
    choice,
    finite_number,
    instance,
    interval,
    items,
    listener,
    positive_number,
    unknown_name,
    whole_number,
    word,
)
from femsub.coupling import STICKING
from femsub.motion.charts import Track, motion_chart
from femsub.motion.first_order import METHODS, Flow
from femsub.motion.generalised_alpha import AlphaFlow
from femsub.motion.nonlinear_model import Sliding, State, sliding
from femsub.motion.signals import FEWEST, part_of, spectrum
from femsub.output import Chart, Displayed, Table

if TYPE_CHECKING:
    from femsub.coupling import Belt
    from femsub.model import Contact, Substructure

log = logging.getLogger(__name__)

DENSE = WIDE  # DOF up to which a sparse model is integrated as a dense one
TOL = {"dense": 1e-9, "alpha": 1e-5}
PER_PERIOD = 16  # recorded points per period of the highest mode
MOST_ASKED = 10**8  # largest number of recorded points that may be requested: 1.6 GB for each port
MOST_POINTS = 200_000  # largest number of recorded points by default
TIGHTEST = 1e-13  # smallest relative tolerance of an integration; below it rounding determines the steps


@dataclass(frozen=True)
class EnergyBalance:
    """The energy balance work = dissipation + change: ∫ fᵀWᵀq̇ dt = ∫ q̇ᵀDq̇ dt + Δ(½q̇ᵀMq̇ + ½qᵀKq), and its `residual`.

    `residual` is the residual of the motion about steady sliding. The work of the friction in steady sliding is part of both
    `work` and `change`, and is left out of the residual. It is relative to the largest of the three remaining terms, and to at
    least a millionth of the energy of the motion.
    """

    work: float
    dissipation: float
    change: float
    residual: float


@dataclass(frozen=True)
class Effort:
    """The cost of a run: steps, evaluations of the right-hand side and of the Jacobian, seconds of wall time."""

    method: str
    tol: float
    steps: int
    rhs: int
    jacobians: int
    seconds: float


@dataclass(frozen=True, eq=False, repr=False)
class Transient(Displayed):
    """A trajectory in time, recorded at ports on a uniform grid, made by `transient`.

    Attributes
    ----------
    contact : Sliding
        The model and its contacts.
    t : ndarray, shape (m,)
    displacements, velocities : mapping of str to ndarray, shape (m,) or (m, p)
        wᵀq and wᵀq̇ at each recorded port.
    states : tuple of ndarray, shape (m, n), or None
        q and q̇ with record="states".
    start, final : State
        The initial and the final state. Give `final` as `start` of another run to continue.
    end : float
        The time of `final`.
    complete : bool
        False if the run was interrupted; the record then ends early.
    energy : EnergyBalance
    effort : Effort
    error : float or None
        The sum of the local errors of the velocities, relative to the size of the motion: an estimate of the error at the end.
        It assumes that disturbances grow or decay like the motion. On a limit cycle the error is mostly a shift in time, which
        the energy balance does not show. None for SciPy's integrators, which do not report local errors.
    rounding : float
        The largest rounding in the displacement of a given `start`, relative to the motion at the start. It limits the accuracy
        of a motion that is small compared with the static deflection. 0 after an impulse of any size.

    Examples
    --------
    >>> import femsub as fs
    >>> run = fs.transient(fs.chain(5, belt=2), fs.Belt(speed=0.2, law=fs.StribeckArctan(eps=1e-2)), (0, 20), samples=100)
    >>> run.complete, run.velocity("belt").shape, run.energy.residual < 1e-6
    (True, (101,), True)
    """

    contact: Sliding
    t: Array
    displacements: Mapping[str, Array]
    velocities: Mapping[str, Array]
    states: tuple[Array, Array] | None
    start: State
    final: State
    end: float
    complete: bool
    energy: EnergyBalance
    effort: Effort
    error: float | None = None
    rounding: float = 0.0

    def __repr__(self) -> str:
        shown = f"t = {self.t[0]:g} to {self.t[-1]:g} in {len(self.t)} points" if len(self.t) else "nothing recorded"
        state = "" if self.complete else f", interrupted at t = {self.end:g}"
        wrong = "" if self.error is None else f"local errors add up to {self.error:.1e} of the motion, "
        if self.rounding > self.effort.tol:
            wrong += "the start differs from steady sliding by rounding only, " if self.rounding >= 1 else \
                     f"{self.rounding:.1e} of the motion at the start is rounding, "
        return (f"Transient: {self.contact.model.name!r} with {self.contact.model.size} DOF, {shown}{state}; "
                f"{self.effort.method} at tol = {self.effort.tol:g}, {self.effort.steps} steps, {self.effort.seconds:.2g} s; "
                f"{wrong}energy balance to {self.energy.residual:.0e}")

    def whole(self) -> Transient:
        """The run itself if it is complete; an interrupted run raises KeyboardInterrupt again."""
        if not self.complete:
            raise KeyboardInterrupt
        return self

    @property
    def step(self) -> float:
        """The step of the grid."""
        return float(self.t[1] - self.t[0]) if len(self.t) > 1 else np.nan

    def port(self, name: str) -> Array:
        """wᵀq(t) on a port, shape (m,) or (m, p)."""
        return self._recorded(self.displacements, name)

    def velocity(self, name: str) -> Array:
        """wᵀq̇(t) on a port, shape (m,) or (m, p)."""
        return self._recorded(self.velocities, name)

    def seen(self, port: str = "", window: tuple[float, float] | None = None, kind: str = "full") -> Track:
        """The velocity at a port, by default the first port recorded, and its spectrum in a window, by default the last quarter.

        `kind` is the key of the model in charts of several models. Of a port of several columns, the first column is used.
        """
        v = self.velocity(port or next(iter(self.velocities)))
        v = v if v.ndim == 1 else v[:, 0]
        start, end = (float(self.t[0]), float(self.t[-1])) if len(self.t) else (0.0, 0.0)
        window = window or (0.25 * start + 0.75 * end, end)
        inside = int(((self.t >= window[0]) & (self.t <= window[1])).sum())
        return Track(kind, self, v, window, spectrum(self.t, v, window) if self.complete and inside > 2 * FEWEST else None,
                     self.contact.belts[0].speed if self.contact.belts else None)

    def tables(self) -> list[Table]:
        """A table with a row for each recorded time, with the displacement and the velocity at each port; it is not printed."""
        columns = {"t": self.t}
        for what, histories in (("u", self.displacements), ("v", self.velocities)):
            for name, values in histories.items():
                several = values.reshape(len(self.t), -1).T
                columns |= {f"{what} {name}" + f" {at}" * (len(several) > 1): one for at, one in enumerate(several)}
        rows = [dict(zip(columns, values, strict=True))
                for values in zip(*(one.tolist() for one in columns.values()), strict=True)]
        return [Table("motion", rows, title="Motion in time")] if rows else []

    def chart(self, title: str = "Motion in time", port: str = "", window: tuple[float, float] | None = None) -> Chart:
        """The velocity at a port over the whole run and in its last periods, and its spectrum in a window.

        By default the first port recorded, and the last quarter of the run as window.
        """
        return motion_chart(self.seen(port, window, self.contact.kind), title)

    def friction(self, name: str) -> Array:
        """F μ(v0 - wᵀq̇(t)) under a belt."""
        belt = self.belt(name)
        return belt.exerted(None, self.velocity(name))

    def belt(self, name: str) -> Belt:
        """The belt on a port."""
        belts = {belt.port: belt for belt in self.contact.belts}
        return belts[choice("port of a belt", name, belts)]

    def _recorded(self, histories: Mapping[str, Array], name: str) -> Array:
        if name not in histories:
            if name in self.contact.model.ports:
                raise InputError(f"port {name!r} was not recorded. Ask for it with transient(..., ports=[{name!r}])")
            raise unknown_name("port", name, histories)
        return histories[name]


def transient(model: Substructure, contacts: Contact | Sequence[Contact], time: tuple[float, float] = (0.0, 500.0), *,
              start: State | None = None, impulse: Mapping[str, float] | float | None = None, ports: Sequence[str] = (),
              step: float | None = None, samples: int | None = None, record_from: float | None = None,
              record: str = "ports", tol: float | None = None, method: str = "auto",
              progress: Callable[[str], None] | None = None) -> Transient:
    """The nonlinear motion of a model under its contacts in time: M q̈ + D q̇ + K q = W f(Wᵀq, Wᵀq̇) from t0 to t1.

    Parameters
    ----------
    model : Substructure
        Full or reduced; M must not be singular.
    contacts : Belt or another contact, or a sequence of them
        On any ports, of one or several columns. A belt needs a friction law, another contact needs `exerted` and `tangents` (see
        `femsub.model.contact.Contact`). Contacts of surfaces, such as `FrictionContact`, are accepted as well.
    time : (t0, t1)
        Start and end.
    start : State, optional
        q and q̇ in the model's coordinates at t0. Default: sliding equilibrium and an impulse on a port, see `impulse`.
    impulse : float or mapping of str to float
        The impulse (mass · length / time), by default 1e-3 on the first contact's port. The same impulse is the same physical
        disturbance for every model, see `Sliding.impulse`.
    ports : sequence of str
        Further ports to record. The ports of the contacts are always recorded.
    step, samples, record_from
        The grid of recorded times: from record_from (default t0) in steps of `step`, or in `samples` equal intervals up to t1.
        Default: 16 points per period of the highest mode, at most 200,000 in total; 2,000 for a sparse model.
    record : str
        'ports', or 'states' for all coordinates as well (2 n numbers per point).
    tol : float
        Bound of the local error: tol times (value + scale). The scale of velocities is the belts' speed or the motion's speed,
        whichever is smaller. See `first_order` (default 1e-9) and `generalised_alpha` (default 1e-5).
    method : str
        'lsoda', 'dop853', 'radau', 'bdf' (SciPy's) for dense models, 'alpha' (the generalised-α method) for sparse ones; 'auto'
        is lsoda for dense models and sparse ones of up to 300 DOF.
    progress : callable, optional
        Called now and then with a line of text.

    Returns
    -------
    Transient

    Raises
    ------
    InputError, InputTypeError
        Times that do not ascend, NaN in the start, a singular M, a belt without a law, a floating model without a `start`.
    NotConvergedError
        The integrator failed.

    Notes
    -----
    Ctrl-C ends the run but not the program: the part computed so far is returned, with `complete` False.

    Examples
    --------
    >>> import femsub as fs
    >>> run = fs.transient(fs.chain(5, belt=2), fs.Belt(speed=0.2, law=fs.StribeckArctan(eps=1e-2)), (0, 20), samples=100)
    >>> print(f"{run.t[0]:g} to {run.t[-1]:g} in {len(run.t)} points")
    0 to 20 in 101 points
    """
    began = clock.perf_counter()
    contact = sliding(model, contacts, "transient")
    t0, t1 = interval("time", time)
    choice("method", method, ("auto", "alpha", *METHODS))
    report = listener("progress", progress)
    if tol is not None and not TIGHTEST <= finite_number("tol", tol) <= 1e-2:
        raise InputError(f"tol must lie between {TIGHTEST:g} and 1e-2, not {tol!r}")
    choice("record", record, ("ports", "states"))
    whole = record == "states"
    # the recorded columns (n, c), with `whole` a unit matrix as the last n; and the place of each port, an index or a slice
    asked = [word("ports", name) for name in items("ports", ports, "names of ports")]
    loads = {name: model.port(name) for name in (*contact.ports, *asked)}
    widths = np.cumsum([0, *(column[0].size for column in loads.values())]).tolist()
    places: dict[str, Any] = {name: ends[0] if column.ndim == 1 else slice(*ends)
                              for (name, column), ends in zip(loads.items(), pairwise(widths), strict=True)}
    columns: Any = np.column_stack([np.zeros((model.size, 0)), *loads.values()])
    columns = sp.hstack([columns, sp.eye_array(model.size)], format="csr") if whole else columns
    if start is not None and impulse is not None:
        raise InputError("give either start or impulse, not both: an impulse starts from the sliding equilibrium")
    first = contact.impulse(1e-3 if impulse is None else impulse) if start is None else contact.checked(start)
    # the trajectory, ready to start, and the grid on which it is recorded, both in times since t0: far from 0, times are rounded
    span = t1 - t0
    flow: Flow | AlphaFlow
    if method == "alpha" or (method == "auto" and sp.issparse(model.K) and model.size > DENSE):
        grid = _grid(t0, t1, step, samples, record_from, 0.0)
        apart = float(grid[1] - grid[0]) if len(grid) > 1 else span
        flow = AlphaFlow(contact, first, t0, apart, TOL["alpha"] if tol is None else float(tol), columns)
    elif model.size > QUADRATIC:
        raise InputError(f"{method!r} is for dense models of up to {QUADRATIC} DOF, but {model.name!r} has {model.size}. Use "
                         "method='alpha', or reduce the model first")
    else:
        flow = Flow(contact, first, t0, TOL["dense"] if tol is None else float(tol), "lsoda" if method == "auto" else method,
                    columns)
        grid = _grid(t0, t1, step, samples, record_from, flow.highest)
    parts = [(np.zeros((0, columns.shape[1])),) * 2]
    reported = clock.perf_counter()
    with closing(flow), Interruptible() as course:
        for times, wanted in _stretches(span, grid, flow.stretch):
            q, v = flow.advance(times)
            parts.append((q[wanted], v[wanted]))
            if clock.perf_counter() - reported > 0.3:  # seconds: about three lines per second can be read
                reported = clock.perf_counter()
                report(f"t = {t0 + flow.t:.6g} of {t1:g}")
    q, v = (np.concatenate(pieces) for pieces in zip(*parts, strict=True))
    work, loss, change, common, energy = flow.balance
    largest = max(abs(work), abs(loss), abs(change), 1e-6 * energy)
    balance = EnergyBalance(work + common, loss, change + common, abs(work - loss - change) / largest if largest else 0.0)
    rounding = 0.0
    if start is not None:  # EPS (qᵀKq)^½ over the motion at the start; both are the square root of an energy
        place = first.displacement
        least = EPS * float(np.sqrt(max(place @ (model.K @ place), 0.0)))
        rounding = least / flow.begins if flow.begins else np.inf if least else 0.0
    run = Transient(contact, t0 + grid[:len(q)], {name: q[:, at] for name, at in places.items()},
                    {name: v[:, at] for name, at in places.items()},
                    (q[:, -model.size:], v[:, -model.size:]) if whole else None, first,
                    flow.state, t0 + flow.t, course.complete, balance,
                    Effort(flow.method, flow.tol, flow.steps, flow.rhs, flow.jacobians, clock.perf_counter() - began),
                    flow.error, rounding)
    log.info("%r", run)
    return run


def sticking(run: Transient, port: str = "belt", between: tuple[float, float] | None = None, *,
             multiple: float = STICKING, below: float | None = None) -> float:
    """The share of the time in which a belt's contact sticks: |v0 - wᵀq̇| ≤ multiple · ε, or ≤ `below` for a law without ε.

    A port of several columns sticks while any of them does, as for `LimitCycle.sticking`.

    Examples
    --------
    >>> import femsub as fs
    >>> run = fs.transient(fs.chain(5, belt=2), fs.Belt(speed=0.2, law=fs.StribeckArctan(eps=1e-2)), (0, 20))
    >>> fs.sticking(run)
    0.0
    """
    belt = instance("run", run, Transient).belt(port)
    parts = [part_of(run.t, one, between, 1)[1] for one in np.atleast_2d(run.velocity(port).T)]
    return float(belt.sticks(np.array(parts), multiple, below).any(axis=0).mean())


def _grid(t0: float, t1: float, step: float | None, samples: int | None, record_from: float | None, highest: float) -> Array:
    """The recorded times since t0."""
    begin = t0 if record_from is None else float(finite_number("record_from", record_from))
    if not t0 <= begin < t1:
        raise InputError(f"record_from must lie in the time from {t0:g} to {t1:g}, but is {begin:g}")
    if step is not None and samples is not None:
        raise InputError("give either step or samples, not both: one follows from the other")
    if samples is not None:
        whole_number("samples", samples, least=1, most=MOST_ASKED)
        return np.linspace(begin - t0, t1 - t0, samples + 1)
    if step is None:
        step = 2 * np.pi / (PER_PERIOD * highest) if highest else (t1 - begin) / 2000
        step = max(step, (t1 - begin) / MOST_POINTS)
    elif (t1 - begin) / positive_number("step", step) > MOST_ASKED:
        raise InputError(f"a step of {step:g} gives {(t1 - begin) / step:.1e} points, but at most {MOST_ASKED:.0e} are possible. "
                         "Use a larger step, or record_from")
    step = float(step)
    return begin - t0 + step * np.arange(int((t1 - begin) / step + EPS**0.5) + 1)


def _stretches(span: float, grid: Array, longest: float) -> Iterator[tuple[Array, Array]]:
    """Yields the times of each call of the integrator from 0 to `span`, and which of them are recorded.

    From the first point of the grid on, each call ends at a point of the grid. The calls depend on the grid and the model only,
    so a run can be repeated exactly.
    """
    for pair in pairwise(np.linspace(0.0, grid[0], int(np.ceil(grid[0] / longest)) + 1)):
        yield np.array(pair), np.zeros(2, dtype=bool)
    apart = float(grid[1] - grid[0]) if len(grid) > 1 else longest
    count = max(1, int(longest / apart))
    rest = [span] if len(grid) == 1 or span - grid[-1] > EPS**0.5 * apart else []
    for at in range(0, max(1, len(grid) - 1), count):
        times = np.append(grid[at:at + count + 1], rest if at + count >= len(grid) - 1 else [])
        yield times, (times <= grid[-1]) & ((times > times[0]) | (at == 0))
