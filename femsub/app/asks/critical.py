"""The first loss of stability over a parameter, of the full and the reduced models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.asks import WHICH, Ask, check_factors, parameter_of, range_of, rowed
from femsub.app.kinds import key
from femsub.app.result import Remark, Result, Shown, Table, Verdict, column, label, span
from femsub.checks import InputError, first_few

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Known, Models


@dataclass(frozen=True)
class CriticalAsk(Ask):
    """The first loss of stability over a parameter; with `every`, all losses and regains, with evidence that none is missing.

    The critical 'slope' of a belt is the largest dμ/dv ≤ 0 at which a mode of the band reaches the imaginary axis.
    No range is needed for it.
    """

    critical: str = key("slope", "the parameter: a key of the contacts, a name in factors of matrices, or [parameter.NAME]",
                        required=True, example="mu")
    between: list[float] = key([], "its range", form="[lo, hi]", otherwise="that of [parameter.NAME]; 'slope' has none",
                               example=[0.0, 0.6])
    every: bool = key(False, "whether all losses and regains of the full model or the pencil are sought and counted")
    models: str = key("all", "the models: 'full', 'reduced', 'all' or 'best'", choices=lambda _: WHICH)
    reference: list[float] = key([], "known critical values to compare with, one for each combination of vary", otherwise="none")

    KIND: ClassVar[str] = "critical"
    PENCIL: ClassVar[bool] = True

    @property
    def by_slope(self) -> bool:
        """Whether the parameter is the slope of a belt, which has no range."""
        return self.critical == "slope" and not self.between

    def check(self, scene: Scene) -> None:
        super().check(scene)
        parameter_of(scene, self.critical)
        if not self.by_slope:
            check_factors(scene, self, self.critical, range_of(scene, self.critical, self.between))
        elif not any(type(one).KIND == "belt" for one in scene.contacts.values()):
            raise InputError("between is missing: only the slope of a belt has no range")
        for path in self.vary if self.by_slope else ():
            if path.startswith("contact.") and path.rpartition(".")[2] in ("speed", "slope", "law", "eps"):
                raise InputError(f"vary: {path!r} changes nothing, since the slope dμ/dv itself is sought. Take 'force', or "
                                 "another critical parameter")

    def run(self, models: Models) -> Result:
        rows, crossings, lost = list[dict[str, Any]](), list[dict[str, Any]](), dict[str, Any]()
        names = self.varying
        for number, (values, own) in enumerate(self.variants(models)):
            known = self.reference[number] if number < len(self.reference) else None
            if models.pencil or self.every:
                for one in own.chosen("full" if models.pencil and self.models == "all" else self.models):
                    found = self.all_of(own, one)
                    lost[" ".join(map(str, values.values())) or own.scene.name] = found
                    crossings += rowed(values, [{**one.head, **row} for row in found.beside(known)])
                if models.pencil:
                    continue
            rows += rowed(values, self.first_of(own))
        data: dict[str, Any] = {"critical": rows or crossings}
        band = models.band_of(self.band)
        shown: list[Shown] = [f"Critical {self.said}{f', modes from {span(band)}' if band else ''}"]
        if rows:
            columns = [*names, "model", "modes", "size", column("value", f"critical {self.said}", ".6g", cell=never),
                       column("omega", "at ω", ".5g"), "error", "port_error"]
            shown.append(Table("critical", rows, columns, f"Critical {self.said}", keys=len(names) + 3))
            shown += dict.fromkeys(f"{label(row['model'])} with {row['size']} DOF: {row['reason']}" for row in rows
                                   if row["reason"])
            if any(row["omega"] == 0 for row in rows):
                shown.append("ω = 0: rigid motion loses its damping and drifts before anything oscillates; for the border of "
                             f"oscillating modes give band = [lo, hi] with lo above 0, e.g. [{1e-3 * models.band[1]:.3g}, "
                             f"{models.band[1]:.6g}]")
            shown.append(fs.stability.critical_chart(rows, names, self.said, models.scene.name))
            if not (self.by_slope or names):
                shown.append(Remark([f"Of the full model, the critical {self.said} is {row['value']:.6g}, at {row['omega']:.6g} "
                                     "rad/time." for row in rows if row["model"] == "full" and np.isfinite(row["value"])]))
        if crossings:
            several = len(crossings) != len({(row["model"], *(row[name] for name in names)) for row in crossings})
            columns = [*names, *([] if models.pencil else ["model", "size"]), column("stability", form="s"),
                       column("value", self.said, "s", cell=lambda row: None if row["value"] is None else
                              fs.stability.fixed_digits(row["value"], row["width"])), column("kind", form="s"), "omega",
                       *([column("reference", "known", ".10f"), column("error", "error", ".0e")] if self.reference else []),
                       "evidence"]
            name = "critical-all" if rows else "critical"
            shown += [*([f"All losses and regains of stability, over {self.said}:"] if several or rows else []),
                      Table(name, crossings, columns, "Losses and regains of stability"), *self.verdict(crossings, lost)]
            data["critical-all"] = {"rows": crossings, "not_excluded": {name: [list(one) for one in found.open]
                                                                       for name, found in lost.items()}}
        models.scene.store["critical", self.critical] = {name: [*found.losses, *found.regains] for name, found in lost.items()}
        models.scene.store["first", self.critical, models._key] = {
            (row["model"], row["modes"]): row["value"] for row in rows if np.isfinite(row["value"])}
        return Result(data, shown)

    @property
    def said(self) -> str:
        """The parameter in texts."""
        return {"slope": "dμ/dv", "mu": "μ"}.get(self.critical, self.critical)

    def first_of(self, models: Models) -> list[dict[str, Any]]:
        """A row for each model: its first loss of stability, beside the full model's."""
        between = None if self.by_slope else range_of(models.scene, self.critical, self.between)
        band, rows = models.band_of(self.band), list[dict[str, Any]]()
        chosen = models.chosen(self.models)
        # over a range the full model is last: its search begins near the loss of the last reduced one
        ordered = sorted(chosen, key=lambda one: one is models.exact) if between else chosen
        found: dict[Known, Any] = {}
        near = float("nan")
        for one in ordered:
            models.say(f"critical {self.critical} of {one.kind} with {one.model.size} DOF")
            model, contacts = models.over(one, [self.critical])
            found[one] = fs.stability.first_loss(model, contacts, self.critical, between, band, near)
            near = found[one].value
        exact = found[models.exact].value if models.exact in found else float("nan")
        for one in chosen:
            loss, errors = found[one], getattr(one.model, "port_error", {})
            rows.append({**one.head, "value": loss.value, "omega": loss.omega, "full": exact,
                         "error": fs.modes.relative_error(loss.value, exact), "port_error": max(
                             (errors.get(name, 0.0) for name in models.places), default=0.0), "reason": loss.reason})
        return rows

    def all_of(self, models: Models, one: Known) -> Any:
        """All losses and regains of stability of a model."""
        models.say(f"critical {self.critical}, all losses of {one.model.size} DOF")
        model, contacts = models.over(one, [self.critical])
        between = None if self.by_slope else range_of(models.scene, self.critical, self.between)
        return fs.stability.all_losses(model, contacts, self.critical, between, models.band_of(self.band))

    def verdict(self, rows: list[dict[str, Any]], lost: Mapping[str, Any]) -> list[Shown]:
        """The verdict on all losses and regains, after lines on intervals in which further crossings are not excluded."""
        left = [f"{name}: further crossings are not excluded in "
                f"{first_few([f'{start:.9g} to {end:.9g}' for start, end in found.open], 'intervals')}." for name, found
                in lost.items() if found.open]
        decides = []
        for row in rows:
            at = "" if row["value"] is None else f" at {row['value']:.8g} by {row['kind']}"
            closed = "" if row.get("reference") is None or row["value"] is None else f" Known is {row['reference']:.8g}."
            decides.append(f"Stability is {row['stability']}{at} ({row['evidence']}).{closed}")
        answer, headline = fs.stability.outcome(list(lost.values()), rows, self.said)
        return [*left, Verdict(decides, ["Values of the parameter outside the range were not searched."], answer, headline,
                               "Where is stability lost?")]


def never(row: Mapping[str, Any]) -> Any:
    """The row's value; 'never' if stability is not lost, at ±inf."""
    return "never" if abs(row["value"]) == float("inf") else row["value"]
