"""`FrictionContact`: Coulomb friction between two surfaces that slide on each other, integrated over meshes that need not match."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.checks import Array, Matrix, finite_number, instance, mapping, positive_number, real_array, word
from femsub.components.mesh import Mesh
from femsub.components.solid_elements import reference, skfem
from femsub.components.ties import Surface, common_parts, picked, reach, rows_of_nodes
from femsub.errors import InputError, InputTypeError, unknown_name
from femsub.model.dof_map import TRANSLATIONS
from femsub.model.joints import GROUND, Site

if TYPE_CHECKING:
    from femsub.model.substructure import Substructure

KEPT = 8  # pairs of surfaces whose points are kept, since a sweep over μ makes a contact for each value
ALONG = 0.1  # of the sliding velocity that must lie in the surface


@dataclass(frozen=True, eq=False)
class FrictionContact:
    """Coulomb friction between a surface and a second one, or a rigid body, that slides on it.

    About steady sliding, with the unit normal n into the first body and t, the direction in which the second moves against it:

    ΔK = ∫ k N Nᵀ + μ k T Nᵀ dA,  ΔD = ∫ μ' p T Tᵀ + (μ p / V) S Sᵀ dA

    Nᵀu, Tᵀu and Sᵀu are the components along n, t and s = n × t of u_first - u_second. The pressure is p - k Nᵀu. It acts on the
    first body with the force (p - k Nᵀu)(n + μ t), and on the second with the opposite one. So friction makes K unsymmetric
    (circulatory). The last term is the damping by friction itself: a velocity along s turns the direction of sliding. It needs V.
    With a second body that turns, K has in addition -∫ (p/r)(μ S Rₛᵀ + r μ' T Rₜᵀ) dA, where R is the component along s (t) of
    ∂u₂/∂θ + e × (u₁ - u₂): the material of the second body moves through the contact.

    The integrals are taken over the common parts of the faces of both surfaces. The contact acts on the interface DOF of both
    sets, so that every basis that keeps these sets as interface represents it without error.

    Parameters
    ----------
    first, second : str
        Interface sets, as 'pad.face' of a system; or 'ground' as the second, for a rigid body. The integrals run over the first:
        give the smaller one.
    meshes : mapping of str to Mesh, or Mesh
        The meshes of both parts by their names, 'pad'. For a single part its mesh.
    stiffness : float
        k, normal stiffness per area (force / length³).
    mu : float
        Coefficient of friction μ, not negative.
    pressure : float
        p, the pressure of steady sliding (force / area), for the terms of ΔD.
    direction : array_like, shape (3,), optional
        Direction in which the second body moves.
    axis : array_like, shape (3,), optional
        In its place: the axis about which the second body turns, in the sense of a right-handed screw.
    centre : array_like, shape (3,)
        A point of the axis; by default the origin.
    speed : float, optional
        V (length / time), or with an axis Ω (rad / time), where V = Ω r. Without it there is no damping by friction, and μ' is of no
        effect on K.
    slope : float
        μ' = dμ/dV (time / length), by default 0.
    tolerance : float, optional
        Largest distance of the surfaces, in units of length; by default 0.05 of the size of a face.

    Raises
    ------
    InputError, InputTypeError
        μ < 0, p < 0, k ≤ 0; both direction and axis or neither; a velocity that is normal to the surface; surfaces that do not
        touch or do not face each other; an unknown set, when the contact is used.

    References
    ----------
    N. Gräbner, V. Mehrmann, S. Quraishi, C. Schröder, U. von Wagner, ZAMM 96 (2016) 1155, for D₁ + D_R/Ω and K₁ + K_R; N. M.
    Kinkaid, O. M. O'Reilly, P. Papadopoulos, J. Sound Vib. 267 (2003) 105 (mechanisms).

    Examples
    --------
    >>> import femsub as fs
    >>> steel, mesh = fs.Material(2.1e11, 0.3, 7850.0), fs.block((0.1, 0.05, 0.02), (4, 2, 1))
    >>> pad = fs.solid(mesh, steel, supports=["top"], interface=["bottom"])
    >>> rubbing = fs.FrictionContact("bottom", "ground", mesh, stiffness=1e12, mu=0.4, direction=(1, 0, 0))
    >>> pencil = pad.linearised(rubbing)
    >>> print(rubbing, pencil, sep="\\n")
    FrictionContact: bottom on ground, mu = 0.4, stiffness 1e+12, sliding along (1, 0, 0)
    Pencil: 135 DOF, sparse, K unsymmetric
    """

    first: str
    second: str
    meshes: Mapping[str, Mesh] | Mesh
    stiffness: float
    mu: float
    pressure: float = 0.0
    direction: Array | None = None
    axis: Array | None = None
    centre: Array | tuple[float, float, float] = (0.0, 0.0, 0.0)
    speed: float | None = None
    slope: float = 0.0
    tolerance: float | None = None

    def __post_init__(self) -> None:
        word("first", self.first)
        word("second", self.second)
        if not isinstance(self.meshes, Mesh):
            for key, mesh in mapping("meshes", self.meshes, "the parts' names and meshes").items():
                instance(f"the mesh of {key!r}", mesh, Mesh)
        positive_number("stiffness", self.stiffness)
        for name, meaning in (("mu", "the coefficient of friction; turn the direction or the axis"), ("pressure", "a pressure")):
            if finite_number(name, getattr(self, name)) < 0:
                raise InputError(f"{name} must not be negative, but is {getattr(self, name)!r}: it is {meaning}")
        if (self.direction is None) == (self.axis is None):
            raise InputError("a friction contact needs either direction=(x, y, z), in which the second body moves, or axis=(x, y, z), "
                             "about which it turns")
        for name in ("direction", "axis", "centre"):
            if getattr(self, name) is None:
                continue
            vector = real_array(name, getattr(self, name))
            if vector.shape != (3,) or (name != "centre" and not np.any(vector)):
                raise InputError(f"{name} must be three numbers" + (", not all 0" if name != "centre" else "") +
                                 f", but is {getattr(self, name)!r}")
            object.__setattr__(self, name, vector if name == "centre" else vector / np.linalg.norm(vector))
        if self.speed is not None:
            positive_number("speed", self.speed)
        finite_number("slope", self.slope)
        if self.tolerance is not None:
            positive_number("tolerance", self.tolerance)

    def __repr__(self) -> str:
        way, vector = ("along", self.direction) if self.axis is None else ("about", self.axis)
        at = "" if self.speed is None else f" at {self.speed:g}"
        return (f"FrictionContact: {self.first} on {self.second}, mu = {self.mu:g}, stiffness {self.stiffness:g}, sliding {way} "
                f"({', '.join(f'{value:.4g}' for value in np.asarray(vector))}){at}")

    @property
    def ports(self) -> tuple[str, ...]:
        """The interface sets that the contact acts on."""
        return (self.first,) if self.second == GROUND else (self.first, self.second)

    def columns(self, model: Substructure) -> Matrix:
        """W (n, p): the motion of the model's interface DOF is Wᵀq."""
        return sp.csc_array(model.interface_rows).T

    def linearised(self, model: Substructure) -> tuple[Matrix | None, Matrix]:
        """(C_D, C_K), sparse, shape (p, p), on the model's interface DOF."""
        points = self._points()
        n, t, s, r = self._directions(points)
        move = self._motions(model, points)
        N, T, S = (_along(vectors, move) for vectors in (n, t, s))
        weight = sp.diags_array(points.weight)
        normal = self.stiffness * (weight @ N)
        K = N.T @ normal + self.mu * (T.T @ normal)
        if self.speed is None or not self.pressure:
            return None, sp.csr_array(K)
        load, faster = self.pressure * points.weight, self.speed * r
        turned, fallen = sp.diags_array(self.mu * load / faster), sp.diags_array(self.slope * load)
        D = T.T @ (fallen @ T) + S.T @ (turned @ S)
        if self.axis is not None:
            carried = self.speed * self._carried(model, points)
            K = K - S.T @ (turned @ _along(s, carried)) - T.T @ (fallen @ _along(t, carried))
        return sp.csr_array(D), sp.csr_array(K)

    def _points(self) -> Points:
        surfaces = [None if name == GROUND else self._mesh(name) for name in (self.first, self.second)]
        return contact_points(surfaces[0], surfaces[1], self.tolerance)

    def _mesh(self, name: str) -> tuple[Mesh, str, str]:
        owner, _, key = name.rpartition(".")
        if isinstance(self.meshes, Mesh):
            return self.meshes, key, name
        if owner not in self.meshes:
            raise unknown_name("mesh of the part", owner, self.meshes)
        return self.meshes[owner], key, name

    def _directions(self, points: Points) -> tuple[Array, Array, Array, Array]:
        """n, t, s (q, 3), and r (q,), by which Ω is multiplied to be a velocity: 1 without an axis."""
        n = points.normal
        way = np.cross(self.axis, points.x - self.centre) if self.axis is not None else np.broadcast_to(self.direction, n.shape)
        size = np.linalg.norm(way, axis=1)
        t = way - np.einsum("qi,qi->q", way, n)[:, None] * n
        along = np.linalg.norm(t, axis=1)
        if (along <= ALONG * size).any():
            raise InputError(f"the second body of {self!r} does not slide along the surface at {points.x[np.argmin(along)].round(6)}: "
                             "its velocity is normal to it, or 0")
        t = t / along[:, None]
        return n, t, np.cross(n, t), along

    def _motions(self, model: Substructure, points: Points) -> list[Matrix]:
        """u_first - u_second at the points, one matrix (q, p) for each direction in space."""
        mine = _moved(model, self.first, points.first, points.N)
        if points.second is None:
            return mine
        return [a - b for a, b in zip(mine, _moved(model, self.second, points.second, points.far), strict=True)]

    def _carried(self, model: Substructure, points: Points) -> list[Matrix]:
        """∂u₂/∂θ + e × (u₁ - u₂) at the points, one matrix (q, p) for each direction in space."""
        apart = self._motions(model, points)
        e = np.asarray(self.axis)
        turned = [e[(i + 1) % 3] * apart[(i + 2) % 3] - e[(i + 2) % 3] * apart[(i + 1) % 3] for i in range(3)]
        if points.second is None:
            return turned
        way = np.cross(e, points.x - self.centre)
        slope = np.linalg.solve(points.J @ points.J.transpose(0, 2, 1), points.J @ way[:, :, None])[:, :, 0]  # ∂s/∂θ
        rate = _at(points.second, points.pair, np.einsum("qks,qs->qk", points.dfar, slope))
        return [a + b for a, b in zip(turned, _moved(model, self.second, points.second, rate), strict=True)]


@dataclass(frozen=True, eq=False)
class Points:
    """Points of quadrature of two surfaces that touch.

    Attributes
    ----------
    first, second : Surface
        The second is None for a rigid body.
    x, normal : ndarray, shape (q, 3)
        The unit normal points into the first body.
    weight : ndarray, shape (q,)
        Areas.
    N, far : sparse, shape (q, nodes of the surface)
        Shape functions of the first and of the second surface.
    pair, dfar, J : ndarray
        The second's faces (q,), its ∂N/∂s (q, k, 2) and ∂x/∂s (q, 2, 3).
    """

    first: Surface
    second: Surface | None
    x: Array
    normal: Array
    weight: Array
    N: Matrix
    far: Matrix | None = None
    pair: Array | None = None
    dfar: Array | None = None
    J: Array | None = None


@lru_cache(maxsize=KEPT)
def contact_points(first: tuple[Mesh, str, str], second: tuple[Mesh, str, str] | None, tolerance: float | None) -> Points:
    """The points of quadrature on the common parts of two surfaces, each given as mesh, set and name.

    Raises
    ------
    InputError
        The surfaces do not touch, or do not face each other.
    """
    ours = Surface.of(*first)
    if second is None:
        face, s, w = _own_points(ours)
        N, J = ours.tangents(face, s)
        normal = np.cross(J[:, 0], J[:, 1])
        area = np.linalg.norm(normal, axis=1)
        x = np.einsum("qk,qki->qi", N, ours.points[ours.faces[face]])
        return Points(ours, None, x, -normal / area[:, None], area * w, _at(ours, face, N))
    theirs = Surface.of(*second)
    face, pair, x, w = common_parts(ours, theirs)
    facing = np.einsum("qi,qi->q", ours.frames[face, 2], theirs.frames[pair, 2])
    to = theirs.place(pair, x)
    far, J = theirs.tangents(pair, to)
    gap = np.linalg.norm(x - np.einsum("qk,qki->qi", far, theirs.points[theirs.faces[pair]]), axis=1)
    near = gap <= reach(ours, face, tolerance)
    if not near.any():
        apart = f"they are at least {gap.min():.3g} apart" if len(gap) else "no faces of them lie opposite each other"
        raise InputError(f"{first[2]} and {second[2]} do not touch: {apart}; move a part, or give a larger tolerance")
    if (facing[near] > 0).any():
        where = x[near][np.argmax(facing[near])].round(6)
        raise InputError(f"{first[2]} and {second[2]} do not face each other at {where}: their outward normals agree; name the "
                         "surfaces that touch, or turn the cells of one mesh")
    face, pair, x, w, to, far, J = (values[near] for values in (face, pair, x, w, to, far, J))
    N, K = ours.tangents(face, ours.place(face, x))
    normal = np.cross(K[:, 0], K[:, 1])
    return Points(ours, theirs, x, -normal / np.linalg.norm(normal, axis=1)[:, None], w, _at(ours, face, N), _at(theirs, pair, far),
                  pair, theirs.shapes(pair, to)[1], J)


def _own_points(surface: Surface) -> tuple[Array, Array, Array]:
    """Faces (q,), places (q, 2) and weights (q,) of quadrature on all faces of a surface."""
    refdom = skfem().refdom.RefQuad if surface.corners == 4 else skfem().refdom.RefTri
    s, w = skfem().quadrature.get_quadrature(refdom, 2 * reference(surface.kind).degree)
    count = len(surface.faces)
    return np.repeat(np.arange(count), len(w)), np.tile(s.T, (count, 1)), np.tile(w, count)


def _at(surface: Surface, face: Array, N: Array) -> Matrix:
    """N (q, k) as a sparse matrix on the nodes of the surface."""
    rows = np.repeat(np.arange(len(N)), N.shape[1])
    return sp.csr_array(sp.coo_array((N.ravel(), (rows, surface.faces[face].ravel())), shape=(len(N), len(surface.points))))


def _moved(model: Substructure, name: str, surface: Surface, N: Matrix) -> list[Matrix]:
    """N u at the points for the motions along x, y and z, each (q, p), in the model's interface DOF."""
    if name not in model.sets:
        raise unknown_name(f"interface set of {model.name!r}", name, model.sets)
    places, known = model.sets[name], model.interface_dofs
    if known is None or known.points is None:
        raise InputTypeError(f"the DOF of {name!r} have no known places: a friction contact needs parts made of meshes")
    found = Site(model.name, name, model, places, known.kept(places), True)
    return [sp.csr_array(N @ picked(found, rows_of_nodes(found, surface, label))) for label in TRANSLATIONS]


def _along(vectors: Array, motions: list[Matrix]) -> Matrix:
    """Σ v_i U_i, (q, p): the component along a direction (q, 3)."""
    return sp.csr_array(sum(sp.diags_array(vectors[:, i]) @ motions[i] for i in range(3)))
