"""Seconds and memory over size: chain, beam, plate and solid from 10 to 10⁶ DOF.

    python -m benchmarks scaling [--components chain beam plate solid] [--steps STEP ...] [--largest N] [--repeats N] [--out DIR]

Measured are the assembly (from the mesh on), HCB and CC, and the CEA of the full model by PEP (of a solid up to 300,000 DOF) and
of both reduced ones. Chain, beam and plate keep 20 modes and give the 20 eigenvalues nearest to 0; the floating solid keeps 50
and gives 32, of which 12 belong to its rigid-body modes. The components are defined below. Beams end at 20,000 DOF: the condition
of their K grows with n⁴, and rounding destroys their lowest frequencies (`fs.beam` warns from 6,300 on). The accuracy of
frequencies is checked by tests and by `python -m benchmarks extreme`.

Each measurement has its own process, so that the peak of its resident memory is its own; packages are loaded, and a tiny problem
is solved, before the clock starts. The results are medians over the repeats, written to scaling.csv, scaling.json and
scaling.png. OMP_NUM_THREADS sets the number of BLAS threads.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

import femsub as fs
from benchmarks import UsageError
from benchmarks.pictures import save
from benchmarks.processes import Row, StoppedError, begin, fresh, machine, peak_mb, warm_up
from femsub.app import report
from femsub.app.result import Result
from femsub.output import Chart, Panel, Series, Table, draw, table

# ---- the components: the chain has unit masses and springs and a dashpot; the others are of steel, in m, kg and s, without
# damping, and their belt takes so little (damping ratios of about 1e-6) that it moves no frequency by more than 1e-12

DAMPING = 0.1  # of the chain
STEEL: dict[str, Any] = {"E": 2.1e11, "rho": 7850.0}
NU = 0.3
LENGTH, SIDE = 1.0, 0.02  # of the beam, which is square
SIDES, THICKNESS = (1.0, 0.8), 0.005  # of the plate
SLAB, NODES = (2.0, 1.5, 0.1), 33  # of the solid; nodes of its interface


@dataclass(frozen=True)
class Kind:
    """The sizes measured, the modes kept, and the slope of the belt."""

    sizes: tuple[int, ...]
    modes: int
    slope: float
    rigid: int = 0
    pep: float = np.inf  # up to so many DOF the full CEA is solved


KINDS = {
    # about half of the slope -d/(4 cos²θ) at which its mode j is lost, θ = (2j - 1)π/(2n + 1): mode j moves m_k by sin(kθ), and
    # d sin²θ + c sin²2θ is its damping to first order
    "chain": Kind((10, 100, 1_000, 10_000, 30_000, 100_000, 300_000, 1_000_000), 20, -DAMPING / 8),
    "beam": Kind((10, 100, 1_000, 10_000, 20_000), 20, 3e-4),
    "plate": Kind((80, 1_000, 10_000, 30_000, 100_000, 300_000), 20, 6e-3),
    "solid": Kind((1_000, 10_000, 30_000, 100_000, 300_000, 1_000_000), 50, 2.0, rigid=6, pep=300_000),
}


def chain(n: int) -> fs.Substructure:
    """Belt under m2, which is not in the interface {m1}, as in the paper."""
    return fs.chain(n, belt=2, damping=DAMPING)


def beam(n: int) -> fs.Substructure:
    """Clamped at the left, joined at the right (2 DOF), a belt at 0.35 L."""
    elements = n // 2
    return fs.beam(LENGTH, elements, E=STEEL["E"], I=SIDE**4 / 12, rho=STEEL["rho"], A=SIDE**2, supports={"left": "clamped"},
                   interface=["right"], ports={"belt": np.linspace(0, LENGTH, elements + 1)[round(0.35 * elements)]})


def plate(n: int) -> fs.Substructure:
    """Simply supported all round, Bogner-Fox-Schmit rectangles (4 nx ny DOF); joined at 3 nodes (12 DOF), a belt at one."""
    nx = round((n / 4 * SIDES[0] / SIDES[1]) ** 0.5)
    ny = round(nx * SIDES[1] / SIDES[0])
    mesh = fs.rectangle(SIDES, (nx, ny))

    def node(x: float, y: float) -> int:
        return round(x * nx) * (ny + 1) + round(y * ny)

    mesh = mesh.with_sets(joint=np.array([node(0.6, share) for share in (0.25, 0.5, 0.75)]))
    return fs.plate(mesh, **STEEL, nu=NU, thickness=THICKNESS, supports={"edge": "simply supported"}, interface=["joint"],
                    ports={"belt": tuple(mesh.points[node(0.35, 0.4)])})


def solid(n: int) -> fs.Substructure:
    """A floating slab of bricks with 8 nodes, joined at 33 nodes of its left face (99 DOF), a belt along its right face."""
    size = np.linspace(0.5, 20, 4000)[:, None] * [20, 15, 1]
    counts = np.maximum(1, size.round()).astype(int)
    chosen = counts[np.abs(np.log(3 * np.prod(counts + 1, axis=1) / n)).argmin()]
    mesh = fs.block(SLAB, [int(count) for count in chosen], "hexahedron")
    left = mesh.nodes("left")
    mesh = mesh.with_sets(joint=left[np.linspace(0, len(left) - 1, min(NODES, len(left))).astype(int)])
    return fs.solid(mesh, fs.Material(STEEL["E"], NU, STEEL["rho"]), interface=["joint"], ports={"belt": ("right", "y")})


BUILD = {"chain": chain, "beam": beam, "plate": plate, "solid": solid}


# ---- what is measured

STEPS = ("assembly", "HCB", "CC", "CEA full", "CEA HCB", "CEA CC")
METHODS: dict[str, Any] = {"HCB": fs.CraigBampton, "CC": fs.CraigChang}
LARGE = 10_000  # exponents begin here, since fixed costs dominate for smaller models
COLUMNS = {"component": "", "dof": ",d", "step": "", "seconds": ".3g", "least": ".3g", "most": ".3g", "runs": "d",
           "peak_mb": ".0f", "base_mb": ".0f", "stable": ""}


def measure(kind: str, step: str, n: int, reduced: tuple[np.ndarray, ...] | None) -> Row:
    """One step at one size, in a fresh process; `reduced` is (M, K, D, w) of the model a CEA is asked of.

    Returns
    -------
    dict
        seconds; peak_mb, and base_mb before the model is built; dof; for a reduction also its matrices, for the CEA
        of a chain its verdict.
    """
    def seen(model: fs.Substructure, since: float) -> Row:
        return {"seconds": time.perf_counter() - since, "peak_mb": peak_mb(), "dof": model.size}

    warm_up()
    of = KINDS[kind]
    fs.reduce(BUILD[kind](of.sizes[0]), fs.CraigBampton(modes=3), ports=True)
    row: Row = {"base_mb": peak_mb()}
    start = time.perf_counter()
    model = BUILD[kind](n) if reduced is None else fs.Substructure(
        reduced[0], reduced[1], reduced[2], ports={"belt": reduced[3]})
    if step == "assembly":
        return row | seen(model, start)
    if step in METHODS:
        method = METHODS[step](modes=min(of.modes, model.size - len(model.interface)))
        start = time.perf_counter()
        rom = fs.reduce(model, method, ports=kind != "chain")
        return row | seen(model, start) | {"reduced": (rom.M, rom.K, rom.D, rom.port("belt"))}
    start = time.perf_counter()
    modes = fs.complex_modes(model, fs.Belt(slope=of.slope), count=min(20 + 2 * of.rigid, 2 * model.size))
    row |= seen(model, start)
    # whether the chain is stable, within the error bars
    return row | {"stable": {True: "yes", False: "NO", None: "undecided"}[modes.is_stable]} if kind == "chain" else row


def run(kind: str, n: int, steps: Sequence[str], repeats: int, failed: list[str]) -> list[Row]:
    """A row for each step: medians over the runs, and the spread of its seconds."""
    reduced: dict[str, tuple[np.ndarray, ...]] = {}
    rows = list[Row]()
    for step in steps:
        model, runs = reduced.get(step.removeprefix("CEA ")), list[Row]()
        if step in ("CEA HCB", "CEA CC") and model is None:
            continue  # its reduction has failed, or was not asked for
        report.progress(f"{kind}, n = {n:,}, {step}")
        try:
            runs = [fresh(measure, kind, step, n, model) for _ in range(repeats)]
        except (fs.FemsubError, MemoryError, StoppedError, ArithmeticError, np.linalg.LinAlgError) as error:
            failed.append(f"{kind}, n = {n:,}, {step}: {type(error).__name__}: {error}")
            continue
        if "reduced" in runs[-1]:
            reduced[step] = runs[-1]["reduced"]
        seconds = [one["seconds"] for one in runs]
        rows.append({"component": kind, "n": n, "dof": rows[0]["dof"] if rows else runs[0]["dof"], "step": step,
                     "least": min(seconds), "most": max(seconds), "runs": len(runs), "stable": runs[-1].get("stable")}
                    | {key: statistics.median(one[key] for one in runs) for key in ("seconds", "peak_mb", "base_mb")})
    return rows


def exponents(rows: list[Row]) -> dict[str, float]:
    """p of seconds ~ nᵖ from LARGE on, by least squares in logarithms, of 'component, step'."""
    found = {}
    for kind, step in dict.fromkeys((row["component"], row["step"]) for row in rows):
        points = [(row["dof"], row["seconds"]) for row in rows if (row["component"], row["step"]) == (kind, step)
                  and row["n"] >= LARGE]
        if len(points) > 1:
            n, seconds = np.log(np.array(points)).T
            found[f"{kind}, {step}"] = float(np.polyfit(n, seconds, 1)[0])
    return found


def figure(rows: list[Row]) -> Any:
    """Median seconds above, peak memory below, one column for each component, all axes logarithmic."""
    looks = {"assembly": ("assembly", "full", "v", "solid"), "HCB": ("reduce: Craig-Bampton", "craig-bampton", None, "solid"),
             "CC": ("reduce: Craig-Chang", "craig-chang", None, "solid"), "CEA full": ("solve: full model", "full", "o", "solid"),
             "CEA HCB": ("solve: Craig-Bampton", "craig-bampton", "x", "dot"),
             "CEA CC": ("solve: Craig-Chang", "craig-chang", "+", "dot")}
    kinds = list(dict.fromkeys(row["component"] for row in rows))
    panels = []
    for key, label in (("seconds", "run time, median  [s]"), ("peak_mb", "peak resident memory  [MB]")):
        for kind in kinds:
            series = []
            for step, (name, model, marker, line) in looks.items():
                mine = [row for row in rows if (row["component"], row["step"]) == (kind, step)]
                if mine:
                    series.append(Series(name, [row["dof"] for row in mine], [row[key] for row in mine], model, line, marker))
            panels.append(Panel(series, "DOF n  [-]", label, kind if key == "seconds" else "", "xy", share={"x": kind, "y": key}))
    return draw(Chart("scaling", "Run time and memory over the size", panels, len(kinds), height=3.2, columns=3))


def main(*, components: Annotated[tuple[str, ...], KINDS] = tuple(KINDS), largest: int = 1_000_000, repeats: int = 1,
         steps: Annotated[tuple[str, ...], STEPS] = STEPS, out: Path = Path("out/scaling")) -> int:
    if repeats < 1:
        raise UsageError("--repeats must be at least 1")
    begin(out)
    rows: list[Row] = []
    failed: list[str] = []
    for kind in components:
        for n in [n for n in KINDS[kind].sizes if n <= largest] or KINDS[kind].sizes[:1]:
            some = [step for step in STEPS if step in steps and (step != "CEA full" or n <= KINDS[kind].pep)]
            rows += run(kind, n, some, repeats, failed)
    report.progress_done()
    powers = exponents(rows)
    text = table([key.replace("_", " ") for key in COLUMNS], [[row[key] for key in COLUMNS] for row in rows],
                 list(COLUMNS.values()), keys=3, none="not measured, or not known")
    data = {"machine": fresh(machine), "rows": rows, "exponents": powers, "failed": failed}
    result = Result(data, [text, Table("scaling", rows)])
    print(result.text(), *(f"{name}: seconds ~ n^{power:.2f} from n = {LARGE:,} on" for name, power in powers.items()),
          *(f"failed: {line}" for line in failed), sep="\n")
    report.write(result, out, figures=False, name="scaling")
    if rows:
        save(out / "scaling.png", lambda: figure(rows))
    return 1 if failed else 0
