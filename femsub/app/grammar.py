"""Scene files: models and asks. A scene is read, every key and name in it is checked, and it is run.

    units, band               the units of all numbers, and the frequencies that matter
    [material.NAME]           E, nu, rho
    [parameter.NAME]          a quantity that may change: its range, or its value
    [part.NAME]               one of the kinds in `femsub.app.parts`
    [[joint]]                 one of `femsub.app.joints`; or [joint.NAME]
    [contact.NAME]            one of `femsub.app.contacts`
    [reduce]                  methods and numbers of modes
    [[ask]]                   one of `femsub.app.asks`

`scene = "brake"` begins with a built-in scene. Keys of a table replace the same keys in that scene's table of the same name. Any
other value replaces the scene's value as a whole; a list of asks replaces all its asks.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from femsub.app.asks import Ask
from femsub.app.changes import ParameterKeys
from femsub.app.contacts import ContactKind
from femsub.app.ends import GROUND, End, LinkKind
from femsub.app.inputs import inputs_of
from femsub.app.joints import JointKind
from femsub.app.kinds import FAMILIES, Kinds, is_beside, key, kinds_file
from femsub.app.methods import ReduceKeys
from femsub.app.names import check_names
from femsub.app.parts import MaterialKeys, Part, PartSite
from femsub.checks import InputError, instance, mapping, path_of, unknown_name, warn, word
from femsub.io import Faults, keys_of, parsed_toml, read_table, spelt
from femsub.output import DENSEST, FASTEST, IN_SI, SYSTEMS, Units

if TYPE_CHECKING:
    from femsub import Facing, Mesh
    from femsub.app.models import Models
    from femsub.app.result import Progress, Result

BUILT_IN = files("femsub.app") / "scenes"
ENDING = ".toml"
LONGEST_NAME = 100
#: entries of results.json that do not belong to an ask
RESERVED = ("scene", "date", "versions", "machine", "inputs", "files", "model", "size", "interface", "contacts", "repairs",
            "failed", "complete", "tables", "charts", "verdict", "written", "sha256", "warnings")


@dataclass(frozen=True)
class UnitKeys:
    """Units by their names."""

    length: str = key("", "as 'mm'", required=True, example="mm")
    time: str = key("", "as 's'; with it Hz is shown beside rad/s", required=True, example="s")
    mass: str = key("", "as 't'", required=True, example="t")
    force: str = key("", "as 'N'", otherwise="'N' where it follows from the others, else in words")


@dataclass(frozen=True)
class Settings:
    """The keys above all tables."""

    name: str = key("", "for headings and file names", otherwise="the scene's name, or that of the file")
    units: str | UnitKeys = key("", "the units of all numbers: 'SI' (m, kg, s, N), 'mm-t-s' (mm, t, s, N), or {length = \"mm\", "
                                "mass = \"t\", time = \"s\"}; where the time is in s, Hz is shown beside rad/s; nothing is "
                                "converted",
                                choices=lambda _: SYSTEMS, otherwise="no unit is claimed", example="SI")
    band: list[float] = key([], "the frequencies that matter, in which models are compared", unit="rad/time", least=0,
                            form="[lo, hi]", otherwise="from 0 to 2 % above the `elastic` lowest elastic modes",
                            example=[0.0, 1e4])
    interface: list[str] = key([], "interface of the joined parts together: 'part.set', 'part' or 'part:0,4'",
                               otherwise="the parts' interfaces that are not joined", example=["disc.front"])
    elastic: int = key(8, "number of elastic modes in the default of band", least=1, most=1000)
    figures: bool = key(True, "whether figures are drawn, in the folder given by --out")
    page: bool = key(False, "whether the results are also one page to read, report.html in the folder given by --out")
    use: list[str] = key([], "Python files with kinds of your own", otherwise="none", example=["mine.py"], file=True)


def built_in() -> dict[str, str]:
    """The built-in scenes: name → first line of the scene's description."""
    order = (BUILT_IN / "order.txt").read_text(encoding="utf-8").split()
    return {name: text_of(name).partition("\n")[0].lstrip("# ").rstrip() for name in order}


