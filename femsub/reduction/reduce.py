"""`reduce`: from a component and a method, or a system and methods of its parts, to a reduced model."""

from __future__ import annotations

import logging
import weakref
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any, overload

import scipy.sparse as sp

from femsub.algebra import LARGE, WORK, check_workers, kept_free, one_thread, reduction_bytes, reused_memory, same, side_by_side
from femsub.checks import DENSE, InputError, InputTypeError, WorkerError, choice, instance, shown
from femsub.coupling import Belt, System
from femsub.model import Affine, Contacts, ReducedSubstructure, Substructure, family_of
from femsub.reduction.basis import assembled
from femsub.reduction.contact_modes import ContactModes
from femsub.reduction.craig_bampton import CraigBampton
from femsub.reduction.craig_chang import CraigChang
from femsub.reduction.dual_craig_bampton import DualCraigBampton
from femsub.reduction.estimates.joined import JoinedSpace
from femsub.reduction.estimates.search import Goal, chosen
from femsub.reduction.guyan import Guyan
from femsub.reduction.herting import Herting
from femsub.reduction.hurty import Hurty
from femsub.reduction.interface_modes import InterfaceModes, with_common_shapes
from femsub.reduction.macneal import MacNeal
from femsub.reduction.method import FIRST, METHODS, PORT_LIMIT, Method, checked, finished, reduced, whole_basis
from femsub.reduction.over_box import over_box
from femsub.reduction.parameter_box import BoxModel, ParameterBox
from femsub.reduction.rubin import Rubin
from femsub.reduction.wider import Wider

log = logging.getLogger(__name__)

ADVICE = "Go on with reduce(system, methods | error.done)"
#: importing the methods registers them
__all__ = ["METHODS", "PORT_LIMIT", "ContactModes", "CraigBampton", "CraigChang", "DualCraigBampton", "Guyan",
           "Herting", "Hurty", "InterfaceModes", "MacNeal", "Method", "Rubin", "reduce"]


@overload
def reduce(sub: Substructure, method: Method, ports: bool | Sequence[str] = ...,
           contacts: Belt | Sequence[Belt] | None = ...) -> ReducedSubstructure: ...


@overload
def reduce(sub: Substructure | Affine, method: ParameterBox, *, contacts: Contacts = ...) -> BoxModel: ...


@overload
def reduce(sub: Substructure, method: Mapping[str, Method | ReducedSubstructure], ports: bool = ...,
           contacts: Belt | Sequence[Belt] | None = ..., *, workers: int | None = ...,
           executor: Executor | None = ...) -> System: ...


