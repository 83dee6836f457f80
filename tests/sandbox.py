"""Runs `femsub` under an audit hook, and prints every file that it opens for writing, makes, moves or deletes elsewhere.

    sandbox.py DIR ARGUMENT...

Allowed are DIR, the temporary folder, /dev/shm, /dev/null, /proc/self, and where matplotlib keeps its list of fonts. The exit
status is that of femsub; each finding is a line of stdout that begins with `outside: `. Processes that it starts are not seen:
they are named, as `started: `.
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


def watch(allowed: list[str]) -> None:
    """From now on, tell what is changed outside of these folders."""
    said = os.dup(1)

    def outside(path: Any) -> bool:
        if isinstance(path, int):  # a file that is open already
            return False
        whole = os.path.realpath(os.fsdecode(path))
        return not any(whole == place or whole.startswith(f"{place}/") for place in allowed)

    def hook(event: str, words: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(words[2], int):
            paths = [words[0]] if words[2] & WRITING else []
        elif event in ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn"):
            os.write(said, f"started: {words[1] if event == 'subprocess.Popen' else words[0]!r}\n".encode())
            return
        else:
            paths = [words[at] for at in CHANGES.get(event, ())]
        if event in ("os.remove", "os.rmdir") and len(words) > 1 and words[1] != -1:  # relative to an open folder
            return
        for path in paths:
            if outside(path):
                os.write(said, f"outside: {event} {os.fsdecode(path)}\n".encode())

    sys.addaudithook(hook)


if __name__ == "__main__":
    sys.dont_write_bytecode = True
    from femsub.app.cli import main

    folder = os.path.realpath(sys.argv[1])
    Path(folder).parent.mkdir(parents=True, exist_ok=True)
    watch([folder, os.path.realpath(tempfile.gettempdir()), "/dev/shm", "/dev/null", "/proc/self", f"/proc/{os.getpid()}",
           *(os.path.expanduser(f"~/{place}/matplotlib") for place in (".config", ".cache"))])
    sys.exit(main(sys.argv[2:]))
