"""Folders for the files of one run, which are gone after it; what a killed run left there goes with the next one."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from femsub.errors import InputError, no_room_error

MEMORY = Path("/dev/shm")  # a folder in memory; on a disk, files would be written to it as well
ROOM = 10  # times what is sent must be free there, since results come back as well
ALIVE = "alive"  # a file that is locked as long as a run lives


@contextmanager
def task_folder(place: Path) -> Iterator[str]:
    """A folder for the files of one run, in memory or in the temporary folder.

    Nobody tidies up if all processes are killed at once. So the run locks a file there as long as it lives, and removes the
    user's own folders whose file is not locked any more.
    """
    from fcntl import LOCK_EX, LOCK_NB, flock

    for left in place.glob(f"femsub-*/{ALIVE}"):
        with suppress(OSError):
            if left.parent.is_symlink() or left.is_symlink() or left.parent.stat().st_uid != os.getuid():
                continue
            with left.open("ab") as other:
                flock(other, LOCK_EX | LOCK_NB)
                shutil.rmtree(left.parent)
    with ExitStack() as stack:
        try:
            folder = stack.enter_context(TemporaryDirectory(prefix="femsub-", dir=place, ignore_cleanup_errors=True))
            file = stack.enter_context(Path(folder, "new").open("wb"))
        except OSError as error:
            raise no_room_error(place, "the files of one call", 0.0, error.strerror or error) from None
        with suppress(OSError):  # a file system without locks: nobody else can lock it either
            flock(file, LOCK_EX)
            os.rename(file.name, Path(folder, ALIVE))
        yield folder


@contextmanager
def only_one(folder: Path) -> Iterator[None]:
    """Hold a folder, in which one run at a time may write; an InputError if another one does, or if none may."""
    from fcntl import LOCK_EX, LOCK_NB, flock

    with ExitStack() as stack:
        try:
            file = stack.enter_context((folder / ALIVE).open("ab"))
        except OSError as error:
            raise InputError(f"the folder {folder} cannot be written: {error.strerror or error}") from None
        try:
            flock(file, LOCK_EX | LOCK_NB)
        except BlockingIOError:
            raise InputError(f"another run works in {folder}. Wait until it has ended, or name another folder") from None
        except OSError:  # a file system without locks
            pass
        yield


def has_room(sent: int) -> bool:
    """Whether the folder in memory will do; a TMPDIR overrules it."""
    return not os.environ.get("TMPDIR") and MEMORY.is_dir() and os.access(MEMORY, os.W_OK | os.X_OK) and \
        shutil.disk_usage(MEMORY).free > ROOM * sent


def in_memory(place: Path) -> bool:
    """Whether a folder is in memory itself (tmpfs), by what the system tells of its mounts."""
    with suppress(OSError):
        mounts = [line.split() for line in Path("/proc/mounts").read_text(encoding="utf-8").splitlines()]
        above = [(len(where), number, kind) for number, (_, where, kind, *_) in enumerate(mounts)
                 if place.resolve().is_relative_to(where)]
        return max(above, default=(0, 0, ""))[2] in ("tmpfs", "ramfs")  # of two on one folder the last one is seen
    return False
