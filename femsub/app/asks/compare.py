"""Reduced models against the full one: errors over run time, and which model is recommended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.asks import Ask, parameter_of, range_of, rowed
from femsub.app.kinds import key
from femsub.app.models import Known
from femsub.app.result import Result, Table, column
from femsub.checks import NOT_CHECKED
from femsub.studies import error_time_chart, study_chart

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Models


ERRORS = ("growth", "critical", "held", "response")


@dataclass(frozen=True)
class CompareAsk(Ask):
    """Frequencies, growth rates and run time of each reduced model beside the full one; the smallest one that may replace it.

    To measure times, each model is reduced and solved again, in turns.
    """

    compare: list[str] = key(["growth", "critical", "held"], "results that are compared beside frequencies: growth rates, the "
                             "critical value of the parameter, frequencies with the interface held, receptances",
                             choices=lambda _: ERRORS)
    parameter: str = key("", "the parameter whose critical value is compared", otherwise="'slope' of a belt", example="mu")
    values: list[float] = key([], "values of the parameter at which growth rates are compared",
                              otherwise="the values of the contacts",
                              example=[0.2, 0.4])
    between: list[float] = key([], "its range", form="[lo, hi]", otherwise="that of [parameter.NAME]")
    frequencies: int = key(400, "number of frequencies of the band at which receptances are compared", least=2, most=100_000)
    listed: int = key(0, "number of natural frequencies printed, of the full and the recommended model", least=0)

    KIND: ClassVar[str] = "compare"
    NEEDS: ClassVar[tuple[str, ...]] = ("reduce",)

    def check(self, scene: Scene) -> None:
        super().check(scene)
        if self.parameter:
            parameter_of(scene, self.parameter)
        if self.over:
            range_of(scene, self.parameter, self.between)

    @property
    def over(self) -> bool:
        """Whether a range of a parameter is searched."""
        return bool(self.parameter) and self.parameter != "slope" and "critical" in self.compare

    def run(self, models: Models) -> Result:
        rows, shown, made = list[dict[str, Any]](), list[Any](), list[tuple[str, fs.Study]]()
        recommended: list[dict[str, Any]] = []
        frequencies: list[dict[str, Any]] = []
        choices: list[Any] = []
        left_out: list[str] = []
        for values, own in self.variants(models):
            found = self.study(own)
            words = ", ".join(f"{name} {value}" for name, value in values.items())
            made.append((words, found))
            rows += rowed(values, found.flat)
            choice = found.advice(own.scene.reduce.tolerance, words)
            choices.append(choice)
            recommended.append({**values, "sentence": choice.sentence, "model": choice.row})
            left_out += found.left_out
            shown += [f"Error against run time{f', {words}' if words else ''}", str(found), choice.sentence]
            if self.listed:
                more, listed = self.beside(own, found)
                shown += more
                frequencies += rowed(values, listed)
        table = Table("compare", rows, title="Error against run time")
        shown += [table, *self.charts(models, made), *choices]
        data = {"rows": rows, "band": made[0][1].band, "recommended": recommended, "left_out": left_out,
                "frequencies": frequencies,
                "tolerance": models.scene.reduce.tolerance, "values": list(made[0][1].values)}
        return Result({"compare": data}, shown)

    def study(self, models: Models) -> fs.Study:
        """The comparison of a full model with its reduced models. The store keeps models and spectra for other asks."""
        keys, (lo, hi) = models.scene.reduce, models.band_of(self.band)
        made = models.reductions()
        over: dict[str, Any] = {"parameter": self.parameter, "between": range_of(models.scene, self.parameter,
                                                                                 self.between)} if self.over else {}
        if not over and (self.parameter or "critical" not in self.compare):
            over = {"parameter": self.parameter if self.values else ""}
        at = np.linspace(lo or hi / self.frequencies, hi, self.frequencies) if "response" in self.compare else None
        known = models.scene.store.get(("first", "slope", models._key)) if not over else None
        kinds = [("full", 0), *((key, count) for key, count, _ in made)]
        critical = [known[one] for one in kinds] if known and all(one in known for one in kinds) else None
        found = fs.study(models.full, [steps for _, _, steps in made], (lo, hi), contacts=models.linear, ports=keys.ports,
                         repeats=keys.repeats, held="held" in self.compare and not over, at=at, assembly=models.assembly,
                         critical=critical, values=self.values, progress=models.say, **over)
        for own, model in zip(found.steps, found.models, strict=True):
            key, count, _ = next(one for one in made if one[2] == own)
            if len(own) == 1:  # for several steps the study does not return the models between them
                models.scene.store.setdefault(models.place_of(own), Known(key, count, model, [models.full], own))
        values = [{self.parameter: value} for value in found.values] or [{}]
        for given, spectrum in zip(values, found.spectra, strict=True):
            place = "modes", id(models.full), tuple(given.items()), (lo, hi), repr(models.linear)
            models.scene.store.setdefault(place if spectrum.evidence != NOT_CHECKED else ("uncounted", *place), spectrum)
        return found

    def charts(self, models: Models, made: list[tuple[str, fs.Study]]) -> list[Any]:
        """Charts of errors over run time; for a part by itself, one chart has all its variants."""
        if models.alone and not self.over:
            return [error_time_chart(made)]
        return [study_chart(found, f"{models.scene.name} {words}".strip(), "-".join(["compare", *words.split()]))
                for words, found in made]

    def beside(self, models: Models, found: fs.Study) -> tuple[list[Any], list[dict[str, Any]]]:
        """(output, rows): natural frequencies in the band, of the full and of the recommended model."""
        own = fs.normal_modes(models.full, band=found.band).elastic
        best = found.recommended(models.scene.reduce.tolerance)
        rows: list[dict[str, Any]] = [{"mode": i, "omega": omega} for i, omega in enumerate(own, start=1)]
        of, columns = "", ["mode", "omega"]
        if best is not None:
            of, columns = f", and of {best.label} with {best.size} DOF", [*columns, "reduced", "error"]
            theirs = fs.modes.undamped(found.models[found.rows.index(best)]).elastic
            for at, to in zip(*fs.modes.match(own, theirs), strict=True):
                if abs(theirs[to] - own[at]) <= fs.modes.NEAR * own[at]:
                    rows[at] |= {"reduced": theirs[to], "error": abs(theirs[to] - own[at]) / own[at]}
        notes: list[Any] = []
        worst = max(found.rows, key=lambda row: row.port_error, default=None)
        if worst is not None and worst.port_error > fs.reduction.PORT_LIMIT:
            notes.append(f"the static response to the contact is off by up to {100 * worst.port_error:.2g} % ({worst.label} with "
                         f"{worst.size} DOF). Set ports = true, or put the contact into the interface")
        if not rows:
            return notes, []
        more = [f"and {len(rows) - self.listed} more"] * (len(rows) > self.listed)
        return [*notes, f"natural frequencies of the full model in the band{of}, in rad/time:", Table(
            "compare-frequencies", rows, [column("reduced", "reduced ω", ".6g") if one == "reduced" else one for one in columns],
            "Natural frequencies", most=self.listed), *more], rows
