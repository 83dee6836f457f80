"""The keys of a scene's reduction: methods, numbers of modes, and the steps of each reduced model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from femsub import reduction
from femsub.app.kinds import key
from femsub.checks import InputError, unknown_name

WHOLE = ("contact-modes", "real-modes", "box")  # methods that reduce the joined model
FULL = "full"  # a part that is not reduced
DEFAULT = ("craig-bampton", "craig-chang")


def checked(entry: Any) -> Any:
    """An entry of `methods`, with each method's name replaced by its key in femsub.

    Raises
    ------
    InputError
        A method is unknown; the entry is an empty table or list, or is of another type.
    """
    if isinstance(entry, str):
        name = reduction.method_key(entry)
        if name not in (*reduction.METHODS, *WHOLE, FULL):
            raise unknown_name("method", entry, (*reduction.METHODS, *WHOLE, FULL))
        return name
    if isinstance(entry, Mapping) and entry:
        return {part: checked(one) if not isinstance(one, Mapping) else {**one, "method": checked(one.get("method", ""))}
                for part, one in entry.items()}
    if isinstance(entry, list) and entry:
        return [checked(one) for one in entry]
    raise InputError(f"methods has {entry!r}: give the name of a method, a table of parts and methods, or a list of steps")


@dataclass(frozen=True)
class ReduceKeys:
    """Reduced models: each method with each number of modes."""

    methods: list[Any] = key(list(DEFAULT), "the methods: a name; {disc = \"rubin\", pad = \"guyan\"}, part by part; or steps, "
                             "[\"rubin\", \"contact-modes\"]. Of the joined model: contact-modes, real-modes, box")
    modes: list[int] = key([10, 20], "numbers of modes to compare, for each method; with joined parts, modes per part", least=0)
    sizes: list[int] = key([], "numbers of DOF, in place of modes, for a scene with one part", least=1, otherwise="modes is used")
    ports: bool = key(True, "whether the static response to ports joins each basis")
    tolerance: float = key(1e-3, "relative error that the recommended model may have", above=0)
    repeats: int = key(5, "runs per measured time", least=1, most=1000)
    workers: int = key(0, "processes that reduce parts side by side", least=0, otherwise="none but this one")

    def __post_init__(self) -> None:
        object.__setattr__(self, "methods", [checked(one) for one in self.methods])

    @property
    def labels(self) -> str:
        """The methods' names in texts: 'Craig-Bampton and Craig-Chang'."""
        def label(one: Any) -> str:
            if isinstance(one, list):
                return ", then ".join(map(label, one))
            if isinstance(one, Mapping):
                return "one for each part"
            return reduction.METHODS[one].label if one in reduction.METHODS else str(one)

        return " and ".join(map(label, self.methods))

    def parts_named(self) -> Iterable[str]:
        """The parts that are named by tables of methods."""
        for entry in self.methods:
            for one in entry if isinstance(entry, list) else [entry]:
                if isinstance(one, Mapping):
                    yield from one
