"""`FrictionContact`: Coulomb friction between surfaces that slide on each other, integrated over meshes that need not match.

`FrictionInMotion` is its nonlinear force on one model in motion, with the tangents of the force.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import scipy.sparse as sp

from femsub.checks import (
    Array,
    InputError,
    InputTypeError,
    Matrix,
    PortWarning,
    finite_number,
    instance,
    mapping,
    positive_number,
    real_array,
    unknown_name,
    warn,
    word,
)
from femsub.components import (
    Facing,
    Mesh,
    Side,
    Surface,
    common_points,
    covered,
    reach,
    reference,
    side_quadrature,
    warn_of_uncovered,
)
from femsub.coupling.joints import GROUND, Joint, Link
from femsub.coupling.ties import motion_of_nodes, unpacked
from femsub.model import TRANSLATIONS, DofMap, Substructure


@dataclass(frozen=True, eq=False)
class FrictionContact(Joint):
    """Coulomb friction between a surface and a second surface, or a rigid body, that slides on it.

    About steady sliding, with the unit normal n into the first body and the direction t of the second body's relative motion:

    ΔK = ∫ k N Nᵀ + μ k T Nᵀ dA,  ΔD = ∫ μ' p T Tᵀ + (μ p / V) S Sᵀ dA

    Nᵀu, Tᵀu and Sᵀu are the components along n, t and s = n × t of u_first - u_second. The pressure is p - k Nᵀu. The force
    (p - k Nᵀu)(n + μ t) acts on the first body, and the opposite force on the second. So friction makes K unsymmetric
    (circulatory). The last term is the damping by friction itself: a velocity along s turns the direction of sliding. It needs V.
    If the second body turns, K also contains -∫ (μ p / r) S Rₛᵀ + μ' p Ω T Rₜᵀ dA, where Rₛ and Rₜ are the components of
    ∂u₂/∂θ + e × (u₁ - u₂): the material of the second body moves through the contact.

    These are the derivatives of the force (p - k Nᵀu)(n + μ(|v|) v/|v|), where v is the sliding velocity in the surface. The
    surfaces neither separate nor stick. p is uniform and moves with the first surface, so there are no terms of its gradient.

    Other terms with p but without k are neglected. At a wavelength L they are about p / (k L) of the terms with k. They come from
    surfaces that tilt or stretch, which turns n and t and changes the area (follower forces). They also come from bodies that
    move relative to each other in the surface, which meet at other places. With a `direction`, the motion of the second body's
    material through the contact is neglected, too.

    In motion (`transient`, `harmonic_balance`, `shoot`) this force acts without linearisation, less its value in steady sliding.
    Displacements are measured from steady sliding. If a pressure is given, the surfaces separate where the pressure would become
    negative. Below 1 % of V, friction is proportional to the sliding velocity and replaces sticking.

    A friction contact is also a joint without equations. Among the joints of `couple` it declares which parts meet, so `couple`
    accepts a part that no other joint connects. The contact itself must be given to the analysis as well.

    The integrals are taken over the common parts of the faces of both surfaces. The contact acts on the interface DOF of both
    sets, so every basis that keeps these sets as interface represents it without error.

    Parameters
    ----------
    first, second : str
        Interface sets, as 'pad.face' of a system; or 'ground' as the second, for a rigid body. The integrals run over the first
        surface: give the smaller surface first.
    meshes : mapping of str to Mesh, or Mesh
        The meshes of both parts by the parts' names, as 'pad'. For a single part its mesh. A `Facing` as `first` replaces both
        surfaces, meshes and tol.
    stiffness : float
        k, normal stiffness per area (force / length³).
    mu : float
        Coefficient of friction μ, not negative.
    pressure : float
        p, the pressure in steady sliding (force / area), for all terms without k.
    direction : array_like, shape (3,), optional
        The direction in which the second body moves.
    axis : array_like, shape (3,), optional
        Instead of `direction`: the axis about which the second body turns, in the sense of a right-handed screw.
    centre : array_like, shape (3,)
        A point on the axis; by default the origin.
    speed : float, optional
        V (length / time), or with an axis Ω (rad / time), where V = Ω r. Without a speed only the terms with k exist.
    slope : float
        μ' = dμ/dV (time / length), by default 0.
    tol : float, optional
        Largest distance between the surfaces, in units of length; by default 0.05 of the size of a face.

    Raises
    ------
    InputError, InputTypeError
        μ < 0, p < 0, k ≤ 0; both direction and axis, or neither. When the contact is used: a velocity that is normal to the
        surface; surfaces that do not touch or do not face each other; an unknown set.

    Warns
    -----
    PortWarning
        When the contact is used: a part of the first surface does not touch the second; the axis is oblique to the surface, so
        that the second body also moves along the normal.

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
    Pencil: 156 DOF, sparse, K unsymmetric
    """

    first: str
    second: str = None  # type: ignore[assignment]
    meshes: Mapping[str, Mesh] | Mesh = field(default_factory=dict)
    stiffness: float = None  # type: ignore[assignment]
    mu: float = None  # type: ignore[assignment]
    pressure: float = 0.0
    direction: Array | None = None
    axis: Array | None = None
    centre: Array | tuple[float, float, float] = (0.0, 0.0, 0.0)
    speed: float | None = None
    slope: float = 0.0
    tol: float | None = None

    def __post_init__(self) -> None:
        if isinstance(self.first, Facing):
            unpacked(self, self.first, ".".join(self.first.first), ".".join(self.first.second))
        word("first", self.first)
        word("second", self.second)
        if not isinstance(self.meshes, Mesh):
            for key, mesh in mapping("meshes", self.meshes, "the parts' names and meshes").items():
                instance(f"the mesh of {key!r}", mesh, Mesh)
        positive_number("stiffness", self.stiffness)
        for name, instead in (("mu", "to reverse the friction, turn the direction or the axis"), ("pressure", "it presses")):
            if finite_number(name, getattr(self, name)) < 0:
                raise InputError(f"{name} must not be negative, but is {getattr(self, name)!r}: {instead}")
        if (self.direction is None) == (self.axis is None):
            raise InputError("a friction contact needs either direction=(x, y, z), in which the second body moves, or "
                             "axis=(x, y, z), about which it turns")
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
        if self.tol is not None:
            positive_number("tol", self.tol)

    def __repr__(self) -> str:
        way, vector = ("along", self.direction) if self.axis is None else ("about", self.axis)
        at = "" if self.speed is None else f" at {self.speed:g}"
        return (f"FrictionContact: {self.first} on {self.second}, mu = {self.mu:g}, stiffness {self.stiffness:g}, sliding {way} "
                f"({', '.join(f'{value:.4g}' for value in np.asarray(vector))}){at}")

    @property
    def ports(self) -> tuple[str, ...]:
        """None: the contact acts on `sets`."""
        return ()

    @property
    def sets(self) -> tuple[str, ...]:
        """The interface sets of both surfaces."""
        return (self.first,) if self.second == GROUND else (self.first, self.second)

    @property
    def affine(self) -> tuple[str, ...]:
        """μ, k, p and μ' are factors of terms. V divides a term that exists only if μ and p are not 0."""
        free = self.speed is None or not self.pressure or not self.mu
        return ("mu", "stiffness", "pressure", "slope", *(("speed",) if free else ()))

    @property
    def affine_through(self) -> dict[str, tuple[Callable[[Any], Any] | None, ...]]:
        """1/V is a factor of the damping by friction itself. Ω is a factor of the term with μ' in K, if the second body turns."""
        carried = self.axis is not None and self.slope
        return {"speed": tuple(of for of, there in ((np.reciprocal, self.mu), (None, carried)) if there)}

    def link(self, parts: Mapping[str, Substructure]) -> Link:
        """A `Link` without equations and springs: it declares that these parts meet. Whether they touch is checked here."""
        owners = [name.partition(".")[0] for name in self.sets]
        for owner in owners:
            if owner not in parts:
                raise unknown_name("part", owner, parts)
        self._points()
        return Link(motions={owner: sp.csr_array((0, parts[owner].size)) for owner in owners}, grounded=self.second == GROUND)

    def linearised(self, model: Substructure) -> tuple[Matrix | None, Matrix]:
        """(C_D, C_K), sparse, (p, p), on the DOF of both sets: minus the tangents of the force in motion, at steady sliding.

        C_K = k (A + μ B) + p (μ C + μ' Ω E) and C_D = p (μ/Ω F + μ' G). The matrices A to G are kept for later calls.
        """
        points = self._points()
        sides = [model.sets[name].tobytes() if name in model.sets else None for name in self.sets]
        ways = [np.array(way, dtype=float).tobytes() for way in (self.direction, self.axis, self.centre)]  # None is NaN
        key = (self.sets, *sides, *ways)
        dofs = model.interface_dofs
        known, pressed, moving = (None, [], []) if dofs is None else points.terms.get(dofs, (None, [], []))
        slides = self.speed is not None and self.pressure > 0
        if known != key or (slides and not moving):
            turning = replace(self, pressure=float(slides), speed=1.0)
            exerting = replace(turning._exerting(model, points, *self._directions(points)), slope=0.0)
            still = replace(exerting, speed=None, stiffness=1.0)
            (A,), (both,) = (replace(still, mu=mu).at_rest() for mu in (0.0, 1.0))
            pressed = [A, both - A]
            moving = [replace(exerting, stiffness=0.0, mu=mu, slope=1.0 - mu).at_rest() for mu in (1.0, 0.0)] if slides else []
            assert dofs is not None  # otherwise `_motions` has raised an error
            points.terms[dofs] = key, pressed, moving
        K = float(self.stiffness) * (pressed[0] + float(self.mu) * pressed[1])
        if not slides:
            return None, sp.csr_array(K)
        (C, F), (E, G) = moving
        speed, p, mu, slope = (float(value or 0.0) for value in (self.speed, self.pressure, self.mu, self.slope))
        return sp.csr_array(p * (mu / speed * F + slope * G)), sp.csr_array(K + p * (mu * C + slope * speed * E))

    def _exerting(self, model: Substructure, points: Points, n: Array, t: Array, s: Array, r: Array) -> FrictionInMotion:
        move = self._motions(model, points)
        turns = self.speed is not None and self.pressure > 0
        carried = None
        if turns and self.axis is not None:
            moved = [float(self.speed or 0.0) * motion for motion in self._carried(model, points)]
            carried = _along(t, moved), _along(s, moved)
        N, T, S = (_along(vectors, move) for vectors in (n, t, s))
        return FrictionInMotion(N, T, S, carried, points.weight, float(self.speed or 0.0) * r if turns else None,
                                float(self.stiffness), float(self.pressure), float(self.mu), float(self.slope))

    def sliding(self, model: Substructure) -> tuple[Matrix, Matrix, Array] | None:
        """N and T at the points of contact (q, p), and the sliding motion S (p, m) of the second body; None without friction.

        `Substructure.check_held` needs them: the contact resists motions along N, friction drives motions along T, and S is the
        steady sliding itself. None also if the rigid motion of a DOF is not known.
        """
        if not self.mu:
            return None
        points = self._points()
        n, t, *_ = self._directions(points)
        N, T = (_along(vectors, move) for move in [self._motions(model, points)] for vectors in (n, t))
        if self.second == GROUND:
            return N, T, np.zeros((N.shape[1], 0))
        dofs = model.interface_dofs.kept(model.sets[self.second])  # type: ignore[union-attr]
        if dofs.no_rigid:
            return None
        way = np.zeros(6)
        way[slice(0, 3) if self.axis is None else slice(3, 6)] = self.direction if self.axis is None else self.axis
        return N, T, np.append(np.zeros(len(model.sets[self.first])), dofs.rigid(np.asarray(self.centre)) @ way)[:, None]

    def in_motion(self, model: Substructure) -> FrictionInMotion:
        """The force of the contact on a model in motion, for `transient` and limit cycles."""
        points = self._points()
        return self._exerting(model, points, *self._directions(points)).dense()

    def patch_loads(self, model: Substructure, degree: int) -> Array:
        """Forces (n, k) of smooth tractions along n and t on the first surface: ∫ N P_j dA and ∫ T P_j dA, for all j.

        P_j are products of Legendre polynomials up to `degree` in two coordinates of the patch. Used as ports, they add to the
        first body's basis its static responses to the tractions of the second surface: few shapes for many DOF.
        """
        points = contact_points(self._mesh(self.first), None, self.tol)
        move = _moved(model, self.first, points.first, points.first.N)
        x = points.x - np.average(points.x, axis=0, weights=points.weight)
        axes = np.linalg.eigh(x.T @ (points.weight[:, None] * x))[1]  # in ascending order of extent; the first is the normal
        legendre = [np.polynomial.legendre.legvander(2 * (at - at.min()) / np.ptp(at) - 1, degree) for at in (x @ axes[:, 1:]).T]
        P = np.stack([legendre[0][:, i] * legendre[1][:, j] for i in range(degree + 1) for j in range(degree + 1 - i)], axis=1)
        n, t, *_ = self._directions(points)
        forces = np.hstack([_along(way, move).T @ (points.weight[:, None] * P) for way in (n, t)])
        return np.asarray(model.interface_rows[model.sets[self.first]].T @ forces)

    def _points(self) -> Points:
        surfaces = [None if name == GROUND else self._mesh(name) for name in (self.first, self.second)]
        points = contact_points(surfaces[0], surfaces[1], self.tol)
        if points.second is not None:
            warn_of_uncovered(points.first.surface, points.second.surface, points.share, self.tol, self.first, self.second)
        return points.without_shapes()

    def _mesh(self, name: str) -> tuple[Mesh, str, str]:
        owner, _, key = name.rpartition(".")
        if isinstance(self.meshes, Mesh):
            return self.meshes, key, name
        if owner not in self.meshes:
            raise unknown_name("mesh of the part", owner, self.meshes)
        return self.meshes[owner], key, name

    def _directions(self, points: Points, oblique: float = 0.02) -> tuple[Array, Array, Array, Array]:
        """n, t, s (q, 3), and the radius r (q,) with V = Ω r; r = 1 without an axis.

        Warns if more than the share `oblique` of the turning second body's velocity is along the normal.
        """
        n = points.normal
        turning = self.axis is not None
        given = np.asarray(self.axis if turning else self.direction)
        way = np.cross(given, points.x - self.centre) if turning else np.tile(given, (len(n), 1))
        size = np.linalg.norm(way, axis=1)
        t = way - np.einsum("qi,qi->q", way, n)[:, None] * n
        along = np.linalg.norm(t, axis=1)  # V/Ω with an axis; a direction has the length 1
        if (along <= 0.1 * size).any():  # within 6 degrees of the normal
            where = points.x[np.argmin(along)].round(6)
            raise InputError(f"the second body of {self!r} does not slide along the surface at {where}: its velocity is 0 there, "
                             "or normal to it")
        if turning:
            # The axis must be normal to a flat surface. On a curved surface, the mean normal velocity of each face is compared:
            # the normals of flat faces differ from the normals of the curved surface, but the differences cancel in each face.
            if np.ptp(n, axis=0).max() < 1e-3:  # flat, within the digits of the coordinates of small faces
                share = float(np.linalg.norm(np.cross(given, n[0])))
                off = f"{np.degrees(np.arcsin(min(share, 1.0))):.3g} degrees from the normal of this flat surface"
            else:
                face = np.unique(points.first.face, return_inverse=True)[1]
                area = np.bincount(face, points.weight)
                away = np.bincount(face, points.weight * np.einsum("qi,qi->q", way, n)) / area
                speed = np.bincount(face, points.weight * size) / area
                share = float(np.sqrt((area @ away**2) / (area @ speed**2)))
                off = f"{share:.0%} of the velocity of the second body is along the normal"
            if share > oblique:
                warn(f"the axis ({', '.join(f'{value:.4g}' for value in given)}) is oblique to {self.first}: {off}. The second "
                     "body parts from it on one side and presses on the other; only the velocity along the surface counts. Give "
                     "axis and centre about which the surface is one of revolution", PortWarning)
        t = t / along[:, None]
        return n, t, np.cross(n, t), along if turning else np.ones(len(n))

    def _motions(self, model: Substructure, points: Points) -> list[Matrix]:
        """u_first - u_second at the points, one matrix (q, p) for each direction in space."""
        mine = _moved(model, self.first, points.first, points.first.N)
        if points.second is None:
            return mine
        theirs = _moved(model, self.second, points.second, points.second.N)
        return [sp.csr_array(sp.hstack([a, -b])) for a, b in zip(mine, theirs, strict=True)]

    def _carried(self, model: Substructure, points: Points) -> list[Matrix]:
        """∂u₂/∂θ + e × (u₁ - u₂) at the points, one matrix (q, p) for each direction in space."""
        apart, e = self._motions(model, points), np.asarray(self.axis)
        turned = [e[(i + 1) % 3] * apart[(i + 2) % 3] - e[(i + 2) % 3] * apart[(i + 1) % 3] for i in range(3)]
        if points.second is None:
            return turned
        way = np.cross(e, points.x - self.centre)
        moved = _moved(model, self.second, points.second, points.second.rate(way))
        return [a + sp.hstack([sp.csr_array((len(way), a.shape[1] - b.shape[1])), b]) for a, b in zip(turned, moved, strict=True)]


