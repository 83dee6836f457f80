"""Pictures that are no charts: fields over two axes, mode shapes on their mesh, the parts of a system in colours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub import components
from femsub.app.figure_style import PAGE, legend_below, new_figure
from femsub.studies import look

if TYPE_CHECKING:
    from femsub import Mesh
    from femsub.checks import Array

DECADES = 3  # of the spectrograms' scale
STRETCH = 0.12  # how far the largest displacement of a solid is drawn, in parts of the mesh's largest side
MARKS = {"contact": ("black", "v"), "interface": ("#0067a5", "s")}
AZIMUTH, ELEVATION = np.radians(-60.0), np.radians(35.0)  # from where solids are seen
#: colours that also those tell apart who see no red or no green
PARTS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442", "#999999")
FINE = 8000  # cells from which on their edges are not drawn
APART = np.array([0.5, 0.5, 2.5])  # of its distance from the middle that each part is moved where parts are drawn apart
LIGHT = np.array([0.2, -0.4, 0.9])  # from where it comes, of length 1 but for rounding


def belt_sweep_figure(found: Mapping[str, Any]) -> Any:
    """max Re λ over the slope and the belt's place, with the border of stability (the paper's Fig. 3a)."""
    panels, belts, slopes = found["panels"], found["belts"], np.abs(found["slopes"])
    interfaces = list(dict.fromkeys(panel["interface"] for panel in panels))
    columns = len(panels) // len(interfaces)
    figure = new_figure(PAGE, 2.4 * len(interfaces) + 0.6)
    axes = figure.subplots(len(interfaces), columns, sharex=True, sharey=True, squeeze=False)
    top = max(float(np.max(panel["growth"])) for panel in panels)
    from matplotlib.colors import SymLogNorm

    norm = SymLogNorm(linthresh=1e-3 * top, vmin=-top, vmax=top)
    mesh = None
    for axis, panel in zip(axes.ravel(), panels, strict=True):
        growth = np.where(np.isfinite(panel["growth"]), panel["growth"], np.nan)
        mesh = axis.pcolormesh(belts, slopes, growth.T, norm=norm, cmap="RdBu_r", shading="nearest", rasterized=True)
        border = -np.array(panel["critical_slope"], dtype=float)
        axis.plot(belts, np.where(np.isfinite(border), border, np.nan), "k.-", lw=1, ms=5, label="critical slope")
        axis.set(yscale="log", title=f"{look(panel['model']).label}, {panel['interface']}")
        axis.set_xticks(belts)
    for axis in axes[-1]:
        axis.set_xlabel("belt under mass  [-]")
    for axis in axes[:, 0]:
        axis.set_ylabel("-dμ/dv  [time/length]")
    legend_below(figure, axes[0, :1])
    figure.suptitle("Growth and critical slope over the belt's place; in braces the interface")
    decades = 10.0 ** np.arange(np.ceil(np.log10(1e-2 * top)), np.log10(top))
    figure.colorbar(mesh, ax=axes, label="max Re λ  [1/time]", shrink=0.8, ticks=[*-decades[::-1], 0.0, *decades])
    return figure


def spectrogram_figure(made: Sequence[tuple[Any, Any]], highest: float) -> Any:
    """Short-time spectra side by side, on one scale (the paper's Fig. 5)."""
    from matplotlib.colors import LogNorm

    figure = new_figure(PAGE, 3.6)
    axes = figure.subplots(1, len(made), squeeze=False, sharey=True)[0]
    top = max(float(found.amplitude.max()) for _, found in made)
    scale = LogNorm(top / 10**DECADES, top)
    for axis, (item, found) in zip(axes, made, strict=True):
        inside = found.omega <= highest
        values = np.maximum(found.amplitude[inside], top / 10**DECADES)
        picture = axis.pcolormesh(found.t, found.omega[inside], values, norm=scale, shading="nearest", cmap="magma",
                                  rasterized=True)
        axis.set(title=f"{look(item.kind).label}, {item.model.size} DOF", xlabel="t  [time]", ylim=(0, highest))
        axis.locator_params(axis="x", nbins=4)
    axes[0].set_ylabel("ω  [rad/time]")
    figure.colorbar(picture, ax=list(axes), label="amplitude of v under the belt\n[length/time]")
    return figure


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

    faces = components.corner_nodes(mesh, *components.boundary_faces(mesh))
    stretch = STRETCH * np.ptp(mesh.points, axis=0).max()
    scale = ScalarMappable(cmap="viridis")
    scale.set_clim(0, 1)
    for axis, u in zip(axes.ravel(), np.moveaxis(shapes, -1, 0), strict=False):
        plane, front, _ = _front(mesh.points + stretch * u, faces)
        colours = scale.to_rgba(np.linalg.norm(u, axis=1)[front].mean(axis=1))
        axis.add_collection(PolyCollection(plane[front], facecolors=colours, linewidths=0.3,
                                           edgecolors=colours if len(faces) > FINE else (0, 0, 0, 0.3)))
        for name, at in marks.items():
            colour, marker = MARKS[name]
            at = at[np.isin(at, faces)] if np.isin(at, faces).any() else at  # corners will do
            hidden = ~np.isin(at, front)
            style = {"color": colour, "ls": "none", "ms": 5 if len(at) < 30 else 3}
            axis.plot(*plane[at[~hidden]].T, marker, mec="white", mew=0.5, label=name, **style)
            axis.plot(*plane[at[hidden]].T, marker, mfc="none", mew=0.7, label=f"{name}, behind", **style)
        axis.set_aspect("equal")
        axis.autoscale_view()
        axis.set_axis_off()
    triad(axes[0, 0])
    figure.colorbar(scale, ax=axes, label="|u| / max|u|  [-]", shrink=0.8)


def _front(points: Array, faces: Array) -> tuple[Array, Array, Array]:
    """Points as they are seen (n, 2), the faces that are turned to the viewer, the nearest last, and their unit normals."""
    plane, depth = seen(points)
    normal = np.cross(points[faces[:, 2]] - points[faces[:, 0]], points[faces[:, -1]] - points[faces[:, 1]])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    front = np.flatnonzero(normal @ seen_from() > 0)  # corners are anticlockwise from outside
    front = front[np.argsort(depth[faces[front]].mean(axis=1), kind="stable")]
    return plane, faces[front], normal[front]


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
        plane, front, normal = _front(moved[name], components.corner_nodes(
            meshes[name], *components.boundary_faces(meshes[name])))
        polygons += list(plane[front])
        fills.append((0.7 + 0.3 * np.clip(normal @ LIGHT, 0, 1))[:, None] * colours[name])
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
