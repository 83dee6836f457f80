"""Scene files explained: `femsub keys` lists kinds and their keys, `femsub new` prints scenes, `femsub schema` is for editors.

`femsub schema > scene.schema.json` writes the schema beside a scene file, where editors look for it. What a schema cannot say is
checked when a scene is read: names that refer to others, bounds that depend on other keys, the order within [lo, hi], NaN.
"""

from __future__ import annotations

import dataclasses
import inspect
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_origin

from femsub.app.changes import ParameterKeys
from femsub.app.grammar import ENDING, Settings, built_in, merged, text_of
from femsub.app.keys import HERTZ, Key, item_kind, keys_of, kinds, type_words
from femsub.app.kinds import FAMILIES, Kinds
from femsub.app.methods import ReduceKeys
from femsub.app.parts import MaterialKeys
from femsub.checks import InputError, unknown_name
from femsub.io import parsed_toml, toml, toml_text

DIALECT = "http://json-schema.org/draft-07/schema#"  # the newest one that TOML editors know
FILE = "scene.schema.json"  # what scene files call it
SIMPLE = {bool: "boolean", int: "integer", float: "number", str: "string"}
#: tables of one kind each, by what stands in brackets
TABLES: dict[str, Any] = {"scene": Settings, "material": MaterialKeys, "parameter": ParameterKeys, "reduce": ReduceKeys}


def keys_text(name: str = "") -> str:
    """Every key of a table: its type, unit, default and meaning; without a name all tables and kinds."""
    known = Kinds()
    if not name:
        lines = [f"{word}: {first_line(kind)}" for word, kind in TABLES.items()]
        for family in FAMILIES:
            lines += ["", f"{family}: one of"]
            names = known.names(family)
            wide = max(map(len, names))
            lines += [f"  {one:<{wide}}  {first_line(known.kind(family, one))}" for one in names]
        return "\n".join(lines)
    family, _, one = name.rpartition(".")
    found = [(each, one) for each in ([family] if family else FAMILIES) if each in FAMILIES and one in known.names(each)]
    if name in TABLES:
        return "\n".join([*_docstring(TABLES[name]), "", *_listed(TABLES[name], "")])
    if not found:
        raise unknown_name("kind", name, [*TABLES, *(each for family in FAMILIES for each in known.names(family))])
    parts = []
    for family, one in found:
        kind = known.kind(family, one)
        parts.append("\n".join([f"{family}: {one}", *_docstring(kind), "", *_listed(kind, "")]))
    return "\n\n".join(parts)


def new_text(source: str) -> str:
    """The file of a built-in scene; of a scene file of one's own the whole file that it stands for."""
    path = Path(source)
    if path.suffix != ENDING:
        return f"#:schema {FILE}\n{text_of(source)}"
    if not path.is_file():
        raise InputError(f"there is no scene file {source}")
    table = parsed_toml(path.read_text(encoding="utf-8"), source)
    if (name := table.pop("scene", None)) is not None:
        table = merged(parsed_toml(text_of(str(name)), str(name)), table, Kinds())
    return f"#:schema {FILE}\n" + toml_text(table)


def first_line(kind: Any) -> str:
    """The first sentence of a class's docstring."""
    return inspect.cleandoc(kind.__doc__ or "").partition("\n\n")[0].replace("\n", " ")


def _listed(kind: Any, indent: str) -> Iterator[str]:
    declared = {spelt(kind, name): one for name, one in keys_of(kind).items()}
    wide = max(map(len, declared))
    for name, one in declared.items():
        margin = f"{indent}{'':<{wide}}  "
        first, *more = _paragraph(_about(one, kind), margin)
        yield from (f"{indent}{name:<{wide}}  {first[len(margin):]}", *more, *_paragraph(one.meaning, margin))
        for table in tables_of(one):
            yield from _listed(table, margin)


def spelt(kind: Any, field: str) -> str:
    """The key of a field: that of the kind itself has hyphens."""
    own = getattr(kind, "KIND", "")
    return own if own.replace("-", "_") == field else field


def tables_of(one: Key) -> list[Any]:
    """The classes of tables that a key may hold."""
    found = []
    for kind in kinds(one.type):
        inner = item_kind(kind) or (get_args(kind)[1] if get_origin(kind) is dict else kind)
        if dataclasses.is_dataclass(inner):
            found.append(inner)
    return found


def _about(one: Key, owner: Any) -> str:
    """'a number above 0 [m]; default 1.0'."""
    words = type_words(one.type).replace("a list of", f"{one.form}," if one.form else "a list of")
    words += f"{', numbers' if 'string' in words else ''} {one.bounds}" if one.bounds else ""
    words += f" [{one.unit}]" if one.unit else ""
    words += ", or \"5 kHz\" where units are given" if one.in_hertz else ""
    words += f": {', '.join(one.choices(owner))}" if one.choices is not None else ""
    standard = one.otherwise or ("" if one.default in (None, "", [], {}) else toml(one.default))
    needed = "; required" if one.required else f"; required with {one.required_with}" if one.required_with else ""
    return words + (needed or (f"; default: {standard}" if standard else ""))


