"""A map of stability over two parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import femsub as fs
from femsub.app.asks import Ask, parameter_of, range_of
from femsub.app.kinds import key
from femsub.app.result import Result
from femsub.checks import InputError

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Models


@dataclass(frozen=True)
class MapAsk(Ask):
    """The number of growing modes and the largest growth rate over two parameters, with the borders of stability as curves.

    For a third parameter there is a map at each of its values; the page shows one map at a time.
    """

    map: list[str] = key([], "the two parameters, across and up", required=True, form="[across, up]", example=["mu", "pressure"])
    points: list[int] = key([60, 60], "number of values of each parameter", least=2, form="[across, up]")
    third: dict[str, list[float]] = key({}, "a third parameter and its values: {speed = [10, 20]}", otherwise="none")
    models: str = key("best", "the model that is mapped: 'full', or 'best', the largest of the last method",
                      choices=lambda _: ("full", "best"))
    spots: int = key(4, "number of points at which the full model is solved too, to check a reduced one", least=0)

    KIND: ClassVar[str] = "map"
    PENCIL: ClassVar[bool] = True

    def check(self, scene: Scene) -> None:
        super().check(scene)
        for name in (*self.map, *self.third):
            parameter_of(scene, name)
        for name in self.map:
            range_of(scene, name, [])
        if len(self.third) > 1:
            raise InputError("third is one parameter with its values, but names several")

    def run(self, models: Models) -> Result:
        known = models.chosen(self.models)[0]
        band = models.band_below(known, self.band)
        ranges = {name: range_of(models.scene, name, []) for name in self.map}
        maps: dict[str, Any] = {}
        (third, values), = self.third.items() or {"": [0.0]}.items()
        for value in values:
            scene = models.scene.varied({f"parameter.{third}.value": value}) if third else models.scene
            own = models.of(scene)
            model, contacts = own.over(known if not own.pencil else own.exact, list(self.map))
            full = own.full if known.before and not own.pencil else None
            maps[f"{third} = {value:g}" if third else ""] = fs.stability_map(
                model, ranges, contacts=contacts, band=band, points=(self.points[0], self.points[1]), full=full,
                spots=self.spots if full is not None else 0, progress=models.say)
        shown: list[Any] = [f"{name}: {one!r}" if name else repr(one) for name, one in maps.items()]
        for name, one in maps.items():
            shown += fs.stability.stability_map_tables("map" + f"-{name.replace(' = ', '-')}" * bool(name), one)
        data = {"map": {"parameters": self.map, "share_undecided": {name: float(one.undecided.mean()) for name, one
                                                                    in maps.items()},
                        "growing": {name: int(one.number.max()) for name, one in maps.items()}}}
        return Result(data, [*shown, fs.stability.stability_map_chart("map", maps, f"{models.scene.name}: stability over "
                                                                 f"{self.map[0]} and {self.map[1]}")])
