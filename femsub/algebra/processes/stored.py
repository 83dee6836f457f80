"""Objects in folders: a pickle, and each array in a file of its own, which a process maps into its memory.

Files that a later call relies on are first checked by hashes. The pickle ends with its own hash. `files_of` lists size and hash
of each file in a folder. The caller keeps that table elsewhere, and `load` compares the files with it before it reads.
"""

from __future__ import annotations

import hashlib
import itertools
import pickle
import shutil
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO, TypeAlias

import numpy as np

from femsub.checks import Array, InputError, hash_of, no_room_error, parsing, unlike

PICKLE = "pickle"  # a file with all but the arrays, which ends with the SHA-256 of its content
Files: TypeAlias = Mapping[str, tuple[int, str]]  # size and hash by name


class DamagedFileError(InputError):
    """A file is not what was written in its place."""


def bytes_of(thing: Any, name: str) -> int:
    """The bytes of an object's arrays; an InputError if pickle refuses the object."""
    arrays: list[pickle.PickleBuffer] = []
    try:
        pickle.dumps(thing, protocol=5, buffer_callback=arrays.append)
    except Exception as error:
        raise InputError(f"the {name} cannot be sent to a worker, since pickle refuses it: {error}. Define classes (such as a "
                         "method of your own) at the top level of a module") from None
    return sum(array.raw().nbytes for array in arrays)


class _Stored(pickle.Pickler):
    """Writes a pickle, and each array to a file of its own beside it. The pickle names no folder, so that it may be moved."""

    def __init__(self, folder: Path, file: BinaryIO) -> None:
        super().__init__(file, protocol=5)
        self.folder, self.names = folder, (f"{number}.npy" for number in itertools.count())
        self.known: dict[int, tuple[Array, str]] = {}

    def persistent_id(self, value: Any) -> str | None:
        if type(value) is not np.ndarray or value.dtype.hasobject or not value.nbytes:
            return None
        if id(value) not in self.known:
            self.known[id(value)] = value, next(self.names)  # it keeps the array, so that no new one gets its id
            np.save(self.folder / self.known[id(value)][1], value)
        return self.known[id(value)][1]


class _Loaded(pickle.Unpickler):
    def __init__(self, folder: Path, file: BinaryIO) -> None:
        super().__init__(file)
        self.folder = folder
        self.known: dict[str, Array] = {}

    def persistent_load(self, name: str) -> Array:
        if name not in self.known:  # two references to one array stay so
            self.known[name] = mapped(self.folder / name)
        return self.known[name]


def store(folder: Path, thing: Any, what: str = "what workers share",
          remedy: str = "Set TMPDIR to a folder with more room") -> Path:
    """Write an object to a new folder that `load` reads.

    Raises
    ------
    NotEnoughMemoryError
        The folder has no room for it, and does not exist then; the message ends with the remedy.
    """
    try:
        folder.mkdir()
        try:
            content = BytesIO()
            _Stored(folder, content).dump(thing)
            (folder / PICKLE).write_bytes(content.getvalue() + hashlib.sha256(content.getvalue()).digest())
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
    except OSError as error:
        raise no_room_error(folder.parent, what, bytes_of(thing, what), error.strerror or error, remedy) from None
    return folder


def files_of(folder: Path) -> Files:
    """Size and hash of each file in a folder, by name, as `load` compares them."""
    return {path.name: (path.stat().st_size, hash_of(path)) for path in sorted(folder.iterdir()) if path.is_file()}


def load(folder: Path, files: Files = MappingProxyType({})) -> Any:
    """The object of a folder by `store`, with its arrays `mapped`.

    Raises
    ------
    DamagedFileError
        The pickle is damaged, or one of the `files` is not as it was.
    FileNotFoundError
        There is no such folder.
    """
    for name, (size, known) in files.items():
        if why := unlike(folder / name, known, size, raising=True):
            raise DamagedFileError(f"{folder / name} is damaged, or was changed: {why}")
    content = (folder / PICKLE).read_bytes()
    body = memoryview(content)[:-hashlib.sha256().digest_size]
    if hashlib.sha256(body).digest() != content[len(body):]:
        raise DamagedFileError(f"{folder / PICKLE} is damaged, or was changed or written by another version of femsub")
    return _Loaded(folder, BytesIO(body)).load()


def mapped(path: Path) -> Array:
    """The array of a file, mapped into memory: a page that is written to becomes a copy, and the file stays as it is."""
    with parsing():
        return np.load(path, "c").view(np.ndarray)
