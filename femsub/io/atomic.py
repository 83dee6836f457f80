"""Atomic writing: a file is written completely or not at all."""

from __future__ import annotations

import hashlib
import os
import secrets
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import BinaryIO, TypeAlias

Writer: TypeAlias = Callable[[BinaryIO], object]  # writes one file's content into an open temporary file, and may read it


def content_hash(file: BinaryIO) -> str:
    """SHA-256 of the whole content of an open file."""
    file.seek(0)
    return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]


def write_whole(folder: Path, writers: Mapping[str, Writer]) -> list[Path]:
    """Write files (names relative to `folder`, which is created) to temporary names, and rename them when all are on the disk.

    Raises
    ------
    OSError
        The folder cannot be written; existing files are unchanged.
    """
    made = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    waiting: list[tuple[Path, Path]] = []
    try:
        for name, writer in writers.items():
            path = folder / name
            made = [parent for parent in path.parents if not parent.exists() and parent not in made] + made
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
            with temporary.open("x+b") as file:
                waiting.append((temporary, path))
                writer(file)
        folder.mkdir(parents=True, exist_ok=True)
        for temporary, path in list(waiting):
            os.replace(temporary, path)
            waiting.remove((temporary, path))
    except BaseException:
        for temporary, _ in waiting:
            temporary.unlink()
        for parent in sorted(made, key=lambda path: len(path.parts), reverse=True):
            if parent.is_dir() and not any(parent.iterdir()):
                parent.rmdir()
        raise
    return [folder / name for name in writers]
