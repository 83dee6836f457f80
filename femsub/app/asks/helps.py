"""Which of several changes of a model helps against a growing mode."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import femsub as fs
from femsub.app.asks import AskAt, parameter_of
from femsub.app.kinds import key
from femsub.app.result import Result, column
from femsub.checks import InputError

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Models


@dataclass(frozen=True)
class HelpsAsk(AskAt):
    """The largest growth rate after each change, from a new solution, in the order of the effect."""

    helps: dict[str, float] = key({}, "changes and their amounts: {damper = 100.0} with [parameter.damper]", required=True,
                                  example={"damper": 100.0})
    target: float = key(0.0, "the growth rate that must not be exceeded; 0: stability", unit="1/time")
    models: str = key("best", "the model: 'full', or 'best', the largest of the last method", choices=lambda _: ("full", "best"))
    solved_in_full: int = key(1, "number of the best changes that are solved in the full model as well", least=0)

    KIND: ClassVar[str] = "helps"
    NEEDS: ClassVar[tuple[str, ...]] = ("contact",)

    def check(self, scene: Scene) -> None:
        super().check(scene)
        for name in self.helps:
            parameter_of(scene, name)
            if name not in scene.parameters or not scene.parameters[name].acts:
                raise InputError(f"{name!r} is no change: [parameter.{name}] must have material, mass, spring or damper")

    def run(self, models: Models) -> Result:
        known = models.chosen(self.models)[0]
        candidates = {name: replace(models.scene.parameters[name].change(models), amount=amount) for name, amount
                      in self.helps.items()}
        found = fs.what_helps(known.model, models.at(self.at), candidates, self.target, band=models.band_below(known, self.band),
                              full=models.full if known.before else None, first=self.solved_in_full)
        table, = found.tables()
        rows = [{**row, "amount": self.helps.get(row["change"], float("nan"))} for row in table.rows]
        columns = [table.columns[0], column("amount", form=".5g"), *table.columns[1:]]
        return Result({"helps": {"before": found.before.growth, "rows": rows}}, [
            repr(found), replace(table, rows=rows, columns=columns), found.chart(f"{models.scene.name}: what helps")])
