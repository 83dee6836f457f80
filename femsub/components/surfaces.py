"""Surfaces of solids: their faces, points on the faces, and the common parts of two surfaces whose meshes do not match."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from femsub.checks import EQUAL, Array, InputError, Matrix, PortWarning, warn
from femsub.components.mesh import Mesh, boundary_faces, corners_of, sides_of
from femsub.components.mesh_checks import listed
from femsub.components.solid_elements import KINDS, on_side, reference, shape_functions, side_quadrature


@dataclass(frozen=True, eq=False)
class Surface:
    """The f faces within a set of nodes of a mesh, and the n nodes of these faces.

    Attributes
    ----------
    faces : ndarray, shape (f, k)
        The nodes of each face as rows of `points`, in the order of `sides_of`.
    points : ndarray, shape (n, 3)
    numbers : ndarray, shape (n,)
        The nodes' numbers, for messages.
    rows : ndarray, shape (n,)
        The nodes as rows of the mesh's points, ascending.
    """

    kind: str
    faces: Array
    points: Array
    numbers: Array
    rows: Array

    @classmethod
    def of(cls, mesh: Mesh, name: str | None, what: str) -> Surface:
        """The faces with all nodes in a set, which must have no other corners of cells; without a name, the whole surface.

        Raises
        ------
        InputError
            Plane cells; an unknown set, or a set without a whole face; corners in the set that belong to no whole face.

        Warns
        -----
        PortWarning
            Midside nodes that belong to no whole face.
        """
        if mesh.kind not in KINDS:
            raise InputError(f"{what}: the mesh {mesh.name!r} has {mesh.kind} cells; ties and contacts join the surfaces of "
                             "solids")
        cells, sides = boundary_faces(mesh)
        rows = np.take_along_axis(mesh.cells[cells], sides_of(mesh.kind, "faces")[sides], axis=1)
        if name is not None:
            rows = _within(mesh, name, rows, what)
        nodes, faces = np.unique(rows, return_inverse=True)
        return cls(mesh.kind, faces.reshape(rows.shape), mesh.points[nodes], mesh.numbers[nodes], nodes)

    @property
    def corners(self) -> int:
        return len(reference(self.kind).faces[0])

    @cached_property
    def polygons(self) -> Array:
        """The corners of each face, (f, 3 or 4, 3)."""
        return self.points[self.faces[:, :self.corners]]

    @cached_property
    def centres(self) -> Array:
        return self.polygons.mean(axis=1)

    @cached_property
    def sizes(self) -> Array:
        """The area of each face, (f,)."""
        return np.linalg.norm(self.areas, axis=1)

    @cached_property
    def border(self) -> float:
        """The total length of the border: of all edges that belong to one face only, taken as straight."""
        corners = self.faces[:, :self.corners]
        edges = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        ends, times = np.unique(edges, axis=0, return_counts=True)
        return float(np.linalg.norm(np.diff(self.points[ends[times == 1]], axis=1), axis=2).sum())

    @property
    def excess(self) -> int:
        """The additional degree of quadrature for oblique quadrilaterals, on which N is not a polynomial in x; otherwise 0."""
        if self.corners == 3:
            return 0
        # the difference between the middles of both diagonals, which is 0 in a parallelogram
        diagonals = self.polygons[:, ::2].mean(axis=1) - self.polygons[:, 1::2].mean(axis=1)
        # with six more degrees the error is below 1e-10 of the integral of N on faces of usual shape
        return 6 if np.abs(diagonals).max() > EQUAL * self.radii.max() else 0

    @cached_property
    def radii(self) -> Array:
        """The distance from the centre to the farthest corner of each face, (f,)."""
        return np.linalg.norm(self.polygons - self.centres[:, None], axis=2).max(axis=1)

    @cached_property
    def areas(self) -> Array:
        """Area times normal of each face, (f, 3): half the cross product of two edges of a triangle, or of both diagonals."""
        P = self.polygons
        return np.cross(P[:, 2] - P[:, 0], P[:, -1] - P[:, 1]) / 2

    @cached_property
    def frames(self) -> Array:
        """Two axes in the mean plane of each face, and its normal, (f, 3, 3)."""
        normal = self.areas / self.sizes[:, None]
        first = self.polygons[:, 1] - self.polygons[:, 0]
        first = first - np.einsum("fi,fi->f", first, normal)[:, None] * normal
        first = first / np.linalg.norm(first, axis=1)[:, None]
        return np.stack([first, np.cross(normal, first), normal], axis=1)


def _within(mesh: Mesh, name: str, rows: Array, what: str) -> Array:
    """The faces, among `rows` (f, k), with all nodes in a set. Corners in the set that belong to none of them are an error."""
    inside = np.zeros(len(mesh.points), dtype=bool)
    inside[mesh.nodes(name)] = True
    rows = rows[inside[rows].all(axis=1)]
    if not len(rows):
        raise InputError(f"{what}: the set {name!r} of the mesh {mesh.name!r} has no whole face of the surface, and ties and "
                         "contacts need faces. It must have all nodes of each face, midside nodes too")
    inside[rows] = False
    left = np.flatnonzero(inside)
    which = f"{len(left)} of the {len(mesh.nodes(name))} nodes of the set {name!r} (number {listed(mesh.numbers[left])})"
    if np.isin(left, corners_of(mesh)).any():
        raise InputError(f"{what}: {which} belong to no whole face within it, and a tie or contact would leave them out. Let "
                         "fs.facing choose the faces that lie opposite the other surface, or take whole faces into the set")
    if len(left):
        warn(f"{what}: {which} are midside nodes of faces that are not all in the set. They take no part", PortWarning)
    return rows


@dataclass(frozen=True, eq=False)
class Side:
    """Points on a surface: their faces (q,), and their coordinates s (q, 2) on the reference face."""

    surface: Surface
    face: Array
    s: Array

    @classmethod
    def nearest(cls, surface: Surface, face: Array, x: Array, steps: int = 20) -> Side:
        """The points of these faces (q,) that are nearest to x (q, 3), by at most `steps` steps of the Gauss-Newton method.

        Eight steps are enough if edges are straight. On curved faces steps may grow before they become small. Far from a face
        they do not converge, and the point is not a common point.
        """
        s = np.full((len(face), 2), 0.5 if surface.corners == 4 else 1 / 3)
        going = np.arange(len(face))
        for _ in range(steps):
            side = cls(surface, face[going], s[going])
            step = side.along(x[going] - side.x)
            s[going] += step
            going = going[np.abs(step).max(axis=1) > EQUAL]  # the next step would be far smaller
            if not len(going):
                break
        return cls(surface, face, s)

    @cached_property
    def shapes(self) -> tuple[Array, Array]:
        """N (q, k) and ∂N/∂s (q, k, 2) of the nodes of each face, evaluated on the first face of the reference element."""
        nodes = sides_of(self.surface.kind, "faces")[0]
        X, tangents = on_side(self.surface.kind, nodes[:self.surface.corners], self.s)
        N, gradients = shape_functions(self.surface.kind, X, nodes)
        return N, gradients @ tangents.T

    @cached_property
    def J(self) -> Array:
        """∂x/∂s, (q, 2, 3)."""
        return np.einsum("qks,qki->qsi", self.shapes[1], self.surface.points[self.surface.faces[self.face]])

    @property
    def x(self) -> Array:
        """The coordinates of the points, (q, 3)."""
        return np.einsum("qk,qki->qi", self.shapes[0], self.surface.points[self.surface.faces[self.face]])

    @property
    def N(self) -> Matrix:
        """Shape functions, sparse, shape (q, nodes of the surface)."""
        return self.sparse(self.shapes[0])

    def along(self, way: Array) -> Array:
        """The components ds (q, 2) of the tangential part of vectors (q, 3)."""
        return np.linalg.solve(self.J @ self.J.transpose(0, 2, 1), self.J @ way[:, :, None])[:, :, 0]

    def rate(self, way: Array) -> Matrix:
        """The rate of N at points that move with the velocity `way` (q, 3) in the surface, sparse, in the shape of N."""
        return self.sparse(np.einsum("qks,qs->qk", self.shapes[1], self.along(way)))

    def chosen(self, rows: Array) -> Side:
        return Side(self.surface, self.face[rows], self.s[rows])

    def sparse(self, N: Array) -> Matrix:
        at = np.repeat(np.arange(len(N)), N.shape[1]), self.surface.faces[self.face].ravel()
        return sp.csr_array(sp.coo_array((N.ravel(), at), shape=(len(N), len(self.surface.points))))


def reach(surface: Surface, face: Array, tol: float | None) -> Array:
    """The largest distance of another surface from these faces: `tol`, by default 5 % of each face's size."""
    return 0.05 * surface.radii[face] if tol is None else np.full(len(face), tol)


