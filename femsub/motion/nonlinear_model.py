"""The nonlinear contact of belts with a substructure: friction forces, steady sliding, initial disturbances.

    M q̈ + D q̇ + K q = W f(Wᵀq̇),   f_c(v) = F_c μ_c(v0_c - v_c)

with one column of W (n, p) for each column of each belt's port, and v = Wᵀq̇ (p,) the speeds under the belts. Friction
stands on the right, see `friction`. Full and reduced models alike: W of a reduced one is VᵀW.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from femsub.checks import EPS, Array, Matrix, finite_number, instance, real_array
from femsub.errors import InputError, InputTypeError, SingularMatrixError
from femsub.linalg.factor import factorise
from femsub.model.friction import Belt, width_of
from femsub.model.substructure import ReducedSubstructure, Substructure
from femsub.modes.shift_invert import ShiftInvert

RESIDUE = 16 * EPS  # relative to the forces that cancel in an equilibrium: the rounding that remains


@dataclass(frozen=True, eq=False, repr=False)
class State:
    """A state of motion: displacement q and velocity q̇ in the coordinates of one model, shape (n,) each.

    Examples
    --------
    >>> import femsub as fs
    >>> fs.State(displacement=[0.0, 0.1], velocity=[0.0, 0.0])
    State: 2 DOF, largest |q| 0.1, largest |q̇| 0
    """

    displacement: Array
    velocity: Array

    def __repr__(self) -> str:
        return f"State: {len(self.displacement)} DOF, largest |q| {np.abs(self.displacement).max():.4g}, " \
               f"largest |q̇| {np.abs(self.velocity).max():.4g}"


@dataclass(frozen=True, eq=False, repr=False)
class Sliding:
    """M q̈ + D q̇ + K q = W f(Wᵀq̇) with W (n, p): a model and the belts on its ports.

    Attributes
    ----------
    model : Substructure
    belts : tuple of Belt
    W : ndarray, shape (n, p)
    owner : tuple of int, length p
        The belt to which each column belongs.
    """

    model: Substructure
    belts: tuple[Belt, ...]
    W: Array
    owner: tuple[int, ...]

    def __repr__(self) -> str:
        under = ", ".join(f"{belt.port!r} at {belt.speed:g}" for belt in self.belts)
        return f"Sliding: {self.model.name!r} with {self.model.size} DOF, belts under {under}"

    @property
    def columns(self) -> int:
        return int(self.W.shape[1])

    def _each(self, function: str, v: Array) -> Array:
        v = np.asarray(v, dtype=float)
        result = np.empty_like(v)
        for row, at in enumerate(self.owner):
            belt = self.belts[at]
            result[row] = belt.force * getattr(belt.law, function)(belt.speed - v[row])
        return result

    def force(self, v: Array) -> Array:
        """f(v) = F μ(v0 - v), in the shape of v, (p,) or (p, m): one row per column of W."""
        return self._each("value", v)

    def tangent(self, v: Array) -> Array:
        """The diagonal of df/dv = -F μ'(v0 - v), shape (p,) or (p, m). It is diagonal since each column is a separate contact."""
        return -self._each("slope", v)

    def sticks(self, v: Array) -> Array:
        """Where the contact sticks, see `Belt.sticks`; bool, in the shape of v."""
        return np.array([self.belts[at].sticks(row) for at, row in zip(self.owner, v, strict=True)])

    @property
    def widths(self) -> list[float]:
        """ε of the belts' laws; NaN for a law without one."""
        return [width_of(belt.law) for belt in self.belts]

    @property
    def without_eps(self) -> list[str]:
        """Ports of the belts whose law has no ε."""
        return [belt.port for belt, width in zip(self.belts, self.widths, strict=True) if np.isnan(width)]

    @cached_property
    def equilibrium(self) -> Array:
        """K q = W F μ(v0): steady sliding, shape (n,).

        Raises
        ------
        InputError
            The model floats, so nothing balances the friction.
        """
        handle = ShiftInvert(self.model.K, self.model.M)
        if handle.floating:
            handle.release()
            raise InputError(f"{self.model.name!r} floats ({handle.rigid.shape[1]} rigid-body modes), so the belt drags it away "
                             "and there is no sliding equilibrium. Hold it with supports or springs")
        found = handle.factor.solve(self.W @ self.force(np.zeros(self.columns)))
        handle.release()
        return found

    def pull(self, displacement: Array) -> Array:
        """W f(0) - K q (n,), the force on a model at rest; 0 where only rounding is left of it."""
        f = self.force(np.zeros(self.columns))
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
        blows = size if isinstance(size, Mapping) else {self.belts[0].port: size}
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


def sliding(model: Substructure, belts: Belt | Sequence[Belt], what: str = "the nonlinear model") -> Sliding:
    """A model with its belts, checked.

    Raises
    ------
    InputError, InputTypeError
        No belt, a belt without a friction law (a slope alone is not enough for nonlinear motion), two belts on one port, an
        unknown port.
    """
    if not isinstance(model, Substructure):
        raise InputTypeError(f"{what} takes a Substructure with a port, not {type(model).__name__}")
    contacts = (belts,) if isinstance(belts, Belt) else tuple(belts) if isinstance(belts, Sequence) else (belts,)
    for belt in contacts:
        if not isinstance(belt, Belt):
            raise InputTypeError(f"{what} takes Belts, whose friction laws it needs, not {type(belt).__name__}")
        if belt.law is None:
            raise InputError(f"the belt on port {belt.port!r} has a slope only, but {what} needs a friction law and the belt's "
                             "speed, e.g. Belt(speed=0.19113, law=StribeckArctan(eps=1e-3))")
    if not contacts:
        raise InputError(f"{what} needs at least one Belt")
    names = [belt.port for belt in contacts]
    if len(set(names)) < len(names):
        raise InputError(f"two belts act on one port: {names}. Give each its own port")
    columns = [model.port(belt.port).reshape(model.size, -1) for belt in contacts]
    owner = tuple(at for at, column in enumerate(columns) for _ in range(column.shape[1]))
    return Sliding(model, contacts, np.hstack(columns), owner)


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