@dataclass(frozen=True, eq=False, repr=False)
class FrictionInMotion:
    """The force f(u, v) of a `FrictionContact` about steady sliding, where u = 0, v = 0 and f = 0.

    At each point the pressure is P = max(p - k Nᵀu, 0), and the second body slides on the first body with the velocity
    w = (V - Tᵀv + Tᵣᵀu) t - (Sᵀv - Sᵣᵀu) s; the terms with u exist if the second body turns. The force on the first body is
    P n + μ(|w|) P w/|w|, less its value in steady sliding. Without a speed or a pressure, the sliding direction is always t.
    Without a pressure, the surfaces do not separate.

    Attributes
    ----------
    N, T, S : sparse or dense, shape (q, p)
        The relative displacements at q points along n, t and s.
    carried : (matrix, matrix) or None
        Tᵣ and Sᵣ (q, p).
    area, speed : ndarray, shape (q,)
        The area of each point, and V. The speed is None if the sliding direction does not change.
    slow : float
        Share of V below which friction is proportional to the sliding velocity, so that its direction has no jump.
    """

    N: Matrix
    T: Matrix
    S: Matrix
    carried: tuple[Matrix, Matrix] | None
    area: Array
    speed: Array | None
    stiffness: float
    pressure: float
    mu: float
    slope: float
    slow: float = 0.01

    def exerted(self, u: Array, v: Array) -> Array:
        """f(u, v), shape (p,)."""
        more, _ = self._pressed(u)
        if self.speed is None:
            return self.N.T @ (self.area * more) + self.mu * (self.T.T @ (self.area * more))
        along, across, _, mu, _ = self._sliding(u, v)
        P = self.pressure + more
        return (self.N.T @ (self.area * more) + self.T.T @ (self.area * (mu * P * along - self.mu * self.pressure))
                + self.S.T @ (self.area * (mu * P * across)))

    def tangents(self, u: Array, v: Array) -> tuple[Array, Array | None]:
        """(∂f/∂u, ∂f/∂v), shape (p, p) each; None for a derivative that is 0 everywhere."""
        of_u, *of_v = (A.toarray() if sp.issparse(A) else A for A in self._derivatives(u, v))
        return of_u, of_v[0] if of_v else None

    def at_rest(self) -> list[Matrix]:
        """-∂f/∂u, and -∂f/∂v unless it is 0, at u = 0 and v = 0."""
        rest = np.zeros(self.N.shape[1])
        return [-A for A in self._derivatives(rest, rest)]

    def dense(self, most: int = 100_000) -> FrictionInMotion:
        """The same with dense matrices, if each has at most `most` entries: sparse products of small matrices take longer."""
        if np.prod(self.N.shape) > most:
            return self
        N, T, S, *carried = (A.toarray() for A in (self.N, self.T, self.S, *(self.carried or ())))
        return replace(self, N=N, T=T, S=S, carried=tuple(carried) or None)

    def _derivatives(self, u: Array, v: Array) -> list[Matrix]:
        """∂f/∂u, and ∂f/∂v unless it is 0."""
        more, touching = self._pressed(u)
        normal = self._by(-self.stiffness * touching, self.N)
        if self.speed is None:
            return [self.N.T @ normal + self.mu * (self.T.T @ normal)]
        along, across, slow, mu, moves = self._sliding(u, v)
        P = self.pressure + more
        turned = mu * P / slow  # derivative of the friction force by a velocity normal to it
        fallen = moves * (self.slope * P - turned)
        blocks = turned + fallen * along**2, fallen * along * across, turned + fallen * across**2
        of_v = -self._squared(blocks, (self.T, self.S))
        of_u = self.N.T @ normal + self.T.T @ _scaled(mu * along, normal) + self.S.T @ _scaled(mu * across, normal)
        if self.carried is not None:
            of_u = of_u + self._squared(blocks, self.carried)
        return [of_u, of_v]

    def _pressed(self, u: Array) -> tuple[Array, Array]:
        """P - p, and whether the surfaces touch, at each point."""
        more = -self.stiffness * (self.N @ u)
        touching = more > -self.pressure if self.pressure else np.ones(len(more), dtype=bool)
        return np.where(touching, more, -self.pressure), touching

    def _sliding(self, u: Array, v: Array) -> tuple[Array, Array, Array, Array, Array]:
        """The components of w/|w| along t and s, |w|, μ(|w|), and whether |w| is above the limit of `slow`, at each point."""
        assert self.speed is not None
        along, across = self.speed - self.T @ v, -(self.S @ v)
        if self.carried is not None:
            along, across = along + self.carried[0] @ u, across + self.carried[1] @ u
        size = np.hypot(along, across)
        slow = np.maximum(size, self.slow * self.speed)
        return along / slow, across / slow, slow, self.mu + self.slope * (slow - self.speed), size >= slow

    def _by(self, factor: Array, A: Matrix) -> Matrix:
        """The rows of A times factors and areas."""
        return _scaled(factor * self.area, A)

    def _squared(self, blocks: tuple[Array, Array, Array], right: tuple[Matrix, Matrix]) -> Matrix:
        """[Tᵀ Sᵀ] [[a, b], [b, c]] times the pair `right`, with areas as weights."""
        a, b, c = blocks
        return self.T.T @ (self._by(a, right[0]) + self._by(b, right[1])) + \
            self.S.T @ (self._by(b, right[0]) + self._by(c, right[1]))


