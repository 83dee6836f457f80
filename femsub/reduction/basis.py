"""Results of the steps of a reduction, and the assembly of the basis V from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.algebra import RigidMotion, phase, undamped
from femsub.checks import Array, Matrix
from femsub.modes import independent, units
from femsub.reduction.statics import COLUMNS, Statics, widened

if TYPE_CHECKING:
    from femsub.model import Estimate, Pencil
    from femsub.modes import NormalModes


@dataclass(frozen=True, eq=False)
class Kept:
    """The modes of a basis: `found` holds all computed modes. Kept are the rigid ones and the first `elastic` others.

    `cutoff` is the frequency of the first mode that is left out. `estimate` is set for a band and a tolerance. `forces` (n_i, k)
    are forces of the modes, mode by mode, whose static responses join the basis. Of modes that are not `inside` the responses are
    all that joins it.
    """

    found: NormalModes
    elastic: int
    cutoff: float
    estimate: Estimate | None = None
    forces: Array | None = None
    inside: bool = True

    @property
    def rigid(self) -> int:
        return self.found.rigid if self.inside else 0

    @property
    def values(self) -> Array:
        """ω² of the modes kept, shape (rigid + elastic,)."""
        return self.found.eigenvalues[:self.rigid + self.elastic if self.inside else 0]

    @property
    def shapes(self) -> Array:
        """Φ of the modes kept, shape (n_i, rigid + elastic)."""
        if not self.inside and self.forces is not None:
            return self.forces[:, :0]
        return self.found.shapes[:, :self.rigid + self.elastic]


@dataclass(frozen=True, eq=False)
class Responses:
    """Static responses to F without the modes' contribution, `rest` (n_i, s), and energies for all port columns (p,).

    `whole` is the energy of the full static response to each port column, `missing` the part of it that Φ does not represent.
    """

    forces: Array
    rest: Array
    whole: Array
    missing: Array


@dataclass(frozen=True, eq=False)
class Basis:
    """V (n, r) with its labels, and M = VᵀMV, K = VᵀKV (r, r) from the orthogonality of the modes.

    K is not computed as a product VᵀKV: for the low modes of a large model, cancellation leaves no correct digit in it.
    `motion` (n, k) is the rigid motion, and `rigid` (r, k) its coordinates, V rigid = motion; None where the method does not know
    them. `interface` (n_b, r) are the rows of V at the interface. D = VᵀDV is None where it is not known yet.
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
    interface: Array
    estimate: Estimate | None = None
    rigid: Array | None = None
    motion: Array | None = None
    D: Array | None = None

    def turned(self, T: Array, kinds: tuple[str, ...], rigid: Array | None) -> Basis:
        """VT (n, k) with TᵀMT, TᵀKT and TᵀDT, and the rigid motions in its coordinates, V rigid = VT rigid'."""
        M, K = (T.T @ A @ T for A in (self.M, self.K))
        return replace(self, V=self.V @ T, M=(M + M.T) / 2, K=(K + K.T) / 2, kinds=kinds, rigid=rigid,
                       interface=self.interface @ T, D=None if self.D is None else T.T @ self.D @ T)


def responses_to(statics: Statics, kept: Kept, ports: Mapping[str, Array]) -> Responses:
    """One block solve for all loads. The modes' contribution is removed first, so that `missing` suffers no cancellation."""
    forces = statics.forces if kept.forces is None else np.hstack([kept.forces, statics.forces])
    loads, s = np.hstack([forces, *(w[statics.part.rows] for w in ports.values())]), forces.shape[1]
    rest = statics.handle.elastic_solve(loads, kept.shapes)
    missing, held = np.einsum("ij,ij->j", rest, loads), kept.shapes[:, kept.rigid:].T @ loads
    whole = missing + np.einsum("ij,ij->j", held, held / kept.values[kept.rigid:, None])
    return Responses(forces, rest[:, :s], whole[s:], missing[s:])


def assembled(statics: Statics, kept: Kept, responses: Responses, ports: Mapping[str, Array], mode_kind: str) -> Basis:
    """V = [C Φ Ξ]. The elastic columns of Φ get the label `mode_kind`."""
    C, n_c = statics.constraint, statics.constraint.shape[1]
    residual, stiffness, inertia, dropped = independent(statics.handle, responses.rest, responses.forces, kept.shapes,
                                                        kept.values)
    r = n_c + len(kept.values)
    V = widened(C, r + residual.shape[1])
    V[statics.part.rows, n_c:r], V[statics.part.rows, r:] = kept.shapes, residual
    M, K = in_blocks(statics.condensed, kept.values, stiffness, inertia, projected(statics.part.sub.M, V, C))
    found = labelled(statics, kept, V, (M, K), dropped, V[statics.part.sub.interface], mode_kind)
    return replace(found, port_error=port_errors(ports, found, kept, responses), estimate=kept.estimate,
                   motion=None if found.rigid is None else V @ found.rigid)


def labelled(statics: Statics, kept: Kept, V: Array, matrices: tuple[Array, Array], dropped: int, interface: Array,
             mode_kind: str) -> Basis:
    """[C Φ Ξ] with its labels and its rigid motion, from the columns V, M and K."""
    M, K = matrices
    n_c, elastic = statics.constraint.shape[1], len(kept.values) - kept.rigid
    kinds = ("constraint",) * n_c + ("rigid",) * kept.rigid + (mode_kind,) * elastic
    kinds += (statics.kind,) * (len(M) - len(kinds))
    factorisations = statics.handle.factorisations + statics.part.factorisations
    factorisations += 0 if kept.inside else kept.found.factorisations
    return Basis(V, M, K, kinds, kept.elastic, kept.cutoff, dropped, {}, factorisations, interface,
                 rigid=statics.rigid_in(kept.rigid, len(M)))


def free_first(q: Array, motion: Array, pencil: Pencil | None) -> RigidMotion:
    """Coordinates q (r, k) of a rigid motion (n, k), with those first that D of the component does not damp."""
    if pencil is None or not q.shape[1] or not pencil.norms[1]:
        return RigidMotion(q, q.shape[1])
    turn, free = undamped(pencil.D, motion, units(pencil.M))
    return RigidMotion(q @ turn[:, np.append(free, np.setdiff1d(np.arange(len(turn)), free))], len(free))


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


def port_errors(ports: Mapping[str, Array], basis: Basis, kept: Kept, responses: Responses) -> dict[str, float]:
    """Static error per port of [C Φ Ξ]: sqrt(missing / whole energy), the largest over the port's columns.

    The constraint modes are exact. The error therefore comes only from the part whose modes are kept. For a component that
    floats on its interface, `whole` is the energy of the self-equilibrated part of the load.
    """
    errors, at, n_c = {}, 0, basis.kinds.count("constraint")
    first, condensed = n_c + len(kept.values), basis.K[:n_c, :n_c]
    inverse = np.linalg.pinv(condensed, rcond=1e-12, hermitian=True) if n_c else condensed
    for name, w in ports.items():
        columns = slice(at, at + w.shape[1])
        at += w.shape[1]
        boundary, _, held = np.split(basis.V.T @ w, [n_c, first])
        missing = responses.missing[columns] - np.einsum("ij,ij->j", held, held / basis.K.diagonal()[first:, None])
        whole = responses.whole[columns] + np.einsum("ij,ij->j", boundary, inverse @ boundary)
        share = np.divide(missing, whole, out=np.zeros_like(whole), where=whole > 0)
        errors[name] = float(np.sqrt(np.clip(share, 0.0, None).max(initial=0.0)))
    return errors
