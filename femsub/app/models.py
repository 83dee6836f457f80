"""The models of a scene, full and reduced, and their modes. Each is computed at its first use, and only once."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

import femsub as fs
from femsub.app.ends import GROUND, End, LinkKind
from femsub.app.methods import FULL
from femsub.checks import Array, InputError, PortWarning
from femsub.model import MOTIONS, contacts_at, family_of
from femsub.reduction import in_words, key_of, reduced_by
from femsub.stability import pencil_over, with_value

if TYPE_CHECKING:
    from femsub.app.grammar import Scene



@dataclass(frozen=True, eq=False)
class Known:
    """A model with its `kind` ('full', or the key of its method), its number of modes, and the models `before` each step."""

    kind: str
    modes: int
    model: Any
    before: Sequence[Any] = ()
    steps: tuple[Any, ...] = ()

    @property
    def head(self) -> dict[str, Any]:
        """The first columns of the model's rows in tables."""
        return {"model": self.kind, "modes": self.modes, "size": self.model.size}

    def expand(self, q: Array) -> Array:
        """Motions (n, k) of the full model from motions (r, k) of this model."""
        after = [*self.before[1:], self.model] if self.before else []
        for above, here in zip(reversed(self.before), reversed(after), strict=True):
            q = above.collected(here.expand(q)) if isinstance(here, fs.System) else here.expand(q)
        return q


