"""Normal modes, as a table, pictures and files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import femsub as fs
from femsub.app.asks import Ask
from femsub.app.kinds import key
from femsub.app.result import Remark, Result, Shown, Table, column
from femsub.app.shapes import pictures

if TYPE_CHECKING:
    from femsub.app.models import Models


@dataclass(frozen=True)
class ModesAsk(Ask):
    """Normal modes of the full model: all modes in the band, or a number of the lowest ones."""

    modes: int | str = key("band", "number of the lowest modes; six more are computed, since a free body has six rigid ones; "
                             "or 'band': all modes in it", choices=lambda _: ("band",), least=1)
    reference: list[float] = key([], "frequencies that another program found, to compare with", unit="rad/time", above=0,
                                 otherwise="none", example=[10.67387655, 11.10545089])
    listed: int = key(20, "number of frequencies printed; the table that --out writes has all", least=1)

    KIND: ClassVar[str] = "modes"

    def run(self, models: Models) -> Result:
        full = models.full
        if isinstance(self.modes, int):
            found = models.normal if self.modes == models.scene.settings.elastic else models.lowest(self.modes)
        else:
            found = fs.normal_modes(full, band=models.band_of(self.band))
        (limit, count), rows = found.counted, fs.modes.rows_beside(found, self.reference)
        data = {"evidence": found.evidence, "rigid": found.rigid, "counted_below": limit, "counted": count, "rows": rows}
        if not rows:
            return Result({"modes": data}, [f"{full.name!r} has no normal mode in the band; {found.evidence}: "
                                            f"{found.count_words}"])
        columns: list[Any] = ["mode", "omega", "residual"]
        shown: list[Shown] = []
        if self.reference:
            apart = [row["difference"] for row in rows if "difference" in row]
            met = f"{len(apart)} of {len(self.reference)} reference frequencies are met by modes of the model"
            shown = [Remark([met + (f", within {max(apart):.1e}." if apart else ".")])]
            columns += [column("reference", "reference ω", ".9g"), column("difference", "rel. difference", ".1e")]
        more = [f"and {len(rows) - self.listed} more"] * (len(rows) > self.listed)
        shown = [f"Normal modes of {full.name!r} in rad/time, {found.rigid} of them rigid; {found.evidence}: {found.count_words}",
                 Table("modes", rows, columns, "Normal modes", most=self.listed), *more, *shown]
        if not models.alone and models.meshes and (bare := [name for name in full.parts if name not in models.meshes]):
            shown.append(f"not drawn, since they have no mesh: {', '.join(bare)}")
        drawn = models.drawn(found.shapes) if models.scene.figures else {}
        units = models.scene.units
        files: dict[str, Any] = {}
        if drawn:
            titles = [f"mode {i}: ω = {omega:.5g} rad/time" for i, omega in enumerate(found.frequencies, 1)]
            fields = [f"mode-{i:02d} {units.frequency(omega)}" for i, omega in enumerate(found.frequencies, 1)]
            made, files = pictures("modes", drawn, titles, f"{models.scene.name}: normal modes", models.marks, fields)
            shown += made
        return Result({"modes": data}, shown, files)
