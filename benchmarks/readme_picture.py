"""A picture of the first page: a brake's flutter diagram over friction, by one small model that is proved, and a mode that grows.

    python -m benchmarks readme-picture [--out DIR]

Lines are those of the small model, circles solutions of the full one. The mode is the small model's, expanded to the mesh.
Seconds are those of the processor; OMP_NUM_THREADS=1 makes them those of one thread. All of it takes some four minutes.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import femsub as fs
from benchmarks.pictures import save
from femsub.app.grammar import Scene
from femsub.components.pictures import PARTS, draw_solid, triad
from femsub.output import PAGE, draw_panel, legend_below, new_figure
from femsub.stability import flutter_chart


def figure(count: int = 141) -> Any:
    """Left frequencies, with the cells of the proof, above growth rates, at `count` values of μ; right a mode that grows."""
    brake = Scene.from_file("brake").models
    # the small model, its modes, and those of the full one at a few values; seconds before and after each
    band, mus, clock = brake.band, np.linspace(0.0, 0.7, count), [time.process_time()]
    small = fs.reduce(brake.full, fs.ParameterBox({"mu": (mus[0], mus[-1])}, band), contacts=brake.at({"mu": 0.0}))
    clock.append(time.process_time())
    found = [small.modes(mu=mu) for mu in mus]
    clock.append(time.process_time())
    full = {mu: fs.complex_modes(brake.full, brake.at({"mu": mu}), band=band).eigenvalues for mu in (0.2, 0.4, 0.6)}
    made, each, once = np.diff([*clock, time.process_time()]) / [1, count, len(full)]
    radius = max(np.max(one.error_bar / np.abs(one.eigenvalues)) for one in found)
    error = max(np.abs(small.modes(mu=mu).eigenvalues / one - 1).max() for mu, one in full.items())  # both have as many
    # the mode of the lowest frequency among those that grow at the last of these values
    mu, modes = max(full), small.modes(mu=max(full))
    at = min(modes.unstable, key=lambda k: modes.eigenvalues[k].imag)
    value = modes.eigenvalues[at]
    (_, (mesh, fields)), = brake.drawn(small.expand(modes.shapes[:, [at]])).items()
    shape = fields[..., 0] * np.exp(-1j * np.angle(fields.ravel()[np.abs(fields).argmax()]))
    drawn = new_figure(1.25 * PAGE, 6.2)
    axes = drawn.subplot_mosaic([["imag", "mode"], ["real", "mode"]], width_ratios=[1.2, 1])
    scale = draw_solid(axes["mode"], mesh, shape.real, {"contact": brake.marks["contact"]})
    drawn.colorbar(scale, ax=axes["mode"], label="|u| / max|u|  [-]", shrink=0.6)
    triad(axes["mode"])
    # the flutter diagram, where each branch that grows has a colour of its own, and where it begins to
    lost = fs.critical_value(small, None, "mu", between=(mus[0], mus[-1]), band=band).losses
    own, whole = f"small model up to {band[1] / (2 * np.pi):,.0f} Hz, {small.evidence}", f"full model, within {error:.0e} |λ|"
    chart = flutter_chart("", {own: fs.track(small, None, "mu", mus, band=band)}, {own: lost}, "", "", {whole: [*full.items()]})
    for part, unit, panel, linear in zip(("imag", "real"), (2 * np.pi, 1.0), chart.panels, ({}, {"y": 100.0}), strict=True):
        series, colours = [], iter(PARTS)
        for one, above in zip(panel.series, chart.panels[0].series, strict=True):
            look: dict[str, Any] = {"y": np.divide(one.y, unit), "size": min(one.size, 4.0)}
            if one.name == "a mode grows":
                x, y = next((x, y) for x, y in zip(above.x, above.y, strict=True) if np.isfinite(y))
                look |= {"name": f"{y / (2 * np.pi):,.0f} Hz, grows from μ = {x:.4f}", "legend": True, "colour": next(colours)}
            series.append(replace(one, **look))
        draw_panel(axes[part], replace(panel, series=series, levels=panel.levels[1:], linear=linear), [], {})
        axes[part].plot(mu, getattr(value, part) / unit, "*", ms=12, color="#e41a1c", zorder=4, label="mode on the right")
    # the cells
    for cell in small.cells:
        assert cell.contour and cell.contour.sides  # none is open
        (lo, hi), top = cell.ranges["mu"], cell.contour.sides[2] / (2 * np.pi)
        axes["imag"].plot([lo, lo, hi, hi], [0, top, top, 0], "k", lw=0.8, label=f"cell: {cell.number} λ, with conjugates")
        axes["imag"].text((lo + hi) / 2, top, f"{cell.number} λ", ha="center", va="bottom", fontsize=8)
    axes["imag"].set(title="frequencies", ylabel="Im λ / 2π  [Hz]", ylim=(0, 1.1 * top), xlim=mus[[0, -1]], xticklabels=[])
    axes["real"].set(title="growth rates, logarithmic beyond 100 1/s", ylabel="Re λ  [1/s]", xlabel="μ  [-]", xlim=mus[[0, -1]])
    axes["mode"].set_title(f"mode at the star: μ = {mu:g}, {value.imag / (2 * np.pi):,.0f} Hz, Re λ = {value.real:.3g} 1/s")
    legend_below(drawn, axes.values(), 3)
    drawn.suptitle(f"A disc brake of {len(small.V):,} DOF over its friction: one small model of {small.size} DOF for all μ\n"
                   f"number of λ {small.evidence} for all μ; each λ within {radius:.0e} |λ| of the full model (estimate)\n"
                   f"seconds of the processor: {made:.0f} to make, then {each:.2f} for each μ; full model: {once:.1f} for each μ")
    return drawn


def main(*, out: Path = Path("out/readme")) -> None:
    out.mkdir(parents=True, exist_ok=True)
    save(out / "brake-over-friction.png", figure)
