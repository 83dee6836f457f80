"""What each reduction method keeps: the shapes of its basis, drawn for one beam, and its errors on that beam.

    python -m benchmarks method-pictures [--out DIR]

The beam is of steel, 1 m long, free, and touched at three points (at nine for interface modes). Each column of the basis V is a
curve, scaled to the same height. Dots are the points, squares the further masters. Curves without mass are dashed. The pages in
docs/methods show the pictures and tables of the errors; tests/test_method_pages.py compares the tables with what `error` and
`flutter_error` find. `python -m benchmarks report method-pictures` puts the pictures into docs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import femsub as fs
from benchmarks.pictures import draw_all
from femsub.checks import Array
from femsub.output import new_figure

STIFFNESS = 48 * 2.1e11 * 1e-8  # k₀ = 48 EI/L³, that of the beam on two supports against a force in the middle
THREE = {"left": [0], "middle": [32], "right": [80]}
NINE = {str(number): [10 * number] for number in range(9)}
COLOURS = {"rigid": "#7a7a7a", "free": "#0067a5", "fixed-interface": "#0067a5", "real": "#0067a5", "interface mode": "#1b7837"}
STATIC = "#c44e00"
METHODS: dict[str, tuple[Any, ...]] = {  # on the pages of these names
    "guyan": (fs.Guyan(2),), "craig-bampton": (fs.CraigBampton(4), fs.Hurty(0)), "craig-chang": (fs.CraigChang(3),),
    "macneal": (fs.MacNeal(3),), "rubin": (fs.Rubin(3),), "herting": (fs.Herting(3),),
    "dual-craig-bampton": (fs.DualCraigBampton(3),)}
NAMES = {"constraint": "constraint modes", "fixed-interface": "fixed-interface modes", "rigid": "rigid-body modes",
         "free": "free modes", "residual attachment": "residual attachment modes", "interface": "interface displacements",
         "interface force": "interface forces", "free and inertia relief": "interior shapes", "real": "real modes",
         "master": "of further masters", "friction response": "friction responses", "interface mode": "interface modes"}


def part(interface: dict[str, list[int]] = THREE, feet: bool = False) -> fs.Substructure:
    """The beam: 40 elements, 82 DOF; deflections of the points are its interface. With feet, ports move and turn the points."""
    beam, unit = fs.beam(1.0, 40, E=2.1e11, I=1e-8, rho=7850.0, A=1e-4), np.eye(82)
    down = [dof for dofs in interface.values() for dof in dofs]
    ports = {"down": unit[:, down], "turn": unit[:, [dof + 1 for dof in down]]}
    return fs.Substructure(beam.M, beam.K, interface=interface, ports=ports if feet else {}, name="beam")


@dataclass(frozen=True)
class Feet:
    """Feet under the three points: a spring k for each, and the friction at its end, which turns the beam by μ k u · length."""

    mu: float = 0.5
    length: float = 0.2
    ports: ClassVar[tuple[str, ...]] = ("down", "turn")

    def linearised(self, model: fs.Substructure) -> tuple[None, Array]:
        return None, STIFFNESS * np.kron([[1.0, 0.0], [self.mu * self.length, 0.0]], np.eye(3))


@cache
def exact(ratio: float, count: int, nine: bool) -> Array:
    """The lowest frequencies of the full beam on springs."""
    return fs.normal_modes(on_springs(part(NINE if nine else THREE), ratio), count=count).frequencies


def on_springs(model: fs.Substructure, ratio: float) -> fs.System:
    """The beam with springs ratio · k₀ under its points; without end they hold it."""
    return fs.couple({"beam": model}, [
        fs.Rigid(("beam", name), "ground") if np.isinf(ratio) else fs.Spring(("beam", name), stiffness=ratio * STIFFNESS)
        for name in model.sets])


def error(method: fs.CraigBampton, ratio: float, count: int = 5, second: fs.InterfaceModes | None = None) -> float:
    """The largest relative error of as many frequencies; with a second method, of the beam touched at nine points."""
    small = fs.reduce(part(NINE if second else THREE), method)
    system: fs.Substructure = on_springs(small, ratio)
    found = fs.normal_modes(fs.reduce(system, second) if second else system, count=count).frequencies
    return float(np.abs(found / exact(ratio, count, bool(second)) - 1).max())


def flutter_error(modes: int, friction: bool, mu: float, count: int = 5) -> float:
    """The largest relative error of the lowest eigenvalues λ of the beam on feet, by contact modes."""
    full, feet = part(feet=True), Feet(mu)
    small = fs.reduce(full, fs.ContactModes(modes, contacts=feet, friction=friction))
    true, found = (fs.complex_modes(model, feet, count=2 * count).eigenvalues for model in (full, small))
    return float((np.abs(found[:, None] - true).min(axis=0) / np.abs(true)).max())


def models(page: str) -> list[fs.ReducedSubstructure]:
    """What is drawn on a page."""
    if page == "contact-modes":
        return [fs.reduce(part(feet=True), fs.ContactModes(4, contacts=Feet()))]
    if page == "interface-modes":
        many = fs.reduce(part(NINE), fs.CraigBampton(0))
        return [many, fs.reduce(many, fs.InterfaceModes(3))]
    return [fs.reduce(part(), method) for method in METHODS[page]]


def kinds(model: fs.ReducedSubstructure) -> tuple[str, ...]:
    """The label of each column, where Guyan's further masters have one of their own."""
    masters = len(model.kinds) - len(THREE) if model.method.startswith("Guyan") else 0
    return model.kinds[:len(model.kinds) - masters] + ("master",) * masters


def figure(page: str) -> Any:
    """A panel for each kind of columns of each model of a page."""
    shown = models(page)
    points = [dofs[0] // 2 for dofs in (NINE if page == "interface-modes" else THREE).values()]
    panels = [(model, kind) for model in shown for kind in dict.fromkeys(kinds(model))]
    most = max(kinds(model).count(kind) for model, kind in panels)
    drawn = new_figure(8.0, 0.75 + 0.36 * most)
    x = np.linspace(0.0, 1.0, 41)
    for axis, (model, kind) in zip(drawn.subplots(1, len(panels), squeeze=False, sharey=True)[0], panels, strict=True):
        columns = [j for j, one in enumerate(kinds(model)) if one == kind]
        held = [node for node in np.flatnonzero(np.count_nonzero(np.abs(model.V[::2]) > 1e-9, axis=1) == 1) if node not in points]
        for row, j in enumerate(columns):
            shape = model.V[::2, j]
            shape = shape / shape[np.abs(shape).argmax()]
            y = 0.75 * shape - 2 * row
            axis.plot(x, 0 * x - 2 * row, color="0.8", lw=0.8)
            axis.plot(x, y, color=COLOURS.get(kind, STATIC), lw=1.6, ls="--" if model.M[j, j] == 0 else "-",
                      label=f"{NAMES[kind]} {row + 1}")
            axis.plot(x[points], y[points], "o", color="black", ms=3.5)
            axis.plot(x[held], y[held], "s", color="black", ms=3.5)
        hurty = "Hurty: " if model.method.startswith("Hurty") else ""
        axis.set(title=hurty + NAMES[kind], ylim=(-2 * most + 0.9, 1.1), xlim=(-0.03, 1.03))
        axis.axis("off")
    return drawn


FIGURES = {page: partial(figure, page) for page in (*METHODS, "contact-modes", "interface-modes")}


def main(names: tuple[str, ...] = (), *, out: Path = Path("out/method-pictures")) -> None:
    draw_all(FIGURES, names, out)
