"""Reduction methods at equal size on joined parts: errors of the lowest frequencies against the unreduced system.

    python -m benchmarks compare-methods [--methods KEY ...] [--coordinates N ...] [--count K] [--out DIR]

The problems are those of benchmarks/joined.py: chains, trusses, beams and membranes in two to four parts. Each part keeps N
coordinates besides its interface DOF: modes, and where the modes are free ones the rigid-body modes of a floating part too. With
--out, methods.csv and methods.png.

largest  the largest |ω/ω_full - 1| of the K lowest elastic frequencies (8)
mean     their geometric mean
size     coordinates of the assembled system; Dual Craig-Bampton has its multipliers in place of interface DOF
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np

import femsub as fs
from benchmarks.joined import LARGER
from benchmarks.pictures import save
from femsub.app.figure_style import draw
from femsub.app.report import table_csv
from femsub.reduction.reduce import METHODS
from femsub.studies.charts import Chart, Panel, Series, look

KEYS = ("craig-bampton", "macneal", "dual-craig-bampton", "rubin", "herting")
FREE_MODES = ("rubin", "craig-chang", "macneal", "dual-craig-bampton", "herting")
FLOOR = 1e-14  # what counts as no error


def table(keys: Sequence[str], sizes: Sequence[int], count: int) -> list[dict[str, Any]]:
    """One row for each problem, method and size: the largest and the mean (geometric) error of `count` frequencies."""
    rows = []
    for name, make in LARGER.items():
        joined = make()
        full = fs.normal_modes(joined.system(), count=count)
        for coordinates, key in itertools.product(sizes, keys):

            def reduced(part: fs.Substructure, key: str = key, coordinates: int = coordinates) -> fs.Substructure:
                """With so many coordinates besides those of its interface: modes of either kind, rigid ones too."""
                rigid = fs.normal_modes(part, count=0).rigid if key in FREE_MODES else 0
                return fs.reduce(part, METHODS[key](coordinates - rigid))

            system: Any = joined.system(reduced)
            modes = fs.normal_modes(system, count=count)
            error = np.abs(modes.frequencies[modes.rigid:] / full.frequencies[full.rigid:] - 1)
            rows.append({"problem": name, "method": key, "coordinates": coordinates, "size": system.size + system.spurious,
                         "largest": float(error.max()), "mean": float(np.exp(np.log(np.maximum(error, FLOOR)).mean()))})
    return rows


def figure(rows: Sequence[dict[str, Any]]) -> Any:
    """For each problem the mean error (lines) and the largest one (dotted) over the size, one line per method."""
    panels = []
    for problem in dict.fromkeys(row["problem"] for row in rows):
        series = []
        for at, key in enumerate(dict.fromkeys(row["method"] for row in rows)):
            mine = [row for row in rows if (row["problem"], row["method"]) == (problem, key)]
            sizes, mean, largest = ([row[what] for row in mine] for what in ("size", "mean", "largest"))
            # thinner on wider lines, smaller on larger marks: methods of equal error are all seen
            series += [Series(f"{look(key).label}, mean", sizes, mean, key, "solid", size=10 - 1.6 * at, width=2.8 - 0.5 * at,
                              hollow=True), Series("largest (dotted)", sizes, largest, key, "dot", "", legend=at == 0)]
        panels.append(Panel(series, "DOF of the system  [-]", "relative error of ω  [-]", problem, "y"))
    return draw(Chart("methods", "Error of the lowest frequencies of joined parts over the size of the reduced system", panels, 3,
                      height=2.5, columns=3))


def main(*, methods: Annotated[tuple[str, ...], sorted(METHODS)] = KEYS, coordinates: tuple[int, ...] = (4, 6, 8, 12),
         count: int = 8, out: Path | None = None) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        rows = table(methods, coordinates, count)
    for row in rows:
        print(f"{row['problem']:22} {METHODS[row['method']].label:20} {row['coordinates']:3} {row['size']:4} "
              f"{row['largest']:9.1e} {row['mean']:9.1e}")
    if out:
        out.mkdir(parents=True, exist_ok=True)
        with open(out / "methods.csv", "wb") as file:
            table_csv(rows, file)
        save(out / "methods.png", lambda: figure(rows))
