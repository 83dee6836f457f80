"""The errors of reduced models whose interface is on springs, from soft to stiff."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import femsub as fs
from femsub.app.asks import Ask
from femsub.app.kinds import key
from femsub.app.result import Result, Table, column
from femsub.checks import InputError

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Models


@dataclass(frozen=True)
class SpringsAsk(Ask):
    """Error of the lowest frequencies of K + s Bᵀdiag(d)B, M over s; d_j is the condensed stiffness at interface DOF j."""

    springs: list[float] = key([1e-4, 1e-2, 1.0, 10.0, 100.0, 1e4], "stiffness s of the springs, relative to the part's own "
                               "static stiffness at the interface", above=0)
    lowest: int = key(8, "number of the lowest elastic frequencies that are compared", least=1, most=1000)

    KIND: ClassVar[str] = "springs"
    NEEDS: ClassVar[tuple[str, ...]] = ("reduce",)

    def check(self, scene: Scene) -> None:
        super().check(scene)
        if len(scene.parts) > 1:
            raise InputError("springs are put under the interface of one part by itself, but the scene has several")

    def run(self, models: Models) -> Result:
        sub = models.full
        if not models.alone or not len(sub.interface):
            return Result({"springs": []}, ["Interface on springs: the part has no interface DOF"])
        own, rows = fs.reduction.interface_stiffness(sub), list[dict[str, Any]]()
        count = min(self.lowest, min(one.model.size for one in models.reduced))
        for ratio in self.springs:
            models.say(f"interface on springs of {ratio:g} times its own stiffness")
            errors = fs.reduction.errors_on_springs(sub, [one.model for one in models.reduced], ratio * own, count)
            rows += [{**one.head, "springs": float(ratio), "error": error} for one, error
                     in zip(models.reduced, errors, strict=True)]
        wide = [one.head | {f"{row['springs']:g}": row["error"] for row in rows if one.head.items() <= row.items()}
                for one in models.reduced]
        columns = ("model", "modes", "size", *(column(f"{ratio:g}", form=".1e") for ratio in self.springs))
        return Result({"springs": rows}, [
            f"Interface on springs: largest error of the lowest {count} frequencies, over the springs' stiffness relative to the "
            "part's own at each interface DOF", Table("", wide, columns, keys=3),
            Table("springs", rows, title="Interface on springs"),
            fs.modes.springs_chart(rows, f"{models.scene.name}: interface on springs, lowest {count} frequencies")])
