"""Friction laws as curves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

import femsub as fs
from femsub.app.asks import Ask
from femsub.app.kinds import key
from femsub.app.result import Result

if TYPE_CHECKING:
    from femsub.app.models import Models


@dataclass(frozen=True)
class FrictionLawAsk(Ask):
    """μ over the sliding speed of all friction laws, for several widths ε, with the belt's own speed and slope."""

    friction_law: list[float] = key([1e-1, 1e-2, 1e-3], "widths ε, in addition to the belt's own", unit="length/time", above=0)

    KIND: ClassVar[str] = "friction-law"
    NEEDS: ClassVar[tuple[str, ...]] = ("belt",)

    def run(self, models: Models) -> Result:
        belt = next(one for one in models.scene.contacts.values() if type(one).KIND == "belt")
        side = np.concatenate([np.geomspace(1e-5, 0.05, 60), np.linspace(0.06, 1.0, 95)])
        speeds = np.concatenate([-side[::-1], [0.0], side])
        titles = {name: getattr(law, "label", name) for name, law in fs.coupling.LAWS.items()}
        widths = sorted({*self.friction_law, belt.eps}, reverse=True)  # type: ignore[attr-defined]
        curves = [{"law": name, "eps": eps, "value": fs.coupling.LAWS[name](eps=eps).value(speeds)} for name in fs.coupling.LAWS
                  for eps in widths]
        return Result({"friction-law": {"speed": speeds, "curves": curves}}, [fs.coupling.friction_chart(
            speeds, curves, titles, belt.speed, models.linear[0].slope or 0.0)])  # type: ignore[attr-defined]
