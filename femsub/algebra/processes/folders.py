"""Folders for the files of one run, which are removed at its end; the next run removes the folders of killed runs."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from femsub.checks import InputError, no_room_error

MEMORY = Path("/dev/shm")  # a folder in memory, whose files no disk has to store
ALIVE = "alive"  # a file that is locked as long as a run lives


@contextmanager
def task_folder(place: Path) -> Iterator[str]:
    """A folder for the files of one run, in memory or in the temporary folder.

    If all processes of a run are killed at once, its folder stays. So a run locks a file in its folder as long as it lives. At
    its start it removes the user's own folders whose file is no longer locked.
    """
    for left in place.glob(f"femsub-*/{ALIVE}"):
        with suppress(OSError):
            if left.parent.is_symlink() or left.is_symlink() or left.parent.stat().st_uid != os.getuid():
                continue
            with left.open("ab") as other:
                if lock(other.fileno()):
                    shutil.rmtree(left.parent)
    with ExitStack() as stack:
        try:
            folder = stack.enter_context(TemporaryDirectory(prefix="femsub-", dir=place, ignore_cleanup_errors=True))
            file = stack.enter_context(Path(folder, "new").open("wb"))
        except OSError as error:
            raise no_room_error(place, "the files of one call", 0.0, error.strerror or error) from None
        with suppress(OSError):  # a file system without locks: nobody else can lock it either
            fcntl.flock(file, fcntl.LOCK_EX)
            os.rename(file.name, Path(folder, ALIVE))
        yield folder


@contextmanager
def only_one(folder: Path) -> Iterator[None]:
    """Hold a folder in which one run at a time may write; an InputError if another run does, or if it cannot be written."""
    with ExitStack() as stack:
        try:
            file = stack.enter_context((folder / ALIVE).open("ab"))
        except OSError as error:
            raise InputError(f"the folder {folder} cannot be written: {error.strerror or error}") from None
        try:
            lock(file.fileno())
        except BlockingIOError:
            raise InputError(f"another run works in {folder}. Wait until it has ended, or name another folder") from None
        yield


@contextmanager
def opened(folder: Path, linked: bool = True) -> Iterator[int]:
    """The file descriptor of an open folder, by which it can be locked; `linked`: the folder may be a link to another.

    Raises
    ------
    OSError
        There is no such folder.
    """
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | (0 if linked else os.O_NOFOLLOW))
    try:
        yield handle
    finally:
        os.close(handle)


def identity(handle: int) -> tuple[int, int]:
    """Device and inode of an open folder, which do not depend on the name by which it was opened."""
    found = os.fstat(handle)
    return found.st_dev, found.st_ino


def lock(handle: int) -> bool:
    """Lock an open file or folder until it is closed, at the latest when this process ends. False: its disk has no locks.

    Other machines do not see the lock.

    Raises
    ------
    BlockingIOError
        Another process, or another opening of it, has locked it.
    """
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:
        return False
    return True


def has_room(sent: int) -> bool:
    """Whether the folder in memory has ten times `sent` bytes free, for tasks and their results; never if TMPDIR is set."""
    return not os.environ.get("TMPDIR") and is_writable(MEMORY) and shutil.disk_usage(MEMORY).free > 10 * sent


def is_writable(place: Path) -> bool:
    """Whether files can be made in a folder."""
    return place.is_dir() and os.access(place, os.W_OK | os.X_OK)


def in_memory(place: Path) -> bool:
    """Whether a folder is in memory itself (tmpfs), by the system's list of mounts."""
    with suppress(OSError):
        mounts = [line.split() for line in Path("/proc/mounts").read_text(encoding="utf-8").splitlines()]
        above = [(len(where), number, kind) for number, (_, where, kind, *_) in enumerate(mounts)
                 if place.resolve().is_relative_to(where)]
        return max(above, default=(0, 0, ""))[2] in ("tmpfs", "ramfs")  # of two mounts on one folder the last hides the first
    return False
