"""Branches of limit cycles over a parameter, and the dots of transients."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.asks.cycles import CyclesAsk, small
from femsub.app.asks.motion import whole
from femsub.app.keys import key
from femsub.app.result import Result, Table, column, label
from femsub.checks import InputError, NoCycleError, NotConvergedError, unknown_name

if TYPE_CHECKING:
    from femsub import Belt, Branch, Substructure
    from femsub.app.grammar import Scene
    from femsub.app.models import Models
    from femsub.checks import Array


@dataclass(frozen=True)
class BranchAsk(CyclesAsk):
    """Families of limit cycles over a parameter of the belt: Hopf points, stability, folds and other special points."""

    branch: str = key("slope", "what varies along the branches", choices=lambda _: fs.motion.PARAMETERS, required=True,
                      example="slope")
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

    KIND: ClassVar[str] = "branch"
    WITHOUT: ClassVar[dict[str, str]] = {"cycles": "it is families of a branch"}

    def check(self, scene: Scene) -> None:
        super().check(scene)
        if len([one for one in scene.contacts.values() if type(one).KIND == "belt"]) != 1:
            raise InputError("branch follows cycles over a parameter of one belt, but the scene has several")
        if self.branch not in fs.motion.PARAMETERS:
            raise unknown_name("parameter of a belt", self.branch, fs.motion.PARAMETERS)

    def run(self, models: Models) -> Result:
        families, first = self.onsets(models)
        belt = next(one for one in models.contacts if isinstance(one, fs.Belt))
        # the range: as given, or from the first Hopf point, where F μ' = first, to the scene's own value and a quarter beyond
        now = float(getattr(belt, self.branch))
        if self.between:
            ends = self.between[0], self.between[1]
        elif self.branch == "speed":
            ends = 0.5 * now, 3 * now
        else:
            assert belt.slope is not None
            begins = first / belt.force if self.branch == "slope" else first / belt.slope
            last = now + 0.25 * (now - begins)
            ends = begins - 0.02 * (last - begins), last
        ends = min(ends), max(ends)
        if self.branch == "force":
            ends = max(ends[0], 0.0), ends[1]
        ordered = self.ordered(models)
        order = ["full", *dict.fromkeys(one.kind for one in models.reduced)]
        if not small(models.full):
            order = [*order[1:], "full"]
        found: list[dict[str, Any]] = []
        for one in ordered:
            for family in families:
                models.say(f"branch of {label(one.kind)} from ω = {family:.4g}")
                begun = time.perf_counter()
                found.append({"model": one.kind, "family": family})
                try:
                    traced, missed = (fs.branch(one.model, models.contacts, self.branch, ends, start=family, points=self.points,
                                                harmonics=self.harmonics), []) if small(one.model) else \
                        self.guided(models, one.model, belt, [
                            item["branch"] for item in found if "branch" in item and item["family"] == family])
                except (NotConvergedError, NoCycleError) as error:
                    found[-1]["why"] = str(error)
                    continue
                omega = traced.hopf.omega if traced.hopf else traced.omega[0]
                if abs(omega / family - 1) > self.near:
                    found[-1]["why"] = f"its nearest mode begins at ω = {omega:.5g}"
                else:
                    found[-1] |= {"branch": traced, "missed": missed, "seconds": time.perf_counter() - begun}
        found.sort(key=lambda item: order.index(item["model"]))
        whole = [item for item in found if "branch" in item]
        dots = [dot for one in sorted(ordered, key=lambda one: order.index(one.kind)) if small(one.model) for dot in self.dotted(
            models, one.kind, one.model, belt, ends, families[0], [item["branch"] for item in whole
                                                                   if item["model"] == one.kind])]
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
            special += [f"  {label(item['model'])}, ω {item['family']:.4g}: {point.kind} at {self.branch} = "
                        f"{point.value:.6g} (ω = {point.omega:.5g}, rms = {point.rms:.4g})" for point in traced.special]
        rows = [{"model": item["model"], "family": item["family"], **row} for item in whole for row in item["branch"].rows()]
        columns = ("model", "family", column("begins", "Hopf point at", ".6g"), column("error", form=".0e"),
                   column("critical", form="s"), column("cycles", form="d"), column("stable", form="d", role=""),
                   column("seconds", form=".1f"))
        return Result({"branch": records, "branch-transients": dots}, [
            f"Branches over the {self.branch}",
            Table("", lines, columns, keys=2, none="no branch was found, or it does not begin at a Hopf point"),
            *(f"ended: {why}: {', '.join(names)}" for why, names in ended.items()),
            *(f"{label(item['model'])} near ω = {item['family']:.4g}: no cycle at {self.branch} = "
              f"{gap[self.branch]:.5g}: {gap['why']}" for item in whole for gap in item["missed"]),
            *["Special points"] * bool(special), *special,
            Table("branch", rows, title="Branches, point by point"), Table("branch-transients", dots, title="Transients"),
            fs.motion.bifurcation_chart(whole, dots, self.branch, families, now, models.scene.name)])

    def guided(self, models: Models, model: Substructure, belt: Belt, guides: Sequence[Branch]) -> tuple[Branch,
                                                                                                         list[dict[str, Any]]]:
        """A model whose modes are not at hand: its cycles at a few points of the last of reduced models' branches.

        Each starts from the cycle there. They are spread evenly from the branch's beginning, where there is no amplitude yet, to
        its end. With them are those that were not found.
        """
        if not guides:
            raise NotConvergedError("no reduced model has this branch")
        guide, parameter = guides[-1], self.branch
        values, points = list[float](), list[fs.LimitCycle]()
        missed: list[dict[str, Any]] = []
        even = np.linspace(guide.values[0], guide.values[-1], max(3, self.dots) + 1)[1:]
        wanted = np.unique([np.abs(guide.values - value).argmin() for value in even])
        for at in wanted:
            value, cycle = float(guide.values[at]), guide.points[at]
            models.say(f"full model, {parameter} = {value:.5g}")
            begin = fs.LimitCycle(points[-1].contact, cycle.orbit, points[-1].flexibility, 0.0, 0.0, 0.0) if points else cycle
            try:
                points.append(fs.harmonic_balance(model, fs.motion.with_parameter(belt, parameter, value), start=begin, tol=1e-3))
                values.append(value)
            except NotConvergedError as error:
                missed.append({parameter: value, "why": str(error)})
        if not points:
            raise NotConvergedError(f"none of {len(wanted)} cycles; the first: {missed[0]['why']}")
        return fs.Branch(parameter, np.array(values), tuple(points), (), None,
                         f"{len(points)} of {len(wanted)} cycles, from those of a reduced model"), missed

    def dotted(self, models: Models, name: str, model: Substructure, belt: Belt, limits: tuple[float, float], slowest: float,
               traced: Sequence[Branch]) -> list[dict[str, Any]]:
        """rms and the strongest frequency of what a blow, or a disturbed cycle, leads to, at a few values of the parameter.

        `slowest` is the frequency whose periods are counted, `traced` are the model's branches.
        """
        found: list[dict[str, Any]] = []
        part = 0.75 if self.dots_from == "blow" else 0.5
        end = self.periods * 2 * np.pi / slowest
        for value in np.linspace(limits[0], limits[1], self.dots + 2)[1:-1].tolist():
            models.say(f"transient of {label(name)}, {self.branch} = {value:.5g}")
            acting = fs.motion.with_parameter(belt, self.branch, value)
            if self.dots_from == "cycle":
                near = [cycle for one in traced for cycle in one.at(value) if cycle.is_stable]
                if not near:
                    continue
                state = near[0].state()
                start = fs.State(state.displacement, 1.05 * state.velocity)
            else:
                # so hard a blow that the contact moves at the belt's speed, which is beyond the threshold of a hard onset
                contact = fs.motion.sliding(model, acting)
                blow = contact.impulse(1.0)
                start = fs.State(blow.displacement, blow.velocity * abs(
                    float(belt.speed or 0.0) / float(contact.W[:, 0] @ blow.velocity)))
            done = whole(fs.transient(model, acting, (0.0, end), start=start, record_from=part * end, samples=8192, tol=1e-6))
            v: Array = done.velocity(belt.port)
            v = v[:, 0] if v.ndim > 1 else v
            if self.dots_from == "cycle":
                omega = 2 * np.pi / repeats(done.t, v, 2 * np.pi / fs.motion.of_signal(done.t, v, 1).omega)
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
