"""Draws the pictures of docs/tutorials/. Each is made of the same model as its page.

    python -m benchmarks tutorial-figures [--out out/tutorials] [disc ...]

`python -m benchmarks report tutorials` puts them into docs/pictures.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import chdir, redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

import femsub as fs
from benchmarks.attacks.common import dense
from benchmarks.pages import blocks_of
from benchmarks.pictures import draw_all
from femsub.components.pictures import shapes_figure
from femsub.output import Chart, Level, Panel, Series, draw, look, new_figure

ROOT = Path(__file__).resolve().parent.parent


def from_page(page: str, *names: str) -> list[Any]:
    """What the blocks of a tutorial define by these names: they are run up to the one that defines the last."""
    known: dict[str, Any] = {}
    blocks = iter(blocks_of((ROOT / "docs" / "tutorials" / f"{page}.md").read_text(encoding="utf-8")))
    with chdir(ROOT), redirect_stdout(StringIO()):
        while not known.keys() >= set(names):
            exec(next(blocks).text, known)
    return [known[name] for name in names]


def disc() -> Any:
    """The mode of the disc that grows fastest, from the full model and from 22 DOF."""
    mesh, full, belt, band, reduced = from_page("disc", "mesh", "disc", "belt", "band", "rom")
    fields, titles = [], []
    for name, model in (("full", full), ("Craig-Chang", reduced)):
        found = fs.complex_modes(model, belt, band=band)
        worst = found.eigenvalues.real.argmax()
        shape = found.shapes[:, worst] if model is full else reduced.expand(found.shapes[:, worst])
        shape = shape * np.exp(-1j * np.angle(shape[np.abs(shape).argmax()]))  # the largest displacement is real
        field = fs.displacements(mesh, full.dofs, shape.real)
        fields.append(field / np.linalg.norm(field, axis=1).max())
        value = found.eigenvalues[worst]
        titles.append(f"{name}, {model.size} DOF: {value.imag / 2 / np.pi:.1f} Hz, growth {value.real:.3f} 1/s")
    marks = {"contact": mesh.nodes("pad"), "interface": mesh.nodes("guides")}
    return shapes_figure(mesh, np.stack(fields, axis=-1), titles, "", marks)


def matrices() -> Any:
    """What a force at the tip moves it by, over the frequency: the full beam and the reduced one, and the difference."""
    full, band, reduced = from_page("matrices", "beam", "band", "rom")
    hertz = np.linspace(1.0, 3600.0, 1500)
    series, responses = [], {}
    for kind, model in (("full", full), ("craig-bampton", reduced)):
        M, K, w = dense(model.M), dense(model.K), model.port("belt").ravel()
        responses[kind] = np.array([w @ np.linalg.solve(K * (1 + 0.01j) - (2 * np.pi * at) ** 2 * M, w) for at in hertz])
        series.append(Series(f"{look(kind).label}, {model.size} DOF", hertz, np.abs(responses[kind]), kind, "solid", "",
                             "#999999" if kind == "full" else "", width=3.5 if kind == "full" else 1.4))
    error = np.abs(responses["craig-bampton"] / responses["full"] - 1)
    end = [Level(band[1] / 2 / np.pi, "end of the band", colour="#808080")]
    return draw(Chart("matrices", "belt's port at the tip; 1 % structural damping", [
        Panel(series, "f  [Hz]", "|wᵀu| / force  [m/N]", logs="y", levels=end, share={"x": "f"}),
        Panel([Series("error", hertz, error, "craig-bampton", "solid", "", legend=False)], "f  [Hz]", "relative error  [-]",
              logs="y", levels=end, share={"x": "f"})], height=2.3))


def how_many_modes() -> Any:
    """Errors of HCB and CC over the size, and what a tolerance chooses for HCB."""
    full, belt, band = from_page("how-many-modes", "full", "belt", "band")
    studies = [fs.study(full, [method(count) for count in (13, 14, 16, 18, 21, 25, 30, 36, 43, 52, 62)], band, contacts=belt,
                        repeats=1).rows for method in (fs.CraigBampton, fs.CraigChang)]
    chosen = [Level(fs.reduce(full, fs.CraigBampton(band=band, tol=tol), contacts=belt).size, f"tol={tol:g}", line=line,
                    colour=look("craig-bampton").colour) for tol, line in ((1e-2, "dot"), (1e-3, "dash"), (1e-4, "solid"))]
    return draw(Chart("how-many-modes", "Errors over the size, and what a tolerance chooses for Craig-Bampton", [
        Panel([Series(look(rows[0].method).label, [row.size for row in rows], [getattr(row, key) for row in rows],
                      rows[0].method, "solid", width=1.0) for rows in studies],
              "DOF of the reduced model  [-]", "relative error  [-]", title, "y", chosen, {"y": (1e-16, 1e1)},
              share={"x": "size", "y": "error"})
        for key, title in (("error_frequency", "error of ω"), ("error_growth", "error of Re λ"),
                           ("error_critical", "error of the critical slope"))], 3, height=3.2, columns=5))


def superelements() -> Any:
    """Errors of the joined superelements' frequencies: of the system against Nastran, and of three reduced ones against it."""
    system, band = from_page("superelements", "system", "band")
    theirs = np.sqrt(np.loadtxt(ROOT / "meshes" / "nastran" / "eigenvalues.txt")[6:])
    ours = fs.normal_modes(system, count=48).frequencies[6:]
    series = [Series(f"joined, {system.size} DOF, against Nastran", theirs, np.abs(ours / theirs - 1), marker=".")]
    levels = [Level(band[1], "end of the band", colour="#555555")]
    for tol, colour in ((1e-2, "#882255"), (1e-3, "#cc6677"), (1e-4, "#ddcc77")):
        small = fs.reduce(system, dict.fromkeys(system.parts, fs.CraigBampton(band=band, tol=tol)))
        error = np.abs(fs.normal_modes(small, count=10).frequencies[6:] / ours[:10] - 1)
        series.append(Series(f"tol={tol:g}, {small.size} DOF", ours[:10], error, "", "solid", "s", colour, 4.0, 1.0))
        levels.append(Level(tol, "", "y", "dot", colour))
    return draw(Chart("superelements", "", [Panel(series, "frequency ω  [rad/s]", "relative error of ω  [-]", "", "xy", levels,
                                                  {"y": (1e-14, 1e1)})], height=3.6, columns=3))


