"""Rigid motion: the motions Z with K Z = 0, some also with D Z = 0. Only this module decides which motions are rigid.

Carried: in a reduced or joined model, rounding in VᵀKV and VᵀDV may look like a soft mount or a damper. So rigid motions are not
searched there. They are found once in each full part, and every basis, joint or contact changes them (`Carried`).

Found from K, in full parts only: u is the relative rounding of K's entries, EPS or more (`rounding_of`). Two ratios measure the
energy and the forces of a motion x (`costs`):

    e = xᵀKx / |x|ᵀ|K||x|,   f = ‖SKx‖ / ‖S|K||x|‖ with S = diag(1/√k_ii).

The energy e of rigid motion is the rounding of a sum of products. The energy of a soft mount below u is as small, but its forces
add up in f, while forces from rounding do not. `rigid_count` decides by both ratios, and by the gap to the next mode.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from femsub.algebra import (
    DEPENDENT,
    SUMS,
    block_diagonal,
    largest,
    null_space,
    same,
    shared,
    sizes,
    translations,
    undamped,
    units as units_of_energy,
)
from femsub.checks import EPS, Array, Matrix
from femsub.model.digits import rounding_of

if TYPE_CHECKING:
    from femsub.model.dof_map import DofMap
    from femsub.model.substructure import Substructure

SOFT = EPS**0.5  # half of all digits: a spring, or the energy of a mode, is soft below this share of the stiffness around it
FORCE = SOFT / 16  # largest f of a rigid-body mode, which rounding may mix with others; f of soft modes of equal energy is larger
BENDING = 0.8 * 3.0**-4  # largest ω² ratio at a gap: below that of the first two modes of a guided and pinned beam, with a margin
MIXED = 0.1  # largest ω² ratio at a gap if soft springs show which modes are elastic; share of elastic modes in a rigid motion
WIDE = 64 * EPS, 1e-6  # modes with an energy up to the first number are rigid if the gap (ratio of ω²) is below the second
WRITTEN = 1e-4  # largest ω² ratio at a gap if the energy is within the rounding of a K with fewer digits
SUMMED = 100  # times SUMS: the rounding of an entry of VᵀKV, of which 1.4e-13 was seen
ENTRIES = 4_000_000  # numbers in a temporary array


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """The motions Z (n, r) with K Z = 0, ZᵀK = 0. The first `free` also have D Z = 0; D damps all combinations of the others."""

    shapes: Array
    free: int
    belong: tuple[Matrix, Matrix] | None = None  # D and K of the reduced part that these motions are valid for

    def belonging(self, M: Matrix, D: Matrix, K: Matrix) -> RigidMotion | None:
        """The motions, valid for these matrices; None if they were made for another K."""
        before = self.belong or (D, K)
        if len(self.shapes) != len(K) or not same(before[1], K):
            return None
        return replace(self if same(before[0], D) else Damped(D, M.diagonal())(self), belong=(D, K))

    @classmethod
    def of(cls, shapes: Array, D: Matrix | None, unit: Array, q: Array | None = None) -> RigidMotion:
        """The motions, with the undamped ones (D Z = 0) first; `unit` (n,) scales the DOF.

        If the coordinates q (r, k) in a basis are given, shapes = V q, the result contains the coordinates.
        """
        q = shapes if q is None else q
        if D is None or not shapes.shape[1] or not (D.nnz if sp.issparse(D) else np.any(D)):
            return cls(q, q.shape[1])
        far = (np.abs(shapes) / unit[:, None]).max(axis=0)  # normalised, so that no motion is rounding beside a larger one
        turn, free = undamped(D, shapes / far, unit)
        rest = np.setdiff1d(np.arange(len(turn)), free)
        return cls(q / far @ turn[:, np.append(free, rest)], len(free))

    def record(self) -> dict[str, Any]:
        """The entries of a file."""
        return {"shapes": self.shapes.tolist(), "free": self.free}

    @property
    def count(self) -> int:
        return int(self.shapes.shape[1])

    @property
    def undamped(self) -> Array:
        """The motions with D Z = 0, shape (n, free)."""
        return self.shapes[:, :self.free]

    @staticmethod
    def none(size: int) -> RigidMotion:
        """The rigid motion of a model of `size` DOF without any: n = `size`, r = 0."""
        return RigidMotion(np.zeros((size, 0)), 0)

    @property
    def zeros(self) -> int:
        """The number of eigenvalues at 0: one for each damped motion, two for each undamped motion."""
        return self.count + self.free

    def mixed(self, turn: Array | None, free: Array | None) -> RigidMotion | None:
        """The motions Z turn, ordered so that the undamped ones, Z turn free, come first; None if `turn` or `free` is None."""
        if turn is None or free is None:
            return None
        if free.shape[1]:
            turn = turn @ np.hstack([free, np.linalg.qr(free, mode="complete")[0][:, free.shape[1]:]])
        return RigidMotion(self.shapes @ turn, free.shape[1])


Decide: TypeAlias = "Callable[[Substructure], RigidMotion | None]"


class Source(ABC):
    """The source of a model's rigid motion, which is computed only when it is needed."""

    @abstractmethod
    def found(self, decide: Decide) -> RigidMotion | None:
        """The motion, or None if rounding leaves it open. `decide` finds the motion of a part that carries none."""


