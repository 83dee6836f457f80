"""The nonlinear contact of belts with a substructure: friction forces, steady sliding, initial disturbances.

    M q̈ + D q̇ + K q = W f(Wᵀq̇),   f_c(v) = F_c μ_c(v0_c - v_c)

with one column of W (n, p) for each column of each belt's port, and v = Wᵀq̇ (p,) the speeds under the belts. Friction
stands on the right, see `friction`. Full and reduced models alike: W of a reduced one is VᵀW. Other contacts exert f(u, v),
which depends on the displacements u = Wᵀq as well, and their columns act on each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.algebra import factorise
from femsub.checks import EPS, Array, Matrix, finite_number, instance, real_array
from femsub.coupling import Belt, asked, width_of
from femsub.errors import InputError, InputTypeError, NotConvergedError, SingularMatrixError
from femsub.model import ReducedSubstructure, Substructure, columns_of, contacts_of
from femsub.modes import ShiftInvert

NEWTON = 50  # largest number of steps to an equilibrium
RESIDUE = 16 * EPS  # relative to the forces that cancel in an equilibrium: the rounding that remains
SMALL = 1e-5  # of the force at rest: a smaller change of it is taken from the tangent


@dataclass(frozen=True, eq=False, repr=False)
class State:
    """A state of motion: displacement q and velocity q̇ in the coordinates of one model, shape (n,) each.

    Raises
    ------
    InputError, InputTypeError
        Not real numbers, or not as many of both.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.State(displacement=[0.0, 0.1], velocity=[0.0, 0.0])
    State: 2 DOF, largest |q| 0.1, largest |q̇| 0
    """

    displacement: Array
    velocity: Array

    def __post_init__(self) -> None:
        for name in ("displacement", "velocity"):
            object.__setattr__(self, name, real_array(name, getattr(self, name), finite=False))
        q, v = np.shape(self.displacement), np.shape(self.velocity)
        if len(q) != 1 or v != q:
            raise InputError(f"displacement and velocity must have one number per coordinate each, but their "
                             f"shapes are {q} and {v}")

    def __repr__(self) -> str:
        return f"State: {len(self.displacement)} DOF, largest |q| {np.abs(self.displacement).max():.4g}, " \
               f"largest |q̇| {np.abs(self.velocity).max():.4g}"


@dataclass(frozen=True, eq=False, repr=False)
class Sliding:
    """M q̈ + D q̇ + K q = W f(Wᵀq, Wᵀq̇) with W (n, p): a model, the belts on its ports, and other contacts.

    Attributes
    ----------
    model : Substructure
    belts : tuple of Belt
    W : ndarray, shape (n, p)
        The belts' columns first.
    owner : tuple of int, length p
        The belt to which each column belongs; the other contacts are counted on.
    others : tuple of Contact
        Only with these f depends on u = Wᵀq, and the columns of one contact act on each other.
    """

    model: Substructure
    belts: tuple[Belt, ...]
    W: Array
    owner: tuple[int, ...]
    others: tuple[Any, ...] = ()

    def __repr__(self) -> str:
        under = ", ".join(f"{belt.port!r} at {belt.speed:g}" for belt in self.belts)
        more = ", ".join(f"{type(other).__name__} on {', '.join(places_of(other))}" for other in self.others)
        return f"Sliding: {self.model.name!r} with {self.model.size} DOF" + (f", belts under {under}" if under else "") + \
               (f", {more}" if more else "")

    @property
    def ports(self) -> list[str]:
        """The ports of all contacts, each once."""
        return list(dict.fromkeys(port for contact in (*self.belts, *self.others) for port in contact.ports))

    @property
    def columns(self) -> int:
        return int(self.W.shape[1])

    def _each(self, function: str, v: Array) -> Array:
        v = np.asarray(v, dtype=float)
        result = np.empty_like(v)
        for row, at in enumerate(self.owner):
            belt = self.belts[at]
            result[row] = belt.force * asked(belt.law, function, belt.speed - v[row])
        return result

    def force(self, v: Array) -> Array:
        """f(v) = F μ(v0 - v), in the shape of v, (p,) or (p, m): one row per column of W. Of belts only, see `exerted`."""
        return self._each("value", v)

    @cached_property
    def blocks(self) -> list[slice]:
        """The columns of each contact, belts first."""
        ends = np.searchsorted(self.owner, np.arange(len(self.belts) + len(self.others) + 1)).tolist()
        return [slice(*pair) for pair in pairwise(ends)]

    def exerted(self, u: Array, v: Array) -> Array:
        """f(u, v) of all contacts at displacements u (p,) and speeds v (p,) of the columns, shape (p,)."""
        if not self.others:
            return self.force(v)
        contacts = (*self.belts, *self.others)
        return np.concatenate([one.exerted(u[rows], v[rows]) for rows, one in zip(self.blocks, contacts, strict=True)])

    def tangents(self, u: Array, v: Array) -> tuple[Array, Array]:
        """(∂f/∂u, ∂f/∂v) of all contacts, shape (p, p) each, block by block."""
        of_u, of_v = np.zeros((self.columns, self.columns)), np.zeros((self.columns, self.columns))
        for rows, contact in zip(self.blocks, (*self.belts, *self.others), strict=True):
            of_u[rows, rows], of_v[rows, rows] = contact.tangents(u[rows], v[rows])
        return of_u, of_v

    def resting(self, displacement: Array) -> Array:
        """f at rest at a displacement q (n,), shape (p,)."""
        return self.exerted(self.W.T @ displacement, np.zeros(self.columns))

    def change(self, displacement: Array) -> Change:
        """f(u₀ + u, v) - f(u₀, 0) as a function of u and v, from a place q (n,) on with u₀ = Wᵀq."""
        u, still = self.W.T @ displacement, np.zeros(self.columns)
        rest = self.exerted(u, still)
        of_u, of_v = self.tangents(u, still)
        speeds = np.array([abs(self.belts[at].speed or 0.0) if at < len(self.belts) else 0.0 for at in self.owner])
        return Change(self, u, rest, RESIDUE * (np.abs(rest) + np.abs(of_u) @ np.abs(u) + np.abs(of_v) @ speeds))

    def tangent(self, v: Array) -> Array:
        """The diagonal of df/dv = -F μ'(v0 - v), shape (p,) or (p, m). It is diagonal since each column is a separate contact."""
        return -self._each("slope", v)

    def sticks(self, v: Array) -> Array:
        """Where the belts stick, see `Belt.sticks`; bool, one row per column of the belts, of v with a row per column of W."""
        return np.array([self.belts[at].sticks(row) for at, row in zip(self.owner, v, strict=True) if at < len(self.belts)])

    @property
    def widths(self) -> list[float]:
        """ε of the belts' laws; NaN for a law without one."""
        return [width_of(belt.law) for belt in self.belts]

    @property
    def without_eps(self) -> list[str]:
        """Ports of the belts whose law has no ε."""
        return [belt.port for belt, width in zip(self.belts, self.widths, strict=True) if np.isnan(width)]

    def _held(self) -> ShiftInvert:
        """The factor of K of a model that does not float; to be released."""
        handle = ShiftInvert(self.model.K, self.model.M, carried=self.model.rigid_motion)
        if handle.floating:
            handle.release()
            raise InputError(f"{self.model.name!r} floats ({handle.rigid.shape[1]} rigid-body modes), so the belt drags it away "
                             "and there is no sliding equilibrium. Hold it with supports or springs")
        return handle

    @cached_property
    def static(self) -> tuple[Array, Array]:
        """K⁻¹W (n, p) and WᵀK⁻¹W (p, p)."""
        handle = self._held()
        Z = handle.factor.solve(self.W)
        handle.release()
        return Z, self.W.T @ Z

    @cached_property
    def equilibrium(self) -> Array:
        """K q = W f at rest: steady sliding, shape (n,). With other contacts by Newton's method for u = WᵀK⁻¹W f(u, 0).

        Raises
        ------
        InputError
            The model floats, so nothing balances the friction.
        NotConvergedError
            Newton's method found no equilibrium.
        """
        u, still = np.zeros(self.columns), np.zeros(self.columns)
        if not self.others:
            handle = self._held()
            found = handle.factor.solve(self.W @ self.force(still))
            handle.release()
            return found
        Z, H = self.static
        for _ in range(NEWTON):
            rest = u - H @ self.exerted(u, still)
            if np.abs(rest).max() <= RESIDUE * (np.abs(u) + np.abs(H) @ np.abs(self.exerted(u, still))).max():
                return Z @ self.exerted(u, still)
            u = u - np.linalg.solve(np.eye(len(u)) - H @ self.tangents(u, still)[0], rest)
        raise NotConvergedError(f"no equilibrium of {self.model.name!r} under its contacts was found in {NEWTON} steps of "
                                "Newton's method. Give a start")

    def pull(self, displacement: Array) -> Array:
        """W f - K q (n,), the force on a model at rest; 0 where only rounding is left of it."""
        f = self.resting(displacement)
        left = self.W @ f - self.model.K @ displacement
        terms = np.abs(self.W) @ np.abs(f) + abs(self.model.K) @ np.abs(displacement)
        return left if np.abs(left).max() > RESIDUE * terms.max() else np.zeros_like(left)

    def impulse(self, size: Mapping[str, float] | float = 1e-3) -> State:
        """The state after a short impulse J on a port: q at the sliding equilibrium, q̇ = M⁻¹ W_p J.

        The same impulse is the same physical disturbance for every model: M_r⁻¹ Vᵀw J is the M-orthogonal projection of
        the full model's M⁻¹ w J. (On a unit mass J is its velocity.)

        Parameters
        ----------
        size : float or mapping of str to float
            J (mass · length / time), on the first belt's port or on the ports named.
        """
        if not isinstance(size, Mapping) and not self.ports:
            raise InputError(f"an impulse needs a port, but {' and '.join(type(one).__name__ for one in self.others)} acts on no "
                             "port. Name one, impulse={port: J}, or give start=")
        blows = size if isinstance(size, Mapping) else {self.ports[0]: size}
        load = np.zeros(self.model.size)
        for port, value in blows.items():
            column = self.model.port(port).reshape(self.model.size, -1).sum(axis=1)
            load = load + column * finite_number(f"impulse on {port!r}", value)
        return State(self.equilibrium, mass_solve(self.model.M, load))

    def checked(self, start: State) -> State:
        """A checked copy of an initial state: finite, and of the model's size."""
        instance("start", start, State, "displacement, velocity")
        parts = [(name, real_array(f"the start's {name}", getattr(start, name))) for name in ("displacement", "velocity")]
        for name, part in parts:
            if part.shape != (self.model.size,):
                raise InputError(f"the start's {name} has the shape {part.shape}, but the model has {self.model.size} DOF. "
                                 "Project a state of the full model onto a reduced one with nonlinear_model.project")
        return State(*(part.copy() for _, part in parts))

    def perturbed(self, displacement: Any = 0.0, velocity: Any = 0.0) -> State:
        """The sliding equilibrium plus a displacement and a velocity in the model's coordinates, shape (n,) each."""
        parts = [_vector(name, value, self.model.size) for name, value in
                 (("displacement", displacement), ("velocity", velocity))]
        return State(self.equilibrium + parts[0], parts[1])


