"""Tables of files, declared as classes: what each key means, its unit, type and bounds, stated once, where its field is.

    @dataclass(frozen=True)
    class Strip:
        length: float = key(1.0, "the strip's length", unit="m", above=0)
        modes: list[int] = key([10, 20], "numbers of modes to compare", least=0)

`femsub keys`, `femsub new`, the JSON schema and the checks of values all read it from there. A subclass may declare a key anew
with another default only: `length: float = 2.0`. A field that neither its class nor a base declares by `key` is no key. A key may
hold a table or a list of tables: its type is then a dataclass of this kind, or a list of it.
"""

from __future__ import annotations

import dataclasses
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from math import pi
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from femsub.checks import InputError, choice, finite_number, interval, shown, unknown_name, whole_number
from femsub.io.faults import Faults, Place

WORDS = {bool: ("true or false", "true or false"), int: ("a whole number", "whole numbers"), float: ("a number", "numbers"),
         str: ("a string", "strings")}
RANGES = ("[lo, hi]", "[from, to]")
HIGHEST = sys.float_info.max ** (1 / 3)  # limit for the upper end of a band
HERTZ = re.compile(r"\s*(\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)\s*(k?)Hz\s*")  # a frequency, where the unit of time is the second


@dataclass(frozen=True)
class Key:
    """The declaration of a key.

    Attributes
    ----------
    meaning : str
        For `femsub keys` and editors; it begins with a small letter.
    unit : str
        Unit of the value, or of each value in a list.
    least, most, above, below : float, optional
        Bounds of the value, or of each value in a list.
    choices : callable
        The valid words, from the class that has the key.
    form : str
        The form of a list of fixed length, '[x, y]', or of a range, '[lo, hi]' or '[from, to]', whose order is checked.
    distinct : bool
        No value of a list may occur twice.
    otherwise : str
        The effect of leaving the key out, where its default does not show it.
    example : object
        A value to show where there is no default.
    required : bool
        The key must be there, and not empty.
    required_with : str
        It must be there if this other key is.
    file : bool
        It names a file, relative to the scene file; its hash is in results.json.
    type, default : object
        Type and default of the field, known once a class has it.
    """

    meaning: str
    unit: str = ""
    least: float | None = None
    most: float | None = None
    above: float | None = None
    below: float | None = None
    choices: Callable[[Any], Iterable[str]] | None = None
    form: str = ""
    distinct: bool = False
    otherwise: str = ""
    example: Any = None
    required: bool = False
    required_with: str = ""
    file: bool = False
    type: Any = None
    default: Any = None

    @property
    def length(self) -> int | None:
        """The length of a list of fixed length, else None."""
        return self.form.count(",") + 1 if self.form else None

    @property
    def bounds(self) -> str:
        """'at least 1 and at most 1000'."""
        bounds = {"at least": self.least, "above": self.above, "at most": self.most, "below": self.below}
        return " and ".join(f"{word} {bound:,}" for word, bound in bounds.items() if bound is not None)

    def admits(self, value: float) -> bool:
        """Whether a number is within the bounds."""
        return ((self.least is None or value >= self.least) and (self.most is None or value <= self.most)
                and (self.above is None or value > self.above) and (self.below is None or value < self.below))

    @property
    def in_hertz(self) -> bool:
        """Whether it is a frequency, or a list of them, which may be given as "5000 Hz" or "5 kHz"."""
        return self.unit.startswith("rad/")

    @property
    def tables(self) -> list[Any]:
        """The classes of tables that it may hold, alone, in a list, or by names."""
        held = [item_type(kind) or (get_args(kind)[1] if get_origin(kind) is dict else kind) for kind in alternatives(self.type)]
        return [kind for kind in held if dataclasses.is_dataclass(kind)]


