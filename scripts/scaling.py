#!/usr/bin/env python3
"""Seconds, memory and error over size: chain, beam, plate and solid from 10 to 10⁶ DOF, on one core and on two.

    python scripts/scaling.py [--components chain beam plate solid] [--cores 1 2] [--steps STEP ...] [--largest N]
                              [--repeats N] [--long SECONDS] [--out DIR]

Measured are the assembly (from the mesh on), HCB and CC, and the CEA of the full model by PEP (of a solid above 300,000 DOF
only where --steps asks for it) and of both reduced ones. Chain, beam and plate keep 20 modes and give the 20 eigenvalues
nearest to 0; the floating solid keeps 50 and gives 32, of which 12 belong to its rigid-body modes. What the components are
is in benchmarks/models.py. Beams end at 20,000 DOF: the condition of their K grows with n⁴, and at 10,000 rounding takes 1.5 % of
their lowest frequencies, full and reduced, at 20,000 that of HCB altogether (`fs.beam` warns from 6,300 on).

Cores are threads of BLAS: OMP_NUM_THREADS and OPENBLAS_NUM_THREADS of the process; all else runs on one core.

Each measurement has a process of its own, so that the peak of its resident memory is its own; packages are loaded, and a
tiny problem solved, before the clock starts. Medians over the repeats, whose order alternates; what takes longer than
--long is measured once. Written are scaling.csv, scaling.json and scaling.png.

error     The largest relative one of the lowest frequencies. Chain: all 20 against the closed form, of HCB those with
          fixed interface. Beam and plate: 5 of the reduced or full model against the continuum, so that errors of the mesh,
          the reduction and the solver add up. Solid: 10 elastic ones against `normal_modes` of the full model, below
          100,000 DOF.
residual  The largest of the kept modes, ‖Kφ - ω²Mφ‖ / ‖(|K| + ω²|M|)|φ|‖, or the largest backward error of a CEA.
"""

from __future__ import annotations

import argparse
import json
import signal
import statistics
import sys
import time
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import numpy as np

import femsub as fs
from benchmarks import models
from benchmarks.pictures import save
from benchmarks.processes import Row, fresh, machine, peak_mb, warm_up
from femsub.app import report
from femsub.app.figure_style import PAGE, new_figure
from femsub.app.scene import Result
from femsub.studies import look
from femsub.studies.tables import Table, table

STEPS = ("assembly", "HCB", "CC", "CEA full", "CEA HCB", "CEA CC")
METHODS: dict[str, Any] = {"HCB": fs.CraigBampton, "CC": fs.CraigChang}
LARGE = 10_000  # below it fixed costs rule
LIMITS = {"exponent": 1.25, "peak_mb": 4000.0}  # what HCB and CC are held to at 10⁶ masses


def largest_error(found: np.ndarray, exact: np.ndarray) -> float:
    """The largest relative one."""
    return float(np.max(np.abs(found / exact - 1)))


