#!/usr/bin/env python3
"""Ratios on solid components: assembly against scikit-fem, HCB bases against SciPy and plain SLEPc, reduced CEA against PEP.

    python scripts/bench.py [--parts assembly bases cea] [--component slab bulk disc] [--dof N ...] [--modes N ...]
                            [--only METHOD ...] [--defaults] [--limit SECONDS] [--repeats N] [--out DIR] [--quick]

assembly  K and M against scikit-fem's `linear_elasticity` and a vector mass form (with its Basis), at the same points.
bases     All constraint modes and 40 fixed-interface modes, with the reduced M and K. `reduce` finds and certifies them. What
          users have today is compared with it:
          - SciPy's `eigsh(sigma=0)` with MKL's Pardiso (the extra `pardiso`), and with SuperLU and its options for symmetric
            matrices. --defaults adds SuperLU with the options that `splu` has by itself.
          - SLEPc as it comes, with CHOLMOD and MUMPS: one factor in Krylov-Schur and in a KSP that solves column by column.
          - PRIMME (the extra `primme`) with the factor of Pardiso, or of SuperLU without it, as its preconditioner, and with
            that of CHOLMOD.
          - Automated multilevel substructuring alone (AMLS): parts to 3 times the highest frequency, no refinement, no count.
          Only `reduce` counts the modes by a second factorisation; ratios are given with it and without it. The error is
          the largest of ω against femsub's certified frequencies. A mode is missed if no frequency lies within 1 % of it.
cea       One sweep over 100 slopes on a reduced component against 100 quadratic problems (PEP) on the full one, of which 3
          are solved and their mean is taken for each of the 100.

What is compared is measured in one run, in alternating order, each time in a process of its own, so that the peak of its
resident memory is its own. Ratios are medians over the repeats, with the least and the most. Written are bench.csv and
bench.json. The parts need scikit-fem; bases needs slepc4py for itself, too.

Each measurement of bases is a line of DIR/measured.jsonl. The same call goes on where it was stopped, and what the folder has of
other cases is told as well. A measurement that takes longer than --limit, or more memory than there is, is told as such.
"""

from __future__ import annotations

import argparse
import os
import signal
import statistics
import sys
import tempfile
from concurrent.futures.process import BrokenProcessPool
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

import femsub as fs
from benchmarks import comparisons as tasks
from benchmarks.processes import Row, StoppedError, fresh, machine, watched
from benchmarks.users import Case, Journal, compared
from femsub.algebra.petsc import has_cholmod
from femsub.app import report
from femsub.app.scene import Result
from femsub.studies.tables import Table, table

PARTS = ("assembly", "bases", "cea")
SIZES: dict[bool, Row] = {  # by --quick: bricks, nodes of the interface, modes
    False: {"assembly": {"hexahedron20": (40, 20, 10), "hexahedron27": (30, 16, 8)},
            "slab": (90, 58, 6), "bulk": (40, 20, 10), "disc": 0.0085, "interface": 84, "modes": 40,
            "cea": (24, 16, 4), "band": 12, "kept": (12, 16, 20, 25, 30, 40, 50, 60, 80)},
    True: {"assembly": {"hexahedron20": (3, 2, 2)},
           "slab": (8, 6, 2), "bulk": (4, 3, 2), "disc": 0.04, "interface": 6, "modes": 6,
           "cea": (8, 4, 1), "band": 4, "kept": (4, 8, 16)}}
SOLVED = [0, 50, 99]  # slopes at which the full model is solved
TIMES = {"assembly": 5.0, "SciPy": 6.0, "SciPy, MKL Pardiso": 3.0, "SLEPc": 1.5, "cea": 300.0}  # so many times faster is asked,
MEMORY = 0.5  # such a share of SciPy's memory,
PACKAGES = {"SciPy, MKL Pardiso": "pypardiso", "PRIMME": "primme", "PRIMME, CHOLMOD": "primme"}  # that methods need
ENTRIES, SAME = 1e-12, 1e-8  # and such an agreement of the entries and of the bases


