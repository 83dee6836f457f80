"""A reduced model from any source, possibly with faults: its matrices, the kinds of its coordinates, and its rigid motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from femsub import checks
from femsub.checks import EPS, EQUAL, Array, InputError, InputTypeError
from femsub.model import DofMap, Pencil, ReducedSubstructure, RigidMotion, Substructure, by_diagonal, units
from femsub.modes import motion_of, semidefinite_frequencies
from femsub.reduction.frequency_bounds import FrequencyBounds, frequency_bounds

HELD_KIND, FREE_KINDS = "fixed-interface", ("free", "free and inertia relief")
PHYSICAL = ("constraint", "interface")  # kinds of physical coordinates, which a basis may have in addition to free modes
SPREAD = "interface mode"  # a kind of coordinates for which no single frequency is the cut-off
AGREE = 1e-6  # relative difference of entries, energies and ω² of one model as two programs write them, with seven digits
SHAPED = 1e-4  # the same for values linear in shapes, which have half the digits of energies, and for clusters of ω
PRODUCTS = 256 * EPS  # rounding of sums in products with large matrices
ENTRIES = ("M", "K", "D", "V", "kinds", "interface", "full_interface", "dofs", "cutoff", "name")


class Mapped(NamedTuple):
    """Rigid motions R from the DOF map that are independent at the interface: UᵀR, U of `parted`; and their energies, ascending.

    Energies are relative to the energies of single DOF. There are none if R is empty, or if the interface has fewer motions than
    DOF. `free` is the number of all interface motions without energy. `whole` is True if the map has all six rigid motions.
    """

    at: Array
    energy: Array
    free: int
    whole: bool


class Body(NamedTuple):
    """P (6, 6), the mass matrix of the rigid motions from the DOF map; mass, centre, relative error, and the map's extent."""

    P: Array
    mass: float
    centre: Array
    wrong: float
    length: float


