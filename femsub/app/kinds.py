"""Kinds of tables in a scene file. Each kind is a class with keys, in its own Python file.

A family is a folder of kinds: parts, joints, contacts, asks. The kind of a table is the one whose name is a key of the table,
such as `critical = "mu"`; this key is the first field of the class. Further kinds come from Python files that a scene names in
`use`, and from packages with an entry point of the group `femsub.kinds`.
"""

from __future__ import annotations

import pkgutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

from femsub.checks import FemsubError, InputError, resolved, unknown_name
from femsub.io import key as key

FAMILIES = ("part", "joint", "contact", "ask")


class Kind:
    """A table of a scene file. `KIND` is the key that names its kind; `FAMILY` is the kind's family, such as 'ask'."""

    KIND: ClassVar[str] = ""
    FAMILY: ClassVar[str] = ""


@cache
def _packaged() -> dict[str, dict[str, str]]:
    """Family → name of a kind → name of its module. Only the packages of the families are imported, not these modules."""
    found: dict[str, dict[str, str]] = {}
    for family in FAMILIES:
        package = import_module(f"femsub.app.{family}s")
        found[family] = {one.name.replace("_", "-"): f"{package.__name__}.{one.name}" for one
                         in pkgutil.iter_modules(package.__path__)}
    return found


@cache
def _installed() -> tuple[ModuleType, ...]:
    """The modules with kinds of installed packages. Kept, since a search of all packages takes as long as a small scene."""
    return tuple(one.load() for one in entry_points(group="femsub.kinds"))


def defined_in(module: ModuleType) -> Iterator[type[Kind]]:
    """The kinds that a module defines itself."""
    for one in vars(module).values():
        if isinstance(one, type) and issubclass(one, Kind) and one.KIND and one.__module__ == module.__name__:
            yield one


class Kinds:
    """The kinds that one scene knows: femsub's own, those of installed packages, and those of `modules`."""

    def __init__(self, modules: Sequence[ModuleType] = ()) -> None:
        self.own: dict[tuple[str, str], type[Kind]] = {}
        for module in (*modules, *_installed()):
            for kind in defined_in(module):
                self.own[kind.FAMILY, kind.KIND] = kind

    def names(self, family: str) -> list[str]:
        """The names of all kinds of a family."""
        return sorted({*_packaged()[family], *(name for own, name in self.own if own == family)})

    def kind(self, family: str, name: str) -> type[Any]:
        """The class of the kind with this name."""
        if (found := self.own.get((family, name))) is not None:
            return found
        return next(one for one in defined_in(import_module(_packaged()[family][name])) if name == one.KIND)

    def of(self, family: str, table: Mapping[str, Any]) -> type[Any]:
        """The class of the kind that a table names.

        Raises
        ------
        InputError
            The table names no kind, or more than one.
        """
        names = self.names(family)
        known = [name for name in table if name in names]
        if len(known) == 1:
            return self.kind(family, known[0])
        if known:
            raise InputError(f"it is of the kinds {' and '.join(known)}: a table has one of them")
        if not table:
            raise InputError(f"it is empty. Name its kind: {', '.join(names)}")
        raise unknown_name(f"kind of {family}: none of its keys names one, as", next(iter(table)), names)


def is_beside(path: Path, folder: Path, trusted: Sequence[str]) -> bool:
    """Whether a Python file lies directly in the folder, or is one of `trusted`, which the user has allowed."""
    with suppress(ValueError):
        whole = resolved(path)
        return whole.parent == resolved(folder) or whole in map(resolved, trusted)
    return False


def kinds_file(path: Path) -> ModuleType:
    """Runs a Python file with kinds, and returns its module.

    Raises
    ------
    InputError
        There is no such file, or it fails.
    """
    if not path.is_file():
        raise InputError(f"there is no file {path}")
    spec = spec_from_file_location(f"femsub_kinds_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = sys.modules[spec.name] = module_from_spec(spec)  # dataclasses look for their module there
    try:
        spec.loader.exec_module(module)
    except FemsubError:
        raise
    except Exception as error:
        raise InputError(f"{path} cannot be read: {type(error).__name__}: {error}") from error
    return module
