"""What is made of a model's matrices once and found again by every call on the model: factors above all.

It is kept beside the matrices, which a model never changes, and goes when they do: no model holds a factor, and none is
copied or written with it. What was used longest ago gives way where memory is short. A factor that is in use lives on
until its users have let go of it: nobody closes what is shared.
"""

from __future__ import annotations

import os
import weakref
from collections import OrderedDict
from collections.abc import Callable, Hashable
from contextlib import suppress
from functools import partial
from threading import RLock
from typing import Any, TypeVar

from femsub.checks import Matrix
from femsub.errors import InputError
from femsub.linalg.process_memory import available

T = TypeVar("T")
Key = tuple[tuple[int, ...], Hashable]
VARIABLE = "FEMSUB_FACTOR_BYTES"  # of the environment: how much is kept at the most
SHARE = 0.25  # of the memory at hand, where the variable says nothing,
FREELY = 1e8  # and bytes up to which nobody asks how much that is
FACTOR_BYTES = 8 * 1.6  # for each nonzero of a factor


class Kept(dict[Key, Any]):
    """What is kept; of what takes memory the bytes, used longest ago first, and their sum."""

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


_lock = RLock()  # taken twice by one thread where the garbage collector runs in between
if hasattr(os, "register_at_fork"):  # a child would wait for ever for a thread that it does not have
    os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_lock.release)
_kept = Kept()
_owners: dict[int, tuple[weakref.ref[Any], set[Key]]] = {}


def shared(owners: tuple[Matrix, ...], what: Hashable, make: Callable[[], T], size: Callable[[T], float] = lambda _: 0.0) -> T:
    """What `make` made of these very matrices before, or makes now; `size` tells its bytes.

    It must hold none of the owners, or they would never go.
    """
    key = tuple(map(id, owners)), what
    with _lock:
        # A number that was given to another matrix must never pass for this one, whatever has become of the callback.
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
    """Bytes of all that is kept."""
    return _kept.total


def _limit() -> float | None:
    if not (told := os.environ.get(VARIABLE)):
        return None
    with suppress(ValueError):
        if (limit := float(told)) >= 0:
            return limit
    raise InputError(f"the environment variable {VARIABLE} must be a number of bytes, such as 2e9, or 0 to keep no factor; it is "
                     f"{told!r}")


def _within(limit: float | None) -> bool:
    kept = kept_bytes()
    if limit is not None:
        return kept <= limit
    free = available() if kept > FREELY else None
    return free is None or kept <= SHARE * (free + kept)


def give_up_until(enough: Callable[[], bool]) -> None:
    """Gives up what was used longest ago, one by one, until there is enough room; what takes none stays."""
    with _lock:
        while not enough() and _kept.sizes:
            _kept.give_up_oldest()


def forget(owners: tuple[Matrix, ...], what: Hashable) -> None:
    """Gives up one thing."""
    with _lock:
        _kept.give_up((tuple(map(id, owners)), what))


def drop(*owners: Matrix) -> None:
    """Gives up what is kept of these matrices; without any, all."""
    with _lock:
        for at in list(map(id, owners) if owners else _owners):
            _gone(at)


def _gone(at: int, _: object = None) -> None:
    with _lock:
        if at in _owners:
            for key in _owners.pop(at)[1]:
                _kept.give_up(key)
                for other in key[0]:  # which may live on
                    if other in _owners:
                        _owners[other][1].discard(key)
