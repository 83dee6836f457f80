"""The output modes of joined parts: the system's normal modes in the band, drawn on the meshes of its parts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from femsub import Mesh, System, displacements, normal_modes
from femsub.app.scene import Result, Shown
from femsub.app.scenes.joined_parts import LISTED, JoinedScene
from femsub.app.scenes.outputs import Drawn, mode_rows, mode_views
from femsub.checks import Array
from femsub.studies import Table


def system_modes(scene: JoinedScene, system: System, meshes: Mapping[str, Mesh]) -> Result:
    """The modes as a table; of parts that have meshes a figure and a file for each kind of cells."""
    found = normal_modes(system, band=(scene.band[0], scene.band[1]))
    rows = mode_rows(found)
    if not rows:
        return Result({"modes": rows}, [f"{scene.name}: the system has no normal mode in the band"])
    shown: list[Shown] = [
        f"Normal modes of {system.name!r} in the band in rad/time, {found.rigid} of them rigid; {found.evidence}",
        Table("modes", rows, ("mode", "omega", "residual"), "Normal modes", most=LISTED)]
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
