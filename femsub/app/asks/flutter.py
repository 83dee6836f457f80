"""The flutter diagram: modes tracked over a parameter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import femsub as fs
from femsub.app.asks import WHICH, Ask, check_factors, parameter_of, range_of
from femsub.app.kinds import key
from femsub.app.result import Remark, Result, Table, label
from femsub.checks import InputError

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Models


@dataclass(frozen=True)
class FlutterAsk(Ask):
    """Frequencies and growth rates of modes over a parameter, and where they meet."""

    flutter: str = key("mu", "the parameter: a key of the contacts, a name in factors of matrices, or [parameter.NAME]",
                       required=True, example="mu")
    between: list[float] = key([], "its range", form="[lo, hi]", otherwise="that of [parameter.NAME]", example=[0.0, 0.6])
    points: int = key(29, "number of values at which modes are listed; the diagram has more where modes meet", least=2,
                      most=10000)
    models: str = key("best", "models drawn as lines: 'full', 'reduced', 'all', or 'best', the largest of the last method",
                      choices=lambda _: WHICH)
    full: list[float] = key([], "values at which the full model is solved and drawn beside a reduced one", otherwise="none",
                            example=[0.2, 0.4])

    KIND: ClassVar[str] = "flutter"
    PENCIL: ClassVar[bool] = True

    def check(self, scene: Scene) -> None:
        super().check(scene)
        parameter_of(scene, self.flutter)
        check_factors(scene, self, self.flutter, range_of(scene, self.flutter, self.between))

    def run(self, models: Models) -> Result:
        lo, hi = range_of(models.scene, self.flutter, self.between)
        tracks, crossings, points = dict[str, Any](), dict[str, Any](), dict[str, Any]()
        kept = models.scene.store.get(("critical", self.flutter), {})
        symbol = "μ" if self.flutter == "mu" else self.flutter
        for values, own in self.variants(models):
            for one in own.chosen(self.models):
                name = " ".join([*map(str, values.values()), *([] if models.pencil and values else [
                    label(one.kind) if one.kind != "full" else own.scene.name if models.pencil else "full"])])
                models.say(f"modes over {self.flutter}, {name} with {one.model.size} DOF")
                model, contacts = own.over(one, [self.flutter], (lo, hi))
                band = own.band_below(one, self.band)
                tracks[name] = fs.track(model, contacts, self.flutter, np.linspace(lo, hi, self.points), band=band)
                if not tracks[name].eigenvalues.size:
                    raise InputError(f"{name} has no mode from {tracks[name].band[0]:g} to {tracks[name].band[1]:g} rad/time "
                                     "anywhere in the range. Give another band")
                known = kept.get(" ".join(map(str, values.values())) or own.scene.name)
                if known is None and (one.before or models.pencil):
                    found = fs.critical_value(model, contacts, self.flutter, between=(lo, hi), band=band,
                                              solver="followed" if one.before else "auto")
                    known = [*found.losses, *found.regains]
                crossings[name] = known or []
            if self.full:
                points[f"full model of {own.full.size} DOF"] = [
                    (value, own.spectrum(own.exact, {self.flutter: value}, own.band_of(self.band), False).eigenvalues) for value
                    in self.full]
        tables = [(name, table) for name, item in tracks.items() for table in item.tables()]
        branches, meetings = ([{"model": name, **row} for name, table in tables if table.name == kind for row in table.rows]
                              for kind in ("flutter", "flutter-meetings"))
        branches += [{"model": "full", self.flutter: float(value), "growth": float(one.real), "omega": float(one.imag),
                      "damping": float(fs.output.damping_percent(one))} for solved in points.values() for value, several in solved
                     for one in several]
        columns = ["model", *next((table.columns for _, table in tables if table.name == "flutter-meetings"), ())]
        losses = ", ".join(f"of {name} at {symbol} = {min(one.value for one in several):.6g}"
                           for name, several in crossings.items() if several)
        return Result({"flutter": {"branches": branches, "meetings": meetings}}, [
            "Modes tracked:", *(f"{name}: {item!r}".replace(" over mu ", " over μ ") for name, item in tracks.items()),
            Remark([f"Stability is lost in the flutter diagram: {losses}."] if losses else ()),
            Table("flutter", branches, title=f"Branches over {symbol}"),
            Table("flutter-meetings", meetings, columns if meetings else (), "Where modes meet", keys=2),
            fs.stability.flutter_chart("flutter", tracks, crossings, f"{symbol}  [-]", models.scene.name, points)])
