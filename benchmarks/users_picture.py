"""Other solvers compared with femsub: measurements of `bases` as data, as pictures, and in the pages.

    python -m benchmarks users-picture --take DIR       # benchmarks/data/users.json, and what the pages tell of it
    python -m benchmarks users-picture --out DIR        # the pictures

DIR of --take is the folder of a run of `python -m benchmarks bases`.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.bases import COMPONENTS, NAMES, REFERENCE
from benchmarks.pictures import plain, save
from benchmarks.processes import Row
from femsub.output import PAGE, few_decades, legend_below, new_figure

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "benchmarks" / "data" / "users.json"
MARKS = "<!-- users -->", "<!-- end of users -->"
KEPT = ("component", "dof", "interface", "modes", "method", "runs", "seconds", "times", "times_least", "times_most", "peak_mb",
        "error", "missed", "ended")
LOOKS = {"SciPy, MKL Pardiso": ("#1f6fb4", "o"), "SciPy": ("#6aa5d8", "s"),
         "SLEPc, CHOLMOD": ("#2a8f4d", "^"), "SLEPc, MUMPS": ("#7cc08b", "v"), "PRIMME": ("#c44e00", "D")}
LABELS = {"SciPy": "SciPy, SuperLU"}
NOT_RUN: Row = dict.fromkeys(KEPT) | {"ended": "not run"}
LANE = 0.15  # inches: of a method in a figure


def taken(told: dict[str, Any]) -> dict[str, Any]:
    """The entries of a run's bases.json that are kept: the machine, and the rows of bases."""
    host = {key: told["machine"].get(key) for key in ("cpu", "cores", "OMP_NUM_THREADS", "commit")}
    return {"machine": host, "rows": [{key: plain(row.get(key)) for key in KEPT} for row in told["rows"]]}


def by_case(rows: Sequence[Row]) -> dict[tuple[str, int, int], dict[str, Row]]:
    """{(component, DOF, modes): {method: row}}, components and methods in the order of the benchmark."""
    keys = sorted({(row["component"], row["dof"], row["modes"]) for row in rows},
                  key=lambda key: (list(COMPONENTS).index(key[0]), *key[1:]))
    return {key: {name: row for name in NAMES for row in rows
                  if (row["component"], row["dof"], row["modes"], row["method"]) == (*key, name)} for key in keys}


def fullest(rows: Sequence[Row]) -> list[Row]:
    """For each component, the rows of the case that most methods have run; of several such cases, the largest."""
    cases = by_case(rows)
    best = {key[0]: key for key in sorted(cases, key=lambda key: (len(cases[key]), *key[1:]))}
    return [row for row in rows if (row["component"], row["dof"], row["modes"]) in best.values()]


def figure(rows: Sequence[Row]) -> Any:
    """Seconds and memory over femsub's, a mark for each method in each case; bars reach over all rounds.

    Beside a mark stands what is wrong with its modes, and without one, why a method has not ended.
    """
    cases = by_case(rows)
    methods = [name for name in LOOKS if any(name in found for found in cases.values())]
    lanes = len(methods) + 1.5  # of a case, with a gap below
    drawn = new_figure(1.15 * PAGE, LANE * lanes * len(cases) + 1.6)
    axes = drawn.subplots(1, 2, sharey=True, width_ratios=[1.5, 1])
    for axis, title, what in zip(axes, ("time", "memory"), ("time over femsub's", "peak memory over femsub's"), strict=True):
        for at, name in enumerate(methods):
            colour, marker = LOOKS[name]
            marks = []
            for case, found in enumerate(cases.values()):
                row, y = found.get(name, NOT_RUN), case * lanes + at
                memory = row["peak_mb"] and found[REFERENCE]["peak_mb"] and row["peak_mb"] / found[REFERENCE]["peak_mb"]
                if share := row["times"] if title == "time" else memory:
                    marks.append((share, y))
                if title == "time":
                    axis.plot([row["times_least"], row["times_most"]] if share else [], [y, y] if share else [], color=colour,
                              lw=1.5, label="_spread", zorder=2)
                    told = row["ended"] or (f"{row['missed']} missed" if row["missed"] else "")
                    axis.annotate(told, (row["times_most"] or 1.0, y), (6, 0), textcoords="offset points", va="center",
                                  fontsize=7, color=colour)
            axis.plot([x for x, _ in marks], [y for _, y in marks], color=colour, marker=marker, ls="none", ms=5.5, mfc=colour,
                      zorder=3, label=LABELS.get(name, name))
        axis.set_xscale("log")
        known = [value for line in axis.lines for value in line.get_xdata()]
        low, high = min([0.9, *known]), max([2.0, *known])
        axis.set(title=title, xlabel=f"{what}  [-]", xlim=(low / 1.25, high * (2.5 if title == "time" else 1.25)))
        axis.axvline(1.0, color="0.2", lw=1.0, ls="--", label="femsub", zorder=1)
        axis.grid(axis="x", lw=0.4)
        axis.tick_params(axis="y", length=0)
        few_decades(axis)
        for case in range(1, len(cases)):
            axis.axhline(case * lanes - 1.25, color="0.8", lw=0.6, zorder=0)
    axes[0].set_yticks([case * lanes + (len(methods) - 1) / 2 for case in range(len(cases))],
                       [f"{COMPONENTS[name].split(' of ')[0]}\n{dof:,} DOF\n{modes} modes" for name, dof, modes in cases])
    axes[0].set_ylim(len(cases) * lanes - 1.25, -1.25)
    legend_below(drawn, axes[:1], 4)
    drawn.suptitle("Craig-Bampton bases: time and memory over those of femsub, which also proves that no mode is missed")
    return drawn


