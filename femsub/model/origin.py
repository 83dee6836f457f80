"""`Origin`: what a reduced model was made of, and what the reductions before its last one have left out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from femsub.checks import Array, Matrix


@dataclass(frozen=True, eq=False)
class Origin:
    """Where the coordinates q (r,) of a reduced model come from. `reduce` makes it; `frequency_bounds` needs it.

    Attributes
    ----------
    size : int
        r, the number of coordinates.
    dofs : int
        DOF of the full model, before all reductions.
    cutoff : float
        No mode that the last reduction left out lies below. Earlier ones may have left out lower ones.
    left_out : float
        The largest 1/ω² of all that the earlier reductions have left out, or more.
    coupling : ndarray, shape (r, r), optional
        W: qᵀWq is at least the square of what couples q to that, in units of its stiffness. None where nothing was left out.
    unbounded : str
        Why nothing is known of it, where that is so.
    premises : tuple of str
        What must hold of parts whose origin is not known.
    belong : (M, K), optional
        The matrices of the reduced model that it was made for.
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
        """The origin of a model with these matrices: of others nothing is known. None where one step of reduction was all."""
        before = self.belong or (M, K)
        if same(before[0], M) and same(before[1], K):
            return replace(self, belong=(M, K))
        if not self.left_out and not self.unbounded:
            return None
        return replace(self, size=len(K), coupling=None, belong=(M, K), unbounded=self.unbounded or
                       "its matrices are not those that reduce made")

    def record(self) -> dict[str, Any]:
        """For JSON; `of_record` reads it."""
        return {"size": self.size, "dofs": self.dofs, "cutoff": None if np.isinf(self.cutoff) else self.cutoff,
                "left_out": self.left_out, "coupling": None if self.coupling is None else self.coupling.tolist(),
                "unbounded": self.unbounded, "premises": list(self.premises)}

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> Origin:
        """A KeyError, TypeError or ValueError says that the record is damaged."""
        size = int(record["size"])
        found = cls(size, int(record["dofs"]), np.inf if record["cutoff"] is None else float(record["cutoff"]),
                    float(record["left_out"]), None if record["coupling"] is None else
                    np.array(record["coupling"], dtype=float).reshape(size, size), str(record["unbounded"]),
                    tuple(str(one) for one in record["premises"]))
        coupling = np.zeros(0) if found.coupling is None else found.coupling
        if not (found.dofs > 0 and found.cutoff > 0 and 0 <= found.left_out < np.inf and np.isfinite(coupling).all()):
            raise ValueError
        return found
