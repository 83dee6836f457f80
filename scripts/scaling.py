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
import csv
import json
import os
import platform
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

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # runs from a bare checkout too

SIZES = (10, 100, 1_000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
STEPS = ("assembly", "HCB", "CC", "CEA full", "CEA HCB", "CEA CC")
MODES, DAMPING = 20, 0.1
FIT_FROM = 10_000  # below it fixed costs rule
LIMITS = {"exponent": 1.25, "peak_mb": 4000.0}  # what HCB and CC are held to at 10⁶ masses
Row = dict[str, Any]


def half_slope(n: int) -> float:
    """Half of the largest slope at which one of the 20 lowest pairs loses its stability."""
    import femsub as fs

    if n <= 10_000:
        band = (0.0, float(fs.chain_frequencies(n, min(MODES, n))[-1]))
        return fs.critical_slope(fs.chain(n, belt=2, damping=DAMPING), band=band).slope / 2
    # First order in the damping: mode j moves m_k by sin(kθ_j), θ_j = (2j - 1)π/(2n + 1), and decays while
    # d1 sin²θ_j + c sin²2θ_j > 0, that is c > -d1/(4 cos²θ_j). At n = 10⁴ the exact value agrees to 6e-11.
    return -DAMPING / (4 * np.cos(np.pi / (2 * n + 1)) ** 2) / 2


def _peak_mb() -> float:
    """The largest resident memory of this process so far, in 10⁶ bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e6


def measure(step: str, n: int, slope: float, reduced: tuple[np.ndarray, ...] | None) -> Row:
    """One step at one size, to be run in a fresh process; `reduced` is (M, K, D, w) of the model a CEA is asked of.

    Returns
    -------
    dict
        seconds; peak_mb, and base_mb before the step's own data; frequency_error, the largest relative one against
        2 sin((2j-1)π/(4n+2)); for a reduction also its matrices, for a CEA its largest backward error and verdict.
    """
    import femsub as fs

    # The belt at m2 is outside the interface {m1} on purpose, as in the paper; the chain scene shows what that costs.
    warnings.simplefilter("ignore", fs.PortWarning)
    for size in (20, 200):  # one below, one above the size from which sparse solvers are taken
        fs.complex_modes(fs.reduce(fs.chain(size, belt=2), fs.CraigBampton(modes=3)), count=2)
        fs.complex_modes(fs.chain(size, belt=2), count=2)
    belt = fs.Belt(slope=slope)
    result: Row = {"base_mb": _peak_mb()}
    if step == "assembly":
        start = time.perf_counter()
        fs.chain(n, belt=2, damping=DAMPING)
    elif step in ("HCB", "CC"):
        method = (fs.CraigBampton if step == "HCB" else fs.CraigChang)(modes=min(MODES, n - 1))
        sub = fs.chain(n, belt=2, damping=DAMPING)
        start = time.perf_counter()
        rom = fs.reduce(sub, method)
    else:
        model = fs.chain(n, belt=2, damping=DAMPING) if reduced is None else \
            fs.Substructure(*reduced[:3], ports={"belt": reduced[3]})
        start = time.perf_counter()
        modes = fs.complex_modes(model, belt, count=min(MODES, 2 * model.size))
    result |= {"seconds": time.perf_counter() - start, "peak_mb": _peak_mb()}
    if step in ("HCB", "CC"):
        kept = [i for i, kind in enumerate(rom.kinds) if kind in ("fixed-interface", "free")]
        # With m1 held, what vibrates is a chain of n - 1 masses.
        exact = fs.chain_frequencies(n - 1 if step == "HCB" else n, len(kept))
        result["frequency_error"] = _largest_error(np.sqrt(rom.K[kept, kept]), exact)
        result["reduced"] = (rom.M, rom.K, rom.D, rom.port("belt"))
    elif step != "assembly":
        told = {True: "yes", False: "NO", None: "undecided"}  # within the error bars
        result |= {"backward_error": float(modes.backward_error.max()), "stable": told[modes.is_stable]}
        if n >= FIT_FROM:  # there the dashpot shifts the frequencies by 5e-12 and less
            found = np.sort(modes.eigenvalues.imag[modes.eigenvalues.imag > 0])
            result["frequency_error"] = _largest_error(found, fs.chain_frequencies(n, len(found)))
    return result


def _largest_error(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.max(np.abs(found / exact - 1)))


def machine() -> Row:
    """Processor, cores, threads and versions, in a process that has loaded everything."""
    import ctypes

    import scipy

    import femsub as fs
    from femsub._slepc import versions

    fs.complex_modes(fs.chain(200), count=2)
    info, maps = ([line.rstrip() for line in path.read_text().splitlines()] if path.exists() else []
                  for path in (Path("/proc/cpuinfo"), Path("/proc/self/maps")))
    models = [line.split(":", 1)[1].strip() for line in info if line.startswith("model name")]
    threads = {}
    for library in sorted({Path(line.split()[-1]) for line in maps if "openblas" in line.rpartition("/")[2]}):
        for name in ("openblas_get_num_threads", "openblas_get_num_threads64_", "scipy_openblas_get_num_threads"):
            if hasattr(loaded := ctypes.CDLL(str(library)), name):
                threads[library.name] = getattr(loaded, name)()
    return {"processor": models[0] if models else platform.processor(), "cores": os.cpu_count(),
            "system": platform.platform(),
            "OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS"), "blas_threads": threads,
            "versions": {"femsub": fs.__version__, "Python": platform.python_version(), "NumPy": np.__version__,
                         "SciPy": scipy.__version__, **versions()}}


def fresh(task: Callable[..., Any], *args: Any) -> Any:
    """task(*args) in a process of its own. It is started by this one, which therefore must stay small: the peak of a
    child on Linux begins at the size of its parent."""
    with ProcessPoolExecutor(max_workers=1, mp_context=get_context("spawn")) as pool:
        return pool.submit(task, *args).result()


def run(sizes: list[int], repeats: int) -> tuple[list[Row], list[str]]:
    """All measurements: one row for each size and step, and what failed."""
    from femsub.errors import FemsubError

    slopes = {n: fresh(half_slope, n) for n in sizes}
    tasks = [(n, step) for n in sizes for step in STEPS]
    runs: dict[tuple[int, str], list[Row]] = {task: [] for task in tasks}
    reduced: dict[tuple[int, str], tuple[np.ndarray, ...]] = {}
    failed: dict[str, None] = {}
    for repeat in range(repeats):
        for at, (n, step) in enumerate(tasks if repeat % 2 == 0 else tasks[::-1]):
            _progress(f"run {repeat + 1}/{repeats}, {at + 1}/{len(tasks)}: n = {n:,}, {step}")
            model = reduced.get((n, step.removeprefix("CEA ")))
            if step in ("CEA HCB", "CEA CC") and model is None:
                continue  # its reduction has failed
            try:
                result = fresh(measure, step, n, slopes[n], model)
            except (FemsubError, MemoryError, BrokenProcessPool) as error:
                failed[f"n = {n:,}, {step}: {type(error).__name__}: {error}"] = None
                continue
            if "reduced" in result:
                reduced[n, step] = result.pop("reduced")
            runs[n, step].append(result)
    _progress("")
    return [_row(n, step, results) for (n, step), results in runs.items() if results], list(failed)


def _progress(text: str) -> None:
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)


def _row(n: int, step: str, results: list[Row]) -> Row:
    seconds, last = [one["seconds"] for one in results], results[-1]
    errors = [one["frequency_error"] for one in results if "frequency_error" in one]
    base, peak = (statistics.median(one[key] for one in results) for key in ("base_mb", "peak_mb"))
    return {"n": n, "step": step, "seconds": statistics.median(seconds), "seconds_min": min(seconds),
            "seconds_max": max(seconds), "peak_mb": peak, "base_mb": base,
            "frequency_error": max(errors, default=None), "backward_error": last.get("backward_error"),
            "stable": last.get("stable"), "runs": seconds}


def exponents(rows: list[Row]) -> dict[str, Row]:
    """p of seconds ~ nᵖ and of memory above the baseline ~ nᵖ, least squares in logarithms, by step."""
    result: dict[str, Row] = {}
    for step in STEPS:
        mine = [row for row in rows if row["step"] == step]
        result[step] = {}
        for name, least in (("from 10^4", FIT_FROM), ("all", 0)):
            fitted = [row for row in mine if row["n"] >= least]
            above = [(row["n"], row["peak_mb"] - row["base_mb"]) for row in fitted]
            result[step][f"seconds, {name}"] = _power([(row["n"], row["seconds"]) for row in fitted])
            result[step][f"memory, {name}"] = _power([point for point in above if point[1] > 1])  # less is slack
    return result


def _power(points: list[tuple[int, float]]) -> float | None:
    return float(np.polyfit(*np.log(np.array(points)).T, 1)[0]) if len(points) > 1 else None


def verdict(rows: list[Row], fits: dict[str, Row], repeats: int) -> list[str]:
    """One line for each of HCB and CC against LIMITS; none where too little was measured."""
    lines = []
    for step in ("HCB", "CC"):
        sizes = [row["n"] for row in rows if row["step"] == step and row["n"] >= FIT_FROM]
        if repeats >= 5 and len(sizes) >= 5 and max(sizes) >= 1_000_000:
            peak = max(row["peak_mb"] for row in rows if row["step"] == step)
            power = fits[step]["seconds, from 10^4"]
            met = power <= LIMITS["exponent"] and peak < LIMITS["peak_mb"]
            lines.append(f"{step}: time ~ n^{power:.2f} (limit {LIMITS['exponent']}), at most {peak / 1000:.2f} GB "
                         f"(limit {LIMITS['peak_mb'] / 1000:g}): {'met' if met else 'NOT MET'}")
    return lines


def table(rows: list[Row], fits: dict[str, Row]) -> str:
    """What is printed: a line for each size and step, then the exponents."""
    def number(value: float | None, form: str) -> str:
        return "-" if value is None else format(value, form)

    lines = [f"{'masses':>9}  {'step':<9}{'seconds':>10}  {'(least to most)':<21}{'peak MB':>8}{'baseline':>10}"
             f"{'freq. error':>13}{'backw. error':>14}  stable"]
    for row in rows:
        spread = f"({row['seconds_min']:.3g} to {row['seconds_max']:.3g})"
        lines.append(f"{row['n']:>9,}  {row['step']:<9}{row['seconds']:>10.3g}  {spread:<21}{row['peak_mb']:>8.0f}"
                     f"{row['base_mb']:>10.0f}{number(row['frequency_error'], '.1e'):>13}"
                     f"{number(row['backward_error'], '.1e'):>14}  {row['stable'] or '-'}")
    heads = list(next(iter(fits.values())))
    lines += ["", f"{'exponents':<12}" + "".join(f"{head:>20}" for head in heads)]
    for step, fit in fits.items():
        lines.append(f"{step:<12}" + "".join(f"{number(fit[head], '.2f'):>20}" for head in heads))
    return "\n".join(lines)


def draw(path: Path, rows: list[Row], fits: dict[str, Row]) -> None:
    """Seconds (median, least to most) and peak memory over n, both axes logarithmic; exponents in the legends."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    looks = {"assembly": ("0.45", "o", "-"), "HCB": ("C0", "s", "-"), "CC": ("C1", "^", "-"),
             "CEA full": ("C3", "D", "-"), "CEA HCB": ("C0", "s", "--"), "CEA CC": ("C1", "^", ":")}
    figure, panels = plt.subplots(1, 2, figsize=(12, 6.2), layout="constrained")
    for panel, key, name in zip(panels, ("seconds", "peak_mb"), ("seconds", "memory"), strict=True):
        for step, (colour, marker, line) in looks.items():
            mine = [row for row in rows if row["step"] == step]
            if not mine:
                continue
            power = fits[step][f"{name}, from 10^4"]
            label = step if power is None else f"{step}  ($n^{{{power:.2f}}}$)"
            middle = np.array([row[key] for row in mine])
            spread = None
            if key == "seconds":
                spread = [middle - [row["seconds_min"] for row in mine], [row["seconds_max"] for row in mine] - middle]
            panel.errorbar([row["n"] for row in mine], middle, spread, color=colour, marker=marker, linestyle=line,
                           label=label, markersize=5, capsize=2, markerfacecolor=colour if line == "-" else "none")
        panel.set(xscale="log", yscale="log", xlabel="masses n")
        panel.grid(True, which="major", alpha=0.3)
    base, most = statistics.median(row["base_mb"] for row in rows), max(row["peak_mb"] for row in rows)
    panels[1].axhline(base, color="0.6", linewidth=1, zorder=0, label=f"packages loaded ({base:.0f} MB)")
    panels[1].axhline(LIMITS["peak_mb"], color="k", linestyle=(0, (1, 3)), linewidth=1, label="limit for HCB and CC")
    panels[0].set(ylabel="seconds (median; bars: least to most)", title="Time")
    panels[1].set(ylabel="peak resident memory in MB", title="Memory")
    panels[1].set_ylim(base / 2, 1.5 * max(most, LIMITS["peak_mb"]))
    for panel, what in zip(panels, ("growth", "growth above the baseline"), strict=True):
        panel.legend(loc="upper center", bbox_to_anchor=(0.5, -0.11), ncols=3, fontsize=9, title_fontsize=9,
                     title=f"in brackets: {what} from $n = 10^4$ on")
    figure.suptitle("Chain, belt under m2 at half of its critical slope: 20 modes in HCB and CC, 20 eigenvalues in CEA")
    figure.savefig(path, dpi=130, format="png")
    plt.close(figure)