def _scaled(factor: Array, A: Matrix) -> Matrix:
    return sp.diags_array(factor) @ A if sp.issparse(A) else factor[:, None] * A


@dataclass(frozen=True, eq=False)
class Points:
    """The quadrature points of two surfaces that touch.

    Attributes
    ----------
    first, second : Side
        The second is None for a rigid body.
    x : ndarray, shape (q, 3)
    weight : ndarray, shape (q,)
        The area of each point.
    share : float
        The share of the first surface that touches the second.
    """

    first: Side
    second: Side | None
    x: Array
    weight: Array
    share: float = 1.0
    #: the matrices of the last contact, by the model's DOF map, for sweeps, which make a contact for each value
    terms: WeakKeyDictionary[DofMap, tuple[Any, list[Matrix], list[list[Matrix]]]] = field(default_factory=WeakKeyDictionary)

    def without_shapes(self) -> Points:
        """The same points; shape functions that they evaluate go with them. They take as much memory as all of `terms`."""
        return replace(self, first=replace(self.first), second=None if self.second is None else replace(self.second))

    @cached_property
    def normal(self) -> Array:
        """The unit normal into the first body, (q, 3)."""
        outward = np.cross(self.first.J[:, 0], self.first.J[:, 1])
        return -outward / np.linalg.norm(outward, axis=1)[:, None]


