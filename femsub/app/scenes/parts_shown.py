"""What scenes of parts with meshes show beside the study: the parts in colours, and how many modes each needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import BinaryIO, ClassVar

import numpy as np

from femsub import CraigBampton, Mesh, ReducedSubstructure, System, reduce
from femsub.app.figures import parts_figure
from femsub.app.scene import Picture, Progress, Result, run_outputs
from femsub.app.scenes.joined_parts import JoinedScene, compared
from femsub.app.scenes.outputs import vtu
from femsub.studies import Table, column


@dataclass(frozen=True)
class MeshedScene(JoinedScene):
    """What scenes of parts with meshes share."""

    methods: list[str] = field(default_factory=lambda: ["craig-bampton", "craig-chang", "rubin", "guyan"])
    ports: bool = True
    repeats: int = 3

    OUTPUTS: ClassVar[tuple[str, ...]] = ("parts", "methods", "modes-per-part")


def run_parts(scene: MeshedScene, system: System, meshes: Mapping[str, Mesh], told: str, progress: Progress) -> Result:
    """The parts in colours, the study over methods, and how many modes each part needs; the belt is at the system's port."""
    belt = replace(scene.linear_belt, port=next(iter(system.ports)))
    views = {"parts": lambda: picture(meshes, f"{scene.name}: {system.size} DOF in {len(meshes)} parts"),
             "methods": lambda: compared(scene, system, belt, scene.name, "methods", progress),
             "modes-per-part": lambda: chosen_modes(scene, system, "modes-per-part", progress)}
    return run_outputs(scene.outputs, lambda output: views[output](), {"band": scene.band, **scene.friction},
                       [f"{told}, {scene.friction_words}"])


def picture(meshes: Mapping[str, Mesh], title: str) -> Result:
    """The parts in colours, parts.png; and parts.vtu with the number of the part, counted from 1, at each node."""
    rows = [{"part": name, "nodes": len(mesh.points), "cells": len(mesh.cells), "kind": mesh.kind}
            for name, mesh in meshes.items()]
    columns = ("part", column("nodes", form="d"), column("cells", form="d"), column("kind", form="s"))
    drawn = Picture("parts", lambda: parts_figure(meshes, title))
    return Result({"parts": rows}, [Table("parts", rows, columns, "Parts"), drawn], {"parts.vtu": partial(_vtu, meshes)})


def _vtu(meshes: Mapping[str, Mesh], file: BinaryIO) -> None:
    first = next(iter(meshes.values()))
    nodes, cells = (np.cumsum([0, *(len(values) for values in each)]) for each in
                    zip(*((mesh.points, mesh.cells) for mesh in meshes.values()), strict=True))
    whole = Mesh(np.vstack([mesh.points for mesh in meshes.values()]),
                 np.vstack([mesh.cells + start for mesh, start in zip(meshes.values(), nodes, strict=False)]), first.kind,
                 groups={name: np.arange(a, b) for name, a, b in zip(meshes, cells, cells[1:], strict=False)})
    number = np.repeat(np.arange(1.0, len(meshes) + 1), np.diff(nodes))
    vtu(whole, {"part": number}, file)


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
