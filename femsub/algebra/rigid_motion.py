"""Rigid motion of a model, carried from the full parts through reductions, joints and contacts: K Z = 0, and D Z = 0 of some.

In a reduced or joined model, rounding in VᵀKV and VᵀDV may look like a soft mount or a damper. So the motions are not looked for
there. Those of a full part are found once, from its own K. A basis, a joint or a contact says what becomes of them.
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

from femsub.algebra.elimination import largest
from femsub.algebra.matrices import block_diagonal, is_symmetric, same
from femsub.algebra.processes.cache import shared
from femsub.checks import Array, Matrix

if TYPE_CHECKING:
    from femsub.model import Substructure

ROUNDING = 1e-13  # share of the forces that cancel in A z below which A z is rounding
FREE = 1e-9  # a motion meets conditions that it violates by less than this, relative to the terms that cancel
CLEAR = 1e-6  # and violates them from here on: between the two nothing can be said
LEAST = 1e-3  # of the largest motion at unit energy: a DOF that moves less may do so by rounding
SAME = 1e-9  # relative distance up to which coordinates describe a given motion
ENTRIES = 4_000_000  # numbers in a temporary


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """The motions Z (n, r) with K Z = 0, ZᵀK = 0. The first `free` of them have D Z = 0, too; no combination of the others."""

    shapes: Array
    free: int
    belong: tuple[Matrix, Matrix] | None = None  # D and K of the reduced part that they were made for

    def belonging(self, M: Matrix, D: Matrix, K: Matrix) -> RigidMotion | None:
        """The motions for these matrices; None if they were made for another K."""
        before = self.belong or (D, K)
        if len(self.shapes) != len(K) or not same(before[1], K):
            return None
        return replace(self if same(before[0], D) else Damped(D, M.diagonal())(self), belong=(D, K))

    @classmethod
    def of(cls, shapes: Array, D: Matrix, unit: Array) -> RigidMotion:
        """The motions with those first that D does not damp; `unit` (n,) scales the DOF."""
        if not shapes.shape[1] or not (D.nnz if sp.issparse(D) else np.any(D)):
            return cls(shapes, shapes.shape[1])
        far = (np.abs(shapes) / unit[:, None]).max(axis=0)  # no motion is rounding beside a larger one
        Z, free = unresisted(D, shapes / far, unit)
        rest = np.setdiff1d(np.arange(Z.shape[1]), free)
        return cls(Z[:, np.append(free, rest)], len(free))

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
        """That of a model of `size` DOF that has none."""
        return RigidMotion(np.zeros((size, 0)), 0)

    @property
    def zeros(self) -> int:
        """How many eigenvalues are at 0: one for each motion, two where D does not damp it."""
        return self.count + self.free

    def mixed(self, turn: Array | None, free: Array | None) -> RigidMotion | None:
        """Z turn, with the directions turn `free` first; None where one of the two is not known."""
        if turn is None or free is None:
            return None
        return RigidMotion(self.shapes @ turn @ _first(free), free.shape[1])


Decide: TypeAlias = "Callable[[Substructure], RigidMotion | None]"


class Source(ABC):
    """Where the rigid motion of a model comes from. It is found when it is asked for."""

    @abstractmethod
    def found(self, decide: Decide) -> RigidMotion | None:
        """The motion; `decide` finds that of a part that knows of none. None where rounding leaves it open."""


Carried: TypeAlias = RigidMotion | Source | None


def found(carried: Carried, decide: Decide) -> RigidMotion | None:
    """The rigid motion that a model carries; None if it carries none, or if rounding leaves it open."""
    return carried.found(decide) if isinstance(carried, Source) else carried


@dataclass(frozen=True, eq=False)
class Changed(Source):
    """That of another model, changed by one step."""

    before: Carried
    step: Callable[[RigidMotion], RigidMotion | None]

    def found(self, decide: Decide) -> RigidMotion | None:
        first: Carried = self
        steps = []
        while isinstance(first, Changed):  # hundreds of contacts are as many steps, too many for calls within calls
            steps.append(first.step)
            first = first.before
        motion = found(first, decide)
        for step in reversed(steps):
            motion = None if motion is None else step(motion)
        return motion


def changed(carried: Carried, step: Callable[[RigidMotion], RigidMotion | None]) -> Carried:
    """What a model carries that differs from another one by one step."""
    return None if carried is None else Changed(carried, step)


@dataclass(frozen=True, eq=False)
class Scaled:
    """x = diag(unit) x': coordinates in other units."""

    unit: Array

    def __call__(self, motion: RigidMotion) -> RigidMotion:
        return RigidMotion(motion.shapes / self.unit[:, None], motion.free)


