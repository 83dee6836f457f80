"""Draws the conference paper's figures 2 to 5 from femsub, for docs/gallery/paper.md and docs/tutorials/paper.md.

    python -m benchmarks paper-figures [--out out/paper] [figure-2 figure-3 figure-4 figure-5]

`python -m benchmarks report paper` puts them into docs/pictures.
Figure 5 follows three models in time and takes some ten seconds; the others take less than one each.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

import femsub as fs
from benchmarks.pictures import draw_all
from femsub.app.figure_style import draw
from femsub.studies import friction_chart, look, spectrogram_chart
from femsub.studies.charts import Chart, Level, Panel, Series

SPEED = 0.19113
BELT = fs.Belt(speed=SPEED, law=fs.StribeckArctan(eps=1e-3))
SIZE = 5  # DOF of the reduced models but in Fig. 3b
LEFT = -0.03  # end of the axis of Fig. 4


def models(belt: int, size: int = SIZE) -> dict[str, Any]:
    """The chain with the belt under a mass, full and reduced, with the paper's interface m1."""
    full = fs.chain(10, belt=belt)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)  # a belt outside of the interface is the paper's case
        return {"full": full, "craig-bampton": fs.reduce(full, fs.CraigBampton(size - 1)),
                "craig-chang": fs.reduce(full, fs.CraigChang(size - 1))}


def marks(kind: str, x: Any, y: Any, line: str = "solid", about: str = "") -> Series:
    """Of a kind of model; small ones on the hollow marks of the full model."""
    full = kind == "full"
    return Series(look(kind).label + about, x, y, kind, line, size=8.0 if full else 5.0, hollow=full)


def figure_2() -> Any:
    """μ over the sliding speed for three ε."""
    side = np.concatenate([np.geomspace(1e-5, 0.05, 60), np.linspace(0.06, 1.0, 95)])
    v = np.concatenate([-side[::-1], [0.0], side])
    curves = [{"law": "arctan", "eps": eps, "value": fs.StribeckArctan(eps=eps).value(v)} for eps in (1e-1, 1e-2, 1e-3)]
    titles = {"arctan": "with the working point (the paper's Fig. 2)"}
    return draw(friction_chart(v, curves, titles, SPEED, BELT.slope or 0.0))


def figure_3() -> Any:
    """Left (a): the critical slope over the belt's place; right (b): over the size. Below: deviation from the full model."""
    places, sizes = np.arange(1, 11), np.arange(2, 11)
    by_place = {kind: np.array([float(fs.critical_slope(models(place)[kind])) for place in places])
                for kind in ("full", "craig-bampton", "craig-chang")}
    full = by_place["full"]
    by_size = {kind: np.array([float(fs.critical_slope(models(2, size)[kind])) for size in sizes])
               for kind in ("craig-bampton", "craig-chang")}
    slope, deviation = "critical -dμ/dv  [time/length]", "deviation from the full model  [-]"
    belt, size = "belt under mass number  [-]", "DOF of the reduced model  [-]"
    return draw(Chart("figure-3", "Critical slope over the belt's place and over the model's size (the paper's Fig. 3)", [
        Panel([marks(kind, places, -found) for kind, found in by_place.items()], belt, slope, f"(a) models of {SIZE} DOF", "y",
              share={"x": "place"}),
        Panel([marks(kind, sizes, -found) for kind, found in by_size.items()], size, slope, "(b) belt under m2",
              levels=[Level(-full[1], f"full: {-full[1]:.6f}", "y")], share={"x": "size"}),
        Panel([marks(kind, places[1:], np.abs(by_place[kind] / full - 1)[1:]) for kind in by_size], belt, deviation, "", "y",
              share={"x": "place", "y": "deviation"}),
        Panel([marks(kind, sizes[:-1], np.abs(found / full[1] - 1)[:-1]) for kind, found in by_size.items()], size, deviation,
              "", "y", share={"x": "size", "y": "deviation"})], 2, height=2.6))


def figure_4() -> Any:
    """Eigenvalues with the belt under m2 and μ' = -0.2677, on the paper's axes."""
    series = []
    for kind, model in models(2).items():
        values = fs.complex_modes(model, BELT).eigenvalues
        outside = int((values.real < LEFT).sum())
        about = f", {model.size} DOF" + f" ({outside} left of the axes)" * (outside > 0)
        series.append(marks(kind, values.real, values.imag, "", about))
    return draw(Chart("figure-4", "Eigenvalues with the belt under m2, dμ/dv = -0.2677 (the paper's Fig. 4)", [Panel(
        series, "Re λ  [1/time]", "Im λ  [rad/time]", levels=[Level(0.0, line="solid", colour="#808080")],
        limits={"x": (LEFT, 0.025)})], width=0.8, height=4.2))


def figure_5() -> Any:
    """Short-time spectra of the velocity under the belt, which is under m2."""
    made = []
    for kind, model in models(2).items():
        run = fs.transient(model, BELT, time=(0.0, 20000.0), step=0.2, impulse=1e-3)
        made.append((SimpleNamespace(kind=kind, model=model), fs.spectrogram(run.t, run.velocity("belt"), 400.0)))
    return draw(spectrogram_chart(made, 2.5))


FIGURES: dict[str, Callable[[], Any]] = {"figure-2": figure_2, "figure-3": figure_3, "figure-4": figure_4, "figure-5": figure_5}


def main(names: tuple[str, ...] = (), *, out: Path = Path("out/paper")) -> None:
    draw_all(FIGURES, names, out)
