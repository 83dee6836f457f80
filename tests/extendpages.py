"""The examples of the pages in docs/extend, as the names that their blocks define."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

PAGES = Path(__file__).parent.parent / "docs" / "extend"


def blocks_of(page: str, language: str = "python") -> list[str]:
    """The blocks of a page, in their order."""
    text = (PAGES / f"{page}.md").read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def names_of(page: str, blocks: int | None = None) -> dict[str, Any]:
    """What the first blocks of a page define, or all of them."""
    module = sys.modules[f"extend_{page}"] = ModuleType(f"extend_{page}")
    for block in blocks_of(page)[:blocks]:
        exec(compile(block, f"docs/extend/{page}.md", "exec"), module.__dict__)
    return module.__dict__


def lines_of(block: str) -> int:
    """Lines of code, without empty ones."""
    return sum(bool(line.strip()) for line in block.splitlines())
