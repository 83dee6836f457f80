"""An audit hook that tells every file which is opened for writing, made, moved or deleted outside of some folders.

    sandbox.py DIR ARGUMENT...

runs `femsub` so in a process of its own, twice with the same arguments. Allowed are DIR, the temporary folder, /dev/shm,
/dev/null, /proc/self, and where matplotlib keeps its list of fonts. The exit status is that of femsub; each finding is a line of
stdout that begins with `outside: `. Processes that it starts are not seen: they are named, as `started: `. In a test, HOOK does
the same.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
#: audit events and which of their arguments are changed
CHANGES = {"os.remove": (0,), "os.rename": (0, 1), "os.mkdir": (0,), "os.rmdir": (0,), "os.link": (1,), "os.symlink": (1,),
           "os.truncate": (0,), "os.chmod": (0,), "os.chown": (0,), "os.utime": (0,), "shutil.rmtree": (0,),
           "shutil.move": (0, 1), "shutil.copyfile": (1,)}
STARTS = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn")


class Hook:
    """The one hook of a process, which Python keeps until its end: it is silent while it has no file to tell in."""

    def __init__(self) -> None:
        self.said: int | None = None
        self.allowed: list[str] = []
        self.added = False

    def start(self, folder: str, said: int) -> None:
        """From now on, tell in this open file what is changed outside of the folder; a forked process tells it there as well."""
        self.allowed = [os.path.realpath(folder), os.path.realpath(tempfile.gettempdir()), "/dev/shm", "/dev/null", "/proc/self",
                        f"/proc/{os.getpid()}",
                        *(os.path.expanduser(f"~/{place}/matplotlib") for place in (".config", ".cache"))]
        self.said = said
        if not self.added:
            sys.addaudithook(self)
            self.added = True

    def outside(self, path: Any) -> bool:
        if isinstance(path, int):  # a file that is open already
            return False
        whole = os.path.realpath(os.fsdecode(path))
        return not any(whole == place or whole.startswith(f"{place}/") for place in self.allowed)

    def __call__(self, event: str, words: tuple[Any, ...]) -> None:
        if self.said is None:
            return
        if event == "open" and isinstance(words[2], int):
            paths = [words[0]] if words[2] & WRITING else []
        elif event in STARTS:
            os.write(self.said, f"started: {words[1] if event == 'subprocess.Popen' else words[0]!r}\n".encode())
            return
        else:
            paths = [words[at] for at in CHANGES.get(event, ())]
        if event in ("os.remove", "os.rmdir") and len(words) > 1 and words[1] != -1:  # relative to an open folder
            return
        for path in paths:
            if self.outside(path):
                os.write(self.said, f"outside: {event} {os.fsdecode(path)}\n".encode())


HOOK = Hook()


if __name__ == "__main__":
    sys.dont_write_bytecode = True
    from femsub.app.cli import main

    Path(sys.argv[1]).parent.mkdir(parents=True, exist_ok=True)
    HOOK.start(sys.argv[1], os.dup(1))
    sys.exit(main(sys.argv[2:]) or main(sys.argv[2:]))
