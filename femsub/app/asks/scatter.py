"""The probability of instability if parameters scatter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from scipy import stats

import femsub as fs
from femsub.app.asks import Ask, parameter_of, range_of
from femsub.app.kinds import key
from femsub.app.result import Result

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Models


@dataclass(frozen=True)
class ScatterAsk(Ask):
    """The probability that a mode grows if parameters have uniform distributions over their ranges, or normal ones."""

    scatter: list[str] = key([], "the parameters that scatter", required=True, example=["mu", "stiffness"])
    samples: int = key(4096, "smallest number of samples", least=16, most=10**7)
    seed: int = key(0, "seed of the random numbers", least=0)
    models: str = key("best", "the model: 'full', or 'best', the largest of the last method", choices=lambda _: ("full", "best"))

    KIND: ClassVar[str] = "scatter"
    PENCIL: ClassVar[bool] = True

    def check(self, scene: Scene) -> None:
        super().check(scene)
        for name in self.scatter:
            parameter_of(scene, name)
            given = scene.parameters.get(name)
            if given is None or given.value is None or not given.deviation:
                range_of(scene, name, [])

    def run(self, models: Models) -> Result:
        inputs: dict[str, Any] = {}
        for name in self.scatter:
            given = models.scene.parameters[name]
            if given.deviation and given.value is not None:
                inputs[name] = stats.norm(given.value, given.deviation)
            else:
                lo, hi = range_of(models.scene, name, [])
                inputs[name] = stats.uniform(lo, hi - lo)
        known = models.chosen(self.models)[0]
        band = models.band_below(known, self.band)
        model, contacts = models.over(known, self.scatter)
        found = fs.scatter(model, inputs, contacts=contacts, band=band, samples=self.samples, seed=self.seed, progress=models.say)
        (lo, hi) = found.interval
        return Result({"scatter": {"probability": found.probability, "interval": [lo, hi], "undecided": found.undecided,
                                   "samples": len(found.samples)}}, [
            repr(found), *found.tables(), found.chart(
                f"{models.scene.name}: modes that grow where {', '.join(self.scatter)} scatter")])
