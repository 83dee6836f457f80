"""Asks: the analyses of a scene. `Ask` is the base class of all kinds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any, ClassVar

from femsub.app.kinds import Kind, key
from femsub.checks import InputError, naming, unknown_name
from femsub.io import check_value, keys_of

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Models
    from femsub.app.result import Result

#: choices of models: the full one, the reduced ones, all, or the largest one of the last method
WHICH = ("full", "reduced", "all", "best")


@dataclass(frozen=True)
class Ask(Kind):
    """The base class of analyses: keys that all kinds have."""

    name: str = key("", "name of its tables and figures", otherwise="the name of its kind")
    band: list[float] = key([], "the frequencies that it considers", unit="rad/time", least=0, form="[lo, hi]",
                            otherwise="that of the scene")
    vary: dict[str, list[Any]] = key({}, "values of other keys; the analysis runs for each: {\"part.chain.belt\" = [1, 2, 3]}; "
                                     "several keys: all combinations", otherwise="none")
    note: str = key("", "a line of text below the titles of its figures", otherwise="nothing")

    FAMILY: ClassVar[str] = "ask"
    alone: ClassVar[bool] = False  #: whether a scene without a part may ask it
    NEEDS: ClassVar[tuple[str, ...]] = ()  #: what the scene must have: some of 'contact', 'belt', 'reduce', 'parts'
    PENCIL: ClassVar[bool] = False  #: whether it accepts a pencil of matrices
    NONLINEAR: ClassVar[bool] = False  #: whether contacts must have a nonlinear law, not only a slope

    @property
    def title(self) -> str:
        """The name of its tables and figures."""
        return self.name or self.KIND

    @property
    def varying(self) -> list[str]:
        """The names of the varied keys that have several values, for tables."""
        return [path.rpartition(".")[2] for path, values in self.vary.items() if len(values) > 1]

    def check(self, scene: Scene) -> None:
        """Refuses an ask that its scene does not allow, before anything is computed.

        Raises
        ------
        InputError
            The scene lacks something that the ask needs, or has something that it cannot treat.
        """
        pencil = [name for name, part in scene.parts.items() if type(part).KIND == "affine"]
        if pencil and not self.PENCIL:
            raise InputError(f"{self.KIND} cannot be asked of {pencil[0]!r}, a pencil of matrices: it has neither places nor DOF "
                             "of a structure. Ask complex-modes, critical, flutter or map")
        belts = [one for one in scene.contacts.values() if type(one).KIND == "belt"]
        for need in self.NEEDS:
            there, what = {"contact": (scene.contacts, "a contact, such as [contact.rub] with belt = \"part.port\""),
                           "belt": (belts, "a belt, [contact.rub] with belt = \"part.port\""),
                           "reduce": (scene.reduce.methods, "reduced models, [reduce] with methods and modes"),
                           "parts": (len(scene.parts) > 1 or any(getattr(one, "cut", 0) for one in scene.parts.values()),
                                     "several parts")}[need]
            if not there:
                raise InputError(f"{self.KIND} needs {what}")
        for name, one in scene.contacts.items() if self.NONLINEAR else ():
            with naming(f"contact {name}"):
                one.check_nonlinear()

    def parts_named(self) -> Iterable[str]:
        """Parts that it names. They need not be joined to others."""
        return ()

    def run(self, models: Models) -> Result:
        """Runs the analysis, and returns its result."""
        raise NotImplementedError

    def variants(self, models: Models) -> Iterator[tuple[dict[str, Any], Models]]:
        """(values for tables, models) for each combination of the values in `vary`."""
        if not self.vary:
            yield {}, models
        for values in product(*self.vary.values()) if self.vary else ():
            changes = dict(zip(self.vary, values, strict=True))
            several = {path.rpartition(".")[2]: shown(value) for path, value in changes.items() if len(self.vary[path]) > 1}
            yield several, models.of(models.scene.varied(changes))


@dataclass(frozen=True)
class AskAt(Ask):
    """The base class of analyses at given values of parameters."""

    at: dict[str, float] = key({}, "values of parameters: {mu = 0.4}", otherwise="as they are given")

    def check(self, scene: Scene) -> None:
        super().check(scene)
        for name in self.at:
            parameter_of(scene, name)


def shown(value: Any) -> Any:
    """A value of `vary` as a table shows it."""
    return "{" + ", ".join(str(one) for one in value) + "}" if isinstance(value, list) else value  # `map` is a kind here


def check_place(scene: Scene, place: str) -> None:
    """Refuses a place 'part.port' that does not exist."""
    name, _, port = place.partition(".")
    if name not in scene.parts:
        raise unknown_name("part", name, scene.parts)
    scene.parts[name].check_port(name, port)


def parameter_of(scene: Scene, name: str) -> None:
    """Refuses an unknown parameter.

    Raises
    ------
    InputError
        Neither contacts nor factors of matrices have it, and no [parameter.NAME] says what it changes.
    """
    names = {one for contact in scene.contacts.values() for one in contact.parameters()}
    for part in scene.parts.values():
        names |= set(part.names)
    names |= {one for one, keys in scene.parameters.items() if keys.acts}
    if not names:
        raise InputError(f"there is no parameter {name!r}: give a contact that has it, such as [contact.rub] with belt = "
                         f"\"part.port\", or a table [parameter.{name}]")
    if name not in names:
        raise unknown_name("parameter", name, names)


def range_of(scene: Scene, name: str, between: list[float]) -> tuple[float, float]:
    """The range of a parameter, from the ask or else from [parameter.NAME].

    Raises
    ------
    InputError
        Neither gives a range, or a contact does not admit these values.
    """
    if between:
        check_bounds(scene, name, between)
        return between[0], between[1]
    given = scene.parameters.get(name)
    if given is None or given.range is None:
        raise InputError(f"between is missing: the range of {name!r}, here or in [parameter.{name}]")
    return given.range


def check_bounds(scene: Scene, name: str, values: Iterable[float]) -> None:
    """Refuses values of a parameter that the keys of contacts do not admit."""
    for contact in scene.contacts.values():
        if name in contact.parameters():
            check_value(keys_of(type(contact))[name], list(values), type(contact), name)  # type: ignore[arg-type]


def check_factors(scene: Scene, ask: Ask, name: str, between: tuple[float, float]) -> None:
    """Refuses factors of matrices that are undefined somewhere in the range of a parameter.

    Raises
    ------
    InputError
        A factor is undefined (the message says which, and where); another parameter has no value; no factor changes.
    """
    values = {other: one.value for other, one in scene.parameters.items() if one.value is not None and other != name}
    later = {path.split(".")[1] for path in ask.vary if path.startswith("parameter.")}  # parameters whose values vary gives
    for part in scene.parts.values():
        if hasattr(part, "check_over") and not later & set(part.names) - set(values):
            part.check_over(name, between, values)


def rowed(values: Mapping[str, Any], rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The rows, each with the varied values in front."""
    return [{**values, **row} for row in rows]