@dataclass(frozen=True, eq=False)
class Restricted:
    """x = X x' for some of the DOF, `rest`; the others do not move."""

    X: Matrix
    rest: Array

    def __call__(self, motion: RigidMotion) -> RigidMotion | None:
        Z, X = motion.shapes[self.rest], self.X.toarray() if sp.issparse(self.X) else self.X
        size = np.linalg.norm(X, axis=0)
        q = np.linalg.lstsq(X / size, Z, rcond=None)[0]
        if np.linalg.norm(Z - X / size @ q) > SAME * np.linalg.norm(Z):
            return None
        return RigidMotion(q / size[:, None], motion.free)


@dataclass(frozen=True, eq=False)
class Damped:
    """Another D; `mass` (n,) scales the DOF."""

    D: Matrix
    mass: Array

    def __call__(self, motion: RigidMotion) -> RigidMotion:
        return RigidMotion.of(motion.shapes, self.D, np.where(self.mass > 0, self.mass, 1.0) ** -0.5)


@dataclass(frozen=True, eq=False)
class Touched:
    """W C_D Wᵀ added to D and W C_K Wᵀ to K: what the contact holds is no rigid motion, and what it brakes is not free.

    Without `left` a motion that friction drives counts as well: K z = 0, but zᵀK ≠ 0.
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
        stiff, brake = (_resisted(C, at, size, self.left) for C in (self.stiffness, self.damping))
        loose = null_space(*stiff)
        if loose is None:
            return None
        damped = np.arange(motion.count) >= motion.free
        more = np.eye(motion.count)[damped] @ loose, brake[0] @ loose
        own = sizes(loose, 1 / np.abs(motion.shapes / self.unit[:, None]).max(axis=0))
        return motion.mixed(loose, null_space(np.vstack(more), np.vstack([own[damped], brake[1] @ own])))


def _resisted(C: Any, at: Array, size: Array, left: bool) -> tuple[Array, Array]:
    """C at, and with `left` Cᵀ at below it, and the sizes that cancel in them."""
    if np.ndim(C) == 0 and not sp.issparse(C):
        return (at, size) if C else (at[:0], size[:0])
    both = C if not left else sp.vstack([C, C.T]) if sp.issparse(C) else np.vstack([C, np.transpose(C)])
    return both @ at, abs(both) @ size


@dataclass(frozen=True, eq=False)
class Joined(Source):
    """That of joined parts: q = L x of all parts, diag(Z_p) c, fulfils A q = 0, and moves no spring.

    Attributes
    ----------
    parts : tuple of Substructure
    L : sparse or dense, shape (N, n)
    unit : ndarray, shape (N,)
        How far each coordinate of the parts moves at unit energy.
    equations : sparse, shape (m, N)
    springs, dampers : tuple of sparse, shape (s, N)
        Motions that springs and dampers act on.
    """

    parts: tuple[Substructure, ...]
    L: Matrix
    unit: Array
    equations: Matrix
    springs: tuple[Matrix, ...]
    dampers: tuple[Matrix, ...]
    belong: tuple[Matrix, Matrix] | None = None  # D and K of the system

    def belonging(self, D: Matrix, K: Matrix) -> Joined | None:
        """The same for these matrices of the system; None if it was made for others."""
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
        x = self._coordinates(Z @ turn)
        if x is None:
            return None
        damped = np.concatenate([np.arange(motion.count) >= motion.free for motion in own])
        brakes = [(sp.csr_array(np.eye(len(damped))[damped]),) * 2, *((A @ Z, abs(A) @ size) for A in self.dampers)]
        B, whole = _stacked(brakes, Z.shape[1])
        far = largest(sp.csr_array(size.T) @ sp.diags_array(1 / self.unit))
        return RigidMotion(x, 0).mixed(np.eye(turn.shape[1]), null_space(B @ turn, whole @ sizes(turn, 1 / far)))

    def _coordinates(self, q: Array) -> Array | None:
        """x with L x = q, or None where there is none: by least squares in units of energy, corrected twice."""
        L = sp.csc_array(sp.diags_array(1 / self.unit) @ sp.csr_array(self.L))
        q = q / self.unit[:, None]
        used = np.flatnonzero(np.diff(L.indptr))  # multipliers move nothing
        L = L[:, used]
        gram = sp.csc_array(L.T @ L)
        scale = sp.diags_array(gram.diagonal() ** -0.5)
        factor = splu(sp.csc_array(scale @ gram @ scale))
        x = np.zeros((len(used), q.shape[1]))
        for _ in range(3):
            x = x + scale @ factor.solve(np.ascontiguousarray(scale @ (L.T @ (q - L @ x))))
        if (np.linalg.norm(q - L @ x, axis=0) > SAME * np.linalg.norm(q, axis=0)).any():
            return None
        whole = np.zeros((self.L.shape[1], q.shape[1]))
        whole[used] = x
        return whole


def sizes(Z: Array, unit: Array, least: float = LEAST) -> Array:
    """|Z| (n, r), but at least a share of what each column moves the DOF in all, in units (n,)."""
    size = np.abs(Z)
    return size + least * unit[:, None] * (size / unit[:, None]).max(axis=0, initial=0.0)


def _stacked(blocks: list[tuple[Matrix, Matrix]], columns: int) -> tuple[Array, Array]:
    """Conditions and their sizes below each other, dense, (m, columns) each."""
    none = sp.csr_array((0, columns))
    one, other = (sp.vstack([none, *(block[side] for block in blocks)]).toarray() for side in (0, 1))
    return one, other


def null_space(B: Array, size: Array) -> Array | None:
    """N (r, k), the c with B c = 0, where `size` (m, r) ≥ |B| are the terms that cancel in B; None where rounding leaves it open.

    Rows and columns are scaled by `size` first, so that neither units nor masses matter: by the factors that bring its entries
    nearest to 1 in the mean of their logarithms, since a row that joins a large motion to a small one has the largest entry from
    the large one alone.
    """
    r = B.shape[1]
    rows = size.any(axis=1)
    B, size = B[rows], size[rows]
    if not len(B):
        return np.eye(r)
    there = size > 0
    share = there / there.sum(axis=1, keepdims=True)
    log = np.log(size, out=np.zeros_like(size), where=there)
    log -= there * (share * log).sum(axis=1, keepdims=True)
    columns = np.exp(np.linalg.lstsq(np.diag(there.sum(axis=0)) - there.T @ share, log.sum(axis=0), rcond=None)[0])
    widest = (size / columns).max(axis=1, keepdims=True)
    columns *= np.where(there.any(axis=0), (size / columns / widest).max(axis=0), 1.0)
    B = B / widest / columns
    small: Array = np.asarray(np.linalg.qr(B, mode="r")) if len(B) > r else B  # the svd makes a square matrix of all rows
    values, V = np.linalg.svd(small, full_matrices=True)[1:]
    values = np.append(values, np.zeros(r - len(values)))
    if ((values > FREE) & (values < CLEAR)).any():
        return None
    return (V[values <= FREE] / columns).T


def of_places(R: Array, D: Matrix, K: Matrix, unit: Array) -> RigidMotion | None:
    """Of the motions R (n, k) of a rigid body those that K does not resist; None where rounding leaves it open."""
    R = R[:, R.any(axis=0)]
    free = null_space(K @ R, abs(K) @ np.abs(R))
    return None if free is None else RigidMotion.of(R @ free, D, unit)


Rubbing: TypeAlias = "tuple[Matrix, Matrix, Matrix, Array]"


def driven(motion: RigidMotion, contacts: Sequence[Rubbing], unit: Array) -> Array | None:
    """Rigid motions z (n, k) that friction pushes and no contact holds; None where rounding leaves it open.

    Each contact gives W (n, p), N and T (q, p) and S (p, m). It presses against motions with N Wᵀz ≠ 0. Of the others its
    friction acts along those with T Wᵀz ≠ 0. Motions Wᵀz = S s go on by themselves: they are the sliding.
    """
    def at_contacts(Z: Array) -> list[tuple[Array, Array]]:
        return [(W.T @ Z, abs(W).T @ sizes(Z, unit)) for W, *_ in contacts]

    def annulled(by: int, moved: list[tuple[Array, Array]]) -> Array | None:
        terms = [(contact[by] @ u, abs(contact[by]) @ size) for contact, (u, size) in zip(contacts, moved, strict=True)]
        return null_space(*map(np.vstack, zip(*terms, strict=True)))

    loose = annulled(1, at_contacts(motion.shapes))
    if loose is None or not loose.shape[1]:
        return loose if loose is None else motion.shapes @ loose
    Z = motion.shapes @ loose
    Z = Z / np.abs(Z / unit[:, None]).max(axis=0)
    moved = at_contacts(Z)
    along = annulled(2, moved)
    steady = la.block_diag(*(S * (size.max(initial=0.0) / np.abs(S).max(initial=1e-300))  # as large as the motions beside it
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


def _first(free: Array) -> Array:
    """A regular (r, r) whose first columns are those of `free` (r, k)."""
    r, k = free.shape
    if not k:
        return np.eye(r)
    return np.hstack([free, np.linalg.qr(free, mode="complete")[0][:, k:]])


def unresisted(A: Matrix, Z: Array, unit: Array) -> tuple[Array, Array]:
    """The motions Z (n, r) rotated such that as many as possible have Az = 0, and the indices of those; `unit` scales the DOF.

    A may be several matrices below each other, and `unit` as often the same.
    """
    turn, free = undamped(A, Z, unit)
    return Z @ turn, free


def undamped(A: Matrix, Z: Array, unit: Array) -> tuple[Array, Array]:
    """The rotation (r, r) of `unresisted`, and the indices of the motions with Az = 0."""
    turn = np.linalg.svd(unit[:, None] * (A @ Z), full_matrices=False)[2].T
    size = sizes(Z, unit[:len(Z)], 1.0).sum(axis=1)  # of all: one at rest at the dashpot has no scale
    scale = np.linalg.norm(unit * (abs(A) @ size))
    return turn, np.flatnonzero(np.linalg.norm(unit[:, None] * (A @ (Z @ turn)), axis=0) <= ROUNDING * scale)


def without(A: Array, Z: Array, unit: Array) -> Array:
    """PᵀAP (n, n) with PZ = 0: A Z is rounding and becomes 0. P is orthogonal in the given units of the coordinates.

    Of an A that is not symmetric, only its product with Z is removed.
    """
    if not Z.shape[1]:
        return A
    scaled = Z / unit[:, None]
    force = A @ Z
    if not force.any():
        return A
    # ZᵀG = I; motions may depend on each other where only some of the coordinates are looked at
    G = np.linalg.pinv(scaled, rcond=SAME).T / unit[:, None]
    if not is_symmetric(A):
        return A - force @ G.T
    result = A - force @ G.T - G @ force.T + G @ (Z.T @ force) @ G.T
    return (result + result.T) / 2


def size_of_products(A: Matrix, V: Matrix) -> Array:
    """g (r, 1) with |v_i|ᵀ|A||v_j| ≤ g_i g_j: one rounding in each entry of A changes VᵀAV by at most EPS g gᵀ.

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
    return np.sqrt(np.einsum("i,ij,ij->j", weight, V, V, optimize=False)).reshape(-1, 1)  # V² would take as much memory as V


