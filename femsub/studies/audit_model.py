"""What an audit looks at: the small matrices as they are, faults and all, and what is stated of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from femsub.checks import EPS, EQUAL, Array

if TYPE_CHECKING:
    from femsub.model import DofMap, RigidMotion

AXES = ("ux", "uy", "uz", "rx", "ry", "rz")
HELD_KIND, FREE_KINDS = "fixed-interface", ("free", "free and inertia relief")
PHYSICAL = ("constraint", "interface")  # kinds of coordinates beside which free modes are not alone
SPREAD = "interface mode"  # a kind that no single frequency is the cut-off of
AGREE = 1e-6  # relative difference of entries, energies and ω² of one model as two programs write them, with seven digits
SHAPED = 1e-4  # the same of what is linear in shapes, which have half the digits of their energies, and of clusters of ω
ROUNDING = 256 * EPS  # of sums in products with large matrices


@dataclass(frozen=True, eq=False)
class SmallModel:
    """The matrices (r, r) of a reduced model and what is stated of it; what is not stated is None, or NaN.

    `places` are the coordinates that are interface DOF, `rows` the interface as rows of V (n, r). `carried` is the rigid motion
    that the model carries.
    """

    name: str
    M: Array
    K: Array
    D: Array | None = None
    V: Array | None = None
    kinds: tuple[str, ...] = ()
    places: Array | None = None
    rows: Array | None = None
    dofs: DofMap | None = None
    cutoff: float = np.nan
    carried: RigidMotion | None = None
    mass: float | None = None
    floating: bool | None = None
    gyroscopic: bool = False
    units: str = ""

    @property
    def size(self) -> int:
        return len(self.M)

    @property
    def given(self) -> dict[str, Array]:
        """The matrices that are there, by name."""
        every = {"M": self.M, "K": self.K, "D": self.D, "V": self.V}
        return {key: A for key, A in every.items() if A is not None}

    @property
    def motion(self) -> Array | None:
        """The shapes (r, k) of the rigid motion that the model carries."""
        return None if self.carried is None else self.carried.shapes

    @cached_property
    def B(self) -> Array:
        """(n_b, r) with u_b = B q; without rows where no interface is known."""
        if self.places is not None and len(self.places):
            return np.eye(self.size)[self.places]
        return self.V[self.rows] if self.V is not None and self.rows is not None else np.zeros((0, self.size))

    @cached_property
    def parted(self) -> tuple[Array, Array, Array]:
        """U (n_b, k), P (r, k) and N (r, r - k): B P = U, B N = 0, UᵀU = I. U are the motions that the interface can make."""
        if self.places is not None and len(self.places):
            inside = np.setdiff1d(np.arange(self.size), self.places)
            return np.eye(len(self.places)), np.eye(self.size)[:, self.places], np.eye(self.size)[:, inside]
        if not len(self.B):
            return np.zeros((0, 0)), np.zeros((self.size, 0)), np.eye(self.size)
        size = np.linalg.norm(self.B, axis=0)  # coordinates have units of their own
        unit = np.where(size > EQUAL * size.max(initial=0.0), size, 1.0)
        U, s, W = np.linalg.svd(self.B / unit)
        k = int(np.count_nonzero(s > EQUAL * s.max(initial=0.0)))
        return U[:, :k], W[:k].T / s[:k] / unit[:, None], W[k:].T / unit[:, None]

    @cached_property
    def static(self) -> Array | None:
        """X (r, k): the static response to motions U of the interface, B X = U; None where the inside has no firm hold."""
        _, P, N = self.parted
        if not N.shape[1]:
            return P
        inner = N.T @ self.K @ N
        unit = units(inner)
        if np.linalg.eigvalsh(inner * np.outer(unit, unit)).min() <= 1e-13:
            return None
        inner = inner * np.outer(unit, unit)
        return P - N @ (unit[:, None] * la.solve(inner, unit[:, None] * (N.T @ self.K @ P), assume_a="pos"))

    @cached_property
    def massless(self) -> Array:
        """Coordinates without mass, as those of MacNeal's interface."""
        return np.flatnonzero(~self.M.any(axis=0) & (self.K.diagonal() > 0))

    @cached_property
    def mass_rank(self) -> int:
        """The rank of M, but for rounding."""
        return int(np.linalg.matrix_rank(scaled(self.M), ROUNDING, hermitian=True))

    @cached_property
    def projected(self) -> bool:
        """Whether M is that of a Ritz model. MacNeal's is not: its free modes alone have mass."""
        return self.basis != "free" or self.mass_rank == self.size

    @cached_property
    def basis(self) -> str:
        """'held' for modes of a held interface, 'free' for free ones, '' where that is not known."""
        if self.kinds:
            if SPREAD in self.kinds:
                return ""
            if HELD_KIND in self.kinds or set(self.kinds) <= {"constraint", "rigid", "static port"}:
                return "held"
            return "free" if set(self.kinds) & set(FREE_KINDS) else ""
        if self.places is None or not len(self.places):
            return ""
        inside = np.setdiff1d(np.arange(self.size), self.places)
        M, K = (A[np.ix_(inside, inside)] for A in (self.M, self.K))
        if max(coupling(self.K, self.places, inside), off_diagonal(M), off_diagonal(K)) <= SHAPED:
            return "held"
        return "free" if len(self.massless) else ""

    @cached_property
    def modal(self) -> Array:
        """The coordinates that are modes, each with a frequency of its own: by their kinds, or those beside the interface."""
        kinds = np.array(self.kinds, dtype=object)
        if len(kinds):
            alone = self.basis == "free" and not set(self.kinds) & set(PHYSICAL)  # Hurty's rigid motions are no modes
            wanted = [HELD_KIND, *(("rigid", "free") if alone else ())]
            return np.flatnonzero([kind in wanted for kind in kinds])
        if self.basis == "held" and self.places is not None:
            return np.setdiff1d(np.arange(self.size), self.places)
        return np.zeros(0, dtype=np.intp)

    @property
    def modal_frequencies(self) -> Array:
        """√(k_ii / m_ii) of the coordinates that are modes, in their order."""
        mass = self.M.diagonal()[self.modal]
        return np.sqrt(np.abs(self.K.diagonal()[self.modal]) / np.where(mass > 0, mass, 1.0))

    @property
    def kept_frequencies(self) -> Array:
        """ω of the modes that the model keeps, ascending: of a free basis with its rigid motions, and what else follows them."""
        if self.basis == "held" and len(self.B) and "static port" not in self.kinds:
            return self.held_frequencies
        return np.sort(self.modal_frequencies) if self.basis == "held" or len(self.modal) else self.free_frequencies

    @cached_property
    def held_frequencies(self) -> Array:
        """ω of the model with its interface at rest."""
        N = self.parted[2]
        return frequencies(N.T @ self.K @ N, N.T @ self.M @ N)

    def energy_unit(self, K: Array, M: Array, rigid: int) -> Array:
        """What the energy of single DOF is compared with, diag K + ω² diag M: a K that is rounding alone has no scale of its own.

        ω is the first frequency of the model above so many rigid motions.
        """
        omega = self.free_frequencies
        return np.abs(K.diagonal()) + float(omega[min(rigid, len(omega) - 1)] ** 2 if len(omega) else 0.0) * M.diagonal()

    @cached_property
    def free_frequencies(self) -> Array:
        """ω of the model by itself, rigid motion and rounding as 0."""
        return frequencies(self.K, self.M)

    @property
    def elastic_frequencies(self) -> Array:
        """Those above 1e-4 of the highest: what lies below is rigid motion, but for rounding."""
        return self.free_frequencies[self.free_frequencies > SHAPED * self.free_frequencies.max(initial=0.0)]

    def strain(self, q: Array) -> float:
        """The largest qᵀKq of the columns of q, over the energy of the single coordinates."""
        whole = q.T**2 @ self.energy_unit(self.K, self.M, q.shape[1])
        return float((np.abs(np.einsum("ij,ij->j", q, self.K @ q)) / np.where(whole > 0, whole, 1.0)).max(initial=0.0))


