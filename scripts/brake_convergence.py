#!/usr/bin/env python3
"""The brake's flutter over three meshes: frequency and growth of its unstable modes, and the critical mu, against element length.

    .venv/bin/python scripts/brake_convergence.py [--sizes METRES ...] [--mu MU] [--out DIR]

Each mesh is reduced to contact modes, whose own error is below that of the mesh. The modes that are unstable on the finest mesh
are found on the others by their eigenvalues. Writes brake-convergence.png and .json.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

import femsub as fs
from benchmarks.pictures import save
from femsub.app.figure_style import PAGE, legend_below, new_figure
from femsub.app.scenes.brake import Brake, BrakeScene
from femsub.modes import match
from femsub.studies.losses import first_loss

MODES = 100
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")  # of modes


def solved(size: float, mu: float) -> dict[str, Any]:
    """The unstable modes of one mesh at mu, all modes in the band, and the critical mu."""
    brake = Brake(BrakeScene(size=size, modes=[MODES]), lambda _: None)
    model = fs.reduce(brake.system, brake.contact_modes(MODES))
    found = fs.complex_modes(model, brake.contacts(mu), band=brake.band)
    critical, omega, _ = first_loss(model, brake.contacts(0.0), "mu", brake.range, brake.band)
    unstable = found.eigenvalues[found.unstable]
    modes = ", ".join(f"{value.imag / 2 / np.pi:.5g} Hz with Re λ = {value.real:.4g}" for value in unstable)
    print(f"{size:g} m, {brake.system.size:,} DOF, reduced to {model.size}: critical mu {critical:.5f} at "
          f"{omega / 2 / np.pi:.5g} Hz; at mu = {mu:g} {modes}", flush=True)
    return {"size": size, "dof": brake.system.size, "critical": critical, "omega": omega, "values": found.eigenvalues,
            "unstable": unstable}


def followed(rows: list[dict[str, Any]]) -> np.ndarray:
    """The unstable modes of the finest mesh on every mesh, shape (meshes, modes)."""
    finest = rows[-1]["unstable"]
    return np.array([row["values"][match(finest, row["values"])[1]] for row in rows])


def figure(rows: list[dict[str, Any]], values: np.ndarray, mu: float) -> Any:
    """Frequency and growth relative to the finest mesh, and the critical mu, over element length."""
    drawn = new_figure(PAGE, 3.6)
    axes = drawn.subplots(1, 3)
    sizes = np.array([row["size"] for row in rows])
    names = [f"{value.imag / 2 / np.pi:.4g} Hz" for value in values[-1]]
    for axis, part, title in ((axes[0], np.imag, "frequency"), (axes[1], np.real, "growth Re λ")):
        for k, name in enumerate(names):
            axis.plot(1e3 * sizes, 100 * (part(values[:, k]) / part(values[-1, k]) - 1), "o^sDv"[k % 5], ls="-",
                      color=COLOURS[k % len(COLOURS)], label=name, zorder=3)
        axis.set(xlabel="element length  [mm]", title=f"{title} at μ = {mu:g}")
    axes[0].set_ylabel("difference to the finest mesh  [%]")
    axes[2].plot(1e3 * sizes, [row["critical"] for row in rows], "s-", color="black")
    near = f"first loss, near {rows[-1]['omega'] / 2 / np.pi:.4g} Hz"
    axes[2].set(xlabel="element length  [mm]", ylabel="critical μ  [-]", title=near)
    for axis in axes:
        axis.set_xlim(0, None)
        axis.grid(lw=0.4)
    legend_below(drawn, axes[:1])
    drawn.suptitle(f"Brake of {', '.join(format(row['dof'], ',') for row in rows)} DOF")
    return drawn


def main() -> int:
    parser = argparse.ArgumentParser(description="The brake's flutter over three meshes.")
    parser.add_argument("--sizes", type=float, nargs="+", default=[0.025, 0.018, 0.0135], metavar="METRES")
    parser.add_argument("--mu", type=float, default=0.4)
    parser.add_argument("--out", type=Path, default=Path("."), metavar="DIR")
    given = parser.parse_args()
    rows = [solved(size, given.mu) for size in sorted(given.sizes, reverse=True)]
    values = followed(rows)
    change = np.abs(np.diff(values, axis=0)) / np.abs(values[-1])
    print("largest change of λ from mesh to mesh, relative to |λ|: " + ", ".join(f"{step:.1e}" for step in change.max(axis=1)))
    given.out.mkdir(parents=True, exist_ok=True)
    save(given.out / "brake-convergence.png", lambda: figure(rows, values, given.mu))
    table = [{"size": row["size"], "dof": row["dof"], "critical_mu": row["critical"], "critical_omega": row["omega"],
              "frequency_hz": (value.imag / 2 / np.pi).tolist(), "growth": value.real.tolist()}
             for row, value in zip(rows, values, strict=True)]
    (given.out / "brake-convergence.json").write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