Carried: TypeAlias = RigidMotion | Source | None


def found(carried: Carried, decide: Decide) -> RigidMotion | None:
    """The rigid motion that a model carries; None if it carries none, or if rounding leaves it open."""
    return carried.found(decide) if isinstance(carried, Source) else carried


@dataclass(frozen=True, eq=False)
class Changed(Source):
    """The rigid motion of another model, changed by one step."""

    before: Carried
    step: Callable[[RigidMotion], RigidMotion | None]

    def found(self, decide: Decide) -> RigidMotion | None:
        first: Carried = self
        steps = []
        while isinstance(first, Changed):  # not by recursion: hundreds of contacts are as many steps
            steps.append(first.step)
            first = first.before
        motion = found(first, decide)
        for step in reversed(steps):
            motion = None if motion is None else step(motion)
        return motion


def changed(carried: Carried, step: Callable[[RigidMotion], RigidMotion | None]) -> Carried:
    """The rigid motion that a model carries if it differs by one step from a model that carries `carried`."""
    return None if carried is None else Changed(carried, step)


@dataclass(frozen=True, eq=False)
class Scaled:
    """A step to coordinates x' in other units, x = diag(unit) x'."""

    unit: Array

    def __call__(self, motion: RigidMotion) -> RigidMotion:
        return RigidMotion(motion.shapes / self.unit[:, None], motion.free)


@dataclass(frozen=True, eq=False)
class Restricted:
    """A step to coordinates x' with x = X x' for the DOF `rest`; the other DOF do not move."""

    X: Matrix
    rest: Array

    def __call__(self, motion: RigidMotion) -> RigidMotion | None:
        q = coordinates(self.X, motion.shapes[self.rest], np.ones(len(self.rest)))
        return None if q is None else RigidMotion(q, motion.free)


@dataclass(frozen=True, eq=False)
class Damped:
    """A step to another D; `mass` (n,) scales the DOF."""

    D: Matrix
    mass: Array

    def __call__(self, motion: RigidMotion) -> RigidMotion:
        return RigidMotion.of(motion.shapes, self.D, np.where(self.mass > 0, self.mass, 1.0) ** -0.5)


