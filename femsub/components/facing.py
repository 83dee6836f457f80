"""`facing`: the faces of one surface that lie opposite another surface, and the share of both areas that has a partner."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from femsub.checks import (
    EQUAL,
    POSITION,
    Array,
    InputError,
    InputTypeError,
    PortWarning,
    instance,
    mapping,
    naming,
    positive_number,
    shown,
    unknown_name,
    warn,
    word,
)
from femsub.components.mesh import Mesh
from femsub.components.surfaces import Surface, common_points, reach


@dataclass(frozen=True, eq=False, repr=False)
class Facing:
    """The faces of a second surface that lie opposite a first surface, see `facing`.

    `Tied`, `FrictionContact` and the `interface` of `solid` accept a `Facing` directly.

    Attributes
    ----------
    first, second : (str, str)
        Part and set of each surface. The second set is a new set, with the nodes of these faces.
    meshes : mapping of str to Mesh
        The meshes of both parts; the second mesh has the new set.
    nodes : ndarray, shape (n,)
        The nodes of the faces as rows of the second mesh's points.
    faces : ndarray, shape (f, k)
        The nodes of each face as rows of the second mesh's points, corners first.
    areas : (float, float)
        The area of the whole first surface, and of these faces of the second.
    coverage : (float, float)
        The share of each of these areas that has a partner, 0 to 1.
    tol : float or None
        The largest distance, as given to `facing`.

    Examples
    --------
    >>> import femsub as fs
    >>> import numpy as np
    >>> low, high = fs.block((1.0, 1.0, 1.0), (2, 2, 1)), fs.block((1.0, 1.0, 0.5), (3, 3, 1))
    >>> high = fs.Mesh(high.points + [0.0, 0.0, 1.0], high.cells, high.kind, high.sets)
    >>> found = fs.facing(("b", "bottom"), "a", {"a": low, "b": high})
    >>> np.round(found.coverage, 9).tolist(), found.faces.shape
    ([1.0, 1.0], (4, 8))
    """

    first: tuple[str, str]
    second: tuple[str, str]
    meshes: Mapping[str, Mesh]
    nodes: Array
    faces: Array
    areas: tuple[float, float]
    coverage: tuple[float, float]
    tol: float | None

    def __repr__(self) -> str:
        first, second = map(".".join, (self.first, self.second))
        return (f"Facing: {percent(self.coverage[0])} of {first} (area {self.areas[0]:.4g}) and {percent(self.coverage[1])} of "
                f"{second} ({self.areas[1]:.4g}; {len(self.faces)} faces, {len(self.nodes)} nodes) have a partner")

    def sets_in(self, mesh: Mesh) -> dict[str, Array]:
        """The node sets of the surfaces in a mesh, which must be the mesh of the first part, of the second part, or of both."""
        found = {}
        for part, name in (self.first, self.second):
            own = self.meshes[part]
            if np.array_equal(mesh.points, own.points) and np.array_equal(mesh.cells, own.cells):
                found[name] = own.nodes(name)
        if not found:
            raise InputError(f"the mesh {mesh.name!r} is neither that of {self.first[0]!r} nor that of {self.second[0]!r}, "
                             "between which these faces were found")
        return found


def facing(first: tuple[str, str], second: tuple[str, str] | str, meshes: Mapping[str, Mesh], tol: float | None = None, *,
           name: str = "") -> Facing:
    """The faces of a second surface that lie opposite a first surface, such as the faces of a disc's track under a pad.

    A face is included if a part of it is nearer to the first surface than `tol`, and if the outward normals are opposed. Nodes of
    both surfaces need not match. The share of both areas with a partner is computed on the common parts of the faces, with
    straight edges.

    Parameters
    ----------
    first : (part, set)
        The smaller surface, of a solid: all of it should have a partner.
    second : (part, set) or part
        The surface whose faces are searched; a part alone means its whole surface.
    meshes : mapping of str to Mesh
        The meshes of both parts, by the names of the parts.
    tol : float, optional
        The largest distance between the surfaces, in units of length; by default 0.05 of the size of a face of the first.
    name : str
        The name of the new set; by default it contains the names of both surfaces.

    Warns
    -----
    PortWarning
        A part of the first surface has no partner, with its share and area. Differences in the last digit of coordinates are
        ignored.

    Raises
    ------
    InputError, InputTypeError
        An unknown part or set, a set without whole faces, cells that are not solid cells; surfaces that lie apart or do not face
        each other.

    Examples
    --------
    >>> import femsub as fs
    >>> from dataclasses import replace
    >>> disc, pad = fs.block((0.4, 0.2, 0.02), (8, 4, 1)), fs.block((0.1, 0.1, 0.01), (3, 3, 1))
    >>> pad = replace(pad, points=pad.points + [0.12, 0.04, 0.02])
    >>> fs.facing(("pad", "bottom"), "disc", {"pad": pad, "disc": disc})
    Facing: 100 % of pad.bottom (area 0.01) and 44 % of disc.facing-pad-bottom (0.0225; 9 faces, 40 nodes) have a partner
    """
    for part in mapping("meshes", meshes, "the parts' names and meshes"):
        word("the name of a part in meshes", part)
    ours, where = _end("first", first)
    theirs, among = (second, None) if isinstance(second, str) else _end("second", second)
    for part in (ours, theirs):
        if part not in meshes:
            raise unknown_name("mesh of the part", part, meshes)
        instance(f"the mesh of {part!r}", meshes[part], Mesh)
    if tol is not None:
        positive_number("tol", tol)
    titles = f"{ours}.{where}", theirs if among is None else f"{theirs}.{among}"
    with naming("first"):
        one = Surface.of(meshes[ours], where, titles[0])
    with naming("second"):
        other = Surface.of(meshes[theirs], among, titles[1])
    here, there, x, w = common_points(one, other, tol)
    gap = np.linalg.norm(x - there.x, axis=1)
    opposed = np.einsum("qi,qi->q", one.frames[here.face, 2], other.frames[there.face, 2])
    near = gap <= reach(one, here.face, tol)
    met = near & (opposed < 0)
    if not met.any():
        why = ("their outward normals agree; name the surfaces that touch, or turn the cells of one mesh" if near.any() else
               f"they are {gap[opposed < 0].min():.3g} apart; move a part, or give a larger tol" if (opposed < 0).any() else
               "no face of one lies before a face of the other; move a part")
        raise InputError(f"{' and '.join(titles)} do not face each other: {why}")
    face, pair, w, turned = here.face[met], there.face[met], w[met], -opposed[met]
    # without faces that overlap only in a strip as wide as the last digits of the coordinates
    key = face * len(other.faces) + pair
    order = np.argsort(key, kind="stable")
    first_of = np.flatnonzero(np.diff(key[order], prepend=-1))
    x, size = x[met][order], np.add.reduceat(w[order], first_of)
    extent = np.linalg.norm(np.maximum.reduceat(x, first_of) - np.minimum.reduceat(x, first_of), axis=1)
    chosen = np.unique(pair[order][first_of][size > digits(one, other) * extent])
    faces = other.rows[other.faces[chosen]]
    nodes = np.unique(faces)
    set_name = word("name", name) or "-".join([*([among] if among else []), "facing", ours.replace(".", "-"), where])
    found = Facing((ours, where), (theirs, set_name), {ours: meshes[ours], theirs: meshes[theirs].with_sets(**{set_name: nodes})},
                   nodes, faces, (float(one.sizes.sum()), float(other.sizes[chosen].sum())),
                   (covered(one, face, w), covered(other, pair, w / turned, chosen)), tol)
    warn_of_uncovered(one, other, found.coverage[0], tol, *titles)
    return found


def covered(surface: Surface, face: Array, area: Array, chosen: Array | None = None) -> float:
    """The share of a surface, or of its chosen faces, that areas (q,) on faces (q,) cover. No face counts more than once."""
    parts, sizes = np.bincount(face, area, len(surface.faces)), surface.sizes
    if chosen is not None:
        parts, sizes = parts[chosen], sizes[chosen]
    return float(np.minimum(parts, sizes).sum() / sizes.sum())


def digits(one: Surface, other: Surface) -> float:
    """The distance by which coinciding points may differ, since coordinates in files have few digits."""
    return POSITION * float(max(np.abs(one.points).max(), np.abs(other.points).max()))


def warn_of_uncovered(one: Surface, other: Surface, share: float, tol: float | None, first: str, second: str) -> None:
    """Warns if only a share of the first surface lies on the second, unless the last digits of coordinates explain it."""
    area = float(one.sizes.sum())
    if share < 1 - digits(one, other) * one.border / area:
        within = reach(one, np.arange(len(one.faces)), tol).max()
        warn(f"only {percent(share)} of {first} lies on {second} (straight edges, within {within:.3g}): {percent(1 - share)} "
             f"of its area of {area:.4g} has no partner there, and nothing acts on it. Move a part, refine the meshes, name a "
             "larger second surface, or give a larger tol", PortWarning)


def percent(share: float) -> str:
    """A share as '100 %', '99.0 %' or '44 %': both the share and its difference from 1 have two digits."""
    least = 100 * min(share, 1 - share)
    return f"{100 * share:.{max(0, 1 - int(np.floor(np.log10(least * (1 + EQUAL))))) if least > 100 * EQUAL else 0}f} %"


def _end(what: str, end: Any) -> tuple[str, str]:
    if not isinstance(end, (tuple, list)) or len(end) != 2 or not all(isinstance(one, str) for one in end):
        raise InputTypeError(f"{what} must be (part, set), as ('pad', 'face'), not {shown(end)}")
    return end[0], end[1]
