"""Scene files explained: `femsub keys` lists kinds and their keys, `femsub new` prints scenes, `femsub schema` is for editors.

`femsub schema > scene.schema.json` writes the schema beside a scene file, where editors look for it. A schema cannot express all
rules: references to other names, bounds that depend on other keys, the order in [lo, hi] and NaN are checked on reading a scene.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from femsub.app.changes import ParameterKeys
from femsub.app.grammar import ENDING, Settings, built_in, merged, text_of
from femsub.app.kinds import FAMILIES, Kinds
from femsub.app.methods import ReduceKeys
from femsub.app.parts import MaterialKeys
from femsub.checks import InputError, unknown_name
from femsub.io import any_of, docstring_lines, first_line, listed_keys, parsed_toml, table_schema, toml_text

DIALECT = "http://json-schema.org/draft-07/schema#"  # the newest one that TOML editors know
FILE = "scene.schema.json"  # the name of the schema in scene files
#: tables that have one kind only, by their names in brackets
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
        return "\n".join([*docstring_lines(TABLES[name]), "", *listed_keys(TABLES[name], "")])
    if not found:
        raise unknown_name("kind", name, [*TABLES, *(each for family in FAMILIES for each in known.names(family))])
    parts = []
    for family, one in found:
        kind = known.kind(family, one)
        parts.append("\n".join([f"{family}: {one}", *docstring_lines(kind), "", *listed_keys(kind, "")]))
    return "\n\n".join(parts)


def new_text(source: str) -> str:
    """The text of a built-in scene; for a scene file, its text with the built-in scene that it begins with filled in."""
    path = Path(source)
    if path.suffix != ENDING:
        return f"#:schema {FILE}\n{text_of(source)}"
    if not path.is_file():
        raise InputError(f"there is no scene file {source}")
    table = parsed_toml(path.read_text(encoding="utf-8"), source)
    if (name := table.pop("scene", None)) is not None:
        table = merged(parsed_toml(text_of(str(name)), str(name)), table, Kinds())
    return f"#:schema {FILE}\n" + toml_text(table)


def schema() -> dict[str, Any]:
    """The JSON schema of scene files. A key in a table names its kind, or a key in the same table of the built-in scene below.

    Unless a scene has kinds of its user (`use`), its tables may have only keys of femsub's kinds.
    """
    known, strict, whole = Kinds(), dict[str, Any](), dict[str, Any]()
    properties: dict[str, Any] = {"scene": {"enum": list(built_in()),
                                            "description": "a built-in scene that this one begins with"}}
    properties |= table_schema(Settings)["properties"]
    for name in ("material", "parameter"):
        properties[name] = {"type": "object", "additionalProperties": table_schema(TABLES[name]),
                            "description": first_line(TABLES[name])}
    properties["reduce"] = table_schema(ReduceKeys)
    for family in FAMILIES:
        names = known.names(family)
        shapes = [table_schema(known.kind(family, name)) for name in names]
        every: dict[str, Any] = {}
        values: dict[str, list[Any]] = {}
        for made in shapes:  # editors offer no completions from inside an `if`
            for key, one in made["properties"].items():
                every.setdefault(key, {"description": one.get("description", "")})
                value = {word: what for word, what in one.items() if word not in ("description", "default")}
                values.setdefault(key, []).extend([value] * (value not in values.get(key, [])))
        one_at_least = {"properties": {key: any_of(ways) for key, ways in values.items()},
                        "propertyNames": {"enum": list(values)}}
        strict[family] = {"additionalProperties": one_at_least, "items": one_at_least}
        needed = [{"if": {"required": [name]}, "then": {"required": made.pop("required", [])}} for name, made in zip(
            names, shapes, strict=True) if family != "ask"]  # for scenes without a built-in one, which may have these keys
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
