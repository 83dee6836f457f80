"""Flutter over a parameter: critical values beside closed forms, modes tracked, the flutter diagram."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from femsub import Affine, CriticalValue, Tracked, critical_value, track
from femsub.app.keys import key
from femsub.app.scene import Progress, Result, Scene, first_of, run_outputs
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


def flutter(scene: FlutterScene, models: Mapping[str, Affine], parameter: str, exact: Mapping[str, float], label: str,
            data: dict[str, Any], progress: Progress, band: tuple[float, float] | None = None,
            text: Sequence[str] = (), unit: str = "") -> Result:
    """Computes what `scene.outputs` names, for each of the models by its name; `exact` are the critical values that are known."""
    between = (scene.between[0], scene.between[1])

    @cache
    def tracked(name: str) -> Tracked:
        progress(f"{scene.name}: modes tracked, {name}")
        modes = track(models[name], None, parameter, np.linspace(*between, scene.points), band=band)
        if not modes.eigenvalues.size:
            raise InputError(f"{name} has no mode from {modes.band[0]:g} to {modes.band[1]:g} rad/time anywhere in the range. "
                             "Give another band")
        return modes

    found: dict[str, CriticalValue] = {}
    for name, model in models.items():
        progress(f"{scene.name}: critical value, {name}")
        found[name] = critical_value(model, None, parameter, between=between, band=band)

    def compute(output: str) -> Result:
        if output == "critical-value":
            return _critical(found, exact, label, between)
        return _diagram({name: tracked(name) for name in models},
                        {name: [*item.losses, *item.regains] for name, item in found.items()}, label, scene.name, unit)

    head = f"{scene.name}: {label} from {between[0]:g} to {between[1]:g}"
    head += f", modes from {span(band)}" if band else ""
    return run_outputs(scene.outputs, compute, {**data, "between": scene.between}, [head, *text])


def _critical(found: Mapping[str, CriticalValue], exact: Mapping[str, float], label: str,
              between: tuple[float, float]) -> Result:
    rows: list[dict[str, Any]] = []
    for name, item in found.items():
        located = any(one.value == item.value for one in item.losses)
        if item.growing or not (located or (item.regains and np.isinf(item.value))):
            where = "lost at the begin" if item.growing else "never lost" if np.isinf(item.value) else "lost at a place not known"
            rows.append({"model": name, "stability": where, "value": None, "kind": "", "omega": None, "exact": exact.get(name),
                         "error": None, "width": None, "evidence": item.evidence})
        for what, crossings in (("lost", item.losses), ("regained", item.regains)):
            for one in crossings:
                first = what == "lost" and one is item.losses[0] and name in exact and located
                rows.append({"model": name, "stability": what, "value": one.value, "kind": one.kind, "omega": one.omega,
                             "exact": exact[name] if first else None, "error": abs(one.value - exact[name]) if first else None,
                             "width": one.width, "evidence": item.evidence})
    columns = ["model", column("stability", form="s"), column("value", label, "s", cell=_digits), column("kind", form="s"),
               "omega", *([column("exact", "closed form", ".10f"), column("error", "error", ".0e")] if exact else []), "evidence"]
    left = [f"{name}: not excluded are further crossings in "
            f"{first_of([f'{lo:.9g} to {hi:.9g}' for lo, hi in item.open], 'intervals')}."
            for name, item in found.items() if item.open]
    places = {name: [list(one) for one in item.open] for name, item in found.items()}
    lost, decides = sum(row["stability"] == "lost" for row in rows), []
    for row in rows:
        at = "" if row["value"] is None else f" at {row['value']:.8g} by {row['kind']}"
        closed = "" if row["value"] is None or row["exact"] is None else f" The closed form gives {row['exact']:.8g}."
        decides.append(f"{row['model']}: stability is {row['stability']}{at} ({row['evidence']}).{closed}")
    return Result({"critical-value": rows, "not_excluded": places}, [
        f"Where stability is lost, over {label}:", Table("critical-value", rows, columns, "Critical values"), *left,
        Verdict(decides, ["Values of the parameter outside the range were not searched."], "found",
                f"{lost} loss{'es' * (lost != 1)} of stability from {between[0]:g} to {between[1]:g}. The model is small as "
                "it is, so that nothing is reduced.", "Where is stability lost?")])


def _digits(row: Mapping[str, Any]) -> str | None:
    """Up to 10 places behind the point, none of them below the width."""
    value, width = row["value"], row["width"]
    return None if value is None else f"{value:.{min(max(-int(np.floor(np.log10(width or 1e-10))), 0), 10)}f}"


def _diagram(tracks: Mapping[str, Tracked], critical: Mapping[str, Sequence[Crossing]], label: str, title: str,
             unit: str) -> Result:
    branches, meetings = branch_rows(tracks), meeting_rows(tracks)
    columns = ["model", column("kind", "meeting", "s"), column("value", label, ".8g"), column("branches", form="d"),
               column("growth", form=".6f"), column("omega", "Im λ", ".6f"), column("gap", form=".0e"),
               column("condition", form=".0e"), "error_bar"]
    return Result({"branches": branches, "meetings": meetings}, [
        "Modes tracked:", *(f"{name}: {item!r}".replace(" over mu ", " over μ ") for name, item in tracks.items()),
        Table("branches", branches, title=f"Branches over {label}"),
        Table("meetings", meetings, columns if meetings else (), "Where modes meet", keys=2),
        flutter_chart("flutter-diagram", tracks, critical, f"{label}  [{unit}]" if unit else label, title)])


def branch_rows(tracks: Mapping[str, Tracked]) -> list[dict[str, Any]]:
    """Rows of a table: each branch at each value asked for."""
    return [{"model": name, item.parameter: float(item.values[i]), "branch": j, "growth": float(value.real),
             "omega": float(value.imag), "error_bar": float(item.error_bar[i, j]), "grows": bool(item.growing[i, j])}
            for name, item in tracks.items() for i in np.flatnonzero(item.asked)
            for j, value in enumerate(item.eigenvalues[i]) if not np.isnan(value)]


def meeting_rows(tracks: Mapping[str, Tracked]) -> list[dict[str, Any]]:
    """Rows of a table: each meeting of two branches."""
    return [{"model": name, "kind": one.kind, "value": one.value, "width": one.width, "branches": list(one.branches),
             "growth": one.eigenvalue.real, "omega": one.eigenvalue.imag, "gap": one.gap,
             "condition": one.condition if np.isfinite(one.condition) else None,
             "error_bar": one.error_bar if np.isfinite(one.error_bar) else None}
            for name, item in tracks.items() for one in item.meetings]