def pieces(K: Matrix, weak: float) -> Array:
    """Which piece each DOF belongs to, (n,): pieces hold together by |k_ij| > weak √(k_ii k_jj)."""
    entries = sp.coo_array(K)
    i, j = entries.coords
    scale = _scale(K)
    strong = np.abs(entries.data) > weak * scale[i] * scale[j]
    graph = sp.coo_array((np.ones(np.count_nonzero(strong)), (i[strong], j[strong])), shape=K.shape)
    return np.asarray(connected_components(sp.csr_array(graph), directed=False)[1])


def _alike(piece: Array) -> Iterator[tuple[Array, Array]]:
    """The pieces (p,) of each size s, and their DOF (p, s)."""
    order, sizes = np.argsort(piece, kind="stable"), np.bincount(piece)
    start = np.cumsum(sizes) - sizes
    for size in np.unique(sizes[sizes > 0]):
        of = np.flatnonzero(sizes == size)
        yield of, order[start[of, None] + np.arange(size)]


def _in_blocks(indptr: Array, columns: int) -> Iterator[tuple[slice, Array, Array]]:
    """Whole rows of a sparse matrix, some at a time: the slice of their entries, the row of each, and where each row begins.

    `columns` is how many numbers a temporary takes for each entry.
    """
    at = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    first = 0
    while first < len(at):
        reached = np.searchsorted(indptr, first + ENTRIES // columns, "right") - 1
        last = int(indptr[max(reached, at[first] + 1)])
        yield slice(first, last), at[first:last], np.flatnonzero(np.diff(at[first:last], prepend=-1))
        first = last


def elastic_forces(K: Matrix, X: Array, Z: Array, piece: Array) -> tuple[Array, Array]:
    """KX (n, k) where K Z = 0, and the sizes that cancel: for each piece's rows, of X without the rigid motion of the piece.

    Beside a soft spring KX is rounding: the entries of K are known, but not their sums, which K Z = 0 says.
    """
    scale = _scale(K)[:, None]
    own, moved = np.zeros((int(piece.max(initial=0)) + 1, Z.shape[1], X.shape[1])), X.copy()
    for of, at in _alike(piece):
        inverse = np.linalg.pinv(scale[at] * Z[at], rcond=SAME)
        for _ in range(2):  # what the first step leaves of it is rounding of X
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
        apart = own[piece[j]] - own[piece[rows]]  # the same both ways, so that the two forces of a spring balance each other
        beyond = moved[j] + np.einsum("er,erk->ek", Z[j], apart)
        beyond *= across.data[part, None]
        forces[rows[start]] += np.add.reduceat(beyond, start)
        sizes[rows[start]] += np.add.reduceat(np.abs(beyond), start)
    return forces, sizes


def _scale(K: Matrix) -> Array:
    diagonal = K.diagonal()
    return np.sqrt(np.where(diagonal > 0, diagonal, 1.0))


def links(K: Matrix, piece: Array, dust: float) -> Matrix:
    """The entries of K that join pieces, and are no rounding: |k_ij| > dust √(k_ii k_jj); sparse (n, n)."""
    entries = sp.coo_array(K)
    i, j = entries.coords
    scale = _scale(K)
    between = (piece[i] != piece[j]) & (np.abs(entries.data) > dust * scale[i] * scale[j])
    return sp.csr_array((entries.data[between], (i[between], j[between])), shape=K.shape)


def strains(link: Matrix, X: Array, piece: Array, scale: Array) -> bool:
    """Whether a combination of the motions X (n, k), in which one piece rests, moves it by the springs that lead there.

    Between stiff pieces a soft spring may be rounding beside their own stiffness, and so may the energy of X. The entries that
    join them have all their digits. `scale` (n,) is 1 over the units of the DOF.
    """
    k = X.shape[1]
    U, rest = np.zeros_like(X), np.zeros((int(piece.max(initial=0)) + 1, k, k))
    for of, at in _alike(piece):
        moved = scale[at, None] * X[at]
        size, V = np.linalg.svd(np.linalg.qr(moved, mode="r"), full_matrices=True)[1:]
        size = np.pad(size, ((0, 0), (0, k - size.shape[1])))
        moves = size > CLEAR * size.max(axis=1, initial=0.0, keepdims=True)
        over = np.divide(1.0, size, out=np.zeros_like(size), where=moves)
        U[at] = moved @ (V.transpose(0, 2, 1) * over[:, None]) / scale[at, None]
        rest[of] = V.transpose(0, 2, 1) * ~moves[:, None]
    entries = sp.coo_array(link)
    order = np.argsort(piece[entries.row], kind="stable")
    i, j, stiffness = entries.row[order], entries.col[order], entries.data[order, None]
    for part, of, start in _in_blocks(np.append(0, np.cumsum(np.bincount(piece[i], minlength=len(rest)))), k * k):
        Y = np.einsum("ek,ekj->ej", X[j[part]], rest[of])
        work = (U[i[part]] * stiffness[part])[:, :, None] * Y[:, None]
        if (np.abs(np.add.reduceat(work, start)) > LEAST * np.add.reduceat(np.abs(work), start)).any():
            return True
    return False