def text_of(name: str) -> str:
    """The file of a built-in scene.

    Raises
    ------
    InputError
        No built-in scene has this name.
    """
    path = BUILT_IN / f"{name}{ENDING}"
    if re.search(r"[/\\]", name) or not path.is_file():
        raise unknown_name("scene", name, (one.name.removesuffix(ENDING) for one in BUILT_IN.iterdir()
                                           if one.name.endswith(ENDING)))
    return path.read_text(encoding="utf-8")


def file_word(name: Any) -> str:
    """A name that may be part of a file's name; '' is valid too."""
    if len(word("it", name)) > LONGEST_NAME or set(name) & set("/\\"):
        raise InputError(f"it cannot be part of a file's name. Take at most {LONGEST_NAME} characters without / and \\")
    return str(name)


def merged(below: Mapping[str, Any], table: Mapping[str, Any], kinds: Kinds) -> dict[str, Any]:
    """The scene `below`, with its keys replaced by those of `table`."""
    found = dict(below)
    for name, value in table.items():
        old = below.get(name)
        if name in (*FAMILIES, "material", "parameter") and isinstance(value, Mapping) and isinstance(old, Mapping):
            found[name] = dict(old) | {one: _over(old.get(one), own, kinds.names(name) if name in FAMILIES else [])
                                       for one, own in value.items()}
        else:
            found[name] = _over(old, value, [])
    # new matrices have their own parameters: a parameter of the scene stays if the table gives it, or if something names it
    words = set(re.findall(r"\w+", repr({name: value for name, value in found.items() if name != "parameter"})))
    if isinstance(several := found.get("parameter"), Mapping) and isinstance(own := table.get("parameter", {}), Mapping):
        found["parameter"] = {name: value for name, value in several.items() if name in own or name in words}
    return found


def _over(old: Any, new: Any, names: Sequence[str]) -> Any:
    """The old table with the keys of the new one; only the new value if it is of another kind, or if one of them is no table."""
    if not (isinstance(old, Mapping) and isinstance(new, Mapping)):
        return new
    another = {key for key in new if key in names} - set(old)
    return dict(new) if another else {**old, **new}


class SceneSource(NamedTuple):
    """The source of a scene: name and text of its file, and which Python files that it names may be run.

    These are all files if `allowed`, else those beside the scene file and those of `trusted`. A `variant` shares the `store` of
    the scene from which it is made, whose asks have been checked.
    """

    name: str = ""
    text: str = ""
    trusted: tuple[str, ...] = ()
    allowed: bool = True
    variant: bool = False
    store: Any = None


