"""Draws the conference paper's figures 2 to 5 from femsub, for docs/gallery/paper.md and docs/tutorials/paper.md.

    python -m benchmarks paper-figures [--out out/paper] [figure-2 figure-3 figure-4 figure-5]

`python -m benchmarks report paper` puts them into docs/pictures.
Figure 5 follows three models in time and takes some ten seconds; the others take less than one each.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import femsub as fs
from benchmarks.pictures import draw_all
from femsub.app.figure_style import new_figure
from femsub.studies import look

LAW = fs.StribeckArctan(eps=1e-3)
BELT = fs.Belt(speed=0.19113, law=LAW)
SIZES = range(2, 11)  # DOF of the reduced models in Fig. 3b
SIZE = 5  # DOF of those in Figs. 3a, 4 and 5
END, STEP, WINDOW = 20000.0, 0.2, 400.0  # of Fig. 5: time, grid, length of a window
DECADES = 3  # of its scale
LEFT = -0.03  # end of the axis of Fig. 4


def models(belt: int, size: int = SIZE) -> dict[str, Any]:
    """The chain with the belt under a mass, full and reduced, with the paper's interface m1."""
    full = fs.chain(10, belt=belt)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)  # a belt outside of the interface is the paper's case
        return {"full": full, "craig-bampton": fs.reduce(full, fs.CraigBampton(size - 1)),
                "craig-chang": fs.reduce(full, fs.CraigChang(size - 1))}


def style(kind: str) -> dict[str, Any]:
    seen = look(kind)
    return {"color": seen.colour, "marker": seen.marker, "ms": 8 if kind == "full" else 5,
            "mfc": "none" if kind == "full" else seen.colour, "zorder": 2 if kind == "full" else 3}


def named(kind: str, model: Any) -> str:
    return f"{look(kind).label}, {model.size} DOF"


def figure_2() -> Any:
    """μ over the sliding speed for three ε."""
    side = np.concatenate([np.geomspace(1e-5, 0.05, 60), np.linspace(0.06, 1.0, 95)])
    v = np.concatenate([-side[::-1], [0.0], side])
    figure = new_figure(6.5, 4)
    axis = figure.subplots()
    for eps, shade in zip((1e-1, 1e-2, 1e-3), ("#9ecae1", "#4292c6", "#000000"), strict=True):
        axis.plot(v, fs.StribeckArctan(eps=eps).value(v), color=shade, label=f"ε = {eps:g}")
    axis.plot(BELT.speed, LAW.value(BELT.speed), "o", color="#c44e00", zorder=4,
              label=f"v0 = {BELT.speed:g}: μ' = {BELT.slope:.4f}")
    axis.set(xlabel="sliding speed v  [length/time]", ylabel="friction coefficient μ  [-]")
    axis.grid()
    axis.legend()
    figure.suptitle("Friction law for three ε, with the working point (the paper's Fig. 2)")
    return figure


def figure_3() -> Any:
    """Left (a): the critical slope over the belt's place; right (b): over the size. Below: deviation from the full model."""
    figure = new_figure(9.5, 6)
    (left, right), (below, beside) = figure.subplots(2, 2, sharex="col")
    beside.sharey(below)
    places = np.arange(1, 11)
    borders = {kind: np.array([float(fs.critical_slope(models(place)[kind])) for place in places])
               for kind in ("full", "craig-bampton", "craig-chang")}
    sizes = np.array(SIZES)
    full = borders["full"][1]
    for kind, found in borders.items():
        left.semilogy(places, -found, **style(kind), lw=1, label=named(kind, models(2)[kind]))
        if kind == "full":
            continue
        below.semilogy(places[1:], np.abs(found / borders["full"] - 1)[1:], **style(kind), lw=1)
        by_size = np.array([float(fs.critical_slope(models(2, size)[kind])) for size in sizes])
        right.plot(sizes, -by_size, **style(kind), lw=1, label=look(kind).label)
        beside.semilogy(sizes[:-1], np.abs(by_size / full - 1)[:-1], **style(kind), lw=1)
    right.axhline(-full, color="black", lw=1, ls="--", label=f"{look('full').label}: {-full:.6f}")
    left.set(title="(a) models of 5 DOF", ylabel="critical -dμ/dv  [time/length]")
    right.set(title="(b) belt under m2")
    below.set(xlabel="belt under mass number  [-]", ylabel="deviation from the full model  [-]", xticks=places)
    beside.set(xlabel="DOF of the reduced model  [-]", xticks=sizes)
    left.legend()
    right.legend()
    for axis in (left, right, below, beside):
        axis.grid()
    figure.suptitle("Critical slope over the belt's place and over the model's size (the paper's Fig. 3)")
    return figure


def figure_4() -> Any:
    """Eigenvalues with the belt under m2 and μ' = -0.2677, on the paper's axes."""
    figure = new_figure(6.5, 5.2)
    axis = figure.subplots()
    for kind, model in models(2).items():
        values = fs.complex_modes(model, BELT).eigenvalues
        outside = int((values.real < LEFT).sum())
        label = named(kind, model) + (f" ({outside} left of the axes)" if outside else "")
        axis.plot(values.real, values.imag, ls="none", **style(kind), label=label)
    axis.axvline(0, color="grey", lw=0.8)
    axis.set(xlim=(LEFT, 0.025), xlabel="Re λ  [1/time]", ylabel="Im λ  [rad/time]")
    axis.grid()
    figure.legend(loc="outside lower center", ncols=3)
    figure.suptitle("Eigenvalues with the belt under m2, dμ/dv = -0.2677 (the paper's Fig. 4)")
    return figure


def figure_5() -> Any:
    """Short-time spectra of the velocity under the belt, which is under m2."""
    from matplotlib.colors import LogNorm

    made = {}
    for kind, model in models(2).items():
        run = fs.transient(model, BELT, time=(0.0, END), step=STEP, impulse=1e-3)
        made[named(kind, model)] = fs.spectrogram(run.t, run.velocity("belt"), WINDOW)
    top = max(float(found.amplitude.max()) for found in made.values())
    figure = new_figure(10.5, 4)
    axes = figure.subplots(1, len(made), sharey=True)
    for axis, (name, found) in zip(axes, made.items(), strict=True):
        inside = found.omega <= 2.5
        picture = axis.pcolormesh(found.t, found.omega[inside], np.maximum(found.amplitude[inside], top / 10**DECADES),
                                  norm=LogNorm(top / 10**DECADES, top), shading="nearest", cmap="magma", rasterized=True)
        axis.set(title=name, xlabel="t  [time]", xticks=[0, 10000])
    axes[0].set_ylabel("ω  [rad/time]")
    figure.colorbar(picture, ax=list(axes), label="velocity of m2  [length/time]")
    figure.suptitle("Spectra over time of the velocity under the belt (the paper's Fig. 5)")
    return figure


FIGURES: dict[str, Callable[[], Any]] = {"figure-2": figure_2, "figure-3": figure_3, "figure-4": figure_4, "figure-5": figure_5}


def main(names: tuple[str, ...] = (), *, out: Path = Path("out/paper")) -> None:
    draw_all(FIGURES, names, out)
