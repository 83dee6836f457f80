"""Results of the steps of a reduction, and the assembly of the basis V from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.algebra import phase
from femsub.checks import Array, Matrix
from femsub.modes import independent
from femsub.reduction.rigid import coordinates
from femsub.reduction.statics import COLUMNS, Statics, widened

if TYPE_CHECKING:
    from femsub.model import Estimate
    from femsub.modes import NormalModes


@dataclass(frozen=True, eq=False)
class Kept:
    """The modes of a basis: `found` holds all computed modes. Kept are the rigid ones and the first `elastic` others.

    `cutoff` is the frequency of the first mode that is left out. `estimate` is set for a band and a tolerance.
    """

    found: NormalModes
    elastic: int
    cutoff: float
    estimate: Estimate | None = None

    @property
    def rigid(self) -> int:
        return self.found.rigid

    @property
    def values(self) -> Array:
        """ω² of the modes kept, shape (rigid + elastic,)."""
        return self.found.eigenvalues[:self.rigid + self.elastic]

    @property
    def shapes(self) -> Array:
        """Φ of the modes kept, shape (n, rigid + elastic)."""
        return self.found.shapes[:, :self.rigid + self.elastic]


@dataclass(frozen=True, eq=False)
class Responses:
    """Static responses to F without the modes' contribution (`rest`, shape (n_i, s)), and energies for all port columns (p,).

    `whole` is the energy of the full static response to each port column. `missing` is the part of it that the first
    `known` columns of [Φ Ξ] do not represent.
    """

    rest: Array
    whole: Array
    missing: Array
    known: int


@dataclass(frozen=True, eq=False)
class Basis:
    """V (n, r) with its labels, and M = VᵀMV, K = VᵀKV (r, r) from the orthogonality of the modes.

    K is not computed as a product VᵀKV: for the low modes of a large model, cancellation leaves no correct digit in it.
    `motion` (n, k) is the rigid motion, and `rigid` (r, k) its coordinates, V rigid = motion; None where the method does not know
    them.
    """

    V: Array
    M: Array
    K: Array
    kinds: tuple[str, ...]
    modes: int
    cutoff: float
    dropped: int
    port_error: Mapping[str, float]
    factorisations: int
    estimate: Estimate | None = None
    rigid: Array | None = None
    motion: Array | None = None


def assembled(statics: Statics, kept: Kept, responses: Responses, ports: Mapping[str, Array], mode_kind: str) -> Basis:
    """V = [C Φ Ξ]. The elastic columns of Φ get the label `mode_kind`."""
    C, forces = statics.constraint, statics.forces
    residual, stiffness, inertia, dropped = independent(statics.handle, responses.rest, forces, kept.shapes, kept.values)
    n_c, r = C.shape[1], C.shape[1] + len(kept.values)
    V = widened(C, r + len(stiffness))
    V[statics.part.rows, n_c:r], V[statics.part.rows, r:] = kept.shapes, residual
    M, K = in_blocks(statics.condensed, kept.values, stiffness, inertia, projected(statics.part.sub.M, V, C))
    kinds = ("constraint",) * n_c + ("rigid",) * kept.rigid + (mode_kind,) * kept.elastic + (statics.kind,) * len(stiffness)
    errors = _port_errors(ports, V, statics.condensed, K.diagonal()[n_c:], responses)
    rigid = coordinates(statics, kept.rigid, len(M))
    return Basis(V, M, K, kinds, kept.elastic, kept.cutoff, dropped, errors, statics.handle.factorisations, kept.estimate, rigid,
                 None if rigid is None else V @ rigid)


def in_blocks(condensed: Array, values: Array, stiffness: Array, inertia: Array, coupling: Array) -> tuple[Array, Array]:
    """M and K (r, r) in [C Φ Ξ], from CᵀKC, the ω² of Φ, the stiffness and mass of Ξ, and [C Φ Ξ]ᵀMC (r, n_c).

    CᵀK[Φ Ξ] = 0 and ΦᵀKΦ = Ω²; the condensed stiffness needs no second product with K.
    """
    n_c = len(condensed)
    diagonals = np.append(np.ones(len(values)), inertia), np.append(values, stiffness)
    M, K = (np.diag(np.append(np.zeros(n_c), diagonal)) for diagonal in diagonals)
    K[:n_c, :n_c] = condensed
    coupling[n_c + len(values) + np.flatnonzero(inertia == 0)] = 0.0
    coupling[:n_c] = (coupling[:n_c] + coupling[:n_c].T) / 2
    M[:, :n_c], M[:n_c] = coupling, coupling.T
    return M, K


@phase("projection")
def projected(A: Matrix, V: Array, W: Array) -> Array:
    """VᵀAW, shape (r, s), a block of columns at a time, so that AW is never stored as a whole."""
    result = np.zeros((V.shape[1], W.shape[1]))
    if not sp.issparse(A) or A.nnz:
        for start in range(0, W.shape[1], COLUMNS):
            part = slice(start, start + COLUMNS)
            result[:, part] = V.T @ (A @ W[:, part])
    return result


def _port_errors(ports: Mapping[str, Array], V: Array, condensed: Array, values: Array,
                 responses: Responses) -> dict[str, float]:
    """Static error per port: sqrt(missing / whole energy), the largest over the port's columns.

    The constraint modes are exact. The error therefore comes only from the part whose modes are kept. For a component that
    floats on its interface, `whole` is the energy of the self-equilibrated part of the load.
    """
    errors, at, n_c = {}, 0, len(condensed)
    inverse = np.linalg.pinv(condensed, rcond=1e-12, hermitian=True) if n_c else condensed
    later = np.flatnonzero(values > 0)
    later = later[later >= responses.known]
    for name, w in ports.items():
        columns = slice(at, at + w.shape[1])
        at += w.shape[1]
        boundary, held = np.split(V.T @ w, [n_c])
        held = held[later]
        missing = responses.missing[columns] - np.einsum("ij,ij->j", held, held / values[later][:, None])
        whole = responses.whole[columns] + np.einsum("ij,ij->j", boundary, inverse @ boundary)
        share = np.divide(missing, whole, out=np.zeros_like(whole), where=whole > 0)
        errors[name] = float(np.sqrt(np.clip(share, 0.0, None).max(initial=0.0)))
    return errors