@dataclass(frozen=True, eq=False)
class Touched:
    """A step that adds W C_D Wᵀ to D and W C_K Wᵀ to K. Motions that C_K resists are not rigid, and C_D damps others.

    With `left`, rigid motions must fulfil K z = 0 and zᵀK = 0. Otherwise K z = 0 suffices, also if friction drives them.
    """

    damping: Any
    W: Array
    stiffness: Any
    unit: Array
    left: bool = True

    def __call__(self, motion: RigidMotion) -> RigidMotion | None:
        if not motion.count:
            return motion
        at = self.W.T @ motion.shapes  # the motion at the contact
        size = abs(self.W).T @ sizes(motion.shapes, self.unit)
        at, size = (np.asarray(A).reshape(-1, motion.count) for A in (at, size))
        acting = []  # for K and D: C u, with `left` Cᵀ u below it, and |C| |u|, the size of the terms that cancel
        for C in (self.stiffness, self.damping):
            if np.ndim(C) == 0 and not sp.issparse(C):
                C = np.eye(len(at)) if C else np.zeros((0, len(at)))
            elif self.left:
                C = sp.vstack([C, C.T]) if sp.issparse(C) else np.vstack([C, np.transpose(C)])
            acting.append((C @ at, abs(C) @ size))
        stiff, brake = acting
        loose = null_space(*stiff)
        if loose is None:
            return None
        damped = np.arange(motion.count) >= motion.free
        more = np.eye(motion.count)[damped] @ loose, brake[0] @ loose
        own = sizes(loose, 1 / np.abs(motion.shapes / self.unit[:, None]).max(axis=0))
        return motion.mixed(loose, null_space(np.vstack(more), np.vstack([own[damped], brake[1] @ own])))


@dataclass(frozen=True, eq=False)
class Joined(Source):
    """The rigid motion of joined parts: their rigid motions q = diag(Z_p) c = L x that fulfil A q = 0 and move no spring.

    Attributes
    ----------
    parts : tuple of Substructure
    L : sparse or dense, shape (N, n)
        q = L x gives the coordinates of the parts from the coordinates of the system.
    unit : ndarray, shape (N,)
        The displacement of each coordinate of the parts at unit energy.
    equations : sparse, shape (m, N)
        A.
    springs, dampers : tuple of sparse, shape (s, N)
        The motions that springs and dampers act on.
    """

    parts: tuple[Substructure, ...]
    L: Matrix
    unit: Array
    equations: Matrix
    springs: tuple[Matrix, ...]
    dampers: tuple[Matrix, ...]
    belong: tuple[Matrix, Matrix] | None = None  # D and K of the system

    def belonging(self, D: Matrix, K: Matrix) -> Joined | None:
        """The same, valid for these matrices of the system; None if it was made for other matrices."""
        before = self.belong or (D, K)
        return replace(self, belong=(D, K)) if same(before[0], D) and same(before[1], K) else None

    def found(self, decide: Decide) -> RigidMotion | None:
        return shared((self.equations, self.L), ("rigid motion", decide.__qualname__), partial(self._found, decide))

    def _found(self, decide: Decide) -> RigidMotion | None:
        own = []
        for part in self.parts:
            motion = found(part.rigid_motion, decide) or decide(part)
            if motion is None:
                return None
            own.append(motion)
        Z = block_diagonal([motion.shapes for motion in own])
        if not Z.shape[1]:
            return RigidMotion.none(self.L.shape[1])
        unit = np.split(self.unit, np.cumsum([len(motion.shapes) for motion in own])[:-1])
        moved = (sizes(motion.shapes, one) for motion, one in zip(own, unit, strict=True))
        size = block_diagonal(list(moved))
        conditions = [A for A in (self.equations, *self.springs) if A.shape[0]]
        turn = null_space(*_stacked([(A @ Z, abs(A) @ size) for A in conditions], Z.shape[1]))
        if turn is None:
            return None
        x = coordinates(self.L, Z @ turn, self.unit)
        if x is None:
            return None
        damped = np.concatenate([np.arange(motion.count) >= motion.free for motion in own])
        brakes = [(sp.csr_array(np.eye(len(damped))[damped]),) * 2, *((A @ Z, abs(A) @ size) for A in self.dampers)]
        B, whole = _stacked(brakes, Z.shape[1])
        far = largest(sp.csr_array(size.T) @ sp.diags_array(1 / self.unit))
        return RigidMotion(x, 0).mixed(np.eye(turn.shape[1]), null_space(B @ turn, whole @ sizes(turn, 1 / far)))


