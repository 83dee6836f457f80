"""The memory of this process: how much is available, and how freed memory is returned to the system."""

from __future__ import annotations

import ctypes
import os
from contextlib import suppress
from pathlib import Path


def give_back_freed_memory() -> None:
    """Make malloc return large freed blocks to the system.

    Loading OpenMPI disables mmap in malloc, so freed memory is not returned. This restores the default.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):
        for option, value in ((-3, 1 << 25), (-1, 1 << 26), (-4, 1 << 16)):  # M_MMAP_THRESHOLD, M_TRIM_THRESHOLD, M_MMAP_MAX
            libc.mallopt(option, value)


def available() -> float | None:
    """Bytes that this process may still allocate, by the system's and its own limit; None if unknown."""
    found = [] if (limit := left_of_limit()) is None else [limit]
    with suppress(OSError, KeyError, ValueError):
        lines = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines())
        found.append(1024.0 * int(lines["MemAvailable"].split()[0]))
    with suppress(OSError, ValueError):  # a container's own limit
        group = Path("/sys/fs/cgroup")
        found.append(float((group / "memory.max").read_text()) - float((group / "memory.current").read_text()))
    return min(found, default=None)


def left_of_limit() -> float | None:
    """Bytes left of this process' own limit of address space or data (`ulimit -v`, `ulimit -d`); None without a limit."""
    try:
        from resource import RLIM_INFINITY, RLIMIT_AS, RLIMIT_DATA, getrlimit

        pages = [int(word) for word in Path("/proc/self/statm").read_text(encoding="ascii").split()]
    except (ImportError, OSError, ValueError):
        return None
    limits = ((getrlimit(RLIMIT_AS)[0], pages[0]), (getrlimit(RLIMIT_DATA)[0], pages[5]))
    return min((limit - used * os.sysconf("SC_PAGE_SIZE") for limit, used in limits if limit != RLIM_INFINITY), default=None)