class Bench:
    """The rows measured so far, what they are checked against, and what failed."""

    def __init__(self, repeats: int, quick: bool, folder: Path, limit: float) -> None:
        self.repeats, self.quick, self.folder, self.limit = repeats, quick, folder, limit
        self.rows: list[Row] = []
        self.checks: list[Row] = []
        self.failed: dict[str, None] = {}
        self.details: Row = {}

    def one(self, label: str, task: Any, *args: Any) -> Row | None:
        """One measurement in a process of its own, or None where it failed."""
        report.progress(label)
        try:
            return fresh(task, *args)
        except (fs.FemsubError, ImportError, MemoryError, BrokenProcessPool, RuntimeError) as error:
            self.failed[f"{label}: {type(error).__name__}: {error}"[:400]] = None
            return None

    def measured(self, label: str, journal: Journal, case: Case, method: str, turn: int) -> None:
        """One measurement of a basis, unless the journal has it or the method was stopped before."""
        if (case, method, turn) in journal.known or journal.ended(case, method):
            return
        values = journal.reference(case)[1]
        if method == tasks.FREQUENCIES and not len(values):
            self.failed[f"{label}: no other method has told the highest frequency that is wanted"] = None
            return
        report.progress(label)
        folder = journal.path.parent / "reference" / case.folder
        folder.mkdir(parents=True, exist_ok=True)
        try:
            row = watched(tasks.bases, method, *case, float(values[-1]) if len(values) else 0.0, folder if turn == 0 else None,
                          limit=self.limit)
        except (StoppedError, MemoryError) as error:
            row = {"ended": str(error) or "not enough memory"}
        except (fs.FemsubError, ImportError, RuntimeError) as error:
            self.failed[f"{label}: {type(error).__name__}: {error}"[:400]] = None
            return
        journal.add(case, method, turn, row)

    def alternating(self, label: str, measured: dict[str, tuple[Any, ...]]) -> dict[str, list[Row | None]]:
        """Each (task, arguments) so many times; the last argument is the folder where results meet, in the first run."""
        runs: dict[str, list[Row | None]] = {name: [] for name in measured}
        for repeat in range(self.repeats):
            for name in list(measured)[::1 if repeat % 2 == 0 else -1]:
                task, *args = measured[name]
                meeting = self.folder if repeat == 0 else None
                runs[name].append(self.one(f"{label}: {name}, run {repeat + 1} of {self.repeats}", task, *args, meeting))
        return runs

    def table(self, part: str, case: str, runs: dict[str, list[Row | None]], dof: dict[str, int] | int) -> dict[str, Row]:
        """A row for each method: medians, spread, memory, and how many times longer than the first one it takes."""
        first, rows = next(iter(runs)), {}
        for name, found in runs.items():
            done = [run for run in found if run]
            if not done:
                continue
            seconds = [run["seconds"] for run in done]
            row: Row = {"part": part, "case": case, "method": name, "dof": dof if isinstance(dof, int) else dof[name],
                        "runs": len(done), "seconds": statistics.median(seconds), "seconds_least": min(seconds),
                        "seconds_most": max(seconds)}
            row |= {key: statistics.median(run[key] for run in done) for key in ("peak_mb", "base_mb")}
            ratios = [run["seconds"] / ours["seconds"] for run, ours in zip(found, runs[first], strict=True) if run and ours]
            if ratios:  # each of one round, so that a slow spell of the machine hits both of its sides
                row |= {"times": statistics.median(ratios), "times_least": min(ratios), "times_most": max(ratios)}
            row["phases"] = {key: statistics.median(run["phases"][key] for run in done) for key in done[0].get("phases", {})}
            row |= {key: done[0][key] for key in ("residual", "factorisations") if key in done[0]}
            row |= {key: done[0][key] for key in done[0] if key.startswith("error")}
            rows[name] = row
        self.rows += rows.values()
        return rows

    def check(self, what: str, value: float, limit: float, form: str, least: bool = False, timed: bool = True) -> None:
        """A line of requirement; times and memory at the sizes of --quick say nothing, and are not judged."""
        met = None if timed and self.quick else bool(value >= limit if least else value <= limit)
        verdict = {True: "met", False: "NOT MET", None: "not judged at these sizes"}[met]
        self.checks.append({"what": what, "value": value, "limit": limit, "met": met, "timed": timed,
                            "text": f"{what} {form.format(value=value, limit=limit)}: {verdict}"})

    def faster(self, what: str, row: Row, limit: float) -> None:
        """The line for a ratio of times."""
        self.check(what, row["times"], limit, "{value:.3g} times faster (at least {limit:g} asked)", least=True)

    def agrees(self, what: str, error: float, limit: float) -> None:
        """The line for an agreement."""
        self.check(what, error, limit, "{value:.1e} (at most {limit:g} asked)", timed=False)


