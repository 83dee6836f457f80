"""The results.json that a run has written, read back with every key that femsub reads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from femsub.checks import FemsubWarning, warn
from femsub.io.atomic import HASHES, content_sum

RESULTS = "results.json"
#: keys of a results.json that femsub reads, whatever the scene
SHAPE = {"scene": str, "inputs": dict, "files": list, "versions": dict, "machine": dict, "written": list, "sha256": dict,
         "warnings": list, "failed": dict, "date": str}


def results_of(path: Path, compared: bool = False) -> dict[str, Any] | None:
    """The content of a results.json, with every key of `SHAPE`; None if the file is none.

    `compared`: warns if the content is not what femsub wrote. Files of older versions have no checksum of their own content.
    """
    if not path.is_file():
        return None
    try:
        known = json.loads(path.read_text(encoding="utf-8"))
        json.dumps(known, ensure_ascii=False).encode()  # half a character cannot be printed
    except (ValueError, RecursionError):
        return None
    if not isinstance(known, dict) or "scene" not in known:
        return None
    said = known
    known = {key: kind() for key, kind in SHAPE.items()} | known
    fit = all(isinstance(known[key], kind) for key, kind in SHAPE.items()) and all(
        isinstance(item, dict) and all(isinstance(item.get(key), str) for key in ("path", "sha256")) for item in known["files"])
    if not fit or not isinstance(known["inputs"].get("units", ""), (str, dict)) or not isinstance(known["inputs"].get("use", []),
                                                                                                  list):
        return None
    if compared and (own := known[HASHES].get(RESULTS)) is not None and own != content_sum(RESULTS, said):
        warn(f"{path} has another content than femsub wrote, by its own sum: it is damaged, or somebody changed it. If you did, "
             f"take {RESULTS!r} out of its {HASHES!r}", FemsubWarning)
    return known