def measure(kind: str, step: str, n: int, known: Row, reduced: tuple[np.ndarray, ...] | None) -> Row:
    """One step at one size, in a fresh process; `reduced` is (M, K, D, w) of the model a CEA is asked of.

    Returns
    -------
    dict
        seconds; peak_mb, and base_mb before the model is built; dof; error and residual, see the top; for a reduction
        also its matrices, for the CEA of a chain its verdict.
    """
    warm_up(kind)
    result: Row = {"base_mb": peak_mb()}
    start = time.perf_counter()
    model = models.build(kind, n) if reduced is None else fs.Substructure(*reduced[:3], ports={"belt": reduced[3]})
    if step == "assembly":
        return result | {"seconds": time.perf_counter() - start, "peak_mb": peak_mb(), "dof": model.size}
    of = models.KINDS[kind]
    if step in METHODS:
        method = METHODS[step](modes=min(of.modes, model.size - len(model.interface)))
        start = time.perf_counter()
        rom = fs.reduce(model, method, ports=kind != "chain")
        result |= {"seconds": time.perf_counter() - start, "peak_mb": peak_mb(), "dof": model.size}
        return result | modes_kept(kind, step, model, rom, known["lowest"]) | {
            "reduced": (rom.M, rom.K, rom.D, rom.port("belt"))}
    count = min(20 + 2 * of.rigid, 2 * model.size)
    start = time.perf_counter()
    modes = fs.complex_modes(model, fs.Belt(slope=known["slope"]), count=count)
    result |= {"seconds": time.perf_counter() - start, "peak_mb": peak_mb(), "residual": float(modes.backward_error.max())}
    found = np.sort(modes.eigenvalues.imag[modes.eigenvalues.imag > 0])
    if kind == "chain":
        result["stable"] = {True: "yes", False: "NO", None: "undecided"}[modes.is_stable]  # within the error bars
        if n >= LARGE:  # there the dashpot shifts the frequencies by 5e-12 and less
            result["error"] = largest_error(found, fs.chain_frequencies(n, len(found)))
    elif known["lowest"] is not None:
        found = found[found > known["lowest"][0] / 2][:of.compared]  # without rigid-body modes
        result["error"] = largest_error(found, known["lowest"][:len(found)]) if len(found) else 1.0
    return result


