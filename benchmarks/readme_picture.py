"""The README's picture: a brake's unstable mode, beside the errors of reduced models over their run time.

    python -m benchmarks readme-picture --brake DIR [--out DIR]

DIR holds a run of the scene brake. The mode is computed anew, by the full model in a narrow band around it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.pictures import NUMBERS, save, shown
from femsub import complex_modes
from femsub.app.figure_style import PAGE, draw_panel, label_points, legend_below, new_figure
from femsub.app.figures import draw_solid, triad
from femsub.app.scenes.brake import Brake, BrakeScene
from femsub.app.scenes.joined_parts import by_kind
from femsub.studies.charts import Level, Panel, Series

NAME = "brake-mode-and-error.png"
PANEL = "growth rates Re λ"
WIDE = 1e-3  # of ω, around the mode


def disc_mode(told: Mapping[str, Any]) -> Mapping[str, Any]:
    """The unstable mode in which the disc has the largest share."""
    return max(told["unstable"], key=lambda row: row["energy_disc"])


def errors(told: Mapping[str, Any]) -> Panel:
    """A panel of the run's error against run time, with the DOF beside the filled marks."""
    chart = next(one for one in told["charts"] if one["name"] == "error-time")
    plain = next(panel for place in chart["places"] for panel in place["panels"] if panel["title"] == PANEL)
    series = []
    for one in plain["series"]:
        given = {key: value for key, value in one.items() if key not in ("hover", "x", "y")}
        known = dict(one["hover"])
        labels = [f"{size:.0f}" for size in known["DOF"]] if one["legend"] and "DOF" in known else ()
        x, y = (np.array(one[key], dtype=float) for key in "xy")
        series.append(Series(x=x, y=y, labels=labels, **given))
    return Panel(series, plain["x"], plain["y"], "error of the growth rates against run time", plain["logs"],
                 [Level(**level) for level in plain["levels"]], rounding=True)


def figure(told: Mapping[str, Any]) -> Any:
    """Left the mode with contact and outline, right the errors."""
    row, mu = disc_mode(told), told["unstable"][0]["mu"]
    brake = Brake(BrakeScene(size=told["inputs"]["size"]), lambda _: None)
    omega = row["omega"]
    modes = complex_modes(brake.system, brake.contacts(mu), band=((1 - WIDE) * omega, (1 + WIDE) * omega))
    at = int(np.argmin(np.abs(modes.eigenvalues - complex(row["growth"], omega))))
    (_, (mesh, fields)), = by_kind(brake.system, brake.meshes, modes.shapes[:, [at]]).items()
    shape = fields[..., 0]
    shape = (shape * np.exp(-1j * np.angle(shape.ravel()[np.abs(shape).argmax()]))).real
    drawn = new_figure(1.25 * PAGE, 4.1)
    left, right = drawn.subplots(1, 2, width_ratios=[1.15, 1])
    scale = draw_solid(left, mesh, shape, {"contact": brake.contact_nodes})
    drawn.colorbar(scale, ax=left, label="|u| / max|u|  [-]", shrink=0.6, location="left")
    triad(left)
    left.set_title(f"unstable mode of the full model at μ = {mu:g}: {row['hertz']:.0f} Hz, Re λ = {row['growth']:.3g} 1/s")
    panel = errors(told)
    labels = draw_panel(right, panel, [value for one in panel.series for value in one.y], {})
    right.set(title=panel.title, xlabel=panel.x, ylabel="largest error over |λ|  [-]")
    legend_below(drawn, (left, right), 4)
    drawn.suptitle(f"A disc brake of {told['size']:,} DOF, and reduced models of it\n"
                   "filled: to solve once; hollow: to reduce and to solve; numbers: DOF")
    label_points(drawn, labels)
    return drawn


def main(*, brake: Path, out: Path = Path("out/readme")) -> None:
    told = json.loads((brake / "results.json").read_text(encoding="utf-8"))
    out.mkdir(parents=True, exist_ok=True)
    save(out / NAME, lambda: figure(told))
    rows = [{"mode": disc_mode(told)["hertz"], "growth": disc_mode(told)["growth"]},
            *(one for one in shown(told, "error-time") if one["panel"] == PANEL)]
    (out / NUMBERS).write_text(json.dumps({NAME: rows}), encoding="utf-8")
