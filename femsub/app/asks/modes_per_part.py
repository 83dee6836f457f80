"""The number of modes that each part needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import femsub as fs
from femsub.app.asks import Ask
from femsub.app.kinds import key
from femsub.app.result import Result, Table, column

if TYPE_CHECKING:
    from femsub.app.models import Models


@dataclass(frozen=True)
class ModesPerPartAsk(Ask):
    """The number of fixed-interface modes of each part with which the whole's natural frequencies are within a tolerance."""

    modes_per_part: float = key(1e-3, "the relative error of the frequencies in the band", above=0)

    KIND: ClassVar[str] = "modes-per-part"
    NEEDS: ClassVar[tuple[str, ...]] = ("parts",)

    def run(self, models: Models) -> Result:
        system, tol = models.full, self.modes_per_part
        undamped = system.with_parts({part: sub.with_damping(None) for part, sub in system.parts.items()})
        models.say(f"modes of each part for a tolerance of {tol:g}")
        method = fs.CraigBampton(band=models.band_of(self.band), tol=tol)
        found = fs.reduce(undamped, dict.fromkeys(system.parts, method), ports=models.scene.reduce.ports)
        kept = {part: own for part, own in found.parts.items() if isinstance(own, fs.ReducedSubstructure)}
        rows = [{"part": part, "size": system.parts[part].size, "interface": len(system.parts[part].interface),
                 "modes": own.modes, "reduced": own.size} for part, own in kept.items()]
        most = max(kept, key=lambda part: kept[part].modes)
        without = ", ".join(part for part, own in kept.items() if not own.modes)
        words = (f"recommendation: Craig-Bampton with {sum(own.modes for own in kept.values())} modes in total, {found.size} of "
                 f"{system.size} DOF. {most} needs the most, {kept[most].modes}")
        words += f". Constraint modes are enough for {without}" if without else ""
        columns = ("part", "size", "interface", "modes", column("reduced", "reduced DOF", "d"))
        return Result({"modes-per-part": {"parts": rows, "size": found.size, "recommendation": words}}, [
            f"fixed-interface modes of each part, for all natural frequencies in the band within {tol:g}:",
            Table("modes-per-part", rows, columns, "Modes of each part"), words])
