"""What users have today, over femsub: measurements of `bases` as data, as pictures, and in the pages.

    python -m benchmarks users-picture --take DIR       # benchmarks/data/users.json, and what the pages tell of it
    python -m benchmarks users-picture --out DIR        # the pictures

DIR of --take is the folder of a run of `python -m benchmarks bases`.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.comparisons import COMPONENTS, NAMES, REFERENCE
from benchmarks.pictures import save
from benchmarks.processes import Row
from femsub.app.figure_style import PAGE, few_decades, legend_below, new_figure

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "benchmarks" / "data" / "users.json"
MARKS = "<!-- users -->", "<!-- end of users -->"
KEPT = ("component", "dof", "interface", "modes", "method", "runs", "seconds", "times", "times_least", "times_most", "peak_mb",
        "error", "missed", "ended")
LOOKS = {"SciPy, MKL Pardiso": ("#1f6fb4", "o"), "SciPy": ("#6aa5d8", "s"), "SciPy, defaults": ("#9cc3e6", "P"),
         "SLEPc, CHOLMOD": ("#2a8f4d", "^"), "SLEPc, MUMPS": ("#7cc08b", "v"), "PRIMME": ("#c44e00", "D"),
         "PRIMME, CHOLMOD": ("#e08a4a", "d")}
LABELS = {"SciPy": "SciPy, SuperLU", "SciPy, defaults": "SciPy, SuperLU as it comes"}
NOT_RUN: Row = dict.fromkeys(KEPT) | {"ended": "not run"}
LANE = 0.15  # inches: of a method in a figure


def taken(told: dict[str, Any]) -> dict[str, Any]:
    """Of the bases.json of a run what is kept: the machine, and the rows of bases."""
    rows = [{key: row.get(key) for key in KEPT} for row in told["rows"]]
    host = {key: told["machine"].get(key) for key in ("cpu", "cores", "OMP_NUM_THREADS", "commit")}
    return {"machine": host, "rows": [{key: float(f"{value:.4g}") if isinstance(value, float) else value
                                       for key, value in row.items()} for row in rows]}


def by_case(rows: Sequence[Row]) -> dict[tuple[str, int, int], dict[str, Row]]:
    """{(component, DOF, modes): {method: row}}, components and methods in the order of the benchmark."""
    keys = sorted({(row["component"], row["dof"], row["modes"]) for row in rows},
                  key=lambda key: (list(COMPONENTS).index(key[0]), *key[1:]))
    return {key: {name: row for name in NAMES for row in rows
                  if (row["component"], row["dof"], row["modes"], row["method"]) == (*key, name)} for key in keys}


def fullest(rows: Sequence[Row]) -> list[Row]:
    """Those of the case that most methods have run, and of these the largest, of each component."""
    cases = by_case(rows)
    best = {key[0]: key for key in sorted(cases, key=lambda key: (len(cases[key]), *key[1:]))}
    return [row for row in rows if (row["component"], row["dof"], row["modes"]) in best.values()]


def figure(rows: Sequence[Row]) -> Any:
    """Seconds and memory over femsub's, a mark for each method in each case; bars reach over all rounds."""
    cases = by_case(rows)
    methods = [name for name in LOOKS if any(name in found for found in cases.values())]
    lanes = len(methods) + 1.5  # of a case, with a gap below
    drawn = new_figure(1.15 * PAGE, LANE * lanes * len(cases) + 1.6)
    left, right = drawn.subplots(1, 2, sharey=True, width_ratios=[1.5, 1])
    for at, name in enumerate(methods):
        colour, marker = LOOKS[name]
        style = {"color": colour, "marker": marker, "ls": "none", "ms": 5.5, "label": LABELS.get(name, name),
                 "mfc": colour, "zorder": 3}
        there = [(case * lanes + at, found[name], found[REFERENCE]) for case, found in enumerate(cases.values()) if name in found]
        timed = [(y, row) for y, row, _ in there if row["times"]]
        left.plot([row["times"] for _, row in timed], [y for y, _ in timed], **style)
        for y, row in timed:
            left.plot([row["times_least"], row["times_most"]], [y, y], color=colour, lw=1.5, label="_spread", zorder=2)
        sized = [(y, row["peak_mb"] / ours["peak_mb"]) for y, row, ours in there if row["peak_mb"] and ours["peak_mb"]]
        right.plot([share for _, share in sized], [y for y, _ in sized], **style)
    for axis, title, what in ((left, "time", "time over femsub's"), (right, "memory", "peak memory over femsub's")):
        axis.set_xscale("log")
        axis.set_title(title)
        known = [value for line in axis.lines for value in line.get_xdata()]
        low, high = min([0.9, *known]), max([2.0, *known])
        axis.set(xlabel=f"{what}  [-]", xlim=(low / 1.25, high * (2.5 if axis is left else 1.25)))
        axis.axvline(1.0, color="0.2", lw=1.0, ls="--", label="femsub", zorder=1)
        axis.grid(axis="x", lw=0.4)
        few_decades(axis)
        for case in range(1, len(cases)):
            axis.axhline(case * lanes - 1.25, color="0.8", lw=0.6, zorder=0)
    _notes(left, cases, methods, lanes)
    left.set_yticks([case * lanes + (len(methods) - 1) / 2 for case in range(len(cases))],
                    [f"{COMPONENTS[name].split(' of ')[0]}\n{dof:,} DOF\n{modes} modes" for name, dof, modes in cases])
    left.tick_params(axis="y", length=0)
    right.tick_params(axis="y", length=0)
    left.set_ylim(len(cases) * lanes - 1.25, -1.25)
    legend_below(drawn, (left,), 4)
    drawn.suptitle("Craig-Bampton bases: time and memory over those of femsub, which also proves that no mode is missed")
    return drawn