def common_points(ours: Surface, theirs: Surface, tol: float | None = None) -> tuple[Side, Side, Array, Array]:
    """Quadrature points on the common parts of our faces and theirs: on our side, on their side, x (q, 3), weights (q,).

    `tol` is the largest distance between the surfaces, as in `reach`.
    """
    from scipy.spatial import cKDTree

    apart = float(ours.radii.max() + theirs.radii.max())
    apart = apart if tol is None else math.hypot(apart, tol)
    several = cKDTree(ours.centres).query_ball_tree(cKDTree(theirs.centres), apart)
    face = np.repeat(np.arange(len(several)), [len(found) for found in several])
    pair = np.fromiter((i for found in several for i in found), dtype=np.intp, count=len(face))
    # two faces at an angle of 60 degrees or more do not lie on each other
    parallel = np.abs(np.einsum("pi,pi->p", ours.frames[face, 2], theirs.frames[pair, 2])) > 0.5
    face, pair = face[parallel], pair[parallel]
    flat = [np.einsum("pki,psi->pks", surface.polygons[at] - ours.centres[face][:, None], ours.frames[face, :2])
            for surface, at in ((ours, face), (theirs, pair))]
    halves = [[(0, 1, 2), (0, 2, 3)][:surface.corners - 2] for surface in (ours, theirs)]
    faces, pairs, triangles = [face[:0]], [pair[:0]], [np.zeros((0, 3, 2))]
    for mine in halves[0]:
        for yours in halves[1]:
            parts = clipped(flat[0][:, mine], flat[1][:, yours])
            for i in range(1, parts.shape[1] - 1):
                faces.append(face)
                pairs.append(pair)
                triangles.append(parts[:, [0, i, i + 1]])
    face, pair, triangle = np.concatenate(faces), np.concatenate(pairs), np.concatenate(triangles)
    area = np.abs(_cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])) / 2
    keep = area > EQUAL * EQUAL * ours.radii[face] ** 2  # smaller parts are faces that touch along a line
    face, pair, triangle, area = face[keep], pair[keep], triangle[keep], area[keep]
    degree = max(4 * reference(surface.kind).degree + surface.excess for surface in (ours, theirs))  # the degree of N_i N_j
    s, w = side_quadrature(3, degree)
    N = np.stack([1 - s[:, 0] - s[:, 1], s[:, 0], s[:, 1]], axis=1)
    x = np.einsum("qk,pks->pqs", N, triangle)
    points = ours.centres[face][:, None] + np.einsum("pqs,psi->pqi", x, ours.frames[face, :2])
    count = len(w)
    x = points.reshape(-1, 3)
    here, there = (Side.nearest(surface, np.repeat(at, count), x) for surface, at in ((ours, face), (theirs, pair)))
    return here, there, x, (2 * area[:, None] * w).ravel()


