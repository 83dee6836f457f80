"""Joined parts: the study over methods, part by part; the parts in colours; the modes of all. The chain and a plate in parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import femsub as fs
from femsub import studies
from femsub.app.figures import parts_figure
from femsub.app.keys import key
from femsub.app.scene import Picture, Progress, Result, Run, Scene, Shown, method_keys, other_method_names
from femsub.app.scenes.chain import MassKeys
from femsub.app.scenes.component import RIGID, Drawn, mode_rows, mode_views, vtu
from femsub.app.scenes.plate import PlateKeys
from femsub.checks import Array
from femsub.coupling import cut_chain
from femsub.errors import InputError
from femsub.modes import NEAR, match
from femsub.reduction import METHODS, PORT_LIMIT, Method
from femsub.studies import Remark, Table, column, elastic

if TYPE_CHECKING:
    from femsub.model import Contacts


@dataclass(frozen=True)
class JoinedScene(Scene):
    """The keys that scenes of joined parts share."""

    methods: list[str] = key(["craig-bampton", "craig-chang", "macneal", "dual-craig-bampton", "guyan"],
                             "reduction methods, each for all parts that have no method of their own; short names (HCB, CC) and "
                             "those of the Python classes will do",
                             choices=method_keys, also=other_method_names)
    modes: list[int] = key([1, 2, 4], "numbers of modes to compare, in each part that has none of its own", least=0)
    ports: bool = key(False, "whether the static response to a part's ports joins its basis")
    band: list[float] = key([], "the frequencies in which models are compared", unit="rad/s", least=0, form="[lo, hi]",
                            required=True, example=[0.0, 1e4])
    tolerance: float = key(1e-3, "relative error of the growth rates, or of the critical μ, that the recommended model may have",
                           above=0)
    listed: int = key(20, "natural frequencies that are printed; the table that --out writes has all in the band", least=1)


@dataclass(frozen=True)
class MeshedScene(JoinedScene):
    """What scenes of parts with meshes share."""

    methods: list[str] = field(default_factory=lambda: ["craig-bampton", "craig-chang", "rubin", "guyan"])
    ports: bool = True
    repeats: int = 3

    OUTPUTS: ClassVar[tuple[str, ...]] = ("parts", "methods", "modes-per-part")

    def joined(self, system: fs.System, meshes: Mapping[str, fs.Mesh], head: str, progress: Progress) -> Result:
        """The parts in colours, the study over methods, and how many modes each part needs; the belt is at the system's port."""
        belt = replace(self.linear_belt, port=next(iter(system.ports)))
        return JoinedRun(self, progress, system, belt, meshes).result({"band": self.band, **self.friction}, [
            f"{head}, {self.friction_words}"])