def beyond_the_border() -> Any:
    """Limit cycles over the belt's speed, full and reduced, and runs in time with rising and falling speed."""
    full, reduced, belt = from_page("beyond-the-border", "full", "rom", "belt")
    series = list[Series]()
    for kind, model in (("full", full), ("craig-chang", reduced)):
        found = fs.branch(model, belt, "speed", between=(0.4, 1.0))
        turn, name = int(np.argmax(found.values)), f"{look(kind).label}, {model.size} DOF: stable cycle"
        style: dict[str, Any] = {"colour": "#a6a6a6", "width": 4.0} if kind == "full" else {"width": 1.5}
        series += [Series(name, found.values[turn:], found.rms[turn:], kind, "solid", "", **style),
                   Series("unstable cycle", found.values[:turn + 1], found.rms[:turn + 1], kind, "dash", "", **style)]
    assert found.hopf is not None
    hopf, fold = found.hopf.value, found.special[0]
    series += [Series("steady sliding, stable", [hopf, 0.75], [0, 0], "full", "solid", "", width=1.5),
               Series("steady sliding, unstable", [0.4, hopf], [0, 0], "full", "dash", "", width=1.5)]
    speeds = np.arange(0.47, 0.711, 0.02)
    for order, marker, name in ((speeds, "^", "rising"), (speeds[::-1], "v", "falling")):
        levels, last = [], None
        for speed in order:
            begin: dict[str, Any] = {"impulse": 1.0} if last is None else {"start": last}
            run = fs.transient(full, replace(belt, speed=float(speed)), time=(0.0, 40000.0), record_from=39000.0, **begin)
            last = run.final
            levels.append(fs.rms(run.t, run.velocity("belt")))
        series.append(Series(f"in time, full, {name} speed", order, levels, "", "", marker, "#555555", 8.0, hollow=True))
    series += [Series(f"{name} {value:.3f}", [value], [height], "", "", marker, "#c44e00", 10.0)
               for name, value, height, marker in (("Hopf point", hopf, 0.0, "*"), ("fold", fold.value, fold.rms, "D"))]
    return draw(Chart("beyond-the-border", "", [Panel(
        series, "belt speed v0  [length/time]", "rms of the speed at the belt  [length/time]", limits={"x": (0.44, 0.73)})],
        height=4.2, columns=2))


