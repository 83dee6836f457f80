"""Files that belong together are replaced together: a process that is killed leaves the old ones or the new ones, whole.

New files are written into a hidden folder beside the old ones. It gets the name `NEXT` when all of them are complete. From then
on they are the folder's content, as `newest` reads it. Then each is moved to its place. The next writer ends a move that was
stopped, and removes the hidden folders of writers that were killed before.

A writer locks the folder (flock), and so does a run for as long as it takes. The system unlocks it when the process ends. Other
machines do not see the lock.
"""

from __future__ import annotations

import hashlib
import json
import secrets
import shutil
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from errno import EEXIST, EINVAL, ELOOP, EWOULDBLOCK
from functools import partial
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, TypeAlias

from femsub.algebra import identity, lock, opened
from femsub.checks import InputError, content_hash, hash_of, no_room_error, resolved, temporary

Writer: TypeAlias = Callable[[BinaryIO], object]  # writes one file's content into an open temporary file, and may read it
HASHES = "sha256"  # the key of {file: hash} in an index
NEXT = ".femsub-next"  # holds complete files that are being moved to their places
TEMPORARY = ".femsub-new-"  # beginning of the name of a folder in which files are being written
#: endings of what femsub writes
OURS = (".json", ".csv", ".png", ".vtu", ".vtk", ".pvd", ".html", ".npz", ".npy", ".mtx", ".mat", ".op4", ".msh", ".inp")
_held: ContextVar[frozenset[tuple[int, int]]] = ContextVar("femsub_held", default=frozenset())  # folders that this thread locked


def with_index(writers: Mapping[str, Writer], index: str, table: Mapping[str, Any]) -> dict[str, Writer]:
    """The writers, and last the writer of an index in JSON: a table, the hashes of the files, and the sum of its own content."""
    hashes: dict[str, str] = {}

    def write(file: BinaryIO, name: str) -> None:
        writers[name](file)
        hashes[name] = content_hash(file)

    def write_index(file: BinaryIO) -> None:
        whole = json.loads(json.dumps({**table, HASHES: hashes}, allow_nan=False))
        whole[HASHES][index] = content_sum(index, whole)
        file.write((json.dumps(whole, indent=1, ensure_ascii=False) + "\n").encode())

    return {**{name: partial(write, name=name) for name in writers}, index: write_index}


def content_sum(index: str, table: Mapping[str, Any]) -> str:
    """SHA-256 of the content of an index, whatever the layout of its JSON; its own entry among its hashes is left out."""
    rest = {**table, HASHES: {name: known for name, known in table[HASHES].items() if name != index}}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def newest(folder: Path, name: str) -> Path:
    """Where a file of the folder is: in its place, or among complete new files that were not moved to their places."""
    waiting = folder / NEXT
    return waiting / name if stat.S_ISREG(_mode(waiting / name)) and stat.S_ISDIR(_mode(waiting)) else folder / name


@contextmanager
def held(folder: Path, alone: bool = False) -> Iterator[None]:
    """Inside, the folder exists and is locked, and a move that a killed writer began is complete. An empty new folder is removed.

    For one file `alone` nothing is locked: its move is a single step.

    Raises
    ------
    OSError
        The folder cannot be made or opened. BlockingIOError: another process, or another thread, writes into it.
    """
    made = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    with opened(folder) as handle:
        before = _held.get()
        try:
            if not alone:
                name = identity(handle)
                if name not in before:
                    try:
                        lock(handle)
                    except BlockingIOError:
                        raise BlockingIOError(EWOULDBLOCK, "another process writes into it; wait for its end, or choose another "
                                              "folder") from None
                _held.set(before | {name})
                _finish(folder)
            # remove the hidden folders of writers that were killed
            for path in folder.glob(f"{TEMPORARY}*"):
                with suppress(OSError), opened(path, linked=False) as left:
                    if lock(left):
                        shutil.rmtree(path)
            yield
        finally:
            _held.set(before)
            for parent in made:  # those that are empty; inner ones come first
                with suppress(OSError):
                    parent.rmdir()


