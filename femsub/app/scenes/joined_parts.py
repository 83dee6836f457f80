"""What the scenes of joined parts share: the study over methods, part by part; the parts in colours; the modes of all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from femsub import (
    ContactModes,
    CraigBampton,
    Mesh,
    ReducedSubstructure,
    System,
    displacements,
    normal_modes,
    reduce,
    study,
)
from femsub.app.figures import parts_figure
from femsub.app.keys import key
from femsub.app.scene import RIGID, Picture, Progress, Result, Scene, Shown, method_keys, other_method_names, run_outputs
from femsub.app.scenes.outputs import Drawn, mode_rows, mode_views, vtu
from femsub.checks import Array
from femsub.modes import NEAR, match
from femsub.reduction import METHODS, PORT_LIMIT, Method
from femsub.studies import (
    Remark,
    Table,
    all_frequencies,
    column,
    elastic,
    errors_chart,
    friction_errors_chart,
    study_choice,
)

if TYPE_CHECKING:
    from femsub.model import Contacts



class Over(NamedTuple):
    """What a study of friction is asked for beside its contacts."""

    parameter: str
    values: Sequence[float]
    between: tuple[float, float]


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


class Choice(NamedTuple):
    """How one part is reduced: a method's key ('' for that of the row, 'full' for none), and modes row by row ([] for all)."""

    method: str = ""
    modes: Sequence[int] = ()


def compared(scene: JoinedScene, system: System, contacts: Contacts, title: str, name: str, progress: Progress,
             choices: Mapping[str, Choice] | None = None, over: Over | None = None) -> Result:
    """The study of one system: full, and reduced part by part with each method and number of modes.

    With `over` it is one of friction over mu: the parts are reduced, and then the system to contact modes.
    """
    made = _methods(scene, system, choices or {})
    methods: list[Any] = [parts for parts, _ in made]
    if over is not None:  # the system is then reduced to as many contact modes; and these are tried alone
        methods = []
        for each, count in made:
            room = sum((each[name].modes or 0) + len(sub.interface) if name in each else sub.size
                       for name, sub in system.parts.items())
            methods.append((each, ContactModes(min(count, room - 1), contacts=contacts)))
        methods += [ContactModes(min(count, system.size - 1), contacts=contacts)
                    for count in dict.fromkeys(count for _, count in made)]
    found = study(system, methods, (scene.band[0], scene.band[1]), contacts=contacts, ports=scene.ports, repeats=scene.repeats,
                  held=over is None, progress=progress, **(over._asdict() if over else {}))
    best, words = found.recommended(scene.tolerance), found.recommendation(scene.tolerance)
    flat = [row.flat() for row in (found.full, *found.rows)]
    parts = [{"part": part, "size": sub.size, "interface": len(sub.interface)} for part, sub in system.parts.items()]
    # natural frequencies of the full system in the band, and beside them those of the recommended model
    frequencies: list[dict[str, Any]] = []
    said: list[Shown] = []
    if not over:
        own = elastic(normal_modes(system, band=(scene.band[0], scene.band[1])))
        frequencies = [{"mode": i, "omega": omega} for i, omega in enumerate(own, start=1)]
    if frequencies and best is not None:
        theirs = all_frequencies(found.models[found.rows.index(best)])
        for at, to in zip(*match(own, theirs), strict=True):
            if abs(theirs[to] - own[at]) <= NEAR * own[at]:
                frequencies[at] |= {"reduced": theirs[to], "error": abs(theirs[to] - own[at]) / own[at]}
    if frequencies:
        of = "" if best is None else f", and of {best.label} with {best.size} DOF"
        columns = ("mode", "omega", *([] if best is None else [column("reduced", "reduced ω", ".6g"), "error"]))
        said = [f"natural frequencies of the full system in the band{of}, in rad/time:",
                Table(f"{name}-frequencies", frequencies, columns, "Natural frequencies", most=scene.listed),
                *[f"and {len(frequencies) - scene.listed} more"] * (len(frequencies) > scene.listed)]
    # what the errors are relative to, and what `reduce` warns of, once for all rows
    notes: list[str] = []
    if not np.isnan(found.full.critical):
        notes.append(f"full: critical {found.symbol} {found.full.critical:.6g}, largest Re λ in the band {found.full.growth:.6g}")
    worst = max(found.rows, key=lambda row: row.port_error, default=None)
    if worst is not None and worst.port_error > PORT_LIMIT:
        notes.append(f"the static response to the belt is off by up to {100 * worst.port_error:.2g} % ({worst.label} with "
                     f"{worst.size} DOF). Set ports = true, or put the contact into the interface")
    data: dict[str, Any] = {"system": repr(system), "parts": parts, "rows": flat, "left_out": found.left_out,
                            "recommendation": words, "recommended": None if best is None else best.flat(),
                            "frequencies": frequencies}
    data |= {"parameter": over.parameter, "values": over.values} if over else {}
    return Result({name: data}, [
        f"{title}: {system!r}", str(found), *notes, words, *said, Table(name, flat, title="Methods, error against run time"),
        (friction_errors_chart if over else errors_chart)(found, title, name),
        study_choice(found, scene.tolerance, name.removeprefix("methods").strip("-").replace("-", " "))])


