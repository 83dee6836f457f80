"""`femsub keys SCENE` and `femsub new SCENE`: the keys of a scene as a list, and as a scene file to begin with."""

from __future__ import annotations

import dataclasses
import inspect
import json
import textwrap
from collections.abc import Container, Iterator, Mapping
from pathlib import Path
from typing import Any

from femsub.app.keys import Key, defaults_of, item_kind, keys_of, kinds, type_words
from femsub.app.scene import scene_of
from femsub.app.schema import FILE


def keys_text(name: str) -> str:
    """Every key of a scene: its type, unit, default and meaning."""
    scene = scene_of(name)[0]
    return "\n".join([*_docstring(scene), "", *_listed(scene, defaults_of(scene, Path(name).stem), "")])


def new_text(name: str) -> str:
    """A scene file with every key. Those that have a default are commented out, so that the file runs as it is.

    A scene that needs files of its own has their names as examples.
    """
    scene = scene_of(name)[0]
    lines = [f"#:schema {FILE}", *_docstring(scene, "# "), "#", *_paragraph(
        "A key behind a # stands at its default. Delete the # to change it.", "# "), "", f'scene = "{name}"']
    return "\n".join([*lines, *_template(scene, defaults_of(scene, Path(name).stem), "")])


def _listed(kind: type, defaults: Mapping[str, Any], indent: str) -> Iterator[str]:
    declared = keys_of(kind)
    wide = max(map(len, declared))
    for name, one in declared.items():
        margin = f"{indent}{'':<{wide}}  "
        first, *more = _paragraph(_about(one, kind, defaults[name]), margin)
        yield from (f"{indent}{name:<{wide}}  {first[len(margin):]}", *more, *_paragraph(one.meaning, margin))
        if one.table is not None:
            yield from _listed(one.table, defaults_of(one.table), margin)


def _template(kind: type, defaults: Mapping[str, Any], header: str, given: Container[str] = ()) -> Iterator[str]:
    """The keys of a table whose header is written already; tables within it come last, as TOML has it.

    Keys that are `given` in an example stand without a #, as those that are required.
    """
    for name, one in sorted(keys_of(kind).items(), key=lambda pair: pair[1].table is not None):
        value = one.example if (example := defaults[name] in (None, "", [])) else defaults[name]
        yield ""
        yield from _paragraph(f"{one.meaning} ({_about(one, kind)}{'; an example' if example else ''})", "# ")
        table, mark = one.table, "" if one.required or name in given else "#"
        if table is None:
            yield f"{mark}{name} = {toml(value)}"
            continue
        brackets = "[[{}]]" if item_kind(kinds(one.type)[0]) else "[{}]"
        for item in value if isinstance(value, list) else [value]:
            yield mark + brackets.format(header + name)
            values = vars(item) if dataclasses.is_dataclass(item) else item or {}
            standard = defaults_of(table)
            own = {key for key, value in values.items() if value != standard.get(key)}
            lines = _template(table, standard | values, f"{header}{name}.", own)
            yield from (mark + line if line and not line.startswith("#") else line for line in lines)


def _about(one: Key, owner: type, default: Any = None) -> str:
    """'a number above 0 [m]; default 1.0'."""
    words = type_words(one.type).replace("a list of", f"{one.form}," if one.form else "a list of")
    words += f"{', numbers' if 'string' in words else ''} {one.bounds}" if one.bounds else ""
    words += f" [{one.unit}]" if one.unit else ""
    words += ", or \"5 kHz\" where units are given" if one.in_hertz else ""
    words += f": {', '.join(one.choices(owner))}" if one.choices is not None else ""
    standard = one.otherwise or ("" if default in (None, "", []) else toml(default))
    return words + ("; required" if one.required else f"; default: {standard}" if standard else "")


def toml(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        if value and not 1e-3 <= abs(value) < 1e6:
            mantissa, exponent = f"{value:.14e}".split("e")
            return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
        digits = f"{value:.15g}"  # 0.3, not 0.30000000000000004
        return digits if "." in digits else f"{digits}.0"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(toml, value))}]"
    return str(value)


def _docstring(kind: type, indent: str = "") -> list[str]:
    """A class's docstring, wrapped anew."""
    parts = inspect.cleandoc(kind.__doc__ or "").split("\n\n")
    return [line for part in parts for line in _paragraph(part, indent)]


def _paragraph(text: str, indent: str = "") -> list[str]:
    return textwrap.wrap(text, width=80, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)