def key(default: Any, meaning: str, **known: Any) -> Any:
    """A field of a frozen dataclass that is a key of scene files; `known` are the attributes of `Key`."""
    metadata = {"key": Key(meaning, **known)}
    if isinstance(default, (list, dict)):
        return dataclasses.field(default_factory=lambda: type(default)(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


@cache
def keys_of(kind: type) -> dict[str, Key]:
    """The keys of a table, by name: the key of its kind, required keys, then others, each with those that its family shares last.

    A key that a class declares anew with a default is not required any more.
    """
    hints = _types(kind)
    found: dict[str, Key] = {}
    for item in dataclasses.fields(kind):
        fields = (getattr(one, "__dataclass_fields__", {}).get(item.name) for one in kind.__mro__)
        known = next((field.metadata["key"] for field in fields if field is not None and "key" in field.metadata), None)
        if known is not None and item.name not in getattr(kind, "WITHOUT", {}):
            default = item.default if item.default_factory is dataclasses.MISSING else item.default_factory()
            found[item.name] = dataclasses.replace(known, type=hints[item.name], default=default,
                                                   required=known.required and "key" in item.metadata)
    general = keys_of(base) if (base := next(filter(dataclasses.is_dataclass, reversed(kind.__mro__)))) is not kind else {}
    own = getattr(kind, "KIND", "").replace("-", "_")
    return dict(sorted(found.items(), key=lambda pair: (pair[0] != own, not pair[1].required, pair[0] in general)))


def spelt(kind: Any, field: str) -> str:
    """The key of a field. The key that names the kind is written with hyphens."""
    own = getattr(kind, "KIND", "")
    return own if own.replace("-", "_") == field else field


_types = cache(get_type_hints)  # each call of get_type_hints evaluates all annotations of a class and of its bases


def alternatives(declared: Any) -> list[Any]:
    """The alternatives of a type: [str, list[float]] of `str | list[float] | None`."""
    parts = get_args(declared) if get_origin(declared) in (Union, UnionType) else [declared]
    return [part for part in parts if part is not NoneType]


def item_type(declared: Any) -> Any:
    """`int` of `list[int]`; None of a type that is no list."""
    return get_args(declared)[0] if get_origin(declared) is list else None


def type_words(declared: Any, many: bool = False) -> str:
    """'a string or a list of numbers'."""
    words = []
    for kind in alternatives(declared):
        inner = item_type(kind)
        if inner is not None:
            words.append(f"{'lists' if many else 'a list'} of {type_words(inner, True)}")
        elif dataclasses.is_dataclass(kind) or get_origin(kind) is dict:
            words.append("tables" if many else "a table")
        elif kind is Any:
            words.append("values" if many else "any value")
        else:
            words.append(WORDS[kind][many])
    return " or ".join(words)


def read_table(kind: Any, table: Mapping[str, Any], place: Place, faults: Faults, hertz: bool = True) -> Any:
    """An instance of a class of keys, from a table at a place of a file; None if it has faults, which are noted.

    `hertz`: whether "5 kHz" may stand for a frequency, since the unit of time is the second. The class's own checks come last.
    """
    before, values, fields = len(faults.found), dict[str, Any](), {spelt(kind, field): field for field in keys_of(kind)}
    for name, value in table.items():
        with faults.at((*place, name)):
            if why := getattr(kind, "WITHOUT", {}).get(name):
                raise InputError(f"there is no such key here: {why}")
            if name not in fields:
                raise unknown_name("key", name, fields)
            values[fields[name]] = _value(keys_of(kind)[fields[name]], value, kind, (*place, name), faults, hertz)
    for name, field in fields.items():
        one = keys_of(kind)[field]
        missing = one.required or (one.required_with and table.get(one.required_with) not in (None, "", []))
        if missing and table.get(name) in (None, "", []):
            faults.add(place, f"the key {name!r} is missing: {one.meaning}")
    if len(faults.found) > before:
        return None
    with faults.at(place):
        return kind(**values)
    return None


def _value(one: Key, value: Any, owner: Any, place: Place, faults: Faults, hertz: bool) -> Any:
    """A value, checked, and converted to the type of its key."""
    if value == [] and any(map(item_type, alternatives(one.type))):
        if place[-1] != getattr(owner, "KIND", None):
            raise InputError("it is an empty list. Leave the key out to take its default")
        wanted = f"one at least of {', '.join(one.choices(owner))}" if one.choices else one.meaning
        raise InputError(f"it is an empty list. Give {wanted}")
    if one.in_hertz:
        value = [in_radians(item, hertz) for item in value] if isinstance(value, list) else in_radians(value, hertz)
    for kind in alternatives(one.type):
        inner = item_type(kind)
        if dataclasses.is_dataclass(kind) and isinstance(value, Mapping):
            return read_table(kind, value, place, faults, hertz)
        if dataclasses.is_dataclass(inner):
            items = {(*place, at): item for at, item in enumerate(value)} if isinstance(value, list) else {(*place,): value}
            if all(isinstance(item, Mapping) for item in items.values()):
                return [read_table(inner, item, at, faults, hertz) for at, item in items.items()]
        if get_origin(kind) is dict and dataclasses.is_dataclass(get_args(kind)[1]) and isinstance(value, Mapping) and \
                all(isinstance(item, Mapping) for item in value.values()):
            return {name: read_table(get_args(kind)[1], item, (*place, name), faults, hertz) for name, item in value.items()}
    value = _typed(value, one.type)
    check_value(one, value, owner, str(place[-1]))
    return value


def in_radians(value: Any, known: bool) -> Any:
    """2π · 5000 for "5 kHz"; numbers as they are."""
    if not isinstance(value, str):
        return value
    if not (found := HERTZ.fullmatch(value)):
        raise InputError(f"{shown(value)} is no frequency. Give numbers in rad per unit of time, or, where that is s, "
                         "\"5000 Hz\" or \"5 kHz\"")
    if not known:
        raise InputError(f"{value!r} is given in hertz, which needs units whose time is s: give units, e.g. units = \"SI\", or "
                         "the frequency in rad per unit of time")
    return 2 * pi * float(found[1]) * (1000 if found[2] else 1)


def check_value(one: Key, value: Any, owner: Any, name: str) -> None:
    """Checks a value against the declaration of its key."""
    if one.length and (isinstance(value, list) and len(value) != one.length):
        raise InputError(f"it must be {one.form}, not {shown(value)}")
    if one.form in RANGES and isinstance(value, list):
        interval("it", value)
    if one.in_hertz and one.form in RANGES and value[1] > HIGHEST:
        raise InputError(f"it must end below {HIGHEST:.3g}, so that the cubes of its frequencies are finite, but is "
                         f"{shown(value)}")
    if one.distinct and (twice := [item for item in value if value.count(item) > 1]):
        raise InputError(f"{twice[0]!r} is listed {value.count(twice[0])} times")
    for place, item in enumerate(value if isinstance(value, list) else [value], 1):
        if one.type in (int, list[int]):
            whole_number("it", item, least=one.least, most=one.most)  # type: ignore[arg-type]
        elif isinstance(item, (int, float)) and not one.admits(item):
            words = {"above 0": "be positive", "at least 0": "not be negative"}.get(one.bounds, f"be {one.bounds}")
            where_in_list = f" in place {place}" if isinstance(value, list) and len(value) > 1 else ""
            raise InputError(f"it must {words}, but is {shown(item)}{where_in_list}")
        if one.choices is not None and isinstance(item, str):
            choice(name.removesuffix("s") if isinstance(value, list) else name, item, one.choices(owner))


def _fits(value: Any, kind: Any) -> bool:
    if kind is Any:
        return True
    if dataclasses.is_dataclass(kind) or get_origin(kind) is dict:
        return isinstance(value, Mapping)
    if (inner := item_type(kind)) is not None:
        return isinstance(value, list) and all(any(_fits(item, one) for one in alternatives(inner)) for item in value)
    return isinstance(value, (int, float) if kind is float else kind) and (kind is bool or not isinstance(value, bool))


def _typed(value: Any, declared: Any, name: str = "it") -> Any:
    """A value in the type of its key: a whole number may stand for a float, and a single value for a list of one."""
    for kind in alternatives(declared):
        inner = item_type(kind)
        if inner is not None:
            items = value if isinstance(value, list) else [value]
            if all(any(_fits(item, one) for one in alternatives(inner)) for item in items):
                return [_typed(item, inner, name) for item in items]
        elif get_origin(kind) is dict and isinstance(value, Mapping):
            return {key: _typed(one, get_args(kind)[1], repr(key)) for key, one in value.items()}
        elif _fits(value, kind):
            return finite_number(name, value) if kind is float else value
    raise InputError(f"{name} must be {type_words(declared)}, not {shown(value)}")
