"""Figures of systems that were reduced part by part: the parts in colours, and errors over size and time."""

from __future__ import annotations

from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter
from typing import Any

import numpy as np

from femsub import Mesh
from femsub.app.figure_style import few_decades, look, new_figure
from femsub.app.figures_modes import seen, seen_from, triad
from femsub.checks import Array
from femsub.components.mesh import boundary_faces, corner_nodes
from femsub.studies.results import Row, Study

KINDS = {"error_frequency": "frequencies", "error_growth": "growth rates", "error_slope": "critical slope",
         "error_force": "forces in the joints"}
FINE = 8000  # cells from which on their edges are not drawn
APART = np.array([0.5, 0.5, 2.5])  # of its distance from the middle that each part is moved where parts are drawn apart
LIGHT = np.array([0.2, -0.4, 0.9])  # from where it comes, of length 1 but for rounding
FLOOR = 1e-13  # errors below are rounding, and drawn there


def errors_figure(found: Study, title: str) -> Any:
    """Errors of frequencies, growth rates, critical slope and forces in the joints: over DOF, and over seconds."""
    kinds = {kind: name for kind, name in KINDS.items()
             if any(np.isfinite(getattr(row, kind)) for row in found.rows)}
    figure = new_figure(3.1 * max(len(kinds), 2), 6.4)
    axes = figure.subplots(2, len(kinds), sharex="row", sharey="col", squeeze=False)
    for line, (across, label) in enumerate(((_size, "DOF of the system  [-]"), (_seconds, "seconds to reduce and to solve"))):
        for axis, kind in zip(axes[line], kinds, strict=True):
            for key in dict.fromkeys(row.method for row in found.rows):
                rows = [row for row in found.rows if row.method == key and row.sound and np.isfinite(getattr(row, kind))]
                points = [(across(row), max(getattr(row, kind), FLOOR)) for row in rows]
                style = look(key)
                axis.plot(*(zip(*points, strict=True) if points else ((), ())), color=style.colour, marker=style.marker,
                          markersize=5, lw=1, mfc="none", label=style.label)
            axis.axvline(across(found.full), color="black", ls="--", lw=1, label="full")
            axis.set(xscale="log", yscale="log", xlabel=label)
            axis.grid(lw=0.4)
        few_decades(axes[line, 0])
    for column, name in enumerate(kinds.values()):
        axes[0, column].set_title(name)
    for axis in axes[:, 0]:
        axis.set_ylabel("relative error  [-]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    figure.suptitle(f"{title}, band {found.band[0]:g} to {found.band[1]:.4g} rad/time\n"
                    "models with a mode missing or added in the band are not shown", fontsize=9)
    return figure


def _size(row: Row) -> float:
    return float(row.size)


def _seconds(row: Row) -> float:
    return row.seconds


def parts_figure(meshes: Mapping[str, Mesh], title: str) -> Any:
    """Parts in colours: plane ones with their cells; solids as they are joined, and drawn apart."""
    from matplotlib import colormaps
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Patch

    palette = colormaps["tab20" if len(meshes) > 10 else "tab10"]
    colours: dict[str, Any] = {name: np.array(palette(number % palette.N)[:3]) for number, name in enumerate(meshes)}
    solid = next(iter(meshes.values())).dimension == 3
    figure = new_figure(11.0 if solid else 6.4, 5.2)
    axes = figure.subplots(1, 2 if solid else 1, squeeze=False)[0]
    edge: dict[str, Any] = {"edgecolors": (0, 0, 0, 0.35),
                            "linewidths": 0.3 if sum(len(mesh.cells) for mesh in meshes.values()) < FINE else 0.0}
    for axis, apart in zip(axes, (np.zeros(3), APART), strict=False):
        if solid:
            polygons, fills = _painted(meshes, colours, apart)
            axis.add_collection(PolyCollection(polygons, facecolors=fills, **edge))
            axis.set_title("drawn apart" if apart.any() else "joined")
            axis.set_axis_off()
        else:
            for name, mesh in meshes.items():
                axis.add_collection(PolyCollection(list(mesh.points[mesh.cells][:, :, :2]), facecolors=colours[name], **edge))
            axis.set(xlabel="x  [length]", ylabel="y  [length]")
        axis.set_aspect("equal")
        axis.autoscale_view()
    if solid:
        triad(axes[0])
    figure.legend([Patch(color=colour) for colour in colours.values()], list(colours), loc="outside lower center",
                  ncols=min(len(colours), 8))
    figure.suptitle(title)
    return figure


def _painted(meshes: Mapping[str, Mesh], colours: Mapping[str, Array], apart: Array) -> tuple[list[Array], Array]:
    """The visible faces of solids as polygons, the nearest last, and their colours; each part moved away from the middle."""
    middle = np.mean([mesh.points.mean(axis=0) for mesh in meshes.values()], axis=0)
    moved = {name: mesh.points + apart * (mesh.points.mean(axis=0) - middle) for name, mesh in meshes.items()}
    polygons: list[Array] = []
    fills = []
    for name in _far_to_near(moved):
        points, faces = moved[name], corner_nodes(meshes[name], *boundary_faces(meshes[name]))
        plane, depth = seen(points)
        normal = np.cross(points[faces[:, 2]] - points[faces[:, 0]], points[faces[:, -1]] - points[faces[:, 1]])
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        front = np.flatnonzero(normal @ seen_from() > 0)
        front = front[np.argsort(depth[faces[front]].mean(axis=1), kind="stable")]
        polygons += list(plane[faces[front]])
        fills.append((0.7 + 0.3 * np.clip(normal[front] @ LIGHT, 0, 1))[:, None] * colours[name])
    return polygons, np.concatenate(fills)


def _far_to_near(points: Mapping[str, Array]) -> list[str]:
    """The parts in the order in which they are painted: one on the viewer's side of a plane x, y or z = const comes later."""
    names = sorted(points, key=lambda name: float(seen(points[name])[1].mean()))
    towards = np.sign(seen_from())
    near, far = ({name: bound(place * towards, axis=0) for name, place in points.items()} for bound in (np.max, np.min))
    tolerance = 1e-6 * max(float(np.ptp(place)) for place in points.values())

    def before(one: str, other: str) -> bool:
        return bool((near[one] <= far[other] + tolerance).any())

    order = TopologicalSorter({other: [one for one in names if one != other and before(one, other) and not before(other, one)]
                               for other in names})
    try:
        return list(order.static_order())
    except CycleError:
        return names
