"""What is rigid: the motions Z with K Z = 0, and D Z = 0 of some. All else asks here.

Carried: in a reduced or joined model, rounding in VᵀKV and VᵀDV may look like a soft mount or a damper. So the motions are not
looked for there. Those of a full part are found once, and a basis, a joint or a contact says what becomes of them (`Carried`).

By K itself, of full parts alone: u is the relative rounding of K's entries, EPS or more (`rounding_of`). Two ratios say what a
motion x costs (`costs`):

    e = xᵀKx / |x|ᵀ|K||x|,   f = ‖SKx‖ / ‖S|K||x|‖ with S = diag(1/√k_ii).

The energy e of rigid motion is the rounding of a sum of products, and so is that of a soft mount below u; but the forces of a
soft mount add up in f, and those of rounding do not. `rigid_count` decides by both, and by the gap to the next mode.
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
FORCE = SOFT / 16  # f of a rigid-body mode, which rounding may have mixed with others; soft modes of as little energy have more
BENDING = 0.8 * 3.0**-4  # ratio of ω² below that of the first modes of a guided and pinned beam; a fifth is for rounding
MIXED = 0.1  # the same ratio where soft springs show which modes are elastic, and the share of others in a rigid motion
WIDE = 64 * EPS, 1e-6  # energy up to which so wide a gap (ratio of ω²) puts modes with others that are rigid
WRITTEN = 1e-4  # the gap where the energy is within the rounding of a K with fewer digits
SUMMED = 100  # times SUMS: the rounding of an entry of VᵀKV, where 1.4e-13 was seen
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
    def of(cls, shapes: Array, D: Matrix | None, unit: Array, q: Array | None = None) -> RigidMotion:
        """The motions with those first that D does not damp; `unit` (n,) scales the DOF.

        Where their coordinates q (r, k) in a basis are given, shapes = V q, it is q that is returned.
        """
        q = shapes if q is None else q
        if D is None or not shapes.shape[1] or not (D.nnz if sp.issparse(D) else np.any(D)):
            return cls(q, q.shape[1])
        far = (np.abs(shapes) / unit[:, None]).max(axis=0)  # no motion is rounding beside a larger one
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
        if free.shape[1]:
            turn = turn @ np.hstack([free, np.linalg.qr(free, mode="complete")[0][:, free.shape[1]:]])
        return RigidMotion(self.shapes @ turn, free.shape[1])


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
        q = coordinates(self.X, motion.shapes[self.rest], np.ones(len(self.rest)))
        return None if q is None else RigidMotion(q, motion.free)


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
        acting = []  # of K and D: C at the contact, with `left` Cᵀ below it, times the motion, and the sizes that cancel in that
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
        x = coordinates(self.L, Z @ turn, self.unit)
        if x is None:
            return None
        damped = np.concatenate([np.arange(motion.count) >= motion.free for motion in own])
        brakes = [(sp.csr_array(np.eye(len(damped))[damped]),) * 2, *((A @ Z, abs(A) @ size) for A in self.dampers)]
        B, whole = _stacked(brakes, Z.shape[1])
        far = largest(sp.csr_array(size.T) @ sp.diags_array(1 / self.unit))
        return RigidMotion(x, 0).mixed(np.eye(turn.shape[1]), null_space(B @ turn, whole @ sizes(turn, 1 / far)))


def coordinates(L: Matrix, q: Array, unit: Array) -> Array | None:
    """x (k, r) with L x = q (n, r), by least squares in `unit` (n,) of the DOF; None where there is none."""
    q = q / unit[:, None]
    x = np.zeros((L.shape[1], q.shape[1]))
    if sp.issparse(L):
        L = sp.csc_array(sp.diags_array(1 / unit) @ sp.csr_array(L))
        used = np.flatnonzero(np.diff(L.indptr))  # multipliers move nothing
        L = L[:, used]
        gram = sp.csc_array(L.T @ L)
        scale = sp.diags_array(gram.diagonal() ** -0.5)
        factor = splu(sp.csc_array(scale @ gram @ scale))
        for _ in range(3):  # two corrections
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
    """Conditions and their sizes below each other, dense, (m, columns) each."""
    none = sp.csr_array((0, columns))
    one, other = (sp.vstack([none, *(block[side] for block in blocks)]).toarray() for side in (0, 1))
    return one, other


def loose_by_places(part: Substructure, held: Array) -> int:
    """How many motions of a rigid body leave the DOF `held` at rest and cost no energy, as far as places of DOF say; else 0."""
    dofs = part.dofs
    if dofs is None or dofs.no_rigid or dofs.size != part.size or not 0 < len(held) < part.size:
        return 0
    R = dofs.rigid()
    R = R[:, R.any(axis=0)]
    R, size, _ = np.linalg.svd(R / np.linalg.norm(R, axis=0), full_matrices=False)
    R = R[:, size > DEPENDENT * size.max(initial=0.0)]  # of DOF on a line, or in one direction, motions are the same
    still = null_space(R[held], sizes(R, energy_units(part))[held])
    if still is None or not still.shape[1]:
        return 0
    at_rest = R @ still
    at_rest[held] = 0.0
    return still.shape[1] if costs_nothing(part.K, at_rest).all() else 0


def of_few_digits(M: Array, D: Array | None, K: Array, dofs: DofMap, lost: float, written: bool) -> RigidMotion | None:
    """The rigid motions that K of a superelement does not resist; None where there are none. Interface DOF come first.

    K has lost some digits, so that its rigid motions are no motions without any force. Where the places of the DOF are known,
    they are those of a rigid body that K resists up to `lost`, each DOF measured in the unit of its own stiffness. Else they are
    found from a `written` K, which has lost up to `lost` of each entry, if the next motion costs far more.
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
    """How far each DOF of a model moves at unit energy, (n,); see `units`."""
    return units_of_energy(model.M.diagonal(), model.K.diagonal())[0]