@dataclass(eq=False)
class Models:
    """The models, contacts, bands and modes of a scene. `say` reports progress; all variants of a scene share its `store`."""

    scene: Scene
    say: Callable[[str], None] = field(default=lambda text: None)

    def of(self, scene: Scene) -> Models:
        """The models of a variant of the scene."""
        return Models(scene, self.say)

    def kept(self, key: Any, make: Callable[[], Any]) -> Any:
        """The object that the store has under a key; at the first call `make` creates it."""
        store = self.scene.store
        if key not in store:
            store[key] = make()
        return store[key]

    @cached_property
    def _key(self) -> str:
        """All inputs on which the full model depends, as one text."""
        scene = self.scene
        surfaces = [(name, one.surfaces, one.facing) for name, one in scene.contacts.items()]
        return repr((scene.parts, scene.joints, scene.materials, surfaces, str(scene.folder)))

    # the full model

    @cached_property
    def _built(self) -> tuple[Any, dict[str, fs.Mesh], dict[str, list[str]], float]:
        """The full model; name of a part in it → mesh; part of the scene → names of its pieces; seconds that this took."""
        return self.kept(("full", self._key), self._build)

    def _build(self) -> tuple[Any, dict[str, fs.Mesh], dict[str, list[str]], float]:
        scene, parts, meshes, joints = self.scene, dict[str, Any](), dict[str, fs.Mesh](), list[Any]()
        pieces: dict[str, list[str]] = {}
        self.say("building the parts")
        start, found = time.perf_counter(), scene.meshes
        for name, part in scene.parts.items():
            with scene.faults.at(("part", name)):
                made = part.made(scene.site(name), found.get(name))
                parts |= made.parts
                meshes |= made.meshes
                joints += made.joints
                pieces[name] = list(made.parts)
        scene.faults.check()
        seconds = time.perf_counter() - start
        rubbing = [one for one in scene.contacts.values() if one.surfaces]
        if len(parts) == 1 and not joints and not scene.joints and not rubbing:
            return next(iter(parts.values())), meshes, pieces, seconds
        for name, joint in scene.joints.items():
            with scene.faults.at(scene.place("joint", name)):
                ends = [self._end(end, at, joint, parts) for at, end in enumerate(joint.surfaces)]
                joints += joint.made(ends, meshes)
        surfaces = []
        for name, contact in scene.contacts.items():
            if contact.surfaces:
                with scene.faults.at(scene.place("contact", name)):
                    surfaces.append(self._contact(contact, meshes))
        scene.faults.check()
        with scene.faults.at(("interface",)):
            open_ends = [self._end(end, 0, LinkKind(), parts) for end in scene.settings.interface]
            system = fs.couple(parts, [*joints, *surfaces], scene.name, interface=open_ends or None)
            return system, meshes, pieces, time.perf_counter() - start
        scene.faults.check()
        raise AssertionError

    def _end(self, words: str, at: int, joint: LinkKind, parts: Mapping[str, Any]) -> Any:
        """An end as `couple` takes it: 'ground', (part, set) or (part, list of DOF)."""
        if words == GROUND:
            return GROUND
        end = End.of(words)
        if (part := parts.get(end.part)) is None:
            raise InputError(f"{end.part!r} is cut into pieces, which are joined only to each other")
        if end.mark == ":":
            return end.part, end.dofs
        if end.mark and at == 1 and joint.facing:
            return self.scene.facing(joint).second
        if end.mark:
            return end.part, end.rest if end.rest in part.ports else self.scene.parts[end.part].set_of(end.rest)
        if not len(part.interface):
            raise InputError(f"{end.part!r} has no interface: give it one, or name here where it is joined")
        whole = [one for one, rows in part.sets.items() if len(rows) == len(part.interface_numbers)]
        return end.part, whole[0] if whole else part.interface.tolist()  # `couple` pairs sets by position, lists by order

    @property
    def full(self) -> Any:
        """The full model: a substructure, a system of several, or a pencil with parameters."""
        return self._built[0]

    @property
    def meshes(self) -> dict[str, fs.Mesh]:
        """The meshes by the names of the model's parts."""
        return self._built[1]

    @property
    def assembly(self) -> float:
        """Seconds for building the full model."""
        return self._built[3]

    @property
    def alone(self) -> bool:
        """Whether the model is one part that is joined to nothing."""
        return not isinstance(self.full, fs.System)

    @property
    def pencil(self) -> bool:
        """Whether the model is a pencil of matrices with parameters."""
        return isinstance(self.full, fs.Affine)

    def port(self, place: str) -> str:
        """The name that 'part.port' has in the model."""
        name, _, port = place.partition(".")
        if self.alone:
            return port
        pieces = self._built[2][name]
        return next((f"{piece}.{port}" for piece in pieces if port in self.full.parts[piece].ports), place)

    def at_end(self, end: str) -> str:
        """The name that an end 'part.set' has in the model."""
        return end.partition(".")[2] if self.alone else end

    # contacts

    def _contact(self, contact: Any, meshes: Mapping[str, fs.Mesh]) -> Any:
        surfaces = list(contact.surfaces)
        if contact.facing:
            surfaces[1] = ".".join(self.scene.facing(contact).second)
        return contact.made(self.port, meshes, surfaces)

    @cached_property
    def contacts(self) -> list[Any]:
        """All contacts, with the values that [parameter.NAME] gives."""
        found = []
        for name, one in self.scene.contacts.items():
            with self.scene.faults.at(self.scene.place("contact", name)):
                found.append(self._contact(one, self.meshes))
        self.scene.faults.check()
        for name, given in self.scene.parameters.items():  # a value in [parameter.NAME] holds for all contacts that have it
            if given.value is not None and not given.acts and any(hasattr(contact, name) for contact in found):
                found = list(contacts_at(found, name, given.value))
        return found

    @property
    def linear(self) -> list[Any]:
        """The contacts for linear analyses: belts have only their slope, no friction law."""
        return [fs.Belt(port=one.port, force=one.force, slope=one.slope) if isinstance(one, fs.Belt) else one for one
                in self.contacts]

    def at(self, values: Mapping[str, float]) -> list[Any]:
        """The contacts for linear analyses at values of parameters."""
        found = self.contacts if set(values) & {"speed", "eps"} else self.linear
        for name, value in values.items():
            found = with_value(found, name, value)
        return found

    @property
    def places(self) -> list[str]:
        """The ports at which contacts act, or, without contacts, all ports."""
        return [name for one in self.contacts for name in one.ports] or list(self.full.ports)

    # frequencies

    @cached_property
    def normal(self) -> fs.NormalModes:
        """The lowest normal modes of the full model: the rigid-body modes, and the elastic modes of the default band."""
        def modes() -> fs.NormalModes:
            self.say("normal modes")
            return self.lowest(self.scene.settings.elastic)

        return self.kept(("normal", self._key, self.scene.settings.elastic), modes)

    def lowest(self, count: int) -> fs.NormalModes:
        """The rigid-body modes of the full model, and six more than `count` elastic modes, as far as it has them."""
        with warnings.catch_warnings():  # not of a small model that lacks some of the six
            warnings.filterwarnings("ignore", "count=", fs.FemsubWarning)
            return fs.normal_modes(self.full, count=min(count + len(MOTIONS), self.full.size))

    @cached_property
    def given_band(self) -> tuple[float, float] | None:
        """The band of the scene, if it has one."""
        band = self.scene.settings.band
        return (band[0], band[1]) if band else None

    @cached_property
    def band(self) -> tuple[float, float]:
        """The band of the scene; if it gives none, from 0 to just above its lowest elastic modes."""
        return self.given_band or self.normal.elastic_band(self.scene.settings.elastic)

    def band_of(self, given: Sequence[float]) -> Any:
        """The band (lo, hi) of an ask if it gives one, else the band of the scene. None for a pencil if neither gives one."""
        return (given[0], given[1]) if given else self.given_band if self.pencil else self.band

    def band_below(self, known: Known, given: Sequence[float] = ()) -> tuple[float, float] | None:
        """`band_of`, up to the model's cut-off.

        Raises
        ------
        InputError
            The cut-off lies below the band.
        """
        if (band := self.band_of(given)) is None:
            return None
        (lo, hi), cutoff = band, float(getattr(known.model, "cutoff", np.inf))
        if cutoff <= lo:
            raise InputError(f"the cut-off of the model of {known.model.size} DOF, {cutoff:.6g} rad/time, lies below the band. "
                             "Keep more modes")
        return lo, min(hi, cutoff)

    # reduced models

    def reductions(self) -> list[tuple[str, int, tuple[Any, ...]]]:
        """(key, number of modes, steps) of each reduced model: every method with every number of modes."""
        keys, found = self.scene.reduce, dict[str, tuple[str, int, tuple[Any, ...]]]()
        for entry in keys.methods:
            for row, count in enumerate(keys.sizes or keys.modes):
                steps = tuple(self._step(one, row, count, bool(keys.sizes)) for one in (entry if isinstance(entry, list)
                                                                                        else [entry]))
                steps = tuple(one for one in steps if one is not None)
                if steps:
                    key = "box" if isinstance(steps[-1], fs.ParameterBox) else key_of(steps)
                    found.setdefault(repr(steps), (key, count, steps))
        if keys.sizes and keys.methods and not found:
            raise InputError(f"sizes: no model of {max(keys.sizes)} DOF has room for the interface of {len(self.full.interface)}")
        return list(found.values())

    def _step(self, entry: Any, row: int, count: int, sized: bool) -> Any:
        """One step: a method, or a mapping of parts to methods, with `count` modes (DOF if `sized`), or as many as fit."""
        full = self.full
        if entry == FULL:
            return None
        if entry in ("contact-modes", "real-modes"):
            return fs.ContactModes(min(count, full.size - 1), contacts=self.linear, friction=entry == "contact-modes")
        if entry == "box":
            ranges = {name: one.range for name, one in self.scene.parameters.items() if one.range}
            return fs.ParameterBox(ranges, band=self.band, tol=self.scene.reduce.tolerance)
        if isinstance(entry, str) and self.alone:
            if sized:
                return fs.reduction.of_size(entry, full, count)
            if count > full.size:
                raise InputError(f"modes: {count} are more than the {full.size} DOF of {full.name!r}")
            return fs.reduction.METHODS[entry](count)
        if self.alone:
            raise InputError("a method for each part needs several parts; give its name alone")
        mapping: dict[str, Any] = {}
        for part, sub in full.parts.items():
            own = entry if isinstance(entry, str) else entry.get(part, FULL)
            modes = count
            if isinstance(own, Mapping):
                given = own.get("modes", [])
                modes = given[min(row, len(given) - 1)] if given else count
                own = own["method"]
            if own != FULL:
                mapping[part] = fs.reduction.with_room(own, sub, modes)
        return mapping

    def reduced_model(self, key: str, count: int, steps: tuple[Any, ...]) -> Known:
        """The reduced model after all steps."""
        def reduce() -> Known:
            self.say("a box of parameters" if isinstance(steps[-1], fs.ParameterBox) else in_words(steps))
            before, model = list[Any](), self.full
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", PortWarning)  # the tables show the port error
                for step in steps:
                    before.append(model)
                    if isinstance(step, fs.ContactModes):  # of a model that is already reduced: fewer than its coordinates
                        step = replace(step, modes=min(step.modes or 0, model.size - 1))
                    if isinstance(step, fs.ParameterBox):
                        family, contacts = self.over(self.exact, list(step.ranges))
                        model = fs.reduce(family, step, contacts=contacts)
                        continue
                    model = reduced_by(model, [step], self.linear, self.scene.reduce.ports, self.scene.reduce.workers or None)
            kept = getattr(model, "modes", count) if key in fs.reduction.METHODS else count
            return Known(key, kept, model, before, steps)

        return self.kept(self.place_of(steps), reduce)

    def place_of(self, steps: Sequence[Any]) -> tuple[Any, ...]:
        """The key of a reduced model in the store."""
        contacts = repr(self.linear) if any(isinstance(one, fs.ContactModes) for one in steps) else ""
        return "reduced", self._key, repr(steps), self.scene.reduce.ports, contacts

    @cached_property
    def reduced(self) -> list[Known]:
        """The reduced models."""
        return [self.reduced_model(*one) for one in self.reductions()]

    @cached_property
    def exact(self) -> Known:
        """The full model."""
        return Known(FULL, 0, self.full)

    @property
    def every(self) -> Iterator[Known]:
        """The full model, then the reduced models."""
        yield self.exact
        yield from self.reduced

    def chosen(self, which: str) -> list[Known]:
        """The models that 'full', 'reduced', 'all' or 'best' names; the full model if the scene has no reduced ones."""
        if which == FULL or not self.scene.reduce.methods:
            return [self.exact]
        if which == "best":
            return [self.best]
        return [*([self.exact] if which == "all" else []), *self.reduced]

    @cached_property
    def best(self) -> Known:
        """The largest model by contact modes alone, if there is one, else the largest model of the last method."""
        if not self.scene.reduce.methods:
            return self.exact
        steps = self.reductions()
        whole = [one for one in steps if len(one[2]) == 1 and one[0] == "contact-modes"]
        found = [self.reduced_model(*one) for one in whole or [one for one in steps if one[0] == steps[-1][0]]]
        return max(reversed(found), key=lambda one: one.model.size)

    # modes and families

    def spectrum(self, known: Known, values: Mapping[str, float] | None = None, band: tuple[float, float] | None = None,
                 evidence: bool | None = None) -> fs.ComplexModes:
        """Complex modes at values of parameters, in a band or all of them; with `evidence` False they need not be counted."""
        given = dict(values or {})

        def modes() -> fs.ComplexModes:
            if self.pencil:
                model = known.model
                return fs.complex_modes(model.at(**self.values(model.parameters, given)), band=band)
            if isinstance(known.model, fs.BoxModel):
                return known.model.modes(**self.values(known.model.parameters, given))
            if known is self.exact or band is None:
                self.say(f"complex modes of {known.model.size} DOF")
                return fs.complex_modes(known.model, self.at(given), band=band, evidence=evidence)
            return fs.modes.beside_the_full(known.model, self.at(given), band=band)

        at = "modes", id(known.model), tuple(given.items()), band, repr(self.linear)
        return self.kept(at if evidence is None or at in self.scene.store else ("uncounted", *at), modes)

    def values(self, names: Iterable[str], given: Mapping[str, float]) -> dict[str, float]:
        """The values of parameters: those that are given, and the scene's values of the others."""
        return {name: given[name] if name in given else self.value(name) for name in names}

    def value(self, name: str) -> float:
        """The value of a parameter of matrices.

        Raises
        ------
        InputError
            It has none.
        """
        given = self.scene.parameters.get(name)
        if given is None or given.value is None:
            raise InputError(f"the parameter {name!r} has no value: give [parameter.{name}] with value")
        return given.value

    def over(self, known: Known, names: Sequence[str], between: tuple[float, float] | None = None) -> tuple[Any, Any]:
        """A model and its contacts, for analyses over the parameters `names`.

        If a parameter changes matrices or the model, the result is a family of pencils, which includes the contacts, and None. It
        is so too if the contacts are affine over the range `between` of one parameter: the family's matrices are formed once.
        """
        changes = {name: one.change(self) for name, one in self.scene.parameters.items() if name in names and one.acts}
        if self.pencil and known is self.exact:
            part, = self.scene.parts.values()
            values = self.values((name for name in part.names if name not in names), {})
            site = self.scene.site(next(iter(self.scene.parts)))
            return self.kept(("family", self._key, tuple(names), tuple(values.items())),
                             lambda: part.family(site, tuple(names), values)), None  # type: ignore[attr-defined]
        if isinstance(known.model, fs.BoxModel):
            return known.model.fixed(**{name: self.value(name) for name in known.model.parameters if name not in names}), None
        if not changes:
            contacts = self.at({}) if "speed" not in names else self.contacts
            if between is None or not pencil_over(known.model, contacts, names[0]).affine(between):
                return known.model, contacts
            return family_of(known.model, contacts, list(names), {names[0]: between}), None
        ranges = {name: self.scene.parameters[name].range for name in names}
        return family_of(known.model, self.linear, list(names), ranges, changes=changes), None  # type: ignore[arg-type]

    # shapes

    def drawn(self, u: Array) -> dict[str, tuple[fs.Mesh, Array]]:
        """Kind of cells → joined mesh of the parts with this kind, and the motions u (n, k) on it as (nodes, 3, k).

        Each motion is scaled so that its largest displacement of all parts is 1.
        """
        moved = {next(iter(self._built[2])): u} if self.alone else self.full.expand(u)
        fields: dict[str, Array] = {}
        for name, mesh in self.meshes.items():
            kind = self.scene.parts.get(name) or next(iter(self.scene.parts.values()))
            found = kind.moved(mesh, self.full if self.alone else self.full.parts[name], moved[name])
            if found is not None:
                fields[name] = found
        if not fields:
            return {}
        largest = np.max([np.linalg.norm(one, axis=1).max(axis=0) for one in fields.values()], axis=0)
        drawn: dict[str, tuple[fs.Mesh, Array]] = {}
        for kind_of in dict.fromkeys(self.meshes[name].kind for name in fields):
            names = [name for name in fields if self.meshes[name].kind == kind_of]
            shapes = np.concatenate([fields[name] for name in names]) / np.where(largest > 0, largest, 1.0)
            drawn[kind_of] = fs.components.joined_mesh([self.meshes[name] for name in names]), shapes
        return drawn

    @property
    def marks(self) -> dict[str, Array]:
        """Nodes of the contacts and of the interface, as rows of the joined mesh; none if there are several kinds of mesh."""
        if len({mesh.kind for mesh in self.meshes.values()}) != 1:
            return {}
        starts = dict(zip(self.meshes, np.cumsum([0, *(len(mesh.points) for mesh in self.meshes.values())]), strict=False))
        found: dict[str, list[Array]] = {"contact": [], "interface": []}
        for one in self.scene.contacts.values():
            if one.surfaces:
                first = End.of(one.surfaces[0])
                name, surface = self.scene.facing(one).second if one.facing else (first.part, first.rest)
                found["contact"].append(starts[name] + self.meshes[name].sets[surface])
        if self.alone and self.full.dofs is not None:
            mesh, dofs = next(iter(self.meshes.values())), self.full.dofs
            ports = [np.flatnonzero(self.full.port(name)) for one in self.contacts for name in one.ports]
            for key, rows in (("contact", np.concatenate(ports) if ports else np.zeros(0, int)),
                              ("interface", self.full.interface)):
                nodes = np.unique(dofs.nodes[rows])
                found[key].append(fs.components.node_rows(mesh, nodes[np.isin(nodes, mesh.numbers)]))
        return {key: np.concatenate(rows) for key, rows in found.items() if rows and len(np.concatenate(rows))}
