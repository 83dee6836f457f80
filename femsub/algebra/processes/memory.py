"""The memory of this process: how much is available, how much it took, and how freed memory is returned to the system."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import RLock

from femsub.algebra.processes.limits import LARGE
from femsub.algebra.processes.system import libc

OPTIONS = -3, -1, -4  # of mallopt: M_MMAP_THRESHOLD, M_TRIM_THRESHOLD, M_MMAP_MAX
#: their values outside of `reused_memory`, and inside: freed blocks larger than the first number go back to the system
GIVEN_BACK, KEPT_INSIDE = (1 << 25, 1 << 26, 1 << 16), (1 << 30, (1 << 31) - 1, 1 << 16)


def give_back_freed_memory() -> None:
    """Make malloc return large freed blocks to the system, but not inside `reused_memory`.

    Loading OpenMPI disables mmap in malloc, so freed memory is not returned. This restores the default.
    """
    if hasattr(libc(), "mallopt"):
        for option, value in zip(OPTIONS, KEPT_INSIDE if _Reuse.depth else GIVEN_BACK, strict=True):
            libc().mallopt(option, value)


class _Reuse:
    """The number of calls that keep freed memory now."""

    depth, lock = 0, RLock()


@contextmanager
def reused_memory(size: int) -> Iterator[None]:
    """Inside, malloc keeps freed arrays of a model of `size` DOF for the next arrays; at the end the system gets all back.

    Otherwise each block of a large model comes from the system anew. The system clears its pages, which took a sixth of the time
    of 200 modes of 288,000 DOF. Small models gain nothing.
    """
    if size < LARGE:
        yield
        return
    with _Reuse.lock:
        _Reuse.depth += 1
        give_back_freed_memory()
    try:
        yield
    finally:
        with _Reuse.lock:
            _Reuse.depth -= 1
            give_back_freed_memory()
            if not _Reuse.depth:
                _trim()


def _trim() -> None:
    """Gives the pages of freed arrays back to the system."""
    if hasattr(libc(), "malloc_trim"):
        libc().malloc_trim(0)


def available() -> float | None:
    """Bytes that this process may still allocate, by the system's memory, its own limits and its groups'; None if unknown."""
    if _Reuse.depth:
        _trim()
    found = [] if (limit := left_of_limit()) is None else [limit]
    with suppress(OSError, KeyError, ValueError):
        lines = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines())
        found.append(1024.0 * int(lines["MemAvailable"].split()[0]))
    found += left_of_groups()
    return min(found, default=None)


def most_memory() -> float:
    """The most bytes that this process has had in memory at any time; 0 where that is unknown."""
    try:
        from resource import RUSAGE_SELF, getrusage
    except ImportError:
        return 0.0
    return 1024.0 * getrusage(RUSAGE_SELF).ru_maxrss


def left_of_groups(mounted: Path = Path("/sys/fs/cgroup"), own: Path = Path("/proc/self/cgroup")) -> list[float]:
    """Bytes left of the limits of the control groups that this process is in: of containers, of a user's session, of a job.

    Each group in the path counts, up to the root, in both versions of the interface. Pages of files that have not been used for
    long count as free: the kernel gives them back before the limit matters.
    """
    groups = [mounted, mounted / "memory"]
    with suppress(OSError, ValueError):
        for line in own.read_text(encoding="utf-8").splitlines():
            _, kinds, path = line.split(":", 2)
            if not kinds or "memory" in kinds.split(","):
                top = mounted if not kinds else mounted / "memory"
                inner = top / path.lstrip("/")
                groups += [inner, *(above for above in inner.parents if above.is_relative_to(top))]
    found = []
    for group in dict.fromkeys(groups):
        for limit, used, spare in (("memory.max", "memory.current", "inactive_file"),
                                   ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")):
            with suppress(OSError, ValueError):  # 'max' is no limit
                most = float((group / limit).read_text(encoding="ascii"))
                left = most - float((group / used).read_text(encoding="ascii"))
                found.append(left)
                stat = dict(one.split() for one in (group / "memory.stat").read_text(encoding="ascii").splitlines())
                found[-1] += min(float(stat.get(spare, 0.0)), max(most - left, 0.0))
    return found


def left_of_limit() -> float | None:
    """Bytes left of this process' own limit of address space or data (`ulimit -v`, `ulimit -d`); None without a limit."""
    try:
        from resource import RLIM_INFINITY, RLIMIT_AS, RLIMIT_DATA, getpagesize, getrlimit

        pages = [int(word) for word in Path("/proc/self/statm").read_text(encoding="ascii").split()]
    except (ImportError, OSError, ValueError):
        return None
    limits = ((getrlimit(RLIMIT_AS)[0], pages[0]), (getrlimit(RLIMIT_DATA)[0], pages[5]))
    return min((limit - used * getpagesize() for limit, used in limits if limit != RLIM_INFINITY), default=None)
