"""Are the estimates of systems right, and do they choose few modes? Over random systems of 2 to 5 parts.

    python scripts/system_effectivity.py [--systems 240] [--from 0] [--out out/system-effectivity]

For each system of benchmarks/random_systems.py: ``reduce(system, {part: CraigBampton(band, tol=1e-3), ...})`` against the full
system, its estimate against the true errors, and its modes against the fewest that meet the tolerance, found by trying all
numbers of modes of the parts. Then `system_estimate` of the same system with parts by a random method and number of modes.
Writes system-effectivity.json, row by row: what is there is not measured again; and system-effectivity.txt, the summary.
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
from benchmarks.random_systems import Case, random_system
from benchmarks.system_errors import fewest, moving, of_lambda, of_omega
from femsub.io.atomic import write_whole
from femsub.modes.normal_modes import all_modes
from femsub.reduction.estimates.nested import ACCEPTED

ROOT = Path(__file__).resolve().parent.parent
TOL = 1e-3
SMALLEST = 1e-9  # true relative errors below it are rounding
OTHERS = (fs.CraigBampton, fs.CraigChang, fs.Rubin, fs.Herting, fs.MacNeal, fs.DualCraigBampton)


def pairs(case: Case, full: np.ndarray | None, rom: fs.System, estimate: fs.Estimate) -> dict[str, Any]:
    """(true error, estimate) of each frequency and eigenvalue, and the largest true error.

    What rounding in the full matrices may have done to the true error of a frequency is granted to the estimate.
    """
    modes = all_modes(rom.K, rom.M, ACCEPTED)
    error = of_omega(case, modes.frequencies[modes.rigid:])
    known = min(len(error), len(estimate.frequency_error))
    found = estimate.frequency_error[:known]
    found = np.where(np.abs(found - error[:known]) <= case.rounding[:known], np.maximum(found, error[:known]), found)
    row: dict[str, Any] = {"omega": list(zip(error[:known].tolist(), found.tolist(), strict=True)),
                           "true": float(error.max(initial=0.0)), "estimate": estimate.worst, "lacking": len(error) - known}
    if full is not None:
        error, partner = of_lambda(case, full, moving(rom, case.belt))
        row["lambda"] = []
        for one, value in zip(error.tolist(), partner, strict=True):
            near = np.abs(estimate.eigenvalues - value) <= 1e-8 * np.abs(value)
            row["lambda"].append((one, float(estimate.eigenvalue_error[near].max(initial=-1.0))))
        row["true"] = max(row["true"], float(error.max(initial=0.0)))
    return row


def measure(seed: int) -> dict[str, Any]:
    """All of one system."""
    case = random_system(seed)
    full = moving(case.system, case.belt) if case.damped else None
    method = fs.CraigBampton(band=case.band, tol=TOL)
    start = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.PortWarning)
        rom = fs.reduce(case.system, dict.fromkeys(case.system.parts, method), contacts=case.belt)
    seconds = time.perf_counter() - start
    assert rom.estimate is not None
    chosen = np.array([part.modes for part in rom.parts.values()])
    row = {"seed": seed, "parts": case.kinds, "size": case.system.size, "damped": case.damped, "wanted": len(case.omega) - 1,
           "modes": chosen.tolist(), "met": rom.estimate.met, "seconds": seconds} | pairs(case, full, rom, rom.estimate)
    row["fewest"], row["exact"], row["rule"] = fewest(case, full, chosen, TOL)
    random = np.random.default_rng([seed, 1])
    methods = {}
    for name, part in case.system.parts.items():
        kind = OTHERS[int(random.integers(len(OTHERS)))]
        methods[name] = kind(int(min(random.integers(1, 9), len(part.interior) - 1)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fs.FemsubWarning)
        other = fs.reduce(case.system, methods)
        row["other"] = {"methods": [str(one) for one in methods.values()]} | pairs(
            case, full, other, fs.system_estimate(case.system, other, case.band, case.belt))
    return row


def shares(rows: list[dict[str, Any]], key: str) -> np.ndarray:
    """Estimate over true error, of all that are above rounding and have both."""
    both = [pair for row in rows for pair in row.get(key, []) if SMALLEST < pair[0] < 1 and pair[1] >= 0]
    found = np.array(both).reshape(-1, 2)
    return found[:, 1] / found[:, 0]


def summary(rows: list[dict[str, Any]]) -> str:
    lines = [f"{len(rows)} systems of {min(len(r['parts']) for r in rows)} to {max(len(r['parts']) for r in rows)} parts, "
             f"{min(r['size'] for r in rows)} to {max(r['size'] for r in rows)} DOF, {sum(r['damped'] for r in rows)} damped"]
    for title, these in (("tol 1e-3", rows), ("any method", [row["other"] for row in rows if "other" in row])):
        for key, limit in (("omega", "bound"), ("lambda", "estimate")):
            share = shares(these, key)
            if len(share):
                lines.append(f"{title:<11}{key:<7}{len(share):>5} figures, {limit} over true error: {share.min():.4g} to "
                             f"{share.max():.4g}, median {np.median(share):.4g}, "
                             f"{100 * np.mean((share >= 1) & (share <= 10)):.1f} % in 1-10, {int((share < 1).sum())} below 1")
    missed = [row["seed"] for row in rows if not row["true"] <= TOL]
    lines.append(f"tol 1e-3: missed in {len(missed)} {missed or ''}; largest true error "
                 f"{max(row['true'] for row in rows):.3g}")
    share = np.array([sum(row["modes"]) / max(row["fewest"], 1) for row in rows])
    more = [(row["seed"], sum(row["modes"]), row["fewest"]) for row, one in zip(rows, share, strict=True) if one > 1.3]
    lines.append(f"modes over the fewest: median {np.median(share):.3f}, largest {share.max():.3f}, {len(more)} above 1.3 "
                 f"{more or ''}; {sum(not row['exact'] for row in rows)} against a lower bound of the fewest")
    share = np.array([row["rule"] / max(sum(row["modes"]), 1) for row in rows])
    lines.append(f"modes in all systems: {sum(sum(row['modes']) for row in rows)}; {sum(row['rule'] for row in rows)} where all "
                 f"parts have theirs up to one frequency, the lowest that meets the tolerance (median {np.median(share):.2f} "
                 f"times as many, at most {share.max():.2f})")
    lines.append(f"seconds per reduction: median {np.median([row['seconds'] for row in rows]):.2f}, largest "
                 f"{max(row['seconds'] for row in rows):.2f}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--systems", type=int, default=240)
    parser.add_argument("--from", type=int, default=0, dest="first", help="the first seed")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "system-effectivity")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    file = asked.out / "system-effectivity.json"
    rows: list[dict[str, Any]] = json.loads(file.read_text()) if file.exists() else []
    done = {row["seed"] for row in rows}
    for seed in range(asked.first, asked.first + asked.systems):
        if seed not in done:
            start = time.perf_counter()
            rows.append(measure(seed))
            text = json.dumps(rows).encode()
            write_whole(asked.out, {file.name: lambda stream, text=text: stream.write(text)})
            row = rows[-1]
            print(f"{seed}: {row['modes']} ({row['fewest']}{'' if row['exact'] else ' or more'}), true {row['true']:.2e}, "
                  f"estimate {row['estimate']:.2e}; {time.perf_counter() - start:.1f} s", flush=True)
    told = summary(rows)
    write_whole(asked.out, {"system-effectivity.txt": lambda stream: stream.write(f"{told}\n".encode())})
    print(told)


if __name__ == "__main__":
    main()