def coordinates(L: Matrix, q: Array, unit: Array) -> Array | None:
    """x (k, r) with L x = q (n, r), by least squares in `unit` (n,) of the DOF; None if L x = q has no solution."""
    q = q / unit[:, None]
    x = np.zeros((L.shape[1], q.shape[1]))
    if sp.issparse(L):
        L = sp.csc_array(sp.diags_array(1 / unit) @ sp.csr_array(L))
        used = np.flatnonzero(np.diff(L.indptr))  # columns of multipliers are zero
        L = L[:, used]
        gram = sp.csc_array(L.T @ L)
        scale = sp.diags_array(gram.diagonal() ** -0.5)
        factor = splu(sp.csc_array(scale @ gram @ scale))
        for _ in range(3):  # one solution, two corrections
            x[used] += scale @ factor.solve(np.ascontiguousarray(scale @ (L.T @ (q - L @ x[used]))))
        left = q - L @ x[used]
    else:
        L = L / unit[:, None]
        size = np.linalg.norm(L, axis=0)
        size = np.where(size > 0, size, 1.0)
        x = np.linalg.lstsq(L / size, q, rcond=None)[0] / size[:, None]
        left = q - L @ x
    return x if (np.linalg.norm(left, axis=0) <= DEPENDENT * np.linalg.norm(q, axis=0)).all() else None


def _stacked(blocks: list[tuple[Matrix, Matrix]], columns: int) -> tuple[Array, Array]:
    """Conditions, and the sizes of their terms, stacked in two dense arrays (m, columns)."""
    none = sp.csr_array((0, columns))
    one, other = (sp.vstack([none, *(block[side] for block in blocks)]).toarray() for side in (0, 1))
    return one, other


def loose_by_places(part: Substructure, held: Array) -> int:
    """The number of rigid motions, from the places of the DOF, with the DOF `held` at rest and without energy; 0 if not known."""
    dofs = part.dofs
    if dofs is None or dofs.no_rigid or dofs.size != part.size or not 0 < len(held) < part.size:
        return 0
    R = dofs.rigid()
    R = R[:, R.any(axis=0)]
    R, size, _ = np.linalg.svd(R / np.linalg.norm(R, axis=0), full_matrices=False)
    R = R[:, size > DEPENDENT * size.max(initial=0.0)]  # if all DOF are on a line, or in one direction, some motions are equal
    still = null_space(R[held], sizes(R, energy_units(part))[held])
    if still is None or not still.shape[1]:
        return 0
    at_rest = R @ still
    at_rest[held] = 0.0
    return still.shape[1] if costs_nothing(part.K, at_rest).all() else 0


def of_few_digits(M: Array, D: Array | None, K: Array, dofs: DofMap, lost: float, written: bool) -> RigidMotion | None:
    """The rigid motions of a superelement, whose interface DOF come first; None if there are none.

    K has lost digits, so its rigid motions are not exactly free of forces. If the places of the DOF are known, a motion of a
    rigid body counts whose forces are at most `lost`, with each DOF in the unit of its own stiffness. Otherwise rigid motions are
    found from a `written` K, with the error `lost` of each entry, if the next motion has far more energy.
    """
    unit = units(K)
    if not dofs.no_rigid:
        scaled = dofs.rigid() / unit[:dofs.size, None]
        size = np.linalg.norm(scaled, axis=0)
        U, values, _ = np.linalg.svd(scaled[:, size > 0] / size[size > 0], full_matrices=False)
        Z = np.zeros((len(K), int(np.count_nonzero(values > lost * values.max(initial=0.0)))))
        Z[:dofs.size] = unit[:dofs.size, None] * U[:, :Z.shape[1]]
        resisted, turn = np.linalg.svd(unit[:, None] * (K @ Z), full_matrices=False)[1:]
        free = Z @ turn.T[:, resisted <= lost * np.sqrt(len(K))]
    elif written:
        A = K * np.outer(unit, unit)
        values, U = np.linalg.eigh(A)
        noise = lost * np.linalg.norm(np.abs(A), 2)
        count = int(np.count_nonzero(values <= noise))
        clear = count < len(values) and noise <= MIXED**2 * values[count]
        free = unit[:, None] * U[:, :count if clear else 0]
    else:
        return None
    return RigidMotion.of(free, D, np.sqrt(np.maximum(M.diagonal(), np.finfo(float).tiny))) if free.size else None


