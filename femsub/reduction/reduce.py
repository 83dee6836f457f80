"""`reduce`: from a component and a method to a reduced model, step by step."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, overload

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, choice, instance, shown
from femsub.errors import InputError, InputTypeError, PortWarning, WorkerError, warn
from femsub.linalg.factor import SMALL
from femsub.linalg.memory import LARGE, check_memory, reduction_bytes
from femsub.linalg.threads import WORK, one_thread
from femsub.linalg.workers import check_workers, side_by_side
from femsub.model.assembly import System
from femsub.model.estimate import SHARE
from femsub.model.matrices import same
from femsub.model.substructure import ReducedSubstructure, Substructure
from femsub.modes.normal_modes import confirm
from femsub.reduction.basis import Basis, Kept, projected
from femsub.reduction.common_shapes import with_common_shapes
from femsub.reduction.contact_modes import ContactModes
from femsub.reduction.craig_bampton import CraigBampton
from femsub.reduction.craig_chang import CraigChang
from femsub.reduction.craig_chang_physical import CraigChangPhysical
from femsub.reduction.dual_craig_bampton import DualCraigBampton
from femsub.reduction.guyan import Guyan
from femsub.reduction.herting import Herting
from femsub.reduction.hurty import Hurty
from femsub.reduction.interface_modes import InterfaceModes
from femsub.reduction.macneal import MacNeal
from femsub.reduction.method import METHODS, Method
from femsub.reduction.mode_selection import unreduced
from femsub.reduction.rubin import Rubin
from femsub.reduction.statics import Partition, Statics, square
from femsub.reduction.system_modes import Goal, chosen_together, common_goal

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from femsub.model.friction import Belt
    from femsub.model.pencil import Pencil

log = logging.getLogger(__name__)

FIRST = 100  # assumed number of modes if it follows from a tolerance, for the choice of threads
ADVICE = "Go on with reduce(system, methods | error.done)"
PORT_LIMIT = 0.01  # relative error of a port's static response (energy norm) above which `reduce` warns

#: importing the methods registers them
__all__ = ["METHODS", "ContactModes", "CraigBampton", "CraigChang", "CraigChangPhysical", "DualCraigBampton", "Guyan", "Herting",
           "Hurty", "InterfaceModes", "MacNeal", "Method", "Rubin", "reduce"]


@overload
def reduce(sub: Substructure, method: Method, ports: bool | Sequence[str] = ...,
           contacts: Belt | Sequence[Belt] | None = ...) -> ReducedSubstructure: ...


@overload
def reduce(sub: Substructure, method: Mapping[str, Method | ReducedSubstructure], ports: bool = ...,
           contacts: Belt | Sequence[Belt] | None = ..., *, workers: int | None = ...,
           executor: Executor | None = ...) -> System: ...


def reduce(sub: Substructure, method: Method | Mapping[str, Method | ReducedSubstructure], ports: bool | Sequence[str] = False,
           contacts: Belt | Sequence[Belt] | None = None, *, workers: int | None = None,
           executor: Executor | None = None) -> ReducedSubstructure | System:
    """Replace a component by a small one: project it onto the basis V of a reduction method.

    The result has the matrices VᵀMV, VᵀDV, VᵀKV (r, r) and the ports Vᵀw, with V (n, r) from the method.

    ``CraigBampton(modes=20)`` keeps that many modes. ``CraigBampton(band=(0, hi), tol=1e-3)`` keeps as few as possible:

    - Every frequency ω of the undamped model in the band is estimated to be within the relative error `tol`.
    - If the model is damped or has `contacts`, the same holds for every complex eigenvalue with Im λ and |Re λ| up to hi.
    - hi is below 0.7 of the cut-off frequency.

    The estimate needs no solution of the full model. Its figures are in ``.estimate`` (see `Nested.bounds` and
    `Nested.doubt`). A DOF with damping but no mass has a real λ of its own. It is kept only if the DOF is interface or port.

    Of a system, band and tolerance are the system's. All parts that have one have the same, and are reduced by `CraigBampton`
    or `Hurty`. The modes of each part are then chosen so that the system is within `tol`, with few modes in all, and with all
    modes of the parts up to hi.

    Parameters
    ----------
    sub : Substructure
        Full, or itself reduced.
    method : CraigBampton, CraigChang or another `Method`
        With its number of modes, or with a band and a tolerance. Of a system it may be a mapping, {'disc': CraigBampton(20)}:
        these parts are reduced, each by its own method, and joined again; the other parts stay. Equal parts with equal methods
        are reduced once. A model that a part was reduced to before may stand in place of the method.
    ports : bool or sequence of str
        True, or the names of ports: adds the static responses to these ports to the basis.
    contacts : Belt or sequence of Belt, optional
        Only with a tolerance: the belts under which the complex eigenvalues must be accurate. Default: only the model's own D.
    workers : int, optional
        Of a system: so many processes reduce its parts side by side, each with one thread of BLAS. Default: this process alone.
    executor : concurrent.futures.Executor, optional
        Reduces the parts instead of processes started for this call: that of dask (``client.get_executor()``), of mpi4py or any
        other. Its processes must see this machine's temporary folder (environment variable TMPDIR).

    Returns
    -------
    ReducedSubstructure, or System where the parts were reduced one by one
        A `Substructure` again; ``.expand(q)`` gives the displacements of the full component.

    Warns
    -----
    PortWarning
        The static response to a port's force is wrong by more than 1 % in the energy norm; see ``.port_error``.

    Raises
    ------
    InputError, InputTypeError
        An unknown method or port; more modes than there are; an interface that does not hold the component (Craig-Bampton);
        contacts without a tolerance.
    NotConvergedError
        No basis meets the tolerance; the message tells how accurate the largest one is.
    NotEnoughMemoryError
        The reduction needs more memory than is free.
    WorkerError
        A worker process died or ran out of memory. ``.part`` names its part, ``.done`` holds the other parts' models:
        ``reduce(system, methods | error.done)`` goes on from there.

    Notes
    -----
    With workers the results are those of one process to the last digit, if that uses one thread of BLAS, too
    (OMP_NUM_THREADS=1). The factors of the parts are made in the workers and end with them. What needs one later, as `refine`
    does, makes it again. A script that uses workers must begin its work under ``if __name__ == "__main__":``.

    Examples
    --------
    >>> import femsub as fs
    >>> sub = fs.chain(10, belt=1)
    >>> fs.reduce(sub, fs.CraigBampton(modes=4))
    ReducedSubstructure 'chain': 5 of 10 DOF by Craig-Bampton with 4 fixed-interface modes, cut-off 1.355 rad/time
    """
    if isinstance(method, Mapping):
        return _part_by_part(sub, method, ports, contacts, workers, executor)
    if workers is not None or executor is not None:
        raise InputError("workers and executor are for the parts of a system: name them with their methods, as in "
                         "reduce(system, {'disc': CraigBampton(20), 'pad': CraigBampton(10)}, workers=2)")
    task = _checked(sub, method, ports, contacts)
    with one_thread(_work(task) < WORK):
        part = method.part(sub)
        basis = _basis(task.turned(part), part) if len(part.sub.interior) or not method.held else _whole(task, part)
        if not basis.V.shape[1]:
            raise InputError(f"the basis for {sub.name!r} would be empty: modes=0, and no interface is given. Ask for modes, or "
                             "name interface DOF")
        rom = method.finished(sub, _projected(task, basis if part.turn is None else replace(basis, V=part.turn @ basis.V)))
    log.info("%r", rom)
    return rom


def _part_by_part(sub: Substructure, methods: Mapping[str, Method | ReducedSubstructure], ports: bool | Sequence[str],
                  contacts: Belt | Sequence[Belt] | None, workers: int | None, executor: Executor | None) -> System:
    system = instance("sub", sub, System, "made by couple, where each part has a method of its own")
    if not isinstance(ports, bool):
        raise InputTypeError(f"ports must be True or False where the parts of a system are reduced, not {shown(ports)}")
    check_workers(workers, executor)
    for name in methods:
        choice("part", name, system.parts)
    if (wanted := common_goal(methods)) is not None:
        if workers is not None or executor is not None:
            raise InputError("workers reduce parts by given numbers of modes; with a tolerance the modes of all parts are chosen "
                             "together, in this process. Leave workers out, or give modes=")
        chosen = {name: one for name, one in methods.items() if isinstance(one, Method)}
        return _together(system, chosen, ports, contacts, wanted)
    if contacts is not None:
        raise InputError("contacts belong to one component with a tolerance, or to a system whose parts are given one: with "
                         "numbers of modes they have no effect. Leave them out")
    found: dict[str, ReducedSubstructure] = {}
    first: dict[str, str] = {}  # the part that a part is equal to, or its own name
    for name, method in methods.items():
        part = system.parts[name]
        if isinstance(method, ReducedSubstructure):
            full = len(part.V) if isinstance(part, ReducedSubstructure) else part.size
            if len(method.V) not in (part.size, full):
                raise InputError(f"the part {name!r} has {full} DOF, but {method!r} was made of {len(method.V)}")
            found[name] = method
        else:
            first[name] = next((one for one in first if first[one] == one and _equal(system.parts[one], part)
                                and methods[one] == method), name)
    tasks = {name: _checked(system.parts[name], methods[name], ports, None)  # type: ignore[arg-type]
             for name in first if first[name] == name}
    largest = sorted(tasks, key=lambda name: -tasks[name].sub.size)  # they begin
    beside = sum(tasks[name].sub.size for name in largest[:workers or 1])
    needs = {name: sum(reduction_bytes(task.sub.K, task.static_columns, task.method.modes or FIRST).values())
             for name, task in tasks.items() if beside >= LARGE and sp.issparse(task.sub.K)}
    try:
        made = side_by_side(reduce, {name: (tasks[name].sub, tasks[name].method, ports) for name in largest}, workers, executor,
                            needs=needs, advice=ADVICE)
    except WorkerError as error:
        error.done.update(found | _twins(error.done, first, system))
        raise
    found |= _twins(made, first, system)
    return system.with_parts(with_common_shapes(system, {name: found[name] for name in methods}))


def _equal(one: Substructure, other: Substructure) -> bool:
    """Whether two full components have the same matrices, interface and ports, whatever their names and places."""
    if one is other:
        return True
    if type(one) is not Substructure or type(other) is not Substructure or list(one.ports) != list(other.ports):
        return False
    pairs = [(getattr(one, key), getattr(other, key)) for key in ("interface", "K", "M", "D")]
    return all(same(A, B) for A, B in [*pairs, *zip(one.ports.values(), other.ports.values(), strict=True)])


def _twins(made: Mapping[str, ReducedSubstructure], first: Mapping[str, str], system: System) -> dict[str, ReducedSubstructure]:
    """The models by part, where each part has that of the part it is equal to, with its own name, DOF map and sets."""
    parts = system.parts
    return {name: made[one] if parts[name] is parts[one] else replace(
        made[one], name=parts[name].name, full_dofs=parts[name].dofs, interface_dofs=parts[name].interface_dofs,
        sets=parts[name].sets) for name, one in first.items() if one in made}


def _together(system: System, methods: Mapping[str, Method], ports: bool, contacts: Belt | Sequence[Belt] | None,
              goal: Goal) -> System:
    """The parts reduced so that the system meets a tolerance; see `chosen_together`."""
    tasks = {name: _checked(system.parts[name], method, ports, None) for name, method in methods.items()}
    parts = {name: task.method.part(task.sub) for name, task in tasks.items()}
    with one_thread(sum(map(_work, tasks.values())) < WORK):
        statics = {name: tasks[name].method.statics(part, part.factored(), tasks[name].extra) for name, part in parts.items()
                   if len(part.sub.interior)}
        kept, estimate = chosen_together(system, statics, {name: task.method.modes for name, task in tasks.items()
                                                           if name in statics and task.method.modes is not None},
                                         contacts, goal)
        bases = {name: _finished(task, statics[name], kept[name]) if name in statics else _whole(task, parts[name], False)
                 for name, task in tasks.items()}
    found = system.with_parts({name: _projected(task, bases[name]) for name, task in tasks.items()})
    log.info("%r: %r", found, estimate)
    return found.estimated_by(estimate)


@dataclass(frozen=True, eq=False)
class _Task:
    """The checked arguments of `reduce`. `extra` (n, s) holds the port columns whose static responses join the basis.

    `pencil` is the damped model whose complex eigenvalues must be within the tolerance.
    """

    sub: Substructure
    method: Method
    ports: Mapping[str, Array]
    extra: Array
    pencil: Pencil | None

    @property
    def static_columns(self) -> int:
        """Static shapes of the method, and responses to the ports: those that join the basis, and those that judge it."""
        return self.method.static_columns(self.sub) + self.extra.shape[1] + sum(w.shape[1] for w in self.ports.values())

    def turned(self, part: Partition) -> _Task:
        """In the coordinates of the part, where these are others."""
        T = part.turn
        if T is None:
            return self
        pencil = None if self.pencil is None else part.sub.with_damping(T.T @ (self.pencil.D @ T)).pencil
        return replace(self, ports={name: T.T @ w for name, w in self.ports.items()}, extra=T.T @ self.extra, pencil=pencil)


def _checked(sub: Substructure, method: Method, ports: bool | Sequence[str],
             contacts: Belt | Sequence[Belt] | None) -> _Task:
    instance("sub", sub, Substructure)
    if not isinstance(method, Method):
        raise InputTypeError(f"unknown method {method!r}; valid: {', '.join(m.__name__ for m in METHODS.values())}")
    if len(sub.interface_rows.shape) == 2 and sub.interface_rows.shape[0] != len(sub.interface):
        raise InputError(f"{sub.name!r} is already reduced, and its interface is spread over generalised coordinates (as "
                         "Craig-Chang does). Reduce the full component instead")
    if isinstance(ports, str) or not isinstance(ports, (bool, Sequence)):
        raise InputTypeError(f"ports must be True, False or a sequence of port names, not {ports!r}")
    columns = {name: w.reshape(len(w), -1) for name, w in sub.ports.items()}
    names = list(sub.ports) if ports is True else list(ports or [])
    for name in names:
        sub.port(name)
    extra = np.hstack([np.zeros((sub.size, 0)), *(columns[name] for name in names)])
    if contacts is not None and method.band is None:
        raise InputError("contacts have no effect on a basis with a given number of modes. Leave them out, or give a band and a "
                         f"tolerance, e.g. {type(method).__name__}(band=(0, 2e3), tol=1e-3)")
    pencil = None
    if method.band is not None:
        pencil = method.judged(sub, contacts)
        if method.band[1] >= SHARE * sub.cutoff:
            raise InputError(f"the band ends at {method.band[1]:.5g} rad/time, but {sub.name!r} is already reduced, with a "
                             f"cut-off of {sub.cutoff:.5g}. End the band below {SHARE:g} of that, or reduce the full component")
    task = _Task(sub, method, columns, extra, pencil)
    check_memory(sub.name, sub.K, task.static_columns, method.modes or 0, method.static_columns(sub))
    return task


def _basis(task: _Task, part: Partition) -> Basis:
    """The four steps; a method may override each."""
    statics = task.method.statics(part, part.factored(), task.extra)
    return _finished(task, statics, task.method.kept(statics, task.pencil))


def _finished(task: _Task, statics: Statics, kept: Kept) -> Basis:
    """The last two steps, and the count of the modes."""
    method = task.method
    responses = method.responses(statics, kept, task.ports)
    statics.handle.release()  # frees memory before `confirm` makes a factor of its own
    confirm(statics.handle, kept.found)
    return method.basis(statics, kept, responses, task.ports)


def _whole(task: _Task, part: Partition, judged: bool = True) -> Basis:
    """The basis of a component whose DOF are all interface: the identity, nothing is left out.

    In a system it is not judged by itself: it may be a point mass, which has no modes.
    """
    sub, method, b = part.sub, task.method, part.sub.interface
    if method.modes and sub is task.sub:
        raise InputError(f"{method.modes} {method.mode_kind} modes were asked for, but every DOF is interface, so there are "
                         "none. Use modes=0, or a smaller interface")
    estimate = unreduced(sub.K, sub.M, method.band, method.tol, task.pencil) if judged and method.band is not None else None
    return Basis(np.eye(sub.size)[:, b], square(sub.M, b), square(sub.K, b), ("constraint",) * len(b), 0, np.inf,
                 task.extra.shape[1], dict.fromkeys(task.ports, 0.0), 0, estimate)


def _projected(task: _Task, basis: Basis) -> ReducedSubstructure:
    sub, V = task.sub, basis.V
    title = task.method.title(basis.modes)
    for name, error in basis.port_error.items():
        if error > PORT_LIMIT:
            warn(
                f"port {name!r} of {sub.name!r}: its static response is off by {error:.2g} in the energy norm with "
                f"{title}. Put its DOF into the interface, or call reduce(..., ports=True)", PortWarning)
    cutoff = min(np.inf if V.shape[1] == sub.size else basis.cutoff, sub.cutoff)
    estimate = None if basis.estimate is None else replace(basis.estimate, cutoff=cutoff)
    return ReducedSubstructure(
        basis.M, basis.K, projected(sub.D, V, V), {name: V.T @ w for name, w in sub.ports.items()}, sub.name, V=V,
        kinds=basis.kinds, modes=basis.modes, full_interface=sub.interface, cutoff=cutoff, method=title,
        dropped=basis.dropped, port_error=basis.port_error, factorisations=basis.factorisations, full_dofs=sub.dofs,
        interface_dofs=sub.interface_dofs, sets=sub.sets, estimate=estimate)


def _work(task: _Task) -> float:
    """Approximate number of multiplications in the dense part of a reduction; decides about threads."""
    sub, kept = task.sub, FIRST if task.method.modes is None else task.method.modes
    if not sp.issparse(sub.K) or sub.size <= SMALL or kept > 0.3 * sub.size:
        return float(sub.size) ** 3
    return float(sub.size) * (kept + task.method.static_columns(sub) + task.extra.shape[1]) ** 2