def _cross(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def clipped(P: Array, Q: Array) -> Array:
    """The common parts of triangles P and Q (p, 3, 2), pair by pair, as polygons (p, 6, 2) with repeated points.

    By I. E. Sutherland and G. W. Hodgman, Commun. ACM 17 (1974) 32: P is cut by one edge of Q after the other. Without a common
    part, all points of the polygon are equal.
    """
    turned = _cross(Q[:, 1] - Q[:, 0], Q[:, 2] - Q[:, 0]) < 0
    Q = np.where(turned[:, None, None], Q[:, ::-1], Q)
    for i in range(3):
        a, b = Q[:, i], Q[:, (i + 1) % 3]
        k = P.shape[1]
        side = _cross((b - a)[:, None], P - a[:, None])
        after, beyond = np.roll(P, -1, axis=1), np.roll(side, -1, axis=1)
        inside, crossing = side >= 0, (side >= 0) != (beyond >= 0)
        share = np.divide(side, side - beyond, out=np.zeros_like(side), where=crossing)
        points = np.stack([P, P + share[:, :, None] * (after - P)], axis=2).reshape(len(P), 2 * k, 2)
        given = np.stack([inside, crossing], axis=2).reshape(len(P), 2 * k)
        order = np.argsort(~given, axis=1, kind="stable")[:, :k + 1]
        P = np.take_along_axis(points, order[:, :, None], axis=1)
        P = np.where(np.take_along_axis(given, order, axis=1)[:, :, None], P, P[:, :1])
    return P