def _methods(scene: JoinedScene, system: System, choices: Mapping[str, Choice]) -> list[tuple[dict[str, Method], int]]:
    """For each row a mapping of parts to methods, with so many modes or all that a part has, and its number of modes."""
    made: dict[tuple[tuple[str, Method], ...], int] = {}
    for name in scene.methods:
        for row, count in enumerate(scene.modes):
            mapping: dict[str, Method] = {}
            for part, sub in system.parts.items():
                own = choices.get(part, Choice())
                if own.method == "full":
                    continue
                kind, modes = METHODS[own.method or name], own.modes[min(row, len(own.modes) - 1)] if own.modes else count
                room = len(sub.interior)
                if not kind.held:  # of a free part; its rigid motions are counted only where so many modes are asked for
                    many = modes > sub.size - RIGID
                    room = sub.size - (normal_modes(sub, count=min(1, sub.size)).rigid if many else RIGID)
                mapping[part] = kind(min(modes, max(room, 0)))
            made.setdefault(tuple(mapping.items()), count)
    return [(dict(pairs), count) for pairs, count in made.items()]


@dataclass(frozen=True)
class MeshedScene(JoinedScene):
    """What scenes of parts with meshes share."""

    methods: list[str] = field(default_factory=lambda: ["craig-bampton", "craig-chang", "rubin", "guyan"])
    ports: bool = True
    repeats: int = 3

    OUTPUTS: ClassVar[tuple[str, ...]] = ("parts", "methods", "modes-per-part")


def run_parts(scene: MeshedScene, system: System, meshes: Mapping[str, Mesh], head: str, progress: Progress) -> Result:
    """The parts in colours, the study over methods, and how many modes each part needs; the belt is at the system's port."""
    belt = replace(scene.linear_belt, port=next(iter(system.ports)))
    views = {"parts": lambda: picture(meshes, f"{scene.name}: {system.size} DOF in {len(meshes)} parts"),
             "methods": lambda: compared(scene, system, belt, scene.name, "methods", progress),
             "modes-per-part": lambda: chosen_modes(scene, system, "modes-per-part", progress)}
    return run_outputs(scene.outputs, lambda output: views[output](), {"band": scene.band, **scene.friction},
                       [f"{head}, {scene.friction_words}"])


def picture(meshes: Mapping[str, Mesh], title: str) -> Result:
    """The parts in colours, parts.png; and parts.vtu with the number of the part, counted from 1, at each node."""
    rows: list[dict[str, Any]] = [{"part": name, "nodes": len(mesh.points), "cells": len(mesh.cells), "kind": mesh.kind}
                                  for name, mesh in meshes.items()]
    columns = ("part", column("nodes", form="d"), column("cells", form="d"), column("kind", form="s"))
    drawn = Picture("parts", lambda: parts_figure(meshes, title))
    nodes, cells = (np.cumsum([0, *(len(values) for values in each)]) for each in
                    zip(*((mesh.points, mesh.cells) for mesh in meshes.values()), strict=True))
    whole = Mesh(np.vstack([mesh.points for mesh in meshes.values()]),
                 np.vstack([mesh.cells + start for mesh, start in zip(meshes.values(), nodes, strict=False)]), rows[0]["kind"],
                 groups={name: np.arange(a, b) for name, a, b in zip(meshes, cells, cells[1:], strict=False)})
    number = np.repeat(np.arange(1.0, len(meshes) + 1), np.diff(nodes))
    return Result({"parts": rows}, [Table("parts", rows, columns, "Parts"), drawn],
                  {"parts.vtu": partial(vtu, whole, {"part": number})})


