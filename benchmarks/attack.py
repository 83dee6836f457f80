"""Random attacks on femsub's numbers: each case is compared with an independent reference.

    python -m benchmarks attack SUBJECT [--cases 3000] [--seed 0] [--kind KIND] [--workers 1] [--limit 600]
                                       [--texts]

SUBJECT is the subject of a function in benchmarks/attacks. --cases is the number of cases over all kinds, or of one KIND;
--seed is the first seed; --workers is the number of processes. The counts are printed by kind and outcome; with --texts, the
outcome of each case, too. A case that crashes its process or takes longer than --limit seconds is wrong. The exit status is 1 if
a case was wrong.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from queue import SimpleQueue
from typing import Annotated

from benchmarks import UsageError
from benchmarks.attacks.common import SUBJECTS
from benchmarks.processes import StoppedError, Worker

for item in iter_modules([str(Path(__file__).parent / "attacks")]):
    import_module(f"benchmarks.attacks.{item.name}")


def attacked(subject: str, kind: str, seed: int) -> str:
    """The outcome of one case. An exception counts as the outcome 'wrong'."""
    try:
        return SUBJECTS[subject][1](kind, seed)
    except Exception as error:
        return f"wrong: seed {seed}: {type(error).__name__}: {error}"


def main(subject: Annotated[str, sorted(SUBJECTS)], *, cases: int = 3000, seed: int = 0, kind: str = "", workers: int = 1,
         limit: float = 600.0, texts: bool = False) -> int:
    kinds = SUBJECTS[subject][0]
    if kind and kind not in kinds:
        raise UsageError(f"--kind {kind}: {subject} has {', '.join(kinds)}")
    tasks = [(one, seed + i) for i in range(cases) for one in ([kind] if kind else kinds)][:cases]
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for the worker processes, which are started below
    idle: SimpleQueue[Worker] = SimpleQueue()
    for _ in range(workers):
        idle.put(Worker())

    def outcome_of(task: tuple[str, int]) -> str:
        worker = idle.get()
        try:
            return worker(attacked, subject, *task, limit=limit)
        except StoppedError as error:
            return f"wrong: seed {task[1]}: {error}"
        finally:
            idle.put(worker)

    outcomes: Counter[tuple[str, str]] = Counter()
    start = time.perf_counter()
    with ThreadPoolExecutor(workers) as threads:
        for (kind, _), outcome in zip(tasks, threads.map(outcome_of, tasks), strict=True):
            outcomes[kind, outcome.split(":")[0]] += 1
            if texts or outcome.startswith("wrong"):
                print(f"{kind}: {outcome}", flush=True)
    while not idle.empty():
        idle.get().close()
    for (kind, outcome), count in sorted(outcomes.items()):
        print(f"{kind}: {outcome}: {count}")
    wrong = sum(count for (_, outcome), count in outcomes.items() if outcome == "wrong")
    print(f"{subject}: {len(tasks)} cases, {wrong} wrong, {time.perf_counter() - start:.0f} s")
    return min(wrong, 1)
