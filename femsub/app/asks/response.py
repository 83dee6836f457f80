"""Receptances of the full and the reduced models over a band."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.asks import Ask, check_place
from femsub.app.kinds import key
from femsub.app.result import Advice, Result, Table, column, label
from femsub.checks import InputError

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Models


@dataclass(frozen=True)
class ResponseAsk(Ask):
    """h(ω), the motion at a place per force at another place, and a bound of each reduced model's error."""

    response: list[str] = key([], "the places of the forces, 'part.port'", required=True, example=["beam.belt"])
    observe: list[str] = key([], "the places whose motion is observed", otherwise="the places of the forces")
    frequencies: int = key(400, "number of frequencies in the band", least=2, most=100_000)
    loss: float = key(0.0, "loss factor of structural damping of the whole model, beside that of its parts", least=0)
    sliding: bool = key(False, "whether the contacts act: vibration about steady sliding, not about rest")

    KIND: ClassVar[str] = "response"

    def check(self, scene: Scene) -> None:
        super().check(scene)
        for place in (*self.response, *self.observe):
            check_place(scene, place)
        if self.loss and len(scene.parts) > 1:
            raise InputError("loss is for a model of one part. Give loss in the tables of the parts")

    def run(self, models: Models) -> Result:
        scene, (lo, hi) = models.scene, models.band_of(self.band)
        omega = np.linspace(lo or hi / self.frequencies, hi, self.frequencies)
        loads = [models.port(place) for place in self.response]
        seen = [models.port(place) for place in self.observe or self.response]
        acting = models.linear if self.sliding else None
        exact: Any = None
        curves, rows, points = list[dict[str, Any]](), list[dict[str, Any]](), list[dict[str, Any]]()
        pairs = list(product(self.response, self.observe or self.response))
        for one in models.every:
            models.say(f"receptance, {label(one.kind)} with {one.model.size} DOF")
            model = fs.damped(one.model, structural=self.loss) if self.loss else one.model
            found = fs.frequency_response(model, acting, at=omega, loads=loads, responses=seen)
            errors = found.errors(exact) if exact else []
            for at, ((load, place), curve) in enumerate(zip(pairs, found.curves(exact), strict=True)):
                which = one.head | ({"load": load, "place": place} if len(pairs) > 1 else {})
                curves.append({**one.head, **curve, "words": f", {place} by {load}" if len(pairs) > 1 else ""})
                points += [which | dict(zip(curve, map(float, values), strict=True))
                           for values in zip(*curve.values(), strict=True)]
                rows += [which | row for row in errors[at:at + 1]]
            exact = exact or found
        columns = ("model", "modes", "size", *(("load", "place") if rows and "load" in rows[0] else ()), column("error", "err h"),
                   column("omega", "at ω", ".5g"), column("error_local", "err h / h", ".1e"), "evidence")
        table = Table("response-errors", rows, columns if rows else (), "Errors of receptances", keys=3)
        where = "about the sliding state" if self.sliding else "at rest"
        head = (f"Receptance at {', '.join(self.observe or self.response)} {where}, loss factor {self.loss:g}, at {len(omega)} "
                f"frequencies; full model: {exact.evidence}, {int(exact.direct.sum())} solved directly, the others by "
                f"{exact.modes} modes")
        shown: list[Any] = [head, table, Table("response", points, title="Receptances"),
                            fs.modes.response_chart(curves, f"{scene.name}: receptance {where}")]
        data = {"evidence": exact.evidence, "modes": exact.modes, "direct": int(exact.direct.sum()), "sliding": self.sliding,
                "loss": self.loss, "rows": rows}
        if not rows:
            return Result({"response": data}, shown)
        tolerance = scene.reduce.tolerance
        choice = Advice(sentence="no small model of this run is accurate enough. Keep more modes, or lower the band",
                        full=models.full.size, band=(lo, hi), brief=table.text(scene.units.known))
        worst_of = {(row["model"], row["modes"], row["size"]): max(
            other["error"] for other in rows if (other["model"], other["modes"]) == (row["model"], row["modes"])) for row in rows}
        fit = [(one, error) for one, error in worst_of.items() if error <= tolerance and one[2] < models.full.size]
        if fit:
            (kind, modes, size), error = min(fit, key=lambda one: (one[0][2], one[1]))
            name, off = label(kind), f"off by at most {error:.1e}"
            choice = replace(
                choice, decides=[f"Its receptance is {off} of the largest one, {where}."], size=size,
                sentence=f"for {100 * tolerance:.3g} % of the largest receptance take {name} with {size} DOF: it is {off}",
                model=f"{name} with {modes} modes ({size} DOF)")
        return Result({"response": data}, [*shown, choice])