@dataclass(eq=False)
class JoinedRun(Run):
    """The outputs of a system of parts.

    `meshes` and `choices` go by parts. A choice is how one part is reduced: a method's key ('' for that of the row, 'full' for
    none), and modes row by row ([] for those of the scene). With `over`, the parameter, its values and the range between, the
    study is one of friction: the parts are reduced, and then the system to contact modes.
    """

    scene: JoinedScene
    system: fs.System
    contacts: Contacts
    meshes: Mapping[str, fs.Mesh] = field(default_factory=dict)
    choices: Mapping[str, tuple[str, Sequence[int]]] = field(default_factory=dict)
    over: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.band = self.scene.band[0], self.scene.band[1]

    def reductions(self) -> list[tuple[dict[str, Method], int]]:
        """For each row a mapping of parts to methods, with so many modes or all that a part has, and its number of modes."""
        made: dict[tuple[tuple[str, Method], ...], int] = {}
        for name in self.scene.methods:
            for row, count in enumerate(self.scene.modes):
                mapping: dict[str, Method] = {}
                for part, sub in self.system.parts.items():
                    method, own = self.choices.get(part, ("", ()))
                    if method == "full":
                        continue
                    kind, modes = METHODS[method or name], own[min(row, len(own) - 1)] if own else count
                    room = len(sub.interior)
                    if not kind.held:  # of a free part; its rigid motions are counted only where so many modes are asked for
                        many = modes > sub.size - RIGID
                        room = sub.size - (fs.normal_modes(sub, count=min(1, sub.size)).rigid if many else RIGID)
                    mapping[part] = kind(min(modes, max(room, 0)))
                made.setdefault(tuple(mapping.items()), count)
        return [(dict(pairs), count) for pairs, count in made.items()]

    def methods(self) -> Result:
        """The study: full, and reduced part by part with each method and number of modes."""
        return self.compared(self.scene.name, "methods")

    def compared(self, title: str, name: str) -> Result:
        """The study under a title, with files of this name."""
        scene, system, over, made = self.scene, self.system, self.over, self.reductions()
        methods = with_contact_modes(system, made, self.contacts) if over else [parts for parts, _ in made]
        found = fs.study(system, methods, self.band, contacts=self.contacts, ports=scene.ports, repeats=scene.repeats,
                         held=not over, progress=self.progress, **over)
        rows, best = found.flat, found.recommended(scene.tolerance)
        choice = studies.study_choice(found, scene.tolerance, name.removeprefix("methods").strip("-").replace("-", " "))
        # natural frequencies of the full system in the band, and beside them those of the recommended model
        frequencies: list[dict[str, Any]] = []
        said: list[Shown] = []
        if not over:
            own = elastic(fs.normal_modes(system, band=self.band))
            frequencies = [{"mode": i, "omega": omega} for i, omega in enumerate(own, start=1)]
        if frequencies:
            of, columns = "", ["mode", "omega"]
            if best is not None:
                of, columns = f", and of {best.label} with {best.size} DOF", [*columns, "reduced", "error"]
                theirs = studies.all_frequencies(found.models[found.rows.index(best)])
                for at, to in zip(*match(own, theirs), strict=True):
                    if abs(theirs[to] - own[at]) <= NEAR * own[at]:
                        frequencies[at] |= {"reduced": theirs[to], "error": abs(theirs[to] - own[at]) / own[at]}
            said = [f"natural frequencies of the full system in the band{of}, in rad/time:",
                    Table(f"{name}-frequencies", frequencies, [
                        column("reduced", "reduced ω", ".6g") if key == "reduced" else key for key in columns],
                          "Natural frequencies", most=scene.listed),
                    *[f"and {len(frequencies) - scene.listed} more"] * (len(frequencies) > scene.listed)]
        # what the errors are relative to, and what `reduce` warns of, once for all rows
        notes: list[str] = []
        if not np.isnan(found.full.critical):
            notes.append(f"full: critical {found.symbol} {found.full.critical:.6g}, largest Re λ in the band "
                         f"{found.full.growth:.6g}")
        worst = max(found.rows, key=lambda row: row.port_error, default=None)
        if worst is not None and worst.port_error > PORT_LIMIT:
            notes.append(f"the static response to the belt is off by up to {100 * worst.port_error:.2g} % ({worst.label} with "
                         f"{worst.size} DOF). Set ports = true, or put the contact into the interface")
        parts = [{"part": part, "size": sub.size, "interface": len(sub.interface)} for part, sub in system.parts.items()]
        data: dict[str, Any] = {
            "system": repr(system), "parts": parts, "rows": rows, "left_out": found.left_out,
            "recommendation": choice.sentence, "recommended": choice.row, "frequencies": frequencies}
        data |= {name: over[name] for name in ("parameter", "values") if over}
        return Result({name: data}, [
            f"{title}: {system!r}", str(found), *notes, choice.sentence, *said,
            Table(name, rows, title="Methods, error against run time"),
            (studies.friction_errors_chart if over else studies.errors_chart)(found, title, name), choice])

    def parts(self) -> Result:
        """The parts in colours, parts.png; and parts.vtu with the number of the part, counted from 1, at each node."""
        meshes, title = self.meshes, f"{self.scene.name}: {self.system.size} DOF in {len(self.meshes)} parts"
        rows: list[dict[str, Any]] = [{"part": name, "nodes": len(mesh.points), "cells": len(mesh.cells), "kind": mesh.kind}
                                      for name, mesh in meshes.items()]
        columns = ("part", column("nodes", form="d"), column("cells", form="d"), column("kind", form="s"))
        ends = np.cumsum([row["cells"] for row in rows])
        groups = {row["part"]: np.arange(end - row["cells"], end) for row, end in zip(rows, ends, strict=True)}
        whole = joined_mesh(list(meshes.values()), groups)
        number = np.repeat(np.arange(1.0, len(rows) + 1), [row["nodes"] for row in rows])
        return Result({"parts": rows}, [Table("parts", rows, columns, "Parts"),
                                        Picture("parts", lambda: parts_figure(meshes, title))],
                      {"parts.vtu": partial(vtu, whole, {"part": number})})

    def modes_per_part(self) -> Result:
        """How many fixed-interface modes each part needs for natural frequencies of the whole within the tolerance."""
        scene, system, name = self.scene, self.system, "modes-per-part"
        undamped = system.with_parts({part: sub.with_damping(None) for part, sub in system.parts.items()})
        self.say(f"modes of each part for a tolerance of {scene.tolerance:g}")
        method = fs.CraigBampton(band=self.band, tol=scene.tolerance)
        found = fs.reduce(undamped, dict.fromkeys(system.parts, method), ports=scene.ports)
        kept = {part: own for part, own in found.parts.items() if isinstance(own, fs.ReducedSubstructure)}
        rows = [{"part": part, "size": system.parts[part].size, "interface": len(system.parts[part].interface),
                 "modes": own.modes, "reduced": own.size} for part, own in kept.items()]
        most = max(kept, key=lambda part: kept[part].modes)
        without = ", ".join(part for part, own in kept.items() if not own.modes)
        words = (f"recommendation: Craig-Bampton with {sum(own.modes for own in kept.values())} modes in all, {found.size} of "
                 f"{system.size} DOF. {most} needs the most, {kept[most].modes}")
        words += f". Constraint modes are enough for {without}" if without else ""
        columns = ("part", "size", "interface", "modes", column("reduced", "reduced DOF", "d"))
        return Result({name: {"parts": rows, "size": found.size, "recommendation": words}}, [
            f"fixed-interface modes of each part, for all natural frequencies in the band within {scene.tolerance:g}:",
            Table(name, rows, columns, "Modes of each part"), words])

    def modes(self) -> Result:
        """The modes as a table, beside frequencies that another program found; of parts that have meshes a figure and a file for
        each kind of cells.
        """
        scene, system, meshes, reference = self.scene, self.system, self.meshes, getattr(self.scene, "reference", ())
        found = fs.normal_modes(system, band=self.band)
        rows = mode_rows(found)
        if not rows:
            return Result({"modes": rows}, [f"{scene.name}: the system has no normal mode in the band"])
        columns: list[Any] = ["mode", "omega", "residual"]
        remarks: list[Remark] = []
        if reference:  # beside the elastic frequencies that are nearest
            own, theirs = found.frequencies[found.rigid:], np.array(reference)
            apart: list[float] = []
            for at, to in zip(*match(own, theirs), strict=True):
                difference = abs(float(own[at] / theirs[to] - 1))
                if difference <= NEAR:
                    rows[found.rigid + at] |= {"reference": float(theirs[to]), "difference": difference}
                    apart.append(difference)
            within = f", within {max(apart):.1e}" if apart else ""
            remarks = [Remark([f"{len(apart)} of {len(theirs)} reference frequencies are met by modes of the system{within}."])]
            columns += [column("reference", "reference ω", ".9g"), column("difference", "rel. difference", ".1e")]
        shown: list[Shown] = [
            f"Normal modes of {system.name!r} in the band in rad/time, {found.rigid} of them rigid; {found.evidence}",
            Table("modes", rows, columns, "Normal modes", most=scene.listed), *remarks]
        if bare := [name for name in system.parts if meshes and name not in meshes]:
            shown.append(f"not drawn, since they have no mesh: {', '.join(bare)}")
        if not meshes or not scene.figures:
            return Result({"modes": rows}, shown)
        pictures, files = mode_views(scene, found.frequencies, by_kind(system, meshes, found.shapes), {})
        return Result({"modes": rows}, [*shown, *pictures], files)


