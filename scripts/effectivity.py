"""Are the estimates of `reduce(sub, CraigBampton(band=…, tol=…))` right, and do they choose well? Over benchmarks/gallery.py.

    python scripts/effectivity.py [--only TEXT] [--out out/effectivity]

For each component and method: the estimates of bases that the search could choose against the true error (all
eigenvalues of the full model by LAPACK), and for 1e-2, 1e-3, 1e-4 and 1e-6 the modes chosen against the fewest that would
do. "No mode to spare" are the largest bases that the modes at hand allow, of which the estimates know least. A band ends
below 0.7 of the cut-off, in the choice and in "would do". Writes effectivity.json, row by row: what is there is not
measured again; effectivity.txt (the summary) and effectivity.png.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import femsub as fs
from benchmarks import gallery
from benchmarks.pictures import save
from femsub.algebra.factor import release
from femsub.app.figure_style import PAGE, legend_below, new_figure
from femsub.io.atomic import write_whole
from femsub.model.bands import within
from femsub.model.estimate import SHARE
from femsub.modes import match
from femsub.reduction.estimates.found_modes import FoundModes
from femsub.reduction.estimates.nested import FAR, Nested
from femsub.reduction.estimates.search import Space
from femsub.studies import look

ROOT = Path(__file__).resolve().parent.parent
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-6)
SMALLEST = 1e-10  # true relative errors below it are rounding
CLUSTER = 1e-6  # frequencies and eigenvalues nearer than this, relatively, count as one, with the largest figures


def true_errors(problem: gallery.Problem, omega: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Relative errors of a reduced model's ω and λ over the full model's in the band, and the λ that these belong to.

    Infinite where the reduced model has none to match.
    """
    exact = problem.omega
    low = np.full(len(exact), np.inf)
    low[:len(omega)] = np.abs(omega[:len(exact)] / exact[:len(omega)] - 1)
    full = problem.eigenvalues
    inside = within(full, problem.band)
    error, partner = np.full(len(full), np.inf), np.full(len(full), np.nan + 0j)
    if inside.any():
        at, to = match(full, values, far=FAR)
        error[at], partner[at] = np.abs(values[to] - full[at]) / np.abs(full[at]), values[to]
    return low, error[inside], partner[inside]


def pairs(exact: np.ndarray, error: np.ndarray, estimate: np.ndarray) -> list[tuple[float, float]]:
    """(true error, estimate), the largest of each cluster."""
    result = []
    order = np.argsort(np.abs(exact), kind="stable")
    exact, error, estimate = exact[order], error[order], estimate[order]
    starts = np.flatnonzero(np.append(True, np.abs(np.diff(exact)) > CLUSTER * np.abs(exact[1:]))) if len(exact) else []
    for group in np.split(np.arange(len(exact)), starts[1:]) if len(exact) else []:
        if error[group].max() > SMALLEST:
            result.append((float(f"{error[group].max():.4g}"), float(f"{estimate[group].max():.4g}")))
    return result


def compared(problem: gallery.Problem, nested: Nested, count: int, tol: float) -> dict[str, Any]:
    """Estimate and truth for one basis."""
    found = nested.estimate(count, problem.band, tol)
    values = nested.damped(count)[0] if nested.D is not None else np.zeros(0, dtype=complex)
    low, error, partner = true_errors(problem, nested.undamped(count)[0], values)
    row: dict[str, Any] = {"modes": count, "worst": max(low.max(initial=0.0), error.max(initial=0.0)), "estimate": found.worst}
    known = min(len(low), len(found.frequencies))
    row["omega"] = pairs(problem.omega[:known], low[:known], found.frequency_error[:known])
    if len(error):
        near = np.array([np.argmin(np.abs(found.eigenvalues - value)) if len(found.eigenvalues) else 0 for value in partner])
        matched = np.array([len(found.eigenvalues) > 0 and abs(found.eigenvalues[i] - value) <= 1e-9 * abs(value)
                            for i, value in zip(near, partner, strict=True)])
        estimate = np.where(matched, found.eigenvalue_error[near] if len(found.eigenvalues) else np.inf, np.inf)
        full = problem.eigenvalues[within(problem.eigenvalues, problem.band)]
        use = np.isfinite(estimate) & np.isfinite(error)
        row["lambda"] = pairs(full[use], error[use], estimate[use])
        row["unpaired"] = int((~use).sum())
    return row