def _notes(axis: Any, cases: dict[tuple[str, int, int], dict[str, Row]], methods: Sequence[str], lanes: float) -> None:
    """Beside a mark what is wrong with its modes; without one, why a method has not ended."""
    for case, found in enumerate(cases.values()):
        for at, name in enumerate(methods):
            row = found.get(name, NOT_RUN)
            told = row["ended"] or (f"{row['missed']} missed" if row["missed"] else "")
            if told:
                place = row["times_most"] or 1.0
                axis.annotate(told, (place, case * lanes + at), (6, 0), textcoords="offset points", va="center", fontsize=7,
                              color=LOOKS[name][0])


def table(rows: Sequence[Row]) -> str:
    """For each case and method: seconds, times as long as femsub with their spread, GB, the largest error, and missed modes."""
    lines = [["component", "DOF", "modes", "method", "seconds", "times femsub's", "GB", "error of ω", "missed"], ["---"] * 9]
    for (name, dof, modes), found in by_case(rows).items():
        for at, (method, row) in enumerate(found.items()):
            case = [COMPONENTS[name], f"{dof:,}", str(modes)] if at == 0 else [""] * 3
            ours = method == REFERENCE
            if row["seconds"]:
                told = [f"{row['seconds']:.3g}", "" if ours else _spread(row), f"{row['peak_mb'] / 1e3:.1f}",
                        "" if ours else f"{row['error']:.0e}", str(row["missed"])]
            else:
                told = [row["ended"] or "failed", *[""] * 4]
            lines.append([*case, LABELS.get(method, method), *told])
    return "\n\n" + "".join(f"| {' | '.join(line)} |\n" for line in lines) + "\n"


def _spread(row: Row) -> str:
    if not row["times"]:
        return ""
    least, middle, most = (f"{row[key]:.2g}" for key in ("times_least", "times", "times_most"))
    return middle if least == most else f"{middle} ({least} to {most})"


def sentence(rows: Sequence[Row]) -> str:
    """How many times as fast as others femsub is, from the least to the most of all cases."""
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
        out.mkdir(parents=True, exist_ok=True)
        save(out / "users.png", lambda: figure(rows))
        save(out / "readme.png", lambda: figure(fullest(rows)))