def _docstring(kind: Any, indent: str = "") -> list[str]:
    """A class's docstring, wrapped anew."""
    parts = inspect.cleandoc(kind.__doc__ or "").split("\n\n")
    return [line for part in parts for line in _paragraph(part, indent)]


def _paragraph(text: str, indent: str = "") -> list[str]:
    return textwrap.wrap(text, width=80, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)


def schema() -> dict[str, Any]:
    """The schema of scene files. A table of a family is of the kind whose key stands in it, or in the scene that it begins with.

    Without kinds of one's own, `use`, a table has no other keys than those of femsub's kinds.
    """
    known, strict, whole = Kinds(), dict[str, Any](), dict[str, Any]()
    properties: dict[str, Any] = {"scene": {"enum": list(built_in()),
                                            "description": "a built-in scene that this one begins with"}}
    properties |= _table(Settings)["properties"]
    for name in ("material", "parameter"):
        properties[name] = {"type": "object", "additionalProperties": _table(TABLES[name]),
                            "description": first_line(TABLES[name])}
    properties["reduce"] = _table(ReduceKeys)
    for family in FAMILIES:
        names = known.names(family)
        shapes = [_table(known.kind(family, name)) for name in names]
        every: dict[str, Any] = {}
        values: dict[str, list[Any]] = {}
        for made in shapes:  # editors do not look for completions behind an `if`
            for key, one in made["properties"].items():
                every.setdefault(key, {"description": one.get("description", "")})
                value = {word: what for word, what in one.items() if word not in ("description", "default")}
                values.setdefault(key, []).extend([value] * (value not in values.get(key, [])))
        one_at_least = {"properties": {key: _any(ways) for key, ways in values.items()}, "propertyNames": {"enum": list(values)}}
        strict[family] = {"additionalProperties": one_at_least, "items": one_at_least}
        needed = [{"if": {"required": [name]}, "then": {"required": made.pop("required", [])}} for name, made in zip(
            names, shapes, strict=True) if family != "ask"]  # of a scene that begins with another one they may stand there
        whole[family] = {"additionalProperties": {"allOf": needed}, "items": {"allOf": needed}} if needed else {}
        one_of = {"type": "object", "properties": every, "allOf": [
            {"if": {"required": [name]}, "then": made} for name, made in zip(names, shapes, strict=True)]}
        tables: dict[str, Any] = {"type": "object", "additionalProperties": one_of}
        listed = {"type": "array", "items": one_of}
        properties[family] = tables if family == "part" else listed if family == "ask" else {"anyOf": [tables, listed]}
    return {"$schema": DIALECT, "title": "femsub scene file", "type": "object", "minProperties": 1, "properties": properties,
            "additionalProperties": False, "if": {"required": ["use"]}, "else": {"properties": strict},
            "anyOf": [{"required": ["scene"]}, {"properties": whole}],
            "description": "A model, and the analyses to run. `femsub keys` explains the tables and their keys."}


def _table(kind: Any) -> dict[str, Any]:
    """The schema of a table of keys."""
    properties: dict[str, Any] = {}
    together: dict[str, list[str]] = {}
    declared = keys_of(kind)
    for field, one in declared.items():
        name = spelt(kind, field)
        about = ", ".join(part for part in (one.unit, one.otherwise and f"default: {one.otherwise}") if part)
        properties[name] = {"description": one.meaning + (f" ({about})" if about else ""), **_any(_ways(one, one.type, kind))}
        if one.default not in (None, "", [], {}) and not one.otherwise and not one.required:
            properties[name]["default"] = one.default
        if one.required_with:
            together.setdefault(one.required_with, []).append(name)
    made: dict[str, Any] = {"type": "object", "properties": properties, "additionalProperties": False}
    if needed := [spelt(kind, name) for name, one in declared.items() if one.required]:
        made["required"] = needed
    return made | ({"dependencies": together} if together else {})


def _ways(one: Key, declared: Any, owner: Any) -> list[dict[str, Any]]:
    """What a value may be, each way of writing it."""
    ways: list[dict[str, Any]] = []
    for way in kinds(declared):
        inner = item_kind(way)
        if way is Any:
            ways.append({})
        elif dataclasses.is_dataclass(way):
            ways.append(_table(way))
        elif get_origin(way) is dict:
            ways.append({"type": "object", "additionalProperties": _any(_ways(one, get_args(way)[1], owner))})
        elif inner is not None:
            single = _ways(one, inner, owner)
            if one.in_hertz:
                single.append({"type": "string", "pattern": f"^{HERTZ.pattern}$"})
            length = one.length
            ways.append({"type": "array", "items": _any(single), "minItems": length or 1} | (
                {"maxItems": length} if length else {}) | ({"uniqueItems": True} if one.distinct else {}))
            if length is None and item_kind(inner) is None:
                bare = [{"not": {"type": "array"}}] if single == [{}] else single
                ways += [way for way in bare if way not in ways]  # one value does for a list of one
        else:
            ways.append(_value(way, one, owner))
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


def _any(ways: list[dict[str, Any]]) -> dict[str, Any]:
    return ways[0] if len(ways) == 1 else {"anyOf": ways}
