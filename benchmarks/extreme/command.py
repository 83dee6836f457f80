"""Stiff and extreme cases, each right within a bound stated beforehand, or refused with the reason.

    python -m benchmarks extreme [--cases NAME ...] [--quick] [--list] [--out DIR]

--cases takes names, parts of them, or groups; --quick leaves out what takes longer than a second or two. The cases are in
benchmarks/extreme/table.py. Each runs apart from the others: what fails, even by a crash or after --limit seconds, is a row of
the table.

References are Sturm counts, companion matrices and solves in 60 digits (mpmath, which `scripts/setup test` installs) of the
matrices as they are, in double precision, closed forms, exact fractions, and equations of motion integrated to 1e-11; none of
it is femsub's. All errors are relative: of ω², of complex eigenvalues, of slopes, of the reduced model's statics, of a motion (of
Floquet multipliers absolute). A bound comes from condition numbers, from what a method was asked for or from what it says of
its own error, is fixed before the error is known, and must be below 1.

right     Each value lies within its bound, none is missed, no claim (rigid-body modes, stability) is false; the backward error is
          at most 1e-9 and ‖ΦᵀMΦ - I‖ at most 1e-8.
refused   An error of femsub's own, or a warning that rounding takes the digits (then with the figures); the reason is listed.
wrong     All else.

Written are extreme.csv, extreme.json and extreme.png. Exit status 1: a row is wrong, or other than it is known to be.
"""

from __future__ import annotations

import time
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import femsub as fs
from benchmarks import UsageError
from benchmarks.extreme.table import CASES
from benchmarks.processes import Row, StoppedError, Worker, begin
from femsub.app import report
from femsub.app.scene import Picture, Result
from femsub.studies.tables import Table

BACKWARD, ORTHOGONAL = 1e-9, 1e-8  # a backward error above the first is warned of by femsub itself
FIGURES = ("error", "bound", "ratio", "backward", "orthogonality", "condition", "missed")


def empty_row(name: str) -> Row:
    """What is known of a case that gave nothing."""
    return {"group": CASES[name].group, "case": name, "verdict": "wrong", "as_known": False, "computed": "", "reason": "",
            **dict.fromkeys(FIGURES), "why": "", "warnings": []}


def evaluate(name: str) -> Row:
    """Runs one case and judges it."""
    case, start = CASES[name], time.perf_counter()
    row = empty_row(name)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", fs.FemsubWarning)
        warnings.simplefilter("ignore", fs.PortWarning)
        try:
            found = case.run()
        except fs.FemsubError as error:
            row |= {"verdict": "refused", "reason": f"{type(error).__name__}: {error}"}
            found = None
        except Exception as error:  # whatever else is raised is no refusal, but must not end the run
            row |= {"reason": f"{type(error).__name__}: {error}"}
            found = None
    told = [one for one in caught if issubclass(one.category, fs.FemsubWarning)]
    row |= {"warnings": [str(one.message) for one in told]}
    if found is not None:
        row |= {key: getattr(found, key) for key in ("computed", "why", *FIGURES)}
        faults = [found.lie, f"{found.ratio:.2g} times its bound" if found.ratio > 1 else "",
                  "the bound says nothing" if not found.bound < 1 else "", f"{found.missed} missed" if found.missed else "",
                  f"‖ΦᵀMΦ - I‖ = {found.orthogonality:.1e}" if (found.orthogonality or 0) > ORTHOGONAL else "",
                  f"backward error {found.backward:.1e}" if (found.backward or 0) > BACKWARD and not told else ""]
        lost = [str(one.message) for one in told if issubclass(one.category, fs.ConditionWarning)]
        row["reason"] = "; ".join(fault for fault in faults if fault)
        if not row["reason"]:
            row["verdict"] = "right"
        elif lost:
            row |= {"verdict": "refused", "reason": f"ConditionWarning: {lost[0]} [{row['reason']}]"}
    known = "right" if case.expect == "right" else "refused"
    row["as_known"] = row["verdict"] == known and (known == "right" or case.expect in row["reason"])
    return row | {"seconds": time.perf_counter() - start}


