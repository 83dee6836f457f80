"""The commands of this folder: `python -m benchmarks` lists them, `python -m benchmarks NAME [options]` runs one."""

from __future__ import annotations

import ast
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

#: The module of each command, whose docstring says what it does and whose `main` reads sys.argv.
COMMANDS = {name: f"benchmarks.{name.replace('-', '_')}" for name in (
    "attack", "band", "bases", "brake", "compare-methods", "gallery", "make-meshes", "method-pictures", "page-picture",
    "paper-figures", "readme-picture", "report", "scaling", "superelements", "tutorial-figures", "users-picture")}
COMMANDS["extreme"] = "benchmarks.extreme.command"


def first_line(module: str) -> str:
    """What a command does. Its file is read, not run: some commands need packages of their own."""
    spec = find_spec(module)
    assert spec is not None and spec.origin is not None
    text = ast.get_docstring(ast.parse(Path(spec.origin).read_text(encoding="utf-8"))) or ""
    return text.splitlines()[0]


def main() -> int:
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name not in COMMANDS:
        known = "\n".join(f"  {name:18}{first_line(module)}" for name, module in sorted(COMMANDS.items()))
        print(f"python -m benchmarks NAME [options]\n\n{known}", file=sys.stderr if name else sys.stdout)
        return 2 if name.strip("-") not in ("", "h", "help") else 0
    sys.argv[:2] = [f"python -m benchmarks {name}"]
    return import_module(COMMANDS[name]).main() or 0


if __name__ == "__main__":
    sys.exit(main())
