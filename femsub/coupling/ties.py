"""`Tied`: surfaces of solids whose meshes do not match, glued by a mortar condition."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.checks import EQUAL, Array, Matrix, instance, mapping, naming, positive_number, word
from femsub.components import KINDS, Mesh, on_side, patch, reference, shape_functions, side_quadrature, sides_of
from femsub.coupling.joints import End, Joint, Link, nearest, site, stacked, title
from femsub.errors import InputError, InputTypeError

if TYPE_CHECKING:
    from femsub.model import DofMap, Substructure


@dataclass(frozen=True, eq=False)
class Tied(Joint):
    """Two surfaces of solids whose meshes do not match, glued (mortar method).

    ∫ ψ_i (u_a - u_b) dA = 0 for every node i of the first surface. The integrals are taken over the common parts of the faces
    of both. A state of constant stress is represented exactly, and the error falls with the order of the elements. For linear
    elements ψ are dual functions, which keep the equations sparse; for quadratic elements they are the shape functions.

    Parameters
    ----------
    first, second : (part, set)
        Interface sets of two solids. The nodes of the first follow the second. Give the finer surface first, or the one that
        lies within the other: all its faces must lie on the second surface.
    meshes : mapping of str to Mesh
        The meshes of both parts, by the names of the parts. They have sets of nodes of the same names.
    tol : float, optional
        The largest distance of the surfaces, in units of length; by default 0.05 of the size of a face.
    name : str
        For messages and multipliers.

    Raises
    ------
    InputError
        By `couple`: surfaces that lie apart, or a first one that reaches beyond the second; nodes that are not interface.

    References
    ----------
    B. I. Wohlmuth, SIAM J. Numer. Anal. 38 (2000) 989 (dual functions); M. A. Puso, Int. J. Numer. Meth. Eng. 59 (2004) 315
    (common parts of faces in space).

    Examples
    --------
    >>> import femsub as fs
    >>> steel, fine, coarse = fs.Material(2.1e11, 0.3, 7850.0), fs.block((1, 1, 1), (3, 3, 3)), fs.block((1, 1, 1), (2, 2, 2))
    >>> parts = {"a": fs.solid(fine, steel, interface=["left"]), "b": fs.solid(coarse, steel, interface=["left"])}
    >>> system = fs.couple(parts, [fs.Tied(("a", "left"), ("b", "left"), {"a": fine, "b": coarse})])
    >>> sum(part.size for part in parts.values()) - system.size == 3 * len(fine.sets["left"])
    True
    """

    first: End
    second: End
    meshes: Mapping[str, Mesh]
    tol: float | None = None
    name: str = ""

    def __post_init__(self) -> None:
        word("name", self.name)
        for key, mesh in mapping("meshes", self.meshes, "the parts' names and meshes").items():
            instance(f"the mesh of {key!r}", mesh, Mesh)
        if self.tol is not None:
            positive_number("tol", self.tol)

    def __repr__(self) -> str:
        return self.name or f"Tied({title(self.first)}, {title(self.second)})"

    def link(self, parts: Mapping[str, Substructure]) -> Link:
        """For each DOF of the first surface one equation."""
        both = []
        for name, end in (("first", self.first), ("second", self.second)):
            with naming(name):
                found = site(parts, end)
                if not found.named or found.dofs is None or found.dofs.points is None:
                    raise InputTypeError(f"{found.title} must be a named interface set of a solid, whose DOF have known places")
                if found.part not in self.meshes:
                    raise InputError(f"the mesh of {found.part!r} is missing: give meshes={{{found.part!r}: mesh, ...}}")
                both.append((found, Surface.of(self.meshes[found.part], end[1].rpartition(".")[2], found.title)))
        (one, ours), (other, theirs) = both
        T = mortar(ours, theirs, self.tol, f"{one.title} and {other.title}")
        assert one.dofs is not None and other.dofs is not None
        blocks = []
        for label in dict.fromkeys(one.dofs.labels[k] for k in one.dofs.components):
            mine, yours = motion_of_nodes(one.dofs, ours, label), motion_of_nodes(other.dofs, theirs, label)
            if (held := np.diff(mine.indptr) == 0).any():
                count = int(held.sum())
                raise InputError(f"{label} of {count} node{'s' * (count != 1)} of {one.title} is held, or no interface DOF, e.g. "
                                 f"of node {ours.numbers[int(held.argmax())]}: release it, or let {other.title} come first")
            blocks.append([(one.part, mine @ one.chosen()), (other.part, -T @ yours @ other.chosen())])
        return Link(stacked(*blocks))


@dataclass(frozen=True, eq=False)
class Surface:
    """The faces of a set of nodes of a mesh, (f,), and its nodes, (n,).

    Attributes
    ----------
    faces : ndarray, shape (f, k)
        Places of each face's nodes among those of the surface, in the order of `sides_of`.
    points : ndarray, shape (n, 3)
    numbers : ndarray, shape (n,)
        The nodes' numbers, for messages.
    """

    kind: str
    faces: Array
    points: Array
    numbers: Array

    @classmethod
    def of(cls, mesh: Mesh, name: str, what: str) -> Surface:
        if mesh.kind not in KINDS:
            raise InputError(f"{what}: the mesh {mesh.name!r} has {mesh.kind} cells; ties join the surfaces of solids")
        found = patch(mesh, name, what)
        if found.kind != "faces":
            raise InputError(f"{what}: the set {name!r} of the mesh {mesh.name!r} is made of {found.kind}, and a tie needs faces")
        rows = np.take_along_axis(mesh.cells[found.cells], sides_of(mesh.kind, "faces")[found.sides], axis=1)
        nodes, faces = np.unique(rows, return_inverse=True)
        return cls(mesh.kind, faces.reshape(rows.shape), mesh.points[nodes], mesh.numbers[nodes])

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

    @property
    def excess(self) -> int:
        """By how much the degree of quadrature is raised where N is no polynomial in x: on quadrilaterals that are oblique."""
        if self.corners == 3:
            return 0
        # the middles of both diagonals, which are one point in a parallelogram
        diagonals = self.polygons[:, ::2].mean(axis=1) - self.polygons[:, 1::2].mean(axis=1)
        # six degrees more leave less than 1e-10 of the integral of N on faces of usual shape
        return 6 if np.abs(diagonals).max() > EQUAL * self.radii.max() else 0

    @cached_property
    def radii(self) -> Array:
        """From its centre to its farthest corner, of each face."""
        return np.linalg.norm(self.polygons - self.centres[:, None], axis=2).max(axis=1)

    @cached_property
    def areas(self) -> Array:
        """Area times normal of each face, (f, 3): half the cross product of two edges of a triangle, of the diagonals else."""
        P = self.polygons
        return np.cross(P[:, 2] - P[:, 0], P[:, -1] - P[:, 1]) / 2

    @cached_property
    def frames(self) -> Array:
        """Two axes in the mean plane of each face, and its normal, (f, 3, 3)."""
        normal = self.areas / np.linalg.norm(self.areas, axis=1)[:, None]
        first = self.polygons[:, 1] - self.polygons[:, 0]
        first = first - np.einsum("fi,fi->f", first, normal)[:, None] * normal
        first = first / np.linalg.norm(first, axis=1)[:, None]
        return np.stack([first, np.cross(normal, first), normal], axis=1)


@dataclass(frozen=True, eq=False)
class Side:
    """Points on a surface: their faces (q,), and the faces' own coordinates there (q, 2)."""

    surface: Surface
    face: Array
    s: Array

    @classmethod
    def nearest(cls, surface: Surface, face: Array, x: Array, steps: int = 20) -> Side:
        """Where these faces (q,) are nearest to points x (q, 3), by Gauss-Newton in so many `steps` at most.

        Eight are enough where edges are straight. On curved faces steps may grow before they become small. Far from a face they
        do not converge, and the point is no common one.
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
        """N (q, k) and ∂N/∂s (q, k, 2) of the nodes of each face, which are those of the first face of the reference element."""
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
        """(q, 3)."""
        return np.einsum("qk,qki->qi", self.shapes[0], self.surface.points[self.surface.faces[self.face]])

    @property
    def N(self) -> Matrix:
        """Shape functions, sparse, shape (q, nodes of the surface)."""
        return self.sparse(self.shapes[0])

    def along(self, way: Array) -> Array:
        """The own coordinates (q, 2) of the part of vectors (q, 3) that is tangential."""
        return np.linalg.solve(self.J @ self.J.transpose(0, 2, 1), self.J @ way[:, :, None])[:, :, 0]

    def rate(self, way: Array) -> Matrix:
        """dN along a velocity (q, 3) in the surface, sparse, in the shape of N."""
        return self.sparse(np.einsum("qks,qs->qk", self.shapes[1], self.along(way)))

    def chosen(self, rows: Array) -> Side:
        return Side(self.surface, self.face[rows], self.s[rows])

    def sparse(self, N: Array) -> Matrix:
        at = np.repeat(np.arange(len(N)), N.shape[1]), self.surface.faces[self.face].ravel()
        return sp.csr_array(sp.coo_array((N.ravel(), at), shape=(len(N), len(self.surface.points))))


def mortar(ours: Surface, theirs: Surface, tol: float | None, what: str, *, missing: float = 1e-3) -> Matrix:
    """T (n, m), sparse, with u = T v: the motion of our nodes that glues them to the others, D u = B v.

    D_ij = ∫ ψ_i N_j dA and B_ik = ∫ ψ_i N'_k dA over the common parts of our faces and theirs. A share `missing`
    of each of our faces may lie beside theirs.

    Raises
    ------
    InputError
        The surfaces lie apart, or ours reaches beyond theirs.
    """
    here, there, x, w = common_points(ours, theirs)
    gap, limit = np.linalg.norm(x - there.x, axis=1), reach(ours, here.face, tol)
    near = gap <= limit
    area = np.linalg.norm(ours.areas, axis=1)
    covered = np.bincount(here.face[near], w[near], len(area)) / area
    if covered.min() < 1 - missing:
        worst = int(covered.argmin())
        beside = np.flatnonzero(here.face == worst)
        why = (f"the surfaces are {gap[beside].min():.3g} apart, and {limit[beside].max():.3g} is allowed" if len(beside) and
               not near[beside].any() else f"only {max(covered[worst], 0.0):.0%} of it lies on the other surface")
        nodes = ", ".join(map(str, ours.numbers[ours.faces[worst]][:ours.corners]))
        raise InputError(f"{what} cannot be tied: at the face with the nodes {nodes} of the first, {why}; move the part, give a "
                         "larger tolerance, or let the surface that lies within the other come first")
    here, there, w = here.chosen(near), there.chosen(near), w[near]
    N, load = here.N, sp.diags_array(w)
    if reference(ours.kind).degree > 1:
        from scipy.sparse.linalg import splu

        return sp.csr_array(splu(sp.csc_array(N.T @ load @ N)).solve((N.T @ load @ there.N).toarray()))
    # ψ = A N with ∫ ψ_i N_j = δ_ij ∫ N_j on each face
    local = here.shapes[0]
    mass = np.zeros((len(area), *local.shape[1:] * 2))
    np.add.at(mass, here.face, w[:, None, None] * local[:, :, None] * local[:, None, :])
    share = mass.sum(axis=2)
    A = share[:, :, None] * np.linalg.inv(mass)
    psi = here.sparse(np.einsum("pij,pj->pi", A[here.face], local))
    return sp.csr_array(sp.diags_array(1 / np.bincount(ours.faces.ravel(), share.ravel())) @ (psi.T @ load @ there.N))


def reach(surface: Surface, face: Array, tol: float | None) -> Array:
    """How far another surface may be away from these faces: `tol`, by default 5 % of each face's size."""
    return 0.05 * surface.radii[face] if tol is None else np.full(len(face), tol)