@dataclass(eq=False)
class GivenModel:
    """The matrices (r, r) of a reduced model, and further data. Data that are not given are None, or NaN for the cut-off.

    `interface` are the coordinates that are interface DOF, `full_interface` the interface as rows of V (n, r), `carried` the
    rigid motion that the model carries.
    """

    name: str
    M: Array
    K: Array
    D: Array | None = None
    V: Array | None = None
    kinds: tuple[str, ...] = ()
    interface: Array | None = None
    full_interface: Array | None = None
    dofs: DofMap | None = None
    cutoff: float = np.nan
    carried: RigidMotion | None = None

    @classmethod
    def of(cls, reduced: Any, cutoff: float | None = None, **stated: Any) -> Self:
        """The model of a `Substructure`, a `Pencil`, or a mapping with its matrices; `stated` are fields of a derived class.

        Raises
        ------
        InputError, InputTypeError
            `reduced` is of another type; an entry is unknown, or is no matrix; the square of the cut-off may overflow.
        """
        if isinstance(reduced, Mapping):
            given = checks.mapping("reduced", reduced, "names and matrices, as {'M': M, 'K': K}")
            if strange := [key for key in given if key not in ENTRIES]:
                raise InputError(f"reduced has an entry {strange[0]!r}; known are {', '.join(ENTRIES)}")
            if "M" not in given or "K" not in given:
                raise InputError(f"reduced needs M and K, but has {', '.join(given) or 'nothing'}")
            own: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
            own["name"] = str(given.get("name", "model"))
            for key in [key for key in own if key in "MKDV"]:
                value = own[key]
                own[key] = checks.real_array(key, value.toarray() if hasattr(value, "toarray") else value, finite=False)
                if own[key].ndim != 2 or not own[key].size:
                    raise InputError(f"{key} must be a matrix, but its shape is {own[key].shape}")
            for key in [key for key in own if key.endswith("interface")]:
                own[key] = checks.whole_numbers(key, own[key]).astype(np.intp)
            own["kinds"] = tuple(checks.word("kinds", kind) for kind in checks.items("kinds", own.get("kinds", ()), "words"))
            if "dofs" in own:
                checks.instance("dofs", own["dofs"], DofMap)
            if own.get("cutoff", np.inf) != np.inf:
                own["cutoff"] = checks.positive_number("cutoff", own["cutoff"])
        elif isinstance(reduced, (Substructure, Pencil)):
            own = {"name": getattr(reduced, "name", "model"), **{key: dense(getattr(reduced, key)) for key in "MKD"}}
            if isinstance(reduced, Substructure):
                own |= {"interface": reduced.interface if len(reduced.interface) else None, "dofs": reduced.interface_dofs}
            if isinstance(reduced, ReducedSubstructure):
                own |= {"V": np.asarray(reduced.V), "kinds": tuple(reduced.kinds), "full_interface": reduced.full_interface,
                        "cutoff": reduced.cutoff, "carried": motion_of(reduced.rigid_motion)}
        else:
            raise InputTypeError("reduced must be a Substructure, a Pencil or a mapping with M and K, not "
                                 f"{type(reduced).__name__}")
        if cutoff is not None:
            own["cutoff"] = cutoff
        highest = float(np.finfo(float).max) ** 0.25  # ω² times a mass up to 1e154 is finite
        if highest < own.get("cutoff", 0.0) < np.inf:
            raise InputError(f"cutoff must be below {highest:.0e}, so that its square is finite; it is {own['cutoff']:g}")
        return cls(**own, **stated)

    @property
    def size(self) -> int:
        return len(self.M)

    @property
    def given(self) -> dict[str, Array]:
        """The matrices that are given, by name."""
        every = {"M": self.M, "K": self.K, "D": self.D, "V": self.V}
        return {key: A for key, A in every.items() if A is not None}

    @property
    def motion(self) -> Array | None:
        """The shapes (r, k) of the rigid motion that the model carries, if there are any."""
        return None if self.carried is None or not self.carried.count else self.carried.shapes

    @cached_property
    def B(self) -> Array:
        """B (n_b, r), u_b = B q; without rows if no interface is known."""
        if self.interface is not None and len(self.interface):
            return np.eye(self.size)[self.interface]
        return self.V[self.full_interface] if self.V is not None and self.full_interface is not None else np.zeros((0, self.size))

    @cached_property
    def parted(self) -> tuple[Array, Array, Array]:
        """U (n_b, k), P (r, k) and N (r, r - k): B P = U, B N = 0, UᵀU = I. U spans the possible motions of the interface."""
        if self.interface is not None and len(self.interface):
            return np.eye(len(self.interface)), np.eye(self.size)[:, self.interface], np.eye(self.size)[:, self.others]
        if not len(self.B):
            return np.zeros((0, 0)), np.zeros((self.size, 0)), np.eye(self.size)
        size = np.linalg.norm(self.B, axis=0)  # coordinates have units of their own
        unit = np.where(size > EQUAL * size.max(initial=0.0), size, 1.0)
        U, s, W = np.linalg.svd(self.B / unit)
        k = int(np.count_nonzero(s > EQUAL * s.max(initial=0.0)))
        return U[:, :k], W[:k].T / s[:k] / unit[:, None], W[k:].T / unit[:, None]

    @cached_property
    def static(self) -> Array | None:
        """X (r, k): the static response to motions U of the interface, B X = U; None if the interface does not hold the model."""
        _, P, N = self.parted
        if not N.shape[1]:
            return P
        inner = N.T @ self.K @ N
        unit = units(inner)
        inner = inner * np.outer(unit, unit)
        if np.linalg.eigvalsh(inner).min() <= 1e-13:
            return None
        return P - N @ (unit[:, None] * la.solve(inner, unit[:, None] * (N.T @ self.K @ P), assume_a="pos"))

    @cached_property
    def massless(self) -> Array:
        """Coordinates without mass, such as MacNeal's interface DOF."""
        return np.flatnonzero(~self.M.any(axis=0) & (self.K.diagonal() > 0))

    @cached_property
    def mass_rank(self) -> int:
        """The numerical rank of M."""
        return int(np.linalg.matrix_rank(by_diagonal(self.M), PRODUCTS, hermitian=True))

    @cached_property
    def projected(self) -> bool:
        """Whether M is that of a Ritz model. MacNeal's M is not, since only free modes have mass in it."""
        return self.basis == "held" or self.mass_rank == self.size

    @property
    def others(self) -> Array:
        """The coordinates that are not interface DOF."""
        return np.setdiff1d(np.arange(self.size), [] if self.interface is None else self.interface)

    @cached_property
    def basis(self) -> str:
        """'held' for fixed-interface modes, 'free' for free modes, '' if the basis is not known."""
        if self.kinds:
            if SPREAD in self.kinds:
                return ""
            if HELD_KIND in self.kinds or set(self.kinds) <= {"constraint", "rigid", "static port"}:
                return "held"
            return "free" if set(self.kinds) & {*FREE_KINDS, "interface"} else ""
        if self.interface is None or not len(self.interface):
            return ""
        M, K = (A[np.ix_(self.others, self.others)] for A in (self.M, self.K))
        if max(coupling(self.K, self.interface, self.others), off_diagonal(M), off_diagonal(K)) <= SHAPED:
            return "held"
        return "free" if len(self.massless) else ""

    @cached_property
    def modal(self) -> Array:
        """The coordinates that are modes, each with its own frequency: from their kinds, or all but the interface."""
        if not self.kinds:
            return self.others if self.basis == "held" else np.zeros(0, dtype=np.intp)
        alone = self.basis == "free" and not set(self.kinds) & set(PHYSICAL)  # Hurty's rigid motions are no modes
        return np.flatnonzero(np.isin(self.kinds, [HELD_KIND, *(("rigid", "free") if alone else ())]))

    @property
    def modal_frequencies(self) -> Array:
        """√(k_ii / m_ii) of the coordinates that are modes, in their order."""
        mass = self.M.diagonal()[self.modal]
        return np.sqrt(np.abs(self.K.diagonal()[self.modal]) / np.where(mass > 0, mass, 1.0))

    @property
    def kept_frequencies(self) -> Array:
        """ω of the modes that the model keeps, ascending, for a free basis with rigid motion.

        For free modes in physical coordinates these are all ω of the model: higher ω follow those of the kept modes.
        """
        if self.basis == "held" and len(self.B) and "static port" not in self.kinds:
            N = self.parted[2]
            return semidefinite_frequencies(N.T @ self.K @ N, N.T @ self.M @ N)  # the interface at rest
        return np.sort(self.modal_frequencies) if self.basis == "held" or len(self.modal) else self.free_frequencies

    def energy_unit(self, K: Array, M: Array, rigid: int) -> Array:
        """diag K + ω² diag M (r,), the scale for energies of single DOF. diag K alone is no scale if K is rounding only.

        ω is the first frequency of the model above `rigid` rigid motions.
        """
        omega = self.free_frequencies
        return np.abs(K.diagonal()) + float(omega[min(rigid, len(omega) - 1)] ** 2 if len(omega) else 0.0) * M.diagonal()

    @cached_property
    def free_frequencies(self) -> Array:
        """ω of the model with its interface free; rigid motion and rounding count as 0."""
        return semidefinite_frequencies(self.K, self.M)

    @property
    def elastic_frequencies(self) -> Array:
        """The `free_frequencies` above 1e-4 of the highest one. Lower values are rigid motion with rounding."""
        return self.free_frequencies[self.free_frequencies > SHAPED * self.free_frequencies.max(initial=0.0)]

    def strain(self, q: Array) -> float:
        """The largest qᵀKq of the columns of q, relative to the energy of the single coordinates."""
        whole = q.T**2 @ self.energy_unit(self.K, self.M, q.shape[1])
        return float((np.abs(np.einsum("ij,ij->j", q, self.K @ q)) / np.where(whole > 0, whole, 1.0)).max(initial=0.0))

    @cached_property
    def mapped(self) -> Mapped | None:
        """The rigid motions from the DOF map of the interface, and their energies; None without a map."""
        if self.dofs is None or self.static is None or not len(self.B):
            return None
        dofs, U, X = self.dofs, self.parted[0], self.static
        R = np.zeros((dofs.size, 0))
        if dofs.points is not None and not dofs.no_rigid:
            R = dofs.rigid()
        elif dofs.points is None:  # rotations need points
            still = DofMap(dofs.nodes, dofs.components, dofs.labels, np.zeros((dofs.size, 3)))
            R = R if still.no_rigid else still.rigid()[:, :3]
        R = R[:, R.any(axis=0)]
        S = X.T @ self.K @ X
        weight = self.energy_unit(S, X.T @ self.M @ X, R.shape[1])
        weight = np.where(weight > 0, weight, 1.0)
        single = S / np.sqrt(np.outer(weight, weight))
        at = U.T @ R
        size = np.linalg.norm(at, axis=0)
        keep: list[int] = []
        for j in np.flatnonzero(size > 0).tolist():
            if np.linalg.matrix_rank(at[:, [*keep, j]] / size[[*keep, j]], tol=AGREE) > len(keep):
                keep.append(j)
        energy = np.zeros(0)
        if keep and U.shape[1] == len(U):
            q = np.linalg.qr(np.sqrt(weight)[:, None] * at[:, keep])[0]
            energy = np.abs(np.linalg.eigvalsh(q.T @ single @ q))
        return Mapped(at[:, keep], energy, int(np.count_nonzero(np.linalg.eigvalsh(single) <= EQUAL)), R.shape[1] == 6)

    @cached_property
    def body(self) -> Body | None:
        """The mass matrix of the six rigid motions from the DOF map; None unless all six are free.

        `wrong` is its relative difference from [[m I, -m c×], [m c×, J]] of a rigid body. J about the centre c must be possible
        for a body: no principal moment is negative, or larger than the sum of the other two.
        """
        found = self.mapped
        if found is None or not found.whole or len(found.energy) != 6 or (found.energy > EQUAL).any():
            return None
        assert self.dofs is not None and self.dofs.points is not None and self.static is not None
        q = self.static @ found.at
        P = q.T @ self.M @ q
        length, m = float(np.ptp(self.dofs.points, axis=0).max()), float(np.trace(P[:3, :3])) / 3
        if m <= 0:
            return Body(P, m, np.zeros(3), np.inf, length)
        moment = (P[:3, 3:] - P[:3, 3:].T) / 2
        c = np.array([moment[1, 2], moment[2, 0], moment[0, 1]]) / m
        reach = max(length, float(np.sqrt(max(np.trace(P[3:, 3:]), 0.0) / m)))
        arm = np.array([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
        axes = np.linalg.eigvalsh(P[3:, 3:] + m * arm @ arm)  # about the centre
        wrong = (np.abs(P[:3, :3] - m * np.eye(3)).max() / m, np.abs(P[:3, 3:] + P[:3, 3:].T).max() / (2 * m * reach),
                 max(axes[2] - axes[0] - axes[1], -axes[0], 0.0) / (m * reach**2))
        return Body(P, m, c + self.dofs.points.mean(axis=0), float(max(wrong)), length)

    def frequency_bounds(self, count: int) -> FrequencyBounds:
        """Bounds of `count` frequencies of the full model, from the small matrices and the cut-off; see `frequency_bounds`."""
        kinds = np.full(self.size, "constraint", dtype=object)
        kinds[self.modal] = HELD_KIND
        M, K = ((A + A.T) / 2 for A in (self.M, self.K))
        V = np.eye(self.size) if self.V is None else self.V
        rom = ReducedSubstructure(M, K, None, {}, self.name, V=V, kinds=tuple(self.kinds or kinds.tolist()), cutoff=self.cutoff,
                                  rigid_motion=self.carried)
        return frequency_bounds(rom, count)


def coupling(A: Array, some: Array, others: Array) -> float:
    """The largest |a_ij| / √(a_ii a_jj), i among the coordinates `some` and j among `others`."""
    return float(np.abs(by_diagonal(A)[np.ix_(some, others)]).max(initial=0.0))


def off_diagonal(A: Array) -> float:
    """The largest |a_ij| / √(a_ii a_jj), i ≠ j."""
    whole = by_diagonal(A)
    return float(np.abs(whole - np.diag(whole.diagonal())).max(initial=0.0))


def dense(value: Any) -> Array:
    """A dense array of float64."""
    return np.asarray(value.toarray() if sp.issparse(value) else value, dtype=float)
