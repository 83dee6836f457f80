"""Cards of the modes that grow: the real modes that couple in each, and the forces that feed it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import femsub as fs
from femsub.app.asks import AskAt
from femsub.app.kinds import key
from femsub.app.result import Remark, Result

if TYPE_CHECKING:
    from femsub.app.models import Models


@dataclass(frozen=True)
class CardAsk(AskAt):
    """A card of each mode that grows, or of the least stable one: partner modes, and the work of each force."""

    card: str = key("best", "the model: 'full', or 'best', the largest of the last method", choices=lambda _: ("full", "best"))
    parameter: str = key("mu", "the parameter of contacts whose value is 0 without friction")

    KIND: ClassVar[str] = "card"
    NEEDS: ClassVar[tuple[str, ...]] = ("contact",)

    def run(self, models: Models) -> Result:
        known = models.chosen(self.card)[0]
        modes = models.spectrum(known, self.at, models.band_below(known, self.band))
        which = modes.drawn_first()
        cards = fs.mode_cards(known.model, models.at(self.at), modes, which,
                              full=known.before[-1] if not models.alone and known.before and isinstance(
                                  known.model, fs.ReducedSubstructure) else None, parameter=self.parameter)
        shown: list[Any] = []
        data: list[dict[str, Any]] = []
        for number, card in enumerate(cards, 1):
            shown += [repr(card), card.sentence]
            shown += [replace(table, name=f"card-{number}-{table.name}") for table in card.tables()]
            shown.append(replace(card.chart(), name=f"card-{number}"))
            data.append({"sentence": card.sentence, "eigenvalue": complex(modes.eigenvalues[which[number - 1]])})
        return Result({"card": data}, [*shown, Remark([card.sentence for card in cards])])