def energy_units(model: Substructure) -> Array:
    """The displacement of each DOF of a model at unit energy, (n,); see `femsub.algebra.units`."""
    return units_of_energy(model.M.diagonal(), model.K.diagonal())[0]


def by_places(part: Substructure) -> RigidMotion | None:
    """The rigid motions of a full part, from the places of its DOF, that K does not resist.

    None if the places are not known, or if rounding leaves open which motions K resists.
    """
    if part.dofs is None or part.dofs.no_rigid:
        return None
    R = part.dofs.rigid()
    R = R[:, R.any(axis=0)]
    free = null_space(part.K @ R, abs(part.K) @ np.abs(R))
    return None if free is None else RigidMotion.of(R @ free, part.D, energy_units(part))


Rubbing: TypeAlias = "tuple[Matrix, Matrix, Matrix, Array]"


def driven(motion: RigidMotion, contacts: Sequence[Rubbing], unit: Array) -> Array | None:
    """Rigid motions z (n, k) that friction drives and no contact resists; None if rounding leaves it open.

    Each contact gives W (n, p), N and T (q, p) and S (p, m). The contact resists motions with N Wᵀz ≠ 0. Of the other motions,
    friction acts along those with T Wᵀz ≠ 0. Motions with Wᵀz = S s are the steady sliding itself, which goes on, so they are
    left out.
    """
    def at_contacts(Z: Array) -> list[tuple[Array, Array]]:
        return [(W.T @ Z, abs(W).T @ sizes(Z, unit)) for W, *_ in contacts]

    def annulled(by: int, moved: list[tuple[Array, Array]]) -> Array | None:
        terms = [(contact[by] @ u, abs(contact[by]) @ size) for contact, (u, size) in zip(contacts, moved, strict=True)]
        return null_space(np.vstack([B for B, _ in terms]), np.vstack([size for _, size in terms]))

    loose = annulled(1, at_contacts(motion.shapes))
    if loose is None or not loose.shape[1]:
        return loose if loose is None else motion.shapes @ loose
    Z = motion.shapes @ loose
    Z = Z / np.abs(Z / unit[:, None]).max(axis=0)
    moved = at_contacts(Z)
    along = annulled(2, moved)
    steady = la.block_diag(*(S * (size.max(initial=0.0) / np.abs(S).max(initial=1e-300))  # scaled to the size of the motions
                             for (*_, S), (_, size) in zip(contacts, moved, strict=True)))
    going = null_space(np.hstack([np.vstack([u for u, _ in moved]), -steady]),
                       np.hstack([np.vstack([size for _, size in moved]), np.abs(steady)]))
    if along is None or going is None:
        return None
    apart = np.hstack([along, going[:Z.shape[1]]])
    apart = apart[:, apart.any(axis=0)]
    apart = (apart / np.abs(apart).max(axis=0, initial=0.0)).T if apart.shape[1] else apart.T
    rest = null_space(apart, np.ones_like(apart))
    return None if rest is None else Z @ rest


def size_of_products(A: Matrix, V: Matrix) -> Array:
    """g (r, 1) with |v_i|ᵀ|A||v_j| ≤ g_i g_j: a relative change EPS of each entry of A changes VᵀAV by at most EPS g gᵀ.

    By Cauchy and Schwarz in units s of the DOF: g_j² = Σ_k (|A|s)_k v_kj²/s_k, with s from the diagonal of A.
    """
    if not (A.nnz if sp.issparse(A) else np.any(A)):
        return np.zeros((V.shape[1], 0))
    size = abs(A)
    diagonal = size.diagonal()
    s = np.where(diagonal > 0, diagonal, np.maximum(size.sum(axis=0), size.sum(axis=1)))
    s = np.where(s > 0, s, 1.0) ** -0.5
    weight = np.maximum(size @ s, size.T @ s) / s
    if sp.issparse(V):
        return np.sqrt(V.power(2).T @ weight).reshape(-1, 1)
    return np.sqrt(np.einsum("i,ij,ij->j", weight, V, V, optimize=False)).reshape(-1, 1)  # without the memory for V²