def by_places(part: Substructure) -> RigidMotion | None:
    """The motions of a rigid body, by the places of a full part's DOF, that K does not resist.

    None where places are not known, or rounding leaves it open.
    """
    if part.dofs is None or part.dofs.no_rigid:
        return None
    R = part.dofs.rigid()
    R = R[:, R.any(axis=0)]
    free = null_space(part.K @ R, abs(part.K) @ np.abs(R))
    return None if free is None else RigidMotion.of(R @ free, part.D, energy_units(part))


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
        return null_space(np.vstack([B for B, _ in terms]), np.vstack([size for _, size in terms]))

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


def rounding(K: Matrix) -> float:
    """The relative rounding u of the entries of K, see `rounding_of`; computed once."""
    return _translated(K)[0]


def annihilates_a_translation(K: Matrix, unit: float = 0.0) -> bool:
    """Whether a uniform motion of every s-th DOF has no elastic energy: a cheap test for a floating component."""
    return bool(is_rigid(*_translated(K)[1:], unit).any())


def _translated(K: Matrix) -> tuple[float, Array, Array]:
    """The rounding of K's entries, and the `costs` of translations; computed once."""
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
    """f and e of each column of x (n, k), (k,) each; 0 where nothing acts. `forces` are Kx and |K||x|, where they are known."""
    force, size = (K @ x, abs(K) @ np.abs(x)) if forces is None else forces
    unit = units(K)[:, None]
    energy, whole = np.einsum("ij,ij->j", x.conj(), force).real, np.einsum("ij,ij->j", np.abs(x), size)
    length, scale = (np.linalg.norm(unit * part, axis=0) for part in (force, size))
    return (np.divide(length, scale, out=np.zeros(len(scale)), where=scale > 0),
            np.divide(energy, whole, out=np.zeros_like(energy), where=whole > 0))


