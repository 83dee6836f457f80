"""A cache for results that belong to a model's matrices, above all their factors.

A cached object lives as long as the matrices, which never change. It is not stored in the model, so copies and pickles do not
contain it. If memory is short, the least recently used objects are dropped. A factor in use stays alive until its users
release it; nobody closes a shared factor.
"""

from __future__ import annotations

import atexit
import os
import weakref
from collections import OrderedDict
from collections.abc import Callable, Hashable
from contextlib import suppress
from functools import partial
from threading import RLock
from typing import Any, TypeVar

from femsub.algebra.process_memory import available
from femsub.checks import Matrix
from femsub.errors import InputError

T = TypeVar("T")
Key = tuple[tuple[int, ...], Hashable]
VARIABLE = "FEMSUB_FACTOR_BYTES"  # environment variable: upper limit of the cache in bytes
SHARE = 0.25  # of the available memory: the limit if the variable is not set
FREELY = 1e8  # bytes that are cached without a look at the available memory
FACTOR_BYTES = 8 * 1.6  # bytes per nonzero of a factor


class Kept(dict[Key, Any]):
    """The cached objects; the bytes of the large ones, least recently used first; and their sum."""

    total = 0

    def __init__(self) -> None:
        self.sizes: OrderedDict[Key, int] = OrderedDict()

    def use(self, key: Key) -> Any:
        if key in self.sizes:
            self.sizes.move_to_end(key)
        return self[key]

    def keep(self, key: Key, made: Any, size: int) -> None:
        self.give_up(key)
        self[key] = made
        if size:
            self.sizes[key] = size
            self.total += size

    def give_up(self, key: Key) -> None:
        if key in self:
            self.total -= self.sizes.pop(key, 0)
            del self[key]

    def give_up_oldest(self) -> None:
        key, size = self.sizes.popitem(last=False)
        self.total -= size
        self.pop(key, None)


_lock = RLock()  # reentrant: the garbage collector may run inside and take it again
if hasattr(os, "register_at_fork"):  # a forked child would wait forever for a thread of its parent
    os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_lock.release)
_kept = Kept()
_owners: dict[int, tuple[weakref.ref[Any], set[Key]]] = {}


def shared(owners: tuple[Matrix, ...], what: Hashable, make: Callable[[], T], size: Callable[[T], float] = lambda _: 0.0) -> T:
    """The cached object of these matrices, made by `make` at the first call; `size` returns its bytes.

    It must not refer to the owners, or they would never be freed.
    """
    key = tuple(map(id, owners)), what
    with _lock:
        # an id may be reused by another matrix: compare the weak references as well
        if key in _kept and all(at in _owners and _owners[at][0]() is owner for at, owner in zip(key[0], owners, strict=True)):
            return _kept.use(key)
    limit = _limit()
    made = make()
    with _lock:
        _kept.keep(key, made, int(size(made)))
        for owner in owners:
            at = id(owner)
            if at not in _owners or _owners[at][0]() is not owner:
                _owners[at] = weakref.ref(owner, partial(_gone, at)), set()
            _owners[at][1].add(key)
        if size(made):
            give_up_until(partial(_within, limit))
    return made


def kept_bytes() -> int:
    """Bytes of all cached objects."""
    return _kept.total


def _limit() -> float | None:
    if not (told := os.environ.get(VARIABLE)):
        return None
    with suppress(ValueError):
        if (limit := float(told)) >= 0:
            return limit
    raise InputError(f"the environment variable {VARIABLE} must be a number of bytes, such as 2e9, or 0 to keep no factor, but "
                     f"is {told!r}")


def _within(limit: float | None) -> bool:
    kept = kept_bytes()
    if limit is not None:
        return kept <= limit
    free = available() if kept > FREELY else None
    return free is None or kept <= SHARE * (free + kept)


def give_up_until(enough: Callable[[], bool]) -> None:
    """Drop cached objects, least recently used first, until there is enough room; objects without size stay."""
    with _lock:
        while not enough() and _kept.sizes:
            _kept.give_up_oldest()


def forget(owners: tuple[Matrix, ...], what: Hashable) -> None:
    """Drop one object."""
    with _lock:
        _kept.give_up((tuple(map(id, owners)), what))


def drop(*owners: Matrix) -> None:
    """Drop the cached objects of these matrices; without arguments, all."""
    with _lock:
        for at in list(map(id, owners) if owners else _owners):
            _gone(at)


def _gone(at: int, _: object = None) -> None:
    with _lock:
        if at in _owners:
            for key in _owners.pop(at)[1]:
                _kept.give_up(key)
                for other in key[0]:  # other owners may live on
                    if other in _owners:
                        _owners[other][1].discard(key)


atexit.register(drop)  # a matrix that outlives this module would call _gone without its globals
