"""The keys of a scene in three forms: `femsub keys SCENE` lists them, `femsub new SCENE` writes a scene file to begin with, and
`femsub schema` gives the JSON schema, with which editors complete, explain and check keys.

`femsub schema > scene.schema.json` writes it beside a scene file, where editors look for it. What a schema cannot say is checked
when a scene is read: bounds that depend on other keys (the belt's mass is one of n), the order within [lo, hi], NaN.
"""

from __future__ import annotations

import dataclasses
import inspect
import json
import textwrap
from collections.abc import Container, Iterator, Mapping
from pathlib import Path
from typing import Any

from femsub.app.keys import HERTZ, Key, defaults_of, item_kind, keys_of, kinds, type_words
from femsub.app.scene import SCENES, scene_of

DIALECT = "http://json-schema.org/draft-07/schema#"  # the newest one that TOML editors know
FILE = "scene.schema.json"  # what scene files call it
SIMPLE = {bool: "boolean", int: "integer", float: "number", str: "string"}


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


def scene_schema(name: str) -> dict[str, Any]:
    """The schema of the files of one scene."""
    scene = scene_of(name)[0]
    text = SCENES[name][1] if name in SCENES else inspect.getdoc(scene) or ""
    made = _table(scene, defaults_of(scene, name))
    made["properties"] = {"scene": {"const": name, "description": text}, **made["properties"]}
    made["required"] = [*(["scene"] if name != "chain" else []), *made["required"]]
    return {"$schema": DIALECT, "title": f"femsub scene {name}", "description": text, "minProperties": 1, **made}


def schema() -> dict[str, Any]:
    """The schema of all scene files, by the scene that each names; 'chain' where it names none.

    Keys that mean the same in all scenes are described once. The first part lists all keys, since editors do not look for
    completions behind an `if`.
    """
    scenes = {name: scene_schema(name) for name in SCENES}
    python = {"type": "string", "pattern": r"\.py$"}
    every: dict[str, Any] = {"scene": {"anyOf": [{"enum": list(SCENES)}, python], "default": "chain",
                                       "description": "what is run: the name of a scene, or the Python file of one of your own"}}
    meanings: dict[str, list[Any]] = {}
    for made in scenes.values():
        for key, one in made["properties"].items():
            bare = {word: value for word, value in one.items() if word != "default"}
            meanings.setdefault(key, []).extend([bare] if bare not in meanings.get(key, []) else [])
    shared = {key for key, found in meanings.items() if len(found) == 1}
    every |= {key: found[0] if key in shared else {"description": found[0].get("description", "")}
              for key, found in meanings.items() if key != "scene"}
    cases = []
    for name, made in scenes.items():
        own = {key: {word: one[word] for word in one if word == "default" or key not in shared}
               for key, one in made["properties"].items() if key != "scene"}
        rules = {word: value for word, value in made.items() if word in ("dependencies", "additionalProperties", "required")}
        asked: dict[str, Any] = {"properties": {"scene": {"const": name}}, "required": made["required"][:1]}
        if name == "chain":
            del asked["required"]
        cases.append({"if": asked, "then": {"properties": {"scene": {}, **own}, **rules}})
    return {"$schema": DIALECT, "title": "femsub scene file",
            "description": "What `femsub run` computes. `femsub keys SCENE` explains the keys.",
            "type": "object", "minProperties": 1, "allOf": [{"properties": every}, *cases]}


def _table(kind: type, defaults: Mapping[str, Any]) -> dict[str, Any]:
    """The schema of a table of keys."""
    declared = keys_of(kind)
    properties: dict[str, Any] = {}
    together: dict[str, list[str]] = {}
    for name, one in declared.items():
        # what the value may be, each way of writing it
        ways = []
        for way in kinds(one.type):
            inner = item_kind(way)
            if inner is None:
                ways.append(_value(way, one, kind))
                continue
            single = [_value(item, one, kind) for item in kinds(inner)]
            if one.in_hertz:
                single.append({"type": "string", "pattern": f"^{HERTZ.pattern}$"})
            length = one.length
            ways.append({"type": "array", "items": _any(single), "minItems": length or 1}
                        | ({"maxItems": length} if length else {}) | ({"uniqueItems": True} if one.distinct else {}))
            if length is None and not dataclasses.is_dataclass(inner):
                ways += [bare for bare in single if bare not in ways]  # one value does for a list of one
        # its meaning and default
        about = ", ".join(part for part in (one.unit, one.otherwise and f"default: {one.otherwise}") if part)
        properties[name] = {"description": one.meaning + (f" ({about})" if about else ""), **_any(ways)}
        if defaults[name] not in (None, "", []) and not one.otherwise:
            properties[name]["default"] = defaults[name]
        if one.required_with:
            together.setdefault(one.required_with, []).append(name)
    made: dict[str, Any] = {"type": "object", "properties": properties, "additionalProperties": False,
                            "required": [name for name, one in declared.items() if one.required]}
    return made | ({"dependencies": together} if together else {})


def _value(kind: Any, one: Key, owner: type) -> dict[str, Any]:
    if dataclasses.is_dataclass(kind):
        assert isinstance(kind, type)
        return _table(kind, defaults_of(kind))
    made: dict[str, Any] = {"type": SIMPLE[kind]}
    if kind in (int, float):
        bounds = {"minimum": one.least, "maximum": one.most, "exclusiveMinimum": one.above,
                  "exclusiveMaximum": one.below}
        made |= {word: bound for word, bound in bounds.items() if bound is not None}
    if kind is str and one.choices is not None:
        made["enum"] = [*one.choices(owner), *(one.also() if one.also else ())]
    elif kind is str and (one.required or one.required_with):
        made["minLength"] = 1
    return made


def _any(ways: list[dict[str, Any]]) -> dict[str, Any]:
    return ways[0] if len(ways) == 1 else {"anyOf": ways}
