"""Pictures of mode shapes on their mesh: beams as lines, plates as contours, solids as deformed surfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.app.figure_style import new_figure

if TYPE_CHECKING:
    from femsub import Mesh
    from femsub.checks import Array

STRETCH = 0.12  # how far the largest displacement of a solid is drawn, in parts of the mesh's largest side
MARKS = {"contact": ("black", "v"), "interface": ("#0067a5", "s")}
AZIMUTH, ELEVATION = np.radians(-60.0), np.radians(35.0)  # from where solids are seen


def shapes_figure(mesh: Mesh, shapes: Array, titles: Sequence[str], title: str, marks: Mapping[str, Array]) -> Any:
    """Fields (nodes, 3, k), the largest displacement of each 1, side by side; `marks` are nodes, rows of the mesh, by name."""
    count = len(titles)
    columns = min(count, 3 if mesh.dimension > 1 else 2)
    rows = -(-count // columns)
    if mesh.dimension == 1:
        draw, upward, width, height = _lines, "w / max|w|  [-]", 4.6, 1.9
    elif mesh.dimension == 2:
        draw, upward, width, height = _contours, "y  [length]", 4.0, 0.5 + 3.3 * _aspect(mesh.points)
    else:
        draw, upward, width, height = _surfaces, "", 4.0, 0.4 + 3.6 * _aspect(seen(mesh.points)[0])
    figure = new_figure(width * columns + (1.0 if mesh.dimension > 1 else 0), height * rows + 0.8)
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    draw(figure, axes, mesh, shapes, marks)
    for axis, label in zip(axes.ravel(), titles, strict=False):
        axis.set_title(label)
    for axis in axes.ravel()[count:]:
        axis.set_visible(False)
    if upward:
        for axis in axes[-1]:
            axis.set_xlabel("x  [length]")
        for axis in axes[:, 0]:
            axis.set_ylabel(upward)
    shown = {label: line for axis in axes.ravel() for line, label in zip(*axis.get_legend_handles_labels(), strict=True)
             if len(line.get_xdata())}
    if shown:
        figure.legend(shown.values(), shown.keys(), loc="outside lower center", ncols=max(2, len(shown)))
    figure.suptitle(title)
    return figure


def _aspect(points: Array) -> float:
    width, height = np.ptp(points[:, :2], axis=0)
    return float(np.clip(height / width, 0.3, 2.0))


def _lines(figure: Any, axes: Any, mesh: Mesh, shapes: Array, marks: Mapping[str, Array]) -> None:
    x = mesh.points[:, 0]
    order = np.argsort(x)
    for axis, w in zip(axes.ravel(), shapes[:, 2].T, strict=False):
        axis.axhline(0, color="grey", lw=0.6)
        axis.plot(x[order], w[order], color="black", lw=1.2)
        for name, at in marks.items():
            colour, marker = MARKS[name]
            axis.plot(x[at], w[at], marker, color=colour, ms=6, ls="none", label=name)
        axis.set(ylim=(-1.2, 1.2))
        axis.grid()


def _contours(figure: Any, axes: Any, mesh: Mesh, shapes: Array, marks: Mapping[str, Array]) -> None:
    cells = mesh.cells if mesh.kind == "triangle" else mesh.cells[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    for axis, w in zip(axes.ravel(), shapes[:, 2].T, strict=False):
        drawn = axis.tripcolor(*mesh.points[:, :2].T, w, triangles=cells, shading="gouraud", cmap="RdBu_r", vmin=-1, vmax=1,
                               rasterized=True)
        for name, at in marks.items():
            colour, marker = MARKS[name]
            axis.plot(*mesh.points[at, :2].T, marker, color=colour, mec="white", ms=6, ls="none", label=name, clip_on=False)
        axis.set_aspect("equal")
    figure.colorbar(drawn, ax=axes, label="w / max|w|  [-]", shrink=0.8)


def _surfaces(figure: Any, axes: Any, mesh: Mesh, shapes: Array, marks: Mapping[str, Array]) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import PolyCollection

    from femsub.components import boundary_faces, corner_nodes

    faces = corner_nodes(mesh, *boundary_faces(mesh))
    stretch = STRETCH * np.ptp(mesh.points, axis=0).max()
    scale = ScalarMappable(cmap="viridis")
    scale.set_clim(0, 1)
    for axis, u in zip(axes.ravel(), np.moveaxis(shapes, -1, 0), strict=False):
        plane, depth = seen(mesh.points + stretch * u)
        corners = plane[faces]
        side, other = corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1]
        front = np.flatnonzero(side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0] > 0)  # anticlockwise from outside
        order = front[np.argsort(depth[faces[front]].mean(axis=1))]  # the nearest is painted last
        size = np.linalg.norm(u, axis=1)[faces[order]].mean(axis=1)
        colours = scale.to_rgba(size)
        fine = len(faces) > 8000
        axis.add_collection(PolyCollection(corners[order], facecolors=colours, linewidths=0.3,
                                           edgecolors=colours if fine else (0, 0, 0, 0.3)))
        for name, at in marks.items():
            colour, marker = MARKS[name]
            at = at[np.isin(at, faces)] if np.isin(at, faces).any() else at  # corners will do
            hidden = ~np.isin(at, faces[front])
            style = {"color": colour, "ls": "none", "ms": 5 if len(at) < 30 else 3}
            axis.plot(*plane[at[~hidden]].T, marker, mec="white", mew=0.5, label=name, **style)
            axis.plot(*plane[at[hidden]].T, marker, mfc="none", mew=0.7, label=f"{name}, behind", **style)
        axis.set_aspect("equal")
        axis.autoscale_view()
        axis.set_axis_off()
    triad(axes[0, 0])
    figure.colorbar(scale, ax=axes, label="|u| / max|u|  [-]", shrink=0.8)


def seen_from() -> Array:
    """The direction towards whom it is seen by, (3,)."""
    return seen(np.eye(3))[1]


def seen(points: Array) -> tuple[Array, Array]:
    """Points as they are seen (n, 2), from the right in front and above, and how near they are (n,)."""
    ca, sa, ce, se = np.cos(AZIMUTH), np.sin(AZIMUTH), np.cos(ELEVATION), np.sin(ELEVATION)
    return points @ np.array([[-sa, ca, 0], [-se * ca, -se * sa, ce]]).T, points @ np.array([ce * ca, ce * sa, se])


def triad(axis: Any) -> None:
    """Which way x, y and z point."""
    origin = np.array([0.0, 0.05])
    for name, along in zip("xyz", seen(np.eye(3))[0], strict=True):
        axis.annotate("", origin + 0.11 * along, origin, xycoords="axes fraction", annotation_clip=False,
                      arrowprops={"arrowstyle": "->", "lw": 0.7, "shrinkA": 0, "shrinkB": 0})
        axis.text(*(origin + 0.15 * along), name, transform=axis.transAxes, fontsize=8, ha="center", va="center")
