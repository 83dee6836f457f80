"""A cache for results that belong to a model's matrices, above all their factors.

A cached object lives as long as the matrices, which never change. It is not stored in the model, so copies and pickles do not
contain it. If memory is short, the least recently used objects are dropped. A factor in use stays alive until its users
release it; nobody closes a shared factor.
"""

from __future__ import annotations

import atexit
import weakref
from collections.abc import Callable, Hashable
from contextlib import suppress
from functools import partial
from threading import RLock
from typing import Any, TypeVar

from femsub.algebra.processes.memory import available
from femsub.algebra.processes.system import held_during_forks, variable
from femsub.checks import InputError, Matrix

T = TypeVar("T")
Key = tuple[tuple[int, ...], Hashable]
VARIABLE = "FEMSUB_FACTOR_BYTES"  # environment variable: upper limit of the cache in bytes

_lock = held_during_forks(RLock())  # reentrant: the garbage collector may run inside and take it again
_kept: dict[Key, tuple[Any, int]] = {}  # cached objects and their bytes; what was used last comes last
_owners: dict[int, weakref.ref[Any]] = {}
_keys: dict[int, set[Key]] = {}  # the keys of an owner's objects that are or were cached
_unseen = 0  # bytes cached since the available memory was last read


def shared(owners: tuple[Matrix, ...], what: Hashable, make: Callable[[], T], size: Callable[[T], float] = lambda _: 0.0) -> T:
    """The cached object of these matrices, made by `make` at the first call; `size` returns its bytes.

    The object must not refer to the owners, or they would never be freed.
    """
    key = tuple(map(id, owners)), what
    with _lock:
        # an id may be reused by another matrix: compare the weak references as well
        if key in _kept and all(_owners[id(owner)]() is owner for owner in owners):
            found: T = _kept.setdefault(key, _kept.pop(key))[0]
            return found
    limit = None
    if given := variable(VARIABLE):
        with suppress(ValueError):
            limit = float(given)
        if limit is None or not limit >= 0:
            raise InputError(f"the environment variable {VARIABLE} must be a number of bytes, such as 2e9, or 0 to keep no "
                             f"factor, but is {given!r}")

    def within() -> bool:
        # a model and its results need three times as much as its factors
        return are_free(3 * kept_bytes()) if limit is None else kept_bytes() <= limit

    global _unseen
    made = make()
    need = int(size(made))
    with _lock:
        _kept[key] = made, need
        for owner in owners:
            if id(owner) not in _owners or _owners[id(owner)]() is not owner:
                _owners[id(owner)] = weakref.ref(owner, partial(_gone, id(owner)))
            _keys.setdefault(id(owner), set()).add(key)
        _unseen += need
        # to read the available memory takes longer than to make a small object: once for each percent of cached bytes will do
        if need and (limit is not None or _unseen >= 0.01 * kept_bytes()):
            _unseen = 0
            give_up_until(within)
    return made


def kept_bytes() -> int:
    """Bytes of all cached objects."""
    return sum(size for _, size in list(_kept.values()))  # the garbage collector may drop some meanwhile


def at_hand(need: float) -> float | None:
    """Bytes available, after cached objects have been dropped as far as `need` requires; None if unknown."""
    free = available()
    if free is None or free >= need:
        return free
    give_up_until(lambda: (free := available()) is None or free >= need)
    return available()


def are_free(need: float) -> bool:
    """Whether `need` bytes are available; True if that is unknown."""
    # to read the available memory takes 0.1 ms, as long as work on a model of a megabyte
    return need < 1e6 or (free := available()) is None or free >= need


def give_up_until(enough: Callable[[], bool]) -> None:
    """Drop cached objects, least recently used first, until there is enough room; objects without size stay."""
    with _lock:
        for key in list(_kept):  # a copy: the garbage collector may drop a matrix at any step, and its entries with it
            if not _kept.get(key, (None, 0))[1]:
                continue
            if enough():
                return
            _kept.pop(key, None)


def forget(owners: tuple[Matrix, ...], what: Hashable) -> None:
    """Drop one object."""
    with _lock:
        _kept.pop((tuple(map(id, owners)), what), None)


def drop(*owners: Matrix) -> None:
    """Drop the cached objects of these matrices; without arguments, all."""
    for at in list(map(id, owners) if owners else _owners):
        _gone(at)


def _gone(at: int, _: object = None) -> None:
    with _lock:
        _owners.pop(at, None)
        for key in _keys.pop(at, ()):
            _kept.pop(key, None)
            for other in key[0]:  # matrices that live on must not collect keys of dropped objects
                _keys.get(other, set()).discard(key)


atexit.register(drop)  # a matrix that outlives this module would call _gone without its globals
