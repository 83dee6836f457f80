"""Results that a run that was stopped goes on with: each ends with its hash, and one that was damaged meanwhile is made anew."""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

SEAL = "sha256"


def sealed(record: dict[str, Any]) -> str:
    """A line of JSON with the hash of all else in it."""
    return json.dumps(record | {SEAL: hashlib.sha256(json.dumps(record).encode()).hexdigest()})


def opened(line: str | bytes, path: Path) -> dict[str, Any] | None:
    """The record of such a line; None if it was cut or changed, which is printed."""
    try:
        record: dict[str, Any] = json.loads(line)
        known = record.pop(SEAL, None)
    except (ValueError, AttributeError):
        record, known = {}, None
    if known == hashlib.sha256(json.dumps(record).encode()).hexdigest():
        return record
    print(f"{path}: a line is damaged, or was written without its hash, and is made anew: {line[:80]!r}", file=sys.stderr)
    return None


def sealed_bytes(content: bytes) -> bytes:
    return content + hashlib.sha256(content).digest()


def opened_bytes(path: Path) -> bytes | None:
    """The content of a file of `sealed_bytes`; None if there is none, or if it was damaged, which is printed."""
    if not path.exists():
        return None
    content = path.read_bytes()
    body = content[:-hashlib.sha256().digest_size]
    if sealed_bytes(body) == content:
        return body
    print(f"{path} is damaged, or was written without its hash, and is made anew", file=sys.stderr)
    return None