class Scene:
    """A scene: its models and its asks, as in a file. `Scene.from_file(path)` reads a scene file.

    Attributes
    ----------
    parts, joints, contacts, materials, parameters : dict
        The tables of the model, by name.
    reduce : ReduceKeys
        Methods and numbers of modes of the reduced models.
    asks : list
        The analyses.
    models : Models
        The full and the reduced models, each built at its first use.

    Raises
    ------
    InputError
        The scene has faults. The message lists them all, with lines of the file.

    Examples
    --------
    >>> scene = fs.Scene.from_file("chain")
    >>> scene.models.full
    Substructure 'chain': 10 DOF, sparse, 28 nonzeros in K, 1 interface DOF, ports belt
    """

    def __init__(self, table: Mapping[str, Any], folder: str | Path = ".", source: SceneSource | None = None) -> None:
        table = mapping("table", table, "the tables of a scene file")
        source = SceneSource() if source is None else instance("source", source, SceneSource, "which a file's scene has")
        self.folder, self.source, self.variant = path_of("folder", folder), source, source.variant
        self.store: dict[Any, Any] = source.store if source.variant else {}
        self.texts: list[Path] = self.store.setdefault("texts", [])  # files of meshes, and the files that they include
        faults = Faults("" if source.variant else source.name, source.text)
        with faults.at(("use",)):
            used = table.get("use", [])
            self.kinds = Kinds([self.module(name) for name in (used if isinstance(used, list) else [used])])
        faults.check()
        known_as = Path(source.name).stem if source.name else ""
        if (name := table.get("scene")) is not None:
            with faults.at(("scene",)):
                known_as = word("it", name)
                below = parsed_toml(text_of(known_as), name)
                table = merged(below, {key: value for key, value in table.items() if key != "scene"}, self.kinds)
            faults.check()
        self.table = dict(table)
        self._read(faults, known_as or "scene")
        check_names(self, faults)
        faults.check()
        self.faults = faults

    @classmethod
    def from_file(cls, source: str | Path, trusted: Sequence[str] = ()) -> Self:
        """A built-in scene by its name, or a scene from a TOML file or from the results.json of a run.

        A Python file that the scene names in `use` is run only if it lies beside the scene's file, or is one of `trusted`.
        """
        name, path = str(source), Path(source)
        if not path.is_file():
            if path.suffix == ENDING or "/" in name:
                raise InputError(f"there is no scene file {name}")
            text_of(name)
            return cls({"scene": name})
        if path.suffix == ".json":
            table, folder = inputs_of(path)
            return cls(table, folder, SceneSource(name, "", tuple(trusted), False))
        try:
            text = path.read_text(encoding="utf-8-sig")  # editors of Windows begin a file with a mark
        except (OSError, ValueError) as error:
            raise InputError(f"{name} cannot be read: {getattr(error, 'strerror', None) or error}") from None
        table = parsed_toml(text, name)
        if not table:
            raise InputError(f"{name} is empty, or has comments only. Begin it with a part, or with scene = \"chain\" or another "
                             "name of `femsub scenes`")
        return cls(table, path.parent, SceneSource(name, text, tuple(trusted), False))

    def _read(self, faults: Faults, known_as: str) -> None:
        """Converts all tables into objects of their classes. A table that cannot be converted is a fault, and is left out."""
        table = self.table
        families: dict[str, type[Any]] = {"material": MaterialKeys, "parameter": ParameterKeys}
        above = {name: value for name, value in table.items() if name not in (*FAMILIES, *families, "reduce")}
        for name in (one for one in above if one not in keys_of(Settings)):
            faults.add((name,), unknown_name("table" if isinstance(above[name], Mapping) else "key", name,
                                             ["scene", *keys_of(Settings), "reduce", *families, *FAMILIES]))
        above = {name: value for name, value in above.items() if name in keys_of(Settings)}
        settings = read_table(Settings, above, (), faults) or Settings()
        self.units = Units.of(vars(settings.units) if isinstance(settings.units, UnitKeys) else settings.units)
        hertz = self.units.known
        if not hertz:  # a second time, now that the unit of time is known to be missing: a frequency in hertz is a fault
            read_table(Settings, above, (), faults, False)
        self.settings, self.figures, self.paged = settings, settings.figures, settings.page
        with faults.at(("name",)):
            self.name = file_word(settings.name) or known_as
        found: dict[str, dict[str, Any]] = {}
        for family in (*families, *FAMILIES):
            found[family] = {}
            for name, place, one in self._tables(family, faults):
                with faults.at(place):
                    kind = families.get(family) or self.kinds.of(family, one)
                    if (item := read_table(kind, one, place, faults, hertz)) is not None:
                        found[family][name] = item
        self.materials: dict[str, MaterialKeys] = found["material"]
        for name, solid in self.materials.items() if self.units.system and not self.variant else ():
            metre, kilogram = IN_SI[self.units.system]
            density, speed = solid.rho * kilogram / metre**3, (solid.E / solid.rho) ** 0.5 * metre
            if density > DENSEST or speed > FASTEST:
                warn(f"material.{name}: in {self.units.system} units its density is {density:.2g} kg/m³, and √(E/ρ), the speed "
                     f"of waves, {speed:.2g} m/s. No solid is like that: E or rho are in other units")
        self.parameters: dict[str, ParameterKeys] = found["parameter"]
        self.parts: dict[str, Part] = found["part"]
        self.joints: dict[str, JointKind] = found["joint"]
        self.contacts: dict[str, ContactKind] = found["contact"]
        self.asks: list[Ask] = list(found["ask"].values())
        for name, ask in found["ask"].items():
            with faults.at((*self.place("ask", name), "name")):
                if file_word(ask.name) in RESERVED:
                    raise InputError(f"{ask.name!r} is the name of another entry of results.json")
            with faults.at((*self.place("ask", name), "note")):
                word("it", ask.note)
        self.reduce = ReduceKeys([])
        if isinstance(given := table.get("reduce"), Mapping):
            self.reduce = read_table(ReduceKeys, given, ("reduce",), faults, hertz) or self.reduce
        elif given is not None:
            faults.add(("reduce",), "it must be a table, [reduce]")
        for name in self.reduce.parts_named():
            if name not in (every := table.get("part", {})):  # parts with faults, which are not in self.parts, included
                faults.add(("reduce", "methods"), unknown_name("part", name, every))
        for name, part in self.parts.items():
            if part.KIND != "affine" or not self.reduce.methods:
                continue
            if self.reduce.methods != ["box"]:
                faults.add(("reduce",), f"{name!r} is a pencil of matrices: its only method is methods = [\"box\"]")
            elif not self.settings.band:
                faults.add(("reduce",), f"a box of {name!r}, a pencil of matrices, needs a band: give band, e.g. band = [0, 2e4]")

    def _tables(self, family: str, faults: Faults) -> Iterator[tuple[str, tuple[Any, ...], Mapping[str, Any]]]:
        """The tables of a family with their names and places: [family.NAME], or [[family]] in their order."""
        several = self.table.get(family, {})
        listed = isinstance(several, list)
        if not (isinstance(several, Mapping) or (listed and family in ("joint", "ask", "contact"))):
            faults.add((family,), f"it must be tables, [{family}.NAME]")
            return
        for name, one in enumerate(several) if listed else several.items():
            if not isinstance(one, Mapping):
                faults.add((family, name), f"it must be a table, [{family}.NAME]" + f" or [[{family}]]" * (family
                                                                                                           in ("joint", "ask")))
            elif (family == "part" and not re.fullmatch(r"[^.:\s]+", str(name))) or name == GROUND:
                faults.add((family, name), "a part's name is a word without a dot or colon, other than 'ground'")
            else:
                yield str(name + 1 if listed else name), (family, name), one

    def place(self, family: str, name: str) -> tuple[Any, ...]:
        """The place of a table in the file, from its name."""
        return (family, int(name) - 1 if isinstance(self.table.get(family), list) else name)

    def module(self, name: Any) -> ModuleType:
        """Runs a Python file of the user, and returns its module. It must lie beside the scene file, or be `trusted`."""
        path = self.folder / word("it", name)
        if not self.source.allowed and not is_beside(path, self.folder, self.source.trusted):
            raise InputError(f"the Python file {path} is not beside the scene file, and would be executed. Read it first, then "
                             f"allow it: femsub run {self.source.name} --trust {path}")
        if ("module", path) not in self.store:  # variants have the same kinds
            self.store["module", path] = kinds_file(path)
        found: ModuleType = self.store["module", path]
        return found

    # meshes, and the interfaces and ports of parts that joints and contacts need

    @cached_property
    def meshes(self) -> dict[str, Mesh]:
        """The meshes of all parts that have one, with sets of the nodes that lie opposite the surface of a joint or contact."""
        found: dict[str, Mesh] = {}
        for name in self.parts:
            with self.faults.at(("part", name)):
                if (mesh := self.mesh(name)) is not None:
                    found[name] = mesh
        self.faults.check()
        for family, links in (("joint", self.joints), ("contact", self.contacts)):
            for name, link in links.items():
                if link.facing:
                    with self.faults.at(self.place(family, name)):
                        under = self.facing(link)
                        part, key = under.second
                        found[part] = found[part].with_sets(**{key: under.nodes})
        self.faults.check()
        return found

    def facing(self, link: LinkKind) -> Facing:
        """The faces of the second surface of a joint or contact that lie opposite the first."""
        from femsub import facing  # late, since it imports NumPy: the error for a wrong file should not wait for that

        first, second = map(End.of, link.surfaces)
        owners = [end.part for end in (first, second) if end.part in self.parts]
        at = ("facing", first, second, link.tol, str(self.folder), *(repr(self.parts[name]) for name in owners))
        if at not in self.store:
            meshes = {name: mesh for name in owners if (mesh := self.mesh(name)) is not None}
            self.store[at] = facing((first.part, first.rest), (second.part, second.rest), meshes, link.tol)
        found: Facing = self.store[at]
        return found

    def mesh(self, name: str) -> Mesh | None:
        """A part's mesh, read or made once."""
        part = self.parts[name]
        place = ("mesh", name, repr(part), str(self.folder))
        if place not in self.store:
            from femsub.io import texts_read

            with texts_read() as texts:  # a mesh does not depend on joints: no interface and ports are needed
                self.store[place] = part.mesh(PartSite(name, self.folder, self.materials, [], {}))
            self.texts += texts
        found: Mesh | None = self.store[place]
        return found

    def site(self, name: str) -> PartSite:
        """The data from which a part is built, with the interface and the ports that joints and contacts need."""
        interface: list[Any] = []
        ports: dict[str, Any] = {}
        for joint in (*self.joints.values(), *self.contacts.values()):
            ports |= (own := joint.ports().get(name, {}))
            for at, words in enumerate(joint.surfaces if not own else ()):
                end = End.of(words)
                if end.part == name:
                    facing = at == 1 and joint.facing
                    interface += [self.facing(joint).second[1]] if facing else self.parts[name].needed(end)
        return PartSite(name, self.folder, self.materials, list(dict.fromkeys(interface)), ports)

    # models and runs

    @cached_property
    def models(self) -> Models:
        """The models of the scene."""
        from femsub.app.models import Models

        return Models(self)

    def varied(self, changes: Mapping[str, Any]) -> Scene:
        """A variant of the scene with changed values: path of a key, such as 'part.chain.belt' → value."""
        table = deepcopy(self.table)
        for path, value in changes.items():
            *above, last = path.split(".")
            here = table
            for at, one in enumerate(above):
                if isinstance(here, list):
                    if not (one.isdecimal() and 1 <= int(one) <= len(here)):
                        raise unknown_name(".".join(above[:at]), one, map(str, range(1, len(here) + 1)))
                    here = here[int(one) - 1]
                elif at == 1 and above[0] in FAMILIES and one not in here:
                    raise unknown_name(above[0], one, here)
                else:
                    here = here.setdefault(one, {})
            if not isinstance(here, dict):
                raise InputError(f"{path!r} is no key: {'.'.join(above)} is no table")
            here[last] = value
        made = Scene(table | {"name": self.name}, self.folder, self.source._replace(text="", store=self.store,
                                                                                          variant=True))
        made.figures = self.figures
        return made

    def run(self, progress: Progress) -> Result:
        """Runs all asks, in the order of the file."""
        from femsub.app.run import run_all

        return run_all(self, progress)

    def without_figures(self) -> Self:
        """Switches figures off, and returns the same scene."""
        self.figures = self.table["figures"] = False
        return self

    def __repr__(self) -> str:
        kinds = ", ".join(f"{name} ({type(part).KIND})" for name, part in self.parts.items())
        return f"Scene {self.name!r}: {kinds}; asks {', '.join(ask.title for ask in self.asks)}"

    def file_places(self, table: Mapping[str, Any]) -> Iterator[tuple[Any, Any]]:
        """The places of values in a scene's table that name files, as (table, key) or (list, index)."""
        def within(kind: Any, table: Any) -> Iterator[tuple[Any, Any]]:
            for name, one in keys_of(kind).items():
                at = spelt(kind, name)
                value = table.get(at)
                if one.file and isinstance(value, str) and value:
                    yield table, at
                elif one.file and isinstance(value, list):
                    yield from ((value, i) for i, item in enumerate(value) if isinstance(item, str))
                items = value if isinstance(value, list) else [value]
                for table_kind, item in product(one.tables, items):
                    if isinstance(item, dict):
                        yield from within(table_kind, item)

        yield from within(Settings, table)
        for family in FAMILIES:
            several = table.get(family, {})
            for one in several if isinstance(several, list) else several.values():
                yield from within(self.kinds.of(family, one), one)