def chosen_modes(scene: JoinedScene, system: System, name: str, progress: Progress) -> Result:
    """How many fixed-interface modes each part needs, so that the natural frequencies of the whole are within the tolerance."""
    undamped = system.with_parts({part: sub.with_damping(None) for part, sub in system.parts.items()})
    progress(f"{scene.name}: modes of each part for a tolerance of {scene.tolerance:g}")
    method = CraigBampton(band=(scene.band[0], scene.band[1]), tol=scene.tolerance)
    found = reduce(undamped, dict.fromkeys(system.parts, method), ports=scene.ports)
    kept = {part: own for part, own in found.parts.items() if isinstance(own, ReducedSubstructure)}
    rows = [{"part": part, "size": system.parts[part].size, "interface": len(system.parts[part].interface), "modes": own.modes,
             "reduced": own.size} for part, own in kept.items()]
    most = max(kept, key=lambda part: kept[part].modes)
    without = ", ".join(part for part, own in kept.items() if not own.modes)
    words = (f"recommendation: Craig-Bampton with {sum(own.modes for own in kept.values())} modes in all, {found.size} of "
             f"{system.size} DOF. {most} needs the most, {kept[most].modes}")
    words += f". Constraint modes are enough for {without}" if without else ""
    columns = ("part", "size", "interface", "modes", column("reduced", "reduced DOF", "d"))
    return Result({name: {"parts": rows, "size": found.size, "recommendation": words}}, [
        f"fixed-interface modes of each part, for all natural frequencies in the band within {scene.tolerance:g}:",
        Table(name, rows, columns, "Modes of each part"), words])


def system_modes(scene: JoinedScene, system: System, meshes: Mapping[str, Mesh], reference: Sequence[float] = ()) -> Result:
    """The modes as a table, beside frequencies that another program found; of parts that have meshes a figure and a file for
    each kind of cells.
    """
    found = normal_modes(system, band=(scene.band[0], scene.band[1]))
    rows = mode_rows(found)
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
    if not rows:
        return Result({"modes": rows}, [f"{scene.name}: the system has no normal mode in the band"])
    shown: list[Shown] = [
        f"Normal modes of {system.name!r} in the band in rad/time, {found.rigid} of them rigid; {found.evidence}",
        Table("modes", rows, ("mode", "omega", "residual", *[column("reference", "reference ω", ".9g"), column(
            "difference", "rel. difference", ".1e")][:2 * bool(reference)]), "Normal modes", most=scene.listed), *remarks]
    if bare := [name for name in system.parts if meshes and name not in meshes]:
        shown.append(f"not drawn, since they have no mesh: {', '.join(bare)}")
    if not meshes or not scene.figures:
        return Result({"modes": rows}, shown)
    pictures, files = mode_views(scene, found.frequencies, by_kind(system, meshes, found.shapes), {})
    return Result({"modes": rows}, [*shown, *pictures], files)


def by_kind(system: System, meshes: Mapping[str, Mesh], shapes: Array) -> dict[str, Drawn]:
    """The parts' meshes of each kind as one, and the modes on it (nodes, 3, k), the largest displacement of all parts 1."""
    moved = system.expand(shapes)
    fields = {name: displacements(mesh, dofs, moved[name]) for name, mesh in meshes.items()
              if (dofs := system.parts[name].dofs) is not None}
    largest = np.max([np.linalg.norm(field, axis=1).max(axis=0) for field in fields.values()], axis=0)
    drawn: dict[str, Drawn] = {}
    for kind in dict.fromkeys(mesh.kind for mesh in meshes.values()):
        names = [name for name, mesh in meshes.items() if mesh.kind == kind]
        starts = np.cumsum([0, *(len(meshes[name].points) for name in names)])
        whole = Mesh(np.vstack([meshes[name].points for name in names]),
                     np.vstack([meshes[name].cells + start for name, start in zip(names, starts, strict=False)]), kind)
        drawn[kind] = whole, np.concatenate([fields[name] for name in names]) / np.where(largest > 0, largest, 1.0)
    return drawn