def rounding(K: Matrix) -> float:
    """The relative rounding u of the entries of K, see `rounding_of`; computed once."""
    return _translated(K)[0]


def annihilates_a_translation(K: Matrix, unit: float = 0.0) -> bool:
    """Whether a uniform motion of every s-th DOF, for some s, has no elastic energy: a cheap test for a floating component."""
    return bool(is_rigid(*_translated(K)[1:], unit).any())


def _translated(K: Matrix) -> tuple[float, Array, Array]:
    """The rounding of K's entries, and f and e of translations (see `costs`); computed once."""
    def found() -> tuple[float, Array, Array]:
        t = translations(K.shape[0])
        forces = K @ t, abs(K) @ t
        return rounding_of(K, t, forces), *costs(K, t, forces)

    return shared((K,), "translations", found)


def units(K: Matrix) -> Array:
    """1/sqrt(k_ii), shape (n,): scales that make forces and moments comparable."""
    diagonal = K.diagonal()
    return np.where(diagonal > 0, diagonal, 1.0) ** -0.5


def costs(K: Matrix, x: Array, forces: tuple[Array, Array] | None = None) -> tuple[Array, Array]:
    """The ratios f and e of each column of x (n, k), (k,) each; 0 if |K||x| = 0. `forces` are Kx and |K||x|, if known already."""
    force, size = (K @ x, abs(K) @ np.abs(x)) if forces is None else forces
    unit = units(K)[:, None]
    energy, whole = np.einsum("ij,ij->j", x.conj(), force).real, np.einsum("ij,ij->j", np.abs(x), size)
    length, scale = (np.linalg.norm(unit * part, axis=0) for part in (force, size))
    return (np.divide(length, scale, out=np.zeros(len(scale)), where=scale > 0),
            np.divide(energy, whole, out=np.zeros_like(energy), where=whole > 0))


def is_rigid(force: Array, energy: Array, unit: float = 0.0) -> Array:
    """Which motions are rigid-body motions and not modes on a soft mount, by their `costs`; bool, shape (k,).

    `unit` is the rounding of the entries of K. If it is larger than the usual limits of f and e, it replaces them.
    """
    return (force < max(FORCE, unit)) & (energy <= max(SUMS, unit))


def costs_nothing(K: Matrix, x: Array, unit: float = 0.0) -> Array:
    """Which columns of x (n, k) fulfil Kx = 0 within rounding, bool, shape (k,); see `is_rigid`."""
    return is_rigid(*costs(K, x), unit)


def bare(K: Matrix, rows: Array | slice = slice(None)) -> Array:
    """Which rows of K contain only rounding: rows of zeros, and rows that a semidefinite K cannot have; bool (m,).

    K ≥ 0 implies k_ij² ≤ k_ii k_jj. If |k_ij| is larger, but only rounding compared with k_jj, it shows the size of the rounding
    in row i. Contact normals that are tilted by rounding cause such rows.
    """
    diagonal, entries = K.diagonal(), sp.coo_array(K[rows])
    own = diagonal[rows]
    (at, j), size = entries.coords, np.abs(entries.data)
    rounding = (np.arange(len(diagonal))[rows][at] != j) & (size <= SUMS * diagonal[j])
    rounding &= size**2 > (1 + SOFT) * np.maximum(own[at], 0.0) * diagonal[j]
    known, most = np.zeros(len(own)), np.zeros(len(own))
    np.maximum.at(known, at[rounding], size[rounding])
    np.maximum.at(most, at, size)
    return np.asarray(most <= known)


def pieces(K: Matrix) -> Array:
    """The number of the piece of each DOF, (n,). Entries |k_ij| > SOFT √(k_ii k_jj) connect the DOF of a piece. Computed once."""
    def found() -> Array:
        entries = sp.coo_array(K)
        strong = _strengths(K, entries) > SOFT
        graph = sp.coo_array((np.ones(np.count_nonzero(strong)), tuple(at[strong] for at in entries.coords)), shape=K.shape)
        return np.asarray(connected_components(sp.csr_array(graph), directed=False)[1])

    return shared((K,), "pieces", found, lambda piece: piece.nbytes)


