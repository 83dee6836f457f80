"""Long work: what its seconds went into, and what is left of it after Ctrl-C.

Phases are named where the work is done, and added up by whoever asks.

    @phase("factorisation")              with timed() as seconds:
    def _factorise(...): ...                 reduce(sub, method)        # seconds["factorisation"], ...

A phase within another is taken out of it. Where nobody asks, a phase costs a look at one variable.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import ParamSpec, Self, TypeVar

P = ParamSpec("P")
R = TypeVar("R")
_asked: ContextVar[tuple[dict[str, float], list[float]] | None] = ContextVar("femsub_phases", default=None)


class Interruptible:
    """Ctrl-C ends the block, and not the program: what it has done by then is kept, and `complete` is False.

    with Interruptible() as work:
        for model in models:
            kept.append(run(model))
    if not work.complete: ...                                   # tell it; the command then ends with a status that is not 0
    """

    complete = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> bool:
        stopped = kind is not None and issubclass(kind, KeyboardInterrupt)
        self.complete = self.complete and not stopped
        return stopped


@contextmanager
def timed() -> Iterator[dict[str, float]]:
    """Seconds by phase of what runs inside; a phase that did not occur is not in it."""
    seconds: dict[str, float] = {}
    token = _asked.set((seconds, []))
    try:
        yield seconds
    finally:
        _asked.reset(token)


def phase(name: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Gives the seconds of each call to the phase `name`, less those of phases within."""

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
