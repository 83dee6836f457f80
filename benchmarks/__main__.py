"""The commands of this folder: `python -m benchmarks` lists them, `python -m benchmarks NAME [options]` runs one."""

from __future__ import annotations

import argparse
import ast
import inspect
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from benchmarks import UsageError

#: The module of each command. Its docstring describes the command and its options, which are the arguments of its `main`.
COMMANDS = {name: f"benchmarks.{name.replace('-', '_')}" for name in (
    "attack", "bases", "gallery", "method-pictures", "over-a-range", "pages", "public-brake-picture", "report",
    "scaling", "users-picture", "extreme")}


def first_line(module: str) -> str:
    """The first line of a command's docstring. Its file is read, not run, since some commands need further packages."""
    spec = find_spec(module)
    assert spec is not None and spec.origin is not None
    text = ast.get_docstring(ast.parse(Path(spec.origin).read_text(encoding="utf-8"))) or ""
    return text.splitlines()[0]


def parser_of(name: str, module: ModuleType) -> argparse.ArgumentParser:
    """The parser from the signature of the module's `main`: arguments after `*` are options, a tuple takes several words.

    Annotated[kind, choices] lists the accepted words.
    """
    parser = argparse.ArgumentParser(f"python -m benchmarks {name}", description=module.__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    hints = get_type_hints(module.main, include_extras=True)
    for key, one in inspect.signature(module.main).parameters.items():
        hint, choices = get_args(hints[key]) if get_origin(hints[key]) is Annotated else (hints[key], None)
        several, optional = get_origin(hint) is tuple, one.kind is one.KEYWORD_ONLY
        kind = (get_args(hint) or (hint,))[0]
        given: dict[str, Any] = {"action": "store_true"} if kind is bool else {"type": kind, "choices": choices}
        if several:
            given["nargs"] = "+" if optional else "*"
        if one.default is not one.empty:
            given |= {"default": one.default, "help": "default %(default)s" if one.default not in (None, (), False) else None}
        if optional:
            given["required"] = one.default is one.empty
        parser.add_argument(f"--{key}" if optional else key, **given)
    return parser


def main() -> int:
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name not in COMMANDS:
        known = "\n".join(f"  {name:22}{first_line(module)}" for name, module in sorted(COMMANDS.items()))
        print(f"python -m benchmarks NAME [options]\n\n{known}", file=sys.stderr if name else sys.stdout)
        return 2 if name.strip("-") not in ("", "h", "help") else 0
    module = import_module(COMMANDS[name])
    parser = parser_of(name, module)
    try:
        return module.main(**vars(parser.parse_args(sys.argv[2:]))) or 0
    except UsageError as error:
        parser.error(str(error))


if __name__ == "__main__":
    sys.exit(main())