def is_rigid(force: Array, energy: Array, unit: float = 0.0) -> Array:
    """Which of the `costs` are those of rigid-body motion, but not of a mode on a soft mount, bool, shape (k,).

    `unit` is the rounding of the entries of K, if it is more than eps: it bounds both ratios.
    """
    return (force < max(FORCE, unit)) & (energy <= max(SUMS, unit))


def costs_nothing(K: Matrix, x: Array, unit: float = 0.0) -> Array:
    """Which columns of x (n, k) have Kx = 0 within rounding, bool, shape (k,); see `is_rigid`."""
    return is_rigid(*costs(K, x), unit)


def bare(K: Matrix, rows: Array | slice = slice(None)) -> Array:
    """Which DOF of these rows K gives no stiffness but rounding: rows of zeros, and rows that no K ≥ 0 can have; bool (m,).

    K ≥ 0 has k_ij² ≤ k_ii k_jj. Where k_ij is larger, and rounding beside k_jj, the rounding of row i is of its size. Contact
    normals that are tilted by rounding make such rows.
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
    """Which piece each DOF belongs to, (n,): pieces hold together by |k_ij| > SOFT √(k_ii k_jj). Computed once."""
    def found() -> Array:
        entries = sp.coo_array(K)
        strong = _strengths(K, entries) > SOFT
        graph = sp.coo_array((np.ones(np.count_nonzero(strong)), tuple(at[strong] for at in entries.coords)), shape=K.shape)
        return np.asarray(connected_components(sp.csr_array(graph), directed=False)[1])

    return shared((K,), "pieces", found, lambda piece: piece.nbytes)


def soft_springs(K: Matrix, unit: float) -> Matrix:
    """The springs that alone join pieces, and are nearly rounding beside their stiffness, sparse (n, n); computed once.

    Entries of a dense K may be sums of products, and are rounding up to SUMMED times as large.
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
    """How many of the modes x (n, k) are rigid, with their ω² in `values`, smallest first, and their `costs`.

    `unit` is the rounding of K's entries.

    A mode is rigid if its energy is only rounding and its ω² lies well below the next. The gap is needed: the first bending mode
    of a long beam may be within rounding, too, but the second is at most 81 times higher, if no end is on a spring. The wider the
    gap, the more rounding is believed.
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
            continue  # nothing shows a gap
        if limit == WIDE[0] and (softly or not free[:count].any()):
            continue  # soft springs inside make such a gap; or all stands on one mount that is soft, but not rounding
        wanted = gap if count == most and (limit or not softly) else MIXED
        while 0 < count < len(size) and size[count - 1] > wanted * size[count]:
            if softly and share[count - 1] <= EPS < MIXED * share[count]:
                break
            count -= 1
        found = max(found, count)
    return found


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
    scale = 1 / units(K)[:, None]
    own, moved = np.zeros((int(piece.max(initial=0)) + 1, Z.shape[1], X.shape[1])), X.copy()
    for of, at in _alike(piece):
        inverse = np.linalg.pinv(scale[at] * Z[at], rcond=DEPENDENT)
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


def links(K: Matrix, piece: Array, dust: float) -> Matrix:
    """The entries of K that join pieces, and are no rounding: |k_ij| > dust √(k_ii k_jj); sparse (n, n)."""
    entries = sp.coo_array(K)
    i, j = entries.coords
    between = (piece[i] != piece[j]) & (_strengths(K, entries) > dust)
    return sp.csr_array((entries.data[between], (i[between], j[between])), shape=K.shape)


def strains(link: Matrix, X: Array, piece: Array, scale: Array, rest: float = 1e-6, least: float = 1e-3) -> bool:
    """Whether a combination of the motions X (n, k), in which one piece rests, moves it by the springs that lead there.

    A piece rests that moves up to the share `rest` of the largest of its motions: X has the rounding of a solve. It is moved if
    more than the share `least` of the forces that cancel is left.

    Between stiff pieces a soft spring may be rounding beside their own stiffness, and so may the energy of X. The entries that
    join them have all their digits. `scale` (n,) is 1 over the units of the DOF.
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