def measure(problem: gallery.Problem, kind: type) -> dict[str, Any]:
    """All of one component and method."""
    sub, band = problem.sub, problem.band
    pencil = sub.linearised(problem.belt)
    damped = pencil if pencil.norms[1] > 0 else None
    extra = np.hstack([w.reshape(sub.size, -1) for w in sub.ports.values()]) if problem.ports else np.zeros((sub.size, 0))
    result: dict[str, Any] = {"problem": problem.name, "method": kind.__name__, "size": sub.size, "below": len(problem.omega),
                              "tolerances": [], "bases": []}
    def of_modes(count: int) -> tuple[FoundModes, Nested]:
        part = FoundModes(gallery.statics(kind, sub, extra), damped, count)
        reference = (space := Space(sub.name, {"": part})).reference()
        return part, reference.nested if damped is None else space.extended(reference, band)

    whole = of_modes(sub.size)[1]
    worst: dict[int, float] = {}

    def truth(count: int) -> float:
        if count not in worst:
            values = whole.damped(count)[0] if whole.D is not None else np.zeros(0, dtype=complex)
            low, error, _ = true_errors(problem, whole.undamped(count)[0], values)
            worst[count] = max(low.max(initial=0.0), error.max(initial=0.0))
        return worst[count]

    cutoffs = np.array([whole.cutoff(count) for count in range(whole.modes + 1)])
    first = int(np.searchsorted(SHARE * cutoffs, band[1], side="right"))
    for tol in TOLERANCES:
        release(sub)  # seconds are those of a first call
        start = time.perf_counter()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fs.PortWarning)
            rom = fs.reduce(sub, kind(band=band, tol=tol), ports=problem.ports, contacts=problem.belt)
        seconds = time.perf_counter() - start
        assert rom.estimate is not None
        modes = fs.normal_modes(rom, band=(0.0, min(1.5 * band[1], rom.cutoff)))
        values = gallery.positive(rom.linearised(problem.belt)) if damped else np.zeros(0, dtype=complex)
        low, error, _ = true_errors(problem, modes.frequencies[modes.rigid:], values)
        fewest = next(count for count in range(first, whole.modes + 1) if truth(count) <= tol)
        free = next(count for count in range(whole.modes + 1) if truth(count) <= tol)
        result["tolerances"].append({
            "tol": tol, "modes": rom.modes, "fewest": fewest, "fewest_without_rule": free, "searched": rom.estimate.searched,
            "true": max(low.max(initial=0.0), error.max(initial=0.0)), "estimate": rom.estimate.worst, "seconds": seconds})
    for known in sorted({min(whole.modes, row["searched"]) for row in result["tolerances"]} |
                        {min(whole.modes, row["modes"] + 1) for row in result["tolerances"]}):
        part, nested = of_modes(known)
        most = part.most
        low = int(np.searchsorted(SHARE * cutoffs[:most + 1], band[1], side="right"))
        if low <= most:
            for count in sorted({*np.linspace(low, most, 6).astype(int).tolist()}):
                result["bases"].append({"known": nested.modes} | compared(problem, nested, count, 1e-3))
    return result


def figures(rows: list[dict[str, Any]], key: str, hard: bool = False) -> np.ndarray:
    """Estimate over true error; only of the largest basis that the modes at hand allow, where `hard`."""
    found = np.array([pair for row in rows for basis in row["bases"] for pair in basis.get(key, [])
                      if not hard or basis["modes"] >= basis["known"] - 1]).reshape(-1, 2)
    return found[:, 1] / found[:, 0]


def summary(rows: list[dict[str, Any]]) -> str:
    lines = []
    for method in ("CraigBampton", "CraigChang"):
        mine = [row for row in rows if row["method"] == method]
        for key in ("omega", "lambda"):
            for hard in (False, True):
                share = figures(mine, key, hard)
                if len(share):
                    lines.append(f"{method:<13}{key:<7}{'no mode to spare' if hard else 'all':<17}{len(share):>6} figures: "
                                 f"{share.min():.3g} to {share.max():.3g}, median {np.median(share):.3g}, "
                                 f"{100 * np.mean((share >= 0.5) & (share <= 10)):.1f} % from 0.5 to 10, "
                                 f"{100 * np.mean((share >= 1) & (share <= 10)):.1f} % from 1 to 10")
    kept = [(row, at) for row in rows for at in row["tolerances"]]
    missed = [(row["problem"], row["method"], at["tol"], at["true"]) for row, at in kept if at["true"] > at["tol"]]
    many = [(row["problem"], row["method"], at["tol"], at["modes"], at["fewest"]) for row, at in kept
            if at["modes"] > max(1.5 * at["fewest"], at["fewest"] + 2)]
    lines.append(f"{len(kept)} reductions to a tolerance: {len(missed)} miss it {missed or ''}, {len(many)} take more than 1.5 "
                 f"times, or 2 more than, the fewest {many or ''}")
    lines.append("modes over the fewest: " + ", ".join(
        f"{share:.2f} x in {100 * q} %" for q, share in
        ((q, np.quantile([at["modes"] / max(at["fewest"], 1) for _, at in kept], q)) for q in (0.5, 0.9, 1.0))))
    lines.append("the same without the rule of 0.7: " + ", ".join(
        f"{share:.2f} x in {100 * q} %" for q, share in
        ((q, np.quantile([at["modes"] / max(at["fewest_without_rule"], 1) for _, at in kept], q)) for q in (0.5, 0.9, 1.0))))
    unpaired = sum(basis.get("unpaired", 0) for row in rows for basis in row["bases"])
    lines.append(f"{unpaired} eigenvalues without an estimate of their own")
    return "\n".join(lines)


