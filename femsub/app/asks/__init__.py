"""What is asked of a scene. `Ask` is what all kinds share."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any, ClassVar

from femsub.app.kinds import Kind, key
from femsub.checks import InputError, unknown_name
from femsub.io import check_value, keys_of

if TYPE_CHECKING:
    from femsub.app.grammar import Scene
    from femsub.app.models import Models
    from femsub.app.result import Result

#: models of a scene: the full one, those reduced, all, or the largest of the last method
WHICH = ("full", "reduced", "all", "best")


@dataclass(frozen=True)
class Ask(Kind):
    """What all analyses have."""

    name: str = key("", "of its tables and figures", otherwise="that of its kind")
    band: list[float] = key([], "the frequencies that it looks at", unit="rad/time", least=0, form="[lo, hi]",
                            otherwise="that of the scene")
    vary: dict[str, list[Any]] = key({}, "values of other keys, each of which is done: {\"part.chain.belt\" = [1, 2, 3]}; of "
                                     "several keys all combinations", otherwise="none")
    note: str = key("", "a line of text at the foot of its figures", otherwise="nothing")

    FAMILY: ClassVar[str] = "ask"
    alone: ClassVar[bool] = False  #: whether a scene without a part may ask it
    NEEDS: ClassVar[tuple[str, ...]] = ()  #: of 'contact', 'belt', 'reduce', 'parts', 'place': what the scene must have
    PENCIL: ClassVar[bool] = False  #: whether it can be asked of a pencil of matrices
    NONLINEAR: ClassVar[bool] = False  #: whether contacts must have their law, not a slope alone

    @property
    def title(self) -> str:
        """The name of its tables and figures."""
        return self.name or self.KIND

    @property
    def varying(self) -> list[str]:
        """The names of the keys that have several values, for tables."""
        return [path.rpartition(".")[2] for path, values in self.vary.items() if len(values) > 1]

    def check(self, scene: Scene) -> None:
        """Refuses what cannot be, before anything is computed.

        Raises
        ------
        InputError
            What the scene lacks, or does not go with.
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
            try:
                one.check_nonlinear()
            except InputError as error:
                raise InputError(f"contact {name}: {error}") from None

    def parts_named(self) -> Iterable[str]:
        """Parts that it names, so that they need not be joined to others."""
        return ()

    def run(self, models: Models) -> Result:
        """What was found."""
        raise NotImplementedError

    def variants(self, models: Models) -> Iterator[tuple[dict[str, Any], Models]]:
        """The models with each combination of `vary`, by what a table shows of it."""
        paths = list(self.vary)
        for values in product(*self.vary.values()):
            if not paths:
                yield {}, models
                continue
            scene = models.scene.varied(dict(zip(paths, values, strict=True)))
            known = {path.rpartition(".")[2]: shown(value) for path, value in zip(paths, values, strict=True)}
            yield {name: known[name] for name in self.varying}, models.of(scene)


@dataclass(frozen=True)
class AskAt(Ask):
    """What analyses at values of parameters have."""

    at: dict[str, float] = key({}, "values of parameters: {mu = 0.4}", otherwise="as they are given")

    def check(self, scene: Scene) -> None:
        super().check(scene)
        for name in self.at:
            parameter_of(scene, name)


def shown(value: Any) -> Any:
    """A value of `vary` in a table."""
    return "{" + ", ".join(str(one) for one in value) + "}" if isinstance(value, list) else value  # `map` is a kind here


def check_place(scene: Scene, place: str) -> None:
    """Refuses a place 'part.port' that is not there."""
    name, _, port = place.partition(".")
    if name not in scene.parts:
        raise unknown_name("part", name, scene.parts)
    scene.parts[name].check_port(name, port)


def parameter_of(scene: Scene, name: str) -> None:
    """Refuses a parameter that nothing has.

    Raises
    ------
    InputError
        Neither contacts nor matrices have it, and no [parameter] says what it is.
    """
    given = scene.parameters.get(name)
    if given is not None and given.acts:
        return
    names = {one for contact in scene.contacts.values() for one in contact.parameters()}
    for part in scene.parts.values():
        names |= set(part.names)
    names |= {one for one, keys in scene.parameters.items() if keys.acts}
    if name not in names:
        raise unknown_name("parameter", name, names)


def range_of(scene: Scene, name: str, between: list[float]) -> tuple[float, float]:
    """The range of a parameter: that of the ask, or of [parameter.NAME].

    Raises
    ------
    InputError
        Neither has one; a contact cannot have these values.
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
    """Refuses factors of matrices that have no value somewhere in the range of a parameter.

    Raises
    ------
    InputError
        The factor, and the place; another parameter without a value; no factor changes.
    """
    values = {other: one.value for other, one in scene.parameters.items() if one.value is not None and other != name}
    later = {path.split(".")[1] for path in ask.vary if path.startswith("parameter.")}  # of which the variants have values
    for part in scene.parts.values():
        if hasattr(part, "check_over") and not later & set(part.names) - set(values):
            part.check_over(name, between, values)


def rowed(values: Mapping[str, Any], rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows with what varies in front."""
    return [{**values, **row} for row in rows]
