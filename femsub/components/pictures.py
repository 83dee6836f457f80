"""Pictures of meshes: mode shapes, and the parts of a system in colours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from itertools import cycle
from typing import Any

import numpy as np

from femsub.checks import Array, package
from femsub.components.mesh import Mesh, boundary_faces, corner_nodes
from femsub.output import PAGE, SIZES, legend_below, new_figure

MARKS = {"contact": ("black", "v"), "interface": ("#0067a5", "s")}
AZIMUTH, ELEVATION = np.radians(-60.0), np.radians(35.0)  # direction from which solids are seen
#: colours that readers with red-green colour blindness can distinguish, too
PARTS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442", "#999999")
#: marks on solids, on whose colours black and blue are hardly visible
MARKS_ON_SOLIDS = {"contact": ("#e41a1c", "v"), "interface": ("#ff7f00", "s")}
APART = np.array([0.5, 0.5, 2.5])  # parts drawn apart are moved by these shares of their distance from the middle
# contour levels of a plate's deflection: smooth shades would show streaks of the mesh, and a level at 0 would zigzag
LEVELS = np.linspace(-1.0, 1.0, 22)
SHARP = np.cos(np.radians(40.0))  # cosine of the angle between the normals of two faces above which their edge is drawn
LIGHT = np.array([0.2, -0.4, 0.9])  # direction towards the light, of length 1 up to rounding


def shapes_figure(mesh: Mesh, shapes: Array, titles: Sequence[str], title: str, marks: Mapping[str, Array]) -> Any:
    """Fields (nodes, 3, k) with the largest displacement 1, side by side. `marks` are nodes, as rows of the mesh, by name."""
    from matplotlib.tri import Triangulation

    count, flat = len(titles), mesh.dimension < 3
    columns = min(count, 3 if mesh.dimension > 1 else 2)
    rows = -(-count // columns)
    aspect = np.ptp((mesh.points if flat else seen(mesh.points)[0])[:, :2], axis=0)
    high = float(np.clip(aspect[1] / aspect[0], 0.3, 2.0)) if mesh.dimension > 1 else 0.0
    width, height = {1: (4.6, 1.9), 2: (4.0, 0.5 + 3.3 * high), 3: (4.0, 0.4 + 3.6 * high)}[mesh.dimension]
    figure = new_figure(width * columns + (1.0 if mesh.dimension > 1 else 0), height * rows + 0.8)
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    order = np.argsort(mesh.points[:, 0])
    for axis, u, label in zip(axes.ravel(), np.moveaxis(shapes, -1, 0), titles, strict=False):
        axis.set_title(label)
        if not flat:
            scale = draw_solid(axis, mesh, u, marks)
            continue
        x, w = mesh.points[:, 0], u[:, 2]
        if mesh.dimension == 1:
            axis.axhline(0, color="grey", lw=0.6)
            axis.plot(x[order], w[order], color="black", lw=1.2)
            axis.set(ylim=(-1.2, 1.2))
            axis.grid()
        else:
            cells = mesh.cells if mesh.kind == "triangle" else mesh.cells[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
            scale = axis.tricontourf(Triangulation(x, mesh.points[:, 1], triangles=cells), np.clip(w, -1, 1), levels=LEVELS,
                                     cmap="RdBu_r")
            axis.set_aspect("equal")
        for name, at in [(name, at) for name, at in marks.items() if len(at)]:
            colour, marker = MARKS[name]
            place, edge = (w[at], colour) if mesh.dimension == 1 else (mesh.points[at, 1], "white")
            axis.plot(x[at], place, marker, color=colour, mec=edge, ms=6, ls="none", label=name, clip_on=mesh.dimension == 1)
    if mesh.dimension == 2:
        figure.colorbar(scale, ax=axes, label="w / max|w|  [-]", shrink=0.8, ticks=np.linspace(-1.0, 1.0, 9))
    elif not flat:
        triad(axes[0, 0])
        figure.colorbar(scale, ax=axes, label="|u| / max|u|  [-]", shrink=0.8)
    for axis in axes.ravel()[count:]:
        axis.set_visible(False)
    for axis in axes[-1] if flat else ():
        axis.set_xlabel("x  [length]")
    for axis in axes[:, 0] if flat else ():
        axis.set_ylabel("w / max|w|  [-]" if mesh.dimension == 1 else "y  [length]")
    legend_below(figure, axes.ravel(), 5)
    figure.suptitle(title)
    return figure


def shapes_window(mesh: Mesh, shapes: Array, titles: Sequence[str], title: str) -> Any:
    """The fields of `shapes_figure` as a `pyvista.Plotter`: `.show()` opens a window, or a view in a notebook."""
    from matplotlib.font_manager import findfont

    pyvista = package("pyvista", "shapes in a window need PyVista", "pyvista")
    points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.points.shape[1])))
    faces = corner_nodes(mesh, *boundary_faces(mesh)) if mesh.dimension == 3 else mesh.cells
    cells = np.column_stack([np.full(len(faces), faces.shape[1]), faces]).ravel()
    columns = min(len(titles), 3)
    window = pyvista.Plotter(shape=(-(-len(titles) // columns), columns), title=title)
    for k, (u, label) in enumerate(zip(np.moveaxis(shapes, -1, 0), titles, strict=True)):
        window.subplot(*divmod(k, columns))
        moved = points + SIZES.stretch * np.ptp(points, axis=0).max() * u
        body = pyvista.PolyData(moved, **{"lines" if mesh.dimension == 1 else "faces": cells})
        body["displacement / largest  [-]"] = np.linalg.norm(u, axis=1)
        window.add_mesh(body, clim=(0, 1), cmap="viridis", show_edges=mesh.dimension > 1)
        window.add_text(label, font_size=8, font_file=findfont("DejaVu Sans"))  # the fonts of VTK have no ω
    window.link_views()
    return window


def draw_solid(axis: Any, mesh: Mesh, u: Array, marks: Mapping[str, Array]) -> Any:
    """Draws a deformed solid with its outline at rest, and marks at nodes; returns the scale of the colours."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import LineCollection, PolyCollection

    faces = corner_nodes(mesh, *boundary_faces(mesh))
    scale = ScalarMappable(cmap="viridis")
    scale.set_clim(0, 1)
    stretch = SIZES.stretch * np.ptp(mesh.points, axis=0).max()
    plane, front, _ = _front(mesh.points + stretch * u, faces)
    corners, sizes = (mesh.points + stretch * u)[faces], np.linalg.norm(u, axis=1)[faces]
    lines = np.zeros((0, 4, 3))
    cut = faces.shape[1] == 4 and SIZES.pieces**2 * len(faces) <= SIZES.fine
    if cut:  # small pieces improve the order from far to near, and the colours
        # edges, each divided into pieces, which are faces without area
        shown = corners[_normals(corners) @ seen_from() > 0]
        ends, next_ends = shown[:, :, None], np.roll(shown, -1, axis=1)[:, :, None]
        places = ends + np.linspace(0.0, 1.0, SIZES.pieces + 1)[:, None] * (next_ends - ends)
        first, last = places[:, :, :-1].reshape(-1, 3), places[:, :, 1:].reshape(-1, 3)
        lines = np.stack([first, last, last, first], axis=1)
        corners, sizes = _cut(corners), _cut(sizes)
    normal = _normals(corners)
    facing = normal @ seen_from() > 0
    colours = scale.to_rgba(sizes[facing].mean(axis=1))
    colours[:, :3] *= (0.8 + 0.2 * np.clip(normal[facing] @ LIGHT, 0, 1))[:, None]
    black = np.broadcast_to([0.0, 0.0, 0.0, 0.3], (len(lines), 4))
    depth = [seen(one.reshape(-1, 3))[1].reshape(one.shape[:2]).mean(axis=1) for one in (corners[facing], lines)]
    order = np.argsort(np.concatenate([depth[0], depth[1] + SIZES.nearer * stretch]), kind="stable")
    pieces = [seen(one)[0] for one in (*corners[facing], *lines)]
    paint, width = np.concatenate([colours, black]), np.repeat([0.3, 0.4], [len(colours), len(lines)])
    around = paint[order] if cut or len(faces) > SIZES.fine else (0, 0, 0, 0.3)
    axis.add_collection(PolyCollection([pieces[at] for at in order], facecolors=paint[order], edgecolors=around,
                                       linewidths=width[order]))
    # the outline at rest: edges of the surface that are sharp, or where it turns away from the viewer
    at_rest, outward = seen(mesh.points)[0], _normals(mesh.points[faces])
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    edges, first, which = np.unique(np.sort(sides, axis=1), axis=0, return_index=True, return_inverse=True)
    face = np.repeat(np.arange(len(faces)), faces.shape[1])
    other = np.empty(len(edges), dtype=int)  # each edge has two faces, or one twice
    other[which.ravel()] = face  # the last one
    one, towards = face[first], outward @ seen_from() > 0
    sharp = (outward[one] * outward[other]).sum(axis=1) < SHARP
    kept = (towards[one] | towards[other]) & (sharp | (towards[one] != towards[other]))
    axis.add_collection(LineCollection(list(at_rest[edges[kept]]), colors="0.25", linewidths=0.6, linestyles=":"))
    axis.plot([], [], color="0.25", lw=0.9, ls=":", label="at rest")
    # arrows from points at rest to their moved places, if the motion is within the surface, since the body would look unmoved
    resting, outward = faces[towards], outward[towards]
    mean = stretch * u[resting].mean(axis=1)
    if np.sum((mean * outward).sum(axis=1) ** 2) < SIZES.slides**2 * np.sum(mean**2):
        at = np.unique(resting)
        at = at[np.linspace(0, len(at) - 1, min(SIZES.arrows, len(at))).astype(int)]
        axis.quiver(*at_rest[at].T, *seen(stretch * u[at])[0].T, angles="xy", scale_units="xy", scale=1.0, width=0.004,
                    color="#c44e00", zorder=4)
    # marks
    for name, at in marks.items():
        colour, marker = MARKS_ON_SOLIDS[name]
        at = at[np.isin(at, faces)] if np.isin(at, faces).any() else at  # corners of faces are enough
        hidden = ~np.isin(at, front)
        style = {"color": colour, "ls": "none", "ms": 5 if len(at) < 30 else 3}
        if not hidden.all():
            axis.plot(*plane[at[~hidden]].T, marker, mec="white", mew=0.5 * (len(at) < 30), label=name, **style)
        if hidden.any():
            axis.plot(*plane[at[hidden]].T, marker, mfc="none", mew=0.7, label=f"{name}, behind", **style)
    axis.set_aspect("equal")
    axis.autoscale_view()
    axis.set_axis_off()
    return scale