def reduce(sub: Any, method: Any, ports: bool | Sequence[str] = False, contacts: Any = None, *, workers: int | None = None,
           executor: Executor | None = None) -> ReducedSubstructure | System | BoxModel:
    """Replace a component by a small one: project it onto the basis V of a reduction method.

    The result has the matrices VᵀMV, VᵀDV, VᵀKV (r, r) and the ports Vᵀw, with V (n, r) from the method.

    ``CraigBampton(modes=20)`` keeps that many modes. ``CraigBampton(band=(0, hi), tol=1e-3)`` keeps as few as possible:

    - Every frequency ω of the undamped model in the band is estimated to be within the relative error `tol`.
    - If the model is damped or has `contacts`, the same holds for every complex eigenvalue with Im λ and |Re λ| up to hi.
    - hi is below 0.7 of the cut-off frequency.

    The estimate needs no solution of the full model. Its figures are in ``.estimate`` (see `Nested.bounds` and
    `Nested.doubt`). A DOF with damping but no mass has a real λ of its own. The reduced model has this λ only if the DOF is
    interface or port. Structural damping is reduced to VᵀHV. The estimate neglects it.

    For a system, band and tolerance hold for the whole system. All parts with a tolerance have the same band and tolerance, and
    are reduced by `CraigBampton` or `Hurty`. The number of modes of each part is chosen so that the system is within `tol`, with
    few modes in total, and with all modes of the parts up to hi.

    Parameters
    ----------
    sub : Substructure
        Full, or itself reduced.
    method : CraigBampton, CraigChang or another `Method`
        With its number of modes, or with a band and a tolerance. For a system it may be a mapping, {'disc': CraigBampton(20)}:
        these parts are reduced, each by its own method, and joined again; the other parts stay. Equal parts with equal methods
        are reduced once. An earlier reduced model of a part may replace the method. With a `ParameterBox`, one small model
        serves all values of the parameters of an `Affine`, or of a model with `contacts`.
    ports : bool or sequence of str
        True, or the names of ports: adds the static responses to these ports to the basis.
    contacts : Belt or sequence of Belt, optional
        Only with a tolerance: the belts under which the complex eigenvalues must be accurate. Default: only the model's own D.
        With a `ParameterBox`: contacts of any kind, whose fields are the parameters.
    workers : int, optional
        Only for a system: number of processes that reduce its parts in parallel, each with one BLAS thread. Default: no others.
    executor : concurrent.futures.Executor, optional
        Reduces the parts instead of `workers`: an executor of dask (``client.get_executor()``), of mpi4py, or any other.
        Its processes must see this machine's temporary folder (environment variable TMPDIR).

    Returns
    -------
    ReducedSubstructure, System where the parts were reduced one by one, or BoxModel
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
        No basis meets the tolerance; the message says how accurate the largest one is.
    NotEnoughMemoryError
        The reduction needs more memory than is free.
    WorkerError
        A worker process died or ran out of memory. ``.part`` names its part, ``.done`` holds the other parts' models:
        ``reduce(system, methods | error.done)`` continues from there.

    Notes
    -----
    With workers the results are equal to the last digit to those of a single process with one thread of BLAS
    (OMP_NUM_THREADS=1). The factors of the parts are lost when the workers end. A later step that needs a factor, such as
    `refine`, computes it again. A script that uses workers must start them under ``if __name__ == "__main__":``.

    Examples
    --------
    >>> import femsub as fs
    >>> sub = fs.chain(10, belt=1)
    >>> fs.reduce(sub, fs.CraigBampton(modes=4))
    ReducedSubstructure 'chain': 5 of 10 DOF by Craig-Bampton with 4 fixed-interface modes, cut-off 1.355 rad/time
    """
    if isinstance(method, ParameterBox):
        if ports is not False or workers is not None or executor is not None:
            raise InputError("a ParameterBox takes no ports, workers or executor, but contacts: reduce(sub, box, contacts=...)")
        return over_box(family_of(sub, contacts, list(method.ranges), method.ranges, apart=True), method)
    if isinstance(method, Mapping):
        return _part_by_part(sub, method, ports, contacts, workers, executor)
    if workers is not None or executor is not None:
        raise InputError("workers and executor are for the parts of a system: give a method for each part, as in "
                         "reduce(system, {'disc': CraigBampton(20), 'pad': CraigBampton(10)}, workers=2)")
    with reused_memory(getattr(sub, "size", 0)):
        return reduced(sub, method, ports, contacts)


def _part_by_part(sub: Substructure, methods: Mapping[str, Method | ReducedSubstructure], ports: bool | Sequence[str],
                  contacts: Belt | Sequence[Belt] | None, workers: int | None, executor: Executor | None) -> System:
    """The system with reduced parts; see `reduce`."""
    system = instance("sub", sub, System, "made by couple, where each part has a method of its own")
    if not isinstance(ports, bool):
        raise InputTypeError(f"ports must be True or False where the parts of a system are reduced, not {shown(ports)}")
    check_workers(workers, executor)
    for name in methods:
        choice("part", name, system.parts)
    if system.own_damping:
        system.with_parts({})  # refuses, before any work
    if (wanted := _common_goal(methods)) is not None:
        if workers is not None or executor is not None:
            raise InputError("workers reduce parts by given numbers of modes; with a tolerance the modes of all parts are chosen "
                             "together, in this process. Leave workers out, or give modes=")
        return _together(system, {name: one for name, one in methods.items() if isinstance(one, Method)}, ports, contacts, wanted)
    if contacts is not None:
        raise InputError("contacts belong to one component with a tolerance, or to a system whose parts are given one: with "
                         "numbers of modes they have no effect. Leave them out")
    found: dict[str, ReducedSubstructure] = {}
    first: dict[str, str] = {}  # for each part, the first part that is equal to it
    seen: dict[tuple[object, ...], list[str]] = {}  # the first of equal parts, by their marks
    for name, method in methods.items():
        part = system.parts[name]
        if isinstance(method, ReducedSubstructure):
            full = len(part.V) if isinstance(part, ReducedSubstructure) else part.size
            if len(method.V) not in (part.size, full):
                raise InputError(f"the part {name!r} has {full} DOF, but {method!r} was made of {len(method.V)}")
            found[name] = method
        else:
            marks = part.size, len(part.interface), *(float(A.diagonal().sum()) for A in (part.K, part.M))
            alike = seen.setdefault(marks, [])
            first[name] = next((one for one in alike if methods[one] == method and _equal(system.parts[one], part)), name)
            if first[name] == name:
                alike.append(name)
    tasks = {name: checked(system.parts[name], methods[name], ports, None)  # type: ignore[arg-type]
             for name in first if first[name] == name}
    largest = sorted(tasks, key=lambda name: -tasks[name].sub.size)  # the largest parts are reduced first
    beside = sum(tasks[name].sub.size for name in largest[:workers or 1])
    needs = {name: sum(reduction_bytes(task.sub.K, task.columns, task.method.modes or FIRST, task.held).values())
             for name, task in tasks.items() if beside >= LARGE and sp.issparse(task.sub.K)}
    try:
        made = side_by_side(reduced, {name: (tasks[name].sub, tasks[name].method, ports) for name in largest}, workers, executor,
                            needs=needs, advice=ADVICE)
    except WorkerError as error:
        error.done.update(found | _twins(error.done, first, system))
        raise
    found |= _twins(made, first, system)
    for name in first:  # models from workers have lost their reference to the full part
        part, method = system.parts[name], methods[name]
        assert isinstance(method, Method)
        found[name]._set(wider=Wider(weakref.ref(part), part if part.size <= DENSE else None, method.held))
    return system.with_parts(with_common_shapes(system, {name: found[name] for name in methods}))


