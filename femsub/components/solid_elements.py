"""Reference elements of solids: scikit-fem's shape functions and quadrature, in the node order of mesh files.

Kinds and node orders are meshio's (VTK's). scikit-fem's local functions are assigned to nodes by the coordinates of the nodes,
not by a table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from femsub.checks import Array, choice, package

_HEX = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], dtype=float)
_HEX_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
_HEX_FACES = ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7))  # outward
_TET = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
_TET_EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
_TET_FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))  # outward
#: six tetrahedra that fill a brick and match those of neighbouring bricks: one for each order of the axes (Kuhn)
_SIXTHS = np.array([[0, 1, 2, 6], [0, 5, 1, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 4, 5, 6], [0, 7, 4, 6]])
_HALVES = np.array([[0, 1, 2], [0, 2, 3]])  #: two triangles that fill a quadrilateral

#: kind: (scikit-fem's element, corners, groups of corners whose centres are the other nodes, faces, degree)
_TABLE: dict[str, tuple[str, Array, tuple[tuple[int, ...], ...], tuple[tuple[int, ...], ...], int]] = {
    "hexahedron": ("ElementHex1", _HEX, (), _HEX_FACES, 1),
    "hexahedron20": ("ElementHexS2", _HEX, _HEX_EDGES, _HEX_FACES, 2),
    "hexahedron27": ("ElementHex2", _HEX, (*_HEX_EDGES, *_HEX_FACES, tuple(range(8))), _HEX_FACES, 2),
    "tetra": ("ElementTetP1", _TET, (), _TET_FACES, 1),
    "tetra10": ("ElementTetP2", _TET, _TET_EDGES, _TET_FACES, 2),
}
KINDS = tuple(_TABLE)


@dataclass(frozen=True, eq=False)
class Reference:
    """A reference element with k nodes.

    Attributes
    ----------
    kind : str
    nodes : ndarray, shape (k, 3)
        Corners first, in the order of mesh files, in [0, 1]³.
    middles : tuple of tuple of int
        For each node that is not a corner, the corners with this node as their centre.
    faces : tuple of tuple of int
        The corners of each face, anticlockwise seen from outside.
    degree : int
        Degree of the shape functions (in each direction, for hexahedra).
    """

    kind: str
    nodes: Array
    middles: tuple[tuple[int, ...], ...]
    faces: tuple[tuple[int, ...], ...]
    degree: int

    @property
    def corners(self) -> int:
        return len(self.nodes) - len(self.middles)

    @property
    def edges(self) -> tuple[tuple[int, int], ...]:
        """The corners at the ends of each edge, with the lower index first."""
        ends = {(min(pair), max(pair)) for face in self.faces for pair in zip(face, (*face[1:], face[0]), strict=True)}
        return tuple(sorted(ends))


def skfem() -> Any:
    """The package scikit-fem, or an error that says how to install it."""
    return package("skfem", "finite elements need scikit-fem and meshio", "scikit-fem", "meshio")


@cache
def reference(kind: str) -> Reference:
    """The reference element of a kind, one of KINDS."""
    _, corners, middles, faces, degree = _TABLE[choice("kind of solid element", kind, KINDS)]
    rest = [corners[list(group)].mean(axis=0) for group in middles]
    return Reference(kind, np.vstack([corners, *rest]), middles, faces, degree)


@cache
def skfem_element(kind: str) -> tuple[Any, Array]:
    element = getattr(skfem(), _TABLE[kind][0])()
    apart = np.abs(reference(kind).nodes[:, None, :] - element.doflocs[None, :, :]).max(axis=2)
    return element, apart.argmin(axis=1)


def shape_functions(kind: str, X: Array, nodes: Sequence[int] | Array | None = None) -> tuple[Array, Array]:
    """N (q, k) and ∂N/∂X (q, k, 3) at reference points X (q, 3), for all nodes or some of them, in the order of mesh files."""
    element, order = skfem_element(kind)
    points = np.ascontiguousarray(X.T)
    values = [element.lbasis(points, int(i)) for i in (order if nodes is None else order[nodes])]
    return (np.stack([np.broadcast_to(value, len(X)) for value, _ in values], axis=1),
            np.stack([np.broadcast_to(gradient, X.T.shape).T for _, gradient in values], axis=1))


def quadrature(kind: str, degree: int) -> tuple[Array, Array]:
    """Points (q, 3) and positive weights (q,), exact for polynomials of `degree` (in each direction, for hexahedra)."""
    X, w = skfem().quadrature.get_quadrature(skfem_element(kind)[0].refdom, degree)
    if w.min() < 0:  # some rules for tetrahedra have a negative weight, which may give a negative mass
        return quadrature(kind, degree + 1)
    return X.T, w


def side_quadrature(corners: int, degree: int) -> tuple[Array, Array]:
    """Points s (q, d) and weights (q,) on the reference line, triangle or square, with 2, 3 or 4 `corners`."""
    refdom = getattr(skfem().refdom, {2: "RefLine", 3: "RefTri", 4: "RefQuad"}[corners])
    s, w = skfem().quadrature.get_quadrature(refdom, degree)
    return s.T, w


def on_side(kind: str, corners: Sequence[int] | Array, s: Array) -> tuple[Array, Array]:
    """Points X (q, 3) on an edge or face of the reference cell, from its corners and its coordinates s (q, d); ∂X/∂s (d, 3)."""
    around = reference(kind).nodes[list(corners)]
    tangents = around[[1, -1][:s.shape[1]]] - around[0]
    return around[0] + s @ tangents, tangents


def jacobians(points: Array, cells: Array, gradients: Array) -> Array:
    """J (m, q, 3, 3) with J_ab = ∂x_b/∂X_a = Σ_i ∂N_i/∂X_a x_ib, for cells (m, k) and gradients (q, k, 3)."""
    q, k, d = gradients.shape
    flat = gradients.transpose(0, 2, 1).reshape(q * d, k)
    return (flat @ points[cells]).reshape(len(cells), q, d, d)


def box(counts: Sequence[int] | Array, kind: str) -> tuple[Array, Array]:
    """Points (n, d) and cells (m, k) of a box of nx x ny x nz bricks, or nx x ny quadrilaterals, of edge 1.

    A brick is divided into six tetrahedra, a quadrilateral into two triangles. Coordinates are exact whole and half numbers.
    """
    size = len(counts)
    what, valid = ("solid element", KINDS) if size == 3 else ("cell of a rectangle", ("quad", "triangle"))
    choice(f"kind of {what}", kind, valid)
    points = np.stack(np.meshgrid(*(np.arange(count + 1.0) for count in counts), indexing="ij"), axis=-1).reshape(-1, size)
    corner = points[(points < counts).all(axis=1), None].astype(int) + _HEX[:2**size, :size].astype(int)
    cells = np.ravel_multi_index(tuple(np.moveaxis(corner, -1, 0)), tuple(np.add(counts, 1)))
    if kind.startswith("t"):
        split = _SIXTHS if size == 3 else _HALVES
        cells = cells[:, split].reshape(-1, split.shape[1])
    return raised(points, cells, kind) if size == 3 else (points, cells)


def raised(points: Array, cells: Array, kind: str) -> tuple[Array, Array]:
    """Points and cells with the midside nodes of a kind, each node once; cells (m, corners) become (m, k)."""
    for size in sorted({len(group) for group in reference(kind).middles}):
        groups = np.array([group for group in reference(kind).middles if len(group) == size])
        keys = np.sort(cells[:, groups].reshape(-1, size), axis=1)
        _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        middle = points[keys[first]].mean(axis=1)
        cells = np.hstack([cells, len(points) + number.reshape(len(cells), len(groups))])
        points = np.vstack([points, middle])
    return points, cells
