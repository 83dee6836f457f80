"""`Origin`: the full model behind a reduced model, and a bound on the modes left out by all reductions but the last."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from femsub.checks import Array, Matrix


@dataclass(frozen=True, eq=False)
class Origin:
    """The origin of the coordinates q (r,) of a reduced model. `reduce` creates it; `frequency_bounds` needs it.

    Attributes
    ----------
    size : int
        r, the number of coordinates.
    dofs : int
        DOF of the full model, before all reductions.
    cutoff : float
        All modes that the last reduction left out are above. Earlier reductions may have left out lower modes.
    left_out : float
        An upper bound of 1/ω² over all modes that the earlier reductions have left out.
    coupling : ndarray, shape (r, r), optional
        W: qᵀWq bounds the squared inertia coupling of q with these modes, in units of their stiffness. None if none was left out.
    unbounded : str
        Why no such bound is known; '' if there is one.
    premises : tuple of str
        Assumptions about parts whose origin is not known.
    belong : (M, K), optional
        The matrices of the reduced model that this origin is valid for.
    """

    size: int
    dofs: int
    cutoff: float
    left_out: float = 0.0
    coupling: Array | None = None
    unbounded: str = ""
    premises: tuple[str, ...] = ()
    belong: tuple[Matrix, Matrix] | None = None

    def belonging(self, M: Matrix, K: Matrix, same: Callable[[Matrix, Matrix], bool]) -> Origin | None:
        """The origin, valid for these matrices. If they are not `belong`, no bound is known: None after a single reduction."""
        before = self.belong or (M, K)
        if same(before[0], M) and same(before[1], K):
            return replace(self, belong=(M, K))
        if not self.left_out and not self.unbounded:
            return None
        return replace(self, size=len(K), coupling=None, belong=(M, K), unbounded=self.unbounded or
                       "its matrices are not those that reduce made")

    def record(self) -> dict[str, Any]:
        """The origin as numbers and lists, for JSON; `of_record` reads it."""
        return {"size": self.size, "dofs": self.dofs, "cutoff": None if np.isinf(self.cutoff) else self.cutoff,
                "left_out": self.left_out, "coupling": None if self.coupling is None else self.coupling.tolist(),
                "unbounded": self.unbounded, "premises": list(self.premises)}

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> Origin:
        """The origin from its `record`. A KeyError, TypeError or ValueError means that the record is damaged."""
        size = int(record["size"])
        found = cls(size, int(record["dofs"]), np.inf if record["cutoff"] is None else float(record["cutoff"]),
                    float(record["left_out"]), None if record["coupling"] is None else
                    np.array(record["coupling"], dtype=float).reshape(size, size), str(record["unbounded"]),
                    tuple(str(one) for one in record["premises"]))
        coupling = np.zeros(0) if found.coupling is None else found.coupling
        if not (found.dofs > 0 and found.cutoff > 0 and 0 <= found.left_out < np.inf and np.isfinite(coupling).all()):
            raise ValueError
        return found
