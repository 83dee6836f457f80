"""The README's picture: the public brake M0 over the speed of its disc, beside the eigenvalues that its authors' program printed.

    python -m benchmarks public-brake-picture FOLDER [--out DIR]

FOLDER has the matrices (github.com/nae9on/BrakeSqueal0.1, data/5koref1), which are no part of femsub. Lines are those of one
small model, circles what the notebook of that program printed, to four digits (benchmarks/data/public-brake.json). Seconds are
those of the processor; OMP_NUM_THREADS=1 makes them those of one thread. All of it takes some two minutes.

The model is the one that the program assembles. It differs from the formula in the paper, and in NLEVP's `disk_brake4669`, in
D_R (1/Ω - 1) for D_R/Ω, K_geo (Ω² - 1) for Ω² K_geo, and D₄/(2π 1600) for D₄/1600.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np

import femsub as fs
from benchmarks.over_a_range import BAND, matrices
from benchmarks.pictures import save
from femsub.checks import Array
from femsub.components.pictures import PARTS
from femsub.output import damping_percent, legend_below, new_figure

DATA = Path(__file__).resolve().parent / "data" / "public-brake.json"
TURN = 2 * np.pi


def brake(folder: Path) -> fs.Affine:
    """D = D₁ + (1/Ω - 1) D_R + Ω D_G + D₄/(2π 1600) and K = K₁ + K_R + (Ω² - 1) K_geo, as the authors' program has them."""
    M, D1, DG, DR, D4, K1, KR, KG = matrices(folder)
    return fs.Affine(M, [(1.0, D1), (lambda speed: 1 / speed - 1, DR), ("speed", DG), (1 / (TURN * 1600), D4)],
                     [(1.0, K1), (1.0, KR), (lambda speed: speed**2 - 1, KG)])


def printed() -> dict[float, Array]:
    """λ that the program printed, in rad/s, by the turns of the disc in a second; all with Re λ > -10 in the band."""
    return {float(turns): np.array([complex(*one) for one in values])
            for turns, values in json.loads(DATA.read_text(encoding="utf-8"))["printed"].items()}


def figure(folder: Path, count: int = 181) -> Any:
    """Frequencies above damping ratios at `count` speeds, by the small model, and what the program printed."""
    family, theirs = brake(folder), printed()
    speeds, clock = TURN * np.linspace(min(theirs), max(theirs), count), [time.process_time()]
    small = fs.reduce(family, fs.ParameterBox({"speed": (speeds[0], speeds[-1])}, band=BAND))
    clock.append(time.process_time())
    found = [small.modes(speed=speed) for speed in speeds]
    clock.append(time.process_time())
    full = fs.complex_modes(family.at(speed=speeds[0]), band=BAND)
    made, each, once = np.diff([*clock, time.process_time()]) / [1, count, 1]
    radius = max((one.error_bar / np.abs(one.eigenvalues)).max() for one in found)
    assert full.evidence == small.evidence == "certified" and len({len(one) for one in found}) == 1
    # the branches, those that grow by more than their radius in colours
    tracked = fs.track(small, None, "speed", speeds, band=BAND)
    losses = fs.critical_value(small, None, "speed", between=(speeds[0], speeds[-1]), band=BAND).losses
    drawn = new_figure(5.6, 5.4)
    axes, colours, places = drawn.subplots(2, 1, sharex=True, height_ratios=[1, 1.2]), iter(PARTS), tracked.values / TURN
    for j in np.argsort(tracked.eigenvalues[-1].imag):
        branch, bar = tracked.eigenvalues[:, j], tracked.error_bar[:, j]
        looks: list[tuple[Array, dict[str, Any]]] = [
            (np.ones(len(branch), bool), {"color": "0.45", "lw": 0.8, "zorder": 2, "label": f"small model, {small.evidence}"})]
        if (grows := branch.real > bar).any():
            hertz, lost = branch.imag[grows][0] / TURN, [one.value / TURN for one in losses
                                                         if abs(one.omega / branch.imag[grows][0] - 1) < 0.01]
            since = f"from {lost[0]:.2f} turns/s" if lost else "at all speeds"
            looks.append((grows, {"color": next(colours), "lw": 2.2, "zorder": 3, "label": f"{hertz:,.0f} Hz, grows {since}"}))
        if (open_ := np.abs(branch.real) <= bar).all():
            looks.append((open_, {"color": "black", "lw": 1.6, "ls": ":", "zorder": 3,
                                  "label": f"{branch.imag[0] / TURN:,.0f} Hz, undecided within its radius"}))
        for where, look in looks:
            for axis, y in zip(axes, (branch.imag / TURN, damping_percent(branch)), strict=True):
                axis.plot(places, np.where(where, y, np.nan), **look)
    for turn, values in theirs.items():
        for axis, y in zip(axes, (values.imag / TURN, damping_percent(values)), strict=True):
            axis.plot([turn] * len(values), y, "ok", ms=4.5, mfc="none", mew=0.9, zorder=4,
                      label=f"printed by its authors' program ({sum(map(len, theirs.values()))} λ)")
    axes[0].set(ylabel="Im λ / 2π  [Hz]", ylim=(0, 3300), title="frequencies", xlim=(min(theirs) - 0.15, max(theirs) + 0.15))
    axes[1].set(ylabel="damping ratio ζ  [%]", ylim=(-0.55, 0.35), xlabel="speed of the disc Ω / 2π  [turns/s]",
                title="damping: a mode grows where it is below zero")
    axes[1].axhspan(-0.55, 0.0, color="#e41a1c", alpha=0.07, lw=0, zorder=0)
    axes[1].axhline(0.0, color="black", lw=0.9, zorder=1)
    for axis in axes:
        axis.grid(lw=0.4)
    legend_below(drawn, axes, 2)
    drawn.suptitle(f"Public disc brake of {family.size:,} DOF: one small model of {small.size} DOF for all speeds\n"
                   f"number of λ {small.evidence} at every speed; each within {radius:.0e} |λ| (estimate)\n"
                   f"seconds: {made:.0f} to make, {each:.3f} per speed; full model: {once:.1f} per speed", fontsize=9)
    return drawn


def main(folder: Path, *, out: Path = Path("out/public-brake")) -> None:
    save(out / "public-brake.png", lambda: figure(folder))
