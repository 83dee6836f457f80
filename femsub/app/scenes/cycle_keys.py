"""What the scenes of limit cycles share: their keys, the table of cycles, the branches and the dots of transients."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from femsub import Branch, LimitCycle, State, Substructure, branch, harmonic_balance, spectrum, transient
from femsub.algebra import QUADRATIC
from femsub.app.keys import key
from femsub.app.scene import NO_SLOPE, Progress, Result, Scene, run_outputs
from femsub.app.scenes.in_time import whole
from femsub.checks import Array
from femsub.errors import InputError, NoCycleError, NotConvergedError
from femsub.motion import PARAMETERS, of_signal, onsets, sliding, with_parameter
from femsub.studies import Table, bifurcation_chart, column, cycles_verdict, label


@dataclass(frozen=True)
class CycleKeys(Scene):
    """What the scenes of limit cycles have in common."""

    parameter: str = key("slope", "what varies along the branches", choices=lambda _: PARAMETERS)
    between: list[float] = key([], "the parameter's range", form="[lo, hi]", otherwise="from the Hopf point of the first mode to "
                               "the scene's own value and a quarter beyond", example=[-0.06, -0.01])
    families: int = key(4, "modes, in the order in which they become unstable, whose cycles are followed", least=1)
    points: int = key(100, "cycles on a branch at most", least=1)
    harmonics: int = key(250, "harmonics on a branch at most", least=1)
    dots: int = key(4, "values of the parameter at which each reduced (or small) model is also integrated in time; of a large "
                    "model as many cycles are sought, three at least", least=0)
    periods: int = key(80, "periods of the slowest family over which it is integrated; amplitude and frequency are those of the "
                       "last quarter, from a 'cycle' those of the second half", least=1)
    dots_from: str = key("blow", "'blow': from the sliding equilibrium with a blow that moves the contact at the belt's speed; "
                         "'cycle': from a stable cycle of its branches next to that value, with velocities raised by 5 %, and no "
                         "dot where there is none (for models whose integration is slow)", choices=lambda _: ("blow", "cycle"))

    near: float = key(0.05, "relative difference of frequencies up to which cycles of two models belong to one mode", above=0)

    WITHOUT: ClassVar[Mapping[str, str]] = NO_SLOPE


def run_cycles(scene: CycleKeys, models: Mapping[str, Substructure], band: tuple[float, float], data: dict[str, Any],
               head: str, progress: Progress) -> Result:
    """The outputs 'cycles' and 'branches' of a set of models, the reference among them first if it is small."""
    say = lambda text: progress(f"{scene.name}: {text}")  # noqa: E731 - a word for each step
    parts = {"cycles": _cycles, "branches": _branches}
    common = {**scene.friction, "band": band, "parameter": scene.parameter}
    return run_outputs(scene.outputs, lambda output: parts[output](scene, models, band, say), common | data, [head])


def _small(model: Substructure) -> bool:
    return not model.pencil.is_sparse or model.size <= QUADRATIC


def _families(scene: CycleKeys, models: Mapping[str, Substructure], band: tuple[float, float]) -> tuple[list[float], float]:
    """Frequencies of the modes to follow, and F μ' at the first one's Hopf point: those of the first small model."""
    small = next((model for model in models.values() if _small(model)), None)
    if small is None:
        raise InputError("no model is small enough for its modes to be listed; name reduction methods")
    omega, c = onsets(sliding(small, scene.rubbing), band)
    if not len(omega):
        raise NoCycleError(f"steady sliding is stable in the band {band[0]:g} to {band[1]:g}: no cycle begins; raise the force, "
                           "or change the speed")
    return [float(value) for value in np.sort(omega[:scene.families])], float(c[0])


def _cycles(scene: CycleKeys, models: Mapping[str, Substructure], band: tuple[float, float], say: Progress) -> Result:
    rows: list[dict[str, Any]] = []
    for family in _families(scene, models, band)[0]:
        found: dict[str, LimitCycle] = {}
        here: list[dict[str, Any]] = []
        for name, model in sorted(models.items(), key=lambda pair: not _small(pair[1])):
            say(f"limit cycle of {label(name)} near ω = {family:.4g}")
            begun = time.perf_counter()
            row: dict[str, Any] = {"family": family, "model": name, "size": model.size}
            try:
                start: Any = family if _small(model) else next(reversed(found.values()), None)
                if start is None:
                    raise NotConvergedError("no reduced model gave a cycle to start from")
                cycle = harmonic_balance(model, scene.rubbing, start=start)
                if abs(cycle.omega / family - 1) > scene.near:
                    raise NotConvergedError(f"only another cycle was found, at ω = {cycle.omega:.5g}")
            except (NotConvergedError, NoCycleError) as error:
                here.append(row | {"why": str(error)})
                continue
            seconds = time.perf_counter() - begun
            found[name] = cycle
            floquet = cycle.floquet
            here.append(row | cycle.row() | {"seconds": seconds,
                                             "multiplier": None if floquet is None else complex(floquet.values[0]),
                                             "trivial_error": None if floquet is None else floquet.error})
        full = found.get("full")
        for row in here:
            if full is not None and "omega" in row and row["model"] != "full":
                row |= {"omega_error": abs(row["omega"] / full.omega - 1), "rms_error": abs(row["rms"] / full.rms - 1)}
        here.sort(key=lambda row: list(models).index(row["model"]))
        rows += here
    kept = [row for row in rows if "omega" in row]
    columns = ("model", "size", column("family", unit=""), "omega", column("omega_error", "error of ω", ".1e"), "rms",
               column("rms_error", "error of rms", ".1e"), "peak", column("sticking", form=".0%"), "is_stable", "multiplier",
               "harmonics", "truncation", column("seconds", form=".2f"))
    shown: list[Any] = [f"Limit cycles at v0 = {scene.speed:g}, F = {scene.force:g}; v is the speed under the belt",
                        Table("", kept, columns, keys=3), Table("cycles", rows, title="Limit cycles")]
    if any(row["is_stable"] is None for row in kept):
        shown.append("?, and no multiplier: of large models the stability of cycles is not computed")
    shown += [f"{label(row['model'])} near ω = {row['family']:.4g}: {row['why']}" for row in rows if "why" in row]
    branched = ["Branches are drawn and listed, not judged: the verdict is that of the cycles at one parameter."]
    shown.append(cycles_verdict(rows, f"at v0 = {scene.speed:g}, F = {scene.force:g}",
                                branched if "branches" in scene.outputs else ()))
    return Result({"cycles": rows}, shown)


def _branches(scene: CycleKeys, models: Mapping[str, Substructure], band: tuple[float, float], say: Progress) -> Result:
    families, first = _families(scene, models, band)
    # the range: as given, or from the first Hopf point, where F μ' = first, to the scene's own value and a quarter beyond
    belt, now = scene.rubbing, float(getattr(scene.rubbing, scene.parameter))
    if scene.between:
        limits = scene.between[0], scene.between[1]
    elif scene.parameter == "speed":
        limits = min(0.5 * now, 3 * now), max(0.5 * now, 3 * now)
    else:
        assert belt.slope is not None
        begins = first / belt.force if scene.parameter == "slope" else first / belt.slope
        ends = now + 0.25 * (now - begins)
        edge = begins - 0.02 * (ends - begins)
        limits = min(edge, ends), max(edge, ends)
    # the branches; large models start from the others' cycles
    found: list[dict[str, Any]] = []
    for name, model in sorted(models.items(), key=lambda pair: not _small(pair[1])):
        for family in families:
            say(f"branch of {label(name)} from ω = {family:.4g}")
            begun = time.perf_counter()
            try:
                traced, missed = _large(scene, found, family, model, say) if not _small(model) else \
                    (branch(model, scene.rubbing, scene.parameter, limits, start=family, points=scene.points,
                            harmonics=scene.harmonics), [])
            except (NotConvergedError, NoCycleError) as error:
                found.append({"model": name, "family": family, "why": str(error)})
                continue
            omega = traced.hopf.omega if traced.hopf else traced.omega[0]
            if abs(omega / family - 1) > scene.near:
                found.append({"model": name, "family": family, "why": f"its nearest mode begins at ω = {omega:.5g}"})
                continue
            found.append({"model": name, "family": family, "branch": traced, "missed": missed,
                          "seconds": time.perf_counter() - begun})
    found.sort(key=lambda item: list(models).index(item["model"]))
    dots = [dot for name, model in models.items() if _small(model)
            for dot in _dots(scene, name, model, limits, families, say,
                             [item["branch"] for item in found if item["model"] == name and "branch" in item])]
    rows = [{"model": item["model"], "family": item["family"], **row} for item in found if "branch" in item
            for row in item["branch"].rows()]
    lines: list[dict[str, Any]] = []
    special = []
    ended: dict[str, list[str]] = {}
    for item in found:
        ended.setdefault(item["why"] if "why" in item else item["branch"].ended, []).append(
            f"{label(item['model'])} from ω = {item['family']:.4g}")
        lines.append({"model": item["model"], "family": item["family"]})
        if "why" in item:
            continue
        traced = item["branch"]
        lines[-1] |= {"cycles": len(traced.points), "stable": sum(flag is True for flag in traced.stable),
                      "seconds": item["seconds"]}
        if traced.hopf:
            lines[-1] |= {"begins": traced.hopf.value, "error": traced.hopf.error,
                          "critical": "super" if traced.hopf.supercritical else "sub"}
        special += [f"  {label(item['model'])}, ω {item['family']:.4g}: {point.kind} at {scene.parameter} = "
                    f"{point.value:.6g} (ω = {point.omega:.5g}, rms = {point.rms:.4g})" for point in traced.special]
    columns = ("model", "family", column("begins", "Hopf point at", ".6g"), column("error", form=".0e"),
               column("critical", form="s"), column("cycles", form="d"), column("stable", form="d", role=""),
               column("seconds", form=".1f"))
    records: list[dict[str, Any]] = []
    for item in found:
        records.append({key: value for key, value in item.items() if key != "branch"})
        if "branch" in item:
            traced, hopf = item["branch"], item["branch"].hopf
            records[-1] |= {"hopf": hopf and {"value": hopf.value, "omega": hopf.omega, "limit": hopf.limit, "error": hopf.error,
                                              "supercritical": hopf.supercritical},
                            "special": [vars(point) for point in traced.special], "ended": traced.ended, "points": traced.rows()}
    return Result({"branches": records, "transients": dots}, [
        f"Branches over the {scene.parameter}",
        Table("", lines, columns, keys=2, none="no branch was found, or it does not begin at a Hopf point"),
        *(f"ended: {why}: {', '.join(names)}" for why, names in ended.items()),
        *(f"{label(item['model'])} near ω = {item['family']:.4g}: no cycle at {scene.parameter} = {gap[scene.parameter]:.5g}: "
          f"{gap['why']}" for item in found for gap in item.get("missed", [])),
        *["Special points"] * bool(special), *special,
        Table("branches", rows, title="Branches, point by point"), Table("transients", dots, title="Transients"),
        bifurcation_chart([item for item in found if "branch" in item], dots, scene.parameter, families, now, scene.name)])


def _large(scene: CycleKeys, found: list[dict[str, Any]], family: float, model: Substructure,
           say: Progress) -> tuple[Branch, list[dict[str, Any]]]:
    """A model whose modes are not at hand: its cycles at a few points of a reduced one's branch, each from the cycle there, and
    where none was found. They are spread evenly from the branch's beginning, where there is no amplitude yet, to its end.
    """
    guides = [item["branch"] for item in found if "branch" in item and item["family"] == family]
    if not guides:
        raise NotConvergedError("no reduced model has this branch")
    guide = guides[-1]
    values, points = [], list[LimitCycle]()
    missed: list[dict[str, Any]] = []
    even = np.linspace(guide.values[0], guide.values[-1], max(3, scene.dots) + 1)[1:]
    wanted = np.unique([np.abs(guide.values - value).argmin() for value in even])
    for at in wanted:
        value, cycle = float(guide.values[at]), guide.points[at]
        say(f"full model, {scene.parameter} = {value:.5g}")
        belt = with_parameter(scene.rubbing, scene.parameter, value)
        begin = LimitCycle(points[-1].contact, cycle.orbit, points[-1].flexibility, 0.0, 0.0, 0.0) if points else cycle
        try:
            points.append(harmonic_balance(model, belt, start=begin, tol=1e-3))
        except NotConvergedError as error:
            missed.append({scene.parameter: value, "why": str(error)})
            continue
        values.append(value)
    if not points:
        raise NotConvergedError(f"none of {len(wanted)} cycles; the first: {missed[0]['why']}")
    return Branch(scene.parameter, np.array(values), tuple(points), (), None,
                  f"{len(points)} of {len(wanted)} cycles, from those of a reduced model"), missed


def _dots(scene: CycleKeys, name: str, model: Substructure, limits: tuple[float, float], families: list[float],
          say: Progress, traced: list[Branch]) -> list[dict[str, Any]]:
    """rms and the strongest frequency of what a blow, or a disturbed cycle, leads to, at a few values of the parameter."""
    dots: list[dict[str, Any]] = []
    part = 0.75 if scene.dots_from == "blow" else 0.5
    end = scene.periods * 2 * np.pi / families[0]
    for value in np.linspace(limits[0], limits[1], scene.dots + 2)[1:-1]:
        say(f"transient of {label(name)}, {scene.parameter} = {value:.5g}")
        belt = with_parameter(scene.rubbing, scene.parameter, float(value))
        if scene.dots_from == "cycle":
            near = [cycle for one in traced for cycle in one.at(float(value)) if cycle.is_stable]
            if not near:
                continue
            state = near[0].state()
            start = State(state.displacement, 1.05 * state.velocity)
        else:
            # so hard a blow that the contact moves at the belt's speed, which is beyond the threshold of a hard onset
            contact = sliding(model, belt)
            blow = contact.impulse(1.0)
            start = State(blow.displacement, blow.velocity * abs(scene.speed / float(contact.W[:, 0] @ blow.velocity)))
        done = whole(transient(model, belt, (0.0, end), start=start, record_from=part * end, samples=8192, tol=1e-6))
        v: Array = done.velocity(belt.port)
        v = v[:, 0] if v.ndim > 1 else v
        if scene.dots_from == "cycle":
            omega = 2 * np.pi / _repeats(done.t, v, 2 * np.pi / of_signal(done.t, v, 1).omega)
        else:
            omega = float(next(iter(spectrum(done.t, v).peaks), np.nan))
        dots.append({"model": name, "value": float(value), "rms": float(np.std(v)), "omega": omega})
    return dots


def _repeats(t: Array, v: Array, guess: float) -> float:
    """The T near a guess (within 3 %) at which v(t + T) is nearest to v(t): few periods are enough for it."""
    trial = guess * np.linspace(0.97, 1.03, 1201)
    early = t[t <= t[-1] - trial[-1]]
    first = np.interp(early, t, v)
    gap = np.array([np.square(np.interp(early + period, t, v) - first).mean() for period in trial])
    return float(trial[np.argmin(gap)])
