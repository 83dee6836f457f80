#!/usr/bin/env python3
"""Seconds and memory over size: the chain of 10 to 10⁶ masses, belt under m2 at half of its critical slope.

    python scripts/scaling.py [--largest N] [--repeats N] [--out DIR]

Measured are the assembly, HCB and CC (interface {m1}, 20 modes each) and the CEA (20 eigenvalues nearest to 0) of the
full model by PEP and of both reduced ones. Each measurement has a process of its own, so that the peak of its resident
memory is its own; packages are loaded, and a tiny problem solved, before the clock starts. Medians over the repeats,
whose order alternates. Written are scaling.csv, scaling.json and scaling.png.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import resource
import signal
import statistics
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # a bare checkout will do
import femsub as fs
from femsub import report
from femsub.scene import Result

SIZES = (10, 100, 1_000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
STEPS = ("assembly", "HCB", "CC", "CEA full", "CEA HCB", "CEA CC")
METHODS: dict[str, Any] = {"HCB": fs.CraigBampton, "CC": fs.CraigChang}
MODES, DAMPING = 20, 0.1
LARGE = 10_000  # below it fixed costs rule
LIMITS = {"exponent": 1.25, "peak_mb": 4000.0}  # what HCB and CC are held to at 10⁶ masses
Row = dict[str, Any]


def half_slope(n: int) -> float:
    """Half of the largest slope at which one of the 20 lowest pairs loses its stability."""
    if n <= LARGE:
        band = (0.0, float(fs.chain_frequencies(n, min(MODES, n))[-1]))
        return fs.critical_slope(fs.chain(n, belt=2, damping=DAMPING), band=band).slope / 2
    # First order in the damping: mode j moves m_k by sin(kθ_j), θ_j = (2j - 1)π/(2n + 1), and decays while
    # d1 sin²θ_j + c sin²2θ_j > 0, that is c > -d1/(4 cos²θ_j). At n = 10⁴ the exact value agrees to 6e-11.
    return -DAMPING / (4 * np.cos(np.pi / (2 * n + 1)) ** 2) / 2


def peak_mb() -> float:
    """The largest resident memory of this process so far, in 10⁶ bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e6


def largest_error(found: np.ndarray, exact: np.ndarray) -> float:
    """The largest relative one."""
    return float(np.max(np.abs(found / exact - 1)))


def warm_up() -> None:
    """Loads everything, below and above the size from which the sparse solvers are taken."""
    # The belt at m2 is outside the interface {m1} on purpose, as in the paper; the scene chain shows what that costs.
    warnings.simplefilter("ignore", fs.PortWarning)
    for size in (20, 200):
        fs.complex_modes(fs.reduce(fs.chain(size, belt=2), fs.CraigBampton(modes=3)), count=2)
        fs.complex_modes(fs.chain(size, belt=2), count=2)


def measure(step: str, n: int, slope: float, reduced: tuple[np.ndarray, ...] | None) -> Row:
    """One step at one size, to be run in a fresh process; `reduced` is (M, K, D, w) of the model a CEA is asked of.

    Returns
    -------
    dict
        seconds; peak_mb, and base_mb before the model is built; frequency_error, the largest relative one against
        2 sin((2j-1)π/(4n+2)); for a reduction also its matrices, for a CEA its largest backward error and verdict.
    """
    warm_up()
    result: Row = {"base_mb": peak_mb()}
    if step == "assembly":
        start = time.perf_counter()
        fs.chain(n, belt=2, damping=DAMPING)
        return result | {"seconds": time.perf_counter() - start, "peak_mb": peak_mb()}
    if reduced is None:
        model = fs.chain(n, belt=2, damping=DAMPING)
    else:
        mass, stiffness, damping, w = reduced
        model = fs.Substructure(mass, stiffness, damping, ports={"belt": w})
    if step in METHODS:
        start = time.perf_counter()
        rom = fs.reduce(model, METHODS[step](modes=min(MODES, n - 1)))
        result |= {"seconds": time.perf_counter() - start, "peak_mb": peak_mb()}
        kept = [i for i, kind in enumerate(rom.kinds) if kind in ("fixed-interface", "free")]
        exact = fs.chain_frequencies(n - 1 if step == "HCB" else n, len(kept))  # with m1 held, n - 1 masses vibrate
        return result | {"frequency_error": largest_error(np.sqrt(rom.K[kept, kept]), exact),
                         "reduced": (rom.M, rom.K, rom.D, rom.port("belt"))}
    start = time.perf_counter()
    modes = fs.complex_modes(model, fs.Belt(slope=slope), count=min(MODES, 2 * model.size))
    result |= {"seconds": time.perf_counter() - start, "peak_mb": peak_mb()}
    if n >= LARGE:  # there the dashpot shifts the frequencies by 5e-12 and less
        found = np.sort(modes.eigenvalues.imag[modes.eigenvalues.imag > 0])
        result["frequency_error"] = largest_error(found, fs.chain_frequencies(n, len(found)))
    verdict = {True: "yes", False: "NO", None: "undecided"}[modes.is_stable]  # within the error bars
    return result | {"backward_error": float(modes.backward_error.max()), "stable": verdict}