def write(path: Path, content: Callable[[Path], None]) -> None:
    """Writes beside the file and renames, so that a file is there whole or not at all."""
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        content(draft)
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def _csv(path: Path, rows: list[Row]) -> None:
    with path.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, [key for key in rows[0] if key != "runs"], extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--largest", type=int, default=SIZES[-1], metavar="N", help="most masses (default 10⁶)")
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="runs of each measurement (default 5)")
    parser.add_argument("--out", type=Path, default=Path("out/scaling"), metavar="DIR", help="default out/scaling")
    asked = parser.parse_args()
    if asked.largest < SIZES[0] or asked.repeats < 1:
        parser.error(f"--largest must be at least {SIZES[0]}, --repeats at least 1")
    try:
        asked.out.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=asked.out).close()
    except OSError as error:
        parser.error(f"cannot write to {asked.out}: {error.strerror}")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # leave in order, or the process that measures stays behind
    computer = fresh(machine)
    rows, failed = run([n for n in SIZES if n < asked.largest] + [asked.largest], asked.repeats)
    fits = exponents(rows)
    checks = verdict(rows, fits, asked.repeats)
    print(table(rows, fits), *checks, *(f"failed: {line}" for line in failed), sep="\n")
    report = {"machine": computer, "repeats": asked.repeats, "modes": MODES, "damping": DAMPING, "rows": rows,
              "exponents": fits, "requirement": checks, "failed": failed}
    text = json.dumps(report, indent=1, ensure_ascii=False) + "\n"
    write(asked.out / "scaling.csv", lambda path: _csv(path, rows))
    write(asked.out / "scaling.json", lambda path: path.write_text(text, encoding="utf-8"))
    write(asked.out / "scaling.png", lambda path: draw(path, rows, fits))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
