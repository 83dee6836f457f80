"""What users would take instead of femsub: measurements of bases, a line of JSON each, and what they come to."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.comparisons import REFERENCE
from benchmarks.processes import Row

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
                if any(rows) or name == REFERENCE}

    def ended(self, case: Case, method: str) -> str:
        """Why a method gave no result, if it was stopped."""
        return next((row["ended"] for (one, name, _), row in self.known.items()
                     if (one, name) == (case, method) and "ended" in row), "")

    def reference(self, case: Case) -> tuple[str, np.ndarray]:
        """The frequencies that others are compared with, in rad/s: femsub's, else those of the first method."""
        known = {name: row["values"] for (one, name, _), row in self.known.items()
                 if one == case and "values" in row}
        name = REFERENCE if REFERENCE in known else next(iter(known), "")
        return name, np.sqrt(np.array(known.get(name, [])))


def compared(certified: np.ndarray, found: Sequence[float] | np.ndarray) -> tuple[float, int]:
    """The largest relative error of frequencies, and how many of the certified ones are missed.

    Each certified frequency has one partner at most, and the sum of min(|Δω|/ω, LOST) is the least possible. A frequency whose
    partner is LOST or further away is missed, and counts in no error.
    """
    from scipy.optimize import linear_sum_assignment

    distance = np.abs(np.asarray(found)[None, :] - certified[:, None]) / certified[:, None]
    pairs = linear_sum_assignment(np.minimum(distance, LOST))
    errors = distance[pairs]
    return float(errors[errors < LOST].max(initial=0.0)), len(certified) - int((errors < LOST).sum())
