#!/usr/bin/env python3
"""Repeated and clustered spectra, by count and by band with its ends on eigenvalues: is every one there, and is any refused?

    python scripts/clusters.py [--models 500] [--first 0] [--kind TEXT]

The random models are those of benchmarks/clusters.py. One line for each that is wrong or refused, then a table of counts. Exits
with 1 if there is any.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter

import scipy.sparse as sp

from benchmarks.clusters import evaluate, make


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", type=int, default=500)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kind", default="")
    args = parser.parse_args()
    counts: Counter[tuple[str, str, str, str]] = Counter()
    for number in range(args.first, args.first + args.models):
        case = make(number)
        if args.kind not in case.kind:
            continue
        told = evaluate(case)
        verdict = told.partition(":")[0] or "right"
        counts[case.kind, "sparse" if sp.issparse(case.model.K) else "dense", next(iter(case.ask)), verdict] += 1
        if told:
            print(f"{number}: {case}: {told}", flush=True)
    for key, count in sorted(counts.items()):
        print("  ".join(f"{part:12}" for part in key), count)
    total = Counter(key[3] for key in counts.elements())
    print(dict(total))
    return int(set(total) != {"right"})


if __name__ == "__main__":
    sys.exit(main())
