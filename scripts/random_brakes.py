"""Does a basis of contact modes with a tolerance miss an unstable mode? Over random small brakes, against dense full solutions.

    python scripts/random_brakes.py [--brakes 200] [--from 0] [--out out/random-brakes]

For each brake of benchmarks/random_brakes.py: ``reduce(system, ContactModes(band, tol=1e-3, contacts))`` and the verdicts of
`complex_modes`, mode by mode; the estimate against the true errors; where it says that λ of the full system is; and the number
of DOF against the fewest whose true errors meet the tolerance. An unstable mode of the full model is missed if the model calls
its counterpart stable, or has none. Writes random-brakes.json, row by row: what is there is not measured again; and
random-brakes.txt, the summary. Seconds are those of the processor.
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
from benchmarks.random_brakes import TOL, fewest, judged, random_brake
from femsub.io.atomic import write_whole

ROOT = Path(__file__).resolve().parent.parent
SMALLEST = 1e-9  # true relative errors below it are rounding


def measure(seed: int) -> dict[str, Any]:
    """All of one brake."""
    brake = random_brake(seed)
    row: dict[str, Any] = {"seed": seed, "kind": brake.kind, "traits": brake.traits, "size": brake.system.size, "mu": brake.mu,
                           "pads": len(brake.contacts)}
    start = time.process_time()
    try:
        row |= judged(brake)
    except fs.NotConvergedError as error:
        row |= {"refused": str(error)}
    row["seconds"] = time.process_time() - start
    if "basis" in row:
        row["fewest"] = fewest(brake, row["basis"])
    return row


def summary(rows: list[dict[str, Any]]) -> str:
    """What is asked of them, in lines."""
    done = [row for row in rows if "refused" not in row]
    total = {key: sum(row[key] for row in done) for key in ("wanted", "unstable", "missed", "undecided", "invented", "outside")}
    lines = [f"{len(rows)} brakes of {min(row['size'] for row in rows)} to {max(row['size'] for row in rows)} DOF, "
             f"{len(rows) - len(done)} refused: {[row['seed'] for row in rows if 'refused' in row]}",
             f"{total['wanted']} modes in the bands; unstable in the full models: {total['unstable']}, in "
             f"{sum(row['unstable'] > 0 for row in done)} brakes",
             f"of these missed: {total['missed']} {[row['seed'] for row in done if row['missed']]}; verdict None for "
             f"{total['undecided']} {[row['seed'] for row in done if row['undecided']]}",
             f"stable modes of the full models that are called unstable: {total['invented']} "
             f"{[row['seed'] for row in done if row['invented']]}"]
    clear = [row for row in done if row["full"] is not None]
    none = [row["seed"] for row in clear if row["rom"] is None]
    wrong = [row["seed"] for row in clear if row["rom"] is not None and row["rom"] != row["full"]]
    lines.append(f"verdicts: {len(clear)} full models are clearly stable or unstable; None for {len(none)} of their models "
                 f"({100 * len(none) / max(len(clear), 1):.1f} %) {none}; wrong for {len(wrong)} {wrong}")
    pairs = np.array([pair for row in done for pair in row["pairs"] if pair[0] > SMALLEST]).reshape(-1, 2)
    share = pairs[:, 1] / pairs[:, 0]
    lines.append(f"true errors: at most {max(row['true'] for row in done):.3g} of {TOL:g}; estimate over true error, "
                 f"{len(pairs)} above {SMALLEST:g}: {share.min():.4g} to {share.max():.4g}, median {np.median(share):.4g}, "
                 f"{int((share < 1).sum())} below 1")
    lines.append(f"λ of the full model outside its circle: {total['outside']}; radii over |λ|: median "
                 f"{np.median([r for row in done for r in row['radii']]):.2g}, largest "
                 f"{max(r for row in done for r in row['radii']):.2g}")
    ratio = np.array([row["basis"] / max(row["fewest"], 1) for row in done])
    lines.append(f"DOF of the models: median {np.median([row['basis'] for row in done]):.0f} of "
                 f"{np.median([row['size'] for row in done]):.0f}; over the fewest that meet the tolerance: median "
                 f"{np.median(ratio):.3f}, 90 % up to {np.quantile(ratio, 0.9):.3f}, largest {ratio.max():.3f}")
    lines.append(f"seconds per brake: median {np.median([row['seconds'] for row in rows]):.2f}, largest "
                 f"{max(row['seconds'] for row in rows):.2f}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--brakes", type=int, default=200)
    parser.add_argument("--from", type=int, default=0, dest="first", help="the first seed")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "random-brakes")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore", fs.PortWarning)  # a pad may reach beyond the edge of a disc
    file = asked.out / "random-brakes.json"
    rows: list[dict[str, Any]] = json.loads(file.read_text()) if file.exists() else []
    done = {row["seed"] for row in rows}
    for seed in range(asked.first, asked.first + asked.brakes):
        if seed not in done:
            rows.append(measure(seed))
            text = json.dumps(rows).encode()
            write_whole(asked.out, {file.name: lambda stream, text=text: stream.write(text)})
            row = rows[-1]
            told = row.get("refused") or (
                f"{row['basis']} ({row['fewest']}), true {row['true']:.2e}, estimate {row['estimate']:.2e}, "
                f"{row['unstable']} unstable, full {row['full']}, rom {row['rom']}")
            print(f"{seed}: {row['kind']} of {row['size']} DOF, {told}; {row['seconds']:.1f} s", flush=True)
    told = summary(rows)
    write_whole(asked.out, {"random-brakes.txt": lambda stream: stream.write(f"{told}\n".encode())})
    print(told)


if __name__ == "__main__":
    main()
