"""A reduced model with additional shapes: static responses to the residuals of its modes in the full component's equations.

For a mode iω, φ of the model, the residual P(iω)Vφ is not 0. The static response K⁻¹P(iω)Vφ is the first term of the basis'
error for that mode. A model with these additional shapes therefore shows how much a result depends on the truncation. This needs
a few solves with the factor of the reduction, and no solution of the full model.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from femsub.algebra import SINGULAR, orthonormal
from femsub.checks import Array
from femsub.reduction.basis import Partition

if TYPE_CHECKING:
    from femsub.model import ReducedSubstructure, Substructure


@dataclass(frozen=True, eq=False)
class Wider:
    """Extends the basis of a model, as long as the full component exists. Neither this object nor the component is pickled.

    A component of up to DENSE coordinates is `kept` alive; keeping a larger component and its factor would take too much memory.
    """

    full: weakref.ref[Substructure]
    kept: Substructure | None
    held: bool
    #: makes the part that is factorised; None: the part of the full component. A system in contact has another K
    part: Callable[[Substructure], Partition] | None = None
    known: dict[str, Partition] = field(default_factory=dict)

    def __call__(self, model: ReducedSubstructure, omega: Array, q: Array, port: str | None) -> ReducedSubstructure | None:
        """The model with the responses to P(iω)Vq, q (r, k), and to the force on a port; None if there is no full component.

        The new coordinates follow those of the model, whose matrices keep their values. The model's D may include other damping
        than the component's D.
        """
        sub, V = self.full(), model.V
        if sub is None or sub.size != len(V) or self.part is not None:
            return None
        x = V @ q
        loads = [sub.K @ x - (sub.M @ x) * omega**2, (sub.D @ x) * omega]
        if port is not None and port in sub.ports:
            loads.append(sub.port(port).reshape(sub.size, -1))
        return self.joined(model, sub, loads)

    def joined(self, model: ReducedSubstructure, sub: Substructure, loads: Sequence[Array]) -> ReducedSubstructure:
        """The model with the static responses of the full component `sub` to loads (n, k)."""
        new, = self.shapes(model, sub, [np.hstack(loads)])
        return replace(model, **self.bordered(model, sub, new), estimate=None, estimated=None)

    def shapes(self, model: ReducedSubstructure, sub: Substructure, loads: Sequence[Array]) -> list[Array]:
        """For each of the loads (n, k), the part of its static responses outside the basis, made M-orthonormal."""
        values, turn = np.linalg.eigh(model.M)
        massive = values > values[-1] * SINGULAR
        known = model.V @ (turn[:, massive] / np.sqrt(values[massive]))
        found = np.split(self.responses(sub, np.hstack(loads)), np.cumsum([one.shape[1] for one in loads])[:-1], axis=1)
        return [orthonormal(one, sub.M.__matmul__, known)[0] for one in found]

    def bordered(self, model: ReducedSubstructure, sub: Substructure, new: Array) -> dict[str, Any]:
        """The fields of the model that change if `new` columns (n, k) are appended to the basis."""
        V = model.V
        wide = np.hstack([V, new])
        M, D, K = (_bordered(own, wide.T @ (A @ new)) for own, A in ((model.M, sub.M), (model.D, sub.D), (model.K, sub.K)))
        D[len(model.D):, :len(model.D)] = (sub.D.T @ new).T @ V
        H = None if model.H is None or sub.H is None else _bordered(model.H, wide.T @ (sub.H @ new))
        ports = {name: np.concatenate([w, new.T @ sub.port(name)]) if name in sub.ports else
                 np.concatenate([w, np.zeros((new.shape[1], *w.shape[1:]))]) for name, w in model.ports.items()}
        return {"M": M, "D": D, "K": K, "H": H, "V": wide, "ports": ports, "kinds": (*model.kinds, *("residual",) * new.shape[1])}

    def responses(self, sub: Substructure, loads: Array) -> Array:
        """K⁻¹F (n, k) for loads on the full component, without rigid motion; with the interface held if the method holds it."""
        part = self.partition(sub)
        found = np.zeros(loads.shape)
        found[part.rows] = part.factored().elastic_solve(loads[part.rows])
        return found

    def partition(self, sub: Substructure) -> Partition:
        """The part that is factorised, with the K of the full component or of the system in contact."""
        if self.part is None:
            return Partition.of(sub, self.held)
        if "part" not in self.known:  # every call would make new matrices, and so a new factor
            self.known["part"] = self.part(sub)
        return self.known["part"]


def _bordered(own: Array, columns: Array) -> Array:
    """[[own, C], [Cᵀ, E]] from the columns [C; E]."""
    r = len(own)
    return np.block([[np.asarray(own), columns[:r]], [columns[:r].T, (columns[r:] + columns[r:].T) / 2]])
