"""Limit cycles of several models of one structure. Cycles that begin from the same mode are a family, and are compared.

Small models come first. A large model, whose modes are not computed, starts from the cycles of the other models.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from femsub.checks import Array, NoCycleError, NotConvergedError, listener
from femsub.coupling import Belt
from femsub.model import Contact, Substructure
from femsub.motion.cycles.branch import Branch, branch
from femsub.motion.cycles.compliance import small
from femsub.motion.cycles.continuation import with_parameter
from femsub.motion.cycles.initial_guess import of_signal
from femsub.motion.cycles.limit_cycle import LimitCycle, harmonic_balance
from femsub.motion.nonlinear_model import State, sliding
from femsub.motion.signals import period_near, spectrum
from femsub.motion.transient import transient
from femsub.output import label

Report = Callable[[str], None] | None


def in_turn(models: Mapping[str, Substructure]) -> dict[str, Substructure]:
    """Models by their keys, small ones first."""
    return dict(sorted(models.items(), key=lambda item: not small(item[1])))


def family_cycles(models: Mapping[str, Substructure], contacts: Sequence[Contact], family: float, near: float = 0.05,
                  progress: Report = None) -> list[dict[str, Any]]:
    """For each model, the cycle that begins from the mode at ω = `family`, or why there is none; with errors against 'full'.

    A cycle belongs to the mode if their frequencies differ by at most the share `near`. A large model starts from the cycle of
    the model before it.
    """
    report, rows, found = listener("progress", progress), list[dict[str, Any]](), dict[str, LimitCycle]()
    for name, model in in_turn(models).items():
        report(f"limit cycle of {label(name)} near ω = {family:.4g}")
        begun = time.perf_counter()
        rows.append({"family": family, "model": name, "size": model.size})
        try:
            start: Any = family if small(model) else next(reversed(found.values()), None)
            if start is None:
                raise NotConvergedError("no reduced model gave a cycle to start from")
            cycle = harmonic_balance(model, contacts, start=start)
            if abs(cycle.omega / family - 1) > near:
                raise NotConvergedError(f"only another cycle was found, at ω = {cycle.omega:.5g}")
        except (NotConvergedError, NoCycleError) as error:
            rows[-1]["why"] = str(error)
            continue
        seconds, floquet = time.perf_counter() - begun, cycle.floquet
        found[name] = cycle
        rows[-1] |= cycle.row() | {"seconds": seconds, "multiplier": None if floquet is None else complex(floquet.values[0]),
                                   "trivial_error": None if floquet is None else floquet.error}
    if full := found.get("full"):
        for row in rows:
            if "omega" in row and row["model"] != "full":
                row |= {"omega_error": abs(row["omega"] / full.omega - 1), "rms_error": abs(row["rms"] / full.rms - 1)}
    return rows


def family_branches(models: Mapping[str, Substructure], contacts: Sequence[Contact], parameter: str, between: tuple[float, float],
                    families: Sequence[float], *, near: float = 0.05, guided: int = 3, progress: Report = None,
                    **options: Any) -> list[dict[str, Any]]:
    """For each model and mode, the branch over a parameter of a belt with its run time, or 'why' there is none.

    `options` are options of `branch`. For a large model, `guided` cycles along the branch of the model before are computed, see
    `along`.
    """
    report, found = listener("progress", progress), list[dict[str, Any]]()
    belt = next(one for one in contacts if isinstance(one, Belt))
    for name, model in in_turn(models).items():
        for family in families:
            report(f"branch of {label(name)} from ω = {family:.4g}")
            begun, missed = time.perf_counter(), list[dict[str, Any]]()
            guides = [item["branch"] for item in found if "branch" in item and item["family"] == family]
            found.append({"model": name, "family": family})
            try:
                if small(model):
                    traced = branch(model, contacts, parameter, between, start=family, **options)
                elif guides:
                    traced, missed = along(guides[-1], model, belt, guided, progress)
                else:
                    raise NotConvergedError("no reduced model has this branch")
            except (NotConvergedError, NoCycleError) as error:
                found[-1]["why"] = str(error)
                continue
            omega = traced.hopf.omega if traced.hopf else traced.omega[0]
            if abs(omega / family - 1) > near:
                found[-1]["why"] = f"its nearest mode begins at ω = {omega:.5g}"
            else:
                found[-1] |= {"branch": traced, "missed": missed, "seconds": time.perf_counter() - begun}
    return found


def along(guide: Branch, model: Substructure, belt: Belt, count: int = 3, progress: Report = None) -> tuple[
        Branch, list[dict[str, Any]]]:
    """Cycles of a large model at a few points of another model's branch, and the values at which no cycle was found.

    Each search starts from the cycle of the other model. The points are spread evenly over the parameter, without the beginning
    of the branch, where the amplitude is 0.
    """
    report, parameter = listener("progress", progress), guide.parameter
    values, points = list[float](), list[LimitCycle]()
    missed: list[dict[str, Any]] = []
    even = np.linspace(guide.values[0], guide.values[-1], max(3, count) + 1)[1:]
    wanted = np.unique([np.abs(guide.values - value).argmin() for value in even])
    for at in wanted:
        value, cycle = float(guide.values[at]), guide.points[at]
        report(f"full model, {parameter} = {value:.5g}")
        begin = LimitCycle(points[-1].contact, cycle.orbit, points[-1].flexibility, 0.0, 0.0, 0.0) if points else cycle
        try:
            points.append(harmonic_balance(model, with_parameter(belt, parameter, value), start=begin, tol=1e-3))
            values.append(value)
        except NotConvergedError as error:
            missed.append({parameter: value, "why": str(error)})
    if not points:
        raise NotConvergedError(f"none of {len(wanted)} cycles; the first: {missed[0]['why']}")
    return Branch(parameter, np.array(values), tuple(points), (), None,
                  f"{len(points)} of {len(wanted)} cycles, from those of a reduced model"), missed


def settled(model: Substructure, belt: Belt, end: float, cycle: LimitCycle | None = None) -> tuple[float, float]:
    """rms and strongest frequency of the motion after an impulse on a belt's port, or from a cycle with 5 % larger velocities.

    The impulse gives the contact the belt's speed, which is beyond the threshold of a hard onset. The motion is evaluated in the
    last quarter of the time up to `end`, from a cycle in the second half.
    """
    if cycle is None:
        contact = sliding(model, belt)
        blow, part = contact.impulse(1.0), 0.75
        start = State(blow.displacement, blow.velocity * abs(float(belt.speed or 0.0) / float(contact.W[:, 0] @ blow.velocity)))
    else:
        state, part = cycle.state(), 0.5
        start = State(state.displacement, 1.05 * state.velocity)
    run = transient(model, belt, (0.0, end), start=start, record_from=part * end, samples=8192, tol=1e-6).whole()
    v: Array = run.velocity(belt.port)
    v = v[:, 0] if v.ndim > 1 else v
    if cycle is None:
        omega = float(next(iter(spectrum(run.t, v).peaks), np.nan))
    else:  # too few periods for a spectrum
        omega = 2 * np.pi / period_near(run.t, v, 2 * np.pi / of_signal(run.t, v, 1).omega)
    return float(np.std(v)), omega


def settled_over(model: Substructure, belt: Belt, parameter: str, between: tuple[float, float], count: int, end: float,
                 branches: Sequence[Branch] | None = None, progress: Report = None) -> list[dict[str, Any]]:
    """`settled` at `count` values within a range of a parameter, from an impulse, or from stable cycles of branches there."""
    report, found = listener("progress", progress), list[dict[str, Any]]()
    for value in np.linspace(*between, count + 2)[1:-1].tolist():
        report(f"transient, {parameter} = {value:.5g}")
        near = [cycle for one in branches or () for cycle in one.at(value) if cycle.is_stable]
        if near or branches is None:
            rms, omega = settled(model, with_parameter(belt, parameter, value), end, near[0] if near else None)
            found.append({"value": value, "rms": rms, "omega": omega})
    return found