def draw(rows: list[dict[str, Any]]) -> Any:
    """How many estimates are how far from the error, and modes chosen over the fewest that would do."""
    figure = new_figure(PAGE, 4.4)
    axes = figure.subplots(1, 3)
    looks = {"CraigBampton": look("craig-bampton"), "CraigChang": look("craig-chang")}
    bins = np.logspace(-0.5, 1.5, 81)  # 1 is an edge
    for axis, key, what in ((axes[0], "omega", "undamped ω"), (axes[1], "lambda", "complex λ")):
        for method, (label, colour, _) in looks.items():
            mine = [row for row in rows if row["method"] == method]
            share, hard = (np.clip(figures(mine, key, hard), bins[0], bins[-1]) for hard in (False, True))
            if len(share):
                axis.hist(share, bins, color=colour, alpha=0.4, label=f"{label}, all bases")
                axis.hist(hard, bins, color=colour, histtype="step", lw=1.2, label=f"{label}, no mode to spare")
        axis.axvspan(1, 10, color="0.9", zorder=0, label="wanted for 90 %")
        for edge in (0.5, 10):
            axis.axvline(edge, color="0.4", ls="--", lw=1, label="0.5 and 10")
        axis.set(xscale="log", yscale="log", ylim=(0.7, 1e5), xlabel="estimate / true error  [-]",
                 title=f"effectivity, {what}")
    axes[0].set_ylabel("number of modes  [-]")
    markers = dict(zip(TOLERANCES, "osD^", strict=True))
    for method, (label, colour, _) in looks.items():
        for tol, marker in markers.items():
            mine = [at for row in rows if row["method"] == method for at in row["tolerances"] if at["tol"] == tol]
            x, y = ([max(at[key], 0.7) for at in mine] for key in ("fewest", "modes"))
            axes[2].plot(x, y, marker, color=colour, ms=4, alpha=0.6, label=f"{label}, tol = {tol:g}")
    line = np.geomspace(0.7, max(at["fewest"] for row in rows for at in row["tolerances"]) * 1.2, 200)
    axes[2].plot(line, line, "k-", lw=0.8, label="the fewest")
    axes[2].plot(line, np.maximum(1.5 * line, line + 2), "k--", lw=0.8, label="1.5 times as many, or 2 more")
    axes[2].set(xscale="log", yscale="log", xlabel="fewest modes that would do  [-]", ylabel="modes chosen  [-]", title="choice")
    legend_below(figure, axes, 3)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="components whose name holds this text")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "effectivity")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    file = asked.out / "effectivity.json"
    rows: list[dict[str, Any]] = json.loads(file.read_text()) if file.exists() else []
    done = {(row["problem"], row["method"]) for row in rows}
    for problem in gallery.GALLERY:
        for kind in problem.kinds:
            if asked.only in problem.name and (problem.name, kind.__name__) not in done:
                start = time.perf_counter()
                rows.append(measure(problem, kind))
                text = json.dumps(rows).encode()
                write_whole(asked.out, {file.name: lambda stream, text=text: stream.write(text)})
                told = ", ".join(f"{at['tol']:g}: {at['modes']} ({at['fewest']}) {at['true']:.1e}"
                                 for at in rows[-1]["tolerances"])
                print(f"{problem.name}, {kind.__name__}: {told}; {time.perf_counter() - start:.0f} s", flush=True)
    told = summary(rows)
    write_whole(asked.out, {"effectivity.txt": lambda stream: stream.write(f"{told}\n".encode())})
    print(told)
    save(asked.out / "effectivity.png", lambda: draw(rows))


if __name__ == "__main__":
    main()
