"""Pictures of systems that are reduced part by part: the parts in colours."""

from __future__ import annotations

from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.app.figure_style import PAGE, new_figure
from femsub.app.figures_modes import seen, seen_from, triad
from femsub.components import boundary_faces, corner_nodes

if TYPE_CHECKING:
    from femsub import Mesh
    from femsub.checks import Array

#: colours that also those tell apart who see no red or no green
PARTS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442", "#999999")
FINE = 8000  # cells from which on their edges are not drawn
APART = np.array([0.5, 0.5, 2.5])  # of its distance from the middle that each part is moved where parts are drawn apart
LIGHT = np.array([0.2, -0.4, 0.9])  # from where it comes, of length 1 but for rounding


def parts_figure(meshes: Mapping[str, Mesh], title: str) -> Any:
    """Parts in colours: plane ones with their cells; solids as they are joined, and drawn apart."""
    from matplotlib import colormaps
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch

    others = colormaps["tab20"]
    palette = PARTS if len(meshes) <= len(PARTS) else [others(number) for number in range(others.N)]
    colours: dict[str, Any] = {name: np.array(to_rgb(palette[number % len(palette)])) for number, name in enumerate(meshes)}
    solid = next(iter(meshes.values())).dimension == 3
    figure = new_figure(PAGE if solid else 0.8 * PAGE, 4.4 if solid else 5.0)
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
