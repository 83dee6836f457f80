"""Waiting for another process, with a warning if that process is stopped meanwhile (SIGSTOP, Ctrl-Z)."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from femsub.algebra.processes.limits import LOOK, PATIENCE

if TYPE_CHECKING:
    from concurrent.futures import Future

log = logging.getLogger(__name__)


def is_stopped(pid: int) -> bool:
    """Whether a process is stopped, by a signal or a debugger, now and at a second check.

    When a whole group is continued, this process may run a moment before the other one.
    """
    with suppress(OSError):
        for pause in (LOOK, 0.0):
            if Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] not in "Tt":
                return False
            time.sleep(pause)
        return True
    return False


def first_done(futures: Iterable[Future[Any]], at_work: Callable[[], Mapping[int, str]], named: set[int],
               killed: str = "and what the others have done is kept") -> set[Future[Any]]:
    """Wait until at least one future has ended, and return all ended ones. A warning names each working process that is stopped.

    Parameters
    ----------
    futures : iterable of Future
    at_work : function
        Returns {process number: its work} for the processes that may be waited for.
    named : set of int
        Processes that a warning has named; those of this call are added.
    killed : str
        The further effect of `kill -KILL`, for the warning.
    """
    from concurrent.futures import FIRST_COMPLETED, wait

    waiting = [*futures]
    while not (ended := wait(waiting, PATIENCE, FIRST_COMPLETED).done):
        for pid, what in at_work().items():
            if pid not in named and is_stopped(pid):
                named.add(pid)
                log.warning("%s waits: process %d is stopped (state T). `kill -CONT %d` lets it go on; `kill -KILL %d` ends it, "
                            "%s", what, pid, pid, pid, killed)
    return ended
