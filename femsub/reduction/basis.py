"""The steps of a reduction and their results: part and factor, static shapes and loads, modes, and the basis V = [C Φ Ξ]."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from femsub.algebra import BLOCK, phase, shared_zeros, times
from femsub.checks import Array, Matrix, SingularMatrixError
from femsub.modes import NormalModes, ShiftInvert, count_deferred, independent

if TYPE_CHECKING:
    from femsub.model import Estimate, Substructure


@dataclass(frozen=True, eq=False)
class Partition:
    """The DOF of a component whose modes are computed: `rows` are the interior, with the interface held, or all DOF.

    `factorisations` counts the factorisations that the choice of the rows took. With `turn` (n, n), `sub` is in other
    coordinates z of the component, x = turn z. `alone` is True where no system chooses the modes of all its parts together.
    """

    sub: Substructure
    rows: Array | slice
    factorisations: int = 0
    turn: Matrix | None = None
    alone: bool = False

    @classmethod
    def of(cls, sub: Substructure, held: bool) -> Partition:
        return cls(sub, sub.interior if held and len(sub.interface) else slice(None))

    def factored(self, seeks: int = 0) -> ShiftInvert:
        """The factor of the part. An earlier factor of the same part is reused. A count of `seeks` modes may be prepared."""
        try:
            return ShiftInvert(self.sub.K, self.sub.M, self.rows, self.sub.rigid_motion, seeks)
        except SingularMatrixError as error:
            raise SingularMatrixError(f"{self.sub.name!r}: {error}") from None


@dataclass(frozen=True, eq=False)
class Statics:
    """The factor, the constraint modes C and the static loads.

    Attributes
    ----------
    handle : ShiftInvert
        Factor of K (or K - σM) of the part.
    constraint, condensed : ndarray, shapes (n, n_c) and (n_c, n_c)
        C and CᵀKC; without columns for Craig-Chang.
    forces : ndarray, shape (n_i, s)
        F, whose static responses join the basis.
    kind : str
        The label of their columns in V.
    rigid : ndarray, shape (n_c, k), or None
        Coordinates of the rigid motions that C contains, C rigid. Rigid-body modes are not included. None: not known.
    sought : Kept, optional
        The modes, if they were computed while a second process solved for constraint modes.
    """

    part: Partition
    handle: ShiftInvert
    constraint: Array
    condensed: Array
    forces: Array
    kind: str
    rigid: Array | None = None
    sought: Kept | None = None

    @classmethod
    def of(cls, part: Partition, handle: ShiftInvert, forces: Array, kind: str) -> Statics:
        """Statics without constraint modes: only the responses to `forces`."""
        return cls(part, handle, zeros(part.sub.size, 0, 0), zeros(0, 0, 0), forces, kind, zeros(0, 0, 0))

    def rigid_in(self, modes: int, size: int) -> Array | None:
        """Rigid motion in the coordinates of [C Φ Ξ], (size, k); the first `modes` columns of Φ are rigid. None: not known."""
        if self.rigid is None:
            return None
        n_c, free = self.rigid.shape
        found = np.zeros((size, free + modes))
        found[:n_c, :free], found[n_c + np.arange(modes), free + np.arange(modes)] = self.rigid, 1.0
        return found

    @cached_property
    def inertia(self) -> Array:
        """MC, shape (n, n_c)."""
        return self.part.sub.M @ self.constraint

    @cached_property
    def rounding(self) -> Array:
        """Rounding error of CᵀKC, shape (n_c, n_c): |E|, positive semidefinite, where E is the difference of two formulas.

        Rigid motion is left out: its condensed stiffness has been set to 0.
        """
        if not len(self.condensed):
            return self.condensed
        E = self.constraint.T @ (self.part.sub.K @ self.constraint) - self.condensed
        bare = self.part.sub.K.diagonal()[self.part.sub.interface]
        unit = np.sqrt(np.where(bare > 0, bare, 1.0))
        stiffness, vectors = np.linalg.eigh(self.condensed / np.outer(unit, unit))
        elastic = vectors[:, stiffness > 1e-14 * stiffness[-1]]
        values, vectors = np.linalg.eigh(elastic.T @ ((E + E.T) / 2 / np.outer(unit, unit)) @ elastic)
        root = unit[:, None] * (elastic @ (vectors * np.sqrt(np.abs(values))))
        return root @ root.T


@dataclass(frozen=True, eq=False)
class Kept:
    """The modes of a basis. `found` holds all computed modes; the rigid-body modes and the first `elastic` others are kept.

    `estimate` is set for a band and a tolerance. `forces` (n_i, k) holds one force for each kept mode; the static responses to
    these forces join the basis. If `inside` is False, only these responses join it, and the modes do not.
    """

    found: NormalModes
    elastic: int
    estimate: Estimate | None = None
    forces: Array | None = None
    inside: bool = True
    free_below: float = np.inf

    @property
    def cutoff(self) -> float:
        """The frequency of the first mode that is left out; `free_below` where that mode was not computed."""
        return float(np.append(self.found.frequencies, self.free_below)[self.found.rigid + self.elastic])

    @property
    def rigid(self) -> int:
        return self.found.rigid if self.inside else 0

    @property
    def values(self) -> Array:
        """ω² of the kept modes, shape (rigid + elastic,)."""
        return self.found.eigenvalues[:self.rigid + self.elastic if self.inside else 0]

    @property
    def shapes(self) -> Array:
        """Φ, the shapes of the kept modes, shape (n_i, rigid + elastic)."""
        if not self.inside and self.forces is not None:
            return self.forces[:, :0]
        return self.found.shapes[:, :self.rigid + self.elastic]


@dataclass(frozen=True, eq=False)
class Basis:
    """V (n, r) with its labels, and M = VᵀMV, K = VᵀKV (r, r) from the orthogonality of the modes.

    K is not computed as a product VᵀKV: for the low modes of a large model, cancellation leaves no correct digit in it.
    `motion` (n, k) is the rigid motion, and `rigid` (r, k) its coordinates, V rigid = motion; None where the method does not know
    them. `interface` (n_b, r) are the rows of V at the interface. D = VᵀDV is None where it is not known yet.

    `forces` (n_i, s) are F. `energies` (2, p) are strain energies for each port column: of the full static response, and of the
    part of this response that Φ does not represent.
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
    forces: Array | None = None
    energies: Array = field(default_factory=lambda: np.zeros((2, 0)))

    def turned(self, T: Array, kinds: tuple[str, ...], rigid: Array | None) -> Basis:
        """VT (n, k) with TᵀMT, TᵀKT and TᵀDT. `rigid` are the coordinates of the rigid motions in VT."""
        M, K = (T.T @ A @ T for A in (self.M, self.K))
        return replace(self, V=self.V @ T, M=(M + M.T) / 2, K=(K + K.T) / 2, kinds=kinds, rigid=rigid,
                       interface=self.interface @ T, D=None if self.D is None else T.T @ self.D @ T)