def soft_springs(K: Matrix, unit: float) -> Matrix:
    """The entries of K between pieces, which are soft springs, sparse (n, n); computed once.

    Entries within rounding are left out. The limit is SUMMED times larger for a dense K, whose entries may be sums of products.
    """
    def found() -> Matrix:
        entries = sp.coo_array(K)
        dust = max(SUMS, unit) * (1.0 if sp.issparse(K) else SUMMED)
        size = _strengths(K, entries)
        if not ((size > dust) & (size <= SOFT)).any():  # then no graph is needed
            return sp.csr_array(K.shape)
        return links(K, pieces(K), dust)

    return shared((K,), ("soft springs", unit), found, lambda link: 12.0 * link.nnz)


def _strengths(K: Matrix, entries: Matrix) -> Array:
    """|k_ij| / √(k_ii k_jj) of each entry, (nnz,)."""
    scale = units(K)
    i, j = entries.coords
    return np.asarray(np.abs(entries.data) * scale[i] * scale[j])


def rigid_count(K: Matrix, values: Array, x: Array, cost: tuple[Array, Array], unit: float) -> int:
    """The number of rigid modes among the modes x (n, k) with ω² in `values`, in ascending order, and with `cost` from `costs`.

    `unit` is the rounding of K's entries.

    A mode is rigid if its energy is only rounding and its ω² is far below the next ω². The gap is needed: the energy of the first
    bending mode of a long beam may be within rounding, too. But the second ω² is at most 81 times higher, if no end is on a
    spring. The wider the gap, the larger the energy that counts as rounding.
    """
    size, found = np.abs(values), 0
    force, energy = cost
    share, free, link = np.abs(energy), is_rigid(force, energy), soft_springs(K, unit)
    softly = bool(free.any() and link.nnz)
    for limit, gap in ((0.0, BENDING), WIDE, (unit, WRITTEN)):
        elastic = ~is_rigid(force, energy, limit)
        count = most = int(np.argmax(elastic)) if elastic.any() else len(size)
        while count and softly and strains(link, x[:, :count], pieces(K), 1 / units(K)):
            count -= 1
        if limit and count == len(size):
            continue  # without an elastic mode there is no gap
        if limit == WIDE[0] and (softly or not free[:count].any()):
            continue  # soft springs inside cause such a gap, and so does a soft mount of the whole model
        wanted = gap if count == most and (limit or not softly) else MIXED
        while 0 < count < len(size) and size[count - 1] > wanted * size[count]:
            if softly and share[count - 1] <= EPS < MIXED * share[count]:
                break
            count -= 1
        found = max(found, count)
    return found


def _alike(piece: Array) -> Iterator[tuple[Array, Array]]:
    """Yields, for each size s of pieces, the pieces (p,) of this size and their DOF (p, s)."""
    order, sizes = np.argsort(piece, kind="stable"), np.bincount(piece)
    start = np.cumsum(sizes) - sizes
    for size in np.unique(sizes[sizes > 0]):
        of = np.flatnonzero(sizes == size)
        yield of, order[start[of, None] + np.arange(size)]