def units(A: Array) -> Array:
    """1/√a_ii, with 1 where that is not positive."""
    diagonal = A.diagonal()
    return np.where(diagonal > 0, diagonal, 1.0) ** -0.5


def scaled(A: Array) -> Array:
    """a_ij / √(a_ii a_jj). Where a diagonal entry is not positive, the largest of its row stands for it."""
    diagonal, size = A.diagonal(), np.abs(A).max(axis=0, initial=0.0)
    unit = np.where(diagonal > 0, diagonal, np.where(size > 0, size, 1.0)) ** -0.5
    return A * np.outer(unit, unit)


def coupling(A: Array, some: Array, others: Array) -> float:
    """The largest |a_ij| / √(a_ii a_jj) between some coordinates and others."""
    return float(np.abs(scaled(A)[np.ix_(some, others)]).max(initial=0.0))


def off_diagonal(A: Array) -> float:
    """The largest |a_ij| / √(a_ii a_jj), i ≠ j."""
    whole = scaled(A)
    return float(np.abs(whole - np.diag(whole.diagonal())).max(initial=0.0))


def frequencies(K: Array, M: Array) -> Array:
    """ω of Kx = ω²Mx in ascending order, K and M semidefinite; coordinates without mass follow statically."""
    if not len(K):
        return np.zeros(0)
    K, M = (K + K.T) / 2, (M + M.T) / 2
    heaviest = float(M.diagonal().max())
    unit = units(K + np.diag(M.diagonal()) * (K.diagonal().max() / heaviest) if heaviest > 0 else K)
    mass = M * np.outer(unit, unit)
    stiff = K * np.outer(unit, unit)
    values, turn = la.eigh(mass)
    heavy = values > 1e-12 * max(values[-1], 0.0)
    if not heavy.any():
        return np.zeros(0)
    Q = turn[:, heavy]
    inner = Q.T @ stiff @ Q
    if not heavy.all():
        # by 1/(ω² + σ) with σ about the lowest: condensed to Q, stiff coordinates that nearly depend on each other lose digits
        ratios = np.einsum("ij,ij->j", Q, stiff @ Q) / values[heavy]
        shift = float(ratios[ratios > EQUAL * ratios.max()].min(initial=ratios.max()))
        try:
            inverse = la.eigh(mass, stiff + shift * mass, eigvals_only=True)[-len(ratios):][::-1]
            return np.sqrt(np.maximum(1 / inverse - shift, 0.0))
        except la.LinAlgError:  # K + σM is not positive definite: a fault, which another check names
            Z = turn[:, ~heavy]
            inner -= (Q.T @ stiff @ Z) @ np.linalg.pinv(Z.T @ stiff @ Z, rcond=1e-12, hermitian=True) @ (Z.T @ stiff @ Q)
    root = values[heavy] ** -0.5
    found = np.linalg.eigvalsh(inner * np.outer(root, root))
    return np.sqrt(np.maximum(found, 0.0))


