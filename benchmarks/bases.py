"""Craig-Bampton bases of solid components against SciPy, plain SLEPc and PRIMME: ratios of seconds and memory.

    python -m benchmarks bases [--component slab bulk disc] [--dof N ...] [--modes N ...] [--only METHOD ...]
                               [--defaults] [--limit SECONDS] [--repeats N] [--out DIR] [--quick]

--component  slab or bulk of hexahedra, or a disc with pads; --dof is about their DOF (some 110,000, the disc 50,000)
--modes      of the fixed interface; --only: femsub and these methods alone
--limit      seconds of one measurement, the component's assembly included; --repeats: runs of each
--quick      tiny sizes show that all works; times mean nothing

All constraint modes and 40 fixed-interface modes, with the reduced M and K. `reduce` finds and certifies them. What users have
today is compared with it:
- SciPy's `eigsh(sigma=0)` with MKL's Pardiso (the extra `pardiso`), and with SuperLU and its options for symmetric
  matrices. --defaults adds SuperLU with the options that `splu` has by itself.
- SLEPc as it comes, with CHOLMOD and MUMPS: one factor in Krylov-Schur and in a KSP that solves column by column.
- PRIMME (the extra `primme`) with the factor of Pardiso, or of SuperLU without it, as its preconditioner, and with
  that of CHOLMOD.
Only `reduce` counts the modes by a second factorisation, and the count is in its time. The error is the largest of ω against
femsub's certified frequencies. A mode is missed if no frequency lies within 1 % of it.

What is compared is measured in one run, in alternating order, each time in a process of its own, so that the peak of its
resident memory is its own. Ratios are medians over the repeats, with the least and the most. Written are bases.csv and
bases.json. Each measurement is a line of DIR/measured.jsonl. The same call goes on where it was stopped, and prints what the
folder has of other cases as well. A measurement that takes longer than --limit, or more memory than there is, is marked so.
"""

from __future__ import annotations

import json
import os
import statistics
import sys
from collections.abc import Iterable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

import femsub as fs
from benchmarks import UsageError, comparisons as tasks
from benchmarks.processes import Row, StoppedError, begin, fresh, machine, watched
from femsub.algebra.petsc import has_cholmod
from femsub.app import report
from femsub.app.scene import Result
from femsub.studies.tables import Table, table

SIZES: dict[bool, Row] = {  # by --quick: bricks or element length, nodes of the interface, modes
    False: {"slab": (90, 58, 6), "bulk": (40, 20, 10), "disc": 0.0085, "interface": 84, "modes": 40},
    True: {"slab": (8, 6, 2), "bulk": (4, 3, 2), "disc": 0.04, "interface": 6, "modes": 6}}
PACKAGES = {"SciPy, MKL Pardiso": "pypardiso", "PRIMME": "primme", "PRIMME, CHOLMOD": "primme"}  # that methods need
COLUMNS = {"case": "", "method": "", "dof": ",d", "seconds": ".3g", "seconds_least": ".3g", "seconds_most": ".3g", "times": ".3g",
           "times_least": ".3g", "times_most": ".3g", "peak_mb": ".0f", "base_mb": ".0f", "error": ".0e", "missed": "d",
           "residual": ".0e", "factorisations": "d", "ended": ""}


FILE = "measured.jsonl"
LOST = 1e-2  # relative: a mode of which no frequency is nearer than that is missed


class Case(NamedTuple):
    """A component with its cells or the length of its elements, nodes of its interface, and modes that are wanted."""

    component: str
    size: Any
    nodes: int
    modes: int

    @property
    def folder(self) -> str:
        """A name for its files."""
        size = "x".join(map(str, self.size)) if isinstance(self.size, tuple) else f"{self.size:g}"
        return f"{self.component}-{size}-{self.nodes}-{self.modes}"