def _in_blocks(indptr: Array, columns: int) -> Iterator[tuple[slice, Array, Array]]:
    """Yields blocks of whole rows of a sparse matrix: the slice of their entries, the row of each entry, and each row's start.

    `columns` is the number of floats that a temporary array needs for each entry.
    """
    at = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    first = 0
    while first < len(at):
        reached = np.searchsorted(indptr, first + ENTRIES // columns, "right") - 1
        last = int(indptr[max(reached, at[first] + 1)])
        yield slice(first, last), at[first:last], np.flatnonzero(np.diff(at[first:last], prepend=-1))
        first = last


def elastic_forces(K: Matrix, X: Array, Z: Array, piece: Array) -> tuple[Array, Array]:
    """KX (n, k) for a K with K Z = 0, and the size of the terms that cancel in it.

    In the rows of each piece, X is taken relative to the rigid motion of the piece. Otherwise rounding would hide the forces of
    soft springs: the row sums of K have few digits, but K Z = 0 gives them exactly.
    """
    scale = 1 / units(K)[:, None]
    own, moved = np.zeros((int(piece.max(initial=0)) + 1, Z.shape[1], X.shape[1])), X.copy()
    for of, at in _alike(piece):
        inverse = np.linalg.pinv(scale[at] * Z[at], rcond=DEPENDENT)
        for _ in range(2):  # the first step leaves rigid motion of the size of X's rounding
            change = inverse @ (scale[at] * moved[at])
            own[of], moved[at] = own[of] + change, moved[at] - Z[at] @ change
    if len(own) == 1:
        return K @ moved, abs(K) @ np.abs(moved)
    entries = sp.coo_array(K)
    between = piece[entries.row] != piece[entries.col]
    inside = sp.csr_array((np.where(between, 0.0, entries.data), entries.coords), shape=K.shape)
    across = sp.csr_array((entries.data[between], (entries.row[between], entries.col[between])), shape=K.shape)
    forces, sizes = inside @ moved, abs(inside) @ np.abs(moved)
    for part, rows, start in _in_blocks(across.indptr, X.shape[1] * max(Z.shape[1], 1)):
        j = across.indices[part]
        apart = own[piece[j]] - own[piece[rows]]  # antisymmetric, so that the two forces of a spring balance each other
        beyond = moved[j] + np.einsum("er,erk->ek", Z[j], apart)
        beyond *= across.data[part, None]
        forces[rows[start]] += np.add.reduceat(beyond, start)
        sizes[rows[start]] += np.add.reduceat(np.abs(beyond), start)
    return forces, sizes


def links(K: Matrix, piece: Array, dust: float) -> Matrix:
    """The entries of K between pieces, without rounding: |k_ij| > dust √(k_ii k_jj); sparse (n, n)."""
    entries = sp.coo_array(K)
    i, j = entries.coords
    between = (piece[i] != piece[j]) & (_strengths(K, entries) > dust)
    return sp.csr_array((entries.data[between], (i[between], j[between])), shape=K.shape)


def strains(link: Matrix, X: Array, piece: Array, scale: Array, rest: float = 1e-6, least: float = 1e-3) -> bool:
    """Whether soft springs load a piece that is at rest in some combination of the motions X (n, k).

    Between stiff pieces the stiffness of a soft spring, and so the energy of X, may be rounding. But the entries of K between the
    pieces, `link`, have all their digits. `scale` (n,) is 1 over the units of the DOF.

    A piece is at rest if it moves at most the share `rest` of its largest motion: X has the rounding of a solve. It is loaded if
    the work of the springs' forces on a motion of the piece exceeds the share `least` of the sum of its absolute terms.
    """
    k = X.shape[1]
    U, still = np.zeros_like(X), np.zeros((int(piece.max(initial=0)) + 1, k, k))
    for of, at in _alike(piece):
        moved = scale[at, None] * X[at]
        size, V = np.linalg.svd(np.linalg.qr(moved, mode="r"), full_matrices=True)[1:]
        size = np.pad(size, ((0, 0), (0, k - size.shape[1])))
        moves = size > rest * size.max(axis=1, initial=0.0, keepdims=True)
        over = np.divide(1.0, size, out=np.zeros_like(size), where=moves)
        U[at] = moved @ (V.transpose(0, 2, 1) * over[:, None]) / scale[at, None]
        still[of] = V.transpose(0, 2, 1) * ~moves[:, None]
    entries = sp.coo_array(link)
    order = np.argsort(piece[entries.row], kind="stable")
    i, j, stiffness = entries.row[order], entries.col[order], entries.data[order, None]
    for part, of, start in _in_blocks(np.append(0, np.cumsum(np.bincount(piece[i], minlength=len(still)))), k * k):
        Y = np.einsum("ek,ekj->ej", X[j[part]], still[of])
        work = (U[i[part]] * stiffness[part])[:, :, None] * Y[:, None]
        if (np.abs(np.add.reduceat(work, start)) > least * np.add.reduceat(np.abs(work), start)).any():
            return True
    return False