def array(value: Any) -> Array:
    """A dense array of float64."""
    return np.asarray(value.toarray() if sp.issparse(value) else value, dtype=float)


def listed(numbers: Sequence[int] | Array, most: int = 4) -> str:
    """'0, 3 and 2 more'."""
    text = ", ".join(str(int(number)) for number in numbers[:most])
    return text + (f" and {len(numbers) - most} more" if len(numbers) > most else "")


def within(difference: Array, A: Array, rounding: Array | float = 0.0) -> Array:
    """|Δ_ij| over √(a_ii a_jj); what is within the rounding counts as none."""
    size = np.sqrt(np.abs(A.diagonal()))
    size = np.where(size > 0, size, EPS * size.max(initial=0.0))
    beyond = np.maximum(np.abs(difference) - rounding, 0.0)
    return np.divide(beyond, np.outer(size, size), out=np.where(beyond > 0, np.inf, 0.0), where=np.outer(size, size) > 0)


def motions(dofs: DofMap) -> tuple[Array, bool]:
    """Rigid motions of the DOF of a map (n_b, k) about the middle of its points, and whether they are all six.

    Translations come first. Rotations need points. A plate's w with its slopes has three.
    """
    labels = np.array([dofs.labels[one] for one in dofs.components])
    deep = np.zeros((len(labels), 3))
    if dofs.points is not None:
        deep[:, :dofs.points.shape[1]] = dofs.points - dofs.points.mean(axis=0)
    x, y, z = deep.T
    if np.isin(labels, ("w", "w,x", "w,y")).all():
        flat = np.stack([labels == "w", np.where(labels == "w", x, labels == "w,x"), np.where(labels == "w", y, labels == "w,y")],
                        axis=1).astype(float)
        few = 1 if dofs.points is None else 1 + min(dofs.points.shape[1], 2)
        return flat[:, :few], False
    if not np.isin(labels, AXES).all():
        return np.zeros((len(labels), 0)), False
    kind = np.array([AXES.index(label) for label in labels])
    found = np.eye(6)[kind]
    none = np.zeros_like(x)
    turned = np.stack([[none, z, -y], [-z, none, x], [y, -x, none]])  # ω × x, by the direction of the DOF and the axis
    for axis in range(3):
        found[kind == axis, 3:] = turned[axis][:, kind == axis].T
    if dofs.points is None or dofs.points.shape[1] < 3:
        return found[:, :3], False
    return found, bool(np.isin(np.arange(3), kind).all())


def body(P: Array, length: float) -> tuple[float, Array, float]:
    """Mass, centre and how far P (6, 6) is from [[m I, -m c×], [m c×, J]] of a rigid body, relative."""
    m = float(np.trace(P[:3, :3])) / 3
    if m <= 0:
        return m, np.zeros(3), np.inf
    moment = (P[:3, 3:] - P[:3, 3:].T) / 2
    centre = np.array([moment[1, 2], moment[2, 0], moment[0, 1]]) / m
    reach = max(length, float(np.sqrt(max(np.trace(P[3:, 3:]), 0.0) / m)))
    wrong = np.abs(P[:3, :3] - m * np.eye(3)).max() / m
    skew = np.abs(P[:3, 3:] + P[:3, 3:].T).max() / (2 * m * reach)
    arm = np.array([[0, -centre[2], centre[1]], [centre[2], 0, -centre[0]], [-centre[1], centre[0], 0]])
    axes = np.linalg.eigvalsh(P[3:, 3:] + m * arm @ arm)  # about the centre
    unlike = max(axes[2] - axes[0] - axes[1], -axes[0], 0.0) / (m * reach**2)
    return m, centre, float(max(wrong, skew, unlike))