@dataclass(frozen=True, eq=False)
class Change:
    """Δf = f(u₀ + u, v) - f(u₀, 0), shape (p,), to full relative accuracy however small the motion is.

    The difference of the two forces has the rounding of the forces. In a small motion nothing else may be left of it. There Δf is
    the tangent half-way times the way, if it agrees with the difference within `rounding`. If it does not, the difference stands:
    the law is curved there, or has a kink or a jump on the way. Either is right to about 1e-10 of Δf.
    """

    contact: Sliding
    place: Array  #: u₀
    rest: Array  #: f(u₀, 0)
    rounding: Array  #: of a difference of two forces

    def __call__(self, u: Array, v: Array) -> Array:
        change = self.contact.exerted(self.place + u, v) - self.rest
        small = np.abs(change) < SMALL * np.abs(self.rest)
        if not small.any():
            return change
        of_u, of_v = self.contact.tangents(self.place + u / 2, v / 2)
        smooth = of_u @ u + of_v @ v
        return np.where(small & (np.abs(smooth - change) <= self.rounding), smooth, change)


def sliding(model: Substructure, belts: Any, what: str = "the nonlinear model", others: bool = False) -> Sliding:
    """A model with its belts, and with `others` also other contacts that exert a force, checked.

    Raises
    ------
    InputError, InputTypeError
        No belt, a belt without a friction law (a slope alone is not enough for nonlinear motion), two belts on one port, an
        unknown port, a contact that does not say what it exerts.
    """
    if not isinstance(model, Substructure):
        raise InputTypeError(f"{what} takes a Substructure with a port, not {type(model).__name__}")
    given = tuple(belts) if isinstance(belts, Sequence) else (belts,)
    contacts = tuple(belt for belt in given if isinstance(belt, Belt))
    free = contacts_of(tuple(belt for belt in given if not isinstance(belt, Belt))) if others else ()
    moving = tuple(made(model) if callable(made := getattr(contact, "in_motion", None)) else contact for contact in free)
    for contact in moving:
        if not all(callable(getattr(contact, name, None)) for name in ("exerted", "tangents")):
            raise InputTypeError(f"{what} needs what a contact exerts in motion, but {type(contact).__name__} has no "
                                 "exerted(u, v) and tangents(u, v)")
    for belt in contacts if others else given:
        if not isinstance(belt, Belt):
            raise InputTypeError(f"{what} takes Belts, whose friction laws it needs, not {type(belt).__name__}")
        if belt.law is None:
            raise InputError(f"the belt on port {belt.port!r} has a slope only, but {what} needs a friction law and the belt's "
                             "speed, e.g. Belt(speed=0.19113, law=StribeckArctan(eps=1e-3))")
    if not contacts and not free:
        raise InputError(f"{what} needs at least one Belt" + (" or another contact" if others else ""))
    names = [belt.port for belt in contacts]
    if len(set(names)) < len(names):
        raise InputError(f"two belts act on one port: {names}. Give each its own port")
    columns = [columns_of(model, contact) for contact in (*contacts, *free)]
    columns = [W.toarray() if sp.issparse(W) else W for W in columns]
    owner = tuple(at for at, column in enumerate(columns) for _ in range(column.shape[1]))
    return Sliding(model, contacts, np.hstack(columns), owner, moving)