@dataclass(frozen=True)
class ChainPartsScene(JoinedScene, MassKeys):
    """The paper's chain in several parts. A mass at a cut belongs to both parts, half to each."""

    n: int = key(10, "number of masses", least=3, most=10**6)
    springs: float | list[float] = key(1.0, "the springs: one value, or n of them", unit="force/length", above=0)
    parts: list[int] = key([2, 3, 5], "numbers of parts to cut it into", least=2, distinct=True)
    band: list[float] = key([], "the frequencies in which models are compared", unit="rad/time", least=0, form="[lo, hi]",
                            otherwise="the lowest three of a chain of equal masses and springs", example=[0.0, 0.8])

    OUTPUTS: ClassVar[tuple[str, ...]] = ("methods",)

    def __post_init__(self) -> None:
        self.fill(band=self.three_pairs)
        super().__post_init__()
        for count in self.parts:
            if count >= self.n:
                raise InputError(f"parts: a chain of {self.n} masses can be cut into {self.n - 1} parts at most, not {count}")

    def run(self, progress: Progress) -> Result:
        data = {"n": self.n, "belt": self.belt, "band": self.band, **self.friction}
        return ChainPartsRun(self, progress).result(data, [f"{self.words}, belt under m{self.belt}, {self.friction_words}"],
                                                    outputs=[f"{count} parts" for count in self.parts])