def write_whole(folder: Path, writers: Mapping[str, Writer]) -> list[Path]:
    """Write files: names relative to `folder`, which is created. In each folder all are replaced, or none.

    Raises
    ------
    OSError
        The folder cannot be written, or another process writes into it; existing files are unchanged.
    """
    places = {name: folder / name for name in writers}
    for name, path in places.items():  # a path that is not below the folder, or that a link leads to, is refused
        words = PurePath(name).parts
        if PurePath(name).is_absolute() or ".." in words:
            raise OSError(EINVAL, f"{name!r} is not a file within it")
        for part in path.parents[:len(words) - 1]:
            if part.is_symlink():
                raise OSError(ELOOP, f"{part} is a link to another folder, and nothing is written outside of this one")
    alone = len(writers) == 1
    with ExitStack() as stack:
        if not alone:
            stack.enter_context(held(folder))
        waiting: dict[Path, Path] = {}
        for place in dict.fromkeys(path.parent for path in places.values()):  # outer folders are locked before inner ones
            stack.enter_context(held(place, alone))
            waiting[place] = stack.enter_context(_temporary(place))
        for name, writer in writers.items():  # in their order: an index lists the files before it
            path = places[name]
            if path.is_dir():
                raise OSError(EEXIST, f"{path} is a folder")
            with (waiting[path.parent] / path.name).open("x+b") as file:
                writer(file)
        for place, new in waiting.items():
            if alone:
                _move(new, place)
            else:
                new.replace(place / NEXT)
        for place in waiting:
            _finish(place, own=True)
    return list(places.values())


def write_or_refuse(what: str, folder: Path, writers: Mapping[str, Writer]) -> list[Path]:
    """`write_whole`, whose OSError becomes an InputError: `what`, such as 'the folder out', cannot be written."""
    try:
        return write_whole(folder, writers)
    except OSError as error:
        raise InputError(f"{what} cannot be written: {error.strerror or error}") from None


def remove(folder: Path, hashes: Mapping[Any, Any]) -> None:
    """Deletes files of the last run, {name: hash}, and the folders that are empty then.

    Only files that the last run wrote are deleted: regular files below the folder, with an ending of femsub's files and with the
    content of the hash. No link is followed.
    """
    whole = resolved(folder)
    for name, known in hashes.items():
        with suppress(OSError, ValueError):  # ValueError: no valid name. A file that may not be read or deleted stays
            path = whole / name
            below = resolved(path) == path and whole in path.parents
            if below and path.suffix in OURS and path.is_file() and hash_of(path) == known:
                path.unlink()
                for parent in path.relative_to(whole).parents[:-1]:
                    (whole / parent).rmdir()


@contextmanager
def scratch(need: float) -> Iterator[Path]:
    """A temporary folder, for programs that write to a name only; it and its files are gone afterwards.

    Raises
    ------
    NotEnoughMemoryError
        A file cannot be written inside; the message says that some `need` bytes must be free.
    """
    place = temporary()
    try:
        with TemporaryDirectory(dir=place) as folder:
            yield Path(folder)
    except OSError as error:
        raise no_room_error(place, "temporary files", need, error.strerror or error) from None


@contextmanager
def _temporary(place: Path) -> Iterator[Path]:
    """A hidden folder, locked as long as its writer lives, and removed if it is still there at the end."""
    with ExitStack() as stack:
        while True:
            path = place / f"{TEMPORARY}{secrets.token_hex(8)}"
            path.mkdir()
            with ExitStack() as one, suppress(FileNotFoundError, BlockingIOError):  # another process removes it as left over
                lock(one.enter_context(opened(path)))
                if path.exists():
                    stack.enter_context(one.pop_all())
                    break
        stack.callback(shutil.rmtree, path, ignore_errors=True)
        yield path


def _finish(folder: Path, own: bool = False) -> None:
    """Move complete new files to their places; `own`: this process has written them.

    Raises
    ------
    OSError
        The folder holds files that a killed writer does not leave.
    """
    waiting = folder / NEXT
    mode = _mode(waiting)
    if not mode:
        return
    found = [*waiting.iterdir()] if stat.S_ISDIR(mode) else [waiting]
    strange = [] if own else [path for path in found if not stat.S_ISREG(_mode(path)) or path == waiting or (
        path.suffix not in OURS and (folder / path.name).exists())]
    if strange:
        raise OSError(EEXIST, f"{strange[0]} was not written by femsub; delete it")
    _move(waiting, folder)
    waiting.rmdir()


def _move(waiting: Path, folder: Path) -> None:
    """Move files to their places, an index last."""
    for path in sorted(waiting.iterdir(), key=lambda path: (path.suffix == ".json", path.name)):
        path.replace(folder / path.name)


def _mode(path: Path) -> int:
    """The mode of a path, links not followed; 0 if there is nothing."""
    try:
        return path.lstat().st_mode
    except OSError:
        return 0
