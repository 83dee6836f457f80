"""Random attacks on numbers, each case beside a reference of its own.

    python -m benchmarks attack SUBJECT [--cases 3000] [--seed 0] [--kind KIND] [--workers 1]

SUBJECT is a module of benchmarks/attacks, beside `common`. Each case is compared with a reference of its own. The counts are
printed by kind and outcome. A case that crashes its process or takes longer than --limit is wrong. Exit status 1 if one was.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from queue import SimpleQueue

from benchmarks.processes import StoppedError, Worker

SUBJECTS = sorted(item.name for item in iter_modules([str(Path(__file__).parent / "attacks")]) if item.name != "common")


def attacked(subject: str, kind: str, seed: int) -> str:
    """The outcome of one case; an exception is one, too."""
    try:
        return import_module(f"benchmarks.attacks.{subject}").attacked(kind, seed)
    except Exception as error:
        return f"wrong: seed {seed}: {type(error).__name__}: {error}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("subject", choices=SUBJECTS)
    parser.add_argument("--cases", type=int, default=3000, help="number of cases, over all kinds")
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--kind", help="one kind alone")
    parser.add_argument("--workers", type=int, default=1, help="number of processes")
    parser.add_argument("--limit", type=float, default=600.0, metavar="SECONDS", help="for one case (default 600)")
    given = parser.parse_args()
    kinds = import_module(f"benchmarks.attacks.{given.subject}").KINDS
    if given.kind is not None and given.kind not in kinds:
        parser.error(f"--kind {given.kind}: {given.subject} has {', '.join(kinds)}")
    tasks = [(kind, given.seed + i) for i in range(given.cases) for kind in (kinds if given.kind is None else (given.kind,))]
    tasks = tasks[:given.cases]
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of the worker processes, which are started below
    idle: SimpleQueue[Worker] = SimpleQueue()
    for _ in range(given.workers):
        idle.put(Worker())

    def outcome_of(task: tuple[str, int]) -> str:
        worker = idle.get()
        try:
            return worker(attacked, given.subject, *task, limit=given.limit)
        except StoppedError as error:
            return f"wrong: seed {task[1]}: {error}"
        finally:
            idle.put(worker)

    outcomes: Counter[tuple[str, str]] = Counter()
    start = time.perf_counter()
    with ThreadPoolExecutor(given.workers) as threads:
        for done, ((kind, _), outcome) in enumerate(zip(tasks, threads.map(outcome_of, tasks), strict=True), 1):
            outcomes[kind, outcome.split(":")[0]] += 1
            if outcome.startswith("wrong"):
                print(f"{kind}: {outcome}", flush=True)
            if sys.stderr.isatty():
                print(f"\r{done} of {len(tasks)}", end="" if done < len(tasks) else "\n", file=sys.stderr)
    while not idle.empty():
        idle.get().close()
    for (kind, outcome), count in sorted(outcomes.items()):
        print(f"{kind}: {outcome}: {count}")
    wrong = sum(count for (_, outcome), count in outcomes.items() if outcome == "wrong")
    print(f"{given.subject}: {len(tasks)} cases, {wrong} wrong, {time.perf_counter() - start:.0f} s")
    return min(wrong, 1)


if __name__ == "__main__":
    sys.exit(main())
