"""Derivatives of eigenvalues with respect to parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import femsub as fs
from femsub.app.asks import AskAt, parameter_of
from femsub.app.kinds import key
from femsub.app.result import Result

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Models


@dataclass(frozen=True)
class SensitivitiesAsk(AskAt):
    """∂λ/∂p of the modes that grow, or of the least stable one, with error bars."""

    sensitivities: list[str] = key([], "the parameters: keys of the contacts, names in factors, or [parameter.NAME]",
                                   required=True, example=["mu", "pressure"])
    models: str = key("best", "the model: 'full', or 'best', the largest of the last method", choices=lambda _: ("full", "best"))

    KIND: ClassVar[str] = "sensitivities"
    PENCIL: ClassVar[bool] = True

    def check(self, scene: Scene) -> None:
        super().check(scene)
        for name in self.sensitivities:
            parameter_of(scene, name)

    def run(self, models: Models) -> Result:
        known = models.chosen(self.models)[0]
        modes = models.spectrum(known, self.at, models.band_below(known, self.band))
        of = modes.drawn_first()
        model, given = known.model, models.scene.parameters
        parameters = [(given[name].change(models) if name in given else None) or name for name in self.sensitivities]
        values = models.values(model.parameters, self.at) if models.pencil or isinstance(model, fs.BoxModel) else None
        found = fs.sensitivities(model, None if values is not None else models.at(self.at), modes, parameters, of=of, at=values)
        table, = found.tables()
        whose = "of the full model" if not known.before else f"of the model of {known.model.size} DOF"
        return Result({"sensitivities": table.rows}, [
            f"Derivatives of eigenvalues {whose}: {found!r}", table,
            found.chart(f"{models.scene.name}: change of Re λ by the whole of each parameter, to first order")])