def machine() -> Row:
    """Processor, cores, versions, and how many threads each BLAS has, when everything is loaded."""
    warm_up()
    threads, maps = {}, Path("/proc/self/maps")
    loaded = maps.read_text().splitlines() if maps.exists() else []
    for library in sorted({Path(line.split()[-1]) for line in loaded if "openblas" in line.rpartition("/")[2]}):
        for name in ("openblas_get_num_threads", "openblas_get_num_threads64_", "scipy_openblas_get_num_threads"):
            if hasattr(handle := ctypes.CDLL(str(library)), name):
                threads[library.name] = getattr(handle, name)()
    return report.machine() | {"femsub": fs.__version__, "OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS"),
                               "blas_threads": threads}


def fresh(task: Callable[..., Any], *args: Any) -> Any:
    """task(*args) in a process of its own. It is started by this one, which therefore must stay small: on Linux the
    peak of a child begins at the size of its parent."""
    with ProcessPoolExecutor(max_workers=1, mp_context=get_context("spawn")) as pool:
        return pool.submit(task, *args).result()


def run(sizes: list[int], repeats: int) -> tuple[list[Row], list[str]]:
    """All measurements: one row for each size and step, and what failed."""
    slopes = {n: fresh(half_slope, n) for n in sizes}
    tasks = [(n, step) for n in sizes for step in STEPS]
    runs: dict[tuple[int, str], list[Row]] = {task: [] for task in tasks}
    reduced: dict[tuple[int, str], tuple[np.ndarray, ...]] = {}
    failed: dict[str, None] = {}
    for repeat in range(repeats):
        for at, (n, step) in enumerate(tasks if repeat % 2 == 0 else tasks[::-1]):
            report.progress(f"run {repeat + 1}/{repeats}, {at + 1}/{len(tasks)}: n = {n:,}, {step}")
            model = reduced.get((n, step.removeprefix("CEA "))) if step.startswith("CEA") else None
            if step in ("CEA HCB", "CEA CC") and model is None:
                continue  # its reduction has failed
            try:
                result = fresh(measure, step, n, slopes[n], model)
            except (fs.FemsubError, MemoryError, BrokenProcessPool) as error:
                failed[f"n = {n:,}, {step}: {type(error).__name__}: {error}"] = None
                continue
            if "reduced" in result:
                reduced[n, step] = result.pop("reduced")
            runs[n, step].append(result)
    report.progress_done()
    return [summary(n, step, results) for (n, step), results in runs.items() if results], list(failed)


def summary(n: int, step: str, results: list[Row]) -> Row:
    """Medians over the runs of one measurement, the spread of its seconds, its largest errors."""
    seconds = [one["seconds"] for one in results]
    row: Row = {"n": n, "step": step, "seconds": statistics.median(seconds), "seconds_least": min(seconds),
                "seconds_most": max(seconds), "runs": len(seconds)}
    row |= {key: statistics.median(one[key] for one in results) for key in ("peak_mb", "base_mb")}
    for key in ("frequency_error", "backward_error"):
        row[key] = max((one[key] for one in results if key in one), default=None)
    return row | {"stable": results[-1].get("stable")}


def exponents(rows: list[Row]) -> list[Row]:
    """p of seconds ~ nᵖ, and of memory above the baseline, by least squares in logarithms, for each step."""
    def power(points: list[tuple[int, float]]) -> float | None:
        x, y = np.log(np.array(points or [(1, 1)])).T
        return float(np.polyfit(x, y, 1)[0]) if len(points) > 1 else None

    result = []
    for step in STEPS:
        fit: Row = {"step": step}
        for name, least in (("large", LARGE), ("all", 0)):
            mine = [row for row in rows if row["step"] == step and row["n"] >= least]
            for key in ("seconds", "seconds_least"):
                fit[f"{key}, {name}"] = power([(row["n"], row[key]) for row in mine])
            above = [(row["n"], row["peak_mb"] - row["base_mb"]) for row in mine]
            fit[f"memory, {name}"] = power([point for point in above if point[1] > 1])  # less is the allocator's slack
        result.append(fit)
    return result


def requirement(rows: list[Row], fits: list[Row]) -> list[str]:
    """A line for each of HCB and CC against LIMITS, where enough was measured: 5 runs, 5 sizes from 10⁴ to 10⁶."""
    lines = []
    for fit in fits:
        mine = [row for row in rows if row["step"] == fit["step"] in METHODS and row["n"] >= LARGE and row["runs"] >= 5]
        if len(mine) >= 5 and mine[-1]["n"] >= SIZES[-1]:
            power, peak = fit["seconds, large"], max(row["peak_mb"] for row in mine)
            met = power <= LIMITS["exponent"] and peak < LIMITS["peak_mb"]
            lines.append(f"{fit['step']} from 10^4 on: seconds ~ n^{power:.2f} (limit {LIMITS['exponent']}), at most "
                         f"{peak:.0f} MB (limit {LIMITS['peak_mb']:.0f}): {'met' if met else 'NOT MET'}")
    return lines