class Journal:
    """The measurements in a folder: a run that was stopped goes on with what is there."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE
        text = self.path.read_text(encoding="utf-8", errors="replace") if self.path.exists() else ""
        self.known: dict[tuple[Case, str, int], Row] = {}
        for line in filter(None, text.splitlines()):
            try:
                row = json.loads(line)
            except ValueError:  # the process was killed while it wrote it
                print(f"{self.path}: a line is damaged, and is made anew: {line[:80]!r}", file=sys.stderr)
                continue
            size = tuple(row["size"]) if isinstance(row["size"], list) else row["size"]
            self.known[Case(row["component"], size, row["nodes"], row["modes"]), row["method"], row["round"]] = row

    def add(self, case: Case, method: str, turn: int, row: Row) -> Row:
        """Writes a measurement at the end of the file."""
        row = case._asdict() | {"method": method, "round": turn} | row
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with open(self.path, "a", encoding="utf-8") as file:
            file.write(f"\n{json.dumps(row)}\n")  # on a line of its own, whatever was left before
        self.known[case, method, turn] = row
        return row

    @property
    def cases(self) -> list[Case]:
        """In order of component and size."""
        return sorted({case for case, _, _ in self.known}, key=lambda case: (case.component, self.dof(case), case.modes))

    def dof(self, case: Case) -> int:
        """0 where no measurement of the case has ended."""
        return max((row.get("dof", 0) for (one, _, _), row in self.known.items() if one == case), default=0)

    def runs(self, case: Case, methods: Iterable[str]) -> dict[str, list[Row | None]]:
        """The measurements of femsub and of each method that has one, round by round; None where one has not ended."""
        turns = 1 + max(turn for one, _, turn in self.known if one == case)
        found = {name: [self.known.get((case, name, turn)) for turn in range(turns)] for name in methods}
        return {name: [row if row and "seconds" in row else None for row in rows] for name, rows in found.items()
                if any(rows) or name == tasks.REFERENCE}

    def ended(self, case: Case, method: str) -> str:
        """Why a method gave no result, if it was stopped."""
        return next((row["ended"] for (one, name, _), row in self.known.items()
                     if (one, name) == (case, method) and "ended" in row), "")

    def reference(self, case: Case) -> tuple[str, np.ndarray]:
        """The frequencies that others are compared with, in rad/s: femsub's, else those of the first method."""
        known = {name: row["values"] for (one, name, _), row in self.known.items()
                 if one == case and "values" in row}
        name = tasks.REFERENCE if tasks.REFERENCE in known else next(iter(known), "")
        return name, np.sqrt(np.array(known.get(name, [])))


def compared(certified: np.ndarray, found: Sequence[float] | np.ndarray) -> tuple[float, int]:
    """The largest relative error of frequencies, and how many of the certified ones are missed.

    Each certified frequency has one partner at most, and the sum of min(|Δω|/ω, LOST) is the least possible. A frequency whose
    partner is LOST or further away is missed, and counts in no error.
    """
    distance = np.abs(np.asarray(found)[None, :] - certified[:, None]) / certified[:, None]
    pairs = linear_sum_assignment(np.minimum(distance, LOST))
    errors = distance[pairs]
    return float(errors[errors < LOST].max(initial=0.0)), len(certified) - int((errors < LOST).sum())


def measured(case: Case, method: str, turn: int, journal: Journal, limit: float) -> str:
    """Measures a basis, unless the journal has it or the method was stopped before; gives what failed."""
    if (case, method, turn) in journal.known or journal.ended(case, method):
        return ""
    report.progress(f"{case.component}, {case.modes} modes: {method}, run {turn + 1}")
    folder = journal.path.parent / "reference" / case.folder
    folder.mkdir(parents=True, exist_ok=True)
    try:
        row = watched(tasks.bases, method, *case, folder if turn == 0 else None, limit=limit)
    except (StoppedError, MemoryError) as error:
        row = {"ended": str(error) or "not enough memory"}
    except (fs.FemsubError, ImportError, RuntimeError) as error:
        return f"{case.component}, {method}: {type(error).__name__}: {error}"[:400]
    journal.add(case, method, turn, row)
    return ""