def assembly(bench: Bench, sizes: Row) -> None:
    for kind, counts in sizes["assembly"].items():
        runs = bench.alternating(f"assembly of {kind}", {
            name: (tasks.assembly, name, kind, counts) for name in ("femsub", "scikit-fem")})
        if not all(any(found) for found in runs.values()):
            continue
        dof = next(run["dof"] for run in runs["femsub"] if run)
        theirs = bench.table("assembly", kind, runs, dof)["scikit-fem"]
        where = f"assembly, {kind}, {dof:,} DOF"
        bench.faster(f"{where}:", theirs, TIMES["assembly"])
        if "error" in theirs:
            bench.agrees(f"{where}, entries of K and M differ by", theirs["error"], ENTRIES)


def bases(bench: Bench, cases: list[Case], defaults: bool, only: list[str] | None, journal: Journal) -> None:
    left_out = set() if defaults else {"SciPy, defaults"}
    if not fresh(has_cholmod):
        left_out |= {name for name in tasks.NAMES if name.endswith("CHOLMOD")}
    left_out |= {name for name, package in PACKAGES.items() if find_spec(package) is None}
    methods = [name for name in tasks.NAMES if name not in left_out and (only is None or name in (tasks.REFERENCE, *only))]
    for case in cases:
        for turn in range(bench.repeats):
            for name in methods[::1 if turn % 2 == 0 else -1]:
                label = f"bases of the {case.component}, {case.modes} modes: {name}, run {turn + 1} of {bench.repeats}"
                bench.measured(label, journal, case, name, turn)
    for case in journal.cases:
        told(bench, case, journal)


def told(bench: Bench, case: Case, journal: Journal) -> None:
    """The rows and checks of a case."""
    runs, dof = journal.runs(case, tasks.NAMES), journal.dof(case)
    columns = max((run["interface"] for found in runs.values() for run in found if run), default=0)
    rows = bench.table("bases", f"{case.component}, {columns} + {case.modes}", runs, dof)
    reference, certified = journal.reference(case)
    for name in runs:
        row = rows.get(name)
        if row is None:
            row = {"part": "bases", "case": f"{case.component}, {columns} + {case.modes}", "method": name, "dof": dof,
                   "runs": 0, "phases": {}}
            bench.rows.append(row)
        row |= {"component": case.component, "interface": columns, "modes": case.modes, "reference": reference,
                "ended": journal.ended(case, name) or None}
        if values := next((run["values"] for run in runs[name] if run), None):
            row["error"], row["missed"] = compared(certified, np.sqrt(values))
    where = f"bases, {case.component}, {dof:,} DOF, {case.modes} modes"
    for name, row in rows.items():
        limit = TIMES.get(name) or TIMES.get(name.split(",")[0])
        if name != tasks.REFERENCE and "times" in row and limit:
            bench.faster(f"{where}, against {name}:", row, limit)
            same = [theirs["seconds"] / (ours["seconds"] - ours["phases"].get(tasks.COUNT, 0.0))
                    for theirs, ours in zip(runs[name], runs[tasks.REFERENCE], strict=True) if theirs and ours]
            bench.faster(f"{where}, against {name}, the count apart:", {"times": statistics.median(same)}, limit)
            if name.startswith("SciPy"):
                bench.check(f"{where}, memory against {name}:", rows[tasks.REFERENCE]["peak_mb"] / row["peak_mb"], MEMORY,
                            "{value:.2f} of it (at most {limit:g} asked)")
        if "error_values" in row:
            bench.agrees(f"{where}, ω² differ from those of {name} by", row["error_values"], SAME)
            bench.agrees(f"{where}, constraint modes differ from those of {name} by", row["error_constraint"], SAME)