def text(rows: list[Row], fits: list[Row]) -> str:
    """The two tables for the terminal."""
    columns = [("masses", "n", ",d"), ("step", "step", ""), ("seconds", "seconds", ".3g"),
               ("least", "seconds_least", ".3g"), ("most", "seconds_most", ".3g"), ("peak MB", "peak_mb", ".0f"),
               ("baseline", "base_mb", ".0f"), ("freq. error", "frequency_error", ".1e"),
               ("backw. error", "backward_error", ".1e"), ("stable", "stable", "")]
    heads, keys, forms = (list(part) for part in zip(*columns, strict=True))
    table = report.table(heads, [[row[key] for key in keys] for row in rows], forms)
    heads = ["growth ~ n^p", "n >= 10^4: seconds", "least", "memory", "all n: seconds", "least", "memory"]
    return f"{table}\n\n" + report.table(heads, [list(fit.values()) for fit in fits], ["", *[".2f"] * 6])


def draw(rows: list[Row], fits: list[Row]) -> Any:
    """Seconds (median, least to most) and peak memory over n, both axes logarithmic; exponents in the legends."""
    from femsub.figures import COLOURS, new_figure

    hcb, cc = COLOURS["craig-bampton"], COLOURS["craig-chang"]
    looks = {"assembly": ("0.55", "v", "-"), "HCB": (hcb, "s", "-"), "CC": (cc, "^", "-"),
             "CEA full": (COLOURS["full"], "o", "-"), "CEA HCB": (hcb, "s", "--"), "CEA CC": (cc, "^", ":")}
    figure = new_figure(12, 6.4)
    panels = figure.subplots(1, 2)
    for panel, key, name in zip(panels, ("seconds", "peak_mb"), ("seconds", "memory"), strict=True):
        for fit in fits:
            mine = [row for row in rows if row["step"] == fit["step"]]
            colour, marker, line = looks[fit["step"]]
            power = fit[f"{name}, large"]
            middle = np.array([row[key] for row in mine])
            spread = None
            if key == "seconds":
                least, most = (np.array([row[f"seconds_{end}"] for row in mine]) for end in ("least", "most"))
                spread = [middle - least, most - middle]
            panel.errorbar([row["n"] for row in mine], middle, spread, color=colour, marker=marker,
                           linestyle=line, markersize=5, capsize=2, markerfacecolor=colour if line == "-" else "none",
                           label=fit["step"] + ("" if power is None else f"  ($n^{{{power:.2f}}}$)"))
        panel.set(xscale="log", yscale="log", xlabel="number of masses n")
        panel.grid(alpha=0.3)
    base, top = statistics.median(row["base_mb"] for row in rows), max(row["peak_mb"] for row in rows)
    panels[1].axhline(base, color="0.6", lw=1, zorder=0, label=f"packages loaded ({base:.0f} MB)")
    panels[1].axhline(LIMITS["peak_mb"], color="#b00000", ls=(0, (1, 3)), label="limit for HCB and CC")
    panels[0].set(title="time", ylabel="seconds  (median; bars: least to most)")
    panels[1].set(title="memory", ylabel="peak resident memory  [MB]")
    panels[1].set_ylim(base / 2, 1.5 * max(top, LIMITS["peak_mb"]))
    for panel, what in zip(panels, ("growth", "growth above the baseline"), strict=True):
        panel.legend(loc="upper center", bbox_to_anchor=(0.5, -0.11), ncols=3, fontsize=9, title_fontsize=9,
                     title=f"in brackets: {what} from $n = 10^4$ on")
    figure.suptitle("Chain, belt under m2 at half of its critical slope: 20 modes in HCB and CC, 20 eigenvalues in CEA")
    return figure


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--largest", type=int, default=SIZES[-1], metavar="N", help="most masses (default 1000000)")
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="runs of each measurement (default 5)")
    parser.add_argument("--out", type=Path, default=Path("out/scaling"), metavar="DIR",
                        help="output folder (default out/scaling)")
    asked = parser.parse_args()
    if asked.largest < SIZES[0] or asked.repeats < 1:
        parser.error(f"--largest must be at least {SIZES[0]}, --repeats at least 1")
    try:
        asked.out.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=asked.out).close()  # to know it now and not at the end
    except OSError as error:
        parser.error(f"the output folder {asked.out} cannot be written: {error.strerror}")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # leave in order, or the process that measures stays behind
    computer = fresh(machine)
    rows, failed = run([n for n in SIZES if n < asked.largest] + [asked.largest], asked.repeats)
    fits = exponents(rows)
    checks = requirement(rows, fits)
    data = {"machine": computer, "modes": MODES, "damping": DAMPING, "large": LARGE, "rows": rows, "exponents": fits,
            "requirement": checks, "failed": failed}
    result = Result(data, rows, text(rows, fits), {"scaling": lambda: draw(rows, fits)})
    print(result.text, *checks, *(f"failed: {line}" for line in failed), sep="\n")
    report.write(result, asked.out, figures=True, name="scaling")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
