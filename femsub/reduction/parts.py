"""The parts of a system, each reduced by a method of its own, and joined again."""

from __future__ import annotations

import logging
import weakref
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace

import scipy.sparse as sp

from femsub.algebra import LARGE, WORK, check_workers, kept_free, one_thread, reduction_bytes, same, side_by_side
from femsub.checks import DENSE, choice, instance, shown
from femsub.coupling import Belt, System
from femsub.errors import InputError, InputTypeError, WorkerError
from femsub.model import ReducedSubstructure, Substructure
from femsub.reduction.basis import assembled
from femsub.reduction.craig_bampton import CraigBampton
from femsub.reduction.estimates.joined import JoinedSpace
from femsub.reduction.estimates.search import Goal, chosen
from femsub.reduction.interface_modes import with_common_shapes
from femsub.reduction.method import FIRST, Method, checked, finished, reduced, whole_basis
from femsub.reduction.wider import Wider

log = logging.getLogger("femsub.reduction.reduce")  # of the function that users call

ADVICE = "Go on with reduce(system, methods | error.done)"


def part_by_part(sub: Substructure, methods: Mapping[str, Method | ReducedSubstructure], ports: bool | Sequence[str],
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
    first: dict[str, str] = {}  # the part that a part is equal to, or its own name
    seen: dict[tuple[object, ...], list[str]] = {}  # parts that are equal to no earlier one, by their marks
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
    largest = sorted(tasks, key=lambda name: -tasks[name].sub.size)  # they begin
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
    for name in first:  # of models that workers made, too
        part, method = system.parts[name], methods[name]
        assert isinstance(method, Method)
        found[name]._set(wider=Wider(weakref.ref(part), part if part.size <= DENSE else None, method.held))
    return system.with_parts(with_common_shapes(system, {name: found[name] for name in methods}))


def _common_goal(methods: Mapping[str, Method | ReducedSubstructure]) -> Goal | None:
    """The band and the tolerance that the methods of the parts share, or None where each has a number of modes.

    Raises
    ------
    InputError
        The parts have different ones, or a method whose modes are not those of a system with its interfaces held.
    """
    goals = {name: goal for name, method in methods.items() if isinstance(method, Method) and (goal := method.goal) is not None}
    if not goals:
        return None
    (first, goal), *_ = goals.items()
    for name, other in goals.items():
        if other != goal:
            raise InputError(f"band and tol are those of the system, the same for all parts, but {first!r} has {goal.tol:g} in "
                             f"{goal.band} and {name!r} {other.tol:g} in {other.band}")
    for name, method in methods.items():
        if not (isinstance(method, CraigBampton) and type(method).kept is CraigBampton.kept):
            raise InputError("modes are chosen for the band of a system where its parts are reduced by CraigBampton or Hurty, "
                             f"not by {method} ({name!r}). Give numbers of modes to all parts, and ask fs.system_estimate what "
                             "their reductions cost the system")
    return goal


def _equal(one: Substructure, other: Substructure) -> bool:
    """Whether two full components have the same matrices, interface and ports, whatever their names and places."""
    if one is other:
        return True
    if type(one) is not Substructure or type(other) is not Substructure or list(one.ports) != list(other.ports):
        return False
    if (one.H is None) != (other.H is None):
        return False
    pairs = [(getattr(one, key), getattr(other, key)) for key in ("interface", "K", "M", "D", "H")]
    return all(same(A, B) for A, B in [*pairs, *zip(one.ports.values(), other.ports.values(), strict=True)])


def _twins(made: Mapping[str, ReducedSubstructure], first: Mapping[str, str], system: System) -> dict[str, ReducedSubstructure]:
    """The models by part, where each part has that of the part it is equal to, with its own name, DOF map and sets."""
    parts = system.parts
    return {name: made[one] if parts[name] is parts[one] else replace(
        made[one], name=parts[name].name, full_dofs=parts[name].dofs, interface_dofs=parts[name].interface_dofs,
        sets=parts[name].sets) for name, one in first.items() if one in made}


def _together(system: System, methods: Mapping[str, Method], ports: bool, contacts: Belt | Sequence[Belt] | None,
              goal: Goal) -> System:
    """The parts reduced so that the system meets a tolerance; see `chosen`."""
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
