"""Flutter over a parameter: critical values, modes tracked, the flutter diagram; of two models with closed forms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from femsub import Affine, CriticalValue, Tracked, critical_value, track
from femsub.app.keys import key
from femsub.app.scene import Progress, Result, Run, Scene, first_of
from femsub.components import two_mode, two_mode_critical, ziegler, ziegler_critical
from femsub.errors import InputError
from femsub.studies import Table, Verdict, column, flutter_chart, span

if TYPE_CHECKING:
    from femsub.stability import Crossing

NO_BELT = "the model is a pencil with one parameter: it has no belt, and is not reduced"


@dataclass(frozen=True)
class FlutterScene(Scene):
    """What scenes of a pencil with one parameter share."""

    between: list[float] = key([0.0, 1.0], "the range of the parameter", form="[lo, hi]")
    points: int = key(151, "values in the range at which modes are listed; the diagram has others between them where modes "
                      "meet", least=2, most=10000)

    OUTPUTS: ClassVar[tuple[str, ...]] = ("critical-value", "diagram")
    WITHOUT: ClassVar[Mapping[str, str]] = dict.fromkeys(("slope", "law", "eps", "speed", "force", "methods", "repeats"), NO_BELT)


@dataclass(eq=False)
class Flutter(Run):
    """The outputs of pencils over a parameter.

    `models` and what is known of their critical values, `exact`, go by the models' names. `label` is the parameter in texts.
    """

    scene: FlutterScene
    models: Mapping[str, Affine]
    parameter: str
    exact: Mapping[str, float]
    label: str
    band: tuple[float, float] | None = None
    unit: str = ""

    def __post_init__(self) -> None:
        self.between = (self.scene.between[0], self.scene.between[1])
        self.found: dict[str, CriticalValue] = {}
        for name, model in self.models.items():
            self.say(f"critical value, {name}")
            self.found[name] = critical_value(model, None, self.parameter, between=self.between, band=self.band)

    def study(self, data: dict[str, Any], text: Sequence[str] = ()) -> Result:
        """What the scene asks for, below a line with the range."""
        head = f"{self.scene.name}: {self.label} from {self.between[0]:g} to {self.between[1]:g}"
        head += f", modes from {span(self.band)}" if self.band else ""
        return self.result({**data, "between": self.scene.between}, [head, *text])

    def critical_value(self) -> Result:
        exact, label, (lo, hi) = self.exact, self.label, self.between
        rows: list[dict[str, Any]] = []
        for name, item in self.found.items():
            located = any(one.value == item.value for one in item.losses)
            crossings: list[tuple[str, Crossing | None]] = [*(("lost", one) for one in item.losses),
                                                            *(("regained", one) for one in item.regains)]
            if item.growing or not (located or (item.regains and np.isinf(item.value))):
                where = "never lost" if np.isinf(item.value) else "lost at a place not known"
                crossings.insert(0, ("lost at the begin" if item.growing else where, None))
            for what, one in crossings:
                first = located and name in exact and one is item.losses[0]
                rows.append({"model": name, "stability": what, "value": one and one.value, "kind": one.kind if one else "",
                             "omega": one and one.omega, "exact": exact.get(name) if first or one is None else None,
                             "error": abs(one.value - exact[name]) if one and first else None, "width": one and one.width,
                             "evidence": item.evidence})
        columns = ["model", column("stability", form="s"), column("value", label, "s", cell=digits), column("kind", form="s"),
                   "omega", *([column("exact", "closed form", ".10f"), column("error", "error", ".0e")] if exact else []),
                   "evidence"]
        left = [f"{name}: not excluded are further crossings in "
                f"{first_of([f'{start:.9g} to {end:.9g}' for start, end in item.open], 'intervals')}."
                for name, item in self.found.items() if item.open]
        places = {name: [list(one) for one in item.open] for name, item in self.found.items()}
        lost, decides = sum(row["stability"] == "lost" for row in rows), []
        for row in rows:
            at = "" if row["value"] is None else f" at {row['value']:.8g} by {row['kind']}"
            closed = "" if row["value"] is None or row["exact"] is None else f" The closed form gives {row['exact']:.8g}."
            decides.append(f"{row['model']}: stability is {row['stability']}{at} ({row['evidence']}).{closed}")
        return Result({"critical-value": rows, "not_excluded": places}, [
            f"Where stability is lost, over {label}:", Table("critical-value", rows, columns, "Critical values"), *left,
            Verdict(decides, ["Values of the parameter outside the range were not searched."], "found",
                    f"{lost} loss{'es' * (lost != 1)} of stability from {lo:g} to {hi:g}. The model is small as it is, so that "
                    "nothing is reduced.", "Where is stability lost?")])

    def diagram(self) -> Result:
        tracks: dict[str, Tracked] = {}
        for name, model in self.models.items():
            self.say(f"modes tracked, {name}")
            tracks[name] = track(model, None, self.parameter, np.linspace(*self.between, self.scene.points), band=self.band)
            if not tracks[name].eigenvalues.size:
                lo, hi = tracks[name].band
                raise InputError(f"{name} has no mode from {lo:g} to {hi:g} rad/time anywhere in the range. Give another band")
        crossings = {name: [*item.losses, *item.regains] for name, item in self.found.items()}
        branches = [{"model": name, item.parameter: float(item.values[i]), "branch": j, "growth": float(value.real),
                     "omega": float(value.imag), "error_bar": float(item.error_bar[i, j]), "grows": bool(item.growing[i, j])}
                    for name, item in tracks.items() for i in np.flatnonzero(item.asked)
                    for j, value in enumerate(item.eigenvalues[i]) if not np.isnan(value)]
        meetings = [{"model": name, "kind": one.kind, "value": one.value, "width": one.width, "branches": list(one.branches),
                     "growth": one.eigenvalue.real, "omega": one.eigenvalue.imag, "gap": one.gap,
                     "condition": one.condition if np.isfinite(one.condition) else None,
                     "error_bar": one.error_bar if np.isfinite(one.error_bar) else None}
                    for name, item in tracks.items() for one in item.meetings]
        columns = ["model", column("kind", "meeting", "s"), column("value", self.label, ".8g"), column("branches", form="d"),
                   column("growth", form=".6f"), column("omega", "Im λ", ".6f"), column("gap", form=".0e"),
                   column("condition", form=".0e"), "error_bar"]
        axis = f"{self.label}  [{self.unit}]" if self.unit else self.label
        return Result({"branches": branches, "meetings": meetings}, [
            "Modes tracked:", *(f"{name}: {item!r}".replace(" over mu ", " over μ ") for name, item in tracks.items()),
            Table("branches", branches, title=f"Branches over {self.label}"),
            Table("meetings", meetings, columns if meetings else (), "Where modes meet", keys=2),
            flutter_chart("flutter-diagram", tracks, crossings, axis, self.scene.name)])


def digits(row: Mapping[str, Any]) -> str | None:
    """The value with up to 10 places behind the point, none of them below its width."""
    value, width = row["value"], row["width"]
    return None if value is None else f"{value:.{min(max(-int(np.floor(np.log10(width or 1e-10))), 0), 10)}f}"


@dataclass(frozen=True)
class TwoModeScene(FlutterScene):
    """Hoffmann's model of two modes that friction couples, over the coefficient of friction."""

    damping: list[float] = key([0.0, 0.05], "dashpots d1 along the belt, one model for each", least=0, distinct=True,
                               unit="√(mass force/length)")
    ratio: float = key(2.0, "d2 / d1, the dashpot across the belt", least=0)
    between: list[float] = key([0.0, 1.5], "the range of the coefficient of friction", form="[lo, hi]")

    def run(self, progress: Progress) -> Result:
        pairs = {f"d1 = {d:g}, d2 = {self.ratio * d:g}": (d, self.ratio * d) for d in self.damping}
        exact = {name: two_mode_critical(pair) for name, pair in pairs.items()}
        flutter = Flutter(self, progress, {name: two_mode(pair) for name, pair in pairs.items()}, "mu", exact, "μ", unit="-")
        return flutter.study({"damping": self.damping, "ratio": self.ratio})


@dataclass(frozen=True)
class ZieglerScene(FlutterScene):
    """Ziegler's pendulum under a follower load P, in the units m = l = k = 1."""

    damping: list[float] = key([0.0, 0.01, 0.2], "dashpots b in both joints, one model for each", unit="√(m l² k)", least=0,
                               distinct=True)
    between: list[float] = key([0.0, 3.0], "the range of the load", unit="k/l", form="[lo, hi]")

    def run(self, progress: Progress) -> Result:
        models = {f"b = {b:g}": ziegler(b) for b in self.damping}
        exact = {f"b = {b:g}": ziegler_critical(b) for b in self.damping}
        return Flutter(self, progress, models, "P", exact, "P l/k", unit="-").study({"damping": self.damping})
