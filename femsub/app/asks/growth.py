"""Growth over a parameter and over what else varies: a heat map with the borders of all models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import femsub as fs
from femsub import studies
from femsub.app.asks import Ask, parameter_of
from femsub.app.keys import key
from femsub.app.result import Result
from femsub.errors import InputError

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Models
    from femsub.app.result import Result


@dataclass(frozen=True)
class GrowthAsk(Ask):
    """max Re λ of each model over the slope of a belt, and the critical slope, for each place or whatever else varies."""

    growth: str = key("slope", "the parameter", required=True, example="slope")
    between: list[float] = key([-0.4, -1e-3], "its range", form="[lo, hi]")
    points: int = key(60, "values in the range, at equal ratios where the range does not hold 0", least=2, most=10000)

    KIND: ClassVar[str] = "growth"
    NEEDS: ClassVar[tuple[str, ...]] = ("belt",)

    def check(self, scene: Scene) -> None:
        super().check(scene)
        parameter_of(scene, self.growth)
        if not self.varying:
            raise InputError("growth needs vary with several values: what changes from column to column, e.g. {\"part.chain.belt\" = [1, 2, 3]}")

    def run(self, models: Models) -> Result:
        lo, hi = self.between
        values = np.linspace(lo, hi, self.points) if lo * hi <= 0 else np.sign(lo) * np.geomspace(abs(hi), abs(lo), self.points)
        panels: dict[tuple[str, int, str], dict[str, Any]] = {}
        first, *others = self.varying
        for varied, own in self.variants(models):
            band = own.band_of(self.band)
            for one in own.every:
                rest = ", ".join(str(varied[name]) for name in others)
                panel = panels.setdefault((one.kind, one.modes, rest), {"model": one.kind, "rest": rest, "growth": [], "critical_slope": []})
                reached = band[1] <= one.model.cutoff  # else its modes above the cut-off would have a say
                panel["growth"].append(fs.sweep(one.model, own.at({self.growth: 0.0}), self.growth, values, band=band).growth
                                       if reached else np.full(len(values), np.nan))
                panel["critical_slope"].append(studies.first_loss(one.model, own.linear, self.growth, None, band).value)
        for panel in panels.values():
            panel["growth"] = np.array(panel["growth"])
        found = {"slopes": values, "at": next(given for given in self.vary.values() if len(given) > 1), "over": first,
                 "panels": sorted(panels.values(), key=lambda one: one["rest"])}
        return Result({"growth": found}, [studies.growth_chart(found)])