def table(rows: Sequence[Row]) -> str:
    """For each case and method: seconds, times as long as femsub with their spread, GB, the largest error, and missed modes."""
    lines = [["component", "DOF", "modes", "method", "seconds", "times femsub's", "GB", "error of ω", "missed"], ["---"] * 9]
    for (name, dof, modes), found in by_case(rows).items():
        for at, (method, row) in enumerate(found.items()):
            case = [COMPONENTS[name], f"{dof:,}", str(modes)] if at == 0 else [""] * 3
            told = [row["ended"] or "failed", *[""] * 4]
            if row["seconds"]:
                ours = method == REFERENCE
                least, middle, most = (f"{row[key] or 0:.2g}" for key in ("times_least", "times", "times_most"))
                times = "" if ours or not row["times"] else middle if least == most else f"{middle} ({least} to {most})"
                told = [f"{row['seconds']:.3g}", times, f"{row['peak_mb'] / 1e3:.1f}", "" if ours else f"{row['error']:.0e}",
                        str(row["missed"])]
            lines.append([*case, LABELS.get(method, method), *told])
    return "\n\n" + "".join(f"| {' | '.join(line)} |\n" for line in lines) + "\n"


def sentence(rows: Sequence[Row]) -> str:
    """The sentence with femsub's speed relative to others, from the smallest to the largest ratio of all cases."""
    told = []
    for name, key in (("fast as SciPy with MKL's Pardiso", "SciPy, MKL Pardiso"), ("plain SLEPc", "SLEPc"), ("PRIMME", "PRIMME")):
        if times := [row["times"] for row in rows if row["method"].startswith(key) and row["times"]]:
            told.append(f"{min(times):.2g} to {max(times):.2g} times as {name}")
    return f"femsub makes such a basis {', '.join(told)}."


PAGES = {"docs/performance.md": table, "README.md": sentence}  # what each has between the marks


def between(text: str) -> str:
    """What a page has between the marks."""
    start, end = MARKS
    return text[text.index(start) + len(start):text.index(end)]


def main(*, take: Path | None = None, out: Path | None = None) -> None:
    if take:
        told = taken(json.loads((take / "bases.json").read_text(encoding="utf-8")))
        lines = ",\n".join(f"  {json.dumps(row, ensure_ascii=False)}" for row in told["rows"])
        DATA.write_text(f'{{"machine": {json.dumps(told["machine"])},\n "rows": [\n{lines}]}}\n', encoding="utf-8")
        for page, make in PAGES.items():
            text = (ROOT / page).read_text(encoding="utf-8")
            start, end = MARKS
            new = text.replace(start + between(text) + end, start + make(told["rows"]) + end)
            (ROOT / page).write_text(new, encoding="utf-8")
    if out:
        rows = json.loads(DATA.read_text(encoding="utf-8"))["rows"]
        save(out / "users.png", lambda: figure(rows))
        save(out / "readme.png", lambda: figure(fullest(rows)))