def common_points(ours: Surface, theirs: Surface) -> tuple[Side, Side, Array, Array]:
    """Points of quadrature on the common parts of our faces and theirs: on ours, on theirs, x (q, 3), weight (q,)."""
    from scipy.spatial import cKDTree

    reach = float(ours.radii.max() + theirs.radii.max())
    several = cKDTree(ours.centres).query_ball_tree(cKDTree(theirs.centres), reach)
    face = np.repeat(np.arange(len(several)), [len(found) for found in several])
    pair = np.fromiter((i for found in several for i in found), dtype=np.intp, count=len(face))
    # two faces with an angle of 60 degrees or more between them do not lie on each other
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
    keep = area > EQUAL * EQUAL * ours.radii[face] ** 2  # below, the two touch along a line
    face, pair, triangle, area = face[keep], pair[keep], triangle[keep], area[keep]
    degree = max(4 * reference(surface.kind).degree + surface.excess for surface in (ours, theirs))  # of N_i N_j
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
    """The common part of triangles P and Q (p, 3, 2), pair by pair, as polygons (p, 6, 2), some of whose points are the same.

    By I. E. Sutherland and G. W. Hodgman, Commun. ACM 17 (1974) 32: P is cut by one edge of Q after the other. No common part
    gives a single point.
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


def motion_of_nodes(dofs: DofMap, surface: Surface, label: str) -> Matrix:
    """One motion of the nodes of a surface, picked from DOF, sparse, shape (n, dofs); the row of a node that is held is empty."""
    assert dofs.points is not None
    labels = [dofs.labels[k] for k in dofs.components]
    place, apart = nearest(surface.points, dofs.points, [label] * len(surface.points), labels)
    nodes = np.flatnonzero(apart <= EQUAL * np.abs(surface.points).max())
    return sp.csr_array((np.ones(len(nodes)), (nodes, place[nodes])), shape=(len(place), dofs.size))
