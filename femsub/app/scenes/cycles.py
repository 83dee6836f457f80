"""Limit cycles of the chain and of a plate, full and reduced: a table, branches, stability, and the dots of transients."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

import femsub as fs
from femsub import harmonic_balance, transient
from femsub.algebra import QUADRATIC
from femsub.app.keys import key
from femsub.app.scene import NO_SLOPE, Progress, Result, Run, Scene
from femsub.app.scenes.chain import ChainScene
from femsub.app.scenes.component import ComponentRun
from femsub.app.scenes.in_time import whole
from femsub.app.scenes.plate import PlateScene
from femsub.checks import Array
from femsub.errors import InputError, NoCycleError, NotConvergedError
from femsub.motion import PARAMETERS, of_signal, onsets, sliding, with_parameter
from femsub.studies import Table, bifurcation_chart, column, cycles_verdict, label, span


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


def small(model: fs.Substructure) -> bool:
    """Whether all modes of a model, and the stability of its cycles, are at hand."""
    return not model.pencil.is_sparse or model.size <= QUADRATIC


@dataclass(eq=False)
class CycleRun(Run):
    """Cycles and branches of models by their names, those from modes in a band; the full model is first if it is small."""

    scene: CycleKeys
    models: Mapping[str, fs.Substructure]
    limits: tuple[float, float]

    def __post_init__(self) -> None:
        self.order = list(self.models)
        #: large models start from the others' cycles
        self.ordered = sorted(self.models.items(), key=lambda pair: not small(pair[1]))

    def study(self, head: str, data: dict[str, Any]) -> Result:
        """What the scene asks for, below a line; `data` says what the models are."""
        return self.result({**self.scene.friction, "band": self.limits, "parameter": self.scene.parameter, **data}, [head])

    @cached_property
    def onsets(self) -> tuple[list[float], float]:
        """Frequencies of the modes to follow, and F μ' at the first one's Hopf point: those of the first small model."""
        if not any(small(model) for model in self.models.values()):
            raise InputError("no model is small enough for its modes to be listed; name reduction methods")
        model = next(model for model in self.models.values() if small(model))
        omega, c = onsets(sliding(model, self.scene.rubbing), self.limits)
        if not len(omega):
            raise NoCycleError(f"steady sliding is stable in the band {self.limits[0]:g} to {self.limits[1]:g}: no cycle begins; "
                               "raise the force, or change the speed")
        return [float(value) for value in np.sort(omega[:self.scene.families])], float(c[0])

    def cycles(self) -> Result:
        scene, rows = self.scene, list[dict[str, Any]]()
        for family in self.onsets[0]:
            found: dict[str, fs.LimitCycle] = {}
            here: list[dict[str, Any]] = []
            for name, model in self.ordered:
                self.say(f"limit cycle of {label(name)} near ω = {family:.4g}")
                begun = time.perf_counter()
                here.append({"family": family, "model": name, "size": model.size})
                try:
                    start: Any = family if small(model) else next(reversed(found.values()), None)
                    if start is None:
                        raise NotConvergedError("no reduced model gave a cycle to start from")
                    cycle = harmonic_balance(model, scene.rubbing, start=start)
                    if abs(cycle.omega / family - 1) > scene.near:
                        raise NotConvergedError(f"only another cycle was found, at ω = {cycle.omega:.5g}")
                except (NotConvergedError, NoCycleError) as error:
                    here[-1]["why"] = str(error)
                    continue
                seconds, floquet = time.perf_counter() - begun, cycle.floquet
                found[name] = cycle
                here[-1] |= cycle.row() | {"seconds": seconds,
                                           "multiplier": None if floquet is None else complex(floquet.values[0]),
                                           "trivial_error": None if floquet is None else floquet.error}
            full = found.get("full")
            for row in here:
                if full is not None and "omega" in row and row["model"] != "full":
                    row |= {"omega_error": abs(row["omega"] / full.omega - 1), "rms_error": abs(row["rms"] / full.rms - 1)}
            rows += sorted(here, key=lambda row: self.order.index(row["model"]))
        kept = [row for row in rows if "omega" in row]
        columns = ("model", "size", column("family", unit=""), "omega", column("omega_error", "error of ω", ".1e"), "rms",
                   column("rms_error", "error of rms", ".1e"), "peak", column("sticking", form=".0%"), "is_stable", "multiplier",
                   "harmonics", "truncation", column("seconds", form=".2f"))
        at = f"at v0 = {scene.speed:g}, F = {scene.force:g}"
        branched = ["Branches are drawn and listed, not judged: the verdict is that of the cycles at one parameter."]
        return Result({"cycles": rows}, [
            f"Limit cycles {at}; v is the speed under the belt", Table("", kept, columns, keys=3),
            Table("cycles", rows, title="Limit cycles"),
            *["?, and no multiplier: of large models the stability of cycles is not computed"] * any(
                row["is_stable"] is None for row in kept),
            *(f"{label(row['model'])} near ω = {row['family']:.4g}: {row['why']}" for row in rows if "why" in row),
            cycles_verdict(rows, at, branched if "branches" in scene.outputs else ())])

    def branches(self) -> Result:
        scene, (families, first) = self.scene, self.onsets
        # the range: as given, or from the first Hopf point, where F μ' = first, to the scene's own value and a quarter beyond
        belt, now = scene.rubbing, float(getattr(scene.rubbing, scene.parameter))
        if scene.between:
            ends = scene.between[0], scene.between[1]
        elif scene.parameter == "speed":
            ends = 0.5 * now, 3 * now
        else:
            assert belt.slope is not None
            begins = first / belt.force if scene.parameter == "slope" else first / belt.slope
            last = now + 0.25 * (now - begins)
            ends = begins - 0.02 * (last - begins), last
        ends = min(ends), max(ends)
        found: list[dict[str, Any]] = []
        for name, model in self.ordered:
            for family in families:
                self.say(f"branch of {label(name)} from ω = {family:.4g}")
                begun = time.perf_counter()
                found.append({"model": name, "family": family})
                try:
                    traced, missed = (fs.branch(model, belt, scene.parameter, ends, start=family, points=scene.points,
                                             harmonics=scene.harmonics), []) if small(model) else \
                        self.guided(model, [item["branch"] for item in found if "branch" in item and item["family"] == family])
                except (NotConvergedError, NoCycleError) as error:
                    found[-1]["why"] = str(error)
                    continue
                omega = traced.hopf.omega if traced.hopf else traced.omega[0]
                if abs(omega / family - 1) > scene.near:
                    found[-1]["why"] = f"its nearest mode begins at ω = {omega:.5g}"
                else:
                    found[-1] |= {"branch": traced, "missed": missed, "seconds": time.perf_counter() - begun}
        found.sort(key=lambda item: self.order.index(item["model"]))
        whole = [item for item in found if "branch" in item]
        dots = [dot for name, model in self.models.items() if small(model) for dot in self.dots(
            name, model, ends, families[0], [item["branch"] for item in whole if item["model"] == name])]
        lines, records, special = list[dict[str, Any]](), list[dict[str, Any]](), list[str]()
        ended: dict[str, list[str]] = {}
        for item in found:
            ended.setdefault(item["why"] if "why" in item else item["branch"].ended, []).append(
                f"{label(item['model'])} from ω = {item['family']:.4g}")
            lines.append({"model": item["model"], "family": item["family"]})
            records.append({key: value for key, value in item.items() if key != "branch"})
            if "why" in item:
                continue
            traced, hopf = item["branch"], item["branch"].hopf
            lines[-1] |= {"cycles": len(traced.points), "stable": sum(flag is True for flag in traced.stable),
                          "seconds": item["seconds"]}
            if hopf:
                lines[-1] |= {"begins": hopf.value, "error": hopf.error, "critical": "super" if hopf.supercritical else "sub"}
            records[-1] |= {"hopf": hopf and {key: getattr(hopf, key) for key in (
                "value", "omega", "limit", "error", "supercritical")}, "special": [vars(point) for point in traced.special],
                            "ended": traced.ended, "points": traced.rows()}
            special += [f"  {label(item['model'])}, ω {item['family']:.4g}: {point.kind} at {scene.parameter} = "
                        f"{point.value:.6g} (ω = {point.omega:.5g}, rms = {point.rms:.4g})" for point in traced.special]
        rows = [{"model": item["model"], "family": item["family"], **row} for item in whole for row in item["branch"].rows()]
        columns = ("model", "family", column("begins", "Hopf point at", ".6g"), column("error", form=".0e"),
                   column("critical", form="s"), column("cycles", form="d"), column("stable", form="d", role=""),
                   column("seconds", form=".1f"))
        return Result({"branches": records, "transients": dots}, [
            f"Branches over the {scene.parameter}",
            Table("", lines, columns, keys=2, none="no branch was found, or it does not begin at a Hopf point"),
            *(f"ended: {why}: {', '.join(names)}" for why, names in ended.items()),
            *(f"{label(item['model'])} near ω = {item['family']:.4g}: no cycle at {scene.parameter} = "
              f"{gap[scene.parameter]:.5g}: {gap['why']}" for item in whole for gap in item["missed"]),
            *["Special points"] * bool(special), *special,
            Table("branches", rows, title="Branches, point by point"), Table("transients", dots, title="Transients"),
            bifurcation_chart(whole, dots, scene.parameter, families, now, scene.name)])

    def guided(self, model: fs.Substructure, guides: Sequence[fs.Branch]) -> tuple[fs.Branch, list[dict[str, Any]]]:
        """A model whose modes are not at hand: its cycles at a few points of the last of reduced models' branches.

        Each starts from the cycle there. They are spread evenly from the branch's beginning, where there is no amplitude yet, to
        its end. With them are those that were not found.
        """
        if not guides:
            raise NotConvergedError("no reduced model has this branch")
        guide, parameter = guides[-1], self.scene.parameter
        values, points = list[float](), list[fs.LimitCycle]()
        missed: list[dict[str, Any]] = []
        even = np.linspace(guide.values[0], guide.values[-1], max(3, self.scene.dots) + 1)[1:]
        wanted = np.unique([np.abs(guide.values - value).argmin() for value in even])
        for at in wanted:
            value, cycle = float(guide.values[at]), guide.points[at]
            self.say(f"full model, {parameter} = {value:.5g}")
            belt = with_parameter(self.scene.rubbing, parameter, value)
            begin = fs.LimitCycle(points[-1].contact, cycle.orbit, points[-1].flexibility, 0.0, 0.0, 0.0) if points else cycle
            try:
                points.append(harmonic_balance(model, belt, start=begin, tol=1e-3))
                values.append(value)
            except NotConvergedError as error:
                missed.append({parameter: value, "why": str(error)})
        if not points:
            raise NotConvergedError(f"none of {len(wanted)} cycles; the first: {missed[0]['why']}")
        return fs.Branch(parameter, np.array(values), tuple(points), (), None,
                      f"{len(points)} of {len(wanted)} cycles, from those of a reduced model"), missed

    def dots(self, name: str, model: fs.Substructure, limits: tuple[float, float], slowest: float, traced: Sequence[fs.Branch]
             ) -> list[dict[str, Any]]:
        """rms and the strongest frequency of what a blow, or a disturbed cycle, leads to, at a few values of the parameter.

        `slowest` is the frequency whose periods are counted, `traced` are the model's branches.
        """
        scene, found = self.scene, list[dict[str, Any]]()
        part = 0.75 if scene.dots_from == "blow" else 0.5
        end = scene.periods * 2 * np.pi / slowest
        for value in np.linspace(limits[0], limits[1], scene.dots + 2)[1:-1].tolist():
            self.say(f"transient of {label(name)}, {scene.parameter} = {value:.5g}")
            belt = with_parameter(scene.rubbing, scene.parameter, value)
            if scene.dots_from == "cycle":
                near = [cycle for one in traced for cycle in one.at(value) if cycle.is_stable]
                if not near:
                    continue
                state = near[0].state()
                start = fs.State(state.displacement, 1.05 * state.velocity)
            else:
                # so hard a blow that the contact moves at the belt's speed, which is beyond the threshold of a hard onset
                contact = sliding(model, belt)
                blow = contact.impulse(1.0)
                start = fs.State(blow.displacement, blow.velocity * abs(scene.speed / float(contact.W[:, 0] @ blow.velocity)))
            done = whole(transient(model, belt, (0.0, end), start=start, record_from=part * end, samples=8192, tol=1e-6))
            v: Array = done.velocity(belt.port)
            v = v[:, 0] if v.ndim > 1 else v
            if scene.dots_from == "cycle":
                omega = 2 * np.pi / repeats(done.t, v, 2 * np.pi / of_signal(done.t, v, 1).omega)
            else:
                omega = float(next(iter(fs.spectrum(done.t, v).peaks), np.nan))
            found.append({"model": name, "value": value, "rms": float(np.std(v)), "omega": omega})
        return found


def repeats(t: Array, v: Array, guess: float) -> float:
    """The T near a guess (within 3 %) at which v(t + T) is nearest to v(t): few periods are enough for it."""
    trial = guess * np.linspace(0.97, 1.03, 1201)
    early = t[t <= t[-1] - trial[-1]]
    first = np.interp(early, t, v)
    gap = np.array([np.square(np.interp(early + period, t, v) - first).mean() for period in trial])
    return float(trial[np.argmin(gap)])


@dataclass(frozen=True)
class ChainCycleScene(CycleKeys, ChainScene):
    """Limit cycles of the paper's chain and of its reduced models."""

    band: list[float] = key([], "holds the frequencies of the modes whose cycles are sought", unit="rad/time", least=0,
                            form="[lo, hi]", otherwise="the four lowest modes of the paper's chain")

    OUTPUTS: ClassVar[tuple[str, ...]] = ("cycles", "branches")

    def __post_init__(self) -> None:
        if not self.band:
            lowest = fs.chain_frequencies(max(self.n, 1), min(max(self.n, 1), 4))
            self.put(band=[0.0, float(1.02 * lowest[-1])])
        super().__post_init__()

    def run(self, progress: Progress) -> Result:
        full = self.model(self.belt, False)
        models = {"full": full, **{method: self.reduced(full, method, self.size) for method in self.methods}}
        head = f"{self.words}, belt under m{self.belt}, {self.friction_words}; {self.labels} of {self.size} DOF"
        data = {"n": self.n, "damping": self.damping, "belt": self.belt, "interface": self.interface, "size": self.size}
        return CycleRun(self, progress, models, (self.band[0], self.band[1])).study(head, data)


@dataclass(frozen=True)
class PlateCycleScene(CycleKeys, PlateScene):
    """Limit cycles of a plate under a belt, over the normal force. Of several `modes` the largest serves.

    The full model's cycles are solved for the harmonics of the contact alone, each from that of a reduced model, at a few values
    of the force; their stability is not computed.
    """

    parameter: str = "force"
    families: int = 1
    modes: list[int] = field(default_factory=lambda: [20])
    force: float = 60.0
    points: int = 60
    dots: int = 2
    periods: int = 8
    dots_from: str = "cycle"

    OUTPUTS: ClassVar[tuple[str, ...]] = ("cycles", "branches")

    def run(self, progress: Progress) -> Result:
        work, most = ComponentRun(self, progress), max(self.modes)
        models = {**{method.key: rom for method, rom in work.reduced if method.modes == most}, "full": work.sub}
        band, rule = work.band
        head = (f"{self.name}: {work.sub!r}\n{self.friction_words}; "
                f"{self.labels} with {most} modes; band {span(band)} ({rule})")
        data = {"model": repr(work.sub), "size": work.sub.size, "modes_kept": most, "band_rule": rule}
        return CycleRun(self, progress, models, band).study(head, data)