def rows_of(case: Case, journal: Journal) -> list[Row]:
    """A row for each method: medians, spread, memory, and how many times longer than femsub it takes, round by round."""
    runs, found = journal.runs(case, tasks.NAMES), []
    columns = max((run["interface"] for several in runs.values() for run in several if run), default=0)
    reference, certified = journal.reference(case)
    for name, several in runs.items():
        done = [run for run in several if run]
        row: Row = {"component": case.component, "interface": columns, "modes": case.modes, "method": name,
                    "case": f"{case.component}, {columns} + {case.modes}", "dof": journal.dof(case), "runs": len(done),
                    "reference": reference, "ended": journal.ended(case, name) or None, "phases": {}}
        if done:
            row |= spread("seconds", [run["seconds"] for run in done])
            ratios = [run["seconds"] / ours["seconds"] for run, ours in zip(several, runs[tasks.REFERENCE], strict=True)
                      if run and ours]  # of one round, so that a slow spell of the machine hits both of its sides
            row |= spread("times", ratios) if ratios else {}
            row |= {key: statistics.median(run[key] for run in done) for key in ("peak_mb", "base_mb")}
            row["phases"] = {key: statistics.median(run["phases"][key] for run in done) for key in done[0]["phases"]}
            row |= {key: value for key, value in done[0].items() if key in ("residual", "factorisations")
                    or key.startswith("error")}
            row["error"], row["missed"] = compared(certified, np.sqrt(done[0]["values"]))
        found.append(row)
    return found


def spread(name: str, values: list[float]) -> Row:
    return {name: statistics.median(values), f"{name}_least": min(values), f"{name}_most": max(values)}


def main(*, component: Annotated[tuple[str, ...], tasks.COMPONENTS] = ("slab",), dof: tuple[int, ...] = (),
         defaults: bool = False, modes: tuple[int, ...] = (), limit: float = 1200.0, repeats: int = 3,
         only: Annotated[tuple[str, ...], tasks.NAMES] = (), out: Path = Path("out/bases"), quick: bool = False) -> int:
    if repeats < 1:
        raise UsageError("--repeats must be at least 1")
    begin(out)
    # Debian's PETSc starts OpenMPI, see femsub/algebra/petsc.py; here slepc4py is loaded without it.
    os.environ |= {"OMPI_MCA_ess_singleton_isolated": "1", "OMPI_MCA_orte_create_session_dirs": "0"}
    computer, sizes, journal = fresh(machine), SIZES[quick], Journal(out)
    cases = [Case(name, size, sizes["interface"], count) for name in component
             for size in ([sizes[name]] if not dof else
                          [fresh(tasks.size_for, name, sizes[name], wanted) for wanted in dof])
             for count in modes or [sizes["modes"]]]
    left_out = {name for name, package in PACKAGES.items() if find_spec(package) is None}
    left_out |= set() if defaults else {"SciPy, defaults"}
    left_out |= set() if fresh(has_cholmod) else {name for name in tasks.NAMES if name.endswith("CHOLMOD")}
    methods = [name for name in tasks.NAMES if name not in left_out
               and (not only or name in (tasks.REFERENCE, *only))]
    failed = [fault for case in cases for turn in range(repeats) for name in methods[::1 if turn % 2 == 0 else -1]
              if (fault := measured(case, name, turn, journal, limit))]
    report.progress_done()
    rows = [row for case in journal.cases for row in rows_of(case, journal)]
    text = table([key.replace("_", " ") for key in COLUMNS], [[row.get(key) for key in COLUMNS] for row in rows],
                 list(COLUMNS.values()))
    phases = table(["phases", "medians"], [[f"{row['method']}, {row['case']}", ", ".join(
        f"{key} {value:.3g} s" for key, value in row["phases"].items())] for row in rows], ["", ""])
    flat = [{key: value for key, value in row.items() if key != "phases"} for row in rows]
    data = {"machine": computer, "quick": quick, "repeats": repeats, "rows": rows, "failed": failed}
    result = Result(data, [text, phases, Table("bases", flat)])
    print(result.text(), *(f"failed: {line}" for line in failed), sep="\n")
    report.write(result, out, figures=False, name="bases")
    return 1 if failed else 0
