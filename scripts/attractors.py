#!/usr/bin/env python3
"""Which motions a chain on a belt ends in, full and reduced: the shares of attractors over many starts.

    python scripts/attractors.py [--starts N] [--sizes 4 5 ...] [--interfaces 1 1,2] [--seed S] [--workers N] [--out DIR]

Several motions coexist, so one trajectory proves nothing. Every model gets the same physical starts, projected M-orthogonally:
random ones around the sliding equilibrium, from small kicks to sticking (`random_start` in benchmarks/attractor_runs.py), and
besides an impulse and a start from rest, which are only listed. Each trajectory is followed until two successive windows show
one motion; trajectories that have not settled by then form a separate class. Motions of all models are distinguished by
`benchmarks/attractor_states.py`: both periodic or both not, rms within 10 %, 80 % of the power on lines within 1.5 %.

From where the full model has ended in each of its states, every reduced model starts once more: the states in which it
stays are those it `holds`, whatever the chance of reaching them.

A reduced model agrees where the total variation between its shares and the full model's is no larger than what two sets of
as many starts of the full model would differ by chance (95 %); the full model has a second set of starts to show it. A model
with all modes must agree. Beside it stand the criteria of `fs.self_excitation`, from linear data alone, with their rank
correlation with the measured errors over the models that are not complete.

Results are appended to trajectories.jsonl in the output folder as they come: a run that was stopped goes on where it
was. Written are attractors.json, attractors.csv and attractors.png.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy comes: such small matrices gain nothing from threads

import argparse
import signal
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from string import ascii_uppercase
from typing import Any

import numpy as np

import femsub as fs
from benchmarks import attractor_runs as runs, attractor_states
from benchmarks.attractor_states import Motion
from benchmarks.pictures import save
from femsub.app import report
from femsub.app.scene import Result
from femsub.studies.self_excitation import CRITERIA, table_rows
from femsub.studies.tables import Table, table

SHORT = {"full": "full", "craig-bampton": "HCB", "craig-chang": "CC"}
MEASURED = ("distance", "error_spectrum", "error_frequency", "error_amplitude")
# Hue of a state by its strongest line, shade by its place among those of that hue.
STRONG = ("#1f2a44", "#009e73", "#882255", "#0072b2")  # of states of the full model
PALE = {True: "#fbe0b5", False: "#d5d5d5"}  # of other states, periodic or not
Row = dict[str, Any]
Model = tuple[str, int, tuple[int, ...]]


def evaluate(settings: runs.Settings, records: Sequence[Row]) -> dict[str, Any]:
    """States over all models, shares of each, distances from the full model, criteria and their rank correlation."""
    order = {"random": 0, "again": 1, "impulse": 2, "rest": 3, "carried": 4}
    # The full model's motions lead, then those of large models; what carried starts end in comes last.
    records = sorted(records, key=lambda line: (line["family"] == "carried", line["method"] != "full", -line["size"],
                                                line["interface"], line["method"], order[line["family"]], line["number"]))
    motions = [Motion.of(line["motion"]) for line in records]
    steady = [at for at, line in enumerate(records) if line["settled"]]
    labels = np.full(len(records), -1)
    labels[steady] = attractor_states.states([motions[at] for at in steady])
    count = int(labels.max()) + 2
    labels[labels < 0] = count - 1  # trajectories that have not settled form a separate class
    groups: dict[tuple[Model, str], list[int]] = {}
    for at, line in enumerate(records):
        groups.setdefault(((line["method"], line["size"], tuple(line["interface"])), line["family"]), []).append(at)
    full = next(model for model, _ in groups if model[0] == "full")
    reference = groups[full, "random"]
    starts = len(reference)
    own = [*labels[reference], *labels[groups[full, "again"]]]
    limit = attractor_states.chance(own, count, starts)
    numbers = {records[at]["number"]: labels[at] for at in reference}
    rows = []
    for model in dict.fromkeys(model for model, _ in groups):
        mine = groups[model, "random"]
        low, high = attractor_states.bootstrap(labels[mine], labels[reference], count)
        distance = _distance(labels[mine], labels[reference], count)
        measured = {"interface": list(model[2]), "starts": len(mine), "shares": attractor_states.shares(labels[mine], count),
                    "distance": distance, "distance_low": low, "distance_high": high, "agrees": distance <= limit,
                    "same_start_same_state": float(np.mean(labels[mine] == labels[reference])),
                    **_errors([motions[at] for at in mine], [motions[at] for at in reference]),
                    "impulse": int(labels[groups[model, "impulse"][0]]), "rest": int(labels[groups[model, "rest"][0]])}
        stayed = {int(labels[at]) for at in groups.get((model, "carried"), ()) if labels[at] == numbers[records[at]["number"]]}
        measured["holds"] = sorted(stayed if model[0] != "full" else set(labels[reference].tolist()) - {count - 1})
        exact, found = runs.full_model(settings, model[2]), runs.model(settings, *model)
        rows += [row | {"method": model[0]} for row in table_rows(exact, [found], settings.contact(), [measured])]
    again = [labels[at] for at in groups[full, "again"]]
    self_distance = _distance(labels[reference], again, count)
    partial: dict[tuple[int, ...], list[Row]] = {}
    for row in rows:
        if row["method"] != "full" and row["size"] < settings.masses:
            partial.setdefault(tuple(row["interface"]), []).append(row)
    correlations = [{"interface": list(interface)} | line | {"told_apart": _told_apart(mine, line["criterion"])}
                    for interface, mine in partial.items()
                    for line in attractor_states.rank_correlation(mine, CRITERIA, MEASURED)]
    early = [line for line in records if line["family"] == "again" and line["settled_at"]]
    return {"states": [_state(motions, labels, label) for label in range(count - 1)], "rows": rows, "chance": limit,
            "again": {"starts": len(again), "shares": attractor_states.shares(again, count), "distance": self_distance,
                      "settled_at_most": max((line["settled_at"] for line in early), default=None)},
            "correlations": correlations, "unsettled": int(np.sum(labels == count - 1)),
            "seconds": float(sum(line["seconds"] for line in records))}


def first_of_each(records: Sequence[Row]) -> list[int]:
    """The number of the first random start of the full model that ended in each of its states."""
    mine = [line for line in records if line["method"] == "full" and line["family"] == "random" and line["settled"]]
    labels = attractor_states.states([Motion.of(line["motion"]) for line in mine])
    return [mine[labels.index(label)]["number"] for label in dict.fromkeys(labels)]


def _distance(labels: Sequence[int], reference: Sequence[int], count: int) -> float:
    """The total variation between the shares of two sets of starts."""
    return attractor_states.total_variation(*(attractor_states.shares(part, count) for part in (labels, reference)))


def _told_apart(rows: Sequence[Row], criterion: str) -> float:
    """How often a model that does not agree has the larger value of a criterion than one that does: 0.5 is chance, 1 always."""
    good, bad = (np.array([row[criterion] for row in rows if row["agrees"] == agrees]) for agrees in (True, False))
    pairs = np.sign(bad[:, None] - good[None, :])
    return float((pairs.mean() + 1) / 2) if pairs.size else np.nan


def _errors(mine: Sequence[Motion], reference: Sequence[Motion]) -> Row:
    """Medians over starts: of the dominant frequency and of the rms; the mean of the power that stands on other lines."""
    pairs = list(zip(mine, reference, strict=True))
    return {"error_frequency": float(np.median([_relative(one.omega, other.omega) for one, other in pairs])),
            "error_amplitude": float(np.median([_relative(one.rms, other.rms) for one, other in pairs])),
            "error_spectrum": float(np.mean([1 - attractor_states.overlap(one, other) for one, other in pairs]))}


def _relative(value: float, exact: float) -> float:
    return abs(value - exact) / exact if exact else float(value != exact)


def _state(motions: Sequence[Motion], labels: np.ndarray, label: int) -> Row:
    mine = [motions[at] for at in np.flatnonzero(labels == label)]
    leader = mine[0]
    strongest = sorted(leader.lines, key=lambda line: -line[1])[:4]
    return {"state": ascii_uppercase[label] if label < 26 else f"S{label}", "omega": leader.omega, "periodic": leader.periodic,
            "lines": [[round(at, 5), round(share, 3)] for at, share in strongest], "count": len(mine),
            "omega_least": min(one.omega for one in mine), "omega_most": max(one.omega for one in mine),
            "rms_least": min(one.rms for one in mine), "rms_most": max(one.rms for one in mine),
            "sticking": float(np.median([one.sticking for one in mine]))}


def text(found: dict[str, Any]) -> str:
    """The three tables and what follows from them."""
    states = found["states"]
    names = [state["state"] for state in states] + ["not settled"]
    parts = [table(
        ["state", "kind", "lines (share of power)", "rms", "sticking", "trajectories"],
        [[state["state"], "periodic" if state["periodic"] else "not periodic",
          "  ".join(f"{at:.4f} ({share:.2f})" for at, share in state["lines"] if share > 0.02),
          f"{state['rms_least']:.3f}-{state['rms_most']:.3f}", state["sticking"], state["count"]] for state in states],
        ["s", "s", "s", "s", ".0%", "d"])]
    rows = found["rows"]
    parts.append(table(
        ["model", "interface", "DOF", "shares", "distance", "95 % interval", "agrees", "holds", "same state", "err ω", "err rms",
         "growing", "missing", "spurious", "growth dist.", "mean compl."],
        [[SHORT[row["method"]], _interface(row["interface"]), row["size"], _told(row["shares"], names), row["distance"],
          f"{row['distance_low']:.2f}-{row['distance_high']:.2f}", "yes" if row["agrees"] else "no",
          "".join(names[at] for at in row["holds"]) or "none", row["same_start_same_state"],
          row["error_frequency"], row["error_amplitude"], row["growing"] - row["missing"] + row["spurious"], row["missing"],
          row["spurious"], row["growth_distance"], row["compliance_mean"]] for row in rows],
        ["s", "s", "d", "s", ".2f", "s", "s", "s", ".0%", ".1e", ".1e", "d", "d", "d", ".2f", ".3f"], keys=3))
    again = found["again"]
    parts.append(f"The full model against itself with {again['starts']} other starts, each followed to the end: distance "
                 f"{again['distance']:.3f}; by chance at most {found['chance']:.3f} (95 %). Not settled: {found['unsettled']}.")
    named = Counter((f"impulse {names[row['impulse']]}", f"rest {names[row['rest']]}") for row in rows)
    parts.append("From an impulse of 1e-3 and from rest: " + "; ".join(
        f"{SHORT[row['method']]} {row['size']} {_interface(row['interface'])}: {names[row['impulse']]}, {names[row['rest']]}"
        for row in rows) + f" ({len(named)} different pairs).")
    if found["correlations"]:
        parts.append("Reduced models that are not complete: how often a criterion is larger for one that does not agree than for "
                     "one that does, and Spearman's rank correlation with what was measured")
        parts.append(table(
            ["criterion", "interface", "tells apart", "distance of shares", "spectrum", "frequency", "amplitude"],
            [[line["criterion"], _interface(line["interface"]), *(_number(line[name]) for name in ("told_apart", *MEASURED))]
             for line in found["correlations"]], ["s", "s", ".0%", "+.2f", "+.2f", "+.2f", "+.2f"]))
    parts.append("\n".join(conclusion(found)))
    return "\n\n".join(parts)


def conclusion(found: dict[str, Any]) -> list[str]:
    """From how many DOF on each method agrees, one line for each interface."""
    lines = []
    rows = sorted((row for row in found["rows"] if row["method"] != "full"), key=lambda row: -row["size"])
    for method, interface in dict.fromkeys((row["method"], tuple(row["interface"])) for row in rows):
        mine = [row for row in rows if (row["method"], tuple(row["interface"])) == (method, interface)]
        least = None
        for row in mine:
            if not row["agrees"]:
                break
            least = row["size"]
        told = f"agrees from {least} DOF on" if least is not None else "agrees with no number of DOF"
        lines.append(f"{SHORT[method]}, interface {_interface(interface)}: {told}")
    return lines


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _interface(masses: Sequence[int]) -> str:
    return "{" + ", ".join(f"m{mass}" for mass in masses) + "}"


def _told(parts: Sequence[float], names: Sequence[str]) -> str:
    shown = sorted(((share, name) for share, name in zip(parts, names, strict=True) if share > 0), reverse=True)
    return " ".join(f"{name} {100 * share:.0f}%" for share, name in shown)


def draw(found: dict[str, Any]) -> Any:
    """Stacked shares over the DOF, HCB above CC, the full model to the right; below, the distance from the full model."""
    from femsub.app.figure_style import PAGE, new_figure
    from femsub.studies import look

    rows, states = found["rows"], found["states"]
    interfaces = list(dict.fromkeys(tuple(row["interface"]) for row in rows if row["method"] != "full"))
    methods = list(dict.fromkeys(row["method"] for row in sorted(rows, key=lambda row: row["method"]) if row["method"] != "full"))
    full = next(row for row in rows if row["method"] == "full")
    sizes = sorted({row["size"] for row in rows if row["method"] != "full"})
    figure = new_figure(PAGE, 7.6)
    panels = figure.subplots(3, len(interfaces), sharex=True, squeeze=False, height_ratios=[3] * len(methods) + [2.4])
    places = [*sizes, sizes[-1] + 1.5, sizes[-1] + 2.5]
    seen = np.any([*(row["shares"] for row in rows), found["again"]["shares"]], axis=0)  # the others were only passed on the way
    own = np.array(full["shares"]) + np.array(found["again"]["shares"]) > 0  # states of the full model itself
    colours = [*_colours(states, own), "white"]
    names = [state["state"] for state in states] + [""]
    for column, interface in zip(panels.T, interfaces, strict=True):
        for panel, method in zip(column, methods, strict=False):
            mine = {row["size"]: row for row in rows if (row["method"], tuple(row["interface"])) == (method, interface)}
            bars = [(size, mine[size]["shares"], mine[size]["holds"]) for size in sizes if size in mine]
            bars += [(places[-2], full["shares"], full["holds"]), (places[-1], found["again"]["shares"], None)]
            for place, parts, holds in bars:
                if holds is not None:
                    panel.text(place, 102, "".join(names[at] for at in holds) or "–", ha="center", va="bottom", fontsize=8)
                below = 0.0
                for share, colour, name in zip(parts, colours, names, strict=True):
                    panel.bar(place, 100 * share, bottom=100 * below, color=colour, width=0.8, edgecolor="0.4", lw=0.4,
                              hatch="///" if colour == "white" else None)
                    if share >= 0.08 and name:
                        panel.text(place, 100 * (below + share / 2), name, ha="center", va="center", fontsize=8,
                                   bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.75})
                    below += share
            panel.axvline(sizes[-1] + 0.75, color="0.5", lw=0.8)
            panel.set_title(f"{look(method).label}, interface {_interface(interface)}")
            panel.set(ylim=(0, 114), yticks=range(0, 101, 20))
        last = column[-1]
        last.axhspan(0, found["chance"], color="0.85", label="within chance (95 %)")
        for method, shift in zip(methods, (-0.08, 0.08), strict=False):
            colour = look(method).colour
            mine = sorted((row for row in rows if (row["method"], tuple(row["interface"])) == (method, interface)),
                          key=lambda row: row["size"])
            at = np.array([row["size"] for row in mine]) + shift
            middle, low, high = (np.array([row[key] for row in mine]) for key in ("distance", "distance_low", "distance_high"))
            last.errorbar(at, middle, [np.maximum(middle - low, 0), np.maximum(high - middle, 0)], color=colour,
                          marker=look(method).marker, ms=5, capsize=2, lw=1.3, label=f"{look(method).label}: distance of shares")
            last.plot(at, [row["missing_share"] for row in mine], color=colour, marker="x", ms=5, lw=1, ls=":",
                      label=f"{look(method).label}: missing share of growing modes")
        last.plot(places[-1], found["again"]["distance"], "ks", ms=5)
        last.set(ylim=(-0.04, 1.06), xlabel="DOF of the reduced model  [-]")
        last.set_xticks(places, [*(str(size) for size in sizes), "full", "full,\nother\nstarts"])
        last.axvline(sizes[-1] + 0.75, color="0.5", lw=0.8)
        last.grid(alpha=0.3)
    for panel in panels[:-1, 0]:
        panel.set_ylabel("share of starts  [%]")
    panels[-1, 0].set_ylabel("distance from full  [-]")
    from_axis = panels[0, 0]
    told = {colours[at]: f"{state['state']}, of the full model: {'periodic' if state['periodic'] else 'not periodic'}, "
            + " + ".join(f"{line:.3f}" for line, share in state["lines"][:3] if share > 0.08) + " rad/time"
            for at, state in enumerate(states) if own[at]}
    told |= {colours[at]: f"not of the full model, {'periodic' if states[at]['periodic'] else 'not periodic'}"
             for at in np.flatnonzero(seen[:-1] & ~own[:-1])}
    if seen[-1]:
        told["white"] = "not settled"
    keys = [from_axis.bar([0], [0], color=colour, edgecolor="0.4", lw=0.4, hatch="///" if colour == "white" else None)
            for colour in told]
    first, second = panels[-1, 0].get_legend_handles_labels()
    figure.legend(keys + first, [*told.values(), *second], loc="outside lower center", ncols=2, fontsize=8)
    figure.suptitle("Where the starts end, by the letters of the states in the table\n"
                    "above the bars: states of the full model in which the model stays if it is put there", fontsize=9)
    from_axis.set_xlim(sizes[0] - 0.7, places[-1] + 0.7)
    return figure


def _by_name(parts: Sequence[float], names: Sequence[str]) -> dict[str, float]:
    return {name: float(share) for share, name in zip(parts, names, strict=True) if share > 0}


def _colours(states: Sequence[Row], own: np.ndarray) -> list[str]:
    """A colour for each state of the full model; all others have one of two pale ones: they differ by their letters."""
    strong = iter(STRONG * len(states))
    return [next(strong) if mine else PALE[state["periodic"]] for state, mine in zip(states, own, strict=False)]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = runs.Settings()
    parser.add_argument("--starts", type=int, default=32, metavar="N", help="random starts per model (default 32)")
    parser.add_argument("--sizes", type=int, nargs="+", default=list(range(4, 11)), metavar="DOF", help="default 4 to 10")
    parser.add_argument("--interfaces", nargs="+", default=["1", "1,2"], metavar="MASSES", help="default: 1 and 1,2")
    parser.add_argument("--seed", type=int, default=default.seed, metavar="S", help=f"default {default.seed}")
    parser.add_argument("--earliest", type=float, default=default.earliest, metavar="T",
                        help=f"nothing has settled before (default {default.earliest:g})")
    parser.add_argument("--latest", type=float, default=default.latest, metavar="T",
                        help=f"where a trajectory is given up (default {default.latest:g})")
    parser.add_argument("--window", type=float, default=default.window, metavar="T", help=f"default {default.window:g}")
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="processes (default 2)")
    parser.add_argument("--out", type=Path, default=Path("out/attractors"), metavar="DIR", help="default out/attractors")
    asked = parser.parse_args()
    try:
        interfaces = [tuple(int(mass) for mass in one.split(",")) for one in asked.interfaces]
    except ValueError:
        parser.error("--interfaces takes masses such as 1 or 1,2")
    if asked.starts < 2 or asked.workers < 1 or not 200 <= asked.window <= asked.earliest <= asked.latest:
        parser.error("--starts must be at least 2, --workers at least 1, and 200 <= --window <= --earliest <= --latest")
    if any(not 2 <= size <= default.masses for size in asked.sizes):
        parser.error(f"--sizes must be between 2 and {default.masses}")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # leave in order, or the processes that compute stay behind
    settings = runs.Settings(seed=asked.seed, window=asked.window, earliest=asked.earliest, latest=asked.latest)
    try:
        report.check_folder(str(asked.out))  # to know it now and not at the end
        wanted = runs.tasks(settings, sorted(set(asked.sizes)), interfaces, asked.starts)
        file = asked.out / "trajectories.jsonl"
        records = runs.run(file, settings, wanted, asked.workers, report.progress)
        records += runs.run(file, settings, runs.carried(wanted, first_of_each(records)), asked.workers, report.progress)
    except fs.InputError as error:
        parser.error(str(error))
    except KeyboardInterrupt:
        report.progress_done()
        print(f"interrupted; what is done is in {asked.out / 'trajectories.jsonl'}, the same command goes on from there",
              file=sys.stderr)
        return 130
    report.progress_done()
    found = evaluate(settings, records)
    names = [state["state"] for state in found["states"]] + ["not settled"]
    plain = found | {"rows": [row | {"shares": _by_name(row["shares"], names), "holds": [names[at] for at in row["holds"]],
                                     "impulse": names[row["impulse"]], "rest": names[row["rest"]]} for row in found["rows"]],
                     "again": found["again"] | {"shares": _by_name(found["again"]["shares"], names)}}
    data = {"settings": runs.asdict(settings), "starts": asked.starts, "machine": report.machine() | report.versions(), **plain}
    flat = [{key: value for key, value in row.items() if key not in ("shares", "holds", "verdict")} for row in found["rows"]]
    result = Result(data, [text(found), Table("attractors", flat)])
    print(result.text())
    report.write(result, asked.out, figures=False, name="attractors")
    save(asked.out / "attractors.png", lambda: draw(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
