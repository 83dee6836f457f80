"""The base class of models, meshes and maps: read-only, also after pickling and copying."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any, Self
from weakref import WeakValueDictionary

import numpy as np
import scipy.sparse as sp

_sealed: WeakValueDictionary[int, np.ndarray] = WeakValueDictionary()  # arrays of models' sparse matrices, by id


class Frozen:
    """Base of dataclasses whose arrays are read-only and whose mappings are views, also after pickle and `deepcopy`.

    Plain pickle loses the read-only flag and refuses the views. Only the fields are pickled; cached values are computed again.
    """

    def __post_init__(self) -> None:
        self._set(**{item.name: getattr(self, item.name) for item in fields(self)})  # type: ignore[arg-type]

    def _set(self, **values: Any) -> None:
        """Set fields of an object under construction, read-only."""
        for name, value in values.items():
            object.__setattr__(self, name, frozen(value))

    def _with(self, **changed: Any) -> Self:
        """A copy with changed fields, without new checks. A cached value that is known already can be given as well."""
        found = object.__new__(type(self))  # `copy` would go through the fields' arrays again, which takes 100 µs
        vars(found).update({item.name: getattr(self, item.name) for item in fields(self)})  # type: ignore[arg-type]
        found._set(**changed)
        return found

    def __getstate__(self) -> dict[str, Any]:
        values = {item.name: getattr(self, item.name) for item in fields(self)}  # type: ignore[arg-type]
        return {name: dict(value) if isinstance(value, Mapping) else value for name, value in values.items()}

    def __setstate__(self, values: dict[str, Any]) -> None:
        self._set(**values)


def frozen(value: Any) -> Any:
    """The value, read-only: an array or matrix (also in a tuple) is locked, a mapping becomes a view of a copy, others stay."""
    if isinstance(value, np.ndarray):
        value.flags.writeable = False
    elif sp.issparse(value):
        for array in _arrays(value):
            array.flags.writeable = False
            _sealed[id(array)] = array
    elif isinstance(value, tuple):
        return tuple(frozen(item) for item in value)
    elif isinstance(value, (dict, MappingProxyType)):
        return MappingProxyType({key: frozen(item) for key, item in value.items()})
    return value


def is_sealed(matrix: Any) -> bool:
    """Whether the arrays of a CSR matrix belong to a model, so that nobody can write to them.

    A read-only array of the caller is not enough: it may be a view of writable memory, or have writable views.
    """
    return all(_sealed.get(id(array)) is array and not array.flags.writeable for array in _arrays(matrix))


def _arrays(matrix: Any) -> list[np.ndarray]:
    return [matrix.data, matrix.indices, matrix.indptr]
