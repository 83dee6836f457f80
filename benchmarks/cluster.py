"""What more workers would take for tasks whose seconds were measured: list scheduling, with what goes over the network."""

from __future__ import annotations

import heapq
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

NETWORK = 1e9  # bytes a second to a worker
LATENCY = 1e-3  # seconds before a file arrives


class Measured(Protocol):
    """One task: the names of those it needs, its seconds, and the bytes of its result."""

    below: tuple[str, ...]
    seconds: float
    bytes: float


@dataclass(frozen=True)
class Simulated:
    """`busy` is the share of the workers' time that they work; `sent` are bytes over the network."""

    workers: int
    seconds: float
    busy: float
    sent: float


def simulated(tasks: Mapping[str, Measured], workers: int, network: float = NETWORK, latency: float = LATENCY) -> Simulated:
    """Each task begins when those below it are done and a worker is free; of several, the one with the longest way to the end.

    A worker has its own results at hand. What others made is sent to it first.
    """
    above = {below: name for name, task in tasks.items() for below in task.below}
    way: dict[str, float] = {}
    for name in tasks:
        path = [name]
        while path[-1] in above and path[-1] not in way:
            path.append(above[path[-1]])
        for one in reversed(path):
            way.setdefault(one, tasks[one].seconds + way.get(above.get(one, ""), 0.0))
    open_ = {name: len(task.below) for name, task in tasks.items()}
    ready = [(-way[name], name) for name, count in open_.items() if not count]
    heapq.heapify(ready)
    free, place = list(range(workers)), dict[str, int]()
    running: list[tuple[float, int, str]] = []
    now = sent = worked = 0.0
    while ready or running:
        while ready and free:
            _, name = heapq.heappop(ready)
            homes = [place[below] for below in tasks[name].below]
            worker = next((home for home in homes if home in free), free[0])
            free.remove(worker)
            foreign = [tasks[below].bytes for below in tasks[name].below if place[below] != worker]
            sent += sum(foreign)
            worked += tasks[name].seconds
            heapq.heappush(running, (now + sum(size / network + latency for size in foreign) + tasks[name].seconds, worker, name))
            place[name] = worker
        now, worker, name = heapq.heappop(running)
        free.append(worker)
        if (parent := above.get(name)) is not None:
            open_[parent] -= 1
            if not open_[parent]:
                heapq.heappush(ready, (-way[parent], parent))
    return Simulated(workers, now, worked / (workers * now) if now else 1.0, sent)
