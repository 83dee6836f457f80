"""Descriptions of declared tables: lists of keys with types, units, defaults and meanings, and a JSON schema for editors."""

from __future__ import annotations

import dataclasses
import inspect
import textwrap
from collections.abc import Iterator
from typing import Any, get_args, get_origin

from femsub.io.declared import HERTZ, Key, alternatives, item_type, keys_of, spelt, type_words
from femsub.io.toml_files import toml

SIMPLE = {bool: "boolean", int: "integer", float: "number", str: "string"}


def first_line(kind: Any) -> str:
    """The first paragraph of a class's docstring, in one line."""
    return inspect.cleandoc(kind.__doc__ or "").partition("\n\n")[0].replace("\n", " ")


def listed_keys(kind: Any, indent: str) -> Iterator[str]:
    declared = {spelt(kind, name): one for name, one in keys_of(kind).items()}
    wide = max(map(len, declared))
    for name, one in declared.items():
        margin = f"{indent}{'':<{wide}}  "
        first, *more = _paragraph(_about(one, kind), margin)
        yield from (f"{indent}{name:<{wide}}  {first[len(margin):]}", *more, *_paragraph(one.meaning, margin))
        for table in one.tables:
            yield from listed_keys(table, margin)


def _about(one: Key, owner: Any) -> str:
    """'a number above 0 [m]; default 1.0'."""
    words = type_words(one.type).replace("a list of", f"{one.form}," if one.form else "a list of")
    words += f"{', numbers' if 'string' in words else ''} {one.bounds}" if one.bounds else ""
    words += f" [{one.unit}]" if one.unit else ""
    words += ", or \"5 kHz\" where the unit of time is s" if one.in_hertz else ""
    words += f": {', '.join(one.choices(owner))}" if one.choices is not None else ""
    standard = one.otherwise or ("" if one.default in (None, "", [], {}) else toml(one.default))
    needed = "; required" if one.required else f"; required with {one.required_with}" if one.required_with else ""
    return words + (needed or (f"; default: {standard}" if standard else ""))


def docstring_lines(kind: Any) -> list[str]:
    """A class's docstring, wrapped anew."""
    parts = inspect.cleandoc(kind.__doc__ or "").split("\n\n")
    return [line for part in parts for line in _paragraph(part, "")]


def _paragraph(text: str, indent: str) -> list[str]:
    return textwrap.wrap(text, width=80, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)


def table_schema(kind: Any) -> dict[str, Any]:
    """The schema of a table of keys."""
    properties: dict[str, Any] = {}
    together: dict[str, list[str]] = {}
    declared = {spelt(kind, field): one for field, one in keys_of(kind).items()}
    for name, one in declared.items():
        about = ", ".join(part for part in (one.unit, one.otherwise and f"default: {one.otherwise}") if part)
        properties[name] = {"description": one.meaning + (f" ({about})" if about else ""), **any_of(_ways(one, one.type, kind))}
        if one.default not in (None, "", [], {}) and not one.otherwise and not one.required:
            properties[name]["default"] = one.default
        if one.required_with:
            together.setdefault(one.required_with, []).append(name)
    made: dict[str, Any] = {"type": "object", "properties": properties, "additionalProperties": False}
    if needed := [name for name, one in declared.items() if one.required]:
        made["required"] = needed
    return made | ({"dependencies": together} if together else {})


def _ways(one: Key, declared: Any, owner: Any) -> list[dict[str, Any]]:
    """The schemas of a value, one for each way of writing it."""
    ways: list[dict[str, Any]] = []
    for way in alternatives(declared):
        inner = item_type(way)
        if way is Any:
            ways.append({})
        elif dataclasses.is_dataclass(way):
            ways.append(table_schema(way))
        elif get_origin(way) is dict:
            ways.append({"type": "object", "additionalProperties": any_of(_ways(one, get_args(way)[1], owner))})
        elif inner is not None:
            single = _ways(one, inner, owner)
            length = one.length
            ways.append({"type": "array", "items": any_of(single), "minItems": length or 1} | (
                {"maxItems": length} if length else {}) | ({"uniqueItems": True} if one.distinct else {}))
            if length is None and item_type(inner) is None:
                bare = [{"not": {"type": "array"}}] if single == [{}] else single
                ways += [way for way in bare if way not in ways]  # a single value may stand for a list of one
        else:
            ways.append(_value(way, one, owner))
            if one.in_hertz:
                ways.append({"type": "string", "pattern": f"^{HERTZ.pattern}$"})
    return ways


def _value(kind: Any, one: Key, owner: Any) -> dict[str, Any]:
    made: dict[str, Any] = {"type": SIMPLE[kind]}
    if kind in (int, float):
        bounds = {"minimum": one.least, "maximum": one.most, "exclusiveMinimum": one.above, "exclusiveMaximum": one.below}
        made |= {word: bound for word, bound in bounds.items() if bound is not None}
    if kind is str and one.choices is not None:
        made["enum"] = list(one.choices(owner))
    elif kind is str and (one.required or one.required_with):
        made["minLength"] = 1
    return made


def any_of(ways: list[dict[str, Any]]) -> dict[str, Any]:
    return ways[0] if len(ways) == 1 else {"anyOf": ways}
