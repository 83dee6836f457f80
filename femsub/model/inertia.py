"""`Inertia`: the inertia forces of rigid accelerations on a model, and its rigid mass matrix."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from femsub.algebra import Frozen, same
from femsub.checks import EPS, Array, Matrix
from femsub.model.dof_map import DofMap


@dataclass(frozen=True, eq=False)
class Supported(Frozen):
    """The DOF held by supports, which are not in the model's matrices: their mass M_fh (n, h), M_hh (h, h), and their DOF map."""

    coupling: Matrix
    mass: Matrix
    dofs: DofMap


@dataclass(frozen=True, eq=False)
class Inertia:
    """P (n, 6) and W (6, 6) of rigid accelerations along x, y, z and about these axes through the origin of coordinates.

    P = M_ff R_f + M_fh R_h,   W = RᵀMR over all DOF, with R of `DofMap.rigid`, f the model's DOF, h the DOF held by supports.

    If the supports have the acceleration a, the motion u relative to them fulfils M ü + D u̇ + K u = -P a. In the coordinates of
    a basis, u = V q, the forces are VᵀP, and W is the same.
    """

    forces: Array
    mass: Array
    belong: Matrix | None = None  # M of the reduced model that this inertia is valid for

    @classmethod
    def of(cls, R: Array, P: Array, supported: Supported | None) -> Inertia:
        """The inertia of a full part with rigid motions R (n, 6) and P = MR, including the mass of supported DOF."""
        W = R.T @ P
        if supported is not None:
            H = supported.dofs.rigid(np.zeros(3))
            beside = supported.coupling @ H
            both = R.T @ beside
            P, W = P + beside, W + both + both.T + H.T @ (supported.mass @ H)
        return cls(np.asarray(P), np.asarray((W + W.T) / 2))

    @property
    def acting(self) -> Array:
        """Indices of the rigid accelerations that accelerate any mass."""
        mass = self.mass.diagonal()
        return np.flatnonzero(mass > EPS * mass.max(initial=0.0))

    def projected(self, V: Any) -> Inertia:
        """The same in the coordinates of a basis V (n, r)."""
        return Inertia(np.asarray(V.T @ self.forces), self.mass)

    def belonging(self, M: Matrix) -> Inertia | None:
        """The same, valid for this M of a reduced model; None if it was made for another M."""
        return replace(self, belong=M) if self.belong is None or same(self.belong, M) else None

    def about(self, origin: Array) -> Inertia:
        """The same with rotations about another point x₀: θ × (x - x₀) = θ × x + x₀ × θ."""
        x, y, z = origin
        T = np.eye(6)
        T[:3, 3:] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
        return replace(self, forces=self.forces @ T, mass=T.T @ self.mass @ T)

    def record(self) -> dict[str, Any]:
        """The entries of a file."""
        return {"forces": self.forces.tolist(), "mass": self.mass.tolist()}

    @classmethod
    def of_record(cls, record: dict[str, Any], size: int) -> Inertia:
        """The inertia from its `record`. A KeyError, TypeError or ValueError means that the record is damaged."""
        found = cls(np.array(record["forces"], dtype=float).reshape(size, 6), np.array(record["mass"], dtype=float).reshape(6, 6))
        if not (np.isfinite(found.forces).all() and np.isfinite(found.mass).all()):
            raise ValueError
        return found