class ChainPartsRun(Run):
    """The study over methods for each number of parts."""

    def compute(self, output: str) -> Result:
        scene, count = self.scene, int(output.split()[0])
        parts, joints, port = cut_chain(scene.n, count, scene.belt, scene.damping, masses=scene.masses, springs=scene.springs)
        system = fs.couple(parts, joints, f"{scene.name} in {count}")
        return JoinedRun(scene, self.progress, system, replace(scene.linear_belt, port=port)).compared(
            f"{scene.name} in {count} parts", f"methods-{count}-parts")


@dataclass(frozen=True)
class PlatePartsScene(MeshedScene, PlateKeys):
    """A steel plate of 0.4 m x 0.3 m x 2 mm, clamped along one side, or your own mesh, cut into parts."""

    elements: list[int] = field(default_factory=lambda: [24, 18])
    parts: int = key(8, "the number of parts, chosen so that they share little", least=2, most=1000)
    sets: list[str] = key([], "instead of parts: groups of cells of the mesh, each of which is a part", otherwise="parts",
                          example=["left-half", "right-half"])
    modes: list[int] = field(default_factory=lambda: [2, 4])
    force: float = 30.0
    band: list[float] = field(default_factory=lambda: [0.0, 3000.0])

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sets and not self.mesh:
            raise InputError("sets are groups of cells of a mesh file, but mesh is not given. Give parts for the rectangle")

    def run(self, progress: Progress) -> Result:
        progress(f"{self.name}: cutting the plate")
        pieces = fs.cut(self.whole(), fs.plate, into=None if self.sets else self.parts, sets=self.sets or None, **self.properties)
        return self.joined(fs.couple(pieces.parts, pieces.joints, self.name), pieces.meshes, repr(pieces), progress)


def contact_modes(system: fs.System, modes: int, contacts: Contacts, friction: bool = True) -> fs.ContactModes:
    """The method for a system as a whole, with as many modes as it has room for."""
    return fs.ContactModes(min(modes, system.size - 1), contacts=contacts, friction=friction)


def with_contact_modes(system: fs.System, made: Sequence[tuple[dict[str, Method], int]], contacts: Contacts) -> list[Any]:
    """Reductions of parts, after each the system's to so many contact modes; and these alone."""
    methods: list[Any] = []
    for each, modes in made:
        room = sum((each[part].modes or 0) + len(sub.interface) if part in each else sub.size
                   for part, sub in system.parts.items())
        methods.append((each, fs.ContactModes(min(modes, room - 1), contacts=contacts)))
    return methods + [contact_modes(system, modes, contacts) for modes in dict.fromkeys(modes for _, modes in made)]


def joined_mesh(meshes: Sequence[fs.Mesh], groups: Mapping[str, Array] | None = None) -> fs.Mesh:
    """Meshes of one kind as one, which share no nodes; `groups` are groups of its cells."""
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    return fs.Mesh(np.vstack([mesh.points for mesh in meshes]),
                   np.vstack([mesh.cells + start for mesh, start in zip(meshes, starts, strict=False)]), meshes[0].kind,
                   groups=groups or {})


def by_kind(system: fs.System, meshes: Mapping[str, fs.Mesh], shapes: Array) -> dict[str, Drawn]:
    """The parts' meshes of each kind as one, and the modes on it (nodes, 3, k), the largest displacement of all parts 1."""
    moved = system.expand(shapes)
    fields = {name: fs.displacements(mesh, dofs, moved[name]) for name, mesh in meshes.items()
              if (dofs := system.parts[name].dofs) is not None}
    largest = np.max([np.linalg.norm(field, axis=1).max(axis=0) for field in fields.values()], axis=0)
    drawn: dict[str, Drawn] = {}
    for kind in dict.fromkeys(mesh.kind for mesh in meshes.values()):
        names = [name for name, mesh in meshes.items() if mesh.kind == kind]
        shapes = np.concatenate([fields[name] for name in names]) / np.where(largest > 0, largest, 1.0)
        drawn[kind] = joined_mesh([meshes[name] for name in names]), shapes
    return drawn