def flutter() -> Any:
    """A block on an inclined arm: its modes over μ, and growth rates over the arm's angle and μ."""
    on_arm, rubbing, full, small = from_page("flutter", "on_arm", "rubbing", "block", "small")
    figure = new_figure(10.5, 5)
    grid = figure.add_gridspec(2, 2, width_ratios=[1, 1.25])
    upper, lower = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0])
    chart = figure.add_subplot(grid[:, 1])
    for kind, model, steps in (("full", full, np.linspace(0.0, 1.0, 11)), ("", small, np.linspace(0.0, 1.0, 201))):
        at, im, re = [], [], []
        for mu in steps:
            values = fs.complex_modes(model, replace(rubbing, mu=float(mu))).eigenvalues
            values = values[(values.imag > 0) & (values.imag < 2 * np.pi * 6000)]
            at += [mu] * len(values)
            im += list(values.imag / 2 / np.pi)
            re += list(values.real)
        style = {"marker": "o", "ms": 7, "mfc": "none", "mec": "black"} if kind else {"marker": ".", "ms": 3, "color": "#c44e00"}
        name = f"full, {model.size} DOF" if kind else f"contact modes, {model.size} DOF"
        upper.plot(at, im, ls="none", label=name, **style)
        lower.plot(at, re, ls="none", **style)
    upper.set(ylabel="Im λ / 2π  [Hz]", title="arm at -30°")
    upper.legend()
    lower.set(xlabel="friction coefficient μ  [-]", ylabel="Re λ  [1/s]")
    for axis in (upper, lower):
        axis.grid()
    angles, friction = np.arange(-80.0, 80.1, 2.0), np.linspace(0.0, 1.5, 61)
    growth = np.empty((len(friction), len(angles)))
    for column, degrees in enumerate(angles):
        model = fs.reduce(on_arm(degrees), fs.ContactModes(6, contacts=rubbing))
        for row, mu in enumerate(friction):
            growth[row, column] = max(fs.complex_modes(model, replace(rubbing, mu=float(mu))).growth, 0.0)
    shown = np.where(growth > 1.0, growth, np.nan)
    picture = chart.pcolormesh(angles, friction, shown, shading="nearest", cmap="viridis_r", rasterized=True)
    above = np.linspace(34.0, 80.0, 100)
    chart.plot(above, 1 / np.tan(np.radians(above)), "--", color="#c44e00", label="self-locking, μ = 1/tan(angle)")
    chart.set(xlabel="angle of the arm  [°]", ylabel="friction coefficient μ  [-]", title="growth rate; white: nothing grows",
              ylim=(0, 1.5))
    for place in (-42, 6):
        chart.text(place, 1.25, "flutter", color="white" if place < 0 else "black", ha="center", rotation=90 if place > 0 else 0)
    chart.text(62, 1.25, "divergence", color="white", ha="center")
    chart.legend(loc="lower center")
    chart.grid(alpha=0.3)
    figure.colorbar(picture, ax=chart, label="largest Re λ  [1/s]")
    return figure


FIGURES: dict[str, Callable[[], Any]] = {"disc": disc, "matrices": matrices, "superelements": superelements,
                                       "how-many-modes": how_many_modes, "beyond-the-border": beyond_the_border,
                                       "flutter": flutter}


def main(names: tuple[str, ...] = (), *, out: Path = Path("out/tutorials")) -> None:
    draw_all(FIGURES, names, out)