def _cut(corners: Array) -> Array:
    """Faces with four corners (m, 4, ...), each divided into SIZES.pieces x SIZES.pieces smaller faces (bilinear)."""
    ends = np.linspace(0.0, 1.0, SIZES.pieces + 1)
    s, t = (one.ravel() for one in np.meshgrid(np.arange(SIZES.pieces), np.arange(SIZES.pieces)))
    s, t = ends[np.stack([s, s + 1, s + 1, s], axis=1)], ends[np.stack([t, t, t + 1, t + 1], axis=1)]
    weights = np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], axis=-1)
    found = np.einsum("qcn,mn...->mqc...", weights, corners)
    return np.asarray(found.reshape(-1, 4, *corners.shape[2:]))


def _normals(corners: Array) -> Array:
    """Unit normals of faces (m, k, 3), whose corners are anticlockwise seen from outside."""
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1])
    length = np.linalg.norm(normal, axis=1)[:, None]
    return np.asarray(normal / np.where(length > 0, length, 1.0))


def _front(points: Array, faces: Array) -> tuple[Array, Array, Array]:
    """Points in the plane of the picture (n, 2), the faces turned to the viewer, the nearest last, and their unit normals."""
    plane, depth = seen(points)
    normal = _normals(points[faces])
    front = np.flatnonzero(normal @ seen_from() > 0)
    front = front[np.argsort(depth[faces[front]].mean(axis=1), kind="stable")]
    return plane, faces[front], normal[front]