def _common_goal(methods: Mapping[str, Method | ReducedSubstructure]) -> Goal | None:
    """The band and the tolerance that the methods of the parts share, or None where each has a number of modes.

    Raises
    ------
    InputError
        The parts have different bands or tolerances, or a method does not keep modes with the interface fixed.
    """
    goals = {name: goal for name, method in methods.items() if isinstance(method, Method) and (goal := method.goal) is not None}
    if not goals:
        return None
    (first, goal), *_ = goals.items()
    for name, other in goals.items():
        if other != goal:
            raise InputError(f"band and tol hold for the whole system and must be the same for all parts, but {first!r} has "
                             f"{goal.tol:g} in {goal.band} and {name!r} {other.tol:g} in {other.band}")
    for name, method in methods.items():
        if not (isinstance(method, CraigBampton) and type(method).kept is CraigBampton.kept):
            raise InputError("modes are chosen for the band of a system where its parts are reduced by CraigBampton or Hurty, "
                             f"not by {method} ({name!r}). Give numbers of modes to all parts, and ask fs.system_estimate what "
                             "their reductions cost the system")
    return goal


def _equal(one: Substructure, other: Substructure) -> bool:
    """Whether two full components have the same matrices, interface and ports. Names and positions may differ."""
    if one is other:
        return True
    if type(one) is not Substructure or type(other) is not Substructure or list(one.ports) != list(other.ports):
        return False
    if (one.H is None) != (other.H is None):
        return False
    pairs = [(getattr(one, key), getattr(other, key)) for key in ("interface", "K", "M", "D", "H")]
    return all(same(A, B) for A, B in [*pairs, *zip(one.ports.values(), other.ports.values(), strict=True)])


def _twins(made: Mapping[str, ReducedSubstructure], first: Mapping[str, str], system: System) -> dict[str, ReducedSubstructure]:
    """The reduced model of each part. Equal parts share one model, but each has its own name, DOF map and sets."""
    parts = system.parts
    return {name: made[one] if parts[name] is parts[one] else replace(
        made[one], name=parts[name].name, full_dofs=parts[name].dofs, interface_dofs=parts[name].interface_dofs,
        sets=parts[name].sets) for name, one in first.items() if one in made}


def _together(system: System, methods: Mapping[str, Method], ports: bool, contacts: Belt | Sequence[Belt] | None,
              goal: Goal) -> System:
    """The system with its parts reduced so that the system meets a tolerance; see `chosen`."""
    tasks = {name: checked(system.parts[name], method, ports, None) for name, method in methods.items()}
    parts = {name: task.method.part(task.sub) for name, task in tasks.items()}
    with one_thread(sum(task.work for task in tasks.values()) < WORK), kept_free(sum(task.beside for task in tasks.values())):
        statics = {name: tasks[name].method.statics(part, part.factored(), tasks[name].extra) for name, part in parts.items()
                   if len(part.sub.interior)}
        given = {name: count for name in statics if (count := methods[name].modes) is not None}
        kept, estimate = chosen(JoinedSpace(system, statics, contacts, goal.band[1], given), goal)
        bases = {name: assembled(statics[name], kept[name], task.ports, task.method.mode_kind) if name in statics
                 else whole_basis(task, parts[name], judged=False) for name, task in tasks.items()}
    found = system.with_parts({name: finished(task, parts[name], bases[name], statics.get(name), kept.get(name))
                               for name, task in tasks.items()})
    log.info("%r: %r", found, estimate)
    return found.estimated_by(estimate)
