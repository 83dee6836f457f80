"""From element matrices to a `Substructure`: summed into CSR chunk by chunk, held DOF taken out."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import scipy.sparse as sp

from femsub.dampers import damped
from femsub.dofs import DofMap
from femsub.errors import InputError
from femsub.pencil import Array, Matrix
from femsub.substructure import Substructure

CHUNK = 4_000_000  # entries of element matrices held at a time


def gathered(dofs: Array, size: int, matrices: Callable[[slice], tuple[Array, Array]]) -> tuple[Matrix, Matrix]:
    """Σ_e of the element matrices (K_e, M_e) that `matrices` gives for a slice of the elements, as CSR (size, size).

    `dofs` (m, k) numbers the DOF of each element. The two triangles are added up in the same order, so that symmetric
    element matrices give sums that are symmetric to the last digit.
    """
    step = max(1, CHUNK // dofs.shape[1] ** 2)
    total: list[Matrix] = []
    for start in range(0, len(dofs), step):
        part = slice(start, start + step)
        rows = np.asarray(dofs[part], dtype=np.int64)
        places = (rows[:, :, None] * size + rows[:, None, :]).ravel()
        order = np.argsort(places, kind="stable")
        places = places[order]
        first = np.flatnonzero(np.diff(places, prepend=-1))
        row, column = np.divmod(places[first], size)
        pointers = np.searchsorted(row, np.arange(size + 1))
        summed = [sp.csr_array((np.add.reduceat(values.ravel()[order], first), column, pointers), shape=(size, size))
                  for values in matrices(part)]
        total = [a + b for a, b in zip(total, summed, strict=True)] if total else summed
    return total[0], total[1]


def component(K: Matrix, M: Matrix, held: Array, interface: Mapping[str, Array], ports: Mapping[str, Array], dofs: DofMap,
              rayleigh: tuple[float, float] | None, name: str) -> Substructure:
    """The substructure of the DOF that are not held; the interface by place, the ports as columns, both for all DOF."""
    loose = np.ones(dofs.size, dtype=bool)
    loose[held] = False
    free = np.flatnonzero(loose)
    if not len(free):
        raise InputError(f"supports hold every DOF of {name!r}: nothing is left to move")
    number = np.cumsum(loose) - 1
    for place, rows in interface.items():
        if not loose[rows].any():
            raise InputError(f"interface {place} of {name!r} is held by the supports: leave out one or the other")
    for port, w in ports.items():
        if not np.any(w[free]):
            raise InputError(f"port {port!r} of {name!r} sits on DOF that the supports hold")
    joined = np.concatenate([*interface.values(), np.zeros(0, dtype=np.intp)]).astype(np.intp)
    kept = list(dict.fromkeys(joined[loose[joined]].tolist()))
    whole = len(free) == dofs.size
    sub = Substructure(M if whole else M[free][:, free], K if whole else K[free][:, free], interface=number[kept] if kept else (),
                       ports={port: w[free] for port, w in ports.items()}, name=name, dofs=dofs.kept(free))
    return sub if rayleigh is None else damped(sub, rayleigh=rayleigh)
