"""Environment variables, processors, functions of C libraries, and locks that survive a fork."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import Any

from femsub.checks import Parser

ONE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # environment of a worker
LAUNCHER = ("OMPI_", "PMIX_", "PMI_")  # variables of mpiexec, by which MPI would take a worker for the process that started it


def variable(name: str) -> str:
    """The value of an environment variable; '' where it is not set."""
    return os.environ.get(name, "")


def set_unless_given(values: Mapping[str, str]) -> None:
    """Set environment variables that the user has not set."""
    for name, value in values.items():
        os.environ.setdefault(name, value)


@contextmanager
def environment_of_workers() -> Iterator[None]:
    """Inside, the environment is the one in which other processes of femsub start."""
    before = dict(os.environ)
    for name in [name for name in before if name.startswith(LAUNCHER)]:
        del os.environ[name]
    os.environ.update(ONE)
    try:
        yield
    finally:
        for name in ONE:
            del os.environ[name]
        os.environ.update(before)


def processors() -> int:
    """How many processors the machine has."""
    return os.cpu_count() or 1


def own_processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else processors()


def functions_of(library: str, pointers: Mapping[str, int]) -> list[Callable[..., int]] | None:
    """C functions of a shared library or of libraries linked to it, by {name: number of arguments}; None if one is hidden.

    All arguments are addresses, and the result is an int.
    """
    try:
        found = [getattr(ctypes.CDLL(library), name) for name in pointers]
    except (AttributeError, OSError):
        return None
    for function, count in zip(found, pointers.values(), strict=True):
        function.argtypes = [ctypes.c_void_p] * count
    return found


@cache
def libc() -> Any:
    """The C library of this process."""
    return ctypes.CDLL(None)


def held_during_forks(lock: Any) -> Any:
    """The same lock, held by this thread during a fork. If another thread held it, the fork would wait for it for ever."""
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(before=lock.acquire, after_in_parent=lock.release, after_in_child=lock.release)
    return lock


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=Parser.renew)
