"""The nonlinear model of a substructure with its contacts: forces, steady sliding, initial disturbances.

    M q̈ + D q̇ + K q = W f(Wᵀq, Wᵀq̇)

with one column of W (n, p) for each column of each contact's ports and sets, and the motion u = Wᵀq, v = Wᵀq̇ (p,) there. A belt
is a contact with f_c = F μ(v0 - v_c) on each column. This holds for full and reduced models: W of a reduced model is VᵀW.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.algebra import factorise
from femsub.checks import (
    EPS,
    Array,
    InputError,
    InputTypeError,
    Matrix,
    NotConvergedError,
    SingularMatrixError,
    finite_number,
    instance,
    naming,
    real_array,
)
from femsub.coupling import Belt, width_of
from femsub.model import ReducedSubstructure, Substructure, columns_of, contacts_of
from femsub.modes import ShiftInvert

RESIDUE = 16 * EPS  # rounding in an equilibrium, relative to the forces that cancel
SMALL_CHANGE = 1e-5  # share c of the force at rest: below it the tangent is used, with an error of c²; a difference has EPS/c


@dataclass(frozen=True, eq=False, repr=False)
class State:
    """A state of motion: displacement q and velocity q̇ in the coordinates of one model, shape (n,) each.

    Raises
    ------
    InputError, InputTypeError
        Not real numbers, or vectors of different lengths.

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
        return f"State: {len(self.displacement)} DOF, largest |q| {np.abs(self.displacement).max(initial=0.0):.4g}, " \
               f"largest |q̇| {np.abs(self.velocity).max(initial=0.0):.4g}"


