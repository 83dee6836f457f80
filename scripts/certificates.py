#!/usr/bin/env python3
"""What the certificates of complex modes cost beside the solution that they certify; and the refinement of reduced modes.

    python scripts/certificates.py [--models NAME ...] [--repeats N] [--out DIR]

Each row is one call of `complex_modes` with its count asked for, or of `reduce` (HCB, CC; 20 modes, whose residuals are part of
the solution). Seconds are those of the processor (the process has one thread of BLAS), medians over the repeats; what took longer
than a minute is measured once. With --out, certificates.csv and .json.

solution  all but the certificates. By band, K - R²M is factorised to know how many eigenvalues to ask for: that is part of it.
errors    residuals, backward errors, condition numbers, error bars (`bars`)
left      left vectors, where the pencil is unsymmetric
inertia   the factorisation of K - R²M, or K - ω²M, where only the count needs it, with its solves
disc      taking the pencil apart, the basis and the margin on the circle (`damping_split`, `disc_count`); of a K that is not
          definite, its factorisation too
projection  modes and factors for the count by projection (`projected_count`), where damping and friction are anywhere
ratio     certificates / solution
refine    `fs.refine` of the modes of a reduced model (Craig-Bampton, 20 modes) in the same band, without the reduction
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
import warnings
from collections.abc import Callable
from typing import Any
from unittest.mock import patch

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
import femsub as fs
from benchmarks import models
from femsub.algebra.factor import release
from femsub.app import report
from femsub.app.scene import Result
from femsub.app.scenes.brake import Brake, BrakeScene
from femsub.modes import normal_modes
from femsub.modes.quadratic import certificate, complex_modes, damping_split, disc_count, sparse
from femsub.modes.quadratic.projected_count import Projection
from femsub.studies.tables import Table, table

LONG = 60.0
KINDS = ("errors", "left", "inertia", "disc", "projection")
Row = dict[str, Any]
# name: (kind, DOF, 'all', 'count', 'band' or a method)
MODELS = {
    "chain 10": ("chain", 10, "all"), "beam 2,000": ("beam", 2_000, "count"), "plate 3,000": ("plate", 3_000, "count"),
    "solid 3,000": ("solid", 3_000, "count"), "chain 100,000": ("chain", 100_000, "count"),
    "chain 100,000, band": ("chain", 100_000, "band"),
    "plate 100,000": ("plate", 100_000, "count"), "plate 100,000, band": ("plate", 100_000, "band"),
    "solid 100,000": ("solid", 100_000, "count"), "solid 100,000, band": ("solid", 100_000, "band"),
    "brake 7,500, band": ("brake", 0.025, "band"), "brake 23,000, band": ("brake", 0.012, "band")}  # by length of elements
METHODS = {"HCB": fs.CraigBampton(20), "CC": fs.CraigChang(20)}
MODELS |= {f"{kind} 100,000, {way}": (kind, 100_000, way) for kind in ("chain", "plate", "solid") for way in METHODS}


class Clock:
    """Processor seconds spent in certificates by kind, from wrapped functions; what is nested counts once."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys((*KINDS, "factor"), 0.0)

    def wrapped(self, kind: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*given: Any, **options: Any) -> Any:
            start = time.process_time()
            try:
                return function(*given, **options)
            finally:
                self.seconds[kind] += time.process_time() - start

        return timed


def once(sub: fs.Substructure, belt: Any, ask: Row) -> tuple[Row, fs.ComplexModes]:
    """Seconds of one call, by kind, with nothing kept of the model from calls before."""
    release(sub)
    clock = Clock()
    with patch.object(complex_modes, "bars", clock.wrapped("errors", complex_modes.bars)), \
            patch.object(sparse.Shifted, "left", clock.wrapped("left", sparse.Shifted.left)), \
            patch.object(certificate, "left_vectors", clock.wrapped("left", certificate.left_vectors)), \
            patch.object(Projection, "__init__", clock.wrapped("projection", Projection.__init__)), \
            patch.object(Projection, "on", clock.wrapped("projection", Projection.on)), \
            patch.object(disc_count, "edge", clock.wrapped("inertia", disc_count.edge)), \
            patch.object(disc_count, "counting", clock.wrapped("factor", disc_count.counting)), \
            patch.object(disc_count, "inertia", clock.wrapped("factor", disc_count.inertia)), \
            patch.object(disc_count, "definite", clock.wrapped("disc", disc_count.definite)), \
            patch.object(disc_count, "count", clock.wrapped("disc", disc_count.count)), \
            patch.object(damping_split, "split", clock.wrapped("disc", damping_split.split)):
        start = time.process_time()
        found = fs.complex_modes(sub, belt, **ask)
        whole = time.process_time() - start
    seconds = clock.seconds
    if "band" in ask:
        seconds["inertia"] -= seconds["factor"]
    del seconds["factor"]
    return {"solution": whole - sum(seconds.values()), **seconds}, found


