"""The scene `brake` with elements of any size."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from femsub.app.grammar import Scene, merged
from femsub.app.kinds import Kinds
from femsub.app.models import Models

PADS = ("inboard", "outboard")


def brake(size: float, table: Mapping[str, Any] = {}) -> Scene:
    """The scene with elements of this size, and the keys of `table`."""
    sized = {"scene": "brake", "part": {name: {"solid": {"brake": name, "size": size}} for name in ("disc", *PADS)}}
    return Scene(merged(sized, table, Kinds()))


def brake_models(size: float) -> Models:
    """Its models: `full`, and the contacts `at({"mu": 0.6})`."""
    return brake(size).models