@dataclass(frozen=True, eq=False, repr=False)
class Sliding:
    """M q̈ + D q̇ + K q = W f(Wᵀq, Wᵀq̇) with W (n, p): a model and its contacts.

    Attributes
    ----------
    model : Substructure
    contacts : tuple of Contact
        The contacts as they were given.
    moving : tuple
        The objects with `exerted` and `tangents`: the contacts themselves, or the results of their `in_motion`.
    W : ndarray, shape (n, p)
        The columns of all contacts side by side.
    blocks : tuple of slice
        The columns of each contact.
    """

    model: Substructure
    contacts: tuple[Any, ...]
    moving: tuple[Any, ...]
    W: Array
    blocks: tuple[slice, ...]

    def __repr__(self) -> str:
        shown = [f", {type(one).__name__} on {', '.join((*one.ports, *getattr(one, 'sets', ())))}"
                + (f" at {one.speed:g}" if isinstance(one, Belt) else "") for one in self.contacts]
        return f"Sliding: {self.model.name!r} with {self.model.size} DOF{''.join(shown)}"

    def changed(self, contacts: Sequence[Any]) -> Sliding:
        """The model with other contacts on the same columns."""
        moving = tuple(move if one is old else in_motion(one, self.model)
                       for one, old, move in zip(contacts, self.contacts, self.moving, strict=True))
        return replace(self, contacts=tuple(contacts), moving=moving)

    @property
    def kind(self) -> str:
        """The key of the model in charts: 'full' or 'reduced'."""
        return "reduced" if isinstance(self.model, ReducedSubstructure) else "full"

    @property
    def ports(self) -> list[str]:
        """The ports of all contacts, each once."""
        return list(dict.fromkeys(port for contact in self.contacts for port in contact.ports))

    @property
    def columns(self) -> int:
        return int(self.W.shape[1])

    @cached_property
    def belts(self) -> tuple[Belt, ...]:
        """The belts among the contacts."""
        return tuple(one for one in self.contacts if isinstance(one, Belt))

    @cached_property
    def speeds(self) -> Array:
        """|v0| of the belt on each column, shape (p,); 0 without one."""
        return np.repeat([abs(one.speed or 0.0) if isinstance(one, Belt) else 0.0 for one in self.contacts],
                         [rows.stop - rows.start for rows in self.blocks])

    @cached_property
    def by_speed(self) -> bool:
        """Whether f depends on the velocities only: ∂f/∂u is None for all contacts."""
        none = np.zeros(self.columns)
        return all(one.tangents(none[rows], none[rows])[0] is None for rows, one in zip(self.blocks, self.moving, strict=True))

    def exerted(self, u: Array, v: Array) -> Array:
        """f of all contacts for displacements u and velocities v of the columns, in their shape, (p,) or (p, m) at m times."""
        found = np.empty(v.shape)
        for at, one in zip(self.blocks, self.moving, strict=True):
            found[at] = one.exerted(u[at], v[at]) if v.ndim == 1 or columnwise(one) else \
                np.array([one.exerted(*pair) for pair in zip(u[at].T, v[at].T, strict=True)]).T
        return found

    def tangents(self, u: Array, v: Array) -> tuple[Array, Array]:
        """(∂f/∂u, ∂f/∂v) of all contacts, shape (p, p) or (p, p, m) each, block by block."""
        whole = of_u, of_v = np.zeros((len(v), *v.shape)), np.zeros((len(v), *v.shape))
        for rows, one in zip(self.blocks, self.moving, strict=True):
            if v.ndim == 1 or columnwise(one):
                parts = one.tangents(u[rows], v[rows])
            else:  # one time after the other; None for a derivative that is 0
                both = zip(*(one.tangents(*pair) for pair in zip(u[rows].T, v[rows].T, strict=True)), strict=True)
                parts = [None if each[0] is None else np.moveaxis(np.array(each), 0, -1) for each in both]
            for found, part in zip(whole, parts, strict=True):
                if part is not None:
                    found[rows, rows] = part
        return of_u, of_v

    def resting(self, displacement: Array) -> Array:
        """f at rest at a displacement q (n,), shape (p,)."""
        return self.exerted(self.W.T @ displacement, np.zeros(self.columns))

    def change(self, displacement: Array) -> ForceChange:
        """f(u₀ + u, v) - f(u₀, 0) as a function of u and v, with u₀ = Wᵀq for a displacement q (n,)."""
        u, still = self.W.T @ displacement, np.zeros(self.columns)
        rest = self.exerted(u, still)
        of_u, of_v = self.tangents(u, still)
        return ForceChange(self, u, rest, RESIDUE * (np.abs(rest) + np.abs(of_u) @ np.abs(u) + np.abs(of_v) @ self.speeds))

    def sticks(self, v: Array) -> Array:
        """Whether the belts stick at velocities v (p, m), see `Belt.sticks`; bool, (k, m), with a row for each belt's column."""
        return np.vstack([one.sticks(v[rows]) for rows, one in zip(self.blocks, self.contacts, strict=True)
                          if isinstance(one, Belt)])

    @property
    def without_eps(self) -> list[str]:
        """Ports of the belts whose law has no ε."""
        return [belt.port for belt in self.belts if np.isnan(width_of(belt.law))]

    @cached_property
    def static(self) -> tuple[Array, Array]:
        """K⁻¹W (n, p) and WᵀK⁻¹W (p, p).

        Raises
        ------
        InputError
            The model floats, so no support balances the friction.
        """
        handle = ShiftInvert(self.model.K, self.model.M, carried=self.model.rigid_motion)
        Z = None if handle.floating else handle.factor.solve(self.W)
        handle.release()
        if Z is None:
            raise InputError(f"{self.model.name!r} floats ({handle.rigid.shape[1]} rigid-body modes), so the belt drags it away "
                             "and there is no sliding equilibrium. Hold it with supports or springs")
        return Z, self.W.T @ Z

    def mean(self, u: Array, v: Array, begin: Array, steps: int = 50) -> tuple[Array, Array]:
        """u₀ (p,) with u₀ = WᵀK⁻¹W f₀, where f₀ is the mean of f(u₀ + u, v) over m times, and f (p, m).

        Newton's method starts from `begin`.

        Raises
        ------
        NotConvergedError
            Newton's method did not converge in `steps` steps.
        """
        H = self.static[1]
        mean, size = begin, float(np.abs(u).max())
        for _ in range(steps):
            f = self.exerted(mean[:, None] + u, v)
            rest = mean - H @ f.mean(axis=1)
            if np.abs(rest).max() <= RESIDUE * ((np.abs(mean) + np.abs(H) @ np.abs(f).mean(axis=1)).max() + size):
                return mean, f
            of_u = self.tangents(mean[:, None] + u, v)[0].mean(axis=-1)
            mean = mean - np.linalg.solve(np.eye(len(mean)) - H @ of_u, rest)
        what = "mean displacement" if size else "equilibrium"
        raise NotConvergedError(f"no {what} of {self.model.name!r} under its contacts was found in {steps} steps of Newton's "
                                "method. Give another start")

    @cached_property
    def equilibrium(self) -> Array:
        """The displacement q (n,) in steady sliding: K q = W f at rest."""
        still = np.zeros((self.columns, 1))
        return self.static[0] @ self.mean(still, still, still[:, 0])[1][:, 0]

    def pull(self, displacement: Array) -> Array:
        """W f - K q (n,), the force on a model at rest; exactly 0 if it is only rounding."""
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
            J (mass · length / time), on the first port or on the ports named.
        """
        if not isinstance(size, Mapping) and not self.ports:
            raise InputError(f"an impulse needs a port, but {' and '.join(type(one).__name__ for one in self.contacts)} acts on "
                             "no port. Name one, impulse={port: J}, or give start=")
        blows = size if isinstance(size, Mapping) else {self.ports[0]: size}
        load = np.zeros(self.model.size)
        for port, value in blows.items():
            with naming("impulse"):
                column = self.model.port(port).reshape(self.model.size, -1).sum(axis=1)
            load = load + column * finite_number(f"impulse on {port!r}", value)
        return State(self.equilibrium, mass_solve(self.model.M, load))

    def checked(self, start: State) -> State:
        """A checked copy of an initial state: finite, and of the model's size."""
        instance("start", start, State, "displacement, velocity")
        return State(self._vector("the start's displacement", start.displacement),
                     self._vector("the start's velocity", start.velocity))

    def perturbed(self, displacement: Any = 0.0, velocity: Any = 0.0) -> State:
        """The sliding equilibrium plus a displacement and a velocity in the model's coordinates, shape (n,) each."""
        return State(self.equilibrium + self._vector("displacement", displacement), self._vector("velocity", velocity))

    def _vector(self, name: str, value: Any) -> Array:
        """A copy of a vector of the model's coordinates (n,). A number gives the vector with all entries equal to it."""
        found, size = real_array(name, value), self.model.size
        if found.shape not in ((), (size,)):
            raise InputError(f"{name} must have {size} entries, one per DOF of the model, but its shape is {found.shape}. "
                             "Project a state of the full model onto a reduced one by fs.motion.project(rom, full.M, q)")
        return np.broadcast_to(found, (size,)).copy()