def places_of(contact: Any) -> tuple[str, ...]:
    """The ports and interface sets that a contact acts on."""
    return (*contact.ports, *getattr(contact, "sets", ()))


def project(rom: ReducedSubstructure, M: Matrix, field: Array) -> Array:
    """The M-orthogonal projection of a field of the full model: q = M_r⁻¹ Vᵀ M u, shape (n,) or (n, k) to (r,) or (r, k).

    M (n, n) is the full model's. V q is the field nearest to u in kinetic energy within the basis.
    """
    if not isinstance(rom, ReducedSubstructure):
        raise InputTypeError(f"project takes a reduced substructure, not {type(rom).__name__}")
    rows = rom.V.shape[0]
    u = np.asarray(field, dtype=float)
    if M.shape != (rows, rows) or u.ndim == 0 or u.shape[0] != rows:
        raise InputError(f"the basis has {rows} rows, but M is {M.shape} and the field {u.shape}. Give those of the full model")
    return mass_solve(rom.M, rom.V.T @ (M @ u))


def mass_solve(M: Matrix, load: Array) -> Array:
    """M⁻¹ load.

    Raises
    ------
    InputError
        M is singular.
    """
    if sp.issparse(M) and M.nnz == np.count_nonzero(M.diagonal()) == M.shape[0]:
        return (load.T / M.diagonal()).T
    try:
        handle = factorise(M, "definite")
    except SingularMatrixError:
        raise InputError("M is singular (massless DOF), so an impulse or a field of velocities has no meaning there. "
                         "Condense those DOF, or reduce the model first (by Rubin: MacNeal leaves the interface without "
                         "mass)") from None
    found = handle.solve(load)
    handle.close()
    return found


def _vector(name: str, value: Any, size: int) -> Array:
    found = real_array(name, value)
    if found.shape not in ((), (size,)):
        raise InputError(f"{name} must have {size} entries, one per DOF of the model, but its shape is {found.shape}")
    return np.broadcast_to(found, (size,)).copy()