def assembled(statics: Statics, kept: Kept, ports: Mapping[str, Array], mode_kind: str) -> Basis:
    """V = [C Φ Ξ]. The elastic columns of Φ get the label `mode_kind`.

    All loads are solved for at once. The solutions exclude the modes' contribution, so that no energy suffers from cancellation.
    Then the factor is released. The count of the modes is checked last, since another process may still be counting.
    """
    handle, C, n_c, rows = statics.handle, statics.constraint, statics.constraint.shape[1], statics.part.rows
    forces = statics.forces if kept.forces is None else np.hstack([kept.forces, statics.forces])
    loads, s = np.hstack([forces, *(w[rows] for w in ports.values())]) if ports else forces, forces.shape[1]
    rest = handle.elastic_solve(loads, kept.shapes)
    missing, held = np.einsum("ij,ij->j", rest, loads), kept.shapes[:, kept.rigid:].T @ loads
    whole = missing + np.einsum("ij,ij->j", held, held / kept.values[kept.rigid:, None])
    handle.release()  # frees memory before `count_deferred` makes a factor of its own
    with handle.sharing:
        residual, stiffness, inertia, dropped = independent(handle, rest[:, :s], forces, kept.shapes, kept.values)
        r = n_c + len(kept.values)
        V = widened(C, r + residual.shape[1])
        V[rows, n_c:r], V[rows, r:] = kept.shapes, residual
        M, K = in_blocks(statics.condensed, kept.values, stiffness, inertia, projected(statics.part.sub.M, V, C, symmetric=True))
        found = labelled(statics, kept, V, (M, K), dropped, V[statics.part.sub.interface], mode_kind)
        energies = np.array([whole[s:], missing[s:]])
        found = replace(found, port_error=port_errors(ports, found, kept, energies), estimate=kept.estimate, forces=forces,
                        energies=energies, motion=None if found.rigid is None else V @ found.rigid)
    count_deferred(handle, kept.found)
    return found


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
def projected(A: Matrix, V: Array, W: Array, symmetric: bool = False) -> Array:
    """VᵀAW, shape (r, s), a block of columns at a time, so that AW is never stored as a whole.

    `symmetric` means that A is symmetric and W holds the first columns of V. Rows above a diagonal block are then copied from
    earlier blocks.
    """
    result = np.zeros((V.shape[1], W.shape[1]))
    if not sp.issparse(A) or A.nnz:
        for start in range(0, W.shape[1], BLOCK):
            part, known = slice(start, min(start + BLOCK, W.shape[1])), start if symmetric else 0
            result[:known, part] = result[part, :known].T
            result[known:, part] = V[:, known:].T @ times(A, W[:, part])
    return result


def structural(sub: Substructure, V: Array) -> Array | None:
    """VᵀHV, symmetric to the last digit; None for a component without structural damping."""
    if sub.H is None:
        return None
    H = projected(sub.H, V, V, symmetric=True)
    return (H + H.T) / 2


def port_errors(ports: Mapping[str, Array], basis: Basis, kept: Kept, energies: Array) -> dict[str, float]:
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
        missing = energies[1, columns] - np.einsum("ij,ij->j", held, held / basis.K.diagonal()[first:, None])
        whole = energies[0, columns] + np.einsum("ij,ij->j", boundary, inverse @ boundary)
        share = np.divide(missing, whole, out=np.zeros_like(whole), where=whole > 0)
        errors[name] = float(np.sqrt(np.clip(share, 0.0, None).max(initial=0.0)))
    return errors


def zeros(rows: int, columns: int, room: int, common: bool = False) -> Array:
    """Zeros (rows, columns) with memory for `room` more columns behind them, which costs nothing until it is written to.

    With `common`, forks of this process share the memory.
    """
    whole = shared_zeros(rows, columns + room) if common else np.zeros((rows, columns + room), order="F")
    return whole[:, :columns]


def widened(C: Array, columns: int) -> Array:
    """C with columns of zeros appended, `columns` in total. C is not copied if `zeros` reserved enough memory behind it.

    For a large interface, a copy of C would take as much memory as all later steps.
    """
    whole = C.base
    if whole is None or whole.shape[1] < columns:
        whole = np.zeros((len(C), columns), order="F")
        whole[:, :C.shape[1]] = C
    V: Array = whole[:, :columns]
    return V


def square(matrix: Matrix, places: Array) -> Array:
    """The submatrix of the given rows and columns, dense."""
    part = matrix[places][:, places]
    return part.toarray() if sp.issparse(part) else part
