"""Full and reduced models integrated in time from one state: error of the amplitude against the run time of a period."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.asks.motion import MotionAsk
from femsub.app.kinds import key
from femsub.app.result import Result, Table, column, label
from femsub.checks import Interruptible

if TYPE_CHECKING:
    from femsub.app.models import Models


@dataclass(frozen=True)
class CompareMotionAsk(MotionAsk):
    """The largest reduced model runs from a blow to its limit cycle. From its state then, all models are integrated and compared.

    Times are in periods of the mode of that model that grows fastest. An [[ask]] motion with the same keys shares the long run.
    """

    motion: list[float] = field(default_factory=lambda: [0.0, 400.0])
    long: float = key(400.0, "periods of the long run", least=4)
    compare_motion: float = key(12.0, "periods of the runs side by side; amplitudes are compared over the second half", least=4)
    full_tol: float = key(3e-5, "error control of the full model (femsub.transient)", above=0)
    points: int = key(40, "number of recorded points per period", least=8)
    in_periods: bool = True
    models: str = "best"

    KIND: ClassVar[str] = "compare-motion"
    NEEDS: ClassVar[tuple[str, ...]] = ("contact", "reduce")
    WITHOUT: ClassVar[dict[str, str]] = dict.fromkeys(("motion", "in_periods", "models", "show", "window", "length"),
                                                      "times are in periods")

    def __post_init__(self) -> None:
        object.__setattr__(self, "motion", [0.0, self.long])

    def run(self, models: Models) -> Result:
        best = models.best
        long, _, period = self.long_run(models, best)
        state = [best.expand(part[:, None])[:, 0] for part in (long.final.displacement, long.final.velocity)]
        rows, exact, place = list[dict[str, Any]](), 0.0, self.place(models)
        with Interruptible() as course:
            long.whole()
            for one in models.every:
                full = one is models.exact
                start = fs.State(*state) if full else fs.State(*(fs.motion.project(one.model, models.full.M, part) for part
                                                                 in state))
                name = f"{label(one.kind)} with {one.model.size} DOF"
                runs = [fs.transient(one.model, models.contacts, (0.0, self.compare_motion * period), start=start,
                                     step=period / self.points, tol=self.full_tol if full else self.tol,
                                     method="alpha" if full else "lsoda",
                                     progress=lambda text, name=name: models.say(f"{name}, {text}")  # type: ignore[misc]
                                     ).whole() for _ in range(1 if full else models.scene.reduce.repeats)]
                v = runs[0].velocity(place)
                amplitude = float(v[len(v) // 2:].std())
                exact = amplitude if full else exact
                seconds = float(np.median([item.effort.seconds for item in runs])) / self.compare_motion
                rows.append({**one.head, "rms": amplitude, "amplitude_error": fs.modes.relative_error(amplitude, exact),
                             "seconds_per_period": seconds, "speedup": rows[0]["seconds_per_period"] / seconds if rows else 1.0,
                             "steps": runs[0].effort.steps, "energy_residual": runs[0].energy.residual,
                             "method": runs[0].effort.method})
        columns = ["model", "modes", "size", column("rms", form=".6g"), column("amplitude_error", "error", ".1e"),
                   column("seconds_per_period", "s per period", ".2g"), column("speedup", "times faster", ".4g"), "steps",
                   "energy_residual"]
        return Result({"compare-motion": {"period": period, "rows": rows}} | ({} if course.complete else {"complete": False}), [
            f"Full and reduced models from one physical state over {self.compare_motion:g} periods (amplitudes over the second "
            "half)",
            Table("compare-motion", rows, columns, "Error against run time in motion"),
            *([fs.motion.period_chart(rows)] if len(rows) > 1 else [])])
