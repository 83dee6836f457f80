"""Growth over a parameter and over varied keys: a heat map with the stability borders of all models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.asks import Ask, parameter_of, shown
from femsub.app.kinds import key
from femsub.app.result import Result
from femsub.checks import InputError

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Models


@dataclass(frozen=True)
class GrowthAsk(Ask):
    """max Re λ of each model over the slope of a belt, and the critical slope, for each value of a varied key."""

    growth: str = key("slope", "the parameter", required=True, example="slope")
    between: list[float] = key([-0.4, -1e-3], "its range", form="[lo, hi]")
    points: int = key(60, "number of values in the range, at equal ratios unless the range contains 0", least=2, most=10000)

    KIND: ClassVar[str] = "growth"
    NEEDS: ClassVar[tuple[str, ...]] = ("belt",)

    def check(self, scene: Scene) -> None:
        super().check(scene)
        parameter_of(scene, self.growth)
        if not self.varying:
            raise InputError("growth needs vary with several values: what "
                             "changes from column to column, e.g. {\"part.chain.belt\" = [1, 2, 3]}")

    def run(self, models: Models) -> Result:
        lo, hi = self.between
        values = np.linspace(lo, hi, self.points) if lo * hi <= 0 else np.sign(lo) * np.geomspace(abs(hi), abs(lo), self.points)
        panels: dict[tuple[str, str], dict[str, Any]] = {}
        first, *others = self.varying
        columns = next(given for given in self.vary.values() if len(given) > 1)
        reduce = models.scene.reduce
        several = len(reduce.sizes or reduce.modes) > 1
        for varied, own in self.variants(models):
            band, at = own.band_of(self.band), [shown(value) for value in columns].index(varied[first])
            for one in own.every:
                size = f"{one.model.size} DOF" if reduce.sizes else f"{one.modes} modes"
                rest = ", ".join([*(str(varied[name]) for name in others), *[size] * (several and one.modes > 0)])
                panel = panels.setdefault((one.kind, rest), {
                    "model": one.kind, "rest": rest, "growth": np.full((len(columns), len(values)), np.nan),
                    "critical_slope": np.full(len(columns), np.nan)})
                if band[1] <= one.model.cutoff:  # else modes above the cut-off could have the largest Re λ
                    contacts = own.at({self.growth: 0.0})
                    panel["growth"][at] = fs.sweep(one.model, contacts, self.growth, values, band=band).growth
                panel["critical_slope"][at] = fs.stability.first_loss(one.model, own.linear, self.growth, None, band).value
        ordered = sorted(panels.items(), key=lambda one: list(dict.fromkeys(rest for _, rest in panels)).index(one[0][1]))
        found = {"slopes": values, "at": columns, "over": first, "panels": [one for _, one in ordered]}
        return Result({"growth": found}, [fs.stability.growth_chart(found)])
