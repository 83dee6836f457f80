"""Effective masses of modes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import femsub as fs
from femsub.app.asks import Ask
from femsub.app.kinds import key
from femsub.app.result import Result

if TYPE_CHECKING:
    from femsub.app.models import Models


@dataclass(frozen=True)
class MassesAsk(Ask):
    """The share of the mass that the modes of the band move when the supports are accelerated."""

    masses: list[float] = key([0.0, 0.0, 0.0], "the point about which rotations are taken", unit="length", form="[x, y, z]")

    KIND: ClassVar[str] = "masses"

    def run(self, models: Models) -> Result:
        modes = fs.normal_modes(models.full, band=models.band_of(self.band))
        found = fs.effective_masses(models.full, modes, origin=self.masses)
        table, = found.tables()
        return Result({"masses": list(table.rows)}, [repr(found), table, found.chart(f"{models.scene.name}: effective masses")])