def reduction(sub: fs.Substructure, way: str) -> Row:
    """Seconds of one reduction, of which the count by inertia is the certificate; nothing is kept from calls before."""
    release(sub)
    clock = Clock()
    with patch.object(normal_modes, "inertia", clock.wrapped("inertia", normal_modes.inertia)):
        start = time.process_time()
        fs.reduce(sub, METHODS[way], ports=True)
        whole = time.process_time() - start
    return {"solution": whole - clock.seconds["inertia"], **{key: clock.seconds[key] for key in KINDS}}


def measure(name: str, repeats: int) -> Row:
    """One model."""
    kind, size, way = MODELS[name]
    if way in METHODS:
        sub = models.build(kind, size)
        return summary({"model": name, "dof": sub.size, "eigenvalues": METHODS[way].modes, "evidence": "certified"},
                       [reduction(sub, way) for _ in range(repeats)])
    if kind == "brake":
        brake = Brake(BrakeScene(size=size), lambda _: None)
        row = {"model": name, "dof": brake.system.size}
        runs = [once(brake.system, brake.contacts(0.6), {"band": brake.band}) for _ in range(repeats)]
        return summary(row | {"eigenvalues": len(runs[0][1]), "evidence": runs[0][1].evidence}, [seconds for seconds, _ in runs])
    sub, belt = models.build(kind, size), fs.Belt(slope=models.KINDS[kind].slope or -0.02)
    count = 20 + 2 * models.KINDS[kind].rigid
    ask: Row = {"all": {}, "count": {"count": count, "evidence": True}, "band": {}}[way]
    top = 0.0
    if way == "band":
        omega = fs.normal_modes(sub, count=count // 2 + 1 - models.KINDS[kind].rigid).frequencies
        top = float(omega[-2:].mean())
        ask = {"band": (0.0, top), "re": (-0.1 * top, 0.1 * top), "evidence": True}
    runs = []
    once(sub, belt, ask) if sub.size < 1000 else None
    for _ in range(repeats if sub.size >= 1000 else 50 * repeats):
        seconds, found = once(sub, belt, ask)
        runs.append(seconds)
        if sum(seconds.values()) > LONG:
            break
    row = summary({"model": name, "dof": sub.size, "eigenvalues": len(found), "evidence": found.evidence}, runs)
    return row | refinement(sub, belt, top) if way == "band" else row


def summary(row: Row, runs: list[Row]) -> Row:
    """Medians over the runs."""
    row |= {key: statistics.median(run[key] for run in runs) for key in runs[0]}
    return row | {"ratio": statistics.median(sum(run[key] for key in KINDS) / run["solution"] for run in runs)}


def refinement(sub: fs.Substructure, belt: fs.Belt, top: float) -> Row:
    """Seconds to refine the modes of an HCB model in the same band, and how far they moved."""
    rom = fs.reduce(sub, fs.CraigBampton(modes=20), ports=True)
    small = fs.complex_modes(rom, belt, band=(0.0, top), re=(-0.1 * top, 0.1 * top))
    start = time.process_time()
    out = fs.refine(sub, small, rom, belt)
    moved = out.moved[~small.rigid & (small.eigenvalues.imag > 0)] / abs(small.eigenvalues[small.eigenvalues.imag > 0])
    return {"refine": time.process_time() - start, "moved": float(moved.max()), "steps": out.steps, "solves": out.solves}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", nargs="+", choices=list(MODELS), default=list(MODELS), metavar="NAME")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--out")
    given = parser.parse_args()
    folder = report.check_folder(given.out)
    warnings.simplefilter("ignore", fs.FemsubWarning)
    for first in (20, 200):  # everything loaded
        fs.complex_modes(fs.chain(first, belt=2), fs.Belt(slope=-0.02), count=2, evidence=True)
    rows: list[Row] = []
    for name in given.models:
        report.progress(name)
        rows.append(measure(name, given.repeats))
        if folder:
            data = {"machine": report.machine() | report.versions(), "rows": rows}
            report.write(Result(data, [Table("certificates", rows)]), folder, False, "certificates")
    report.progress_done()
    shown = ("model", "dof", "eigenvalues", "evidence", "solution", *KINDS, "ratio", "refine", "moved")
    formats = ("s", "d", "d", "s", ".4g", *(".3g" for _ in KINDS), ".1%", ".3g", ".1e")
    print(table(shown, [[row.get(key) for key in shown] for row in rows], formats))


if __name__ == "__main__":
    main()
