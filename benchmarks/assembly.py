"""A solid assembly in parts, reduced as one part and part by part: seconds and peak memory.

    python -m benchmarks.assembly [--dof N] [--parts N] [--modes N] [--workers N] [--only one|parts|workers]

Cubes in a row, held at the first face, whose meshes do not match. Each is glued to the next over a square in the middle of the
face. The interface of the assembly is the square on the last face. Each run is in a process of its own with one thread of BLAS.

model      Seconds to make the parts and to couple them. All runs need them.
reduce     Seconds of `fs.reduce`.
peak       The largest memory that was taken from the machine: of all processes, with what they share counted once.
deviation  The largest relative difference of the lowest frequencies from those of the run as one part.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from itertools import pairwise

import numpy as np

import femsub as fs
from benchmarks.processes import Row, fresh, taken_mb
from femsub.studies.tables import table

SIDE, GLUED = 0.1, 0.15  # m; share of a face's side
COARSER = 0.87  # each second cube's bricks along an edge, by those of the others
LOWEST = 20  # frequencies that are compared
KEPT = "2e9"  # bytes of factors that are kept: those of the parts before are not needed
RUNS = ("one", "parts", "workers")


def cubes(dof: int, count: int) -> fs.System:
    """The assembly, of about so many DOF in all."""
    fine = max(4, round((dof / count / 3 * 2 / (1 + COARSER**3)) ** (1 / 3)) - 1)
    bricks = [fine if i % 2 == 0 else max(3, round(COARSER * fine)) for i in range(count)]
    meshes = {f"c{i}": _cube(n, i, bricks) for i, n in enumerate(bricks)}
    steel = fs.Material(2.1e11, 0.3, 7850.0)
    parts = {name: fs.solid(mesh, steel, supports=["left"] if name == "c0" else [], name=name,
                            interface=["after"] if name == "c0" else ["before", "after"]) for name, mesh in meshes.items()}
    joints: list[fs.Tied] = []
    for one, other in pairwise(meshes):
        first, second = (one, "after"), (other, "before")
        if len(meshes[one].cells) < len(meshes[other].cells):  # the finer surface comes first
            first, second = second, first
        joints.append(fs.Tied(first, second, {name: meshes[name] for name in (one, other)}))
    return fs.couple(parts, joints, "cubes", interface=[(f"c{count - 1}", "after")])


def _cube(bricks: int, place: int, all_bricks: list[int]) -> fs.Mesh:
    """A cube of linear bricks with the squares where it is glued; of the coarser of two neighbours it covers the other's."""
    mesh = fs.block((SIDE, SIDE, SIDE), [bricks] * 3, "hexahedron", name=f"c{place}")
    inner = max(1, round(GLUED * max(all_bricks) / 2)) / max(all_bricks)  # half the finer square, in sides
    lines = np.arange(bricks + 1) / bricks
    low, high = lines[lines <= 0.5 - inner + 1e-9].max(), lines[lines >= 0.5 + inner - 1e-9].min()
    if bricks == max(all_bricks):  # inside the other's square
        low, high = lines[lines >= 0.5 - inner - 1e-9].min(), lines[lines <= 0.5 + inner + 1e-9].max()
    y, z = mesh.points[:, 1] / SIDE, mesh.points[:, 2] / SIDE
    inside = (np.abs(np.stack([y, z]) - (low + high) / 2) <= (high - low) / 2 + 1e-9).all(axis=0)
    sets = {name: np.flatnonzero(inside & np.isin(np.arange(len(inside)), mesh.sets[side]))
            for name, side in (("before", "left"), ("after", "right"))}
    return fs.Mesh(mesh.points + np.array([place * SIDE, 0.0, 0.0]), mesh.cells, mesh.kind, {**mesh.sets, **sets}, name=mesh.name)


def measured(run: str, dof: int, count: int, modes: int, workers: int) -> Row:
    """One run."""
    os.environ.setdefault("FEMSUB_FACTOR_BYTES", KEPT)
    with taken_mb() as taken:
        start = time.perf_counter()
        system = cubes(dof, count)
        built = time.perf_counter()
        if run == "one":
            found: fs.Substructure = fs.reduce(system, fs.CraigBampton(2 * LOWEST))
        else:
            methods = dict.fromkeys(system.parts, fs.CraigBampton(modes))
            found = fs.reduce(system, methods, workers=workers if run == "workers" else None)
        done = time.perf_counter()
    return {"dof": system.size, "reduced": found.size, "interface": max(len(part.interface) for part in system.parts.values()),
            "model": built - start, "reduce": done - built, "peak_mb": taken[0],
            "frequencies": fs.normal_modes(found, LOWEST).frequencies}


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--dof", type=int, default=1_000_000)
    parser.add_argument("--parts", type=int, default=8)
    parser.add_argument("--modes", type=int, default=8, help="of each part")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", choices=RUNS)
    given = parser.parse_args()
    rows: list[Row] = []
    for run in RUNS if given.only is None else (given.only,):
        row = fresh(measured, run, given.dof, given.parts, given.modes, given.workers, cores=1)
        exact = rows[0]["frequencies"] if rows else row["frequencies"]
        rows.append(row | {"run": {"one": "as one part", "parts": "part by part", "workers": f"{given.workers} workers"}[run],
                           "deviation": float(np.abs(row["frequencies"] / exact - 1).max()) if rows else None})
        print(f"{rows[-1]['run']}: {row['reduce']:.1f} s, {row['peak_mb']:.0f} MB", flush=True)
    columns = {"run": "run", "reduced": "reduced DOF", "model": "model, s", "reduce": "reduce, s", "peak_mb": "peak, MB",
               "deviation": "deviation"}
    print(f"{rows[0]['dof']:,} DOF in {given.parts} parts of at most {rows[0]['interface']} interface DOF, {given.modes} modes "
          f"of each; as one part {2 * LOWEST}")
    print(table(list(columns.values()), [[row[key] for key in columns] for row in rows], ["", "d", ".1f", ".1f", ".0f", ".1e"]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
