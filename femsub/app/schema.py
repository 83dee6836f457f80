"""The JSON schema of scene files: editors complete, explain and check keys with it.

`femsub schema > scene.schema.json` writes it beside a scene file, where editors look for it. What a schema cannot say is checked
when a scene is read: bounds that depend on other keys (the belt's mass is one of n), the order within [lo, hi], NaN.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Mapping
from typing import Any

from femsub.app.keys import HERTZ, Key, defaults_of, item_kind, keys_of, kinds
from femsub.app.scene import SCENES, scene_of

DIALECT = "http://json-schema.org/draft-07/schema#"  # the newest one that TOML editors know
FILE = "scene.schema.json"  # what scene files call it
SIMPLE = {bool: "boolean", int: "integer", float: "number", str: "string"}


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