@lru_cache(maxsize=8)  # a sweep over μ makes a contact for each value, with the same few pairs of surfaces
def contact_points(first: tuple[Mesh, str, str], second: tuple[Mesh, str, str] | None, tol: float | None) -> Points:
    """The quadrature points on the common parts of two surfaces, each given as mesh, set and name.

    Raises
    ------
    InputError
        The surfaces do not touch, or do not face each other.
    """
    ours = Surface.of(*first)
    if second is None:
        s, w = side_quadrature(ours.corners, 4 * reference(ours.kind).degree)  # the degree of N_i N_j times the area element
        count = len(ours.faces)
        side = Side(ours, np.repeat(np.arange(count), len(w)), np.tile(s, (count, 1)))
        return Points(side, None, side.x, np.tile(w, count) * np.linalg.norm(np.cross(side.J[:, 0], side.J[:, 1]), axis=1))
    side, far, x, w = common_points(ours, Surface.of(*second), tol)
    gap = np.linalg.norm(x - far.x, axis=1)
    near = gap <= reach(ours, side.face, tol)
    if not near.any():
        apart = f"they are at least {gap.min():.3g} apart" if len(gap) else "no faces of them lie opposite each other"
        raise InputError(f"{first[2]} and {second[2]} do not touch: {apart}; move a part, or give a larger tolerance")
    side, far, x, w = side.chosen(near), far.chosen(near), x[near], w[near]
    facing = np.einsum("qi,qi->q", ours.frames[side.face, 2], far.surface.frames[far.face, 2])
    if (facing > 0).any():
        raise InputError(f"{first[2]} and {second[2]} do not face each other at {x[np.argmax(facing)].round(6)}: their outward "
                         "normals agree; name the surfaces that touch, or turn the cells of one mesh")
    return Points(side, far, x, w, covered(ours, side.face, w))


def _moved(model: Substructure, name: str, side: Side, N: Matrix) -> list[Matrix]:
    """The displacements along x, y and z at the points, three matrices (q, p) on the DOF of an interface set."""
    if name not in model.sets:
        raise unknown_name(f"interface set of {model.name!r}", name, model.sets)
    known = model.interface_dofs
    if known is None or known.points is None:
        raise InputTypeError(f"the DOF of {name!r} have no known places: a friction contact needs parts made of meshes")
    dofs = known.kept(model.sets[name])
    return [N @ motion_of_nodes(dofs, side.surface, label) for label in TRANSLATIONS]


def _along(vectors: Array, motions: list[Matrix]) -> Matrix:
    """Σ v_i U_i, (q, p): the component of the motions along the directions `vectors` (q, 3)."""
    return sp.csr_array(sum(sp.diags_array(vectors[:, i]) @ motions[i] for i in range(3)))
