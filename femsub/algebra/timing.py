"""Timing of phases.

Phases are named where the work is done, and summed where the times are needed.

    @phase("factorisation")              with timed() as seconds:
    def _factorise(...): ...                 reduce(sub, method)        # seconds["factorisation"], ...

The time of an inner phase is not counted in the outer one. Without `timed()` a phase costs only the test of one variable.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")
_asked: ContextVar[tuple[dict[str, float], list[float]] | None] = ContextVar("femsub_phases", default=None)


@contextmanager
def timed() -> Iterator[dict[str, float]]:
    """Seconds by phase of the code that runs inside; only phases that occur are listed."""
    seconds: dict[str, float] = {}
    token = _asked.set((seconds, []))
    try:
        yield seconds
    finally:
        _asked.reset(token)


def phase(name: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator: add the seconds of each call to the phase `name`, without those of inner phases."""

    def mark(call: Callable[P, R]) -> Callable[P, R]:
        @wraps(call)
        def measured(*arguments: P.args, **options: P.kwargs) -> R:
            asked = _asked.get()
            if asked is None:
                return call(*arguments, **options)
            seconds, within = asked
            within.append(0.0)
            start = time.perf_counter()
            try:
                return call(*arguments, **options)
            finally:
                spent = time.perf_counter() - start
                seconds[name] = seconds.get(name, 0.0) + spent - within.pop()
                if within:
                    within[-1] += spent
        return measured

    return mark
