"""Branches of limit cycles over a parameter, and transients as dots beside them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.asks.cycles import CyclesAsk
from femsub.app.kinds import key
from femsub.app.result import Result, Table, column, label
from femsub.checks import InputError

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Models


@dataclass(frozen=True)
class BranchAsk(CyclesAsk):
    """Families of limit cycles over a parameter of the belt: Hopf points, stability, folds and other special points."""

    branch: str = key("slope", "the parameter along the branches", choices=lambda _: fs.motion.PARAMETERS, required=True,
                      example="slope")
    between: list[float] = key([], "the parameter's range", form="[lo, hi]", otherwise="from the Hopf point of the first mode to "
                               "the scene's own value and a quarter beyond", example=[-0.06, -0.01])
    families: int = key(4, "number of modes, in the order in which they become unstable, whose cycles are followed", least=1)
    points: int = key(100, "largest number of cycles on a branch", least=1)
    harmonics: int = key(250, "largest number of harmonics on a branch", least=1)
    dots: int = key(4, "values of the parameter at which each reduced (or small) model is also integrated in time; of a large "
                    "model as many cycles are computed instead, but at least three", least=0)
    periods: int = key(80, "length of the integration in periods of the slowest family; amplitude and frequency are taken from "
                       "its last quarter, with 'cycle' from its second half", least=1)
    dots_from: str = key("blow", "'blow': starts from the sliding equilibrium and a blow that moves the contact at the belt's "
                         "speed; 'cycle': starts from the nearest stable cycle of the model's branches, with velocities raised "
                         "by 5 %, and draws no dot without one (for slow integrations)", choices=lambda _: ("blow", "cycle"))

    KIND: ClassVar[str] = "branch"
    WITHOUT: ClassVar[dict[str, str]] = {"cycles": "for a branch this key is families"}

    def check(self, scene: Scene) -> None:
        super().check(scene)
        if len([one for one in scene.contacts.values() if type(one).KIND == "belt"]) != 1:
            raise InputError("branch follows cycles over a parameter of one belt, but the scene has several")

    def run(self, models: Models) -> Result:
        families, first = self.onsets(models)
        largest, belt = self.largest(models), next(one for one in models.contacts if isinstance(one, fs.Belt))
        lo, hi = self.between or fs.motion.range_around(belt, self.branch, first)
        ends = (max(lo, 0.0) if self.branch == "force" else lo, hi)
        found = fs.motion.family_branches(largest, models.contacts, self.branch, ends, families, near=self.near, guided=self.dots,
                                          points=self.points, harmonics=self.harmonics, progress=models.say)
        whole = [item for item in found if "branch" in item]
        dots: list[dict[str, Any]] = []
        for name, model in largest.items():
            if fs.motion.small(model):
                own = [item["branch"] for item in whole if item["model"] == name] if self.dots_from == "cycle" else None
                dots += [{"model": name, **dot} for dot in fs.motion.settled_over(
                    model, belt, self.branch, ends, self.dots, self.periods * 2 * np.pi / families[0], own, models.say)]
        lines, records, special = list[dict[str, Any]](), list[dict[str, Any]](), list[str]()
        ended: dict[str, list[str]] = {}
        for item in found:
            traced = item.get("branch")
            ended.setdefault(traced.ended if traced else item["why"], []).append(
                f"{label(item['model'])} from ω = {item['family']:.4g}")
            lines.append({"model": item["model"], "family": item["family"]})
            records.append({key: value for key, value in item.items() if key != "branch"})
            if traced:
                lines[-1] |= {**traced.summary(), "seconds": item["seconds"]}
                records[-1] |= traced.record()
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
            fs.motion.bifurcation_chart(whole, dots, self.branch, families, float(getattr(belt, self.branch)),
                                        models.scene.name)])