def seen_from() -> Array:
    """The direction towards the viewer, (3,)."""
    return seen(np.eye(3))[1]


def seen(points: Array) -> tuple[Array, Array]:
    """Points in the plane of the picture (n, 2), seen from the front right and above, and their nearness to the viewer (n,)."""
    ca, sa, ce, se = np.cos(AZIMUTH), np.sin(AZIMUTH), np.cos(ELEVATION), np.sin(ELEVATION)
    return points @ np.array([[-sa, ca, 0], [-se * ca, -se * sa, ce]]).T, points @ np.array([ce * ca, ce * sa, se])


def triad(axis: Any) -> None:
    """Draws the directions of x, y and z."""
    origin = np.array([0.0, 0.05])
    for name, along in zip("xyz", seen(np.eye(3))[0], strict=True):
        axis.annotate("", origin + 0.11 * along, origin, xycoords="axes fraction", annotation_clip=False,
                      arrowprops={"arrowstyle": "->", "lw": 0.7, "shrinkA": 0, "shrinkB": 0})
        axis.text(*(origin + 0.15 * along), name, transform=axis.transAxes, fontsize=8, ha="center", va="center")


def parts_figure(meshes: Mapping[str, Mesh], title: str) -> Any:
    """Parts in colours: plane parts with their cells; solids joined, and drawn apart."""
    from matplotlib import colormaps
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch

    palette: Sequence[Any] = PARTS if len(meshes) <= len(PARTS) else [colormaps["tab20"](number) for number in range(20)]
    colours: dict[str, Any] = {name: np.array(to_rgb(colour)) for name, colour in zip(meshes, cycle(palette), strict=False)}
    solid = next(iter(meshes.values())).dimension == 3
    figure = new_figure(PAGE if solid else 0.8 * PAGE, 4.4 if solid else 5.0)
    axes = figure.subplots(1, 2 if solid else 1, squeeze=False)[0]
    edge: dict[str, Any] = {"edgecolors": (0, 0, 0, 0.35),
                            "linewidths": 0.3 if sum(len(mesh.cells) for mesh in meshes.values()) < SIZES.fine else 0.0}
    for axis, apart in zip(axes, (np.zeros(3), APART), strict=False):
        if solid:
            middle = np.mean([mesh.points.mean(axis=0) for mesh in meshes.values()], axis=0)
            moved = {name: mesh.points + apart * (mesh.points.mean(axis=0) - middle) for name, mesh in meshes.items()}
            polygons: list[Array] = []
            fills = []
            for name in _far_to_near(moved):  # the visible faces, the nearest last
                plane, front, normal = _front(moved[name], corner_nodes(
                    meshes[name], *boundary_faces(meshes[name])))
                polygons += list(plane[front])
                fills.append((0.7 + 0.3 * np.clip(normal @ LIGHT, 0, 1))[:, None] * colours[name])
            axis.add_collection(PolyCollection(polygons, facecolors=np.concatenate(fills), **edge))
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


def _far_to_near(points: Mapping[str, Array]) -> list[str]:
    """The parts in the order of painting: a part on the viewer's side of a plane x, y or z = const comes later."""
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