def run(names: list[str], limit: float) -> list[Row]:
    """All rows, from a process that is replaced when it crashes or hangs."""
    rows, worker = [], Worker()
    for at, name in enumerate(names):
        report.progress(f"{at + 1}/{len(names)}: {CASES[name].group}: {name}")
        try:
            rows.append(worker(evaluate, name, limit=limit))
        except StoppedError as error:
            rows.append(empty_row(name) | {"reason": str(error), "seconds": limit})
    worker.close()
    report.progress_done()
    return rows


def text(rows: list[Row]) -> str:
    """The reasons of refusals and of wrong rows, and where the bounds come from; all figures are in the table's file."""
    parts = []
    for verdict in ("refused", "wrong"):
        lines = [f"  {row['case']}: {row['reason']}" for row in rows if row["verdict"] == verdict]
        if lines:
            parts.append("\n".join([f"{verdict}:", *lines]))
    bounds = Counter(row["why"] for row in rows if row["verdict"] == "right")
    parts.append("\n".join(["bounds of what is right:", *(f"  {count} x {why}" for why, count in bounds.most_common())]))
    return "\n\n".join(parts)


def draw(rows: list[Row]) -> Any:
    """Error over bound, and the verdicts of each group."""
    from femsub.app.figure_style import PAGE, legend_below, new_figure

    groups = list(dict.fromkeys(row["group"] for row in rows))
    colours = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "black")
    markers = "os^Dv"  # as many as share no factor with the colours: 35 pairs before the first one comes again
    figure = new_figure(PAGE, 4.9)
    cloud, bars = figure.subplots(1, 2, width_ratios=[3, 2])
    for at, group in enumerate(groups):
        points = [(row["bound"], max(row["error"], 1e-18)) for row in rows
                  if row["group"] == group and row["verdict"] == "right"]
        if points:
            cloud.plot(*zip(*points, strict=True), markers[at % len(markers)], color=colours[at % len(colours)], ms=5, mew=0,
                       alpha=0.8, zorder=3, label=group)
    cloud.plot([1e-19, 1], [1e-19, 1], color="black", lw=1, label="error = bound")
    cloud.set(xscale="log", yscale="log", xlim=(1e-16, 1), ylim=(3e-19, 1), title="largest error of each right case",
              xlabel="relative bound, stated beforehand  [-]", ylabel="relative error, drawn from 1e-18 on  [-]")
    cloud.grid(alpha=0.3)
    left = [0] * len(groups)
    for verdict, colour in (("right", "#009e73"), ("refused", "#e69f00"), ("wrong", "black")):
        counts = [sum(row["group"] == group and row["verdict"] == verdict for row in rows) for group in groups]
        bars.barh(groups, counts, left=left, color=colour, label=f"{verdict}: {sum(counts)}")
        left = [a + b for a, b in zip(left, counts, strict=True)]
    bars.invert_yaxis()
    bars.set(title="verdicts", xlabel="cases  [-]", xlim=(0, 1.05 * max(left)))
    legend_below(figure, [cloud, bars], 6)
    return figure


def main(*, cases: tuple[str, ...] = (), quick: bool = False, list: bool = False, limit: float = 300.0,
         out: Path = Path("out/extreme")) -> int:
    names = [name for name, case in CASES.items() if (case.quick or not quick) and (
        not cases or any(part in name or part == case.group for part in cases))]
    if not names:
        raise UsageError("no case has such a name; --list shows them")
    if list:
        print(*(f"{CASES[name].group}: {name}" for name in names), sep="\n")
        return 0
    begin(out)
    start = time.perf_counter()
    rows = run(names, limit)
    counts = Counter(row["verdict"] for row in rows)
    odd = [row["case"] for row in rows if not row["as_known"]]
    summary = (f"{len(rows)} cases in {time.perf_counter() - start:.0f} s: {counts['right']} right within their bounds, "
               f"{counts['refused']} refused with the reason, {counts['wrong']} wrong")
    data = {"machine": report.machine() | report.versions(), "summary": summary, "rows": rows, "other_than_known": odd}
    flat = [row | {"warnings": "; ".join(row["warnings"])} for row in rows]
    result = Result(data, [text(rows), Table("extreme", flat), Picture("extreme", lambda: draw(rows))])
    print(result.text(), "", summary, *([f"other than known: {', '.join(odd)}"] if odd else []), sep="\n")
    report.write(result, out, figures=True, name="extreme")
    return 1 if odd or counts["wrong"] else 0