def modes_kept(kind: str, step: str, model: fs.Substructure, rom: fs.ReducedSubstructure, exact: np.ndarray | None) -> Row:
    """Error of the reduced model's frequencies, and the largest residual of the modes it keeps."""
    import scipy.linalg

    from femsub.modes.normal_modes import relative_residual

    at = np.array([i for i, name in enumerate(rom.kinds) if name in ("fixed-interface", "free")])
    values, shapes = rom.K[at, at], rom.V[:, at]
    if step == "HCB":
        inner = model.interior
        residual = relative_residual(model.K[inner][:, inner], model.M[inner][:, inner], values, shapes[inner])
    else:
        residual = relative_residual(model.K, model.M, values, shapes)
    result = {"residual": float(residual.max())}
    if kind == "chain":  # with m1 held, n - 1 masses vibrate
        exact = fs.chain_frequencies(model.size - 1 if step == "HCB" else model.size, len(at))
        return result | {"error": largest_error(np.sqrt(values), exact)}
    if exact is None:
        return result
    rigid, count = models.KINDS[kind].rigid, min(len(exact), model.size // 2)
    squares = scipy.linalg.eigh(rom.K, rom.M, eigvals_only=True)[rigid:rigid + count]
    return result | {"error": largest_error(np.sqrt(np.maximum(squares, 0)), exact[:count])}


def sizes(kind: str, largest: int | None) -> list[int]:
    """Those of the component below the largest, which comes last."""
    of = models.KINDS[kind]
    top = of.sizes[-1] if largest is None else max(of.sizes[0], min(largest, of.most))
    return [n for n in of.sizes if n < top] + [int(top)]


def run(asked: argparse.Namespace) -> tuple[list[Row], list[str]]:
    """All measurements: one row for each component, size, number of cores and step, and what failed."""
    steps = STEPS if asked.steps is None else [step for step in STEPS if step in asked.steps or f"CEA {step}" in asked.steps]
    tasks = [(kind, n, cores, step) for kind in asked.components for n in sizes(kind, asked.largest) for cores in asked.cores
             for step in steps if asked.steps or step != "CEA full" or n <= models.KINDS[kind].pep]
    runs: dict[tuple[str, int, int, str], list[Row]] = {task: [] for task in tasks}
    known: dict[tuple[str, int], Row] = {}
    reduced: dict[tuple[str, int, int, str], tuple[np.ndarray, ...]] = {}
    failed: dict[tuple[str, int, int, str], str] = {}
    for repeat in range(asked.repeats):
        for at, task in enumerate(tasks if repeat % 2 == 0 else tasks[::-1]):
            kind, n, cores, step = task
            label = f"{kind}, n = {n:,}, {cores} core{'s' * (cores > 1)}, {step}"
            report.progress(f"run {repeat + 1}/{asked.repeats}, {at + 1}/{len(tasks)}: {label}")
            model = reduced.get((kind, n, cores, step.removeprefix("CEA "))) if step.startswith("CEA") else None
            if task in failed or (step in ("CEA HCB", "CEA CC") and model is None):
                continue  # it, or its reduction, has failed
            if runs[task] and runs[task][0]["seconds"] > asked.long:
                continue
            try:
                if (kind, n) not in known:
                    known[kind, n] = fresh(models.reference, kind, n)
                result = fresh(measure, kind, step, n, known[kind, n], model, cores=cores)
            except (fs.FemsubError, MemoryError, BrokenProcessPool, ArithmeticError, np.linalg.LinAlgError) as error:
                failed[task] = f"{label}: {type(error).__name__}: {error}"
                continue
            if "reduced" in result:
                reduced[task] = result.pop("reduced")
            runs[task].append(result)
            if repeat == 0:
                print(f"{label}: {result['seconds']:.3g} s, {result['peak_mb']:.0f} MB", file=sys.stderr, flush=True)
    report.progress_done()
    rows = [summary(task, results) for task, results in runs.items() if results]
    dof = {(row["component"], row["n"]): row["dof"] for row in rows if row["dof"]}
    return [row | {"dof": dof.get((row["component"], row["n"]), row["n"])} for row in rows], list(failed.values())


def summary(task: tuple[str, int, int, str], results: list[Row]) -> Row:
    """Medians over the runs of one measurement, the spread of its seconds, its largest errors."""
    kind, n, cores, step = task
    seconds = [one["seconds"] for one in results]
    row: Row = {"component": kind, "n": n, "dof": results[0].get("dof"), "cores": cores, "step": step,
                "seconds": statistics.median(seconds), "seconds_least": min(seconds), "seconds_most": max(seconds),
                "runs": len(seconds)}
    row |= {key: statistics.median(one[key] for one in results) for key in ("peak_mb", "base_mb")}
    row |= {key: max((one[key] for one in results if key in one), default=None) for key in ("error", "residual")}
    return row | {"stable": results[-1].get("stable")}


def exponents(rows: list[Row]) -> list[Row]:
    """p of seconds ~ nᵖ, and of memory above the baseline, by least squares in logarithms, for each component, number of
    cores and step; `large` begins at the same size for all, and beams have no more than a factor of 2 there."""
    def power(points: list[tuple[int, float]]) -> float | None:
        x, y = np.log(np.array(points or [(1, 1)])).T
        return float(np.polyfit(x, y, 1)[0]) if len(points) > 1 else None

    result = []
    for kind, cores, step in dict.fromkeys((row["component"], row["cores"], row["step"]) for row in rows):
        fit: Row = {"component": kind, "cores": cores, "step": step}
        for name, least in (("large", LARGE), ("all", 0)):
            mine = [row for row in rows if (row["component"], row["cores"], row["step"]) == (kind, cores, step)
                    and row["n"] >= least]
            for key in ("seconds", "seconds_least"):
                fit[f"{key}, {name}"] = power([(row["dof"], row[key]) for row in mine])
            above = [(row["dof"], row["peak_mb"] - row["base_mb"]) for row in mine]
            fit[f"memory, {name}"] = power([point for point in above if point[1] > 1])  # less is the allocator's slack
        result.append(fit)
    return result


def requirement(rows: list[Row], fits: list[Row]) -> list[str]:
    """A line for each of HCB and CC of the chain against LIMITS, where enough was measured: 5 runs, 5 sizes up to 10⁶."""
    lines = []
    for fit in fits:
        mine = [row for row in rows if row["component"] == fit["component"] == "chain" and row["cores"] == fit["cores"]
                and row["step"] == fit["step"] in METHODS and row["n"] >= LARGE and row["runs"] >= 5]
        if len(mine) >= 5 and mine[-1]["n"] >= models.KINDS["chain"].sizes[-1]:
            power, peak = fit["seconds, large"], max(row["peak_mb"] for row in mine)
            met = power <= LIMITS["exponent"] and peak < LIMITS["peak_mb"]
            lines.append(f"chain, {fit['step']}, cores: {fit['cores']}, from 10^4 on: seconds ~ n^{power:.2f} (limit "
                         f"{LIMITS['exponent']}), at most {peak:.0f} MB (limit {LIMITS['peak_mb']:.0f}): "
                         f"{'met' if met else 'NOT MET'}")
    return lines


def text(rows: list[Row], fits: list[Row]) -> str:
    """The two tables for the terminal."""
    columns = [("component", "component", ""), ("DOF", "dof", ",d"), ("cores", "cores", "d"), ("step", "step", ""),
               ("seconds", "seconds", ".3g"), ("least", "seconds_least", ".3g"), ("most", "seconds_most", ".3g"),
               ("runs", "runs", "d"), ("peak MB", "peak_mb", ".0f"), ("baseline", "base_mb", ".0f"),
               ("error", "error", ".1e"), ("residual", "residual", ".1e"), ("stable", "stable", "")]
    heads, keys, forms = (list(part) for part in zip(*columns, strict=True))
    shown = table(heads, [[row[key] for key in keys] for row in rows], forms, keys=4, none="not measured, or not known")
    heads = ["growth ~ n^p", "cores", "step", "n >= 10^4: seconds", "least", "memory", "all n: seconds", "least", "memory"]
    return f"{shown}\n\n" + table(heads, [list(fit.values()) for fit in fits], ["", "d", "", *[".2f"] * 6], keys=3,
                                none="too few sizes")


def draw(rows: list[Row], fits: list[Row]) -> Any:
    """Seconds (least to most as bars) above, peak memory below, one column for each component, all axes logarithmic."""
    hcb, cc = (look(key) for key in ("craig-bampton", "craig-chang"))
    dots = (0, (1, 1.5))  # what is solved after a reduction
    looks = {"assembly": ("0.55", "v", "-"), "HCB": (hcb.colour, hcb.marker, "-"), "CC": (cc.colour, cc.marker, "-"),
             "CEA full": ("black", "o", "-"), "CEA HCB": (hcb.colour, "x", dots), "CEA CC": (cc.colour, "+", dots)}
    told = {"HCB": f"reduce: {hcb.label}", "CC": f"reduce: {cc.label}", "CEA full": "solve: full model",
            "CEA HCB": f"solve: {hcb.label}", "CEA CC": f"solve: {cc.label}"}
    kinds, cores = (list(dict.fromkeys(row[key] for row in rows)) for key in ("component", "cores"))
    figure = new_figure(PAGE if len(kinds) > 1 else 0.7 * PAGE, 7.0)
    panels = figure.subplots(2, len(kinds), sharex=True, sharey="row", squeeze=False)
    for (times, memory), kind in zip(panels.T, kinds, strict=True):
        lines = [f"{told[fit['step']]} {fit['seconds, large']:.2f}" for fit in fits if fit["seconds, large"] is not None
                 and fit["component"] == kind and fit["cores"] == max(cores) and fit["step"] in ("HCB", "CC", "CEA full")]
        for fit in (fit for fit in fits if fit["component"] == kind):
            mine = [row for row in rows if all(row[key] == fit[key] for key in ("component", "cores", "step"))]
            colour, marker, line = looks[fit["step"]]
            dof, least, middle, most, peak = np.array([[row[key] for key in (
                "dof", "seconds_least", "seconds", "seconds_most", "peak_mb")] for row in mine]).T
            most_cores = fit["cores"] == max(cores)
            style = {"color": colour, "marker": marker, "markersize": 5, "lw": 1.3, "linestyle": line,
                     "alpha": 1.0 if most_cores else 0.4, "zorder": 2 + most_cores}
            times.errorbar(dof, middle, [middle - least, most - middle], capsize=2, **style)[0].set_label(fit["step"])
            memory.plot(dof, peak, label=fit["step"], **style)
        times.set(xscale="log", yscale="log", title=kind)
        if lines:
            times.annotate("p of $n^p$ from $10^4$ on:\n" + "\n".join(lines), (0.04, 0.96), xycoords="axes fraction", va="top",
                           fontsize=8)
        memory.set(yscale="log", xlabel="DOF n  [-]")
        if kind == "chain":
            memory.axhline(LIMITS["peak_mb"], color="0.3", ls=(0, (1, 3)))
            memory.annotate("limit of both reductions", (0.03, LIMITS["peak_mb"]), xycoords=("axes fraction", "data"), va="top",
                            textcoords="offset points", xytext=(0, -3), fontsize=8, color="0.3")
        for panel in (times, memory):
            panel.grid(alpha=0.3)
    panels[0, 0].set_ylabel("run time, median; bars: least to most  [s]")
    panels[1, 0].set_ylabel("peak resident memory  [MB]")
    shown = [step for step in looks if step in {row["step"] for row in rows}]
    empty = panels[0, 0]
    keys = [empty.plot([], [], color=colour, marker=marker, ls=line, markersize=5)[0]
            for colour, marker, line in map(looks.get, shown)]
    names = [told.get(step, step) for step in shown]
    if len(cores) > 1:
        keys += [empty.plot([], [], color="0.3", alpha=1.0 if many == max(cores) else 0.4)[0] for many in cores]
        names += [f"{many} core{'s' * (many > 1)}{'' if many == max(cores) else ' (pale)'}" for many in cores]
    figure.legend(keys, names, loc="outside lower center", ncols=3)
    return figure


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    kinds = list(models.KINDS)
    parser.add_argument("--components", nargs="+", choices=kinds, default=kinds, metavar="NAME", help="default: all four")
    parser.add_argument("--cores", nargs="+", type=int, default=[1, 2], metavar="N", help="threads of BLAS (default 1 2)")
    parser.add_argument("--steps", nargs="+", choices=STEPS, metavar="STEP", help=f"of {', '.join(STEPS)} (default: all)")
    parser.add_argument("--largest", type=int, metavar="N", help="most DOF (default: 10^6; beam 20,000, plate 300,000)")
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="runs of each measurement (default 5)")
    parser.add_argument("--long", type=float, default=60.0, metavar="SECONDS",
                        help="what takes longer is measured once (default 60)")
    parser.add_argument("--out", type=Path, default=Path("out/scaling"), metavar="DIR",
                        help="output folder (default out/scaling)")
    parser.add_argument("--redraw", action="store_true", help="draw scaling.png again from the scaling.json in the output folder")
    asked = parser.parse_args()
    if asked.redraw:
        if not (asked.out / "scaling.json").exists():
            parser.error(f"--redraw: there is no scaling.json in {asked.out}")
        told = json.loads((asked.out / "scaling.json").read_text(encoding="utf-8"))
        save(asked.out / "scaling.png", lambda: draw(told["rows"], told["exponents"]))
        return 0
    if asked.repeats < 1 or min(asked.cores) < 1 or (asked.largest is not None and asked.largest < 10):
        parser.error("--largest must be at least 10, --repeats and --cores at least 1")
    try:
        report.check_folder(str(asked.out))  # to know it now and not at the end
    except fs.InputError as error:
        parser.error(str(error))
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # leave in order, or the process that measures stays behind
    computers = {cores: fresh(machine, cores=cores) for cores in asked.cores}
    rows, failed = run(asked)
    fits = exponents(rows)
    checks = requirement(rows, fits)
    data = {"machine": computers, "modes": {kind: models.KINDS[kind].modes for kind in asked.components},
            "damping": models.DAMPING, "large": LARGE, "rows": rows, "exponents": fits, "requirement": checks, "failed": failed}
    result = Result(data, [text(rows, fits), Table("scaling", rows)])
    print(result.text(), *checks, *(f"failed: {line}" for line in failed), sep="\n")
    report.write(result, asked.out, figures=False, name="scaling")
    if rows:
        save(asked.out / "scaling.png", lambda: draw(rows, fits))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