def cea(bench: Bench, sizes: Row) -> None:
    given = bench.one("cea: band and slopes", tasks.setting, sizes["cea"], sizes["band"])
    if given is None:
        return
    few, band = given["slopes"][SOLVED], given["band"]
    full: list[Row | None] = [bench.one("cea: PEP, run 1", tasks.full_cea, sizes["cea"], few, band)]
    if full[0] is None:
        return
    chosen = bench.one("cea: size of the reduced model", tasks.reductions, sizes["cea"], sizes["kept"], few, full[0]["spectra"])
    if chosen is None:
        return
    bench.details["cea"] = given | {"tried": chosen["tried"], "eigenvalues in the band": len(full[0]["spectra"][0])}
    best = min(chosen["tried"], key=lambda row: row["growth_error"])
    if "model" not in chosen:
        bench.agrees("cea: growth rates, of all sizes that were tried, differ at least by", best["growth_error"], tasks.GROWTH)
        return
    best = bench.details["cea"]["chosen"] = chosen["chosen"]
    reduced: list[Row | None] = []
    for repeat in range(bench.repeats):
        turns = ["reduced", "full"] if repeat % 2 else ["full", "reduced"]
        for turn in turns:
            if turn == "reduced":
                reduced.append(bench.one(f"cea: sweep, run {repeat + 1}", tasks.reduced_cea, chosen["model"], given["slopes"],
                                         band))
            elif repeat:
                full.append(bench.one(f"cea: PEP, run {repeat + 1}", tasks.full_cea, sizes["cea"], few, band))
    # what 100 PEP would take, from the mean of those that were solved
    scaled = [run and run | {"seconds": run["seconds"] * tasks.SLOPES / len(few), "phases": {}} for run in full]
    name = f"{best['method']}, {best['modes']} modes"
    rows = bench.table("cea", f"{tasks.SLOPES} slopes", {name: reduced, "PEP (extrapolated)": scaled},
                       {name: best["size"], "PEP (extrapolated)": given["dof"]})
    where = f"cea, {given['dof']:,} DOF against {best['size']} ({name}), {tasks.SLOPES} slopes"
    if len(rows) == 2:
        whole = rows[name]["seconds"] + best["reduction_seconds"]
        bench.details["cea"]["times_with_reduction"] = rows["PEP (extrapolated)"]["seconds"] / whole
        bench.faster(f"{where} (PEP: {len(few)} measured, extrapolated):", rows["PEP (extrapolated)"], TIMES["cea"])
    bench.agrees(f"{where}, growth rates in the band differ by", best["growth_error"], tasks.GROWTH)


