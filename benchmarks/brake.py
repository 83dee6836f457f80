"""A large brake: its reduction, 100 values of mu of the reduced model, and the full model at one, with seconds and memory.

    python -m benchmarks.brake [--size METRES] [--modes N] [--method KEY] [--mu N] [--full METRES] [--out FILE]

Each measurement runs in a process of its own, so that the memory told is its own. --size 0.0085 has 50,000 DOF, 0.0035 some
480,000. --method reduces the parts one by one before (their interface is dense: only for small models). --full is the size of the
elements of the model that is solved in full, 0 for none. The number of threads is that of OMP_NUM_THREADS.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

import femsub as fs
from benchmarks.processes import fresh, machine, peak_mb
from femsub.app.scenes.brake import PADS, Brake, BrakeScene
from femsub.studies.friction_sweep import first_loss, over_mu

MU = 0.5  # at which the full model is solved


def made(size: float, **keys: Any) -> tuple[Brake, dict[str, Any]]:
    """The brake, its size, and the seconds to build it."""
    start = time.perf_counter()
    brake = Brake(BrakeScene(size=size, **keys), lambda _: None)
    nodes = sum(len(brake.meshes[name].sets["face"]) for name in PADS)
    return brake, {"element": size, "dof": brake.system.size, "contact_nodes": nodes, "build_s": time.perf_counter() - start}


def reduced(size: float, modes: int, method: str, points: int) -> dict[str, Any]:
    """A reduced model, solved at so many values of mu."""
    brake, row = made(size, modes=[modes])
    model, affine, seconds = brake.reduced(method, modes)
    band = brake.scene.band[0], brake.scene.band[1]
    start, unstable = time.perf_counter(), []
    for mu in np.linspace(brake.scene.mu[0], brake.scene.mu[1], points):
        found = fs.complex_modes(affine.at(mu=float(mu)), band=band)
        unstable.append(len(found.unstable))
    sweep = time.perf_counter() - start
    critical, omega = first_loss(affine, brake.scene.mu, band)
    near = fs.complex_modes(affine.at(mu=MU), band=band)
    return row | {"model": f"{method or 'contact modes'} {modes}", "size": model.size, "reduce_s": seconds, "points": points,
                  "sweep_s": sweep, "critical_mu": critical, "critical_hz": omega / (2 * np.pi), "most_unstable": max(unstable),
                  "unstable": [[value.real, value.imag] for value in near.eigenvalues[near.unstable]], "peak_mb": peak_mb()}


def full(size: float) -> dict[str, Any]:
    """The full model at one mu."""
    brake, row = made(size)
    affine = over_mu(brake.system, brake.contacts(0.0))
    start = time.perf_counter()
    found = fs.complex_modes(affine.at(mu=MU), band=(brake.scene.band[0], brake.scene.band[1]))
    return row | {"model": "full", "solve_s": time.perf_counter() - start, "modes": len(found), "peak_mb": peak_mb(),
                  "unstable": [[value.real, value.imag] for value in found.eigenvalues[found.unstable]]}


def told(row: dict[str, Any]) -> str:
    """One line for the terminal."""
    head = f"{row['dof']:,} DOF, {row['contact_nodes']:,} contact nodes, built in {row['build_s']:.1f} s; {row['model']}: "
    if row["model"] == "full":
        what = f"one mu in {row['solve_s']:.1f} s, {row['modes']} modes"
    else:
        what = (f"{row['size']} DOF in {row['reduce_s']:.1f} s, {row['points']} values of mu in {row['sweep_s']:.1f} s, critical "
                f"mu {row['critical_mu']:.5f} at {row['critical_hz']:.5g} Hz")
    lost = ", ".join(f"{growth:.4g} {omega / (2 * np.pi):+.5g} Hz" for growth, omega in row["unstable"])
    return f"{head}{what}; peak {row['peak_mb']:,.0f} MB; unstable at mu = {MU}: {lost or 'none'}"


def main() -> None:
    parser = argparse.ArgumentParser(description="A large brake, reduced and full.")
    parser.add_argument("--size", type=float, default=0.0085, metavar="METRES", help="of the elements; default 0.0085")
    parser.add_argument("--modes", type=int, default=100, metavar="N", help="real modes of the brake in contact; default 100")
    parser.add_argument("--method", default="", metavar="KEY", help="for the parts, e.g. craig-bampton; default none")
    parser.add_argument("--mu", type=int, default=100, metavar="N", help="values of mu; default 100")
    parser.add_argument("--full", type=float, default=0.025, metavar="METRES", help="elements of the full model; 0: none")
    parser.add_argument("--out", type=Path, metavar="FILE", help="a JSON file for the rows")
    given = parser.parse_args()
    rows = [fresh(reduced, given.size, given.modes, given.method, given.mu)]
    print(told(rows[0]), flush=True)
    if given.full:
        rows.append(fresh(full, given.full))
        print(told(rows[1]), flush=True)
    if given.out:
        given.out.write_text(json.dumps({"machine": fresh(machine), "rows": rows}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
