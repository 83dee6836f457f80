"""The machine that a run used, and the commit of its code."""

from __future__ import annotations

import platform
from contextlib import suppress
from pathlib import Path
from typing import Any

from femsub.algebra.processes.beside import completed
from femsub.algebra.processes.system import processors


def machine() -> dict[str, Any]:
    """The machine on which times were measured: processor, number of cores, system."""
    model = platform.processor() or platform.machine()
    with suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as file:
        model = next((line.split(":", 1)[1].strip() for line in file if line.startswith("model name")), model)
    return {"cpu": model, "cores": processors(), "system": platform.platform()}


def commit(folder: Path) -> str | None:
    """The commit of the clone that a folder is part of, with '-dirty' where files were changed; None outside of one."""
    def git(*words: str) -> str:
        done = completed(["git", "--no-optional-locks", "-C", str(folder), *words], 10.0)
        if done is None or done.returncode:
            raise OSError("git did not answer")
        return done.stdout.strip()

    try:
        git("ls-files", "--error-unmatch", "__init__.py")  # it may lie in a clone of something else
        return git("describe", "--always", "--dirty", "--abbrev=40", "--exclude", "*")
    except OSError:
        return None