def text(bench: Bench) -> str:
    """The tables for the terminal."""
    heads = ["part", "case", "method", "DOF", "seconds", "least", "most", "times", "least", "most", "peak MB", "before", "error",
             "missed", "not ended"]
    keys = ["part", "case", "method", "dof", "seconds", "seconds_least", "seconds_most", "times", "times_least", "times_most",
            "peak_mb", "base_mb", "error", "missed", "ended"]
    forms = ["", "", "", ",d", ".3g", ".3g", ".3g", ".3g", ".3g", ".3g", ".0f", ".0f", ".0e", "d", ""]
    parts = [table(heads, [[row.get(key) for key in keys] for row in bench.rows], forms)]
    lines = [[f"{row['method']}, {row['case']}", ", ".join(f"{key} {value:.3g} s" for key, value in row["phases"].items()),
              row.get("residual"), row.get("factorisations")] for row in bench.rows if row["part"] != "cea"]
    if lines:
        parts.append(table(["phases", "medians", "residual of modes", "factorisations"], lines, ["", "", ".0e", "d"]))
    if "cea" in bench.details:
        tried = [[row[key] for key in ("method", "modes", "size", "growth_error", "reduction_seconds")]
                 for row in bench.details["cea"]["tried"]]
        parts.append(table(["reduced models", "modes", "DOF", "err Re λ", "seconds"], tried, ["", "d", "d", ".1e", ".3g"]))
    if times := bench.details.get("cea", {}).get("times_with_reduction"):
        parts.append(f"cea: {times:.3g} times faster where the reduction itself is counted with the sweep")
    return "\n\n".join(parts)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS), help="what is measured (default all)")
    parser.add_argument("--component", nargs="+", choices=list(tasks.COMPONENTS), default=["slab"],
                        help=f"of the part bases: {', '.join(f'{key} = {text}' for key, text in tasks.COMPONENTS.items())} "
                             "(default slab)")
    parser.add_argument("--dof", type=int, nargs="+", help="bases: of the components, about (default some 110,000; disc 50,000)")
    parser.add_argument("--defaults", action="store_true", help="bases: SciPy's own choice of ordering, too (slow)")
    parser.add_argument("--modes", type=int, nargs="+", help="bases: fixed-interface modes (default 40)")
    parser.add_argument("--limit", type=float, default=1200.0, metavar="SECONDS",
                        help="bases: most seconds of one measurement, the component's assembly included (default 1200)")
    parser.add_argument("--only", nargs="+", choices=tasks.NAMES, help="bases: femsub and these alone")
    parser.add_argument("--repeats", type=int, default=3, metavar="N", help="runs of each measurement (default 3)")
    parser.add_argument("--out", type=Path, default=Path("out/bench"), metavar="DIR", help="output folder (default out/bench)")
    parser.add_argument("--quick", action="store_true", help="tiny sizes: shows that all works, times mean nothing")
    asked = parser.parse_args()
    if asked.repeats < 1:
        parser.error("--repeats must be at least 1")
    try:
        report.check_folder(str(asked.out))  # to know it now and not at the end
    except fs.InputError as error:
        parser.error(str(error))
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # leave in order, or the process that measures stays behind
    # Debian's PETSc starts OpenMPI, see femsub/algebra/petsc.py; here slepc4py is loaded without it.
    os.environ |= {"OMPI_MCA_ess_singleton_isolated": "1", "OMPI_MCA_orte_create_session_dirs": "0"}
    computer, sizes = fresh(machine), dict(SIZES[asked.quick])
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(asked.repeats, asked.quick, Path(folder), asked.limit)
        if "assembly" in asked.parts:
            assembly(bench, sizes)
        if "bases" in asked.parts:
            cases = [Case(name, size, sizes["interface"], modes) for name in asked.component
                     for size in ([sizes[name]] if asked.dof is None else
                                  [fresh(tasks.size_for, name, sizes[name], dof) for dof in asked.dof])
                     for modes in asked.modes or [sizes["modes"]]]
            bases(bench, cases, asked.defaults, asked.only, Journal(asked.out))
        if "cea" in asked.parts:
            cea(bench, sizes)
    report.progress_done()
    failed = list(bench.failed)
    data = {"machine": computer, "quick": asked.quick, "repeats": asked.repeats, "rows": bench.rows, "checks": bench.checks,
            "details": bench.details, "failed": failed}
    flat = [{key: value for key, value in row.items() if key != "phases"} |
            {f"{key} [s]": value for key, value in row["phases"].items()} for row in bench.rows]
    result = Result(data, [text(bench), Table("bench", flat)])
    print(result.text(), "", *(check["text"] for check in bench.checks), *(f"failed: {line}" for line in failed), sep="\n")
    report.write(result, asked.out, figures=False, name="bench")
    return 1 if failed or any(check["met"] is False and not check["timed"] for check in bench.checks) else 0


if __name__ == "__main__":
    sys.exit(main())