@dataclass(frozen=True, eq=False)
class ForceChange:
    """Δf = f(u₀ + u, v) - f(u₀, 0), shape (p,), with a relative error of about 1e-10 for any size of the motion.

    The difference of the two forces has the rounding of the forces, which may exceed Δf in a small motion. Then Δf is the tangent
    at half the motion times the motion, if it agrees with the difference within `rounding`. Otherwise the law is curved there, or
    has a kink or a jump, and the difference is used.
    """

    contact: Sliding
    place: Array  #: u₀
    rest: Array  #: f(u₀, 0)
    rounding: Array  #: the rounding of a difference of two forces

    def __call__(self, u: Array, v: Array) -> Array:
        change = self.contact.exerted(self.place + u, v) - self.rest
        small = np.abs(change) < SMALL_CHANGE * np.abs(self.rest)
        if not small.any():
            return change
        of_u, of_v = self.contact.tangents(self.place + u / 2, v / 2)
        smooth = of_u @ u + of_v @ v
        return np.where(small & (np.abs(smooth - change) <= self.rounding), smooth, change)


def sliding(model: Substructure, contacts: Any, what: str = "the nonlinear model", *, structural: bool = False) -> Sliding:
    """A model with its contacts, checked. With `structural` the caller uses the model's structural damping.

    Raises
    ------
    InputError, InputTypeError
        No contact, a belt without a friction law (a slope is not enough for nonlinear motion), two belts on one port, an unknown
        port, a contact without `exerted` and `tangents`, structural damping.
    """
    if not isinstance(model, Substructure):
        raise InputTypeError(f"{what} takes a Substructure with a port, not {type(model).__name__}")
    if not structural:
        model.viscous_only(what)
    given = contacts_of(contacts)
    if not given:
        raise InputError(f"{what} needs at least one contact, such as a Belt")
    moving = tuple(in_motion(contact, model) for contact in given)
    for contact in moving:
        if not all(callable(getattr(contact, name, None)) for name in ("exerted", "tangents")):
            raise InputTypeError(f"{what} needs what a contact exerts in motion, but {type(contact).__name__} has no "
                                 "exerted(u, v) and tangents(u, v)")
    names = [contact.port for contact in given if isinstance(contact, Belt)]
    if len(set(names)) < len(names):
        raise InputError(f"two belts act on one port: {names}. Give each its own port")
    columns = [W.toarray() if sp.issparse(W) else W for W in (columns_of(model, contact) for contact in given)]
    model.refuse_empty(model.D, model.H, *columns)
    ends = np.cumsum([0, *(W.shape[1] for W in columns)]).tolist()
    return Sliding(model, given, moving, np.hstack(columns), tuple(slice(*pair) for pair in pairwise(ends)))


def in_motion(contact: Any, model: Substructure) -> Any:
    """The object with `exerted` and `tangents` for a contact on a model: the contact itself, or the result of its `in_motion`."""
    return made(model) if callable(made := getattr(contact, "in_motion", None)) else contact


def columnwise(contact: Any) -> bool:
    """Whether the columns are independent, so that arrays of any shape are accepted (see `Contact`)."""
    return bool(getattr(contact, "columnwise", False))


def project(rom: ReducedSubstructure, M: Matrix, field: Array) -> Array:
    """The M-orthogonal projection of a field of the full model: q = M_r⁻¹ Vᵀ M u, shape (n,) or (n, k) to (r,) or (r, k).

    M (n, n) is the mass matrix of the full model. V q is the field in the basis that is nearest to u in kinetic energy.
    """
    if not isinstance(rom, ReducedSubstructure):
        raise InputTypeError(f"project takes a reduced substructure, not {type(rom).__name__}")
    rows = rom.V.shape[0]
    u = real_array("field", field)
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
        raise massless("M", "an impulse or a field of velocities has no meaning") from None
    found = handle.solve(load)
    handle.close()
    return found


def massless(matrix: str, lacks: str) -> InputError:
    """The error for a singular M."""
    return InputError(f"{matrix} is singular (massless DOF), so {lacks} there. Condense those DOF, or reduce the model first (by "
                      "Rubin: MacNeal leaves the interface without mass)")
